//! Pictures: the viewer, the gallery and crops.

use maud::{Markup, html};

use super::{Curves, NONE, Page, named, or_none, percent};
use crate::image::Palette;
use crate::report::analysis::{last_measured, measured};
use crate::report::number::{digits, short};
use crate::report::pictures::Shown;

impl Page<'_> {
    /// Two pictures over each other. Filled by the script; without it, the gallery shows all.
    pub(super) fn viewer(&self) -> Markup {
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
    pub(super) fn gallery(&self) -> Markup {
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

    pub(super) fn crops(&self, regions: &[(usize, Curves)]) -> Markup {
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
}
