//! Volume photons: how they are stored, how wide they are spread, and the hierarchy over them.

pub(crate) mod discs;
pub mod kernel;
pub(crate) mod map;
mod radii;
pub(crate) mod simd;

pub use map::{MapSettings, Photon, PhotonMap, Plane, Radii, Radius};
