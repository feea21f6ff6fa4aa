//! Estimators against each other: unbiased ones by Welch's t-test over blocks of the picture with the histogram of its p-values
//! (Jung, Hanika and Dachsbacher 2020, "Detecting bias in Monte Carlo renderers using Welch's t-test"), biased ones by equivalence.

use super::blocks::{BLOCK, Blocks};
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
/// Of an equivalence, variances of few seeds are moderated by what they are on average, as a share of a block's light, with as much
/// weight as so many degrees of freedom (Smyth 2004, "Linear models and empirical Bayes methods").
const MODERATION: f64 = 10.0;
/// Blocks darker than this share of the picture tell nothing of relative errors, nor of the distribution of p-values.
const DARK: f64 = 0.05;
/// Differences of less than this share of the picture's light are not tested: in darkness, means are of a few samples.
const NOTHING: f64 = 0.002;

/// An estimator's pictures.
pub struct Side<'b> {
    /// What it is called.
    pub name: &'b str,
    /// Its pictures.
    pub blocks: &'b Blocks,
    /// Why it may lack some light, if it may.
    pub misses: Option<&'b str>,
    /// Whether the scene itself is rendered so: then what is lacking is missed.
    pub is_own: bool,
}

impl<'b> Side<'b> {
    /// Why a lack of light is not held against it.
    fn excuse(&self) -> Option<&'b str> {
        self.misses.filter(|_| !self.is_own)
    }
}

/// A block and channel in which two sides differ.
struct Apart {
    block: usize,
    share: f64,
    p: f64,
}

/// Compares two unbiased estimators.
pub fn unbiased(test: &str, a: &Side<'_>, b: &Side<'_>) -> Row {
    let (count, level) = (a.blocks.count(), 0.5 * (a.blocks.level() + b.blocks.level()));
    if level <= 0.0 {
        return Row::not_applicable(test, format!("neither {} nor {} finds any light", a.name, b.name));
    }

    // Every block and channel.
    let places = || (0..count).flat_map(|block| (0..3).map(move |channel| (block, channel)));
    let tests: Vec<(usize, Welch, f64)> = places()
        .map(|(block, channel)| {
            let (a, b) = (a.blocks.mean(block, channel), b.blocks.mean(block, channel));
            let mut welch = Welch::test(&a, &b);
            if welch.difference.abs() < NOTHING * level {
                welch.p = 1.0;
            }
            (block, welch, 0.5 * (a.value + b.value))
        })
        .collect();
    let all: Vec<f64> = tests.iter().map(|(_, welch, _)| welch.p).collect();
    let limit = ALPHA / all.len() as f64;
    let (mut faults, mut excused): (Vec<Apart>, Vec<Apart>) = (Vec::new(), Vec::new());
    for (block, welch, mean) in tests.iter().filter(|(_, welch, _)| welch.p <= limit) {
        let lacks = if welch.difference > 0.0 { b.excuse() } else { a.excuse() };
        let apart = Apart { block: *block, share: welch.difference / mean, p: welch.p };
        if lacks.is_some() { excused.push(apart) } else { faults.push(apart) }
    }

    // Their distribution.
    let greys: Vec<(f64, bool)> = (0..count - 1)
        .map(|block| {
            let (a, b) = (a.blocks.grey(block), b.blocks.grey(block));
            (Welch::test(&a, &b).p, 0.5 * (a.value + b.value) > 3.0 * DARK * level)
        })
        .collect();
    let lit: Vec<f64> = greys.iter().filter(|(_, lit)| *lit).map(|(p, _)| *p).collect();
    let excess = excess_of_small(&lit);
    let complete = a.misses.is_none() && b.misses.is_none();
    let map = PMap {
        block: BLOCK,
        columns: a.blocks.columns,
        histogram: histogram(&lit),
        p: greys.iter().map(|(p, _)| *p).collect(),
    };
    let least = all.iter().copied().fold(1.0, f64::min);
    let row = |outcome, found: String| Row { map: Some(map.clone()), ..Row::new(test, outcome, found).with(least) };

    // What would have shown.
    let sees = resolution(tests.iter().map(|(_, welch, mean)| (welch.error, *mean)), level, limit, a.blocks.seeds());
    if let Some(worst) = faults.iter().min_by(|a, b| a.p.total_cmp(&b.p)) {
        let why = if worst.share > 0.0 { b.misses } else { a.misses };
        return row(
            Outcome::Fail,
            format!(
                "{} is {} than {} in {}{}: p = {:.1e}; so it is in {} of {} blocks and channels (Holm)",
                a.name,
                apart(worst.share),
                b.name,
                a.blocks.place(worst.block),
                why.map_or(String::new(), |why| format!(", as {why}")),
                worst.p,
                holm(&all, ALPHA),
                all.len()
            ),
        );
    }
    if complete && excess < 0.1 * ALPHA {
        return row(
            Outcome::Fail,
            format!(
                "too many small p-values over the blocks, though none alone is: chance {excess:.1e}; histogram {:?}",
                map.histogram
            ),
        );
    }
    if let Some(first) = excused.iter().min_by(|a, b| a.p.total_cmp(&b.p)) {
        let why = if first.share > 0.0 { b.excuse() } else { a.excuse() }.unwrap_or_default();
        let outcome = if 2 * excused.len() > all.len() { Outcome::NotApplicable } else { Outcome::Pass };
        return row(
            outcome,
            format!(
                "{} is {} than {} in {}, as {why}: not compared in {} of {} blocks and channels; else alike",
                a.name,
                apart(first.share),
                b.name,
                a.blocks.place(first.block),
                excused.len(),
                all.len()
            ),
        );
    }
    if sees > BLIND {
        return row(
            Outcome::NotApplicable,
            format!("too noisy: differences below {} would not have shown", percent(sees)),
        );
    }
    row(
        Outcome::Pass,
        format!("alike: least p {least:.2e} of {}; differences above {} would have shown", all.len(), percent(sees)),
    )
}

/// What share of a block's light would have shown, in half of the blocks that are not dark.
fn resolution(errors: impl Iterator<Item = (f64, f64)>, level: f64, limit: f64, seeds: usize) -> f64 {
    let quantile = student_quantile(limit, 2.0 * (seeds as f64 - 1.0).max(1.0));
    let lit = errors.filter(|(_, mean)| *mean > DARK * level);
    let mut shares: Vec<f64> = lit.map(|(error, mean)| quantile * error / mean).collect();
    shares.sort_by(f64::total_cmp);
    shares.get(shares.len() / 2).copied().unwrap_or(f64::INFINITY)
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
    /// The bias that its radii declare for a block's channel, and the standard error of that: what radii of half the width
    /// change, twice. Bias that grows with the radius, as at walls, is that; one that grows with its square less.
    fn declared(&self, change: &Blocks, block: usize, channel: usize) -> (f64, f64) {
        let change = change.mean(block, channel);
        (2.0 * change.value.abs(), 2.0 * change.error())
    }

    /// The declared bias over the blocks of the picture as a share of its light: the root of the mean square, noise taken off.
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

    /// The noise of one picture's blocks as a share of its light: the root of the mean square.
    pub fn noise(&self) -> f64 {
        let last = self.wide.count() - 1;
        let square = |block| {
            let Mean { variance, count, .. } = self.wide.grey(block);
            variance * count
        };
        let mean = (0..last).map(square).sum::<f64>() / last.max(1) as f64;
        mean.sqrt() / (3.0 * self.wide.level())
    }
}

/// Compares a biased estimator with an unbiased one: their difference is to lie within the declared bias and what noise explains.
pub fn biased(test: &str, photons: &Blurred<'_>, judge: &Side<'_>) -> Row {
    let (count, level) = (judge.blocks.count(), judge.blocks.level());
    if level <= 0.0 && photons.wide.level() <= 0.0 {
        return Row::not_applicable(test, format!("neither {} nor {} finds any light", photons.name, judge.name));
    }
    let change = photons.wide.less(photons.narrow);
    let tests = 3 * count;
    let freedom = (judge.blocks.seeds().min(photons.wide.seeds()) as f64 - 1.0).max(1.0);
    let errors = student_quantile(ALPHA / tests as f64, freedom + MODERATION).max(ERRORS);
    let variance = |block, channel| {
        let (own, other) = (photons.wide.mean(block, channel), judge.blocks.mean(block, channel));
        own.variance + other.variance + photons.declared(&change, block, channel).1.powi(2)
    };
    let light = |block, channel| judge.blocks.mean(block, channel).value.abs().max(DARK * level);
    let places = || (0..count).flat_map(|block| (0..3).map(move |channel| (block, channel)));
    let usual =
        places().map(|(b, c)| variance(b, c)).sum::<f64>() / places().map(|(b, c)| light(b, c).powi(2)).sum::<f64>();
    // The worst of each kind, by how many times what is allowed it is.
    let (mut worst, mut fault, mut excused): (f64, Option<String>, Option<(f64, &str)>) = (0.0, None, None);
    let (mut faults, mut blocks_excused) = (0, 0);
    let mut widths = Vec::new();
    for (block, channel) in places() {
        let (own, other) = (photons.wide.mean(block, channel), judge.blocks.mean(block, channel));
        let (bias, _) = photons.declared(&change, block, channel);
        let moderated = MODERATION * usual * light(block, channel).powi(2) + freedom * variance(block, channel);
        let noise = errors * (moderated / (freedom + MODERATION)).sqrt();
        let slack = SLACK[0] * other.value.abs() + SLACK[1] * level;
        let (difference, allowed) = (own.value - other.value, bias + slack + noise);
        if other.value > DARK * level {
            widths.push(noise / other.value);
        }
        let times = difference.abs() / allowed.max(f64::MIN_POSITIVE);
        if times <= 1.0 {
            worst = worst.max(times);
            continue;
        }
        let lacks = if difference > 0.0 { judge.misses } else { photons.misses };
        match lacks {
            Some(why) => {
                blocks_excused += 1;
                if excused.is_none_or(|(most, _)| times > most) {
                    excused = Some((times, why));
                }
            }
            None => {
                faults += 1;
                if times > worst.max(1.0) || fault.is_none() {
                    worst = times;
                    let share = |x: f64| percent(x / light(block, channel));
                    fault = Some(format!(
                        "{} is {} than {} in {}; allowed are {} (bias {}, noise {})",
                        photons.name,
                        apart(difference / light(block, channel)),
                        judge.name,
                        judge.blocks.place(block),
                        share(allowed),
                        share(bias),
                        share(noise)
                    ));
                }
            }
        }
    }
    widths.sort_by(f64::total_cmp);
    let sees = widths.get(widths.len() / 2).copied().unwrap_or(f64::INFINITY);
    if let Some(fault) = fault {
        let found = format!("{fault}; so it is in {faults} of {tests} blocks and channels");
        return Row::new(test, Outcome::Fail, found).with(worst);
    }
    if sees > BLIND {
        let why = format!(
            "{} is too noisy to judge: its error and that of {} are {} of a block's light",
            judge.name,
            photons.name,
            percent(sees)
        );
        return Row::not_applicable(test, why).with(worst);
    }
    if let Some((_, why)) = excused {
        let outcome = if 2 * blocks_excused > tests { Outcome::NotApplicable } else { Outcome::Pass };
        let found = format!(
            "not compared in {blocks_excused} of {tests} blocks and channels, as {why}; else within bias and noise"
        );
        return Row::new(test, outcome, found).with(worst);
    }
    let found = format!(
        "within bias and noise: at most {worst:.2} of what is allowed; noise {} of a block's light",
        percent(sees)
    );
    Row::new(test, Outcome::Pass, found).with(worst)
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
