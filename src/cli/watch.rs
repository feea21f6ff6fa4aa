//! What follows a render: the progress, and the files and viewers that show how far it came.

use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::time::{Duration, Instant};

use super::progress::Bar;
#[cfg(feature = "tev")]
use super::tev::Viewer;
use crate::Result;
use crate::image::{self, ToneSettings};
use crate::render::checkpoint::{self, Subject};
use crate::render::{Checkpoint, Film, Progress, Stats};

/// Between two pictures.
const PICTURES: Duration = Duration::from_secs(1);
/// Nothing takes more than one part in so many of the time.
const SHARE: u32 = 20;

/// Something to be done again and again.
struct Repeated<T> {
    what: T,
    least: Duration,
    next: Instant,
    failed: bool,
}

impl<T> Repeated<T> {
    fn new(what: T, least: Duration) -> Self {
        Repeated { what, least, next: Instant::now() + least, failed: false }
    }

    /// Does it if it is time. A failure costs no render: it is shown once.
    fn due(&mut self, bar: &Bar, work: impl FnOnce(&mut T) -> Result<()>) {
        let start = Instant::now();
        if start < self.next {
            return;
        }
        if let Err(error) = work(&mut self.what)
            && !std::mem::replace(&mut self.failed, true)
        {
            bar.say(&format!("warning: {error}; the render goes on"));
        }
        self.next = Instant::now() + self.least.max(SHARE * start.elapsed());
    }
}

/// Shows progress, and keeps checkpoint, preview and viewer up to date.
pub struct Watch {
    bar: Bar,
    outputs: Mutex<Outputs>,
}

/// A checkpoint that is kept up to date.
pub struct Kept {
    pub path: PathBuf,
    pub subject: Subject,
    /// Whether another program may fill the same file, which must not lose passes by that.
    pub shared: bool,
}

impl Kept {
    fn write(&self, film: &Film, stats: &Stats) -> Result<()> {
        if self.shared && holds(&self.path, film) {
            return Ok(());
        }
        checkpoint::write(&self.path, &self.subject, film, stats)
    }
}

/// Whether there is a checkpoint at `path` with all finished passes of a film.
fn holds(path: &Path, film: &Film) -> bool {
    Checkpoint::read(path).is_ok_and(|there| {
        let mut passes = film.done().ranges();
        passes.all(|(seed, (first, last))| there.film.done().missing(seed, first..=last).next().is_none())
    })
}

struct Outputs {
    tone: ToneSettings,
    checkpoint: Option<Repeated<Kept>>,
    preview: Option<Repeated<PathBuf>>,
    #[cfg(feature = "tev")]
    viewer: Option<Repeated<Viewer>>,
}

impl Watch {
    /// A bar and nothing else.
    pub fn new(bar: Bar, tone: ToneSettings) -> Self {
        let outputs = Outputs {
            tone,
            checkpoint: None,
            preview: None,
            #[cfg(feature = "tev")]
            viewer: None,
        };
        Watch { bar, outputs: Mutex::new(outputs) }
    }

    fn outputs(&mut self) -> &mut Outputs {
        self.outputs.get_mut().unwrap_or_else(|poisoned| poisoned.into_inner())
    }

    /// Writes checkpoints, so far apart at least.
    pub fn checkpoint(&mut self, kept: Kept, apart: Duration) {
        self.outputs().checkpoint = Some(Repeated::new(kept, apart));
    }

    /// Writes pictures to `path`.
    pub fn preview(&mut self, path: PathBuf) {
        self.outputs().preview = Some(Repeated::new(path, PICTURES));
    }

    /// Sends images to a viewer.
    #[cfg(feature = "tev")]
    pub fn viewer(&mut self, viewer: Viewer) {
        self.outputs().viewer = Some(Repeated::new(viewer, PICTURES));
    }

    /// Clears the progress and writes everything a last time: whether checkpoints could be. A preview that cannot costs no render.
    pub fn finish(self, film: &Film, stats: &Stats) -> Vec<Result<()>> {
        self.bar.finish();
        let outputs = self.outputs.into_inner().unwrap_or_else(|poisoned| poisoned.into_inner());
        let mut written = Vec::new();
        if let Some(Repeated { what: kept, .. }) = outputs.checkpoint
            && film.done().count() > 0
        {
            written.push(kept.write(film, stats));
        }
        if let Some(preview) = outputs.preview
            && film.has_samples()
            && let Err(error) = image::write(preview.what, &film.image().into(), &outputs.tone)
        {
            self.bar.say(&format!("warning: {error}"));
        }
        #[cfg(feature = "tev")]
        if let Some(mut viewer) = outputs.viewer
            && film.has_samples()
        {
            // A viewer that was closed has seen enough.
            let _ = viewer.what.show(&film.image());
        }
        written
    }
}

impl Progress for Watch {
    fn phase(&self, name: &'static str, steps: u64) {
        self.bar.phase(name, steps);
    }

    fn advance(&self, steps: u64) {
        self.bar.advance(steps);
    }

    fn refined(&self, film: &Film, stats: &Stats) {
        self.bar.refined(film, stats);
        let Ok(mut outputs) = self.outputs.lock() else { return };
        let Outputs { tone, checkpoint, preview, .. } = &mut *outputs;
        if let Some(checkpoint) = checkpoint
            && film.done().count() > 0
        {
            checkpoint.due(&self.bar, |kept| kept.write(film, stats));
        }
        if let Some(preview) = preview {
            preview.due(&self.bar, |path| image::write(path, &film.image().into(), tone));
        }
        #[cfg(feature = "tev")]
        if let Some(viewer) = &mut outputs.viewer {
            let show = |viewer: &mut Viewer| {
                viewer.show(&film.image()).map_err(|error| crate::Error::output("the tev viewer", error))
            };
            viewer.due(&self.bar, show);
        }
    }
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;
    use crate::render::{Limits, Silent, refine};
    use crate::scene;

    #[test]
    fn a_shared_checkpoint_loses_no_pass() {
        let scene_file = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/ball.toml");
        let overrides = ["film.width=4", "film.height=3", "render.samples=1", "render.method=path"].map(String::from);
        let description = scene::read(&scene_file, &overrides).unwrap();
        let (scene, settings) = scene::build(&description).unwrap();
        let made = |last| {
            let limits = Limits { passes: Some(1..=last), resumable: true, ..Limits::default() };
            refine(&scene, &settings, &limits, None, &Silent, &false.into()).unwrap()
        };
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("kept");
        let kept = |shared| Kept { path: path.clone(), subject: Subject::new(&description, 1), shared };
        let passes = || Checkpoint::read(&path).unwrap().film.done().count();
        let (begun, done) = (made(1), made(2));
        kept(true).write(&begun.film, &begun.stats).unwrap();
        assert_eq!(passes(), 1);
        kept(true).write(&done.film, &done.stats).unwrap();
        let before = fs::read(&path).unwrap();
        // A slower run of the same task comes later.
        kept(true).write(&begun.film, &begun.stats).unwrap();
        assert!(fs::read(&path).unwrap() == before);
        kept(false).write(&begun.film, &begun.stats).unwrap();
        assert_eq!(passes(), 1);
    }
}
