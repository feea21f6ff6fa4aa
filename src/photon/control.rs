//! Density control (Suykens and Willems 2000): more photons are traced than a map is to hold, and where they lie closest, some hand their
//! power to neighbours. None is lost, and none is left to chance: a sum of powers of many is less noisy than the power of one.

use rayon::prelude::*;

use super::Photon;
use super::simd::LANES;
use super::store::{ordered, storable};
use crate::math::Vec3;

/// So many times as many photons are traced as are kept.
pub(super) const RICHER: u64 = 4;
/// Photons lie on one side of a surface if the cosine between its normals is at least this.
const FACING: f32 = 0.9;
/// A neighbour as far as a group is wide is as good as one whose light comes from this far (1 − cosine) aside.
const ASIDE: f32 = 0.5;
/// Directions that have the mean cosine for their length stand for each other where their 1 − g² differ by no more than this share.
const SAME_LENGTH: f32 = 0.01;

/// Whether photons are told apart by their events.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Tagged(pub bool);

/// What photons fill.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Filled {
    Surfaces,
    Media,
}

/// Has photons hand their power to neighbours until about `target` are left, or those that have no neighbour of their kind: on surfaces one
/// whose normal is much the same; where photons are `tagged`, one of as many events. Of a group of sixteen neighbours as many are kept
/// as the root of their density asks for: where they lie four times as close, twice as many to each area or volume.
pub(super) fn hand_over(photons: Vec<Photon>, target: u64, filled: Filled, Tagged(tagged): Tagged) -> Vec<Photon> {
    if photons.len() as u64 <= target {
        return photons;
    }
    let photons = ordered(storable(photons));

    // How many to keep of each group: c times the root of its size.
    let roots: Vec<f64> =
        photons.par_chunks(LANES).map(|group| (group.len() as f64 * size(group, filled)).sqrt()).collect();
    let kept = |c: f64, index: usize| {
        let count = LANES.min(photons.len() - index * LANES) as f64;
        (c * roots[index]).clamp(1.0, count)
    };
    let all = |c: f64| (0..roots.len()).map(|index| kept(c, index)).sum::<f64>();
    let largest = roots.iter().fold(f64::MIN_POSITIVE, |largest, root| root.max(largest));
    let (mut low, mut high) = (0.0, LANES as f64 / largest);
    while all(high) < target as f64 && high < 1e12 * LANES as f64 / largest {
        high *= 2.0;
    }
    for _ in 0..40 {
        let middle = 0.5 * (low + high);
        if all(middle) < target as f64 {
            low = middle;
        } else {
            high = middle;
        }
    }

    // Whole numbers, by steps of the golden ratio.
    let control = |(index, group): (usize, &[Photon])| {
        let offset = (index as f64 * 0.618_033_988_749_895).fract();
        survivors(group, (kept(high, index) + offset) as usize, filled, tagged)
    };
    photons.par_chunks(LANES).enumerate().flat_map_iter(control).collect()
}

/// The area or volume that photons fill: of their box, which on a surface is flat.
fn size(group: &[Photon], filled: Filled) -> f64 {
    let extent = extent(group).as_dvec3();
    let [x, y, z] = extent.to_array();
    match filled {
        Filled::Surfaces => (x * y).max(y * z).max(z * x),
        Filled::Media => x * y * z,
    }
}

fn extent(group: &[Photon]) -> Vec3 {
    let (low, high) = group.iter().fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(low, high), photon| {
        (low.min(photon.position), high.max(photon.position))
    });
    high - low
}

/// The axis along which a normal points most, and which way.
fn facing(normal: Vec3) -> usize {
    let size = normal.abs();
    let axis = (0..3).fold(0, |longest, axis| if size[axis] > size[longest] { axis } else { longest });
    2 * axis + usize::from(normal[axis] < 0.0)
}

/// Of a group, `count` photons that are spread along its longest edge, and those that none of these stands for; with the powers of the
/// rest.
fn survivors(group: &[Photon], count: usize, filled: Filled, tagged: bool) -> Vec<Photon> {
    let extent = extent(group);
    let axis = (0..3).fold(0, |widest, axis| if extent[axis] > extent[widest] { axis } else { widest });
    let mut group = group.to_vec();
    // Kind by kind, so that of each some are chosen.
    let kind = |photon: &Photon| {
        let side = if filled == Filled::Surfaces { facing(photon.normal.unpacked()) } else { 0 };
        (side, if tagged { photon.events } else { 0 })
    };
    let along = |photon: &Photon| photon.position[axis];
    group.sort_by(|a, b| kind(a).cmp(&kind(b)).then(along(a).total_cmp(&along(b))));
    let count = count.clamp(1, group.len());
    let chosen = |index: usize| (index + 1) * count / group.len() > index * count / group.len();
    let (mut kept, rest): (Vec<_>, Vec<_>) = (0..group.len()).partition(|&index| chosen(index));
    let mut kept: Vec<Photon> = kept.drain(..).map(|index| group[index]).collect();
    let scale = 1.0 / extent.length_squared().max(f32::MIN_POSITIVE);
    for photon in rest.into_iter().map(|index| group[index]) {
        let stands_for = |other: &Photon| {
            let alike = !tagged || other.events == photon.events;
            match filled {
                Filled::Surfaces => alike && other.normal.unpacked().dot(photon.normal.unpacked()) >= FACING,
                // Of one mean cosine, where that is the length of directions.
                Filled::Media => {
                    let [other, own] = [other, &photon].map(|photon| photon.direction.length_squared());
                    alike && (other - own).abs() <= SAME_LENGTH * (1.0 - own) + 1e-6
                }
            }
        };
        let apart = |other: &Photon| {
            let aside = 1.0 - other.direction.dot(photon.direction);
            scale * other.position.distance_squared(photon.position) + aside / ASIDE
        };
        let others = kept.iter_mut().filter(|other| stands_for(other));
        match others.min_by(|a, b| apart(a).total_cmp(&apart(b))) {
            Some(other) => other.power += photon.power,
            None => kept.push(photon),
        }
    }
    kept
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::random::Purpose;
    use crate::math::{DVec3, Stream};
    use crate::photon::PackedNormal;

    /// Photons on both sides of a sheet, four times as close in its left half, of one event or two: a quarter is left, twice as close
    /// there, and each side has the power of either kind that it had.
    #[test]
    fn power_is_handed_over_to_neighbours_of_its_kind() {
        const N: usize = 40_000;
        let mut stream = Stream::new(17, Purpose::Test, 0, 0);
        let mut photon = || {
            let [u, v] = stream.uniform2();
            let left = stream.uniform() < 0.8;
            let below = stream.uniform() < 0.5;
            Photon {
                position: Vec3::new(if left { -u } else { u } as f32, v as f32, 0.0),
                direction: Vec3::new(0.6, 0.0, if below { 0.8 } else { -0.8 }),
                power: Vec3::splat(stream.uniform() as f32),
                events: if stream.uniform() < 0.5 { 1 } else { 2 },
                normal: PackedNormal::new(if below { DVec3::NEG_Z } else { DVec3::Z }),
            }
        };
        let photons: Vec<Photon> = (0..N).map(|_| photon()).collect();
        let kinds = |photons: &[Photon]| {
            let mut powers = [[0.0; 2]; 2];
            for photon in photons {
                let below = usize::from(photon.normal.unpacked().z < 0.0);
                powers[below][usize::from(photon.events == 2)] += f64::from(photon.power.x);
            }
            powers
        };
        let left = |photons: &[Photon]| photons.iter().filter(|photon| photon.position.x < 0.0).count() as f64;
        for tagged in [true, false] {
            let kept = hand_over(photons.clone(), N as u64 / 4, Filled::Surfaces, Tagged(tagged));
            // Of four kinds each is kept in groups of which less than four photons were to be.
            let count = kept.len() as f64 / (N as f64 / 4.0);
            assert!((0.98..if tagged { 1.3 } else { 1.1 }).contains(&count), "{count} times as many as wanted");
            let closer = left(&kept) / (kept.len() as f64 - left(&kept));
            assert!((closer / 2.0 - 1.0).abs() < if tagged { 0.5 } else { 0.15 }, "{closer} times as close");
            for (before, after) in kinds(&photons).iter().zip(kinds(&kept)) {
                assert!((after[0] + after[1] - before[0] - before[1]).abs() < 1e-3, "{before:?} {after:?}");
                assert!(!tagged || (after[0] - before[0]).abs() < 1e-3, "{before:?} {after:?}");
            }
        }
        assert_eq!(hand_over(photons.clone(), N as u64, Filled::Surfaces, Tagged(false)), photons);
    }
}
