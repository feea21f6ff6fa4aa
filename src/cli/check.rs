//! `volpm check`.

use std::fmt::Write as _;
use std::path::PathBuf;
use std::time::Duration;

use clap::Args;

use super::planned::refuse;
use super::progress::Bar;
use super::values;
use crate::check::{self, Outcome, Report, Request};
use crate::render::{Film, Progress, Stats};
use crate::{Error, Result};

#[derive(Args)]
#[command(
    after_help = "Exit status: 0 if no row failed, 3 if one did, 2 for bad input, 130 if interrupted. docs/check.md tells what each row tests."
)]
pub struct Arguments {
    /// The scene file (.toml).
    scene: PathBuf,
    /// Overrides a key of the scene file, by its dotted path; repeatable.
    #[arg(long, value_name = "KEY=VALUE")]
    set: Vec<String>,
    /// The seed of all random numbers (render.seed).
    #[arg(long, value_name = "N")]
    seed: Option<u64>,
    /// About how long one thread would take for the check: more tells finer differences.
    #[arg(long, value_name = "TIME", value_parser = values::time, default_value = "60s")]
    time: Duration,
    /// So many pictures of photon maps, and eight times as many by paths and by light paths, however long they take: the same
    /// figures on every machine.
    #[arg(long, value_name = "N", conflicts_with = "time", value_parser = clap::value_parser!(u32).range(4..=1000))]
    seeds: Option<u32>,
    /// Threads to use; default: all cores.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    threads: Option<u16>,
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
    let mut set = arguments.set.clone();
    set.extend(arguments.seed.map(|seed| format!("render.seed={seed}")));
    let request =
        Request { scene: arguments.scene.clone(), set, seconds: arguments.time.as_secs_f64(), seeds: arguments.seeds };
    let stop = super::stop_on_signal()?;
    let pool = super::pool(arguments.threads)?;
    let teller = Teller { bar: Bar::new(arguments.quiet) };
    let report = pool.install(|| check::run(&request, &teller, &stop));
    teller.bar.finish();
    let report = report?;
    if !arguments.quiet && !arguments.strict {
        report.warnings.iter().for_each(|warning| super::tell(format_args!("warning: {warning}")));
    }
    super::print(&if arguments.json { super::json(&report)? } else { table(&report) })?;
    match report.count(Outcome::Fail) {
        _ if !report.complete => Err(Error::Interrupted),
        _ if arguments.strict && !report.warnings.is_empty() => refuse(&report.warnings),
        0 => Ok(()),
        1 => Err(Error::Doubt("one row failed".to_string())),
        rows => Err(Error::Doubt(format!("{rows} rows failed"))),
    }
}

/// Tells how far a check is.
struct Teller {
    bar: Bar,
}

impl Progress for Teller {
    fn phase(&self, name: &'static str, _: u64) {
        // Pictures are many and small: how many steps there will be is not known.
        self.bar.phase(name, 0);
    }

    fn advance(&self, _: u64) {}

    fn refined(&self, _: &Film, _: &Stats) {}
}

/// A line for each row, and one for the command that shows more.
fn table(report: &Report) -> String {
    let width = report.rows.iter().map(|row| row.test.chars().count()).max().unwrap_or(0);
    let mut text = String::new();
    // Writing to a string cannot fail.
    for row in &report.rows {
        let outcome = match row.outcome {
            Outcome::Pass => "pass",
            Outcome::Fail => "FAIL",
            Outcome::NotApplicable => "n/a",
        };
        let _ = writeln!(text, "{outcome:<4}  {:width$}  {}", row.test, row.found);
        if let Some(command) = &row.command {
            let _ = writeln!(text, "{:4}  {:width$}  {command}", "", "");
        }
    }
    let _ = writeln!(
        text,
        "{} passed, {} failed, {} not applicable, in {:.1} s ({:.1} s of threads)",
        report.count(Outcome::Pass),
        report.count(Outcome::Fail),
        report.count(Outcome::NotApplicable),
        report.seconds,
        report.thread_seconds
    );
    text
}
