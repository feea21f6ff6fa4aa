//! `volpm diff`.

use std::path::{Path, PathBuf};

use clap::Args;

use crate::check::{self, Outcome, Row};
use crate::image::{self, DiffOptions, Figures, Pair, Palette};
use crate::{Error, Result};

#[derive(Args)]
pub struct Arguments {
    /// The image to judge: .exr, .png, .pfm or .hdr.
    image: PathBuf,
    /// What it is judged by, of the same size.
    reference: PathBuf,
    /// A named layer of both instead of the image.
    #[arg(long, value_name = "NAME")]
    layer: Option<String>,
    /// The reference's standard error: an image whose squares are subtracted from the squared errors.
    /// Default: the reference's own layer of that name, if it has one.
    #[arg(long, value_name = "FILE")]
    standard_error: Option<PathBuf>,
    /// Another picture of the image's kind, by another seed; repeatable. With --references, a t-test tells whether both kinds have the
    /// same mean; the status is 1 if they have not.
    #[arg(long, value_name = "FILE", requires = "references")]
    images: Vec<PathBuf>,
    /// Another picture of the reference's kind, by another seed; repeatable.
    #[arg(long, value_name = "FILE", requires = "images")]
    references: Vec<PathBuf>,
    /// Writes the map of that test's p-values, by blocks: black is 1, bright 10⁻⁶ or less.
    #[arg(long, value_name = "FILE.png", value_parser = super::values::png, requires = "images")]
    p_values: Option<PathBuf>,
    /// Also HDR-FLIP: the largest difference over all exposures, instead of at one. --flip and --max-flip then mean it.
    #[arg(long)]
    hdr: bool,
    /// Writes the map of FLIP, 0 to 1.
    #[arg(long, value_name = "FILE.png", value_parser = super::values::png)]
    flip: Option<PathBuf>,
    /// Writes a map of signed errors relative to the reference: red is too bright, blue too dark.
    #[arg(long, value_name = "FILE.png", value_parser = super::values::png)]
    error: Option<PathBuf>,
    /// The share that the ends of the bar of --error stand for. Default: chosen from the errors.
    #[arg(long, value_name = "SHARE", value_parser = super::values::share, requires = "error")]
    error_range: Option<f64>,
    /// Ends with status 1 if the RMSE is larger.
    #[arg(long, value_name = "NUMBER", value_parser = super::values::limit)]
    max_rmse: Option<f64>,
    /// Ends with status 1 if the relative squared error is larger.
    #[arg(long, value_name = "NUMBER", value_parser = super::values::limit)]
    max_relmse: Option<f64>,
    /// Ends with status 1 if the bias of the mean is larger, in either direction.
    #[arg(long, value_name = "SHARE", value_parser = super::values::limit)]
    max_bias: Option<f64>,
    /// Ends with status 1 if FLIP is larger.
    #[arg(long, value_name = "NUMBER", value_parser = super::values::limit)]
    max_flip: Option<f64>,
    /// As JSON.
    #[arg(long)]
    json: bool,
}

pub fn run(arguments: &Arguments) -> Result<()> {
    let options = DiffOptions { layer: arguments.layer.clone(), standard_error: arguments.standard_error.clone() };
    for path in arguments.flip.iter().chain(&arguments.error).chain(&arguments.p_values) {
        image::check_target(path)?;
    }
    let pair = Pair::read(&arguments.image, &arguments.reference, &options)?;
    let looked_at = [("--hdr", arguments.hdr), ("--flip", arguments.flip.is_some())];
    let looked_at = looked_at.into_iter().chain([("--max-flip", arguments.max_flip.is_some())]);
    if let (false, Some((option, _))) = (pair.coloured, looked_at.into_iter().find(|(_, given)| *given)) {
        return Err(Error::Usage(format!(
            "{option} compares colours as one sees them; the layer \"{}\" holds none",
            options.layer.unwrap_or_default()
        )));
    }

    let mut figures = pair.figures()?;
    let over_exposures = if arguments.hdr { pair.hdr_flip() } else { None };
    figures.hdr_flip = over_exposures.as_ref().map(|flip| flip.mean);
    if let Some(path) = &arguments.flip {
        let flip = if arguments.hdr { over_exposures } else { pair.flip() };
        let flip = flip.ok_or_else(|| Error::output(path, BLACK))?;
        let labels = ["0", "0.5", "1"].map(String::from);
        write_map(path, flip.map.iter().map(|&value| f64::from(value)), &pair, Palette::Magma, &labels)?;
    }
    if let Some(path) = &arguments.error {
        let errors = image::signed_errors(&pair.image, &pair.reference).unwrap_or_default();
        let range = arguments.error_range.unwrap_or_else(|| image::range_of(errors.iter().copied()));
        let percent = format!("{}%", 1e-4 * (1e6 * range).round());
        let labels = [format!("-{percent}"), "0".into(), format!("+{percent}")];
        write_map(path, errors.into_iter().map(|error| error / range), &pair, Palette::Diverging, &labels)?;
    }
    let tested = if arguments.images.is_empty() { None } else { Some(t_test(&pair, &options, arguments)?) };
    super::print(&match (arguments.json, &tested) {
        (true, None) => super::json(&figures)?,
        (true, Some(row)) => super::json(&serde_json::json!({ "figures": figures, "t_test": row }))?,
        (false, None) => format!("{figures}\n"),
        (false, Some(row)) => format!("{figures}\nt-test: {}\n", row.found),
    })?;
    judge(&figures, arguments)?;
    match tested {
        Some(row) if row.outcome == Outcome::Fail => Err(Error::Failed(row.found)),
        _ => Ok(()),
    }
}

/// Whether two sets of pictures have the same means.
fn t_test(pair: &Pair, options: &DiffOptions, arguments: &Arguments) -> Result<Row> {
    let (mut images, mut references) = (vec![pair.image.clone()], vec![pair.reference.clone()]);
    for (set, files, with) in [
        (&mut images, &arguments.images, &arguments.reference),
        (&mut references, &arguments.references, &arguments.reference),
    ] {
        for file in files {
            set.push(Pair::read(file, with, options)?.image);
        }
    }
    let row = check::t_test(&images, &references)?;
    if let (Some(path), Some(map)) = (&arguments.p_values, &row.map) {
        // As many decades as the colours span.
        const DECADES: f64 = 6.0;
        let labels = ["1", "1e-3", "1e-6"].map(String::from);
        let width = pair.reference.width;
        let place = |at: usize| at / width / map.block * map.columns + at % width / map.block;
        let values = (0..pair.reference.pixels.len()).map(|at| (-map.p[place(at)].log10() / DECADES).clamp(0.0, 1.0));
        write_map(path, values, pair, Palette::Magma, &labels)?;
    }
    Ok(row)
}

const BLACK: &str = "HDR-FLIP is undefined: the reference is black";

fn write_map(
    path: &Path,
    values: impl Iterator<Item = f64>,
    pair: &Pair,
    palette: Palette,
    labels: &[String],
) -> Result<()> {
    let (pixels, width) = image::map_with_bar(values, pair.reference.width, palette, labels);
    image::write_pixels(path, &pixels, width)
}

/// Whether the figures stay below the limits that were given.
fn judge(figures: &Figures, arguments: &Arguments) -> Result<()> {
    let (flip, flip_name) = if arguments.hdr { (figures.hdr_flip, "HDR-FLIP") } else { (figures.flip, "FLIP") };
    let limits = [
        ("RMSE", Some(figures.rmse), "--max-rmse", arguments.max_rmse),
        ("relMSE", figures.rel_mse, "--max-relmse", arguments.max_relmse),
        ("bias", figures.bias.map(f64::abs), "--max-bias", arguments.max_bias),
        (flip_name, flip, "--max-flip", arguments.max_flip),
    ];
    let mut broken = Vec::new();
    for (name, found, option, limit) in limits {
        let Some(limit) = limit else { continue };
        match found {
            Some(found) if found <= limit => {}
            Some(found) => broken.push(format!("{name} {found:.6} exceeds {limit} ({option})")),
            None => broken.push(format!("{name} is undefined for a black reference ({option})")),
        }
    }
    let limited = limits.iter().any(|(.., limit)| limit.is_some());
    if let (true, Some(found)) = (limited, figures.non_finite) {
        let [x, y] = found.first;
        broken.push(format!("{} pixels are not finite, the first in column {x}, row {y}", found.count));
    }
    if broken.is_empty() { Ok(()) } else { Err(Error::Failed(broken.join("; "))) }
}
