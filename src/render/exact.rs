//! Sums of numbers that depend neither on the order nor on the grouping of what is added.
//!
//! A number is cut into digits of 32 bits at fixed places, and the two highest places that any number of a
//! sum reaches are summed as integers. What lies below them is cut off, number by number: at most 2⁻³² of the
//! largest number added, for each number. Which places are kept follows from the largest number alone, and what a number
//! has there from that number alone; so parts of a sum, added, are the whole, bit for bit. (The idea is that
//! of reproducible summation by bins, Demmel and Nguyen 2015, "Parallel Reproducible Summation", here with
//! integers.)

use std::io::{self, Read, Write};

use rayon::prelude::*;

/// Bits of a digit.
const DIGIT: i32 = 32;
/// The lowest place for a number's highest digit: far below the squares of the smallest 32-bit floats.
const LOWEST: i8 = -14;
/// The highest place, that of the largest 64-bit float.
const HIGHEST: i8 = 31;
/// So many numbers fit into a sum: their digits stay below 2⁶².
pub const MOST: u32 = 1 << 30;
/// Elements that one task handles.
const CHUNK: usize = 4096;

/// For each element (a pixel), sums of `C` channels that share their places.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ExactSums<const C: usize> {
    /// The place of the higher digit.
    places: Vec<i8>,
    /// The sums of the higher and the lower digits by channel.
    digits: Vec<[[i64; 2]; C]>,
}

/// 2^{32 place}, exactly.
fn unit(place: i8) -> f64 {
    f64::from_bits(((1023 + DIGIT as i64 * place as i64) as u64) << 52)
}

/// The place of the highest digit of a finite number.
fn place_of(value: f64) -> i8 {
    let exponent = ((value.to_bits() >> 52) & 0x7ff) as i32 - 1023;
    exponent.div_euclid(DIGIT).max(LOWEST as i32) as i8
}

/// The digits at `place`, which is not below the number's own, and at the next lower one.
fn digits(value: f64, place: i8) -> [i64; 2] {
    let scaled = value * unit(-place);
    let high = scaled.trunc();
    [high as i64, ((scaled - high) * unit(1)).trunc() as i64]
}

/// What the digits at `place` stand for, rounded once.
fn value([high, low]: [i64; 2], place: i8) -> f64 {
    (((high as i128) << DIGIT) + low as i128) as f64 * unit(place - 1)
}

fn raise<const C: usize>(place: &mut i8, digits: &mut [[i64; 2]; C], to: i8) {
    for digits in digits.iter_mut() {
        match to - *place {
            ..=0 => {}
            1 => *digits = [0, digits[0]],
            _ => *digits = [0, 0],
        }
    }
    *place = to.max(*place);
}

fn add<const C: usize>(place: &mut i8, sums: &mut [[i64; 2]; C], values: [f64; C]) {
    let values = values.map(|value| if value.is_finite() { value } else { 0.0 });
    let needed = values.iter().fold(LOWEST, |place, value| place.max(place_of(*value)));
    raise(place, sums, needed);
    for (sum, value) in sums.iter_mut().zip(values) {
        let [high, low] = digits(value, *place);
        sum[0] += high;
        sum[1] += low;
    }
}

/// What the sum of `values` alone would be.
pub fn rounded<const C: usize>(values: [f64; C]) -> [f64; C] {
    let (mut place, mut sums) = (LOWEST, [[0; 2]; C]);
    add(&mut place, &mut sums, values);
    sums.map(|digits| value(digits, place))
}

impl<const C: usize> ExactSums<C> {
    /// Bytes that one element takes, in memory and in a file.
    pub const BYTES: usize = 1 + 16 * C;

    /// Sums of nothing.
    pub fn new(elements: usize) -> Self {
        ExactSums { places: vec![LOWEST; elements], digits: vec![[[0; 2]; C]; elements] }
    }

    /// Adds numbers to all elements; what is not finite counts as 0. No more than [`MOST`] times, merged sums
    /// included.
    pub fn add(&mut self, values: impl Fn(usize) -> [f64; C] + Sync) {
        let chunks = self.places.par_chunks_mut(CHUNK).zip(self.digits.par_chunks_mut(CHUNK)).enumerate();
        chunks.for_each(|(chunk, (places, digits))| {
            for (i, (place, digits)) in places.iter_mut().zip(digits).enumerate() {
                add(place, digits, values(chunk * CHUNK + i));
            }
        });
    }

    /// Adds numbers to one element; what is not finite counts as 0. No more than 2³¹ times.
    pub fn add_at(&mut self, at: usize, values: [f64; C]) {
        add(&mut self.places[at], &mut self.digits[at], values);
    }

    /// Adds other sums of as many elements.
    pub fn merge(&mut self, other: &Self) {
        let others = other.places.iter().zip(&other.digits);
        for ((place, sums), (&from, more)) in self.places.iter_mut().zip(&mut self.digits).zip(others) {
            let to = from.max(*place);
            raise(place, sums, to);
            let (mut from, mut more) = (from, *more);
            raise(&mut from, &mut more, to);
            for (sum, more) in sums.iter_mut().zip(more) {
                sum[0] += more[0];
                sum[1] += more[1];
            }
        }
    }

    /// The sums of an element.
    pub fn get(&self, at: usize) -> [f64; C] {
        self.digits[at].map(|digits| value(digits, self.places[at]))
    }

    /// Writes places, then digits, little-endian.
    pub fn write(&self, file: &mut impl Write) -> io::Result<()> {
        for chunk in self.places.chunks(CHUNK) {
            let bytes: Vec<u8> = chunk.iter().map(|place| place.to_le_bytes()[0]).collect();
            file.write_all(&bytes)?;
        }
        for chunk in self.digits.chunks(CHUNK) {
            let bytes: Vec<u8> = chunk.iter().flatten().flatten().flat_map(|digit| digit.to_le_bytes()).collect();
            file.write_all(&bytes)?;
        }
        Ok(())
    }

    /// Reads what [`ExactSums::write`] wrote. `None` if so many `numbers` cannot have such sums.
    pub fn read(file: &mut impl Read, elements: usize, numbers: u32) -> io::Result<Option<Self>> {
        let mut sums = ExactSums::new(elements);
        let mut buffer = vec![0u8; CHUNK * 16 * C];
        for chunk in sums.places.chunks_mut(CHUNK) {
            let bytes = &mut buffer[..chunk.len()];
            file.read_exact(bytes)?;
            for (place, byte) in chunk.iter_mut().zip(bytes.iter()) {
                *place = i8::from_le_bytes([*byte]);
            }
        }
        for chunk in sums.digits.chunks_mut(CHUNK) {
            let bytes = &mut buffer[..chunk.len() * 16 * C];
            file.read_exact(bytes)?;
            let (words, _) = bytes.as_chunks::<8>();
            for (digit, word) in chunk.as_flattened_mut().as_flattened_mut().iter_mut().zip(words) {
                *digit = i64::from_le_bytes(*word);
            }
        }
        let most = (numbers as u64) << DIGIT;
        let possible = sums.places.iter().all(|place| (LOWEST..=HIGHEST).contains(place))
            && sums.digits.iter().flatten().flatten().all(|digit| digit.unsigned_abs() <= most);
        Ok(possible.then_some(sums))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::Stream;
    use crate::math::random::Purpose;

    /// Numbers of either sign over the whole range, zeros and the extremes among them.
    fn numbers(count: u64) -> Vec<[f64; 2]> {
        let number = |stream: &mut Stream, range: f64| {
            let sign = if stream.uniform() < 0.2 { -1.0 } else { 1.0 };
            sign * (range * (2.0 * stream.uniform() - 1.0)).exp2()
        };
        let mut numbers: Vec<[f64; 2]> = (0..count)
            .map(|i| {
                let mut stream = Stream::new(3, Purpose::Test, i, 0);
                let range = if i % 2 == 0 { 200.0 } else { 3.0 };
                [number(&mut stream, range), number(&mut stream, range)]
            })
            .collect();
        numbers.extend([[0.0, 1e-300], [f64::MIN_POSITIVE / 8.0, 0.0], [1e61, -1e61], [1.0, -1.0]]);
        numbers
    }

    fn sum(numbers: &[[f64; 2]]) -> ExactSums<2> {
        let mut sums = ExactSums::new(1);
        numbers.iter().for_each(|&values| sums.add(|_| values));
        sums
    }

    #[test]
    fn grouping_and_order_change_nothing() {
        let numbers = numbers(300);
        let whole = sum(&numbers);
        for trial in 0..200 {
            let mut stream = Stream::new(4, Purpose::Test, trial, 0);
            let mut order: Vec<(f64, usize)> = (0..numbers.len()).map(|i| (stream.uniform(), i)).collect();
            order.sort_by(|a, b| a.0.total_cmp(&b.0));
            let shuffled: Vec<[f64; 2]> = order.iter().map(|&(_, i)| numbers[i]).collect();
            let at = (stream.uniform() * numbers.len() as f64) as usize;
            let (mut first, second) = (sum(&shuffled[..at]), sum(&shuffled[at..]));
            first.merge(&second);
            assert_eq!(first, whole, "split at {at}");
        }
    }

    #[test]
    fn sums_are_precise() {
        // At any scale, to 2⁻³² of the largest number for each.
        for scale in [1e-45, 1e-30, 1e-9, 1.0, 4e9, 1e30, 1e60] {
            let values: Vec<f64> = (0..1000).map(|i| scale * Stream::new(5, Purpose::Test, i, 0).uniform()).collect();
            let mut sums = ExactSums::new(1);
            values.iter().for_each(|&value| sums.add(|_| [value]));
            let expected: f64 = values.iter().sum();
            let [found] = sums.get(0);
            assert!(found <= expected * (1.0 + 1e-12), "{scale}: {found} {expected}");
            assert!(expected - found <= 1000.0 * scale / (1u64 << 32) as f64, "{scale}: {found} {expected}");
        }
        // Whole numbers below 2³² are exact, and one number alone loses no bit of a 32-bit float.
        let mut sums = ExactSums::new(1);
        (0..1000).for_each(|i| sums.add(|_| [i as f64]));
        assert_eq!(sums.get(0), [499_500.0]);
        for value in [f32::from_bits(1), f32::MIN_POSITIVE, 0.1, 1.0 / 3.0, 1e-8, f32::MAX] {
            assert_eq!(rounded([value as f64, -value as f64]), [value as f64, -value as f64]);
        }
        assert_eq!(rounded([f64::NAN, f64::INFINITY, 1.5]), [0.0, 0.0, 1.5]);
    }

    #[test]
    fn files_hold_what_was_written_and_nothing_impossible() {
        let sums = sum(&numbers(50));
        let mut bytes = Vec::new();
        sums.write(&mut bytes).unwrap();
        assert_eq!(bytes.len(), ExactSums::<2>::BYTES);
        let read = |bytes: &[u8], numbers| ExactSums::<2>::read(&mut &*bytes, 1, numbers);
        assert_eq!(read(&bytes, 54).unwrap(), Some(sums));
        assert!(read(&bytes[..bytes.len() - 1], 54).is_err());
        let mut damaged = bytes.clone();
        damaged[0] = 77;
        assert_eq!(read(&damaged, 54).unwrap(), None);
        damaged = bytes;
        damaged[8] = 0x40;
        assert_eq!(read(&damaged, 54).unwrap(), None);
    }
}
