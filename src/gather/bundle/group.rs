//! Groups of a bundle's rays, each in a frame of its own.

#![allow(
    clippy::needless_range_loop,
    reason = "iterators' closures need not be inlined into a kernel's instruction set"
)]

use super::lines::{Around, Line, Lines, Towards, around, bound, offsets, rows};
use super::rays::Bundle;
use crate::gather::beam::{Pruning, exponents};
use crate::gather::sampled::{GROUP, Sampled, TransmittanceTable, VECTORS};
use crate::math::DVec3;
use crate::photon::discs::PhotonMap;
use crate::photon::simd::{LANES, Lanes, Row, Task};

/// Rays of a group may deviate from its axis by this slope: errors are of the order of its square.
const MAX_SLOPE: f64 = 0.02;

/// Where rays deviate by less and many photons are met, rims of discs are not off by a thousandth of a pixel.
const WIDE_SLOPE: f64 = 0.0115;

/// The variable d of a group may reach this, where its series is right to 10⁻⁴.
const MAX_VARIATION: f64 = 0.15;

/// Optical depth by which the starts of a group's rays may differ.
const MAX_DEPTH_APART: f64 = 10.0;

/// [`Pruning`] of a group, by the transmittance since the last start of its rays.
#[derive(Clone, Copy, Debug)]
pub(super) struct Pruned {
    /// The greatest z of photons that count.
    pub(super) end: f32,
    /// Photons count 2^max(0, offset + slope·z) times.
    pub(super) lift: [f32; 2],
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
pub(super) struct Group {
    /// Its rays in the bundle.
    pub(super) first: usize,
    pub(super) count: usize,
    pub(super) axes: [[f32; 3]; 3],
    pub(super) offset: [f32; 3],
    /// Offsets p, slopes s and −s²/2 of the rays; lanes without a ray have those of another.
    pub(super) rays: [Vector; VECTORS],
    /// Everything within |x|, |y| ≤ spread + slope·|z|, for all rays and for each vector around its own axis.
    pub(super) around: Around,
    pub(super) near: [Around; VECTORS],
    pub(super) towards: Towards,
    pub(super) axis: DVec3,
    /// Where on a ray photons may count last, and the greatest z of such a place.
    pub(super) farthest: f64,
    pub(super) last: f64,
    /// The first and last z of any ray, and of all rays.
    pub(super) any: [f32; 2],
    pub(super) all: [f32; 2],
    /// Where transmittance is counted from.
    pub(super) zero: f32,
    pub(super) pruned: Pruned,
    /// What remains to be multiplied, by ray.
    pub(super) factor: [[f64; 3]; GROUP],
    /// Sums, by vector and channel: of photons without events, and of the others.
    pub(super) sums: [[[Row; 3]; VECTORS]; 2],
    pub(super) pinhole: bool,
    /// Whether s² matters where many photons are met.
    pub(super) wide: bool,
    /// Transmittance, where it is no exponential of z.
    pub(super) table: Option<TransmittanceTable>,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Vector {
    pub(super) offset: [Row; 2],
    pub(super) slope: [Row; 2],
    pub(super) bend: Row,
    pub(super) start: Row,
    pub(super) end: Row,
}

impl Vector {
    const EMPTY: Vector = {
        let row = Row([0.0; LANES]);
        Vector { offset: [row; 2], slope: [row; 2], bend: row, start: row, end: row }
    };
}

/// [`Group::set`] as a kernel.
pub(super) struct Arrange<'a> {
    pub(super) group: &'a mut Group,
    pub(super) map: &'a PhotonMap,
    pub(super) bundle: &'a Bundle<'a>,
    pub(super) first: usize,
    pub(super) count: usize,
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
    pub(super) const EMPTY: Group = Group {
        first: 0,
        count: 0,
        axes: [[0.0; 3]; 3],
        offset: [0.0; 3],
        rays: [Vector::EMPTY; VECTORS],
        around: Around::AXIS,
        near: [Around::AXIS; VECTORS],
        towards: Towards::NOWHERE,
        axis: DVec3::Z,
        farthest: 0.0,
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
        (self.farthest, self.last) = (f64::INFINITY, last_end);
        if self.pruned.end.is_finite() {
            // A photon before the end may have its foot point beyond it.
            let end = f64::from(self.pruned.end) + 2.0 * MAX_SLOPE * widest;
            self.last = last_end.min(end);
            let mut farthest = f64::NEG_INFINITY;
            for i in 0..count {
                farthest = farthest.max((end - lines.origin[i]) * (1.0 + lines.square[i]).sqrt());
            }
            self.farthest = farthest;
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
                let sampled = rays
                    .iter()
                    .zip(&samples[first..])
                    .zip(lines.origin)
                    .map(|((&(_, a, b), &samples), origin)| Sampled { samples, origin, range: (a, b) });
                table.set(depths, step, sampled, zero, (exponents(bundle.extinction), map.fluence), map.isa)?;
                Some(table)
            }
        };
        Some(())
    }

    pub(super) fn vectors(&self) -> usize {
        self.count.div_ceil(LANES)
    }
}
