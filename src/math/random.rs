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
    /// A path from a light to the camera.
    Light = 7,
    /// A photon of a caustic.
    Caustic = 8,
    /// A photon of the global map.
    Global = 9,
    /// A record of the irradiance cache, or the look for places that want one.
    Irradiance = 10,
    /// A shadow photon.
    Shadow = 11,
    /// A path from the eye that tells where photons count.
    Importon = 12,
    /// How wide a light is, for the choice of a method.
    Choice = 13,
    /// How many samples a pixel takes.
    Adaptive = 14,
}

/// What a number of a camera sample, a light path or a photon is for: the first draw of each is spread evenly over a pixel's
/// samples, or all paths or photons of a pass.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Dimension {
    /// The place on the film: two numbers.
    Film,
    /// The distance of a collision.
    Flight,
    /// A direction drawn at an event: two numbers.
    Direction,
    /// A point on a light: two numbers.
    Light,
    /// The choice of a light.
    LightChoice,
    /// A light, a point on it and a distance for them: four numbers.
    Equiangular,
    /// A place on the lens: two numbers.
    Lens,
    /// Where and whither a path leaves a light: four numbers, of which two are those of the film, where that path does not begin.
    Departure,
    /// What a photon is aimed at, and where on that: three numbers, which only the eye uses else.
    Aim,
}

impl Dimension {
    /// The dimensions of Sobol's sequence that it takes, whose first are the most even: one bit each.
    const fn bits(self) -> u16 {
        match self {
            Dimension::Film => 0b11,
            Dimension::Flight => 0b1 << 2,
            Dimension::Direction => 0b11 << 3,
            Dimension::Light => 0b11 << 5,
            Dimension::Equiangular => 0b1111 << 7,
            Dimension::Aim => 0b111 << 7,
            Dimension::LightChoice => 0b1 << 11,
            Dimension::Lens => 0b11 << 12,
            Dimension::Departure => 0b11 | 0b11 << 14,
        }
    }
}

/// A stream of uniform random numbers. A camera sample's first draws of each kind that [`Dimension`] names come from a
/// point of a scrambled Sobol' sequence that its pixel's samples share, a light path's or a photon's from one that all of a pass
/// share; all others are independent.
#[derive(Clone, Debug)]
pub struct Stream {
    random: Pcg64Mcg,
    /// The point, before it is scrambled by the key.
    point: [u32; DIMENSIONS],
    key: u64,
    /// The dimensions of the point that were not drawn yet.
    left: u16,
    /// Those that the next draws take, within [`Stream::draw`].
    open: u16,
    /// How often the point was moved on for further draws of lights.
    moved: u32,
}

/// What a point of a stream held before lights were drawn: see [`Stream::again`].
#[derive(Clone, Copy, Debug)]
pub struct Mark(u16);

/// How far a light's dimensions move on with every further draw, as shares of 2³²: the choice by the golden ratio's fraction, the place
/// on it by the lattice that is its like in two dimensions (Roberts 2018, "The unreasonable effectiveness of quasirandom sequences").
const fn step(dimension: u32) -> u32 {
    match dimension {
        5 => 0xc13f_a9a9,
        6 => 0x91e1_0da6,
        11 => 0x9e37_79b9,
        _ => 0,
    }
}

/// SplitMix64's finaliser (Steele, Lea and Flood 2014): every input bit changes half of the output bits.
pub(crate) fn mix(mut z: u64) -> u64 {
    z = z.wrapping_add(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

/// Dimensions of the points.
const DIMENSIONS: usize = 16;

/// Primitive polynomials, by degree and inner coefficients, and initial direction numbers of the dimensions from the
/// second on (Joe and Kuo 2008, "Constructing Sobol' sequences with better two-dimensional projections").
const SOBOL: [(u32, u32, [u32; 6]); DIMENSIONS - 1] = [
    (1, 0, [1, 0, 0, 0, 0, 0]),
    (2, 1, [1, 3, 0, 0, 0, 0]),
    (3, 1, [1, 3, 1, 0, 0, 0]),
    (3, 2, [1, 1, 1, 0, 0, 0]),
    (4, 1, [1, 1, 3, 3, 0, 0]),
    (4, 4, [1, 3, 5, 13, 0, 0]),
    (5, 2, [1, 1, 5, 5, 17, 0]),
    (5, 4, [1, 1, 5, 5, 5, 0]),
    (5, 7, [1, 1, 7, 11, 19, 0]),
    (5, 11, [1, 1, 5, 1, 1, 0]),
    (5, 13, [1, 1, 1, 3, 11, 0]),
    (5, 14, [1, 3, 5, 5, 31, 0]),
    (6, 1, [1, 3, 3, 9, 7, 49]),
    (6, 13, [1, 1, 1, 15, 21, 21]),
    (6, 16, [1, 3, 1, 13, 27, 49]),
];

/// What each bit of a sample's number contributes to each dimension.
static DIRECTIONS: [[u32; DIMENSIONS]; 32] = directions();

const fn directions() -> [[u32; DIMENSIONS]; 32] {
    let mut rows = [[0; DIMENSIONS]; 32];
    let mut bit = 0;
    while bit < 32 {
        // The first dimension is van der Corput's.
        rows[bit][0] = 1 << (31 - bit);
        let mut dimension = 1;
        while dimension < DIMENSIONS {
            let (degree, inner, initial) = SOBOL[dimension - 1];
            let degree = degree as usize;
            rows[bit][dimension] = if bit < degree {
                initial[bit] << (31 - bit)
            } else {
                let first = rows[bit - degree][dimension];
                let mut sum = first ^ (first >> degree);
                let mut k = 1;
                while k < degree {
                    if inner >> (degree - 1 - k) & 1 == 1 {
                        sum ^= rows[bit - k][dimension];
                    }
                    k += 1;
                }
                sum
            };
            dimension += 1;
        }
        bit += 1;
    }
    rows
}

/// A nested uniform scramble (Owen 1995): every bit is flipped or not as `key` and the bits above it say. By
/// hashing, with the constants that Burley (2020, "Practical hash-based Owen scrambling") reports of Vegdahl.
fn scramble(x: u32, key: u32) -> u32 {
    let mut x = x.reverse_bits();
    x ^= x.wrapping_mul(0x3d20_adea);
    x = x.wrapping_add(key);
    x = x.wrapping_mul((key >> 16) | 1);
    x ^= x.wrapping_mul(0x0552_6c56);
    x ^= x.wrapping_mul(0x53a2_2864);
    x.reverse_bits()
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
        Stream { random: Pcg64Mcg::from_seed(bytes), point: [0; DIMENSIONS], key: 0, left: 0, open: 0, moved: 0 }
    }

    /// The stream of sample `sample` of a pass through a pixel; `number` counts the samples of all passes. Whatever
    /// their number, samples from 0 on are spread evenly, those of different passes and pixels independently.
    pub fn of_sample(seed: u64, pixel: u64, number: u64, (pass, sample): (u32, u32)) -> Self {
        let mut stream = Stream::new(seed, Purpose::Camera, pixel, number);
        stream.key = mix(mix(mix(mix(seed) ^ Purpose::Pixel as u64) ^ pixel) ^ pass as u64);
        stream.spread(sample);
        stream
    }

    /// The stream of path or photon `path` from a light, in a pass. Whatever their number, those from 0 on are spread evenly, those of
    /// different purposes and passes, and each 2³² of one, independently.
    pub fn of_path(seed: u64, purpose: Purpose, path: u64, pass: u64) -> Self {
        let mut stream = Stream::new(seed, purpose, path, pass);
        stream.key = mix(mix(mix(mix(seed) ^ purpose as u64) ^ (path >> 32)) ^ pass);
        stream.spread(path as u32);
        stream
    }

    /// Takes this point of the sequence.
    fn spread(&mut self, number: u32) {
        let mut bits = number;
        while bits != 0 {
            let row = &DIRECTIONS[bits.trailing_zeros() as usize];
            self.point.iter_mut().zip(row).for_each(|(x, direction)| *x ^= direction);
            bits &= bits - 1;
        }
        self.left = !0;
    }

    /// Draws what `of` says: numbers that `draws` takes first come from its dimensions, once a sample; what it leaves of these
    /// goes to no one else.
    #[inline]
    pub fn draw<T>(&mut self, of: Dimension, draws: impl FnOnce(&mut Stream) -> T) -> T {
        self.open = of.bits() & self.left;
        let drawn = draws(self);
        self.open = 0;
        drawn
    }

    /// Where [`Stream::again`] begins.
    pub fn mark(&self) -> Mark {
        Mark(self.left)
    }

    /// Makes the next draw of a light the `number`-th of several since `mark`. Each is uniform by itself; together they are spread over
    /// the lights as evenly as over a sample's siblings.
    pub fn again(&mut self, mark: Mark, number: u32) {
        self.left |= mark.0 & (Dimension::Light.bits() | Dimension::LightChoice.bits());
        self.moved = number;
    }

    #[inline]
    fn bits(&mut self) -> u64 {
        let random = self.random.next_u64();
        if self.open == 0 { random } else { self.spread_bits(random) }
    }

    /// Bits of the point, as far as it has any, before random ones.
    fn spread_bits(&mut self, random: u64) -> u64 {
        // A dimension drawn twice would tie two numbers together.
        let dimension = self.open.trailing_zeros();
        self.open &= self.open - 1;
        self.left &= !(1 << dimension);
        let key = mix(self.key ^ dimension as u64);
        // The hash alone is not quite uniform over its keys; the shift makes each number exactly so.
        let x = scramble(self.point[dimension as usize], key as u32) ^ (key >> 32) as u32;
        let x = x.wrapping_add(self.moved.wrapping_mul(step(dimension)));
        (x as u64) << 32 | random >> 32
    }

    /// Uniform in [0, 1), a multiple of 2⁻⁵³.
    #[inline]
    pub fn uniform(&mut self) -> f64 {
        (self.bits() >> 11) as f64 * (1.0 / (1u64 << 53) as f64)
    }

    /// Two uniform numbers.
    #[inline]
    pub fn uniform2(&mut self) -> [f64; 2] {
        [self.uniform(), self.uniform()]
    }

    /// Exponentially distributed with mean 1: finite, and never 0.
    pub fn exponential(&mut self) -> f64 {
        -self.inner().ln()
    }

    /// Uniform in (0, 1): neither 0 nor 1.
    #[inline]
    fn inner(&mut self) -> f64 {
        ((self.bits() >> 11) as f64 + 0.5) * (1.0 / (1u64 << 53) as f64)
    }

    /// The number whose logarithm is how far light flies, from (0, 1).
    #[inline]
    pub fn flight(&mut self) -> f64 {
        self.draw(Dimension::Flight, Stream::inner)
    }

    /// The two numbers of a direction.
    #[inline]
    pub fn direction(&mut self) -> [f64; 2] {
        self.draw(Dimension::Direction, Stream::uniform2)
    }

    /// This stream, for a part that goes its own way; what is left are others, independent of it.
    pub fn part(&mut self) -> Stream {
        let seed = [self.random.next_u64(), self.random.next_u64()].map(mix);
        let mut bytes = [0; 16];
        bytes[..8].copy_from_slice(&seed[0].to_le_bytes());
        bytes[8..].copy_from_slice(&seed[1].to_le_bytes());
        let rest = Stream { random: Pcg64Mcg::from_seed(bytes), left: 0, ..self.clone() };
        std::mem::replace(self, rest)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Sample numbers below any power of two fall into different strata in every dimension, and into different
    /// elementary intervals of the film's plane.
    #[test]
    fn first_draws_are_spread() {
        const SAMPLES: u32 = 64;
        const KINDS: [(Dimension, usize); 7] = [
            (Dimension::Film, 2),
            (Dimension::Flight, 1),
            (Dimension::Direction, 2),
            (Dimension::Light, 2),
            (Dimension::LightChoice, 1),
            (Dimension::Equiangular, 4),
            (Dimension::Lens, 2),
        ];
        let draw = |sample| {
            let mut stream = Stream::of_sample(3, 17, sample as u64, (0, sample));
            let mut numbers = Vec::new();
            for (kind, count) in KINDS {
                stream.draw(kind, |stream| numbers.extend((0..count).map(|_| stream.uniform())));
            }
            numbers
        };
        let points: Vec<Vec<f64>> = (0..SAMPLES).map(draw).collect();
        for dimension in 0..points[0].len() {
            let mut strata: Vec<u32> = points.iter().map(|p| (p[dimension] * SAMPLES as f64) as u32).collect();
            strata.sort_unstable();
            assert!(strata.into_iter().eq(0..SAMPLES), "dimension {dimension}");
        }
        for across in [2, 4, 8, 16, 32] {
            let (columns, rows) = (across as f64, (SAMPLES / across) as f64);
            let mut cells: Vec<u32> =
                points.iter().map(|p| (p[0] * columns) as u32 + across * (p[1] * rows) as u32).collect();
            cells.sort_unstable();
            assert!(cells.into_iter().eq(0..SAMPLES), "{across} columns");
        }
    }

    /// Numbers that a draw leaves go to no one else: the next draws of a sample are independent of its point.
    #[test]
    fn numbers_left_over_are_not_passed_on() {
        let spread = |after: &dyn Fn(&mut Stream)| {
            let mut strata: Vec<u32> = (0..64)
                .map(|sample| {
                    let mut stream = Stream::of_sample(3, 17, sample as u64, (0, sample));
                    after(&mut stream);
                    (stream.uniform() * 64.0) as u32
                })
                .collect();
            strata.sort_unstable();
            strata.dedup();
            strata.len()
        };
        assert!(spread(&|stream| stream.draw(Dimension::Light, |_| ())) < 60);
        assert!(spread(&|_| ()) < 60);
    }

    /// A kind's second draws are independent of the first.
    #[test]
    fn later_draws_are_independent() {
        const PIXELS: u64 = 20_000;
        let mut covariance = 0.0;
        for pixel in 0..PIXELS {
            let mut stream = Stream::of_sample(5, pixel, 6, (0, 6));
            let mut draw = || stream.draw(Dimension::Flight, Stream::uniform) - 0.5;
            covariance += draw() * draw() / PIXELS as f64;
        }
        // The product of two has a standard deviation of 1/12.
        assert!(covariance.abs() < 4.0 / 12.0 / (PIXELS as f64).sqrt(), "{covariance}");
    }
}
