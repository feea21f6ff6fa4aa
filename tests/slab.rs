//! Reflectance R and transmittance T of wide slabs, by paths, by photons that leave and by photons gathered, against
//! numbers from elsewhere: a table made by adding–doubling, and a solver, which shares nothing with the renderer.
//!
//! R and T of a beam at normal incidence are, by reciprocity, what a camera sees that looks straight at the slab
//! under light of radiance 1 from all sides of one half space: above it for R, below it for T.

use std::f64::consts::PI;
use std::fmt;
use std::ops::ControlFlow;

use volpm::math::random::Purpose;
use volpm::math::{DVec3, Ray, Rgb, Stream};
use volpm::scene::{Inside, Scene};
use volpm::surface::Side;
use volpm::transport::{Heading, Luggage, Part, Parts, Segment, Tally, Traveller, Vertex, Walk, fly, survive, travel};

use crate::half_space::H;
use crate::support::{Checks, Effort, Estimate, STRICT, allowed, chosen, data, scene};

/// Adding–doubling, by which `docs/certified.md` is made, too.
#[path = "../examples/certified/adding.rs"]
mod solver;

/// A slab in vacuum.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Slab {
    pub index: f64,
    pub tau: f64,
    pub albedo: f64,
    /// `hg` or `schlick`, and its parameter.
    pub phase: &'static str,
    pub g: f64,
}

impl fmt::Display for Slab {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "n = {}, τ = {}, Λ = {}, {} {}", self.index, self.tau, self.albedo, self.phase, self.g)
    }
}

/// The rows of `data/slab.csv`: index, optical thickness, albedo, phase function and its parameter, R and T.
fn table() -> Vec<(Slab, [f64; 2])> {
    let text = std::fs::read_to_string(data("slab.csv")).unwrap();
    let row = |line: &str| {
        let cells: Vec<&str> = line.split(',').collect();
        let number = |i: usize| cells[i].parse::<f64>().unwrap();
        let phase = if cells[3] == "schlick" { "schlick" } else { "hg" };
        let slab = Slab { index: number(0), tau: number(1), albedo: number(2), phase, g: number(4) };
        (slab, [number(5), number(6)])
    };
    text.lines().skip(1).map(row).collect()
}

#[test]
fn the_solver_agrees_with_the_table() {
    let mut checks = Checks::default();
    for (slab, expected) in table() {
        let [r, t] = slab.exact();
        // The table has six digits and is sure to 1e-5; where there is a critical angle, to 3e-5 (half as many nodes
        // again change the solver's numbers by 5e-6 there).
        let sure = if slab.index == 1.0 { 1e-5 } else { 3e-5 };
        let close = |x: f64, y: f64| (x - y).abs() <= sure * y.max(0.01);
        checks.holds(format!("{slab}: {r} {t}"), close(r, expected[0]) && close(t, expected[1]));
    }
    checks.finish();
}

/// At angles: thick slabs are half spaces, which H functions know, one without losses on a white ground sends all back, and there and back is the same.
#[test]
fn the_solver_agrees_with_half_spaces_and_is_reciprocal() {
    let mut checks = Checks::default();
    let cosines = [1.0, 0.5, 0.2];
    let isotropic = solver::moments(|_| 1.0 / (4.0 * PI));
    let slab = |tau, albedo, ground| {
        solver::solve(&solver::Slab { index: 1.0, tau, albedo, moments: &isotropic, ground }, cosines)
    };
    let mut close = |what: &str, x: f64, y: f64| checks.holds(format!("{what}: {x} {y}"), (x / y - 1.0).abs() < 2e-5);
    let (albedo, deep, thin, white) = (0.9, slab(60.0, 0.9, 0.0), slab(1.0, 0.9, 0.0), slab(3.0, 1.0, 1.0));
    let h = H::new(albedo);
    for (i, from) in cosines.into_iter().enumerate() {
        close("reflected", deep.reflected[i], h.reflected(from));
        close("by white ground", white.reflected[i], 1.0);
        for (j, to) in cosines.into_iter().enumerate() {
            let exact = albedo * from * h.at(from) * h.at(to) / (4.0 * PI * (from + to));
            close("radiance", deep.up[i][j], exact);
            if i != j {
                close("back through a thin slab", thin.down[i][j] / from, thin.down[j][i] / to);
            }
        }
    }
    checks.finish();
}

impl Slab {
    /// R and T of a beam at normal incidence, by the solver.
    pub fn exact(&self) -> [f64; 2] {
        let (g, schlick) = (self.g, self.phase == "schlick");
        let moments = solver::moments(|x: f64| {
            if schlick {
                (1.0 - g * g) / (4.0 * PI * (1.0 - g * x).powi(2))
            } else {
                (1.0 - g * g) / (4.0 * PI * (1.0 + g * g - 2.0 * g * x).powf(1.5))
            }
        });
        let slab =
            solver::Slab { index: self.index, tau: self.tau, albedo: self.albedo, moments: &moments, ground: 0.0 };
        let solution = solver::solve(&slab, [1.0; solver::DIRECTIONS]);
        [solution.reflected[0], solution.transmitted[0]]
    }

    fn materials(&self) -> String {
        let parameter = if self.phase == "schlick" { "k" } else { "g" };
        format!(
            "[media.fog]\nsigma_t = 1.0\nalbedo = {}\nphase = {{ type = \"{}\", {parameter} = {} }}\n\
             [materials.black]\ntype = \"lambert\"\nreflectance = 0\n\
             [materials.glass]\ntype = \"dielectric\"\nior = {}\n",
            self.albedo, self.phase, self.g, self.index
        )
    }

    /// A box from z = −τ to 0.
    fn block(&self, half: f64) -> String {
        format!(
            "{}[[shapes]]\ntype = \"box\"\nmin = [{}, {}, {}]\nmax = [{half}, {half}, 0]\nmaterial = \"{}\"\n\
             interior = \"fog\"\n",
            self.materials(),
            -half,
            -half,
            -self.tau,
            if self.index == 1.0 { "none" } else { "glass" }
        )
    }

    /// 50 times as wide as thick.
    fn wide(&self) -> String {
        self.block(50.0 * self.tau.max(1.0))
    }

    /// What a camera sees that looks straight at the wide slab, under a sky of radiance 1 above it or below. A black
    /// sheet hides the other half of it.
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

    /// A column of the slab between mirrors, which stand for all of its width. One end of the tube shines 1, the other
    /// is black. `view` is what the camera looks like, how it renders, and all about photons.
    pub fn column(&self, transmitted: bool, half: f64, view: &str) -> String {
        let (top, bottom) = (0.3, -self.tau - 0.3);
        let (lit, dark) = if transmitted { (bottom, top) } else { (top, bottom) };
        let mut text = format!(
            "[film]\nwidth = 1\nheight = 1\nlayers = false\n\
             [camera]\nposition = [0, 0, 0.2]\ntarget = [0, 0, 0]\n{view}\n{}\
             [materials.mirror]\ntype = \"mirror\"\nreflectance = 1\n\
             [[shapes]]\ntype = \"quad\"\norigin = [{a}, {a}, {dark}]\nedge_u = [{c}, 0, 0]\nedge_v = [0, {c}, 0]\n\
             material = \"black\"\n\
             [[shapes]]\ntype = \"disk\"\ncenter = [0, 0, {lit}]\nnormal = [0, 0, {}]\nradius = {}\n\
             material = \"black\"\nemission = {{ radiance = 1.0 }}\n",
            self.block(half + 0.01),
            if transmitted { 1 } else { -1 },
            1.6 * half,
            a = -half - 0.01,
            c = 2.0 * half + 0.02,
        );
        let height = top - bottom;
        for (x, y, u) in [(-1.0, -1.0, [1, 0]), (-1.0, 1.0, [1, 0]), (-1.0, -1.0, [0, 1]), (1.0, -1.0, [0, 1])] {
            text += &format!(
                "[[shapes]]\ntype = \"quad\"\norigin = [{}, {}, {bottom}]\nedge_u = [{}, {}, 0]\n\
                 edge_v = [0, 0, {height}]\nmaterial = \"mirror\"\n",
                half * x,
                half * y,
                2.0 * half * u[0] as f64,
                2.0 * half * u[1] as f64
            );
        }
        text
    }

    /// R or T by path tracing, its standard error at most `precise` of the exact value.
    fn by_path(&self, side: usize, samples: u32, effort: Effort, precise: impl Fn(f64) -> f64) -> Estimate {
        effort.estimate(&self.seen(side == 1, samples), &[], precise)
    }

    /// R or T by gathering. A camera that looks along the column sees no blur of kernels: light is the same all over a
    /// disc.
    fn by_gathering(&self, side: usize, effort: Effort, precise: impl Fn(f64) -> f64) -> Estimate {
        const PHOTONS: u32 = 30_000;
        // Discs almost as wide as the column, so that one ray meets most photons.
        let neighbours = (0.3 * f64::from(PHOTONS) / self.tau) as u32;
        let view = format!(
            "fov = 2\n[render]\nmethod = \"photon\"\nsamples = 64\n[photons]\nvolume = {PHOTONS}\n\
             [volume]\nneighbours = {neighbours}\nmax_radius = 0.49"
        );
        effort.estimate(&self.column(side == 1, 0.5, &view), &[], precise)
    }

    /// R and T by counting photons that leave, in lots of 100.
    fn by_counting(&self, effort: Effort, precise: [impl Fn(f64) -> f64; 2]) -> [Estimate; 2] {
        const LOT: u64 = 100;
        let camera = "[film]\nwidth = 1\nheight = 1\n[camera]\nposition = [0, 0, 2]\ntarget = [0, 0, 0]\n";
        let scene = scene(&format!("{camera}{}", self.wide()), &[]);
        let lot = |index: u32| {
            let photons = LOT * u64::from(index)..LOT * (u64::from(index) + 1);
            let powers = photons.map(|index| leaving(&scene, &mut Stream::new(5, Purpose::Test, index, 0)));
            powers.fold([0.0; 2], |sum, power| [0, 1].map(|side| sum[side] + power[side] / LOT as f64))
        };
        let over = |lots: &[[f64; 2]]| [0, 1].map(|side| Estimate::over(lots, |lot| [lot[side]; 3]));
        let enough =
            |lots: &[[f64; 2]]| over(lots).iter().zip(&precise).all(|(found, precise)| found.is_within(precise));
        over(&effort.draw(lot, enough))
    }
}

/// One photon on its way, and the power with which it leaves upwards, and downwards.
struct Leaving<'s, 't> {
    scene: &'s Scene,
    stream: &'t mut Stream,
    power: [f64; 2],
}

impl<'s> Traveller<'s> for Leaving<'s, '_> {
    type Own = ();

    fn scene(&self) -> &'s Scene {
        self.scene
    }

    fn stream(&mut self) -> &mut Stream {
        self.stream
    }

    fn segment(&mut self, segment: &Segment<'_>, luggage: &mut Luggage<()>, _: &mut Parts<'s, ()>) -> ControlFlow<f64> {
        let medium = &self.scene.media[segment.medium as usize];
        let (range, mut tally) = ((segment.a, segment.b), Tally::default());
        fly(medium, segment.ray, range, &mut luggage.weight, self.stream, &mut tally, |_, _, _| {})
            .map_or(ControlFlow::Continue(()), ControlFlow::Break)
    }

    fn turn(
        &mut self,
        at: Vertex<'_>,
        _: &Walk<'s>,
        luggage: &mut Luggage<()>,
        _: &mut Parts<'s, ()>,
    ) -> Option<Heading> {
        let onward = at.onward(Side::Light, None, &mut luggage.weight, self.stream, survive)?;
        Some(Heading { direction: onward.direction })
    }

    fn escapes(&mut self, direction: DVec3, luggage: &Luggage<()>) {
        self.power[usize::from(direction.z <= 0.0)] += luggage.weight.x;
    }

    fn stopped(&mut self) {
        panic!("a photon goes on for ever");
    }
}

/// The power of a photon that leaves upwards, and downwards, of 1 that comes from above.
fn leaving(scene: &Scene, stream: &mut Stream) -> [f64; 2] {
    let ray = Ray::new(DVec3::Z - scene.center, -DVec3::Z);
    let start =
        Part { walk: Walk::start(scene, ray, Inside::default()), luggage: Luggage::new(Rgb::ONE, ()), collision: None };
    let mut leaving = Leaving { scene, stream, power: [0.0; 2] };
    travel(&mut leaving, start, &mut Parts::new());
    leaving.power
}

/// Rows that between them have every index, phase function, thickness and albedo, with R and T, and how many times 800
/// samples these take by path tracing, for each seed.
fn cases() -> Vec<(Slab, [f64; 2], [u32; 2])> {
    let wanted = [
        ((1.0, 1.0, 0.9, 0.0), [10, 4]),
        ((1.0, 4.0, 0.5, 0.0), [1, 1]),
        ((1.0, 4.0, 1.0, 0.0), [8, 6]),
        ((1.0, 16.0, 0.99, 0.0), [1, 6]),
        ((1.0, 1.0, 0.5, 0.75), [10, 4]),
        ((1.0, 16.0, 1.0, 0.75), [2, 6]),
        ((1.0, 4.0, 1.0, 0.7), [3, 3]),
        ((1.4, 1.0, 0.9, 0.0), [3, 1]),
        ((1.4, 4.0, 0.99, 0.0), [1, 2]),
    ];
    let table = table();
    let case = |(wanted, samples): ((f64, f64, f64, f64), [u32; 2])| {
        let row = table.iter().find(|(slab, _)| (slab.index, slab.tau, slab.albedo, slab.g) == wanted);
        let (slab, _) = *row.unwrap_or_else(|| panic!("no row {wanted:?}"));
        (slab, slab.exact(), samples)
    };
    wanted.map(case).into()
}

const SIDES: [&str; 2] = ["R", "T"];

#[test]
fn slabs_by_path_tracing() {
    let mut checks = Checks::default();
    // Those that photons do not take, and the last, which both do: all thicknesses, albedos and phase functions.
    for (_, case) in cases().into_iter().enumerate().filter(|(index, _)| index % 2 == 1 || *index >= 6) {
        let (slab, exact, samples) = case;
        for (side, name) in SIDES.into_iter().enumerate() {
            let found = slab.by_path(side, 800 * samples[side], Effort::once(32), |_| 0.0);
            let precision = if exact[side] > 0.1 { 0.005 } else { 0.0125 };
            checks.agree(&format!("{slab}: {name}"), &found, &Estimate::exact([exact[side]; 3]), precision, 0.0);
        }
    }
    checks.finish();
}

#[test]
fn slabs_by_photons() {
    let mut checks = Checks::default();
    // Every second one, which leaves all of the indices and phase functions.
    for (slab, exact, _) in cases().into_iter().step_by(2) {
        for (side, name) in SIDES.into_iter().enumerate() {
            let found = slab.by_gathering(side, Effort::once(9), |_| 0.0);
            let precision = if exact[side] > 0.1 { 0.0125 } else { 0.025 };
            checks.agree(&format!("{slab}: {name}"), &found, &Estimate::exact([exact[side]; 3]), precision, 0.0);
        }
    }
    checks.finish();
}

/// Slabs that between them have both indices, thin and thick ones, and forward scattering; for R and T samples by path
/// tracing in lots of 400, in each of 16 renders, and photons in lots of 400.
const REFRACTING: [(Slab, [u32; 2], u32); 6] = [
    (Slab { index: 1.33, tau: 1.0, albedo: 0.9, phase: "hg", g: 0.9 }, [20, 1], 200),
    (Slab { index: 1.33, tau: 8.0, albedo: 0.99, phase: "hg", g: 0.5 }, [2, 4], 60),
    (Slab { index: 1.5, tau: 4.0, albedo: 0.99, phase: "hg", g: 0.9 }, [6, 2], 60),
    (Slab { index: 1.5, tau: 30.0, albedo: 0.999, phase: "hg", g: 0.8 }, [2, 7], 60),
    (Slab { index: 1.33, tau: 100.0, albedo: 1.0, phase: "hg", g: 0.9 }, [1, 0], 60),
    (Slab { index: 1.5, tau: 100.0, albedo: 0.999, phase: "hg", g: 0.0 }, [1, 0], 30),
];

#[test]
fn refracting_slabs_by_path_tracing_and_by_counting_photons() {
    let mut checks = Checks::default();
    for (slab, samples, photons) in REFRACTING {
        let exact = slab.exact();
        let counted = slab.by_counting(Effort::once(4 * photons), [|_| 0.0; 2]);
        for (side, name) in SIDES.into_iter().enumerate() {
            let value = Estimate::exact([exact[side]; 3]);
            if samples[side] > 0 {
                let found = slab.by_path(side, 400 * samples[side], Effort::once(16), |_| 0.0);
                checks.agree(&format!("{slab}: {name} by path"), &found, &value, 0.0095, 0.0);
            }
            let (what, found) = (format!("{slab}: {name} by photons"), &counted[side]);
            if exact[side] > 0.01 {
                checks.agree(&what, found, &value, 0.016, 0.0);
            } else {
                let (mean, error) = (found.mean[0], found.standard_error[0]);
                checks.holds(format!("{what}: {mean:.2e}"), (mean - exact[side]).abs() < 1e-4 + 3.0 * error);
            }
        }
    }
    checks.finish();
}

/// All rows of the table, and what refracts at two more indices, with R and T.
fn grid() -> Vec<(Slab, [f64; 2])> {
    let mut slabs: Vec<Slab> = table().into_iter().map(|(slab, _)| slab).collect();
    for index in [1.33, 1.5] {
        for g in [0.0, 0.5, 0.9] {
            for tau in [1.0, 4.0, 16.0, 100.0] {
                slabs.extend([0.9, 0.99, 1.0].map(|albedo| Slab { index, tau, albedo, phase: "hg", g }));
            }
        }
    }
    slabs.into_iter().map(|slab| (slab, slab.exact())).collect()
}

/// The sides of the grid that `VOLPM_CASES` chooses: slab, what it is called, side, and the exact value. What is below
/// 1e-9 no sampling sees.
fn sides() -> impl Iterator<Item = (Slab, String, usize, f64)> {
    let sides = |(slab, exact): (Slab, [f64; 2])| {
        [0, 1].map(|side| (slab, format!("{slab}: {}", SIDES[side]), side, exact[side]))
    };
    grid().into_iter().flat_map(sides).filter(|(_, what, _, exact)| *exact > 1e-9 && chosen(what))
}

#[test]
#[ignore = "an hour of one core: cargo test --release --test promises every_slab_by_path -- --ignored --nocapture"]
fn every_slab_by_path_tracing() {
    let mut checks = Checks::default();
    for (slab, what, side, exact) in sides() {
        let value = Estimate::exact([exact; 3]);
        if exact > 1e-3 {
            let found = slab.by_path(side, 1000, Effort::patient(&what, 16), |_| 0.005 * exact);
            checks.agree(&what, &found, &value, 0.005, 0.0);
        } else {
            let found = slab.by_path(side, 1000, Effort::patient(&what, 200), |_| STRICT.1 * 1e-4);
            checks.close(&what, &found, &value, 0.0, STRICT);
        }
    }
    checks.finish();
}

#[test]
#[ignore = "an hour of one core: cargo test --release --test promises every_slab_by_counting -- --ignored --nocapture"]
fn every_slab_by_counting_photons() {
    let mut checks = Checks::default();
    for (slab, exact) in grid().into_iter().filter(|(slab, _)| chosen(&slab.to_string())) {
        let precise = exact.map(|exact| move |_| STRICT.1 * allowed(exact, 0.01));
        let found = slab.by_counting(Effort::patient(&slab.to_string(), 2000), precise);
        for side in [0, 1].into_iter().filter(|&side| exact[side] > 1e-9) {
            let what = format!("{slab}: {}", SIDES[side]);
            checks.close(&what, &found[side], &Estimate::exact([exact[side]; 3]), 0.01, STRICT);
        }
    }
    checks.finish();
}

#[test]
#[ignore = "some hours of one core: cargo test --release --test promises every_slab_by_gathering -- --ignored --nocapture"]
fn every_slab_by_gathering() {
    let mut checks = Checks::default();
    for (slab, what, side, exact) in sides() {
        let found = slab.by_gathering(side, Effort::patient(&what, 16), |_| STRICT.1 * allowed(exact, 0.02));
        checks.close(&what, &found, &Estimate::exact([exact; 3]), 0.02, STRICT);
    }
    checks.finish();
}
