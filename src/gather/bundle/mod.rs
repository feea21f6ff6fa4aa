//! Beam queries of rays that run close to one another, as those of neighbouring pixels: they share the
//! walk through the hierarchy, and all that varies little between them.
//!
//! One walk collects the photons near the whole bundle. For each group of up to 64 rays, photons are then
//! taken to the group's frame, its rays written as x = pₓ + sₓz, y = p_y + s_y z with small slopes s along the
//! group's axis. What a photon at (a, b, z) contributes is a constant of the group times (1 + d)^{−3/2},
//! where d, linear in sₓ, s_y and −s²/2, carries the phase function's and the transmittance's dependence
//! on the ray: exact in the logarithm's first order, and for Henyey and Greenstein's function in all.
//! The distance from the ray is the offset at the photon's own z, wrong by the order of s²; that order is added but
//! where rays hardly deviate and many photons are met, so that the rims of single discs are not seen.

#![allow(
    clippy::needless_range_loop,
    reason = "iterators' closures need not be inlined into a kernel's instruction set"
)]

mod collect;
mod evaluate;
mod group;
mod lines;
mod photons;
mod rays;
#[cfg(test)]
mod tests;

pub use rays::Bundle;

use crate::gather::depth::DepthTable;
use crate::gather::gathered::{GatherStats, Gathered};
use crate::gather::phase::{BroadSum, Evaluate, HenyeyGreenstein, Isotropic, Kind, PhaseLanes, Sum};
use crate::gather::sampled::GROUP;
use crate::math::DVec3;
use crate::photon::discs::PhotonMap;
use crate::photon::kernel::Profile;
use crate::photon::simd::LANES;
use collect::{Collect, Cone};
use evaluate::Shift;
use group::{Arrange, Group};
use lines::Lines;
use photons::{Collected, Lists, NO_LISTS, Shifted, WALLS};

/// Memory reused from bundle to bundle.
#[derive(Debug)]
pub struct BundleScratch {
    near: [Option<Collected>; 2 * (WALLS + 1)],
    plain: Shifted,
    careful: Shifted,
    lists: Box<Lists>,
    groups: Vec<Group>,
    lines: Vec<Lines>,
    table: DepthTable,
}

impl Default for BundleScratch {
    fn default() -> Self {
        BundleScratch {
            near: Default::default(),
            plain: Shifted::new(),
            careful: Shifted::new(),
            lists: Box::new(NO_LISTS),
            groups: Vec::new(),
            lines: Vec::new(),
            table: DepthTable::new(),
        }
    }
}

impl PhotonMap {
    /// What each ray of a bundle gathers, as [`PhotonMap::gather`] would, to about a thousandth. Rays too far
    /// apart for that, or under another kernel than the biweight, are gathered one by one.
    pub fn gather_bundle(
        &self,
        bundle: &Bundle<'_>,
        scratch: &mut BundleScratch,
        stats: &mut GatherStats,
        out: &mut Vec<Gathered>,
    ) {
        out.clear();
        out.resize(bundle.rays.len(), Gathered::default());
        if self.is_empty() {
            stats.queries += bundle.rays.len() as u64;
            return;
        }
        let mut groups = std::mem::take(&mut scratch.groups);
        let (mut first, mut used) = (0, 0);
        while first < bundle.rays.len() {
            let most = (bundle.rays.len() - first).min(GROUP);
            // Ever fewer rays, as long as they fill a vector.
            let sizes = [most, most.min(GROUP / 2), most.min(LANES)];
            if used == groups.len() {
                groups.push(Group::EMPTY);
            }
            let group = &mut groups[used];
            let mut set = |count: usize| self.isa.run(Arrange { group, map: self, bundle, first, count }).is_some();
            let narrow = self.profile == Profile::Biweight && sizes.into_iter().any(&mut set);
            if narrow {
                first += group.count;
                used += 1;
            } else {
                let end = first + most.min(LANES);
                for index in first..end {
                    out[index] = bundle.gather_alone(self, index, &mut scratch.table, stats);
                }
                first = end;
            }
        }
        self.serve(bundle, &mut groups[..used], scratch, stats);
        let constant = phase_constant(bundle.phase);
        for group in &groups[..used] {
            stats.queries += group.count as u64;
            for index in 0..group.count {
                let (vector, lane) = (index / LANES, index % LANES);
                let gathered = &mut out[group.first + index];
                for channel in 0..3 {
                    let sum = |part: usize| f64::from(group.sums[part][vector][channel].0[lane]);
                    let (single, multiple) = (sum(0), sum(1));
                    let factor = group.factor[index][channel] * constant;
                    gathered.single[channel] = (single * factor) as f32;
                    gathered.total[channel] = ((single + multiple) * factor) as f32;
                }
            }
        }
        scratch.groups = groups;
    }

    /// Gathers for all groups with one walk, or with several if they are far apart.
    fn serve(&self, bundle: &Bundle<'_>, groups: &mut [Group], scratch: &mut BundleScratch, stats: &mut GatherStats) {
        let Some(cone) = Cone::around(self, bundle, groups, &mut scratch.lines) else {
            if let [_, _, ..] = groups {
                let (some, others) = groups.split_at_mut(groups.len() / 2);
                self.serve(bundle, some, scratch, stats);
                self.serve(bundle, others, scratch, stats);
            }
            return;
        };
        match &bundle.phase.0 {
            Kind::Isotropic => self.serve_phase(bundle, Isotropic, &cone, groups, scratch, stats),
            Kind::HenyeyGreenstein(g) => {
                self.serve_phase(bundle, HenyeyGreenstein::new(*g, DVec3::Z), &cone, groups, scratch, stats)
            }
            Kind::Sum(terms) => self.serve_phase(bundle, Sum::new(terms, DVec3::Z), &cone, groups, scratch, stats),
            Kind::Broad(terms, broad) => {
                let phase = BroadSum::new(terms, broad, DVec3::Z);
                self.serve_phase(bundle, phase, &cone, groups, scratch, stats);
            }
        }
    }

    fn serve_phase<P: Evaluate>(
        &self,
        bundle: &Bundle<'_>,
        phase: P,
        cone: &Cone,
        groups: &mut [Group],
        scratch: &mut BundleScratch,
        stats: &mut GatherStats,
    ) {
        let BundleScratch { near, plain, careful, lists, .. } = scratch;
        let mut serve = |kind: usize, near: &mut Collected| {
            for group in groups.iter_mut() {
                let any = phase.any();
                self.isa.run_or(
                    Shift { bundle, phase, near, kind, group, plain, careful, lists, stats },
                    |Shift { bundle, near, kind, group, plain, careful, lists, stats, .. }| Shift {
                        bundle,
                        phase: any,
                        near,
                        kind,
                        group,
                        plain,
                        careful,
                        lists,
                        stats,
                    },
                );
            }
            near.len = 0;
        };
        let nodes = self.isa.run(Collect { map: self, cone, max_events: bundle.max_events, near, serve: &mut serve });
        for (kind, near) in near.iter_mut().enumerate() {
            if let Some(near) = near.as_mut().filter(|near| near.len > 0) {
                serve(kind, near);
            }
        }
        stats.nodes += nodes;
    }
}

/// The factor that [`Evaluate`] leaves out.
fn phase_constant(phase: &PhaseLanes) -> f64 {
    match &phase.0 {
        Kind::Isotropic => Isotropic.constant(),
        Kind::HenyeyGreenstein(g) => HenyeyGreenstein::new(*g, DVec3::Z).constant(),
        Kind::Sum(terms) => Sum::new(terms, DVec3::Z).constant(),
        Kind::Broad(terms, broad) => BroadSum::new(terms, broad, DVec3::Z).constant(),
    }
}
