//! Volume photons: how they are stored, how wide they are spread, and the hierarchy over them.

mod balls;
pub(crate) mod discs;
mod emission;
mod history;
mod instructions;
pub mod kernel;
mod pass;
mod pilot;
mod radius;
pub(crate) mod simd;
mod sinks;
pub(crate) mod store;
mod tracer;
mod uneven;
pub mod walls;

pub use balls::{Ball, PointMap, PointMemory, PointSettings};
pub use discs::{Disc, MapSettings, PhotonMap, Plane};
pub use emission::Sources;
pub use instructions::Instructions;
pub use pass::{Traced, trace};
pub use radius::{Filling, InMedium, Radii, Radius, narrowing};
pub use store::Photon;
pub use tracer::Pass;
