//! Samples through the pixels of a tile.

use std::ops::Range;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Mutex, PoisonError};
use std::time::Instant;

use super::adaptive::{Allotment, Found, Sounding, Survey, colour, is_sounded, noise};
use super::camera::Camera;
use super::eye::{Claim, Context, Eye, EyeSettings, Indirect, Mode, Path};
use super::film::{Shown, Sums};
use super::irradiance::{Filled, Filler};
use super::light_tracer::{LightTracer, Origin, Sent};
use super::maps::{Maps, VolumeMap};
use super::pass::Renderer;
use super::plan::Plan;
use super::progress::Progress;
use crate::gather::{GatherStats, GlobalMap, IrradianceCache, Queue, SurfaceMap};
use crate::math::{Ray, Stream};
use crate::photon::narrowing;
use crate::scene::description::{self, Method, SingleScattering, Window};
use crate::scene::{Inside, Scene};
use crate::transport::{Parts, Tally};

/// Pixels along the edge of a tile, the work of one task.
pub(super) const TILE: u32 = 16;

/// Pixels along the edge of a bundle: its camera rays gather photons together.
pub(super) const BUNDLE: u32 = 8;

/// The work of light gathered along a ray, or of a shadow ray, in rays that find nothing.
const QUERY: u64 = 8;

/// Samples a pixel takes before its neighbours' turn, at most.
const ROUND: u32 = 16;

/// Sums of a tile's pixels, and what they cost.
struct Tile {
    sums: Vec<(u32, u32, Sums)>,
    /// The work that each of them was.
    work: Vec<u64>,
    /// What bundles tell of the picture, by one of their pixels, if they are asked.
    found: Vec<((u32, u32), Found)>,
    gathered: GatherStats,
    tally: Tally,
}

/// Tiles of the picture, whole ones from the top left.
#[derive(Clone, Copy)]
struct Tiles {
    columns: u32,
    rows: u32,
}

impl Tiles {
    fn of((width, height): (u32, u32)) -> Self {
        Tiles { columns: width.div_ceil(TILE), rows: height.div_ceil(TILE) }
    }

    /// The corner of a tile.
    fn corner(self, tile: u32) -> (u32, u32) {
        (tile % self.columns * TILE, tile / self.columns * TILE)
    }

    /// The tiles that a window lies in.
    fn within(self, Window { x, y, width, height }: Window) -> Vec<u32> {
        let rows = y / TILE..(y + height).div_ceil(TILE);
        let across = move |row| (x / TILE..(x + width).div_ceil(TILE)).map(move |column| row * self.columns + column);
        rows.flat_map(across).collect()
    }
}

/// What the samples of a round are for.
#[derive(Clone, Copy)]
enum Purpose<'r> {
    /// The picture.
    Picture,
    /// That, and to tell how bright it is.
    Level,
    /// That, and to tell where its noise is: by halves, the second from this sample on, beside means of so much.
    Noise(u32, [f64; 2]),
    /// What pixels take more than others.
    More(&'r Allotment),
}

/// What a thread keeps from one tile to the next: memory.
struct Room<'s> {
    queue: Queue<Claim>,
    parts: Parts<'s, Path>,
    origins: Parts<'s, Origin>,
}

/// A round of samples of all pixels.
struct Round<'r, 's> {
    scene: &'s Scene,
    camera: &'r Camera,
    plan: &'r Plan,
    stop: &'r (dyn Fn() -> bool + Sync),
    eye: &'r Eye<'s>,
    /// Who sends light to the pixels, if not all of it is looked for.
    lamps: Option<&'r LightTracer<'s>>,
    pass: u32,
    samples: Range<u32>,
    purpose: Purpose<'r>,
    shown: Shown,
}

impl<P: Progress> Renderer<'_, P> {
    /// Samples all pixels, in rounds, the first of them short, so that an interrupted image is whole.
    pub(super) fn expose(&mut self, mode: Mode<'_>, maps: Option<&Maps>, pass: u32) {
        let all = Tiles::of(self.camera.size());
        let within = all.within(self.camera.window());
        // Of light that is sent, camera rays see only what comes straight from an emitter, through sheets at most.
        let sends = self.plan.method == Method::Light;
        let (stop, clock) = (self.stop, self.clock);
        let stop = &move || stop.load(Ordering::Relaxed) || clock.ends_samples();
        let lamps = sends.then(|| LightTracer::new(self.scene, &self.camera, &self.plan, pass, stop));
        let tasks = lamps.as_ref().map_or(0, LightTracer::tasks_in_sample);
        // What fills the irradiance cache may change the plan's samples.
        let plan = self.plan.clone();
        let settings = eye_settings(&plan, &self.camera, (mode, maps), stop);
        let mut eye = Eye::new(self.scene, settings);
        let cache = self.fill_cache(&eye, pass);
        eye.keep(cache.as_ref());

        // Where noise is looked for, tiles outside of the window tell of the picture, too.
        let sounding = Sounding::new(self.plan.samples).filter(|_| self.plan.adaptive);
        let mut asked = within.clone();
        if sounding.is_some() {
            let count = all.columns * all.rows;
            asked.extend((0..count).filter(|tile| is_sounded(*tile, count)));
            asked.sort_unstable();
            asked.dedup();
        }
        let beside = (asked.len() - within.len()) as u64 * sounding.map_or(0, |sounding| u64::from(sounding.taken()));
        let mut survey = Survey::new((all.columns, all.rows));
        let mut allotment: Option<Allotment> = None;

        // Rounds.
        self.progress.phase("render", (within.len() as u64 + tasks) * self.plan.samples as u64 + beside);
        let (mut from, mut end) = (0, self.plan.samples);
        while from < end && !self.stopped() {
            let most = if pass == 0 { self.progress.round(from).clamp(1, ROUND) } else { ROUND };
            let (to, purpose) = match (sounding, &allotment) {
                (Some(_), _) if from == 0 => (1, Purpose::Level),
                (Some(sounding), None) => (sounding.taken(), Purpose::Noise(1 + sounding.half(), survey.levels())),
                (_, Some(allotment)) => (end.min(from.saturating_add(most)), Purpose::More(allotment)),
                (None, None) => (end.min(from.saturating_add(most)), Purpose::Picture),
            };
            let tiles = if matches!(purpose, Purpose::Level | Purpose::Noise(..)) { &asked } else { &within };
            // The samples of a tile are told to be as many as of all others, however they are allotted.
            let told = |sample: u32| match &allotment {
                Some(allotment) => (f64::from(self.plan.samples) * allotment.share(sample)) as u64,
                None => u64::from(sample),
            };
            let steps = told(to).saturating_sub(told(from));
            let round = Round {
                scene: self.scene,
                camera: &self.camera,
                plan: &self.plan,
                stop,
                eye: &eye,
                lamps: lamps.as_ref(),
                pass,
                samples: from..to,
                purpose,
                shown: self.film.shown(),
            };
            // Each thread takes the next tile until there is none: the last ones are short of company for no longer
            // than one takes.
            let next = AtomicU64::new(0);
            let count = tiles.len() as u64;
            let tasks = count + tasks * u64::from(to - from);
            let image = Mutex::new((&mut self.film, &mut self.stats, &mut survey));
            let progress = self.progress;
            // Tasks that busy threads do not take find no tile left.
            let work = || {
                let mut room = Room { queue: Queue::default(), parts: Parts::new(), origins: Parts::new() };
                while !round.stopped() {
                    let number = next.fetch_add(1, Ordering::Relaxed);
                    if number >= tasks {
                        break;
                    }
                    if let Some(sent) = number.checked_sub(count).and_then(|task| round.send(task, &mut room)) {
                        if sent.is_broken_off {
                            break;
                        }
                        let mut image = image.lock().unwrap_or_else(PoisonError::into_inner);
                        let (film, stats, _) = &mut *image;
                        film.splat(&sent.splats, sent.paths);
                        stats.emitted += sent.paths;
                        stats.tally = stats.tally.merge(sent.tally);
                        drop(image);
                        progress.advance(1);
                        continue;
                    }
                    let tile = round.tile(all.corner(tiles[number as usize]), &mut room);
                    let mut image = image.lock().unwrap_or_else(PoisonError::into_inner);
                    let (film, stats, survey) = &mut *image;
                    for (x, y, sum) in &tile.sums {
                        if let Some((x, y)) = round.camera.window().place(*x, *y) {
                            film.add(x, y, sum);
                        }
                    }
                    for (place, found) in tile.found {
                        survey.set(place, found);
                    }
                    stats.gather += tile.gathered;
                    stats.tally = stats.tally.merge(tile.tally);
                    drop(image);
                    progress.advance(steps);
                }
            };
            rayon::scope(|scope| (0..rayon::current_num_threads()).for_each(|_| scope.spawn(|_| work())));
            if let (Purpose::Noise(..), Some(sounding), false) = (purpose, sounding, self.stopped()) {
                let allotted = Allotment::new(&survey, sounding, (self.plan.seed, pass));
                end = allotted.most;
                allotment = Some(allotted);
            }
            from = to;
            self.end_round();
        }
    }
}

impl<P: Progress> Renderer<'_, P> {
    /// Fills the pass's irradiance cache, if it has one.
    fn fill_cache(&mut self, eye: &Eye<'_>, pass: u32) -> Option<IrradianceCache> {
        let settings = self.plan.cache.filter(|_| eye.gathers())?;
        let start = Instant::now();
        self.progress.phase("irradiance", 0);
        let scale = narrowing(pass / self.plan.parts, SurfaceMap::DIMENSION);
        let (scene, camera, plan) = (self.scene, &self.camera, &self.plan);
        let filler = Filler { scene, camera, plan, settings, eye, pass, scale };
        let stop = || self.stop.load(Ordering::Relaxed) || self.clock.ends_photons();
        let Filled { cache, gathered, tally } = filler.fill(&stop);
        if self.clock.ends_photons() && !self.clock.has_image() {
            // The only image there will be.
            self.plan.samples = 1;
            self.warnings.push(format!("the time was up when {} places knew their indirect light", cache.len()));
        }
        self.clock.begin_samples();
        self.stats.records += cache.len() as u64;
        self.stats.gather += gathered;
        self.stats.tally = self.stats.tally.merge(tally);
        self.stats.build_seconds += start.elapsed().as_secs_f64();
        Some(cache)
    }
}

/// How the eyes of a pass with these maps deal with media.
pub(super) fn mode<'s>(plan: &Plan, maps: Option<&'s Maps>) -> Mode<'s> {
    match maps.map(|maps| &maps.volume) {
        Some(Some(VolumeMap::Beams(maps))) => Mode::Gather(maps),
        Some(Some(VolumeMap::Points(maps))) => Mode::March(maps),
        Some(None) => Mode::Pass,
        // Light paths bring all but emitters, and what media emit; Whitted's rays see no more of media.
        None if matches!(plan.method, Method::Light | Method::Whitted) => Mode::Pass,
        None => by_paths(plan),
    }
}

/// How paths deal with media.
pub(super) fn by_paths(plan: &Plan) -> Mode<'static> {
    if plan.split { Mode::Split } else { Mode::Track }
}

/// What the eyes of a pass are told.
pub(super) fn eye_settings<'s>(
    plan: &'s Plan,
    camera: &Camera,
    (mode, maps): (Mode<'s>, Option<&'s Maps>),
    stop: &'s (dyn Fn() -> bool + Sync),
) -> EyeSettings<'s> {
    let sends = plan.method == Method::Light;
    EyeSettings {
        mode,
        max_events: plan.max_events,
        single_scattering: if sends { SingleScattering::Photons } else { plan.single_scattering },
        peaks: &plan.peaks,
        marchers: plan.traced.as_deref(),
        caustics: maps.and_then(|maps| maps.caustic.as_ref()),
        visibility: maps.and_then(|maps| maps.visibility.as_ref()),
        indirect: indirect(plan, maps),
        light_samples: plan.light_samples,
        whitted: plan.method == Method::Whitted,
        sends,
        spread: camera.cone().map(|width| width * footprint(plan.samples)),
        stop,
    }
}

/// The random numbers of a sample of a pass through a pixel, its ray, and the solids around the start of that.
pub(super) fn set_out(
    (scene, camera, plan): (&Scene, &Camera, &Plan),
    (x, y): (u32, u32),
    (pass, sample): (u32, u32),
) -> (Stream, Ray, Inside) {
    let pixel = u64::from(y) * u64::from(camera.size().0) + u64::from(x);
    // Passes may take any number of samples.
    let number = u64::from(pass) << 32 | u64::from(sample);
    let mut stream = Stream::of_sample(plan.seed, pixel, number, (pass, sample));
    let ray = camera.ray(x, y, &mut stream);
    let inside = plan.inside.clone().unwrap_or_else(|| scene.inside(ray.origin));
    (stream, ray, inside)
}

/// Who tells indirect light: where it was to be a map that there is not, as hardly any light lands, paths do.
fn indirect<'s>(plan: &Plan, maps: Option<&'s Maps>) -> Indirect<'s> {
    let global = maps.and_then(|maps| maps.global.as_ref());
    let from_media_only = maps.is_some_and(|maps| maps.from_media_only);
    match (plan.indirect, global) {
        (description::Indirect::None, _) => Indirect::Nobody,
        (description::Indirect::Map, Some(global)) => Indirect::Map(global),
        (description::Indirect::FinalGather, global) if global.is_some() || from_media_only => {
            let near = plan.accurate_distance.unwrap_or(global.map_or(0.0, GlobalMap::blur));
            Indirect::Gather { global, near, rays: plan.gather_rays, cache: None }
        }
        _ => Indirect::Path,
    }
}

/// Over what part of a pixel's width textures are blurred. Half a pixel took a third of the variance of a finely checkered plane, with a
/// bias of its squared error at a hundred samples; as samples grow more, the bias falls with the variance.
fn footprint(samples: u32) -> f64 {
    (2.0 / f64::from(samples).sqrt()).min(0.5)
}

impl<'s> Round<'_, 's> {
    fn stopped(&self) -> bool {
        (self.stop)()
    }

    /// Sends the light of a task, if any is sent.
    fn send(&self, task: u64, room: &mut Room<'s>) -> Option<Sent> {
        let lamps = self.lamps?;
        let sample = self.samples.start + (task / lamps.tasks_in_sample()) as u32;
        Some(lamps.trace((sample, task % lamps.tasks_in_sample()), &mut room.origins))
    }

    /// Samples the pixels of a tile. Rays that gather photons together do so in the whole of it, also where the film has a window: what
    /// each of them finds depends on the others by roundings.
    fn tile(&self, corner: (u32, u32), room: &mut Room<'s>) -> Tile {
        let ((width, height), window) = (self.camera.size(), self.camera.window());
        let tells = matches!(self.purpose, Purpose::Level | Purpose::Noise(..));
        let together = tells || matches!(self.eye.mode(), Mode::Gather(_));
        let mut done = Tile {
            sums: Vec::new(),
            work: Vec::new(),
            found: Vec::new(),
            gathered: GatherStats::default(),
            tally: Tally::default(),
        };
        for part in 0..(TILE / BUNDLE).pow(2) {
            let (x0, y0) = (corner.0 + part % (TILE / BUNDLE) * BUNDLE, corner.1 + part / (TILE / BUNDLE) * BUNDLE);
            let pixels = (0..BUNDLE * BUNDLE)
                .map(|index| (x0 + every_second_bit(index), y0 + every_second_bit(index >> 1)))
                .filter(|(x, y)| *x < width && *y < height && (together || window.place(*x, *y).is_some()));
            let rays = pixels.clone().map(|pixel| self.samples_of(pixel).len()).sum();
            room.queue.begin(self.camera.fan((x0, y0), BUNDLE, rays));
            for pixel in pixels {
                if self.stopped() {
                    break;
                }
                match self.purpose {
                    Purpose::Noise(second, _) => {
                        self.pixel(pixel, self.samples.start..second, room, &mut done);
                        self.pixel(pixel, second..self.samples.end, room, &mut done);
                    }
                    _ => self.pixel(pixel, self.samples_of(pixel), room, &mut done),
                }
            }
            if let Mode::Gather(maps) = self.eye.mode() {
                maps.gather_bundles(&mut room.queue);
            }
        }
        if let Mode::Gather(maps) = self.eye.mode() {
            maps.gather_streams(&mut room.queue);
            for (claim, gathered) in room.queue.done.drain(..) {
                for (component, radiance) in claim.settle(&gathered, &mut done.tally) {
                    done.sums[claim.pixel as usize].2.add_to(component, radiance);
                }
            }
        }
        done.gathered = std::mem::take(&mut room.queue.stats);
        if tells {
            done.found = self.found(&done);
        }
        done
    }

    /// The samples that a pixel takes in this round.
    fn samples_of(&self, pixel: (u32, u32)) -> Range<u32> {
        let Range { start, end } = self.samples;
        match self.purpose {
            Purpose::More(allotment) => start..allotment.count(pixel).clamp(start, end),
            _ => start..end,
        }
    }

    /// What the bundles of a tile tell of the picture.
    fn found(&self, Tile { sums, work, .. }: &Tile) -> Vec<((u32, u32), Found)> {
        let mut found: Vec<((u32, u32), Found)> = Vec::new();
        let mut add = |(x, y): (u32, u32), value: f64, work: u64| {
            let bundle = (x / BUNDLE, y / BUNDLE);
            if found.last().is_none_or(|((x, y), _)| (x / BUNDLE, y / BUNDLE) != bundle) {
                found.push(((x, y), Found::default()));
            }
            if let Some((_, found)) = found.last_mut() {
                found.add((x, y), value, work);
            }
        };
        match self.purpose {
            Purpose::Noise(_, levels) => {
                for (halves, work) in sums.chunks_exact(2).zip(work.chunks_exact(2)) {
                    let [first, second] = [0, 1].map(|half| halves[half].2.mean(&self.shown).to_array());
                    let (x, y, _) = halves[0];
                    add((x, y), noise([first, second], levels[colour(x, y)]), work[0] + work[1]);
                }
            }
            _ => {
                for ((x, y, sums), work) in sums.iter().zip(work) {
                    add((*x, *y), sums.mean(&self.shown).element_sum() / 3.0, *work);
                }
            }
        }
        found
    }

    fn pixel(&self, (x, y): (u32, u32), samples: Range<u32>, room: &mut Room<'s>, done: &mut Tile) {
        if samples.is_empty() {
            return;
        }
        let Round { scene, camera, plan, eye, pass, .. } = self;
        let mut sum = Sums::default();
        let (count, before) = (samples.len() as u64, room.queue.asked());
        for sample in samples {
            let (mut stream, ray, inside) = set_out((scene, camera, plan), (x, y), (*pass, sample));
            let index = done.sums.len() as u32;
            let tally = &mut done.tally;
            let Room { queue, parts, .. } = &mut *room;
            let mut context = Context { stream: &mut stream, queue, pixel: index, tally, parts };
            let found = eye.look(ray, inside, &mut context);
            if found.is_broken_off {
                break;
            }
            sum.add(&found);
        }
        done.sums.push((x, y, sum));
        done.work.push(count + QUERY * (room.queue.asked() - before));
    }
}

/// The number made of bits 0, 2 and 4: one coordinate of a Morton code.
pub(super) fn every_second_bit(code: u32) -> u32 {
    code & 1 | code >> 1 & 2 | code >> 2 & 4
}
