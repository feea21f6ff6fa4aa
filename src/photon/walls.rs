//! The surfaces that cut the discs of photons near them.

use smallvec::SmallVec;

use super::Plane;
use crate::math::Vec3;
use crate::scene::Scene;

/// The three nearest walls within `radius` of a photon: opaque surfaces, and boundaries of its region. A face
/// counts where the photon stands over it, not past its edge: beyond an edge there is room.
pub fn near(scene: &Scene, position: Vec3, radius: f32, walls: &mut SmallVec<[Plane; 3]>) {
    const MOST: usize = 3;
    let p = position.as_dvec3();
    let mut around = None;
    scene.geometry.nearest_surfaces(p, radius as f64, |near| {
        let surface = &scene.surfaces[near.id as usize];
        let above = (p - near.point).dot(near.normal);
        if near.distance - above > 1e-6 * near.distance {
            return;
        }
        let is_wall = surface.material.is_opaque()
            || surface.solid.is_some_and(|solid| {
                let inside = around.get_or_insert_with(|| scene.inside(p));
                scene.region(&inside.with(solid, !inside.contains(solid))) != scene.region(inside)
            });
        if !is_wall {
            return;
        }
        let wall = Plane { normal: near.normal.as_vec3(), distance: near.distance as f32 };
        let at = walls.partition_point(|other| other.distance <= wall.distance);
        if at < MOST {
            walls.truncate(MOST - 1);
            walls.insert(at, wall);
        }
    });
}
