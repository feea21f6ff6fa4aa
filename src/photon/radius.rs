//! How wide photons are spread: laws of the dimension of the space that they fill.

use std::f64::consts::PI;

use rayon::prelude::*;

use crate::math::Vec3;

/// How wide photons are spread.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Radius {
    /// The same for all, above 0.
    Fixed(f32),
    /// r = D (n/m)^{1/3} with the distance D to the m-th nearest *other* photon (Jarosz et al. 2008,
    /// §4): the disc of a photon reaches as far as its n-th neighbour would in an even density.
    Variable {
        /// n, the photons that a disc's sphere should hold.
        neighbours: u32,
        /// m, the neighbour that is looked for, at least 1.
        pilot: u32,
        /// No radius exceeds this. If it is not finite, the diagonal of the box around the photons.
        max_radius: f32,
    },
}

impl Radius {
    /// About as wide among this share of the photons: an adaptive radius holds as many fewer of them.
    pub fn among(self, share: f64) -> Radius {
        match self {
            Radius::Fixed(_) => self,
            Radius::Variable { neighbours, pilot, max_radius } => Radius::Variable {
                neighbours: (f64::from(neighbours) * share).round().max(1.0) as u32,
                pilot: (f64::from(pilot) * share.sqrt()).ceil().max(f64::from(pilot.min(LEAST_PILOT))) as u32,
                max_radius,
            },
        }
    }
}

/// Fewer neighbours tell radii that are too small on average.
const LEAST_PILOT: u32 = 5;

/// Radii of a map's discs, all 0 if it is empty.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Radii {
    /// The smallest.
    pub min: f32,
    /// The mean.
    pub mean: f32,
    /// The largest.
    pub max: f32,
}

impl Radii {
    /// Extremes and mean, summed in a fixed order.
    pub(super) fn of(radii: &[f32]) -> Radii {
        if radii.is_empty() {
            return Radii::default();
        }
        let parts: Vec<(f32, f64, f32)> = radii
            .par_chunks(CHUNK)
            .map(|part| {
                part.iter().fold((f32::INFINITY, 0.0, 0.0f32), |(min, sum, max), &r| {
                    (min.min(r), sum + f64::from(r), max.max(r))
                })
            })
            .collect();
        let sum: f64 = parts.iter().map(|part| part.1).sum();
        Radii {
            min: parts.iter().fold(f32::INFINITY, |min, part| min.min(part.0)),
            mean: (sum / radii.len() as f64) as f32,
            max: parts.iter().fold(0.0, |max, part| max.max(part.2)),
        }
    }
}

/// Photons that fill a space of `D` dimensions evenly: 3 in media, 2 on surfaces.
pub struct Filling<const D: u32>;

/// Photons in media.
pub type InMedium = Filling<3>;

impl<const D: u32> Filling<D> {
    /// What a radius is to be multiplied by for `ratio` times as many photons to be within it: ratio^{1/D}.
    #[inline]
    pub fn growth(ratio: f64) -> f64 {
        match D {
            2 => ratio.sqrt(),
            3 => ratio.cbrt(),
            _ => ratio.powf(1.0 / f64::from(D)),
        }
    }

    /// The radius of a ball of this volume, or of a disc of this area: `D` is 3 or 2.
    pub fn radius_of(volume: f64) -> f64 {
        Self::growth(volume / if D == 2 { PI } else { 4.0 / 3.0 * PI })
    }
}

/// What the radii of a pass are multiplied by that comes after `before` others, in `dimension` dimensions: r_{k+1}^d =
/// r_k^d (k + α)/(k + 1) with α = 4/(4 + d), which lets noise and blur vanish alike, RMSE ∝ N^{−2/(4+d)} (after
/// Knaus and Zwicker 2011, "Progressive Photon Mapping: A Probabilistic Approach").
pub fn narrowing(before: u32, dimension: u32) -> f64 {
    let d = dimension as f64;
    let alpha = 4.0 / (4.0 + d);
    let shrunk: f64 = (1..=before).map(|k| (k as f64 + alpha) / (k as f64 + 1.0)).product();
    shrunk.powf(1.0 / d)
}

/// Radii that one task sums.
const CHUNK: usize = 4096;

/// Radii of this many roundings of a photon's largest coordinate, at least: below, the distance between it and a ray is mostly
/// rounding.
const MIN_RADIUS_ROUNDINGS: f32 = 4.0;

/// The smallest radius as a share of `max_radius`, or of the diagonal of the box around the photons where that is less.
const MIN_RADIUS_SHARE: f32 = 1e-6;

/// The smallest radius whose inverse square, and a power divided by it, stay finite in `f32`.
pub(super) const MIN_RADIUS: f32 = 1e-12;

/// The largest radius whose square stays finite in `f32`, with room for sums of a few.
pub(super) const MAX_RADIUS: f32 = 1e18;

/// The least and the largest of adaptive radii.
#[derive(Clone, Copy, Debug)]
pub(super) struct Limits {
    least: f32,
    /// The largest.
    pub cap: f32,
}

impl Limits {
    /// Those of photons in a box.
    pub fn of(max_radius: f32, scale: f32, min: Vec3, max: Vec3) -> Self {
        let diagonal = max.as_dvec3().distance(min.as_dvec3()).min(f64::from(MAX_RADIUS)) as f32;
        let cap = match (max_radius.is_finite(), diagonal > 0.0) {
            (true, _) => max_radius * scale,
            (false, true) => diagonal * scale,
            (false, false) => scale,
        }
        .clamp(MIN_RADIUS, MAX_RADIUS);
        let extent = if diagonal > 0.0 { cap.min(diagonal) } else { cap };
        Limits { least: (MIN_RADIUS_SHARE * extent).clamp(MIN_RADIUS, cap), cap }
    }

    /// The least radius around a place.
    #[inline(always)]
    pub fn least(&self, x: Vec3) -> f32 {
        (MIN_RADIUS_ROUNDINGS * f32::EPSILON * x.abs().max_element()).max(self.least).min(self.cap)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn radii_follow_the_law() {
        // ∏ (k + α)/(k + 1) = Γ(n + 1 + α)/(Γ(1 + α) Γ(n + 2)), n passes later, by Stirling's series.
        let ln_gamma = |x: f64| {
            let shift: f64 = (0..20).map(|i| (x + i as f64).ln()).sum();
            let y = x + 20.0;
            (y - 0.5) * y.ln() - y + 0.5 * (2.0 * std::f64::consts::PI).ln() + 1.0 / (12.0 * y)
                - 1.0 / (360.0 * y.powi(3))
                - shift
        };
        for (dimension, alpha) in [(2u32, 2.0 / 3.0), (3, 4.0 / 7.0)] {
            assert_eq!(narrowing(0, dimension), 1.0);
            let mut power = 1.0;
            for before in 0..200u32 {
                let n = before as f64;
                let found = narrowing(before, dimension).powi(dimension as i32);
                let closed = (ln_gamma(n + 1.0 + alpha) - ln_gamma(1.0 + alpha) - ln_gamma(n + 2.0)).exp();
                assert!((found / power - 1.0).abs() < 1e-12, "{dimension} {before}: {found} {power}");
                assert!((found / closed - 1.0).abs() < 1e-9, "{dimension} {before}: {found} {closed}");
                power *= (n + 1.0 + alpha) / (n + 2.0);
            }
            // Blur falls with the radius squared as fast as noise with r^{−d/2} N^{−1/2}.
            let slope = (narrowing(1 << 20, dimension) / narrowing(1 << 16, dimension)).log2() / 4.0;
            assert!((slope + 1.0 / (4.0 + dimension as f64)).abs() < 1e-4, "{dimension}: {slope}");
        }
    }
}
