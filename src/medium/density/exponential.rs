//! An atmosphere.

use crate::math::{DAffine3, DVec3, Ray, one_minus_exp_over};

/// An atmosphere: with h = (x − origin)·up, `value` e^{−h/scale_height} above the origin and `value` below.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Exponential {
    /// A point of height h = 0.
    pub origin: DVec3,
    /// The direction the density falls in, not 0; h is what its length makes of it.
    pub up: DVec3,
    /// The height over which it falls to 1/e, above 0.
    pub scale_height: f64,
    /// The density at and below height 0.
    pub value: f64,
}

/// Above this many scale heights e^{−h} is 0 for every purpose.
const FAR: f64 = 700.0;

impl Exponential {
    /// Carried along by a transform of the scene.
    pub fn moved(&self, transform: DAffine3) -> Self {
        // h = (x − origin)·up with x taken back to the coordinates before.
        let back = transform.inverse();
        let (origin, up) = (transform.transform_point3(self.origin), back.matrix3.transpose() * self.up);
        Exponential { origin, up, ..*self }
    }

    /// The density at the point `p`.
    pub fn at(&self, p: DVec3) -> f64 {
        self.value * (-self.height(p).max(0.0)).exp()
    }

    /// The length over which it is nearly linear, an eighth of its scale height: between the two ends linear
    /// interpolation is off by 1/512 of the density at most.
    pub(super) fn feature_length(&self) -> f64 {
        self.scale_height / 8.0
    }

    /// The height of `p` over the origin, in scale heights.
    fn height(&self, p: DVec3) -> f64 {
        (p - self.origin).dot(self.up) / self.scale_height
    }

    /// Splits `[t0, t1]` where the ray crosses heights 0 and `FAR`; visits the pieces in order with the
    /// heights at their ends, until told to stop.
    fn pieces(&self, ray: &Ray, t0: f64, t1: f64, mut visit: impl FnMut(f64, f64, f64, f64) -> bool) {
        // Heights along the ray, in scale heights.
        let rise = ray.direction.dot(self.up) / self.scale_height;
        let h = self.height(ray.origin);
        let at = |t: f64| if rise == 0.0 { h } else { h + rise * t };
        // Where it crosses from one layer into the next.
        let mut cuts = [t0, t0, t0, t1];
        // Between which heights each piece lies, whatever rounding makes of its ends.
        let mut layers = [(f64::NEG_INFINITY, f64::INFINITY); 3];
        if rise != 0.0 {
            let (a, b) = (-h / rise, (FAR - h) / rise);
            cuts[1] = a.min(b).clamp(t0, t1);
            cuts[2] = a.max(b).clamp(t0, t1);
            layers = [(f64::NEG_INFINITY, 0.0), (0.0, FAR), (FAR, f64::INFINITY)];
            if rise < 0.0 {
                layers.reverse();
            }
        }
        for (pair, (low, high)) in cuts.windows(2).zip(layers) {
            let height = |t: f64| at(t).clamp(low, high);
            if pair[0] < pair[1] && !visit(pair[0], pair[1], height(pair[0]), height(pair[1])) {
                return;
            }
        }
    }

    /// ∫ρ over a piece that lies wholly below 0 or above it.
    fn piece_depth(&self, length: f64, h0: f64, h1: f64) -> f64 {
        let low = h0.min(h1).max(0.0);
        if low >= FAR {
            return 0.0;
        }
        let climb = (h1.max(h0).max(0.0)) - low;
        let density = self.value * (-low).exp();
        if length.is_infinite() {
            // Level or below: one that climbs was cut at `FAR`.
            return if density > 0.0 { f64::INFINITY } else { 0.0 };
        }
        density * length * one_minus_exp_over(climb)
    }

    /// ∫ρ dt between two parameters of the ray; `t1` may be infinite.
    pub fn depth(&self, ray: &Ray, t0: f64, t1: f64) -> f64 {
        let mut depth = 0.0;
        self.pieces(ray, t0, t1, |a, b, ha, hb| {
            depth += self.piece_depth(b - a, ha, hb);
            true
        });
        depth
    }

    /// Where between `t0` and `t1` the depth since `t0` reaches `target`.
    pub fn advance(&self, ray: &Ray, t0: f64, t1: f64, target: f64) -> Option<f64> {
        let rise = ray.direction.dot(self.up) / self.scale_height;
        let mut left = target;
        let mut found = None;
        self.pieces(ray, t0, t1, |a, b, ha, hb| {
            let depth = self.piece_depth(b - a, ha, hb);
            if left > depth || depth == 0.0 {
                left -= depth;
                return true;
            }
            // In this piece: the exponential's integral, inverted.
            let low = ha.min(hb).max(0.0);
            let climb = ha.max(hb).max(0.0) - low;
            let t = if climb == 0.0 {
                a + left / (self.value * (-low).exp())
            } else if rise > 0.0 {
                // left = ρ(a)/rise · (1 − e^{−rise s})
                a - (-(left * rise / (self.value * (-ha).exp())).min(1.0)).ln_1p() / rise
            } else {
                // From the dense end: depth − left = ρ(b)/|rise| · (1 − e^{−|rise| s}).
                b - (-((depth - left) * -rise / (self.value * (-hb).exp())).min(1.0)).ln_1p() / rise
            };
            found = Some(t.clamp(a, b));
            false
        });
        found
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn depth_is_the_integral_and_advance_its_inverse() {
        let air = Exponential { origin: DVec3::new(1.0, 2.0, 3.0), up: DVec3::Y, scale_height: 0.7, value: 1.3 };
        for (direction, t0, t1) in [
            (DVec3::new(0.6, 0.8, 0.0), 0.0, 9.0),
            (DVec3::new(0.6, -0.8, 0.0), 0.0, 9.0),
            (DVec3::new(1.0, 0.0, 0.0), 1.0, 4.0),
            (DVec3::new(1.0, 1e-9, 0.0), 1.0, 4.0),
            (DVec3::new(0.0, -1.0, 0.0), 0.0, 2.0),
            (DVec3::new(0.0, 1.0, 0.0), 0.0, 3000.0),
        ] {
            let ray = Ray::new(DVec3::new(-1.0, 4.0, 0.5), direction.normalize());
            let depth = air.depth(&ray, t0, t1);
            let n = 2_000_000;
            let step = (t1 - t0) / n as f64;
            let sum: f64 = (0..n).map(|i| air.at(ray.at(t0 + (i as f64 + 0.5) * step)) * step).sum();
            assert!((depth - sum).abs() < 1e-5 * sum, "{direction}: {depth} against {sum}");
            for share in [1e-9, 0.1, 0.5, 0.999] {
                let t = air.advance(&ray, t0, t1, share * depth).expect("within the range");
                let reached = air.depth(&ray, t0, t);
                assert!(
                    (reached - share * depth).abs() < 1e-9 * depth,
                    "{direction}: {share} gives {}",
                    reached / depth
                );
            }
            assert!(air.advance(&ray, t0, t1, depth * 1.001).is_none());
        }
    }

    #[test]
    fn half_lines_that_climb_have_an_end_to_their_depth() {
        use crate::math::random::{Purpose, Stream};
        let air = Exponential { origin: DVec3::ZERO, up: DVec3::Y, scale_height: 1.0, value: 1.0 };
        for index in 0..20_000 {
            let mut stream = Stream::new(1, Purpose::Test, index, 0);
            let direction = crate::math::sampling::sphere(stream.uniform2()).normalize();
            let height = 10.0 * (stream.uniform() - 0.5);
            let ray = Ray::new(DVec3::new(0.0, height, 0.0), direction);
            let depth = air.depth(&ray, 0.0, f64::INFINITY);
            let expected = if direction.y <= 0.0 {
                f64::INFINITY
            } else {
                ((-height).max(0.0) + (-height.max(0.0)).exp()) / direction.y
            };
            assert!(
                depth == expected || (depth - expected).abs() < 1e-9 * expected,
                "{ray:?}: {depth}, not {expected}"
            );
            let target = stream.exponential() / 0.1;
            let reached = air.advance(&ray, 0.0, f64::INFINITY, target);
            assert_eq!(
                reached.is_some_and(f64::is_finite),
                target <= depth,
                "{ray:?}: {target} of {depth} at {reached:?}"
            );
        }
    }

    #[test]
    fn whole_half_lines_have_their_closed_form() {
        let air = Exponential { origin: DVec3::ZERO, up: DVec3::Y, scale_height: 2.0, value: 0.5 };
        let up = Ray::new(DVec3::new(0.0, 1.0, 0.0), DVec3::new(0.0, 0.5, 0.75f64.sqrt()));
        let expected = 0.5 * (-0.5f64).exp() * 2.0 / 0.5;
        assert!((air.depth(&up, 0.0, f64::INFINITY) - expected).abs() < 1e-12);
        let level = Ray::new(DVec3::ZERO, DVec3::X);
        assert_eq!(air.depth(&level, 0.0, f64::INFINITY), f64::INFINITY);
        let down = Ray::new(DVec3::new(0.0, 5000.0, 0.0), DVec3::NEG_Y);
        assert_eq!(air.depth(&down, 0.0, f64::INFINITY), f64::INFINITY);
        assert!(air.advance(&down, 0.0, f64::INFINITY, 3.0).is_some_and(|t| (t - 5004.0).abs() < 1e-9));
    }
}
