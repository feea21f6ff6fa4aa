//! When a part of a check is to end: its time is up, or the user says so. Time is that of all threads together, so that a busy machine
//! takes longer, and tells no less.

use std::sync::LazyLock;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

use crate::compare::cpu_seconds;
use crate::{Error, Result};

/// Seconds that all threads of the program have computed; where that is not known, seconds since this was first asked.
pub fn seconds_of_threads() -> f64 {
    static START: LazyLock<Instant> = LazyLock::new(Instant::now);
    cpu_seconds().unwrap_or_else(|| START.elapsed().as_secs_f64())
}

/// Ends what runs by setting a flag.
pub struct Halt<'a> {
    /// The user's wish, which ends all.
    stop: &'a AtomicBool,
    /// What renders look at.
    flag: AtomicBool,
    /// Seconds of threads until then.
    until: Mutex<f64>,
    is_done: AtomicBool,
}

/// How often the clock is looked at.
const BEAT: Duration = Duration::from_millis(20);

impl<'a> Halt<'a> {
    /// Runs `work` beside a clock.
    pub fn with<T>(stop: &'a AtomicBool, work: impl FnOnce(&Halt<'a>) -> T) -> T {
        let halt = Halt {
            stop,
            flag: AtomicBool::new(false),
            until: Mutex::new(f64::INFINITY),
            is_done: AtomicBool::new(false),
        };
        std::thread::scope(|scope| {
            scope.spawn(|| {
                while !halt.is_done.load(Ordering::Relaxed) {
                    if halt.stop.load(Ordering::Relaxed) || seconds_of_threads() >= halt.end() {
                        halt.flag.store(true, Ordering::Relaxed);
                    }
                    std::thread::sleep(BEAT);
                }
            });
            let done = Done(&halt.is_done);
            let found = work(&halt);
            drop(done);
            found
        })
    }

    fn end(&self) -> f64 {
        *self.until.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Allows what comes next so many seconds.
    pub fn allow(&self, seconds: f64) {
        *self.until.lock().unwrap_or_else(PoisonError::into_inner) = seconds_of_threads() + seconds;
        self.flag.store(self.stop.load(Ordering::Relaxed), Ordering::Relaxed);
    }

    /// What renders look at.
    pub fn flag(&self) -> &AtomicBool {
        &self.flag
    }

    /// Whether what runs is to end.
    pub fn is_over(&self) -> bool {
        self.flag.load(Ordering::Relaxed)
    }

    /// Whether the user wants no more.
    ///
    /// # Errors
    /// [`Error::Interrupted`] then.
    pub fn go_on(&self) -> Result<()> {
        if self.stop.load(Ordering::Relaxed) { Err(Error::Interrupted) } else { Ok(()) }
    }
}

/// Ends the clock, also where the work panics.
struct Done<'d>(&'d AtomicBool);

impl Drop for Done<'_> {
    fn drop(&mut self) {
        self.0.store(true, Ordering::Relaxed);
    }
}
