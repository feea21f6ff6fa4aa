//! The page of a sweep: curves of error and cost against the key that is swept, and a table of all points.

use maud::{DOCTYPE, Markup, PreEscaped, html};

use super::analysis::Point;
use super::number::{count, digits, short, time, with_error};
use super::page::{colours, key};
use super::plot::{self, Across, Line, Plot};
use crate::Result;
use crate::compare::results::{BudgetKind, Figure};
use crate::compare::sweep::{Found, Sweep};

/// A curve's file, what is said of it, and itself.
type Curve = (&'static str, &'static str, Markup);
/// What a curve shows of what was found.
type Shown = fn(&Found) -> Option<Figure>;

const CURVES: [(&str, &str, &str, Shown); 4] = [
    (
        "error",
        "relative error",
        "√relmse against the reference of each point; what the reference is uncertain by is taken off.",
        Found::error,
    ),
    (
        "share",
        "mean / reference",
        "The mean of the picture as a share of the reference's: 1 without bias; bars are standard errors over seeds.",
        Found::share,
    ),
    ("cost", "CPU seconds", "What it took, photons and maps included.", |found| found.cpu_seconds),
    ("work", "relmse · CPU seconds", "Error times cost: a better estimate has less, however long it takes.", |found| {
        found.work().map(|value| Figure { value, error: None })
    }),
];

/// The curves of a sweep, those that there are points for.
pub fn curves(sweep: &Sweep) -> Result<Vec<Curve>> {
    let values = &sweep.range.values;
    let ends = values.first().copied().zip(values.last().copied());
    let logarithmic = sweep.range.geometric && values.iter().all(|value| *value > 0.0);
    let across = Across { name: &sweep.range.key, unit: "", logarithmic, ends };
    let mut curves = Vec::new();
    for (file, quantity, what, shown) in CURVES {
        let point = |value: f64, found: &Found| {
            let Figure { value: figure, error } = shown(found)?;
            figure.is_finite().then_some(Point { at: value, value: figure, error })
        };
        let lines = sweep.variants.iter().enumerate().map(|(k, variant)| {
            let mut points: Vec<Point> =
                variant.points.iter().filter_map(|swept| point(swept.value, swept.found.as_ref()?)).collect();
            points.sort_by(|a, b| a.at.total_cmp(&b.at));
            Line::new(&variant.name, k, points)
        });
        let lines = lines.filter(|line| !line.points.is_empty()).collect();
        if let Some(curve) = plot::draw(&Plot { across, quantity, lines, guide: false, range: None, named: true })? {
            curves.push((file, what, curve));
        }
    }
    Ok(curves)
}

/// The whole page.
pub fn page(sweep: &Sweep, curves: &[Curve]) -> String {
    let title = format!("{}: {} swept", sweep.scene, sweep.range.key);
    html! {
        (DOCTYPE)
        html lang="en" {
            head {
                meta charset="utf-8";
                meta name="viewport" content="width=device-width, initial-scale=1";
                meta name="color-scheme" content="light dark";
                title { (title) }
                link rel="icon" href="data:,";
                style { (PreEscaped(include_str!("style.css"))) (colours(sweep.variants.len())) }
            }
            body {
                header {
                    p.kind { "volpm compare --sweep" }
                    h1 { (title) }
                    p { (circumstances(sweep)) }
                    @if !sweep.complete {
                        p.notice role="note" { strong { "Interrupted. " } "This shows what was measured until then." }
                    }
                }
                main {
                    section #curves {
                        h2 { "Curves" }
                        @for (_, what, curve) in curves { figure.curve-figure { (curve) figcaption { (what) } } }
                    }
                    section #points { h2 { "All points" } (table(sweep)) }
                }
            }
        }
    }
    .into_string()
}

fn circumstances(sweep: &Sweep) -> Markup {
    let budget = sweep.budgets.values.first().copied().unwrap_or_default();
    html! {
        @match sweep.budgets.kind {
            BudgetKind::Seconds => (time(budget)),
            BudgetKind::Samples => { (count(budget as u64)) " samples per pixel" }
        }
        ", " (sweep.seeds) @if sweep.seeds == 1 { " seed" } @else { " seeds" }
        ", " (sweep.threads) @if sweep.threads == 1 { " thread" } @else { " threads" }
        @if let Some(cpu) = &sweep.machine.cpu { " of " (cpu) }
        @for setting in &sweep.set { ", " code { (setting.key) " = " (setting.value) } }
        ". Figures: " a href="sweep.json" { "sweep.json" } ", " a href="sweep.csv" { "sweep.csv" } "."
    }
}

fn table(sweep: &Sweep) -> Markup {
    let figure =
        |figure: Option<Figure>| figure.map_or("–".to_string(), |Figure { value, error }| with_error(value, error));
    html! {
        div.wide { table.measures {
            thead { tr {
                @for title in [sweep.range.key.as_str(), "variant", "mean / reference", "relative error", "CPU seconds", "relmse · CPU seconds", "reference", "error of its pixels", "notes"] {
                    th scope="col" { (title) }
                }
            } }
            @for (index, value) in sweep.range.values.iter().enumerate() {
                tbody { @for (k, variant) in sweep.variants.iter().enumerate() { @if let Some(point) = variant.points.get(index) { tr {
                    @if k == 0 { th scope="rowgroup" rowspan=(sweep.variants.len()) { (short(*value)) } }
                    th scope="row" { (key(&variant.name, k)) }
                    @match &point.found {
                        Some(found) => {
                            td { (figure(found.share())) } td { (figure(found.error())) } td { (figure(found.cpu_seconds)) }
                            td { (found.work().map_or("–".to_string(), |work| digits(work, 3))) }
                            td { (digits(found.reference, 4)) }
                            td { (found.reference_error.map_or("–".to_string(), |error| format!("{} %", digits(100.0 * error, 2)))) }
                        }
                        None => { @for _ in 0..6 { td { "–" } } }
                    }
                    td.text { (point.notes.join("; ")) }
                } } } }
            }
        } }
    }
}
