//! When a render is to stop for want of time.

use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::{Duration, Instant};

/// However short the limit of time, a first image may take so long for its photons.
const FIRST_PHOTONS: Duration = Duration::from_secs(1);
/// After its photons, a first image may take as long as the limit of time, or so long where that is shorter, for its first
/// sample of each pixel.
const FIRST_SAMPLES: Duration = Duration::from_secs(3);

/// A pass that was expected to end in time may exceed the limit of time by this share of it.
const OVERTIME: f64 = 0.05;

/// When to stop. Whoever asks may share it with who tells how far things are.
pub(super) struct Clock {
    start: Instant,
    limit: Option<Duration>,
    image: AtomicBool,
    /// Nanoseconds that the last pass took.
    pass: AtomicU64,
    /// Nanoseconds from the start until the last pass came to its samples.
    samples: AtomicU64,
}

impl Clock {
    pub(super) fn new(limit: Option<Duration>, image: bool) -> Self {
        let image = AtomicBool::new(image);
        Clock { start: Instant::now(), limit, image, pass: AtomicU64::new(0), samples: AtomicU64::new(0) }
    }

    /// Whether there is an image to show, so that what is under way may be given up.
    pub(super) fn has_image(&self) -> bool {
        self.image.load(Ordering::Relaxed)
    }

    /// From now on there is an image.
    pub(super) fn shows_image(&self) {
        self.image.store(true, Ordering::Relaxed);
    }

    /// A pass has come to its end, after so long.
    pub(super) fn end_pass(&self, took: Duration) {
        self.pass.store(took.as_nanos() as u64, Ordering::Relaxed);
        self.shows_image();
    }

    /// A pass has come to its samples.
    pub(super) fn begin_samples(&self) {
        self.samples.store(self.start.elapsed().as_nanos() as u64, Ordering::Relaxed);
    }

    /// How long the last pass took.
    fn pass(&self) -> Duration {
        Duration::from_nanos(self.pass.load(Ordering::Relaxed))
    }

    /// How long ago the last pass came to its samples.
    fn sampling(&self) -> Duration {
        self.start.elapsed().saturating_sub(Duration::from_nanos(self.samples.load(Ordering::Relaxed)))
    }

    /// Whether a pass that takes as long as the one before would end in time.
    pub(super) fn allows_a_pass(&self) -> bool {
        self.limit.is_none_or(|limit| self.start.elapsed() + self.pass() <= limit)
    }

    /// Whether to trace no more photons.
    pub(super) fn ends_photons(&self) -> bool {
        self.limit.is_some_and(|limit| {
            let end = if self.has_image() { limit.mul_f64(1.0 + OVERTIME) } else { limit.max(FIRST_PHOTONS) };
            self.start.elapsed() >= end
        })
    }

    /// Whether to take no more samples.
    pub(super) fn ends_samples(&self) -> bool {
        self.limit.is_some_and(|limit| match (self.has_image(), self.pass().is_zero()) {
            (true, true) => self.start.elapsed() >= limit,
            (true, false) => self.start.elapsed() >= limit.mul_f64(1.0 + OVERTIME),
            (false, _) => self.start.elapsed() >= limit && self.sampling() >= limit.max(FIRST_SAMPLES),
        })
    }
}
