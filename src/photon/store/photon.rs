//! A photon, as it is traced and handed to a map.

use crate::math::{DVec3, Vec3};

/// A photon at a collision in a medium, on a flight through a medium of uneven density, or where it lands on a surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Photon {
    /// Where it is, collided or landed.
    pub position: Vec3,
    /// The unit direction it travelled in; where the phase function's mean cosine g varies over a medium, times g.
    pub direction: Vec3,
    /// Its flux \[W\] into the collision, already divided by the number of emitted photons, times
    /// the albedo there, and times 1 − g² where g varies; on a surface without these. On a flight, by volume and density these are what a medium scatters.
    pub power: Vec3,
    /// Events between the light and this place, at most 255; 0 for light that came straight.
    pub events: u8,
    /// The normal of the surface it landed on, on the side that it came from; of no meaning in a medium.
    pub normal: PackedNormal,
}

/// A unit vector in two bytes, right to a degree: its place on an octahedron (Meyer et al. 2010), unfolded into a square.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PackedNormal([i8; 2]);

impl PackedNormal {
    /// Packs a unit vector.
    pub fn new(normal: DVec3) -> Self {
        let n = normal / normal.abs().element_sum();
        let [x, y] = if n.z >= 0.0 { [n.x, n.y] } else { folded([n.x, n.y]) };
        PackedNormal([x, y].map(|x| (127.0 * x).round() as i8))
    }

    /// The unit vector.
    pub fn unpacked(self) -> Vec3 {
        let [x, y] = self.0.map(|x| f32::from(x) / 127.0);
        let z = 1.0 - x.abs() - y.abs();
        let [x, y] = if z >= 0.0 { [x, y] } else { folded([x.into(), y.into()]).map(|x| x as f32) };
        Vec3::new(x, y, z).normalize()
    }
}

/// The lower half of the octahedron, turned up around the edges of the upper one; and back.
fn folded([x, y]: [f64; 2]) -> [f64; 2] {
    [(1.0 - y.abs()).copysign(x), (1.0 - x.abs()).copysign(y)]
}

impl Photon {
    /// Whether all its numbers are.
    pub(super) fn is_finite(&self) -> bool {
        self.position.is_finite() && self.direction.is_finite() && self.power.is_finite()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::sampling;

    #[test]
    fn normals_are_kept_to_a_degree() {
        const N: usize = 10_000;
        for i in 0..N {
            let golden = (i as f64 * 0.618_033_988_749_895).fract();
            let normal = sampling::sphere([(i as f64 + 0.5) / N as f64, golden]);
            let off = PackedNormal::new(normal).unpacked().as_dvec3().angle_between(normal);
            assert!(off < 1f64.to_radians(), "{normal}: off by {off}");
        }
    }
}
