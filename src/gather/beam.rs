//! The beam query: all in-scattered light along a ray segment as one sum over the photon discs that
//! it meets (Jarosz et al. 2008, Eq. 20–22).

use super::depth::DepthTable;
use super::phase::{Evaluate, HenyeyGreenstein, Isotropic, Kind, PhaseLanes, Rayleigh, Schlick, Sum};
use crate::math::{DVec3, Frame, Vec3};
use crate::photon::discs::{LEAF, STACK};
use crate::photon::kernel::disc_share_lanes;
use crate::photon::map::{PhotonMap, WallLayer};
use crate::photon::simd::{LANES, Lanes, Row, Task, at_most, prefetch};
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
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
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
            Kind::Schlick(k) => self.gather_phase(query, Schlick::new(*k, omega), stats),
            Kind::Rayleigh => self.gather_phase(query, Rayleigh::new(omega), stats),
            Kind::Sum(terms) => self.gather_phase(query, Sum::new(terms, omega), stats),
        }
    }

    fn gather_phase(&self, query: &BeamQuery, phase: impl Evaluate, stats: &mut GatherStats) -> Gathered {
        stats.queries += 1;
        if self.is_empty() {
            return Gathered::default();
        }
        let exponents = query.extinction.to_array().map(|sigma| (-f64::from(sigma) * LOG2_E) as f32);
        let grey = exponents[0] == exponents[1] && exponents[0] == exponents[2];
        match query.depth {
            None if grey => self.gather_kind(query, phase, Grey(exponents[0]), stats),
            None => self.gather_kind(query, phase, Coloured(exponents), stats),
            Some(table) => self.gather_kind(query, phase, Tabulated { table, exponents, grey }, stats),
        }
    }

    fn gather_kind(
        &self,
        query: &BeamQuery,
        phase: impl Evaluate,
        transmittance: impl Transmit,
        stats: &mut GatherStats,
    ) -> Gathered {
        let constant = phase.constant();
        let sums = self.isa.run(Gather { map: self, query, phase, transmittance, stats });
        let scaled = |sum: [f64; 3]| sum.map(|x| (x * constant) as f32);
        Gathered { total: scaled(sums.total), single: scaled(sums.single) }
    }
}

/// Transmittance from the segment's start, times a factor, for each channel.
trait Transmit: Copy {
    /// Lanes outside of `bits` may be anything.
    fn weigh<L: Lanes>(&self, factor: L, t: L, bits: u16) -> [L; 3];
}

/// A homogeneous medium with the same extinction in every channel: −σ log₂e.
#[derive(Clone, Copy)]
struct Grey(f32);

impl Transmit for Grey {
    #[inline(always)]
    fn weigh<L: Lanes>(&self, factor: L, t: L, _: u16) -> [L; 3] {
        [factor.mul(t.mul(L::splat(self.0)).exp2()); 3]
    }
}

/// A homogeneous medium.
#[derive(Clone, Copy)]
struct Coloured([f32; 3]);

impl Transmit for Coloured {
    #[inline(always)]
    fn weigh<L: Lanes>(&self, factor: L, t: L, _: u16) -> [L; 3] {
        [
            factor.mul(t.mul(L::splat(self.0[0])).exp2()),
            factor.mul(t.mul(L::splat(self.0[1])).exp2()),
            factor.mul(t.mul(L::splat(self.0[2])).exp2()),
        ]
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
    fn weigh<L: Lanes>(&self, factor: L, t: L, mut bits: u16) -> [L; 3] {
        let mut row = Row([0.0; LANES]);
        t.store(&mut row);
        let mut depths = Row([0.0; LANES]);
        while bits != 0 {
            let lane = bits.trailing_zeros() as usize;
            bits &= bits - 1;
            depths.0[lane] = self.table.depth_at(f64::from(row.0[lane])) as f32;
        }
        let depth = L::load(&depths);
        if self.grey {
            Grey(self.exponents[0]).weigh(factor, depth, bits)
        } else {
            Coloured(self.exponents).weigh(factor, depth, bits)
        }
    }
}

/// The query as a kernel.
struct Gather<'a, P, T> {
    map: &'a PhotonMap,
    query: &'a BeamQuery<'a>,
    phase: P,
    transmittance: T,
    stats: &'a mut GatherStats,
}

/// Sums without the phase function's constant.
struct Sums {
    total: [f64; 3],
    single: [f64; 3],
}

/// The ray in every lane: x ↦ x·axis + offset gives the coordinates along ω, u and v.
struct RayLanes<L> {
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

impl<P: Evaluate, T: Transmit> Task for Gather<'_, P, T> {
    type Output = Sums;

    #[inline(always)]
    fn run<L: Lanes>(self) -> Sums {
        let Gather { map, query, phase, transmittance, stats } = self;
        // Offsets are exact in f64, and cancel against coordinates of the same size as the map's,
        // however far away the ray starts.
        let frame = Frame::around(query.direction);
        let omega = query.direction.as_vec3().to_array();
        let (u, v) = (frame.x.as_vec3().to_array(), frame.y.as_vec3().to_array());
        let offset = [query.direction, frame.x, frame.y].map(|axis| -axis.dot(query.origin) as f32);
        let ray = RayLanes::<L> {
            omega: splat3(omega),
            u: splat3(u),
            v: splat3(v),
            offset: splat3(offset),
            length: L::splat(query.length),
        };
        let slabs = if map.boxes { Some(Slabs::new(map, query)) } else { None };

        let mut sums = Sums { total: [0.0; 3], single: [0.0; 3] };
        let mut stack = [0u32; STACK + LANES];
        let mut list = [0u32; LIST];
        let mut waiting = 1;
        while waiting > 0 {
            // Walk until the list is full.
            let mut listed = 0;
            while waiting > 0 && listed < LISTED {
                waiting -= 1;
                let node = &map.nodes[stack[waiting] as usize];
                stats.nodes += 1;
                let hit = match &slabs {
                    Some(slabs) => slabs.hit::<L>(&node.min, &node.max),
                    None => ray.hit(&node.center, &node.radius),
                };
                let leaves = node.leaves();
                let (blocks, inner) = (hit & leaves, hit & !leaves);
                if blocks != 0
                    && let Some(out) = list[listed..].first_chunk_mut()
                {
                    L::compress_indices(&node.children, blocks, out);
                    listed += blocks.count_ones() as usize;
                }
                if inner != 0
                    && let Some(out) = stack[waiting..].first_chunk_mut()
                {
                    L::compress_indices(&node.children, inner, out);
                    waiting += inner.count_ones() as usize;
                }
            }

            // Evaluate what it holds.
            stats.blocks += listed as u64;
            let mut total = [L::splat(0.0); 3];
            let mut single = [L::splat(0.0); 3];
            for i in 0..listed {
                prefetch(&map.blocks[(list[(i + AHEAD).min(listed - 1)] & !LEAF) as usize]);
                let index = (list[i] & !LEAF) as usize;
                let block = &map.blocks[index];
                let x = load3::<L>(&block.position);
                let t = dot_plus(&x, &ray.omega, ray.offset[0]);
                let a = dot_plus(&x, &ray.u, ray.offset[1]);
                let b = dot_plus(&x, &ray.v, ray.offset[2]);
                let inverse_square = L::load(&block.inverse_square);
                let q = a.mul_add(a, b.mul(b)).neg_mul_add(inverse_square, L::splat(1.0));
                let zero = L::splat(0.0);
                let mut mask = L::and(zero.less(q), L::and(zero.less(t), t.less(ray.length)));
                let mut bits = L::bits(mask);
                if bits == 0 {
                    continue;
                }
                let mut factor = q.mul(q).mul(phase.values(&load3::<L>(&block.direction)));
                for wall in map.walls(index) {
                    let (share, near) = beside_wall(wall, &ray, a, b, inverse_square);
                    factor = factor.div(share);
                    mask = L::and(mask, near);
                    bits = L::bits(mask);
                }
                if let Some(events) = map.events.get(index)
                    && query.max_events < u8::MAX
                {
                    bits &= at_most(events, query.max_events);
                    mask = L::mask(bits);
                }
                stats.photons += u64::from(bits.count_ones());
                let weights = transmittance.weigh(factor, t, bits);
                let power = load3::<L>(&block.power);
                for channel in 0..3 {
                    total[channel] = weights[channel].keep(mask).mul_add(power[channel], total[channel]);
                }
                if let Some(events) = map.events.get(index) {
                    let first = L::mask(bits & at_most(events, 0));
                    for channel in 0..3 {
                        single[channel] = weights[channel].keep(first).mul_add(power[channel], single[channel]);
                    }
                }
            }
            for channel in 0..3 {
                sums.total[channel] += f64::from(total[channel].sum());
                sums.single[channel] += f64::from(single[channel].sum());
            }
        }
        sums
    }
}

#[inline(always)]
fn splat3<L: Lanes>(v: [f32; 3]) -> [L; 3] {
    [L::splat(v[0]), L::splat(v[1]), L::splat(v[2])]
}

#[inline(always)]
fn load3<L: Lanes>(rows: &[Row; 3]) -> [L; 3] {
    [L::load(&rows[0]), L::load(&rows[1]), L::load(&rows[2])]
}

/// `x·v + offset`
#[inline(always)]
fn dot_plus<L: Lanes>(x: &[L; 3], v: &[L; 3], offset: L) -> L {
    x[0].mul_add(v[0], x[1].mul_add(v[1], x[2].mul_add(v[2], offset)))
}

impl<L: Lanes> RayLanes<L> {
    /// Which spheres the segment touches.
    #[inline(always)]
    fn hit(&self, center: &[Row; 3], radius: &Row) -> u16 {
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
struct Slabs {
    origin: [f32; 3],
    inverse: [f32; 3],
    start: f32,
    end: f32,
}

/// Stands for 1/0: a ray parallel to a slab is inside of it always or never.
const PARALLEL: f32 = 1e30;

impl Slabs {
    fn new(map: &PhotonMap, query: &BeamQuery) -> Self {
        let moved = (map.bounds().center() - query.origin).dot(query.direction);
        let origin = (query.origin + moved * query.direction).as_vec3().to_array();
        let inverse = query.direction.to_array().map(|w| {
            let inverse = (1.0 / w) as f32;
            if inverse.abs() < PARALLEL { inverse } else { PARALLEL.copysign(w as f32) }
        });
        // Ends are off by roundings of the distance moved.
        let slack = 4.0 * f32::EPSILON * moved.abs() as f32;
        Slabs { origin, inverse, start: -moved as f32 - slack, end: (f64::from(query.length) - moved) as f32 + slack }
    }

    /// Which boxes the segment touches.
    #[inline(always)]
    fn hit<L: Lanes>(&self, min: &[Row; 3], max: &[Row; 3]) -> u16 {
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
fn beside_wall<L: Lanes>(wall: &WallLayer, ray: &RayLanes<L>, a: L, b: L, inverse_square: L) -> (L, L::Mask) {
    let zero = L::splat(0.0);
    let normal = load3::<L>(&wall.normal);
    let (nu, nv) = (dot_plus(&normal, &ray.u, zero), dot_plus(&normal, &ray.v, zero));
    let height = b.neg_mul_add(nv, a.neg_mul_add(nu, L::load(&wall.distance)));
    // The wall cuts the disc's plane in a line at height/sin θ; it never does if the ray is normal to it.
    let sin2 = nu.mul_add(nu, nv.mul(nv)).max(L::splat(f32::MIN_POSITIVE));
    let s2 = height.mul(height).mul(inverse_square).div(sin2);
    (disc_share_lanes(s2), zero.less(height))
}
