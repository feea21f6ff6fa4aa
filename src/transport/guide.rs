//! Where an eye path goes on from a surface, drawn from what photons say of the light there.

use std::f64::consts::PI;

use crate::math::{Cells, DVec3, Frame};

/// A density over the directions above a matte surface: a half in proportion to the cosine, a half to the flux of photons that landed around
/// it times the cosine (Jensen 1995, "Importance driven path tracing using the photon map"; Jensen 2001, section 11.2). Whatever the
/// flux, it is at least half of the cosine's own density, so that paths drawn by it are right, and never much worse than those drawn without.
#[derive(Clone, Debug)]
pub struct DirectionGuide<'f> {
    frame: Frame,
    flux: &'f DirectionTable,
}

/// The flux of photons by the directions that they came from, about the normal of a surface: the running sums of the probabilities of cells.
pub type DirectionTable = [f32; COUNT];

/// The cells that are told apart. More would hold too few photons each.
const CELLS: Cells = Cells { rings: 4, sectors: 12 };
const COUNT: usize = CELLS.count();
/// The share that goes in proportion to the cosine alone.
const EVEN: f64 = 0.5;

/// The table of photons that came with these powers from these directions, all of a frame whose z is the normal; `None` where there are none.
pub fn direction_table(photons: impl Iterator<Item = (DVec3, f64)>) -> Option<DirectionTable> {
    let mut cells = [0.0; COUNT];
    photons.filter(|(from, _)| from.z > 0.0).for_each(|(from, power)| CELLS.add(from, power, &mut cells));
    let total: f64 = cells.iter().sum();
    let is_usable = total > 0.0 && total.is_finite();
    is_usable.then(|| {
        let mut sum = 0.0;
        let mut table = cells.map(|power| {
            sum += EVEN / COUNT as f64 + (1.0 - EVEN) * power / total;
            sum as f32
        });
        table[COUNT - 1] = 1.0;
        table
    })
}

impl<'f> DirectionGuide<'f> {
    /// About the normal of `frame`, by what was found close to it about one that may differ a little.
    pub fn new(frame: Frame, flux: &'f DirectionTable) -> DirectionGuide<'f> {
        DirectionGuide { frame, flux }
    }

    /// The direction that two uniform numbers stand for.
    pub fn direction(&self, [u, v]: [f64; 2]) -> DVec3 {
        let index = self.flux.partition_point(|sum| f64::from(*sum) <= u).min(COUNT - 1);
        let [below, share] = self.cell(index);
        let rest = ((u - below) / share).clamp(0.0, 1.0 - f64::EPSILON);
        CELLS.direction(index, &self.frame, [rest, v])
    }

    /// The density per steradian with which `direction` is drawn; 0 below the surface.
    pub fn density(&self, direction: DVec3) -> f64 {
        let local = self.frame.to_local(direction);
        if local.z <= 0.0 {
            return 0.0;
        }
        let [ring, sector] = CELLS.holding(local);
        let [_, share] = self.cell(ring * CELLS.sectors + sector);
        share * COUNT as f64 * local.z / PI
    }

    /// The sum of the probabilities before a cell, and its own.
    fn cell(&self, index: usize) -> [f64; 2] {
        let below = if index == 0 { 0.0 } else { f64::from(self.flux[index - 1]) };
        [below, f64::from(self.flux[index]) - below]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::Stream;
    use crate::math::random::Purpose;
    use crate::math::sampling;

    /// Directions come as often as the density says, which is at least half of the cosine's and all of one in the whole; they lie above the
    /// surface, also where the guide was found about a normal that differs.
    #[test]
    fn directions_come_as_often_as_the_density_says() {
        const N: usize = 200_000;
        let mut stream = Stream::new(3, Purpose::Test, 0, 0);
        let lamp = DVec3::new(0.6, -0.3, 0.5).normalize();
        let photons = (0..64).map(|k| (if k % 4 == 0 { DVec3::new(-0.2, 0.1, 0.9).normalize() } else { lamp }, 1.0));
        let below = std::iter::once((DVec3::NEG_Z, 1e9));
        let table = direction_table(photons.chain(below)).expect("there are photons");
        let normal = DVec3::new(0.3, 0.1, -0.9).normalize();
        let frame = Frame::around(DVec3::new(0.28, 0.15, -0.9).normalize()).turned(normal);
        let guide = DirectionGuide::new(frame, &table);

        // ∫ p = 1 by even directions; ∫ f over what is drawn, f/p, is ∫ f by even ones.
        let f = |o: DVec3| (3.0 * o.dot(frame.to_world(lamp))).exp() * o.dot(normal).max(0.0);
        let (mut whole, mut expected, mut found, mut bright) = (0.0, 0.0, [0.0; 2], 0);
        for _ in 0..N {
            let even = sampling::sphere(stream.uniform2());
            let density = guide.density(even);
            assert!(density >= 0.5 * (1.0 - 1e-5) * even.dot(normal).max(0.0) / PI, "{density}");
            whole += 4.0 * PI * density / N as f64;
            expected += 4.0 * PI * f(even) / N as f64;
            let drawn = guide.direction(stream.uniform2());
            assert!(drawn.dot(normal) >= 0.0 && (drawn.length() - 1.0).abs() < 1e-12);
            let value = f(drawn) / guide.density(drawn);
            found = [found[0] + value / N as f64, found[1] + value * value / N as f64];
            bright += usize::from(drawn.dot(frame.to_world(lamp)) > 0.9);
        }
        assert!((whole - 1.0).abs() < 0.015, "{whole}");
        let error = ((found[1] - found[0] * found[0]) / N as f64).sqrt();
        assert!((found[0] / expected - 1.0).abs() < 0.015 && error < 0.005 * found[0], "{found:?}, not {expected}");
        // By the cosine alone some 5 of 100 would go there.
        assert!(bright > N / 4, "{bright}");
    }

    #[test]
    fn what_tells_nothing_guides_nowhere() {
        for photons in [vec![], vec![(DVec3::Z, 0.0)], vec![(DVec3::NEG_Z, 1.0)], vec![(DVec3::Z, f64::INFINITY)]] {
            assert!(direction_table(photons.into_iter()).is_none());
        }
    }
}
