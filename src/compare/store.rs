//! The folder of a comparison: what is kept in it, and what of it still holds.
//!
//! ```text
//! results.json, results.csv
//! reference.exr, reference.json                  the common reference, and what it was made of
//! limits/<what it is of>.exr, .json              variants' own limits
//! runs/<variant>/seed-<seed>.json                what a run found, and what it was of
//! runs/<variant>/seed-<seed>-<budget>.exr        its images
//! runs/<variant>/mean-<budget>.exr               their means over seeds
//! ```

use std::fs;
use std::io::Write as _;
use std::path::{Path, PathBuf};

use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

use super::results::{BudgetKind, Results, Statistics, Tuned};
use crate::image::{self, Image, Picture, ToneSettings, write_aside};
use crate::{Error, Result};

/// The folder of a comparison.
#[derive(Clone, Debug)]
pub struct Store {
    folder: PathBuf,
}

/// What a run of a variant with one seed found.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Run {
    /// Of all that it depends on.
    pub digest: String,
    /// Whether it came to its end.
    pub whole: bool,
    pub loading_seconds: f64,
    pub statistics: Statistics,
    pub warnings: Vec<String>,
    /// By budget, where there was an image.
    pub shots: Vec<Option<Shot>>,
}

/// An image on the way.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Shot {
    pub seconds: f64,
    pub cpu_seconds: Option<f64>,
    pub passes: u64,
    pub samples: u64,
    pub image: String,
    pub tuned: Option<Tuned>,
}

/// What a reference is of, beside its image.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Made {
    pub digest: String,
    pub samples: u64,
    pub seconds: f64,
}

impl Store {
    /// The folder, which is made if it is missing, for results in the file called `results`.
    pub fn new(folder: &Path, results: &str) -> Result<Store> {
        let store = Store { folder: folder.to_owned() };
        store.make(&store.folder)?;
        image::check_target(folder.join(results))?;
        Ok(store)
    }

    fn make(&self, folder: &Path) -> Result<()> {
        fs::create_dir_all(folder).map_err(|error| Error::output(folder, error))
    }

    /// A file in it, by its relative name.
    pub fn path(&self, name: &str) -> PathBuf {
        self.folder.join(name)
    }

    /// The name of a run's file.
    pub fn run_name(variant: &str, seed: u64, rest: &str) -> String {
        format!("runs/{variant}/seed-{seed}{rest}")
    }

    /// What a file holds, if it is there and whole.
    pub fn read<T: DeserializeOwned>(&self, name: &str) -> Option<T> {
        serde_json::from_slice(&fs::read(self.path(name)).ok()?).ok()
    }

    /// Writes a value as JSON, aside first.
    pub fn write(&self, name: &str, value: &impl Serialize) -> Result<()> {
        let path = self.path(name);
        let text = serde_json::to_string_pretty(value).map_err(|error| Error::output(&path, error))?;
        self.write_text(name, &(text + "\n"))
    }

    /// Writes a text file, aside first.
    pub fn write_text(&self, name: &str, text: &str) -> Result<()> {
        let path = self.path(name);
        self.make(path.parent().unwrap_or(&self.folder))?;
        write_aside(&path, |file| file.write_all(text.as_bytes()))
    }

    /// Writes an image.
    pub fn write_image(&self, name: &str, picture: &Picture) -> Result<()> {
        let path = self.path(name);
        self.make(path.parent().unwrap_or(&self.folder))?;
        image::write(&path, picture, &ToneSettings::default())
    }

    /// Reads an image.
    pub fn read_image(&self, name: &str) -> Result<Image> {
        Ok(image::read(self.path(name))?.image)
    }

    /// Whether a file is there.
    pub fn has(&self, name: &str) -> bool {
        self.path(name).is_file()
    }

    /// A run that is of `digest`, with its images.
    pub fn run(&self, variant: &str, seed: u64, digest: &str) -> Option<Run> {
        let run: Run = self.read(&Store::run_name(variant, seed, ".json"))?;
        let complete = run.shots.iter().flatten().all(|shot| self.has(&shot.image));
        Some(run).filter(|run| complete && run.digest == digest)
    }

    /// Writes `results.json` and `results.csv`.
    pub fn write_results(&self, results: &Results) -> Result<()> {
        self.write("results.json", results)?;
        self.write_text("results.csv", &super::csv::table(results))
    }
}

/// A budget in the name of a file.
pub fn label(kind: BudgetKind, budget: f64) -> String {
    match kind {
        BudgetKind::Seconds => format!("{budget}s"),
        BudgetKind::Samples => format!("{budget}spp"),
    }
}
