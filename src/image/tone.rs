//! From radiance to what a screen shows: exposure, a curve, the sRGB encoding.

use super::Image;

/// How radiance becomes an 8-bit picture.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ToneSettings {
    /// Stops: radiance is multiplied by 2^exposure. `None`: [`auto_exposure`].
    pub exposure: Option<f64>,
    /// The curve applied after it.
    pub curve: ToneMap,
}

/// The curve from exposed radiance to the linear light of a screen.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ToneMap {
    /// None: what exceeds 1 is cut off.
    Linear,
    /// An S-shaped curve that darkens shadows a little and rolls highlights off towards white, which
    /// is reached at 10.
    ///
    /// The fit of the ACES reference transform by K. Narkowicz, "ACES Filmic Tone Mapping Curve"
    /// (2015), with its input scaled so that 0.18 maps to 0.18 (0.46 in sRGB). The curve is applied to the
    /// largest and the smallest channel; the middle one is placed so that the ratio
    /// (mid − min)/(max − min), and with it the hue, stays: bright colours fade to white
    /// but do not drift (as in the Adobe DNG SDK's `RefBaselineRGBTone`).
    #[default]
    Filmic,
}

/// The level a picture's typical brightness is exposed to: mid-grey.
const MID_GREY: f64 = 0.18;

/// The exposure in stops at which an image is neither dark nor burnt out: the one that brings its
/// typical luminance to mid-grey, 0.18.
///
/// Typical is the median of the luminances weighted by their square roots: large dark regions
/// hardly pull it down, small lamps hardly up. What is above the 99th percentile of the lit pixels counts as
/// that percentile, so that fireflies have no say. Pixels that are black, negative or not finite
/// are left out; an image of nothing else gets 0.
pub fn auto_exposure(image: &Image) -> f64 {
    let mut lit: Vec<f64> =
        image.pixels.iter().map(luminance).filter(|value| *value > 0.0 && value.is_finite()).collect();
    if lit.is_empty() {
        return 0.0;
    }
    lit.sort_unstable_by(f64::total_cmp);
    let cap = lit[(lit.len() - 1) * 99 / 100];
    let weight = |value: f64| value.min(cap).sqrt();
    let half = 0.5 * lit.iter().map(|&value| weight(value)).sum::<f64>();
    let mut below = 0.0;
    let typical = lit.iter().find(|&&value| {
        below += weight(value);
        below >= half
    });
    (MID_GREY / typical.map_or(cap, |value| value.min(cap))).log2()
}

/// Rec. 709 luminance.
pub(super) fn luminance([r, g, b]: &[f32; 3]) -> f64 {
    0.2126 * f64::from(*r) + 0.7152 * f64::from(*g) + 0.0722 * f64::from(*b)
}

/// `image` in 8-bit sRGB, rounded. Negative values and NaN become 0, infinite ones white.
pub fn tone_map(image: &Image, settings: &ToneSettings) -> Vec<[u8; 3]> {
    let gain = settings.exposure.unwrap_or_else(|| auto_exposure(image)).exp2();
    let map = |pixel: &[f32; 3]| {
        let exposed = pixel.map(|value| (gain * f64::from(value)).max(0.0));
        let shown = match settings.curve {
            ToneMap::Linear => exposed,
            ToneMap::Filmic => filmic_colour(exposed),
        };
        // The conversion saturates.
        shown.map(|value| (255.0 * linear_to_srgb(value.min(1.0)) + 0.5) as u8)
    };
    image.pixels.iter().map(map).collect()
}

/// The curve of [`ToneMap::Filmic`] for one channel, in [0, 1].
fn filmic(value: f64) -> f64 {
    // The solution of f(0.18 s) = 0.18 for Narkowicz's f.
    const SCALE: f64 = 0.723_171;
    // f reaches 1 at 7.2417 and would go on to 1.03.
    let x = (SCALE * value).min(7.3);
    (x * (2.51 * x + 0.03) / (x * (2.43 * x + 0.59) + 0.14)).min(1.0)
}

/// The curve applied to a colour without turning its hue.
fn filmic_colour(colour: [f64; 3]) -> [f64; 3] {
    let low = colour[0].min(colour[1]).min(colour[2]);
    let high = colour[0].max(colour[1]).max(colour[2]);
    let (shown_low, shown_high) = (filmic(low), filmic(high));
    if !high.is_finite() || high == low {
        return colour.map(filmic);
    }
    let slope = (shown_high - shown_low) / (high - low);
    colour.map(|value| shown_low + slope * (value - low))
}

/// The sRGB encoding (IEC 61966-2-1) of a linear value in [0, 1].
pub(super) fn linear_to_srgb(value: f64) -> f64 {
    if value <= 0.003_130_8 { 12.92 * value } else { 1.055 * value.powf(1.0 / 2.4) - 0.055 }
}

/// The linear value of an sRGB one in [0, 1].
pub(super) fn srgb_to_linear(value: f64) -> f64 {
    if value <= 0.040_45 { value / 12.92 } else { ((value + 0.055) / 1.055).powf(2.4) }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn shown(pixel: [f32; 3], exposure: f64, curve: ToneMap) -> [u8; 3] {
        let image = Image { width: 1, height: 1, pixels: vec![pixel] };
        tone_map(&image, &ToneSettings { exposure: Some(exposure), curve })[0]
    }

    #[test]
    fn mid_grey_stays_and_white_is_reached() {
        // 0.18 is 0.4614 in sRGB.
        for curve in [ToneMap::Linear, ToneMap::Filmic] {
            assert_eq!(shown([0.18; 3], 0.0, curve), [118; 3]);
            assert_eq!(shown([0.045; 3], 2.0, curve), [118; 3]);
            assert_eq!(shown([f32::NAN, -1.0, 0.0], 0.0, curve), [0; 3]);
            assert_eq!(shown([f32::INFINITY; 3], 0.0, curve), [255; 3]);
        }
        assert_eq!(shown([1.0; 3], 0.0, ToneMap::Linear), [255; 3]);
        assert!(shown([9.0; 3], 0.0, ToneMap::Filmic)[0] >= 253);
        assert_eq!(shown([10.1; 3], 0.0, ToneMap::Filmic), [255; 3]);
        assert!((filmic(0.18) - 0.18).abs() < 1e-6);
        let levels: Vec<f64> = (0..2000).map(|i| filmic(0.01 * f64::from(i))).collect();
        assert!(levels.is_sorted() && levels[1999] == 1.0);
    }

    #[test]
    fn the_filmic_curve_keeps_the_hue() {
        for scale in [0.01, 0.3, 1.0, 4.0] {
            let colour = [1.0, 0.35, 0.05].map(|value: f64| scale * value);
            let [r, g, b] = filmic_colour(colour);
            let place = |r: f64, g: f64, b: f64| (g - b) / (r - b);
            assert!((place(r, g, b) - place(1.0, 0.35, 0.05)).abs() < 1e-12);
        }
    }

    #[test]
    fn the_chosen_exposure_ignores_fireflies_darkness_and_lamps() {
        let base = Image::from_fn(100, 100, |x, y| [0.4 + 0.002 * ((x + y) % 100) as f32; 3]);
        let plain = auto_exposure(&base);
        assert!((plain - (0.18f64 / 0.5).log2()).abs() < 0.1, "{plain}");

        let mut fireflies = base.clone();
        fireflies.pixels.iter_mut().step_by(211).for_each(|pixel| *pixel = [1e7; 3]);
        assert!((auto_exposure(&fireflies) - plain).abs() < 0.2);

        let mut lamp = base.clone();
        lamp.pixels[..200].fill([60.0; 3]);
        assert!((auto_exposure(&lamp) - plain).abs() < 0.5);

        // One pixel in fifty is lit; the rest is black, or all but black.
        for night in [0.0, 1e-6] {
            let mut dark = base.clone();
            dark.pixels.iter_mut().enumerate().filter(|(i, _)| i % 49 != 0).for_each(|(_, p)| *p = [night; 3]);
            assert!((auto_exposure(&dark) - plain).abs() < 0.5, "{night}");
        }

        for nothing in [0.0, -1.0, f32::NAN, f32::INFINITY] {
            assert_eq!(auto_exposure(&Image { width: 1, height: 1, pixels: vec![[nothing; 3]] }), 0.0);
        }
    }
}
