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

#[test]
fn all_methods_agree_among_all_materials() {
    let mut checks = Checks::default();
    let path = images(16, ROOM, &["render.method=path", "render.samples=60"]);
    let photon = images(16, ROOM, &["render.method=photon", "render.samples=40", "photons.volume=60_000"]);
    let grey = |images: &[Image]| Estimate::over(images, |image| [image.mean(); 3]);
    checks.agree("room", &grey(&photon), &grey(&path), 0.006, 0.005);

    // What is seen through a pane, connections to the camera do not find.
    let text = ROOM.replace("material = \"pane\"", "material = \"worn\"");
    let path = images(16, &text, &["render.method=path", "render.samples=60"]);
    let light = images(16, &text, &["render.method=light", "render.samples=150"]);
    checks.agree("room, by light", &grey(&light), &grey(&path), 0.006, 0.0);
    checks.finish();
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
    let path = Estimate::of(16, text, &["render.method=path", "render.samples=1600"]);
    let photon = Estimate::of(16, text, &["render.method=photon", "render.samples=60", "photons.volume=30_000"]);
    checks.agree("ball", &photon, &path, 0.01, 0.005);
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
