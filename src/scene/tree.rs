//! The text of a scene file as a tree of values that remember where they stand.

use std::sync::Arc;

use toml::de::{DeTable, DeValue};

use super::description::{Document, Place, Source};
use crate::Result;

/// A value and where it stands.
#[derive(Clone)]
pub(super) struct Node {
    pub(super) value: Value,
    pub(super) source: Source,
}

/// A value of TOML.
#[derive(Clone)]
pub(super) enum Value {
    Table(Vec<Entry>),
    Array(Vec<Node>),
    String(String),
    Integer(i128),
    Float(f64),
    Boolean(bool),
    Date(String),
}

/// A key of a table and its value.
#[derive(Clone)]
pub(super) struct Entry {
    pub(super) key: String,
    pub(super) source: Source,
    pub(super) node: Node,
}

/// Where the text is no valid TOML, and why.
type Flaw = (Source, String);

/// Reads the text of a scene file; the root is a table.
pub(super) fn parse(document: &Arc<Document>) -> Result<Node> {
    let at = |offset: usize| Source::File { offset, document: document.clone() };
    let tree = match DeTable::parse(&document.text) {
        Ok(root) => convert(DeValue::Table(root.into_inner()), 0, &at),
        Err(error) => Err(syntax_flaw(&error, &at)),
    };
    tree.map_err(|(source, message)| Place { source, key: "".into() }.error(message))
}

/// Reads the text of one value, every part of which is said to stand at `source`.
pub(super) fn parse_value(text: &str, source: &Source) -> Result<Node, String> {
    let at = |_| source.clone();
    let tree = match DeValue::parse(text) {
        Ok(value) => convert(value.into_inner(), 0, &at),
        Err(error) => Err(syntax_flaw(&error, &at)),
    };
    tree.map_err(|(_, message)| message)
}

fn convert(value: DeValue, offset: usize, at: &impl Fn(usize) -> Source) -> Result<Node, Flaw> {
    let too_large = |text: &str, what: &str| (at(offset), format!("{text} does not fit into {what}"));
    let value = match value {
        DeValue::String(text) => Value::String(text.into_owned()),
        DeValue::Integer(number) => match i128::from_str_radix(number.as_str(), number.radix()) {
            Ok(number) => Value::Integer(number),
            Err(_) => return Err(too_large(number.as_str(), "an integer")),
        },
        DeValue::Float(number) => match number.as_str().parse::<f64>() {
            // Only what is written out as inf or nan ends in a letter.
            Ok(parsed) if parsed.is_finite() || number.as_str().ends_with(['f', 'n']) => Value::Float(parsed),
            _ => return Err(too_large(number.as_str(), "a 64-bit floating-point number")),
        },
        DeValue::Boolean(value) => Value::Boolean(value),
        DeValue::Datetime(date) => Value::Date(date.to_string()),
        DeValue::Array(items) => {
            let items = items.into_iter().map(|item| {
                let offset = item.span().start;
                convert(item.into_inner(), offset, at)
            });
            Value::Array(items.collect::<Result<_, _>>()?)
        }
        DeValue::Table(table) => Value::Table(convert_table(table, at)?),
    };
    Ok(Node { value, source: at(offset) })
}

/// The parser sorts by key; the order of the file is restored.
fn convert_table(table: DeTable, at: &impl Fn(usize) -> Source) -> Result<Vec<Entry>, Flaw> {
    let mut pairs: Vec<_> = table.into_iter().collect();
    pairs.sort_by_key(|(key, _)| key.span().start);
    let entries = pairs.into_iter().map(|(key, value)| {
        let (key_offset, offset) = (key.span().start, value.span().start);
        let node = convert(value.into_inner(), offset, at)?;
        Ok(Entry { key: key.into_inner().into_owned(), source: at(key_offset), node })
    });
    entries.collect()
}

fn syntax_flaw(error: &toml::de::Error, at: &impl Fn(usize) -> Source) -> Flaw {
    let offset = error.span().map_or(0, |span| span.start);
    (at(offset), format!("not valid TOML: {}", error.message()))
}
