//! What a pass's photons will come to, by some of them.

use super::work::{Clock, timed};
use crate::Result;
use crate::gather::{GlobalMap, SurfaceMap, VisibilityMap};
use crate::photon::{Kind, Landed, Photon, Radius, Traced, at_once, sample, sample_surfaces, trace_shadows};
use crate::render::maps::{Maps, mean_extinctions, shadow_order, surface_order, wanted};
use crate::render::pass::order;
use crate::render::plan::Plan;
use crate::render::sparse;
use crate::scene::Scene;

/// Photons of a map that tell what all of them take: few, and enough that blocks and walls are as in the map.
const ENOUGH: u64 = 1 << 16;

/// What was found of photons that a render is going to trace; `None` of those it does not want.
#[derive(Debug, Default)]
pub(super) struct Samples {
    pub volume: Option<Expected>,
    pub caustic: Option<Expected>,
    pub global: Option<Expected>,
    pub shadow: Option<Expected>,
    /// Of those that are forced, and read by no one.
    pub unread: Option<Box<Samples>>,
    /// Maps of those that were traced.
    pub maps: Maps,
    /// Bytes that distance fields have come to meanwhile.
    pub distances: u64,
}

/// What photons of a map come to.
#[derive(Debug, Default)]
pub(super) struct Expected {
    /// Photons of the map.
    pub stored: u64,
    /// Photons emitted for it,
    pub emitted: u64,
    /// and their events.
    pub events: u64,
    /// Whether most of them are aimed.
    pub aimed: bool,
    /// Whether their first collisions are forced.
    pub forced: bool,
    /// Whether there are none though media send light to surfaces, which is gathered.
    pub from_media_only: bool,
    /// Why there are none, if a pilot found that.
    pub why_none: Option<&'static str>,
    /// Bytes of the map,
    pub bytes: u64,
    /// and of that what walls near photons take,
    pub walls: u64,
    /// what is kept for rays that surfaces spread,
    pub sparse: u64,
    /// of how many photons,
    pub sparse_photons: u64,
    /// what irradiances take that are known beforehand,
    pub irradiances: u64,
    /// of which there are so many,
    pub irradiance_count: u64,
    /// and what tells where light comes from.
    pub flux: u64,
    /// How many times as many photons are met in the map as among those that were traced,
    pub fullness: f64,
    /// and in that for rays that surfaces spread.
    pub sparse_fullness: f64,
    /// How many were emitted to tell that,
    pub sampled: u64,
    /// and how many seconds that took, with pilots,
    pub traced_in: Option<f64>,
    /// and to build a map of them.
    pub built_in: Option<f64>,
    /// Whether some discs lean on walls.
    pub leans: bool,
    /// Whether some photons keep directions,
    pub directions: bool,
    /// and a power for each channel.
    pub colours: bool,
    /// The mean radius of discs.
    pub radius: f64,
}

impl Samples {
    /// Traces some of the photons of a plan's first pass, and builds maps of them.
    pub fn take(scene: &Scene, plan: &Plan, clock: Clock<'_>) -> Result<Samples> {
        let mut maps = Maps::default();
        let volume = if plan.volume_photons > 0 { Some(of_media(scene, plan, &mut maps, clock)?) } else { None };
        let mut on_surfaces = |kind| {
            if wanted(plan, kind) > 0 { of_surfaces(scene, plan, kind, &mut maps, clock).map(Some) } else { Ok(None) }
        };
        let (caustic, global) = (on_surfaces(Kind::Caustic)?, on_surfaces(Kind::Global)?);
        let shadow = shadow_order(plan, 0).map(|order| {
            let (shadows, traced_in) = timed(clock, || trace_shadows(scene, &order, &|| false));
            let (map, built_in) = timed(clock, || VisibilityMap::build(&shadows.photons, scene.lights.len()));
            let (stored, emitted) = (shadows.photons.len() as u64, shadows.emitted);
            let bytes = map.bytes() as u64;
            maps.visibility = Some(map);
            Expected { stored, emitted, bytes, sampled: emitted, traced_in, built_in, ..Expected::default() }
        });
        let unread = plan.unread.as_ref().map(|unread| Samples::take(scene, unread, clock)).transpose()?.map(Box::new);
        let distances = scene.distances.iter().flatten().map(|field| field.bytes() as u64).sum();
        Ok(Samples { volume, caustic, global, shadow, unread, maps, distances })
    }

    /// How many times as many photons as in the map of those that were traced in media are met in that of all.
    pub fn fullness(&self) -> f64 {
        self.volume.as_ref().map_or(1.0, |volume| volume.fullness)
    }

    /// The same for rays that surfaces spread.
    pub fn sparse_fullness(&self) -> f64 {
        self.volume.as_ref().map_or(1.0, |volume| volume.sparse_fullness)
    }

    /// Bytes of the maps of photons in media.
    pub fn volume_bytes(&self) -> u64 {
        let unread = self.unread.as_ref().map_or(0, |unread| unread.volume_bytes());
        unread + self.volume.as_ref().map_or(0, |map| map.bytes)
    }

    /// The most bytes of maps and of photons that are not in one yet. Those of media leave as their map is filled, and those on surfaces
    /// come later, beside it.
    pub fn building_bytes(&self) -> u64 {
        let of = |map: &Option<Expected>| map.as_ref().map_or(0, traced_bytes);
        let [media, caustic, global] = [&self.volume, &self.caustic, &self.global].map(of);
        // Beside all photons there are, at first, chunks of those that are traced at once, with regions, and then half of the map before half of the
        // photons are given back. Where distance fields grow between chunks, the allocator keeps all of these.
        let chunks = |found: &Expected| found.stored * size_of::<(u32, Photon)>() as u64;
        let tracing = self.volume.as_ref().map_or(0, |found| match self.distances {
            0 => {
                let at_once = all(chunks(found), found.emitted, at_once(found.emitted).min(found.emitted));
                media + at_once.max(found.bytes / 2)
            }
            fields => media + chunks(found) + found.bytes / 2 + fields,
        });
        let landing = self.volume_bytes() + (2 * caustic).max(caustic + 2 * global);
        tracing.max(landing).max(self.volume_bytes() + self.surface_bytes() + caustic.max(global))
    }

    /// The most bytes of photons that are not in a map yet: those of media, or of one of the maps on surfaces.
    pub fn traced_bytes(&self) -> u64 {
        [&self.volume, &self.caustic, &self.global].into_iter().flatten().map(traced_bytes).max().unwrap_or(0)
    }

    /// Bytes of the maps of photons on surfaces.
    pub fn surface_bytes(&self) -> u64 {
        let unread = self.unread.as_ref().map_or(0, |unread| unread.surface_bytes());
        unread + [&self.caustic, &self.global, &self.shadow].into_iter().flatten().map(|map| map.bytes).sum::<u64>()
    }
}

/// Bytes of a map's photons as they were traced.
fn traced_bytes(map: &Expected) -> u64 {
    map.stored * size_of::<Photon>() as u64
}

/// As much as there is in all, if `part` is what a part of the emissions leave.
fn all(part: u64, emitted: u64, planned: u64) -> u64 {
    (part as f64 * planned as f64 / emitted.max(1) as f64).round() as u64
}

fn of_media(scene: &Scene, plan: &Plan, found: &mut Maps, clock: Clock<'_>) -> Result<Expected> {
    let (traced, traced_in) = timed(clock, || sample(scene, &order(plan, 0), ENOUGH));
    let traced = traced?;
    let Traced { emitted, planned, events, aimed, forced, .. } = traced;
    let scaled = |part: usize| all(part as u64, emitted, planned);
    let mut expected = Expected {
        stored: scaled(traced.stored() as usize),
        emitted: planned,
        events: (planned as f64 * events) as u64,
        aimed,
        forced,
        sampled: emitted,
        traced_in,
        ..Expected::default()
    };
    if expected.stored == 0 {
        expected.why_none = Some("none of a pilot's photons meets a medium that scatters");
        return Ok(expected);
    }

    // As wide as all of them will be. Those for rays that surfaces spread are as large as their number says.
    let thinned = Plan { radius: plan.radius.among(emitted as f64 / planned as f64), spreads: false, ..plan.clone() };
    let extinctions = mean_extinctions(scene, &traced.regions);
    let (maps, built_in) = timed(clock, || Maps::build(scene, &thinned, 0, &extinctions, traced.regions));
    expected.built_in = built_in;
    expected.fullness = planned as f64 / emitted as f64;
    let one_in = sparse::one_in(expected.stored as usize).filter(|_| plan.spreads && plan.points.is_none());
    expected.sparse_fullness = expected.fullness * one_in.map_or(1.0, |one_in| met(plan.radius, one_in as u32));
    let mut radii = 0.0;
    for (_, map) in maps.summaries() {
        let (photons, bytes) = (scaled(map.photons), scaled(map.bytes));
        let one_in = sparse::one_in(photons as usize).filter(|_| plan.spreads && plan.points.is_none());
        let of_spread = |number: u64| one_in.map_or(0, |one_in| number / one_in as u64);
        expected.sparse += of_spread(bytes);
        expected.sparse_photons += of_spread(photons);
        expected.bytes += bytes + of_spread(bytes);
        expected.walls += scaled(map.walls);
        expected.leans |= map.leans;
        expected.directions |= map.directions;
        expected.colours |= map.colours;
        radii += f64::from(map.radii.mean) * photons as f64;
    }
    expected.radius = radii / expected.stored as f64;
    found.volume = maps.volume;
    Ok(expected)
}

/// The share of photons that a ray still meets where one in so many stands for all, and is spread more widely: of N photons in discs of radius r a ray
/// meets some N r², and n of them fill a radius r ∝ (n/N)^⅓.
fn met(radius: Radius, one_in: u32) -> f64 {
    let fewer = f64::from(one_in).recip();
    match (radius, sparse::wider(radius, one_in)) {
        (Radius::Variable { neighbours: all, .. }, Radius::Variable { neighbours, .. }) => {
            fewer * (f64::from(neighbours) / f64::from(all) / fewer).powf(2.0 / 3.0)
        }
        _ => fewer,
    }
}

fn of_surfaces(scene: &Scene, plan: &Plan, kind: Kind, found: &mut Maps, clock: Clock<'_>) -> Result<Expected> {
    let (landed, traced_in) = timed(clock, || sample_surfaces(scene, &surface_order(plan, kind, 0), ENOUGH));
    let landed = landed?;
    let Landed { emitted, planned, events, aimed, from_media_only, why_none, .. } = landed;
    let scaled = |part: usize| all(part as u64, emitted, planned);
    let mut expected = Expected {
        stored: scaled(landed.photons.len()),
        emitted: planned,
        events: (planned as f64 * events) as u64,
        aimed,
        from_media_only,
        why_none,
        sampled: emitted,
        traced_in,
        ..Expected::default()
    };
    if kind == Kind::Global {
        found.from_media_only = from_media_only;
    }
    if landed.photons.is_empty() {
        return Ok(expected);
    }
    match kind {
        Kind::Caustic => {
            let (reach, filter) = plan.caustics;
            let photons = (kind, landed.photons);
            let (map, built_in) = timed(clock, || SurfaceMap::build(scene, photons, reach, filter, 1.0));
            expected.built_in = built_in;
            expected.bytes = scaled(map.bytes());
            found.caustic = Some(map);
        }
        Kind::Global => {
            let photons = (landed.photons, landed.scattered);
            let (map, built_in) = timed(clock, || GlobalMap::build(scene, photons, &plan.global, 1.0));
            expected.built_in = built_in;
            expected.bytes = scaled(map.bytes());
            expected.irradiances = scaled(map.irradiance_bytes());
            if let Some(places) = expected.stored.checked_div(u64::from(plan.global.precomputed)) {
                expected.irradiance_count = places;
            }
            expected.flux = map.flux().map_or(0, |flux| scaled(flux.bytes()));
            found.global = Some(map);
        }
    }
    Ok(expected)
}
