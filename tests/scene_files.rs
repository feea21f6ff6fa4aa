//! Scene files mean what the manual says, and what is wrong in them is named with its place.

use std::path::{Path, PathBuf};

use volpm::light::Sides;
use volpm::math::random::{Purpose, Stream};
use volpm::math::{DVec2, DVec3, Rgb};
use volpm::medium::density::bricks::{Interpolation, NegativePolicy};
use volpm::medium::density::{Exponential, Noise};
use volpm::medium::phase::{HenyeyGreenstein, Isotropic, Mixture, Rayleigh, Schlick, mie};
use volpm::scene::description::*;
use volpm::surface::{self, Dielectric, Lambert, Mirror, Reflector};
use volpm::{Error, scene};

/// Every table, with a value for every key that is supported.
const SAMPLE: &str = r#"title = "all of it"

[film]
width = 320
height = 200
filter = "tent"
exposure = -1
tone_map = "linear"
layers = false
standard_error = true
crop = [20, 10, 100, 150]

[camera]
position = [0.0, 1.0, 6.0]
target = [0, 1, 0]
up = [0, 2, 0]
projection = "orthographic"
fov = 30
fov_axis = "smaller"
aperture = 0.1
focus_distance = 5.0

[world]
medium = "fog"
unit = "cm"

[media.smoke]
sigma_t = 20.0
albedo = [0.95, 0.5, 0]
density = { type = "vdb", file = "../media/smoke.vdb", grid = "soot", transform = [{ scale = 0.5 }, { translate = [1, 2, 3] }], interpolation = "nearest", negative = "zero" }
emission = { temperature = "heat", kelvin_scale = 2, scale = 1e-3 }

[media.fog]
sigma_s = [0.02, 0.03, 0.04]
sigma_a = 0.5
scale = 2
add = true
phase = { type = "hg", g = -0.75 }
density = { type = "exponential", origin = [0, 1, 0], up = [0, 2, 0], scale_height = 3, value = 4 }
emission = { radiance = [1, 2, 3], scale = 2 }

[media.cloud]
sigma_s = 1
phase = { type = "mixture", lobes = [{ weight = 0.75, type = "schlick", k = 0.5 }, { weight = 0.25, type = "rayleigh" }] }
density = { type = "array", file = "/data/cloud.npy", min = [0, 0, 0], max = [1, 2, 3] }

[materials]
white = { type = "lambert", reflectance = 0.75 }
chrome = { type = "mirror", reflectance = [0.9, 0.8, 0.7] }
"my glass" = { type = "dielectric", ior = [1.5, 1.504, 1.513], roughness = 0.25 }

[[shapes]]
type = "quad"
origin = [-5, 0, -5]
edge_u = [0, 0, 10]
edge_v = [10, 0, 0]
material = "white"

[[shapes]]
name = "haze"
type = "box"
min = [-1, 0, -1]
max = [1, 3, 1]
interior = "smoke"
priority = -2
visible = false
casts_caustics = false

[[shapes]]
type = "sphere"
center = [3, 5, 2]
radius = 0.25
emission = { power = 60, side = "both" }

[[shapes]]
type = "disk"
center = [0, 0, 0]
normal = [0, 0, 2]
radius = 1
material = "chrome"
receives_caustics = false

[[shapes]]
type = "cylinder"
base = [0, 0, 0]
top = [0, 1, 0]
radius = 1
caps = true
material = "my glass"

[[shapes]]
type = "mesh"
file = "bunny.obj"
smooth = false
transform = [{ rotate = { axis = [0, 0, 3], angle = 90 } }, { matrix = [1, 0, 0, 7, 0, 1, 0, 8, 0, 0, 1, 9, 0, 0, 0, 1] }]
material = "none"
interior = "fog"

[[shapes]]
type = "instance"
of = "haze"
transform = [{ translate = [1, 0, 0] }]

[[shapes]]
type = "lathe"
profile = [[0, -1], [2, 0.5]]
segments = 7
crease = 12.5
material = "white"

[[lights]]
name = "lamp"
type = "spot"
position = [0, 4, 0]
target = [0, 0, 0]
power = 6.283185307179586
inner_angle = 60
outer_angle = 90
radius = 0.5

[[lights]]
type = "point"
position = [1, 2, 3]
intensity = [1, 2, 3]

[[lights]]
type = "directional"
direction = [0, -2, 0]
irradiance = 3
angle = 0.5
center = [0, 9, 0]
radius = 2

[[lights]]
type = "environment"
file = "sky.hdr"
scale = 2
rotate = 45

[[lights]]
type = "sky"
sun = [0, 2, 0]
turbidity = 2.5
ground = [0.1, 0.2, 0.3]
scale = 0.01
sun_scale = 0

[render]
method = "path"
samples = 8
adaptive = false
light_samples = 4
passes = 3
seed = 18446744073709551615
max_depth = 3
quality = "high"

[photons]
volume = 1_000
max_emitted = 2_000
projection = false
importance = true
density_control = true
emission = "random"

[volume]
estimate = "point"
kernel = "fixed"
profile = "epanechnikov"
radius = 0.1
neighbours = 50
pilot = 8
max_radius = 0.5
boundaries = "share"
single_scattering = "approximate"
peaks = "photons"
march = { step = "adaptive", size = 0.25, contrast = 0.3 }
"#;

const CAMERA: &str = "[camera]\nposition = [0, 0, 4]\ntarget = [0, 0, 0]\n";

fn parse(text: &str, overrides: &[&str]) -> Result<Description, Error> {
    let overrides: Vec<String> = overrides.iter().map(|text| text.to_string()).collect();
    scene::parse(text, Path::new("scenes/x.toml"), &overrides)
}

fn sample() -> Description {
    parse(SAMPLE, &[]).expect("the sample is a valid scene")
}

/// What is wrong with `text`.
fn complaint(text: &str, overrides: &[&str]) -> String {
    match parse(text, overrides) {
        Err(Error::Scene(message)) => message,
        other => panic!("expected an error about the scene, got {other:?} from\n{text}"),
    }
}

#[test]
fn every_key_is_read_as_the_manual_says() {
    let scene = sample();
    assert_eq!(scene.title.as_deref(), Some("all of it"));
    assert_eq!(
        scene.film,
        Film {
            width: 320,
            height: 200,
            crop: Some(Window { x: 20, y: 10, width: 100, height: 150 }),
            filter: Filter::Tent,
            exposure: Some(-1.0),
            tone_map: ToneMap::Linear,
            layers: false,
            standard_error: true,
        }
    );
    let camera = &scene.camera;
    assert_eq!((camera.position, camera.target), (DVec3::new(0.0, 1.0, 6.0), DVec3::Y));
    assert_eq!((camera.up, camera.fov), (2.0 * DVec3::Y, 30.0));
    assert_eq!((camera.aperture, camera.focus_distance), (0.1, 5.0));
    assert_eq!((camera.projection, camera.fov_axis), (Projection::Orthographic, FovAxis::Smaller));
    assert_eq!(scene.world.unit, Unit::Centimetre);
    assert_eq!(scene.world.medium.map(|medium| medium.value), Some(1));

    // Media keep the order of the file.
    let [smoke, fog, cloud] = scene.media.as_slice() else { panic!("{:?}", scene.media) };
    assert_eq!([&smoke.name, &fog.name, &cloud.name], ["smoke", "fog", "cloud"]);
    assert!(smoke.sigma_s.abs_diff_eq(Rgb::new(19.0, 10.0, 0.0), 1e-14));
    assert!(smoke.sigma_a.abs_diff_eq(Rgb::new(1.0, 10.0, 20.0), 1e-14));
    assert!(smoke.albedo().abs_diff_eq(Rgb::new(0.95, 0.5, 0.0), 1e-15));
    let Density::Vdb { file, grid, transform, interpolation, negative } = &smoke.density else { panic!("{smoke:?}") };
    assert_eq!(file.value, PathBuf::from("scenes/../media/smoke.vdb"));
    assert_eq!(file.place.to_string(), "scenes/x.toml:30:34: media.smoke.density.file");
    assert_eq!(grid.as_ref().map(|grid| grid.value.as_str()), Some("soot"));
    assert_eq!(transform.transform_point3(DVec3::splat(4.0)), DVec3::new(3.0, 4.0, 5.0));
    assert_eq!((*interpolation, *negative), (Interpolation::Nearest, NegativePolicy::Zero));
    let Some(MediumEmission::BlackBody { temperature, kelvin_scale, scale }) = &smoke.emission else { panic!() };
    assert_eq!((temperature.value.as_str(), *kelvin_scale, *scale), ("heat", 2.0, 1e-3));

    assert_eq!((fog.sigma_s, fog.sigma_a), (Rgb::new(0.04, 0.06, 0.08), Rgb::ONE));
    assert!(fog.adds && !smoke.adds);
    assert_eq!(fog.phase, HenyeyGreenstein { g: -0.75 }.into());
    let up = 2.0 * DVec3::Y;
    assert_eq!(fog.density, Density::Exponential(Exponential { origin: DVec3::Y, up, scale_height: 3.0, value: 4.0 }));
    assert_eq!(fog.emission, Some(MediumEmission::Constant { radiance: Rgb::new(2.0, 4.0, 6.0) }));

    assert_eq!((cloud.sigma_s, cloud.sigma_a), (Rgb::ONE, Rgb::ZERO));
    assert_eq!(cloud.phase, Mixture::new(vec![(0.75, Schlick { k: 0.5 }.into()), (0.25, Rayleigh.into())]).into());
    let Density::Array { file, min, max } = &cloud.density else { panic!("{cloud:?}") };
    assert_eq!(
        (file.value.as_path(), *min, *max),
        (Path::new("/data/cloud.npy"), DVec3::ZERO, DVec3::new(1.0, 2.0, 3.0))
    );

    let kinds: Vec<_> = scene.materials.iter().map(|material| (material.name.as_str(), material.kind)).collect();
    let expected = [
        ("white", Reflector::Lambert(Lambert { reflectance: Rgb::splat(0.75) }).into()),
        ("chrome", Reflector::Mirror(Mirror { reflectance: Rgb::new(0.9, 0.8, 0.7) }).into()),
        ("my glass", Dielectric { index: Rgb::new(1.5, 1.504, 1.513), roughness: 0.25 }.into()),
        ("none", surface::Material::None),
        ("black", Reflector::Lambert(Lambert { reflectance: Rgb::ZERO }).into()),
    ];
    assert_eq!(kinds, expected);

    let materials: Vec<_> = scene.shapes.iter().map(|shape| shape.material.value).collect();
    assert_eq!(materials, [0, 3, 4, 1, 2, 3, 3, 0]);
    let interiors: Vec<_> =
        scene.shapes.iter().map(|shape| shape.interior.as_ref().map(|medium| medium.value)).collect();
    assert_eq!(interiors, [None, Some(0), None, None, None, Some(1), Some(0), None]);
    let [quad, haze, lamp, disk, cylinder, mesh, instance, lathe] = scene.shapes.as_slice() else { panic!() };
    let edges = (10.0 * DVec3::Z, 10.0 * DVec3::X);
    assert_eq!(quad.kind, ShapeKind::Quad { origin: DVec3::new(-5.0, 0.0, -5.0), edge_u: edges.0, edge_v: edges.1 });
    let (min, max) = (DVec3::new(-1.0, 0.0, -1.0), DVec3::new(1.0, 3.0, 1.0));
    assert_eq!(haze.kind, ShapeKind::Box { min, max });
    assert_eq!((haze.name.as_deref(), haze.priority, haze.visible), (Some("haze"), -2, false));
    assert_eq!(lamp.kind, ShapeKind::Sphere { center: DVec3::new(3.0, 5.0, 2.0), radius: 0.25 });
    let emission = lamp.emission.as_ref().expect("the sphere is a light");
    assert_eq!((emission.strength, emission.side), (Strength::Power(Rgb::splat(60.0)), Sides::Both));
    assert_eq!(disk.kind, ShapeKind::Disk { center: DVec3::ZERO, normal: DVec3::Z, radius: 1.0 });
    assert_eq!(cylinder.kind, ShapeKind::Cylinder { base: DVec3::ZERO, top: DVec3::Y, radius: 1.0, caps: true });
    let ShapeKind::Mesh { file, smooth: false } = &mesh.kind else { panic!("{mesh:?}") };
    assert_eq!(file.value, PathBuf::from("scenes/bunny.obj"));
    // A right-handed quarter turn about z, then the shift of the matrix's last column.
    assert!(mesh.transform.transform_point3(DVec3::X).abs_diff_eq(DVec3::new(7.0, 9.0, 9.0), 1e-15));
    let profile = vec![DVec2::new(0.0, -1.0), DVec2::new(2.0, 0.5)];
    assert_eq!(lathe.kind, ShapeKind::Lathe { profile, segments: Some(7), crease: 12.5 });
    assert_eq!((&instance.kind, instance.priority, instance.visible), (&ShapeKind::Instance { of: 1 }, -2, true));
    let caustics = [quad, haze, instance, disk].map(|shape| (shape.caustics.casts, shape.caustics.receives));
    assert_eq!(caustics, [(true, true), (false, true), (false, true), (true, false)]);

    let [spot, point, directional, environment, sky] = scene.lights.as_slice() else { panic!() };
    let LightKind::Spot { direction, intensity, inner_angle, outer_angle, radius, .. } = spot.kind else { panic!() };
    assert_eq!((direction, inner_angle, outer_angle, radius), (-DVec3::Y, 60.0, 90.0, 0.5));
    // 2π W over 2π[(1 − ½) + (½ − 0)/2] sr.
    assert!(intensity.abs_diff_eq(Rgb::splat(1.0 / 0.75), 1e-14), "{intensity}");
    let position = DVec3::new(1.0, 2.0, 3.0);
    assert_eq!(point.kind, LightKind::Point { position, intensity: position, radius: 0.0 });
    let beam = Some(Beam { center: 9.0 * DVec3::Y, radius: 2.0 });
    let irradiance = Rgb::splat(3.0);
    assert_eq!(directional.kind, LightKind::Directional { direction: -DVec3::Y, irradiance, angle: 0.5, beam });
    let LightKind::Environment { source: EnvironmentSource::Image(file), scale, rotate } = &environment.kind else {
        panic!()
    };
    assert_eq!((file.value.as_path(), *scale, *rotate), (Path::new("scenes/sky.hdr"), Rgb::splat(2.0), 45.0));
    let (sun, ground) = (DVec3::Y, Rgb::new(0.1, 0.2, 0.3));
    let (scale, sun_scale) = (Rgb::splat(0.01), Rgb::ZERO);
    assert_eq!(sky.kind, LightKind::Sky { sun, turbidity: 2.5, ground, scale, sun_scale });

    assert_eq!(
        scene.render,
        Render {
            method: Method::Path,
            automatic: false,
            quality: Quality::High,
            samples: 8,
            adaptive: false,
            light_samples: 4,
            passes: 3,
            seed: u64::MAX,
            max_depth: 3
        }
    );
    let photons = Photons {
        volume: Some(1000),
        global: None,
        caustic: None,
        max_emitted: 2000,
        projection: false,
        emission: PhotonEmission::Random,
        importance: true,
        density_control: true,
    };
    assert_eq!(scene.photons, photons);
    let volume = Volume {
        estimate: Estimate::Point,
        kernel: Kernel::Fixed,
        profile: Some(Profile::Epanechnikov),
        radius: Some(0.1),
        neighbours: Some(50),
        pilot: Some(8),
        max_radius: Some(0.5),
        boundaries: Boundaries::Share,
        single_scattering: SingleScattering::Approximate,
        peaks: Peaks::Photons,
        march: Some(March { step: Step::Adaptive, size: Some(0.25), contrast: 0.3 }),
    };
    assert_eq!(scene.volume, volume);
}

#[test]
fn a_camera_is_enough() {
    let scene = parse(CAMERA, &[]).expect("everything else has a default");
    assert_eq!((scene.film.width, scene.film.height, scene.film.filter), (640, 480, Filter::Box));
    assert_eq!((scene.film.exposure, scene.film.tone_map), (None, ToneMap::Filmic));
    assert_eq!((scene.camera.up, scene.camera.fov, scene.camera.focus_distance), (DVec3::Y, 40.0, 4.0));
    assert_eq!((scene.camera.projection, scene.camera.fov_axis), (Projection::Perspective, FovAxis::Y));
    assert_eq!((scene.film.crop, scene.film.size()), (None, (640, 480)));
    assert_eq!(
        scene.render,
        Render {
            method: Method::Photon,
            automatic: true,
            quality: Quality::Normal,
            samples: 16,
            adaptive: true,
            light_samples: 1,
            passes: 1,
            seed: 1,
            max_depth: 0
        }
    );
    assert_eq!((scene.volume.kernel, scene.volume.estimate), (Kernel::Variable, Estimate::Beam));
    assert_eq!(scene.volume.march, None);
    assert_eq!((scene.photons.volume, scene.photons.max_emitted), (None, 50_000_000));
    assert_eq!((scene.photons.projection, scene.photons.emission), (true, PhotonEmission::Qmc));
    assert_eq!(scene.surface.accurate_distance, None);
    assert!(scene.warnings[0].contains("nothing gives light"), "{:?}", scene.warnings);
}

/// Scenes that are wrong where the mark `‸` stands: text after the camera, the key, a part of the message.
const MISTAKES: &[(&str, &str, &str)] = &[
    // Unknown keys and names.
    (
        "[media.fog]\n‸sgima_s = 1\n",
        "media.fog.sgima_s",
        "unknown key; did you mean `sigma_s`? (keys here: phase, sigma_s, sigma_a",
    ),
    ("[‸flim]\n", "flim", "did you mean `film`?"),
    ("[film]\n‸wdith = 1\n", "film.wdith", "did you mean `width`?"),
    ("[render]\n‸max-depth = 1\n", "render.max-depth", "did you mean `max_depth`?"),
    ("[volume]\n‸neighbors = 5\n", "volume.neighbors", "did you mean `neighbours`?"),
    ("[volume]\nmarch = { ‸stp = \"uniform\" }\n", "volume.march.stp", "did you mean `step`?"),
    ("[surface]\n‸indirekt = \"none\"\n", "surface.indirekt", "did you mean `indirect`?"),
    ("[photons]\n‸causstic = 1\n", "photons.causstic", "did you mean `caustic`?"),
    (
        "[world]\nmedium = ‸\"fgo\"\n[media.fog]\nsigma_s = 1\n",
        "world.medium",
        "no medium is named \"fgo\"; did you mean `fog`?",
    ),
    ("[world]\nmedium = ‸\"fog\"\n", "world.medium", "there is none"),
    (
        "[materials.white]\ntype = \"lambert\"\n[[shapes]]\ntype = \"sphere\"\ncenter = [0, 0, 0]\nradius = 1\nmaterial = ‸\"whit\"\n",
        "shapes.0.material",
        "no material is named \"whit\"; did you mean `white`? (there are white, none)",
    ),
    (
        "[[shapes]]\ntype = \"sphere\"\ncenter = [0, 0, 0]\nradius = 1\ninterior = ‸\"fog\"\n",
        "shapes.0.interior",
        "no medium is named",
    ),
    (
        "[[shapes]]\nname = \"a\"\ntype = \"instance\"\nof = ‸\"b\"\n",
        "shapes.a.of",
        "no shape is named \"b\"; did you mean `a`?",
    ),
    ("[[shapes]]\ntype = ‸\"spere\"\n", "shapes.0.type", "did you mean `sphere`?"),
    (
        "[[shapes]]\ntype = \"sphere\"\n‸centre = [0, 0, 0]\ncenter = [0, 0, 0]\nradius = 1\nmaterial = \"none\"\n",
        "shapes.0.centre",
        "did you mean `center`?",
    ),
    (
        "[film]\nfilter = ‸\"Tent\"\n",
        "film.filter",
        "found \"Tent\"; expected one of \"box\", \"tent\", \"gaussian\"; did you mean `tent`?",
    ),
    ("[media.a]\nsigma_s = 1\nphase = { type = ‸\"HG\", g = 0 }\n", "media.a.phase.type", "did you mean `hg`?"),
    (
        "[materials.a]\ntype = \"lambert\"\nreflectance = { texture = ‸\"chequer\" }\n",
        "materials.a.reflectance.texture",
        "did you mean `checker`?",
    ),
    ("‸[materials.none]\ntype = \"mirror\"\n", "materials.none", "expected another name"),
    // Wrong types.
    ("[film]\nwidth = ‸16.5\n", "film.width", "found 16.5; expected an integer from 1 to 4294967295"),
    ("[film]\nwidth = ‸\"wide\"\n", "film.width", "found \"wide\""),
    ("[film]\nlayers = ‸1\n", "film.layers", "found 1; expected true or false"),
    ("film = ‸3\n", "film", "found 3; expected a table"),
    ("[media]\nfog = ‸2\n", "media.fog", "expected a table"),
    ("‸[shapes]\ntype = \"sphere\"\n", "shapes", "expected an array of tables, [[shapes]]"),
    ("shapes = [‸1]\n", "shapes.0", "expected a table"),
    (
        "[media.a]\nsigma_s = ‸[1, 2]\n",
        "media.a.sigma_s",
        "found [1, 2]; expected a finite number of at least 0, or three of them",
    ),
    ("[[lights]]\ntype = \"point\"\nposition = [0, ‸true, 0]\nintensity = 1\n", "lights.0.position.1", "found true"),
    ("[film]\nwidth = ‸1979-05-27\n", "film.width", "the date"),
    // Out of range.
    ("[film]\nwidth = ‸0\n", "film.width", "found 0; expected an integer from 1"),
    ("[film]\nheight = ‸-1\n", "film.height", "found -1"),
    ("[film]\nwidth = ‸100000\nheight = 100000\n", "film.width", "100000 × 100000 pixels take 112 GiB"),
    ("[film]\ncrop = ‸[0, 0, 640]\n", "film.crop", "expected four integers, [x, y, width, height]"),
    ("[film]\ncrop = [0, 0, ‸0, 1]\n", "film.crop.2", "found 0; expected an integer from 1"),
    ("[film]\ncrop = ‸[600, 0, 41, 1]\n", "film.crop", "expected a part of the film of 640 × 480 pixels"),
    ("[film]\ncrop = ‸[0, 4294967295, 1, 2]\n", "film.crop", "expected a part of the film of 640 × 480 pixels"),
    ("[photons]\nemission = ‸\"sobol\"\n", "photons.emission", "expected one of \"qmc\", \"random\""),
    ("[photons]\nprojection = ‸1\n", "photons.projection", "found 1; expected true or false"),
    ("[surface]\naccurate_distance = ‸-1\n", "surface.accurate_distance", "found -1; expected 0, or a number above 0"),
    (
        "[surface]\nestimate = \"sheets\"\ndifferential_checking = ‸true\n",
        "surface.differential_checking",
        "sheets have radii of their own",
    ),
    ("[volume]\nboundaries = ‸\"leen\"\n", "volume.boundaries", "found \"leen\"; expected one of"),
    ("[volume]\nmarch = { step = ‸\"rnd\" }\n", "volume.march.step", "found \"rnd\"; expected one of"),
    (
        "[[shapes]]\ntype = \"sphere\"\ncenter = [0, 0, 0]\nradius = 1\nmaterial = \"none\"\ncasts_caustics = ‸\"no\"\n",
        "shapes.0.casts_caustics",
        "found \"no\"; expected true or false",
    ),
    // Still to come.
    ("[photons]\nimportance = ‸\"eye\"\n", "photons.importance", "expected true or false"),
    ("[render]\nquality = ‸\"best\"\n", "render.quality", "draft"),
    ("[media.a]\nsigma_s = 1\nadd = ‸1\n", "media.a.add", "found 1; expected true or false"),
    (
        "[media.a]\nsigma_s = 1\ndensity = { type = \"noise\", precision = ‸\"double\" }\n",
        "media.a.density.precision",
        "found \"double\"; expected one of \"full\", \"half\"",
    ),
    ("[render]\nsamples = ‸0\n", "render.samples", "found 0"),
    ("[render]\nlight_samples = ‸0\n", "render.light_samples", "found 0; expected an integer from 1 to 4096"),
    ("[render]\nlight_samples = ‸-1\n", "render.light_samples", "found -1; expected an integer from 1 to 4096"),
    ("[render]\nlight_samples = ‸5000\n", "render.light_samples", "found 5000; expected an integer from 1 to 4096"),
    ("[render]\nseed = ‸-1\n", "render.seed", "found -1"),
    ("[media.a]\nsigma_s = ‸-0.5\n", "media.a.sigma_s", "found -0.5; expected a finite number of at least 0"),
    ("[media.a]\nsigma_s = [1, 2, ‸nan]\n", "media.a.sigma_s.2", "found nan"),
    ("[media.a]\nsigma_a = ‸inf\n", "media.a.sigma_a", "found inf"),
    ("‸[media.a]\nsigma_a = 1e300\nscale = 1e300\n", "media.a", "exceed the range"),
    (
        "[media.a]\nsigma_t = 1\nalbedo = [0.5, ‸1.01, 0]\n",
        "media.a.albedo.1",
        "found 1.01; expected a number from 0 to 1",
    ),
    (
        "[media.a]\nsigma_s = 1\nphase = { type = \"hg\", g = ‸1 }\n",
        "media.a.phase.g",
        "found 1; expected a number above -1 and below 1",
    ),
    ("[media.a]\nsigma_s = 1\nphase = { type = \"schlick\", k = ‸-1.0 }\n", "media.a.phase.k", "found -1.0"),
    (
        "[media.a]\nsigma_s = 1\nphase = { type = \"mixture\", lobes = ‸[{ weight = 0.5, type = \"rayleigh\" }] }\n",
        "media.a.phase.lobes",
        "the weights sum to 0.5; expected 1",
    ),
    ("[media.a]\nsigma_s = 1\ndensity = { type = \"constant\", value = ‸-1 }\n", "media.a.density.value", "found -1"),
    (
        "[media.a]\nsigma_s = 1\ndensity = { type = \"exponential\", scale_height = ‸0 }\n",
        "media.a.density.scale_height",
        "found 0",
    ),
    (
        "[materials.a]\ntype = \"lambert\"\nreflectance = ‸1.5\n",
        "materials.a.reflectance",
        "found 1.5; expected a number from 0 to 1",
    ),
    ("[materials.a]\ntype = \"dielectric\"\nior = ‸0\n", "materials.a.ior", "found 0"),
    (
        "[[shapes]]\ntype = \"sphere\"\ncenter = [0, 0, 0]\nradius = ‸0\nmaterial = \"none\"\n",
        "shapes.0.radius",
        "found 0; expected a number above 0",
    ),
    (
        "[[shapes]]\ntype = \"box\"\nmin = [0, 0, 0]\nmax = ‸[1, 0, 1]\nmaterial = \"none\"\n",
        "shapes.0.max",
        "expected a point above `min`",
    ),
    (
        "[[shapes]]\ntype = \"quad\"\norigin = [0, 0, 0]\nedge_u = [1, 0, 0]\nedge_v = ‸[-2, 0, 0]\nmaterial = \"none\"\n",
        "shapes.0.edge_v",
        "is parallel to `edge_u`",
    ),
    (
        "[[shapes]]\ntype = \"disk\"\ncenter = [0, 0, 0]\nnormal = ‸[0, 0, 0]\nradius = 1\nmaterial = \"none\"\n",
        "shapes.0.normal",
        "expected a vector that is not 0",
    ),
    (
        "[[shapes]]\ntype = \"sphere\"\ncenter = [0, 0, 0]\nradius = 1\nmaterial = \"none\"\npriority = ‸0.5\n",
        "shapes.0.priority",
        "expected an integer",
    ),
    (
        "[[lights]]\ntype = \"spot\"\nposition = [0, 1, 0]\ntarget = [0, 0, 0]\nintensity = 1\ninner_angle = ‸20\nouter_angle = 10\n",
        "lights.0.inner_angle",
        "expected at most `outer_angle`, 10",
    ),
    (
        "[[lights]]\ntype = \"spot\"\nposition = [0, 1, 0]\ntarget = [0, 0, 0]\nintensity = 1\nouter_angle = ‸100\n",
        "lights.0.outer_angle",
        "found 100",
    ),
    (
        "[[lights]]\ntype = \"spot\"\nposition = [0, 1, 0]\ntarget = ‸[0, 1, 0]\nintensity = 1\n",
        "lights.0.target",
        "where the light stands",
    ),
    ("[volume]\nradius = ‸-1\n", "volume.radius", "found -1"),
    ("[volume]\npilot = ‸4\n", "volume.pilot", "found 4; expected an integer from 5"),
    ("[photons]\nvolume = ‸0\n", "photons.volume", "found 0"),
    // Missing and contradicting keys.
    ("‸[media.a]\n", "media.a", "has no coefficients"),
    ("‸[media.a]\nsigma_t = 1\n", "media.a.albedo", "is missing beside `sigma_t`"),
    ("[media.a]\nsigma_t = ‸1\nsigma_s = 1\n", "media.a.sigma_t", "`sigma_s` is given too"),
    ("[media.a]\nsigma_a = 1\nalbedo = ‸1\n", "media.a.albedo", "`sigma_a` is given too"),
    (
        "[media.a]\nsigma_a = 1\nemission = { temperature = ‸\"t\" }\n",
        "media.a.emission.temperature",
        "expected a `density` of type \"vdb\"",
    ),
    ("[media.a]\nsigma_a = 1\nemission = ‸{}\n", "media.a.emission", "needs `radiance`, `temperature` or `grid`"),
    ("[media.a]\nsigma_a = 1\nphase = ‸{ g = 0 }\n", "media.a.phase.type", "is missing"),
    (
        "[media.a]\nsigma_a = 1\ndensity = { type = \"array\", file = ‸\"a.vdb\", min = [0, 0, 0], max = [1, 1, 1] }\n",
        "media.a.density.file",
        "ends in .npy",
    ),
    ("‸[[shapes]]\ntype = \"sphere\"\ncenter = [0, 0, 0]\nmaterial = \"none\"\n", "shapes.0.radius", "is missing"),
    ("‸[[shapes]]\ntype = \"sphere\"\ncenter = [0, 0, 0]\nradius = 1\n", "shapes.0", "needs a `material`"),
    (
        "[[shapes]]\ntype = \"sphere\"\ncenter = [0, 0, 0]\nradius = 1\nemission = { radiance = 1, power = ‸1 }\n",
        "shapes.0.emission.power",
        "expected only one of them",
    ),
    (
        "[media.a]\nsigma_a = 1\n[[shapes]]\ntype = \"disk\"\ncenter = [0, 0, 0]\nnormal = [0, 0, 1]\nradius = 1\ninterior = ‸\"a\"\n",
        "shapes.0.interior",
        "a disk is not closed",
    ),
    (
        "[materials.a]\ntype = \"dielectric\"\n[[shapes]]\ntype = \"cylinder\"\nbase = [0, 0, 0]\ntop = [0, 0, 1]\nradius = 1\ncaps = false\nmaterial = ‸\"a\"\n",
        "shapes.0.material",
        "a cylinder without caps is not closed",
    ),
    (
        "[materials.a]\ntype = \"schlick\"\nlayer = { f0 = ‸2 }\n",
        "materials.a.layer.f0",
        "found 2; expected a number from 0 to 1",
    ),
    (
        "[materials.a]\ntype = \"coated\"\nbase = { type = \"schlick\", layer = ‸{ f0 = 1 } }\n",
        "materials.a.base.layer",
        "has one layer; expected no second one",
    ),
    (
        "[materials.a]\ntype = \"coated\"\nbase = { type = \"mix\", a = \"none\", b = { type = ‸\"dielectric\" } }\n",
        "materials.a.base.b.type",
        "found \"dielectric\"",
    ),
    (
        "[materials.b]\ntype = \"coated\"\nbase = \"a\"\n[materials.a]\ntype = \"mix\"\na = \"none\"\nb = ‸\"a\"\n",
        "materials.a.b",
        "mixtures of mixtures are deeper here than 8",
    ),
    ("[materials.a]\ntype = \"mix\"\na = \"none\"\nb = ‸\"a\"\n", "materials.a.b", "\"a\" is made of itself"),
    (
        "[materials.a]\ntype = \"mix\"\na = \"none\"\nb = { type = \"mix\", a = \"none\", b = ‸\"a\" }\n",
        "materials.a.b.b",
        "\"a\" is made of itself",
    ),
    (
        "[materials.a]\ntype = \"mix\"\na = \"none\"\nb = ‸{ type = \"dielectric\" }\n",
        "materials.a.b",
        "is a dielectric, which has two sides; expected",
    ),
    (
        "[materials.a]\ntype = \"mix\"\na = \"none\"\nb = { type = \"lambert\", reflectance = ‸2 }\n",
        "materials.a.b.reflectance",
        "found 2; expected a number from 0 to 1",
    ),
    (
        "[[lights]]\ntype = \"point\"\nposition = [0, 0, 0]\npower = 1\nprofile = \"a.ies\"\nradius = ‸1\n",
        "lights.0.radius",
        "has no meaning beside `profile`",
    ),
    (
        "[[lights]]\ntype = \"point\"\nposition = [0, 0, 0]\npower = 1\ndirection = ‸[0, 1, 0]\n",
        "lights.0.direction",
        "has no meaning without `profile`",
    ),
    (
        "[[lights]]\ntype = \"spot\"\nposition = [0, 0, 0]\ntarget = [1, 0, 0]\npower = 1\nprofile = \"a.ldt\"\nouter_angle = ‸9\n",
        "lights.0.outer_angle",
        "has no meaning beside `profile`",
    ),
    (
        "[media.a]\nsigma_a = 1\n[[shapes]]\ntype = \"lathe\"\nprofile = [[0, 0], [1, 1], [1, 2]]\ninterior = ‸\"a\"\n",
        "shapes.0.interior",
        "a lathe whose profile neither begins and ends on the axis",
    ),
    (
        "[[shapes]]\ntype = \"lathe\"\nprofile = [[0, 0], ‸[1, 1, 2]]\nmaterial = \"none\"\n",
        "shapes.0.profile.1",
        "expected two numbers, [radius, height]",
    ),
    (
        "[[shapes]]\nname = \"é\"\ntype = \"sphere\"\ncenter = [0, 0, 0]\nradius = 1\nmaterial = \"none\"\n‸[[shapes]]\nname = \"é\"\ntype = \"sphere\"\ncenter = [0, 0, 0]\nradius = 1\nmaterial = \"none\"\n",
        "shapes.\"é\"",
        "another shape is named",
    ),
    (
        "‸[[shapes]]\nname = \"a\"\ntype = \"instance\"\nof = \"b\"\n[[shapes]]\nname = \"b\"\ntype = \"instance\"\nof = \"a\"\n",
        "shapes.a",
        "a → b → a",
    ),
    (
        "‸[[lights]]\ntype = \"directional\"\ndirection = [0, -1, 0]\nirradiance = 1\ncenter = [0, 0, 0]\n",
        "lights.0.radius",
        "is missing beside `center`",
    ),
    ("[[lights]]\ntype = \"sky\"\nsun = ‸[0, 0, 0]\n", "lights.0.sun", "expected a vector that is not 0"),
    ("[[lights]]\ntype = \"sky\"\nsun = ‸[1, -0.01, 0]\n", "lights.0.sun", "the sun is below the horizon"),
    (
        "[[lights]]\ntype = \"sky\"\nsun = [0, 1, 0]\nturbidity = ‸11\n",
        "lights.0.turbidity",
        "found 11; expected a number from 1 to 10",
    ),
    (
        "[[lights]]\ntype = \"sky\"\nsun = [0, 1, 0]\nground = [0, ‸1.5, 0]\n",
        "lights.0.ground.1",
        "found 1.5; expected a number from 0 to 1",
    ),
    (
        "[[lights]]\ntype = \"sky\"\nsun = [0, 1, 0]\nsun_scale = ‸-1\n",
        "lights.0.sun_scale",
        "found -1; expected a finite number of at least 0",
    ),
    ("‸[[lights]]\ntype = \"sky\"\n", "lights.0.sun", "is missing"),
    ("‸[[lights]]\ntype = \"point\"\nposition = [0, 0, 0]\n", "lights.0", "needs `intensity` or `power`"),
    // Transforms.
    (
        "[[shapes]]\ntype = \"sphere\"\ncenter = [0, 0, 0]\nradius = 1\nmaterial = \"none\"\ntransform = [{ scale = ‸[1, 0, 1] }]\n",
        "shapes.0.transform.0.scale",
        "expected factors other than 0",
    ),
    (
        "[[shapes]]\ntype = \"sphere\"\ncenter = [0, 0, 0]\nradius = 1\nmaterial = \"none\"\ntransform = [{ scale = 1 }, ‸{ scale = 2, translate = [1, 0, 0] }]\n",
        "shapes.0.transform.1",
        "found 2 of `scale`",
    ),
    (
        "[[shapes]]\ntype = \"sphere\"\ncenter = [0, 0, 0]\nradius = 1\nmaterial = \"none\"\ntransform = [{ matrix = ‸[1, 2, 3, 0, 4, 5, 6, 0, 7, 8, 9, 0, 0, 0, 0, 1] }]\n",
        "shapes.0.transform.0.matrix",
        "cannot be inverted",
    ),
    (
        "[[shapes]]\ntype = \"sphere\"\ncenter = [0, 0, 0]\nradius = 1\nmaterial = \"none\"\ntransform = ‸[{ scale = 1e-200 }, { scale = 1e-200 }]\n",
        "shapes.0.transform",
        "cannot be inverted",
    ),
    // Measured media, units, noise.
    ("[media.a]\npreset = ‸\"marbel\"\n", "media.a.preset", "\"wholemilk\"; did you mean `marble`?"),
    ("[media.a]\nsigma_a = 1\npreset = ‸\"marble\"\n", "media.a.preset", "is given beside coefficients"),
    ("[media.a]\nalbedo = 1\npreset = ‸\"marble\"\n", "media.a.preset", "is given beside coefficients"),
    ("[media.a]\nsigma_s = 1\nunit = ‸\"km\"\n", "media.a.unit", "one of \"scene\", \"mm\", \"cm\", \"m\""),
    (
        "[media.a]\nsigma_s = 1\nphase = { type = \"mie\", diameter = ‸51 }\n",
        "media.a.phase.diameter",
        "found 51; expected a number above 0 and at most 50",
    ),
    ("[media.a]\nsigma_s = 1\nphase = { type = \"mie\", diameter = ‸0 }\n", "media.a.phase.diameter", "found 0;"),
    (
        "[media.a]\nsigma_s = 1\ndensity = { type = \"noise\", threshold = ‸1 }\n",
        "media.a.density.threshold",
        "at least 0 and below 1",
    ),
    (
        "[media.a]\nsigma_s = 1\ndensity = { type = \"noise\" }\n[world]\nmedium = ‸\"a\"\n",
        "world.medium",
        "noise, which has no end; expected it as the `interior` of shapes",
    ),
    // TOML itself.
    ("[film]\nwidth = ‸\n", "", "not valid TOML"),
    ("[film]\nwidth = 1\n‸width = 2\n", "", "duplicate key"),
    ("[film]\nexposure = ‸1e999\n", "", "1e999 does not fit"),
];

#[test]
fn mistakes_are_named_with_place_value_and_remedy() {
    let (mut failures, mut shown) = (Vec::new(), 0);
    for (text, key, part) in MISTAKES {
        let text = format!("{text}\n{CAMERA}");
        let before = text.split('‸').next().unwrap_or_default();
        let column = before.rsplit('\n').next().unwrap_or_default().chars().count() + 1;
        let mut start = format!("scenes/x.toml:{}:{column}: ", before.matches('\n').count() + 1);
        if !key.is_empty() {
            start += &format!("{key}: ");
        }
        let message = complaint(&text.replace('‸', ""), &[]);
        if !message.starts_with(&start) || !message.contains(part) || told(&message).count() != 1 {
            failures.push(format!("expected {start}… {part}\ngot      {message}"));
        }
        // Below stands the line of the file, with a mark where the mistake is; what is missing stands nowhere.
        if let [_, line, mark] = message.lines().collect::<Vec<_>>()[..] {
            shown += 1;
            let from_mark: String = line.chars().skip(mark.chars().count() - 1).collect();
            let meant = text.split('‸').nth(1).and_then(|rest| rest.lines().next()).unwrap_or_default();
            if !mark.ends_with('^') || !meant.starts_with(&from_mark) || from_mark.is_empty() != meant.is_empty() {
                failures.push(format!("the mark is not before {meant}: {message}"));
            }
        }
    }
    assert!(4 * shown > 3 * MISTAKES.len(), "{shown} of {} mistakes are shown in their line", MISTAKES.len());
    assert!(failures.is_empty(), "{}", failures.join("\n"));
}

/// The lines of a message that tell of a problem, without those of the file.
fn told(message: &str) -> impl Iterator<Item = &str> {
    message.lines().filter(|line| !line.starts_with(' '))
}

/// Mixtures of mixtures have an end.
#[test]
fn mixtures_are_so_deep() {
    let mixture = |deep: usize| {
        let inner = "{ type = \"lambert\" }".to_string();
        let around = |inner, _| format!("{{ type = \"mix\", a = \"none\", b = {inner} }}");
        format!("[materials]\na = {}\n{CAMERA}", (0..deep).fold(inner, around))
    };
    assert!(parse(&mixture(8), &[]).is_ok());
    let message = complaint(&mixture(9), &[]);
    assert!(message.contains("mixtures of mixtures are deeper here than 8"), "{message}");
}

#[test]
fn a_camera_must_see() {
    for (text, part) in [
        ("", "camera: is missing"),
        ("[camera]\nposition = [0, 0, 0]\ntarget = [0, 0, 0]\n", "3:10: camera.target: is where the camera stands"),
        ("[camera]\nposition = [0, 1, 0]\ntarget = [0, 0, 0]\n", "1:1: camera.up: [0, 1, 0] is parallel to the view"),
        ("[camera]\nposition = [0, 1, 0]\ntarget = [0, 0, 0]\nup = [0, 0, 0]\n", "4:6: camera.up: "),
        (
            "[camera]\nposition = [0, 0, 1]\ntarget = [0, 0, 0]\nfov = 180\n",
            "4:7: camera.fov: found 180; expected a number above 0 and below 180",
        ),
        ("[camera]\nposition = [0, 0, 1]\ntarget = [0, 0, 0]\nfocus_distance = 0\n", "camera.focus_distance: found 0"),
    ] {
        let message = complaint(text, &[]);
        assert!(message.contains(part), "expected {part} in\n{message}");
    }
}

#[test]
fn several_mistakes_are_reported_at_once_in_the_order_of_the_file() {
    let message = complaint(
        "[film]\nwidth = 0\nfoo = 1\n[media.a]\nsigma_s = -1\n[[lights]]\ntype = \"pont\"\n",
        &["render.samples=0"],
    );
    let keys = [
        "1:1: camera",
        "2:9: film.width",
        "3:1: film.foo",
        "5:11: media.a.sigma_s",
        "7:8: lights.0.type",
        "--set render.samples=0: render.samples",
    ];
    assert_eq!(told(&message).count(), keys.len(), "{message}");
    for (line, key) in told(&message).zip(keys) {
        assert!(line.contains(key), "expected {key} in {line}");
    }
}

#[test]
fn overrides_reach_every_key() {
    let scene = parse(
        SAMPLE,
        &[
            "film.width=128",
            "film.filter=gaussian",
            "media.fog.sigma_s = [1, 2, 3]",
            "media.new.sigma_a=0.5",
            "world.medium=new",
            "shapes.haze.max.1=7",
            "shapes.2.radius=9",
            "lights.lamp.power=0",
            "materials.'my glass'.ior=2",
            "media.smoke.density.file=a = b/smöke.vdb",
            "media.cloud.phase={ type = \"isotropic\" }",
        ],
    )
    .expect("every override is valid");
    assert_eq!((scene.film.width, scene.film.filter), (128, Filter::Gaussian));
    assert_eq!(scene.media[1].sigma_s, Rgb::new(2.0, 4.0, 6.0));
    assert_eq!((scene.media[3].name.as_str(), scene.media[3].sigma_a), ("new", Rgb::splat(0.5)));
    assert_eq!(scene.world.medium.map(|medium| medium.value), Some(3));
    assert!(matches!(scene.shapes[1].kind, ShapeKind::Box { max, .. } if max.y == 7.0));
    assert!(matches!(scene.shapes[2].kind, ShapeKind::Sphere { radius: 9.0, .. }));
    assert!(matches!(scene.lights[0].kind, LightKind::Spot { intensity: Rgb::ZERO, .. }));
    assert_eq!(scene.materials[2].kind, Dielectric { index: Rgb::splat(2.0), roughness: 0.25 }.into());
    let Density::Vdb { file, .. } = &scene.media[0].density else { panic!() };
    assert_eq!(file.value, PathBuf::from("scenes/a = b/smöke.vdb"));
    assert_eq!(scene.media[2].phase, Isotropic.into());

    for (text, part) in [
        ("film.wdith=3", "--set film.wdith=3: film.wdith: unknown key; did you mean `width`?"),
        ("film.width=0", "--set film.width=0: film.width: found 0"),
        ("film.width=12x", "film.width: found \"12x\"; expected an integer"),
        ("flim.width=3", "--set flim.width=3: flim: unknown key; did you mean `film`?"),
        ("media.fog.sigma_s=[1, 2", "not valid TOML"),
        ("media.fog.sigma_s=", "expected a value"),
        ("film.width", "expected key=value"),
        ("film..width=3", "is not a dotted key"),
        ("film.width.x=3", "film.width is a single value"),
        ("shapes.8.radius=1", "shapes.8: no such element; expected a name or an index from 0 to 7"),
        ("shapes.hazy.radius=1", "shapes.hazy: no such element; did you mean `haze`?"),
        ("volume.march.step=unifrom", "did you mean `uniform`?"),
    ] {
        let message = complaint(SAMPLE, &[text]);
        assert!(message.contains(part), "expected {part} in\n{message}");
    }
}

/// σ_s and σ_a of the medium `a`.
fn coefficients(text: &str) -> (Rgb, Rgb) {
    let scene = parse(&format!("{text}{CAMERA}"), &[]).unwrap_or_else(|error| panic!("{error}"));
    (scene.media[0].sigma_s, scene.media[0].sigma_a)
}

#[test]
fn coefficients_are_converted_to_scene_units() {
    let close = |(s, a): (Rgb, Rgb), sigma_s: [f64; 3], sigma_a: [f64; 3]| {
        let off = (s / Rgb::from_array(sigma_s) - 1.0).abs().max((a / Rgb::from_array(sigma_a) - 1.0).abs());
        assert!(off.max_element() < 1e-12, "{s} and {a}, not {sigma_s:?} and {sigma_a:?}");
    };
    // Per millimetre, in a scene of metres.
    close(coefficients("[media.a]\npreset = \"marble\"\n"), [2190.0, 2620.0, 3000.0], [2.1, 4.1, 7.1]);
    let centimetres = "[world]\nunit = \"cm\"\n[media.a]\nscale = 0.5\n";
    close(coefficients(&format!("{centimetres}preset = \"cream\"\n")), [36.9, 27.35, 15.75], [0.001, 0.014, 0.0815]);
    close(
        coefficients(&format!("{centimetres}preset = \"ketchup\"\nunit = \"m\"\n")),
        [0.0009, 0.00035, 0.00015],
        [0.000305, 0.00485, 0.00725],
    );
    close(coefficients("[media.a]\npreset = \"skin1\"\nunit = \"scene\"\n"), [0.74, 0.88, 1.01], [0.032, 0.17, 0.48]);
    // What was measured is the reduced coefficient.
    let forward = "[media.a]\npreset = \"wholemilk\"\nunit = \"scene\"\nphase = { type = \"mixture\", lobes = [{ weight = 0.75, type = \"hg\", g = 0.8 }, { weight = 0.25, type = \"rayleigh\" }] }\n";
    close(coefficients(forward), [2.55 / 0.4, 3.21 / 0.4, 3.77 / 0.4], [0.0011, 0.0024, 0.014]);
    let other = "[world]\nunit = \"mm\"\n[media.a]\nunit = \"cm\"\nsigma_t = 20\nalbedo = 0.25\n";
    close(coefficients(other), [0.5; 3], [1.5; 3]);
    close(coefficients("[media.a]\nsigma_s = 2\nsigma_a = 3\n[world]\nunit = \"mm\"\n"), [2.0; 3], [3.0; 3]);
}

#[test]
fn kinds_have_their_defaults() {
    let media = |text: &str| parse(&format!("[media.a]\nsigma_s = 1\n{text}\n{CAMERA}"), &[]).map(|scene| scene.media);
    let noise = media("density = { type = \"noise\" }").expect("defaults");
    assert_eq!(noise[0].density, Density::Noise(Noise { scale: 1.0, octaves: 4, threshold: 0.5, seed: 0 }));
    let text = "density = { type = \"noise\", scale = 2, octaves = 3, threshold = 0, seed = 9 }\nphase = { type = \"mie\", diameter = 20 }";
    let noise = media(text).expect("every key");
    assert_eq!(noise[0].density, Density::Noise(Noise { scale: 2.0, octaves: 3, threshold: 0.0, seed: 9 }));
    assert_eq!(noise[0].phase, mie(20.0).into());
}

#[test]
fn instances_take_over_what_they_do_not_say() {
    let text = format!(
        "{CAMERA}
        [media.fog]
        sigma_s = 1
        [materials.white]
        type = 'lambert'
        [[shapes]]
        name = 'twice'
        type = 'instance'
        of = 'once'
        transform = [{{ translate = [0, 1, 0] }}]
        priority = 7
        [[shapes]]
        name = 'once'
        type = 'instance'
        of = 'ball'
        material = 'white'
        transform = [{{ scale = 2 }}]
        [[shapes]]
        name = 'ball'
        type = 'sphere'
        center = [0, 0, 0]
        radius = 1
        interior = 'fog'
        visible = false
        transform = [{{ translate = [1, 0, 0] }}]"
    );
    let scene = parse(&text, &[]).expect("instances of instances are allowed");
    let [twice, once, ball] = scene.shapes.as_slice() else { panic!() };
    assert_eq!((&twice.kind, &once.kind), (&ShapeKind::Instance { of: 2 }, &ShapeKind::Instance { of: 2 }));
    assert_eq!((twice.transform * ball.transform).transform_point3(DVec3::ZERO), DVec3::new(2.0, 1.0, 0.0));
    assert_eq!((once.transform * ball.transform).transform_point3(DVec3::ZERO), DVec3::new(2.0, 0.0, 0.0));
    let said =
        |shape: &Shape| (shape.material.value, shape.interior.as_ref().map(|medium| medium.value), shape.priority);
    assert_eq!((said(twice), said(once)), ((0, Some(0), 7), (0, Some(0), 0)));
    assert!(twice.visible && once.visible && !ball.visible);
}

#[test]
fn the_improbable_is_warned_about() {
    let warned = |text: &str, part: &str| {
        let scene = parse(&format!("{text}\n{CAMERA}"), &[]).unwrap_or_else(|error| panic!("{error}"));
        let [warning] = scene.warnings.as_slice() else { panic!("{part}: {:?}", scene.warnings) };
        assert!(warning.contains(part), "expected {part} in {warning}");
    };
    let sun = "[[lights]]\ntype = 'directional'\ndirection = [0, -1, 0]\nirradiance = 1\n";
    let glass = "[materials.glass]\ntype = 'dielectric'\n[[shapes]]\ntype = 'sphere'\ncenter = [0, 0, 0]\nradius = 1\nmaterial = 'glass'\n";
    warned("[[lights]]\ntype = 'point'\nposition = [0, 0, 0]\npower = 0\n", "nothing gives light");
    warned(
        &format!("{sun}[media.a]\nsigma_s = 1\nemission = {{ radiance = 1 }}\n"),
        "media.a: has an emission but does not glow",
    );
    let sky = "[[lights]]\ntype = 'sky'\nsun = [0, 1, 0]\n";
    for infinite in [sun, sky] {
        warned(&format!("{infinite}[media.a]\nsigma_s = 1\n[world]\nmedium = 'a'\n"), "lights.0: light from infinity");
    }
    warned(
        &format!("{sun}[[shapes]]\ntype = 'sphere'\ncenter = [0, 0, 0]\nradius = 1\nmaterial = 'none'\n"),
        "shapes.0: has material \"none\"",
    );
    warned(&format!("{sun}{glass}[render]\nmethod = 'path'\n"), "does not see light of lights.0 by way of shapes.0");
    let pane = glass.replace("'dielectric'", "'thin_dielectric'");
    warned(&format!("{sun}{pane}[render]\nmethod = 'path'\n"), "does not see light of lights.0 that shapes.0 mirror;");
    warned(&format!("{sun}{pane}[render]\nmethod = 'light'\n"), "does not see what shapes.0 mirror towards the camera");
    assert!(parse(&format!("{sun}{glass}{CAMERA}"), &[]).is_ok_and(|scene| scene.warnings.is_empty()));
}

#[test]
fn files_that_are_no_scenes_are_refused() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let refused = |name: &str, part: &str| {
        let path = folder.path().join(name);
        let error = scene::read(&path, &[]).expect_err(part);
        assert_eq!(error.exit_status(), 2);
        assert!(error.to_string().starts_with(&path.display().to_string()), "{error}");
        assert!(error.to_string().contains(part), "expected {part} in {error}");
    };
    refused("missing.toml", "cannot be read");
    refused(".", "is a folder");
    std::fs::write(folder.path().join("binary.toml"), b"[film]\n\xff\xfe\n").expect("written");
    refused("binary.toml", "is not UTF-8 text (line 2)");
    let huge = std::fs::File::create(folder.path().join("huge.toml")).expect("created");
    huge.set_len(1 << 40).expect("a sparse file");
    refused("huge.toml", "is larger than");
    std::fs::write(folder.path().join("ein schöner.toml"), CAMERA).expect("written");
    assert!(scene::read(&folder.path().join("ein schöner.toml"), &[]).is_ok());
}

#[test]
fn no_text_makes_the_reader_panic() {
    const PIECES: &[&str] = &[
        "\"",
        "'",
        "[",
        "]",
        "[[",
        "]]",
        "{",
        "}",
        "=",
        ",",
        ".",
        "\n",
        "#",
        "-",
        "1e308",
        "-0.0",
        "nan",
        "inf",
        "0x",
        "é",
        "\u{feff}",
        "\0",
        "name = \"haze\"\n",
        "of = \"haze\"\n",
        "1e-308",
        "99999999999999999999",
        "true",
        "[]",
        "{}",
    ];
    let mut random = Stream::new(1, Purpose::Test, 0, 0);
    let mut pick = |n: usize| (random.uniform() * n as f64) as usize;
    let starts: Vec<usize> = SAMPLE.char_indices().map(|(start, _)| start).collect();
    for _ in 0..4000 {
        let mut text = SAMPLE.to_owned();
        for _ in 0..1 + pick(4) {
            let boundary =
                |text: &str, at: usize| (0..=at.min(text.len())).rev().find(|&i| text.is_char_boundary(i)).unwrap_or(0);
            let from = boundary(&text, starts[pick(starts.len())]);
            let to = boundary(&text, from + pick(12)).max(from);
            match pick(3) {
                0 => text.replace_range(from..to, ""),
                1 => text.replace_range(from..to, PIECES[pick(PIECES.len())]),
                _ => text.truncate(if pick(20) == 0 { from } else { text.len() }),
            }
        }
        // Whatever comes out, it comes out.
        let _ = parse(&text, &["shapes.haze.min.0=-3"]);
        let line = SAMPLE.lines().nth(pick(120)).unwrap_or_default();
        let _ = parse(SAMPLE, &[line]);
    }
    // Depth is bounded by the parser, not by the stack.
    for text in
        ["[".repeat(100_000), format!("a = {}", "[".repeat(100_000)), format!("{} = 1", ["a"; 100_000].join("."))]
    {
        assert!(complaint(&text, &[]).contains("not valid TOML"));
    }
}
