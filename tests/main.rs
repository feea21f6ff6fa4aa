//! One file for each promise.

mod support;

mod closed_forms;
mod determinism;
mod references;
mod scene_files;
mod slab;
mod vdb;
