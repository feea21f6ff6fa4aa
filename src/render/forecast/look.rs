//! What the pixels of a pass have to do, by a few of them.

use std::sync::atomic::{AtomicU64, Ordering};

use super::sample::Samples;
use super::work::{Clock, SHORTEST, Timed, Unit, Work, timed};
use crate::gather::{GatherStats, IrradianceCache, Queue};
use crate::math::Cells;
use crate::photon::{self, Kind, SurfacePass, sample_surfaces};
use crate::render::camera::Camera;
use crate::render::eye::{Context, Eye, EyeSettings, Happening, Indirect, Mode, Told};
use crate::render::irradiance::{BATCH, Filler, most_records};
use crate::render::maps::surface_order;
use crate::render::pass::order;
use crate::render::plan::{CacheSettings, Plan};
use crate::render::tile::{BUNDLE, every_second_bit, eye_settings, mode, set_out};
use crate::scene::Scene;
use crate::scene::description::Method;
use crate::surface::Nature;
use crate::transport::{Parts, Tally};

/// Bundles of pixels that are looked at.
const BUNDLES: u32 = 8;
/// Gather rays of a record that only tells how many records there will be: fewer than those of the render.
const FEW_RAYS: u32 = 48;
/// Records that are made for that, at most.
const RECORDS: u64 = 4096;
/// To find where records are wanted, each pixel is looked at so often, about: once from coarse to fine, and again in the end.
const LOOKS: f64 = 3.0;
/// What is timed is repeated until it takes so many times as long as a clock can tell,
const TELLING: f64 = 3.0;
/// but no more often than this.
const MOST_TIMES: u32 = 16;
/// Paths are broken off when that was asked about so often, each time after thousands of events of one path.
const PATIENCE: u64 = 64;

/// What an item has to do in one part of a pass, and a part of that which was done and timed.
pub(super) type Part = (&'static str, Work, Option<Timed>);

/// What a pass has to do, and parts of that.
#[derive(Clone, Copy, Debug, Default)]
struct Looked {
    /// For all camera samples.
    camera: (Work, Option<Timed>),
    /// For all records of the irradiance cache.
    records: (Work, Option<Timed>),
}

/// What some camera samples did.
#[derive(Clone, Copy, Default)]
struct Seen {
    samples: f64,
    all: Steps,
    /// Of that, what came after the first matte surface of each,
    onward: Steps,
    /// from which so many went on.
    sent: f64,
    gathered: GatherStats,
}

/// What happened to paths.
#[derive(Clone, Copy, Default)]
struct Steps {
    rays: f64,
    segments: f64,
    uneven: f64,
    bounces: f64,
    collisions: f64,
    /// Matte surfaces that were met.
    matte: f64,
}

impl Steps {
    /// Counts a step of a path.
    fn count(&mut self, scene: &Scene, what: &Happening) {
        match what {
            Happening::Segment { medium, .. } => {
                self.segments += 1.0;
                self.uneven += f64::from(!scene.media[*medium as usize].density.is_even());
            }
            Happening::Surface { nature, onward, .. } => {
                self.bounces += 1.0;
                self.rays += f64::from(onward.is_some());
                self.matte += f64::from(*nature == Nature::Diffuse);
            }
            Happening::Collision { onward, .. } => {
                self.collisions += 1.0;
                self.rays += f64::from(onward.is_some());
            }
            Happening::Light { .. } | Happening::Escape => {}
        }
    }
}

/// What a ray among so many shapes and triangles costs, against one among few.
fn depth(scene: &Scene) -> f64 {
    let primitives: u64 = (0..scene.geometry.placed().len() as u32)
        .map(|shape| u64::from(scene.geometry.triangles(shape).unwrap_or(1)))
        .sum();
    1.0 + DEEPER * (primitives.max(1) as f64).log2()
}

/// By how much a look-up costs more where photons are counted and no irradiance is known beforehand.
const COUNTED: f64 = 5.0;
/// By how much rays cost more where there are twice as many triangles.
const DEEPER: f64 = 0.15;

/// What each item has to do in one part of a pass.
pub(super) fn work_of_all(
    scene: &Scene,
    camera: &Camera,
    plan: &Plan,
    samples: &Samples,
    clock: Clock<'_>,
) -> Vec<Part> {
    let mut works = of_photons(scene, samples);
    works.extend(samples.unread.iter().flat_map(|unread| of_photons(scene, unread)));
    let Looked { camera: (work, timed), records } = look(scene, camera, plan, samples, clock);
    works.push(("camera_paths", work, timed));
    if plan.cache.is_some() {
        works.push(("irradiance_cache", records.0, records.1));
    }
    if plan.method == Method::Light {
        let (width, height) = (camera.window().width, camera.window().height);
        let paths = f64::from(width) * f64::from(height) * f64::from(plan.samples);
        works.push(("light_paths", of_light_paths(scene, plan).times(paths), None));
    }
    works
}

/// Emissions of pilots, of each map.
const PILOTS: f64 = 25_000.0;

/// What photons and their maps have to do.
fn of_photons(scene: &Scene, samples: &Samples) -> Vec<Part> {
    let deep = depth(scene);
    let wanders = scene.distances.iter().flatten().next().is_some();
    let mut works = Vec::new();
    for (photons, map, found, stored, wanders) in [
        ("volume_photons", "volume_map", &samples.volume, Unit::Photon, wanders),
        ("caustic_photons", "caustic_map", &samples.caustic, Unit::SurfacePhoton, false),
        ("global_photons", "global_map", &samples.global, Unit::SurfacePhoton, false),
        ("shadow_photons", "visibility_map", &samples.shadow, Unit::SurfacePhoton, false),
    ] {
        let Some(found) = found else { continue };
        let traced = |emitted: u64| {
            let all = emitted as f64 + PILOTS;
            let events = all * found.events as f64 / found.emitted.max(1) as f64;
            let event = if wanders { (Unit::Wandering, events) } else { (Unit::Event, deep * events) };
            Work::of(&[(Unit::Emission, deep * all), event])
        };
        works.push((photons, traced(found.emitted), Timed::new(traced(found.sampled), found.traced_in)));
        let part = found.sampled as f64 / found.emitted.max(1) as f64;
        let built = |photons: u64, part: f64| {
            let irradiances = part * found.irradiance_count as f64;
            Work::of(&[(stored, part * photons as f64), (Unit::Irradiance, irradiances)])
        };
        let all = built(found.stored + found.sparse_photons, 1.0);
        works.push((map, all, Timed::new(built(found.stored, part), found.built_in)));
    }
    works
}

/// What a light path has to do, by some photons; where these would be too long to trace, as if it had no events.
fn of_light_paths(scene: &Scene, plan: &Plan) -> Work {
    const FEW: u64 = 1000;
    let surfaces = SurfacePass { target: FEW, ..surface_order(plan, Kind::Global, 0) };
    let surfaces = sample_surfaces(scene, &surfaces, FEW).map_or(0.0, |landed| landed.events);
    let media = photon::sample(scene, &photon::Pass { target: FEW, ..order(plan, 0) }, FEW);
    let (events, deep) = (media.map_or(0.0, |traced| traced.events).max(surfaces), depth(scene));
    // Each event is seen by the camera, if nothing is in the way.
    Work::of(&[(Unit::Emission, deep), (Unit::Event, deep * events), (Unit::ShadowRay, deep * events)])
}

/// Looks at some pixels of a planned pass through maps of a part of its photons.
fn look(scene: &Scene, camera: &Camera, plan: &Plan, samples: &Samples, clock: Clock<'_>) -> Looked {
    let asked = AtomicU64::new(0);
    let stop = || asked.fetch_add(1, Ordering::Relaxed) >= PATIENCE;
    let maps = Some(&samples.maps).filter(|_| plan.method == Method::Photon);
    let settings = eye_settings(plan, camera, (mode(plan, maps), maps), &stop);
    let eye = Eye::new(scene, settings);
    let seen = some_pixels(scene, camera, plan, &eye);
    let window = camera.window();
    let pixels = f64::from(window.width) * f64::from(window.height);
    let paths = pixels * f64::from(plan.samples);
    let of_paths = |eye: &Eye<'_>, seen: &Seen| {
        let work = |full: f64| seen.work(scene, plan, &seen.all, full);
        let (times, seconds) = time_pixels(scene, camera, plan, eye, clock);
        (work(samples.fullness()).times(paths / seen.samples.max(1.0)), Timed::new(work(1.0).times(times), seconds))
    };
    let Some(cache) = plan.cache.filter(|_| eye.gathers()) else {
        return Looked { camera: of_paths(&eye, &seen), ..Looked::default() };
    };

    // Rays that records send, and that look where one is wanted.
    let finds = Work::of(&[(Unit::Ray, LOOKS * pixels * depth(scene))]);
    let work = |rays: f64, full: f64| {
        let onward = seen.work(scene, plan, &seen.onward, full);
        onward.times(if seen.sent > 0.0 { rays / seen.sent } else { 0.0 }) + finds
    };
    let ((filled, are_all), seconds) = timed(clock, || some_records(scene, camera, plan, &eye, cache, &stop));
    let few = (filled.len() * Cells::about(FEW_RAYS).count()) as f64;
    let records = most_records(camera.size(), plan.samples, &cache).min(filled.len() as u64);
    let sent = records as f64 * cache.rays() as f64;
    let records = (work(sent, samples.sparse_fullness()), Timed::new(work(few, 1.0), seconds));

    // Paths that a record tells the rest, or none does.
    let mut eye = Eye::new(
        scene,
        match are_all {
            true => settings,
            false => EyeSettings { indirect: Indirect::Nobody, ..settings },
        },
    );
    eye.keep(Some(&filled));
    let told = some_pixels(scene, camera, plan, &eye);
    Looked { camera: of_paths(&eye, &told), records }
}

/// Records of few rays, about as many as there will be of many; and whether they are all, or only the first.
fn some_records(
    scene: &Scene,
    camera: &Camera,
    plan: &Plan,
    eye: &Eye<'_>,
    settings: CacheSettings,
    stop: &(impl Fn() -> bool + Sync),
) -> (IrradianceCache, bool) {
    let most = most_records(camera.size(), plan.samples, &settings).min(RECORDS);
    let settings = CacheSettings { cells: Cells::about(FEW_RAYS), by_flux: 0, ..settings };
    let filler = Filler { scene, camera, plan, settings, eye, pass: 0, scale: 1.0 };
    let batches = AtomicU64::new(0);
    let filled = filler.fill(&|| batches.fetch_add(1, Ordering::Relaxed) >= most.div_ceil(BATCH as u64) || stop());
    let are_all = most < RECORDS || (filled.cache.len() as u64) < most;
    (filled.cache, are_all)
}

/// The bundles of pixels that are looked at: where each begins.
fn bundles(camera: &Camera) -> impl Iterator<Item = (u32, u32)> {
    // By the plastic number, which is to the plane what the golden ratio is to the line.
    const STEPS: [f64; 2] = [0.754_877_666_246_692_8, 0.569_840_290_998_053_3];
    let window = camera.window();
    (0..BUNDLES).map(move |bundle| {
        let place = |step: f64, from: u32, size: u32| {
            let share = (0.5 + f64::from(bundle) * step).fract();
            (from + (share * f64::from(size)) as u32) / BUNDLE * BUNDLE
        };
        (place(STEPS[0], window.x, window.width), place(STEPS[1], window.y, window.height))
    })
}

/// The pixels of a bundle that are on the film.
fn pixels_of(camera: &Camera, (x0, y0): (u32, u32)) -> impl Iterator<Item = (u32, u32)> {
    let (width, height) = camera.size();
    let pixels =
        (0..BUNDLE * BUNDLE).map(move |index| (x0 + every_second_bit(index), y0 + every_second_bit(index >> 1)));
    pixels.filter(move |&(x, y)| x < width && y < height)
}

/// Follows one path from each pixel of some bundles.
fn some_pixels<'s>(scene: &'s Scene, camera: &Camera, plan: &Plan, eye: &Eye<'s>) -> Seen {
    let (mut queue, mut parts, mut tally) = (Queue::default(), Parts::new(), Tally::default());
    let mut seen = Seen::default();
    for corner in bundles(camera) {
        queue.begin(camera.fan(corner, BUNDLE, (BUNDLE * BUNDLE) as usize));
        for (x, y) in pixels_of(camera, corner) {
            let (mut stream, ray, inside) = set_out((scene, camera, plan), (x, y), (0, 0));
            let mut context =
                Context { stream: &mut stream, queue: &mut queue, pixel: 0, tally: &mut tally, parts: &mut parts };
            let (_, told) = eye.tell(ray, inside, &mut context);
            seen.samples += 1.0;
            seen.all.rays += 1.0;
            let mut is_onward = false;
            for Told { what, .. } in &told {
                seen.all.count(scene, what);
                if is_onward {
                    seen.onward.count(scene, what);
                } else if let Happening::Surface { nature: Nature::Diffuse, onward, .. } = what {
                    is_onward = true;
                    seen.sent += f64::from(onward.is_some());
                    seen.onward.rays += f64::from(onward.is_some());
                }
            }
        }
        if let Mode::Gather(maps) = eye.mode() {
            maps.gather_bundles(&mut queue);
        }
    }
    if let Mode::Gather(maps) = eye.mode() {
        maps.gather_streams(&mut queue);
    }
    seen.gathered = queue.stats;
    seen
}

/// Renders the same pixels as [`some_pixels`] so often that a clock tells how long that takes. Returns how often, and the seconds.
fn time_pixels<'s>(
    scene: &'s Scene,
    camera: &Camera,
    plan: &Plan,
    eye: &Eye<'s>,
    clock: Clock<'_>,
) -> (f64, Option<f64>) {
    let (mut queue, mut parts, mut tally) = (Queue::default(), Parts::new(), Tally::default());
    let mut times = 0;
    let start = clock();
    let took = || clock().zip(start).map(|(now, start)| now - start);
    while times < MOST_TIMES && took().is_some_and(|seconds| seconds < TELLING * SHORTEST) {
        for corner in bundles(camera) {
            queue.begin(camera.fan(corner, BUNDLE, (BUNDLE * BUNDLE) as usize));
            for at in pixels_of(camera, corner) {
                let (mut stream, ray, inside) = set_out((scene, camera, plan), at, (0, times));
                let (queue, tally, parts) = (&mut queue, &mut tally, &mut parts);
                eye.look(ray, inside, &mut Context { stream: &mut stream, queue, pixel: 0, tally, parts });
            }
            if let Mode::Gather(maps) = eye.mode() {
                maps.gather_bundles(&mut queue);
            }
        }
        if let Mode::Gather(maps) = eye.mode() {
            maps.gather_streams(&mut queue);
            queue.done.clear();
        }
        times += 1;
    }
    (f64::from(times), took())
}

impl Seen {
    /// What some of the steps had to do, where maps hold `full` times as many photons as those that were looked up.
    fn work(&self, scene: &Scene, plan: &Plan, steps: &Steps, full: f64) -> Work {
        let Steps { rays, segments, uneven, bounces, collisions, matte } = *steps;
        let share = |part: f64, of: f64| if of > 0.0 { part / of } else { 0.0 };
        let (deep, gathered) = (depth(scene), share(segments, self.all.segments));
        // Where paths collide, each asks for light.
        let asked = self.gathered.shadow_rays as f64 * share(bounces, self.all.bounces)
            + if plan.method == Method::Path { collisions } else { 0.0 };
        let looked_up = match () {
            () if plan.global_photons > 0 && plan.global.precomputed == 0 => COUNTED * matte,
            () if plan.caustic_photons + plan.global_photons > 0 => matte,
            () => 0.0,
        };
        Work::of(&[
            (Unit::Ray, deep * rays),
            (Unit::Bounce, bounces + collisions),
            (Unit::ShadowRay, deep * asked),
            (Unit::Flight, uneven),
            (Unit::Query, gathered * self.gathered.queries as f64),
            (Unit::Block, gathered * full * self.gathered.blocks as f64),
            (Unit::LookUp, looked_up),
        ])
    }
}
