//! Photons within a ball around each place looked up.

use std::f64::consts::PI;

use rayon::prelude::*;

use super::cut::{Cutting, Disc, Place, cutting};
use crate::math::{DVec3, Rgb, Stream};
use crate::photon::sheets::{FACING, FLATTENED};
use crate::photon::simd::LANES;
use crate::photon::{Ball, Kind, Photon, PointMap, PointMemory, PointSettings};
use crate::scene::Scene;
use crate::scene::description::SurfaceFilter;
use crate::transport::Events;

/// Photons of which those count that are within a radius of the place: the distance of the n-th nearest, or the cap, or fixed.
#[derive(Debug)]
pub(super) struct Balls {
    pub(super) map: PointMap,
    /// Which photons they are.
    kind: Kind,
    /// By block, whether the discs around may be cut.
    cut: Vec<bool>,
}

impl Balls {
    /// All radii are `scale` times as wide as `ball` says.
    pub(super) fn build(scene: &Scene, (kind, photons): (Kind, Vec<Photon>), ball: Ball, scale: f32) -> Self {
        let settings =
            PointSettings { scale, tagged: true, normals: true, boundaries: false, ..PointSettings::new(ball) };
        let map = PointMap::build(photons, &settings, &|_, _| 0.0);
        let mut balls = Balls { map, kind, cut: Vec::new() };
        balls.cut = (0..balls.map.events.len()).into_par_iter().map(|block| balls.may_cut(scene, block)).collect();
        balls
    }

    /// Memory taken, in bytes.
    pub(super) fn bytes(&self) -> usize {
        self.map.bytes() + size_of_val(&*self.cut)
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
        let all = (Events::unlimited(), SurfaceFilter::None);
        let area = self.around(scene, place, all, stream, memory, |_, _, power| sum += power);
        area.map_or((Rgb::ZERO, 0.0, true), |(area, cut)| (sum / area, (area / PI).sqrt() as f32, cut))
    }

    /// Tells `photon` from where and with what power photons landed around a place, each counted as the filter says. Returns the
    /// area they landed on, and whether it is cut; `None` where there are none.
    pub(super) fn around(
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
            let (direction, power) = self.map.loads[block].of(lane);
            let reached = || disc.as_ref().is_none_or(|disc| disc.reaches(scene, place, offset.as_dvec3()));
            if -direction.dot(place.normal) <= 0.0 || !reached() {
                continue;
            }
            found = true;
            // Of a slope, the area is counted that the tangent plane sees.
            let weight = f64::from(filter.weight(distance / squared) * facing);
            photon(stream, -direction, power * weight);
        }
        let share = |disc: &Disc| disc.share(scene, place, (filter, self.kind), true);
        found.then(|| (PI * radius * radius * disc.as_ref().map_or(1.0, share), cut))
    }

    /// Whether the discs around one photon of a block may be cut, by what probes on a wider rim say.
    fn may_cut(&self, scene: &Scene, block: usize) -> bool {
        let point = self.map.place(block, 0);
        let mut memory = PointMemory::default();
        let radius = f64::from(1.25 * self.map.look_up(point, &mut memory).sqrt() + self.map.half(block));
        let normal = self.map.normals[block][0].unpacked().as_dvec3();
        let Cutting { walls, edges } = cutting(scene, Place { point: point.as_dvec3(), normal }, radius, self.kind);
        walls || edges
    }
}
