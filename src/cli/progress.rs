//! Progress on stderr.

use std::sync::Mutex;

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

use crate::render::{Film, Progress, Stats};

/// A bar with phase, rate and time left; on a terminal that is not one, or when told to be quiet, nothing.
pub struct Bar {
    bar: Mutex<ProgressBar>,
    /// How far the passes are.
    passes: Mutex<String>,
    quiet: bool,
}

impl Bar {
    /// A bar that is not shown yet.
    pub fn new(quiet: bool) -> Self {
        Bar { bar: Mutex::new(ProgressBar::hidden()), passes: Mutex::default(), quiet }
    }

    /// Clears the line.
    pub fn finish(&self) {
        if let Ok(bar) = self.bar.lock() {
            bar.finish_and_clear();
        }
    }
}

impl Bar {
    /// A message beside the bar.
    pub fn say(&self, message: &str) {
        if self.quiet {
            return;
        }
        match self.bar.lock() {
            Ok(bar) => bar.suspend(|| super::tell(message)),
            Err(_) => super::tell(message),
        }
    }
}

impl Progress for Bar {
    fn phase(&self, name: &'static str, steps: u64) {
        let Ok(mut bar) = self.bar.lock() else { return };
        bar.finish_and_clear();
        if self.quiet {
            return;
        }
        *bar = if steps == 0 { ProgressBar::new_spinner() } else { ProgressBar::new(steps) };
        bar.set_draw_target(ProgressDrawTarget::stderr_with_hz(8));
        let template = if steps == 0 {
            "{prefix:>8} {spinner} {elapsed}  {msg}"
        } else {
            "{prefix:>8} [{bar:40}] {percent:>3} %  {human_pos}/{human_len}  {per_sec}  {eta} left  {msg}"
        };
        if let Ok(style) = ProgressStyle::with_template(template) {
            bar.set_style(style.progress_chars("=> "));
        }
        bar.set_prefix(name);
        if let Ok(passes) = self.passes.lock() {
            bar.set_message(passes.clone());
        }
        bar.tick();
    }

    fn advance(&self, steps: u64) {
        if let Ok(bar) = self.bar.lock() {
            bar.inc(steps);
        }
    }

    fn refined(&self, _: &Film, stats: &Stats) {
        if stats.passes == 0 {
            return;
        }
        let error = stats.error.map_or(String::new(), |error| format!(", standard error {:.2} %", 100.0 * error));
        if let Ok(mut passes) = self.passes.lock() {
            *passes = format!("pass {}{error}", stats.passes + 1);
        }
    }
}
