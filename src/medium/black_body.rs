//! Black-body radiance in linear sRGB.

use crate::math::{DMat3, DVec3, Rgb};

/// Below this nothing visible is radiated.
const COLDEST: f64 = 400.0;
/// From here on the table is too coarse.
const HOTTEST: f64 = 40_000.0;
/// Planck's constant, J s; the speed of light, m/s; Boltzmann's constant, J/K (SI 2019, exact).
const H: f64 = 6.626_070_15e-34;
const C: f64 = 299_792_458.0;
const K: f64 = 1.380_649e-23;

/// CIE XYZ to linear sRGB (IEC 61966-2-1), in columns.
const XYZ_TO_SRGB: DMat3 = DMat3::from_cols(
    DVec3::new(3.240_454_2, -0.969_266_0, 0.055_643_4),
    DVec3::new(-1.537_138_5, 1.876_010_8, -0.204_025_9),
    DVec3::new(-0.498_531_4, 0.041_556_0, 1.057_225_2),
);

/// max(0, M · ∫ B_λ(T) (x̄, ȳ, z̄) dλ) with Planck's B_λ = 2hc²/λ⁵/(e^{hc/λkT} − 1) and the CIE 1931
/// curves, tabulated over temperature: W/(m² sr), no factor 683, no normalisation; 0 below 400 K.
#[derive(Clone, Debug)]
pub struct BlackBody {
    /// ln XYZ at equal steps of 1/T from 1/400 K down to 0.
    table: Vec<DVec3>,
}

impl Default for BlackBody {
    fn default() -> Self {
        const STEPS: usize = 1024;
        let table = (0..STEPS)
            .map(|i| {
                let inverse = (STEPS - i) as f64 / (STEPS as f64 * COLDEST);
                xyz(1.0 / inverse).map(f64::ln)
            })
            .collect();
        BlackBody { table }
    }
}

impl BlackBody {
    /// The radiance of a black body of a temperature in kelvin, in linear sRGB, W/(sr · m²); 0 below 400 K.
    pub fn radiance(&self, kelvin: f64) -> Rgb {
        if kelvin.is_nan() || kelvin < COLDEST {
            return Rgb::ZERO;
        }
        let steps = self.table.len();
        let x = (1.0 - COLDEST / kelvin) * steps as f64;
        // ln XYZ is nearly linear in 1/T; of the hottest it is not, and is computed.
        let xyz = if kelvin >= HOTTEST {
            xyz(kelvin)
        } else {
            let i = x as usize;
            self.table[i].lerp(self.table[i + 1], x - i as f64).map(f64::exp)
        };
        (XYZ_TO_SRGB * xyz).max(Rgb::ZERO)
    }
}

/// The colour of a black body in linear sRGB, its channels 1 on average. `kelvin` is at least 1000.
pub fn colour(kelvin: f64) -> Rgb {
    let rgb = (XYZ_TO_SRGB * xyz(kelvin)).max(Rgb::ZERO);
    rgb * (3.0 / rgb.element_sum())
}

/// The radiance of a black body behind something that lets `share` of the light of a wavelength in nanometres pass.
pub(crate) fn seen_through(kelvin: f64, share: impl Fn(f64) -> f64) -> Rgb {
    (XYZ_TO_SRGB * xyz_through(kelvin, share)).max(Rgb::ZERO)
}

/// CIE XYZ of the radiance of a black body.
fn xyz(kelvin: f64) -> DVec3 {
    xyz_through(kelvin, |_| 1.0)
}

/// The same behind a filter, by its integral over the visible spectrum.
fn xyz_through(kelvin: f64, share: impl Fn(f64) -> f64) -> DVec3 {
    let planck = |nanometres: f64| {
        let wavelength = nanometres * 1e-9;
        2.0 * H * C * C / wavelength.powi(5) / (H * C / (wavelength * K * kelvin)).exp_m1()
    };
    let sum: DVec3 = CIE_1931
        .iter()
        .enumerate()
        .map(|(i, &curves)| {
            let nanometres = FIRST_NANOMETRE + STEP_NANOMETRES * i as f64;
            DVec3::from_array(curves) * planck(nanometres) * share(nanometres)
        })
        .sum();
    sum * STEP_NANOMETRES * 1e-9
}

const FIRST_NANOMETRE: f64 = 380.0;
const STEP_NANOMETRES: f64 = 5.0;

/// The colour-matching functions x̄, ȳ, z̄ of the CIE 1931 2° standard observer (CIE 018:2019, Table 6).
#[rustfmt::skip]
const CIE_1931: [[f64; 3]; 81] = [
    [0.001368, 3.9e-05, 0.00645],
    [0.002236, 6.4e-05, 0.01055],
    [0.004243, 0.00012, 0.02005],
    [0.00765, 0.000217, 0.03621],
    [0.01431, 0.000396, 0.06785],
    [0.02319, 0.00064, 0.1102],
    [0.04351, 0.00121, 0.2074],
    [0.07763, 0.00218, 0.3713],
    [0.13438, 0.004, 0.6456],
    [0.21477, 0.0073, 1.03905],
    [0.2839, 0.0116, 1.3856],
    [0.3285, 0.01684, 1.62296],
    [0.34828, 0.023, 1.74706],
    [0.34806, 0.0298, 1.7826],
    [0.3362, 0.038, 1.77211],
    [0.3187, 0.048, 1.7441],
    [0.2908, 0.06, 1.6692],
    [0.2511, 0.0739, 1.5281],
    [0.19536, 0.09098, 1.28764],
    [0.1421, 0.1126, 1.0419],
    [0.09564, 0.13902, 0.81295],
    [0.05795, 0.1693, 0.6162],
    [0.03201, 0.20802, 0.46518],
    [0.0147, 0.2586, 0.3533],
    [0.0049, 0.323, 0.272],
    [0.0024, 0.4073, 0.2123],
    [0.0093, 0.503, 0.1582],
    [0.0291, 0.6082, 0.1117],
    [0.06327, 0.71, 0.07825],
    [0.1096, 0.7932, 0.05725],
    [0.1655, 0.862, 0.04216],
    [0.22575, 0.91485, 0.02984],
    [0.2904, 0.954, 0.0203],
    [0.3597, 0.9803, 0.0134],
    [0.43345, 0.99495, 0.00875],
    [0.51205, 1.0, 0.00575],
    [0.5945, 0.995, 0.0039],
    [0.6784, 0.9786, 0.00275],
    [0.7621, 0.952, 0.0021],
    [0.8425, 0.9154, 0.0018],
    [0.9163, 0.87, 0.00165],
    [0.9786, 0.8163, 0.0014],
    [1.0263, 0.757, 0.0011],
    [1.0567, 0.6949, 0.001],
    [1.0622, 0.631, 0.0008],
    [1.0456, 0.5668, 0.0006],
    [1.0026, 0.503, 0.00034],
    [0.9384, 0.4412, 0.00024],
    [0.85445, 0.381, 0.00019],
    [0.7514, 0.321, 0.0001],
    [0.6424, 0.265, 5e-05],
    [0.5419, 0.217, 3e-05],
    [0.4479, 0.175, 2e-05],
    [0.3608, 0.1382, 1e-05],
    [0.2835, 0.107, 0.0],
    [0.2187, 0.0816, 0.0],
    [0.1649, 0.061, 0.0],
    [0.1212, 0.04458, 0.0],
    [0.0874, 0.032, 0.0],
    [0.0636, 0.0232, 0.0],
    [0.04677, 0.017, 0.0],
    [0.0329, 0.01192, 0.0],
    [0.0227, 0.00821, 0.0],
    [0.01584, 0.005723, 0.0],
    [0.011359, 0.004102, 0.0],
    [0.008111, 0.002929, 0.0],
    [0.00579, 0.002091, 0.0],
    [0.004109, 0.001484, 0.0],
    [0.002899, 0.001047, 0.0],
    [0.002049, 0.00074, 0.0],
    [0.00144, 0.00052, 0.0],
    [0.001, 0.000361, 0.0],
    [0.00069, 0.000249, 0.0],
    [0.000476, 0.000172, 0.0],
    [0.000332, 0.00012, 0.0],
    [0.000235, 8.5e-05, 0.0],
    [0.000166, 6e-05, 0.0],
    [0.000117, 4.2e-05, 0.0],
    [8.3e-05, 3e-05, 0.0],
    [5.9e-05, 2.1e-05, 0.0],
    [4.2e-05, 1.5e-05, 0.0],];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn radiance_follows_the_integral() {
        let table = BlackBody::default();
        for kelvin in [400.0, 401.3, 777.0, 2000.0, 3456.7, 6500.0, 30_000.0, 399_999.0, 1e7] {
            let exact = (XYZ_TO_SRGB * xyz(kelvin)).max(Rgb::ZERO);
            let error = (table.radiance(kelvin) - exact).abs().max_element();
            assert!(error <= 2e-3 * exact.max_element(), "{kelvin} K: off by {error} of {exact}");
        }
        assert_eq!(table.radiance(399.9), Rgb::ZERO);
        assert_eq!(table.radiance(f64::NAN), Rgb::ZERO);
    }

    /// An integral over the 1 nm curves (380–780 nm) made elsewhere gives these.
    #[test]
    fn red_hot_and_daylight() {
        let table = BlackBody::default();
        let red = table.radiance(2000.0);
        assert!((red - Rgb::new(1711.0, 439.4, 13.9)).abs().max_element() < 2.0, "{red}");
        let day = table.radiance(6500.0);
        assert!((day / Rgb::new(4.6925e6, 4.4254e6, 4.6540e6) - 1.0).abs().max_element() < 2e-3, "{day}");
        let lamp = colour(2000.0);
        assert!((lamp - red * (3.0 / red.element_sum())).abs().max_element() < 1e-2, "{lamp}");
    }
}
