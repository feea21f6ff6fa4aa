//! Kinds of media that need a scene around them: glows that light their surroundings, noise, droplets; and a grid that
//! holds one number.

use std::f64::consts::PI;

use volpm::math::random::{Purpose, Stream};
use volpm::math::{Bounds, DVec3, Ray, Rgb};

use crate::point_queries::{block, grey};
use crate::support::{Checks, Estimate, images, scene};

const FILM: &str = "[film]\nwidth = 12\nheight = 12\nlayers = false\n";

/// The fire of `scenes/fire.toml` over a floor, without a medium's coefficients.
const FIRE: &str = r#"
[world]
medium = "fire"
[media.fire]
density = { type = "vdb", file = "../../media/fire.vdb", grid = "density" }
emission = { temperature = "temperature", scale = 0.01 }
phase = { type = "hg", g = 0.3 }
[materials.stone]
type = "lambert"
reflectance = 0.5
[[shapes]]
type = "disk"
center = [0, -0.2, 0]
normal = [0, 1, 0]
radius = 20.0
material = "stone"
"#;

/// Light of an even, thin ball arrives as if from its centre: the inverse square is Newton's.
#[test]
fn a_thin_glow_lights_a_floor_as_from_its_centre() {
    let mut checks = Checks::default();
    let (radius, height, sigma_a, radiance, reflectance) = (1.0f64, 1.5f64, 1e-5, 2e4, 0.6);
    let expected = reflectance / PI * sigma_a * radiance * 4.0 / 3.0 * PI * radius.powi(3) / (height * height);
    for (method, scatters) in [("path", 0.0), ("photon", 0.0), ("path", 1e-6), ("photon", 1e-6)] {
        let text = format!(
            "{FILM}[camera]\nposition = [4, 3, 0]\ntarget = [0, 0, 0]\nfov = 0.1\n\
             [media.ball]\nsigma_a = {sigma_a}\nsigma_s = {scatters}\nemission = {{ radiance = {radiance} }}\n\
             [materials.floor]\ntype = \"lambert\"\nreflectance = {reflectance}\n\
             [[shapes]]\ntype = \"disk\"\ncenter = [0, 0, 0]\nnormal = [0, 1, 0]\nradius = 10\nmaterial = \"floor\"\n\
             [[shapes]]\ntype = \"sphere\"\ncenter = [0, {height}, 0]\nradius = {radius}\ninterior = \"ball\"\n\
             [render]\nmethod = \"{method}\"\n"
        );
        let found = Estimate::of(8, &text, &["render.samples=64", "photons.volume=1000"]);
        // Of its own light the ball keeps a few σ_a R.
        checks.agree(&format!("{method}, σ_s {scatters}"), &found, &Estimate::exact([expected; 3]), 0.003, 3e-5);
    }
    checks.finish();
}

/// What reaches a point of the floor from every voxel, summed up without a renderer.
#[test]
fn flames_light_the_floor() {
    let mut checks = Checks::default();
    let coefficients = "sigma_a = [1, 2, 3]";
    let camera = "[camera]\nposition = [2, 1, 1]\ntarget = [0.9, -0.2, 0.4]\nfov = 0.05\n";
    let text = format!("{FILM}{camera}{}", FIRE.replace("[media.fire]", &format!("[media.fire]\n{coefficients}")));
    let scene = scene(&text, &[]);
    let medium = &scene.media[0];
    let floor = DVec3::new(0.9, -0.2, 0.4) - scene.center;
    let Bounds { min, max } = medium.density.support();
    // One point in each cell of a fine grid; counted as if drawn anywhere, which overstates the error.
    const CELLS: [u64; 3] = [125, 175, 125];
    const POINTS: u64 = CELLS[0] * CELLS[1] * CELLS[2];
    let contribution = |index: u64| {
        let mut stream = Stream::new(1, Purpose::Test, index, 0);
        let cell = [index % CELLS[0], index / CELLS[0] % CELLS[1], index / (CELLS[0] * CELLS[1])];
        let place = std::array::from_fn(|axis| (cell[axis] as f64 + stream.uniform()) / CELLS[axis] as f64);
        let p = min + DVec3::from_array(place) * (max - min);
        let (distance, density) = (p.distance(floor), medium.density.at(p));
        let emitted = if density > 0.0 { medium.emitted(p) * density } else { Rgb::ZERO };
        if emitted == Rgb::ZERO {
            return Rgb::ZERO;
        }
        let direction = (p - floor) / distance;
        let depth = medium.density.depth(&Ray::new(floor, direction), 0.0, distance);
        let factor = 0.5 / PI * direction.y / (distance * distance) * (max - min).element_product();
        emitted * medium.transmittance(depth) * factor
    };
    let found: Vec<Rgb> = (0..POINTS).map(contribution).collect();
    let mean = found.iter().sum::<Rgb>() / POINTS as f64;
    let variance = found.iter().map(|x| (x - mean) * (x - mean)).sum::<Rgb>() / (POINTS * POINTS) as f64;
    let expected = Estimate { mean: mean.to_array(), standard_error: variance.map(f64::sqrt).to_array() };
    for (method, seeds) in [("path", 8), ("photon", 5)] {
        let found = Estimate::of(seeds, &text, &[&format!("render.method={method}"), "render.samples=30"]);
        checks.agree(method, &found, &expected, 0.015, 0.0);
    }
    checks.finish();
}

/// Flames light smoke that scatters, and a floor, by photons from within them and by paths. Little is seen of the
/// flames themselves: what glows is the share that absorbs.
#[test]
fn photons_leave_flames() {
    let mut checks = Checks::default();
    let camera = "[camera]\nposition = [1.5, 1.3, 5]\ntarget = [0, 1.3, 0]\nfov = 36\n";
    let text = format!("{FILM}{camera}{}", FIRE.replace("[media.fire]", "[media.fire]\nsigma_t = 6\nalbedo = 0.95"));
    // Path tracing found this once (128 seeds of 100 samples).
    let path = Estimate { mean: [0.013_079; 3], standard_error: [3.5e-5; 3] };
    let photon = images(5, &text, &["render.method=photon", "render.samples=25", "photons.volume=200_000"]);
    checks.agree("flames", &grey(&photon), &path, 0.01, 0.01);
    checks.finish();
}

/// A ball and a box of uneven smoke, the ball an instance moved away from where its noise was taken.
#[test]
fn photons_and_paths_agree_in_noise() {
    let mut checks = Checks::default();
    let text = format!(
        r#"{FILM}
[camera]
position = [0, 0.8, 6]
target = [0, 0, 0]
fov = 30
[media.smoke]
sigma_t = [20, 30, 50]
albedo = [0.95, 0.9, 0.8]
phase = {{ type = "hg", g = 0.4 }}
density = {{ type = "noise", scale = 0.8, octaves = 3, threshold = 0.45, seed = 5 }}
[[shapes]]
name = "ball"
type = "sphere"
center = [5, 5, 5]
radius = 0.8
interior = "smoke"
visible = false
[[shapes]]
type = "instance"
of = "ball"
transform = [{{ rotate = {{ axis = [1, 2, 0], angle = 40 }} }}, {{ translate = [-7.5, -1.5, -4] }}]
[[shapes]]
type = "box"
min = [0.2, -1, -0.7]
max = [1.6, 0.9, 0.7]
interior = "smoke"
[[lights]]
type = "point"
position = [-1, 3, 2]
intensity = 20
radius = 0.3
[[lights]]
type = "environment"
radiance = [0.1, 0.15, 0.3]
"#
    );
    // Path tracing found this once (128 seeds of 200 samples).
    let known = Estimate { mean: [0.111_410, 0.152_488, 0.267_257], standard_error: [3.1e-5, 2.5e-5, 4.3e-5] };
    let path = Estimate::of(16, &text, &["render.method=path", "render.samples=50"]);
    checks.agree("paths", &path, &known, 0.004, 0.0);
    let photon = Estimate::of(6, &text, &["render.method=photon", "render.samples=16", "photons.volume=200_000"]);
    checks.agree("photons", &photon, &known, 0.004, 0.008);
    checks.finish();
}

/// An instance takes the noise of its template along.
#[test]
fn instances_carry_noise() {
    let noise = "density = { type = \"noise\", scale = 0.5, octaves = 2, threshold = 0.3, seed = 2 }";
    let shape = "[[shapes]]\nname = \"a\"\ntype = \"sphere\"\ncenter = [1, 2, 3]\nradius = 1\ninterior = \"fog\"\n";
    let instance = "[[shapes]]\ntype = \"instance\"\nof = \"a\"\ntransform = [{ scale = 2 }, { rotate = { axis = [0, 0, 1], angle = 90 } }, { translate = [10, 20, 30] }]\n";
    let text = format!(
        "[camera]\nposition = [0, 0, 9]\ntarget = [0, 0, 0]\n[media.fog]\nsigma_s = 1\n{noise}\n{shape}{instance}\
         [[lights]]\ntype = \"point\"\nposition = [0, 9, 0]\nintensity = 1\n"
    );
    let scene = scene(&text, &[]);
    let [one, other] = &scene.media[..] else { panic!("{} media", scene.media.len()) };
    let mut stream = Stream::new(1, Purpose::Test, 0, 0);
    for _ in 0..1000 {
        let p = DVec3::new(1.0, 2.0, 3.0) + 0.5 * DVec3::from_array(std::array::from_fn(|_| stream.uniform() - 0.5));
        let carried = DVec3::new(-2.0 * p.y, 2.0 * p.x, 2.0 * p.z) + DVec3::new(10.0, 20.0, 30.0);
        let (here, there) = (one.density.at(p - scene.center), other.density.at(carried - scene.center));
        assert!((here - there).abs() < 1e-5, "{p}: {here} and {there}");
    }
}

/// Fog of water droplets in front of a lamp: the peak is a hundred times narrower than what a photon's disc spans.
#[test]
fn photons_and_paths_agree_on_droplets() {
    let mut checks = Checks::default();
    let text = format!(
        r#"{FILM}
[camera]
position = [0, 0, 6]
target = [0, 0, 0]
fov = 30
[media.fog]
sigma_s = 1.5
sigma_a = 0.05
phase = {{ type = "mie", diameter = 5 }}
[[shapes]]
type = "sphere"
center = [0, 0, 0]
radius = 1.2
interior = "fog"
[[lights]]
type = "point"
position = [1.5, 2, -1.5]
intensity = 20
radius = 0.4
"#
    );
    // Path tracing found this once (384 seeds of 100 samples).
    let known = Estimate { mean: [0.740_566; 3], standard_error: [4.7e-4; 3] };
    let path = images(16, &text, &["render.method=path", "render.samples=50"]);
    checks.agree("paths", &grey(&path), &known, 0.01, 0.0);
    let photon = images(8, &text, &["render.method=photon", "render.samples=36", "photons.volume=200_000"]);
    checks.agree("photons", &grey(&photon), &known, 0.01, 0.005);
    checks.finish();
}

/// A grid that holds one number is a homogeneous medium to every way of gathering its light.
#[test]
fn a_grid_of_one_number_is_a_homogeneous_medium() {
    let mut checks = Checks::default();
    let grid =
        "density = { type = \"array\", file = \"beam/constant.npy\", min = [-1, -0.8, -0.8], max = [1, 0.8, 0.8] }";
    let glass = ["materials.glass={ type = \"dielectric\", ior = 1.3 }", "shapes.0.material=\"glass\""];
    let [fixed, variable] = ["fixed", "variable"].map(|kernel| format!("volume.kernel={kernel}"));
    let [uniform, adaptive, exponential] =
        ["uniform", "adaptive", "exponential"].map(|step| format!("volume.march.step={step}"));
    let (beam, size) = ("volume.estimate=beam", "volume.march.size=0.2");
    let [traced, approximate] = ["traced", "approximate"].map(|mode| format!("volume.single_scattering={mode}"));
    // With whether the homogeneous medium is rendered anew: marched otherwise, its light is that of the row before.
    let rows: [(&str, bool, &[&str]); 11] = [
        ("path", true, &["render.method=path", "render.samples=200"]),
        ("beam, fixed", true, &[beam, &fixed]),
        ("beam, variable", true, &[beam, &variable]),
        ("point, uniform", true, &[&fixed, &uniform, size]),
        ("point, adaptive", true, &[&variable, &adaptive, size]),
        ("point, exponential", false, &[&variable, &exponential, size]),
        ("traced", true, &[beam, &traced]),
        ("traced, uniform", false, &[beam, &traced, &uniform, size]),
        ("traced, adaptive", false, &[beam, &traced, &adaptive, size]),
        ("traced, exponential", false, &[beam, &traced, &exponential, size]),
        ("approximate, through glass", true, &[beam, &approximate, glass[0], glass[1]]),
    ];
    let mut plain = None;
    for (name, anew, set) in rows {
        let set = [&["render.samples=6", "photons.volume=60_000"], set].concat();
        let found = |density: &str| grey(&images(12, &block(density), &set));
        let plain = plain.insert(plain.filter(|_| !anew).unwrap_or_else(|| found("")));
        checks.agree(name, &found(grid), plain, 0.01, 0.0);
    }
    checks.finish();
}
