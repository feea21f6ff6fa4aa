//! Air without an end that light from infinity lights: photons bring little of its light near, and none of what is far.

use super::camera::Camera;
use crate::math::Stream;
use crate::math::random::Purpose;
use crate::scene::Scene;
use crate::scene::description::Method;

/// Looks across and down a picture that tell what is seen of the air beyond where light from infinity is traced.
const LOOKS: u32 = 32;
/// What photons leave out is worth telling from this share of what is seen on.
const BEYOND: f64 = 0.005;
/// Air so many times as wide as a scene leaves more noise of photons than one wants.
const NOISY_AIR: f64 = 4.0;

/// The share of camera rays that collide with the world's medium farther away than photons are traced, which start
/// [around the scene](crate::light::Surroundings) if they come from infinity: as over fog that reaches to the horizon.
fn seen_beyond(scene: &Scene, camera: &Camera) -> f64 {
    let Some(medium) = scene.lit_air() else { return 0.0 };
    if scene.medium(&scene.inside(camera.position)) != scene.world {
        return 0.0;
    }
    let (width, height) = camera.size();
    let places = |of: u32| {
        (0..of.min(LOOKS)).map(move |i| (f64::from(of) * (f64::from(i) + 0.5) / f64::from(of.min(LOOKS))) as u32)
    };
    let beyond = |(x, y): (u32, u32)| {
        let pixel = u64::from(y) * u64::from(width) + u64::from(x);
        let ray = camera.ray(x, y, &mut Stream::new(0, Purpose::Choice, pixel, 0));
        let from = ray.origin - scene.surroundings.center;
        let (toward, radius) = (from.dot(ray.direction), scene.surroundings.radius);
        let leaves = (toward * toward - from.length_squared() + radius * radius).max(0.0).sqrt() - toward;
        let ends = scene.geometry.nearest_where(&ray, 0.0, f64::INFINITY, |_| true);
        let left = |a: f64, b: f64| (-medium.extinction * medium.density.depth(&ray, a, b)).exp().element_sum() / 3.0;
        if ends > leaves { left(0.0, leaves) * (1.0 - left(leaves, ends)) } else { 0.0 }
    };
    let looks: Vec<(u32, u32)> = places(height).flat_map(|y| places(width).map(move |x| (x, y))).collect();
    looks.iter().copied().map(beyond).sum::<f64>() / looks.len() as f64
}

/// Why such air is left to paths, if it is.
pub(super) fn left_to_paths(scene: &Scene, camera: &Camera) -> Option<String> {
    if scene.has_wide_air() {
        let width = scene.width_of_air();
        return Some(format!(
            "as photons from infinity would be traced through air {width:.1} times as wide as the scene"
        ));
    }
    let beyond = seen_beyond(scene, camera);
    (beyond > BEYOND)
        .then(|| format!("as {:.1} % of what is seen is air farther away than photons are traced", 100.0 * beyond))
}

/// What who takes another method should know of such air.
pub(super) fn warning(scene: &Scene, camera: &Camera, method: Method) -> Option<String> {
    let (name, method) = (&scene.lit_air()?.name, method.name());
    let (share, width) = (seen_beyond(scene, camera), scene.width_of_air());
    let what = if share > BEYOND {
        let share = 100.0 * share;
        format!(
            "{share:.1} % of what the camera sees is medium {name} farther away than light from infinity is traced, and is black by method \"{method}\""
        )
    } else if width > NOISY_AIR {
        format!(
            "medium {name} has no end, and light from infinity is traced through air {width:.0} times as wide as the scene, of which method \"{method}\" brings little near"
        )
    } else {
        return None;
    };
    Some(format!("{what}: put the medium into a shape, or use method \"path\""))
}
