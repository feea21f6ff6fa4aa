//! What a comparison found: the contents of `results.json`, version 1.
//!
//! # How figures are defined
//!
//! With I_k the image of seed k (k = 1…K), R the reference, V its variance (the squared standard error of each of its
//! pixels' channels), M the mean of the whole reference, and ⟨·⟩ the mean over the pixels of a region and three
//! channels:
//!
//! | | |
//! |---|---|
//! | `mse` | the mean over seeds of ⟨(I_k − R)²⟩, less ⟨V⟩ |
//! | `rmse` | √mse; 0 where chance makes `mse` negative |
//! | `relmse` | the mean over seeds of ⟨(I_k − R)²/(R² + 0.01 M²)⟩, less ⟨V/(R² + 0.01 M²)⟩: as `volpm diff`, but that M is always that of the whole image |
//! | `variance` | ⟨Σ_k (I_k − Ī)²⟩/(K − 1), Ī the mean of the images: what another seed would change |
//! | `bias2` | ⟨(Ī − R)²⟩ − variance/K − ⟨V⟩: without bias, negative as often as positive; `mse` = `bias2` + `variance` |
//!
//! Standard errors are those of the figure over seeds: of K independent values for `mse`, `relmse`, the mean and the
//! seconds; by the jackknife for `variance` and `bias2`. They leave out what is uncertain of the reference, which all
//! seeds share.
//!
//! All paths are relative to the folder of the results.

use serde::{Deserialize, Serialize};

/// The version of the format. It changes when a field changes its meaning or goes; fields may be added without.
pub const VERSION: u32 = 1;

/// A whole comparison.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Results {
    /// [`VERSION`].
    pub version: u32,
    /// What made it.
    pub program: Program,
    /// Where it ran.
    pub machine: Machine,
    /// Threads that rendered.
    pub threads: usize,
    /// Whether all that was asked for is there; not if it was interrupted.
    pub complete: bool,
    /// What was rendered.
    pub scene: Scene,
    /// What was asked for.
    pub study: Study,
    /// What errors are measured against.
    pub reference: Reference,
    /// The parts of the image that errors are given for; the first is the whole, named `image`.
    pub regions: Vec<Region>,
    /// In the order they were asked for.
    pub variants: Vec<Variant>,
    /// What the user should know.
    pub warnings: Vec<String>,
}

/// A program.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Program {
    /// `volpm`.
    pub name: String,
    /// Its version.
    pub version: String,
    /// The commit it was built from, where that is known.
    pub commit: Option<String>,
}

/// A machine.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Machine {
    /// The processor's name, where the system tells.
    pub cpu: Option<String>,
    /// Threads that run at once.
    pub logical_cores: usize,
    /// Operating system and architecture: `linux x86_64`.
    pub os: String,
}

/// The scene that is compared.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Scene {
    /// The scene file, as it was named.
    pub path: String,
    /// What it calls itself.
    pub title: Option<String>,
    /// Its text.
    pub text: String,
    /// Pixels across.
    pub width: u32,
    /// Pixels down.
    pub height: u32,
    /// Stops by which pictures are to be brightened; `None`: chosen from the reference.
    pub exposure: Option<f64>,
    /// Whether pictures have the filmic tone curve; else they are clipped.
    pub filmic: bool,
}

/// What was asked for.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Study {
    /// The study file's text, if it is not in the scene file.
    pub text: Option<String>,
    /// Where variants are measured.
    pub budgets: Budgets,
    /// The seeds of each variant.
    pub seeds: Vec<u64>,
    /// Keys of the scene file that were replaced for all variants.
    pub set: Vec<Setting>,
    /// The layers that were measured, `volume` or names joined by `+`; `None`: the whole image.
    pub layer: Option<String>,
    /// The photons that all variants share, if they do.
    pub same_map: Option<SameMap>,
}

/// Where variants are measured.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Budgets {
    /// What the values are.
    pub kind: BudgetKind,
    /// Ascending.
    pub values: Vec<f64>,
}

/// What budgets count.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum BudgetKind {
    /// Seconds of wall-clock time, as [`Measured::seconds`].
    Seconds,
    /// Camera samples per pixel.
    Samples,
}

/// A key of the scene file and its value, as `--set` takes them.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Setting {
    /// The dotted key.
    pub key: String,
    /// A value of TOML.
    pub value: String,
}

/// Photons that all variants gather from.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SameMap {
    /// The seed they were drawn with.
    pub seed: u64,
    /// Photons stored.
    pub photons: u64,
    /// Photons emitted.
    pub emitted: u64,
    /// Seconds to trace them; in no variant's time.
    pub seconds: f64,
}

/// An image that errors are measured against.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Reference {
    /// Where it comes from.
    pub kind: ReferenceKind,
    /// Its method, `path` or `photon`, where it was made.
    pub method: Option<String>,
    /// An EXR file with it, and with its standard error as layer `standard_error` if that is known. `None` where each
    /// variant has one of its own ([`Variant::limit`]).
    pub image: Option<String>,
    /// √⟨V/(R² + 0.01 M²)⟩ over the whole image; `None` where it is not known, and errors include the reference's.
    pub standard_error: Option<f64>,
    /// Camera samples per pixel, where it was made.
    pub samples: Option<u64>,
    /// Seconds it took, where it was made.
    pub seconds: Option<f64>,
    /// What was set for it beside what holds for all.
    pub set: Vec<Setting>,
    /// By region, in their order.
    pub regions: Vec<ReferenceRegion>,
}

/// Where a reference comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum ReferenceKind {
    /// A file that was given.
    File,
    /// Made for this comparison.
    Made,
    /// Each variant's own limit: the same map gathered with many samples.
    Own,
}

/// A region of a reference.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ReferenceRegion {
    /// Its mean by channel.
    pub mean: [f64; 3],
    /// ⟨V⟩, where it is known.
    pub variance: Option<f64>,
}

/// A part of the image.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Region {
    /// Its name.
    pub name: String,
    /// The leftmost column.
    pub x: u32,
    /// The top row.
    pub y: u32,
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
}

/// An estimate with its settings.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Variant {
    /// Its name: letters, digits, `-`, `_` and `.`, so that it can name files.
    pub name: String,
    /// `path` or `photon`.
    pub method: String,
    /// What was set for it beside what holds for all.
    pub set: Vec<Setting>,
    /// Settings that were derived and not given, in words.
    pub notes: Vec<String>,
    /// The image that its errors are measured against, if not the common one.
    pub limit: Option<Reference>,
    /// Seconds to read and build the scene, mean over seeds; in no time below.
    pub loading_seconds: f64,
    /// What a run did, of the first seed, up to the last measure.
    pub statistics: Statistics,
    /// One for each budget, in their order.
    pub measures: Vec<Measure>,
}

/// What a run did.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Statistics {
    /// Passes with photons of their own.
    pub passes: u64,
    /// Camera samples per pixel.
    pub samples: u64,
    /// Photons emitted, in all passes.
    pub emitted: u64,
    /// Photons stored, in all passes.
    pub photons: u64,
    /// Seconds in the photon pass.
    pub photons_seconds: f64,
    /// Seconds for radii and hierarchies. With one map for all, only those of its own structure over it, which are in
    /// no measured time.
    pub build_seconds: f64,
    /// Seconds for the pixels.
    pub render_seconds: f64,
    /// Queries: of rays by beams, of points by marching.
    pub queries: u64,
    /// Photons gathered by a query on average: discs per ray with beams. `None` without queries.
    pub photons_per_query: Option<f64>,
    /// Queries for a camera sample, on average.
    pub queries_per_sample: f64,
    /// The radii of discs, or of the balls of points, of the last pass: smallest, mean, largest. `None` where there is no
    /// map, and for points whose balls are as wide as their neighbours say.
    pub radii: Option<[f64; 3]>,
    /// Bytes of the largest map.
    pub map_bytes: u64,
    /// The most memory that the process held during the run, where the system tells: scene, map and image, and what
    /// the comparison keeps.
    pub peak_bytes: Option<u64>,
}

/// A variant at a budget.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Measure {
    /// The budget.
    pub budget: f64,
    /// What was found; `None` where some seed had no image by then.
    pub measured: Option<Measured>,
}

/// An image on the way, and what it cost.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Measured {
    /// Wall-clock seconds to this image: photons, map and pixels, without loading and measuring; with one map for all,
    /// pixels only. The last whole pass (in the first: the last whole round of samples) within the budget counts, so
    /// that it is a little below a budget in seconds.
    pub seconds: Figure,
    /// Seconds of all threads, where the system tells.
    pub cpu_seconds: Option<Figure>,
    /// Passes with photons of their own, of the first seed; 0 within the first.
    pub passes: u64,
    /// Camera samples per pixel, of the first seed.
    pub samples: u64,
    /// What was chosen so that the variant takes the time given, if it was.
    pub tuned: Option<Tuned>,
    /// An EXR file with the image of the first seed.
    pub image: String,
    /// An EXR file with the mean over seeds, where there are several: noise is less there, bias is not.
    pub mean_image: Option<String>,
    /// By region, in their order.
    pub regions: Vec<Figures>,
}

/// What was chosen for a variant.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Tuned {
    /// The time it was to take.
    pub target_seconds: f64,
    /// The key that was varied, and the value chosen.
    pub setting: Setting,
    /// Whether even the cheapest setting takes longer than the time given: then that is what is shown.
    pub over: bool,
    /// All numbers of camera samples that were tried, each with the value that takes the time given. The one with the
    /// least RMSE over the whole image (first seed) was chosen.
    pub trials: Vec<Trial>,
}

/// A setting that takes the time given.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Trial {
    /// Camera samples per pixel.
    pub samples: u64,
    /// The value of the key.
    pub value: String,
    /// Seconds it took.
    pub seconds: f64,
    /// RMSE over the whole image, of the first seed.
    pub rmse: f64,
}

/// A number and its standard error over seeds.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Figure {
    /// The number.
    pub value: f64,
    /// Its standard error; `None` with too few seeds to tell.
    pub error: Option<f64>,
}

/// Error figures of a region, as the [module](self) defines them.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Figures {
    /// Mean by channel.
    pub mean: [Figure; 3],
    /// Mean squared error.
    pub mse: Figure,
    /// Its root.
    pub rmse: Figure,
    /// Relative mean squared error; `None` if the reference is black.
    pub relmse: Option<Figure>,
    /// Squared bias; `None` with a single seed.
    pub bias2: Option<Figure>,
    /// Variance; `None` with a single seed.
    pub variance: Option<Figure>,
}
