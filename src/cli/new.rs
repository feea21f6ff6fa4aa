//! `volpm new`.

use std::io::Write;
use std::path::PathBuf;

use clap::{Args, ValueEnum};

use crate::Result;
use crate::image;

#[derive(Args)]
#[command(after_help = "A file that exists is never touched. `volpm help KEY` is the manual of each key.")]
pub struct Arguments {
    /// The scene file to write (.toml).
    file: PathBuf,
    /// What it starts from.
    #[arg(long, value_name = "KIND")]
    from: Kind,
}

/// What a new scene starts from.
#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Kind {
    /// Columns in fog before a lamp.
    Fog,
    /// Drifting smoke; says how to name a .vdb file.
    Smoke,
    /// A pawn of marble: light under its surface.
    Marble,
    /// Glass and gold that throw light on a table.
    Caustic,
    /// A room whose walls light one another.
    Room,
}

impl Kind {
    /// The scene file.
    fn text(self) -> &'static str {
        match self {
            Kind::Fog => include_str!("../../scenes/new/fog.toml"),
            Kind::Smoke => include_str!("../../scenes/new/smoke.toml"),
            Kind::Marble => include_str!("../../scenes/new/marble.toml"),
            Kind::Caustic => include_str!("../../scenes/new/caustic.toml"),
            Kind::Room => include_str!("../../scenes/new/room.toml"),
        }
    }
}

pub fn run(arguments: &Arguments) -> Result<()> {
    let path = &arguments.file;
    image::write_new(path, |file| file.write_all(arguments.from.text().as_bytes()))?;
    super::tell(format_args!("{}: written; next: volpm render {}", path.display(), quoted(path)));
    Ok(())
}

/// A path as a shell takes it, where that is simple.
fn quoted(path: &std::path::Path) -> String {
    let text = path.display().to_string();
    if text.contains([' ', '\'', '"', '$', '&']) { format!("{text:?}") } else { text }
}
