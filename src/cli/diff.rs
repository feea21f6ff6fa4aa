//! `volpm diff`.

use std::path::PathBuf;

use clap::Args;

use crate::Result;
use crate::image::{self, DiffOptions};

#[derive(Args)]
pub struct Arguments {
    /// The image to judge.
    image: PathBuf,
    /// What it is judged by.
    reference: PathBuf,
    /// A named layer of both instead of the image.
    #[arg(long, value_name = "NAME")]
    layer: Option<String>,
    /// The reference's standard error: an image whose squares are subtracted from the squared errors.
    /// Default: the reference's own layer of that name, if it has one.
    #[arg(long, value_name = "FILE")]
    standard_error: Option<PathBuf>,
    /// As JSON.
    #[arg(long)]
    json: bool,
}

pub fn run(arguments: &Arguments) -> Result<()> {
    let options = DiffOptions { layer: arguments.layer.clone(), standard_error: arguments.standard_error.clone() };
    let figures = image::diff(&arguments.image, &arguments.reference, &options)?;
    super::print(&if arguments.json { super::json(&figures)? } else { format!("{figures}\n") })
}
