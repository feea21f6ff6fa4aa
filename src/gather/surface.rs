//! Radiance that a surface reflects, from photons that landed around.

use std::f64::consts::PI;

use crate::math::{Rgb, Stream, Vec3};
use crate::photon::simd::Row;
use crate::photon::{Ball, Photon, PointMap, PointMemory, PointSettings};
use crate::scene::description::SurfaceFilter;
use crate::surface::Side;
use crate::transport::{Events, Interaction, Vertex};

/// Photons that landed on surfaces.
///
/// The radiance estimate (Jensen 2001, Eq. 7.8): L(x, ω) = Σ f(x, ω_p → ω) Φ_p k(d/r)/(π r²) over photons within r of x, where r is the
/// distance of the n-th nearest, or the cap. Balls are flattened: photons count that lie near the tangent plane at x and came
/// from the side that is looked at, so that light of one wall does not colour another at an edge, nor shine through a sheet.
#[derive(Debug)]
pub struct SurfaceMap {
    map: PointMap,
    filter: SurfaceFilter,
}

/// How high above the tangent plane photons count, as a share of the radius: a ball of five radii still has all its
/// light.
const FLATTENED: f32 = 0.1;

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

impl SurfaceMap {
    /// A photon is spread over a disc.
    pub const DIMENSION: u32 = 2;

    /// Puts photons in order, in parallel, with the same result for any number of threads. No radius exceeds `max_radius`, and all
    /// are `scale` times as wide.
    pub fn build(
        photons: Vec<Photon>,
        (neighbours, max_radius): (u32, f32),
        filter: SurfaceFilter,
        scale: f32,
    ) -> Self {
        let ball = Ball::Nearest { neighbours: neighbours.max(2), max_radius };
        let settings = PointSettings { scale, tagged: true, boundaries: false, ..PointSettings::new(ball) };
        SurfaceMap { map: PointMap::build(photons, &settings, &|_, _| 0.0), filter }
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
        self.map.bytes()
    }

    /// The radiance that goes from `at` to where its ray came from, of light with no more events before than `most`.
    pub fn reflected(&self, at: &Interaction, most: Events, stream: &mut Stream, memory: &mut PointMemory) -> Rgb {
        if !self.map.bounds().contains(at.point) {
            return Rgb::ZERO;
        }
        let x = at.point.as_vec3();
        let squared = self.map.look_up(x, memory);
        let normal = at.incidence.normal.as_vec3();
        let (height, most) = (FLATTENED * squared.sqrt(), most.in_a_byte());
        let vertex = Vertex::Surface(at);
        let mut sum = Rgb::ZERO;
        for &block in memory.blocks() {
            let block = block as usize;
            let (places, load, events) = (self.map.places(block), &self.map.loads[block], &self.map.events[block]);
            let of = |rows: &[Row; 3], lane: usize| Vec3::new(rows[0].0[lane], rows[1].0[lane], rows[2].0[lane]);
            for (lane, &events) in events.iter().enumerate() {
                let offset = of(places, lane) - x;
                let distance = offset.length_squared();
                // Lanes without a photon are infinitely far, or not a number.
                let near = distance < squared && offset.dot(normal).abs() <= height;
                if !near || events > most {
                    continue;
                }
                let from = -of(&load.direction, lane).as_dvec3();
                let cos = from.dot(at.incidence.normal);
                if cos <= 0.0 {
                    continue;
                }
                let weight = f64::from(self.filter.weight(distance / squared)) / cos;
                let power = Rgb::from(of(&load.power, lane).as_dvec3()) * weight;
                vertex.toward(from, Side::Eye, false, power, stream, |power, sent| sum += power * sent.value);
            }
        }
        sum / (PI * f64::from(squared))
    }
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
