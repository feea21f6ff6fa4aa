//! Measuring a render on its way: images at budgets, by a clock that stands while they are taken.

use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use super::machine::cpu_seconds;
use super::results::{BudgetKind, Budgets};
use crate::image::Image;
use crate::render::{Film, Progress, Stats};

/// The image at some time.
#[derive(Clone, Debug)]
pub struct Snapshot {
    pub image: Image,
    pub seconds: f64,
    pub cpu_seconds: Option<f64>,
    pub samples: u64,
    pub stats: Stats,
}

/// Takes snapshots of a render at budgets, and ends it after the last.
pub struct Meter<'a, P> {
    watch: &'a P,
    /// Ends the whole comparison.
    stop: &'a AtomicBool,
    /// Ends this render.
    halt: AtomicBool,
    budgets: &'a Budgets,
    /// Seconds after which the render ends anyhow.
    deadline: f64,
    start: Instant,
    /// Nanoseconds that the clock stood.
    paused: AtomicU64,
    state: Mutex<State>,
}

struct State {
    /// The images taken, by budget.
    taken: Vec<Option<Arc<Snapshot>>>,
    /// The budget that comes next.
    next: usize,
    /// The last image that may turn out to be the last within a budget.
    candidate: Option<Arc<Snapshot>>,
    cpu_start: Option<f64>,
    /// Seconds of all threads while the clock stood.
    cpu_paused: f64,
    /// When samples began.
    began: f64,
    /// When the last pass ended.
    pass: f64,
}

/// Samples that a round takes at most.
const ROUND: f64 = 16.0;
/// Rounds are made to end at this share of the time left until a budget, as times vary.
const SURE: f64 = 0.9;
/// For a budget of which no more than this share is left, no round is made shorter: short ones cost more.
const NEAR: f64 = 0.08;
/// A render that is expected to exceed its last budget by this share of what is under way goes on nevertheless.
const HOPE: f64 = 0.1;

impl<'a, P: Progress> Meter<'a, P> {
    /// A meter whose clock starts now.
    pub fn new(budgets: &'a Budgets, most: Option<f64>, watch: &'a P, stop: &'a AtomicBool) -> Self {
        let last = budgets.values.last().copied().unwrap_or(0.0);
        let deadline = match budgets.kind {
            BudgetKind::Seconds => last,
            BudgetKind::Samples => most.unwrap_or(f64::INFINITY),
        };
        let state = State {
            taken: vec![None; budgets.values.len()],
            next: 0,
            candidate: None,
            cpu_start: cpu_seconds(),
            cpu_paused: 0.0,
            began: 0.0,
            pass: 0.0,
        };
        Meter {
            watch,
            stop,
            halt: AtomicBool::new(stop.load(Ordering::Relaxed)),
            budgets,
            deadline,
            start: Instant::now(),
            paused: AtomicU64::new(0),
            state: Mutex::new(state),
        }
    }

    /// What ends the render.
    pub fn halt(&self) -> &AtomicBool {
        &self.halt
    }

    fn elapsed(&self) -> f64 {
        let paused = Duration::from_nanos(self.paused.load(Ordering::Relaxed));
        self.start.elapsed().saturating_sub(paused).as_secs_f64()
    }

    /// The images by budget, where there was one by then.
    pub fn finish(self) -> Vec<Option<Arc<Snapshot>>> {
        let mut state = self.state.into_inner().unwrap_or_else(|poisoned| poisoned.into_inner());
        let whole = !self.stop.load(Ordering::Relaxed);
        if whole && self.budgets.kind == BudgetKind::Seconds {
            // What is later is not within them.
            let State { taken, next, candidate, .. } = &mut state;
            taken[*next..].fill(candidate.clone());
        }
        state.taken
    }

    /// Takes what there is, if it may be the last image within the next budget. Returns whether nothing is left to
    /// be taken.
    fn take(&self, state: &mut State, now: f64, film: &Film, stats: &Stats) -> bool {
        let first = stats.passes == 0;
        let samples = if first { film.samples_in_pass() as u64 } else { stats.samples };
        let snapshot = |state: &State| {
            let cpu = cpu_seconds().zip(state.cpu_start).map(|(now, start)| now - start - state.cpu_paused);
            let mut stats = stats.clone();
            // The pass under way has not counted its own.
            stats.samples = samples;
            if first {
                stats.render_seconds = now - stats.photons_seconds - stats.build_seconds;
            }
            Some(Arc::new(Snapshot { image: film.image(), seconds: now, cpu_seconds: cpu, samples, stats }))
        };
        let values = &self.budgets.values;
        let reached = match self.budgets.kind {
            BudgetKind::Seconds => now,
            BudgetKind::Samples => samples as f64,
        };
        while state.next < values.len() && reached > values[state.next] {
            state.taken[state.next] = state.candidate.clone();
            state.next += 1;
        }
        let Some(&budget) = values.get(state.next) else { return true };
        match self.budgets.kind {
            BudgetKind::Samples => {
                if !first || reached == budget {
                    state.candidate = snapshot(state);
                }
                if reached == budget {
                    state.taken[state.next] = state.candidate.clone();
                    state.next += 1;
                }
                state.next == values.len()
            }
            BudgetKind::Seconds => {
                // What comes next takes this long: a round of samples, or a pass.
                let (most, least) = if first {
                    let sample = (now - state.began) / samples.max(1) as f64;
                    (ROUND * sample, sample)
                } else {
                    (now - state.pass, now - state.pass)
                };
                // It may take longer than what came before.
                if state.candidate.is_none() || now + 2.0 * most > budget {
                    state.candidate = snapshot(state);
                }
                now + (1.0 - HOPE) * least > values[values.len() - 1]
            }
        }
    }
}

impl<P: Progress> Progress for Meter<'_, P> {
    fn phase(&self, name: &'static str, steps: u64) {
        self.watch.phase(name, steps);
    }

    fn advance(&self, steps: u64) {
        self.watch.advance(steps);
        if self.stop.load(Ordering::Relaxed) || self.elapsed() > self.deadline {
            self.halt.store(true, Ordering::Relaxed);
        }
    }

    fn refined(&self, film: &Film, stats: &Stats) {
        let (now, pause, cpu) = (self.elapsed(), Instant::now(), cpu_seconds());
        let Ok(mut state) = self.state.lock() else { return };
        if self.take(&mut state, now, film, stats) {
            self.halt.store(true, Ordering::Relaxed);
        }
        if stats.passes > 0 {
            state.pass = now;
        }
        self.watch.refined(film, stats);
        state.cpu_paused += cpu_seconds().zip(cpu).map_or(0.0, |(now, before)| now - before);
        self.paused.fetch_add(pause.elapsed().as_nanos() as u64, Ordering::Relaxed);
    }

    fn round(&self, done: u32) -> u32 {
        let Ok(mut state) = self.state.lock() else { return 1 };
        let now = self.elapsed();
        if done == 0 {
            state.began = now;
        }
        let mut left = self.budgets.values[state.next..].iter().copied();
        let fits = match self.budgets.kind {
            BudgetKind::Samples => left.next().unwrap_or(0.0) - f64::from(done),
            BudgetKind::Seconds if done == 0 => 1.0,
            BudgetKind::Seconds => {
                let next = left.find(|budget| budget - now > NEAR * budget).unwrap_or(f64::INFINITY);
                SURE * (next - now) * f64::from(done) / (now - state.began).max(1e-9)
            }
        };
        fits.clamp(1.0, ROUND) as u32
    }
}
