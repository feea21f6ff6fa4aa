//! A renderer for light in fog, smoke and marble.

#![warn(missing_docs)]

#[cfg(feature = "cli")]
pub mod cli;
pub mod error;
pub mod gather;
pub mod geometry;
pub mod image;
pub mod light;
pub mod math;
pub mod medium;
pub mod photon;
pub mod render;
pub mod scene;
pub mod surface;
pub mod transport;

pub use error::{Error, Result};
