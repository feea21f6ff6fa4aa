//! A renderer for light in fog, smoke and marble.

#![warn(missing_docs)]

pub mod error;
pub mod math;
pub mod scene;

pub use error::{Error, Result};
