use std::f64::consts::PI;

use super::{DVec3, Frame};

/// Cells of a hemisphere with equal parts of the cosine: rings from the pole down, sectors from x on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Cells {
    /// Rings.
    pub rings: usize,
    /// Sectors of each.
    pub sectors: usize,
}

impl Cells {
    /// About so many, as square as can be.
    pub fn about(rays: u32) -> Cells {
        let rings = (f64::from(rays) / PI).sqrt().round().max(2.0);
        Cells { rings: rings as usize, sectors: ((f64::from(rays) / rings).round() as usize).max(3) }
    }

    /// How many there are.
    pub const fn count(self) -> usize {
        self.rings * self.sectors
    }

    /// The cell that a direction of the frame, with the pole as z, goes through.
    pub fn holding(self, direction: DVec3) -> [usize; 2] {
        let squared = direction.x * direction.x + direction.y * direction.y;
        let turn = direction.y.atan2(direction.x) / (2.0 * PI);
        let ring = ((squared * self.rings as f64) as usize).min(self.rings - 1);
        let sector = (((turn + 1.0).fract() * self.sectors as f64) as usize).min(self.sectors - 1);
        [ring, sector]
    }

    /// Adds what comes from a direction of the frame to its cell, and a part to those around it: light comes not quite from there where it
    /// is looked for.
    pub fn add(self, direction: DVec3, power: f64, flux: &mut [f64]) {
        let [ring, sector] = self.holding(direction);
        let mut give = |ring: usize, sector: usize, share: f64| flux[ring * self.sectors + sector] += share * power;
        let [before, after] = [sector + self.sectors - 1, sector + 1].map(|sector| sector % self.sectors);
        give(ring, sector, 0.5);
        give(ring, before, 0.125);
        give(ring, after, 0.125);
        give(ring.saturating_sub(1), sector, 0.125);
        give((ring + 1).min(self.rings - 1), sector, 0.125);
    }

    /// How many rays go through each cell: one, so that what is found is right whatever the flux is said to be, and `more` in all, in
    /// proportion to the flux, evenly where there is none. As strata, cells whose light is bright, and so uneven, are worth that.
    pub fn rays(self, flux: &[f64], more: u32) -> Vec<u32> {
        let total: f64 = flux.iter().sum();
        let (scale, even) =
            if total > 0.0 { (f64::from(more) / total, 0.0) } else { (0.0, f64::from(more) / self.count() as f64) };
        let (mut sum, mut given) = (0.5, 0.0);
        let of = |flux: &f64| {
            sum += scale * flux + even;
            let before = std::mem::replace(&mut given, f64::floor(sum));
            1 + (given - before) as u32
        };
        flux.iter().map(of).collect()
    }

    /// A direction in cell `index`, drawn in proportion to the cosine to the frame's z.
    pub fn direction(self, index: usize, frame: &Frame, [u, v]: [f64; 2]) -> DVec3 {
        let squared = ((index / self.sectors) as f64 + u) / self.rings as f64;
        let (sin, cos) = (2.0 * PI * ((index % self.sectors) as f64 + v) / self.sectors as f64).sin_cos();
        let radius = squared.sqrt();
        frame.to_world(DVec3::new(radius * cos, radius * sin, (1.0 - squared).sqrt())).normalize()
    }
}
