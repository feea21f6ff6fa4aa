//! One file for each promise.

mod support;

#[cfg(feature = "cli")]
mod cli;
mod closed_forms;
mod scene_files;
mod stress;
mod vdb;
