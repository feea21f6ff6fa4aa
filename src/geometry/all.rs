//! All shapes of a scene, and what rays and points meet of them.

use std::ops::Range;

use smallvec::SmallVec;

use super::tree::Tree;
use super::{Cluster, Hit, Placed, Shape};
use crate::math::{Bounds, DVec3, Ray, error_bound};

/// A hit before its normals are needed.
#[derive(Clone, Copy, Debug)]
pub(super) struct Crossing {
    t: f64,
    id: u32,
    primitive: u32,
    weights: [f64; 2],
}

/// Puts crossings in the order in which a ray meets them; where several coincide, by shape and primitive.
fn sort(crossings: &mut [Crossing]) {
    if crossings.len() > 1 {
        crossings.sort_unstable_by(|a, b| a.t.total_cmp(&b.t).then((a.id, a.primitive).cmp(&(b.id, b.primitive))));
    }
}

/// All placed shapes of a scene.
#[derive(Debug)]
pub struct Geometry {
    pub(super) placed: Vec<Placed>,
    pub(super) tree: Tree,
    bounds: Bounds,
}

impl Geometry {
    /// The shapes' ids are their indices.
    pub fn new(placed: Vec<Placed>) -> Self {
        let boxes: Vec<Bounds> = placed.iter().map(Placed::bounds).collect();
        let bounds = boxes.iter().fold(Bounds::EMPTY, |all, b| all.union(*b));
        Geometry { tree: Tree::new(&boxes), placed, bounds }
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
        let order = self.tree.order();
        self.tree.along(ray, t_min, t_max, |i| {
            let id = order[i as usize];
            let before = limit;
            self.placed[id as usize].crossings(ray, t_min, before, &mut |t, primitive, weights| {
                limit = visit(Crossing { t, id, primitive, weights });
                limit
            });
            limit
        });
    }

    /// The nearest hit with `t_min < t < t_max` and those that coincide with it go into `out`. Returns
    /// whether there is one.
    pub fn intersect(&self, ray: &Ray, t_min: f64, t_max: f64, out: &mut Cluster) -> bool {
        let crossings = &mut out.crossings;
        crossings.clear();
        let (mut nearest, mut limit) = (f64::INFINITY, t_max);
        self.crossings(ray, t_min, t_max, |crossing| {
            if crossing.t < nearest {
                nearest = crossing.t;
                let last = nearest + error_bound(ray, nearest);
                limit = limit.min(last.next_up());
                if !crossings.is_empty() {
                    crossings.retain(|c| c.t <= last);
                }
            }
            crossings.push(crossing);
            limit
        });
        sort(crossings);
        self.take(ray, out, 0..out.crossings.len())
    }

    /// All crossings with `t_min < t < t_max` go into `out`, for [`Geometry::intersect_next`] to take. Returns whether none of
    /// them is of a shape for whose id `blocks` holds; what there is in `out` is of no use otherwise.
    pub fn collect(&self, ray: &Ray, t_min: f64, t_max: f64, blocks: impl Fn(u32) -> bool, out: &mut Cluster) -> bool {
        let crossings = &mut out.crossings;
        crossings.clear();
        let mut free = true;
        self.crossings(ray, t_min, t_max, |crossing| {
            free = free && !blocks(crossing.id);
            crossings.push(crossing);
            if free { t_max } else { f64::NEG_INFINITY }
        });
        if free {
            sort(crossings);
        }
        free
    }

    /// What [`Geometry::intersect`] finds, of the crossings that [`Geometry::collect`] found on this ray.
    pub fn intersect_next(&self, ray: &Ray, t_min: f64, t_max: f64, out: &mut Cluster) -> bool {
        let first = out.crossings.partition_point(|c| c.t <= t_min);
        let Some(nearest) = out.crossings.get(first).filter(|c| c.t < t_max) else {
            out.hits.clear();
            return false;
        };
        let last = (nearest.t + error_bound(ray, nearest.t)).min(t_max.next_down());
        let count = out.crossings[first..].iter().take_while(|c| c.t <= last).count();
        self.take(ray, out, first..first + count)
    }

    /// These of the crossings become the hits.
    fn take(&self, ray: &Ray, out: &mut Cluster, range: Range<usize>) -> bool {
        let Cluster { crossings, hits } = out;
        hits.clear();
        hits.extend(crossings[range].iter().map(|crossing| self.hit(ray, crossing)));
        !hits.is_empty()
    }

    /// Calls `visit` for every hit with `t_min < t < t_max`, in no particular order.
    pub fn all_hits(&self, ray: &Ray, t_min: f64, t_max: f64, mut visit: impl FnMut(Hit)) {
        self.crossings(ray, t_min, t_max, |crossing| {
            visit(self.hit(ray, &crossing));
            t_max
        });
    }

    /// How far the nearest hit lies with `t_min < t < t_max` for which `counts` holds; `t_max` if there is none.
    pub fn nearest_where(&self, ray: &Ray, t_min: f64, t_max: f64, counts: impl Fn(&Hit) -> bool) -> f64 {
        let mut nearest = t_max;
        self.crossings(ray, t_min, t_max, |crossing| {
            if crossing.t < nearest && counts(&self.hit(ray, &crossing)) {
                nearest = crossing.t;
            }
            nearest
        });
        nearest
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

    #[inline]
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

    /// The point at which a ray hits a shape, in its object space.
    pub fn object_point(&self, ray: &Ray, hit: &Hit) -> DVec3 {
        self.placed[hit.id as usize].to_object(ray.at(hit.t))
    }

    /// ∂p/∂u and ∂p/∂v in object space and in the world, at a point of a shape's surface in object space.
    pub fn tangents(&self, hit: &Hit, object: DVec3) -> [[DVec3; 2]; 2] {
        let placed = &self.placed[hit.id as usize];
        let tangents = placed.tangents(object, hit.primitive);
        [tangents, tangents.map(|along| placed.vector_to_world(along))]
    }

    /// The centre and the radius of a sphere around a shape: itself, where it is one in the world.
    pub fn bounding_sphere(&self, id: u32) -> (DVec3, f64) {
        let bounds = self.bounds(id);
        self.placed[id as usize].world_sphere().unwrap_or((bounds.center(), 0.5 * bounds.diagonal()))
    }

    /// Whether a shape encloses a volume: spheres, boxes, cylinders with caps, lathes whose ends lie on the
    /// axis or coincide, and meshes as [`Mesh::is_closed`](super::Mesh::is_closed) says.
    pub fn is_closed(&self, id: u32) -> bool {
        self.placed[id as usize].is_closed()
    }

    /// Whether a closed shape may overlap itself, so that its faces do not tell what lies behind them.
    pub fn overlaps_itself(&self, id: u32) -> bool {
        matches!(self.placed[id as usize].shape(), Shape::Mesh(mesh) if mesh.overlaps_itself())
    }

    /// Whether a closed shape contains `p`; never for open ones. Points on the surface may count either
    /// way, but always the same.
    pub fn contains(&self, id: u32, p: DVec3) -> bool {
        self.placed[id as usize].contains(p)
    }

    /// Whether a closed shape contains all of a box, or nothing of it; `None` where neither is certain.
    pub fn contains_all(&self, id: u32, bounds: &Bounds) -> Option<bool> {
        let placed = &self.placed[id as usize];
        if !placed.bounds().overlaps(bounds) {
            return Some(false);
        }
        let convex = matches!(placed.shape(), Shape::Sphere(_) | Shape::Cuboid(_) | Shape::Cylinder(_));
        if convex && bounds.corners().into_iter().all(|corner| placed.contains(corner)) {
            return Some(true);
        }
        let (center, reach) = (bounds.center(), 0.5 * bounds.diagonal());
        (placed.clearance(center, 2.0 * reach) > reach).then(|| placed.contains(center))
    }

    /// The ids of all closed shapes that contain `p` go into `out`, ascending.
    pub fn containing(&self, p: DVec3, out: &mut SmallVec<[u32; 8]>) {
        out.clear();
        self.boxes_around(p, |id| {
            if self.contains(id, p) {
                out.push(id);
            }
        });
        out.sort_unstable();
    }

    /// Calls `visit` with the ids of shapes whose box contains `p`, and a few more.
    pub fn boxes_around(&self, p: DVec3, visit: impl FnMut(u32)) {
        self.boxes_overlapping(&Bounds { min: p, max: p }, visit);
    }

    /// Calls `visit` with the ids of shapes whose box overlaps this one, and a few more.
    pub fn boxes_overlapping(&self, bounds: &Bounds, mut visit: impl FnMut(u32)) {
        self.tree.overlapping(bounds, |i| visit(self.tree.order()[i as usize]));
    }
}
