//! Free flights through one medium.

use std::ops::ControlFlow;

use super::roulette::shares;
use crate::math::{Ray, Rgb, Stream};
use crate::medium::Medium;
use crate::medium::density::Density;

/// What is counted on the way and reported in the end.
#[derive(Clone, Copy, Debug, Default)]
pub struct Tally {
    /// Look-ups that found more than the majorant promised.
    pub violations: u64,
    /// Walks ended by the safety stop.
    pub stopped: u64,
    /// Photons or samples dropped because a number was not finite.
    pub broken: u64,
}

impl Tally {
    /// The sum of two.
    pub fn merge(self, other: Tally) -> Tally {
        Tally {
            violations: self.violations + other.violations,
            stopped: self.stopped + other.stopped,
            broken: self.broken + other.broken,
        }
    }
}

/// Draws where light that enters `medium` at `a` next collides before `b`, and weights `weight` for it:
/// for a collision by σ_t,c e^{−τ_c}/p̄, for passing through by e^{−τ_c} over its probability, with the
/// channels mixed by their present shares. The weight's sum stays the same.
///
/// `visit` is called for what is emitted on the way: with a parameter, and the weight that the emitted
/// radiance per length has there, in expectation over the whole flight.
pub fn fly(
    medium: &Medium,
    ray: &Ray,
    (a, b): (f64, f64),
    weight: &mut Rgb,
    stream: &mut Stream,
    tally: &mut Tally,
    mut emission: impl FnMut(f64, Rgb),
) -> Option<f64> {
    let sigma = medium.extinction;
    let Density::Grid(grid) = &medium.density else {
        let w = shares(*weight);
        let u = stream.uniform();
        let channel = if u < w.x { sigma.x } else if u < w.x + w.y { sigma.y } else { sigma.z };
        // A channel without extinction never collides.
        let target = if channel > 0.0 { stream.exponential() / channel } else { f64::INFINITY };
        let collision = if target.is_finite() { medium.density.advance(ray, a, b, target) } else { None };
        let depth = if collision.is_some() { target } else { medium.density.depth(ray, a, b) };
        let passed = medium.transmittance(depth);
        let factor = if collision.is_some() { sigma * passed } else { passed };
        let mean = (w * factor).element_sum();
        if mean > 0.0 {
            *weight *= factor / mean;
        } else {
            // Passing where the chance of it is 0 in f64.
            *weight = Rgb::ZERO;
        }
        return collision;
    };

    // Delta tracking under local majorants (Woodcock et al. 1965; per channel as in Kutz et al. 2017).
    let largest = sigma.max_element();
    let mut collision = None;
    let mut target = stream.exponential();
    grid.majorants(ray, a, b, |from, to, majorant| {
        let mu = majorant * largest;
        if mu <= 0.0 {
            return ControlFlow::Continue(());
        }
        let mut t = from;
        loop {
            let step = target / mu;
            if t + step >= to {
                target -= (to - t) * mu;
                return ControlFlow::Continue(());
            }
            t += step;
            target = stream.exponential();
            let density = grid.at(ray.at(t));
            let extinction = sigma * density;
            if density > majorant * (1.0 + 1e-5) {
                tally.violations += 1;
            }
            emission(t, *weight * (density / mu));
            let real = ((shares(*weight) * extinction).element_sum() / mu).min(1.0);
            if stream.uniform() < real {
                *weight *= extinction / (mu * real);
                collision = Some(t);
                return ControlFlow::Break(());
            }
            *weight *= ((Rgb::ONE - extinction / mu) / (1.0 - real)).max(Rgb::ZERO);
        }
    });
    collision
}

/// The density per length with which [`fly`] collides at `t` after it entered at `a` with `weight`; for
/// voxels, where it is not known, a stand-in that depends on nothing but its arguments.
pub fn flight_density(medium: &Medium, ray: &Ray, a: f64, t: f64, weight: Rgb) -> f64 {
    let sigma = medium.extinction;
    let density = medium.density.at(ray.at(t));
    match medium.density {
        Density::Grid(_) => (shares(weight) * sigma).element_sum() * density,
        _ => {
            let depth = medium.density.depth(ray, a, t);
            (shares(weight) * sigma * medium.transmittance(depth)).element_sum() * density
        }
    }
}

/// Multiplies `weight` by an unbiased estimate of the transmittance from `a` to `b`: exact where the
/// depth has a closed form, by ratio tracking (Novák et al. 2014) in voxels, ended by roulette once
/// little is left.
pub fn pass(medium: &Medium, ray: &Ray, (a, b): (f64, f64), weight: &mut Rgb, stream: &mut Stream) {
    let Density::Grid(grid) = &medium.density else {
        *weight *= medium.transmittance(medium.density.depth(ray, a, b));
        return;
    };
    let sigma = medium.extinction;
    let largest = sigma.max_element();
    let start = weight.max_element();
    let mut target = stream.exponential();
    grid.majorants(ray, a, b, |from, to, majorant| {
        let mu = majorant * largest;
        if mu <= 0.0 {
            return ControlFlow::Continue(());
        }
        let mut t = from;
        loop {
            let step = target / mu;
            if t + step >= to {
                target -= (to - t) * mu;
                return ControlFlow::Continue(());
            }
            t += step;
            target = stream.exponential();
            *weight *= (Rgb::ONE - sigma * (grid.at(ray.at(t)) / mu)).max(Rgb::ZERO);
            let left = weight.max_element() / start;
            if left < 0.1 {
                if stream.uniform() >= left {
                    *weight = Rgb::ZERO;
                    return ControlFlow::Break(());
                }
                *weight /= left;
            }
        }
    });
}

/// A walk split in two: what collides on a stretch, and what does not.
#[derive(Clone, Copy, Debug)]
pub struct Forced {
    /// Where the one part collides, and its weight; `None` where nothing can.
    pub collision: Option<(f64, Rgb)>,
    /// The transmittance: by this the other part's weight is multiplied.
    pub passed: Rgb,
    /// The chance of a collision, with the channels mixed by their shares of the weight.
    pub chance: f64,
}

/// Splits a walk that enters `medium` at `a` with `weight` and leaves it at `b`: exact for any optical
/// depth, however small.
pub fn force(medium: &Medium, ray: &Ray, (a, b): (f64, f64), weight: Rgb, stream: &mut Stream) -> Forced {
    let sigma = medium.extinction;
    let depth = medium.density.depth(ray, a, b);
    let passed = medium.transmittance(depth);
    // 1 − e^{−σD} without cancellation.
    let absorbed = sigma.map(|sigma| if sigma > 0.0 { -(-sigma * depth).exp_m1() } else { 0.0 });
    let part = shares(weight) * absorbed;
    let chance = part.element_sum();
    let nothing = Forced { collision: None, passed, chance: 0.0 };
    if chance.is_nan() || chance <= 0.0 {
        return nothing;
    }
    let [u, v] = stream.uniform2();
    let u = u * chance;
    let channel = if u < part.x { 0 } else if u < part.x + part.y { 1 } else { 2 };
    // The inverse of (1 − e^{−σD})/(1 − e^{−σD_b}).
    let target = -(-v * absorbed[channel]).ln_1p() / sigma[channel];
    let Some(t) = medium.density.advance(ray, a, b, target.min(depth)) else { return nothing };
    let density = sigma * medium.transmittance(target);
    let mean = (shares(weight) * density).element_sum();
    Forced { collision: (mean > 0.0).then(|| (t, weight * density * (chance / mean))), passed, chance }
}
