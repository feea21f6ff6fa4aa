//! Beam queries of rays that run close to one another, as those of neighbouring pixels: they share the
//! walk through the hierarchy, and all that varies little between them.
//!
//! One walk collects the photons near the whole bundle. For each group of up to 64 rays, photons are then
//! taken to the group's frame, its rays written as x = pₓ + sₓz, y = p_y + s_y z with small slopes s along the
//! group's axis. What a photon at (a, b, z) contributes is a constant of the group times (1 + d)^{−3/2},
//! where d, linear in sₓ, s_y and −s²/2, carries the phase function's and the transmittance's dependence
//! on the ray: exact in the logarithm's first order, and for Henyey and Greenstein's function in all.
//! The distance from the ray is the offset at the photon's own z, wrong by the order of s²; that order is added but
//! where rays hardly deviate and many photons are met, so that the rims of single discs are not seen.

#![allow(
    clippy::needless_range_loop,
    reason = "iterators' closures need not be inlined into a kernel's instruction set"
)]

use super::beam::{BeamQuery, Descent, GatherStats, Gathered, Meets, Pruning, exponents};
use super::depth::DepthTable;
use super::phase::{Evaluate, HenyeyGreenstein, Isotropic, Kind, PhaseLanes, Sum};
use super::sampled::{GROUP, Sampled, SampledDepths, Samples, TransmittanceTable, VECTORS};
use crate::math::{DVec3, Frame, Ray, Vec3};
use crate::photon::kernel::{Profile, inverse_biweight_share};
use crate::photon::map::PhotonMap;
use crate::photon::simd::{LANES, Lanes, Row, Task, at_most, dot_plus, load3, splat3};
use crate::photon::store::Node;
use smallvec::SmallVec;
use std::ops::Range;

/// Rays that gather together: in one medium, from one map.
#[derive(Clone, Copy, Debug)]
pub struct Bundle<'a> {
    /// The rays and their stretches, those of neighbouring pixels next to one another.
    pub rays: &'a [(Ray, f64, f64)],
    /// The medium's phase function.
    pub phase: &'a PhaseLanes,
    /// The extinction coefficient.
    pub extinction: Vec3,
    /// Only photons with at most this many events count, if the map is tagged; 255 for all.
    pub max_events: u8,
    /// Whether rays end, by roulette, where little light arrives from; not in a heterogeneous medium.
    pub pruned: bool,
    /// In a heterogeneous medium, every ray's depths and the step at which they were sampled.
    pub depths: Option<(&'a SampledDepths, f64, &'a [Samples])>,
}

impl Bundle<'_> {
    /// What one of its rays gathers by itself.
    pub(super) fn gather_alone(
        &self,
        map: &PhotonMap,
        index: usize,
        table: &mut DepthTable,
        stats: &mut GatherStats,
    ) -> Gathered {
        let (ray, a, b) = self.rays[index];
        if let Some((depths, step, samples)) = self.depths {
            depths.tabulate(samples[index], step, a, table);
        }
        let query = BeamQuery {
            origin: ray.at(a),
            direction: ray.direction,
            length: (b - a) as f32,
            phase: self.phase,
            extinction: self.extinction,
            depth: self.depths.is_some().then_some(&*table),
            max_events: self.max_events,
            pruning: self.pruned.then(|| Pruning::number(ray.direction)),
        };
        map.gather(&query, stats)
    }
}

/// Rays of a group may deviate from its axis by this slope: errors are of the order of its square.
const MAX_SLOPE: f64 = 0.02;

/// Where rays deviate by less and many photons are met, rims of discs are not off by a thousandth of a pixel.
const WIDE_SLOPE: f64 = 0.0115;

/// The variable d of a group may reach this, where its series is right to 10⁻⁴.
const MAX_VARIATION: f64 = 0.15;

/// Optical depth by which the starts of a group's rays may differ.
const MAX_DEPTH_APART: f64 = 10.0;

/// The slope up to which a bundle is walked as one.
const WIDE: f64 = 0.7;

/// Photons of one kind near the bundle before all groups are served.
const NEAR: usize = 4096;

/// Photons of a group before they are evaluated: as much as the nearest cache holds.
const CHUNK: usize = 512;

/// Where rays of a vector meet fewer of a chunk's photons than this share, each vector gets a list.
const SPARSE: f32 = 0.7;

/// Fields of a photon near the bundle: position, 1/r², direction, power; then normal and distance of walls.
const FIELDS: usize = 10;
const WALL_FIELDS: usize = 4;

/// Walls a photon may have.
const WALLS: usize = 3;

/// A field of photons, its vectors each in one line of the cache.
#[derive(Clone, Debug)]
#[repr(C, align(64))]
struct Field<const N: usize>([f32; N]);

/// Photons near the bundle, by field. The stride is no multiple of a page, for the sake of the cache.
#[derive(Debug)]
struct Near {
    fields: Vec<Field<NEAR_STRIDE>>,
    len: usize,
}

const NEAR_STRIDE: usize = NEAR + 2 * LANES;

impl Near {
    fn new(walls: usize) -> Self {
        Near { fields: vec![Field([0.0; NEAR_STRIDE]); FIELDS + WALL_FIELDS * walls], len: 0 }
    }

    #[inline(always)]
    fn load<L: Lanes>(&self, index: usize, at: usize) -> L {
        L::load_front(&self.fields[index].0[at..])
    }

    /// Writes packed lanes behind the last photon.
    #[inline(always)]
    fn write<L: Lanes>(&mut self, index: usize, value: L, bits: u16) {
        if let Some(out) = self.fields[index].0[self.len..].first_chunk_mut() {
            value.compress(bits, out);
        }
    }
}

/// Photons in a group's frame.
#[derive(Debug)]
struct Chunk {
    fields: Box<[Field<CHUNK_STRIDE>; CHUNK_FIELDS]>,
    len: usize,
}

const CHUNK_STRIDE: usize = CHUNK + 2 * LANES;

/// x, y, z, 1/r², the three slopes of d, and the power; then 1/r, normal and distance of walls, and the place
/// among the knots of a table.
const CHUNK_FIELDS: usize = PLACE + 1;
const PLACE: usize = 11 + WALL_FIELDS * WALLS;

impl Chunk {
    fn new() -> Self {
        Chunk { fields: Box::new([const { Field([0.0; CHUNK_STRIDE]) }; CHUNK_FIELDS]), len: 0 }
    }

    #[inline(always)]
    fn write<L: Lanes>(&mut self, index: usize, value: L, bits: u16) {
        if let Some(out) = self.fields[index].0[self.len..].first_chunk_mut() {
            value.compress(bits, out);
        }
    }
}

/// [`Pruning`] of a group, by the transmittance since the last start of its rays.
#[derive(Clone, Copy, Debug)]
struct Pruned {
    /// The greatest z of photons that count.
    end: f32,
    /// Photons count 2^max(0, offset + slope·z) times.
    lift: [f32; 2],
}

impl Pruned {
    const NEVER: Pruned = Pruned { end: f32::INFINITY, lift: [f32::NEG_INFINITY, 0.0] };

    fn new(pruning: Pruning, exponents: [f32; 3], start: f32) -> Self {
        let depth = pruning.depth(exponents);
        if depth.is_infinite() {
            return Self::NEVER;
        }
        let brightest = pruning.last / depth;
        Pruned { end: start + depth, lift: [pruning.faintest + brightest * start, -brightest] }
    }
}

/// A group of rays in its own frame.
#[derive(Clone, Debug)]
struct Group {
    /// Its rays in the bundle.
    first: usize,
    count: usize,
    axes: [[f32; 3]; 3],
    offset: [f32; 3],
    /// Offsets p, slopes s and −s²/2 of the rays; lanes without a ray have those of another.
    rays: [Vector; VECTORS],
    /// Everything within |x|, |y| ≤ spread + slope·|z|, for all rays and for each vector around its own axis.
    around: Around,
    near: [Around; VECTORS],
    towards: Towards,
    axis: DVec3,
    /// Where on a ray photons may count last, and the greatest z of such a place.
    reach: f64,
    last: f64,
    /// The first and last z of any ray, and of all rays.
    any: [f32; 2],
    all: [f32; 2],
    /// Where transmittance is counted from.
    zero: f32,
    pruned: Pruned,
    /// What remains to be multiplied, by ray.
    factor: [[f64; 3]; GROUP],
    /// Sums, by vector and channel: of photons without events, and of the others.
    sums: [[[Row; 3]; VECTORS]; 2],
    pinhole: bool,
    /// Whether s² matters where many photons are met.
    wide: bool,
    /// Transmittance, where it is no exponential of z.
    table: Option<TransmittanceTable>,
}

#[derive(Clone, Copy, Debug, PartialEq)]
struct Vector {
    offset: [Row; 2],
    slope: [Row; 2],
    bend: Row,
    start: Row,
    end: Row,
}

impl Vector {
    const EMPTY: Vector = {
        let row = Row([0.0; LANES]);
        Vector { offset: [row; 2], slope: [row; 2], bend: row, start: row, end: row }
    };
}

/// A cone, its spread growing from z = 0 in both directions.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Around {
    offset: [f32; 2],
    slope: [f32; 2],
    spread: f32,
    widening: f32,
}

impl Around {
    const AXIS: Around = Around { offset: [0.0; 2], slope: [0.0; 2], spread: 0.0, widening: 0.0 };
}

/// Memory reused from bundle to bundle.
#[derive(Debug)]
pub struct BundleScratch {
    near: [Option<Near>; 2 * (WALLS + 1)],
    plain: Chunk,
    careful: Chunk,
    lists: Box<[[u32; CHUNK_STRIDE]; VECTORS]>,
    groups: Vec<Group>,
    lines: Vec<Lines>,
    table: DepthTable,
}

impl Default for BundleScratch {
    fn default() -> Self {
        BundleScratch {
            near: Default::default(),
            plain: Chunk::new(),
            careful: Chunk::new(),
            lists: Box::new([[0; CHUNK_STRIDE]; VECTORS]),
            groups: Vec::new(),
            lines: Vec::new(),
            table: DepthTable::new(),
        }
    }
}

impl PhotonMap {
    /// What each ray of a bundle gathers, as [`PhotonMap::gather`] would, to about a thousandth. Rays too far
    /// apart for that, or under another kernel than the biweight, are gathered one by one.
    pub fn gather_bundle(
        &self,
        bundle: &Bundle<'_>,
        scratch: &mut BundleScratch,
        stats: &mut GatherStats,
        out: &mut Vec<Gathered>,
    ) {
        out.clear();
        out.resize(bundle.rays.len(), Gathered::default());
        if self.is_empty() {
            stats.queries += bundle.rays.len() as u64;
            return;
        }
        let mut groups = std::mem::take(&mut scratch.groups);
        let (mut first, mut used) = (0, 0);
        while first < bundle.rays.len() {
            let most = (bundle.rays.len() - first).min(GROUP);
            // Ever fewer rays, as long as they fill a vector.
            let sizes = [most, most.min(GROUP / 2), most.min(LANES)];
            if used == groups.len() {
                groups.push(Group::EMPTY);
            }
            let group = &mut groups[used];
            let mut set = |count: usize| self.isa.run(Arrange { group, map: self, bundle, first, count }).is_some();
            let narrow = self.profile == Profile::Biweight && sizes.into_iter().any(&mut set);
            if narrow {
                first += group.count;
                used += 1;
            } else {
                let end = first + most.min(LANES);
                for index in first..end {
                    out[index] = bundle.gather_alone(self, index, &mut scratch.table, stats);
                }
                first = end;
            }
        }
        self.serve(bundle, &mut groups[..used], scratch, stats);
        let constant = phase_constant(bundle.phase);
        for group in &groups[..used] {
            stats.queries += group.count as u64;
            for index in 0..group.count {
                let (vector, lane) = (index / LANES, index % LANES);
                let gathered = &mut out[group.first + index];
                for channel in 0..3 {
                    let sum = |part: usize| f64::from(group.sums[part][vector][channel].0[lane]);
                    let (single, multiple) = (sum(0), sum(1));
                    let factor = group.factor[index][channel] * constant;
                    gathered.single[channel] = (single * factor) as f32;
                    gathered.total[channel] = ((single + multiple) * factor) as f32;
                }
            }
        }
        scratch.groups = groups;
    }

    /// Gathers for all groups with one walk, or with several if they are far apart.
    fn serve(&self, bundle: &Bundle<'_>, groups: &mut [Group], scratch: &mut BundleScratch, stats: &mut GatherStats) {
        let Some(cone) = Cone::around(self, bundle, groups, &mut scratch.lines) else {
            if let [_, _, ..] = groups {
                let (some, others) = groups.split_at_mut(groups.len() / 2);
                self.serve(bundle, some, scratch, stats);
                self.serve(bundle, others, scratch, stats);
            }
            return;
        };
        match &bundle.phase.0 {
            Kind::Isotropic => self.serve_phase(bundle, Isotropic, &cone, groups, scratch, stats),
            Kind::HenyeyGreenstein(g) => {
                self.serve_phase(bundle, HenyeyGreenstein::new(*g, DVec3::Z), &cone, groups, scratch, stats)
            }
            Kind::Sum(terms) => self.serve_phase(bundle, Sum::new(terms, DVec3::Z), &cone, groups, scratch, stats),
        }
    }

    fn serve_phase<P: Evaluate>(
        &self,
        bundle: &Bundle<'_>,
        phase: P,
        cone: &Cone,
        groups: &mut [Group],
        scratch: &mut BundleScratch,
        stats: &mut GatherStats,
    ) {
        let BundleScratch { near, plain, careful, lists, .. } = scratch;
        let mut serve = |kind: usize, near: &mut Near| {
            for group in groups.iter_mut() {
                let shift = Shift { bundle, phase, near, kind, group, plain, careful, lists, stats };
                self.isa.run(shift);
            }
            near.len = 0;
        };
        let nodes = self.isa.run(Collect { map: self, cone, max_events: bundle.max_events, near, serve: &mut serve });
        for (kind, near) in near.iter_mut().enumerate() {
            if let Some(near) = near.as_mut().filter(|near| near.len > 0) {
                serve(kind, near);
            }
        }
        stats.nodes += nodes;
    }
}

/// The factor that [`Evaluate`] leaves out.
fn phase_constant(phase: &PhaseLanes) -> f64 {
    match &phase.0 {
        Kind::Isotropic => Isotropic.constant(),
        Kind::HenyeyGreenstein(g) => HenyeyGreenstein::new(*g, DVec3::Z).constant(),
        Kind::Sum(terms) => Sum::new(terms, DVec3::Z).constant(),
    }
}

/// A ray in a frame: x = offset + slope·z.
#[derive(Clone, Copy, Debug)]
struct Line {
    /// Where its parameter is 0.
    origin: f64,
    offset: [f64; 2],
    slope: [f64; 2],
    start: f64,
    end: f64,
    /// The cosine between ray and axis.
    cos: f64,
}

impl Line {
    /// Rays that lean away from the axis by more are too oblique.
    const LEAST_COS: f64 = 0.5;

    #[inline(always)]
    fn new(direction: DVec3, from: DVec3, (a, b): (f64, f64), frame: &Frame) -> Line {
        let cos = direction.dot(frame.z);
        let inverse = 1.0 / cos;
        let slope = [direction.dot(frame.x) * inverse, direction.dot(frame.y) * inverse];
        let z = from.dot(frame.z);
        let offset = [from.dot(frame.x) - z * slope[0], from.dot(frame.y) - z * slope[1]];
        Line { origin: z, offset, slope, start: z + a * cos, end: z + b * cos, cos }
    }

    /// The slope's square.
    fn square(&self) -> f64 {
        square(self.slope)
    }
}

#[inline(always)]
fn square([x, y]: [f64; 2]) -> f64 {
    x * x + y * y
}

/// The lines of a group's rays, by field.
#[derive(Clone, Debug)]
struct Lines {
    origin: [f64; GROUP],
    offset: [[f64; GROUP]; 2],
    slope: [[f64; GROUP]; 2],
    square: [f64; GROUP],
    start: [f64; GROUP],
    end: [f64; GROUP],
    cos: [f64; GROUP],
}

impl Lines {
    /// Of rays that end at `reach` at the latest; lines to spare repeat the last. In loops that become vectors.
    #[inline(always)]
    fn new(rays: &[(Ray, f64, f64)], frame: &Frame, origin: DVec3, reach: f64) -> Self {
        let zero = [0.0; GROUP];
        let (mut direction, mut from, mut range) = ([zero; 3], [zero; 3], [zero; 2]);
        for i in 0..GROUP {
            let (ray, a, b) = &rays[i.min(rays.len() - 1)];
            let towards = ray.origin - origin;
            [direction[0][i], direction[1][i], direction[2][i]] = ray.direction.to_array();
            [from[0][i], from[1][i], from[2][i]] = towards.to_array();
            [range[0][i], range[1][i]] = [*a, b.min(reach)];
        }
        let mut lines = Lines {
            origin: zero,
            offset: [zero; 2],
            slope: [zero; 2],
            square: zero,
            start: zero,
            end: zero,
            cos: zero,
        };
        for i in 0..GROUP {
            let along = DVec3::new(direction[0][i], direction[1][i], direction[2][i]);
            let from = DVec3::new(from[0][i], from[1][i], from[2][i]);
            let line = Line::new(along, from, (range[0][i], range[1][i]), frame);
            lines.origin[i] = line.origin;
            for axis in 0..2 {
                lines.offset[axis][i] = line.offset[axis];
                lines.slope[axis][i] = line.slope[axis];
            }
            lines.square[i] = line.square();
            lines.start[i] = line.start;
            lines.end[i] = line.end;
            lines.cos[i] = line.cos;
        }
        lines
    }

    /// The least and the greatest of a field.
    #[inline(always)]
    fn extremes(field: &[f64; GROUP]) -> (f64, f64) {
        let (mut least, mut greatest) = (field[0], field[0]);
        for value in field {
            least = if *value < least { *value } else { least };
            greatest = if *value > greatest { *value } else { greatest };
        }
        (least, greatest)
    }
}

/// Rounded, and finite.
fn bound(x: f64) -> f32 {
    x.clamp(f64::from(-f32::MAX), f64::from(f32::MAX)) as f32
}

/// Where rays come from and where they go.
#[derive(Clone, Copy, Debug)]
struct Towards {
    /// The sums of directions and of origins.
    direction: DVec3,
    origins: DVec3,
    count: usize,
    /// The first one's origin, and whether it is that of all.
    origin: DVec3,
    common: bool,
}

impl Towards {
    const NOWHERE: Towards =
        Towards { direction: DVec3::ZERO, origins: DVec3::ZERO, count: 0, origin: DVec3::ZERO, common: true };

    #[inline(always)]
    fn of(rays: &[(Ray, f64, f64)]) -> Self {
        let mut all = Towards { origin: rays[0].0.origin, count: rays.len(), ..Self::NOWHERE };
        for (ray, ..) in rays {
            all.direction += ray.direction;
            all.origins += ray.origin;
            all.common &= ray.origin == all.origin;
        }
        all
    }

    fn merge(&self, other: &Towards) -> Self {
        if self.count == 0 {
            return *other;
        }
        Towards {
            direction: self.direction + other.direction,
            origins: self.origins + other.origins,
            count: self.count + other.count,
            origin: self.origin,
            common: self.common && other.common && self.origin == other.origin,
        }
    }

    /// An axis, a place on it, and whether that is the origin of them all.
    fn middle(&self, map: &PhotonMap) -> Option<(Frame, DVec3, bool)> {
        let axis = self.direction.try_normalize()?;
        // Single precision wants its origin near the map.
        let bounds = map.bounds();
        let pinhole = self.common && self.origin.distance(bounds.center()) < 4.0 * bounds.diagonal();
        let mean = if self.common { self.origin } else { self.origins / self.count as f64 };
        let origin = if pinhole { mean } else { mean + axis * (bounds.center() - mean).dot(axis) };
        Some((Frame::around(axis), origin, pinhole))
    }
}

fn rows(frame: &Frame) -> [[f32; 3]; 3] {
    [frame.x, frame.y, frame.z].map(|axis| axis.as_vec3().to_array())
}

fn offsets(frame: &Frame, origin: DVec3) -> [f32; 3] {
    [frame.x, frame.y, frame.z].map(|axis| -axis.dot(origin) as f32)
}

/// Lines of a group: by offset and slope.
type Part<'a> = ([&'a [f64]; 2], [&'a [f64]; 2]);

impl Lines {
    #[inline(always)]
    fn some(&self, range: Range<usize>) -> Part<'_> {
        let [x, y] = &self.offset;
        let [u, v] = &self.slope;
        ([&x[range.clone()], &y[range.clone()]], [&u[range.clone()], &v[range]])
    }
}

/// A cone around lines whose axis is their mean.
#[inline(always)]
fn around(parts: &[Part<'_>]) -> Around {
    let (mut offset, mut slope, mut count) = ([0.0; 2], [0.0; 2], 0);
    for (offsets, slopes) in parts {
        count += offsets[0].len();
        for axis in 0..2 {
            for i in 0..offsets[axis].len() {
                offset[axis] += offsets[axis][i];
                slope[axis] += slopes[axis][i];
            }
        }
    }
    let share = 1.0 / count as f64;
    for axis in 0..2 {
        offset[axis] *= share;
        slope[axis] *= share;
    }
    let (mut spread, mut widening) = (0.0, 0.0);
    for (offsets, slopes) in parts {
        for i in 0..offsets[0].len() {
            let aside = square([offsets[0][i] - offset[0], offsets[1][i] - offset[1]]);
            let apart = square([slopes[0][i] - slope[0], slopes[1][i] - slope[1]]);
            spread = if aside > spread { aside } else { spread };
            widening = if apart > widening { apart } else { widening };
        }
    }
    Around::new(offset, slope, spread.sqrt(), widening.sqrt())
}

impl Around {
    /// Rounded up.
    fn new(offset: [f64; 2], slope: [f64; 2], spread: f64, widening: f64) -> Self {
        let up = |x: f64| (x * (1.0 + 1e-5)) as f32;
        Around {
            offset: [offset[0] as f32, offset[1] as f32],
            slope: [slope[0] as f32, slope[1] as f32],
            spread: up(spread),
            widening: up(widening) + 1e-6,
        }
    }

    /// How far its lines may lean from z.
    fn steepest(&self) -> f32 {
        self.widening + self.slope[0].hypot(self.slope[1])
    }
}

/// [`Group::set`] as a kernel.
struct Arrange<'a> {
    group: &'a mut Group,
    map: &'a PhotonMap,
    bundle: &'a Bundle<'a>,
    first: usize,
    count: usize,
}

impl Task for Arrange<'_> {
    type Output = Option<()>;

    #[inline(always)]
    fn run<L: Lanes>(self) -> Option<()> {
        let Arrange { group, map, bundle, first, count } = self;
        group.set(map, bundle, first, count)
    }
}

impl Group {
    const EMPTY: Group = Group {
        first: 0,
        count: 0,
        axes: [[0.0; 3]; 3],
        offset: [0.0; 3],
        rays: [Vector::EMPTY; VECTORS],
        around: Around::AXIS,
        near: [Around::AXIS; VECTORS],
        towards: Towards::NOWHERE,
        axis: DVec3::Z,
        reach: 0.0,
        last: 0.0,
        any: [0.0; 2],
        all: [0.0; 2],
        zero: 0.0,
        pruned: Pruned::NEVER,
        factor: [[0.0; 3]; GROUP],
        sums: [[[Row([0.0; LANES]); 3]; VECTORS]; 2],
        pinhole: false,
        wide: false,
        table: None,
    };

    /// Makes it the group of these rays, its sums zero. `None` if they are too far apart; then it is no group.
    #[inline(always)]
    fn set(&mut self, map: &PhotonMap, bundle: &Bundle<'_>, first: usize, count: usize) -> Option<()> {
        let rays = &bundle.rays[first..first + count];
        let towards = Towards::of(rays);
        let (frame, origin, pinhole) = towards.middle(map)?;
        let lines = Lines::new(rays, &frame, origin, f64::INFINITY);
        if Lines::extremes(&lines.cos).0 < Line::LEAST_COS {
            return None;
        }
        let steepest = Lines::extremes(&lines.square).1.sqrt();
        let (zero, last) = Lines::extremes(&lines.start);
        let (first_end, last_end) = Lines::extremes(&lines.end);
        let extinction = bundle.extinction.as_dvec3();
        // Tables know how transmittance varies; otherwise it must vary little.
        let thickness = if bundle.depths.is_some() { DVec3::ZERO } else { extinction };
        let (thick, thin) = (thickness.max_element(), thickness.min_element());
        let (widest, extent) = (map.radii().max as f64, map.bounds().diagonal());
        let narrow = steepest <= MAX_SLOPE
            && steepest * bundle.phase.steepness() <= MAX_VARIATION
            && steepest * thick * widest <= MAX_VARIATION
            && steepest * (thick - thin) * widest <= 0.1 * MAX_VARIATION
            && steepest.powi(2) * thick * extent <= 0.02 * MAX_VARIATION
            && (last - zero) * thick <= MAX_DEPTH_APART;
        if !narrow {
            return None;
        }

        (self.first, self.count, self.pinhole) = (first, count, pinhole);
        self.wide = steepest > WIDE_SLOPE;
        (self.axes, self.offset) = (rows(&frame), offsets(&frame, origin));
        self.any = [bound(zero), bound(last_end)];
        self.all = [bound(last), bound(first_end)];
        self.zero = bound(zero);
        let pruned = bundle.pruned && bundle.depths.is_none();
        let pruning = Pruning::new(pruned.then(|| Pruning::number(rays[0].0.direction)));
        self.pruned = Pruned::new(pruning, exponents(bundle.extinction), bound(last));
        self.any[1] = self.any[1].min(self.pruned.end);
        (self.towards, self.axis) = (towards, frame.z);
        (self.reach, self.last) = (f64::INFINITY, last_end);
        if self.pruned.end.is_finite() {
            // A photon before the end may have its foot point beyond it.
            let end = f64::from(self.pruned.end) + 2.0 * MAX_SLOPE * widest;
            self.last = last_end.min(end);
            let mut reach = f64::NEG_INFINITY;
            for i in 0..count {
                reach = reach.max((end - lines.origin[i]) * (1.0 + lines.square[i]).sqrt());
            }
            self.reach = reach;
        }
        self.sums = [[[Row([0.0; LANES]); 3]; VECTORS]; 2];
        self.around = around(&[lines.some(0..count)]);
        for (vector, near) in self.near.iter_mut().enumerate().take(count.div_ceil(LANES)) {
            *near = around(&[lines.some(vector * LANES..count.min((vector + 1) * LANES))]);
        }
        for (vector, rays) in self.rays.iter_mut().enumerate() {
            for lane in 0..LANES {
                let i = vector * LANES + lane;
                for axis in 0..2 {
                    rays.offset[axis].0[lane] = lines.offset[axis][i] as f32;
                    rays.slope[axis].0[lane] = lines.slope[axis][i] as f32;
                }
                rays.bend.0[lane] = (-0.5 * lines.square[i]) as f32;
                rays.start.0[lane] = bound(lines.start[i]);
                rays.end.0[lane] = bound(lines.end[i]);
            }
        }
        self.factor = [[1.0; 3]; GROUP];
        if bundle.depths.is_none() {
            for (i, factor) in self.factor.iter_mut().enumerate() {
                let across = lines.offset[0][i] * lines.slope[0][i] + lines.offset[1][i] * lines.slope[1][i];
                let saved = lines.start[i] - zero + 0.5 * lines.start[i] * lines.square[i] + across;
                if saved != 0.0 {
                    *factor = [extinction.x, extinction.y, extinction.z].map(|sigma| (sigma * saved).exp());
                }
            }
        }
        self.table = match bundle.depths {
            None => None,
            Some((depths, step, samples)) => {
                let mut table = self.table.take().unwrap_or_default();
                let sampled =
                    (0..count).map(|index| Sampled { samples: samples[first + index], origin: lines.origin[index] });
                table.set(depths, step, sampled, zero, exponents(bundle.extinction), map.isa)?;
                Some(table)
            }
        };
        Some(())
    }

    fn vectors(&self) -> usize {
        self.count.div_ceil(LANES)
    }
}

/// All that a bundle may meet.
struct Cone {
    axes: [[f32; 3]; 3],
    offset: [f32; 3],
    around: Around,
    any: [f32; 2],
}

impl Cone {
    /// `None` if the rays are too far apart, or there are none.
    fn around(map: &PhotonMap, bundle: &Bundle<'_>, groups: &[Group], lines: &mut Vec<Lines>) -> Option<Cone> {
        let towards = groups.iter().fold(Towards::NOWHERE, |all, group| all.merge(&group.towards));
        let (frame, origin, pinhole) = towards.middle(map)?;
        let (around, any) = if pinhole {
            Self::of_axes(&frame, groups)?
        } else {
            let mut any = [f64::INFINITY, f64::NEG_INFINITY];
            lines.clear();
            for group in groups {
                let rays = &bundle.rays[group.first..group.first + group.count];
                let some = Lines::new(rays, &frame, origin, group.reach);
                if Lines::extremes(&some.cos).0 < Line::LEAST_COS {
                    return None;
                }
                any = [any[0].min(Lines::extremes(&some.start).0), any[1].max(Lines::extremes(&some.end).1)];
                lines.push(some);
            }
            let parts: SmallVec<[Part<'_>; VECTORS]> =
                lines.iter().zip(groups).map(|(lines, group)| lines.some(0..group.count)).collect();
            (around(&parts), any)
        };
        (f64::from(around.widening) <= WIDE || groups.len() == 1).then(|| Cone {
            axes: rows(&frame),
            offset: offsets(&frame, origin),
            around,
            any: any.map(bound),
        })
    }

    /// The cone of groups that come from the frame's origin, each a cone around an axis, and its range.
    fn of_axes(frame: &Frame, groups: &[Group]) -> Option<(Around, [f64; 2])> {
        let mut mean = [0.0; 2];
        for group in groups {
            let line = Line::new(group.axis, DVec3::ZERO, (0.0, 0.0), frame);
            if line.cos < Line::LEAST_COS {
                return None;
            }
            for axis in 0..2 {
                mean[axis] += line.slope[axis] / groups.len() as f64;
            }
        }
        let (mut widening, mut any) = (0.0f64, [f64::INFINITY, f64::NEG_INFINITY]);
        for group in groups {
            let line = Line::new(group.axis, DVec3::ZERO, (0.0, 0.0), frame);
            // What leans by w from an axis of slope s has at most the slope (s + w)/(1 − s w).
            let (lean, slope) = (f64::from(group.around.steepest()), line.square().sqrt());
            let more = lean * (1.0 + line.square()) / (1.0 - slope * lean);
            let apart = square([line.slope[0] - mean[0], line.slope[1] - mean[1]]).sqrt();
            widening = widening.max(apart + more);
            let aside = lean * slope * line.cos;
            let (start, end) = (f64::from(group.any[0]), group.last);
            for z in [line.cos - aside, line.cos + aside] {
                any = [any[0].min(start * z), any[1].max(end * z)];
            }
        }
        Some((Around::new([0.0; 2], mean, 0.0, widening), any))
    }
}

/// A cone in lanes.
struct AroundLanes<L> {
    offset: [L; 2],
    slope: [L; 2],
    spread: L,
    widening: L,
}

impl Around {
    #[inline(always)]
    fn lanes<L: Lanes>(&self) -> AroundLanes<L> {
        AroundLanes {
            offset: [L::splat(self.offset[0]), L::splat(self.offset[1])],
            slope: [L::splat(self.slope[0]), L::splat(self.slope[1])],
            spread: L::splat(self.spread),
            widening: L::splat(self.widening),
        }
    }
}

impl<L: Lanes> AroundLanes<L> {
    /// Which spheres of radius `r` around (a, b, z) it meets.
    #[inline(always)]
    fn meets(&self, a: L, b: L, z: L, r: L) -> L::Mask {
        let x = z.neg_mul_add(self.slope[0], a.sub(self.offset[0]));
        let y = z.neg_mul_add(self.slope[1], b.sub(self.offset[1]));
        let limit = z.max(L::splat(0.0).sub(z)).add(r).mul_add(self.widening, self.spread.add(r));
        x.mul_add(x, y.mul(y)).less_equal(limit.mul(limit))
    }
}

/// A [`Cone`] in lanes.
struct ConeLanes<L> {
    axes: [[L; 3]; 3],
    offset: [L; 3],
    around: AroundLanes<L>,
    first: L,
    last: L,
}

impl Cone {
    #[inline(always)]
    fn lanes<L: Lanes>(&self) -> ConeLanes<L> {
        ConeLanes {
            axes: [splat3(self.axes[0]), splat3(self.axes[1]), splat3(self.axes[2])],
            offset: splat3(self.offset),
            around: self.around.lanes(),
            first: L::splat(self.any[0]),
            last: L::splat(self.any[1]),
        }
    }
}

impl<L: Lanes> ConeLanes<L> {
    /// Which spheres it meets.
    #[inline(always)]
    fn meets(&self, x: &[L; 3], r: L) -> u16 {
        let a = dot_plus(x, &self.axes[0], self.offset[0]);
        let b = dot_plus(x, &self.axes[1], self.offset[1]);
        let z = dot_plus(x, &self.axes[2], self.offset[2]);
        let between = L::and(self.first.less(z.add(r)), z.sub(r).less(self.last));
        L::bits(L::and(self.around.meets(a, b, z, r), between))
    }
}

/// How many blocks ahead to fetch.
const AHEAD: usize = 6;

impl<L: Lanes> Meets<L> for ConeLanes<L> {
    #[inline(always)]
    fn children(&self, node: &Node) -> u16 {
        self.meets(&load3(&node.center), L::load(&node.radius))
    }
}

/// The walk that collects the photons near a bundle.
struct Collect<'a, F> {
    map: &'a PhotonMap,
    cone: &'a Cone,
    max_events: u8,
    near: &'a mut [Option<Near>; 2 * (WALLS + 1)],
    serve: &'a mut F,
}

/// Photons are of one kind if they had an event before or not, and by the number of walls: kind/2.
fn kind(events: bool, walls: usize) -> usize {
    2 * walls + usize::from(events)
}

impl<F: FnMut(usize, &mut Near)> Task for Collect<'_, F> {
    /// Nodes visited.
    type Output = u64;

    #[inline(always)]
    fn run<L: Lanes>(self) -> u64 {
        let Collect { map, cone, max_events, near, serve } = self;
        let cone = cone.lanes::<L>();

        let mut descent = Descent::new();
        while descent.goes_on() {
            let listed = descent.list::<L>(map, &cone);
            for i in 0..listed.min(AHEAD) {
                map.blocks.prefetch(descent.block(i));
            }
            for i in 0..listed {
                map.blocks.prefetch(descent.block((i + AHEAD).min(listed - 1)));
                let index = descent.block(i);
                let block = map.blocks.get(index);
                let x = load3(block.position);
                let inverse_square = L::load(block.inverse_square);
                let mut bits = cone.meets(&x, inverse_square.rsqrt());
                let mut first_events = 0;
                if let Some(events) = map.events.get(index) {
                    first_events = at_most(events, 0);
                    bits &= at_most(events, max_events);
                }
                if bits == 0 {
                    continue;
                }
                let walls = map.walls(index);
                for layer in 0..=walls.len().min(WALLS) {
                    // Layers are filled in order: those with no wall in the next are done.
                    let more = walls
                        .get(layer)
                        .map_or(0, |wall| L::bits(L::load(&wall.distance).less(L::splat(f32::INFINITY))));
                    let here = bits & !more;
                    bits &= more;
                    for (events, some) in [(false, here & first_events), (true, here & !first_events)] {
                        if some == 0 {
                            continue;
                        }
                        let kind = kind(events, layer);
                        let near = near[kind].get_or_insert_with(|| Near::new(layer));
                        for axis in 0..3 {
                            near.write(axis, x[axis], some);
                            near.write(4 + axis, L::load(&block.direction[axis]), some);
                            near.write(7 + axis, L::load(&block.power[axis]), some);
                        }
                        near.write(3, inverse_square, some);
                        for (wall, index) in walls[..layer].iter().zip((FIELDS..).step_by(WALL_FIELDS)) {
                            for axis in 0..3 {
                                near.write(index + axis, L::load(&wall.normal[axis]), some);
                            }
                            near.write(index + 3, L::load(&wall.distance), some);
                        }
                        near.len += some.count_ones() as usize;
                        if near.len + LANES > NEAR {
                            serve(kind, near);
                        }
                    }
                }
            }
        }
        descent.nodes
    }
}

/// Takes photons near the bundle to a group's frame, and evaluates them there.
struct Shift<'a, P> {
    bundle: &'a Bundle<'a>,
    phase: P,
    near: &'a Near,
    kind: usize,
    group: &'a mut Group,
    plain: &'a mut Chunk,
    careful: &'a mut Chunk,
    lists: &'a mut [[u32; CHUNK_STRIDE]; VECTORS],
    stats: &'a mut GatherStats,
}

impl<P: Evaluate> Task for Shift<'_, P> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self) {
        let Shift { bundle, phase, near, kind, group, plain, careful, lists, stats } = self;
        let (walls, part) = (kind / 2, kind % 2);
        let axes = [splat3::<L>(group.axes[0]), splat3(group.axes[1]), splat3(group.axes[2])];
        let offset = splat3::<L>(group.offset);
        let zero = L::splat(0.0);
        let around = group.around.lanes::<L>();
        let (any_start, any_end) = (L::splat(group.any[0]), L::splat(group.any[1]));
        let (all_start, all_end) = (L::splat(group.all[0]), L::splat(group.all[1]));
        // |z| of a foot point deviates from that of its photon by the radius times the slope.
        let slope = L::splat(group.around.steepest() + 1e-5);
        let start = L::splat(group.zero);
        let sigma = bundle.extinction;
        let exponents = exponents(sigma);
        let tabulated = group.table.is_some();
        let grey = exponents[0] == exponents[1] && exponents[0] == exponents[2];
        // Tables know how transmittance varies from ray to ray.
        let thirds = L::splat(if tabulated { 0.0 } else { sigma.element_sum() * (2.0 / 9.0) });
        plain.len = 0;
        careful.len = 0;
        for at in (0..near.len).step_by(LANES) {
            let x = [near.load::<L>(0, at), near.load(1, at), near.load(2, at)];
            let inverse_square = near.load::<L>(3, at);
            let a = dot_plus(&x, &axes[0], offset[0]);
            let b = dot_plus(&x, &axes[1], offset[1]);
            let z = dot_plus(&x, &axes[2], offset[2]);
            let r = inverse_square.rsqrt();
            let between = L::and(any_start.less(z.add(r)), z.sub(r).less(any_end));
            let between = L::and(between, z.less_equal(L::splat(group.pruned.end)));
            let valid = u16::MAX >> (LANES - (near.len - at).min(LANES));
            let hit = L::bits(L::and(around.meets(a, b, z, r), between)) & valid;
            if hit == 0 {
                continue;
            }
            let direction = [near.load::<L>(4, at), near.load(5, at), near.load(6, at)];
            let d = [
                dot_plus(&direction, &axes[0], zero),
                dot_plus(&direction, &axes[1], zero),
                dot_plus(&direction, &axes[2], zero),
            ];
            let (value, kappa) = phase.near_axis(&d);
            // What lies farther before the start has its foot point there too, and counts nothing, however bright.
            let margin = r.mul(slope);
            let depth = z.sub(start).max(zero.sub(margin));
            let weights = if tabulated {
                [value; 3]
            } else {
                let lift = z.mul_add(L::splat(group.pruned.lift[1]), L::splat(group.pruned.lift[0])).max(zero);
                if grey {
                    [value.mul(depth.mul_add(L::splat(exponents[0]), lift).exp2()); 3]
                } else {
                    [
                        value.mul(depth.mul_add(L::splat(exponents[0]), lift).exp2()),
                        value.mul(depth.mul_add(L::splat(exponents[1]), lift).exp2()),
                        value.mul(depth.mul_add(L::splat(exponents[2]), lift).exp2()),
                    ]
                }
            };
            let fields = [
                a,
                b,
                z,
                inverse_square,
                a.mul_add(thirds, kappa.mul(d[0])),
                b.mul_add(thirds, kappa.mul(d[1])),
                z.mul_add(thirds, kappa.mul(d[2])),
                near.load::<L>(7, at).mul(weights[0]),
                near.load::<L>(8, at).mul(weights[1]),
                near.load::<L>(9, at).mul(weights[2]),
            ];
            let inside = L::bits(L::and(all_start.less(z.sub(margin)), z.add(margin).less(all_end)));
            let safe = if walls == 0 { hit & inside } else { 0 };
            if safe != 0 {
                for index in 0..FIELDS {
                    plain.write(index, fields[index], safe);
                }
                if let Some(table) = &group.table {
                    plain.write(PLACE, table.place(z), safe);
                }
                plain.len += safe.count_ones() as usize;
                if plain.len + LANES > CHUNK {
                    evaluate::<L, P>(plain, group, part, lists, stats);
                }
            }
            let unsafe_ones = hit & !safe;
            if unsafe_ones != 0 {
                for index in 0..FIELDS {
                    careful.write(index, fields[index], unsafe_ones);
                }
                careful.write(10, inverse_square.mul(r), unsafe_ones);
                if let Some(table) = &group.table {
                    careful.write(PLACE, table.place(z), unsafe_ones);
                }
                for wall in 0..walls {
                    let (from, to) = (FIELDS + WALL_FIELDS * wall, 11 + WALL_FIELDS * wall);
                    let normal = [near.load::<L>(from, at), near.load(from + 1, at), near.load(from + 2, at)];
                    for axis in 0..3 {
                        careful.write(to + axis, dot_plus(&normal, &axes[axis], zero), unsafe_ones);
                    }
                    careful.write(to + 3, near.load::<L>(from + 3, at), unsafe_ones);
                }
                careful.len += unsafe_ones.count_ones() as usize;
                if careful.len + LANES > CHUNK {
                    evaluate_carefully::<L, P>(careful, walls, group, part, lists, stats);
                }
            }
        }
        evaluate::<L, P>(plain, group, part, lists, stats);
        evaluate_carefully::<L, P>(careful, walls, group, part, lists, stats);
    }
}

/// One ray vector, loaded.
#[derive(Clone, Copy)]
struct Rays<L> {
    offset: [L; 2],
    slope: [L; 2],
    bend: L,
}

impl Vector {
    #[inline(always)]
    fn load<L: Lanes>(&self) -> Rays<L> {
        Rays {
            offset: [L::load(&self.offset[0]), L::load(&self.offset[1])],
            slope: [L::load(&self.slope[0]), L::load(&self.slope[1])],
            bend: L::load(&self.bend),
        }
    }
}

/// A photon of a chunk, in every lane.
#[derive(Clone, Copy)]
struct Spread<L> {
    place: [L; 3],
    inverse_square: L,
    change: [L; 3],
    power: [L; 3],
}

impl Chunk {
    #[inline(always)]
    fn spread<L: Lanes>(&self, index: usize) -> Spread<L> {
        // Below CHUNK anyway; so the compiler knows.
        let index = index % CHUNK;
        let of = |field: usize| L::splat(self.fields[field].0[index]);
        Spread {
            place: [of(0), of(1), of(2)],
            inverse_square: of(3),
            change: [of(4), of(5), of(6)],
            power: [of(7), of(8), of(9)],
        }
    }

    /// Where a photon lies among the knots of a table, if there is one.
    #[inline(always)]
    fn place<const TABLE: usize>(&self, index: usize) -> f32 {
        if TABLE == 0 { 0.0 } else { self.fields[PLACE].0[index % CHUNK] }
    }
}

/// (1 + d)^{−3/2} to fourth order.
#[inline(always)]
fn series<L: Lanes>(d: L) -> L {
    let p = L::splat(2.460_937_5).mul_add(d, L::splat(-2.1875));
    let p = p.mul_add(d, L::splat(1.875));
    let p = p.mul_add(d, L::splat(-1.5));
    p.mul_add(d, L::splat(1.0))
}

impl<L: Lanes> Rays<L> {
    /// The photon's offset from the rays.
    #[inline(always)]
    fn aside<const PINHOLE: bool>(&self, photon: &Spread<L>) -> [L; 2] {
        let [a, b, z] = photon.place;
        if PINHOLE {
            [z.neg_mul_add(self.slope[0], a), z.neg_mul_add(self.slope[1], b)]
        } else {
            [z.neg_mul_add(self.slope[0], a.sub(self.offset[0])), z.neg_mul_add(self.slope[1], b.sub(self.offset[1]))]
        }
    }

    /// 1 − ρ²/r², 0 outside of the disc.
    #[inline(always)]
    fn inside(&self, aside: &[L; 2], photon: &Spread<L>) -> L {
        let square = aside[0].mul_add(aside[0], aside[1].mul(aside[1]));
        square.neg_mul_add(photon.inverse_square, L::splat(1.0)).max(L::splat(0.0))
    }

    /// [`Rays::inside`] with what it leaves out: of the offset, what lies along the ray.
    #[inline(always)]
    fn inside_closely(&self, aside: &[L; 2], photon: &Spread<L>) -> L {
        let along = aside[0].mul_add(self.slope[0], aside[1].mul(self.slope[1]));
        let square = aside[0].mul_add(aside[0], aside[1].mul(aside[1]));
        let square = along.neg_mul_add(along, square);
        square.neg_mul_add(photon.inverse_square, L::splat(1.0)).max(L::splat(0.0))
    }

    /// The kernel's shape times how phase function and transmittance vary.
    #[inline(always)]
    fn weight<P: Evaluate>(&self, q: L, photon: &Spread<L>) -> L {
        let [x, y, z] = photon.change;
        let d = x.mul_add(self.slope[0], y.mul_add(self.slope[1], z.mul(self.bend)));
        let varied = if P::EVEN { d.mul_add(L::splat(-1.5), L::splat(1.0)) } else { series(d) };
        q.mul(q).mul(varied)
    }
}

#[inline(always)]
fn accumulate<L: Lanes>(sums: &mut [L; 3], weight: L, photon: &Spread<L>) {
    for channel in 0..3 {
        sums[channel] = weight.mul_add(photon.power[channel], sums[channel]);
    }
}

/// The same of light that is attenuated on its way, as the group's table says that has so many channels; 0 for none.
#[inline(always)]
fn accumulate_passed<L: Lanes, const TABLE: usize>(
    sums: &mut [L; 3],
    weight: L,
    (group, vector, place): (&Group, usize, f32),
    photon: &Spread<L>,
) {
    match &group.table {
        Some(table) if TABLE == 1 => {
            let [passed] = table.at::<L, 1>(vector, place);
            accumulate(sums, weight.mul(passed), photon);
        }
        Some(table) if TABLE == 3 => {
            let passed = table.at::<L, 3>(vector, place);
            for channel in 0..3 {
                sums[channel] = weight.mul(passed[channel]).mul_add(photon.power[channel], sums[channel]);
            }
        }
        _ => accumulate(sums, weight, photon),
    }
}

#[inline(always)]
fn add_to_rows<L: Lanes>(rows: &mut [Row; 3], sums: &[L; 3]) {
    for channel in 0..3 {
        L::load(&rows[channel]).add(sums[channel]).store(&mut rows[channel]);
    }
}

/// Lists which photons of a chunk each vector may meet. Returns their numbers.
#[inline(always)]
fn list<L: Lanes>(chunk: &Chunk, group: &Group, lists: &mut [[u32; CHUNK_STRIDE]; VECTORS]) -> [usize; VECTORS] {
    let mut counts = [0; VECTORS];
    for (vector, list) in lists.iter_mut().enumerate().take(group.vectors()) {
        let around = group.near[vector].lanes::<L>();
        let mut count = 0;
        for at in (0..chunk.len).step_by(LANES) {
            let load = |field: usize| L::load_front(&chunk.fields[field].0[at..]);
            let hit = L::bits(around.meets(load(0), load(1), load(2), load(3).rsqrt()));
            let hit = hit & u16::MAX >> (LANES - (chunk.len - at).min(LANES));
            let mut indices = [at as u32; LANES];
            for (lane, index) in indices.iter_mut().enumerate() {
                *index += lane as u32;
            }
            if let Some(out) = list[count..].first_chunk_mut() {
                L::compress_indices(&indices, hit, out);
                count += hit.count_ones() as usize;
            }
        }
        counts[vector] = count;
    }
    counts
}

/// Adds what the photons of a chunk contribute, those that lie between the ends of all rays and near no wall.
#[inline(always)]
fn evaluate<L: Lanes, P: Evaluate>(
    chunk: &mut Chunk,
    group: &mut Group,
    part: usize,
    lists: &mut [[u32; CHUNK_STRIDE]; VECTORS],
    stats: &mut GatherStats,
) {
    if chunk.len == 0 {
        return;
    }
    let counts = list::<L>(chunk, group, lists);
    let listed: usize = counts.iter().sum();
    let dense = group.vectors() == VECTORS && listed as f32 >= SPARSE * (VECTORS * chunk.len) as f32;
    let channels = group.table.as_ref().map_or(0, |table| table.channels);
    let (tested, met) = match (dense, group.pinhole, channels) {
        (true, true, 0) if !group.wide => evaluate_dense::<L, P, true, false, 0>(chunk, group, part),
        (true, true, 1) if !group.wide => evaluate_dense::<L, P, true, false, 1>(chunk, group, part),
        (true, true, 0) => evaluate_dense::<L, P, true, true, 0>(chunk, group, part),
        (true, true, 1) => evaluate_dense::<L, P, true, true, 1>(chunk, group, part),
        (true, false, 0) => evaluate_dense::<L, P, false, true, 0>(chunk, group, part),
        (true, false, 1) => evaluate_dense::<L, P, false, true, 1>(chunk, group, part),
        (true, _, _) => evaluate_dense::<L, P, false, true, 3>(chunk, group, part),
        (false, true, 0) => evaluate_listed::<L, P, true, 0>(chunk, group, part, lists, &counts),
        (false, true, 1) => evaluate_listed::<L, P, true, 1>(chunk, group, part, lists, &counts),
        (false, false, 0) => evaluate_listed::<L, P, false, 0>(chunk, group, part, lists, &counts),
        (false, false, 1) => evaluate_listed::<L, P, false, 1>(chunk, group, part, lists, &counts),
        (false, _, _) => evaluate_listed::<L, P, false, 3>(chunk, group, part, lists, &counts),
    };
    stats.blocks += tested;
    stats.photons += met;
    chunk.len = 0;
}

#[inline(always)]
fn evaluate_dense<L: Lanes, P: Evaluate, const PINHOLE: bool, const CLOSELY: bool, const TABLE: usize>(
    chunk: &Chunk,
    group: &mut Group,
    part: usize,
) -> (u64, u64) {
    let mut met = 0;
    // Two vectors at a time: their sums and all that is needed for them fit into 32 registers.
    for pair in (0..VECTORS).step_by(2) {
        let rays = [group.rays[pair].load::<L>(), group.rays[pair + 1].load::<L>()];
        let mut sums = [[L::splat(0.0); 3]; 2];
        for index in 0..chunk.len {
            let photon = chunk.spread::<L>(index);
            for vector in 0..2 {
                let aside = rays[vector].aside::<PINHOLE>(&photon);
                let q = if CLOSELY {
                    rays[vector].inside_closely(&aside, &photon)
                } else {
                    rays[vector].inside(&aside, &photon)
                };
                let weight = rays[vector].weight::<P>(q, &photon);
                let passed = (&*group, pair + vector, chunk.place::<TABLE>(index));
                accumulate_passed::<L, TABLE>(&mut sums[vector], weight, passed, &photon);
                met += u64::from(L::bits(L::splat(0.0).less(q)).count_ones());
            }
        }
        for vector in 0..2 {
            add_to_rows(&mut group.sums[part][pair + vector], &sums[vector]);
        }
    }
    ((VECTORS * chunk.len) as u64, met)
}

#[inline(always)]
fn evaluate_listed<L: Lanes, P: Evaluate, const PINHOLE: bool, const TABLE: usize>(
    chunk: &Chunk,
    group: &mut Group,
    part: usize,
    lists: &[[u32; CHUNK_STRIDE]; VECTORS],
    counts: &[usize; VECTORS],
) -> (u64, u64) {
    let (mut tested, mut met) = (0, 0);
    for vector in 0..group.vectors() {
        let rays = group.rays[vector].load::<L>();
        let mut sums = [L::splat(0.0); 3];
        for &index in &lists[vector][..counts[vector]] {
            let photon = chunk.spread::<L>(index as usize);
            let aside = rays.aside::<PINHOLE>(&photon);
            let q = rays.inside_closely(&aside, &photon);
            let weight = rays.weight::<P>(q, &photon);
            let passed = (&*group, vector, chunk.place::<TABLE>(index as usize));
            accumulate_passed::<L, TABLE>(&mut sums, weight, passed, &photon);
            met += u64::from(L::bits(L::splat(0.0).less(q)).count_ones());
        }
        tested += counts[vector] as u64;
        add_to_rows(&mut group.sums[part][vector], &sums);
    }
    (tested, met)
}

/// The same for photons near walls or near an end of a ray.
#[inline(always)]
fn evaluate_carefully<L: Lanes, P: Evaluate>(
    chunk: &mut Chunk,
    walls: usize,
    group: &mut Group,
    part: usize,
    lists: &mut [[u32; CHUNK_STRIDE]; VECTORS],
    stats: &mut GatherStats,
) {
    if chunk.len == 0 {
        return;
    }
    let counts = list::<L>(chunk, group, lists);
    let zero = L::splat(0.0);
    let mut met = 0;
    for vector in 0..group.vectors() {
        let rays = group.rays[vector].load::<L>();
        let (start, end) = (L::load(&group.rays[vector].start), L::load(&group.rays[vector].end));
        let mut sums = [zero; 3];
        for &index in &lists[vector][..counts[vector]] {
            let photon = chunk.spread::<L>(index as usize);
            let aside = rays.aside::<false>(&photon);
            let q = rays.inside_closely(&aside, &photon);
            // The foot point lies nearer to where the ray leans.
            let foot = aside[0].mul_add(rays.slope[0], aside[1].mul_add(rays.slope[1], photon.place[2]));
            let mut mask = L::and(zero.less(q), L::and(start.less(foot), foot.less(end)));
            let mut weight = rays.weight::<P>(q, &photon);
            let index = index as usize % CHUNK;
            let of = |field: usize| L::splat(chunk.fields[field].0[index]);
            let inverse = of(10);
            for wall in (11..).step_by(WALL_FIELDS).take(walls) {
                // The normal across the ray; the foot point's height; the disc's distance from the wall.
                let lean = of(wall + 2);
                let x = lean.neg_mul_add(rays.slope[0], of(wall));
                let y = lean.neg_mul_add(rays.slope[1], of(wall + 1));
                let height = y.neg_mul_add(aside[1], x.neg_mul_add(aside[0], of(wall + 3)));
                let sin2 = x.mul_add(x, y.mul(y)).max(L::splat(f32::MIN_POSITIVE));
                let s = height.mul(inverse).mul(sin2.rsqrt());
                weight = weight.mul(inverse_biweight_share(s));
                mask = L::and(mask, zero.less(height));
            }
            let weight = weight.keep(mask);
            match group.table.as_ref().map(|table| table.channels) {
                None => accumulate(&mut sums, weight, &photon),
                Some(1) => {
                    let passed = (&*group, vector, chunk.place::<1>(index));
                    accumulate_passed::<L, 1>(&mut sums, weight, passed, &photon);
                }
                Some(_) => {
                    let passed = (&*group, vector, chunk.place::<3>(index));
                    accumulate_passed::<L, 3>(&mut sums, weight, passed, &photon);
                }
            }
            met += u64::from(L::bits(mask).count_ones());
        }
        stats.blocks += counts[vector] as u64;
        add_to_rows(&mut group.sums[part][vector], &sums);
    }
    stats.photons += met;
    chunk.len = 0;
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gather::StreamScratch;
    use crate::math::random::{Purpose, Stream};
    use crate::math::sampling;
    use crate::medium::density::bricks::{BrickGrid, NegativePolicy};
    use crate::medium::density::{Density, Grid};
    use crate::medium::phase::{Draine, HenyeyGreenstein, Isotropic, Mixture, Rayleigh, Schlick};
    use crate::photon::{MapSettings, Photon, Plane, Radius};
    use glam::DAffine3;
    use std::sync::Arc;

    /// Photons in the cube [−1, 1]³, denser towards its middle.
    fn photons(count: usize) -> Vec<Photon> {
        let mut stream = Stream::new(21, Purpose::Test, 0, 0);
        let mut coordinate = |i: usize| {
            let u = 2.0 * stream.uniform() - 1.0;
            if i.is_multiple_of(3) { u.powi(3) } else { u }
        };
        let positions: Vec<DVec3> =
            (0..count).map(|i| DVec3::new(coordinate(i), coordinate(i), coordinate(i))).collect();
        positions
            .into_iter()
            .map(|position| Photon {
                position: position.as_vec3(),
                direction: sampling::sphere(stream.uniform2()).as_vec3(),
                power: Vec3::new(stream.uniform() as f32, stream.uniform() as f32, 0.5),
                events: (4.0 * stream.uniform()) as u8,
            })
            .collect()
    }

    /// The cube's faces as walls.
    fn room(x: Vec3, r: f32, _: f32, planes: &mut SmallVec<[Plane; 3]>) {
        for axis in [Vec3::X, Vec3::Y, Vec3::Z] {
            for normal in [axis, -axis] {
                let distance = 1.0 + x.dot(normal);
                if distance < 2.0 * r {
                    planes.push(Plane { normal, distance, leans: false });
                }
            }
        }
    }

    /// Rays from a lens of this radius at `from` through 8 × 8 pixels, four each, each pixel `pixel` wide.
    fn rays(from: DVec3, lens: f64, pixel: f64, (a, b): (f64, f64)) -> Vec<(Ray, f64, f64)> {
        let mut stream = Stream::new(22, Purpose::Test, 0, 0);
        let frame = Frame::around((DVec3::new(0.1, -0.2, 0.05) - from).normalize());
        let distance = from.length();
        (0..256u32)
            .map(|i| {
                let code = i / 4;
                let half = |code: u32| f64::from(code & 1 | code >> 1 & 2 | code >> 2 & 4);
                let [u, v] = stream.uniform2();
                let (x, y) = (pixel * (half(code) + u), pixel * (half(code >> 1) + v));
                let (p, q) = sampling::disc(stream.uniform2());
                let start = from + lens * (p * frame.x + q * frame.y);
                let target = from + distance * (frame.z + x * frame.x + y * frame.y);
                let jitter = 0.01 * stream.uniform();
                (Ray::new(start, (target - start).normalize()), a + jitter, b - jitter)
            })
            .collect()
    }

    #[test]
    fn bundles_gather_what_their_rays_gather() {
        let lobes = [
            PhaseLanes::new(Isotropic),
            PhaseLanes::new(HenyeyGreenstein { g: 0.75 }),
            PhaseLanes::new(HenyeyGreenstein { g: -0.93 }),
            PhaseLanes::new(Schlick { k: 0.6 }),
            PhaseLanes::new(Rayleigh),
            PhaseLanes::new(Mixture::new(vec![
                (0.7, HenyeyGreenstein { g: 0.8 }.into()),
                (0.3, Schlick { k: -0.4 }.into()),
            ])),
            PhaseLanes::new(Mixture::new(vec![
                (0.55, HenyeyGreenstein { g: 0.97 }.into()),
                (0.45, Draine { g: -0.5, alpha: 17.0 }.into()),
            ])),
        ];
        let far = DVec3::new(3.0, 1.0, -4.0);
        let views = [
            ("outside", rays(far, 0.0, 0.003, (0.0, f64::INFINITY))),
            ("through a lens", rays(far, 0.05, 0.003, (0.0, f64::INFINITY))),
            ("from within", rays(DVec3::new(0.3, 0.2, -0.4), 0.0, 0.004, (0.1, 0.8))),
            ("from far away", rays(1e5 * far, 1e-3, 1e-8, (509_899.5, 509_904.0))),
            ("wide", rays(far, 0.0, 0.2, (0.0, f64::INFINITY))),
        ];
        let photons = photons(20_000);
        let variable = Radius::Variable { neighbours: 60, pilot: 8, max_radius: 0.3 };
        for (tagged, walled) in [(false, false), (true, true)] {
            let settings = MapSettings { tagged, ..MapSettings::new(variable) };
            let planes = |x: Vec3, r: f32, mean: f32, planes: &mut SmallVec<[Plane; 3]>| {
                if walled {
                    room(x, r, mean, planes);
                }
            };
            let map = PhotonMap::build(photons.clone(), &settings, &planes);
            let (mut scratch, mut gathered) = (BundleScratch::default(), Vec::new());
            let mut table = DepthTable::new();
            let (mut stream, mut streamed) = (StreamScratch::default(), Vec::<Gathered>::new());
            for (name, rays) in &views {
                for (number, phase) in lobes.iter().enumerate() {
                    let extinction = if number % 2 == 0 { Vec3::splat(0.7) } else { Vec3::new(0.2, 0.9, 2.0) };
                    let max_events = if tagged && number > 2 { 2 } else { u8::MAX };
                    let bundle = Bundle { rays, phase, extinction, max_events, pruned: false, depths: None };
                    let mut stats = GatherStats::default();
                    map.gather_bundle(&bundle, &mut scratch, &mut stats, &mut gathered);
                    assert_eq!(gathered.len(), rays.len());
                    let (mut seen, mut squares, mut largest) = (0.0, 0.0, 0.0f64);
                    for (index, bundled) in gathered.iter().enumerate() {
                        let single = bundle.gather_alone(&map, index, &mut table, &mut GatherStats::default());
                        for c in 0..3 {
                            seen += f64::from(single.total[c]).powi(2);
                            for (x, y) in [(single.total, bundled.total), (single.single, bundled.single)] {
                                let off = f64::from(x[c] - y[c]).abs();
                                squares += off.powi(2);
                                largest = largest.max(off / f64::from(single.total[c].max(f32::MIN_POSITIVE)));
                            }
                        }
                    }
                    assert!(seen > 0.0, "{name}, phase {number}: nothing seen");
                    let off = (squares / seen).sqrt();
                    map.gather_stream(&bundle, &mut stream, &mut GatherStats::default(), &mut streamed);
                    for (index, streamed) in streamed.iter().enumerate() {
                        let single = bundle.gather_alone(&map, index, &mut table, &mut GatherStats::default());
                        for c in 0..3 {
                            for (x, y) in [(single.total, streamed.total), (single.single, streamed.single)] {
                                assert!((x[c] - y[c]).abs() <= 2e-5 * single.total[c], "{name}: {x:?} {y:?}");
                            }
                        }
                    }
                    // Single rays may have a photon on their end, on one side of it here, on the other there.
                    assert!(
                        off < 3e-4 && largest < 4e-3,
                        "{name}, phase {number}, walls {walled}: {off:.1e} {largest:.1e}"
                    );
                }
            }
        }
    }

    /// Light that grows as it gets fainter on its way: much of it arrives from where roulette decides.
    #[test]
    fn pruned_rays_are_right_on_average() {
        let mut photons = photons(20_000);
        for photon in &mut photons {
            photon.power *= (9.0 * photon.position.z).exp();
        }
        let settings = MapSettings::new(Radius::Variable { neighbours: 60, pilot: 8, max_radius: 0.3 });
        let map = PhotonMap::build(photons, &settings, &|_: Vec3, _: f32, _: f32, _: &mut _| ());
        let phase = PhaseLanes::new(HenyeyGreenstein { g: 0.3 });
        let density = Density::Uniform;
        for extinction in [Vec3::splat(10.0), Vec3::new(12.0, 9.0, 10.0)] {
            // Each ray by itself, its number going through all.
            let query = BeamQuery {
                origin: DVec3::new(0.1, 0.2, -1.5),
                direction: DVec3::Z,
                length: 1.4,
                phase: &phase,
                extinction,
                depth: None,
                max_events: u8::MAX,
                pruning: None,
            };
            let (mut whole, mut short) = (GatherStats::default(), GatherStats::default());
            let expected = Vec3::from(map.gather(&query, &mut whole).total);
            let mut table = DepthTable::new();
            for knot in 0..=14 {
                let t = 0.1 * f64::from(knot);
                table.push(t, density.depth(&Ray::new(query.origin, query.direction), 0.0, t), 1.0);
            }
            table.finish();
            for depth in [None, Some(&table)] {
                let mut mean = DVec3::ZERO;
                for i in 0..1000 {
                    let query = BeamQuery { depth, pruning: Some((i as f32 + 0.5) * 1e-3), ..query };
                    mean += Vec3::from(map.gather(&query, &mut short).total).as_dvec3() * 1e-3;
                }
                let off = (mean / expected.as_dvec3() - 1.0).abs().max_element();
                assert!(off < 2e-3, "{mean} for {expected}");
            }
            assert!(short.photons < 1900 * whole.photons, "{} and {} photons", short.photons, whole.photons);

            // Bundles and streams, whose rays bring their numbers.
            let (mut scratch, mut streams) = (BundleScratch::default(), StreamScratch::default());
            let (mut gathered, mut streamed) = (Vec::new(), Vec::new());
            let mut stats = [GatherStats::default(); 3];
            let mut sums = [DVec3::ZERO; 3];
            for turn in 0..600 {
                let from = DVec3::new(0.1 + 1e-4 * f64::from(turn), 0.2, -1.5);
                let rays = rays(from, 0.0, 0.001, (0.02, 1.4));
                let bundle =
                    Bundle { rays: &rays, phase: &phase, extinction, max_events: u8::MAX, pruned: true, depths: None };
                map.gather_bundle(&bundle, &mut scratch, &mut stats[0], &mut gathered);
                map.gather_stream(&bundle, &mut streams, &mut stats[1], &mut streamed);
                let [bundles, streams, wholes] = &mut sums;
                *bundles += gathered.iter().map(|ray| Vec3::from(ray.total).as_dvec3()).sum::<DVec3>();
                *streams += streamed.iter().map(|ray| Vec3::from(ray.total).as_dvec3()).sum::<DVec3>();
                map.gather_bundle(&Bundle { pruned: false, ..bundle }, &mut scratch, &mut stats[2], &mut gathered);
                *wholes += gathered.iter().map(|ray| Vec3::from(ray.total).as_dvec3()).sum::<DVec3>();
            }
            // The weights 1/P of what is beyond vary by less than their mean; 2400 groups have a number each.
            for sum in &sums[..2] {
                let off = (*sum / sums[2] - 1.0).abs().max_element();
                assert!(off < 0.06, "{sum} for {}", sums[2]);
            }
            assert!(stats[0].photons < stats[2].photons && stats[1].photons < stats[2].photons);
        }
    }

    /// Uneven voxels on the cube and beyond.
    fn voxels() -> Density {
        let values: Vec<f32> = (0..24 * 24 * 24).map(|i| if i % 5 == 0 { 0.0 } else { (i % 7) as f32 * 0.5 }).collect();
        let bricks = BrickGrid::from_dense([-12; 3], [24; 3], &values, 0.0, NegativePolicy::Error).expect("finite");
        Density::Grid(Grid::new(Arc::new(bricks), DAffine3::from_scale(DVec3::splat(0.12))))
    }

    #[test]
    fn bundles_know_uneven_depths() {
        let density = voxels();
        let settings = MapSettings::new(Radius::Variable { neighbours: 60, pilot: 8, max_radius: 0.3 });
        let map = PhotonMap::build(photons(20_000), &settings, &|_: Vec3, _: f32, _: f32, _: &mut _| ());
        let phase = PhaseLanes::new(HenyeyGreenstein { g: 0.6 });
        let (mut scratch, mut gathered) = (BundleScratch::default(), Vec::new());
        let views = [
            ("narrow", rays(DVec3::new(3.0, 1.0, -4.0), 0.0, 0.003, (2.5, 8.0))),
            ("through a lens", rays(DVec3::new(3.0, 1.0, -4.0), 0.1, 0.003, (2.5, 8.0))),
            ("wide", rays(DVec3::new(3.0, 1.0, -4.0), 0.0, 0.1, (2.5, 8.0))),
        ];
        for (name, rays) in &views {
            for extinction in [Vec3::splat(0.9), Vec3::new(0.3, 1.0, 1.5)] {
                let mut depths = SampledDepths::default();
                let samples: Vec<Samples> = rays
                    .iter()
                    .map(|(ray, a, b)| depths.sample(&density, 0.04, ray, (*a, *b), 0.15).expect("few and small").0)
                    .collect();
                let depths = Some((&depths, 0.04, &*samples));
                let bundle = Bundle { rays, phase: &phase, extinction, max_events: u8::MAX, pruned: false, depths };
                map.gather_bundle(&bundle, &mut scratch, &mut GatherStats::default(), &mut gathered);
                let (mut seen, mut squares, mut sum) = (0.0, 0.0, 0.0);
                for ((ray, a, b), bundled) in rays.iter().zip(&gathered) {
                    // An independent table, of many exact knots.
                    let mut table = DepthTable::new();
                    for knot in 0..=600 {
                        let t = (b - a) * f64::from(knot) / 600.0;
                        table.push(t, density.depth(ray, *a, a + t), density.at(ray.at(a + t)));
                    }
                    table.finish();
                    let query = BeamQuery {
                        origin: ray.at(*a),
                        direction: ray.direction,
                        length: (b - a) as f32,
                        phase: &phase,
                        extinction,
                        depth: Some(&table),
                        max_events: u8::MAX,
                        pruning: None,
                    };
                    let single = map.gather(&query, &mut GatherStats::default());
                    for c in 0..3 {
                        let off = f64::from(bundled.total[c] - single.total[c]);
                        seen += f64::from(single.total[c]).powi(2);
                        squares += off.powi(2);
                        sum += off / f64::from(single.total[c].max(f32::MIN_POSITIVE));
                    }
                }
                let (off, bias) = ((squares / seen).sqrt(), sum / (3.0 * rays.len() as f64));
                assert!(off < 1.5e-3 && bias.abs() < 5e-4, "{name}, {extinction}: {off:.1e}, bias {bias:.1e}");
            }
        }
    }
}
