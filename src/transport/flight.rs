//! Free flights through one medium.

use std::ops::ControlFlow;

use crate::math::random::Dimension;
use crate::math::{Ray, Rgb, Stream, choose, shares};
use crate::medium::density::{self, Density, Grid};
use crate::medium::{Medium, transmittance};
use smallvec::SmallVec;

/// How far light flies in an even medium, drawn before surfaces are looked for: through dense media flights end long before the far
/// side of a solid.
#[derive(Clone, Copy, Debug, Default)]
pub struct Ahead(Option<f64>);

impl Ahead {
    /// Of a length that is known.
    pub fn of(length: f64) -> Self {
        Ahead(Some(length))
    }

    /// Draws the length, if it is not known; infinite where the medium is uneven and flights are drawn on the way.
    pub fn draw(&mut self, medium: &Medium, weight: Rgb, stream: &mut Stream) -> f64 {
        if let Some(length) = self.0 {
            return length;
        }
        if !medium.density.is_even() {
            return f64::INFINITY;
        }
        *self.0.insert(stream.draw(Dimension::Flight, |stream| draw(medium, weight, stream)))
    }

    /// The parameter in a range at which light collides by chance, as was drawn before or on the way; weights `weight` for it.
    pub fn collide(
        &mut self,
        medium: &Medium,
        ray: &Ray,
        range: (f64, f64),
        weight: &mut Rgb,
        stream: &mut Stream,
        tally: &mut Tally,
    ) -> Option<f64> {
        match self.0.take() {
            Some(target) => end(medium, ray, range, target, weight),
            None => {
                stream.draw(Dimension::Flight, |stream| fly(medium, ray, range, weight, stream, tally, |_, _, _| {}))
            }
        }
    }
}

/// What is counted on the way and reported in the end.
#[derive(Clone, Copy, Debug, Default, serde::Serialize, serde::Deserialize)]
#[serde(default)]
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

/// Draws how far light of this weight flies in a medium without voxels, as density integrated along its way: a length
/// where the density is 1. Infinite if it never collides.
pub fn draw(medium: &Medium, weight: Rgb, stream: &mut Stream) -> f64 {
    let sigma = medium.extinction;
    let length = stream.exponential();
    let channel = if sigma == Rgb::splat(sigma.x) {
        sigma.x
    } else {
        choose(shares(weight).to_array(), 1.0, stream.uniform()).map_or(0.0, |choice| sigma[choice.index])
    };
    // A channel without extinction never collides.
    if channel > 0.0 { length / channel } else { f64::INFINITY }
}

/// Where a flight that [`draw`] drew ends between `a` and `b`, if it does; weights `weight` for either, as [`fly`] says.
pub fn end(medium: &Medium, ray: &Ray, (a, b): (f64, f64), target: f64, weight: &mut Rgb) -> Option<f64> {
    let sigma = medium.extinction;
    let collision = if target.is_finite() { medium.density.advance(ray, a, b, target) } else { None };
    if sigma == Rgb::splat(sigma.x) {
        // Both factors are 1.
        return collision;
    }
    let depth = if collision.is_some() { target } else { medium.density.depth(ray, a, b) };
    let passed = medium.transmittance(depth);
    let factor = if collision.is_some() { sigma * passed } else { passed };
    let mean = (shares(*weight) * factor).element_sum();
    if mean > 0.0 {
        *weight *= factor / mean;
    } else {
        // Passing where the chance of it is 0 in f64.
        *weight = Rgb::ZERO;
    }
    collision
}

/// Draws where light that enters `medium` at `a` next collides before `b`, and weights `weight` for it:
/// for a collision by σ_t,c e^{−τ_c} over its mean, for passing through by e^{−τ_c} over its mean, both over the
/// channels by their present shares. The weight's sum stays the same.
///
/// In voxels and sums `tentative` is called at each place where it may collide: with the parameter, the weight it has come there with, and
/// a length. That times the weight is what the radiance emitted per length counts, in expectation over the whole flight.
#[inline]
pub fn fly(
    medium: &Medium,
    ray: &Ray,
    range: (f64, f64),
    weight: &mut Rgb,
    stream: &mut Stream,
    tally: &mut Tally,
    tentative: impl FnMut(f64, Rgb, f64),
) -> Option<f64> {
    match &medium.density {
        Density::Grid(grid) => track(medium.extinction, grid, ray, range, weight, stream, tally, tentative),
        Density::Sum(sum) => superpose(medium.extinction, sum, ray, range, weight, stream, tally, tentative),
        Density::Uniform | Density::Exponential(_) => {
            let target = draw(medium, *weight, stream);
            end(medium, ray, range, target, weight)
        }
    }
}

/// The extinction of the densest channel that carries something. The others must not be waited for: one of them may be a billion times
/// denser.
fn strongest(sigma: Rgb, weight: Rgb) -> f64 {
    Rgb::select(weight.cmpgt(Rgb::ZERO), sigma, Rgb::ZERO).max_element()
}

/// A flight through voxels: delta tracking under local majorants (Woodcock et al. 1965; per channel as in Kutz et al. 2017).
/// Where they promise long work, the density itself is the majorant: its depth is known cell by cell.
#[allow(clippy::too_many_arguments, reason = "those of `fly`")]
fn track(
    sigma: Rgb,
    grid: &Grid,
    ray: &Ray,
    (a, b): (f64, f64),
    weight: &mut Rgb,
    stream: &mut Stream,
    tally: &mut Tally,
    mut tentative: impl FnMut(f64, Rgb, f64),
) -> Option<f64> {
    let mut largest = strongest(sigma, *weight);
    let mut collision = None;
    let mut target = stream.exponential();
    // The largest extinction from there on, if it does not collide.
    let mut passes = |t: f64, density: f64, mu: f64, stream: &mut Stream| {
        let extinction = sigma * density;
        tentative(t, *weight, density / mu);
        let real = ((shares(*weight) * extinction).element_sum() / mu).min(1.0);
        if stream.uniform() < real {
            *weight *= extinction / (mu * real);
            return None;
        }
        *weight *= ((Rgb::ONE - extinction / mu) / (1.0 - real)).max(Rgb::ZERO);
        Some(strongest(sigma, *weight))
    };
    grid.majorants(ray, a, b, |from, to, majorant| {
        if majorant * largest <= 0.0 {
            return ControlFlow::Continue(());
        }
        if (to - from) * majorant * largest > LABORIOUS {
            grid.cells(ray, from, to, |cell| {
                let whole = cell.integral();
                let mut passed = 0.0;
                while passed + target / largest < whole {
                    passed += target / largest;
                    target = stream.exponential();
                    let t = grid.within(ray, &cell, passed);
                    let density = grid.at(ray.at(t));
                    if density > 0.0 {
                        let Some(left) = passes(t, density, density * largest, stream) else {
                            collision = Some(t);
                            return ControlFlow::Break(());
                        };
                        largest = left;
                    }
                }
                target -= (whole - passed) * largest;
                ControlFlow::Continue(())
            });
            return if collision.is_some() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) };
        }
        let mut t = from;
        loop {
            let mu = majorant * largest;
            let step = target / mu;
            if t + step >= to {
                target -= (to - t) * mu;
                return ControlFlow::Continue(());
            }
            t += step;
            target = stream.exponential();
            let density = grid.at(ray.at(t));
            if density > majorant * (1.0 + 1e-5) {
                tally.violations += 1;
            }
            let Some(left) = passes(t, density, mu, stream) else {
                collision = Some(t);
                return ControlFlow::Break(());
            };
            largest = left;
        }
    });
    collision
}

/// A flight through several densities at once. In the densest channel that carries something each part is flown through on its own, as if it were alone,
/// and the nearest collision counts: independent Poisson processes add up. Other channels are thinner everywhere by the same factor, so for them that collision
/// is a tentative one; if it is none, that channel carries nothing any more, and the flight goes on by the next.
#[allow(clippy::too_many_arguments, reason = "those of `fly`")]
#[inline(never)]
fn superpose(
    sigma: Rgb,
    sum: &density::Sum,
    ray: &Ray,
    (mut a, b): (f64, f64),
    weight: &mut Rgb,
    stream: &mut Stream,
    tally: &mut Tally,
    mut tentative: impl FnMut(f64, Rgb, f64),
) -> Option<f64> {
    loop {
        let largest = strongest(sigma, *weight);
        if largest <= 0.0 {
            return None;
        }
        let mut nearest: Option<f64> = None;
        let mut met: SmallVec<[(f64, f64); 16]> = SmallVec::new();
        // Closed forms first: voxels beyond where those collide need not be looked at.
        let (voxels, closed): (SmallVec<[_; 4]>, SmallVec<[_; 4]>) =
            sum.parts().iter().partition(|part| part.density.has_voxels());
        for density::Part { weight: factor, density } in closed.into_iter().chain(voxels) {
            let (own, range) = (factor * largest, (a, nearest.unwrap_or(b)));
            let found = match density {
                Density::Grid(grid) => {
                    let meet = |t: f64, _: Rgb, length: f64| met.push((t, factor * length));
                    track(Rgb::splat(own), grid, ray, range, &mut Rgb::splat(1.0), stream, tally, meet)
                }
                density => {
                    let found = density.advance(ray, range.0, range.1, stream.exponential() / own);
                    met.extend(found.map(|t| (t, 1.0 / largest)));
                    found
                }
            };
            nearest = found.or(nearest);
        }
        let end = nearest.unwrap_or(b);
        met.retain(|(t, _)| *t <= end);
        met.sort_unstable_by(|one, other| one.0.total_cmp(&other.0));
        for (t, length) in met {
            tentative(t, *weight, length);
        }
        let t = nearest?;
        let real = ((shares(*weight) * sigma).element_sum() / largest).min(1.0);
        if stream.uniform() < real {
            *weight *= sigma / (largest * real);
            return Some(t);
        }
        *weight *= ((Rgb::ONE - sigma / largest) / (1.0 - real)).max(Rgb::ZERO);
        a = t;
    }
}

/// Delta tracking that has to expect more tentative collisions than this on one piece of a ray gives way to
/// exact depths.
const LABORIOUS: f64 = 32.0;

/// The density per length with which [`fly`] collides at `t` after it entered at `a` with `weight`; for
/// voxels, where it is not known, a stand-in that depends on nothing but its arguments.
pub fn flight_density(medium: &Medium, ray: &Ray, a: f64, t: f64, weight: Rgb) -> f64 {
    let sigma = medium.extinction;
    let density = medium.density.at(ray.at(t));
    if medium.density.has_voxels() {
        return (shares(weight) * sigma).element_sum() * density;
    }
    let depth = medium.density.depth(ray, a, t);
    (shares(weight) * sigma * medium.transmittance(depth)).element_sum() * density
}

/// Multiplies `weight` by an unbiased estimate of the transmittance from `a` to `b`: exact where the
/// depth has a closed form, by ratio tracking (Novák et al. 2014) in voxels, ended by roulette once
/// little is left; exact again where that would take long.
pub fn pass(medium: &Medium, ray: &Ray, range: (f64, f64), weight: &mut Rgb, stream: &mut Stream) {
    match &medium.density {
        Density::Uniform | Density::Exponential(_) => {
            *weight *= medium.transmittance(medium.density.depth(ray, range.0, range.1));
        }
        Density::Grid(grid) => pass_voxels(medium.extinction, grid, ray, range, weight, stream),
        // The product of independent estimates.
        Density::Sum(sum) => {
            for part in sum.parts() {
                let sigma = part.weight * medium.extinction;
                match &part.density {
                    _ if weight.max_element() <= 0.0 => return,
                    Density::Grid(grid) => pass_voxels(sigma, grid, ray, range, weight, stream),
                    density => *weight *= transmittance(sigma, density.depth(ray, range.0, range.1)),
                }
            }
        }
    }
}

/// [`pass`] for voxels.
fn pass_voxels(sigma: Rgb, grid: &Grid, ray: &Ray, (a, b): (f64, f64), weight: &mut Rgb, stream: &mut Stream) {
    let largest = sigma.max_element();
    let start = weight.max_element();
    let mut target = stream.exponential();
    grid.majorants(ray, a, b, |from, to, majorant| {
        let mu = majorant * largest;
        if mu <= 0.0 {
            return ControlFlow::Continue(());
        }
        if (to - from) * mu > LABORIOUS {
            *weight *= transmittance(sigma, grid.depth(ray, from, to));
            return if weight.max_element() > 0.0 { ControlFlow::Continue(()) } else { ControlFlow::Break(()) };
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
    let [v, u] = stream.uniform2();
    let Some(channel) = choose(part.to_array(), chance, u).map(|choice| choice.index) else { return nothing };
    // The inverse of (1 − e^{−σD})/(1 − e^{−σD_b}).
    let target = -(-v * absorbed[channel]).ln_1p() / sigma[channel];
    let Some(t) = medium.density.advance(ray, a, b, target.min(depth)) else { return nothing };
    let density = sigma * medium.transmittance(target);
    let mean = (shares(weight) * density).element_sum();
    Forced { collision: (mean > 0.0).then(|| (t, weight * density * (chance / mean))), passed, chance }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::random::Purpose;
    use crate::math::{DAffine3, DVec3};
    use crate::medium::Emission;
    use crate::medium::density::bricks::{BrickGrid, NegativePolicy};
    use crate::medium::density::{Density, Exponential, Grid};
    use crate::medium::phase::{Isotropic, Phase};
    use std::sync::Arc;

    fn medium(extinction: Rgb, density: Density) -> Medium {
        Medium {
            name: "test".to_string(),
            extinction,
            albedo: Rgb::splat(0.5).into(),
            phase: Phase::Isotropic(Isotropic).into(),
            density,
            emission: Emission::None,
        }
    }

    /// Uneven voxels, some empty, one of them large.
    fn voxels() -> Density {
        let values: Vec<f32> = (0..20 * 6 * 6)
            .map(|i| match i % 7 {
                0..3 => 0.0,
                6 if i == 20 * 6 * 3 + 20 * 3 + 9 => 30.0,
                k => 0.3 * k as f32,
            })
            .collect();
        let bricks = BrickGrid::from_dense([0; 3], [20, 6, 6], &values, 0.0, NegativePolicy::Error).expect("finite");
        Density::Grid(Grid::new(Arc::new(bricks), DAffine3::from_scale(DVec3::splat(0.2))))
    }

    fn densities() -> Vec<(&'static str, Density)> {
        let air = Exponential { origin: DVec3::ZERO, up: DVec3::new(1.0, 0.5, 0.0), scale_height: 1.1, value: 0.9 };
        let air = Density::Exponential(air);
        let parts = [(0.3, Density::Uniform), (0.6, voxels()), (0.8, air.clone()), (0.2, voxels())];
        let parts = parts.into_iter().map(|(weight, density)| density::Part { weight, density });
        let sum = Density::Sum(density::Sum::new(parts.collect()));
        vec![("uniform", Density::Uniform), ("exponential", air), ("voxels", voxels()), ("sum", sum)]
    }

    fn ray() -> Ray {
        Ray::new(DVec3::new(-0.5, 0.31, 0.4), DVec3::new(1.0, 0.08, 0.05).normalize())
    }

    /// Sums and sums of squares of weights in slots along the ray, the last for what passes.
    struct Histogram {
        sums: Vec<[Rgb; 2]>,
        draws: f64,
    }

    const SLOTS: usize = 12;
    const FAR: f64 = 4.8;

    impl Histogram {
        fn of(draws: usize, mut draw: impl FnMut(&mut Stream) -> Vec<(Option<f64>, Rgb)>) -> Self {
            let mut sums = vec![[Rgb::ZERO; 2]; SLOTS + 1];
            for i in 0..draws {
                let mut stream = Stream::new(11, Purpose::Test, i as u64, 0);
                for (t, weight) in draw(&mut stream) {
                    let slot = t.map_or(SLOTS, |t| ((t / FAR * SLOTS as f64) as usize).min(SLOTS - 1));
                    sums[slot][0] += weight;
                    sums[slot][1] += weight * weight;
                }
            }
            Histogram { sums, draws: draws as f64 }
        }

        /// Each slot's mean against the light that is extinguished there, e^{−τ(a)} − e^{−τ(b)}.
        fn assert_extinction(&self, what: &str, medium: &Medium) {
            for slot in 0..=SLOTS {
                let at = |slot: usize| FAR * slot as f64 / SLOTS as f64;
                let passed = |t: f64| medium.transmittance(medium.density.depth(&ray(), 0.0, t));
                let expected = if slot == SLOTS { passed(FAR) } else { passed(at(slot)) - passed(at(slot + 1)) };
                let [sum, squares] = self.sums[slot];
                let mean = sum / self.draws;
                let deviation = ((squares / self.draws - mean * mean).max(Rgb::ZERO) / self.draws).map(f64::sqrt);
                for c in 0..3 {
                    // A slot that is hit about once cannot tell its own deviation.
                    let bound = 4.5 * deviation[c] + 8.0 / self.draws;
                    assert!(
                        (mean[c] - expected[c]).abs() <= bound,
                        "{what}, slot {slot}, channel {c}: {} against {} ± {}",
                        mean[c],
                        expected[c],
                        deviation[c]
                    );
                }
            }
        }
    }

    /// Of the last, red ends at once, and nobody waits for it then.
    const COLOURS: [Rgb; 5] = [
        Rgb::splat(0.8),
        Rgb::new(0.05, 1.0, 0.3),
        Rgb::new(0.0, 0.7, 0.0),
        Rgb::new(0.002, 0.05, 2.0),
        Rgb::new(4e9, 0.5, 2.0),
    ];

    #[test]
    fn flights_collide_as_extinction_says() {
        for (name, density) in densities() {
            for extinction in COLOURS {
                let medium = medium(extinction, density.clone());
                let mut tally = Tally::default();
                let histogram = Histogram::of(60_000, |stream| {
                    let mut weight = Rgb::new(1.0, 1.0, 1.0);
                    let t = fly(&medium, &ray(), (0.0, FAR), &mut weight, stream, &mut tally, |_, _, _| {});
                    assert!((weight.element_sum() - 3.0).abs() < 1e-9, "{name}: the sum has drifted to {weight}");
                    vec![(t, weight)]
                });
                histogram.assert_extinction(&format!("{name}, {extinction}"), &medium);
                assert_eq!(tally.violations, 0);
            }
        }
    }

    /// Where light may collide in voxels and sums, lengths add up to the integral of the density, faded: ∫ρ T dt.
    #[test]
    fn tentative_collisions_see_the_whole_density() {
        for (name, density) in densities().into_iter().skip(2) {
            for extinction in COLOURS {
                let medium = medium(extinction, density.clone());
                // What is beyond one place, and what is before.
                let slots = 12.0;
                let (mut sums, draws) = ([[Rgb::ZERO; 2]; 2], 60_000);
                for i in 0..draws {
                    let mut stream = Stream::new(12, Purpose::Test, i, 0);
                    let (mut found, mut weight, mut last) = ([Rgb::ZERO; 2], Rgb::ONE, 0.0);
                    fly(
                        &medium,
                        &ray(),
                        (0.0, FAR),
                        &mut weight,
                        &mut stream,
                        &mut Tally::default(),
                        |t, weight, length| {
                            assert!(t >= last, "{name}: {t} after {last}");
                            last = t;
                            found[usize::from(t > 2.0)] += weight * length;
                        },
                    );
                    for (sums, found) in sums.iter_mut().zip(found) {
                        sums[0] += found;
                        sums[1] += found * found;
                    }
                }
                let mut expected = [Rgb::ZERO; 2];
                let step = 1e-3 * FAR / slots;
                for i in 0..12_000 {
                    let t = (f64::from(i) + 0.5) * step;
                    let passed = medium.transmittance(medium.density.depth(&ray(), 0.0, t));
                    expected[usize::from(t > 2.0)] += passed * (medium.density.at(ray().at(t)) * step);
                }
                for ([sum, squares], expected) in sums.into_iter().zip(expected) {
                    let n = draws as f64;
                    let mean = sum / n;
                    let bound =
                        4.5 * ((squares / n - mean * mean).max(Rgb::ZERO) / n).map(f64::sqrt) + 1e-3 * expected + 1e-9;
                    // A channel without extinction emits nothing.
                    let is_right = (mean - expected).abs().cmple(bound) | extinction.cmple(Rgb::ZERO);
                    assert!(is_right.all(), "{name}, {extinction}: {mean}, not {expected}");
                }
            }
        }
    }

    #[test]
    fn split_walks_collide_as_extinction_says() {
        for (name, density) in densities() {
            for extinction in COLOURS {
                let medium = medium(extinction, density.clone());
                let histogram = Histogram::of(30_000, |stream| {
                    let forced = force(&medium, &ray(), (0.0, FAR), Rgb::ONE, stream);
                    let collided = forced.collision.map(|(t, weight)| (Some(t), weight));
                    collided.into_iter().chain([(None, forced.passed)]).collect()
                });
                histogram.assert_extinction(&format!("{name}, {extinction}"), &medium);
            }
        }
    }

    /// 1 − e^{−τ} of an optical depth of 10⁻⁸ has all its digits.
    #[test]
    fn split_walks_are_exact_in_thin_media() {
        let thin = medium(Rgb::new(1e-9, 1e-8, 1e-12), Density::Uniform);
        let (mut sum, draws) = (Rgb::ZERO, 10_000);
        for i in 0..draws {
            let mut stream = Stream::new(5, Purpose::Test, i, 0);
            let forced = force(&thin, &ray(), (0.0, 1.0), Rgb::ONE, &mut stream);
            let (t, weight) = forced.collision.expect("forced");
            assert!((0.0..=1.0).contains(&t));
            sum += weight;
        }
        // The weights do not vary: σ over its mean.
        let mean = sum / draws as f64;
        assert!((mean / thin.extinction - 1.0).abs().max_element() < 1e-6, "{mean}");
    }

    #[test]
    fn passing_is_transmittance_on_average() {
        for (name, density) in densities() {
            for extinction in COLOURS {
                let medium = medium(extinction, density.clone());
                let (mut sum, mut squares, n) = (Rgb::ZERO, Rgb::ZERO, 60_000);
                for i in 0..n {
                    let mut stream = Stream::new(3, Purpose::Test, i, 0);
                    let mut weight = Rgb::ONE;
                    pass(&medium, &ray(), (0.0, FAR), &mut weight, &mut stream);
                    sum += weight;
                    squares += weight * weight;
                }
                let n = n as f64;
                let (mean, exact) = (sum / n, medium.transmittance(medium.density.depth(&ray(), 0.0, FAR)));
                let deviation = ((squares / n - mean * mean).max(Rgb::ZERO) / n).map(f64::sqrt);
                let bound = deviation * 4.5 + 1e-12;
                assert!((mean - exact).abs().cmple(bound).all(), "{name}, {extinction}: {mean} against {exact}");
            }
        }
    }

    /// A channel without extinction lets everything pass; the others, nothing that is endless.
    #[test]
    fn endless_media() {
        let medium = medium(Rgb::new(0.0, 0.5, 2.0), Density::Uniform);
        let mut tally = Tally::default();
        for i in 0..1000 {
            let mut stream = Stream::new(9, Purpose::Test, i, 0);
            let mut weight = Rgb::ONE;
            let t = fly(&medium, &ray(), (0.0, f64::INFINITY), &mut weight, &mut stream, &mut tally, |_, _, _| {});
            assert!(weight.is_finite());
            match t {
                Some(t) => assert!(t.is_finite() && weight.x == 0.0),
                None => assert_eq!(weight, Rgb::new(3.0, 0.0, 0.0)),
            }
        }
    }
}
