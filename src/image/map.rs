//! Numbers as colours: maps of differences, and the bars that say what their colours mean.

use super::Image;
use super::tone::luminance;

/// Colours for numbers. Both palettes keep their order in grey and for colour-blind eyes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Palette {
    /// From 0, black, to 1, pale yellow; what FLIP maps are shown in. Magma by N. Smith and S. van der Walt
    /// (matplotlib, CC0).
    Magma,
    /// From −1, blue, by 0, white, to 1, red. RdBu by C. Brewer (colorbrewer2.org), turned round.
    Diverging,
}

/// Magma at k/16.
const MAGMA: [[u8; 3]; 17] = [
    [0, 0, 4],
    [10, 8, 34],
    [29, 17, 71],
    [54, 16, 107],
    [81, 18, 124],
    [106, 28, 129],
    [131, 38, 129],
    [156, 46, 127],
    [183, 55, 121],
    [207, 64, 112],
    [229, 80, 100],
    [244, 105, 92],
    [251, 135, 97],
    [254, 165, 113],
    [254, 194, 135],
    [253, 224, 161],
    [252, 253, 191],
];

const RED_BLUE: [[u8; 3]; 11] = [
    [5, 48, 97],
    [33, 102, 172],
    [67, 147, 195],
    [146, 197, 222],
    [209, 229, 240],
    [247, 247, 247],
    [253, 219, 199],
    [244, 165, 130],
    [214, 96, 77],
    [178, 24, 43],
    [103, 0, 31],
];

/// What is not a number, in either palette.
const NOT_A_NUMBER: [u8; 3] = [240, 228, 66];

impl Palette {
    /// The colours at equal distances over the palette's range; between them, colours are interpolated in sRGB.
    pub fn stops(self) -> &'static [[u8; 3]] {
        match self {
            Palette::Magma => &MAGMA,
            Palette::Diverging => &RED_BLUE,
        }
    }

    /// The colour of `value`; values beyond the range have the colour of its end, NaN has one of its own.
    pub fn colour(self, value: f64) -> [u8; 3] {
        if value.is_nan() {
            return NOT_A_NUMBER;
        }
        let share = match self {
            Palette::Magma => value,
            Palette::Diverging => 0.5 * (value + 1.0),
        };
        let stops = self.stops();
        let place = share.clamp(0.0, 1.0) * (stops.len() - 1) as f64;
        let below = (place as usize).min(stops.len() - 2);
        let part = place - below as f64;
        let mix = |c: usize| (1.0 - part) * f64::from(stops[below][c]) + part * f64::from(stops[below + 1][c]);
        [0, 1, 2].map(|c| mix(c).round() as u8)
    }
}

/// How much brighter than the reference each pixel is, relative to it: (Y_I − Y_R)/√(Y_R² + 0.01 · mean(Y_R)²), Y
/// Rec. 709 luminance; the root of what relative squared error sums, with its sign. NaN where either is not
/// finite; `None` if the sizes differ.
pub fn signed_errors(image: &Image, reference: &Image) -> Option<Vec<f64>> {
    if (image.width, image.height) != (reference.width, reference.height) {
        return None;
    }
    let known: Vec<f64> = reference.pixels.iter().map(luminance).collect();
    let finite = || known.iter().filter(|value| value.is_finite());
    let level = finite().sum::<f64>() / finite().count().max(1) as f64;
    let error = |(pixel, &known): (&[f32; 3], &f64)| {
        let difference = luminance(pixel) - known;
        match difference.is_finite() {
            // 0/0 only where nothing is expected and nothing found.
            true if difference == 0.0 => 0.0,
            true => difference / (known * known + 0.01 * level * level).sqrt(),
            false => f64::NAN,
        }
    };
    Some(image.pixels.iter().zip(&known).map(error).collect())
}

/// The range ±r to show signed errors in: r is at least what 98 of 100 of them stay below, and 1, 2 or 5 times a
/// power of ten.
pub fn range_of(errors: impl Iterator<Item = f64>) -> f64 {
    let mut sizes: Vec<f64> = errors.map(f64::abs).filter(|size| size.is_finite()).collect();
    sizes.sort_unstable_by(f64::total_cmp);
    let size = sizes.get((sizes.len() * 98 / 100).min(sizes.len().saturating_sub(1))).copied().unwrap_or(0.0);
    // Below a millionth lies the rounding of what is compared.
    let size = size.clamp(1e-6, 1e6);
    let decade = 10f64.powf(size.log10().floor());
    [1.0, 2.0, 5.0, 10.0].map(|step| step * decade).into_iter().find(|range| *range >= 0.999_999 * size).unwrap_or(size)
}

/// Digits of 3 × 5 dots, a row in each three bits from the top left.
const GLYPHS: [(char, u16); 14] = [
    ('0', 0b111_101_101_101_111),
    ('1', 0b010_110_010_010_111),
    ('2', 0b111_001_111_100_111),
    ('3', 0b111_001_011_001_111),
    ('4', 0b101_101_111_001_001),
    ('5', 0b111_100_111_001_111),
    ('6', 0b111_100_111_101_111),
    ('7', 0b111_001_010_010_010),
    ('8', 0b111_101_111_101_111),
    ('9', 0b111_101_111_001_111),
    ('.', 0b000_000_000_000_010),
    ('%', 0b101_001_010_100_101),
    ('+', 0b000_010_111_010_000),
    ('-', 0b000_000_111_000_000),
];

/// Dots of a glyph are squares of this many pixels.
const DOT: usize = 2;
/// From one glyph to the next.
const ADVANCE: usize = 4 * DOT;
/// The bar is this high, with a margin above and below.
const BAR: usize = 12;
const MARGIN: usize = 4;

/// A picture of `values`, rows of `width`, in colours, above a bar that shows the palette between the first and
/// the last of `labels` (of digits, `.`, `%`, `+` and `-`; spread evenly). Returns the pixels and their width, which is
/// that of the labels if the map is narrower.
pub fn map_with_bar(
    values: impl Iterator<Item = f64>,
    width: usize,
    palette: Palette,
    labels: &[String],
) -> (Vec<[u8; 3]>, usize) {
    const PAPER: [u8; 3] = [255; 3];
    const INK: [u8; 3] = [0; 3];
    let breadth = |label: &str| (ADVANCE * label.chars().count()).saturating_sub(DOT);
    let needed = 2 * MARGIN + labels.iter().map(|label| breadth(label) + 2 * ADVANCE).sum::<usize>();
    let full = width.max(needed);

    let mut pixels: Vec<[u8; 3]> = Vec::new();
    for (i, value) in values.enumerate() {
        pixels.push(palette.colour(value));
        if i % width == width - 1 {
            pixels.resize(pixels.len() + full - width, PAPER);
        }
    }
    let top = pixels.len() / full;
    pixels.resize(full * (top + 3 * MARGIN + BAR + 5 * DOT), PAPER);

    let (left, long) = (MARGIN, full - 2 * MARGIN);
    let first = match palette {
        Palette::Magma => 0.0,
        Palette::Diverging => -1.0,
    };
    for y in top + MARGIN..top + MARGIN + BAR {
        for x in 0..long {
            let share = x as f64 / (long - 1) as f64;
            pixels[y * full + left + x] = palette.colour(first + share * (1.0 - first));
        }
    }
    for (k, label) in labels.iter().enumerate() {
        // The first label begins where the bar does, the last ends there.
        let free = long - breadth(label);
        let mut x = left + free * k / (labels.len() - 1).max(1);
        for letter in label.chars() {
            let dots = GLYPHS.iter().find(|(glyph, _)| *glyph == letter).map_or(0, |(_, dots)| *dots);
            for bit in (0..15).filter(|bit| dots >> (14 - bit) & 1 == 1) {
                for (dy, dx) in (0..DOT).flat_map(|dy| (0..DOT).map(move |dx| (dy, dx))) {
                    let y = top + 2 * MARGIN + BAR + bit / 3 * DOT + dy;
                    pixels[y * full + x + bit % 3 * DOT + dx] = INK;
                }
            }
            x += ADVANCE;
        }
    }
    (pixels, full)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn palettes_keep_their_order_and_their_ends() {
        let grey = |[r, g, b]: [u8; 3]| luminance(&[r, g, b].map(|value| (f32::from(value) / 255.0).powf(2.2)));
        let levels: Vec<f64> = (0..=100).map(|i| grey(Palette::Magma.colour(f64::from(i) / 100.0))).collect();
        assert!(levels.is_sorted());
        for (from, to) in [(0.0, 1.0), (0.0, -1.0)] {
            let towards = |i: i32| grey(Palette::Diverging.colour(from + f64::from(i) / 100.0 * (to - from)));
            assert!((0..=100).map(towards).is_sorted_by(|a, b| a >= b), "towards {to}");
        }
        assert_eq!(Palette::Magma.colour(f64::INFINITY), [252, 253, 191]);
        assert_eq!(Palette::Diverging.colour(-9.0), [5, 48, 97]);
        assert_eq!(Palette::Diverging.colour(0.0), [247; 3]);
        assert_eq!(Palette::Magma.colour(f64::NAN), NOT_A_NUMBER);
    }

    #[test]
    fn errors_are_signed_and_relative() {
        let reference = Image { width: 2, height: 2, pixels: vec![[1.0; 3], [3.0; 3], [0.0; 3], [4.0; 3]] };
        let image = Image { width: 2, height: 2, pixels: vec![[2.0; 3], [0.0; 3], [0.0; 3], [f32::NAN; 3]] };
        let errors = signed_errors(&image, &reference).unwrap();
        // The mean is 2.
        assert!((errors[0] - 1.0 / 1.04f64.sqrt()).abs() < 1e-12 && (errors[1] + 3.0 / 9.04f64.sqrt()).abs() < 1e-12);
        assert!(errors[2] == 0.0 && errors[3].is_nan());
        assert_eq!(signed_errors(&Image::new(2, 2), &Image::new(2, 2)).unwrap(), [0.0; 4]);
        assert!(signed_errors(&Image::new(4, 1), &reference).is_none());
        for (errors, range) in
            [(vec![0.3, -0.2], 0.5), (vec![1.0], 1.0), (vec![-1.1], 2.0), (vec![f64::NAN], 1e-6), (vec![0.05; 3], 0.05)]
        {
            let found = range_of(errors.iter().copied());
            assert!((found / range - 1.0).abs() < 1e-9, "{errors:?}: {found}");
        }
    }

    #[test]
    fn a_bar_below_the_map_says_what_its_colours_mean() {
        for width in [3, 400] {
            let values = (0..2 * width).map(|i| (i % width) as f64 / (width - 1) as f64);
            let labels = ["0", "0.5", "1"].map(String::from);
            let (pixels, full) = map_with_bar(values, width, Palette::Magma, &labels);
            assert!(full >= width && pixels.len().is_multiple_of(full));
            assert_eq!((pixels[0], pixels[width - 1]), (Palette::Magma.colour(0.0), Palette::Magma.colour(1.0)));
            let row = &pixels[full * (2 + MARGIN)..][..full];
            assert_eq!((row[MARGIN], row[full - MARGIN - 1]), (pixels[0], pixels[width - 1]));
            // Dots of the digits: 12, 12 + 1 + 11, 8.
            let ink = pixels[full * (2 + 2 * MARGIN + BAR)..].iter().filter(|pixel| **pixel == [0; 3]).count();
            assert_eq!(ink, DOT * DOT * (12 + 12 + 1 + 11 + 8));
        }
    }
}
