//! The command line: one file a command. Nothing else in this crate prints.

mod diff;
mod info;
mod progress;
mod render;

use std::ffi::OsString;
use std::process::ExitCode;

use clap::{Parser, Subcommand};

use crate::{Error, Result};

/// A renderer for light in fog, smoke and marble.
#[derive(Parser)]
#[command(name = "volpm", version, max_term_width = 100)]
struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Renders a scene.
    Render(render::Arguments),
    /// Error figures of one image against another.
    Diff(diff::Arguments),
    /// What is in a scene, .vdb, .obj, .npy or image file.
    Info(info::Arguments),
}

/// Runs the program and returns its exit status: 0 done; 1 failed; 2 bad usage or bad input; 130 interrupted.
pub fn main(arguments: impl IntoIterator<Item = OsString>) -> ExitCode {
    let arguments = match Arguments::try_parse_from(arguments) {
        Ok(arguments) => arguments,
        Err(error) => {
            // Help and version go to stdout with status 0, complaints to stderr with status 2.
            let status = if error.use_stderr() { 2 } else { 0 };
            return if error.print().is_ok() { ExitCode::from(status) } else { ExitCode::from(1) };
        }
    };
    let done = match arguments.command {
        Command::Render(arguments) => render::run(&arguments),
        Command::Diff(arguments) => diff::run(&arguments),
        Command::Info(arguments) => info::run(&arguments),
    };
    match done {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::from(error.exit_status())
        }
    }
}

/// Prints to stdout; a reader that hung up is no failure.
fn print(text: &str) -> Result<()> {
    use std::io::Write;
    let mut out = std::io::stdout().lock();
    match out.write_all(text.as_bytes()).and_then(|()| out.flush()) {
        Err(error) if error.kind() != std::io::ErrorKind::BrokenPipe => Err(Error::output("stdout", error)),
        _ => Ok(()),
    }
}

/// A value as pretty JSON, or the error that it has none.
fn json(value: &impl serde::Serialize) -> Result<String> {
    serde_json::to_string_pretty(value).map(|text| text + "\n").map_err(|error| Error::output("JSON", error))
}
