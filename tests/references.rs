//! Both estimators against images made with other programs, or by quadrature (`data/reference/README.md`).

use volpm::image::Image;

use crate::support::{Checks, Estimate, image, images, scene_text};

/// The reference of a scene, and how uncertain it is.
struct Reference {
    mean: Image,
    standard_error: Image,
}

impl Reference {
    fn made_by_others(name: &str) -> Self {
        Reference {
            mean: image(&format!("reference/{name}/reference.exr")),
            standard_error: image(&format!("reference/{name}/standard_error.exr")),
        }
    }

    fn exact(name: &str) -> Self {
        let mean = image(&format!("reference/{name}.pfm"));
        Reference { standard_error: Image::new(mean.width, mean.height), mean }
    }

    /// The mean over the pixels of a part of the image.
    fn estimate(&self, part: impl Fn(usize, usize) -> bool + Copy) -> Estimate {
        let mut variance = [0.0; 3];
        let mut count = 0.0;
        for y in 0..self.mean.height {
            for x in (0..self.mean.width).filter(|&x| part(x, y)) {
                let error = self.standard_error.get(x, y);
                for c in 0..3 {
                    variance[c] += f64::from(error[c]).powi(2);
                }
                count += 1.0;
            }
        }
        Estimate { mean: mean_of(&self.mean, part), standard_error: variance.map(|v: f64| v.sqrt() / count) }
    }
}

fn mean_of(image: &Image, part: impl Fn(usize, usize) -> bool) -> [f64; 3] {
    let mut sum = [0.0; 3];
    let mut count = 0.0;
    for y in 0..image.height {
        for x in (0..image.width).filter(|&x| part(x, y)) {
            for (sum, value) in sum.iter_mut().zip(image.get(x, y)) {
                *sum += f64::from(value);
            }
            count += 1.0;
        }
    }
    sum.map(|sum| sum / count)
}

/// Edge of the blocks that are compared.
const BLOCK: usize = 8;

/// What is allowed beyond noise, as shares of the whole image's mean.
struct Allowed {
    mean: f64,
    block: f64,
    precision: f64,
}

const UNBIASED: Allowed = Allowed { mean: 0.0, block: 0.0, precision: 0.003 };

/// 100 000 photons blur: into the dark around smoke, out of the glare around a lamp.
const BLURRED: Allowed = Allowed { mean: 0.01, block: 0.03, precision: 0.005 };

/// In smoke whose mean free path is little wider than a disc, light also blurs into its shaded side.
const BLURRED_SMOKE: Allowed = Allowed { mean: 0.01, block: 0.08, precision: 0.005 };

/// Where phase functions peak, the pixels around the lamp are noisy.
const PEAKED: f64 = 0.015;

/// Compares the whole image and its blocks, leaving out pixels that are not in `part`.
fn compare(
    checks: &mut Checks,
    what: &str,
    images: &[Image],
    reference: &Reference,
    allowed: &Allowed,
    part: impl Fn(usize, usize) -> bool + Copy,
) {
    let expected = reference.estimate(part);
    let found = Estimate::over(images, |image| mean_of(image, part));
    checks.agree(&format!("{what}, whole image"), &found, &expected, allowed.precision, allowed.mean);

    let (mut count, mut outside, mut worst) = (0, 0, (0.0, String::new()));
    let tolerance = expected.mean.map(|mean| allowed.block * mean);
    let channels = if reference.mean.pixels.iter().all(|[r, g, b]| r == g && g == b) { 1 } else { 3 };
    for by in 0..reference.mean.height / BLOCK {
        for bx in 0..reference.mean.width / BLOCK {
            let block = |x: usize, y: usize| x / BLOCK == bx && y / BLOCK == by;
            if !part(bx * BLOCK, by * BLOCK) {
                continue;
            }
            let expected = reference.estimate(block);
            let found = Estimate::over(images, |image| mean_of(image, block));
            for (c, tolerance) in tolerance.iter().enumerate().take(channels) {
                let error = found.standard_error[c].hypot(expected.standard_error[c]);
                let difference = found.mean[c] - expected.mean[c];
                let beyond = (difference.abs() - tolerance - 1e-6 * expected.mean[c]).max(0.0);
                let z = if beyond > 0.0 { beyond / error } else { 0.0 };
                count += 1;
                outside += (z > 3.0) as usize;
                if z > worst.0 {
                    let share = 100.0 * difference / expected.mean[c];
                    worst = (
                        z,
                        format!(
                            "block {bx} {by}, channel {c}, {share:+.2} % ± {:.2} %",
                            100.0 * error / expected.mean[c]
                        ),
                    );
                }
            }
        }
    }
    // With standard errors from 16 seeds, 0.9 % lie outside of three of them if nothing is wrong, and as many more as
    // chance allows.
    let expected = 0.009 * count as f64;
    let (z, place) = worst;
    let text =
        format!("{what}: {outside} of {count} block means outside of 3 standard errors; worst {z:.1} at {place}");
    checks.holds(text, outside as f64 <= expected + 3.0 * expected.sqrt() && z < 6.5);
}

fn everywhere(_: usize, _: usize) -> bool {
    true
}

/// Discs blur the singularity at the lamp, in the middle of the image.
fn away_from_the_lamp(x: usize, y: usize) -> bool {
    !((32..64).contains(&x) && (32..64).contains(&y))
}

/// Radiance grows without bound towards the lamp, so the variance of its neighbours' samples has none either: of few
/// seeds, most see too little and think themselves sure.
fn not_at_the_lamp(x: usize, y: usize) -> bool {
    !((40..56).contains(&x) && (40..56).contains(&y))
}

const SEEDS: u32 = 16;

#[test]
fn a_room_full_of_fog() {
    let mut checks = Checks::default();
    let text = scene_text("reference/cornell_fog/scene.toml");
    let reference = Reference::made_by_others("cornell_fog");
    let path = images(SEEDS, &text, &["render.method=path", "render.samples=4", "film.layers=false"]);
    compare(&mut checks, "path", &path, &reference, &UNBIASED, everywhere);
    let photon = images(
        SEEDS + SEEDS / 4,
        &text,
        &[
            "render.method=photon",
            "render.samples=2",
            "photons.volume=100000",
            "photons.global=20000",
            "film.layers=false",
        ],
    );
    compare(&mut checks, "photon", &photon, &reference, &BLURRED, everywhere);
    checks.finish();
}

#[test]
fn smoke_in_a_grid() {
    let mut checks = Checks::default();
    let text = scene_text("reference/smoke_grid/scene.toml");
    let npy = text.replace("smoke_grid_64.npy", "reference/smoke_grid/smoke_grid_64.npy");
    let array = text.lines().find(|line| line.starts_with("density")).unwrap();
    let vdb = text.replace(
        array,
        "density = { type = \"vdb\", file = \"reference/smoke_grid/smoke_grid_64.vdb\", grid = \"density\" }",
    );
    let reference = Reference::made_by_others("smoke_grid");
    let path = ["render.method=path", "render.samples=4", "film.layers=false"];
    let photon = ["render.method=photon", "render.samples=1", "photons.volume=100000", "film.layers=false"];
    for (what, set, allowed) in [("path", &path[..], &UNBIASED), ("photon", &photon, &BLURRED_SMOKE)] {
        let found = images(SEEDS, &npy, set);
        compare(&mut checks, what, &found, &reference, allowed, everywhere);
        // One grid, read from either file.
        let same = found[0].pixels == images(1, &vdb, set)[0].pixels;
        checks.holds(format!("{what}: npy and vdb are one"), same);
    }
    checks.finish();
}

#[test]
fn single_scattering_around_a_point_light() {
    let mut checks = Checks::default();
    for name in ["iso", "hg075", "schlick07"] {
        let text = scene_text(&format!("reference/analytic_point/{name}.toml"));
        let reference = Reference::exact(&format!("analytic_point/{name}"));
        let path = images(SEEDS, &text, &["render.method=path", "render.samples=8", "film.layers=false"]);
        compare(
            &mut checks,
            &format!("{name}, path"),
            &path,
            &reference,
            &Allowed { precision: PEAKED, ..UNBIASED },
            not_at_the_lamp,
        );
        let photon = images(
            SEEDS,
            &text,
            &["render.method=photon", "render.samples=2", "photons.volume=200000", "film.layers=false"],
        );
        compare(
            &mut checks,
            &format!("{name}, photon"),
            &photon,
            &reference,
            &Allowed { precision: PEAKED, ..BLURRED },
            away_from_the_lamp,
        );
        let traced = images(
            SEEDS + SEEDS / 4,
            &text,
            &["render.method=photon", "volume.single_scattering=traced", "render.samples=4", "film.layers=false"],
        );
        compare(
            &mut checks,
            &format!("{name}, traced"),
            &traced,
            &reference,
            &Allowed { precision: PEAKED, ..UNBIASED },
            not_at_the_lamp,
        );
    }
    checks.finish();
}
