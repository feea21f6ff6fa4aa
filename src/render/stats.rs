//! What a render cost.

use serde::{Deserialize, Serialize};

use super::maps::Summary;
use crate::gather::GatherStats;
use crate::photon::Radii;
use crate::transport::Tally;

/// What a render cost, in all passes together.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
#[serde(default)]
pub struct Stats {
    /// Seconds in the photon pass.
    pub photons_seconds: f64,
    /// Seconds for radii and hierarchies.
    pub build_seconds: f64,
    /// Seconds for the pixels.
    pub render_seconds: f64,
    /// Photons emitted.
    pub emitted: u64,
    /// Volume photons stored.
    pub volume: u64,
    /// Photons of caustics stored.
    pub caustic: u64,
    /// Photons stored in global maps.
    pub global: u64,
    /// Shadow photons that landed.
    pub shadow: u64,
    /// Records of irradiance caches.
    pub records: u64,
    /// The largest map, in bytes.
    pub map_bytes: u64,
    /// The largest maps of photons on surfaces, in bytes.
    pub surface_bytes: u64,
    /// The discs' radii, of the last pass.
    #[serde(skip)]
    pub radii: Radii,
    /// What queries cost, of beams or of points.
    pub gather: GatherStats,
    /// Passes done.
    pub passes: u64,
    /// Camera samples per pixel in the image.
    pub samples: u64,
    /// The relative standard error ([`Film::error`](super::Film::error)), where there are several passes.
    pub error: Option<f64>,
    /// Counts of mishaps.
    pub tally: Tally,
}

impl Stats {
    /// Adds what other passes cost.
    pub fn merge(&mut self, other: &Stats) {
        self.photons_seconds += other.photons_seconds;
        self.build_seconds += other.build_seconds;
        self.render_seconds += other.render_seconds;
        self.emitted += other.emitted;
        self.volume += other.volume;
        self.caustic += other.caustic;
        self.global += other.global;
        self.shadow += other.shadow;
        self.records += other.records;
        self.map_bytes = self.map_bytes.max(other.map_bytes);
        self.surface_bytes = self.surface_bytes.max(other.surface_bytes);
        self.gather += other.gather;
        self.passes += other.passes;
        self.samples += other.samples;
        self.tally = self.tally.merge(other.tally);
    }

    /// Notes maps that were built for a pass.
    pub(super) fn built(&mut self, maps: &[(u32, Summary)]) {
        self.tally.broken += maps.iter().map(|(_, map)| map.rejected as u64).sum::<u64>();
        self.map_bytes = self.map_bytes.max(maps.iter().map(|(_, map)| map.bytes as u64).sum());
        self.radii = radii(maps);
    }
}

/// The radii of all maps together.
fn radii(maps: &[(u32, Summary)]) -> Radii {
    let photons: usize = maps.iter().map(|(_, map)| map.photons).sum();
    if photons == 0 {
        return Radii::default();
    }
    maps.iter().fold(Radii { min: f32::INFINITY, mean: 0.0, max: 0.0 }, |all, (_, map)| {
        let Radii { min, mean, max } = map.radii;
        let share = map.photons as f32 / photons as f32;
        Radii { min: all.min.min(min), mean: all.mean + share * mean, max: all.max.max(max) }
    })
}
