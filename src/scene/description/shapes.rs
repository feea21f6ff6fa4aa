//! Shapes and what they are made of: `[materials.*]` and `[[shapes]]`.

use std::path::PathBuf;

use serde::Serialize;

use super::{Located, Place};
use crate::light::Sides;
use crate::math::{DAffine3, DVec2, DVec3, Rgb};
use crate::surface::{self, Relief, Slot};

/// `[materials.*]`: what shapes are made of.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Material {
    /// The material's key under `[materials]`.
    pub name: String,
    /// Which kind of material it is, with what is said of it.
    pub kind: surface::Material,
    /// Textures that take the place of its constants.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub textures: Vec<(Slot, Located<Texture>)>,
    /// The texture that turns its normal.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub relief: Option<Relief<Located<Texture>>>,
    /// Where the material is described; for a default, the first shape that needs it.
    #[serde(skip)]
    pub place: Place,
}

/// A colour or number that changes over a surface.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Texture {
    /// From an image.
    Image {
        /// A `.png`, `.jpg`, `.exr`, `.hdr` or `.pfm` file.
        file: Located<PathBuf>,
        /// What is beyond its edge.
        wrap: surface::Wrap,
        /// How its integers are understood; `None`: as sRGB for colours, as they are for numbers and normals.
        color_space: Option<ColorSpace>,
        /// Turns (u, v, 0) into coordinates of the image.
        to_image: DAffine3,
    },
    /// Two colours by turns.
    Checker(surface::Checker),
    /// Between two colours by noise.
    Noise(surface::NoiseTexture),
}

/// How an image's integers are understood. Images of floating-point numbers are always linear.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum ColorSpace {
    /// By the curve of sRGB.
    Srgb,
    /// In proportion.
    Linear,
}

/// `[[shapes]]`: a surface, and what fills it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Shape {
    /// What instances and overrides call it; no two shapes share a name.
    pub name: Option<String>,
    /// The surface in object space.
    pub kind: ShapeKind,
    /// From object to world space, invertible. An instance's is applied after the transform of the
    /// shape it repeats, and to the density inside.
    pub transform: DAffine3,
    /// An index into [`Description::materials`](super::Description::materials). Not given: `none` with an interior, black with
    /// emission, an instance's template's; meaningless on an invisible shape.
    pub material: Located<usize>,
    /// An index into [`Description::media`](super::Description::media): what fills the solid. Only shapes that can be closed have
    /// one; whether a mesh is closed is not known yet. Behind an opaque material it is seen from inside only. An instance has its template's unless it says otherwise.
    pub interior: Option<Located<usize>>,
    /// The highest of the solids that contain a point decides what is there. An instance has its template's unless it says otherwise.
    pub priority: i32,
    /// The light it sends out. An instance has its template's unless it says otherwise.
    pub emission: Option<ShapeEmission>,
    /// What becomes of caustics. An instance has its template's unless it says otherwise.
    pub caustics: Caustics,
    /// False for what is only a template of instances.
    pub visible: bool,
    /// Where the shape is described.
    #[serde(skip)]
    pub place: Place,
}

/// Which caustics a shape has to do with (Jensen 2001, §9.3). Light that came from a light to a surface which spreads it by specular
/// events alone is left out where anything that mirrored or refracted it casts none, or the surface receives none.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct Caustics {
    /// Whether light that it mirrors or refracts may become a caustic.
    pub casts: bool,
    /// Whether caustics fall on it.
    pub receives: bool,
}

impl Caustics {
    /// As light has it.
    pub const ALL: Caustics = Caustics { casts: true, receives: true };
}

/// The kinds of shape.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum ShapeKind {
    /// A sphere.
    Sphere {
        /// The sphere's centre.
        center: DVec3,
        /// The sphere's radius, above 0.
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
        /// One of the parallelogram's corners.
        origin: DVec3,
        /// From `origin` along one edge.
        edge_u: DVec3,
        /// From `origin` along the other edge; not parallel to `edge_u`.
        edge_v: DVec3,
    },
    /// A flat disk.
    Disk {
        /// The disk's centre.
        center: DVec3,
        /// The unit normal, which points out.
        normal: DVec3,
        /// The disk's radius, above 0.
        radius: f64,
    },
    /// A round cylinder.
    Cylinder {
        /// The centre of one end.
        base: DVec3,
        /// The centre of the other end; differs from `base`.
        top: DVec3,
        /// The cylinder's radius, above 0.
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
        /// An index into [`Description::shapes`](super::Description::shapes) of a shape that is no instance itself: instances of
        /// instances are resolved, their transforms composed.
        of: usize,
    },
}

/// `shapes.*.emission`: the light that a shape sends out.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ShapeEmission {
    /// How strong the light is.
    pub strength: Strength,
    /// The sides of the surface that it leaves from.
    pub side: Sides,
    /// Where the emission is described.
    #[serde(skip)]
    pub place: Place,
}

/// How strong an emitting shape is, by channel and at least 0.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Strength {
    /// The radiance it sends in every direction, in W/(sr · unit²).
    Radiance(Rgb),
    /// The power in W over all emitting sides; radiance is power/(π A), A the emitting area after the
    /// transform, each instance anew.
    Power(Rgb),
}
