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
    for (name, triangles, volume) in [("rose", 200_000, 1500.0..1700.0), ("hand", 100_000, 60_000.0..70_000.0)] {
        let mesh = Mesh::load(&scenes().join(format!("{name}.obj.gz")), true).unwrap();
        assert!(mesh.triangle_count() >= triangles, "{name}: {} triangles", mesh.triangle_count());
        assert!(mesh.volume().is_some_and(|found| volume.contains(&found)), "{name}: {:?}", mesh.volume());
    }
}

#[test]
fn every_scene_can_be_built() {
    let mut count = 0;
    for folder in [scenes(), scenes().join("paper"), scenes().join("materials")] {
        for entry in fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.extension().is_some_and(|ending| ending == "toml") {
                let built = scene::read(&path, &[]).and_then(|description| scene::build(&description));
                assert!(built.is_ok(), "{}: {}", path.display(), built.err().unwrap());
                count += 1;
            }
        }
    }
    assert!(count >= 18, "only {count} scenes");
}
