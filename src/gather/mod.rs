//! Radiance from photons: sums over the discs that an eye ray meets.

mod beam;
mod depth;
pub mod march;
mod phase;
mod point;
mod volume;

pub use beam::{BeamQuery, GatherStats, Gathered};
pub use depth::DepthTable;
pub use phase::{Lobe, PhaseLanes};
pub use point::{Marching, PointMaps, PointQuery};
pub use volume::{Queue, Reach, VolumeMaps, emitted};
