//! The point query: the light scattered at one point, from the photons in a ball around it (Jensen 2001, §10.7;
//! Jarosz et al. 2008, Eq. 3–4).

use super::confined::{Confines, Within, share_of_ball};
use super::gathered::{GatherStats, Gathered, Sums};
use super::march::{March, Marcher};
use super::phase::{BroadSum, Evaluate, HenyeyGreenstein, Isotropic, Kind, PhaseLanes, Sum};
use super::segment::EyeSegment;
use crate::geometry::Hull;
use crate::math::{DVec3, Rgb, Stream, Vec3};
use crate::medium::Medium;
use crate::medium::phase::Peak;
use crate::photon::kernel::{Biweight, Constant, Epanechnikov, Profile, Shape};
use crate::photon::simd::{Lanes, Task, at_most, load3, prefetch};
use crate::photon::{Plane, PointMap, PointMemory};
use smallvec::SmallVec;

/// A point on a ray from the eye.
#[derive(Clone, Copy, Debug)]
pub struct PointQuery<'a> {
    /// Where.
    pub position: DVec3,
    /// The ray's unit direction ω, away from the eye.
    pub direction: DVec3,
    /// The medium's phase function.
    pub phase: &'a PhaseLanes,
    /// The solid that it lies in, if balls are about as wide as that.
    pub hull: Option<&'a Hull>,
    /// Only photons with at most this many events count, if the map is tagged; 255 for all.
    pub max_events: u8,
}

/// The walls of a point's surroundings.
type Planes = SmallVec<[Plane; 3]>;

impl PointMap {
    /// The light scattered at a point against the ray's direction, radiance per unit of length,
    ///
    /// S_c = Σᵢ K₃(|xᵢ − x|/r)/r³ · p(−dᵢ·ω) · Pᵢ,c   over |xᵢ − x| < r.
    ///
    /// With r at the n-th neighbour that one lies on the rim and does not count: n photons would be too many by
    /// n/(n − 1), as the n-th says where the ball ends.
    ///
    /// `walls` is asked for the walls within a distance of a point, where there may be any: photons beyond them do
    /// not count, and the sum is divided by the share of the kernel on this side of each.
    ///
    /// Allocates nothing once `memory` has grown. The result depends on the map and the query alone, up to the
    /// rounding of the instruction set.
    pub fn gather(
        &self,
        query: &PointQuery,
        walls: &impl Fn(Vec3, f32, &mut SmallVec<[Plane; 3]>),
        memory: &mut PointMemory,
        stats: &mut GatherStats,
    ) -> Gathered {
        stats.queries += 1;
        if self.is_empty() {
            return Gathered::default();
        }
        let x = query.position.as_vec3();
        let before = memory.nodes();
        let squared_radius = self.look_up(x, memory);
        let blocks = memory.blocks();
        stats.nodes += memory.nodes() - before;
        stats.blocks += blocks.len() as u64;
        if blocks.is_empty() {
            return Gathered::default();
        }
        let radius = squared_radius.sqrt();
        let mut planes = Planes::new();
        if query.hull.is_none() && !self.is_clear(x, radius, blocks) {
            walls(x, radius, &mut planes);
        }

        let within = query.hull.map(|hull| Within::new(hull, query.position));
        let (found, omega) =
            (LookedUp { map: self, x, squared_radius, blocks, planes: &planes, within }, query.direction);
        let sums = match &query.phase.0 {
            Kind::Isotropic => found.sum(Isotropic, query.max_events, stats),
            Kind::HenyeyGreenstein(g) => found.sum(HenyeyGreenstein::new(*g, omega), query.max_events, stats),
            Kind::Sum(terms) => found.sum(Sum::new(terms, omega), query.max_events, stats),
            Kind::Broad(terms, broad) => found.sum(BroadSum::new(terms, broad, omega), query.max_events, stats),
        };
        let inside = match query.hull {
            None => share(self.profile, &planes, radius),
            Some(hull) => share_of_ball(self.profile, hull, query.position, radius.into()),
        };
        let factor = self.profile.ball_peak() / (f64::from(squared_radius) * f64::from(radius) * inside);
        sums.times(factor)
    }
}

/// The share of the kernel on this side of all walls: exact for two; of three, as if the third's share of what one
/// leaves were its share of what both leave.
fn share(profile: Profile, planes: &[Plane], radius: f32) -> f64 {
    let distance = |plane: &Plane| f64::from(plane.distance) / f64::from(radius);
    let one = |plane: &Plane| profile.ball_share(distance(plane));
    let two = |p: &Plane, q: &Plane| {
        profile.ball_share_of_two([distance(p), distance(q)], p.normal.as_dvec3().dot(q.normal.as_dvec3()))
    };
    let share = match planes {
        [] => 1.0,
        [p] => one(p),
        [p, q] => two(p, q),
        [p, q, r, ..] => two(p, q) * two(p, r) * two(q, r) / (one(p) * one(q) * one(r)),
    };
    share.max(LEAST_SHARE)
}

/// Between walls that touch, nothing would be left.
const LEAST_SHARE: f64 = 1e-9;

/// What a look-up found.
#[derive(Clone, Copy)]
struct LookedUp<'a> {
    map: &'a PointMap,
    x: Vec3,
    squared_radius: f32,
    blocks: &'a [u32],
    planes: &'a [Plane],
    /// Photons elsewhere do not count.
    within: Option<Within>,
}

impl LookedUp<'_> {
    fn sum(self, phase: impl Evaluate, max_events: u8, stats: &mut GatherStats) -> Sums {
        match self.map.profile {
            Profile::Constant => self.sum_of(phase, Constant, max_events, stats),
            Profile::Epanechnikov => self.sum_of(phase, Epanechnikov, max_events, stats),
            Profile::Biweight => self.sum_of(phase, Biweight, max_events, stats),
        }
    }

    fn sum_of(self, phase: impl Evaluate, shape: impl Shape, max_events: u8, stats: &mut GatherStats) -> Sums {
        let any = phase.any();
        self.map.isa.run_or(
            GatherBall { found: self, phase, shape, max_events, stats },
            |GatherBall { found, shape, max_events, stats, .. }| GatherBall {
                found,
                phase: any,
                shape,
                max_events,
                stats,
            },
        )
    }
}

/// The sum as a kernel.
struct GatherBall<'a, P, S> {
    found: LookedUp<'a>,
    phase: P,
    #[allow(dead_code, reason = "its type says it all")]
    shape: S,
    max_events: u8,
    stats: &'a mut GatherStats,
}

/// How many blocks ahead to fetch.
const AHEAD: usize = 2;

impl<P: Evaluate, S: Shape> Task for GatherBall<'_, P, S> {
    type Output = Sums;

    #[inline(always)]
    fn run<L: Lanes>(self) -> Sums {
        let GatherBall {
            found: LookedUp { map, x, squared_radius, blocks, planes, within },
            phase,
            max_events,
            stats,
            ..
        } = self;
        let lanes = [L::splat(x.x), L::splat(x.y), L::splat(x.z)];
        let (limit, inverse) = (L::splat(squared_radius), L::splat(1.0 / squared_radius));
        let zero = L::splat(0.0);
        let mut total = [zero; 3];
        let mut single = [zero; 3];
        let mut photons = 0;
        for (i, &index) in blocks.iter().enumerate() {
            let index = index as usize;
            prefetch(&map.loads[blocks[(i + AHEAD).min(blocks.len() - 1)] as usize]);
            let d2 = map.squared::<L>(index, &lanes);
            let mut bits = L::bits(d2.less(limit));
            if bits == 0 {
                continue;
            }
            for plane in planes {
                let [dx, dy, dz] = map.relative::<L>(index, &lanes);
                let n = plane.normal;
                let height = dz.mul_add(L::splat(n.z), L::splat(plane.distance));
                let height = dx.mul_add(L::splat(n.x), dy.mul_add(L::splat(n.y), height));
                bits &= L::bits(zero.less(height));
            }
            if let Some(within) = &within {
                bits &= L::bits(within.contains(&map.relative::<L>(index, &lanes)));
            }
            let events = map.events.get(index);
            if let Some(events) = events
                && max_events < u8::MAX
            {
                bits &= at_most(events, max_events);
            }
            photons += u64::from(bits.count_ones());
            let load = &map.loads[index];
            let q = d2.neg_mul_add(inverse, L::splat(1.0)).max(zero);
            let weight = S::value(q).mul(phase.values(&load3::<L>(&load.direction))).keep(L::mask(bits));
            let power = load3::<L>(&load.power);
            for channel in 0..3 {
                total[channel] = weight.mul_add(power[channel], total[channel]);
            }
            if let Some(events) = events {
                let first = weight.keep(L::mask(at_most(events, 0)));
                for channel in 0..3 {
                    single[channel] = first.mul_add(power[channel], single[channel]);
                }
            }
        }
        stats.photons += photons;
        let mut sums = Sums { total: [0.0; 3], single: [0.0; 3] };
        for channel in 0..3 {
            sums.total[channel] = f64::from(total[channel].sum()) * phase.constant();
            sums.single[channel] = f64::from(single[channel].sum()) * phase.constant();
        }
        sums
    }
}

/// One point map for each region, and how rays are marched through each medium.
#[derive(Debug)]
pub struct PointMaps {
    maps: Vec<Option<PointMap>>,
    phases: Vec<PhaseLanes>,
    marchers: Vec<Marcher>,
    confines: Confines,
}

/// What a thread keeps from march to march.
#[derive(Debug, Default)]
pub struct Marching {
    memories: Vec<PointMemory>,
    /// Of the marches themselves.
    pub march: March,
}

impl PointMaps {
    /// From the maps of all regions, in their order, all media, the peaks of these that are left to paths, and each one's marcher.
    pub fn new(
        maps: Vec<Option<PointMap>>,
        media: &[Medium],
        peaks: &[Option<Peak>],
        marchers: Vec<Marcher>,
        confines: Confines,
    ) -> Self {
        PointMaps { maps, phases: PhaseLanes::of_media(media, peaks), marchers, confines }
    }

    /// From now on, rays are marched so, by medium.
    pub fn march(&mut self, marchers: &[Marcher]) {
        self.marchers = marchers.to_vec();
    }

    /// The maps that hold photons, with their regions.
    pub fn by_region(&self) -> impl Iterator<Item = (u32, &PointMap)> {
        self.maps.iter().enumerate().filter_map(|(region, map)| Some((region as u32, map.as_ref()?)))
    }

    /// Marches along a segment: the light scattered once, and all other, as radiance at its start. `weight` is what
    /// light there counts, by channel; `walls` as for [`PointMap::gather`].
    pub fn gather(
        &self,
        (medium, segment, weight): (&Medium, &EyeSegment, Rgb),
        walls: &impl Fn(Vec3, f32, &mut SmallVec<[Plane; 3]>),
        stream: &mut Stream,
        marching: &mut Marching,
        stats: &mut GatherStats,
    ) -> [Rgb; 2] {
        let EyeSegment { ray, a, b, region, .. } = *segment;
        let region = region as usize;
        let Some(map) = &self.maps[region] else { return Default::default() };
        let Some((first, last)) = map.bounds().clip(&ray, a, b) else { return Default::default() };
        if marching.memories.len() <= region {
            marching.memories.resize_with(region + 1, PointMemory::default);
        }
        let memory = &mut marching.memories[region];
        let phase = &self.phases[segment.medium as usize];
        let hull = self.confines.of(segment.solid);
        let mut source = |t: f64, _: &mut Stream| {
            let position = ray.at(t);
            let density = if map.fluence { medium.density.at(position) } else { 1.0 };
            if density <= 0.0 {
                return [Rgb::ZERO; 2];
            }
            let query = PointQuery { position, direction: ray.direction, phase, hull, max_events: segment.max_events };
            let (total, single) = map.gather(&query, walls, memory, stats).rgb();
            [total * density, single * density]
        };
        let marcher = &self.marchers[segment.medium as usize];
        let line = (&ray, a, first, last);
        let [total, single] = marching.march.along(marcher, line, (medium, weight), stream, &mut source);
        [single, total - single]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gather::march::Stepping;
    use crate::math::random::Purpose;
    use crate::math::{Ray, sampling};
    use crate::medium::Emission;
    use crate::medium::density::Density;
    use crate::medium::phase::{HenyeyGreenstein, Isotropic, Phase};
    use crate::photon::simd::Isa;
    use crate::photon::{Ball, Photon, PointSettings};

    use std::f64::consts::PI;

    const PROFILES: [Profile; 3] = [Profile::Constant, Profile::Epanechnikov, Profile::Biweight];

    fn no_walls(_: Vec3, _: f32, _: &mut Planes) {}

    fn far(_: Vec3, limit: f32) -> f32 {
        limit
    }

    /// The walls of the cube [−1, 1]³ within a distance of a point inside.
    fn room(x: Vec3, r: f32, planes: &mut Planes) {
        for axis in [Vec3::X, Vec3::Y, Vec3::Z] {
            for normal in [axis, -axis] {
                let distance = 1.0 + x.dot(normal);
                if distance < r {
                    planes.push(Plane { normal, distance, leans: false });
                }
            }
        }
    }

    fn room_clearance(x: Vec3, limit: f32) -> f32 {
        (1.0 - x.abs().max_element()).min(limit)
    }

    /// Photons in the cube [−1, 1]³, a third of them in a dense spot.
    fn photons(count: usize, stream: &mut Stream) -> Vec<Photon> {
        (0..count)
            .map(|i| {
                let x = DVec3::from_array([0; 3].map(|_| 2.0 * stream.uniform() - 1.0));
                Photon {
                    position: (if i % 3 == 0 { 0.3 + 0.02 * x } else { x }).as_vec3(),
                    direction: sampling::sphere(stream.uniform2()).as_vec3(),
                    power: Vec3::from_array([0; 3].map(|_| stream.uniform() as f32)),
                    events: (stream.uniform() * 4.0) as u8,
                    normal: Default::default(),
                }
            })
            .collect()
    }

    /// What the documentation says, by a search through all photons, in f64; and how many count.
    fn search(
        photons: &[Photon],
        settings: &PointSettings,
        query: &PointQuery,
        g: f64,
        walls: &impl Fn(Vec3, f32, &mut Planes),
    ) -> ([f64; 3], u64) {
        let x = query.position.as_vec3();
        let distance = |photon: &Photon| photon.position.as_dvec3().distance(x.as_dvec3());
        let r = match settings.ball {
            Ball::Fixed(radius) => f64::from(radius),
            Ball::Nearest { neighbours, max_radius } => {
                let mut all: Vec<f64> = photons.iter().map(distance).collect();
                all.sort_by(f64::total_cmp);
                all.get(neighbours as usize - 1).copied().unwrap_or(f64::INFINITY).min(max_radius.into())
            }
        } * f64::from(settings.scale);
        let mut planes = Planes::new();
        walls(x, r as f32, &mut planes);
        let (mut sum, mut count) = (DVec3::ZERO, 0);
        for photon in photons {
            let to = photon.position.as_dvec3() - x.as_dvec3();
            let beyond = |plane: &Plane| to.dot(plane.normal.as_dvec3()) + f64::from(plane.distance) <= 0.0;
            // The n-th photon itself, found at its own distance, is not inside.
            if distance(photon) >= r || planes.iter().any(beyond) || photon.events > query.max_events {
                continue;
            }
            let cosine = -photon.direction.as_dvec3().dot(query.direction);
            let phase = (1.0 - g * g) / (4.0 * PI * (1.0 + g * g - 2.0 * g * cosine).powf(1.5));
            sum += photon.power.as_dvec3() * (phase * settings.profile.ball(distance(photon) / r) / r.powi(3));
            count += 1;
        }
        sum /= share(settings.profile, &planes, r as f32);
        (sum.to_array(), count)
    }

    #[test]
    fn look_ups_equal_a_search_through_all() {
        let mut stream = Stream::new(1, Purpose::Test, 0, 0);
        let g = 0.6;
        let phase = PhaseLanes::new(HenyeyGreenstein { g });
        let nearest = |neighbours, max_radius| Ball::Nearest { neighbours, max_radius };
        let mut case = 0;
        for (count, ball) in [
            (4000, Ball::Fixed(0.15)),
            (4000, nearest(2, 9.0)),
            (4000, nearest(50, 9.0)),
            (4000, nearest(50, 0.12)),
            (4000, nearest(3000, 9.0)),
            (40, nearest(41, 1.5)),
            (1, nearest(2, 1.5)),
        ] {
            let photons = photons(count, &mut stream);
            for isa in Isa::available() {
                case += 1;
                let settings = PointSettings {
                    profile: PROFILES[case % 3],
                    scale: if case % 4 == 0 { 0.8 } else { 1.0 },
                    tagged: true,
                    ..PointSettings::new(ball)
                };
                let mut map = PointMap::build(photons.clone(), &settings, &room_clearance);
                map.isa = isa;
                let mut memory = PointMemory::default();
                let mut at = DVec3::ZERO;
                for i in 0..60 {
                    // Some far from the last, most close to it; some in the dense spot and some at its rim.
                    at = match i % 6 {
                        0 => DVec3::from_array([0; 3].map(|_| 2.0 * stream.uniform() - 1.0)),
                        1 => DVec3::splat(0.3) + 0.03 * sampling::sphere(stream.uniform2()),
                        _ => (at + 0.02 * sampling::sphere(stream.uniform2())).clamp(-DVec3::ONE, DVec3::ONE),
                    };
                    let query = PointQuery {
                        position: at,
                        direction: sampling::sphere(stream.uniform2()),
                        phase: &phase,
                        hull: None,
                        max_events: if i % 5 == 0 { 1 } else { 255 },
                    };
                    let (expected, inside) = search(&photons, &settings, &query, g, &room);
                    let mut stats = GatherStats::default();
                    let got = map.gather(&query, &room, &mut memory, &mut stats);
                    assert_eq!(stats.photons, inside, "{isa:?} {settings:?} {query:?}");
                    for (channel, &expected) in expected.iter().enumerate() {
                        let error = (f64::from(got.total[channel]) - expected).abs();
                        assert!(error <= 1e-4 * expected, "{isa:?} {settings:?}: {got:?} {expected:?}");
                    }
                    // Where the last look-up was makes no difference.
                    let fresh = map.gather(&query, &room, &mut PointMemory::default(), &mut stats);
                    assert_eq!(got, fresh, "{isa:?} {settings:?}");
                    let direct = PointQuery { max_events: 0, ..query };
                    assert_eq!(map.gather(&direct, &room, &mut memory, &mut stats).total, got.single);
                }
            }
        }
    }

    #[test]
    fn photons_at_one_place_and_none() {
        let one = Photon {
            position: Vec3::new(0.3, -4.0, 2.0),
            direction: Vec3::X,
            power: Vec3::ONE,
            events: 0,
            normal: Default::default(),
        };
        let phase = PhaseLanes::new(Isotropic);
        let query = PointQuery {
            position: one.position.as_dvec3(),
            direction: DVec3::Z,
            phase: &phase,
            hull: None,
            max_events: 255,
        };
        for ball in [Ball::Fixed(0.5), Ball::Nearest { neighbours: 500, max_radius: 0.5 }] {
            let settings = PointSettings::new(ball);
            let look = |map: &PointMap, query: &PointQuery| {
                map.gather(query, &no_walls, &mut PointMemory::default(), &mut GatherStats::default()).total[0]
            };
            let map = PointMap::build(vec![one; 40_000], &settings, &far);
            let r = f64::from(map.radii().mean);
            assert!(r > 0.0 && map.radii().min == map.radii().max);
            let expected = 40_000.0 * 3.0 / (16.0 * PI * PI) / r.powi(3);
            assert!((f64::from(look(&map, &query)) / expected - 1.0).abs() < 1e-4);
            let away = PointQuery { position: query.position + DVec3::X, ..query };
            assert_eq!(look(&map, &away), 0.0);
            // A single one is seen from as far as the cap.
            let map = PointMap::build(vec![one], &settings, &far);
            let near = PointQuery { position: query.position + 0.4 * DVec3::X, ..query };
            let expected = 3.0 / (16.0 * PI * PI) / 0.5f64.powi(3);
            assert!((f64::from(look(&map, &near)) / expected - 1.0).abs() < 1e-4);
            assert_eq!(look(&map, &away), 0.0);
            let none = PointMap::build(Vec::new(), &settings, &far);
            assert_eq!((look(&none, &query), none.bounds().is_empty()), (0.0, true));
        }
    }

    /// Photons spread evenly in a room scatter 1/4π of their power density into every direction:
    /// L = q/4π (1 − e^{−σs})/σ for every marcher, ball and profile, inside, along a wall and into a corner.
    #[test]
    fn an_even_density_gives_the_closed_form() {
        const COUNT: usize = 60_000;
        const SIGMA: [f64; 3] = [0.2, 0.8, 2.0];
        let mut stream = Stream::new(13, Purpose::Test, 0, 0);
        let photon = |_| Photon {
            position: Vec3::from_array([0; 3].map(|_| (2.0 * stream.uniform() - 1.0) as f32)),
            direction: Vec3::Y,
            power: Vec3::splat(1e-3),
            events: 0,
            normal: Default::default(),
        };
        let photons: Vec<Photon> = (0..COUNT).map(photon).collect();
        let density = 1e-3 * COUNT as f64 / 8.0;
        let medium = Medium {
            name: String::new(),
            extinction: SIGMA.into(),
            albedo: Rgb::ONE.into(),
            phase: Phase::Isotropic(Isotropic).into(),
            density: Density::Uniform,
            emission: Emission::None,
        };
        let n = 40;
        let r = (f64::from(n) / (COUNT as f64 / 8.0) / (4.0 / 3.0 * PI)).cbrt();
        for (case, ball) in
            [Ball::Fixed(r as f32), Ball::Nearest { neighbours: n, max_radius: 1.0 }].into_iter().enumerate()
        {
            for profile in PROFILES {
                let settings = PointSettings { profile, ..PointSettings::new(ball) };
                let steppings = [Stepping::Uniform, Stepping::Adaptive { contrast: 0.3 }, Stepping::Exponential];
                for stepping in steppings {
                    let map = PointMap::build(photons.clone(), &settings, &room_clearance);
                    let maps = PointMaps::new(
                        vec![Some(map)],
                        std::slice::from_ref(&medium),
                        &[],
                        vec![Marcher { stepping, size: 0.15 }],
                        Confines::default(),
                    );
                    let (mut ratios, mut marching) = (Vec::new(), Marching::default());
                    let mut stream = Stream::new(13, Purpose::Test, 1, case as u64);
                    for i in 0..256 {
                        let s = -0.8 + 1.6 * stream.uniform();
                        let (origin, direction, length) = match i % 3 {
                            0 => (DVec3::new(s, 1.6 * stream.uniform() - 0.8, -0.9), DVec3::Z, 1.8),
                            1 => (DVec3::new(s, 0.3 * r - 1.0, -0.9), DVec3::Z, 1.8),
                            _ => (DVec3::new(0.0, 0.0, s), DVec3::new(1.0, 1.0, 0.0).normalize(), 2f64.sqrt()),
                        };
                        let segment = EyeSegment {
                            ray: Ray::new(origin, direction),
                            a: 0.0,
                            b: length,
                            medium: 0,
                            region: 0,
                            solid: None,
                            max_events: 255,
                            from_camera: true,
                            passed: false,
                            spread: false,
                        };
                        let mut stats = GatherStats::default();
                        let gathered =
                            maps.gather((&medium, &segment, Rgb::ONE), &room, &mut stream, &mut marching, &mut stats);
                        assert!(stats.queries >= 3);
                        let [_, more] = gathered;
                        let expected = Rgb::from_array(
                            SIGMA.map(|sigma| density / (4.0 * PI) * (1.0 - (-sigma * length).exp()) / sigma),
                        );
                        ratios.push(more / expected);
                    }
                    let count = ratios.len() as f64;
                    let mean = ratios.iter().sum::<Rgb>() / count;
                    let variance = ratios.iter().map(|x| (*x - mean) * (*x - mean)).sum::<Rgb>() / (count - 1.0);
                    for channel in 0..3 {
                        let error = (variance[channel] / count).sqrt();
                        let found = mean[channel];
                        assert!(error < 0.016, "{ball:?} {profile:?} {stepping:?}: ± {error}");
                        assert!(
                            (found - 1.0).abs() < 3.0 * error,
                            "{ball:?} {profile:?} {stepping:?}, channel {channel}: {found} ± {error}"
                        );
                    }
                }
            }
        }
    }
}
