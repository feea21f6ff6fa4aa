//! The manual of scene files: every key that the reader knows, with its type, unit, default, meaning and cost.
//!
//! Tests hold it to the reader: a table has the keys that the reader asks it for and no others, defaults are those of the reader, and
//! every example can be read. A new key is a line here, beside its line in the reader.

mod form;
mod lights;
mod materials;
mod media;
mod schema;
mod settings;
mod shapes;
mod studies;
#[cfg(test)]
mod tests;

/// A table of scene files.
#[derive(Clone, Copy, Debug)]
pub struct Section {
    /// Its dotted path: `*` stands for a name, or for a number in a list. Empty for the file itself.
    pub path: &'static str,
    /// The value of `type` (of textures: `texture`) whose keys these are; empty for keys of every kind.
    pub kind: &'static str,
    /// What it is.
    pub about: &'static str,
    /// A part of a scene file that has it; empty for what only comes with a kind.
    pub example: &'static str,
    /// Its keys.
    pub keys: &'static [Key],
}

/// A key of a table.
#[derive(Clone, Copy, Debug)]
pub struct Key {
    /// Its name.
    pub name: &'static str,
    /// Which values it takes.
    pub value: Form,
    /// The unit of that; empty for none.
    pub unit: &'static str,
    /// What holds without it.
    pub default: Otherwise,
    /// What it does.
    pub about: &'static str,
    /// What it costs, in time, memory or error; empty if nothing to speak of.
    pub cost: &'static str,
    /// Keys that have to do with it.
    pub see: &'static [&'static str],
}

/// What holds where a key is not given.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Otherwise {
    /// It must be given.
    Required,
    /// This value, as scene files say it.
    Is(&'static str),
    /// What is chosen, in words.
    Chosen(&'static str),
    /// Nothing.
    None,
}

pub use form::{Form, Range};
pub use schema::schema;

use Otherwise::{Chosen, Is, None as Nothing, Required};

impl Key {
    const fn new(name: &'static str, value: Form, default: Otherwise, about: &'static str) -> Key {
        Key { name, value, unit: "", default, about, cost: "", see: &[] }
    }

    const fn unit(self, unit: &'static str) -> Key {
        Key { unit, ..self }
    }

    const fn cost(self, cost: &'static str) -> Key {
        Key { cost, ..self }
    }

    const fn see(self, see: &'static [&'static str]) -> Key {
        Key { see, ..self }
    }
}

/// All sections, in the order of the manual.
pub fn sections() -> impl Iterator<Item = &'static Section> {
    [
        settings::SCENE,
        media::SECTIONS,
        materials::SECTIONS,
        shapes::SECTIONS,
        lights::SECTIONS,
        settings::SECTIONS,
        studies::SECTIONS,
    ]
    .into_iter()
    .flatten()
}

/// What the manual has to say of what was asked for.
#[derive(Clone, Debug)]
pub enum Found {
    /// Keys, each with its section.
    Keys(Vec<(&'static Section, &'static Key)>),
    /// Tables of one path.
    Sections(Vec<&'static Section>),
    /// Nothing; with the nearest that there is.
    Nothing(Option<String>),
}

impl Section {
    /// The dotted path of one of its keys.
    pub fn path_of(&self, key: &Key) -> String {
        if self.path.is_empty() { key.name.to_string() } else { format!("{}.{}", self.path, key.name) }
    }
}

/// Looks up a key (`volume.neighbours`, `media.fog.phase.g`, `media.*.phase.g`), a table (`volume`), all keys of one (`render.*`), or keys
/// by the end of their path (`neighbours`).
pub fn find(asked: &str) -> Found {
    let parts: Vec<&str> = asked.split('.').collect();
    let tables = sections().filter(|section| !section.path.is_empty());
    let (named, like): (Vec<_>, Vec<_>) =
        tables.filter(|section| is_path(section.path, &parts)).partition(|section| section.path == asked);
    let keys: Vec<_> = all_keys().filter(|(section, key)| is_path(&section.path_of(key), &parts)).collect();
    // Of a path that ends in a star, and is none of a table, the keys are meant.
    let means_keys = parts.ends_with(&["*"]) && !keys.is_empty();
    match (named.is_empty(), like.is_empty() || means_keys, keys.is_empty()) {
        (false, ..) => return Found::Sections(named),
        (true, false, _) => return Found::Sections(like),
        (true, true, false) => return Found::Keys(keys),
        (true, true, true) => {}
    }
    let ends = |path: String| {
        let whole: Vec<&str> = path.split('.').collect();
        whole.ends_with(&parts)
    };
    let keys: Vec<_> = all_keys().filter(|(section, key)| ends(section.path_of(key))).collect();
    if keys.is_empty() { Found::Nothing(nearest(asked)) } else { Found::Keys(keys) }
}

/// All that [`find`] finds by its whole path: tables and keys, some of them several times.
pub fn paths() -> impl Iterator<Item = String> {
    let tables = sections().filter(|section| !section.path.is_empty()).map(|section| section.path.to_string());
    tables.chain(all_keys().map(|(section, key)| section.path_of(key)))
}

fn all_keys() -> impl Iterator<Item = (&'static Section, &'static Key)> {
    sections().flat_map(|section| section.keys.iter().map(move |key| (section, key)))
}

/// Whether a path of the manual is the one asked for: where that has `*`, anything may stand, or nothing.
fn is_path(path: &str, asked: &[&str]) -> bool {
    let parts: Vec<&str> = path.split('.').collect();
    is_way(&parts, asked)
}

fn is_way(parts: &[&str], asked: &[&str]) -> bool {
    match (parts, asked) {
        ([], []) => true,
        (["*", rest @ ..], _) => asked.split_first().is_some_and(|(_, on)| is_way(rest, on)) || is_way(rest, asked),
        ([part, rest @ ..], [first, on @ ..]) => (part == first || *first == "*") && is_way(rest, on),
        _ => false,
    }
}

/// The path nearest to what was asked for, or the key of that name; `None` if all are far.
fn nearest(asked: &str) -> Option<String> {
    // What is longer is no misspelt key.
    const LONGEST: usize = 100;
    if asked.len() > LONGEST {
        return None;
    }
    let last = asked.rsplit('.').next().unwrap_or(asked);
    let distance = |path: &str, name: &str| {
        let whole = strsim::osa_distance(asked, &path.replace(".*", ""));
        let named = if asked.contains('.') { usize::MAX } else { strsim::osa_distance(last, name) };
        whole.min(named)
    };
    let tables = sections().filter(|section| !section.path.is_empty());
    let tables = tables.map(|section| (distance(section.path, section.path), section.path.to_string()));
    let keys = all_keys().map(|(section, key)| (distance(&section.path_of(key), key.name), section.path_of(key)));
    let (off, path) = keys.chain(tables).min_by_key(|(off, _)| *off)?;
    (off <= (asked.chars().count() / 3).max(1)).then_some(path)
}
