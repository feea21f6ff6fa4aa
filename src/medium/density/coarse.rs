//! About how dense voxels are, cell by cell.

use std::sync::Arc;

use rayon::prelude::*;

use super::Grid;
use crate::math::{Bounds, DAffine3, DVec3, Ray};

/// About how dense voxels are in cells of many: their root mean square, or an eighth of the densest one where that is more.
/// Around cells that are not empty it falls off over some others.
#[derive(Clone, Debug)]
pub struct Coarse {
    /// From the scene to cells, the lowest of which is at the origin.
    to_cells: DAffine3,
    size: [usize; 3],
    /// z fastest.
    values: Arc<[f32]>,
}

/// Cells, at most, before some are added around them.
const MOST: f64 = (1u32 << 17) as f64;

/// Voxels from one end to the other, at most.
const FARTHEST: f64 = (1u32 << 30) as f64;

/// Voxels along an edge of the smallest cells.
const EDGE: i32 = 8;

/// Voxels that are looked at along an edge of a cell, at most: those of a brick.
const LOOKS: i32 = 8;

/// Cells over which it falls off around what is not empty,
const RINGS: i32 = 2;
/// to this share in each.
const FALL: f32 = 0.25;

/// A cell is no less dense than this share of its densest voxel.
const LEAST: f32 = 0.125;

/// The cells of voxels, in index space: the same wherever these are placed.
#[derive(Clone, Debug)]
pub(super) struct Cells {
    /// From index space to cells.
    to_cells: DAffine3,
    size: [usize; 3],
    values: Arc<[f32]>,
}

impl Cells {
    /// Of voxels; `None` where there are none, or no end of them.
    pub fn new(grid: &Grid) -> Option<Self> {
        let voxels = grid.voxels();
        let inside = if voxels.background() == 0.0 { voxels.support() } else { Bounds::ALL };
        let extent = inside.intersection(grid.clip());
        if extent.is_empty() || extent.size().max_element() > FARTHEST {
            return None;
        }
        let mut edge = EDGE;
        let cells = |edge: i32| (extent.size() / f64::from(edge)).ceil() + 1.0;
        while cells(edge).element_product() > MOST {
            edge *= 2;
        }
        let low = (extent.min / f64::from(edge)).floor().as_ivec3() - RINGS;
        let high = (extent.max / f64::from(edge)).floor().as_ivec3() + RINGS;
        let size = (high - low + 1).to_array().map(|cells| cells as usize);
        let looks = edge.min(LOOKS);
        let stride = edge / looks;
        let value = |index: usize| {
            let [_, y, z] = size;
            let cell = [index / (y * z), index / z % y, index % z];
            let first: [i32; 3] = std::array::from_fn(|axis| (low[axis] + cell[axis] as i32) * edge);
            let (mut squares, mut most) = (0.0, 0.0f32);
            for i in 0..looks.pow(3) {
                let place = [i / (looks * looks), i / looks % looks, i % looks];
                let [x, y, z] = std::array::from_fn(|axis| first[axis] + stride * place[axis]);
                let at = DVec3::new(f64::from(x), f64::from(y), f64::from(z));
                let value = if grid.clip().contains(at) { voxels.value_at(x, y, z) } else { 0.0 };
                squares += f64::from(value).powi(2);
                most = most.max(value);
            }
            // No brick is overlooked.
            let bricks = if stride > 1 { edge / 8 } else { 0 };
            for i in 0..bricks.pow(3) {
                let place = [i / (bricks * bricks), i / bricks % bricks, i % bricks];
                most = most.max(voxels.brick_max(std::array::from_fn(|axis| (first[axis] >> 3) + place[axis])));
            }
            ((squares / f64::from(looks.pow(3))).sqrt() as f32).max(LEAST * most)
        };
        let mut values: Vec<f32> = (0..size.iter().product()).into_par_iter().map(value).collect();
        for _ in 0..RINGS {
            values = spread(&values, size);
        }
        let to_cells =
            DAffine3::from_translation(-low.as_dvec3()) * DAffine3::from_scale(DVec3::splat(f64::from(edge).recip()));
        Some(Cells { to_cells, size, values: values.into() })
    }
}

impl Coarse {
    /// Cells where `to_index` takes the scene to the voxels.
    pub(super) fn new(cells: &Cells, to_index: &DAffine3) -> Self {
        Coarse { to_cells: cells.to_cells * *to_index, size: cells.size, values: cells.values.clone() }
    }

    /// Calls `visit(from, to, density)` on consecutive pieces of the ray between `a` and `b`, where it is not 0.
    pub fn pieces(&self, ray: &Ray, (a, b): (f64, f64), mut visit: impl FnMut(f64, f64, f64)) {
        let inside = Ray {
            origin: self.to_cells.transform_point3(ray.origin),
            direction: self.to_cells.transform_vector3(ray.direction),
        };
        let size = DVec3::from_array(self.size.map(|cells| cells as f64));
        let Some((enters, leaves)) = (Bounds { min: DVec3::ZERO, max: size }).clip(&inside, a, b) else { return };

        // From plane to plane, always the nearest.
        let start = inside.at(enters);
        let (mut cell, mut step, mut next, mut width) = ([0i32; 3], [0i32; 3], [f64::INFINITY; 3], [f64::INFINITY; 3]);
        for axis in 0..3 {
            let along = inside.direction[axis];
            cell[axis] = (start[axis].floor() as i32).clamp(0, self.size[axis] as i32 - 1);
            if along != 0.0 {
                step[axis] = if along > 0.0 { 1 } else { -1 };
                width[axis] = along.abs().recip();
                next[axis] = (f64::from(cell[axis] + i32::from(along > 0.0)) - inside.origin[axis]) / along;
            }
        }
        let mut from = enters;
        while from < leaves {
            let nearest = if next[0] < next[1] { 0 } else { 1 };
            let axis = if next[nearest] < next[2] { nearest } else { 2 };
            let to = next[axis].min(leaves);
            let [x, y, z] = cell.map(|cell| cell as usize);
            let density = self.values[(x * self.size[1] + y) * self.size[2] + z];
            if from < to && density > 0.0 {
                visit(from, to, f64::from(density));
            }
            from = from.max(to);
            next[axis] += width[axis];
            cell[axis] += step[axis];
            if cell[axis] < 0 || cell[axis] as usize >= self.size[axis] {
                break;
            }
        }
    }
}

/// No cell is less than [`FALL`] times any around it.
fn spread(values: &[f32], size: [usize; 3]) -> Vec<f32> {
    let mut spread = values.to_vec();
    // Cubes are products of their edges: along one axis after the other, the neighbours' maximum.
    let strides = [size[1] * size[2], size[2], 1];
    let mut around = values.to_vec();
    for axis in 0..3 {
        let before = around.clone();
        for (index, value) in around.iter_mut().enumerate() {
            let place = index / strides[axis] % size[axis];
            if place > 0 {
                *value = value.max(before[index - strides[axis]]);
            }
            if place + 1 < size[axis] {
                *value = value.max(before[index + strides[axis]]);
            }
        }
    }
    for (value, around) in spread.iter_mut().zip(around) {
        *value = value.max(FALL * around);
    }
    spread
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::random::{Purpose, Stream};
    use crate::math::sampling;
    use crate::medium::density::bricks::{BrickGrid, NegativePolicy};

    /// Pieces follow one another, end where cells do, and know no place as empty where there is matter within a cell of it, nor
    /// any as thin where it is dense.
    #[test]
    fn pieces_are_dense_where_voxels_are() {
        let values: Vec<f32> =
            (0..40 * 20 * 30).map(|i| if i % 97 == 0 { 5.0 } else { 0.01 * (i % 7) as f32 }).collect();
        let bricks =
            BrickGrid::from_dense([-3, 5, 9], [40, 20, 30], &values, 0.0, NegativePolicy::Error).expect("finite");
        let turned = DAffine3::from_rotation_y(0.4) * DAffine3::from_scale(DVec3::new(0.1, 0.2, 0.1));
        let grid = Grid::new(Arc::new(bricks), turned);
        let coarse = grid.coarse().expect("there are voxels");
        let mut stream = Stream::new(44, Purpose::Test, 0, 0);
        let bounds = grid.support();
        let mut met = 0;
        for _ in 0..500 {
            let share = DVec3::from_array([0; 3].map(|_| stream.uniform()));
            let direction = sampling::sphere(stream.uniform2());
            let ray = Ray::new(bounds.min + share * bounds.size() - 2.0 * direction, direction);
            let mut pieces = Vec::new();
            coarse.pieces(&ray, (0.1, 30.0), |from, to, density| pieces.push((from, to, density)));
            assert!(pieces.is_sorted_by(|before, after| before.1 <= after.0 + 1e-12));
            for i in 0..400 {
                let t = 0.1 + 0.02 * f64::from(i);
                let density = grid.at(ray.at(t));
                if density > 0.0 {
                    let here =
                        pieces.iter().find(|(from, to, _)| (*from..*to).contains(&t)).map_or(0.0, |piece| piece.2);
                    assert!(density <= here / f64::from(LEAST * FALL), "{density} where it is about {here}");
                    met += 1;
                }
            }
        }
        assert!(met > 10_000, "{met}");
    }

    #[test]
    fn emptiness_has_no_pieces() {
        let bricks = BrickGrid::from_dense([0; 3], [8; 3], &[0.0; 512], 0.0, NegativePolicy::Error).expect("finite");
        assert!(Grid::new(Arc::new(bricks), DAffine3::IDENTITY).coarse().is_none());
    }
}
