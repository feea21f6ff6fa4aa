//! Shapes and where rays, points and samples meet them.
//!
//! A [`Shape`] lives in its own space; [`Placed`] puts it into the world; [`Geometry`] holds all placed
//! shapes and answers questions about them: what a ray meets ([`Geometry::intersect`]), which solids
//! contain a point ([`Geometry::containing`]), which surfaces are near it
//! ([`Geometry::nearest_surfaces`]), and samples of their areas. Everything is `f64`; only the
//! hierarchies' boxes and the vertices of meshes are `f32`.
//!
//! *Out* is away from the inside for sphere, box, cylinder, lathe and any closed mesh, whatever its winding;
//! edge_u × edge_v of the transformed edges for a quad; the side of `normal`, carried along by the
//! inverse transpose, for a disk; the counter-clockwise side in object space, carried along by the
//! transform, for an open mesh. A mirroring transform keeps out out.

mod all;
mod area;
mod cuboid;
mod cylinder;
mod disk;
mod distances;
mod ellipsoid;
mod face;
mod facing;
mod flaws;
mod hull;
mod lathe;
mod mesh;
mod near;
mod obj;
mod overlap;
mod placed;
mod quad;
mod sphere;
mod tree;
mod triangles;

pub use all::Geometry;
pub(crate) use area::area_of;
pub use area::{AreaSample, DirectionSample, Patch};
pub use cuboid::Cuboid;
pub use cylinder::Cylinder;
pub use disk::Disk;
pub use distances::Distances;
pub use flaws::Flaws;
pub use hull::{Hull, HullKind};
pub use lathe::Lathe;
pub use mesh::Mesh;
pub use near::Near;
pub use placed::{Placed, Shape};
pub use quad::Quad;
pub use sphere::Sphere;
pub(crate) use tree::Tree;

use smallvec::SmallVec;

use crate::math::DVec3;
use all::Crossing;

/// Where a ray meets a surface.
#[derive(Clone, Copy, Debug)]
pub struct Hit {
    /// The distance along the ray.
    pub t: f64,
    /// The index of the placed shape.
    pub id: u32,
    /// The face of a box or cylinder, the piece of a lathe, the triangle of a mesh; 0 for the others.
    pub primitive: u32,
    /// The unit geometric normal in the world, pointing out.
    pub normal: DVec3,
    /// The unit normal to shade with, in the hemisphere of `normal`.
    pub shading_normal: DVec3,
    /// Texture coordinates.
    pub uv: [f64; 2],
}

/// The nearest hit of a ray together with all hits within [`error_bound`](crate::math::error_bound) of it: surfaces that
/// coincide are one event. Meant to be reused, so that it allocates at most once.
#[derive(Clone, Debug, Default)]
pub struct Cluster {
    crossings: SmallVec<[Crossing; 4]>,
    hits: SmallVec<[Hit; 4]>,
}

impl Cluster {
    /// Forgets all hits.
    pub fn clear(&mut self) {
        self.hits.clear();
    }

    /// The nearest hit; of several at the same distance the one with the lowest id and primitive.
    pub fn nearest(&self) -> Option<&Hit> {
        self.hits.first()
    }

    /// All hits, ordered by distance, id and primitive.
    pub fn hits(&self) -> &[Hit] {
        &self.hits
    }
}

#[cfg(test)]
mod tests;
