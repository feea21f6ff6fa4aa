//! Light that is due to a pixel before it is known.

use super::Component;
use crate::gather::Gathered;
use crate::math::Rgb;
use crate::transport::Tally;

/// Samples of more radiance than this would leave the range of images, which are `f32`: dropped and counted.
pub const BRIGHTEST: f64 = 1e30;

/// What becomes of the light that a segment gathers. No path waits for it: it is added to the pixel when it is known.
#[derive(Clone, Copy, Debug)]
pub struct Claim {
    /// The pixel it is for.
    pub pixel: u32,
    /// The part of the light that the pixel gets.
    pub(super) weight: Rgb,
    /// Where light goes that was scattered once, and all other.
    pub(super) components: [Component; 2],
}

impl Claim {
    /// The radiance that is due, by component; none where it is beyond what images hold, which is counted.
    pub fn settle(&self, gathered: &Gathered, tally: &mut Tally) -> [(Component, Rgb); 2] {
        let (total, single) = gathered.rgb();
        let mut due = [self.weight * single, self.weight * (total - single)];
        check(&mut due, tally);
        [(self.components[0], due[0]), (self.components[1], due[1])]
    }
}

/// Drops radiance that is not finite or beyond what images hold.
pub(super) fn check(radiances: &mut [Rgb], tally: &mut Tally) {
    for radiance in radiances {
        if !radiance.is_finite() || radiance.max_element() > BRIGHTEST {
            tally.broken += 1;
            *radiance = Rgb::ZERO;
        }
    }
}
