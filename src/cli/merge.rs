//! `volpm merge`.

use std::path::{Path, PathBuf};

use clap::Args;

use super::picture::{Facts, picture, tone_of};
use crate::image::{self, Format};
use crate::render::{Checkpoint, checkpoint};
use crate::{Error, Result};

#[derive(Args)]
pub struct Arguments {
    /// Checkpoints of one scene, with different seeds or passes.
    #[arg(required = true)]
    checkpoints: Vec<PathBuf>,
    /// Where to write them together: an image by its ending, .exr, .png, .pfm or .hdr; else a checkpoint. Repeatable.
    #[arg(short, long, value_name = "FILE", required = true)]
    out: Vec<PathBuf>,
    /// Refuses to write anything but passes 1 to N.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    passes: Option<u32>,
    /// No messages but errors.
    #[arg(short, long)]
    quiet: bool,
}

pub fn run(arguments: &Arguments) -> Result<()> {
    arguments.out.iter().try_for_each(image::check_target)?;
    let mut files = arguments.checkpoints.iter();
    let first: &Path = files.next().ok_or_else(|| Error::Usage("there is no checkpoint to merge".to_string()))?;
    let mut all = Checkpoint::read(first)?;
    for (index, file) in files.enumerate() {
        let next = Checkpoint::read(file)?;
        all.merge(&next).map_err(|why| {
            let others = if index == 0 { "" } else { " and the others before it" };
            Error::asset(file, format!("cannot be joined with {}{others}: {why}", first.display()))
        })?;
    }
    let Checkpoint { subject, film, stats } = &all;
    if let Some(passes) = arguments.passes {
        check_complete(&all, passes)?;
    }
    let seeds = film.done().seeds().collect();
    let picture = picture(film, stats, &Facts { scene: subject.scene.clone(), method: &subject.method, seeds });
    for path in &arguments.out {
        match Format::of(path) {
            Ok(_) => image::write(path, &picture, &tone_of(subject))?,
            Err(_) => checkpoint::write(path, subject, film, stats)?,
        }
    }
    if !arguments.quiet {
        let names: Vec<String> = arguments.out.iter().map(|path| path.display().to_string()).collect();
        let passes = stats.passes;
        let error = stats.error.map_or(String::new(), |error| format!(", standard error {:.2} %", 100.0 * error));
        super::tell(format_args!("{}: {passes} passes{error}", names.join(", ")));
    }
    Ok(())
}

/// Checks that a checkpoint holds passes 1 to `passes` of each of its seeds, and no other.
fn check_complete(all: &Checkpoint, passes: u32) -> Result<()> {
    let (done, parts) = (all.film.done(), all.subject.parts);
    let last = passes.saturating_mul(parts);
    for seed in done.seeds() {
        if let Some(pass) = done.beyond(seed, last) {
            let pass = pass.div_ceil(parts);
            return Err(Error::Usage(format!(
                "nothing is written: there is a pass {pass} of seed {seed}, beyond the {passes} that there should be"
            )));
        }
        if let Some(first) = done.missing(seed, 1..=last).next() {
            let held = done.ranges().filter(|(of, _)| *of == seed).map(|(_, (first, last))| (last - first) as u64 + 1);
            let missing = (last as u64 - held.sum::<u64>()).div_ceil(parts as u64);
            return Err(Error::Usage(format!(
                "nothing is written: of passes 1 to {passes} of seed {seed}, {missing} are missing, pass {} first; make them, and merge again",
                first.div_ceil(parts)
            )));
        }
    }
    Ok(())
}
