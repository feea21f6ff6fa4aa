//! `volpm help KEY`: the manual of a key of scene files, or of a table of keys.

use std::fmt::Write as _;

use crate::scene::manual::{self, Found, Key, Otherwise, Section};
use crate::{Error, Result};

/// Lines are no wider than this.
const WIDTH: usize = 100;

/// Prints what the manual says of a key or a table.
///
/// # Errors
/// [`Error::Usage`] for a key that is not there, with the nearest that is.
pub fn run(asked: &str) -> Result<()> {
    super::print(&match manual::find(asked) {
        Found::Keys(keys) => keys.iter().map(|(section, key)| entry(section, key)).collect::<Vec<_>>().join("\n"),
        Found::Sections(sections) => list(&sections),
        Found::Nothing(nearest) => {
            let nearest = nearest.map_or_else(String::new, |nearest| format!("; did you mean `{nearest}`?"));
            return Err(Error::Usage(format!(
                "{asked:?} is neither a command nor a key of scene files{nearest} (`volpm help` lists the commands, `volpm help volume` the keys of a table)"
            )));
        }
    })
}

/// All that there is about a key.
fn entry(section: &Section, key: &Key) -> String {
    let mut text = section.path_of(key);
    if !section.kind.is_empty() {
        let _ = write!(text, "  (of {})", section.kind);
    }
    text.push('\n');
    let value = key.value.to_string();
    let see = key.see.join(", ");
    let default = default(key);
    for (what, said) in [
        ("value", value.as_str()),
        ("unit", key.unit),
        ("default", default.as_str()),
        ("cost", key.cost),
        ("see", &see),
    ] {
        if !said.is_empty() {
            paragraph(&mut text, &format!("  {what:<9}"), said);
        }
    }
    text.push('\n');
    paragraph(&mut text, "  ", key.about);
    text
}

/// What holds without a key, in words.
pub(super) fn default(key: &Key) -> String {
    match key.default {
        Otherwise::Required => "none: it must be given".to_string(),
        Otherwise::Is(value) => value.to_string(),
        Otherwise::Chosen(what) => what.to_string(),
        Otherwise::None => "none".to_string(),
    }
}

/// The keys of tables of one path.
fn list(sections: &[&Section]) -> String {
    let mut text = String::new();
    for (number, section) in sections.iter().enumerate() {
        if number > 0 {
            text.push('\n');
        }
        let kind = if section.kind.is_empty() { String::new() } else { format!("  (of {})", section.kind) };
        let _ = writeln!(text, "[{}]{kind}", section.path);
        paragraph(&mut text, "  ", section.about);
        let wide = section.keys.iter().map(|key| key.name.len()).max().unwrap_or(0);
        for key in section.keys {
            let told = match key.default {
                Otherwise::Is(value) => format!("{} ({value})", key.about),
                Otherwise::Required => format!("{} (required)", key.about),
                Otherwise::Chosen(_) | Otherwise::None => key.about.to_string(),
            };
            paragraph(&mut text, &format!("  {:wide$}  ", key.name), &told);
        }
        if !section.example.is_empty() {
            let _ = writeln!(text, "  e.g. {}", section.example);
        }
    }
    text
}

/// Words after a lead, in lines that are indented as far.
fn paragraph(text: &mut String, lead: &str, words: &str) {
    let indent = lead.chars().count();
    let mut line = lead.to_string();
    let mut is_empty = true;
    for word in words.split(' ') {
        if !is_empty && line.chars().count() + 1 + word.chars().count() > WIDTH {
            text.push_str(&line);
            text.push('\n');
            line = " ".repeat(indent);
            is_empty = true;
        }
        if !is_empty {
            line.push(' ');
        }
        line.push_str(word);
        is_empty = false;
    }
    text.push_str(line.trim_end());
    text.push('\n');
}
