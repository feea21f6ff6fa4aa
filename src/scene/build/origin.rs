//! Where a scene's origin is: photons are kept in single precision, and what is seen is to have the digits.

use super::super::description::{Description, LightKind, Place};
use crate::Result;
use crate::math::{Bounds, DVec3};

/// Where the middle of the scene is more than so many times as far from the camera as more than half of its parts are, a few of them
/// lie far beyond all others.
const FAR: f64 = 1e4;
/// Of the scene's extent, a part with a smaller share of it has no digits left.
const DIGITS: f64 = 1e-15;

/// A scene's origin.
#[derive(Debug)]
pub(super) struct Origin {
    pub center: DVec3,
    /// Where a few parts lie far beyond all others, how far those others are from the camera at most; else infinite.
    pub near: f64,
}

impl Origin {
    /// The middle of all shapes, which lie in these boxes, and the camera; the camera itself, where a few parts lie far beyond the
    /// rest.
    ///
    /// # Errors
    /// [`Error::Scene`](crate::Error::Scene) where a shape is so far away, or so large, that another has no digits left.
    pub fn of(description: &Description, shapes: &[(&Place, Bounds)]) -> Result<Self> {
        let camera = description.camera.position;
        let all = shapes.iter().fold(Bounds::of_points([camera]), |all, (_, bounds)| all.union(*bounds));

        let extent = |bounds: &Bounds| bounds.union(Bounds::of_points([camera])).diagonal();
        let farthest = shapes.iter().max_by(|a, b| extent(&a.1).total_cmp(&extent(&b.1)));
        let smallest = shapes.iter().min_by(|a, b| a.1.diagonal().total_cmp(&b.1.diagonal()));
        if let (Some((far, far_bounds)), Some((_, small_bounds))) = (farthest, smallest)
            && small_bounds.diagonal() < DIGITS * extent(far_bounds)
        {
            return Err(far.error(format!(
                "this shape reaches {:.1e} from the camera, which leaves no digits for another that is {:.1e} wide: bring it nearer, or leave it out",
                extent(far_bounds),
                small_bounds.diagonal()
            )));
        }

        let lights = description.lights.iter().filter_map(|light| match light.kind {
            LightKind::Point { position, .. } | LightKind::Spot { position, .. } => Some(position),
            LightKind::Profile { position, .. } => Some(position),
            _ => None,
        });
        // How far the camera can see in what is around it.
        let distance = |bounds: &Bounds| {
            if bounds.contains(camera) {
                0.5 * bounds.diagonal()
            } else {
                camera.clamp(bounds.min, bounds.max).distance(camera)
            }
        };
        let to_shapes = shapes.iter().map(|(_, bounds)| distance(bounds));
        let mut distances: Vec<f64> = to_shapes.chain(lights.map(|place| place.distance(camera))).collect();
        let center = all.center();
        if distances.is_empty() {
            return Ok(Origin { center, near: f64::INFINITY });
        }
        let middle = distances.len() / 2;
        let near = FAR * *distances.select_nth_unstable_by(middle, f64::total_cmp).1;
        if center.distance(camera) <= near {
            return Ok(Origin { center, near: f64::INFINITY });
        }
        Ok(Origin { center: camera, near })
    }
}
