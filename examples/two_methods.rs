//! The same scene by photons and by paths, and how far apart they are: the check that `volpm diff` makes of files, in memory.
//!
//! ```sh
//! cargo run --release --example two_methods -- scenes/cornell-fog.toml
//! ```
//!
//! Paths have noise and no bias, photons a little blur and hardly any noise; what is left of their difference is both.

use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;
use std::time::Instant;

use volpm::image::{self, Image, ToneSettings};
use volpm::render::{self, Silent};
use volpm::scene;

fn main() -> volpm::Result<()> {
    let path = std::env::args_os().nth(1).map_or_else(|| PathBuf::from("scenes/cornell-fog.toml"), PathBuf::from);
    let photons = rendered(&path, &["render.method=\"photon\"", "render.samples=4"])?;
    let paths = rendered(&path, &["render.method=\"path\"", "render.samples=64"])?;
    for (name, image) in [("photons", &photons), ("paths", &paths)] {
        image::write(
            std::env::temp_dir().join(format!("{name}.png")),
            &image.clone().into(),
            &ToneSettings::default(),
        )?;
    }
    let figures = image::compare(&photons, &paths, None)?;
    println!("bias {:.2} %, RMSE {:.3e}", 100.0 * figures.bias.unwrap_or(0.0), figures.rmse);
    println!("pictures are in {}", std::env::temp_dir().display());
    Ok(())
}

/// A small picture of a scene file, with these keys replaced.
fn rendered(path: &Path, set: &[&str]) -> volpm::Result<Image> {
    let small = ["film.width=80", "film.height=60", "photons.volume=100_000"];
    let overrides: Vec<String> = small.iter().chain(set).map(ToString::to_string).collect();
    let (scene, settings) = scene::build(&scene::read(path, &overrides)?)?;
    let start = Instant::now();
    let rendering = render::render(&scene, &settings, &Silent, &AtomicBool::new(false))?;
    println!("{}: {:.2} s", set.join(", "), start.elapsed().as_secs_f64());
    Ok(rendering.film.image())
}
