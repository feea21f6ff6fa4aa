//! Photons on their way to the rays of a group, by field: those collected near the bundle, then those shifted to the
//! group's frame.

#![allow(
    clippy::needless_range_loop,
    reason = "iterators' closures need not be inlined into a kernel's instruction set"
)]

use crate::gather::sampled::VECTORS;
use crate::photon::simd::{LANES, Lanes};

/// Walls a photon may have.
pub(super) const WALLS: usize = 3;

/// Fields of a wall: its normal and its distance.
const WALL_FIELDS: usize = 4;

/// Photons of one kind near the bundle before all groups are served.
const MOST_COLLECTED: usize = 4096;

/// Room for them, and for whole vectors behind the last; no multiple of a page, for the sake of the cache.
const COLLECTED_ROOM: usize = MOST_COLLECTED + 2 * LANES;

/// Photons of a group before they are evaluated: as much as the nearest cache holds.
const MOST_SHIFTED: usize = 512;

/// Room for them, and for whole vectors behind the last.
const SHIFTED_ROOM: usize = MOST_SHIFTED + 2 * LANES;

/// For each vector of a group's rays, which of the shifted photons it may meet.
pub(super) type Lists = [[u32; SHIFTED_ROOM]; VECTORS];

/// Lists to begin with.
pub(super) const NO_LISTS: Lists = [[0; SHIFTED_ROOM]; VECTORS];

/// A field of photons, its vectors each in one line of the cache.
#[derive(Clone, Debug)]
#[repr(C, align(64))]
struct Field<const N: usize>([f32; N]);

impl<const N: usize> Field<N> {
    const ZERO: Self = Field([0.0; N]);

    #[inline(always)]
    fn load<L: Lanes>(&self, at: usize) -> L {
        L::load_front(&self.0[at..])
    }

    /// Writes the lanes of `bits`, packed.
    #[inline(always)]
    fn write<L: Lanes>(&mut self, at: usize, value: L, bits: u16) {
        if let Some(out) = self.0[at..].first_chunk_mut() {
            value.compress(bits, out);
        }
    }
}

/// Writes three fields of the photons of `bits`, packed, from place `at` on.
#[inline(always)]
fn write3<L: Lanes, const N: usize>(fields: &mut [Field<N>], first: usize, at: usize, values: &[L; 3], bits: u16) {
    for axis in 0..3 {
        fields[first + axis].write(at, values[axis], bits);
    }
}

/// Photons near the bundle.
#[derive(Debug)]
pub(super) struct Collected {
    fields: Vec<Field<COLLECTED_ROOM>>,
    pub(super) len: usize,
}

impl Collected {
    // Which field is which; of vectors, the first of three.
    const POSITION: usize = 0;
    const INVERSE_SQUARE: usize = 3;
    const DIRECTION: usize = 4;
    const POWER: usize = 7;
    const WALLS: usize = 10;

    pub(super) fn new(walls: usize) -> Self {
        Collected { fields: vec![Field::ZERO; Self::WALLS + WALL_FIELDS * walls], len: 0 }
    }

    #[inline(always)]
    fn load3<L: Lanes>(&self, first: usize, at: usize) -> [L; 3] {
        [self.fields[first].load(at), self.fields[first + 1].load(at), self.fields[first + 2].load(at)]
    }

    #[inline(always)]
    pub(super) fn position<L: Lanes>(&self, at: usize) -> [L; 3] {
        self.load3(Self::POSITION, at)
    }

    /// 1/r².
    #[inline(always)]
    pub(super) fn inverse_square<L: Lanes>(&self, at: usize) -> L {
        self.fields[Self::INVERSE_SQUARE].load(at)
    }

    #[inline(always)]
    pub(super) fn direction<L: Lanes>(&self, at: usize) -> [L; 3] {
        self.load3(Self::DIRECTION, at)
    }

    #[inline(always)]
    pub(super) fn power<L: Lanes>(&self, at: usize) -> [L; 3] {
        self.load3(Self::POWER, at)
    }

    /// The normals of walls, and the photons' distances from them.
    #[inline(always)]
    pub(super) fn wall<L: Lanes>(&self, wall: usize, at: usize) -> ([L; 3], L) {
        let first = Self::WALLS + WALL_FIELDS * wall;
        (self.load3(first, at), self.fields[first + 3].load(at))
    }

    /// Writes the photons of `bits` behind the last one; they count once [`Collected::advance`] is called.
    #[inline(always)]
    pub(super) fn write<L: Lanes>(&mut self, position: &[L; 3], inverse_square: L, power: &[L; 3], bits: u16) {
        write3(&mut self.fields, Self::POSITION, self.len, position, bits);
        write3(&mut self.fields, Self::POWER, self.len, power, bits);
        self.fields[Self::INVERSE_SQUARE].write(self.len, inverse_square, bits);
    }

    /// Writes the directions of the photons of `bits`; where none are written, they are those of other photons, or zero.
    #[inline(always)]
    pub(super) fn write_direction<L: Lanes>(&mut self, direction: &[L; 3], bits: u16) {
        write3(&mut self.fields, Self::DIRECTION, self.len, direction, bits);
    }

    /// Writes a wall of the photons of `bits`.
    #[inline(always)]
    pub(super) fn write_wall<L: Lanes>(&mut self, wall: usize, normal: &[L; 3], distance: L, bits: u16) {
        let first = Self::WALLS + WALL_FIELDS * wall;
        write3(&mut self.fields[..], first, self.len, normal, bits);
        self.fields[first + 3].write(self.len, distance, bits);
    }

    /// The photons of `bits` are written. Returns whether there is no room for as many again.
    #[inline(always)]
    pub(super) fn advance(&mut self, bits: u16) -> bool {
        self.len += bits.count_ones() as usize;
        self.len + LANES > MOST_COLLECTED
    }
}

/// Photons in a group's frame.
#[derive(Debug)]
pub(super) struct Shifted {
    fields: Box<[Field<SHIFTED_ROOM>; Shifted::FIELDS]>,
    pub(super) len: usize,
}

/// Shifted photons: one in every lane, or one a lane.
#[derive(Clone, Copy)]
pub(super) struct PhotonLanes<L> {
    /// (a, b, z).
    pub(super) position: [L; 3],
    pub(super) inverse_square: L,
    /// How phase function and transmittance change with the two slopes of a ray and with −s²/2.
    pub(super) change: [L; 3],
    /// Times phase function and transmittance along the group's axis.
    pub(super) power: [L; 3],
}

impl Shifted {
    // Which field is which; of vectors, the first of three.
    const POSITION: usize = 0;
    const INVERSE_SQUARE: usize = 3;
    const CHANGE: usize = 4;
    const POWER: usize = 7;
    const INVERSE_RADIUS: usize = 10;
    const WALLS: usize = 11;
    const KNOT: usize = Self::WALLS + WALL_FIELDS * WALLS;
    const FIELDS: usize = Self::KNOT + 1;

    pub(super) fn new() -> Self {
        Shifted { fields: Box::new([const { Field::ZERO }; Self::FIELDS]), len: 0 }
    }

    /// Positions (a, b, z) and 1/r², from a photon on.
    #[inline(always)]
    pub(super) fn discs<L: Lanes>(&self, at: usize) -> ([L; 3], L) {
        let load = |field: usize| self.fields[field].load(at);
        let position = [load(Self::POSITION), load(Self::POSITION + 1), load(Self::POSITION + 2)];
        (position, load(Self::INVERSE_SQUARE))
    }

    #[inline(always)]
    fn at(&self, field: usize, index: usize) -> f32 {
        // Below it anyway; so the compiler knows.
        self.fields[field].0[index % MOST_SHIFTED]
    }

    #[inline(always)]
    fn splat3<L: Lanes>(&self, first: usize, index: usize) -> [L; 3] {
        [L::splat(self.at(first, index)), L::splat(self.at(first + 1, index)), L::splat(self.at(first + 2, index))]
    }

    /// A photon, in every lane.
    #[inline(always)]
    pub(super) fn photon<L: Lanes>(&self, index: usize) -> PhotonLanes<L> {
        PhotonLanes {
            position: self.splat3(Self::POSITION, index),
            inverse_square: L::splat(self.at(Self::INVERSE_SQUARE, index)),
            change: self.splat3(Self::CHANGE, index),
            power: self.splat3(Self::POWER, index),
        }
    }

    /// 1/r of a photon that needs care, in every lane.
    #[inline(always)]
    pub(super) fn inverse_radius<L: Lanes>(&self, index: usize) -> L {
        L::splat(self.at(Self::INVERSE_RADIUS, index))
    }

    /// The normal of a photon's wall, and its distance, in every lane.
    #[inline(always)]
    pub(super) fn wall<L: Lanes>(&self, wall: usize, index: usize) -> ([L; 3], L) {
        let first = Self::WALLS + WALL_FIELDS * wall;
        (self.splat3(first, index), L::splat(self.at(first + 3, index)))
    }

    /// Where a photon lies among the knots of a table, if there is one.
    #[inline(always)]
    pub(super) fn knot<const TABLE: usize>(&self, index: usize) -> f32 {
        if TABLE == 0 { 0.0 } else { self.at(Self::KNOT, index) }
    }

    /// Writes the photons of `bits` behind the last one; they count once [`Shifted::advance`] is called.
    #[inline(always)]
    pub(super) fn write<L: Lanes>(&mut self, photons: &PhotonLanes<L>, bits: u16) {
        let fields = &mut self.fields[..];
        write3(fields, Self::POSITION, self.len, &photons.position, bits);
        fields[Self::INVERSE_SQUARE].write(self.len, photons.inverse_square, bits);
        write3(fields, Self::CHANGE, self.len, &photons.change, bits);
        write3(fields, Self::POWER, self.len, &photons.power, bits);
    }

    /// Writes 1/r of the photons of `bits`.
    #[inline(always)]
    pub(super) fn write_inverse_radius<L: Lanes>(&mut self, inverse_radius: L, bits: u16) {
        self.fields[Self::INVERSE_RADIUS].write(self.len, inverse_radius, bits);
    }

    /// Writes a wall of the photons of `bits`.
    #[inline(always)]
    pub(super) fn write_wall<L: Lanes>(&mut self, wall: usize, normal: &[L; 3], distance: L, bits: u16) {
        let first = Self::WALLS + WALL_FIELDS * wall;
        write3(&mut self.fields[..], first, self.len, normal, bits);
        self.fields[first + 3].write(self.len, distance, bits);
    }

    /// Writes where the photons of `bits` lie among the knots of a table.
    #[inline(always)]
    pub(super) fn write_knot<L: Lanes>(&mut self, knot: L, bits: u16) {
        self.fields[Self::KNOT].write(self.len, knot, bits);
    }

    /// The photons of `bits` are written. Returns whether there is no room for as many again.
    #[inline(always)]
    pub(super) fn advance(&mut self, bits: u16) -> bool {
        self.len += bits.count_ones() as usize;
        self.len + LANES > MOST_SHIFTED
    }
}
