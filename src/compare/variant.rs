//! Variants: an estimate with its settings.

use super::context::{Context, Pair, pair};
use crate::gather::march::Marcher;
use crate::render::{Camera, Limits, Plan, SharedMap, volume_photons};
use crate::scene::description::{Description, Estimate, Kernel, Method};
use crate::scene::description::{March, Volume};
use crate::scene::{self, Scene, Settings, StudyVariant, is_plain};
use crate::{Error, Result};

/// Names of the built-in variants, and what they set.
pub const BUILT_IN: [(&str, &[(&str, &str)]); 12] = [
    ("path", &[("render.method", "path")]),
    ("light", &[("render.method", "light")]),
    ("beam", &[("render.method", "photon"), ("volume.estimate", "beam"), ("volume.kernel", "variable")]),
    ("beam-fixed", &[("render.method", "photon"), ("volume.estimate", "beam"), ("volume.kernel", "fixed")]),
    ("beam-2008", &BEAM_2008),
    ("point-uniform", &POINT[0]),
    ("point-adaptive", &POINT[1]),
    ("point-exponential", &POINT[2]),
    ("map", &[("render.method", "photon"), ("surface.indirect", "map")]),
    ("sheets", &[("render.method", "photon"), ("surface.indirect", "map"), ("surface.estimate", "sheets")]),
    ("final-gather", &GATHER[0]),
    ("cache", &GATHER[1]),
];

/// The variants that are compared if none is named: those of media.
pub const DEFAULT: [&str; 5] = ["path", "beam", "point-uniform", "point-adaptive", "point-exponential"];

/// The estimate of the paper (Jarosz, Zwicker and Jensen 2008), Eqs. 21 to 25: discs face the ray, and nothing is done about walls.
const BEAM_2008: [(&str, &str); 7] = [
    ("render.method", "photon"),
    ("volume.estimate", "beam"),
    ("volume.kernel", "variable"),
    ("volume.profile", "biweight"),
    ("volume.boundaries", "none"),
    ("volume.single_scattering", "photons"),
    ("volume.peaks", "photons"),
];

const fn point(step: &'static str) -> [(&'static str, &'static str); 3] {
    [("render.method", "photon"), ("volume.estimate", "point"), ("volume.march.step", step)]
}

const POINT: [[(&str, &str); 3]; 3] = [point("uniform"), point("adaptive"), point("exponential")];

const fn gather(cache: &'static str) -> [(&'static str, &'static str); 3] {
    [("render.method", "photon"), ("surface.indirect", "final_gather"), ("surface.irradiance_cache", cache)]
}

const GATHER: [[(&str, &str); 3]; 2] = [gather("false"), gather("true")];

/// What the built-in variant `name` sets.
pub fn built_in(name: &str) -> Option<&'static [(&'static str, &'static str)]> {
    BUILT_IN.iter().find(|(known, _)| *known == name).map(|(_, set)| *set)
}

/// Reads a list of variants as `--estimates` takes it: built-in ones by name, and `name:key=value,key=value`.
///
/// # Errors
/// [`Error::Usage`].
pub fn parse(text: &str) -> Result<Vec<StudyVariant>> {
    let mut variants: Vec<StudyVariant> = Vec::new();
    for part in at_commas(text) {
        let (name, setting) = match part.split_once(':') {
            Some((name, setting)) if is_plain(name.trim()) => (Some(name), Some(setting)),
            _ if part.contains('=') => (None, Some(part)),
            _ => (Some(part), None),
        };
        if let Some(name) = name.map(str::trim) {
            if setting.is_none() && built_in(name).is_none() {
                return Err(Error::Usage(unknown(name)));
            }
            if !is_plain(name) {
                return Err(Error::Usage(format!(
                    "--estimates: {name:?} is no name for a variant; expected letters, digits, `-`, `_` and `.`"
                )));
            }
            variants.push(StudyVariant { name: name.to_string(), ..StudyVariant::default() });
        }
        let Some(setting) = setting else { continue };
        match (variants.last_mut(), pair(setting)) {
            (Some(variant), Some(pair)) => variant.set.push(pair),
            _ => {
                return Err(Error::Usage(format!(
                    "--estimates: found {part:?}; expected a built-in variant, or name:key=value,key=value"
                )));
            }
        }
    }
    Ok(variants)
}

/// What to say of a variant that is not built in and sets nothing.
fn unknown(name: &str) -> String {
    let names: Vec<&str> = BUILT_IN.iter().map(|(name, _)| *name).collect();
    let near = names.iter().min_by_key(|known| strsim::osa_distance(known, name));
    let near = near.filter(|known| strsim::osa_distance(known, name) <= 3);
    let suggestion = near.map_or(String::new(), |near| format!("; did you mean `{near}`?"));
    format!(
        "there is no variant {name:?}{suggestion} (built in: {}; others set something: name:key=value,key=value)",
        names.join(", ")
    )
}

/// Parts between commas outside of quotes and brackets.
fn at_commas(text: &str) -> Vec<&str> {
    let (mut parts, mut start, mut depth, mut quote) = (Vec::new(), 0, 0u32, None);
    for (at, c) in text.char_indices() {
        match (quote, c) {
            (Some(open), c) if c == open => quote = None,
            (Some(_), _) => {}
            (None, '"' | '\'') => quote = Some(c),
            (None, '[' | '{') => depth += 1,
            (None, ']' | '}') => depth = depth.saturating_sub(1),
            (None, ',') if depth == 0 => {
                parts.push(&text[start..at]);
                start = at + 1;
            }
            _ => {}
        }
    }
    parts.push(&text[start..]);
    parts
}

/// A variant with everything it sets.
#[derive(Clone, Debug)]
pub struct Variant {
    pub asked: StudyVariant,
    /// All overrides beside the common ones, in order.
    pub set: Vec<Pair>,
    /// What was derived, in words.
    pub notes: Vec<String>,
    /// The scene with these settings.
    pub description: Description,
    /// What is chosen for it.
    pub tune: Option<Tunable>,
}

impl Variant {
    /// Settings of `asked`, with what a built-in variant needs and the scene does not give.
    pub fn new(asked: &StudyVariant, context: &mut Context<'_>) -> Result<Variant> {
        let name = &asked.name;
        let base = asked.of.as_deref().unwrap_or(name);
        let mut set = Vec::new();
        match built_in(base) {
            Some(built_in) => set.extend(built_in.iter().map(|(key, value)| (key.to_string(), value.to_string()))),
            None if asked.of.is_some() || asked.set.is_empty() => return Err(Error::Usage(unknown(base))),
            None => {}
        }
        let given = set.len();
        set.extend(asked.set.iter().cloned());
        let mut notes = Vec::new();
        let mut description = context.describe(name, &set)?;
        if let Some((key, value, why)) = derived(&description, context)? {
            notes.push(format!("{key} = {value}: {why}"));
            set.insert(given, (key.to_string(), value));
            description = context.describe(name, &set)?;
        }
        Ok(Variant { asked: asked.clone(), set, notes, description, tune: None })
    }

    /// Whether its rays are marched.
    pub fn marches(&self) -> bool {
        self.description.render.method == Method::Photon && self.description.volume.estimate == Estimate::Point
    }
}

/// A width of kernels for a variant whose scene gives that of the other kernel only: the mean of the adaptive radii,
/// or the number of neighbours whose radii are as wide as the fixed one on average.
fn derived(description: &Description, context: &mut Context<'_>) -> Result<Option<(&'static str, String, String)>> {
    let (volume, base) = (&description.volume, &context.base.volume);
    if description.render.method != Method::Photon || volume.kernel == base.kernel {
        return Ok(None);
    }
    match (volume.kernel, volume.radius, volume.neighbours, base.radius) {
        (Kernel::Fixed, None, ..) => {
            let Some(mean) = mean_radius(context, None)? else { return Ok(None) };
            let why = "the mean of the radii that the scene's own kernel has".to_string();
            Ok(Some(("volume.radius", significant(mean), why)))
        }
        (Kernel::Variable, _, None, Some(radius)) => {
            // r³ ∝ n.
            const TRIED: u32 = 50;
            let Some(mean) = mean_radius(context, Some(TRIED))? else { return Ok(None) };
            let neighbours = (f64::from(TRIED) * (radius / mean).powi(3)).round().clamp(5.0, 5000.0);
            let why = format!("radii are then about as wide as the scene's {radius} on average");
            Ok(Some(("volume.neighbours", neighbours.to_string(), why)))
        }
        _ => Ok(None),
    }
}

/// The mean radius of the scene's discs with adaptive radii; `None` without photons.
fn mean_radius(context: &mut Context<'_>, neighbours: Option<u32>) -> Result<Option<f64>> {
    let beam = built_in("beam").unwrap_or_default();
    let mut set: Vec<Pair> = beam.iter().map(|(key, value)| (key.to_string(), value.to_string())).collect();
    set.extend(neighbours.map(|n| ("volume.neighbours".to_string(), n.to_string())));
    let (scene, settings) = scene::build(&context.describe("beam", &set)?)?;
    let map = SharedMap::build(&scene, &settings, context.photons()?)?;
    let stats = map.stats();
    Ok((stats.volume > 0).then_some(stats.radii.mean.into()))
}

/// Three digits of a number.
pub fn significant(value: f64) -> String {
    // Printing to three digits and reading again leaves the shortest text.
    let rounded: f64 = format!("{value:.2e}").parse().unwrap_or(value);
    format!("{rounded}")
}

/// A number of the scene that can be chosen so that a variant takes a given time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Tunable {
    MarchSize,
    Contrast,
    Neighbours,
    Radius,
    Photons,
}

impl Tunable {
    const ALL: [(&str, Tunable); 5] = [
        ("volume.march.size", Tunable::MarchSize),
        ("volume.march.contrast", Tunable::Contrast),
        ("volume.neighbours", Tunable::Neighbours),
        ("volume.radius", Tunable::Radius),
        ("photons.volume", Tunable::Photons),
    ];

    /// The number under a key.
    pub fn of(key: &str) -> Result<Tunable> {
        let known = Self::ALL.iter().find(|(known, _)| *known == key);
        known.map(|(_, tunable)| *tunable).ok_or_else(|| {
            let keys: Vec<&str> = Self::ALL.iter().map(|(key, _)| *key).collect();
            Error::Usage(format!("{key:?} cannot be tuned; expected one of {}", keys.join(", ")))
        })
    }

    /// Its key.
    pub fn key(self) -> &'static str {
        Self::ALL.iter().find(|(_, tunable)| *tunable == self).map_or("", |(key, _)| key)
    }

    /// Whether the cost of a variant depends on it.
    pub fn concerns(self, variant: &Variant) -> bool {
        let volume = &variant.description.volume;
        match self {
            Tunable::MarchSize | Tunable::Contrast => variant.marches(),
            Tunable::Neighbours => volume.kernel == Kernel::Variable,
            Tunable::Radius => volume.kernel == Kernel::Fixed,
            Tunable::Photons => true,
        }
    }

    /// Whether maps must be built anew where it changes.
    pub fn changes_maps(self) -> bool {
        !matches!(self, Tunable::MarchSize | Tunable::Contrast)
    }

    /// Its value, from the scene's plan where the file leaves it open, and how far it may go.
    pub fn range(self, scene: &Scene, settings: &Settings) -> Result<(f64, [f64; 2])> {
        let (plan, volume) = (plan(scene, settings)?, &settings.volume);
        let extent = scene.bounds().diagonal().max(f64::MIN_POSITIVE);
        let (now, range) = match self {
            Tunable::MarchSize => (shortest_step(&plan), [1e-5 * extent, 10.0 * extent]),
            Tunable::Contrast => (march(volume).contrast, [1e-3, 1e3]),
            Tunable::Neighbours => (neighbours(&plan), [5.0, 1e5]),
            Tunable::Radius => (radius(&plan), [1e-5 * extent, extent]),
            Tunable::Photons => (volume_photons(scene, settings) as f64, [1e3, 1e9]),
        };
        Ok((now.clamp(range[0], range[1]), range))
    }

    /// Sets it. Returns the value as a scene file would say it.
    pub fn set(self, settings: &mut Settings, value: f64) -> String {
        let whole = value.round().max(1.0);
        let volume = &mut settings.volume;
        match self {
            Tunable::MarchSize => {
                volume.march = Some(March { size: Some(value), ..march(volume) });
            }
            Tunable::Contrast => volume.march = Some(March { contrast: value, ..march(volume) }),
            Tunable::Neighbours => volume.neighbours = Some(whole as u32),
            Tunable::Radius => volume.radius = Some(value),
            Tunable::Photons => settings.photons.volume = Some(whole as u64),
        }
        match self {
            Tunable::Neighbours | Tunable::Photons => format!("{whole}"),
            _ => format!("{value}"),
        }
    }
}

/// How a scene marches.
fn march(volume: &Volume) -> March {
    volume.march.clone().unwrap_or(March::DEFAULT)
}

fn plan(scene: &Scene, settings: &Settings) -> Result<Plan> {
    Plan::new(scene, settings, &Camera::new(&scene.camera, &settings.film), &Limits::default())
}

/// The radius of a plan with fixed ones.
fn radius(plan: &Plan) -> f64 {
    match plan.radius {
        crate::photon::Radius::Fixed(radius) => radius.into(),
        crate::photon::Radius::Variable { max_radius, .. } => max_radius.into(),
    }
}

/// n of a plan with adaptive radii.
fn neighbours(plan: &Plan) -> f64 {
    match plan.radius {
        crate::photon::Radius::Fixed(_) => 0.0,
        crate::photon::Radius::Variable { neighbours, .. } => neighbours.into(),
    }
}

/// The shortest step of a plan's marchers.
fn shortest_step(plan: &Plan) -> f64 {
    let marchers: &[Marcher] = plan.points.as_ref().map_or(&[], |points| &points.marchers);
    marchers.iter().fold(f64::INFINITY, |least, marcher| least.min(marcher.size))
}

/// What a variant's own limit has beside many samples, unless the study says so: all marchers have the same limit, which
/// short exponential steps find with the least noise.
pub fn limit(variant: &Variant, context: &Context<'_>) -> Result<Vec<Pair>> {
    if let Some(limit) = &variant.asked.limit {
        return Ok(limit.clone());
    }
    if !variant.marches() {
        return Ok(Vec::new());
    }
    let (scene, mut settings) = scene::build(&context.describe(&variant.asked.name, &variant.set)?)?;
    let own = settings.volume.march.as_mut().and_then(|march| march.size.take());
    let size = (0.5 * shortest_step(&plan(&scene, &settings)?)).min(own.unwrap_or(f64::INFINITY));
    let set = [("volume.march.step", "exponential".to_string()), ("volume.march.size", significant(size))];
    Ok(set.map(|(key, value)| (key.to_string(), value)).to_vec())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lists_of_variants_are_read() {
        let found = parse("path, mine:volume.neighbours=20, media.\"a,b\".sigma_s=[1,2,3] ,beam").unwrap();
        let names: Vec<&str> = found.iter().map(|variant| variant.name.as_str()).collect();
        assert_eq!(names, ["path", "mine", "beam"]);
        let pair = |key: &str, value: &str| (key.to_string(), value.to_string());
        assert_eq!(found[1].set, [pair("volume.neighbours", "20"), pair("media.\"a,b\".sigma_s", "[1,2,3]")]);
        for (text, expected) in [
            ("beem", "did you mean `beam`?"),
            ("", "no variant"),
            ("a=1", "expected a built-in"),
            ("a b:c=1", "expected a built-in"),
        ] {
            let message = parse(text).unwrap_err().to_string();
            assert!(message.contains(expected), "{text}: {message}");
        }
    }
}
