//! Visual importance: where photons change the picture. Importons, which are traced from the eye as photons are from lights, tell how
//! much each place counts there (Smits et al. 1992; Peter and Pietrek 1998: the three-pass technique); photons are then emitted and
//! stored with that in view (Keller and Wald 2000; Suykens and Willems 2000).
//!
//! As many photons should lie at a place as it has importance. So where more would, relative to the whole, they are left to roulette: kept
//! ones carry the power of the others. And sources are drawn by how noisy they would leave what is seen.

use super::Photon;
use super::targets::Aim;
use crate::math::Vec3;

/// A place that counts in the picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Importon {
    /// The place.
    pub position: Vec3,
    /// How much it counts: the share of a camera ray's radiance that light from there would be.
    pub weight: f32,
}

/// What importons have left, by who looks for light where they lie.
#[derive(Clone, Debug, Default)]
pub struct Importons {
    /// Along rays through media that scatter.
    pub media: Vec<Importon>,
    /// On surfaces that spread light, seen straight or by specular events: where caustics are looked up.
    pub caustic: Vec<Importon>,
    /// On surfaces where the global map is looked up.
    pub global: Vec<Importon>,
}

impl Importons {
    /// How many there are.
    pub fn count(&self) -> usize {
        self.media.len() + self.caustic.len() + self.global.len()
    }
}

/// How important places are for the photons that come to them. A kd-tree over importons and a pilot's photons together: in each leaf the
/// importons' share of all importance, over the photons' share of all photons.
#[derive(Clone, Debug)]
pub(super) struct Importance {
    nodes: Vec<Node>,
}

/// Where a photon started: the number of its source, and at what it was aimed, if it was.
pub(super) type Origin = (u32, Option<Aim>);

#[derive(Clone, Copy, Debug)]
enum Node {
    /// Splits at this coordinate along an axis; the upper half is the node of this number, the lower one the next.
    Split {
        axis: u8,
        at: f32,
        upper: u32,
    },
    Leaf {
        worth: f32,
    },
}

/// Importons and photons in a leaf, at most: enough for their ratio.
const LEAF: usize = 64;
/// Of each, so many are added to a leaf, at the mean of their shares: what few say may be wrong.
const PRIOR: f64 = 0.5;
/// All photons are kept where there is as much importance as this for them, of what they have on average: to trace others in their place
/// takes longer than to gather them.
const ENOUGH: f64 = 0.25;
/// However unimportant, no fewer than this share of photons is kept: one that is seen after all does not stand out by more, nor are more
/// traced.
const LEAST: f64 = 1.0 / 8.0;
/// However important, a photon counts as no more than so many when sources are chosen.
const MOST: f64 = 8.0;

impl Importance {
    /// From importons and the places of a pilot's photons; `None` where either are too few to tell anything.
    pub fn new(importons: &[Importon], photons: impl Iterator<Item = Vec3>) -> Option<Importance> {
        let photons = photons.map(|position| Marker { position, importance: None });
        let of = |importon: &Importon| Marker { position: importon.position, importance: Some(importon.weight) };
        let mut markers: Vec<Marker> = photons.chain(importons.iter().map(of)).collect();
        markers.retain(|marker| marker.position.is_finite());
        let total = Sums::of(&markers);
        if total.photons == 0.0 || !total.importance.is_normal() {
            return None;
        }
        let mut tree = Importance { nodes: Vec::new() };
        tree.split(&mut markers, &total);
        Some(tree)
    }

    fn split(&mut self, markers: &mut [Marker], total: &Sums) {
        let (low, high) = markers.iter().fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(low, high), marker| {
            (low.min(marker.position), high.max(marker.position))
        });
        let size = high - low;
        let axis = (0..3).fold(0, |widest, axis| if size[axis] > size[widest] { axis } else { widest });
        if markers.len() <= LEAF || size[axis] <= 0.0 {
            self.nodes.push(Node::Leaf { worth: Sums::of(markers).worth(total) as f32 });
            return;
        }
        let middle = markers.len() / 2;
        let coordinate = |marker: &Marker| marker.position[axis];
        markers.select_nth_unstable_by(middle, |a, b| coordinate(a).total_cmp(&coordinate(b)));
        let at = coordinate(&markers[middle]);
        let node = self.nodes.len();
        self.nodes.push(Node::Split { axis: axis as u8, at, upper: 0 });
        let (lower, upper) = markers.split_at_mut(middle);
        self.split(lower, total);
        let second = self.nodes.len() as u32;
        self.nodes[node] = Node::Split { axis: axis as u8, at, upper: second };
        self.split(upper, total);
    }

    /// The share of all importance around a place over the share of all photons: 1 where there are as many as there should be.
    pub fn worth(&self, position: Vec3) -> f64 {
        let mut node = 0;
        loop {
            match self.nodes[node] {
                Node::Leaf { worth } => return f64::from(worth),
                Node::Split { axis, at, upper } => {
                    node = if position[axis as usize] < at { node + 1 } else { upper as usize };
                }
            }
        }
    }

    /// The share of photons around a place that are to be kept.
    pub fn keep(&self, position: Vec3) -> f64 {
        (self.worth(position) / ENOUGH).clamp(LEAST, 1.0)
    }

    /// Of each photon where it started, and its power with what that is worth; and its power's square likewise, which tells the noise
    /// that it leaves in what is seen.
    pub fn useful<'a>(
        &'a self,
        photons: impl Iterator<Item = (&'a Photon, Origin)> + 'a,
    ) -> impl Iterator<Item = Useful> + 'a {
        photons.map(|(photon, origin)| {
            let (power, worth) = (f64::from(photon.power.element_sum()), self.worth(photon.position).min(MOST));
            Useful { origin, power: power * worth, squared: power * power * worth }
        })
    }
}

/// A photon as what is seen makes use of it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Useful {
    /// Where it started.
    pub origin: Origin,
    /// Its power, times what that is worth.
    pub power: f64,
    /// Its power's square, times the same.
    pub squared: f64,
}

/// An importon, or a photon.
#[derive(Clone, Copy)]
struct Marker {
    position: Vec3,
    /// Of an importon.
    importance: Option<f32>,
}

/// What some of them come to.
struct Sums {
    importance: f64,
    photons: f64,
    /// The importance of an importon, on average.
    mean: f64,
}

impl Sums {
    fn of(markers: &[Marker]) -> Sums {
        let importance = markers.iter().filter_map(|marker| marker.importance).map(f64::from).sum::<f64>();
        let importons = markers.iter().filter(|marker| marker.importance.is_some()).count();
        Sums { importance, photons: (markers.len() - importons) as f64, mean: importance / importons.max(1) as f64 }
    }

    /// By how much more importance than photons there is here, of all.
    fn worth(&self, total: &Sums) -> f64 {
        let share = (self.importance + PRIOR * total.mean) / total.importance;
        share / ((self.photons + PRIOR) / total.photons)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::Stream;
    use crate::math::random::Purpose;

    /// Four times as much importance as photons left of x = 0, and a quarter of it right: worth tells both, and only on the right
    /// are photons left to chance.
    #[test]
    fn worth_is_importance_by_photons() {
        let mut stream = Stream::new(11, Purpose::Test, 0, 0);
        let mut place = |left: f64| {
            let x = if stream.uniform() < left { -stream.uniform() } else { stream.uniform() };
            Vec3::new(x as f32, stream.uniform() as f32, 0.0)
        };
        let importons: Vec<Importon> = (0..20_000).map(|_| Importon { position: place(0.8), weight: 3.0 }).collect();
        let photons: Vec<Vec3> = (0..10_000).map(|_| place(0.2)).collect();
        let importance = Importance::new(&importons, photons.into_iter()).expect("there are both");
        let mean = |right: bool| {
            let mut of = 0.0;
            for i in 0..1000 {
                let x = (i as f32 + 0.5) / 1000.0;
                of += importance.worth(Vec3::new(if right { x } else { -x }, 0.618 * i as f32 % 1.0, 0.0)) / 1000.0;
            }
            of
        };
        let [left, right] = [mean(false), mean(true)];
        // Of about 20 in a leaf, the mean of the inverse is higher.
        assert!((left / 4.0 - 1.0).abs() < 0.12 && (right / 0.25 - 1.0).abs() < 0.12, "{left} {right}");
        assert_eq!(importance.keep(Vec3::new(-0.5, 0.5, 0.0)), 1.0);
        assert!(Importance::new(&importons, std::iter::empty()).is_none());
        assert!(Importance::new(&[], [Vec3::ZERO].into_iter()).is_none());
    }
}
