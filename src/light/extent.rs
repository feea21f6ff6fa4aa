//! What emitters take up, alone and in groups.

use super::{Area, Directivity, Emitter, Goniometric, Light, Point, Sides, SoftCone, Spot};
use crate::geometry::{Geometry, Shape, area_of};
use crate::math::{Bounds, DVec3};
use std::f64::consts::{FRAC_PI_2, PI};

/// What an emitter takes up, or several together: where they are, whither they shine, and how much.
#[derive(Clone, Copy, Debug)]
pub(super) struct Extent {
    /// A box around them.
    pub bounds: Bounds,
    /// Their middle, weighted by intensity.
    pub center: DVec3,
    /// The mean square of the distance from there, weighted likewise.
    pub spread: f64,
    /// No part is farther from the middle.
    pub radius: f64,
    /// Whither they shine.
    pub cone: Cone,
    /// W/sr in the direction in which each is brightest, all channels together.
    pub intensity: f64,
    /// The mean over all directions, in shares of that.
    pub mean: f64,
    /// Of the intensity the share that falls with the square of the cosine beyond bright directions, as that of spots about
    /// does.
    pub soft: f64,
    /// No emitter's area is smaller.
    pub area: f64,
}

/// Directions in which emitters are brightest, and how far beyond these they shine.
#[derive(Clone, Copy, Debug)]
pub(super) struct Cone {
    /// The middle of the brightest directions; zero where these are all around.
    pub axis: DVec3,
    /// Half the angle between the outermost of these.
    pub bright: f64,
    /// How far from a brightest direction there is light.
    pub beyond: f64,
}

impl Cone {
    /// All directions alike.
    const ALL: Cone = Cone { axis: DVec3::ZERO, bright: PI, beyond: 0.0 };

    /// Whether there is no direction without light, as far as is certain.
    pub fn is_all(&self) -> bool {
        self.axis == DVec3::ZERO || self.bright + self.beyond > 0.99 * PI
    }

    fn of(cone: &SoftCone) -> Self {
        // Half-angles from 1 − cos x = 2 sin² (x/2).
        let [inner, outer] = [cone.inner, cone.outer].map(|below| 2.0 * (0.5 * below).sqrt().min(1.0).asin());
        Cone { axis: cone.axis, bright: inner, beyond: outer - inner }
    }
}

/// The angle between unit vectors, exact where it is small.
fn angle(a: DVec3, b: DVec3) -> f64 {
    a.cross(b).length().atan2(a.dot(b))
}

impl Extent {
    /// Of an emitter whose light thins with the square of the distance; `None` for others, and for what sends none.
    pub fn of(emitter: Emitter, light: &Light, geometry: &Geometry) -> Option<Extent> {
        let extent = match light {
            Light::Point(Point { position, intensity }) => Extent::at(*position, intensity.element_sum(), None),
            Light::Spot(Spot { position, intensity, cone }) => {
                Extent::at(*position, intensity.element_sum(), Some(cone))
            }
            Light::Goniometric(lamp) => Extent::of_profile(lamp),
            Light::Area(area) if matches!(area.profile, Directivity::Beam(..)) => return None,
            Light::Area(area) => match emitter.triangle {
                Some(triangle) => Extent::of_triangle(area, geometry.triangle(area.shape, triangle)?),
                None => Extent::of_shape(area, geometry),
            },
            Light::Directional(_) | Light::Environment(_) => return None,
        };
        (extent.intensity > 0.0).then_some(extent)
    }

    fn at(position: DVec3, intensity: f64, cone: Option<&SoftCone>) -> Extent {
        Extent {
            bounds: Bounds::of_points([position]),
            center: position,
            spread: 0.0,
            radius: 0.0,
            cone: cone.map_or(Cone::ALL, Cone::of),
            intensity,
            mean: cone.map_or(1.0, mean_of),
            soft: if cone.is_some() { 1.0 } else { 0.0 },
            area: 0.0,
        }
    }

    fn of_profile(lamp: &Goniometric) -> Extent {
        // A measurement may end with all its light: beyond by what rounding may amount to.
        const MARGIN: f64 = 1e-3;
        let profile = lamp.profile();
        let cone = Cone { axis: lamp.axis(), bright: (profile.widest() + MARGIN).min(PI), beyond: 0.0 };
        let mean = profile.total() / (4.0 * PI);
        Extent { cone, mean, ..Extent::at(lamp.position, lamp.intensity.element_sum(), None) }
    }

    fn of_triangle(light: &Area, (corners, normal): ([DVec3; 3], DVec3)) -> Extent {
        let [a, b, c] = corners;
        let center = (a + b + c) / 3.0;
        let edges = a.distance_squared(b) + b.distance_squared(c) + c.distance_squared(a);
        let area = area_of(corners);
        Extent {
            bounds: Bounds::of_points(corners),
            center,
            spread: edges / 36.0,
            radius: corners.into_iter().map(|corner| corner.distance(center)).fold(0.0, f64::max),
            cone: facing(light.sides, normal),
            intensity: light.power().element_sum() * (area / light.area) / (PI * light.sides.count()),
            mean: 0.25 * light.sides.count(),
            soft: 0.0,
            area,
        }
    }

    fn of_shape(light: &Area, geometry: &Geometry) -> Extent {
        let flat = match geometry.placed()[light.shape as usize].shape() {
            Shape::Quad(_) | Shape::Disk(_) => Some(geometry.sample_area(light.shape, [0.5; 2]).normal),
            _ => None,
        };
        let power = light.power().element_sum();
        let sides = light.sides.count();
        let (cone, intensity, mean, soft) = match (light.profile, flat) {
            (Directivity::Spot(intensity, cone), _) => (Cone::of(&cone), intensity.element_sum(), mean_of(&cone), 1.0),
            // A flat one is brightest along its normal; round ones are about as bright from all sides.
            (_, Some(normal)) => (facing(light.sides, normal), power / (PI * sides), 0.25 * sides, 0.0),
            (_, None) => (Cone::ALL, power / (4.0 * PI), 1.0, 0.0),
        };
        let radius = 0.5 * light.bounds.diagonal();
        Extent {
            bounds: light.bounds,
            center: light.bounds.center(),
            // As of a square's area.
            spread: radius * radius / 3.0,
            radius,
            cone,
            intensity,
            mean,
            soft,
            area: light.area,
        }
    }

    /// What all of these take up together.
    pub fn around<'a>(parts: impl Iterator<Item = &'a Extent> + Clone) -> Extent {
        let (mut bounds, mut intensity, mut area) = (Bounds::EMPTY, 0.0, f64::INFINITY);
        let (mut center, mut axis, mut mean, mut soft) = (DVec3::ZERO, DVec3::ZERO, 0.0, 0.0);
        for part in parts.clone() {
            bounds = bounds.union(part.bounds);
            intensity += part.intensity;
            mean += part.intensity * part.mean;
            soft += part.intensity * part.soft;
            area = part.area.min(area);
            center += part.intensity * part.center;
            axis += part.intensity * part.cone.axis;
        }
        center = (center / intensity).clamp(bounds.min, bounds.max);
        let axis = axis.try_normalize().unwrap_or(DVec3::ZERO);
        (mean, soft) = (mean / intensity, soft / intensity);
        let (spread, radius, cone) = (0.0, 0.0, Cone::ALL);
        let mut all = Extent { bounds, center, spread, radius, cone, intensity, mean, soft, area };
        let (mut bright, mut beyond) = (0.0, 0.0);
        for part in parts {
            let apart2 = part.center.distance_squared(center);
            all.spread += part.intensity / intensity * (part.spread + apart2);
            all.radius = all.radius.max(apart2.sqrt() + part.radius);
            let from_axis = if part.cone.is_all() { PI } else { angle(axis, part.cone.axis) + part.cone.bright };
            bright = from_axis.max(bright);
            beyond = part.cone.beyond.max(beyond);
        }
        if axis != DVec3::ZERO && bright < PI {
            all.cone = Cone { axis, bright, beyond };
        }
        all
    }
}

/// The mean intensity over all directions, in shares of that on the axis.
fn mean_of(cone: &SoftCone) -> f64 {
    cone.solid_angle() / (4.0 * PI)
}

/// The directions in which a flat diffuse emitter shines.
fn facing(sides: Sides, normal: DVec3) -> Cone {
    let one_side = |axis| Cone { axis, bright: 0.0, beyond: FRAC_PI_2 };
    match sides {
        Sides::Out => one_side(normal),
        Sides::In => one_side(-normal),
        Sides::Both => Cone::ALL,
    }
}
