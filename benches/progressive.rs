//! How fast the error of passes falls with the number of photons: noise and blur together.
//!
//! A smooth cloud in parallel light, against the path tracer. Writes RMSE, as a share of the mean, by
//! photons, and the slope of its logarithm: −1/3 for beams, −2/7 for points.

use std::sync::Mutex;
use std::sync::atomic::AtomicBool;

use rayon::prelude::*;
use volpm::image::Image;
use volpm::render::{Film, Limits, Progress, Stats, refine};
use volpm::scene;

/// The square root of the number of pixels: so many that discs stay wider than they are, as they would else
/// average out noise but not blur.
const WIDTH: usize = 48;
/// Voxels along an edge.
const VOXELS: usize = 24;
/// Photons of a pass.
const PHOTONS: f64 = 4000.0;
/// Independent renders.
const SEEDS: u32 = 4;

fn text() -> String {
    format!(
        r#"
[film]
width = {WIDTH}
height = {WIDTH}
layers = false
[camera]
position = [0, 0, 6]
target = [0, 0, 0]
fov = 16
[world]
medium = "cloud"
[media.cloud]
sigma_t = 1.5
albedo = 0.8
density = {{ type = "array", file = "cloud.npy", min = [-2, -2, -2], max = [2, 2, 2] }}
[[lights]]
type = "directional"
direction = [1, -1, 0.5]
irradiance = 1
"#
    )
}

/// A density that falls off smoothly to nothing.
fn cloud() -> Vec<u8> {
    let mut header = format!("{{'descr': '<f4', 'fortran_order': False, 'shape': ({VOXELS}, {VOXELS}, {VOXELS}), }}");
    while (10 + header.len() + 1) % 64 != 0 {
        header.push(' ');
    }
    header.push('\n');
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend((header.len() as u16).to_le_bytes());
    bytes.extend(header.bytes());
    let at = |i: usize| 4.0 * (i as f64 + 0.5) / VOXELS as f64 - 2.0;
    for index in 0..VOXELS.pow(3) {
        let (x, y, z) = (at(index % VOXELS), at(index / VOXELS % VOXELS), at(index / VOXELS / VOXELS));
        let density = (-2.0 * (x * x + y * y + z * z)).exp();
        bytes.extend((density as f32).to_le_bytes());
    }
    bytes
}

/// Keeps the images after 1, 2, 4, … passes.
#[derive(Default)]
struct Album(Mutex<Vec<(u64, Image)>>);

impl Progress for Album {
    fn phase(&self, _: &'static str, _: u64) {}
    fn advance(&self, _: u64) {}
    fn refined(&self, film: &Film, stats: &Stats) {
        if stats.passes.is_power_of_two()
            && let Ok(mut images) = self.0.lock()
        {
            images.push((stats.passes, film.image()));
        }
    }
}

fn render(folder: &std::path::Path, passes: u32, overrides: &[String]) -> Vec<(u64, Image)> {
    let description = scene::parse(&text(), &folder.join("scene.toml"), overrides).expect("a scene");
    let (scene, settings) = scene::build(&description).expect("a scene");
    let limits = Limits { passes: Some(1..=passes), ..Limits::default() };
    let album = Album::default();
    refine(&scene, &settings, &limits, None, &album, &AtomicBool::new(false)).expect("a render");
    album.0.into_inner().unwrap_or_default()
}

/// The mean over pixels of a product of two differences from a reference.
fn product(a: &Image, b: &Image, references: [&Image; 2]) -> f64 {
    let values = |image: &Image| image.pixels.iter().flatten().map(|value| *value as f64).collect::<Vec<f64>>();
    let (a, b, [p, q]) = (values(a), values(b), references.map(values));
    (0..a.len()).map(|i| (a[i] - p[i]) * (b[i] - q[i])).sum::<f64>() / a.len() as f64
}

fn main() {
    let mut numbers = std::env::args().skip(1).filter_map(|argument| argument.parse::<u32>().ok());
    let passes = numbers.next().unwrap_or(256);
    let reference_samples = numbers.next().unwrap_or(1024);
    let folder = tempfile::tempdir().expect("a folder");
    std::fs::write(folder.path().join("cloud.npy"), cloud()).expect("a file");

    // Two references: the product of the differences from either has no variance of theirs in it.
    let references: Vec<Image> = [101, 102]
        .into_par_iter()
        .map(|seed| {
            let set = [
                "render.method=path".to_string(),
                format!("render.samples={reference_samples}"),
                format!("render.seed={seed}"),
            ];
            render(folder.path(), 1, &set).swap_remove(0).1
        })
        .collect();
    let level = references[0].mean();

    let (fixed, variable) = ("volume.radius=0.25", "volume.neighbours=60");
    for (estimate, name, extra) in [
        ("beam", "fixed", fixed),
        ("beam", "variable", variable),
        ("point", "fixed", fixed),
        ("point", "knn", variable),
    ] {
        let albums: Vec<Vec<(u64, Image)>> = (1..=SEEDS)
            .into_par_iter()
            .map(|seed| {
                let set = [
                    format!("volume.estimate={estimate}"),
                    format!("volume.kernel={name}"),
                    extra.to_string(),
                    "volume.max_radius=10".to_string(),
                    format!("photons.volume={PHOTONS}"),
                    "render.samples=1".to_string(),
                    format!("render.seed={seed}"),
                ];
                render(folder.path(), passes, &set)
            })
            .collect();
        println!("{estimate}s, {name} radii, {extra}: photons, RMSE, of it blur, as shares of the mean {level:.4}");
        let mut points = Vec::new();
        for step in 0..albums[0].len() {
            let images: Vec<&Image> = albums.iter().map(|album| &album[step].1).collect();
            let both = [&references[0], &references[1]];
            let squared = images.iter().map(|image| product(image, image, both)).sum::<f64>() / images.len() as f64;
            // Of different seeds only what they share: the blur.
            let pairs = (0..images.len()).flat_map(|i| (0..i).map(move |j| (i, j)));
            let products: Vec<f64> = pairs.map(|(i, j)| product(images[i], images[j], both)).collect();
            let blur = products.iter().sum::<f64>() / products.len() as f64;
            let photons = albums[0][step].0 as f64 * PHOTONS;
            let (rmse, blur) = (squared.max(0.0).sqrt() / level, blur.max(0.0).sqrt() / level);
            println!("{photons:>12} {rmse:10.5} {blur:10.5}");
            points.push((photons.ln(), rmse.ln()));
        }
        // After the first passes, whose radii still are what they were.
        let points: Vec<(f64, f64)> = points.into_iter().skip(3).collect();
        let n = points.len() as f64;
        let (x, y) = (points.iter().map(|p| p.0).sum::<f64>() / n, points.iter().map(|p| p.1).sum::<f64>() / n);
        let covariance: f64 = points.iter().map(|p| (p.0 - x) * (p.1 - y)).sum();
        let slope = covariance / points.iter().map(|p| (p.0 - x).powi(2)).sum::<f64>();
        println!("slope from 8 passes on: {slope:.3}");
    }
}
