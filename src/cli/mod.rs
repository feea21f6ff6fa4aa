//! The command line: one file a command. Nothing else in this crate prints.

mod check;
#[cfg(feature = "report")]
mod compare;
mod completions;
mod costs;
mod diff;
mod force;
mod frames;
mod info;
mod job;
mod man;
mod manual;
mod merge;
mod new;
mod picture;
mod plan;
mod planned;
mod progress;
mod render;
#[cfg(feature = "tev")]
mod tev;
// What only comparisons are asked with is there for them.
#[cfg_attr(not(feature = "report"), allow(dead_code))]
mod values;
mod watch;

use std::ffi::OsString;
use std::fmt::Display;
use std::io::{self, Write};
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use clap::error::ErrorKind;
use clap::{Parser, Subcommand};

use crate::{Error, Result};

/// A renderer for light in fog, smoke and marble.
#[derive(Parser)]
#[command(
    name = "volpm",
    version,
    max_term_width = 100,
    after_help = "`volpm help KEY` is the manual of a key of scene files, such as volume.neighbours, or of a table, such as volume; of render and compare, which are commands, render.* and compare.*."
)]
struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Renders a scene.
    Render(render::Arguments),
    /// Error against run time for several estimates of a scene.
    #[cfg(feature = "report")]
    Compare(compare::Arguments),
    /// Whether a scene can be believed: estimators against each other, energy, leaks, what is not finite.
    Check(check::Arguments),
    /// Error figures of one image against another.
    Diff(diff::Arguments),
    /// Joins checkpoints of one scene made with other seeds or passes.
    Merge(merge::Arguments),
    /// Writes a commented scene to start from.
    New(new::Arguments),
    /// Which passes and structures a scene gets, and why not others.
    Plan(plan::Arguments),
    /// Writes the passes of a scene as tasks for a render farm.
    Job(job::Arguments),
    /// What is in a scene, .vdb, .obj, .npy, image or checkpoint file.
    Info(info::Arguments),
    /// Prints a JSON schema of scene files, by which editors complete and check them.
    Schema,
    /// Prints completions for a shell.
    Completions(completions::Arguments),
    /// Prints a page of the manual: of the program, of a command, or of scene files.
    Man(man::Arguments),
}

/// Runs the program and returns its exit status: 0 done; 1 failed; 2 bad usage or bad input; 3 a checked scene
/// is not to be believed; 130 interrupted.
pub fn main(arguments: impl IntoIterator<Item = OsString>) -> ExitCode {
    let arguments: Vec<OsString> = arguments.into_iter().collect();
    let asked = key_asked_for(&arguments);
    let arguments = match Arguments::try_parse_from(arguments) {
        Ok(arguments) => arguments,
        Err(error) => {
            if let Some(key) = asked.filter(|_| error.kind() == ErrorKind::InvalidSubcommand) {
                return status(manual::run(&key));
            }
            // Help and version go to stdout with status 0, complaints to stderr with status 2.
            let printed = error.print();
            return if error.use_stderr() { ExitCode::from(2) } else { status(unless_hung_up(printed)) };
        }
    };
    let done = match arguments.command {
        Command::Render(arguments) => render::run(&arguments),
        #[cfg(feature = "report")]
        Command::Compare(arguments) => compare::run(&arguments),
        Command::Check(arguments) => check::run(&arguments),
        Command::Diff(arguments) => diff::run(&arguments),
        Command::Merge(arguments) => merge::run(&arguments),
        Command::New(arguments) => new::run(&arguments),
        Command::Plan(arguments) => plan::run(&arguments),
        Command::Job(arguments) => job::run(&arguments),
        Command::Info(arguments) => info::run(&arguments),
        Command::Schema => json(&crate::scene::manual::schema()).and_then(|text| print(&text)),
        Command::Completions(arguments) => completions::run(&arguments),
        Command::Man(arguments) => man::run(&arguments),
    };
    status(done)
}

/// The exit status of what was done; tells of an error.
fn status(done: Result<()>) -> ExitCode {
    match done {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            tell(format_args!("error: {error}"));
            ExitCode::from(error.exit_status())
        }
    }
}

/// What `volpm help` is asked for, if that may be a key of scene files.
fn key_asked_for(arguments: &[OsString]) -> Option<String> {
    match arguments {
        [_, help, key] if help == "help" => key.to_str().map(str::to_string),
        _ => None,
    }
}

/// What is set by Ctrl-C. A second one ends the program at once.
fn stop_on_signal() -> Result<Arc<AtomicBool>> {
    let stop = Arc::new(AtomicBool::new(false));
    let flag = stop.clone();
    let on_signal = move || {
        if flag.swap(true, Ordering::Relaxed) {
            std::process::exit(130);
        }
    };
    ctrlc::set_handler(on_signal).map_err(|error| Error::Usage(format!("cannot listen for Ctrl-C: {error}")))?;
    Ok(stop)
}

/// So many threads, or one for each core.
fn pool(threads: Option<u16>) -> Result<rayon::ThreadPool> {
    let threads = threads.map_or(0, usize::from);
    rayon::ThreadPoolBuilder::new()
        .num_threads(threads)
        .build()
        .map_err(|error| Error::Limit(format!("cannot start {threads} threads: {error}")))
}

/// Tells the user something on stderr, in a line of its own. What cannot be told is dropped: a reader that hung up, or a
/// log on a full disk, must not cost the picture.
fn tell(message: impl Display) {
    let _ = writeln!(io::stderr().lock(), "{message}");
}

/// Prints what was asked for to stdout.
fn print(text: &str) -> Result<()> {
    let mut out = io::stdout().lock();
    unless_hung_up(out.write_all(text.as_bytes()).and_then(|()| out.flush()))
}

/// What became of writing to stdout, where a reader that hung up has read enough.
fn unless_hung_up(written: io::Result<()>) -> Result<()> {
    match written {
        Err(error) if error.kind() != io::ErrorKind::BrokenPipe => Err(Error::output("stdout", error)),
        _ => Ok(()),
    }
}

/// A value as pretty JSON, or the error that it has none.
fn json(value: &impl serde::Serialize) -> Result<String> {
    serde_json::to_string_pretty(value).map(|text| text + "\n").map_err(|error| Error::output("JSON", error))
}
