//! Which way the triangles below a node's children face, so that a search for walls around a point can pass by those that
//! the point does not stand over (the normal cones of Johnson and Cohen 2001, "Spatialized normal cone hierarchies").

use super::tree::{Children, Tree};
use crate::math::{DVec3, Vec3};

/// The cones of the lines along the normals of the triangles below a node's eight children: of either sense, as the two
/// sides of a sheet lie together.
#[derive(Clone, Copy, Debug)]
pub(super) struct Facing {
    axis: [[f32; 8]; 3],
    /// Sines and cosines of the cones' half angles; cosine 0 for all lines.
    sin: [f32; 8],
    cos: [f32; 8],
    /// A bit for each child whose normals all have the axis' sense.
    one_sided: u8,
}

/// A cone that holds the normals of some triangles, or the lines along them.
#[derive(Clone, Copy)]
struct NormalCone {
    axis: Vec3,
    sin: f32,
    cos: f32,
    one_sided: bool,
}

impl NormalCone {
    /// The narrowest cone found around others.
    fn around(parts: &[NormalCone]) -> NormalCone {
        let first = parts[0].axis;
        let sense = |part: &NormalCone| part.axis.dot(first).signum();
        let axis: Vec3 = parts.iter().map(|part| part.axis * sense(part)).sum();
        let axis = axis.normalize_or(first);
        let one_sided = parts.iter().all(|part| part.one_sided && part.axis.dot(axis) > 0.0);
        // The cosine of the angle to the farthest line of a part: of a sum of two angles.
        let farthest = |part: &NormalCone| {
            let cos = axis.dot(part.axis).abs().min(1.0);
            cos * part.cos - (1.0 - cos * cos).sqrt() * part.sin
        };
        let cos = parts.iter().map(farthest).fold(1.0, f32::min).max(0.0);
        NormalCone { axis, sin: (1.0 - cos * cos).sqrt(), cos, one_sided }
    }
}

impl Facing {
    /// By node of `tree`; `normal` gives a triangle's unit normal.
    pub fn of(tree: &Tree, normal: impl Fn(u32) -> DVec3) -> Vec<Facing> {
        let flat = |axis: Vec3| NormalCone { axis, sin: 0.0, cos: 1.0, one_sided: true };
        let cones = tree.gathered(flat(Vec3::ZERO), |index| flat(normal(index).as_vec3()), NormalCone::around);
        let by_node = |cones: &[NormalCone; 8]| {
            let one_sided = cones.iter().enumerate().map(|(child, cone)| u8::from(cone.one_sided) << child);
            Facing {
                axis: std::array::from_fn(|axis| cones.map(|cone| cone.axis[axis])),
                sin: cones.map(|cone| cone.sin),
                cos: cones.map(|cone| cone.cos),
                one_sided: one_sided.fold(0, |bits, bit| bits | bit),
            }
        };
        cones.iter().map(by_node).collect()
    }

    /// The children, a bit each, with triangles to which the way from the point may lie within an angle of the normal,
    /// given by its sine and cosine.
    #[inline]
    pub fn may_face(&self, children: &Children, [sin, cos]: [f32; 2]) -> u8 {
        /// Rounding of cosines.
        const SLACK: f32 = 1e-5;
        let [x, y, z] = &children.way;
        let mut bits = 0;
        for i in 0..8 {
            let (distance2, radius2) = (x[i] * x[i] + y[i] * y[i] + z[i] * z[i], children.radius2[i]);
            // ---- the cone, widened by the angle and by what the sphere covers
            let (s, c) = (self.sin[i] * cos + self.cos[i] * sin, self.cos[i] * cos - self.sin[i] * sin);
            let least = c * (distance2 - radius2).max(0.0).sqrt() - s * radius2.sqrt() - SLACK * distance2.sqrt();
            let along = x[i] * self.axis[0][i] + y[i] * self.axis[1][i] + z[i] * self.axis[2][i];
            let may = (distance2 <= radius2) | (c <= 0.0) | (along.abs() >= least);
            bits |= u8::from(may) << i;
        }
        bits
    }

    /// The children, a bit each, whose normals are all within an angle of `normal`, given by its sine and cosine.
    #[inline]
    pub fn are_along(&self, normal: Vec3, [sin, cos]: [f32; 2]) -> u8 {
        let mut bits = 0;
        for i in 0..8 {
            let along = normal.x * self.axis[0][i] + normal.y * self.axis[1][i] + normal.z * self.axis[2][i];
            // The cone is narrower, and its axis within the difference.
            let are = (self.cos[i] > cos) & (along >= cos * self.cos[i] + sin * self.sin[i]);
            bits |= u8::from(are) << i;
        }
        bits & self.one_sided
    }
}
