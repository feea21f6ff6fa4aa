//! From a scene to pixels.

mod camera;
mod equiangular;
mod eye;
mod film;
mod pass;
mod plan;
mod tile;

pub use camera::Camera;
pub use eye::{Claim, Component, Context, Eye, Mode, Sample};
pub use film::{Film, Layers, Sums};
pub use pass::{Progress, Rendering, Silent, Stats, render};
pub use plan::Plan;
