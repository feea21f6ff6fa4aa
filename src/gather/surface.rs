//! Radiance that a surface reflects, from photons that landed around.

use std::f64::consts::{PI, TAU};

use rayon::prelude::*;

use super::few::Few;
use crate::math::random::Purpose;
use crate::math::{DVec3, Frame, Ray, Rgb, Stream, Vec3};
use crate::photon::simd::{LANES, Row};
use crate::photon::{Ball, Kind, PackedNormal, Photon, PointMap, PointMemory, PointSettings};
use crate::scene::description::SurfaceFilter;
use crate::scene::{Finish, Scene, Surface};
use crate::surface::{Material, Nature, Scattering, Side, TexturePoint};
use crate::transport::{Events, Interaction, Vertex};

/// Photons that landed on surfaces.
///
/// The radiance estimate (Jensen 2001, Eq. 7.8): L(x, ω) = Σ f(x, ω_p → ω) Φ_p k(d/r)/(s π r²) over photons within r of x, where r is the
/// distance of the n-th nearest, or the cap, or fixed. Balls are flattened: photons count that lie near the tangent plane at x, on
/// surfaces that face the same way, so that light of one wall does not colour another at an edge, nor shine through a sheet. s is the share of
/// the disc on which such photons can land, without what lies past an edge or behind a wall.
#[derive(Debug)]
pub struct SurfaceMap {
    map: PointMap,
    filter: SurfaceFilter,
    /// Which photons they are.
    kind: Kind,
    /// By block, whether the discs around may be cut.
    cut: Vec<bool>,
}

/// How high above the tangent plane photons count, as a share of the radius: a ball of five radii still has all its
/// light.
const FLATTENED: f32 = 0.1;
/// Photons count whose surface's normal has at least this cosine to that at the place looked up.
const FACING: f32 = 0.8;
/// Sectors of a disc that is cut: where they are free, its photons need not be looked at one by one.
const SECTORS: usize = 24;
/// A surface is a wall to a place whose normal it has at most this cosine to.
const SLOPE: f64 = 0.3;
/// Probes that tell what share of a disc photons can land on.
const PROBES: u32 = 24;
/// Probes around a block that tell whether its discs are cut at all.
const RIM: u32 = 8;
/// No disc is taken to be cut to less than this share.
const LEAST_SHARE: f64 = 0.05;

impl SurfaceFilter {
    /// k(x), of which the mean over the unit disc is 1: what a photon counts at distance x of the radius.
    fn weight(self, squared: f32) -> f32 {
        match self {
            SurfaceFilter::None => 1.0,
            SurfaceFilter::Cone => 3.0 * (1.0 - squared.sqrt()),
            SurfaceFilter::Gaussian => {
                // As Jensen's (2001, Eq. 7.10) with β = 1.953, which falls to 0 at the rim; his α = 0.918 lets the mean be 0.7 % off.
                const BETA: f32 = 1.953;
                let rest = 1.0 - (-BETA).exp();
                let mean = 1.0 - (1.0 - (1.0 - (-0.5 * BETA).exp()) / (0.5 * BETA)) / rest;
                (1.0 - (1.0 - (-0.5 * BETA * squared).exp()) / rest).max(0.0) / mean
            }
        }
    }
}

/// A place on a surface, and its unit normal on the side that is looked at.
#[derive(Clone, Copy, Debug)]
pub struct Place {
    /// The point.
    pub point: DVec3,
    /// The geometric normal.
    pub normal: DVec3,
}

impl SurfaceMap {
    /// A photon is spread over a disc.
    pub const DIMENSION: u32 = 2;

    /// Puts photons in order, in parallel, with the same result for any number of threads. All radii are `scale` times as wide as
    /// `ball` says.
    pub fn build(
        scene: &Scene,
        (kind, photons): (Kind, Vec<Photon>),
        ball: Ball,
        filter: SurfaceFilter,
        scale: f32,
    ) -> Self {
        let settings =
            PointSettings { scale, tagged: true, normals: true, boundaries: false, ..PointSettings::new(ball) };
        let map = PointMap::build(photons, &settings, &|_, _| 0.0);
        let mut surfaces = SurfaceMap { map, filter, kind, cut: Vec::new() };
        let blocks = surfaces.map.events.len();
        surfaces.cut = (0..blocks).into_par_iter().map(|block| surfaces.may_cut(scene, block)).collect();
        surfaces
    }

    /// How many photons it holds.
    pub fn len(&self) -> usize {
        self.map.len()
    }

    /// Whether it holds none.
    pub fn is_empty(&self) -> bool {
        self.map.is_empty()
    }

    /// How many photons were left out because a number was not finite.
    pub fn rejected(&self) -> usize {
        self.map.rejected()
    }

    /// Memory taken, in bytes.
    pub fn bytes(&self) -> usize {
        self.map.bytes() + size_of_val(&*self.cut)
    }

    /// The radii of look-ups at some of the photons, on average.
    pub fn mean_radius(&self) -> f64 {
        self.map.radii().mean.into()
    }

    /// The radiance that goes from `at` to where its ray came from, of light with no more events before than `most`.
    pub fn reflected(
        &self,
        scene: &Scene,
        at: &Interaction,
        most: Events,
        stream: &mut Stream,
        memory: &mut PointMemory,
    ) -> Rgb {
        let place = Place { point: at.point, normal: at.incidence.normal };
        let (vertex, shading_normal) = (Vertex::Surface(at), at.incidence.shading_normal);
        let is_lambertian = at.bsdf.lambertian().is_some();
        let mut sum = Rgb::ZERO;
        let mut send = |stream: &mut Stream, from: DVec3, power: Rgb| {
            // Powers on Lambertian surfaces are as the shading normal sees them: elsewhere it is this one that counts.
            let cos = from.dot(if is_lambertian { shading_normal } else { place.normal });
            if cos > 0.0 {
                let part = |power: Rgb, sent: Scattering| sum += power * sent.value;
                vertex.toward(from, Side::Eye, false, power / cos, stream, part);
            }
        };
        // To follow every photon between facets or layers is most of the time of a picture with a rough varnish.
        let mut few = at.bsdf.is_walked().then(Few::default);
        let area =
            self.around(scene, place, (most, self.filter), stream, memory, |stream, from, power| match &mut few {
                Some(few) => few.tell(stream, from, power),
                None => send(stream, from, power),
            });
        few.iter().flat_map(Few::drawn).for_each(|(from, power)| send(stream, from, power));
        area.map_or(Rgb::ZERO, |(area, _)| sum / area)
    }

    /// The irradiance of a place where a photon landed, as its shading normal sees it, the radius over which it is an average, and
    /// whether the disc is cut. All photons count alike: the one that is there for certain then makes up, on average, for the one
    /// that is missing between it and those for whom it is the nearest. With a cone, light were 1 % too bright, and without that photon
    /// 3 % too dark.
    fn irradiance(
        &self,
        scene: &Scene,
        place: Place,
        stream: &mut Stream,
        memory: &mut PointMemory,
    ) -> (Rgb, f32, bool) {
        let mut sum = Rgb::ZERO;
        let all = (Events::unlimited(), SurfaceFilter::None);
        let area = self.around(scene, place, all, stream, memory, |_, _, power| sum += power);
        area.map_or((Rgb::ZERO, 0.0, true), |(area, cut)| (sum / area, (area / PI).sqrt() as f32, cut))
    }

    /// Tells `photon` from where and with what power photons landed around a place, each counted as the filter says. Returns the
    /// area they landed on, and whether it is cut; `None` where there are none.
    fn around(
        &self,
        scene: &Scene,
        place: Place,
        (most, filter): (Events, SurfaceFilter),
        stream: &mut Stream,
        memory: &mut PointMemory,
        mut photon: impl FnMut(&mut Stream, DVec3, Rgb),
    ) -> Option<(f64, bool)> {
        if !self.map.bounds().contains(place.point) {
            return None;
        }
        let (x, normal) = (place.point.as_vec3(), place.normal.as_vec3());
        let squared = self.map.look_up(x, memory);
        let (height, most) = (FLATTENED * squared.sqrt(), most.in_a_byte());
        let counts = |block: usize, lane: usize| {
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

        // Whether any of them says that discs here may be cut, and how.
        let lanes = || memory.blocks().iter().flat_map(|&block| (0..LANES).map(move |lane| (block as usize, lane)));
        let cut = lanes().any(|(block, lane)| self.cut[block] && counts(block, lane).is_some());
        let radius = f64::from(squared.sqrt());
        let disc = cut.then(|| Disc::new(scene, place, radius, stream.uniform()));

        let mut found = false;
        for (block, lane) in lanes() {
            let Some((offset, distance, facing)) = counts(block, lane) else { continue };
            let load = &self.map.loads[block];
            let of = |rows: &[Row; 3]| Vec3::new(rows[0].0[lane], rows[1].0[lane], rows[2].0[lane]).as_dvec3();
            let from = -of(&load.direction);
            let reached = || disc.as_ref().is_none_or(|disc| disc.reaches(scene, place, offset.as_dvec3()));
            if from.dot(place.normal) <= 0.0 || !reached() {
                continue;
            }
            found = true;
            // Of a slope, the area is counted that the tangent plane sees.
            let weight = f64::from(filter.weight(distance / squared) * facing);
            photon(stream, from, Rgb::from(of(&load.power)) * weight);
        }
        let share = |disc: &Disc| disc.share(scene, place, filter, self.kind);
        found.then(|| (PI * radius * radius * disc.as_ref().map_or(1.0, share), cut))
    }

    /// Whether the discs around one photon of a block may be cut, by what probes on a wider rim say.
    fn may_cut(&self, scene: &Scene, block: usize) -> bool {
        let point = self.map.place(block, 0);
        let half = (1..LANES).map(|lane| self.map.place(block, lane)).filter(|p| p.is_finite());
        let half = half.map(|p| p.distance_squared(point)).fold(0.0, f32::max).sqrt();
        let mut memory = PointMemory::default();
        let radius = f64::from(1.25 * self.map.look_up(point, &mut memory).sqrt() + half);
        let normal = self.map.normals[block][0].unpacked().as_dvec3();
        let place = Place { point: point.as_dvec3(), normal };
        let frame = Frame::around(normal);
        (0..RIM).any(|probe| {
            let aside = on_rim(&frame, radius, f64::from(probe) / f64::from(RIM));
            let height = f64::from(FLATTENED) * radius;
            !is_free(scene, place, aside, height) || landing(scene, place, aside, height, self.kind) < 1.0
        })
    }

    /// Photons at places where photons landed, with the irradiance there as power, the normal, as long as the radius it was averaged
    /// over, as direction, and as many events as it is cut: 1 or 0.
    pub(super) fn irradiances(&self, scene: &Scene, places: &[(Vec3, PackedNormal)]) -> Vec<Photon> {
        let of = |memory: &mut PointMemory, (index, &(position, normal)): (usize, &(Vec3, PackedNormal))| {
            let direction = normal.unpacked();
            let place = Place { point: position.as_dvec3(), normal: direction.as_dvec3() };
            // Only turns the pattern of probes.
            let mut stream = Stream::new(0, Purpose::Map, index as u64, 0);
            let (irradiance, radius, cut) = self.irradiance(scene, place, &mut stream, memory);
            Photon { position, direction: radius * direction, power: irradiance.as_vec3(), events: cut.into(), normal }
        };
        places.par_iter().enumerate().map_init(PointMemory::default, of).collect()
    }
}

/// The part of the disc around a place that photons can land on: as far as a way just above the tangent plane is free of walls.
struct Disc {
    frame: Frame,
    radius: f64,
    /// Where the first sector's middle is, in turns.
    turn: f64,
    /// Which are free throughout, by the ways along their middles and those of their neighbours.
    free: [bool; SECTORS],
}

impl Disc {
    fn new(scene: &Scene, place: Place, radius: f64, turn: f64) -> Disc {
        let frame = Frame::around(place.normal);
        let height = f64::from(FLATTENED) * radius;
        let middle = |sector: usize| on_rim(&frame, radius, turn + sector as f64 / SECTORS as f64);
        let along: [bool; SECTORS] = std::array::from_fn(|sector| is_free(scene, place, middle(sector), height));
        let free = std::array::from_fn(|sector| {
            along[sector] && along[(sector + 1) % SECTORS] && along[(sector + SECTORS - 1) % SECTORS]
        });
        Disc { frame, radius, turn, free }
    }

    /// Whether photons so far aside are on it.
    fn reaches(&self, scene: &Scene, place: Place, offset: DVec3) -> bool {
        let (x, y) = (offset.dot(self.frame.x), offset.dot(self.frame.y));
        let turns = (y.atan2(x) / TAU - self.turn).rem_euclid(1.0);
        self.free[(turns * SECTORS as f64 + 0.5) as usize % SECTORS]
            || is_free(scene, place, x * self.frame.x + y * self.frame.y, f64::from(FLATTENED) * self.radius)
    }

    /// Its share of the whole disc, weighted by a filter: without what is not free, and where no surface that faces the same way lies
    /// below. (Jensen 2001, §7.4, takes the convex hull of the photons for it.)
    fn share(&self, scene: &Scene, place: Place, filter: SurfaceFilter, kind: Kind) -> f64 {
        let (mut covered, mut all) = (0.0, 0.0);
        for probe in 0..PROBES {
            // Vogel's spiral: as many on equal areas.
            let squared = (f64::from(probe) + 0.5) / f64::from(PROBES);
            let (sin, cos) = (TAU * (self.turn + f64::from(probe) * 0.618_033_988_749_895)).sin_cos();
            let weight = f64::from(filter.weight(squared as f32));
            all += weight;
            let aside = self.radius * squared.sqrt() * (cos * self.frame.x + sin * self.frame.y);
            let height = f64::from(FLATTENED) * self.radius;
            if self.reaches(scene, place, aside) {
                covered += weight * landing(scene, place, aside, height, kind);
            }
        }
        (covered / all).max(LEAST_SHARE)
    }
}

/// A vector of this length in the plane of a frame, turned by a share of a full turn.
fn on_rim(frame: &Frame, radius: f64, turn: f64) -> DVec3 {
    let (sin, cos) = (TAU * turn).sin_cos();
    radius * (cos * frame.x + sin * frame.y)
}

/// Whether light of one place may be that of the other, `aside` of it: no wall is between.
pub(super) fn are_one(scene: &Scene, place: Place, aside: DVec3) -> bool {
    is_free(scene, place, aside, f64::from(FLATTENED) * aside.length())
}

/// Whether the way `aside` from a place, `height` above it, is free of walls. Slopes are none: they are of the same surface.
fn is_free(scene: &Scene, place: Place, aside: DVec3, height: f64) -> bool {
    let length = aside.length();
    let Some(direction) = aside.try_normalize() else { return true };
    let ray = Ray::new(place.point + height * place.normal, direction);
    let mut free = true;
    scene.geometry.all_hits(&ray, 0.0, length, |hit| {
        let facing = if hit.normal.dot(direction) > 0.0 { -hit.normal } else { hit.normal };
        free &= facing.dot(place.normal) >= SLOPE || !scene.surfaces[hit.id as usize].material.is_opaque();
    });
    free
}

/// The share of photons that are stored of those which arrive `aside` of a place, no more than `height` off its tangent plane and on a
/// surface that faces the same way: of mixtures, what meets a part that spreads light.
fn landing(scene: &Scene, place: Place, aside: DVec3, height: f64, kind: Kind) -> f64 {
    let ray = Ray::new(place.point + aside + height * place.normal, -place.normal);
    let mut stored = 0f64;
    scene.geometry.all_hits(&ray, 0.0, 2.0 * height, |hit| {
        let Surface { material, paint, caustics, .. } = scene.surfaces[hit.id as usize];
        let receives = kind == Kind::Global || caustics.receives;
        if receives && hit.normal.dot(place.normal).abs() >= f64::from(FACING) {
            let object = scene.geometry.object_point(&ray, &hit);
            let at = TexturePoint { uv: hit.uv, object, footprint: 0.0 };
            // Textures may decide how a surface spreads light.
            let stores = |finish: &Finish| {
                let Material::Opaque(mut bsdf) = finish.material else { return false };
                if let Some(paint) = finish.paint {
                    scene.paints[paint as usize].put_on(&mut bsdf, &at);
                }
                bsdf.nature() == Nature::Diffuse
            };
            stored = stored.max(scene.share(&Finish { material, paint }, &at, &stores));
        }
    });
    stored
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Over the unit disc, every filter has a mean of 1, and none is below 0.
    #[test]
    fn filters_are_normalised() {
        const N: usize = 100_000;
        for filter in [SurfaceFilter::None, SurfaceFilter::Cone, SurfaceFilter::Gaussian] {
            let weights = (0..N).map(|i| f64::from(filter.weight((i as f32 + 0.5) / N as f32)));
            assert!(weights.clone().all(|weight| weight >= 0.0));
            let mean = weights.sum::<f64>() / N as f64;
            assert!((mean - 1.0).abs() < 1e-4, "{filter:?}: {mean}");
        }
    }
}
