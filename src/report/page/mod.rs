//! The page. Every text that is put into it is escaped by the templates.

mod images;
mod summary;
mod tables;

use maud::{DOCTYPE, Markup, PreEscaped, Render, html};
use serde_json::json;

use super::analysis::{Point, Quantity, Reach, baseline, common_budget, common_level, curve, error_at_common_time};
use super::number::{count, digits, short, time, with_error};
use super::pictures::Pictures;
use super::plot::{self, Across, Line, Plot, dashes, marker};
use crate::Result;
use crate::compare::results::{BudgetKind, Figure, Results, Setting};

/// The plots of a region.
pub struct Curves {
    /// RMSE against time.
    pub error: Option<Markup>,
    bias: Option<Markup>,
    variance: Option<Markup>,
}

impl Curves {
    /// Draws error, squared bias and variance of all variants over time, in one region.
    pub fn draw(results: &Results, region: usize) -> Result<Curves> {
        let whole = region == 0;
        let lines = |quantity: Quantity| -> Vec<Line<'_>> {
            let variants = results.variants.iter().enumerate();
            variants
                .map(|(k, variant)| Line::new(&variant.name, k, curve(variant, region, quantity)))
                .filter(|line| !line.points.is_empty())
                .collect()
        };
        let (bias, variance) = (lines(Quantity::Bias), lines(Quantity::Variance));
        // Both on one scale, so that they can be compared.
        let values = || {
            let points = bias.iter().chain(&variance).flat_map(|line| &line.points);
            points.map(|point| point.limit().unwrap_or(point.value)).filter(|value| *value > 0.0)
        };
        let range = values().min_by(f64::total_cmp).zip(values().max_by(f64::total_cmp));
        let across = Across::SECONDS;
        let small = |quantity, lines| plot::draw(&Plot { across, quantity, lines, guide: false, range, named: false });
        Ok(Curves {
            error: plot::draw(&Plot {
                across,
                quantity: "RMSE",
                lines: lines(Quantity::Rmse),
                guide: true,
                range: None,
                named: whole,
            })?,
            bias: small("bias²", bias)?,
            variance: small("variance", variance)?,
        })
    }
}

/// The whole page.
pub fn page(results: &Results, pictures: &Pictures, curves: &Curves) -> Result<String> {
    let page = Page { results, pictures, baseline: baseline(results), level: common_level(results, 0) };
    let regions = (1..results.regions.len())
        .map(|region| Ok((region, Curves::draw(results, region)?)))
        .collect::<Result<Vec<_>>>()?;
    let name = results.scene.title.as_deref().unwrap_or(&results.scene.path);
    let data = serde_json::to_string(&page.data()).unwrap_or_default().replace('<', "\\u003c");
    let page = html! {
        (DOCTYPE)
        html lang="en" {
            head {
                meta charset="utf-8";
                meta name="viewport" content="width=device-width, initial-scale=1";
                meta name="color-scheme" content="light dark";
                title { "Error against time: " (name) }
                link rel="icon" href="data:,";
                style { (PreEscaped(include_str!("../style.css"))) (colours(results.variants.len())) }
            }
            body {
                header {
                    p.kind { "volpm compare" }
                    h1 { (name) }
                    p { (page.circumstances()) }
                    (page.notices())
                    nav aria-label="Sections" {
                        @for (place, title) in [
                            ("summary", "Summary"), ("time", "Error against time"), ("images", "Images"), ("crops", "Crops"),
                            ("measures", "All measures"), ("cost", "Photons and memory"), ("scene", "Scene and machine"),
                        ] { a href={ "#" (place) } { (title) } }
                    }
                }
                main {
                    section #summary { h2 { "Summary" } (page.summary()) }
                    section #time { h2 { "Error against time" } (page.time(curves)) }
                    section #images { h2 { "Images" } (page.viewer()) (page.gallery()) }
                    section #crops { h2 { "Crops" } (page.crops(&regions)) }
                    section #measures { h2 { "All measures" } (page.measures(0)) (page.tuning()) }
                    section #cost { h2 { "Photons and memory" } (page.cost()) }
                    section #scene { h2 { "Scene and machine" } (page.reference()) (page.scene()) (page.machine()) }
                }
                script type="application/json" id="data" { (PreEscaped(data)) }
                script { (PreEscaped(include_str!("../script.js"))) }
            }
        }
    };
    Ok(page.into_string())
}

/// What the parts of the page are made of.
struct Page<'r> {
    results: &'r Results,
    pictures: &'r Pictures,
    /// The variant that others are compared with.
    baseline: usize,
    /// The error whose times are compared.
    level: Option<f64>,
}

/// What is not there.
const NONE: PreEscaped<&str> = PreEscaped("<span class=\"none\">–</span>");

impl Render for Figure {
    fn render(&self) -> Markup {
        html! { (with_error(self.value, self.error)) }
    }
}

/// Something, or a dash.
fn or_none(value: Option<impl Render>) -> Markup {
    html! { @match value { Some(value) => (value), None => (NONE) } }
}

/// A variant's name with its line and marker.
fn named(results: &Results, variant: usize) -> Markup {
    key(&results.variants[variant].name, variant)
}

/// The name of the variant of this number with its line and marker.
pub fn key(name: &str, variant: usize) -> Markup {
    let dash =
        dashes(variant).split(' ').map(|length| length.parse::<f64>().map_or("none".into(), |l| (2.0 * l).to_string()));
    html! {
        span.variant style={ "--c: var(--v" (variant) ")" } {
            svg.key viewBox="0 0 30 12" width="30" height="12" aria-hidden="true" {
                path d="M0 6H30" stroke-dasharray=(dash.collect::<Vec<_>>().join(" ")) {}
                path.dot d=(marker(variant, 15.0, 6.0, 4.0)) {}
            }
            (name)
        }
    }
}

fn settings(settings: &[Setting]) -> Markup {
    html! { @for (k, Setting { key, value }) in settings.iter().enumerate() { @if k > 0 { ", " } code { (key) " = " (value) } } }
}

/// Variables of style sheets, for so many variants.
pub fn colours(count: usize) -> Markup {
    let colours = (0..count).map(|k| format!("--v{k}:{};", plot::colour(k)));
    html! { ":root{" (colours.collect::<String>()) "}" }
}

/// A ratio.
fn times(ratio: f64) -> String {
    format!("{} ×", digits(ratio, 2))
}

impl Page<'_> {
    fn budget_name(&self, k: usize) -> String {
        let value = self.results.study.budgets.values.get(k).copied().unwrap_or_default();
        match self.results.study.budgets.kind {
            BudgetKind::Seconds => time(value),
            BudgetKind::Samples if value == 1.0 => "1 sample".into(),
            BudgetKind::Samples => format!("{} samples", count(value as u64)),
        }
    }

    fn circumstances(&self) -> Markup {
        let Results { scene, study, threads, machine, .. } = self.results;
        let seeds = study.seeds.len();
        html! {
            (scene.width) " × " (scene.height) " pixels"
            @if let Some(layer) = &study.layer { ", layer " (layer) }
            ", " (seeds) @if seeds == 1 { " seed" } @else { " seeds" }
            ", " (threads) @if *threads == 1 { " thread" } @else { " threads" }
            @if let Some(cpu) = &machine.cpu { " of " (cpu) }
            @if study.same_map.is_some() { ", one photon map for all" }
            ". Figures: " a href="results.json" { "results.json" } ", " a href="results.csv" { "results.csv" } "."
        }
    }

    fn notices(&self) -> Markup {
        html! {
            @if !self.results.complete {
                p.notice role="note" { strong { "Interrupted. " } "This shows what was measured until then." }
            }
            @for warning in &self.results.warnings { p.notice role="note" { (warning) } }
        }
    }

    fn curve(&self, variant: usize) -> Vec<Point> {
        curve(&self.results.variants[variant], 0, Quantity::Rmse)
    }

    fn time(&self, curves: &Curves) -> Markup {
        let seconds = "Time is that of photons, map and pixels: neither loading nor measuring nor this report.";
        html! {
            @match &curves.error {
                Some(plot) => {
                    figure.curve-figure {
                        (plot)
                        figcaption {
                            "RMSE over the whole image; bars are standard errors over seeds. The dotted line has slope −1/2. " (seconds)
                            " Also as " a href="curve.svg" { "curve.svg" } "."
                        }
                    }
                    @if self.level.is_some() {
                        p.needs-script hidden {
                            label for="level" { "Error to reach" }
                            " "
                            input #level type="range" step="any";
                            " " output #level-output for="level" {}
                            " – times and speed-ups in the " a href="#summary" { "summary" } " follow:"
                            " " span #level-times {}
                        }
                    }
                }
                None => p { "No error above 0 was measured." },
            }
            h3 { "Bias² and variance against time" }
            @if curves.bias.is_none() && curves.variance.is_none() {
                p { "Bias and variance can be told apart with two seeds or more (" code { "--seeds" } ")." }
            } @else {
                (self.small_plots(&[("Bias²", &curves.bias), ("Variance", &curves.variance)]))
                p.note {
                    "Variance falls with more samples; what is left is bias. Hollow marks: below two standard errors, the "
                    "value is likely to be lower than the mark."
                }
            }
        }
    }

    fn small_plots(&self, plots: &[(&str, &Option<Markup>)]) -> Markup {
        html! {
            div.plots {
                @for (name, plot) in plots {
                    @if let Some(plot) = plot { figure { (plot) figcaption { (name) } } }
                }
            }
            p.legend { @for k in 0..self.results.variants.len() { (named(self.results, k)) " " } }
        }
    }

    /// What the script works with.
    fn data(&self) -> serde_json::Value {
        let variants =
            self.results.variants.iter().zip(&self.pictures.variants).enumerate().map(|(k, (variant, drawn))| {
                let points: Vec<_> = self.curve(k).iter().map(|point| [point.at, point.value]).collect();
                let budgets: Vec<_> = drawn
                    .budgets
                    .iter()
                    .map(|shown| {
                        shown.as_ref().map(|shown| {
                            json!({
                                "image": shown.image,
                                "mean": shown.mean,
                                "flip": shown.maps.as_ref().map(|maps| &maps.flip),
                                "error": shown.maps.as_ref().map(|maps| &maps.error),
                                "meanError": shown.mean_error,
                            })
                        })
                    })
                    .collect();
                json!({ "name": variant.name, "points": points, "limit": drawn.limit, "budgets": budgets })
            });
        let best = {
            let errors = self.results.variants.iter().map(|variant| error_at_common_time(self.results, variant, 0));
            errors
                .enumerate()
                .filter_map(|(k, error)| Some((k, error?)))
                .min_by(|a, b| a.1.total_cmp(&b.1))
                .map(|(k, _)| k)
        };
        json!({
            "variants": variants.collect::<Vec<_>>(),
            "reference": self.pictures.reference,
            "baseline": self.baseline,
            "best": best,
            "budget": common_budget(self.results),
            "level": self.level,
        })
    }
}

/// A share in per cent.
fn percent(share: f64) -> String {
    format!("{} %", if share >= 0.01 { short(100.0 * share) } else { digits(100.0 * share, 2) })
}

/// When an error was reached.
fn reached(reach: Reach) -> String {
    match reach {
        Reach::At(seconds) => time(seconds),
        Reach::Before(seconds) => format!("< {}", time(seconds)),
        Reach::After(seconds) => format!("> {}", time(seconds)),
    }
}
