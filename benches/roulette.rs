//! What roulette by power could save (§7 of Jarosz, Zwicker and Jensen 2008 leaves it open): of the blocks of 16 photons
//! that a camera ray meets, the share that must be evaluated if each survives with a probability proportional to its
//! importance, the rest counting accordingly more, so that the noise this adds to a ray is a given share of what it
//! gathers. `cargo bench --bench roulette`, from the root of the repository.
//!
//! Importance by transmittance is what queries use (`Pruning`); by power, a block's powers over r² times that is known
//! before it is read; with foresight, it is what the block contributes, and nothing can do better. The walk to the
//! blocks is not counted, and the noise is what one ray by itself would have: rays of a bundle would share it.

use std::collections::BTreeMap;
use std::path::PathBuf;
use volpm::math::random::{Purpose, Stream};
use volpm::math::{Ray, Vec3};
use volpm::medium::Medium;
use volpm::photon::{self, Disc, Emission, MapSettings, Pass, PhotonMap, Radius};
use volpm::render::Camera;
use volpm::scene::description::SingleScattering;
use volpm::scene::{self, Settings};
use volpm::transport::Events;

const BLOCK: usize = 16;
const PHOTONS: u64 = 300_000;
const RAYS: usize = 200;
const NOISE: [f64; 3] = [1e-2, 1e-3, 1e-4];
const WAYS: [&str; 3] = ["transmittance", "power", "foresight"];

/// A block that a ray meets: what it contributes, and its importance in each way.
#[derive(Clone, Copy, Default)]
struct Met {
    sum: f64,
    importance: [f64; 3],
}

/// The blocks that a ray meets, and the noise of the map itself, as a share of all.
fn meet(discs: &[Disc], medium: &Medium, ray: &Ray) -> (Vec<Met>, f64) {
    let mut blocks = BTreeMap::<usize, Met>::new();
    let (mut total, mut squares) = (0.0, 0.0);
    for (index, disc) in discs.iter().enumerate() {
        let to = disc.photon.position.as_dvec3() - ray.origin;
        let t = to.dot(ray.direction);
        let inverse_square = f64::from(disc.radius).powi(-2);
        let q = 1.0 - (to - t * ray.direction).length_squared() * inverse_square;
        if t <= 0.0 || q <= 0.0 {
            continue;
        }
        let (_, phase) =
            medium.phase.value(disc.photon.position.as_dvec3(), disc.photon.direction.as_dvec3(), -ray.direction);
        let transmittance = (-medium.extinction.x * t).exp();
        let power = f64::from(disc.photon.power.x) * inverse_square * transmittance;
        let value = power * q * q * phase;
        let block = blocks.entry(index / BLOCK).or_default();
        block.sum += value;
        let [passed, powers, sum] = &mut block.importance;
        *passed = passed.max(transmittance);
        *powers += power;
        *sum += value;
        total += value;
        squares += value * value;
    }
    (blocks.into_values().collect(), squares.sqrt() / total)
}

/// The share of blocks that survive where that adds noise of `noise` times the whole.
fn surviving(blocks: &[Met], way: usize, noise: f64) -> f64 {
    let total: f64 = blocks.iter().map(|block| block.sum).sum();
    let greatest = blocks.iter().map(|block| block.importance[way]).fold(0.0, f64::max);
    let chance = |block: &Met, limit: f64| (block.importance[way] / (limit * greatest)).min(1.0);
    // Bisection for the importance below which blocks may be left out.
    let (mut least, mut most) = (1e-12f64, 1e12f64);
    while most / least > 1.0 + 1e-6 {
        let limit = (least * most).sqrt();
        let variance: f64 = blocks.iter().map(|block| block.sum.powi(2) * (1.0 / chance(block, limit) - 1.0)).sum();
        *(if variance > (noise * total).powi(2) { &mut most } else { &mut least }) = limit;
    }
    blocks.iter().map(|block| chance(block, least)).sum::<f64>() / blocks.len() as f64
}

fn main() {
    for name in ["cornell", "stage", "cars", "lighthouse"] {
        let path = PathBuf::from(format!("scenes/paper/{name}.toml"));
        let scene = scene::read(&path, &[]).and_then(|description| scene::build(&description));
        let (scene, Settings { film, .. }) = scene.unwrap_or_else(|error| panic!("{error}"));
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
        let mut traced =
            photon::trace(&scene, &pass, &|_, _| {}, &|| false).expect("it is no more than a pass may take");
        traced.regions.sort_by_key(Vec::len);
        let photons = traced.regions.pop().expect("the scene has a medium");
        let radius = Radius::Variable { neighbours: 300, pilot: 18, max_radius: 0.5 };
        let map = PhotonMap::build(photons, &MapSettings::new(radius), &|_: Vec3, _: f32, _: f32, _: &mut _| ());
        let discs: Vec<Disc> = map.discs().collect();

        let camera = Camera::new(&scene.camera, &film);
        let mut stream = Stream::new(5, Purpose::Test, 0, 0);
        let (mut rays, mut own, mut met) = (0.0, 0.0, 0);
        let mut shares = [[0.0; WAYS.len()]; NOISE.len()];
        for _ in 0..RAYS {
            let [x, y] = stream.uniform2();
            let (x, y) = (x * f64::from(film.width), y * f64::from(film.height));
            let ray = camera.ray(x as u32, y as u32, &mut stream);
            let (blocks, noise) = meet(&discs, &scene.media[0], &ray);
            if blocks.is_empty() {
                continue;
            }
            rays += 1.0;
            own += noise;
            met += blocks.len();
            for (noise, shares) in NOISE.into_iter().zip(&mut shares) {
                for (way, share) in shares.iter_mut().enumerate() {
                    *share += surviving(&blocks, way, noise);
                }
            }
        }
        println!("{name}: {:.0} blocks a ray; noise of the map {:.3}", met as f64 / rays, own / rays);
        for (noise, shares) in NOISE.into_iter().zip(shares) {
            let of = |way: usize| format!("{} {:.0} %", WAYS[way], 100.0 * shares[way] / rays);
            println!("  noise {noise:.0e}: by {}, {}, {}", of(0), of(1), of(2));
        }
    }
}
