//! `[compare]`: what a study file asks for.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::description::Document;
use super::table::{Item, Problems, Read, Table, join};
use super::text::text_of;
use super::tree::{self, Node, Value};
use crate::quantity;
use crate::{Error, Result};

/// What a study file says, checked as far as it can be without the scene. What it leaves out is `None` or empty.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Study {
    /// The scene file; `None`: the study is part of one.
    pub scene: Option<PathBuf>,
    /// Keys of the scene to replace for all variants, with values of TOML.
    pub set: Vec<(String, String)>,
    /// The variants to compare.
    pub variants: Vec<StudyVariant>,
    /// Seconds at which to measure, ascending.
    pub budgets: Option<Vec<f64>>,
    /// Camera samples per pixel at which to measure, ascending.
    pub samples: Option<Vec<u32>>,
    /// Seconds that a variant may take.
    pub time: Option<f64>,
    /// The number of seeds.
    pub seeds: Option<u32>,
    /// `path`, `photon`, `own`, or the file of a reference.
    pub reference: Option<StudyReference>,
    /// Keys of the scene to replace for a reference that is made, with values of TOML.
    pub reference_set: Vec<(String, String)>,
    /// The relative standard error that it should have.
    pub reference_error: Option<f64>,
    /// Seconds that it may take.
    pub reference_time: Option<f64>,
    /// Camera samples per pixel of variants' own limits.
    pub limit_samples: Option<u32>,
    /// Whether all variants gather from one map.
    pub same_map: Option<bool>,
    /// The layer to measure.
    pub layer: Option<String>,
    /// Parts of the image: name, then leftmost column, top row, width and height.
    pub regions: Vec<(String, [u32; 4])>,
    /// The key that is chosen such that variants take the time given.
    pub tune: Option<String>,
}

/// What errors are measured against.
#[derive(Clone, Debug, PartialEq)]
pub enum StudyReference {
    /// An image made by the path tracer.
    Path,
    /// An image made by photon mapping, of many passes.
    Photon,
    /// Each variant's own limit on the common map.
    Own,
    /// An image in a file.
    File(PathBuf),
}

/// A variant of a study.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct StudyVariant {
    /// The variant's name.
    pub name: String,
    /// The built-in variant it starts from, if not the scene as it is.
    pub of: Option<String>,
    /// Keys of the scene to replace, with values of TOML.
    pub set: Vec<(String, String)>,
    /// Numbers of camera samples per pixel to try when it is tuned.
    pub samples: Vec<u32>,
    /// The key that is chosen such that it takes the time given.
    pub tune: Option<String>,
    /// The variant whose time it gets.
    pub time: Option<String>,
    /// Keys of the scene to replace besides for the variant's own limit, with values of TOML.
    pub limit: Option<Vec<(String, String)>>,
}

impl StudyReference {
    /// A word, or the name of a file.
    pub fn of(text: &str, folder: &Path) -> StudyReference {
        match text {
            "path" => StudyReference::Path,
            "photon" => StudyReference::Photon,
            "own" => StudyReference::Own,
            file => StudyReference::File(folder.join(file)),
        }
    }
}

/// Reads the study that the file at `path` holds, and the text of the file; `None` if it holds none.
///
/// # Errors
/// [`Error::Asset`] if the file cannot be read or is no text; [`Error::Scene`] with one line for each mistake.
pub fn read_study(path: &Path) -> Result<(Option<Study>, String)> {
    let text = text_of(path)?;
    let document = Document { name: path.display().to_string(), text: text.clone() };
    let root = tree::parse(&Arc::new(document))?;
    let problems = Problems::default();
    let folder = path.parent().unwrap_or(Path::new(""));
    let table = Item::root(&root, &problems).table();
    let study = table.and_then(|table| {
        let study = table.get("compare", |item| study(&item.table()?, folder))?;
        if study.as_ref().is_some_and(|study| study.scene.is_some()) {
            // Whatever else stands here would be lost.
            table.get("title", Item::string)?;
            table.finish()?;
        }
        Ok(study)
    });
    problems.check()?;
    match study {
        Ok(study) => Ok((study, text)),
        // A value that could not be read has left a problem behind.
        Err(_) => Err(Error::Scene(format!("{}: cannot be read", path.display()))),
    }
}

/// Reads `[compare]` of a file in `folder`.
pub(super) fn study(table: &Table, folder: &Path) -> Read<Study> {
    let scene = table.get("scene", |item| Ok(item.file(folder, &["toml"])?.value));
    let set = table.get("set", settings);
    let variants = table.get("variants", |item| {
        let items = item.array("an array of names and tables")?;
        let variants: Vec<Read<StudyVariant>> = items.iter().map(variant).collect();
        Ok((items, variants.into_iter().collect::<Read<Vec<_>>>()?))
    });
    let budgets = table.get("budgets", |item| ascending(item, "an array of times", seconds));
    let samples = table.get("samples", |item| ascending(item, "an array of numbers of samples", |item| item.u32(1)));
    let time = table.get("time", seconds);
    let seeds = table.get("seeds", |item| item.u32(1));
    let reference = table.get("reference", |item| Ok(StudyReference::of(item.string()?, folder)));
    let reference_set = table.get("reference_set", settings);
    let reference_error = table.get("reference_error", |item| {
        if item.is_number() {
            item.positive()
        } else {
            item.string().and_then(|text| word(item, quantity::share(text)))
        }
    });
    let reference_time = table.get("reference_time", seconds);
    let limit_samples = table.get("limit_samples", |item| item.u32(2));
    let same_map = table.get("same_map", Item::boolean);
    let layer = table.get("layer", |item| item.string().map(str::to_owned));
    let regions = table.get("regions", |item| item.array("an array of tables")?.iter().map(region).collect());
    let tune = table.get("tune", |item| item.string().map(str::to_owned));
    table.finish()?;
    let variants: Vec<StudyVariant> = match variants? {
        None => Vec::new(),
        Some((items, variants)) => {
            check_names(&items, &variants)?;
            variants
        }
    };
    let (budgets, samples) = (budgets?, samples?);
    if budgets.is_some() && samples.is_some() {
        return Err(table.fail_at("samples", "`budgets` is given too; expected only one of them"));
    }
    Ok(Study {
        scene: scene?,
        set: set?.unwrap_or_default(),
        variants,
        budgets,
        samples,
        time: time?,
        seeds: seeds?,
        reference: reference?,
        reference_set: reference_set?.unwrap_or_default(),
        reference_error: reference_error?,
        reference_time: reference_time?,
        limit_samples: limit_samples?,
        same_map: same_map?,
        layer: layer?,
        regions: regions?.unwrap_or_default(),
        tune: tune?,
    })
}

fn word<T>(item: &Item, value: Result<T, String>) -> Read<T> {
    value.map_err(|expected| item.fail(expected))
}

/// A number of seconds, or a text with a unit.
fn seconds(item: &Item) -> Read<f64> {
    if item.is_number() {
        return item.positive();
    }
    word(item, quantity::time(item.string()?)).map(|time| time.as_secs_f64())
}

fn ascending<T: PartialOrd>(item: &Item, expected: &str, read: impl Fn(&Item) -> Read<T>) -> Read<Vec<T>> {
    let values: Vec<T> = item.array(expected)?.iter().map(read).collect::<Read<_>>()?;
    if values.is_empty() || values.windows(2).any(|pair| pair[0] >= pair[1]) {
        return Err(item.fail(format!("expected {expected}, each larger than the one before")));
    }
    Ok(values)
}

fn region(item: &Item) -> Read<(String, [u32; 4])> {
    let table = item.table()?;
    let name = table.require("name", |item| item.string().map(str::to_owned));
    let [x, y] = ["x", "y"].map(|key| table.require(key, |item| item.u32(0)));
    let [width, height] = ["width", "height"].map(|key| table.require(key, |item| item.u32(1)));
    table.finish()?;
    Ok((name?, [x?, y?, width?, height?]))
}

fn variant(item: &Item) -> Read<StudyVariant> {
    if !item.is_table() {
        let name = item.string()?.to_owned();
        return Ok(StudyVariant { name, ..StudyVariant::default() });
    }
    let table = item.table()?;
    let text = |key| table.get(key, |item| item.string().map(str::to_owned));
    let name = table.require("name", |item| item.string().map(str::to_owned));
    let of = text("of");
    let set = table.get("set", settings);
    let samples = table.get("samples", |item| match item.is_number() {
        true => Ok(vec![item.u32(1)?]),
        false => ascending(item, "a number of samples, or an array of them", |item| item.u32(1)),
    });
    let (tune, time) = (text("tune"), text("time"));
    let limit = table.get("limit", settings);
    table.finish()?;
    Ok(StudyVariant {
        name: name?,
        of: of?,
        set: set?.unwrap_or_default(),
        samples: samples?.unwrap_or_default(),
        tune: tune?,
        time: time?,
        limit: limit?,
    })
}

/// Whether a name can be part of a file's.
pub fn is_plain(name: &str) -> bool {
    let plain = |c: char| c.is_ascii_alphanumeric() || matches!(c, '-' | '_' | '.');
    !name.is_empty() && !name.starts_with('.') && name.len() <= 64 && name.chars().all(plain)
}

fn check_names(items: &[Item], variants: &[StudyVariant]) -> Read<()> {
    let mut result = Ok(());
    for (index, (item, variant)) in items.iter().zip(variants).enumerate() {
        let names: Vec<&str> = variants.iter().map(|variant| variant.name.as_str()).collect();
        if !is_plain(&variant.name) {
            result = Err(item.fail(format!(
                "{:?} is no name for a variant; expected letters, digits, `-`, `_` and `.`",
                variant.name
            )));
        } else if names[..index].contains(&variant.name.as_str()) {
            result = Err(item.fail("another variant has the same name"));
        }
        let Some(time) = &variant.time else { continue };
        match variants.iter().find(|other| other.name == *time) {
            None => result = Err(item.unknown_name("variant", time, &names)),
            Some(other) if other.time.is_some() => {
                result =
                    Err(item
                        .fail(format!("{time} itself gets the time of another; expected one with a time of its own")));
            }
            Some(_) => {}
        }
    }
    result
}

/// The leaves of a table, each by its dotted key, as `--set` takes them.
fn settings(item: &Item) -> Read<Vec<(String, String)>> {
    let mut found = Vec::new();
    for (key, item) in item.table()?.items() {
        leaves(key.to_owned(), item.node, &mut found);
    }
    Ok(found)
}

fn leaves(key: String, node: &Node, found: &mut Vec<(String, String)>) {
    match &node.value {
        Value::Table(entries) if !entries.is_empty() => {
            for entry in entries {
                leaves(join(&key, &entry.key), &entry.node, found);
            }
        }
        value => found.push((key, text(value))),
    }
}

/// A value as TOML.
fn text(value: &Value) -> String {
    let list = |parts: Vec<String>, [open, close]: [&str; 2]| format!("{open}{}{close}", parts.join(", "));
    match value {
        Value::Table(entries) => {
            let parts = entries.iter().map(|entry| format!("{} = {}", join("", &entry.key), text(&entry.node.value)));
            list(parts.collect(), ["{", "}"])
        }
        Value::Array(nodes) => list(nodes.iter().map(|node| text(&node.value)).collect(), ["[", "]"]),
        Value::String(string) => {
            let mut quoted = String::from('"');
            for c in string.chars() {
                match c {
                    '"' | '\\' => quoted.extend(['\\', c]),
                    c if c.is_control() => quoted.push_str(&format!("\\u{:04X}", c as u32)),
                    c => quoted.push(c),
                }
            }
            quoted + "\""
        }
        Value::Integer(number) => number.to_string(),
        Value::Float(number) => format!("{number:?}"),
        Value::Boolean(value) => value.to_string(),
        Value::Date(date) => date.clone(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Result<Study> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("study.toml");
        std::fs::write(&path, text).unwrap();
        let (study, _) = read_study(&path)?;
        let mut study = study.unwrap();
        study.scene = study.scene.map(|scene| scene.strip_prefix(folder.path()).unwrap().to_owned());
        Ok(study)
    }

    #[test]
    fn a_study_is_read_whole() {
        let study = read(
            r#"
            [compare]
            scene = "../a.toml"
            set = { "film.width" = 64, volume = { march = { step = "uniform" } } }
            budgets = [0.5, "1s", "1m"]
            seeds = 3
            reference = "own"
            reference_error = "2%"
            same_map = true
            regions = [{ name = "caustic", x = 1, y = 2, width = 3, height = 4 }]
            variants = [
                "beam",
                { name = "m", of = "point-uniform", set = { "media.\"a b\".sigma_s" = [0.1, 2] }, samples = [1, 4], tune = "volume.march.size", time = "beam", limit = { "volume.march.size" = 1e-7 } },
            ]
            "#,
        )
        .unwrap();
        let pair = |key: &str, value: &str| (key.to_string(), value.to_string());
        assert_eq!(study.scene.as_deref(), Some(Path::new("../a.toml")));
        assert_eq!(study.set, [pair("film.width", "64"), pair("volume.march.step", "\"uniform\"")]);
        assert_eq!(study.budgets, Some(vec![0.5, 1.0, 60.0]));
        assert_eq!((study.reference, study.reference_error), (Some(StudyReference::Own), Some(0.02)));
        assert_eq!(study.regions, [("caustic".to_string(), [1, 2, 3, 4])]);
        let [beam, m] = &study.variants[..] else { panic!() };
        assert_eq!((beam.name.as_str(), beam.samples.len()), ("beam", 0));
        assert_eq!(m.set, [pair("media.\"a b\".sigma_s", "[0.1, 2]")]);
        assert_eq!((&m.samples, m.time.as_deref()), (&vec![1, 4], Some("beam")));
        assert_eq!(m.limit, Some(vec![pair("volume.march.size", "1e-7")]));
    }

    #[test]
    fn mistakes_are_named_with_their_place() {
        for (text, expected) in [
            ("[compare]\nbudgets = [2, 1]", "compare.budgets: expected an array of times, each larger"),
            ("[compare]\nvariants = [{ set = {} }]", "compare.variants.0.name: is missing"),
            ("[compare]\nvariants = [\"a\", \"a\"]", "another variant has the same name"),
            ("[compare]\nvariants = [\"a/b\"]", "no name for a variant"),
            ("[compare]\nvariants = [{ name = \"a\", time = \"beem\" }, \"beam\"]", "did you mean `beam`?"),
            ("[compare]\nreference_eror = 1", "did you mean `reference_error`?"),
            ("[compare]\nscene = \"a.toml\"\n[film]\nwidth = 3", "film: unknown key"),
            ("[compare]\nbudgets = [1]\nsamples = [1]", "only one of them"),
        ] {
            let message = read(text).unwrap_err().to_string();
            assert!(message.contains(expected), "{text}: {message}");
        }
    }
}
