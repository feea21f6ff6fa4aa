//! Kinds of cameras, and parts of the film.

use crate::support::{ALL_SORTS, Checks, Estimate, render};

/// A floor, a wall, a rough metal and a block of fog under a spot, in parallel rays through a lens.
const PARALLEL: &str = r#"
[film]
width = 12
height = 10
layers = false
[camera]
projection = "orthographic"
position = [0.2, 1.4, 4.6]
target = [0, 0.6, 0]
fov = 36
aperture = 0.15
focus_distance = 4
[media.fog]
sigma_s = [0.5, 0.7, 0.9]
sigma_a = 0.05
phase = { type = "hg", g = 0.4 }
[materials.floor]
type = "lambert"
reflectance = { texture = "checker", scale = 2, a = [0.8, 0.7, 0.6], b = [0.2, 0.3, 0.4] }
[materials.copper]
type = "conductor"
metal = "Cu"
roughness = 0.4
[[shapes]]
type = "quad"
origin = [-2, 0, 2]
edge_u = [4, 0, 0]
edge_v = [0, 0, -4]
material = "floor"
[[shapes]]
type = "quad"
origin = [-2, 0, -1.5]
edge_u = [4, 0, 0]
edge_v = [0, 2.2, 0]
material = "floor"
[[shapes]]
type = "sphere"
center = [-0.7, 0.5, 0.3]
radius = 0.4
material = "copper"
[[shapes]]
type = "box"
min = [-0.2, 0.2, -1]
max = [1.4, 1.4, 1]
interior = "fog"
[[lights]]
type = "spot"
position = [0.9, 3, 0.6]
target = [0, 0.5, 0]
intensity = [12, 10, 8]
inner_angle = 15
outer_angle = 30
"#;

/// Parallel rays see the same, be light looked for along them, gathered from photons, or sent to the camera.
#[test]
fn parallel_rays_see_the_same_by_all_methods() {
    let mut checks = Checks::default();
    for lens in ["camera.aperture=0", "camera.aperture=0.15"] {
        let by = |method: &str, seeds: u32, samples: u32| {
            let settings = [format!("render.method={method}"), format!("render.samples={samples}")];
            let [method, samples] = &settings;
            Estimate::of(seeds, PARALLEL, &[lens, method, samples, "photons.volume=20_000"])
        };
        let path = by("path", 8, 128);
        checks.agree(&format!("light, {lens}"), &by("light", 8, 192), &path, 0.01, 0.0);
        checks.agree(&format!("photon, {lens}"), &by("photon", 4, 48), &path, 0.01, 0.006);
    }
    checks.finish();
}

/// A part of the film is what it is in the whole picture, to the last bit, whatever gathers, keeps or sends the light, and where filters
/// reach beyond it.
#[test]
fn a_part_of_the_film_is_as_in_the_whole() {
    let (x, y, w, h) = (9, 5, 18, 13);
    let crop = format!("film.crop=[{x}, {y}, {w}, {h}]");
    let filter = "film.filter=gaussian";
    let methods: [&[&str]; 4] = [
        &["render.method=photon", filter, "photons.global=5000"],
        &[
            "render.method=photon",
            "volume.estimate=point",
            "render.samples=1",
            "photons.volume=5000",
            "photons.global=5000",
        ],
        &["render.method=path", filter],
        &["render.method=light", filter],
    ];
    for settings in methods {
        let whole = render(ALL_SORTS, settings).film.image();
        let part = render(ALL_SORTS, &[settings, &[&crop]].concat()).film.image();
        assert_eq!((part.width, part.height), (w, h));
        for row in 0..h {
            let from = (y + row) * whole.width + x;
            assert_eq!(part.pixels[row * w..(row + 1) * w], whole.pixels[from..from + w], "{settings:?}, row {row}");
        }
    }
}
