//! A renderer for light in fog, smoke and marble.
//!
//! Light in participating media is computed by methods that judge each other: volumetric photon mapping with the
//! beam radiance estimate (Jarosz, Zwicker and Jensen 2008), which gathers all photons along a ray in one query, an
//! unbiased path tracer, and an unbiased light tracer, which knows the caustics that paths do not find.
//!
//! A [scene](scene::Description) comes from a file, from text, or from [code](scene::Draft), with the same keys, defaults and checks.
//! [`render::render`] makes a [film](render::Film) of it in memory, on the current thread pool of `rayon`. Whoever calls it
//! [hears](render::Progress) how far it is and may stop it at any time with what there is by then. There is no global state; nothing is
//! printed, and no file is written that is not asked for; what is wrong with input is an [`Error`].
//!
//! # Example
//!
//! ```no_run
//! use std::sync::atomic::AtomicBool;
//! use volpm::{image, render, scene};
//!
//! # fn main() -> volpm::Result<()> {
//! let description = scene::read("scenes/smoke.toml".as_ref(), &["film.width=320".to_string()])?;
//! let (scene, settings) = scene::build(&description)?;
//! let rendering = render::render(&scene, &settings, &render::Silent, &AtomicBool::new(false))?;
//! image::write("smoke.png", &rendering.film.image().into(), &image::ToneSettings::default())?;
//! # Ok(())
//! # }
//! ```
//!
//! Longer ones are in `examples/`: `scene_in_code`, `progress_and_stop`, `plan_and_photons`, `two_methods`.
//!
//! # The way of the light
//!
//! ```text
//! file ─► description ─► scene ─► plan ─► photons ─► maps ─► pixels ─► files
//! ```
//!
//! - [`scene`] reads what a file says into a [`scene::Description`], with places kept for errors, and builds a
//!   [`scene::Scene`] of it: files loaded, instances placed, the middle moved to the origin. How a picture of it is
//!   computed, [`scene::Settings`] say.
//! - [`render`] decides once what the scene needs (the [`render::Plan`]), then makes passes: photons, maps, and
//!   camera samples that walk from surface to surface. What that will be, a [`render::Forecast`] tells.
//! - [`photon`] draws photons from lights and glowing media, walks them, stores them where they collide, or, bent by glass and mirrors,
//!   land on surfaces, finds their radii and builds the hierarchy over their discs.
//! - [`gather`] answers beam queries: what a segment of a ray receives from the discs it crosses; and point queries,
//!   for which it marches along rays.
//! - [`transport`] is the journey that photons and eye paths share: from vertex to vertex, through media and boundaries;
//!   light asked for and met, free flights, transmittance, and Russian roulette that keeps the sum of a weight.
//! - [`light`], [`surface`], [`medium`] and [`geometry`] hold the kinds a scene can be made of, one file each.
//! - [`check`] says whether a scene can be believed: estimators against each other, energy, geometry.
//! - [`compare`] renders several estimates of a scene and measures their errors against run time.
//! - `report`, with the feature of that name, shows what a comparison found.
//! - [`image`] reads and writes pictures and says how far one is from another; [`math`] lies beneath.
//!
//! What each estimator computes, with its equations and their sources, is on a page of its own: [`estimators`].
//!
//! # Units and conventions
//!
//! Radiometric: power in W, intensity in W/sr, radiance in W/(sr · unit²), each for three channels of linear
//! sRGB. Coefficients are per scene unit. Space is right-handed. Phase functions take the cosine between the
//! directions of travel before and after, forward +1.
//!
//! # Features
//!
//! All are on by default; the library builds with none of them.
//!
//! | feature | |
//! |---|---|
//! | `vdb`, `obj`, `exr`, `png` | files that are read and written: OpenVDB; Wavefront OBJ; OpenEXR; PNG, JPEG and Radiance HDR. PFM and NumPy arrays always are. What a build leaves out is an error that names the feature |
//! | `report` | what a comparison found, as a page: the module `report` |
//! | `cli` | the program: the module `cli` |
//! | `tev` | images sent to the viewer tev by the program |

#![warn(missing_docs)]

pub mod check;
#[cfg(feature = "cli")]
pub mod cli;
pub mod compare;
pub mod error;
#[doc = include_str!("estimators.md")]
pub mod estimators {}
pub mod gather;
pub mod geometry;
pub mod image;
pub mod light;
pub mod math;
pub mod medium;
pub mod photon;
mod quantity;
pub mod render;
#[cfg(feature = "report")]
pub mod report;
pub mod scene;
pub mod surface;
pub mod transport;

pub use error::{Error, Result};
