//! A render that tells how far it is, is refined pass by pass, and is stopped from outside.
//!
//! ```sh
//! cargo run --release --example progress_and_stop
//! ```
//!
//! A program with windows would do the same: render on a thread of its own, listen by a function, show the film whenever it got
//! better, and set a flag when the user has seen enough. What was rendered until then stays.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Sender, channel};
use std::thread;

use volpm::render::{self, End, Film, Limits, Progress, Stats};
use volpm::scene;

const SCENE: &str = r#"
[film]
width = 80
height = 60

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
volume = 20_000

[render]
samples = 2
"#;

/// What a window would be told.
enum News {
    Phase(&'static str),
    /// Passes, the mean of the image and its standard error.
    Refined(u64, f64, Option<f64>),
}

/// Passes on news, and a picture whenever there is a better one. `volpm::render::Callback` makes as much of a closure where no film is wanted.
struct Listener(Sender<News>);

impl Progress for Listener {
    fn phase(&self, name: &'static str, _: u64) {
        // Nobody need listen.
        let _ = self.0.send(News::Phase(name));
    }

    fn advance(&self, _: u64) {}

    fn refined(&self, film: &Film, stats: &Stats) {
        let _ = self.0.send(News::Refined(stats.passes, film.image().mean(), film.error()));
    }
}

fn main() -> volpm::Result<()> {
    let description = scene::parse(SCENE, "scene in memory".as_ref(), &["render.seed=7".to_string()])?;
    let (scene, settings) = scene::build(&description)?;
    // As many passes as it takes, each with fresh photons, until somebody says stop.
    let limits = Limits { passes: Some(1..=u32::MAX), ..Limits::default() };
    let (stop, (sender, news)) = (AtomicBool::new(false), channel());
    let rendering = thread::scope(|threads| {
        let listener = Listener(sender);
        let render = threads.spawn(|| render::refine(&scene, &settings, &limits, None, &{ listener }, &stop));
        for told in news {
            match told {
                News::Phase(name) => println!("{name}"),
                News::Refined(passes, mean, error) => {
                    let error = error.map_or("unknown yet".to_string(), |error| format!("{:.2} %", 100.0 * error));
                    println!("  after {passes} passes: mean {mean:.4}, standard error {error}");
                    // The user has seen enough.
                    stop.store(passes >= 4, Ordering::Relaxed);
                }
            }
        }
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
