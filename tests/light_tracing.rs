//! Light paths, connected to the camera, find the light that eye paths find: kind by kind, block by block of the film.

use std::collections::BTreeMap;

use rayon::prelude::*;
use volpm::image::LayerData;
use volpm::render::Film;

use crate::support::{Estimate, built, render};

/// Independent renders by each method.
const SEEDS: u32 = 32;
/// Blocks of the film across and down.
const BLOCKS: [usize; 2] = [3, 3];
/// Layers that both methods see. Smooth glass and mirrors show nothing to light paths.
const KINDS: [&str; 7] =
    ["emission", "direct", "indirect", "caustic", "volume_emission", "volume_single", "volume_multiple"];

/// Every kind's mean by block, and over the film.
fn blocks(film: &Film) -> BTreeMap<String, Vec<[f64; 3]>> {
    let (width, height) = film.size();
    let (width, height) = (width as usize, height as usize);
    let mut found = BTreeMap::new();
    for layer in film.layers() {
        let LayerData::Rgb(values) = &layer.channels else { continue };
        if !KINDS.contains(&layer.name.as_str()) {
            continue;
        }
        let [across, down] = BLOCKS;
        let mut means = vec![[0.0; 3]; across * down + 1];
        for (at, value) in values.iter().enumerate() {
            let block = at / width * down / height * across + at % width * across / width;
            let pixels = |n: usize, blocks: usize, i: usize| ((i + 1) * n).div_ceil(blocks) - (i * n).div_ceil(blocks);
            let size = pixels(width, across, block % across) * pixels(height, down, block / across);
            for c in 0..3 {
                means[block][c] += f64::from(value[c]) / size as f64;
                means[across * down][c] += f64::from(value[c]) / values.len() as f64;
            }
        }
        found.insert(layer.name, means);
    }
    found
}

/// Renders by both methods, and compares what they find. The mean of every kind that is at least a tenth of the picture is to be
/// known to `precise`, as a share.
fn compare(what: &str, text: &str, overrides: &[&str], (eye_samples, light_samples): (u32, u32), precise: f64) {
    let [eye, light] = [("path", eye_samples), ("light", light_samples)].map(|(method, samples)| {
        let (method, samples) = (format!("render.method={method}"), format!("render.samples={samples}"));
        let render = |seed: u32| {
            let seed = format!("render.seed={seed}");
            let mut all = vec![method.as_str(), &samples, &seed, "film.layers=true"];
            all.extend(overrides);
            blocks(&render(text, &all).film)
        };
        (1..=SEEDS).into_par_iter().map(render).collect::<Vec<_>>()
    });
    let mut failed = Vec::new();
    let last = BLOCKS[0] * BLOCKS[1];
    let zero = [0.0; 3];
    let mean = |kind: &str| {
        let found = |seed: &BTreeMap<String, Vec<[f64; 3]>>| seed.get(kind).map_or(0.0, |means| means[last][1]);
        eye.iter().map(found).sum::<f64>() / f64::from(SEEDS)
    };
    let whole: f64 = KINDS.iter().map(|kind| mean(kind)).sum();
    assert!(whole > 0.0, "{what}: all is black");
    for kind in KINDS {
        for block in 0..=last {
            let of = |seeds: &[BTreeMap<String, Vec<[f64; 3]>>]| {
                Estimate::over(seeds, |seed| seed.get(kind).map_or(zero, |means| means[block]))
            };
            let (a, b) = (of(&eye), of(&light));
            for c in 0..3 {
                let error = a.standard_error[c].hypot(b.standard_error[c]);
                let off = (a.mean[c] - b.mean[c]).abs();
                // Where one of them has met nothing rare in a part of the picture, it does not tell how far off it is.
                let knows = block == last || (a.mean[c] > 0.0) == (b.mean[c] > 0.0);
                // Roundings of layers.
                let far = knows && off > 4.5 * error + 1e-5 * a.mean[c];
                let vague = block == last && mean(kind) > 0.1 * whole && error > precise * a.mean[c];
                if far || vague {
                    failed.push(format!(
                        "{kind}, block {block}, channel {c}: path {:.5e} ± {:.1e}, light {:.5e} ± {:.1e} ({:+.2} %, {:.1} σ)",
                        a.mean[c],
                        a.standard_error[c],
                        b.mean[c],
                        b.standard_error[c],
                        100.0 * (b.mean[c] / a.mean[c] - 1.0),
                        off / error,
                    ));
                }
            }
        }
    }
    assert!(failed.is_empty(), "{what}:\n{}", failed.join("\n"));
}

/// White walls and a lamp on the ceiling, seen through the open front.
const ROOM: &str = r#"
[film]
width = 15
height = 12
[camera]
position = [0, 0.1, 3.4]
target = [0, 0, 0]
fov = 45
[materials.white]
type = "lambert"
reflectance = [0.8, 0.6, 0.4]
[[shapes]]
type = "quad"
origin = [-1, -1, 1]
edge_u = [2, 0, 0]
edge_v = [0, 0, -2]
material = "white"
[[shapes]]
type = "quad"
origin = [-1, -1, -1]
edge_u = [2, 0, 0]
edge_v = [0, 2, 0]
material = "white"
[[shapes]]
type = "quad"
origin = [-1, 1, -1]
edge_u = [2, 0, 0]
edge_v = [0, 0, 2]
material = "white"
[[shapes]]
type = "sphere"
center = [0.3, -0.5, 0]
radius = 0.5
material = "white"
[[shapes]]
type = "quad"
origin = [-0.3, 0.99, -0.3]
edge_u = [0.6, 0, 0]
edge_v = [0, 0, 0.6]
emission = { radiance = 5, side = "both" }
"#;

#[test]
fn a_room() {
    compare("room", ROOM, &[], (64, 64), 0.005);
}

/// The same events count, whatever their limit: layer by layer.
#[test]
fn limits_of_events() {
    for depth in 1..=3 {
        let depth = format!("render.max_depth={depth}");
        compare(&depth, FOG, &[&depth], (48, 96), 0.015);
    }
}

/// Films that are not square, cameras that are turned, and every filter.
#[test]
fn filters_and_turned_cameras() {
    for filter in ["box", "tent", "gaussian"] {
        let filter = format!("film.filter={filter}");
        let turned = ["film.width=9", "film.height=14", "camera.up=[0.5, 1, 0.2]", "camera.target=[0.4, -0.2, 0.3]"];
        let all: Vec<&str> = turned.into_iter().chain([filter.as_str()]).collect();
        compare(&filter, ROOM, &all, (48, 48), 0.02);
    }
}

/// Fog in a box over a white floor, lit by a spot without size.
const FOG: &str = r#"
[film]
width = 15
height = 12
[camera]
position = [0, 0.6, 4.5]
target = [0, 0, 0]
fov = 40
[media.fog]
sigma_s = [0.4, 0.7, 1.2]
sigma_a = 0.1
phase = { type = "hg", g = 0.5 }
[materials.white]
type = "lambert"
reflectance = 0.7
[[shapes]]
type = "box"
min = [-1, -1, -1]
max = [1, 1, 1]
interior = "fog"
[[shapes]]
type = "quad"
origin = [-3, -1.01, 3]
edge_u = [6, 0, 0]
edge_v = [0, 0, -6]
material = "white"
[[lights]]
type = "spot"
position = [0.7, 2.4, 0.5]
target = [0, 0, 0]
intensity = [9, 6, 3]
inner_angle = 20
outer_angle = 32
"#;

#[test]
fn fog_in_a_box() {
    compare("fog", FOG, &[], (64, 96), 0.015);
}

/// A lens before fog; a ball of glass that bends each channel otherwise, and one that is rough, both before a white wall.
const GLASS: &str = r#"
[film]
width = 12
height = 12
[camera]
position = [0, 0, 4]
target = [0, 0, 0]
fov = 50
aperture = 0.4
focus_distance = 3.0
[media.fog]
sigma_s = [0.05, 0.1, 0.2]
sigma_a = 0.02
[materials.white]
type = "lambert"
reflectance = 0.7
[materials.glass]
type = "dielectric"
ior = [1.4, 1.5, 1.6]
[materials.frosted]
type = "dielectric"
ior = 1.4
roughness = 0.3
[[shapes]]
type = "box"
min = [-5, -5, -2]
max = [5, 5, 3]
interior = "fog"
[[shapes]]
type = "sphere"
center = [-0.9, 0, 0]
radius = 0.7
material = "glass"
[[shapes]]
type = "sphere"
center = [0.9, 0, 0]
radius = 0.7
material = "frosted"
[[shapes]]
type = "quad"
origin = [-4, -4, -1]
edge_u = [8, 0, 0]
edge_v = [0, 8, 0]
material = "white"
[[shapes]]
type = "sphere"
center = [0, 2.6, 1.5]
radius = 1.2
emission = { radiance = 3 }
"#;

#[test]
fn a_lens_and_glass() {
    compare("glass", GLASS, &[], (64, 192), 0.02);
    // In the fog itself, what scatters close to the lens is far brighter.
    compare("in fog", GLASS, &["world.medium=\"fog\""], (16, 64), 0.06);
}

/// A sky that is brighter above, and a sun; a mesh of smoothed normals on a floor.
const SKY: &str = r#"
[film]
width = 15
height = 10
[camera]
position = [0, 1.5, 6]
target = [0, 0.4, 0]
fov = 40
[materials.white]
type = "lambert"
reflectance = 0.6
[[shapes]]
type = "lathe"
profile = [[0, 0], [1, 0.1], [0.8, 0.9], [0.5, 1.4], [0, 1.6]]
segments = 7
crease = 70
material = "white"
[[shapes]]
type = "disk"
center = [0, 0, 0]
normal = [0, 1, 0]
radius = 2.5
material = "white"
[[lights]]
type = "environment"
radiance = [0.3, 0.4, 0.6]
[[lights]]
type = "directional"
direction = [1, -1.2, -0.7]
irradiance = 2
angle = 4
"#;

#[test]
fn a_sky_and_a_sun() {
    compare("sky", SKY, &[], (128, 256), 0.005);
    let clear = r#"lights=[{ type = "sky", sun = [-1, 0.4, 0.7], turbidity = 4 }]"#;
    compare("clear sky", SKY, &[clear], (128, 256), 0.01);
}

/// A cloud that glows and scatters, over a white floor.
const GLOW: &str = r#"
[film]
width = 12
height = 12
[camera]
position = [0, 0.5, 5]
target = [0, 0, 0]
fov = 40
[media.ember]
sigma_s = 0.8
sigma_a = [0.3, 0.4, 0.6]
emission = { radiance = [2, 1, 0.4] }
[materials.white]
type = "lambert"
reflectance = 0.7
[[shapes]]
type = "sphere"
center = [0, 0.2, 0]
radius = 1
interior = "ember"
[[shapes]]
type = "quad"
origin = [-3, -1.01, 3]
edge_u = [6, 0, 0]
edge_v = [0, 0, -6]
material = "white"
"#;

#[test]
fn a_glowing_cloud() {
    compare("glow", GLOW, &[], (128, 192), 0.005);
}

/// Soap bubbles, one in the other, with smoke in the outer one and an ember in the inner one; lace on a pane. All under a round lamp and a
/// wide sun, in haze.
const BUBBLES: &str = r#"
[film]
width = 12
height = 12
[camera]
position = [0, 0.6, 4.5]
target = [0, 0.4, 0]
fov = 40
[world]
medium = "haze"
[media.haze]
sigma_s = [0.05, 0.1, 0.15]
sigma_a = 0.02
phase = { type = "hg", g = 0.5 }
[media.smoke]
sigma_s = [0.8, 0.6, 0.4]
sigma_a = 0.1
[media.ember]
sigma_s = 0.3
sigma_a = [0.3, 0.4, 0.6]
emission = { radiance = [1, 0.5, 0.2] }
[materials.white]
type = "lambert"
reflectance = 0.7
[materials.soap]
type = "thin_dielectric"
ior = [1.3, 1.5, 1.8]
[materials.lace]
type = "mix"
a = "soap"
b = { type = "mix", a = "none", b = "white" }
[[shapes]]
type = "quad"
origin = [-3, -0.6, 3]
edge_u = [6, 0, 0]
edge_v = [0, 0, -6]
material = "white"
[[shapes]]
type = "sphere"
center = [-0.6, 0.5, 0]
radius = 0.7
interior = "smoke"
material = "soap"
[[shapes]]
type = "sphere"
center = [-0.5, 0.5, 0.1]
radius = 0.4
interior = "ember"
material = "soap"
priority = 1
[[shapes]]
type = "quad"
origin = [0.1, -0.5, 0.4]
edge_u = [1.2, 0, 0.3]
edge_v = [0, 1.2, 0]
material = "lace"
[[shapes]]
type = "sphere"
center = [0.4, 1.5, -0.4]
radius = 0.25
emission = { radiance = 12 }
[[lights]]
type = "directional"
direction = [0.2, -1, -0.5]
irradiance = 0.5
angle = 8
"#;

/// What sheets let pass is asked for, by shadow rays from all kinds of places and by connections to the camera, met by chance, and
/// counted once; with few events, too.
#[test]
fn bubbles_and_a_pane() {
    compare("bubbles", BUBBLES, &[], (16, 32), 0.04);
    compare("bubbles, three events", BUBBLES, &["render.max_depth=3"], (16, 32), 0.04);
}

/// What it cannot see, and what it will never know, is said by name; a rough ball and a lens are no such things.
#[test]
fn what_it_does_not_see_is_said() {
    let said = |overrides: &[&str]| {
        let few = ["film.width=2", "film.height=2", "render.samples=1"];
        let all: Vec<&str> = few.into_iter().chain(overrides.iter().copied()).collect();
        let mut warnings = built(GLASS, &all).0.warnings;
        warnings.extend(render(GLASS, &all).warnings);
        warnings.join("\n")
    };
    let light = said(&["render.method=light", "world.medium=\"fog\"", "camera.aperture=0"]);
    assert!(light.contains("does not see what shapes.1 mirror or refract"), "{light}");
    assert!(light.contains("a pinhole in medium fog"), "{light}");
    let lens = said(&["render.method=light", "world.medium=\"fog\"", "materials.glass.roughness=0.1"]);
    assert!(!lens.contains("does not see") && !lens.contains("pinhole"), "{lens}");
    let path = said(&["render.method=path", "world.medium=\"fog\"", "camera.aperture=0"]);
    assert!(!path.contains("does not see") && !path.contains("pinhole"), "{path}");
}
