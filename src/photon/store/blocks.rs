//! Photons in blocks of sixteen, field by field.

use super::Photon;
use super::order::{events_of, pieces};
use crate::photon::simd::{LANES, Row, prefetch_at};
use rayon::prelude::*;

/// Sixteen photons. Lanes without one lie at infinity and have no power.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Block<'a> {
    pub position: &'a [Row; 3],
    pub direction: &'a [Row; 3],
    /// K₂(0) · power/r².
    pub power: &'a [Row; 3],
    /// 1/r².
    pub inverse_square: &'a Row,
}

/// Blocks of photons, the rows of each next to one another. A radius that all share is stored once.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Blocks {
    /// 1/r² in front of each block, or of all; then position, direction and power of its photons.
    rows: Vec<Row>,
    /// How many blocks there are.
    count: usize,
    /// Rows from block to block.
    stride: usize,
    /// What counts of the place of a block's 1/r²: all of it, or nothing, which leaves the first row of all.
    mask: usize,
}

/// Rows of a block besides 1/r².
const ROWS: usize = 9;

impl Blocks {
    /// Takes photons in order, their powers multiplied by `gain`; and their events, if `tagged`. Without an
    /// `inverse_square` of all, room is left for that of each.
    pub(crate) fn new(
        photons: Vec<Photon>,
        inverse_square: Option<f32>,
        gain: f32,
        tagged: bool,
    ) -> (Self, Vec<[u8; LANES]>) {
        let count = photons.len().div_ceil(LANES);
        let stride = ROWS + usize::from(inverse_square.is_none());
        let own = stride - ROWS;
        let mut rows = Vec::with_capacity(1 + count * stride);
        let mut events = Vec::with_capacity(if tagged { count } else { 0 });
        rows.extend(inverse_square.map(|x| Row([x; LANES])));
        for photons in pieces(photons) {
            let from = rows.len();
            rows.resize(from + photons.len().div_ceil(LANES) * stride, Row([0.0; LANES]));
            let fill = |(rows, photons): (&mut [Row], &[Photon])| {
                let rows = &mut rows[own..];
                rows[..3].fill(Row([f32::INFINITY; LANES]));
                for (lane, photon) in photons.iter().enumerate() {
                    for axis in 0..3 {
                        rows[axis].0[lane] = photon.position[axis];
                        rows[3 + axis].0[lane] = photon.direction[axis];
                        rows[6 + axis].0[lane] = gain * photon.power[axis];
                    }
                }
            };
            rows[from..].par_chunks_mut(stride).zip(photons.par_chunks(LANES)).for_each(fill);
            if tagged {
                events.par_extend(events_of(&photons));
            }
        }
        (Blocks { rows, count, stride, mask: own.wrapping_neg() }, events)
    }

    /// Gives each photon its own 1/r², and multiplies its power by that and by `gain`.
    pub(crate) fn spread(&mut self, photons: usize, radii: &[f32], gain: f32) {
        let blocks = self.rows.par_chunks_mut(self.stride).zip(radii.par_chunks(LANES));
        blocks.enumerate().for_each(|(index, (rows, radii))| {
            rows[0] = Row([f32::INFINITY; LANES]);
            for (lane, &r) in radii[..photons_in(index, photons)].iter().enumerate() {
                rows[0].0[lane] = 1.0 / (r * r);
                for power in &mut rows[1 + 6..] {
                    power.0[lane] *= gain / (r * r);
                }
            }
        });
    }

    /// How many there are.
    #[inline(always)]
    pub(crate) fn len(&self) -> usize {
        self.count
    }

    /// Block `index`.
    #[inline(always)]
    pub(crate) fn get(&self, index: usize) -> Block<'_> {
        assert!(index < self.count, "no such block");
        let at = index * self.stride;
        // SAFETY: block `count` − 1 ends with `rows`, and so this one does not end behind it: its 1/r² lies in front of
        // its rows, or in front of all. Two checks instead of one would cost 3 % of a query.
        let (rows, inverse_square) =
            unsafe { (self.rows.get_unchecked(at + 1..at + 1 + ROWS), self.rows.get_unchecked(at & self.mask)) };
        let (triples, _) = rows.as_chunks::<3>();
        Block { position: &triples[0], direction: &triples[1], power: &triples[2], inverse_square }
    }

    /// Asks the processor to fetch block `index`.
    #[inline(always)]
    pub(crate) fn prefetch(&self, index: usize) {
        prefetch_at::<[Row; 1 + ROWS]>(self.rows.as_ptr().wrapping_add(index * self.stride).cast());
    }

    /// Memory taken, in bytes.
    pub(crate) fn bytes(&self) -> usize {
        size_of_val(&*self.rows)
    }
}

/// Photons in block `block` of a map of `photons`.
pub(crate) fn photons_in(block: usize, photons: usize) -> usize {
    (photons - block * LANES).min(LANES)
}
