//! What a scene file says, typed and checked, before any other file is opened.
//!
//! One field for each key. Units are those of the file: lengths in scene units, coefficients per scene
//! unit, angles in degrees, colours in linear sRGB. Defaults are applied, except where a good value
//! depends on the loaded scene: those are `None`. References by name are indices. File names are
//! resolved against the folder of the scene file. Whatever may still turn out wrong once files are
//! loaded carries its [`Place`].

mod lights;
mod settings;
mod shapes;

use std::fmt;
use std::panic::Location;
use std::path::PathBuf;
use std::sync::Arc;

use serde::Serialize;

use crate::Error;
use crate::math::{DAffine3, DVec3, Rgb};
use crate::medium::density::bricks::{Interpolation, NegativePolicy, Precision};
use crate::medium::density::{Exponential, Noise};
use crate::medium::phase::Phase;
use crate::surface::Relief;

pub use lights::*;
pub use settings::*;
pub use shapes::*;

/// Where in a scene file, in which `--set`, or in which line of code something was said.
#[derive(Clone, PartialEq)]
pub struct Place {
    pub(crate) source: Source,
    pub(crate) key: Arc<str>,
}

/// The text a value comes from.
#[derive(Clone, PartialEq)]
pub(crate) enum Source {
    /// A byte of a scene file.
    File { offset: usize, document: Arc<Document> },
    /// An override of the command line, as it was typed: `key=value`.
    Override(Arc<str>),
    /// A line of code.
    Code(&'static Location<'static>),
}

/// A scene file as it was read.
#[derive(PartialEq, Eq)]
pub(crate) struct Document {
    pub(crate) name: String,
    pub(crate) text: String,
}

impl Place {
    /// The dotted key, for example `media.fog.sigma_s` or `shapes.2.radius`.
    pub fn key(&self) -> &str {
        &self.key
    }

    /// An error about what stands here: `file:line:column: key: message`, and below the line of the file.
    pub fn error(&self, message: impl fmt::Display) -> Error {
        Error::Scene(self.told(message))
    }

    /// A message about what stands here, as those of errors are.
    pub(crate) fn told(&self, message: impl fmt::Display) -> String {
        format!("{self}: {message}{}", self.source.excerpt())
    }
}

impl Source {
    /// Line and column, from 1, columns in characters; `None` for what is not in a scene file.
    pub(crate) fn line_and_column(&self) -> Option<(usize, usize)> {
        let Source::File { document, offset } = self else { return None };
        let before = document.text.get(..*offset).unwrap_or(&document.text);
        let start = before.rfind('\n').map_or(0, |newline| newline + 1);
        let lines = before.bytes().filter(|&byte| byte == b'\n').count();
        // A byte order mark takes no column.
        Some((lines + 1, before[start..].chars().filter(|&c| c != '\u{feff}').count() + 1))
    }
}

impl Source {
    /// The line of the file that this stands in, with a mark below its place: two lines more of a message, indented. Nothing for what is
    /// in no scene file.
    pub(crate) fn excerpt(&self) -> String {
        // So much of a long line is shown, and so much of that before the place.
        const SHOWN: usize = 100;
        const BEFORE: usize = 60;
        let (Source::File { document, .. }, Some((line, column))) = (self, self.line_and_column()) else {
            return String::new();
        };
        let Some(text) = document.text.lines().nth(line - 1) else { return String::new() };
        let first = (column - 1).saturating_sub(BEFORE);
        let plain = |c: char| if c.is_control() { ' ' } else { c };
        let shown: String = text.chars().filter(|&c| c != '\u{feff}').skip(first).take(SHOWN).map(plain).collect();
        format!("\n    {}\n    {}^", shown.trim_end(), " ".repeat(column - 1 - first))
    }
}

impl fmt::Display for Source {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match (self, self.line_and_column()) {
            (Source::File { document, .. }, Some((line, column))) => write!(f, "{}:{line}:{column}", document.name),
            (Source::File { document, .. }, None) => f.write_str(&document.name),
            (Source::Override(text), _) => write!(f, "--set {text}"),
            (Source::Code(place), _) => place.fmt(f),
        }
    }
}

/// Nothing: a description says enough without the place of each word.
impl fmt::Debug for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("_")
    }
}

impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.key.as_ref() {
            "" => write!(f, "{}", self.source),
            key => write!(f, "{}: {key}", self.source),
        }
    }
}

/// A value and where it was said.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(transparent)]
pub struct Located<T> {
    /// The value that was said.
    pub value: T,
    /// Where it was said; for a default, the table that leaves it out.
    #[serde(skip)]
    pub place: Place,
}

/// A whole scene file.
#[derive(Clone, Debug, Serialize)]
pub struct Description {
    /// The scene file.
    #[serde(skip)]
    pub path: PathBuf,
    /// What the scene calls itself.
    #[serde(skip)]
    pub title: Option<String>,
    /// `[film]`
    pub film: Film,
    /// `[camera]`
    pub camera: Camera,
    /// `[world]`
    pub world: World,
    /// `[media.*]`, in the order of the file.
    pub media: Vec<Medium>,
    /// `[materials.*]`, in the order of the file; then parts of mixtures that have no name, then what shapes without a `material` get.
    pub materials: Vec<Material>,
    /// `[[shapes]]`
    pub shapes: Vec<Shape>,
    /// `[[lights]]`
    pub lights: Vec<Light>,
    /// `[render]`
    pub render: Render,
    /// `[photons]`
    pub photons: Photons,
    /// `[volume]`
    pub volume: Volume,
    /// `[surface]`
    pub surface: Surface,
    /// What is allowed but probably not meant, each message complete.
    #[serde(skip)]
    pub warnings: Vec<String>,
}

impl Description {
    /// All files that the scene file names.
    pub fn files_mut(&mut self) -> Vec<&mut PathBuf> {
        let mut files = Vec::new();
        for medium in &mut self.media {
            files.extend(medium.density.file_mut());
        }
        for material in &mut self.materials {
            let relief = match &mut material.relief {
                Some(Relief::NormalMap(texture, _) | Relief::Bump(texture, _)) => Some(&mut texture.value),
                None => None,
            };
            let textures = material.textures.iter_mut().map(|(_, texture)| &mut texture.value).chain(relief);
            files.extend(textures.filter_map(|texture| match texture {
                Texture::Image { file, .. } => Some(&mut file.value),
                Texture::Checker(_) | Texture::Noise(_) => None,
            }));
        }
        for shape in &mut self.shapes {
            match &mut shape.kind {
                ShapeKind::Mesh { file, .. } => files.push(&mut file.value),
                ShapeKind::Sphere { .. }
                | ShapeKind::Box { .. }
                | ShapeKind::Quad { .. }
                | ShapeKind::Disk { .. }
                | ShapeKind::Cylinder { .. }
                | ShapeKind::Lathe { .. }
                | ShapeKind::Instance { .. } => {}
            }
        }
        for light in &mut self.lights {
            match &mut light.kind {
                LightKind::Environment { source: EnvironmentSource::Image(file), .. } => files.push(&mut file.value),
                LightKind::Profile { file, .. } => files.push(&mut file.value),
                LightKind::Environment { source: EnvironmentSource::Constant(_), .. }
                | LightKind::Point { .. }
                | LightKind::Spot { .. }
                | LightKind::Directional { .. }
                | LightKind::Sky { .. } => {}
            }
        }
        files
    }
}

/// `[camera]`: a pinhole, or a thin lens if `aperture` is above 0.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Camera {
    /// Where the camera stands.
    pub position: DVec3,
    /// What the camera looks at; differs from `position`.
    pub target: DVec3,
    /// What is up in the image; not parallel to the view, of any length.
    pub up: DVec3,
    /// How places of the film become rays.
    pub projection: Projection,
    /// The full angle along `fov_axis` in degrees, in (0, 180); of parallel rays that under which a perspective camera here would see
    /// as much of the plane through `target`.
    pub fov: f64,
    /// Along which side of the film that angle is.
    pub fov_axis: FovAxis,
    /// The radius of the lens, 0 for a pinhole.
    pub aperture: f64,
    /// The distance along the axis to the sharp plane.
    pub focus_distance: f64,
    /// Where the camera is described.
    #[serde(skip)]
    pub place: Place,
}

/// How places of the film become rays.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Projection {
    /// They come from one point, or the lens around it.
    Perspective,
    /// They are parallel.
    Orthographic,
}

/// A side of the film.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum FovAxis {
    /// Its height.
    Y,
    /// Its width.
    X,
    /// The shorter of both.
    Smaller,
}

/// `[world]`: what is everywhere outside solids.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct World {
    /// An index into [`Description::media`]; `None` is vacuum.
    pub medium: Option<Located<usize>>,
    /// What one scene unit is.
    pub unit: Unit,
}

/// A unit of length.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Unit {
    /// Millimetres.
    Millimetre,
    /// Centimetres.
    Centimetre,
    /// Metres.
    Metre,
}

impl Unit {
    /// How many metres it is.
    pub fn metres(self) -> f64 {
        match self {
            Unit::Millimetre => 1e-3,
            Unit::Centimetre => 1e-2,
            Unit::Metre => 1.0,
        }
    }
}

/// `[media.*]`: what fills shapes, or the world.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Medium {
    /// The medium's key under `[media]`.
    pub name: String,
    /// Scattering coefficient per scene unit where the density is 1, `scale` applied; at least 0; 0 where grids tell it.
    pub sigma_s: Rgb,
    /// Absorption coefficient per scene unit where the density is 1, `scale` applied; at least 0; 0 where grids tell it.
    pub sigma_a: Rgb,
    /// What grids of the density's file tell in place of numbers.
    #[serde(skip_serializing_if = "MediumGrids::is_empty")]
    pub grids: MediumGrids,
    /// How light is turned at a scattering event.
    pub phase: Phase,
    /// What both coefficients are multiplied by at each point.
    pub density: Density,
    /// How exactly its voxels are kept.
    pub precision: Precision,
    /// The light the medium sends out by itself.
    pub emission: Option<MediumEmission>,
    /// Whether it adds to what it overlaps, instead of taking its place.
    pub adds: bool,
    /// Where the medium is described.
    #[serde(skip)]
    pub place: Place,
}

/// A grid of the density's file ([`Density::grids`]).
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct NamedGrid {
    /// The name of the grid.
    pub name: Located<String>,
    /// What its values are multiplied by, at least 0.
    pub scale: f64,
}

/// What grids tell of a medium in place of numbers.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct MediumGrids {
    /// The extinction coefficient per scene unit where the density is 1, and the grid of the albedo.
    pub albedo: Option<(Rgb, NamedGrid)>,
    /// The scattering coefficient per scene unit.
    pub sigma_s: Option<NamedGrid>,
    /// The absorption coefficient per scene unit.
    pub sigma_a: Option<NamedGrid>,
    /// The mean cosine of a Henyey–Greenstein phase function.
    pub mean_cosine: Option<NamedGrid>,
}

impl MediumGrids {
    /// Whether all is told by numbers.
    pub fn is_empty(&self) -> bool {
        *self == MediumGrids::default()
    }

    /// All that are named.
    fn named(&self) -> impl Iterator<Item = &NamedGrid> {
        let albedo = self.albedo.as_ref().map(|(_, grid)| grid);
        [albedo, self.sigma_s.as_ref(), self.sigma_a.as_ref(), self.mean_cosine.as_ref()].into_iter().flatten()
    }
}

impl Medium {
    /// Whether it may absorb: as far as numbers tell.
    pub fn may_absorb(&self) -> bool {
        self.sigma_a != Rgb::ZERO || self.grids.albedo.is_some() || self.grids.sigma_a.is_some()
    }

    /// The names of all grids beside the density's that it is made of.
    pub(crate) fn named_grids(&self) -> impl Iterator<Item = &Located<String>> {
        let glow = match &self.emission {
            Some(MediumEmission::BlackBody { temperature, .. }) => Some(temperature),
            Some(MediumEmission::Grid { radiance }) => Some(&radiance.name),
            Some(MediumEmission::Constant { .. }) | None => None,
        };
        self.grids.named().map(|grid| &grid.name).chain(glow)
    }

    /// The extinction coefficient σ_t = σ_s + σ_a per scene unit where the density is 1.
    pub fn sigma_t(&self) -> Rgb {
        self.sigma_s + self.sigma_a
    }

    /// The single-scattering albedo σ_s/σ_t by channel, 0 where nothing is extinguished.
    pub fn albedo(&self) -> Rgb {
        let ratio = |s: f64, t: f64| if t > 0.0 { s / t } else { 0.0 };
        let t = self.sigma_t();
        Rgb::new(ratio(self.sigma_s.x, t.x), ratio(self.sigma_s.y, t.y), ratio(self.sigma_s.z, t.z))
    }
}

/// `media.*.density`: what a medium's coefficients are multiplied by. It lives in world space; an instance's transform carries it along.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Density {
    /// One value everywhere.
    Constant {
        /// The density, at least 0.
        value: f64,
    },
    /// A grid of an OpenVDB file.
    Vdb {
        /// The `.vdb` file.
        file: Located<PathBuf>,
        /// The name of the grid; `None`: the file's only grid, or else the one named `density`.
        grid: Option<Located<String>>,
        /// Applied after the grid's own transform.
        transform: DAffine3,
        /// The density between voxels.
        interpolation: Interpolation,
        /// What becomes of voxels below 0.
        negative: NegativePolicy,
    },
    /// Cell-centred samples in a box: clamped to the outer samples inside it, 0 outside.
    Array {
        /// A `.npy` file of float32 in C order, indices \[z\]\[y\]\[x\].
        file: Located<PathBuf>,
        /// The lower corner of the box.
        min: DVec3,
        /// The upper corner, above `min` on every axis.
        max: DVec3,
    },
    /// An atmosphere that thins out with height.
    Exponential(Exponential),
    /// Fractal noise, defined in all space; only what solids are filled with can have it.
    Noise(Noise),
}

impl Density {
    /// The value, at least 0, that it has everywhere, if it is even.
    pub fn even(&self) -> Option<f64> {
        match self {
            Density::Constant { value } => Some(*value),
            _ => None,
        }
    }

    /// Whether it is made only where shapes are filled with it.
    pub fn fills_shapes(&self) -> bool {
        matches!(self, Density::Noise(_))
    }

    /// The file whose grids have a place beside it, and their transform.
    pub fn grids(&self) -> Option<(&Located<PathBuf>, DAffine3)> {
        match self {
            Density::Vdb { file, transform, .. } => Some((file, *transform)),
            _ => None,
        }
    }

    /// The file it is read from.
    fn file_mut(&mut self) -> Option<&mut PathBuf> {
        match self {
            Density::Vdb { file, .. } | Density::Array { file, .. } => Some(&mut file.value),
            _ => None,
        }
    }
}

/// `media.*.emission`: L_e, which is multiplied by σ_a.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum MediumEmission {
    /// One radiance everywhere.
    Constant {
        /// L_e in W/(sr · unit²), `scale` applied; at least 0.
        radiance: Rgb,
    },
    /// A black body's, its temperature read from a second grid of the density's file ([`Density::grids`]).
    BlackBody {
        /// The name of the grid.
        temperature: Located<String>,
        /// Kelvin per unit of the grid, above 0.
        kelvin_scale: f64,
        /// What Planck's radiance is multiplied by, at least 0.
        scale: f64,
    },
    /// One that another grid of the density's file tells.
    Grid {
        /// L_e in W/(sr · unit²); voxels are at least 0.
        radiance: NamedGrid,
    },
}
