//! Discs in a medium of uneven density.
//!
//! Photons collide where a medium is dense. Spread evenly over a disc, they would carry light from where it is dense to
//! where it is thin and more of it is seen: too bright by a tenth in veined stone whose veins are as wide as the discs.
//! So what a photon brings to a ray counts ρ/ρ̄ times, with the density ρ where the ray passes, and its mean ρ̄ over the
//! disc around that place, which is how much denser than ρ photons lie there. Where the fluence is even, all matter then
//! scatters alike, whatever the radius: fluence alone is blurred. (With the mean around the *photon*, which would conserve
//! its power, matter would be too dark next to where there is none, and that is the side it is seen from.) The mean is
//! looked up around the photon and, from how it changes there, carried on to the ray: right to first order.

use std::f32::consts::PI;

use rayon::prelude::*;

use super::discs::{PhotonMap, WallLayer};
use super::store::photons_in;
use crate::math::{DVec3, Vec3};

/// Places on a disc where its density is looked up, its centre not counted.
const PLACES: usize = 20;

/// The golden angle, π (3 − √5).
const GOLDEN: f32 = 0.763_932 * PI;

impl PhotonMap {
    /// Lets photons count in proportion to the `density` of the medium they are in, where rays pass that know it.
    pub fn follow_density(&mut self, density: &(impl Fn(DVec3) -> f64 + Sync)) {
        // As many within a distance as the kernel has there.
        let distances: [f32; PLACES] =
            std::array::from_fn(|i| self.profile.disc_distance((i as f32 + 0.5) / PLACES as f32));
        let map = &*self;
        let densities = (0..map.blocks.len())
            .into_par_iter()
            .map(|index| {
                let mut layer = WallLayer::EMPTY;
                for lane in 0..photons_in(index, map.len()) {
                    let (gradient, mean) = map.around((index, lane), &distances, density);
                    layer.distance.0[lane] = mean;
                    for axis in 0..3 {
                        layer.normal[axis].0[lane] = gradient[axis];
                    }
                }
                layer
            })
            .collect();
        self.densities = densities;
    }

    /// How the density changes around a photon, and its mean over the disc as far as walls do not cut it off: along the
    /// wall it leans on, else over all directions.
    fn around(
        &self,
        (index, lane): (usize, usize),
        distances: &[f32; PLACES],
        density: &impl Fn(DVec3) -> f64,
    ) -> (Vec3, f32) {
        let block = self.blocks.get(index);
        let center = Vec3::from(block.position.each_ref().map(|row| row.0[lane]));
        let radius = block.inverse_square.0[lane].sqrt().recip();
        let walls = self.walls(index);
        let normal = |layer: usize| Vec3::from(walls[layer].normal.each_ref().map(|row| row.0[lane]));
        let leans = self.leaning.get(index).is_some_and(|bits| bits >> lane & 1 == 1);
        let axes = leans.then(|| normal(0).any_orthonormal_pair());
        // No photon's places are turned as its neighbours' are.
        let turn = GOLDEN * PLACES as f32 * lane as f32;
        let own = density(center.as_dvec3()) as f32;
        let (mut sum, mut count) = (own, 1.0f32);
        let (mut moment, mut squares) = (Vec3::ZERO, f32::MIN_POSITIVE);
        for (i, distance) in distances.iter().enumerate() {
            let (sin, cos) = (turn + GOLDEN * i as f32).sin_cos();
            let offset = radius
                * distance
                * match axes {
                    Some((x, y)) => cos * x + sin * y,
                    None => {
                        // Heights in another order than distances.
                        let z = 1.0 - (2.0 * ((7 * i + 3) % PLACES) as f32 + 1.0) / PLACES as f32;
                        let flat = (1.0 - z * z).sqrt();
                        Vec3::new(flat * cos, flat * sin, z)
                    }
                };
            let cut = |layer: usize| normal(layer).dot(offset) + walls[layer].distance.0[lane] < 0.0;
            if !(usize::from(leans)..walls.len()).any(cut) {
                let density = density((center + offset).as_dvec3()) as f32;
                sum += density;
                count += 1.0;
                moment += (density - own) * offset;
                squares += offset.length_squared();
            }
        }
        // Least squares, for places that lie evenly in so many dimensions.
        let dimensions = if leans { 2.0 } else { 3.0 };
        (dimensions / squares * moment, sum / count)
    }
}
