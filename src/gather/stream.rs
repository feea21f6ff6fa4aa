//! Beam queries of many rays that have nothing in common: they go through the hierarchy together, depth first,
//! so that every node and every photon is fetched once for all rays that need it.

use super::beam::{Coloured, Found, Grey, Pruning, RayFrame, Slabs, Transmit, add_block, exponents};
use super::bundle::Bundle;
use super::gathered::{GatherStats, Gathered};
use super::phase::{BroadSum, Evaluate, HenyeyGreenstein, Isotropic, Kind, Sum};
use crate::math::DVec3;
use crate::photon::discs::PhotonMap;
use crate::photon::simd::{LANES, Lanes, Task, prefetch};
use crate::photon::store::{Subtrees, blocks_of};

/// Rays that go together: their sums and frames stay in the second cache.
const BATCH: usize = 8192;

/// Memory reused from stream to stream.
#[derive(Debug, Default)]
pub struct StreamScratch {
    /// Lists of rays, those of a node's children one after the other.
    lists: Vec<u32>,
    sums: Vec<[[f32; 3]; 2]>,
}

/// A ray, ready for tests.
#[derive(Clone, Copy)]
struct Prepared<P> {
    frame: RayFrame,
    slabs: Slabs,
    phase: P,
    pruning: Pruning,
}

impl PhotonMap {
    /// What each ray of a bundle gathers, as [`PhotonMap::gather`] would, wherever the rays go: for hundreds of
    /// rays and more.
    pub fn gather_stream(
        &self,
        bundle: &Bundle<'_>,
        scratch: &mut StreamScratch,
        stats: &mut GatherStats,
        out: &mut Vec<Gathered>,
    ) {
        out.clear();
        match &bundle.phase.0 {
            Kind::Isotropic => self.stream_phase(bundle, |_| Isotropic, scratch, stats, out),
            Kind::HenyeyGreenstein(g) => {
                self.stream_phase(bundle, |omega| HenyeyGreenstein::new(*g, omega), scratch, stats, out)
            }
            Kind::Sum(terms) => self.stream_phase(bundle, |omega| Sum::new(terms, omega), scratch, stats, out),
            Kind::Broad(terms, broad) => {
                self.stream_phase(bundle, |omega| BroadSum::new(terms, broad, omega), scratch, stats, out)
            }
        }
    }

    fn stream_phase<P: Evaluate>(
        &self,
        bundle: &Bundle<'_>,
        phase: impl Fn(DVec3) -> P,
        scratch: &mut StreamScratch,
        stats: &mut GatherStats,
        out: &mut Vec<Gathered>,
    ) {
        stats.queries += bundle.rays.len() as u64;
        if self.is_empty() {
            out.resize(bundle.rays.len(), Gathered::default());
            return;
        }
        let exponents = exponents(bundle.extinction);
        let grey = exponents[0] == exponents[1] && exponents[0] == exponents[2];
        let mut prepared = Vec::with_capacity(bundle.rays.len().min(BATCH));
        for rays in bundle.rays.chunks(BATCH) {
            prepared.clear();
            prepared.extend(rays.iter().map(|(ray, a, b)| {
                let pruning = Pruning::new(bundle.pruned.then(|| Pruning::number(ray.direction)));
                let (origin, length) = (ray.at(*a), ((b - a) as f32).min(pruning.depth(exponents)));
                Prepared {
                    frame: RayFrame::new(origin, ray.direction, length),
                    slabs: Slabs::new(self, origin, ray.direction, length),
                    phase: phase(ray.direction),
                    pruning,
                }
            }));
            let max_events = bundle.max_events;
            scratch.sums.clear();
            scratch.sums.resize(rays.len(), Default::default());
            if grey {
                self.stream_kind(&prepared, Grey(exponents[0]), max_events, scratch, stats);
            } else {
                self.stream_kind(&prepared, Coloured(exponents), max_events, scratch, stats);
            }
            let constant = prepared.first().map_or(0.0, |ray| ray.phase.constant()) as f32;
            out.extend(scratch.sums.iter().map(|[total, single]| Gathered {
                total: total.map(|sum| sum * constant),
                single: single.map(|sum| sum * constant),
            }));
        }
    }

    fn stream_kind<P: Evaluate>(
        &self,
        rays: &[Prepared<P>],
        transmittance: impl Transmit,
        max_events: u8,
        scratch: &mut StreamScratch,
        stats: &mut GatherStats,
    ) {
        let any = transmittance.any();
        self.isa.run_or(
            GatherStream { map: self, rays, transmittance, max_events, scratch, stats },
            |GatherStream { map, rays, max_events, scratch, stats, .. }| GatherStream {
                map,
                rays,
                transmittance: any,
                max_events,
                scratch,
                stats,
            },
        );
    }
}

/// Rays that go together, as a kernel.
struct GatherStream<'a, P, T> {
    map: &'a PhotonMap,
    rays: &'a [Prepared<P>],
    transmittance: T,
    max_events: u8,
    scratch: &'a mut StreamScratch,
    stats: &'a mut GatherStats,
}

/// A node, and the list of the rays that meet it.
#[derive(Clone, Copy)]
struct Visit {
    node: u32,
    start: usize,
    count: usize,
    /// Where the lists end that are still needed when this one has been used.
    end: usize,
}

impl<P: Evaluate, T: Transmit> Task for GatherStream<'_, P, T> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self) {
        let GatherStream { map, rays, transmittance, max_events, scratch, stats } = self;
        let StreamScratch { lists, sums } = scratch;
        lists.clear();
        lists.extend(0..rays.len() as u32);
        let mut waiting: smallvec::SmallVec<[Visit; 128]> = smallvec::SmallVec::new();
        waiting.push(Visit { node: 0, start: 0, count: rays.len(), end: rays.len() });
        while let Some(visit) = waiting.pop() {
            let node = &map.nodes[visit.node as usize];
            let leaves = node.leaves();
            // Room for every child's list at its longest.
            let first = visit.end;
            lists.resize(first + LANES * visit.count, 0);
            let (own, children) = lists.split_at_mut(first);
            let own = &own[visit.start..visit.start + visit.count];
            let mut counts = [0; LANES];
            let (mut met, mut photons) = (0, 0);
            for &index in own {
                let ray = &rays[index as usize];
                let lanes = ray.frame.lanes::<L>();
                let hit = if map.boxes {
                    ray.slabs.hit::<L>(&node.min, &node.max)
                } else {
                    lanes.hit(&node.center, &node.radius)
                };
                let (blocks, mut inner) = (hit & leaves, hit & !leaves);
                if blocks != 0 {
                    let mut found = Found::<L>::none();
                    let limits = (max_events, ray.pruning, None);
                    met += u64::from(blocks.count_ones());
                    for block in blocks_of(&node.children, blocks) {
                        add_block(map, block, &lanes, &ray.phase, &transmittance, limits, &mut found);
                    }
                    photons += found.photons;
                    let [total, single] = &mut sums[index as usize];
                    for channel in 0..3 {
                        total[channel] += found.total[channel].sum();
                        single[channel] += found.single[channel].sum();
                    }
                }
                while inner != 0 {
                    let child = inner.trailing_zeros() as usize;
                    inner &= inner - 1;
                    children[child * visit.count + counts[child]] = index;
                    counts[child] += 1;
                }
            }
            stats.nodes += visit.count as u64;
            stats.blocks += met;
            stats.photons += photons;
            let end = first + LANES * visit.count;
            for (child, &count) in counts.iter().enumerate() {
                if count > 0 {
                    let start = first + child * visit.count;
                    prefetch(&map.nodes[node.children[child] as usize]);
                    waiting.push(Visit { node: node.children[child], start, count, end });
                }
            }
        }
    }
}
