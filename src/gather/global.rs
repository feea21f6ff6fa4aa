//! Radiance that surfaces reflect of all light, from the global photon map.

use super::flux::FluxMap;
use super::surface::{Place, Reach, SurfaceMap, are_one};
use crate::math::{Rgb, Stream, Vec3};
use crate::photon::{Ball, Kind, Load, Photon, PointMap, PointMemory};
use crate::scene::Scene;
use crate::scene::description::SurfaceFilter;
use crate::transport::{Events, Interaction};
use std::f64::consts::PI;

/// All photons that landed on surfaces, and the irradiance at some of them (Christensen 1999, "Faster photon map global
/// illumination"): where a surface is Lambertian, what it reflects of the nearest one is told without counting photons.
#[derive(Debug)]
pub struct GlobalMap {
    photons: SurfaceMap,
    irradiances: Option<PointMap>,
    flux: Option<FluxMap>,
    /// The radius over which light is averaged, on average.
    blur: f64,
}

/// Of so many irradiances around a place the nearest is taken that is on its surface.
const CANDIDATES: u32 = 6;
/// A precomputed irradiance counts where the normals have at least this cosine,
const FACING: f32 = 0.9;
/// and it lies no higher above the tangent plane than this share of its distance.
const HIGHEST: f32 = 0.3;

/// What one thread keeps from look-up to look-up.
#[derive(Clone, Debug, Default)]
pub struct GlobalMemory {
    photons: PointMemory,
    irradiances: PointMemory,
}

/// How a global map is made.
#[derive(Clone, Copy, Debug)]
pub struct GlobalSettings {
    /// How far photons count.
    pub reach: Reach,
    /// How photons count from the middle of their disc to its rim.
    pub filter: SurfaceFilter,
    /// The irradiance is computed at one of so many photons; 0: nowhere.
    pub precomputed: u32,
    /// The cap of radii within which a precomputed irradiance is looked for.
    pub max_radius: f32,
    /// Whether it is kept from where scattered photons come.
    pub flux: bool,
}

impl GlobalMap {
    /// Puts photons in order, and some of those that were `scattered` before, with the same result for any number of threads; all
    /// radii are `scale` times as wide.
    pub fn build(
        scene: &Scene,
        (photons, scattered): (Vec<Photon>, Vec<Photon>),
        settings: &GlobalSettings,
        scale: f32,
    ) -> Self {
        let GlobalSettings { reach, filter, precomputed, max_radius, .. } = *settings;
        let some = photons.iter().step_by(precomputed.max(1) as usize).filter(|_| precomputed > 0);
        let places: Vec<_> = some.map(|photon| (photon.position, photon.normal)).collect();
        let flux = settings.flux.then(|| FluxMap::build(scattered, max_radius));
        let photons = SurfaceMap::build(scene, (Kind::Global, photons), reach, filter, scale);
        let irradiances = (!places.is_empty()).then(|| {
            let nearest = Ball::Nearest { neighbours: CANDIDATES, max_radius };
            PointMap::on_surfaces(photons.irradiances(scene, &places, precomputed), nearest, 1.0)
        });
        GlobalMap { blur: photons.mean_radius(), photons, irradiances, flux }
    }

    /// How many photons were left out because a number was not finite.
    pub fn rejected(&self) -> usize {
        self.photons.rejected()
    }

    /// Memory taken, in bytes.
    pub fn bytes(&self) -> usize {
        self.photons.bytes() + self.irradiance_bytes() + self.flux.as_ref().map_or(0, FluxMap::bytes)
    }

    /// What of it irradiances take that are known beforehand, in bytes.
    pub fn irradiance_bytes(&self) -> usize {
        self.irradiances.as_ref().map_or(0, PointMap::bytes)
    }

    /// From where scattered photons come, if that is kept.
    pub fn flux(&self) -> Option<&FluxMap> {
        self.flux.as_ref()
    }

    /// The radius over which light is averaged, on average: nearer than this, the light of two places is one.
    pub fn blur(&self) -> f64 {
        self.blur
    }

    /// The radiance that goes from `at` to where its ray came from, of all light with no more events before than `most`: by
    /// counting photons, or where it may be `rough`, by a precomputed irradiance.
    pub fn reflected(
        &self,
        scene: &Scene,
        at: &Interaction,
        (most, rough): (Events, bool),
        stream: &mut Stream,
        memory: &mut GlobalMemory,
    ) -> Rgb {
        if rough
            && !most.is_limited()
            && let Some(reflectance) = at.bsdf.lambertian()
            && let Some(irradiance) = self.nearest_irradiance(scene, at, memory)
        {
            return reflectance * irradiance / PI;
        }
        self.photons.reflected(scene, at, most, stream, &mut memory.photons)
    }

    /// The precomputed irradiance nearest to a place, among those on its surface.
    fn nearest_irradiance(&self, scene: &Scene, at: &Interaction, memory: &mut GlobalMemory) -> Option<Rgb> {
        let map = self.irradiances.as_ref()?;
        if !map.bounds().contains(at.point) {
            return None;
        }
        let (x, normal) = (at.point.as_vec3(), at.incidence.normal.as_vec3());
        let memory = &mut memory.irradiances;
        let squared = map.look_up(x, memory);
        let mut nearest = (squared, None);
        for &block in memory.blocks() {
            let block = block as usize;
            for (lane, candidate) in map.normals[block].iter().enumerate() {
                let offset = map.place(block, lane) - x;
                let distance = offset.length_squared();
                let facing = candidate.unpacked().dot(normal) >= FACING;
                if distance <= nearest.0 && facing && offset.dot(normal).abs() <= HIGHEST * distance.sqrt() {
                    nearest = (distance, Some((block, lane)));
                }
            }
        }
        // Not from farther than it is an average over, nor from behind a wall.
        let (block, lane) = nearest.1?;
        let Load { power, direction } = &map.loads[block];
        let radius = Vec3::from(direction.each_ref().map(|row| row.0[lane])).length();
        let place = Place { point: at.point, normal: at.incidence.normal };
        let aside = || (map.place(block, lane) - x).as_dvec3();
        if nearest.0 > radius * radius || map.events[block][lane] != 0 && !are_one(scene, place, aside()) {
            return None;
        }
        Some(Rgb::new(power[0].0[lane].into(), power[1].0[lane].into(), power[2].0[lane].into()))
    }
}
