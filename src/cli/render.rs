//! `volpm render`.

use std::ops::RangeInclusive;
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;
use std::time::{Duration, Instant};

use clap::Args;
use serde::Serialize;

use super::force::Force;
use super::picture::{Facts, default_endings, picture, tone};
use super::planned::{Loaded, Planned, warned};
use super::progress::Bar;
#[cfg(feature = "tev")]
use super::tev::Viewer;
use super::watch::{Kept, Watch};
use super::{frames, values};
use crate::check::Names;
use crate::compare::peak_bytes;
use crate::image::{self, Format};
use crate::medium;
use crate::render::checkpoint::Subject;
use crate::render::{self, Camera, Checkpoint, End, Film, Forecast, Limits, Plan, Rendering, Stats};
use crate::scene::Scene;
use crate::scene::description::Description;
use crate::{Error, Result};

#[derive(Args, Clone)]
pub struct Arguments {
    #[command(flatten)]
    planned: Planned,
    #[command(flatten)]
    force: Force,
    /// Where to write the image, by ending: .exr, .png, .pfm or .hdr; repeatable. Default: <scene>.exr and
    /// <scene>.png in the current folder.
    #[arg(short, long, value_name = "FILE")]
    out: Vec<PathBuf>,
    /// Makes only these passes of a longer render, counted from 1, both ends included: 9..16.
    #[arg(long, value_name = "A..B", value_parser = values::passes, conflicts_with = "passes")]
    pass_range: Option<RangeInclusive<u32>>,
    /// Refines until this time is up, counted after loading: 90s, 1.5m, 2h. Unless --passes says otherwise, with
    /// as many passes as fit.
    #[arg(long, value_name = "TIME", value_parser = values::time)]
    time: Option<Duration>,
    /// Refines until the standard error over passes is so small a share of the image: 2%.
    #[arg(long, value_name = "SHARE", value_parser = values::share)]
    target_error: Option<f64>,
    /// Keeps finished passes in this file, for --resume and `volpm merge`: now and then, on Ctrl-C, and in the end.
    #[arg(long, value_name = "FILE", group = "kept", conflicts_with = "force")]
    checkpoint: Option<PathBuf>,
    /// Makes those passes that this checkpoint does not hold yet, and no image: for tasks that may be stopped or run twice.
    #[arg(long, value_name = "FILE", group = "kept", conflicts_with_all = ["out", "resume", "time", "target_error", "force"])]
    fill: Option<PathBuf>,
    /// How long it takes until --checkpoint or --fill is written again: 90s, 10m. Writing never takes more than a twentieth of the time.
    #[arg(long, value_name = "TIME", default_value = "30s", value_parser = values::time, requires = "kept")]
    checkpoint_every: Duration,
    /// Goes on from a checkpoint of the same scene: passes that it holds are not repeated.
    #[arg(long, value_name = "FILE", conflicts_with = "force")]
    resume: Option<PathBuf>,
    /// Renders frame after frame, both ends included: 1..240. In the names of files that the scene names, and of those that are
    /// written, #### stands for the number: smoke_####.vdb is smoke_0012.vdb.
    #[arg(long, value_name = "A..B", value_parser = values::frames, conflicts_with = "replay")]
    frames: Option<RangeInclusive<u32>>,
    /// Rewrites this picture as the image is refined.
    #[arg(long, value_name = "FILE.png", value_parser = values::png)]
    preview: Option<PathBuf>,
    /// Shows the image in the viewer tev as it is refined.
    #[cfg(feature = "tev")]
    #[arg(long, value_name = "HOST:PORT", value_parser = values::address)]
    tev: Option<String>,
    /// Tells of one camera path instead, event by event, as the film would draw it: column, row, and the number of the sample
    /// in the pixel, all from 0. By method "path" alone.
    #[arg(long, value_name = "X,Y,SAMPLE", value_parser = values::replay)]
    replay: Option<((u32, u32), u64)>,
    /// Writes what the render cost as JSON.
    #[arg(long, value_name = "FILE.json")]
    stats: Option<PathBuf>,
    /// No progress and no messages but errors.
    #[arg(short, long)]
    quiet: bool,
}

impl Arguments {
    /// All files that a render writes or goes on from, but for the preview, which frames share.
    fn files_mut(&mut self) -> impl Iterator<Item = &mut PathBuf> {
        let options = [&mut self.checkpoint, &mut self.fill, &mut self.resume, &mut self.stats];
        self.out.iter_mut().chain(options.into_iter().flatten())
    }
}

pub fn run(arguments: &Arguments) -> Result<()> {
    let stop = super::stop_on_signal()?;
    let Some(range) = &arguments.frames else { return render_one(arguments, &stop) };

    // Frame after frame: what can be refused of any is refused before the first.
    let mut all = Arguments { out: outputs(arguments)?, ..arguments.clone() };
    let scene = (&*arguments.planned.scene, &*arguments.planned.overrides());
    frames::check(range, scene, all.files_mut().map(|file| &*file))?;
    for frame in range.clone() {
        let mut one = all.clone();
        one.files_mut().for_each(|file| *file = frames::numbered(file, frame));
        one.planned.frame = Some(frame);
        if !arguments.quiet {
            super::tell(format_args!("frame {frame} of {} to {}", range.start(), range.end()));
        }
        render_one(&one, &stop)?;
    }
    Ok(())
}

/// Renders a scene, or a frame of it.
fn render_one(arguments: &Arguments, stop: &AtomicBool) -> Result<()> {
    let start = Instant::now();
    // Everything that can be refused is, before anything is computed.
    let outputs = outputs(arguments)?;
    for output in &outputs {
        Format::of(output)?;
        image::check_target(output)?;
    }
    let kept = arguments.checkpoint.as_ref().or(arguments.fill.as_ref());
    for path in [arguments.stats.as_ref(), kept, arguments.preview.as_ref()].into_iter().flatten() {
        image::check_target(path)?;
    }
    let resumed = arguments.resume.as_ref().or(arguments.fill.as_ref().filter(|path| path.exists()));
    let before = resumed.map(|path| Ok((path, Checkpoint::read(path)?))).transpose()?;
    let pool = super::pool(arguments.planned.threads)?;
    let Loaded { description, scene, settings, choice } = pool.install(|| arguments.planned.load())?;
    if let Some((pixel, sample)) = arguments.replay {
        let replayed = render::Replayer::new(&scene, &settings)?.replay(pixel, sample)?;
        return super::print(&Names::new(&description, &scene).story(&replayed));
    }
    let load = start.elapsed().as_secs_f64();
    if !arguments.quiet {
        describe(&scene);
    }
    let limits = limits(arguments);
    let mut watch = Watch::new(Bar::new(arguments.quiet), tone(&description.film));
    if let Some(path) = &arguments.preview {
        watch.preview(path.clone());
    }
    let mut start_from = None;
    if before.is_some() || kept.is_some() {
        let subject =
            Subject::new(&description, limits.parts(&scene, &settings, render::volume_photons(&scene, &settings))?);
        if let Some((path, before)) = before {
            let (film, stats) = continued(path, before, &subject, settings.render.seed)?;
            if let Some(last) = arguments.planned.passes
                && let Some(beyond) = film.done().beyond(settings.render.seed, last.saturating_mul(subject.parts))
            {
                return Err(Error::Usage(format!(
                    "--passes {last}: {} holds passes up to {}, which are not taken out: ask for as many at least, or leave out --resume",
                    path.display(),
                    beyond.div_ceil(subject.parts)
                )));
            }
            let passes = limits.counted(&settings, subject.parts);
            if arguments.fill.is_some() && film.done().missing(settings.render.seed, passes).next().is_none() {
                if !arguments.quiet {
                    super::tell(format_args!("{}: holds all these passes already", path.display()));
                }
                return Ok(());
            }
            start_from = Some((film, stats));
        }
        if let Some(path) = kept {
            if resumed != Some(path) {
                check_replaceable(path, &subject)?;
            }
            let kept = Kept { path: path.clone(), subject, shared: arguments.fill.is_some() };
            watch.checkpoint(kept, arguments.checkpoint_every);
        }
    }
    #[cfg(feature = "tev")]
    if let Some(address) = &arguments.tev {
        let name = description.path.display().to_string();
        watch.viewer(Viewer::new(address, &name, settings.film.size())?);
    }
    let rendering = pool.install(|| {
        let plan = Plan::new(&scene, &settings, &Camera::new(&scene.camera, &settings.film), &limits)?;
        if !arguments.quiet {
            super::tell(Forecast::of(&scene, &settings, &limits, &plan, choice.as_ref()).line());
        }
        render::refine_planned(&scene, &settings, plan, &limits, start_from, &watch, stop)
    })?;
    let finished = watch.finish(&rendering.film, &rendering.stats);
    let total = start.elapsed().as_secs_f64();
    let strict = arguments.planned.strict;
    if !arguments.quiet && !strict {
        for warning in &rendering.warnings {
            super::tell(format_args!("warning: {warning}"));
        }
    }

    let report = Report::new(&description, &scene, &rendering, pool.current_num_threads(), load, total);
    let tone = tone(&description.film);
    // What cannot be written must not cost what can.
    let mut written: Vec<Result<()>> = finished;
    // An image without a sample would only replace a better one.
    let seen = rendering.film.has_samples();
    if seen {
        let picture = picture(&rendering.film, &rendering.stats, &facts(&description, &rendering.film));
        written.extend(outputs.iter().map(|output| image::write(output, &picture, &tone)));
    }
    if let Some(path) = &arguments.stats {
        let text = super::json(&report)?;
        written.push(image::write_aside(path, |file| std::io::Write::write_all(file, text.as_bytes())));
    }
    let mut failures = written.into_iter().filter_map(Result::err);
    if let Some(first) = failures.next() {
        failures.for_each(|error| super::tell(format_args!("error: {error}")));
        return Err(first);
    }
    if let Some(path) = arguments.checkpoint.as_ref().filter(|_| !arguments.quiet) {
        match rendering.film.done().count() {
            0 => super::tell(format_args!("{}: not written: no pass is finished", path.display())),
            passes => super::tell(format_args!("{}: {passes} passes, to go on from with --resume", path.display())),
        }
    }
    if rendering.end == End::Interrupted {
        if !arguments.quiet && !outputs.is_empty() {
            let names: Vec<String> = outputs.iter().map(|path| path.display().to_string()).collect();
            let done = if seen { "as far as it came" } else { "not written: there is no sample yet" };
            super::tell(format_args!("{}: {done}", names.join(", ")));
        }
        return Err(Error::Interrupted);
    }
    if !seen {
        let names: Vec<String> = outputs.iter().map(|path| path.display().to_string()).collect();
        return Err(Error::Limit(format!(
            "the time was up before there was any sample: {} not written; allow more --time",
            names.join(", ")
        )));
    }
    if !arguments.quiet {
        summarise(&report, &rendering.stats, arguments.fill.as_ref().map_or(&outputs, std::slice::from_ref));
    }
    if strict && !rendering.warnings.is_empty() {
        return Err(Error::Failed(warned(&rendering.warnings)));
    }
    Ok(())
}

fn limits(arguments: &Arguments) -> Limits {
    // Where time or error end the render, passes do so only if the command line says so.
    let ends_by_itself = arguments.time.is_some() || arguments.target_error.is_some();
    let passes = arguments.planned.passes.filter(|_| ends_by_itself).map(|last| 1..=last);
    Limits {
        passes: arguments.pass_range.clone().or(passes),
        time: arguments.time,
        target_error: arguments.target_error,
        memory: arguments.planned.memory,
        resumable: arguments.checkpoint.is_some() || arguments.fill.is_some(),
        shown: None,
        forced: arguments.force.forced.clone(),
    }
}

/// Checks that a checkpoint at `path` would replace nothing but one of the same scene.
fn check_replaceable(path: &Path, subject: &Subject) -> Result<()> {
    if !path.exists() {
        return Ok(());
    }
    let difference = match Checkpoint::read(path) {
        Ok(before) => {
            before.subject.difference(subject).map(|how| format!("is of another scene or other settings: {how}"))
        }
        Err(Error::Asset { message, .. }) => Some(format!("cannot be used: {message}")),
        Err(error) => return Err(error),
    };
    match difference {
        Some(what) => {
            Err(Error::output(path, format!("the checkpoint there {what}; name another file, or remove this one")))
        }
        None => Ok(()),
    }
}

/// What a checkpoint holds, if it can be continued.
fn continued(path: &Path, before: Checkpoint, subject: &Subject, seed: u64) -> Result<(Film, Stats)> {
    if let Some(difference) = before.subject.difference(subject) {
        return Err(Error::asset(
            path,
            format!("this checkpoint is of another scene or other settings (it, then now): {difference}"),
        ));
    }
    let seeds: Vec<u64> = before.film.done().seeds().collect();
    if !seeds.contains(&seed) {
        let seeds: Vec<String> = seeds.iter().map(u64::to_string).collect();
        return Err(Error::asset(
            path,
            format!(
                "this checkpoint holds passes of seed {}, not of seed {seed}: give --seed, or render the new seed by itself and join both with `volpm merge`",
                seeds.join(", ")
            ),
        ));
    }
    Ok((before.film, before.stats))
}

fn facts(description: &Description, film: &Film) -> Facts<'static> {
    let mut seeds: Vec<u64> = film.done().seeds().collect();
    if seeds.is_empty() {
        seeds.push(description.render.seed);
    }
    let scene = description.path.display().to_string();
    Facts { scene, method: description.render.method.name(), seeds }
}

fn outputs(arguments: &Arguments) -> Result<Vec<PathBuf>> {
    if !arguments.out.is_empty() || arguments.fill.is_some() {
        return Ok(arguments.out.clone());
    }
    let scene = &arguments.planned.scene;
    let stem =
        scene.file_stem().ok_or_else(|| Error::Usage(format!("{}: not the name of a scene file", scene.display())))?;
    let with = |ending: &str| {
        let mut name = stem.to_os_string();
        if arguments.frames.is_some() {
            name.push(".####");
        }
        name.push(ending);
        PathBuf::from(name)
    };
    Ok(default_endings().into_iter().map(with).collect())
}

/// Each medium's bounds, range of extinction and optical depth; then warnings.
fn describe(scene: &Scene) {
    for medium in &scene.media {
        let extinction = medium.extinction * medium.density.max();
        let support = medium.density.support();
        let sigma = format!("{:.4}, {:.4}, {:.4}", extinction.x, extinction.y, extinction.z);
        if support.is_empty() || extinction.max_element() <= 0.0 {
            super::tell(format_args!("medium {}: clear", medium.name));
        } else if support.size().is_finite() {
            let (min, max) = (support.min + scene.center, support.max + scene.center);
            let across = support.size().max_element();
            let ray = crate::math::Ray::new(support.center() - across * crate::math::DVec3::Y, crate::math::DVec3::Y);
            let depth = medium.density.depth(&ray, 0.0, 2.0 * across) * medium.extinction.max_element();
            super::tell(format_args!(
                "medium {}: from ({:.3}, {:.3}, {:.3}) to ({:.3}, {:.3}, {:.3}), extinction up to ({sigma}), optical depth {depth:.3} upwards through its middle",
                medium.name, min.x, min.y, min.z, max.x, max.y, max.z
            ));
        } else {
            let kind = if medium.density.is_even() { "the same everywhere" } else { "without an end" };
            super::tell(format_args!("medium {}: {kind}, extinction up to ({sigma})", medium.name));
        }
    }
    for warning in &scene.warnings {
        super::tell(format_args!("warning: {warning}"));
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
    passes: u64,
    samples: u64,
    /// The relative standard error over passes.
    error: Option<f64>,
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
    shadow: u64,
    /// Radii of the discs.
    radius: [f32; 3],
}

#[derive(Serialize)]
struct Gather {
    queries: u64,
    tested: u64,
    gathered: u64,
    records: u64,
    /// Of surfaces.
    shadow_rays: u64,
    /// Those that shadow photons made needless.
    spared_rays: u64,
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
        let density = medium::bytes(&scene.media);
        Report {
            scene: description.path.display().to_string(),
            method: description.render.method.name(),
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
                global: stats.global,
                caustic: stats.caustic,
                shadow: stats.shadow,
                radius: [stats.radii.min, stats.radii.mean, stats.radii.max],
            },
            gather: Gather {
                queries: stats.gather.queries,
                tested: stats.gather.blocks * 16,
                gathered: stats.gather.photons,
                records: stats.records,
                shadow_rays: stats.gather.shadow_rays,
                spared_rays: stats.gather.spared_rays,
            },
            bytes: Bytes {
                peak: peak_bytes(),
                volume_map: stats.map_bytes,
                surface_maps: stats.surface_bytes,
                density,
            },
            passes: stats.passes,
            samples: stats.samples,
            error: stats.error,
            interrupted: rendering.end == End::Interrupted,
            warnings: scene.warnings.iter().chain(&rendering.warnings).cloned().collect(),
        }
    }
}

fn summarise(report: &Report, stats: &Stats, outputs: &[PathBuf]) {
    let seconds = &report.seconds;
    let mut parts = vec![format!("{:.1} s", seconds.total)];
    if stats.volume > 0 {
        parts.push(format!("photons {:.1} s ({} of {} emitted)", seconds.photons, stats.volume, stats.emitted));
        parts.push(format!("map {:.1} s ({:.0} MB)", seconds.build, stats.map_bytes as f64 * 1e-6));
    }
    parts.push(format!("pixels {:.1} s", seconds.render));
    if stats.passes > 1 {
        parts.push(format!("{} passes", stats.passes));
    }
    if let Some(error) = stats.error {
        parts.push(format!("standard error {:.2} %", 100.0 * error));
    }
    let names: Vec<String> = outputs.iter().map(|path| path.display().to_string()).collect();
    super::tell(format_args!("{}: {}", names.join(", "), parts.join(", ")));
}
