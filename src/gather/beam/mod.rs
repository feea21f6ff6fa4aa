//! The beam query: all in-scattered light along a ray segment as one sum over the photon discs that
//! it meets (Jarosz et al. 2008, Eq. 20–22),
//!
//! > L = Σᵢ K₂(ρᵢ/rᵢ)/rᵢ² · p(dᵢ → −ω) · T(tᵢ) · Pᵢ   over 0 < tᵢ < length, ρᵢ < rᵢ.
//!
//! - `query` is what is asked and found: it sums over all blocks of sixteen discs that the segment may meet.
//! - `descent` finds these blocks in the map's hierarchy.
//! - `frame` has the ray in coordinates of its own, which tell tᵢ and ρᵢ, and the spheres and boxes that it touches.
//! - `block` evaluates the terms of one block.
//! - `leaning` has what walls do to discs: they cut off a share of K₂, and some discs lean on them.
//! - `transmittance` is T, and how far a query goes where that is small.

mod block;
mod frame;
mod leaning;
mod listing;
mod query;
#[cfg(test)]
mod tests;
mod transmittance;

pub(super) use block::{Found, add_block};
pub(super) use frame::{RayFrame, Slabs};
pub(super) use listing::Listing;
pub use query::BeamQuery;
pub(super) use transmittance::{Coloured, Grey, Pruning, Transmit, exponents};
