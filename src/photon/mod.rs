//! Photons in media and on surfaces: how they are traced, stored and spread.
//!
//! - `emission` draws where they start, at what `targets`, `pilot` finds out how, `tracer` is their journey, `wander` that of many at once
//!   deep in dense solids, `pass` all of them together.
//! - `importance` tells where photons change the picture; `guide` is what they learn about where to aim.
//! - `control` has photons hand their power to neighbours where they lie closest.
//! - `budget` bounds what that may cost.
//! - `history` is what a photon remembers of its way; by that, `sinks` stores it or does not.
//! - `surfaces` are photons on surfaces: of caustics, and all; `shadows` those that tell where shadows are.
//! - `store` puts photons in order, in blocks and under a tree; `discs` is the map for beam queries, `balls` that for point
//!   queries, `sheets` that of photons on surfaces with radii of their own, with what they need of `radius`, [`kernel`],
//!   [`walls`], solids that are `small` against discs, and `uneven` densities.
//! - `simd` holds registers and sets of instructions.

mod balls;
mod budget;
mod control;
pub(crate) mod discs;
mod emission;
mod guide;
mod history;
mod importance;
mod instructions;
pub mod kernel;
mod pass;
mod pilot;
mod radius;
mod shadows;
pub(crate) mod sheets;
pub(crate) mod simd;
mod sinks;
pub mod small;
pub(crate) mod store;
mod surfaces;
mod targets;
mod tracer;
mod uneven;
pub mod walls;
mod wander;

pub(crate) use balls::Load;
pub use balls::{Ball, PointMap, PointMemory, PointSettings};
pub use control::Tagged;
pub use discs::{Disc, MapSettings, PhotonMap, Plane};
pub use emission::{Emission, Sources, Start};
pub use history::History;
pub use importance::{Importon, Importons};
pub use instructions::Instructions;
pub(crate) use pass::at_once;
pub use pass::{Traced, sample, trace};
pub use radius::{Filling, InMedium, Radii, Radius, narrowing};
pub use shadows::{ShadowPass, ShadowPhoton, Shadows, Sight, served_lights, trace_shadows};
pub(crate) use sinks::leaves_out_deep;
pub use store::{PackedNormal, Photon};
pub use surfaces::{Kind, Landed, SurfacePass, may_land, sample_surfaces, trace_surfaces, why_none_land};
pub use tracer::Pass;
pub(crate) use tracer::in_chunks;
