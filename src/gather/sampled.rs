//! Optical depth of rays that gather together, at evenly spaced places, so that a photon looks it up for
//! sixteen rays at once.

use std::ops::ControlFlow;

use super::depth::DepthTable;
use crate::math::Ray;
use crate::medium::density::{Density, Grid};
use crate::photon::simd::{Isa, LANES, Lanes, Row, Task};

/// The density integrated along rays from the beginnings of their stretches, at the multiples of one step of
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
pub(super) const MOST: f64 = 4096.0;

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
        if (last - first).is_nan() || last - first > MOST {
            return None;
        }
        let start = self.values.len();
        self.values.push(0.0);
        let total = match density {
            Density::Grid(grid) => self.sample_grid(grid, step, ray, (a, b), first),
            _ => {
                let mut next = first + 1.0;
                while next * step < b {
                    self.values.push(density.depth(ray, a, next * step) as f32);
                    next += 1.0;
                }
                density.depth(ray, a, b)
            }
        };
        // The last holds for all beyond.
        self.values.push(total as f32);
        let values = &self.values[start..];
        if values.windows(2).any(|pair| f64::from(pair[1] - pair[0]) > most) {
            self.values.truncate(start);
            return None;
        }
        Some((Samples { first: first as i64, start: start as u32, count: values.len() as u32 }, total))
    }

    /// The values of a ray's samples.
    pub(super) fn values(&self, samples: Samples) -> &[f32] {
        &self.values[samples.start as usize..][..samples.count as usize]
    }

    /// Adds a ray: nothing at the multiple `first` of the step, then `inner`, then `total` for all beyond.
    pub(super) fn insert(&mut self, first: i64, inner: impl Iterator<Item = f32>, total: f32) -> Samples {
        let start = self.values.len();
        self.values.push(0.0);
        self.values.extend(inner);
        self.values.push(total);
        Samples { first, start: start as u32, count: (self.values.len() - start) as u32 }
    }

    /// The same depths as a table of lengths from the ray's parameter `a`, for a query of its own.
    pub(super) fn tabulate(&self, samples: Samples, step: f64, a: f64, table: &mut DepthTable) {
        let values = self.values(samples);
        let value = |index: usize| f64::from(values[index.min(values.len() - 1)]);
        table.clear();
        for index in 0..values.len() {
            let t = (samples.first + index as i64) as f64 * step - a;
            let before = index.saturating_sub(1);
            let slope = (value(index + 1) - value(before)) / ((index + 1 - before) as f64 * step);
            table.push(t, value(index), slope);
        }
        table.finish();
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
            let (start, middle, end) = (f64::from(cell.rho_a), f64::from(cell.rho_mid), f64::from(cell.rho_b));
            while next * step < cell.tb {
                // The parabola through start, middle and end, integrated.
                let x = ((next * step - cell.ta) / width).max(0.0);
                let bent = start + end - 2.0 * middle;
                let part = width * x * (start + x * (2.0 * middle - 1.5 * start - 0.5 * end + x * (2.0 / 3.0) * bent));
                values.push((depth + part.clamp(0.0, inside)) as f32);
                next += 1.0;
            }
            depth += inside;
            ControlFlow::Continue(())
        });
        depth
    }
}

/// A ray of a group: its samples, and where in the group's frame its parameter is 0.
pub(super) struct Sampled {
    pub samples: Samples,
    pub origin: f64,
}

/// Transmittance of up to four vectors of rays, at evenly spaced z, by channel; linear between.
#[derive(Clone, Debug, Default)]
pub(super) struct TransmittanceTable {
    rows: Vec<Row>,
    channels: usize,
    /// Rows of a vector, over the channels.
    knots: usize,
    start: f32,
    per_step: f32,
}

impl TransmittanceTable {
    /// For rays that begin at z = `start` or after, sampled every `step`; `exponents` are −σ log₂e. One row a knot if they are equal.
    pub(super) fn new(
        depths: &SampledDepths,
        step: f64,
        rays: impl Iterator<Item = Sampled> + Clone,
        start: f64,
        exponents: [f32; 3],
        isa: Isa,
    ) -> Self {
        let grey = exponents[0] == exponents[1] && exponents[0] == exponents[2];
        let channels = if grey { 1 } else { 3 };
        // Where knot 0 falls among a ray's own samples.
        let offset = |ray: &Sampled| (start - ray.origin) / step - ray.samples.first as f64;
        let mut knots = 2;
        let mut vectors = 0;
        for (index, ray) in rays.clone().enumerate() {
            knots = knots.max((f64::from(ray.samples.count) - offset(&ray)).ceil() as usize + 1);
            vectors = index / LANES + 1;
        }
        let mut table = TransmittanceTable {
            rows: vec![Row([0.0; LANES]); vectors * knots * channels],
            channels,
            knots,
            start: start as f32,
            per_step: (1.0 / step) as f32,
        };
        for (index, ray) in rays.enumerate() {
            let samples = depths.values(ray.samples);
            let (Some(first), Some(last)) = (samples.first(), samples.last()) else { continue };
            let offset = offset(&ray);
            let (whole, part) = (offset.floor(), (offset - offset.floor()) as f32);
            let vector = &mut table.rows[index / LANES * knots * channels..][..knots * channels];
            let at = |place: i64| {
                if place < 0 { *first } else { *samples.get(place as usize).unwrap_or(last) }
            };
            let mut before = at(whole as i64);
            for (knot, rows) in vector.chunks_exact_mut(channels).enumerate() {
                let after = at(whole as i64 + knot as i64 + 1);
                rows[0].0[index % LANES] = before + part * (after - before);
                before = after;
            }
        }
        isa.run(Pass { table: &mut table, exponents });
        table
    }

    /// Where a photon's `z` lies among the knots.
    #[inline(always)]
    pub(super) fn place<L: Lanes>(&self, z: L) -> L {
        let last = L::splat((self.knots - 2) as f32 + 0.999_9);
        z.sub(L::splat(self.start)).mul(L::splat(self.per_step)).max(L::splat(0.0)).min(last)
    }

    /// The transmittance to a place for the rays of a vector, by channel.
    #[inline(always)]
    pub(super) fn at<L: Lanes>(&self, vector: usize, place: f32) -> [L; 3] {
        let knot = place as usize;
        let part = L::splat(place - knot as f32);
        let first = (vector * self.knots + knot) * self.channels;
        if self.channels == 1 {
            [self.between(first, 1, part); 3]
        } else {
            [self.between(first, 3, part), self.between(first + 1, 3, part), self.between(first + 2, 3, part)]
        }
    }

    #[inline(always)]
    fn between<L: Lanes>(&self, row: usize, stride: usize, part: L) -> L {
        let (before, after) = (L::load(&self.rows[row]), L::load(&self.rows[row + stride]));
        after.sub(before).mul_add(part, before)
    }
}

/// Turns depths into transmittance.
struct Pass<'a> {
    table: &'a mut TransmittanceTable,
    exponents: [f32; 3],
}

impl Task for Pass<'_> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self) {
        let Pass { table, exponents } = self;
        for rows in table.rows.chunks_exact_mut(table.channels) {
            let depth = L::load(&rows[0]);
            for (row, exponent) in rows.iter_mut().zip(exponents) {
                depth.mul(L::splat(exponent)).exp2().store(row);
            }
        }
    }
}
