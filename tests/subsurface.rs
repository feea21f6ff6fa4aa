//! Light inside refracting solids: slabs against adding–doubling, spheres by photons against path tracing, and lossless
//! solids in a furnace.

use std::f64::consts::PI;
use std::ops::ControlFlow;

use rayon::prelude::*;
use volpm::image::Image;
use volpm::math::random::Purpose;
use volpm::math::{DVec3, Ray, Rgb, Stream};
use volpm::photon::{self, Pass, Photon};
use volpm::scene::{Inside, Scene};
use volpm::transport::{Crossing, Segment, Side, Stop, Tally, Visitor, Walk, fly, survive};

use crate::slab::solver;
use crate::support::{Checks, Estimate, images, scene};

/// A slab in vacuum.
#[derive(Clone, Copy, Debug)]
struct Slab {
    index: f64,
    tau: f64,
    albedo: f64,
    g: f64,
}

impl Slab {
    /// R and T of a beam at normal incidence.
    fn exact(&self) -> [f64; 2] {
        let g = self.g;
        let phase = |x: f64| (1.0 - g * g) / (4.0 * PI * (1.0 + g * g - 2.0 * g * x).powf(1.5));
        solver::slab(self.index, self.tau, self.albedo, phase).into()
    }

    fn materials(&self) -> String {
        format!(
            "[media.fog]\nsigma_t = 1.0\nalbedo = {}\nphase = {{ type = \"hg\", g = {} }}\n\
             [materials.black]\ntype = \"lambert\"\nreflectance = 0\n\
             [materials.glass]\ntype = \"dielectric\"\nior = {}\n",
            self.albedo, self.g, self.index
        )
    }

    /// A box 50 times as wide as thick: from z = −τ to 0.
    fn wide(&self) -> String {
        let half = 50.0 * self.tau.max(1.0);
        format!(
            "{}[[shapes]]\ntype = \"box\"\nmin = [{}, {}, {}]\nmax = [{half}, {half}, 0]\nmaterial = \"glass\"\n\
             interior = \"fog\"\n",
            self.materials(),
            -half,
            -half,
            -self.tau
        )
    }

    /// R or T by reciprocity: what a camera sees that looks straight at the slab, under a sky of radiance 1 above it
    /// or below. A black sheet hides the other half of it.
    fn seen(&self, transmitted: bool, samples: u32) -> String {
        let far = 2000.0 * self.tau.max(1.0);
        let sheet = if transmitted { 3.0 } else { -self.tau - 0.01 };
        format!(
            "[film]\nwidth = 1\nheight = 1\nlayers = false\n\
             [camera]\nposition = [0, 0, 2]\ntarget = [0, 0, 0]\nfov = 2\n\
             [render]\nmethod = \"path\"\nsamples = {samples}\n[[lights]]\ntype = \"environment\"\nradiance = 1.0\n{}\
             [[shapes]]\ntype = \"quad\"\norigin = [{}, {}, {sheet}]\nedge_u = [{}, 0, 0]\nedge_v = [0, {}, 0]\n\
             material = \"black\"\n",
            self.wide(),
            -far,
            -far,
            2.0 * far,
            2.0 * far
        )
    }

    /// A column of the slab, 8 mean free paths wide, between mirrors, which stand for all of its width, and with a
    /// lamp of radiance 1 at one end.
    fn column(&self, transmitted: bool, photons: u32) -> String {
        const HALF: f64 = 4.0;
        let (top, bottom) = (0.3, -self.tau - 0.3);
        let (lit, dark) = if transmitted { (bottom, top) } else { (top, bottom) };
        let mut text = format!(
            "[film]\nwidth = 1\nheight = 1\nlayers = false\n\
             [camera]\nposition = [0, 0, 0.2]\ntarget = [0, 0, 0]\nfov = 60\n\
             [render]\nmethod = \"photon\"\nsamples = 64\n[photons]\nvolume = {photons}\n\
             [volume]\nkernel = \"fixed\"\nradius = 1.5\n{}[materials.mirror]\ntype = \"mirror\"\n\
             [[shapes]]\ntype = \"box\"\nmin = [{a}, {a}, {}]\nmax = [{b}, {b}, 0]\nmaterial = \"glass\"\n\
             interior = \"fog\"\n\
             [[shapes]]\ntype = \"quad\"\norigin = [{a}, {a}, {dark}]\nedge_u = [{c}, 0, 0]\nedge_v = [0, {c}, 0]\n\
             material = \"black\"\n\
             [[shapes]]\ntype = \"disk\"\ncenter = [0, 0, {lit}]\nnormal = [0, 0, {}]\nradius = 6\n\
             material = \"black\"\nemission = {{ radiance = 1.0 }}\n",
            self.materials(),
            -self.tau,
            if transmitted { 1 } else { -1 },
            a = -HALF - 0.01,
            b = HALF + 0.01,
            c = 2.0 * HALF + 0.02,
        );
        let height = top - bottom;
        for (x, y, u) in [(-1.0, -1.0, [1, 0]), (-1.0, 1.0, [1, 0]), (-1.0, -1.0, [0, 1]), (1.0, -1.0, [0, 1])] {
            text += &format!(
                "[[shapes]]\ntype = \"quad\"\norigin = [{}, {}, {bottom}]\nedge_u = [{}, {}, 0]\n\
                 edge_v = [0, 0, {height}]\nmaterial = \"mirror\"\n",
                HALF * x,
                HALF * y,
                2.0 * HALF * u[0] as f64,
                2.0 * HALF * u[1] as f64
            );
        }
        text
    }
}

/// One photon, flying.
struct Flying<'t> {
    scene: &'t Scene,
    weight: Rgb,
    stream: &'t mut Stream,
    collision: Option<f64>,
}

impl Visitor for Flying<'_> {
    fn segment(&mut self, segment: &Segment<'_>) -> ControlFlow<()> {
        let medium = &self.scene.media[segment.medium as usize];
        let (range, mut tally) = ((segment.a, segment.b), Tally::default());
        self.collision = fly(medium, segment.ray, range, &mut self.weight, self.stream, &mut tally, |_, _| {});
        if self.collision.is_some() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    }

    fn crossing(&mut self, _: &Crossing<'_>) {}
}

/// The power of a photon that leaves upwards, and downwards, of 1 that comes from above.
fn leaving(scene: &Scene, stream: &mut Stream) -> [f64; 2] {
    let ray = Ray::new(DVec3::Z - scene.center, -DVec3::Z);
    let (mut walk, mut weight) = (Walk::start(scene, ray, Inside::default()), Rgb::ONE);
    loop {
        let mut flying = Flying { scene, weight, stream, collision: None };
        let stop = walk.advance(&mut flying);
        weight = flying.weight;
        let collision = flying.collision;
        match (stop, collision) {
            (Stop::Ended, Some(t)) => {
                let medium = &scene.media[0];
                if !survive(&mut weight, medium.albedo, stream) {
                    return [0.0; 2];
                }
                let (direction, _) = medium.phase.sample(walk.ray.direction, stream);
                walk.turn(t, direction);
            }
            (Stop::Surface(at), _) => match at.scatter(Side::Light, &mut weight, stream) {
                Some(direction) => walk.leave(&at, direction),
                None => return [0.0; 2],
            },
            _ => {
                let power = weight.x;
                return if walk.ray.direction.z > 0.0 { [power, 0.0] } else { [0.0, power] };
            }
        }
    }
}

/// The means and standard errors of R and T over photons.
fn counted(slab: &Slab, photons: u64) -> [(f64, f64); 2] {
    let camera = "[film]\nwidth = 1\nheight = 1\n[camera]\nposition = [0, 0, 2]\ntarget = [0, 0, 0]\n";
    let scene = scene(&format!("{camera}{}", slab.wide()), &[]);
    let found: Vec<[f64; 2]> = (0..photons)
        .into_par_iter()
        .map(|index| leaving(&scene, &mut Stream::new(5, Purpose::Test, index, 0)))
        .collect();
    [0, 1].map(|side| {
        let mean = found.iter().map(|f| f[side]).sum::<f64>() / photons as f64;
        let variance = found.iter().map(|f| (f[side] - mean).powi(2)).sum::<f64>() / (photons - 1) as f64;
        (mean, (variance / photons as f64).sqrt())
    })
}

/// Slabs that between them have both indices, thin and thick ones, and forward scattering; for R and T samples by path
/// tracing in thousands, in each of 16 renders, and photons in thousands.
const SLABS: [(Slab, [u32; 2], u64); 6] = [
    (Slab { index: 1.33, tau: 1.0, albedo: 0.9, g: 0.9 }, [20, 1], 200),
    (Slab { index: 1.33, tau: 8.0, albedo: 0.99, g: 0.5 }, [2, 4], 60),
    (Slab { index: 1.5, tau: 4.0, albedo: 0.99, g: 0.9 }, [6, 2], 60),
    (Slab { index: 1.5, tau: 30.0, albedo: 0.999, g: 0.8 }, [2, 7], 60),
    (Slab { index: 1.33, tau: 100.0, albedo: 1.0, g: 0.9 }, [1, 0], 60),
    (Slab { index: 1.5, tau: 100.0, albedo: 0.999, g: 0.0 }, [1, 0], 30),
];

#[test]
fn refracting_slabs_by_path_tracing_and_by_counting_photons() {
    let mut checks = Checks::default();
    for (slab, samples, photons) in SLABS {
        let exact = slab.exact();
        let counted = counted(&slab, 1000 * photons);
        for (side, name) in ["R", "T"].into_iter().enumerate() {
            let what = format!("{slab:?}: {name}");
            let value = Estimate::exact([exact[side]; 3]);
            if samples[side] > 0 {
                let found = Estimate::of(16, &slab.seen(side == 1, 1000 * samples[side]), &[]);
                checks.agree(&format!("{what} by path"), &found, &value, 0.005, 0.0);
            }
            let (mean, error) = counted[side];
            if exact[side] > 0.01 {
                let found = Estimate { mean: [mean; 3], standard_error: [error; 3] };
                checks.agree(&format!("{what} by photons"), &found, &value, 0.01, 0.0);
            } else {
                checks.holds(format!("{what} by photons: {mean:.2e}"), (mean - exact[side]).abs() < 1e-4 + 3.0 * error);
            }
        }
    }
    checks.finish();
}

/// Light gathered from photons, as a camera sees it whose rays refract by up to 30°.
#[test]
fn refracting_slabs_by_gathering() {
    let mut checks = Checks::default();
    for (slab, transmitted) in [(SLABS[1].0, false), (SLABS[1].0, true)] {
        // Radiance by path tracing: at an angle, the solver's R and T are not what is seen.
        let text = slab.column(transmitted, 150_000);
        let path = Estimate::of(16, &text, &["render.method=path", "render.samples=8000"]);
        let found = Estimate::of(32, &text, &[]);
        checks.agree(&format!("{slab:?}, transmitted: {transmitted}"), &found, &path, 0.01, 0.01);
    }
    checks.finish();
}

/// A ball of radius 1 and the medium `fog`, seen from afar, so that it fills the film.
fn ball(medium: &str, material: &str, light: &str) -> String {
    format!(
        "[film]\nwidth = 24\nheight = 24\nlayers = false\n\
         [camera]\nposition = [0, 0, 100]\ntarget = [0, 0, 0]\nfov = 1.18\n[media.fog]\n{medium}\n\
         [materials.glass]\n{material}\n\
         [[shapes]]\ntype = \"sphere\"\ncenter = [0, 0, 0]\nradius = 1\nmaterial = \"glass\"\ninterior = \"fog\"\n{light}"
    )
}

/// The mean of an image over the silhouette of that ball, from a share of its radius to the rim.
fn zone(image: &Image, from: f64) -> [f64; 3] {
    const FINE: usize = 8;
    let (width, height) = (image.width, image.height);
    // The rim in units of half the film.
    let rim = (0.01f64).asin().tan() / (0.59f64).to_radians().tan();
    let (mut sum, mut total) = (Rgb::ZERO, 0.0);
    for y in 0..height {
        for x in 0..width {
            let place =
                |i: usize, k: usize, n: usize| 2.0 * (i as f64 + (k as f64 + 0.5) / FINE as f64) / n as f64 - 1.0;
            let inside = (0..FINE * FINE).filter(|k| {
                let r = place(x, k % FINE, width).hypot(place(y, k / FINE, height)) / rim;
                r >= from && r < 1.0
            });
            let weight = inside.count() as f64;
            let [r, g, b] = image.pixels[y * width + x];
            sum += weight * Rgb::new(r.into(), g.into(), b.into());
            total += weight;
        }
    }
    (sum / total).to_array()
}

/// Balls of marble's albedo from hardly any mean free path to a thousand, lit from the front: the whole, and the
/// outermost 5 % of the silhouette's radius.
#[test]
fn balls_lit_from_the_front() {
    // Wide enough for path tracing to find it through the boundary.
    let lamp = "[[shapes]]\ntype = \"disk\"\ncenter = [0, 0, 101]\nnormal = [0, 0, -1]\nradius = 150\n\
                emission = { radiance = 1.0 }\n";
    let mut checks = Checks::default();
    for (thickness, index, g, by_path, (seeds, photons)) in [
        (1.0, 1.0, 0.8, 400, (16, 200_000)),
        (10.0, 1.3, 0.8, 100, (16, 200_000)),
        (100.0, 1.0, 0.0, 16, (16, 100_000)),
        (100.0, 1.5, 0.0, 32, (16, 100_000)),
        (1000.0, 1.3, 0.8, 32, (40, 300_000)),
    ] {
        let medium = format!("sigma_t = {thickness}\nalbedo = 0.999\nphase = {{ type = \"hg\", g = {g} }}");
        let text = ball(&medium, &format!("type = \"dielectric\"\nior = {index}"), lamp);
        let path = images(16, &text, &["render.method=path", &format!("render.samples={by_path}")]);
        let photons = format!("photons.volume={photons}");
        let found = images(seeds, &text, &["render.method=photon", &photons, "render.samples=8"]);
        let what = format!("σ_t R = {thickness}, n = {index}, g = {g}");
        for (name, from, precision, bias) in [("ball", 0.0, 0.01, 0.01), ("ring", 0.95, 0.025, 0.02)] {
            let [path, found] = [&path, &found]
                .map(|images| Estimate::over(images, |image| [zone(image, from).iter().sum::<f64>() / 3.0; 3]));
            checks.agree(&format!("{what}, {name}"), &found, &path, precision, bias);
        }
    }
    checks.finish();
}

/// A slab lit from behind, by both methods: above 1e-3 within the errors, below within 1e-4.
#[test]
fn a_backlit_slab() {
    let mut checks = Checks::default();
    for tau in [2.0, 10.0, 30.0] {
        let text = format!(
            "[film]\nwidth = 4\nheight = 4\nlayers = false\n\
             [camera]\nposition = [0, 0, {0}]\ntarget = [0, 0, 0]\nfov = 30\n\
             [media.fog]\nsigma_t = 1.0\nalbedo = [0.999, 0.998, 0.9]\n\
             [materials.glass]\ntype = \"dielectric\"\nior = 1.5\n\
             [[shapes]]\ntype = \"box\"\nmin = [-{1}, -{1}, -{tau}]\nmax = [{1}, {1}, 0]\nmaterial = \"glass\"\n\
             interior = \"fog\"\n\
             [[shapes]]\ntype = \"quad\"\norigin = [-{1}, -{1}, -{2}]\nedge_u = [{3}, 0, 0]\nedge_v = [0, {3}, 0]\n\
             emission = {{ radiance = 1.0 }}\n",
            4.0 * tau,
            2.0 * tau,
            1.5 * tau,
            4.0 * tau,
        );
        let path = Estimate::of(16, &text, &["render.method=path", "render.samples=600"]);
        let found = Estimate::of(16, &text, &["photons.volume=200000", "render.samples=32"]);
        for c in 0..3 {
            let error = path.standard_error[c].hypot(found.standard_error[c]);
            let difference = (found.mean[c] - path.mean[c]).abs();
            let allowed = if path.mean[c] > 1e-3 { 0.02 * path.mean[c] } else { 1e-4 };
            let what =
                format!("τ = {tau}, channel {c}: {:.3e} against {:.3e} ± {error:.1e}", found.mean[c], path.mean[c]);
            checks.holds(what, difference <= allowed + 3.0 * error && error <= 0.03 * path.mean[c].max(5e-3));
        }
    }
    checks.finish();
}

/// Lossless solids of any index, roughness, density and shape cannot be seen in a white furnace, and inside index n
/// everything is n².
#[test]
fn lossless_solids_in_a_furnace() {
    let sky = "[[lights]]\ntype = \"environment\"\nradiance = 1.0\n";
    let voxels = "density = { type = \"noise\", scale = 0.5, octaves = 2, threshold = 0.3 }";
    let mut checks = Checks::default();
    let sphere = "type = \"sphere\"\ncenter = [0, 0, 0]\nradius = 1";
    let block = "type = \"box\"\nmin = [-0.8, -0.7, -0.6]\nmax = [0.5, 0.7, 0.6]";
    for (name, shape, medium, index, roughness) in [
        ("rough", sphere, "sigma_s = 5", 1.5, 0.3),
        ("very rough", block, "sigma_s = [1, 5, 20]\nphase = { type = \"hg\", g = 0.8 }", 1.8, 0.9),
        ("rough and lighter than what is around", sphere, "sigma_s = 2", 0.7, 0.2),
        ("veined", block, &format!("sigma_s = 8\n{voxels}"), 1.3, 0.0),
    ] {
        for (place, z, expected) in [("outside", 4.0, 1.0), ("inside", 0.1, index * index)] {
            let text = format!(
                "[film]\nwidth = 4\nheight = 4\nlayers = false\n\
                 [camera]\nposition = [0.1, 0.05, {z}]\ntarget = [0, 0, -1]\nfov = 30\n[media.fog]\n{medium}\n\
                 [materials.glass]\ntype = \"dielectric\"\nior = {index}\nroughness = {roughness}\n\
                 [[shapes]]\n{shape}\nmaterial = \"glass\"\ninterior = \"fog\"\n{sky}"
            );
            let path = Estimate::of(16, &text, &["render.method=path", "render.samples=300"]);
            let what = format!("{name}, {place}");
            let expected = Estimate::exact([expected; 3]);
            checks.agree(&format!("{what}, by path"), &path, &expected, 0.01, 0.0);
            // Inside, few photons are near enough to the camera to be seen: too noisy to tell.
            if z > 1.0 {
                let photons = Estimate::of(24, &text, &["photons.volume=80000", "render.samples=16"]);
                checks.agree(&format!("{what}, by photons"), &photons, &expected, 0.015, 0.02);
            }
        }
    }
    checks.finish();
}

/// Glass, milk in it, and air above: three interfaces; and a block with a bubble of air and a vein of another medium.
/// Both methods see the same.
#[test]
fn nested_solids() {
    let glass_of_milk = "
[media.milk]
sigma_s = [6, 8, 10]
sigma_a = [0.02, 0.05, 0.2]
phase = { type = \"hg\", g = 0.7 }
[media.tint]
sigma_a = [0.3, 0.1, 0.2]
[materials.glass]
type = \"dielectric\"
ior = 1.5
[materials.water]
type = \"dielectric\"
ior = 1.33
[materials.air]
type = \"dielectric\"
ior = 1
[[shapes]]
type = \"cylinder\"
base = [0, -1, 0]
top = [0, 1, 0]
radius = 0.8
material = \"glass\"
interior = \"tint\"
[[shapes]]
type = \"cylinder\"
base = [0, -0.9, 0]
top = [0, 1.1, 0]
radius = 0.7
material = \"air\"
priority = 1
[[shapes]]
type = \"cylinder\"
base = [0, -0.95, 0]
top = [0, 0.6, 0]
radius = 0.75
material = \"water\"
interior = \"milk\"
priority = 0
";
    let vein = "
[media.ice]
sigma_s = 1
sigma_a = [0.2, 0.1, 0.05]
[media.vein]
sigma_s = 10
sigma_a = [0.1, 0.3, 0.6]
[materials.ice]
type = \"dielectric\"
ior = 1.31
roughness = 0.2
[materials.air]
type = \"dielectric\"
ior = 1
[[shapes]]
type = \"box\"
min = [-1, -1, -1]
max = [1, 1, 1]
material = \"ice\"
interior = \"ice\"
[[shapes]]
type = \"sphere\"
center = [0.3, 0.2, 0.4]
radius = 0.35
material = \"air\"
priority = 2
[[shapes]]
type = \"cylinder\"
base = [-0.9, -0.8, 0]
top = [0.7, 0.5, 0.2]
radius = 0.25
interior = \"vein\"
priority = 1
";
    let lamp = "[[shapes]]\ntype = \"sphere\"\ncenter = [5, 4, 4]\nradius = 3\nemission = { radiance = 1.0 }\n\
                [[lights]]\ntype = \"environment\"\nradiance = 0.2\n";
    let view = "[film]\nwidth = 12\nheight = 12\nlayers = false\n\
                [camera]\nposition = [0, 1.5, 5]\ntarget = [0, 0, 0]\nfov = 24\n";
    let mut checks = Checks::default();
    for (name, solids) in [("a glass of milk", glass_of_milk), ("ice with a bubble and a vein", vein)] {
        let text = format!("{view}{solids}{lamp}");
        let path = Estimate::of(16, &text, &["render.method=path", "render.samples=128"]);
        let found = Estimate::of(16, &text, &["photons.volume=150000", "render.samples=16"]);
        checks.agree(name, &found, &path, 0.01, 0.01);
    }
    checks.finish();
}

/// Coloured glass without scattering: what passes is Fresnel's transmittance both ways and Beer's law between, with all
/// reflections inside, as a plate at normal incidence shows: T = (1 − F)² a / (1 − F² a²).
#[test]
fn absorption_by_beers_law() {
    let (index, thickness, sigma) = (1.5f64, 2.0f64, [0.1f64, 0.5, 1.5]);
    let text = format!(
        "[film]\nwidth = 1\nheight = 1\nlayers = false\n\
         [camera]\nposition = [0, 0, 10]\ntarget = [0, 0, 0]\nfov = 0.01\n\
         [media.cognac]\nsigma_a = {sigma:?}\n[materials.glass]\ntype = \"dielectric\"\nior = {index}\n\
         [[shapes]]\ntype = \"box\"\nmin = [-5, -5, 0]\nmax = [5, 5, {thickness}]\nmaterial = \"glass\"\n\
         interior = \"cognac\"\n\
         [[shapes]]\ntype = \"quad\"\norigin = [-5, -5, -1]\nedge_u = [10, 0, 0]\nedge_v = [0, 10, 0]\n\
         emission = {{ radiance = 1.0 }}\n"
    );
    let f = ((index - 1.0) / (index + 1.0)).powi(2);
    let exact = sigma.map(|sigma| {
        let a = (-sigma * thickness).exp();
        (1.0 - f).powi(2) * a / (1.0 - f * f * a * a)
    });
    let mut checks = Checks::default();
    for method in ["path", "photon"] {
        let found = Estimate::of(16, &text, &[&format!("render.method={method}"), "render.samples=20000"]);
        checks.agree(method, &found, &Estimate::exact(exact), 0.003, 0.0);
    }
    checks.finish();
}

/// Stone whose veins are about as wide as discs: light stays with the matter that scatters it. In a white furnace, where
/// it would be a tenth too bright otherwise, and lit from the front.
#[test]
fn a_veined_ball() {
    let medium = |albedo| {
        format!(
            "sigma_t = 160\nalbedo = {albedo}\n\
             density = {{ type = \"noise\", scale = 0.8, octaves = 3, threshold = 0.5, seed = 5 }}"
        )
    };
    let glass = "type = \"dielectric\"\nior = 1.4";
    let mut checks = Checks::default();
    let sky = "[[lights]]\ntype = \"environment\"\nradiance = 1.0\n";
    let wide = ["photons.volume=100000", "volume.neighbours=600", "render.samples=8"];
    let found = Estimate::of(8, &ball(&medium(1.0), glass, sky), &wide);
    checks.agree("in a furnace", &found, &Estimate::exact([1.0; 3]), 0.01, 0.03);
    let lamp = "[[shapes]]\ntype = \"disk\"\ncenter = [0, 0, 101]\nnormal = [0, 0, -1]\nradius = 150\n\
                emission = { radiance = 1.0 }\n";
    let text = ball(&medium(0.99), glass, lamp);
    let path = Estimate::of(16, &text, &["render.method=path", "render.samples=48"]);
    let narrow = ["photons.volume=150000", "volume.neighbours=60", "render.samples=8"];
    checks.agree("lit from the front", &Estimate::of(8, &text, &narrow), &path, 0.01, 0.02);
    checks.finish();
}

/// A lamp in a hollow of wax, as a candle's flame: what is seen of it from outside has come through.
#[test]
fn wax_lit_from_inside() {
    let lamp = "[materials.air]\ntype = \"dielectric\"\nior = 1\n\
                [[shapes]]\ntype = \"cylinder\"\nbase = [0, -0.2, 0]\ntop = [0, 1.1, 0]\nradius = 0.55\n\
                material = \"air\"\npriority = 1\n\
                [[shapes]]\ntype = \"sphere\"\ncenter = [0, 0.3, 0]\nradius = 0.3\n\
                emission = { radiance = [1.5, 1.0, 0.8] }\n";
    let text = ball("sigma_t = 12\nalbedo = [0.999, 0.99, 0.95]", "type = \"dielectric\"\nior = 1.43", lamp);
    let path = Estimate::of(16, &text, &["render.method=path", "render.samples=64"]);
    let found = Estimate::of(16, &text, &["photons.volume=100000", "render.samples=8"]);
    let mut checks = Checks::default();
    checks.agree("wax", &found, &path, 0.01, 0.01);
    checks.finish();
}

const ON_A_FLOOR: &str = "
[film]
width = 12
height = 12
layers = false
[camera]
position = [0, 3, 8]
target = [0, 1, 0]
fov = 13
[media.milk]
sigma_t = 15
albedo = [0.998, 0.998, 0.99]
[materials.water]
type = \"dielectric\"
ior = 1.33
[materials.table]
type = \"lambert\"
reflectance = [0.5, 0.2, 0.1]
[[shapes]]
type = \"cylinder\"
base = [0, 0, 0]
top = [0, 2, 0]
radius = 0.8
material = \"water\"
interior = \"milk\"
[[shapes]]
type = \"disk\"
center = [0, -0.01, 0]
normal = [0, 1, 0]
radius = 40
material = \"table\"
[[shapes]]
type = \"quad\"
origin = [-9, 1, -3]
edge_u = [0, 7, 0]
edge_v = [-1, 0, 7]
emission = { radiance = 4.0 }
[[lights]]
type = \"environment\"
radiance = 0.3
";

/// A small solid on a wide floor, under a sky: photons are aimed at it, from the lights and from the floor, and those
/// that come from far away are not so strong that they stand out.
#[test]
fn a_small_solid_on_a_wide_floor() {
    let path = Estimate::of(16, ON_A_FLOOR, &["render.method=path", "render.samples=96"]);
    let found = Estimate::of(24, ON_A_FLOOR, &["photons.volume=100000", "render.samples=8"]);
    let mut checks = Checks::default();
    checks.agree("a small solid", &found, &path, 0.015, 0.01);
    checks.finish();
}

/// Photons of one walk are no more than one, and one of great power stands for many: either is seen as blotches. The power
/// just below one side of the milk varies as that of not much fewer independent photons than are stored there.
#[test]
fn photons_in_a_dense_solid_are_nearly_independent() {
    const SEEDS: u64 = 48;
    let scene = scene(ON_A_FLOOR, &[]);
    let side = |seed: u64| {
        let pass = Pass { seed, index: 0, target: 20_000, max_emitted: 10_000_000 };
        let traced = photon::trace(&scene, &pass, &|_, _| {}, &|| false);
        let shallow = |photon: &&Photon| {
            let p = photon.position.as_dvec3() + scene.center;
            p.z > 0.0 && p.y > 0.2 && p.y < 1.8 && 0.8 - p.x.hypot(p.z) < 1.0 / 15.0
        };
        let powers =
            traced.regions.iter().flatten().filter(shallow).map(|photon| f64::from(photon.power.element_sum()));
        powers.fold((0.0, 0.0), |(count, sum), power| (count + 1.0, sum + power))
    };
    let found: Vec<(f64, f64)> = (1..=SEEDS).into_par_iter().map(side).collect();
    let n = SEEDS as f64;
    let mean = |of: &dyn Fn(&(f64, f64)) -> f64| found.iter().map(of).sum::<f64>() / n;
    let (stored, power) = (mean(&|side| side.0), mean(&|side| side.1));
    let variance = mean(&|side| (side.1 - power).powi(2)) * n / (n - 1.0);
    let independent = power * power / variance;
    // The variance is known to a fifth.
    assert!(independent > 0.25 * stored, "{stored:.0} photons vary as {independent:.0} independent ones");
}
