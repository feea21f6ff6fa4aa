//! Lights: `[[lights]]`.

use std::path::PathBuf;

use serde::Serialize;

use super::{Located, Place};
use crate::math::{DVec3, Rgb};

/// `[[lights]]`: a light that is no shape's.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Light {
    /// What overrides and messages call it.
    pub name: Option<String>,
    /// Which kind of light it is, with what is said of it.
    pub kind: LightKind,
    /// Where the light is described.
    #[serde(skip)]
    pub place: Place,
}

/// The kinds of light. Strengths are by channel and at least 0.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum LightKind {
    /// One intensity in every direction, from a point or a small sphere.
    Point {
        /// Where the light stands.
        position: DVec3,
        /// The intensity in W/sr; power/4π where a power was given.
        intensity: Rgb,
        /// The radius of a sphere that sends out the same power; 0: a point.
        radius: f64,
    },
    /// A cone with a soft edge.
    Spot {
        /// Where the light stands.
        position: DVec3,
        /// The unit vector towards its target.
        direction: DVec3,
        /// The intensity on the axis in W/sr; computed from the power where one was given.
        intensity: Rgb,
        /// The half-angle of the cone within which the intensity is full, in degrees, at most `outer_angle`.
        inner_angle: f64,
        /// The half-angle of the cone outside of which it is dark, in degrees, in (0, 90\].
        outer_angle: f64,
        /// The radius of a disc facing the target with the same intensity far away; 0: a point.
        radius: f64,
    },
    /// A point or a spot with the profile of a lamp.
    Profile {
        /// Where the light stands.
        position: DVec3,
        /// The unit vector along the lamp's axis.
        direction: DVec3,
        /// How strong it is.
        strength: ProfileStrength,
        /// An IESNA LM-63 file, or a EULUMDAT file.
        file: Located<PathBuf>,
    },
    /// Parallel light, or nearly so.
    Directional {
        /// The unit direction of travel.
        direction: DVec3,
        /// The irradiance of a plane that faces it, in W/unit².
        irradiance: Rgb,
        /// The light's apparent diameter in degrees, in \[0, 180).
        angle: f64,
        /// The round beam it is restricted to; `None`: unbounded.
        beam: Option<Beam>,
    },
    /// A clear sky with its sun, see [`Sky`](crate::light::Sky).
    Sky {
        /// The unit vector towards the sun; its y is at least 0.
        sun: DVec3,
        /// How hazy the air is, from 1 to 10.
        turbidity: f64,
        /// The share of light that the ground reflects, in \[0, 1\].
        ground: Rgb,
        /// What the light of sky, ground and sun is multiplied by.
        scale: Rgb,
        /// What that of the sun is multiplied by as well; 0: no sun.
        sun_scale: Rgb,
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

/// How strong a lamp with a profile is.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum ProfileStrength {
    /// The intensity in W/sr where the profile is brightest.
    Intensity(Rgb),
    /// The power in W in all directions together.
    Power(Rgb),
}

/// The disc a round directional beam starts on, perpendicular to its direction.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Beam {
    /// The disc's centre.
    pub center: DVec3,
    /// The disc's radius, above 0.
    pub radius: f64,
}

/// Where an environment's radiance comes from.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum EnvironmentSource {
    /// One radiance from everywhere, in W/(sr · unit²).
    Constant(Rgb),
    /// A latitude–longitude image, `.exr` or `.hdr`.
    Image(Located<PathBuf>),
}
