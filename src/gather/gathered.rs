//! What queries find, and what they cost.

use crate::math::{Rgb, Vec3};

/// What a query found.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Gathered {
    /// Radiance at the segment's start.
    pub total: [f32; 3],
    /// The part from photons without events before their collision; 0 if the map is not tagged.
    pub single: [f32; 3],
}

impl Gathered {
    /// Both parts in `f64`.
    pub fn rgb(&self) -> (Rgb, Rgb) {
        let wide = |rgb: [f32; 3]| Vec3::from_array(rgb).as_dvec3();
        (wide(self.total), wide(self.single))
    }
}

/// What queries cost, summed.
#[derive(Clone, Copy, Debug, Default, serde::Serialize, serde::Deserialize, PartialEq, Eq)]
#[serde(default)]
pub struct GatherStats {
    /// Queries made.
    pub queries: u64,
    /// Nodes visited.
    pub nodes: u64,
    /// Blocks of sixteen photons tested.
    pub blocks: u64,
    /// Photons that contributed.
    pub photons: u64,
    /// Shadow rays that surfaces sent,
    pub shadow_rays: u64,
    /// and those that shadow photons spared.
    pub spared_rays: u64,
}

impl std::ops::AddAssign for GatherStats {
    fn add_assign(&mut self, other: Self) {
        self.queries += other.queries;
        self.nodes += other.nodes;
        self.blocks += other.blocks;
        self.photons += other.photons;
        self.shadow_rays += other.shadow_rays;
        self.spared_rays += other.spared_rays;
    }
}

/// The sums of a query, before they are multiplied by what all their terms have in common.
pub(super) struct Sums {
    pub(super) total: [f64; 3],
    pub(super) single: [f64; 3],
}

impl Sums {
    /// What was found, with this common factor.
    pub(super) fn times(&self, factor: f64) -> Gathered {
        let times = |sums: [f64; 3]| sums.map(|sum| (sum * factor) as f32);
        Gathered { total: times(self.total), single: times(self.single) }
    }
}
