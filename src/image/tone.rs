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
fn luminance([r, g, b]: &[f32; 3]) -> f64 {
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
    const SCALE: f64 = 0.723_166_8;
    // f reaches 1 at 7.2429 and would go on to 1.03.
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
