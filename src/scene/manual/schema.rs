//! The manual as a JSON schema, by which editors complete and check scene files while they are written.

use serde_json::{Map, Value, json};

use super::form::{Bounds, Form, Range};
use super::{Key, Otherwise, Section, sections};
use crate::scene::description::Source;
use crate::scene::tree::{self, Node};

/// Parts of mixtures: phase functions with a weight, but no mixtures.
const LOBES: &str = "media.*.phase.lobes.*";

/// A JSON schema (draft 7) of scene files and studies. It allows whatever the reader does, and tells keys that do not exist, wrong types and
/// numbers out of range; what depends on several keys, and on other files, is left to the reader.
pub fn schema() -> Value {
    let mut definitions = Map::new();
    for section in sections().filter(|section| !section.path.is_empty()) {
        definitions.entry(section.path).or_insert_with(|| table(section.path));
    }
    let mut schema = table("");
    schema["$schema"] = "http://json-schema.org/draft-07/schema#".into();
    schema["title"] = "a scene of volpm".into();
    schema["definitions"] = definitions.into();
    // A study of another scene has no camera of its own.
    schema["required"] = json!([]);
    schema["anyOf"] = json!([
        { "required": ["camera"] },
        { "required": ["compare"], "properties": { "compare": { "required": ["scene"] } } },
    ]);
    schema
}

/// A table of that path, of whatever kind.
fn table(path: &str) -> Value {
    let of = |path| sections().filter(move |section| section.path == path);
    if path != LOBES {
        return kinds(of(path), &[]);
    }
    let keys = of(path).flat_map(|section| section.keys);
    let weight: Vec<&Key> = keys.filter(|key| !matches!(key.value, Form::Kind)).collect();
    kinds(of("media.*.phase").filter(|section| section.kind != "mixture"), &weight)
}

/// A table of one of these kinds, with the keys that all have, and more.
fn kinds<'a>(sections: impl Iterator<Item = &'a Section>, more: &[&'a Key]) -> Value {
    let (shared, kinds): (Vec<&Section>, Vec<&Section>) = sections.partition(|section| section.kind.is_empty());
    let shared: Vec<&Key> = shared.iter().flat_map(|section| section.keys).chain(more.iter().copied()).collect();
    if kinds.is_empty() {
        return object(None, &shared);
    }
    let kinds = kinds.into_iter().map(|section| {
        let keys: Vec<&Key> = shared.iter().copied().chain(section.keys).collect();
        object(Some(section), &keys)
    });
    json!({ "anyOf": kinds.collect::<Vec<_>>() })
}

/// A table with these keys and no others.
fn object(kind: Option<&Section>, keys: &[&Key]) -> Value {
    let mut properties = Map::new();
    for key in keys {
        let said = match (key.value, kind) {
            (Form::Kind, Some(section)) => json!({ "const": section.kind, "description": section.about }),
            _ => described(key),
        };
        properties.insert(key.name.to_string(), said);
    }
    let required: Vec<&str> =
        keys.iter().filter(|key| key.default == Otherwise::Required).map(|key| key.name).collect();
    json!({ "type": "object", "properties": properties, "required": required, "additionalProperties": false })
}

/// The values of a key, and what the manual says of it.
fn described(key: &Key) -> Value {
    let mut lines = vec![key.about.to_string(), format!("Value: {}", key.value)];
    if !key.unit.is_empty() {
        lines.push(format!("Unit: {}", key.unit));
    }
    match key.default {
        Otherwise::Is(value) | Otherwise::Chosen(value) => lines.push(format!("Default: {value}")),
        Otherwise::Required | Otherwise::None => {}
    }
    if !key.cost.is_empty() {
        lines.push(format!("Cost: {}", key.cost));
    }
    // Beside a reference validators of this draft hear nothing else.
    let mut said = match values(&key.value) {
        reference @ Value::Object(_) if reference.get("$ref").is_some() => json!({ "allOf": [reference] }),
        other => other,
    };
    said["description"] = lines.join("\n\n").into();
    if let Otherwise::Is(value) = key.default
        && let Ok(value) = tree::parse_value(value, &Source::Override("".into()))
    {
        said["default"] = json(&value);
    }
    said
}

/// What a key may be.
fn values(form: &Form) -> Value {
    match form {
        Form::Boolean => json!({ "type": "boolean" }),
        Form::Number(range) => numbers("number", *range),
        Form::Integer(range) => numbers("integer", *range),
        Form::Choice(names) => json!({ "enum": names }),
        Form::Text(_) | Form::Kind => json!({ "type": "string" }),
        Form::Array(length, of) => {
            json!({ "type": "array", "items": values(of), "minItems": length, "maxItems": length })
        }
        Form::List(_, of) => json!({ "type": "array", "items": values(of) }),
        Form::Table(path) => json!({ "$ref": format!("#/definitions/{path}") }),
        Form::Named(path) => {
            json!({ "type": "object", "additionalProperties": { "$ref": format!("#/definitions/{path}") } })
        }
        Form::Keys => json!({ "type": "object" }),
        Form::OneOf(forms) => json!({ "anyOf": forms.iter().map(values).collect::<Vec<_>>() }),
        Form::Said(_, form) => values(form),
    }
}

fn numbers(kind: &str, range: Range) -> Value {
    // Whole numbers without a point, as people write them.
    let number = |x: f64| if x.fract() == 0.0 { json!(x as i64) } else { json!(x) };
    let Bounds { low, high } = range.map(number);
    let mut said = json!({ "type": kind });
    if let Some((low, holds)) = low {
        said[if holds { "minimum" } else { "exclusiveMinimum" }] = low;
    }
    if let Some((high, holds)) = high {
        said[if holds { "maximum" } else { "exclusiveMaximum" }] = high;
    }
    said
}

/// A value of a scene file as JSON, as editors hand it to the schema.
pub(super) fn json(node: &Node) -> Value {
    match &node.value {
        tree::Value::Table(entries) => {
            entries.iter().map(|entry| (entry.key.clone(), json(&entry.node))).collect::<Map<_, _>>().into()
        }
        tree::Value::Array(items) => items.iter().map(json).collect::<Vec<_>>().into(),
        tree::Value::String(text) | tree::Value::Date(text) => text.as_str().into(),
        tree::Value::Integer(number) => i64::try_from(*number).map_or_else(|_| (*number as f64).into(), Value::from),
        tree::Value::Float(number) => (*number).into(),
        tree::Value::Boolean(value) => (*value).into(),
    }
}
