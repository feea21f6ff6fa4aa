//! Solids smaller than discs.
//!
//! A wall that cuts a disc is taken as a plane. A boundary of a solid that is smaller than the disc is none: a puff cuts a hole out of the
//! discs of the fog around it, not half of them, and of the disc of a photon within it leaves an islet. Which share of the kernel lies in the
//! photon's region is found by looking at places on the disc, over all directions, and the photon counts as much more: each ray's light
//! is spread over a disc's width then, and none is lost or made up.
//!
//! Places are drawn until some of them lie in the region: their number over that of hits is 1 over the share on average, however small
//! that is, as the share's inverse would not be (inverse binomial sampling; Haldane 1945, "On a method of estimating frequencies").

use rayon::prelude::*;
use smallvec::SmallVec;

use super::discs::PhotonMap;
use super::kernel::Profile;
use super::simd::LANES;
use super::store::photons_in;
use crate::math::random::{Purpose, Stream};
use crate::math::{Bounds, DVec3, Vec3, sampling};
use crate::scene::{Inside, Scene, Surface};

/// Places that must be found in the region.
const HITS: u32 = 16;
/// So many places at most.
const MOST: u32 = 512;
/// Solids whose half width is less than this many radii of a disc are small to it.
const SMALL: f32 = 2.0;

/// Solids that discs may be wider than.
#[derive(Debug)]
pub struct SmallSolids<'s> {
    scene: &'s Scene,
    /// By shape, half of the longest edge of its box; infinite for those that bound no solid, those that light does not pass,
    /// and those that walls stand at, which discs may well be parallel to: a layer between mirrors is no puff.
    sizes: Vec<f32>,
    /// The least of them.
    least: f32,
    /// By region, the largest of its solids'; infinite for the world's.
    largest: Vec<f32>,
}

impl<'s> SmallSolids<'s> {
    /// Those of a scene.
    pub fn of(scene: &'s Scene) -> Self {
        let size = |(shape, surface): (u32, &Surface)| {
            if surface.solid.is_none() || surface.material.shades() {
                return f32::INFINITY;
            }
            let (bounds, mut free) = (scene.geometry.bounds(shape), true);
            scene.geometry.boxes_overlapping(&bounds, |other| {
                free &= other == shape || !scene.surfaces[other as usize].material.is_wall();
            });
            if free { 0.5 * bounds.size().max_element() as f32 } else { f32::INFINITY }
        };
        let sizes: Vec<f32> = (0..).zip(&scene.surfaces).map(size).collect();
        let mut largest = vec![0.0f32; scene.regions as usize];
        largest[scene.world_region as usize] = f32::INFINITY;
        for solid in &scene.solids {
            let largest = &mut largest[solid.region as usize];
            *largest = largest.max(sizes[solid.shape as usize]);
        }
        SmallSolids { scene, least: sizes.iter().copied().fold(f32::INFINITY, f32::min), sizes, largest }
    }

    /// Whether a shape bounds a solid that is small to discs of this radius.
    pub fn is_small(&self, shape: u32, radius: f32) -> bool {
        self.sizes[shape as usize] < SMALL * radius
    }

    /// Whether any does.
    pub fn any(&self, radius: f32) -> bool {
        self.least < SMALL * radius
    }

    /// Whether all solids of a region are small to discs of this radius.
    pub fn all_of(&self, region: u32, radius: f32) -> bool {
        self.largest[region as usize] < SMALL * radius
    }

    /// How much more a photon of a region counts, as small solids leave it that share of its disc; `cut` are places that walls cut off.
    fn gain(
        &self,
        region: u32,
        (profile, center, radius): (Profile, Vec3, f32),
        cut: Option<&dyn Fn(Vec3) -> bool>,
    ) -> f32 {
        let (scene, around) = (self.scene, center.as_dvec3());
        let reach = f64::from(radius);
        let mut near: SmallVec<[(u32, u32); 8]> = SmallVec::new();
        let mut farthest = 0.0f64;
        scene.geometry.boxes_overlapping(&Bounds { min: around - reach, max: around + reach }, |shape| {
            let Some(solid) = scene.surfaces[shape as usize].solid.filter(|_| self.is_small(shape, radius)) else {
                return;
            };
            let bounds = scene.geometry.bounds(shape);
            if around.clamp(bounds.min, bounds.max).distance(around) < reach {
                near.push((shape, solid));
                let corner = (bounds.max - around).max(around - bounds.min);
                farthest = farthest.max(corner.length());
            }
        });
        if near.is_empty() {
            return 1.0;
        }
        near.sort_unstable();
        let large: Inside = near.iter().fold(scene.inside(around), |inside, &(_, solid)| inside.with(solid, false));
        let is_hole = scene.region(&large) == region;
        // Beyond the small solids that it lies in there is nothing of its region.
        let share = match is_hole || cut.is_some() {
            true => 1.0,
            false => profile.disc_within(farthest / reach),
        };
        let is_within = |p: DVec3| {
            let mut of = near.iter().filter(|(shape, _)| scene.geometry.contains(*shape, p)).peekable();
            match of.peek() {
                None => is_hole,
                Some(_) => {
                    scene.region(&of.fold(large.clone(), |inside, &(_, solid)| inside.with(solid, true))) == region
                }
            }
        };
        let bits = center.to_array().map(|x| u64::from(x.to_bits()));
        let mut stream = Stream::new(bits[0], Purpose::Map, bits[1], bits[2]);
        let (mut places, mut hits) = (0, 0);
        for _ in 0..MOST {
            let distance = profile.disc_distance((share * stream.uniform()) as f32);
            let offset = f64::from(distance) * reach * sampling::sphere(stream.uniform2());
            if cut.is_some_and(|cut| cut(offset.as_vec3())) {
                continue;
            }
            places += 1;
            hits += u32::from(is_within(around + offset));
            if hits == HITS {
                break;
            }
        }
        (f64::from(places) / (f64::from(hits.max(1)) * share)) as f32
    }
}

impl PhotonMap {
    /// Lets photons of a region that lie near solids smaller than their discs give all of their light.
    pub fn keep_light(&mut self, small: &SmallSolids, region: u32) {
        if !small.any(self.radii().max) {
            return;
        }
        let map = &*self;
        let of_block = |index: usize| {
            let block = map.blocks.get(index);
            let walls = map.walls(index);
            let mut gains = [1.0; LANES];
            for (lane, gain) in gains.iter_mut().enumerate().take(photons_in(index, map.len())) {
                let radius = block.inverse_square.0[lane].sqrt().recip();
                if small.any(radius) {
                    let center = Vec3::from(block.position.each_ref().map(|row| row.0[lane]));
                    let is_cut = walls.first().is_some_and(|wall| wall.distance.0[lane] < radius);
                    let cut = |offset: Vec3| {
                        walls.iter().any(|wall| {
                            let normal = Vec3::from(wall.normal.each_ref().map(|row| row.0[lane]));
                            normal.dot(offset) + wall.distance.0[lane] < 0.0
                        })
                    };
                    *gain = small.gain(region, (map.profile, center, radius), is_cut.then_some(&cut));
                }
            }
            gains
        };
        let gains: Vec<[f32; LANES]> = (0..map.blocks.len()).into_par_iter().map(of_block).collect();
        self.blocks.weigh(&gains);
    }
}
