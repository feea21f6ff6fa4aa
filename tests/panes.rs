//! Light that sheets let straight through is asked for: every method finds it, through as many as its events allow.

use crate::support::{Checks, Estimate, render};

/// A floor of reflectance 0.5, seen straight from above at the origin. Sheets cast no caustics.
const FLOOR: &str = r#"
[film]
width = 2
height = 2
[camera]
position = [0, 1, 0]
target = [0, 0, 0]
up = [0, 0, -1]
fov = 0.01
[materials.floor]
type = "lambert"
reflectance = 0.5
[materials.black]
type = "lambert"
reflectance = 0
[materials.pane]
type = "thin_dielectric"
[materials.torn]
type = "mix"
a = "pane"
b = "none"
weight = 0.3
[materials.dirty]
type = "mix"
a = { type = "mix", a = "none", b = "black", weight = 0.5 }
b = "pane"
weight = 0.8
[[shapes]]
type = "quad"
origin = [-3, 0, 3]
edge_u = [6, 0, 0]
edge_v = [0, 0, -6]
material = "floor"
"#;

/// A lamp of no size at (2, 3, 0), and a sun that shines along the same way.
const LAMPS: [(&str, f64); 2] = [
    ("[[lights]]\ntype = \"point\"\nposition = [2, 3, 0]\nintensity = 20\n", 20.0 / 13.0),
    ("[[lights]]\ntype = \"directional\"\ndirection = [-2, -3, 0]\nirradiance = 2\n", 2.0),
];

/// A material, and a height.
type Sheet = (&'static str, f64);

/// A level sheet at this height, over all ways from the lamps to the floor.
fn sheet(material: &str, y: f64) -> String {
    format!(
        "[[shapes]]\ntype = \"quad\"\norigin = [-4.2, {y}, 4.2]\nedge_u = [8.4, 0, 0]\nedge_v = [0, 0, -8.4]\n\
         material = \"{material}\"\ncasts_caustics = false\n"
    )
}

/// 1 − R of a pane, R = 2F/(1 + F).
fn passed(cos: f64) -> f64 {
    let n = 1.5;
    let beyond = (1.0 - (1.0 - cos * cos) / (n * n)).sqrt();
    let [s, p] = [(cos - n * beyond) / (cos + n * beyond), (n * cos - beyond) / (n * cos + beyond)];
    let once = 0.5 * (s * s + p * p);
    (1.0 - once) / (1.0 + once)
}

/// What the floor sends of lamps of no size, which no path meets: the part that its sheets let pass. Each that is passed is an event,
/// holes are none; beyond the first case nothing is seen where one more is needed than may be.
#[test]
fn lamps_of_no_size_shine_through_sheets() {
    let aslant = 3.0 / 13.0f64.sqrt();
    let (t, straight) = (passed(aslant), passed(1.0));
    let cases: [(&[Sheet], u32, f64); 9] = [
        (&[], 1, 1.0),
        (&[("pane", 1.5)], 1, 0.0),
        (&[("pane", 1.5)], 2, t),
        (&[("pane", 1.5), ("pane", 1.7)], 2, 0.0),
        (&[("pane", 1.5), ("pane", 1.7)], 3, t * t),
        (&[("pane", 0.5)], 3, t * straight),
        (&[("torn", 1.5)], 1, 0.3),
        (&[("torn", 1.5)], 2, 0.3 + 0.7 * t),
        (&[("dirty", 1.5), ("pane", 1.7)], 3, (0.1 + 0.8 * t) * t),
    ];
    // Light paths hit a small place rarely, and light of a sun is the same all around it.
    let few = "photons.volume=2000";
    let methods: [(&str, &[&str]); 4] = [
        ("path", &["render.samples=512"]),
        ("whitted", &["render.samples=512"]),
        ("photon", &["render.samples=512", "surface.indirect=path", "surface.shadow_photons=true", few]),
        ("light", &["render.samples=4096", "camera.fov=40"]),
    ];
    let mut checks = Checks::default();
    for (lamp, irradiance) in LAMPS {
        for (sheets, depth, share) in &cases {
            let expected = irradiance * aslant * 0.5 / std::f64::consts::PI * share;
            let panes = sheets.iter().map(|(material, y)| sheet(material, *y));
            let text: String = [FLOOR.to_string(), lamp.to_string()].into_iter().chain(panes).collect();
            let methods = &methods[..if lamp.contains("directional") { 4 } else { 3 }];
            for (method, overrides) in methods {
                let limits = [format!("render.method={method}"), format!("render.max_depth={depth}")];
                let all: Vec<&str> = limits.iter().map(String::as_str).chain(overrides.iter().copied()).collect();
                let found = Estimate::of(8, &text, &all);
                let what = format!("{method}, {sheets:?}, {depth} events");
                if expected > 0.0 {
                    checks.agree(&what, &found, &Estimate::exact([expected; 3]), 0.08, 0.001);
                } else {
                    checks.holds(format!("{what}: {found:?}"), found.mean == [0.0; 3]);
                }
            }
        }
    }
    checks.finish();
}

/// A lamp that a pane mirrors aslant, before black: every sample finds it, though few paths go there, and once; through another pane, if
/// there may be that many events.
#[test]
fn every_sample_finds_a_lamp_in_a_pane() {
    let lamp = "[[shapes]]\ntype = \"quad\"\norigin = [-3, 2, -6]\nedge_u = [6, 0, 0]\nedge_v = [0, 0, 5]\nemission = { radiance = 7 }\n";
    let text = |above: &str| {
        let view = "[camera]\nposition = [0, 1, 2]\ntarget = [0, 0, 0]\nup = [0, 1, 0]\nfov = 0.01\n";
        let scene =
            FLOOR.replace("[camera]\nposition = [0, 1, 0]\ntarget = [0, 0, 0]\nup = [0, 0, -1]\nfov = 0.01\n", view);
        format!("{}{}{lamp}{above}", scene.replace("material = \"floor\"", "material = \"black\""), sheet("pane", 0.01))
    };
    let passed = passed(1.0 / 5.0f64.sqrt());
    let mirrored = 7.0 * (1.0 - passed);
    let other = sheet("pane", 1.5);
    for method in ["path", "photon", "whitted"] {
        for (above, depth, expected) in [("", 1, mirrored), (&other, 1, 0.0), (&other, 2, mirrored * passed)] {
            let set = [format!("render.method={method}"), format!("render.max_depth={depth}")];
            let overrides = [&set[0], &set[1], "render.samples=4"];
            let image = render(&text(above), &overrides).film.image();
            let found = image.channel_means();
            assert!((found[0] - expected).abs() <= 1e-3 * expected, "{method}, {depth}: {found:?}, not {expected}");
        }
    }
}

/// Walls that shine 1 − ρ and reflect ρ around fog that scatters only, in which sheets hang, one in the other: all is 1, wherever light is
/// asked for and wherever it is met.
const FURNACE: &str = r#"
[film]
width = 8
height = 8
[camera]
position = [0, 0, 0.8]
target = [0, 0, 0]
fov = 70
[render]
method = "path"
samples = 128
light_samples = 2
[media.fog]
sigma_s = 0.6
[media.breath]
sigma_s = [0.3, 1, 2]
phase = { type = "hg", g = 0.6 }
[materials.wall]
type = "lambert"
reflectance = 0.6
[materials.film]
type = "thin_dielectric"
ior = [1.4, 1.6, 2]
[materials.torn]
type = "mix"
a = "film"
b = { type = "mix", a = "none", b = { type = "lambert", reflectance = 1 } }
[[shapes]]
type = "box"
min = [-1, -1, -1]
max = [1, 1, 1]
material = "wall"
interior = "fog"
emission = { radiance = 0.4, side = "in" }
[[shapes]]
type = "sphere"
center = [0, 0, 0.4]
radius = 0.5
material = "film"
interior = "breath"
priority = 1
[[shapes]]
type = "sphere"
center = [0, 0.1, 0.3]
radius = 0.25
material = "torn"
priority = 2
[[shapes]]
type = "quad"
origin = [-0.9, -0.9, -0.3]
edge_u = [1.8, 0, 0]
edge_v = [0, 1.8, 0]
material = "film"
"#;

#[test]
fn a_furnace_of_sheets() {
    let mut checks = Checks::default();
    checks.agree("furnace", &Estimate::of(12, FURNACE, &[]), &Estimate::exact([1.0; 3]), 0.003, 0.0);
    checks.finish();
}
