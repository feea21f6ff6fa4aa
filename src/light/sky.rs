//! A clear sky, with its sun.

use super::{Directional, Environment};
use crate::image::Image;
use crate::math::{DVec3, Rgb};
use crate::medium::black_body;
use crate::{Error, Result};
use hw_skymodel::rgb::{Channel, SkyParams, SkyState};
use std::f64::consts::{PI, TAU};
use std::ops::RangeInclusive;

/// A clear sky by the model of Hosek and Wilkie, *An Analytic Model for Full Spectral Sky-Dome Radiance* (SIGGRAPH 2012),
/// with the sun that lights it and the ground below; +y is up.
///
/// Radiances are in linear sRGB, W/(m² sr), as those of [`BlackBody`](black_body::BlackBody): spectral radiance integrated
/// over the CIE 1931 curves, no factor 683. A white sky of 1 has 683 cd/m².
#[derive(Clone, Debug)]
pub struct Sky {
    model: SkyState,
    /// The unit vector towards the sun.
    sun: DVec3,
    /// What the sun sends through the air onto a plane that faces it.
    beam: Rgb,
    /// The share of light that the ground reflects.
    ground: Rgb,
}

/// The size of the image in which a sky is looked up. Rows are half as high as columns are wide: most changes near the
/// horizon. Where the sun stands above 5°, radiance interpolated in it is off by less than 2 % but in the lowest half row.
const COLUMNS: usize = 512;
const ROWS: usize = 512;

impl Sky {
    /// The turbidities the model was fitted to: 1 is the purest air, 2 to 3 a clear day, 6 is hazy, 10 is mist.
    pub const TURBIDITY: RangeInclusive<f64> = 1.0..=10.0;

    /// The sky about a sun that stands in this direction, a unit vector not below the horizon, with a turbidity and a ground
    /// that reflects this share of light.
    ///
    /// # Errors
    /// When a number is out of its range.
    pub fn new(sun: DVec3, turbidity: f64, ground: Rgb) -> Result<Self> {
        let albedo = ground.to_array().map(|share| share as f32);
        let elevation = elevation(sun);
        let model = SkyState::new(&SkyParams { elevation: elevation as f32, turbidity: turbidity as f32, albedo })
            .map_err(|error| Error::Scene(format!("a sky cannot be: {error}")))?;
        Ok(Sky { model, sun, beam: sunlight(elevation, turbidity), ground })
    }

    /// The lights that make it, if they are not black: sky and ground, multiplied by `scale`, and the sun, multiplied by
    /// `scale` and `sun_scale`.
    pub fn lights(&self, scale: Rgb, sun_scale: Rgb) -> (Option<Environment>, Option<Directional>) {
        let shines = scale.max_element() > 0.0;
        let around = shines.then(|| Environment::image(self.image(sun_scale), scale, 0.0)).flatten();
        let irradiance = scale * sun_scale * self.beam;
        // 1 − cos of half the angle.
        let cone = 2.0 * (0.25 * SUN_DIAMETER.to_radians()).sin().powi(2);
        let sun = Directional { direction: -self.sun, irradiance, cone, beam: None };
        (around, (irradiance.max_element() > 0.0).then_some(sun))
    }

    /// The radiance of the sky without the sun, in a direction that is not below the horizon.
    fn radiance(&self, direction: DVec3) -> Rgb {
        let (from_zenith, from_sun) =
            (direction.angle_between(DVec3::Y) as f32, direction.angle_between(self.sun) as f32);
        let channel = |channel| f64::from(self.model.radiance(from_zenith, from_sun, channel));
        // The fit dips below 0 beside a low sun.
        Rgb::new(channel(Channel::R), channel(Channel::G), channel(Channel::B)).max(Rgb::ZERO)
    }

    /// Sky and ground by latitude and longitude, as environments are. The ground is Lambertian under sky and sun, and the
    /// same everywhere.
    fn image(&self, sun_scale: Rgb) -> Image {
        let latitude = |row: f64| PI * row / ROWS as f64;
        let mut pixels = Vec::with_capacity(ROWS * COLUMNS);
        let mut irradiance = self.sun.y * sun_scale * self.beam;
        for row in 0..ROWS / 2 {
            let (sin, cos) = latitude(row as f64 + 0.5).sin_cos();
            let (top, bottom) = (latitude(row as f64).cos(), latitude(row as f64 + 1.0).cos());
            // ∫ cos dω over a texel of this row.
            let weight = 0.5 * TAU / COLUMNS as f64 * (top * top - bottom * bottom);
            for column in 0..COLUMNS {
                let (east, north) = (TAU * ((column as f64 + 0.5) / COLUMNS as f64 - 0.5)).sin_cos();
                let radiance = self.radiance(DVec3::new(sin * east, cos, -sin * north));
                irradiance += weight * radiance;
                pixels.push(radiance.as_vec3().to_array());
            }
        }
        let ground = (self.ground * irradiance / PI).as_vec3().to_array();
        pixels.resize(ROWS * COLUMNS, ground);
        Image { width: COLUMNS, height: ROWS, pixels }
    }
}

/// The sun's apparent diameter in degrees, at its mean distance.
const SUN_DIAMETER: f64 = 0.533;
/// Its effective temperature (IAU 2015 Resolution B3).
const SUN_KELVIN: f64 = 5772.0;

/// The angle above the horizon of a unit vector.
fn elevation(direction: DVec3) -> f64 {
    direction.y.min(1.0).asin()
}

/// The irradiance that a sun at this angle above the horizon sends through the air onto a plane that faces it: a black body behind molecules, ozone and aerosol, whose transmittances are those of Bird and Riordan (1986) as
/// Preetham, Shirley and Smits (1999) use them for skies.
fn sunlight(elevation: f64, turbidity: f64) -> Rgb {
    // Kasten and Young (1989): how many times as much air is in the way as towards the zenith.
    let air = 1.0 / (elevation.sin() + 0.50572 * (elevation.to_degrees() + 6.07995).powf(-1.6364));
    let aerosol = aerosol(turbidity);
    let radiance = black_body::seen_through(SUN_KELVIN, |nanometres| {
        let micrometres = 1e-3 * nanometres;
        let molecules = 0.008735 * micrometres.powf(-4.08);
        let haze = aerosol * micrometres.powf(-1.3);
        (-air * (molecules + haze + OZONE_CENTIMETRES * ozone(nanometres))).exp()
    });
    let sin = (0.5 * SUN_DIAMETER.to_radians()).sin();
    PI * sin * sin * radiance
}

/// Ångström's turbidity coefficient β, the optical thickness of the aerosol at 1 µm.
///
/// That of Preetham's formula, 0.0461 T − 0.0459, is of hazier air than this sky was computed in: at T = 3 it leaves a sun at
/// 5° a fifth of the light that the sky's authors give it. These bring its luminance closest to theirs, *Adding a
/// Solar-Radiance Function to the Hošek–Wilkie Skylight Model* (2013), from 5° to 60°: within 13 %.
fn aerosol(turbidity: f64) -> f64 {
    const BETA: [f64; 10] = [0.004, 0.009, 0.017, 0.031, 0.0455, 0.0565, 0.0745, 0.104, 0.153, 0.2345];
    interpolate(&BETA, turbidity - 1.0)
}

const OZONE_CENTIMETRES: f64 = 0.35;

/// The absorption coefficient of ozone, per cm (Leckner 1978), of whose bands that of Chappuis is visible.
fn ozone(nanometres: f64) -> f64 {
    #[rustfmt::skip]
    const EVERY_TEN_FROM_440: [f64; 36] = [
        0.0, 0.003, 0.006, 0.009, 0.014, 0.021, 0.030, 0.040, 0.048, 0.063, 0.075, 0.085, 0.103, 0.120, 0.120, 0.115, 0.125, 0.120,
        0.105, 0.090, 0.079, 0.067, 0.057, 0.048, 0.036, 0.028, 0.023, 0.018, 0.014, 0.011, 0.010, 0.009, 0.007, 0.004, 0.0, 0.0,
    ];
    interpolate(&EVERY_TEN_FROM_440, 0.1 * (nanometres - 440.0))
}

/// Linear between values at 0, 1, …, and constant beyond.
fn interpolate(values: &[f64], at: f64) -> f64 {
    let last = values.len() - 1;
    let at = at.clamp(0.0, last as f64);
    let i = (at as usize).min(last - 1);
    values[i] + (values[i + 1] - values[i]) * (at - i as f64)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::Stream;
    use crate::math::random::Purpose;

    fn towards(elevation: f64, azimuth: f64) -> DVec3 {
        let (elevation, azimuth) = (elevation.to_radians(), azimuth.to_radians());
        DVec3::new(elevation.cos() * azimuth.cos(), elevation.sin(), elevation.cos() * azimuth.sin())
    }

    fn luminance(rgb: Rgb) -> f64 {
        rgb.dot(Rgb::new(0.2126, 0.7152, 0.0722))
    }

    /// Against the authors' data as Mitsuba 3.9 evaluates them (`sunsky`, times the integral of ȳ): the zenith, beside the sun,
    /// low, and away from the sun.
    #[test]
    fn is_that_of_its_authors() {
        let directions = |sun: f64| [(90.0, 0.0), (sun + 2.0, 10.0), (5.0, 90.0), (30.0, 180.0)];
        #[rustfmt::skip]
        let skies = [
            (3.0, 30.0, 0.2, [[1.6796, 3.1909, 6.3782], [19.1470, 21.5097, 23.0679], [10.0645, 14.7551, 18.3500], [3.6674, 6.6383, 11.4314]]),
            (6.5, 4.0, 0.5, [[0.8317, 1.3047, 1.7894], [57.7056, 29.5373, 7.5675], [4.5659, 4.1862, 2.8192], [3.1690, 3.8411, 3.8391]]),
            (1.4, 80.0, 0.0, [[3.1684, 5.6734, 10.0142], [3.9905, 7.2523, 10.5754], [9.5326, 14.6479, 21.6070], [2.9862, 5.8163, 11.5814]]),
        ];
        for (turbidity, sun, ground, radiances) in skies {
            let sky = Sky::new(towards(sun, 0.0), turbidity, Rgb::splat(ground)).expect("in range");
            for ((elevation, azimuth), expected) in directions(sun).into_iter().zip(radiances) {
                let (found, expected) = (sky.radiance(towards(elevation, azimuth)), Rgb::from_array(expected));
                assert!(found.abs_diff_eq(expected, 2e-4 * expected.max_element()), "{found} for {expected}");
            }
        }
    }

    /// The luminance of the sun, over 683, by the same authors' data of 2013, from the same source.
    #[test]
    fn the_sun_is_as_bright_as_its_sky_takes_it_for() {
        #[rustfmt::skip]
        let suns = [
            (1.0, 5.0, 49.3), (1.0, 60.0, 141.9), (2.0, 20.0, 110.5), (3.0, 5.0, 36.8), (3.0, 30.0, 120.9), (3.0, 60.0, 137.6),
            (6.0, 10.0, 45.1), (8.0, 30.0, 85.9), (10.0, 10.0, 6.59), (10.0, 60.0, 84.5),
        ];
        for (turbidity, elevation, expected) in suns {
            let found = luminance(sunlight(f64::to_radians(elevation), turbidity));
            assert!((found / expected - 1.0).abs() < 0.13, "{turbidity}, {elevation}°: {found} for {expected}");
        }
        // Whiter above, red at the horizon; never more than above the air, 125 klx for a black body.
        let [high, low] = [90.0, 0.0].map(|elevation| sunlight(f64::to_radians(elevation), 2.0));
        assert!(
            high.z > 0.6 * high.x && low.z < 0.01 * low.x && low.x > 0.0 && low.x < 0.1 * high.x,
            "{high} and {low}"
        );
        assert!(luminance(high) * 0.683 < 125.0);
    }

    /// What a level plane gets from the sky as it is rendered is the integral of the model, and the ground below sends on its
    /// share of that and of the sun's light.
    #[test]
    fn a_level_plane_gets_the_integral() {
        let skies = [(1.0, 2.0), (3.0, 30.0), (10.0, 60.0)];
        let mut stream = Stream::new(5, Purpose::Test, 0, 0);
        for (turbidity, elevation) in skies {
            let (albedo, scale, sun_scale) = (Rgb::new(0.2, 0.5, 0.9), Rgb::new(1.0, 2.0, 3.0), Rgb::splat(0.5));
            let sky = Sky::new(towards(elevation, 40.0), turbidity, albedo).expect("in range");
            let (around, sun) = sky.lights(scale, sun_scale);
            let (around, sun) = (around.expect("not black"), sun.expect("not black"));
            let steps = 512;
            let integral: Rgb = (0..steps * steps)
                .map(|i| {
                    let [x, y] = [i % steps, i / steps].map(|k| (k as f64 + 0.5) / steps as f64);
                    // Evenly over the disc that the dome stands on, so that the cosine is in the density.
                    let (sin, cos) = ((1.0 - y).sqrt(), y.sqrt());
                    let (s, c) = (TAU * x).sin_cos();
                    scale * sky.radiance(DVec3::new(sin * c, cos, sin * s)) * (PI / (steps * steps) as f64)
                })
                .sum();

            let n = 40_000;
            let (mut sum, mut squares) = (Rgb::ZERO, Rgb::ZERO);
            for _ in 0..n {
                let arrival = around.arrive(&mut stream).expect("not black");
                let x = arrival.radiance * (arrival.direction.y.max(0.0) / arrival.density);
                sum += x;
                squares += x * x;
            }
            let mean = sum / n as f64;
            let sigma = ((squares / n as f64 - mean * mean) / n as f64).map(f64::sqrt);
            let off = (mean - integral).abs();
            assert!(off.cmple(4.0 * sigma + 1e-3 * integral).all(), "{mean} ± {sigma} for {integral}");

            let below = around.radiance(-towards(3.0, 20.0));
            let expected = albedo / PI * (integral + elevation.to_radians().sin() * sun.irradiance);
            assert!((below / expected - Rgb::ONE).abs().max_element() < 2e-3, "{below} for {expected}");
            let diameter = 2.0 * (1.0 - sun.cone).acos().to_degrees();
            assert!((diameter - SUN_DIAMETER).abs() < 1e-6 && sun.direction == -sky.sun);
        }
    }

    #[test]
    fn nothing_is_made_of_no_light() {
        let sky = Sky::new(DVec3::Y, 3.0, Rgb::ZERO).expect("in range");
        assert!(matches!(sky.lights(Rgb::ZERO, Rgb::ONE), (None, None)));
        assert!(matches!(sky.lights(Rgb::ONE, Rgb::ZERO), (Some(_), None)));
        for (sun, turbidity) in [(-DVec3::Y, 3.0), (DVec3::Y, 0.5), (DVec3::Y, f64::NAN), (DVec3::X, 11.0)] {
            assert!(Sky::new(sun, turbidity, Rgb::ZERO).is_err());
        }
    }
}
