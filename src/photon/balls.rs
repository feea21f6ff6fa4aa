//! The point map: photons for point queries, in blocks of sixteen under a balanced tree of boxes.
//!
//! Positions lie apart from what a photon carries: a look-up tests several times as many photons as it
//! gathers. The neighbours of a point are found in two steps: one walk collects the squared distances of
//! photons within a first bound, and one selection by bisection then finds the n-th of them. Among 1.26 n candidates
//! that is 9 times as fast as a heap of the n nearest for n = 50, and 20 times for n = 200; quickselect takes 3 times as
//! long. Look-ups that follow one another are close to one another, so the last radius is a bound that seldom fails.

use super::kernel::Profile;
use super::radius::{InMedium, Radii, radius_limits};
use super::simd::{Isa, LANES, Lanes, Row, Task};
use super::store::{
    KEPT, LEAF, List, Photon, STACK, children, events_of, node_count, ordered, photons_in, pieces, storable,
};
use crate::math::{Bounds, Vec3};
use rayon::prelude::*;
use std::ops::Range;

/// How far a look-up reaches.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Ball {
    /// The same radius everywhere, above 0.
    Fixed(f32),
    /// As far as the n-th nearest photon.
    Nearest {
        /// n, at least 2: the n-th itself only says how far the ball reaches.
        neighbours: u32,
        /// No radius exceeds this. If it is not finite, the diagonal of the box around the photons.
        max_radius: f32,
    },
}

/// What a point map stores.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PointSettings {
    /// How far a look-up reaches.
    pub ball: Ball,
    /// How photons count from the middle of the ball to its rim.
    pub profile: Profile,
    /// Multiplies every radius, the cap included: progressive passes shrink it. At most 1.
    pub scale: f32,
    /// Whether photons remember their number of events.
    pub tagged: bool,
    /// Whether walls near a look-up correct it.
    pub boundaries: bool,
}

impl PointSettings {
    /// The constant profile, untagged, corrected at walls, radii as they are.
    pub fn new(ball: Ball) -> Self {
        PointSettings { ball, profile: Profile::Constant, scale: 1.0, tagged: false, boundaries: true }
    }
}

/// What sixteen photons carry; nothing in lanes without one.
#[derive(Clone, Debug, PartialEq)]
#[repr(C, align(64))]
pub(crate) struct Load {
    pub direction: [Row; 3],
    pub power: [Row; 3],
}

/// Sixteen subtrees: boxes around their photons, and where they are.
#[derive(Clone, Debug, PartialEq)]
#[repr(C, align(64))]
pub(crate) struct BoxNode {
    min: [Row; 3],
    /// Both are ∞ for a child that does not exist.
    max: [Row; 3],
    /// Indices of nodes, or of blocks with [`LEAF`] set.
    children: [u32; LANES],
    /// Which children are blocks.
    leaves: u16,
}

impl BoxNode {
    const EMPTY: BoxNode = BoxNode {
        min: [Row([f32::INFINITY; LANES]); 3],
        max: [Row([f32::INFINITY; LANES]); 3],
        children: [0; LANES],
        leaves: 0,
    };
}

/// How far the nearest surface is at least, around a block.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Clearance {
    center: Vec3,
    distance: f32,
}

/// Photons to be looked up around points: about 38 bytes each, one more if tagged.
#[derive(Clone, Debug)]
pub struct PointMap {
    positions: Vec<[Row; 3]>,
    pub(crate) loads: Vec<Load>,
    /// Events of the photons, if tagged.
    pub(crate) events: Vec<[u8; LANES]>,
    nodes: Vec<BoxNode>,
    /// By block; none if walls do not matter.
    clearances: Vec<Clearance>,
    pub(crate) isa: Isa,
    pub(crate) profile: Profile,
    ball: Ball,
    scale: f32,
    /// The least and the largest radius of adaptive balls, before they are scaled.
    limits: (f32, f32),
    photons: usize,
    rejected: usize,
    bounds: Bounds,
}

/// What one thread keeps from look-up to look-up.
#[derive(Clone, Debug, Default)]
pub struct PointMemory {
    /// Blocks near the last point.
    blocks: Vec<u32>,
    distances: Vec<Row>,
    /// The last place and the distance of its n-th photon.
    last: Option<(Vec3, f32)>,
    /// Nodes visited, in all.
    nodes: u64,
}

impl PointMemory {
    /// The blocks that the last look-up met.
    pub(crate) fn blocks(&self) -> &[u32] {
        &self.blocks
    }

    /// How many nodes all look-ups took.
    pub(crate) fn nodes(&self) -> u64 {
        self.nodes
    }
}

impl PointMap {
    /// A photon is spread over a ball.
    pub const DIMENSION: u32 = 3;

    /// Orders `photons` and builds the tree; in parallel, on the current thread pool, with the same result
    /// for any number of threads.
    ///
    /// `clearance` is asked how far from a place the nearest surface is, which it need not know beyond the
    /// distance it is given: look-ups far from all surfaces need not ask for walls.
    ///
    /// *Nearest:* where fewer than n photons are within `max_radius`, that is the radius. No radius is smaller
    /// than a millionth of `max_radius`, or four roundings of the largest coordinate.
    ///
    /// Photons that are not finite, and those beyond 2³² − 1, are left out and counted.
    pub fn build(
        photons: Vec<Photon>,
        settings: &PointSettings,
        clearance: &(impl Fn(Vec3, f32) -> f32 + Sync),
    ) -> PointMap {
        let given = photons.len();
        let photons = storable(photons);
        let count = photons.len();
        let blocks = count.div_ceil(LANES);
        let (mut positions, mut loads) = (Vec::with_capacity(blocks), Vec::with_capacity(blocks));
        let mut events = Vec::with_capacity(if settings.tagged { blocks } else { 0 });
        for photons in pieces(ordered(photons)) {
            positions.par_extend(photons.par_chunks(LANES).map(positions_of));
            loads.par_extend(photons.par_chunks(LANES).map(load_of));
            if settings.tagged {
                events.par_extend(events_of(&photons));
            }
        }

        let mut nodes = vec![BoxNode::EMPTY; if count == 0 { 0 } else { node_count(positions.len()) }];
        let (min, max) = if count == 0 {
            (Vec3::INFINITY, Vec3::NEG_INFINITY)
        } else {
            Input { positions: &positions, photons: count }.fill(0..positions.len(), 0, &mut nodes)
        };
        let wanted = match settings.ball {
            Ball::Fixed(radius) => radius,
            Ball::Nearest { max_radius, .. } => max_radius,
        };
        let limits = radius_limits(wanted, 1.0, min, max);
        let mut map = PointMap {
            positions,
            loads,
            events,
            nodes,
            clearances: Vec::new(),
            isa: Isa::best(),
            profile: settings.profile,
            ball: settings.ball,
            scale: settings.scale.min(1.0),
            limits,
            photons: count,
            rejected: given - count,
            bounds: Bounds { min: min.as_dvec3(), max: max.as_dvec3() },
        };
        if settings.boundaries {
            map.clearances = map.clearances_by(clearance);
        }
        map
    }

    /// How many photons it holds.
    pub fn len(&self) -> usize {
        self.photons
    }

    /// Whether it holds none.
    pub fn is_empty(&self) -> bool {
        self.photons == 0
    }

    /// How many photons were left out because a number was not finite.
    pub fn rejected(&self) -> usize {
        self.rejected
    }

    /// Memory taken, in bytes.
    pub fn bytes(&self) -> usize {
        size_of_val(&*self.positions)
            + size_of_val(&*self.loads)
            + size_of_val(&*self.events)
            + size_of_val(&*self.nodes)
            + size_of_val(&*self.clearances)
    }

    /// The radius that no look-up exceeds.
    pub fn reach(&self) -> f32 {
        self.scale * self.limits.1
    }

    /// The radii of the balls around some of its photons.
    pub fn radii(&self) -> Radii {
        const SOME: usize = 4096;
        let of = |photon: usize| {
            let rows = &self.positions[photon / LANES];
            let x = Vec3::from(rows.each_ref().map(|row| row.0[photon % LANES]));
            self.look_up(x, &mut PointMemory::default()).sqrt()
        };
        let step = self.photons.div_ceil(SOME).max(1);
        Radii::of(&(0..self.photons).into_par_iter().step_by(step).map(of).collect::<Vec<_>>())
    }

    /// A box around all balls that hold a photon: look-ups outside find nothing. Empty for an empty map.
    pub fn bounds(&self) -> Bounds {
        if self.is_empty() { self.bounds } else { self.bounds.grown(f64::from(self.reach())) }
    }

    /// The squared radius of the ball around `x`; the blocks that reach into it are then in `memory`, in an order
    /// that depends on the map alone. The photons inside are those strictly closer.
    pub(crate) fn look_up(&self, x: Vec3, memory: &mut PointMemory) -> f32 {
        self.isa.run(LookUp { map: self, x, memory })
    }

    #[inline(always)]
    fn around<L: Lanes>(&self, x: Vec3, memory: &mut PointMemory) -> f32 {
        let lanes = [L::splat(x.x), L::splat(x.y), L::splat(x.z)];
        match self.ball {
            Ball::Fixed(_) => {
                let squared = (self.reach() * self.reach()).min(f32::MAX);
                memory.blocks.clear();
                let mut walk = Walk::new(self);
                while let Some((node, mut hit)) = walk.next(&lanes, squared) {
                    while hit != 0 {
                        memory.blocks.push(node.children[hit.trailing_zeros() as usize] & !LEAF);
                        hit &= hit - 1;
                    }
                }
                memory.nodes += walk.visited;
                squared
            }
            Ball::Nearest { neighbours, .. } => {
                let squared = self.nearest::<L>(x, &lanes, neighbours as usize, memory);
                if self.scale == 1.0 { squared } else { squared * self.scale * self.scale }
            }
        }
    }

    /// The squared distance to the `n`-th photon, within the limits.
    #[inline(always)]
    fn nearest<L: Lanes>(&self, x: Vec3, lanes: &[L; 3], n: usize, memory: &mut PointMemory) -> f32 {
        let (least, cap) = self.limits;
        let (least, cap) = (least * least, (cap * cap).min(f32::MAX));
        // Room for whole rows: n numbers, those that come before the list is shortened, and a vector.
        let rows = (KEPT / LANES).max(2 * n.div_ceil(LANES)) + 2;
        if memory.distances.len() < rows {
            memory.distances.resize(rows, Row([0.0; LANES]));
        }
        let most = (rows - 2) * LANES;
        let mut list = List::new(&mut memory.distances);
        let blocks = &mut memory.blocks;

        let mut bound = match memory.last {
            // The n photons of the last ball are within the second of these. The first is tighter where the
            // density is not about to fall.
            Some((place, distance)) => {
                let radius = distance * (1.0 + MARGIN).min(1.0 + ROUNDING + place.distance(x) / distance);
                radius * radius
            }
            None => self.even_radius(n).powi(2),
        };
        let squared = loop {
            bound = bound.max(least).min(cap);
            blocks.clear();
            list.clear();
            let mut walk = Walk::new(self);
            while let Some((node, mut hit)) = walk.next(lanes, bound) {
                while hit != 0 {
                    let block = node.children[hit.trailing_zeros() as usize] & !LEAF;
                    hit &= hit - 1;
                    let d2 = self.squared(block, lanes);
                    let bits = L::bits(d2.less_equal(L::splat(bound)));
                    if bits == 0 {
                        continue;
                    }
                    blocks.push(block);
                    list.push(d2, bits);
                    if list.len() > most {
                        let tighter = list.select::<L>(n, bound);
                        list.shrink(n, tighter);
                        bound = tighter.max(least);
                    }
                }
            }
            memory.nodes += walk.visited;
            if list.len() >= n {
                break list.select::<L>(n, bound).max(least);
            }
            if bound >= cap {
                break cap;
            }
            let growth = InMedium::growth(n as f64 / list.len().max(1) as f64) as f32;
            let radius = bound.sqrt() * ((1.0 + MARGIN) * growth).min(MOST_GROWTH);
            bound = radius * radius;
        };
        memory.last = Some((x, squared.sqrt()));
        squared
    }

    /// The radius of a ball of n photons if they filled the box around them evenly.
    fn even_radius(&self, n: usize) -> f32 {
        let size = self.bounds.size().as_vec3();
        let volume = size.max(Vec3::splat(0.01 * size.max_element())).element_product();
        (InMedium::radius_of(f64::from(volume) * n as f64 / self.photons as f64) as f32).max(f32::MIN_POSITIVE)
    }

    /// Squared distances of a block's photons from `x`.
    #[inline(always)]
    pub(crate) fn squared<L: Lanes>(&self, block: u32, x: &[L; 3]) -> L {
        let [dx, dy, dz] = self.relative(block, x);
        dx.mul_add(dx, dy.mul_add(dy, dz.mul(dz)))
    }

    /// A block's photons relative to `x`.
    #[inline(always)]
    pub(crate) fn relative<L: Lanes>(&self, block: u32, x: &[L; 3]) -> [L; 3] {
        let rows = &self.positions[block as usize];
        [L::load(&rows[0]).sub(x[0]), L::load(&rows[1]).sub(x[1]), L::load(&rows[2]).sub(x[2])]
    }

    /// Whether no surface is within `radius` of `x`, as far as what is known about `blocks` tells.
    pub(crate) fn is_clear(&self, x: Vec3, radius: f32, blocks: &[u32]) -> bool {
        self.clearances.is_empty()
            || blocks.iter().any(|&block| {
                let Clearance { center, distance } = self.clearances[block as usize];
                let spare = distance - radius;
                spare > 0.0 && center.distance_squared(x) < spare * spare
            })
    }

    fn clearances_by(&self, clearance: &(impl Fn(Vec3, f32) -> f32 + Sync)) -> Vec<Clearance> {
        let input = Input { positions: &self.positions, photons: self.photons };
        let of = |block: usize| {
            let (min, max) = input.block(block);
            let (center, half) = (0.5 * (min + max), 0.5 * max.distance(min));
            // A look-up that reaches this block is at most `half` and a radius away.
            let radius = match self.ball {
                Ball::Fixed(_) => self.reach(),
                Ball::Nearest { neighbours, .. } => {
                    (1.5 * half * InMedium::growth(f64::from(neighbours) / LANES as f64) as f32).min(self.reach())
                }
            };
            let limit = 2.0 * radius + half;
            Clearance { center, distance: clearance(center, limit).min(limit) }
        };
        (0..self.positions.len()).into_par_iter().map(of).collect()
    }
}

/// A look-up as a kernel.
struct LookUp<'a> {
    map: &'a PointMap,
    x: Vec3,
    memory: &'a mut PointMemory,
}

impl Task for LookUp<'_> {
    type Output = f32;

    #[inline(always)]
    fn run<L: Lanes>(self) -> f32 {
        self.map.around::<L>(self.x, self.memory)
    }
}

/// A first bound is this much wider than the last radius: chosen in `benches/point.rs`.
const MARGIN: f32 = 0.08;

/// What a root and its square may be off by.
const ROUNDING: f32 = 4.0 * f32::EPSILON;

/// A bound that was too tight grows by this factor at most.
const MOST_GROWTH: f32 = 2.5;

fn positions_of(photons: &[Photon]) -> [Row; 3] {
    let mut rows = [Row([f32::INFINITY; LANES]); 3];
    for (lane, photon) in photons.iter().enumerate() {
        for (row, x) in rows.iter_mut().zip(photon.position.to_array()) {
            row.0[lane] = x;
        }
    }
    rows
}

fn load_of(photons: &[Photon]) -> Load {
    let mut load = Load { direction: [Row([0.0; LANES]); 3], power: [Row([0.0; LANES]); 3] };
    for (lane, photon) in photons.iter().enumerate() {
        for axis in 0..3 {
            load.direction[axis].0[lane] = photon.direction[axis];
            load.power[axis].0[lane] = photon.power[axis];
        }
    }
    load
}

struct Input<'a> {
    positions: &'a [[Row; 3]],
    photons: usize,
}

impl Input<'_> {
    /// Fills `nodes` with the tree over the blocks of `range`; `first` is the index of its root. Returns the
    /// corners of the box around it.
    fn fill(&self, range: Range<usize>, first: usize, nodes: &mut [BoxNode]) -> (Vec3, Vec3) {
        let Some((root, rest)) = nodes.split_first_mut() else { return (Vec3::INFINITY, Vec3::NEG_INFINITY) };
        let boxes = children(&range, first, rest, &mut root.children, |part, first, own| {
            if own.is_empty() { self.block(part.start) } else { self.fill(part, first, own) }
        });
        for (lane, &child) in root.children.iter().enumerate().take(boxes.len()) {
            root.leaves |= u16::from(child & LEAF != 0) << lane;
        }
        let (mut low, mut high) = (Vec3::INFINITY, Vec3::NEG_INFINITY);
        for (lane, (min, max)) in boxes.into_iter().enumerate() {
            for axis in 0..3 {
                root.min[axis].0[lane] = min[axis];
                root.max[axis].0[lane] = max[axis];
            }
            low = low.min(min);
            high = high.max(max);
        }
        (low, high)
    }

    fn block(&self, index: usize) -> (Vec3, Vec3) {
        let rows = &self.positions[index];
        let at = |lane: usize| Vec3::new(rows[0].0[lane], rows[1].0[lane], rows[2].0[lane]);
        (0..photons_in(index, self.photons))
            .fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(min, max), lane| (min.min(at(lane)), max.max(at(lane))))
    }
}

/// A way through the tree.
struct Walk<'a> {
    map: &'a PointMap,
    stack: [u32; STACK + LANES],
    waiting: usize,
    /// Nodes so far.
    visited: u64,
}

impl<'a> Walk<'a> {
    #[inline(always)]
    fn new(map: &'a PointMap) -> Self {
        Walk { map, stack: [0; STACK + LANES], waiting: usize::from(!map.nodes.is_empty()), visited: 0 }
    }

    /// The next node with blocks whose boxes come within the squared distance `bound` of `x`, and which of its
    /// children they are.
    #[inline(always)]
    fn next<L: Lanes>(&mut self, x: &[L; 3], bound: f32) -> Option<(&'a BoxNode, u16)> {
        while self.waiting > 0 {
            self.waiting -= 1;
            let node = &self.map.nodes[self.stack[self.waiting] as usize];
            self.visited += 1;
            // Each step rounds like that of `squared`, so that no photon seems closer than the box it is in.
            let [dx, dy, dz] = [away(node, 0, x[0]), away(node, 1, x[1]), away(node, 2, x[2])];
            let gap = dx.mul_add(dx, dy.mul_add(dy, dz.mul(dz)));
            let hit = L::bits(gap.less_equal(L::splat(bound)));
            let inner = hit & !node.leaves;
            if inner != 0
                && let Some(out) = self.stack[self.waiting..].first_chunk_mut()
            {
                L::compress_indices(&node.children, inner, out);
                self.waiting += inner.count_ones() as usize;
            }
            if hit & node.leaves != 0 {
                return Some((node, hit & node.leaves));
            }
        }
        None
    }
}

/// How far `x` is from the boxes of a node's children along an axis.
#[inline(always)]
fn away<L: Lanes>(node: &BoxNode, axis: usize, x: L) -> L {
    let below = L::load(&node.min[axis]).sub(x);
    let above = x.sub(L::load(&node.max[axis]));
    below.max(above).max(L::splat(0.0))
}
