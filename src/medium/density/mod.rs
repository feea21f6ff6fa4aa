//! How a medium's density ρ(x) varies over space.
//!
//! A kind of density is one file and is listed in [`Density`], in the scene's description, and where scene files are
//! read and built. Everybody else asks: whether it is even or endless, its greatest value, its depth along a ray and
//! where that is reached, the knots to interpolate it by, the length of its features, and for the voxels it may be
//! made of, which give local majorants and cells. A sum of densities, where media add up, is one, too.

pub mod bricks;
mod coarse;
mod exponential;
mod grid;
mod noise;
pub mod npy;
mod sum;
pub mod vdb;

pub use coarse::Coarse;
pub use exponential::Exponential;
pub use grid::Grid;
pub use noise::Noise;
pub use sum::{Part, Sum};

use crate::math::{Bounds, DAffine3, DVec3, Ray};

/// A density, one of the kinds a scene file can name, or a sum of them. A constant value is folded into the medium's
/// coefficients; arrays and noise are voxels too.
#[derive(Clone, Debug)]
pub enum Density {
    /// ρ = 1 everywhere.
    Uniform,
    /// An atmosphere that thins out with height.
    Exponential(Exponential),
    /// Voxels: of a file, an array or noise.
    Grid(Grid),
    /// Those of several media that fill the same space.
    Sum(Sum),
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
            (Density::Sum(one), Density::Sum(other)) => one.is_that(other),
            _ => false,
        }
    }

    /// Whether it goes on without an end and thins out in no direction: light from infinity does not get through.
    pub fn is_endless(&self) -> bool {
        match self {
            Density::Uniform => true,
            Density::Exponential(_) => false,
            Density::Grid(density) => density.voxels().background() > 0.0 && !density.support().size().is_finite(),
            Density::Sum(density) => density.parts().iter().any(|part| part.density.is_endless()),
        }
    }

    /// Carried along by a transform of the scene.
    pub fn moved(&self, transform: DAffine3) -> Density {
        match self {
            Density::Uniform => Density::Uniform,
            Density::Exponential(density) => Density::Exponential(density.moved(transform)),
            Density::Grid(density) => Density::Grid(density.moved(transform)),
            Density::Sum(density) => Density::Sum(density.moved(transform)),
        }
    }

    /// The length over which it is nearly linear: a voxel's width, an eighth of a scale height; infinite where it is even, of a sum the
    /// least.
    pub fn feature_length(&self) -> f64 {
        match self {
            Density::Uniform => f64::INFINITY,
            Density::Exponential(density) => density.feature_length(),
            Density::Grid(density) => density.voxel_size(),
            Density::Sum(density) => density.feature_length(),
        }
    }

    /// The voxels that it is made of, or a part of it.
    pub fn grids(&self) -> impl Iterator<Item = &Grid> {
        let (alone, sum) = match self {
            Density::Grid(grid) => (Some(grid), None),
            Density::Sum(sum) => (None, Some(sum)),
            Density::Uniform | Density::Exponential(_) => (None, None),
        };
        alone.into_iter().chain(sum.into_iter().flat_map(Sum::grids).map(|(_, grid)| grid))
    }

    /// Whether rays are tracked through voxels by local majorants; if not, depths have closed forms.
    pub fn has_voxels(&self) -> bool {
        match self {
            Density::Uniform | Density::Exponential(_) => false,
            Density::Grid(_) => true,
            Density::Sum(sum) => sum.grids().next().is_some(),
        }
    }

    /// Whether [`Density::coarse`] tells about how dense it is: it has voxels, and an end or the same density beyond them.
    pub fn has_cells(&self) -> bool {
        match self {
            Density::Uniform | Density::Exponential(_) => false,
            Density::Grid(grid) => grid.coarse().is_some(),
            Density::Sum(sum) => sum.has_cells(),
        }
    }

    /// Calls `visit(from, to, density)` on consecutive pieces of the ray between `a` and `b`, with about how dense it is there, where that
    /// is not 0: see [`Coarse`].
    pub fn coarse(&self, ray: &Ray, range: (f64, f64), visit: impl FnMut(f64, f64, f64)) {
        match self {
            Density::Uniform | Density::Exponential(_) => {}
            Density::Grid(grid) => {
                if let Some(coarse) = grid.coarse() {
                    coarse.pieces(ray, range, visit);
                }
            }
            Density::Sum(sum) => sum.coarse(ray, range, visit),
        }
    }

    /// The density ρ at the point `p`.
    pub fn at(&self, p: DVec3) -> f64 {
        match self {
            Density::Uniform => 1.0,
            Density::Exponential(density) => density.at(p),
            Density::Grid(density) => density.at(p),
            Density::Sum(density) => density.at(p),
        }
    }

    /// An upper bound of ρ that holds everywhere; voxels alone reach it.
    pub fn max(&self) -> f64 {
        match self {
            Density::Uniform => 1.0,
            Density::Exponential(density) => density.value,
            Density::Grid(density) => density.max(),
            Density::Sum(density) => density.max(),
        }
    }

    /// A box outside of which ρ is 0; infinite where there is none.
    pub fn support(&self) -> Bounds {
        match self {
            Density::Uniform | Density::Exponential(_) => Bounds::ALL,
            Density::Grid(density) => density.support(),
            Density::Sum(density) => density.support(),
        }
    }

    /// D = ∫ρ dt from `t0` to `t1`, which may be infinite; exact up to rounding.
    pub fn depth(&self, ray: &Ray, t0: f64, t1: f64) -> f64 {
        match self {
            Density::Uniform => t1 - t0,
            Density::Exponential(density) => density.depth(ray, t0, t1),
            Density::Grid(density) => density.depth(ray, t0, t1),
            Density::Sum(density) => density.depth(ray, t0, t1),
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
            Density::Sum(sum) => sum.knots(ray, (t0, t1), is_long, knot),
            Density::Exponential(air) => spaced((t0, t1), |t| (air.depth(ray, t0, t), air.at(ray.at(t))), knot),
        }
    }

    /// Where between `t0` and `t1` the depth since `t0` reaches `target`; `None` if it does not.
    pub fn advance(&self, ray: &Ray, t0: f64, t1: f64, target: f64) -> Option<f64> {
        match self {
            Density::Uniform => (target <= t1 - t0).then(|| (t0 + target).min(t1)),
            Density::Exponential(density) => density.advance(ray, t0, t1, target),
            Density::Grid(density) => density.advance(ray, t0, t1, target),
            Density::Sum(density) => density.advance(ray, t0, t1, target),
        }
    }
}

/// Where between `low` and `high` a depth reaches `target`: Newton's method from a `share` of the way on, kept between bounds. `told` is the
/// depth up to a place, and the density there.
#[inline(always)]
fn reached((mut low, mut high): (f64, f64), share: f64, target: f64, told: impl Fn(f64) -> (f64, f64)) -> f64 {
    let mut t = low + (high - low) * share.clamp(0.0, 1.0);
    for _ in 0..60 {
        let (depth, density) = told(t);
        let error = depth - target;
        if error.abs() <= 1e-7 * target {
            break;
        }
        if error > 0.0 {
            high = t
        } else {
            low = t
        }
        let next = t - error / density;
        t = if next > low && next < high { next } else { 0.5 * (low + high) };
    }
    t
}

/// Calls `knot` at evenly spaced places with what `known` tells there: a depth and a density.
fn spaced((t0, t1): (f64, f64), known: impl Fn(f64) -> (f64, f64), mut knot: impl FnMut(f64, f64, f64)) {
    for i in 1..=KNOTS {
        let t = t0 + (t1 - t0) * i as f64 / KNOTS as f64;
        let (depth, density) = known(t);
        knot(t, depth, density);
    }
}
