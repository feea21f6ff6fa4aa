//! What is asked for light: lights, or triangles of them, and how one is chosen.

use super::extent::Extent;
use super::tree::{Cut, ToSegment, Tree};
use super::{Light, Receiver};
use crate::geometry::{Geometry, Hit};
use crate::math::{DVec3, Ray, choose};

/// What is asked for light: a light, or a triangle of one that is a mesh.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Emitter {
    /// The light: an index into [`Scene::lights`](crate::scene::Scene::lights).
    pub light: u32,
    /// The triangle, where not all of the light is asked.
    pub triangle: Option<u32>,
}

/// How many emitters are weighed one by one, which is exact; of more there is a tree.
pub const FEW: usize = 16;

/// Meshes of more triangles are asked as wholes: the tree takes 200 bytes for each.
const MOST_TRIANGLES: u32 = 1 << 18;

/// All emitters of a scene.
#[derive(Debug, Default)]
pub struct Emitters {
    /// The lights that shine from infinity, by index.
    infinite: Vec<u32>,
    /// Of many emitters.
    many: Option<Many>,
}

#[derive(Debug)]
struct Many {
    /// The lights that do not thin with the square of the distance: from infinity, and beams. These are weighed one by one.
    outside: Vec<u32>,
    /// The others, in the order of lights, then of triangles.
    emitters: Vec<Emitter>,
    /// By light, the index of its first emitter; `NONE` of those outside.
    first: Vec<u32>,
    tree: Tree,
}

const NONE: u32 = u32::MAX;

impl Emitters {
    /// The emitters of these lights.
    pub fn new(lights: &[Light], geometry: &Geometry) -> Self {
        let infinite = (0..).zip(lights).filter(|(_, light)| light.is_infinite()).map(|(index, _)| index).collect();
        let mut many =
            Many { outside: Vec::new(), emitters: Vec::new(), first: Vec::new(), tree: Tree::new([].into_iter()) };
        for (light, kind) in (0..).zip(lights) {
            if !kind.thins() {
                many.outside.push(light);
                many.first.push(NONE);
                continue;
            }
            many.first.push(many.emitters.len() as u32);
            let triangles = match kind {
                Light::Area(area) => geometry.triangles(area.shape).filter(|count| *count <= MOST_TRIANGLES),
                _ => None,
            };
            match triangles {
                Some(count) => many.emitters.extend((0..count).map(|i| Emitter { light, triangle: Some(i) })),
                None => many.emitters.push(Emitter { light, triangle: None }),
            }
        }
        if many.emitters.len() <= FEW {
            return Emitters { infinite, many: None };
        }
        let extent = |emitter: &Emitter| Extent::of(*emitter, &lights[emitter.light as usize], geometry);
        many.tree = Tree::new(many.emitters.iter().map(extent));
        Emitters { infinite, many: Some(many) }
    }

    /// How many are in a tree, if there are so many.
    pub fn in_tree(&self) -> Option<usize> {
        self.many.as_ref().map(|many| many.emitters.len())
    }

    /// The lights that shine from infinity, by index.
    pub fn infinite(&self) -> &[u32] {
        &self.infinite
    }

    /// The emitter that a ray meets on a light's surface.
    #[inline]
    pub fn at(&self, light: u32, hit: &Hit) -> Emitter {
        let triangle = self.many.as_ref().and_then(|many| many.triangle(light, hit.primitive));
        Emitter { light, triangle }
    }

    /// Draws an emitter for a receiver, by how much light each might send there; with the probability of that. Where there are few,
    /// and of lights outside the tree, its normal does not count.
    #[inline]
    pub fn draw(&self, lights: &[Light], receiver: &Receiver, u: impl FnOnce() -> f64) -> Option<(Emitter, f64)> {
        if let Some(many) = &self.many {
            return many.draw(lights, receiver, u());
        }
        if let [_] = lights {
            return Some((Emitter { light: 0, triangle: None }, 1.0));
        }
        let p = receiver.point;
        let total: f64 = lights.iter().map(|light| light.importance(p)).sum();
        if total.is_nan() || total <= 0.0 {
            return None;
        }
        let choice = choose(lights.iter().map(|light| light.importance(p)), total, u())?;
        Some((Emitter { light: choice.index as u32, triangle: None }, choice.probability))
    }

    /// The probability with which [`Emitters::draw`] draws this one.
    #[inline]
    pub fn probability(&self, lights: &[Light], emitter: Emitter, receiver: &Receiver) -> f64 {
        if let Some(many) = &self.many {
            return many.probability(lights, emitter, receiver);
        }
        if let [_] = lights {
            return 1.0;
        }
        let p = receiver.point;
        let total: f64 = lights.iter().map(|light| light.importance(p)).sum();
        if total > 0.0 { lights[emitter.light as usize].importance(p) / total } else { 0.0 }
    }

    /// What draws emitters for pieces of rays, where there are many.
    pub(crate) fn along(&self, ray: &Ray, range: (f64, f64), reach: f64) -> Option<Along<'_>> {
        self.many.as_ref().map(|many| Along { many, cut: many.tree.to_segment(ray, range, reach) })
    }

    /// Whether there are any that these may draw, where there are many.
    pub(crate) fn are_any_along(&self, ray: &Ray, range: (f64, f64), reach: f64) -> Option<bool> {
        self.many.as_ref().map(|many| many.tree.is_any_near(ray, range, reach))
    }
}

impl Many {
    /// As [`Emitters::draw`].
    fn draw(&self, lights: &[Light], receiver: &Receiver, u: f64) -> Option<(Emitter, f64)> {
        let within = self.tree.to_point(receiver);
        if self.outside.is_empty() {
            let (emitter, probability) = within.draw(u)?;
            return Some((self.emitters[emitter as usize], probability));
        }
        let weights = || self.outside(lights, receiver.point).chain([within.irradiance()]);
        let choice = choose(weights(), weights().sum(), u)?;
        if let Some(&light) = self.outside.get(choice.index) {
            return Some((Emitter { light, triangle: None }, choice.probability));
        }
        let (emitter, probability) = within.draw(choice.rest)?;
        Some((self.emitters[emitter as usize], choice.probability * probability))
    }

    /// As [`Emitters::probability`].
    fn probability(&self, lights: &[Light], emitter: Emitter, receiver: &Receiver) -> f64 {
        let (within, index) = (self.tree.to_point(receiver), self.index(emitter));
        if self.outside.is_empty() {
            return index.map_or(0.0, |index| within.probability(index));
        }
        let total: f64 = self.outside(lights, receiver.point).chain([within.irradiance()]).sum();
        if total.is_nan() || total <= 0.0 {
            return 0.0;
        }
        match index {
            None => lights[emitter.light as usize].importance(receiver.point) / total,
            Some(index) => within.irradiance() / total * within.probability(index),
        }
    }

    fn triangle(&self, light: u32, primitive: u32) -> Option<u32> {
        self.emitters.get(self.first[light as usize] as usize)?.triangle.map(|_| primitive)
    }

    /// Where an emitter of the tree is in the list.
    fn index(&self, emitter: Emitter) -> Option<u32> {
        let first = self.first[emitter.light as usize];
        (first != NONE).then(|| first + emitter.triangle.unwrap_or(0))
    }

    /// What the lights outside of the tree may bring, one by one.
    fn outside<'l>(&'l self, lights: &'l [Light], p: DVec3) -> impl Iterator<Item = f64> + 'l {
        self.outside.iter().map(move |&light| lights[light as usize].importance(p))
    }
}

/// What draws emitters for a piece of a ray: those near it, by their intensity over the square of their distance.
pub(crate) struct Along<'e> {
    many: &'e Many,
    cut: Cut<'e, ToSegment>,
}

impl Along<'_> {
    /// Draws one, with the probability of that.
    pub fn draw(&self, u: f64) -> Option<(Emitter, f64)> {
        let (emitter, probability) = self.cut.draw(u)?;
        Some((self.many.emitters[emitter as usize], probability))
    }

    /// The probability with which [`Along::draw`] draws this one.
    pub fn probability(&self, emitter: Emitter) -> f64 {
        self.many.index(emitter).map_or(0.0, |index| self.cut.probability(index))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{Mesh, Placed, Shape};
    use crate::light::{Area, Directional, Directivity, Environment, Point, Sides, SoftCone, Spot};
    use crate::math::random::Purpose;
    use crate::math::{DAffine3, Rgb, Stream, Vec3, sampling};
    use std::f64::consts::PI;
    use std::sync::Arc;

    /// Points of all powers, some of them at one place and one dark; spots; a ball of triangles that shines outwards, pressed and
    /// turned, one that shines inwards, a sky, and a beam.
    fn many() -> (Vec<Light>, Geometry) {
        let mut stream = Stream::new(11, Purpose::Test, 0, 0);
        let mut lights = vec![Light::Environment(Environment::constant(Rgb::splat(0.05)))];
        for i in 0..60 {
            let position = DVec3::from_array([0; 3].map(|_| 8.0 * stream.uniform() - 4.0));
            let position = if i % 10 == 0 { DVec3::ONE } else { position };
            let intensity = Rgb::splat(if i == 7 { 0.0 } else { 10f64.powf(3.0 * stream.uniform() - 3.0) });
            if i % 2 == 0 {
                lights.push(Light::Point(Point { position, intensity }));
            } else {
                let axis = sampling::sphere(stream.uniform2()).normalize();
                let outer = [0.01, 0.3, 1.5][i % 3];
                let cone = SoftCone::new(axis, stream.uniform() * outer, outer);
                lights.push(Light::Spot(Spot { position, intensity, cone }));
            }
        }
        let (direction, beam) = (DVec3::X, Some((DVec3::new(-9.0, 0.0, 0.0), 2.0)));
        lights.push(Light::Directional(Directional { direction, irradiance: Rgb::ONE, cone: 0.0, beam }));
        let pressed = DAffine3::from_translation(DVec3::new(0.0, 0.0, -5.0))
            * DAffine3::from_rotation_x(0.7)
            * DAffine3::from_scale(DVec3::new(1.0, -0.4, 2.0));
        let around = DAffine3::from_scale(DVec3::splat(6.0));
        let mesh = Arc::new(ball());
        let places = [pressed, around].map(|place| Placed::new(Shape::Mesh(mesh.clone()), place).unwrap());
        let geometry = Geometry::new(places.into());
        for (shape, sides) in [(0, Sides::Out), (1, Sides::In)] {
            let (area, bounds) = (geometry.area(shape), geometry.bounds(shape));
            let shine = (Directivity::Diffuse(Rgb::splat(0.1)), sides);
            lights.push(Light::Area(Area::new(shape, shine, area, bounds)));
        }
        (lights, geometry)
    }

    fn ball() -> Mesh {
        const N: u32 = 12;
        let place = |i: u32| {
            let (a, b) = (PI * f64::from(i / N) / f64::from(N - 1), 2.0 * PI * f64::from(i % N) / f64::from(N));
            DVec3::new(a.sin() * b.cos(), a.sin() * b.sin(), a.cos()).as_vec3()
        };
        let positions: Vec<Vec3> = (0..N * N).map(place).collect();
        let quads = (0..(N - 1) * N).map(|i| [i, i / N * N + (i + 1) % N, (i / N + 1) * N + (i + 1) % N, i + N]);
        Mesh::new(positions, quads.flat_map(|[a, b, c, d]| [[a, d, c], [a, c, b]]).collect(), false).unwrap()
    }

    /// Places all around: among the lights, on some, and far away.
    fn places() -> Vec<DVec3> {
        let mut stream = Stream::new(12, Purpose::Test, 0, 0);
        let mut places = vec![DVec3::ZERO, DVec3::ONE, DVec3::new(0.0, 0.0, -5.0)];
        for size in [1e-6, 0.3, 5.0, 5.0, 5.0, 5.0, 20.0, 1e3, 1e6, 1e12] {
            places.push(DVec3::ONE + size * sampling::sphere(stream.uniform2()));
            places.push(size * sampling::sphere(stream.uniform2()));
        }
        places
    }

    /// Those who receive light there: from all around, and from one side.
    fn receivers(point: DVec3) -> [Receiver; 2] {
        let normal = DVec3::new(point.y, 0.3, point.x).normalize();
        [Receiver::around(point), Receiver { point, normal }]
    }

    fn all(lights: &[Light], emitters: &Emitters) -> Vec<Emitter> {
        let many = emitters.many.as_ref().expect("there are many");
        assert!(many.emitters.len() > 500 && many.outside.len() == 2, "{} lights", lights.len());
        let outside = many.outside.iter().map(|&light| Emitter { light, triangle: None });
        outside.chain(many.emitters.iter().copied()).collect()
    }

    /// Each is drawn for the share of random numbers that is its probability, to the digit the same that is told for it; the rest
    /// finds nothing.
    #[test]
    fn draws_follow_probabilities() {
        const N: usize = 30_000;
        let (lights, geometry) = many();
        let emitters = Emitters::new(&lights, &geometry);
        let all = all(&lights, &emitters);
        for (at, p) in places().into_iter().enumerate() {
            let ray = Ray::new(p, (DVec3::new(0.3, 0.1, 0.2) - p).normalize_or(DVec3::Z));
            let along = emitters.along(&ray, (0.1, [5.0, f64::INFINITY][at % 2]), [0.5, 3.0][at / 2 % 2]).unwrap();
            let receiver = receivers(p)[at % 2];
            let to_point = |u| emitters.draw(&lights, &receiver, || u);
            let to_segment = |u| along.draw(u);
            let point = |emitter| emitters.probability(&lights, emitter, &receiver);
            let segment = |emitter| along.probability(emitter);
            type Draw<'a> = &'a dyn Fn(f64) -> Option<(Emitter, f64)>;
            let ways: [(Draw, &dyn Fn(Emitter) -> f64); 2] = [(&to_point, &point), (&to_segment, &segment)];
            for (way, (draw, probability)) in ways.into_iter().enumerate() {
                let mut counts = vec![0usize; all.len()];
                for i in 0..N {
                    let Some((emitter, told)) = draw((i as f64 + 0.5) / N as f64) else { continue };
                    assert_eq!(told, probability(emitter), "{way}, {p}: {emitter:?}");
                    counts[all.iter().position(|other| *other == emitter).unwrap()] += 1;
                }
                let mut sum = 0.0;
                for (emitter, count) in all.iter().zip(counts) {
                    let expected = probability(*emitter);
                    sum += expected;
                    let off = (count as f64 - N as f64 * expected).abs();
                    assert!(off <= 2.0, "{way}, {p}: {emitter:?} was drawn {count} times, not {}", N as f64 * expected);
                }
                assert!(sum < 1.0 + 1e-9, "{way}, {p}: {sum}");
                assert!(way == 1 || sum > 0.7, "{p}: {} of all draws find nothing", 1.0 - sum);
            }
        }
    }

    /// Whoever sends light to a place may be drawn there: at the edges of cones, and over triangles seen almost along their plane.
    #[test]
    fn no_light_is_left_out() {
        let (lights, geometry) = many();
        let emitters = Emitters::new(&lights, &geometry);
        let all = all(&lights, &emitters);
        let mut stream = Stream::new(13, Purpose::Test, 0, 0);
        let mut places = places();
        for light in &lights {
            if let Light::Spot(spot) = light {
                for _ in 0..20 {
                    let (way, far) = (spot.cone.sample([1.0 - 1e-4, stream.uniform()]), stream.uniform());
                    places.push(spot.position + 10f64.powf(far) * way);
                }
            }
        }
        for triangle in 0..240 {
            let Some((corners, normal)) = geometry.triangle(0, triangle) else { continue };
            let beside = corners[0] + 0.7 * (corners[1] - corners[2]);
            places.push(beside + 1e-3 * stream.uniform() * normal);
        }
        let mut found = 0;
        for p in places {
            for emitter in &all {
                let light = &lights[emitter.light as usize];
                let Some(arrival) = light.arrive(&geometry, emitter.triangle, p, &mut stream) else { continue };
                if arrival.radiance.max_element() > 0.0 {
                    found += 1;
                    for receiver in receivers(p) {
                        assert!(emitters.probability(&lights, *emitter, &receiver) > 0.0, "{receiver:?}: {emitter:?}");
                    }
                }
            }
        }
        assert!(found > 50_000, "{found}");
    }

    /// How much noisier light is that is asked for so, than if every light were chosen exactly by its irradiance: Σe²/q over
    /// (Σe)². In a medium, and on surfaces that look anywhere.
    #[test]
    fn choices_are_near_the_best() {
        let mut stream = Stream::new(14, Purpose::Test, 0, 0);
        let lights: Vec<Light> = (0..1000)
            .map(|i| {
                let position = 10.0 * DVec3::new(stream.uniform(), stream.uniform(), 0.3 * stream.uniform());
                let intensity = Rgb::splat(10f64.powf(stream.uniform()));
                let axis = DVec3::new(stream.uniform() - 0.5, stream.uniform() - 0.5, -1.0).normalize();
                let cone = SoftCone::new(axis, 0.4, 0.8);
                if i % 2 == 0 {
                    Light::Point(Point { position, intensity })
                } else {
                    Light::Spot(Spot { position, intensity, cone })
                }
            })
            .collect();
        let geometry = Geometry::new(Vec::new());
        let emitters = Emitters::new(&lights, &geometry);
        const PLACES: usize = 200;
        let (mut means, mut normals) = ([0.0; 2], Stream::new(15, Purpose::Test, 0, 0));
        for _ in 0..PLACES {
            let point = 10.0 * DVec3::new(stream.uniform(), stream.uniform(), 0.3 * stream.uniform());
            let normal = sampling::sphere(normals.uniform2()).normalize();
            for (mean, receiver) in means.iter_mut().zip([Receiver::around(point), Receiver { point, normal }]) {
                let (mut sum, mut squares) = (0.0, 0.0);
                for (light, kind) in (0..).zip(&lights) {
                    let Some(arrival) = kind.arrive(&geometry, None, point, &mut stream) else {
                        continue;
                    };
                    let cos = if receiver.normal == DVec3::ZERO { 1.0 } else { normal.dot(arrival.direction).max(0.0) };
                    let brings = kind.importance(point) * cos;
                    if brings > 0.0 {
                        sum += brings;
                        let chance = emitters.probability(&lights, Emitter { light, triangle: None }, &receiver);
                        squares += brings * brings / chance;
                    }
                }
                // Where all light is below the horizon, nothing is to be chosen.
                *mean += if sum > 0.0 { squares / (sum * sum) / PLACES as f64 } else { 0.0 };
            }
        }
        assert!(means[0] < 1.35 && means[1] < 2.1, "{means:?}");
    }
}
