//! What grids tell of a medium beside its density: albedo, coefficients, mean cosine and glow.

use volpm::math::{DVec3, Rgb};
use volpm::medium::{Medium, Phases};
use volpm::scene;

use crate::support::{Checks, Estimate, data, images, scene};

/// A cloud of 10³ voxels over a floor, beside a lamp.
const SCENE: &str = r#"
[film]
width = 12
height = 12
layers = false
[camera]
position = [0.5, 1.5, 6.0]
target = [0, -0.1, 0]
fov = 27
[media.cloud]
COEFFICIENTS
density = { type = "vdb", file = "vdb/medium.vdb", DENSITY }
[materials.white]
type = "lambert"
reflectance = 0.5
[[shapes]]
type = "box"
min = [-0.95, -0.95, -0.95]
max = [0.95, 0.95, 0.95]
interior = "cloud"
[[shapes]]
type = "quad"
origin = [-5, -1.5, -5]
edge_u = [0, 0, 10]
edge_v = [10, 0, 0]
material = "white"
[[lights]]
type = "spot"
position = [2.5, 4, 1.5]
target = [0, 0, 0]
intensity = 60
inner_angle = 25
outer_angle = 30
radius = 0.3
"#;

fn cloud(coefficients: &str) -> String {
    SCENE.replace("COEFFICIENTS", coefficients).replace("DENSITY", "grid = \"density\"")
}

const VARYING: &str = r#"sigma_t = 1.2
albedo = { grid = "albedo" }
phase = { type = "hg", g = { grid = "g", scale = 0.9 } }
emission = { grid = "fire", scale = 0.3 }"#;

/// All methods find the same picture of a medium of which all varies.
#[test]
fn methods_agree_on_what_varies() {
    let mut checks = Checks::default();
    let text = cloud(VARYING);
    let of = |sets: &[&str]| Estimate::of(6, &text, sets);
    let path = of(&["render.method=path", "render.samples=64"]);
    let photon = ["render.method=photon", "photons.volume=8000", "render.samples=4"];
    let light = of(&["render.method=light", "render.samples=48"]);
    checks.agree("light", &light, &path, 0.015, 0.0);
    checks.agree("beams", &of(&photon), &path, 0.015, 0.01);
    checks.agree("points", &of(&[&photon[..], &["volume.estimate=point"]].concat()), &path, 0.015, 0.01);
    checks.finish();
}

/// Grids of one value, and coefficients that are shares of the density, are those numbers: the same bits.
#[test]
fn what_does_not_vary_is_a_number() {
    let bits = |text: &str, sets: &[&str]| images(1, text, sets)[0].pixels.clone();
    let photon = ["render.method=photon", "photons.volume=1000", "render.samples=1"];
    let path = ["render.method=path", "render.samples=4"];
    let number = cloud("sigma_t = 2\nalbedo = 0.5\nphase = { type = \"hg\", g = 0.5 }");
    let (by_path, by_photons) = (bits(&number, &path), bits(&number, &photon));
    let grid = cloud("sigma_t = 2\nalbedo = { grid = \"half\" }\nphase = { type = \"hg\", g = 0.5 }");
    assert!(bits(&grid, &path) == by_path && bits(&grid, &photon) == by_photons);
    let g = cloud("sigma_t = 2\nalbedo = 0.5\nphase = { type = \"hg\", g = { grid = \"half\" } }");
    assert!(bits(&g, &path) == by_path);

    // Times the density, and without one.
    let same =
        "sigma_s = { grid = \"half\" }\nsigma_a = { grid = \"half\" }\nscale = 2\nphase = { type = \"hg\", g = 0.5 }";
    assert!(bits(&cloud(same), &path) == by_path && bits(&cloud(same), &photon) == by_photons);
    let alone =
        SCENE.replace("COEFFICIENTS", &same.replace("half", "density").replace("= 2", "= 1")).replace(", DENSITY", "");
    assert!(bits(&alone, &path) == by_path && bits(&alone, &photon) == by_photons);
}

/// Values at voxels are those that the file was made with, and an instance carries them along.
#[test]
fn an_instance_carries_all_grids() {
    let instance = "[[shapes]]\ntype = \"instance\"\nof = \"it\"\ntransform = [{ rotate = { axis = [0, 1, 0], angle = 90 } }, { translate = [0, 3, 0] }]\n";
    let text = cloud(VARYING).replace("interior =", "name = \"it\"\ninterior =");
    let scene = scene(&format!("{text}{instance}"), &[]);
    let [own, carried] = &scene.media[..] else { panic!("{} media", scene.media.len()) };
    for index in [[0.0, 2.0, 7.0], [9.0, 4.0, 3.0], [5.0, 6.0, 1.0]] {
        let p = 0.2 * (DVec3::from_array(index) - 4.5);
        let moved = DVec3::new(p.z, p.y + 3.0, -p.x);
        let expected = Rgb::new(0.55 + 0.4 * p.x / 0.9, 0.5, 0.55 - 0.4 * p.x / 0.9);
        let cosine = 0.9 * (0.15 + 0.65 * p.z / 0.9);
        for (medium, p) in [(own, p), (carried, moved)] {
            let p = p - scene.center;
            assert!((medium.albedo_at(p) - expected).abs().max_element() <= 1.0 / 32.0 + 1e-6, "{index:?}");
            assert!((mean_cosine(medium, p) - cosine).abs() <= 0.9 / 32.0 + 1e-6, "{index:?}");
        }
        let emitted = [(own, p), (carried, moved)].map(|(medium, p)| medium.emitted(p - scene.center));
        assert!(emitted[0].max_element() > 0.0 && (emitted[0] - emitted[1]).abs().max_element() < 1e-5);
    }
}

/// That of a Henyey–Greenstein function, from its value straight ahead: (1 + g)/4π (1 − g)².
fn mean_cosine(medium: &Medium, p: DVec3) -> f64 {
    assert!(matches!(medium.phase, Phases::HenyeyGreenstein(_)));
    let [ahead, back] = [1.0, -1.0].map(|sign| medium.phase.value(p, DVec3::Z, sign * DVec3::Z).1);
    // (1 + g)³/(1 − g)³
    let cubed = (ahead / back).cbrt();
    (cubed - 1.0) / (cubed + 1.0)
}

#[test]
fn what_grids_cannot_tell_is_refused() {
    for (coefficients, expected) in [
        (
            "sigma_t = 1\nalbedo = { grid = \"smoke\" }",
            "media.cloud.albedo.grid: ∙holds no grid \"smoke\"; its grids are: \"density\", \"albedo\"",
        ),
        (
            "sigma_t = 1\nalbedo = { grid = \"wrong\" }",
            "media.cloud.albedo.grid: ∙grid \"wrong\": 200 values are out of range, the worst 1.1875; expected an albedo of at most 1",
        ),
        ("sigma_t = 1\nalbedo = { grid = \"g\" }", "voxels are negative, down to -0.5"),
        (
            "sigma_t = 1\nalbedo = 1\nphase = { type = \"hg\", g = { grid = \"wrong\" } }",
            "media.cloud.phase.g.grid: ∙the worst 1.1875; expected mean cosines between -1 and 1",
        ),
        (
            "sigma_t = 1\nalbedo = 1\nphase = { type = \"hg\", g = { grid = \"albedo\" } }",
            "of type vec3s, expected float",
        ),
        (
            "sigma_s = { grid = \"fire\" }\nsigma_a = { grid = \"grey\" }",
            "media.cloud: the extinction sigma_s + sigma_a of",
        ),
        (
            "sigma_s = { grid = \"density\" }\nsigma_a = { grid = \"moved\" }",
            "media.cloud.sigma_a.grid: ∙has another transform",
        ),
        ("sigma_t = 1\nalbedo = 1\nemission = { grid = \"g\" }", "voxels are negative"),
        (
            "sigma_a = 1\nemission = { grid = \"fire\", kelvin_scale = 2 }",
            "media.cloud.emission.kelvin_scale: has no meaning here",
        ),
        ("preset = \"milk\"", "preset"),
        (
            "preset = \"wholemilk\"\nphase = { type = \"hg\", g = { grid = \"g\" } }",
            "media.cloud.preset: is given beside a grid of `g`",
        ),
    ] {
        let built = scene::parse(&cloud(coefficients), &data("scene.toml"), &[]).and_then(|said| scene::build(&said));
        let error = built.err().unwrap_or_else(|| panic!("{coefficients}")).to_string();
        assert!(expected.split('∙').all(|part| error.contains(part)), "{error}");
    }
    let text = SCENE.replace("COEFFICIENTS", VARYING);
    let text = text.replace("{ type = \"vdb\", file = \"vdb/medium.vdb\", DENSITY }", "{ type = \"constant\" }");
    let error = scene::parse(&text, &data("scene.toml"), &[]).expect_err("no file").to_string();
    assert!(
        error.contains("albedo.grid: names a second grid of the density's file; expected a `density` of type \"vdb\""),
        "{error}"
    );
}

/// A grid that is turned, sheared, mirrored, or a million times as large or small is at each point what it was before at the point that went
/// there, and along each ray, too.
#[test]
fn transforms_carry_grids_along() {
    use volpm::math::Ray;
    use volpm::math::random::{Purpose, Stream};
    type Back = fn(DVec3) -> DVec3;
    let turned = |p: DVec3| {
        let (sin, cos) = 30f64.to_radians().sin_cos();
        DVec3::new(cos * p.x + sin * p.y, cos * p.y - sin * p.x, p.z)
    };
    let cases: [(&str, Back, f64); 6] = [
        ("{ rotate = { axis = [0, 0, 1], angle = 30 } }", turned, 1.0),
        (
            "{ matrix = [1, 0.4, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1] }",
            |p| DVec3::new(p.x - 0.4 * p.y, p.y, p.z),
            1.0,
        ),
        ("{ scale = [-1, 1, 1] }", |p| DVec3::new(-p.x, p.y, p.z), 1.0),
        ("{ scale = [1, 1, -0.01] }", |p| DVec3::new(p.x, p.y, -100.0 * p.z), 1.0),
        ("{ scale = 1e6 }", |p| 1e-6 * p, 1e6),
        ("{ scale = 1e-6 }", |p| 1e6 * p, 1e-6),
    ];
    let of = |density: &str| {
        scene(&SCENE.replace("COEFFICIENTS", "sigma_t = 1.2\nalbedo = 0.5").replace("DENSITY", density), &[])
    };
    let before = of("grid = \"density\"");
    let mut stream = Stream::new(12, Purpose::Test, 0, 0);
    for (transform, back, size) in cases {
        let after = of(&format!("grid = \"density\", transform = [{transform}]"));
        let [was, is] = [&before, &after].map(|scene| &scene.media[0].density);
        let mut dense = 0;
        for _ in 0..2000 {
            let mut point = || {
                let [x, y] = stream.uniform2();
                size * (2.4 * DVec3::new(x, y, stream.uniform()) - DVec3::splat(1.2))
            };
            let (p, q) = (point(), point());
            let (at, expected) = (is.at(p - after.center), was.at(back(p) - before.center));
            assert!((at - expected).abs() < 1e-5, "{transform} at {p}: {at}, not {expected}");
            dense += usize::from(expected > 0.0);
            let along = |density: &volpm::medium::density::Density, [p, q]: [DVec3; 2]| {
                density.depth(&Ray::new(p, (q - p).normalize()), 0.0, p.distance(q)) / p.distance(q)
            };
            let found = along(is, [p, q].map(|p| p - after.center));
            let expected = along(was, [p, q].map(|p| back(p) - before.center));
            assert!((found - expected).abs() < 1e-5, "{transform} from {p} to {q}: {found}, not {expected}");
        }
        assert!(dense > 10, "{transform}: {dense} points in the cloud");
    }
}
