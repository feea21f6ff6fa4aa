//! A renderer for light in fog, smoke and marble.

#![warn(missing_docs)]

pub mod error;
pub mod gather;
pub mod math;
pub mod photon;

pub use error::{Error, Result};
