//! What bundles promise.

use super::*;
use crate::gather::beam::BeamQuery;
use crate::gather::{SampledDepths, Samples, StreamScratch};
use crate::math::random::{Purpose, Stream};
use crate::math::{Frame, Ray, Vec3, sampling};
use crate::medium::density::bricks::{BrickGrid, NegativePolicy};
use crate::medium::density::{Density, Grid};
use crate::medium::phase::{Draine, HenyeyGreenstein, Isotropic, Mixture, Peak, Rayleigh, Schlick, mie};
use crate::photon::{MapSettings, Photon, Plane, Radius};
use glam::DAffine3;
use smallvec::SmallVec;
use std::sync::Arc;

/// Photons in the cube [−1, 1]³, denser towards its middle.
fn photons(count: usize) -> Vec<Photon> {
    let mut stream = Stream::new(21, Purpose::Test, 0, 0);
    let mut coordinate = |i: usize| {
        let u = 2.0 * stream.uniform() - 1.0;
        if i.is_multiple_of(3) { u.powi(3) } else { u }
    };
    let positions: Vec<DVec3> = (0..count).map(|i| DVec3::new(coordinate(i), coordinate(i), coordinate(i))).collect();
    positions
        .into_iter()
        .map(|position| Photon {
            position: position.as_vec3(),
            direction: sampling::sphere(stream.uniform2()).as_vec3(),
            power: Vec3::new(stream.uniform() as f32, stream.uniform() as f32, 0.5),
            events: (4.0 * stream.uniform()) as u8,
            normal: Default::default(),
        })
        .collect()
}

/// The cube's faces as walls.
fn room(x: Vec3, r: f32, _: f32, planes: &mut SmallVec<[Plane; 3]>) {
    for axis in [Vec3::X, Vec3::Y, Vec3::Z] {
        for normal in [axis, -axis] {
            let distance = 1.0 + x.dot(normal);
            if distance < 2.0 * r {
                planes.push(Plane { normal, distance, leans: false });
            }
        }
    }
}

/// Rays from a lens of this radius at `from` through 8 × 8 pixels, four each, each pixel `pixel` wide.
fn rays(from: DVec3, lens: f64, pixel: f64, (a, b): (f64, f64)) -> Vec<(Ray, f64, f64)> {
    let mut stream = Stream::new(22, Purpose::Test, 0, 0);
    let frame = Frame::around((DVec3::new(0.1, -0.2, 0.05) - from).normalize());
    let distance = from.length();
    (0..256u32)
        .map(|i| {
            let code = i / 4;
            let half = |code: u32| f64::from(code & 1 | code >> 1 & 2 | code >> 2 & 4);
            let [u, v] = stream.uniform2();
            let (x, y) = (pixel * (half(code) + u), pixel * (half(code >> 1) + v));
            let (p, q) = sampling::disc(stream.uniform2());
            let start = from + lens * (p * frame.x + q * frame.y);
            let target = from + distance * (frame.z + x * frame.x + y * frame.y);
            let jitter = 0.01 * stream.uniform();
            (Ray::new(start, (target - start).normalize()), a + jitter, b - jitter)
        })
        .collect()
}

#[test]
fn bundles_gather_what_their_rays_gather() {
    const BELOW_PEAKS: usize = 7;
    let lobes = [
        PhaseLanes::new(Isotropic),
        PhaseLanes::new(HenyeyGreenstein { g: 0.75 }),
        PhaseLanes::new(HenyeyGreenstein { g: -0.93 }),
        PhaseLanes::new(Schlick { k: 0.6 }),
        PhaseLanes::new(Rayleigh),
        PhaseLanes::new(Mixture::new(vec![
            (0.7, HenyeyGreenstein { g: 0.8 }.into()),
            (0.3, Schlick { k: -0.4 }.into()),
        ])),
        PhaseLanes::new(Mixture::new(vec![
            (0.55, HenyeyGreenstein { g: 0.97 }.into()),
            (0.45, Draine { g: -0.5, alpha: 17.0 }.into()),
        ])),
        PhaseLanes::below(&Peak::new(&HenyeyGreenstein { g: 0.93 }.into(), 4.0)),
        PhaseLanes::below(&Peak::new(&mie(12.0).into(), 4.0)),
    ];
    let far = DVec3::new(3.0, 1.0, -4.0);
    let views = [
        ("outside", rays(far, 0.0, 0.003, (0.0, f64::INFINITY))),
        ("through a lens", rays(far, 0.05, 0.003, (0.0, f64::INFINITY))),
        ("from within", rays(DVec3::new(0.3, 0.2, -0.4), 0.0, 0.004, (0.1, 0.8))),
        ("from far away", rays(1e5 * far, 1e-3, 1e-8, (509_899.5, 509_904.0))),
        ("wide", rays(far, 0.0, 0.2, (0.0, f64::INFINITY))),
    ];
    let photons = photons(20_000);
    let variable = Radius::Variable { neighbours: 60, pilot: 8, max_radius: 0.3 };
    for (tagged, walled) in [(false, false), (true, true)] {
        let settings = MapSettings { tagged, ..MapSettings::new(variable) };
        let planes = |x: Vec3, r: f32, mean: f32, planes: &mut SmallVec<[Plane; 3]>| {
            if walled {
                room(x, r, mean, planes);
            }
        };
        let map = PhotonMap::build(photons.clone(), &settings, &planes);
        let (mut scratch, mut gathered) = (BundleScratch::default(), Vec::new());
        let mut table = DepthTable::new();
        let (mut stream, mut streamed) = (StreamScratch::default(), Vec::<Gathered>::new());
        for (name, rays) in &views {
            for (number, phase) in lobes.iter().enumerate() {
                let extinction = if number % 2 == 0 { Vec3::splat(0.7) } else { Vec3::new(0.2, 0.9, 2.0) };
                let max_events = if tagged && number > 2 { 2 } else { u8::MAX };
                let bundle = Bundle { rays, phase, extinction, max_events, pruned: false, depths: None };
                let mut stats = GatherStats::default();
                map.gather_bundle(&bundle, &mut scratch, &mut stats, &mut gathered);
                assert_eq!(gathered.len(), rays.len());
                let (mut seen, mut squares, mut largest) = (0.0, 0.0, 0.0f64);
                for (index, bundled) in gathered.iter().enumerate() {
                    let single = bundle.gather_alone(&map, index, &mut table, &mut GatherStats::default());
                    for c in 0..3 {
                        seen += f64::from(single.total[c]).powi(2);
                        for (x, y) in [(single.total, bundled.total), (single.single, bundled.single)] {
                            let off = f64::from(x[c] - y[c]).abs();
                            squares += off.powi(2);
                            largest = largest.max(off / f64::from(single.total[c].max(f32::MIN_POSITIVE)));
                        }
                    }
                }
                assert!(seen > 0.0, "{name}, phase {number}: nothing seen");
                let off = (squares / seen).sqrt();
                map.gather_stream(&bundle, &mut stream, &mut GatherStats::default(), &mut streamed);
                for (index, streamed) in streamed.iter().enumerate() {
                    let single = bundle.gather_alone(&map, index, &mut table, &mut GatherStats::default());
                    for c in 0..3 {
                        for (x, y) in [(single.total, streamed.total), (single.single, streamed.single)] {
                            assert!((x[c] - y[c]).abs() <= 2e-5 * single.total[c], "{name}: {x:?} {y:?}");
                        }
                    }
                }
                // Single rays may have a photon on their end, on one side of it here, on the other there. The bend below a peak
                // counts in the second order, which is left out.
                let (most, at_worst) = if number < BELOW_PEAKS { (3e-4, 4e-3) } else { (1e-3, 1e-2) };
                assert!(
                    off < most && largest < at_worst,
                    "{name}, phase {number}, walls {walled}: {off:.1e} {largest:.1e}"
                );
            }
        }
    }
}

/// What all photons of a map share is not stored, and no query answers otherwise for that: grey light scattered alike in all directions takes
/// 25 bytes a photon at most, 21 with one radius.
#[test]
fn what_photons_share_is_not_stored() {
    let mut photons = photons(20_000);
    for photon in &mut photons {
        photon.power = Vec3::splat(photon.power.x);
    }
    let coloured = photons.iter().map(|photon| Photon { power: photon.power * Vec3::new(1.0, 1.0, 0.5), ..*photon });
    let coloured: Vec<Photon> = coloured.collect();
    let rays = rays(DVec3::new(3.0, 1.0, -4.0), 0.05, 0.003, (0.0, f64::INFINITY));
    let no_walls = |_: Vec3, _: f32, _: f32, _: &mut _| ();
    let variable = Radius::Variable { neighbours: 60, pilot: 8, max_radius: 0.3 };
    for (radius, most) in [(Radius::Fixed(0.1), 21.0), (variable, 25.0)] {
        let build = |photons: &Vec<Photon>, directions| {
            PhotonMap::build(photons.clone(), &MapSettings { directions, ..MapSettings::new(radius) }, &no_walls)
        };
        let (lean, full) = (build(&photons, false), build(&coloured, true));
        let [lean_bytes, full_bytes] = [&lean, &full].map(|map| map.bytes() as f64 / map.len() as f64);
        assert!(lean_bytes < most && full_bytes > lean_bytes + 19.9, "{lean_bytes} and {full_bytes} bytes a photon");
        let phase = &PhaseLanes::new(Isotropic);
        let extinction = Vec3::splat(0.7);
        let bundle = Bundle { rays: &rays, phase, extinction, max_events: u8::MAX, pruned: false, depths: None };
        let found = [&lean, &full].map(|map| {
            let (mut stats, mut gathered, mut streamed) = Default::default();
            map.gather_bundle(&bundle, &mut BundleScratch::default(), &mut stats, &mut gathered);
            map.gather_stream(&bundle, &mut StreamScratch::default(), &mut stats, &mut streamed);
            let mut table = DepthTable::new();
            let alone = (0..rays.len()).map(|ray| bundle.gather_alone(map, ray, &mut table, &mut stats));
            [gathered, streamed, alone.collect()]
        });
        let mut seen = 0.0;
        for (lean, full) in found[0].iter().flatten().zip(found[1].iter().flatten()) {
            let [red, green, blue] = lean.total;
            assert!(red == full.total[0] && green == full.total[1] && blue == red, "{lean:?} {full:?}");
            seen += red;
        }
        assert!(seen > 0.0);
    }
}

/// Light that grows as it gets fainter on its way: much of it arrives from where roulette decides.
#[test]
fn pruned_rays_are_right_on_average() {
    let mut photons = photons(20_000);
    for photon in &mut photons {
        photon.power *= (9.0 * photon.position.z).exp();
    }
    let settings = MapSettings::new(Radius::Variable { neighbours: 60, pilot: 8, max_radius: 0.3 });
    let map = PhotonMap::build(photons, &settings, &|_: Vec3, _: f32, _: f32, _: &mut _| ());
    let phase = PhaseLanes::new(HenyeyGreenstein { g: 0.3 });
    let density = Density::Uniform;
    for extinction in [Vec3::splat(10.0), Vec3::new(12.0, 9.0, 10.0)] {
        // Each ray by itself, its number going through all.
        let query = BeamQuery {
            origin: DVec3::new(0.1, 0.2, -1.5),
            direction: DVec3::Z,
            length: 1.4,
            phase: &phase,
            extinction,
            depth: None,
            hull: None,
            max_events: u8::MAX,
            pruning: None,
        };
        let (mut whole, mut short) = (GatherStats::default(), GatherStats::default());
        let expected = Vec3::from(map.gather(&query, &mut whole).total);
        let mut table = DepthTable::new();
        for knot in 0..=14 {
            let t = 0.1 * f64::from(knot);
            table.push(t, density.depth(&Ray::new(query.origin, query.direction), 0.0, t), 1.0);
        }
        table.finish();
        for depth in [None, Some(&table)] {
            let mut mean = DVec3::ZERO;
            for i in 0..1000 {
                let query = BeamQuery { depth, pruning: Some((i as f32 + 0.5) * 1e-3), ..query };
                mean += Vec3::from(map.gather(&query, &mut short).total).as_dvec3() * 1e-3;
            }
            let off = (mean / expected.as_dvec3() - 1.0).abs().max_element();
            assert!(off < 2e-3, "{mean} for {expected}");
        }
        assert!(short.photons < 1900 * whole.photons, "{} and {} photons", short.photons, whole.photons);

        // Bundles and streams, whose rays bring their numbers.
        let (mut scratch, mut streams) = (BundleScratch::default(), StreamScratch::default());
        let (mut gathered, mut streamed) = (Vec::new(), Vec::new());
        let mut stats = [GatherStats::default(); 3];
        let mut sums = [DVec3::ZERO; 3];
        for turn in 0..600 {
            let from = DVec3::new(0.1 + 1e-4 * f64::from(turn), 0.2, -1.5);
            let rays = rays(from, 0.0, 0.001, (0.02, 1.4));
            let bundle =
                Bundle { rays: &rays, phase: &phase, extinction, max_events: u8::MAX, pruned: true, depths: None };
            map.gather_bundle(&bundle, &mut scratch, &mut stats[0], &mut gathered);
            map.gather_stream(&bundle, &mut streams, &mut stats[1], &mut streamed);
            let [bundles, streams, wholes] = &mut sums;
            *bundles += gathered.iter().map(|ray| Vec3::from(ray.total).as_dvec3()).sum::<DVec3>();
            *streams += streamed.iter().map(|ray| Vec3::from(ray.total).as_dvec3()).sum::<DVec3>();
            map.gather_bundle(&Bundle { pruned: false, ..bundle }, &mut scratch, &mut stats[2], &mut gathered);
            *wholes += gathered.iter().map(|ray| Vec3::from(ray.total).as_dvec3()).sum::<DVec3>();
        }
        // The weights 1/P of what is beyond vary by less than their mean; 2400 groups have a number each.
        for sum in &sums[..2] {
            let off = (*sum / sums[2] - 1.0).abs().max_element();
            assert!(off < 0.06, "{sum} for {}", sums[2]);
        }
        assert!(stats[0].photons < stats[2].photons && stats[1].photons < stats[2].photons);
    }
}

/// Uneven voxels on the cube and beyond.
fn voxels() -> Density {
    let values: Vec<f32> = (0..24 * 24 * 24).map(|i| if i % 5 == 0 { 0.0 } else { (i % 7) as f32 * 0.5 }).collect();
    let bricks = BrickGrid::from_dense([-12; 3], [24; 3], &values, 0.0, NegativePolicy::Error).expect("finite");
    Density::Grid(Grid::new(Arc::new(bricks), DAffine3::from_scale(DVec3::splat(0.12))))
}

#[test]
fn bundles_know_uneven_depths() {
    let density = voxels();
    let settings = MapSettings::new(Radius::Variable { neighbours: 60, pilot: 8, max_radius: 0.3 });
    let mut map = PhotonMap::build(photons(20_000), &settings, &|_: Vec3, _: f32, _: f32, _: &mut _| ());
    let phase = PhaseLanes::new(HenyeyGreenstein { g: 0.6 });
    let (mut scratch, mut gathered) = (BundleScratch::default(), Vec::new());
    let views = [
        ("narrow", rays(DVec3::new(3.0, 1.0, -4.0), 0.0, 0.003, (2.5, 8.0))),
        ("through a lens", rays(DVec3::new(3.0, 1.0, -4.0), 0.1, 0.003, (2.5, 8.0))),
        ("wide", rays(DVec3::new(3.0, 1.0, -4.0), 0.0, 0.1, (2.5, 8.0))),
    ];
    for (number, (name, rays)) in (0..).zip(views.iter().chain(&views)) {
        // Where photons count by the density, samples know it as the mean over two steps, here two thirds of a voxel.
        map.fluence = number >= views.len();
        for extinction in [Vec3::splat(0.9), Vec3::new(0.3, 1.0, 1.5)] {
            let mut depths = SampledDepths::default();
            let samples: Vec<Samples> = rays
                .iter()
                .map(|(ray, a, b)| depths.sample(&density, 0.04, ray, (*a, *b), 0.15).expect("few and small").0)
                .collect();
            let depths = Some((&depths, 0.04, &*samples));
            let bundle = Bundle { rays, phase: &phase, extinction, max_events: u8::MAX, pruned: false, depths };
            map.gather_bundle(&bundle, &mut scratch, &mut GatherStats::default(), &mut gathered);
            let (mut seen, mut squares, mut sum) = (0.0, 0.0, 0.0);
            for ((ray, a, b), bundled) in rays.iter().zip(&gathered) {
                // An independent table, of many exact knots.
                let mut table = DepthTable::new();
                for knot in 0..=600 {
                    let t = (b - a) * f64::from(knot) / 600.0;
                    table.push(t, density.depth(ray, *a, a + t), density.at(ray.at(a + t)));
                }
                table.finish();
                let query = BeamQuery {
                    origin: ray.at(*a),
                    direction: ray.direction,
                    length: (b - a) as f32,
                    phase: &phase,
                    extinction,
                    depth: Some(&table),
                    hull: None,
                    max_events: u8::MAX,
                    pruning: None,
                };
                let single = map.gather(&query, &mut GatherStats::default());
                for c in 0..3 {
                    let off = f64::from(bundled.total[c] - single.total[c]);
                    seen += f64::from(single.total[c]).powi(2);
                    squares += off.powi(2);
                    sum += off / f64::from(single.total[c].max(f32::MIN_POSITIVE));
                }
            }
            let (off, bias) = ((squares / seen).sqrt(), sum / (3.0 * rays.len() as f64));
            let limits = if map.fluence { (1.5e-2, 1e-2) } else { (1.5e-3, 5e-4) };
            assert!(off < limits.0 && bias.abs() < limits.1, "{name}, {extinction}: {off:.1e}, bias {bias:.1e}");
        }
    }
}
