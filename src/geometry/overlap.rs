//! Whether a closed mesh overlaps itself: whether it encloses places twice, or none of what its faces say.
//!
//! What a mesh encloses is what its winding number says: all places that are wound around more often one way than the other, by the way
//! that encloses the larger volume. Where a mesh does not overlap itself, a ray that meets a face knows from it alone whether it comes in or
//! goes out; else it has to ask.

use std::collections::HashMap;

use rayon::prelude::*;

use super::Mesh;
use crate::math::{Bounds, DVec3, DisjointSets};

/// Of each part that hangs together, at most so many triangles are looked at from both sides.
const LOOKS: usize = 64;
/// What volumes of tetrahedra may be off by, as a share of the product of the lengths that they are made of.
const ROUNDING: f64 = 1e-14;

impl Mesh {
    /// Whether it may overlap itself. Triangles that only touch may count as crossing.
    pub(super) fn overlaps_itself(&self) -> bool {
        let triangles = || (0..self.triangle_count() as u32).into_par_iter().with_min_len(256);
        let overlaps =
            || self.is_closed() && (triangles().any(|triangle| self.is_crossed(triangle)) || self.is_nested());
        *self.overlaps.get_or_init(overlaps)
    }

    /// Whether a triangle crosses one of a higher number, with which it shares no edge.
    fn is_crossed(&self, triangle: u32) -> bool {
        let corners = self.corners(triangle);
        let bounds = Bounds::of_points(corners);
        let mut crossed = false;
        self.overlapping(&bounds, |other| {
            if other > triangle && !crossed {
                let others = self.corners(other);
                crossed = bounds.overlaps(&Bounds::of_points(others)) && cross(corners, others);
            }
        });
        crossed
    }

    /// Whether a part that hangs together lies within another, and faces as that does. No triangles cross.
    fn is_nested(&self) -> bool {
        // Triangles hang together by corners.
        let count = self.triangle_count() as u32;
        let mut sets = DisjointSets::new(count as usize);
        let mut first: HashMap<[u32; 3], u32> = HashMap::with_capacity(count as usize / 2);
        for triangle in 0..count {
            for corner in self.corners(triangle) {
                let place = (corner + DVec3::ZERO).as_vec3().to_array().map(f32::to_bits);
                let other = *first.entry(place).or_insert(triangle);
                sets.join(triangle as usize, other as usize);
            }
        }
        drop(first);
        // Inside behind each face, and outside before it.
        let step = 1e-6 * self.bounds().diagonal();
        sets.groups().into_par_iter().any(|part| {
            part.iter().step_by(part.len().div_ceil(LOOKS)).any(|&triangle| {
                let [a, b, c] = self.corners(triangle as u32);
                let (middle, normal) = ((a + b + c) / 3.0, (b - a).cross(c - a).normalize_or_zero());
                let size = (b - a).cross(c - a).length().sqrt();
                let aside = step.min(1e-3 * size) * normal;
                self.contains(middle + aside) || !self.contains(middle - aside)
            })
        })
    }
}

/// Six times the volume of a tetrahedron; 0 within rounding.
fn volume([a, b, c, d]: [DVec3; 4]) -> f64 {
    let (u, v, w) = (b - a, c - a, d - a);
    let volume = u.cross(v).dot(w);
    if volume.abs() <= ROUNDING * u.length() * v.length() * w.length() { 0.0 } else { volume }
}

/// Whether triangles cross that share no edge; not if they lie in one plane.
fn cross(one: [DVec3; 3], other: [DVec3; 3]) -> bool {
    let shared = |of: &[DVec3; 3], corner: &DVec3| of.contains(corner);
    let common: Vec<usize> = (0..3).filter(|&i| shared(&other, &one[i])).collect();
    let edges = |of: [DVec3; 3], with: [DVec3; 3]| {
        (0..3).any(|i| {
            let (p, q) = (of[i], of[(i + 1) % 3]);
            // An edge that begins at the other triangle's corner meets it there.
            !shared(&with, &p) && !shared(&with, &q) && pierces([p, q], with)
        })
    };
    common.len() < 2 && (edges(one, other) || edges(other, one))
}

/// Whether a segment meets a triangle, and does not lie in its plane.
fn pierces([p, q]: [DVec3; 2], [a, b, c]: [DVec3; 3]) -> bool {
    let (from, to) = (volume([a, b, c, p]), volume([a, b, c, q]));
    if from * to > 0.0 || from == 0.0 && to == 0.0 {
        return false;
    }
    let sides = [volume([p, q, a, b]), volume([p, q, b, c]), volume([p, q, c, a])];
    sides.iter().all(|side| *side >= 0.0) || sides.iter().all(|side| *side <= 0.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::Vec3;

    /// A box, its faces turned inward if that is wanted.
    fn cube(min: Vec3, max: Vec3, inward: bool, positions: &mut Vec<Vec3>, triangles: &mut Vec<[u32; 3]>) {
        let first = positions.len() as u32;
        for i in 0..8 {
            let pick = |bit: u32, axis: usize| if i >> bit & 1 == 0 { min[axis] } else { max[axis] };
            positions.push(Vec3::new(pick(0, 0), pick(1, 1), pick(2, 2)));
        }
        for [a, b, c, d] in [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]] {
            for [p, q, r] in [[a, b, c], [a, c, d]] {
                let triangle = if inward { [p, r, q] } else { [p, q, r] };
                triangles.push(triangle.map(|i| first + i));
            }
        }
    }

    /// Boxes that cross, whether faces lie in one plane or not, and boxes in boxes that face alike overlap; apart ones, cavities, and what
    /// is flat or touches nothing do not.
    #[test]
    fn meshes_that_overlap_themselves_are_known() {
        let unit = (Vec3::ZERO, Vec3::ONE);
        let moved = |x: f32, y: f32, z: f32| (Vec3::new(x, y, z), Vec3::new(x, y, z) + 1.0);
        for (what, others, expected) in [
            ("one", vec![], false),
            ("crossing", vec![(moved(0.4, 0.3, 0.2), false)], true),
            ("crossing in planes", vec![(moved(0.5, 0.0, 0.0), false)], true),
            ("apart", vec![(moved(1.5, 0.0, 0.0), false)], false),
            ("nested", vec![((Vec3::splat(0.2), Vec3::splat(0.7)), false)], true),
            ("hollow", vec![((Vec3::splat(0.2), Vec3::splat(0.7)), true)], false),
        ] {
            let (mut positions, mut triangles) = (Vec::new(), Vec::new());
            cube(unit.0, unit.1, false, &mut positions, &mut triangles);
            for ((min, max), inward) in others {
                cube(min, max, inward, &mut positions, &mut triangles);
            }
            let mesh = Mesh::new(positions, triangles, false).unwrap();
            assert!(mesh.is_closed());
            assert_eq!(mesh.overlaps_itself(), expected, "{what}");
        }
    }
}
