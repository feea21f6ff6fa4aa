//! Scenes written in code instead of a file, for the same reader.

use std::panic::Location;
use std::path::Path;
use std::sync::Arc;

use super::description::{Description, Document, Place, Source};
use super::table::Problems;
use super::tree::{self, Node};
use super::{overrides, read};
use crate::Result;
use crate::math::DVec3;

/// A scene, or a table of one, written in code.
///
/// Keys are those of scene files, and so are defaults and checks: [`describe`](Draft::describe) is the reader of those, and its
/// errors name the line of code that set a value.
///
/// ```
/// use volpm::scene::{self, Draft};
///
/// # fn main() -> volpm::Result<()> {
/// let glass = Draft::new().set("type", "dielectric").set("ior", 1.5);
/// let draft = Draft::new()
///     .set("camera", Draft::new().set("position", [0.0, 0.0, 5.0]).set("target", [0.0, 0.0, 0.0]))
///     .set("media.fog.sigma_s", 0.2)
///     .set("media.fog.sigma_a", 0.01)
///     .set("world.medium", "fog")
///     .set("materials.glass", glass)
///     .push("shapes", Draft::new().set("type", "sphere").set("center", [0, 0, 0]).set("radius", 1).set("material", "glass"))
///     .push("lights", Draft::new().set("type", "point").set("position", [2, 3, 2]).set("intensity", 50));
/// let (scene, settings) = scene::build(&draft.describe("fog")?)?;
/// # Ok(())
/// # }
/// ```
#[derive(Clone)]
pub struct Draft {
    root: Node,
    /// Keys that lead nowhere.
    flaws: Vec<(Place, String)>,
}

/// A value of a [`Draft`]: made [from](From) numbers, strings, switches, vectors (also of colours), lists, and drafts of tables.
#[derive(Clone)]
pub struct Value(Said);

#[derive(Clone)]
enum Said {
    One(tree::Value),
    List(Vec<Value>),
    Table(Draft),
}

impl Draft {
    /// An empty table.
    #[track_caller]
    pub fn new() -> Draft {
        Draft { root: Node { value: tree::Value::Table(Vec::new()), source: here() }, flaws: Vec::new() }
    }

    /// What the text of a scene file says, to say more. `name` is what errors call it.
    ///
    /// # Errors
    /// [`Error::Scene`](crate::Error::Scene) if the text is no TOML.
    pub fn parse(text: &str, name: &str) -> Result<Draft> {
        let document = Document { name: name.to_owned(), text: text.to_owned() };
        Ok(Draft { root: tree::parse(&Arc::new(document))?, flaws: Vec::new() })
    }

    /// Sets the value of a key, dotted as in overrides: `media.fog.sigma_s`; elements of lists are named by their index from 0
    /// or by their `name`. Tables that are missing are made.
    #[track_caller]
    #[must_use]
    pub fn set(self, key: &str, value: impl Into<Value>) -> Draft {
        self.put(key, here(), value.into(), |node, value| {
            *node = value;
            Ok(())
        })
    }

    /// Adds a value to the list under a key: a table of `shapes` or `lights`, a step of a `transform`.
    #[track_caller]
    #[must_use]
    pub fn push(self, key: &str, value: impl Into<Value>) -> Draft {
        self.put(key, here(), value.into(), |node, value| match &mut node.value {
            tree::Value::Array(items) => {
                items.push(value);
                Ok(())
            }
            // What was not there is an empty table.
            tree::Value::Table(entries) if entries.is_empty() => {
                node.value = tree::Value::Array(vec![value]);
                Ok(())
            }
            _ => Err("is no list; expected one to add to".to_owned()),
        })
    }

    fn put(
        mut self,
        key: &str,
        source: Source,
        value: Value,
        place: impl FnOnce(&mut Node, Node) -> Result<(), String>,
    ) -> Draft {
        let value = value.node(&source, &mut self.flaws);
        let put = overrides::lead(&mut self.root, key, &source)
            .and_then(|node| place(node, value).map_err(|message| (key.to_owned(), message)));
        if let Err((key, message)) = put {
            self.flaws.push((Place { source, key: key.as_str().into() }, message));
        }
        self
    }

    /// Reads it as the reader reads the text of a scene file. `path` is what messages call the scene, and names of files are relative to
    /// its folder; it need not exist.
    ///
    /// # Errors
    /// [`Error::Scene`](crate::Error::Scene), as [`read`](super::read()).
    pub fn describe(&self, path: impl AsRef<Path>) -> Result<Description> {
        let problems = Problems::default();
        for (place, message) in &self.flaws {
            problems.note(place.clone(), message);
        }
        read::described(&self.root, &problems, path.as_ref())
    }
}

impl Default for Draft {
    #[track_caller]
    fn default() -> Draft {
        Draft::new()
    }
}

/// The line of code that calls what calls this.
#[track_caller]
fn here() -> Source {
    Source::Code(Location::caller())
}

impl Value {
    /// As a node that was said at `source`; with it, what is wrong with drafts in it.
    fn node(self, source: &Source, flaws: &mut Vec<(Place, String)>) -> Node {
        let value = match self.0 {
            Said::One(value) => value,
            Said::List(items) => tree::Value::Array(items.into_iter().map(|item| item.node(source, flaws)).collect()),
            Said::Table(draft) => {
                flaws.extend(draft.flaws);
                return draft.root;
            }
        };
        Node { value, source: source.clone() }
    }
}

fn whole(number: impl Into<i128>) -> tree::Value {
    tree::Value::Integer(number.into())
}

fn real(number: impl Into<f64>) -> tree::Value {
    tree::Value::Float(number.into())
}

fn text(text: impl Into<String>) -> tree::Value {
    tree::Value::String(text.into())
}

macro_rules! from {
    ($($from:ty => $of:path),*) => {
        $(impl From<$from> for Value {
            fn from(value: $from) -> Value {
                Value(Said::One($of(value)))
            }
        })*
    };
}

from!(
    bool => tree::Value::Boolean,
    i32 => whole,
    u32 => whole,
    i64 => whole,
    u64 => whole,
    f32 => real,
    f64 => real,
    &str => text,
    String => text
);

impl From<Draft> for Value {
    fn from(table: Draft) -> Value {
        Value(Said::Table(table))
    }
}

impl<T: Into<Value>> From<Vec<T>> for Value {
    fn from(items: Vec<T>) -> Value {
        Value(Said::List(items.into_iter().map(Into::into).collect()))
    }
}

impl<T: Into<Value>, const N: usize> From<[T; N]> for Value {
    fn from(items: [T; N]) -> Value {
        Value(Said::List(items.into_iter().map(Into::into).collect()))
    }
}

impl From<DVec3> for Value {
    fn from(vector: DVec3) -> Value {
        vector.to_array().into()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene;

    /// A scene in code is the scene that a file would say.
    #[test]
    fn code_says_what_a_file_says() {
        let text = r#"
            camera = { position = [0, 0, 5], target = [0, 0, 0] }
            media.fog = { sigma_s = [0.1, 0.2, 0.3], sigma_a = 0.1, phase = { type = "hg", g = 0.5 } }
            [[shapes]]
            type = "sphere"
            center = [0, 0, 0]
            radius = 1.5
            interior = "fog"
            transform = [{ scale = 2 }, { translate = [1, 0, 0] }]
            [[lights]]
            type = "point"
            position = [2, 3, 2]
            intensity = 50
        "#;
        let phase = Draft::new().set("type", "hg").set("g", 0.5);
        let ball =
            Draft::new().set("type", "sphere").set("center", DVec3::ZERO).set("radius", 1.5).set("interior", "fog");
        let ball = ball.push("transform", Draft::new().set("scale", 2));
        let ball = ball.push("transform", Draft::new().set("translate", vec![1, 0, 0]));
        let draft = Draft::new()
            .set("camera.position", [0, 0, 5])
            .set("camera.target", [0.0; 3])
            .set("media.fog", Draft::new().set("sigma_s", [0.1, 0.2, 0.3]).set("sigma_a", 0.1))
            .set("media.fog.phase", phase)
            .push("shapes", ball)
            .push("lights", Draft::new().set("type", "point").set("position", [2, 3, 2]).set("intensity", 1))
            .set("lights.0.intensity", 50);
        let said = |description: &Description| serde_json::to_value(description).unwrap();
        let file = scene::parse(text, Path::new("scene.toml"), &[]).unwrap();
        assert_eq!(said(&draft.describe("scene.toml").unwrap()), said(&file));
        let more = Draft::parse(text, "scene.toml").unwrap().set("film.width", 320);
        assert_eq!(more.describe("scene.toml").unwrap().film.width, 320);
    }

    /// What is wrong is told with the line of code that says it.
    #[test]
    fn mistakes_name_their_line() {
        let camera = Draft::new().set("position", [0, 0, 5]).set("target", [0, 0, 0]);
        let line = line!() + 1;
        let draft = Draft::new().set("camera", camera).set("film.widht", 8).set("film.height", -1).push("camera", 1);
        let error = draft.describe("scene").unwrap_err().to_string();
        let messages: Vec<&str> = error.lines().collect();
        assert_eq!(messages.len(), 3, "{error}");
        for expected in
            ["film.widht: unknown key; did you mean `width`?", "film.height: found -1", "camera: is no list"]
        {
            let message = messages.iter().find(|message| message.contains(expected));
            let message = message.unwrap_or_else(|| panic!("{expected}: {error}"));
            assert!(message.starts_with(&format!("{}:{line}:", file!())), "{message}");
        }
    }
}
