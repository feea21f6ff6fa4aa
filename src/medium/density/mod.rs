//! How a medium's density ρ(x) varies over space.
//!
//! A kind of density is one file and is listed in [`Density`], in the scene's description, and where scene files are
//! read and built. Everybody else asks: whether it is even or endless, its greatest value, its depth along a ray and
//! where that is reached, the knots to interpolate it by, the length of its features, and for the voxels it may be
//! made of, which give local majorants and cells.

pub mod bricks;
mod coarse;
mod exponential;
mod grid;
mod noise;
pub mod npy;
pub mod vdb;

pub use coarse::Coarse;
pub use exponential::Exponential;
pub use grid::Grid;
pub use noise::Noise;

use crate::math::{Bounds, DAffine3, DVec3, Ray};

/// A density, one of the kinds a scene file can name. A constant value is folded into the medium's
/// coefficients; arrays and noise are voxels too.
#[derive(Clone, Debug)]
pub enum Density {
    /// ρ = 1 everywhere.
    Uniform,
    /// An atmosphere that thins out with height.
    Exponential(Exponential),
    /// Voxels: of a file, an array or noise.
    Grid(Grid),
}

/// Knots of a table of depths on a ray through a density without voxels.
const KNOTS: usize = 256;

impl Density {
    /// Whether it is the same everywhere.
    pub fn is_even(&self) -> bool {
        matches!(self, Density::Uniform)
    }

    /// Whether it is known to be the same as another at each point.
    pub fn is_that(&self, other: &Density) -> bool {
        match (self, other) {
            (Density::Uniform, Density::Uniform) => true,
            (Density::Exponential(one), Density::Exponential(other)) => one == other,
            (Density::Grid(one), Density::Grid(other)) => one.is_that(other),
            _ => false,
        }
    }

    /// Whether it goes on without an end and thins out in no direction: light from infinity does not get through.
    pub fn is_endless(&self) -> bool {
        match self {
            Density::Uniform => true,
            Density::Exponential(_) => false,
            Density::Grid(density) => density.voxels().background() > 0.0 && !density.support().size().is_finite(),
        }
    }

    /// Carried along by a transform of the scene.
    pub fn moved(&self, transform: DAffine3) -> Density {
        match self {
            Density::Uniform => Density::Uniform,
            Density::Exponential(density) => Density::Exponential(density.moved(transform)),
            Density::Grid(density) => Density::Grid(density.moved(transform)),
        }
    }

    /// The length over which it is nearly linear: a voxel's width, an eighth of a scale height; infinite where it is even.
    pub fn feature_length(&self) -> f64 {
        match self {
            Density::Uniform => f64::INFINITY,
            Density::Exponential(density) => density.feature_length(),
            Density::Grid(density) => density.voxel_size(),
        }
    }

    /// The voxels it is made of, through which rays are tracked by local majorants; `None` where the depth along a ray
    /// has a closed form, which [`Density::advance`] inverts.
    pub fn voxels(&self) -> Option<&Grid> {
        match self {
            Density::Grid(grid) => Some(grid),
            _ => None,
        }
    }

    /// The density ρ at the point `p`.
    pub fn at(&self, p: DVec3) -> f64 {
        match self {
            Density::Uniform => 1.0,
            Density::Exponential(density) => density.at(p),
            Density::Grid(density) => density.at(p),
        }
    }

    /// An upper bound of ρ that holds everywhere; voxels reach it.
    pub fn max(&self) -> f64 {
        match self {
            Density::Uniform => 1.0,
            Density::Exponential(density) => density.value,
            Density::Grid(density) => density.max(),
        }
    }

    /// A box outside of which ρ is 0; infinite where there is none.
    pub fn support(&self) -> Bounds {
        match self {
            Density::Uniform | Density::Exponential(_) => Bounds::ALL,
            Density::Grid(density) => density.support(),
        }
    }

    /// D = ∫ρ dt from `t0` to `t1`, which may be infinite; exact up to rounding.
    pub fn depth(&self, ray: &Ray, t0: f64, t1: f64) -> f64 {
        match self {
            Density::Uniform => t1 - t0,
            Density::Exponential(density) => density.depth(ray, t0, t1),
            Density::Grid(density) => density.depth(ray, t0, t1),
        }
    }

    /// Calls `knot(t, depth, density)` at places between `t0` and `t1` from which the depth since `t0` can be
    /// interpolated, by cubics that know the density at their ends, in the order of t; none where it is even. A cell
    /// of voxels over whose depth `is_long` says so has a knot in its middle, too.
    pub fn knots(
        &self,
        ray: &Ray,
        (t0, t1): (f64, f64),
        is_long: impl Fn(f64) -> bool,
        knot: impl FnMut(f64, f64, f64),
    ) {
        match self {
            Density::Uniform => {}
            Density::Grid(grid) => grid.knots(ray, (t0, t1), is_long, knot),
            Density::Exponential(air) => spaced((t0, t1), |t| (air.depth(ray, t0, t), air.at(ray.at(t))), knot),
        }
    }

    /// Where between `t0` and `t1` the depth since `t0` reaches `target`; `None` if it does not.
    pub fn advance(&self, ray: &Ray, t0: f64, t1: f64, target: f64) -> Option<f64> {
        match self {
            Density::Uniform => (target <= t1 - t0).then(|| (t0 + target).min(t1)),
            Density::Exponential(density) => density.advance(ray, t0, t1, target),
            Density::Grid(density) => density.advance(ray, t0, t1, target),
        }
    }
}

/// Calls `knot` at evenly spaced places with what `known` tells there: a depth and a density.
fn spaced((t0, t1): (f64, f64), known: impl Fn(f64) -> (f64, f64), mut knot: impl FnMut(f64, f64, f64)) {
    for i in 1..=KNOTS {
        let t = t0 + (t1 - t0) * i as f64 / KNOTS as f64;
        let (depth, density) = known(t);
        knot(t, depth, density);
    }
}
