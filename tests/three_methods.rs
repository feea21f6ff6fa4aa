//! Paths from the eye, photons, and paths from lights find the same light, on a dozen scenes that all three can do: with textures,
//! normal maps, coats, metals, rough glass and fog, seen from outside the fog or by a lens.

use volpm::compare::cpu_seconds;
use volpm::image::Image;

use crate::support::{Effort, Estimate, built, chosen};

/// What the scenes are made of: each names the materials and media that it uses.
const PARTS: &str = r#"
[film]
width = 12
height = 10
layers = false
[camera]
position = [0.2, 1.0, 4.6]
target = [0, 0.8, 0]
fov = 40
[media.fog]
sigma_s = [0.5, 0.7, 0.9]
sigma_a = 0.05
phase = { type = "hg", g = 0.4 }
[media.haze]
sigma_s = [0.05, 0.07, 0.1]
sigma_a = 0.01
phase = { type = "rayleigh" }
[media.cloud]
sigma_s = [2, 2.5, 3]
sigma_a = 0.1
phase = { type = "hg", g = 0.7 }
density = { type = "noise", scale = 0.8, octaves = 3, threshold = 0.3, seed = 2 }
[media.air]
sigma_s = 0.6
sigma_a = 0.1
density = { type = "exponential", scale_height = 0.6 }
[media.ember]
sigma_s = 0.8
sigma_a = [0.3, 0.4, 0.6]
emission = { radiance = [2, 1, 0.4] }
[materials.white]
type = "lambert"
reflectance = [0.7, 0.6, 0.5]
[materials.tiles]
type = "lambert"
reflectance = { texture = "checker", scale = 2, space = "object", a = [0.8, 0.7, 0.6], b = [0.2, 0.3, 0.4] }
[materials.wall]
type = "phong"
diffuse = { texture = "checker", scale = 3, a = [0.6, 0.3, 0.2], b = [0.1, 0.3, 0.5] }
specular = 0.3
exponent = 20
[materials.floor]
type = "coated"
roughness = { texture = "noise", scale = 0.2, octaves = 2, a = 0.15, b = 0.5 }
base = { type = "lambert", reflectance = { texture = "checker", scale = 2, space = "object", a = 0.8, b = 0.2 } }
normal_map = { texture = "noise", scale = 0.3, octaves = 2, a = [0.4, 0.45, 0.9], b = [0.6, 0.55, 1.0] }
[materials.copper]
type = "conductor"
metal = "Cu"
roughness = [0.5, 0.25]
[materials.worn]
type = "mix"
a = "copper"
b = { type = "oren_nayar", reflectance = [0.2, 0.5, 0.4], sigma = 0.5 }
weight = { texture = "noise", scale = 0.3, octaves = 3, threshold = 0.3, space = "object", a = 0, b = 1 }
bump = { texture = "noise", scale = 0.2, octaves = 1, space = "object", a = 0, b = 1 }
strength = 0.05
[materials.painted]
type = "schlick"
f0 = [0.9, 0.5, 0.4]
roughness = { texture = "checker", scale = 4, a = 0.5, b = 0.8 }
[materials.frosted]
type = "dielectric"
ior = 1.4
roughness = 0.4
"#;

const LENS: &str = "camera.aperture=0.15";

/// Name, what is changed of the parts, and shapes and lights.
const SCENES: [(&str, &[&str], &[&str]); 14] = [
    ("tiles and a block of fog", &[], &[FLOOR_OF_TILES, BLOCK_OF_FOG, SPOT]),
    ("the same by a lens", &[LENS, "camera.focus_distance=4"], &[FLOOR_OF_TILES, BLOCK_OF_FOG, SPOT]),
    ("all materials around fog", &[], &[COATED_FLOOR, BACK_WALL, BALLS, BLOCK_OF_FOG, LAMP]),
    ("coats and a metal in haze", &[LENS], &[COATED_FLOOR, BALLS, ROOM_OF_HAZE, LAMP]),
    ("a sky and a sun over a cloud", &[], &[FLOOR_OF_TILES, CLOUD, SKY]),
    ("coats below a sky and a cloud", &[LENS], &[COATED_FLOOR, BALLS, CLOUD, SKY]),
    ("frosted glass in haze", &[], &[FLOOR_OF_TILES, FROSTED, ROOM_OF_HAZE, LAMP]),
    ("frosted glass and a wall, fog behind", &[LENS], &[COATED_FLOOR, BACK_WALL, FROSTED, BLOCK_OF_FOG, LAMP]),
    ("glow over a glossy floor", &[], &[COATED_FLOOR, BACK_WALL, GLOW]),
    ("glow, a lamp and a metal", &[LENS], &[FLOOR_OF_TILES, BALLS, GLOW, LAMP]),
    ("air that thins, and a spot", &[], &[COATED_FLOOR, BALLS, BLOCK_OF_AIR, SPOT]),
    ("dust that adds to grains", &[LENS], &[FLOOR_OF_TILES, DUST, LAMP]),
    ("smoke that adds to mist", &[LENS], &[FLOOR_OF_TILES, SMOKE, LAMP]),
    ("many lamps in haze", &[], &[COATED_FLOOR, BACK_WALL, BALLS, ROOM_OF_HAZE, MANY]),
];

const FLOOR_OF_TILES: &str = "[[shapes]]\ntype = \"quad\"\norigin = [-2, 0, 2]\nedge_u = [4, 0, 0]\nedge_v = [0, 0, -4]\n\
                              material = \"tiles\"\n";
const COATED_FLOOR: &str = "[[shapes]]\ntype = \"quad\"\norigin = [-2, 0, 2]\nedge_u = [4, 0, 0]\nedge_v = [0, 0, -4]\n\
                            material = \"floor\"\n";
const BACK_WALL: &str = "[[shapes]]\ntype = \"quad\"\norigin = [-2, 0, -1.5]\nedge_u = [4, 0, 0]\nedge_v = [0, 2.2, 0]\n\
                         material = \"wall\"\n";
const BALLS: &str = "[[shapes]]\ntype = \"sphere\"\ncenter = [-0.8, 0.51, 0.4]\nradius = 0.5\nmaterial = \"worn\"\n\
                     [[shapes]]\ntype = \"cylinder\"\nbase = [0.9, 0.05, -0.6]\ntop = [0.9, 1.1, -0.6]\nradius = 0.4\n\
                     material = \"painted\"\n";
const FROSTED: &str = "[[shapes]]\ntype = \"sphere\"\ncenter = [0.3, 0.7, 0.5]\nradius = 0.5\nmaterial = \"frosted\"\n\
                       priority = 3\n";
const BLOCK_OF_FOG: &str = "[[shapes]]\ntype = \"box\"\nmin = [-0.7, 0.3, -1.2]\nmax = [1.5, 1.7, 1.2]\n\
                            interior = \"fog\"\npriority = 2\n";
const BLOCK_OF_AIR: &str = "[[shapes]]\ntype = \"box\"\nmin = [-1.5, 0.01, -1.5]\nmax = [1.5, 1.7, 1.5]\n\
                            interior = \"air\"\npriority = 2\n";
const ROOM_OF_HAZE: &str = "[[shapes]]\ntype = \"box\"\nmin = [-1.9, 0.005, -1.9]\nmax = [1.9, 2.2, 1.9]\n\
                            interior = \"haze\"\npriority = 1\n";
/// A ball that glows and adds to the block it is half in.
const DUST: &str = "[media.dust]\nsigma_s = 0.6\nsigma_a = [0.4, 0.2, 0]\nemission = { radiance = 0.3 }\nadd = true\n\
                    phase = { type = \"hg\", g = 0.7 }\n[media.grains]\nsigma_s = 0.9\n[[shapes]]\ntype = \"sphere\"\n\
                    center = [-0.5, 0.9, 0.4]\nradius = 0.6\ninterior = \"dust\"\n[[shapes]]\ntype = \"box\"\n\
                    min = [-0.7, 0.3, -1.2]\nmax = [1.5, 1.7, 1.2]\ninterior = \"grains\"\n";
/// A ball of smoke that glows and adds to the block of mist it is half in: density, albedo, phase function and glow are others.
const SMOKE: &str = "[media.mist]\nsigma_t = [0.4, 0.6, 0.8]\nalbedo = [0.9, 0.8, 0.9]\nphase = { type = \"hg\", g = 0.6 }\n\
                     [media.smoke]\nsigma_t = [4, 6, 8]\nalbedo = [0.5, 0.7, 0.8]\nadd = true\n\
                     density = { type = \"noise\", scale = 0.8, octaves = 3, threshold = 0.35, seed = 2 }\n\
                     emission = { radiance = [0.6, 0.4, 0.2] }\n[[shapes]]\ntype = \"sphere\"\n\
                     center = [-0.3, 0.9, 0.2]\nradius = 0.8\ninterior = \"smoke\"\n[[shapes]]\ntype = \"box\"\n\
                     min = [-0.7, 0.05, -1.2]\nmax = [1.5, 1.7, 1.2]\ninterior = \"mist\"\n";
const CLOUD: &str = "[[shapes]]\ntype = \"sphere\"\ncenter = [0.1, 1.1, 0]\nradius = 0.7\ninterior = \"cloud\"\n";
const GLOW: &str = "[[shapes]]\ntype = \"sphere\"\ncenter = [0.2, 0.8, 0.3]\nradius = 0.6\ninterior = \"ember\"\n";
const SPOT: &str = "[[lights]]\ntype = \"spot\"\nposition = [0.9, 3, 0.6]\ntarget = [0, 0.5, 0]\nintensity = [12, 10, 8]\n\
                    inner_angle = 15\nouter_angle = 30\n";
const LAMP: &str = "[[shapes]]\ntype = \"disk\"\ncenter = [-0.5, 2.1, 0.5]\nnormal = [0.2, -1, 0]\nradius = 0.35\n\
                    emission = { radiance = [12, 10, 8] }\n";
const SKY: &str = "[[lights]]\ntype = \"environment\"\nradiance = [0.3, 0.4, 0.6]\n\
                   [[lights]]\ntype = \"directional\"\ndirection = [1, -1.2, -0.7]\nirradiance = 2\nangle = 4\n";
/// Stands for rows of lamps: enough for a tree.
const MANY: &str = "many";

/// Five by four lamps of many colours below the ceiling, every second a spot.
fn many() -> String {
    let lamp = |i: i32| {
        let (x, z) = (0.6 * f64::from(i % 5) - 1.2, 0.7 * f64::from(i / 5) - 1.0);
        let intensity = [0, 1, 2].map(|c| 0.15 + 0.1 * f64::from((i * 7 + c * 5) % 6));
        let kind = match i % 2 {
            0 => "type = \"point\"".to_string(),
            _ => format!("type = \"spot\"\ntarget = [{}, 0, {z}]\nouter_angle = 50", x + 0.3),
        };
        format!("[[lights]]\nposition = [{x}, 2.0, {z}]\nintensity = {intensity:?}\n{kind}\n")
    };
    (0..20).map(lamp).collect()
}

/// The samples of a pixel by each method.
const SAMPLES: [(&str, &str); 3] =
    [("path", "render.samples=96"), ("photon", "render.samples=40"), ("light", "render.samples=192")];
/// Photons are spread over their neighbourhood: by so much, as a share, blocks and means may differ.
const BLUR: [f64; 2] = [0.01, 0.003];

/// Means of the image's quarters, and of all of it.
fn means(image: &Image) -> Vec<[f64; 3]> {
    let (width, height) = (image.width, image.height);
    let mut sums = vec![[0.0; 3]; 5];
    for (at, pixel) in image.pixels.iter().enumerate() {
        let quarter = at / width * 2 / height * 2 + at % width * 2 / width;
        for c in 0..3 {
            sums[quarter][c] += 4.0 * f64::from(pixel[c]) / image.pixels.len() as f64;
            sums[4][c] += f64::from(pixel[c]) / image.pixels.len() as f64;
        }
    }
    sums
}

/// Renders all scenes by all methods with the effort and the photons given, until means are known to `precise`, and says what does
/// not agree.
fn compare(effort: impl Fn(&str) -> Effort, photons: u32, precise: f64, tells: bool) {
    let photons = format!("photons.volume={photons}");
    let mut failed = Vec::new();
    for (name, changes, parts) in SCENES.iter().filter(|(name, ..)| chosen(name)) {
        let scene = parts.iter().map(|part| if *part == MANY { many() } else { part.to_string() });
        let text: String = std::iter::once(PARTS.to_string()).chain(scene).collect();
        let mut line = format!("{name:>40}");
        let found = SAMPLES.map(|(method, samples)| {
            let method = format!("render.method={method}");
            let all: Vec<&str> = changes.iter().copied().chain([samples, &photons, &method]).collect();
            // What is partly a mirror, light paths show in part.
            let warnings = built(&text, &all).0.warnings;
            assert!(!warnings.iter().any(|warning| warning.contains("does not see")), "{name}: {warnings:?}");
            let whole = |image: &Image| means(image)[4];
            let known = |images: &[Image]| Estimate::over(images, whole).is_within(|mean| precise * mean);
            let start = cpu_seconds();
            let images = effort(&format!("{name} {method}")).images(&text, &all, known);
            let spent = cpu_seconds().zip(start).map_or(0.0, |(now, start)| now - start);
            let blocks: Vec<Vec<[f64; 3]>> = images.iter().map(means).collect();
            let estimates: Vec<Estimate> = (0..5).map(|block| Estimate::over(&blocks, |seed| seed[block])).collect();
            let Estimate { mean, standard_error } = estimates[4];
            line += &format!(" | {:.5} ± {:.2} % {spent:5.1} s", mean[1], 100.0 * standard_error[1] / mean[1]);
            estimates
        });
        let [path, others @ ..] = &found;
        for (method, other) in ["photon", "light"].iter().zip(others) {
            let (off, error) = other[4].bias(&path[4])[1];
            line += &format!(" | {method} {:+.2} ± {:.2} %", 100.0 * off, 100.0 * error);
            for block in 0..5 {
                let blur = if *method == "photon" { BLUR[block / 4] } else { 0.0 };
                for (c, (off, error)) in other[block].bias(&path[block]).into_iter().enumerate() {
                    let far = off.abs() > 4.5 * error + blur;
                    if far || (block == 4 && error > 2.0 * precise) {
                        failed.push(format!(
                            "{name}, {method}, block {block}, channel {c}: {:+.2} ± {:.2} %",
                            100.0 * off,
                            100.0 * error
                        ));
                    }
                }
            }
        }
        if tells {
            println!("{line}");
        }
    }
    assert!(failed.is_empty(), "{}", failed.join("\n"));
}

#[test]
fn three_methods_agree_on_a_dozen_scenes() {
    // Most of the noise is that of samples, however few the photons are.
    compare(|_| Effort::once(8), 8000, 0.012, false);
}

/// Media that add up to deep ones, where photons are kept by how deep they are, with the phase function that light is turned by.
#[test]
fn photons_agree_where_media_add_up_to_deep_ones() {
    let wax = "[media.wax]\nsigma_t = 4\nalbedo = 0.8\nadd = true\n[media.dust]\nsigma_t = 0.3\nalbedo = [0.9, 0.6, 0.4]\n\
               phase = { type = \"hg\", g = 0.6 }\nadd = true\n[[shapes]]\ntype = \"sphere\"\ncenter = [0, 0.9, 0]\nradius = 0.8\n\
               interior = \"wax\"\n[[shapes]]\ntype = \"sphere\"\ncenter = [0, 0.9, 0]\nradius = 1\ninterior = \"dust\"\n";
    let text = [PARTS, wax, FLOOR_OF_TILES, LAMP].concat();
    let of = |changes: &[&str]| {
        let images = Effort::once(4).images(&text, changes, |_| true);
        Estimate::over(&images, |image| means(image)[4])
    };
    let path = of(&["render.method=path", "render.samples=1024"]);
    let photon = of(&["render.method=photon", "render.samples=64", "photons.volume=300000"]);
    for (off, error) in photon.bias(&path) {
        assert!(
            error < 0.01 && off.abs() < 0.03 + 4.0 * error,
            "{:+.2} ± {:.2} %: {path:?} {photon:?}",
            100.0 * off,
            100.0 * error
        );
    }
}

/// To be run by hand, alone: a table of means, each known to 0.2 % or as well as the time allows (`VOLPM_SECONDS` a method).
#[test]
#[ignore = "minutes of every scene"]
fn three_methods_agree_to_a_third_of_a_percent() {
    compare(|what| Effort::patient(what, 32), 20_000, 0.002, true);
}
