//! `volpm plan`.

use std::fmt::Write as _;

use clap::Args;

use super::costs;
use super::force::Force;
use super::planned::{Loaded, Planned};
use crate::compare::{cpu_seconds, peak_bytes, resident_bytes};
use crate::render::{Costs, Forecast, Item, Limits};
use crate::{Error, Result};

#[derive(Args)]
#[command(
    after_help = "Nothing is rendered: a part of the photons is traced to tell what all of them come to. docs/plan.md tells what each line is.",
    mut_arg("scene", |scene| scene.required(false))
)]
pub struct Arguments {
    #[command(flatten)]
    planned: Option<Planned>,
    #[command(flatten)]
    force: Force,
    /// Prints the plan as JSON instead of a table.
    #[arg(long)]
    json: bool,
    /// Measures first what things cost on this machine: some seconds, best with nothing else running. Kept in volpm/costs.json in the folder for configuration
    /// ($XDG_CONFIG_HOME, or ~/.config), or where $VOLPM_COSTS says. From then on, plans tell seconds.
    #[arg(long)]
    calibrate: bool,
}

pub fn run(arguments: &Arguments) -> Result<()> {
    if arguments.calibrate {
        let path = costs::place()?;
        // On one thread, as they are told.
        let measured = super::pool(Some(1))?.install(|| Costs::measure(cpu_seconds))?;
        costs::write(&measured, &path)?;
        super::tell(format_args!("{}: costs of this machine", path.display()));
    }
    let Some(planned) = &arguments.planned else {
        let asked = "what scene? Name a .toml file, or say --calibrate".to_string();
        return if arguments.calibrate { Ok(()) } else { Err(Error::Usage(asked)) };
    };
    let measured = costs::read()?;
    let pool = super::pool(planned.threads)?;
    let loaded = pool.install(|| planned.load())?;
    let memory = resident_bytes().zip(peak_bytes());
    let limits = Limits { memory: planned.memory, forced: arguments.force.forced.clone(), ..Limits::default() };
    let Loaded { scene, settings, choice, .. } = &loaded;
    let mut forecast = match &measured {
        None => pool.install(|| Forecast::new(scene, settings, &limits, choice.as_ref()))?,
        // On one thread, as its seconds are told.
        Some(measured) => {
            let timed = || Forecast::timed(scene, settings, &limits, choice.as_ref(), &cpu_seconds);
            let mut forecast = super::pool(Some(1))?.install(timed)?;
            forecast.price(measured, true);
            forecast
        }
    };
    if let Some(memory) = memory {
        forecast.bytes.foretell(memory, pool.current_num_threads());
    }
    for warning in &loaded.scene.warnings {
        super::tell(format_args!("warning: {warning}"));
    }
    super::print(&if arguments.json { super::json(&forecast)? } else { table(&loaded, &forecast) })
}

/// A line for each item, those that the scene needs first.
fn table(loaded: &Loaded, forecast: &Forecast) -> String {
    let Forecast { method, why, seed, film: [width, height], samples, passes, parts, items, bytes, seconds } = forecast;
    let mut text = String::new();
    // Writing to a string cannot fail.
    let _ = writeln!(text, "{}: method {method}, {why}", loaded.description.path.display());
    let passes = match passes {
        None => "passes until the end".to_string(),
        Some(1) => "1 pass".to_string(),
        Some(passes) => format!("{passes} passes"),
    };
    let parts = if *parts > 1 { format!(" in {parts} parts each") } else { String::new() };
    let _ = writeln!(text, "{width} × {height} pixels, {samples} samples a pixel, {passes}{parts}, seed {seed}");
    let name = items.iter().map(|item| item.name.len()).max().unwrap_or(0);
    let facts: Vec<String> = items.iter().map(facts).collect();
    let wide = facts.iter().map(|facts| facts.chars().count()).max().unwrap_or(0);
    for (what, needed, forced) in [
        ("what it gets", true, false),
        ("what is forced, and why it is not needed", false, true),
        ("what it does without", false, false),
    ] {
        let all = items.iter().zip(&facts).filter(|(item, _)| (item.needed, item.forced) == (needed, forced));
        for (number, (item, facts)) in all.enumerate() {
            if number == 0 {
                let _ = writeln!(text, "\n{what}");
            }
            let line = match needed || forced {
                true => format!("  {:name$}  {facts:wide$}  {}", item.name, item.why),
                false => format!("  {:name$}  {}", item.name, item.why),
            };
            let _ = writeln!(text, "{}", line.trim_end());
        }
    }
    let sizes = [
        ("film", bytes.film),
        ("maps in media", bytes.volume_map),
        ("maps on surfaces", bytes.surface_maps),
        ("voxels", bytes.density),
    ];
    let sizes: Vec<String> = sizes.iter().map(|(what, bytes)| format!("{what} {}", megabytes(*bytes))).collect();
    let peak = bytes.peak.map_or_else(String::new, |peak| format!("; {} at most, with the program", megabytes(peak)));
    let _ = writeln!(text, "\nmemory: {}{peak}", sizes.join(", "));
    if let Some(seconds) = seconds {
        let _ = writeln!(text, "time: {seconds:.1} s of one thread");
    }
    text
}

/// The numbers of an item.
fn facts(item: &Item) -> String {
    let mut facts: Vec<String> = Vec::new();
    facts.extend(item.count.map(|count| count.to_string()));
    facts.extend(item.emitted.map(|emitted| format!("of {emitted} emitted")));
    facts.extend(item.events.map(|events| format!("{events} events")));
    facts.extend(item.bytes.map(megabytes));
    facts.extend(item.share.map(|share| format!("{:.0} % of the time", 100.0 * share)));
    facts.extend(item.seconds.map(|seconds| format!("{seconds:.2} s")));
    facts.join(", ")
}

fn megabytes(bytes: u64) -> String {
    format!("{:.1} MB", bytes as f64 * 1e-6)
}
