//! A few photons that stand for many.

use crate::math::{DVec3, Rgb, Stream};

/// How many.
const FEW: usize = 8;

/// Photons drawn from all that are told, in proportion to their power, by reservoirs that are independent of each other (Chao 1982, "A
/// general purpose unequal probability sampling plan"): what surfaces send of them is, on average, what they send of all.
#[derive(Default)]
pub(super) struct Few {
    /// The sum of all powers.
    total: f64,
    /// Whence those that were drawn came, and their powers as shares of their sum over the channels.
    drawn: [(DVec3, Rgb); FEW],
}

impl Few {
    /// One more photon.
    #[inline]
    pub(super) fn tell(&mut self, stream: &mut Stream, from: DVec3, power: Rgb) {
        let weight = power.element_sum();
        if weight <= 0.0 {
            return;
        }
        self.total += weight;
        for drawn in &mut self.drawn {
            if stream.uniform() * self.total < weight {
                *drawn = (from, power / weight);
            }
        }
    }

    /// Those that were drawn, each with its part of all power.
    pub(super) fn drawn(&self) -> impl Iterator<Item = (DVec3, Rgb)> {
        let share = self.total / FEW as f64;
        self.drawn.iter().filter(move |_| share > 0.0).map(move |&(from, power)| (from, share * power))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::random::Purpose;

    /// The power of each photon is kept on average, and that of all together always.
    #[test]
    fn few_carry_the_power_of_all() {
        const RUNS: u32 = 20_000;
        let powers = [Rgb::new(1.0, 0.0, 0.0), Rgb::new(0.0, 4.0, 0.0), Rgb::ZERO, Rgb::new(0.5, 0.5, 2.0)];
        let mut found = [Rgb::ZERO; 4];
        for run in 0..RUNS {
            let mut stream = Stream::new(7, Purpose::Test, run.into(), 0);
            let mut few = Few::default();
            for (i, power) in powers.into_iter().enumerate() {
                few.tell(&mut stream, DVec3::new(i as f64, 0.0, 1.0), power);
            }
            let total: f64 = few.drawn().map(|(_, power)| power.element_sum()).sum();
            assert!((total - 8.0).abs() < 1e-12, "{total}");
            few.drawn().for_each(|(from, power)| found[from.x as usize] += power / f64::from(RUNS));
        }
        for (power, found) in powers.into_iter().zip(found) {
            // Shares p of all power are drawn binomially, 8 · 20 000 times.
            let share = power.element_sum() / 8.0;
            let error = (share * (1.0 - share) / (FEW as f64 * f64::from(RUNS))).sqrt() * 8.0;
            assert!((found.element_sum() - power.element_sum()).abs() <= 4.0 * error, "{found} of {power}");
        }
        assert!(Few::default().drawn().next().is_none());
    }
}
