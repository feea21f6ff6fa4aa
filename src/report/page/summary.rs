//! The answer in a few sentences, and the table it was read from.

use maud::{Markup, html};

use super::{Page, named, or_none, percent, reached, times};
use crate::compare::results::{BudgetKind, Figures};
use crate::report::analysis::{
    Point, Speedup, common_budget, common_time, error_at_common_time, last_measured, measured, slope, speedup, time_to,
};
use crate::report::number::{digits, short, time};

impl Page<'_> {
    /// The answer in a few sentences, then the table it was read from.
    pub(super) fn summary(&self) -> Markup {
        let results = self.results;
        let errors: Vec<Option<f64>> =
            results.variants.iter().map(|variant| error_at_common_time(results, variant, 0)).collect();
        let mut order: Vec<(usize, f64)> =
            errors.iter().enumerate().filter_map(|(k, error)| Some((k, (*error)?))).collect();
        order.sort_by(|a, b| a.1.total_cmp(&b.1));
        let (Some(&(best, least)), Some(common)) = (order.first(), common_time(results)) else {
            return html! { p { "Nothing was measured." } };
        };
        let base = errors[self.baseline];
        let budget = common_budget(results);
        // Where budgets are no times, figures other than the RMSE are those of one of them.
        let (at_budget, missing) = match (results.study.budgets.kind, budget) {
            (BudgetKind::Samples, Some(k)) => (format!(" at {}", self.budget_name(k)), "not measured"),
            _ => (String::new(), "not reached"),
        };
        html! {
            p.verdict {
                "After " strong { (time(common)) } ", " strong { (results.variants[best].name) } " has the smallest error, RMSE "
                (digits(least, 3))
                @for (k, (other, error)) in order.iter().skip(1).enumerate() {
                    @if k == 0 { "; " } @else if k + 2 == order.len() { " and " } @else { ", " }
                    (results.variants[*other].name) " has "
                    @if least > 0.0 { (times(error / least)) } @else { (digits(*error, 3)) }
                    @if k == 0 { " as much" }
                }
                "."
            }
            (self.why())
            div.wide { table {
                caption {
                    "RMSE over the whole image. "
                    "Error and speed are compared with " (results.variants[self.baseline].name) ": × above 1 is better."
                }
                thead { tr {
                    th scope="col" { "variant" }
                    th scope="col" { "RMSE at " (time(common)) }
                    th scope="col" { "less error" }
                    th scope="col" { "relative error" (at_budget) }
                    th scope="col" { "FLIP" (at_budget) }
                    th scope="col" { "bias² of MSE" (at_budget) }
                    th scope="col" { "slope" }
                    th scope="col" { "time to RMSE " span.level-value { (or_none(self.level.map(short))) } }
                    th scope="col" { "faster" }
                } }
                tbody {
                    @for (k, variant) in results.variants.iter().enumerate() {
                        @let at = budget.and_then(|budget| Some((budget, measured(variant, budget)?)));
                        @let figures = at.and_then(|(_, measured)| measured.regions.first());
                        tr.best[k == best] data-row=(k) {
                            th scope="row" { (named(results, k)) }
                            td {
                                @match (results.study.budgets.kind, figures, errors[k]) {
                                    (BudgetKind::Seconds, Some(figures), _) => (figures.rmse),
                                    (_, _, Some(error)) => (digits(error, 3)),
                                    _ => span.none { (missing) },
                                }
                            }
                            td { (or_none(errors[k].zip(base).filter(|(own, _)| *own > 0.0).map(|(own, base)| times(base / own)))) }
                            td { (or_none(figures.and_then(|figures| figures.relmse).map(|figure| percent(figure.value.max(0.0).sqrt())))) }
                            td { (or_none(at.and_then(|(budget, _)| self.flip(k, budget)).map(|flip| digits(flip, 3)))) }
                            td { (or_none(figures.and_then(Self::share_of_bias).map(Share::told))) }
                            td { (or_none(slope(&self.curve(k)))) }
                            @let reach = self.level.and_then(|level| time_to(&self.curve(k), level));
                            td.reach { (or_none(reach.map(reached))) }
                            td.faster { (or_none(self.faster(k))) }
                        }
                    }
                }
            } }
            details {
                summary { "What the columns mean" }
                dl {
                    dt { "RMSE" } dd { "root of the mean squared error over pixels and channels, less the reference's own variance; ± is the standard error over seeds." }
                    dt { "relative error" } dd { "root of relMSE, ⟨(I − R)²/(R² + 0.01 M²)⟩, M the reference's mean." }
                    dt { "FLIP" } dd { "mean difference that one sees when flipping between image and reference (Andersson and others 2020), of the first seed." }
                    dt { "bias² of MSE" } dd { "the share of the squared error that more samples of the same settings would not remove; the rest is variance. Needs two seeds; < is two standard errors above what cannot be told from 0." }
                    dt { "slope" } dd { "the exponent p of RMSE ∝ timeᵖ, by least squares over all measures; −0.5 where only independent samples are added." }
                    dt { "time to RMSE" } dd { "interpolated between measures; < and > where the error was already or not yet there." }
                }
            }
        }
    }

    /// The share of squared bias in the squared error, if both are known: itself, or where it cannot be told from 0
    /// what it is likely below.
    fn share_of_bias(figures: &Figures) -> Option<Share> {
        let (bias, variance) = (figures.bias2?, figures.variance?.value);
        let point = Point { at: 0.0, value: bias.value, error: bias.error };
        let of = |bias: f64| bias / (bias + variance);
        match point.limit() {
            Some(limit) if limit > 0.0 => Some(Share::Below(of(limit))),
            None if bias.value > 0.0 => Some(Share::Is(of(bias.value))),
            _ => (variance > 0.0).then_some(Share::Is(0.0)),
        }
    }

    /// What keeps variants from being better.
    fn why(&self) -> Markup {
        let results = self.results;
        let shares: Vec<(usize, Share)> = results
            .variants
            .iter()
            .enumerate()
            .filter_map(|(k, variant)| Some((k, Self::share_of_bias(last_measured(variant)?.1.regions.first()?)?)))
            .collect();
        let list = |told: &dyn Fn(Share) -> Option<String>| -> String {
            let told = shares.iter().filter_map(|(k, share)| Some((k, told(*share)?)));
            told.map(|(k, share)| format!("{} ({share})", results.variants[*k].name)).collect::<Vec<_>>().join(", ")
        };
        let biased = list(&|share| match share {
            Share::Is(share) if share >= 0.5 => Some(percent(share)),
            _ => None,
        });
        let noisy = list(&|share| match share {
            Share::Is(share) if share < 0.5 => Some(percent(1.0 - share)),
            Share::Below(share) if share < 0.5 => Some(format!("> {}", percent(1.0 - share))),
            _ => None,
        });
        html! {
            @if !biased.is_empty() || !noisy.is_empty() {
                p {
                    "At the last measures, "
                    @if !biased.is_empty() { "bias is most of the squared error of " (biased) }
                    @if !biased.is_empty() && !noisy.is_empty() { "; " }
                    @if !noisy.is_empty() { "variance is most of the squared error of " (noisy) }
                    "."
                }
            }
        }
    }

    pub(super) fn flip(&self, variant: usize, budget: usize) -> Option<f64> {
        let shown = self.pictures.variants.get(variant)?.budgets.get(budget)?.as_ref()?;
        Some(shown.maps.as_ref()?.flip_mean)
    }

    fn faster(&self, variant: usize) -> Option<String> {
        if variant == self.baseline {
            return Some("1 ×".into());
        }
        let reach = |k: usize| time_to(&self.curve(k), self.level?);
        Some(match speedup(reach(variant)?, reach(self.baseline)?)? {
            Speedup::Exactly(ratio) => times(ratio),
            Speedup::AtLeast(ratio) => format!("> {}", times(ratio)),
            Speedup::AtMost(ratio) => format!("< {}", times(ratio)),
        })
    }
}

/// A share of something, or what it is below.
#[derive(Clone, Copy)]
enum Share {
    Is(f64),
    Below(f64),
}

impl Share {
    fn told(self) -> String {
        match self {
            Share::Is(share) => percent(share),
            Share::Below(share) => format!("< {}", percent(share)),
        }
    }
}
