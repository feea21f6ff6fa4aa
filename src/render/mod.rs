//! From a scene to pixels.

mod camera;
pub mod checkpoint;
mod done;
mod exact;
mod eye;
mod film;
mod limits;
mod pass;
mod pilot;
mod plan;
mod shared;
mod tile;

pub use camera::Camera;
pub use checkpoint::Checkpoint;
pub use done::Done;
pub use eye::{Claim, Component, Context, Eye, EyeSettings, Mode, Path, Sample};
pub use film::{Film, Layers, Sums};
pub use limits::Limits;
pub use pass::{End, Progress, Rendering, Silent, Stats, narrowing, refine, render};
pub use plan::{Plan, volume_photons};
pub use shared::{SharedMap, SharedPhotons, refine_shared};
