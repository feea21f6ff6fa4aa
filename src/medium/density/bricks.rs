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

use super::vdb;
use crate::error::{Error, Result};
use crate::math::{Bounds, DVec3, Vec3};
use glam::Vec4;
use rayon::prelude::*;
use std::collections::HashMap;
use std::ops::ControlFlow;

/// What to do with negative voxels.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum NegativePolicy {
    /// Refuse the grid.
    #[default]
    Error,
    /// Take them for 0.
    Zero,
}

/// The density between voxels.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Interpolation {
    /// Linear along each axis, continuous.
    #[default]
    Trilinear,
    /// That of the nearest voxel: constant on cubes centred on voxels.
    Nearest,
}

/// A piece of a ray and the density at its ends and middle.
///
/// Within a cell the density along a ray is a cubic polynomial, which Simpson's rule integrates
/// exactly: (tb − ta) (ρ_a + 4 ρ_mid + ρ_b)/6.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cell {
    /// The ray's parameter where the piece begins.
    pub ta: f64,
    /// The ray's parameter where it ends; above `ta`.
    pub tb: f64,
    /// The density at `ta`.
    pub rho_a: f32,
    /// The density halfway.
    pub rho_mid: f32,
    /// The density at `tb`.
    pub rho_b: f32,
}

impl Cell {
    /// The integral of the density over the piece, in densities times the ray's parameter.
    pub fn integral(&self) -> f64 {
        let sum = self.rho_a as f64 + 4.0 * self.rho_mid as f64 + self.rho_b as f64;
        if sum == 0.0 { 0.0 } else { (self.tb - self.ta) * sum / 6.0 }
    }

    /// Whether the density is the same throughout.
    pub fn is_constant(&self) -> bool {
        self.rho_a == self.rho_mid && self.rho_mid == self.rho_b
    }
}

/// Voxels in bricks.
#[derive(Clone)]
pub struct BrickGrid {
    background: f32,
    interpolation: Interpolation,
    /// The values of each brick, z fastest, and then the constants.
    values: Vec<f32>,
    /// The least and greatest value of each brick.
    own_ranges: Vec<Range>,
    index: Index,
    /// The first and last voxel along each axis that differ from the background.
    occupied: Option<([i32; 3], [i32; 3])>,
    active: Active,
    max: f32,
}

/// Larger values are refused: interpolation would leave the range of `f32`.
const LARGEST: f32 = 1e30;

/// Sums over active voxels.
#[derive(Clone, Copy)]
struct Active {
    count: u64,
    sum: f64,
    min: f32,
    max: f32,
}

#[derive(Clone, Copy, PartialEq)]
struct Range {
    min: f32,
    max: f32,
}

/// An entry of the index: a brick, a node of the next level, or, with this bit, a constant.
const CONSTANT: u32 = 1 << 31;
/// The background is the first of the constants.
const BACKGROUND: u32 = CONSTANT;

/// Where bricks are. Coordinates count bricks.
#[derive(Clone)]
enum Index {
    Dense {
        min: [i32; 3],
        size: [u32; 3],
        codes: Vec<u32>,
        /// The least and greatest value of each entry's voxels and apron.
        ranges: Vec<Range>,
    },
    Sparse(SparseIndex),
}

/// The levels of an OpenVDB tree.
#[derive(Clone, Default)]
struct SparseIndex {
    /// Sorted by coordinates, which count cubes of 512³ bricks.
    roots: Vec<([i32; 3], u32)>,
    /// Nodes of 32³ entries of 16³ bricks each.
    upper: Vec<Box<[u32]>>,
    /// Nodes of 16³ entries of one brick each.
    lower: Vec<Box<[u32]>>,
}

/// A brick or a cube of bricks on the way of a ray.
struct Block {
    /// The lowest brick.
    lo: [i32; 3],
    /// Beyond the highest brick.
    hi: [i32; 3],
    code: u32,
    range: Range,
}

/// A ray in the coordinates of cells: nearest voxels are cells shifted by half.
struct IndexRay {
    origin: DVec3,
    direction: DVec3,
    inverse: DVec3,
}

impl std::fmt::Debug for BrickGrid {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("BrickGrid").field("bricks", &self.values.len()).field("occupied", &self.occupied).finish()
    }
}

impl BrickGrid {
    /// The voxels of `grid`, to be interpolated trilinearly.
    ///
    /// Inactive voxels count with the value OpenVDB gives them: as stored, or the background.
    ///
    /// # Errors
    /// [`Error::Asset`] for a level set, for voxels that are not finite or (under
    /// [`NegativePolicy::Error`]) negative, with their count, and for voxels beyond ±2³⁰.
    pub fn from_vdb(grid: &vdb::Grid, negative: NegativePolicy) -> Result<BrickGrid> {
        let fail = |message: String| Error::asset(&grid.path, format!("grid {:?}: {message}", grid.name));
        if grid.class == vdb::GridClass::LevelSet {
            return Err(fail(
                "is a level set: its values are distances to a surface, not densities; convert it to a fog volume"
                    .into(),
            ));
        }
        let mut builder = Builder::new(grid.background, negative);
        for leaf in &grid.leaves {
            builder.add_leaf(leaf.origin, &leaf.active, &leaf.values);
        }
        for tile in grid.tiles() {
            builder.add_tile(&tile);
        }
        builder.finish().map_err(fail)
    }

    /// `values` in z, y, x order (x fastest) from voxel `origin` on, all active; `background` beyond.
    ///
    /// # Errors
    /// [`Error::Limit`] if `values` has another length than `dims` say, and as [`BrickGrid::from_vdb`] for values
    /// out of range.
    pub fn from_dense(
        origin: [i32; 3],
        dims: [usize; 3],
        values: &[f32],
        background: f32,
        negative: NegativePolicy,
    ) -> Result<BrickGrid> {
        let [nx, ny, nz] = dims;
        if nx.checked_mul(ny).and_then(|n| n.checked_mul(nz)) != Some(values.len()) {
            return Err(Error::Limit(format!("{} values for an array of {nx} x {ny} x {nz}", values.len())));
        }
        let mut builder = Builder::new(background, negative);
        let end: [i64; 3] = std::array::from_fn(|axis| origin[axis] as i64 + dims[axis] as i64);
        if (0..3).any(|axis| out_of_reach(origin[axis] as i64, end[axis])) {
            return Err(Error::Limit(format!("an array of {nx} x {ny} x {nz} from {origin:?} is out of reach")));
        }
        if !values.is_empty() {
            let bricks = |axis: usize| origin[axis] >> 3..=(end[axis] as i32 - 1) >> 3;
            let mut brick = [background; 512];
            for bx in bricks(0) {
                for by in bricks(1) {
                    for bz in bricks(2) {
                        let lowest = [8 * bx, 8 * by, 8 * bz];
                        let mut active = [0_u64; 8];
                        for (n, value) in brick.iter_mut().enumerate() {
                            let local = [n >> 6, n >> 3 & 7, n & 7];
                            let at: [usize; 3] = std::array::from_fn(|axis| {
                                (lowest[axis] + local[axis] as i32).wrapping_sub(origin[axis]) as u32 as usize
                            });
                            let inside = at[0] < nx && at[1] < ny && at[2] < nz;
                            *value = if inside { values[(at[2] * ny + at[1]) * nx + at[0]] } else { background };
                            active[n >> 6] |= (inside as u64) << (n & 63);
                        }
                        builder.add_leaf(lowest, &active, &brick);
                    }
                }
            }
        }
        builder.finish().map_err(Error::Limit)
    }

    /// The voxels of these bricks, none of which is named twice, from a function of the voxel; 0 beyond.
    ///
    /// # Errors
    /// As [`BrickGrid::from_dense`] for values out of range.
    pub fn from_function(bricks: &[[i32; 3]], value: impl Fn([i32; 3]) -> f32 + Sync) -> Result<BrickGrid> {
        // Values of so many bricks wait to be indexed.
        const AT_ONCE: usize = 1 << 12;
        let mut builder = Builder::new(0.0, NegativePolicy::Error);
        for batch in bricks.chunks(AT_ONCE) {
            let fill = |brick: &[i32; 3]| -> [f32; 512] {
                std::array::from_fn(|n| {
                    let local = [n >> 6, n >> 3 & 7, n & 7];
                    value(std::array::from_fn(|axis| 8 * brick[axis] + local[axis] as i32))
                })
            };
            let filled: Vec<[f32; 512]> = batch.par_iter().map(fill).collect();
            for (brick, values) in batch.iter().zip(&filled) {
                builder.add_leaf(brick.map(|x| 8 * x), &[u64::MAX; 8], values);
            }
        }
        builder.finish().map_err(Error::Limit)
    }

    /// The same voxels, interpolated in another way.
    pub fn with_interpolation(self, interpolation: Interpolation) -> BrickGrid {
        BrickGrid { interpolation, ..self }
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
        index + size_of_val(&self.values[..]) + size_of_val(&self.own_ranges[..])
    }

    /// Where the density can differ from the background, in index space: lower faces included, upper
    /// ones not. Empty if it differs nowhere.
    pub fn support(&self) -> Bounds {
        let Some((lo, hi)) = self.cell_range() else { return Bounds::EMPTY };
        let shift = self.shift();
        Bounds { min: DVec3::from_array(lo.map(f64::from)) - shift, max: DVec3::from_array(hi.map(f64::from)) - shift }
    }

    /// The value of voxel (i, j, k).
    pub fn value_at(&self, i: i32, j: i32, k: i32) -> f32 {
        let (place, mask) = self.place(self.code([i >> 3, j >> 3, k >> 3]));
        self.values[place + (offset([i & 7, j & 7, k & 7]) & mask)]
    }

    /// The density at `p`, in index space.
    #[inline]
    pub fn density(&self, p: DVec3) -> f32 {
        match self.interpolation {
            Interpolation::Trilinear => self.trilinear(p),
            Interpolation::Nearest => self.nearest(p),
        }
    }

    /// The value of the voxel nearest to `p`; halfway, that of the upper one.
    #[inline]
    pub fn nearest(&self, p: DVec3) -> f32 {
        self.value_at(floor(p.x + 0.5), floor(p.y + 0.5), floor(p.z + 0.5))
    }

    /// The density at `p` interpolated between the eight voxels around it.
    #[inline]
    pub fn trilinear(&self, p: DVec3) -> f32 {
        let i = [floor(p.x), floor(p.y), floor(p.z)];
        let brick = i.map(|i| i >> 3);
        let local = i.map(|i| i & 7);
        let crosses = local.contains(&7);
        let fraction = |axis: usize| (p[axis] - i[axis] as f64) as f32;
        if !crosses {
            let code = self.code(brick);
            if code & CONSTANT != 0 {
                return self.constant(code);
            }
            return interpolate(&corners_inside(self.brick(code), local), [fraction(0), fraction(1), fraction(2)]);
        }
        let corners = self.corners_across(&self.codes_near(brick).map(|code| self.place(code)), local);
        // Far beyond the bricks a coordinate may not fit an `i32`.
        interpolate(&corners, [0, 1, 2].map(|axis| fraction(axis).clamp(0.0, 1.0)))
    }

    /// Calls `visit(ta, tb, max, min)` with bounds of the density on consecutive pieces of the ray
    /// `origin + t direction`, in index space, `direction` of any length. The pieces tile [t0, t1].
    ///
    /// Bounds hold up to the rounding of `f32` interpolation, 10⁻⁶ of the grid's maximum.
    /// One bound for each brick, those with equal bounds joined.
    pub fn majorants<B>(
        &self,
        origin: DVec3,
        direction: DVec3,
        t0: f64,
        t1: f64,
        mut visit: impl FnMut(f64, f64, f64, f64) -> ControlFlow<B>,
    ) -> ControlFlow<B> {
        let ray = IndexRay::new(origin + self.shift(), direction);
        let mut pending: Option<(f64, f64, Range)> = None;
        self.walk_blocks(&ray, t0, t1, |a, b, block| {
            match &mut pending {
                Some((_, end, range)) if *range == block.range => *end = b,
                _ => {
                    if let Some((a, b, range)) = pending.replace((a, b, block.range)) {
                        return visit(a, b, range.max as f64, range.min as f64);
                    }
                }
            }
            ControlFlow::Continue(())
        })?;
        match pending {
            Some((a, b, range)) => visit(a, b, range.max as f64, range.min as f64),
            None => ControlFlow::Continue(()),
        }
    }

    /// Visits the cells that the ray `origin + t direction` crosses within [t0, t1], in index space,
    /// `direction` of any length. The pieces tile [t0, t1]; where the density is constant over whole
    /// bricks one piece stands for many cells.
    pub fn walk_cells<B>(
        &self,
        origin: DVec3,
        direction: DVec3,
        t0: f64,
        t1: f64,
        visit: impl FnMut(Cell) -> ControlFlow<B>,
    ) -> ControlFlow<B> {
        match self.interpolation {
            Interpolation::Trilinear => self.walk_cells_as::<true, B>(origin, direction, t0, t1, visit),
            Interpolation::Nearest => self.walk_cells_as::<false, B>(origin, direction, t0, t1, visit),
        }
    }

    fn walk_cells_as<const TRILINEAR: bool, B>(
        &self,
        origin: DVec3,
        direction: DVec3,
        t0: f64,
        t1: f64,
        mut visit: impl FnMut(Cell) -> ControlFlow<B>,
    ) -> ControlFlow<B> {
        let constant = |ta, tb, rho| Cell { ta, tb, rho_a: rho, rho_mid: rho, rho_b: rho };
        let ray = IndexRay::new(origin + self.shift(), direction);
        let mut pending: Option<(f64, f64, f32)> = None;
        self.walk_blocks(&ray, t0, t1, |a, b, block| {
            if block.range.min == block.range.max {
                match &mut pending {
                    Some((_, end, rho)) if *rho == block.range.max => *end = b,
                    _ => {
                        if let Some((a, b, rho)) = pending.replace((a, b, block.range.max)) {
                            return visit(constant(a, b, rho));
                        }
                    }
                }
                return ControlFlow::Continue(());
            }
            if let Some((a, b, rho)) = pending.take() {
                visit(constant(a, b, rho))?;
            }
            self.walk_brick::<TRILINEAR, B>(&ray, a, b, &block, &mut visit)
        })?;
        match pending {
            Some((a, b, rho)) => visit(constant(a, b, rho)),
            None => ControlFlow::Continue(()),
        }
    }

    /// The integral of the density over [t0, t1] along `origin + t direction`, in densities times t.
    pub fn integral(&self, origin: DVec3, direction: DVec3, t0: f64, t1: f64) -> f64 {
        let mut sum = 0.0;
        let _ = self.walk_cells(origin, direction, t0, t1, |cell| {
            sum += cell.integral();
            ControlFlow::<()>::Continue(())
        });
        sum
    }

    /// Walks the cells of one brick from `a` to `b`.
    #[inline]
    fn walk_brick<const TRILINEAR: bool, B>(
        &self,
        ray: &IndexRay,
        a: f64,
        b: f64,
        block: &Block,
        visit: &mut impl FnMut(Cell) -> ControlFlow<B>,
    ) -> ControlFlow<B> {
        // Positions are relative to the brick from here on: there `f32` has room for 10⁻⁶ of a voxel.
        let o = ray.origin - DVec3::from_array(block.lo.map(|x| 8.0 * x as f64));
        let start = o + a * ray.direction;
        let mut cell = [0; 3];
        let mut step = [0; 3];
        let mut plane_t = [f64::INFINITY; 3];
        for axis in 0..3 {
            cell[axis] = floor(start[axis]).clamp(0, 7);
            let d = ray.direction[axis];
            if d != 0.0 {
                step[axis] = if d > 0.0 { 1 } else { -1 };
                plane_t[axis] = ((cell[axis] + (d > 0.0) as i32) as f64 - o[axis]) * ray.inverse[axis];
            }
        }
        let stored = (block.code & CONSTANT == 0).then(|| self.brick(block.code));
        let mut near: Option<[(usize, usize); 8]> = None;

        let mut ta = a;
        let mut from = start.as_vec3();
        loop {
            let axis = if plane_t[0] < plane_t[1] && plane_t[0] < plane_t[2] {
                0
            } else if plane_t[1] < plane_t[2] {
                1
            } else {
                2
            };
            let tb = plane_t[axis].min(b);
            if tb > ta {
                let piece = if TRILINEAR {
                    let corners = match stored {
                        Some(values) if !cell.contains(&7) => corners_inside(values, cell),
                        _ => {
                            let near =
                                near.get_or_insert_with(|| self.codes_near(block.lo).map(|code| self.place(code)));
                            self.corners_across(near, cell)
                        }
                    };
                    let to = (start + (tb - a) * ray.direction).as_vec3();
                    let lowest = Vec3::new(cell[0] as f32, cell[1] as f32, cell[2] as f32);
                    let fa = (from - lowest).clamp(Vec3::ZERO, Vec3::ONE);
                    let fb = (to - lowest).clamp(Vec3::ZERO, Vec3::ONE);
                    from = to;
                    let [rho_a, rho_mid, rho_b] = interpolate_along(&corners, fa, fb);
                    Cell { ta, tb, rho_a, rho_mid, rho_b }
                } else {
                    let (place, mask) = self.place(block.code);
                    let rho = self.values[place + (offset(cell) & mask)];
                    Cell { ta, tb, rho_a: rho, rho_mid: rho, rho_b: rho }
                };
                visit(piece)?;
                ta = tb;
            }
            cell[axis] += step[axis];
            if tb >= b {
                return ControlFlow::Continue(());
            }
            if cell[axis] & !7 != 0 {
                // Rounding has put the brick's last plane before its end.
                cell[axis] -= step[axis];
                plane_t = [f64::INFINITY; 3];
            } else {
                let plane = cell[axis] + (step[axis] > 0) as i32;
                plane_t[axis] = (plane as f64 - o[axis]) * ray.inverse[axis];
            }
        }
    }

    /// Visits bricks, or larger cubes of one value, that tile [t0, t1].
    #[inline]
    fn walk_blocks<B>(
        &self,
        ray: &IndexRay,
        t0: f64,
        t1: f64,
        mut visit: impl FnMut(f64, f64, Block) -> ControlFlow<B>,
    ) -> ControlFlow<B> {
        let background = |a: f64, b: f64| {
            let range = Range { min: self.background, max: self.background };
            (a, b, Block { lo: [0; 3], hi: [0; 3], code: BACKGROUND, range })
        };
        let mut call = |(a, b, block): (f64, f64, Block)| {
            if a < b { visit(a, b, block) } else { ControlFlow::Continue(()) }
        };
        let Some((lo, hi)) = self.cell_range() else { return call(background(t0, t1)) };
        let Some((enter, exit)) = ray.clip(lo, hi, t0, t1) else { return call(background(t0, t1)) };
        call(background(t0, enter))?;

        let at = ray.origin + enter * ray.direction;
        let first = lo.map(|x| x >> 3);
        let last = hi.map(|x| (x - 1) >> 3);
        let mut brick: [i32; 3] = std::array::from_fn(|axis| (floor(at[axis]) >> 3).clamp(first[axis], last[axis]));
        let mut t = enter;
        while t < exit {
            let block = self.block(brick);
            let (lo, hi) = (block.lo, block.hi);
            let mut end = f64::INFINITY;
            let mut axis = 0;
            for a in 0..3 {
                let d = ray.direction[a];
                if d != 0.0 {
                    let plane = 8 * if d > 0.0 { hi[a] as i64 } else { lo[a] as i64 };
                    let t = (plane as f64 - ray.origin[a]) * ray.inverse[a];
                    if t < end {
                        (end, axis) = (t, a);
                    }
                }
            }
            let end = end.clamp(t, exit);
            call((t, end, block))?;
            t = end;
            if t < exit {
                // Strictly onwards along one axis and never back along the others.
                let at = ray.origin + t * ray.direction;
                for a in 0..3 {
                    let d = ray.direction[a];
                    if a == axis {
                        brick[a] = if d > 0.0 { hi[a] } else { lo[a] - 1 }.clamp(first[a], last[a]);
                    } else if hi[a] - lo[a] > 1 {
                        let new = (floor(at[a]) >> 3).clamp(lo[a], hi[a] - 1).clamp(first[a], last[a]);
                        brick[a] = if d > 0.0 { new.max(brick[a]) } else { new.min(brick[a]) };
                    }
                }
            }
        }
        call(background(exit, t1))
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

    #[inline]
    fn code(&self, brick: [i32; 3]) -> u32 {
        match &self.index {
            Index::Dense { min, size, codes, .. } => dense_entry(min, size, brick).map_or(BACKGROUND, |n| codes[n]),
            Index::Sparse(index) => index.find(brick).0,
        }
    }

    /// The brick, or the cube of equal bricks, around `brick`.
    #[inline]
    fn block(&self, brick: [i32; 3]) -> Block {
        let one = |code, range| Block { lo: brick, hi: brick.map(|x| x + 1), code, range };
        let index = match &self.index {
            Index::Dense { min, size, codes, ranges } => {
                return match dense_entry(min, size, brick) {
                    Some(n) => one(codes[n], ranges[n]),
                    None => one(BACKGROUND, Range { min: self.background, max: self.background }),
                };
            }
            Index::Sparse(index) => index,
        };
        let (code, log2) = index.find(brick);
        if code & CONSTANT != 0 && log2 > 0 {
            // The uppermost layers of a cube have their apron in other cubes. Below them the cube is all
            // one; in them it is, layer by layer, if those others are as large and of the same value.
            let lo = brick.map(|x| x >> log2 << log2);
            let top = lo.map(|x| x + (1 << log2) - 1);
            let crosses: [bool; 3] = std::array::from_fn(|axis| brick[axis] == top[axis]);
            let same = (1..8).all(|n| {
                let step: [i32; 3] = std::array::from_fn(|axis| n >> (2 - axis) & 1);
                (0..3).any(|axis| step[axis] == 1 && !crosses[axis]) || {
                    let (other, size) = index.find(std::array::from_fn(|axis| brick[axis] + step[axis]));
                    other == code && size >= log2
                }
            });
            if same {
                return Block {
                    lo: std::array::from_fn(|axis| if crosses[axis] { brick[axis] } else { lo[axis] }),
                    hi: std::array::from_fn(|axis| top[axis] + crosses[axis] as i32),
                    code,
                    range: self.own_range(code),
                };
            }
        }
        let range =
            self.codes_near(brick).into_iter().fold(Range::NONE, |range, code| range.union(self.own_range(code)));
        one(code, range)
    }

    /// The entries of a brick and its upper neighbours, z fastest.
    #[inline]
    fn codes_near(&self, brick: [i32; 3]) -> [u32; 8] {
        match &self.index {
            Index::Dense { min, size, codes, .. } => {
                // A step beyond a row's end leads to another's first entry: both layers are background.
                let Some(n) = dense_entry(min, size, brick) else { return [BACKGROUND; 8] };
                let (y, x) = (size[2] as usize, size[1] as usize * size[2] as usize);
                [0, 1, y, y + 1, x, x + 1, x + y, x + y + 1]
                    .map(|step| codes.get(n + step).map_or(BACKGROUND, |code| *code))
            }
            Index::Sparse(index) => std::array::from_fn(|n| {
                let step = [n >> 2 & 1, n >> 1 & 1, n & 1];
                index.find(std::array::from_fn(|axis| brick[axis] + step[axis] as i32)).0
            }),
        }
    }

    /// Where an entry's values are, and which bits of an offset count there.
    #[inline]
    fn place(&self, code: u32) -> (usize, usize) {
        if code & CONSTANT != 0 {
            (512 * self.own_ranges.len() + (code & !CONSTANT) as usize, 0)
        } else {
            (512 * code as usize, 511)
        }
    }

    #[inline]
    fn constant(&self, code: u32) -> f32 {
        self.values[self.place(code).0]
    }

    #[inline]
    fn brick(&self, code: u32) -> &[f32; 512] {
        &self.values.as_chunks().0[code as usize]
    }

    fn own_range(&self, code: u32) -> Range {
        if code & CONSTANT == 0 {
            return self.own_ranges[code as usize];
        }
        let value = self.constant(code);
        Range { min: value, max: value }
    }

    /// The corners of a cell that may reach into the brick's upper neighbours; `near` says where these are.
    #[inline]
    fn corners_across(&self, near: &[(usize, usize); 8], cell: [i32; 3]) -> [f32; 8] {
        let upper = cell.map(|x| (x as usize + 1) & 7);
        let crosses = cell.map(|x| (x == 7) as usize);
        std::array::from_fn(|n| {
            let pick = |axis: usize| if n >> (2 - axis) & 1 != 0 { upper[axis] } else { cell[axis] as usize };
            let neighbour = n & (crosses[0] << 2 | crosses[1] << 1 | crosses[2]);
            let (place, mask) = near[neighbour];
            self.values[place + ((pick(0) << 6 | pick(1) << 3 | pick(2)) & mask)]
        })
    }
}

impl Range {
    const NONE: Range = Range { min: f32::INFINITY, max: f32::NEG_INFINITY };

    fn union(self, other: Range) -> Range {
        Range { min: self.min.min(other.min), max: self.max.max(other.max) }
    }
}

impl IndexRay {
    fn new(origin: DVec3, direction: DVec3) -> Self {
        // So small a component that its inverse overflows moves the ray nowhere.
        let direction = DVec3::from_array(direction.to_array().map(|d| if d.recip().is_finite() { d } else { 0.0 }));
        IndexRay { origin, direction, inverse: direction.recip() }
    }

    /// The part of [t0, t1] inside the box of cells; its upper faces are outside.
    fn clip(&self, lo: [i32; 3], hi: [i32; 3], t0: f64, t1: f64) -> Option<(f64, f64)> {
        let (mut enter, mut exit) = (t0, t1);
        for axis in 0..3 {
            let (o, d) = (self.origin[axis], self.direction[axis]);
            let (lo, hi) = (lo[axis] as f64, hi[axis] as f64);
            if d == 0.0 {
                if !(lo..hi).contains(&o) {
                    return None;
                }
                continue;
            }
            let (near, far) = if d > 0.0 { (lo, hi) } else { (hi, lo) };
            enter = enter.max((near - o) * self.inverse[axis]);
            exit = exit.min((far - o) * self.inverse[axis]);
        }
        (enter < exit).then_some((enter, exit))
    }
}

/// Collects bricks and cubes of one value, then indexes them.
struct Builder {
    stored_background: f32,
    background: f32,
    negative: NegativePolicy,
    values: Vec<[f32; 512]>,
    constants: Vec<f32>,
    by_value: HashMap<u32, u32>,
    roots: HashMap<[i32; 3], u32>,
    index: SparseIndex,
    occupied: Option<([i32; 3], [i32; 3])>,
    active: Active,
    max: f32,
    bad: u64,
    below_zero: u64,
    lowest: f32,
    far: Option<[i32; 3]>,
}

impl Builder {
    fn new(background: f32, negative: NegativePolicy) -> Self {
        // As for voxels; what is out of range is refused in the end.
        let stored_background = background;
        let background = if background > 0.0 && background.is_finite() { background } else { 0.0 };
        let mut builder = Builder {
            stored_background,
            background,
            negative,
            values: Vec::new(),
            constants: Vec::new(),
            by_value: HashMap::new(),
            roots: HashMap::new(),
            index: SparseIndex::default(),
            occupied: None,
            active: Active { count: 0, sum: 0.0, min: f32::INFINITY, max: f32::NEG_INFINITY },
            max: background,
            bad: 0,
            below_zero: 0,
            lowest: 0.0,
            far: None,
        };
        builder.constant(background);
        builder
    }

    /// Counts what is out of range, and applies the policy.
    fn check(&mut self, value: f32, count: u64) -> f32 {
        if value.is_nan() || value.abs() > LARGEST {
            self.bad += count;
            return 0.0;
        }
        if value < 0.0 {
            if self.negative == NegativePolicy::Error {
                self.below_zero += count;
                self.lowest = self.lowest.min(value);
            }
            return 0.0;
        }
        // A zero has no sign.
        value + 0.0
    }

    fn constant(&mut self, value: f32) -> u32 {
        *self.by_value.entry(value.to_bits()).or_insert_with(|| {
            self.constants.push(value);
            CONSTANT | (self.constants.len() - 1) as u32
        })
    }

    fn add_active(&mut self, value: f32, count: u64) {
        self.active.count += count;
        self.active.sum += value as f64 * count as f64;
        self.active.min = self.active.min.min(value);
        self.active.max = self.active.max.max(value);
    }

    fn occupy(&mut self, first: [i32; 3], last: [i32; 3]) {
        if (0..3).any(|axis| out_of_reach(first[axis] as i64, last[axis] as i64)) {
            self.far.get_or_insert(first);
            return;
        }
        let (lo, hi) = self.occupied.get_or_insert((first, last));
        for axis in 0..3 {
            lo[axis] = lo[axis].min(first[axis]);
            hi[axis] = hi[axis].max(last[axis]);
        }
    }

    fn add_leaf(&mut self, origin: [i32; 3], active: &[u64; 8], stored: &[f32; 512]) {
        let mut values = [0.0; 512];
        let (mut first, mut last) = ([8; 3], [-1; 3]);
        for (n, (value, &stored)) in values.iter_mut().zip(stored).enumerate() {
            *value = self.check(stored, 1);
            self.max = self.max.max(*value);
            if active[n >> 6] >> (n & 63) & 1 != 0 {
                self.add_active(*value, 1);
            }
            if *value != self.background {
                let local = [n >> 6, n >> 3 & 7, n & 7];
                for axis in 0..3 {
                    first[axis] = local[axis].min(first[axis] as usize) as i32;
                    last[axis] = last[axis].max(local[axis] as i32);
                }
            }
        }
        if last[0] < 0 {
            return;
        }
        self.occupy(
            std::array::from_fn(|axis| origin[axis] + first[axis]),
            std::array::from_fn(|axis| origin[axis] + last[axis]),
        );
        let code = if values.iter().all(|value| *value == values[0]) {
            self.constant(values[0])
        } else {
            self.values.push(values);
            (self.values.len() - 1) as u32
        };
        self.enter(origin.map(|x| x >> 3), 0, code);
    }

    fn add_tile(&mut self, tile: &vdb::Tile) {
        let count = (tile.size as u64).pow(3);
        let value = self.check(tile.value, count);
        self.max = self.max.max(value);
        if tile.active {
            self.add_active(value, count);
        }
        if value != self.background {
            self.occupy(tile.origin, tile.origin.map(|x| x + (tile.size - 1)));
            let code = self.constant(value);
            self.enter(tile.origin.map(|x| x >> 3), tile.size.ilog2() - 3, code);
        }
    }

    fn finish(mut self) -> Result<BrickGrid, String> {
        let stored = self.stored_background;
        if !stored.is_finite() || stored < 0.0 && self.negative == NegativePolicy::Error {
            return Err(format!("its background is {stored}, expected a number not below 0"));
        }
        if self.bad > 0 {
            return Err(format!("{} voxels are infinite, above 10³⁰ or not numbers: repair the grid", self.bad));
        }
        if self.below_zero > 0 {
            return Err(format!(
                "{} voxels are negative, down to {}: densities must not be; set negative = \"zero\" to take them for 0",
                self.below_zero, self.lowest
            ));
        }
        if let Some(far) = self.far {
            return Err(format!("has voxels at {far:?}, beyond ±2^30"));
        }
        if self.values.len() >= CONSTANT as usize || self.constants.len() >= CONSTANT as usize {
            return Err("has more than 2^31 bricks".to_string());
        }
        let own_ranges = self.values.iter().map(|values| layer_range(values, 0)).collect();
        let mut sparse = std::mem::take(&mut self.index);
        sparse.roots = self.roots.drain().collect();
        sparse.roots.sort_unstable();
        let index = self.dense_index(&sparse).unwrap_or(Index::Sparse(sparse));
        let mut values = self.values.into_flattened();
        values.reserve_exact(self.constants.len());
        values.extend(self.constants);
        values.shrink_to_fit();
        Ok(BrickGrid {
            background: self.background,
            interpolation: Interpolation::Trilinear,
            values,
            own_ranges,
            index,
            occupied: self.occupied,
            active: self.active,
            max: self.max,
        })
    }

    /// Enters a cube of 2^`log2` bricks along an edge.
    fn enter(&mut self, brick: [i32; 3], log2: u32, code: u32) {
        fn node(nodes: &mut Vec<Box<[u32]>>, size: usize) -> u32 {
            nodes.push(vec![BACKGROUND; size].into());
            (nodes.len() - 1) as u32
        }
        let SparseIndex { upper, lower, .. } = &mut self.index;
        let root = self.roots.entry(brick.map(|x| x >> 9)).or_insert(BACKGROUND);
        if log2 == 9 {
            *root = code;
            return;
        }
        if *root & CONSTANT != 0 {
            *root = node(upper, 1 << 15);
        }
        let entry = &mut upper[*root as usize][upper_offset(brick)];
        if log2 == 4 {
            *entry = code;
            return;
        }
        if *entry & CONSTANT != 0 {
            *entry = node(lower, 1 << 12);
        }
        lower[*entry as usize][lower_offset(brick)] = code;
    }

    /// A dense index in place of the sparse one, if it is not too large.
    fn dense_index(&self, sparse: &SparseIndex) -> Option<Index> {
        // An entry takes 12 bytes, a brick 2048: the array may cost a third of the bricks, or 1 MB.
        const ALWAYS: u64 = 1 << 16;
        const PER_BRICK: u64 = 56;
        let budget = ALWAYS + PER_BRICK * self.values.len() as u64;
        let (first, last) = self.occupied.unwrap_or_default();
        // One more below, where cells reach up into the first bricks, and one more above for these.
        let min = first.map(|x| (x >> 3) - 1);
        let size: [u32; 3] = std::array::from_fn(|axis| ((last[axis] >> 3) - min[axis] + 2) as u32);
        let count = size.iter().try_fold(1_u64, |count, &n| count.checked_mul(n as u64)).filter(|n| *n <= budget)?;
        let brick = |n: usize, part: usize| {
            let (y, x) = (size[2] as usize, size[1] as usize * size[2] as usize);
            let local = [n / x + (part >> 2 & 1), n / y % size[1] as usize + (part >> 1 & 1), n % y + (part & 1)];
            std::array::from_fn(|axis| min[axis] + local[axis] as i32)
        };
        let codes: Vec<u32> = (0..count as usize).map(|n| sparse.find(brick(n, 0)).0).collect();

        // The ranges of those parts of each brick that lie in the apron of a lower neighbour.
        let parts: Vec<[Range; 8]> =
            self.values.iter().map(|values| std::array::from_fn(|part| layer_range(values, part))).collect();
        let range = |n: usize| {
            (0..8).fold(Range::NONE, |range, part| {
                let code = dense_entry(&min, &size, brick(n, part)).map_or(BACKGROUND, |n| codes[n]);
                let constant = self.constants.get((code & !CONSTANT) as usize).filter(|_| code & CONSTANT != 0);
                range.union(constant.map_or_else(|| parts[code as usize][part], |&c| Range { min: c, max: c }))
            })
        };
        let ranges = (0..codes.len()).map(range).collect();
        Some(Index::Dense { min, size, codes, ranges })
    }
}

impl SparseIndex {
    /// The entry for a brick, and the size of the cube it stands for in bricks, as a power of two.
    fn find(&self, brick: [i32; 3]) -> (u32, u32) {
        let root = brick.map(|x| x >> 9);
        let Ok(found) = self.roots.binary_search_by_key(&root, |root| root.0) else { return (BACKGROUND, 9) };
        let code = self.roots[found].1;
        if code & CONSTANT != 0 {
            return (code, 9);
        }
        let code = self.upper[code as usize][upper_offset(brick)];
        if code & CONSTANT != 0 {
            return (code, 4);
        }
        (self.lower[code as usize][lower_offset(brick)], 0)
    }
}

/// Whether voxels from `first` to `last` leave what `i32` arithmetic has room for.
fn out_of_reach(first: i64, last: i64) -> bool {
    first < -(1 << 30) || last > 1 << 30
}

/// The range of the voxels of a brick whose x, y, z is 0 where the bits 2, 1, 0 of `part` say so.
fn layer_range(values: &[f32; 512], part: usize) -> Range {
    let count = |bit: usize| if part >> bit & 1 != 0 { 1 } else { 8 };
    let mut range = Range::NONE;
    for x in 0..count(2) {
        for y in 0..count(1) {
            for value in &values[64 * x + 8 * y..][..count(0)] {
                range = range.union(Range { min: *value, max: *value });
            }
        }
    }
    range
}

#[inline]
fn dense_entry(min: &[i32; 3], size: &[u32; 3], brick: [i32; 3]) -> Option<usize> {
    let at: [u32; 3] = std::array::from_fn(|axis| brick[axis].wrapping_sub(min[axis]) as u32);
    (at[0] < size[0] && at[1] < size[1] && at[2] < size[2])
        .then(|| (at[0] as usize * size[1] as usize + at[1] as usize) * size[2] as usize + at[2] as usize)
}

fn upper_offset(brick: [i32; 3]) -> usize {
    brick.iter().fold(0, |n, x| n << 5 | (x >> 4 & 31) as usize)
}

fn lower_offset(brick: [i32; 3]) -> usize {
    brick.iter().fold(0, |n, x| n << 4 | (x & 15) as usize)
}

#[inline]
fn offset(local: [i32; 3]) -> usize {
    (local[0] << 6 | local[1] << 3 | local[2]) as usize & 511
}

/// The corners of a cell within a brick, z fastest.
#[inline]
fn corners_inside(values: &[f32; 512], cell: [i32; 3]) -> [f32; 8] {
    let n = offset(cell);
    let at = |step: usize| values[(n + step) & 511];
    [at(0), at(1), at(8), at(9), at(64), at(65), at(72), at(73)]
}

#[inline]
fn interpolate(corners: &[f32; 8], [x, y, z]: [f32; 3]) -> f32 {
    let lerp = |a: f32, b: f32, f: f32| a + (b - a) * f;
    let [c0, c1, c2, c3, c4, c5, c6, c7] = *corners;
    let low = lerp(lerp(c0, c1, z), lerp(c2, c3, z), y);
    let high = lerp(lerp(c4, c5, z), lerp(c6, c7, z), y);
    lerp(low, high, x)
}

/// The densities at `a`, halfway and at `b`, where the corners interpolate.
#[inline]
fn interpolate_along(corners: &[f32; 8], a: Vec3, b: Vec3) -> [f32; 3] {
    // All three at once, one to a lane.
    let lanes = |a: f32, b: f32| Vec4::new(a, 0.5 * (a + b), b, b);
    let (x, y, z) = (lanes(a.x, b.x), lanes(a.y, b.y), lanes(a.z, b.z));
    let edge = |a: f32, b: f32| Vec4::splat(a) + Vec4::splat(b - a) * z;
    let lerp = |a: Vec4, b: Vec4, f: Vec4| a + (b - a) * f;
    let [c0, c1, c2, c3, c4, c5, c6, c7] = *corners;
    let low = lerp(edge(c0, c1), edge(c2, c3), y);
    let high = lerp(edge(c4, c5), edge(c6, c7), y);
    let [a, mid, b, _] = lerp(low, high, x).to_array();
    [a, mid, b]
}

/// ⌊x⌋, saturated below and above what `i32` holds.
#[inline]
fn floor(x: f64) -> i32 {
    let truncated = x as i32;
    truncated.saturating_sub((x < truncated as f64) as i32)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::Stream;
    use crate::math::random::Purpose;

    type Values = Box<dyn Fn([i32; 3]) -> f32>;

    struct Case {
        name: &'static str,
        grid: BrickGrid,
        /// The value of any voxel.
        values: Values,
        /// Where to look.
        around: Bounds,
    }

    /// Noise with holes of background and bricks of one value, so that every kind of entry meets every other.
    fn noise(at: [i32; 3], background: f32) -> f32 {
        let brick = at.map(|x| x >> 3);
        let hash = |at: [i32; 3]| {
            let mut stream =
                Stream::new(9, Purpose::Test, (at[0] as u32 as u64) << 32 | at[1] as u32 as u64, at[2] as u32 as u64);
            stream.uniform() as f32
        };
        match (hash(brick.map(|x| x + 1000)) * 4.0) as i32 {
            0 => background,
            1 => 0.75,
            _ => hash(at),
        }
    }

    fn dense(name: &'static str, origin: [i32; 3], dims: [usize; 3], background: f32) -> Case {
        let size = dims.map(|n| n as i32);
        let inside = move |at: [i32; 3]| (0..3).all(|axis| (0..size[axis]).contains(&(at[axis] - origin[axis])));
        let values: Values = Box::new(move |at| if inside(at) { noise(at, background) } else { background });
        let mut list = Vec::new();
        for z in 0..size[2] {
            for y in 0..size[1] {
                for x in 0..size[0] {
                    list.push(values([origin[0] + x, origin[1] + y, origin[2] + z]));
                }
            }
        }
        let grid = BrickGrid::from_dense(origin, dims, &list, background, NegativePolicy::Error).unwrap();
        let min = DVec3::from_array(origin.map(f64::from));
        let around = Bounds { min, max: min + DVec3::from_array(size.map(f64::from)) }.grown(12.0);
        Case { name, grid, values, around }
    }

    /// Leaves and tiles of every size, behind a sparse index: a cube of 4096³ would fill 134 million
    /// dense entries.
    fn sparse() -> Case {
        let mut builder = Builder::new(0.25, NegativePolicy::Error);
        for (origin, size, value) in [([4096, 0, 0], 4096, 0.5), ([0, 0, 128], 128, 0.75), ([0, 128, 0], 8, 1.0)] {
            builder.add_tile(&vdb::Tile { origin, size, value, active: true });
        }
        let leaf = |at: [i32; 3]| at[0] >> 3 == 511 && at[1] >> 4 == 0 && at[2] >> 5 == 0;
        for (y, z) in [(0, 0), (0, 8), (0, 16), (0, 24), (8, 0), (8, 8), (8, 16), (8, 24)] {
            let values = std::array::from_fn(|n| {
                noise([4088 + (n >> 6) as i32, y + (n >> 3 & 7) as i32, z + (n & 7) as i32], 0.25)
            });
            builder.add_leaf([4088, y, z], &[u64::MAX; 8], &values);
        }
        let values: Values = Box::new(move |at| {
            let within = |origin: [i32; 3], size: i32| (0..3).all(|a| (0..size).contains(&(at[a] - origin[a])));
            match () {
                () if within([4096, 0, 0], 4096) => 0.5,
                () if within([0, 0, 128], 128) => 0.75,
                () if within([0, 128, 0], 8) => 1.0,
                () if leaf(at) => noise(at, 0.25),
                () => 0.25,
            }
        });
        let grid = builder.finish().unwrap();
        assert!(matches!(grid.index, Index::Sparse(_)) && grid.bytes() < 1 << 20);
        let around = Bounds { min: DVec3::new(4080.0, -6.0, -6.0), max: DVec3::new(4106.0, 24.0, 40.0) };
        Case { name: "sparse", grid, values, around }
    }

    fn cases() -> Vec<Case> {
        vec![
            dense("brick", [-13, 5, -40], [37, 29, 50], 0.0),
            dense("background", [3, -9, 0], [20, 17, 23], 0.5),
            dense("single voxel", [7, 7, 7], [1, 1, 1], 0.0),
            dense("line", [-2, 8, -3], [1, 1, 40], 0.0),
            sparse(),
        ]
    }

    fn both(case: Case) -> [Case; 2] {
        let Case { name, grid, values, around } = case;
        let values = std::rc::Rc::new(values);
        let other = values.clone();
        let copy = grid.clone();
        [
            Case { name, grid, values: Box::new(move |at| values(at)), around },
            Case {
                name,
                grid: copy.with_interpolation(Interpolation::Nearest),
                values: Box::new(move |at| other(at)),
                around,
            },
        ]
    }

    fn point(stream: &mut Stream, bounds: &Bounds) -> DVec3 {
        let u = DVec3::new(stream.uniform(), stream.uniform(), stream.uniform());
        bounds.min + u * bounds.size()
    }

    /// A ray and its end: any direction, along axes, in planes of voxels and cells, through corners, never ending.
    fn ray(stream: &mut Stream, bounds: &Bounds, kind: usize) -> (DVec3, DVec3, f64, f64) {
        let mut origin = point(stream, bounds);
        let mut direction = point(stream, bounds) - point(stream, bounds);
        let axis = kind / 2 % 3;
        match kind % 8 {
            2 => direction = [DVec3::X, DVec3::NEG_Y, DVec3::Z][axis] * direction.length(),
            3 => {
                origin = origin.round();
                direction = [DVec3::NEG_X, DVec3::Y, DVec3::NEG_Z][axis] * 0.37;
            }
            4 => {
                origin = (origin / 8.0).round() * 8.0;
                direction[axis] = 0.0;
            }
            5 => {
                origin = (origin / 8.0).round() * 8.0 + 0.5;
                direction = DVec3::new(1.0, -1.0, 1.0) * direction.x.signum();
            }
            6 => direction[axis] = 1e-310,
            7 => direction[axis] = -0.0,
            _ => {}
        }
        let t0 = stream.uniform() * 2.0 - 0.5;
        let t1 = if kind.is_multiple_of(3) { f64::INFINITY } else { t0 + 3.0 * stream.uniform() };
        (origin, direction, t0, t1)
    }

    /// What lies between voxels, from the definition.
    fn brute_force(case: &Case, p: DVec3) -> f64 {
        if case.grid.interpolation == Interpolation::Nearest {
            return (case.values)((p + 0.5).floor().to_array().map(|x| x as i32)) as f64;
        }
        let low = p.floor();
        let f = p - low;
        (0..8)
            .map(|n| {
                let step = [n >> 2 & 1, n >> 1 & 1, n & 1];
                let weight: f64 = (0..3).map(|a| if step[a] == 1 { f[a] } else { 1.0 - f[a] }).product();
                weight * (case.values)(std::array::from_fn(|a| low[a] as i32 + step[a])) as f64
            })
            .sum()
    }

    #[test]
    fn densities_are_those_of_the_definition() {
        for case in cases().into_iter().flat_map(both) {
            let mut stream = Stream::new(1, Purpose::Test, 0, 0);
            let support = case.grid.support();
            for n in 0..4000 {
                let mut p = point(&mut stream, &case.around);
                if n % 4 == 0 {
                    p[n / 4 % 3] = p[n / 4 % 3].round();
                }
                let (found, expected) = (case.grid.density(p) as f64, brute_force(&case, p));
                assert!((found - expected).abs() < 1e-6, "{} {p}: {found} {expected}", case.name);
                assert!(found <= case.grid.max() as f64);
                // Beyond the support there is the background, on its upper faces too.
                if p.cmplt(support.min).any() || p.cmpge(support.max).any() {
                    assert_eq!(found, case.grid.background() as f64, "{} {p}", case.name);
                }
            }
            for p in [DVec3::INFINITY, DVec3::NEG_INFINITY, DVec3::splat(2147483647.5), DVec3::splat(-3e9)] {
                assert_eq!(case.grid.density(p), case.grid.background());
            }
        }
    }

    #[test]
    fn the_support_is_as_small_as_it_can_be() {
        let one = || BrickGrid::from_dense([7, -8, 0], [1, 1, 1], &[2.0], 0.0, NegativePolicy::Error).unwrap();
        let at = DVec3::new(7.0, -8.0, 0.0);
        assert_eq!(one().support(), Bounds { min: at - 1.0, max: at + 1.0 });
        let nearest = one().with_interpolation(Interpolation::Nearest);
        assert_eq!(nearest.support(), Bounds { min: at - 0.5, max: at + 0.5 });
        assert_eq!((nearest.density(at - 0.5), nearest.density(at + DVec3::X * 0.5)), (2.0, 0.0));
        assert!(
            BrickGrid::from_dense([0; 3], [2, 1, 1], &[3.0; 2], 3.0, NegativePolicy::Error)
                .unwrap()
                .support()
                .is_empty()
        );
        assert!(
            BrickGrid::from_dense([0; 3], [0, 1, 1], &[], 0.0, NegativePolicy::Error).unwrap().support().is_empty()
        );
    }

    #[test]
    fn majorants_tile_the_ray_and_bound_the_density() {
        for case in cases().into_iter().flat_map(both) {
            let mut stream = Stream::new(2, Purpose::Test, 0, 0);
            let (mut pieces, mut tight) = (0, 0);
            for kind in 0..800 {
                let (origin, direction, t0, t1) = ray(&mut stream, &case.around, kind);
                let mut at = t0;
                let flow = case.grid.majorants(origin, direction, t0, t1, |a, b, max, min| {
                    assert!(a == at && b > a, "{} ray {kind}: {a}..{b} after {at}", case.name);
                    at = b;
                    pieces += 1;
                    tight += (max < case.grid.max() as f64) as usize;
                    for _ in 0..4 {
                        let t = a + (b.min(a + 1e3) - a) * (0.001 + 0.998 * stream.uniform());
                        let rho = case.grid.density(origin + t * direction) as f64;
                        assert!(
                            (min - 2e-6..=max + 2e-6).contains(&rho),
                            "{} ray {kind}: {rho} in {min}..{max}",
                            case.name
                        );
                    }
                    ControlFlow::<()>::Continue(())
                });
                assert!(flow.is_continue() && at == t1, "{} ray {kind}: ends at {at}, not {t1}", case.name);
            }
            assert!(pieces >= 800 && tight > pieces / 4, "{}: {tight} of {pieces} are tight", case.name);
        }
    }

    #[test]
    fn cells_tile_the_ray_and_hold_its_densities() {
        for case in cases().into_iter().flat_map(both) {
            let mut stream = Stream::new(3, Purpose::Test, 0, 0);
            for kind in 0..800 {
                let (origin, direction, t0, t1) = ray(&mut stream, &case.around, kind);
                let mut at = t0;
                let flow = case.grid.walk_cells(origin, direction, t0, t1, |cell| {
                    assert!(cell.ta == at && cell.tb > at, "{} ray {kind}: {cell:?} after {at}", case.name);
                    at = cell.tb;
                    // Slivers are left out: there a rounding of t may lead into the next cell.
                    if (cell.tb - cell.ta) * direction.length() > 1e-6 {
                        let expected = |t: f64| brute_force(&case, origin + t * direction);
                        let (a, b) = (cell.ta, cell.tb.min(cell.ta + 1e3));
                        let mid = 0.5 * (a + b);
                        assert!(
                            (cell.rho_mid as f64 - expected(mid)).abs() < 2e-6,
                            "{} ray {kind} {cell:?}",
                            case.name
                        );
                        let [ya, ym, yb] = [cell.rho_a, cell.rho_mid, cell.rho_b].map(f64::from);
                        if case.grid.interpolation == Interpolation::Trilinear {
                            assert!((ya - expected(a)).abs() < 2e-6 && (yb - expected(b)).abs() < 2e-6);
                        } else {
                            assert!(ya == ym && ym == yb);
                        }
                    }
                    ControlFlow::<()>::Continue(())
                });
                assert!(flow.is_continue() && at == t1, "{} ray {kind}: ends at {at}, not {t1}", case.name);
            }
        }
    }

    #[test]
    fn integrals_are_those_of_fine_quadrature() {
        for case in cases().into_iter().flat_map(both) {
            let mut stream = Stream::new(4, Purpose::Test, 0, 0);
            for kind in 0..60 {
                let (origin, direction, t0, t1) = ray(&mut stream, &case.around, kind);
                let t1 = t1.min(t0 + 1.0);
                // Midpoints: the density is Lipschitz or has a jump per cell, far below the bound.
                let steps = 40_000;
                let width = (t1 - t0) / steps as f64;
                let sum: f64 = (0..steps)
                    .map(|i| case.grid.density(origin + (t0 + (i as f64 + 0.5) * width) * direction) as f64)
                    .sum();
                let (found, expected) = (case.grid.integral(origin, direction, t0, t1), sum * width);
                let jumps = if case.grid.interpolation == Interpolation::Nearest { 200.0 * width } else { 1e-6 };
                assert!((found - expected).abs() <= jumps, "{} ray {kind}: {found} {expected}", case.name);
            }
        }
    }

    #[test]
    fn integrals_add_up_exactly_where_they_are_known() {
        // A linear ramp along x, integrated along a slanted line: a quadratic function of the ends.
        let values: Vec<f32> = (0..30 * 30 * 30).map(|n| (n % 30) as f32).collect();
        let grid = BrickGrid::from_dense([0; 3], [30; 3], &values, 0.0, NegativePolicy::Error).unwrap();
        let (a, b) = (DVec3::new(0.3, 2.1, 28.0), DVec3::new(28.9, 25.7, 1.0));
        let integral = grid.integral(a, b - a, 0.0, 1.0);
        assert!((integral - 0.5 * (0.3 + 28.9)).abs() < 1e-5, "{integral}");
        // A single voxel of value v holds v in total: ∫ over x at the middle.
        let one = BrickGrid::from_dense([100, -7, 7], [1; 3], &[3.0], 0.0, NegativePolicy::Error).unwrap();
        let integral = one.integral(DVec3::new(0.0, -7.0, 7.0), DVec3::X * 2.0, 0.0, f64::INFINITY);
        assert!((integral - 1.5).abs() < 1e-6, "{integral}");
    }

    #[test]
    fn voxels_far_apart_cost_no_more_than_near_ones() {
        let mut builder = Builder::new(0.0, NegativePolicy::Error);
        for (origin, value) in [([-5000, 3000, 20000], 1.0), ([40_000_000, 0, 0], 2.0)] {
            let mut values = [0.0; 512];
            values[0] = value;
            builder.add_leaf(origin, &[1, 0, 0, 0, 0, 0, 0, 0], &values);
        }
        let grid = builder.finish().unwrap();
        assert!(grid.bytes() < 400_000, "{} bytes", grid.bytes());
        assert_eq!((grid.value_at(-5000, 3000, 20000), grid.value_at(40_000_000, 0, 0), grid.sum()), (1.0, 2.0, 3.0));
        // From one to the other, in 10,000 steps rather than five million.
        let mut pieces = 0;
        let from = DVec3::new(-5000.0, 3000.0, 20000.0);
        let _ = grid.majorants(from, DVec3::new(40_000_000.0, 0.0, 0.0) - from, 0.0, 1.0, |_, _, _, _| {
            pieces += 1;
            ControlFlow::<()>::Continue(())
        });
        assert!((3..10).contains(&pieces), "{pieces}");
        // The same in the uppermost layer of the index's cubes; one brick at a time it would take minutes.
        for n in 0..100 {
            let from = DVec3::new(-6000.0, 1000.5 + n as f64, 4090.0 + 0.05 * n as f64);
            assert_eq!(grid.integral(from, DVec3::new(1.0, 0.0, 0.0), 0.0, 1e9), 0.0);
        }
        let integral = grid.integral(from - DVec3::X * 10.0, DVec3::X, 0.0, f64::INFINITY);
        assert!((integral - 1.0).abs() < 1e-6, "{integral}");
    }
}
