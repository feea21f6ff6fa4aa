//! Lights, placed.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::{Builder, Part, Shine};
use crate::geometry::{Disk, Placed, Shape, Sphere};
use crate::image;
use crate::light::{
    self, Directional, Directivity, Environment, Goniometric, Light, Point, Profile, Sides, Sky, SoftCone, Spot,
};
use crate::math::DAffine3;
use crate::scene::Surface;
use crate::scene::description::{self as said, LightKind, Located, ProfileStrength};
use crate::surface::Material;
use crate::{Error, Result};

impl Builder<'_> {
    /// Places lights: those with a size as shapes that shine.
    pub(super) fn place_lights(&mut self) -> Result<()> {
        let description = self.description;
        for said in &description.lights {
            let fail = |error: Error| said.place.error(error);
            match &said.kind {
                LightKind::Point { position, intensity, radius } => {
                    if intensity.max_element() <= 0.0 {
                        continue;
                    }
                    let position = *position - self.origin.center;
                    if *radius > 0.0 {
                        let sphere = Sphere::new(position, *radius).map_err(fail)?;
                        let power = Shine::Power(4.0 * std::f64::consts::PI * *intensity, Sides::Out);
                        self.lamp(Shape::Sphere(sphere), Material::BLACK, power).map_err(fail)?;
                    } else {
                        self.lights.push(Light::Point(Point { position, intensity: *intensity }));
                    }
                }
                LightKind::Spot { position, direction, intensity, inner_angle, outer_angle, radius } => {
                    if intensity.max_element() <= 0.0 {
                        continue;
                    }
                    let position = *position - self.origin.center;
                    let cone = SoftCone::new(*direction, inner_angle.to_radians(), outer_angle.to_radians());
                    if *radius > 0.0 {
                        let disc = Disk::new(position, *direction, *radius).map_err(fail)?;
                        let shine = Shine::Disc(Directivity::Spot(*intensity, cone));
                        self.lamp(Shape::Disk(disc), Material::None, shine).map_err(fail)?;
                    } else {
                        self.lights.push(Light::Spot(Spot { position, intensity: *intensity, cone }));
                    }
                }
                LightKind::Profile { position, direction, strength, file } => {
                    let profile = self.profile(file)?;
                    let intensity = match *strength {
                        ProfileStrength::Intensity(intensity) => intensity,
                        ProfileStrength::Power(power) => power / profile.total(),
                    };
                    if intensity.max_element() > 0.0 {
                        let lamp = Goniometric::new(*position - self.origin.center, *direction, intensity, profile);
                        self.lights.push(Light::Goniometric(lamp));
                    }
                }
                LightKind::Directional { direction, irradiance, angle, beam } => {
                    if irradiance.max_element() <= 0.0 {
                        continue;
                    }
                    let half = 0.5 * angle.to_radians();
                    let cone = SoftCone::new(*direction, half, half);
                    match beam {
                        Some(beam) if *angle > 0.0 => {
                            let center = beam.center - self.origin.center;
                            let disc = Disk::new(center, *direction, beam.radius).map_err(fail)?;
                            let radiance = light::cone_radiance(*irradiance, cone.outer);
                            let shine = Shine::Disc(Directivity::Beam(radiance, cone));
                            self.lamp(Shape::Disk(disc), Material::None, shine).map_err(fail)?;
                        }
                        _ => self.lights.push(Light::Directional(Directional {
                            direction: *direction,
                            irradiance: *irradiance,
                            cone: cone.outer,
                            beam: beam.map(|beam| (beam.center - self.origin.center, beam.radius)),
                        })),
                    }
                }
                LightKind::Sky { sun, turbidity, ground, scale, sun_scale } => {
                    let sky = Sky::new(*sun, *turbidity, *ground).map_err(fail)?;
                    let (around, sun) = sky.lights(*scale, *sun_scale);
                    self.lights.extend(around.map(Light::Environment));
                    self.lights.extend(sun.map(Light::Directional));
                }
                LightKind::Environment { source, scale, rotate } => {
                    if scale.max_element() <= 0.0 {
                        continue;
                    }
                    let light = match source {
                        said::EnvironmentSource::Constant(radiance) => {
                            let radiance = *radiance * *scale;
                            (radiance.max_element() > 0.0).then(|| Environment::constant(radiance))
                        }
                        said::EnvironmentSource::Image(file) => {
                            let image = read_environment(&file.value).map_err(|error| file.place.error(error))?;
                            let light = Environment::image(image, *scale, rotate.to_radians());
                            if light.is_none() {
                                self.warnings.push(file.place.told("the image is black: no light"));
                            }
                            light
                        }
                    };
                    self.lights.extend(light.map(Light::Environment));
                }
            }
        }
        Ok(())
    }

    fn profile(&mut self, file: &Located<PathBuf>) -> Result<Arc<Profile>> {
        if let Some(profile) = self.profiles.get(&file.value) {
            return Ok(profile.clone());
        }
        let profile = Arc::new(Profile::read(&file.value).map_err(|error| file.place.error(error))?);
        self.profiles.insert(file.value.clone(), profile.clone());
        Ok(profile)
    }

    fn lamp(&mut self, shape: Shape, material: Material, shine: Shine) -> Result<()> {
        let placed = Placed::new(shape, DAffine3::IDENTITY)?;
        let surface = Surface { material, solid: None, light: None, paint: None, caustics: said::Caustics::ALL };
        self.parts.push(Part { placed, surface, solid: None, emission: Some(shine) });
        Ok(())
    }
}

fn read_environment(path: &Path) -> Result<image::Image> {
    let picture = image::read(path)?;
    match picture.image.pixels.iter().position(|p| p.iter().any(|c| !c.is_finite() || *c < 0.0)) {
        None => Ok(picture.image),
        Some(at) => {
            let (x, y) = (at % picture.image.width, at / picture.image.width);
            let value = picture.image.pixels[at];
            Err(Error::asset(path, format!("pixel ({x}, {y}) is {value:?}; radiance must be finite and not negative")))
        }
    }
}
