//! One run: images of a variant, measured as they get better.

use std::sync::Arc;

use super::comparison::{Comparison, Found};
use super::figures::figures;
use super::lab::Lab;
use super::results::{self, BudgetKind, Budgets, Statistics};
use super::store::{Shot, Store, label};
use super::variant::Tunable;
use super::{meter, tune};
use crate::image::Image;
use crate::{Error, Result};

/// A run on its way.
pub struct Measuring<'m> {
    pub comparison: &'m Comparison<'m>,
    pub found: &'m Found,
    pub seed: u64,
    pub warnings: Vec<String>,
    /// Of the last image.
    pub stats: Option<crate::render::Stats>,
    pub shots: Vec<Option<Shot>>,
}

impl Measuring<'_> {
    /// Refines, and measures on the way.
    pub fn refine(&mut self, lab: &mut Lab<'_>, times: Option<Vec<Option<f64>>>) -> Result<()> {
        let request = self.comparison.context.request;
        let asked = &self.comparison.budgets;
        let (places, budgets, most): (Vec<usize>, Budgets, Option<f64>) = match times {
            // Another's times ascend as its budgets do; two of them may be the same.
            Some(times) => {
                let times = times.into_iter().enumerate().filter_map(|(index, time)| Some((index, time?)));
                let (places, values) = times.unzip();
                (places, Budgets { kind: BudgetKind::Seconds, values }, None)
            }
            None => ((0..asked.values.len()).collect(), asked.clone(), request.time),
        };
        self.shots = vec![None; asked.values.len()];
        if places.is_empty() {
            return Ok(());
        }
        let outcome = lab.measure(&budgets, most)?;
        self.warnings.extend(outcome.warnings);
        for (index, taken) in places.into_iter().zip(outcome.taken) {
            self.shots[index] = taken.map(|snapshot| self.keep(index, &snapshot, None)).transpose()?;
        }
        Ok(())
    }

    /// Finds, for each budget, what takes its time, as the first seed has it.
    pub fn tuned(&mut self, lab: &mut Lab<'_>, tunable: Tunable, times: Option<Vec<Option<f64>>>) -> Result<()> {
        let comparison = self.comparison;
        let times = times.unwrap_or_else(|| comparison.budgets.values.iter().copied().map(Some).collect());
        for (index, time) in times.into_iter().enumerate() {
            let known = self.found.runs.first().map(|run| run.shots[index].as_ref());
            let taken = match (known, time) {
                (Some(known), _) => self.repeat(lab, tunable, known)?,
                (None, Some(time)) => self.find(lab, tunable, time)?,
                (None, None) => None,
            };
            let shot = taken.map(|(snapshot, tuned)| self.keep(index, &snapshot, Some(tuned))).transpose()?;
            self.shots.push(shot);
        }
        Ok(())
    }

    fn find(
        &self,
        lab: &mut Lab<'_>,
        tunable: Tunable,
        time: f64,
    ) -> Result<Option<(Arc<meter::Snapshot>, results::Tuned)>> {
        let samples = match self.found.variant.asked.samples.as_slice() {
            [] => vec![lab.settings.render.samples],
            several => several.to_vec(),
        };
        let held = self.comparison.standard(self.found);
        let (standard, whole) = (held.standard()?, &self.comparison.regions[0]);
        let rmse = |image: &Image| figures(std::slice::from_ref(image), standard, whole).rmse.value;
        tune::tune(lab, tunable, &samples, time, &rmse)
    }

    /// What the first seed had, with another.
    fn repeat(
        &self,
        lab: &mut Lab<'_>,
        tunable: Tunable,
        known: Option<&Shot>,
    ) -> Result<Option<(Arc<meter::Snapshot>, results::Tuned)>> {
        let Some((shot, tuned)) = known.and_then(|shot| Some((shot, shot.tuned.clone()?))) else { return Ok(None) };
        let value: f64 = tuned.setting.value.parse().map_err(|_| Error::Interrupted)?;
        lab.set(tunable, value)?;
        Ok(lab.shoot(shot.samples as u32, None)?.map(|snapshot| (snapshot, tuned)))
    }

    /// Writes an image.
    fn keep(&mut self, index: usize, snapshot: &meter::Snapshot, tuned: Option<results::Tuned>) -> Result<Shot> {
        let Comparison { budgets, store, .. } = self.comparison;
        let budget = label(budgets.kind, budgets.values[index]);
        let image = Store::run_name(&self.found.variant.asked.name, self.seed, &format!("-{budget}.exr"));
        store.write_image(&image, &snapshot.image.clone().into())?;
        self.stats = Some(snapshot.stats.clone());
        Ok(Shot {
            seconds: snapshot.seconds,
            cpu_seconds: snapshot.cpu_seconds,
            passes: snapshot.stats.passes,
            samples: snapshot.samples,
            image,
            tuned,
        })
    }
}

/// What a run did until its last image.
pub fn statistics(lab: &Lab<'_>, stats: Option<crate::render::Stats>, peak_bytes: Option<u64>) -> Statistics {
    let Some(mut stats) = stats else { return Statistics { peak_bytes, ..Statistics::default() } };
    if let Some(map) = lab.map_stats() {
        (stats.emitted, stats.volume, stats.radii) = (map.emitted, map.volume, map.radii);
        (stats.map_bytes, stats.build_seconds) = (map.map_bytes, map.build_seconds);
    }
    let (width, height) = lab.settings.film.size();
    let pixels = f64::from(width) * f64::from(height);
    let queries = stats.gather.queries as f64;
    Statistics {
        passes: stats.passes,
        samples: stats.samples,
        emitted: stats.emitted,
        photons: stats.volume,
        photons_seconds: stats.photons_seconds,
        build_seconds: stats.build_seconds,
        render_seconds: stats.render_seconds,
        queries: stats.gather.queries,
        photons_per_query: (queries > 0.0).then(|| stats.gather.photons as f64 / queries),
        queries_per_sample: queries / (pixels * stats.samples.max(1) as f64),
        radii: (stats.volume > 0).then(|| [stats.radii.min, stats.radii.mean, stats.radii.max].map(f64::from)),
        map_bytes: stats.map_bytes,
        peak_bytes,
    }
}
