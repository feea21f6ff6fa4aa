//! What photons are aimed at: spheres around what matters, each with its share of them.

use std::f64::consts::{PI, TAU};
use std::sync::Arc;

use super::emission::BY_POWER;
use super::guide::Guide;
use crate::geometry::Tree;
use crate::math::{Bounds, DVec3, Distribution, Frame, Ray, choose, sampling};

/// A sphere that photons are aimed at.
#[derive(Clone, Debug)]
pub(super) struct Target {
    pub center: DVec3,
    pub radius: f64,
    /// The share of photons that are aimed at it.
    pub share: f64,
    /// Where on it, if that is learnt: of directions, by 1 − cos θ as a share of its most, and the turn; of parallel light by the
    /// distance's square and the turn.
    pub guide: Option<Guide>,
}

/// At which target a photon was aimed, and where on it.
#[derive(Clone, Copy, Debug)]
pub struct Aim {
    pub(super) target: u32,
    pub(super) place: [f64; 2],
}

/// All targets: the smallest around solids, then wider ones.
#[derive(Clone, Debug)]
pub(super) struct Targets {
    all: Vec<Target>,
    /// How many of them are the smallest around a solid.
    closest: usize,
    /// The share of photons that are not aimed.
    unaimed: f64,
    /// A hierarchy, where there are many.
    many: Option<Many>,
}

/// Many targets: those that a line meets are looked up, and one is drawn by bisection.
#[derive(Clone, Debug)]
struct Many {
    tree: Arc<Tree>,
    /// Around all.
    bounds: Bounds,
    /// Shares of the targets and, last, of what is not aimed.
    shares: Distribution,
    /// By how many solids they hold, of the smallest.
    closest: Distribution,
}

/// Spheres around a solid, or around several, are as many times wider than one another: so the power of a photon grows no faster
/// than with the square of the distance from the solid at which it lands, which is how its chance to come to the solid falls.
const WIDER: f64 = 3.0;
/// Around each of so many solids there are wider spheres; more are grouped, and a line meets few spheres, however many there are.
const FEW_SOLIDS: usize = 16;
/// Spheres that cover this part of a wider one are as well aimed at by aiming at that.
const COVERED: f64 = 0.25;
/// So many targets are looked through one by one.
const FEW: usize = 128;
/// Of many targets, those teach where on them to aim that so many photons of use were aimed at.
const TELLING: usize = 64;

impl Target {
    /// The sphere around a box, with no share yet.
    pub fn around(bounds: Bounds) -> Target {
        Target::new(bounds.center(), 0.5 * bounds.diagonal())
    }

    pub fn new(center: DVec3, radius: f64) -> Target {
        Target { center, radius, share: 0.0, guide: None }
    }

    fn bounds(&self) -> Bounds {
        Bounds { min: self.center, max: self.center }.grown(self.radius)
    }

    /// 1 − cos of the half-angle under which it is seen; all around from inside of it.
    fn opening(&self, from: DVec3) -> f64 {
        let sin2 = (self.radius / self.center.distance(from)).powi(2);
        if sin2 < 1.0 { sin2 / (1.0 + (1.0 - sin2).sqrt()) } else { 2.0 }
    }

    /// Its direction, if it has one.
    fn axis(&self, from: DVec3) -> Option<DVec3> {
        (self.center - from).try_normalize()
    }

    /// The direction towards it that two uniform numbers stand for, whatever is learnt.
    pub fn towards(&self, from: DVec3, numbers: [f64; 2]) -> DVec3 {
        let axis = self.axis(from).unwrap_or(DVec3::Z);
        Frame::around(axis).to_world(sampling::cone(self.opening(from), numbers)).normalize()
    }

    /// The density of that per steradian: of two numbers that are uniform, or, `by_guide`, drawn as is learnt.
    fn density(&self, from: DVec3, direction: DVec3, by_guide: bool) -> f64 {
        let opening = self.opening(from);
        let axis = self.axis(from).unwrap_or(DVec3::Z);
        let lower = 0.5 * (axis - direction).length_squared();
        if lower > opening {
            return 0.0;
        }
        let place = || {
            let Frame { x, y, .. } = Frame::around(axis);
            [lower / opening, turn(direction.dot(x), direction.dot(y))]
        };
        let guided = if by_guide { self.guided(place) } else { 1.0 };
        guided / (2.0 * PI * opening)
    }

    /// By how much denser photons are aimed at a place on it than evenly.
    pub fn guided(&self, place: impl FnOnce() -> [f64; 2]) -> f64 {
        self.guide.as_ref().map_or(1.0, |guide| guide.density(place()))
    }
}

/// The direction of (x, y) as a share of a full turn from x.
pub(super) fn turn(x: f64, y: f64) -> f64 {
    (y.atan2(x) / TAU).rem_euclid(1.0)
}

impl Targets {
    /// None: nothing is aimed.
    pub fn none() -> Self {
        Targets { all: Vec::new(), closest: 0, unaimed: 1.0, many: None }
    }

    /// These, and wider ones around them that reach to `whole`; with these shares of the photons, of which those at hand get each the same.
    pub fn with_wider(closest: Vec<Target>, whole: f64, shares: [f64; 2]) -> Self {
        let (closest, wider) = match closest.len() > FEW_SOLIDS {
            true => Groups::new(&closest).spheres(whole),
            false => {
                let mut wider = Vec::new();
                for target in &closest {
                    let mut target = Target { share: 1.0, ..target.clone() };
                    while target.radius > 0.0 && target.radius * WIDER < whole {
                        target.radius *= WIDER;
                        wider.push(target.clone());
                    }
                }
                (closest.into_iter().map(|target| Target { share: 1.0, ..target }).collect(), wider)
            }
        };
        let count = closest.len();
        let each = |of: &[Target], share: f64| share / of.iter().map(|target| target.share).sum::<f64>().max(1.0);
        let (near, wide) = (each(&closest, shares[0]), each(&wider, shares[1]));
        let near = closest.into_iter().map(|target| Target { share: near * target.share, ..target });
        let wide = wider.into_iter().map(|target| Target { share: wide * target.share, ..target });
        Self::of(near.chain(wide).collect(), count)
    }

    /// These, which get such a share of the photons in all.
    pub fn even(mut all: Vec<Target>, share: f64) -> Self {
        let (count, each) = (all.len(), share / all.len().max(1) as f64);
        all.iter_mut().for_each(|target| target.share = each);
        Self::of(all, count)
    }

    fn of(all: Vec<Target>, closest: usize) -> Self {
        let unaimed = 1.0 - all.iter().map(|target| target.share).sum::<f64>();
        let many = (all.len() > FEW).then(|| {
            let boxes: Vec<Bounds> = all.iter().map(Target::bounds).collect();
            Many {
                tree: Arc::new(Tree::new(&boxes)),
                bounds: boxes.iter().fold(Bounds::EMPTY, |all, bounds| all.union(*bounds)),
                shares: Distribution::default(),
                closest: Distribution::new(all[..closest].iter().map(|target| target.share)),
            }
        });
        let mut targets = Targets { all, closest, unaimed, many };
        targets.share_out();
        targets
    }

    fn share_out(&mut self) {
        if let Some(many) = &mut self.many {
            many.shares = Distribution::new(self.all.iter().map(|target| target.share).chain([self.unaimed]));
        }
    }

    pub fn is_empty(&self) -> bool {
        self.all.is_empty()
    }

    /// The share of photons that are not aimed.
    pub fn unaimed(&self) -> f64 {
        self.unaimed
    }

    /// The target that a uniform number stands for, and its number; `None` for what is not aimed.
    pub fn choose(&self, u: f64) -> Option<(u32, &Target)> {
        let chosen = match &self.many {
            Some(many) => many.shares.choose(u).map_or(0, |choice| choice.index),
            None => {
                let shares = self.all.iter().map(|target| target.share).chain([self.unaimed]);
                choose(shares, 1.0, u).map_or(0, |choice| choice.index)
            }
        };
        Some((chosen as u32, self.all.get(chosen)?))
    }

    /// Aims anew: at each target, and where on it, about as much as photons of use were aimed there, by their powers.
    pub fn learn(&mut self, useful: &[(Aim, f64)]) {
        let total: f64 = useful.iter().map(|(_, power)| power).sum();
        if !total.is_normal() {
            return;
        }
        let mut sorted = useful.to_vec();
        sorted.sort_by_key(|(aim, _)| aim.target);
        let mut groups = sorted.chunk_by(|(a, _), (b, _)| a.target == b.target).peekable();
        let (aimed, least) = (1.0 - self.unaimed, if self.many.is_some() { TELLING } else { 1 });
        for (index, target) in (0..).zip(&mut self.all) {
            let here = groups.next_if(|group| group[0].0.target == index).unwrap_or_default();
            let learnt = aimed * here.iter().map(|(_, power)| power).sum::<f64>() / total;
            target.share = BY_POWER * target.share + (1.0 - BY_POWER) * learnt;
            let places = here.iter().filter(|_| here.len() >= least);
            target.guide = Guide::new(places.map(|(aim, power)| (aim.place, *power)));
        }
        self.share_out();
    }

    /// One of the smallest around solids, drawn evenly by solids.
    pub fn any_closest(&self, u: f64) -> Option<&Target> {
        let last = self.closest.checked_sub(1)?;
        let index = match &self.many {
            None => (u * self.closest as f64) as usize,
            Some(many) => many.closest.choose(u)?.index,
        };
        self.all.get(index.min(last))
    }

    /// The density per steradian with which directions from a point are drawn so.
    pub fn density_to_closest(&self, from: DVec3, direction: DVec3) -> f64 {
        match &self.many {
            None => {
                let closest = self.all.iter().take(self.closest);
                closest.map(|target| target.density(from, direction, false)).sum::<f64>() / self.closest.max(1) as f64
            }
            Some(many) => many.sum_along(&Ray::new(from, direction), |index| {
                let target = &self.all[index];
                if index < self.closest {
                    many.closest.probability(index) * target.density(from, direction, false)
                } else {
                    0.0
                }
            }),
        }
    }

    /// The density per steradian with which directions from a point are drawn to all, each by its share.
    pub fn density(&self, from: DVec3, direction: DVec3) -> f64 {
        let of = |target: &Target| target.share * target.density(from, direction, true);
        match &self.many {
            None => self.all.iter().map(of).sum(),
            Some(many) => many.sum_along(&Ray::new(from, direction), |index| of(&self.all[index])),
        }
    }

    /// The sum of what there is `of` each target that a line may meet; of the others there is nothing.
    pub fn across(&self, line: &Ray, of: impl Fn(&Target) -> f64) -> f64 {
        match &self.many {
            None => self.all.iter().map(of).sum(),
            Some(many) => {
                let back = many.bounds.diagonal() + line.origin.distance(many.bounds.center());
                many.sum_along(&Ray::new(line.at(-back), line.direction), |index| of(&self.all[index]))
            }
        }
    }
}

impl Many {
    /// The sum of what there is `of` each target, given by its number, that a ray may meet.
    fn sum_along(&self, ray: &Ray, of: impl Fn(usize) -> f64) -> f64 {
        let mut sum = 0.0;
        self.tree.along(ray, 0.0, f64::INFINITY, |place| {
            sum += of(self.tree.order()[place as usize] as usize);
            f64::INFINITY
        });
        sum
    }
}

/// Targets, halved again and again.
struct Groups {
    /// Parents before their children; the first is of all.
    nodes: Vec<Group>,
}

/// Some targets, and the sphere around them.
struct Group {
    sphere: Target,
    /// The nodes of its halves; itself if it is but one target.
    halves: Option<[usize; 2]>,
}

impl Groups {
    /// Of at least one target.
    fn new(targets: &[Target]) -> Self {
        let mut groups = Groups { nodes: Vec::with_capacity(2 * targets.len()) };
        let mut members: Vec<u32> = (0..targets.len() as u32).collect();
        groups.add(targets, &mut members);
        groups
    }

    /// Adds the group of these, and all within; returns its number.
    fn add(&mut self, targets: &[Target], members: &mut [u32]) -> usize {
        let of = |&index: &u32| &targets[index as usize];
        let bounds = members.iter().fold(Bounds::EMPTY, |all, index| all.union(of(index).bounds()));
        let center = bounds.center();
        let radius =
            members.iter().map(|index| center.distance(of(index).center) + of(index).radius).fold(0.0, f64::max);
        let index = self.nodes.len();
        let sphere = Target { share: members.len() as f64, ..Target::new(center, radius) };
        self.nodes.push(Group { sphere, halves: None });
        if members.len() > 1 {
            let size = bounds.size().to_array();
            let axis = (0..3).fold(0, |best, axis| if size[axis] > size[best] { axis } else { best });
            let middle = members.len() / 2;
            let along = |index: &u32| of(index).center[axis];
            members.select_nth_unstable_by(middle, |a, b| along(a).total_cmp(&along(b)).then(a.cmp(b)));
            let (low, high) = members.split_at_mut(middle);
            self.nodes[index].halves = Some([self.add(targets, low), self.add(targets, high)]);
        }
        index
    }

    /// The smallest spheres to aim at, and wider ones, up to `whole`. Their shares are the numbers of targets in them.
    ///
    /// Within a sphere those that are [`WIDER`] times smaller, or as much smaller again, are aimed at if they cover no more than a part
    /// of what is seen of it: see [`COVERED`]. If not even the targets do, the sphere is as good as they are.
    fn spheres(&self, whole: f64) -> (Vec<Target>, Vec<Target>) {
        let (mut closest, mut wider) = (Vec::new(), Vec::new());
        let mut pending = vec![(0, whole)];
        while let Some((index, reach)) = pending.pop() {
            let Group { sphere, halves } = &self.nodes[index];
            if halves.is_none() || sphere.radius <= 0.0 {
                closest.push(sphere.clone());
                continue;
            }
            let Some((parts, size)) = self.parts(index, reach) else {
                closest.push(sphere.clone());
                continue;
            };
            for part in parts {
                let Group { sphere, halves } = &self.nodes[part];
                let mut target = sphere.clone();
                if halves.is_none() {
                    target.radius *= WIDER;
                }
                while target.radius > 0.0 && target.radius <= size {
                    wider.push(target.clone());
                    target.radius *= WIDER;
                }
                pending.push((part, sphere.radius));
            }
        }
        (closest, wider)
    }

    /// The largest parts of a group that cover little of a sphere of radius `reach` around it, and how large they are.
    fn parts(&self, index: usize, reach: f64) -> Option<(Vec<usize>, f64)> {
        let mut parts = vec![index];
        let mut size = reach;
        loop {
            size /= WIDER;
            let mut next = 0;
            while let Some(&part) = parts.get(next) {
                match self.nodes[part].halves {
                    Some([low, high]) if self.nodes[part].sphere.radius > size => {
                        parts[next] = low;
                        parts.push(high);
                    }
                    _ => next += 1,
                }
            }
            let radius = |part: &usize| self.nodes[*part].sphere.radius;
            let covered: f64 = parts.iter().map(|part| radius(part).max(size).powi(2)).sum();
            if covered <= COVERED * reach * reach {
                return Some((parts, size));
            }
            let all_are_single = parts.iter().all(|part| self.nodes[*part].halves.is_none());
            if all_are_single && parts.iter().all(|part| radius(part) >= size) || size <= 1e-12 * reach {
                return None;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::Stream;
    use crate::math::random::Purpose;

    /// Whatever there is of targets, directions are drawn with the density that is said, of all and of the smallest; and a line meets few.
    #[test]
    fn many_targets_are_aimed_at_with_the_density_that_is_said() {
        for count in [3, 2000] {
            let mut stream = Stream::new(17, Purpose::Test, count, 0);
            let place = |stream: &mut Stream| DVec3::from_array([0; 3].map(|_| 2.0 * stream.uniform() - 1.0));
            let closest: Vec<Target> = (0..count).map(|_| Target::new(place(&mut stream), 0.02)).collect();
            let mut targets = Targets::with_wider(closest, 3.0, [0.5, 0.25]);
            // What covers all that is seen has none wider around it.
            assert!(targets.all.len() <= 8 * count as usize && (0.25 - 1e-9..0.5 + 1e-9).contains(&targets.unaimed));
            let mut first = None;
            for _ in 0..2 {
                let from = DVec3::new(0.3, 0.2, 1.7);
                let (mut inverse, mut closest, mut aims) = (0.0, 0.0, Vec::new());
                const N: u32 = 4000;
                for _ in 0..N {
                    let numbers = [stream.uniform(), stream.uniform(), stream.uniform()];
                    let direction = match targets.choose(numbers[0]) {
                        Some((target, of)) => {
                            let place = of
                                .guide
                                .as_ref()
                                .map_or([numbers[1], numbers[2]], |guide| guide.place([numbers[1], numbers[2]]));
                            aims.push((Aim { target, place }, numbers[1].powi(4)));
                            of.towards(from, place)
                        }
                        None => sampling::sphere([numbers[1], numbers[2]]),
                    };
                    let linear = targets.all.iter().map(|target| target.share * target.density(from, direction, true));
                    let (found, linear) = (targets.density(from, direction), linear.sum::<f64>());
                    assert!((found - linear).abs() <= 1e-9 * linear, "{count}: {found} {linear}");
                    let met = targets.across(&Ray::new(from + direction, direction), |_| 1.0);
                    assert!(met <= 60.0, "{count}: {met} targets on a line");
                    inverse += 1.0 / (found + targets.unaimed / (4.0 * PI)) / f64::from(N);
                    let towards = targets.any_closest(numbers[0]).map(|of| of.towards(from, [numbers[1], numbers[2]]));
                    closest += targets.density_to_closest(from, towards.unwrap_or_default()).recip() / f64::from(N);
                }
                // ∫ 1/p over what p draws is the whole.
                assert!((inverse / (4.0 * PI) - 1.0).abs() < 0.08, "{count}: {inverse}");
                // So it is of the smallest, as much as is seen of them, also when it has been learnt where to aim photons.
                let first = *first.get_or_insert(closest);
                assert!(
                    (closest / first - 1.0).abs() < 0.1 && closest < 4.0 * PI,
                    "{count}: {closest}, {first} before"
                );
                targets.learn(&aims);
            }
        }
    }
}
