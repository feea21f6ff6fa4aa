//! Programs that are killed, and what they leave behind.

use std::fs;
use std::path::Path;
use std::process::{Command, Output, Stdio};
use std::time::Duration;

use serde_json::Value;
use volpm::image::{self, Picture};
use volpm::math::random::{Purpose, Stream};

use crate::support::{ALL_SORTS, data};

/// Scenes and features that are killed in turn: the scene's file, and what is set besides.
const KILLED: [(&str, &[&str]); 11] = [
    ("all-sorts", &["--set", "render.method=photon"]),
    ("all-sorts", &["--set", "render.method=path", "--set", "film.layers=false"]),
    ("all-sorts", &["--set", "render.method=light"]),
    ("all-sorts", &["--set", "volume.estimate=point", "--set", "volume.kernel=fixed", "--seed", "7"]),
    ("all-sorts", &["--set", "volume.single_scattering=traced", "--set", "photons.importance=true"]),
    ("all-sorts", &["--memory", "48MiB", "--set", "photons.volume=20000"]),
    ("scenes/jensen/box.toml", &["--set", "photons.global=3000", "--set", "surface.gather_rays=8"]),
    ("scenes/glass-ball.toml", &["--set", "photons.caustic=2000", "--set", "photons.global=2000"]),
    ("scenes/marble-diffuse.toml", &["--set", "volume.estimate=point"]),
    ("scenes/stress/instances.toml", &["--set", "photons.density_control=true"]),
    ("scenes/cornell-fog.toml", &["--set", "surface.indirect=map", "--threads", "1"]),
];

fn program(folder: &Path, arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_volpm"));
    command.current_dir(folder).args(arguments).stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
    command
}

#[track_caller]
fn succeeds(folder: &Path, arguments: &[&str]) -> Output {
    let done = program(folder, arguments).output().unwrap();
    assert!(done.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&done.stderr));
    done
}

/// Kills a long render at any moment, as often as `VOLPM_KILLS` says (50), other moments for each `VOLPM_SEED` (1). What it kept is
/// sound, and rendered on from there comes out as if nothing had happened, to the last bit; every second kill is of a render
/// that went on from what another left. Checkpoints are written all the time, so that some die while they are.
#[test]
#[ignore = "minutes: cargo test --release --test promises killed_renders -- --ignored --nocapture"]
fn killed_renders_go_on_as_if_nothing_had_been() {
    let number = |name: &str, default: u64| std::env::var(name).map_or(default, |text| text.parse().unwrap());
    kill(number("VOLPM_KILLS", 50), number("VOLPM_SEED", 1), 2.0);
}

/// The same a few times, soon after the start.
#[test]
fn some_killed_renders_go_on() {
    kill(4, 2, 0.6);
}

/// Kills renders so many times, each within so many seconds.
fn kill(kills: u64, seed: u64, within: f64) {
    let mut dice = Stream::new(seed, Purpose::Test, 0, 2);
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    fs::create_dir_all(at("reference")).unwrap();
    fs::write(at("all-sorts.toml"), ALL_SORTS).unwrap();
    let grid = "reference/smoke_grid";
    fs::create_dir_all(at(grid)).unwrap();
    fs::copy(data(grid).join("smoke_grid_64.vdb"), at(grid).join("smoke_grid_64.vdb")).unwrap();

    let (mut resumed, mut early, mut half_written) = (0, 0, 0);
    for kill in 0..kills {
        let (scene, features) = KILLED[kill as usize / 2 % KILLED.len()];
        let own = format!("{scene}.toml");
        let file = Path::new(env!("CARGO_MANIFEST_DIR")).join(scene);
        let scene = if at(&own).exists() { &own } else { file.to_str().unwrap() };
        let small = ["film.width=24", "film.height=16", "render.samples=1", "photons.volume=2000"];
        let mut base = vec!["render", scene, "-q"];
        base.extend(small.iter().flat_map(|set| ["--set", *set]));
        base.extend(features);

        // Every second goes on from what the one before has left.
        if kill % 2 == 0 {
            let _ = fs::remove_file(at("kept"));
        }
        let mut arguments = [&base[..], &["-o", "a.exr", "--time", "1h"]].concat();
        arguments.extend(["--checkpoint", "kept", "--checkpoint-every", "1ms", "--preview", "p.png"]);
        if at("kept").exists() {
            arguments.extend(["--resume", "kept"]);
        }
        let mut child = program(folder.path(), &arguments).spawn().unwrap();
        std::thread::sleep(Duration::from_secs_f64(within * dice.uniform()));
        assert_eq!(child.try_wait().unwrap(), None, "{arguments:?}: it ended by itself");
        child.kill().unwrap();
        child.wait().unwrap();
        assert!(!at("a.exr").exists());
        let parts = fs::read_dir(folder.path()).unwrap().filter_map(|entry| {
            let path = entry.unwrap().path();
            path.extension().is_some_and(|ending| ending == "part").then_some(path)
        });
        let parts: Vec<_> = parts.collect();
        half_written += usize::from(!parts.is_empty());
        parts.iter().for_each(|part| fs::remove_file(part).unwrap());
        if !at("kept").exists() {
            early += 1;
            continue;
        }

        let facts: Value =
            serde_json::from_slice(&succeeds(folder.path(), &["info", "kept", "--json"]).stdout).unwrap();
        let all = facts["passes"].as_array().unwrap();
        assert!(all.len() == 1 && all[0]["first"] == 1, "{facts}");
        let last = all[0]["last"].as_u64().unwrap().div_ceil(facts["parts_of_a_pass"].as_u64().unwrap()) + 1;
        let last = last.to_string();
        succeeds(folder.path(), &[&base[..], &["-o", "on.exr", "--passes", &last, "--resume", "kept"]].concat());
        succeeds(folder.path(), &[&base[..], &["-o", "whole.exr", "--passes", &last]].concat());
        let [on, whole]: [Picture; 2] = ["on.exr", "whole.exr"].map(|name| image::read(at(name)).unwrap());
        assert!(on.image == whole.image && on.layers == whole.layers, "{base:?}: {last} passes are another picture");
        println!("{kill:3} {scene} {features:?}: {last} passes");
        resumed += 1;
    }
    println!(
        "{kills} killed: {early} before anything was kept, {half_written} while a file was written; {resumed} resumed to the same bits"
    );
}

/// What is no checkpoint of the scene is neither gone on from nor replaced, and what cannot be written is told before the work.
#[cfg(target_os = "linux")]
#[test]
fn foreign_files_are_neither_resumed_nor_replaced() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let scene = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/stress/tiny.toml");
    let base = ["render", scene.to_str().unwrap(), "-q", "--samples", "1", "--set", "render.method=path"];
    let refused = |more: &[&str], status: i32, message: &str| {
        let done = program(folder.path(), &[&base[..], more].concat()).output().unwrap();
        let said = String::from_utf8_lossy(&done.stderr).into_owned();
        assert!(done.status.code() == Some(status) && said.contains(message), "{more:?}: {:?} {said}", done.status);
    };
    fs::write(at("text"), "not a checkpoint, but long enough to be one").unwrap();
    fs::create_dir(at("folder")).unwrap();
    let out = ["-o", "a.pfm"];
    refused(&[&out[..], &["--resume", "text"]].concat(), 2, "not a checkpoint");
    refused(&[&out[..], &["--resume", "folder"]].concat(), 2, "this is not a file");
    refused(&[&out[..], &["--resume", "nowhere"]].concat(), 2, "cannot read the checkpoint");
    refused(&[&out[..], &["--checkpoint", "folder"]].concat(), 1, "this is a folder");
    refused(&[&out[..], &["--checkpoint", "nowhere/c"]].concat(), 1, "there is no folder");
    refused(&["-o", "folder.pfm/a.pfm"], 1, "there is no folder");
    assert!(!at("a.pfm").exists());
    // Only one of the same scene is replaced.
    refused(&[&out[..], &["--checkpoint", "text"]].concat(), 1, "cannot be used: not a checkpoint");
    succeeds(folder.path(), &[&base[..], &out, &["--checkpoint", "c"]].concat());
    let kept = fs::read(at("c")).unwrap();
    refused(&[&out[..], &["--checkpoint", "c", "--set", "lights.0.intensity=2"]].concat(), 1, "is of another scene");
    assert_eq!(fs::read(at("c")).unwrap(), kept);
    assert_eq!(fs::read(at("text")).unwrap(), b"not a checkpoint, but long enough to be one");
    succeeds(folder.path(), &[&base[..], &out, &["--checkpoint", "c"]].concat());
}

/// Programs that write the same files at the same time: whoever reads one finds one of them whole.
#[test]
fn two_programs_at_one_file_leave_one_whole() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let scene = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/stress/tiny.toml");
    let (scene, path) = (scene.to_str().unwrap(), "render.method=path");
    let both = ["1", "2"].map(|seed| {
        let arguments = ["render", scene, "-q", "--samples", "1", "--passes", "20", "--set", path, "--seed", seed];
        let files = ["-o", "a.pfm", "--checkpoint", "c", "--checkpoint-every", "1ms", "--preview", "p.png"];
        program(folder.path(), &[&arguments[..], &files].concat()).spawn().unwrap()
    });
    for child in both {
        let done = child.wait_with_output().unwrap();
        assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    }
    succeeds(folder.path(), &["info", "c"]);
    assert!(image::read(at("a.pfm")).is_ok() && image::read(at("p.png")).is_ok());
    let mut names: Vec<_> = fs::read_dir(folder.path()).unwrap().map(|entry| entry.unwrap().file_name()).collect();
    names.sort();
    assert_eq!(names, ["a.pfm", "c", "p.png"]);
}
