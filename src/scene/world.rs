//! A scene as the renderer sees it: loaded, checked, and moved so that its middle is the origin.

use smallvec::SmallVec;

use super::description::{Camera, Caustics};
use super::{Finish, Glow};
use crate::geometry::{Cluster, Distances, Geometry};
use crate::light::{Emitter, Emitters, Light, Receiver, Surroundings};
use crate::math::{Bounds, DVec3, Ray, Rgb, Stream, error_bound};
use crate::medium::Medium;
use crate::medium::density::Density;
use crate::surface::{Material, Paint};

/// What is there: who looks, shapes, media and lights. How a picture of it is computed, [`Settings`](super::Settings) say.
#[derive(Debug)]
pub struct Scene {
    /// Who looks, from where.
    pub camera: Camera,
    /// All surfaces; ids of placed shapes index `surfaces`.
    pub geometry: Geometry,
    /// What each placed shape is made of.
    pub surfaces: Vec<Surface>,
    /// What changes over surfaces.
    pub paints: Vec<Paint>,
    /// What mixtures are made of, by index of the material in the description; empty where there are none.
    pub finishes: Vec<Finish>,
    /// Whether some light passes through surfaces that keep off the rest.
    pub has_holes: bool,
    /// The closed shapes that decide what fills space; a higher index takes precedence. After them, overlaps of some of them where
    /// media add up, which no surface bounds.
    pub solids: Vec<Solid>,
    /// Where media add up, in the order of what overlaps.
    pub overlaps: Vec<Overlap>,
    /// What fills space outside of solids: an index into `media`.
    pub world: Option<u32>,
    /// The region outside of solids.
    pub world_region: u32,
    /// The number of regions.
    pub regions: u32,
    /// How far surfaces are from places in each solid and, last, in the world, where a medium of one density is so dense that light
    /// wanders.
    pub distances: Vec<Option<Distances>>,
    /// What fills each of them: indices into `media`.
    pub region_media: Vec<Option<u32>>,
    /// All media, one for each place its density was carried to.
    pub media: Vec<Medium>,
    /// All lights, but for glowing media.
    pub lights: Vec<Light>,
    /// What is asked for light: lights, or triangles of them.
    pub emitters: Emitters,
    /// The glowing media that have an end, as lights.
    pub glows: Vec<Glow>,
    /// What light from infinity can reach.
    pub surroundings: Surroundings,
    /// The scene's middle in the file's coordinates, which is the origin here; the camera where a few parts lie far beyond the rest.
    pub center: DVec3,
    /// How far from the camera that rest is at most; infinite where there is none beyond.
    pub near: f64,
    /// What the user should know of the scene, each message complete.
    pub warnings: Vec<String>,
}

/// Air is wide that is so many times as wide as what is near.
const WIDE_AIR: f64 = 2.0;

/// What a placed shape is made of.
#[derive(Clone, Copy, Debug)]
pub struct Surface {
    /// What the shape's boundary does with light.
    pub material: Material,
    /// The solid that the shape bounds: an index into [`Scene::solids`].
    pub solid: Option<u32>,
    /// The light that the shape is: an index into [`Scene::lights`].
    pub light: Option<u32>,
    /// What changes over it: an index into [`Scene::paints`].
    pub paint: Option<u32>,
    /// Which caustics it has to do with.
    pub caustics: Caustics,
}

/// A closed shape with an interior or a dielectric material.
#[derive(Clone, Copy, Debug)]
pub struct Solid {
    /// The placed shape that bounds it.
    pub shape: u32,
    /// What fills it: an index into [`Scene::media`]; `None` is vacuum.
    pub medium: Option<u32>,
    /// Its index of refraction, if it is a dielectric.
    pub index: Option<Rgb>,
    /// Whether its medium adds to what it overlaps.
    pub adds: bool,
    /// Whether its shape overlaps itself, so that faces do not tell what lies behind them.
    pub overlaps_itself: bool,
    /// The region it decides: space a photon map is shared in.
    pub region: u32,
}

/// Solids that overlap, and whose media add up.
#[derive(Clone, Debug, PartialEq)]
pub struct Overlap {
    /// Those whose media add, and below them the first whose medium does not, if there is one; those with precedence first.
    pub of: SmallVec<[u32; 6]>,
    /// The solid that stands for them: an index into [`Scene::solids`].
    pub solid: u32,
}

/// The solids that contain a point, those with precedence first.
#[derive(Debug, Default, PartialEq)]
pub struct Inside {
    solids: SmallVec<[u32; 6]>,
}

impl Clone for Inside {
    /// One or two numbers in a register: the derived one goes number by number, at every surface of every path.
    #[inline]
    fn clone(&self) -> Self {
        let solids = match self.solids[..] {
            [] => SmallVec::new(),
            [a] => SmallVec::from_buf_and_len([a, 0, 0, 0, 0, 0], 1),
            [a, b] => SmallVec::from_buf_and_len([a, b, 0, 0, 0, 0], 2),
            _ => SmallVec::from_slice(&self.solids),
        };
        Inside { solids }
    }
}

impl Inside {
    /// The set of these solids, given in any order.
    pub fn of(solids: impl IntoIterator<Item = u32>) -> Self {
        let mut solids: SmallVec<[u32; 6]> = solids.into_iter().collect();
        solids.sort_unstable_by(|a, b| b.cmp(a));
        solids.dedup();
        Inside { solids }
    }

    /// Whether `solid` is one of them.
    pub fn contains(&self, solid: u32) -> bool {
        self.solids.contains(&solid)
    }

    /// All of them, those with precedence first.
    pub fn solids(&self) -> &[u32] {
        &self.solids
    }

    /// These solids with `solid` added or left out.
    pub fn with(&self, solid: u32, inside: bool) -> Self {
        let mut changed = self.clone();
        changed.set(solid, inside);
        changed
    }

    fn set(&mut self, solid: u32, inside: bool) {
        // Descending order; a set of a few.
        match self.solids.binary_search_by(|other| solid.cmp(other)) {
            Ok(at) if !inside => {
                self.solids.remove(at);
            }
            Err(at) if inside => self.solids.insert(at, solid),
            _ => {}
        }
    }
}

impl Scene {
    /// The medium that fills the places inside these solids.
    #[inline]
    pub fn medium(&self, inside: &Inside) -> Option<u32> {
        match self.decisive(inside) {
            Some(solid) => solid.medium,
            None => self.world,
        }
    }

    /// Whether a ray inside these solids certainly meets no surface from parameter `a` to `b`.
    #[inline]
    pub fn is_free(&self, inside: &Inside, ray: &Ray, (a, b): (f64, f64)) -> bool {
        self.distances(inside).is_some_and(|distances| distances.is_free(&self.geometry, ray, a, b))
    }

    /// How far the nearest surface is from a point inside these solids, at least, as far as that is remembered; else 0.
    #[inline]
    pub fn least_clearance(&self, inside: &Inside, p: DVec3) -> f64 {
        self.distances(inside).map_or(0.0, |distances| distances.least(&self.geometry, p))
    }

    /// How far surfaces are from places inside these solids, where that is remembered.
    #[inline]
    pub fn distances(&self, inside: &Inside) -> Option<&Distances> {
        let place = inside.solids.first().map_or(self.solids.len(), |&solid| solid as usize);
        self.distances.get(place)?.as_ref()
    }

    /// The solid, or the overlap of several, that decides what fills the places inside these solids.
    #[inline]
    fn decisive(&self, inside: &Inside) -> Option<&Solid> {
        Some(&self.solids[self.decisive_solid(inside)? as usize])
    }

    /// Its index.
    #[inline]
    pub fn decisive_solid(&self, inside: &Inside) -> Option<u32> {
        let first = *inside.solids.first()?;
        Some(if self.solids[first as usize].adds { self.overlap(inside).unwrap_or(first) } else { first })
    }

    /// The overlap of the solids above all others, if their media are more than that of the first.
    #[cold]
    fn overlap(&self, inside: &Inside) -> Option<u32> {
        let adding = inside.solids.iter().take_while(|&&solid| self.solids[solid as usize].adds).count();
        let of = &inside.solids[..inside.solids.len().min(adding + 1)];
        let found = self.overlaps.binary_search_by(|overlap| overlap.of[..].cmp(of)).ok()?;
        Some(self.overlaps[found].solid)
    }

    /// The region of the places inside these solids.
    #[inline]
    pub fn region(&self, inside: &Inside) -> u32 {
        match self.decisive(inside) {
            Some(solid) => solid.region,
            None => self.world_region,
        }
    }

    /// The density of a medium, if its photons tell its fluence: where it scatters, is made of voxels, and fills no solid that
    /// refracts. Under refracting surfaces discs lean, and are wide against mean free paths and veins: there, collisions do better.
    pub fn uneven(&self, medium: u32) -> Option<&Density> {
        let refracts = |solid: &Solid| solid.medium == Some(medium) && solid.index.is_some();
        self.media[medium as usize].uneven().filter(|_| !self.solids.iter().any(refracts))
    }

    /// The index of refraction inside these solids: that of the dielectric with precedence.
    pub fn index(&self, inside: &Inside) -> Rgb {
        inside.solids.iter().find_map(|&solid| self.solids[solid as usize].index).unwrap_or(Rgb::ONE)
    }

    /// The solids that contain `p`.
    pub fn inside(&self, p: DVec3) -> Inside {
        if self.solids.is_empty() {
            return Inside::default();
        }
        let mut shapes = SmallVec::new();
        self.geometry.containing(p, &mut shapes);
        Inside::of(shapes.iter().filter_map(|&shape| self.surfaces[shape as usize].solid))
    }

    /// σ_a L_e of medium `index` at `p`, radiance per length, and the solids around; `None` outside of the medium.
    pub fn radiated(&self, index: u32, p: DVec3) -> Option<(Rgb, Inside)> {
        let medium = &self.media[index as usize];
        let density = medium.density.at(p);
        if density <= 0.0 {
            return None;
        }
        let inside = self.inside(p);
        (self.medium(&inside) == Some(index)).then(|| (medium.emitted(p) * density, inside))
    }

    /// What is inside after a ray has crossed all the surfaces of `cluster`.
    /// Of several crossings of one solid at one place, as on an edge, the sum counts.
    pub fn cross(&self, inside: &Inside, cluster: &Cluster, ray: &Ray) -> Inside {
        let mut after = inside.clone();
        if cluster.hits().iter().all(|hit| self.surfaces[hit.id as usize].solid.is_none()) {
            return after;
        }
        let mut crossings: SmallVec<[(u32, i32); 6]> = SmallVec::new();
        for hit in cluster.hits() {
            if let Some(solid) = self.surfaces[hit.id as usize].solid {
                let step = if hit.normal.dot(ray.direction) < 0.0 { 1 } else { -1 };
                match crossings.iter_mut().find(|crossing| crossing.0 == solid) {
                    Some(crossing) => crossing.1 += step,
                    None => crossings.push((solid, step)),
                }
            }
        }
        for (solid, sum) in crossings {
            let Solid { shape, overlaps_itself, .. } = self.solids[solid as usize];
            if overlaps_itself {
                let last = cluster.hits().last().map_or(0.0, |hit| hit.t);
                after.set(solid, self.geometry.contains(shape, ray.at(last + 2.0 * error_bound(ray, last))));
            } else if sum != 0 {
                after.set(solid, sum > 0);
            }
        }
        after
    }

    /// Draws a light for a point, or a triangle of one, and the probability it was drawn with, by how much light each
    /// might send there.
    #[inline]
    pub fn choose_light(&self, receiver: &Receiver, stream: &mut Stream) -> Option<(Emitter, f64)> {
        self.emitters.draw(&self.lights, receiver, || stream.uniform())
    }

    /// The probability with which [`Scene::choose_light`] draws this emitter.
    #[inline]
    pub fn light_choice(&self, emitter: Emitter, receiver: &Receiver) -> f64 {
        self.emitters.probability(&self.lights, emitter, receiver)
    }

    /// A box around all that the camera can see at a finite distance: surfaces, bounded media, lights of
    /// no size, and the camera itself.
    pub fn bounds(&self) -> Bounds {
        self.bounds_with(self.geometry.all_bounds(), f64::INFINITY)
    }

    /// That box without what lies far beyond the rest.
    pub fn near_bounds(&self) -> Bounds {
        let shapes = 0..self.surfaces.len() as u32;
        let near = shapes.filter(|&shape| self.is_near(shape)).map(|shape| self.geometry.bounds(shape));
        self.bounds_with(near.fold(Bounds::EMPTY, Bounds::union), self.near)
    }

    /// The world's medium, if it scatters light from infinity that shines on it and thins out without an end, as an atmosphere does.
    pub fn lit_air(&self) -> Option<&Medium> {
        let medium = &self.media[self.world? as usize];
        let thins_out = !medium.density.is_endless() && !medium.density.support().size().is_finite();
        (thins_out && medium.scatters() && !self.emitters.infinite().is_empty()).then_some(medium)
    }

    /// How many times as wide as what is near the [surroundings](Scene::surroundings) are to which photons from infinity are traced through [air](Scene::lit_air);
    /// 0 where there is none.
    pub fn width_of_air(&self) -> f64 {
        let near = 0.5 * self.near_bounds().diagonal();
        if self.lit_air().is_some() && near > 0.0 { self.surroundings.radius / near } else { 0.0 }
    }

    /// Whether that is so wide that few photons from infinity come near: one in four, or fewer.
    pub fn has_wide_air(&self) -> bool {
        self.width_of_air() > WIDE_AIR
    }

    /// Whether a shape is no larger than what is near, and does not lie beyond it.
    pub fn is_near(&self, shape: u32) -> bool {
        let bounds = self.geometry.bounds(shape);
        bounds.center().distance(self.camera.position) <= self.near && bounds.diagonal() <= self.near
    }

    /// A box around another, the camera, and lights of no size that are no farther than `near`.
    fn bounds_with(&self, mut bounds: Bounds, near: f64) -> Bounds {
        bounds = bounds.union(Bounds::of_points([self.camera.position]));
        for light in &self.lights {
            let position = match light {
                Light::Point(point) => Some(point.position),
                Light::Spot(spot) => Some(spot.position),
                Light::Goniometric(lamp) => Some(lamp.position),
                Light::Directional(light) => light.beam.map(|beam| beam.0),
                Light::Environment(_) | Light::Area(_) => None,
            };
            let position = position.filter(|position| position.distance(self.camera.position) <= near);
            bounds = bounds.union(Bounds::of_points(position));
        }
        bounds
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::random::Purpose;
    use crate::scene;

    /// Light that may come from a sphere, a disc, a sky, points and spots with and without a size, a sun and a beam.
    const LIGHTS: &str = r#"
[camera]
position = [0, 0, 9]
target = [0, 0, 0]
[[shapes]]
type = "sphere"
center = [0, 0, 0]
radius = 1
emission = { radiance = [3, 2, 1] }
[[shapes]]
type = "disk"
center = [0, 0, 1]
normal = [0, 0, 1]
radius = 0.5
emission = { radiance = 0.2 }
[[lights]]
type = "environment"
radiance = 0.25
[[lights]]
type = "point"
position = [1, 0, 0]
intensity = 0.7
[[lights]]
type = "point"
position = [1, 0, 0]
radius = 0.2
intensity = 0.7
[[lights]]
type = "spot"
position = [0, 0, 0.2]
target = [0, 0, 9]
intensity = 5
[[lights]]
type = "spot"
position = [0, 0, 0.2]
target = [0, 0, 9]
radius = 0.1
intensity = 5
[[lights]]
type = "directional"
direction = [0, 0, -1]
irradiance = 2
[[lights]]
type = "directional"
direction = [0, 0, 1]
irradiance = 2
angle = 2
center = [0, 0, -3]
radius = 1.5
"#;

    /// Each light counts for about the irradiance that it brings, from all sides together: the same unit for all, or some
    /// would hardly be asked beside others. Near a shape, the nearest point of its box stands for all of it: up to four times
    /// too much.
    #[test]
    fn lights_are_chosen_by_the_irradiance_they_bring() {
        let (scene, _) = scene::from_text(LIGHTS);
        let mut stream = Stream::new(3, Purpose::Test, 0, 0);
        let mut failed = Vec::new();
        for z in [1.3, 2.0, 5.0, 40.0] {
            let p = DVec3::new(0.1, 0.05, z) - scene.center;
            for light in &scene.lights {
                const N: usize = 2000;
                let arriving = |stream: &mut Stream| {
                    let arrival = light.arrive(&scene.geometry, None, p, stream);
                    arrival.map_or(0.0, |arrival| arrival.radiance.element_sum() / arrival.density)
                };
                let irradiance = (0..N).map(|_| arriving(&mut stream)).sum::<f64>() / N as f64;
                let ratio = light.importance(p) / irradiance;
                let most = if z < 10.0 { 4.5 } else { 1.7 };
                failed.extend((!(0.2..most).contains(&ratio)).then(|| format!("{}, z = {z}: {ratio}", light.kind())));
            }
        }
        assert!(failed.is_empty(), "{failed:#?}");
    }
}
