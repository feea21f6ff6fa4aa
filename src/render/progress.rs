//! Who hears how far a render has come.

use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};

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

/// Tells a function how far a render has come: the phase, the steps of it that are done, and how many it has (0 if unknown). It is
/// called by all threads that render, often: it should return soon.
pub struct Callback<F> {
    tell: F,
    phase: Mutex<(&'static str, u64)>,
    done: AtomicU64,
}

impl<F: Fn(&str, u64, u64) + Sync> Callback<F> {
    /// Tells `tell`.
    pub fn new(tell: F) -> Callback<F> {
        Callback { tell, phase: Mutex::new(("", 0)), done: AtomicU64::new(0) }
    }

    fn now(&self) -> MutexGuard<'_, (&'static str, u64)> {
        self.phase.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl<F: Fn(&str, u64, u64) + Sync> Progress for Callback<F> {
    fn phase(&self, name: &'static str, steps: u64) {
        *self.now() = (name, steps);
        self.done.store(0, Ordering::Relaxed);
        (self.tell)(name, 0, steps);
    }

    fn advance(&self, steps: u64) {
        let done = self.done.fetch_add(steps, Ordering::Relaxed) + steps;
        let (name, all) = *self.now();
        (self.tell)(name, done, all);
    }
}

/// Nobody listens.
pub struct Silent;

impl Progress for Silent {
    fn phase(&self, _: &'static str, _: u64) {}
    fn advance(&self, _: u64) {}
}
