//! Caustics on surfaces: photons bring what light paths find.

use crate::support::{Checks, Estimate, render};

/// A ball of glass over a checkered floor, and a round lamp.
const BALL: &str = r#"
[materials.floor]
type = "lambert"
reflectance = { texture = "checker", scale = 6, a = [0.8, 0.5, 0.3], b = 0.2 }
[materials.glass]
type = "dielectric"
ior = 1.5
[[shapes]]
type = "quad"
origin = [-3, 0, 3]
edge_u = [6, 0, 0]
edge_v = [0, 0, -6]
material = "floor"
[[shapes]]
type = "sphere"
center = [0, 1.4, 0]
radius = 0.8
material = "glass"
[[shapes]]
type = "disk"
center = [0.5, 3, -0.2]
normal = [-0.5, -1.6, 0.2]
radius = 0.2
emission = { radiance = [30, 25, 20] }
"#;

/// What lies below the ball instead of the checkered floor: metal so rough that photons tell what it sends.
const BRUSHED: (&str, &str) = (
    "type = \"lambert\"\nreflectance = { texture = \"checker\", scale = 6, a = [0.8, 0.5, 0.3], b = 0.2 }",
    "type = \"conductor\"\nmetal = \"Cu\"\nroughness = 0.35",
);

/// A ring of metal, not quite smooth, on a table under thin fog, and a small lamp; a pane lies over a part of the light.
const RING: &str = r#"
[[shapes]]
type = "box"
min = [-1.5, 0.01, -1.5]
max = [1.5, 1, 1.5]
interior = "fog"
[media.fog]
sigma_s = 0.05
sigma_a = 0.02
[materials.table]
type = "oren_nayar"
reflectance = [0.5, 0.3, 0.2]
sigma = 0.3
[materials.gold]
type = "conductor"
metal = "Au"
roughness = 0.1
[materials.pane]
type = "thin_dielectric"
[[shapes]]
type = "quad"
origin = [-2, 0, 2]
edge_u = [4, 0, 0]
edge_v = [0, 0, -4]
material = "table"
[[shapes]]
type = "cylinder"
base = [0, 0, 0]
top = [0, 0.5, 0]
radius = 1
caps = false
material = "gold"
[[shapes]]
type = "quad"
origin = [-1, 1.2, 1]
edge_u = [1, 0, 0]
edge_v = [0, 0, -1]
material = "pane"
[[shapes]]
type = "sphere"
center = [2, 2, 1]
radius = 0.15
emission = { radiance = 60 }
"#;

/// A block of glass before a corner of two walls under a small sun and a sky; what it sends to one wall lights the other.
const CORNER: &str = r#"
[materials.wall]
type = "lambert"
reflectance = 0.7
[materials.glass]
type = "dielectric"
ior = 1.6
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
edge_v = [0, 4, 0]
material = "wall"
[[shapes]]
type = "box"
min = [-0.4, 0.9, -0.9]
max = [0.4, 1.9, -0.1]
transform = [{ rotate = { axis = [1, 1, 0], angle = 40 } }]
material = "glass"
[[lights]]
type = "directional"
direction = [-0.3, -1, -0.6]
irradiance = 3
angle = 2
[[lights]]
type = "environment"
radiance = 0.3
"#;

/// The mean of a film on which no glass or metal is seen, by photons within the blur of their discs and no part of the light twice,
/// against what light tracing found once with standard errors (32 seeds), or paths (the ring: 8 seeds).
#[test]
fn photons_bring_caustics() {
    let mut checks = Checks::default();
    let brushed = BALL.replacen(BRUSHED.0, BRUSHED.1, 1);
    assert_ne!(brushed, BALL);
    let below_the_ball = "position = [0, 0.5, 0.1]\ntarget = [0, 0, 0.1]\nup = [0, 0, -1]\nfov = 110";
    let (one, both): (&[&str], &[&str]) = (&["knn"], &["knn", "sheets"]);
    for (name, scene, estimates, camera, samples, (mean, standard_error)) in [
        ("ball", BALL, both, below_the_ball, 16, ([0.233_810, 0.124_677, 0.062_368], [1.8e-5, 8.8e-6, 4.2e-6])),
        (
            "ball over metal",
            &brushed,
            one,
            below_the_ball,
            16,
            ([0.170_295, 0.090_242, 0.061_524], [5.5e-5, 2.2e-5, 1.4e-5]),
        ),
        (
            "ring",
            RING,
            one,
            "position = [0, 1.1, 0]\ntarget = [0, 0, 0]\nup = [0, 0, -1]\nfov = 50",
            64,
            ([0.054_317, 0.032_099, 0.020_177], [1.3e-5, 6.7e-6, 2.7e-6]),
        ),
        (
            "corner",
            CORNER,
            both,
            "position = [0, 1.4, -0.5]\ntarget = [0, 0, -2]\nfov = 70",
            32,
            ([0.764_826; 3], [4.1e-4; 3]),
        ),
    ] {
        let text = format!("[film]\nwidth = 16\nheight = 16\nlayers = false\n[camera]\n{camera}\n{scene}");
        let samples = format!("render.samples={samples}");
        for estimate in estimates {
            let chosen = format!("surface.estimate={estimate}");
            // What is not of the caustic brings little of the noise.
            let photons = ["photons.caustic=50_000", "photons.global=20_000", "photons.volume=10_000"];
            let found = Estimate::of(4, &text, &[&photons[..], &[&samples, &chosen]].concat());
            checks.agree(&format!("{name}, {estimate}"), &found, &Estimate { mean, standard_error }, 0.01, 0.005);
        }
    }
    checks.finish();
}

/// A ball of glass over a floor of which one part receives no caustics, and a mirror beside it that casts none; a wall shows what the
/// floor sends on.
const FLAGS: &str = r#"
[film]
width = 16
height = 16
[camera]
position = [0, 0.5, 0.1]
target = [0, 0, 0.1]
up = [0, 0, -1]
fov = 110
[materials.floor]
type = "lambert"
reflectance = 0.6
[materials.glass]
type = "dielectric"
[materials.silver]
type = "conductor"
metal = "Ag"
roughness = 0.08
[[shapes]]
name = "dull"
type = "quad"
origin = [-3, 0, 3]
edge_u = [2.75, 0, 0]
edge_v = [0, 0, -6]
material = "floor"
receives_caustics = false
[[shapes]]
type = "quad"
origin = [-0.25, 0, 3]
edge_u = [3.25, 0, 0]
edge_v = [0, 0, -6]
material = "floor"
[[shapes]]
type = "quad"
origin = [-3, 0, -1.2]
edge_u = [6, 0, 0]
edge_v = [0, 3, 0]
material = "floor"
[[shapes]]
name = "ball"
type = "sphere"
center = [0, 1.4, 0]
radius = 0.8
material = "glass"
[[shapes]]
name = "sheet"
type = "quad"
origin = [1.2, 0.6, 1]
edge_u = [0.6, 1.4, 0]
edge_v = [0, 0, -2]
material = "silver"
casts_caustics = false
[[shapes]]
type = "disk"
center = [0.5, 3, -0.2]
normal = [-0.5, -1.6, 0.2]
radius = 0.7
emission = { radiance = [30, 25, 20] }
"#;

/// What shapes cast or receive none of is left out, whoever looks for it: photons, paths and light paths find the same of the rest, also
/// of what that lights.
#[test]
fn caustics_are_left_out_by_all_methods() {
    let mut checks = Checks::default();
    let by = |method: &str, seeds: u32, samples: u32| {
        let settings = [format!("render.method={method}"), format!("render.samples={samples}")];
        let [method, samples] = &settings;
        Estimate::of(seeds, FLAGS, &[method, samples, "photons.caustic=20_000", "photons.global=20_000"])
    };
    let light = by("light", 8, 200);
    checks.agree("path", &by("path", 8, 200), &light, 0.02, 0.0);
    checks.agree("photon", &by("photon", 4, 16), &light, 0.02, 0.01);
    checks.finish();

    // Nothing else changes where nothing is cast: of a path tracer's picture, one layer is gone.
    let layers = |casts: bool| {
        let casts = format!("shapes.ball.casts_caustics={casts}");
        let film = render(FLAGS, &[&casts, "render.method=path", "render.samples=64", "render.adaptive=false"]).film;
        film.layers()
    };
    let (mut all, rest) = (layers(true), layers(false));
    let names = all.len();
    all.retain(|layer| layer.name != "caustic");
    assert!(all.len() + 1 == names && rest.len() == all.len());
    for (all, rest) in all.iter().zip(&rest).filter(|(layer, _)| layer.name != "indirect") {
        assert!(all.name == rest.name && all.channels == rest.channels, "{}", all.name);
    }
}
