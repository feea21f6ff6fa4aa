//! Both estimators against numbers that are known exactly.

use std::fmt::Write;

use crate::support::{Checks, Estimate, render};

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
                along_z(0.0, 90.0, method, if method == "path" { 1 << 17 } else { 1 << 13 })
            );
            let found = Estimate::of(16, &text, &[]);
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
    for albedo in [0.5, 0.9] {
        let expected = 1.0 - (1.0 - albedo as f64).sqrt() * chandrasekhar_h(albedo, 1.0);
        let published = if albedo == 0.5 { 0.1152 } else { 0.4149 };
        assert!((expected - published as f64).abs() < 5e-5, "{expected}");
        let text = format!(
            "{}{SKY}[media.fog]\nsigma_t = 1.0\nalbedo = {albedo}\n\
             [materials.black]\ntype = \"lambert\"\nreflectance = 0\n\
             [[shapes]]\ntype = \"box\"\nmin = [-1500, -1500, -60]\nmax = [1500, 1500, 0]\ninterior = \"fog\"\n\
             [[shapes]]\ntype = \"quad\"\norigin = [-4000, -4000, -60.1]\nedge_u = [8000, 0, 0]\n\
             edge_v = [0, 8000, 0]\nmaterial = \"black\"\n",
            along_z(5.0, 1.0, "path", 20_000)
        );
        let found = Estimate::of(32, &text, &[]);
        checks.agree(&format!("albedo {albedo}"), &found, &Estimate::exact([expected; 3]), 0.003, 0.0);
    }
    checks.finish();
}

/// H(μ) by iterating 1/H = √(1−Λ) + (Λ/2) ∫₀¹ μ′H(μ′)/(μ+μ′) dμ′ (Chandrasekhar 1960, §V) with the midpoint rule.
fn chandrasekhar_h(albedo: f64, mu: f64) -> f64 {
    const N: usize = 2000;
    let node = |i: usize| (i as f64 + 0.5) / N as f64;
    let inverse = |h: &[f64], mu: f64| {
        let sum: f64 = h.iter().enumerate().map(|(i, h)| node(i) * h / (mu + node(i))).sum();
        (1.0 - albedo).sqrt() + 0.5 * albedo * sum / N as f64
    };
    let mut h = vec![1.0; N];
    for _ in 0..40 {
        h = (0..N).map(|i| 1.0 / inverse(&h, node(i))).collect();
    }
    1.0 / inverse(&h, mu)
}

/// Where nothing absorbs and the sky is 1 everywhere, everything is 1, and n² inside of index n.
#[test]
fn a_furnace_of_lossless_solids_by_path_tracing() {
    let mut checks = Checks::default();
    let media = [
        ("thin", "sigma_s = 0.1"),
        ("thick, forward", "sigma_s = 20\nphase = { type = \"hg\", g = 0.8 }"),
        ("backward", "sigma_s = 3\nphase = { type = \"schlick\", k = -0.7 }"),
        ("Rayleigh", "sigma_s = 2\nphase = { type = \"rayleigh\" }"),
        ("extinction 1 : 1000 between channels", "sigma_s = [0.02, 1, 20]"),
        ("nothing in a channel", "sigma_s = [0, 1, 4]"),
    ];
    for (name, medium) in media {
        for (kind, material, inside) in [("matched", "", 1.0), ("dielectric", "material = \"glass\"", 2.25)] {
            for (place, z, expected) in [("outside", 3.0, 1.0), ("inside", 0.3, inside)] {
                let text = format!(
                    "{}{SKY}[media.fog]\n{medium}\n[materials.glass]\ntype = \"dielectric\"\nior = 1.5\n{}",
                    along_z(z, 30.0, "path", 4096),
                    ball(material)
                );
                let found = Estimate::of(32, &text, &[]);
                let what = format!("{name}, {kind}, {place}");
                checks.agree(&what, &found, &Estimate::exact([expected; 3]), 0.005, 0.0);
            }
        }
    }
    checks.finish();
}

/// The same room by both methods: walls that shine 1 − ρ and reflect ρ around a medium that scatters only.
#[test]
fn a_closed_furnace() {
    let mut checks = Checks::default();
    for method in BOTH {
        let mut text = along_z(0.8, 70.0, method, if method == "path" { 4096 } else { 256 });
        write!(
            text,
            "[photons]\nvolume = 100_000\n[media.fog]\nsigma_s = 0.8\n[materials.wall]\ntype = \"lambert\"\nreflectance = 0.6\n\
             [[shapes]]\ntype = \"box\"\nmin = [-1, -1, -1]\nmax = [1, 1, 1]\nmaterial = \"wall\"\n\
             interior = \"fog\"\nemission = {{ radiance = 0.4, side = \"in\" }}\n"
        )
        .unwrap();
        let found = Estimate::of(16, &text, &[]);
        checks.agree(method, &found, &Estimate::exact([1.0; 3]), 0.003, 0.0);
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
        let (emitted, expected) = (stats.emitted as f64, 1.0 / (1.0 - albedo as f64));
        // The number of collisions is geometrically distributed.
        let error = (expected * (expected - 1.0) / emitted).sqrt();
        let found = stats.volume as f64 / emitted;
        let what = format!("albedo {albedo}: {found} ± {error} collisions, expected {expected}");
        checks.holds(what, (found - expected).abs() <= 3.0 * error && error < 0.01 * expected);
    }
    checks.finish();
}
