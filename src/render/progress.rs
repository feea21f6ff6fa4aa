//! Who hears how far a render has come.

use super::film::Film;
use super::stats::Stats;

/// Hears how far a render has come.
pub trait Progress: Sync {
    /// A phase begins, of so many steps (0 if unknown).
    fn phase(&self, name: &'static str, steps: u64);
    /// Steps were done.
    fn advance(&self, steps: u64);
    /// The image is better than before: a pass has ended, or a round of samples of the first one. Told by the
    /// thread that renders, which goes on when this returns.
    fn refined(&self, _film: &Film, _stats: &Stats) {}
    /// How many samples of each pixel the first pass should take until [`Progress::refined`] is told of them, where
    /// it has taken `done`. Fewer at a time take longer.
    fn round(&self, done: u32) -> u32 {
        if done == 0 { 1 } else { u32::MAX }
    }
}

impl<T: Progress + ?Sized> Progress for &T {
    fn phase(&self, name: &'static str, steps: u64) {
        (**self).phase(name, steps);
    }

    fn advance(&self, steps: u64) {
        (**self).advance(steps);
    }

    fn refined(&self, film: &Film, stats: &Stats) {
        (**self).refined(film, stats);
    }

    fn round(&self, done: u32) -> u32 {
        (**self).round(done)
    }
}

/// Nobody listens.
pub struct Silent;

impl Progress for Silent {
    fn phase(&self, _: &'static str, _: u64) {}
    fn advance(&self, _: u64) {}
}
