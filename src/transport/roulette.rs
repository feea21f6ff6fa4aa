use crate::math::{Rgb, Stream, shares};

/// Russian roulette against the factor by which an event scales a weight: survives with the factor's
/// mean over the channels' shares, and then keeps the weight's sum unchanged. Weights so stay bounded
/// along any path. Returns whether the walk goes on.
///
/// A factor above 1 on average is applied without roulette.
pub fn survive(weight: &mut Rgb, factor: Rgb, stream: &mut Stream) -> bool {
    let chance = (shares(*weight) * factor).element_sum();
    if chance.is_nan() || chance <= 0.0 {
        return false;
    }
    if chance >= 1.0 {
        *weight *= factor;
        return true;
    }
    *weight *= factor / chance;
    stream.uniform() < chance
}

/// Specular events in a row, after which walks are left to roulette.
const MANY: u32 = 1000;
/// The chance to go on at each of them.
const ONWARD: f64 = 0.99;

/// Roulette for walks that specular surfaces have turned so often in a row: clear glass may keep light by total
/// reflection without end. What comes out late carries the weight of what was ended.
pub fn endures(turns: u32, weight: &mut Rgb, stream: &mut Stream) -> bool {
    if turns <= MANY {
        return true;
    }
    *weight /= ONWARD;
    stream.uniform() < ONWARD
}
