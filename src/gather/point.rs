//! The point query: the light scattered at one point, from the photons in a ball around it (Jensen 2001, §10.7;
//! Jarosz et al. 2008, Eq. 3–4).

use super::phase::{Evaluate, HenyeyGreenstein, Isotropic, Kind, PhaseLanes, Rayleigh, Schlick, Sum};
use super::march::{Marcher, Steps, Stretch};
use super::volume::{lanes, tabulate};
use super::{DepthTable, GatherStats, Gathered, Reach};
use crate::math::{DVec3, Rgb, Stream, Vec3};
use crate::medium::Medium;
use crate::medium::density::Density;
use crate::photon::kernel::{Biweight, Constant, Epanechnikov, Profile, Shape};
use crate::photon::simd::{Lanes, Row, Task, at_most, prefetch};
use crate::photon::{Plane, PointMap, PointMemory};
use smallvec::SmallVec;
use std::marker::PhantomData;

/// A point on a ray from the eye.
#[derive(Clone, Copy, Debug)]
pub struct PointQuery<'a> {
    /// Where.
    pub position: DVec3,
    /// The ray's unit direction ω, away from the eye.
    pub direction: DVec3,
    /// The medium's phase function.
    pub phase: &'a PhaseLanes,
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
        let omega = query.direction;
        let look = Look { map: self, query, walls, memory, stats };
        match &query.phase.0 {
            Kind::Isotropic => look.by_profile(Isotropic),
            Kind::HenyeyGreenstein(g) => look.by_profile(HenyeyGreenstein::new(*g, omega)),
            Kind::Schlick(k) => look.by_profile(Schlick::new(*k, omega)),
            Kind::Rayleigh => look.by_profile(Rayleigh::new(omega)),
            Kind::Sum(terms) => look.by_profile(Sum::new(terms, omega)),
        }
    }
}

/// A look-up.
struct Look<'a, W> {
    map: &'a PointMap,
    query: &'a PointQuery<'a>,
    walls: &'a W,
    memory: &'a mut PointMemory,
    stats: &'a mut GatherStats,
}

impl<W: Fn(Vec3, f32, &mut Planes)> Look<'_, W> {
    fn by_profile(self, phase: impl Evaluate) -> Gathered {
        match self.map.profile {
            Profile::Constant => self.gather::<Constant>(phase),
            Profile::Epanechnikov => self.gather::<Epanechnikov>(phase),
            Profile::Biweight => self.gather::<Biweight>(phase),
        }
    }

    fn gather<S: Shape>(self, phase: impl Evaluate) -> Gathered {
        self.map.isa.run(Gather { look: self, phase, shape: PhantomData::<S> })
    }
}

/// The look-up as a kernel.
struct Gather<'a, W, P, S> {
    look: Look<'a, W>,
    phase: P,
    shape: PhantomData<S>,
}

/// How many blocks ahead to fetch.
const AHEAD: usize = 2;

impl<W: Fn(Vec3, f32, &mut Planes), P: Evaluate, S: Shape> Task for Gather<'_, W, P, S> {
    type Output = Gathered;

    #[inline(always)]
    fn run<L: Lanes>(self) -> Gathered {
        let Gather { look: Look { map, query, walls, memory, stats }, phase, .. } = self;
        let x = query.position.as_vec3();
        let before = memory.nodes;
        let squared_radius = map.around::<L>(x, memory);
        let blocks = &memory.blocks;
        stats.nodes += memory.nodes - before;
        stats.blocks += blocks.len() as u64;
        if blocks.is_empty() {
            return Gathered::default();
        }

        let radius = squared_radius.sqrt();
        let mut planes = Planes::new();
        if !map.is_clear(x, radius, blocks) {
            walls(x, radius, &mut planes);
        }
        let share: f64 =
            planes.iter().map(|plane| map.profile.ball_share(f64::from(plane.distance) / f64::from(radius))).product();

        let lanes = [L::splat(x.x), L::splat(x.y), L::splat(x.z)];
        let (limit, inverse) = (L::splat(squared_radius), L::splat(1.0 / squared_radius));
        let zero = L::splat(0.0);
        let mut total = [zero; 3];
        let mut single = [zero; 3];
        for (i, &index) in blocks.iter().enumerate() {
            prefetch(&map.loads[blocks[(i + AHEAD).min(blocks.len() - 1)] as usize]);
            let d2 = map.squared::<L>(index, &lanes);
            let mut bits = L::bits(d2.less(limit));
            if bits == 0 {
                continue;
            }
            for plane in &planes {
                let [dx, dy, dz] = map.relative::<L>(index, &lanes);
                let n = plane.normal;
                let height = dz.mul_add(L::splat(n.z), L::splat(plane.distance));
                let height = dx.mul_add(L::splat(n.x), dy.mul_add(L::splat(n.y), height));
                bits &= L::bits(zero.less(height));
            }
            let events = map.events.get(index as usize);
            if let Some(events) = events
                && query.max_events < u8::MAX
            {
                bits &= at_most(events, query.max_events);
            }
            stats.photons += u64::from(bits.count_ones());
            let load = &map.loads[index as usize];
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
        let volume = f64::from(squared_radius) * f64::from(radius) * share;
        let factor = phase.constant() * map.profile.ball_peak() / volume;
        let mut gathered = Gathered::default();
        for channel in 0..3 {
            gathered.total[channel] = (f64::from(total[channel].sum()) * factor) as f32;
            gathered.single[channel] = (f64::from(single[channel].sum()) * factor) as f32;
        }
        gathered
    }
}

#[inline(always)]
fn load3<L: Lanes>(rows: &[Row; 3]) -> [L; 3] {
    [L::load(&rows[0]), L::load(&rows[1]), L::load(&rows[2])]
}

/// One point map for each region, and how rays are marched through each medium.
#[derive(Debug)]
pub struct PointMaps {
    maps: Vec<Option<PointMap>>,
    phases: Vec<PhaseLanes>,
    marchers: Vec<Marcher>,
}

/// What a thread keeps from march to march.
#[derive(Debug, Default)]
pub struct Marching {
    memories: Vec<PointMemory>,
    steps: Steps,
    table: DepthTable,
}

impl PointMaps {
    /// From the maps of all regions, in their order, all media, and each one's marcher.
    pub fn new(maps: Vec<Option<PointMap>>, media: &[Medium], marchers: Vec<Marcher>) -> Self {
        PointMaps { maps, phases: media.iter().map(|medium| lanes(&medium.phase)).collect(), marchers }
    }

    /// The maps that hold photons, with their regions.
    pub fn by_region(&self) -> impl Iterator<Item = (u32, &PointMap)> {
        self.maps.iter().enumerate().filter_map(|(region, map)| Some((region as u32, map.as_ref()?)))
    }

    /// Marches along a stretch: the light scattered once, and all other, as radiance at its start. `weight` is what light there counts, by channel; `walls` as for [`PointMap::gather`].
    pub fn gather(
        &self,
        (medium, reach, weight): (&Medium, &Reach, Rgb),
        walls: &impl Fn(Vec3, f32, &mut SmallVec<[Plane; 3]>),
        stream: &mut Stream,
        marching: &mut Marching,
        stats: &mut GatherStats,
    ) -> [Rgb; 2] {
        let Reach { ray, a, b, region, .. } = *reach;
        let region = region as usize;
        let Some(map) = &self.maps[region] else { return Default::default() };
        let Some((first, last)) = map.bounds().clip(&ray, a, b) else { return Default::default() };
        if marching.memories.len() <= region {
            marching.memories.resize_with(region + 1, PointMemory::default);
        }
        let memory = &mut marching.memories[region];
        let table = &mut marching.table;
        let depth = match medium.density {
            Density::Uniform => None,
            _ => {
                tabulate(medium, &ray, a, last, table);
                Some(&*table)
            }
        };
        let stretch = Stretch { ray: &ray, from: a, a: first, b: last, medium, depth, weight };
        let phase = &self.phases[reach.medium as usize];
        let mut source = |t: f64, _: &mut Stream| {
            let query =
                PointQuery { position: ray.at(t), direction: ray.direction, phase, max_events: reach.max_events };
            let (total, single) = map.gather(&query, walls, memory, stats).rgb();
            [total, single]
        };
        let marcher = &self.marchers[reach.medium as usize];
        let [total, single] = marcher.march(&stretch, stream, &mut marching.steps, &mut source);
        [single, total - single]
    }
}
