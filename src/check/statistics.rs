//! Welch's t-test, what its p-values are compared with, and how false alarms over many tests are bounded.

/// A mean with its standard error, and the degrees of freedom that this has.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mean {
    /// The mean of the values.
    pub value: f64,
    /// The variance of that mean: s²/n.
    pub variance: f64,
    /// How many values there are.
    pub count: f64,
}

impl Mean {
    /// Of at least two values.
    pub fn of(values: impl Iterator<Item = f64> + Clone) -> Mean {
        let count = values.clone().count().max(1) as f64;
        let value = values.clone().sum::<f64>() / count;
        let squares: f64 = values.map(|x| (x - value) * (x - value)).sum();
        Mean { value, variance: squares / (count - 1.0).max(1.0) / count, count }
    }
}

/// Whether two means differ: Welch's t-test.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Welch {
    /// The first mean less the second.
    pub difference: f64,
    /// The standard error of that.
    pub error: f64,
    /// Degrees of freedom, by Welch and Satterthwaite.
    pub freedom: f64,
    /// The chance of a difference as large, or larger, of equal means.
    pub p: f64,
}

/// Two means that differ by less than this share of the larger do so by rounding of the pixels.
const ROUNDING: f64 = 1e-5;

impl Welch {
    /// Tests two means for equality.
    pub fn test(a: &Mean, b: &Mean) -> Welch {
        let (difference, variance) = (a.value - b.value, a.variance + b.variance);
        let error = variance.sqrt();
        let parts =
            a.variance * a.variance / (a.count - 1.0).max(1.0) + b.variance * b.variance / (b.count - 1.0).max(1.0);
        let freedom = if parts > 0.0 { variance * variance / parts } else { (a.count + b.count - 2.0).max(1.0) };
        let rounding = ROUNDING * a.value.abs().max(b.value.abs());
        let p = match difference.abs() {
            apart if apart <= rounding => 1.0,
            apart if error > 0.0 => student_tails(apart / error, freedom),
            _ => 0.0,
        };
        Welch { difference, error, freedom, p }
    }
}

/// The chance that |t| exceeds this, for Student's distribution with `freedom` degrees of freedom.
pub fn student_tails(t: f64, freedom: f64) -> f64 {
    incomplete_beta(0.5 * freedom, 0.5, freedom / (freedom + t * t))
}

/// What |t| exceeds with chance `p`: by bisection, as p falls steadily with t.
pub fn student_quantile(p: f64, freedom: f64) -> f64 {
    let (mut low, mut high) = (0.0, 1.0);
    while student_tails(high, freedom) > p && high < 1e12 {
        high *= 2.0;
    }
    for _ in 0..80 {
        let middle = 0.5 * (low + high);
        if student_tails(middle, freedom) > p { low = middle } else { high = middle }
    }
    high
}

/// The regularised incomplete beta function I_x(a, b), by its continued fraction (Abramowitz and Stegun 1964, 26.5.8), evaluated
/// by Lentz's method.
fn incomplete_beta(a: f64, b: f64, x: f64) -> f64 {
    if x <= 0.0 || x >= 1.0 {
        return if x >= 1.0 { 1.0 } else { 0.0 };
    }
    // The fraction converges fast on this side.
    if x > (a + 1.0) / (a + b + 2.0) {
        return 1.0 - incomplete_beta(b, a, 1.0 - x);
    }
    let front = ln_gamma(a + b) - ln_gamma(a) - ln_gamma(b) + a * x.ln() + b * (-x).ln_1p();
    const TINY: f64 = 1e-300;
    let away = |x: f64| if x.abs() < TINY { TINY } else { x };
    let (mut c, mut d) = (1.0, 1.0 / away(1.0 - (a + b) * x / (a + 1.0)));
    let mut fraction = d;
    for m in 1..500 {
        let m = f64::from(m);
        let even = m * (b - m) * x / ((a + 2.0 * m - 1.0) * (a + 2.0 * m));
        let odd = -(a + m) * (a + b + m) * x / ((a + 2.0 * m) * (a + 2.0 * m + 1.0));
        let mut step = 1.0;
        for term in [even, odd] {
            d = 1.0 / away(1.0 + term * d);
            c = away(1.0 + term / c);
            step = c * d;
            fraction *= step;
        }
        if (step - 1.0).abs() < 1e-14 {
            break;
        }
    }
    (front.exp() * fraction / a).clamp(0.0, 1.0)
}

/// ln Γ(x) for x > 0, by Lanczos' approximation (g = 7, nine terms), right to some 15 digits.
fn ln_gamma(x: f64) -> f64 {
    const TERMS: [f64; 9] = [
        0.999_999_999_999_809_9,
        676.520_368_121_885_1,
        -1_259.139_216_722_402_8,
        771.323_428_777_653_1,
        -176.615_029_162_140_6,
        12.507_343_278_686_905,
        -0.138_571_095_265_720_12,
        9.984_369_578_019_572e-6,
        1.505_632_735_149_311_6e-7,
    ];
    if x < 0.5 {
        // Reflection.
        let pi = std::f64::consts::PI;
        return (pi / (pi * x).sin()).ln() - ln_gamma(1.0 - x);
    }
    let x = x - 1.0;
    let t = x + 7.5;
    let sum = (1..9).fold(TERMS[0], |sum, i| sum + TERMS[i] / (x + i as f64));
    0.5 * (2.0 * std::f64::consts::PI).ln() + (x + 0.5) * t.ln() - t + sum.ln()
}

/// Whether there are too many small p-values among these, of which each is uniform by itself where nothing is wrong: a bound of
/// the chance of a distribution that lies as far above the uniform one, or farther (Kolmogorov's one-sided test, by Massart's
/// inequality).
pub fn excess_of_small(p: &[f64]) -> f64 {
    let mut sorted: Vec<f64> = p.to_vec();
    sorted.sort_by(f64::total_cmp);
    let n = sorted.len() as f64;
    let above = (1..).zip(&sorted).map(|(rank, p)| f64::from(rank) / n - p).fold(0.0, f64::max);
    (-2.0 * n * above * above).exp().min(1.0)
}

/// How many of these tests fail, where no more than a share `alpha` of all such families may have a single false alarm (Holm 1979).
pub fn holm(p: &[f64], alpha: f64) -> usize {
    let mut sorted: Vec<f64> = p.to_vec();
    sorted.sort_by(f64::total_cmp);
    let fails = |(index, p): &(usize, &f64)| **p <= alpha / (sorted.len() - index) as f64;
    sorted.iter().enumerate().take_while(fails).count()
}

/// The numbers of p-values in ten bins from 0 to 1.
pub fn histogram(p: &[f64]) -> [u32; 10] {
    let mut bins = [0; 10];
    p.iter().for_each(|p| bins[((10.0 * p) as usize).min(9)] += 1);
    bins
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::Stream;
    use crate::math::random::Purpose;

    /// Values of tables: two-sided tails of Student's distribution.
    #[test]
    fn students_tails_are_those_of_tables() {
        for (t, freedom, p) in [
            (12.706_204_736, 1.0, 0.05),
            (2.228_138_852, 10.0, 0.05),
            (3.169_272_673, 10.0, 0.01),
            (4.586_894_0, 10.0, 0.001),
            (1.959_963_985, 1e9, 0.05),
            (2.0, 2.0, 0.183_503_419),
        ] {
            let found = student_tails(t, freedom);
            assert!((found / p - 1.0).abs() < 2e-6, "t {t}, {freedom} degrees: {found}, not {p}");
            assert!((student_quantile(p, freedom) / t - 1.0).abs() < 2e-6);
        }
        assert_eq!((student_tails(0.0, 5.0), student_tails(1e9, 50.0)), (1.0, 0.0));
    }

    /// Of equal means, however different their variances and counts, p-values are uniform; of means apart they are small.
    #[test]
    fn p_values_of_equal_means_are_uniform() {
        let mut stream = Stream::new(11, Purpose::Test, 0, 0);
        // A sum of uniform numbers: mean 0, variance 1.
        let mut normal = || (0..12).map(|_| stream.uniform()).sum::<f64>() - 6.0;
        let mut tests = |shift: f64| -> Vec<f64> {
            let mut draw = |count: usize, scale: f64, shift: f64| {
                let values: Vec<f64> = (0..count).map(|_| shift + scale * normal()).collect();
                Mean::of(values.iter().copied())
            };
            (0..2000).map(|_| Welch::test(&draw(8, 1.0, shift), &draw(24, 3.0, 0.0)).p).collect()
        };
        let (equal, apart) = (tests(0.0), tests(0.7));
        assert!(excess_of_small(&equal) > 0.01, "{:?}", histogram(&equal));
        assert!(histogram(&equal).iter().all(|&bin| (130..275).contains(&bin)), "{:?}", histogram(&equal));
        assert!(excess_of_small(&apart) < 1e-12 && holm(&equal, 1e-3) == 0);
        assert_eq!(holm(&[0.5, 1e-5, 4e-4, 0.9], 1e-3), 1);
        // By rounding only.
        let mean = |value| Mean { value, variance: 0.0, count: 8.0 };
        assert_eq!((Welch::test(&mean(1.0), &mean(1.0 + 1e-7)).p, Welch::test(&mean(1.0), &mean(1.1)).p), (1.0, 0.0));
    }
}
