//! What damaged files are put through; the targets of `fuzz/` share it.

use std::path::Path;
use std::sync::atomic::AtomicBool;
use std::time::Duration;

use volpm::Result;
use volpm::geometry::Mesh;
use volpm::image::{self, LayerData};
use volpm::light::Profile;
use volpm::medium::density::bricks::{BrickGrid, NegativePolicy};
use volpm::medium::density::{npy, vdb};
use volpm::render::{Checkpoint, End, Limits, Silent, refine};
use volpm::scene;
use xxhash_rust::xxh3::xxh3_128;

/// What became of a mutant.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Outcome {
    Read,
    /// A render that was broken off.
    Late,
}

/// A picture that takes longer is broken off, and counts as a failure.
pub const LONGEST: Duration = Duration::from_secs(60);

/// Overrides that keep a picture small whatever else a scene says.
pub const SMALL: [&str; 10] = [
    "film.width=4",
    "film.height=3",
    "film.crop=[0, 0, 4, 3]",
    "render.samples=1",
    "render.light_samples=1",
    "render.passes=1",
    "photons.volume=300",
    "photons.global=200",
    "photons.caustic=200",
    "photons.max_emitted=20000",
];

/// Reads a file by its ending.
pub fn read(path: &Path) -> Result<()> {
    match path.extension().and_then(|ending| ending.to_str()).unwrap_or_default() {
        "vdb" => {
            let file = vdb::File::open(path)?;
            let grids = (0..file.grids().len()).map(|index| file.read_at(index));
            // One that cannot be read is no harm to the others.
            for grid in grids.filter_map(Result::ok) {
                drop(BrickGrid::from_vdb(&grid, NegativePolicy::Zero));
            }
        }
        "npy" => drop(npy::read(path)?),
        "obj" => drop(Mesh::load(path, true)?),
        "ies" | "ldt" => drop(Profile::read(path)?),
        "jpg" | "png" => drop(image::read_texture(path, false)?),
        "exr" | "hdr" | "pfm" => drop(image::read(path)?),
        _ => drop(Checkpoint::read(path)?),
    }
    Ok(())
}

/// Renders a scene small.
pub fn picture(text: &str, path: &Path) -> Result<Outcome> {
    let set: Vec<String> = SMALL.iter().map(|text| text.to_string()).collect();
    let description = scene::parse(text, path, &set)?;
    let (scene, settings) = scene::build(&description)?;
    let limits = Limits { passes: Some(1..=1), time: Some(LONGEST), ..Limits::default() };
    let rendering = refine(&scene, &settings, &limits, None, &Silent, &AtomicBool::new(false))?;
    let sound = |value: &f32| value.is_finite() && *value >= 0.0;
    let image = rendering.film.image();
    assert!(image.pixels.as_flattened().iter().all(sound), "pixels that cannot be: {:?}", image.pixels);
    for layer in rendering.film.layers() {
        if let LayerData::Rgb(values) = &layer.channels {
            assert!(values.as_flattened().iter().all(sound), "pixels that cannot be in {}: {values:?}", layer.name);
        }
    }
    Ok(if rendering.end == End::Finished { Outcome::Read } else { Outcome::Late })
}

/// With the checksum that goes with it.
pub fn sealed(mut checkpoint: Vec<u8>) -> Vec<u8> {
    if let Some(sums) = checkpoint.len().checked_sub(16) {
        let seal = xxh3_128(&checkpoint[..sums]);
        checkpoint[sums..].copy_from_slice(&seal.to_le_bytes());
    }
    checkpoint
}
