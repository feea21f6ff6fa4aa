//! One file for each promise.

mod support;

mod closed_forms;
mod scene_files;
mod vdb;
