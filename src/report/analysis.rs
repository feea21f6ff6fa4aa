//! What measures say: curves, slopes, the time to an error, ratios.

use crate::compare::results::{BudgetKind, Figure, Figures, Measured, Results, Variant};

/// What is drawn against time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Quantity {
    /// Root of the mean squared error.
    Rmse,
    /// Squared bias: the square of the mean error over seeds.
    Bias,
    /// Variance between seeds.
    Variance,
}

impl Quantity {
    /// The figure of a region.
    pub fn of(self, figures: &Figures) -> Option<Figure> {
        match self {
            Quantity::Rmse => Some(figures.rmse),
            Quantity::Bias => figures.bias2,
            Quantity::Variance => figures.variance,
        }
    }
}

/// A figure and where it was measured.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Point {
    /// Seconds of rendering until then, or the value of what is swept.
    pub at: f64,
    /// The value of the figure.
    pub value: f64,
    /// Its standard error, if known.
    pub error: Option<f64>,
}

impl Point {
    /// The largest value that is not unlikely, where the figure cannot be told from 0.
    pub fn limit(&self) -> Option<f64> {
        let error = self.error?;
        (self.value < 2.0 * error).then_some(self.value.max(0.0) + 2.0 * error)
    }
}

/// The points of a variant in a region, by time. An image that serves several budgets is one point; figures of runs
/// without time are none.
pub fn curve(variant: &Variant, region: usize, quantity: Quantity) -> Vec<Point> {
    let measured = variant.measures.iter().filter_map(|measure| measure.measured.as_ref());
    let mut points: Vec<Point> = measured
        .filter_map(|measured| {
            let figure = quantity.of(measured.regions.get(region)?)?;
            Some(Point { at: measured.seconds.value, value: figure.value, error: figure.error })
        })
        .filter(|point| point.at > 0.0 && point.at.is_finite() && point.value.is_finite())
        .collect();
    points.sort_by(|a, b| a.at.total_cmp(&b.at));
    points.dedup_by(|b, a| b.at == a.at);
    points
}

/// The exponent of a power law and its standard error, where those of the points are known: the line of least
/// squares through the logarithms. `None` with fewer than three points above 0.
pub fn slope(points: &[Point]) -> Option<Figure> {
    let logs: Vec<(f64, f64, Option<f64>)> = points
        .iter()
        .filter(|point| point.value > 0.0)
        .map(|point| (point.at.ln(), point.value.ln(), point.error.map(|error| error / point.value)))
        .collect();
    if logs.len() < 3 {
        return None;
    }
    let middle = logs.iter().map(|(t, ..)| t).sum::<f64>() / logs.len() as f64;
    let spread: f64 = logs.iter().map(|(t, ..)| (t - middle).powi(2)).sum();
    if spread == 0.0 {
        return None;
    }
    let weight = |t: f64| (t - middle) / spread;
    let value = logs.iter().map(|(t, e, _)| weight(*t) * e).sum();
    let variance: Option<f64> = logs.iter().map(|(t, _, error)| error.map(|error| (weight(*t) * error).powi(2))).sum();
    Some(Figure { value, error: variance.map(f64::sqrt) })
}

/// When a variant has come down to an error.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Reach {
    /// After so many seconds, between two measures.
    At(f64),
    /// It was there at its first measure.
    Before(f64),
    /// It was not there at its last measure.
    After(f64),
}

/// When the curve first is at `level`, interpolated as a power law between measures; `None` without measures.
pub fn time_to(points: &[Point], level: f64) -> Option<Reach> {
    let Some(k) = points.iter().position(|point| point.value <= level) else {
        return points.last().map(|last| Reach::After(last.at));
    };
    if k == 0 {
        return Some(Reach::Before(points[0].at));
    }
    let (a, b) = (points[k - 1], points[k]);
    // A value of 0 is met at its own time.
    let share = if b.value > 0.0 { (a.value / level).ln() / (a.value / b.value).ln() } else { 1.0 };
    Some(Reach::At(a.at * (b.at / a.at).powf(share)))
}

/// The value at a time, interpolated as a power law; `None` outside the measures.
pub fn value_at(points: &[Point], seconds: f64) -> Option<f64> {
    let k = points.iter().position(|point| point.at >= seconds)?;
    let b = points[k];
    if b.at == seconds {
        return Some(b.value);
    }
    let a = points[k.checked_sub(1)?];
    let share = (seconds / a.at).ln() / (b.at / a.at).ln();
    Some(if a.value > 0.0 && b.value > 0.0 {
        a.value * (b.value / a.value).powf(share)
    } else {
        (1.0 - share) * a.value + share * b.value
    })
}

/// How many times as fast, or on which side of that.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Speedup {
    /// So many times.
    Exactly(f64),
    /// At least so many times.
    AtLeast(f64),
    /// At most so many times.
    AtMost(f64),
}

/// How much sooner `own` is than `other`; `None` where the measures do not tell.
pub fn speedup(own: Reach, other: Reach) -> Option<Speedup> {
    use Reach::{After, At, Before};
    match (own, other) {
        (At(own), At(other)) => Some(Speedup::Exactly(other / own)),
        (At(own) | Before(own), After(other)) | (Before(own), At(other)) => Some(Speedup::AtLeast(other / own)),
        (At(own) | After(own), Before(other)) | (After(own), At(other)) => Some(Speedup::AtMost(other / own)),
        (After(_), After(_)) | (Before(_), Before(_)) => None,
    }
}

/// The variant that others are compared with: the first path tracer, else the first of all.
pub fn baseline(results: &Results) -> usize {
    results.variants.iter().position(|variant| variant.method == "path").unwrap_or(0)
}

/// The budget at which variants are compared in one table: the last that the most of them reached.
pub fn common_budget(results: &Results) -> Option<usize> {
    let reached = |k: usize| results.variants.iter().filter(|variant| measured(variant, k).is_some()).count();
    (0..results.study.budgets.values.len()).filter(|&k| reached(k) > 0).max_by_key(|&k| (reached(k), k))
}

/// What was found at budget `k`.
pub fn measured(variant: &Variant, k: usize) -> Option<&Measured> {
    variant.measures.get(k)?.measured.as_ref()
}

/// The last budget that the variant reached, and what was found there.
pub fn last_measured(variant: &Variant) -> Option<(usize, &Measured)> {
    variant.measures.iter().enumerate().rev().find_map(|(k, measure)| Some((k, measure.measured.as_ref()?)))
}

/// The time at which variants are compared. A budget in seconds is one; with budgets in samples, the last of all times of
/// measures between whose own measures most variants lie.
pub fn common_time(results: &Results) -> Option<f64> {
    match results.study.budgets.kind {
        BudgetKind::Seconds => results.study.budgets.values.get(common_budget(results)?).copied(),
        BudgetKind::Samples => {
            let curves: Vec<Vec<Point>> =
                results.variants.iter().map(|variant| curve(variant, 0, Quantity::Rmse)).collect();
            let known = |time: f64| curves.iter().filter(|points| value_at(points, time).is_some()).count();
            let times = curves.iter().flatten().map(|point| (known(point.at), point.at));
            times.max_by(|a, b| a.0.cmp(&b.0).then(a.1.total_cmp(&b.1))).map(|(_, time)| time)
        }
    }
}

/// The RMSE of a variant at [`common_time`] in a region.
pub fn error_at_common_time(results: &Results, variant: &Variant, region: usize) -> Option<f64> {
    match results.study.budgets.kind {
        BudgetKind::Seconds => Some(measured(variant, common_budget(results)?)?.regions.get(region)?.rmse.value),
        BudgetKind::Samples => value_at(&curve(variant, region, Quantity::Rmse), common_time(results)?),
    }
}

/// The error at which to compare times: of those that were measured, rounded up to two digits, the smallest at which the
/// most variants have a time and not only a bound of it. `None` without errors above 0.
pub fn common_level(results: &Results, region: usize) -> Option<f64> {
    let curves: Vec<Vec<Point>> =
        results.variants.iter().map(|variant| curve(variant, region, Quantity::Rmse)).collect();
    let rounded = |value: f64| {
        let unit = 10f64.powf(value.log10().floor() - 1.0);
        (value / unit - 1e-9).ceil() * unit
    };
    let known =
        |level: f64| curves.iter().filter(|points| matches!(time_to(points, level), Some(Reach::At(_)))).count();
    let levels = curves.iter().flatten().map(|point| point.value).filter(|value| *value > 0.0).map(rounded);
    levels
        .map(|level| (known(level), level))
        .max_by(|a, b| a.0.cmp(&b.0).then(b.1.total_cmp(&a.1)))
        .map(|(_, level)| level)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn points(list: &[(f64, f64)]) -> Vec<Point> {
        list.iter().map(|&(at, value)| Point { at, value, error: Some(0.1 * value) }).collect()
    }

    #[test]
    fn power_laws_are_recovered() {
        let law = |t: f64| (t, 0.3 * t.powf(-0.5));
        let curve = points(&[law(1.0), law(2.0), law(4.0), law(8.0)]);
        let found = slope(&curve).unwrap();
        // ln t is 0, 1, 2, 3 times ln 2: the squares of the weights sum to 1/(5 ln² 2).
        let expected = 0.1 / (5f64.sqrt() * 2f64.ln());
        assert!((found.value + 0.5).abs() < 1e-12 && (found.error.unwrap() - expected).abs() < 1e-12);
        let Some(Reach::At(time)) = time_to(&curve, 0.3 * 3f64.powf(-0.5)) else { panic!() };
        assert!((time - 3.0).abs() < 1e-9);
        assert!((value_at(&curve, 5.0).unwrap() - 0.3 * 5f64.powf(-0.5)).abs() < 1e-12);
        assert_eq!((value_at(&curve, 9.0), value_at(&curve, 0.5)), (None, None));
        assert_eq!(time_to(&curve, 0.4), Some(Reach::Before(1.0)));
        assert_eq!(time_to(&curve, 0.01), Some(Reach::After(8.0)));
        assert_eq!((time_to(&[], 1.0), slope(&curve[..2])), (None, None));
        // Without error there is nothing to interpolate.
        assert_eq!(time_to(&points(&[(1.0, 1.0), (2.0, 0.0)]), 0.5), Some(Reach::At(2.0)));
    }

    #[test]
    fn speedups_say_what_is_known() {
        use Reach::{After, At, Before};
        assert_eq!(speedup(At(2.0), At(8.0)), Some(Speedup::Exactly(4.0)));
        assert_eq!(speedup(At(2.0), After(8.0)), Some(Speedup::AtLeast(4.0)));
        assert_eq!(speedup(Before(2.0), At(8.0)), Some(Speedup::AtLeast(4.0)));
        assert_eq!(speedup(After(8.0), At(2.0)), Some(Speedup::AtMost(0.25)));
        assert_eq!(speedup(At(8.0), Before(2.0)), Some(Speedup::AtMost(0.25)));
        assert_eq!((speedup(After(1.0), After(2.0)), speedup(Before(1.0), Before(2.0))), (None, None));
    }
}
