//! What a scene will take, told before it is rendered, and its photons themselves.
//!
//! ```sh
//! cargo run --release --example plan_and_photons -- scenes/new/fog.toml
//! ```
//!
//! Prints the plan of the scene, traces the photons of its first pass, and shows how the light they stand for is spread over heights and numbers of
//! events. Photons are good for more than pictures: the light that a medium takes up, for example.

use std::path::PathBuf;
use std::sync::atomic::AtomicBool;

use volpm::math::DVec3;
use volpm::render::{Callback, Forecast, Limits, SharedPhotons};
use volpm::scene;

fn main() -> volpm::Result<()> {
    let path = std::env::args_os().nth(1).map_or_else(|| PathBuf::from("scenes/new/fog.toml"), PathBuf::from);
    let overrides = ["render.method=\"photon\"".to_string(), "photons.volume=200_000".to_string()];
    let (scene, settings) = scene::build(&scene::read(&path, &overrides)?)?;

    let forecast = Forecast::new(&scene, &settings, &Limits::default(), None)?;
    println!("{}", forecast.line());
    for item in forecast.items.iter().filter(|item| item.needed) {
        println!("  {:24} {:>12} bytes  {}", item.name, item.bytes.unwrap_or(0), item.why);
    }

    let told = Callback::new(|phase, _, steps| {
        if steps > 0 {
            eprintln!("{phase}: {steps} steps");
        }
    });
    let photons = SharedPhotons::trace(&scene, &settings, &told, &AtomicBool::new(false))?;
    println!("{} photons of {} that were emitted, in {:.2} s", photons.stored(), photons.emitted, photons.seconds);

    // Positions are around the scene's middle; so are its bounds.
    let bounds = scene.bounds();
    let mut heights = [0.0; 10];
    let mut events = [0.0; 8];
    for photon in photons.regions().iter().flatten() {
        let share = (f64::from(photon.position.y) - bounds.min.y) / (bounds.max.y - bounds.min.y);
        let power = photon.power.as_dvec3().dot(DVec3::ONE) / 3.0;
        heights[((10.0 * share).max(0.0) as usize).min(9)] += power;
        events[usize::from(photon.events).min(7)] += power;
    }
    let whole: f64 = events.iter().sum();
    for (tenth, power) in heights.iter().enumerate().rev() {
        println!(
            "  height {:3} %  {:5.1} % of what media scatter",
            10 * tenth,
            100.0 * power / whole.max(f64::MIN_POSITIVE)
        );
    }
    for (before, power) in events.iter().enumerate() {
        println!("  {before} events before  {:5.1} %", 100.0 * power / whole.max(f64::MIN_POSITIVE));
    }
    Ok(())
}
