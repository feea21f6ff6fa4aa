//! Phase functions: how scattered light spreads over directions.
//!
//! All are normalised over the sphere, and depend on the cosine between the direction light travels
//! in before and after scattering; *forward*, the unchanged direction, has cosine +1.
//!
//! [`Phase::value`], [`Phase::density`] and [`Phase::sample`] agree: `sample` draws directions whose density per
//! steradian is `density`, and says it with each; since all kinds are drawn from the phase function itself, that is
//! `value`.
//!
//! A kind is one file: a struct that answers what `Kind` asks, and its form in lanes. It is listed in [`Phase`], its form
//! in `term::Form`, and where scene files are read; nowhere else are kinds told apart.

mod all;
mod draine;
mod henyey_greenstein;
mod isotropic;
mod kind;
mod mie;
mod peak;
mod rayleigh;
mod schlick;
mod term;
#[cfg(test)]
mod tests;

pub use all::{Mixture, Phase};
pub use draine::Draine;
pub use henyey_greenstein::HenyeyGreenstein;
pub use isotropic::Isotropic;
pub(crate) use kind::Arithmetic;
pub use mie::{LARGEST_DIAMETER, mie};
pub(crate) use peak::Broad;
pub use peak::Peak;
pub use rayleigh::Rayleigh;
pub use schlick::Schlick;
pub(crate) use term::Term;
