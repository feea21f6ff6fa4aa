//! The volume photon map: photons in blocks of sixteen, in the order of a median split.

use super::PackedNormal;
use super::kernel::Profile;
use super::radius::{InMedium, Limits, MAX_RADIUS, MIN_RADIUS, Radii, Radius};
use super::simd::{Isa, LANES, Row};
use super::store::{self, Blocks, Kept, Node, Photon, Widths, ordered, photons_in, storable};
use crate::math::{Bounds, Vec3};
use rayon::prelude::*;
use smallvec::SmallVec;

/// What a map stores.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MapSettings {
    /// How wide photons are spread.
    pub radius: Radius,
    /// The kernel.
    pub profile: Profile,
    /// Multiplies every radius, the cap included: progressive passes shrink it.
    pub scale: f32,
    /// Whether photons remember their number of events.
    pub tagged: bool,
    /// Whether photons keep their directions: needless where light is scattered alike in all directions.
    pub directions: bool,
    /// Whether walls near a photon correct its contribution.
    pub boundaries: bool,
    /// Whether photons count in proportion to the density where rays pass them.
    pub fluence: bool,
}

impl MapSettings {
    /// The biweight, untagged, with directions, corrected at walls, radii as they are.
    pub fn new(radius: Radius) -> Self {
        let (profile, scale) = (Profile::Biweight, 1.0);
        MapSettings { radius, profile, scale, tagged: false, directions: true, boundaries: true, fluence: false }
    }
}

/// A photon of a map, and how wide it is spread.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Disc {
    /// The photon; without events if the map is not tagged.
    pub photon: Photon,
    /// Its disc's radius.
    pub radius: f32,
}

/// A wall near a photon, taken as a plane.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Plane {
    /// The unit normal on the photon's side.
    pub normal: Vec3,
    /// The photon's distance, not negative.
    pub distance: f32,
    /// Whether the photon's disc lies along it, not across rays: at most one wall of a photon.
    pub leans: bool,
}

/// At most one wall for each photon of a block; lanes without one have `distance` ∞.
#[derive(Clone, Debug, PartialEq)]
#[repr(C, align(64))]
pub(crate) struct WallLayer {
    pub normal: [Row; 3],
    pub distance: Row,
}

impl WallLayer {
    pub(crate) const EMPTY: WallLayer =
        WallLayer { normal: [Row([0.0; LANES]); 3], distance: Row([f32::INFINITY; LANES]) };
}

/// Walls that a photon may be near: a corner has three.
const WALLS: usize = 3;

/// Blocks that one task handles.
const CHUNK: usize = 256;

/// Chunks whose walls are looked for before those found are put together.
const ROUND: usize = 64;

/// Where boxes bound discs better than spheres: mean radius over the mean longest edge of the box
/// around a block's photons. Measured in `benches/beam/main.rs`.
const BOXES_BELOW: f64 = 0.5;

/// Photons, their discs' radii, and a hierarchy over the discs.
///
/// About 40 bytes a photon, 12 less without directions, 8 less where the power of each is the same in all channels; 4 more if radii vary,
/// one more if tagged, 16 to 48 more for those in blocks near walls. While it is built, as much again as photons take that are not in it yet.
#[derive(Clone, Debug)]
pub struct PhotonMap {
    pub(crate) blocks: Blocks,
    /// Events of the photons, if tagged.
    pub(crate) events: Vec<[u8; LANES]>,
    pub(crate) nodes: Vec<Node>,
    /// For each block where its layers start in `walls`; one more entry than blocks, or none at all
    /// if no photon is near a wall.
    pub(crate) wall_starts: Vec<u32>,
    pub(crate) walls: Vec<WallLayer>,
    /// For each block the photons whose disc lies along the wall of the first layer; empty if there are none.
    pub(crate) leaning: Vec<u16>,
    /// Where light is spread in proportion to the density, as planes over which the mean density is the height: that
    /// around the photon, and how it changes from there. Empty where light is spread evenly.
    pub(crate) densities: Vec<WallLayer>,
    /// Whether walks test boxes rather than spheres.
    pub(crate) boxes: bool,
    /// Whether photons count in proportion to the density where rays pass them.
    pub(crate) fluence: bool,
    pub(crate) isa: Isa,
    pub(crate) profile: Profile,
    /// [`Profile::polynomial`].
    pub(crate) shape: [f32; 3],
    photons: usize,
    rejected: usize,
    radii: Radii,
    bounds: Bounds,
}

impl PhotonMap {
    /// A photon is spread over a disc.
    pub const DIMENSION: u32 = 2;

    /// Orders `photons`, finds their radii, and builds the hierarchy; in parallel, on the current
    /// thread pool, with the same result for any number of threads.
    ///
    /// `planes` is asked for the walls near a photon, once radii are known: its position, its radius and the mean radius
    /// of all. A wall matters if it is closer than *twice* the photon's radius, because the disc is drawn around a foot
    /// point that may be a radius away, or if the disc leans on it. That one and the nearest others count, three in all.
    ///
    /// *Variable radii:* among fewer than m + 1 photons the farthest stands for the m-th neighbour,
    /// with its own count; a single photon gets `max_radius`. Photons at one place get the smallest
    /// radius: a millionth of `max_radius` or of the photons' extent, or four roundings of their largest coordinate.
    ///
    /// Photons that are not finite, and those beyond 2³² − 1, are left out and counted.
    pub fn build(
        photons: Vec<Photon>,
        settings: &MapSettings,
        planes: &(impl Fn(Vec3, f32, f32, &mut SmallVec<[Plane; 3]>) + Sync),
    ) -> PhotonMap {
        let given = photons.len();
        let photons = storable(photons);
        let count = photons.len();
        let isa = Isa::best();
        let peak = settings.profile.disc_peak() as f32;
        let photons = ordered(photons);
        let kept = |inverse_square, gain| {
            let MapSettings { directions, tagged, .. } = *settings;
            Kept { inverse_square, gain, directions, tagged }
        };
        let own;
        let (blocks, events, radii) = match settings.radius {
            Radius::Fixed(radius) => {
                let r = (radius * settings.scale).clamp(MIN_RADIUS, MAX_RADIUS);
                let square = 1.0 / (r * r);
                let (blocks, events) = Blocks::new(photons, &kept(Some(square), peak * square));
                (blocks, events, Widths::Same(r))
            }
            Radius::Variable { neighbours, pilot, max_radius } => {
                let (mut blocks, events) = Blocks::new(photons, &kept(None, 1.0));
                own = radii_of(isa, &blocks, count, (neighbours, pilot), (max_radius, settings.scale));
                blocks.spread(count, &own, peak);
                (blocks, events, Widths::Own(&own))
            }
        };
        let (nodes, extent) = store::build(&blocks, count, radii);
        let summary = match radii {
            Widths::Same(r) if count > 0 => Radii { min: r, mean: r, max: r },
            Widths::Same(_) => Radii::default(),
            Widths::Own(radii) => Radii::of(&radii[..count]),
        };
        let (wall_starts, walls, leaning) = if settings.boundaries {
            walls_of(&blocks, count, radii, &|position, radius, found: &mut _| {
                planes(position, radius, summary.mean, found);
            })
        } else {
            Default::default()
        };
        let size = extent.block_sizes / blocks.len().max(1) as f64;
        PhotonMap {
            boxes: f64::from(summary.mean) < BOXES_BELOW * size,
            fluence: settings.fluence,
            isa,
            profile: settings.profile,
            shape: settings.profile.polynomial(),
            photons: count,
            rejected: given - count,
            radii: summary,
            bounds: Bounds { min: extent.min.as_dvec3(), max: extent.max.as_dvec3() },
            blocks,
            events,
            nodes,
            wall_starts,
            walls,
            leaning,
            densities: Vec::new(),
        }
    }

    /// How many photons it holds.
    pub fn len(&self) -> usize {
        self.photons
    }

    /// Whether it holds none.
    pub fn is_empty(&self) -> bool {
        self.photons == 0
    }

    /// The photons, in the order of the hierarchy, to roundings; their directions are zero where they are not kept.
    pub fn discs(&self) -> impl Iterator<Item = Disc> + '_ {
        (0..self.photons).map(|index| {
            let (block, lane) = (self.blocks.get(index / LANES), index % LANES);
            let of = |rows: [&Row; 3]| Vec3::from(rows.map(|row| row.0[lane]));
            let inverse_square = block.inverse_square.0[lane];
            let photon = Photon {
                position: of(block.position.each_ref()),
                direction: block.direction.map_or(Vec3::ZERO, |rows| of(rows.each_ref())),
                power: of(block.power) / (self.profile.disc_peak() as f32 * inverse_square),
                events: self.events.get(index / LANES).map_or(0, |events| events[lane]),
                normal: PackedNormal::default(),
            };
            Disc { photon, radius: inverse_square.sqrt().recip() }
        })
    }

    /// How many photons were left out because a number was not finite.
    pub fn rejected(&self) -> usize {
        self.rejected
    }

    /// Memory taken, in bytes.
    pub fn bytes(&self) -> usize {
        self.blocks.bytes()
            + size_of_val(&*self.events)
            + size_of_val(&*self.nodes)
            + self.wall_bytes()
            + size_of_val(&*self.densities)
    }

    /// What of it walls near photons take, in bytes.
    pub fn wall_bytes(&self) -> usize {
        size_of_val(&*self.wall_starts) + size_of_val(&*self.walls) + size_of_val(&*self.leaning)
    }

    /// Whether it keeps photons' directions.
    pub fn has_directions(&self) -> bool {
        self.blocks.has_directions()
    }

    /// Whether the power of each photon is the same in all channels, and kept once.
    pub fn is_grey(&self) -> bool {
        self.blocks.is_grey()
    }

    /// Whether some discs lie along walls.
    pub fn leans(&self) -> bool {
        !self.leaning.is_empty()
    }

    /// The discs' radii.
    pub fn radii(&self) -> Radii {
        self.radii
    }

    /// A box around all discs: a ray that misses it gathers nothing. Empty for an empty map.
    pub fn bounds(&self) -> Bounds {
        self.bounds
    }

    /// The layers of walls near block `index`.
    #[inline(always)]
    pub(crate) fn walls(&self, index: usize) -> &[WallLayer] {
        if self.wall_starts.is_empty() {
            return &[];
        }
        &self.walls[self.wall_starts[index] as usize..self.wall_starts[index + 1] as usize]
    }
}

/// The radius of every disc, sixteen a block.
fn radii_of(
    isa: Isa,
    blocks: &Blocks,
    photons: usize,
    (neighbours, pilot): (u32, u32),
    (max_radius, scale): (f32, f32),
) -> Vec<f32> {
    let (nodes, extent) = store::build(blocks, photons, Widths::Same(0.0));
    let limits = Limits::of(max_radius, scale, extent.min, extent.max);
    if photons <= 1 {
        return vec![limits.cap; blocks.len() * LANES];
    }
    let m = (pilot.max(1) as usize).min(photons - 1);
    let growth = scale * InMedium::growth(f64::from(neighbours.max(1)) / m as f64) as f32;
    let mut radii = store::nearest(isa, blocks, photons, &nodes, m);
    radii.par_iter_mut().enumerate().for_each(|(index, r)| {
        let rows = blocks.get(index / LANES).position;
        let place = Vec3::from(rows.each_ref().map(|row| row.0[index % LANES]));
        *r = (growth * r.sqrt()).max(limits.least(place)).min(limits.cap);
    });
    radii
}

/// Where each block's layers of walls start, the layers, and which photons lean on the first; nothing if there are no
/// walls, or none that lean.
fn walls_of(
    blocks: &Blocks,
    photons: usize,
    radii: Widths,
    planes: &(impl Fn(Vec3, f32, &mut SmallVec<[Plane; 3]>) + Sync),
) -> (Vec<u32>, Vec<WallLayer>, Vec<u16>) {
    let of_chunk = |first: usize| {
        let chunk = first..(first + CHUNK).min(blocks.len());
        let mut counts = Vec::with_capacity(chunk.len());
        let mut walls: Vec<WallLayer> = Vec::new();
        let mut leaning = vec![0u16; chunk.len()];
        let mut found = SmallVec::new();
        for (index, leaning) in chunk.zip(&mut leaning) {
            let (block, first) = (blocks.get(index), walls.len());
            for lane in 0..photons_in(index, photons) {
                let position = Vec3::from(block.position.each_ref().map(|row| row.0[lane]));
                let radius = radii.of(index * LANES + lane);
                found.clear();
                planes(position, radius, &mut found);
                found.retain(|plane| plane.leans || plane.distance < 2.0 * radius);
                found.sort_by(|a: &Plane, b: &Plane| b.leans.cmp(&a.leans).then(a.distance.total_cmp(&b.distance)));
                *leaning |= u16::from(found.first().is_some_and(|plane| plane.leans)) << lane;
                for (layer, plane) in found.iter().take(WALLS).enumerate() {
                    if first + layer == walls.len() {
                        walls.push(WallLayer::EMPTY);
                    }
                    let wall = &mut walls[first + layer];
                    wall.distance.0[lane] = plane.distance;
                    for axis in 0..3 {
                        wall.normal[axis].0[lane] = plane.normal[axis];
                    }
                }
            }
            counts.push((walls.len() - first) as u32);
        }
        (counts, walls, leaning)
    };

    let mut starts = Vec::with_capacity(blocks.len() + 1);
    let mut walls = Vec::new();
    let mut all_leaning = Vec::with_capacity(blocks.len());
    let mut start = 0;
    starts.push(start);
    // A few at a time: what is found need not be held twice.
    for round in (0..blocks.len()).step_by(ROUND * CHUNK) {
        let firsts = round..(round + ROUND * CHUNK).min(blocks.len());
        let parts: Vec<(Vec<u32>, Vec<WallLayer>, Vec<u16>)> =
            firsts.into_par_iter().step_by(CHUNK).map(of_chunk).collect();
        for (counts, part, leaning) in parts {
            for count in counts {
                start += count;
                starts.push(start);
            }
            walls.extend(part);
            all_leaning.extend(leaning);
        }
    }
    if walls.is_empty() {
        return Default::default();
    }
    walls.shrink_to_fit();
    if all_leaning.iter().all(|bits| *bits == 0) {
        all_leaning = Vec::new();
    }
    (starts, walls, all_leaning)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::random::{Purpose, Stream};

    /// `count` photons, a third of them close to one place and some at exactly one place.
    fn uneven(count: usize) -> Vec<Photon> {
        let mut stream = Stream::new(5, Purpose::Test, count as u64, 0);
        (0..count)
            .map(|i| {
                let x = Vec3::from_array([0; 3].map(|_| stream.uniform() as f32));
                Photon {
                    position: match i % 12 {
                        0 => Vec3::splat(0.25),
                        1..4 => 0.7 + 0.01 * x,
                        _ => x * Vec3::new(3.0, 1.0, 2.0),
                    },
                    direction: Vec3::Z,
                    power: Vec3::ONE,
                    events: (i % 7) as u8,
                    normal: Default::default(),
                }
            })
            .collect()
    }

    fn no_walls(_: Vec3, _: f32, _: f32, _: &mut SmallVec<[Plane; 3]>) {}

    #[test]
    fn nearest_distances_equal_those_of_a_search_through_all() {
        let kept = Kept { inverse_square: None, gain: 1.0, directions: false, tagged: false };
        for (count, m) in [(2, 1), (3, 2), (16, 5), (17, 16), (40, 23), (500, 1), (3000, 23), (3000, 700)] {
            let (blocks, _) = Blocks::new(ordered(uneven(count)), &kept);
            let (nodes, _) = store::build(&blocks, count, Widths::Same(0.0));
            let at = |i: usize| blocks.get(i / LANES).position.each_ref().map(|row| f64::from(row.0[i % LANES]));
            let all: Vec<[f64; 3]> = (0..count).map(at).collect();
            for isa in Isa::available() {
                let squared = store::nearest(isa, &blocks, count, &nodes, m);
                for i in (0..count).step_by(1 + count / 300) {
                    let to = |x: &[f64; 3]| (0..3).map(|k| (x[k] - all[i][k]).powi(2)).sum::<f64>();
                    let mut distances: Vec<f64> = all.iter().map(to).collect();
                    distances.sort_by(f64::total_cmp);
                    let (got, expected) = (f64::from(squared[i]), distances[m]);
                    assert!((got - expected).abs() <= 1e-6 * expected, "{isa:?} {count} {m}: {got} {expected}");
                }
            }
        }
    }

    #[test]
    fn radii_follow_the_neighbours_between_their_bounds() {
        let variable = |neighbours, pilot, max_radius| Radius::Variable { neighbours, pilot, max_radius };
        let build = |count, radius| PhotonMap::build(uneven(count), &MapSettings::new(radius), &no_walls).radii();
        // Two photons, their distance d, n = 8: r = 2d.
        let pair = uneven(2);
        let d = pair[0].position.distance(pair[1].position);
        let radii = build(2, variable(8, 23, 100.0));
        assert!((radii.min - 2.0 * d).abs() < 1e-6 * d && radii.min == radii.max, "{radii:?} {d}");
        // One photon, and none.
        assert_eq!(build(1, variable(500, 23, 0.3)), Radii { min: 0.3, mean: 0.3, max: 0.3 });
        assert_eq!(build(0, variable(500, 23, 0.3)), Radii::default());
        // Some at one place, others too far apart.
        let radii = build(3000, variable(500, 23, 0.3));
        assert!(radii.min >= 0.3e-6 && radii.min < 1e-5 && radii.max == 0.3, "{radii:?}");
        // Everything scales, the cap included.
        let half = MapSettings { scale: 0.5, ..MapSettings::new(variable(500, 23, 0.3)) };
        let halved = PhotonMap::build(uneven(3000), &half, &no_walls).radii();
        assert!((halved.mean - 0.5 * radii.mean).abs() < 1e-6 && halved.max == 0.15, "{halved:?}");
    }

    #[test]
    fn a_map_is_the_same_for_any_number_of_threads() {
        let settings = MapSettings {
            tagged: true,
            ..MapSettings::new(Radius::Variable { neighbours: 50, pilot: 8, max_radius: 0.2 })
        };
        let floor = |x: Vec3, r: f32, _: f32, planes: &mut SmallVec<[Plane; 3]>| {
            if x.z < 2.0 * r {
                planes.push(Plane { normal: Vec3::Z, distance: x.z, leans: false });
            }
        };
        let build = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| PhotonMap::build(uneven(30_000), &settings, &floor))
        };
        let one = build(1);
        assert!(!one.walls.is_empty());
        for threads in [2, 5] {
            let other = build(threads);
            assert!(one.blocks == other.blocks && one.nodes == other.nodes && one.events == other.events);
            assert!(one.walls == other.walls && one.wall_starts == other.wall_starts && one.radii == other.radii);
        }
    }

    #[test]
    fn a_photon_takes_at_most_64_bytes() {
        for count in [1000, 20_000, 65_536] {
            let settings = MapSettings { tagged: true, ..MapSettings::new(Radius::Fixed(0.1)) };
            let map = PhotonMap::build(uneven(count), &settings, &no_walls);
            assert!(map.bytes() <= 64 * count, "{} bytes for {count}", map.bytes());
        }
    }

    #[test]
    fn photons_that_are_not_finite_are_left_out_and_counted() {
        let mut photons = uneven(100);
        photons[7].position.y = f32::NAN;
        photons[8].power.x = f32::INFINITY;
        let map = PhotonMap::build(photons, &MapSettings::new(Radius::Fixed(0.1)), &no_walls);
        assert_eq!((map.len(), map.rejected()), (98, 2));
    }
}
