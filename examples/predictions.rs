//! Makes the table of `docs/plan.md` of what plans tell of memory and time, and what renders take: of each scene of the repository, smaller and with fewer photons
//! than it asks for.
//!
//! ```sh
//! cargo run --release --example predictions                                 # all
//! cargo run --release --example predictions -- 320 scenes/ball.toml ...     # these, so many pixels wide
//! ```
//!
//! Costs of this machine are measured first. Each plan and each render is a process of its own, on one thread.

mod measure;

use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;

use measure::{Outcome, numbers, one_thread};
use volpm::compare::{cpu_seconds, peak_bytes, resident_bytes};
use volpm::render::{
    Camera, Choice, Costs, Forecast, Limits, Plan, Silent, caustic_photons, choose, global_photons, refine_planned,
    volume_photons,
};
use volpm::scene::{self, Scene, Settings};

/// Pixels across, unless others are asked for; scenes that are narrower stay as they are.
const WIDTH: u32 = 96;
/// Camera samples a pixel, at most.
const SAMPLES: u32 = 8;
/// Photons in media, and of each map on surfaces, at most.
const PHOTONS: [u64; 2] = [200_000, 100_000];
/// Shorter times are not compared: the system counts hundredths of a second.
const SHORTEST: f64 = 0.1;

fn main() -> Outcome<()> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let words: Vec<&str> = arguments.iter().map(String::as_str).collect();
    match words[..] {
        ["plan", scene, width, costs] => plan(scene.as_ref(), width.parse()?, &serde_json::from_str(costs)?),
        ["render", scene, width] => render(scene.as_ref(), width.parse()?),
        [] => table(&scenes("scenes".as_ref())?, WIDTH),
        [width, ref scenes @ ..] => table(&scenes.iter().map(PathBuf::from).collect::<Vec<_>>(), width.parse()?),
    }
}

/// All scenes below a folder, by name.
fn scenes(folder: &Path) -> Outcome<Vec<PathBuf>> {
    let mut found = Vec::new();
    for entry in std::fs::read_dir(folder)? {
        let path = entry?.path();
        if path.is_dir() && !path.ends_with("studies") {
            found.extend(scenes(&path)?);
        } else if path.extension().is_some_and(|extension| extension == "toml") {
            found.push(path);
        }
    }
    found.sort();
    Ok(found)
}

fn table(scenes: &[PathBuf], width: u32) -> Outcome<()> {
    let costs = one_thread()?.install(|| Costs::measure(cpu_seconds))?;
    let costs = serde_json::to_string(&costs)?;
    println!("| scene | peak, MB | told | | s | told | |");
    println!("|---|--:|--:|--:|--:|--:|--:|");
    let mut ratios: [Vec<f64>; 2] = Default::default();
    for scene in scenes {
        let name = scene.to_str().ok_or("a scene's name is no text")?;
        // Some scenes of `stress` are refused.
        let told = match numbers(&["plan", name, &width.to_string(), &costs]) {
            Ok(told) => told,
            Err(error) => {
                eprintln!("{name}: {error}");
                continue;
            }
        };
        let took = numbers(&["render", name, &width.to_string()])?;
        let [bytes, seconds] = [told[0] / took[0], told[1] / took[1]];
        let tells = took[1] >= SHORTEST;
        println!(
            "| `{}` | {:.1} | {:.1} | {:+.0} % | {:.2} | {:.2} | {} |",
            scene.strip_prefix("scenes").unwrap_or(scene).with_extension("").display(),
            1e-6 * took[0],
            1e-6 * told[0],
            100.0 * (bytes - 1.0),
            took[1],
            told[1],
            if tells { format!("{seconds:.2} ×") } else { String::new() },
        );
        ratios[0].push(bytes);
        ratios[1].extend(Some(seconds).filter(|_| tells));
    }
    for (what, ratios) in ["memory", "time"].iter().zip(&mut ratios) {
        ratios.sort_by(f64::total_cmp);
        let [least, most] = [ratios.first(), ratios.last()].map(|ratio| ratio.copied().unwrap_or(1.0));
        println!("\n{what}: told is {least:.2} to {most:.2} times what it took");
    }
    Ok(())
}

/// A scene, as large as it is measured.
fn load(path: &Path, width: u32) -> volpm::Result<(Scene, Settings, Option<Choice>)> {
    let mut description = scene::read(path, &[])?;
    let film = &mut description.film;
    if film.width > width {
        (film.width, film.height) = (width, (width * film.height).div_ceil(film.width));
    }
    description.render.samples = description.render.samples.min(SAMPLES);
    description.render.passes = 1;
    let (scene, mut settings) = scene::build(&description)?;
    let choice = choose(&scene, &settings)?;
    if let Some(Choice { method, .. }) = choice {
        settings.render.method = method;
    }
    let fewer = |wanted: u64, most: u64, of: &mut Option<u64>| {
        if wanted > most {
            *of = Some(most);
        }
    };
    let wanted =
        [volume_photons(&scene, &settings), caustic_photons(&scene, &settings), global_photons(&scene, &settings)];
    fewer(wanted[0], PHOTONS[0], &mut settings.photons.volume);
    fewer(wanted[1], PHOTONS[1], &mut settings.photons.caustic);
    fewer(wanted[2], PHOTONS[1], &mut settings.photons.global);
    Ok((scene, settings, choice))
}

/// Prints the most memory, and the seconds, that a plan tells.
fn plan(path: &Path, width: u32, costs: &Costs) -> Outcome<()> {
    let forecast = one_thread()?.install(|| -> volpm::Result<_> {
        let (scene, settings, choice) = load(path, width)?;
        let memory = resident_bytes().zip(peak_bytes());
        let mut forecast = Forecast::timed(&scene, &settings, &Limits::default(), choice.as_ref(), &cpu_seconds)?;
        if let Some(memory) = memory {
            forecast.bytes.foretell(memory, 1);
        }
        forecast.price(costs, true);
        Ok(forecast)
    })?;
    println!("{} {}", forecast.bytes.peak.unwrap_or(0), forecast.seconds.unwrap_or(0.0));
    Ok(())
}

/// Prints the most memory, and the processor's seconds after loading and planning, that a render takes.
fn render(path: &Path, width: u32) -> Outcome<()> {
    let stop = AtomicBool::new(false);
    let seconds = one_thread()?.install(|| -> volpm::Result<_> {
        let (scene, settings, _) = load(path, width)?;
        let limits = Limits::default();
        let plan = Plan::new(&scene, &settings, &Camera::new(&scene.camera, &settings.film), &limits)?;
        let start = cpu_seconds().unwrap_or(0.0);
        refine_planned(&scene, &settings, plan, &limits, None, &Silent, &stop)?;
        Ok(cpu_seconds().unwrap_or(0.0) - start)
    })?;
    println!("{} {seconds}", peak_bytes().unwrap_or(0));
    Ok(())
}
