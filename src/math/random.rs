//! Random streams that belong to a pixel's sample or to a photon, never to a thread: results do not
//! depend on how work is divided.

use rand_core::{Rng, SeedableRng};
use rand_pcg::Pcg64Mcg;

/// What a stream is for; streams of different purposes never coincide.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u64)]
pub enum Purpose {
    /// A camera sample.
    Camera = 1,
    /// An emitted photon.
    Photon = 2,
    /// A photon of the pilot that tells the yield.
    Pilot = 3,
    /// Choices about a stored map.
    Map = 4,
    /// What the samples of a pixel share.
    Pixel = 5,
    /// Whatever a test draws.
    Test = 6,
}

/// A stream of uniform random numbers.
#[derive(Clone, Debug)]
pub struct Stream(Pcg64Mcg);

/// SplitMix64's finaliser (Steele, Lea and Flood 2014): every input bit changes half of the output bits.
fn mix(mut z: u64) -> u64 {
    z = z.wrapping_add(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

impl Stream {
    /// The stream of item `index`, sub-item `sub`, of `purpose`, under the user's `seed`.
    pub fn new(seed: u64, purpose: Purpose, index: u64, sub: u64) -> Self {
        let low = mix(mix(mix(seed) ^ purpose as u64) ^ index);
        let low = mix(low ^ sub);
        let high = mix(low ^ 0x6a09_e667_f3bc_c908);
        let mut bytes = [0; 16];
        bytes[..8].copy_from_slice(&low.to_le_bytes());
        bytes[8..].copy_from_slice(&high.to_le_bytes());
        Stream(Pcg64Mcg::from_seed(bytes))
    }

    /// Uniform in [0, 1), a multiple of 2⁻⁵³.
    pub fn uniform(&mut self) -> f64 {
        (self.0.next_u64() >> 11) as f64 * (1.0 / (1u64 << 53) as f64)
    }

    /// Two uniform numbers.
    pub fn uniform2(&mut self) -> [f64; 2] {
        [self.uniform(), self.uniform()]
    }

    /// Exponentially distributed with mean 1: finite, and never 0.
    pub fn exponential(&mut self) -> f64 {
        let u = ((self.0.next_u64() >> 11) as f64 + 0.5) * (1.0 / (1u64 << 53) as f64);
        -u.ln()
    }
}
