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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::random::Purpose;

    /// Light that total reflection keeps in a solid of clear glass for thousands of turns, some of which would come out at
    /// each: as much comes out, and walks come to an end though none would.
    #[test]
    fn kept_light_ends_and_none_is_lost() {
        const WALKS: u64 = 20_000;
        // Of what walks past roulette's beginning, a fiftieth comes out at each turn.
        const OUT: f64 = 0.02;
        let (mut out, mut squares) = (0.0, 0.0);
        for walk in 0..WALKS {
            let mut stream = Stream::new(7, Purpose::Test, walk, 0);
            let (mut weight, mut turns, mut found) = (Rgb::ONE, 0, 0.0);
            while endures(turns, &mut weight, &mut stream) {
                assert!(turns < 10_000, "a walk goes on");
                if turns > MANY {
                    found += OUT * (1.0 - OUT).powi((turns - MANY - 1) as i32) * weight.y;
                } else {
                    assert_eq!(weight, Rgb::ONE);
                }
                turns += 1;
            }
            out += found;
            squares += found * found;
        }
        let n = WALKS as f64;
        let (mean, error) = (out / n, (squares / n - (out / n).powi(2)).sqrt() / n.sqrt());
        assert!(error < 0.01 && (mean - 1.0).abs() < 4.0 * error, "{mean} ± {error} comes out");
    }
}
