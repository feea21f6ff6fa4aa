//! A tree over emitters, from which one is drawn in proportion to what it may bring, in as many steps as the tree is
//! deep (Conty Estevez and Kulla 2018, "Importance sampling of many lights with adaptive tree splitting").
//!
//! Every node holds up to eight children: groups of emitters, or one. From the root down, a child is chosen in proportion to an
//! estimate of the irradiance that it brings, which is 0 only where none of its emitters sends light. A wide node knows more of
//! what it chooses from than a narrow one, and its children are weighed eight at a time.

use super::Receiver;
use super::extent::Extent;
use super::lanes::{Lanes, WIDTH};
use crate::math::{Bounds, DVec3, Ray, choose};
use smallvec::SmallVec;
use std::f64::consts::PI;

/// No tree is deeper: the way to an emitter fits a number of 64 bits, three a level.
const DEEPEST: usize = 21;
/// From this depth on groups are halved by count, so that it gets no deeper.
const HALVED: usize = 10;
/// Places that a group is divided at are looked for between so many parts of its length.
const BINS: usize = 16;
/// In larger groups only along the longest axis, and by directions.
const LARGE: usize = 4096;
/// Points that are farther away in the tree's coordinates count as no farther: their squares' product is still a number.
const FARTHEST: f64 = 1e9;
/// Marks a child as one emitter.
const LEAF: u32 = 1 << 31;
/// Of a group that is spread out evenly within a ball of radius R the mean of 1/distance² from its middle is 3/R², and the mean
/// square of the distance 0.6 R²: so much of that takes the place of the distance.
const NEAR: f64 = 5.0 / 9.0;
/// Of the largest cosine that light of a group may have to a surface's normal, so much counts at least: with less (0.1), strong
/// lights among many weak ones below the horizon make a hall of 10 000 lights noisier, with more (0.5) they do so with 1000.
const OF_MOST: f32 = 0.3;
/// The least that counts of light that comes from below the horizon: shading normals are not those of the surface, and gloss and
/// coats do not go by the cosine. What this wastes is no more than so much.
const GRAZING: f32 = 0.02;

/// The estimate of what emitters bring; the same for drawing one, and for the probability of that.
pub(super) trait Query {
    /// Groups are opened of whose light more than so much of all is in doubt.
    const DOUBT: f32;

    /// What each child may bring.
    fn weigh(&self, node: &Node) -> Weights;
}

/// Emitters in groups of groups.
#[derive(Debug)]
pub(super) struct Tree {
    nodes: Vec<Node>,
    /// By emitter, the way to it from the root: which child to take, three bits a level, the first lowest. `NOWHERE` for
    /// those that send no light.
    ways: Vec<u64>,
    frame: Scale,
    /// W/sr: the sum over all emitters.
    intensity: f64,
}

/// Leads to no emitter.
const NOWHERE: u64 = u64::MAX;

/// The tree's coordinates: all that shines is within about 1 of the origin.
#[derive(Clone, Copy, Debug)]
struct Scale {
    center: DVec3,
    size: f64,
}

/// A lane a child. Lengths are in the tree's coordinates, intensities in shares of all.
#[derive(Debug)]
pub(super) struct Node {
    center: [Lanes; 3],
    low: [Lanes; 3],
    high: [Lanes; 3],
    /// The square of half the middle one of the box' edges: the least that counts as the distance from the box.
    thick: Lanes,
    /// [`NEAR`] times the mean square of the distance from the middle.
    spread: Lanes,
    radius: Lanes,
    axis: [Lanes; 3],
    /// Cosine and sine of half the angle between the outermost of the brightest directions; a cosine of −2 if these are all
    /// around.
    bright: [Lanes; 2],
    /// The cosine of how far from these there is light.
    beyond: Lanes,
    /// 1 over 1 less that; and how much of the intensity is soft.
    fall: Lanes,
    soft: Lanes,
    /// The mean over all directions, in shares of the intensity.
    mean: Lanes,
    /// The smallest area of an emitter.
    area: Lanes,
    intensity: Lanes,
    /// Indices of nodes, or with [`LEAF`] of emitters.
    children: [u32; WIDTH],
}

/// An emitter in a tree that grows.
struct Item {
    extent: Extent,
    emitter: u32,
}

impl Tree {
    /// A tree over these; those that are `None` are never drawn.
    pub fn new(extents: impl ExactSizeIterator<Item = Option<Extent>>) -> Self {
        let mut ways = vec![NOWHERE; extents.len()];
        let with_light = (0..).zip(extents).filter_map(|(emitter, extent)| Some(Item { extent: extent?, emitter }));
        let mut items: Vec<Item> = with_light.collect();
        let bounds = items.iter().fold(Bounds::EMPTY, |all, item| all.union(item.extent.bounds));
        let half = 0.5 * bounds.diagonal();
        let frame = Scale { center: bounds.center(), size: if half > 0.0 { half } else { 1.0 } };
        let intensity = items.iter().map(|item| item.extent.intensity).sum();
        let mut tree = Tree { nodes: Vec::new(), ways: Vec::new(), frame, intensity };
        if !items.is_empty() {
            tree.grow(&mut items, (0, 0), &mut ways);
        }
        tree.ways = ways;
        tree
    }

    /// Adds a node over these emitters, to which this way leads, of so many steps; and all below. Returns its index.
    fn grow(&mut self, items: &mut [Item], (way, depth): (u64, usize), ways: &mut [u64]) -> u32 {
        let index = self.nodes.len();
        self.nodes.push(Node::EMPTY);
        let mut groups = vec![Group::of(items)];
        while groups.len() < WIDTH {
            // The one that says least about where its light comes from.
            let cost = |group: &Group| if depth < HALVED { group.cost } else { group.items.len() as f64 };
            let dividable = (0..groups.len()).filter(|&at| groups[at].items.len() > 1);
            let Some(at) = dividable.max_by(|&a, &b| cost(&groups[a]).total_cmp(&cost(&groups[b]))) else { break };
            let group = groups.swap_remove(at);
            groups.extend(group.divide(depth < HALVED));
        }
        for (lane, group) in groups.into_iter().enumerate() {
            let way = way | (lane as u64) << (3 * depth);
            let extent = Extent::around(group.items.iter().map(|item| &item.extent));
            let child = match group.items {
                [item] => {
                    ways[item.emitter as usize] = way;
                    LEAF | item.emitter
                }
                items => self.grow(items, (way, depth + 1), ways),
            };
            debug_assert!(depth < DEEPEST);
            let (frame, intensity) = (self.frame, self.intensity);
            self.nodes[index].set(lane, &extent, frame, intensity, child);
        }
        index as u32
    }

    /// What may come to a receiver: irradiance, all channels together.
    pub fn to_point(&self, receiver: &Receiver) -> Cut<'_, ToPoint> {
        let point = ((receiver.point - self.frame.center) / self.frame.size).clamp_length_max(FARTHEST);
        self.cut(ToPoint { point, normal: receiver.normal })
    }

    /// What may come to this piece of a ray from emitters that are no farther from its line than `reach`, and no larger.
    pub fn to_segment(&self, ray: &Ray, range: (f64, f64), reach: f64) -> Cut<'_, ToSegment> {
        self.cut(self.near(ray, range, reach))
    }

    /// Whether there may be such an emitter.
    pub fn is_any_near(&self, ray: &Ray, range: (f64, f64), reach: f64) -> bool {
        !self.nodes.is_empty() && self.any_below(&self.near(ray, range, reach), 0)
    }

    fn near(&self, ray: &Ray, (a, b): (f64, f64), reach: f64) -> ToSegment {
        let Scale { center, size } = self.frame;
        ToSegment {
            origin: ((ray.origin - center) / size).as_vec3().to_array(),
            direction: ray.direction.as_vec3().to_array(),
            range: [a, b].map(|t| (t / size) as f32),
            reach: (reach / size) as f32,
        }
    }

    fn any_below(&self, query: &impl Query, node: u32) -> bool {
        let node = &self.nodes[node as usize];
        let Weights { weights, .. } = query.weigh(node);
        let counts =
            |(weight, child): (&f32, &u32)| *weight > 0.0 && (child & LEAF != 0 || self.any_below(query, *child));
        weights.iter().zip(&node.children).any(counts)
    }

    /// Opens groups that say too little about their light.
    fn cut<Q: Query>(&self, query: Q) -> Cut<'_, Q> {
        let mut cut = Cut { tree: self, query, groups: SmallVec::new(), total: 0.0 };
        let mut least = 0.0;
        let mut open: SmallVec<[(u32, u64, u32); CUT]> = SmallVec::new();
        if !self.nodes.is_empty() {
            open.push((0, 0, 0));
        }
        while let Some((index, way, depth)) = open.pop() {
            let node = &self.nodes[index as usize];
            let Weights { weights, doubts } = cut.query.weigh(node);
            if depth == 0 {
                least = Q::DOUBT * weights.iter().sum::<f32>();
            }
            for lane in 0..WIDTH {
                if weights[lane] <= 0.0 {
                    continue;
                }
                let (child, way) = (node.children[lane], way | (lane as u64) << (3 * depth));
                if child & LEAF == 0 && doubts[lane] > least && cut.groups.len() + open.len() + 2 * WIDTH <= CUT {
                    open.push((child, way, depth + 1));
                } else {
                    cut.total += f64::from(weights[lane]);
                    cut.groups.push(Place { child, depth: depth + 1, weight: weights[lane], way });
                }
            }
        }
        cut
    }
}

/// Groups that are told apart for a query, at most.
const CUT: usize = 64;
/// A group in a cut.
struct Place {
    /// As in [`Node::children`].
    child: u32,
    /// Steps from the root, and which.
    depth: u32,
    way: u64,
    weight: f32,
}

/// The groups of a tree from which emitters are drawn for a query: larger ones where they are far away or of little light.
pub(super) struct Cut<'t, Q> {
    tree: &'t Tree,
    query: Q,
    groups: SmallVec<[Place; CUT]>,
    total: f64,
}

impl Cut<'_, ToPoint> {
    /// About the irradiance.
    pub fn irradiance(&self) -> f64 {
        self.total * self.tree.intensity / (self.tree.frame.size * self.tree.frame.size)
    }
}

impl<Q: Query> Cut<'_, Q> {
    /// Draws an emitter: its index, and the probability of that.
    pub fn draw(&self, u: f64) -> Option<(u32, f64)> {
        let choice = choose(self.groups.iter().map(|group| f64::from(group.weight)), self.total, u)?;
        let mut probability = choice.probability;
        let mut u = choice.rest;
        let mut child = self.groups[choice.index].child;
        while child & LEAF == 0 {
            let node = &self.tree.nodes[child as usize];
            let Weights { weights, .. } = self.query.weigh(node);
            let choice = choose(weights.map(f64::from), sum(&weights), u)?;
            probability *= choice.probability;
            u = choice.rest;
            child = node.children[choice.index];
        }
        Some((child & !LEAF, probability))
    }

    /// The probability with which [`Cut::draw`] draws this emitter.
    pub fn probability(&self, emitter: u32) -> f64 {
        let way = self.tree.ways[emitter as usize];
        let leads = |group: &&Place| way != NOWHERE && (way ^ group.way) & !(u64::MAX << (3 * group.depth)) == 0;
        let Some(group) = self.groups.iter().find(leads) else { return 0.0 };
        let mut probability = f64::from(group.weight) / self.total;
        let (mut child, mut way) = (group.child, way >> (3 * group.depth));
        while child & LEAF == 0 {
            let node = &self.tree.nodes[child as usize];
            let (Weights { weights, .. }, lane) = (self.query.weigh(node), way as usize % WIDTH);
            if weights[lane] <= 0.0 {
                return 0.0;
            }
            probability *= f64::from(weights[lane]) / sum(&weights);
            child = node.children[lane];
            way /= WIDTH as u64;
        }
        probability
    }
}

/// A node's children for a query.
pub(super) struct Weights {
    /// What each may bring.
    weights: [f32; WIDTH],
    /// How much of that is in doubt.
    doubts: [f32; WIDTH],
}

fn sum(weights: &[f32; WIDTH]) -> f64 {
    weights.iter().map(|weight| f64::from(*weight)).sum()
}

/// Emitters that become a child, or several.
struct Group<'i> {
    items: &'i mut [Item],
    cost: f64,
}

/// What the cost of a group is made of.
#[derive(Clone, Copy)]
struct Sums {
    bounds: Bounds,
    intensity: f64,
    axis: DVec3,
    /// The widest angle within which one shines.
    wide: f64,
    count: usize,
}

impl Sums {
    const EMPTY: Sums = Sums { bounds: Bounds::EMPTY, intensity: 0.0, axis: DVec3::ZERO, wide: 0.0, count: 0 };

    fn add(&mut self, item: &Item) {
        let Item { extent, .. } = item;
        self.bounds = self.bounds.union(extent.bounds);
        self.intensity += extent.intensity;
        self.axis += extent.intensity * extent.cone.axis;
        let wide = if extent.cone.is_all() { PI } else { extent.cone.bright + extent.cone.beyond };
        self.wide = self.wide.max(wide);
        self.count += 1;
    }

    fn join(&mut self, other: &Sums) {
        self.bounds = self.bounds.union(other.bounds);
        self.intensity += other.intensity;
        self.axis += other.axis;
        self.wide = self.wide.max(other.wide);
        self.count += other.count;
    }

    /// How much the light of a group may differ from what is taken of it: by its intensity, its size, and the directions it
    /// shines in. These are those within its widest angle of a mean one, and of others the farther off, the shorter the sum of
    /// their axes.
    fn cost(&self) -> f64 {
        if self.count == 0 {
            return 0.0;
        }
        let apart = (self.axis.length() / self.intensity).min(1.0).acos();
        self.intensity * self.bounds.size().length_squared() * (1.0 - (self.wide + apart).min(PI).cos())
    }
}

impl<'i> Group<'i> {
    fn of(items: &'i mut [Item]) -> Self {
        let mut sums = Sums::EMPTY;
        items.iter().for_each(|item| sums.add(item));
        let cost = sums.cost();
        Group { items, cost }
    }

    /// Two groups, where they cost least; or halves of the number.
    fn divide(self, by_cost: bool) -> [Group<'i>; 2] {
        let middle = if by_cost { place(self.items) } else { None };
        let (low, high) = self.items.split_at_mut(middle.unwrap_or(self.items.len() / 2));
        [Group::of(low), Group::of(high)]
    }
}

/// Puts these in an order in which they are best divided, before the place returned; `None` where all are at one place.
fn place(items: &mut [Item]) -> Option<usize> {
    let coordinate = |item: &Item, axis: usize| {
        let from = if axis < 3 { item.extent.center } else { item.extent.cone.axis };
        from[axis % 3]
    };
    let of = |from: fn(&Item) -> DVec3| Bounds::of_points(items.iter().map(from));
    let ranges = [of(|item| item.extent.center), of(|item| item.extent.cone.axis)];
    let longest = ranges[0].size().max_element();
    let ranges: [(f64, f64); 6] = std::array::from_fn(|axis| {
        let range = ranges[axis / 3];
        (range.min[axis % 3], range.size()[axis % 3])
    });
    let bin = |item: &Item, axis: usize| {
        let along = (coordinate(item, axis) - ranges[axis].0) / ranges[axis].1;
        ((along * BINS as f64) as usize).min(BINS - 1)
    };
    let mut best: Option<(f64, usize, usize)> = None;
    for axis in 0..6 {
        let size = ranges[axis].1;
        if size <= 0.0 || items.len() > LARGE && axis < 3 && size < longest {
            continue;
        }
        let mut bins = [Sums::EMPTY; BINS];
        items.iter().for_each(|item| bins[bin(item, axis)].add(item));
        // What lies above each bin's lower end.
        let mut above = bins;
        for at in (0..BINS - 1).rev() {
            let next = above[at + 1];
            above[at].join(&next);
        }
        let mut below = Sums::EMPTY;
        for at in 1..BINS {
            below.join(&bins[at - 1]);
            let cost = below.cost() + above[at].cost();
            let both = below.count > 0 && above[at].count > 0;
            if both && best.is_none_or(|(least, ..)| cost < least) {
                best = Some((cost, axis, at));
            }
        }
    }
    let (_, axis, at) = best?;
    items.sort_by_key(|item| bin(item, axis) >= at);
    Some(items.partition_point(|item| bin(item, axis) < at))
}

impl Node {
    const EMPTY: Node = Node {
        center: [Lanes::ZERO; 3],
        low: [Lanes::ZERO; 3],
        high: [Lanes::ZERO; 3],
        thick: Lanes::ZERO,
        spread: Lanes::ZERO,
        radius: Lanes::ZERO,
        axis: [Lanes::ZERO; 3],
        bright: [Lanes::ZERO; 2],
        beyond: Lanes::ZERO,
        fall: Lanes::ZERO,
        soft: Lanes::ZERO,
        mean: Lanes::ZERO,
        area: Lanes::ZERO,
        intensity: Lanes::ZERO,
        children: [0; WIDTH],
    };

    fn set(&mut self, lane: usize, extent: &Extent, frame: Scale, total: f64, child: u32) {
        let Scale { center, size } = frame;
        let Extent { bounds, cone, .. } = extent;
        let write = |to: &mut [Lanes; 3], from: DVec3| {
            to.iter_mut().zip(from.to_array()).for_each(|(axis, x)| axis.0[lane] = x as f32);
        };
        write(&mut self.center, (extent.center - center) / size);
        write(&mut self.low, (bounds.min - center) / size);
        write(&mut self.high, (bounds.max - center) / size);
        let [x, y, z] = (bounds.size() / size).to_array();
        let middle = x.max(y).min(x.min(y).max(z));
        self.thick.0[lane] = (0.25 * middle * middle) as f32;
        self.spread.0[lane] = (NEAR * extent.spread / (size * size)) as f32;
        // Wider by more than places are rounded.
        self.radius.0[lane] = (extent.radius / size) as f32 * (1.0 + 1e-6) + 1e-6;
        if cone.is_all() {
            (self.bright[0].0[lane], self.bright[1].0[lane], self.beyond.0[lane]) = (-2.0, 0.0, -2.0);
        } else {
            write(&mut self.axis, cone.axis);
            let (sin, cos) = cone.bright.sin_cos();
            (self.bright[0].0[lane], self.bright[1].0[lane]) = (cos as f32, sin as f32);
            // Sines from cosines lose digits, but for those of small angles, which meet no others here.
            let margin = if cone.bright + cone.beyond < 0.5 { 1e-5 } else { 1e-3 };
            self.beyond.0[lane] = cone.beyond.cos() as f32 - margin;
        }
        self.fall.0[lane] = 1.0 / (1.0 - self.beyond.0[lane]);
        self.soft.0[lane] = extent.soft as f32;
        self.mean.0[lane] = extent.mean as f32;
        self.area.0[lane] = (extent.area / (size * size)) as f32;
        self.intensity.0[lane] = ((extent.intensity / total) as f32).max(f32::MIN_POSITIVE);
        self.children[lane] = child;
    }
}

/// Light to a point, in the tree's coordinates.
pub(super) struct ToPoint {
    point: DVec3,
    /// As in [`Receiver::normal`].
    normal: DVec3,
}

impl Query for ToPoint {
    /// Opening more makes pictures of a hall with 1000 lights less noisy by less than it costs.
    const DOUBT: f32 = 0.02;

    /// Irradiance: intensity over the square of the distance. For that stands the product of the distances from the middle and
    /// from the box: near a long lamp light goes by 1/(length · distance). The intensity is that of the middle, the closer the
    /// more of the mean over all directions; it is 0 only where the point lies beyond the cone at the least angle to the axis at
    /// which any place of the group sees it. Of that, a surface that takes light from one side only gets the share [`received`].
    #[inline]
    fn weigh(&self, node: &Node) -> Weights {
        let (zero, one) = (Lanes::ZERO, Lanes::all(1.0));
        let [p, n] = [self.point, self.normal].map(|v| v.as_vec3().to_array().map(Lanes::all));
        let (mut distance2, mut near2, mut along, mut above) = (zero, zero, zero, zero);
        for axis in 0..3 {
            let (p, x) = (p[axis], p[axis] - node.center[axis]);
            let aside = (node.low[axis] - p).max(p - node.high[axis]).max(zero);
            distance2 = distance2 + x * x;
            near2 = near2 + aside * aside;
            along = along + x * node.axis[axis];
            above = above - x * n[axis];
        }
        let inverse = one / distance2.max(Lanes::all(1e-18)).sqrt();
        // The cosine of the angle to the axis, less that under which the group is seen, less that of the brightest directions.
        let cos = (along * inverse).max(Lanes::all(-1.0)).min(one);
        let sin = (one - cos * cos).sqrt();
        let sin_seen = (node.radius * inverse).min(one);
        let cos_seen = (one - sin_seen * sin_seen).sqrt();
        let ([cos_bright, sin_bright], beyond) = (node.bright, node.beyond);
        let least = cos.below(cos_seen, cos * cos_seen + sin * sin_seen, one);
        let across = (one - least * least).max(zero).sqrt();
        let least = least.below(cos_bright, least * cos_bright + across * sin_bright, one);
        let least = sin_seen.below(one, least, one);
        // Seen from far the group shines as from its middle; from within as on the mean.
        let middle = cos.below(cos_bright, cos * cos_bright + sin * sin_bright, one);
        let fallen = ((middle - beyond) * node.fall).max(zero);
        let fallen = fallen * (one - node.soft + node.soft * fallen);
        let fallen = cos_bright.below(Lanes::all(-1.0), node.mean, fallen);
        let wide2 = (distance2 + node.spread).max(Lanes::all(1e-18));
        let doubt = node.spread / wide2;
        let facing = fallen + doubt.sqrt() * (node.mean - fallen);
        let product = (near2 + node.thick).max(Lanes::all(1e-18)) * wide2;
        let irradiance = node.intensity * facing.max(Lanes::all(1e-4)) / product.sqrt();
        let irradiance = if self.normal == DVec3::ZERO {
            irradiance
        } else {
            irradiance * received((above * inverse).max(Lanes::all(-1.0)).min(one), (sin_seen, cos_seen), doubt.sqrt())
        };
        let irradiance = irradiance.max(Lanes::all(f32::MIN_POSITIVE));
        let weights = beyond.below(least, zero.below(node.intensity, irradiance, zero), zero);
        Weights { weights: weights.0, doubts: (weights * doubt).0 }
    }
}

/// The share that a surface receives of the light of a group whose middle is at an angle of this cosine to the normal, and whose
/// ball is seen under this angle: about the mean of the cosines of its light, which is that of the middle, the closer the more of
/// ¼, that of all directions; but no less than a part of the largest that any place of the group may have.
#[inline(always)]
fn received(cos: Lanes, (sin_seen, cos_seen): (Lanes, Lanes), close: Lanes) -> Lanes {
    let (zero, one) = (Lanes::ZERO, Lanes::all(1.0));
    let sin = (one - cos * cos).sqrt();
    let most = cos.below(cos_seen, cos * cos_seen + sin * sin_seen, one);
    let most = sin_seen.below(one, most, one);
    let middle = cos.max(zero);
    let mean = middle + close * (Lanes::all(0.25) - middle);
    mean.max(Lanes::all(OF_MOST) * most).max(Lanes::all(GRAZING))
}

/// Light to a piece of a ray, in the tree's coordinates.
pub(super) struct ToSegment {
    origin: [f32; 3],
    direction: [f32; 3],
    range: [f32; 2],
    reach: f32,
}

impl Query for ToSegment {
    /// How much comes to all of a segment is no more than guessed.
    const DOUBT: f32 = 0.25;

    #[inline]
    fn weigh(&self, node: &Node) -> Weights {
        let (zero, all) = (Lanes::ZERO, Lanes::all);
        let (o, d, [a, b]) = (self.origin.map(all), self.direction.map(all), self.range.map(all));
        let to = [0, 1, 2].map(|axis| node.center[axis] - o[axis]);
        let along = to[0] * d[0] + to[1] * d[1] + to[2] * d[2];
        let [x, y, z] = [0, 1, 2].map(|axis| to[axis] - along * d[axis]);
        let aside2 = x * x + y * y + z * z;
        let before = along - along.min(b).max(a);
        let spread = (aside2 + before * before + node.spread + node.area).max(all(1e-30));
        let light = (node.intensity / spread).max(all(f32::MIN_POSITIVE));
        // Within reach, and not too large.
        let farthest = all(self.reach) + node.radius;
        let light = zero.below(node.intensity, light, zero);
        let light = (farthest * farthest).below(aside2, zero, light);
        let weights = all(self.reach * self.reach).below(node.area, zero, light);
        Weights { weights: weights.0, doubts: (weights * node.spread / spread).0 }
    }
}
