//! Volume photons: how they are stored, how wide they are spread, and the hierarchy over them.

pub(crate) mod discs;
mod emission;
mod history;
mod instructions;
pub mod kernel;
pub(crate) mod map;
mod pilot;
mod points;
mod radii;
pub(crate) mod simd;
mod sinks;
mod tracer;
mod uneven;
pub mod walls;

pub use emission::Sources;
pub use instructions::Instructions;
pub use map::{Disc, MapSettings, Photon, PhotonMap, Plane, Radii, Radius};
pub use points::{Ball, PointMap, PointMemory, PointSettings};
pub use tracer::{Pass, Traced, trace};
