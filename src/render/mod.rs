//! From a scene to pixels.

mod camera;
mod equiangular;
mod eye;

pub use camera::Camera;
pub use eye::{Component, Context, Eye, Mode, Sample};
