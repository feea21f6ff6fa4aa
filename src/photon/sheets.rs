//! The sheet map: photons on surfaces, each spread over a disc on its tangent plane, in blocks of sixteen under a tree of boxes.
//!
//! It is to a point map what the discs of beam queries are to points along rays: the radius belongs to the photon (Jarosz et al. 2008, §4),
//! and places are told by all sheets that hold them. As photons fill surfaces in two dimensions, radii in proportion to the distance of
//! the m-th neighbour are in proportion to the density's inverse square root, with which what is first order in the blur vanishes
//! (Abramson 1982, "On bandwidth variation in kernel estimates: a square root law").

use std::f32::consts::PI;

use rayon::prelude::*;

use super::balls::{Ball, Near, PointMap, PointMemory};
use super::radius::{Filling, Limits, Radii};
use super::simd::{LANES, Lanes, Row, Task, dot_plus, splat3};
use super::store::{Descent, Photon, blocks_of, photons_in};
use crate::math::{Bounds, Vec3};

/// How high above the tangent plane photons count, as a share of the radius: a ball of five radii still has all its
/// light.
pub(crate) const FLATTENED: f32 = 0.1;
/// Photons count whose surface's normal has at least this cosine to that at the place looked up.
pub(crate) const FACING: f32 = 0.8;

/// Photons on surfaces.
type OnSurfaces = Filling<2>;

/// How wide photons on surfaces are spread.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SheetSettings {
    /// n: about so many sheets overlap.
    pub neighbours: u32,
    /// m: the radius is found from the m-th nearest photon.
    pub pilot: u32,
    /// No radius exceeds this. If it is not finite, the diagonal of the box around the photons.
    pub max_radius: f32,
    /// Multiplies every radius, the cap included: progressive passes shrink it.
    pub scale: f32,
}

/// Photons and their sheets.
#[derive(Clone, Debug)]
pub struct SheetMap {
    /// The photons, under boxes around their sheets.
    pub(crate) photons: PointMap,
    /// Squared radii; 0 in lanes without a photon.
    squares: Vec<Row>,
    settings: SheetSettings,
    radii: Radii,
}

impl SheetMap {
    /// Orders photons, finds their radii, and builds the tree; in parallel, on the current thread pool, with the same result for any
    /// number of threads.
    pub fn build(photons: Vec<Photon>, settings: &SheetSettings) -> SheetMap {
        let SheetSettings { pilot, max_radius, .. } = *settings;
        // With the photon itself.
        let ball = Ball::Nearest { neighbours: pilot + 1, max_radius };
        let mut photons = PointMap::on_surfaces(photons, ball, 1.0);
        let squares = squares_of(&photons, settings);
        let radii: Vec<f32> = squares.iter().flat_map(|row| row.0.map(f32::sqrt)).collect();
        photons.cover(&radii);
        SheetMap { settings: *settings, radii: Radii::of(&radii[..photons.len()]), photons, squares }
    }

    /// Memory taken, in bytes.
    pub fn bytes(&self) -> usize {
        self.photons.bytes() + size_of_val(&*self.squares)
    }

    /// The sheets' radii.
    pub fn radii(&self) -> Radii {
        self.radii
    }

    /// How wide its photons are spread.
    pub(crate) fn settings(&self) -> &SheetSettings {
        &self.settings
    }

    /// How many blocks there are.
    pub(crate) fn blocks(&self) -> usize {
        self.squares.len()
    }

    /// A photon's squared radius; 0 if there is none.
    pub(crate) fn square(&self, block: usize, lane: usize) -> f32 {
        self.squares[block].0[lane]
    }

    /// A photon's radius; 0 if there is none.
    pub(crate) fn radius(&self, block: usize, lane: usize) -> f32 {
        self.square(block, lane).sqrt()
    }

    /// Of the photons that the last look-up found, the radius of the nearest to `x`; 0 if there is none.
    pub(crate) fn radius_at(&self, x: Vec3, memory: &PointMemory) -> f32 {
        let distance = |&(block, lane): &(usize, usize)| self.photons.place(block, lane).distance_squared(x);
        let nearest = memory.lanes().min_by(|a, b| distance(a).total_cmp(&distance(b)));
        nearest.map_or(0.0, |(block, lane)| self.radius(block, lane))
    }

    /// Divides powers by the sheets' areas, of each the share that is asked for.
    pub(crate) fn divide_powers(&mut self, share: impl Fn(usize, usize) -> f32 + Sync) {
        let loads = self.photons.loads.par_iter_mut().zip(&self.squares).enumerate();
        loads.for_each(|(block, (load, squares))| {
            for power in &mut load.power {
                for (lane, (power, square)) in
                    power.0.iter_mut().zip(squares.0).enumerate().filter(|(_, (_, s))| *s > 0.0)
                {
                    *power /= PI * square * share(block, lane);
                }
            }
        });
    }

    /// Finds the photons whose sheets' spheres hold `x`, as the `memory`'s lanes, in an order that depends on the map alone.
    pub(crate) fn look_up(&self, x: Vec3, memory: &mut PointMemory) {
        self.photons.isa.run(LookUp { map: self, x, memory });
    }
}

/// The squared radius of every sheet: r = d √(n/c), c the photons on the same surface strictly closer than d, the m-th nearest.
fn squares_of(photons: &PointMap, settings: &SheetSettings) -> Vec<Row> {
    let SheetSettings { neighbours, max_radius, scale, .. } = *settings;
    let Bounds { min, max } = photons.extent();
    let limits = Limits::of(max_radius, scale, min.as_vec3(), max.as_vec3());
    let square = |Found { squared, count }: Found, place: Vec3| {
        let growth = OnSurfaces::growth(f64::from(neighbours) / f64::from(count.max(1))) as f32;
        (scale * growth * squared.sqrt()).max(limits.least(place)).min(limits.cap).powi(2)
    };
    let of = |memory: &mut PointMemory, block: usize| {
        let mut squares = Row([0.0; LANES]);
        for (lane, out) in squares.0[..photons_in(block, photons.len())].iter_mut().enumerate() {
            let found = photons.isa.run(Pilot { photons, of: (block, lane), memory });
            *out = square(found, photons.place(block, lane));
        }
        squares
    };
    (0..photons.events.len()).into_par_iter().map_init(PointMemory::default, of).collect()
}

/// The look-up around a photon that tells its radius.
struct Pilot<'a> {
    photons: &'a PointMap,
    of: (usize, usize),
    memory: &'a mut PointMemory,
}

/// What it finds.
struct Found {
    /// The squared distance of the m-th nearest, or the cap.
    squared: f32,
    /// How many photons that are strictly closer are on the same surface.
    count: u32,
}

impl Task for Pilot<'_> {
    type Output = Found;

    #[inline(always)]
    fn run<L: Lanes>(self) -> Found {
        let Pilot { photons, of: (block, lane), memory } = self;
        let (x, own) = (photons.place(block, lane), photons.normals[block][lane]);
        let squared = photons.around::<L>(x, memory);
        let (normal, x) = (own.unpacked(), splat3(x.to_array()));
        let (direction, highest) = (splat3(normal.to_array()), L::splat(FLATTENED * FLATTENED * squared));
        let mut count = 0;
        for &block in memory.blocks() {
            let offset = photons.relative(block as usize, &x);
            let height = dot_plus(&offset, &direction, L::splat(0.0));
            let near = dot_plus(&offset, &offset, L::splat(0.0)).less(L::splat(squared));
            let bits = L::bits(L::and(near, height.mul(height).less_equal(highest)));
            let faces = |lane: &usize| {
                let other = photons.normals[block as usize][*lane];
                bits >> lane & 1 != 0 && (other == own || other.unpacked().dot(normal) >= FACING)
            };
            count += (0..LANES).filter(faces).count() as u32;
        }
        Found { squared, count }
    }
}

/// A look-up as a kernel.
struct LookUp<'a> {
    map: &'a SheetMap,
    x: Vec3,
    memory: &'a mut PointMemory,
}

impl Task for LookUp<'_> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self) {
        let LookUp { map: SheetMap { photons, squares, .. }, x, memory } = self;
        let x = [L::splat(x.x), L::splat(x.y), L::splat(x.z)];
        memory.clear();
        let mut descent = Descent::new(&photons.nodes);
        while let Some((node, hit)) = descent.next::<L>(&Near { x: &x, squared: 0.0 }) {
            for block in blocks_of(&photons.nodes[node].children, hit) {
                memory.push(block, L::bits(photons.squared(block, &x).less(L::load(&squares[block]))));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::random::{Purpose, Stream};
    use crate::math::{DVec3, sampling};
    use crate::photon::PackedNormal;
    use crate::photon::simd::Isa;
    use std::collections::BTreeSet;

    /// On both sides of a square without thickness and on a ball, some close together; by number as power.
    fn photons() -> Vec<Photon> {
        let mut stream = Stream::new(6, Purpose::Test, 0, 0);
        let mut place = |i: usize| {
            let [u, v] = stream.uniform2();
            match i % 4 {
                0 => (0.2 * sampling::sphere([u, v]) + DVec3::Z, sampling::sphere([u, v])),
                1 => (DVec3::new(0.01 * u, 0.01 * v, 0.0), DVec3::Z),
                2 => (DVec3::new(2.0 * u, v, 0.0), DVec3::Z),
                _ => (DVec3::new(2.0 * u, v, 0.0), -DVec3::Z),
            }
        };
        let photon = |i: usize| {
            let (position, normal) = place(i);
            let (position, normal) = (position.as_vec3(), PackedNormal::new(normal));
            Photon { position, direction: Vec3::X, power: Vec3::splat(i as f32), events: 0, normal }
        };
        (0..3001).map(photon).collect()
    }

    const SETTINGS: SheetSettings = SheetSettings { neighbours: 40, pilot: 10, max_radius: 0.15, scale: 0.9 };

    /// Radii as the documentation defines them, from the distances to all photons.
    fn radii(photons: &[Photon]) -> Vec<f32> {
        let SheetSettings { neighbours, pilot, max_radius, scale } = SETTINGS;
        let of = |photon: &Photon| {
            let offset = |other: &Photon| other.position - photon.position;
            let mut all: Vec<f32> = photons.iter().map(|other| offset(other).length()).collect();
            let d = all.select_nth_unstable_by(pilot as usize, f32::total_cmp).1.min(max_radius);
            let normal = photon.normal.unpacked();
            let is_near = |other: &&Photon| {
                offset(other).length() < d
                    && offset(other).dot(normal).abs() <= FLATTENED * d
                    && other.normal.unpacked().dot(normal) >= FACING
            };
            let count = photons.iter().filter(is_near).count();
            scale * (d * (neighbours as f32 / count as f32).sqrt()).min(max_radius)
        };
        photons.iter().map(of).collect()
    }

    #[test]
    fn look_ups_find_the_sheets_that_hold_a_place() {
        let photons = photons();
        let mut map = SheetMap::build(photons.clone(), &SETTINGS);
        let radii = radii(&photons);
        let number = |map: &SheetMap, block: usize, lane: usize| map.photons.loads[block].power[0].0[lane] as usize;
        for index in 0..photons.len() {
            let (block, lane) = (index / LANES, index % LANES);
            let (found, expected) = (map.radius(block, lane), radii[number(&map, block, lane)]);
            assert!((found / expected - 1.0).abs() < 1e-4, "{found}, not {expected}");
        }
        let mut stream = Stream::new(7, Purpose::Test, 0, 0);
        for isa in Isa::available() {
            map.photons.isa = isa;
            let mut memory = PointMemory::default();
            for i in 0..300 {
                let near = 0.02 * sampling::sphere(stream.uniform2()).as_vec3();
                let x = photons[7 * i].position + if i % 2 == 0 { near } else { Vec3::ZERO };
                map.look_up(x, &mut memory);
                let found: Vec<usize> = memory.lanes().map(|(block, lane)| number(&map, block, lane)).collect();
                let set: BTreeSet<usize> = found.iter().copied().collect();
                assert_eq!(set.len(), found.len(), "a photon twice");
                for (index, (photon, radius)) in photons.iter().zip(&radii).enumerate() {
                    let share = photon.position.distance(x) / radius;
                    assert!(
                        (share - 1.0).abs() < 1e-3 || (share < 1.0) == set.contains(&index),
                        "{isa:?} {i}: {share}"
                    );
                }
            }
        }
    }

    #[test]
    fn a_map_is_the_same_for_any_number_of_threads() {
        let on = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let map = pool.install(|| SheetMap::build(photons(), &SETTINGS));
            (map.squares, map.photons.nodes, map.radii)
        };
        assert!(on(1) == on(5));
    }
}
