//! Adding–doubling, azimuthally averaged: what a slab between vacuum, or on a ground, reflects and transmits.
//!
//! On Gauss nodes of (0, 1) and a few directions more, of next to no weight, a layer so thin that light scatters in it at most once is
//! doubled until it is the slab (van de Hulst, *Multiple Light Scattering*, 1980, ch. 4). Refracting boundaries are two more layers (Prahl,
//! van Gemert and Welch, "Determining the optical properties of turbid media by using the adding–doubling method", Applied Optics 32, 1993), and so is a
//! ground. The peak of a phase function that the nodes cannot resolve goes straight on (Wiscombe, "The Delta-M Method", Journal of the Atmospheric
//! Sciences 34, 1977). It shares nothing with the renderer.

use std::f64::consts::PI;

/// Nodes of each half of the cosines: those of light that may leave, and those of light that is totally reflected.
const HALF: usize = 40;
const N: usize = 2 * HALF;
/// How many directions outside of the slab one solution is for.
pub const DIRECTIONS: usize = 3;
const SIZE: usize = N + DIRECTIONS;
/// The weight of those directions: they change nothing, and what is sent into them can still be read.
const NEXT_TO_NONE: f64 = 1e-8;
/// What is sent from a node into another, for power 1.
type Matrix = Vec<[f64; SIZE]>;

/// Layers of one medium.
pub struct Slab<'a> {
    /// Of refraction, relative to what is around.
    pub index: f64,
    /// Optical thickness.
    pub tau: f64,
    /// Single-scattering albedo.
    pub albedo: f64,
    /// Of the phase function, by [`moments`].
    pub moments: &'a [f64],
    /// The reflectance of a Lambertian ground right below; used where `index` is 1.
    pub ground: f64,
}

/// What a slab does with light from above.
pub struct Solution {
    /// The share of a beam's power that leaves upwards, with what the surface mirrors.
    pub reflected: [f64; DIRECTIONS],
    /// The share that passes downwards, scattered or not; what a ground receives.
    pub transmitted: [f64; DIRECTIONS],
    /// Radiance that leaves upwards into the second direction, of a beam along the first with irradiance 1 on a plane that faces it: scattered light,
    /// averaged over azimuths.
    pub up: [[f64; DIRECTIONS]; DIRECTIONS],
    /// As `up`, downwards.
    pub down: [[f64; DIRECTIONS]; DIRECTIONS],
}

/// Solves a slab for beams and views whose cosines to the normal, outside, are given.
pub fn solve(slab: &Slab<'_>, cosines: [f64; DIRECTIONS]) -> Solution {
    let n = slab.index;
    // Without a critical angle, any point will do.
    let middle = if n > 1.0 { (1.0 - 1.0 / (n * n)).sqrt() } else { 0.5 };
    let (nodes, weights) = gauss(HALF);
    let (mut node, mut weight) = (Vec::new(), Vec::new());
    for (from, to) in [(0.0, middle), (middle, 1.0)] {
        node.extend(nodes.iter().map(|x| from + (to - from) * 0.5 * (x + 1.0)));
        weight.extend(weights.iter().map(|w| 0.5 * (to - from) * w));
    }
    node.extend(cosines.map(|mu| (1.0 - (1.0 - mu * mu) / (n * n)).sqrt()));
    weight.extend([NEXT_TO_NONE; DIRECTIONS]);

    // The peak that Legendre's polynomials up to N leave is light that goes on.
    let peak = slab.moments[N];
    let moments: Vec<f64> = slab.moments[..N].iter().map(|m| (m - peak) / (1.0 - peak)).collect();
    let tau = slab.tau * (1.0 - slab.albedo * peak);
    let albedo = slab.albedo * (1.0 - peak) / (1.0 - slab.albedo * peak);
    let Layer { r, full } = Layer::doubled(tau, albedo, &moments, &node, &weight);

    // Inside: down at the top is d = v + u B, at the bottom e = d T + f R with f = e G, and up at the top u = d R + f T; B is what the upper
    // boundary reflects from inside, G what the lower one or the ground does, v what enters.
    let top: Vec<f64> = node.iter().map(|&mu| reflectance(mu, n)).collect();
    let bottom: Matrix = (0..SIZE)
        .map(|i| {
            std::array::from_fn(|j| {
                let mirrored = if i == j { top[i] } else { 0.0 };
                mirrored + slab.ground * 2.0 * node[j] * weight[j]
            })
        })
        .collect();
    let below = product(&full, &inverse(&minus_from_one(&product(&bottom, &r))));
    let mut above = product(&product(&below, &bottom), &full);
    for i in 0..SIZE {
        for j in 0..SIZE {
            above[i][j] += r[i][j];
        }
    }
    let reflected: Matrix = above.iter().map(|row| std::array::from_fn(|j| row[j] * top[j])).collect();
    let bounces = inverse(&minus_from_one(&reflected));

    let mut solution = Solution { reflected: [0.0; 3], transmitted: [0.0; 3], up: [[0.0; 3]; 3], down: [[0.0; 3]; 3] };
    for i in 0..DIRECTIONS {
        let entering = 1.0 - top[N + i];
        let down: Matrix = vec![bounces[N + i].map(|x| x * entering)];
        let leaving = |a: &Matrix| -> [f64; SIZE] {
            let inside = &product(&down, a)[0];
            std::array::from_fn(|j| (1.0 - top[j]) * inside[j])
        };
        let (up, passed) = (leaving(&above), leaving(&below));
        solution.reflected[i] = top[N + i] + up.iter().sum::<f64>();
        solution.transmitted[i] = passed.iter().sum();
        // A beam brings its cosine for each area, and radiance is less by n² outside.
        let radiance = |power: f64, j: usize| cosines[i] * power / (2.0 * PI * node[N + j] * weight[N + j] * n * n);
        solution.up[i] = std::array::from_fn(|j| radiance(up[N + j], j));
        solution.down[i] = std::array::from_fn(|j| radiance(passed[N + j], j));
    }
    solution
}

/// What a layer reflects, and what it lets pass, scattered or not.
struct Layer {
    r: Matrix,
    full: Matrix,
}

impl Layer {
    fn doubled(tau: f64, albedo: f64, moments: &[f64], node: &[f64], weight: &[f64]) -> Layer {
        // Both signs of the cosine.
        let polynomials: Vec<Vec<f64>> = node.iter().map(|&x| legendre(N, x)).collect();
        let averaged = |i: usize, j: usize, sign: f64| -> f64 {
            (0..N)
                .map(|l| {
                    let parity = if l % 2 == 1 { sign } else { 1.0 };
                    (2 * l + 1) as f64 * moments[l] * polynomials[i][l] * polynomials[j][l] * parity
                })
                .sum()
        };
        const DOUBLINGS: i32 = 28;
        let thin = tau / 2f64.powi(DOUBLINGS);
        // What is lost is kept, not what passes: doubling 1 − δ would lose digits.
        let mut lost: Vec<f64> = node.iter().map(|mu| -(-thin / mu).exp_m1()).collect();
        let layer = |sign: f64| -> Matrix {
            let entry = |i: usize, j: usize| lost[i] * 0.5 * albedo * averaged(i, j, sign) * weight[j];
            (0..SIZE).map(|i| std::array::from_fn(|j| entry(i, j))).collect()
        };
        let (mut r, mut t) = (layer(-1.0), layer(1.0));
        let with_direct = |t: &Matrix, lost: &[f64]| -> Matrix {
            (0..SIZE).map(|i| std::array::from_fn(|j| t[i][j] + if i == j { 1.0 - lost[i] } else { 0.0 })).collect()
        };
        for _ in 0..DOUBLINGS {
            let full = with_direct(&t, &lost);
            let bounces = inverse(&minus_from_one(&product(&r, &r)));
            let there = product(&full, &bounces);
            let back = product(&product(&there, &r), &full);
            // full·bounces·full − direct², written without the direct part.
            let twice = product(&there, &full);
            for i in 0..SIZE {
                let direct = (1.0 - lost[i]) * (1.0 - lost[i]);
                for j in 0..SIZE {
                    r[i][j] += back[i][j];
                    t[i][j] = twice[i][j] - if i == j { direct } else { 0.0 };
                }
                lost[i] = 1.0 - direct;
            }
        }
        let full = with_direct(&t, &lost);
        Layer { r, full }
    }
}

/// Fresnel's reflectance from inside of index `n`, for light with this cosine to the normal.
fn reflectance(mu: f64, n: f64) -> f64 {
    let sin2 = n * n * (1.0 - mu * mu);
    if n == 1.0 {
        return 0.0;
    }
    if sin2 >= 1.0 {
        return 1.0;
    }
    let nu = (1.0 - sin2).sqrt();
    let (s, p) = ((n * mu - nu) / (n * mu + nu), (mu - n * nu) / (mu + n * nu));
    0.5 * (s * s + p * p)
}

/// ½∫ 4π p(x) P_l(x) dx of a phase function per steradian, for all l that [`solve`] uses. Panels narrow towards x = 1, where p may be steep.
pub fn moments(p: impl Fn(f64) -> f64) -> Vec<f64> {
    let (node, weight) = gauss(64);
    let mut moments = vec![0.0; N + 1];
    // In 1 − x.
    let edges = [0.0, 1e-6, 1e-5, 1e-4, 1e-3, 1e-2, 0.1, 0.4, 1.0, 2.0];
    for edge in edges.windows(2) {
        for (x, w) in node.iter().zip(&weight) {
            let (half, x) =
                (0.5 * (edge[1] - edge[0]), 1.0 - 0.5 * (edge[0] + edge[1]) + 0.5 * (edge[1] - edge[0]) * x);
            let value = 2.0 * PI * p(x) * half * w;
            for (moment, polynomial) in moments.iter_mut().zip(legendre(N + 1, x)) {
                *moment += value * polynomial;
            }
        }
    }
    moments
}

fn legendre(count: usize, x: f64) -> Vec<f64> {
    let mut p = vec![1.0, x];
    for l in 2..count {
        p.push(((2 * l - 1) as f64 * x * p[l - 1] - (l - 1) as f64 * p[l - 2]) / l as f64);
    }
    p
}

/// Gauss–Legendre nodes and weights on (−1, 1), by Newton's method.
pub fn gauss(n: usize) -> (Vec<f64>, Vec<f64>) {
    let pair = |i: usize| {
        let mut x = (PI * (i as f64 + 0.75) / (n as f64 + 0.5)).cos();
        let mut slope = 0.0;
        // Each step doubles the digits, of which the guess has three.
        for _ in 0..8 {
            let p = legendre(n + 1, x);
            slope = n as f64 * (x * p[n] - p[n - 1]) / (x * x - 1.0);
            x -= p[n] / slope;
        }
        (x, 2.0 / ((1.0 - x * x) * slope * slope))
    };
    (0..n).map(pair).unzip()
}

/// Row by row, as they lie in memory.
fn product(a: &Matrix, b: &Matrix) -> Matrix {
    let row = |a: &[f64; SIZE]| {
        let mut sum = [0.0; SIZE];
        for (a, b) in a.iter().zip(b) {
            sum.iter_mut().zip(b).for_each(|(sum, b)| *sum += a * b);
        }
        sum
    };
    a.iter().map(row).collect()
}

fn minus_from_one(a: &Matrix) -> Matrix {
    (0..SIZE).map(|i| std::array::from_fn(|j| if i == j { 1.0 - a[i][j] } else { -a[i][j] })).collect()
}

/// Gauss–Jordan elimination; the matrices here are close to 1 and need no pivots.
fn inverse(a: &Matrix) -> Matrix {
    let mut a = a.clone();
    let mut b: Matrix = (0..SIZE).map(|i| std::array::from_fn(|j| if i == j { 1.0 } else { 0.0 })).collect();
    for k in 0..SIZE {
        let scale = 1.0 / a[k][k];
        a[k] = a[k].map(|x| x * scale);
        b[k] = b[k].map(|x| x * scale);
        let (ak, bk) = (a[k], b[k]);
        for i in (0..SIZE).filter(|&i| i != k) {
            let factor = a[i][k];
            // Columns of a up to k are not read again, and those of b beyond it are still 0 in row k.
            a[i][k + 1..].iter_mut().zip(&ak[k + 1..]).for_each(|(a, x)| *a -= factor * x);
            b[i][..=k].iter_mut().zip(&bk[..=k]).for_each(|(b, x)| *b -= factor * x);
        }
    }
    b
}
