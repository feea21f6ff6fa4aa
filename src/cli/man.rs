//! `volpm man`.

use clap::{Args, CommandFactory};
use clap_mangen::Man;
use roff::{Inline, Roff, bold, italic, roman};

use super::manual::default;
use crate::scene::manual::{self, Key, Otherwise, Section};
use crate::{Error, Result};

/// What the page of scene files is asked for by.
const SCENE: &str = "scene";

#[derive(Args)]
#[command(
    after_help = "To read one: volpm man scene | man -l -\nTo keep them: volpm man > volpm.1; volpm man render > volpm-render.1; volpm man scene > volpm-scene.5"
)]
pub struct Arguments {
    /// A command, or `scene` for the keys of scene files. Default: the program itself.
    page: Option<String>,
}

pub fn run(arguments: &Arguments) -> Result<()> {
    let program = super::Arguments::command();
    let page = match arguments.page.as_deref() {
        None => Man::new(program),
        Some(SCENE) => return super::print(&scene_files()),
        Some(name) => {
            let Some(command) = program.find_subcommand(name) else {
                let names: Vec<&str> = program.get_subcommands().map(clap::Command::get_name).collect();
                return Err(Error::Usage(format!(
                    "there is no page on {name:?}; expected {} or {SCENE}",
                    names.join(", ")
                )));
            };
            let title = format!("volpm-{name}");
            let command = command.clone().name(title.clone()).bin_name(format!("volpm {name}"));
            Man::new(command.version(env!("CARGO_PKG_VERSION"))).title(title)
        }
    };
    let mut text = Vec::new();
    page.render(&mut text).map_err(|error| Error::output("the page", error))?;
    super::print(&String::from_utf8_lossy(&text))
}

/// The manual of scene files as a page of section 5.
fn scene_files() -> String {
    let mut page = Roff::new();
    page.control("TH", ["volpm-scene", "5", "", concat!("volpm ", env!("CARGO_PKG_VERSION"))]);
    page.control("SH", ["NAME"]);
    page.text([roman("volpm-scene - scene files of volpm")]);
    page.control("SH", ["DESCRIPTION"]);
    page.text([
        roman("A scene is a TOML file. Lengths are in scene units, coefficients per scene unit, angles in degrees; colours are linear sRGB. In paths of keys "),
        bold("*"),
        roman(" stands for a name, or for a number in a list."),
    ]);
    for section in manual::sections() {
        page.control("SH", [heading(section).as_str()]);
        page.text([roman(section.about)]);
        section.keys.iter().for_each(|key| entry(&mut page, key));
    }
    page.render()
}

fn heading(section: &Section) -> String {
    match (section.path, section.kind) {
        ("", _) => "the file".to_string(),
        (path, "") => format!("[{path}]"),
        (path, kind) => format!("[{path}] of {kind}"),
    }
}

/// A key, and what is said of it.
fn entry(page: &mut Roff, key: &Key) {
    page.control("TP", []);
    page.text([bold(key.name), roman(" – "), italic(key.value.to_string())]);
    let mut said: Vec<Inline> = vec![roman(key.about), roman(".")];
    if !key.unit.is_empty() {
        said.push(roman(format!(" Unit: {}.", key.unit)));
    }
    if key.default != Otherwise::None {
        said.push(roman(format!(" Default: {}.", default(key))));
    }
    if !key.cost.is_empty() {
        said.push(roman(format!(" Cost: {}.", key.cost)));
    }
    page.text(said);
}
