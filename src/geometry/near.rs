//! What is near a point: how far it is, and the closest point of every face.

use smallvec::SmallVec;

use super::mesh::SAME_WAY;
use super::{Geometry, Shape};
use crate::math::{Bounds, DVec3};

/// The closest point of a face.
#[derive(Clone, Copy, Debug)]
pub struct Near {
    /// The index of the placed shape.
    pub id: u32,
    /// The face, as in [`Hit::primitive`](super::Hit::primitive).
    pub primitive: u32,
    /// The closest point of the face.
    pub point: DVec3,
    /// The face's unit normal there, towards the side on which the query lies.
    pub normal: DVec3,
    /// From the query to `point`.
    pub distance: f64,
}

impl Geometry {
    /// How far the nearest surface is from `p`; `limit` if it is farther. Quick however many triangles there
    /// are.
    pub fn clearance(&self, p: DVec3, limit: f64) -> f64 {
        let mut nearest = limit;
        self.tree.near(p, limit, |i| {
            nearest = self.placed[self.tree.order()[i as usize] as usize].clearance(p, nearest);
            nearest
        });
        nearest
    }

    /// Calls `visit` with the closest point of every face within `radius` of `p`: spheres, quads, disks and cylinders'
    /// sides and caps have one, boxes six, lathes one a piece; meshes their nearest triangle, and of those that `p` stands
    /// over (to 18 degrees) at most six. Faces of one lathe or mesh that face the same way (to 18 degrees) are merged into
    /// the nearest, and their normals lean towards `p` over edges that turn less. So the corner of a room gives three
    /// planes.
    pub fn nearest_surfaces(&self, p: DVec3, radius: f64, mut visit: impl FnMut(Near)) {
        let around = Bounds { min: p - radius, max: p + radius };
        let mut merged: SmallVec<[Near; 16]> = SmallVec::new();
        self.tree.overlapping(&around, |i| {
            let id = self.tree.order()[i as usize];
            let placed = &self.placed[id as usize];
            if !placed.bounds().overlaps(&around) {
                return;
            }
            let merge = matches!(placed.shape(), Shape::Lathe(_) | Shape::Mesh(_));
            merged.clear();
            placed.faces_near(p, radius, &mut |primitive, point, normal| {
                let distance = point.distance(p);
                let mut normal = if normal.dot(p - point) < 0.0 { -normal } else { normal };
                // Over an edge between faces that hardly turn, the smooth surface that they stand for faces `p`.
                if merge && normal.dot(p - point) > SAME_WAY * distance {
                    normal = (p - point) / distance;
                }
                let near = Near { id, primitive, point, normal, distance };
                let same = |other: &&mut Near| other.normal.dot(normal) > SAME_WAY;
                match merged.iter_mut().find(same).filter(|_| merge) {
                    Some(other) => {
                        if (near.distance, near.primitive) < (other.distance, other.primitive) {
                            *other = near;
                        }
                    }
                    None => merged.push(near),
                }
            });
            merged.iter().for_each(|near| visit(*near));
        });
    }
}
