//! Light in spheres, and around a lamp in an endless medium, of isotropic scattering and extinction 1: by closed forms and one integral equation.

use std::f64::consts::PI;

use crate::adding::gauss;

/// The share of light from all sides that leaves a sphere of radius R again.
///
/// By Kirchhoff's law it is 1 − ε, of the emissivity ε = 4(1 − Λ)/R² ∫₀ᴿ (1 − φ) r² dr of a sphere that glows by 1 − Λ, whose fluence φ (1 in equilibrium)
/// follows from that of a slab: u = rφ solves u(r) = ½ ∫₋ᴿᴿ E₁(|r − r′|) (Λ u(r′) + (1 − Λ) r′) dr′ (Davison, *Neutron Transport Theory*,
/// 1957). u is linear between nodes, and E₁ integrated exactly; the error falls with the square of their distance, and is extrapolated.
pub fn sphere_albedo(albedo: f64, radius: f64) -> f64 {
    let [coarse, fine] = [100, 200].map(|n| 1.0 - emissivity(albedo, radius, n));
    fine + (fine - coarse) / 3.0
}

fn emissivity(albedo: f64, radius: f64, n: usize) -> f64 {
    let h = radius / n as f64;
    // ∫ E₁(|r_i − r′|) hat_j(r′) dr′ for the hat function around r_j, of k = |i − j| steps: the second difference of E₃ over h, and where
    // E₁ is singular what it leaves out of the slopes.
    let third = |k: usize| exponential_integral(3, k as f64 * h);
    let hats: Vec<f64> = (0..=2 * n)
        .map(|k| match k {
            0 => 2.0 + 2.0 * (third(1) - 0.5) / h,
            _ => (third(k - 1) - 2.0 * third(k) + third(k + 1)) / h,
        })
        .collect();
    // Odd in r: the nodes 1 … n stand for both signs; at the end half a hat is left.
    let end = |i: usize| {
        let half = |k: usize| (third(k - 1) - third(k)) / h - exponential_integral(2, k as f64 * h);
        (if i == n { 0.5 * hats[0] } else { half(n - i) }) - half(n + i)
    };
    let weight = |i: usize, j: usize| if j == n { end(i) } else { hats[i.abs_diff(j)] - hats[i + j] };
    let kernel: Vec<Vec<f64>> = (1..=n).map(|i| (1..=n).map(|j| 0.5 * weight(i, j)).collect()).collect();
    let r = |i: usize| (i + 1) as f64 * h;
    let mut u = vec![0.0; n];
    // Each order of scattering is a term; lossless spheres do not glow.
    if albedo < 1.0 {
        loop {
            let next: Vec<f64> = kernel
                .iter()
                .map(|row| row.iter().enumerate().map(|(j, w)| w * (albedo * u[j] + (1.0 - albedo) * r(j))).sum())
                .collect();
            let change = next.iter().zip(&u).map(|(a, b): (&f64, &f64)| (a - b).abs()).fold(0.0, f64::max);
            u = next;
            if change < 1e-13 {
                break;
            }
        }
    }
    // (1 − φ) r² = r² − r u, linear pieces of u: Simpson's rule would ask for more than they know, the trapezium's error is extrapolated.
    let value = |i: usize| r(i) * (r(i) - u[i]);
    let integral = h * ((0..n - 1).map(value).sum::<f64>() + 0.5 * value(n - 1));
    4.0 * (1.0 - albedo) / (radius * radius) * integral
}

/// E_n(x) = ∫₁^∞ e^{−xt} t^{−n} dt for n = 2 or 3, x ≥ 0: upwards from E₁ by its series for small x, by a continued fraction for large
/// (Abramowitz and Stegun 1964, §5.1).
fn exponential_integral(n: u32, x: f64) -> f64 {
    if x == 0.0 {
        return 1.0 / f64::from(n - 1);
    }
    const EULER: f64 = 0.577_215_664_901_532_9;
    let first = if x < 1.0 {
        let (mut sum, mut term) = (-EULER - x.ln(), -1.0);
        for k in 1..40 {
            term *= -x / f64::from(k);
            sum += term / f64::from(k);
        }
        sum
    } else {
        let mut fraction = 0.0;
        for k in (1..200).rev() {
            let k = f64::from(k);
            fraction = k / (1.0 + k / (x + fraction));
        }
        (-x).exp() / (x + fraction)
    };
    (2..=n).fold(first, |e, m| ((-x).exp() - x * e) / f64::from(m - 1))
}

/// Fluence at distance r from an isotropic source of power 1 in an endless medium: the pole and the cut of its Fourier transform (Case, de Hoffmann
/// and Placzek, *Introduction to the Theory of Neutron Diffusion*, 1953).
pub struct Endless {
    albedo: f64,
    /// κ of e^{−κr}, and its factor.
    kappa: f64,
    factor: f64,
    nodes: (Vec<f64>, Vec<f64>),
}

impl Endless {
    pub fn new(albedo: f64) -> Self {
        // Λ artanh(κ)/κ = 1, by bisection; its left side rises from Λ.
        let (mut low, mut high) = (0.0, 1.0);
        for _ in 0..200 {
            let middle: f64 = 0.5 * (low + high);
            if albedo * middle.atanh() < middle { low = middle } else { high = middle }
        }
        let kappa: f64 = 0.5 * (low + high);
        let square = kappa * kappa;
        let factor = square * (1.0 - square) / (albedo * (square - 1.0 + albedo)) / (2.0 * PI);
        Endless { albedo, kappa, factor, nodes: gauss(16) }
    }

    pub fn fluence(&self, r: f64) -> f64 {
        // ∫₀¹ g(μ) e^{−r/μ} dμ/μ² in s = 1/μ − 1: ∫₀^∞ g e^{−r(1+s)} ds, of which little is left at s = 40/r; in pieces, which narrow
        // towards s = 0, where g varies like 1/ln².
        let end = 40.0 / r;
        let (mut sum, mut to) = (0.0, end);
        for _ in 0..30 {
            let from = 0.35 * to;
            sum += self.piece(r, from, to);
            to = from;
        }
        sum += self.piece(r, 0.0, to);
        self.factor * (-self.kappa * r).exp() / r + sum * (-r).exp() / (4.0 * PI * r)
    }

    fn piece(&self, r: f64, from: f64, to: f64) -> f64 {
        let half = 0.5 * (to - from);
        let value = |x: f64| {
            let s = from + half * (x + 1.0);
            let (mu, c) = (1.0 / (1.0 + s), self.albedo);
            // artanh(μ) = ½ ln((1 + μ)/(1 − μ)), and 1 − μ = s/(1 + s).
            let artanh = 0.5 * ((2.0 + s) / s).ln();
            let real = 1.0 - c * mu * artanh;
            (-r * s).exp() / (real * real + (0.5 * PI * c * mu).powi(2))
        };
        half * self.nodes.0.iter().zip(&self.nodes.1).map(|(&x, w)| w * value(x)).sum::<f64>()
    }

    /// What parallel rays see that start on a square of the given half width at distance `d` from the lamp, centred on the line from it and away from
    /// it along that line: the mean of ∫₀^∞ e^{−t} Λ/4π φ(r) dt.
    pub fn seen(&self, d: f64, half: f64) -> f64 {
        let (node, weight) = gauss(12);
        let mut sum = 0.0;
        for (x, wx) in node.iter().zip(&weight) {
            for (y, wy) in node.iter().zip(&weight) {
                let across = (half * 0.5 * (x + 1.0)).hypot(half * 0.5 * (y + 1.0));
                for (from, to) in [(0.0, 0.5), (0.5, 2.0), (2.0, 6.0), (6.0, 14.0), (14.0, 36.0)] {
                    for (z, wz) in node.iter().zip(&weight) {
                        let t = from + (to - from) * 0.5 * (z + 1.0);
                        let w = 0.25 * wx * wy * 0.5 * (to - from) * wz;
                        sum += w * (-t).exp() * self.fluence(across.hypot(d + t));
                    }
                }
            }
        }
        sum * self.albedo / (4.0 * PI)
    }
}
