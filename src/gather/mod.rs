//! Radiance from photons: sums over the discs that an eye ray meets.

mod beam;
mod bundle;
mod confined;
mod depth;
mod few;
mod flux;
mod gathered;
mod global;
mod irradiance;
mod lattice;
pub mod march;
mod phase;
mod point;
mod sampled;
mod segment;
mod stream;
mod surface;
#[cfg(test)]
mod tests;
mod visibility;
mod volume;

pub use beam::BeamQuery;
pub use bundle::{Bundle, BundleScratch};
pub use confined::Confines;
pub use depth::DepthTable;
pub use flux::{FluxMap, FluxMemory};
pub use gathered::{GatherStats, Gathered};
pub use global::{GlobalMap, GlobalMemory, GlobalSettings};
pub use irradiance::{Gathering, IrradianceCache, Limits, Record, Spacing};
pub use lattice::{Fan, Lattices};
pub use phase::PhaseLanes;
pub use point::{Marching, PointMaps, PointQuery};
pub use sampled::{SampledDepths, Samples};
pub use segment::EyeSegment;
pub use stream::StreamScratch;
pub use surface::{Reach, SurfaceMap};
pub use visibility::{Visibility, VisibilityMap};
pub use volume::{Queue, VolumeMaps, emitted};
