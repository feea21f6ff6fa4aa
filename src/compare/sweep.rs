//! Sweeps: the same comparison at many values of one key, to see where an estimate ceases to hold and what it costs there.
//!
//! A point of a sweep is a comparison with one budget, in `points/<number>` of its folder; what they found together is in
//! `sweep.json` and `sweep.csv`. What cannot be rendered at a point, or not in time, is left out there with the reason.

use std::fmt::Write as _;
use std::path::Path;
use std::sync::atomic::AtomicBool;

use serde::{Deserialize, Serialize};

use super::context::{pairs, settings};
use super::csv::quoted;
use super::results::{BudgetKind, Budgets, Figure, Machine, Measured, Program, Results, Setting};
use super::store::Store;
use super::variant::Variant;
use super::{Context, Request, Watch, checks, machine, measure};
use crate::scene::{StudyReference, StudyVariant};
use crate::{Error, Result};

/// The version of the format of `sweep.json`.
pub const VERSION: u32 = 1;

/// Values of one key.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Range {
    /// The dotted key of the scene file.
    pub key: String,
    /// Whether each value is the same multiple of the one before, and not as much more.
    pub geometric: bool,
    /// The values, from end to end.
    pub values: Vec<f64>,
}

/// Ends of the same sign whose ratio is less than this have points evenly between them.
const NEAR: f64 = 10.0;

impl Range {
    /// So many values from one end to the other: each the same multiple of the one before where both ends have one sign and are at
    /// least ten times apart, else evenly spaced. `whole` numbers are rounded, and those that fall together are one.
    ///
    /// # Errors
    /// What is wrong with the ends.
    pub fn new(key: &str, [from, to]: [f64; 2], points: u32, whole: bool) -> Result<Range, String> {
        if !from.is_finite() || !to.is_finite() || from == to {
            return Err("expected two finite numbers that differ".to_string());
        }
        let ratio = to / from;
        let geometric = ratio > 0.0 && ratio.is_finite() && !(1.0 / NEAR..NEAR).contains(&ratio);
        let last = points.max(2) - 1;
        let value = |k: u32| {
            let share = f64::from(k) / f64::from(last);
            let value = match k {
                0 => from,
                k if k == last => to,
                _ if geometric => from * ratio.powf(share),
                _ => from + share * (to - from),
            };
            match (whole, geometric) {
                (true, _) => value.round(),
                (false, true) => rounded(value),
                // Halfway between −a and a is nothing.
                (false, false) if value.abs() < 1e-9 * (to - from).abs() => 0.0,
                (false, false) => rounded(value),
            }
        };
        let mut values: Vec<f64> = (0..=last).map(value).collect();
        values.dedup();
        Ok(Range { key: key.to_string(), geometric, values })
    }
}

/// A value with four digits.
fn rounded(value: f64) -> f64 {
    // What is written can be read.
    format!("{value:.3e}").parse().unwrap_or(value)
}

/// A whole sweep.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Sweep {
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
    /// The scene file, as it was named.
    pub scene: String,
    /// What is swept.
    pub range: Range,
    /// Where variants are measured: one budget.
    pub budgets: Budgets,
    /// Seeds of each variant and point.
    pub seeds: u32,
    /// Keys of the scene file that were replaced for all.
    pub set: Vec<Setting>,
    /// By variant, in the order they were asked for.
    pub variants: Vec<Swept>,
}

/// A variant at all points.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Swept {
    /// Its name.
    pub name: String,
    /// By value of the key, in their order.
    pub points: Vec<Point>,
}

/// A variant at a point.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Point {
    /// The value of the key.
    pub value: f64,
    /// What was found.
    pub found: Option<Found>,
    /// Why nothing was, and what was warned about.
    pub notes: Vec<String>,
}

/// What was found of a variant at a point; the figures are defined in [`results`](super::results).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Found {
    /// Wall-clock seconds.
    pub seconds: Figure,
    /// Seconds of all threads, where the system tells.
    pub cpu_seconds: Option<Figure>,
    /// Camera samples per pixel, of the first seed.
    pub samples: u64,
    /// The mean over pixels and channels.
    pub mean: Figure,
    /// That of the reference.
    pub reference: f64,
    /// The relative standard error of its pixels, where it is known.
    pub reference_error: Option<f64>,
    /// Relative mean squared error against the reference; `None` if that is black.
    pub relmse: Option<Figure>,
}

impl Found {
    fn new(results: &Results, measured: &Measured) -> Option<Found> {
        let (figures, reference) = (measured.regions.first()?, results.reference.regions.first()?);
        let errors: Option<Vec<f64>> = figures.mean.iter().map(|figure| figure.error).collect();
        // Channels are seen by the same samples: their errors are taken to go together.
        let error = errors.map(|errors| errors.iter().sum::<f64>() / 3.0);
        Some(Found {
            seconds: measured.seconds,
            cpu_seconds: measured.cpu_seconds,
            samples: measured.samples,
            mean: Figure { value: figures.mean.iter().map(|figure| figure.value).sum::<f64>() / 3.0, error },
            reference: reference.mean.iter().sum::<f64>() / 3.0,
            reference_error: results.reference.standard_error,
            relmse: figures.relmse,
        })
    }

    /// The mean as a share of the reference's, with its standard error over seeds; `None` where the reference is black.
    pub fn share(&self) -> Option<Figure> {
        let share = |value: f64| value / self.reference;
        (self.reference > 0.0).then(|| Figure { value: share(self.mean.value), error: self.mean.error.map(share) })
    }

    /// √relmse, 0 where chance makes that negative.
    pub fn error(&self) -> Option<Figure> {
        let Figure { value, error } = self.relmse?;
        let root = value.max(0.0).sqrt();
        Some(Figure { value: root, error: error.filter(|_| root > 0.0).map(|error| 0.5 * error / root) })
    }

    /// relmse times CPU seconds: what a better estimate has less of however long it takes.
    pub fn work(&self) -> Option<f64> {
        Some(self.relmse?.value.max(0.0) * self.cpu_seconds?.value)
    }
}

/// Compares at all values of a key, in `folder`: what it already holds of the same points is not repeated. Runs on the current
/// thread pool; `stop` ends it early, and what was measured by then is in the results.
///
/// # Errors
/// As [`run`](super::run) where nothing can be compared at all, at any value. What is refused at some is told there.
pub fn run(request: &Request, range: &Range, folder: &Path, watch: &dyn Watch, stop: &AtomicBool) -> Result<Sweep> {
    let mut request = request.clone();
    check(&request)?;
    let (variants, samples) = {
        let budgets = Budgets { kind: BudgetKind::Samples, values: vec![1.0] };
        let mut context = Context::new(&request, watch, stop)?;
        let samples = context.base.render.samples;
        (checks::variants(&mut context, request.budgets.as_ref().unwrap_or(&budgets))?, samples)
    };
    let budgets = match request.budgets.take().filter(|budgets| !budgets.values.is_empty()) {
        Some(budgets) if budgets.values.len() == 1 => budgets,
        Some(_) => {
            return Err(Error::Usage("a sweep measures at one budget: give one of --samples or --budgets".to_string()));
        }
        None => Budgets { kind: BudgetKind::Samples, values: vec![samples.into()] },
    };
    request.budgets = Some(budgets.clone());
    let store = Store::new(folder, "sweep.json")?;
    let swept = |variant: &Variant| Swept { name: variant.asked.name.clone(), points: Vec::new() };
    let mut sweep = Sweep {
        version: VERSION,
        program: machine::program(),
        machine: machine::machine(),
        threads: rayon::current_num_threads(),
        complete: true,
        scene: request.scene.display().to_string(),
        range: range.clone(),
        budgets,
        seeds: request.seeds,
        set: settings(&pairs(&request.set)),
        variants: variants.iter().map(swept).collect(),
    };
    let asked: Vec<StudyVariant> = variants.into_iter().map(|variant| variant.asked).collect();
    let mut refused = None;
    'points: for (index, &value) in range.values.iter().enumerate() {
        let place = folder.join(format!("points/{index}"));
        for (variant, asked) in sweep.variants.iter_mut().zip(&asked) {
            watch.begins(&format!("{} = {value}: {}", range.key, asked.name));
            let mut one = request.clone();
            one.variants = vec![asked.clone()];
            one.set.push(format!("{}={value}", range.key));
            variant.points.push(match point(&one, value, &place, watch, stop) {
                Ok(point) => point,
                Err(error @ (Error::Scene(_) | Error::Limit(_) | Error::Asset { .. })) => {
                    // Without the line of the scene file that is shown below.
                    let notes = error.to_string().lines().next().map(str::to_string).into_iter().collect();
                    refused.get_or_insert(error);
                    Point { value, found: None, notes }
                }
                Err(Error::Interrupted) => {
                    sweep.complete = false;
                    break 'points;
                }
                Err(error) => return Err(error),
            });
        }
    }
    let mut points = sweep.variants.iter().flat_map(|variant| &variant.points).peekable();
    if points.peek().is_none() {
        return Err(Error::Interrupted);
    }
    // A key that there is not, say.
    if let Some(error) = refused.filter(|_| points.all(|point| point.found.is_none())) {
        return Err(error);
    }
    store.write("sweep.json", &sweep)?;
    store.write_text("sweep.csv", &table(&sweep))?;
    Ok(sweep)
}

/// What a sweep cannot be asked for.
fn check(request: &Request) -> Result<()> {
    let asked = [
        (request.same_map, "one map for all variants"),
        (request.tune.is_some(), "a key to tune"),
        (!request.regions.is_empty(), "regions"),
        (matches!(request.reference, StudyReference::File(_)), "a file as its reference"),
        (request.reference == StudyReference::Own, "a reference of each variant's own"),
    ];
    match asked.iter().find(|(asked, _)| *asked) {
        Some((_, what)) => Err(Error::Usage(format!("a sweep does not take {what}"))),
        None => Ok(()),
    }
}

/// One variant at one point.
fn point(request: &Request, value: f64, folder: &Path, watch: &dyn Watch, stop: &AtomicBool) -> Result<Point> {
    let (_, results) = measure(request, folder, watch, stop)?;
    if !results.complete {
        return Err(Error::Interrupted);
    }
    let variant = results.variants.first();
    let measured = variant.and_then(|variant| variant.measures.first()?.measured.as_ref());
    let mut notes: Vec<String> = variant.map(|variant| variant.notes.clone()).unwrap_or_default();
    notes.extend(results.warnings.iter().cloned());
    if measured.is_none() {
        notes.push("not reached in the time given".to_string());
    }
    Ok(Point { value, found: measured.and_then(|measured| Found::new(&results, measured)), notes })
}

const COLUMNS: &str = "value,variant,seconds,cpu_seconds,samples,mean,mean_se,reference,reference_error,share,share_se,\
relmse,relmse_se,error,error_se,work,notes";

/// `sweep.csv`: a line for each value and variant. Fields that are not known are empty.
fn table(sweep: &Sweep) -> String {
    let mut text = format!("{COLUMNS}\n");
    for (index, value) in sweep.range.values.iter().enumerate() {
        for variant in &sweep.variants {
            let Some(point) = variant.points.get(index) else { continue };
            let mut line = vec![value.to_string(), variant.name.clone()];
            line.extend(match &point.found {
                Some(found) => fields(found),
                None => vec![String::new(); COLUMNS.split(',').count() - 3],
            });
            line.push(quoted(&point.notes.join("; ")));
            // Writing to a string cannot fail.
            let _ = writeln!(text, "{}", line.join(","));
        }
    }
    text
}

fn fields(found: &Found) -> Vec<String> {
    let number = |value: Option<f64>| value.map_or(String::new(), |value| value.to_string());
    let both = |figure: Option<Figure>| [number(figure.map(|f| f.value)), number(figure.and_then(|f| f.error))];
    let mut fields = vec![found.seconds.value.to_string(), number(found.cpu_seconds.map(|figure| figure.value))];
    fields.push(found.samples.to_string());
    fields.extend(both(Some(found.mean)));
    fields.extend([found.reference.to_string(), number(found.reference_error)]);
    fields.extend([found.share(), found.relmse, found.error()].into_iter().flat_map(both));
    fields.push(number(found.work()));
    fields
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_are_spaced_as_their_ends_ask() {
        let range = |ends, points, whole| Range::new("a.b", ends, points, whole).unwrap();
        let wide = range([1e-8, 1e6], 8, false);
        assert_eq!(
            (wide.geometric, wide.values.as_slice()),
            (true, &[1e-8, 1e-6, 1e-4, 0.01, 1.0, 100.0, 1e4, 1e6][..])
        );
        let signs = range([-0.9, 0.9], 5, false);
        assert_eq!((signs.geometric, signs.values.as_slice()), (false, &[-0.9, -0.45, 0.0, 0.45, 0.9][..]));
        assert_eq!(range([1.0, 2.5], 4, false).values, [1.0, 1.5, 2.0, 2.5]);
        assert_eq!(range([-1e4, -1.0], 5, false).values, [-1e4, -1e3, -100.0, -10.0, -1.0]);
        assert_eq!(range([1.0, 10.0], 30, true).values, (1..=10).map(f64::from).collect::<Vec<_>>());
        assert_eq!(range([0.0, 3.0], 2, true).values, [0.0, 3.0]);
        assert_eq!(range([0.0, 1.0], 3, false).values, [0.0, 0.5, 1.0]);
        assert_eq!(range([1e4, 0.0], 3, false).values, [1e4, 5e3, 0.0]);
        assert!(Range::new("a", [1.0, 1.0], 3, false).is_err() && Range::new("a", [0.0, f64::NAN], 3, false).is_err());
    }
}
