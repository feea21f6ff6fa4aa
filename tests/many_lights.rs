//! Light is the same however many lights send it.

use std::fmt::Write;

use crate::support::{Checks, Estimate};

/// A room with fog, seen from within.
const ROOM: &str = r#"
[film]
width = 4
height = 4
layers = false
[camera]
position = [0, 0, 5.5]
target = [0, -0.3, 0]
fov = 50
[world]
medium = "fog"
[media.fog]
sigma_s = [0.05, 0.08, 0.1]
sigma_a = 0.02
phase = { type = "hg", g = 0.5 }
[materials.wall]
type = "lambert"
reflectance = [0.3, 0.6, 0.5]
[[shapes]]
type = "box"
min = [-3, -3, -3]
max = [3, 3, 6]
material = "wall"
"#;

/// Points and spots, each so many times with so much less light.
fn lights(times: usize) -> String {
    let mut text = String::new();
    let all = [
        ("point", [-2.0, 1.0, 0.0], [3.0, 2.0, 1.0]),
        ("point", [2.0, -2.0, 2.0], [0.5, 1.0, 2.0]),
        ("spot", [1.0, 2.5, -1.0], [4.0, 9.0, 6.0]),
        ("spot", [-1.0, 2.5, 3.0], [6.0, 3.0, 9.0]),
    ];
    for (kind, position, intensity) in all {
        let intensity = intensity.map(|x: f64| x / times as f64);
        let more = if kind == "spot" { "target = [0.5, -3, 0]\nouter_angle = 35" } else { "" };
        for _ in 0..times {
            let light =
                format!("[[lights]]\ntype = \"{kind}\"\nposition = {position:?}\nintensity = {intensity:?}\n{more}");
            writeln!(text, "{light}").unwrap();
        }
    }
    text
}

/// A lamp below the ceiling, of so many triangles along and across; or a quad.
fn lamp(count: Option<usize>, folder: &std::path::Path) -> String {
    let emission = "emission = { radiance = [2, 3, 4] }\n";
    let Some(n) = count else {
        let place = "origin = [-2, 2.8, -2]\nedge_u = [3, 0, 0]\nedge_v = [0, 0, 1]";
        return format!("[[shapes]]\ntype = \"quad\"\n{place}\n{emission}");
    };
    // A unit square in its own space.
    let mut mesh = String::new();
    for i in 0..=n * (n + 2) {
        let [x, z] = [i % (n + 1), i / (n + 1)].map(|k| k as f64 / n as f64);
        writeln!(mesh, "v {x} 0 {z}").unwrap();
    }
    for i in (0..n * (n + 1)).filter(|i| i % (n + 1) < n).map(|i| i + 1) {
        let [b, c, d] = [i + 1, i + n + 2, i + n + 1];
        writeln!(mesh, "f {i} {b} {c}\nf {i} {c} {d}").unwrap();
    }
    let file = folder.join("lamp.obj");
    std::fs::write(&file, mesh).unwrap();
    let place = "transform = [{ scale = [3, 1, 1] }, { translate = [-2, 2.8, -2] }]";
    format!("[[shapes]]\ntype = \"mesh\"\nfile = {file:?}\n{place}\n{emission}")
}

/// Lights that are weighed one by one, and the same light from many more, of which a tree draws; a lamp that is one quad, and one
/// of 200 triangles.
#[test]
fn many_lights_send_what_a_few_do() {
    let folder = tempfile::tempdir().unwrap();
    let mut checks = Checks::default();
    let few = format!("{ROOM}{}{}", lights(1), lamp(None, folder.path()));
    let many = format!("{ROOM}{}{}", lights(10), lamp(Some(10), folder.path()));
    for (method, samples, precision, bias) in [("path", 500, 0.007, 0.0), ("photon", 30, 0.013, 0.005)] {
        let of = |text: &str| {
            let changes = [format!("render.method={method}"), format!("render.samples={samples}")];
            let changes = [&*changes[0], &changes[1], "photons.volume=20000", "render.max_depth=4"];
            Estimate::of(16, text, &changes)
        };
        checks.agree(method, &of(&many), &of(&few), precision, bias);
    }
    checks.finish();
}
