//! Curves on logarithmic axes, against time or what is swept, as SVG: axes and lines by plotters, each variant in a group of its own.

use std::ops::Range;

use maud::{Markup, PreEscaped, html};
use plotters::chart::{ChartBuilder, ChartContext};
use plotters::coord::cartesian::Cartesian2d;
use plotters::coord::ranged1d::{DefaultFormatting, KeyPointHint, KeyPointWeight, Ranged};
use plotters::drawing::IntoDrawingArea;
use plotters::prelude::{Color, LineSeries, RGBColor, SVGBackend};
use plotters::style::IntoFont;

use super::analysis::Point;
use super::number::short;
use crate::{Error, Result};

/// A curve.
pub struct Line<'r> {
    /// What it is called.
    name: &'r str,
    /// Which variant it is: decides colour, marker and dashes.
    variant: usize,
    /// Its points, from left to right. Those that cannot be shown on a logarithmic axis are left out.
    pub points: Vec<Point>,
}

impl<'r> Line<'r> {
    /// The curve of a variant.
    pub fn new(name: &'r str, variant: usize, mut points: Vec<Point>) -> Line<'r> {
        points.retain(|point| shown(point).0 > 0.0);
        Line { name, variant, points }
    }
}

/// What a horizontal axis shows.
#[derive(Clone, Copy)]
pub struct Across<'r> {
    /// What it is called.
    pub name: &'r str,
    /// What follows its numbers.
    pub unit: &'r str,
    /// Whether it is logarithmic, not even.
    pub logarithmic: bool,
    /// What it reaches from and to, even if there are no points there.
    pub ends: Option<(f64, f64)>,
}

impl Across<'_> {
    /// Time.
    pub const SECONDS: Across<'static> = Across { name: "seconds", unit: " s", logarithmic: true, ends: None };
}

/// A picture of curves.
pub struct Plot<'r> {
    /// What the horizontal axis shows.
    pub across: Across<'r>,
    /// What the vertical axis shows.
    pub quantity: &'r str,
    /// The curves.
    pub lines: Vec<Line<'r>>,
    /// Whether there is a dotted line of slope −1/2, along which independent samples go.
    pub guide: bool,
    /// Where the vertical axis begins and ends, if not where the curves do.
    pub range: Option<(f64, f64)>,
    /// Whether names stand at the ends of the lines.
    pub named: bool,
}

/// Colours that differ for all kinds of eyes, on light and on dark: M. Okabe and K. Ito, "Color Universal Design"
/// (2008), without yellow and black.
const COLOURS: [(u8, u8, u8); 7] =
    [(0, 114, 178), (213, 94, 0), (0, 158, 115), (204, 121, 167), (230, 159, 0), (86, 180, 233), (128, 128, 128)];

/// The colour of a variant, for style sheets.
pub fn colour(variant: usize) -> String {
    let (r, g, b) = COLOURS[variant % COLOURS.len()];
    format!("#{r:02X}{g:02X}{b:02X}")
}

/// The dashes of a variant's line, in units of its width. With seven colours, 28 variants look different.
pub fn dashes(variant: usize) -> &'static str {
    ["none", "6 2.5", "1.5 2", "8 2 1.5 2"][variant % 4]
}

/// The outline of a variant's marker about a place.
pub fn marker(variant: usize, x: f64, y: f64, radius: f64) -> String {
    let polygon = |corners: &[(f64, f64)]| {
        let corners = corners.iter().map(|(dx, dy)| format!("{:.2} {:.2}", x + radius * dx, y + radius * dy));
        format!("M{}Z", corners.collect::<Vec<_>>().join("L"))
    };
    match variant % 6 {
        0 => format!(
            "M{:.2} {y:.2}a{radius} {radius} 0 1 0 {d} 0a{radius} {radius} 0 1 0 -{d} 0Z",
            x - radius,
            d = 2.0 * radius
        ),
        1 => polygon(&[(-0.9, -0.9), (0.9, -0.9), (0.9, 0.9), (-0.9, 0.9)]),
        2 => polygon(&[(0.0, -1.25), (1.15, 0.85), (-1.15, 0.85)]),
        3 => polygon(&[(0.0, -1.35), (1.35, 0.0), (0.0, 1.35), (-1.35, 0.0)]),
        4 => polygon(&[(0.0, 1.25), (1.15, -0.85), (-1.15, -0.85)]),
        _ => {
            let (a, b) = (0.4, 1.2);
            polygon(&[
                (-a, -b),
                (a, -b),
                (a, -a),
                (b, -a),
                (b, a),
                (a, a),
                (a, b),
                (-a, b),
                (-a, a),
                (-b, a),
                (-b, -a),
                (-a, -a),
            ])
        }
    }
}

/// Plotters places in whole units; these are quarters of a pixel.
const UNIT: i32 = 4;

/// An axis whose labels are 1, 2 and 5 times powers of ten, or fewer where those are too many; an even one's are multiples of such a
/// number.
#[derive(Clone, Copy)]
struct Axis {
    start: f64,
    end: f64,
    logarithmic: bool,
}

impl Axis {
    /// An axis over `values`, with room at its ends, over a factor of 5 at least.
    fn over(values: impl Iterator<Item = f64>, room: f64) -> Option<Axis> {
        let (low, high) = values
            .filter(|value| *value > 0.0 && value.is_finite())
            .fold((f64::INFINITY, 0.0f64), |(low, high), value| (low.min(value), high.max(value)));
        if high == 0.0 {
            return None;
        }
        let wider = (5.0 * low / high).max(1.0).sqrt().max(room);
        Some(Axis { start: low / wider, end: high * wider, logarithmic: true })
    }

    /// An even axis over `values`, with room at its ends.
    fn even(values: impl Iterator<Item = f64>) -> Option<Axis> {
        let (low, high) = values
            .filter(|value| value.is_finite())
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), value| (low.min(value), high.max(value)));
        let room = if high > low { 0.04 * (high - low) } else { 0.5 };
        (low <= high).then_some(Axis { start: low - room, end: high + room, logarithmic: false })
    }

    /// How far along the axis a value is.
    fn share(&self, value: f64) -> f64 {
        if self.logarithmic {
            (value / self.start).ln() / (self.end / self.start).ln()
        } else {
            (value - self.start) / (self.end - self.start)
        }
    }

    /// Labels of an even axis, no more than `most`: multiples of 1, 2 or 5 times a power of ten.
    fn multiples(&self, most: usize) -> Vec<f64> {
        let least = (self.end - self.start) / most.max(1) as f64;
        let decade = 10f64.powf(least.log10().floor());
        let step = [1.0, 2.0, 5.0, 10.0].map(|multiple| multiple * decade).into_iter().find(|step| *step >= least);
        let step = step.unwrap_or(10.0 * decade);
        let marks = (self.start / step).ceil() as i64..=(self.end / step).floor() as i64;
        // 3 · 0.1 is no round number.
        marks.map(|mark| format!("{:.6e}", mark as f64 * step).parse().unwrap_or_default()).collect()
    }

    /// Multiples, each in [1, 10), of powers of ten, every `step`-th power.
    fn marks(&self, multiples: &[f64], step: i32) -> Vec<f64> {
        let decades = self.start.log10().floor() as i32..=self.end.log10().floor() as i32;
        let all = decades
            .filter(|decade| decade.rem_euclid(step) == 0)
            .flat_map(|decade| multiples.iter().map(move |multiple| multiple * 10f64.powi(decade)));
        all.filter(|mark| (0.9999 * self.start..=1.0001 * self.end).contains(mark)).collect()
    }
}

impl Ranged for Axis {
    type FormatOption = DefaultFormatting;
    type ValueType = f64;

    fn map(&self, value: &f64, (low, high): (i32, i32)) -> i32 {
        // Conversions saturate.
        (f64::from(low) + self.share(*value) * f64::from(high - low)).round() as i32
    }

    fn key_points<Hint: KeyPointHint>(&self, hint: Hint) -> Vec<f64> {
        const ALL: [f64; 9] = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0];
        if !self.logarithmic {
            return if matches!(hint.weight(), KeyPointWeight::Bold) {
                self.multiples(hint.max_num_points())
            } else {
                Vec::new()
            };
        }
        let span = (self.end / self.start).log10();
        if !matches!(hint.weight(), KeyPointWeight::Bold) {
            return if span > 5.0 { self.marks(&[1.0], 1) } else { self.marks(&ALL, 1) };
        }
        let most = hint.max_num_points();
        let step = (span / most as f64).ceil().max(1.0) as i32;
        let candidates = [self.marks(&[1.0, 2.0, 5.0], 1), self.marks(&[1.0, 3.0], 1)];
        candidates.into_iter().find(|marks| marks.len() <= most).unwrap_or_else(|| self.marks(&[1.0], step))
    }

    fn range(&self) -> Range<f64> {
        self.start..self.end
    }
}

type Chart<'a, 'b> = ChartContext<'a, SVGBackend<'b>, Cartesian2d<Axis, Axis>>;
type Drawn = std::result::Result<(), plotters::drawing::DrawingAreaErrorKind<std::io::Error>>;

/// What all parts of a plot are drawn into: its axes and its size.
struct Canvas {
    x: Axis,
    y: Axis,
    width: i32,
    height: i32,
    right: i32,
}

impl Canvas {
    /// The elements that `fill` draws.
    fn part(&self, fill: impl FnOnce(&mut Chart<'_, '_>) -> Drawn) -> Result<String> {
        let fail = |error| Error::output("a plot", error);
        let mut text = String::new();
        {
            let size = ((UNIT * self.width) as u32, (UNIT * self.height) as u32);
            let area = SVGBackend::with_string(&mut text, size).into_drawing_area();
            let mut chart = ChartBuilder::on(&area)
                .margin_top(UNIT * 12)
                .margin_right(UNIT * self.right)
                .x_label_area_size(UNIT * 46)
                .y_label_area_size(UNIT * 74)
                .build_cartesian_2d(self.x, self.y)
                .map_err(fail)?;
            fill(&mut chart).map_err(fail)?;
            area.present().map_err(fail)?;
        }
        // Parts are put together in one element.
        let start = text.find('>').map_or(0, |place| place + 1);
        let end = text.rfind("</svg>").unwrap_or(text.len());
        Ok(text[start..end.max(start)].to_string())
    }
}

/// The value to show of a point, and whether it is its own and no limit.
fn shown(point: &Point) -> (f64, bool) {
    point.limit().map_or((point.value, true), |limit| (limit, false))
}

/// The plot as an element `svg`; `None` if there is nothing to draw.
///
/// Each variant is a group `g.curve` with its name as `data-variant`, its line a `polyline`. Points below 2 standard
/// errors are hollow, at the value they are likely below, and no line leads to them.
pub fn draw(plot: &Plot<'_>) -> Result<Option<Markup>> {
    let points = || plot.lines.iter().flat_map(|line| &line.points);
    let ends = plot.across.ends.into_iter().flat_map(|(low, high)| [low, high]);
    let places = points().map(|point| point.at).chain(ends);
    let places = if plot.across.logarithmic { Axis::over(places, 1.15) } else { Axis::even(places) };
    let heights = match plot.range {
        Some((low, high)) => Axis::over([low, high].into_iter(), 1.3),
        None => Axis::over(points().map(|point| shown(point).0), 1.3),
    };
    let (Some(x), Some(y)) = (places, heights) else { return Ok(None) };
    // Names take about eight pixels a letter.
    let longest = plot.lines.iter().map(|line| line.name.chars().count()).max().unwrap_or(0);
    let right = if plot.named { (34 + 8 * longest as i32).clamp(100, 300) } else { 16 };
    let (width, height) = if plot.named { (610 + right, 430) } else { (480, 340) };
    let frame = Canvas { x, y, width, height, right };

    let ink = RGBColor(34, 34, 34);
    let grid = RGBColor(128, 128, 128);
    let mut area = (0.0..0.0, 0.0..0.0);
    let axes = frame.part(|chart| {
        let font = |size: i32| ("system-ui, sans-serif", UNIT * size).into_font().color(&ink);
        chart
            .configure_mesh()
            .x_desc(plot.across.name)
            .y_desc(plot.quantity)
            .x_labels(if plot.named { 12 } else { 8 })
            .y_labels(8)
            .x_label_formatter(&|value| short(*value))
            .y_label_formatter(&|value| short(*value))
            .label_style(font(15))
            .axis_desc_style(font(16))
            .axis_style(grid.stroke_width(UNIT as u32))
            .bold_line_style(grid.mix(0.35).stroke_width(UNIT as u32))
            .light_line_style(grid.mix(0.12).stroke_width(UNIT as u32))
            .set_all_tick_mark_size(UNIT * 4)
            .draw()?;
        let (columns, rows) = chart.plotting_area().get_pixel_range();
        let real = |range: Range<i32>| f64::from(range.start)..f64::from(range.end);
        area = (real(columns), real(rows));
        Ok(())
    })?;
    let (left, right, top, bottom) = (area.0.start, area.0.end, area.1.start, area.1.end);
    let place = |at: f64, value: f64| {
        let y = bottom - frame.y.share(value) * (bottom - top);
        (left + frame.x.share(at) * (right - left), y.clamp(top - 8.0, bottom))
    };

    let guide = match (plot.guide, points().next()) {
        (true, Some(_)) => {
            // From the upper left corner of the frame, or where it would be reached from the middle.
            let start = (frame.x.start * 1.05, frame.y.end / 1.1);
            let fall = |t: f64| (t, start.1 * (t / start.0).powf(-0.5));
            let end = frame.x.end.min(start.0 * (start.1 / frame.y.start).powi(2));
            Some(frame.part(|chart| {
                let line = [fall(start.0), fall(end)];
                chart.draw_series(LineSeries::new(line, grid.stroke_width(3 * UNIT as u32 / 2))).map(drop)
            })?)
        }
        _ => None,
    };

    let mut curves = Vec::new();
    for line in &plot.lines {
        let (r, g, b) = COLOURS[line.variant % COLOURS.len()];
        let certain: Vec<(f64, f64)> =
            line.points.iter().filter(|point| shown(point).1).map(|point| (point.at, point.value)).collect();
        let stroke = frame.part(|chart| {
            let style = RGBColor(r, g, b).stroke_width(2 * UNIT as u32);
            chart.draw_series(LineSeries::new(certain, style)).map(drop)
        })?;
        curves.push((line, stroke));
    }

    let ends =
        plot.lines.iter().filter_map(|line| line.points.last().map(|point| (place(point.at, shown(point).0).1, line)));
    let names = apart(ends.collect(), f64::from(17 * UNIT), top..bottom);

    let unit = f64::from(UNIT);
    let label = format!("{} against {}: {}", plot.quantity, plot.across.name, described(plot));
    Ok(Some(html! {
        svg.plot xmlns="http://www.w3.org/2000/svg" viewBox={ "0 0 " (UNIT * width) " " (UNIT * height) }
            role="img" aria-label=(label)
            data-frame={ (left) " " (top) " " (right) " " (bottom) }
            data-value={ (frame.y.start) " " (frame.y.end) } {
            style { (PreEscaped(include_str!("plot.css"))) }
            g.axes { (PreEscaped(axes)) }
            @if let Some(guide) = guide {
                g.guide stroke-dasharray={ (UNIT) " " (3 * UNIT) } { title { "slope −1/2" } (PreEscaped(guide)) }
            }
            @for (line, stroke) in &curves {
                @let colour = colour(line.variant);
                g.curve data-variant=(line.name) {
                    g stroke-dasharray=(scaled(dashes(line.variant))) stroke-linejoin="round" { (PreEscaped(stroke)) }
                    @for point in &line.points {
                        @let (value, certain) = shown(point);
                        @let (x, y) = place(point.at, value);
                        @if let (true, Some(error)) = (certain, point.error) {
                            @let high = place(point.at, point.value + error).1;
                            @let low = place(point.at, (point.value - error).max(1e-3 * point.value)).1;
                            path.bar d={ "M" (x) " " (high) "V" (low) } stroke=(colour) stroke-width=(1.5 * unit) {}
                        }
                        path.point d=(marker(line.variant, x, y, 4.0 * unit)) stroke=(colour) stroke-width=(1.5 * unit)
                            fill=(if certain { colour.as_str() } else { "none" }) {
                            title {
                                (line.name) ", " (short(point.at)) (plot.across.unit) ": "
                                @if certain { (short(value)) } @else { "below " (short(value)) }
                                @if let (true, Some(error)) = (certain, point.error) { " ± " (short(error)) }
                            }
                        }
                    }
                }
            }
            @if plot.named {
                g.names font-family="system-ui, sans-serif" font-size=(13 * UNIT) {
                    @for (y, line) in &names {
                        @let colour = colour(line.variant);
                        path d=(marker(line.variant, right + 16.0 * unit, *y, 4.0 * unit)) fill=(colour) {}
                        text x=(right + 26.0 * unit) y=(*y) dy="0.35em" { (line.name) }
                    }
                }
            }
        }
    }))
}

/// Names at heights within `range` near those given, at least `spacing` apart as far as there is room.
fn apart<T>(mut names: Vec<(f64, T)>, spacing: f64, range: Range<f64>) -> Vec<(f64, T)> {
    names.sort_by(|a, b| a.0.total_cmp(&b.0));
    let first = range.start + 0.5 * spacing;
    let room = (range.end - range.start - spacing * names.len() as f64).max(0.0);
    let mut next = first;
    for (k, (height, _)) in names.iter_mut().enumerate() {
        // Those below need their room, too.
        let latest = first + room + spacing * k as f64;
        *height = height.clamp(next, latest.max(next));
        next = *height + spacing;
    }
    names
}

/// Lengths of dashes in units of the plot.
fn scaled(dashes: &str) -> String {
    let lengths: Vec<String> = dashes
        .split(' ')
        .filter_map(|length| length.parse::<f64>().ok())
        .map(|l| (2.0 * l * f64::from(UNIT)).to_string())
        .collect();
    if lengths.is_empty() { "none".into() } else { lengths.join(" ") }
}

/// The ends of each curve, in words.
fn described(plot: &Plot<'_>) -> String {
    let unit = plot.across.unit;
    let ends = plot.lines.iter().filter_map(|line| {
        let (first, last) = (line.points.first()?, line.points.last()?);
        let (name, [a, b, c, d]) = (line.name, [first.value, first.at, last.value, last.at].map(short));
        Some(format!("{name} from {a} at {b}{unit} to {c} at {d}{unit}"))
    });
    ends.collect::<Vec<_>>().join("; ")
}
