use std::path::Path;
use std::sync::Arc;

use super::*;
use crate::scene::description::Document;
use crate::scene::table::Problems;
use crate::scene::tree::{self, Node, Value};
use crate::scene::{overrides, parse};

const CAMERA: &str = "camera = { position = [0, 0, 5], target = [0, 0, 0] }\n";

/// A scene that has a section's table.
fn scene(section: &Section) -> String {
    let example = section.example.replace("NAME", if section.path.starts_with("media") { "fog" } else { "stone" });
    format!("{CAMERA}{example}\n")
}

/// Where a section's table stands in its example.
fn place(section: &Section) -> String {
    let named = section.path.replace("media.*", "media.fog").replace("materials.*", "materials.stone");
    named.replace('*', "0")
}

/// A value of a key of that table, as an override.
fn set(section: &Section, key: &str, value: &str) -> String {
    let place = place(section);
    if place.is_empty() { format!("{key}={value}") } else { format!("{place}.{key}={value}") }
}

fn read(section: &Section, overrides: &[String]) -> std::result::Result<serde_json::Value, String> {
    let description = parse(&scene(section), Path::new("scene.toml"), overrides).map_err(|error| error.to_string())?;
    let mut value = serde_json::to_value(&description).unwrap();
    if section.path != "render" {
        // Whoever says anything about photons asks for them.
        value["render"]["automatic"] = serde_json::Value::Null;
    }
    Ok(value)
}

/// Sections that a file can have: of those with kinds, one for each.
fn tables() -> impl Iterator<Item = &'static Section> {
    sections().filter(|section| section.path == "camera" || !section.example.is_empty())
}

/// Keys of a section, and of all kinds of its table.
fn keys(section: &Section) -> Vec<&'static Key> {
    let shared =
        sections().filter(|other| other.path == section.path && (other.kind.is_empty() || other.kind == section.kind));
    shared.flat_map(|other| other.keys).collect()
}

/// Of every table the manual has the keys that the reader asks it for, and no others: those that its message lists beside a key that is unknown.
#[test]
fn the_manual_has_the_keys_that_the_reader_knows() {
    for section in tables() {
        let what = format!("[{}] {}", section.path, section.kind);
        read(section, &[]).unwrap_or_else(|error| panic!("{what}: {error}"));
        let error = read(section, &[set(section, "no_such_key", "1")]).unwrap_err();
        let (_, listed) = error.split_once("(keys here: ").unwrap_or_else(|| panic!("{what}: {error}"));
        let mut known: Vec<&str> = listed.split(')').next().unwrap().split(", ").collect();
        let mut told: Vec<&str> = keys(section).iter().map(|key| key.name).collect();
        known.sort_unstable();
        told.sort_unstable();
        known.dedup();
        assert_eq!(told, known, "{what}");
    }
}

/// A default that is a value is the reader's: a scene that says it is the scene that does not.
#[test]
fn defaults_are_those_of_the_reader() {
    for section in tables() {
        for key in keys(section) {
            let Is(value) = key.default else { continue };
            let what = section.path_of(key);
            let example: &str = without(section.example, key.name).leak();
            let section = Section { example, ..*section };
            let read =
                |overrides: &[String]| read(&section, overrides).unwrap_or_else(|error| panic!("{what}: {error}"));
            assert_eq!(read(&[set(&section, key.name, value)]), read(&[]), "{what} is not {value} by default");
        }
    }
}

/// An example without a key, if it has that.
fn without(example: &str, key: &str) -> String {
    let Some(start) = example.find(&format!(" {key} = ")) else { return example.to_string() };
    let mut depth = 0;
    let end = example[start..].find(|c: char| {
        depth += i32::from("[{".contains(c)) - i32::from("]}".contains(c));
        depth < 0 || depth == 0 && c == ','
    });
    let rest = &example[start + end.unwrap()..];
    let before = example[..start].trim_end_matches(',');
    if before.ends_with('{') { format!("{before}{}", rest.trim_start_matches(',')) } else { format!("{before}{rest}") }
}

/// The pages name every key, whatever is said of a key is said in whole, and keys that it refers to exist.
#[test]
fn pages_name_every_key() {
    let page = include_str!("../../../docs/scene-format.md");
    let studies = include_str!("../../../docs/compare.md");
    for (section, key) in all_keys() {
        let page = if section.path.starts_with("compare") { studies } else { page };
        let word = |c: char| c.is_alphanumeric() || c == '_';
        let named = page.split(|c: char| !word(c)).any(|found| found == key.name);
        let what = section.path_of(key);
        assert!(named, "no page names {what}");
        assert!(!key.value.to_string().is_empty() && !key.about.is_empty(), "{what}");
        for other in key.see {
            let found = matches!(find(other), Found::Keys(_) | Found::Sections(_));
            assert!(found && *other != what, "{what} refers to {other}");
        }
    }
}

/// Keys of all scenes of the project are in the manual, wherever they stand.
#[test]
fn keys_of_scenes_are_in_the_manual() {
    fn walk(path: &str, node: &Node, missing: &mut Vec<String>) {
        // What is replaced is given by whole paths.
        if [".set", "reference_set", ".limit"].iter().any(|end| path.ends_with(end)) {
            return;
        }
        let parts: Vec<(&str, &Node)> = match &node.value {
            Value::Table(entries) => entries.iter().map(|entry| (entry.key.as_str(), &entry.node)).collect(),
            Value::Array(items) => items.iter().map(|item| ("0", item)).collect(),
            _ => Vec::new(),
        };
        for (key, node) in parts {
            let path = if path.is_empty() { key.to_string() } else { format!("{path}.{key}") };
            // A texture or a part of a material may stand in many places; the places themselves are keys.
            let inner = path.starts_with("materials") && path.matches('.').count() > 2;
            let is_element = key == "0" && !matches!(node.value, Value::Table(_));
            if !inner && !is_element && matches!(find(&path), Found::Nothing(_)) {
                missing.push(path.clone());
            }
            walk(&path, node, missing);
        }
    }
    let (mut missing, mut read) = (Vec::new(), 0);
    for folder in ["", "jensen", "materials", "paper", "lamps", "room", "stress", "studies"] {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes").join(folder);
        for entry in std::fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.extension().is_some_and(|ending| ending == "toml") {
                let document = Document { name: String::new(), text: std::fs::read_to_string(&path).unwrap() };
                walk("", &tree::parse(&Arc::new(document)).unwrap(), &mut missing);
                read += 1;
            }
        }
    }
    assert!(missing.is_empty() && read > 40, "{missing:?} in {read} scenes");
}

/// What is asked for is found by its whole path, by any name in place of a star, and by its end; a misspelt key has a suggestion.
#[test]
fn keys_are_found_as_users_ask_for_them() {
    let paths = |asked: &str| match find(asked) {
        Found::Keys(keys) => keys.iter().map(|(section, key)| section.path_of(key)).collect::<Vec<_>>(),
        Found::Sections(sections) => sections.iter().map(|section| format!("[{}]", section.path)).collect(),
        Found::Nothing(nearest) => vec![format!("? {}", nearest.unwrap_or_default())],
    };
    assert_eq!(paths("volume.neighbours"), ["volume.neighbours"]);
    for asked in ["media.*.phase.g", "media.fog.phase.g", "media.phase.g", "phase.g"] {
        assert_eq!(paths(asked), ["media.*.phase.g"], "{asked}");
    }
    assert_eq!(paths("neighbours"), ["volume.neighbours", "surface.neighbours"]);
    assert_eq!(paths("shapes.3.casts_caustics"), ["shapes.*.casts_caustics"]);
    assert_eq!(paths("volume.march"), ["[volume.march]"]);
    assert!(paths("compare.*").contains(&"compare.budgets".to_string()) && paths("media.*") == ["[media.*]"]);
    assert_eq!((paths("render.*").len(), paths("render.*")[0].as_str()), (8, "render.method"));
    assert_eq!(paths("volume.nieghbours"), ["? volume.neighbours"]);
    assert_eq!(paths("nieghbours"), ["? volume.neighbours"]);
    assert_eq!(paths("xyzzy"), ["? "]);
}

/// What a JSON schema has against a value, at the first place; `root` is the schema whose definitions are meant.
fn objection(root: &serde_json::Value, schema: &serde_json::Value, value: &serde_json::Value) -> Option<String> {
    let number = |limit: &serde_json::Value| (value.as_f64().unwrap_or(f64::NAN), limit.as_f64().unwrap());
    let size = || value.as_array().map_or(0, Vec::len) as u64;
    let any = |of: &serde_json::Value| {
        let objections = of.as_array().unwrap().iter().map(|schema| objection(root, schema, value));
        let objections: Vec<Option<String>> = objections.collect();
        (!objections.contains(&None)).then(|| format!("none of these: {objections:?}"))
    };
    for (keyword, said) in schema.as_object().unwrap() {
        let is_fine = match keyword.as_str() {
            "$schema" | "title" | "description" | "default" | "definitions" => true,
            "type" => match said.as_str().unwrap() {
                "object" => value.is_object(),
                "array" => value.is_array(),
                "string" => value.is_string(),
                "boolean" => value.is_boolean(),
                "number" => value.is_number(),
                "integer" => value.is_i64() || value.is_u64(),
                other => panic!("type {other}"),
            },
            "enum" => said.as_array().unwrap().contains(value),
            "const" => said == value,
            "minimum" => matches!(number(said), (x, low) if x >= low),
            "maximum" => matches!(number(said), (x, high) if x <= high),
            "exclusiveMinimum" => matches!(number(said), (x, low) if x > low),
            "exclusiveMaximum" => matches!(number(said), (x, high) if x < high),
            "minItems" => size() >= said.as_u64().unwrap(),
            "maxItems" => size() <= said.as_u64().unwrap(),
            "required" => said.as_array().unwrap().iter().all(|key| value.get(key.as_str().unwrap()).is_some()),
            "$ref" => {
                let definition = &root["definitions"][said.as_str().unwrap().strip_prefix("#/definitions/").unwrap()];
                if let Some(objection) = objection(root, definition, value) {
                    return Some(objection);
                }
                true
            }
            "anyOf" => match any(said) {
                Some(objection) => return Some(objection),
                None => true,
            },
            "allOf" => said.as_array().unwrap().iter().all(|schema| objection(root, schema, value).is_none()),
            "items" => match value.as_array().into_iter().flatten().find_map(|item| objection(root, said, item)) {
                Some(objection) => return Some(objection),
                None => true,
            },
            "properties" => {
                let known = said.as_object().unwrap().iter();
                let objections =
                    known.filter_map(|(key, schema)| Some((key, objection(root, schema, value.get(key)?)?)));
                if let Some((key, objection)) = objections.into_iter().next() {
                    return Some(format!("{key}: {objection}"));
                }
                true
            }
            "additionalProperties" => {
                let properties = schema.get("properties");
                let is_more = |key: &String| properties.is_none_or(|known| known.get(key).is_none());
                let mut more = value.as_object().into_iter().flatten().filter(|(key, _)| is_more(key));
                match said.as_bool() {
                    Some(_) => more.next().is_none(),
                    None => more.all(|(_, value)| objection(root, said, value).is_none()),
                }
            }
            other => panic!("{other} is in the schema"),
        };
        if !is_fine {
            return Some(format!("{value} is not {keyword} {said}"));
        }
    }
    None
}

/// The schema allows all scenes of the project, and of every key what the reader allows; it refuses what the reader refuses of numbers,
/// choices and switches, and keys that do not exist.
#[test]
fn the_schema_allows_what_the_reader_allows() {
    let schema = schema();
    let tree = |name: &str, text: &str| {
        let document = Document { name: name.to_string(), text: text.to_string() };
        tree::parse(&Arc::new(document)).unwrap()
    };
    let mut folders = vec![Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes")];
    let mut scenes = 0;
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
            } else if path.extension().is_some_and(|ending| ending == "toml") {
                let scene = tree("", &std::fs::read_to_string(&path).unwrap());
                assert_eq!(objection(&schema, &schema, &schema::json(&scene)), None, "{}", path.display());
                scenes += 1;
            }
        }
    }
    assert!(scenes > 60, "{scenes} scenes");

    let probes = [
        "-1",
        "0",
        "1",
        "2",
        "10",
        "100",
        "1000",
        "100_000",
        "10_000_000",
        "1e-7",
        "0.5",
        "1.55",
        "true",
        "\"zzz\"",
        "[0, 0, 1]",
        "[1, 2]",
        "{ }",
        "{ no_such_key = 1 }",
    ];
    let mut compared = 0;
    for section in tables() {
        for key in keys(section) {
            for probe in probes {
                let set = set(section, key.name, probe);
                let problems = Problems::default();
                let mut root = tree("scene.toml", &scene(section));
                overrides::apply(&mut root, &set, &problems);
                problems.check().unwrap();
                let objection = objection(&schema, &schema, &schema::json(&root));
                let read = read(section, std::slice::from_ref(&set));
                assert!(read.is_err() || objection.is_none(), "{set} is refused: {objection:?}");
                // What the reader has against the value itself, and not against what else the scene says.
                let refused = read.err().filter(|error| error.contains("found ") && error.contains("; expected"));
                if matches!(key.value, Form::Boolean | Form::Number(_) | Form::Integer(_) | Form::Choice(_))
                    && let Some(error) = refused
                {
                    assert!(objection.is_some(), "{set} is allowed: {error}");
                }
                compared += 1;
            }
        }
    }
    assert!(compared > 3000, "{compared}");
    let refused = tree("", &format!("{CAMERA}media.fog = {{ sigma_s = 1.0, sigma_z = 1.0 }}\n"));
    assert!(objection(&schema, &schema, &schema::json(&refused)).is_some());
}
