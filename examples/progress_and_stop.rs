//! A render that tells how far it is, is refined pass by pass, and is stopped from outside.
//!
//! ```sh
//! cargo run --release --example progress_and_stop
//! ```
//!
//! A program with windows would do the same: render on a thread of its own, listen by a function, show the film whenever it got
//! better, and set a flag when the user has seen enough. What was rendered until then stays.

use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::Duration;

use volpm::render::{self, End, Film, Limits, Progress, Stats};
use volpm::scene;

const SCENE: &str = r#"
[film]
width = 160
height = 120

[camera]
position = [0, 1, 6]
target = [0, 1, 0]

[media.fog]
sigma_s = 0.2
sigma_a = 0.02

[[shapes]]
type = "box"
min = [-3, -1, -3]
max = [3, 3, 3]
interior = "fog"

[[lights]]
type = "point"
position = [1, 2, 0]
intensity = 20

[photons]
volume = 50_000
"#;

/// Prints phases, and the error whenever a pass has ended. `volpm::render::Callback` makes as much of a closure where no film is wanted.
struct Listener;

impl Progress for Listener {
    fn phase(&self, name: &'static str, _: u64) {
        println!("{name}");
    }

    fn advance(&self, _: u64) {}

    fn refined(&self, film: &Film, stats: &Stats) {
        let error = film.error().map_or("unknown yet".to_string(), |error| format!("{:.2} %", 100.0 * error));
        println!("  after {} passes: mean {:.4}, standard error {error}", stats.passes, film.image().mean());
    }
}

fn main() -> volpm::Result<()> {
    let description = scene::parse(SCENE, "scene in memory".as_ref(), &["render.seed=7".to_string()])?;
    let (scene, settings) = scene::build(&description)?;
    // As many passes as it takes, each with fresh photons, until somebody says stop.
    let limits = Limits { passes: Some(1..=u32::MAX), ..Limits::default() };
    let stop = AtomicBool::new(false);
    let rendering = thread::scope(|threads| {
        let render = threads.spawn(|| render::refine(&scene, &settings, &limits, None, &Listener, &stop));
        thread::sleep(Duration::from_secs(2));
        stop.store(true, Ordering::Relaxed);
        render.join().expect("the renderer does not panic")
    })?;
    assert_eq!(rendering.end, End::Interrupted);
    println!(
        "stopped; the image of {} passes is kept: mean {:.4}",
        rendering.stats.passes,
        rendering.film.image().mean()
    );
    Ok(())
}
