//! Voxels where the scene has them.

use std::ops::ControlFlow;
use std::sync::{Arc, OnceLock};

use super::bricks::{BrickGrid, Cell, Precision};
use super::coarse::Cells;
use super::{Coarse, reached};
use crate::math::{Bounds, DAffine3, DVec3, Ray};

/// Voxels placed in the scene: a density, or a temperature.
#[derive(Clone, Debug)]
pub struct Grid {
    voxels: Arc<BrickGrid>,
    /// From the scene to index space, where a voxel's value sits at its integer coordinates.
    to_index: DAffine3,
    /// Outside of this box in index space the density is 0.
    clip: Bounds,
    /// What all places of the voxels share of the following, clipped alike.
    cells: Arc<OnceLock<Option<Cells>>>,
    /// Found when it is first asked for.
    coarse: Arc<OnceLock<Option<Coarse>>>,
}

impl Grid {
    /// Places voxels; `to_world` takes index space to the scene.
    pub fn new(voxels: Arc<BrickGrid>, to_world: DAffine3) -> Self {
        Grid { voxels, to_index: to_world.inverse(), clip: Bounds::ALL, cells: Arc::default(), coarse: Arc::default() }
    }

    /// With voxels kept so exactly.
    pub fn with_precision(self, precision: Precision) -> Self {
        let voxels = Arc::new(Arc::unwrap_or_clone(self.voxels).with_precision(precision));
        Grid { voxels, cells: Arc::default(), coarse: Arc::default(), ..self }
    }

    /// With density 0 outside of a box in index space.
    pub fn clipped(self, clip: Bounds) -> Self {
        Grid { clip, cells: Arc::default(), coarse: Arc::default(), ..self }
    }

    /// Carried along by a transform of the scene.
    pub fn moved(&self, transform: DAffine3) -> Self {
        let to_index = self.to_index * transform.inverse();
        let (voxels, cells) = (self.voxels.clone(), self.cells.clone());
        Grid { voxels, to_index, clip: self.clip, cells, coarse: Arc::default() }
    }

    /// Whether it is the other one: the same voxels in the same place.
    pub(super) fn is_that(&self, other: &Grid) -> bool {
        Arc::ptr_eq(&self.voxels, &other.voxels) && self.to_index == other.to_index && self.clip == other.clip
    }

    /// The voxels in index space, which several grids may share.
    pub fn voxels(&self) -> &Arc<BrickGrid> {
        &self.voxels
    }

    /// About how dense it is, cell by cell; `None` where it is empty, or never ends.
    pub fn coarse(&self) -> Option<&Coarse> {
        let cells = || self.cells.get_or_init(|| Cells::new(self)).as_ref();
        self.coarse.get_or_init(|| cells().map(|cells| Coarse::new(cells, &self.to_index))).as_ref()
    }

    /// Outside of this box in index space the density is 0.
    pub(super) fn clip(&self) -> Bounds {
        self.clip
    }

    /// The least distance between two neighbouring planes of voxel centres.
    pub fn voxel_size(&self) -> f64 {
        let rows = self.to_index.matrix3.transpose();
        let steepest = rows.x_axis.length().max(rows.y_axis.length()).max(rows.z_axis.length());
        1.0 / steepest
    }

    /// The interpolated value at the point `p` of the scene; 0 where it is clipped away.
    pub fn at(&self, p: DVec3) -> f64 {
        let p = self.to_index.transform_point3(p);
        if self.clip.contains(p) { self.voxels.density(p) as f64 } else { 0.0 }
    }

    /// The largest value of a voxel, the background included.
    pub fn max(&self) -> f64 {
        self.voxels.max() as f64
    }

    /// A box in the scene outside of which the value is 0; infinite where there is none.
    pub fn support(&self) -> Bounds {
        let inside = if self.voxels.background() == 0.0 { self.voxels.support() } else { Bounds::ALL };
        let inside = inside.intersection(self.clip);
        if inside.size().is_finite() || inside.is_empty() {
            inside.transformed(&self.to_index.inverse())
        } else {
            Bounds::ALL
        }
    }

    /// The ray in index space, its parameter unchanged, and the range of it that is not clipped away.
    fn enter(&self, ray: &Ray, t0: f64, t1: f64) -> Option<(DVec3, DVec3, f64, f64)> {
        let origin = self.to_index.transform_point3(ray.origin);
        let direction = self.to_index.transform_vector3(ray.direction);
        let inside = Ray { origin, direction };
        let (a, b) = if self.clip == Bounds::ALL { (t0, t1) } else { self.clip.clip(&inside, t0, t1)? };
        (a < b).then_some((origin, direction, a, b))
    }

    /// Calls `visit(a, b, majorant)` on consecutive pieces of the ray between `t0` and `t1`, with an upper bound of the
    /// value on each; nothing where it is clipped away.
    pub fn majorants(&self, ray: &Ray, t0: f64, t1: f64, mut visit: impl FnMut(f64, f64, f64) -> ControlFlow<()>) {
        if let Some((origin, direction, a, b)) = self.enter(ray, t0, t1) {
            let _ = self.voxels.majorants(origin, direction, a, b, |a, b, max, _| visit(a, b, max));
        }
    }

    /// Visits the cells that the ray crosses between `t0` and `t1`, in order, with the value as a cubic of the ray's
    /// parameter in each; nothing where it is clipped away.
    pub fn cells(&self, ray: &Ray, t0: f64, t1: f64, visit: impl FnMut(Cell) -> ControlFlow<()>) {
        if let Some((origin, direction, a, b)) = self.enter(ray, t0, t1) {
            let _ = self.voxels.walk_cells(origin, direction, a, b, visit);
        }
    }

    /// ∫ρ dt between two parameters of the ray, cell by cell: exact up to rounding.
    pub fn depth(&self, ray: &Ray, t0: f64, t1: f64) -> f64 {
        let mut depth = 0.0;
        self.cells(ray, t0, t1, |cell| {
            depth += cell.integral();
            ControlFlow::Continue(())
        });
        depth
    }

    /// The ends of all cells, and the middles of those that `is_long` says so of; see [`Density::knots`](super::Density::knots).
    pub(super) fn knots(
        &self,
        ray: &Ray,
        (t0, t1): (f64, f64),
        is_long: impl Fn(f64) -> bool,
        mut knot: impl FnMut(f64, f64, f64),
    ) {
        let mut depth = 0.0;
        self.cells(ray, t0, t1, |cell| {
            if !cell.tb.is_finite() {
                return ControlFlow::Break(());
            }
            // A gap between cells, where the grid is clipped, adds nothing but needs its ends.
            knot(cell.ta, depth, cell.rho_a as f64);
            let inside = cell.integral();
            if is_long(inside) && !cell.is_constant() {
                // Simpson's rule over the first half, whose middle is a quarter in.
                let quarter = self.at(ray.at(0.75 * cell.ta + 0.25 * cell.tb));
                let half = (cell.tb - cell.ta) * (cell.rho_a as f64 + 4.0 * quarter + cell.rho_mid as f64) / 12.0;
                knot(0.5 * (cell.ta + cell.tb), depth + half.max(0.0).min(inside), cell.rho_mid as f64);
            }
            depth += inside;
            knot(cell.tb, depth, cell.rho_b as f64);
            ControlFlow::Continue(())
        });
    }

    /// Where between `t0` and `t1` the depth since `t0` reaches `target`; `None` if it does not.
    pub(super) fn advance(&self, ray: &Ray, t0: f64, t1: f64, target: f64) -> Option<f64> {
        let mut left = target;
        let mut found = None;
        self.cells(ray, t0, t1, |cell| {
            let depth = cell.integral();
            if left > depth || depth == 0.0 {
                left -= depth;
                return ControlFlow::Continue(());
            }
            found = Some(self.within(ray, &cell, left));
            ControlFlow::Break(())
        });
        found
    }

    /// Where in a cell the depth since its start reaches `target`.
    /// Simpson's rule is exact on any part of a cell, where the density is a cubic.
    pub fn within(&self, ray: &Ray, cell: &Cell, target: f64) -> f64 {
        let start = cell.rho_a as f64;
        if cell.is_constant() {
            return (cell.ta + target / start).min(cell.tb);
        }
        reached((cell.ta, cell.tb), target / cell.integral(), target, |t| {
            let density = self.at(ray.at(t));
            let middle = self.at(ray.at(0.5 * (cell.ta + t)));
            ((t - cell.ta) * (start + 4.0 * middle + density) / 6.0, density)
        })
    }
}
