//! What is promised of instruction sets.

use super::portable::Portable;
use super::*;

/// What every operation makes of rows of numbers.
struct Operations<'a>(&'a [Row; 3]);

impl Task for Operations<'_> {
    type Output = Vec<[f32; LANES]>;

    #[inline(always)]
    fn run<L: Lanes>(self) -> Self::Output {
        let [a, b, c] = load3::<L>(self.0);
        let (less, at_most) = (a.less(b), a.less_equal(b));
        let mut packed = [[0.0; LANES]; 2];
        a.compress(L::bits(less), &mut packed[0]);
        let mut indices = [0; LANES];
        L::compress_indices(&std::array::from_fn(|lane| lane as u32), L::bits(at_most), &mut indices);
        packed[1] = indices.map(|index| index as f32);
        for (row, mask) in packed.iter_mut().zip([less, at_most]) {
            // What lies behind the packed lanes may be anything.
            row[L::bits(mask).count_ones() as usize..].fill(0.0);
        }
        let made = [
            a.add(b),
            a.sub(b),
            a.mul(b),
            a.div(b),
            a.min(b),
            a.max(b),
            a.mul_add(b, c),
            a.neg_mul_add(b, c),
            b.sqrt(),
            b.min(L::splat(1e30)).rsqrt(),
            a.exp2(),
            a.select(less, b),
            a.keep(at_most),
            a.keep(L::and(L::mask(0x9a5c), at_most)),
            L::splat(a.sum()),
            L::splat(a.largest()),
            L::load_front(&self.0[1].0),
        ];
        let rows = made.map(|lanes| {
            let mut row = Row([0.0; LANES]);
            lanes.store(&mut row);
            row.0
        });
        rows.into_iter().chain(packed).collect()
    }
}

/// All instruction sets agree with arrays to a few roundings, ties, infinities and small numbers included.
#[test]
fn instruction_sets_compute_the_same() {
    let a = std::array::from_fn(|lane| [-130.0, -3.5, 0.5, 1e-30, 7.25, 100.0, 0.0, -0.125][lane % 8]);
    let b = std::array::from_fn(|lane| [2.0, 3.5, 0.5, 1e30, 0.25, f32::INFINITY, 9.0][lane % 7]);
    let c = std::array::from_fn(|lane| lane as f32 - 8.0);
    let rows = [Row(a), Row(b), Row(c)];
    let expected = Operations(&rows).run::<Portable>();
    for isa in Isa::available() {
        for (number, (found, expected)) in isa.run(Operations(&rows)).iter().zip(&expected).enumerate() {
            for (x, y) in found.iter().zip(expected) {
                let close = (x - y).abs() <= 1e-6 * y.abs() + 1e-36;
                assert!(close || x == y || (x.is_nan() && y.is_nan()), "{isa:?}, operation {number}: {x} {y}");
            }
        }
    }
}
