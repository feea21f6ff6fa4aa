//! The rays of a bundle: what is asked of a map for all of them.

use crate::gather::beam::{BeamQuery, Pruning};
use crate::gather::depth::DepthTable;
use crate::gather::gathered::{GatherStats, Gathered};
use crate::gather::phase::PhaseLanes;
use crate::gather::sampled::{SampledDepths, Samples};
use crate::math::{Ray, Vec3};
use crate::photon::discs::PhotonMap;

/// Rays that gather together: in one medium, from one map.
#[derive(Clone, Copy, Debug)]
pub struct Bundle<'a> {
    /// The rays and where their segments begin and end, those of neighbouring pixels next to one another.
    pub rays: &'a [(Ray, f64, f64)],
    /// The medium's phase function.
    pub phase: &'a PhaseLanes,
    /// The extinction coefficient.
    pub extinction: Vec3,
    /// Only photons with at most this many events count, if the map is tagged; 255 for all.
    pub max_events: u8,
    /// Whether rays end, by roulette, where little light arrives from; not in a heterogeneous medium.
    pub pruned: bool,
    /// In a heterogeneous medium, every ray's depths and the step at which they were sampled.
    pub depths: Option<(&'a SampledDepths, f64, &'a [Samples])>,
}

impl Bundle<'_> {
    /// What one of its rays gathers by itself.
    pub(super) fn gather_alone(
        &self,
        map: &PhotonMap,
        index: usize,
        table: &mut DepthTable,
        stats: &mut GatherStats,
    ) -> Gathered {
        let (ray, a, b) = self.rays[index];
        if let Some((depths, step, samples)) = self.depths {
            depths.tabulate(samples[index], step, (a, b), table);
        }
        let query = BeamQuery {
            origin: ray.at(a),
            direction: ray.direction,
            length: (b - a) as f32,
            phase: self.phase,
            extinction: self.extinction,
            depth: self.depths.is_some().then_some(&*table),
            hull: None,
            max_events: self.max_events,
            pruning: self.pruned.then(|| Pruning::number(ray.direction)),
        };
        map.gather(&query, stats)
    }
}
