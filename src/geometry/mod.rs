//! Shapes and where rays, points and samples meet them.
//!
//! A [`Shape`] lives in its own space; [`Placed`] puts it into the world; [`Geometry`] holds all placed
//! shapes and answers questions about them: what a ray meets ([`Geometry::intersect`]), which solids
//! contain a point ([`Geometry::containing`]), which surfaces are near it
//! ([`Geometry::nearest_surfaces`]), and samples of their areas. Everything is `f64`; only the
//! hierarchies' boxes and the vertices of meshes are `f32`.
//!
//! *Out* is away from the inside for sphere, box, cylinder and any closed mesh, whatever its winding;
//! edge_u × edge_v of the transformed edges for a quad; the side of `normal`, carried along by the
//! inverse transpose, for a disk; the counter-clockwise side in object space, carried along by the
//! transform, for an open mesh. A mirroring transform keeps out out.

mod cuboid;
mod cylinder;
mod disk;
mod ellipsoid;
mod mesh;
mod obj;
mod placed;
mod quad;
mod sphere;
mod tree;

pub use cuboid::Cuboid;
pub use cylinder::Cylinder;
pub use disk::Disk;
pub use mesh::Mesh;
pub use placed::{Placed, Shape};
pub use quad::Quad;
pub use sphere::Sphere;

use crate::math::{Bounds, DVec3, Frame, Ray, error_bound, sampling};
use smallvec::SmallVec;
use std::f64::consts::TAU;
use tree::Tree;

/// Up to this many placed shapes are tried one after the other; a tree wins above.
const LOOP_LIMIT: usize = 12;

/// Where a ray meets a surface.
#[derive(Clone, Copy, Debug)]
pub struct Hit {
    /// The distance along the ray.
    pub t: f64,
    /// The index of the placed shape.
    pub id: u32,
    /// The face of a box or cylinder, the triangle of a mesh; 0 for the others.
    pub primitive: u32,
    /// The unit geometric normal in the world, pointing out.
    pub normal: DVec3,
    /// The unit normal to shade with, in the hemisphere of `normal`.
    pub shading_normal: DVec3,
    /// Texture coordinates.
    pub uv: [f64; 2],
}

/// A hit before its normals are needed.
#[derive(Clone, Copy, Debug)]
struct Crossing {
    t: f64,
    id: u32,
    primitive: u32,
    weights: [f64; 2],
}

/// The nearest hit of a ray together with all hits within [`error_bound`] of it: surfaces that coincide
/// are one event. Meant to be reused, so that it allocates at most once.
#[derive(Clone, Debug, Default)]
pub struct Cluster {
    crossings: SmallVec<[Crossing; 4]>,
    hits: SmallVec<[Hit; 4]>,
}

impl Cluster {
    /// The nearest hit; of several at the same distance the one with the lowest id and primitive.
    pub fn nearest(&self) -> Option<&Hit> {
        self.hits.first()
    }

    /// All hits, ordered by distance, id and primitive.
    pub fn hits(&self) -> &[Hit] {
        &self.hits
    }
}

/// A point drawn on a surface.
#[derive(Clone, Copy, Debug)]
pub struct AreaSample {
    /// The point in the world.
    pub point: DVec3,
    /// The unit geometric normal, pointing out.
    pub normal: DVec3,
    /// The density per area in the world.
    pub pdf: f64,
}

/// A point of a surface drawn as seen from another point.
#[derive(Clone, Copy, Debug)]
pub struct DirectionSample {
    /// The point in the world.
    pub point: DVec3,
    /// The unit geometric normal there, pointing out.
    pub normal: DVec3,
    /// The unit direction to it.
    pub direction: DVec3,
    /// The distance to it.
    pub distance: f64,
    /// The density per solid angle at the other point.
    pub pdf: f64,
}

/// The closest point of a face.
#[derive(Clone, Copy, Debug)]
pub struct Near {
    /// The index of the placed shape.
    pub id: u32,
    /// The face, as in [`Hit::primitive`].
    pub primitive: u32,
    /// The closest point of the face.
    pub point: DVec3,
    /// The face's unit normal there, towards the side on which the query lies.
    pub normal: DVec3,
    /// From the query to `point`.
    pub distance: f64,
}

/// All placed shapes of a scene.
#[derive(Debug)]
pub struct Geometry {
    placed: Vec<Placed>,
    /// None for a handful of shapes.
    tree: Option<Tree>,
    bounds: Bounds,
}

impl Geometry {
    /// The shapes' ids are their indices.
    pub fn new(placed: Vec<Placed>) -> Self {
        Self::with_loop_limit(placed, LOOP_LIMIT)
    }

    fn with_loop_limit(placed: Vec<Placed>, limit: usize) -> Self {
        let boxes: Vec<Bounds> = placed.iter().map(Placed::bounds).collect();
        let bounds = boxes.iter().fold(Bounds::EMPTY, |all, b| all.union(*b));
        let tree = (placed.len() > limit).then(|| Tree::new(&boxes));
        Geometry { placed, tree, bounds }
    }

    /// The shapes, by id.
    pub fn placed(&self) -> &[Placed] {
        &self.placed
    }

    /// The box around a shape.
    pub fn bounds(&self, id: u32) -> Bounds {
        self.placed[id as usize].bounds()
    }

    /// The box around all shapes.
    pub fn all_bounds(&self) -> Bounds {
        self.bounds
    }

    /// Calls `visit` for every crossing with `t_min < t < t_max`; it returns the new `t_max`.
    #[inline]
    fn crossings(&self, ray: &Ray, t_min: f64, t_max: f64, mut visit: impl FnMut(Crossing) -> f64) {
        let mut limit = t_max;
        let mut shape = |id: u32| {
            let before = limit;
            self.placed[id as usize].crossings(ray, t_min, before, &mut |t, primitive, weights| {
                limit = visit(Crossing { t, id, primitive, weights });
                limit
            });
            limit
        };
        match &self.tree {
            None => {
                for id in 0..self.placed.len() as u32 {
                    if shape(id) < t_min {
                        return;
                    }
                }
            }
            Some(tree) => {
                let order = tree.order();
                tree.along(ray, t_min, t_max, |i| shape(order[i as usize]));
            }
        }
    }

    /// The nearest hit with `t_min < t < t_max` and those that coincide with it go into `out`. Returns
    /// whether there is one.
    pub fn intersect(&self, ray: &Ray, t_min: f64, t_max: f64, out: &mut Cluster) -> bool {
        let Cluster { crossings, hits } = out;
        crossings.clear();
        hits.clear();
        let (mut nearest, mut limit) = (f64::INFINITY, t_max);
        self.crossings(ray, t_min, t_max, |crossing| {
            if crossing.t < nearest {
                nearest = crossing.t;
                let last = nearest + error_bound(ray, nearest);
                limit = limit.min(last.next_up());
                crossings.retain(|c| c.t <= last);
            }
            crossings.push(crossing);
            limit
        });
        crossings.sort_unstable_by(|a, b| a.t.total_cmp(&b.t).then((a.id, a.primitive).cmp(&(b.id, b.primitive))));
        hits.extend(crossings.iter().map(|c| self.hit(ray, c)));
        !hits.is_empty()
    }

    /// Calls `visit` for every hit with `t_min < t < t_max`, in no particular order.
    pub fn all_hits(&self, ray: &Ray, t_min: f64, t_max: f64, mut visit: impl FnMut(Hit)) {
        self.crossings(ray, t_min, t_max, |crossing| {
            visit(self.hit(ray, &crossing));
            t_max
        });
    }

    /// Whether the ray meets, with `t_min < t < t_max`, a shape for whose id `blocks` holds.
    pub fn occluded(&self, ray: &Ray, t_min: f64, t_max: f64, blocks: impl Fn(u32) -> bool) -> bool {
        let mut blocked = false;
        self.crossings(ray, t_min, t_max, |crossing| {
            blocked = blocked || blocks(crossing.id);
            if blocked { f64::NEG_INFINITY } else { t_max }
        });
        blocked
    }

    fn hit(&self, ray: &Ray, c: &Crossing) -> Hit {
        let surface = self.placed[c.id as usize].surface(ray, c.t, c.primitive, c.weights);
        Hit {
            t: c.t,
            id: c.id,
            primitive: c.primitive,
            normal: surface.normal,
            shading_normal: surface.shading_normal,
            uv: surface.uv,
        }
    }

    /// Whether a shape encloses a volume: spheres, boxes, cylinders with caps, and meshes as
    /// [`Mesh::is_closed`] says.
    pub fn is_closed(&self, id: u32) -> bool {
        self.placed[id as usize].is_closed()
    }

    /// Whether a closed shape contains `p`; never for open ones. Points on the surface may count either
    /// way, but always the same.
    pub fn contains(&self, id: u32, p: DVec3) -> bool {
        self.placed[id as usize].contains(p)
    }

    /// The ids of all closed shapes that contain `p` go into `out`, ascending.
    pub fn containing(&self, p: DVec3, out: &mut SmallVec<[u32; 8]>) {
        out.clear();
        let mut test = |id: u32| {
            if self.bounds(id).contains(p) && self.contains(id, p) {
                out.push(id);
            }
        };
        match &self.tree {
            None => (0..self.placed.len() as u32).for_each(test),
            Some(tree) => {
                tree.overlapping(&Bounds { min: p, max: p }, |i| test(tree.order()[i as usize]));
                out.sort_unstable();
            }
        }
    }

    /// The area of a shape in the world.
    pub fn area(&self, id: u32) -> f64 {
        self.placed[id as usize].area()
    }

    /// A point on a shape. Uniform by world area for quads, disks, boxes and under similarity
    /// transforms; otherwise uniform by area in object space, which `pdf` accounts for.
    pub fn sample_area(&self, id: u32, u: [f64; 2]) -> AreaSample {
        let (point, normal, pdf) = self.placed[id as usize].sample_area(u);
        AreaSample { point, normal, pdf }
    }

    /// The density, per world area, with which [`Geometry::sample_area`] draws the place of `hit`.
    pub fn pdf_area(&self, id: u32, hit: &Hit) -> f64 {
        self.placed[id as usize].pdf_area(hit.normal)
    }

    /// A point on a shape for the light it sends towards `from`: for what is a sphere in the world, seen
    /// from outside, uniform in the cone it subtends (Shirley, Wang and Zimmerman 1996); else
    /// [`Geometry::sample_area`] with its density per solid angle, d²/|cos θ| times that per area. `None`
    /// when the point drawn is seen edge-on or coincides with `from`.
    pub fn sample_toward(&self, id: u32, from: DVec3, u: [f64; 2]) -> Option<DirectionSample> {
        if let Some(cone) = Cone::of(&self.placed[id as usize], from) {
            return Some(cone.sample(from, u));
        }
        let AreaSample { point, normal, pdf } = self.sample_area(id, u);
        let distance = point.distance(from);
        let direction = (point - from) / distance;
        let pdf = pdf * distance * distance / direction.dot(normal).abs();
        (pdf.is_finite() && direction.is_finite()).then_some(DirectionSample {
            point,
            normal,
            direction,
            distance,
            pdf,
        })
    }

    /// The density, per solid angle at `from`, with which [`Geometry::sample_toward`] draws the place of
    /// `hit`, which lies in `direction`; 0 for the far side of a sphere seen from outside.
    pub fn pdf_toward(&self, id: u32, from: DVec3, hit: &Hit, direction: DVec3) -> f64 {
        let cosine = direction.dot(hit.normal);
        if let Some(cone) = Cone::of(&self.placed[id as usize], from) {
            return if cosine <= 0.0 { cone.pdf() } else { 0.0 };
        }
        let pdf = self.pdf_area(id, hit) * hit.t * hit.t / cosine.abs();
        if pdf.is_finite() { pdf } else { 0.0 }
    }

    /// Calls `visit` with the closest point of every face within `radius` of `p`: spheres, quads, disks
    /// and cylinders' sides and caps have one, boxes six, meshes one a triangle, of which those of one
    /// mesh that face the same way (to 10⁻³) are merged into the nearest. So the corner of a room gives
    /// three planes. Exact for flat faces and under similarity transforms; for spheres, disks and
    /// cylinders stretched unequally a point of the surface at least as close as the image of the closest
    /// one in object space, improved by iteration.
    pub fn nearest_surfaces(&self, p: DVec3, radius: f64, mut visit: impl FnMut(Near)) {
        let around = Bounds { min: p - radius, max: p + radius };
        let mut merged: SmallVec<[Near; 16]> = SmallVec::new();
        let mut shape = |id: u32| {
            let placed = &self.placed[id as usize];
            if !placed.bounds().overlaps(&around) {
                return;
            }
            let merge = matches!(placed.shape(), Shape::Mesh(_));
            merged.clear();
            placed.faces_near(p, radius, &mut |primitive, point, normal| {
                let normal = if normal.dot(p - point) < 0.0 { -normal } else { normal };
                let near = Near { id, primitive, point, normal, distance: point.distance(p) };
                let same = |other: &&mut Near| other.normal.distance_squared(normal) < 1e-6;
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
        };
        match &self.tree {
            None => (0..self.placed.len() as u32).for_each(shape),
            Some(tree) => tree.overlapping(&around, |i| shape(tree.order()[i as usize])),
        }
    }
}

/// The cone a sphere subtends at a point outside.
struct Cone {
    center: DVec3,
    radius: f64,
    /// To the centre.
    distance: f64,
    sin2_max: f64,
    /// 1 − cos of the half-angle.
    one_minus_cos_max: f64,
}

impl Cone {
    fn of(placed: &Placed, from: DVec3) -> Option<Self> {
        let (center, radius) = placed.world_sphere()?;
        let distance = center.distance(from);
        if distance <= radius {
            return None;
        }
        let sine = radius / distance;
        let sin2_max = sine * sine;
        // cos from (d − r)(d + r), which keeps its digits close to the surface.
        let cos_max = ((distance - radius) * (distance + radius)).sqrt() / distance;
        Some(Cone { center, radius, distance, sin2_max, one_minus_cos_max: sin2_max / (1.0 + cos_max) })
    }

    fn pdf(&self) -> f64 {
        (TAU * self.one_minus_cos_max).recip()
    }

    fn sample(&self, from: DVec3, u: [f64; 2]) -> DirectionSample {
        let frame = Frame::around((self.center - from) / self.distance);
        let local = sampling::cone(self.one_minus_cos_max, u);
        // ---- the nearer intersection; no difference of close numbers, whatever the sphere's size
        let w = u[0] * self.one_minus_cos_max;
        let sin2 = w * (2.0 - w);
        let half_chord = (1.0 - sin2 / self.sin2_max).max(0.0).sqrt();
        let power = (self.distance - self.radius) * (self.distance + self.radius);
        let distance = power / (self.distance * local.z + self.radius * half_chord);
        // ---- the angle between the normal and the way back to `from`
        let sine = distance / self.radius;
        let cosine = sin2 / self.sin2_max.sqrt() + local.z * half_chord;
        let normal = frame.to_world(DVec3::new(sine * local.x, sine * local.y, -cosine)).normalize();
        let direction = frame.to_world(local).normalize();
        DirectionSample { point: self.center + self.radius * normal, normal, direction, distance, pdf: self.pdf() }
    }
}
