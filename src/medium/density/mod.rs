//! How a medium's density varies in space.

pub mod bricks;
pub mod npy;
pub mod vdb;
