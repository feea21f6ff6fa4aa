//! Lights: `[[lights]]`.

use std::path::PathBuf;

use super::{Located, Place};
use crate::math::{DVec3, Rgb};

/// `[[lights]]`
#[derive(Clone, Debug, PartialEq)]
pub struct Light {
    /// What overrides and messages call it.
    pub name: Option<String>,
    /// What it is.
    pub kind: LightKind,
    /// Where it is described.
    pub place: Place,
}

/// The kinds of light. Strengths are by channel and at least 0.
#[derive(Clone, Debug, PartialEq)]
pub enum LightKind {
    /// The same in every direction.
    Point {
        /// Where it is.
        position: DVec3,
        /// In W/sr; power/4π where a power was given.
        intensity: Rgb,
        /// Above 0, a sphere of the same power.
        radius: f64,
    },
    /// A cone with a soft edge.
    Spot {
        /// Where it is.
        position: DVec3,
        /// The unit vector towards its target.
        direction: DVec3,
        /// In W/sr on the axis; computed from the power where one was given.
        intensity: Rgb,
        /// The half-angle within which it is full, in degrees, at most `outer_angle`.
        inner_angle: f64,
        /// The half-angle outside of which it is dark, in degrees, in (0, 90].
        outer_angle: f64,
        /// Above 0, a disc facing the target with the same intensity far away.
        radius: f64,
    },
    /// Parallel light, or nearly so.
    Directional {
        /// The unit direction of travel.
        direction: DVec3,
        /// In W/unit² on a plane that faces it.
        irradiance: Rgb,
        /// The apparent diameter in degrees, in [0, 180).
        angle: f64,
        /// The round beam it is restricted to; `None`: unbounded.
        beam: Option<Beam>,
    },
    /// Light from infinity, all around.
    Environment {
        /// Where its radiance comes from.
        source: EnvironmentSource,
        /// What the radiance is multiplied by.
        scale: Rgb,
        /// The turn about +y in degrees, counter-clockwise from above.
        rotate: f64,
    },
}

/// The disc a round directional beam starts on, perpendicular to its direction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Beam {
    /// The disc's centre.
    pub center: DVec3,
    /// The disc's radius, above 0.
    pub radius: f64,
}

/// Where an environment's radiance comes from.
#[derive(Clone, Debug, PartialEq)]
pub enum EnvironmentSource {
    /// The same radiance from everywhere, in W/(sr · unit²).
    Constant(Rgb),
    /// A latitude–longitude image, `.exr` or `.hdr`.
    Image(Located<PathBuf>),
}
