//! Numbers for the children of a node of the tree over emitters.

use std::ops::{Add, Div, Mul, Sub};

/// How many there are.
pub(super) const WIDTH: usize = 8;

/// Numbers side by side, each for a child of a node. Operations are loops of a fixed count, which become a few instructions
/// of whatever vectors there are.
#[derive(Clone, Copy, Debug)]
#[repr(align(32))]
pub(super) struct Lanes(pub [f32; WIDTH]);

impl Lanes {
    pub const ZERO: Lanes = Lanes([0.0; WIDTH]);

    #[inline(always)]
    pub fn all(x: f32) -> Self {
        Lanes([x; WIDTH])
    }

    #[inline(always)]
    fn zip(self, other: Lanes, f: impl Fn(f32, f32) -> f32) -> Self {
        let mut out = self;
        for lane in 0..WIDTH {
            out.0[lane] = f(self.0[lane], other.0[lane]);
        }
        out
    }

    #[inline(always)]
    pub fn max(self, other: Lanes) -> Self {
        self.zip(other, |a, b| if a > b { a } else { b })
    }

    #[inline(always)]
    pub fn min(self, other: Lanes) -> Self {
        self.zip(other, |a, b| if a < b { a } else { b })
    }

    #[inline(always)]
    pub fn sqrt(self) -> Self {
        self.zip(self, |a, _| a.sqrt())
    }

    /// `yes` where it is below `limit`, `no` elsewhere.
    #[inline(always)]
    pub fn below(self, limit: Lanes, yes: Lanes, no: Lanes) -> Self {
        let mut out = self;
        for lane in 0..WIDTH {
            out.0[lane] = if self.0[lane] < limit.0[lane] { yes.0[lane] } else { no.0[lane] };
        }
        out
    }
}

impl Add for Lanes {
    type Output = Lanes;
    #[inline(always)]
    fn add(self, other: Lanes) -> Lanes {
        self.zip(other, |a, b| a + b)
    }
}

impl Sub for Lanes {
    type Output = Lanes;
    #[inline(always)]
    fn sub(self, other: Lanes) -> Lanes {
        self.zip(other, |a, b| a - b)
    }
}

impl Mul for Lanes {
    type Output = Lanes;
    #[inline(always)]
    fn mul(self, other: Lanes) -> Lanes {
        self.zip(other, |a, b| a * b)
    }
}

impl Div for Lanes {
    type Output = Lanes;
    #[inline(always)]
    fn div(self, other: Lanes) -> Lanes {
        self.zip(other, |a, b| a / b)
    }
}
