//! One file for each promise.

mod scene_files;
mod vdb;
