//! Reflectance R and transmittance T of wide slabs, by both estimators, against numbers from elsewhere: a table made
//! by adding–doubling, and the solver below, which shares nothing with the renderer.
//!
//! R and T of a beam at normal incidence are, by reciprocity, what a camera sees that looks straight at the slab
//! under light of radiance 1 from all sides of one half space: above it for R, below it for T.

use std::f64::consts::PI;

use crate::support::{Checks, Estimate, data};

/// A row of `data/slab.csv`: index, optical thickness, albedo, phase function and its parameter, R and T.
#[derive(Clone, Debug)]
struct Row {
    index: f64,
    tau: f64,
    albedo: f64,
    phase: String,
    g: f64,
    reflectance: f64,
    transmittance: f64,
}

fn table() -> Vec<Row> {
    let text = std::fs::read_to_string(data("slab.csv")).unwrap();
    let row = |line: &str| {
        let cells: Vec<&str> = line.split(',').collect();
        let number = |i: usize| cells[i].parse::<f64>().unwrap();
        Row {
            index: number(0),
            tau: number(1),
            albedo: number(2),
            phase: cells[3].to_string(),
            g: number(4),
            reflectance: number(5),
            transmittance: number(6),
        }
    };
    text.lines().skip(1).map(row).collect()
}

/// Azimuthally averaged adding–doubling, on Gauss nodes of (0, 1) and the normal, which has no weight (van de Hulst
/// 1980, ch. 4); boundaries are two more layers (Prahl, van Gemert and Welch 1993).
pub mod solver {
    use super::PI;

    /// Nodes of each half of the cosines: those of light that may leave, and those of light that is totally reflected.
    const HALF: usize = 40;
    const N: usize = 2 * HALF;
    const SIZE: usize = N + 1;
    type Matrix = Vec<[f64; SIZE]>;

    /// R and T of a slab of index `n` in vacuum, for a phase function `p(cos θ)` per steradian.
    pub fn slab(n: f64, tau: f64, albedo: f64, p: impl Fn(f64) -> f64) -> (f64, f64) {
        // Without a critical angle, any point will do.
        let middle = if n > 1.0 { (1.0 - 1.0 / (n * n)).sqrt() } else { 0.5 };
        let (nodes, weights) = gauss(HALF);
        let (mut node, mut weight) = (Vec::new(), Vec::new());
        for (from, to) in [(0.0, middle), (middle, 1.0)] {
            node.extend(nodes.iter().map(|x| from + (to - from) * 0.5 * (x + 1.0)));
            weight.extend(weights.iter().map(|w| 0.5 * (to - from) * w));
        }
        node.push(1.0);
        weight.push(0.0);

        // Both signs of the cosine through the Legendre moments that the nodes integrate exactly.
        let moments = moments(N, p);
        let polynomials: Vec<Vec<f64>> = node.iter().map(|&x| legendre(N, x)).collect();
        let averaged = |i: usize, j: usize, sign: f64| -> f64 {
            (0..N)
                .map(|l| {
                    let parity = if l % 2 == 1 { sign } else { 1.0 };
                    (2 * l + 1) as f64 * moments[l] * polynomials[i][l] * polynomials[j][l] * parity
                })
                .sum()
        };

        // A layer so thin that light scatters in it at most once, then doubled.
        const DOUBLINGS: i32 = 28;
        let thin = tau / 2f64.powi(DOUBLINGS);
        // What is lost is kept, not what passes: doubling 1 − δ would lose digits.
        let mut lost: Vec<f64> = node.iter().map(|mu| -(-thin / mu).exp_m1()).collect();
        let layer = |sign: f64| -> Matrix {
            let entry = |i: usize, j: usize| lost[i] * 0.5 * albedo * averaged(i, j, sign) * weight[j];
            (0..SIZE).map(|i| std::array::from_fn(|j| entry(i, j))).collect()
        };
        let mut r = layer(-1.0);
        let mut t = layer(1.0);
        for _ in 0..DOUBLINGS {
            let full: Matrix = (0..SIZE)
                .map(|i| std::array::from_fn(|j| t[i][j] + if i == j { 1.0 - lost[i] } else { 0.0 }))
                .collect();
            let bounces = inverse(&minus_from_one(&product(&r, &r)));
            let there = product(&full, &bounces);
            let back = product(&product(&there, &r), &full);
            // full·bounces·full − direct², written without the direct part.
            let twice = product(&there, &full);
            for i in 0..SIZE {
                let direct = (1.0 - lost[i]) * (1.0 - lost[i]);
                for j in 0..SIZE {
                    r[i][j] += back[i][j];
                    t[i][j] = twice[i][j] - if i == j { direct } else { 0.0 };
                }
                lost[i] = 1.0 - direct;
            }
        }
        if n == 1.0 {
            let out = |matrix: &Matrix| matrix[N].iter().sum::<f64>();
            return (out(&r), out(&t) + (-tau).exp());
        }

        // Inside: down at the top is d = v + u B, at the bottom e = d T + f R with f = e B, and up at the top
        // u = d R + f T, B the boundary's reflectance from inside, v what enters.
        let boundary: Vec<f64> = node.iter().map(|&mu| reflectance(mu, n)).collect();
        let reflected =
            |a: &Matrix| -> Matrix { a.iter().map(|row| std::array::from_fn(|j| row[j] * boundary[j])).collect() };
        let scaled =
            |a: &Matrix| -> Matrix { (0..SIZE).map(|i| std::array::from_fn(|j| boundary[i] * a[i][j])).collect() };
        let full: Matrix =
            (0..SIZE).map(|i| std::array::from_fn(|j| t[i][j] + if i == j { 1.0 - lost[i] } else { 0.0 })).collect();
        let below = product(&full, &inverse(&minus_from_one(&scaled(&r))));
        let mut above = product(&below, &scaled(&full));
        for i in 0..SIZE {
            for j in 0..SIZE {
                above[i][j] += r[i][j];
            }
        }
        let entering = 1.0 - boundary[N];
        let down: [f64; SIZE] = inverse(&minus_from_one(&reflected(&above)))[N].map(|x| x * entering);
        let leaving = |a: &Matrix| -> f64 {
            (0..SIZE).map(|j| (1.0 - boundary[j]) * (0..SIZE).map(|i| down[i] * a[i][j]).sum::<f64>()).sum()
        };
        (boundary[N] + leaving(&above), leaving(&below))
    }

    /// Fresnel's reflectance from inside of index `n`, for light with this cosine to the normal.
    fn reflectance(mu: f64, n: f64) -> f64 {
        let sin2 = n * n * (1.0 - mu * mu);
        if sin2 >= 1.0 {
            return 1.0;
        }
        let nu = (1.0 - sin2).sqrt();
        let (s, p) = ((n * mu - nu) / (n * mu + nu), (mu - n * nu) / (mu + n * nu));
        0.5 * (s * s + p * p)
    }

    /// ½∫ 4π p(x) P_l(x) dx for l below `count`.
    fn moments(count: usize, p: impl Fn(f64) -> f64) -> Vec<f64> {
        let (node, weight) = gauss(400);
        let mut moments = vec![0.0; count];
        for (x, w) in node.iter().zip(&weight) {
            let value = 2.0 * PI * p(*x) * w;
            for (moment, polynomial) in moments.iter_mut().zip(legendre(count, *x)) {
                *moment += value * polynomial;
            }
        }
        moments
    }

    fn legendre(count: usize, x: f64) -> Vec<f64> {
        let mut p = vec![1.0, x];
        for l in 2..count {
            p.push(((2 * l - 1) as f64 * x * p[l - 1] - (l - 1) as f64 * p[l - 2]) / l as f64);
        }
        p
    }

    /// Gauss–Legendre nodes and weights on (−1, 1), by Newton's method.
    fn gauss(n: usize) -> (Vec<f64>, Vec<f64>) {
        let pair = |i: usize| {
            let mut x = (PI * (i as f64 + 0.75) / (n as f64 + 0.5)).cos();
            let mut slope = 0.0;
            for _ in 0..50 {
                let p = legendre(n + 1, x);
                slope = n as f64 * (x * p[n] - p[n - 1]) / (x * x - 1.0);
                x -= p[n] / slope;
            }
            (x, 2.0 / ((1.0 - x * x) * slope * slope))
        };
        (0..n).map(pair).unzip()
    }

    fn product(a: &Matrix, b: &Matrix) -> Matrix {
        let entry = |i: usize, j: usize| (0..SIZE).map(|k| a[i][k] * b[k][j]).sum();
        (0..SIZE).map(|i| std::array::from_fn(|j| entry(i, j))).collect()
    }

    fn minus_from_one(a: &Matrix) -> Matrix {
        (0..SIZE).map(|i| std::array::from_fn(|j| if i == j { 1.0 - a[i][j] } else { -a[i][j] })).collect()
    }

    /// Gauss–Jordan elimination; the matrices here are close to 1 and need no pivots.
    fn inverse(a: &Matrix) -> Matrix {
        let mut a = a.clone();
        let mut b: Matrix = (0..SIZE).map(|i| std::array::from_fn(|j| if i == j { 1.0 } else { 0.0 })).collect();
        for k in 0..SIZE {
            let scale = 1.0 / a[k][k];
            a[k] = a[k].map(|x| x * scale);
            b[k] = b[k].map(|x| x * scale);
            let (ak, bk) = (a[k], b[k]);
            for i in (0..SIZE).filter(|&i| i != k) {
                let factor = a[i][k];
                for j in 0..SIZE {
                    a[i][j] -= factor * ak[j];
                    b[i][j] -= factor * bk[j];
                }
            }
        }
        b
    }
}

fn phase_function(row: &Row) -> impl Fn(f64) -> f64 {
    let (g, schlick) = (row.g, row.phase == "schlick");
    move |x: f64| {
        if schlick {
            (1.0 - g * g) / (4.0 * PI * (1.0 - g * x).powi(2))
        } else {
            (1.0 - g * g) / (4.0 * PI * (1.0 + g * g - 2.0 * g * x).powf(1.5))
        }
    }
}

#[test]
fn the_solver_agrees_with_the_table() {
    let mut checks = Checks::default();
    for row in table() {
        let (r, t) = solver::slab(row.index, row.tau, row.albedo, phase_function(&row));
        // The table has six digits and is sure to 1e-5; where there is a critical angle, to 3e-5 (half as many nodes
        // again change the solver's numbers by 5e-6 there).
        let sure = if row.index == 1.0 { 1e-5 } else { 3e-5 };
        let close = |x: f64, y: f64| (x - y).abs() <= sure * y.max(0.01);
        let holds = close(r, row.reflectance) && close(t, row.transmittance);
        checks.holds(format!("{row:?}: {r} {t}"), holds);
    }
    checks.finish();
}

fn medium(row: &Row) -> String {
    let parameter = if row.phase == "schlick" { "k" } else { "g" };
    format!(
        "[media.fog]\nsigma_t = 1.0\nalbedo = {}\nphase = {{ type = \"{}\", {parameter} = {} }}\n\
         [materials.black]\ntype = \"lambert\"\nreflectance = 0\n\
         [materials.glass]\ntype = \"dielectric\"\nior = {}\n",
        row.albedo, row.phase, row.g, row.index
    )
}

fn boundary(row: &Row) -> &'static str {
    if row.index == 1.0 { "none" } else { "glass" }
}

/// A box 50 times as wide as thick under the sky, with a black sheet beyond or above the camera.
fn wide(row: &Row, transmitted: bool, samples: u32) -> String {
    let half = 50.0 * row.tau.max(1.0);
    let sheet = if transmitted { 3.0 } else { -row.tau - 0.01 };
    let far = 40.0 * half;
    format!(
        "[film]\nwidth = 1\nheight = 1\nlayers = false\n\
         [camera]\nposition = [0, 0, 2]\ntarget = [0, 0, 0]\nfov = 2\n\
         [render]\nmethod = \"path\"\nsamples = {samples}\n{}\
         [[lights]]\ntype = \"environment\"\nradiance = 1.0\n\
         [[shapes]]\ntype = \"box\"\nmin = [{}, {}, {}]\nmax = [{half}, {half}, 0]\nmaterial = \"{}\"\ninterior = \"fog\"\n\
         [[shapes]]\ntype = \"quad\"\norigin = [{}, {}, {sheet}]\nedge_u = [{}, 0, 0]\nedge_v = [0, {}, 0]\nmaterial = \"black\"\n",
        medium(row),
        -half,
        -half,
        -row.tau,
        boundary(row),
        -far,
        -far,
        2.0 * far,
        2.0 * far
    )
}

/// A column of the slab between mirrors, which stand for all of its width. One end of the tube shines 1, the other is
/// black. A camera that looks along it sees no blur of kernels: light is the same all over a disc.
fn column(row: &Row, transmitted: bool, samples: u32, photons: u32) -> String {
    let (top, bottom) = (0.3, -row.tau - 0.3);
    let (lit, dark) = if transmitted { (bottom, top) } else { (top, bottom) };
    // Discs almost as wide as the column, so that one ray meets most photons.
    let neighbours = (0.3 * photons as f64 / row.tau) as u32;
    let mut text = format!(
        "[film]\nwidth = 1\nheight = 1\nlayers = false\n\
         [camera]\nposition = [0, 0, 0.2]\ntarget = [0, 0, 0]\nfov = 2\n\
         [render]\nmethod = \"photon\"\nsamples = {samples}\n[photons]\nvolume = {photons}\n\
         [volume]\nneighbours = {neighbours}\nmax_radius = 0.49\n{}\
         [materials.mirror]\ntype = \"mirror\"\nreflectance = 1\n\
         [[shapes]]\ntype = \"box\"\nmin = [-0.51, -0.51, {}]\nmax = [0.51, 0.51, 0]\nmaterial = \"{}\"\ninterior = \"fog\"\n\
         [[shapes]]\ntype = \"quad\"\norigin = [-0.5, -0.5, {dark}]\nedge_u = [1, 0, 0]\nedge_v = [0, 1, 0]\nmaterial = \"black\"\n\
         [[shapes]]\ntype = \"disk\"\ncenter = [0, 0, {lit}]\nnormal = [0, 0, {}]\nradius = 0.8\nmaterial = \"black\"\n\
         emission = {{ radiance = 1.0 }}\n",
        medium(row),
        -row.tau,
        boundary(row),
        if transmitted { 1 } else { -1 }
    );
    let height = top - bottom;
    for (x, y, u) in [(-0.5, -0.5, [1, 0]), (-0.5, 0.5, [1, 0]), (-0.5, -0.5, [0, 1]), (0.5, -0.5, [0, 1])] {
        text += &format!(
            "[[shapes]]\ntype = \"quad\"\norigin = [{x}, {y}, {bottom}]\nedge_u = [{}, {}, 0]\nedge_v = [0, 0, {height}]\nmaterial = \"mirror\"\n",
            u[0], u[1]
        );
    }
    text
}

/// A row, and how many times 2000 samples R and T take by path tracing, for each seed.
struct Case {
    row: Row,
    exact: [f64; 2],
    samples: [u32; 2],
}

/// Rows that between them have every index, phase function, thickness and albedo.
fn cases() -> Vec<Case> {
    let wanted = [
        ((1.0, 1.0, 0.9, 0.0), [10, 4]),
        ((1.0, 4.0, 0.5, 0.0), [12, 12]),
        ((1.0, 4.0, 1.0, 0.0), [8, 6]),
        ((1.0, 16.0, 0.99, 0.0), [4, 10]),
        ((1.0, 1.0, 0.5, 0.75), [10, 4]),
        ((1.0, 16.0, 1.0, 0.75), [4, 10]),
        ((1.0, 4.0, 1.0, 0.7), [4, 4]),
        ((1.4, 1.0, 0.9, 0.0), [24, 6]),
        ((1.4, 4.0, 0.99, 0.0), [4, 6]),
    ];
    let table = table();
    let case = |((index, tau, albedo, g), samples): ((f64, f64, f64, f64), [u32; 2])| {
        let row = table.iter().find(|row| (row.index, row.tau, row.albedo, row.g) == (index, tau, albedo, g));
        let row = row.unwrap_or_else(|| panic!("no row {index} {tau} {albedo} {g}")).clone();
        let exact = solver::slab(index, tau, albedo, phase_function(&row)).into();
        Case { row, exact, samples }
    };
    wanted.map(case).into()
}

/// Above 1e-3 within 3 standard errors, below it within 1e-4. `precision` is what these errors may be at most, for
/// numbers above 0.1 and below.
fn check(checks: &mut Checks, case: &Case, transmitted: bool, found: &Estimate, precision: [f64; 2]) {
    let row = &case.row;
    let name = if transmitted { "T" } else { "R" };
    let exact = case.exact[transmitted as usize];
    let what = format!("n = {}, τ = {}, Λ = {}, {} {}: {name}", row.index, row.tau, row.albedo, row.phase, row.g);
    if exact > 1e-3 {
        let precision = precision[usize::from(exact < 0.1)];
        checks.agree(&what, found, &Estimate::exact([exact; 3]), precision, 0.0);
    } else {
        let close = found.mean.iter().all(|x| (x - exact).abs() < 1e-4);
        checks.holds(format!("{what}: {:?} against {exact}", found.mean), close);
    }
}

#[test]
fn slabs_by_path_tracing() {
    let mut checks = Checks::default();
    // Those that photons do not take, and the last, which both do: all thicknesses, albedos and phase functions.
    for (_, case) in cases().into_iter().enumerate().filter(|(index, _)| index % 2 == 1 || *index >= 6) {
        for transmitted in [false, true] {
            let samples = 2000 * case.samples[transmitted as usize];
            let found = Estimate::of(32, &wide(&case.row, transmitted, samples), &[]);
            check(&mut checks, &case, transmitted, &found, [0.003, 0.0075]);
        }
    }
    checks.finish();
}

#[test]
fn slabs_by_photons() {
    let mut checks = Checks::default();
    // Every second one, which leaves all of the indices and phase functions.
    for case in cases().into_iter().step_by(2) {
        for transmitted in [false, true] {
            let found = Estimate::of(80, &column(&case.row, transmitted, 64, 30_000), &[]);
            check(&mut checks, &case, transmitted, &found, [0.025, 0.05]);
        }
    }
    checks.finish();
}
