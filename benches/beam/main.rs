//! Speed of the photon map: building it, and beam queries in nanoseconds per gathered photon and
//! per ray, by kind of medium. One thread for queries. `cargo bench --bench beam`; a number after
//! `--` sets how many photons (default 1 000 000), `AVX-512`, `AVX2` or `portable` the instructions of queries
//! (default the fastest).
//!
//! Even: photons spread over a cube five wide, seen from within, from the middle of a face, at 50 degrees. Beams: six
//! narrow cones in a larger box, seen from a wall of it at 70 degrees.
//! Camera: rays of a picture of 256 × 256 pixels, some of its tiles, or all where few photons are met, those of
//! neighbouring pixels one after the other. Anyhow: rays
//! between random points.

mod floor;
mod paper;
#[path = "../photons/mod.rs"]
mod photons;

use glam::{DAffine3, DVec3, Vec3};
use std::sync::Arc;
use std::time::Instant;
use volpm::gather::{
    BeamQuery, Bundle, BundleScratch, DepthTable, Fan, GatherStats, Gathered, Lattices, PhaseLanes, SampledDepths,
    Samples, StreamScratch,
};
use volpm::math::random::{Purpose, Stream};
use volpm::math::{Frame, Ray};
use volpm::medium::density::bricks::{BrickGrid, NegativePolicy};
use volpm::medium::density::{Density, Grid};
use volpm::medium::phase::{HenyeyGreenstein, Isotropic, Rayleigh, Schlick};
use volpm::photon::{Disc, Instructions, MapSettings, Photon, PhotonMap, Radius};

const SIGMA: f32 = 0.4;

/// Rays of a pinhole camera looking along `forward`, this many degrees wide, 256 pixels, four rays a pixel, from every
/// n-th tile of the picture.
fn camera(from: DVec3, forward: DVec3, degrees: f64, every: usize) -> Vec<Ray> {
    let mut stream = Stream::new(3, Purpose::Test, 0, 0);
    let frame = Frame::around(forward);
    let reach = (0.5 * degrees.to_radians()).tan();
    let mut all = Vec::new();
    for tile in (0..32 * 32).step_by(every) {
        let corner = [tile % 32, tile / 32].map(|x| 8.0 * f64::from(x));
        for i in 0..256 {
            let (pixel, [a, b]) = (i / 4, stream.uniform2());
            let half = |code: usize| (code & 1 | code >> 1 & 2 | code >> 2 & 4) as f64;
            let x = reach * ((corner[0] + half(pixel) + a) / 128.0 - 1.0);
            let y = reach * ((corner[1] + half(pixel >> 1) + b) / 128.0 - 1.0);
            all.push(Ray::new(from, (frame.z + x * frame.x + y * frame.y).normalize()));
        }
    }
    all
}

fn anyhow(rays: usize) -> Vec<Ray> {
    let mut stream = Stream::new(4, Purpose::Test, 0, 0);
    let mut point = || DVec3::from_array([0; 3].map(|_| 5.0 * stream.uniform() - 2.5));
    let mut one = || {
        let from = point();
        Ray::new(from, (point() - from).normalize())
    };
    (0..rays).map(|_| one()).collect()
}

/// Seconds that this thread has run: a machine's other work does not count.
fn seconds() -> f64 {
    let mut time = libc::timespec { tv_sec: 0, tv_nsec: 0 };
    // SAFETY: the call writes one timespec, which `time` is.
    unsafe { libc::clock_gettime(libc::CLOCK_THREAD_CPUTIME_ID, &mut time) };
    time.tv_sec as f64 + 1e-9 * time.tv_nsec as f64
}

fn measure(name: &str, map: &PhotonMap, rays: &[Ray], template: &BeamQuery) {
    let mut best = f64::INFINITY;
    let mut stats = GatherStats::default();
    for _ in 0..5 {
        stats = GatherStats::default();
        let mut sum = 0.0;
        let start = seconds();
        for ray in rays {
            let query = BeamQuery { origin: ray.origin, direction: ray.direction, ..*template };
            sum += map.gather(&query, &mut stats).total[1];
        }
        std::hint::black_box(sum);
        best = best.min(seconds() - start);
    }
    let of = |x: u64| x as f64 / rays.len() as f64;
    println!(
        "  {name:34} {:7.2} ns/photon {:9.0} ns/ray   {:6.0} photons, {:5.0} blocks, {:4.0} nodes a ray; {:.1} tested a hit",
        best * 1e9 / stats.photons.max(1) as f64,
        best * 1e9 / rays.len() as f64,
        of(stats.photons),
        of(stats.blocks),
        of(stats.nodes),
        16.0 * stats.blocks as f64 / stats.photons.max(1) as f64,
    );
}

/// By how much pixels, each of four rays, are off relative to single queries.
#[derive(Default)]
struct Off(Vec<f32>);

impl Off {
    fn add<R>(&mut self, rays: &[R], found: &[Gathered], mut alone: impl FnMut(&R) -> Gathered) {
        for (rays, found) in rays.chunks(4).zip(found.chunks(4)) {
            let exact: Vec3 = rays.iter().map(|ray| Vec3::from(alone(ray).total)).sum();
            let found: Vec3 = found.iter().map(|gathered| Vec3::from(gathered.total)).sum();
            if exact.max_element() > 0.0 {
                self.0.push((exact - found).abs().max_element() / exact.max_element());
            }
        }
    }
}

impl std::fmt::Display for Off {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let mut sorted = self.0.clone();
        sorted.sort_by(f32::total_cmp);
        let at = |share: f64| sorted.get((share * (sorted.len().max(1) - 1) as f64) as usize).copied().unwrap_or(0.0);
        let far = sorted.iter().filter(|off| **off > 1e-3).count();
        write!(f, "pixels off by {:.1e} in the median, {:.1e} in 99 %, {:.1e} at most", at(0.5), at(0.99), at(1.0))?;
        write!(f, "; {far} of {} by more than 1e-3", sorted.len())
    }
}

/// Bundles of 256 rays, as of 8 × 8 pixels, against single queries.
fn measure_bundles(name: &str, map: &PhotonMap, rays: &[Ray], template: &BeamQuery) {
    let reaches: Vec<(Ray, f64, f64)> = rays.iter().map(|ray| (*ray, 0.0, f64::from(template.length))).collect();
    let mut scratch = BundleScratch::default();
    let (mut best, mut off, mut hits) = (f64::INFINITY, Off::default(), 0);
    let mut out = Vec::new();
    let mut stats = GatherStats::default();
    for round in 0..5 {
        stats = GatherStats::default();
        let mut total = 0.0;
        let mut exact = GatherStats::default();
        for rays in reaches.chunks(256) {
            let bundle = Bundle {
                rays,
                phase: template.phase,
                extinction: template.extinction,
                max_events: template.max_events,
                pruned: false,
                depths: None,
            };
            let start = seconds();
            map.gather_bundle(&bundle, &mut scratch, &mut stats, &mut out);
            total += seconds() - start;
            if round == 0 {
                off.add(rays, &out, |(ray, ..)| {
                    let query = BeamQuery { origin: ray.origin, direction: ray.direction, ..*template };
                    map.gather(&query, &mut exact)
                });
                hits = exact.photons;
            }
        }
        best = best.min(total);
    }
    println!(
        "  {name:34} {:7.3} ns/photon {:9.0} ns/ray   in bundles; {:.2} tested a hit; {off}",
        best * 1e9 / hits.max(1) as f64,
        best * 1e9 / rays.len() as f64,
        16.0 * stats.blocks as f64 / hits.max(1) as f64,
    );
}

/// What rays through 8 × 8 pixels span.
fn fan(rays: &[Ray]) -> Fan {
    let sum: DVec3 = rays.iter().map(|ray| ray.direction).sum();
    let frame = Frame::around(sum.normalize());
    let slope = |ray: &Ray| {
        let local = frame.to_local(ray.direction);
        local.x.abs().max(local.y.abs()) / local.z
    };
    Fan { origin: rays[0].origin, frame, slope: rays.iter().map(slope).fold(0.0, f64::max), rays: rays.len() }
}

/// The beam estimate in a grid of uneven density, 64 voxels along each edge of the cube: with its depths sampled already, and
/// with the time that takes.
fn measure_grid(map: &PhotonMap, rays: &[Ray], template: &BeamQuery) {
    const VOXELS: usize = 64;
    let width = 5.0 / VOXELS as f64;
    let value =
        |i: usize| 0.75 + 0.5 * ((i % VOXELS / 8 + i / VOXELS % VOXELS / 8 + i / VOXELS / VOXELS / 8) % 2) as f32;
    let values: Vec<f32> = (0..VOXELS.pow(3)).map(value).collect();
    let corner = [-(VOXELS as i32) / 2; 3];
    let bricks = BrickGrid::from_dense(corner, [VOXELS; 3], &values, 0.0, NegativePolicy::Error).expect("finite");
    let density = Density::Grid(Grid::new(Arc::new(bricks), DAffine3::from_scale(DVec3::splat(width))));
    let mut scratch = BundleScratch::default();
    let (mut out, mut stats) = (Vec::new(), GatherStats::default());
    let (mut best, mut best_with, mut off) = (f64::INFINITY, f64::INFINITY, Off::default());
    for round in 0..5 {
        stats = GatherStats::default();
        let (mut sampling, mut gathering) = (0.0, 0.0);
        for rays in rays.chunks(256) {
            let reaches: Vec<(Ray, f64, f64)> = rays.iter().map(|ray| (*ray, 0.0, 7.5)).collect();
            let (mut lattices, mut depths) = (Lattices::default(), SampledDepths::default());
            let start = seconds();
            lattices.begin(Some(fan(rays)));
            let sample = |(ray, a, b): &(Ray, f64, f64)| {
                let (step, sigma) = (0.5 * width, f64::from(SIGMA));
                let (range, most) = ((*a, *b), 0.15 / sigma);
                lattices
                    .sample((0, &density), step, ray, range, (most, sigma), &mut depths)
                    .or_else(|| depths.sample(&density, step, ray, range, most))
                    .expect("smooth enough")
                    .0
            };
            let samples: Vec<Samples> = reaches.iter().map(sample).collect();
            let middle = seconds();
            let bundle = Bundle {
                rays: &reaches,
                phase: template.phase,
                extinction: template.extinction,
                max_events: template.max_events,
                pruned: false,
                depths: Some((&depths, 0.5 * width, &samples)),
            };
            map.gather_bundle(&bundle, &mut scratch, &mut stats, &mut out);
            gathering += seconds() - middle;
            sampling += middle - start;
            if round == 0 {
                let mut table = DepthTable::new();
                off.add(&reaches, &out, |(ray, a, b)| {
                    let fine = 0.125 * width;
                    let (mut t, mut depth) = (*a, 0.0);
                    table.clear();
                    while t < *b {
                        table.push(t, depth, density.at(ray.at(t)));
                        depth += density.depth(ray, t, t + fine);
                        t += fine;
                    }
                    table.finish();
                    let query =
                        BeamQuery { origin: ray.origin, direction: ray.direction, depth: Some(&table), ..*template };
                    map.gather(&query, &mut GatherStats::default())
                });
            }
        }
        best = best.min(gathering);
        best_with = best_with.min(gathering + sampling);
    }
    println!(
        "  {:34} {:7.3} ns/photon {:9.0} ns/ray   in bundles; {:.3} ns/photon with its depths; {off}",
        "camera, grid",
        best * 1e9 / stats.photons.max(1) as f64,
        best * 1e9 / rays.len() as f64,
        best_with * 1e9 / stats.photons.max(1) as f64,
    );
}

/// The beam estimate along rays from anywhere, in streams of 8192.
fn measure_streams(name: &str, map: &PhotonMap, rays: &[Ray], template: &BeamQuery) {
    let reaches: Vec<(Ray, f64, f64)> = rays.iter().map(|ray| (*ray, 0.0, f64::from(template.length))).collect();
    let mut scratch = StreamScratch::default();
    let mut best = f64::INFINITY;
    let mut out = Vec::new();
    let mut stats = GatherStats::default();
    for _ in 0..3 {
        stats = GatherStats::default();
        let bundle = Bundle {
            rays: &reaches,
            phase: template.phase,
            extinction: template.extinction,
            max_events: template.max_events,
            pruned: false,
            depths: None,
        };
        let start = seconds();
        map.gather_stream(&bundle, &mut scratch, &mut stats, &mut out);
        best = best.min(seconds() - start);
    }
    println!(
        "  {name:34} {:7.3} ns/photon {:9.0} ns/ray   in streams; {:.2} tested a hit",
        best * 1e9 / stats.photons.max(1) as f64,
        best * 1e9 / rays.len() as f64,
        16.0 * stats.blocks as f64 / stats.photons.max(1) as f64,
    );
}

/// What roulette by transmittance saves, and the noise it adds to a ray, in media of more and more mean free paths.
fn measure_pruning(map: &PhotonMap, rays: &[Ray], template: &BeamQuery) {
    for sigma in [0.4, 1.0, 2.0, 4.0, 10.0] {
        let reaches: Vec<(Ray, f64, f64)> = rays.iter().map(|ray| (*ray, 0.0, 5.0)).collect();
        let (mut bundles, mut streams) = (BundleScratch::default(), StreamScratch::default());
        let mut spent = [[f64::INFINITY; 2]; 2];
        let mut found = [[Vec::new(), Vec::new()], [Vec::new(), Vec::new()]];
        for _ in 0..3 {
            for pruned in [false, true] {
                let bundle = |rays| Bundle {
                    rays,
                    phase: template.phase,
                    extinction: Vec3::splat(sigma),
                    max_events: template.max_events,
                    pruned,
                    depths: None,
                };
                let mut stats = GatherStats::default();
                let [together, alone] = &mut found[usize::from(pruned)];
                together.clear();
                let start = seconds();
                let mut out = Vec::new();
                for rays in reaches.chunks(256) {
                    map.gather_bundle(&bundle(rays), &mut bundles, &mut stats, &mut out);
                    together.extend_from_slice(&out);
                }
                let middle = seconds();
                map.gather_stream(&bundle(&reaches), &mut streams, &mut stats, alone);
                let [by_bundles, by_streams] = &mut spent[usize::from(pruned)];
                *by_bundles = by_bundles.min(middle - start);
                *by_streams = by_streams.min(seconds() - middle);
            }
        }
        let off = |way: usize| {
            let squares = found[0][way].iter().zip(&found[1][way]).map(|(all, some)| {
                let (all, some) = (f64::from(all.total[1]), f64::from(some.total[1]));
                ((some - all).powi(2), all.powi(2))
            });
            let (off, all) = squares.fold((0.0, 0.0), |sum, x| (sum.0 + x.0, sum.1 + x.1));
            (off / all).sqrt()
        };
        let each = |way: usize, pruned: usize| spent[pruned][way] * 1e9 / rays.len() as f64;
        println!(
            "  {:34} bundles {:6.0} ns/ray, pruned {:6.0}, off by {:.1e}; streams {:6.0}, pruned {:6.0}, off by {:.1e}",
            format!("depth {}", 5.0 * sigma),
            each(0, 0),
            each(0, 1),
            off(0),
            each(1, 0),
            each(1, 1),
            off(1),
        );
    }
}

/// The floor, and the hierarchy of the paper, on some of the rays.
fn compare(map: &PhotonMap, rays: &[Ray], instructions: Instructions) {
    let name = instructions.to_string();
    let discs: Vec<Disc> = map.discs().collect();
    let some: Vec<&Ray> = rays.iter().step_by(rays.len().div_ceil(32)).collect();
    let (mut gathered, mut spent) = (0, 0.0);
    for ray in &some {
        let list = floor::List::of(&discs, ray);
        if list.len() == 0 {
            continue;
        }
        // As often as fills a few milliseconds; the best of several.
        let times = 4_000_000 / list.len();
        let prepared = floor::Prepared::new(ray);
        let best = (0..5)
            .filter_map(|_| {
                let start = seconds();
                for _ in 0..times {
                    std::hint::black_box(list.evaluate(std::hint::black_box(&prepared), SIGMA, 0.75, &name)?);
                }
                Some((seconds() - start) / times as f64)
            })
            .fold(f64::INFINITY, f64::min);
        gathered += list.len();
        spent += best;
    }
    println!("  {:34} {:7.3} ns/photon", format!("floor, HG 0.75, {name}"), spent * 1e9 / gathered as f64);

    let paper = paper::Paper::build(discs);
    let (mut photons, mut worst, mut best) = (0, 0.0f32, f64::INFINITY);
    for _ in 0..3 {
        photons = 0;
        let start = seconds();
        for ray in &some {
            photons += std::hint::black_box(paper.gather(ray, SIGMA, 0.75)).photons;
        }
        best = best.min(seconds() - start);
    }
    let phase = PhaseLanes::new(HenyeyGreenstein { g: 0.75 });
    for ray in &some {
        let query = BeamQuery { origin: ray.origin, direction: ray.direction, ..query(&phase) };
        let ours = Vec3::from(map.gather(&query, &mut GatherStats::default()).total);
        let theirs = paper.gather(ray, SIGMA, 0.75).radiance;
        if ours.max_element() > 0.0 {
            worst = worst.max((ours - theirs).abs().max_element() / ours.max_element());
        }
    }
    println!(
        "  {:34} {:7.2} ns/photon; differs by {worst:.0e} at most",
        "hierarchy of the paper, HG 0.75",
        best * 1e9 / photons as f64
    );
}

fn query(phase: &PhaseLanes) -> BeamQuery<'_> {
    BeamQuery {
        origin: DVec3::ZERO,
        direction: DVec3::Z,
        length: f32::INFINITY,
        phase,
        extinction: Vec3::splat(SIGMA),
        depth: None,
        hull: None,
        max_events: 255,
        pruning: None,
    }
}

fn build(name: &str, photons: &[Photon], radius: Radius, instructions: Instructions) -> PhotonMap {
    let mut best = f64::INFINITY;
    let mut map = None;
    let settings = MapSettings::new(radius);
    for _ in 0..3 {
        let photons = photons.to_vec();
        let start = Instant::now();
        map = Some(PhotonMap::build(photons, &settings, &|_: Vec3, _: f32, _: f32, _: &mut _| ()));
        best = best.min(start.elapsed().as_secs_f64());
    }
    let mut map = map.unwrap();
    map.use_instructions(instructions);
    println!(
        "{name}: {} photons, {:?}, {:.1} bytes a photon; built in {:.3} s by {} threads",
        map.len(),
        map.radii(),
        map.bytes() as f64 / map.len() as f64,
        best,
        rayon::current_num_threads(),
    );
    map
}

fn main() {
    let count = std::env::args().skip(1).find_map(|a| a.parse().ok()).unwrap_or(1_000_000);
    let available = Instructions::available();
    let named = |set: &&Instructions| std::env::args().skip(1).any(|a| a == set.to_string());
    let set = *available.iter().find(named).unwrap_or(&available[0]);
    println!("queries by {set}");
    let phases = [
        ("isotropic", PhaseLanes::new(Isotropic)),
        ("Henyey-Greenstein 0.75", PhaseLanes::new(HenyeyGreenstein { g: 0.75 })),
        ("Schlick 0.7", PhaseLanes::new(Schlick { k: 0.7 })),
        ("Rayleigh", PhaseLanes::new(Rayleigh)),
        ("Henyey-Greenstein 0.95", PhaseLanes::new(HenyeyGreenstein { g: 0.95 })),
    ];
    let mut table = DepthTable::new();
    for i in 0..=100 {
        table.push(0.2 * f64::from(i), 0.2 * f64::from(i), 1.0);
    }
    table.finish();

    let photons = photons::even(count);
    let variable = Radius::Variable { neighbours: 500, pilot: 23, max_radius: 1.0 };
    let map = build("even, variable", &photons, variable, set);
    let view = |every: usize| camera(DVec3::new(0.0, 0.0, -2.45), DVec3::Z, 50.0, every);
    let rays = view(61);
    for (name, phase) in &phases {
        measure(&format!("camera, {name}"), &map, &rays, &query(phase));
        measure_bundles(&format!("camera, {name}"), &map, &rays, &query(phase));
    }
    let plain = query(&phases[1].1);
    measure("camera, coloured", &map, &rays, &BeamQuery { extinction: Vec3::new(0.2, 0.4, 0.6), ..plain });
    measure_bundles("camera, coloured", &map, &rays, &BeamQuery { extinction: Vec3::new(0.2, 0.4, 0.6), ..plain });
    measure_grid(&map, &rays, &plain);
    measure("camera, tabulated", &map, &rays, &BeamQuery { depth: Some(&table), ..plain });
    measure("anyhow", &map, &anyhow(2000), &plain);
    measure_streams("anyhow", &map, &anyhow(8192), &plain);
    measure_pruning(&map, &rays, &plain);
    compare(&map, &rays, set);

    for radius in [0.02, 0.04, 0.06, 0.1] {
        let map = build("even, fixed", &photons, Radius::Fixed(radius), set);
        measure("camera", &map, &rays, &plain);
        measure_bundles("camera", &map, &view(1), &plain);
        measure("anyhow", &map, &anyhow(4000), &plain);
        measure_streams("anyhow", &map, &anyhow(8192), &plain);
        compare(&map, &rays, set);
    }

    let mut piled = photons;
    for photon in piled.iter_mut().step_by(2) {
        photon.position = Vec3::splat(0.1);
    }
    build("even, but half at one place, variable", &piled, variable, set);

    let map = build("beams, variable", &photons::beams(count), variable, set);
    let rays = camera(DVec3::new(0.0, -14.0, -0.5), DVec3::Y, 70.0, 13);
    measure("camera", &map, &rays, &plain);
    measure_bundles("camera", &map, &rays, &plain);
    compare(&map, &rays, set);
}
