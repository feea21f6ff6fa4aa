//! What a scene file may say, and reading it with places kept for errors.

pub mod description;

pub use description::{Description, Located, Place};
