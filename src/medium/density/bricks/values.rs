//! The values of voxels, as they are or in half the room.

use super::interpolate::{inside, offset};

/// How exactly voxels are kept.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Precision {
    /// As they are: 32 bits.
    #[default]
    Full,
    /// Rounded to 11 digits of a binary number, in 16 bits: by 0.05 % at most, down to 10⁻⁹ of the largest of 8³ neighbours, and by so much
    /// less than that below. Cubes of one value are exact.
    Half,
}

/// Where an entry of the index has its values, and which bits of an offset count there.
pub(super) type Place = (usize, usize);

/// The values of each brick, z fastest, and then the constants.
#[derive(Clone)]
pub(super) enum Values {
    Full(Vec<f32>),
    Half(Halves),
}

/// Values as halves of the IEEE format, in units of which each brick and each constant has its own: that it is a power of two between the largest value
/// over 2¹⁵ and over 2¹⁴ makes room for the least, and products with it are exact. None is negative.
#[derive(Clone)]
pub(super) struct Halves {
    bits: Vec<u16>,
    units: Vec<f32>,
    bricks: usize,
}

/// The exponent of a half has its zero so many powers of two below that of an `f32`.
const BIAS: f32 = f32::from_bits((127 + 112) << 23);

impl Halves {
    /// Bricks and constants in half the room.
    fn new(bricks: &[[f32; 512]], constants: &[f32]) -> Halves {
        let mut bits = Vec::with_capacity(512 * bricks.len() + constants.len());
        let mut units = Vec::with_capacity(bricks.len() + constants.len());
        for values in bricks {
            let unit = unit_of(values.iter().fold(0.0, |a, &b| a.max(b)));
            units.push(unit);
            bits.extend(values.iter().map(|value| half(value / unit)));
        }
        // One, in units of themselves.
        units.extend(constants);
        bits.extend(constants.iter().map(|_| half(1.0)));
        Halves { bits, units, bricks: bricks.len() }
    }

    #[inline]
    fn at(&self, (place, mask): Place, offset: usize) -> f32 {
        let brick = place / 512;
        let unit = self.units[if brick < self.bricks { brick } else { place - 511 * self.bricks }];
        whole(self.bits[place + (offset & mask)]) * unit
    }
}

#[inline]
fn full(values: &[f32], (place, mask): Place, offset: usize) -> f32 {
    values[place + (offset & mask)]
}

/// A brick of values, as it is kept.
#[derive(Clone, Copy)]
pub(super) enum Brick<'a> {
    Full(&'a [f32; 512]),
    Half(&'a [u16; 512], f32),
}

impl Brick<'_> {
    /// The corners of a cell within it, z fastest.
    #[inline]
    pub(super) fn corners(self, cell: [i32; 3]) -> [f32; 8] {
        match self {
            Brick::Full(values) => inside(values, offset(cell)),
            Brick::Half(bits, unit) => inside(bits, offset(cell)).map(|half| whole(half) * unit),
        }
    }

    /// All its values.
    pub(super) fn values(self) -> [f32; 512] {
        match self {
            Brick::Full(values) => *values,
            Brick::Half(bits, unit) => bits.map(|half| whole(half) * unit),
        }
    }
}

/// The power of two in whose units a largest value is from 2¹⁴ up to 2¹⁵.
fn unit_of(largest: f32) -> f32 {
    let exponent = (largest.to_bits() >> 23) as i32 - 127 - 14;
    f32::from_bits(((exponent + 127).max(1) as u32) << 23)
}

/// The nearest half, the even one of two, of a number from 0 to 2¹⁵.
fn half(value: f32) -> u16 {
    let bits = (value / BIAS).to_bits();
    ((bits + 0xFFF + (bits >> 13 & 1)) >> 13) as u16
}

#[inline]
fn whole(half: u16) -> f32 {
    f32::from_bits(u32::from(half) << 13) * BIAS
}

impl Values {
    /// In half the room; `bricks` of them come before the constants.
    pub(super) fn halved(self, bricks: usize) -> Values {
        match self {
            Values::Full(values) => {
                let (bricks, constants) = values.split_at(512 * bricks);
                Values::Half(Halves::new(bricks.as_chunks().0, constants))
            }
            halves @ Values::Half(_) => halves,
        }
    }

    /// All constants; `bricks` of values come before them.
    pub(super) fn constants(&self, bricks: usize) -> &[f32] {
        match self {
            Values::Full(values) => &values[512 * bricks..],
            Values::Half(halves) => &halves.units[bricks..],
        }
    }

    /// The value at an offset of a place.
    #[inline]
    pub(super) fn at(&self, place: Place, offset: usize) -> f32 {
        match self {
            Values::Full(values) => full(values, place, offset),
            Values::Half(halves) => halves.at(place, offset),
        }
    }

    /// The values at eight offsets of places, which `of` tells by their numbers.
    #[inline]
    pub(super) fn eight(&self, of: impl Fn(usize) -> (Place, usize)) -> [f32; 8] {
        match self {
            Values::Full(values) => std::array::from_fn(|n| {
                let (place, offset) = of(n);
                full(values, place, offset)
            }),
            Values::Half(halves) => std::array::from_fn(|n| {
                let (place, offset) = of(n);
                halves.at(place, offset)
            }),
        }
    }

    /// One of the bricks.
    #[inline]
    pub(super) fn brick(&self, brick: usize) -> Brick<'_> {
        match self {
            Values::Full(values) => Brick::Full(&values.as_chunks().0[brick]),
            Values::Half(halves) => Brick::Half(&halves.bits.as_chunks().0[brick], halves.units[brick]),
        }
    }

    /// The memory taken, in bytes.
    pub(super) fn bytes(&self) -> usize {
        match self {
            Values::Full(values) => size_of_val(&values[..]),
            Values::Half(halves) => size_of_val(&halves.bits[..]) + size_of_val(&halves.units[..]),
        }
    }
}
