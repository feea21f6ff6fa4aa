//! A scene as the command line asks for it: what of that changes the plan of a render.

use std::path::PathBuf;

use clap::Args;

use super::{frames, values};
use crate::render::{self, Choice};
use crate::scene::description::Description;
use crate::scene::{self, Scene, Settings};
use crate::{Error, Result};

/// The options that change what a render of a scene does.
#[derive(Args, Clone)]
pub struct Planned {
    /// The scene file (.toml).
    pub scene: PathBuf,
    /// Overrides a key of the scene file, by its dotted path; repeatable.
    #[arg(long, value_name = "KEY=VALUE")]
    set: Vec<String>,
    /// Camera samples per pixel (render.samples).
    #[arg(long, value_name = "N")]
    samples: Option<u64>,
    /// The seed of all random numbers (render.seed).
    #[arg(long, value_name = "N")]
    seed: Option<u64>,
    /// Passes, each with fresh photons in narrower discs (render.passes).
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    pub passes: Option<u32>,
    /// Splits passes so that the render takes about this much memory at most: 8GiB.
    #[arg(long, value_name = "SIZE", value_parser = values::bytes)]
    pub memory: Option<u64>,
    /// Threads to use; default: all cores.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub threads: Option<u16>,
    /// Warnings are errors: of the scene before anything is rendered, of the render once its image is written.
    #[arg(long)]
    pub strict: bool,
    /// The frame that files have in their names instead of #.
    #[arg(skip)]
    pub frame: Option<u32>,
}

/// A scene that was read and built.
pub struct Loaded {
    /// What its file says, with the method that was chosen.
    pub description: Description,
    /// What is there.
    pub scene: Scene,
    /// How its picture is computed.
    pub settings: Settings,
    /// The method and why, if the file leaves that open.
    pub choice: Option<Choice>,
}

impl Planned {
    /// What is set in the scene but for its passes, as `KEY=VALUE`.
    pub fn overrides(&self) -> Vec<String> {
        let mut overrides = self.set.clone();
        overrides.extend(self.samples.map(|n| format!("render.samples={n}")));
        overrides.extend(self.seed.map(|n| format!("render.seed={n}")));
        overrides
    }

    /// Reads and builds the scene, and chooses the method that its file leaves open, on the current thread pool.
    ///
    /// # Errors
    /// Those of reading and building; by `--strict` warnings of the scene, too.
    pub fn load(&self) -> Result<Loaded> {
        let mut overrides = self.overrides();
        overrides.extend(self.passes.map(|n| format!("render.passes={n}")));
        let mut description = scene::read(&self.scene, &overrides)?;
        if let Some(frame) = self.frame {
            frames::number(&mut description, frame);
        }
        let (scene, settings) = scene::build(&description)?;
        let choice = render::choose(&scene, &settings)?;
        if let Some(Choice { method, .. }) = choice {
            (description.render.method, description.render.automatic) = (method, false);
        }
        if self.strict {
            refuse(&scene.warnings)?;
        }
        let settings = Settings::of(&description);
        Ok(Loaded { description, scene, settings, choice })
    }
}

/// By `--strict`: warnings of a scene are its errors.
///
/// # Errors
/// [`Error::Scene`], if there is any.
pub fn refuse(warnings: &[String]) -> Result<()> {
    if warnings.is_empty() { Ok(()) } else { Err(Error::Scene(warned(warnings))) }
}

/// Warnings as an error.
pub fn warned(warnings: &[String]) -> String {
    format!("{}\n(warnings are errors: --strict)", warnings.join("\n"))
}
