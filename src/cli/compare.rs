//! `volpm compare`.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;
use std::time::Duration;

use clap::Args;

use super::planned::refuse;
use super::progress::Bar;
use super::values;
use crate::compare::results::{BudgetKind, Budgets, Results};
use crate::compare::sweep::{Range, Sweep};
use crate::compare::{self, Request, Watch};
use crate::render::{Film, Progress, Stats};
use crate::scene::StudyReference;
use crate::{Error, Result, report};

#[derive(Args)]
pub struct Arguments {
    /// A scene file, or a study file: one with a table [compare].
    scene: PathBuf,
    /// The folder of the report; what it holds of the same comparison is not repeated.
    #[arg(short, long, value_name = "DIR")]
    out: PathBuf,
    /// The variants to compare: path, light, beam, beam-fixed, point-uniform, point-adaptive, point-exponential, map, sheets,
    /// final-gather, cache, and own ones as name:key=value,key=value. Default: path, beam and the points.
    #[arg(long, value_name = "LIST")]
    estimates: Vec<String>,
    /// Times at which to measure: 1s,2s,4s. Default: doubling from 1s up to --time, from the first that every variant
    /// reaches.
    #[arg(long, value_name = "LIST", value_delimiter = ',', value_parser = values::time)]
    budgets: Vec<Duration>,
    /// Camera samples per pixel at which to measure, instead of times: 1,2,4.
    #[arg(long, value_name = "LIST", value_delimiter = ',', conflicts_with = "budgets",
        value_parser = clap::value_parser!(u32).range(1..))]
    samples: Vec<u32>,
    /// How long each variant is refined: 90s, 1.5m, 2h. Default: 60s.
    #[arg(long, value_name = "TIME", value_parser = values::time)]
    time: Option<Duration>,
    /// Chooses this key for each variant that depends on it, such that it takes the time given: volume.march.size,
    /// volume.march.contrast, volume.neighbours, volume.radius or photons.volume.
    #[arg(long, value_name = "KEY")]
    tune: Option<String>,
    /// All variants gather from one photon map.
    #[arg(long)]
    same_map: bool,
    /// Renders each variant with so many seeds, to tell bias from variance.
    #[arg(long, value_name = "K", value_parser = clap::value_parser!(u32).range(1..=1000))]
    seeds: Option<u32>,
    /// What errors are measured against: an image file, path or photon for an image made by that method, or own for each
    /// variant's own limit on the common map. Default: path.
    #[arg(long, value_name = "REFERENCE")]
    reference: Option<String>,
    /// The standard error to which a reference is made: 2%.
    #[arg(long, value_name = "SHARE", value_parser = values::share)]
    reference_error: Option<f64>,
    /// How long that may take. Default: 10m.
    #[arg(long, value_name = "TIME", value_parser = values::time)]
    reference_time: Option<Duration>,
    /// A part of the image to give errors for, in pixels from the top left; repeatable.
    #[arg(long, value_name = "NAME=X,Y,W,H", value_parser = values::region)]
    region: Vec<(String, [u32; 4])>,
    /// Measures this layer instead of the whole image: volume, or names of EXR layers joined by +.
    #[arg(long, value_name = "NAME")]
    layer: Option<String>,
    /// Overrides a key of the scene file for all variants; repeatable.
    #[arg(long, value_name = "KEY=VALUE")]
    set: Vec<String>,
    /// Threads to use; default: all cores.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    threads: Option<u16>,
    /// Compares at values of this key from A to B, instead of at times: media.fog.scale=1e-8..1e6. What each variant does with
    /// as many samples (or seconds) is measured against the reference of each value.
    #[arg(long, value_name = "KEY=A..B", value_parser = values::sweep)]
    sweep: Option<values::Ends>,
    /// How many values that is.
    #[arg(long, value_name = "N", default_value_t = 8, requires = "sweep",
        value_parser = clap::value_parser!(u32).range(2..=1000))]
    points: u32,
    /// Prints the results as JSON instead of a table.
    #[arg(long)]
    json: bool,
    /// Warnings are errors, once the results are printed.
    #[arg(long)]
    strict: bool,
    /// No progress and no messages but errors.
    #[arg(short, long)]
    quiet: bool,
}

pub fn run(arguments: &Arguments) -> Result<()> {
    let request = request(arguments)?;
    let stop = super::stop_on_signal()?;
    let pool = super::pool(arguments.threads)?;
    let teller = Teller { bar: Bar::new(arguments.quiet) };
    if let Some(ends) = &arguments.sweep {
        return sweep(arguments, &request, ends, &teller, (&pool, &stop));
    }
    let results = pool.install(|| {
        let results = compare::run(&request, &arguments.out, &teller, &stop)?;
        report::write(&results, &arguments.out)?;
        Ok(results)
    });
    teller.bar.finish();
    let results = results?;
    if !arguments.quiet {
        if !arguments.strict {
            results.warnings.iter().for_each(|warning| super::tell(format_args!("warning: {warning}")));
        }
        for variant in &results.variants {
            variant.notes.iter().for_each(|note| super::tell(format_args!("{}: {note}", variant.name)));
        }
    }
    super::print(&if arguments.json { super::json(&results)? } else { table(&results) })?;
    interrupted_unless(results.complete, arguments)?;
    if arguments.strict { refuse(&results.warnings) } else { Ok(()) }
}

/// Says of what is not complete that it goes on.
fn interrupted_unless(complete: bool, arguments: &Arguments) -> Result<()> {
    if complete {
        return Ok(());
    }
    if !arguments.quiet {
        super::tell(format_args!("{}: as far as it came; the same command goes on", arguments.out.display()));
    }
    Err(Error::Interrupted)
}

/// Compares at many values of a key.
fn sweep(
    arguments: &Arguments,
    request: &Request,
    ends: &values::Ends,
    teller: &Teller,
    (pool, stop): (&rayon::ThreadPool, &AtomicBool),
) -> Result<()> {
    let range = Range::new(&ends.key, ends.values, arguments.points, ends.whole)
        .map_err(|expected| Error::Usage(format!("--sweep: {expected}")))?;
    let swept = pool.install(|| {
        let swept = compare::sweep::run(request, &range, &arguments.out, teller, stop)?;
        report::write_sweep(&swept, &arguments.out)?;
        Ok(swept)
    });
    teller.bar.finish();
    let swept: Sweep = swept?;
    super::print(&if arguments.json { super::json(&swept)? } else { sweep_table(&swept) })?;
    interrupted_unless(swept.complete, arguments)
}

/// By value and variant: the mean as a share of the reference's, the relative error, and CPU seconds; and the error of the reference's pixels.
fn sweep_table(swept: &Sweep) -> String {
    let mut text = format!("{:>12}", swept.range.key.rsplit('.').next().unwrap_or_default());
    // Writing to a string cannot fail.
    for variant in &swept.variants {
        let _ = write!(text, "  {:>30}", variant.name);
    }
    text.push_str("   reference\n");
    for (index, value) in swept.range.values.iter().enumerate() {
        let _ = write!(text, "{value:>12?}");
        for point in swept.variants.iter().filter_map(|variant| variant.points.get(index)) {
            let cell = point.found.as_ref().map_or("none".to_string(), |found| {
                let share = found.share().map_or("-".to_string(), |share| format!("{:.4}", share.value));
                let error = found.error().map_or("-".to_string(), |error| format!("{:.2} %", 100.0 * error.value));
                let cost = found.cpu_seconds.map_or("-".to_string(), |cost| format!("{:.2} s", cost.value));
                format!("{share} ({error}, {cost})")
            });
            let _ = write!(text, "  {cell:>30}");
        }
        let mut found = swept.variants.iter().filter_map(|variant| variant.points.get(index)?.found.as_ref());
        let error = found.find(|found| found.reference > 0.0).and_then(|found| found.reference_error);
        let _ = writeln!(text, "  {:>10}", error.map_or("-".to_string(), |error| format!("±{:.2} %", 100.0 * error)));
    }
    text + "mean / reference (relative error, CPU seconds)\n"
}

/// What the file asks for, with what the command line says instead.
fn request(arguments: &Arguments) -> Result<Request> {
    let mut request = Request::read(&arguments.scene)?;
    request.set.extend(arguments.set.iter().cloned());
    if !arguments.estimates.is_empty() {
        request.variants.clear();
        for list in &arguments.estimates {
            request.variants.extend(compare::parse_variants(list)?);
        }
    }
    let budgets = |kind, mut values: Vec<f64>| {
        values.sort_by(f64::total_cmp);
        values.dedup();
        Some(Budgets { kind, values })
    };
    if !arguments.budgets.is_empty() {
        let seconds = arguments.budgets.iter().map(Duration::as_secs_f64);
        request.budgets = budgets(BudgetKind::Seconds, seconds.collect());
    } else if !arguments.samples.is_empty() {
        request.budgets = budgets(BudgetKind::Samples, arguments.samples.iter().copied().map(f64::from).collect());
    } else if arguments.time.is_some() && request.budgets.as_ref().is_some_and(|b| b.kind == BudgetKind::Seconds) {
        // A time of the command line is not one of the file's budgets.
        request.budgets = None;
    }
    let seconds = |time: Option<Duration>| time.map(|time| time.as_secs_f64());
    request.time = seconds(arguments.time).or(request.time);
    request.reference_time = seconds(arguments.reference_time).unwrap_or(request.reference_time);
    request.reference_error = arguments.reference_error.unwrap_or(request.reference_error);
    request.seeds = arguments.seeds.unwrap_or(request.seeds);
    request.same_map |= arguments.same_map;
    if let Some(reference) = &arguments.reference {
        request.reference = StudyReference::of(reference, Path::new(""));
    }
    request.layer = arguments.layer.clone().or(request.layer);
    request.tune = arguments.tune.clone().or(request.tune);
    request.regions.extend(arguments.region.iter().cloned());
    Ok(request)
}

/// Tells how far a comparison is.
struct Teller {
    bar: Bar,
}

impl Progress for Teller {
    fn phase(&self, name: &'static str, _: u64) {
        // Runs end by time: how many steps that will be is not known.
        self.bar.phase(name, 0);
    }

    fn advance(&self, _: u64) {}

    fn refined(&self, film: &Film, stats: &Stats) {
        self.bar.refined(film, stats);
    }
}

impl Watch for Teller {
    fn begins(&self, what: &str) {
        self.bar.say(what);
    }
}

/// RMSE by variant and budget, and when it was reached.
fn table(results: &Results) -> String {
    let values = &results.study.budgets.values;
    let unit = match results.study.budgets.kind {
        BudgetKind::Seconds => " s",
        BudgetKind::Samples => " spp",
    };
    let width = results.variants.iter().map(|variant| variant.name.len()).max().unwrap_or(0).max(7);
    let mut text = format!("{:width$}", "RMSE");
    // Writing to a string cannot fail.
    for value in values {
        let _ = write!(text, "  {:>22}", format!("{value}{unit}"));
    }
    text.push('\n');
    for variant in &results.variants {
        let _ = write!(text, "{:width$}", variant.name);
        for measure in &variant.measures {
            let cell = measure.measured.as_ref().map_or("not reached".to_string(), |measured| {
                format!("{:.3e} ({:.3} s)", measured.regions[0].rmse.value, measured.seconds.value)
            });
            let _ = write!(text, "  {cell:>22}");
        }
        text.push('\n');
    }
    text
}
