//! Sound files to damage: small, and of every kind that is read.

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;

use image::codecs::jpeg::JpegEncoder;
use tempfile::TempDir;
use volpm::image::{self as picture, Image, Picture, ToneSettings};
use volpm::render::checkpoint::{self, Subject};
use volpm::render::{Limits, Silent, refine};
use volpm::scene;

use crate::examine::SMALL;

/// A folder with a file of each kind; scenes of [`SCENES`] name them.
pub struct Corpus {
    pub folder: TempDir,
}

/// A lamp that throws a ring.
const IES: &str = "IESNA91\n[TEST] made up\nTILT=NONE\n1 800 1.0 5 3 1 2 -0.1 0 0\n1.0 1.0 9\n0 10 20 45 90\n0 45 90\n\
                   2440 1366 323 14 0\n2440 1300 300 10 0\n2440 1200 200 9 0\n";
/// Two triangles that a square is made of, and a closed tetrahedron.
const OPEN: &str = "# a square\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nvn 0 0 1\n\
                    o square\nf 1/1/1 2/2/1 3/3/1\nf 1/1/1 3/3/1 4/4/1\n";
const CLOSED: &str = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf -4 -1 -2\n";

impl Corpus {
    pub fn new() -> Corpus {
        let corpus = Corpus { folder: tempfile::tempdir().expect("a temporary folder") };
        for (name, from) in [
            ("ball.vdb", "vdb/fog_sphere.vdb"),
            ("half.vdb", "vdb/mask_half_blosc.vdb"),
            ("zip.vdb", "vdb/ramp_float_zip.vdb"),
            ("turned.vdb", "vdb/xf_affine_rotated.vdb"),
            ("two.vdb", "vdb/two_grids.vdb"),
            ("even.npy", "beam/constant.npy"),
        ] {
            fs::copy(Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data").join(from), corpus.path(name))
                .expect(name);
        }
        for (name, text) in [("ring.ies", IES), ("lamp.ldt", &eulumdat()), ("open.obj", OPEN), ("closed.obj", CLOSED)] {
            fs::write(corpus.path(name), text).expect(name);
        }
        corpus.pictures();
        corpus.checkpoint();
        corpus
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn pictures(&self) {
        let image = Image::from_fn(7, 5, |x, y| [x as f32 / 7.0, y as f32 / 5.0, (x * y % 3) as f32 / 3.0]);
        let picture: Picture = image.into();
        for name in ["sky.exr", "sky.hdr", "tile.png", "tile.pfm"] {
            picture::write(self.path(name), &picture, &ToneSettings::default()).expect(name);
        }
        let mut jpeg = Vec::new();
        let pixels: Vec<u8> = (0..16 * 8 * 3).map(|i| (i * 7 % 251) as u8).collect();
        JpegEncoder::new(&mut jpeg).encode(&pixels, 16, 8, image::ExtendedColorType::Rgb8).expect("a JPEG");
        fs::write(self.path("tile.jpg"), jpeg).expect("tile.jpg");
    }

    fn checkpoint(&self) {
        let path = self.path("scene.toml");
        let set: Vec<String> = SMALL.iter().chain(&["render.passes=2"]).map(|text| text.to_string()).collect();
        let description = scene::parse(SCENES[0].1, &path, &set).expect("a scene");
        let (scene, settings) = scene::build(&description).expect("a scene");
        let limits = Limits { resumable: true, ..Limits::default() };
        let made = refine(&scene, &settings, &limits, None, &Silent, &AtomicBool::new(false)).expect("a picture");
        let subject = Subject::new(&description, 1);
        checkpoint::write(self.path("passes"), &subject, &made.film, &made.stats).expect("a checkpoint");
    }
}

/// A lamp in EULUMDAT.
fn eulumdat() -> String {
    let mut lines = vec!["volpm".to_owned(), "1".to_owned(), "4".to_owned()];
    lines.extend(["4", "90", "3", "45"].map(str::to_owned));
    lines.extend((0..18).map(|line| format!("{line}")));
    lines.push("1".to_owned());
    lines.extend((0..16).map(|line| format!("0.{line}")));
    lines.extend(["0", "90", "180", "270", "0", "45", "90", "100", "60", "5", "90", "50", "0"].map(str::to_owned));
    lines.join("\r\n")
}

/// Whether files of a folder can be read as those of [`SCENES`].
pub fn is_scene(path: &Path) -> bool {
    path.extension().is_some_and(|ending| ending == "toml")
}

/// Scenes that together say nearly all that can be said.
pub const SCENES: [(&str, &str); 6] = [
    (
        "fog",
        r#"
[film]
filter = "tent"
[camera]
position = [0, 0.2, 4]
target = [0, 0, 0]
fov = 40
aperture = 0.01
focus_distance = 3.5
[world]
medium = "haze"
unit = "cm"
[media.haze]
sigma_s = [0.05, 0.1, 0.2]
sigma_a = 0.02
unit = "cm"
density = { type = "exponential", origin = [0, -1, 0], scale_height = 2.0, up = [0, 1, 0.1], value = 0.8 }
phase = { type = "mixture", lobes = [{ weight = 0.7, type = "hg", g = 0.8 }, { weight = 0.3, type = "schlick", k = -0.2 }] }
[media.mist]
sigma_t = 4
albedo = 0.9
phase = { type = "mie", diameter = 8 }
density = { type = "noise", scale = 0.7, octaves = 2, threshold = 0.4, seed = 2 }
[materials.white]
type = "lambert"
reflectance = 0.7
[[shapes]]
type = "sphere"
name = "ball"
center = [0.3, 0, 0]
radius = 0.9
interior = "mist"
[[shapes]]
type = "instance"
of = "ball"
transform = [{ scale = [1, 0.5, 0.8] }, { rotate = { axis = [0, 1, 1], angle = 30 } }, { translate = [-1.5, 0, 0.2] }]
[[shapes]]
type = "quad"
origin = [-4, -1.2, 4]
edge_u = [8, 0, 0]
edge_v = [0, 0, -8]
material = "white"
[[lights]]
type = "spot"
position = [-2, 2, 1]
target = [0, 0, 0]
intensity = [10, 20, 30]
inner_angle = 20
outer_angle = 30
radius = 0.1
[render]
max_depth = 12
"#,
    ),
    (
        "glass",
        r#"
[camera]
position = [0, 1, 5]
target = [0, 0.5, 0]
fov = 35
fov_axis = "smaller"
[media.milk]
preset = "wholemilk"
scale = 0.05
phase = { type = "hg", g = 0.5 }
[media.dye]
sigma_a = [0.1, 0.2, 2.0]
add = true
[materials]
water = { type = "dielectric", ior = 1.33 }
frosted = { type = "dielectric", ior = [1.5, 1.51, 1.52], roughness = 0.2 }
floor = { type = "lambert", reflectance = { texture = "checker", scale = 2, a = 0.6, b = [0.1, 0.2, 0.3], space = "object" } }
soap = { type = "thin_dielectric", ior = 1.5 }
[[shapes]]
type = "lathe"
profile = [[0, 0], [0.6, 0], [0.5, 1.2], [0, 1.2]]
segments = 7
crease = 20
material = "water"
interior = "milk"
priority = 1
[[shapes]]
type = "sphere"
center = [0.2, 0.7, 0]
radius = 0.3
interior = "dye"
[[shapes]]
type = "cylinder"
base = [1.2, 0, 0]
top = [1.3, 0.9, 0.2]
radius = 0.3
material = "frosted"
[[shapes]]
type = "disk"
center = [0, -0.01, 0]
normal = [0, 1, 0]
radius = 5
material = "floor"
[[shapes]]
type = "sphere"
center = [-1.2, 0.5, 0]
radius = 0.5
material = "soap"
[[shapes]]
type = "quad"
origin = [-1, 4, -1]
edge_u = [2, 0, 0]
edge_v = [0, 0, 2]
emission = { power = 100.0, side = "both" }
[[lights]]
type = "directional"
direction = [0.2, -1, 0.1]
irradiance = 3
angle = 1
[volume]
kernel = "fixed"
radius = 0.1
[render]
max_depth = 12
"#,
    ),
    (
        "grids",
        r#"
[camera]
position = [0, 0, 5]
target = [0, 0, 0]
projection = "orthographic"
[media.smoke]
sigma_t = [3, 4, 5]
albedo = 0.8
density = { type = "array", file = "even.npy", min = [-1, -0.8, -0.8], max = [1, 0.8, 0.8] }
[media.ball]
sigma_s = 0.4
sigma_a = 0.1
density = { type = "vdb", file = "ball.vdb", transform = [{ scale = 0.1 }], interpolation = "nearest", negative = "zero", precision = "half" }
emission = { radiance = [1.0, 0.4, 0.1], scale = 0.1 }
[materials.white]
type = "oren_nayar"
reflectance = 0.7
sigma = 0.4
[[shapes]]
type = "box"
min = [-1.2, -1, -1]
max = [1.2, 1, 1]
interior = "smoke"
[[shapes]]
type = "sphere"
center = [0, 0, 0]
radius = 2
interior = "ball"
priority = -1
transform = [{ matrix = [1, 0.1, 0, 0.1, 0, 1, 0, 0, 0, 0, 1.2, 0, 0, 0, 0, 1] }]
[[shapes]]
type = "mesh"
file = "open.obj"
smooth = false
material = "white"
transform = [{ scale = 5 }, { translate = [-2.5, -2, -3] }]
[[lights]]
type = "point"
position = [-2, 1, 1]
profile = "ring.ies"
power = 20
temperature = 3000
[volume]
estimate = "point"
kernel = "variable"
neighbours = 20
march = { step = "adaptive", size = 0.2, contrast = 0.1 }
boundaries = "share"
[render]
max_depth = 12
"#,
    ),
    (
        "paints",
        r#"
[camera]
position = [0, 1, 6]
target = [0, 0.5, 0]
[materials.wood]
type = "coated"
ior = 1.5
roughness = 0.1
base = { type = "lambert", reflectance = { texture = "image", file = "tile.png", wrap = "mirror", transform = [{ scale = 3 }] } }
[materials.gold]
type = "conductor"
metal = "Au"
roughness = [0.3, 0.1]
[materials.brass]
type = "conductor"
eta = [0.4, 0.5, 1.2]
k = [3, 2.5, 2]
[materials.lace]
type = "mix"
a = "none"
b = { type = "phong", diffuse = 0.4, specular = 0.3, exponent = 30 }
weight = { texture = "image", file = "tile.jpg", color_space = "linear" }
[materials.lacquer]
type = "schlick"
f0 = 0.4
roughness = 0.2
isotropy = 0.3
layer = { f0 = 0.9, roughness = 0.5, isotropy = 1 }
[materials.hammered]
type = "mirror"
reflectance = { texture = "noise", a = 0.5, b = 0.9, scale = 0.3, octaves = 2, space = "object" }
bump = { texture = "noise", a = 0, b = 1, scale = 0.2, octaves = 1, space = "object" }
strength = 0.05
[[shapes]]
type = "mesh"
file = "closed.obj"
material = "gold"
[[shapes]]
type = "box"
min = [-1.5, 0, -1]
max = [-0.7, 0.8, 0]
material = "wood"
[[shapes]]
type = "sphere"
center = [1.4, 0.5, 0]
radius = 0.5
material = "lacquer"
casts_caustics = false
[[shapes]]
type = "sphere"
center = [2.4, 0.5, 0]
radius = 0.4
material = "brass"
[[shapes]]
type = "sphere"
center = [-2.4, 0.5, 0]
radius = 0.4
material = "hammered"
[[shapes]]
type = "quad"
origin = [-3, 0, 2]
edge_u = [6, 0, 0]
edge_v = [0, 0, -4]
material = "lace"
receives_caustics = true
[[lights]]
type = "environment"
file = "sky.exr"
scale = 2
rotate = 30
[[lights]]
type = "sky"
sun = [1, 1, 0.4]
turbidity = 4
ground = 0.3
scale = 0.01
[surface]
indirect = "final_gather"
gather_rays = 8
estimate = "sheets"
shadow_photons = true
[render]
max_depth = 12
"#,
    ),
    (
        "deep",
        r#"
[camera]
position = [0, 0, 4]
target = [0, 0, 0]
[world]
medium = "air"
[media.air]
sigma_s = 0.02
sigma_a = 0.005
[media.milk]
sigma_s = [20, 30, 40]
sigma_a = [0.02, 0.05, 0.1]
phase = { type = "hg", g = 0.3 }
[media.fire]
sigma_a = 2
sigma_s = 1
density = { type = "vdb", file = "two.vdb", grid = "density", transform = [{ scale = 0.05 }] }
emission = { temperature = "temperature", kelvin_scale = 1.5, scale = 1e-3 }
[materials.skin]
type = "dielectric"
ior = 1.3
roughness = 0.3
[materials.wall]
type = "lambert"
reflectance = 0.5
[[shapes]]
type = "sphere"
center = [0, 0, 0]
radius = 1
material = "skin"
interior = "milk"
[[shapes]]
type = "box"
min = [1, -1, -1]
max = [2, 1, 1]
interior = "fire"
[[shapes]]
type = "box"
min = [-3, -3, -5]
max = [3, 3, 5]
material = "wall"
[[lights]]
type = "point"
position = [2, 2, 2]
intensity = 30
profile = "lamp.ldt"
[volume]
single_scattering = "traced"
march = { step = "exponential", size = 0.1 }
[render]
max_depth = 12
"#,
    ),
    (
        "plain",
        r#"
[camera]
position = [0, 0, 4]
target = [0, 0, 0]
[media.smoke]
sigma_t = 3
albedo = 0.9
phase = { type = "rayleigh" }
[materials.white]
type = "lambert"
reflectance = 0.7
[[shapes]]
type = "sphere"
center = [0, 0, 0]
radius = 1
interior = "smoke"
[[shapes]]
type = "quad"
origin = [-4, -1.2, 4]
edge_u = [8, 0, 0]
edge_v = [0, 0, -8]
material = "white"
[[shapes]]
type = "sphere"
center = [2, 2, 1]
radius = 0.2
emission = { radiance = 40 }
[[lights]]
type = "environment"
radiance = [0.1, 0.2, 0.3]
[volume]
kernel = "variable"
neighbours = 12
max_radius = 0.5
pilot = 5
profile = "epanechnikov"
[surface]
indirect = "map"
neighbours = 10
filter = "gaussian"
max_radius = 0.5
"#,
    ),
];
