//! What tracing photons may cost. Events are counted, whoever traces them; the clock is never asked. So a pass that is refused is
//! refused wherever it is made.

use std::sync::atomic::{AtomicU64, Ordering};

use crate::{Error, Result};

/// Events of all pilots of a map together, at most.
const MOST_OF_PILOTS: u64 = 400_000_000;
/// Events of a pass, at most,
const MOST_EVENTS: u64 = 2_000_000_000;
/// or so many for each photon that is wanted.
const MOST_EACH: u64 = 1_000;
/// A map that was to hold some photons holds no more than so many times as many,
const MOST_TIMES: u64 = 16;
/// and as many as these.
const MOST_MORE: u64 = 1 << 22;
/// Whoever traces tells of so many events at a time.
const SETTLED: u64 = 1 << 14;
/// No more emissions than so many tell how long walks are,
const FIRST: u64 = 32;
/// and fewer where they take so many events: those are very long.
const LONG_FIRST: u64 = 1_000_000;
/// Where a pilot would take more events than this, it is of fewer emissions:
const LONG_PILOT: f64 = 1e7;
/// so many events are enough for it.
const ENOUGH_FOR_PILOT: f64 = 2e6;
/// Emissions of a pass for the sake of their number take no more events than this,
const LONG_PASS: f64 = 3e7;
/// but are no fewer than these.
const FEWEST: u64 = 30;

/// A budget of events, and of photons kept.
#[derive(Debug)]
pub(super) struct Budget {
    events: AtomicU64,
    photons: AtomicU64,
    most: [u64; 2],
}

/// What one task has spent, as far as it has not told.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Bill {
    events: u64,
    photons: u64,
}

impl Budget {
    /// For pilots.
    pub fn of_pilots() -> Self {
        Self::new([MOST_OF_PILOTS, u64::MAX])
    }

    /// For a pass that wants so many photons.
    pub fn of_pass(target: u64) -> Self {
        let photons = target.saturating_mul(MOST_TIMES).saturating_add(MOST_MORE);
        Self::new([MOST_EVENTS.max(target.saturating_mul(MOST_EACH)), photons])
    }

    fn new(most: [u64; 2]) -> Self {
        Budget { events: AtomicU64::new(0), photons: AtomicU64::new(0), most }
    }

    /// Events told so far.
    pub fn events(&self) -> u64 {
        self.events.load(Ordering::Relaxed)
    }

    /// How many events an emission has, about: `trace` is told how many to trace.
    pub fn events_of_each(&self, mut trace: impl FnMut(u64)) -> f64 {
        let (mut count, before) = (1, self.events());
        loop {
            let from = self.events();
            trace(count);
            let events = self.events() - from;
            if count >= FIRST || events + from - before >= LONG_FIRST || self.is_spent() {
                return events as f64 / count as f64;
            }
            count *= 2;
        }
    }

    /// Whether more was spent than there is. All that is told adds up to the same in any order, so that this is so in the end or is not,
    /// whoever is first.
    pub fn is_spent(&self) -> bool {
        self.events() > self.most[0] || self.photons.load(Ordering::Relaxed) > self.most[1]
    }

    /// Refuses a pass of which so many photons, of `each` events, are to be emitted.
    pub fn allow(&self, emitted: u64, each: f64) -> Result<()> {
        if emitted as f64 * each <= self.most[0] as f64 {
            return Ok(());
        }
        Err(Error::Limit(format!(
            "light in this scene ends too seldom: a photon has {each:.0} events on average before it escapes or is absorbed, and {emitted} photons would take more than {:e}; open the scene, lower a reflectance or an albedo, ask for fewer photons, or limit render.max_depth",
            self.most[0]
        )))
    }

    /// Refuses what has overspent.
    pub fn settle(&self) -> Result<()> {
        if self.events() > self.most[0] {
            return Err(Error::Limit(format!(
                "light in this scene ends too seldom: after {:e} events photons have neither escaped nor been absorbed; open the scene, lower a reflectance or an albedo, or limit render.max_depth",
                self.most[0]
            )));
        }
        if self.is_spent() {
            return Err(Error::Limit(format!(
                "a few photons in this scene collide far more often than most, and leave more than {} in a map that was to hold fewer: open the scene, lower an albedo, or limit render.max_depth",
                self.most[1]
            )));
        }
        Ok(())
    }
}

impl Bill {
    /// One more event, after which this many photons are kept by the task.
    #[inline]
    pub fn add(&mut self, budget: &Budget, kept: usize) {
        self.events += 1;
        if self.events >= SETTLED {
            self.settle(budget, kept);
        }
    }

    /// Tells the budget.
    pub fn settle(&mut self, budget: &Budget, kept: usize) {
        budget.events.fetch_add(std::mem::take(&mut self.events), Ordering::Relaxed);
        let kept = kept as u64;
        budget.photons.fetch_add(kept - self.photons, Ordering::Relaxed);
        self.photons = kept;
    }
}

/// How many emissions a pilot makes that would make so many, where each has `each` events.
pub(super) fn pilot(emissions: u64, each: f64) -> u64 {
    if each * emissions as f64 <= LONG_PILOT { emissions } else { ((ENOUGH_FOR_PILOT / each) as u64).max(1) }
}

/// How many a pass makes at least that would make so many for the sake of their number alone.
pub(super) fn fewest(emissions: u64, each: f64) -> u64 {
    if each * emissions as f64 <= LONG_PASS { emissions } else { ((LONG_PASS / each) as u64).max(FEWEST) }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The longer walks are, the fewer there are, and the more there is to a pass the more it may take; what is too much is refused,
    /// however many told of it.
    #[test]
    fn long_walks_take_bounded_work() {
        assert_eq!((pilot(4096, 1000.0), fewest(10_000, 1000.0)), (4096, 10_000));
        assert_eq!((pilot(4096, 1e5), fewest(10_000, 1e5)), (20, 300));
        assert_eq!((pilot(4096, 1e8), fewest(10_000, 1e8)), (1, 30));

        let budget = Budget::of_pass(10);
        assert!(budget.allow(30, 1e6).is_ok() && budget.allow(10_000, 1e6).is_err());
        assert!(Budget::of_pass(100_000_000).allow(10_000, 1e6).is_ok());
        let mut bills = [Bill::default(); 3];
        for index in 0..10 * SETTLED as usize {
            bills[index % 3].add(&budget, 0);
        }
        bills.iter_mut().for_each(|bill| bill.settle(&budget, 1_000_000));
        assert_eq!(budget.events(), 10 * SETTLED);
        assert!(budget.settle().is_ok());
        bills.iter_mut().for_each(|bill| bill.settle(&budget, 2_000_000));
        let refused = budget.settle().expect_err("it kept six million where ten were wanted");
        assert!(refused.to_string().contains("far more often"), "{refused}");

        // Emissions of 10⁶ events each are tried once, those of one event until there are enough.
        for (each, tried) in [(LONG_FIRST, 1), (1, 2 * FIRST - 1)] {
            let (budget, mut emitted) = (Budget::of_pilots(), 0);
            let found = budget.events_of_each(|count| {
                emitted += count;
                let mut bill = Bill { events: count * each, photons: 0 };
                bill.settle(&budget, 0);
            });
            assert_eq!((found, emitted), (each as f64, tried));
        }
    }
}
