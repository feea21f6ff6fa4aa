//! What passes from a light to a vertex: shadow rays.

use std::convert::Infallible;
use std::ops::ControlFlow;

use smallvec::SmallVec;

use super::events::Events;
use super::flight::pass;
use super::segment::Segment;
use super::walk::{Stop, Visitor, Walk};
use crate::math::{Ray, Rgb, Stream};
use crate::medium::transmittance;
use crate::scene::{Inside, Scene};

/// Remembers the segments on the way, to be paid for once the way is known to be free.
#[derive(Default)]
struct Way {
    segments: SmallVec<[(u32, f64, f64); 4]>,
}

impl Visitor for Way {
    type End = Infallible;

    fn segment(&mut self, segment: &Segment<'_>) -> ControlFlow<Infallible> {
        self.segments.push((segment.medium, segment.a, segment.b));
        ControlFlow::Continue(())
    }
}

/// Multiplies `weight` by an unbiased estimate of what passes along `ray`, which starts inside these
/// solids, up to `distance`: through media and index-matched boundaries, nothing through surfaces.
pub fn transmit(scene: &Scene, ray: Ray, inside: &Inside, distance: f64, weight: &mut Rgb, stream: &mut Stream) {
    // The light's own surface does not block it.
    let distance = distance * (1.0 - 1e-9);
    let mut way = Way::default();
    if scene.solids.is_empty() {
        if scene.geometry.occluded(&ray, 0.0, distance, |id| scene.surfaces[id as usize].material.is_opaque()) {
            *weight = Rgb::ZERO;
            return;
        }
        if let Some(world) = scene.world {
            way.segments.push((world, 0.0, distance));
        }
    } else {
        let mut walk = Walk::new(scene, ray, inside.clone()).until(distance);
        if let Stop::Surface(_) = walk.advance(&mut way) {
            *weight = Rgb::ZERO;
            return;
        }
    }
    for (medium, a, b) in way.segments {
        pass(&scene.media[medium as usize], &ray, (a, b), weight, stream);
        if weight.max_element() <= 0.0 {
            return;
        }
    }
}

/// As [`transmit`], and straight on through `most` refracting boundaries (Jensen 2001, §10.8.2), each of which
/// lets 1 − F of the light pass. Before one beyond which the index is lower, refracted light would have gone another
/// way through the medium: its length takes the place of the straight one (Eq. 10.31).
pub fn transmit_straight(
    scene: &Scene,
    ray: Ray,
    inside: &Inside,
    distance: f64,
    most: Events,
    weight: &mut Rgb,
    stream: &mut Stream,
) {
    let mut rest = distance * (1.0 - 1e-9);
    let (mut ray, mut inside) = (ray, inside.clone());
    let mut left = most;
    loop {
        let mut way = Way::default();
        let stop = Walk::new(scene, ray, inside).until(rest).advance(&mut way);
        let at = match stop {
            Stop::Surface(at) => Some(at),
            _ => None,
        };
        let mut longer = Rgb::ONE;
        if let Some(at) = &at {
            let (Some(straight), Some(fewer)) = (at.bsdf.straight(&at.incidence), left.left_after(1)) else {
                *weight = Rgb::ZERO;
                return;
            };
            left = fewer;
            *weight *= straight.passed;
            longer = straight.longer;
        }
        for (medium, a, b) in way.segments {
            let medium = &scene.media[medium as usize];
            if longer == Rgb::ONE {
                pass(medium, &ray, (a, b), weight, stream);
            } else {
                *weight *= transmittance(medium.extinction * longer, medium.density.depth(&ray, a, b));
            }
            if weight.max_element() <= 0.0 {
                return;
            }
        }
        let Some(at) = at else { return };
        rest -= at.t;
        (ray, inside) = at.departure(ray.direction);
    }
}
