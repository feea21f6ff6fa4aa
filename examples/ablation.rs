//! Makes the table of `docs/plan.md` of what leaving things out saves: scenes that do not need a thing, without it and with it forced.
//!
//! ```sh
//! cargo run --release --example ablation
//! ```
//!
//! Each render is a process of its own, on one thread, so that what it took at most is its own; of three, the least counts.

mod measure;

use std::sync::atomic::AtomicBool;

use measure::{Outcome, numbers, one_thread};
use volpm::compare::{cpu_seconds, peak_bytes};
use volpm::render::{Camera, Forced, Limits, Plan, Silent, refine_planned};
use volpm::scene;

/// What a scene is called, and how it differs from the room.
type Case = (&'static str, &'static [&'static str]);

/// A room with a lamp, a matte ball and one of glass.
const ROOM: &str = r#"
film = { width = 160, height = 120, layers = false }
camera = { position = [0, 0, 3.9], target = [0, -0.5, 0] }
render = { samples = 4, method = "path" }
photons = { volume = 300_000 }
materials.wall = { type = "lambert", reflectance = 0.6 }
materials.glass = { type = "dielectric", ior = 1.5 }
media.fog = { sigma_s = 0.1, sigma_a = 0.01 }
[[shapes]]
type = "box"
min = [-4, -4, -4]
max = [4, 4, 4]
material = "wall"
[[shapes]]
type = "sphere"
center = [-1.2, -1, 0]
radius = 1
material = "wall"
[[shapes]]
type = "sphere"
center = [1.2, -1, 0]
radius = 1
material = "glass"
[[lights]]
type = "point"
position = [1, 3, 0]
intensity = 5
"#;

const PATHS: Case = ("room, paths", &[]);
const FOG_PATHS: Case = ("fog, paths", &["world.medium=fog"]);
const FOG: Case = ("fog, photons", &["world.medium=fog", "render.method=photon"]);
const FOG_SHOWN: Case = ("fog, photons shown", &["world.medium=fog", "render.method=photon", "surface.indirect=map"]);
const FEW_EVENTS: Case = ("room, six events", &["render.max_depth=6"]);

/// What is forced, in which scene: one that does without it.
const CASES: [(&[Forced], Case); 12] = [
    (&[Forced::EternityPilot], FEW_EVENTS),
    (&[Forced::Importons], FOG),
    (&[Forced::VolumePhotons], FOG_PATHS),
    (&[Forced::CausticPhotons], PATHS),
    (&[Forced::GlobalPhotons], PATHS),
    (&[Forced::GlobalPhotons, Forced::Irradiances], PATHS),
    (&[Forced::GlobalPhotons, Forced::FluxMap], PATHS),
    (&[Forced::ShadowPhotons], PATHS),
    (&[Forced::SparseVolumeMap], FOG_SHOWN),
    (&[Forced::PathSplitting], FOG_PATHS),
    (&[Forced::FilmLayers], PATHS),
    (&[Forced::PassSums], PATHS),
];
/// Renders of which the least counts.
const TIMES: usize = 3;

fn main() -> Outcome<()> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    if let Some((case, forces)) = arguments.split_first() {
        return render(CASES[case.parse::<usize>()?], forces == ["forced"]);
    }
    println!("| forced | scene | s | forced | peak, MB | forced | maps and film, MB | forced |");
    println!("|---|---|--:|--:|--:|--:|--:|--:|");
    for (case, (forced, (scene, _))) in CASES.iter().enumerate() {
        let [without, with] = [measured(case, "plain")?, measured(case, "forced")?];
        let names: Vec<String> = forced.iter().map(|forced| format!("`{forced}`")).collect();
        let facts = (0..3).map(|of| match of {
            0 => format!("{:.2} | {:.2}", without[of], with[of]),
            _ => format!("{:.1} | {:.1}", 1e-6 * without[of], 1e-6 * with[of]),
        });
        println!("| {} | {scene} | {} |", names.join(", "), facts.collect::<Vec<_>>().join(" | "));
    }
    Ok(())
}

/// Seconds, the most memory, and the bytes of maps and film: the least of some renders.
fn measured(case: usize, forces: &str) -> Outcome<[f64; 3]> {
    let mut least = [f64::INFINITY; 3];
    for _ in 0..TIMES {
        for (least, found) in least.iter_mut().zip(numbers(&[&case.to_string(), forces])?) {
            *least = least.min(found);
        }
    }
    Ok(least)
}

/// One render, with what it took on stdout.
fn render((forced, (_, overrides)): (&[Forced], Case), forces: bool) -> Outcome<()> {
    let overrides: Vec<String> = overrides.iter().map(ToString::to_string).collect();
    let (scene, settings) = scene::build(&scene::parse(ROOM, "ablation.toml".as_ref(), &overrides)?)?;
    let limits = Limits { forced: if forces { forced.to_vec() } else { Vec::new() }, ..Limits::default() };
    let stop = AtomicBool::new(false);
    let rendering = one_thread()?.install(|| {
        let plan = Plan::new(&scene, &settings, &Camera::new(&scene.camera, &settings.film), &limits)?;
        refine_planned(&scene, &settings, plan, &limits, None, &Silent, &stop)
    })?;
    let stats = &rendering.stats;
    let bytes = stats.map_bytes + stats.surface_bytes + limits.film_bytes(&settings, 1);
    println!("{} {} {bytes}", cpu_seconds().unwrap_or(0.0), peak_bytes().unwrap_or(0));
    Ok(())
}
