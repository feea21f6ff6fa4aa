//! Voxels for rendering: bricks of 8³ values behind an index, in index space.
//!
//! A voxel's value sits at its integer coordinates. Between voxels the density is trilinear, or that of
//! the nearest voxel; beyond all voxels it is the background. Cubes of one value are an entry in the
//! index, whatever their size. The index is an array over the occupied range of bricks where that is
//! not much larger than the bricks themselves, and otherwise the three levels of an OpenVDB tree.
//!
//! A *cell* is what the eight voxels around it interpolate: the cube from voxel (i, j, k) to
//! (i+1, j+1, k+1). A brick answers for the cells at its 8³ voxels, and so its majorant spans one more
//! layer of voxels, the *apron*, that belongs to its upper neighbours.

mod build;
mod index;
mod interpolate;
#[cfg(test)]
mod tests;
mod values;
mod walk;

pub use values::Precision;
pub use walk::Cell;

use crate::math::{Bounds, DVec3};
use index::{Index, Range};
use values::Values;

/// What becomes of negative voxels.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum NegativePolicy {
    /// The grid is refused.
    Error,
    /// They count as 0.
    Zero,
}

/// The density between voxels.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Interpolation {
    /// Linear along each axis, continuous.
    Trilinear,
    /// That of the nearest voxel: constant on cubes centred on voxels.
    Nearest,
}

/// Voxels in bricks of 8³ behind an index, in index space.
#[derive(Clone)]
pub struct BrickGrid {
    background: f32,
    interpolation: Interpolation,
    values: Values,
    /// The least and greatest value of each brick.
    own_ranges: Vec<Range>,
    index: Index,
    /// The first and last voxel along each axis that differ from the background.
    occupied: Option<([i32; 3], [i32; 3])>,
    active: Active,
    max: f32,
}

/// Sums over active voxels.
#[derive(Clone, Copy)]
struct Active {
    count: u64,
    sum: f64,
    min: f32,
    max: f32,
}

impl std::fmt::Debug for BrickGrid {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("BrickGrid").field("bricks", &self.bricks()).field("occupied", &self.occupied).finish()
    }
}

impl BrickGrid {
    /// With another density between its voxels.
    pub fn with_interpolation(self, interpolation: Interpolation) -> BrickGrid {
        BrickGrid { interpolation, ..self }
    }

    /// With values kept so exactly; what is rounded stays so.
    pub fn with_precision(self, precision: Precision) -> BrickGrid {
        match precision {
            Precision::Full => self,
            Precision::Half => self.halved(),
        }
    }

    /// How the density behaves between voxels.
    pub fn interpolation(&self) -> Interpolation {
        self.interpolation
    }

    /// The density where there are no voxels.
    pub fn background(&self) -> f32 {
        self.background
    }

    /// The greatest density anywhere, the background included.
    pub fn max(&self) -> f32 {
        self.max
    }

    /// A voxel with the greatest density, unless only the background has it or voxels are too far apart to look at all.
    pub fn densest(&self) -> Option<[i32; 3]> {
        const MOST_BRICKS: f64 = 1e7;
        let (lo, hi) = self.occupied.map(|(lo, hi)| (lo.map(|x| x >> 3), hi.map(|x| x >> 3)))?;
        if (0..3).map(|axis| f64::from(hi[axis]) - f64::from(lo[axis]) + 1.0).product::<f64>() > MOST_BRICKS {
            return None;
        }
        let cube = |lo: [i32; 3], hi: [i32; 3]| {
            (lo[0]..=hi[0])
                .flat_map(move |i| (lo[1]..=hi[1]).flat_map(move |j| (lo[2]..=hi[2]).map(move |k| [i, j, k])))
        };
        let brick = cube(lo, hi).find(|&brick| self.brick_max(brick) == self.max)?;
        let first = brick.map(|x| x << 3);
        cube(first, first.map(|x| x + 7)).find(|&[i, j, k]| self.value_at(i, j, k) == self.max)
    }

    /// The least value of an active voxel; infinite without any.
    pub fn min_active(&self) -> f32 {
        self.active.min
    }

    /// The greatest value of an active voxel; negative infinite without any.
    pub fn max_active(&self) -> f32 {
        self.active.max
    }

    /// How many voxels are active.
    pub fn active_voxels(&self) -> u64 {
        self.active.count
    }

    /// The sum over the active voxels.
    pub fn sum(&self) -> f64 {
        self.active.sum
    }

    /// How many bricks are stored.
    pub fn bricks(&self) -> usize {
        self.own_ranges.len()
    }

    /// The memory taken, in bytes.
    pub fn bytes(&self) -> usize {
        let index = match &self.index {
            Index::Dense { codes, ranges, .. } => size_of_val(&codes[..]) + size_of_val(&ranges[..]),
            Index::Sparse(index) => {
                let nodes = index.upper.iter().chain(&index.lower);
                size_of_val(&index.roots[..]) + nodes.map(|node| size_of_val(&node[..])).sum::<usize>()
            }
        };
        index + self.values.bytes() + size_of_val(&self.own_ranges[..])
    }

    /// Where the density can differ from the background, in index space: lower faces included, upper
    /// ones not. Empty if it differs nowhere.
    pub fn support(&self) -> Bounds {
        let Some((lo, hi)) = self.cell_range() else { return Bounds::EMPTY };
        let shift = self.shift();
        Bounds { min: DVec3::from_array(lo.map(f64::from)) - shift, max: DVec3::from_array(hi.map(f64::from)) - shift }
    }

    /// The first cell and beyond the last along each axis that is not all background.
    fn cell_range(&self) -> Option<([i32; 3], [i32; 3])> {
        let reach = (self.interpolation == Interpolation::Trilinear) as i32;
        self.occupied.map(|(first, last)| (first.map(|x| x - reach), last.map(|x| x + 1)))
    }

    /// From positions to the coordinates of cells.
    fn shift(&self) -> DVec3 {
        match self.interpolation {
            Interpolation::Trilinear => DVec3::ZERO,
            Interpolation::Nearest => DVec3::splat(0.5),
        }
    }
}
