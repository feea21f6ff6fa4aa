//! A renderer for light in fog, smoke and marble.

#![warn(missing_docs)]

pub mod error;
pub mod math;
pub mod medium;

pub use error::{Error, Result};
