//! What the targets share: files are put through what the mutants of the suite are put through.

use std::path::PathBuf;
use std::sync::LazyLock;

#[path = "../../tests/mutants/examine.rs"]
mod examine;

pub use examine::sealed;
use examine::{Outcome, picture, read};

/// Where files to be read are put.
static FOLDER: LazyLock<tempfile::TempDir> = LazyLock::new(|| tempfile::tempdir().expect("a temporary folder"));

/// Reads a file of this ending: it is sound, or refused.
pub fn reads(bytes: &[u8], ending: &str) {
    let path = FOLDER.path().join(format!("file.{ending}"));
    std::fs::write(&path, bytes).expect("room for a file");
    let _ = read(&path);
}

/// Renders a scene small; files that it names are those of `tests/data` and of scenes.
pub fn renders(text: &str) {
    let path = PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../scenes/fuzz.toml"));
    if let Ok(Outcome::Late) = picture(text, &path) {
        panic!("a small picture takes too long");
    }
}
