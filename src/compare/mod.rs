//! Error against run time: several estimates of one scene, each refined once and measured on the way.
//!
//! A [`Request`] says what to compare, [`run()`] does it in a folder, and [`Results`] say what was found. What is measured,
//! and how, is told in `docs/compare.md`; the figures are defined in [`results`]. A [`sweep`] compares at many values of one key.

mod assemble;
mod checks;
mod comparison;
mod context;
mod csv;
mod figures;
mod lab;
mod machine;
mod measuring;
mod meter;
mod reference;
mod request;
pub mod results;
mod run;
mod store;
pub mod sweep;
mod tune;
mod variant;
mod watch;

use std::path::Path;
use std::sync::atomic::AtomicBool;

use crate::{Error, Result};

pub use machine::{cpu_seconds, peak_bytes, resident_bytes};
pub use request::Request;
pub use results::Results;
pub use variant::parse as parse_variants;
pub use watch::Watch;

use comparison::{Comparison, Found};
use context::Context;
use store::Store;

/// Compares, in `folder`: what it already holds of the same comparison is not repeated. Runs on the current thread pool;
/// `stop` ends it early, and what was measured by then is in the results, which are written to the folder too.
///
/// # Errors
/// [`Error::Usage`], [`Error::Scene`] and [`Error::Asset`] for what cannot be compared; [`Error::Output`] where the folder
/// cannot be written to; [`Error::Interrupted`] if nothing was measured yet.
pub fn run(request: &Request, folder: &Path, watch: &dyn Watch, stop: &AtomicBool) -> Result<Results> {
    let (store, results) = measure(request, folder, watch, stop)?;
    store.write_results(&results)?;
    Ok(results)
}

/// Compares in a folder, and leaves what was found to be written there.
fn measure(request: &Request, folder: &Path, watch: &dyn Watch, stop: &AtomicBool) -> Result<(Store, Results)> {
    let (budgets, trim) = request.where_to_measure()?;
    let mut context = Context::new(request, watch, stop)?;
    let regions = checks::regions(request, &context.base)?;
    let store = Store::new(folder, "results.json")?;
    let variants = checks::variants(&mut context, &budgets)?;
    if request.same_map {
        context.photons()?;
    }
    let common = reference::common(&context, &store, &regions)?;
    let comparison = Comparison { context: &context, store: &store, budgets, regions, common };
    let mut found: Vec<Found> = variants.into_iter().map(Found::new).collect();
    let complete = match comparison.measure(&mut found) {
        Ok(()) => true,
        Err(Error::Interrupted) if found.iter().any(|found| !found.runs.is_empty()) => false,
        Err(error) => return Err(error),
    };
    let results = comparison.results(&found, complete, trim)?;
    Ok((store, results))
}
