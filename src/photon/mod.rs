//! Volume photons: how they are stored, how wide they are spread, and the hierarchy over them.

mod emission;
mod history;
mod instructions;
pub mod kernel;
pub(crate) mod map;
mod pass;
mod pilot;
mod points;
mod radii;
pub(crate) mod simd;
mod sinks;
pub(crate) mod store;
mod tracer;
mod uneven;
pub mod walls;

pub use emission::Sources;
pub use instructions::Instructions;
pub use map::{Disc, MapSettings, PhotonMap, Plane, Radii, Radius};
pub use pass::{Traced, trace};
pub use points::{Ball, PointMap, PointMemory, PointSettings};
pub use store::Photon;
pub use tracer::Pass;
