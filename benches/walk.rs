//! How fast light wanders through dense solids: emissions and seconds of a thread for a lamp in a ball of milk of so many mean free paths,
//! where most walks never come near the surface, and where they do. `cargo bench --bench walk`.

use std::path::Path;
use std::time::Instant;

use volpm::photon::{self, Emission, Pass};
use volpm::scene;
use volpm::scene::description::SingleScattering;
use volpm::transport::Events;

const ALBEDO: f64 = 0.9995;
const PHOTONS: u64 = 2000;

fn main() {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("a thread");
    for (what, sigma) in [("white", "1.0"), ("coloured", "[0.9, 1.0, 1.1]")] {
        for radius in [60.0, 10.0] {
            let text = format!(
                "[camera]\nposition = [0, 0, 999]\ntarget = [0, 0, 0]\n[media.milk]\nsigma_t = {sigma}\nalbedo = {ALBEDO}\n\
                 [[shapes]]\ntype = \"sphere\"\ncenter = [0, 0, 0]\nradius = {radius}\ninterior = \"milk\"\n\
                 [[lights]]\ntype = \"point\"\nposition = [0, 0, 0]\nintensity = 1\n"
            );
            let description =
                scene::parse(&text, Path::new("milk.toml"), &[]).unwrap_or_else(|error| panic!("{error}"));
            let (scene, _) = scene::build(&description).unwrap_or_else(|error| panic!("{error}"));
            let pass = Pass {
                seed: 1,
                index: 0,
                target: PHOTONS,
                max_emitted: 1000 * PHOTONS,
                emission: Emission::default(),
                max_events: Events::unlimited(),
                single_scattering: SingleScattering::Photons,
                importons: None,
                control: None,
            };
            let start = Instant::now();
            let traced = pool.install(|| photon::trace(&scene, &pass, &|_, _| {}, &|| false));
            let traced = traced.expect("it is no more than a pass may take");
            let seconds = start.elapsed().as_secs_f64();
            println!("{what}, radius {radius}: {} emitted, {} stored, {seconds:.2} s", traced.emitted, traced.stored());
        }
    }
}
