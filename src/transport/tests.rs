//! One harness for all that scatters: every material and every phase function, asked as a vertex.

use std::f64::consts::PI;

use rayon::prelude::*;

use super::{Collision, Interaction, Vertex};
use crate::math::random::Purpose;
use crate::math::{DVec3, Rgb, Stream, sampling};
use crate::medium::density::Density;
use crate::medium::phase::{Draine, HenyeyGreenstein, Isotropic, Mixture, Phase, Rayleigh, Schlick};
use crate::medium::{Emission, Medium};
use crate::scene::Inside;
use crate::scene::description::Caustics;
use crate::surface::{
    Bsdf, Coat, Coated, Conductor, Fresnel, Incidence, Lambert, Lobe, Mirror, Mix, Nature, OrenNayar, Phong, Reflector,
    Rough, Scattering, Schlick as SchlickSurface, Side, Smooth, Thin, Varnish,
};

/// Something that scatters, and light that meets it.
struct Case {
    name: String,
    at: At,
    /// Whether a value is what it is, and no estimate of it.
    exact: bool,
    /// What is left of white light.
    albedo: Albedo,
    /// Whether its values vary so that some samples tell their mean: where indices all but match, light that facets beyond
    /// the first send goes into lobes of a ten-thousandth.
    even: bool,
}

enum At {
    Surface(Interaction),
    Medium(Medium, DVec3),
}

impl Case {
    fn of(&self, with: impl FnOnce(Vertex<'_>)) {
        match &self.at {
            At::Surface(at) => with(Vertex::Surface(at)),
            At::Medium(medium, direction) => with(Vertex::Medium(&Collision {
                point: DVec3::ZERO,
                direction: *direction,
                t: 0.0,
                medium,
                index: 0,
                inside: &Inside::default(),
                peak: None,
            })),
        }
    }
}

pub(super) fn interaction(bsdf: Bsdf, incidence: Incidence) -> Interaction {
    let (before, after) = (Inside::default(), Inside::default());
    let caustics = Caustics::ALL;
    Interaction { point: DVec3::ZERO, incidence, t: 1.0, bsdf, caustics, offset: 1e-9, before, after }
}

/// Light that meets a surface with normal z at an angle of this sine, whose shading normal leans by `lean`.
fn incidence(sin: f64, lean: f64) -> Incidence {
    let direction = DVec3::new(0.8 * sin, 0.6 * sin, -(1.0 - sin * sin).sqrt());
    let shading_normal = DVec3::new(lean.sin() * 0.6, -lean.sin() * 0.8, lean.cos());
    Incidence { direction, normal: DVec3::Z, shading_normal, tangent: DVec3::new(0.6, 0.8, 0.0) }
}

const SINES: [f64; 4] = [0.0, 0.6, 0.95, 0.99999];
const NEARLY_NOTHING: Rgb = Rgb::splat(1.0001);
const PARTING: Rgb = Rgb::new(1.4, 1.5, 1.7);

/// A material under test.
struct Kind {
    name: String,
    bsdf: Bsdf,
    /// Whether a value is what it is, and no estimate of it.
    exact: bool,
    /// What is left of white light, if that is known: by channel, or all of it where it comes to 1.
    albedo: Albedo,
}

impl Kind {
    /// Whether what it sends first is reciprocal by itself. Between a coat and a base that both reflect specularly, light goes to and
    /// fro before that from one end, and thereafter from the other.
    fn is_reciprocal_at_once(&self) -> bool {
        !matches!(self.bsdf, Bsdf::Coated(Coated { base: Reflector::Schlick(base), .. }) if base.roughness < 0.5)
    }
}

#[derive(Clone, Copy, PartialEq)]
enum Albedo {
    /// As [`Vertex::albedo`] says.
    Known,
    /// 1: nothing is absorbed.
    Lossless,
    /// Less than 1 somehow.
    AtMostOne,
}

fn materials() -> Vec<Kind> {
    let reflectance = Rgb::new(0.9, 0.5, 0.1);
    let mut all = Vec::new();
    let mut exactly = |name: String, reflector: Reflector, albedo: Albedo| {
        all.push(Kind { name, bsdf: reflector.into(), exact: true, albedo });
    };
    let lambert = |reflectance| Reflector::Lambert(Lambert { reflectance });
    exactly("lambert".to_string(), lambert(reflectance), Albedo::Known);
    for sigma in [0.2, 1.5] {
        let oren_nayar = OrenNayar { reflectance, sigma };
        exactly(format!("oren-nayar {sigma}"), Reflector::OrenNayar(oren_nayar), Albedo::Known);
    }
    for exponent in [0.0, 7.5, 3000.0] {
        let phong = Phong { diffuse: 0.5 * reflectance, specular: Rgb::new(0.1, 0.5, 0.8), exponent };
        exactly(format!("phong {exponent}"), Reflector::Phong(phong), Albedo::AtMostOne);
    }

    // Of facets and layers: values are estimates, but for smooth coats over Lambertian bases.
    let mut estimated = |name: String, bsdf: Bsdf, albedo: Albedo| {
        let smooth = |coat: Coat| matches!(coat, Coat::Dielectric(Varnish { roughness: 0.0, .. }));
        let closed = matches!(bsdf, Bsdf::Coated(Coated { base: Reflector::Lambert(_), coat }) if smooth(coat));
        all.push(Kind { name, bsdf, exact: closed, albedo: if closed { Albedo::Known } else { albedo } });
    };
    let gold = Fresnel::metals().find(|(name, _)| *name == "Au").expect("gold is a metal").1;
    let white = Fresnel::Schlick { f0: Rgb::ONE };
    let conductor = |fresnel, roughness| Reflector::Conductor(Conductor { fresnel, roughness });
    for roughness in [[0.1; 2], [0.05, 0.4], [0.9, 0.6]] {
        estimated(format!("gold {roughness:?}"), conductor(gold, roughness).into(), Albedo::AtMostOne);
        estimated(format!("white metal {roughness:?}"), conductor(white, roughness).into(), Albedo::Lossless);
    }
    for (roughness, isotropy) in [(0.1, 1.0), (0.4, 0.3), (0.9, 0.5)] {
        for (f0, albedo) in [(reflectance, Albedo::AtMostOne), (Rgb::ONE, Albedo::Lossless)] {
            let schlick = Reflector::Schlick(SchlickSurface { f0, roughness, isotropy });
            estimated(format!("schlick {roughness} {isotropy} {f0}"), schlick.into(), albedo);
        }
    }
    let coated = |base: Reflector, roughness: f64, index: f64| {
        let coat = Coat::Dielectric(Varnish::new(index, roughness));
        Bsdf::Coated(Coated { base, coat })
    };
    for roughness in [0.0, 0.1, 0.6] {
        let metal = |fresnel| conductor(fresnel, [0.3, 0.2]);
        for (base, name, albedo) in [
            (lambert(reflectance), "colour", Albedo::AtMostOne),
            (lambert(Rgb::ONE), "white", Albedo::Lossless),
            (metal(gold), "gold", Albedo::AtMostOne),
            (metal(white), "white metal", Albedo::Lossless),
        ] {
            let name = format!("{name} under a coat, α {roughness}");
            estimated(name, coated(base, roughness, if roughness == 0.1 { 1.2 } else { 1.5 }), albedo);
        }
    }
    let mirror = Reflector::Mirror(Mirror { reflectance: Rgb::ONE });
    estimated("a mirror under a rough coat".to_string(), coated(mirror, 0.3, 1.5), Albedo::Lossless);
    for (name, a, b, albedo) in [
        ("colour and gold", lambert(reflectance), conductor(gold, [0.2; 2]), Albedo::AtMostOne),
        ("white and a white metal", lambert(Rgb::ONE), conductor(white, [0.4; 2]), Albedo::Lossless),
    ] {
        estimated(format!("a mix of {name}"), Bsdf::Mix(Mix { a, b, weight: 0.3 }), albedo);
    }
    let index = |n: f64| Rgb::splat(n);
    for (name, from, to) in [
        ("into glass", index(1.0), index(1.5)),
        ("out of glass", index(1.5), index(1.0)),
        ("into nearly nothing", index(1.0), NEARLY_NOTHING),
        ("into diamond and more", index(1.0), index(4.0)),
        ("into flint that disperses", index(1.0), PARTING),
        ("out of flint that disperses", PARTING, index(1.0)),
    ] {
        for alpha in [0.1, 0.3, 1.0] {
            estimated(format!("rough {name}, α {alpha}"), Bsdf::Rough(Rough { from, to, alpha }), Albedo::Lossless);
        }
    }
    let schlick = |f0, roughness, isotropy| SchlickSurface { f0, roughness, isotropy };
    for roughness in [0.0, 0.25] {
        let base = Reflector::Schlick(schlick(Rgb::ONE, 0.1, 0.5));
        estimated(format!("half a mirror under a coat, α {roughness}"), coated(base, roughness, 1.5), Albedo::Lossless);
    }
    let pale = Rgb::new(0.04, 0.3, 0.7);
    for (upper, below) in [
        (schlick(pale, 0.1, 1.0), (0.9, 1.0)),
        (schlick(pale, 0.0, 1.0), (0.1, 0.6)),
        (schlick(pale, 0.3, 0.4), (0.2, 1.0)),
        (schlick(pale, 0.8, 1.0), (0.05, 1.0)),
        (schlick(Rgb::splat(0.5), 0.3, 1.0), (0.0, 1.0)),
    ] {
        for (f0, albedo) in [(reflectance, Albedo::AtMostOne), (Rgb::ONE, Albedo::Lossless)] {
            let base = Reflector::Schlick(schlick(f0, below.0, below.1));
            let name = format!("schlick {} {} over {below:?} {f0}", upper.roughness, upper.isotropy);
            estimated(name, Bsdf::Coated(Coated { base, coat: Coat::Schlick(upper) }), albedo);
        }
    }
    all
}

fn phases() -> Vec<(String, Phase)> {
    let mut all: Vec<(String, Phase)> = vec![
        ("isotropic".to_string(), Phase::Isotropic(Isotropic)),
        ("rayleigh".to_string(), Phase::Rayleigh(Rayleigh)),
        ("draine".to_string(), Phase::Draine(Draine { g: 0.7, alpha: 2.0 })),
    ];
    for g in [0.5, -0.9, 0.99, 0.9999, -0.999_999] {
        all.push((format!("henyey-greenstein {g}"), Phase::HenyeyGreenstein(HenyeyGreenstein { g })));
        all.push((format!("schlick {g}"), Phase::Schlick(Schlick { k: g })));
    }
    let two = [(0.3, Phase::Rayleigh(Rayleigh)), (0.7, Phase::HenyeyGreenstein(HenyeyGreenstein { g: 0.95 }))];
    all.push(("mixture".to_string(), Phase::Mixture(Mixture::new(two.to_vec()))));
    all
}

fn cases(lean: f64) -> Vec<Case> {
    let mut all = Vec::new();
    for Kind { name, bsdf, exact, albedo } in materials() {
        for sin in SINES {
            let at = incidence(sin, lean);
            if at.direction.dot(at.shading_normal) < 0.0 {
                let even = !matches!(bsdf, Bsdf::Rough(Rough { to, .. }) if to == NEARLY_NOTHING);
                let name = format!("{name}, sine {sin}");
                all.push(Case { name, at: At::Surface(interaction(bsdf, at)), exact, albedo, even });
            }
        }
    }
    if lean == 0.0 {
        for (name, phase) in phases() {
            let medium = Medium {
                name: name.clone(),
                extinction: Rgb::ONE,
                albedo: Rgb::new(0.9, 0.5, 0.1).into(),
                phase: phase.into(),
                density: Density::Uniform,
                emission: Emission::None,
            };
            all.push(Case { name, at: At::Medium(medium, DVec3::Z), exact: true, albedo: Albedo::Known, even: true });
        }
    }
    all
}

pub(super) fn random(index: usize) -> Stream {
    Stream::new(77, Purpose::Test, index as u64, 0)
}

/// All that goes along `o`, and the first part of it.
fn toward(at: Vertex<'_>, o: DVec3, side: Side, stream: &mut Stream) -> (Rgb, Scattering) {
    let (mut value, mut first) = (Rgb::ZERO, None);
    at.toward(o, side, false, Rgb::ONE, stream, |weight, sent| {
        assert!(sent.value.is_finite() && sent.ahead.is_finite(), "{sent:?}");
        for channel in 0..3 {
            assert!(sent.value[channel] <= 0.0 || sent.ahead[channel] > 0.0, "{o}: not drawn, but sent: {sent:?}");
        }
        value += weight * sent.value;
        first.get_or_insert(Scattering { value: weight * sent.value, ..sent });
    });
    (value, first.unwrap_or(Scattering { value: Rgb::ZERO, ahead: Rgb::ZERO }))
}

/// A direction with its weight, and whether it has a density: else no one can ask for light from there.
fn draw(at: Vertex<'_>, side: Side, stream: &mut Stream) -> (DVec3, Rgb, bool) {
    let mut weight = Rgb::ONE;
    let always = |weight: &mut Rgb, factor: Rgb, _: &mut Stream| {
        *weight *= factor;
        true
    };
    match at.onward(side, None, &mut weight, stream, always) {
        Some(onward) => (onward.direction, weight, onward.density > 0.0),
        None => (DVec3::ZERO, Rgb::ZERO, false),
    }
}

/// A cell of directions: a range of cos θ and one of φ.
#[derive(Clone, Copy)]
struct Cell {
    cos: [f64; 2],
    phi: [f64; 2],
}

impl Cell {
    const SPHERE: Cell = Cell { cos: [-1.0, 1.0], phi: [-PI, PI] };

    /// 1 − cos θ is kept apart, so that lobes of a millionth about the axis have cells of their own.
    fn holds(&self, (below, phi): (f64, f64)) -> bool {
        let cos = [1.0 - self.cos[1], 1.0 - self.cos[0]];
        cos[0] <= below && below < cos[1] && self.phi[0] <= phi && phi < self.phi[1]
    }

    fn solid_angle(&self) -> f64 {
        (self.cos[1] - self.cos[0]) * (self.phi[1] - self.phi[0])
    }

    /// Halved along its longer side.
    fn halves(&self) -> [Cell; 2] {
        let middle = |[a, b]: [f64; 2]| 0.5 * (a + b);
        // As seen on the sphere.
        let sin = (1.0 - middle(self.cos).powi(2)).sqrt();
        let tall = (self.cos[1] - self.cos[0]) / sin.max(1e-12);
        if tall > sin * (self.phi[1] - self.phi[0]) {
            let m = middle(self.cos);
            [Cell { cos: [self.cos[0], m], ..*self }, Cell { cos: [m, self.cos[1]], ..*self }]
        } else {
            let m = middle(self.phi);
            [Cell { phi: [self.phi[0], m], ..*self }, Cell { phi: [m, self.phi[1]], ..*self }]
        }
    }

    fn direction(&self, [u, v]: [f64; 2]) -> DVec3 {
        let cos = self.cos[0] + (self.cos[1] - self.cos[0]) * u;
        let phi = self.phi[0] + (self.phi[1] - self.phi[0]) * v;
        let sin = (1.0 - cos * cos).max(0.0).sqrt();
        DVec3::new(sin * phi.cos(), sin * phi.sin(), cos)
    }
}

fn polar(o: DVec3) -> (f64, f64) {
    let across = o.x * o.x + o.y * o.y;
    let below = if o.z > 0.0 { across / (1.0 + o.z) } else { 1.0 - o.z };
    (below.min(2.0 - 1e-15), o.y.atan2(o.x).min(PI - 1e-15))
}

/// Drawn weights, but for those of specular parts, against the mean of the value, and numbers of draws against the density where that is exact: χ² over cells of
/// the sphere, small where many are drawn. What the cells sum up to is the albedo.
fn draws_follow(case: &Case, index: usize, side: Side, failed: &mut Vec<String>) {
    const N: usize = 30_000;
    const MOST: usize = 400;
    // Light that comes back from facets beyond the first is seldom sent, and then much of it.
    let strata = if case.exact { 10 } else { 32 };
    let count = (strata * strata) as f64;
    case.of(|at| {
        let mut stream = random(index);
        let drawn: Vec<((f64, f64), Rgb)> = (0..N)
            .map(|_| draw(at, side, &mut stream))
            .filter(|(_, weight, spread)| *weight != Rgb::ZERO && *spread)
            .map(|(o, weight, _)| (polar(o), weight))
            .collect();
        let least = (drawn.len() / MOST).min(20) as f64;

        // Cells that hold few draws each.
        let mut cells = Vec::new();
        let mut waiting = vec![(Cell::SPHERE, drawn, 0)];
        while let Some((cell, drawn, depth)) = waiting.pop() {
            if drawn.len() <= MOST || depth >= 60 {
                cells.push((cell, drawn));
                continue;
            }
            for half in cell.halves() {
                let inside = drawn.iter().filter(|(place, _)| half.holds(*place)).copied().collect();
                waiting.push((half, inside, depth + 1));
            }
        }

        // Each quantity in each cell: by draws, and by integration.
        let (mut chi2, mut degrees, mut total, mut unsure) = (0.0, 0.0f64, [Rgb::ZERO; 2], Rgb::ZERO);
        let mut rest = [[0.0; 4]; 2];
        for (cell, drawn) in &cells {
            let area = cell.solid_angle() / count;
            let mut integrals = [[0.0; 2]; 2];
            let (mut sent, mut sent_squares) = (Rgb::ZERO, Rgb::ZERO);
            for k in 0..strata * strata {
                let jitter = stream.uniform2();
                let place = [(k / strata) as f64 + jitter[0], (k % strata) as f64 + jitter[1]];
                let o = cell.direction(place.map(|x| x / strata as f64));
                let (value, Scattering { ahead: density, .. }) = toward(at, o, side, &mut stream);
                sent += value * area;
                sent_squares += value * value * (area * area);
                for (sum, x) in integrals.iter_mut().zip([value.y, density.y]) {
                    *sum = [sum[0] + x * area, sum[1] + (x * area).powi(2)];
                }
            }
            total[1] += sent;
            unsure += (sent_squares - sent * sent / count).max(Rgb::ZERO);
            let n = N as f64;
            total[0] += drawn.iter().map(|(_, weight)| *weight).sum::<Rgb>() / n;
            let weights = drawn.iter().map(|(_, weight)| weight.y);
            let sums = [
                (weights.clone().sum::<f64>() / n, weights.map(|w| w * w).sum::<f64>() / (n * n)),
                (drawn.len() as f64 / n, drawn.len() as f64 / (n * n)),
            ];
            for (what, ((sum, variance), [integral, squares])) in sums.into_iter().zip(integrals).enumerate() {
                if what == 1 && !case.exact {
                    continue;
                }
                // No stratum is known better than a few per cent of its variation.
                let off = (squares - integral * integral / count).max(0.0);
                let row = [sum, integral, variance, off];
                if drawn.len() >= 20 {
                    let error = variance + off + (0.01 * integral).powi(2);
                    chi2 += (sum - integral).powi(2) / error;
                    degrees += 1.0;
                } else {
                    rest[what].iter_mut().zip(row).for_each(|(all, x)| *all += x);
                }
            }
        }
        for [sum, integral, variance, off] in rest {
            let error = variance + off + (0.03 * integral).powi(2) + 1e-8;
            if (sum - integral).powi(2) > 20.0 * error {
                failed.push(format!("{}: {sum} is drawn aside, not {integral}", case.name));
            }
        }
        // Errors of estimates are themselves known from a few values, some of them rare and large.
        let limit = degrees + if case.exact { 5.0 } else { 10.0 } * (2.0 * degrees).sqrt();
        if degrees < least || chi2 > limit {
            failed.push(format!("{}: χ² {chi2:.0} over {degrees} cells", case.name));
        }

        // All of them.
        let off = (total[0] - total[1]).abs() - 4.0 * unsure.map(f64::sqrt);
        if off.max_element() > 0.03 * total[0].max_element().max(1.0) {
            failed.push(format!("{}: {} drawn, {} sent", case.name, total[0], total[1]));
        }
    });
}

#[test]
fn draws_follow_values_and_densities() {
    let check = |(index, case): (usize, Case)| {
        let mut failed = Vec::new();
        if case.even {
            draws_follow(&case, index, if index % 2 == 0 { Side::Light } else { Side::Eye }, &mut failed);
        }
        failed
    };
    let failed: Vec<String> = cases(0.0).into_par_iter().enumerate().flat_map_iter(check).collect();
    assert!(failed.is_empty(), "{failed:#?}");
}

/// What is drawn carries the albedo on average, as power: nothing is lost and nothing made. Eyes that look about a shading
/// normal never find more.
#[test]
fn furnaces_hold_the_albedo() {
    const N: usize = 20_000;
    for lean in [0.0, 0.4] {
        for (index, case) in cases(lean).iter().enumerate() {
            case.of(|at| {
                let side = if lean == 0.0 { Side::Light } else { Side::Eye };
                let (mut sum, mut squares) = (Rgb::ZERO, Rgb::ZERO);
                let mut stream = random(1000 + index);
                for _ in 0..N {
                    let (o, mut weight, _) = draw(at, side, &mut stream);
                    if let Vertex::Surface(Interaction { bsdf: Bsdf::Rough(rough), .. }) = at
                        && side == Side::Eye
                        && o.z < 0.0
                    {
                        // Radiance is larger where the index is, energy is not.
                        weight *= (rough.to / rough.from) * (rough.to / rough.from);
                    }
                    sum += weight;
                    squares += weight * weight;
                }
                let mean = sum / N as f64;
                let error = ((squares / N as f64 - mean * mean).max(Rgb::ZERO) / N as f64).map(f64::sqrt);
                let albedo = if case.albedo == Albedo::Known { at.albedo() } else { Rgb::ONE };
                for channel in 0..3 {
                    let (off, most) = (mean[channel] - albedo[channel], 4.5 * error[channel] + 1e-9);
                    let equals = lean == 0.0 && case.albedo != Albedo::AtMostOne;
                    let holds = if equals { off.abs() < most } else { off < most };
                    assert!(holds, "{}, leaning {lean}: {mean} ± {error}, albedo {albedo}", case.name);
                }
            });
        }
    }
}

/// How the same place is met from the other end of a path that leaves it along `o`.
fn reversed(at: &Interaction, o: DVec3) -> Interaction {
    let Incidence { normal, shading_normal, .. } = at.incidence;
    let through = o.dot(normal) < 0.0;
    let turn = if through { -1.0 } else { 1.0 };
    let bsdf = match at.bsdf {
        Bsdf::Rough(rough) if through => Bsdf::Rough(Rough { from: rough.to, to: rough.from, ..rough }),
        other => other,
    };
    interaction(
        bsdf,
        Incidence { direction: -o, normal: turn * normal, shading_normal: turn * shading_normal, ..at.incidence },
    )
}

/// A photon that arrives along i and leaves along o, and an eye path that arrives along −o and leaves along −i, are one: value of
/// light times |i·g| is value of eyes times |o·g|, with the geometric normal g, whatever the shading normal, the indices and
/// the side. Without a shading normal that is reciprocity. Of rough boundaries it is asked of single facets, whose values are no
/// estimates.
#[test]
fn light_and_eye_see_the_same() {
    for lean in [0.0, 0.3] {
        for Kind { name, bsdf, .. } in materials().into_iter().filter(Kind::is_reciprocal_at_once) {
            let mut stream = random(2000);
            let (mut pairs, mut lit) = (0, 0);
            while pairs < 2000 {
                let i = -sampling::direction(stream.uniform().max(1e-3), stream.uniform());
                let at = interaction(bsdf, Incidence { direction: i, ..incidence(0.0, lean) });
                let o = sampling::sphere(stream.uniform2());
                let (g, s) = (at.incidence.normal, at.incidence.shading_normal);
                let back = reversed(&at, o);
                let faces = |at: &Interaction| at.incidence.direction.dot(at.incidence.shading_normal) < 0.0;
                if !faces(&at) || !faces(&back) || (o.dot(g) < 0.0) != (o.dot(s) < 0.0) {
                    continue;
                }
                let light = toward(Vertex::Surface(&at), o, Side::Light, &mut stream).1.value * i.dot(g).abs();
                let eye = toward(Vertex::Surface(&back), -i, Side::Eye, &mut stream).1.value * o.dot(g).abs();
                let off = (light - eye).abs().max_element();
                assert!(off <= 1e-6 * light.max_element(), "{name}, leaning {lean}: {i} to {o}: {light} and {eye}");
                pairs += 1;
                lit += u32::from(light.max_element() > 0.0);
            }
            assert!(lit > 100, "{name}, leaning {lean}: only {lit} pairs of directions send light");
        }
    }
}

/// What goes from a cone of directions into another through layers that light goes to and fro between is the same both ways.
#[test]
fn layers_are_reciprocal() {
    const N: usize = 30_000;
    let kinds = materials().into_iter().filter(|kind| !kind.is_reciprocal_at_once());
    for (index, Kind { name, bsdf, .. }) in kinds.enumerate() {
        let mut stream = random(4000 + index);
        let (mut sum, mut difference, mut squares) = (Rgb::ZERO, Rgb::ZERO, Rgb::ZERO);
        for _ in 0..N {
            let i = -sampling::direction(0.2 + 0.3 * stream.uniform(), 0.3 * stream.uniform());
            let o = sampling::direction(0.6 + 0.3 * stream.uniform(), 0.3 + 0.3 * stream.uniform());
            let at = interaction(bsdf, Incidence { direction: i, ..incidence(0.0, 0.0) });
            let back = reversed(&at, o);
            let forth = toward(Vertex::Surface(&at), o, Side::Light, &mut stream).0 * i.z.abs();
            let back = toward(Vertex::Surface(&back), -i, Side::Light, &mut stream).0 * o.z;
            sum += forth;
            difference += forth - back;
            squares += (forth - back) * (forth - back);
        }
        let error = squares.map(f64::sqrt);
        for c in 0..3 {
            assert!(difference[c].abs() < 4.0 * error[c], "{name}: {sum} differs by {difference} ± {error}");
            assert!(error[c] < 0.03 * sum[c], "{name}: {sum} ± {error}");
        }
    }
}

/// Specular kinds answer no question about a density; smooth boundaries split light into parts that make up all of it.
#[test]
fn specular_kinds_have_no_density() {
    let reflectance = Rgb::new(0.9, 0.5, 0.1);
    let smooth = |from: Rgb, to: Rgb| Bsdf::Smooth(Smooth { from, to });
    let all = [
        Bsdf::from(Reflector::Mirror(Mirror { reflectance })),
        Bsdf::Thin(Thin { index: Rgb::new(1.3, 1.5, 1.9) }),
        smooth(Rgb::ONE, Rgb::splat(1.5)),
        smooth(Rgb::splat(1.5), Rgb::ONE),
        smooth(Rgb::ONE, PARTING),
    ];
    for (index, bsdf) in all.into_iter().enumerate() {
        for sin in SINES {
            let at = interaction(bsdf, incidence(sin, 0.0));
            let vertex = Vertex::Surface(&at);
            assert_eq!(vertex.nature(), Nature::Specular);
            let mut stream = random(3000 + index);
            let always = |weight: &mut Rgb, factor: Rgb, _: &mut Stream| {
                *weight *= factor;
                true
            };
            let sent = |lobe: Option<Lobe>, stream: &mut Stream| {
                const N: usize = 4000;
                let mut sum = Rgb::ZERO;
                for _ in 0..N {
                    let mut weight = Rgb::ONE;
                    if let Some(onward) = vertex.onward(Side::Light, lobe, &mut weight, stream, always) {
                        assert_eq!(onward.density, 0.0);
                        sum += weight / N as f64;
                        assert_eq!(toward(vertex, onward.direction, Side::Light, stream).0, Rgb::ZERO);
                    }
                }
                sum
            };
            let drawn = sent(None, &mut stream);
            assert!((drawn - vertex.albedo()).abs().max_element() < 0.1, "{bsdf:?}: {drawn}");
            if let Some(boundary) = at.bsdf.boundary(&at.incidence) {
                let parts = [Lobe::Reflected, Lobe::Refracted].map(|lobe| sent(Some(lobe), &mut stream));
                let reflected = boundary.reflected.expect("smooth");
                assert!((parts[0] - reflected).abs().max_element() < 1e-9, "{bsdf:?}: {} reflected", parts[0]);
                assert!((parts[0] + parts[1] - Rgb::ONE).abs().max_element() < 0.1, "{bsdf:?}: {parts:?}");
            }
        }
    }
}

/// What a coat or a sheet mirrors and what comes from the base or passes, each followed for certain, are together what is drawn by chance:
/// above and below a plane, and as a mirror. Where both are followed, so are the densities.
#[test]
fn coats_and_their_bases_may_be_followed_apart() {
    const N: usize = 40_000;
    let always = |weight: &mut Rgb, factor: Rgb, _: &mut Stream| {
        *weight *= factor;
        true
    };
    let mut found = 0;
    for (index, kind) in materials().iter().enumerate() {
        for sin in SINES {
            let at = interaction(kind.bsdf, incidence(sin, 0.0));
            let Some((mirrored, factor)) = at.bsdf.mirrored(&at.incidence) else { continue };
            found += 1;
            let vertex = Vertex::Surface(&at);
            let mut stream = random(4000 + index);
            // The mean weight of what is mirrored, of what goes steeply and of what goes flatly from the base, with variances.
            let mut sent = |lobe: Option<Lobe>| {
                let (mut sums, mut squares) = ([0.0; 3], [0.0; 3]);
                for _ in 0..N {
                    let mut weight = Rgb::ONE;
                    let Some(onward) = vertex.onward(Side::Eye, lobe, &mut weight, &mut stream, always) else {
                        continue;
                    };
                    let bin = match onward.density {
                        0.0 if onward.direction.z > 0.0 => 0,
                        _ if onward.direction.z > 0.6 => 1,
                        _ => 2,
                    };
                    assert!(bin > 0 || onward.direction.distance(mirrored) < 1e-12, "{}: {onward:?}", kind.name);
                    sums[bin] += weight.y / N as f64;
                    squares[bin] += weight.y * weight.y / N as f64;
                }
                [0, 1, 2].map(|bin| (sums[bin], (squares[bin] - sums[bin] * sums[bin]) / N as f64))
            };
            let drawn = sent(None);
            let coat = sent(Some(Lobe::Reflected));
            let base = sent(Some(Lobe::Refracted));
            assert!((coat[0].0 - factor.y).abs() < 1e-9 && coat[1].0 + coat[2].0 == 0.0, "{}: {coat:?}", kind.name);
            assert_eq!(base[0].0, 0.0, "{}", kind.name);
            for (bin, drawn) in drawn.iter().enumerate() {
                let apart = coat[bin].0 + base[bin].0;
                let error = (drawn.1 + base[bin].1).sqrt();
                assert!((drawn.0 - apart).abs() < 4.5 * error + 1e-9, "{}, {sin}: {drawn:?}, {apart}", kind.name);
            }

            // The density of what a draw from the base finds, as one who asks there is told.
            let mut weight = Rgb::ONE;
            let onward = vertex.onward(Side::Eye, Some(Lobe::Refracted), &mut weight, &mut stream, always);
            let Some(onward) = onward.filter(|onward| onward.density > 0.0) else { continue };
            let mut told = None;
            vertex.toward(onward.direction, Side::Eye, true, Rgb::ONE, &mut stream, |_, sent| {
                told.get_or_insert(sent.ahead.y);
            });
            if let Some(told) = told {
                assert!((told / onward.density - 1.0).abs() < 1e-9, "{}: {told}, {}", kind.name, onward.density);
            }
        }
    }
    assert!(found >= 6, "{found} coats that mirror");
}
