//! What tests share: scenes from text, renders, and estimates with their standard error.

#[cfg(feature = "report")]
pub mod browser;

use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;

use rayon::prelude::*;
use volpm::image::{self, Image};
use volpm::render::{Rendering, Silent, render as render_scene};
use volpm::scene::{self, Scene};

/// A file under `tests/data`.
pub fn data(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data").join(path)
}

/// A stored image.
pub fn image(path: &str) -> Image {
    image::read(data(path)).unwrap_or_else(|error| panic!("{error}")).image
}

/// The text of a stored scene.
pub fn scene_text(path: &str) -> String {
    std::fs::read_to_string(data(path)).unwrap_or_else(|error| panic!("{path}: {error}"))
}

/// A scene from the text of a scene file; relative paths start at `tests/data`.
pub fn scene(text: &str, overrides: &[&str]) -> Scene {
    let overrides: Vec<String> = overrides.iter().map(|text| text.to_string()).collect();
    let description =
        scene::parse(text, &data("scene.toml"), &overrides).unwrap_or_else(|error| panic!("{error}\n{text}"));
    scene::build(&description).unwrap_or_else(|error| panic!("{error}\n{text}"))
}

/// A whole render.
pub fn render(text: &str, overrides: &[&str]) -> Rendering {
    render_scene(&scene(text, overrides), &Silent, &AtomicBool::new(false)).unwrap_or_else(|error| panic!("{error}"))
}

/// The images of renders with seeds 1, 2, …
pub fn images(seeds: u32, text: &str, overrides: &[&str]) -> Vec<Image> {
    // Small films do not fill a machine: seeds run side by side.
    (1..=seeds)
        .into_par_iter()
        .map(|seed| {
            let seed = format!("render.seed={seed}");
            let mut overrides = overrides.to_vec();
            overrides.push(&seed);
            render(text, &overrides).film.image()
        })
        .collect()
}

/// A mean by channel, and its standard error over independent seeds.
#[derive(Clone, Copy, Debug)]
pub struct Estimate {
    pub mean: [f64; 3],
    pub standard_error: [f64; 3],
}

impl Estimate {
    /// Of what `measure` finds in images of independent seeds.
    pub fn over(images: &[Image], measure: impl Fn(&Image) -> [f64; 3]) -> Self {
        let found: Vec<[f64; 3]> = images.iter().map(measure).collect();
        let n = found.len() as f64;
        let mean: [f64; 3] = std::array::from_fn(|c| found.iter().map(|f| f[c]).sum::<f64>() / n);
        let standard_error = std::array::from_fn(|c| {
            let variance = found.iter().map(|f| (f[c] - mean[c]).powi(2)).sum::<f64>() / (n - 1.0);
            (variance / n).sqrt()
        });
        Estimate { mean, standard_error }
    }

    /// Of the mean over the whole image, in renders with seeds 1, 2, …
    pub fn of(seeds: u32, text: &str, overrides: &[&str]) -> Self {
        Self::over(&images(seeds, text, overrides), Image::channel_means)
    }

    /// An exact value.
    pub fn exact(mean: [f64; 3]) -> Self {
        Estimate { mean, standard_error: [0.0; 3] }
    }

    /// All channels times a factor.
    pub fn times(self, factor: f64) -> Self {
        Estimate { mean: self.mean.map(|x| x * factor), standard_error: self.standard_error.map(|x| x * factor.abs()) }
    }

    /// The difference from `other` as a share of it, and the standard error of that, by channel.
    pub fn bias(&self, other: &Estimate) -> [(f64, f64); 3] {
        std::array::from_fn(|c| {
            let scale = other.mean[c].abs();
            let error = self.standard_error[c].hypot(other.standard_error[c]);
            ((self.mean[c] - other.mean[c]) / scale, error / scale)
        })
    }
}

/// A list of comparisons, all made before the first that fails ends the test: a pattern in what fails says more
/// than one number.
#[derive(Default)]
pub struct Checks {
    made: usize,
    failed: usize,
}

impl Checks {
    /// Checks that two estimates agree as the design defines it: the means differ by at most 3 standard errors,
    /// each of which is at most `precision` of the mean, plus a stated bias, as shares of the mean.
    pub fn agree(&mut self, what: &str, found: &Estimate, expected: &Estimate, precision: f64, bias: f64) {
        for c in 0..3 {
            let scale = expected.mean[c].abs();
            let error = found.standard_error[c].hypot(expected.standard_error[c]);
            let difference = found.mean[c] - expected.mean[c];
            // Numbers of a film are 32-bit.
            let rounding = 1e-6 * scale;
            let precise =
                found.standard_error[c] <= precision * scale && expected.standard_error[c] <= precision * scale;
            let agrees = difference.abs() <= 3.0 * error + bias * scale + rounding;
            self.line(
                precise && agrees,
                format!(
                    "{what}, channel {c}: {:.6e} ± {:.3} % against {:.6e} ± {:.3} %: {:+.3} %, {:+.1} standard errors{}{}",
                    found.mean[c],
                    100.0 * found.standard_error[c] / scale,
                    expected.mean[c],
                    100.0 * expected.standard_error[c] / scale,
                    100.0 * difference / scale,
                    difference / error,
                    if agrees { "" } else { " DIFFERS" },
                    if precise { "" } else { " TOO NOISY" },
                ),
            );
        }
    }

    /// Checks anything else.
    pub fn holds(&mut self, what: String, holds: bool) {
        self.line(holds, what);
    }

    fn line(&mut self, holds: bool, text: String) {
        self.made += 1;
        self.failed += usize::from(!holds);
        println!("{} {text}", if holds { "  " } else { "✗ " });
    }

    /// Ends the test.
    #[track_caller]
    pub fn finish(self) {
        assert!(self.failed == 0, "{} of {} comparisons failed (✗)", self.failed, self.made);
    }
}

/// Fog and a grid, a diffuse wall, lights of several kinds: all random numbers there are.
pub const ALL_SORTS: &str = r#"
[film]
width = 40
height = 36
[camera]
position = [0, 0.2, 4]
target = [0, 0, 0]
fov = 40
[world]
medium = "haze"
[media.haze]
sigma_s = [0.05, 0.1, 0.2]
sigma_a = 0.02
[media.smoke]
sigma_t = 4
albedo = 0.9
density = { type = "vdb", file = "reference/smoke_grid/smoke_grid_64.vdb", grid = "density" }
phase = { type = "hg", g = 0.4 }
[materials.white]
type = "lambert"
reflectance = 0.7
[[shapes]]
type = "box"
min = [-1, -1, -1]
max = [1, 1, 1]
interior = "smoke"
[[shapes]]
type = "quad"
origin = [-4, -1.2, 4]
edge_u = [8, 0, 0]
edge_v = [0, 0, -8]
material = "white"
[[shapes]]
type = "sphere"
center = [2, 2, 1]
radius = 0.2
emission = { radiance = 40 }
[[lights]]
type = "point"
position = [-2, 1, 1]
intensity = [1, 2, 3]
[render]
samples = 3
[photons]
volume = 30_000
"#;
