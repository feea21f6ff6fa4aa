//! `volpm render`.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use clap::Args;
use serde::Serialize;

use super::progress::Bar;
use crate::image::{self, Attribute, Format, Picture, ToneMap, ToneSettings};
use crate::medium::density::Density;
use crate::render::{self, Rendering, Stats};
use crate::scene::description::{self, Description, Method};
use crate::scene::{self, Scene};
use crate::{Error, Result};

#[derive(Args)]
pub struct Arguments {
    /// The scene file (.toml).
    scene: PathBuf,
    /// Where to write the image, by ending: .exr, .png, .pfm or .hdr; repeatable. Default: <scene>.exr and
    /// <scene>.png in the current folder.
    #[arg(short, long, value_name = "FILE")]
    out: Vec<PathBuf>,
    /// Overrides a key of the scene file, by its dotted path; repeatable.
    #[arg(long, value_name = "KEY=VALUE")]
    set: Vec<String>,
    /// Camera samples per pixel (render.samples).
    #[arg(long, value_name = "N")]
    samples: Option<u64>,
    /// The seed of all random numbers (render.seed).
    #[arg(long, value_name = "N")]
    seed: Option<u64>,
    /// Threads to use; default: all cores.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    threads: Option<u16>,
    /// Writes what the render cost as JSON.
    #[arg(long, value_name = "FILE.json")]
    stats: Option<PathBuf>,
    /// No progress and no messages but errors.
    #[arg(short, long)]
    quiet: bool,
}

pub fn run(arguments: &Arguments) -> Result<()> {
    let start = Instant::now();
    // Everything that can be refused is, before anything is computed.
    let outputs = outputs(arguments)?;
    for output in &outputs {
        Format::of(output)?;
        image::check_target(output)?;
    }
    if let Some(path) = &arguments.stats {
        image::check_target(path)?;
    }
    let mut overrides = arguments.set.clone();
    overrides.extend(arguments.samples.map(|n| format!("render.samples={n}")));
    overrides.extend(arguments.seed.map(|n| format!("render.seed={n}")));

    let stop = Arc::new(AtomicBool::new(false));
    let flag = stop.clone();
    let on_signal = move || {
        // A second signal ends the program at once.
        if flag.swap(true, Ordering::Relaxed) {
            std::process::exit(130);
        }
    };
    ctrlc::set_handler(on_signal).map_err(|error| Error::Usage(format!("cannot listen for Ctrl-C: {error}")))?;

    let threads = arguments.threads.map_or(0, usize::from);
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(threads)
        .build()
        .map_err(|error| Error::Limit(format!("cannot start {threads} threads: {error}")))?;
    let bar = Bar::new(arguments.quiet);
    let (description, scene) = pool.install(|| -> Result<(Description, Scene)> {
        let description = scene::read(&arguments.scene, &overrides)?;
        let scene = scene::build(&description)?;
        Ok((description, scene))
    })?;
    let load = start.elapsed().as_secs_f64();
    if !arguments.quiet {
        describe(&scene);
    }
    let rendering = pool.install(|| render::render(&scene, &bar, &stop));
    bar.finish();
    let rendering = rendering?;
    let total = start.elapsed().as_secs_f64();
    if !arguments.quiet {
        for warning in &rendering.warnings {
            eprintln!("warning: {warning}");
        }
    }

    let report = Report::new(&description, &scene, &rendering, pool.current_num_threads(), load, total);
    let picture = picture(&description, &rendering, total);
    let film = &description.film;
    let tone = ToneSettings {
        exposure: film.exposure,
        curve: match film.tone_map {
            description::ToneMap::Linear => ToneMap::Linear,
            description::ToneMap::Filmic => ToneMap::Filmic,
        },
    };
    // What cannot be written must not cost what can.
    let mut written: Vec<Result<()>> = Vec::new();
    // An image without a sample would only replace a better one.
    let seen = rendering.film.has_samples();
    if seen {
        written.extend(outputs.iter().map(|output| image::write(output, &picture, &tone)));
    }
    if let Some(path) = &arguments.stats {
        let text = super::json(&report)?;
        written.push(image::write_aside(path, |file| std::io::Write::write_all(file, text.as_bytes())));
    }
    let mut failures = written.into_iter().filter_map(Result::err);
    if let Some(first) = failures.next() {
        failures.for_each(|error| eprintln!("error: {error}"));
        return Err(first);
    }
    if rendering.interrupted {
        if !arguments.quiet {
            let names: Vec<String> = outputs.iter().map(|path| path.display().to_string()).collect();
            let done = if seen { "as far as it came" } else { "not written: there is no sample yet" };
            eprintln!("{}: {done}", names.join(", "));
        }
        return Err(Error::Interrupted);
    }
    if !arguments.quiet {
        summarise(&report, &rendering.stats, &outputs);
    }
    Ok(())
}

fn outputs(arguments: &Arguments) -> Result<Vec<PathBuf>> {
    if !arguments.out.is_empty() {
        return Ok(arguments.out.clone());
    }
    let stem = arguments
        .scene
        .file_stem()
        .ok_or_else(|| Error::Usage(format!("{}: not the name of a scene file", arguments.scene.display())))?;
    let with = |ending: &str| {
        let mut name = stem.to_os_string();
        name.push(ending);
        PathBuf::from(name)
    };
    Ok(vec![with(".exr"), with(".png")])
}

/// Each medium's bounds, range of extinction and optical depth; then warnings.
fn describe(scene: &Scene) {
    for medium in &scene.media {
        let extinction = medium.extinction * medium.density.max();
        let support = medium.density.support();
        let sigma = format!("{:.4}, {:.4}, {:.4}", extinction.x, extinction.y, extinction.z);
        if support.is_empty() || extinction.max_element() <= 0.0 {
            eprintln!("medium {}: clear", medium.name);
        } else if support.size().is_finite() {
            let (min, max) = (support.min + scene.center, support.max + scene.center);
            let across = support.size().max_element();
            let ray = crate::math::Ray::new(support.center() - across * crate::math::DVec3::Y, crate::math::DVec3::Y);
            let depth = medium.density.depth(&ray, 0.0, 2.0 * across) * medium.extinction.max_element();
            eprintln!(
                "medium {}: from ({:.3}, {:.3}, {:.3}) to ({:.3}, {:.3}, {:.3}), extinction up to ({sigma}), optical depth {depth:.3} upwards through its middle",
                medium.name, min.x, min.y, min.z, max.x, max.y, max.z
            );
        } else {
            let kind =
                if matches!(medium.density, Density::Uniform) { "the same everywhere" } else { "without an end" };
            eprintln!("medium {}: {kind}, extinction up to ({sigma})", medium.name);
        }
    }
    for warning in &scene.warnings {
        eprintln!("warning: {warning}");
    }
}

fn picture(description: &Description, rendering: &Rendering, total: f64) -> Picture {
    let text = |text: &str| Attribute::Text(text.to_string());
    Picture {
        image: rendering.film.image(),
        layers: rendering.film.layers(),
        attributes: vec![
            ("scene".to_string(), text(&description.path.display().to_string())),
            ("renderer".to_string(), text(concat!("volpm ", env!("CARGO_PKG_VERSION")))),
            ("method".to_string(), text(method_name(description.render.method))),
            ("seed".to_string(), text(&description.render.seed.to_string())),
            ("samples".to_string(), Attribute::Number(rendering.stats.samples as f64)),
            ("passes".to_string(), Attribute::Number(rendering.stats.passes as f64)),
            ("seconds".to_string(), Attribute::Number(total)),
        ],
    }
}

fn method_name(method: Method) -> &'static str {
    match method {
        Method::Photon => "photon",
        Method::Path => "path",
    }
}

/// What `--stats` writes.
#[derive(Serialize)]
struct Report {
    scene: String,
    method: &'static str,
    seed: u64,
    threads: usize,
    seconds: Seconds,
    photons: Photons,
    gather: Gather,
    bytes: Bytes,
    passes: u32,
    samples: u32,
    interrupted: bool,
    warnings: Vec<String>,
}

#[derive(Serialize)]
struct Seconds {
    load: f64,
    photons: f64,
    build: f64,
    render: f64,
    total: f64,
}

#[derive(Serialize)]
struct Photons {
    emitted: u64,
    volume: u64,
    global: u64,
    caustic: u64,
    /// Radii of the discs.
    radius: [f32; 3],
}

#[derive(Serialize)]
struct Gather {
    queries: u64,
    tested: u64,
    gathered: u64,
}

#[derive(Serialize)]
struct Bytes {
    peak: Option<u64>,
    volume_map: u64,
    surface_maps: u64,
    density: u64,
}

impl Report {
    fn new(
        description: &Description,
        scene: &Scene,
        rendering: &Rendering,
        threads: usize,
        load: f64,
        total: f64,
    ) -> Self {
        let stats = &rendering.stats;
        let mut seen = Vec::new();
        let mut density = 0;
        for medium in &scene.media {
            if let Density::Grid(grid) = &medium.density {
                let voxels = Arc::as_ptr(grid.voxels());
                if !seen.contains(&voxels) {
                    seen.push(voxels);
                    density += grid.voxels().bytes() as u64;
                }
            }
        }
        Report {
            scene: description.path.display().to_string(),
            method: method_name(description.render.method),
            seed: description.render.seed,
            threads,
            seconds: Seconds {
                load,
                photons: stats.photons_seconds,
                build: stats.build_seconds,
                render: stats.render_seconds,
                total,
            },
            photons: Photons {
                emitted: stats.emitted,
                volume: stats.volume,
                global: 0,
                caustic: 0,
                radius: [stats.radii.min, stats.radii.mean, stats.radii.max],
            },
            gather: Gather {
                queries: stats.gather.queries,
                tested: stats.gather.blocks * 16,
                gathered: stats.gather.photons,
            },
            bytes: Bytes { peak: peak_bytes(), volume_map: stats.map_bytes, surface_maps: 0, density },
            passes: stats.passes,
            samples: stats.samples,
            interrupted: rendering.interrupted,
            warnings: scene.warnings.iter().chain(&rendering.warnings).cloned().collect(),
        }
    }
}

/// The most memory the process has held, where the system tells.
fn peak_bytes() -> Option<u64> {
    let status = std::fs::read_to_string(Path::new("/proc/self/status")).ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"))?;
    line.trim().strip_suffix("kB")?.trim().parse::<u64>().ok().map(|kib| kib * 1024)
}

fn summarise(report: &Report, stats: &Stats, outputs: &[PathBuf]) {
    let seconds = &report.seconds;
    let mut parts = vec![format!("{:.1} s", seconds.total)];
    if stats.volume > 0 {
        parts.push(format!("photons {:.1} s ({} of {} emitted)", seconds.photons, stats.volume, stats.emitted));
        parts.push(format!("map {:.1} s ({:.0} MB)", seconds.build, stats.map_bytes as f64 * 1e-6));
    }
    parts.push(format!("pixels {:.1} s", seconds.render));
    let names: Vec<String> = outputs.iter().map(|path| path.display().to_string()).collect();
    eprintln!("{}: {}", names.join(", "), parts.join(", "));
}
