//! Films as pictures.

use crate::image::{Attribute, Format, Picture, ToneMap, ToneSettings};
use crate::render::checkpoint::Subject;
use crate::render::{Film, Stats};
use crate::scene::description;

/// What a picture says of itself: the same of equal renders, so that their files are equal.
pub struct Facts<'f> {
    /// The scene file.
    pub scene: String,
    /// The method by which it was made.
    pub method: &'f str,
    /// The seeds of its passes.
    pub seeds: Vec<u64>,
}

/// The endings of what is written where nobody says what: all light, and what one looks at, as far as this was built with them.
pub fn default_endings() -> Vec<&'static str> {
    let endings = [(Format::Exr, ".exr"), (Format::Png, ".png")].into_iter();
    let endings: Vec<&str> = endings.filter(|(format, _)| format.is_built_in()).map(|(_, ending)| ending).collect();
    if endings.is_empty() { vec![".pfm"] } else { endings }
}

/// A film as a picture with layers and attributes.
pub fn picture(film: &Film, stats: &Stats, facts: &Facts<'_>) -> Picture {
    let text = |name: &str, text: &str| (name.to_string(), Attribute::Text(text.to_string()));
    let number = |name: &str, number: f64| (name.to_string(), Attribute::Number(number));
    let seeds: Vec<String> = facts.seeds.iter().map(u64::to_string).collect();
    Picture {
        image: film.image(),
        layers: film.layers(),
        attributes: vec![
            text("scene", &facts.scene),
            text("renderer", concat!("volpm ", env!("CARGO_PKG_VERSION"))),
            text("method", facts.method),
            text("seed", &seeds.join(", ")),
            number("samples", stats.samples as f64),
            number("passes", stats.passes as f64),
        ],
    }
}

/// How PNG files are to be exposed.
pub fn tone(film: &description::Film) -> ToneSettings {
    let curve = match film.tone_map {
        description::ToneMap::Linear => ToneMap::Linear,
        description::ToneMap::Filmic => ToneMap::Filmic,
    };
    ToneSettings { exposure: film.exposure, curve }
}

/// How PNG files of a checkpoint are to be exposed.
pub fn tone_of(subject: &Subject) -> ToneSettings {
    let curve = if subject.filmic { ToneMap::Filmic } else { ToneMap::Linear };
    ToneSettings { exposure: subject.exposure, curve }
}
