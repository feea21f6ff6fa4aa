//! What a wall does to photons near it: uncorrected, the light lost grows with the radius; corrected, what photons are
//! off by grows with its square, as it does away from walls.

use std::f64::consts::PI;
use std::ops::Range;

use rayon::prelude::*;
use smallvec::SmallVec;
use volpm::gather::{BeamQuery, GatherStats, PhaseLanes};
use volpm::image::Image;
use volpm::math::random::Purpose;
use volpm::math::{DVec3, Stream, Vec3};
use volpm::medium::phase::HenyeyGreenstein;
use volpm::photon::{self, Emission, MapSettings, Pass, PhotonMap, Plane, Radius, walls};
use volpm::render::Camera;
use volpm::scene::Settings;
use volpm::scene::description::SingleScattering;
use volpm::transport::Events;

use crate::support::{Checks, Estimate, built, images};

/// Fog over a black floor, seen along it: each row of pixels is a tenth higher above it than the one below.
const ROOM: &str = r#"
[film]
width = 4
height = 18
layers = false
[camera]
position = [0, 0, 20]
target = [0, 0.9, 0]
fov = 5.153
[media.fog]
sigma_s = 0.6
sigma_a = 0.2
phase = { type = "hg", g = 0.3 }
[materials.black]
type = "lambert"
reflectance = 0
[[shapes]]
type = "box"
min = [-1, -0.1, -1]
max = [1, 2, 1]
interior = "fog"
[[shapes]]
type = "quad"
origin = [-3, 0, 3]
edge_u = [6, 0, 0]
edge_v = [0, 0, -6]
material = "black"
[[lights]]
type = "point"
position = [1.4, 0.9, 0.9]
intensity = 10
"#;

/// Rows that show the fog next to the floor, and far from all surfaces.
const BANDS: [(&str, Range<u32>); 2] = [("at the wall", 14..18), ("inside", 6..10)];

/// How high the lower band is.
const HEIGHT: f64 = 0.4;

/// Radii, each twice the one before.
const RADII: [f64; 3] = [0.1, 0.2, 0.4];

const SAMPLES: u32 = 64;

fn band_of(image: &Image, rows: &Range<u32>) -> f64 {
    let pixels = &image.pixels[rows.start as usize * image.width..rows.end as usize * image.width];
    pixels.iter().map(|pixel| f64::from(pixel[0])).sum::<f64>() / pixels.len() as f64
}

/// What both bands show, by radius, corrected and not, of the same photons along the same rays.
fn bands(seed: u64) -> [[[f64; 2]; 3]; 2] {
    let (scene, Settings { film, .. }) = built(ROOM, &[]);
    let camera = Camera::new(&scene.camera, &film);
    let pass = Pass {
        seed,
        index: 0,
        target: 100_000,
        max_emitted: 10_000_000,
        emission: Emission::default(),
        max_events: Events::unlimited(),
        single_scattering: SingleScattering::Photons,
        importons: None,
        control: None,
    };
    let traced = photon::trace(&scene, &pass, &|_, _| {}, &|| false).unwrap();
    let medium = &scene.media[0];
    let middle = DVec3::new(0.0, 1.0, 0.0) - scene.center;
    let photons = &traced.regions[scene.region(&scene.inside(middle)) as usize];
    let fog = scene.geometry.bounds(scene.solids[0].shape);
    let phase = PhaseLanes::new(HenyeyGreenstein { g: 0.3 });
    [true, false].map(|boundaries| {
        RADII.map(|radius| {
            let settings = MapSettings { boundaries, ..MapSettings::new(Radius::Fixed(radius as f32)) };
            let near = |position: Vec3, radius: f32, _: f32, planes: &mut SmallVec<[Plane; 3]>| {
                walls::near(&scene, position, 2.0 * radius, false, planes);
            };
            let map = PhotonMap::build(photons.clone(), &settings, &near);
            BANDS.map(|(_, rows)| {
                let mut sum = 0.0;
                for (x, y) in rows.clone().flat_map(|y| (0..film.width).map(move |x| (x, y))) {
                    let mut stream = Stream::new(seed, Purpose::Test, u64::from(y), u64::from(x));
                    for _ in 0..SAMPLES {
                        let ray = camera.ray(x, y, &mut stream);
                        let Some((a, b)) = fog.clip(&ray, 0.0, f64::INFINITY) else { continue };
                        let query = BeamQuery {
                            origin: ray.at(a),
                            direction: ray.direction,
                            length: (b - a) as f32,
                            phase: &phase,
                            extinction: medium.extinction.as_vec3(),
                            depth: None,
                            hull: None,
                            max_events: u8::MAX,
                            pruning: None,
                        };
                        sum += f64::from(map.gather(&query, &mut GatherStats::default()).total[0]);
                    }
                }
                sum / f64::from(SAMPLES * film.width * rows.len() as u32)
            })
        })
    })
}

/// The coefficients of the parabola through the values at all radii: constant, linear, quadratic.
fn parabola([b1, b2, b3]: [f64; 3]) -> [f64; 3] {
    let [r1, r2, r3] = RADII;
    let (first, second) = ((b2 - b1) / (r2 - r1), (b3 - b2) / (r3 - r2));
    let quadratic = (second - first) / (r3 - r1);
    let linear = first - quadratic * (r1 + r2);
    [b1 - linear * r1 - quadratic * r1 * r1, linear, quadratic]
}

#[test]
fn bias_at_a_wall_is_linear_without_the_correction_and_quadratic_with_it() {
    let mut checks = Checks::default();
    let path = images(16, ROOM, &["render.method=path", "render.samples=400"]);
    let found: Vec<[[[f64; 2]; 3]; 2]> = (1..=16).into_par_iter().map(bands).collect();
    for (band, (name, rows)) in BANDS.iter().enumerate() {
        let reference = Estimate::over(&path, |image| [band_of(image, rows); 3]);
        let level = reference.mean[0];
        // ∫ (1 − C(h/r)) dh = 16r/35π of the light is lost next to the floor.
        let floor = Estimate::over(&path, |image| [band_of(image, &(17..18)); 3]).mean[0];
        let lost = if band == 0 { -16.0 / (35.0 * PI) / HEIGHT * floor / level } else { 0.0 };
        for (mode, what, expected) in [(0, "corrected", 0.0), (1, "uncorrected", lost)] {
            let fits: Vec<[f64; 3]> =
                found.iter().map(|found| parabola(found[mode].map(|bands| bands[band] / level - 1.0))).collect();
            let mean = |index: usize| fits.iter().map(|fit| fit[index]).sum::<f64>() / fits.len() as f64;
            let error = |index: usize| {
                let mean = mean(index);
                let squares: f64 = fits.iter().map(|fit| (fit[index] - mean).powi(2)).sum();
                (squares / (fits.len() * (fits.len() - 1)) as f64).sqrt()
            };
            let [constant, linear, quadratic] = [0, 1, 2].map(|index| (mean(index), error(index)));
            let of = |radius: f64| constant.0 + linear.0 * radius + quadratic.0 * radius * radius;
            println!("{name}, {what}: {:+.4} {:+.4} {:+.4}", of(0.1), of(0.2), of(0.4));
            let noise = constant.1.hypot(reference.standard_error[0] / level);
            checks.holds(
                format!("{name}, {what}: without radius {:+.4} ± {noise:.4}", constant.0),
                noise < 0.01 && constant.0.abs() < 3.0 * noise,
            );
            checks.holds(
                format!(
                    "{name}, {what}: linear {:+.4} ± {:.4} for {expected:+.4}, quadratic {:+.4} ± {:.4}",
                    linear.0, linear.1, quadratic.0, quadratic.1
                ),
                linear.1 < 0.03 && (linear.0 - expected).abs() < 3.0 * linear.1,
            );
        }
    }
    checks.finish();
}
