//! Walks of a ray over bricks, and within a brick over cells.

use std::ops::ControlFlow;

use super::index::{BACKGROUND, Block, CONSTANT, Range};
use super::interpolate::{floor, interpolate_along, offset};
use super::values::Place;
use super::{BrickGrid, Interpolation};
use crate::math::{DVec3, Vec3};

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

/// A ray in the coordinates of cells: nearest voxels are cells shifted by half.
struct IndexRay {
    origin: DVec3,
    direction: DVec3,
    inverse: DVec3,
}

impl BrickGrid {
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

    /// [`BrickGrid::walk_cells`] for one kind of interpolation.
    fn walk_cells_as<const TRILINEAR: bool, B>(
        &self,
        origin: DVec3,
        direction: DVec3,
        t0: f64,
        t1: f64,
        mut visit: impl FnMut(Cell) -> ControlFlow<B>,
    ) -> ControlFlow<B> {
        // Pieces of one density are joined until another begins.
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
        // The first cell, and where the ray leaves it through each axis' plane. Positions are relative to the brick
        // from here on: there `f32` has room for 10⁻⁶ of a voxel.
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
        let stored = (block.code & CONSTANT == 0).then(|| self.values.brick(block.code as usize));
        let mut near: Option<[Place; 8]> = None;

        // From plane to plane, always the nearest.
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

            // The piece in this cell.
            if tb > ta {
                let piece = if TRILINEAR {
                    let corners = match stored {
                        Some(brick) if !cell.contains(&7) => brick.corners(cell),
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
                    let rho = self.values.at(self.place(block.code), offset(cell));
                    Cell { ta, tb, rho_a: rho, rho_mid: rho, rho_b: rho }
                };
                visit(piece)?;
                ta = tb;
            }

            // On to the next cell.
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
        // Before and behind the occupied cells there is background.
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

        // The first block.
        let at = ray.origin + enter * ray.direction;
        let first = lo.map(|x| x >> 3);
        let last = hi.map(|x| (x - 1) >> 3);
        let mut brick: [i32; 3] = std::array::from_fn(|axis| (floor(at[axis]) >> 3).clamp(first[axis], last[axis]));
        let mut t = enter;
        while t < exit {
            // Through which of its faces the ray leaves the block, and where.
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

            // The brick behind that face.
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
}

impl IndexRay {
    /// From a ray in the coordinates of cells, of any length.
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
