//! FLIP: how different two pictures look when one flips between them on a screen.
//!
//! - [`flip`], LDR-FLIP, is for pictures as they are shown: P. Andersson, J. Nilsson, T. Akenine-Möller,
//!   M. Oskarsson, K. Åström, M. D. Fairchild, "FLIP: A Difference Evaluator for Alternating Images", Proc. ACM
//!   Comput. Graph. Interact. Tech. 3(2), 2020. Section numbers below are those of this paper.
//! - [`hdr_flip`] is for radiance, which can be shown at many exposures: P. Andersson, J. Nilsson, P. Shirley,
//!   T. Akenine-Möller, "Visualizing Errors in Rendered High Dynamic Range Images", Eurographics Short Papers 2021.

use std::f64::consts::PI;

use rayon::prelude::*;

use super::Image;
use super::tone::{luminance, srgb_to_linear};
use crate::math::{DMat3, DVec3};

/// Pixels per degree of visual angle of the paper's display: 0.7 m before a screen 0.7 m wide with
/// 3840 columns, 0.7 · 3840/0.7 · π/180.
pub const DEFAULT_PIXELS_PER_DEGREE: f64 = 3840.0 * PI / 180.0;

/// The difference of two pictures.
#[derive(Clone, Debug)]
pub struct Flip {
    /// The difference at each pixel, row by row: 0 (none) to 1.
    pub map: Vec<f32>,
    /// The mean over the map.
    pub mean: f64,
}

impl Flip {
    fn of(map: Vec<f32>) -> Flip {
        let mean = map.iter().map(|&value| f64::from(value)).sum::<f64>() / map.len() as f64;
        Flip { map, mean }
    }
}

/// The difference between two 8-bit sRGB pictures of `width` columns, seen at `pixels_per_degree`;
/// `None` if they differ in size or are not whole rows.
pub fn flip(reference: &[[u8; 3]], test: &[[u8; 3]], width: usize, pixels_per_degree: f64) -> Option<Flip> {
    let table: [f32; 256] = std::array::from_fn(|value| srgb_to_linear(value as f64 / 255.0) as f32);
    let linear = |picture: &[[u8; 3]]| -> Vec<[f32; 3]> {
        picture.par_iter().map(|pixel| pixel.map(|value| table[usize::from(value)])).collect()
    };
    Some(Flip::of(difference(&linear(reference), &linear(test), width, pixels_per_degree)?))
}

/// HDR-FLIP: the largest LDR-FLIP of each pixel over the exposures from that at which the reference's brightest pixel
/// is not burnt out to that at which its median is as bright; about one a stop, at least two. Negative values
/// and NaN count as 0.
///
/// `None` if the images differ in size, have no pixels, or no pixel of the reference is brighter than 0.
pub fn hdr_flip(reference: &Image, test: &Image, pixels_per_degree: f64) -> Option<Flip> {
    if (reference.width, reference.height) != (test.width, test.height) {
        return None;
    }
    let mut largest: Option<Vec<f32>> = None;
    for exposure in exposures(reference)? {
        let [shown, tried] = [reference, test].map(|image| exposed(image, exposure));
        let map = difference(&shown, &tried, reference.width, pixels_per_degree)?;
        match &mut largest {
            Some(largest) => largest.iter_mut().zip(map).for_each(|(most, value)| *most = most.max(value)),
            None => largest = Some(map),
        }
    }
    largest.map(Flip::of)
}

/// The tone mapper of HDR-FLIP: the fit of the ACES reference transform by K. Narkowicz (2015) after a
/// pre-exposure of 0.6, (a x² + b x)/(c x² + d x + e).
const ACES: [f64; 5] = [0.36 * 2.51, 0.6 * 0.03, 0.36 * 2.43, 0.6 * 0.59, 0.14];

/// The exposures of HDR-FLIP, in stops (§2.1 of its paper): what the tone mapper takes to 0.85 is the reference's
/// largest luminance at the first and its median at the last.
fn exposures(reference: &Image) -> Option<impl Iterator<Item = f64>> {
    const SHOWN: f64 = 0.85;
    let mut luminances: Vec<f64> =
        reference.pixels.iter().map(luminance).filter(|value| *value > 0.0 && value.is_finite()).collect();
    luminances.sort_unstable_by(f64::total_cmp);
    let (brightest, count) = (*luminances.last()?, luminances.len());
    let median = 0.5 * (luminances[(count - 1) / 2] + luminances[count / 2]);

    let [a, b, c, d, e] = ACES;
    let (square, linear, constant) = (a - SHOWN * c, b - SHOWN * d, -SHOWN * e);
    let level = (-linear + (linear * linear - 4.0 * square * constant).sqrt()) / (2.0 * square);
    let (first, last) = ((level / brightest).log2(), (level / median).log2());
    let count = ((last - first).ceil() as usize).max(2);
    Some((0..count).map(move |i| first + (last - first) * i as f64 / (count - 1) as f64))
}

/// `image` as the tone mapper of HDR-FLIP shows it, linear in [0, 1].
fn exposed(image: &Image, exposure: f64) -> Vec<[f32; 3]> {
    let [a, b, c, d, e] = ACES;
    let gain = exposure.exp2();
    let shown = |value: f32| {
        // The curve has passed 1 long before 1e9, from where on its terms would overflow for the brightest.
        let x = (gain * f64::from(value)).clamp(0.0, 1e9);
        if x.is_nan() { 0.0 } else { (x * (a * x + b) / (x * (c * x + d) + e)).min(1.0) as f32 }
    };
    image.pixels.par_iter().map(|pixel| pixel.map(shown)).collect()
}

/// The difference at each pixel of two pictures in linear sRGB within [0, 1].
fn difference(reference: &[[f32; 3]], test: &[[f32; 3]], width: usize, pixels_per_degree: f64) -> Option<Vec<f32>> {
    let whole = width > 0 && !reference.is_empty() && reference.len().is_multiple_of(width);
    let resolved = pixels_per_degree.is_finite() && pixels_per_degree > 0.0;
    if !whole || !resolved || reference.len() != test.len() {
        return None;
    }
    let filters = Filters::new(pixels_per_degree);
    let a = Seen::new(reference, width, &filters);
    let b = Seen::new(test, width, &filters);

    // The largest colour difference on a screen, §4.1.3.
    let green = hunt_lab([0.0, 1.0, 0.0]);
    let blue = hunt_lab([0.0, 0.0, 1.0]);
    let largest = hyab(green, blue).powf(COLOUR_EXPONENT);
    let at = |i: usize| {
        let colour = redistribute(hyab(a.colours[i], b.colours[i]).powf(COLOUR_EXPONENT), largest);
        // §4.2: the larger of the differences in edges and in points, as an exponent, §4.3.
        let [edges, points] = [0, 1].map(|kind| (a.features[i][kind] - b.features[i][kind]).abs());
        let feature = (edges.max(points) / std::f32::consts::SQRT_2).powf(FEATURE_EXPONENT);
        colour.powf(1.0 - feature)
    };
    Some((0..reference.len()).into_par_iter().map(at).collect())
}

/// q_c of §4.1.3.
const COLOUR_EXPONENT: f32 = 0.7;
/// q_f of §4.2.
const FEATURE_EXPONENT: f32 = 0.5;

/// §4.1.3: colour differences spread over [0, 1], those up to 0.4 of the largest over [0, 0.95].
fn redistribute(difference: f32, largest: f32) -> f32 {
    const P_C: f32 = 0.4;
    const P_T: f32 = 0.95;
    let knee = P_C * largest;
    if difference < knee { P_T / knee * difference } else { P_T + (difference - knee) / (largest - knee) * (1.0 - P_T) }
}

/// One picture as the eye takes it in.
struct Seen {
    /// Filtered colours in Hunt-adjusted L*a*b*.
    colours: Vec<[f32; 3]>,
    /// The strength of edges and points.
    features: Vec<[f32; 2]>,
}

impl Seen {
    fn new(picture: &[[f32; 3]], width: usize, filters: &Filters) -> Seen {
        let opponents: Vec<[f32; 3]> = picture.par_iter().map(|&pixel| to_opponent(pixel)).collect();
        let plane = |c: usize| opponents.iter().map(|colour| colour[c]).collect::<Vec<f32>>();

        // §4.1.1: each opponent channel blurred as the eye does at this distance.
        let luminance = plane(0);
        let y = convolve(&luminance, width, &filters.achromatic, &filters.achromatic);
        let cx = convolve(&plane(1), width, &filters.red_green, &filters.red_green);
        let cz = plane(2);
        let [near, far] = [&filters.blue_yellow[0], &filters.blue_yellow[1]].map(|(weight, kernel)| {
            let mut blurred = convolve(&cz, width, kernel, kernel);
            blurred.iter_mut().for_each(|value| *value *= weight);
            blurred
        });
        let to_rgb = from_relative_xyz();
        let colours = (0..picture.len())
            .into_par_iter()
            .map(|i| from_opponent([y[i], cx[i], near[i] + far[i]], &to_rgb).map(|value| value.clamp(0.0, 1.0)))
            .map(hunt_lab)
            .collect();

        // §4.2: first and second derivatives of the unfiltered luminance, scaled to [0, 1].
        let grey: Vec<f32> = luminance.iter().map(|value| (value + 16.0) / 116.0).collect();
        let strength = |derivative: &[f32]| {
            let x = convolve(&grey, width, derivative, &filters.smooth);
            let y = convolve(&grey, width, &filters.smooth, derivative);
            x.into_iter().zip(y).map(|(x, y)| x.hypot(y)).collect::<Vec<f32>>()
        };
        let features = strength(&filters.edge).into_iter().zip(strength(&filters.point)).map(|(e, p)| [e, p]).collect();
        Seen { colours, features }
    }
}

/// The one-dimensional kernels; two-dimensional ones are their products.
struct Filters {
    achromatic: Vec<f32>,
    red_green: Vec<f32>,
    /// Two Gaussians with the shares they have in the sum.
    blue_yellow: [(f32, Vec<f32>); 2],
    /// The Gaussian along an edge, its derivative and second derivative across.
    smooth: Vec<f32>,
    edge: Vec<f32>,
    point: Vec<f32>,
}

impl Filters {
    fn new(pixels_per_degree: f64) -> Filters {
        // Table 1: a √(π/b) exp(−π² d²/b) at d degrees.
        const ACHROMATIC: f64 = 0.0047;
        const RED_GREEN: f64 = 0.0053;
        const BLUE_YELLOW: [(f64, f64); 2] = [(34.1, 0.04), (13.5, 0.025)];
        // Three standard deviations of the widest.
        let radius = (3.0 * (0.04 / (2.0 * PI * PI)).sqrt() * pixels_per_degree).ceil() as i64;
        let gaussian = |b: f64| samples(radius, |x| (-(PI * x / pixels_per_degree).powi(2) / b).exp());

        let parts = BLUE_YELLOW.map(|(a, b)| {
            let kernel = gaussian(b);
            let sum: f64 = kernel.iter().sum();
            (a * (PI / b).sqrt() * sum * sum, kernel)
        });
        let total: f64 = parts.iter().map(|(volume, _)| volume).sum();

        // §4.2: the detector spans 0.082 degrees.
        let deviation = 0.5 * 0.082 * pixels_per_degree;
        let radius = (3.0 * deviation).ceil() as i64;
        let bell = |x: f64| (-x * x / (2.0 * deviation * deviation)).exp();
        Filters {
            achromatic: normalised(gaussian(ACHROMATIC)),
            red_green: normalised(gaussian(RED_GREEN)),
            blue_yellow: parts.map(|(volume, kernel)| ((volume / total) as f32, normalised(kernel))),
            smooth: normalised(samples(radius, bell)),
            edge: normalised(samples(radius, |x| -x * bell(x))),
            point: normalised(samples(radius, |x| (x * x / (deviation * deviation) - 1.0) * bell(x))),
        }
    }
}

fn samples(radius: i64, kernel: impl Fn(f64) -> f64) -> Vec<f64> {
    (-radius..=radius).map(|x| kernel(x as f64)).collect()
}

/// The kernel scaled so that its positive weights sum to 1 and its negative ones, if any, to −1.
fn normalised(kernel: Vec<f64>) -> Vec<f32> {
    let positive: f64 = kernel.iter().filter(|weight| **weight > 0.0).sum();
    let negative: f64 = kernel.iter().filter(|weight| **weight < 0.0).sum();
    kernel.iter().map(|&weight| (weight / if weight < 0.0 { -negative } else { positive }) as f32).collect()
}

/// `plane` convolved by `along_x` and then `along_y`, kernels of odd length; beyond its borders the
/// plane continues with the values there.
fn convolve(plane: &[f32], width: usize, along_x: &[f32], along_y: &[f32]) -> Vec<f32> {
    let height = plane.len() / width;
    let mut rows = vec![0.0; plane.len()];
    rows.par_chunks_exact_mut(width).zip(plane.par_chunks_exact(width)).for_each(|(out, row)| {
        for (x, out) in out.iter_mut().enumerate() {
            let tap = |(k, weight): (usize, &f32)| weight * row[clamped(x, k, along_x.len() / 2, width)];
            *out = along_x.iter().enumerate().map(tap).sum();
        }
    });
    let mut result = vec![0.0; plane.len()];
    result.par_chunks_exact_mut(width).enumerate().for_each(|(y, out)| {
        for (k, weight) in along_y.iter().enumerate() {
            let row = &rows[clamped(y, k, along_y.len() / 2, height) * width..][..width];
            out.iter_mut().zip(row).for_each(|(out, value)| *out += weight * value);
        }
    });
    result
}

/// `position + k − radius`, kept within `0..size`.
fn clamped(position: usize, k: usize, radius: usize, size: usize) -> usize {
    (position + k).saturating_sub(radius).min(size - 1)
}

/// Linear sRGB to XYZ, from the sRGB primaries and white point (IEC 61966-2-1).
const TO_XYZ: [[f64; 3]; 3] = [
    [10_135_552.0 / 24_577_794.0, 8_788_810.0 / 24_577_794.0, 4_435_075.0 / 24_577_794.0],
    [2_613_072.0 / 12_288_897.0, 8_788_810.0 / 12_288_897.0, 887_015.0 / 12_288_897.0],
    [1_425_312.0 / 73_733_382.0, 8_788_810.0 / 73_733_382.0, 70_074_185.0 / 73_733_382.0],
];

/// XYZ of a linear sRGB colour, relative to that of white.
fn to_relative_xyz(colour: [f32; 3]) -> [f32; 3] {
    TO_XYZ.map(|row| {
        let white: f64 = row.iter().sum();
        (row.iter().zip(colour).map(|(weight, value)| weight * f64::from(value)).sum::<f64>() / white) as f32
    })
}

/// The linear opponent space Y C_x C_z of a linear sRGB colour, Appendix A.
fn to_opponent(colour: [f32; 3]) -> [f32; 3] {
    let [x, y, z] = to_relative_xyz(colour);
    [116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z)]
}

/// The inverse of [`to_relative_xyz`].
fn from_relative_xyz() -> DMat3 {
    let [x, y, z] = TO_XYZ.map(|row| DVec3::from_array(row) / DVec3::from_array(row).element_sum());
    DMat3::from_cols(x, y, z).transpose().inverse()
}

/// The linear sRGB colour of an opponent one.
fn from_opponent([luma, cx, cz]: [f32; 3], to_rgb: &DMat3) -> [f32; 3] {
    let y = f64::from((luma + 16.0) / 116.0);
    let xyz = DVec3::new(y + f64::from(cx) / 500.0, y, y - f64::from(cz) / 200.0);
    (*to_rgb * xyz).to_array().map(|value| value as f32)
}

/// L*a*b* of a linear sRGB colour, its chroma weighted by lightness after Hunt, §4.1.2.
fn hunt_lab(colour: [f32; 3]) -> [f32; 3] {
    const DELTA: f32 = 6.0 / 29.0;
    let [x, y, z] = to_relative_xyz(colour).map(|value| {
        if value > DELTA * DELTA * DELTA { value.cbrt() } else { value / (3.0 * DELTA * DELTA) + 4.0 / 29.0 }
    });
    let lightness = 116.0 * y - 16.0;
    let hunt = 0.01 * lightness;
    [lightness, hunt * 500.0 * (x - y), hunt * 200.0 * (y - z)]
}

/// The HyAB distance, §4.1.3: city block in lightness, Euclidean in chroma.
fn hyab(a: [f32; 3], b: [f32; 3]) -> f32 {
    (a[0] - b[0]).abs() + (a[1] - b[1]).hypot(a[2] - b[2])
}

#[cfg(test)]
mod tests {
    use super::*;

    const WIDTH: usize = 80;

    fn picture(value: impl Fn(usize, usize, usize) -> usize) -> Vec<[u8; 3]> {
        (0..WIDTH * 60).map(|i| [0, 1, 2].map(|c| value(i % WIDTH, i / WIDTH, c) as u8)).collect()
    }

    /// A fixed scramble, so that the authors' implementation can be fed the same pictures.
    fn hash(x: usize, y: usize, c: usize) -> usize {
        let [x, y, c] = [x, y, c].map(|value| value as u32);
        let mut h = x.wrapping_mul(0x9e37_79b1) ^ y.wrapping_mul(0x85eb_ca6b) ^ c.wrapping_mul(0xc2b2_ae35);
        h = (h ^ (h >> 15)).wrapping_mul(0x2c1b_3c6d);
        h = (h ^ (h >> 12)).wrapping_mul(0x297a_2d39);
        (h ^ (h >> 15)) as usize
    }

    /// The expected means were computed by the authors' C++ implementation (nv-flip 0.1.2).
    #[test]
    fn means_agree_with_the_authors_implementation() {
        let ramp = |x: usize, y: usize, c: usize| [3 * x, 4 * y, 255 - 3 * x][c];
        let smooth = picture(ramp);
        let noisy = picture(|x, y, c| (ramp(x, y, c) + hash(x, y, c) % 31).saturating_sub(15).min(255));
        let sparks = picture(|x, y, c| if hash(x, y, 7).is_multiple_of(97) { 255 } else { ramp(x, y, c) });
        let checks =
            |shift: usize| picture(move |x, y, _| if ((x + shift) / 8 + y / 8).is_multiple_of(2) { 230 } else { 25 });
        let pure = |channel: usize| picture(move |_, _, c| if c == channel { 255 } else { 0 });
        for (name, reference, test, density, expected) in [
            ("noise", &smooth, &noisy, DEFAULT_PIXELS_PER_DEGREE, 0.081_400_9),
            ("noise, far", &smooth, &noisy, 30.0, 0.162_562_6),
            ("sparks", &smooth, &sparks, DEFAULT_PIXELS_PER_DEGREE, 0.059_767_3),
            ("shift", &checks(0), &checks(1), DEFAULT_PIXELS_PER_DEGREE, 0.283_179_5),
            ("unlike", &checks(0), &smooth, DEFAULT_PIXELS_PER_DEGREE, 0.926_179_6),
            ("green and blue", &pure(1), &pure(2), DEFAULT_PIXELS_PER_DEGREE, 1.0),
            ("same", &noisy, &noisy, DEFAULT_PIXELS_PER_DEGREE, 0.0),
        ] {
            let flip = flip(reference, test, WIDTH, density).unwrap();
            assert!((flip.mean - expected).abs() < 1e-4, "{name}: {} instead of {expected}", flip.mean);
        }
    }

    /// The expected means were computed by the authors' Python package (flip-evaluator 1.7).
    #[test]
    fn means_over_exposures_agree_with_the_authors_implementation() {
        let image = |value: &dyn Fn(usize, usize, usize) -> f32| {
            Image::from_fn(WIDTH, 60, |x, y| [0, 1, 2].map(|c| value(x, y, c)))
        };
        // Ten stops of brightness.
        let ramp =
            |x: usize, y: usize, c: usize| ((x as f32 - 20.0) / 8.0).exp2() * ((c + 1) as f32 + y as f32 / 30.0) / 4.0;
        let smooth = image(&ramp);
        let noisy = image(&|x, y, c| ramp(x, y, c) * (0.7 + 0.6 * (hash(x, y, c) % 1001) as f32 / 1000.0));
        let spark = |x: usize, y: usize| if hash(x, y, 7).is_multiple_of(97) { 50.0 } else { 0.0 };
        let sparks = image(&|x, y, c| ramp(x, y, c) + spark(x, y));
        let dark = image(&|x, y, c| 0.8 * ramp(x, y, c));
        let flat = |level: f32| image(&|_, _, _| level);
        for (name, reference, test, density, expected) in [
            ("noise", &smooth, &noisy, DEFAULT_PIXELS_PER_DEGREE, 0.105_372_6),
            ("noise, far", &smooth, &noisy, 30.0, 0.204_751_5),
            ("sparks", &smooth, &sparks, DEFAULT_PIXELS_PER_DEGREE, 0.076_954_0),
            ("dark", &smooth, &dark, DEFAULT_PIXELS_PER_DEGREE, 0.256_337_8),
            ("flat", &flat(0.5), &flat(0.4), DEFAULT_PIXELS_PER_DEGREE, 0.089_181_4),
            ("same", &noisy, &noisy, DEFAULT_PIXELS_PER_DEGREE, 0.0),
        ] {
            let flip = hdr_flip(reference, test, density).unwrap();
            assert!((flip.mean - expected).abs() < 1e-4, "{name}: {} instead of {expected}", flip.mean);
        }
        // Radiance has no unit in which it is seen; what is black has no exposure.
        let brighter = [&smooth, &noisy].map(|image| {
            let pixels = image.pixels.iter().map(|pixel| pixel.map(|value| 1024.0 * value)).collect();
            Image { pixels, ..*image }
        });
        let scaled = hdr_flip(&brighter[0], &brighter[1], DEFAULT_PIXELS_PER_DEGREE).unwrap().mean;
        assert!((scaled - 0.105_372_6).abs() < 1e-4, "{scaled}");
        assert!(hdr_flip(&flat(0.0), &smooth, DEFAULT_PIXELS_PER_DEGREE).is_none());
        let broken = image(&|x, _, _| [f32::NAN, f32::INFINITY, f32::MAX, -1.0][x % 4]);
        let map = hdr_flip(&smooth, &broken, DEFAULT_PIXELS_PER_DEGREE).unwrap().map;
        assert!(map.iter().all(|value| (0.0..=1.0).contains(value)));
    }

    #[test]
    fn the_map_shows_where() {
        let grey = picture(|_, _, _| 100);
        let mut dotted = grey.clone();
        dotted[20 * WIDTH + 30] = [255; 3];
        let map = flip(&grey, &dotted, WIDTH, DEFAULT_PIXELS_PER_DEGREE).unwrap().map;
        let worst = (0..map.len()).max_by(|&a, &b| map[a].total_cmp(&map[b])).unwrap();
        assert_eq!((worst % WIDTH, worst / WIDTH), (30, 20));
        assert_eq!((map[0], map[59 * WIDTH]), (0.0, 0.0));
        assert!(flip(&grey, &dotted[1..], WIDTH, DEFAULT_PIXELS_PER_DEGREE).is_none());
    }
}
