//! Typed reading of a tree of values. Every problem is noted with its place, and reading goes on, so
//! that one run shows as many mistakes as possible.

use std::cell::{Cell, RefCell};
use std::f64::consts::FRAC_PI_2;
use std::fmt::Display;
use std::path::{Path, PathBuf};

use super::description::{Located, Place};
use super::tree::{Entry, Node, Value};
use crate::math::{DVec3, Rgb};
use crate::{Error, Result};

/// A problem was noted; what was to be read cannot be.
#[derive(Clone, Copy, Debug)]
pub(super) struct Noted;

/// The largest coordinate: squares of coordinates and their products with distances stay finite.
const LARGEST: f64 = 1e100;

/// What reading a value gives.
pub(super) type Read<T> = std::result::Result<T, Noted>;

/// The problems found so far.
#[derive(Default)]
pub(super) struct Problems {
    kept: RefCell<Vec<Problem>>,
    others: Cell<usize>,
}

#[derive(Clone, PartialEq)]
struct Problem {
    message: String,
    /// Whether something is missing from the table that the place is.
    missing: bool,
    place: Place,
}

impl Problems {
    const KEPT: usize = 100;
    const SHOWN: usize = 20;

    /// Notes a problem with what stands at `place`.
    pub(super) fn note(&self, place: Place, message: impl Display) -> Noted {
        self.push(Problem { message: message.to_string(), missing: false, place })
    }

    /// Whether further problems are only counted.
    fn is_full(&self) -> bool {
        self.kept.borrow().len() >= Self::KEPT
    }

    fn push(&self, problem: Problem) -> Noted {
        let mut kept = self.kept.borrow_mut();
        if kept.len() >= Self::KEPT {
            self.others.set(self.others.get() + 1);
        } else if !kept.contains(&problem) {
            // What an instance takes over from its template is checked for each.
            kept.push(problem);
        }
        Noted
    }

    /// An error that holds all problems in the order of the file, each in a line and with the line of the file below, or none.
    pub(super) fn check(&self) -> Result<()> {
        let mut kept = self.kept.borrow().clone();
        if kept.is_empty() {
            return Ok(());
        }
        kept.sort_by_cached_key(|problem| problem.place.source.line_and_column().unwrap_or((usize::MAX, 0)));
        let others = self.others.get() + kept.len().saturating_sub(Self::SHOWN);
        let shown = kept.iter().take(Self::SHOWN);
        let line = |Problem { place, message, missing }: &Problem| {
            // What is missing stands nowhere.
            if *missing { format!("{place}: {message}") } else { place.told(message) }
        };
        let mut lines: Vec<String> = shown.map(line).collect();
        if others > 0 {
            lines.push(format!("and {others} more"));
        }
        Err(Error::Scene(lines.join("\n")))
    }
}

/// A value under the key it was reached by.
#[derive(Clone)]
pub(super) struct Item<'a> {
    pub(super) node: &'a Node,
    key: String,
    problems: &'a Problems,
}

impl<'a> Item<'a> {
    /// The whole of a scene file.
    pub(super) fn root(node: &'a Node, problems: &'a Problems) -> Self {
        Item { node, key: String::new(), problems }
    }

    /// Where the value stands.
    pub(super) fn place(&self) -> Place {
        Place { source: self.node.source.clone(), key: self.key.as_str().into() }
    }

    /// `value`, which was said here.
    pub(super) fn at<T>(&self, value: T) -> Located<T> {
        Located { value, place: self.place() }
    }

    /// Notes a problem with this value.
    pub(super) fn fail(&self, message: impl Display) -> Noted {
        self.problems.note(self.place(), message)
    }

    /// A problem that stands elsewhere.
    pub(super) fn fail_about(&self, place: &Place, message: impl Display) -> Noted {
        self.problems.note(place.clone(), message)
    }

    /// Notes that something else was expected than was found.
    pub(super) fn expected(&self, expected: impl Display) -> Noted {
        self.fail(format!("found {}; expected {expected}", found(&self.node.value)))
    }

    /// Notes that this asks for what is still to come; `what` ends in a verb.
    pub(super) fn unsupported(&self, what: impl Display) -> Noted {
        self.fail(format!("{what} not supported yet"))
    }

    /// A table, none of whose keys has been asked for.
    pub(super) fn table(&self) -> Read<Table<'a>> {
        match &self.node.value {
            Value::Table(entries) => Ok(Table { item: self.clone(), entries, known: RefCell::default() }),
            _ => Err(self.expected("a table")),
        }
    }

    pub(super) fn is_table(&self) -> bool {
        matches!(self.node.value, Value::Table(_))
    }

    /// The value under a key of this table, for who has yet to decide how to read it; the key does not count as asked for.
    pub(super) fn peek(&self, key: &str) -> Option<&'a Value> {
        let Value::Table(entries) = &self.node.value else { return None };
        entries.iter().find(|entry| entry.key == key).map(|entry| &entry.node.value)
    }

    pub(super) fn is_number(&self) -> bool {
        self.any_number().is_some()
    }

    /// The items of an array, named by their index, or by their `name` if they are tables that have one.
    pub(super) fn array(&self, expected: &str) -> Read<Vec<Item<'a>>> {
        let Value::Array(nodes) = &self.node.value else { return Err(self.expected(expected)) };
        let item = |(index, node): (usize, &'a Node)| {
            let key = match name_of(node) {
                Some(name) => join(&self.key, name),
                None => join(&self.key, &index.to_string()),
            };
            Item { node, key, problems: self.problems }
        };
        Ok(nodes.iter().enumerate().map(item).collect())
    }

    pub(super) fn string(&self) -> Read<&'a str> {
        match &self.node.value {
            Value::String(text) => Ok(text),
            _ => Err(self.expected("a string")),
        }
    }

    pub(super) fn located_string(&self) -> Read<Located<String>> {
        self.string().map(|text| self.at(text.to_owned()))
    }

    pub(super) fn boolean(&self) -> Read<bool> {
        match self.node.value {
            Value::Boolean(value) => Ok(value),
            _ => Err(self.expected("true or false")),
        }
    }

    /// A file name with one of `endings`, resolved against `folder`.
    pub(super) fn file(&self, folder: &Path, endings: &[&str]) -> Read<Located<PathBuf>> {
        let text = self.string()?;
        let lower = text.to_ascii_lowercase();
        if !endings.iter().any(|known| lower.strip_suffix(known).is_some_and(|rest| rest.ends_with('.'))) {
            let endings: Vec<String> = endings.iter().map(|ending| format!(".{ending}")).collect();
            return Err(self.expected(format!("the name of a file that ends in {}", endings.join(" or "))));
        }
        Ok(self.at(folder.join(text)))
    }

    /// A finite number that is accepted; `expected` says which are.
    fn number_where(&self, expected: &str, accepts: impl Fn(f64) -> bool) -> Read<f64> {
        match self.any_number() {
            Some(number) if number.is_finite() && accepts(number) => Ok(number),
            _ => Err(self.expected(expected)),
        }
    }

    fn any_number(&self) -> Option<f64> {
        match self.node.value {
            Value::Integer(number) => Some(number as f64),
            Value::Float(number) => Some(number),
            _ => None,
        }
    }

    pub(super) fn number(&self) -> Read<f64> {
        self.number_where("a finite number", |_| true)
    }

    pub(super) fn positive(&self) -> Read<f64> {
        self.number_where("a finite number above 0", |x| x > 0.0)
    }

    pub(super) fn non_negative(&self) -> Read<f64> {
        self.number_where("a finite number of at least 0", |x| x >= 0.0)
    }

    /// A number above `low` and below `high`.
    pub(super) fn between(&self, low: f64, high: f64) -> Read<f64> {
        self.number_where(&format!("a number above {low} and below {high}"), |x| low < x && x < high)
    }

    /// A number of at least `low`, below `high`.
    pub(super) fn half_open(&self, low: f64, high: f64) -> Read<f64> {
        self.number_where(&format!("a number of at least {low} and below {high}"), |x| low <= x && x < high)
    }

    /// A number above `low`, at most `high`.
    pub(super) fn above_up_to(&self, low: f64, high: f64) -> Read<f64> {
        self.number_where(&format!("a number above {low} and at most {high}"), |x| low < x && x <= high)
    }

    /// A number from `low` to `high`, both allowed.
    pub(super) fn within(&self, low: f64, high: f64) -> Read<f64> {
        self.number_where(&format!("a number from {low} to {high}"), |x| low <= x && x <= high)
    }

    /// An angle in radians, from 0 to a right one.
    pub(super) fn slope(&self) -> Read<f64> {
        self.number_where("radians from 0 to π/2 (1.5708)", |x| (0.0..=FRAC_PI_2).contains(&x))
    }

    /// An integer from `low` to `high`, both allowed.
    pub(super) fn integer<T: TryFrom<i128>>(&self, low: i128, high: i128) -> Read<T> {
        let number = match self.node.value {
            Value::Integer(number) if (low..=high).contains(&number) => T::try_from(number).ok(),
            _ => None,
        };
        number.ok_or_else(|| self.expected(format!("an integer from {low} to {high}")))
    }

    pub(super) fn u32(&self, low: u32) -> Read<u32> {
        self.integer(low.into(), u32::MAX.into())
    }

    pub(super) fn u64(&self, low: u64) -> Read<u64> {
        self.integer(low.into(), u64::MAX.into())
    }

    /// A length above 0 whose square is neither 0 nor infinite.
    pub(super) fn length(&self) -> Read<f64> {
        self.number_where("a number above 0 (from 1e-100 to 1e100)", |x| (1.0 / LARGEST..=LARGEST).contains(&x))
    }

    /// A length as [`Item::length`] takes it, or 0.
    pub(super) fn length_or_zero(&self) -> Read<f64> {
        let accepts = |x| x == 0.0 || (1.0 / LARGEST..=LARGEST).contains(&x);
        self.number_where("0, or a number above 0 (from 1e-100 to 1e100)", accepts)
    }

    /// A number that a length may be, with either sign.
    pub(super) fn coordinate(&self) -> Read<f64> {
        self.number_where("a number from -1e100 to 1e100", |x| (-LARGEST..=LARGEST).contains(&x))
    }

    /// `[x, y, z]`
    pub(super) fn vector(&self) -> Read<DVec3> {
        let expected = "three numbers, [x, y, z]";
        let items = self.array(expected)?;
        let [x, y, z] = items.as_slice() else { return Err(self.expected(expected)) };
        let (x, y, z) = (x.coordinate(), y.coordinate(), z.coordinate());
        Ok(DVec3::new(x?, y?, z?))
    }

    /// `[x, y, z]`, not all 0.
    pub(super) fn nonzero_vector(&self) -> Read<DVec3> {
        let vector = self.vector()?;
        if vector == DVec3::ZERO { Err(self.expected("a vector that is not 0")) } else { Ok(vector) }
    }

    /// `[x, y, z]`, not all 0, brought to unit length.
    pub(super) fn direction(&self) -> Read<DVec3> {
        let vector = self.nonzero_vector()?;
        unit(vector).ok_or_else(|| self.expected("a vector that is not 0"))
    }

    /// `[r, g, b]`, or one number for all channels.
    fn colour_where(&self, expected: &str, accepts: impl Fn(f64) -> bool) -> Read<Rgb> {
        if self.is_number() {
            return Ok(Rgb::splat(self.number_where(expected, accepts)?));
        }
        let whole = format!("{expected}, or three of them, [r, g, b]");
        let items = self.array(&whole)?;
        let [r, g, b] = items.as_slice() else { return Err(self.expected(whole)) };
        let [r, g, b] = [r, g, b].map(|channel| channel.number_where(expected, &accepts));
        Ok(Rgb::new(r?, g?, b?))
    }

    /// A colour without negative channels.
    pub(super) fn colour(&self) -> Read<Rgb> {
        self.colour_where("a finite number of at least 0", |x| x >= 0.0)
    }

    /// A colour whose channels are above 0.
    pub(super) fn positive_colour(&self) -> Read<Rgb> {
        self.colour_where("a finite number above 0", |x| x > 0.0)
    }

    /// A colour whose channels are in \[0, 1\].
    pub(super) fn share(&self) -> Read<Rgb> {
        self.colour_where("a number from 0 to 1", |x| (0.0..=1.0).contains(&x))
    }

    /// One of `options` by name; those of `later` are refused as not supported yet.
    pub(super) fn choice<T: Copy>(&self, options: &[(&str, T)], later: &[&str]) -> Read<T> {
        let names = || options.iter().map(|(name, _)| *name).chain(later.iter().copied());
        let list = || names().map(|name| format!("{name:?}")).collect::<Vec<_>>().join(", ");
        let Value::String(text) = &self.node.value else { return Err(self.expected(format!("one of {}", list()))) };
        if let Some((_, value)) = options.iter().find(|(name, _)| name == text) {
            return Ok(*value);
        }
        if later.contains(&text.as_str()) {
            return Err(self.unsupported(format!("{text:?} is")));
        }
        Err(self.expected(format!("one of {}{}", list(), did_you_mean(text, names()))))
    }

    /// The index in `names` of the one this refers to; `kind` is what they are, in the singular.
    pub(super) fn reference(&self, kind: &str, names: &[&str]) -> Read<usize> {
        let text = self.string()?;
        names.iter().position(|name| *name == text).ok_or_else(|| self.unknown_name(kind, text, names))
    }

    /// A reference to what is not among `names`.
    pub(super) fn unknown_name(&self, kind: &str, text: &str, names: &[&str]) -> Noted {
        // A problem that is only counted needs no suggestion.
        let names = if self.problems.is_full() { &[] } else { names };
        let suggestion = did_you_mean(text, names.iter().copied());
        let known = listed(names, "there are", "there is none");
        self.fail(format!("no {kind} is named {}{suggestion} ({known})", quoted(text)))
    }
}

/// A table; it remembers which keys were asked for.
pub(super) struct Table<'a> {
    item: Item<'a>,
    entries: &'a [Entry],
    known: RefCell<Vec<&'static str>>,
}

impl<'a> Table<'a> {
    /// Where the table stands.
    pub(super) fn place(&self) -> Place {
        self.item.place()
    }

    /// The place of a key that may be missing.
    pub(super) fn place_of(&self, key: &str) -> Place {
        let source = self.entries.iter().find(|entry| entry.key == key).map(|entry| &entry.node.source);
        let source = source.unwrap_or(&self.item.node.source).clone();
        Place { source, key: join(&self.item.key, key).as_str().into() }
    }

    /// The items of a table whose keys are names.
    pub(super) fn items(&self) -> Vec<(&'a str, Item<'a>)> {
        self.entries.iter().map(|entry| (entry.key.as_str(), self.item_of(entry))).collect()
    }

    fn item_of(&self, entry: &'a Entry) -> Item<'a> {
        Item { node: &entry.node, key: join(&self.item.key, &entry.key), problems: self.item.problems }
    }

    /// The item under `key`, if there is one; the key counts as asked for.
    pub(super) fn find(&self, key: &'static str) -> Option<Item<'a>> {
        self.known.borrow_mut().push(key);
        self.entries.iter().find(|entry| entry.key == key).map(|entry| self.item_of(entry))
    }

    /// What `read` makes of the item under `key`, if there is one.
    pub(super) fn get<T>(&self, key: &'static str, read: impl FnOnce(&Item<'a>) -> Read<T>) -> Read<Option<T>> {
        self.find(key).map(|item| read(&item)).transpose()
    }

    /// What `read` makes of the item under `key`; `default` if there is none.
    pub(super) fn get_or<T>(&self, key: &'static str, default: T, read: impl FnOnce(&Item<'a>) -> Read<T>) -> Read<T> {
        Ok(self.get(key, read)?.unwrap_or(default))
    }

    /// What `read` makes of the item under `key`, which must be there.
    pub(super) fn require<T>(&self, key: &'static str, read: impl FnOnce(&Item<'a>) -> Read<T>) -> Read<T> {
        self.get(key, read)?.ok_or_else(|| self.missing(key, "is missing"))
    }

    /// A problem with what is not there: a `key`, or one of several where that is empty. A misspelt key
    /// in the same table explains it and takes its place.
    pub(super) fn missing(&self, key: &str, message: impl Display) -> Noted {
        let place = if key.is_empty() { self.place() } else { self.place_of(key) };
        self.item.problems.push(Problem { message: message.to_string(), missing: true, place })
    }

    /// The table under `key`; an empty one if there is none.
    pub(super) fn section(&self, key: &'static str) -> Read<Table<'a>> {
        let missing = || {
            let item = Item { node: self.item.node, key: join(&self.item.key, key), problems: self.item.problems };
            Table { item, entries: &[], known: RefCell::default() }
        };
        Ok(self.get(key, Item::table)?.unwrap_or_else(missing))
    }

    /// Notes a problem with the table as a whole.
    pub(super) fn fail(&self, message: impl Display) -> Noted {
        self.item.fail(message)
    }

    /// A problem with a key that may be missing.
    pub(super) fn fail_at(&self, key: &str, message: impl Display) -> Noted {
        self.item.problems.note(self.place_of(key), message)
    }

    /// Refuses the keys nobody asked for.
    pub(super) fn finish(&self) -> Read<()> {
        let known = self.known.borrow();
        let mut result = Ok(());
        for entry in self.entries.iter().filter(|entry| !known.contains(&entry.key.as_str())) {
            let place = Place { source: entry.source.clone(), key: self.item_of(entry).key.as_str().into() };
            let suggestion = did_you_mean(&entry.key, known.iter().copied());
            let keys = listed(&known, "keys here:", "no keys are expected here");
            result = Err(self.item.problems.note(place, format!("unknown key{suggestion} ({keys})")));
        }
        if result.is_err() {
            let here = &self.item.node.source;
            self.item.problems.kept.borrow_mut().retain(|problem| !problem.missing || problem.place.source != *here);
        }
        result
    }
}

/// The `name` of a table.
pub(super) fn name_of(node: &Node) -> Option<&str> {
    let Value::Table(entries) = &node.value else { return None };
    entries.iter().find(|entry| entry.key == "name").and_then(|entry| match &entry.node.value {
        Value::String(name) => Some(name.as_str()),
        _ => None,
    })
}

/// A dotted key with one more part.
pub(super) fn join(key: &str, part: &str) -> String {
    let bare = !part.is_empty() && part.chars().all(|c| c.is_ascii_alphanumeric() || c == '_' || c == '-');
    let part = if bare { part.to_owned() } else { quoted(part) };
    if key.is_empty() { part } else { format!("{key}.{part}") }
}

/// `vector` at unit length, if that can be had.
pub(super) fn unit(vector: DVec3) -> Option<DVec3> {
    let largest = vector.abs().max_element();
    // Scaled first: the squares of large and small numbers do not fit into f64.
    (largest > 0.0 && largest.is_finite()).then(|| (vector / largest).normalize())
}

/// `; did you mean …?` for the candidate nearest to `name`, or nothing if all are far.
pub(super) fn did_you_mean<'a>(name: &str, candidates: impl Iterator<Item = &'a str>) -> String {
    // Bounds on the work, where names or mistakes are many.
    const LONGEST: usize = 64;
    const MOST: usize = 1000;
    if name.len() > LONGEST {
        return String::new();
    }
    let plain = |text: &str| text.to_lowercase().replace('-', "_");
    let name = plain(name);
    let near = candidates.take(MOST).filter(|candidate| candidate.len() <= LONGEST).filter_map(|candidate| {
        let distance = strsim::osa_distance(&name, &plain(candidate));
        (distance <= (candidate.chars().count().max(name.chars().count()) / 3).max(1)).then_some((distance, candidate))
    });
    near.min_by_key(|(distance, _)| *distance).map_or_else(String::new, |(_, best)| format!("; did you mean `{best}`?"))
}

fn listed(names: &[&str], lead: &str, none: &str) -> String {
    const SHOWN: usize = 24;
    match names {
        [] => none.to_owned(),
        _ if names.len() > SHOWN => format!("{lead} {}, … {} in all", names[..SHOWN].join(", "), names.len()),
        _ => format!("{lead} {}", names.join(", ")),
    }
}

fn quoted(text: &str) -> String {
    const SHOWN: usize = 64;
    match text.char_indices().nth(SHOWN) {
        Some((end, _)) => format!("{:?}…", &text[..end]),
        None => format!("{text:?}"),
    }
}

/// A value as a message names it.
fn found(value: &Value) -> String {
    match value {
        Value::Table(_) => "a table".to_owned(),
        Value::Array(items) if items.len() <= 4 => {
            let item = |item: &Node| match &item.value {
                Value::Array(_) => "[…]".to_owned(),
                value => found(value),
            };
            format!("[{}]", items.iter().map(item).collect::<Vec<_>>().join(", "))
        }
        Value::Array(items) => format!("an array of {}", items.len()),
        Value::String(text) => quoted(text),
        Value::Integer(number) => number.to_string(),
        Value::Float(number) if number.is_nan() => "nan".to_owned(),
        Value::Float(number) => format!("{number:?}"),
        Value::Boolean(value) => value.to_string(),
        Value::Date(date) => format!("the date {date}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_near_names_are_suggested() {
        let keys = ["sigma_s", "sigma_a", "g", "center"];
        let suggest = |name| did_you_mean(name, keys.into_iter());
        assert_eq!(suggest("sgima_a"), "; did you mean `sigma_a`?");
        assert_eq!(suggest("Sigma-S"), "; did you mean `sigma_s`?");
        assert_eq!(suggest("centre"), "; did you mean `center`?");
        assert_eq!(suggest("albedo"), "");
        assert_eq!(suggest(&"sigma_s".repeat(1000)), "");
    }

    #[test]
    fn keys_are_joined_as_toml_reads_them() {
        assert_eq!(join("", "media"), "media");
        assert_eq!(join("media", "fog-2"), "media.fog-2");
        assert_eq!(join("media", "my fog"), "media.\"my fog\"");
        assert_eq!(join("media", ""), "media.\"\"");
    }
}
