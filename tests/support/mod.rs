//! What tests share: scenes from text, renders, and estimates with their standard error.

use std::path::Path;
use std::sync::atomic::AtomicBool;

use volpm::image::Image;
use volpm::render::{Rendering, Silent, render as render_scene};
use volpm::scene::{self, Scene};

/// A scene from the text of a scene file; relative paths start at `tests/data`.
pub fn scene(text: &str, overrides: &[&str]) -> Scene {
    let overrides: Vec<String> = overrides.iter().map(|text| text.to_string()).collect();
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/scene.toml");
    let description = scene::parse(text, &path, &overrides).unwrap_or_else(|error| panic!("{error}"));
    scene::build(&description).unwrap_or_else(|error| panic!("{error}"))
}

/// A whole render.
pub fn render(text: &str, overrides: &[&str]) -> Rendering {
    render_scene(&scene(text, overrides), &Silent, &AtomicBool::new(false)).unwrap_or_else(|error| panic!("{error}"))
}

/// A mean over an image's pixels, and its standard error over independent seeds.
#[derive(Clone, Copy, Debug)]
pub struct Estimate {
    pub mean: [f64; 3],
    pub standard_error: [f64; 3],
}

impl Estimate {
    /// Of what `measure` finds in renders with seeds 1, 2, …
    pub fn over(seeds: u32, text: &str, overrides: &[&str], measure: impl Fn(&Image) -> [f64; 3]) -> Self {
        let found: Vec<[f64; 3]> = (1..=seeds)
            .map(|seed| {
                let seed = format!("render.seed={seed}");
                let mut overrides = overrides.to_vec();
                overrides.push(&seed);
                measure(&render(text, &overrides).film.image())
            })
            .collect();
        let n = found.len() as f64;
        let mean: [f64; 3] = std::array::from_fn(|c| found.iter().map(|f| f[c]).sum::<f64>() / n);
        let standard_error = std::array::from_fn(|c| {
            let variance = found.iter().map(|f| (f[c] - mean[c]).powi(2)).sum::<f64>() / (n - 1.0);
            (variance / n).sqrt()
        });
        Estimate { mean, standard_error }
    }

    /// Of the mean over the whole image.
    pub fn of(seeds: u32, text: &str, overrides: &[&str]) -> Self {
        Self::over(seeds, text, overrides, |image| image.channel_means())
    }

    /// Asserts agreement with another estimate as the design defines it: the means differ by at most 3 standard
    /// errors, which are at most `precision` of the mean, plus a stated bias, as shares of the mean.
    #[track_caller]
    pub fn assert_agrees(&self, what: &str, other: &Estimate, precision: f64, bias: f64) {
        for c in 0..3 {
            let scale = other.mean[c].abs();
            let error = self.standard_error[c].hypot(other.standard_error[c]);
            let difference = self.mean[c] - other.mean[c];
            assert!(
                error <= precision * scale * 2f64.sqrt(),
                "{what}, channel {c}: standard error {error:e} of {scale:e} is too large to say anything"
            );
            assert!(
                difference.abs() <= 3.0 * error + bias * scale,
                "{what}, channel {c}: {} against {}: {:+.3} %, {:.1} standard errors",
                self.mean[c],
                other.mean[c],
                100.0 * difference / scale,
                difference / error
            );
        }
    }

    /// An exact value.
    pub fn exact(mean: [f64; 3]) -> Self {
        Estimate { mean, standard_error: [0.0; 3] }
    }
}
