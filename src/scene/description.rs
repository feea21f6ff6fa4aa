//! What a scene file says, typed and checked, before any other file is opened.
//!
//! One field for each key. Units are those of the file: lengths in scene units, coefficients per scene
//! unit, angles in degrees, colours in linear sRGB. Defaults are applied, except where a good value
//! depends on the loaded scene: those are `None`. References by name are indices. File names are
//! resolved against the folder of the scene file. Whatever may still turn out wrong once files are
//! loaded carries its [`Place`].

use std::fmt;
use std::path::PathBuf;
use std::sync::Arc;

use crate::Error;
use crate::math::{DAffine3, DVec2, DVec3, Rgb};
use crate::medium::density::{Exponential, Noise};
use crate::medium::phase::Phase;

/// Where in a scene file, or in which `--set`, something was said.
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

    /// An error about what stands here: `file:line:column: key: message`.
    pub fn error(&self, message: impl fmt::Display) -> Error {
        Error::Scene(format!("{self}: {message}"))
    }
}

impl Source {
    /// Line and column, from 1, columns in characters; `None` for an override.
    pub(crate) fn line_and_column(&self) -> Option<(usize, usize)> {
        let Source::File { document, offset } = self else { return None };
        let before = document.text.get(..*offset).unwrap_or(&document.text);
        let start = before.rfind('\n').map_or(0, |newline| newline + 1);
        let lines = before.bytes().filter(|&byte| byte == b'\n').count();
        // A byte order mark takes no column.
        Some((lines + 1, before[start..].chars().filter(|&c| c != '\u{feff}').count() + 1))
    }
}

impl fmt::Display for Source {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match (self, self.line_and_column()) {
            (Source::File { document, .. }, Some((line, column))) => write!(f, "{}:{line}:{column}", document.name),
            (Source::File { document, .. }, None) => f.write_str(&document.name),
            (Source::Override(text), _) => write!(f, "--set {text}"),
        }
    }
}

/// Nothing: descriptions that say the same look the same, wherever they say it
/// ([`crate::render::checkpoint`] compares them so).
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
#[derive(Clone, Debug, PartialEq)]
pub struct Located<T> {
    /// The value.
    pub value: T,
    /// Where it was said; for a default, the table that leaves it out.
    pub place: Place,
}

/// A whole scene file.
#[derive(Clone, Debug)]
pub struct Description {
    /// The scene file.
    pub path: PathBuf,
    /// What the scene calls itself.
    pub title: Option<String>,
    /// `[film]`
    pub film: Film,
    /// `[camera]`
    pub camera: Camera,
    /// `[world]`
    pub world: World,
    /// `[media.*]`, in the order of the file.
    pub media: Vec<Medium>,
    /// `[materials.*]`, in the order of the file; then those that shapes without a `material` get.
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
    /// What is allowed but probably not meant, each message complete.
    pub warnings: Vec<String>,
}

impl Description {
    /// All files that the scene file names.
    pub fn files_mut(&mut self) -> Vec<&mut PathBuf> {
        let mut files = Vec::new();
        for medium in &mut self.media {
            files.extend(medium.density.file_mut());
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
                LightKind::Environment { source: EnvironmentSource::Constant(_), .. }
                | LightKind::Point { .. }
                | LightKind::Spot { .. }
                | LightKind::Directional { .. } => {}
            }
        }
        files
    }
}

/// `[film]`: the image.
#[derive(Clone, Debug, PartialEq)]
pub struct Film {
    /// Pixels across, at least 1.
    pub width: u32,
    /// Pixels down, at least 1.
    pub height: u32,
    /// How samples are weighted into pixels.
    pub filter: Filter,
    /// Stops by which PNG files are brightened; `None`: chosen from the image.
    pub exposure: Option<f64>,
    /// The tone curve of PNG files.
    pub tone_map: ToneMap,
    /// Whether EXR files carry the components of light transport as layers.
    pub layers: bool,
    /// Whether a single pass splits its photons to estimate the standard error.
    pub standard_error: bool,
}

/// The reconstruction filter of the film.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Filter {
    /// The mean over the pixel's square.
    Box,
    /// A tent two pixels wide.
    Tent,
    /// A truncated Gaussian.
    Gaussian,
}

/// How radiance becomes the values of a PNG file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ToneMap {
    /// Exposure, then clipping.
    Linear,
    /// A curve with toe and shoulder.
    Filmic,
}

/// `[camera]`: a pinhole, or a thin lens if `aperture` is above 0.
#[derive(Clone, Debug, PartialEq)]
pub struct Camera {
    /// Where it stands.
    pub position: DVec3,
    /// What it looks at; differs from `position`.
    pub target: DVec3,
    /// What is up in the image; not parallel to the view, of any length.
    pub up: DVec3,
    /// The full vertical angle in degrees, in (0, 180).
    pub fov: f64,
    /// The radius of the lens, 0 for a pinhole.
    pub aperture: f64,
    /// The distance along the axis to the sharp plane.
    pub focus_distance: f64,
    /// Where the camera is described.
    pub place: Place,
}

/// `[world]`: what is everywhere outside solids.
#[derive(Clone, Debug, PartialEq)]
pub struct World {
    /// An index into [`Description::media`]; `None` is vacuum.
    pub medium: Option<Located<usize>>,
    /// What one scene unit is.
    pub unit: Unit,
}

/// A unit of length.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
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

/// `[media.*]`
#[derive(Clone, Debug, PartialEq)]
pub struct Medium {
    /// Its key under `[media]`.
    pub name: String,
    /// Scattering coefficient per scene unit where the density is 1, `scale` applied; at least 0.
    pub sigma_s: Rgb,
    /// Absorption coefficient per scene unit where the density is 1, `scale` applied; at least 0.
    pub sigma_a: Rgb,
    /// How light is turned at a scattering event.
    pub phase: Phase,
    /// What both coefficients are multiplied by at each point.
    pub density: Density,
    /// The light the medium sends out by itself.
    pub emission: Option<MediumEmission>,
    /// Where it is described.
    pub place: Place,
}

impl Medium {
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

/// `media.*.density`. It lives in world space; an instance's transform carries it along.
#[derive(Clone, Debug, PartialEq)]
pub enum Density {
    /// The same everywhere.
    Constant {
        /// The density, at least 0.
        value: f64,
    },
    /// A grid of an OpenVDB file.
    Vdb {
        /// The file.
        file: Located<PathBuf>,
        /// The name of the grid; `None`: the file's only grid, or else the one named `density`.
        grid: Option<Located<String>>,
        /// Applied after the grid's own transform.
        transform: DAffine3,
        /// Between voxels.
        interpolation: Interpolation,
        /// What becomes of voxels below 0.
        negative: Negative,
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
    /// An atmosphere.
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

/// What a grid's value is between voxels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Interpolation {
    /// Linear on each axis.
    Trilinear,
    /// That of the nearest voxel.
    Nearest,
}

/// What becomes of negative voxels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Negative {
    /// The file is refused.
    Error,
    /// They count as 0.
    Zero,
}

/// `media.*.emission`: L_e, which is multiplied by σ_a.
#[derive(Clone, Debug, PartialEq)]
pub enum MediumEmission {
    /// The same radiance everywhere.
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
}

/// `[materials.*]`
#[derive(Clone, Debug, PartialEq)]
pub struct Material {
    /// Its key under `[materials]`.
    pub name: String,
    /// What it does with light.
    pub kind: MaterialKind,
    /// Where it is described; for a default, the first shape that needs it.
    pub place: Place,
}

/// The kinds of material.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum MaterialKind {
    /// Diffuse reflection on both sides.
    Lambert {
        /// In \[0, 1\].
        reflectance: Rgb,
    },
    /// Perfectly specular reflection on both sides.
    Mirror {
        /// In \[0, 1\].
        reflectance: Rgb,
    },
    /// A refracting boundary.
    Dielectric {
        /// The absolute index of refraction by channel, above 0.
        ior: Rgb,
        /// GGX's α, in \[0, 1\]; 0 is smooth.
        roughness: f64,
    },
    /// An index-matched boundary: light passes, only the medium changes.
    None,
}

/// `[[shapes]]`
#[derive(Clone, Debug, PartialEq)]
pub struct Shape {
    /// What instances and overrides call it; no two shapes share a name.
    pub name: Option<String>,
    /// The surface in object space.
    pub kind: ShapeKind,
    /// From object to world space, invertible. An instance's is applied after the transform of the
    /// shape it repeats, and to the density inside.
    pub transform: DAffine3,
    /// An index into [`Description::materials`]. Not given: `none` with an interior, black with
    /// emission, an instance's template's; meaningless on an invisible shape.
    pub material: Located<usize>,
    /// An index into [`Description::media`]: what fills the solid. Only shapes that can be closed have
    /// one; whether a mesh is closed is not known yet. Behind an opaque material it is seen from inside only. An instance has its template's unless it says otherwise.
    pub interior: Option<Located<usize>>,
    /// The highest of the solids that contain a point decides what is there. An instance has its template's unless it says otherwise.
    pub priority: i32,
    /// The light it sends out. An instance has its template's unless it says otherwise.
    pub emission: Option<ShapeEmission>,
    /// False for what is only a template of instances.
    pub visible: bool,
    /// Where it is described.
    pub place: Place,
}

/// The kinds of shape.
#[derive(Clone, Debug, PartialEq)]
pub enum ShapeKind {
    /// A sphere.
    Sphere {
        /// Its centre.
        center: DVec3,
        /// Above 0.
        radius: f64,
    },
    /// A box with faces across the axes.
    Box {
        /// The lower corner.
        min: DVec3,
        /// The upper corner, above `min` on every axis.
        max: DVec3,
    },
    /// A parallelogram; out is `edge_u` × `edge_v`.
    Quad {
        /// A corner.
        origin: DVec3,
        /// From `origin` along one edge.
        edge_u: DVec3,
        /// From `origin` along the other edge; not parallel to `edge_u`.
        edge_v: DVec3,
    },
    /// A flat disk.
    Disk {
        /// Its centre.
        center: DVec3,
        /// Out; of unit length.
        normal: DVec3,
        /// Above 0.
        radius: f64,
    },
    /// A round cylinder.
    Cylinder {
        /// The centre of one end.
        base: DVec3,
        /// The centre of the other end; differs from `base`.
        top: DVec3,
        /// Above 0.
        radius: f64,
        /// Whether the ends are closed.
        caps: bool,
    },
    /// A polyline turned about the y axis.
    Lathe {
        /// Points (radius, height): at least two, those in a row differ, radii are not below 0.
        profile: Vec<DVec2>,
        /// Flat facets around the axis; none for round.
        segments: Option<u32>,
        /// Kinks of less than this, in degrees, are shaded round.
        crease: f64,
    },
    /// Triangles from a file.
    Mesh {
        /// An `.obj` file, or an `.obj.gz` one.
        file: Located<PathBuf>,
        /// Whether the file's shading normals are used.
        smooth: bool,
    },
    /// Another shape once more.
    Instance {
        /// An index into [`Description::shapes`] of a shape that is no instance itself: instances of
        /// instances are resolved, their transforms composed.
        of: usize,
    },
}

/// `shapes.*.emission`
#[derive(Clone, Debug, PartialEq)]
pub struct ShapeEmission {
    /// How much.
    pub strength: Strength,
    /// From which side.
    pub side: Side,
    /// Where it is described.
    pub place: Place,
}

/// How strong an emitting shape is, by channel and at least 0.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Strength {
    /// The radiance it sends in every direction, in W/(sr · unit²).
    Radiance(Rgb),
    /// The power in W over all emitting sides; radiance is power/(π A), A the emitting area after the
    /// transform, each instance anew.
    Power(Rgb),
}

/// The sides of a surface that emit.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Side {
    /// Away from the inside.
    Out,
    /// Towards the inside.
    In,
    /// Either way; the emitting area is twice the surface's.
    Both,
}

/// `[[lights]]`
#[derive(Clone, Debug, PartialEq)]
pub struct Light {
    /// What overrides and messages call it.
    pub name: Option<String>,
    /// What it is.
    pub kind: LightKind,
    /// Where it is described.
    pub place: Place,
}

/// The kinds of light. Strengths are by channel and at least 0.
#[derive(Clone, Debug, PartialEq)]
pub enum LightKind {
    /// The same in every direction.
    Point {
        /// Where it is.
        position: DVec3,
        /// In W/sr; power/4π where a power was given.
        intensity: Rgb,
        /// Above 0, a sphere of the same power.
        radius: f64,
    },
    /// A cone with a soft edge.
    Spot {
        /// Where it is.
        position: DVec3,
        /// The unit vector towards its target.
        direction: DVec3,
        /// In W/sr on the axis; computed from the power where one was given.
        intensity: Rgb,
        /// The half-angle within which it is full, in degrees, at most `outer_angle`.
        inner_angle: f64,
        /// The half-angle outside of which it is dark, in degrees, in (0, 90].
        outer_angle: f64,
        /// Above 0, a disc facing the target with the same intensity far away.
        radius: f64,
    },
    /// Parallel light, or nearly so.
    Directional {
        /// The unit direction of travel.
        direction: DVec3,
        /// In W/unit² on a plane that faces it.
        irradiance: Rgb,
        /// The apparent diameter in degrees, in [0, 180).
        angle: f64,
        /// The round beam it is restricted to; `None`: unbounded.
        beam: Option<Beam>,
    },
    /// Light from infinity, all around.
    Environment {
        /// Where its radiance comes from.
        source: EnvironmentSource,
        /// What the radiance is multiplied by.
        scale: Rgb,
        /// The turn about +y in degrees, counter-clockwise from above.
        rotate: f64,
    },
}

/// The disc a round directional beam starts on, perpendicular to its direction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Beam {
    /// The disc's centre.
    pub center: DVec3,
    /// The disc's radius, above 0.
    pub radius: f64,
}

/// Where an environment's radiance comes from.
#[derive(Clone, Debug, PartialEq)]
pub enum EnvironmentSource {
    /// The same radiance from everywhere, in W/(sr · unit²).
    Constant(Rgb),
    /// A latitude–longitude image, `.exr` or `.hdr`.
    Image(Located<PathBuf>),
}

/// `[render]`
#[derive(Clone, Debug, PartialEq)]
pub struct Render {
    /// How the image is computed.
    pub method: Method,
    /// Camera samples per pixel and pass, at least 1.
    pub samples: u32,
    /// Passes, each with fresh photons in narrower discs, at least 1.
    pub passes: u32,
    /// What all random numbers derive from.
    pub seed: u64,
    /// The number of events between light and eye; 0: unlimited.
    pub max_depth: u32,
}

/// How the image is computed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Method {
    /// Photon mapping.
    Photon,
    /// The unbiased path tracer.
    Path,
}

/// `[photons]`
#[derive(Clone, Debug, PartialEq)]
pub struct Photons {
    /// About how many photons the volume map should hold, at least 1; `None`: chosen from the scene.
    pub volume: Option<u64>,
    /// The most photons that are emitted in a pass, at least 1.
    pub max_emitted: u64,
}

/// `[volume]`: how media are gathered.
#[derive(Clone, Debug, PartialEq)]
pub struct Volume {
    /// What is gathered along a ray.
    pub estimate: Estimate,
    /// How wide photons are.
    pub kernel: Kernel,
    /// How photons count from their middle to their rim; `None`: chosen by the estimate.
    pub profile: Option<Profile>,
    /// The radius of [`Kernel::Fixed`], above 0; `None`: chosen from the scene.
    pub radius: Option<f64>,
    /// The number n of photons an adaptive radius should cover, at least 1; `None`: chosen from the scene.
    pub neighbours: Option<u32>,
    /// The number m of photons from which an adaptive radius is found, at least 5; `None`: max(5, ⌈√n⌉).
    pub pilot: Option<u32>,
    /// The cap of adaptive radii, above 0; `None`: chosen from the scene.
    pub max_radius: Option<f64>,
    /// How rays are stepped through, where they are.
    pub march: Option<March>,
    /// Where light comes from that is scattered once.
    pub single_scattering: SingleScattering,
}

/// What is gathered along a ray.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Estimate {
    /// All photons around the ray at once.
    Beam,
    /// The photons around points on the ray.
    Point,
}

/// How photons count from their middle to their rim.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Profile {
    /// The same everywhere.
    Constant,
    /// 1 − x².
    Epanechnikov,
    /// (1 − x²)².
    Biweight,
}

/// `[volume] march`
#[derive(Clone, Debug, PartialEq)]
pub struct March {
    /// How long steps are.
    pub step: Step,
    /// The length of the smallest step, above 0; `None`: chosen from the scene.
    pub size: Option<f64>,
    /// What the ends of an adaptive step may differ by, above 0, as a share.
    pub contrast: f64,
}

impl March {
    /// What holds unless the scene file says otherwise. The contrast is about the noise of some tens of photons: with less,
    /// all steps would be halved; with more, what is small and bright is missed too often (`scenes/volume-caustic.toml`).
    pub const DEFAULT: March = March { step: Step::Exponential, size: None, contrast: 0.2 };
}

/// How long the steps of a march are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Step {
    /// All alike.
    Uniform,
    /// Short where density or light change.
    Adaptive,
    /// The longer the less light arrives from there.
    Exponential,
}

/// Where light comes from that a medium scatters straight from a light.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SingleScattering {
    /// From photons, like all other.
    Photons,
    /// By rays to the lights, through index-matched boundaries.
    Traced,
    /// By rays to the lights that go straight on, through refracting boundaries, too.
    Approximate,
}

impl SingleScattering {
    /// Whether rays to the lights ask for this light, so that photons must not bring it as well.
    pub fn asks_lights(self) -> bool {
        self != SingleScattering::Photons
    }

    /// Whether these rays go straight on through refracting boundaries, which in truth turn them.
    pub fn goes_straight_on(self) -> bool {
        self == SingleScattering::Approximate
    }
}

/// How wide photons are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kernel {
    /// One radius for all.
    Fixed,
    /// As wide as the photons around are sparse.
    Variable,
}
