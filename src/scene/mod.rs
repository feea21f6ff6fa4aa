//! What a scene file may say, and reading it with places kept for errors.
//!
//! [`read()`] turns the text of a scene file and the overrides of the command line into a
//! [`Description`]: typed, checked, references resolved, but no other file opened yet.

mod build;
pub mod description;
mod glow;
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
pub use glow::Glow;
pub use read::{parse, read};
pub use settings::Settings;
pub use study::{Study, StudyReference, StudyVariant, is_plain, read_study};
pub use world::{Inside, Scene, Solid, Surface};
