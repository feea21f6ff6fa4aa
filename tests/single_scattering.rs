//! Traced single scattering agrees with the path tracer, and with photons, on all kinds of light and through every
//! boundary it claims to pass; what a shadow ray cannot stand for stays in the photon map.

use volpm::image::Image;

use crate::support::{Checks, Estimate, images};

const FILM: &str = "[film]\nwidth = 12\nheight = 12\nlayers = false\n";
const PATH: &str = "render.method=path";
const PHOTON: &str = "render.method=photon";
const TRACED: &str = "volume.single_scattering=traced";
const APPROXIMATE: &str = "volume.single_scattering=approximate";

/// The mean over all channels of the image.
fn grey(images: &[Image]) -> Estimate {
    Estimate::over(images, |image| [image.mean(); 3])
}

fn of(text: &str, seeds: u32, samples: u32, overrides: &[&str]) -> Estimate {
    let samples = format!("render.samples={samples}");
    grey(&images(seeds, &format!("{FILM}{text}"), &[overrides, &[&samples]].concat()))
}

/// What makes light scattered once be traced at every place of a march.
fn march(step: &str, size: f64) -> [String; 2] {
    [format!("volume.march.step={step}"), format!("volume.march.size={size}")]
}

/// Fog with a wide lamp, seen directly and by way of diffuse walls.
const ROOM: &str = r#"
[camera]
position = [0, 1, 1.8]
target = [0, 0.9, -1]
fov = 60
[world]
medium = "fog"
[media.fog]
sigma_s = [0.3, 0.5, 0.8]
sigma_a = 0.05
phase = { type = "hg", g = 0.6 }
[materials.wall]
type = "lambert"
reflectance = [0.4, 0.3, 0.2]
[[shapes]]
type = "box"
min = [-2, 0, -2]
max = [2, 2.5, 2]
material = "wall"
[[shapes]]
type = "disk"
center = [0, 2.4, -0.3]
normal = [0, -1, 0]
radius = 0.8
emission = { radiance = 20 }
"#;

/// What it shows of the fog, among black walls.
const MIRROR: &str = r#"
[materials.glossy]
type = "mirror"
reflectance = 0.9
[[shapes]]
type = "quad"
origin = [-1.5, 0.2, -1.9]
edge_u = [3, 0, 0]
edge_v = [0, 1.5, 0]
material = "glossy"
"#;

/// Against what path tracing found once with standard errors (48 seeds of 200 to 260 samples).
#[test]
fn fog_with_a_lamp() {
    let mut checks = Checks::default();
    let by_path = |mean, standard_error| Estimate { mean: [mean; 3], standard_error: [standard_error; 3] };
    // Light scattered once, or reflected once: no photon takes part.
    let path = by_path(0.344_058, 4.8e-4);
    let traced = of(ROOM, 16, 20, &[PHOTON, TRACED, "render.max_depth=1"]);
    checks.agree("one event", &traced, &path, 0.006, 0.0);
    for step in ["uniform", "adaptive", "exponential"] {
        let [step_is, size_is] = march(step, 0.5);
        let set = [PHOTON, TRACED, "render.max_depth=1", &step_is, &size_is];
        let marched = of(ROOM, 16, 13, &set);
        checks.agree(&format!("one event, {step} steps"), &marched, &path, 0.006, 0.0);
    }
    let text = format!("{ROOM}{MIRROR}");
    let seen_twice = ["materials.wall.reflectance=0", "render.max_depth=2"];
    let path = by_path(0.531_897, 8.2e-4);
    let traced = of(&text, 16, 40, &[&seen_twice[..], &[PHOTON, TRACED, "photons.volume=100_000"]].concat());
    checks.agree("in a mirror", &traced, &path, 0.006, 0.004);
    // All light; most of the noise is that of walls. Photons of the second collision on are blurred, but count for less.
    let path = by_path(0.928_810, 1.4e-3);
    let photons = ["photons.volume=100_000", "photons.global=20_000"];
    let traced = of(ROOM, 12, 36, &[&[PHOTON, TRACED], &photons[..]].concat());
    checks.agree("all light, traced", &traced, &path, 0.01, 0.003);
    let gathered = of(ROOM, 20, 36, &[&[PHOTON], &photons[..]].concat());
    checks.agree("all light, photons", &gathered, &path, 0.01, 0.01);
    checks.finish();
}

/// Voxels before an image of a sky, whose light is wide, and forward scattering, which is narrow.
#[test]
fn smoke_before_a_sky() {
    let mut checks = Checks::default();
    let text = r#"
[camera]
position = [0.3, 0.4, 3.5]
target = [0, -0.1, 0]
fov = 20
[media.smoke]
sigma_t = [4, 6, 8]
albedo = 0.9
density = { type = "vdb", file = "reference/smoke_grid/smoke_grid_64.vdb", grid = "density" }
phase = { type = "hg", g = 0.85 }
[[shapes]]
type = "box"
min = [-1, -1, -1]
max = [1, 1, 1]
interior = "smoke"
[[lights]]
type = "environment"
file = "beam/window.hdr"
rotate = 40
[[lights]]
type = "directional"
direction = [-1, -2, -0.5]
irradiance = 3
angle = 3
[[lights]]
type = "spot"
position = [2, 1, 1]
target = [0, 0, 0]
intensity = 10
"#;
    let path = of(text, 16, 25, &[PATH, "render.max_depth=1"]);
    let traced = of(text, 16, 20, &[PHOTON, TRACED, "render.max_depth=1"]);
    checks.agree("one event", &traced, &path, 0.006, 0.0);
    for step in ["uniform", "adaptive", "exponential"] {
        let [step_is, size_is] = march(step, 0.4);
        let set = [PHOTON, TRACED, "render.max_depth=1", &step_is, &size_is];
        let marched = of(text, 16, 3, &set);
        checks.agree(&format!("one event, {step} steps"), &marched, &path, 0.006, 0.0);
    }
    // Path tracing found this once (384 seeds of 80 samples).
    let known = Estimate { mean: [0.291_062; 3], standard_error: [1.6e-4; 3] };
    checks.agree("all light, paths", &of(text, 16, 20, &[PATH]), &known, 0.006, 0.0);
    let traced = of(text, 5, 16, &[PHOTON, TRACED, "photons.volume=100_000"]);
    checks.agree("all light, traced", &traced, &known, 0.006, 0.01);
    checks.finish();
}

/// A ball of glass in fog, lit through the fog's index-matched boundary by a lamp that paths can meet through it.
const CAUSTIC: &str = r#"
[camera]
position = [0, -0.3, 5]
target = [0, -0.4, 0]
fov = 12
[media.fog]
sigma_s = 0.6
sigma_a = 0.1
phase = { type = "hg", g = 0.3 }
[materials.glass]
type = "dielectric"
ior = 1.5
[[shapes]]
type = "box"
min = [-1.5, -1.5, -1.5]
max = [1.5, 1.5, 1.5]
interior = "fog"
[[shapes]]
type = "sphere"
center = [0, 0.3, 0]
radius = 0.5
material = "glass"
priority = 1
[[shapes]]
type = "sphere"
center = [0, 3.5, 0]
radius = 0.6
emission = { radiance = 10 }
"#;

/// Light scattered once that came through the glass is light of three events at most; it must not be lost, nor be
/// counted twice. Path tracing found this once (64 seeds of 1000 samples), and 0.00703 without what came through the glass.
#[test]
fn a_caustic_survives() {
    let mut checks = Checks::default();
    let depth = "render.max_depth=3";
    let path = Estimate { mean: [0.023_137; 3], standard_error: [5.9e-5; 3] };
    let traced = of(CAUSTIC, 5, 32, &[PHOTON, TRACED, depth, "photons.volume=200_000"]);
    checks.agree("traced", &traced, &path, 0.0065, 0.006);
    let photons = of(CAUSTIC, 8, 32, &[PHOTON, depth, "photons.volume=200_000"]);
    checks.agree("photons", &photons, &path, 0.0065, 0.01);
    checks.finish();
}

/// Fog that glows and a lamp in it: photons of the glow stay in the map.
#[test]
fn photons_of_a_glow_stay() {
    let mut checks = Checks::default();
    let text = r#"
[camera]
position = [0, -0.4, 5]
target = [0, -0.4, 0]
fov = 12
[media.fog]
sigma_t = 1.2
albedo = [0.9, 0.6, 0.3]
emission = { radiance = [0.3, 0.5, 0.8] }
phase = { type = "hg", g = 0.6 }
[[shapes]]
type = "cylinder"
base = [0, -1, 0]
top = [0, 1, 0]
radius = 1
interior = "fog"
[[shapes]]
type = "disk"
center = [0.3, 0.6, 0.2]
normal = [1, 0.5, 0.3]
radius = 0.3
emission = { radiance = 5, side = "both" }
"#;
    for depth in ["render.max_depth=1", "render.max_depth=0"] {
        let path = of(text, 16, 60, &[PATH, depth]);
        let traced = of(text, 8, 64, &[PHOTON, TRACED, depth, "photons.volume=100_000"]);
        checks.agree(depth, &traced, &path, 0.003, 0.005);
    }
    checks.finish();
}

/// A wide slab. Lit along its normal, light does at its boundary what straight shadow rays take it for: one scattering
/// has a closed form. Lit aslant, the way through the medium is right, but light that is spread by cos θ/cos θ′ as it
/// enters is not.
#[test]
fn straight_on_through_a_boundary() {
    let mut checks = Checks::default();
    let (sigma_s, sigma_a, irradiance) = ([0.5, 1.0, 2.0], 0.3, 3.0);
    for (ior, [x, y]) in [(1.0, [0.3, -1.0]), (1.5, [0.0, -1.0]), (1.5, [1.0, -1.0])] {
        let depth = if ior == 1.0 { 1 } else { 3 };
        let text = format!(
            r#"{FILM}
[camera]
position = [3, 10, 0]
target = [0, 0, 0]
fov = 1
[media.milk]
sigma_s = {sigma_s:?}
sigma_a = {sigma_a}
[materials.glass]
type = "dielectric"
ior = {ior}
[[shapes]]
type = "box"
min = [-20, -1, -20]
max = [20, 0, 20]
material = "glass"
interior = "milk"
[[lights]]
type = "directional"
direction = [{x}, {y}, 0]
irradiance = {irradiance}
[render]
max_depth = {depth}
"#
        );
        // In, scattered, out: cosines outside and inside, and what Fresnel's equations let pass.
        let cosines = |cos: f64| (cos, (1.0 - (1.0 - cos * cos) / (ior * ior)).sqrt());
        let passed = |(cos, inside): (f64, f64)| {
            let parallel = (ior * cos - inside) / (ior * cos + inside);
            let perpendicular = (cos - ior * inside) / (cos + ior * inside);
            1.0 - 0.5 * (parallel * parallel + perpendicular * perpendicular)
        };
        let (eye, light) = (cosines(10.0 / 109f64.sqrt()), cosines(-y / f64::hypot(x, y)));
        let expected = sigma_s.map(|sigma_s| {
            let ways = 1.0 / eye.1 + 1.0 / light.1;
            let tau = (sigma_s + sigma_a) * ways;
            let arriving = irradiance * passed(light);
            let scattered = sigma_s * arriving / (4.0 * std::f64::consts::PI * eye.1) * (1.0 - (-tau).exp()) / tau;
            scattered * passed(eye) / (ior * ior)
        });
        let found = Estimate::of(16, &text, &[PHOTON, APPROXIMATE, "render.samples=100", "photons.volume=1000"]);
        checks.agree(&format!("index {ior}, light along {x}, {y}"), &found, &Estimate::exact(expected), 0.003, 2e-4);
    }
    checks.finish();
}
