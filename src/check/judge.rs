//! Estimators against each other: unbiased ones by Welch's t-test over blocks of the picture with the histogram of its p-values
//! (Jung, Hanika and Dachsbacher 2020, "Detecting bias in Monte Carlo renderers using Welch's t-test"), biased ones by equivalence.

use super::blocks::Blocks;
use super::report::{Outcome, PMap, Row};
use super::statistics::{Mean, Welch, excess_of_small, histogram, holm, student_quantile};

/// No more than this share of all rows is failed by chance, over all blocks and channels of a row together.
pub const ALPHA: f64 = 1e-3;
/// Where differences of this share of the light, or less, would not have shown, nothing is told.
const BLIND: f64 = 0.5;
/// Of an equivalence, a difference of this share of a block's light, and of that of the whole picture, is none.
const SLACK: [f64; 2] = [0.02, 0.005];
/// The least number of standard errors that a difference may have by chance.
const ERRORS: f64 = 3.0;
/// Variances of few seeds, or of rare bright samples which a block may not have met, are moderated by what they are on average, as a
/// share of a block's light, with as much weight as so many degrees of freedom (Smyth 2004, "Linear models and empirical Bayes methods").
const MODERATION: f64 = 10.0;
/// Blocks darker than this share of the picture tell nothing of relative errors, nor of the distribution of p-values.
const DARK: f64 = 0.05;
/// Differences of less than this share of the picture's light are not tested: in darkness, means are of a few samples.
const NOTHING: f64 = 0.002;

const RARE: &str = "its light there comes in rare, bright samples, which blocks may lack";

/// An estimator's pictures.
pub struct Side<'b> {
    /// What it is called.
    pub name: &'b str,
    /// Its pictures.
    pub blocks: &'b Blocks,
    /// Why it may lack some light, if it may.
    pub misses: Option<&'b str>,
    /// Whether fireflies hold so much of its light that what blocks lack of them is not told by how far pictures are apart.
    pub is_rare: bool,
    /// Whether the scene itself is rendered so: then what is lacking is missed.
    pub is_own: bool,
}

impl<'b> Side<'b> {
    /// That misses nothing.
    pub fn whole(name: &'b str, blocks: &'b Blocks) -> Self {
        Side { name, blocks, misses: None, is_rare: false, is_own: false }
    }

    /// Why it may be too dark, if it may.
    fn lack(&self) -> Option<&'b str> {
        self.misses.or(self.is_rare.then_some(RARE))
    }

    /// Why a lack of light is not held against it.
    fn excuse(&self) -> Option<&'b str> {
        self.misses.filter(|_| !self.is_own).or(self.is_rare.then_some(RARE))
    }
}

/// A block and channel in which two sides differ.
struct Apart<'d> {
    block: usize,
    share: f64,
    p: f64,
    /// The side that has less.
    lacking: &'d Side<'d>,
}

/// Compares two unbiased estimators. `moderate`: where noise is much the same in blocks that are alike, no block is surer than it may be.
pub fn unbiased(test: &str, a: &Side<'_>, b: &Side<'_>, moderate: bool) -> Row {
    let level = 0.5 * (a.blocks.level() + b.blocks.level());
    if level <= 0.0 {
        return Row::not_applicable(test, format!("neither {} nor {} finds any light", a.name, b.name));
    }
    let duel = Duel::new(a, b, level, moderate);
    let (outcome, found) = duel.verdict();
    Row { map: Some(duel.map()), ..Row::new(test, outcome, found).with(duel.least()) }
}

/// Two unbiased estimators, compared.
struct Duel<'d> {
    a: &'d Side<'d>,
    b: &'d Side<'d>,
    /// The mean over pixels and channels.
    level: f64,
    /// Of each block and channel: the block, the test, and the mean of both.
    tests: Vec<(usize, Welch, f64)>,
    /// By block, the p-value of all channels together, and whether the block is not dark.
    greys: Vec<(f64, bool)>,
}

impl<'d> Duel<'d> {
    fn new(a: &'d Side<'d>, b: &'d Side<'d>, level: f64, moderate: bool) -> Self {
        let count = a.blocks.count();
        let light = |place: (usize, usize)| {
            let [a, b] = [a, b].map(|side| side.blocks.mean(place.0, place.1).value);
            (0.5 * (a + b)).max(DARK * level)
        };
        let [of_a, of_b] = [a, b].map(|side| {
            let means: Vec<Mean> = places(count).map(|(block, channel)| side.blocks.mean(block, channel)).collect();
            let lights: Vec<f64> = places(count).map(light).collect();
            if moderate { moderated(&means, &lights) } else { means }
        });
        let test = |((block, _), (a, b)): ((usize, usize), (&Mean, &Mean))| {
            let mut welch = Welch::test(a, b);
            if welch.difference.abs() < NOTHING * level {
                welch.p = 1.0;
            }
            (block, welch, 0.5 * (a.value + b.value))
        };
        let grey = |block| {
            let (a, b) = (a.blocks.grey(block), b.blocks.grey(block));
            (Welch::test(&a, &b).p, 0.5 * (a.value + b.value) > 3.0 * DARK * level)
        };
        let tests = places(count).zip(of_a.iter().zip(&of_b)).map(test).collect();
        Duel { a, b, level, tests, greys: (0..count - 1).map(grey).collect() }
    }

    fn all(&self) -> Vec<f64> {
        self.tests.iter().map(|(_, welch, _)| welch.p).collect()
    }

    fn least(&self) -> f64 {
        self.all().into_iter().fold(1.0, f64::min)
    }

    /// The p-value that a test must have to fail by itself.
    fn limit(&self) -> f64 {
        ALPHA / self.tests.len() as f64
    }

    /// The p-values of blocks that are not dark.
    fn lit(&self) -> Vec<f64> {
        self.greys.iter().filter(|(_, lit)| *lit).map(|(p, _)| *p).collect()
    }

    fn map(&self) -> PMap {
        let Blocks { block, columns, .. } = *self.a.blocks;
        let p = self.greys.iter().map(|(p, _)| *p).collect();
        PMap { block, columns, p, histogram: histogram(&self.lit()) }
    }

    /// Of the tests that fail, those that are held against an estimator, or those that are not, the least p-value first.
    fn apart(&self, excused: bool) -> Vec<Apart<'d>> {
        let failed = self.tests.iter().filter(|(_, welch, _)| welch.p <= self.limit());
        let mut apart: Vec<Apart<'d>> = failed
            .map(|(block, welch, mean)| {
                let lacking = if welch.difference > 0.0 { self.b } else { self.a };
                Apart { block: *block, share: welch.difference / mean, p: welch.p, lacking }
            })
            .filter(|apart| apart.lacking.excuse().is_some() == excused)
            .collect();
        apart.sort_by(|a, b| a.p.total_cmp(&b.p));
        apart
    }

    fn verdict(&self) -> (Outcome, String) {
        let (a, b, count) = (self.a, self.b, self.tests.len());
        let tell = |worst: &Apart<'_>| {
            let why = worst.lacking.lack().map_or(String::new(), |why| format!(", as {why}"));
            format!("{} is {} than {} in {}{why}", a.name, apart(worst.share), b.name, a.blocks.place(worst.block))
        };
        if let Some(worst) = self.apart(false).first() {
            let failed = holm(&self.all(), ALPHA);
            let told = tell(worst);
            return (
                Outcome::Fail,
                format!("{told}: p = {:.1e}; so it is in {failed} of {count} blocks and channels (Holm)", worst.p),
            );
        }
        let (excess, complete) = (excess_of_small(&self.lit()), a.lack().is_none() && b.lack().is_none());
        if complete && excess < 0.1 * ALPHA {
            let bins = histogram(&self.lit());
            return (
                Outcome::Fail,
                format!(
                    "too many small p-values over the blocks, though none alone is: chance {excess:.1e}; histogram {bins:?}"
                ),
            );
        }
        let excused = self.apart(true);
        if let Some(worst) = excused.first() {
            let outcome = if 2 * excused.len() > count { Outcome::NotApplicable } else { Outcome::Pass };
            let told = tell(worst);
            return (
                outcome,
                format!("{told}: not compared in {} of {count} blocks and channels; else alike", excused.len()),
            );
        }
        let sees = percent(self.resolution());
        if self.resolution() > BLIND {
            return (Outcome::NotApplicable, format!("too noisy: differences below {sees} would not have shown"));
        }
        let least = self.least();
        (Outcome::Pass, format!("alike: least p {least:.2e} of {count}; differences above {sees} would have shown"))
    }

    /// What share of a block's light would have shown, in half of the blocks that are not dark.
    fn resolution(&self) -> f64 {
        let quantile = student_quantile(self.limit(), 2.0 * (self.a.blocks.seeds() as f64 - 1.0).max(1.0));
        let lit = self.tests.iter().filter(|(_, _, mean)| *mean > DARK * self.level);
        median(lit.map(|(_, welch, mean)| quantile * welch.error / mean).collect())
    }
}

/// Pictures of a biased estimator: with the radii that it has, and with half of them, from the same photons.
pub struct Blurred<'b> {
    /// What it is called.
    pub name: &'b str,
    /// With the radii that it has.
    pub wide: &'b Blocks,
    /// With half of them.
    pub narrow: &'b Blocks,
    /// Why it may lack some light, if it may.
    pub misses: Option<&'b str>,
}

impl Blurred<'_> {
    /// The bias that its radii declare, over the blocks of the picture, as a share of its light: the root of the mean square, noise taken off.
    pub fn blur(&self) -> f64 {
        let change = self.wide.less(self.narrow);
        let last = self.wide.count() - 1;
        let square = |block| {
            let Mean { value, variance, .. } = change.grey(block);
            4.0 * (value * value - variance)
        };
        let mean = (0..last).map(square).sum::<f64>() / last.max(1) as f64;
        mean.max(0.0).sqrt() / (3.0 * self.wide.level())
    }
}

/// Compares a biased estimator with an unbiased one: their difference is to lie within the declared bias and what noise explains.
pub fn biased(test: &str, photons: &Blurred<'_>, judge: &Side<'_>) -> Row {
    let level = judge.blocks.level().max(photons.wide.level());
    if level <= 0.0 {
        return Row::not_applicable(test, format!("neither {} nor {} finds any light", photons.name, judge.name));
    }
    let differences = differences(photons, judge, level);
    let count = differences.len();
    let lit = differences.iter().filter(|found| found.light > DARK * level);
    let sees = median(lit.map(|found| found.noise / found.light).collect());
    let lacks = |found: &&Difference| if found.value > 0.0 { judge.lack() } else { photons.misses };
    let (excused, faults): (Vec<&Difference>, Vec<&Difference>) =
        differences.iter().filter(|found| found.times() > 1.0).partition(|found| lacks(found).is_some());
    let worst = |of: &[&Difference]| of.iter().copied().max_by(|a, b| a.times().total_cmp(&b.times())).copied();
    let within = differences.iter().map(Difference::times).filter(|times| *times <= 1.0).fold(0.0, f64::max);

    if let Some(worst) = worst(&faults) {
        let share = |x: f64| percent(x / worst.light);
        let found = format!(
            "{} is {} than {} in {}; allowed are {} (bias {}, noise {}); so it is in {} of {count} blocks and channels",
            photons.name,
            apart(worst.value / worst.light),
            judge.name,
            judge.blocks.place(worst.block),
            share(worst.allowed),
            share(worst.bias),
            share(worst.noise),
            faults.len()
        );
        return Row::new(test, Outcome::Fail, found).with(worst.times());
    }
    if sees > BLIND {
        let (judge, photons, sees) = (judge.name, photons.name, percent(sees));
        let why =
            format!("{judge} is too noisy to judge: its error and that of {photons} are {sees} of a block's light");
        return Row::not_applicable(test, why).with(within);
    }
    if let Some(why) = worst(&excused).and_then(|worst| lacks(&&worst)) {
        let outcome = if 2 * excused.len() > count { Outcome::NotApplicable } else { Outcome::Pass };
        let found = format!(
            "not compared in {} of {count} blocks and channels, as {why}; else within bias and noise",
            excused.len()
        );
        return Row::new(test, outcome, found).with(within);
    }
    let sees = percent(sees);
    let found =
        format!("within bias and noise: at most {within:.2} of what is allowed; noise {sees} of a block's light");
    Row::new(test, Outcome::Pass, found).with(within)
}

/// What photons and judge differ by in a channel of a block.
#[derive(Clone, Copy)]
struct Difference {
    block: usize,
    value: f64,
    /// The light there, by the judge.
    light: f64,
    /// What is declared, what noise explains, and what is allowed.
    bias: f64,
    noise: f64,
    allowed: f64,
}

impl Difference {
    /// How many times what is allowed it is.
    fn times(&self) -> f64 {
        self.value.abs() / self.allowed.max(f64::MIN_POSITIVE)
    }
}

/// Of all blocks and channels.
fn differences(photons: &Blurred<'_>, judge: &Side<'_>, level: f64) -> Vec<Difference> {
    let count = judge.blocks.count();
    let change = photons.wide.less(photons.narrow);
    let freedom = (judge.blocks.seeds().min(photons.wide.seeds()) as f64 - 1.0).max(1.0);
    let errors = student_quantile(ALPHA / (3 * count) as f64, freedom + MODERATION).max(ERRORS);
    let variance = |(block, channel)| {
        let (own, other) = (photons.wide.mean(block, channel), judge.blocks.mean(block, channel));
        own.variance + other.variance + 4.0 * change.mean(block, channel).variance
    };
    let light = |(block, channel)| judge.blocks.mean(block, channel).value.abs().max(DARK * level);
    let usual = places(count).map(variance).sum::<f64>() / places(count).map(|place| light(place).powi(2)).sum::<f64>();
    let difference = |place @ (block, channel)| {
        let (own, other) = (photons.wide.mean(block, channel).value, judge.blocks.mean(block, channel).value);
        // Bias that grows with the radius, as at walls, is twice what half of it changes; one that grows with its square less.
        let bias = 2.0 * change.mean(block, channel).value.abs();
        let moderated = MODERATION * usual * light(place).powi(2) + freedom * variance(place);
        let noise = errors * (moderated / (freedom + MODERATION)).sqrt();
        let allowed = bias + noise + SLACK[0] * other.abs() + SLACK[1] * level;
        Difference { block, value: own - other, light: light(place), bias, noise, allowed }
    };
    places(count).map(difference).collect()
}

/// Means of all places, of which the last block is the whole picture, with variances no smaller than moderated by those of other places
/// that are half to twice as bright: a block that has not met what is rare does not know how much it varies.
fn moderated(means: &[Mean], lights: &[f64]) -> Vec<Mean> {
    let blocks = means.len() - 3;
    let relative = |place: usize| means[place].variance / lights[place].powi(2);
    let moderate = |(place, mean): (usize, &Mean)| {
        if place >= blocks {
            return *mean;
        }
        let alike = (0..blocks).filter(|other| (0.5..=2.0).contains(&(lights[*other] / lights[place])));
        let (sum, count) = alike.fold((0.0, 0.0), |(sum, count), other| (sum + relative(other), count + 1.0));
        let (usual, freedom) = (sum / count * lights[place].powi(2), mean.count - 1.0);
        let variance = (MODERATION * usual + freedom * mean.variance) / (MODERATION + freedom);
        Mean { variance: variance.max(mean.variance), ..*mean }
    };
    means.iter().enumerate().map(moderate).collect()
}

/// All channels of so many blocks.
fn places(count: usize) -> impl Iterator<Item = (usize, usize)> {
    (0..count).flat_map(|block| (0..3).map(move |channel| (block, channel)))
}

/// The middle one of these; infinite if there are none.
fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(f64::INFINITY)
}

/// A difference in words.
fn apart(share: f64) -> String {
    format!("{} {}", percent(share.abs()), if share > 0.0 { "brighter" } else { "darker" })
}

/// A share in per cent, to two digits.
pub fn percent(share: f64) -> String {
    let percent = 100.0 * share;
    match percent.abs() {
        10.0.. => format!("{percent:.0} %"),
        1.0.. => format!("{percent:.1} %"),
        _ => format!("{percent:.2} %"),
    }
}
