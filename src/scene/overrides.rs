//! `--set key=value`: a value of the scene file replaced from the command line.

use std::sync::Arc;

use toml::de::{DeTable, DeValue};

use super::description::{Place, Source};
use super::table::{Problems, did_you_mean, join, name_of};
use super::tree::{Entry, Node, Value, parse_value};

/// Applies `text`, `key=value`, to the tree of a scene file. The key is dotted as in TOML; elements of
/// arrays are named by their index from 0 or by their `name`; tables that are missing are created. The
/// value is one of TOML, or else a string without its quotes.
pub(super) fn apply(root: &mut Node, text: &str, problems: &Problems) {
    let source = Source::Override(Arc::from(text));
    let note = |key: &str, message: String| {
        problems.note(Place { source: source.clone(), key: key.into() }, message);
    };
    let Some((key, value)) = split(text) else {
        return note("", "expected key=value, for example film.width=128".to_owned());
    };
    let parts = match parts_of(key) {
        Ok(parts) => parts,
        Err(message) => return note("", message),
    };
    let value = match value_of(value, &source) {
        Ok(value) => value,
        Err(message) => return note("", message),
    };
    match follow(root, &parts, &source) {
        Ok(node) => *node = value,
        Err((key, message)) => note(&key, message),
    }
}

/// Where a dotted key leads; tables that are missing are created, said at `source`, and so is what it leads to, empty. On
/// failure, the key that leads nowhere and why.
pub(super) fn lead<'n>(root: &'n mut Node, key: &str, source: &Source) -> Result<&'n mut Node, (String, String)> {
    let parts = parts_of(key).map_err(|message| (String::new(), message))?;
    follow(root, &parts, source)
}

fn parts_of(key: &str) -> Result<Vec<String>, String> {
    key_parts(key).ok_or_else(|| {
        format!(
            "{key:?} is not a dotted key, for example media.fog.sigma_s; other characters than letters, digits, - and _ need quotes"
        )
    })
}

/// At the first `=` outside quotes.
fn split(text: &str) -> Option<(&str, &str)> {
    let mut quote = None;
    let at = text.find(|c| {
        match quote {
            Some(open) if c == open => quote = None,
            None if c == '"' || c == '\'' => quote = Some(c),
            _ => {}
        }
        c == '=' && quote.is_none()
    })?;
    Some((text[..at].trim(), text[at + 1..].trim()))
}

fn key_parts(key: &str) -> Option<Vec<String>> {
    let line = format!("{key} = 0");
    let mut table = DeTable::parse(&line).ok()?.into_inner();
    let mut parts = Vec::new();
    loop {
        let mut pairs = table.into_iter();
        let (Some((key, value)), None) = (pairs.next(), pairs.next()) else { return None };
        parts.push(key.into_inner().into_owned());
        match value.into_inner() {
            DeValue::Table(inner) => table = inner,
            DeValue::Integer(_) => return Some(parts),
            _ => return None,
        }
    }
}

fn value_of(text: &str, source: &Source) -> Result<Node, String> {
    match parse_value(text, source) {
        Ok(value) => Ok(value),
        Err(_) if text.is_empty() => Err("expected a value after `=`".to_owned()),
        Err(message) if text.starts_with(['"', '\'', '[', '{']) => Err(message),
        Err(_) => Ok(Node { value: Value::String(text.to_owned()), source: source.clone() }),
    }
}

/// Where `parts` lead, as [`lead`].
fn follow<'n>(root: &'n mut Node, parts: &[String], source: &Source) -> Result<&'n mut Node, (String, String)> {
    let mut node = root;
    let mut key = String::new();
    for part in parts {
        let parent = std::mem::take(&mut key);
        key = join(&parent, part);
        node = match &mut node.value {
            Value::Table(entries) => {
                let index = entries.iter().position(|entry| entry.key == *part).unwrap_or_else(|| {
                    let node = Node { value: Value::Table(Vec::new()), source: source.clone() };
                    entries.push(Entry { key: part.clone(), source: source.clone(), node });
                    entries.len() - 1
                });
                &mut entries[index].node
            }
            Value::Array(nodes) => match element(nodes, part) {
                Ok(index) => &mut nodes[index],
                Err(message) => return Err((key, message)),
            },
            _ => return Err((key, format!("{parent} is a single value that has no keys"))),
        };
    }
    Ok(node)
}

fn element(nodes: &[Node], part: &str) -> Result<usize, String> {
    let by_index = part.parse().ok().filter(|&index| index < nodes.len());
    let by_name = || nodes.iter().position(|node| name_of(node) == Some(part));
    by_index.or_else(by_name).ok_or_else(|| {
        let count = match nodes.len() {
            0 => "there are none".to_owned(),
            n => format!("expected a name or an index from 0 to {}", n - 1),
        };
        format!("no such element{}; {count}", did_you_mean(part, nodes.iter().filter_map(name_of)))
    })
}
