//! From a scene to pixels.

mod camera;
pub mod checkpoint;
mod clock;
mod done;
mod eternity;
mod exact;
mod eye;
mod film;
mod importons;
mod irradiance;
mod light_tracer;
mod limits;
mod maps;
mod pass;
mod peaks;
mod pilot;
mod plan;
mod progress;
mod replay;
mod shared;
mod splat;
mod stats;
mod tile;
mod warnings;

pub use camera::Camera;
pub use checkpoint::Checkpoint;
pub use done::Done;
pub use eye::{Claim, Component, Context, Eye, EyeSettings, Happening, Mode, Path, Sample, Told};
pub use film::{Film, Layers, Sums};
pub use limits::Limits;
pub use pass::{End, Rendering, refine, render};
pub use plan::{Plan, volume_photons};
pub use progress::{Progress, Silent};
pub use replay::{Replayed, Replayer};
pub use shared::{SharedMap, SharedPhotons, refine_shared};
pub use stats::Stats;
