//! The page. Every text that is put into it is escaped by the templates.

use maud::{DOCTYPE, Markup, PreEscaped, Render, html};
use serde_json::json;

use super::analysis::{
    Point, Quantity, Reach, Speedup, baseline, common_budget, common_level, common_time, curve, error_at_common_time,
    last_measured, measured, slope, speedup, time_to,
};
use super::number::{bytes, count, digits, short, time, with_error};
use super::pictures::{Pictures, Shown};
use super::plot::{self, Line, Plot, dashes, marker};
use crate::Result;
use crate::compare::results::{BudgetKind, Figure, Figures, Reference, ReferenceKind, Results, Setting, Variant};
use crate::image::Palette;

/// The plots of a region.
pub struct Curves {
    /// RMSE.
    pub error: Option<Markup>,
    bias: Option<Markup>,
    variance: Option<Markup>,
}

impl Curves {
    /// Draws them.
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
        let small = |quantity, lines| plot::draw(&Plot { quantity, lines, guide: false, range, named: false });
        Ok(Curves {
            error: plot::draw(&Plot {
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
                style { (PreEscaped(include_str!("style.css"))) (page.colours()) }
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
                script { (PreEscaped(include_str!("script.js"))) }
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
    let dash =
        dashes(variant).split(' ').map(|length| length.parse::<f64>().map_or("none".into(), |l| (2.0 * l).to_string()));
    html! {
        span.variant style={ "--c: var(--v" (variant) ")" } {
            svg.key viewBox="0 0 30 12" width="30" height="12" aria-hidden="true" {
                path d="M0 6H30" stroke-dasharray=(dash.collect::<Vec<_>>().join(" ")) {}
                path.dot d=(marker(variant, 15.0, 6.0, 4.0)) {}
            }
            (results.variants[variant].name)
        }
    }
}

fn settings(settings: &[Setting]) -> Markup {
    html! { @for (k, Setting { key, value }) in settings.iter().enumerate() { @if k > 0 { ", " } code { (key) " = " (value) } } }
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

    /// Variables of style sheets.
    fn colours(&self) -> Markup {
        let colours = (0..self.results.variants.len()).map(|k| format!("--v{k}:{};", plot::colour(k)));
        html! { ":root{" (colours.collect::<String>()) "}" }
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

    /// The share of squared bias in the squared error, if both are known: itself, or where it cannot be told from 0
    /// what it is likely below.
    fn share_of_bias(figures: &Figures) -> Option<Share> {
        let (bias, variance) = (figures.bias2?, figures.variance?.value);
        let point = Point { seconds: 0.0, value: bias.value, error: bias.error };
        let of = |bias: f64| bias / (bias + variance);
        match point.limit() {
            Some(limit) if limit > 0.0 => Some(Share::Below(of(limit))),
            None if bias.value > 0.0 => Some(Share::Is(of(bias.value))),
            _ => (variance > 0.0).then_some(Share::Is(0.0)),
        }
    }

    fn curve(&self, variant: usize) -> Vec<Point> {
        curve(&self.results.variants[variant], 0, Quantity::Rmse)
    }

    /// The answer in a few sentences, then the table it was read from.
    fn summary(&self) -> Markup {
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

    fn flip(&self, variant: usize, budget: usize) -> Option<f64> {
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

    fn bar(&self, palette: Palette) -> Markup {
        let stops: Vec<String> = palette.stops().iter().map(|[r, g, b]| format!("rgb({r} {g} {b})")).collect();
        let (name, labels) = match palette {
            Palette::Magma => ("FLIP", ["0".to_string(), "0.5".into(), "1".into()]),
            Palette::Diverging => {
                let range = percent(self.pictures.range);
                ("signed error", [format!("−{range} too dark"), "0".into(), format!("+{range} too bright")])
            }
        };
        html! {
            div.bar role="img" aria-label={ "Colours of " (name) " from " (labels[0]) " to " (labels[2]) } {
                span { (name) }
                div style={ "background: linear-gradient(90deg, " (stops.join(", ")) ")" } {}
                @for label in &labels { span { (label) } }
            }
        }
    }

    /// Two pictures over each other. Filled by the script; without it, the gallery shows all.
    fn viewer(&self) -> Markup {
        let measured = self.pictures.variants.iter().any(|variant| variant.last().is_some());
        let select = |id: &str, label: &str, options: Markup| {
            html! { label { (label) " " select id=(id) { (options) } } }
        };
        let variants = html! {
            @for (k, variant) in self.results.variants.iter().enumerate() { option value=(k) { (variant.name) } }
            option value="reference" { "reference" }
        };
        let kinds = [
            ("image", "image"),
            ("mean", "mean over seeds"),
            ("flip", "FLIP"),
            ("error", "signed error"),
            ("meanError", "signed error of the mean"),
        ];
        html! {
            @if measured {
                div #viewer.needs-script hidden {
                    div.controls {
                        (select("left", "left", variants.clone()))
                        (select("right", "right", variants))
                        (select("budget", "at", html! {
                            @for k in 0..self.results.study.budgets.values.len() { option value=(k) { (self.budget_name(k)) } }
                        }))
                        (select("kind", "show", html! { @for (value, name) in kinds { option value=(value) { (name) } } }))
                        button #flip type="button" aria-pressed="false" { "flip " kbd { "F" } }
                        button #zoom type="button" { "zoom " kbd { "Z" } " " span #zoom-value { "1×" } }
                    }
                    div #stage tabindex="0" role="group" aria-label="Two pictures, divided by the slider"
                        style={ "--w:" (self.results.scene.width) ";--h:" (self.results.scene.height) } {
                        div.layers {
                            img #below alt="";
                            img #above alt="";
                            div #handle {}
                        }
                        p.tag #left-tag {}
                        p.tag #right-tag {}
                    }
                    input #split type="range" min="0" max="100" value="50" step="0.5" aria-label="Where the left picture ends";
                    div data-bar="error" hidden { (self.bar(Palette::Diverging)) }
                    div data-bar="flip" hidden { (self.bar(Palette::Magma)) }
                    p.keys {
                        kbd { "F" } " or " kbd { "Space" } " shows left and right in turn; " kbd { "←" } " " kbd { "→" }
                        " move the slider; " kbd { "A" } " next left, " kbd { "D" } " next right; " kbd { "T" } " next time; "
                        kbd { "M" } " image or map; " kbd { "Z" } " zoom. Keys work while the picture or the slider has the focus."
                    }
                }
            }
        }
    }

    /// The last pictures of all variants, which need no script.
    fn gallery(&self) -> Markup {
        let results = self.results;
        let picture = |path: &str, name: &str, what: &str| {
            let (width, height) = (results.scene.width, results.scene.height);
            html! { td { a href=(path) {
                img src=(path) alt={ (name) ": " (what) } width=(width) height=(height) loading="lazy";
            } } }
        };
        let means =
            self.pictures.variants.iter().any(|variant| variant.last().is_some_and(|shown| shown.mean_error.is_some()));
        html! {
            h3 { "At the last measure" }
            (self.bar(Palette::Diverging))
            (self.bar(Palette::Magma))
            p.note {
                "Signed error: brighter (red) or darker (blue) than the reference, relative to it, "
                "(I − R)/√(R² + 0.01 M²) in luminance. All images are exposed by " (digits(self.pictures.exposure, 2)) " stops."
            }
            div.wide { table.gallery {
                thead { tr {
                    th scope="col" { "variant" } th scope="col" { "image" } th scope="col" { "signed error" }
                    @if means { th scope="col" { "signed error of the mean over seeds" } }
                    th scope="col" { "FLIP" }
                } }
                tbody {
                    @if let Some(path) = &self.pictures.reference {
                        tr { th scope="row" { "reference" } (picture(path, "reference", "image")) }
                    }
                    @for (k, (variant, drawn)) in results.variants.iter().zip(&self.pictures.variants).enumerate() {
                        @if let Some(path) = &drawn.limit {
                            tr { th scope="row" { "reference of " (variant.name) } (picture(path, &variant.name, "its own reference")) }
                        }
                        tr {
                            th scope="row" {
                                (named(results, k))
                                @if let Some((budget, measured)) = last_measured(variant) {
                                    p { (self.budget_name(budget)) }
                                    p { "RMSE " (or_none(measured.regions.first().map(|figures| short(figures.rmse.value)))) }
                                    p { "FLIP " (or_none(self.flip(k, budget).map(short))) }
                                }
                            }
                            @match drawn.last() {
                                Some(shown) => {
                                    (picture(&shown.image, &variant.name, "image"))
                                    @match &shown.maps { Some(maps) => (picture(&maps.error, &variant.name, "signed error")), None => td { (NONE) } }
                                    @if means {
                                        @match &shown.mean_error { Some(path) => (picture(path, &variant.name, "signed error of the mean over seeds")), None => td { (NONE) } }
                                    }
                                    @match &shown.maps { Some(maps) => (picture(&maps.flip, &variant.name, "FLIP")), None => td { (NONE) } }
                                }
                                None => td.missing colspan=(if means { 4 } else { 3 }) { span.none { "no budget was reached" } },
                            }
                        }
                    }
                }
            } }
            details { summary { "Files of all images" } (self.files()) }
        }
    }

    fn files(&self) -> Markup {
        let results = self.results;
        let links = |exr: &str, shown: &Shown| {
            let link = |path: &str, name: &str| html! { a href=(path) { (name) } " " };
            html! {
                (link(exr, "EXR")) (link(&shown.image, "PNG"))
                @if let Some(maps) = &shown.maps { (link(&maps.error, "error")) (link(&maps.flip, "FLIP")) }
                @if let Some(path) = &shown.mean { (link(path, "mean")) }
                @if let Some(path) = &shown.mean_error { (link(path, "mean's error")) }
            }
        };
        html! {
            div.wide { table {
                thead { tr {
                    th scope="col" { "variant" }
                    @for k in 0..results.study.budgets.values.len() { th scope="col" { (self.budget_name(k)) } }
                } }
                tbody { @for (k, (variant, drawn)) in results.variants.iter().zip(&self.pictures.variants).enumerate() {
                    tr {
                        th scope="row" { (named(results, k)) }
                        @for (budget, shown) in drawn.budgets.iter().enumerate() { td {
                            @match shown.as_ref().zip(measured(variant, budget)) {
                                Some((shown, measured)) => (links(&measured.image, shown)),
                                None => span.none { "not reached" },
                            }
                        } }
                    }
                } }
            } }
        }
    }

    fn crops(&self, regions: &[(usize, Curves)]) -> Markup {
        let results = self.results;
        html! {
            @if self.pictures.crops.is_empty() { p { "There are none: the image is small, or nothing differs." } }
            @if !self.pictures.crops.is_empty() { (self.bar(Palette::Diverging)) }
            @for (k, crop) in self.pictures.crops.iter().enumerate() {
                @let [x, y, width, height] = crop.place;
                @let scale = (220 / width.max(1)).clamp(1, 16);
                @let picture = |path: &str, alt: String| html! {
                    a href=(path) { img.crop src=(path) alt=(alt) width=(width * scale) height=(height * scale) loading="lazy"; }
                };
                h3 { (crop.name.replace('-', " ")) }
                p.note {
                    "Columns " (x) " to " (x + width - 1) ", rows " (y) " to " (y + height - 1) ", enlarged " (scale) " times. "
                    @if regions.is_empty() { "Chosen for its errors; name others with " code { "--region" } "." }
                }
                div.crops {
                    @if let Some(path) = &crop.reference {
                        figure { (picture(path, format!("{}: reference", crop.name))) figcaption { "reference" } }
                    }
                    @for (v, shown) in crop.variants.iter().enumerate() {
                        @if let Some((budget, image, error)) = shown {
                            figure {
                                (picture(image, format!("{}: {}", crop.name, results.variants[v].name)))
                                @if let Some(error) = error { (picture(error, format!("{}: signed error of {}", crop.name, results.variants[v].name))) }
                                figcaption { (named(results, v)) " " (self.budget_name(*budget)) }
                            }
                        }
                    }
                }
                @if let Some((region, curves)) = regions.get(k) {
                    (self.small_plots(&[("RMSE", &curves.error), ("Bias²", &curves.bias), ("Variance", &curves.variance)]))
                    (self.measures(*region))
                }
            }
        }
    }

    /// All figures of a region, budget by budget.
    fn measures(&self, region: usize) -> Markup {
        let results = self.results;
        let name = if region == 0 { "the whole image" } else { &results.regions[region].name };
        let split = results.variants.iter().any(|variant| {
            last_measured(variant).is_some_and(|(_, measured)| {
                measured.regions.get(region).is_some_and(|figures| figures.variance.is_some())
            })
        });
        html! {
            div.wide { table.measures {
                caption { "Figures of " (name) ". Less error: how many times the RMSE of " (results.variants.get(self.baseline).map_or("", |v| &v.name)) " at the same budget is as large." }
                thead { tr {
                    th scope="col" { "budget" } th scope="col" { "variant" } th scope="col" { "seconds" } th scope="col" { "passes" }
                    th scope="col" { "samples" } th scope="col" { "RMSE" } th scope="col" { "less error" } th scope="col" { "relMSE" }
                    @if split { th scope="col" { "bias²" } th scope="col" { "variance" } }
                    th scope="col" { "mean" }
                } }
                @for budget in 0..results.study.budgets.values.len() {
                    @let figures = |variant: &Variant| measured(variant, budget).and_then(|measured| measured.regions.get(region)).map(|figures| figures.rmse.value);
                    @let base = results.variants.get(self.baseline).and_then(figures);
                    tbody { @for (k, variant) in results.variants.iter().enumerate() { tr {
                        @if k == 0 { th scope="rowgroup" rowspan=(results.variants.len()) { (self.budget_name(budget)) } }
                        th scope="row" { (named(results, k)) }
                        @match measured(variant, budget).and_then(|found| Some((found, found.regions.get(region)?))) {
                            Some((found, figures)) => {
                                td { (found.seconds) } td { (count(found.passes)) } td { (count(found.samples)) }
                                td { (figures.rmse) }
                                td { (or_none(base.filter(|_| figures.rmse.value > 0.0).map(|base| times(base / figures.rmse.value)))) }
                                td { (or_none(figures.relmse)) }
                                @if split { td { (or_none(figures.bias2)) } td { (or_none(figures.variance)) } }
                                td { (digits(figures.mean.iter().map(|mean| mean.value).sum::<f64>() / 3.0, 4)) }
                            }
                            None => td.missing colspan=(if split { 9 } else { 7 }) { span.none { "not reached" } },
                        }
                    } } }
                }
            } }
        }
    }

    fn tuning(&self) -> Markup {
        let tuned = || {
            let measures =
                self.results.variants.iter().enumerate().flat_map(|(k, variant)| {
                    variant.measures.iter().enumerate().map(move |(b, measure)| (k, b, measure))
                });
            measures.filter_map(|(k, budget, measure)| Some((k, budget, measure.measured.as_ref()?.tuned.as_ref()?)))
        };
        html! {
            @if tuned().next().is_some() {
                h3 { "Tuned to the time" }
                div.wide { table {
                    thead { tr {
                        th scope="col" { "variant" } th scope="col" { "budget" } th scope="col" { "chosen" } th scope="col" { "tried: samples, value, seconds, RMSE" }
                    } }
                    tbody { @for (k, budget, tuned) in tuned() { tr {
                        th scope="row" { (named(self.results, k)) }
                        td { (self.budget_name(budget)) }
                        td { (settings(std::slice::from_ref(&tuned.setting))) @if tuned.over { " – even the cheapest takes longer" } }
                        td { @for trial in &tuned.trials {
                            p { (count(trial.samples)) ", " (trial.value) ", " (time(trial.seconds)) ", " (short(trial.rmse)) }
                        } }
                    } } }
                } }
            }
        }
    }

    fn cost(&self) -> Markup {
        let results = self.results;
        type Cell = fn(&Variant) -> Option<String>;
        let rows: [(&str, Cell); 16] = [
            ("passes", |v| Some(count(v.statistics.passes))),
            ("samples per pixel", |v| Some(count(v.statistics.samples))),
            ("photons emitted", |v| Some(count(v.statistics.emitted))),
            ("photons stored", |v| Some(count(v.statistics.photons))),
            ("time of photons", |v| Some(time(v.statistics.photons_seconds))),
            ("time of radii and hierarchies", |v| Some(time(v.statistics.build_seconds))),
            ("time of pixels", |v| Some(time(v.statistics.render_seconds))),
            ("queries", |v| Some(count(v.statistics.queries))),
            ("queries per sample", |v| Some(short(v.statistics.queries_per_sample))),
            ("photons per query (discs per ray)", |v| v.statistics.photons_per_query.map(short)),
            ("smallest radius", |v| v.statistics.radii.map(|radii| short(radii[0]))),
            ("mean radius", |v| v.statistics.radii.map(|radii| short(radii[1]))),
            ("largest radius", |v| v.statistics.radii.map(|radii| short(radii[2]))),
            ("memory of the map", |v| Some(bytes(v.statistics.map_bytes))),
            ("peak memory of the process", |v| v.statistics.peak_bytes.map(bytes)),
            ("loading, in no time above", |v| Some(time(v.loading_seconds))),
        ];
        html! {
            div.wide { table {
                caption { "Of the first seed's run, up to its last measure; radii of its last pass, in scene units." }
                thead { tr { th scope="col" { "" } @for k in 0..results.variants.len() { th scope="col" { (named(results, k)) } } } }
                tbody {
                    tr { th scope="row" { "method" } @for variant in &results.variants { td { (variant.method) } } }
                    @for (name, cell) in rows {
                        tr { th scope="row" { (name) } @for variant in &results.variants { td { (or_none(cell(variant))) } } }
                    }
                    tr { th scope="row" { "settings" } @for variant in &results.variants { td.text {
                        @if variant.set.is_empty() { (NONE) } @else { (settings(&variant.set)) }
                    } } }
                    @if results.variants.iter().any(|variant| !variant.notes.is_empty()) {
                        tr { th scope="row" { "derived" } @for variant in &results.variants { td.text {
                            @for note in &variant.notes { p { (note) } }
                        } } }
                    }
                }
            } }
            @if let Some(map) = &results.study.same_map {
                p {
                    "All variants gather from one map of " (count(map.photons)) " photons (" (count(map.emitted)) " emitted, seed " (map.seed)
                    "), traced in " (time(map.seconds)) ", which no time above includes."
                }
            }
        }
    }

    fn reference(&self) -> Markup {
        let describe = |reference: &Reference| {
            html! {
                @match reference.kind {
                    ReferenceKind::File => "a file that was given",
                    ReferenceKind::Made => "made for this comparison",
                    ReferenceKind::Own => "each variant's own limit: the same map gathered with many samples",
                }
                @if let Some(method) = &reference.method { ", method " (method) }
                @if let Some(samples) = reference.samples { ", " (count(samples)) " samples per pixel" }
                @if let Some(seconds) = reference.seconds { ", " (time(seconds)) }
                @match reference.standard_error {
                    Some(error) => { ", relative standard error " (percent(error)) ", subtracted from the errors" }
                    None => ", standard error unknown: errors include the reference's own",
                }
                @if let Some(image) = &reference.image { ", " a href=(image) { (image) } }
                @if !reference.set.is_empty() { ", " (settings(&reference.set)) }
                "."
            }
        };
        html! {
            h3 { "Reference" }
            p { (describe(&self.results.reference)) }
            @for variant in &self.results.variants {
                @if let Some(limit) = &variant.limit { p { "Of " (variant.name) ": " (describe(limit)) } }
            }
        }
    }

    fn scene(&self) -> Markup {
        let Results { scene, study, .. } = self.results;
        html! {
            h3 { "Scene" }
            p { code { (scene.path) } @if !study.set.is_empty() { ", with " (settings(&study.set)) } ". Seeds: "
                (study.seeds.iter().map(u64::to_string).collect::<Vec<_>>().join(", ")) "." }
            details { summary { "Text of the scene" } pre tabindex="0" { code { (scene.text) } } }
            @if let Some(text) = &study.text { details { summary { "Text of the study" } pre tabindex="0" { code { (text) } } } }
        }
    }

    fn machine(&self) -> Markup {
        let Results { program, machine, threads, .. } = self.results;
        html! {
            h3 { "Machine" }
            dl.facts {
                dt { "program" } dd { (program.name) " " (program.version) @if let Some(commit) = &program.commit { ", commit " code { (commit) } } }
                dt { "processor" } dd { (or_none(machine.cpu.as_deref())) ", " (machine.logical_cores) " logical cores" }
                dt { "system" } dd { (machine.os) }
                dt { "threads" } dd { (threads) }
            }
        }
    }

    /// What the script works with.
    fn data(&self) -> serde_json::Value {
        let variants =
            self.results.variants.iter().zip(&self.pictures.variants).enumerate().map(|(k, (variant, drawn))| {
                let points: Vec<_> = self.curve(k).iter().map(|point| [point.seconds, point.value]).collect();
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

fn percent(share: f64) -> String {
    format!("{} %", if share >= 0.01 { short(100.0 * share) } else { digits(100.0 * share, 2) })
}

fn reached(reach: Reach) -> String {
    match reach {
        Reach::At(seconds) => time(seconds),
        Reach::Before(seconds) => format!("< {}", time(seconds)),
        Reach::After(seconds) => format!("> {}", time(seconds)),
    }
}
