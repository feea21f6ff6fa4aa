use super::{Arrival, Departure, DrawnFrom, Profile};
use crate::math::{DVec3, Frame, Ray, Rgb, Stream};
use std::sync::Arc;

/// A point that shines as a lamp was measured to.
#[derive(Clone, Debug)]
pub struct Goniometric {
    /// Where it is.
    pub position: DVec3,
    /// W/sr per channel where the profile is brightest.
    pub intensity: Rgb,
    /// z is the lamp's axis; φ of the profile goes from x to y.
    frame: Frame,
    profile: Arc<Profile>,
}

impl Goniometric {
    /// A lamp with this unit axis. φ = 0 is towards +x, or towards +z where the axis is along x; for a lamp that shines down φ grows
    /// counter-clockwise as seen from above.
    pub fn new(position: DVec3, axis: DVec3, intensity: Rgb, profile: Arc<Profile>) -> Self {
        const PARALLEL: f64 = 1.0 - 1e-9;
        let towards = if axis.x.abs() < PARALLEL { DVec3::X } else { DVec3::Z };
        let x = (towards - towards.dot(axis) * axis).normalize();
        Goniometric { position, intensity, frame: Frame { x, y: x.cross(axis), z: axis }, profile }
    }

    /// The unit axis.
    pub fn axis(&self) -> DVec3 {
        self.frame.z
    }

    /// The profile.
    pub fn profile(&self) -> &Profile {
        &self.profile
    }

    pub(super) fn power(&self) -> Rgb {
        self.profile.total() * self.intensity
    }

    pub(super) fn importance(&self, p: DVec3) -> f64 {
        self.arrive(p).map_or(0.0, |arrival| arrival.radiance.element_sum())
    }

    pub(super) fn arrive(&self, p: DVec3) -> Option<Arrival> {
        Arrival::from_point(self.position, p, |travel| {
            let share = self.profile.at(self.frame.to_local(travel));
            (share > 0.0).then(|| share * self.intensity)
        })
    }

    pub(super) fn depart(&self, stream: &mut Stream) -> Departure {
        let direction = self.frame.to_world(self.profile.sample(stream)).normalize();
        Departure { ray: Ray::new(self.position, direction), power: self.power(), spread: DrawnFrom::Other }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Geometry;
    use crate::light::extent::Extent;
    use crate::light::{Emitter, Light};
    use crate::math::random::Purpose;
    use crate::math::sampling;

    /// The axis points where it is told to, φ = 0 towards +x and 90 towards −z below a lamp that shines down; photons carry the power, and
    /// where the tree over lights expects none, there is none.
    #[test]
    fn lamps_are_aimed() {
        let file = concat!(env!("CARGO_MANIFEST_DIR"), "/scenes/lamps/street.ies");
        let profile = Arc::new(Profile::read(file).unwrap());
        let lamp = Goniometric::new(DVec3::ZERO, -DVec3::Y, Rgb::ONE, profile.clone());
        let share = |x: f64, y: f64, z: f64| lamp.arrive(DVec3::new(x, y, z)).map_or(0.0, |light| light.radiance.x);
        assert!(share(0.0, -1.0, 0.0) > 0.0 && share(0.0, 1.0, 0.0) == 0.0);
        let along = share(2.0, -1.0, 0.0);
        assert!(along > 2.0 * share(0.0, -1.0, -2.0) && (along - share(-2.0, -1.0, 0.0)).abs() < 1e-3 * along);
        // The lantern's light is before it, at C90.
        assert!(share(0.0, -1.0, -0.7) > 1.2 * share(0.0, -1.0, 0.7));

        let mut stream = Stream::new(5, Purpose::Test, 0, 0);
        for axis in [DVec3::X, -DVec3::X, DVec3::new(0.6, 0.0, -0.8), DVec3::Y] {
            let power = Rgb::new(3.0, 2.0, 1.0);
            let lamp = Goniometric::new(DVec3::ONE, axis, power / profile.total(), profile.clone());
            let light = Light::Goniometric(lamp.clone());
            let extent = Extent::of(Emitter { light: 0, triangle: None }, &light, &Geometry::new(Vec::new()));
            let cone = extent.expect("it shines").cone;
            for _ in 0..2000 {
                let photon = lamp.depart(&mut stream);
                assert!((photon.power - power).abs().max_element() < 1e-12);
                let o = sampling::sphere(stream.uniform2());
                for direction in [photon.ray.direction, o] {
                    let lit = lamp.arrive(DVec3::ONE + 3.0 * direction).is_some();
                    let expected = cone.axis.angle_between(direction) <= cone.bright + cone.beyond;
                    assert!(!lit || expected, "{axis}: {direction}");
                }
            }
        }
    }
}
