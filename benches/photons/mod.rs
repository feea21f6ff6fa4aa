//! Photons that benches look up.

use glam::{DVec3, Vec3};
use volpm::math::random::{Purpose, Stream};
use volpm::math::{Frame, sampling};
use volpm::photon::Photon;

fn photon(position: DVec3, direction: DVec3, stream: &mut Stream) -> Photon {
    let power = Vec3::from_array([0; 3].map(|_| stream.uniform() as f32));
    Photon {
        position: position.as_vec3(),
        direction: direction.as_vec3(),
        power,
        events: (4.0 * power.x) as u8,
        normal: Default::default(),
    }
}

/// Spread over a cube five wide.
pub fn even(count: usize) -> Vec<Photon> {
    let mut stream = Stream::new(1, Purpose::Test, 0, 0);
    let mut one = || {
        let x = DVec3::from_array([0; 3].map(|_| 5.0 * stream.uniform() - 2.5));
        let d = sampling::sphere(stream.uniform2());
        photon(x, d, &mut stream)
    };
    (0..count).map(|_| one()).collect()
}

/// In six narrow cones in a larger box.
pub fn beams(count: usize) -> Vec<Photon> {
    let mut stream = Stream::new(2, Purpose::Test, 0, 0);
    let one = |i: usize| {
        let k = (i % 6) as f64;
        let axis = DVec3::new(0.1 * (2.5 - k), if i.is_multiple_of(2) { -0.3 } else { 0.3 }, -1.0).normalize();
        let start = DVec3::new(3.0 * k - 7.5, if i.is_multiple_of(2) { 1.5 } else { -1.5 }, 4.5);
        let d = Frame::around(axis).to_world(sampling::cone(0.022, stream.uniform2()));
        photon(start + d * (0.3 + 8.7 * stream.uniform()), d, &mut stream)
    };
    (0..count).map(one).collect()
}
