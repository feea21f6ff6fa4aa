//! One scene with its map, rendered as often as it takes.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use super::meter::{Meter, Snapshot};
use super::results::{BudgetKind, Budgets};
use super::variant::Tunable;
use super::watch::Watch;
use crate::render::{Component, Film, Limits, Rendering, SharedMap, SharedPhotons, Stats, refine, refine_shared};
use crate::scene::description::Method;
use crate::scene::{Scene, Settings};
use crate::{Error, Result};

/// A variant of one seed, ready to be rendered.
pub struct Lab<'a> {
    pub scene: Scene,
    pub settings: Settings,
    /// Photons that all share.
    pub photons: Option<&'a SharedPhotons>,
    map: Option<SharedMap>,
    shown: Option<Vec<Component>>,
    watch: &'a dyn Watch,
    stop: &'a AtomicBool,
}

/// What a render found.
pub struct Outcome {
    /// The images taken, by budget.
    pub taken: Vec<Option<Arc<Snapshot>>>,
    pub warnings: Vec<String>,
}

impl<'a> Lab<'a> {
    /// Builds the map, if photons are shared.
    pub fn new(
        (scene, mut settings): (Scene, Settings),
        photons: Option<&'a SharedPhotons>,
        shown: Option<Vec<Component>>,
        watch: &'a dyn Watch,
        stop: &'a AtomicBool,
    ) -> Result<Lab<'a>> {
        // One pass is one pass.
        settings.film.standard_error = false;
        let photons = photons.filter(|_| settings.render.method == Method::Photon);
        let mut lab = Lab { scene, settings, photons, map: None, shown, watch, stop };
        lab.build()?;
        Ok(lab)
    }

    fn build(&mut self) -> Result<()> {
        if let Some(photons) = self.photons {
            self.watch.phase("build", 0);
            self.map = Some(SharedMap::build(&self.scene, &self.settings, photons)?);
        }
        Ok(())
    }

    /// Changes a number of the settings. Returns it as a scene file would say it.
    pub fn set(&mut self, tunable: Tunable, value: f64) -> Result<String> {
        let text = tunable.set(&mut self.settings, value);
        if tunable.changes_maps() {
            self.build()?;
        }
        Ok(text)
    }

    /// What the common map cost, and holds.
    pub fn map_stats(&self) -> Option<&Stats> {
        self.map.as_ref().map(SharedMap::stats)
    }

    /// Renders and measures on the way, for `most` seconds if budgets are no times. With fresh photons, each pass has as
    /// many samples as the scene says; else there is one pass that goes on.
    pub fn measure(&mut self, budgets: &Budgets, most: Option<f64>) -> Result<Outcome> {
        let fresh = self.settings.render.method == Method::Photon && self.photons.is_none();
        let samples = self.settings.render.samples;
        self.settings.render.passes = 1;
        if !fresh {
            self.settings.render.samples = u32::MAX;
        }
        let watch = self.watch;
        let meter = Meter::new(budgets, most, &watch, self.stop);
        let limits = Limits { passes: fresh.then_some(1..=u32::MAX), ..self.limits() };
        let rendering = self.render(&limits, None, &meter, meter.halt());
        self.settings.render.samples = samples;
        Ok(Outcome { warnings: rendering?.warnings, taken: meter.finish() })
    }

    /// One image of so many samples, of a single pass, if it takes no more than `most` seconds.
    pub fn shoot(&mut self, samples: u32, most: Option<f64>) -> Result<Option<Arc<Snapshot>>> {
        let before = std::mem::replace(&mut self.settings.render.samples, samples);
        let budgets = Budgets { kind: BudgetKind::Samples, values: vec![samples.into()] };
        let outcome = self.measure(&budgets, most);
        self.settings.render.samples = before;
        if self.stop.load(Ordering::Relaxed) {
            return Err(Error::Interrupted);
        }
        Ok(outcome?.taken.pop().flatten())
    }

    /// Limits that say which components to show.
    pub fn limits(&self) -> Limits {
        Limits { shown: self.shown.clone(), ..Limits::default() }
    }

    /// Renders from the common map, or with fresh photons where there is none.
    pub fn render(
        &mut self,
        limits: &Limits,
        before: Option<(Film, Stats)>,
        progress: &impl crate::render::Progress,
        stop: &AtomicBool,
    ) -> Result<Rendering> {
        match &mut self.map {
            Some(map) => refine_shared(&self.scene, &self.settings, map, limits, before, progress, stop),
            None => refine(&self.scene, &self.settings, limits, before, progress, stop),
        }
    }
}
