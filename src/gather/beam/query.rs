//! The beam query: what is asked, and how it is answered.

use super::block::{Found, add_block};
use super::frame::{RayFrame, RayLanes, Slabs};
use super::listing::Listing;
use super::transmittance::{Coloured, Grey, Pruning, Tabulated, Transmit, exponents};
use crate::gather::confined::Confined;
use crate::gather::depth::DepthTable;
use crate::gather::gathered::{GatherStats, Gathered, Sums};
use crate::gather::phase::{BroadSum, Evaluate, HenyeyGreenstein, Isotropic, Kind, PhaseLanes, Sum};
use crate::geometry::Hull;
use crate::math::{DVec3, Vec3};
use crate::photon::discs::PhotonMap;
use crate::photon::simd::{Lanes, Task};
use crate::photon::store::{Meets, Node};

/// A segment of a ray from the eye through one medium.
#[derive(Clone, Copy, Debug)]
pub struct BeamQuery<'a> {
    /// Where it starts.
    pub origin: DVec3,
    /// The unit direction ω, away from the eye.
    pub direction: DVec3,
    /// Its length; may be infinite.
    pub length: f32,
    /// The medium's phase function.
    pub phase: &'a PhaseLanes,
    /// The extinction coefficient; with `depth`, per unit of density.
    pub extinction: Vec3,
    /// The density integrated along the segment; `None` for a density of 1 throughout.
    pub depth: Option<&'a DepthTable>,
    /// Only photons with at most this many events count, if the map is tagged; 255 for all.
    pub max_events: u8,
    /// The solid that it lies in, if discs are about as wide as that.
    pub hull: Option<&'a Hull>,
    /// A number in (0, 1] that decides, by Russian roulette, how far the query goes where hardly any light arrives
    /// from; `None` for all the way.
    pub pruning: Option<f32>,
}

impl PhotonMap {
    /// The light scattered towards the start of a ray segment along its whole length,
    ///
    /// L_c = Σᵢ K₂(ρᵢ/rᵢ)/rᵢ² · e^{−σ_c D(tᵢ)} · p(−dᵢ·ω) · Pᵢ,c   over 0 < tᵢ < length, ρᵢ < rᵢ,
    ///
    /// with tᵢ = (xᵢ − o)·ω, ρᵢ the photon's distance from the ray, D(t) = t without a table. Where
    /// walls cut the disc around the foot point, a contribution is divided by the share of the disc
    /// on the photon's side, and is none if the foot point lies on the other side.
    ///
    /// Allocates nothing. The result depends on the map and the query alone, up to the rounding of
    /// the instruction set.
    pub fn gather(&self, query: &BeamQuery, stats: &mut GatherStats) -> Gathered {
        let omega = query.direction;
        match &query.phase.0 {
            Kind::Isotropic => self.gather_phase(query, Isotropic, stats),
            Kind::HenyeyGreenstein(g) => self.gather_phase(query, HenyeyGreenstein::new(*g, omega), stats),
            Kind::Sum(terms) => self.gather_phase(query, Sum::new(terms, omega), stats),
            Kind::Broad(terms, broad) => self.gather_phase(query, BroadSum::new(terms, broad, omega), stats),
        }
    }

    fn gather_phase(&self, query: &BeamQuery, phase: impl Evaluate, stats: &mut GatherStats) -> Gathered {
        stats.queries += 1;
        if self.is_empty() {
            return Gathered::default();
        }
        let exponents = exponents(query.extinction);
        let grey = exponents[0] == exponents[1] && exponents[0] == exponents[2];
        let pruning = Pruning::new(query.pruning);
        let deepest = pruning.depth(exponents);
        let end = match query.depth {
            None => deepest,
            Some(table) => table.reach(deepest),
        };
        let query = &BeamQuery { length: query.length.min(end), ..*query };
        match query.depth {
            None if grey => self.gather_kind((query, pruning), phase, Grey(exponents[0]), stats),
            None => self.gather_kind((query, pruning), phase, Coloured(exponents), stats),
            Some(table) => self.gather_kind(
                (query, pruning),
                phase,
                Tabulated { table, exponents, grey, fluence: self.fluence },
                stats,
            ),
        }
    }

    fn gather_kind(
        &self,
        (query, pruning): (&BeamQuery, Pruning),
        phase: impl Evaluate,
        transmittance: impl Transmit,
        stats: &mut GatherStats,
    ) -> Gathered {
        let constant = phase.constant();
        let (any_phase, any_transmittance) = (phase.any(), transmittance.any());
        let sums = self.isa.run_or(
            GatherBeam { map: self, query, pruning, phase, transmittance, stats },
            |GatherBeam { map, query, pruning, stats, .. }| {
                let (phase, transmittance) = (any_phase, any_transmittance);
                GatherBeam { map, query, pruning, phase, transmittance, stats }
            },
        );
        sums.times(constant)
    }
}

/// The query as a kernel.
struct GatherBeam<'a, P, T> {
    map: &'a PhotonMap,
    query: &'a BeamQuery<'a>,
    pruning: Pruning,
    phase: P,
    transmittance: T,
    stats: &'a mut GatherStats,
}

/// How many blocks ahead to fetch.
const AHEAD: usize = 2;

/// A ray, by the test that its map wants.
struct RayTest<'a, L> {
    ray: &'a RayLanes<L>,
    slabs: &'a Option<Slabs>,
}

impl<L: Lanes> Meets<Node> for RayTest<'_, L> {
    #[inline(always)]
    fn children(&self, node: &Node) -> u16 {
        match self.slabs {
            Some(slabs) => slabs.hit::<L>(&node.min, &node.max),
            None => self.ray.hit(&node.center, &node.radius),
        }
    }
}

impl<P: Evaluate, T: Transmit> Task for GatherBeam<'_, P, T> {
    type Output = Sums;

    #[inline(always)]
    fn run<L: Lanes>(self) -> Sums {
        let GatherBeam { map, query, pruning, phase, transmittance, stats } = self;
        let ray = RayFrame::new(query.origin, query.direction, query.length).lanes::<L>();
        let slabs = if map.boxes { Some(Slabs::new(map, query.origin, query.direction, query.length)) } else { None };

        let confined = query.hull.map(|hull| {
            let turn = Pruning::number(-query.direction);
            Confined::new(hull, query.origin, query.direction, turn.into())
        });
        let limits = (query.max_events, pruning, confined.as_ref());
        let mut sums = Sums { total: [0.0; 3], single: [0.0; 3] };
        let mut listing = Listing::new(map);
        let (mut blocks, mut photons) = (0, 0);
        while listing.goes_on() {
            let listed = listing.fill::<L>(&RayTest { ray: &ray, slabs: &slabs });
            let mut found = Found::<L>::none();
            for i in 0..listed {
                map.blocks.prefetch(listing.block((i + AHEAD).min(listed - 1)));
                let index = listing.block(i);
                add_block(map, index, &ray, &phase, &transmittance, limits, &mut found);
            }
            for channel in 0..3 {
                sums.total[channel] += f64::from(found.total[channel].sum());
                sums.single[channel] += f64::from(found.single[channel].sum());
            }
            blocks += listed as u64;
            photons += found.photons;
        }
        stats.nodes += listing.nodes();
        stats.blocks += blocks;
        stats.photons += photons;
        sums
    }
}
