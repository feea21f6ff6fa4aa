//! The program at its command line: what it accepts, refuses, writes, and how it ends.

use std::fs;
use std::path::Path;
use std::process::{Command, Output, Stdio};
use std::time::{Duration, Instant};

use serde_json::Value;
use volpm::image::{self, Attribute, LayerData, Picture};
use volpm::render::Unit;

pub(crate) const SCENE: &str = r#"
[film]
width = 12
height = 8

[camera]
position = [0, 0, 5]
target = [0, 0, 0]

[render]
samples = 4

[photons]
volume = 2000

[media.smoke]
sigma_t = 2
albedo = [0.9, 0.8, 0.5]

[materials.white]
type = "lambert"
reflectance = 0.7

[materials.mirror]
type = "mirror"

[[shapes]]
type = "box"
min = [-1, -1, -1]
max = [1, 1, 1]
interior = "smoke"

[[shapes]]
type = "mesh"
file = "models/floor.obj"
material = "white"

[[shapes]]
type = "sphere"
center = [1.5, 0, 0]
radius = 0.5
material = "mirror"

[[lights]]
type = "point"
position = [2, 3, 2]
intensity = 50
radius = 0.2
"#;

pub(crate) const FLOOR: &str = "v -5 -1 -5\nv -5 -1 5\nv 5 -1 5\nv 5 -1 -5\nf 1 2 3 4\n";

/// A folder with a scene in a folder of its own.
fn workplace() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    fs::create_dir_all(folder.path().join("scènes of mine/models")).unwrap();
    fs::write(folder.path().join("scènes of mine/smoke ☁.toml"), SCENE).unwrap();
    fs::write(folder.path().join("scènes of mine/models/floor.obj"), FLOOR).unwrap();
    folder
}

const NAME: &str = "scènes of mine/smoke ☁.toml";

fn program(folder: &Path, arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_volpm"));
    command.current_dir(folder).args(arguments).stdin(Stdio::null());
    command
}

fn run(folder: &Path, arguments: &[&str]) -> Output {
    program(folder, arguments).output().unwrap()
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8(bytes.to_vec()).unwrap()
}

fn names_in(folder: &Path) -> Vec<String> {
    let mut names: Vec<String> =
        fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

/// The largest difference between the image and the sum of its components, as a share of the largest value.
fn excess(picture: &Picture) -> f32 {
    const COMPONENTS: [&str; 8] = [
        "emission",
        "direct",
        "indirect",
        "specular",
        "caustic",
        "volume_emission",
        "volume_single",
        "volume_multiple",
    ];
    let mut sums = vec![[0.0f32; 3]; picture.image.pixels.len()];
    for layer in picture.layers.iter().filter(|layer| COMPONENTS.contains(&layer.name.as_str())) {
        let LayerData::Rgb(values) = &layer.channels else { panic!("{} is no colour", layer.name) };
        for (sum, value) in sums.as_flattened_mut().iter_mut().zip(values.as_flattened()) {
            *sum += value;
        }
    }
    let values = picture.image.pixels.as_flattened();
    let largest = values.iter().fold(0.0f32, |a, &b| a.max(b));
    sums.as_flattened().iter().zip(values).fold(0.0f32, |most, (a, b)| most.max((a - b).abs())) / largest
}

#[test]
fn a_render_writes_what_was_asked_for_and_where() {
    let folder = workplace();
    let at = |name: &str| folder.path().join(name);
    for method in ["photon", "path"] {
        let set = format!("render.method={method}");
        let outputs = ["-o", "a b.exr", "-o", "ü.png", "-o", "c.pfm", "-o", "d.HDR"];
        let options = ["--set", &set, "--samples", "3", "--seed", "7", "--threads", "2", "--stats", "stats.json"];
        let done = run(folder.path(), &[&["render", NAME], &outputs[..], &options].concat());
        assert_eq!(done.status.code(), Some(0), "{}", text(&done.stderr));
        assert!(done.stdout.is_empty());
        // No terminal, no progress: lines of plain text.
        let messages = text(&done.stderr);
        assert!(messages.contains("medium smoke") && !messages.contains(['\r', '\u{1b}']), "{messages:?}");

        let picture = image::read(at("a b.exr")).unwrap();
        assert_eq!((picture.image.width, picture.image.height), (12, 8));
        assert!(excess(&picture) < 1e-5, "{method}: components miss the image by {}", excess(&picture));
        let layers: Vec<&str> = picture.layers.iter().map(|layer| layer.name.as_str()).collect();
        for name in ["direct", "specular", "volume_single", "volume_multiple", "albedo", "normal", "depth"] {
            assert!(layers.contains(&name), "{method}: {name} is not in {layers:?}");
        }
        for absent in ["volume_emission", "standard_error"] {
            assert!(!layers.contains(&absent), "{method}: {absent}");
        }
        let attribute = |name: &str| picture.attributes.iter().find(|(key, _)| key == name).map(|(_, value)| value);
        assert!(matches!(attribute("scene"), Some(Attribute::Text(scene)) if scene.ends_with("smoke ☁.toml")));
        assert!(matches!(attribute("seed"), Some(Attribute::Text(seed)) if seed == "7"));
        assert!(
            matches!(attribute("renderer"), Some(Attribute::Text(version)) if version.contains(env!("CARGO_PKG_VERSION")))
        );
        // Nothing that differs from one render to the next.
        assert!(attribute("seconds").is_none());
        // PFM holds the same numbers.
        assert_eq!(image::read(at("c.pfm")).unwrap().image.pixels, picture.image.pixels);
        assert_eq!(image::read(at("ü.png")).unwrap().image.width, 12);
        assert_eq!(image::read(at("d.HDR")).unwrap().image.height, 8);

        let stats: Value = serde_json::from_slice(&fs::read(at("stats.json")).unwrap()).unwrap();
        for key in [
            "/scene",
            "/method",
            "/seed",
            "/threads",
            "/seconds/load",
            "/seconds/photons",
            "/seconds/build",
            "/seconds/render",
            "/seconds/total",
            "/photons/emitted",
            "/photons/volume",
            "/photons/global",
            "/photons/caustic",
            "/gather/queries",
            "/gather/tested",
            "/gather/gathered",
            "/gather/shadow_rays",
            "/gather/spared_rays",
            "/bytes/peak",
            "/bytes/volume_map",
            "/bytes/surface_maps",
            "/bytes/density",
            "/passes",
            "/samples",
        ] {
            assert!(stats.pointer(key).is_some_and(|value| !value.is_null()), "{key} in {stats}");
        }
        assert_eq!((&stats["method"], &stats["seed"], &stats["threads"]), (&method.into(), &7.into(), &2.into()));
        assert_eq!((&stats["samples"], &stats["passes"]), (&3.into(), &1.into()));
        assert_eq!(stats["photons"]["volume"].as_u64() > Some(0), method == "photon");
    }
    // Unless told otherwise: <scene>.exr and <scene>.png in the current folder. Quiet is silent.
    let done = run(folder.path(), &["render", NAME, "--quiet"]);
    assert_eq!((done.status.code(), done.stdout, done.stderr), (Some(0), vec![], vec![]));
    assert_eq!(
        names_in(folder.path()),
        ["a b.exr", "c.pfm", "d.HDR", "scènes of mine", "smoke ☁.exr", "smoke ☁.png", "stats.json", "ü.png"]
    );
    // Any number of threads gives the same pixels.
    for (threads, name) in [("1", "one.pfm"), ("3", "three.pfm")] {
        assert!(run(folder.path(), &["render", NAME, "-q", "--threads", threads, "-o", name]).status.success());
    }
    assert_eq!(fs::read(at("one.pfm")).unwrap(), fs::read(at("three.pfm")).unwrap());
}

#[test]
fn what_is_wrong_is_refused_before_the_work() {
    let folder = workplace();
    fs::create_dir(folder.path().join("folder.exr")).unwrap();
    fs::write(folder.path().join("notes.txt"), "").unwrap();
    fs::write(folder.path().join("broken.exr"), "no image").unwrap();
    let before = names_in(folder.path());
    // A render of what is valid here would take hours.
    let render = |more: &[&'static str]| [&["render", NAME, "--samples", "1000000"], more].concat();
    let cases: Vec<(Vec<&str>, i32, &str)> = vec![
        (vec![], 2, "Usage"),
        (vec!["rendr", NAME], 2, "similar"),
        (vec!["render"], 2, "<SCENE>"),
        (vec!["render", "missing.toml"], 2, "missing.toml"),
        (vec!["render", "scènes of mine"], 2, "is a folder"),
        (render(&["--sample", "3"]), 2, "--samples"),
        (render(&["--samples", "0"]), 2, "samples"),
        (render(&["--threads", "0"]), 2, "1..=1024"),
        (render(&["--set", "film.width"]), 2, "key=value"),
        (render(&["--set", "film.widht=3"]), 2, "did you mean `width`"),
        (render(&["--set", "shapes.1.file=nothing.obj"]), 2, "nothing.obj"),
        (render(&["-o", "image"]), 2, ".exr, .png, .pfm or .hdr"),
        (render(&["-o", "image.jpg"]), 2, ".exr, .png, .pfm or .hdr"),
        (render(&["-o", "nowhere/image.exr"]), 1, "there is no folder nowhere"),
        (render(&["-o", "folder.exr"]), 1, "this is a folder"),
        (render(&["-o", "notes.txt/image.exr"]), 1, "notes.txt"),
        (render(&["--stats", "nowhere/stats.json"]), 1, "there is no folder nowhere"),
        (vec!["diff", "missing.exr", "missing.exr"], 2, "missing.exr"),
        (vec!["diff", "broken.exr", "broken.exr"], 2, "broken.exr"),
        (vec!["info", "notes.txt"], 2, ".toml, .vdb, .npy, .obj"),
        (vec!["info", "broken.exr"], 2, "broken.exr"),
        (vec!["plan", "missing.toml"], 2, "missing.toml"),
        (vec!["plan", NAME, "--set", "film.widht=3"], 2, "did you mean `width`"),
        (vec!["plan", NAME, "--strict", "--set", "lights=[]"], 2, "(warnings are errors: --strict)"),
        (vec!["plan", NAME, "--memory", "1MB"], 2, "are not enough"),
        (vec!["plan", NAME, "--force", "mirrors"], 2, "global_photons, shadow_photons"),
        (vec!["plan"], 2, "--calibrate"),
        (render(&["--force", "pass_sums", "--checkpoint", "c"]), 2, "cannot be used with"),
        (vec!["new", "scene.toml"], 2, "--from"),
        (vec!["new", "scene.toml", "--from", "steam"], 2, "fog, smoke, marble, caustic, room"),
        (vec!["new", "notes.txt", "--from", "fog"], 2, "exists already"),
        (vec!["new", "nowhere/scene.toml", "--from", "fog"], 1, "there is no folder nowhere"),
        (vec!["help", "media.fog.sigma_x"], 2, "did you mean `media.*.sigma_"),
        (vec!["help", "nowhere.at_all_or_elsewhere"], 2, "neither a command nor a key"),
        (render(&["--passes", "0"]), 2, "--passes"),
        (render(&["--passes", "4", "--pass-range", "1..2"]), 2, "cannot be used with"),
        (render(&["--pass-range", "0..3"]), 2, "counted from 1"),
        (render(&["--time=30"]), 2, "such as 90s"),
        (render(&["--target-error", "0%"]), 2, "such as 2%"),
        (render(&["--memory", "8"]), 2, "such as 8GiB"),
        (render(&["--memory", "1MB"]), 2, "are not enough"),
        (render(&["--strict", "--set", "lights=[]"]), 2, "(warnings are errors: --strict)"),
        (render(&["--checkpoint", "nowhere/file"]), 1, "there is no folder nowhere"),
        (render(&["--resume", "missing"]), 2, "missing"),
        (render(&["--resume", "notes.txt"]), 2, "not a checkpoint"),
        (render(&["--preview", "p.exr"]), 2, "ends in .png"),
        (render(&["--preview", "nowhere/p.png"]), 1, "there is no folder nowhere"),
        #[cfg(feature = "tev")]
        (render(&["--tev", "localhost"]), 2, "HOST:PORT"),
        #[cfg(feature = "tev")]
        (render(&["--tev", "localhost:1"]), 1, "start tev first"),
        (vec!["merge", "missing", "-o", "c"], 2, "missing"),
        (vec!["merge", "notes.txt"], 2, "--out"),
        (vec!["merge", "notes.txt", "-o", "nowhere/c"], 1, "there is no folder nowhere"),
    ];
    for (arguments, status, message) in cases {
        let done = run(folder.path(), &arguments);
        let said = text(&done.stderr);
        assert_eq!(done.status.code(), Some(status), "{arguments:?}: {said}");
        assert!(said.contains(message), "{arguments:?}: {said}");
        assert!(done.stdout.is_empty() && !said.contains("panicked"), "{arguments:?}: {said}");
    }
    assert_eq!(names_in(folder.path()), before);
    // Errors are shown however quiet.
    assert!(!run(folder.path(), &["render", "missing.toml", "-q"]).stderr.is_empty());
    for arguments in [&["help"][..], &["--help"], &["help", "render"], &["--version"]] {
        let done = run(folder.path(), arguments);
        assert!(done.status.success() && !done.stdout.is_empty() && done.stderr.is_empty(), "{arguments:?}");
    }
}

#[test]
fn figures_and_facts_go_to_stdout() {
    let folder = workplace();
    assert!(run(folder.path(), &["render", NAME, "-q", "-o", "a.exr", "-o", "a.pfm"]).status.success());
    let same = run(folder.path(), &["diff", "a.exr", "a.pfm", "--json"]);
    let figures: Value = serde_json::from_slice(&same.stdout).unwrap();
    assert_eq!(figures["rmse"], 0.0, "{figures}");
    assert!(same.stderr.is_empty());
    for file in [NAME, "a.exr", "a.pfm", "scènes of mine/models/floor.obj"] {
        let plain = run(folder.path(), &["info", file]);
        assert!(plain.status.success() && plain.stderr.is_empty() && text(&plain.stdout).contains("file: "), "{file}");
        let facts: Value = serde_json::from_slice(&run(folder.path(), &["info", file, "--json"]).stdout).unwrap();
        assert!(facts.is_object(), "{file}");
    }
    let missing = run(folder.path(), &["diff", "a.exr", "a.exr", "--layer", "nothing"]);
    assert_eq!(missing.status.code(), Some(2));
    assert!(text(&missing.stderr).contains("volume_single"), "{}", text(&missing.stderr));
}

#[test]
fn differences_are_drawn_and_held_to_limits() {
    let folder = workplace();
    let at = |name: &str| folder.path().join(name);
    for (seed, name) in [("1", "a"), ("2", "b")] {
        let outputs: Vec<String> = ["exr", "png", "pfm", "hdr"].map(|ending| format!("{name}.{ending}")).to_vec();
        let outputs = outputs.iter().flat_map(|output| ["-o", output]);
        let arguments: Vec<&str> = ["render", NAME, "-q", "--seed", seed].into_iter().chain(outputs).collect();
        assert!(run(folder.path(), &arguments).status.success());
    }
    let diff = |more: &[&str]| {
        let done = run(folder.path(), &[&["diff"], more].concat());
        (done.status.code(), text(&done.stdout), text(&done.stderr))
    };
    // Any format against any other; limits that hold and limits that do not, of which all are named.
    for ending in ["exr", "png", "pfm", "hdr"] {
        let (status, said, _) = diff(&[&format!("a.{ending}"), "b.exr", "--max-rmse", "1e6", "--max-relmse", "1e6"]);
        assert!(status == Some(0) && said.contains("relMSE"), "{ending}: {said}");
    }
    let none = ["--max-rmse", "0", "--max-relmse", "0", "--max-bias", "0%", "--max-flip", "0", "--hdr"];
    let (status, said, errors) = diff(&[&["a.exr", "a.pfm"], &none[..]].concat());
    assert_eq!((status, errors.as_str()), (Some(0), ""));
    assert!(said.contains("HDR-FLIP   0.0"), "{said}");
    let (status, said, errors) = diff(&[&["a.exr", "b.exr"], &none[..]].concat());
    assert!(status == Some(1) && said.contains("RMSE"), "{said}");
    for option in ["--max-rmse", "--max-relmse", "--max-bias", "--max-flip"] {
        assert!(errors.contains(&format!("exceeds 0 ({option})")), "{errors}");
    }
    // What is left out of the means is not forgiven.
    let mut broken = image::read(at("a.pfm")).unwrap();
    broken.image.pixels[14][1] = f32::NAN;
    image::write(at("nan.pfm"), &broken, &image::ToneSettings::default()).unwrap();
    assert_eq!(diff(&["nan.pfm", "a.pfm"]).0, Some(0));
    let (status, _, errors) = diff(&["nan.pfm", "a.pfm", "--max-rmse", "1"]);
    assert!(status == Some(1) && errors.contains("column 2, row 1"), "{errors}");

    // Maps; wrong use is refused before anything is written.
    let before = names_in(folder.path());
    for (wrong, message) in [
        (&["--layer", "depth", "--flip", "f.png"][..], "holds none"),
        (&["--layer", "depth", "--max-flip", "1"], "holds none"),
        (&["--flip", "f.exr"], ".png"),
        (&["--max-rmse=-1"], "a number from 0"),
        (&["--max-rmse", "few"], "1e-4"),
        (&["--error-range", "10%"], "--error"),
    ] {
        let (status, said, errors) = diff(&[&["a.exr", "b.exr"], wrong].concat());
        assert_eq!((status, said.as_str()), (Some(2), ""), "{wrong:?}");
        assert!(errors.contains(message), "{wrong:?}: {errors}");
    }
    assert_eq!(diff(&["a.exr", "b.exr", "--flip", "nowhere/f.png"]).0, Some(1));
    assert_eq!(names_in(folder.path()), before);
    let (status, ..) = diff(&["a.exr", "b.exr", "--layer", "direct", "--flip", "f.png", "--error", "e.png"]);
    assert_eq!(status, Some(0));
    for map in ["f.png", "e.png"] {
        // Below the map, a bar.
        let map = image::read(at(map)).unwrap().image;
        assert!(map.width >= 12 && map.height > 8);
        assert!(map.get(0, 0) != [1.0; 3] && map.get(map.width - 1, map.height - 1) == [1.0; 3]);
    }
}

#[cfg(target_os = "linux")]
#[test]
fn a_full_disk_costs_no_old_file() {
    let folder = workplace();
    let at = |name: &str| folder.path().join(name);
    fs::write(at("old.exr"), "old").unwrap();
    // Files of this process end after a block of 512 or 1024 bytes.
    let limited = "trap '' XFSZ; ulimit -f 1; exec \"$0\" \"$@\"";
    let arguments =
        ["-c", limited, env!("CARGO_BIN_EXE_volpm"), "render", NAME, "-q", "-o", "old.exr", "-o", "new.png"];
    let done = Command::new("sh").current_dir(folder.path()).args(arguments).output().unwrap();
    let said = text(&done.stderr);
    assert_eq!(done.status.code(), Some(1), "{said}");
    assert!(said.contains("cannot write old.exr"), "{said}");
    assert_eq!(fs::read(at("old.exr")).unwrap(), b"old");
    // The image that fits is there, and nothing else.
    assert_eq!(names_in(folder.path()), ["new.png", "old.exr", "scènes of mine"]);
    assert!(image::read(at("new.png")).is_ok());
    // A folder that takes no files is found out before the work; so is a device that is full.
    let done = run(folder.path(), &["render", NAME, "--samples", "1000000", "-o", "/proc/image.exr"]);
    assert_eq!(done.status.code(), Some(1), "{}", text(&done.stderr));
    let full = fs::OpenOptions::new().write(true).open("/dev/full").unwrap();
    let done = program(folder.path(), &["info", NAME]).stdout(full).output().unwrap();
    assert_eq!(done.status.code(), Some(1), "{}", text(&done.stderr));
}

/// A pipe whose reader has hung up.
#[cfg(unix)]
fn hung_up() -> Stdio {
    std::io::pipe().unwrap().1.into()
}

#[cfg(target_os = "linux")]
#[test]
fn what_cannot_be_told_costs_no_picture() {
    let folder = workplace();
    let full = || Stdio::from(fs::OpenOptions::new().write(true).open("/dev/full").unwrap());
    // A render tells of its media and of what it wrote; bad usage is told of as well.
    for (how, stderr) in [("hung up", hung_up as fn() -> Stdio), ("full", full)] {
        let arguments = ["render", NAME, "--samples", "1", "-o", "a.pfm", "--checkpoint", "a.checkpoint"];
        let done = program(folder.path(), &arguments).stderr(stderr()).status().unwrap();
        assert_eq!(done.code(), Some(0), "stderr is {how}");
        assert!(image::read(folder.path().join("a.pfm")).is_ok(), "stderr is {how}");
        fs::remove_file(folder.path().join("a.pfm")).unwrap();
        for arguments in [&["render", "nowhere.toml"][..], &["render", "--nonsense"], &["new"]] {
            let done = program(folder.path(), arguments).stderr(stderr()).status().unwrap();
            assert_eq!(done.code(), Some(2), "{arguments:?}: stderr is {how}");
        }
    }
    // What was asked for is the work itself: a reader may have enough of it, a disk not.
    for arguments in [&["info", NAME][..], &["plan", NAME], &["--help"], &["--version"]] {
        for (stdout, status) in [(hung_up(), 0), (full(), 1)] {
            let done = program(folder.path(), arguments).stdout(stdout).output().unwrap();
            assert_eq!(done.status.code(), Some(status), "{arguments:?}: {}", text(&done.stderr));
            assert_eq!(text(&done.stderr).contains("cannot write stdout"), status == 1, "{arguments:?}");
        }
    }
}

/// Costs of a machine tell seconds, and of nothing else; what is no such file is refused by its name.
#[test]
fn costs_of_a_machine_tell_seconds() {
    let folder = workplace();
    let plan =
        |costs: &str| program(folder.path(), &["plan", NAME, "--json"]).env("VOLPM_COSTS", costs).output().unwrap();
    let known = plan("none.json");
    let mut known: Value = serde_json::from_slice(&known.stdout).unwrap();
    assert!(known["seconds"].is_null(), "{known}");
    // A second for each of everything.
    let units = Unit::ALL.map(|unit| format!("{:?}: 1e9", unit.name())).join(", ");
    let version = env!("CARGO_PKG_VERSION");
    let costs = format!("{{\"version\": \"{version}\", \"nanoseconds\": {{{units}}}}}");
    fs::write(folder.path().join("costs.json"), &costs).unwrap();
    let told = plan("costs.json");
    let mut told: Value = serde_json::from_slice(&told.stdout).unwrap_or_else(|_| panic!("{}", text(&told.stderr)));
    assert!(told["seconds"].as_f64().unwrap() > 1e5, "{told}");
    for plan in [&mut known, &mut told] {
        let items = plan["items"].as_object().unwrap().values();
        let shares: f64 = items.filter_map(|item| item["share"].as_f64()).sum();
        assert!((shares - 1.0).abs() < 1e-9, "{shares}");
        for item in plan["items"].as_object_mut().unwrap().values_mut() {
            item["share"].take();
            item["seconds"].take();
        }
        plan["seconds"].take();
        // That of the process, which no two runs have alike.
        plan["bytes"]["peak"].take();
    }
    assert_eq!(known, told);

    fs::write(folder.path().join("costs.json"), costs.replace("\"ray\"", "\"wave\"")).unwrap();
    let refused = plan("costs.json");
    assert_eq!(refused.status.code(), Some(2));
    assert!(text(&refused.stderr).contains("costs.json") && text(&refused.stderr).contains("ray is missing"));

    // Nothing is measured that cannot be kept.
    let mut calibrate = program(folder.path(), &["plan", "--calibrate"]);
    let refused = calibrate.env("VOLPM_COSTS", "costs.json/of-this.json").output().unwrap();
    assert_eq!(refused.status.code(), Some(1));
    assert!(text(&refused.stderr).contains("VOLPM_COSTS"), "{}", text(&refused.stderr));
}

#[cfg(unix)]
#[test]
fn an_interrupted_render_writes_what_it_has() {
    use std::io::{BufRead, BufReader};
    let folder = workplace();
    for method in ["photon", "path"] {
        let set = format!("render.method={method}");
        let arguments = ["render", NAME, "--samples", "100000000", "--set", &set, "-o", "a.exr", "--stats", "s.json"];
        let mut child = program(folder.path(), &arguments).stderr(Stdio::piped()).spawn().unwrap();
        // The first message comes when Ctrl-C is listened for and the scene is loaded.
        let mut messages = BufReader::new(child.stderr.take().unwrap());
        let mut said = String::new();
        messages.read_line(&mut said).unwrap();
        std::thread::sleep(Duration::from_secs(2));
        let sent = Instant::now();
        let id = child.id().to_string();
        assert!(Command::new("kill").args(["-INT", &id]).status().unwrap().success());
        let status = child.wait().unwrap();
        assert_eq!(status.code(), Some(130), "{method}");
        assert!(sent.elapsed() < Duration::from_secs(10), "{method}: it took {:?} to stop", sent.elapsed());
        let picture = image::read(folder.path().join("a.exr")).unwrap();
        assert!(picture.image.pixels.iter().all(|pixel| pixel.iter().all(|value| value.is_finite())));
        assert!(picture.image.channel_means()[0] > 0.0, "{method}: the image is black");
        let stats: Value = serde_json::from_slice(&fs::read(folder.path().join("s.json")).unwrap()).unwrap();
        assert_eq!(stats["interrupted"], true);
    }
}

/// Waits until `done`, for a minute at most.
#[cfg(unix)]
fn wait_until(what: &str, mut done: impl FnMut() -> bool) {
    let start = Instant::now();
    while !done() {
        assert!(start.elapsed() < Duration::from_secs(60), "waited for {what}");
        std::thread::sleep(Duration::from_millis(20));
    }
}

#[cfg(unix)]
#[test]
fn an_interrupted_render_goes_on_from_its_checkpoint() {
    let folder = workplace();
    let at = |name: &str| folder.path().join(name);
    let base = ["render", NAME, "-q", "--set", "film.exposure=1", "-o"];
    let arguments = [&base[..], &["a.pfm", "--passes", "1000000", "--checkpoint", "c", "--preview", "p.png"]].concat();
    let mut child = program(folder.path(), &arguments).stderr(Stdio::null()).spawn().unwrap();
    // A picture comes while it is made, and is always whole.
    wait_until("a preview", || at("p.png").exists());
    assert_eq!(image::read(at("p.png")).unwrap().image.width, 12);
    assert!(Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap().success());
    assert_eq!(child.wait().unwrap().code(), Some(130));
    assert_eq!(names_in(folder.path()), ["a.pfm", "c", "p.png", "scènes of mine"]);

    // The image is that of the finished passes, which are those of any other run.
    let again = run(folder.path(), &["merge", "c", "-o", "merged.pfm", "-o", "merged.exr", "-o", "merged.png"]);
    assert_eq!(again.status.code(), Some(0), "{}", text(&again.stderr));
    assert_eq!(fs::read(at("merged.pfm")).unwrap(), fs::read(at("a.pfm")).unwrap());
    assert_eq!(fs::read(at("merged.png")).unwrap(), fs::read(at("p.png")).unwrap());
    let facts = run(folder.path(), &["info", "c", "--json"]);
    let facts: Value = serde_json::from_slice(&facts.stdout).unwrap();
    assert_eq!((&facts["passes"][0]["seed"], &facts["passes"][0]["first"]), (&1.into(), &1.into()), "{facts}");
    let picture = image::read(at("merged.exr")).unwrap();
    let attribute = picture.attributes.iter().find(|(name, _)| name == "passes");
    let Some((_, Attribute::Number(passes))) = attribute else { panic!("{:?}", picture.attributes) };
    let more = (*passes as u32 + 2).to_string();
    let resumed = [&base[..], &["b.exr", "--resume", "c", "--passes", &more, "--threads", "1"]].concat();
    let whole = [&base[..], &["d.exr", "--passes", &more]].concat();
    for arguments in [resumed, whole] {
        let done = run(folder.path(), &arguments);
        assert_eq!((done.status.code(), text(&done.stderr)), (Some(0), String::new()));
    }
    let (resumed, whole) = (image::read(at("b.exr")).unwrap(), image::read(at("d.exr")).unwrap());
    assert!(resumed.image == whole.image && resumed.layers == whole.layers);
    assert!(whole.layer("standard_error").is_some());

    // Other seeds and settings are refused; a checkpoint that cannot be used is left alone.
    for (more, message) in [
        (["--seed", "2"], "holds passes of seed 1, not of seed 2"),
        (["--samples", "5"], "render.samples is 4 in one and 5 in the other"),
    ] {
        let done = run(folder.path(), &[&base[..], &["x.pfm", "--resume", "c", "--checkpoint", "c"], &more].concat());
        assert_eq!(done.status.code(), Some(2));
        assert!(text(&done.stderr).contains(message), "{}", text(&done.stderr));
    }
    // What it holds is not taken out.
    let done = run(folder.path(), &[&base[..], &["e.pfm", "--passes", "3", "--checkpoint", "e"]].concat());
    assert_eq!(done.status.code(), Some(0), "{}", text(&done.stderr));
    let fewer = run(folder.path(), &[&base[..], &["x.pfm", "--passes", "2", "--resume", "e"]].concat());
    assert_eq!(fewer.status.code(), Some(2));
    assert!(text(&fewer.stderr).contains("--passes 2: e holds passes up to 3"), "{}", text(&fewer.stderr));
    let twice = run(folder.path(), &["merge", "c", "c", "-o", "x.pfm"]);
    assert_eq!(twice.status.code(), Some(2));
    assert!(text(&twice.stderr).contains("both hold"), "{}", text(&twice.stderr));
    assert!(!at("x.pfm").exists() && run(folder.path(), &["merge", "c", "-o", "x"]).status.success());
}

#[test]
fn a_render_keeps_to_time_and_error() {
    let folder = workplace();
    let stats = |more: &[&str]| -> Value {
        let arguments = [&["render", NAME, "-q", "-o", "a.pfm", "--stats", "s.json"], more].concat();
        let done = run(folder.path(), &arguments);
        assert_eq!(done.status.code(), Some(0), "{more:?}: {}", text(&done.stderr));
        serde_json::from_slice(&fs::read(folder.path().join("s.json")).unwrap()).unwrap()
    };
    for method in ["render.method=photon", "render.method=path"] {
        let start = Instant::now();
        let timed = stats(&["--time", "1.5s", "--set", method]);
        assert!(start.elapsed() < Duration::from_secs(8), "{:?}", start.elapsed());
        let passes = timed["passes"].as_u64().unwrap();
        assert!(passes > 1 && timed["samples"] == 4 * passes && timed["error"].as_f64() > Some(0.0), "{timed}");
        let precise = stats(&["--target-error", "20%", "--set", method]);
        assert!(precise["error"].as_f64() <= Some(0.2) && precise["passes"].as_u64() >= Some(4), "{precise}");
    }
    let limited = stats(&["--time", "1h", "--passes", "3"]);
    assert_eq!(limited["passes"], 3);
    let short = stats(&["--time", "10ms", "--samples", "100000000"]);
    assert_eq!((&short["passes"], &short["interrupted"]), (&0.into(), &false.into()));
    let warnings = short["warnings"].as_array().unwrap();
    assert!(warnings.iter().any(|warning| warning.as_str().unwrap().contains("of 100000000 samples")), "{short}");
}

#[cfg(feature = "tev")]
#[test]
fn a_viewer_gets_the_image() {
    use std::io::Read;
    let listener = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap().to_string();
    let viewer = std::thread::spawn(move || {
        let (mut socket, _) = listener.accept().unwrap();
        let mut bytes = Vec::new();
        socket.read_to_end(&mut bytes).unwrap();
        bytes
    });
    let folder = workplace();
    let done = run(folder.path(), &["render", NAME, "-q", "-o", "a.pfm", "--tev", &address]);
    assert_eq!(done.status.code(), Some(0), "{}", text(&done.stderr));
    let bytes = viewer.join().unwrap();
    // Packets: length, kind, content.
    let mut packets = Vec::new();
    let mut rest = &bytes[..];
    while let Some((length, _)) = rest.split_first_chunk::<4>() {
        let (packet, after) = rest.split_at(u32::from_le_bytes(*length) as usize);
        packets.push(&packet[4..]);
        rest = after;
    }
    let (create, update) = (4, 6);
    let kinds: Vec<u8> = packets.iter().map(|packet| packet[0]).collect();
    assert!(kinds[0] == create && kinds.len() > 1 && kinds[1..].iter().all(|kind| *kind == update), "{kinds:?}");
    assert!(packets[0].windows(NAME.len()).any(|part| part == NAME.as_bytes()));
    let image = image::read(folder.path().join("a.pfm")).unwrap().image;
    let pixels: Vec<u8> = image.pixels.iter().flatten().flat_map(|value| value.to_le_bytes()).collect();
    assert!(packets.last().unwrap().ends_with(&pixels), "the last image is another");
}

#[test]
fn nothing_prints_by_what_panics_without_a_reader() {
    fn search(folder: &Path) {
        for entry in fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                search(&path);
                continue;
            }
            let source = fs::read_to_string(&path).unwrap();
            for call in ["print!(", "println!(", "dbg!("] {
                assert!(!source.contains(call), "{} calls {call}…)", path.display());
            }
        }
    }
    search(&Path::new(env!("CARGO_MANIFEST_DIR")).join("src"));
}

/// Each starting scene stands alone, has nothing to warn about, and is a picture; what is there is never replaced.
#[test]
fn new_scenes_render_as_they_are() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    for kind in ["fog", "smoke", "marble", "caustic", "room"] {
        let file = format!("my {kind}.toml");
        let done = run(folder.path(), &["new", &file, "--from", kind]);
        assert_eq!(done.status.code(), Some(0), "{kind}: {}", text(&done.stderr));
        let again = run(folder.path(), &["new", &file, "--from", "fog"]);
        assert_eq!(again.status.code(), Some(2), "{kind}: {}", text(&again.stderr));
        let (scene, settings) = volpm::scene::build(&volpm::scene::read(&at(&file), &[]).unwrap()).unwrap();
        assert!(scene.warnings.is_empty(), "{kind}: {:?}", scene.warnings);
        assert!(settings.render.seed == 1 && settings.film.size().0 >= 200, "{kind} was replaced");
        let small = ["film.width=24", "film.height=18", "photons.volume=20000", "photons.caustic=10000"];
        let small: Vec<&str> = small.iter().flat_map(|set| ["--set", set]).collect();
        let picture = [&["render", &file, "--samples", "2", "--quiet", "-o", "a.pfm"][..], &small].concat();
        let done = run(folder.path(), &picture);
        assert_eq!(done.status.code(), Some(0), "{kind}: {}", text(&done.stderr));
        let image = image::read(at("a.pfm")).unwrap().image;
        let values = image.pixels.as_flattened();
        let lit = values.iter().filter(|value| **value > 0.0).count();
        assert!(values.iter().all(|value| value.is_finite()) && 2 * lit > values.len(), "{kind}: {lit} are lit");
    }
}

/// What plans and manuals say is printed as it is asked for: a table, or one object with the names that stay; a key, with its default.
#[test]
fn plans_and_manuals_are_printed() {
    let folder = workplace();
    let plan = run(folder.path(), &["plan", NAME, "--samples", "3"]);
    assert_eq!(plan.status.code(), Some(0), "{}", text(&plan.stderr));
    assert!(text(&plan.stdout).contains("3 samples a pixel") && text(&plan.stdout).contains("volume_map"));
    let object = run(folder.path(), &["plan", NAME, "--json"]);
    let object: Value = serde_json::from_slice(&object.stdout).unwrap();
    assert_eq!((&object["method"], &object["film"]), (&"photon".into(), &serde_json::json!([12, 8])));
    let items = &object["items"];
    assert_eq!((&items["volume_map"]["needed"], &items["light_paths"]["needed"]), (&true.into(), &false.into()));
    assert_eq!(items["volume_map"]["bytes"], object["bytes"]["volume_map"]);
    assert_eq!(names_in(folder.path()), ["scènes of mine"]);
    for (key, expected) in [
        ("volume.neighbours", "volume.neighbours\n  value    an integer"),
        ("media.smoke.phase.g", "media.*.phase.g  (of hg)"),
        ("surface", "irradiance_cache"),
        ("render", "Usage: volpm render"),
    ] {
        let done = run(folder.path(), &["help", key]);
        assert_eq!(done.status.code(), Some(0), "{key}: {}", text(&done.stderr));
        assert!(text(&done.stdout).contains(expected), "{key}: {}", text(&done.stdout));
    }
    let schema = run(folder.path(), &["schema"]);
    let schema: Value = serde_json::from_slice(&schema.stdout).unwrap();
    assert_eq!(schema["definitions"]["volume"]["properties"]["neighbours"]["minimum"], 1);
    for (asked, expected) in [
        (&["completions", "bash"][..], "volume.neighbours"),
        (&["completions", "zsh"], "--target-error"),
        (&["man"], ".TH volpm 1"),
        (&["man", "render"], "target\\-error"),
        (&["man", "scene"], "\\fBneighbours\\fR"),
    ] {
        let done = run(folder.path(), asked);
        assert_eq!(done.status.code(), Some(0), "{asked:?}: {}", text(&done.stderr));
        assert!(text(&done.stdout).contains(expected), "{asked:?}: {}", text(&done.stdout));
    }
}

/// The most memory that a plan foretells is what the render takes, to a fifth, where photons and not the allocator's pieces take most.
#[test]
#[cfg(target_os = "linux")]
fn plans_foretell_memory() {
    let folder = workplace();
    for photons in ["photons.volume=400000", "photons.volume=1600000"] {
        let options = ["--set", photons, "--threads", "2"];
        let plan = run(folder.path(), &[&["plan", NAME, "--json"], &options[..]].concat());
        let plan: Value = serde_json::from_slice(&plan.stdout).unwrap();
        let render = ["render", NAME, "--quiet", "-o", "a.pfm", "--stats", "stats.json"];
        let done = run(folder.path(), &[&render[..], &options].concat());
        assert_eq!(done.status.code(), Some(0), "{}", text(&done.stderr));
        let stats: Value = serde_json::from_slice(&fs::read(folder.path().join("stats.json")).unwrap()).unwrap();
        let [told, found] = [&plan, &stats].map(|figures| figures["bytes"]["peak"].as_f64().unwrap());
        assert!((told / found - 1.0).abs() < 0.2, "{photons}: {told} told, {found} found");
    }
}

/// Frames are renders of their own, with their numbers in the names of files; what cannot be done for all of them is refused before the first.
#[test]
fn frames_have_numbers_in_their_names() {
    let folder = workplace();
    let at = |name: &str| folder.path().join(name);
    for (frame, height) in [("07", "-1"), ("08", "-0.5")] {
        let name = format!("scènes of mine/models/floor_{frame}.obj");
        fs::write(at(&name), FLOOR.replace("-1 ", &format!("{height} "))).unwrap();
    }
    let rendered = |options: &[&str]| run(folder.path(), &[&["render", NAME, "--quiet"], options].concat());
    let floors = ["--set", "shapes.1.file=models/floor_##.obj"];
    let before = names_in(folder.path());
    for (options, expected) in [
        (&[&floors[..], &["--frames", "7..9", "-o", "###.pfm"]].concat()[..], "floor_09.obj"),
        (&[&floors[..], &["--frames", "7..8", "-o", "a.pfm"]].concat(), "a.pfm"),
        (&["--frames", "7..8", "-o", "###.pfm"], "nothing in it changes"),
    ] {
        let done = rendered(options);
        assert_eq!(done.status.code(), Some(2), "{options:?}: {}", text(&done.stderr));
        assert!(text(&done.stderr).contains(expected), "{options:?}: {}", text(&done.stderr));
    }
    assert_eq!(names_in(folder.path()), before);

    let done = rendered(&[&floors[..], &["--frames", "7..8", "-o", "###.pfm", "--stats", "#.json"]].concat());
    assert_eq!(done.status.code(), Some(0), "{}", text(&done.stderr));
    let done = rendered(&["--set", "shapes.1.file=models/floor_07.obj", "-o", "alone.pfm"]);
    assert_eq!(done.status.code(), Some(0), "{}", text(&done.stderr));
    let [first, second, alone] = ["007.pfm", "008.pfm", "alone.pfm"].map(|name| fs::read(at(name)).unwrap());
    assert!(first == alone && first != second && at("7.json").exists() && at("8.json").exists());
}

/// A warning shows the line that it is about, and is an error to every command that reads a scene and is asked for that.
#[test]
fn warnings_show_their_line_and_may_be_errors() {
    let folder = tempfile::tempdir().unwrap();
    let sun = "[[lights]]\ntype = \"directional\"\ndirection = [0, -1, 0]\nirradiance = 1\n";
    let fog = "[media.fog]\nsigma_s = 0.1\nsigma_a = 0.1\n[world]\nmedium = \"fog\"\n";
    let small = "[film]\nwidth = 4\nheight = 4\n[render]\nmethod = \"path\"\nsamples = 1\n";
    let camera = "[camera]\nposition = [0, 0, 5]\ntarget = [0, 0, 0]\n";
    fs::write(folder.path().join("sun.toml"), format!("{sun}{fog}{small}{camera}")).unwrap();
    let shown = "sun.toml:1:1: lights.0: light from infinity does not get through";
    let line = "    [[lights]]\n    ^\n";
    let commands: [&[&str]; 5] = [
        &["render", "sun.toml", "-o", "sun.pfm"],
        &["plan", "sun.toml"],
        &["info", "sun.toml"],
        &["check", "sun.toml", "--time", "1s"],
        &["compare", "sun.toml", "-o", "compared", "--estimates", "path", "--samples", "1", "--reference-time", "1s"],
    ];
    for command in commands {
        let done = run(folder.path(), command);
        let said = text(&done.stderr) + &text(&done.stdout);
        assert!(done.status.code() != Some(2) && said.contains(shown), "{command:?}: {said}");
        let strict = run(folder.path(), &[command, &["--strict"]].concat());
        let said = text(&strict.stderr);
        assert_eq!(strict.status.code(), Some(2), "{command:?}: {said}");
        assert!(said.contains(shown) && said.contains(line) && said.contains("(warnings are errors"), "{said}");
    }
}
