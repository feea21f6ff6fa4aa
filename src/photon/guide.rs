//! What photons learn about where to aim.

use crate::math::Distribution;

/// A density over the unit square, even in each of its cells. What is drawn from even numbers stays spread as they are.
#[derive(Clone, Debug)]
pub struct Guide {
    rows: Distribution,
    /// Of each row.
    columns: Vec<Distribution>,
}

/// Cells along each side.
const CELLS: usize = 16;
/// The share that stays even: what is learnt from a few photons may be wrong.
const EVEN: f64 = 0.25;

impl Guide {
    /// In proportion to the weights around places, but for a share that is even; `None` where there are no weights.
    pub fn new(weights: impl Iterator<Item = ([f64; 2], f64)>) -> Option<Guide> {
        let mut cells = [[0.0; CELLS]; CELLS];
        let mut total = 0.0;
        for (place, weight) in weights {
            let [row, column] = place.map(cell);
            cells[row][column] += weight;
            total += weight;
        }
        let even = EVEN / (CELLS * CELLS) as f64;
        cells.iter_mut().flatten().for_each(|weight| *weight = even + (1.0 - EVEN) * *weight / total);
        let is_usable = total > 0.0 && total.is_finite();
        is_usable.then(|| Guide {
            rows: Distribution::new(cells.map(|row| row.iter().sum())),
            columns: cells.map(Distribution::new).to_vec(),
        })
    }

    /// The place that two uniform numbers stand for.
    pub fn place(&self, [u, v]: [f64; 2]) -> [f64; 2] {
        let row = self.rows.choose(u);
        let column = row.and_then(|row| self.columns[row.index].choose(v));
        let (Some(row), Some(column)) = (row, column) else { return [u, v] };
        [row, column].map(|choice| (choice.index as f64 + choice.rest) / CELLS as f64)
    }

    /// The density there.
    pub fn density(&self, place: [f64; 2]) -> f64 {
        let [row, column] = place.map(cell);
        (CELLS * CELLS) as f64 * self.rows.probability(row) * self.columns[row].probability(column)
    }
}

/// The row or column of a number.
fn cell(number: f64) -> usize {
    ((number * CELLS as f64) as usize).min(CELLS - 1)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Places are drawn with the density that is said, which integrates to 1 and is nowhere small.
    #[test]
    fn places_follow_the_density() {
        const N: usize = 512;
        let guide = Guide::new([([0.1, 0.9], 3.0), ([0.55, 0.2], 1.0)].into_iter()).expect("there are weights");
        let even = |i: usize| (i as f64 + 0.5) / N as f64;
        let (mut sum, mut inverse) = (0.0, 0.0);
        for i in 0..N * N {
            let numbers = [even(i / N), even(i % N)];
            sum += guide.density(numbers);
            // ∫ 1/p over what p draws is the area.
            inverse += 1.0 / guide.density(guide.place(numbers));
            assert!(guide.density(numbers) >= EVEN * (1.0 - 1e-9));
        }
        let [sum, inverse] = [sum, inverse].map(|sum| sum / (N * N) as f64);
        assert!((sum - 1.0).abs() < 1e-9 && (inverse - 1.0).abs() < 0.02, "{sum} {inverse}");
        assert!(Guide::new([([0.5; 2], 0.0)].into_iter()).is_none());
    }
}
