//! What to compare.

use std::path::{Path, PathBuf};

use super::results::{BudgetKind, Budgets};
use crate::render::Component;
use crate::scene::{self, Study, StudyReference, StudyVariant};
use crate::{Error, Result};

/// What to compare.
#[derive(Clone, Debug)]
pub struct Request {
    /// The scene file.
    pub scene: PathBuf,
    /// The study file's text, if it is another.
    pub study: Option<String>,
    /// Overrides for all variants, `key=value`.
    pub set: Vec<String>,
    /// The variants; none: the built-in ones of media, but `beam-fixed`, and but `path` where all share a map.
    pub variants: Vec<StudyVariant>,
    /// Where to measure; `None`: at 1, 2, 4… seconds up to `time`, from the first that no variant misses.
    pub budgets: Option<Budgets>,
    /// Seconds that a variant may take; `None`: 60 where budgets do not say it.
    pub time: Option<f64>,
    /// How many seeds, from the scene's on.
    pub seeds: u32,
    /// What errors are measured against.
    pub reference: StudyReference,
    /// What a reference that is made has besides.
    pub reference_set: Vec<(String, String)>,
    /// The relative standard error that it is made to.
    pub reference_error: f64,
    /// Seconds that it may take.
    pub reference_time: f64,
    /// Camera samples per pixel of variants' own limits.
    pub limit_samples: u32,
    /// Whether all variants gather from one map.
    pub same_map: bool,
    /// The layers to measure: `volume`, or names joined by `+`.
    pub layer: Option<String>,
    /// Parts of the image: name, then leftmost column, top row, width and height.
    pub regions: Vec<(String, [u32; 4])>,
    /// The key to be chosen so that variants take the time given.
    pub tune: Option<String>,
}

impl Request {
    /// What the file at `path` asks for: a study, a scene that holds one, or a scene as it is.
    ///
    /// # Errors
    /// [`Error::Asset`] if the file cannot be read or is no text; [`Error::Scene`] with one line for each mistake.
    pub fn read(path: &Path) -> Result<Request> {
        let (study, text) = scene::read_study(path)?;
        let study = study.unwrap_or_default();
        let budgets = |kind, values| Some(Budgets { kind, values });
        let Study { time, same_map, layer, regions, tune, variants, .. } = study;
        Ok(Request {
            study: study.scene.is_some().then_some(text),
            scene: study.scene.unwrap_or_else(|| path.to_owned()),
            set: study.set.iter().map(|(key, value)| format!("{key}={value}")).collect(),
            variants,
            budgets: match (study.budgets, study.samples) {
                (Some(seconds), _) => budgets(BudgetKind::Seconds, seconds),
                (None, Some(samples)) => budgets(BudgetKind::Samples, samples.into_iter().map(f64::from).collect()),
                (None, None) => None,
            },
            time,
            seeds: study.seeds.unwrap_or(1),
            reference: study.reference.unwrap_or(StudyReference::Path),
            reference_set: study.reference_set,
            reference_error: study.reference_error.unwrap_or(0.02),
            reference_time: study.reference_time.unwrap_or(600.0),
            limit_samples: study.limit_samples.unwrap_or(256),
            same_map: same_map.unwrap_or(false),
            layer,
            regions,
            tune,
        })
    }

    /// The components that are measured; `None`: all.
    pub(super) fn components(&self) -> Result<Option<Vec<Component>>> {
        let Some(layer) = &self.layer else { return Ok(None) };
        let mut components: Vec<Component> = Vec::new();
        for name in layer.split('+').map(str::trim) {
            let named: Vec<Component> = match name {
                "volume" => vec![Component::VolumeEmission, Component::VolumeSingle, Component::VolumeMultiple],
                name => Component::ALL.into_iter().filter(|component| component.name() == name).collect(),
            };
            if named.is_empty() {
                let names: Vec<&str> = Component::ALL.iter().map(|component| component.name()).collect();
                return Err(Error::Usage(format!(
                    "there is no layer {name:?}; expected volume, or some of {}, joined by +",
                    names.join(", ")
                )));
            }
            components.extend(named);
        }
        Ok(Some(components))
    }

    /// Where to measure, and whether budgets that not all variants reach are left out at the start.
    pub(super) fn where_to_measure(&self) -> Result<(Budgets, bool)> {
        if let Some(budgets) = &self.budgets {
            let ascends = budgets.values.windows(2).all(|pair| pair[0] < pair[1]);
            let positive = budgets.values.iter().all(|&value| value > 0.0 && value.is_finite());
            if budgets.values.is_empty() || !ascends || !positive {
                return Err(Error::Usage("budgets must be above 0, each larger than the one before".to_string()));
            }
            return Ok((budgets.clone(), false));
        }
        let time = self.time.unwrap_or(60.0);
        let mut values: Vec<f64> = (0..30).map(|k| f64::from(1u32 << k)).take_while(|&value| value < time).collect();
        values.push(time);
        Ok((Budgets { kind: BudgetKind::Seconds, values }, true))
    }
}
