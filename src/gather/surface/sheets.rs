//! Photons that each are spread over a sheet of their own.

use std::f64::consts::TAU;

use rayon::prelude::*;

use super::cut::{ALL_FREE, CLOSE, Cutting, Disc, Free, Place, cutting, stray};
use crate::math::{DVec3, Rgb, Stream};
use crate::photon::sheets::{FACING, FLATTENED, SheetMap, SheetSettings};
use crate::photon::simd::LANES;
use crate::photon::{Kind, Photon, PointMemory};
use crate::scene::Scene;
use crate::scene::description::SurfaceFilter;
use crate::transport::Events;

/// Photons of which those count whose sheets hold the place. What walls and edges leave of a sheet is found once for each.
#[derive(Debug)]
pub(super) struct Sheets {
    /// Powers are already divided by the areas that sheets cover, as the filter weights them.
    pub(super) map: SheetMap,
    filter: SurfaceFilter,
    /// Which photons they are.
    kind: Kind,
    /// By block, in which sectors sheets are free of walls; nothing if all are.
    free: Vec<[Free; LANES]>,
}

/// The share of a sheet that is covered, and where it is free.
type Cut = (f64, Free);

/// Where nothing is cut.
const WHOLE: Cut = (1.0, ALL_FREE);

/// As far from the place of a precomputed irradiance as √(p/n) times this and their radius, photons are missing for whom it is the
/// nearest of one in p: 32/(9π) Γ(5/2), the mean distance from the rim of a disc times that of √u for u of density u e^{−u}.
const MISSING: f64 = 1.504;

impl Sheets {
    /// Puts photons in order and finds what their sheets cover.
    pub(super) fn build(
        scene: &Scene,
        (kind, photons): (Kind, Vec<Photon>),
        settings: &SheetSettings,
        filter: SurfaceFilter,
    ) -> Self {
        let map = SheetMap::build(photons, settings);
        let mut sheets = Sheets { map, filter, kind, free: Vec::new() };
        let cuts: Vec<_> = (0..sheets.map.blocks()).into_par_iter().map(|block| sheets.cuts(scene, block)).collect();
        if cuts.iter().any(|cuts| cuts.is_some()) {
            sheets.free =
                cuts.iter().map(|cuts| cuts.map_or([ALL_FREE; LANES], |cuts| cuts.map(|(_, free)| free))).collect();
        }
        sheets.map.divide_powers(|block, lane| cuts[block].map_or(1.0, |cuts| cuts[lane].0) as f32);
        sheets
    }

    /// Memory taken, in bytes.
    pub(super) fn bytes(&self) -> usize {
        self.map.bytes() + size_of_val(&*self.free)
    }

    /// What of each of a block's sheets is covered; `None` if they all are, throughout.
    fn cuts(&self, scene: &Scene, block: usize) -> Option<[Cut; LANES]> {
        let widest = (0..LANES).map(|lane| self.map.radius(block, lane)).fold(0.0, f32::max);
        let around = f64::from(widest + self.map.photons.half(block));
        let Cutting { walls, edges } = cutting(scene, self.place(block, 0), around, self.kind);
        if !walls && !edges {
            return None;
        }
        let of = |lane: usize| {
            let radius = f64::from(self.map.radius(block, lane));
            if radius == 0.0 {
                return WHOLE;
            }
            let place = self.place(block, lane);
            let disc = Disc::new(place, radius, turn(block, lane));
            let ways = disc.ways(scene, place);
            let share = match edges {
                true => disc.share(scene, place, Some(&ways), (self.filter, self.kind)),
                false => ways.share(self.filter),
            };
            (share, ways.free())
        };
        let cuts = std::array::from_fn(of);
        (cuts != [WHOLE; LANES]).then_some(cuts)
    }

    /// Where a photon landed.
    fn place(&self, block: usize, lane: usize) -> Place {
        let normal = self.map.photons.normals[block][lane].unpacked().as_dvec3();
        Place { point: self.map.photons.place(block, lane).as_dvec3(), normal }
    }

    /// What a photon counts at whose place an irradiance is computed, one in `one_in`: there for certain, it makes up on average for the one
    /// that is missing at a distance x̄ between it and those for whom it is the nearest. It counts k(x̄) for that, and besides c(x̄) − c(0),
    /// as it also makes sheets narrower whose pilot, of radius d, finds it: at a distance y, by
    /// c(y) = ½ ∫ ∇·(y′ k(y′)) dy′/(π d²) over a disc of radius d around y, the mean of k(|y + d u|) (1 + y·u/d) over directions u.
    pub(super) fn weight_of_own(&self, one_in: u32) -> f32 {
        const DIRECTIONS: u32 = 32;
        let SheetSettings { neighbours, pilot, scale, .. } = *self.map.settings();
        let of = |count: u32| (f64::from(count) / f64::from(neighbours)).sqrt() / f64::from(scale);
        let (missing, pilot) = (MISSING * of(one_in), of(pilot));
        let kernel = |distance: f64| {
            if distance < 1.0 { f64::from(self.filter.weight((distance * distance) as f32)) } else { 0.0 }
        };
        let crowding = |y: f64| {
            let toward = |direction: u32| {
                let cos = (TAU * (f64::from(direction) + 0.5) / f64::from(DIRECTIONS)).cos();
                kernel((y * y + pilot * pilot + 2.0 * y * pilot * cos).sqrt()) * (1.0 + y * cos / pilot)
            };
            (0..DIRECTIONS).map(toward).sum::<f64>() / f64::from(DIRECTIONS)
        };
        (kernel(missing) + crowding(missing) - crowding(0.0)).max(0.0) as f32
    }

    /// The irradiance of a place where a photon landed, as its shading normal sees it, the radius of that photon's sheet, and whether
    /// some of the sheets there are cut. That photon counts `own`.
    pub(super) fn irradiance(
        &self,
        scene: &Scene,
        place: Place,
        own: f32,
        stream: &mut Stream,
        memory: &mut PointMemory,
    ) -> (Rgb, f32, bool) {
        let mut sum = Rgb::ZERO;
        let all = (Events::unlimited(), Some(own), f64::INFINITY);
        let cut = self.around(scene, place, all, stream, memory, |_, _, power| sum += power);
        (sum, self.map.radius_at(place.point.as_vec3(), memory), cut.unwrap_or(true))
    }

    /// Tells `photon` from where and with what power by area photons landed around a place that is looked at from so far. Returns whether
    /// some of their sheets are cut by walls; `None` where there are none. A photon at the very place counts `own`, if that is said.
    pub(super) fn around(
        &self,
        scene: &Scene,
        place: Place,
        (most, own, came): (Events, Option<f32>, f64),
        stream: &mut Stream,
        memory: &mut PointMemory,
        mut photon: impl FnMut(&mut Stream, DVec3, Rgb),
    ) -> Option<bool> {
        let (x, normal, most) = (place.point.as_vec3(), place.normal.as_vec3(), most.in_a_byte());
        let (photons, mut cut) = (&self.map.photons, None);
        self.map.look_up(x, memory);
        let close = |(block, lane)| came * came < CLOSE * CLOSE * f64::from(self.map.square(block, lane));
        let separate = memory.lanes().any(close) && self.is_separate(scene, place, memory);
        for (block, lane) in memory.lanes() {
            let offset = x - photons.place(block, lane);
            let (distance, square) = (offset.length_squared(), self.map.square(block, lane));
            let own_normal = photons.normals[block][lane].unpacked();
            let (facing, height) = (own_normal.dot(normal), offset.dot(own_normal));
            let (direction, power) = photons.loads[block].of(lane);
            if photons.events[block][lane] > most
                || facing < FACING
                || height * height > FLATTENED * FLATTENED * square
                || -direction.dot(place.normal) <= 0.0
                || separate && !self.is_joined(scene, place, (block, lane))
            {
                continue;
            }
            let free = self.free.get(block).map_or(ALL_FREE, |free| free[lane]);
            if free != ALL_FREE {
                let place = self.place(block, lane);
                let (disc, offset) = (Disc::new(place, square.sqrt().into(), turn(block, lane)), offset.as_dvec3());
                if free >> disc.sector(offset) & 1 == 0 && !disc.leads_to(scene, place, offset) {
                    continue;
                }
            }
            cut = Some(cut.unwrap_or(false) || free != ALL_FREE);
            let weight = match own {
                Some(own) if distance == 0.0 => own,
                _ => self.filter.weight(distance / square),
            };
            // Of a slope, the area is counted that the sheet's plane sees.
            photon(stream, -direction, power * f64::from(weight * facing));
        }
        cut
    }

    /// Whether photons that were found around a place are of a surface that is separate, as the one may be that strays most.
    #[cold]
    fn is_separate(&self, scene: &Scene, place: Place, memory: &PointMemory) -> bool {
        let (x, normal) = (place.point.as_vec3(), place.normal.as_vec3());
        let strays = |(block, lane): (usize, usize)| {
            let own = self.map.photons.normals[block][lane].unpacked();
            let offset = x - self.map.photons.place(block, lane);
            let near = own.dot(normal) >= FACING && offset.dot(own).abs() <= FLATTENED * self.map.radius(block, lane);
            near.then(|| (stray(offset, [normal, own]), (block, lane)))
        };
        let farthest = memory.lanes().filter_map(strays).max_by(|a, b| a.0.total_cmp(&b.0));
        farthest.is_some_and(|(_, lane)| !self.is_joined(scene, place, lane))
    }

    /// Whether a photon is of the same surface as a place.
    fn is_joined(&self, scene: &Scene, place: Place, (block, lane): (usize, usize)) -> bool {
        let offset = self.map.photons.place(block, lane).as_dvec3() - place.point;
        Disc::of_one_surface(scene, place, self.map.radius(block, lane).into()).is_joined(scene, place, offset)
    }
}

/// How the probes around a photon are turned.
fn turn(block: usize, lane: usize) -> f64 {
    ((block * LANES + lane) as f64 * 0.618_033_988_749_895).fract()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::Vec3;
    use crate::math::random::Purpose;
    use crate::photon::PackedNormal;
    use crate::scene;

    /// Light that falls evenly on a square is told as even: by places everywhere on it, also near its rim and the wall on it, and by
    /// irradiances at one photon in four, taken where they are the nearest.
    #[test]
    fn even_light_is_even() {
        let (scene, _) = scene::from_text(
            "[camera]\nposition = [0, 0, 3]\ntarget = [0, 0, 0]\n\
             [materials.white]\ntype = \"lambert\"\nreflectance = 0.5\n\
             [[shapes]]\ntype = \"quad\"\norigin = [-1, -1, 0]\nedge_u = [2, 0, 0]\nedge_v = [0, 2, 0]\nmaterial = \"white\"\n\
             [[shapes]]\ntype = \"quad\"\norigin = [0.3, -1, 0]\nedge_u = [0, 2, 0]\nedge_v = [0, 0, 1]\nmaterial = \"white\"\n",
        );
        const PHOTONS: usize = 30_000;
        const PLACES: usize = 12_000;
        const ONE_IN: usize = 4;
        let mut stream = Stream::new(8, Purpose::Test, 0, 0);
        let mut place = || {
            let [u, v] = stream.uniform2();
            DVec3::new(2.0 * u - 1.0, 2.0 * v - 1.0, 0.0) - scene.center
        };
        let photon = |position: DVec3| Photon {
            position: position.as_vec3(),
            direction: -Vec3::Z,
            power: Vec3::splat(4.0 / PHOTONS as f32),
            events: 0,
            normal: PackedNormal::new(DVec3::Z),
        };
        let photons: Vec<Photon> = (0..PHOTONS).map(|_| photon(place())).collect();
        let places: Vec<DVec3> = (0..PLACES).map(|_| place()).collect();
        let some = || photons.iter().step_by(ONE_IN);
        let nearest = |point: &DVec3| {
            let distances = some().map(|photon| photon.position.distance_squared(point.as_vec3()));
            distances.enumerate().min_by(|a, b| a.1.total_cmp(&b.1)).unwrap().0
        };
        let nearest: Vec<usize> = places.iter().map(nearest).collect();
        let mut memory = PointMemory::default();
        let mut any = Stream::new(9, Purpose::Test, 0, 0);
        let mut off = Vec::new();
        for filter in [SurfaceFilter::None, SurfaceFilter::Cone, SurfaceFilter::Gaussian] {
            for scale in [1.0, 0.7] {
                let settings = SheetSettings { neighbours: 80, pilot: 20, max_radius: 1.0, scale };
                let sheets = Sheets::build(&scene, (Kind::Global, photons.clone()), &settings, filter);
                let at = |point: DVec3| Place { point, normal: DVec3::Z };
                let mut sum = 0.0;
                for point in &places {
                    let all = (Events::unlimited(), None, f64::INFINITY);
                    sheets.around(&scene, at(*point), all, &mut any, &mut memory, |_, _, power| sum += power.x);
                }
                let shown = sum / PLACES as f64;

                let own = sheets.weight_of_own(ONE_IN as u32);
                let mut irradiance = |photon: &Photon| {
                    sheets.irradiance(&scene, at(photon.position.as_dvec3()), own, &mut any, &mut memory).0.x
                };
                let irradiances: Vec<f64> = some().map(&mut irradiance).collect();
                let told = nearest.iter().map(|&index| irradiances[index]).sum::<f64>() / PLACES as f64;
                if (shown - 1.0).abs() > 0.005 || (told - 1.0).abs() > 0.006 {
                    off.push(format!("{filter:?}, {scale}: {shown} shown, {told} told"));
                }
            }
        }
        assert!(off.is_empty(), "{off:#?}");
    }
}
