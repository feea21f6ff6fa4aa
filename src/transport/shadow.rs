//! What passes from a light to a vertex: shadow rays.

use std::convert::Infallible;
use std::ops::ControlFlow;

use smallvec::SmallVec;

use super::events::Events;
use super::flight::pass;
use super::segment::Segment;
use super::surface::Interaction;
use super::walk::{Stop, Visitor, Walk, pass_by_chance};
use crate::math::{DVec3, Ray, Rgb, Stream, error_bound};
use crate::medium::transmittance;
use crate::scene::{Inside, Scene};

/// Remembers the segments on the way, to be paid for once the way is known to be free.
struct Way<'w> {
    segments: SmallVec<[(u32, f64, f64); 4]>,
    /// The share that passes through holes.
    passes: f64,
    stream: &'w mut Stream,
}

impl<'w> Way<'w> {
    fn new(stream: &'w mut Stream) -> Self {
        Way { segments: SmallVec::new(), passes: 1.0, stream }
    }
}

impl Visitor for Way<'_> {
    type End = Infallible;

    fn segment(&mut self, segment: &Segment<'_>) -> ControlFlow<Infallible> {
        self.segments.push((segment.medium, segment.a, segment.b));
        ControlFlow::Continue(())
    }

    /// All of what passes, instead of all by chance; by chance where some passes otherwise, too.
    fn mixture(&mut self, passes: f64, sheets: bool) -> Option<f64> {
        if sheets {
            return pass_by_chance(passes, self.stream);
        }
        self.passes *= passes;
        if passes > 0.0 { None } else { Some(0.0) }
    }
}

/// A piece of a ray from where light is asked for to just before a light.
#[derive(Clone, Copy, Debug)]
pub struct ShadowRay {
    /// The ray.
    pub ray: Ray,
    /// Its length; infinite to lights at infinity.
    pub length: f64,
}

impl ShadowRay {
    /// From `start`, a point or a place just off the surface it lies on, to what arrives at `point` from `distance` away in
    /// `direction`, from a surface with this normal. It ends just off that surface, on the side of `point`, by what rounding may
    /// amount to. Both ends are put off along their normals: had the ray kept its direction from another start, it would meet
    /// the light's surface early, by more than any share of its length if the start is rounded coarsely, as far
    /// away from the camera, and the light is near.
    #[inline]
    pub fn new(start: DVec3, point: DVec3, direction: DVec3, distance: f64, normal: DVec3) -> Self {
        if distance.is_infinite() {
            return ShadowRay { ray: Ray::new(start, direction), length: distance };
        }
        let ray = Ray::new(point, direction);
        let off = error_bound(&ray, distance) * if normal.dot(direction) > 0.0 { -1.0 } else { 1.0 };
        ShadowRay { ray: Ray::new(start, direction), length: 0.0 }.towards(ray.at(distance) + off * normal)
    }

    /// From the same start to another end.
    fn towards(self, end: DVec3) -> Self {
        let way = end - self.ray.origin;
        let direction = way.try_normalize().unwrap_or(self.ray.direction);
        ShadowRay { ray: Ray::new(self.ray.origin, direction), length: way.length() }
    }

    /// To the same end from another start.
    fn from(self, start: DVec3) -> Self {
        let moved = ShadowRay { ray: Ray::new(start, self.ray.direction), ..self };
        if self.length.is_finite() { moved.towards(self.ray.at(self.length)) } else { moved }
    }
}

/// Multiplies `weight` by an unbiased estimate of what passes along a ray that starts inside these solids: through media and
/// index-matched boundaries, straight through `most` sheets, the share that mixtures with holes let pass, nothing through other
/// surfaces. Returns the number of sheets, each of which is an event.
pub fn transmit(
    scene: &Scene,
    shadow: ShadowRay,
    inside: &Inside,
    most: Events,
    weight: &mut Rgb,
    stream: &mut Stream,
) -> u64 {
    let ShadowRay { ray, length: distance } = shadow;
    let mut way = Way::new(stream);
    let mut sheets = 0;
    if scene.solids.is_empty() && !scene.has_holes {
        if scene.geometry.occluded(&ray, 0.0, distance, |id| scene.surfaces[id as usize].material.is_opaque()) {
            *weight = Rgb::ZERO;
            return sheets;
        }
        if let Some(world) = scene.world {
            way.segments.push((world, 0.0, distance));
        }
    } else {
        let mut walk = Walk::new(scene, ray, inside.clone()).until(distance);
        if !walk.is_free() {
            *weight = Rgb::ZERO;
            return sheets;
        }
        if let Stop::Surface(at) = walk.advance(&mut way) {
            sheets = pass_sheets(&mut walk, &at, &mut way, most, weight);
        }
        *weight *= way.passes;
    }
    for (medium, a, b) in way.segments {
        pass(&scene.media[medium as usize], &ray, (a, b), weight, stream);
        if weight.max_element() <= 0.0 {
            break;
        }
    }
    sheets
}

/// Goes on from the first sheet, straight through `most` at most; nothing of `weight` is left if there is another surface in the way.
/// Returns their number.
#[cold]
fn pass_sheets(walk: &mut Walk<'_>, first: &Interaction, way: &mut Way<'_>, most: Events, weight: &mut Rgb) -> u64 {
    let mut sheets = 0;
    let mut pass = |walk: &mut Walk<'_>, at: &Interaction| {
        let passed = at.sheet().filter(|_| most.allows(sheets));
        *weight *= passed.unwrap_or(Rgb::ZERO);
        sheets += 1;
        walk.leave(at, at.incidence.direction);
        passed.is_some()
    };
    let mut goes_on = pass(walk, first);
    while goes_on && let Stop::Surface(at) = walk.advance(way) {
        goes_on = pass(walk, &at);
    }
    sheets
}

/// As [`transmit`], and straight on through refracting boundaries (Jensen 2001, §10.8.2), each of which lets 1 − F of the light
/// pass; `most` of these and of sheets together. Before one beyond which the index is lower, refracted light would have gone another
/// way through the medium: its length takes the place of the straight one (Eq. 10.31).
pub fn transmit_straight(
    scene: &Scene,
    mut shadow: ShadowRay,
    inside: &Inside,
    most: Events,
    weight: &mut Rgb,
    stream: &mut Stream,
) -> u64 {
    let mut inside = inside.clone();
    let mut left = most;
    let mut sheets = 0;
    loop {
        let ShadowRay { ray, length } = shadow;
        let mut way = Way::new(stream);
        let stop = Walk::new(scene, ray, inside).until(length).advance(&mut way);
        let at = match stop {
            Stop::Surface(at) => Some(at),
            _ => None,
        };
        *weight *= way.passes;
        let mut longer = Rgb::ONE;
        if let Some(at) = &at {
            let (Some(straight), Some(fewer)) = (at.bsdf.straight(&at.incidence), left.left_after(1)) else {
                *weight = Rgb::ZERO;
                return sheets;
            };
            left = fewer;
            sheets += u64::from(at.bsdf.is_sheet());
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
                return sheets;
            }
        }
        let Some(at) = at else { return sheets };
        let onward;
        (onward, inside) = at.departure(ray.direction);
        shadow = shadow.from(onward.origin);
    }
}
