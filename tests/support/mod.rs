//! What tests share: scenes from text, renders, and estimates with their standard error.

#[cfg(feature = "report")]
pub mod browser;

use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;
use std::time::{Duration, Instant};

use rayon::prelude::*;
use volpm::image::{self, Image};
use volpm::render::{Rendering, Silent, render as render_scene};
use volpm::scene::{self, Scene, Settings};

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
    built(text, overrides).0
}

/// A scene and its settings from the text of a scene file; relative paths start at `tests/data`.
pub fn built(text: &str, overrides: &[&str]) -> (Scene, Settings) {
    let overrides: Vec<String> = overrides.iter().map(|text| text.to_string()).collect();
    let description =
        scene::parse(text, &data("scene.toml"), &overrides).unwrap_or_else(|error| panic!("{error}\n{text}"));
    scene::build(&description).unwrap_or_else(|error| panic!("{error}\n{text}"))
}

/// A whole render.
pub fn render(text: &str, overrides: &[&str]) -> Rendering {
    let (scene, settings) = built(text, overrides);
    render_scene(&scene, &settings, &Silent, &AtomicBool::new(false)).unwrap_or_else(|error| panic!("{error}"))
}

/// The images of renders with seeds 1, 2, …
pub fn images(seeds: u32, text: &str, overrides: &[&str]) -> Vec<Image> {
    Effort::once(seeds).images(text, overrides, |_| true)
}

/// How many independent samples are drawn.
#[derive(Clone, Copy, Debug)]
pub struct Effort {
    /// Samples are numbered from here.
    from: u32,
    /// So many are drawn, then half as many again, and again, until they are enough,
    first: u32,
    /// or another round would take longer than this in all.
    longest: Duration,
}

impl Effort {
    /// Samples 1 to `count`.
    pub fn once(count: u32) -> Self {
        Effort { from: 1, first: count, longest: Duration::ZERO }
    }

    /// As many as the case of this name needs, for tests run by hand: for at most `VOLPM_SECONDS` (600), with seeds of its
    /// own, others for each `VOLPM_SEED` (1).
    pub fn patient(what: &str, first: u32) -> Self {
        let number = |name: &str, default: u32| {
            std::env::var(name).map_or(default, |text| text.parse().unwrap_or_else(|_| panic!("{name}={text}")))
        };
        let longest = Duration::from_secs(number("VOLPM_SECONDS", 600).into());
        // FNV-1a: cases that shared random numbers would err together.
        let hash = |hash: u32, byte: u8| (hash ^ u32::from(byte)).wrapping_mul(16_777_619);
        let from = what.bytes().fold(number("VOLPM_SEED", 1).wrapping_mul(2_166_136_261), hash) >> 1;
        Effort { from, first, longest }
    }

    /// The samples, by their numbers.
    pub fn draw<T: Send>(&self, draw: impl Fn(u32) -> T + Sync, enough: impl Fn(&[T]) -> bool) -> Vec<T> {
        let (start, mut found, mut round) = (Instant::now(), Vec::new(), self.first);
        loop {
            let next = self.from + found.len() as u32;
            found.par_extend((next..next + round).into_par_iter().map(&draw));
            if enough(&found) || start.elapsed().mul_f64(1.5) > self.longest {
                return found;
            }
            round = (found.len() as u32).div_ceil(2);
        }
    }

    /// The images of renders, whose seeds are the samples' numbers.
    pub fn images(&self, text: &str, overrides: &[&str], enough: impl Fn(&[Image]) -> bool) -> Vec<Image> {
        // Small films do not fill a machine: seeds run side by side.
        let image = |seed: u32| {
            let seed = format!("render.seed={seed}");
            let mut overrides = overrides.to_vec();
            overrides.push(&seed);
            render(text, &overrides).film.image()
        };
        self.draw(image, enough)
    }

    /// The mean over whole images, until its standard error is at most `precise` in every channel, which it takes from
    /// the mean.
    pub fn estimate(&self, text: &str, overrides: &[&str], precise: impl Fn(f64) -> f64) -> Estimate {
        let over = |images: &[Image]| Estimate::over(images, Image::channel_means);
        over(&self.images(text, overrides, |images| over(images).is_within(&precise)))
    }
}

/// Whether a case of a test run by hand is to be run: its name holds all parts of `VOLPM_CASES`, which semicolons divide.
pub fn chosen(what: &str) -> bool {
    std::env::var("VOLPM_CASES").map_or(true, |parts| parts.split(';').all(|part| what.contains(part)))
}

/// A mean by channel, and its standard error over independent seeds.
#[derive(Clone, Copy, Debug)]
pub struct Estimate {
    pub mean: [f64; 3],
    pub standard_error: [f64; 3],
}

impl Estimate {
    /// Of what `measure` finds in independent samples.
    pub fn over<T>(samples: &[T], measure: impl Fn(&T) -> [f64; 3]) -> Self {
        let found: Vec<[f64; 3]> = samples.iter().map(measure).collect();
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

    /// Whether the standard errors are at most what `precise` makes of the means.
    pub fn is_within(&self, precise: impl Fn(f64) -> f64) -> bool {
        (0..3).all(|c| self.standard_error[c] <= precise(self.mean[c]))
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

/// For [`Checks::close`]: the difference is within what is allowed, and the standard error a third of that.
pub const STRICT: (f64, f64) = (0.0, 1.0 / 3.0);

/// How far a number may be from one that is expected: a share of it above 1e-3, below 1e-4.
pub fn allowed(expected: f64, share: f64) -> f64 {
    if expected > 1e-3 { share * expected } else { 1e-4 }
}

/// The channels to look at: one of grey.
fn channels(found: &Estimate, expected: &Estimate) -> std::ops::Range<usize> {
    let grey = |x: &[f64; 3]| x[0] == x[1] && x[0] == x[2];
    let all = [found, expected].into_iter().flat_map(|estimate| [&estimate.mean, &estimate.standard_error]);
    0..if all.into_iter().all(grey) { 1 } else { 3 }
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
        for c in channels(found, expected) {
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

    /// Checks that numbers are as close as the subsurface issue asks: above 1e-3 to a share of themselves, below to
    /// 1e-4. `sure.0` standard errors are allowed beyond that, each at most `sure.1` of what is allowed.
    pub fn close(&mut self, what: &str, found: &Estimate, expected: &Estimate, share: f64, sure: (f64, f64)) {
        for c in channels(found, expected) {
            let scale = expected.mean[c];
            let allowed = allowed(scale, share);
            let error = found.standard_error[c].hypot(expected.standard_error[c]);
            let difference = found.mean[c] - scale;
            let (precise, close) = (error <= sure.1 * allowed, difference.abs() <= allowed + sure.0 * error);
            self.line(
                precise && close,
                format!(
                    "{what}, channel {c}: {:.4e} against {scale:.4e}: {difference:+.1e} ± {error:.1e}, {:+.2} ± {:.2} %, \
                     {:+.1} standard errors{}{}",
                    found.mean[c],
                    100.0 * difference / scale,
                    100.0 * error / scale,
                    difference / error,
                    if close { "" } else { " DIFFERS" },
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
