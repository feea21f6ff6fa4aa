//! Where light comes from that gather rays find, as photons tell it.

use crate::math::DVec3;
use crate::photon::sheets::{FACING, FLATTENED};
use crate::photon::simd::LANES;
use crate::photon::{Ball, Photon, PointMap, PointMemory};
use crate::transport::Interaction;

/// Photons that were scattered before they landed on a surface: from where, and with what power, tells where gather rays find light (Jensen
/// 1995, "Importance driven path tracing using the photon map"). Those straight from lights, and those of caustics, tell nothing of it.
#[derive(Debug)]
pub struct FluxMap {
    photons: PointMap,
}

/// So many photons tell the flux around a place.
const NEIGHBOURS: u32 = 64;

impl FluxMap {
    /// From photons that were scattered before they landed; none are looked for farther than `max_radius`.
    pub fn build(photons: Vec<Photon>, max_radius: f32) -> Self {
        let nearest = Ball::Nearest { neighbours: NEIGHBOURS, max_radius };
        FluxMap { photons: PointMap::on_surfaces(photons, nearest, 1.0) }
    }

    /// Memory taken, in bytes.
    pub fn bytes(&self) -> usize {
        self.photons.bytes()
    }

    /// Tells `photon` from where and with what power photons landed around a place.
    pub fn around(&self, at: &Interaction, memory: &mut PointMemory, mut photon: impl FnMut(DVec3, f64)) {
        if !self.photons.bounds().contains(at.point) {
            return;
        }
        let (x, normal) = (at.point.as_vec3(), at.incidence.normal.as_vec3());
        let squared = self.photons.look_up(x, memory);
        let height = FLATTENED * squared.sqrt();
        for &block in memory.blocks() {
            let block = block as usize;
            for lane in 0..LANES {
                let offset = self.photons.place(block, lane) - x;
                // Lanes without a photon are infinitely far, or not a number.
                let near = offset.length_squared() < squared && offset.dot(normal).abs() <= height;
                if near && self.photons.normals[block][lane].unpacked().dot(normal) >= FACING {
                    let (direction, power) = self.photons.loads[block].of(lane);
                    photon(-direction, power.element_sum());
                }
            }
        }
    }
}
