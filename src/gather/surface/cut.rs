//! What cuts the discs around places on surfaces: walls and edges.

use std::f64::consts::TAU;

use crate::math::{DVec3, Frame, Ray, Vec3};
use crate::photon::Kind;
use crate::photon::sheets::{FACING, FLATTENED};
use crate::scene::description::SurfaceFilter;
use crate::scene::{Finish, Scene, Surface};
use crate::surface::TexturePoint;
use crate::surface::{Material, Nature};

/// Sectors of a disc that is cut: where they are free, its photons need not be looked at one by one.
const SECTORS: u32 = 24;
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
    frame: Frame,
    radius: f64,
    /// How high above the place its ways lead.
    height: f64,
    /// Where the first sector's middle is, in turns.
    turn: f64,
    /// By the ways along the sectors' middles and those of their neighbours.
    free: Free,
    /// Whether slopes are walls, too.
    slopes: bool,
}

impl Disc {
    /// Looks for walls around a place; `turn` only turns the pattern of probes.
    pub(super) fn new(scene: &Scene, place: Place, radius: f64, turn: f64) -> Disc {
        let mut disc = Disc::known(place, radius, turn, 0);
        let height = disc.height;
        let middle = |sector: u32| on_rim(&disc.frame, radius, turn + f64::from(sector) / f64::from(SECTORS));
        let along: [bool; SECTORS as usize] =
            std::array::from_fn(|sector| is_free(scene, place, middle(sector as u32), height));
        let are_free =
            |sector: usize| [0, 1, along.len() - 1].iter().all(|aside| along[(sector + aside) % along.len()]);
        disc.free = (0..along.len()).fold(0, |free, sector| free | Free::from(are_free(sector)) << sector);
        disc
    }

    /// One of which it is known where it is free.
    pub(super) fn known(place: Place, radius: f64, turn: f64, free: Free) -> Disc {
        let height = f64::from(FLATTENED) * radius;
        Disc { frame: Frame::around(place.normal), radius, height, turn, free, slopes: false }
    }

    /// One of which photons are to be [joined](Disc::is_joined) to its place, be they ever so near.
    pub(super) fn of_one_surface(scene: &Scene, place: Place, radius: f64) -> Disc {
        let disc = Disc::known(place, radius, 0.0, 0);
        Disc { height: headroom(scene, place, ABOVE * disc.height), slopes: true, ..disc }
    }

    /// Which of its sectors are free.
    pub(super) fn free(&self) -> Free {
        self.free
    }

    /// Whether photons so far aside are on it.
    pub(super) fn reaches(&self, scene: &Scene, place: Place, offset: DVec3) -> bool {
        let (x, y) = (offset.dot(self.frame.x), offset.dot(self.frame.y));
        let aside = x * self.frame.x + y * self.frame.y;
        if self.slopes {
            return is_open(scene, place.point + self.height * place.normal, aside);
        }
        let turns = (y.atan2(x) / TAU - self.turn).rem_euclid(1.0);
        self.free >> ((turns * f64::from(SECTORS) + 0.5) as u32 % SECTORS) & 1 != 0
            || is_free(scene, place, aside, self.height)
    }

    /// Whether a photon so far from the place landed on the same surface, or one joined to that: no wall is on the way up from the place, along
    /// its tangent plane and down to the photon. To one that faces the same way no way leads from below.
    pub(super) fn is_joined(&self, scene: &Scene, place: Place, offset: DVec3) -> bool {
        let down = self.height - offset.dot(place.normal);
        let from = place.point + offset + down * place.normal;
        // Down to the surface of the photon itself.
        let way = down - SAME * self.height;
        down > 0.0 && self.reaches(scene, place, offset) && is_open(scene, from, -way.max(0.0) * place.normal)
    }

    /// Its share of the whole disc, weighted by a filter: without what is not free, and where no surface that faces the same way lies
    /// below, unless there are no `edges`. (Jensen 2001, §7.4, takes the convex hull of the photons for it.)
    pub(super) fn share(&self, scene: &Scene, place: Place, (filter, kind): (SurfaceFilter, Kind), edges: bool) -> f64 {
        let height = self.height;
        let share_of = |probes: u32| {
            let (mut covered, mut all) = ([0.0; 2], [0.0; 2]);
            for probe in 0..probes {
                // Vogel's spiral: as many on equal areas.
                let squared = (f64::from(probe) + 0.5) / f64::from(probes);
                let (sin, cos) = (TAU * (self.turn + f64::from(probe) * 0.618_033_988_749_895)).sin_cos();
                let weight = f64::from(filter.weight(squared as f32));
                let half = probe as usize % 2;
                all[half] += weight;
                let aside = self.radius * squared.sqrt() * (cos * self.frame.x + sin * self.frame.y);
                if self.reaches(scene, place, aside) {
                    covered[half] += weight * if edges { landing(scene, place, aside, height, kind) } else { 1.0 };
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

/// A vector of this length in the plane of a frame, turned by a share of a full turn.
fn on_rim(frame: &Frame, radius: f64, turn: f64) -> DVec3 {
    let (sin, cos) = (TAU * turn).sin_cos();
    radius * (cos * frame.x + sin * frame.y)
}

/// What cuts discs.
#[derive(Clone, Copy, Debug)]
pub(super) struct Cutting {
    /// Walls that stand on them.
    pub(super) walls: bool,
    /// Places where no photon can land.
    pub(super) edges: bool,
}

/// What may cut discs of up to this radius around a place, by what probes on the rim say.
pub(super) fn cutting(scene: &Scene, place: Place, radius: f64, kind: Kind) -> Cutting {
    let (frame, height) = (Frame::around(place.normal), f64::from(FLATTENED) * radius);
    let mut cutting = Cutting { walls: false, edges: false };
    for probe in 0..RIM {
        let aside = on_rim(&frame, radius, f64::from(probe) / f64::from(RIM));
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

/// Whether the way `aside` from a place, `height` above it, is free of walls. Slopes are none: they are of the same surface.
fn is_free(scene: &Scene, place: Place, aside: DVec3, height: f64) -> bool {
    let length = aside.length();
    let Some(direction) = aside.try_normalize() else { return true };
    let ray = Ray::new(place.point + height * place.normal, direction);
    let mut free = true;
    scene.geometry.all_hits(&ray, 0.0, length, |hit| {
        let facing = if hit.normal.dot(direction) > 0.0 { -hit.normal } else { hit.normal };
        free &= facing.dot(place.normal) >= SLOPE || !scene.surfaces[hit.id as usize].material.is_wall();
    });
    free
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
