//! Fractal noise.

use std::sync::Arc;

use super::Grid;
use super::bricks::BrickGrid;
use crate::error::{Error, Result};
use crate::math::{Bounds, DAffine3, DVec3};

/// A density of fractal gradient noise: n(x) = Σ_o 2^{−o} P_o(2^o x/scale) / Σ_o 2^{−o} over the octaves
/// o = 0, 1, …, and ρ = max(0, (1 + n)/2 − threshold)/(1 − threshold), from 0 to 1.
///
/// P_o is Perlin's improved noise (Improving Noise, SIGGRAPH 2002): at the corners of a unit lattice stand
/// gradients, one of the twelve vectors to the edges' middles of a cube each, and between them the eight linear
/// functions are blended by 6t⁵ − 15t⁴ + 10t³. Corners choose by an integer hash of their coordinates, the octave
/// and the seed instead of by a table of permutations, so the noise does not repeat; each octave is shifted by
/// less than a cell, so that their zeros do not coincide.
///
/// What is between the points of a lattice, `SAMPLES` to a cell of the finest octave, is *defined* as their
/// trilinear interpolation. So the density is a grid of voxels like any other — tracked, integrated and gathered
/// by the same code — and yet a function of place alone: where it is sampled does not change it. Only integers,
/// sums and products take part: it is the same on every machine.
///
/// (1 + n)/2 has the mean ½; its standard deviation is 0.134 for one octave and 0.083 for four.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Noise {
    /// The size of a cell of the coarsest octave, above 0.
    pub scale: f64,
    /// The number of octaves, from 1 to 24.
    pub octaves: u32,
    /// Noise below this is empty; in [0, 1).
    pub threshold: f64,
    /// Another seed, another noise.
    pub seed: u32,
}

/// Voxels to a cell of the finest octave.
const SAMPLES: u32 = 4;

/// The most bricks that are looked at, 2²⁸ voxels: 1 GiB if none is empty.
const MOST_BRICKS: f64 = (1u64 << 19) as f64;

/// Farther from the origin, voxels have no index.
const FARTHEST: f64 = (1u64 << 30) as f64 - 64.0;

impl Noise {
    /// The distance between voxels.
    pub fn spacing(&self) -> f64 {
        self.scale / f64::from(SAMPLES << (self.octaves - 1))
    }

    /// Voxels of the noise inside of these boxes; around them it ends somewhere.
    ///
    /// # Errors
    /// [`Error::Limit`] where that takes too many voxels, or where the boxes are too far from the origin.
    pub fn sample(&self, extents: &[Bounds]) -> Result<Grid> {
        let spacing = self.spacing();
        // The bricks that hold the voxels around every point of a box, with one to spare for rounding.
        let ranges: Vec<[DVec3; 2]> = extents
            .iter()
            .filter(|extent| !extent.is_empty())
            .map(|extent| {
                let low = ((extent.min / spacing).floor() - 1.0) / 8.0;
                let high = ((extent.max / spacing).floor() + 2.0) / 8.0;
                [low.floor(), high.floor()]
            })
            .collect();

        // Too many voxels, or too far away, are refused before any is made.
        let count: f64 = ranges.iter().map(|[low, high]| (*high - *low + 1.0).element_product()).sum();
        if count.is_nan() || count > MOST_BRICKS {
            return Err(Error::Limit(format!(
                "noise in these shapes takes {:.1e} voxels of {spacing:.3e}: expected at most {:.1e}, by smaller shapes, a larger `scale` or fewer `octaves`",
                count * 512.0,
                MOST_BRICKS * 512.0
            )));
        }
        let farthest = ranges.iter().flatten().map(|corner| corner.abs().max_element()).fold(0.0, f64::max);
        if farthest * 8.0 > FARTHEST {
            return Err(Error::Limit(format!(
                "noise with voxels of {spacing:.3e} does not reach as far from the origin as its shapes: expected a larger `scale` or fewer `octaves`"
            )));
        }

        // Each brick once, though boxes overlap.
        let mut bricks = Vec::with_capacity(count as usize);
        for [low, high] in ranges {
            let ([x0, y0, z0], [x1, y1, z1]) = (low.as_ivec3().to_array(), high.as_ivec3().to_array());
            let rows = (x0..=x1).flat_map(|x| (y0..=y1).map(move |y| (x, y)));
            bricks.extend(rows.flat_map(|(x, y)| (z0..=z1).map(move |z| [x, y, z])));
        }
        bricks.sort_unstable();
        bricks.dedup();
        let voxels = BrickGrid::from_function(&bricks, |voxel| self.at_voxel(voxel))?;
        Ok(Grid::new(Arc::new(voxels), DAffine3::from_scale(DVec3::splat(spacing))))
    }

    /// The density at any point, not interpolated between voxels.
    pub fn at(&self, p: DVec3) -> f64 {
        self.between_voxels(p / self.spacing())
    }

    fn at_voxel(&self, voxel: [i32; 3]) -> f32 {
        self.between_voxels(DVec3::from_array(voxel.map(f64::from))) as f32
    }

    /// The density at a point in units of voxels: the sum of the octaves, cut off at the threshold.
    fn between_voxels(&self, voxel: DVec3) -> f64 {
        let (mut sum, mut total) = (0.0, 0.0);
        for octave in 0..self.octaves {
            // Voxels to a cell of this octave; a power of two, so that quotients are exact.
            let cell = f64::from(SAMPLES << (self.octaves - 1 - octave));
            let salt = hash(self.seed.wrapping_add(octave.wrapping_mul(0x9e37_79b9)));
            let shift = DVec3::from_array([1, 2, 3].map(|axis| f64::from(hash(salt ^ axis) >> 8) / (1 << 24) as f64));
            let weight = 1.0 / f64::from(1u32 << octave);
            sum += weight * perlin(voxel / cell + shift, salt);
            total += weight;
        }
        let noise = 0.5 + 0.5 * sum / total;
        ((noise - self.threshold) / (1.0 - self.threshold)).clamp(0.0, 1.0)
    }
}

/// Mixes the bits of an integer (Wellons 2018, `lowbias32`).
fn hash(mut x: u32) -> u32 {
    x = (x ^ (x >> 16)).wrapping_mul(0x7feb_352d);
    x = (x ^ (x >> 15)).wrapping_mul(0x846c_a68b);
    x ^ (x >> 16)
}

/// Gradient noise at `p`, between −1.04 and 1.04.
fn perlin(p: DVec3, salt: u32) -> f64 {
    let floor = p.floor();
    let [i, j, k] = floor.as_ivec3().to_array().map(|i| i as u32);
    let t = p - floor;
    let fade = t * t * t * (t * (t * 6.0 - 15.0) + 10.0);
    let mut sum = 0.0;
    for corner in 0..8u32 {
        let [x, y, z] = [corner & 1, corner >> 1 & 1, corner >> 2];
        let at = hash(i.wrapping_add(x) ^ hash(j.wrapping_add(y) ^ hash(k.wrapping_add(z) ^ salt)));
        let away = t - DVec3::new(f64::from(x), f64::from(y), f64::from(z));
        // Twelve equal parts of the hash's range: which component is 0, and the signs of the others.
        let edge = ((u64::from(at) * 12) >> 32) as u32;
        let (a, b) = match edge >> 2 {
            0 => (away.x, away.y),
            1 => (away.y, away.z),
            _ => (away.z, away.x),
        };
        let slope = (if edge & 1 == 0 { a } else { -a }) + (if edge & 2 == 0 { b } else { -b });
        let blend = |axis: usize, upper: u32| if upper == 1 { fade[axis] } else { 1.0 - fade[axis] };
        sum += blend(0, x) * blend(1, y) * blend(2, z) * slope;
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;

    fn unit_boxes(low: f64, high: f64) -> Vec<Bounds> {
        vec![Bounds { min: DVec3::splat(low), max: DVec3::splat(high) }]
    }

    #[test]
    fn the_formula_does_not_drift() {
        // From a transcription of the documentation elsewhere.
        let noise = Noise { scale: 1.0, octaves: 3, threshold: 0.0, seed: 7 };
        let found = [[0, 0, 0], [1, 2, 3], [-5, 40, -77], [1000, -1000, 12345]].map(|voxel| noise.at_voxel(voxel));
        assert_eq!(found, [0.369_677_28, 0.470_386_87, 0.441_047_64, 0.462_293_62]);
    }

    #[test]
    fn statistics_are_as_documented() {
        for (octaves, deviation) in [(1, 0.134), (4, 0.083)] {
            let noise = Noise { scale: 1.0, octaves, threshold: 0.0, seed: 3 };
            let (mut n, mut sum, mut squares) = (0.0, 0.0, 0.0);
            for i in 0..60_000i32 {
                // Far apart on all octaves.
                let value = f64::from(noise.at_voxel([i * 37, (i % 211) * 57, (i % 1009) * 131]));
                assert!((0.0..=1.0).contains(&value));
                (n, sum, squares) = (n + 1.0, sum + value, squares + value * value);
            }
            let mean = sum / n;
            let found = (squares / n - mean * mean).sqrt();
            assert!((mean - 0.5).abs() < 0.005, "{octaves} octaves: mean {mean}");
            assert!((found / deviation - 1.0).abs() < 0.03, "{octaves} octaves: deviation {found}");
        }
    }

    #[test]
    fn what_is_sampled_does_not_change_the_density() {
        let noise = Noise { scale: 0.7, octaves: 3, threshold: 0.45, seed: 1 };
        let one = noise.sample(&unit_boxes(-1.0, 1.0)).expect("small");
        let other = noise.sample(&[unit_boxes(0.3, 1.4), unit_boxes(-5.0, -4.0)].concat()).expect("small");
        let mut different = 0;
        for i in 0..2000 {
            let u = |k: f64| 0.3 + 0.7 * (k * f64::from(i)).fract();
            let p = DVec3::new(u(0.754_877), u(0.569_840), u(0.381_966));
            assert_eq!(one.at(p), other.at(p), "{p}");
            different += usize::from(one.at(p) > 0.0);
        }
        assert!((200..1800).contains(&different), "{different} of 2000 are not empty");
        let seeded = Noise { seed: 2, ..noise }.sample(&unit_boxes(-1.0, 1.0)).expect("small");
        assert_ne!(one.at(DVec3::splat(0.5)), seeded.at(DVec3::splat(0.5)));
    }

    #[test]
    fn too_many_voxels_are_refused_before_they_are_made() {
        let noise = Noise { scale: 1.0, octaves: 8, threshold: 0.5, seed: 0 };
        for extent in [unit_boxes(0.0, 10.0), unit_boxes(0.0, 1e90), unit_boxes(1e9, 1e9 + 0.01)] {
            let error = noise.sample(&extent).expect_err("too large").to_string();
            assert!(error.contains("expected"), "{error}");
        }
        assert_eq!(noise.sample(&[]).expect("nothing").max(), 0.0);
    }
}
