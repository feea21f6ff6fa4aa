//! Whitted's ray tracing, and shadow rays of which several are sent: mirrors, glass, and light straight from lights.

use volpm::image::LayerData;

use crate::support::{Checks, Estimate, images, render};

/// A floor of reflectance 0.5 under a lamp of radius 0.5 and radiance 40 at (2, 3, 0); a white wall and a ball of glass that send it more, though
/// not straight. The camera looks at the origin.
const ROOM: &str = r#"
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
[materials.glass]
type = "dielectric"
ior = 1.5
[materials.mirror]
type = "mirror"
reflectance = 0.8
[[shapes]]
type = "quad"
origin = [-6, 0, 6]
edge_u = [12, 0, 0]
edge_v = [0, 0, -12]
material = "floor"
[[shapes]]
type = "quad"
origin = [-3, 0, -6]
edge_u = [0, 0, 12]
edge_v = [0, 6, 0]
material = "floor"
[[shapes]]
type = "sphere"
center = [0.4, 1.4, 0.6]
radius = 0.3
material = "glass"
[[shapes]]
type = "sphere"
center = [2, 3, 0]
radius = 0.5
emission = { radiance = 40 }
[render]
method = "whitted"
samples = 256
"#;

/// A pane between the camera and the floor.
const PANE: &str = r#"
[[shapes]]
type = "box"
min = [-0.1, 0.4, -0.1]
max = [0.1, 0.6, 0.1]
material = "glass"
"#;

/// A mirror at half a right angle, by which the camera sees the origin from the side.
const MIRROR: &str = r#"
[[shapes]]
type = "disk"
center = [0, 0.8, 0]
normal = [0, -1, 1]
radius = 0.1
material = "mirror"
"#;

/// What the layers of a render are, by their names, in the mean; those that are 0 left out.
fn layers(text: &str, overrides: &[&str]) -> Vec<(&'static str, f64)> {
    let film = render(text, overrides).film;
    let layers = film.layers();
    let mean = |name: &str| {
        let Some(layer) = layers.iter().find(|layer| layer.name == name) else { return 0.0 };
        let LayerData::Rgb(pixels) = &layer.channels else { panic!("layer {name} is no colour") };
        pixels.iter().map(|pixel| f64::from(pixel[0])).sum::<f64>() / pixels.len() as f64
    };
    let all = volpm::render::Component::ALL.map(|component| (component.name(), mean(component.name())));
    let sum: f64 = all.iter().map(|(_, mean)| mean).sum();
    assert!((sum - film.image().mean()).abs() < 1e-5 * sum.max(1e-9), "{all:?}");
    all.into_iter().filter(|(_, mean)| *mean != 0.0).collect()
}

/// The floor under a lamp, L ρ (r/d)² cos θ, straight, through a pane of which what is reflected within it passes at last, and
/// by a mirror; with no more events than are allowed, and through fog that only takes away. Nothing else is seen, though walls and
/// glass would send it.
#[test]
fn light_comes_straight_or_by_specular_events_and_by_no_other() {
    let floor = 40.0 * 0.5 * (0.25 / 13.0) * 3.0 / 13.0f64.sqrt();
    let pane = 0.96 / 1.04;
    let aside = ROOM
        .replace("position = [0, 1, 0]", "position = [0, 0.8, 3]")
        .replace("target = [0, 0, 0]", "target = [0, 0.8, 0]");
    let aside = aside.replace("up = [0, 0, -1]", "up = [0, 1, 0]");
    let (through, mirrored) = (format!("{ROOM}{PANE}"), format!("{aside}{MIRROR}"));
    // A point's light, of intensity 20, as the way from all of a wide lamp is not the same.
    let fog = ROOM.replace("[[shapes]]\ntype = \"sphere\"\ncenter = [2, 3, 0]\nradius = 0.5\nemission = { radiance = 40 }", "[[lights]]\ntype = \"point\"\nposition = [2, 3, 0]\nintensity = 20\n[world]\nmedium = \"fog\"\n[media.fog]\nsigma_s = 0.1\nsigma_a = 0.05");
    let dimmed =
        20.0 * 0.5 / std::f64::consts::PI / 13.0 * 3.0 / 13.0f64.sqrt() * (-0.15 * (1.0 + 13.0f64.sqrt())).exp();
    let mut checks = Checks::default();
    for (what, text, depth, layer, expected) in [
        ("floor", ROOM, 0, "direct", floor),
        ("floor, one event", ROOM, 1, "direct", floor),
        ("pane", &through, 0, "specular", pane * floor),
        ("pane, three events", &through, 3, "specular", 0.96 * 0.96 * floor),
        ("pane, two events", &through, 2, "specular", 0.0),
        ("mirror", &mirrored, 0, "specular", 0.8 * floor),
        ("mirror, one event", &mirrored, 1, "specular", 0.0),
        ("fog", &fog, 0, "direct", dimmed),
    ] {
        let found = layers(text, &[&format!("render.max_depth={depth}")]);
        let holds = match &found[..] {
            [] => expected == 0.0,
            [(name, mean)] => *name == layer && (mean / expected - 1.0).abs() < 0.003,
            _ => false,
        };
        checks.holds(format!("{what}: {found:?}, expected {layer} {expected}"), holds);
    }
    // Of a light of no size, paths see no caustic: what the ball shows the floor of the wall is indirect light.
    let point = fog.replace("[world]\nmedium = \"fog\"\n", "");
    let found = layers(&point, &["render.method=path", "render.samples=4096"]);
    checks.holds(format!("paths, point: {found:?}"), found.iter().map(|(name, _)| *name).eq(["direct", "indirect"]));
    // What paths see besides.
    let found = layers(ROOM, &["render.method=path", "render.samples=4096"]);
    let more = |layer: &str| found.iter().any(|(name, mean)| *name == layer && *mean > 1e-4);
    checks.holds(format!("paths: {found:?}"), more("indirect") && more("caustic"));
    checks.finish();
}

/// A floor half in the shadow of a wide lamp.
const PENUMBRA: &str = r#"
[film]
width = 8
height = 8
[camera]
position = [0, 3, 4]
target = [0, 0, 0]
fov = 20
[materials.floor]
type = "lambert"
reflectance = 0.5
[materials.black]
type = "lambert"
reflectance = 0
[[shapes]]
type = "quad"
origin = [-6, 0, 6]
edge_u = [12, 0, 0]
edge_v = [0, 0, -12]
material = "floor"
[[shapes]]
type = "quad"
origin = [-8, 1, 4]
edge_u = [8, 0, 0]
edge_v = [0, 0, -8]
material = "black"
[[shapes]]
type = "quad"
origin = [-1, 2, -1]
edge_u = [2, 0, 0]
edge_v = [0, 0, 2]
emission = { radiance = 3 }
[render]
samples = 1
"#;

/// Of N shadow rays the mean is the same and the variance at most an N-th of what one leaves; also where a floor that shines like a mirror meets
/// lamp and sky by chance as often as it asks for them.
#[test]
fn more_shadow_rays_leave_less_noise_and_the_mean() {
    const RAYS: f64 = 8.0;
    let glossy = PENUMBRA.replace(
        "type = \"lambert\"\nreflectance = 0.5",
        "type = \"phong\"\ndiffuse = 0.2\nspecular = 0.6\nexponent = 30",
    );
    let glossy = glossy.replace("samples = 1", "samples = 6");
    let glossy = format!("{glossy}[[lights]]\ntype = \"environment\"\nradiance = 0.2\n");
    let mut checks = Checks::default();
    for (what, text) in [("matt", PENUMBRA), ("glossy", &glossy)] {
        for method in ["path", "photon", "whitted"] {
            let [one, many] = [1.0, RAYS].map(|rays| {
                let set = [format!("render.method={method}"), format!("render.light_samples={rays}")];
                // There is no indirect light to keep photons for.
                images(300, text, &[&*set[0], &set[1], "surface.indirect=none"])
            });
            let [[mean_of_one, few], [mean_of_many, less]] = [&one, &many].map(|images| {
                let over = Estimate::over(images, |image| image.channel_means());
                let of_pixel = |x, y| Estimate::over(images, |image| image.get(x, y).map(f64::from));
                let pixels = (0..8).flat_map(|y| (0..8).map(move |x| (x, y)));
                let variance = pixels.map(|(x, y)| of_pixel(x, y).standard_error[0].powi(2)).sum();
                [over, Estimate::exact([variance; 3])]
            });
            checks.agree(&format!("{what}, {method}"), &mean_of_many, &mean_of_one, 0.01, 0.0);
            let ratio = few.mean[0] / less.mean[0];
            let least = if what == "matt" { 0.95 * RAYS } else { 1.0 };
            checks.holds(format!("{what}, {method}: {ratio:.2} times less variance"), ratio > least);
        }
    }
    checks.finish();
}
