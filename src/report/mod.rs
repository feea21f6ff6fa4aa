//! A comparison as a page: tables, plots and pictures of what [`compare`](crate::compare) found.
//!
//! [`write()`] reads the images that [`Results`] names and writes `index.html`, `curve.svg`, `overview.png` and a
//! folder `pictures` beside them. The page needs nothing else: it can be opened from a disk, without a network.

mod analysis;
mod number;
mod page;
mod pictures;
mod plot;
mod sweep;

use std::io::Write;
use std::path::Path;

use crate::Result;
use crate::compare::Results;
use crate::compare::sweep::Sweep;
use crate::image::write_aside;

/// Writes the report of `results` into their folder `dir`: `index.html`; `curve.svg`, error against time;
/// `overview.png`, the variants side by side; and in `pictures` PNG files of all images, exposed alike, and of their
/// differences from the reference.
///
/// Errors: [`Error::Asset`](crate::Error::Asset) for images that are missing or of another size,
/// [`Error::Output`](crate::Error::Output) for what cannot be written.
pub fn write(results: &Results, dir: &Path) -> Result<()> {
    let pictures = pictures::draw(results, dir)?;
    let curves = page::Curves::draw(results, 0)?;
    if let Some(error) = &curves.error {
        write_aside(dir.join("curve.svg"), |file| file.write_all(error.0.as_bytes()))?;
    }
    let page = page::page(results, &pictures, &curves)?;
    write_aside(dir.join("index.html"), |file| file.write_all(page.as_bytes()))
}

/// Writes the report of a sweep into its folder `dir`: `index.html`, and `error.svg`, `share.svg`, `cost.svg` and `work.svg`, its curves.
///
/// Errors: [`Error::Output`](crate::Error::Output).
pub fn write_sweep(sweep: &Sweep, dir: &Path) -> Result<()> {
    let curves = sweep::curves(sweep)?;
    for (name, _, curve) in &curves {
        write_aside(dir.join(format!("{name}.svg")), |file| file.write_all(curve.0.as_bytes()))?;
    }
    let page = sweep::page(sweep, &curves);
    write_aside(dir.join("index.html"), |file| file.write_all(page.as_bytes()))
}
