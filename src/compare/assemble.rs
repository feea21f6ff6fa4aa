//! What runs found, as results.

use super::comparison::{Comparison, Found};
use super::context::{pairs, settings};
use super::figures::{figures, mean};
use super::machine;
use super::results::{self, Measure, Measured, Reference, ReferenceKind, Results, SameMap};
use super::store::{Run, Shot, label};
use crate::Result;
use crate::image::Image;
use crate::scene;
use crate::scene::description::ToneMap;

impl Comparison<'_> {
    /// The results of all variants; with `trim`, from the first budget on that all of them reached.
    pub fn results(&self, found: &[Found], complete: bool, trim: bool) -> Result<Results> {
        let (context, request) = (self.context, self.context.request);
        let base = &context.base;
        let mut budgets = self.budgets.clone();
        let mut variants: Vec<results::Variant> =
            found.iter().map(|found| self.variant(found)).collect::<Result<_>>()?;
        if trim {
            let missed = |index: usize| variants.iter().any(|variant| variant.measures[index].measured.is_none());
            let left_out = (0..budgets.values.len()).take_while(|&index| missed(index)).count();
            if left_out < budgets.values.len() {
                budgets.values.drain(..left_out);
                variants.iter_mut().for_each(|variant| drop(variant.measures.drain(..left_out)));
            }
        }
        let reference = match &self.common {
            Some(known) => known.facts.clone(),
            None => Reference {
                kind: ReferenceKind::Own,
                method: None,
                image: None,
                standard_error: None,
                samples: Some(request.limit_samples.into()),
                seconds: None,
                set: Vec::new(),
                regions: Vec::new(),
            },
        };
        let mut warnings: Vec<String> = Vec::new();
        for found in found {
            for warning in found.runs.iter().flat_map(|run| &run.warnings) {
                let warning = format!("{}: {warning}", found.variant.asked.name);
                if !warnings.contains(&warning) {
                    warnings.push(warning);
                }
            }
        }
        if let (Some(error), ReferenceKind::Made) = (reference.standard_error, reference.kind)
            && error > request.reference_error
        {
            warnings.push(format!(
                "the reference has a standard error of {:.2} %, not of {:.2} %: its time was up",
                100.0 * error,
                100.0 * request.reference_error
            ));
        }
        let doubtful = found.iter().zip(&variants).filter(|(found, variant)| self.is_doubtful(found, variant));
        let doubtful: Vec<&str> = doubtful.map(|(_, variant)| variant.name.as_str()).collect();
        if !doubtful.is_empty() {
            warnings.push(format!(
                "errors of {} are less than half of what the reference is uncertain by: it needs a smaller --reference-error and the --reference-time for it, or limits more limit_samples",
                doubtful.join(", ")
            ));
        }
        let scene_text = scene::read_study(&request.scene)?.1;
        Ok(Results {
            version: results::VERSION,
            program: machine::program(),
            machine: machine::machine(),
            threads: rayon::current_num_threads(),
            complete,
            scene: results::Scene {
                path: request.scene.display().to_string(),
                title: base.title.clone(),
                text: scene_text,
                width: base.film.size().0,
                height: base.film.size().1,
                exposure: base.film.exposure,
                filmic: base.film.tone_map == ToneMap::Filmic,
            },
            study: results::Study {
                text: request.study.clone(),
                budgets,
                seeds: self.seeds(),
                set: settings(&pairs(&request.set)),
                layer: request.layer.clone(),
                same_map: context.shared().map(|photons| SameMap {
                    seed: base.render.seed,
                    photons: photons.stored(),
                    emitted: photons.emitted,
                    seconds: photons.seconds,
                }),
            },
            reference,
            regions: self.regions.clone(),
            variants,
            warnings,
        })
    }

    /// Whether some error over the whole image is less than half of what the reference itself is uncertain by.
    fn is_doubtful(&self, found: &Found, variant: &results::Variant) -> bool {
        let known = self.standard(found).facts().and_then(|facts| facts.regions.first()?.variance);
        let squares = variant.measures.iter().flat_map(|measure| &measure.measured).map(|m| m.regions[0].mse.value);
        known.is_some_and(|known| squares.into_iter().any(|square| square < 0.25 * known))
    }

    fn variant(&self, found: &Found) -> Result<results::Variant> {
        let Found { variant, limit, runs } = found;
        let loading: Vec<f64> = runs.iter().map(|run| run.loading_seconds).collect();
        let measures = self.budgets.values.iter().enumerate();
        Ok(results::Variant {
            name: variant.asked.name.clone(),
            method: variant.description.render.method.name().to_string(),
            set: settings(&variant.set),
            notes: variant.notes.clone(),
            limit: limit.as_ref().map(|known| known.facts.clone()),
            loading_seconds: mean(&loading).value,
            statistics: runs.first().map(|run| run.statistics.clone()).unwrap_or_default(),
            measures: measures
                .map(|(index, &budget)| Ok(Measure { budget, measured: self.measured(found, index, budget)? }))
                .collect::<Result<_>>()?,
        })
    }

    /// What was measured at a budget, where all seeds reached it.
    fn measured(&self, found: &Found, index: usize, budget: f64) -> Result<Option<Measured>> {
        // An interrupted run adds what it has.
        let counts = |run: &&Run| run.whole || run.shots[index].is_some();
        let shots: Option<Vec<&Shot>> = found.runs.iter().filter(counts).map(|run| run.shots[index].as_ref()).collect();
        let (Some(shots), Some(standard)) = (shots.filter(|shots| !shots.is_empty()), self.standard(found).0) else {
            return Ok(None);
        };
        let images: Vec<Image> = shots.iter().map(|shot| self.store.read_image(&shot.image)).collect::<Result<_>>()?;
        let mean_image = if images.len() > 1 {
            let name = format!("runs/{}/mean-{}.exr", found.variant.asked.name, label(self.budgets.kind, budget));
            self.store.write_image(&name, &mean_of(&images).into())?;
            Some(name)
        } else {
            None
        };
        let cpu: Option<Vec<f64>> = shots.iter().map(|shot| shot.cpu_seconds).collect();
        Ok(Some(Measured {
            seconds: mean(&shots.iter().map(|shot| shot.seconds).collect::<Vec<_>>()),
            cpu_seconds: cpu.map(|seconds| mean(&seconds)),
            passes: shots[0].passes,
            samples: shots[0].samples,
            tuned: shots[0].tuned.clone(),
            image: shots[0].image.clone(),
            mean_image,
            regions: self.regions.iter().map(|region| figures(&images, &standard.standard, region)).collect(),
        }))
    }
}

/// The mean of images of one size.
fn mean_of(images: &[Image]) -> Image {
    let mut sums = vec![0.0f64; 3 * images[0].pixels.len()];
    for image in images {
        sums.iter_mut().zip(image.pixels.as_flattened()).for_each(|(sum, &value)| *sum += f64::from(value));
    }
    let mut mean = Image::new(images[0].width, images[0].height);
    let count = images.len() as f64;
    mean.pixels.as_flattened_mut().iter_mut().zip(sums).for_each(|(mean, sum)| *mean = (sum / count) as f32);
    mean
}
