//! A comparison measures what it says: bias as bias and noise as noise, the same figures whenever it is repeated or
//! continued, and variants on one map that differ in nothing but gathering.

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, Ordering};

use volpm::compare::results::{Figures, Results, Variant};
use volpm::compare::sweep::Range;
use volpm::compare::{self, Request, Watch};
use volpm::image::{self, Image};
use volpm::render::Progress;

use crate::support::render;

/// A shaft of light through a box of fog, onto a floor.
const SCENE: &str = r#"
[film]
width = 24
height = 18
[camera]
position = [0, 0.3, 4.5]
target = [0, 0, 0]
fov = 40
[media.fog]
sigma_s = 0.4
sigma_a = 0.1
[materials.white]
type = "lambert"
reflectance = 0.5
[[shapes]]
type = "box"
min = [-1.5, -1, -1.5]
max = [1.5, 1, 1.5]
interior = "fog"
[[shapes]]
type = "quad"
origin = [-3, -1.01, 3]
edge_u = [6, 0, 0]
edge_v = [0, 0, -6]
material = "white"
[[lights]]
type = "spot"
position = [0.5, 2, 0]
target = [0, 0, 0]
intensity = 30
inner_angle = 8
outer_angle = 12
[render]
samples = 4
[photons]
volume = 20_000
[volume]
neighbours = 40
[surface]
indirect = "path"
"#;

/// A folder with the scene, and a comparison that goes with it.
fn study(compare: &str) -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.toml");
    fs::write(&path, format!("{SCENE}[compare]\n{compare}")).unwrap();
    (folder, path)
}

/// Notes what begins, and stops after some time.
#[derive(Default)]
struct Notes {
    begun: Mutex<Vec<String>>,
    stop: AtomicBool,
    /// Stop at the first samples of this.
    stop_at: Option<&'static str>,
}

impl Progress for Notes {
    fn phase(&self, _: &'static str, _: u64) {}

    fn advance(&self, _: u64) {
        let begun = self.begun.lock().unwrap();
        if self.stop_at.is_some() && begun.last().map(String::as_str) == self.stop_at {
            self.stop.store(true, Ordering::Relaxed);
        }
    }
}

impl Watch for Notes {
    fn begins(&self, what: &str) {
        self.begun.lock().unwrap().push(what.to_string());
    }
}

fn run(scene: &Path, folder: &Path, threads: usize, notes: &Notes) -> volpm::Result<Results> {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
    let request = Request::read(scene)?;
    pool.install(|| compare::run(&request, folder, notes, &notes.stop))
}

fn simply(compare: &str) -> (tempfile::TempDir, Results) {
    let (folder, scene) = study(compare);
    let results = run(&scene, &folder.path().join("report"), 2, &Notes::default()).unwrap();
    (folder, results)
}

/// Figures of the whole image at a budget.
fn figures<'r>(results: &'r Results, variant: &str, budget: usize) -> &'r Figures {
    let variant = results.variants.iter().find(|found| found.name == variant).unwrap();
    &variant.measures[budget].measured.as_ref().unwrap().regions[0]
}

/// What must not depend on when and how often a comparison was made: figures and images.
fn essence(results: &Results, folder: &Path) -> Vec<(Vec<Figures>, Image)> {
    let measured = results.variants.iter().flat_map(|variant| &variant.measures).flat_map(|m| &m.measured);
    measured.map(|m| (m.regions.clone(), image::read(folder.join(&m.image)).unwrap().image)).collect()
}

#[test]
fn bias_shows_as_bias_and_noise_as_noise() {
    let (folder, results) = simply(
        r#"
        samples = [16]
        seeds = 4
        set = { render.max_depth = 1 }
        reference = "path"
        reference_error = 0.02
        layer = "volume"
        regions = [{ name = "shaft", x = 8, y = 0, width = 8, height = 12 }]
        variants = [
            { name = "fine", of = "beam-fixed", set = { volume.radius = 0.05 } },
            { name = "wide", of = "beam-fixed", set = { volume.radius = 0.5 } },
            { name = "noisy", of = "beam-fixed", set = { volume.radius = 0.05, photons.volume = 1000 } },
        ]
        "#,
    );
    let level = results.reference.regions[1].mean[0].powi(2);
    let of = |name: &str| {
        let variant = results.variants.iter().find(|variant| variant.name == name).unwrap();
        let shaft = &variant.measures[0].measured.as_ref().unwrap().regions[1];
        let (bias2, variance) = (shaft.bias2.unwrap(), shaft.variance.unwrap());
        assert!((bias2.value + variance.value - shaft.mse.value).abs() < 1e-9 * shaft.mse.value);
        (bias2.value / level, variance.value / level, bias2.error.unwrap() / level)
    };
    let ((fine_bias, fine_noise, _), (wide_bias, wide_noise, error), (noisy_bias, noisy_noise, noisy_error)) =
        (of("fine"), of("wide"), of("noisy"));
    // Ten times the radius blurs a shaft as wide as that; a twentieth of the photons have twenty times the variance.
    assert!(wide_bias > 0.05 && wide_bias > 10.0 * wide_noise && wide_bias > 10.0 * error, "{wide_bias} {wide_noise}");
    assert!(wide_bias > 10.0 * fine_bias.abs(), "{wide_bias} {fine_bias}");
    assert!((10.0..40.0).contains(&(noisy_noise / fine_noise)), "{noisy_noise} {fine_noise}");
    assert!(noisy_bias.abs() < 0.1 * noisy_noise + 3.0 * noisy_error, "{noisy_bias} {noisy_noise} ± {noisy_error}");
    // In the picture: the mean over seeds keeps the blur.
    let wide = results.variants[1].measures[0].measured.as_ref().unwrap();
    let mean = image::read(folder.path().join("report").join(wide.mean_image.as_ref().unwrap())).unwrap().image;
    assert_eq!((mean.width, mean.height), (24, 18));
}

#[test]
fn a_comparison_by_samples_repeats_itself_and_goes_on_where_it_stopped() {
    let compare = r#"
        samples = [1, 4, 9]
        seeds = 2
        reference_error = 0.2
        variants = ["path", "beam", "point-exponential"]
    "#;
    let (folder, scene) = study(compare);
    let at = |name: &str| folder.path().join(name);
    let whole = run(&scene, &at("whole"), 2, &Notes::default()).unwrap();
    assert!(whole.complete);
    let expected = essence(&whole, &at("whole"));
    assert_eq!(expected.len(), 9);

    // Again in the same folder: nothing is rendered.
    let notes = Notes::default();
    let again = run(&scene, &at("whole"), 2, &notes).unwrap();
    assert!(notes.begun.into_inner().unwrap().is_empty());
    assert_eq!(essence(&again, &at("whole")), expected);

    // Stopped among the reference's samples, and among those of a variant.
    let stopped = |at: &Path, stop_at| {
        let notes = Notes { stop_at: Some(stop_at), ..Notes::default() };
        run(&scene, at, 2, &notes)
    };
    let parts = at("parts");
    assert!(matches!(stopped(&parts, "reference to 20 %"), Err(volpm::Error::Interrupted)));
    let part = stopped(&parts, "beam, seed 2").unwrap();
    assert!(!part.complete);
    assert!(part.variants[0].measures[2].measured.is_some());
    let notes = Notes::default();
    let continued = run(&scene, &parts, 2, &notes).unwrap();
    assert_eq!(notes.begun.into_inner().unwrap(), ["beam, seed 2", "point-exponential, seed 2"]);
    assert!(continued.complete);
    assert_eq!(essence(&continued, &parts), expected);

    // Other settings are other runs.
    fs::write(&scene, fs::read_to_string(&scene).unwrap().replace("neighbours = 40", "neighbours = 30")).unwrap();
    let notes = Notes::default();
    run(&scene, &parts, 2, &notes).unwrap();
    let begun = notes.begun.into_inner().unwrap();
    assert!(begun.contains(&"beam, seed 1".to_string()), "{begun:?}");
}

/// Many events between lamp and eye: the first numbers of a sample, which are spread evenly and make a pixel converge
/// faster where they matter, do not matter here.
const SLAB: &str = r#"
[film]
width = 16
height = 12
[camera]
position = [0, 0, 4.5]
target = [0, 0, 0]
fov = 20
[media.fog]
sigma_s = 3.5
[[shapes]]
type = "box"
min = [-4, -4, -1.5]
max = [4, 4, 1.5]
interior = "fog"
[[shapes]]
type = "quad"
origin = [-3, -3, -1.6]
edge_u = [6, 0, 0]
edge_v = [0, 6, 0]
emission = { radiance = 10 }
[compare]
samples = [8, 16, 32, 64, 128]
seeds = 12
reference_error = 0.3
variants = ["path"]
"#;

#[test]
fn path_tracing_falls_with_the_root_of_samples() {
    let folder = tempfile::tempdir().unwrap();
    let scene = folder.path().join("slab.toml");
    fs::write(&scene, SLAB).unwrap();
    let results = run(&scene, &folder.path().join("report"), 2, &Notes::default()).unwrap();
    let point = |budget: usize| {
        let figures = figures(&results, "path", budget);
        let (bias2, variance) = (figures.bias2.unwrap(), figures.variance.unwrap().value);
        // All of it is noise, as far as the reference can tell.
        assert!(bias2.value.abs() < 4.0 * bias2.error.unwrap() + 0.1 * variance, "{bias2:?} {variance}");
        (results.study.budgets.values[budget].ln(), 0.5 * variance.ln())
    };
    let points: Vec<(f64, f64)> = (0..5).map(point).collect();
    let mean = |of: &dyn Fn(&(f64, f64)) -> f64| points.iter().map(of).sum::<f64>() / points.len() as f64;
    let (x, y) = (mean(&|p| p.0), mean(&|p| p.1));
    let slope = mean(&|p| (p.0 - x) * (p.1 - y)) / mean(&|p| (p.0 - x).powi(2));
    assert!((slope + 0.5).abs() < 0.03, "{slope}: {points:?}");
}

#[test]
fn variants_on_one_map_differ_only_in_gathering() {
    let (folder, results) = simply(
        r#"
        samples = [16]
        seeds = 4
        same_map = true
        reference = "own"
        limit_samples = 64
        variants = ["beam", "point-uniform", "point-adaptive", "beam-fixed"]
        "#,
    );
    let map = results.study.same_map.as_ref().unwrap();
    for variant in &results.variants {
        assert_eq!((variant.statistics.photons, variant.statistics.emitted), (map.photons, map.emitted));
        // The limit has no error but noise, of which none is left that several seeds share.
        let whole = figures(&results, &variant.name, 0);
        let (bias2, variance) = (whole.bias2.unwrap().value, whole.variance.unwrap().value);
        assert!(bias2.abs() < 0.25 * variance, "{}: {bias2} {variance}", variant.name);
    }
    // The scene says nothing of a fixed radius: it is as wide as the others are on average.
    let [beam, .., fixed] = &results.variants[..] else { panic!() };
    let mean = |variant: &Variant| variant.statistics.radii.unwrap()[1];
    assert!((mean(fixed) / mean(beam) - 1.0).abs() < 0.01, "{} {}", mean(fixed), mean(beam));
    assert!(fixed.notes[0].starts_with("volume.radius = "), "{:?}", fixed.notes);

    // All marchers have one limit, beams another.
    let limit = |index: usize| results.variants[index].limit.as_ref().unwrap().image.clone().unwrap();
    assert_eq!(limit(1), limit(2));
    assert_ne!(limit(0), limit(1));

    // The map is that of the scene's first pass, whatever seed the samples have.
    for (variant, estimate) in [(0, "beam"), (1, "point")] {
        let measured = results.variants[variant].measures[0].measured.as_ref().unwrap();
        let found = image::read(folder.path().join("report").join(&measured.image)).unwrap().image;
        let estimate = format!("volume.estimate={estimate}");
        let plain =
            render(SCENE, &[&estimate, "volume.march.step=uniform", "render.samples=16", "render.adaptive=false"])
                .film
                .image();
        let scale = plain.mean() as f32;
        for (a, b) in found.pixels.as_flattened().iter().zip(plain.pixels.as_flattened()) {
            assert!((a - b).abs() < 1e-4 * (scale + b), "{estimate}: {a} {b}");
        }
    }
}

#[test]
fn tuning_meets_the_time_or_says_that_it_cannot() {
    let (_folder, results) = simply(
        r#"
        budgets = [1e-6, 0.05, 0.4]
        same_map = true
        reference_error = 0.3
        variants = [{ name = "march", of = "point-uniform", tune = "volume.march.size", samples = [1, 2] }]
        "#,
    );
    let tuned: Vec<_> =
        results.variants[0].measures.iter().map(|m| m.measured.as_ref().unwrap().tuned.clone().unwrap()).collect();
    assert!(tuned[0].over && tuned[0].trials.len() == 1);
    assert!(!tuned[2].over && tuned[2].trials.len() == 2);
    let size = |index: usize| tuned[index].setting.value.parse::<f64>().unwrap();
    assert!(size(0) > size(1) && size(1) > size(2), "{tuned:?}");
}

#[test]
fn a_budget_that_is_too_short_is_not_reached() {
    let (_folder, results) = simply("budgets = [1e-6, 0.5]\nreference_error = 0.3\nvariants = [\"beam\", \"path\"]");
    for variant in &results.variants {
        assert!(variant.measures[0].measured.is_none());
        let seconds = variant.measures[1].measured.as_ref().unwrap().seconds.value;
        assert!(seconds > 0.0 && seconds <= 0.5, "{seconds}");
    }
}

#[cfg(feature = "cli")]
#[test]
fn wrong_use_is_answered() {
    let (folder, _) = study("variants = [\"path\"]");
    let small = folder.path().join("small.exr");
    image::write(&small, &Image::new(3, 3).into(), &image::ToneSettings::default()).unwrap();
    for (arguments, status, expected) in [
        (vec!["--estimates", "beem"], 2, "did you mean `beam`?"),
        (vec!["--reference", "small.exr"], 2, "3 × 3 pixels, the scene 24 × 18"),
        (vec!["--reference", "missing.exr"], 2, "missing.exr"),
        (vec!["--reference", "own"], 2, "--same-map"),
        (vec!["--region", "a=20,0,5,5"], 2, "not within the image of 24 × 18"),
        (vec!["--region", "a=1,2,3"], 2, "such as caustic=40,60,32,24"),
        (vec!["--layer", "fog"], 2, "no layer \"fog\""),
        (vec!["--samples", "0"], 2, "--samples"),
        (vec!["--budgets", "1s", "--samples", "2"], 2, "cannot be used with"),
        (vec!["--tune", "film.width"], 2, "volume.march.size"),
        (vec!["--samples", "4", "--tune", "volume.march.size", "--estimates", "point-uniform"], 2, "to which time"),
        (vec!["--same-map", "--estimates", "a:photons.volume=3"], 2, "differ only in how they gather"),
        (vec!["--estimates", "a:volume.neighbours=x"], 2, "volume.neighbours"),
        (vec!["--estimates", "path,path"], 2, "two variants"),
        (vec!["--set", "film.wdth=3"], 2, "did you mean `width`?"),
    ] {
        let out = std::process::Command::new(env!("CARGO_BIN_EXE_volpm"))
            .current_dir(folder.path())
            .args(["compare", "scene.toml", "-o", "report"])
            .args(&arguments)
            .output()
            .unwrap();
        let said = String::from_utf8_lossy(&out.stderr);
        assert_eq!(out.status.code(), Some(status), "{arguments:?}: {said}");
        assert!(said.contains(expected), "{arguments:?}: {said}");
    }
    assert!(!folder.path().join("report/results.json").exists());
}

/// A sweep measures at each value against the reference of that value, says what is refused, and repeats nothing.
#[test]
fn a_sweep_measures_at_each_value() {
    let (folder, path) = study("");
    let mut request = Request::read(&path).unwrap();
    request.set =
        ["film.width=8", "film.height=6", "render.samples=2", "photons.volume=2000"].map(str::to_owned).into();
    request.variants = compare::parse_variants("path,beam").unwrap();
    (request.seeds, request.reference_error, request.reference_time) = (2, 0.05, 5.0);
    let out = folder.path().join("out");
    let range = Range::new("media.fog.scale", [0.01, 1e30], 3, false).unwrap();
    let swept = compare::sweep::run(&request, &range, &out, &Notes::default(), &AtomicBool::new(false)).unwrap();
    assert_eq!(swept.variants.iter().map(|variant| variant.name.as_str()).collect::<Vec<_>>(), ["path", "beam"]);
    for variant in &swept.variants {
        let [thin, dense, absurd] = &variant.points[..] else { panic!("{:?}", variant.points) };
        let share = thin.found.as_ref().unwrap().share().unwrap();
        assert!((share.value - 1.0).abs() < 0.2 && thin.found.as_ref().unwrap().samples == 2, "{thin:?}");
        for point in [dense, absurd] {
            assert!(point.found.is_none() && point.notes[0].contains("optical depths"), "{point:?}");
        }
    }
    let notes = Notes::default();
    let again = compare::sweep::run(&request, &range, &out, &notes, &AtomicBool::new(false)).unwrap();
    // Files keep numbers to their last digit but one.
    for (again, first) in again.variants.iter().zip(&swept.variants) {
        let seconds = |points: &[compare::sweep::Point]| points[0].found.as_ref().unwrap().seconds.value;
        assert!((seconds(&again.points) / seconds(&first.points) - 1.0).abs() < 1e-12, "{again:?}, not {first:?}");
    }
    let begun = notes.begun.lock().unwrap();
    assert!(!begun.iter().any(|begun| begun.contains("seed")), "it is repeated: {begun:?}");
    let csv = fs::read_to_string(out.join("sweep.csv")).unwrap();
    assert_eq!(csv.lines().count(), 1 + 6, "{csv}");
    request.same_map = true;
    assert!(compare::sweep::run(&request, &range, &out, &Notes::default(), &AtomicBool::new(false)).is_err());
}
