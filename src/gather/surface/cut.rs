//! What cuts the discs around places on surfaces: walls and edges.

use std::f64::consts::TAU;

use crate::math::{DVec3, Frame, Ray, Vec3};
use crate::photon::Kind;
use crate::photon::sheets::{FACING, FLATTENED};
use crate::scene::description::SurfaceFilter;
use crate::scene::{Finish, Scene, Surface};
use crate::surface::TexturePoint;
use crate::surface::{Material, Nature};

/// Sectors of a disc that is cut, a way along the middle of each: as far as those of a sector and of its neighbours are free, its photons need not
/// be looked at one by one.
const SECTORS: usize = 24;
/// Tangents of the angles between the sectors' edges in a quadrant and its axis: 7.5°, 22.5° and so on.
const EDGES: [f64; SECTORS / 4] = [
    0.131_652_497_587_396,
    0.414_213_562_373_095,
    0.767_326_987_978_960,
    1.303_225_372_841_206,
    2.414_213_562_373_095,
    7.595_754_112_725_15,
];
/// cos and sin of the angle between ways.
const NEXT_WAY: (f64, f64) = (0.965_925_826_289_068, 0.258_819_045_102_521);
/// cos and sin of the angle between the probes of a spiral, the golden one.
const NEXT_PROBE: (f64, f64) = (-0.737_368_878_078_320, -0.675_490_294_261_524);
/// A wall between two ways may be nearer than both: a plane at their middle, by one in a hundred.
const BETWEEN: f64 = 0.98;
/// A surface is a wall to a place whose normal it has at most this cosine to.
const SLOPE: f64 = 0.3;
/// Probes that tell what share of a disc photons can land on.
const PROBES: u32 = 24;
/// Where it is covered here and there, as on relief, it takes so many, or the light of half of it would be 5 % too bright:
const PROBES_ON_RELIEF: u32 = 72;
/// where the share's square has a variance of more than this share of it, by what the probes say.
const UNEVEN: f64 = 0.002;
/// Probes around places that tell whether their discs are cut at all.
const RIM: u32 = 8;
/// No disc is taken to be cut to less than this share.
const LEAST_SHARE: f64 = 0.05;
/// Ways that tell whether photons are of joined surfaces lead so many times as high as discs are: above all of their photons.
const ABOVE: f64 = 1.25;
/// Whoever looks at a place from no farther than so many radii may be enclosed with it by something smaller than its disc.
pub(super) const CLOSE: f64 = 2.0;
/// A surface is met again on the way to a place on it within this share of the height that is come from.
const SAME: f64 = 0.02;

/// Which sectors of a disc are free throughout, by bits.
pub(super) type Free = u32;
/// All are.
pub(super) const ALL_FREE: Free = (1 << SECTORS) - 1;

/// A place on a surface, and its unit normal on the side that is looked at.
#[derive(Clone, Copy, Debug)]
pub struct Place {
    /// The point.
    pub point: DVec3,
    /// The geometric normal.
    pub normal: DVec3,
}

/// The part of the disc around a place that photons can land on: as far as a way just above the tangent plane is free of walls.
pub(super) struct Disc {
    /// Its x axis is the first sector's middle.
    frame: Frame,
    radius: f64,
    /// How high above the place its ways lead.
    height: f64,
    /// Whether slopes are walls, too.
    slopes: bool,
}

/// How far ways along the middles of a disc's sectors are free, at most as far as its rim.
pub(super) struct Ways {
    free: [f64; SECTORS],
    /// The squares of how far sectors are clear of walls, infinite where they are throughout.
    clear: [f64; SECTORS],
    radius: f64,
}

impl Ways {
    fn new(free: [f64; SECTORS], radius: f64) -> Ways {
        // By the way of a sector and those of its neighbours.
        let clear = std::array::from_fn(|sector| {
            let [before, after] = [SECTORS - 1, 1].map(|aside| free[(sector + aside) % SECTORS]);
            let clear = free[sector].min(before).min(after);
            if clear >= radius { f64::INFINITY } else { (BETWEEN * clear).powi(2) }
        });
        Ways { free, clear, radius }
    }

    /// Those of a disc without walls.
    pub(super) fn all_free(radius: f64) -> Ways {
        Ways { free: [radius; SECTORS], clear: [f64::INFINITY; SECTORS], radius }
    }

    /// Which sectors are free throughout.
    pub(super) fn free(&self) -> Free {
        (0..SECTORS).fold(0, |free, sector| free | Free::from(self.clear[sector].is_infinite()) << sector)
    }

    /// The share of the disc, weighted by a filter, that is free: its integral over what each way crosses, the mean over the ways.
    pub(super) fn share(&self, filter: SurfaceFilter) -> f64 {
        let within = |free: f64| filter.within((free / self.radius).powi(2));
        (self.free.iter().map(|&free| within(free)).sum::<f64>() / SECTORS as f64).max(LEAST_SHARE)
    }
}

impl Disc {
    /// The disc of a place; `turn`, in turns, only turns the pattern of probes.
    pub(super) fn new(place: Place, radius: f64, turn: f64) -> Disc {
        let Frame { x, y, z } = Frame::around(place.normal);
        let (sin, cos) = (TAU * turn).sin_cos();
        let frame = Frame { x: cos * x + sin * y, y: cos * y - sin * x, z };
        Disc { frame, radius, height: f64::from(FLATTENED) * radius, slopes: false }
    }

    /// Looks for walls around.
    pub(super) fn ways(&self, scene: &Scene, place: Place) -> Ways {
        let mut turned = (1.0, 0.0);
        let free = std::array::from_fn(|_| {
            let direction = turned.0 * self.frame.x + turned.1 * self.frame.y;
            turned = rotated(turned, NEXT_WAY);
            free_until(scene, place, direction, self.radius, self.height)
        });
        Ways::new(free, self.radius)
    }

    /// One of which photons are to be [joined](Disc::is_joined) to its place, be they ever so near.
    pub(super) fn of_one_surface(scene: &Scene, place: Place, radius: f64) -> Disc {
        let disc = Disc::new(place, radius, 0.0);
        Disc { height: headroom(scene, place, ABOVE * disc.height), slopes: true, ..disc }
    }

    /// An offset from the place along the disc.
    fn along(&self, offset: DVec3) -> [f64; 2] {
        [offset.dot(self.frame.x), offset.dot(self.frame.y)]
    }

    /// The sector in which an offset lies.
    pub(super) fn sector(&self, offset: DVec3) -> usize {
        let [x, y] = self.along(offset);
        let quadrant = EDGES.iter().map(|tangent| usize::from(y.abs() > tangent * x.abs())).sum();
        let half: usize = if x < 0.0 { SECTORS / 2 - quadrant } else { quadrant };
        if y < 0.0 { (SECTORS - half) % SECTORS } else { half }
    }

    /// Whether photons so far aside are on it, by its ways as far as they tell.
    pub(super) fn reaches(&self, scene: &Scene, place: Place, ways: &Ways, offset: DVec3) -> bool {
        offset.length_squared() < ways.clear[self.sector(offset)] || self.leads_to(scene, place, offset)
    }

    /// Whether the way to photons so far aside is free.
    pub(super) fn leads_to(&self, scene: &Scene, place: Place, offset: DVec3) -> bool {
        let [x, y] = self.along(offset);
        let aside = x * self.frame.x + y * self.frame.y;
        if self.slopes {
            is_open(scene, place.point + self.height * place.normal, aside)
        } else {
            is_free(scene, place, aside, self.height)
        }
    }

    /// Whether a photon so far from the place landed on the same surface, or one joined to that: no wall is on the way up from the place, along
    /// its tangent plane and down to the photon. To one that faces the same way no way leads from below.
    pub(super) fn is_joined(&self, scene: &Scene, place: Place, offset: DVec3) -> bool {
        let down = self.height - offset.dot(place.normal);
        let from = place.point + offset + down * place.normal;
        // Down to the surface of the photon itself.
        let way = down - SAME * self.height;
        down > 0.0 && self.leads_to(scene, place, offset) && is_open(scene, from, -way.max(0.0) * place.normal)
    }

    /// Its share of the whole disc, weighted by a filter: without what is not free, and where no surface that faces the same way lies
    /// below. (Jensen 2001, §7.4, takes the convex hull of the photons for it.)
    pub(super) fn share(
        &self,
        scene: &Scene,
        place: Place,
        ways: Option<&Ways>,
        (filter, kind): (SurfaceFilter, Kind),
    ) -> f64 {
        let reaches = |aside: DVec3| match ways {
            Some(ways) => self.reaches(scene, place, ways, aside),
            None => self.leads_to(scene, place, aside),
        };
        let share_of = |probes: u32| {
            let (mut covered, mut all, mut turned) = ([0.0; 2], [0.0; 2], (1.0, 0.0));
            for probe in 0..probes {
                // Vogel's spiral: as many on equal areas.
                let squared = (f64::from(probe) + 0.5) / f64::from(probes);
                let weight = f64::from(filter.weight(squared as f32));
                let half = probe as usize % 2;
                all[half] += weight;
                let aside = self.radius * squared.sqrt() * (turned.0 * self.frame.x + turned.1 * self.frame.y);
                turned = rotated(turned, NEXT_PROBE);
                if reaches(aside) {
                    covered[half] += weight * landing(scene, place, aside, self.height, kind);
                }
            }
            let share = ((covered[0] + covered[1]) / (all[0] + all[1])).max(LEAST_SHARE);
            // What is divided by a share s of variance v is too large by v/s² on average. Halves tell v, if they are drawn by chance; those of a
            // spiral are about twice as unlike.
            let unlike = 0.5 * (covered[0] / all[0] - covered[1] / all[1]) / share;
            (share, 0.5 * unlike * unlike)
        };
        let mut found = share_of(PROBES);
        if found.1 > UNEVEN {
            found = share_of(PROBES_ON_RELIEF);
        }
        let (share, excess) = found;
        (share * (1.0 + excess)).min(1.0)
    }
}

/// A vector of the plane, turned by the angle of another of length 1.
fn rotated((x, y): (f64, f64), (cos, sin): (f64, f64)) -> (f64, f64) {
    (cos * x - sin * y, sin * x + cos * y)
}

/// What cuts discs.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Cutting {
    /// Walls that stand on them.
    pub(super) walls: bool,
    /// Places where no photon can land.
    pub(super) edges: bool,
}

impl Cutting {
    /// Whether anything does.
    pub(super) fn any(self) -> bool {
        self.walls || self.edges
    }

    /// All that cuts either of two.
    pub(super) fn or(self, other: Cutting) -> Cutting {
        Cutting { walls: self.walls || other.walls, edges: self.edges || other.edges }
    }
}

/// What may cut discs of up to this radius around a place, by what probes on the rim say.
pub(super) fn cutting(scene: &Scene, place: Place, radius: f64, kind: Kind) -> Cutting {
    let (frame, height) = (Frame::around(place.normal), f64::from(FLATTENED) * radius);
    let mut cutting = Cutting::default();
    for probe in 0..RIM {
        let (sin, cos) = (TAU * f64::from(probe) / f64::from(RIM)).sin_cos();
        let aside = radius * (cos * frame.x + sin * frame.y);
        let is_free = is_free(scene, place, aside, height);
        cutting.walls |= !is_free;
        cutting.edges |= is_free && landing(scene, place, aside, height, kind) < 1.0;
    }
    cutting
}

/// How far a photon is from where a surface through a place would lie if it were as curved as the normals at both say: nothing on spheres and
/// planes, and how far apart they are for two planes that face the same way.
pub(super) fn stray(offset: Vec3, normals: [Vec3; 2]) -> f32 {
    (0.5 * offset.dot(normals[0] + normals[1])).abs()
}

/// How high above a place ways may lead: as high as is asked for, or half as high as the lowest wall above it.
fn headroom(scene: &Scene, place: Place, height: f64) -> f64 {
    let mut lowest = 2.0 * height;
    let up = Ray::new(place.point, place.normal);
    scene.geometry.all_hits(&up, SAME * height, height, |hit| {
        if scene.surfaces[hit.id as usize].material.is_wall() {
            lowest = lowest.min(hit.t);
        }
    });
    (0.5 * lowest).min(height)
}

/// Whether no wall lies on a way.
fn is_open(scene: &Scene, from: DVec3, way: DVec3) -> bool {
    let is_wall = |shape: u32| scene.surfaces[shape as usize].material.is_wall();
    way.try_normalize()
        .is_none_or(|direction| !scene.geometry.occluded(&Ray::new(from, direction), 0.0, way.length(), is_wall))
}

/// Whether light of one place may be that of the other, `aside` of it: no wall is between.
pub fn are_one(scene: &Scene, place: Place, aside: DVec3) -> bool {
    is_free(scene, place, aside, f64::from(FLATTENED) * aside.length())
}

/// Whether the way `aside` from a place, `height` above it, is free of walls.
fn is_free(scene: &Scene, place: Place, aside: DVec3, height: f64) -> bool {
    let length = aside.length();
    aside.try_normalize().is_none_or(|direction| free_until(scene, place, direction, length, height) >= length)
}

/// How far a way from a place is free of walls, up to a length, along its tangent plane and `height` above it. Slopes are none: they are of the
/// same surface.
fn free_until(scene: &Scene, place: Place, direction: DVec3, length: f64, height: f64) -> f64 {
    let ray = Ray::new(place.point + height * place.normal, direction);
    scene.geometry.nearest_where(&ray, 0.0, length, |hit| {
        let facing = if hit.normal.dot(direction) > 0.0 { -hit.normal } else { hit.normal };
        facing.dot(place.normal) < SLOPE && scene.surfaces[hit.id as usize].material.is_wall()
    })
}

/// The share of photons that are stored of those which arrive `aside` of a place, no more than `height` off its tangent plane and on a
/// surface that faces the same way: of mixtures, what meets a part that spreads light.
fn landing(scene: &Scene, place: Place, aside: DVec3, height: f64, kind: Kind) -> f64 {
    let ray = Ray::new(place.point + aside + height * place.normal, -place.normal);
    let mut stored = 0f64;
    scene.geometry.all_hits(&ray, 0.0, 2.0 * height, |hit| {
        let Surface { material, paint, caustics, .. } = scene.surfaces[hit.id as usize];
        let receives = kind == Kind::Global || caustics.receives;
        if receives && hit.normal.dot(place.normal).abs() >= f64::from(FACING) {
            let object = scene.geometry.object_point(&ray, &hit);
            let at = TexturePoint { uv: hit.uv, object, footprint: 0.0 };
            // Textures may decide how a surface spreads light.
            let stores = |finish: &Finish| {
                let Material::Opaque(mut bsdf) = finish.material else { return false };
                if let Some(paint) = finish.paint {
                    scene.paints[paint as usize].put_on(&mut bsdf, &at);
                }
                bsdf.nature() == Nature::Diffuse
            };
            stored = stored.max(scene.share(&Finish { material, paint }, &at, &stores));
        }
    });
    stored
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::Stream;
    use crate::math::random::Purpose;
    use crate::scene;

    /// A wall cuts a segment off a disc, whose share is known; photons before it are on the disc, and those behind it are not, be they found by
    /// sectors or by ways of their own.
    #[test]
    fn walls_cut_segments_off() {
        for distance in [0.1, 0.35, 0.8] {
            let (scene, _) = scene::from_text(&format!(
                "[camera]\nposition = [0, 0, 3]\ntarget = [0, 0, 0]\n\
                 [materials.white]\ntype = \"lambert\"\nreflectance = 0.5\n\
                 [[shapes]]\ntype = \"quad\"\norigin = [-3, -3, 0]\nedge_u = [6, 0, 0]\nedge_v = [0, 6, 0]\nmaterial = \"white\"\n\
                 [[shapes]]\ntype = \"quad\"\norigin = [{distance}, -3, 0]\nedge_u = [0, 6, 0]\nedge_v = [0, 0, 1]\nmaterial = \"white\"\n",
            ));
            let place = Place { point: -scene.center, normal: DVec3::Z };
            let mut stream = Stream::new(3, Purpose::Test, 0, 0);
            let angle = f64::acos(distance);
            let expected = 1.0 - (angle - angle.sin() * angle.cos()) / (0.5 * TAU);
            let mut mean = 0.0;
            const TURNS: usize = 32;
            for _ in 0..TURNS {
                let disc = Disc::new(place, 1.0, stream.uniform());
                let ways = disc.ways(&scene, place);
                let share = ways.share(SurfaceFilter::None);
                assert!((share - expected).abs() < 0.01, "{share}, not {expected} at {distance}");
                mean += share / TURNS as f64;
                for _ in 0..100 {
                    let [u, v] = stream.uniform2().map(|u| 1.4 * u - 0.7);
                    let (offset, before) = (DVec3::new(u, v, 0.0), u < distance);
                    assert_eq!(disc.reaches(&scene, place, &ways, offset), before, "{offset} at {distance}");
                    assert!(ways.free() >> disc.sector(offset) & 1 == 0 || before, "{offset} at {distance}");
                }
            }
            assert!((mean - expected).abs() < 0.001, "{mean}, not {expected} at {distance}");
        }
    }
}
