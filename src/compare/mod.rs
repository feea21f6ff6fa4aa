//! Error against run time: several estimates of one scene, each refined once and measured on the way.

pub mod results;

pub use results::Results;
