//! Paths find the light in the peaks of phase functions that photons leave to them: all of it, and none twice, against the path tracer.

use crate::support::{Checks, Estimate, images};

const TRACED: &str = "volume.single_scattering=traced";
const POINTS: &str = "volume.estimate=point";
const PHOTONS: [&str; 6] = [
    "render.method=photon",
    "volume.peaks=paths",
    "photons.volume=30_000",
    "photons.global=10_000",
    "photons.caustic=10_000",
    "render.samples=24",
];

/// A room without a ceiling under a sky, full of fog, with a lamp, a pane, and a ball of glass that holds some of it.
const ROOM: &str = r#"
[film]
width = 10
height = 10
layers = false
[camera]
position = [0, 1, 1.8]
target = [0, 1.1, -1]
fov = 70
[media.fog]
sigma_s = SIGMA
sigma_a = 0.05
phase = PHASE
[materials.wall]
type = "lambert"
reflectance = [0.4, 0.3, 0.2]
[materials.pane]
type = "thin_dielectric"
[materials.glass]
type = "dielectric"
ior = 1.4
[[shapes]]
type = "box"
min = [-1.99, 0.01, -1.99]
max = [1.99, 2.5, 1.99]
interior = "fog"
[[shapes]]
type = "quad"
origin = [-2, 0, 2]
edge_u = [4, 0, 0]
edge_v = [0, 0, -4]
material = "wall"
[[shapes]]
type = "quad"
origin = [-2, 0, -2]
edge_u = [4, 0, 0]
edge_v = [0, 3, 0]
material = "wall"
[[shapes]]
type = "quad"
origin = [-1.2, 0.3, -0.8]
edge_u = [1.6, 0, 0.3]
edge_v = [0, 1.6, 0]
material = "pane"
[[shapes]]
type = "sphere"
center = [0.9, 0.6, -0.6]
radius = 0.5
material = "glass"
interior = "fog"
priority = 1
[[shapes]]
type = "disk"
center = [0.2, 2.0, -1.2]
normal = [0, -1, 0.4]
radius = 0.6
emission = { radiance = 12 }
[[lights]]
type = "environment"
radiance = [0.5, 0.7, 1]
"#;

/// A small cloud under a sky, with a sun at one side.
const CLOUD: &str = r#"
[film]
width = 10
height = 10
layers = false
[camera]
position = [0.3, 0.2, 4.5]
target = [0, 0, 0]
fov = 30
[media.cloud]
sigma_t = [9, 11, 12]
albedo = 0.98
phase = PHASE
density = { type = "noise", scale = 1.2, octaves = 2, threshold = 0.4, seed = 3 }
[[shapes]]
type = "box"
min = [-1, -1, -1]
max = [1, 1, 1]
interior = "cloud"
[[lights]]
type = "directional"
direction = [1, -0.4, -0.3]
irradiance = 3
angle = 6
[[lights]]
type = "environment"
radiance = [0.3, 0.5, 1]
"#;

const HG: &str = "{ type = \"hg\", g = 0.9 }";
const MIE: &str = "{ type = \"mie\", diameter = 12 }";

/// A name, a scene, its depth, what path tracing found with its standard error, and more settings.
type Case<'a> = (&'a str, &'a str, &'a str, (f64, f64), &'a [&'a str]);

/// Against what path tracing found once, with standard errors (eight seeds).
#[test]
fn nothing_is_left_out_and_nothing_counts_twice() {
    let mut checks = Checks::default();
    let room = |phase, sigma| ROOM.replace("PHASE", phase).replace("SIGMA", sigma);
    let (grey, coloured, cloud) =
        (room(HG, "0.6"), room(MIE, "[0.3, 0.6, 0.9]"), |phase| CLOUD.replace("PHASE", phase));
    let cases: [Case<'_>; 8] = [
        ("room, one event", &grey, "1", (0.221_98, 1.5e-4), &[]),
        ("room, two events", &grey, "2", (0.401_53, 3.6e-4), &[]),
        ("room, two events, traced", &grey, "2", (0.401_53, 3.6e-4), &[TRACED]),
        ("room", &grey, "0", (0.759_90, 9.3e-4), &[]),
        ("room, points", &grey, "0", (0.759_90, 9.3e-4), &[POINTS]),
        ("room of droplets, coloured", &coloured, "0", (0.756_99, 1.06e-3), &[]),
        ("cloud", &cloud(HG), "0", (0.607_16, 7.1e-4), &[]),
        ("cloud of droplets", &cloud(MIE), "0", (0.603_25, 1.47e-3), &[]),
    ];
    for (what, text, depth, (mean, standard_error), set) in cases {
        let path = Estimate { mean: [mean; 3], standard_error: [standard_error; 3] };
        let depth = format!("render.max_depth={depth}");
        let all = [&PHOTONS[..], &[&depth], set].concat();
        checks.agree(what, &Estimate::over(&images(6, text, &all), |image| [image.mean(); 3]), &path, 0.03, 0.01);
    }
    checks.finish();
}
