//! What a scene file may say, and reading it with places kept for errors.
//!
//! [`read()`] turns the text of a scene file and the overrides of the command line into a
//! [`Description`]: typed, checked, references resolved, but no other file opened yet. A [`Draft`] is the same
//! from code. [`build()`] makes a [`Scene`] of it.

mod build;
pub mod description;
mod draft;
mod glow;
pub mod manual;
mod mixture;
mod overrides;
mod read;
mod settings;
mod study;
mod table;
mod text;
mod tree;
mod world;

pub use build::build;
pub use description::{Description, Located, Place};
pub use draft::{Draft, Value};
pub use glow::Glow;
pub use mixture::Finish;
pub use read::{parse, read};
pub use settings::Settings;
pub use study::{Study, StudyReference, StudyVariant, is_plain, read_study};
pub use world::{Inside, Overlap, Scene, Solid, Surface};

/// A scene from the text of a scene file, for tests of what lies above.
#[cfg(test)]
pub(crate) fn from_text(text: &str) -> (Scene, Settings) {
    let description = parse(text, std::path::Path::new("scene.toml"), &[]).unwrap_or_else(|error| panic!("{error}"));
    build(&description).unwrap_or_else(|error| panic!("{error}"))
}
