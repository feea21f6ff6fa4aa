//! How far surfaces are from places in a solid, remembered cell by cell.
//!
//! A random walk through a dense solid flies a short way at each of thousands of steps, and hardly any leads to a surface. So cells
//! about as large as its flights remember how far the nearest surface is from their middles: from there on nobody looks for it where
//! it cannot be (sphere tracing; Hart 1996). Cells are asked for the first time by whoever comes there first, and whoever asks finds the
//! same.

use std::sync::OnceLock;
use std::sync::atomic::{AtomicU16, Ordering};

use super::Geometry;
use crate::math::{Bounds, DVec3, Ray};

/// Cells along an edge of a brick: they are made together.
const BRICK: u32 = 8;
const CELLS: usize = (BRICK * BRICK * BRICK) as usize;
/// There is room for so many bricks at most, of all solids together: 64 MiB, if walks come near surfaces in all of them.
const MOST_BRICKS: f64 = 65_536.0;
/// Distances are remembered up to so many edges of a cell,
const FARTHEST: f64 = 32.0;
/// in so many steps each.
const STEPS: f64 = 2000.0;
/// Of what no one has asked for.
const UNKNOWN: u16 = u16::MAX;
/// It is enough to know that a surface is farther from a place than so many edges.
const FAR: f64 = 4.0;
/// A ray that passes surfaces within this part of a cell's edge is left to be intersected with them,
const NEAR: f64 = 0.1;
/// and one that takes more steps than these.
const MOST_STEPS: u32 = 12;

/// Distances of the nearest surface from places in a box.
#[derive(Debug)]
pub struct Distances {
    low: DVec3,
    /// The edge of a cell,
    edge: f64,
    /// and how many cells there are to a length.
    cells: f64,
    /// The box, in cells,
    end: DVec3,
    /// and in bricks.
    size: [u32; 3],
    /// Of each brick the distance from its middle in steps, or [`UNKNOWN`],
    bricks: Vec<AtomicU16>,
    /// and of its cells, where it is near a surface.
    near: Vec<OnceLock<Box<[AtomicU16; CELLS]>>>,
}

impl Distances {
    /// Bytes of what has been asked for so far, beyond what there is from the beginning.
    pub fn bytes(&self) -> usize {
        self.near.iter().filter(|cells| cells.get().is_some()).count() * size_of::<[AtomicU16; CELLS]>()
    }

    /// Of places in `bounds`, in cells of this edge, or larger ones where those would be too many beside those of so many others; `None` where
    /// `bounds` has no end.
    pub fn new(bounds: &Bounds, edge: f64, sharing: usize) -> Option<Self> {
        let size = bounds.size();
        let volume = size.max(DVec3::splat(1e-3 * size.max_element())).element_product();
        // Half-filled bricks at the ends leave less room.
        let edge = edge.max((2.0 * volume * sharing as f64 / MOST_BRICKS).cbrt() / f64::from(BRICK));
        if volume.is_nan() || volume <= 0.0 || !edge.is_finite() {
            return None;
        }
        let size = (size / (edge * f64::from(BRICK))).floor().to_array().map(|bricks| bricks as u32 + 1);
        let end = DVec3::from(size.map(|bricks| f64::from(bricks * BRICK)));
        let count = size.iter().map(|&n| n as usize).product();
        let (mut bricks, mut near) = (Vec::new(), Vec::new());
        bricks.resize_with(count, || AtomicU16::new(UNKNOWN));
        near.resize_with(count, OnceLock::new);
        Some(Distances { low: bounds.min, edge, cells: edge.recip(), end, size, bricks, near })
    }

    /// How far the nearest surface is from `p`, at least: near surfaces exact to the distance of the middle of a cell. 0 outside of the
    /// box.
    #[inline]
    pub fn least(&self, geometry: &Geometry, p: DVec3) -> f64 {
        let place = (p - self.low) * self.cells;
        let is_inside = place.cmpge(DVec3::ZERO).all() && place.cmplt(self.end).all();
        if !is_inside {
            return 0.0;
        }
        let (i, j, k) = (place.x as u32, place.y as u32, place.z as u32);
        let number = i / BRICK + self.size[0] * (j / BRICK + self.size[1] * (k / BRICK));
        let half = BRICK / 2;
        let middle = |i: u32| f64::from((i & !(BRICK - 1)) + half);
        let middle = DVec3::new(middle(i), middle(j), middle(k));
        let left = self.known(&self.bricks[number as usize], geometry, middle) - place.distance(middle);
        if left > FAR {
            return self.edge * left;
        }
        let cells = self.near[number as usize].get_or_init(|| Box::new([const { AtomicU16::new(UNKNOWN) }; CELLS]));
        let cell = i % BRICK + BRICK * (j % BRICK + BRICK * (k % BRICK));
        let middle = DVec3::new(f64::from(i), f64::from(j), f64::from(k)) + 0.5;
        self.edge * (self.known(&cells[cell as usize], geometry, middle) - place.distance(middle)).max(0.0)
    }

    /// How far the nearest surface is from a place, both in cells, as was found before, or is found now.
    #[inline]
    fn known(&self, steps: &AtomicU16, geometry: &Geometry, place: DVec3) -> f64 {
        let known = match steps.load(Ordering::Relaxed) {
            UNKNOWN => self.measure(steps, geometry, place),
            known => known,
        };
        f64::from(known) * STEPS.recip()
    }

    #[cold]
    fn measure(&self, steps: &AtomicU16, geometry: &Geometry, place: DVec3) -> u16 {
        let clear = geometry.clearance(self.low + place * self.edge, FARTHEST * self.edge);
        // A step less, for the sake of roundings.
        let found = ((clear * self.cells * STEPS) as u16).saturating_sub(1);
        steps.store(found, Ordering::Relaxed);
        found
    }

    /// Whether a ray certainly meets no surface from parameter `a` to `b`.
    pub fn is_free(&self, geometry: &Geometry, ray: &Ray, a: f64, b: f64) -> bool {
        let mut t = a;
        for _ in 0..MOST_STEPS {
            let free = self.least(geometry, ray.at(t));
            t += free;
            if t > b {
                return true;
            }
            if free < NEAR * self.edge {
                return false;
            }
        }
        false
    }
}
