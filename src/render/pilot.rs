//! Pilots: a few camera paths that tell what a scene is like, before it is rendered.

use std::convert::Infallible;
use std::ops::ControlFlow;

use super::camera::Camera;
use super::eternity::{Wandered, wander};
use crate::math::random::Purpose;
use crate::math::{Bounds, DVec3, Ray, Rgb, Stream};
use crate::scene::Scene;
use crate::surface::{Nature, Side};
use crate::transport::{Segment, Stop, Vertex, Visitor, Walk, pass_by_chance, survive};

/// Camera paths that tell how often paths collide.
const PILOT: u64 = 2000;
/// Where fewer paths than this share collide, they split.
const RARE: f64 = 0.01;

/// Of a path that looks for what the camera sees.
const MOST_EVENTS: u32 = 16;

/// A few paths that tell what a scene is like.
pub(super) struct Pilot<'s> {
    pub scene: &'s Scene,
    pub camera: &'s Camera,
    /// What all random numbers derive from.
    pub seed: u64,
}

impl Pilot<'_> {
    /// A box around nearly all surfaces that camera paths meet first where light can be asked for; `None` if they meet none.
    pub fn seen(&self) -> Option<Bounds> {
        const OUTLIERS: usize = 100;
        let find = |index| self.first_surface(&mut Stream::new(self.seed, Purpose::Pilot, index, u64::MAX - 1));
        let points: Vec<DVec3> = (0..PILOT).filter_map(find).collect();
        let last = points.len().checked_sub(1)?;
        let [x, y, z] = [0, 1, 2].map(|axis| {
            let mut sorted: Vec<f64> = points.iter().map(|point| point[axis]).collect();
            sorted.sort_by(f64::total_cmp);
            [sorted[last / OUTLIERS], sorted[last - last / OUTLIERS]]
        });
        let bounds = Bounds { min: DVec3::new(x[0], y[0], z[0]), max: DVec3::new(x[1], y[1], z[1]) };
        Some(bounds.grown(0.05 * bounds.diagonal()))
    }

    /// The first surface on which light can be asked for, seen from a place of the film straight or by specular events.
    fn first_surface(&self, stream: &mut Stream) -> Option<DVec3> {
        struct Through<'t>(&'t mut Stream);

        impl Visitor for Through<'_> {
            type End = Infallible;

            fn segment(&mut self, _: &Segment<'_>) -> ControlFlow<Infallible> {
                ControlFlow::Continue(())
            }

            fn mixture(&mut self, passes: f64, _: bool) -> Option<f64> {
                pass_by_chance(passes, self.0)
            }
        }

        let ray = self.ray(stream);
        let (mut walk, mut weight) = (Walk::start(self.scene, ray, self.scene.inside(ray.origin)), Rgb::ONE);
        for _ in 0..MOST_EVENTS {
            let Stop::Surface(at) = walk.advance(&mut Through(stream)) else { return None };
            if at.bsdf.nature() != Nature::Specular {
                return Some(at.point);
            }
            let onward = Vertex::Surface(&at).onward(Side::Eye, None, &mut weight, stream, survive)?;
            walk.leave(&at, onward.direction);
        }
        None
    }

    /// A ray from a place of the film.
    pub fn ray(&self, stream: &mut Stream) -> Ray {
        let x = (stream.uniform() * self.camera.size().0 as f64) as u32;
        let y = (stream.uniform() * self.camera.size().1 as f64) as u32;
        self.camera.ray(x, y, stream)
    }

    /// Whether so few paths collide that all of them should split.
    pub fn collisions_are_rare(&self, parts: u32) -> bool {
        const LONG_ENOUGH: u64 = 1000;
        let mut collided = 0;
        for index in 0..PILOT {
            let mut stream = Stream::new(self.seed, Purpose::Pilot, index, parts as u64);
            let ray = self.ray(&mut stream);
            let wandered = wander(self.scene, &self.scene.media, ray, LONG_ENOUGH, &mut stream);
            if !matches!(wandered, Wandered::Ended { collided: false }) {
                collided += 1;
            }
        }
        (collided as f64) < RARE * PILOT as f64
    }
}
