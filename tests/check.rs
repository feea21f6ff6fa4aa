//! `volpm check`: sound scenes pass, broken ones are caught with what is wrong, and a path is told as the film drew it.

use std::fs;
use std::path::Path;
use std::sync::atomic::AtomicBool;

use volpm::check::{self, Outcome, Report, Request, Row};
use volpm::render::{Replayer, Silent, render};
use volpm::scene;

/// A ball of fog over a floor, under a round lamp.
const SOUND: &str = r#"
[film]
width = 18
height = 12
[camera]
position = [0, 1, 6]
target = [0, 1, 0]
fov = 40
[render]
samples = 2
[photons]
volume = 4000
[media.fog]
sigma_t = [0.8, 0.5, 1.2]
albedo = 0.9
[materials.white]
type = "lambert"
reflectance = 0.7
[[shapes]]
name = "floor"
type = "quad"
origin = [-5, 0, 5]
edge_u = [10, 0, 0]
edge_v = [0, 0, -10]
material = "white"
[[shapes]]
name = "ball"
type = "sphere"
center = [0, 1, 0]
radius = 1
interior = "fog"
[[lights]]
type = "point"
position = [0.3, 3.3, 0.3]
intensity = 30
radius = 0.1
"#;

/// Another medium in part of the first, a box with a lamp and a ball in it, a roof one of whose faces is flipped, a second floor in
/// the place of the first, and the lamp once more.
const BROKEN: &str = r#"
[media.smoke]
sigma_t = 4
albedo = 0.3
[[shapes]]
name = "other"
type = "sphere"
center = [0.8, 1, 0]
radius = 0.8
interior = "smoke"
[[shapes]]
name = "chest"
type = "box"
min = [4, 0.1, -4]
max = [5, 1.1, -3]
material = "white"
[[shapes]]
name = "treasure"
type = "sphere"
center = [4.5, 0.5, -3.5]
radius = 0.2
interior = "gold"
[media.gold]
sigma_t = 5
albedo = 0.5
[[lights]]
type = "point"
position = [4.1, 0.3, -3.1]
intensity = 10
[[shapes]]
name = "roof"
type = "mesh"
file = "roof.obj"
material = "white"
[materials.grey]
type = "lambert"
reflectance = 0.3
[[shapes]]
name = "ground"
type = "quad"
origin = [-5, 0, 5]
edge_u = [10, 0, 0]
edge_v = [0, 0, -10]
material = "grey"
[[lights]]
type = "point"
position = [0.3, 3.3, 0.3]
intensity = 30
radius = 0.1
"#;

const ROOF: &str = "v -1 3 -1\nv 1 3 -1\nv 1 3 1\nv -1 3 1\nf 1 2 3\nf 1 4 3\n";

const SEEDS: u32 = 4;

fn checked(folder: &Path, text: &str, set: &[&str]) -> Report {
    let scene = folder.join("scene.toml");
    fs::write(&scene, text).unwrap();
    let set = set.iter().map(|pair| pair.to_string()).collect();
    let request = Request { scene, set, seconds: 60.0, seeds: Some(SEEDS) };
    check::run(&request, &Silent, &AtomicBool::new(false)).unwrap()
}

#[track_caller]
fn row<'r>(report: &'r Report, test: &str) -> &'r Row {
    let found = report.rows.iter().find(|row| row.test == test);
    found.unwrap_or_else(|| panic!("no row {test}: {:#?}", report.rows))
}

#[track_caller]
fn outcome_of(report: &Report, test: &str) -> Outcome {
    row(report, test).outcome
}

#[test]
fn a_sound_scene_passes() {
    let folder = tempfile::tempdir().unwrap();
    let report = checked(folder.path(), SOUND, &[]);
    assert!(report.complete && report.count(Outcome::Fail) == 0, "{:#?}", report.rows);
    for test in [
        "boundaries without leaks",
        "lights reach what is seen",
        "shapes are seen",
        "media are entered",
        "nothing is there twice",
        "energy: emitted = absorbed + escaped + left",
        "energy: photons bring what media scatter",
        "pixels are finite and not negative",
        "path ↔ path",
        "path ↔ light",
        "photons ↔ path",
        "points ↔ path",
        "photons: bias of their radii",
    ] {
        assert_eq!(outcome_of(&report, test), Outcome::Pass, "{test}: {:#?}", report.rows);
    }
    let map = report.rows.iter().find_map(|row| row.map.as_ref()).expect("a map of p-values");
    assert_eq!((map.columns, map.p.len()), (3, 6));
}

#[test]
fn what_is_wrong_is_named() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("roof.obj"), ROOF).unwrap();
    let report = checked(folder.path(), &format!("{SOUND}{BROKEN}"), &[]);
    for (test, named) in [
        ("meshes", "shapes.roof: 1 edges"),
        ("overlaps of solids", "shapes.ball and shapes.other overlap in part"),
        ("lights reach what is seen", "the point light at (4.1, 0.3, -3.1)"),
        ("shapes are seen", "shapes.treasure"),
        ("media are entered", "medium gold"),
        ("nothing is there twice", "lights.2 is the same as lights.0; shapes.ground is where shapes.floor is"),
    ] {
        assert_caught(&report, test, named);
    }
}

#[track_caller]
fn assert_caught(report: &Report, test: &str, named: &str) {
    let row = row(report, test);
    assert!(row.outcome == Outcome::Fail && row.found.contains(named), "{row:#?}");
}

/// What needs pictures to be seen, each in a scene of its own: a hole in a mesh, and a camera in a pillar; matter too dense for its photons;
/// a lens over the floor, left to paths that hardly ever find the lamp through it; a lamp too bright for a picture's numbers.
#[test]
fn what_pictures_show_is_named() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("sheet.obj"), torn_sheet()).unwrap();
    let blind = "[[shapes]]\nname = \"pillar\"\ntype = \"sphere\"\ncenter = [8, 9, 6]\nradius = 0.5\nmaterial = \"white\"\n\
                 [[shapes]]\nname = \"sheet\"\ntype = \"mesh\"\nfile = \"sheet.obj\"\nmaterial = \"white\"\n";
    let lens = "[materials.glass]\ntype = \"dielectric\"\n\
                [[shapes]]\ntype = \"sphere\"\ncenter = [0.3, 2.5, 0.3]\nradius = 0.4\nmaterial = \"glass\"\n";
    let dense = "media.fog.scale=1e4";
    let by_paths = ["render.method=path", "lights.0.radius=0.02"];
    for (more, set, caught) in [
        (
            blind,
            &["camera.position=[8, 9, 6]"][..],
            &[
                ("meshes", "shapes.sheet: 4 of"),
                ("the picture is lit", "black"),
                ("shapes are seen", "shapes.floor"),
                ("lights reach what is seen", "the emission of the lamp at (0.3, 3.3, 0.3)"),
            ][..],
        ),
        ("", &[dense], &[("points ↔ path", "darker")]),
        (lens, &by_paths, &[("path ↔ light", "by way of mirrors and glass by chance only")]),
        ("", &["lights.0.intensity=1e38"], &[("pixels are finite and not negative", "were dropped")]),
    ] {
        let report = checked(folder.path(), &format!("{SOUND}{more}"), set);
        for (test, named) in caught {
            assert_caught(&report, test, named);
        }
    }
}

/// A bent sheet of many faces, four of whose edges lie round a hole.
fn torn_sheet() -> String {
    const SIDE: usize = 14;
    let mut text = String::new();
    for i in 0..(SIDE + 1) * (SIDE + 1) {
        let (x, y) = (i % (SIDE + 1), i / (SIDE + 1));
        text += &format!("v {} {} {}\n", 0.1 * x as f64, 2.0 + 0.01 * (x * y % 5) as f64, -0.1 * y as f64);
    }
    for (x, y) in (0..SIDE * SIDE).map(|i| (i % SIDE, i / SIDE)).filter(|cell| *cell != (5, 7)) {
        let a = y * (SIDE + 1) + x + 1;
        text += &format!("f {} {} {} {}\n", a, a + 1, a + SIDE + 2, a + SIDE + 1);
    }
    text
}

/// Photons spread over far more than there is, without a correction: the ball is darker than its radii say.
#[test]
fn a_far_too_large_radius_is_caught() {
    let folder = tempfile::tempdir().unwrap();
    let set = ["volume.kernel=fixed", "volume.radius=3", "volume.boundaries=none"];
    let report = checked(folder.path(), SOUND, &set);
    assert_eq!(outcome_of(&report, "photons ↔ path"), Outcome::Fail, "{:#?}", report.rows);
    assert_eq!(outcome_of(&report, "path ↔ light"), Outcome::Pass);
}

/// The samples of a pixel, told one by one, make the pixel: through glass, in fog, and where paths split.
#[test]
fn a_replay_is_what_the_film_drew() {
    let folder = tempfile::tempdir().unwrap();
    let glass = "[materials.glass]\ntype = \"dielectric\"\n[[shapes]]\ntype = \"sphere\"\ncenter = [1.2, 0.6, 1.5]\nradius = 0.5\nmaterial = \"glass\"\n";
    let scene = folder.path().join("scene.toml");
    fs::write(&scene, format!("{SOUND}{glass}")).unwrap();
    for sigma in ["1.5", "1e-3"] {
        let set = ["render.method=path".to_string(), "render.passes=2".into(), format!("media.fog.sigma_t={sigma}")];
        let (scene, settings) = scene::build(&scene::read(&scene, &set).unwrap()).unwrap();
        let image = render(&scene, &settings, &Silent, &AtomicBool::new(false)).unwrap().film.image();
        let replayer = Replayer::new(&scene, &settings).unwrap();
        for y in (0..12).step_by(3) {
            for x in 0..18 {
                let samples = (0..4).map(|sample| replayer.replay((x, y), sample).unwrap());
                let sum: volpm::math::Rgb =
                    samples.map(|told| told.sample.radiance.iter().sum::<volpm::math::Rgb>()).sum();
                let pixel = image.get(x as usize, y as usize).map(f64::from);
                for (told, drawn) in (0.25 * sum).to_array().into_iter().zip(pixel) {
                    assert!((told - drawn).abs() <= 1e-6 * drawn, "{x},{y}: {told}, not {drawn}");
                }
            }
        }
        let told = replayer.replay((9, 6), 0).unwrap();
        assert!(!told.told.is_empty());
        assert!(replayer.replay((18, 0), 0).is_err());
    }
}

/// The exit status tells, and so does JSON; a path is told in words.
#[cfg(feature = "cli")]
#[test]
fn the_command_line_tells() {
    let folder = tempfile::tempdir().unwrap();
    let run = |arguments: &[&str]| {
        let mut command = std::process::Command::new(env!("CARGO_BIN_EXE_volpm"));
        command.current_dir(folder.path()).args(arguments).output().unwrap()
    };
    // Nothing shines: the quickest of all checks.
    let dark: String = SOUND.split("[[lights]]").next().unwrap().to_string();
    fs::write(folder.path().join("dark.toml"), dark).unwrap();
    let output = run(&["check", "dark.toml", "--seeds", "4", "--json", "--quiet"]);
    assert_eq!(output.status.code(), Some(3), "{output:?}");
    let report: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    let lit = report["rows"].as_array().unwrap().iter().find(|row| row["test"] == "the picture is lit").unwrap();
    assert_eq!((lit["outcome"].as_str(), report["complete"].as_bool()), (Some("fail"), Some(true)));
    assert_eq!(run(&["check", "missing.toml"]).status.code(), Some(2));

    fs::write(folder.path().join("scene.toml"), SOUND).unwrap();
    let replay = run(&["render", "scene.toml", "--set", "render.method=path", "--replay", "9,6,1"]);
    let told = String::from_utf8(replay.stdout).unwrap();
    assert!(replay.status.success() && told.contains("medium fog") && told.contains("radiance ("), "{told}");
    assert_eq!(run(&["render", "scene.toml", "--replay", "9,6,1"]).status.code(), Some(2));
}
