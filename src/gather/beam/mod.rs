//! The beam query: all in-scattered light along a ray segment as one sum over the photon discs that
//! it meets (Jarosz et al. 2008, Eq. 20–22).

#[cfg(test)]
mod tests;

use super::depth::DepthTable;
use super::phase::{Evaluate, HenyeyGreenstein, Isotropic, Kind, PhaseLanes, Sum};
use crate::math::random::mix;
use crate::math::{DVec3, Frame, Vec3};
use crate::photon::discs::{PhotonMap, WallLayer};
use crate::photon::kernel::Profile;
use crate::photon::simd::{LANES, Lanes, Row, Task, at_most, dot_plus, load3, splat3};
use crate::photon::store::{LEAF, Node, STACK};
use std::f64::consts::LOG2_E;

/// A segment of a ray from the eye through one medium.
#[derive(Clone, Copy, Debug)]
pub struct BeamQuery<'a> {
    /// Where it starts.
    pub origin: DVec3,
    /// The unit direction ω, away from the eye.
    pub direction: DVec3,
    /// Its length; may be infinite.
    pub length: f32,
    /// The medium's phase function.
    pub phase: &'a PhaseLanes,
    /// The extinction coefficient; with `depth`, per unit of density.
    pub extinction: Vec3,
    /// The density integrated along the segment; `None` for a density of 1 throughout.
    pub depth: Option<&'a DepthTable>,
    /// Only photons with at most this many events count, if the map is tagged; 255 for all.
    pub max_events: u8,
    /// A number in (0, 1] that decides, by Russian roulette, how far the query goes where hardly any light arrives
    /// from; `None` for all the way.
    pub pruning: Option<f32>,
}

/// Russian roulette by transmittance: where less than the share F = [`FAINTEST`] of light arrives from, in its
/// brightest channel, a query goes on with the chance P = T/F, and what it finds there counts 1/P times. One number
/// u decides for the whole ray: it ends where T = F u, and all beyond is neither visited nor evaluated. Right on
/// average over u.
#[derive(Clone, Copy, Debug)]
pub(super) struct Pruning {
    /// log₂ F.
    pub(super) faintest: f32,
    /// log₂ F u.
    pub(super) last: f32,
}

/// Light of a smaller share is left to roulette. The larger it is, the sooner queries end, and the noisier are lights
/// seen through dense media.
const FAINTEST: f32 = 1e-4;

impl Pruning {
    pub(super) fn new(u: Option<f32>) -> Self {
        match u {
            Some(u) => Pruning { faintest: FAINTEST.log2(), last: (FAINTEST * u).log2() },
            None => Pruning { faintest: f32::NEG_INFINITY, last: f32::NEG_INFINITY },
        }
    }

    /// The density integrated up to the end, at these −σ log₂e.
    pub(super) fn depth(&self, exponents: [f32; 3]) -> f32 {
        let brightest = exponents.into_iter().fold(f32::NEG_INFINITY, f32::max);
        if brightest < 0.0 { self.last / brightest } else { f32::INFINITY }
    }

    /// A number for a ray, as good as random, from its direction.
    pub(super) fn number(direction: DVec3) -> f32 {
        let bits = direction.to_array().into_iter().fold(0, |hash, x| mix(hash ^ x.to_bits()));
        ((bits >> 40) + 1) as f32 * (1.0 / (1u64 << 24) as f32)
    }
}

/// What a beam query found.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Gathered {
    /// Radiance at the segment's start.
    pub total: [f32; 3],
    /// The part from photons without events before their collision; 0 if the map is not tagged.
    pub single: [f32; 3],
}

/// What queries cost, summed.
#[derive(Clone, Copy, Debug, Default, serde::Serialize, serde::Deserialize, PartialEq, Eq)]
#[serde(default)]
pub struct GatherStats {
    /// Queries made.
    pub queries: u64,
    /// Nodes visited.
    pub nodes: u64,
    /// Blocks of sixteen photons tested.
    pub blocks: u64,
    /// Photons that contributed.
    pub photons: u64,
}

impl std::ops::AddAssign for GatherStats {
    fn add_assign(&mut self, other: Self) {
        self.queries += other.queries;
        self.nodes += other.nodes;
        self.blocks += other.blocks;
        self.photons += other.photons;
    }
}

impl PhotonMap {
    /// The light scattered towards the start of a ray segment along its whole length,
    ///
    /// L_c = Σᵢ K₂(ρᵢ/rᵢ)/rᵢ² · e^{−σ_c D(tᵢ)} · p(−dᵢ·ω) · Pᵢ,c   over 0 < tᵢ < length, ρᵢ < rᵢ,
    ///
    /// with tᵢ = (xᵢ − o)·ω, ρᵢ the photon's distance from the ray, D(t) = t without a table. Where
    /// walls cut the disc around the foot point, a contribution is divided by the share of the disc
    /// on the photon's side, and is none if the foot point lies on the other side.
    ///
    /// Allocates nothing. The result depends on the map and the query alone, up to the rounding of
    /// the instruction set.
    pub fn gather(&self, query: &BeamQuery, stats: &mut GatherStats) -> Gathered {
        let omega = query.direction;
        match &query.phase.0 {
            Kind::Isotropic => self.gather_phase(query, Isotropic, stats),
            Kind::HenyeyGreenstein(g) => self.gather_phase(query, HenyeyGreenstein::new(*g, omega), stats),
            Kind::Sum(terms) => self.gather_phase(query, Sum::new(terms, omega), stats),
        }
    }

    fn gather_phase(&self, query: &BeamQuery, phase: impl Evaluate, stats: &mut GatherStats) -> Gathered {
        stats.queries += 1;
        if self.is_empty() {
            return Gathered::default();
        }
        let exponents = exponents(query.extinction);
        let grey = exponents[0] == exponents[1] && exponents[0] == exponents[2];
        let pruning = Pruning::new(query.pruning);
        let deepest = pruning.depth(exponents);
        let end = match query.depth {
            None => deepest,
            Some(table) => table.reach(deepest),
        };
        let query = &BeamQuery { length: query.length.min(end), ..*query };
        match query.depth {
            None if grey => self.gather_kind((query, pruning), phase, Grey(exponents[0]), stats),
            None => self.gather_kind((query, pruning), phase, Coloured(exponents), stats),
            Some(table) => self.gather_kind((query, pruning), phase, Tabulated { table, exponents, grey }, stats),
        }
    }

    fn gather_kind(
        &self,
        (query, pruning): (&BeamQuery, Pruning),
        phase: impl Evaluate,
        transmittance: impl Transmit,
        stats: &mut GatherStats,
    ) -> Gathered {
        let constant = phase.constant();
        let sums = self.isa.run(Gather { map: self, query, pruning, phase, transmittance, stats });
        let scaled = |sum: [f64; 3]| sum.map(|x| (x * constant) as f32);
        Gathered { total: scaled(sums.total), single: scaled(sums.single) }
    }
}

/// −σ log₂e, by channel.
pub(super) fn exponents(extinction: Vec3) -> [f32; 3] {
    (extinction.as_dvec3() * -LOG2_E).as_vec3().to_array()
}

/// Transmittance from the segment's start, times a factor, for each channel.
pub(super) trait Transmit: Copy {
    /// Lanes outside of `bits` may be anything.
    fn weigh<L: Lanes>(&self, factor: L, t: L, bits: u16, pruning: Pruning) -> [L; 3];

    /// The density, where it varies: whatever it is outside of `bits`.
    #[inline(always)]
    fn density<L: Lanes>(&self, _t: L, _bits: u16) -> Option<L> {
        None
    }
}

/// A homogeneous medium with the same extinction in every channel: −σ log₂e.
#[derive(Clone, Copy)]
pub(super) struct Grey(pub(super) f32);

impl Transmit for Grey {
    #[inline(always)]
    fn weigh<L: Lanes>(&self, factor: L, t: L, _: u16, pruning: Pruning) -> [L; 3] {
        let exponent = t.mul(L::splat(self.0));
        let kept = factor.keep(L::splat(pruning.last).less(exponent));
        [kept.mul(exponent.max(L::splat(pruning.faintest)).exp2()); 3]
    }
}

/// A homogeneous medium.
#[derive(Clone, Copy)]
pub(super) struct Coloured(pub(super) [f32; 3]);

impl Transmit for Coloured {
    #[inline(always)]
    fn weigh<L: Lanes>(&self, factor: L, t: L, _: u16, pruning: Pruning) -> [L; 3] {
        let [x, y, z] = [t.mul(L::splat(self.0[0])), t.mul(L::splat(self.0[1])), t.mul(L::splat(self.0[2]))];
        let brightest = x.max(y).max(z);
        let lift = L::splat(pruning.faintest).sub(brightest).max(L::splat(0.0));
        let kept = factor.keep(L::splat(pruning.last).less(brightest));
        [kept.mul(x.add(lift).exp2()), kept.mul(y.add(lift).exp2()), kept.mul(z.add(lift).exp2())]
    }
}

/// A heterogeneous medium.
#[derive(Clone, Copy)]
struct Tabulated<'a> {
    table: &'a DepthTable,
    exponents: [f32; 3],
    grey: bool,
}

impl Transmit for Tabulated<'_> {
    #[inline(always)]
    fn weigh<L: Lanes>(&self, factor: L, t: L, bits: u16, pruning: Pruning) -> [L; 3] {
        let depth = self.table.depths(t, bits);
        if self.grey {
            Grey(self.exponents[0]).weigh(factor, depth, bits, pruning)
        } else {
            Coloured(self.exponents).weigh(factor, depth, bits, pruning)
        }
    }

    #[inline(always)]
    fn density<L: Lanes>(&self, t: L, bits: u16) -> Option<L> {
        Some(self.table.densities(t, bits))
    }
}

/// The query as a kernel.
struct Gather<'a, P, T> {
    map: &'a PhotonMap,
    query: &'a BeamQuery<'a>,
    pruning: Pruning,
    phase: P,
    transmittance: T,
    stats: &'a mut GatherStats,
}

/// Sums without the phase function's constant.
struct Sums {
    total: [f64; 3],
    single: [f64; 3],
}

/// A ray with two directions across it: x ↦ x·axis + offset gives the coordinates along ω, u and v.
/// Offsets are exact in f64, and cancel against coordinates of the same size as the map's, however far
/// away the ray starts.
#[derive(Clone, Copy, Debug)]
pub(super) struct RayFrame {
    axes: [[f32; 3]; 3],
    offset: [f32; 3],
    length: f32,
}

impl RayFrame {
    pub(super) fn new(origin: DVec3, direction: DVec3, length: f32) -> Self {
        let frame = Frame::around(direction);
        let axes = [direction, frame.x, frame.y];
        RayFrame {
            axes: axes.map(|axis| axis.as_vec3().to_array()),
            offset: axes.map(|axis| -axis.dot(origin) as f32),
            length,
        }
    }

    #[inline(always)]
    pub(super) fn lanes<L: Lanes>(&self) -> RayLanes<L> {
        RayLanes {
            omega: splat3(self.axes[0]),
            u: splat3(self.axes[1]),
            v: splat3(self.axes[2]),
            offset: splat3(self.offset),
            length: L::splat(self.length),
        }
    }
}

/// Sums in lanes, and how many photons there are in them, counted in a register.
pub(super) struct Found<L> {
    pub(super) total: [L; 3],
    pub(super) single: [L; 3],
    pub(super) photons: u64,
}

impl<L: Lanes> Found<L> {
    #[inline(always)]
    pub(super) fn none() -> Self {
        Found { total: [L::splat(0.0); 3], single: [L::splat(0.0); 3], photons: 0 }
    }
}

/// Adds what the photons of a block contribute to a ray: of each whose foot point lies on the ray and whose disc the ray
/// meets,
///
/// > K₂(ρ) · p(d → −ω) · T(t) · Φ,
///
/// with the photon's distance ρ from the ray, its direction d and flux Φ, and the transmittance T to its foot point at t.
/// The kernel is K₂(ρ) = K₂(0)/r² · (c₀ + c₁q + c₂q²) with q = 1 − ρ²/r², and the block's power is K₂(0) Φ/r² already; of
/// the phase function p, [`Evaluate::constant`] is left out. Beside walls the kernel is divided by the share of it that
/// they leave, and where light follows the density, what a photon counts is multiplied by the density on
/// the ray over its mean across the disc. To `single` go the photons without events.
#[inline(always)]
pub(super) fn add_block<L: Lanes>(
    map: &PhotonMap,
    index: usize,
    ray: &RayLanes<L>,
    phase: &impl Evaluate,
    transmittance: &impl Transmit,
    (max_events, pruning): (u8, Pruning),
    found: &mut Found<L>,
) {
    // In the ray's frame: where the foot point is, and how far within the disc the ray passes.
    let block = map.blocks.get(index);
    let x = load3::<L>(block.position);
    let t = dot_plus(&x, &ray.omega, ray.offset[0]);
    let a = dot_plus(&x, &ray.u, ray.offset[1]);
    let b = dot_plus(&x, &ray.v, ray.offset[2]);
    let inverse_square = L::load(block.inverse_square);
    let mut q = a.mul_add(a, b.mul(b)).neg_mul_add(inverse_square, L::splat(1.0));
    let zero = L::splat(0.0);

    // Discs that lie along a wall, not across the ray.
    let mut t = t;
    let mut leaning = None;
    // Not left to `leaning`: where that is none, what it would hold is multiplied by all the same, and thrown away, and
    // whatever lies there may be denormal, which takes a hundred times as long.
    let mut stretch = L::splat(1.0);
    if let Some(&bits) = map.leaning.get(index)
        && bits != 0
    {
        let disc = Leaning::new(&map.walls(index)[0], bits, ray, [t, a, b], inverse_square);
        t = t.add(disc.shift);
        q = disc.shift.mul(disc.shift).neg_mul_add(inverse_square, q);
        stretch = disc.stretch;
        leaning = Some(disc);
    }

    // Discs that are met, between the ends of the ray.
    let mut mask = L::and(zero.less(q), L::and(zero.less(t), t.less(ray.length)));
    let mut bits = L::bits(mask);
    if bits == 0 {
        return;
    }

    // The kernel's shape and the phase function.
    let [c0, c1, c2] = map.shape;
    let shape = q.mul_add(q.mul_add(L::splat(c2), L::splat(c1)), L::splat(c0));
    let mut factor = shape.mul(phase.values(&load3::<L>(block.direction))).mul(stretch);

    // What walls cut off.
    for wall in map.walls(index) {
        let (share, near) = match &leaning {
            None => beside_wall(map.profile, wall, ray, a, b, inverse_square),
            Some(disc) => disc.beside_wall(map.profile, wall, ray, a, b, inverse_square),
        };
        factor = factor.div(share);
        mask = L::and(mask, near);
        bits = L::bits(mask);
    }

    // Photons that had too many events.
    if let Some(events) = map.events.get(index)
        && max_events < u8::MAX
    {
        bits &= at_most(events, max_events);
        mask = L::mask(bits);
    }
    found.photons += u64::from(bits.count_ones());

    // The density where the ray passes, by its mean over the disc.
    if let Some(mean) = map.densities.get(index)
        && let Some(density) = transmittance.density(t, bits)
    {
        let normal = load3::<L>(&mean.normal);
        let (nu, nv) = (dot_plus(&normal, &ray.u, zero), dot_plus(&normal, &ray.v, zero));
        let here = L::load(&mean.distance);
        let mut around = b.neg_mul_add(nv, a.neg_mul_add(nu, here));
        if let Some(disc) = &leaning {
            around = disc.shift.mul_add(dot_plus(&normal, &ray.omega, zero), around);
        }
        factor = factor.mul(density.div(around.max(here.mul(L::splat(LEAST_DENSITY)))));
    }

    // Transmittance and roulette; then the sums.
    let weights = transmittance.weigh(factor, t, bits, pruning);
    let power = load3::<L>(block.power);
    for channel in 0..3 {
        found.total[channel] = weights[channel].keep(mask).mul_add(power[channel], found.total[channel]);
    }
    if let Some(events) = map.events.get(index) {
        let first = L::mask(bits & at_most(events, 0));
        for channel in 0..3 {
            found.single[channel] = weights[channel].keep(first).mul_add(power[channel], found.single[channel]);
        }
    }
}

/// A [`RayFrame`] in every lane.
pub(super) struct RayLanes<L> {
    omega: [L; 3],
    u: [L; 3],
    v: [L; 3],
    offset: [L; 3],
    length: L,
}

/// Blocks found before they are evaluated: few enough that the list stays in the nearest cache.
const LISTED: usize = 256;

/// How many blocks ahead to fetch.
const AHEAD: usize = 2;

/// Added blocks of one node may overshoot the list, and so may a whole vector written for them.
const LIST: usize = LISTED + 2 * LANES;

/// What may meet a node's children.
pub(super) trait Meets<L> {
    /// Those it meets.
    fn children(&self, node: &Node) -> u16;
}

/// A walk through the hierarchy, depth first, that lists the blocks it finds, some at a time.
pub(super) struct Descent {
    stack: [u32; STACK + LANES],
    waiting: usize,
    list: [u32; LIST],
    /// Nodes visited.
    pub(super) nodes: u64,
}

impl Descent {
    #[inline(always)]
    pub(super) fn new() -> Self {
        Descent { stack: [0; STACK + LANES], waiting: 1, list: [0; LIST], nodes: 0 }
    }

    /// Whether there is more to be listed.
    #[inline(always)]
    pub(super) fn goes_on(&self) -> bool {
        self.waiting > 0
    }

    /// Lists blocks anew until the list is full or the walk ends. Returns how many.
    #[inline(always)]
    pub(super) fn list<L: Lanes>(&mut self, map: &PhotonMap, target: &impl Meets<L>) -> usize {
        let mut listed = 0;
        while self.waiting > 0 && listed < LISTED {
            self.waiting -= 1;
            let node = &map.nodes[self.stack[self.waiting] as usize];
            self.nodes += 1;
            let hit = target.children(node);
            let leaves = node.leaves();
            let (near, inner) = (hit & leaves, hit & !leaves);
            if near != 0
                && let Some(out) = self.list[listed..].first_chunk_mut()
            {
                L::compress_indices(&node.children, near, out);
                listed += near.count_ones() as usize;
            }
            if inner != 0
                && let Some(out) = self.stack[self.waiting..].first_chunk_mut()
            {
                L::compress_indices(&node.children, inner, out);
                self.waiting += inner.count_ones() as usize;
            }
        }
        listed
    }

    /// A block of the list.
    #[inline(always)]
    pub(super) fn block(&self, place: usize) -> usize {
        (self.list[place] & !LEAF) as usize
    }
}

/// A ray, by the test that its map wants.
struct Target<'a, L> {
    ray: &'a RayLanes<L>,
    slabs: &'a Option<Slabs>,
}

impl<L: Lanes> Meets<L> for Target<'_, L> {
    #[inline(always)]
    fn children(&self, node: &Node) -> u16 {
        match self.slabs {
            Some(slabs) => slabs.hit::<L>(&node.min, &node.max),
            None => self.ray.hit(&node.center, &node.radius),
        }
    }
}

impl<P: Evaluate, T: Transmit> Task for Gather<'_, P, T> {
    type Output = Sums;

    #[inline(always)]
    fn run<L: Lanes>(self) -> Sums {
        let Gather { map, query, pruning, phase, transmittance, stats } = self;
        let ray = RayFrame::new(query.origin, query.direction, query.length).lanes::<L>();
        let slabs = if map.boxes { Some(Slabs::new(map, query.origin, query.direction, query.length)) } else { None };

        let limits = (query.max_events, pruning);
        let mut sums = Sums { total: [0.0; 3], single: [0.0; 3] };
        let mut descent = Descent::new();
        let (mut blocks, mut photons) = (0, 0);
        while descent.goes_on() {
            let listed = descent.list::<L>(map, &Target { ray: &ray, slabs: &slabs });
            let mut found = Found::<L>::none();
            for i in 0..listed {
                map.blocks.prefetch(descent.block((i + AHEAD).min(listed - 1)));
                let index = descent.block(i);
                add_block(map, index, &ray, &phase, &transmittance, limits, &mut found);
            }
            for channel in 0..3 {
                sums.total[channel] += f64::from(found.total[channel].sum());
                sums.single[channel] += f64::from(found.single[channel].sum());
            }
            blocks += listed as u64;
            photons += found.photons;
        }
        stats.nodes += descent.nodes;
        stats.blocks += blocks;
        stats.photons += photons;
        sums
    }
}

impl<L: Lanes> RayLanes<L> {
    /// Which spheres the segment touches.
    #[inline(always)]
    pub(super) fn hit(&self, center: &[Row; 3], radius: &Row) -> u16 {
        let x = load3::<L>(center);
        let radius = L::load(radius);
        let t = dot_plus(&x, &self.omega, self.offset[0]);
        let a = dot_plus(&x, &self.u, self.offset[1]);
        let b = dot_plus(&x, &self.v, self.offset[2]);
        let near = a.mul_add(a, b.mul(b)).less_equal(radius.mul(radius));
        let ahead = L::splat(0.0).less(t.add(radius));
        let before_end = t.sub(radius).less(self.length);
        L::bits(L::and(near, L::and(ahead, before_end)))
    }
}

/// The ray as the box test wants it, its origin moved along it to next to the map.
#[derive(Clone, Copy, Debug)]
pub(super) struct Slabs {
    origin: [f32; 3],
    inverse: [f32; 3],
    start: f32,
    end: f32,
}

/// Stands for 1/0: a ray parallel to a slab is inside of it always or never.
const PARALLEL: f32 = 1e30;

impl Slabs {
    pub(super) fn new(map: &PhotonMap, origin: DVec3, direction: DVec3, length: f32) -> Self {
        let moved = (map.bounds().center() - origin).dot(direction);
        let origin = (origin + moved * direction).as_vec3().to_array();
        let inverse = direction.to_array().map(|w| {
            let inverse = (1.0 / w) as f32;
            if inverse.abs() < PARALLEL { inverse } else { PARALLEL.copysign(w as f32) }
        });
        // Ends are off by roundings of the distance moved. The last is finite, so that it lies
        // before boxes that do not exist.
        let slack = 4.0 * f32::EPSILON * moved.abs() as f32;
        let end = ((f64::from(length) - moved) as f32 + slack).min(f32::MAX);
        Slabs { origin, inverse, start: -moved as f32 - slack, end }
    }

    /// Which boxes the segment touches.
    #[inline(always)]
    pub(super) fn hit<L: Lanes>(&self, min: &[Row; 3], max: &[Row; 3]) -> u16 {
        let mut enter = L::splat(self.start);
        let mut leave = L::splat(self.end);
        for axis in 0..3 {
            let (origin, inverse) = (L::splat(self.origin[axis]), L::splat(self.inverse[axis]));
            let low = L::load(&min[axis]).sub(origin).mul(inverse);
            let high = L::load(&max[axis]).sub(origin).mul(inverse);
            enter = enter.max(low.min(high));
            leave = leave.min(low.max(high));
        }
        L::bits(enter.less_equal(leave))
    }
}

/// The share of each disc on the photon's side of its wall, and whether the foot point is there too.
/// `a` and `b` are the photon's coordinates across the ray: the foot point is x − a u − b v.
#[inline(always)]
fn beside_wall<L: Lanes>(
    profile: Profile,
    wall: &WallLayer,
    ray: &RayLanes<L>,
    a: L,
    b: L,
    inverse_square: L,
) -> (L, L::Mask) {
    let zero = L::splat(0.0);
    let normal = load3::<L>(&wall.normal);
    let (nu, nv) = (dot_plus(&normal, &ray.u, zero), dot_plus(&normal, &ray.v, zero));
    let height = b.neg_mul_add(nv, a.neg_mul_add(nu, L::load(&wall.distance)));
    // The wall cuts the disc's plane in a line at height/sin θ; it never does if the ray is normal to it.
    let sin2 = nu.mul_add(nu, nv.mul(nv)).max(L::splat(f32::MIN_POSITIVE));
    let s2 = height.mul(height).mul(inverse_square).div(sin2);
    (profile.disc_share_lanes(s2), zero.less(height))
}

/// Discs that lie along a wall, and others across the ray, of one block.
///
/// A photon may be spread over any disc around it: with the unit normal ν of the disc, the ray meets its plane at
/// t = tᵢ + δ, at the distance √(ρ² + δ²) from the photon, and per length of the ray there are 1/(ν·ω) times as many
/// discs. With ν the wall's normal, light is blended with light at the same depth below the surface only, where it
/// changes little; across the ray, it is blended with light at depths r sin θ apart.
///
/// A wall that is curved leaves its plane before it comes to the ray. Where the ray's start (or its end, if it goes
/// towards the wall) is off the plane by H, less than a quarter of the radius, it stands for the wall: the depth is
/// counted from there, which adds H/(ν·ω) to t. Else the ray comes through another wall, and discs lie across it.
struct Leaning<L> {
    /// ν across the ray, and along it.
    across: [L; 2],
    along: L,
    /// δ.
    shift: L,
    /// 1/(ν·ω).
    stretch: L,
}

/// Discs are not turned farther towards the ray than to this ν·ω, so that none counts more than twenty times.
const LEAST_ALONG: f32 = 0.05;

/// The mean density around a ray is taken to be no less than this share of that around a photon.
const LEAST_DENSITY: f32 = 0.25;

/// (H/r)² up to which a ray's end is on a wall.
const ON_WALL: f32 = 0.0625;

impl<L: Lanes> Leaning<L> {
    /// The photons of `bits` lean on their `wall`.
    #[inline(always)]
    fn new(wall: &WallLayer, bits: u16, ray: &RayLanes<L>, [t, a, b]: [L; 3], inverse_square: L) -> Self {
        let (zero, one) = (L::splat(0.0), L::splat(1.0));
        let normal = load3::<L>(&wall.normal);
        let (nu, nv) = (dot_plus(&normal, &ray.u, zero), dot_plus(&normal, &ray.v, zero));
        let along = dot_plus(&normal, &ray.omega, zero);
        let sign = one.select(zero.less_equal(along), L::splat(-1.0));
        // The end of the ray that may be on the wall, and how high above the wall's plane it is.
        let end = zero.select(zero.less(sign), ray.length).sub(t);
        let foot = b.neg_mul_add(nv, a.neg_mul_add(nu, L::load(&wall.distance)));
        let height = end.mul_add(along, foot);
        let mask = L::mask(bits & L::bits(height.mul(height).mul(inverse_square).less(L::splat(ON_WALL))));
        let along = along.mul(sign);
        let least = L::splat(LEAST_ALONG);
        // What is left across the ray where ν·ω is raised to its least.
        let rest = along.neg_mul_add(along, one).max(L::splat(f32::MIN_POSITIVE));
        let scale = one.min(least.neg_mul_add(least, one).div(rest).sqrt()).mul(sign);
        let across = [nu.mul(scale).keep(mask), nv.mul(scale).keep(mask)];
        let along = along.max(least).select(mask, one);
        let stretch = one.div(along);
        let lift = height.mul(sign).keep(mask);
        let shift = a.mul_add(across[0], b.mul_add(across[1], lift)).mul(stretch);
        Leaning { across, along, shift, stretch }
    }

    /// As the function of this name, for the point where the ray meets the disc.
    #[inline(always)]
    fn beside_wall(
        &self,
        profile: Profile,
        wall: &WallLayer,
        ray: &RayLanes<L>,
        a: L,
        b: L,
        inverse_square: L,
    ) -> (L, L::Mask) {
        let zero = L::splat(0.0);
        let normal = load3::<L>(&wall.normal);
        let (nu, nv) = (dot_plus(&normal, &ray.u, zero), dot_plus(&normal, &ray.v, zero));
        let nw = dot_plus(&normal, &ray.omega, zero);
        let foot = b.neg_mul_add(nv, a.neg_mul_add(nu, L::load(&wall.distance)));
        let height = self.shift.mul_add(nw, foot);
        let cos = nw.mul_add(self.along, nu.mul_add(self.across[0], nv.mul(self.across[1])));
        let sin2 = cos.neg_mul_add(cos, L::splat(1.0)).max(L::splat(1e-6));
        let s2 = height.mul(height).mul(inverse_square).div(sin2);
        (profile.disc_share_lanes(s2), zero.less(height))
    }
}
