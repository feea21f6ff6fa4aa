//! Materials and textures in pictures: both methods see the same, and textures lie where they should.

use volpm::image::{self, Image, LayerData};

use crate::support::{Checks, Estimate, images, render};

/// Glossy, coated, mixed, bent and textured surfaces around fog and a lamp, all of which light the fog.
const ROOM: &str = r#"
[film]
width = 12
height = 12
layers = false
[camera]
position = [0.2, 1.1, 3.4]
target = [0, 0.9, 0]
fov = 50
[media.fog]
sigma_s = [0.5, 0.7, 0.9]
sigma_a = 0.05
phase = { type = "hg", g = 0.4 }
[materials.wall]
type = "phong"
diffuse = { texture = "checker", scale = 3, a = [0.6, 0.3, 0.2], b = [0.1, 0.3, 0.5] }
specular = 0.3
exponent = 20
[materials.floor]
type = "coated"
roughness = { texture = "noise", scale = 0.2, octaves = 2, a = 0.05, b = 0.5 }
base = { type = "lambert", reflectance = { texture = "checker", scale = 2, space = "object", a = 0.8, b = 0.2 } }
normal_map = { texture = "noise", scale = 0.3, octaves = 2, a = [0.4, 0.45, 0.9], b = [0.6, 0.55, 1.0] }
[materials.copper]
type = "conductor"
metal = "Cu"
roughness = [0.4, 0.15]
[materials.worn]
type = "mix"
a = "copper"
b = { type = "oren_nayar", reflectance = [0.2, 0.5, 0.4], sigma = 0.5 }
weight = { texture = "noise", scale = 0.3, octaves = 3, threshold = 0.3, space = "object", a = 0, b = 1 }
bump = { texture = "noise", scale = 0.2, octaves = 1, space = "object", a = 0, b = 1 }
strength = 0.05
[materials.pane]
type = "thin_dielectric"
[materials.painted]
type = "schlick"
f0 = [0.9, 0.5, 0.4]
roughness = { texture = "checker", scale = 4, a = 0.2, b = 0.7 }
[[shapes]]
type = "box"
min = [-2, 0, -2]
max = [2, 2.2, 4]
material = "wall"
[[shapes]]
type = "quad"
origin = [-2, 0.01, 4]
edge_u = [4, 0, 0]
edge_v = [0, 0, -6]
material = "floor"
[[shapes]]
type = "sphere"
center = [-0.8, 0.55, 0.4]
radius = 0.5
material = "worn"
[[shapes]]
type = "cylinder"
base = [0.9, 0.05, -0.6]
top = [0.9, 1.1, -0.6]
radius = 0.4
material = "painted"
[[shapes]]
type = "quad"
origin = [-1.5, 0.3, -0.9]
edge_u = [1.2, 0, 0.3]
edge_v = [0, 1.2, 0]
material = "pane"
[[shapes]]
type = "box"
min = [-0.6, 0.4, -1.2]
max = [1.9, 1.9, 1.5]
interior = "fog"
priority = 2
[[shapes]]
type = "sphere"
center = [-0.9, 1.7, 0.9]
radius = 0.2
emission = { radiance = [12, 10, 8] }
"#;

/// By photons, against what path tracing found once with a standard error (32 seeds of 240 samples); light paths are held to such a
/// room in `three_methods`.
#[test]
fn photons_light_a_room_of_all_materials() {
    let mut checks = Checks::default();
    let photons = ["photons.volume=60_000", "photons.global=30_000", "photons.caustic=20_000"];
    let photon = images(11, ROOM, &[&["render.method=photon", "render.samples=40"], &photons[..]].concat());
    let found = Estimate::over(&photon, |image| [image.mean(); 3]);
    let path = Estimate { mean: [0.328_859; 3], standard_error: [2.5e-4; 3] };
    checks.agree("room", &found, &path, 0.006, 0.005);
    checks.finish();
}

/// A lamp behind lace, leaves cut out of a quad, and a veil of two layers around a ball of fog, in haze.
const VEILS: &str = r#"
[film]
width = 12
height = 9
layers = false
[camera]
position = [0, 1.3, 5]
target = [0, 0.9, 0]
fov = 36
[media.haze]
sigma_s = 0.12
[media.fog]
sigma_s = [0.6, 1.2, 2.0]
[materials.floor]
type = "lambert"
reflectance = 0.5
[materials.glaze]
type = "coated"
base = { type = "lambert", reflectance = [0.7, 0.2, 0.1] }
roughness = 0.4
[materials.lace]
type = "mix"
a = "none"
b = { type = "mix", a = "glaze", b = { type = "conductor", metal = "Cu", roughness = 0.4 }, weight = 0.3 }
weight = { texture = "checker", scale = 6, a = 0, b = 1 }
[materials.leaf]
type = "mix"
a = { type = "lambert", reflectance = [0.2, 0.5, 0.1], bump = { texture = "noise", scale = 0.1, a = 0, b = 1 }, strength = 0.02 }
b = "none"
weight = { texture = "noise", scale = 0.3, octaves = 2, threshold = 0.4, a = 0, b = 1 }
[materials.veil]
type = "mix"
a = { type = "schlick", f0 = 0.2, roughness = 0.6, layer = { f0 = [0.8, 0.7, 0.3], roughness = 0.8 } }
b = "none"
weight = 0.6
[[shapes]]
type = "box"
min = [-3, 0, -3]
max = [3, 3, 6]
material = "floor"
[[shapes]]
type = "box"
min = [-2.9, 0.1, -2.9]
max = [2.9, 2.9, 4]
interior = "haze"
[[shapes]]
type = "quad"
origin = [-1.6, 0.2, -0.4]
edge_u = [1.3, 0, 0.3]
edge_v = [0, 1.4, 0]
material = "lace"
[[shapes]]
type = "quad"
origin = [-0.4, 0.9, 0.6]
edge_u = [0.9, 0, 0]
edge_v = [0, 0.5, 0.4]
material = "leaf"
[[shapes]]
type = "sphere"
center = [1.0, 0.8, 0]
radius = 0.6
material = "veil"
interior = "fog"
priority = 1
[[shapes]]
type = "sphere"
center = [-0.7, 1.4, -1.4]
radius = 0.3
emission = { radiance = 20 }
"#;

#[test]
fn all_methods_agree_behind_masks() {
    let mut checks = Checks::default();
    let grey = |images: &[Image]| Estimate::over(images, |image| [image.mean(); 3]);
    // Path tracing found this once (48 seeds of 250 samples).
    let path = Estimate { mean: [0.216_347; 3], standard_error: [5.1e-4; 3] };
    let photons = ["photons.volume=60_000", "photons.global=20_000", "photons.caustic=20_000"];
    let photon = images(8, VEILS, &[&["render.method=photon", "render.samples=100"], &photons[..]].concat());
    let light = images(16, VEILS, &["render.method=light", "render.samples=120"]);
    checks.agree("veils", &grey(&photon), &path, 0.008, 0.004);
    checks.agree("veils, by light", &grey(&light), &path, 0.008, 0.0);
    checks.finish();
}

/// A mask with all of one part is that part, bit for bit.
#[test]
fn masks_of_all_or_nothing_are_what_they_are_made_of() {
    let image = |material: &str| {
        let text = VEILS.replace("material = \"lace\"", &format!("material = \"{material}\""));
        let masks = "[materials.all]\ntype = \"mix\"\na = \"none\"\nb = \"glaze\"\nweight = 1\n\
                     [materials.nothing]\ntype = \"mix\"\na = \"none\"\nb = \"glaze\"\nweight = 0\n";
        images(1, &format!("{masks}{text}"), &["render.method=path", "render.samples=4"]).remove(0).pixels
    };
    assert!(image("all") == image("glaze"));
    assert!(image("nothing") == image("none"));
    assert!(image("all") != image("nothing"));
}

/// Of light through a hundred masks, the share passes that passes each, to the power of their number: of what is seen by chance, and
/// of what is asked for exactly. Masks that mirror send light to and fro between them, and it comes to an end.
#[test]
fn many_masks_pass_the_product() {
    const MASKS: i32 = 100;
    let scene = |masks: i32| {
        let mut text = "[film]\nwidth = 4\nheight = 4\nlayers = false\n\
             [camera]\nposition = [0, 0, 5]\ntarget = [0, 0, 0]\nfov = 10\n\
             [materials.white]\ntype = \"lambert\"\n\
             [materials.mask]\ntype = \"mix\"\na = \"none\"\nb = { type = \"mirror\", reflectance = 0 }\nweight = 0.02\n\
             [materials.sieve]\ntype = \"mix\"\na = \"none\"\nb = \"mirror\"\n\
             [materials.mirror]\ntype = \"mirror\"\n"
            .to_string();
        for i in 0..masks {
            let z = 1.0 + f64::from(i) / f64::from(MASKS);
            text += &format!(
                "[[shapes]]\ntype = \"disk\"\ncenter = [0, 0, {z}]\nnormal = [0, 0, 1]\nradius = 30\nmaterial = \"mask\"\n"
            );
        }
        text
    };
    let seen = "[[shapes]]\ntype = \"disk\"\ncenter = [0, 0, 0]\nnormal = [0, 0, 1]\nradius = 9\nemission = { radiance = 1 }\n";
    let found = Estimate::of(8, &(scene(MASKS) + seen), &["render.method=path", "render.samples=300"]);
    let expected = 0.98f64.powi(MASKS);
    assert!((found.mean[0] - expected).abs() < 4.0 * found.standard_error[0], "{found:?}, not {expected}");
    assert!(found.standard_error[0] < 0.02 * expected, "{found:?}");

    // Lit from behind the camera's back, which sees the floor before all masks.
    let lit = "[[shapes]]\ntype = \"disk\"\ncenter = [0, 0, 3]\nnormal = [0, 0, 1]\nradius = 9\nmaterial = \"white\"\n\
               [[lights]]\ntype = \"point\"\nposition = [0, 0, -1]\nintensity = 1\n";
    let camera = ["camera.position=[0, 0, 2.5]", "camera.target=[0, 0, 9]"];
    let image = |masks| {
        let settings = ["render.method=path", "render.max_depth=1", camera[0], camera[1]];
        images(1, &(scene(masks) + lit), &settings).remove(0).mean()
    };
    let passed = image(MASKS) / image(0);
    assert!((passed / expected - 1.0).abs() < 1e-5, "{passed}, not {expected}");

    let between = "[[shapes]]\ntype = \"box\"\nmin = [-1, -1, -1]\nmax = [1, 1, 1]\nmaterial = \"sieve\"\n\
                   [[shapes]]\ntype = \"disk\"\ncenter = [0, 0, -4]\nnormal = [0, 0, 1]\nradius = 90\nmaterial = \"white\"\n\
                   [[lights]]\ntype = \"environment\"\nradiance = 1\n";
    let furnace = images(
        4,
        &(scene(0) + between),
        &["render.method=path", "render.samples=100", "materials.white.reflectance=1"],
    );
    let furnace = Estimate::over(&furnace, |image| image.channel_means());
    assert!((furnace.mean[0] - 1.0).abs() < 4.0 * furnace.standard_error[0] + 1e-6, "{furnace:?}");
}

/// A coat over a mixture is the mixture of its parts under that coat, to the bit: with holes in it, textures of both, and a mixture inside.
#[test]
fn a_coat_covers_each_part_of_a_mixture() {
    let coat = "ior = 1.7\nroughness = { texture = \"checker\", a = 0.05, b = 0.4, scale = 3, space = \"object\" }\n";
    let (over, inner, parts) = (
        format!("[materials.top]\ntype = \"coated\"\nbase = \"wood\"\n{coat}"),
        ["\"gold\"", "{ type = \"mirror\", reflectance = 0.8 }"],
        |base: &str, name: &str| format!("[materials.{name}]\ntype = \"coated\"\nbase = {base}\n{coat}"),
    );
    let mix = |name: &str, a: &str, b: &str, weight: &str| {
        format!("[materials.{name}]\ntype = \"mix\"\na = {a}\nb = {b}\nweight = {weight}\n")
    };
    let checker = "{ texture = \"checker\", a = 0, b = 0.8, scale = 4, space = \"object\" }";
    let coated = over + &mix("wood", "\"none\"", "\"inlay\"", checker) + &mix("inlay", inner[0], inner[1], "0.3");
    let mixed = mix("top", "\"none\"", "\"inlay\"", checker)
        + &mix("inlay", "\"first\"", "\"second\"", "0.3")
        + &parts(inner[0], "first")
        + &parts(inner[1], "second");
    let of = |materials: &str| {
        let text = format!(
            "[film]\nwidth = 12\nheight = 12\n[camera]\nposition = [0, 1, 4]\ntarget = [0, 0.3, 0]\nfov = 40\n\
             [materials.gold]\ntype = \"conductor\"\nmetal = \"Au\"\nroughness = 0.2\n{materials}\
             [[shapes]]\ntype = \"sphere\"\ncenter = [0, 0.3, 0]\nradius = 0.7\nmaterial = \"top\"\n\
             [[lights]]\ntype = \"environment\"\nradiance = [0.3, 0.2, 0.1]\n\
             [[lights]]\ntype = \"point\"\nposition = [2, 3, 2]\npower = 60\n"
        );
        images(1, &text, &["render.samples=4", "photons.caustic=2_000", "photons.global=2_000"]).remove(0).pixels
    };
    let (coated, mixed) = (of(&coated), of(&mixed));
    assert!(coated == mixed && coated.iter().flatten().any(|value| *value > 0.0));
}

/// A ball of fog in the light that a polished floor mirrors: photons that are aimed at the ball from the floor's diffuse base leave
/// that light to others.
#[test]
fn polish_lights_fog() {
    let mut checks = Checks::default();
    let text = "[film]\nwidth = 8\nheight = 8\nlayers = false\n\
                [camera]\nposition = [0, 1, 6]\ntarget = [0, 1, 0]\nfov = 9\n\
                [media.fog]\nsigma_s = 2\n\
                [materials.floor]\ntype = \"coated\"\nior = 4\nbase = { type = \"lambert\", reflectance = 0.1 }\n\
                [[shapes]]\ntype = \"disk\"\ncenter = [0, 0, 0]\nnormal = [0, 1, 0]\nradius = 20\nmaterial = \"floor\"\n\
                [[shapes]]\ntype = \"sphere\"\ncenter = [0, 1, 0]\nradius = 0.4\ninterior = \"fog\"\n\
                [[shapes]]\ntype = \"disk\"\ncenter = [2.5, 1.5, 0]\nnormal = [0, -1, 0]\nradius = 0.8\nemission = { radiance = 5 }\n";
    // Path tracing found this once (128 seeds of 1600 samples).
    let known = Estimate { mean: [0.015_508; 3], standard_error: [2.6e-5; 3] };
    let path = Estimate::of(16, text, &["render.method=path", "render.samples=400"]);
    checks.agree("paths", &path, &known, 0.01, 0.0);
    let photon = Estimate::of(24, text, &["render.method=photon", "render.samples=60", "photons.volume=30_000"]);
    checks.agree("photons", &photon, &known, 0.01, 0.005);
    checks.finish();
}

/// The albedo of pixels is what the texture says, the image's lower left corner at the quad's origin, row 0 on top; integers go by the curve of sRGB unless they are said to be linear.
#[test]
fn textures_lie_where_they_should() {
    let folder = tempfile::tempdir().unwrap();
    let bytes = [[255u8, 0, 0], [0, 188, 0], [0, 0, 99], [99, 99, 99]];
    let file = folder.path().join("four.png");
    image::write_pixels(&file, &bytes, 2).unwrap();
    let linear = |byte: u8| {
        let share = f64::from(byte) / 255.0;
        if share <= 0.04045 { share / 12.92 } else { ((share + 0.055) / 1.055).powf(2.4) }
    };
    for (color_space, value) in [("srgb", &linear as &dyn Fn(u8) -> f64), ("linear", &|byte| f64::from(byte) / 255.0)] {
        let text = format!(
            "[film]\nwidth = 4\nheight = 4\nfilter = \"box\"\n\
             [camera]\nposition = [0, 0, 5]\ntarget = [0, 0, 0]\nfov = 22.6198649480404\n\
             [render]\nmethod = \"path\"\nsamples = 16\n\
             [materials.picture]\ntype = \"lambert\"\n\
             reflectance = {{ texture = \"image\", file = {file:?}, wrap = \"clamp\", color_space = \"{color_space}\" }}\n\
             [[shapes]]\ntype = \"quad\"\norigin = [-1, -1, 0]\nedge_u = [2, 0, 0]\nedge_v = [0, 2, 0]\nmaterial = \"picture\"\n\
             [[lights]]\ntype = \"environment\"\nradiance = 1\n"
        );
        let albedo = albedo(&text);
        // The outer pixels' middles are the middles of texels, or beyond.
        for (corner, (x, y)) in bytes.iter().zip([(0, 0), (3, 0), (0, 3), (3, 3)]) {
            let [found, expected] = [albedo[4 * y + x].map(f64::from), corner.map(value)];
            let off = found.iter().zip(expected).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            assert!(off < 1e-4, "{color_space} at {x} {y}: {found:?}, not {expected:?}");
        }
    }
}

fn albedo(text: &str) -> Vec<[f32; 3]> {
    let layers = render(text, &[]).film.layers();
    let albedo = layers.into_iter().find_map(|layer| match layer.channels {
        LayerData::Rgb(pixels) if layer.name == "albedo" => Some(pixels),
        _ => None,
    });
    albedo.expect("a layer of albedo")
}

/// Stripes too fine for a pixel are seen in their mean colour at one ray a pixel, and as stripes where pixels are finer than they.
#[test]
fn fine_textures_are_even_from_afar() {
    const STRIPES: usize = 128;
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("stripes.png");
    let bytes: Vec<[u8; 3]> = (0..STRIPES * STRIPES).map(|i| [if i % 2 == 0 { 0 } else { 255 }; 3]).collect();
    image::write_pixels(&file, &bytes, STRIPES).unwrap();
    let seen = |pixels: usize, distance: f64| {
        albedo(&format!(
            "[film]\nwidth = {pixels}\nheight = {pixels}\n[camera]\nposition = [0, 0, {distance}]\ntarget = [0, 0, 0]\nfov = 20\n\
             [render]\nmethod = \"path\"\nsamples = 1\n\
             [materials.picture]\ntype = \"lambert\"\nreflectance = {{ texture = \"image\", file = {file:?} }}\n\
             [[shapes]]\ntype = \"quad\"\norigin = [-1, -1, 0]\nedge_u = [2, 0, 0]\nedge_v = [0, 2, 0]\nmaterial = \"picture\"\n\
             [[lights]]\ntype = \"environment\"\nradiance = 1\n"
        ))
    };
    let far = seen(12, 5.0);
    assert!(far.iter().flatten().all(|share| (share - 0.5).abs() < 1e-3), "{far:?}");
    let near = seen(12, 0.05);
    let (least, most) = near.iter().flatten().fold((1f32, 0f32), |(a, b), share| (a.min(*share), b.max(*share)));
    assert!(least < 0.3 && most > 0.7, "from {least} to {most}");
}
