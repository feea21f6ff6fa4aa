//! Photons and path tracing find one light on small scenes that between them have every kind of light, medium and boundary;
//! what photons are off by falls as there are more of them.

use volpm::image::Image;

use crate::support::{Checks, Estimate, images};

/// A scene, what path tracing found of it, and what it takes to find that again.
struct Case {
    text: &'static str,
    /// Means over the image by channel and of all channels, with standard errors: by path tracing, once, with seeds of their own
    /// (128 of 100 samples a pixel, of 500 in the room; 384 of the ball of glass, of smoke and cloud, and of what is side by side).
    known: [(f64, f64); 4],
    /// Photons of the smaller of two maps; the larger holds 16 times as many.
    photons: u32,
    /// Seeds of the larger map.
    seeds: u32,
    /// Camera samples a pixel with photons, for each of the seeds.
    samples: u32,
    /// The bias of the larger map, as a share of the mean.
    bias: f64,
}

const FILM: &str = "[film]\nwidth = 12\nheight = 12\nlayers = false\n";

impl Case {
    #[track_caller]
    fn check(&self) {
        let mut checks = Checks::default();
        let text = format!("{FILM}{}", self.text);
        let path = images(16, &text, &["render.method=path", "render.samples=100"]);
        let photons = |count: u32, seeds: u32| {
            let (count, samples) = (format!("photons.volume={count}"), format!("render.samples={}", self.samples));
            // Those on surfaces bring little of the noise.
            images(seeds, &text, &["render.method=photon", &samples, &count, "photons.global=20_000"])
        };
        let few = photons(self.photons, 8);
        let many = photons(16 * self.photons, self.seeds);
        // All channels together; each alone is noisier.
        let grey = |images: &[Image]| Estimate::over(images, |image| [image.mean(); 3]);
        let colour = |images: &[Image]| Estimate::over(images, Image::channel_means);
        let known = |channels: [usize; 3]| Estimate {
            mean: channels.map(|c| self.known[c].0),
            standard_error: channels.map(|c| self.known[c].1),
        };
        let (known_grey, known_colour) = (known([3; 3]), known([0, 1, 2]));
        for (what, images, bias) in [("paths", &path, 0.0), ("many photons", &many, self.bias)] {
            checks.agree(what, &grey(images), &known_grey, 0.0135, bias);
            checks.agree(&format!("{what}, colour"), &colour(images), &known_colour, 0.02, bias);
        }

        // Radii are 16^(−1/3) = 0.4 times as wide, and bias is at least of first order in them.
        let ((before, noise), (after, left)) = (grey(&few).bias(&known_grey)[0], grey(&many).bias(&known_grey)[0]);
        let holds = before.abs() < 4.0 * noise || after.abs() <= 0.5 * before.abs() + 3.0 * left;
        checks.holds(
            format!(
                "bias {:+.3} ± {:.3} %, then {:+.3} ± {:.3} %",
                100.0 * before,
                100.0 * noise,
                100.0 * after,
                100.0 * left
            ),
            holds,
        );
        checks.finish();
    }
}

/// Ball, backward, coloured 1 : 20, point light.
#[test]
fn backward_ball() {
    Case {
        text: r#"
[camera]
position = [0, 0.5, 4]
target = [0, 0, 0]
fov = 22
[media.fog]
sigma_t = [0.2, 1, 4]
albedo = [0.9, 0.8, 0.95]
phase = { type = "hg", g = -0.5 }
[[shapes]]
type = "sphere"
center = [0, 0, 0]
radius = 1
interior = "fog"
[[lights]]
type = "point"
position = [1.5, 1.5, 1]
intensity = [3, 2, 1]
"#,
        known: [(0.011_188, 1.1e-5), (0.016_319, 1.5e-5), (0.014_128, 2.6e-5), (0.013_878, 1.2e-5)],
        photons: 20_000,
        seeds: 4,
        samples: 4,
        bias: 0.01,
    }
    .check();
}

/// Camera inside, walls, forward, spot with a size.
#[test]
fn room_with_a_spot() {
    Case {
        text: r#"
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
[[lights]]
type = "spot"
position = [1.2, 1.9, 1.3]
target = [-0.5, 0.3, -1]
intensity = 10
inner_angle = 40
outer_angle = 60
radius = 0.3
"#,
        known: [(0.106_995, 7.4e-5), (0.114_030, 1.3e-4), (0.133_994, 2.8e-4), (0.118_339, 1.5e-4)],
        photons: 15_000,
        seeds: 14,
        samples: 20,
        bias: 0.01,
    }
    .check();
}

/// Voxels, forward, sun with an angle.
#[test]
fn voxels_in_the_sun() {
    Case {
        text: r#"
[camera]
position = [0.3, 0.4, 3.5]
target = [0, -0.1, 0]
fov = 20
[media.smoke]
sigma_t = [4, 6, 8]
albedo = 0.9
density = { type = "vdb", file = "reference/smoke_grid/smoke_grid_64.vdb", grid = "density" }
phase = { type = "hg", g = 0.5 }
[[shapes]]
type = "box"
min = [-1, -1, -1]
max = [1, 1, 1]
interior = "smoke"
[[lights]]
type = "directional"
direction = [-1, -2, -0.5]
irradiance = 3
angle = 8
"#,
        known: [(0.026_972, 2.9e-5), (0.034_302, 4.0e-5), (0.039_242, 5.9e-5), (0.033_505, 3.8e-5)],
        photons: 10_000,
        seeds: 4,
        samples: 4,
        bias: 0.01,
    }
    .check();
}

/// Voxels of a ball, Schlick, environment image.
#[test]
fn voxels_under_a_window() {
    Case {
        text: r#"
[camera]
position = [4, 3, 7]
target = [4, 3, 3]
fov = 25
[media.fog]
sigma_t = 4
albedo = [0.99, 0.9, 0.7]
density = { type = "vdb", file = "vdb/fog_sphere.vdb", grid = "density" }
phase = { type = "schlick", k = 0.6 }
[[shapes]]
type = "box"
min = [2.5, 1.5, 1.5]
max = [5.5, 4.5, 4.5]
interior = "fog"
[[lights]]
type = "environment"
file = "beam/window.hdr"
rotate = 40
"#,
        known: [(0.600_035, 4.5e-4), (0.493_331, 2.7e-4), (0.381_018, 1.3e-4), (0.491_461, 2.6e-4)],
        photons: 20_000,
        seeds: 4,
        samples: 4,
        bias: 0.01,
    }
    .check();
}

/// Side by side, 100 and 20 per unit, even sky.
#[test]
fn side_by_side() {
    Case {
        text: r#"
[camera]
position = [0, 0, 1]
target = [0, 0, 0]
fov = 8
[media.milk]
sigma_t = 100
albedo = [0.99, 0.9, 0.5]
[media.tea]
sigma_t = [20, 30, 60]
albedo = 0.6
phase = { type = "hg", g = 0.9 }
[[shapes]]
type = "box"
min = [-0.1, -0.05, -0.05]
max = [0, 0.05, 0.05]
interior = "milk"
[[shapes]]
type = "box"
min = [0, -0.05, -0.05]
max = [0.1, 0.05, 0.05]
interior = "tea"
[[lights]]
type = "environment"
radiance = [1, 0.9, 0.7]
"#,
        known: [(0.752_122, 1.4e-4), (0.514_198, 6.0e-5), (0.249_064, 2.0e-5), (0.505_128, 6.3e-5)],
        photons: 20_000,
        seeds: 4,
        samples: 4,
        bias: 0.015,
    }
    .check();
}

/// Nested, camera in the outer one of 0.01 per unit, round beam.
#[test]
fn nested() {
    Case {
        text: r#"
[camera]
position = [0, 2, 18]
target = [0, 0, 0]
fov = 25
[media.haze]
sigma_s = [0.008, 0.01, 0.02]
sigma_a = 0.002
[media.cloud]
sigma_t = 0.8
albedo = 0.95
phase = { type = "rayleigh" }
[[shapes]]
type = "box"
min = [-20, -10, -20]
max = [20, 10, 20]
interior = "haze"
[[shapes]]
type = "sphere"
center = [0, 0, 0]
radius = 2
interior = "cloud"
[[lights]]
type = "directional"
direction = [1, -0.3, 0]
irradiance = 10
center = [-10, 3, 0]
radius = 2.5
"#,
        known: [(0.091_938, 9.0e-5), (0.090_438, 8.9e-5), (0.082_904, 9.0e-5), (0.088_427, 8.8e-5)],
        photons: 20_000,
        seeds: 8,
        samples: 4,
        bias: 0.01,
    }
    .check();
}

/// Glass ball in fog, light through it from a sphere.
#[test]
fn light_through_glass() {
    Case {
        text: r#"
[camera]
position = [0, -0.3, 5]
target = [0, -0.3, 0]
fov = 20
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
[[shapes]]
type = "sphere"
center = [0, 3.5, 0]
radius = 0.6
emission = { radiance = 10 }
"#,
        known: [(0.037_169, 7.1e-5), (0.037_169, 7.1e-5), (0.037_169, 7.1e-5), (0.037_169, 7.1e-5)],
        photons: 20_000,
        seeds: 4,
        samples: 4,
        bias: 0.01,
    }
    .check();
}

/// Glowing fog around a lamp, directional light without end.
#[test]
fn glowing_fog() {
    Case {
        text: r#"
[camera]
position = [0, -0.4, 5]
target = [0, -0.4, 0]
fov = 12
[media.fog]
sigma_t = 1.2
albedo = [0.9, 0.6, 0.3]
emission = { radiance = [0.1, 0.2, 0.4] }
phase = { type = "mixture", lobes = [{ weight = 0.7, type = "hg", g = 0.6 }, { weight = 0.3, type = "isotropic" }] }
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
emission = { radiance = 10, side = "both" }
[[lights]]
type = "directional"
direction = [0, -1, 0.3]
irradiance = 2
"#,
        known: [(0.166_657, 2.8e-4), (0.172_466, 9.2e-5), (0.328_840, 2.7e-5), (0.222_655, 1.3e-4)],
        photons: 20_000,
        seeds: 5,
        samples: 4,
        bias: 0.009,
    }
    .check();
}

/// A room of fog, cut in two by a sheet without thickness: light on one side, none on the other. The eye stands in the
/// dark or in the light, and looks at the sheet or along it.
#[test]
fn no_light_leaks_through_a_sheet() {
    let mut checks = Checks::default();
    let mean = |side: f64, along: bool| {
        let target = if along { [0.02 * side, 1.0, 0.0] } else { [0.0, 0.0, 0.3] };
        let position = if along { [0.02 * side, -0.95, 0.0] } else { [0.9 * side, 0.0, 0.0] };
        let text = format!(
            "{FILM}[camera]\nposition = {position:?}\ntarget = {target:?}\nup = [0, 0, 1]\nfov = 40\n\
             [world]\nmedium = \"fog\"\n[media.fog]\nsigma_t = 1\nalbedo = 0.9\n\
             [materials.black]\ntype = \"lambert\"\nreflectance = 0\n\
             [[shapes]]\ntype = \"box\"\nmin = [-1, -1, -1]\nmax = [1, 1, 1]\nmaterial = \"black\"\n\
             [[shapes]]\ntype = \"quad\"\norigin = [0, -1.1, -1.1]\nedge_u = [0, 2.2, 0]\nedge_v = [0, 0, 2.2]\nmaterial = \"black\"\n\
             [[lights]]\ntype = \"point\"\nposition = [0.5, 0.2, 0.1]\nintensity = 1\n[photons]\nvolume = 20_000\n"
        );
        Estimate::of(4, &text, &["render.method=photon", "render.samples=16"]).mean[0]
    };
    for along in [false, true] {
        let (dark, light) = (mean(-1.0, along), mean(1.0, along));
        let leak = dark / light;
        checks.holds(
            format!("along the sheet {along}: {dark} of {light} leaks, {:.4} %", 100.0 * leak),
            light > 0.01 && leak < 1e-3,
        );
    }
    checks.finish();
}

/// Photons whose light comes from elsewhere do not stand for one another where light is scattered by that: density control leaves such media alone.
#[test]
fn density_control_mixes_no_directions() {
    let lit = |z: i32, radiance: &str| {
        format!(
            "[[shapes]]\ntype = \"sphere\"\ncenter = [0, 0, {z}]\nradius = 0.3\nemission = {{ radiance = {radiance} }}\n"
        )
    };
    let text = format!(
        "[film]\nwidth = 16\nheight = 12\n[camera]\nposition = [0, 0, 6]\ntarget = [0, 0, 0]\n[photons]\nvolume = 20000\n\
         [media.fog]\nsigma_s = 0.5\nphase = {{ type = \"hg\", g = 0.7 }}\n\
         [[shapes]]\ntype = \"box\"\nmin = [-1, -1, -1]\nmax = [1, 1, 1]\ninterior = \"fog\"\n{}{}",
        lit(-4, "[40, 8, 2]"),
        lit(9, "[2, 8, 40]")
    );
    let [with, without] = [true, false].map(|control| {
        Estimate::of(4, &text, &["render.method=photon", &format!("photons.density_control={control}")])
    });
    for (difference, _) in with.bias(&without) {
        assert!(difference.abs() < 0.01, "{with:?} and {without:?}");
    }
}
