//! What is promised of beam queries in whatever scene.

use std::sync::Arc;

use glam::{DAffine3, DMat3};
use rayon::prelude::*;
use smallvec::SmallVec;

use super::depth::DepthTable;
use super::march::{Marcher, Stepping};
use super::{BeamQuery, EyeSegment, Fan, GatherStats, Marching, PhaseLanes, PointMaps, Queue, VolumeMaps};
use crate::math::random::Purpose;
use crate::math::{DVec3, Frame, Ray, Rgb, Stream, Vec3, sampling};
use crate::medium::density::bricks::{BrickGrid, Interpolation, NegativePolicy};
use crate::medium::density::{self, Density, Exponential, Grid};
use crate::medium::phase::{HenyeyGreenstein, Isotropic, Phase, Schlick};
use crate::medium::{Emission, Medium};
use crate::photon::kernel::Profile;
use crate::photon::{Ball, MapSettings, Photon, PhotonMap, Plane, PointMap, PointSettings, Radius};

/// Scenes that are made, and views of each.
const WORLDS: u64 = 250;
const VIEWS: usize = 40;

/// Random numbers with a shape.
struct Dice(Stream);

impl Dice {
    fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.0.uniform()
    }

    /// 10 to a power between these.
    fn decades(&mut self, low: f64, high: f64) -> f64 {
        10f64.powf(self.between(low, high))
    }

    fn below(&mut self, count: usize) -> usize {
        (self.0.uniform() * count as f64) as usize
    }

    fn chance(&mut self, chance: f64) -> bool {
        self.0.uniform() < chance
    }

    fn direction(&mut self) -> DVec3 {
        sampling::sphere(self.0.uniform2())
    }

    /// In [−1, 1]³.
    fn cube(&mut self) -> DVec3 {
        DVec3::from_array([0; 3].map(|_| self.between(-1.0, 1.0)))
    }
}

/// Photons and the medium they are in.
struct World {
    /// Half the edges of the box they are in, and its centre.
    half: DVec3,
    center: DVec3,
    medium: Medium,
    maps: VolumeMaps,
    /// The map within, and one of the same photons whose discs fall off less towards their rims.
    map: PhotonMap,
    fuller: PhotonMap,
    /// Whether queries can be compared: nothing is too dense, too large, or cut off by walls.
    comparable: bool,
}

/// Voxels along each axis, most often thousands along one of them.
fn voxels(dice: &mut Dice, half: DVec3, center: DVec3) -> Grid {
    const MOST: f64 = 30_000.0;
    let long = dice.decades(0.0, 3.6).ceil();
    let wide = dice.between(1.0, f64::min(long, MOST / long)).floor();
    let deep = dice.between(1.0, f64::min(long, MOST / (long * wide)).max(1.0)).floor();
    let mut edges = [long as usize, wide as usize, deep as usize];
    edges.rotate_left(dice.below(3));
    let emptiness = dice.between(0.0, 0.6);
    let values: Vec<f32> = (0..edges.into_iter().product())
        .map(|_| if dice.chance(emptiness) { 0.0 } else { dice.0.uniform() as f32 })
        .collect();
    let origin = [0; 3].map(|_| dice.between(-50.0, 50.0) as i32);
    let bricks = BrickGrid::from_dense(origin, edges, &values, 0.0, NegativePolicy::Error).expect("finite");
    let even = dice.chance(0.2);
    let bricks = bricks.with_interpolation(if even { Interpolation::Nearest } else { Interpolation::Trilinear });
    // The voxels fill the box, more or less, which makes them as uneven as it is; or they are turned, too.
    let count = DVec3::from_array(edges.map(|edge| edge as f64));
    let first = DVec3::from_array(origin.map(f64::from));
    let scale = 2.0 * half * dice.between(0.5, 2.0) / count;
    let turned = if dice.chance(0.5) {
        DMat3::from_axis_angle(dice.direction(), dice.between(0.0, 6.3))
    } else {
        DMat3::IDENTITY
    };
    let to_middle = DAffine3::from_translation(-(first + 0.5 * (count - 1.0)));
    let placed = DAffine3::from_mat3_translation(turned * DMat3::from_diagonal(scale), center);
    Grid::new(Arc::new(bricks), placed * to_middle)
}

fn world(dice: &mut Dice) -> World {
    let absurd = dice.chance(0.03);
    let extent = if absurd { dice.decades(15.0, 25.0) } else { dice.decades(-4.0, 5.0) };
    let half = DVec3::from_array([0; 3].map(|_| extent * dice.decades(-2.0, 0.0)));
    let center = if dice.chance(0.5) { DVec3::ZERO } else { dice.cube() * extent };
    let photons: Vec<Photon> = (0..1 + dice.below(300))
        .map(|_| Photon {
            position: (center + half * dice.cube()).as_vec3(),
            direction: dice.direction().as_vec3(),
            power: Vec3::from_array([0; 3].map(|_| dice.0.uniform() as f32)),
            events: dice.below(4) as u8,
            normal: Default::default(),
        })
        .collect();
    let radius = if dice.chance(0.5) {
        Radius::Fixed((extent * dice.decades(-1.5, 0.3)) as f32)
    } else {
        let max_radius = if dice.chance(0.5) { f32::INFINITY } else { (extent * dice.decades(-1.0, 0.0)) as f32 };
        Radius::Variable { neighbours: 1 + dice.below(60) as u32, pilot: 1 + dice.below(8) as u32, max_radius }
    };
    let walled = dice.chance(0.2);
    let planes = |x: Vec3, r: f32, _: f32, planes: &mut SmallVec<[Plane; 3]>| {
        for (axis, normal) in [Vec3::X, Vec3::Y, Vec3::Z].into_iter().enumerate() {
            let distance = (half[axis] - (f64::from(x[axis]) - center[axis]).abs()).max(0.0) as f32;
            if walled && distance < 2.0 * r {
                let side = if f64::from(x[axis]) < center[axis] { 1.0 } else { -1.0 };
                planes.push(Plane { normal: side * normal, distance, leans: false });
            }
        }
    };
    let air = |dice: &mut Dice| {
        let (up, scale_height) = (dice.direction(), extent * dice.decades(-1.0, 2.0));
        Density::Exponential(Exponential { origin: center, up, scale_height, value: 1.0 })
    };
    let density = match dice.below(7) {
        0 | 1 => Density::Uniform,
        2 => air(dice),
        3 => {
            let parts = [Density::Uniform, air(dice), Density::Grid(voxels(dice, half, center))];
            let part = |density| density::Part { weight: dice.between(0.1, 0.5), density };
            Density::Sum(density::Sum::new(parts.into_iter().map(part).collect()))
        }
        _ => Density::Grid(voxels(dice, half, center)),
    };
    // Photons in voxels count by the density, which rays together know less closely.
    let fluence = matches!(density, Density::Grid(_)) && dice.chance(0.5);
    let settings = MapSettings { tagged: dice.chance(0.5), fluence, ..MapSettings::new(radius) };
    let map = PhotonMap::build(photons.clone(), &settings, &planes);
    let fuller = PhotonMap::build(photons, &MapSettings { profile: Profile::Epanechnikov, ..settings }, &planes);
    // So thin that nowhere is left to roulette, or so dense that most is.
    let dense = dice.chance(0.1);
    let across = if dense { dice.decades(0.0, 6.0) } else { dice.decades(-2.0, 0.0) };
    let extinction = across / extent * if dice.chance(0.5) { Rgb::ONE } else { Rgb::new(0.0, 1.0, 0.3) };
    let phase = match dice.below(4) {
        0 => Phase::Isotropic(Isotropic),
        1 => Phase::Schlick(Schlick { k: dice.between(-0.9, 0.9) }),
        _ => Phase::HenyeyGreenstein(HenyeyGreenstein { g: dice.between(-0.9, 0.9) }),
    };
    let (albedo, phase) = (Rgb::ONE.into(), phase.into());
    let medium = Medium { name: String::new(), extinction, albedo, phase, density, emission: Emission::None };
    let maps = VolumeMaps::new(vec![Some(map.clone())], std::slice::from_ref(&medium), &[], super::Confines::default());
    World { half, center, medium, maps, map, fuller, comparable: !(absurd || dense || walled || fluence) }
}

/// Rays through neighbouring pixels, from a pinhole or a lens, near or far; and their fan.
fn view(dice: &mut Dice, world: &World) -> (Vec<EyeSegment>, Option<Fan>) {
    let extent = world.half.max_element();
    let target = world.center + world.half * dice.cube();
    let distance = if dice.chance(0.3) { extent * dice.between(0.0, 1.0) } else { extent * dice.decades(0.0, 4.5) };
    let from = target + distance * dice.direction();
    let frame = Frame::around((target - from).try_normalize().unwrap_or(DVec3::Z));
    let slope = extent * dice.decades(-3.0, 0.0) / distance.max(extent);
    let lens = if dice.chance(0.5) { 0.0 } else { extent * dice.decades(-4.0, -1.0) };
    // Nothing of what is in the box lies before this.
    let before = (distance - 4.0 * extent).max(0.0);
    let start = before + if dice.chance(0.5) { 0.0 } else { extent * dice.between(0.0, 3.0) };
    let end = if dice.chance(0.5) { f64::INFINITY } else { start + extent * dice.between(0.0, 6.0) };
    let max_events = if dice.chance(0.8) { u8::MAX } else { dice.below(4) as u8 };
    let from_camera = dice.chance(0.8);
    let rays = match &world.medium.density {
        Density::Grid(_) | Density::Sum(_) => 1 + dice.below(34),
        _ => 1 + dice.below(80),
    };
    let segments = (0..rays)
        .map(|_| {
            let (p, q) = sampling::disc(dice.0.uniform2());
            let origin = from + lens * (p * frame.x + q * frame.y);
            let [x, y] = [0; 2].map(|_| dice.between(-slope, slope));
            let direction = (from + distance.max(extent) * (frame.z + x * frame.x + y * frame.y) - origin).normalize();
            let ray = Ray::new(origin, direction);
            EyeSegment {
                ray,
                a: start,
                b: end,
                medium: 0,
                region: 0,
                solid: None,
                max_events,
                from_camera,
                passed: false,
                spread: false,
            }
        })
        .collect();
    let fan = (lens == 0.0).then(|| Fan { origin: from, frame, slope, rays: 20 + dice.below(200) });
    (segments, fan)
}

/// What one ray gathers by itself from `a` to `b`, all depths known.
fn alone(world: &World, map: &PhotonMap, segment: &EyeSegment, (a, b): (f64, f64)) -> [f64; 3] {
    let (phase, mut table) = (PhaseLanes::new(world.medium.phase.even().expect("one").clone()), DepthTable::new());
    let ray = &segment.ray;
    let end = map.bounds().clip(ray, a, b).map_or(a, |(_, end)| end);
    table.tabulate(&world.medium, ray, (a, end));
    // Depths are counted from where the ray's segment begins, wherever this one does.
    let before = world.medium.transmittance(world.medium.density.depth(ray, segment.a.min(a), segment.a.max(a)));
    let query = BeamQuery {
        origin: ray.at(a),
        direction: ray.direction,
        length: (b - a) as f32,
        phase: &phase,
        extinction: world.medium.extinction.as_vec3(),
        depth: (!matches!(world.medium.density, Density::Uniform)).then_some(&table),
        hull: None,
        max_events: segment.max_events,
        pruning: None,
    };
    let found = Vec3::from(map.gather(&query, &mut GatherStats::default()).total).as_dvec3();
    (if a < segment.a { found / before } else { found * before }).to_array()
}

/// Ten thousand views of all sorts of scenes: bundles and streams find what each ray finds by itself, whatever the
/// extent, the distance, the voxels and how uneven they are; and whatever is found is finite.
#[test]
fn rays_together_find_what_each_finds_alone() {
    let of_world = |number: u64| {
        let mut dice = Dice(Stream::new(41, Purpose::Test, number, 0));
        let world = world(&mut dice);
        let mut queue: Queue<usize> = Queue::default();
        let mut compared = 0;
        for turn in 0..VIEWS {
            let what = format!("world {number}, view {turn}");
            let (segments, fan) = view(&mut dice, &world);
            queue.begin(fan);
            queue.done.clear();
            for (index, segment) in segments.iter().enumerate() {
                let passed = world.maps.gather(&world.medium, *segment, Some(index), &mut queue);
                assert!(passed.is_finite() && passed.min_element() >= 0.0, "{what}: transmittance {passed}");
            }
            world.maps.gather_bundles(&mut queue);
            world.maps.gather_streams(&mut queue);
            let mut found = vec![[0.0; 3]; segments.len()];
            for (index, gathered) in &queue.done {
                found[*index] = gathered.total;
                let sound = |value: &f32| value.is_finite() && *value >= 0.0;
                assert!(gathered.total.iter().chain(&gathered.single).all(sound), "{what}: {gathered:?}");
            }
            if !world.comparable {
                continue;
            }
            for (segment, found) in segments.iter().zip(&found).step_by(1 + segments.len() / 6) {
                compare(&world, segment, found.map(f64::from), &what);
                compared += 1;
            }
        }
        compared
    };
    let compared: usize = (0..WORLDS).into_par_iter().map(of_world).sum();
    assert!(compared > 15_000, "{compared}");
}

/// Whether a ray found what it finds alone, as closely as its way of gathering promises.
fn compare(world: &World, segment: &EyeSegment, found: [f64; 3], what: &str) {
    let EyeSegment { a, b, .. } = *segment;
    let alone = |map: &PhotonMap, range: (f64, f64)| alone(world, map, segment, range);
    let expected = alone(&world.map, (a, b));
    let uniform = matches!(world.medium.density, Density::Uniform);
    let share = match uniform {
        // Streams differ by the order of their sums.
        true if !segment.from_camera => 3e-5,
        // Phase function and transmittance by a series.
        true => 4e-3,
        // Depths between the rays of a lattice, and transmittance between samples.
        false => 0.01 + 0.003 + 4e-3,
    };
    // Coordinates are rounded: in units of the smallest disc, and of the mean free path.
    let extent = world.center.abs().max_element() + 2.0 * world.half.length();
    let span = f64::min(b, a + 8.0 * world.half.length());
    let rounding = 4.0 * f64::from(f32::EPSILON) * (extent + world.map.bounds().diagonal() + span - a);
    let across = rounding / f64::from(world.map.radii().min);
    let along = rounding * world.medium.extinction.max_element();
    let near = |found: f64, low: f64, high: f64, fuller: f64| {
        let off = (share + along) * high + (if segment.from_camera { 1e-3 } else { 1e-5 } + across) * fuller;
        (low - off..=high + off).contains(&found)
    };
    if (0..3).all(|c| near(found[c], expected[c], expected[c], 0.0)) {
        return;
    }
    // Near its rim a disc hardly counts: how much is off is a share of what it would count if it fell off less. And
    // a photon may be on either side of an end.
    let ends = 4.0 * rounding;
    let low = alone(&world.map, (a + ends, (b - ends).max(a + ends)));
    let high = alone(&world.map, (a - ends, b + ends));
    let fuller = alone(&world.fuller, (a - ends, b + ends));
    assert!(
        (0..3).all(|c| near(found[c], low[c], high[c], fuller[c])),
        "{what}: {found:?} instead of {expected:?}, at least {low:?}, at most {high:?}, rims {fuller:?}, {segment:?}"
    );
}

/// Where fluence is even, matter of whatever density scatters by it, however wide discs and balls are: L = Φ/4π ∫ρ e^{−σD} dt, in
/// bundles, by rays of their own, and by points, in every channel.
#[test]
fn even_fluence_is_scattered_by_the_density() {
    const EDGE: usize = 60;
    let extinction = Rgb::new(1.5, 0.4, 3.0);
    let values: Vec<f32> = (0..16 * 16 * 16)
        .map(|i| {
            let [x, y, z] = [i / 256, i / 16 % 16, i % 16];
            // A dense block, a thin one, and nothing.
            if x < 6 { 2.0 } else { 0.3 * ((y + z) % 4) as f32 }
        })
        .collect();
    let bricks = BrickGrid::from_dense([-8; 3], [16; 3], &values, 0.0, NegativePolicy::Error).expect("finite");
    let medium = Medium {
        name: String::new(),
        extinction,
        albedo: Rgb::ONE.into(),
        phase: Phase::Isotropic(Isotropic).into(),
        density: Density::Grid(Grid::new(Arc::new(bricks), DAffine3::from_scale(DVec3::splat(0.1)))),
        emission: Emission::None,
    };
    let mut dice = Dice(Stream::new(42, Purpose::Test, 0, 0));
    let half = 1.4;
    // One in each cell of a lattice: their number varies less.
    let photons: Vec<Photon> = (0..EDGE.pow(3))
        .map(|i| {
            let cell = [i / EDGE.pow(2), i / EDGE % EDGE, i % EDGE].map(|cell| 2.0 * cell as f64 + 1.0);
            Photon {
                position: (half * ((DVec3::from_array(cell) + dice.cube()) / EDGE as f64 - 1.0)).as_vec3(),
                direction: Vec3::X,
                power: Vec3::ONE,
                events: 0,
                normal: Default::default(),
            }
        })
        .collect();
    let by_volume = (EDGE as f64 / (2.0 * half)).powi(3);
    let radius = Radius::Fixed(0.25);
    let settings = MapSettings { fluence: true, ..MapSettings::new(radius) };
    let map = PhotonMap::build(photons.clone(), &settings, &|_: Vec3, _: f32, _: f32, _: &mut SmallVec<[Plane; 3]>| {});
    let maps = VolumeMaps::new(vec![Some(map)], std::slice::from_ref(&medium), &[], super::Confines::default());
    let points = PointMap::build(
        photons,
        &PointSettings { fluence: true, ..PointSettings::new(Ball::Fixed(0.25)) },
        &|_, limit| limit,
    );
    let marchers = vec![Marcher { stepping: Stepping::Uniform, size: 0.04 }];
    let points =
        PointMaps::new(vec![Some(points)], std::slice::from_ref(&medium), &[], marchers, super::Confines::default());

    let mut queue: Queue<usize> = Queue::default();
    let (mut marching, mut expected, mut by_points) = (Marching::default(), [Rgb::ZERO; 2], Rgb::ZERO);
    let (from, rays) = (DVec3::new(0.9, 0.5, -6.0), 600);
    for ray in 0..rays {
        let direction = (DVec3::new(dice.between(-0.6, 0.6), dice.between(-0.6, 0.6), 0.0) - from).normalize();
        // Every other two rays begin and end where there is matter.
        let (a, b) = if ray % 4 < 2 { (0.0, 12.0) } else { (5.23, 6.51) };
        let segment = EyeSegment {
            ray: Ray::new(from, direction),
            a,
            b,
            medium: 0,
            region: 0,
            solid: None,
            max_events: 255,
            from_camera: ray % 2 == 0,
            passed: false,
            spread: false,
        };
        maps.gather(&medium, segment, Some(ray), &mut queue);
        let depth = medium.density.depth(&segment.ray, a, b);
        let light = (Rgb::ONE - medium.transmittance(depth)) / extinction * (by_volume / (4.0 * std::f64::consts::PI));
        expected[ray % 2] += light;
        let no_walls = |_: Vec3, _: f32, _: &mut SmallVec<[Plane; 3]>| {};
        let asked = (&medium, &segment, Rgb::ONE);
        by_points += points.gather(asked, &no_walls, &mut dice.0, &mut marching, &mut GatherStats::default())[1];
    }
    maps.gather_bundles(&mut queue);
    assert_eq!(queue.done.len(), rays);
    let mut sums = [Rgb::ZERO; 2];
    for (ray, gathered) in &queue.done {
        sums[ray % 2] += Rgb::from(Vec3::from(gathered.total).as_dvec3());
    }
    let all = expected[0] + expected[1];
    for (what, found, expected) in
        [("bundles", sums[0], expected[0]), ("alone", sums[1], expected[1]), ("points", by_points, all)]
    {
        let off = (found / expected - Rgb::ONE).map(f64::abs).max_element();
        assert!(off < 0.006, "{what}: {found}, not {expected}");
    }
}

/// Rays that were spread gather from the map of fewer photons where their region has one, together with others that do not.
#[test]
fn spread_rays_gather_from_fewer_photons() {
    let medium = Medium {
        name: String::new(),
        extinction: Rgb::splat(0.3),
        albedo: Rgb::ONE.into(),
        phase: Phase::Isotropic(Isotropic).into(),
        density: Density::Uniform,
        emission: Emission::None,
    };
    let mut dice = Dice(Stream::new(43, Purpose::Test, 0, 0));
    let positions: Vec<Vec3> = (0..500).map(|_| dice.cube().as_vec3()).collect();
    let photon = |power: f32, &position: &Vec3| Photon {
        position,
        direction: Vec3::X,
        power: Vec3::splat(power),
        events: 0,
        normal: Default::default(),
    };
    // The same photons, so that what is gathered tells the map by its power alone.
    let map = |power: f32| {
        let photons = positions.iter().map(|position| photon(power, position)).collect();
        let settings = MapSettings::new(Radius::Fixed(0.4));
        PhotonMap::build(photons, &settings, &|_: Vec3, _: f32, _: f32, _: &mut SmallVec<[Plane; 3]>| {})
    };
    let of = |maps| VolumeMaps::new(maps, std::slice::from_ref(&medium), &[], super::Confines::default());
    let maps = of(vec![Some(map(1.0)), Some(map(1.0))]).with_sparse(of(vec![Some(map(3.0)), None]));

    let mut queue: Queue<usize> = Queue::default();
    for number in 0..80 {
        // Eight rays on each line.
        let way = (number / 8) as f64;
        let ray = Ray::new(DVec3::new(0.1 * way - 0.5, 0.3, -4.0), DVec3::Z);
        let bit = |bit: usize| number >> bit & 1 == 1;
        let segment = EyeSegment {
            ray,
            a: 0.0,
            b: 8.0,
            medium: 0,
            region: u32::from(bit(0)),
            solid: None,
            max_events: 255,
            from_camera: bit(1),
            passed: false,
            spread: bit(2),
        };
        maps.gather(&medium, segment, Some(number), &mut queue);
    }
    maps.gather_bundles(&mut queue);
    maps.gather_streams(&mut queue);
    let mut found = [0.0; 80];
    for (number, gathered) in &queue.done {
        found[*number] += gathered.total[0];
    }
    for line in found.chunks(8) {
        assert!(line[0] > 0.0);
        for (number, light) in line.iter().enumerate() {
            let times = if number & 1 == 0 && number & 4 != 0 { 3.0 } else { 1.0 };
            assert!((light / (times * line[0]) - 1.0).abs() < 1e-4, "{number}: {light}, not {times} × {}", line[0]);
        }
    }
}
