//! Photons in blocks of sixteen, field by field.

use super::Photon;
use super::order::{events_of, pieces};
use crate::math::Vec3;
use crate::photon::simd::{LANES, Row, prefetch_at};
use rayon::prelude::*;

/// Sixteen photons. Lanes without one lie at infinity and have no power.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Block<'a> {
    pub position: &'a [Row; 3],
    /// `None` where directions are not kept.
    pub direction: Option<&'a [Row; 3]>,
    /// K₂(0) · power/r², by channel; one row for all where they are alike.
    pub power: [&'a Row; 3],
    /// 1/r².
    pub inverse_square: &'a Row,
}

/// Blocks of photons, the rows of each next to one another. What all photons share is stored once or not at all: a common radius,
/// directions that nobody asks for, and the channels of grey light.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Blocks {
    /// 1/r² in front of each block, or of all; then position, direction and power of its photons.
    rows: Vec<Row>,
    /// How many blocks there are.
    count: usize,
    fields: Fields,
    /// Rows from block to block.
    stride: usize,
    /// What counts of the place of a block's 1/r²: all of it, or nothing, which leaves the first row of all.
    mask: usize,
}

/// Which rows a block has besides 1/r²: three of positions, and these.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Fields {
    /// Whether it has three of directions.
    directions: bool,
    /// The row of each channel's power.
    power: [usize; 3],
    /// How many rows there are.
    rows: usize,
}

impl Fields {
    fn new(directions: bool, grey: bool) -> Self {
        let first = if directions { 6 } else { 3 };
        let power = if grey { [first; 3] } else { [first, first + 1, first + 2] };
        Fields { directions, power, rows: power[2] + 1 }
    }

    /// Writes up to sixteen photons into a block's rows, the other lanes of which are empty.
    fn fill(self, rows: &mut [Row], photons: &[Photon], gain: f32) {
        rows[..3].fill(Row([f32::INFINITY; LANES]));
        let (geometry, power) = rows.split_at_mut(self.power[0]);
        for (lane, photon) in photons.iter().enumerate() {
            let values = photon.position.to_array().into_iter().chain(photon.direction.to_array());
            for (row, value) in geometry.iter_mut().zip(values) {
                row.0[lane] = value;
            }
            for (row, value) in power.iter_mut().zip(photon.power.to_array()) {
                row.0[lane] = gain * value;
            }
        }
    }
}

/// What of photons goes into blocks.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Kept {
    /// 1/r² of all; without it, room is left for that of each.
    pub inverse_square: Option<f32>,
    /// What powers are multiplied by.
    pub gain: f32,
    /// Whether directions are kept.
    pub directions: bool,
    /// Whether events are returned.
    pub tagged: bool,
}

impl Blocks {
    /// Takes photons in order; and their events, if they are wanted.
    pub(crate) fn new(photons: Vec<Photon>, kept: &Kept) -> (Self, Vec<[u8; LANES]>) {
        let Kept { inverse_square, gain, directions, tagged } = *kept;
        let grey = photons.par_iter().all(|photon| photon.power == Vec3::splat(photon.power.x));
        let fields = Fields::new(directions, grey);
        let count = photons.len().div_ceil(LANES);
        let own = usize::from(inverse_square.is_none());
        let stride = fields.rows + own;
        let mut rows = Vec::with_capacity(1 + count * stride);
        let mut events = Vec::with_capacity(if tagged { count } else { 0 });
        rows.extend(inverse_square.map(|x| Row([x; LANES])));
        for photons in pieces(photons) {
            let from = rows.len();
            rows.resize(from + photons.len().div_ceil(LANES) * stride, Row([0.0; LANES]));
            let blocks = rows[from..].par_chunks_mut(stride).zip(photons.par_chunks(LANES));
            blocks.for_each(|(rows, photons)| fields.fill(&mut rows[own..], photons, gain));
            if tagged {
                events.par_extend(events_of(&photons));
            }
        }
        (Blocks { rows, count, fields, stride, mask: own.wrapping_neg() }, events)
    }

    /// Gives each photon its own 1/r², and multiplies its power by that and by `gain`.
    pub(crate) fn spread(&mut self, photons: usize, radii: &[f32], gain: f32) {
        let powers = self.fields.power[0];
        let blocks = self.rows.par_chunks_mut(self.stride).zip(radii.par_chunks(LANES));
        blocks.enumerate().for_each(|(index, (rows, radii))| {
            rows[0] = Row([f32::INFINITY; LANES]);
            for (lane, &r) in radii[..photons_in(index, photons)].iter().enumerate() {
                rows[0].0[lane] = 1.0 / (r * r);
                for power in &mut rows[1 + powers..] {
                    power.0[lane] *= gain / (r * r);
                }
            }
        });
    }

    /// Multiplies powers.
    pub(crate) fn weigh(&mut self, factors: &[[f32; LANES]]) {
        let (power, own) = (self.fields.power, usize::from(self.mask != 0));
        let blocks = self.rows[1 - own..].par_chunks_mut(self.stride).zip(factors);
        blocks.for_each(|(rows, factors)| {
            for row in &mut rows[own + power[0]..] {
                row.0.iter_mut().zip(factors).for_each(|(power, factor)| *power *= factor);
            }
        });
    }

    /// Whether directions are kept.
    pub(crate) fn has_directions(&self) -> bool {
        self.fields.directions
    }

    /// Whether photons have one power for all channels.
    pub(crate) fn is_grey(&self) -> bool {
        self.fields.power[0] == self.fields.power[2]
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
        let Fields { directions, power, rows } = self.fields;
        // SAFETY: block `count` − 1 ends with `rows`, and so this one does not end behind it: its 1/r² lies in front of
        // its rows, or in front of all. It has three rows of positions, three of directions if `directions`, and those of
        // `power`. Checks would cost 3 % of a query.
        unsafe {
            let rows = self.rows.get_unchecked(at + 1..at + 1 + rows);
            let three = |first: usize| &*rows.as_ptr().add(first).cast::<[Row; 3]>();
            Block {
                position: three(0),
                direction: directions.then(|| three(3)),
                power: power.map(|row| rows.get_unchecked(row)),
                inverse_square: self.rows.get_unchecked(at & self.mask),
            }
        }
    }

    /// Asks the processor to fetch block `index`.
    #[inline(always)]
    pub(crate) fn prefetch(&self, index: usize) {
        let first = self.rows.as_ptr().wrapping_add(index * self.stride);
        prefetch_at::<[Row; 5]>(first.cast());
        if self.fields.rows > 4 {
            prefetch_at::<[Row; 5]>(first.wrapping_add(5).cast());
        }
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
