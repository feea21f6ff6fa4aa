//! What the renderer finds, and how sure it is.

use std::path::Path;
use std::sync::atomic::AtomicBool;

use rayon::prelude::*;
use volpm::{Result, render, scene};

/// A way to render.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Method {
    Path,
    Light,
    Beams,
    FixedBeams,
    Points,
    Traced,
}

impl Method {
    pub const ALL: [Method; 6] =
        [Method::Path, Method::Light, Method::Beams, Method::FixedBeams, Method::Points, Method::Traced];

    pub fn name(self) -> &'static str {
        match self {
            Method::Path => "`path`",
            Method::Light => "`light`",
            Method::Beams => "beams",
            Method::FixedBeams => "fixed beams",
            Method::Points => "points",
            Method::Traced => "traced",
        }
    }

    fn settings(self) -> &'static [&'static str] {
        match self {
            Method::Path => &["render.method=path"],
            Method::Light => &["render.method=light"],
            Method::Beams => &["render.method=photon"],
            Method::FixedBeams => &["render.method=photon", "volume.kernel=fixed", "volume.radius=0.25"],
            Method::Points => &["render.method=photon", "volume.estimate=point"],
            Method::Traced => &["render.method=photon", "volume.single_scattering=traced"],
        }
    }
}

/// How much work a number is worth.
#[derive(Clone, Copy)]
pub struct Effort {
    /// Of photon maps; twice as many of paths.
    pub seeds: u32,
    /// Camera paths for each pixel.
    pub samples: u32,
    /// Light paths for each pixel.
    pub light: u32,
    /// In a map.
    pub photons: u32,
    /// Of rays that gather, for each pixel.
    pub rays: u32,
    /// Who finds light in the peaks of phase functions (`volume.peaks`).
    pub peaks: &'static str,
}

/// A mean over seeds, and its standard error.
#[derive(Clone, Copy, Debug)]
pub struct Found {
    pub mean: f64,
    pub error: f64,
    /// Whether the renderer warned of something.
    pub warned: bool,
}

impl Found {
    /// `a + b·x` of it.
    pub fn mapped(self, a: f64, b: f64) -> Found {
        Found { mean: a + b * self.mean, error: b.abs() * self.error, ..self }
    }

    /// By how many standard errors it is off; films hold 32-bit numbers.
    pub fn sigmas(self, exact: f64) -> f64 {
        (self.mean - exact) / self.error.max(1e-6 * exact.abs())
    }

    /// Whether it tells anything: a standard error of a fifth, or no light at all, does not.
    pub fn tells(self, exact: f64) -> bool {
        self.mean != 0.0 && self.error < 0.2 * exact.abs()
    }
}

/// The mean over a scene's film.
pub fn measure(text: &str, method: Method, effort: Effort) -> Result<Found> {
    let mut common: Vec<String> = method.settings().iter().map(|text| text.to_string()).collect();
    match method {
        Method::Path => common.push(format!("render.samples={}", effort.samples)),
        Method::Light => common.push(format!("render.samples={}", effort.light)),
        _ => common.extend([
            format!("render.samples={}", effort.rays),
            format!("photons.volume={}", effort.photons),
            format!("volume.peaks={}", effort.peaks),
        ]),
    }
    let one = |seed: u32| -> Result<(f64, bool)> {
        let mut overrides = common.clone();
        overrides.push(format!("render.seed={seed}"));
        let description = scene::parse(text, Path::new("certified.toml"), &overrides)?;
        let (scene, settings) = scene::build(&description)?;
        let rendering = render::render(&scene, &settings, &render::Silent, &AtomicBool::new(false))?;
        Ok((rendering.film.image().mean(), !rendering.warnings.is_empty()))
    };
    // Maps take longer than films.
    let seeds = if matches!(method, Method::Path | Method::Light) { 2 * effort.seeds } else { effort.seeds };
    let found: Vec<(f64, bool)> = (1..=seeds).into_par_iter().map(one).collect::<Result<_>>()?;
    let n = found.len() as f64;
    let mean = found.iter().map(|(x, _)| x).sum::<f64>() / n;
    let variance = found.iter().map(|(x, _)| (x - mean).powi(2)).sum::<f64>() / (n - 1.0);
    Ok(Found { mean, error: (variance / n).sqrt(), warned: found.iter().any(|(_, warned)| *warned) })
}

/// Seconds of all threads of this program.
pub fn cpu_seconds() -> f64 {
    let mut time = libc::timespec { tv_sec: 0, tv_nsec: 0 };
    // SAFETY: `time` is a valid place to write to.
    unsafe { libc::clock_gettime(libc::CLOCK_PROCESS_CPUTIME_ID, &mut time) };
    time.tv_sec as f64 + 1e-9 * time.tv_nsec as f64
}
