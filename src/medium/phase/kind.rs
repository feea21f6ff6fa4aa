//! What every kind of phase function answers, what it is asked with, and the arithmetic its form is written in.

use crate::math::{DVec3, Stream};

/// What every kind of phase function answers.
pub(super) trait Kind {
    /// Its value per steradian for light deflected so.
    fn at(&self, deflection: Deflection) -> f64;

    /// A deflection drawn from it, for `u` in [0, 1); more numbers come from the stream.
    fn deflect(&self, u: f64, stream: &mut Stream) -> Deflection;

    /// The mean cosine of the deflection.
    fn mean_cosine(&self) -> f64;
}

/// The cosine of a scattering angle with its distances to both ends, none of which cancels.
#[derive(Clone, Copy, Debug)]
pub(super) struct Deflection {
    /// The cosine of the angle, cos θ; forward +1.
    pub(super) cos: f64,
    /// Its distance to +1, 1 − cos θ.
    pub(super) below_one: f64,
    /// Its distance to −1, 1 + cos θ.
    pub(super) above_minus_one: f64,
}

impl Deflection {
    /// Between two unit directions of travel.
    pub(super) fn between(before: DVec3, after: DVec3) -> Self {
        let cos = before.dot(after);
        if cos >= 0.0 {
            let v = 0.5 * (after - before).length_squared();
            Deflection { cos: 1.0 - v, below_one: v, above_minus_one: 2.0 - v }
        } else {
            let v = 0.5 * (after + before).length_squared();
            Deflection { cos: v - 1.0, below_one: 2.0 - v, above_minus_one: v }
        }
    }

    /// From 1 − cos θ and 1 + cos θ.
    pub(super) fn from_ends(below_one: f64, above_minus_one: f64) -> Self {
        let cos = if below_one < above_minus_one { 1.0 - below_one } else { above_minus_one - 1.0 };
        Deflection { cos, below_one, above_minus_one }
    }

    /// The angle measured from the opposite direction.
    pub(super) fn mirrored(self) -> Self {
        Deflection { cos: -self.cos, below_one: self.above_minus_one, above_minus_one: self.below_one }
    }
}

/// The narrowest lobe that terms tell apart, by its |g|: far narrower than any direction in `f32` can tell.
pub(super) const NARROWEST: f64 = 1.0 - 1e-12;

/// The arithmetic that terms are written in: of one number, or of a block's photons side by side.
pub(crate) trait Arithmetic: Copy {
    /// One number, side by side as often as there is room.
    fn splat(x: f32) -> Self;
    /// `self − b`
    fn sub(self, b: Self) -> Self;
    /// `self · b`
    fn mul(self, b: Self) -> Self;
    /// `self · b + c`
    fn mul_add(self, b: Self, c: Self) -> Self;
    /// 1/√self
    fn rsqrt(self) -> Self;
    /// The lesser of both.
    fn min(self, b: Self) -> Self;
    /// The greater of both.
    fn max(self, b: Self) -> Self;
}
