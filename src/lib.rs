//! A renderer for light in fog, smoke and marble.

#![warn(missing_docs)]

pub mod error;
pub mod geometry;
pub mod math;

pub use error::{Error, Result};
