//! The plan that is told is the one that is followed: what it says a render will have, the render has, of about that size.

use std::sync::atomic::AtomicBool;

use volpm::render::{Forced, Forecast, Limits, Rendering, Silent, choose, refine, render};
use volpm::scene::description::Method;

use crate::support::built;

/// A room with a lamp, of which parts are exchanged.
const ROOM: &str = r#"
[film]
width = 24
height = 16
[camera]
position = [0, 0, 3.9]
target = [0, 0, 0]
[render]
samples = 1
[materials.wall]
type = "lambert"
reflectance = 0.6
[materials.glass]
type = "dielectric"
ior = 1.5
[media.fog]
sigma_s = 0.2
[media.cloud]
sigma_t = 6
albedo = 0.9
density = { type = "noise", threshold = 0.3 }
phase = { type = "hg", g = 0.8 }
[[shapes]]
type = "box"
min = [-4, -4, -4]
max = [4, 4, 4]
material = "wall"
[[shapes]]
name = "ball"
type = "sphere"
center = [0, -1, 0]
radius = 1
material = "wall"
[[lights]]
type = "point"
position = [1, 3, 0]
intensity = 5
"#;

/// Of photons in fog and on surfaces, of voxels by paths through peaks, of points, of a path tracer and of a light tracer: whatever the
/// plan says there is, and only that, is there after the render, as large as it said to a fifth, and of as many photons.
#[test]
fn a_render_has_what_its_plan_says() {
    let volume = "photons.volume=90000";
    let cases: [(&str, &[&str]); 7] = [
        ("walls", &["photons.global=90000"]),
        ("a caustic, shown", &["shapes.ball.material=glass", "surface.shadow_photons=true", volume]),
        ("fog", &["world.medium=fog", volume]),
        (
            "a cloud, and the map of surfaces",
            &["shapes.ball.material=none", "shapes.ball.interior=cloud", "surface.indirect=map", volume],
        ),
        ("points", &["world.medium=fog", "volume.estimate=point", "render.max_depth=3", "photons.volume=70000"]),
        ("paths", &["world.medium=fog", "render.method=path", "film.layers=false"]),
        ("light paths", &["shapes.ball.material=glass", "render.method=light"]),
    ];
    for (what, overrides) in cases {
        let (scene, mut settings) = built(ROOM, overrides);
        let choice = choose(&scene, &settings).unwrap();
        if let Some(choice) = &choice {
            settings.render.method = choice.method;
        }
        let forecast = Forecast::new(&scene, &settings, &Limits::default(), choice.as_ref()).unwrap();
        let Rendering { stats, .. } = render(&scene, &settings, &Silent, &AtomicBool::new(false)).unwrap();
        assert_eq!(forecast.method, settings.render.method.name(), "{what}");
        let close = |name: &str, told: u64, found: u64, off: f64| {
            let allowed = off * found as f64 + if found > 0 { 20.0 } else { 0.0 };
            assert!(told.abs_diff(found) as f64 <= allowed, "{what}, {name}: {told} told, {found} found");
        };
        let told = |name: &str| forecast.item(name).unwrap_or_else(|| panic!("{name}"));
        for (name, found) in [
            ("volume_photons", stats.volume),
            ("caustic_photons", stats.caustic),
            ("global_photons", stats.global),
            ("shadow_photons", stats.shadow),
        ] {
            assert_eq!(told(name).needed, found > 0, "{what}, {name}: {}", told(name).why);
            close(name, told(name).count.unwrap_or(0), found, 0.1);
        }
        for (name, found) in [("irradiance_cache", stats.records), ("camera_paths", stats.samples)] {
            assert_eq!(told(name).needed, found > 0, "{what}, {name}: {}", told(name).why);
            assert!(told(name).count.unwrap_or(0) >= found, "{what}, {name}: {found}");
        }
        if what == "fog" || what.starts_with("a cloud") {
            let kept = ["photon_directions", "photon_colours"].map(|name| told(name).needed);
            assert_eq!(kept, [what != "fog", false], "{what}: grey light, which fog scatters alike in all directions");
        }
        close("volume_map", forecast.bytes.volume_map, stats.map_bytes, 0.2);
        close("surface_maps", forecast.bytes.surface_maps, stats.surface_bytes, 0.2);
        let parts = ["caustic_map", "global_map", "visibility_map"].map(|name| told(name).bytes.unwrap_or(0));
        assert_eq!(parts.iter().sum::<u64>(), forecast.bytes.surface_maps, "{what}");
    }
}

/// Every item is explained on the page about plans, with a reason where it is needed and where it is not.
#[test]
fn every_item_is_explained() {
    let page = include_str!("../docs/plan.md");
    for overrides in [&[][..], &["world.medium=fog"], &["render.method=path"]] {
        let (scene, settings) = built(ROOM, overrides);
        let forecast = Forecast::new(&scene, &settings, &Limits::default(), None).unwrap();
        for item in &forecast.items {
            assert!(page.contains(&format!("| `{}` |", item.name)), "docs/plan.md has no row for {}", item.name);
            assert!(!item.why.is_empty(), "{}", item.name);
        }
    }
}

/// Photons tell where light comes from wherever gather rays go, kept or not, and are not stored for that where none go.
#[test]
fn flux_is_kept_for_gather_rays_alone() {
    for (set, kept) in [
        (&["surface.irradiance_cache=true"][..], true),
        (&["surface.irradiance_cache=false"], true),
        (&["surface.gather_directions=bsdf"], false),
        (&["surface.indirect=map"], false),
    ] {
        let (scene, settings) = built(ROOM, &[&["photons.global=20000", "render.method=photon"], set].concat());
        let forecast = Forecast::new(&scene, &settings, &Limits::default(), None).unwrap();
        let flux = forecast.item("flux_map").expect("the plan has a row for it");
        assert_eq!((flux.needed, flux.bytes.is_some_and(|bytes| bytes > 0)), (kept, kept), "{set:?}: {}", flux.why);
    }
}

/// What is forced is there, as large as the plan says, and the picture is the same: to the bit where nothing reads it, and in the mean where what
/// it tells means the same.
#[test]
fn what_is_forced_changes_no_light() {
    let paths = ["world.medium=fog", "render.method=path", "photons.volume=30000", "photons.global=30000"];
    let many = ["world.medium=fog", "render.method=path", "render.samples=32"];
    let few = ["render.method=path", "render.max_depth=5", "film.layers=false", "shapes.ball.material=glass"];
    let fog = ["world.medium=fog", "render.method=photon", "photons.volume=60000", "surface.indirect=map"];
    let cases: [(&[&str], Forced, f64); 12] = [
        (&few, Forced::EternityPilot, 0.0),
        (&few, Forced::CausticPhotons, 0.0),
        (&paths, Forced::VolumePhotons, 0.0),
        (&paths, Forced::GlobalPhotons, 0.0),
        (&paths, Forced::ShadowPhotons, 0.0),
        (&paths, Forced::Irradiances, 0.0),
        (&paths, Forced::FluxMap, 0.0),
        (&few, Forced::FilmLayers, 1e-6),
        (&few, Forced::PassSums, 1e-6),
        (&many, Forced::PathSplitting, 0.1),
        (&fog, Forced::Importons, 0.1),
        (&fog, Forced::SparseVolumeMap, 0.1),
    ];
    for (overrides, forced, off) in cases {
        let (scene, settings) = built(ROOM, overrides);
        let rendered = |forced: &[Forced]| {
            let limits = Limits { forced: forced.to_vec(), ..Limits::default() };
            let forecast = Forecast::new(&scene, &settings, &limits, None).unwrap();
            (forecast, refine(&scene, &settings, &limits, None, &Silent, &AtomicBool::new(false)).unwrap())
        };
        let ((without, plain), (forecast, with)) = (rendered(&[]), rendered(&[forced, forced]));
        let item = |of: &Forecast| of.item(forced.name()).map(|item| (item.needed, item.forced));
        assert_eq!((item(&without), item(&forecast)), (Some((false, false)), Some((false, true))), "{forced}");
        let images = [plain.film.image(), with.film.image()];
        match off {
            0.0 => assert_eq!(images[0].pixels, images[1].pixels, "{forced}"),
            off => {
                let [before, after] = images.map(|image| image.channel_means()[0]);
                assert!((after / before - 1.0).abs() < off, "{forced}: {before}, then {after}");
            }
        }
        for (name, found, before) in [
            ("volume_photons", with.stats.volume, plain.stats.volume),
            ("caustic_photons", with.stats.caustic, plain.stats.caustic),
            ("global_photons", with.stats.global, plain.stats.global),
            ("shadow_photons", with.stats.shadow, plain.stats.shadow),
        ] {
            let told = forecast.item(name).unwrap();
            assert_eq!(told.forced, found > 0 && before == 0, "{forced}: {name}");
            assert!(told.count.unwrap_or(0).abs_diff(found) as f64 <= 0.1 * found as f64, "{forced}: {name}");
        }
        let bytes = forecast.bytes.volume_map + forecast.bytes.surface_maps;
        let found = with.stats.map_bytes + with.stats.surface_bytes;
        assert!(bytes.abs_diff(found) as f64 <= 0.2 * found as f64, "{forced}: {bytes} told, {found} found");
    }
}

/// Air without an end under a sun is left to paths where few photons would come near, or where the camera sees farther than they are traced; who
/// asks for photons is told. Fog no wider than the scene is left to photons, and so is smoke, which has an end.
#[test]
fn air_without_an_end_is_left_to_paths() {
    let thins = |height: f64| format!("{{ type = \"exponential\", scale_height = {height} }}");
    let smoke = "{ type = \"vdb\", file = \"../../media/smoke.vdb\", transform = [{ scale = 100 }] }".to_string();
    let air = |sigma: f64, density: &str, camera: &str| {
        format!(
            "[film]\nwidth = 24\nheight = 16\n[camera]\n{camera}\n\
             [media.air]\nsigma_s = {sigma}\nsigma_a = {}\ndensity = {density}\n\
             [world]\nmedium = \"air\"\n\
             [materials.white]\ntype = \"lambert\"\nreflectance = 0.5\n\
             [[shapes]]\ntype = \"box\"\nmin = [-20, -1, -20]\nmax = [20, 0, 20]\nmaterial = \"white\"\n\
             [[lights]]\ntype = \"directional\"\ndirection = [1, -1, 0]\nirradiance = 3\n",
            0.1 * sigma
        )
    };
    let down = "position = [0, 30, 10]\ntarget = [0, 0, 0]";
    let far = "position = [0, 12, 10]\ntarget = [0, 11, 0]";
    for (sigma, density, camera, why) in [
        (0.02, thins(4.0), down, Some("times as wide")),
        (0.5, thins(1.0), far, Some("farther away")),
        (0.5, thins(1.0), down, None),
        (0.02, smoke, down, None),
    ] {
        let told = |automatic: bool| {
            let text = air(sigma, &density, camera);
            let (scene, mut settings) = built(&text, &["render.samples=1", "photons.volume=2000"]);
            if automatic {
                settings.render.automatic = true;
                return choose(&scene, &settings).unwrap().expect("is left to the plan").why;
            }
            settings.render.method = Method::Photon;
            let stop = AtomicBool::new(false);
            render(&scene, &settings, &Silent, &stop).unwrap().warnings.join("\n")
        };
        for told in [told(true), told(false)] {
            let is_told = told.contains("times as wide") || told.contains("farther away");
            assert!(why.map_or(!is_told, |why| told.contains(why)), "{sigma}, {camera}: {told}");
        }
    }
}
