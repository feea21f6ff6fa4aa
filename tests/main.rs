//! One file for each promise.

mod support;

/// Chandrasekhar's H functions, by which `docs/certified.md` is made, too.
#[path = "../examples/certified/half_space.rs"]
mod half_space;

mod adaptive;
mod beam_against_path;
mod cameras;
#[cfg(feature = "cli")]
mod caustics;
mod check;
mod cli;
mod closed_forms;
mod compare;
mod determinism;
#[cfg(feature = "cli")]
mod faults;
mod figures;
mod grids;
mod indirect;
#[cfg(feature = "cli")]
mod job;
mod kinds;
mod light_tracing;
mod many_lights;
mod materials;
#[cfg(feature = "cli")]
mod pages;
mod panes;
mod passes;
mod peaks;
mod plan;
mod point_queries;
mod references;
#[cfg(feature = "report")]
mod report;
mod scene_files;
mod single_scattering;
mod slab;
mod stress;
mod subsurface;
mod three_methods;
mod vdb;
mod walls;
mod whitted;
