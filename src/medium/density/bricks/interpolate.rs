//! The density at a point, and where the corners of a cell are found.

use super::index::CONSTANT;
use super::values::Place;
use super::{BrickGrid, Interpolation};
use crate::math::{DVec3, Vec3};
use glam::Vec4;

impl BrickGrid {
    /// The value of voxel (i, j, k).
    pub fn value_at(&self, i: i32, j: i32, k: i32) -> f32 {
        self.values.at(self.place(self.code([i >> 3, j >> 3, k >> 3])), offset([i & 7, j & 7, k & 7]))
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
        // The cell.
        let i = [floor(p.x), floor(p.y), floor(p.z)];
        let brick = i.map(|i| i >> 3);
        let local = i.map(|i| i & 7);
        let fraction = |axis: usize| (p[axis] - i[axis] as f64) as f32;

        // Most cells lie within one brick.
        if !local.contains(&7) {
            let code = self.code(brick);
            if code & CONSTANT != 0 {
                return self.constant(code);
            }
            return interpolate(
                &self.values.brick(code as usize).corners(local),
                [fraction(0), fraction(1), fraction(2)],
            );
        }

        // The others reach into its upper neighbours.
        let corners = self.corners_across(&self.codes_near(brick).map(|code| self.place(code)), local);
        // Far beyond the bricks a coordinate may not fit an `i32`.
        interpolate(&corners, [0, 1, 2].map(|axis| fraction(axis).clamp(0.0, 1.0)))
    }

    /// The corners of a cell that may reach into the brick's upper neighbours; `near` says where these are.
    #[inline]
    pub(super) fn corners_across(&self, near: &[Place; 8], cell: [i32; 3]) -> [f32; 8] {
        let upper = cell.map(|x| (x as usize + 1) & 7);
        let crosses = cell.map(|x| (x == 7) as usize);
        self.values.eight(|n| {
            let pick = |axis: usize| if n >> (2 - axis) & 1 != 0 { upper[axis] } else { cell[axis] as usize };
            let neighbour = n & (crosses[0] << 2 | crosses[1] << 1 | crosses[2]);
            (near[neighbour], pick(0) << 6 | pick(1) << 3 | pick(2))
        })
    }
}

/// Where a brick keeps a voxel.
#[inline]
pub(super) fn offset(local: [i32; 3]) -> usize {
    (local[0] << 6 | local[1] << 3 | local[2]) as usize & 511
}

/// What a brick has at the corners of the cell at an offset, z fastest.
#[inline]
pub(super) fn inside<T: Copy>(values: &[T; 512], n: usize) -> [T; 8] {
    let at = |step: usize| values[(n + step) & 511];
    [at(0), at(1), at(8), at(9), at(64), at(65), at(72), at(73)]
}

/// The density at a place in a cell, each coordinate from 0 to 1, of which `corners` are the values, z fastest.
#[inline]
pub(super) fn interpolate(corners: &[f32; 8], [x, y, z]: [f32; 3]) -> f32 {
    let lerp = |a: f32, b: f32, f: f32| a + (b - a) * f;
    let [c0, c1, c2, c3, c4, c5, c6, c7] = *corners;
    let low = lerp(lerp(c0, c1, z), lerp(c2, c3, z), y);
    let high = lerp(lerp(c4, c5, z), lerp(c6, c7, z), y);
    lerp(low, high, x)
}

/// The densities at `a`, halfway and at `b`, where the corners interpolate.
#[inline]
pub(super) fn interpolate_along(corners: &[f32; 8], a: Vec3, b: Vec3) -> [f32; 3] {
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
pub(super) fn floor(x: f64) -> i32 {
    let truncated = x as i32;
    truncated.saturating_sub((x < truncated as f64) as i32)
}
