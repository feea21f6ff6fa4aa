//! Choices in proportion to weights.

/// What was chosen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Choice {
    /// Which of the weights.
    pub index: usize,
    /// With which probability: its weight over their sum.
    pub probability: f64,
    /// The place within the weight's share of [0, 1): uniform in [0, 1) again, and independent of the index.
    pub rest: f64,
}

/// The largest number below 1.
const BELOW_ONE: f64 = 1.0 - f64::EPSILON / 2.0;

/// Chooses one of a few weights, none negative, whose sum is `total`, by a uniform number from [0, 1). `None` where all are 0.
/// One of weight 0 is never chosen, whatever is rounded.
#[inline]
pub fn choose(weights: impl IntoIterator<Item = f64>, total: f64, u: f64) -> Option<Choice> {
    let mut left = u * total;
    let mut chosen = None;
    for (index, weight) in weights.into_iter().enumerate() {
        if weight > 0.0 {
            chosen = Some((index, weight, left));
            if left < weight {
                break;
            }
        }
        left -= weight;
    }
    chosen.filter(|_| total > 0.0).map(|(index, weight, left)| Choice {
        index,
        probability: weight / total,
        rest: (left / weight).clamp(0.0, BELOW_ONE),
    })
}

/// Many weights, chosen from by bisection of a few of their running sums (the method of cutpoints, Chen and Asau 1974).
#[derive(Clone, Debug, Default)]
pub struct Distribution {
    /// Up to and with each, in shares of the total: the last is 1.
    sums: Vec<f64>,
    /// For each of as many even parts of [0, 1) and for 1, the first sum that is above its beginning; empty if there are few.
    cuts: Vec<u32>,
    total: f64,
}

/// So many weights or fewer need no cuts.
const FEW: usize = 32;

impl Distribution {
    /// Of weights, none of them negative. Nothing can be chosen, and every probability is 0, where their sum is 0 or not
    /// finite.
    pub fn new(weights: impl IntoIterator<Item = f64>) -> Self {
        let mut total = 0.0;
        let add = |weight| {
            total += weight;
            total
        };
        let mut sums: Vec<f64> = weights.into_iter().map(add).collect();
        let possible = total > 0.0 && total.is_finite();
        sums.iter_mut().for_each(|sum| *sum = if possible { *sum / total } else { 0.0 });
        let mut cuts = Vec::new();
        if sums.len() > FEW {
            let (parts, mut index) = (sums.len(), 0);
            cuts.extend((0..=parts).map(|part| {
                let from = part as f64 / parts as f64;
                index += sums[index..].iter().take_while(|sum| **sum <= from).count();
                index as u32
            }));
        }
        Distribution { sums, cuts, total }
    }

    /// The sum of the weights.
    pub fn total(&self) -> f64 {
        self.total
    }

    /// Whether nothing can be chosen.
    pub fn is_empty(&self) -> bool {
        self.sums.last().is_none_or(|last| *last != 1.0)
    }

    /// The probability with which [`Distribution::choose`] finds `index`.
    #[inline]
    pub fn probability(&self, index: usize) -> f64 {
        self.sums[index] - self.below(index)
    }

    /// Chooses by a uniform number from [0, 1).
    pub fn choose(&self, u: f64) -> Option<Choice> {
        if self.is_empty() {
            return None;
        }
        let last = self.sums.len() - 1;
        // Rounding may choose the next part for a number at the end of one.
        let part = (u * self.sums.len() as f64) as usize;
        let from = part.checked_sub(1).and_then(|part| self.cuts.get(part)).map_or(0, |cut| *cut as usize);
        let to = self.cuts.get(part + 2).map_or(last, |cut| *cut as usize).min(last);
        let index = from + self.sums[from..to].partition_point(|&sum| sum <= u);
        let probability = self.probability(index);
        let rest = ((u - self.below(index)) / probability).clamp(0.0, BELOW_ONE);
        Some(Choice { index, probability, rest })
    }

    #[inline]
    fn below(&self, index: usize) -> f64 {
        if index == 0 { 0.0 } else { self.sums[index - 1] }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::Stream;
    use crate::math::random::Purpose;

    /// Both ways choose each weight as often as it says, spread what is left over [0, 1), and pass over those of weight 0.
    #[test]
    fn weights_are_chosen_by_their_shares() {
        let weights = [0.0, 2.0, 0.0, 0.5, 1e-9, 5.0, 0.0];
        let total = 7.5 + 1e-9;
        let many = Distribution::new(weights);
        assert!((many.total() - total).abs() < 1e-12);
        const N: usize = 75_000;
        let few = |u| choose(weights, total, u);
        let by_bisection = |u| many.choose(u);
        let ways: [&dyn Fn(f64) -> Option<Choice>; 2] = [&few, &by_bisection];
        for way in ways {
            let (mut counts, mut rests) = ([0usize; 7], [0.0; 7]);
            for u in (0..N).map(|i| (i as f64 + 0.5) / N as f64).chain([0.0, BELOW_ONE]) {
                let found = way(u).expect("not all are 0");
                assert!((0.0..1.0).contains(&found.rest), "{u}: {found:?}");
                assert!((found.probability - weights[found.index] / total).abs() < 1e-12, "{u}: {found:?}");
                counts[found.index] += 1;
                rests[found.index] += found.rest;
            }
            for (index, weight) in weights.into_iter().enumerate() {
                let expected = weight / total * N as f64;
                assert!((counts[index] as f64 - expected).abs() <= 2.0, "{index}: {counts:?}");
                assert!(weight > 0.0 || counts[index] == 0, "{index}: {counts:?}");
                let mean = rests[index] / counts[index] as f64;
                assert!(counts[index] < 100 || (mean - 0.5).abs() < 1e-3, "{index}: {mean}");
            }
        }
    }

    /// However uneven weights are, and wherever a number lies: the first running sum above it.
    #[test]
    fn cuts_lead_to_what_all_sums_say() {
        let mut stream = Stream::new(1, Purpose::Test, 0, 0);
        for count in [FEW + 1, 100, 5000] {
            let weights: Vec<f64> = (0..count).map(|i| [0.0, 1.0, stream.uniform().powi(60)][i % 3]).collect();
            let many = Distribution::new(weights);
            let between = (0..20_000).map(|_| stream.uniform()).collect::<Vec<_>>();
            let edges = (0..=count).map(|i| i as f64 / count as f64).chain(many.sums.iter().copied());
            let beside = edges.flat_map(|u| [u.next_down(), u, u.next_up()]).filter(|u| (0.0..1.0).contains(u));
            for u in beside.chain(between) {
                let expected = many.sums.iter().position(|sum| *sum > u);
                assert_eq!(many.choose(u).map(|choice| choice.index), expected, "{count} {u}");
            }
        }
    }

    #[test]
    fn nothing_is_chosen_where_there_is_nothing() {
        for weights in [vec![], vec![0.0, 0.0], vec![f64::INFINITY], vec![f64::NAN]] {
            let many = Distribution::new(weights.iter().copied());
            assert!(many.is_empty() && many.choose(0.5).is_none(), "{weights:?}");
            assert!((0..weights.len()).all(|index| many.probability(index) == 0.0), "{weights:?}");
        }
        assert_eq!(choose([0.0; 3], 0.0, 0.5), None);
        assert_eq!(choose([1.0; 3], f64::NAN, 0.5), None);
    }
}
