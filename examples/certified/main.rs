//! Makes the tables of `docs/certified.md`: what the renderer finds, by every estimator, where others know the answer.
//!
//! ```sh
//! cargo run --release --example certified -- docs/certified.md                # writes them into the page
//! cargo run --release --example certified -- docs/certified.md slabs spheres  # these alone
//! cargo run --release --example certified                                     # prints them
//! ```
//!
//! Numbers are the same at each run on one machine. What others know is computed here (`adding.rs`, `half_space.rs`, `exact.rs`) and, by other people's
//! programs, in `tests/data/certified.json`.

mod adding;
mod exact;
mod half_space;
mod measure;
mod scenes;
mod table;
mod witnesses;

use std::error::Error;
use std::fmt::Write;

use adding::{Solution, moments, solve};
use measure::{Effort, Found, Method, cpu_seconds, measure};
use scenes::{Light, Slab, View};
use table::{Row, digits};
use volpm::math::DVec3;
use volpm::medium::phase::{Phase, mie};
use witnesses::Witnesses;

type Outcome<T> = Result<T, Box<dyn Error>>;

/// Cosines to the normal of beams and views: 0°, 60°, and one that grazes.
const COSINES: [f64; 3] = [1.0, 0.5, 0.2];

/// What a number is worth unless it says otherwise: about a second.
const EFFORT: Effort = Effort { seeds: 8, samples: 200, light: 80, photons: 20_000, rays: 2, peaks: "auto" };

fn main() -> Outcome<()> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let (page, wanted) = match arguments.split_first() {
        Some((page, wanted)) => (Some(page), wanted),
        None => (None, &[][..]),
    };
    let witnesses = Witnesses::read()?;
    let mut text = page.map(std::fs::read_to_string).transpose()?;
    for (name, section) in SECTIONS {
        if !wanted.is_empty() && !wanted.iter().any(|wanted| wanted == name) {
            continue;
        }
        let start = cpu_seconds();
        let mut table = section(&witnesses)?;
        let seconds = cpu_seconds() - start;
        if seconds >= 1.0 {
            let _ = write!(table, "\n{seconds:.0} s of one core.\n");
        }
        put(&mut text, name, &table)?;
        if let (Some(page), Some(text)) = (page, &text) {
            std::fs::write(page, text)?;
        }
    }
    Ok(())
}

/// Puts a table between its markers in the page, or prints it.
fn put(page: &mut Option<String>, name: &str, table: &str) -> Outcome<()> {
    let Some(page) = page else {
        println!("## {name}\n\n{table}");
        return Ok(());
    };
    let (begin, end) = (format!("<!-- {name} -->\n"), format!("<!-- /{name} -->"));
    let place = |mark: &str| page.find(mark).ok_or(format!("the page has no line {}", mark.trim()));
    let (from, to) = (place(&begin)? + begin.len(), place(&end)?);
    page.replace_range(from..to, &format!("\n{table}\n"));
    Ok(())
}

type Section = fn(&Witnesses) -> Outcome<String>;

const SECTIONS: [(&str, Section); 8] = [
    ("spheres", spheres),
    ("endless", endless),
    ("slabs", slabs),
    ("boundaries", boundaries),
    ("clouds", clouds),
    ("droplets", droplets),
    ("few-photons", few_photons),
    ("half-spaces", half_spaces),
];

fn henyey_greenstein(g: f64) -> Vec<f64> {
    moments(|x| (1.0 - g * g) / (4.0 * std::f64::consts::PI * (1.0 + g * g - 2.0 * g * x).powf(1.5)))
}

fn solved(slab: &Slab, moments: &[f64]) -> Solution {
    solve(
        &adding::Slab { index: slab.index, tau: slab.tau, albedo: slab.albedo, moments, ground: slab.ground },
        COSINES,
    )
}

/// What is looked at: its name in tables and in the witnesses' file, and the picture.
#[derive(Clone, Copy)]
struct Quantity {
    name: &'static str,
    key: &'static str,
    view: View,
}

impl Quantity {
    const fn new(name: &'static str, key: &'static str, light: Light, from_below: bool, cosine: f64) -> Self {
        Quantity { name, key, view: View { light, from_below, cosine } }
    }

    fn exact(&self, solution: &Solution) -> f64 {
        let index = |cosine: f64| COSINES.iter().position(|c| *c == cosine).expect("a direction that is solved for");
        match (self.view.light, self.view.from_below) {
            (Light::Sky, false) => solution.reflected[index(self.view.cosine)],
            (Light::Sky, true) => solution.transmitted[index(self.view.cosine)],
            (Light::Beam(from), false) => solution.up[index(from)][index(self.view.cosine)],
            (Light::Beam(from), true) => solution.down[index(from)][index(self.view.cosine)],
        }
    }
}

const R0: Quantity = Quantity::new("R 0°", "r0", Light::Sky, false, 1.0);
const T0: Quantity = Quantity::new("T 0°", "t0", Light::Sky, true, 1.0);
const R60: Quantity = Quantity::new("R 60°", "r60", Light::Sky, false, 0.5);
const T60: Quantity = Quantity::new("T 60°", "t60", Light::Sky, true, 0.5);
const UP: Quantity = Quantity::new("L↑ 60° → 0°", "up", Light::Beam(0.5), false, 1.0);
const DOWN: Quantity = Quantity::new("L↓ 60° → 0°", "down", Light::Beam(0.5), true, 1.0);

/// Which methods are asked for a picture of a slab. Light paths see nothing by way of mirrors or smooth glass; of the other estimates from photons each has its
/// kind of picture.
fn methods(slab: &Slab, view: View) -> Vec<Method> {
    let mut methods = vec![Method::Path];
    if view.cosine == 1.0 && slab.index == 1.0 {
        methods.push(Method::Light);
    }
    // There photons wander for hundreds of collisions, of which a map keeps about one.
    if slab.albedo == 1.0 && slab.tau > 15.0 {
        return methods;
    }
    methods.push(Method::Beams);
    methods.extend(match view {
        View { light: Light::Beam(_), .. } => &[Method::Points, Method::Traced][..],
        View { cosine: 1.0, .. } => &[Method::Points],
        _ => &[Method::FixedBeams],
    });
    methods
}

/// A row of scenes that differ by method, told as it is found; `of` makes of the film's mean what is looked for.
fn row(
    name: String,
    exact: f64,
    second: Option<(f64, f64)>,
    methods: &[Method],
    effort: Effort,
    scene: impl Fn(Method) -> String,
    of: impl Fn(Found) -> Found,
) -> Outcome<Row> {
    let mut row = Row { name, exact, second, found: Vec::new() };
    for &method in methods {
        let start = cpu_seconds();
        let found = of(measure(&scene(method), method, effort)?);
        let (share, error) = (100.0 * (found.mean / exact - 1.0), 100.0 * found.error / exact);
        eprintln!("{}, {}: {share:+.2} ± {error:.2} %, {:.1} s", row.name, method.name(), cpu_seconds() - start);
        row.found.push((method, found));
    }
    Ok(row)
}

/// A row of a slab.
fn of_slab(
    slab: &Slab,
    quantity: Quantity,
    exact: f64,
    second: Option<f64>,
    name: String,
    effort: Effort,
) -> Outcome<Row> {
    let scene = |method| if method == Method::Path { slab.wide(quantity.view) } else { slab.column(quantity.view) };
    row(name, exact, second.map(|value| (value, 0.0)), &methods(slab, quantity.view), effort, scene, |found| found)
}

/// Optical thickness, albedo, g, what is looked at, and what part of the usual work is enough.
type Case = (f64, f64, f64, &'static [Quantity], f64);

const FLUXES: &[Quantity] = &[R0, T0, UP];
const ALL: &[Quantity] = &[R0, T0, R60, T60, UP, DOWN];

fn slabs(witnesses: &Witnesses) -> Outcome<String> {
    let cases: [Case; 13] = [
        (0.1, 0.9, 0.0, ALL, 1.0),
        (0.1, 1.0, 0.75, FLUXES, 1.0),
        (1.0, 0.5, 0.0, FLUXES, 1.0),
        (1.0, 0.9, 0.75, ALL, 1.0),
        (1.0, 1.0, 0.0, ALL, 1.0),
        (1.0, 0.99, 0.9, FLUXES, 1.0),
        (2.0, 0.9, 0.75, &[R0, T0], 1.0),
        (10.0, 0.9, 0.0, &[R0, R60, UP], 1.0),
        (10.0, 0.5, 0.75, &[R0, UP], 1.0),
        (10.0, 0.99, 0.9, &[R0, T0, R60, UP], 0.5),
        (10.0, 1.0, 0.75, &[R0, T0, UP], 0.3),
        (100.0, 0.99, 0.0, &[R0, R60, UP], 0.5),
        (100.0, 1.0, 0.9, &[R0, R60, UP], 0.05),
    ];
    let mut rows = Vec::new();
    for (tau, albedo, g, quantities, share) in cases {
        let slab = Slab::hg(1.0, tau, albedo, g);
        let solution = solved(&slab, &henyey_greenstein(g));
        for quantity in quantities {
            let second = witnesses.number(&["slab", &format!("1 {tau} {albedo} {g}"), quantity.key]);
            let name = format!("τ {tau}, Λ {albedo}, g {g}: {}", quantity.name);
            let effort =
                Effort { photons: if tau < 1.0 { EFFORT.photons / 5 } else { scaled(share).photons }, ..scaled(share) };
            rows.push(of_slab(&slab, *quantity, quantity.exact(&solution), second, name, effort)?);
        }
    }
    Ok(table::table(&rows))
}

/// Less where paths are long.
fn scaled(share: f64) -> Effort {
    let of = |full: u32| (f64::from(full) * share) as u32;
    Effort { samples: of(EFFORT.samples), light: of(EFFORT.light), photons: of(EFFORT.photons).max(4000), ..EFFORT }
}

fn boundaries(witnesses: &Witnesses) -> Outcome<String> {
    let cases: [(f64, Case); 3] = [
        (1.4, (1.0, 0.9, 0.75, &[R0, T0, R60, T60], 0.5)),
        (1.4, (10.0, 0.99, 0.0, &[R0, T0, R60, T60], 0.3)),
        (1.5, (30.0, 0.9, 0.0, &[R0], 0.5)),
    ];
    let mut rows = Vec::new();
    for (index, (tau, albedo, g, quantities, share)) in cases {
        let slab = Slab::hg(index, tau, albedo, g);
        let solution = solved(&slab, &henyey_greenstein(g));
        for quantity in quantities {
            let second = witnesses.number(&["slab", &format!("{index} {tau} {albedo} {g}"), quantity.key]);
            let name = format!("n {index}, τ {tau}, Λ {albedo}, g {g}: {}", quantity.name);
            rows.push(of_slab(&slab, *quantity, quantity.exact(&solution), second, name, scaled(share))?);
        }
    }
    Ok(table::table(&rows))
}

fn half_spaces(witnesses: &Witnesses) -> Outcome<String> {
    let mut rows = Vec::new();
    // So deep that nothing comes back: where nothing is lost, on a white ground, above which light tends to be the same from all sides.
    for (albedo, tau, ground) in [(0.5, 20.0, 0.0), (0.9, 25.0, 0.0), (0.99, 40.0, 0.0), (1.0, 16.0, 1.0)] {
        let slab = Slab { ground, ..Slab::new(1.0, tau, albedo, "{ type = \"isotropic\" }") };
        let h = half_space::H::new(albedo);
        let grazing = Quantity::new("R 78°", "r78", Light::Sky, false, COSINES[2]);
        for quantity in [R0, R60, grazing, UP] {
            let exact = match quantity.view.light {
                Light::Sky => h.reflected(quantity.view.cosine),
                Light::Beam(from) => {
                    albedo * from * h.at(from) * h.at(1.0) / (4.0 * std::f64::consts::PI * (1.0 + from))
                }
            };
            let second = witnesses.number(&["half_space", &albedo.to_string(), quantity.key]);
            let name = format!("Λ {albedo}: {}", quantity.name);
            let share = if albedo == 1.0 { 0.2 } else { 0.7 };
            rows.push(of_slab(&slab, quantity, exact, second, name, scaled(share))?);
        }
    }
    Ok(table::table(&rows))
}

fn spheres(witnesses: &Witnesses) -> Outcome<String> {
    let mut rows = Vec::new();
    let isotropic = "{ type = \"isotropic\" }";
    let forward = "{ type = \"hg\", g = 0.85 }";
    for (radius, albedo, phase, share) in [
        (1.0, 0.0, isotropic, 1.0),
        (0.1, 0.9, isotropic, 1.0),
        (1.0, 0.5, isotropic, 1.0),
        (1.0, 0.9, isotropic, 1.0),
        (1.0, 0.99, isotropic, 1.0),
        (10.0, 0.9, isotropic, 0.5),
        (10.0, 0.99, isotropic, 0.3),
        (1.0, 1.0, isotropic, 0.5),
        (10.0, 1.0, forward, 0.2),
    ] {
        let exact = if albedo == 1.0 { 1.0 } else { exact::sphere_albedo(albedo, radius) };
        let key = format!("{albedo} {radius}");
        let second = witnesses.number(&["sphere", &key, "albedo"]).zip(witnesses.number(&["sphere", &key, "error"]));
        let what = if phase == forward { ", g 0.85" } else { "" };
        let name = format!("R {radius}, Λ {albedo}{what}");
        let text = scenes::sphere(radius, albedo, phase);
        let effort = Effort { samples: (60.0 * share) as u32, light: 100, photons: 50_000, ..EFFORT };
        let methods = [Method::Path, Method::Beams, Method::Light, Method::FixedBeams, Method::Points];
        // Corners of the film see the light itself.
        let quarter = std::f64::consts::FRAC_PI_4;
        let of = |film: Found| film.mapped(1.0 - 1.0 / quarter, 1.0 / quarter);
        rows.push(row(name, exact, second, &methods, effort, |_| text.clone(), of)?);
    }
    Ok(table::table(&rows))
}

fn endless(witnesses: &Witnesses) -> Outcome<String> {
    let mut rows = Vec::new();
    for albedo in [0.5, 0.9, 0.99] {
        let medium = exact::Endless::new(albedo);
        for d in [0.5, 1.0, 2.0, 5.0, 10.0] {
            let exact = medium.seen(d, 0.25 * d);
            let second = witnesses.number(&["endless", &format!("{albedo} {d}"), "radiance"]).map(|value| (value, 0.0));
            let name = format!("Λ {albedo}, d {d}");
            let text = scenes::endless(albedo, d);
            let share = if albedo > 0.95 { 0.1 } else { 1.0 };
            let photons = if albedo > 0.95 { 50_000 } else { 150_000 };
            let effort = Effort { light: 2000, photons, ..scaled(share) };
            rows.push(row(name, exact, second, &Method::ALL, effort, |_| text.clone(), |found| found)?);
        }
    }
    Ok(table::table(&rows))
}

fn droplet_phase(diameter: f64) -> impl Fn(f64) -> f64 {
    let phase = Phase::Mixture(mie(diameter));
    move |cos: f64| phase.value(DVec3::Z, DVec3::new((1.0 - cos * cos).max(0.0).sqrt(), 0.0, cos))
}

fn clouds(witnesses: &Witnesses) -> Outcome<String> {
    let mut rows = Vec::new();
    let phases = [
        ("hg 0.85", "{ type = \"hg\", g = 0.85 }", henyey_greenstein(0.85)),
        ("mie 20 µm", "{ type = \"mie\", diameter = 20 }", moments(droplet_phase(20.0))),
    ];
    for (kind, phase, moments) in &phases {
        for (tau, share) in [(8.0, 0.3), (64.0, 0.05)] {
            for ground in [0.0, 0.8] {
                let slab = Slab { ground, ..Slab::new(1.0, tau, 1.0, phase) };
                let solution = solved(&slab, moments);
                let quantities: &[Quantity] = if ground == 0.0 { &[R0, T0, R60] } else { &[R0, UP] };
                for quantity in
                    quantities.iter().filter(|quantity| kind.starts_with("hg") || quantity.view.light == Light::Sky)
                {
                    let key = format!("{tau} hg {ground}");
                    let second =
                        if kind.starts_with("hg") { witnesses.number(&["cloud", &key, quantity.key]) } else { None };
                    let name = format!("{kind}, τ {tau}, ground {ground}: {}", quantity.name);
                    // As it would be by itself without the mirrors, which stand for width.
                    let effort = Effort { peaks: "paths", ..scaled(share) };
                    rows.push(of_slab(&slab, *quantity, quantity.exact(&solution), second, name, effort)?);
                }
            }
        }
    }
    Ok(table::table(&rows))
}

/// The fit against Mie's theory: no pictures.
fn droplets(witnesses: &Witnesses) -> Outcome<String> {
    let mut text = String::new();
    for diameter in [10.0, 20.0] {
        let key = diameter.to_string();
        let list = |name: &str| witnesses.list(&["droplets", &key, name]);
        let (angles, values, exact_moments) = (list("angles")?, list("values")?, list("moments")?);
        let fit = droplet_phase(diameter);
        let fit_moments = moments(&fit);
        let _ = write!(text, "| {diameter} µm |");
        angles.iter().for_each(|angle| {
            let _ = write!(text, " {angle}° |");
        });
        let _ = writeln!(text, " g |\n|{}", "---|".repeat(angles.len() + 2));
        for (name, of, g) in [
            ("Mie", values.clone(), exact_moments[1]),
            ("fit", angles.iter().map(|a| fit(a.to_radians().cos())).collect(), fit_moments[1]),
        ] {
            let cells: Vec<String> = of.iter().map(|value| digits(*value, 3)).collect();
            let _ = writeln!(text, "| {name} | {} | {g:.4} |", cells.join(" | "));
        }
        let share: Vec<String> =
            angles.iter().zip(&values).map(|(a, v)| format!("{:.2}", fit(a.to_radians().cos()) / v)).collect();
        let _ = writeln!(text, "| fit/Mie | {} | |\n", share.join(" | "));
    }
    text += "| droplets, τ, ground | | Mie | discrete ordinates | fit | fit − Mie |\n|---|---|---|---|---|---|\n";
    for diameter in [10.0, 20.0] {
        let key = diameter.to_string();
        let exact_moments = witnesses.list(&["droplets", &key, "moments"])?;
        let fit_moments = moments(droplet_phase(diameter));
        for tau in [8.0, 64.0] {
            let of = |moments: &[f64]| solved(&Slab::new(1.0, tau, 1.0, ""), moments);
            let (exact, fit) = (of(&exact_moments), of(&fit_moments));
            for quantity in [R0, R60, T0] {
                let (a, b) = (quantity.exact(&exact), quantity.exact(&fit));
                let second = witnesses.number(&["droplets", &key, &tau.to_string(), quantity.key]).unwrap_or(f64::NAN);
                let _ = writeln!(
                    text,
                    "| {diameter} µm, τ {tau} | {} | {a:.4} | {second:.4} | {b:.4} | {:+.4} ({:+.1} %) |",
                    quantity.name,
                    b - a,
                    100.0 * (b / a - 1.0)
                );
            }
        }
    }
    Ok(text)
}

/// What few photons cost where phase functions are peaked.
fn few_photons(_: &Witnesses) -> Outcome<String> {
    let slab = Slab::hg(1.0, 10.0, 0.99, 0.8);
    let exact = R0.exact(&solved(&slab, &henyey_greenstein(0.8)));
    let room = scenes::room("{ type = \"mie\", diameter = 12 }");
    let path = measure(&room, Method::Path, Effort { seeds: 32, samples: 100, ..EFFORT })?;
    let columns = [
        ("slab", slab.column(R0.view), exact, "photons"),
        ("slab, `peaks = \"paths\"`", slab.column(R0.view), exact, "paths"),
        ("room", room.clone(), path.mean, "photons"),
        ("room, `peaks = \"paths\"`", room, path.mean, "paths"),
    ];
    let mut text = String::from("| photons | seeds |");
    for (name, ..) in &columns {
        let _ = write!(text, " {name} |");
    }
    let _ = writeln!(text, "\n|{}", "---|".repeat(columns.len() + 2));
    for (photons, seeds) in [(10_000, 24), (30_000, 12), (100_000, 6)] {
        let _ = write!(text, "| {photons} | {seeds} |");
        for (name, scene, exact, peaks) in &columns {
            let start = cpu_seconds();
            let found = measure(scene, Method::Beams, Effort { seeds, photons, peaks, ..EFFORT })?;
            let cell = format!("{:+.2} ± {:.2} %", 100.0 * (found.mean / exact - 1.0), 100.0 * found.error / exact);
            eprintln!("{photons}, {name}: {cell}, {:.1} s", cpu_seconds() - start);
            let _ = write!(text, " {cell} |");
        }
        text += "\n";
    }
    let _ = writeln!(text, "\nPaths know the room to {:.2} %.", 100.0 * path.error / path.mean);
    Ok(text)
}
