//! A scene written in code, rendered into memory: a ball of glass in fog, whose light is gathered behind it.
//!
//! ```sh
//! cargo run --release --example scene_in_code
//! ```
//!
//! Keys are those of scene files (`docs/scene-format.md`), and so are defaults and messages, but that they name lines of this file.
//! Nothing is written: the picture is read from the film, its light by component from the film's layers, and shown by characters.

use std::sync::atomic::AtomicBool;

use volpm::image::LayerData;
use volpm::render::{self, Silent};
use volpm::scene::{self, Draft};

fn main() -> volpm::Result<()> {
    let ball = Draft::new().set("type", "sphere").set("center", [0.0, 0.5, 0.0]).set("radius", 0.5);
    let fog = Draft::new().set("type", "box").set("min", [-2, -1, -2]).set("max", [2, 2, 2]).set("interior", "fog");
    let spot = Draft::new().set("type", "spot").set("position", [-3.0, 2.5, 0.0]).set("target", [0.0, 0.5, 0.0]);
    let draft = Draft::new()
        .set("film", Draft::new().set("width", 72).set("height", 32).set("layers", true))
        .set("camera", Draft::new().set("position", [0.0, 0.5, 6.0]).set("target", [0.0, 0.3, 0.0]).set("fov", 36))
        .set("media.fog", Draft::new().set("sigma_s", 0.3).set("sigma_a", 0.01))
        .set("materials.glass", Draft::new().set("type", "dielectric").set("ior", 1.5))
        .push("shapes", fog)
        .push("shapes", ball.set("material", "glass").set("priority", 1))
        .push("lights", spot.set("intensity", 100).set("outer_angle", 10).set("radius", 0.05))
        .set("photons.volume", 100_000)
        .set("render.samples", 4);

    let (scene, settings) = scene::build(&draft.describe("ball in fog")?)?;
    for warning in &scene.warnings {
        println!("warning: {warning}");
    }
    let rendering = render::render(&scene, &settings, &Silent, &AtomicBool::new(false))?;

    // Linear radiance, row 0 on top.
    let image = rendering.film.image();
    let brightest = image.pixels.as_flattened().iter().copied().fold(0.0, f32::max);
    for row in image.pixels.chunks(image.width) {
        let shade = |pixel: &[f32; 3]| {
            let level = (pixel[1] / brightest).powf(0.4) * 9.0;
            b" .:-=+*#%@"[level.clamp(0.0, 9.0) as usize] as char
        };
        println!("{}", row.iter().map(shade).collect::<String>());
    }
    for layer in rendering.film.layers() {
        if let LayerData::Rgb(pixels) = &layer.channels {
            let sum: f64 = pixels.as_flattened().iter().map(|&value| f64::from(value)).sum();
            println!("{:24} mean {:.5}", layer.name, sum / (3 * pixels.len()) as f64);
        }
    }
    let stats = &rendering.stats;
    println!("{} photons kept of {} emitted, {} bytes of maps", stats.volume, stats.emitted, stats.map_bytes);
    Ok(())
}
