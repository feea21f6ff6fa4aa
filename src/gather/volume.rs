//! All volume photons of a scene, and what a segment of a ray gathers from them.

use std::ops::ControlFlow;

use super::beam::Pruning;
use super::confined::Confines;
use super::point::Marching;
use super::segment::EyeSegment;
use super::{
    BeamQuery, Bundle, BundleScratch, DepthTable, Fan, FluxMemory, GatherStats, Gathered, GlobalMemory, Lattices,
    PhaseLanes, SampledDepths, Samples, StreamScratch,
};
use crate::math::{DVec3, Ray, Rgb, Vec3, one_minus_exp_over};
use crate::medium::density::Density;
use crate::medium::phase::Peak;
use crate::medium::{Emission, Medium};
use crate::photon::{PhotonMap, PointMemory};

/// One photon map for each region, so that a ray gathers its region's photons only.
#[derive(Debug)]
pub struct VolumeMaps {
    maps: Vec<Option<PhotonMap>>,
    phases: Vec<PhaseLanes>,
    extinctions: Vec<Vec3>,
    /// By medium, the distance between two samples of a ray's depth, at most: half of the density's feature length.
    steps: Vec<f64>,
    confines: Confines,
    /// Of the regions with so many photons that some of them are enough for rays that were spread.
    sparse: Option<Box<VolumeMaps>>,
}

/// A segment that waits, with its depths if they vary, for its owner.
#[derive(Debug)]
struct Waiting<O> {
    segment: EyeSegment,
    samples: Option<Samples>,
    owner: O,
}

/// Segments that wait to be gathered, each for an owner, and those that are done; memory that a thread
/// reuses.
#[derive(Debug)]
pub struct Queue<O> {
    bundles: Vec<Waiting<O>>,
    streams: Vec<Waiting<O>>,
    depths: SampledDepths,
    lattices: Lattices,
    /// The owners whose segments are done, with what was gathered for them.
    pub done: Vec<(O, Gathered)>,
    table: DepthTable,
    /// For rays that are marched instead.
    pub marching: Marching,
    /// For points on surfaces: of caustics,
    pub around: PointMemory,
    /// of all light,
    pub global: GlobalMemory,
    /// and of where that comes from.
    pub flux: FluxMemory,
    bundle: BundleScratch,
    stream: StreamScratch,
    /// What was counted.
    pub stats: GatherStats,
}

impl<O> Default for Queue<O> {
    fn default() -> Self {
        Queue {
            bundles: Vec::new(),
            streams: Vec::new(),
            depths: SampledDepths::default(),
            lattices: Lattices::default(),
            done: Vec::new(),
            table: DepthTable::new(),
            marching: Marching::default(),
            around: PointMemory::default(),
            global: GlobalMemory::default(),
            flux: FluxMemory::default(),
            bundle: BundleScratch::default(),
            stream: StreamScratch::default(),
            stats: GatherStats::default(),
        }
    }
}

impl<O> Queue<O> {
    /// The segments from the camera that follow are those of a fan's rays.
    pub fn begin(&mut self, fan: Option<Fan>) {
        self.lattices.begin(fan);
    }

    /// How often light was asked for so far: along rays, also where it has yet to be gathered, and by shadow rays.
    pub fn asked(&self) -> u64 {
        (self.bundles.len() + self.streams.len()) as u64 + self.stats.queries + self.stats.shadow_rays
    }
}

/// Between two samples of a ray that gathers together with others, the optical depth may grow by this much:
/// linear interpolation of transmittance is then right to 0.3 %, and far better on average.
const MOST_PASSED: f64 = 0.15;

/// Samples along the diagonal of a map's box, at least: on a ray's first and last step, which are cut, depth is not known
/// better than to a part of what one of them adds.
const SAMPLES: f64 = 64.0;

impl VolumeMaps {
    /// From the maps of all regions, in their order, all media, and the peaks of these that are left to paths.
    pub fn new(maps: Vec<Option<PhotonMap>>, media: &[Medium], peaks: &[Option<Peak>], confines: Confines) -> Self {
        VolumeMaps {
            confines,
            maps,
            phases: PhaseLanes::of_media(media, peaks),
            extinctions: media.iter().map(|medium| medium.extinction.as_vec3()).collect(),
            steps: media.iter().map(|medium| 0.5 * medium.density.feature_length()).collect(),
            sparse: None,
        }
    }

    /// With maps of fewer photons, where there are any, for rays that were spread.
    pub fn with_sparse(self, sparse: VolumeMaps) -> Self {
        VolumeMaps { sparse: Some(Box::new(sparse)), ..self }
    }

    /// Those of fewer photons, if there are any.
    pub fn sparse(&self) -> Option<&VolumeMaps> {
        self.sparse.as_deref()
    }

    /// Those of fewer photons, if a segment gathers from them.
    fn sparse_for(&self, segment: &EyeSegment) -> Option<&VolumeMaps> {
        self.sparse().filter(|sparse| segment.spread && sparse.maps[segment.region as usize].is_some())
    }

    /// The maps that hold photons.
    pub fn maps(&self) -> impl Iterator<Item = &PhotonMap> {
        self.maps.iter().flatten()
    }

    /// The maps that hold photons, with their regions.
    pub fn by_region(&self) -> impl Iterator<Item = (u32, &PhotonMap)> {
        self.maps.iter().enumerate().filter_map(|(region, map)| Some((region as u32, map.as_ref()?)))
    }

    /// Gathers a segment for its owner, if it has one, at once or when the queue is told to. Returns the
    /// transmittance of the segment.
    pub fn gather<O>(&self, medium: &Medium, segment: EyeSegment, owner: Option<O>, queue: &mut Queue<O>) -> Rgb {
        if let Some(sparse) = self.sparse_for(&segment) {
            return sparse.gather(medium, segment, owner, queue);
        }
        let EyeSegment { ray, a, b, .. } = segment;
        let map = self.maps[segment.region as usize].as_ref();
        // No photon reaches beyond the box around all discs.
        let met = map.and_then(|map| map.bounds().clip(&ray, a, b)).map(|(_, end)| end);
        let (Some(map), Some(end), Some(owner)) = (map, met, owner) else {
            return medium.transmittance(medium.density.depth(&ray, a, b));
        };
        // Bundles have no discs that lean on walls.
        let confined = self.confines.of(segment.solid).is_some();
        let together = segment.from_camera && !map.leans() && !confined;
        if medium.density.is_even() {
            if confined {
                queue.done.push((owner, map.gather(&self.query(&segment), &mut queue.stats)));
                return medium.transmittance(medium.density.depth(&ray, a, b));
            }
            let waiting = if together { &mut queue.bundles } else { &mut queue.streams };
            waiting.push(Waiting { segment, samples: None, owner });
            return medium.transmittance(medium.density.depth(&ray, a, b));
        }
        // Nothing absorbs beyond a grid, and no photon waits beyond the discs.
        let (enters, leaves) = medium.density.support().clip(&ray, a, b).unwrap_or((a, a));
        let end = if leaves.is_finite() { leaves } else { end };
        let total = |until_end: f64| if end < leaves { medium.density.depth(&ray, a, b) } else { until_end };
        if together {
            let extinction = medium.extinction.max_element();
            let (most, step) = (MOST_PASSED / extinction, self.step(map, segment.medium));
            let (density, range) = (&medium.density, (enters, end));
            let Queue { lattices, depths, .. } = queue;
            let sampled = lattices
                .sample((segment.medium, density), step, &ray, range, (most, extinction), depths)
                .or_else(|| depths.sample(density, step, &ray, range, most));
            if let Some((samples, depth)) = sampled {
                let Queue { bundles, done, depths, .. } = queue;
                // Where there is no matter, fluence is not scattered.
                let part = match map.fluence {
                    true => depths.occupied(samples, step, (a.max(enters), b.min(leaves))),
                    false => Some((samples, (a, b))),
                };
                match part {
                    Some((samples, (a, b))) => {
                        let segment = EyeSegment { a, b, ..segment };
                        bundles.push(Waiting { segment, samples: Some(samples), owner });
                    }
                    None => done.push((owner, Gathered::default())),
                }
                return medium.transmittance(total(depth));
            }
        }
        queue.table.tabulate(medium, &ray, (a, end));
        if map.fluence && queue.table.total() <= 0.0 {
            queue.done.push((owner, Gathered::default()));
            return Rgb::ONE;
        }
        let mut query = BeamQuery { depth: Some(&queue.table), ..self.query(&segment) };
        if map.fluence {
            query.length = query.length.min((leaves - a) as f32);
        }
        queue.done.push((owner, map.gather(&query, &mut queue.stats)));
        medium.transmittance(total(queue.table.total()))
    }

    /// Gathers what waits of camera rays close to one another.
    pub fn gather_bundles<O: Copy>(&self, queue: &mut Queue<O>) {
        let Queue { bundles, done, bundle, depths, stats, .. } = queue;
        let gather =
            |map: &PhotonMap, rays: &Bundle<'_>, gathered: &mut _| map.gather_bundle(rays, bundle, stats, gathered);
        self.gather_together(bundles, depths, done, gather);
        depths.clear();
    }

    /// Gathers what waits of rays anywhere.
    pub fn gather_streams<O: Copy>(&self, queue: &mut Queue<O>) {
        let Queue { streams, done, stream, depths, stats, .. } = queue;
        let gather =
            |map: &PhotonMap, rays: &Bundle<'_>, gathered: &mut _| map.gather_stream(rays, stream, stats, gathered);
        self.gather_together(streams, depths, done, gather);
    }

    /// Gathers what waits, by map and medium.
    fn gather_together<O: Copy>(
        &self,
        waiting: &mut Vec<Waiting<O>>,
        depths: &SampledDepths,
        done: &mut Vec<(O, Gathered)>,
        mut gather: impl FnMut(&PhotonMap, &Bundle<'_>, &mut Vec<Gathered>),
    ) {
        let key = |waiting: &Waiting<O>| {
            let EyeSegment { region, medium, max_events, passed, .. } = waiting.segment;
            let is_sparse = self.sparse_for(&waiting.segment).is_some();
            (is_sparse, region, medium, max_events, passed, waiting.samples.is_some())
        };
        waiting.sort_by_key(key);
        let (mut rays, mut samples, mut gathered) = (Vec::new(), Vec::new(), Vec::new());
        for same in waiting.chunk_by(|a, b| key(a) == key(b)) {
            let (_, region, medium, max_events, passed, sampled) = key(&same[0]);
            let maps = self.sparse_for(&same[0].segment).unwrap_or(self);
            let Some(map) = &maps.maps[region as usize] else { continue };
            let index = medium as usize;
            rays.clear();
            rays.extend(same.iter().map(|Waiting { segment: EyeSegment { ray, a, b, .. }, .. }| (*ray, *a, *b)));
            samples.clear();
            samples.extend(same.iter().filter_map(|waiting| waiting.samples));
            let bundle = Bundle {
                rays: &rays,
                phase: &self.phases[index],
                extinction: self.extinction(medium, passed),
                max_events,
                pruned: true,
                depths: sampled.then_some((depths, self.step(map, medium), &samples)),
            };
            gather(map, &bundle, &mut gathered);
            done.extend(same.iter().map(|waiting| waiting.owner).zip(gathered.iter().copied()));
        }
        waiting.clear();
    }

    /// The distance between two samples of a ray that gathers from a map.
    fn step(&self, map: &PhotonMap, medium: u32) -> f64 {
        self.steps[medium as usize].min(map.bounds().diagonal() / SAMPLES)
    }

    /// What fades light along a segment of a medium.
    fn extinction(&self, medium: u32, passed: bool) -> Vec3 {
        if passed { Vec3::ZERO } else { self.extinctions[medium as usize] }
    }

    /// A query without a table of depths.
    fn query(&self, segment: &EyeSegment) -> BeamQuery<'_> {
        BeamQuery {
            origin: segment.ray.at(segment.a),
            direction: segment.ray.direction,
            length: (segment.b - segment.a) as f32,
            phase: &self.phases[segment.medium as usize],
            extinction: self.extinction(segment.medium, segment.passed),
            depth: None,
            hull: self.confines.of(segment.solid),
            max_events: segment.max_events,
            pruning: Some(Pruning::number(segment.ray.direction)),
        }
    }
}

/// ∫ T σ_a L_e w dt from `a` to `b`, as radiance at `a`: exact where L_e is the same everywhere, for w = 1; else
/// one point a cell, drawn with the numbers `jitter` gives, and weighted by `share`.
pub fn emitted(
    medium: &Medium,
    ray: &Ray,
    (a, b): (f64, f64),
    mut jitter: impl FnMut() -> f64,
    share: impl Fn(DVec3) -> f64,
) -> Rgb {
    match (&medium.emission, medium.even_glow()) {
        (Emission::None, _) => Rgb::ZERO,
        (_, Some(_)) => {
            let depth = medium.density.depth(ray, a, b);
            // ∫ e^{−σD} dD; 1/σ over an infinite depth.
            let mean = medium.extinction.map(|sigma| match sigma * depth {
                tau if tau.is_infinite() => 1.0 / sigma,
                tau => {
                    if sigma > 0.0 {
                        depth * one_minus_exp_over(tau)
                    } else {
                        0.0
                    }
                }
            });
            medium.emitted(DVec3::ZERO) * mean
        }
        _ => {
            let (mut sum, mut depth) = (Rgb::ZERO, 0.0);
            // What is emitted over a length that `t` stands for, where it is as deep as `depth` tells.
            let here = |t: f64, length: f64, depth: &dyn Fn() -> f64| {
                let p = ray.at(t);
                match medium.emitted_at(p) {
                    emitted if emitted.max_element() > 0.0 => {
                        emitted * (length * share(p)) * medium.transmittance(depth())
                    }
                    _ => Rgb::ZERO,
                }
            };
            match &medium.density {
                Density::Uniform | Density::Exponential(_) => {}
                Density::Grid(grid) => grid.cells(ray, a, b, |cell| {
                    let inside = cell.integral();
                    if inside > 0.0 {
                        // The depth up to there, as if the cell were even.
                        let part = jitter();
                        let width = cell.tb - cell.ta;
                        sum += here(cell.ta + width * part, width, &|| depth + part * inside);
                    }
                    depth += inside;
                    ControlFlow::Continue(())
                }),
                Density::Sum(density) => density.pieces(ray, (a, b), (b - a) / PIECES, |piece| {
                    let width = piece.tb - piece.ta;
                    if piece.depth > 0.0 && width.is_finite() {
                        let t = piece.ta + width * jitter();
                        sum += here(t, width, &|| depth + density.depth_in(ray, piece, t));
                    }
                    depth += piece.depth;
                    ControlFlow::Continue(())
                }),
            }
            sum
        }
    }
}

/// Of what several media emit together there is a point in each so many parts of a ray, at least.
const PIECES: f64 = 64.0;
