//! Photons in small solids: how much of a disc or ball lies within them.
//!
//! A disc as wide as its solid is cut all around, and planes at its nearest faces do not tell how much is left. In a ball or a box,
//! however placed, that is seen from the disc's middle: with the distance s(φ) to the surface in each direction φ along the disc, the
//! share of the kernel within is the mean of its shares within s(φ), as the solid is convex. A sum over directions that are spread evenly is
//! exact up to what the outline changes between two of them.
//!
//! Contributions are divided by the share around the foot point, as beside walls; so where light is even, a picture is right however wide
//! discs are. The solid's photons count, and no others of its region.

use std::f64::consts::TAU;

use rayon::prelude::*;

use crate::geometry::{Hull, HullKind};
use crate::math::{DVec3, Frame};
use crate::photon::kernel::Profile;
use crate::photon::simd::{Lanes, dot_plus, splat3};
use crate::scene::Scene;

/// Directions along a disc.
const AROUND: usize = 16;
/// Directions from the middle of a ball.
const ALL_AROUND: usize = 48;
/// Shares are taken to be no less, nor less than this part of a disc as wide as the solid: no photon counts many times in a ball's outermost
/// slice, which holds little light.
const LEAST_SHARE: f32 = 0.004;
/// Photons this far outside, relative to the solid, are rounded.
const ROUNDED: f32 = 1e-4;
/// Discs and balls wider than this share of their solid's size are cut by its whole surface, not by planes;
const WIDE: f64 = 0.15;
/// where they would lean on its surface, those in solids whose size is less than so many mean free paths, as light comes from all of it;
const THIN: f64 = 2.0;
/// and those that are wider than this share,
const WIDER: f64 = 0.7;
/// up to so many mean free paths: in a ball of four, with 33 photons, means are 10 % too dark so, and 21 % where discs lean; in one of
/// twenty 55 % and 21 %.
const THICK: f64 = 10.0;

/// The hulls of solids, where photons of their region are spread wide.
#[derive(Debug, Default)]
pub struct Confines {
    /// By solid.
    hulls: Vec<Option<Hull>>,
    /// By region, the largest of its solids' hulls; infinite where there are other solids.
    sizes: Vec<f64>,
}

impl Confines {
    /// Those that a scene's solids may be.
    pub fn possible(scene: &Scene) -> Confines {
        let mut sizes = vec![0.0f64; scene.regions as usize];
        sizes[scene.world_region as usize] = f64::INFINITY;
        let mut roles = vec![Role::Alone; scene.solids.len()];
        for overlap in &scene.overlaps {
            overlap.of.iter().for_each(|&solid| roles[solid as usize] = Role::Part);
            roles[overlap.solid as usize] = Role::Overlap(&overlap.of);
        }
        let hull = |solid: u32| {
            let hull = scene.geometry.hull(scene.solids[solid as usize].shape);
            hull.filter(|_| is_whole(scene, solid, roles[solid as usize]))
        };
        let hulls: Vec<Option<Hull>> = (0..scene.solids.len() as u32).into_par_iter().map(hull).collect();
        for (solid, hull) in scene.solids.iter().zip(&hulls) {
            let size = &mut sizes[solid.region as usize];
            *size = size.max(hull.map_or(f64::INFINITY, |hull| hull.size));
        }
        Confines { hulls, sizes }
    }

    /// Whether photons of a region that are spread so wide on average are confined; given the extinction where their discs would else lean
    /// on its surface.
    pub fn confine(&self, region: u32, radius: f64, leans: Option<f64>) -> bool {
        let size = self.sizes[region as usize];
        match leans.map(|extinction| extinction * size) {
            None => radius > WIDE * size,
            Some(paths) => radius > WIDE * size && paths < THIN || radius > WIDER * size && paths < THICK,
        }
    }

    /// Those of regions whose photons are.
    pub fn of_regions(mut self, scene: &Scene, are_confined: impl Fn(u32) -> bool) -> Confines {
        let regions: Vec<bool> = (0..scene.regions).map(are_confined).collect();
        for (solid, hull) in scene.solids.iter().zip(&mut self.hulls) {
            *hull = hull.filter(|_| regions[solid.region as usize]);
        }
        self
    }

    /// That of a solid.
    pub fn of(&self, solid: Option<u32>) -> Option<&Hull> {
        self.hulls.get(solid? as usize)?.as_ref()
    }
}

/// What a solid has to do with the overlaps of others.
#[derive(Clone, Copy)]
enum Role<'s> {
    /// Nothing.
    Alone,
    /// It overlaps others, and media add up there.
    Part,
    /// It stands for that overlap of solids, in the shape of the smallest.
    Overlap(&'s [u32]),
}

/// Whether a solid's photons may lie anywhere in it: nothing takes the place of a part of it, adds to it, or stands in it.
fn is_whole(scene: &Scene, solid: u32, role: Role) -> bool {
    let region = |solid: u32| scene.solids[solid as usize].region;
    // Solids are in order of their precedence; those of a region share their photons. Below the first whose medium does not add, none counts.
    let (parts, lowest) = match role {
        Role::Alone => (&[][..], Some(solid)),
        Role::Part => return false,
        Role::Overlap(of) => (of, of.last().copied().filter(|&last| !scene.solids[last as usize].adds)),
    };
    let yields = |other: u32| lowest.is_some_and(|lowest| other < lowest) || region(other) == region(solid);
    let shape = scene.solids[solid as usize].shape;
    let bounds = scene.geometry.bounds(shape);
    let mut whole = true;
    scene.geometry.boxes_overlapping(&bounds, |other| {
        whole = whole
            && (other == shape || {
                let surface = &scene.surfaces[other as usize];
                match scene.geometry.contains_all(other, &bounds) {
                    Some(contains) => contains || surface.solid.is_none_or(|other| !parts.contains(&other)),
                    None => {
                        let yields = |other| !parts.contains(&other) && yields(other);
                        !surface.material.is_wall() && surface.solid.is_none_or(yields)
                    }
                }
            });
    });
    whole
}

/// Which photons lie in a hull.
#[derive(Clone, Copy, Debug)]
pub(super) struct Within {
    kind: HullKind,
    /// To the hull's coordinates: rows, and what is added.
    rows: [[f32; 3]; 3],
    moved: [f32; 3],
}

impl Within {
    /// For places relative to `around`.
    pub(super) fn new(hull: &Hull, around: DVec3) -> Self {
        let rows = hull.to_unit.matrix3.transpose();
        Within {
            kind: hull.kind,
            rows: [rows.x_axis, rows.y_axis, rows.z_axis].map(|row| row.as_vec3().to_array()),
            moved: hull.to_unit.transform_point3(around).as_vec3().to_array(),
        }
    }

    #[inline(always)]
    pub(super) fn contains<L: Lanes>(&self, x: &[L; 3]) -> L::Mask {
        let [x, y, z] = [0, 1, 2].map(|axis| dot_plus(x, &splat3(self.rows[axis]), L::splat(self.moved[axis])));
        self.reach(&[x, y, z]).less_equal(L::splat(1.0 + ROUNDED))
    }

    /// Of places in the hull's coordinates, how far out they are: 1 on its surface.
    #[inline(always)]
    fn reach<L: Lanes>(&self, [x, y, z]: &[L; 3]) -> L {
        match self.kind {
            HullKind::Ball => x.mul_add(*x, y.mul_add(*y, z.mul(*z))).sqrt(),
            HullKind::Cube => {
                let far = |x: &L| x.max(L::splat(0.0).sub(*x));
                far(x).max(far(y)).max(far(z))
            }
        }
    }
}

/// A hull as a ray passes through it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Confined {
    pub(super) within: Within,
    /// The ray in its coordinates.
    origin: [f32; 3],
    direction: [f32; 3],
    /// Directions across the ray.
    around: [[f32; 3]; AROUND],
    /// [`Hull::size`], less what is rounded.
    size: f32,
}

impl Confined {
    /// As seen by a ray; `turn` from [0, 1] turns the directions across it.
    pub(super) fn new(hull: &Hull, origin: DVec3, direction: DVec3, turn: f64) -> Self {
        let unit = &hull.to_unit;
        let frame = Frame::around(direction);
        let around = std::array::from_fn(|k| {
            let (sin, cos) = (TAU * (k as f64 + turn) / AROUND as f64).sin_cos();
            unit.transform_vector3(cos * frame.x + sin * frame.y).as_vec3().to_array()
        });
        Confined {
            within: Within::new(hull, DVec3::ZERO),
            origin: unit.transform_point3(origin).as_vec3().to_array(),
            direction: unit.transform_vector3(direction).as_vec3().to_array(),
            around,
            size: hull.size as f32 * (1.0 - ROUNDED),
        }
    }

    /// The shares of discs around foot points at t, with these 1/r²; anything outside of `bits`.
    #[inline(always)]
    pub(super) fn share<L: Lanes>(&self, profile: Profile, (t, bits): (L, u16), inverse_square: L) -> L {
        let (zero, one) = (L::splat(0.0), L::splat(1.0));
        let p = [0, 1, 2].map(|axis| t.mul_add(L::splat(self.direction[axis]), L::splat(self.origin[axis])));
        // Most often they lie within, all of them.
        let clear = one.sub(self.within.reach(&p)).max(zero).mul(L::splat(self.size));
        if L::bits(clear.mul(clear).mul(inverse_square).less(one)) & bits == 0 {
            return one;
        }
        let inside = one.sub(p[0].mul_add(p[0], p[1].mul_add(p[1], p[2].mul(p[2])))).max(zero);
        let mut beyond = zero;
        for d in &self.around {
            let s = match self.within.kind {
                HullKind::Ball => {
                    let a = d[0] * d[0] + d[1] * d[1] + d[2] * d[2];
                    let b = dot_plus(&p, &splat3(*d), zero);
                    inside.mul(L::splat(a)).add(b.mul(b)).sqrt().sub(b).mul(L::splat(1.0 / a))
                }
                HullKind::Cube => {
                    let to = |axis: usize| {
                        let steep = 1.0 / d[axis].abs().max(1e-30);
                        p[axis].neg_mul_add(L::splat(1.0f32.copysign(d[axis])), one).mul(L::splat(steep))
                    };
                    to(0).min(to(1)).min(to(2))
                }
            };
            let s = s.max(zero);
            // The kernel's share beyond s: (1 − s²/r²)^{k + 1}.
            let q = one.sub(s.mul(s).mul(inverse_square)).max(zero);
            beyond = beyond.add(match profile {
                Profile::Constant => q,
                Profile::Epanechnikov => q.mul(q),
                Profile::Biweight => q.mul(q).mul(q),
            });
        }
        let least = one.min(inverse_square.mul(L::splat(self.size * self.size))).mul(L::splat(LEAST_SHARE));
        beyond.neg_mul_add(L::splat(1.0 / AROUND as f32), one).max(least)
    }
}

/// The share of the kernel of a ball of a point within a hull.
pub(super) fn share_of_ball(profile: Profile, hull: &Hull, at: DVec3, radius: f64) -> f64 {
    let golden = TAU * 0.618_033_988_749_894_9;
    let within = |k: usize| {
        let z = 1.0 - (2 * k + 1) as f64 / ALL_AROUND as f64;
        let (sin, cos) = (golden * k as f64).sin_cos();
        let flat = (1.0 - z * z).sqrt();
        profile.ball_within(hull.exit(at, DVec3::new(flat * cos, flat * sin, z)) / radius)
    };
    ((0..ALL_AROUND).map(within).sum::<f64>() / ALL_AROUND as f64).max(f64::MIN_POSITIVE)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{Cuboid, Geometry, Placed, Shape, Sphere};
    use crate::math::random::Purpose;
    use crate::math::{DAffine3, Stream, sampling};
    use crate::photon::simd::{Isa, LANES, Row, Task};

    struct Share<'a>(&'a Confined, Profile, Row, f32);
    impl Task for Share<'_> {
        type Output = Row;
        #[inline(always)]
        fn run<L: Lanes>(self) -> Row {
            let Share(confined, profile, mut t, radius) = self;
            confined.share(profile, (L::load(&t), u16::MAX), L::splat(1.0 / (radius * radius))).store(&mut t);
            t
        }
    }

    /// Discs and balls across solids have the shares within these that a sum over places on them finds, whatever their size.
    #[test]
    fn shares_are_what_lies_within() {
        let turned = DAffine3::from_scale_rotation_translation(
            DVec3::new(0.5, 1.0, 1.4),
            glam::DQuat::from_axis_angle(DVec3::new(0.6, 0.0, 0.8), 1.0),
            DVec3::new(7.0, -3.0, 2.0),
        );
        let shapes = [
            Shape::Sphere(Sphere::new(DVec3::new(0.3, 0.0, 0.1), 0.4).unwrap()),
            Shape::Cuboid(Cuboid::new(DVec3::new(-0.2, -0.5, 0.1), DVec3::new(0.4, 0.3, 0.5)).unwrap()),
        ];
        let geometry =
            Geometry::new(shapes.into_iter().map(|shape| Placed::new(shape, turned).unwrap()).collect::<Vec<_>>());
        let mut stream = Stream::new(83, Purpose::Test, 0, 0);
        for (id, kind) in [(0, HullKind::Ball), (1, HullKind::Cube)] {
            let hull = geometry.hull(id).unwrap();
            assert_eq!(hull.kind, kind);
            let bounds = geometry.bounds(id);
            for profile in [Profile::Constant, Profile::Epanechnikov, Profile::Biweight] {
                let (mut worst, mut sum) = (0.0f64, 0.0);
                const N: u32 = 60;
                for _ in 0..N {
                    let at = loop {
                        let share = DVec3::from_array([0; 3].map(|_| stream.uniform()));
                        let at = bounds.min + share * bounds.size();
                        if hull.contains(at) {
                            assert!(geometry.contains(id, at));
                            break at;
                        }
                    };
                    let direction = sampling::sphere(stream.uniform2());
                    let radius = hull.size * 4.0f64.powf(2.0 * stream.uniform() - 1.0);
                    let confined = Confined::new(&hull, at - 0.1 * direction, direction, stream.uniform());
                    let found = Isa::best().run(Share(&confined, profile, Row([0.1; LANES]), radius as f32)).0[0];

                    let frame = Frame::around(direction);
                    let (mut expected, rings, turns) = (0.0, 60, 120);
                    for i in 0..rings * turns {
                        let (x, angle) = (
                            (f64::from(i / turns) + 0.5) / f64::from(rings),
                            TAU * f64::from(i % turns) / f64::from(turns),
                        );
                        let place = at + radius * x * (angle.cos() * frame.x + angle.sin() * frame.y);
                        if hull.contains(place) {
                            expected += TAU * x * profile.disc(x) / f64::from(rings * turns);
                        }
                    }
                    let off = f64::from(found) - expected;
                    worst = worst.max(off.abs());
                    sum += off;

                    let ball = share_of_ball(profile, &hull, at, radius);
                    let mut within = 0.0;
                    for _ in 0..2000 {
                        let x = stream.uniform().cbrt();
                        if hull.contains(at + radius * x * sampling::sphere(stream.uniform2())) {
                            within += profile.ball(x) * 4.0 / 3.0 * std::f64::consts::PI / 2000.0;
                        }
                    }
                    assert!((ball - within).abs() < 0.1, "{kind:?} {profile:?}: {ball}, not {within}");
                }
                assert!(worst < 0.04 && (sum / f64::from(N)).abs() < 0.005, "{kind:?} {profile:?}: {worst} {sum}");
            }
        }
    }
}
