//! Both estimators against numbers that are known exactly.

use std::fmt::Write;

use crate::half_space::H;
use crate::support::{Checks, Estimate, render, scene};

const BOTH: [&str; 2] = ["path", "photon"];

/// A film of `size` × `size` pixels, one camera and the render table.
fn view(size: u32, position: [f64; 3], target: [f64; 3], up: [f64; 3], fov: f64, method: &str, samples: u32) -> String {
    format!(
        "[film]\nwidth = {size}\nheight = {size}\nlayers = false\n\
         [camera]\nposition = {position:?}\ntarget = {target:?}\nup = {up:?}\nfov = {fov}\n\
         [render]\nmethod = \"{method}\"\nsamples = {samples}\n"
    )
}

const SKY: &str = "[[lights]]\ntype = \"environment\"\nradiance = 1.0\n";

/// Looks along −z from `z`.
fn along_z(z: f64, fov: f64, method: &str, samples: u32) -> String {
    view(1, [0.0, 0.0, z], [0.0, 0.0, z - 1.0], [0.0, 1.0, 0.0], fov, method, samples)
}

/// A sphere of radius 1 around the origin, filled with `fog`.
fn ball(material: &str) -> String {
    format!("[[shapes]]\ntype = \"sphere\"\ncenter = [0, 0, 0]\nradius = 1\ninterior = \"fog\"\n{material}\n")
}

#[test]
fn a_sphere_that_absorbs_dims_the_sky() {
    let mut checks = Checks::default();
    let sigma: [f64; 3] = [0.01, 0.7, 2.0];
    for method in BOTH {
        let text = format!(
            "{}{SKY}[media.fog]\nsigma_a = {sigma:?}\n{}",
            along_z(0.0, 60.0, method, if method == "path" { 1 << 16 } else { 16 }),
            ball("")
        );
        let expected = Estimate::exact(sigma.map(|sigma| (-sigma).exp()));
        checks.agree(method, &Estimate::of(16, &text, &[]), &expected, 0.003, 0.0);
    }
    checks.finish();
}

/// Two balls of absorbers that add, half-way in each other, in a box of a third.
#[test]
fn absorbers_that_add_dim_the_sky_together() {
    let mut checks = Checks::default();
    let text = |method| {
        format!(
            "{}{SKY}[media.a]\nsigma_a = [0.3, 0.2, 0.1]\nadd = true\n[media.b]\nsigma_a = [0, 0.1, 0.4]\n[[shapes]]\ntype = \"sphere\"\n\
             center = [0, 0, 0]\nradius = 1\ninterior = \"a\"\n[[shapes]]\ntype = \"sphere\"\ncenter = [0, 0, 1]\nradius = 1\n\
             interior = \"a\"\n[[shapes]]\ntype = \"box\"\nmin = [-1, -1, -0.5]\nmax = [1, 1, 4]\ninterior = \"b\"\n",
            along_z(9.0, 0.1, method, if method == "path" { 1 << 15 } else { 16 })
        )
    };
    // 2 by each ball, 4.5 by the box.
    let expected = Estimate::exact([-1.2_f64, -0.8 - 0.45, -0.4 - 1.8].map(f64::exp));
    for method in BOTH {
        checks.agree(method, &Estimate::of(16, &text(method), &[]), &expected, 0.003, 1e-4);
    }
    checks.finish();
}

/// Inside a sphere that shines 1 and reflects `a`, filled with an absorber: a chord's mean transmittance
/// I = 2[1 − (1+τ)e^{−τ}]/τ², τ = 2σ_aR, gives e^{−σ_aR}/(1 − aI) at the centre.
#[test]
fn a_glowing_sphere_around_an_absorber() {
    let mut checks = Checks::default();
    for (a, sigma, radius) in [(0.5, 0.7, 1.0), (0.8, 0.15, 2.5)] {
        let tau: f64 = 2.0 * sigma * radius;
        let chord = 2.0 * (1.0 - (1.0 + tau) * (-tau).exp()) / (tau * tau);
        let expected = (-sigma * radius).exp() / (1.0 - a * chord);
        for method in BOTH {
            let text = format!(
                "{}[media.fog]\nsigma_a = {sigma}\n[materials.wall]\ntype = \"lambert\"\nreflectance = {a}\n\
                 [[shapes]]\ntype = \"sphere\"\ncenter = [0, 0, 0]\nradius = {radius}\nmaterial = \"wall\"\n\
                 interior = \"fog\"\nemission = {{ radiance = 1.0, side = \"in\" }}\n",
                along_z(0.0, 90.0, method, if method == "path" { 1 << 14 } else { 1 << 11 })
            );
            // Indirect light by paths, without bias.
            let found = Estimate::of(16, &text, &["surface.indirect=path"]);
            checks.agree(&format!("a = {a}, {method}"), &found, &Estimate::exact([expected; 3]), 0.003, 0.0);
        }
    }
    checks.finish();
}

/// The plane albedo of a half space at normal incidence is 1 − √(1−Λ)·H(1), H Chandrasekhar's function for
/// isotropic scattering. By reciprocity it is what a camera sees that looks straight down under an even sky.
#[test]
fn a_half_space_under_an_even_sky() {
    let mut checks = Checks::default();
    for (albedo, published) in [(0.5f64, 0.1152f64), (0.9, 0.4149)] {
        let expected = H::new(albedo).reflected(1.0);
        assert!((expected - published).abs() < 5e-5, "{expected}");
        let text = format!(
            "{}{SKY}[media.fog]\nsigma_t = 1.0\nalbedo = {albedo}\n\
             [materials.black]\ntype = \"lambert\"\nreflectance = 0\n\
             [[shapes]]\ntype = \"box\"\nmin = [-1500, -1500, -60]\nmax = [1500, 1500, 0]\ninterior = \"fog\"\n\
             [[shapes]]\ntype = \"quad\"\norigin = [-4000, -4000, -60.1]\nedge_u = [8000, 0, 0]\n\
             edge_v = [0, 8000, 0]\nmaterial = \"black\"\n",
            along_z(5.0, 1.0, "path", 5_000)
        );
        let found = Estimate::of(32, &text, &[]);
        checks.agree(&format!("albedo {albedo}"), &found, &Estimate::exact([expected; 3]), 0.003, 0.0);
    }
    checks.finish();
}

/// Where nothing absorbs and the sky is 1 everywhere, everything is 1, and n² inside of index n.
#[test]
fn a_furnace_of_lossless_solids_by_path_tracing() {
    let mut checks = Checks::default();
    let media = [
        ("thin", "sigma_s = 0.1", 100),
        ("thick, forward", "sigma_s = 20\nphase = { type = \"hg\", g = 0.8 }", 400),
        ("backward", "sigma_s = 3\nphase = { type = \"schlick\", k = -0.7 }", 400),
        ("Rayleigh", "sigma_s = 2\nphase = { type = \"rayleigh\" }", 400),
        ("extinction 1 : 1000 between channels", "sigma_s = [0.02, 1, 20]", 2240),
        ("nothing in a channel", "sigma_s = [0, 1, 4]", 2240),
    ];
    for (name, medium, samples) in media {
        for (kind, material, inside) in [("matched", "", 1.0), ("dielectric", "material = \"glass\"", 2.25)] {
            for (place, z, expected) in [("outside", 3.0, 1.0), ("inside", 0.3, inside)] {
                let text = format!(
                    "{}{SKY}[media.fog]\n{medium}\n[materials.glass]\ntype = \"dielectric\"\nior = 1.5\n{}",
                    along_z(z, 30.0, "path", samples),
                    ball(material)
                );
                // Behind glass, grey light loses nothing by any path: no estimate of it varies.
                let exact = kind == "dielectric" && samples < 1000;
                let found = Estimate::of(if exact { 3 } else { 24 }, &text, &[]);
                let what = format!("{name}, {kind}, {place}");
                checks.agree(&what, &found, &Estimate::exact([expected; 3]), 0.008, 0.0);
            }
        }
    }
    checks.finish();
}

/// One room by both methods: walls that shine 1 − ρ and reflect ρ around a medium that scatters only.
#[test]
fn a_closed_furnace() {
    let mut checks = Checks::default();
    for method in BOTH {
        let mut text = along_z(0.8, 70.0, method, 1 << 10);
        write!(
            text,
            "[photons]\nvolume = 300_000\nglobal = 20_000\n[media.fog]\nsigma_s = 0.8\n[materials.wall]\ntype = \"lambert\"\nreflectance = 0.6\n\
             [[shapes]]\ntype = \"box\"\nmin = [-1, -1, -1]\nmax = [1, 1, 1]\nmaterial = \"wall\"\n\
             interior = \"fog\"\nemission = {{ radiance = 0.4, side = \"in\" }}\n"
        )
        .unwrap();
        let found = Estimate::of(16, &text, &[]);
        checks.agree(method, &found, &Estimate::exact([1.0; 3]), 0.006, 0.0);
    }
    checks.finish();
}

/// A medium that absorbs only does not scatter a light's beam.
#[test]
fn no_albedo_no_scattered_light() {
    for method in BOTH {
        let text = format!(
            "{}[media.fog]\nsigma_a = 2.0\n[[lights]]\ntype = \"point\"\nposition = [0.5, 0, 0]\nintensity = 100\n{}",
            along_z(3.0, 30.0, method, 64),
            ball("")
        );
        assert_eq!(render(&text, &[]).film.image().mean(), 0.0, "{method}");
    }
}

/// In an infinite medium of albedo Λ a photon collides 1/(1 − Λ) times on average, whatever the phase function;
/// none escapes, so all that was emitted is absorbed.
#[test]
fn collisions_of_a_photon() {
    let mut checks = Checks::default();
    for (albedo, phase) in [(0.3, "{ type = \"isotropic\" }"), (0.9, "{ type = \"hg\", g = 0.7 }")] {
        let text = format!(
            "{}[world]\nmedium = \"fog\"\n[media.fog]\nsigma_t = 2.5\nalbedo = {albedo}\nphase = {phase}\n\
             [[lights]]\ntype = \"point\"\nposition = [0, 0, 0]\nintensity = 1\n[photons]\nvolume = 400_000\n",
            along_z(3.0, 30.0, "photon", 1)
        );
        let stats = render(&text, &[]).stats;
        let (emitted, expected) = (stats.emitted as f64, 1.0 / (1.0 - albedo));
        // The number of collisions is geometrically distributed.
        let error = (expected * (expected - 1.0) / emitted).sqrt();
        let found = stats.volume as f64 / emitted;
        let what = format!("albedo {albedo}: {found} ± {error} collisions, expected {expected}");
        checks.holds(what, (found - expected).abs() <= 3.0 * error && error < 0.01 * expected);
    }
    checks.finish();
}

/// Thin fog scatters in proportion to its optical depth, however thin.
#[test]
fn thin_fog_is_linear_in_its_depth() {
    let mut checks = Checks::default();
    for method in BOTH {
        let at = |depth: f64| {
            let text = format!(
                "{}[photons]\nvolume = 50_000\n[media.fog]\nsigma_s = {}\n\
                 [[lights]]\ntype = \"point\"\nposition = [0.3, 1.5, 0]\nintensity = 1\n{}",
                view(4, [0.0, 0.0, 4.0], [0.0; 3], [0.0, 1.0, 0.0], 20.0, method, 64),
                0.5 * depth,
                ball("")
            );
            Estimate::of(8, &text, &[]).times(1.0 / depth)
        };
        let thinnest = at(1e-8);
        checks.holds(format!("{method}: {thinnest:?}"), thinnest.mean[0] > 0.0);
        for depth in [1e-6, 1e-4] {
            checks.agree(&format!("{method}, depth {depth}"), &at(depth), &thinnest, 0.01, 0.0);
        }
    }
    checks.finish();
}

/// Light from infinity, and a ray to infinity, do not survive an endless medium; a lamp in it shines.
#[test]
fn a_medium_without_end() {
    for method in BOTH {
        let fog = "[world]\nmedium = \"fog\"\n[media.fog]\nsigma_t = 0.3\nalbedo = 0.8\n[photons]\nvolume = 20_000\n";
        let camera = along_z(3.0, 60.0, method, 64);
        let sun = "[[lights]]\ntype = \"directional\"\ndirection = [0, -1, 0]\nirradiance = 1\n";
        assert_eq!(render(&format!("{camera}{fog}{SKY}{sun}"), &[]).film.image().mean(), 0.0, "{method}");
        let lamp = "[[lights]]\ntype = \"point\"\nposition = [0, 1, 0]\nintensity = 1\n";
        let mean = render(&format!("{camera}{fog}{SKY}{lamp}"), &[]).film.image().mean();
        assert!(mean > 1e-3 && mean < 1.0, "{method}: {mean}");
    }
}

/// A lit ball of fog, written in one of several ways that mean the same.
fn lit_ball(method: &str, medium: &str, unit: f64, at: [f64; 3]) -> String {
    let place = |x: f64, y: f64, z: f64| [at[0] + unit * x, at[1] + unit * y, at[2] + unit * z];
    format!(
        "{}[photons]\nvolume = 20_000\n[media.fog]\nalbedo = [0.9, 0.8, 0.5]\n{medium}\n\
         [materials.white]\ntype = \"lambert\"\nreflectance = 0.6\n\
         [[shapes]]\ntype = \"box\"\nmin = {:?}\nmax = {:?}\ninterior = \"fog\"\n\
         [[shapes]]\ntype = \"quad\"\norigin = {:?}\nedge_u = {:?}\nedge_v = {:?}\nmaterial = \"white\"\n\
         [[lights]]\ntype = \"spot\"\nposition = {:?}\ntarget = {:?}\nintensity = {}\ninner_angle = 20\nouter_angle = 40\n",
        view(8, place(0.2, 0.4, 4.0), place(0.0, 0.0, 0.0), [0.0, 1.0, 0.0], 25.0, method, 64),
        place(-1.0, -0.8, -0.5),
        place(1.0, 0.8, 0.5),
        place(-3.0, -1.0, 3.0),
        [6.0 * unit, 0.0, 0.0],
        [0.0, 0.0, -6.0 * unit],
        place(1.0, 2.5, 1.0),
        place(0.0, 0.0, 0.0),
        10.0 * unit * unit
    )
}

/// A grid that holds one number is a homogeneous medium; units and place do not matter.
#[test]
fn one_ball_in_several_words() {
    let mut checks = Checks::default();
    for method in BOTH {
        let of = |medium: &str, unit: f64, at: [f64; 3]| Estimate::of(16, &lit_ball(method, medium, unit, at), &[]);
        let sigma = |unit: f64| format!("sigma_t = [{}, {}, {}]", 0.5 / unit, 1.0 / unit, 3.0 / unit);
        let plain = of(&sigma(1.0), 1.0, [0.0; 3]);
        let grid = format!(
            "{}\ndensity = {{ type = \"array\", file = \"beam/constant.npy\", min = [-1, -0.8, -0.5], max = [1, 0.8, 0.5] }}",
            sigma(1.0)
        );
        checks.agree(&format!("{method}, grid"), &of(&grid, 1.0, [0.0; 3]), &plain, 0.01, 0.0);
        for unit in [1e4, 1e-4] {
            let found = of(&sigma(unit), unit, [0.0; 3]);
            checks.agree(&format!("{method}, scaled by {unit}"), &found, &plain, 0.01, 0.0);
        }
        let far = of(&sigma(1.0), 1.0, [1e5, -1e5, 1e5]);
        checks.agree(&format!("{method}, far from the origin"), &far, &plain, 0.01, 0.0);
    }
    checks.finish();
}

/// The camera knows what it is in: in one medium, in two at once, on a boundary.
#[test]
fn a_camera_in_a_medium() {
    let mut checks = Checks::default();
    for method in BOTH {
        let samples = if method == "path" { 1 << 16 } else { 16 };
        for (what, z, depth) in [
            ("in the outer one", 1.5, 0.5 * 0.4 + 2.0 * 0.7 + 1.0 * 0.4),
            ("in both", 0.5, 1.5 * 0.7 + 1.0 * 0.4),
            ("on the boundary of the inner one", 1.0, 2.0 * 0.7 + 1.0 * 0.4),
            ("outside", 4.0, 2.0 * 0.4 + 2.0 * 0.7),
        ] {
            let text = format!(
                "{}{SKY}[media.fog]\nsigma_a = 0.7\n[media.haze]\nsigma_a = 0.4\n\
                 [[shapes]]\ntype = \"sphere\"\ncenter = [0, 0, 0]\nradius = 2\ninterior = \"haze\"\n{}",
                along_z(z, 0.01, method, samples),
                ball("")
            );
            let found = Estimate::of(16, &text, &[]);
            checks.agree(&format!("{method}, {what}"), &found, &Estimate::exact([f64::exp(-depth); 3]), 0.003, 0.0);
        }
    }
    checks.finish();
}

/// A furnace by photons: what is missing stems from discs cut by the boundary, and shrinks with them.
#[test]
fn a_furnace_of_lossless_solids_by_photons() {
    let mut checks = Checks::default();
    let voxels = "density = { type = \"vdb\", file = \"reference/smoke_grid/smoke_grid_64.vdb\", grid = \"density\" }";
    let media = [
        ("thin", "sigma_s = 0.5".to_string()),
        ("coloured", "sigma_s = [0.1, 1, 4]".to_string()),
        ("voxels", format!("sigma_s = 4\n{voxels}")),
    ];
    for (name, medium) in media {
        for (kind, material) in [("matched", ""), ("dielectric", "material = \"glass\"")] {
            let text = format!(
                "{}{SKY}[media.fog]\n{medium}\n[materials.glass]\ntype = \"dielectric\"\nior = 1.5\n{}",
                view(4, [0.0, 0.0, 3.0], [0.0; 3], [0.0, 1.0, 0.0], 30.0, "photon", 8),
                ball(material)
            );
            let one = Estimate::exact([1.0; 3]);
            let of = |photons: u32| Estimate::of(5, &text, &[&format!("photons.volume={photons}")]);
            let (few, many) = (of(10_000).bias(&one), of(80_000).bias(&one));
            for c in 0..3 {
                let ((before, noise), (after, left)) = (few[c], many[c]);
                let shrinks = after.abs() <= 0.5 * before.abs() + 3.0 * left.hypot(0.5 * noise);
                let text = format!(
                    "{name}, {kind}, channel {c}: bias {before:+.4} ± {noise:.4}, then {after:+.4} ± {left:.4}"
                );
                checks.holds(text, shrinks && after.abs() <= 0.015 + 3.0 * left && left < 0.01);
            }
        }
    }
    checks.finish();
}

/// Around a lamp in an endless medium of isotropic scattering photons bring Λ/(1 − Λ) of its power to collisions that scatter, at a mean squared
/// distance of 2/(1 − Λ) mean free paths: the value and the curvature at 0 of the fluence's Fourier transform A/(1 − ΛA), of A = arctan(k)/k.
#[test]
fn photons_wander_as_far_as_they_should() {
    use volpm::light::Light;
    use volpm::photon::{Emission, Pass, trace};
    use volpm::scene::description::SingleScattering;
    use volpm::transport::Events;
    const SEEDS: u64 = 12;
    for albedo in [0.9, 0.99] {
        let text = format!(
            "[camera]\nposition = [0, 0, 10]\ntarget = [0, 0, 11]\n[world]\nmedium = \"fog\"\n\
             [media.fog]\nsigma_t = 1\nalbedo = {albedo}\n[[lights]]\ntype = \"point\"\nposition = [0, 0, 0]\npower = 1\n"
        );
        let scene = scene(&text, &[]);
        let Light::Point(lamp) = &scene.lights[0] else { panic!("no lamp") };
        let exact = [albedo / (1.0 - albedo), 2.0 / (1.0 - albedo)];
        let found: Vec<[f64; 2]> = (1..=SEEDS)
            .map(|seed| {
                let pass = Pass {
                    seed,
                    index: 0,
                    target: 20_000,
                    max_emitted: u64::MAX,
                    emission: Emission::default(),
                    max_events: Events::unlimited(),
                    single_scattering: SingleScattering::Photons,
                    importons: None,
                    control: None,
                };
                let traced = trace(&scene, &pass, &|_, _| {}, &|| false).unwrap();
                let mut sums = [0.0; 2];
                for photon in traced.regions.iter().flatten() {
                    let squared = photon.position.as_dvec3().distance_squared(lamp.position);
                    sums[0] += f64::from(photon.power.x);
                    sums[1] += f64::from(photon.power.x) * squared;
                }
                [sums[0] / exact[0] - 1.0, sums[1] / (exact[0] * exact[1]) - 1.0]
            })
            .collect();
        for (moment, what) in ["power", "power times squared distance"].iter().enumerate() {
            let mean = found.iter().map(|off| off[moment]).sum::<f64>() / SEEDS as f64;
            let squares = found.iter().map(|off| (off[moment] - mean).powi(2)).sum::<f64>();
            let error = (squares / (SEEDS * (SEEDS - 1)) as f64).sqrt();
            assert!(error < 0.02 && mean.abs() < 4.0 * error, "Λ {albedo}, {what}: off by {mean} ± {error}");
        }
    }
}
