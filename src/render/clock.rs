//! When a render is to stop for want of time.

use std::time::{Duration, Instant};

/// However short the limit of time, a first image may take so long for its photons.
const FIRST_PHOTONS: Duration = Duration::from_secs(1);
/// After its photons, a first image may take as long as the limit of time, or so long where that is shorter, for its first
/// sample of each pixel.
const FIRST_SAMPLES: Duration = Duration::from_secs(3);

/// A pass that was expected to end in time may exceed the limit of time by this share of it.
const OVERTIME: f64 = 0.05;

/// When to stop.
pub(super) struct Clock {
    start: Instant,
    limit: Option<Duration>,
    /// Whether there is an image to show, so that what is under way may be given up.
    pub image: bool,
    /// How long the last pass took.
    pub pass: Duration,
    /// When the last pass came to its samples.
    pub samples: Instant,
}

impl Clock {
    pub(super) fn new(limit: Option<Duration>, image: bool) -> Self {
        let start = Instant::now();
        Clock { start, limit, image, pass: Duration::ZERO, samples: start }
    }

    /// Whether a pass that takes as long as the one before would end in time.
    pub(super) fn allows_a_pass(&self) -> bool {
        self.limit.is_none_or(|limit| self.start.elapsed() + self.pass <= limit)
    }

    /// Whether to trace no more photons.
    pub(super) fn ends_photons(&self) -> bool {
        self.limit.is_some_and(|limit| {
            let end = if self.image { limit.mul_f64(1.0 + OVERTIME) } else { limit.max(FIRST_PHOTONS) };
            self.start.elapsed() >= end
        })
    }

    /// Whether to take no more samples.
    pub(super) fn ends_samples(&self) -> bool {
        self.limit.is_some_and(|limit| match (self.image, self.pass.is_zero()) {
            (true, true) => self.start.elapsed() >= limit,
            (true, false) => self.start.elapsed() >= limit.mul_f64(1.0 + OVERTIME),
            (false, _) => self.start.elapsed() >= limit && self.samples.elapsed() >= limit.max(FIRST_SAMPLES),
        })
    }
}
