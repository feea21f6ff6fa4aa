//! One file for each promise.

mod support;

mod scene_files;
mod vdb;
