//! Glowing media as lights.

use rayon::prelude::*;

use crate::math::random::Purpose;
use crate::math::{Bounds, DVec3, Distribution, Ray, Rgb, Stream, sampling};
use crate::medium::Medium;

/// A glowing medium that has an end, in a box: points are drawn from cells in proportion to what was found there, for
/// photons to what it sends out, for those who ask for light to what of that leaves the box besides.
#[derive(Debug)]
pub struct Glow {
    /// The medium: an index into [`Scene::media`](super::Scene::media).
    pub medium: u32,
    bounds: Bounds,
    /// Cells along each edge of the box.
    cells: usize,
    /// By cell, x fastest.
    sent: Distribution,
    /// By cell, x fastest.
    leaving: Distribution,
    /// An estimate of its power.
    power: f64,
}

/// Cells along each edge of the box of voxels, whose flames may be thin.
const CELLS_OF_VOXELS: usize = 64;
/// Cells along each edge of the box of another medium.
const CELLS: usize = 24;
/// Points tried in each cell, one in each of its octants.
const TRIES: usize = 8;
/// The share of points drawn evenly over the box, so that no place is missed.
const EVEN: f64 = 0.1;
/// Of the points for those who ask, the share drawn from what leaves the box.
const LEAVING: f64 = 0.6;

impl Glow {
    /// `medium`, which has this `index` and lies within `bounds`; `radiated` tells what it sends out at a point, radiance
    /// per length, and nothing where it is not. `None` where it sends out nothing, or has no end.
    pub(super) fn new(
        index: u32,
        medium: &Medium,
        bounds: Bounds,
        radiated: impl Fn(DVec3) -> Option<Rgb> + Sync,
    ) -> Option<Glow> {
        if bounds.is_empty() || !bounds.size().is_finite() {
            return None;
        }
        let cells = if medium.density.has_voxels() { CELLS_OF_VOXELS } else { CELLS };
        let (sent, leaving) = Default::default();
        let mut glow = Glow { medium: index, bounds, cells, sent, leaving, power: 0.0 };
        // What each cell sends out, and what of it leaves the box in a direction drawn at random.
        let look = |cell: usize| {
            let mut stream = Stream::new(0, Purpose::Map, index as u64, cell as u64);
            let (mut sent, mut last) = (0.0, None);
            for octant in 0..TRIES {
                let half = |axis: usize| 0.5 * (octant >> axis & 1) as f64;
                let p = glow.point_in(cell, std::array::from_fn(|axis| half(axis) + 0.5 * stream.uniform()));
                if let Some(radiance) = radiated(p) {
                    sent += radiance.element_sum();
                    last = Some((p, radiance));
                }
            }
            let Some((p, radiance)) = last.filter(|_| sent > 0.0) else { return (0.0, 0.0) };
            let ray = Ray::new(p, sampling::sphere(stream.uniform2()).normalize());
            // What of it the medium itself lets through, as if it filled the box.
            let (_, end) = bounds.clip(&ray, 0.0, f64::INFINITY).unwrap_or((0.0, 0.0));
            let transmittance = medium.transmittance(medium.density.depth(&ray, 0.0, end));
            let passed = (radiance * transmittance).element_sum() / radiance.element_sum();
            (sent, if passed > 0.0 { sent * passed } else { 0.0 })
        };
        let found: Vec<(f64, f64)> = (0..cells.pow(3)).into_par_iter().map(look).collect();
        let [sent, leaving] = [found.iter().map(|f| f.0).sum::<f64>(), found.iter().map(|f| f.1).sum::<f64>()];
        if sent <= 0.0 {
            return None;
        }
        let even = |share: f64| (1.0 - EVEN) * share + EVEN / found.len() as f64;
        glow.sent = Distribution::new(found.iter().map(|f| even(f.0 / sent)));
        let leaves = |f: &(f64, f64)| if leaving > 0.0 { f.1 / leaving } else { f.0 / sent };
        let mixed = |f: &(f64, f64)| (1.0 - LEAVING) * f.0 / sent + LEAVING * leaves(f);
        glow.leaving = Distribution::new(found.iter().map(|f| even(mixed(f))));
        glow.power = 4.0 * std::f64::consts::PI * sent / TRIES as f64 * glow.cell_volume();
        Some(glow)
    }

    /// About the power it sends out, all channels together, before it is absorbed on its way.
    pub fn power(&self) -> f64 {
        self.power
    }

    fn cell_volume(&self) -> f64 {
        (self.bounds.size() / self.cells as f64).element_product()
    }

    fn point_in(&self, cell: usize, u: [f64; 3]) -> DVec3 {
        let n = self.cells;
        let index = DVec3::new((cell % n) as f64, (cell / n % n) as f64, (cell / n / n) as f64);
        self.bounds.min + (index + DVec3::from_array(u)) / n as f64 * self.bounds.size()
    }

    /// Draws a point for those who ask for light, as [`Glow::draw`] does for photons.
    pub fn draw_leaving(&self, stream: &mut Stream) -> (DVec3, f64) {
        self.draw_from(&self.leaving, stream)
    }

    /// Draws a point for a photon, perhaps outside of the medium, and tells the density per volume with which it was
    /// drawn.
    pub fn draw(&self, stream: &mut Stream) -> (DVec3, f64) {
        self.draw_from(&self.sent, stream)
    }

    fn draw_from(&self, cells: &Distribution, stream: &mut Stream) -> (DVec3, f64) {
        let cell = cells.choose(stream.uniform()).map_or(0, |choice| choice.index);
        let point = self.point_in(cell, std::array::from_fn(|_| stream.uniform()));
        (point, cells.probability(cell) / self.cell_volume())
    }

    /// The density per volume with which [`Glow::draw_leaving`] draws `p`.
    pub fn density(&self, p: DVec3) -> f64 {
        let n = self.cells;
        let place = (p - self.bounds.min) / self.bounds.size() * n as f64;
        let [x, y, z] = place.to_array().map(|x| (x.max(0.0) as usize).min(n - 1));
        self.leaving.probability((z * n + y) * n + x) / self.cell_volume()
    }

    /// The longest edge of its box.
    pub fn extent(&self) -> f64 {
        self.bounds.size().max_element()
    }
}
