//! Where light comes from that gather rays find, as photons tell it.

use std::sync::OnceLock;

use crate::math::{DVec3, Frame};
use crate::photon::sheets::{FACING, FLATTENED};
use crate::photon::simd::LANES;
use crate::photon::{Ball, Photon, PointMap, PointMemory};
use crate::transport::{DirectionGuide, DirectionTable, Interaction, direction_table};

/// Photons that were scattered before they landed on a surface: from where, and with what power, tells where gather rays find light (Jensen
/// 1995, "Importance driven path tracing using the photon map"). Those straight from lights, and those of caustics, tell nothing of it.
#[derive(Debug)]
pub struct FluxMap {
    photons: PointMap,
    /// Places where some of them landed,
    places: PointMap,
    /// and by block and lane, once somebody has asked, what those around tell.
    tables: Vec<OnceLock<Option<Box<DirectionTable>>>>,
}

/// So many photons tell the flux around a place.
const NEIGHBOURS: u32 = 64;
/// It is told at one of so many: as far as that, it hardly changes.
const TO_A_PLACE: usize = 16;
/// Of so many places around a point the nearest is taken that is on its surface,
const CANDIDATES: u32 = 4;
/// which is where the normals have at least this cosine.
const ALIKE: f64 = 0.9;

/// What one thread keeps from look-up to look-up.
#[derive(Clone, Debug, Default)]
pub struct FluxMemory {
    photons: PointMemory,
    places: PointMemory,
}

impl FluxMap {
    /// From photons that were scattered before they landed; none are looked for farther than `max_radius`.
    pub fn build(photons: Vec<Photon>, max_radius: f32) -> Self {
        let nearest = |neighbours| Ball::Nearest { neighbours, max_radius };
        let places: Vec<_> = photons.iter().step_by(TO_A_PLACE).copied().collect();
        let places = PointMap::on_surfaces(places, nearest(CANDIDATES), 1.0);
        let tables = places.normals.iter().flatten().map(|_| OnceLock::new()).collect();
        FluxMap { photons: PointMap::on_surfaces(photons, nearest(NEIGHBOURS), 1.0), places, tables }
    }

    /// Memory taken, in bytes, once all is known.
    pub fn bytes(&self) -> usize {
        let each = size_of::<OnceLock<Option<Box<DirectionTable>>>>() + size_of::<DirectionTable>();
        self.photons.bytes() + self.places.bytes() + self.tables.len() * each
    }

    /// Where paths go on from a surface, by what photons around it tell; `None` where there are none.
    pub fn guide(&self, at: &Interaction, memory: &mut FluxMemory) -> Option<DirectionGuide<'_>> {
        if !self.places.bounds().contains(at.point) {
            return None;
        }
        let x = at.point.as_vec3();
        let mut nearest = (self.places.look_up(x, &mut memory.places), None);
        for &block in memory.places.blocks() {
            for lane in 0..LANES {
                let squared = (self.places.place(block as usize, lane) - x).length_squared();
                if squared <= nearest.0 && self.normal(block as usize, lane).dot(at.incidence.normal) >= ALIKE {
                    nearest = (squared, Some((block as usize, lane)));
                }
            }
        }
        let (block, lane) = nearest.1?;
        let frame = Frame::around(self.normal(block, lane));
        let table = self.tables[block * LANES + lane].get_or_init(|| {
            let mut found = Vec::with_capacity(NEIGHBOURS as usize);
            let place = self.places.place(block, lane).as_dvec3();
            let add = |from: DVec3, power| found.push((frame.to_local(from), power));
            self.around((place, frame.z), &mut memory.photons, add);
            direction_table(found.into_iter()).map(Box::new)
        });
        Some(DirectionGuide::new(frame.turned(at.incidence.shading_normal), table.as_deref()?))
    }

    /// The normal of the surface at a place. Lanes without one have some normal, but are infinitely far.
    fn normal(&self, block: usize, lane: usize) -> DVec3 {
        self.places.normals[block][lane].unpacked().as_dvec3()
    }

    /// Tells `photon` from where and with what power photons landed around a place on a surface with this normal.
    pub fn around(
        &self,
        (point, normal): (DVec3, DVec3),
        memory: &mut PointMemory,
        mut photon: impl FnMut(DVec3, f64),
    ) {
        if !self.photons.bounds().contains(point) {
            return;
        }
        let (x, normal) = (point.as_vec3(), normal.as_vec3());
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
