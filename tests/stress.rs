//! Extreme scenes, those under `scenes/stress`: every one renders to finite, non-negative pixels in bounded time
//! by both methods, or is refused with a reason; and each keeps what its first line says.

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, LazyLock, mpsc};
use std::time::{Duration, Instant};

use rayon::{ThreadPool, ThreadPoolBuilder};
use volpm::Result;
use volpm::image::LayerData;
use volpm::render::{Limits, Rendering, Silent, refine, render};
use volpm::scene;

/// What a scene came to: the image's mean, and all that was warned about.
struct Outcome {
    mean: [f64; 3],
    warnings: String,
}

fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/stress")
}

/// A scene of the folder by its name, or any by its path.
fn try_render(name: &str, overrides: &[&str]) -> Result<(Rendering, Vec<String>)> {
    let overrides: Vec<String> = overrides.iter().map(|text| text.to_string()).collect();
    let description = scene::read(&folder().join(name).with_extension("toml"), &overrides)?;
    let (scene, settings) = scene::build(&description)?;
    let rendering = render(&scene, &settings, &Silent, &AtomicBool::new(false))?;
    let warnings = scene.warnings.iter().chain(&rendering.warnings).cloned().collect();
    Ok((rendering, warnings))
}

/// Renders a scene and checks what holds for all of them.
#[track_caller]
fn outcome(name: &str, overrides: &[&str]) -> Outcome {
    // Threads of its own: those that all tests share may take up another test's work in between.
    static POOL: LazyLock<ThreadPool> = LazyLock::new(|| ThreadPoolBuilder::new().build().unwrap());
    let start = Instant::now();
    let rendered = POOL.install(|| try_render(name, overrides));
    let (rendering, warnings) = rendered.unwrap_or_else(|error| panic!("{name}: {error}"));
    let seconds = start.elapsed().as_secs_f64();
    assert!(seconds < 30.0, "{name} {overrides:?}: took {seconds:.1} s");
    let image = rendering.film.image();
    let sound = |value: &f32| value.is_finite() && *value >= 0.0;
    assert!(image.pixels.as_flattened().iter().all(sound), "{name} {overrides:?}: {:?}", image.channel_means());
    for layer in rendering.film.layers() {
        if let LayerData::Rgb(values) = &layer.channels {
            assert!(values.as_flattened().iter().all(sound), "{name} {overrides:?}: layer {}", layer.name);
        }
    }
    Outcome { mean: image.channel_means(), warnings: warnings.join("\n") }
}

const PATH: &str = "render.method=path";
const PHOTON: &str = "render.method=photon";

/// Every estimator there is.
const ESTIMATORS: [&[&str]; 16] = [
    &[PATH],
    &["render.method=light"],
    &["render.method=whitted"],
    &[PHOTON, "volume.kernel=fixed"],
    &[PHOTON, "volume.kernel=variable"],
    &[PHOTON, "volume.kernel=variable", "volume.boundaries=share", "volume.peaks=paths"],
    &[PHOTON, "volume.estimate=point", "volume.march.step=exponential"],
    &[PHOTON, "volume.estimate=point", "volume.march.step=uniform"],
    &[PHOTON, "volume.estimate=point", "volume.march.step=adaptive"],
    &[PHOTON, "volume.estimate=point", "volume.march.step=random"],
    &[PHOTON, "volume.single_scattering=traced", "volume.march.step=adaptive"],
    &[PHOTON, "volume.single_scattering=approximate"],
    &[PHOTON, "surface.indirect=map", "surface.filter=gaussian"],
    &[PHOTON, "surface.indirect=final_gather", "surface.irradiance_cache=false", "photons.importance=true"],
    &[PHOTON, "surface.indirect=final_gather", "surface.estimate=sheets", "surface.shadow_photons=true"],
    &[PHOTON, "render.passes=3", "photons.density_control=true"],
];

/// Those that find the light of media each in a way of its own.
const LIGHT_OF_MEDIA: [&[&str]; 7] = [
    &[PATH],
    &["render.method=light", "render.samples=64"],
    &[PHOTON],
    &[PHOTON, "volume.kernel=fixed"],
    &[PHOTON, "volume.estimate=point"],
    &[PHOTON, "volume.estimate=point", "volume.march.step=adaptive"],
    &[PHOTON, "volume.single_scattering=traced", "volume.march.step=random"],
];

#[track_caller]
fn assert_near(what: &str, found: f64, expected: f64, share: f64) {
    assert!((found - expected).abs() <= share * expected.abs(), "{what}: {found} instead of {expected}");
}

#[test]
fn every_stress_scene_is_finite_or_refused() {
    let mut names: Vec<String> = std::fs::read_dir(folder())
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .filter(|path| path.extension().is_some_and(|ending| ending == "toml"))
        .map(|path| path.file_stem().unwrap().to_str().unwrap().to_owned())
        .collect();
    names.sort();
    assert!(names.len() >= 16);
    for name in names {
        let without_end = ["closed", "white-mist"].contains(&name.as_str());
        for method in [PATH, PHOTON] {
            if without_end {
                let error = try_render(&name, &[method]).expect_err("it has no steady state");
                assert_eq!(error.exit_status(), 2);
                assert!(error.to_string().contains("render.max_depth"), "{error}");
                outcome(&name, &[method, "render.max_depth=3"]);
            } else {
                outcome(&name, &[method]);
            }
        }
        // By all there is, small.
        let small = ["film.width=6", "film.height=6", "render.samples=2", "photons.volume=500"];
        let small = [&small[..], &["photons.global=300", "photons.caustic=300", "photons.max_emitted=20000"]].concat();
        let bounded: &[&str] = if without_end { &["render.max_depth=3"] } else { &[] };
        for estimator in ESTIMATORS {
            outcome(&name, &[&small, bounded, estimator].concat());
        }
    }
}

/// A room that light never leaves is found out from outside, too, for what shines in it; and so is an atmosphere that is dense without
/// an end, in which walks have no mean length.
#[test]
fn eternity_is_found_out_from_outside() {
    for method in [PATH, PHOTON, "render.method=light"] {
        let error = try_render("closed", &["camera.position=[0,0,70]", method]).expect_err("light does not end");
        assert!(error.to_string().contains("neither escapes"), "{error}");
    }
    let error = try_render("atmosphere", &["media.smoke.albedo=1", PHOTON]).expect_err("nor does it here");
    assert!(error.to_string().contains("below its origin"), "{error}");
}

/// A room that light hardly ever leaves.
const LASTING: [&str; 3] =
    ["camera.position=[0,0,70]", "media.smoke.albedo=0.9999999999", "materials.white.reflectance=0.9999999999"];

/// The first photon's walk has hardly an end: it is broken off when that is wanted, or its time is up, and an eye path, too.
#[test]
fn a_walk_without_end_is_broken_off() {
    let render_with = |overrides: &[&str], time: Option<Duration>| {
        let overrides: Vec<String> = LASTING.iter().chain(overrides).map(|text| text.to_string()).collect();
        let description = scene::read(&folder().join("closed.toml"), &overrides).unwrap();
        let (scene, settings) = scene::build(&description).unwrap();
        let stop = Arc::new(AtomicBool::new(false));
        let (told, ended) = (stop.clone(), mpsc::channel());
        // Were the walk not broken off, this thread would outlive the test.
        std::thread::spawn(move || {
            let pool = ThreadPoolBuilder::new().num_threads(1).build().unwrap();
            let limits = Limits { time, ..Limits::default() };
            let rendering = pool.install(|| refine(&scene, &settings, &limits, None, &Silent, &told));
            let shows = |rendering: Rendering| rendering.film.image().pixels.iter().flatten().any(|&x| x > 0.0);
            ended.0.send(rendering.is_ok_and(shows))
        });
        if time.is_none() {
            std::thread::sleep(Duration::from_millis(300));
            stop.store(true, Ordering::Relaxed);
        }
        let found = ended.1.recv_timeout(Duration::from_secs(20));
        assert_eq!(found, Ok(false), "{overrides:?}, {time:?}: it goes on, or shows something");
    };
    render_with(&[PHOTON], None);
    render_with(&["render.method=light"], None);
    render_with(&["camera.position=[0,0,5]", PATH], Some(Duration::from_millis(300)));
}

/// Matter in which light does not get from one number to the next is refused, with its place; a little less is right at its surface.
#[test]
fn depths_without_digits_are_refused() {
    let lit = |sigma: &str| outcome("dense", &[PATH, &format!("media.smoke.sigma_t={sigma}")]).mean[0];
    assert_near("at its surface", lit("1e12"), lit("1e4"), 0.02);
    for (name, sigma) in [("dense", "1e19"), ("hot-voxel", "1e10")] {
        let error =
            try_render(name, &[&format!("media.smoke.sigma_t={sigma}")]).expect_err("it is too deep").to_string();
        assert!(error.contains("media.smoke: optical depths up to"), "{error}");
        assert_eq!(error.contains("of its voxel ("), name == "hot-voxel", "{error}");
    }
}

/// In thin matter whose light lamps are asked for, the map hardly matters: it is not filled whatever that takes.
#[test]
fn photons_that_hardly_matter_are_few() {
    let overrides = ["media.smoke.sigma_t=1e-3", "volume.single_scattering=traced", "photons.volume=20000", PHOTON];
    let (rendering, warnings) = try_render("thin", &overrides).unwrap();
    assert!(rendering.stats.emitted <= 4_000_000, "{}", rendering.stats.emitted);
    assert!(warnings.is_empty(), "{warnings:?}");
}

/// More photons than memory holds are refused before any is traced.
#[test]
fn photons_beyond_memory_are_refused() {
    let error = try_render("too-bright", &["photons.volume=9223372036854775807", PHOTON]).expect_err("they do not fit");
    assert!(error.to_string().contains("of memory, more than 64.0 GiB"), "{error}");
}

/// A shape far beyond all others changes nothing in the picture of these, whatever radii photons have; and one so far that it leaves
/// no digits is refused by its name.
#[test]
fn a_far_shape_changes_nothing() {
    let far = |x: &str, kernel: &str| {
        let place = format!("shapes.0.edge_u=[0,0,{x}]");
        let small = [place.as_str(), kernel, "render.samples=4", "photons.volume=5000"];
        try_render("atmosphere", &small).map(|(rendering, _)| rendering.film.image().channel_means()[0])
    };
    for kernel in ["volume.kernel=variable", "volume.kernel=fixed"] {
        let near = far("1e6", kernel).unwrap();
        for x in ["1e7", "1e8"] {
            assert_near(&format!("{x}, {kernel}"), far(x, kernel).unwrap(), near, 0.05);
        }
    }
    let error = try_render("closed", &["shapes.1.max=[6,6,1e18]"]).expect_err("no digits are left").to_string();
    assert!(error.contains("shapes.1: this shape reaches"), "{error}");
    let error = try_render("column", &["shapes.0.max=[1,1,1e18]"]).expect_err("nor are any for voxels").to_string();
    assert!(error.contains("media.smoke: its voxels are"), "{error}");
}

/// From afar, a grid is many thousand steps away: samples along rays count them all, and tables of them end where they should.
#[test]
fn smoke_is_seen_from_afar() {
    let small = ["film.width=160", "film.height=120", "render.samples=1", "photons.volume=20000"];
    let near = outcome("../smoke", &[&small[..], &["camera.position=[1.2,1.75,6]"]].concat());
    let far = outcome("../smoke", &[&small[..], &["camera.position=[1.2,1.75,25]"]].concat());
    assert!(far.mean[0] > 0.0 && far.mean[0] < near.mean[0], "{:?} {:?}", far.mean, near.mean);
}

#[test]
fn light_grows_with_a_small_optical_depth() {
    for estimator in LIGHT_OF_MEDIA {
        let at = |sigma: f64| {
            let sigma_t = format!("media.smoke.sigma_t={sigma:e}");
            outcome("thin", &[&[sigma_t.as_str()], estimator].concat()).mean[0] / sigma
        };
        let reference = at(1e-6);
        for sigma in [1e-8, 1e-4] {
            assert_near(&format!("{estimator:?}, sigma_t {sigma:e}"), at(sigma), reference, 0.01);
        }
    }
}

#[test]
fn dense_matter_is_a_surface_and_wide_photons_are_warned_about() {
    // Beyond some hundred mean free paths only the surface matters; the same random numbers make the images alike.
    let thick = outcome("dense", &[PATH, "media.smoke.sigma_t=1e6"]).mean[0];
    let dense = outcome("dense", &[PATH]);
    assert_near("1e4 against 1e6", dense.mean[0], thick, 0.03);
    assert!(dense.warnings.is_empty(), "{}", dense.warnings);
    assert!(outcome("dense", &[PHOTON]).warnings.contains("mean free paths"));
}

#[test]
fn what_loses_nothing_is_invisible_under_an_even_sky() {
    assert_near("forward", outcome("forward", &[PATH]).mean[0], 1.0, 0.005);
    let channels = outcome("channels", &[PATH]).mean;
    for mean in channels {
        assert_near("channels", mean, 1.0, 0.02);
    }
    // Red never collides: no photon, no bias.
    assert_near("red", outcome("channels", &[PHOTON]).mean[0], 1.0, 1e-6);
    assert_near("glass", outcome("glass-of-water", &[PATH]).mean[1], 1.0, 1e-3);
    assert_near("glass", outcome("glass-of-water", &[PHOTON]).mean[1], 1.0, 0.05);
}

#[test]
fn a_boundary_belongs_to_the_side_that_is_faced() {
    for method in [PATH, PHOTON] {
        let at = |camera: &str, lamp: &str| {
            outcome(
                "on-boundary",
                &[method, &format!("camera.position={camera}"), &format!("lights.0.position={lamp}")],
            )
            .mean[0]
        };
        let on = at("[0, 0, 1]", "[0, 1, 0]");
        // A nudge changes a few hits at the edges of things, nothing else; one inwards also which random numbers
        // a path uses for what.
        assert_near(method, on, at("[0, 0, 1.0000001]", "[0, 1.0000001, 0]"), 0.02);
        if method == PHOTON {
            assert_near(method, on, at("[0, 0, 0.9999999]", "[0, 0.9999999, 0]"), 0.02);
        }
    }
}

#[test]
fn solids_in_the_same_place_are_one() {
    for method in [PATH, PHOTON] {
        let twice = outcome("coincident", &[method]).mean[0];
        // A template is not there.
        let once = outcome("coincident", &[method, "shapes.1.visible=false"]).mean[0];
        assert_near(method, twice, once, 1e-6);
    }
}

#[test]
fn voxels_however_uneven_are_the_medium_they_describe() {
    for method in [PATH, PHOTON] {
        let column = outcome("column", &[method]).mean[0];
        let even = outcome("column", &[method, "media.smoke.density={ type = \"constant\" }"]).mean[0];
        assert_near(&format!("column, {method}"), column, even, 0.05);
    }
}

#[test]
fn what_the_user_should_know_is_said() {
    for method in [PATH, PHOTON] {
        let fog = outcome("fog-and-sky", &[method]);
        assert_eq!(fog.mean, [0.0; 3]);
        assert!(fog.warnings.contains("light from infinity"), "{}", fog.warnings);
        let dark = outcome("thin", &[method, "lights.0.intensity=0"]);
        assert_eq!(dark.mean, [0.0; 3]);
        assert!(dark.warnings.contains("nothing gives light"), "{}", dark.warnings);
        let bright = outcome("too-bright", &[method]);
        assert!(bright.warnings.contains("too strong"), "{}", bright.warnings);
    }
    let glow = ["world.medium=smoke", "media.smoke.emission={ radiance = 1 }", PHOTON];
    assert!(outcome("thin", &glow).warnings.contains("glows and has no end"));
    let emptied = outcome("thin", &[PHOTON, "media.smoke.density={ type = \"constant\", value = 0 }"]);
    assert!(emptied.warnings.contains("vacuum"), "{}", emptied.warnings);
}

#[test]
fn small_far_media_find_their_photons() {
    let tiny = outcome("tiny", &[PHOTON]);
    assert!(!tiny.warnings.contains("stay dark"), "{}", tiny.warnings);
    assert!(tiny.mean[0] > 0.0);
}

#[test]
fn photons_however_spread_keep_the_image_finite() {
    let tiny = "volume.radius=1e-30";
    let huge = "volume.radius=1e30";
    for overrides in [
        &["photons.volume=10"][..],
        &["photons.max_emitted=1"],
        &["volume.kernel=fixed", tiny],
        &["volume.kernel=fixed", huge],
        &["photons.volume=1000", "volume.max_radius=1e-30"],
        &["photons.volume=1000", "volume.max_radius=1e30"],
        &["film.width=1", "film.height=1", "render.samples=1", "render.max_depth=1"],
        &["film.width=16384", "film.height=1", "render.samples=1"],
    ] {
        outcome("few-photons", &[&[PHOTON], overrides].concat());
    }
}

#[test]
fn the_standard_error_is_the_spread_over_seeds() {
    const SEEDS: usize = 24;
    for method in [PATH, PHOTON] {
        // Of each seed: every value, and the square of the standard error it claims.
        let found: Vec<(Vec<f64>, Vec<f64>)> = (0..SEEDS)
            .map(|seed| {
                let seed = format!("render.seed={seed}");
                let overrides = [method, &seed, "film.standard_error=true", "render.samples=16", "photons.volume=4000"];
                let (rendering, _) = try_render("column", &overrides).unwrap_or_else(|error| panic!("{error}"));
                let layers = rendering.film.layers();
                let layer = layers.iter().find(|layer| layer.name == "standard_error").expect("a layer was asked for");
                let LayerData::Rgb(errors) = &layer.channels else { panic!("the standard error is a colour") };
                let values = rendering.film.image().pixels.iter().map(|pixel| pixel[0] as f64).collect();
                (values, errors.iter().map(|error| (error[0] as f64).powi(2)).collect())
            })
            .collect();
        // Claimed over observed variance, of all seeds but one.
        let ratio = |left_out: usize| {
            let kept = || found.iter().enumerate().filter(move |(seed, _)| *seed != left_out).map(|(_, found)| found);
            let n = kept().count() as f64;
            let (mut claimed, mut observed) = (0.0, 0.0);
            for pixel in 0..found[0].0.len() {
                let mean = kept().map(|found| found.0[pixel]).sum::<f64>() / n;
                observed += kept().map(|found| (found.0[pixel] - mean).powi(2)).sum::<f64>() / (n - 1.0);
                claimed += kept().map(|found| found.1[pixel]).sum::<f64>() / n;
            }
            claimed / observed
        };
        let all = ratio(usize::MAX);
        let partial: Vec<f64> = (0..SEEDS).map(ratio).collect();
        let mean = partial.iter().sum::<f64>() / SEEDS as f64;
        let jackknife = (partial.iter().map(|r| (r - mean).powi(2)).sum::<f64>() * (1.0 - 1.0 / SEEDS as f64)).sqrt();
        assert!(jackknife < 0.25, "{method}: {all} ± {jackknife} says nothing");
        assert!((all - 1.0).abs() < 3.0 * jackknife, "{method}: claimed over observed variance is {all} ± {jackknife}");
    }
}

#[test]
fn size_and_place_of_a_scene_do_not_matter() {
    let render = |size: f64, place: f64| {
        let at = |x: f64, y: f64, z: f64| format!("[{}, {}, {}]", place + size * x, place + size * y, place + size * z);
        let along = |x: f64, y: f64, z: f64| format!("[{}, {}, {}]", size * x, size * y, size * z);
        let overrides = [
            format!("camera.position={}", at(0.0, 0.0, 5.0)),
            format!("camera.target={}", at(0.0, 0.0, 0.0)),
            format!("shapes.0.min={}", at(-1.0, -1.0, -1.0)),
            format!("shapes.0.max={}", at(1.0, 1.0, 1.0)),
            format!("shapes.1.min={}", at(-1.0, -1.0, -1.0)),
            format!("shapes.1.max={}", at(1.0, 1.0, 1.0)),
            format!("shapes.2.origin={}", at(-5.0, -1.0, -5.0)),
            format!("shapes.2.edge_u={}", along(0.0, 0.0, 10.0)),
            format!("shapes.2.edge_v={}", along(10.0, 0.0, 0.0)),
            format!("lights.0.position={}", at(2.0, 3.0, 2.0)),
            format!("lights.0.intensity={}", 50.0 * size * size),
            format!("media.smoke.sigma_t={}", 2.0 / size),
        ];
        let overrides: Vec<&str> = overrides.iter().map(String::as_str).collect();
        LIGHT_OF_MEDIA.map(|estimator| outcome("coincident", &[&overrides[..], estimator].concat()).mean[0])
    };
    let reference = render(1.0, 0.0);
    for (size, place) in [(1e-4, 0.0), (1e4, 0.0), (1.0, 1e5)] {
        for ((found, expected), estimator) in render(size, place).into_iter().zip(reference).zip(LIGHT_OF_MEDIA) {
            assert_near(&format!("size {size}, place {place}, {estimator:?}"), found, expected, 0.01);
        }
    }
}

/// A room of all simple shapes far from the origin of its file's coordinates, which have few digits there.
#[test]
fn a_room_far_away_is_the_same() {
    let folder = tempfile::tempdir().unwrap();
    let render = |place: f64, estimator: &[&str]| {
        let at = |x: f64, y: f64, z: f64| format!("[{}, {}, {}]", place + x, place + y, place + z);
        let shapes = format!(
            "[materials.white]\ntype = \"lambert\"\nreflectance = 0.6\n\
             [[shapes]]\ntype = \"box\"\nmin = {}\nmax = {}\nmaterial = \"white\"\n\
             [[shapes]]\ntype = \"sphere\"\ncenter = {}\nradius = 0.7\ninterior = \"fog\"\n\
             [[shapes]]\ntype = \"cylinder\"\nbase = {}\ntop = {}\nradius = 0.4\nmaterial = \"white\"\n\
             [[shapes]]\ntype = \"disk\"\ncenter = {}\nnormal = [0, 1, 0]\nradius = 0.5\nmaterial = \"white\"\n\
             [[shapes]]\ntype = \"quad\"\norigin = {}\nedge_u = [1, 0, 0]\nedge_v = [0, 0, 1]\nemission = {{ radiance = 9 }}\n",
            at(-3.0, -1.5, -3.0),
            at(3.0, 3.5, 6.0),
            at(0.4, 0.0, 0.0),
            at(-1.5, -1.5, -1.0),
            at(-1.5, 0.2, -1.0),
            at(1.8, -0.5, 1.0),
            at(-0.5, 3.4, 0.5)
        );
        let scene = written(&folder, "room", &shapes);
        let (stand, target, lamp) = (at(0.0, 0.0, 5.0), at(0.0, 0.0, 0.0), at(2.0, 3.0, 2.0));
        let moved = [("camera.position", stand), ("camera.target", target), ("lights.0.position", lamp)];
        let moved = moved.map(|(key, place)| format!("{key}={place}"));
        let moved: Vec<&str> = moved.iter().map(String::as_str).collect();
        outcome(&scene, &[&moved[..], &["photons.volume=4000", "render.samples=16"], estimator].concat()).mean[0]
    };
    for estimator in [&[PATH][..], &["render.method=light"], &[PHOTON], &[PHOTON, "surface.indirect=path"]] {
        let near = render(0.0, estimator);
        for place in [1e4, 1e6] {
            assert_near(&format!("{estimator:?} at {place}"), render(place, estimator), near, 0.01);
        }
    }
}

/// A small picture of matter under a lamp.
const LAMP: &str = r#"
[film]
width = 12
height = 12
[camera]
position = [0, 0, 5]
target = [0, 0, 0]
fov = 35
[render]
samples = 64
[media.fog]
sigma_t = 20
albedo = 0.8
[[lights]]
type = "point"
position = [2, 3, 2]
intensity = 50
"#;

/// A scene with these shapes, kept in a folder.
fn written(folder: &tempfile::TempDir, name: &str, shapes: &str) -> String {
    let path = folder.path().join(name).with_extension("toml");
    std::fs::write(&path, format!("{LAMP}{shapes}")).unwrap();
    path.to_str().unwrap().to_owned()
}

/// However far away the camera stands, a lens as much longer sees the same; thousands of uneven layers of voxels are on each ray's way.
#[test]
fn from_afar_a_scene_looks_the_same() {
    const LAYERS: usize = 3000;
    let folder = tempfile::tempdir().unwrap();
    let mut head = format!("{{'descr': '<f4', 'fortran_order': False, 'shape': ({LAYERS}, 2, 2), }}");
    head += &" ".repeat(128 - 10 - head.len() - 1);
    let mut grid = [b"\x93NUMPY\x01\x00\x76\x00", head.as_bytes(), b"\n"].concat();
    for layer in 0..LAYERS {
        let density = 1.0 + (0.01 * layer as f32).sin() + if layer % 7 == 0 { 3.0 } else { 0.0 };
        (0..4).for_each(|_| grid.extend(density.to_le_bytes()));
    }
    std::fs::write(folder.path().join("layers.npy"), grid).unwrap();
    let solid = "[[shapes]]\ntype = \"box\"\nmin = [-1, -1, -1]\nmax = [1, 1, 1]\ninterior = \"fog\"\n";
    let scene = written(&folder, "layers", solid);
    let density = "media.fog.density={ type = \"array\", file = \"layers.npy\", min = [-1, -1, -1], max = [1, 1, 1] }";
    let from = |distance: f64, estimator: &[&str]| {
        let lens = format!("camera.fov={}", 2.0 * (1.6 / distance).atan().to_degrees());
        let place = format!("camera.position=[0, 0, {distance}]");
        let small = [density, "media.fog.sigma_t=0.8", "photons.volume=2000", "render.samples=12"];
        outcome(&scene, &[&small[..], &[lens.as_str(), place.as_str()], estimator].concat()).mean[0]
    };
    for estimator in LIGHT_OF_MEDIA {
        let far = from(600.0, estimator);
        assert_near(&format!("{estimator:?}, closer"), from(60.0, estimator), far, 0.04);
        assert_near(&format!("{estimator:?}, farther"), from(6000.0, estimator), far, 0.02);
    }
}

/// Discs and balls wider than the solids that photons lie in give these their light, be there sixty photons in each or seven.
#[test]
fn many_small_solids_keep_their_light() {
    let folder = tempfile::tempdir().unwrap();
    for (kind, shape, scale) in [
        ("sphere", "center = [0, 0, 0]\nradius = 0.03", ""),
        ("box", "min = [-0.03, -0.02, -0.02]\nmax = [0.03, 0.02, 0.02]", ""),
        ("sphere", "center = [0, 0, 0]\nradius = 0.03", "{ scale = [0.7, 1.6, 1] }, "),
    ] {
        let mut shapes = format!("[[shapes]]\nname = \"one\"\ntype = \"{kind}\"\n{shape}\ninterior = \"fog\"\n");
        for i in 1..500 {
            let [x, y, z] =
                [0.754_877_7, 0.569_840_3, 0.618_034].map(|step: f64| 2.0 * (f64::from(i) * step).fract() - 1.0);
            let moved = format!(
                "{scale}{{ rotate = {{ axis = [{x}, {y}, 1], angle = {i} }} }}, {{ translate = [{x}, {y}, {z}] }}"
            );
            shapes += &format!("[[shapes]]\ntype = \"instance\"\nof = \"one\"\ntransform = [{moved}]\n");
        }
        let scene = written(&folder, "many", &shapes);
        let path = outcome(&scene, &[PATH, "render.samples=512"]).mean[0];
        for (photons, bound, estimate) in [(30_000, 0.04, "beam"), (3500, 0.08, "beam"), (30_000, 0.05, "point")] {
            let photons = format!("photons.volume={photons}");
            let found = outcome(&scene, &[PHOTON, &photons, &format!("volume.estimate={estimate}")]).mean[0];
            assert_near(&format!("{kind}{scale}, {photons}, {estimate}"), found, path, bound);
        }
    }
}

/// A mesh that crosses itself, or holds another that faces alike, encloses what either encloses, whoever asks.
#[test]
fn a_mesh_that_overlaps_itself_is_the_same_to_all() {
    let folder = tempfile::tempdir().unwrap();
    let cube = |min: f64, max: f64, first: u32| {
        let corner = |i: u32| [0, 1, 2].map(|axis| if i >> axis & 1 == 0 { min } else { max });
        let mut text: String = (0..8).map(corner).map(|[x, y, z]| format!("v {x} {y} {z}\n")).collect();
        for [a, b, c, d] in [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]] {
            text += &format!("f {} {} {} {}\n", first + a, first + b, first + c, first + d);
        }
        text
    };
    std::fs::write(folder.path().join("crossing.obj"), cube(-0.8, 0.6, 1) + &cube(-0.2, 1.0, 9)).unwrap();
    std::fs::write(folder.path().join("nested.obj"), cube(-0.8, 0.6, 1) + &cube(-0.5, 0.3, 9)).unwrap();
    std::fs::write(folder.path().join("plain.obj"), cube(-0.8, 0.6, 1)).unwrap();
    let thin = ["media.fog.sigma_t=2", "photons.volume=30000"];
    let mean = |name: &str, overrides: &[&str]| {
        let mesh = format!("[[shapes]]\ntype = \"mesh\"\nfile = \"{name}.obj\"\ninterior = \"fog\"\n");
        outcome(&written(&folder, name, &mesh), &[&thin, overrides].concat()).mean[0]
    };
    let path = ["crossing", "nested", "plain"].map(|name| mean(name, &[PATH, "render.samples=256"]));
    assert_near("nested, by paths", path[1], path[2], 0.02);
    for (name, path) in ["crossing", "nested"].iter().zip(path) {
        for method in [&[PHOTON][..], &["render.method=light", "render.samples=1024"]] {
            assert_near(&format!("{name}, {method:?}"), mean(name, method), path, 0.05);
        }
    }
}

/// A camera in a small opaque ball above a bright floor sees nothing of that, however few photons there are and however wide their discs.
#[test]
fn no_light_comes_into_an_opaque_ball() {
    let folder = tempfile::tempdir().unwrap();
    let scene = |ball: [f64; 2]| {
        let [height, radius] = ball;
        let quad = |v: &str| {
            format!(
                "[[shapes]]\ntype = \"quad\"\norigin = [-5, 0, -5]\nedge_u = [10, 0, 0]\nedge_v = {v}\nmaterial = \"white\"\n"
            )
        };
        let text = format!(
            "[film]\nwidth = 12\nheight = 8\n[camera]\nposition = [3.5, {height}, 3.5]\ntarget = [3.4, 0, 3.4]\nfov = 60\n\
             [render]\nmethod = \"photon\"\nsamples = 4\n[materials.white]\ntype = \"lambert\"\nreflectance = 0.7\n{}{}\
             [[shapes]]\ntype = \"sphere\"\ncenter = [3.5, {height}, 3.5]\nradius = {radius}\nmaterial = \"white\"\n\
             [[lights]]\ntype = \"point\"\nposition = [0.3, 3.3, 0.3]\nintensity = 30\n",
            quad("[0, 0, 10]"),
            quad("[0, 10, 0]")
        );
        let file = folder.path().join(format!("ball{height}.toml"));
        std::fs::write(&file, text).unwrap();
        file.to_str().unwrap().to_owned()
    };
    for (ball, photons) in [([0.5, 0.45], 4000), ([0.1, 0.05], 4000), ([0.7, 0.5], 300)] {
        let scene = scene(ball);
        for estimate in ["knn", "sheets"] {
            for seed in 1..=2 {
                let sets = [
                    "surface.indirect=map".to_owned(),
                    format!("surface.estimate={estimate}"),
                    format!("photons.global={photons}"),
                    format!("render.seed={seed}"),
                ];
                let sets: Vec<&str> = sets.iter().map(String::as_str).collect();
                assert_eq!(outcome(&scene, &sets).mean, [0.0; 3], "{ball:?}: {sets:?}");
            }
        }
        let outside =
            ["surface.indirect=map", "camera.position=[3.5,3,3.5]", "camera.target=[2,0,2]", "photons.global=4000"];
        assert!(outcome(&scene, &outside).mean[0] > 0.1, "the floor is dark");
    }
}

/// Solids smaller than discs take holes out of the fog around them, be their matter uneven, added to it or in its place: both keep their light.
#[test]
fn small_solids_in_fog_keep_their_light_and_that_of_the_fog() {
    let folder = tempfile::tempdir().unwrap();
    let fog = "[media.air]\nsigma_t = 0.3\nalbedo = 0.8\n\
               [[shapes]]\ntype = \"box\"\nmin = [-1.2, -1.2, -1.2]\nmax = [1.2, 1.2, 1.2]\ninterior = \"air\"\n";
    let noise = "media.fog.density={ type = \"noise\", scale = 0.03, octaves = 1, threshold = 0.35 }";
    let (adds, dense, thin) = ("media.fog.add=true", "media.fog.sigma_t=100", "media.fog.sigma_t=25");
    let ball = |[x, y, z]: [f64; 3]| format!("type = \"sphere\"\ncenter = [{x}, {y}, {z}]\nradius = 0.03");
    let cylinder = |[x, y, z]: [f64; 3]| {
        format!("type = \"cylinder\"\nbase = [{x}, {}, {z}]\ntop = [{x}, {}, {z}]\nradius = 0.03", y - 0.03, y + 0.03)
    };
    let puffs = |shape: &dyn Fn([f64; 3]) -> String| -> String {
        let place =
            |i: u32| [0.754_877_7, 0.569_840_3, 0.618_034].map(|step: f64| 2.0 * (f64::from(i) * step).fract() - 1.0);
        (0..1000).map(|i| format!("[[shapes]]\n{}\ninterior = \"fog\"\n", shape(place(i)))).collect()
    };
    for (case, around, shape, sets) in [
        ("balls of noise added to fog", fog, puffs(&ball), &[noise, dense, adds][..]),
        ("balls of noise in place of fog", fog, puffs(&ball), &[noise, dense]),
        ("even cylinders added to fog", fog, puffs(&cylinder), &[thin, adds]),
        ("even cylinders", "", puffs(&cylinder), &[thin]),
    ] {
        let scene = written(&folder, "puffs", &format!("{around}{shape}"));
        let mean = |estimator: &[&str]| outcome(&scene, &[sets, estimator].concat()).mean[0];
        let path = mean(&[PATH, "render.samples=1024"]);
        for (photons, bound) in [("photons.volume=100000", 0.02), ("photons.volume=30000", 0.025)] {
            assert_near(&format!("row 28, {case}, beams, {photons}"), mean(&[PHOTON, photons]), path, bound);
        }
    }
}

/// However many solids and lamps there are, a photon costs little more, by beams and by points.
#[test]
fn costs_grow_slowly_with_solids() {
    let folder = tempfile::tempdir().unwrap();
    let seconds = |count: u32, estimator: &[&str]| {
        let mut text = String::new();
        let size = 0.3 / f64::from(count).cbrt();
        for i in 0..count {
            let [x, y, z] =
                [0.754_877_7, 0.569_840_3, 0.618_034].map(|step: f64| 2.0 * (f64::from(i) * step).fract() - 1.0);
            text += &format!(
                "[[shapes]]\ntype = \"sphere\"\ncenter = [{x}, {y}, {z}]\nradius = {size}\ninterior = \"fog\"\n"
            );
        }
        let scene = written(&folder, &format!("balls{count}"), &text);
        let sets = [&["photons.volume=20000", "render.samples=1", "media.fog.sigma_t=8"][..], estimator].concat();
        let pool = ThreadPoolBuilder::new().num_threads(1).build().unwrap();
        let (rendering, _) = pool.install(|| try_render(&scene, &sets)).unwrap();
        let stats = &rendering.stats;
        (stats.photons_seconds + stats.build_seconds) / stats.emitted as f64
    };
    for estimator in [&[PHOTON][..], &[PHOTON, "volume.estimate=point"]] {
        let (few, many) = (seconds(100, estimator), seconds(10_000, estimator));
        assert!(
            many < 10.0 * few,
            "row 28, {estimator:?}: {many:.2e} s a photon among 10 000 balls, {few:.2e} s among 100; expected about as much"
        );
    }
}

/// Whenever a render is stopped, it ends soon, with what it has.
#[test]
fn a_render_ends_soon_when_it_is_stopped() {
    let folder = tempfile::tempdir().unwrap();
    let solid = "[[shapes]]\ntype = \"box\"\nmin = [-1, -1, -1]\nmax = [1, 1, 1]\ninterior = \"fog\"\n";
    let scene = written(&folder, "long", solid);
    for estimator in [
        &[PATH, "render.samples=1000000"][..],
        &["render.method=light", "render.samples=1000000"],
        &[PHOTON, "photons.volume=20000000"],
        &[PHOTON, "photons.volume=100000", "render.samples=1000000"],
        &[PHOTON, "volume.estimate=point", "photons.volume=100000", "render.samples=1000000"],
    ] {
        for delay in [0, 100, 700] {
            let sets: Vec<String> = estimator.iter().map(|text| text.to_string()).collect();
            let (scene, settings) = scene::build(&scene::read(Path::new(&scene), &sets).unwrap()).unwrap();
            let stop = AtomicBool::new(false);
            let waited = std::thread::scope(|scope| {
                let rendering = scope.spawn(|| render(&scene, &settings, &Silent, &stop));
                std::thread::sleep(Duration::from_millis(delay));
                stop.store(true, Ordering::Relaxed);
                let start = Instant::now();
                let rendering =
                    rendering.join().unwrap().unwrap_or_else(|error| panic!("row 29, {estimator:?}: {error}"));
                let pixels = &rendering.film.image().pixels;
                assert!(
                    pixels.as_flattened().iter().all(|x| x.is_finite() && *x >= 0.0),
                    "row 29, {estimator:?}, stopped after {delay} ms: its picture is not finite"
                );
                start.elapsed().as_secs_f64()
            });
            // 0.2 s, and what other tests on the same processor take meanwhile.
            assert!(
                waited < 3.0,
                "row 29, {estimator:?}, stopped after {delay} ms: it went on for {waited:.1} s; expected 0.2"
            );
        }
    }
}

/// The light of a picture of the sky and that of lamps of every kind add up, and so does what they cost.
#[test]
fn a_picture_of_the_sky_and_lamps_add_up() {
    let folder = tempfile::tempdir().unwrap();
    // One bright pixel of 8 × 4, the others dim.
    let mut sky = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 4 +X 7\n".to_vec();
    (0..28).for_each(|i| sky.extend(if i == 9 { [128, 128, 128, 132] } else { [128, 128, 128, 128] }));
    std::fs::write(folder.path().join("sky.hdr"), sky).unwrap();
    let solid = "[[shapes]]\ntype = \"sphere\"\ncenter = [0, 0, 0]\nradius = 1\ninterior = \"fog\"\n";
    let picture = "[[lights]]\ntype = \"environment\"\nfile = \"sky.hdr\"\n";
    let lamps = "[[lights]]\ntype = \"spot\"\nposition = [0, 4, 0]\ntarget = [0, 0, 0]\ninner_angle = 10\nouter_angle = 20\nintensity = 40\n\
                 [[lights]]\ntype = \"directional\"\ndirection = [-1, -1, 0]\nirradiance = 1\n\
                 [[shapes]]\ntype = \"quad\"\norigin = [-2, -2, -2]\nedge_u = [0, 0, 1]\nedge_v = [0, 1, 0]\nemission = { radiance = 5 }\n";
    for estimator in LIGHT_OF_MEDIA {
        let thin = ["media.fog.sigma_t=1", "photons.volume=20000"];
        let render = |name: &str, lights: &str, sets: &[&str]| {
            let scene = written(&folder, name, &format!("{solid}{lights}"));
            let samples: &[&str] =
                if estimator[0] == PHOTON { &["render.samples=64"] } else { &["render.samples=256"] };
            let sets = [&thin[..], estimator, samples, sets].concat();
            let mean = outcome(&scene, &sets).mean[0];
            (mean, try_render(&scene, &sets).unwrap().0.stats.emitted as f64)
        };
        let dark = ["lights.0.intensity=0"];
        let (sky, lit, both) = (
            render("sky", picture, &dark),
            render("lamps", lamps, &[]),
            render("both", &format!("{picture}{lamps}"), &[]),
        );
        assert_near(&format!("row 34, {estimator:?}, radiance"), both.0, sky.0 + lit.0, 0.03);
        assert!(
            both.1 <= 1.5 * (sky.1 + lit.1),
            "row 34, {estimator:?}: {} photons emitted; expected {} + {} at most",
            both.1,
            sky.1,
            lit.1
        );
    }
}
