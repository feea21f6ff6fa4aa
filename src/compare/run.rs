//! The runs of a comparison, made or read.

use std::sync::atomic::Ordering;
use std::time::Instant;

use serde::Serialize;

use super::comparison::{Comparison, Found};
use super::lab::Lab;
use super::measuring::{Measuring, statistics};
use super::results::{Budgets, Reference};
use super::store::{Run, Store};
use super::variant::Tunable;
use super::{machine, reference};
use crate::render::checkpoint::Subject;
use crate::scene;
use crate::{Error, Result};

impl Comparison<'_> {
    /// All runs: seed by seed, so that a machine that slows down slows all variants alike; those whose time others get
    /// come first.
    pub fn measure(&self, found: &mut [Found]) -> Result<()> {
        let (first, later): (Vec<usize>, Vec<usize>) =
            (0..found.len()).partition(|&index| found[index].variant.asked.time.is_none());
        for seed in self.seeds() {
            for &index in first.iter().chain(&later) {
                let given = found[index].variant.asked.time.clone();
                let times = given.map(|name| {
                    let other = found.iter().find(|other| other.variant.asked.name == name);
                    let shots = other.and_then(|other| other.runs.first()).map(|run| run.shots.as_slice());
                    shots.unwrap_or_default().iter().map(|shot| shot.as_ref().map(|shot| shot.seconds)).collect()
                });
                if self.common.is_none() && found[index].limit.is_none() {
                    let limit = reference::limit(&found[index].variant, self.context, self.store, &self.regions)?;
                    found[index].limit = Some(limit);
                }
                let run = self.run(&found[index], seed, times)?;
                let whole = run.whole;
                if whole || run.shots.iter().any(Option::is_some) {
                    found[index].runs.push(run);
                }
                if !whole {
                    return Err(Error::Interrupted);
                }
            }
        }
        Ok(())
    }

    /// A run of a variant with a seed, made or read. `times` are those it gets, by budget, if they are another's.
    fn run(&self, found: &Found, seed: u64, times: Option<Vec<Option<f64>>>) -> Result<Run> {
        let (context, variant) = (self.context, &found.variant);
        let name = &variant.asked.name;
        let mut description = variant.description.clone();
        description.render.seed = seed;
        let digest = context.digest(&Asked {
            settings: Subject::new(&description, 1).fingerprint(),
            seed,
            budgets: &self.budgets,
            time: context.request.time,
            times: &times,
            tune: variant.tune.map(Tunable::key),
            samples: &variant.asked.samples,
            map: context.map(),
            // The best of several numbers of samples is so against its reference.
            reference: self.standard(found).facts().filter(|_| variant.tune.is_some()),
        })?;
        if let Some(run) = self.store.run(name, seed, &digest).filter(|run| run.whole) {
            return Ok(run);
        }
        context.watch.begins(&format!("{name}, seed {seed}"));
        let start = Instant::now();
        let fresh = context.describe(name, &variant.set)?;
        let (scene, mut settings) = scene::build(&fresh)?;
        settings.render.seed = seed;
        let loading_seconds = start.elapsed().as_secs_f64();
        let peak = machine::forget_peak();
        let warnings = scene.warnings.clone();
        let mut lab =
            Lab::new((scene, settings), context.shared(), context.request.components()?, context.watch, context.stop)?;
        let mut measuring = Measuring { comparison: self, found, seed, warnings, stats: None, shots: Vec::new() };
        let ended = match variant.tune {
            None => measuring.refine(&mut lab, times),
            Some(tunable) => measuring.tuned(&mut lab, tunable, times),
        };
        let whole = match ended {
            Ok(()) => !context.stop.load(Ordering::Relaxed),
            Err(Error::Interrupted) => false,
            Err(error) => return Err(error),
        };
        let Measuring { warnings, stats, mut shots, .. } = measuring;
        shots.resize(self.budgets.values.len(), None);
        let statistics = statistics(&lab, stats, peak.then(machine::peak_bytes).flatten());
        let run = Run { digest, whole, loading_seconds, statistics, warnings, shots };
        if whole || run.shots.iter().any(Option::is_some) {
            self.store.write(&Store::run_name(name, seed, ".json"), &run)?;
        }
        Ok(run)
    }
}

/// What a run depends on.
#[derive(Serialize)]
struct Asked<'a> {
    settings: String,
    seed: u64,
    budgets: &'a Budgets,
    /// Seconds it may take.
    time: Option<f64>,
    /// The times it gets, by budget, if they are another's.
    times: &'a Option<Vec<Option<f64>>>,
    tune: Option<&'static str>,
    samples: &'a [u32],
    map: Option<(String, u64)>,
    reference: Option<&'a Reference>,
}
