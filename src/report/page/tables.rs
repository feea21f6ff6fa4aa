//! Tables: all measures, what they cost, and what was compared on which machine.

use maud::{Markup, html};

use super::{NONE, Page, named, or_none, percent, settings, times};
use crate::compare::results::{Reference, ReferenceKind, Results, Variant};
use crate::report::analysis::{last_measured, measured};
use crate::report::number::{bytes, count, digits, short, time};

impl Page<'_> {
    /// All figures of a region, budget by budget.
    pub(super) fn measures(&self, region: usize) -> Markup {
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

    pub(super) fn tuning(&self) -> Markup {
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

    pub(super) fn cost(&self) -> Markup {
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

    pub(super) fn reference(&self) -> Markup {
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

    pub(super) fn scene(&self) -> Markup {
        let Results { scene, study, .. } = self.results;
        html! {
            h3 { "Scene" }
            p { code { (scene.path) } @if !study.set.is_empty() { ", with " (settings(&study.set)) } ". Seeds: "
                (study.seeds.iter().map(u64::to_string).collect::<Vec<_>>().join(", ")) "." }
            details { summary { "Text of the scene" } pre tabindex="0" { code { (scene.text) } } }
            @if let Some(text) = &study.text { details { summary { "Text of the study" } pre tabindex="0" { code { (text) } } } }
        }
    }

    pub(super) fn machine(&self) -> Markup {
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
}
