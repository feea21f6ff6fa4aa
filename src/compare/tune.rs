//! Settings with which a variant takes a given time.

use std::sync::Arc;

use super::lab::Lab;
use super::meter::Snapshot;
use super::results::{Setting, Trial, Tuned};
use super::variant::Tunable;
use crate::Result;
use crate::image::Image;

/// A time is met if it is missed by no more than this share.
const CLOSE: f64 = 0.04;
/// Renders of one number of samples that look for a setting, at most.
const SEARCHES: usize = 10;
/// Full renders of one number of samples, at most.
const CONFIRMATIONS: usize = 3;
/// A trial shorter than this says little.
const TELLING: f64 = 0.1;
/// A trial may take this many times the time that is looked for.
const PATIENCE: f64 = 4.0;

/// What a setting costs.
#[derive(Clone, Copy, Debug)]
struct Cost {
    /// Photons and maps.
    fixed: f64,
    sample: f64,
}

impl Cost {
    fn of(&self, samples: u32) -> f64 {
        self.fixed + f64::from(samples) * self.sample
    }
}

/// Costs found so far, by the logarithm of the value, cheap ones first.
struct Search<'l, 'a> {
    lab: &'l mut Lab<'a>,
    tunable: Tunable,
    start: f64,
    range: [f64; 2],
    known: Vec<(f64, Cost)>,
}

impl Search<'_, '_> {
    /// Whether larger values cost less.
    fn falls(&self) -> bool {
        matches!(self.tunable, Tunable::MarchSize | Tunable::Contrast)
    }

    /// The place of a value, such that costs grow with it.
    fn place(&self, value: f64) -> f64 {
        if self.falls() { -value.ln() } else { value.ln() }
    }

    fn value(&self, place: f64) -> f64 {
        if self.falls() { (-place).exp() } else { place.exp() }
    }

    /// The cheapest and the dearest place.
    fn ends(&self) -> (f64, f64) {
        let [a, b] = self.range.map(|value| self.place(value));
        (a.min(b), a.max(b))
    }

    /// Renders at a place, with up to `samples` samples.
    fn try_at(&mut self, place: f64, samples: u32, target: f64) -> Result<Cost> {
        self.lab.set(self.tunable, self.value(place))?;
        let mut count = 1;
        let cost = loop {
            // With fresh photons nobody knows beforehand what they take.
            let most = self.lab.photons.is_some().then_some(PATIENCE * target);
            let Some(shot) = self.lab.shoot(count, most)? else {
                break Cost { fixed: 0.0, sample: f64::INFINITY };
            };
            let fixed = match self.lab.photons {
                Some(_) => 0.0,
                None => shot.stats.photons_seconds + shot.stats.build_seconds,
            };
            let sample = (shot.seconds - fixed) / f64::from(count);
            let telling = ((TELLING / sample.max(1e-9)).ceil() as u32).clamp(1, samples);
            if telling <= count {
                break Cost { fixed, sample };
            }
            count = telling;
        };
        let at = self.known.partition_point(|(known, _)| *known < place);
        self.known.insert(at, (place, cost));
        Ok(cost)
    }

    /// A place where `samples` samples take `target` seconds, as far as costs of fewer samples tell; `None` if even
    /// the cheapest takes longer.
    fn find(&mut self, samples: u32, target: f64) -> Result<Option<f64>> {
        let (cheapest, dearest) = self.ends();
        if self.known.is_empty() {
            self.try_at(self.place(self.start), samples, target)?;
        }
        for _ in 0..SEARCHES {
            let below = self.known.iter().rev().find(|(_, cost)| cost.of(samples) <= target).copied();
            let above = self.known.iter().find(|(_, cost)| cost.of(samples) > target).copied();
            let next = match (below, above) {
                (Some((place, cost)), None) => {
                    if place >= dearest || close(cost.of(samples), target) {
                        return Ok(Some(place));
                    }
                    (place + step((target / cost.of(samples)).ln())).min(dearest)
                }
                (None, Some((place, cost))) => {
                    if place <= cheapest {
                        return Ok(None);
                    }
                    (place - step((cost.of(samples) / target).ln())).max(cheapest)
                }
                (Some(low), Some(high)) => {
                    if close(low.1.of(samples), target) || high.0 - low.0 < CLOSE / 2.0 {
                        return Ok(Some(low.0));
                    }
                    let (a, b) = ((low.1.of(samples) / target).ln(), (high.1.of(samples) / target).ln());
                    // Times grow like powers; an unknown one only says which way.
                    let share = if b.is_finite() { -a / (b - a) } else { 0.5 };
                    low.0 + (high.0 - low.0) * share.clamp(0.1, 0.9)
                }
                // Without a cost nothing was tried.
                (None, None) => return Ok(None),
            };
            self.try_at(next, samples, target)?;
        }
        Ok(self.known.iter().rev().find(|(_, cost)| cost.of(samples) <= target).map(|(place, _)| *place))
    }
}

fn close(time: f64, target: f64) -> bool {
    (1.0 - CLOSE..=1.0).contains(&(time / target))
}

/// How far to go where a time is wrong by this factor's logarithm.
fn step(logarithm: f64) -> f64 {
    if logarithm.is_finite() { logarithm.clamp(0.2, 3.0) } else { 1.5 }
}

/// Of all numbers of samples in `candidates`, each with the value of `tunable` that makes it take `target` seconds, the
/// one with the least RMSE. `None` if there is no image at all.
pub fn tune(
    lab: &mut Lab<'_>,
    tunable: Tunable,
    candidates: &[u32],
    target: f64,
    rmse: &dyn Fn(&Image) -> f64,
) -> Result<Option<(Arc<Snapshot>, Tuned)>> {
    let (start, range) = tunable.range(&lab.scene, &lab.settings)?;
    let mut search = Search { lab, tunable, start, range, known: Vec::new() };
    let mut best: Option<(f64, Arc<Snapshot>, String, bool)> = None;
    let mut trials = Vec::new();
    for (index, &samples) in candidates.iter().enumerate() {
        let Some((shot, value, over)) = confirmed(&mut search, samples, target, index == 0)? else { continue };
        let error = rmse(&shot.image);
        trials.push(Trial { samples: samples.into(), value: value.clone(), seconds: shot.seconds, rmse: error });
        if best.as_ref().is_none_or(|(least, ..)| error < *least) {
            best = Some((error, shot, value, over));
        }
    }
    Ok(best.map(|(_, shot, value, over)| {
        let setting = Setting { key: tunable.key().to_string(), value };
        (shot, Tuned { target_seconds: target, setting, over, trials })
    }))
}

/// An image of `samples` samples that took the target, its setting, and whether it took longer because it must. `None`
/// if it would take longer, unless it is the `last` resort.
fn confirmed(
    search: &mut Search<'_, '_>,
    samples: u32,
    target: f64,
    last: bool,
) -> Result<Option<(Arc<Snapshot>, String, bool)>> {
    let mut aim = target;
    let mut best: Option<(Arc<Snapshot>, String)> = None;
    for _ in 0..CONFIRMATIONS {
        let Some(place) = search.find(samples, aim)? else { break };
        let value = search.lab.set(search.tunable, search.value(place))?;
        let Some(shot) = search.lab.shoot(samples, None)? else { break };
        let miss = |shot: &Snapshot| {
            let ratio = shot.seconds / target;
            // Late is worse than early.
            if ratio > 1.0 { 2.0 * (ratio - 1.0) } else { 1.0 - ratio }
        };
        let ratio = shot.seconds / target;
        if best.as_ref().is_none_or(|(best, _)| miss(&shot) < miss(best)) {
            best = Some((shot, value));
        }
        if (1.0 - 2.0 * CLOSE..=1.0 + CLOSE).contains(&ratio) || place >= search.ends().1 {
            break;
        }
        aim /= ratio;
    }
    if let Some((shot, value)) = best {
        return Ok(Some((shot, value, false)));
    }
    if !last {
        return Ok(None);
    }
    let cheapest = search.ends().0;
    let value = search.lab.set(search.tunable, search.value(cheapest))?;
    Ok(search.lab.shoot(samples, None)?.map(|shot| (shot, value, true)))
}
