//! What is promised of beam queries.

use super::BeamQuery;
use crate::gather::{DepthTable, GatherStats, Gathered, PhaseLanes};
use crate::math::random::{Purpose, Stream};
use crate::math::{DVec3, Vec3, sampling};
use crate::medium::phase::{Draine, HenyeyGreenstein, Isotropic, Mixture, Phase, Rayleigh, Schlick};
use crate::photon::kernel::Profile;
use crate::photon::simd::Isa;
use crate::photon::{MapSettings, Photon, PhotonMap, Plane, Radius};
use smallvec::SmallVec;
use std::f64::consts::PI;

type Planes = SmallVec<[Plane; 3]>;

fn no_walls(_: Vec3, _: f32, _: f32, _: &mut Planes) {}

/// The walls of the cube [−1, 1]³.
fn room(x: Vec3, r: f32, _: f32, planes: &mut Planes) {
    for axis in [Vec3::X, Vec3::Y, Vec3::Z] {
        for normal in [axis, -axis] {
            let distance = 1.0 + x.dot(normal);
            if distance < 2.0 * r {
                planes.push(Plane { normal, distance, leans: false });
            }
        }
    }
}

fn direction(stream: &mut Stream) -> DVec3 {
    sampling::sphere(stream.uniform2())
}

/// Photons in the cube [−1, 1]³; every second travels nearly along −z, some exactly.
fn photons(count: usize, stream: &mut Stream) -> Vec<Photon> {
    (0..count)
        .map(|i| {
            let spread = stream.uniform().powi(6);
            let direction = match i % 4 {
                0 => (direction(stream) * spread - DVec3::Z).normalize(),
                1 => -DVec3::Z,
                _ => direction(stream),
            };
            Photon {
                position: Vec3::from_array([0; 3].map(|_| (2.0 * stream.uniform() - 1.0) as f32)),
                direction: direction.as_vec3(),
                power: Vec3::from_array([0; 3].map(|_| stream.uniform() as f32)),
                events: (stream.uniform() * 4.0) as u8,
                normal: Default::default(),
            }
        })
        .collect()
}

/// Radii by a search through all photons.
fn radii(photons: &[Photon], radius: Radius) -> Vec<f64> {
    let (n, m, cap) = match radius {
        Radius::Fixed(r) => return vec![f64::from(r); photons.len()],
        Radius::Variable { neighbours, pilot, max_radius } => (neighbours, pilot as usize, max_radius),
    };
    let of = |photon: &Photon| {
        let distance = |other: &Photon| photon.position.as_dvec3().distance(other.position.as_dvec3());
        let mut distances: Vec<f64> = photons.iter().map(distance).collect();
        distances.sort_by(f64::total_cmp);
        let m = m.min(photons.len() - 1);
        if m == 0 { f64::from(cap) } else { (distances[m] * (f64::from(n) / m as f64).cbrt()).min(f64::from(cap)) }
    };
    photons.iter().map(of).collect()
}

/// The sum as the documentation has it, over all photons, in f64. Of a place `along` the ray, its depth and density.
fn reference(
    photons: &[Photon],
    (radii, profile): (&[f64], Profile),
    query: &BeamQuery,
    phase: &Phase,
    along: impl Fn(f64) -> (f64, f64),
    planes: impl Fn(Vec3, f32, f32, &mut Planes),
) -> ([f64; 3], [f64; 3]) {
    let (mut total, mut single) = ([0.0; 3], [0.0; 3]);
    let mut walls = Planes::new();
    'photons: for (photon, &r) in photons.iter().zip(radii) {
        let x = photon.position.as_dvec3();
        let t = (x - query.origin).dot(query.direction);
        let foot = query.origin + t * query.direction;
        if t <= 0.0 || t >= f64::from(query.length) || foot.distance(x) >= r || photon.events > query.max_events {
            continue;
        }
        let mut value = profile.disc(foot.distance(x) / r) / (r * r);
        value *= phase.value(photon.direction.as_dvec3().normalize(), -query.direction);
        walls.clear();
        planes(photon.position, r as f32, r as f32, &mut walls);
        walls.sort_by(|a, b| a.distance.total_cmp(&b.distance));
        for wall in walls.iter().take(3) {
            let normal = wall.normal.as_dvec3();
            let height = f64::from(wall.distance) + normal.dot(foot - x);
            if height <= 0.0 {
                continue 'photons;
            }
            value /= profile.disc_share(height / (r * normal.cross(query.direction).length()));
        }
        let (depth, density) = along(t);
        for channel in 0..3 {
            let transmittance = (-f64::from(query.extinction[channel]) * depth).exp();
            let part = value * density * transmittance * f64::from(photon.power[channel]);
            total[channel] += part;
            if photon.events == 0 {
                single[channel] += part;
            }
        }
    }
    (total, single)
}

fn check(got: [f32; 3], expected: [f64; 3], what: &dyn std::fmt::Debug) {
    let largest = expected.into_iter().fold(0.0, f64::max);
    for channel in 0..3 {
        let error = (f64::from(got[channel]) - expected[channel]).abs();
        assert!(error <= 4e-5 * largest, "{what:?}: {got:?} instead of {expected:?}");
    }
}

/// A density along a ray and its integral.
fn smooth(t: f64) -> (f64, f64) {
    (1.2 * t + (1.0 - (3.0 * t).cos()) / 3.0, 1.2 + (3.0 * t).sin())
}

#[test]
fn queries_equal_the_sum_over_all_photons() {
    let sum = |lobes: [(f64, Phase); 2]| Phase::from(Mixture::new(lobes.into()));
    let phases: Vec<Phase> = vec![
        Isotropic.into(),
        HenyeyGreenstein { g: 0.75 }.into(),
        HenyeyGreenstein { g: -0.5 }.into(),
        HenyeyGreenstein { g: 0.9999 }.into(),
        HenyeyGreenstein { g: -0.99 }.into(),
        Schlick { k: -0.7 }.into(),
        Schlick { k: 0.999 }.into(),
        Rayleigh.into(),
        sum([
            (0.5, sum([(0.6, Isotropic.into()), (0.4, Rayleigh.into())])),
            (0.5, sum([(0.8, HenyeyGreenstein { g: 0.3 }.into()), (0.2, Schlick { k: -0.2 }.into())])),
        ]),
        sum([(0.49, HenyeyGreenstein { g: 0.998 }.into()), (0.51, Draine { g: 0.63, alpha: 32.0 }.into())]),
    ];
    let variable = Radius::Variable { neighbours: 40, pilot: 7, max_radius: 0.6 };
    let counts = [1, 15, 16, 17, 1000, 1000, 300, 300];
    let profiles = [Profile::Biweight, Profile::Epanechnikov, Profile::Constant];
    let mut table = DepthTable::new();
    for i in 0..=1000 {
        let t = f64::from(i) * 0.01;
        let (depth, density) = smooth(t);
        table.push(t, depth, density);
    }
    table.finish();
    let mut found = 0;
    for (case, &count) in counts.iter().enumerate() {
        let mut stream = Stream::new(11, Purpose::Test, case as u64, 0);
        let photons = photons(count, &mut stream);
        let radius = if case % 2 == 0 { variable } else { Radius::Fixed(0.4) };
        let profile = profiles[if case > 5 { 2 } else { case / 2 % 2 }];
        let settings = MapSettings { tagged: true, profile, ..MapSettings::new(radius) };
        let walled = case != 4;
        let planes = if walled { room } else { no_walls };
        let mut map = PhotonMap::build(photons.clone(), &settings, &planes);
        let radii = radii(&photons, radius);
        for number in 0..90 {
            let phase = &phases[number % phases.len()];
            let towards = photons[number % count].position.as_dvec3();
            let direction = match number % 5 {
                0 => DVec3::Z,
                1 => DVec3::X,
                2 => (DVec3::Z + 1e-4 * direction(&mut stream)).normalize(),
                _ => direction(&mut stream),
            };
            // Every sixth ray passes exactly through a photon; distances from 0 to far away.
            let aside = if number % 6 == 0 { 0.0 } else { 0.2 };
            let back = [0.3, 1.0, 2.5, 1000.0][number % 4];
            let origin = towards + aside * self::direction(&mut stream) - back * direction;
            let tabulated = number % 3 == 2 && back < 5.0;
            let query = BeamQuery {
                origin,
                direction,
                length: [f32::INFINITY, 0.8, 1000.4, 2.0][number / 2 % 4],
                phase: &PhaseLanes::new(phase.clone()),
                extinction: if back > 5.0 {
                    Vec3::splat(1e-3)
                } else {
                    [Vec3::splat(0.7), Vec3::new(0.0, 0.5, 3.0), Vec3::ZERO][number % 7 % 3]
                },
                depth: tabulated.then_some(&table),
                hull: None,
                max_events: if number % 4 == 1 { 2 } else { 255 },
                pruning: None,
            };
            let depth = |t| if tabulated { smooth(t).0 } else { t };
            // Photons in voxels count by the density.
            map.fluence = tabulated && number % 2 == 0;
            let density = |t| if map.fluence { smooth(t).1 } else { 1.0 };
            let along = |t| (depth(t), density(t));
            let (total, single) = reference(&photons, (&radii, profile), &query, phase, along, planes);
            found += usize::from(total[0] > 0.0);
            for isa in Isa::available() {
                map.isa = isa;
                for boxes in [false, true] {
                    map.boxes = boxes;
                    let got = map.gather(&query, &mut GatherStats::default());
                    let what = (isa, boxes, count, number, phase);
                    check(got.total, total, &what);
                    check(got.single, single, &what);
                }
            }
        }
    }
    assert!(found > 250, "only {found} rays met photons");
}

#[test]
fn instruction_sets_agree() {
    let mut stream = Stream::new(12, Purpose::Test, 0, 0);
    let photons = photons(20_000, &mut stream);
    let radius = Radius::Variable { neighbours: 100, pilot: 10, max_radius: 0.3 };
    let mut map = PhotonMap::build(photons, &MapSettings::new(radius), &room);
    let phase = PhaseLanes::new(HenyeyGreenstein { g: 0.6 });
    for _ in 0..50 {
        let query = BeamQuery {
            origin: 0.5 * direction(&mut stream),
            direction: direction(&mut stream),
            length: 1.0,
            phase: &phase,
            extinction: Vec3::new(0.2, 0.4, 0.8),
            depth: None,
            hull: None,
            max_events: 255,
            pruning: None,
        };
        let results: Vec<[f32; 3]> = Isa::available()
            .into_iter()
            .map(|isa| {
                map.isa = isa;
                map.gather(&query, &mut GatherStats::default()).total
            })
            .collect();
        for other in &results[1..] {
            for channel in 0..3 {
                let (a, b) = (results[0][channel], other[channel]);
                assert!((a - b).abs() <= 1e-5 * a, "{results:?}");
            }
        }
    }
}

/// Photons everywhere alike below a boundary, mean free path 1: a ray gathers q/(4π σ) at any angle, even where
/// discs are several mean free paths wide, and no less next to another wall; and where light grows with depth, it
/// is that of the right depth: ∫ (1 + z cos θ) e^{−z} dz = 1 + cos θ.
#[test]
fn leaning_discs_keep_depths_apart() {
    const N: usize = 400_000;
    const HALF: f64 = 12.0;
    const DEPTH: f64 = 8.0;
    let boundary = |x: Vec3, r: f32, _: f32, planes: &mut Planes| {
        planes.push(Plane { normal: -Vec3::Z, distance: -x.z, leans: true });
        let distance = x.x + HALF as f32;
        if distance < 2.0 * r {
            planes.push(Plane { normal: Vec3::X, distance, leans: false });
        }
    };
    let mut stream = Stream::new(13, Purpose::Test, 0, 0);
    let volume = 4.0 * HALF * HALF * DEPTH;
    let photons: Vec<Photon> = (0..N)
        .map(|_| {
            let x = |stream: &mut Stream| (2.0 * stream.uniform() - 1.0) * HALF;
            let position = DVec3::new(x(&mut stream), x(&mut stream), -DEPTH * stream.uniform());
            let power = Vec3::new(1.0, 1.0 - position.z as f32, 1.0) * (volume / N as f64) as f32;
            Photon { position: position.as_vec3(), direction: Vec3::X, power, events: 0, normal: Default::default() }
        })
        .collect();
    let phase = PhaseLanes::new(Isotropic);
    for radius in [0.7, 3.0] {
        let mut map = PhotonMap::build(photons.clone(), &MapSettings::new(Radius::Fixed(radius)), &boundary);
        assert!(map.leans());
        for cos in [1.0f64, 0.7, 0.3, 0.15] {
            let mut means = Vec::new();
            let sets = if cos == 0.3 { Isa::available() } else { vec![Isa::best()] };
            for isa in sets {
                map.isa = isa;
                let mut sum = DVec3::ZERO;
                let rays = if radius < 1.0 { 400 } else { 60 };
                let mut stream = Stream::new(14, Purpose::Test, 0, 0);
                for ray in 0..rays {
                    let (x, y) = (8.0 * stream.uniform() - 4.0, 8.0 * stream.uniform() - 4.0);
                    let sin = (1.0 - cos * cos).sqrt();
                    // Every second one next to the other wall, along it.
                    let (x, towards) = if ray % 2 == 0 { (x, DVec3::X) } else { (0.3 - HALF, DVec3::Y) };
                    let query = BeamQuery {
                        origin: DVec3::new(x, y, 0.0),
                        direction: DVec3::new(0.0, 0.0, -cos) + sin * towards,
                        length: f32::INFINITY,
                        phase: &phase,
                        extinction: Vec3::ONE,
                        depth: None,
                        hull: None,
                        max_events: 255,
                        pruning: None,
                    };
                    let total = map.gather(&query, &mut GatherStats::default()).total;
                    sum += DVec3::from_array(total.map(f64::from)) * (4.0 * PI / rays as f64);
                }
                assert!((sum.x - 1.0).abs() < 0.02, "r = {radius}, cos = {cos}: {sum}");
                assert!((sum.y / (1.0 + cos) - 1.0).abs() < 0.02, "r = {radius}, cos = {cos}: {sum}");
                means.push(sum);
            }
            assert!(means.iter().all(|mean| mean.distance(means[0]) < 1e-4 * means[0].length()));
        }
    }
}

#[test]
fn photons_at_one_place_give_a_finite_sum() {
    let one = Photon {
        position: Vec3::new(0.3, -4.0, 2.0),
        direction: Vec3::X,
        power: Vec3::ONE,
        events: 0,
        normal: Default::default(),
    };
    let phase = PhaseLanes::new(Isotropic);
    for radius in [Radius::Fixed(0.5), Radius::Variable { neighbours: 500, pilot: 23, max_radius: 0.5 }] {
        let map = PhotonMap::build(vec![one; 40_000], &MapSettings::new(radius), &no_walls);
        let r = f64::from(map.radii().mean);
        assert!(r > 0.0 && map.radii().min == map.radii().max);
        let mut query = BeamQuery {
            origin: DVec3::new(0.3f32.into(), -4.0, 0.0),
            direction: DVec3::Z,
            length: f32::INFINITY,
            phase: &phase,
            extinction: Vec3::splat(0.1),
            depth: None,
            hull: None,
            max_events: 255,
            pruning: None,
        };
        let mut stats = GatherStats::default();
        let got = map.gather(&query, &mut stats);
        let expected = 40_000.0 * Profile::Biweight.disc(0.0) / (r * r) * (-0.2f64).exp() * 0.25 / PI;
        check(got.total, [expected; 3], &radius);
        assert_eq!((got.single, stats.photons), ([0.0; 3], 40_000));
        // The segment ends at the photons, or starts there: both ends are open.
        query.length = 2.0;
        assert_eq!(map.gather(&query, &mut stats), Gathered::default());
        query.origin.z = 2.0;
        assert_eq!(map.gather(&query, &mut stats), Gathered::default());
    }
    let empty = PhotonMap::build(Vec::new(), &MapSettings::new(Radius::Fixed(0.5)), &no_walls);
    let query = BeamQuery {
        origin: DVec3::ZERO,
        direction: DVec3::Z,
        length: 1.0,
        phase: &phase,
        extinction: Vec3::ONE,
        depth: None,
        hull: None,
        max_events: 255,
        pruning: None,
    };
    assert_eq!(empty.gather(&query, &mut GatherStats::default()), Gathered::default());
}

/// Photons spread evenly in a room scatter 1/4π of their power density into every direction:
/// L = q/4π (1 − e^{−σs})/σ, inside, through faces, along a wall and into a corner.
#[test]
fn an_even_density_gives_the_closed_form() {
    const COUNT: usize = 500_000;
    const SIGMA: f64 = 0.5;
    let phase = PhaseLanes::new(Isotropic);
    let cap = 0.12;
    let variable = Radius::Variable { neighbours: 200, pilot: 14, max_radius: cap };
    for (case, radius) in [Radius::Fixed(cap), variable].into_iter().enumerate() {
        let mut stream = Stream::new(13, Purpose::Test, case as u64, 0);
        let photon = |_| Photon {
            position: Vec3::from_array([0; 3].map(|_| (2.0 * stream.uniform() - 1.0) as f32)),
            direction: Vec3::Y,
            power: Vec3::splat(1e-3),
            events: 0,
            normal: Default::default(),
        };
        let map = PhotonMap::build((0..COUNT).map(photon).collect(), &MapSettings::new(radius), &room);
        let plain = MapSettings { boundaries: false, ..MapSettings::new(radius) };
        let density = 1e-3 * COUNT as f64 / 8.0;
        let photons = map.discs().map(|disc| Photon { power: Vec3::splat(1e-3), ..disc.photon });
        let uncorrected = PhotonMap::build(photons.collect(), &plain, &no_walls);
        let r = f64::from(map.radii().mean);
        let oblique = DVec3::new(1.0, 1.0, 0.0).normalize();
        let near = 0.3 * r - 1.0;
        // A direction, a row of starting points a diameter apart, where the segment ends, and
        // whether walls must be known.
        type Start = fn(f64, f64) -> DVec3;
        let inside: Start = |s, _| DVec3::new(s, 0.3, -0.7);
        let outside: Start = |s, _| DVec3::new(s, -0.2, -1.0);
        let along: Start = |s, near| DVec3::new(s, near, -0.7);
        let corner: Start = |s, _| DVec3::new(0.0, 0.0, s);
        for (start, direction, length, walled) in [
            (inside, DVec3::Z, 1.4, false),
            (outside, DVec3::Z, f64::INFINITY, false),
            (along, DVec3::Z, 1.4, true),
            (corner, oblique, 2f64.sqrt(), true),
        ] {
            let path = if length.is_finite() { length } else { 2.0 };
            let expected = density / (4.0 * PI) * (1.0 - (-SIGMA * path).exp()) / SIGMA;
            let rays = 6;
            let (mut sum, mut plain_sum) = (0.0, 0.0);
            for i in 0..rays {
                let s = -0.7 + 1.4 * (f64::from(i) + 0.5) / f64::from(rays);
                let query = BeamQuery {
                    origin: start(s, near),
                    direction,
                    length: length as f32,
                    phase: &phase,
                    extinction: Vec3::splat(SIGMA as f32),
                    depth: None,
                    hull: None,
                    max_events: 255,
                    pruning: None,
                };
                sum += f64::from(map.gather(&query, &mut GatherStats::default()).total[0]);
                plain_sum += f64::from(uncorrected.gather(&query, &mut GatherStats::default()).total[0]);
            }
            let mean = sum / f64::from(rays);
            // Var = ∫ (K₂/r²)² T² dV P q/(4π)² for fixed radii, where ∫ K₂² = 9/5π; dividing by
            // a share of at least one half at most doubles it, and radii that vary by a few
            // percent hardly change it.
            let squares = 9.0 / (5.0 * PI * r * r) * (1.0 - (-2.0 * SIGMA * path).exp()) / (2.0 * SIGMA);
            let variance = squares * density * 1e-3 / (16.0 * PI * PI) * if walled { 2.0 } else { 1.0 };
            let error = (variance / f64::from(rays)).sqrt();
            assert!(error < 0.02 * expected);
            assert!((mean - expected).abs() < 3.0 * error, "{radius:?} {path}: {mean} {expected} {error}");
            if start(0.0, near) == along(0.0, near) {
                let lost = plain_sum / f64::from(rays) / expected;
                let share = Profile::Biweight.disc_share(0.3);
                assert!((lost - share).abs() < 0.05, "{lost} of the light is left, {share} expected");
            }
        }
    }
}
