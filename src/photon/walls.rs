//! The surfaces that cut the discs of photons near them.

use smallvec::SmallVec;

use super::Plane;
use super::small::SmallSolids;
use crate::geometry::Near;
use crate::math::Vec3;
use crate::scene::description::Boundaries;
use crate::scene::{Inside, Scene, Solid};

/// Walls whose normals differ by less than this cosine are one: neighbouring faces of a curved mesh.
const ONE_WALL: f64 = 0.9;

/// In a map whose discs have a mean radius of more mean free paths than this, they lean on the nearest boundary of their
/// region: across a ray that leaves at an angle θ to the normal, they would blend depths r sin θ apart. Smaller ones lose
/// less than they would by leaning on walls that the ray does not come through.
const LEANING: f64 = 0.5;

/// How many mean free paths below a boundary discs lean on it at least: what leaves comes from there. Light of discs
/// that do not, from below, would count beside that of those that do.
const DEPTH: f32 = 2.0;

/// The walls that matter for photons of a map, in a medium of this extinction coefficient: see [`near`].
#[derive(Clone, Copy, Debug)]
pub struct Walls {
    /// Its discs lean: all or none, as light of those from below that do not would count beside that of those that do.
    lean: bool,
    /// How far boundaries may be on which discs lean.
    depth: f32,
}

impl Walls {
    /// Of a map whose discs have this mean radius, before passes narrow them: so all passes of a picture make the same of them.
    pub fn of_discs(boundaries: Boundaries, extinction: f64, mean: f64) -> Walls {
        Walls { lean: boundaries == Boundaries::Lean && mean * extinction > LEANING, depth: DEPTH / extinction as f32 }
    }

    /// Whether discs lean.
    pub fn lean(&self) -> bool {
        self.lean
    }

    /// The same without discs that lean.
    pub fn without_leaning(self) -> Walls {
        Walls { lean: false, ..self }
    }

    /// Those of a photon whose disc is so wide. If it does not lean, boundaries of solids `small` to it are none.
    pub fn near(
        &self,
        scene: &Scene,
        small: &SmallSolids,
        (position, radius): (Vec3, f32),
        walls: &mut SmallVec<[Plane; 3]>,
    ) {
        // The disc is drawn around a foot point that may be a radius away from the photon.
        let reach = if self.lean { (2.0 * radius).max(self.depth) } else { 2.0 * radius };
        let passes = |shape| !self.lean && small.is_small(shape, radius);
        find(scene, position, reach, (self.lean, passes), walls);
    }
}

/// The three nearest walls within `radius` of a photon: opaque surfaces, and boundaries of its region. A face
/// counts where the photon stands over it, not past its edge: beyond an edge there is room. Faces that coincide
/// are one wall, and so are faces that hardly differ in direction.
///
/// If the photon's disc `leans`, then on the nearest boundary of its region that is nearer than other walls, be it an
/// edge: its normal points to the photon, as along it the depth grows.
pub fn near(scene: &Scene, position: Vec3, radius: f32, leans: bool, walls: &mut SmallVec<[Plane; 3]>) {
    find(scene, position, radius, (leans, |_| false), walls);
}

/// As [`near`], but for the surfaces of shapes that are passed over.
fn find(
    scene: &Scene,
    position: Vec3,
    radius: f32,
    (leans, passes): (bool, impl Fn(u32) -> bool),
    walls: &mut SmallVec<[Plane; 3]>,
) {
    const MOST: usize = 3;
    let p = position.as_dvec3();
    let mut faces: SmallVec<[(Near, bool); 8]> = SmallVec::new();
    scene.geometry.nearest_surfaces(p, radius as f64, |mut near| {
        if passes(near.id) {
            return;
        }
        let above = (p - near.point).dot(near.normal);
        let over = near.distance - above <= 1e-6 * near.distance;
        if leans && !over {
            near.normal = (p - near.point) / near.distance;
        }
        if leans || over {
            faces.push((near, over));
        }
    });
    faces.sort_unstable_by(|(a, _), (b, _)| {
        a.distance.total_cmp(&b.distance).then((a.id, a.primitive).cmp(&(b.id, b.primitive)))
    });
    let (mut around, mut others) = (None, None);
    let boxed = || {
        let mut solids: SmallVec<[u32; 8]> = SmallVec::new();
        scene.geometry.boxes_around(p, |shape| solids.extend(scene.surfaces[shape as usize].solid));
        solids
    };
    while let Some(&(first, over)) = faces.first() {
        let coincides = |near: &Near| {
            near.normal.dot(first.normal) > 1.0 - 1e-9 && near.distance - first.distance <= 1e-6 * f64::from(radius)
        };
        let coincident = faces.iter().filter(|(near, _)| coincides(near));
        let surfaces = coincident.map(|(near, _)| &scene.surfaces[near.id as usize]);
        let opaque = surfaces.clone().any(|surface| surface.material.shades());
        let is_wall = opaque || {
            let solids: SmallVec<[u32; 8]> = surfaces.filter_map(|surface| surface.solid).collect();
            match solids[..] {
                [] => false,
                // Most often the world is on the other side, whichever side this is.
                [solid]
                    if !scene.solids[solid as usize].overlaps_itself
                        && others.get_or_insert_with(boxed).iter().all(|other| *other == solid) =>
                {
                    scene.region(&Inside::of([solid])) != scene.world_region
                }
                _ => {
                    let inside = around.get_or_insert_with(|| scene.inside(p));
                    let toggled = |beyond: Inside, &solid: &u32| {
                        let Solid { shape, overlaps_itself, .. } = scene.solids[solid as usize];
                        let behind = || first.point - 1e-6 * f64::from(radius) * first.normal;
                        let contained = overlaps_itself && scene.geometry.contains(shape, behind());
                        beyond.with(solid, if overlaps_itself { contained } else { !inside.contains(solid) })
                    };
                    let beyond = solids.iter().fold(inside.clone(), toggled);
                    scene.region(&beyond) != scene.region(inside)
                }
            }
        };
        let leans = leans && walls.is_empty() && is_wall && !opaque;
        if is_wall && (over || leans) {
            walls.push(Plane { normal: first.normal.as_vec3(), distance: first.distance as f32, leans });
            if walls.len() == MOST {
                return;
            }
        }
        faces.retain(|(near, _)| {
            let same = is_wall && near.normal.dot(first.normal) > ONE_WALL;
            // What lies beyond a wall cuts nothing that is left: the next petal of a flower, the room next door.
            let beyond = is_wall && (near.point - first.point).dot(first.normal) < -1e-6 * f64::from(radius);
            !(same || beyond || coincides(near))
        });
    }
}

/// How far the nearest surface is from `position`, of any kind; `limit` if it is farther.
pub fn clearance(scene: &Scene, position: Vec3, limit: f32) -> f32 {
    scene.geometry.clearance(position.as_dvec3(), limit.into()) as f32
}
