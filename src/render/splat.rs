//! Light that is sent to pixels, from wherever it comes, not looked for through them.

use super::exact::ExactSums;
use super::eye::Component;
use crate::math::Rgb;

/// Light that arrived at a pixel.
#[derive(Clone, Copy, Debug)]
pub struct Splat {
    /// The pixel, row by row from the top left.
    pub pixel: u32,
    /// Its kind.
    pub component: Component,
    /// The radiance it would be if its path were the only one.
    pub radiance: Rgb,
}

const COMPONENTS: usize = Component::ALL.len();

/// Sums of splats by pixel: exact, so that the order in which they come changes nothing.
#[derive(Debug)]
pub(super) struct Splats {
    /// Of all components that are shown.
    shown: ExactSums<3>,
    /// By component, where layers are kept; `None` for those that are black throughout.
    components: [Option<ExactSums<3>>; COMPONENTS],
    pixels: usize,
    /// The light paths they stem from.
    paths: u64,
}

impl Splats {
    /// Of no path yet.
    pub fn new(pixels: usize) -> Self {
        Splats { shown: ExactSums::new(pixels), components: [const { None }; COMPONENTS], pixels, paths: 0 }
    }

    /// Bytes that they take by pixel.
    pub const fn bytes(layers: bool) -> usize {
        ExactSums::<3>::BYTES * if layers { 1 + COMPONENTS } else { 1 }
    }

    /// Adds all that `paths` paths have sent: no more than one splat for each pixel and component, and no more than 2²⁸
    /// times.
    pub fn add(&mut self, splats: &[Splat], paths: u64, shown: &[bool; COMPONENTS], layers: bool) {
        self.paths += paths;
        for splat in splats {
            let (at, component) = (splat.pixel as usize, splat.component as usize);
            let radiance = splat.radiance.to_array();
            if shown[component] {
                self.shown.add_at(at, radiance);
            }
            if layers {
                let sums = self.components[component].get_or_insert_with(|| ExactSums::new(self.pixels));
                sums.add_at(at, radiance);
            }
        }
    }

    /// A pixel's mean over all paths.
    pub fn mean(&self, at: usize) -> [f64; 3] {
        self.over_paths(&self.shown, at)
    }

    /// Of one component.
    pub fn component(&self, component: usize, at: usize) -> [f64; 3] {
        self.components[component].as_ref().map_or([0.0; 3], |sums| self.over_paths(sums, at))
    }

    /// Whether any splat was of this component.
    pub fn holds(&self, component: usize) -> bool {
        self.components[component].is_some()
    }

    fn over_paths(&self, sums: &ExactSums<3>, at: usize) -> [f64; 3] {
        let scale = 1.0 / self.paths.max(1) as f64;
        sums.get(at).map(|sum| sum * scale)
    }
}

/// Joins splats of the same pixel and component, in the order in which they came.
pub(super) fn join(splats: &mut Vec<Splat>) {
    splats.sort_by_key(|splat| (splat.pixel, splat.component as usize));
    splats.dedup_by(|next, sum| {
        let same = next.pixel == sum.pixel && next.component == sum.component;
        if same {
            sum.radiance += next.radiance;
        }
        same
    });
}
