//! Which way the triangles below a node face, so that a search for walls around a point can pass by those that the point
//! does not stand over (the normal cones of Johnson and Cohen 2001, "Spatialized normal cone hierarchies").

use super::tree::Tree;
use crate::math::{DVec3, Vec3};

/// Where the triangles below a node are, and the cone of the lines along their normals: of either sense, as the
/// two sides of a sheet lie together.
#[derive(Clone, Copy, Debug)]
pub(super) struct Facing {
    /// The middle of a sphere around them, in the tree's cube.
    center: Vec3,
    radius: f32,
    axis: Vec3,
    /// Sine and cosine of the cone's half angle; cosine 0 for all lines.
    sin: f32,
    cos: f32,
    /// Whether all normals have the axis' sense.
    one_sided: bool,
}

impl Facing {
    /// By node of `tree`; `normal` gives a triangle's unit normal.
    pub fn of(tree: &Tree, normal: impl Fn(u32) -> DVec3) -> Vec<Facing> {
        let flat = |index: u32| {
            let axis = normal(index).as_vec3();
            Facing { center: Vec3::ZERO, radius: 0.0, axis, sin: 0.0, cos: 1.0, one_sided: true }
        };
        tree.gathered(flat, |around, parts| {
            let (center, radius) = (around.center().into(), 0.5 * around.diagonal().length());
            let first = parts[0].axis;
            let sense = |part: &Facing| part.axis.dot(first).signum();
            let axis: Vec3 = parts.iter().map(|part| part.axis * sense(part)).sum();
            let axis = axis.normalize_or(first);
            let one_sided = parts.iter().all(|part| part.one_sided && part.axis.dot(axis) > 0.0);
            // The cosine of the angle to the farthest line of a part: of a sum of two angles.
            let farthest = |part: &Facing| {
                let cos = axis.dot(part.axis).abs().min(1.0);
                cos * part.cos - (1.0 - cos * cos).sqrt() * part.sin
            };
            let cos = parts.iter().map(farthest).fold(1.0, f32::min).max(0.0);
            Facing { center, radius, axis, sin: (1.0 - cos * cos).sqrt(), cos, one_sided }
        })
    }

    /// Whether the way from `p`, in the tree's cube, to one of the triangles may lie within an angle of its normal, given
    /// by its sine and cosine.
    pub fn may_face(&self, p: Vec3, [sin, cos]: [f32; 2]) -> bool {
        /// Rounding of cosines.
        const SLACK: f32 = 1e-5;
        let way = p - self.center;
        let distance = way.length();
        if distance <= self.radius {
            return true;
        }
        // ---- the cone, widened by the angle and by what the sphere covers
        let (s, c) = (self.sin * cos + self.cos * sin, self.cos * cos - self.sin * sin);
        let spread = self.radius / distance;
        let widened = c * (1.0 - spread * spread).sqrt() - s * spread;
        c <= 0.0 || widened <= 0.0 || way.dot(self.axis).abs() >= (widened - SLACK) * distance
    }

    /// Whether all normals are within an angle of `normal`, given by its sine and cosine.
    pub fn is_along(&self, normal: Vec3, [sin, cos]: [f32; 2]) -> bool {
        // The cone is narrower, and its axis within the difference.
        self.one_sided && self.cos > cos && normal.dot(self.axis) >= cos * self.cos + sin * self.sin
    }
}
