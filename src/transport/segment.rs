//! What a walk passes on its way.

use crate::geometry::Hit;
use crate::math::Ray;
use crate::scene::Inside;

/// A piece of a ray in one medium.
pub struct Segment<'a> {
    /// The ray.
    pub ray: &'a Ray,
    /// The parameter on it where the piece begins.
    pub a: f64,
    /// The parameter where it ends; perhaps infinite.
    pub b: f64,
    /// The medium: an index into [`Scene::media`](crate::scene::Scene::media).
    pub medium: u32,
    /// The solids around it.
    pub inside: &'a Inside,
}

/// A surface that a ray meets and that shines.
pub struct Crossing<'a> {
    /// The ray.
    pub ray: &'a Ray,
    /// The intersection.
    pub hit: &'a Hit,
    /// The light: an index into [`Scene::lights`](crate::scene::Scene::lights).
    pub light: u32,
}
