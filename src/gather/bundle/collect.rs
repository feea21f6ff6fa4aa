//! The walk through the hierarchy that collects the photons near all groups of a bundle.

#![allow(
    clippy::needless_range_loop,
    reason = "iterators' closures need not be inlined into a kernel's instruction set"
)]

use super::group::Group;
use super::lines::{Around, AroundLanes, Line, Lines, Part, Towards, around, bound, offsets, rows, square};
use super::photons::{Collected, WALLS};
use super::rays::Bundle;
use crate::gather::beam::Listing;
use crate::gather::sampled::VECTORS;
use crate::math::{DVec3, Frame};
use crate::photon::discs::PhotonMap;
use crate::photon::simd::{Lanes, Task, at_most, dot_plus, load3, splat3};
use crate::photon::store::{Meets, Node};
use smallvec::SmallVec;

/// The slope up to which a bundle is walked as one.
const WIDE: f64 = 0.7;

/// All that a bundle may meet.
pub(super) struct Cone {
    axes: [[f32; 3]; 3],
    offset: [f32; 3],
    around: Around,
    any: [f32; 2],
}

impl Cone {
    /// `None` if the rays are too far apart, or there are none.
    pub(super) fn around(
        map: &PhotonMap,
        bundle: &Bundle<'_>,
        groups: &[Group],
        lines: &mut Vec<Lines>,
    ) -> Option<Cone> {
        let towards = groups.iter().fold(Towards::NOWHERE, |all, group| all.merge(&group.towards));
        let (frame, origin, pinhole) = towards.middle(map)?;
        let (around, any) = if pinhole {
            Self::of_axes(&frame, groups)?
        } else {
            let mut any = [f64::INFINITY, f64::NEG_INFINITY];
            lines.clear();
            for group in groups {
                let rays = &bundle.rays[group.first..group.first + group.count];
                let some = Lines::new(rays, &frame, origin, group.farthest);
                if Lines::extremes(&some.cos).0 < Line::LEAST_COS {
                    return None;
                }
                any = [any[0].min(Lines::extremes(&some.start).0), any[1].max(Lines::extremes(&some.end).1)];
                lines.push(some);
            }
            let parts: SmallVec<[Part<'_>; VECTORS]> =
                lines.iter().zip(groups).map(|(lines, group)| lines.some(0..group.count)).collect();
            (around(&parts), any)
        };
        (f64::from(around.widening) <= WIDE || groups.len() == 1).then(|| Cone {
            axes: rows(&frame),
            offset: offsets(&frame, origin),
            around,
            any: any.map(bound),
        })
    }

    /// The cone of groups that come from the frame's origin, each a cone around an axis, and its range.
    fn of_axes(frame: &Frame, groups: &[Group]) -> Option<(Around, [f64; 2])> {
        let mut mean = [0.0; 2];
        for group in groups {
            let line = Line::new(group.axis, DVec3::ZERO, (0.0, 0.0), frame);
            if line.cos < Line::LEAST_COS {
                return None;
            }
            for axis in 0..2 {
                mean[axis] += line.slope[axis] / groups.len() as f64;
            }
        }
        let (mut widening, mut any) = (0.0f64, [f64::INFINITY, f64::NEG_INFINITY]);
        for group in groups {
            let line = Line::new(group.axis, DVec3::ZERO, (0.0, 0.0), frame);
            // What leans by w from an axis of slope s has at most the slope (s + w)/(1 − s w).
            let (lean, slope) = (f64::from(group.around.steepest()), line.square().sqrt());
            let more = lean * (1.0 + line.square()) / (1.0 - slope * lean);
            let apart = square([line.slope[0] - mean[0], line.slope[1] - mean[1]]).sqrt();
            widening = widening.max(apart + more);
            let aside = lean * slope * line.cos;
            let (start, end) = (f64::from(group.any[0]), group.last);
            for z in [line.cos - aside, line.cos + aside] {
                any = [any[0].min(start * z), any[1].max(end * z)];
            }
        }
        Some((Around::new([0.0; 2], mean, 0.0, widening), any))
    }
}

/// A [`Cone`] in lanes.
struct ConeLanes<L> {
    axes: [[L; 3]; 3],
    offset: [L; 3],
    around: AroundLanes<L>,
    first: L,
    last: L,
}

impl Cone {
    #[inline(always)]
    fn lanes<L: Lanes>(&self) -> ConeLanes<L> {
        ConeLanes {
            axes: [splat3(self.axes[0]), splat3(self.axes[1]), splat3(self.axes[2])],
            offset: splat3(self.offset),
            around: self.around.lanes(),
            first: L::splat(self.any[0]),
            last: L::splat(self.any[1]),
        }
    }
}

impl<L: Lanes> ConeLanes<L> {
    /// Which spheres it meets.
    #[inline(always)]
    fn meets(&self, x: &[L; 3], r: L) -> u16 {
        let a = dot_plus(x, &self.axes[0], self.offset[0]);
        let b = dot_plus(x, &self.axes[1], self.offset[1]);
        let z = dot_plus(x, &self.axes[2], self.offset[2]);
        let between = L::and(self.first.less(z.add(r)), z.sub(r).less(self.last));
        L::bits(L::and(self.around.meets(a, b, z, r), between))
    }
}

/// How many blocks ahead to fetch.
const AHEAD: usize = 6;

impl<L: Lanes> Meets<Node> for ConeLanes<L> {
    #[inline(always)]
    fn children(&self, node: &Node) -> u16 {
        self.meets(&load3(&node.center), L::load(&node.radius))
    }
}

/// The walk that collects the photons near a bundle.
pub(super) struct Collect<'a, F> {
    pub(super) map: &'a PhotonMap,
    pub(super) cone: &'a Cone,
    pub(super) max_events: u8,
    pub(super) near: &'a mut [Option<Collected>; 2 * (WALLS + 1)],
    pub(super) serve: &'a mut F,
}

/// Photons are of one kind if they had an event before or not, and by the number of walls: kind/2.
fn kind(events: bool, walls: usize) -> usize {
    2 * walls + usize::from(events)
}

impl<F: FnMut(usize, &mut Collected)> Task for Collect<'_, F> {
    /// Nodes visited.
    type Output = u64;

    #[inline(always)]
    fn run<L: Lanes>(self) -> u64 {
        let Collect { map, cone, max_events, near, serve } = self;
        let cone = cone.lanes::<L>();

        let mut listing = Listing::new(map);
        while listing.goes_on() {
            let listed = listing.fill::<L>(&cone);
            for i in 0..listed.min(AHEAD) {
                map.blocks.prefetch(listing.block(i));
            }
            for i in 0..listed {
                map.blocks.prefetch(listing.block((i + AHEAD).min(listed - 1)));
                let index = listing.block(i);
                let block = map.blocks.get(index);
                let x = load3(block.position);
                let inverse_square = L::load(block.inverse_square);
                let mut bits = cone.meets(&x, inverse_square.rsqrt());
                let mut first_events = 0;
                if let Some(events) = map.events.get(index) {
                    first_events = at_most(events, 0);
                    bits &= at_most(events, max_events);
                }
                if bits == 0 {
                    continue;
                }
                let walls = map.walls(index);
                for layer in 0..=walls.len().min(WALLS) {
                    // Layers are filled in order: those with no wall in the next are done.
                    let more = walls
                        .get(layer)
                        .map_or(0, |wall| L::bits(L::load(&wall.distance).less(L::splat(f32::INFINITY))));
                    let here = bits & !more;
                    bits &= more;
                    for (events, some) in [(false, here & first_events), (true, here & !first_events)] {
                        if some == 0 {
                            continue;
                        }
                        let kind = kind(events, layer);
                        let near = near[kind].get_or_insert_with(|| Collected::new(layer));
                        near.write(&x, inverse_square, &block.power.map(L::load), some);
                        if let Some(direction) = block.direction {
                            near.write_direction(&load3::<L>(direction), some);
                        }
                        for (number, wall) in walls[..layer].iter().enumerate() {
                            near.write_wall(number, &load3(&wall.normal), L::load(&wall.distance), some);
                        }
                        if near.advance(some) {
                            serve(kind, near);
                        }
                    }
                }
            }
        }
        listing.nodes()
    }
}
