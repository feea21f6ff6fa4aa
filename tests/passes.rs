//! Passes: the image depends on which passes it holds, not on how they were made; checkpoints hold them; limits end
//! them; their spread tells the error.

use std::fs;
use std::path::Path;
use std::sync::atomic::AtomicBool;
use std::time::{Duration, Instant};

use volpm::image::{Image, Layer};
use volpm::photon::narrowing;
use volpm::render::checkpoint::{self, Subject};
use volpm::render::{Checkpoint, End, Film, Limits, Rendering, Silent, Stats, refine};
use volpm::scene::{self, Description, Scene, Settings};
use xxhash_rust::xxh3::xxh3_128;

use crate::support::{ALL_SORTS, data};

/// Overrides that make the scene quick to render.
const QUICK: [&str; 4] = ["film.width=19", "film.height=18", "render.samples=2", "photons.volume=2000"];

struct Work {
    description: Description,
    scene: Scene,
    settings: Settings,
}

impl Work {
    fn new(overrides: &[&str]) -> Self {
        let overrides: Vec<String> = QUICK.iter().chain(overrides).map(|text| text.to_string()).collect();
        let description = scene::parse(ALL_SORTS, &data("scene.toml"), &overrides).unwrap();
        let (scene, settings) = scene::build(&description).unwrap();
        Work { description, scene, settings }
    }

    fn render(&self, limits: &Limits, before: Option<(Film, Stats)>) -> Rendering {
        refine(&self.scene, &self.settings, limits, before, &Silent, &AtomicBool::new(false)).unwrap()
    }

    fn passes(&self, first: u32, last: u32) -> Rendering {
        self.render(&Limits { passes: Some(first..=last), ..Limits::default() }, None)
    }

    fn subject(&self) -> Subject {
        Subject::new(&self.description, 1)
    }

    fn save(&self, path: &Path, rendering: &Rendering) {
        checkpoint::write(path, &self.subject(), &rendering.film, &rendering.stats).unwrap();
    }
}

fn on<T: Send>(threads: usize, work: impl FnOnce() -> T + Send) -> T {
    rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap().install(work)
}

/// All that is in a picture, as bits.
fn bits(film: &Film) -> (Vec<u32>, Vec<(String, Vec<u32>)>) {
    let of = |pixels: &[[f32; 3]]| pixels.iter().flatten().map(|value| value.to_bits()).collect::<Vec<u32>>();
    let layer = |layer: Layer| {
        let values = match layer.channels {
            volpm::image::LayerData::Rgb(values) | volpm::image::LayerData::Normal(values) => of(&values),
            volpm::image::LayerData::Scalar(values) => values.iter().map(|value| value.to_bits()).collect(),
        };
        (layer.name, values)
    };
    (of(&film.image().pixels), film.layers().into_iter().map(layer).collect())
}

#[test]
fn parts_of_a_render_are_the_whole() {
    let folder = tempfile::tempdir().unwrap();
    let file = |name: &str| folder.path().join(name);
    for method in ["photon", "path", "light"] {
        let work = Work::new(&[&format!("render.method={method}")]);
        let whole = on(3, || work.passes(1, 4));
        assert_eq!((whole.end, whole.stats.passes, whole.stats.samples), (End::Finished, 4, 8));
        let expected = bits(&whole.film);
        let names: Vec<&str> = expected.1.iter().map(|(name, _)| name.as_str()).collect();
        for name in ["direct", "volume_single", "volume_multiple", "albedo", "normal", "depth", "standard_error"] {
            assert!(names.contains(&name), "{method}: {name} is not in {names:?}");
        }

        // Interrupted and resumed.
        let begun = on(1, || work.passes(1, 2));
        assert!(bits(&begun.film).0 != expected.0);
        work.save(&file("first"), &begun);
        let Checkpoint { film, stats, subject } = Checkpoint::read(file("first")).unwrap();
        assert_eq!(subject, work.subject());
        assert!(bits(&film) == bits(&begun.film), "{method}: a file changes the film");
        let resumed = on(2, || work.render(&Limits { passes: Some(1..=4), ..Limits::default() }, Some((film, stats))));
        assert!(bits(&resumed.film) == expected, "{method}: resumed");
        assert_eq!((resumed.stats.passes, resumed.stats.emitted), (4, whole.stats.emitted));

        // Two halves, and three uneven parts in another order.
        work.save(&file("second"), &work.passes(3, 4));
        work.save(&file("third"), &work.passes(3, 3));
        work.save(&file("fourth"), &work.passes(4, 4));
        work.save(&file("whole"), &whole);
        for parts in [&["first", "second"][..], &["second", "first"], &["fourth", "first", "third"]] {
            let mut merged = Checkpoint::read(file(parts[0])).unwrap();
            for part in &parts[1..] {
                merged.merge(&Checkpoint::read(file(part)).unwrap()).unwrap();
            }
            assert!(bits(&merged.film) == expected, "{method}: {parts:?} merged");
            assert_eq!(merged.stats.error, whole.stats.error);
            // Sums are the same, not only what is seen of them: the files end alike, up to the checksum.
            checkpoint::write(file("merged"), &merged.subject, &merged.film, &whole.stats).unwrap();
            assert!(fs::read(file("merged")).unwrap() == fs::read(file("whole")).unwrap(), "{method}: {parts:?}");
        }
    }
}

#[test]
fn a_single_pass_is_the_first_of_many() {
    for method in ["photon", "path", "light"] {
        let work = Work::new(&[&format!("render.method={method}")]);
        let single = work.render(&Limits::default(), None);
        assert!(bits(&single.film) == bits(&work.passes(1, 1).film), "{method}");
    }
}

#[test]
fn radii_shrink_from_pass_to_pass() {
    let work = Work::new(&["volume.kernel=fixed", "volume.radius=0.25"]);
    let adaptive = Work::new(&["volume.max_radius=0.4", "volume.neighbours=5", "photons.volume=20_000"]);
    for pass in [1u32, 2, 9] {
        let factor = narrowing(pass - 1, 2);
        let radii = work.passes(pass, pass).stats.radii;
        assert_eq!((radii.min, radii.max), ((0.25 * factor as f32), (0.25 * factor as f32)), "pass {pass}");
        // The cap of adaptive radii shrinks with them.
        let radii = adaptive.passes(pass, pass).stats.radii;
        assert_eq!(radii.max, 0.4 * factor as f32, "pass {pass}");
        assert!(radii.min < radii.max);
    }
}

#[test]
fn seeds_are_averaged() {
    let folder = tempfile::tempdir().unwrap();
    let seeds: Vec<Work> = (1..=4).map(|seed| Work::new(&[&format!("render.seed={seed}")])).collect();
    let renderings: Vec<Rendering> = seeds.iter().map(|work| work.passes(1, 4)).collect();
    let mut merged = None;
    for (work, rendering) in seeds.iter().zip(&renderings) {
        let path = folder.path().join("one");
        work.save(&path, rendering);
        let next = Checkpoint::read(&path).unwrap();
        match &mut merged {
            None => merged = Some(next),
            Some(merged) => merged.merge(&next).unwrap(),
        }
    }
    let merged = merged.unwrap();
    let images: Vec<Image> = renderings.iter().map(|rendering| rendering.film.image()).collect();
    let found = merged.film.image();
    for (at, pixel) in found.pixels.iter().enumerate() {
        for (c, &value) in pixel.iter().enumerate() {
            let mean = images.iter().map(|image| image.pixels[at][c] as f64).sum::<f64>() / 4.0;
            assert!((value as f64 - mean).abs() <= 3e-7 * mean, "pixel {at}: {value} is not {mean}");
        }
    }
    assert_eq!(merged.stats.passes, 16);
    // Four times the passes, half the error, as far as so few passes tell.
    let error = |rendering: &Rendering| rendering.stats.error.unwrap();
    let before = renderings.iter().map(error).sum::<f64>() / 4.0;
    let share = merged.stats.error.unwrap() / before;
    assert!((0.4..0.65).contains(&share), "the error falls to {share}");
}

#[test]
fn the_spread_of_passes_is_the_error() {
    // Without the small lamp, which few paths find.
    let overrides = ["render.method=path", "render.samples=4", "shapes.2.emission.radiance=0"];
    let render = |seed: u32| Work::new(&[&overrides[..], &[&format!("render.seed={seed}")]].concat()).passes(1, 16);
    let renderings: Vec<Rendering> = (1..=6).map(render).collect();
    let (mut squared, mut expected) = (0.0, 0.0);
    let values = |pixels: &[[f32; 3]]| pixels.iter().flatten().map(|value| *value as f64).collect::<Vec<f64>>();
    for pair in renderings.chunks(2) {
        let images: Vec<Image> = pair.iter().map(|rendering| rendering.film.image()).collect();
        let pixels = values(&images[0].pixels).into_iter().zip(values(&images[1].pixels));
        squared += pixels.map(|(a, b)| (a - b).powi(2)).sum::<f64>();
        for (rendering, image) in pair.iter().zip(&images) {
            let layers = rendering.film.layers();
            let layer = layers.iter().find(|layer| layer.name == "standard_error").unwrap();
            let volpm::image::LayerData::Rgb(errors) = &layer.channels else { panic!("an error is a colour") };
            let errors = values(errors);
            expected += errors.iter().map(|error| error * error).sum::<f64>();
            // What the whole image is said to be off by is made of these.
            let relative = |(error, value): (&f64, f64)| error * error / (value * value + 0.01 * image.mean().powi(2));
            let sum: f64 = errors.iter().zip(values(&image.pixels)).map(relative).sum();
            let found = rendering.stats.error.unwrap();
            assert!((found / (sum / errors.len() as f64).sqrt() - 1.0).abs() < 1e-5);
        }
    }
    // Of independent renders the squared difference is the sum of both squared errors.
    let ratio = (squared / expected).sqrt();
    assert!((0.85..1.18).contains(&ratio), "the error is {ratio} times what passes say");
}

#[test]
fn a_render_ends_when_it_is_told_to() {
    // Threads of its own: it should not wait for other tests.
    on(2, ends_when_told);
}

fn ends_when_told() {
    let work = Work::new(&[]);
    // With an error that a few passes reach.
    let few = work.passes(1, 6).stats.error.unwrap();
    let limits = Limits { target_error: Some(1.02 * few), ..Limits::default() };
    let precise = work.render(&limits, None);
    assert_eq!(precise.end, End::Precise);
    assert!(precise.stats.error.unwrap() <= 1.02 * few && (4..=6).contains(&precise.stats.passes));
    // Out of reach: the passes end, and it is said.
    let limits = Limits { target_error: Some(1e-9), passes: Some(1..=5), ..Limits::default() };
    let finished = work.render(&limits, None);
    assert_eq!((finished.end, finished.stats.passes), (End::Finished, 5));
    assert!(finished.warnings.iter().any(|warning| warning.contains("after 5 passes")), "{:?}", finished.warnings);

    // By the clock, with the passes that fit; they are what they would be without a clock.
    let limit = Duration::from_millis(1500);
    let start = Instant::now();
    let timed = work.render(&Limits { time: Some(limit), ..Limits::default() }, None);
    assert!(start.elapsed() < 2 * limit, "{:?}", start.elapsed());
    assert_eq!(timed.end, End::TimeUp);
    assert!(timed.stats.passes > 1, "{} passes", timed.stats.passes);
    let same = work.passes(1, timed.stats.passes as u32);
    assert!(bits(&timed.film) == bits(&same.film));

    // Shorter than the first pass: with the photons and samples that there are.
    for overrides in [
        &["photons.volume=400_000_000", "photons.max_emitted=4_000_000_000"][..],
        &["render.samples=1_000_000"],
        &["render.samples=1_000_000", "render.method=path"],
    ] {
        let work = Work::new(overrides);
        let start = Instant::now();
        let cut = work.render(&Limits { time: Some(Duration::from_millis(200)), ..Limits::default() }, None);
        assert!(start.elapsed() < Duration::from_secs(20), "{overrides:?}: {:?}", start.elapsed());
        assert_eq!((cut.end, cut.stats.passes), (End::TimeUp, 0), "{overrides:?}");
        assert!(cut.stats.samples >= 1 && cut.film.image().mean() > 0.0, "{overrides:?}: {:?}", cut.stats);
        assert!(cut.film.image().pixels.iter().flatten().all(|value| value.is_finite()));
        assert!(cut.warnings.iter().any(|warning| warning.contains("the time was up")), "{:?}", cut.warnings);
    }
}

#[test]
fn short_memory_makes_more_passes_of_one() {
    let work = Work::new(&["photons.volume=1_000_000", "film.layers=false"]);
    let limits = |memory| Limits { memory: Some(memory), ..Limits::default() };
    assert_eq!(limits(1 << 30).parts(&work.scene, &work.settings, 1_000_000).unwrap(), 1);
    let parts = limits(100 << 20).parts(&work.scene, &work.settings, 1_000_000).unwrap();
    assert!((2..20).contains(&parts), "{parts} parts");
    // One radius for all is stored once.
    let [fixed, variable] = ["fixed", "variable"].map(|kernel| {
        let work = Work::new(&["film.layers=false", &format!("volume.kernel={kernel}")]);
        limits(1 << 30).parts(&work.scene, &work.settings, 1_000_000_000).unwrap()
    });
    assert!(fixed < variable, "{fixed} and {variable} parts");
    let refused = limits(1 << 20).parts(&work.scene, &work.settings, 1_000_000).unwrap_err().to_string();
    assert!(refused.contains("are not enough") && refused.contains("allow"), "{refused}");
    // What it says would do does.
    let allowed: f64 = refused.split("allow ").nth(1).unwrap().split(' ').next().unwrap().parse().unwrap();
    assert!(
        limits(((allowed + 0.1) * 1048576.0) as u64).parts(&work.scene, &work.settings, 1_000_000).is_ok(),
        "{refused}"
    );
}

#[test]
fn what_does_not_belong_together_is_not_joined() {
    let folder = tempfile::tempdir().unwrap();
    let made = |overrides: &[&str], first, last| {
        let work = Work::new(overrides);
        let path = folder.path().join("made");
        work.save(&path, &work.passes(first, last));
        Checkpoint::read(path).unwrap()
    };
    let refused = |overrides: &[&str], first, last| {
        let mut one = made(&["render.seed=3"], 2, 4);
        let before = bits(&one.film);
        let why = one.merge(&made(overrides, first, last)).unwrap_err();
        assert!(bits(&one.film) == before);
        why
    };
    for (overrides, key) in [
        (&["render.samples=3"][..], "render.samples is 2 in one and 3 in the other"),
        (&["photons.volume=2001"], "photons.volume is 2000 in one and 2001 in the other"),
        (&["film.width=20"], "film.width"),
        (
            &["media.haze.sigma_a=0.03"],
            "media.haze.sigma_a is [0.02,0.02,0.02] in one and [0.03,0.03,0.03] in the other",
        ),
        (&["volume.radius=0.3"], "volume.radius"),
        (&["render.method=path"], "render.method"),
    ] {
        let why = refused(&[overrides, &["render.seed=3"]].concat(), 5, 5);
        assert!(why.contains(key), "{why}");
    }
    let why = refused(&["render.seed=3"], 4, 6);
    assert!(why.contains("both hold pass 4 of seed 3"), "{why}");
    // What pixels do not depend on keeps nothing apart.
    let mut one = made(&["render.seed=3"], 2, 2);
    one.merge(&made(&["film.exposure=2", "title=other", "film.tone_map=linear", "render.passes=9"], 2, 2)).unwrap();
    // Nor does where the scene lies; what is in its files does.
    let copy = |change: &str| {
        let place = tempfile::tempdir().unwrap();
        let (from, to) = (data("reference/smoke_grid"), place.path().join("reference/smoke_grid"));
        fs::create_dir_all(&to).unwrap();
        let mut bytes = fs::read(from.join("smoke_grid_64.vdb")).unwrap();
        bytes.extend_from_slice(change.as_bytes());
        fs::write(to.join("smoke_grid_64.vdb"), bytes).unwrap();
        let description = scene::parse(ALL_SORTS, &place.path().join("other.toml"), &QUICK.map(String::from)).unwrap();
        Subject::new(&description, 1)
    };
    let here = Work::new(&[]).subject();
    assert_eq!(here.difference(&copy("")), None);
    assert!(here.difference(&copy("x")).is_some());
}

#[test]
fn damaged_checkpoints_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("checkpoint");
    let work = Work::new(&["film.width=4", "film.height=3"]);
    work.save(&path, &work.passes(1, 2));
    let good = fs::read(&path).unwrap();
    assert!(Checkpoint::read(&path).is_ok());
    let read = |bytes: &[u8]| {
        fs::write(&path, bytes).unwrap();
        Checkpoint::read(&path)
    };
    let refused = |bytes: &[u8], what: &str| {
        let error = read(bytes).map(|_| ()).expect_err(what);
        assert_eq!(error.exit_status(), 2, "{what}");
        error.to_string()
    };
    // Cut short, or with bytes overwritten.
    for length in (0..good.len()).step_by(1 + good.len() / 150) {
        refused(&good[..length], &format!("{length} bytes"));
    }
    for at in (0..good.len()).step_by(1 + good.len() / 250) {
        for value in [0, 0xff, good[at] ^ 1] {
            let mut bad = good.clone();
            bad[at] = value;
            if bad != good {
                refused(&bad, &format!("byte {at} is {value}"));
            }
        }
    }
    assert!(refused(&[&good[..], b"x"].concat(), "a byte more").contains("checksum"));
    assert!(refused(b"no checkpoint, but as long as one that is short", "text").contains("does not begin"));
    for other in [good[16] - 1, good[16] + 1] {
        let mut bytes = good.clone();
        bytes[16] = other;
        let version = format!("a checkpoint of version {other}; this program reads version {}", good[16]);
        assert!(refused(&bytes, &version).contains(&version));
    }
    assert_eq!(Checkpoint::read(folder.path()).unwrap_err().exit_status(), 2);
    assert_eq!(Checkpoint::read(folder.path().join("missing")).unwrap_err().exit_status(), 2);

    // With a checksum that is right: whatever is read, it is refused or it is a film.
    let sealed = |mut bytes: Vec<u8>| {
        let end = bytes.len() - 16;
        let checksum = xxh3_128(&bytes[..end]).to_le_bytes();
        bytes[end..].copy_from_slice(&checksum);
        bytes
    };
    assert!(read(&sealed(good.clone())).is_ok());
    for at in (16..good.len() - 16).step_by(1 + good.len() / 400) {
        for value in [0, b'9', 0x7f, 0xff] {
            let mut bytes = good.clone();
            bytes[at] = value;
            if let Ok(checkpoint) = read(&sealed(bytes)) {
                bits(&checkpoint.film);
            }
        }
    }
    // Headers that claim more than there is.
    let header = u32::from_le_bytes(good[20..24].try_into().unwrap()) as usize;
    let text = std::str::from_utf8(&good[24..24 + header]).unwrap();
    for (from, to) in [
        (r#""width":4"#, r#""width":4000000000"#),
        (r#""height":3"#, r#""height":4294967295"#),
        (r#""width":4"#, r#""width":0"#),
        (r#"[1,2]"#, r#"[1,4294967295]"#),
        (r#"[1,2]"#, r#"[0,2]"#),
        (r#""direct""#, r#""smell""#),
        (r#""layers":true"#, r#""layers":false"#),
        (r#""parts":1"#, r#""parts":0"#),
    ] {
        assert!(text.contains(from), "{from} in {text}");
        let changed = text.replacen(from, to, 1);
        let length = (changed.len() as u32).to_le_bytes();
        let bytes = [&good[..20], &length, changed.as_bytes(), &good[24 + header..]].concat();
        let error = refused(&sealed(bytes), to);
        assert!(error.contains("damaged"), "{to}: {error}");
    }
    let mut long = good.clone();
    long[20..24].copy_from_slice(&u32::MAX.to_le_bytes());
    assert!(refused(&sealed(long), "a long header").contains("longer"));
}
