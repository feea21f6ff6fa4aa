//! Some of a pass's photons in media, for rays that a surface spreads its question for light over.
//!
//! Hundreds of such rays tell together what a place gets: each finds enough in a map of fewer photons, spread a little more widely, and the
//! cost of a ray grows with the photons that it meets. In a room of fog that is most of the time that an irradiance cache takes.

use crate::math::random::mix;
use crate::photon::{Photon, Radius};

/// Photons of a region that are enough.
const ENOUGH: usize = 100_000;
/// n of adaptive radii among them, at least, unless that of all photons is smaller.
const NEIGHBOURS: u32 = 60;

/// Of each region that holds twice as many or more, about [`ENOUGH`] photons with the power of all of them, drawn by chance, and how wide they
/// are spread; of other regions none.
pub(super) fn some_photons(regions: &[Vec<Photon>], radius: Radius) -> Vec<(Radius, Vec<Photon>)> {
    let some = |photons: &Vec<Photon>| {
        let Some(one_in) = one_in(photons.len()) else { return (radius, Vec::new()) };
        // By their number, but as if by chance: photons of one sequence that follow one another at even distances are no fair sample of it.
        let drawn = (0..).zip(photons).filter(|(number, _)| mix(*number).is_multiple_of(one_in as u64));
        let drawn = drawn.map(|(_, photon)| Photon { power: photon.power * one_in as f32, ..*photon });
        (wider(radius, one_in as u32), drawn.collect())
    };
    regions.iter().map(some).collect()
}

/// One photon in how many stands for all of a region; `None` where all of them do.
pub(super) fn one_in(photons: usize) -> Option<usize> {
    Some(photons / ENOUGH).filter(|one_in| *one_in >= 2)
}

/// How wide one photon in so many is spread.
pub(super) fn wider(radius: Radius, one_in: u32) -> Radius {
    match radius {
        Radius::Fixed(_) => radius,
        Radius::Variable { neighbours: all, pilot, max_radius } => {
            let neighbours = (all / one_in).max(NEIGHBOURS).min(all);
            let share = f64::from(neighbours) / f64::from(all);
            let pilot = ((f64::from(pilot) * share.sqrt()).ceil() as u32).max(5).min(neighbours);
            Radius::Variable { neighbours, pilot, max_radius }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::Vec3;
    use crate::photon::PackedNormal;

    /// Half a million photons, each in its own place, become about a hundred thousand with the same power, evenly all over; a few stay as they are.
    #[test]
    fn some_photons_stand_for_all() {
        const ALL: usize = 5 * ENOUGH;
        let photon = |i: usize| Photon {
            position: Vec3::splat(i as f32),
            direction: Vec3::Z,
            power: Vec3::splat(1.0 / ALL as f32),
            events: 3,
            normal: PackedNormal::default(),
        };
        let radius = Radius::Variable { neighbours: 200, pilot: 15, max_radius: 1.0 };
        let regions = [(0..ALL).map(photon).collect(), (0..10).map(photon).collect()];
        let some = some_photons(&regions, radius);
        assert!(some[1].1.is_empty());
        let (wide, drawn) = &some[0];
        assert_eq!(*wide, Radius::Variable { neighbours: 60, pilot: 9, max_radius: 1.0 });
        for tenth in 0..10 {
            let within = |photon: &&Photon| (photon.position.x as usize) / (ALL / 10) == tenth;
            let power: f32 = drawn.iter().filter(within).map(|photon| photon.power.x).sum();
            // A binomial share: 50 000 photons, one in five.
            let deviation = (4.0 / (ALL as f32 / 10.0)).sqrt();
            assert!((10.0 * power - 1.0).abs() < 5.0 * deviation, "tenth {tenth}: {power}");
        }
    }
}
