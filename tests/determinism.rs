//! One scene and one seed give the same pixels, bit by bit, whatever the number of threads.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::atomic::AtomicBool;

use volpm::image::{Image, LayerData};
use volpm::render::{Film, Silent, render as render_scene};
use volpm::scene::{self, Settings};
use xxhash_rust::xxh3::Xxh3;

use crate::support::{ALL_SORTS, render};

/// Scenes in which every kind of light path occurs, with what makes each quick, and what else is to be changed.
const SCENES: [(&str, &[&str]); 14] = [
    ("smoke", &[]),
    ("milk", &[]),
    ("marble", &[]),
    ("candle", &[]),
    ("stage", &["render.max_depth=4", "surface.shadow_photons=true"]),
    ("volume-caustic", &["volume.single_scattering=traced"]),
    ("cornell-fog", &["volume.kernel=fixed"]),
    ("fire", &[]),
    ("veined-sphere", &["film.layers=true"]),
    ("skin", &["volume.single_scattering=approximate"]),
    ("stress/channels", &[]),
    ("stress/fog-and-sky", &["volume.single_scattering=traced", "volume.march={ step = \"adaptive\" }"]),
    ("stress/atmosphere", &["volume.march={ step = \"exponential\" }"]),
    ("stress/glass-of-water", &[]),
];

/// Makes a scene small.
const QUICK: [&str; 5] =
    ["film.width=16", "film.height=12", "render.samples=2", "render.passes=1", "photons.volume=3000"];

const ESTIMATES: [(&str, [&str; 2]); 4] = [
    ("path", ["render.method=path", "volume.estimate=beam"]),
    ("beam", ["render.method=photon", "volume.estimate=beam"]),
    ("point", ["render.method=photon", "volume.estimate=point"]),
    ("light", ["render.method=light", "volume.estimate=beam"]),
];

/// A digest of all that is in a picture.
fn digest(film: &Film) -> u64 {
    let mut hash = Xxh3::new();
    let mut add = |values: &[f32]| values.iter().for_each(|value| hash.update(&value.to_bits().to_le_bytes()));
    add(film.image().pixels.as_flattened());
    for layer in film.layers() {
        match &layer.channels {
            LayerData::Rgb(values) | LayerData::Normal(values) => add(values.as_flattened()),
            LayerData::Scalar(values) => add(values),
        }
    }
    hash.digest()
}

/// One thread and five make the same picture of every scene, by every estimate.
///
/// Pictures are the same from one version of the program to the next where only its code was moved. To prove that, name a
/// file in `VOLPM_HASHES`: it is written if it is not there, and else compared. It holds for one machine: mathematical
/// functions and vectors differ between processors.
#[test]
fn threads_change_no_scene() {
    let mut found = BTreeMap::new();
    for (name, changes) in SCENES {
        let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes").join(name).with_extension("toml");
        let read = |chosen: &[&str]| {
            let overrides: Vec<String> = [&QUICK[..], changes, chosen].concat().iter().map(|t| t.to_string()).collect();
            scene::read(&file, &overrides).unwrap_or_else(|error| panic!("{error}"))
        };
        // How it is rendered is no part of a scene: one is enough.
        let (scene, _) = scene::build(&read(&[])).unwrap_or_else(|error| panic!("{error}"));
        for (estimate, chosen) in ESTIMATES {
            let settings = Settings::of(&read(&chosen));
            let [one, five] = [1, 5].map(|threads| {
                let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
                let rendering = pool.install(|| render_scene(&scene, &settings, &Silent, &AtomicBool::new(false)));
                digest(&rendering.unwrap_or_else(|error| panic!("{name}: {error}")).film)
            });
            assert_eq!(one, five, "{name}, {estimate}: five threads");
            found.insert(format!("{name} {estimate}"), one);
        }
    }
    let Some(file) = std::env::var_os("VOLPM_HASHES") else { return };
    let text: String = found.iter().map(|(what, hash)| format!("{what} {hash:016x}\n")).collect();
    match std::fs::read_to_string(&file) {
        Ok(known) => {
            let changed: Vec<&str> = text.lines().filter(|line| !known.lines().any(|old| old == *line)).collect();
            assert!(changed.is_empty(), "{} of {} pictures changed: {changed:#?}", changed.len(), found.len());
        }
        Err(_) => std::fs::write(&file, text).unwrap(),
    }
}

#[test]
fn threads_change_nothing() {
    for (method, estimate) in [("photon", "beam"), ("photon", "point"), ("path", "beam"), ("light", "beam")] {
        let image = |threads: usize, seed: u32| -> Image {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let (method, seed) = (format!("render.method={method}"), format!("render.seed={seed}"));
            let estimate = format!("volume.estimate={estimate}");
            pool.install(|| render(ALL_SORTS, &[&method, &estimate, &seed]).film.image())
        };
        let one = image(1, 7);
        for threads in [2, 5] {
            let other = image(threads, 7);
            let bits = |image: &Image| image.pixels.iter().flatten().map(|x| x.to_bits()).collect::<Vec<_>>();
            assert!(bits(&one) == bits(&other), "{method}, {estimate}: {threads} threads");
        }
        let other = image(2, 8);
        // Pixels that no light path has met are black by every seed.
        let same = one.pixels.iter().zip(&other.pixels).filter(|(a, b)| a == b && **a != [0.0; 3]).count();
        assert!(same < one.pixels.len() / 20, "{method}, {estimate}: another seed left {same} pixels as they were");
        assert!(one.mean() > 0.0);
    }
}
