//! Photons within a ball around each place looked up.

use std::f64::consts::PI;

use rayon::prelude::*;

use super::cut::{CLOSE, Cutting, Disc, Place, Ways, cutting, stray};
use crate::math::{DVec3, Rgb, Stream};
use crate::photon::sheets::{FACING, FLATTENED};
use crate::photon::simd::LANES;
use crate::photon::{Ball, Kind, Photon, PointMap, PointMemory};
use crate::scene::Scene;
use crate::scene::description::SurfaceFilter;
use crate::transport::Events;

/// Photons of which those count that are within a radius of the place: the distance of the n-th nearest, or the cap, or fixed.
#[derive(Debug)]
pub(super) struct Balls {
    pub(super) map: PointMap,
    /// Whether the radius is narrowed where light has an edge within it.
    checks: bool,
    /// Which photons they are.
    kind: Kind,
    /// By block, what may cut the discs around.
    cuts: Vec<Cutting>,
}

impl Balls {
    /// All radii are `scale` times as wide as `ball` says.
    pub(super) fn build(
        scene: &Scene,
        (kind, photons): (Kind, Vec<Photon>),
        (ball, checks): (Ball, bool),
        scale: f32,
    ) -> Self {
        let map = PointMap::on_surfaces(photons, ball, scale);
        let mut balls = Balls { map, checks, kind, cuts: Vec::new() };
        balls.cuts = (0..balls.map.events.len()).into_par_iter().map(|block| balls.cutting(scene, block)).collect();
        balls
    }

    /// Memory taken, in bytes.
    pub(super) fn bytes(&self) -> usize {
        self.map.bytes() + size_of_val(&*self.cuts)
    }

    /// The irradiance of a place where a photon landed, as its shading normal sees it, the radius over which it is an average, and
    /// whether the disc is cut. All photons count alike: the one that is there for certain then makes up, on average, for the one
    /// that is missing between it and those for whom it is the nearest. With a cone, light were 1 % too bright, and without that photon
    /// 3 % too dark.
    pub(super) fn irradiance(
        &self,
        scene: &Scene,
        place: Place,
        stream: &mut Stream,
        memory: &mut PointMemory,
    ) -> (Rgb, f32, bool) {
        let mut sum = Rgb::ZERO;
        let all = (Events::unlimited(), SurfaceFilter::None, f64::INFINITY);
        let area = self.around(scene, place, all, stream, memory, |_, _, power| sum += power);
        area.map_or((Rgb::ZERO, 0.0, true), |(area, cut)| (sum / area, (area / PI).sqrt() as f32, cut))
    }

    /// Tells `photon` from where and with what power photons landed around a place that is looked at from so far, each counted as the
    /// filter says. Returns the area they landed on, and whether it is cut; `None` where there are none.
    pub(super) fn around(
        &self,
        scene: &Scene,
        place: Place,
        (most, filter, came): (Events, SurfaceFilter, f64),
        stream: &mut Stream,
        memory: &mut PointMemory,
        mut photon: impl FnMut(&mut Stream, DVec3, Rgb),
    ) -> Option<(f64, bool)> {
        if !self.map.bounds().contains(place.point) {
            return None;
        }
        let (x, normal) = (place.point.as_vec3(), place.normal.as_vec3());
        let mut squared = self.map.look_up(x, memory);
        let lanes = || memory.blocks().iter().flat_map(|&block| (0..LANES).map(move |lane| (block as usize, lane)));
        let most = most.in_a_byte();
        let counts = |block: usize, lane: usize, squared: f32| {
            let height = FLATTENED * squared.sqrt();
            let offset = self.map.place(block, lane) - x;
            let distance = offset.length_squared();
            // Lanes without a photon are infinitely far, or not a number.
            let near = distance < squared && offset.dot(normal).abs() <= height;
            if !near || self.map.events[block][lane] > most {
                return None;
            }
            let facing = self.map.normals[block][lane].unpacked().dot(normal);
            (facing >= FACING).then_some((offset, distance, facing))
        };

        // As far as light is even.
        if self.checks {
            let mut rings = Rings::default();
            for (block, lane) in lanes() {
                if let Some((_, distance, facing)) = counts(block, lane, squared) {
                    let (_, power) = self.map.loads[block].of(lane);
                    let ring = (distance / squared * RINGS as f32) as usize;
                    let (ring, power) = (&mut rings[ring.min(RINGS - 1)], power.element_sum() * f64::from(facing));
                    *ring = [ring[0] + power, ring[1] + power * power];
                }
            }
            squared *= even_share(&rings);
        }

        // Whether some lie on a surface that is separate, as the one may that strays most; or any says that discs here may be cut.
        let radius = f64::from(squared.sqrt());
        let close = came < CLOSE * radius;
        let one = close.then(|| self.apart(scene, place, squared, memory)).flatten();
        let is_one = one.is_some();
        let cutting = match one {
            Some(_) => Cutting { walls: true, edges: true },
            None => self.cutting_around(memory, |block, lane| counts(block, lane, squared).is_some()),
        };
        let disc = one.or_else(|| cutting.any().then(|| Disc::new(place, radius, stream.uniform())));
        let ways = disc.as_ref().filter(|_| !is_one).map(|disc| match cutting.walls {
            true => disc.ways(scene, place),
            false => Ways::all_free(radius),
        });

        let mut found = false;
        for (block, lane) in lanes() {
            let Some((offset, distance, facing)) = counts(block, lane, squared) else { continue };
            let (direction, power) = self.map.loads[block].of(lane);
            let reached = || match (&disc, &ways) {
                (Some(disc), Some(ways)) => disc.reaches(scene, place, ways, offset.as_dvec3()),
                (Some(disc), None) => disc.is_joined(scene, place, offset.as_dvec3()),
                (None, _) => true,
            };
            if -direction.dot(place.normal) <= 0.0 || !reached() {
                continue;
            }
            found = true;
            // Of a slope, the area is counted that the tangent plane sees.
            let weight = f64::from(filter.weight(distance / squared) * facing);
            photon(stream, -direction, power * weight);
        }
        let share = || match (&disc, &ways) {
            (Some(_), Some(ways)) if !cutting.edges => ways.share(filter),
            (Some(disc), ways) => disc.share(scene, place, ways.as_ref(), (filter, self.kind)),
            (None, _) => 1.0,
        };
        found.then(|| (PI * radius * radius * share(), cutting.any()))
    }

    /// What may cut the disc on which those photons lie that count.
    fn cutting_around(&self, memory: &PointMemory, counts: impl Fn(usize, usize) -> bool) -> Cutting {
        let mut cutting = Cutting::default();
        for &block in memory.blocks() {
            let (block, more) = (block as usize, cutting.or(self.cuts[block as usize]));
            if more != cutting && (0..LANES).any(|lane| counts(block, lane)) {
                cutting = more;
            }
        }
        cutting
    }

    /// The disc around a place whose photons are to be of one surface, if not all of those within a squared radius are: if the one that strays
    /// most is not.
    #[cold]
    fn apart(&self, scene: &Scene, place: Place, squared: f32, memory: &PointMemory) -> Option<Disc> {
        let (x, normal) = (place.point.as_vec3(), place.normal.as_vec3());
        let strays = |(block, lane): (usize, usize)| {
            let (offset, own) = (self.map.place(block, lane) - x, self.map.normals[block][lane].unpacked());
            let near = offset.length_squared() < squared && offset.dot(normal).abs() <= FLATTENED * squared.sqrt();
            (near && own.dot(normal) >= FACING).then(|| (stray(offset, [normal, own]), offset))
        };
        let lanes = memory.blocks().iter().flat_map(|&block| (0..LANES).map(move |lane| (block as usize, lane)));
        let (_, offset) = lanes.filter_map(strays).max_by(|a, b| a.0.total_cmp(&b.0))?;
        let disc = Disc::of_one_surface(scene, place, squared.sqrt().into());
        (!disc.is_joined(scene, place, offset.as_dvec3())).then_some(disc)
    }

    /// What may cut the discs around one photon of a block, by what probes on a wider rim say.
    fn cutting(&self, scene: &Scene, block: usize) -> Cutting {
        let point = self.map.place(block, 0);
        let mut memory = PointMemory::default();
        let radius = f64::from(1.25 * self.map.look_up(point, &mut memory).sqrt() + self.map.half(block));
        let normal = self.map.normals[block][0].unpacked().as_dvec3();
        cutting(scene, Place { point: point.as_dvec3(), normal }, radius, self.kind)
    }
}

/// Rings of equal area, from the middle of a disc outwards, in which its light is looked at for an edge.
const RINGS: usize = 16;
/// So many rings are kept in any case.
const KEPT: usize = 4;
/// Light has an edge where what lands beyond differs from what lands within by more than so many standard errors of the difference, both by
/// area: of even light, one disc of 80 photons in sixteen seems to have one.
const SURE: f64 = 3.0;

/// What lands on rings: power, and the sum of its photons' squares.
type Rings = [[f64; 2]; RINGS];

/// The share of a disc's area, from its middle outwards, in which light is even: up to the ring where the difference between light within and
/// beyond is the surest. It is differential checking (Jensen 2001, §7.4.3), which no longer adds photons where the estimate only rises or
/// only falls as they are, by a test.
fn even_share(rings: &Rings) -> f32 {
    let sum =
        |rings: &[[f64; 2]]| rings.iter().fold([0.0; 2], |[power, square], ring| [power + ring[0], square + ring[1]]);
    let [power, square] = sum(rings);
    let (mut within, mut best) = (sum(&rings[..KEPT]), (SURE * SURE, RINGS));
    for (ring, [power_here, square_here]) in rings.iter().enumerate().skip(KEPT) {
        let (area, rest) = (ring as f64, (RINGS - ring) as f64);
        let difference = within[0] / area - (power - within[0]) / rest;
        let variance = within[1] / area.powi(2) + (square - within[1]) / rest.powi(2);
        if difference.powi(2) > best.0 * variance {
            best = (difference.powi(2) / variance, ring);
        }
        within = [within[0] + power_here, within[1] + square_here];
    }
    best.1 as f32 / RINGS as f32
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Rings are kept as far as light is even, be it brighter beyond or darker; all of them where the difference may be chance.
    #[test]
    fn light_is_even_up_to_its_edges() {
        let share = |edge: usize, within: f64, beyond: f64| {
            even_share(&std::array::from_fn(|ring| [if ring < edge { within } else { beyond }; 2]))
        };
        for (edge, expected) in [(0, 1.0), (4, 0.25), (6, 0.375), (8, 0.5), (12, 0.75), (16, 1.0)] {
            for (within, beyond) in [(6.0, 1.0), (1.0, 6.0)] {
                assert_eq!(share(edge, within, beyond), expected, "{within} up to {edge}, then {beyond}");
            }
            assert_eq!(share(edge, 5.0, 4.0), 1.0, "up to {edge}");
            assert_eq!(share(edge, 0.0, 0.0), 1.0);
        }
        assert!(share(8, 0.0, 5.0) <= 0.5);
    }
}
