//! Marching: where along a ray something is evaluated, and what each place weighs (Jensen 2001, §10.4).
//!
//! All three marchers divide the ray into steps and draw one place in each, in proportion to the transmittance of a
//! locally constant medium. A place then weighs T(t)/p(t), with the exact T: in a constant medium this is ∫T over
//! the step, wherever the place is, and in any medium the sum is right on average for any size of steps.

use super::DepthTable;
use crate::math::{Ray, Rgb, Stream};
use crate::medium::Medium;
use crate::transport::shares;

/// How long steps are.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Stepping {
    /// All alike.
    Uniform,
    /// Halved while the density or the light at their ends differs by more than this, as a share of the larger of
    /// both and of the ray's mean.
    Adaptive {
        /// The largest difference.
        contrast: f64,
    },
    /// In inverse proportion to the transmittance: each step sees the same share of what there is to see.
    Exponential,
}

/// A marcher.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Marcher {
    /// How long steps are.
    pub stepping: Stepping,
    /// The smallest step, above 0; steps that must fill a stretch are a little shorter.
    pub size: f64,
}

/// A stretch of a ray through one medium.
#[derive(Clone, Copy, Debug)]
pub struct Stretch<'a> {
    /// The ray.
    pub ray: &'a Ray,
    /// Where transmittance starts to count.
    pub from: f64,
    /// Where marching begins, not before `from`.
    pub a: f64,
    /// Where it ends; finite.
    pub b: f64,
    /// What is around.
    pub medium: &'a Medium,
    /// The density integrated since `from`, which is where the table starts; `None` for a density of 1.
    pub depth: Option<&'a DepthTable>,
    /// What light at `from` would count, by channel: channels that count little get few places.
    pub weight: Rgb,
}

/// Memory that a thread reuses.
#[derive(Clone, Debug, Default)]
pub struct Steps {
    knots: Vec<Knot>,
}

/// A place on the ray: the transmitted share of light, averaged over the channels, and its integral up to there.
#[derive(Clone, Copy, Debug)]
struct Knot {
    t: f64,
    transmitted: f64,
    mass: f64,
}

/// Below this transmittance, steps go on by roulette.
const FAINT: f64 = 0.05;

/// Adaptive marching starts with steps this many times the smallest.
const COARSEST: f64 = 16.0;

/// How often adaptive marching looks between the ends of a step.
const LOOK_BETWEEN: f64 = 0.5;

/// Knots between which exponential marching takes the transmittance for exponential.
const KNOTS: usize = 128;

/// A marched integral, by quantity.
type Sums<const N: usize> = [Rgb; N];

impl Stretch<'_> {
    fn depth(&self, t: f64) -> f64 {
        self.depth.map_or(t - self.from, |table| table.depth_at(t - self.from))
    }

    /// The share of light that arrives from depth `d`, averaged over the channels by what they count.
    fn transmitted(&self, d: f64) -> f64 {
        (shares(self.weight) * self.medium.transmittance(d)).element_sum()
    }
}

/// One step: its ends, and the depths there.
#[derive(Clone, Copy)]
struct Step {
    ends: [f64; 2],
    depths: [f64; 2],
}

/// A place in a step.
struct Place {
    t: f64,
    /// The share of the step that lies before it.
    x: f64,
    /// Its probability density.
    density: f64,
}

impl Step {
    fn new(stretch: &Stretch, a: f64, b: f64) -> Self {
        Step { ends: [a, b], depths: [stretch.depth(a), stretch.depth(b)] }
    }

    /// The optical depth of the step, by channel.
    fn tau(&self, stretch: &Stretch) -> Rgb {
        stretch.medium.extinction * (self.depths[1] - self.depths[0])
    }

    /// A place drawn in proportion to transmittance: in the mean over channels, by what of each arrives from here.
    fn place(&self, stretch: &Stretch, u: f64) -> Place {
        let [a, b] = self.ends;
        let tau = self.tau(stretch);
        let arriving = shares(stretch.weight * stretch.medium.transmittance(self.depths[0]));
        // One number chooses the channel and then the place.
        let (mut rest, mut channel) = (u, 0);
        while channel < 2 && rest >= arriving[channel] {
            rest -= arriving[channel];
            channel += 1;
        }
        let grey = tau.x == tau.y && tau.x == tau.z;
        let v = if grey { u } else { (rest / arriving[channel]).clamp(0.0, 1.0) };
        let x = exponential(tau[channel], v);
        let density = (arriving * tau.map(|tau| (-tau * x).exp() / mean_transmittance(tau))).element_sum();
        Place { t: a + (b - a) * x, x, density: density / (b - a) }
    }
}

/// (1 − e^{−τ})/τ
fn mean_transmittance(tau: f64) -> f64 {
    crate::math::one_minus_exp_over(tau)
}

/// ∫₀¹ x e^{−τx} dx
fn first_moment(tau: f64) -> f64 {
    if tau < 1e-3 {
        0.5 - tau / 3.0 + tau * tau / 8.0
    } else {
        (mean_transmittance(tau) - (-tau).exp()) / tau
    }
}

/// x in [0, 1] with density ∝ e^{−τx}.
fn exponential(tau: f64, u: f64) -> f64 {
    if tau < 1e-9 { u } else { (-(u * (-tau).exp_m1()).ln_1p() / tau).min(1.0) }
}

/// Roulette by transmittance, once it is faint.
struct Roulette {
    /// The share of marches that have come this far.
    reached: f64,
}

impl Roulette {
    /// Whether to go on where so much light is transmitted.
    fn goes_on(&mut self, transmitted: f64, stream: &mut Stream) -> bool {
        let share = (transmitted / FAINT).min(1.0);
        if share >= self.reached {
            return true;
        }
        let chance = share / self.reached;
        self.reached = share;
        stream.uniform() < chance
    }
}

impl Marcher {
    /// ∫ T(t) S(t) dt over a stretch, as seen at its `from`, for quantities S that `source` tells at a place; the
    /// first of them guides adaptive steps.
    pub fn march<const N: usize>(
        &self,
        stretch: &Stretch,
        stream: &mut Stream,
        steps: &mut Steps,
        source: &mut impl FnMut(f64, &mut Stream) -> [Rgb; N],
    ) -> [Rgb; N] {
        let mut sums = [Rgb::ZERO; N];
        let length = stretch.b - stretch.a;
        let mut roulette = Roulette { reached: 1.0 };
        let start = stretch.transmitted(stretch.depth(stretch.a));
        if length.is_nan() || length <= 0.0 || !roulette.goes_on(start, stream) {
            return sums;
        }
        match self.stepping {
            Stepping::Uniform => {
                let count = (length / self.size).ceil().max(1.0);
                let u = stream.uniform();
                let mut step = Step::new(stretch, stretch.a, stretch.a);
                for i in 1..=count as u64 {
                    let end = stretch.a + length * (i as f64 / count);
                    step = Step { ends: [step.ends[1], end], depths: [step.depths[1], stretch.depth(end)] };
                    if !roulette.goes_on(stretch.transmitted(step.depths[0]), stream) {
                        break;
                    }
                    add(&mut sums, stretch, &step, u, 1.0 / roulette.reached, stream, source);
                }
            }
            Stepping::Exponential => {
                steps.tabulate(stretch);
                let mass = steps.knots.last().map_or(0.0, |knot| knot.mass);
                let count = (mass / self.size).ceil().max(1.0);
                let u = stream.uniform();
                let mut step = Step::new(stretch, stretch.a, stretch.a);
                let mut knot = 1;
                for i in 1..=count as u64 {
                    let end = if i as f64 == count {
                        stretch.b
                    } else {
                        steps.place(mass * (i as f64 / count), &mut knot).clamp(step.ends[1], stretch.b)
                    };
                    step = Step { ends: [step.ends[1], end], depths: [step.depths[1], stretch.depth(end)] };
                    add(&mut sums, stretch, &step, u, 1.0 / roulette.reached, stream, source);
                }
            }
            Stepping::Adaptive { contrast } => {
                self.adapt(stretch, contrast, &mut roulette, stream, source, &mut sums);
            }
        }
        sums
    }

    /// Adaptive marching. The source between the ends of a step is taken for linear; what that misses is estimated at
    /// a place between, every second time: the steps themselves were chosen by the values at their ends, and would
    /// otherwise miss, on average, what is too small for them.
    fn adapt<const N: usize>(
        &self,
        stretch: &Stretch,
        contrast: f64,
        roulette: &mut Roulette,
        stream: &mut Stream,
        source: &mut impl FnMut(f64, &mut Stream) -> [Rgb; N],
        sums: &mut Sums<N>,
    ) {
        let length = stretch.b - stretch.a;
        let levels = (length / (2.0 * self.size)).max(1.0).min(COARSEST).log2().floor();
        let coarse = self.size * levels.exp2();
        let mut probe = |t: f64, stream: &mut Stream| {
            let depth = stretch.depth(t);
            Probe { t, depth, density: stretch.medium.density.at(stretch.ray.at(t)), source: source(t, stream) }
        };
        let mut waiting: smallvec::SmallVec<[Probe<N>; 8]> = smallvec::SmallVec::new();
        let mut seen = (0.0, 0.0);
        let mut start = probe(stretch.a, stream);
        let mut next = stretch.a + coarse * (0.25 + 0.75 * stream.uniform());
        while start.t < stretch.b {
            if !roulette.goes_on(stretch.transmitted(start.depth), stream) {
                return;
            }
            // A short rest at the end joins the last step.
            let end = if next > stretch.b - 0.25 * coarse { stretch.b } else { next };
            next = end + coarse;
            waiting.push(probe(end, stream));
            while let Some(end) = waiting.last() {
                let width = end.t - start.t;
                let brightest = |probe: &Probe<N>| probe.source[0].max_element();
                let [here, there] = [brightest(&start), brightest(end)];
                let mean = if seen.1 > 0.0 { seen.0 / seen.1 } else { 0.0 };
                let arriving = stretch.transmitted(start.depth);
                let reference = (arriving * here.max(there)).max(mean);
                let differs = (start.source[0] - end.source[0]).abs().max_element() * arriving > contrast * reference
                    || (start.density - end.density).abs() > contrast * start.density.max(end.density);
                if differs && width >= 2.0 * self.size * (1.0 - 1e-9) {
                    waiting.push(probe(start.t + 0.5 * width, stream));
                    continue;
                }
                seen.0 += 0.5 * (here + there) * arriving * width;
                seen.1 += width;
                let step = Step { ends: [start.t, end.t], depths: [start.depth, end.depth] };
                let tau = step.tau(stretch);
                let first = stretch.medium.transmittance(start.depth) * (width / roulette.reached);
                let late = tau.map(first_moment);
                let early = tau.map(mean_transmittance) - late;
                for (i, sum) in sums.iter_mut().enumerate() {
                    *sum += first * (early * start.source[i] + late * end.source[i]);
                }
                if stream.uniform() < LOOK_BETWEEN {
                    let place = step.place(stretch, stream.uniform());
                    let between = probe(place.t, stream);
                    let factor = 1.0 / (place.density * roulette.reached * LOOK_BETWEEN);
                    let exact = stretch.medium.transmittance(between.depth) * factor;
                    let constant =
                        stretch.medium.transmittance(start.depth) * tau.map(|tau| (-tau * place.x).exp()) * factor;
                    for (i, sum) in sums.iter_mut().enumerate() {
                        let linear = start.source[i].lerp(end.source[i], place.x);
                        *sum += exact * between.source[i] - constant * linear;
                    }
                }
                if let Some(end) = waiting.pop() {
                    start = end;
                }
            }
        }
    }
}

/// What adaptive marching knows of a place.
#[derive(Clone, Copy)]
struct Probe<const N: usize> {
    t: f64,
    depth: f64,
    density: f64,
    source: [Rgb; N],
}

/// Adds what one place in a step says.
fn add<const N: usize>(
    sums: &mut Sums<N>,
    stretch: &Stretch,
    step: &Step,
    u: f64,
    factor: f64,
    stream: &mut Stream,
    source: &mut impl FnMut(f64, &mut Stream) -> [Rgb; N],
) {
    if step.ends[1] <= step.ends[0] {
        return;
    }
    let place = step.place(stretch, u);
    let weight = stretch.medium.transmittance(stretch.depth(place.t)) * (factor / place.density);
    if weight.max_element() > 0.0 && weight.is_finite() {
        let values = source(place.t, stream);
        for (sum, value) in sums.iter_mut().zip(values) {
            *sum += weight * value;
        }
    }
}

impl Steps {
    /// Knots along the stretch, closer together at its start.
    fn tabulate(&mut self, stretch: &Stretch) {
        self.knots.clear();
        let length = stretch.b - stretch.a;
        let mut last = Knot { t: stretch.a, transmitted: stretch.transmitted(stretch.depth(stretch.a)), mass: 0.0 };
        self.knots.push(last);
        let grey = stretch.medium.extinction.max_element() == stretch.medium.extinction.min_element();
        // One exponential says it all.
        let count = if stretch.depth.is_none() && grey { 1 } else { KNOTS };
        for i in 1..=count {
            let t = stretch.a + length * (i as f64 / count as f64).powi(2);
            let transmitted = stretch.transmitted(stretch.depth(t));
            let tau = (last.transmitted / transmitted).ln();
            let mean = if tau.is_finite() { last.transmitted * mean_transmittance(tau) } else { 0.5 * last.transmitted };
            last = Knot { t, transmitted, mass: last.mass + mean * (t - last.t) };
            self.knots.push(last);
        }
    }

    /// Where the mass reaches `mass`, looking from knot `from` on.
    fn place(&self, mass: f64, from: &mut usize) -> f64 {
        while *from + 1 < self.knots.len() && self.knots[*from].mass < mass {
            *from += 1;
        }
        let (before, after) = (self.knots[*from - 1], self.knots[*from]);
        let share = ((mass - before.mass) / (after.mass - before.mass)).clamp(0.0, 1.0);
        let tau = (before.transmitted / after.transmitted).ln();
        before.t + (after.t - before.t) * if tau.is_finite() { exponential(tau, share) } else { share }
    }
}
