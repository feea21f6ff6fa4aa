//! Damaged files: whatever is changed in a file, it is read, or refused with a message, in bounded memory and time; and a
//! damaged scene becomes a picture whose pixels are finite and not negative, or is refused. Nothing panics.
//!
//! Mutants are numbered, and a number always makes the same one. What fails is kept, and named with its number. For hours by
//! hand: `cargo test --release --test mutants -- --ignored --nocapture`, each test for `VOLPM_SECONDS` (600), with other
//! mutants for each `VOLPM_SEED` (1).

mod corpus;
mod examine;
mod memory;
mod mutation;

use std::fs;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use rayon::ThreadPoolBuilder;
use volpm::Result;

use corpus::{Corpus, SCENES};
use examine::{LONGEST, Outcome, picture, read, sealed};
use memory::most_held;

/// The most that reading a small file, or a small picture of a small scene, may hold.
const MOST_HELD: usize = 1 << 30;
/// Whoever takes longer and cannot be broken off ends the program.
const DEADLINE: Duration = Duration::from_secs(300);

/// Who takes longer is told of, and kept.
const SLOW: Duration = Duration::from_secs(10);

/// The mutant that is under way, since when, and where it is kept.
struct Case {
    since: Instant,
    what: String,
    kept: PathBuf,
}

type UnderWay = Arc<Mutex<Option<Case>>>;

/// Makes mutants and counts what became of them.
struct Laboratory {
    pool: rayon::ThreadPool,
    /// Mutants are numbered from here.
    from: u64,
    under_way: UnderWay,
    counts: [usize; 2],
    most_held: usize,
    slowest: (Duration, String),
    failures: Vec<String>,
}

impl Laboratory {
    fn new(from: u64) -> Laboratory {
        let under_way = UnderWay::default();
        let watched = Arc::downgrade(&under_way);
        std::thread::spawn(move || {
            while let Some(watched) = watched.upgrade() {
                if let Some(case) = &*watched.lock().unwrap()
                    && case.since.elapsed() > DEADLINE
                {
                    eprintln!("{}, kept as {}: no end after {DEADLINE:?}", case.what, case.kept.display());
                    std::process::exit(101);
                }
                drop(watched);
                std::thread::sleep(Duration::from_millis(500));
            }
        });
        Laboratory {
            // What is held is counted by thread.
            pool: ThreadPoolBuilder::new().num_threads(1).build().unwrap(),
            from,
            under_way,
            counts: [0; 2],
            most_held: 0,
            slowest: (Duration::ZERO, String::new()),
            failures: Vec::new(),
        }
    }

    /// What becomes of one mutant, whose bytes are kept if that is none of what may be.
    fn examine(&mut self, name: &str, number: u64, mutant: &[u8], work: impl FnOnce() -> Result<Outcome> + Send) {
        let what = format!("mutant {number} of {name}");
        let kept = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("{number}-{name}"));
        let start = Instant::now();
        // Even if the program is ended.
        fs::write(&kept, mutant).unwrap();
        *self.under_way.lock().unwrap() = Some(Case { since: start, what: what.clone(), kept });
        let (ended, held) = self.pool.install(|| most_held(|| catch_unwind(AssertUnwindSafe(work))));
        let case = self.under_way.lock().unwrap().take().expect("it was under way");
        let is_slow = start.elapsed() > SLOW;
        if is_slow {
            println!("{what}, kept as {}: takes {:.1?}", case.kept.display(), start.elapsed());
        }
        if start.elapsed() > self.slowest.0 {
            self.slowest = (start.elapsed(), what.clone());
        }
        self.most_held = self.most_held.max(held);
        let failure = match ended {
            Err(panic) => {
                let text = panic.downcast_ref::<String>().map(String::as_str);
                format!("panics: {}", text.or(panic.downcast_ref::<&str>().copied()).unwrap_or("?"))
            }
            Ok(_) if held > MOST_HELD => format!("takes {} MiB", held >> 20),
            Ok(Ok(Outcome::Late)) => format!("takes longer than {LONGEST:?}"),
            Ok(Err(error)) if error.to_string().is_empty() => "is refused without a word".to_owned(),
            Ok(outcome) => {
                if !is_slow {
                    fs::remove_file(&case.kept).unwrap();
                }
                return self.counts[usize::from(outcome.is_err())] += 1;
            }
        };
        println!("{what}, kept as {}: {failure}", case.kept.display());
        self.failures.push(format!("{what}: {failure}"));
    }

    /// Mutants of a file that a reader is given the path of.
    fn files(&mut self, path: &Path, count: u64, change: fn(Vec<u8>) -> Vec<u8>) {
        let sound = fs::read(path).unwrap();
        read(path).unwrap_or_else(|error| panic!("{error}"));
        let name = path.file_name().unwrap().to_string_lossy().into_owned();
        for number in self.from..self.from + count {
            let mutant = change(mutation::of_bytes(&sound, number));
            fs::write(path, &mutant).unwrap();
            self.examine(&name, number, &mutant, || read(path).map(|()| Outcome::Read));
        }
        fs::write(path, &sound).unwrap();
    }

    /// Mutants of a scene's text.
    fn scenes(&mut self, name: &str, text: &str, folder: &Path, count: u64) {
        let path = folder.join(name);
        picture(text, &path).unwrap_or_else(|error| panic!("{error}"));
        for number in self.from..self.from + count {
            let mutant = mutation::of_text(text, number);
            self.examine(name, number, mutant.as_bytes(), || picture(&mutant, &path));
        }
    }

    /// Pictures of scenes one of whose files is damaged.
    fn behind(&mut self, corpus: &Corpus, scene: &str, files: &[&str], count: u64) {
        let text = SCENES.iter().find(|(name, _)| *name == scene).unwrap().1;
        for file in files {
            let path = corpus.path(file);
            let sound = fs::read(&path).unwrap();
            for number in self.from..self.from + count {
                let mutant = mutation::of_bytes(&sound, number);
                fs::write(&path, &mutant).unwrap();
                self.examine(&format!("{scene}-{file}"), number, &mutant, || picture(text, &corpus.path("scene.toml")));
            }
            fs::write(&path, &sound).unwrap();
        }
    }

    fn report(&self) {
        let [read, refused] = self.counts;
        let ((slowest, what), kib) = (&self.slowest, self.most_held >> 10);
        println!("{read} read, {refused} refused; at most {kib} KiB; the slowest took {slowest:.2?}: {what}");
    }

    #[track_caller]
    fn finish(self) {
        self.report();
        assert!(self.failures.is_empty(), "{} failures:\n{}", self.failures.len(), self.failures.join("\n"));
        assert!(self.counts.iter().all(|count| *count > 0), "all were read, or none");
    }
}

/// All readers, with so many mutants of each file.
fn readers(laboratory: &mut Laboratory, corpus: &Corpus, count: u64) {
    let small = ["even.npy", "open.obj", "closed.obj", "ring.ies", "lamp.ldt"];
    for name in small.iter().chain(&["sky.exr", "sky.hdr", "tile.png", "tile.pfm", "tile.jpg"]) {
        laboratory.files(&corpus.path(name), 2 * count, |bytes| bytes);
    }
    for name in ["ball.vdb", "half.vdb", "zip.vdb", "turned.vdb", "two.vdb", "passes"] {
        laboratory.files(&corpus.path(name), count, |bytes| bytes);
    }
    laboratory.files(&corpus.path("passes"), count, sealed);
}

/// Whole scenes: of damaged text, and behind damaged files.
fn scenes(laboratory: &mut Laboratory, corpus: &Corpus, count: u64) {
    for (name, text) in SCENES {
        laboratory.scenes(name, text, corpus.folder.path(), count);
    }
    laboratory.behind(corpus, "grids", &["even.npy", "ball.vdb", "open.obj", "ring.ies"], count / 4);
    laboratory.behind(corpus, "paints", &["tile.png", "tile.jpg", "sky.exr", "closed.obj"], count / 4);
    laboratory.behind(corpus, "deep", &["two.vdb", "lamp.ldt"], count / 4);
}

#[test]
fn readers_stand_damaged_files() {
    let (corpus, mut laboratory) = (Corpus::new(), Laboratory::new(0));
    readers(&mut laboratory, &corpus, 500);
    laboratory.finish();
}

#[test]
fn pictures_of_damaged_scenes_are_sound() {
    let (corpus, mut laboratory) = (Corpus::new(), Laboratory::new(0));
    scenes(&mut laboratory, &corpus, 10);
    laboratory.finish();
}

/// Rounds of other mutants, until the time is up.
fn for_long(work: impl Fn(&mut Laboratory, &Corpus)) {
    let number = |name: &str, default: u64| {
        std::env::var(name).map_or(default, |text| text.parse().unwrap_or_else(|_| panic!("{name}={text}")))
    };
    let (start, time) = (Instant::now(), Duration::from_secs(number("VOLPM_SECONDS", 600)));
    let (corpus, mut laboratory) = (Corpus::new(), Laboratory::new(number("VOLPM_SEED", 1) << 32));
    while start.elapsed() < time {
        work(&mut laboratory, &corpus);
        laboratory.report();
        laboratory.from += 1 << 16;
    }
    laboratory.finish();
}

#[test]
#[ignore = "as long as VOLPM_SECONDS says"]
fn readers_stand_mutants_for_long() {
    for_long(|laboratory, corpus| readers(laboratory, corpus, 1000));
}

#[test]
#[ignore = "as long as VOLPM_SECONDS says"]
fn pictures_of_mutants_are_sound_for_long() {
    for_long(|laboratory, corpus| scenes(laboratory, corpus, 200));
}

/// The scenes of the repository that are rendered quickly.
#[test]
#[ignore = "as long as VOLPM_SECONDS says"]
fn pictures_of_the_repositorys_mutants_are_sound_for_long() {
    let mut found: Vec<(PathBuf, String)> = Vec::new();
    for folder in ["stress", "room", "materials", "jensen", "lamps"] {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes").join(folder);
        let files = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
        for path in files.filter(|path| corpus::is_scene(path)) {
            let text = fs::read_to_string(&path).unwrap();
            let start = Instant::now();
            if picture(&text, &path).is_ok() && start.elapsed() < Duration::from_millis(500) {
                found.push((path, text));
            }
        }
    }
    found.sort();
    for_long(|laboratory, _| {
        for (path, text) in &found {
            let name = path.file_name().unwrap().to_string_lossy();
            laboratory.scenes(&name, text, path.parent().unwrap(), 20);
        }
    });
}
