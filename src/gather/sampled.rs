//! Optical depth of rays that gather together, at evenly spaced places, so that a photon looks it up for
//! sixteen rays at once.

#![allow(
    clippy::needless_range_loop,
    reason = "iterators' closures need not be inlined into a kernel's instruction set"
)]

use std::ops::ControlFlow;

use super::depth::DepthTable;
use crate::math::Ray;
use crate::medium::density::{Density, Grid, Sum};
use crate::photon::simd::{Isa, LANES, Lanes, Row, Task};
use smallvec::SmallVec;

/// Vectors of rays in a group, at most.
pub(super) const VECTORS: usize = 4;

/// Rays that gather together from one table, at most.
pub(super) const GROUP: usize = VECTORS * LANES;

/// The density integrated along rays from the beginnings of their segments, at the multiples of one step of
/// the ray's parameter.
#[derive(Clone, Debug, Default)]
pub struct SampledDepths {
    values: Vec<f32>,
}

/// The samples of one ray.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Samples {
    /// The multiple of the step at which the first is.
    first: i64,
    start: u32,
    count: u32,
}

/// Samples of a ray, at most.
const MOST: f64 = 4096.0;

/// Multiples of a step are told apart, to a thousandth of it, up to this one; far beyond, one more is the same number.
const FARTHEST: f64 = (1u64 << 42) as f64;

/// Knots of a group's table, at most: to `f32`, a place among them is right to a thousandth of a step.
const MOST_KNOTS: f64 = 2.0 * MOST;

/// Whether a ray can have samples at these multiples of the step and all between.
pub(super) fn countable(first: f64, last: f64) -> bool {
    last - first <= MOST && first.abs() <= FARTHEST && last.abs() <= FARTHEST
}

impl SampledDepths {
    /// Forgets all rays.
    pub fn clear(&mut self) {
        self.values.clear();
    }

    /// Samples the density along a ray from `a` to `b`, which must be finite, every `step`. Returns the samples
    /// and the whole integral; `None` if it grows by more than `most` between two samples, or if they would be
    /// too many.
    pub fn sample(
        &mut self,
        density: &Density,
        step: f64,
        ray: &Ray,
        (a, b): (f64, f64),
        most: f64,
    ) -> Option<(Samples, f64)> {
        let (first, last) = ((a / step).floor(), (b / step).ceil());
        if !countable(first, last) {
            return None;
        }
        let start = self.values.len();
        self.values.push(0.0);
        let total = match density {
            Density::Grid(grid) => self.sample_grid(grid, step, ray, (a, b), first),
            Density::Sum(sum) => self.sample_sum(sum, step, ray, (a, b), first),
            Density::Uniform | Density::Exponential(_) => self.sample_closed(density, step, ray, (a, b), first),
        };
        // The last holds for all beyond.
        self.values.push(total as f32);
        let values = &self.values[start..];
        let steep = |pair: &[f32]| f64::from(pair[1] - pair[0]) > most;
        if !(total as f32).is_finite() || values.windows(2).any(steep) {
            self.values.truncate(start);
            return None;
        }
        Some((Samples { first: first as i64, start: start as u32, count: values.len() as u32 }, total))
    }

    /// The values of a ray's samples.
    pub(super) fn values(&self, samples: Samples) -> &[f32] {
        &self.values[samples.start as usize..][..samples.count as usize]
    }

    /// Of a ray's segment from `a` to `b`, the part without what is empty at its ends, but for two steps of it: the density found
    /// between samples is then the same. Its samples, and where it begins and ends; `None` if all is empty.
    pub(super) fn occupied(&self, samples: Samples, step: f64, (a, b): (f64, f64)) -> Option<(Samples, (f64, f64))> {
        const MARGIN: usize = 2;
        let values = self.values(samples);
        let total = *values.last()?;
        let before = values.partition_point(|&value| value <= 0.0).saturating_sub(1 + MARGIN);
        let last = values.partition_point(|&value| value < total) + MARGIN;
        if total <= 0.0 {
            return None;
        }
        let at = |index: usize| (samples.first + index as i64) as f64 * step;
        let range = (if before > 0 { at(before) } else { a }, if last + 1 < values.len() { at(last) } else { b });
        let count = (last + 1).min(values.len()) - before;
        let first = samples.first + before as i64;
        Some((Samples { first, start: samples.start + before as u32, count: count as u32 }, range))
    }

    /// Adds a ray: nothing at the multiple `first` of the step, then `inner`, then `total` for all beyond.
    pub(super) fn insert(&mut self, first: i64, inner: impl Iterator<Item = f32>, total: f32) -> Samples {
        let start = self.values.len();
        self.values.push(0.0);
        self.values.extend(inner);
        self.values.push(total);
        Samples { first, start: start as u32, count: (self.values.len() - start) as u32 }
    }

    /// The sampled depths of a ray, whose segment is from `a` to `b`, as a table of lengths from `a`, for a query of its own.
    pub(super) fn tabulate(&self, samples: Samples, step: f64, (a, b): (f64, f64), table: &mut DepthTable) {
        let values = Values::new(self, samples, step, (a, b));
        let [starts, stops] = values.ends;
        let last = values.values.len() as i64 - 1;
        table.clear();
        for index in 0..=last {
            // What is sampled of a segment's first and last step is only a part of it.
            let t = match index {
                0 if starts => 0.0,
                _ if index == last && stops => b - a,
                _ => (samples.first + index) as f64 * step - a,
            };
            table.push(t, f64::from(values.at(index)), f64::from(values.growth(index)) / (2.0 * step));
        }
        table.finish();
    }

    fn sample_closed(&mut self, density: &Density, step: f64, ray: &Ray, (a, b): (f64, f64), first: f64) -> f64 {
        let mut next = first + 1.0;
        while next * step < b {
            self.values.push(density.depth(ray, a, next * step) as f32);
            next += 1.0;
        }
        density.depth(ray, a, b)
    }

    /// Samples each part behind the others, and adds them up.
    fn sample_sum(&mut self, sum: &Sum, step: f64, ray: &Ray, (a, b): (f64, f64), first: f64) -> f64 {
        let start = self.values.len();
        let last = (b / step).ceil();
        let count = ((last - first) as usize).saturating_sub(1);
        self.values.resize(start + count, 0.0);
        let mut whole = 0.0;
        for part in sum.parts() {
            let total = match &part.density {
                Density::Grid(grid) => self.sample_grid(grid, step, ray, (a, b), first),
                density => self.sample_closed(density, step, ray, (a, b), first),
            };
            // Where voxels are clipped away, nothing is added.
            self.values.resize(start + 2 * count, total as f32);
            let (sums, own) = self.values[start..].split_at_mut(count);
            for (sum, own) in sums.iter_mut().zip(own) {
                *sum += part.weight as f32 * *own;
            }
            self.values.truncate(start + count);
            whole += part.weight * total;
        }
        whole
    }

    fn sample_grid(&mut self, grid: &Grid, step: f64, ray: &Ray, (a, b): (f64, f64), first: f64) -> f64 {
        let Self { values } = self;
        let mut next = first + 1.0;
        let mut depth = 0.0;
        grid.cells(ray, a, b, |cell| {
            if !cell.tb.is_finite() {
                return ControlFlow::Break(());
            }
            let (width, inside) = (cell.tb - cell.ta, cell.integral());
            if next * step < cell.tb {
                // The parabola through start, middle and end, integrated.
                let (start, middle, end) = (f64::from(cell.rho_a), f64::from(cell.rho_mid), f64::from(cell.rho_b));
                let slope = 2.0 * middle - 1.5 * start - 0.5 * end;
                let bend = (2.0 / 3.0) * (start + end - 2.0 * middle);
                let inverse = width.recip();
                while next * step < cell.tb {
                    let x = ((next * step - cell.ta) * inverse).max(0.0);
                    let part = width * x * (start + x * (slope + x * bend));
                    values.push((depth + part.max(0.0).min(inside)) as f32);
                    next += 1.0;
                }
            }
            depth += inside;
            ControlFlow::Continue(())
        });
        depth
    }
}

/// The samples of a ray.
struct Values<'a> {
    values: &'a [f32],
    /// Whether its segment begins on the first step, and ends on the last: of these, only a part is sampled.
    ends: [bool; 2],
    /// The steps that are sampled.
    steps: f64,
}

impl<'a> Values<'a> {
    /// Of a ray whose segment is from `a` to `b`.
    fn new(depths: &'a SampledDepths, samples: Samples, step: f64, (a, b): (f64, f64)) -> Self {
        let values = depths.values(samples);
        let last = values.len() as i64 - 1;
        let ends = [(a / step).floor() == samples.first as f64, (b / step).ceil() == (samples.first + last) as f64];
        let steps = if ends == [true; 2] { ((b - a) / step).max(1e-6) } else { last as f64 };
        Values { values, ends, steps }
    }

    /// The depth at a sample; beyond, that of the first or the last.
    fn at(&self, index: i64) -> f32 {
        self.values[index.clamp(0, self.values.len() as i64 - 1) as usize]
    }

    /// By how much the depth grows from the sample before this to the one after it; around steps that are cut, twice by as much as
    /// on the nearest whole one.
    fn growth(&self, index: i64) -> f32 {
        let last = self.values.len() as i64 - 1;
        let (first_whole, last_whole) = (i64::from(self.ends[0]), last - i64::from(self.ends[1]));
        if first_whole < last_whole {
            let step = |index: i64| {
                let before = if self.ends[0] { index.max(first_whole) } else { index };
                let before = if self.ends[1] { before.min(last_whole - 1) } else { before };
                self.at(before + 1) - self.at(before)
            };
            step(index - 1) + step(index)
        } else {
            // Too short to tell more than its mean.
            2.0 * (self.at(last) - self.at(0)) / self.steps as f32
        }
    }
}

/// A ray of a group: its samples, where in the group's frame its parameter is 0, and from where to where its segment is.
pub(super) struct Sampled {
    pub samples: Samples,
    pub origin: f64,
    pub range: (f64, f64),
}

/// Transmittance of up to four vectors of rays, at evenly spaced z, by channel; linear between.
#[derive(Clone, Debug, Default)]
pub(super) struct TransmittanceTable {
    rows: Vec<Row>,
    /// One if transmittance is the same in all three.
    pub(super) channels: usize,
    /// Rows of a vector, over the channels.
    knots: usize,
    start: f32,
    per_step: f32,
}

impl TransmittanceTable {
    /// Of rays that begin at z = `start` or after, sampled every `step`; `exponents` are −σ log₂e. One row a knot if
    /// they are equal. Times the density with `fluence`. What it was of is forgotten, and its memory used. `None` if that takes too many knots.
    pub(super) fn set(
        &mut self,
        depths: &SampledDepths,
        step: f64,
        rays: impl Iterator<Item = Sampled>,
        start: f64,
        (exponents, fluence): ([f32; 3], bool),
        isa: Isa,
    ) -> Option<()> {
        let mut knots = 2.0f64;
        let along = |ray: Sampled| {
            // Where knot 0 falls among the ray's own samples.
            let offset = (start - ray.origin) / step - ray.samples.first as f64;
            // The last two lie where the depths of all rays are whole.
            let enough = (f64::from(ray.samples.count) - offset).ceil() + 1.0;
            knots = knots.max(if offset <= FARTHEST { enough } else { f64::INFINITY });
            let values = Values::new(depths, ray.samples, step, ray.range);
            Along { values, whole: offset.floor() as i64, part: (offset - offset.floor()) as f32 }
        };
        let rays: SmallVec<[Along<'_>; GROUP]> = rays.map(along).collect();
        if knots > MOST_KNOTS {
            return None;
        }
        let knots = knots as usize;
        let grey = exponents[0] == exponents[1] && exponents[0] == exponents[2];
        self.channels = if grey { 1 } else { 3 };
        self.knots = knots;
        (self.start, self.per_step) = (start as f32, (1.0 / step) as f32);
        self.rows.resize(rays.len().div_ceil(LANES) * knots * self.channels, Row([0.0; LANES]));
        let per_sample = fluence.then(|| (0.5 / step) as f32);
        isa.run(Fill { table: self, rays: &rays, exponents, per_sample });
        Some(())
    }

    /// Where a photon's `z` lies among the knots: from 0 to that of the last but one, beyond which nothing changes. There
    /// is always another knot behind a place, and the number is a whole one that `f32` holds.
    #[inline(always)]
    pub(super) fn place<L: Lanes>(&self, z: L) -> L {
        let last = L::splat((self.knots - 2) as f32);
        z.sub(L::splat(self.start)).mul(L::splat(self.per_step)).max(L::splat(0.0)).min(last)
    }

    /// The transmittance to a place for the rays of a vector, of its one channel or its three.
    #[inline(always)]
    pub(super) fn at<L: Lanes, const CHANNELS: usize>(&self, vector: usize, place: f32) -> [L; CHANNELS] {
        let knot = place as usize;
        let part = L::splat(place - knot as f32);
        let first = (vector * self.knots + knot) * CHANNELS;
        let mut passed = [part; CHANNELS];
        for channel in 0..CHANNELS {
            passed[channel] = self.between(first + channel, CHANNELS, part);
        }
        passed
    }

    #[inline(always)]
    fn between<L: Lanes>(&self, row: usize, stride: usize, part: L) -> L {
        let (before, after) = (L::load(&self.rows[row]), L::load(&self.rows[row + stride]));
        after.sub(before).mul_add(part, before)
    }
}

/// The depths of a ray, and where among them knot 0 of a table falls: so many samples and a part of one later.
struct Along<'a> {
    values: Values<'a>,
    whole: i64,
    part: f32,
}

impl Along<'_> {
    /// The depths at as many knots as there are lanes, from this one on.
    #[inline(always)]
    fn at<L: Lanes>(&self, knot: i64) -> L {
        let first = self.whole + knot;
        let values = self.values.values;
        let [before, after] = match usize::try_from(first).ok().and_then(|first| values.get(first..)) {
            Some(values) if values.len() > LANES => [L::load_front(values), L::load_front(&values[1..])],
            _ => {
                let mut rows = [Row([0.0; LANES]); 2];
                for (later, row) in rows.iter_mut().enumerate() {
                    for (lane, value) in row.0.iter_mut().enumerate() {
                        *value = self.values.at(first + (later + lane) as i64);
                    }
                }
                [L::load(&rows[0]), L::load(&rows[1])]
            }
        };
        after.sub(before).mul_add(L::splat(self.part), before)
    }

    /// By how much the depth grows over the two steps around each of as many knots.
    #[inline(always)]
    fn growth<L: Lanes>(&self, knot: i64) -> L {
        const MORE: i64 = LANES as i64 + 3;
        let first = self.whole + knot;
        if 2 <= first && first + MORE <= self.values.values.len() as i64 {
            return self.at::<L>(knot + 1).sub(self.at(knot - 1));
        }
        let mut rows = [Row([0.0; LANES]); 2];
        for (later, row) in rows.iter_mut().enumerate() {
            for (lane, value) in row.0.iter_mut().enumerate() {
                *value = self.values.growth(first + (later + lane) as i64);
            }
        }
        let [before, after] = [L::load(&rows[0]), L::load(&rows[1])];
        after.sub(before).mul_add(L::splat(self.part), before)
    }
}

/// Fills a table, some knots of a vector of rays at a time.
struct Fill<'a> {
    table: &'a mut TransmittanceTable,
    rays: &'a [Along<'a>],
    exponents: [f32; 3],
    /// Half of the knots in a length, if transmittance is to be multiplied by the density.
    per_sample: Option<f32>,
}

impl Task for Fill<'_> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self) {
        let Fill { table, rays, exponents, per_sample } = self;
        let TransmittanceTable { rows, channels, knots, .. } = table;
        for (rays, rows) in rays.chunks(LANES).zip(rows.chunks_exact_mut(*knots * *channels)) {
            let [mut by_ray, mut densities] = [[Row([0.0; LANES]); LANES]; 2];
            for (first, rows) in (0i64..).step_by(LANES).zip(rows.chunks_mut(LANES * *channels)) {
                for (ray, depths) in rays.iter().zip(&mut by_ray) {
                    ray.at::<L>(first).store(depths);
                }
                if let Some(per_sample) = per_sample {
                    for (ray, densities) in rays.iter().zip(&mut densities) {
                        ray.growth::<L>(first).mul(L::splat(per_sample)).store(densities);
                    }
                }
                for (knot, rows) in rows.chunks_exact_mut(*channels).enumerate() {
                    let mut depths = Row([0.0; LANES]);
                    for lane in 0..LANES {
                        depths.0[lane] = by_ray[lane].0[knot];
                    }
                    let depths = L::load(&depths);
                    let mut density = L::splat(1.0);
                    if per_sample.is_some() {
                        let mut row = Row([0.0; LANES]);
                        for lane in 0..LANES {
                            row.0[lane] = densities[lane].0[knot];
                        }
                        density = L::load(&row);
                    }
                    for (row, exponent) in rows.iter_mut().zip(exponents) {
                        depths.mul(L::splat(exponent)).exp2().mul(density).store(row);
                    }
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Without what is empty at its ends, a ray's depths and densities are the same wherever they are asked for.
    #[test]
    fn nothing_is_lost_with_what_is_empty() {
        let step = 0.25;
        let mut depths = SampledDepths::default();
        for (empty, full, rest) in [(9, 5, 7), (0, 6, 9), (8, 4, 0), (2, 3, 2), (3, 1, 3), (1, 0, 1)] {
            let steps = empty + full + rest;
            let (a, b) = (-7.1 * step, (f64::from(steps) - 7.4) * step);
            let depth = |index: i32| (index - empty).clamp(0, full) as f32;
            let samples = depths.insert(-8, (1..=steps - 1).map(depth), depth(steps));
            let Some((part, range)) = depths.occupied(samples, step, (a, b)) else {
                assert_eq!(full, 0);
                continue;
            };
            assert!(part.count <= samples.count && range.0 >= a && range.1 <= b);
            assert!(part.count as i32 <= full + 5, "{} steps for {full}", part.count);
            let before = part.first - samples.first;
            let whole = Values::new(&depths, samples, step, (a, b));
            let part = Values::new(&depths, part, step, range);
            for index in 0..=i64::from(steps) {
                assert_eq!(part.at(index - before), whole.at(index));
                assert_eq!(part.growth(index - before), whole.growth(index), "{empty}, {full}, {rest}: {index}");
            }
        }
    }
}
