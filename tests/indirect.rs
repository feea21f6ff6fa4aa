//! Indirect light on surfaces: gathered, cached, or read from the global map, it is what paths find.

use crate::support::{Checks, Estimate, render};

/// A box with coloured walls, a tall box and a ball in it, and a square lamp below its ceiling (Goral et al. 1984).
const ROOM: &str = r#"
[materials.white]
type = "lambert"
reflectance = 0.75
[materials.red]
type = "lambert"
reflectance = [0.63, 0.06, 0.05]
[[shapes]]
type = "quad"
origin = [-1, 0, -1]
edge_u = [0, 0, 2]
edge_v = [2, 0, 0]
material = "white"
[[shapes]]
type = "quad"
origin = [-1, 2, -1]
edge_u = [2, 0, 0]
edge_v = [0, 0, 2]
material = "white"
[[shapes]]
type = "quad"
origin = [-1, 0, -1]
edge_u = [2, 0, 0]
edge_v = [0, 2, 0]
material = "white"
[[shapes]]
type = "quad"
origin = [-1, 0, -1]
edge_u = [0, 2, 0]
edge_v = [0, 0, 2]
material = "red"
[[shapes]]
type = "box"
min = [-0.3, 0, -0.3]
max = [0.3, 1.2, 0.3]
transform = [{ rotate = { axis = [0, 1, 0], angle = 18 } }, { translate = [-0.35, 0, -0.35] }]
material = "white"
[[shapes]]
type = "sphere"
center = [0.4, 0.35, 0.35]
radius = 0.35
material = "white"
[[shapes]]
type = "quad"
origin = [-0.25, 1.99, -0.25]
edge_u = [0.5, 0, 0]
edge_v = [0, 0, 0.5]
emission = { radiance = 17 }
[camera]
position = [0, 1, 3.4]
target = [0, 1, 0]
fov = 40
"#;

/// A rough, tiled floor, a varnished wall, a mirror and a ball of glass in fog under a round lamp, with a sky that shines in.
const MIXED: &str = r#"
[media.fog]
sigma_s = 0.06
sigma_a = 0.02
[[shapes]]
type = "box"
min = [-1.95, 0.01, -1.95]
max = [1.85, 2.9, 1.95]
interior = "fog"
[materials.floor]
type = "oren_nayar"
reflectance = { texture = "checker", scale = 4, a = [0.7, 0.6, 0.4], b = 0.3 }
sigma = 0.4
[materials.paint]
type = "lambert"
reflectance = [0.3, 0.6, 0.7]
[materials.varnished]
type = "coated"
base = "paint"
[materials.silver]
type = "mirror"
reflectance = 0.9
[materials.glass]
type = "dielectric"
[[shapes]]
type = "quad"
origin = [-2, 0, 2]
edge_u = [4, 0, 0]
edge_v = [0, 0, -4]
material = "floor"
[[shapes]]
type = "quad"
origin = [-2, 0, -2]
edge_u = [4, 0, 0]
edge_v = [0, 3, 0]
material = "varnished"
[[shapes]]
type = "quad"
origin = [-2, 0, -2]
edge_u = [0, 3, 0]
edge_v = [0, 0, 4]
material = "paint"
[[shapes]]
type = "disk"
center = [1.9, 1, 0]
normal = [-1, 0, 0]
radius = 0.9
material = "silver"
[[shapes]]
type = "sphere"
center = [0.3, 0.6, -0.3]
radius = 0.5
material = "glass"
[[shapes]]
type = "sphere"
center = [-0.6, 2.4, 0.6]
radius = 0.3
emission = { radiance = 14 }
[[lights]]
type = "environment"
radiance = [0.1, 0.15, 0.25]
[camera]
position = [0, 1.4, 4.2]
target = [0, 1, 0]
fov = 50
"#;

const FILM: &str = "[film]\nwidth = 16\nheight = 16\nlayers = false\n";

const WAYS: &[(&str, &[&str])] = &[
    ("gathered", &["surface.irradiance_cache=false"]),
    ("cached", &[]),
    ("cached by distance", &["surface.records=split_sphere", "surface.cache_error=0.2"]),
    ("shown", &["surface.indirect=map"]),
    ("shown by sheets", &["surface.indirect=map", "surface.estimate=sheets"]),
];

/// Means of whole films by all ways, within half a per cent beyond their noise of what paths found once, with standard errors.
#[test]
fn indirect_light_is_what_paths_find() {
    let mut checks = Checks::default();
    for (name, scene, samples, (mean, standard_error)) in
        [("room", ROOM, "render.samples=32", ROOM_BY_PATHS), ("mixed", MIXED, "render.samples=12", MIXED_BY_PATHS)]
    {
        for (way, set) in WAYS {
            // Few photons of thin fog and of caustics: they bring little of the noise.
            let mut overrides =
                vec!["photons.volume=10_000", "photons.caustic=20_000", "photons.global=60_000", samples];
            overrides.extend(*set);
            let found = Estimate::of(8, &format!("{FILM}{scene}"), &overrides);
            checks.agree(&format!("{name}, {way}"), &found, &Estimate { mean, standard_error }, 0.01, 0.005);
        }
    }
    checks.finish();
}

/// By `render.method=path` with 4096 samples, 16 seeds.
const ROOM_BY_PATHS: ([f64; 3], [f64; 3]) = ([0.358_373, 0.307_892, 0.307_127], [2.6e-5, 1.9e-5, 1.9e-5]);
const MIXED_BY_PATHS: ([f64; 3], [f64; 3]) = ([0.456_988, 0.498_696, 0.540_907], [4.4e-5, 4.5e-5, 4.0e-5]);

/// In a closed box that shines and reflects a part a of what arrives, L = L_e/(1 − a) everywhere: in its corners, too.
#[test]
fn furnaces_are_even() {
    let mut checks = Checks::default();
    for (albedo, seeds) in [(0.5, 3), (0.9, 7)] {
        let text = format!(
            "{FILM}[materials.wall]\ntype = \"lambert\"\nreflectance = {albedo}\n[[shapes]]\ntype = \"box\"\nmin = [-1, -1, -1]\n\
             max = [1, 1, 2]\nmaterial = \"wall\"\nemission = {{ radiance = 1, side = \"in\" }}\n\
             [camera]\nposition = [0.2, 0.1, 1.8]\ntarget = [0, 0, 0]\nfov = 80\n"
        );
        for (way, set) in WAYS {
            let mut overrides = vec!["photons.global=60_000", "render.samples=16"];
            overrides.extend(*set);
            let found = Estimate::of(seeds, &text, &overrides);
            let expected = Estimate { mean: [1.0 / (1.0 - albedo); 3], standard_error: [0.0; 3] };
            checks.agree(&format!("{albedo}, {way}"), &found, &expected, 0.01, 0.005);
        }
    }
    checks.finish();
}

/// So it is on a floor of relief, finer than the discs of photons: what they cover of it here and there is found without a bias.
#[test]
fn furnaces_are_even_on_relief() {
    const CELLS: [u32; 2] = [66, 100];
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("relief.obj");
    let mut relief = String::new();
    for (x, z) in (0..=CELLS[1]).flat_map(|z| (0..=CELLS[0]).map(move |x| (x, z))) {
        let mut hash = x.wrapping_mul(7919).wrapping_add(z.wrapping_mul(104_729));
        hash = (hash ^ hash >> 16).wrapping_mul(0x7feb_352d);
        hash = (hash ^ hash >> 15).wrapping_mul(0x846c_a68b);
        let height = f64::from(hash ^ hash >> 16) / f64::from(u32::MAX);
        let [x, z] = [f64::from(x) / f64::from(CELLS[0]), f64::from(z) / f64::from(CELLS[1])];
        relief += &format!("v {} {} {}\n", 2.0 * x - 1.0, 0.08 * height - 0.98, 3.0 * z - 1.0);
    }
    for (x, z) in (0..CELLS[1]).flat_map(|z| (1..=CELLS[0]).map(move |x| (x, z))) {
        let [a, b] = [0, 1].map(|row| (z + row) * (CELLS[0] + 1) + x);
        relief += &format!("f {a} {b} {}\nf {} {b} {}\n", a + 1, a + 1, b + 1);
    }
    std::fs::write(&file, relief).unwrap();
    let text = format!(
        "{FILM}[materials.wall]\ntype = \"lambert\"\nreflectance = 0.5\n[[shapes]]\ntype = \"box\"\nmin = [-1, -1, -1]\n\
         max = [1, 1, 2]\nmaterial = \"wall\"\nemission = {{ radiance = 1, side = \"in\" }}\n\
         [[shapes]]\ntype = \"mesh\"\nfile = {file:?}\nsmooth = false\nmaterial = \"wall\"\nemission = {{ radiance = 1, side = \"out\" }}\n\
         [camera]\nposition = [0.2, 0.1, 1.8]\ntarget = [0, -0.6, 0]\nfov = 60\n"
    );
    let mut checks = Checks::default();
    let expected = Estimate { mean: [2.0; 3], standard_error: [0.0; 3] };
    for (way, set) in WAYS.iter().filter(|(way, _)| matches!(*way, "gathered" | "shown")) {
        let mut overrides = vec!["photons.global=60_000", "render.samples=16"];
        overrides.extend(*set);
        checks.agree(way, &Estimate::of(6, &text, &overrides), &expected, 0.01, 0.005);
    }
    checks.finish();
}

/// Behind a wall without thickness it is dark: less than a millionth of what is lit comes there.
#[test]
fn no_light_leaks_through_a_sheet() {
    let text = format!(
        "{FILM}[materials.wall]\ntype = \"lambert\"\nreflectance = 0.8\n[[shapes]]\ntype = \"box\"\nmin = [-2, -1, -1]\nmax = [2, 1, 1]\n\
         material = \"wall\"\n[[shapes]]\ntype = \"quad\"\norigin = [0, -1, -1]\nedge_u = [0, 2, 0]\nedge_v = [0, 0, 2]\nmaterial = \"wall\"\n\
         [[lights]]\ntype = \"point\"\nposition = [-0.2, 0.3, 0]\nintensity = 5\n\
         [camera]\nposition = [1.9, 0.1, 0.3]\ntarget = [0, 0, 0]\nfov = 90\n"
    );
    for (way, set) in WAYS {
        let mut overrides = vec!["photons.global=50_000"];
        overrides.extend(*set);
        let leaked = render(&text, &overrides).film.image().channel_means();
        let lit = render(&text.replace("[-0.2, 0.3, 0]", "[0.2, 0.3, 0]"), &overrides).film.image().channel_means();
        assert!(leaked[0] <= 1e-6 * lit[0], "{way}: {leaked:?} of {lit:?}");
    }
}

/// Where nothing is kept of what gather rays find, the noise of pixels falls as there are more of them: their variance to a sixteenth at least, of
/// sixty-four, beside which light changes from pixel to pixel.
#[test]
fn gather_rays_share_the_noise() {
    let text = format!(
        "{FILM}[materials.wall]\ntype = \"lambert\"\nreflectance = 0.7\n[[shapes]]\ntype = \"box\"\nmin = [-2, -1, -1]\nmax = [2, 1, 1]\n\
         material = \"wall\"\n[[lights]]\ntype = \"point\"\nposition = [-1.5, 0.3, 0]\nintensity = 5\n\
         [camera]\nposition = [0, 0, 0.9]\ntarget = [0, 0, -1]\nfov = 10\n"
    );
    let of = |rays: &str| {
        let overrides = ["photons.global=20_000", "surface.irradiance_cache=false", "render.samples=2", rays];
        let image = render(&text, &overrides).film.image();
        let rows = image.pixels.chunks(image.width);
        let steps = rows.flat_map(|row| row.windows(2).map(|pair| f64::from(pair[0][0] - pair[1][0]).powi(2)));
        steps.sum::<f64>() / image.mean().powi(2)
    };
    let (one, many) = (of("surface.gather_rays=1"), of("surface.gather_rays=64"));
    assert!(many * 16.0 < one, "squared steps from pixel to pixel: {many} with 64 rays, {one} with one");
}

/// Shadow photons spare most shadow rays, and leave the picture as it is: a thousandth of the light is more than they mistake.
#[test]
fn shadow_photons_spare_rays() {
    let of = |chosen: &str| {
        let film = "[film]\nwidth = 32\nheight = 32\n";
        let overrides = ["surface.indirect=none", "render.samples=16", "render.adaptive=false", chosen];
        render(&format!("{film}{ROOM}"), &overrides)
    };
    let (without, with) = (of("surface.shadow_photons=false"), of("surface.shadow_photons=true"));
    let (asked, left) = (without.stats.gather, with.stats.gather);
    assert_eq!((without.stats.shadow, asked.spared_rays), (0, 0));
    assert_eq!(left.shadow_rays + left.spared_rays, asked.shadow_rays);
    assert!(left.spared_rays * 10 > asked.shadow_rays * 6, "{} of {} spared", left.spared_rays, asked.shadow_rays);
    let [with, without] = [with, without].map(|rendering| rendering.film.image());
    assert!((with.mean() / without.mean() - 1.0).abs() < 1e-3, "{}, not {}", with.mean(), without.mean());
}
