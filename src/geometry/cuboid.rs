use crate::math::{Bounds, DAffine3, DVec3, Ray};
use crate::{Error, Result};

/// The axes along which u and v grow on each face, and whether they do so forward.
const ACROSS: [[(usize, bool); 2]; 6] = [
    [(2, true), (1, true)],
    [(2, false), (1, true)],
    [(0, true), (2, true)],
    [(0, true), (2, false)],
    [(0, false), (1, true)],
    [(0, true), (1, true)],
];

/// A box with faces along the axes; closed. Its primitives are the faces −x, +x, −y, +y, −z, +z.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cuboid {
    bounds: Bounds,
}

impl Cuboid {
    /// The box between two corners.
    ///
    /// # Errors
    /// When an edge is not positive or a number is not finite.
    pub fn new(min: DVec3, max: DVec3) -> Result<Self> {
        if !min.is_finite() || !max.is_finite() || !min.cmplt(max).all() {
            return Err(Error::Scene(format!(
                "a box from min {min} to max {max}: expected finite numbers and min below max on every axis"
            )));
        }
        Ok(Cuboid { bounds: Bounds { min, max } })
    }

    /// This, `by` further on.
    pub(super) fn moved(self, by: DVec3) -> Self {
        let Bounds { min, max } = self.bounds;
        Cuboid { bounds: Bounds { min: min + by, max: max + by } }
    }

    pub(super) fn bounds(&self, m: &DAffine3) -> Bounds {
        self.bounds.transformed(m)
    }

    /// Slabs by division, so that a ray that runs in a face is inside and one that meets an edge
    /// still has an entry and an exit.
    #[inline]
    pub(super) fn crossings(&self, ray: &Ray, visit: &mut impl FnMut(f64, u32)) {
        let Bounds { min, max } = self.bounds;
        let Ray { origin, direction } = *ray;
        // A ray within two parallel faces meets neither; one beside them nothing.
        let parallel = direction.cmpeq(DVec3::ZERO);
        let (mut low, mut high) = ((min - origin) / direction, (max - origin) / direction);
        if parallel.any() {
            if (parallel & (origin.cmplt(min) | origin.cmpgt(max))).any() {
                return;
            }
            low = DVec3::select(parallel, DVec3::NEG_INFINITY, low);
            high = DVec3::select(parallel, DVec3::INFINITY, high);
        }
        let (near, far) = (low.min(high), low.max(high));
        let (t0, t1) = (near.max_element(), far.min_element());
        if t0 <= t1 {
            let face = |axis: usize, upper: bool| 2 * axis as u32 + u32::from(upper);
            let first = |t: f64, of: DVec3| (0..2).find(|&axis| of[axis] == t).unwrap_or(2);
            let (enter, leave) = (first(t0, near), first(t1, far));
            visit(t0, face(enter, direction[enter] < 0.0));
            visit(t1, face(leave, direction[leave] > 0.0));
        }
    }

    pub(super) fn normal(&self, face: u32) -> DVec3 {
        let axis = DVec3::AXES[(face / 2) as usize % 3];
        if face.is_multiple_of(2) { -axis } else { axis }
    }

    /// The coordinates across the face, from 0 to 1: to the right and up, as seen from outside with +y up; top and bottom as seen
    /// with −z and +z up.
    pub(super) fn uv(&self, p: DVec3, face: u32) -> [f64; 2] {
        let q = (p - self.bounds.min) / self.bounds.size();
        ACROSS[face as usize % 6].map(|(axis, forward)| if forward { q[axis] } else { 1.0 - q[axis] })
    }

    /// ∂p/∂u and ∂p/∂v: a face's edges.
    pub(super) fn tangents(&self, face: u32) -> [DVec3; 2] {
        let size = self.bounds.size();
        ACROSS[face as usize % 6].map(|(axis, forward)| {
            let along = DVec3::AXES[axis] * size[axis];
            if forward { along } else { -along }
        })
    }

    pub(super) fn contains(&self, p: DVec3) -> bool {
        self.bounds.contains(p)
    }

    /// The face as origin and two edges.
    pub(super) fn face(&self, face: u32) -> [DVec3; 3] {
        let axis = (face / 2) as usize % 3;
        let size = self.bounds.size().to_array();
        let edge = |k: usize| DVec3::AXES[k % 3] * size[k % 3];
        let origin = if face.is_multiple_of(2) { self.bounds.min } else { self.bounds.min + edge(axis) };
        [origin, edge(axis + 1), edge(axis + 2)]
    }
}
