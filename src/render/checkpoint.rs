//! Checkpoints: finished passes in a file, to be continued or joined with others of the same scene.
//!
//! Little-endian throughout:
//!
//! ```text
//! 16 bytes  "volpm checkpoint"
//!  4        the version of the format, 2
//!  4        the length of the header
//!  …        the header: JSON, what the passes are of and which there are
//!  …        sums over passes, plane by plane: means, their squares, the components that the header names,
//!           then albedo with normal, depth, and hits if layers are kept. Of each plane first the places
//!           (8 bits a pixel), then the digits (two of 64 bits a channel)
//! 16        XXH3-128 of everything before
//! ```
//!
//! Nothing in it depends on how its passes were grouped, but for what the header says of their cost.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Display;
use std::fs::File;
use std::io::{self, BufReader, Read, Seek, SeekFrom, Write};
use std::path::Path;

use serde::{Deserialize, Serialize};
use serde_json::Value;
use xxhash_rust::xxh3::Xxh3;

use super::done::Done;
use super::exact::{self, ExactSums};
use super::eye::Component;
use super::film::{Film, Finished, Layers, Surfaces};
use super::stats::Stats;
use crate::image::write_aside;
use crate::scene::description::ToneMap;
use crate::scene::{Description, is_plain};
use crate::{Error, Result};

const MAGIC: &[u8; 16] = b"volpm checkpoint";
const VERSION: u32 = 2;
/// Bytes before the header, and after the sums.
const HEAD: u64 = 16 + 4 + 4;
const TAIL: u64 = 16;

/// Finished passes and what they are of.
#[derive(Debug)]
pub struct Checkpoint {
    /// What they are of.
    pub subject: Subject,
    /// Their sums.
    pub film: Film,
    /// What they cost.
    pub stats: Stats,
}

/// What passes are of. Only passes of the same scene and settings can be joined.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Subject {
    /// The scene file.
    pub scene: String,
    /// What a scene file calls the method.
    pub method: String,
    /// Parts that each pass is split into; each of them counts as a pass here.
    pub parts: u32,
    /// Stops by which PNG files are brightened.
    pub exposure: Option<f64>,
    /// Whether PNG files have the filmic tone curve.
    pub filmic: bool,
    /// What pixels depend on, but for seed and passes, by name: the keys of the scene with their values, the hash of each
    /// file it names instead of its path, the parts, and the program's version.
    settings: BTreeMap<String, String>,
}

#[derive(Serialize, Deserialize)]
struct Header {
    subject: Subject,
    width: u32,
    height: u32,
    layers: bool,
    components: Vec<String>,
    done: Done,
    stats: Stats,
}

impl Subject {
    /// Passes, each split into so many parts, of what a scene file says. Reads the files it names.
    pub fn new(description: &Description, parts: u32) -> Self {
        let mut plain = description.clone();
        for file in plain.files_mut() {
            let name = file.file_name().unwrap_or_default().to_string_lossy();
            let content = hash_of(file).map_or("unread".to_string(), |hash| format!("{hash:032x}"));
            *file = format!("{name} {content}").into();
        }
        let mut settings = BTreeMap::new();
        // A description is numbers and text: it can always be told.
        name_values(&serde_json::to_value(&plain).unwrap_or_default(), "", &mut settings);
        NOT_OF_PIXELS.iter().for_each(|name| drop(settings.remove(*name)));
        settings.insert("parts".to_string(), parts.to_string());
        settings.insert(PROGRAM.to_string(), env!("CARGO_PKG_VERSION").to_string());
        Subject {
            scene: description.path.display().to_string(),
            method: description.render.method.name().to_string(),
            parts,
            exposure: description.film.exposure,
            filmic: description.film.tone_map == ToneMap::Filmic,
            settings,
        }
    }

    /// A digest of the named settings: two subjects have the same one only if they have the same settings, as far as 128
    /// bits can tell.
    pub fn fingerprint(&self) -> String {
        let mut hash = Xxh3::new();
        // Lengths keep names and values apart, whatever is in them.
        for text in self.settings.iter().flat_map(|(name, value)| [name, value]) {
            hash.update(&(text.len() as u64).to_le_bytes());
            hash.update(text.as_bytes());
        }
        format!("{:032x}", hash.digest128())
    }

    /// Where this and another subject differ, so that their passes must not be joined.
    pub fn difference(&self, other: &Subject) -> Option<String> {
        let (one, two) = (&self.settings, &other.settings);
        let names = one.keys().chain(two.keys().filter(|name| !one.contains_key(*name)));
        let named = std::iter::once(PROGRAM).chain(names.map(String::as_str));
        let told = |value: Option<&String>| value.map_or("not there".to_string(), String::clone);
        named
            .map(|name| (name, one.get(name), two.get(name)))
            .find(|(_, value, other)| value != other)
            .map(|(name, value, other)| format!("{name} is {} in one and {} in the other", told(value), told(other)))
    }
}

/// The name under which settings hold the program's version.
const PROGRAM: &str = "version";

/// What a scene file says that no pixel's sums depend on.
const NOT_OF_PIXELS: [&str; 5] =
    ["film.exposure", "film.tone_map", "film.standard_error", "render.seed", "render.passes"];

/// Adds all values below `value` by dotted names. Vectors are one value; what has names of its own is called by them, as
/// scene files do, and its number, by which others refer to it, is its value.
fn name_values(value: &Value, name: &str, settings: &mut BTreeMap<String, String>) {
    let below = |key: &dyn Display| if name.is_empty() { key.to_string() } else { format!("{name}.{key}") };
    match value {
        Value::Object(fields) => fields.iter().for_each(|(key, value)| name_values(value, &below(key), settings)),
        Value::Array(values) if values.iter().any(|value| value.is_object() || value.is_array()) => {
            let own: BTreeSet<&str> = values.iter().filter_map(|value| value.get("name")?.as_str()).collect();
            let named = own.len() == values.len() && own.iter().all(|name| is_plain(name) && !name.contains('.'));
            for (index, value) in values.iter().enumerate() {
                match value.get("name").and_then(Value::as_str).filter(|_| named) {
                    Some(own) => {
                        settings.insert(below(&own), index.to_string());
                        name_values(value, &below(&own), settings);
                    }
                    None => name_values(value, &below(&index), settings),
                }
            }
        }
        Value::Null => drop(settings.insert(name.to_string(), "not set".to_string())),
        _ => drop(settings.insert(name.to_string(), value.to_string())),
    }
}

fn hash_of(path: &Path) -> io::Result<u128> {
    hash(&mut File::open(path)?, u64::MAX)
}

/// XXH3-128 of the next `length` bytes, or all there are.
fn hash(file: &mut File, length: u64) -> io::Result<u128> {
    let (mut hash, mut buffer) = (Xxh3::new(), vec![0; 1 << 18]);
    let mut file = file.take(length);
    loop {
        match file.read(&mut buffer) {
            Ok(0) => return Ok(hash.digest128()),
            Ok(count) => hash.update(&buffer[..count]),
            Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
            Err(error) => return Err(error),
        }
    }
}

/// Hashes what it passes on.
struct Hashing<W> {
    file: W,
    hash: Xxh3,
}

impl<W: Write> Write for Hashing<W> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let count = self.file.write(bytes)?;
        self.hash.update(&bytes[..count]);
        Ok(count)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.file.flush()
    }
}

/// Writes the finished passes of a film, aside first. The film must be one of several passes.
///
/// # Errors
/// [`Error::Output`].
pub fn write(path: impl AsRef<Path>, subject: &Subject, film: &Film, stats: &Stats) -> Result<()> {
    let path = path.as_ref();
    let Some(sums) = film.finished().filter(|_| film.done().count() > 0) else {
        return Err(Error::output(path, "there is no finished pass to keep"));
    };
    let present = Component::ALL.iter().zip(&sums.components).filter(|(_, sums)| sums.is_some());
    let (width, height) = film.size();
    let header = Header {
        subject: subject.clone(),
        width,
        height,
        layers: film.kept().components,
        components: present.map(|(component, _)| component.name().to_string()).collect(),
        done: film.done().clone(),
        stats: stats.clone(),
    };
    let header = serde_json::to_vec(&header).map_err(|error| Error::output(path, error))?;
    let length = u32::try_from(header.len()).map_err(|_| Error::output(path, "the scene is too large to describe"))?;
    write_aside(path, |file| {
        let mut file = Hashing { file, hash: Xxh3::new() };
        file.write_all(MAGIC)?;
        file.write_all(&VERSION.to_le_bytes())?;
        file.write_all(&length.to_le_bytes())?;
        file.write_all(&header)?;
        sums.means.write(&mut file)?;
        sums.squares.write(&mut file)?;
        sums.components.iter().flatten().try_for_each(|sums| sums.write(&mut file))?;
        if let Some(Surfaces { guides, depth, hits }) = &sums.surfaces {
            guides.write(&mut file)?;
            depth.write(&mut file)?;
            hits.write(&mut file)?;
        }
        let hash = file.hash.digest128();
        file.file.write_all(&hash.to_le_bytes())
    })
}

impl Checkpoint {
    /// Reads a checkpoint. Memory is taken for no more than the file holds.
    ///
    /// # Errors
    /// [`Error::Asset`] for a file that is missing, damaged, or none of this version.
    pub fn read(path: impl AsRef<Path>) -> Result<Checkpoint> {
        let path = path.as_ref();
        let cannot = |error: io::Error| Error::asset(path, format!("cannot read the checkpoint: {error}"));
        let mut file = File::open(path).map_err(cannot)?;
        let metadata = file.metadata().map_err(cannot)?;
        if !metadata.is_file() {
            return Err(Error::asset(path, "cannot read the checkpoint: this is not a file"));
        }
        match decode(&mut file, metadata.len()) {
            Ok(Ok(checkpoint)) => Ok(checkpoint),
            Ok(Err(message)) => Err(Error::asset(path, message)),
            Err(error) => Err(cannot(error)),
        }
    }

    /// Whether a file begins like a checkpoint.
    pub fn is_one(path: impl AsRef<Path>) -> bool {
        let mut magic = [0; MAGIC.len()];
        let read = File::open(path).and_then(|mut file| file.read_exact(&mut magic));
        read.is_ok() && &magic == MAGIC
    }

    /// Adds the passes of another checkpoint.
    ///
    /// # Errors
    /// What keeps them apart: another scene, other settings, or passes that both hold.
    pub fn merge(&mut self, other: &Checkpoint) -> Result<(), String> {
        if let Some(difference) = self.subject.difference(&other.subject) {
            return Err(format!("they are of different scenes or settings: {difference}"));
        }
        self.film.merge(&other.film)?;
        self.stats.merge(&other.stats);
        self.stats.error = self.film.error();
        Ok(())
    }
}

/// A checkpoint, or what is wrong with it.
fn decode(file: &mut File, length: u64) -> io::Result<Result<Checkpoint, String>> {
    let mut head = [0; HEAD as usize];
    if length < HEAD + TAIL {
        return Ok(Err(format!("not a checkpoint: {length} bytes are less than any has")));
    }
    file.read_exact(&mut head)?;
    if !head.starts_with(MAGIC) {
        return Ok(Err("not a checkpoint: it does not begin with \"volpm checkpoint\"".to_string()));
    }
    let word = |at: usize| u32::from_le_bytes([head[at], head[at + 1], head[at + 2], head[at + 3]]);
    let (version, header) = (word(16), word(20) as u64);
    if version != VERSION {
        return Ok(Err(format!(
            "a checkpoint of version {version}; this program reads version {VERSION}: use the program that wrote it"
        )));
    }
    let damaged = |what: &str| Ok(Err(format!("the checkpoint is damaged or cut short: {what}")));
    file.rewind()?;
    let found = hash(file, length - TAIL)?;
    let mut expected = [0; TAIL as usize];
    file.read_exact(&mut expected)?;
    if found != u128::from_le_bytes(expected) {
        return damaged("its checksum is another");
    }
    if header > length - HEAD - TAIL {
        return damaged("its header is longer than the file");
    }

    let mut file = BufReader::with_capacity(1 << 18, file);
    file.seek(SeekFrom::Start(HEAD))?;
    let mut text = vec![0; header as usize];
    file.read_exact(&mut text)?;
    let header: Header = match serde_json::from_slice(&text) {
        Ok(header) => header,
        Err(error) => return damaged(&format!("its header: {error}")),
    };
    let Header { subject, width, height, layers, components, done, stats } = header;
    let known: Vec<bool> =
        Component::ALL.iter().map(|component| components.iter().any(|name| name == component.name())).collect();
    if known.iter().filter(|known| **known).count() != components.len() || (!layers && !components.is_empty()) {
        return damaged("its header names layers that there are not");
    }
    if !done.is_sound() || done.count() > exact::MOST as u64 || done.count() == 0 || subject.parts == 0 {
        return damaged("its header names passes that cannot be");
    }
    let pixel = (2 + components.len()) * ExactSums::<3>::BYTES
        + if layers { ExactSums::<6>::BYTES + 2 * ExactSums::<1>::BYTES } else { 0 };
    let pixels = width as u64 * height as u64;
    let sums = length - HEAD - TAIL - text.len() as u64;
    if pixels == 0 || pixels as u128 * pixel as u128 != sums as u128 {
        return damaged(&format!("{width} × {height} pixels do not take {sums} bytes"));
    }

    let (pixels, passes) = (pixels as usize, done.count() as u32);
    let impossible = || damaged("its sums cannot be");
    let Some(means) = ExactSums::read(&mut file, pixels, passes)? else { return impossible() };
    let Some(squares) = ExactSums::read(&mut file, pixels, passes)? else { return impossible() };
    let mut finished = Finished { means, squares, components: Default::default(), surfaces: None };
    for (sums, known) in finished.components.iter_mut().zip(known) {
        if known {
            *sums = ExactSums::read(&mut file, pixels, passes)?;
            if sums.is_none() {
                return impossible();
            }
        }
    }
    if layers {
        let Some(guides) = ExactSums::read(&mut file, pixels, passes)? else { return impossible() };
        let Some(depth) = ExactSums::read(&mut file, pixels, passes)? else { return impossible() };
        let Some(hits) = ExactSums::read(&mut file, pixels, passes)? else { return impossible() };
        finished.surfaces = Some(Surfaces { guides, depth, hits });
    }
    let film = Film::of_finished((width, height), Layers { components: layers }, finished, done);
    Ok(Ok(Checkpoint { subject, film, stats }))
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn differences_are_named() {
        let subject = |value: Value| {
            let mut settings = BTreeMap::new();
            name_values(&value, "", &mut settings);
            let scene = "a.toml".to_string();
            Subject { scene, method: "path".to_string(), parts: 1, exposure: None, filmic: true, settings }
        };
        let told = |one: Value, other: Value| {
            let (one, other) = (subject(one), subject(other));
            assert_eq!(one.fingerprint() == other.fingerprint(), one.difference(&other).is_none());
            one.difference(&other).unwrap_or_default()
        };
        let volume = |radius: Value| json!({ "volume": { "radius": radius }, "media": [{ "sigma": [0.1, 2.0] }] });
        assert_eq!(told(volume(json!(0.1)), volume(json!(0.1))), "");
        assert_eq!(told(volume(json!(0.1)), volume(json!(0.2))), "volume.radius is 0.1 in one and 0.2 in the other");
        assert_eq!(
            told(volume(json!(0.1)), volume(Value::Null)),
            "volume.radius is 0.1 in one and not set in the other"
        );
        let other = json!({ "volume": { "radius": 0.1 }, "media": [{ "sigma": [0.1, 3.0] }] });
        assert_eq!(told(volume(json!(0.1)), other), "media.0.sigma is [0.1,2.0] in one and [0.1,3.0] in the other");
        let haze = |order: [&str; 2]| json!({ "media": [{ "name": order[0] }, { "name": order[1] }], "interior": 0 });
        assert_eq!(told(haze(["fog", "haze"]), haze(["haze", "fog"])), "media.fog is 0 in one and 1 in the other");
        let fewer = json!({ "volume": { "radius": 0.1 } });
        assert_eq!(told(fewer, volume(json!(0.1))), "media.0.sigma is not there in one and [0.1,2.0] in the other");
    }

    /// Whatever a scene file says tells checkpoints apart, but for what no pixel depends on.
    #[test]
    fn settings_have_the_names_of_the_scene_file() {
        let of = |overrides: &[&str]| {
            let overrides: Vec<String> = overrides.iter().map(|text| text.to_string()).collect();
            let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/smoke.toml");
            Subject::new(&crate::scene::read(&path, &overrides).unwrap(), 1)
        };
        let plain = of(&[]);
        for name in ["film.width", "render.samples", "volume.kernel", "camera.fov", "photons.volume", "parts", PROGRAM]
        {
            assert!(plain.settings.contains_key(name), "{name} in {:#?}", plain.settings);
        }
        assert!(!plain.settings.keys().any(|name| name.contains("place")), "{:#?}", plain.settings);
        assert_eq!(
            plain.difference(&of(&["render.seed=7", "render.passes=3", "film.exposure=2", "title=\"a\""])),
            None
        );
        let narrow = plain.difference(&of(&["camera.fov=11"])).unwrap();
        assert!(narrow.starts_with("camera.fov is ") && narrow.ends_with("11.0 in the other"), "{narrow}");
    }
}
