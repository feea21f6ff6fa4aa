//! The scenes that come with the program can be built, and the carved figures in them are sound.

use std::fs;
use std::path::{Path, PathBuf};

use volpm::geometry::Mesh;
use volpm::scene;

fn scenes() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes")
}

#[test]
fn carved_figures_are_closed() {
    for (name, triangles, volume) in
        [("rose", 200_000, 1500.0..1700.0), ("hand", 100_000, 60_000.0..70_000.0), ("jensen/waves", 20_000, 3.9..4.1)]
    {
        let mesh = Mesh::load(&scenes().join(format!("{name}.obj.gz")), true).unwrap();
        assert!(mesh.triangle_count() >= triangles, "{name}: {} triangles", mesh.triangle_count());
        assert!(mesh.volume().is_some_and(|found| volume.contains(&found)), "{name}: {:?}", mesh.volume());
    }
}

#[test]
fn every_scene_can_be_built() {
    let mut count = 0;
    for folder in ["", "paper", "materials", "jensen", "room"].map(|folder| scenes().join(folder)) {
        for entry in fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.extension().is_some_and(|ending| ending == "toml") {
                let built = scene::read(&path, &[]).and_then(|description| scene::build(&description));
                assert!(built.is_ok(), "{}: {}", path.display(), built.err().unwrap());
                count += 1;
                for other in others(&path) {
                    let read = scene::read(&path, &other);
                    assert!(read.is_ok(), "{}, {other:?}: {}", path.display(), read.err().unwrap());
                }
            }
        }
    }
    assert!(count >= 33, "only {count} scenes");
}

/// What the lines of a scene's comments say that one may set for another picture.
fn others(scene: &Path) -> Vec<Vec<String>> {
    let text = fs::read_to_string(scene).unwrap();
    let lines = text.lines().filter_map(|line| line.strip_prefix("#   --set "));
    let set =
        |line: &str| line.split("--set ").filter_map(|rest| rest.split_whitespace().next()).map(String::from).collect();
    lines.map(set).collect()
}
