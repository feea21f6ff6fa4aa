//! Marching: where along a ray something is evaluated, and what each place weighs (Jensen 2001, §10.4).
//!
//! All marchers divide the ray into steps and draw one place in each, in proportion to the transmittance of a
//! locally constant medium. A place then weighs T(t)/p(t), with the exact T: in a constant medium this is ∫T over
//! the step, wherever the place is, and in any medium the sum is right on average for any size of steps.

use super::DepthTable;
use crate::math::{Ray, Rgb, Stream, shares};
use crate::medium::Medium;
use smallvec::SmallVec;

/// How long steps are.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Stepping {
    /// All alike.
    Uniform,
    /// Halved while the density or the light at their ends differs by more than this, as a share of the larger; light
    /// as a share of the ray's mean where that is more.
    Adaptive {
        /// The largest difference.
        contrast: f64,
    },
    /// In inverse proportion to the transmittance: each step sees the same share of what there is to see.
    Exponential,
    /// As long as light flies freely where they begin, −ln ξ/σ_t, but no shorter than the smallest, nor where the density varies longer
    /// than a few of these (Jensen 2001, Eq. 10.20).
    Random,
}

/// A marcher.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Marcher {
    /// How long steps are.
    pub stepping: Stepping,
    /// The smallest step, above 0; steps that must fill a segment are a little shorter, and those of a segment that would take more
    /// than some 100 000 are longer.
    pub size: f64,
}

/// A segment of a ray, as it is marched along.
#[derive(Clone, Copy, Debug)]
pub struct MarchSegment<'a> {
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
    knots: Vec<TransmittanceKnot>,
}

/// [`Steps`], and a table of depths where the density varies.
#[derive(Debug, Default)]
pub struct March {
    steps: Steps,
    table: DepthTable,
}

impl March {
    /// Marches along a ray from `a` to `b`, both finite, through one medium, depth counted from `from`; see [`Marcher::march`]. `weight`
    /// is what light at `from` counts, by channel.
    pub fn along<const N: usize>(
        &mut self,
        marcher: &Marcher,
        (ray, from, a, b): (&Ray, f64, f64, f64),
        (medium, weight): (&Medium, Rgb),
        stream: &mut Stream,
        source: &mut impl FnMut(f64, &mut Stream) -> [Rgb; N],
    ) -> [Rgb; N] {
        let depth = if medium.density.is_even() {
            None
        } else {
            self.table.tabulate(medium, ray, (from, b));
            Some(&self.table)
        };
        let segment = MarchSegment { ray, from, a, b, medium, depth, weight };
        marcher.march(&segment, stream, &mut self.steps, source)
    }
}

/// A place on the ray: the transmitted share of light, averaged over the channels, and its integral up to there.
#[derive(Clone, Copy, Debug)]
struct TransmittanceKnot {
    t: f64,
    transmitted: f64,
    mass: f64,
}

/// Below this transmittance, steps go on by roulette.
const FAINT: f64 = 0.05;

/// Adaptive marching starts with steps this many times the smallest. Longer ones come upon what is small and bright
/// seldom, and then with a large weight: in `scenes/volume-caustic.toml` 8 and 16 are noisier, 2 is slower.
const COARSEST: f64 = 4.0;

/// Random steps are no longer than this many times the smallest where the density varies: what lies beyond may be dense.
const LONGEST: f64 = 8.0;

/// No piece of a ray takes more steps than about this many, however short they are said to be: the sum is right on average for any size.
const MOST_STEPS: f64 = 1e5;

/// Knots between which exponential marching takes the transmittance for exponential.
const KNOTS: usize = 128;

impl MarchSegment<'_> {
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
struct DrawnPlace {
    t: f64,
    /// The share of the step that lies before it.
    x: f64,
    /// Its probability density.
    density: f64,
}

impl Step {
    fn new(segment: &MarchSegment, a: f64, b: f64) -> Self {
        Step { ends: [a, b], depths: [segment.depth(a), segment.depth(b)] }
    }

    /// The optical depth of the step, by channel.
    fn tau(&self, segment: &MarchSegment) -> Rgb {
        segment.medium.extinction * (self.depths[1] - self.depths[0])
    }

    /// A place drawn in proportion to transmittance: in the mean over channels, by what of each arrives from here.
    fn place(&self, segment: &MarchSegment, u: f64) -> DrawnPlace {
        let [a, b] = self.ends;
        let tau = self.tau(segment);
        let arriving = shares(segment.weight * segment.medium.transmittance(self.depths[0]));
        // One number chooses the channel and then the place.
        let (mut rest, mut channel) = (u, 0);
        while channel < 2 && rest >= arriving[channel] {
            rest -= arriving[channel];
            channel += 1;
        }
        let grey = tau.x == tau.y && tau.x == tau.z;
        let v = if grey { u } else { (rest / arriving[channel].max(f64::MIN_POSITIVE)).min(1.0) };
        let x = exponential(tau[channel], v);
        let density = (arriving * tau.map(|tau| (-tau * x).exp() / mean_transmittance(tau))).element_sum();
        DrawnPlace { t: a + (b - a) * x, x, density: density / (b - a) }
    }
}

impl Step {
    /// A place drawn in proportion to the light that arrives if it is linear between the ends; [`BLIND`] of them by transmittance alone.
    fn place_by_light(&self, segment: &MarchSegment, light: [Rgb; 2], u: f64) -> DrawnPlace {
        let tau = self.tau(segment);
        let arriving = shares(segment.weight * segment.medium.transmittance(self.depths[0]));
        let late = tau.map(first_moment);
        let early = tau.map(mean_transmittance) - late;
        let masses = arriving * (early * light[0] + late * light[1]);
        let mass = masses.element_sum();
        let seen = (mass > 0.0 && mass.is_finite()) as u8 as f64 * (1.0 - BLIND);
        let width = self.ends[1] - self.ends[0];

        // One number chooses the channel and then the place.
        let x = if u >= seen {
            self.place(segment, ((u - seen) / (1.0 - seen)).min(1.0f64.next_down())).x
        } else {
            let (mut rest, mut channel) = (u / seen * mass, 0);
            while channel < 2 && rest >= masses[channel] {
                rest -= masses[channel];
                channel += 1;
            }
            let v = (rest / masses[channel].max(f64::MIN_POSITIVE)).min(1.0);
            linear_times_exponential([light[0][channel], light[1][channel]], tau[channel], v)
        };
        let faded = arriving * tau.map(|tau| (-tau * x).exp());
        let by_transmittance = (faded / tau.map(mean_transmittance)).element_sum();
        let by_light = if seen > 0.0 { (faded * light[0].lerp(light[1], x)).element_sum() / mass } else { 0.0 };
        let density = (seen * by_light + (1.0 - seen) * by_transmittance) / width;
        DrawnPlace { t: self.ends[0] + width * x, x, density }
    }
}

/// The share of places of adaptive steps that are drawn without regard to the light at their ends: between them it may be anything.
const BLIND: f64 = 0.25;

/// x in [0, 1] with density ∝ (s₀ + (s₁ − s₀) x) e^{−τx}, both s at least 0 and one above.
fn linear_times_exponential(s: [f64; 2], tau: f64, u: f64) -> f64 {
    if s[0] == s[1] {
        return exponential(tau, u);
    }
    let before = |x: f64| x * (s[0] * mean_transmittance(tau * x) + (s[1] - s[0]) * x * first_moment(tau * x));
    let wanted = u * before(1.0);
    // Newton's steps, where they stay in the bracket.
    let (mut low, mut high) = (0.0, 1.0);
    let mut x = exponential(tau, u);
    for _ in 0..64 {
        let over = before(x) - wanted;
        if over > 0.0 {
            high = x
        } else {
            low = x
        }
        let next = x - over / ((s[0] + (s[1] - s[0]) * x) * (-tau * x).exp());
        let next = if next > low && next < high { next } else { 0.5 * (low + high) };
        if (next - x).abs() <= 1e-14 {
            return next;
        }
        x = next;
    }
    x
}

/// (1 − e^{−τ})/τ
fn mean_transmittance(tau: f64) -> f64 {
    crate::math::one_minus_exp_over(tau)
}

/// ∫₀¹ x e^{−τx} dx
fn first_moment(tau: f64) -> f64 {
    if tau < 1e-3 { 0.5 - tau / 3.0 + tau * tau / 8.0 } else { (mean_transmittance(tau) - (-tau).exp()) / tau }
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
    /// About how many places there are per length in a medium where this share of light is transmitted.
    pub fn places(&self, medium: &Medium, transmitted: f64) -> f64 {
        match self.stepping {
            Stepping::Random => {
                // The mean of the longer one of a free path and the smallest step.
                let rate = medium.max_extinction();
                rate / (self.size * rate + (-self.size * rate).exp())
            }
            Stepping::Uniform | Stepping::Adaptive { .. } => 1.0 / self.size,
            Stepping::Exponential => transmitted / self.size,
        }
    }

    /// ∫ T(t) S(t) dt over a segment, as seen at its `from`, for quantities S that `source` tells at a place; the
    /// first of them guides adaptive steps.
    pub fn march<const N: usize>(
        &self,
        segment: &MarchSegment,
        stream: &mut Stream,
        steps: &mut Steps,
        source: &mut impl FnMut(f64, &mut Stream) -> [Rgb; N],
    ) -> [Rgb; N] {
        let mut sums = [Rgb::ZERO; N];
        let length = segment.b - segment.a;
        let shortest = (length / MOST_STEPS).max(4.0 * f64::EPSILON * segment.b.abs());
        let marcher = Marcher { size: self.size.max(shortest), ..*self };
        let mut roulette = Roulette { reached: 1.0 };
        let start = segment.transmitted(segment.depth(segment.a));
        if length.is_nan() || length <= 0.0 || !roulette.goes_on(start, stream) {
            return sums;
        }
        match marcher.stepping {
            Stepping::Uniform => {
                let count = (length / marcher.size).ceil().max(1.0);
                let u = stream.uniform();
                let mut step = Step::new(segment, segment.a, segment.a);
                for i in 1..=count as u64 {
                    let end = segment.a + length * (i as f64 / count);
                    step = Step { ends: [step.ends[1], end], depths: [step.depths[1], segment.depth(end)] };
                    if !roulette.goes_on(segment.transmitted(step.depths[0]), stream) {
                        break;
                    }
                    add(&mut sums, segment, &step, u, 1.0 / roulette.reached, stream, source);
                }
            }
            Stepping::Exponential => {
                steps.tabulate(segment);
                let mass = steps.knots.last().map_or(0.0, |knot| knot.mass);
                let count = (mass / marcher.size).ceil().max(1.0);
                let u = stream.uniform();
                let mut step = Step::new(segment, segment.a, segment.a);
                let mut knot = 1;
                for i in 1..=count as u64 {
                    let end = if i as f64 == count {
                        segment.b
                    } else {
                        steps.place(mass * (i as f64 / count), &mut knot).max(step.ends[1]).min(segment.b)
                    };
                    step = Step { ends: [step.ends[1], end], depths: [step.depths[1], segment.depth(end)] };
                    add(&mut sums, segment, &step, u, 1.0 / roulette.reached, stream, source);
                }
            }
            Stepping::Random => {
                let even = segment.medium.density.is_even();
                let longest = if even { f64::INFINITY } else { LONGEST * marcher.size };
                let extinction = segment.medium.extinction.max_element();
                let mut step = Step::new(segment, segment.a, segment.a);
                while step.ends[1] < segment.b && roulette.goes_on(segment.transmitted(step.depths[1]), stream) {
                    let from = step.ends[1];
                    let density = if even { 1.0 } else { segment.medium.density.at(segment.ray.at(from)) };
                    let length = (stream.exponential() / (extinction * density)).clamp(marcher.size, longest);
                    let end = (from + length).min(segment.b);
                    step = Step { ends: [from, end], depths: [step.depths[1], segment.depth(end)] };
                    let u = stream.uniform();
                    add(&mut sums, segment, &step, u, 1.0 / roulette.reached, stream, source);
                }
            }
            Stepping::Adaptive { contrast } => {
                marcher.adapt(segment, contrast, &mut roulette, stream, source, &mut sums);
            }
        }
        sums
    }

    /// Adaptive marching. What the ends of a step tell, by which the steps were chosen, says where between them a place is drawn, and
    /// only that counts: no matter what was found at the ends, the sum is right on average, and no place counts less than nothing.
    fn adapt<const N: usize>(
        &self,
        segment: &MarchSegment,
        contrast: f64,
        roulette: &mut Roulette,
        stream: &mut Stream,
        source: &mut impl FnMut(f64, &mut Stream) -> [Rgb; N],
        sums: &mut [Rgb; N],
    ) {
        let length = segment.b - segment.a;
        let levels = (length / (2.0 * self.size)).clamp(1.0, COARSEST).log2().floor();
        let coarse = self.size * levels.exp2();
        let mut probe = |t: f64, stream: &mut Stream| {
            let depth = segment.depth(t);
            Probe { t, depth, density: segment.medium.density.at(segment.ray.at(t)), source: source(t, stream) }
        };
        // The longest steps first: what they see on average tells what matters.
        let mut coarsest: SmallVec<[(Probe<N>, f64); 32]> = SmallVec::new();
        let mut start = probe(segment.a, stream);
        let mut next = segment.a + coarse * (0.25 + 0.75 * stream.uniform());
        let mut mean = 0.0;
        coarsest.push((start, 1.0));
        while start.t < segment.b && roulette.goes_on(segment.transmitted(start.depth), stream) {
            // A short rest at the end joins the last step.
            let end = probe(if next > segment.b - 0.25 * coarse { segment.b } else { next }, stream);
            mean += 0.5 * (start.arriving(segment) + end.arriving(segment)) * (end.t - start.t) / length;
            coarsest.push((end, roulette.reached));
            next = end.t + coarse;
            start = end;
        }

        let mut waiting: SmallVec<[Probe<N>; 8]> = SmallVec::new();
        for ends in coarsest.windows(2) {
            let (mut start, reached) = (ends[0].0, ends[1].1);
            waiting.push(ends[1].0);
            while let Some(end) = waiting.last() {
                let width = end.t - start.t;
                let arriving = segment.transmitted(start.depth);
                let brightest = start.source[0].max(end.source[0]).max_element();
                let change = (start.source[0] - end.source[0]).abs().max_element();
                let differs = change * arriving > contrast * mean.max(brightest * arriving)
                    || (start.density - end.density).abs() > contrast * start.density.max(end.density);
                if differs && width >= 2.0 * self.size * (1.0 - 1e-9) {
                    waiting.push(probe(start.t + 0.5 * width, stream));
                    continue;
                }
                let step = Step { ends: [start.t, end.t], depths: [start.depth, end.depth] };
                let place = step.place_by_light(segment, [start.source[0], end.source[0]], stream.uniform());
                let between = probe(place.t, stream);
                let weight = segment.medium.transmittance(between.depth) / (place.density * reached);
                for (sum, value) in sums.iter_mut().zip(between.source) {
                    *sum += weight * value;
                }
                start = *end;
                waiting.pop();
            }
        }
    }
}

impl<const N: usize> Probe<N> {
    /// The brightest channel of the source, faded by the way to here.
    fn arriving(&self, segment: &MarchSegment) -> f64 {
        self.source[0].max_element() * segment.transmitted(self.depth)
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
    sums: &mut [Rgb; N],
    segment: &MarchSegment,
    step: &Step,
    u: f64,
    factor: f64,
    stream: &mut Stream,
    source: &mut impl FnMut(f64, &mut Stream) -> [Rgb; N],
) {
    if step.ends[1] <= step.ends[0] {
        return;
    }
    let place = step.place(segment, u);
    let weight = segment.medium.transmittance(segment.depth(place.t)) * (factor / place.density);
    if weight.max_element() > 0.0 && weight.is_finite() {
        let values = source(place.t, stream);
        for (sum, value) in sums.iter_mut().zip(values) {
            *sum += weight * value;
        }
    }
}

impl Steps {
    /// Knots along the segment, closer together at its start.
    fn tabulate(&mut self, segment: &MarchSegment) {
        self.knots.clear();
        let length = segment.b - segment.a;
        let mut last =
            TransmittanceKnot { t: segment.a, transmitted: segment.transmitted(segment.depth(segment.a)), mass: 0.0 };
        self.knots.push(last);
        let grey = segment.medium.extinction.max_element() == segment.medium.extinction.min_element();
        // One exponential says it all.
        let count = if segment.depth.is_none() && grey { 1 } else { KNOTS };
        for i in 1..=count {
            let t = segment.a + length * (i as f64 / count as f64).powi(2);
            let transmitted = segment.transmitted(segment.depth(t));
            let tau = (last.transmitted / transmitted).ln();
            let mean =
                if tau.is_finite() { last.transmitted * mean_transmittance(tau) } else { 0.5 * last.transmitted };
            last = TransmittanceKnot { t, transmitted, mass: last.mass + mean * (t - last.t) };
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::DVec3;
    use crate::math::random::Purpose;
    use crate::medium::Emission;
    use crate::medium::density::{Density, Exponential};
    use crate::medium::phase::{Isotropic, Phase};

    const STEPPINGS: [Stepping; 4] =
        [Stepping::Uniform, Stepping::Adaptive { contrast: 0.2 }, Stepping::Exponential, Stepping::Random];

    fn medium(extinction: [f64; 3], density: Density) -> Medium {
        Medium {
            name: String::new(),
            extinction: extinction.into(),
            albedo: Rgb::ONE.into(),
            phase: Phase::Isotropic(Isotropic).into(),
            density,
            emission: Emission::None,
        }
    }

    /// The mean of many marches over its expectation, its standard error, and how many places each took.
    fn run(marcher: &Marcher, segment: &MarchSegment, source: impl Fn(f64) -> Rgb, expected: Rgb) -> (Rgb, Rgb, f64) {
        const MARCHES: u64 = 4000;
        let (mut sum, mut squares, mut places) = (Rgb::ZERO, Rgb::ZERO, 0u64);
        let mut steps = Steps::default();
        for i in 0..MARCHES {
            let mut stream = Stream::new(3, Purpose::Test, i, 0);
            let [one] = marcher.march(segment, &mut stream, &mut steps, &mut |t, _| {
                places += 1;
                [source(t)]
            });
            sum += one / expected;
            squares += one * one / (expected * expected);
        }
        let count = MARCHES as f64;
        let mean = sum / count;
        let variance = (squares / count - mean * mean).max(Rgb::ZERO);
        (mean, (variance / count).map(f64::sqrt), places as f64 / count)
    }

    /// ∫ T S dt by the midpoint rule.
    fn integral(segment: &MarchSegment, source: impl Fn(f64) -> Rgb) -> Rgb {
        const N: usize = 200_000;
        let width = (segment.b - segment.a) / N as f64;
        let at = |i: usize| segment.a + (i as f64 + 0.5) * width;
        (0..N).map(|i| segment.medium.transmittance(segment.depth(at(i))) * source(at(i)) * width).sum::<Rgb>()
    }

    /// Right on average, for steps of any size: light that varies, a flash much shorter than the steps, media that
    /// are thin, thick, coloured, and thinning out, and segments that begin late.
    #[test]
    fn every_marcher_is_right_on_average() {
        let wave = |t: f64| Rgb::new(1.0 + (3.0 * t).sin(), 1.0, (-t).exp());
        let flash = |t: f64| Rgb::splat(if (1.3..1.6).contains(&t) { 1.0 } else { 0.01 });
        let ray = Ray::new(DVec3::new(0.0, 0.0, -1.0), DVec3::Z);
        let air = Exponential { origin: DVec3::ZERO, up: DVec3::Z, scale_height: 0.5, value: 3.0 };
        for (extinction, density) in [
            ([0.0, 1e-7, 0.3], Density::Uniform),
            ([0.7; 3], Density::Uniform),
            ([0.2, 2.0, 40.0], Density::Uniform),
            ([0.5, 1.0, 3.0], Density::Exponential(air)),
        ] {
            let medium = medium(extinction, density);
            for (a, b) in [(0.0, 4.0), (1.0, 2.0)] {
                let mut table = DepthTable::new();
                if let Density::Exponential(air) = &medium.density {
                    for i in 0..=400 {
                        let t = b * f64::from(i) / 400.0;
                        table.push(t, medium.density.depth(&ray, 0.0, t), air.at(ray.at(t)));
                    }
                    table.finish();
                }
                let depth = (!medium.density.is_even()).then_some(&table);
                let of_weight = |weight| MarchSegment { ray: &ray, from: 0.0, a, b, medium: &medium, depth, weight };
                let sources: [(&str, &dyn Fn(f64) -> Rgb); 2] = [("wave", &wave), ("flash", &flash)];
                for (name, source) in sources {
                    let expected = integral(&of_weight(Rgb::ONE), source);
                    for weight in [Rgb::ONE, Rgb::new(0.0, 1.0, 5.0)] {
                        for (stepping, size) in
                            STEPPINGS.into_iter().flat_map(|s| [0.1, 0.5, 9.0].map(|size| (s, size)))
                        {
                            let marcher = Marcher { stepping, size };
                            let (mean, error, _) = run(&marcher, &of_weight(weight), source, expected);
                            for c in (0..3).filter(|&c| weight[c] > 0.0) {
                                let found = (mean[c] - 1.0).abs();
                                assert!(
                                    found < 4.0 * error[c] + 1e-4,
                                    "{name} {extinction:?} {a} {weight} {marcher:?} {c}: {mean} ± {error}"
                                );
                            }
                        }
                    }
                }
            }
        }
    }

    #[test]
    fn even_light_in_an_even_grey_medium_needs_one_place() {
        let ray = Ray::new(DVec3::ZERO, DVec3::Z);
        let medium = medium([0.7; 3], Density::Uniform);
        let segment =
            MarchSegment { ray: &ray, from: 0.0, a: 0.5, b: 4.0, medium: &medium, depth: None, weight: Rgb::ONE };
        let expected = Rgb::splat(((-0.35f64).exp() - (-2.8f64).exp()) / 0.7);
        for stepping in STEPPINGS {
            let (mean, error, _) = run(&Marcher { stepping, size: 9.0 }, &segment, |_| Rgb::ONE, expected);
            assert!(
                (mean - 1.0).abs().max_element() < 1e-9 && error.max_element() < 1e-7,
                "{stepping:?} {mean} {error}"
            );
        }
    }

    /// Steps too short to be taken, or even to be told from none, are longer.
    #[test]
    fn steps_however_short_are_bounded() {
        let ray = Ray::new(DVec3::ZERO, DVec3::Z);
        let medium = medium([0.7; 3], Density::Uniform);
        for (a, b) in [(0.0, 4.0), (1e9, 1e9 + 1e-6)] {
            let segment = MarchSegment { ray: &ray, from: a, a, b, medium: &medium, depth: None, weight: Rgb::ONE };
            let expected = -(-0.7 * (b - a)).exp_m1() / 0.7;
            for stepping in STEPPINGS {
                let mut places = 0;
                let marcher = Marcher { stepping, size: 1e-300 };
                let mut stream = Stream::new(6, Purpose::Test, 0, 0);
                let [found] = marcher.march(&segment, &mut stream, &mut Steps::default(), &mut |_, _| {
                    places += 1;
                    [Rgb::ONE]
                });
                assert!((found / expected - 1.0).abs().max_element() < 1e-2, "{stepping:?} {a}: {found}");
                assert!(places < 1_000_000, "{stepping:?} {a}: {places} places");
            }
        }
    }

    /// Where the ends of a step are bright and what lies between is dark, as between the beams of two lamps, nothing is negative.
    #[test]
    fn no_light_is_less_than_none() {
        let ray = Ray::new(DVec3::ZERO, DVec3::Z);
        let lamps = |t: f64| Rgb::new((-t).exp(), if t < 0.2 { 1e3 } else { 0.0 }, if t > 2.9 { 1.0 } else { 0.0 });
        for extinction in [[1e-3, 2e-3, 3e-3], [2.0, 0.5, 3.0]] {
            let medium = medium(extinction, Density::Uniform);
            let weight = Rgb::new(1.0, 0.5, 2.0);
            let segment = MarchSegment { ray: &ray, from: 0.0, a: 0.0, b: 3.0, medium: &medium, depth: None, weight };
            let marcher = Marcher { stepping: Stepping::Adaptive { contrast: 0.3 }, size: 255.0 };
            let (mut sum, mut squares, marches) = (Rgb::ZERO, Rgb::ZERO, 100_000);
            for i in 0..marches {
                let mut stream = Stream::new(5, Purpose::Test, i, 0);
                let [one] = marcher.march(&segment, &mut stream, &mut Steps::default(), &mut |t, _| [lamps(t)]);
                assert!(one.min_element() >= 0.0 && one.is_finite(), "{one}");
                sum += one;
                squares += one * one;
            }
            let n = marches as f64;
            let (mean, expected) = (sum / n, integral(&segment, lamps));
            let error = ((squares / n - mean * mean) / n).map(f64::sqrt);
            assert!(
                (mean - expected).abs().cmple(4.0 * error).all(),
                "{extinction:?}: {mean} ± {error}, not {expected}"
            );
        }
        for (s, tau) in
            [([1.0, 0.0], 0.0), ([0.0, 1.0], 1e-12), ([0.0, 2.0], 50.0), ([3.0, 1.0], 1e4), ([0.2, 1.0], 2.0)]
        {
            for u in [0.0, 1e-9, 0.3, 0.999, 1.0] {
                let x = linear_times_exponential(s, tau, u);
                let below =
                    |x: f64| x * (s[0] * mean_transmittance(tau * x) + (s[1] - s[0]) * x * first_moment(tau * x));
                assert!((0.0..=1.0).contains(&x) && (below(x) / below(1.0) - u).abs() < 1e-9, "{s:?} {tau} {u}: {x}");
            }
        }
    }

    /// Where light does not arrive from, no one looks often.
    #[test]
    fn effort_follows_transmittance_and_contrast() {
        let ray = Ray::new(DVec3::ZERO, DVec3::Z);
        let places = |sigma: f64, stepping, source: &dyn Fn(f64) -> Rgb| {
            let medium = medium([sigma; 3], Density::Uniform);
            let segment =
                MarchSegment { ray: &ray, from: 0.0, a: 0.0, b: 100.0, medium: &medium, depth: None, weight: Rgb::ONE };
            run(&Marcher { stepping, size: 0.1 }, &segment, source, Rgb::ONE).2
        };
        let one = |_: f64| Rgb::ONE;
        // ∫T dt = 1, a tenth of it each.
        let exponential = places(1.0, Stepping::Exponential, &one);
        assert!((10.0..=11.0).contains(&exponential), "{exponential}");
        // 30 steps to 1/20, and one mean free path from there on.
        let uniform = places(1.0, Stepping::Uniform, &one);
        assert!((35.0..45.0).contains(&uniform), "{uniform}");
        // Steps of a mean free path or a little more, down to 1/20 and then one or two.
        let random = places(1.0, Stepping::Random, &one);
        assert!((3.0..6.0).contains(&random), "{random}");
        // Coarse steps where nothing changes, two places each; fine ones around the flash.
        let even = places(0.0, Stepping::Adaptive { contrast: 0.1 }, &one);
        assert!((495.0..510.0).contains(&even), "{even}");
        let flash = places(0.0, Stepping::Adaptive { contrast: 0.1 }, &|t| Rgb::splat((-(t - 50.0).powi(2)).exp()));
        assert!((even + 50.0..even + 200.0).contains(&flash), "{flash} {even}");
    }
}
