//! `[materials.*]`

use std::f64::consts::FRAC_PI_2;

use super::form::{COUNT, Form, NUMBER, POSITIVE, Range, SHARE, SHARE_CHANNELS, SHARE_COLOUR, STEPS};
use super::{Chosen, Is, Key, Nothing, Required, Section};

const TEXTURE: Form = Form::Said("a texture", &Form::Table("materials.*.reflectance"));
const COLOUR: Form = Form::OneOf(&[SHARE, SHARE_CHANNELS, TEXTURE]);
const SHARE_OR_TEXTURE: Form = Form::OneOf(&[SHARE, TEXTURE]);
const INDEX: Form = Form::OneOf(&[POSITIVE, Form::Said("[r, g, b]", &Form::Array(3, &POSITIVE))]);
const MATERIAL: Form = Form::OneOf(&[Form::Text("the name of a material"), Form::Table("materials.*")]);
const SPACE: Key = Key::new(
    "space",
    Form::Choice(&["uv", "object"]),
    Is("\"uv\""),
    "which coordinates it is of: those of the surface, or object space",
);
const A: Key = Key::new("a", SHARE_COLOUR, Is("0.8"), "the one colour");
const B: Key = Key::new("b", SHARE_COLOUR, Is("0.2"), "the other colour");
const F0: Key = Key::new("f0", COLOUR, Is("0.5"), "what it reflects head-on");
const ISOTROPY: Key =
    Key::new("isotropy", Form::Number(Range::AboveUpTo(0.0, 1.0)), Is("1"), "below 1 highlights are stretched");
const REFLECTANCE: Key = Key::new("reflectance", COLOUR, Is("0.5"), "the share of light that is reflected");

pub(super) const SECTIONS: &[Section] = &[
    Section {
        path: "materials.*",
        kind: "",
        about: "what a surface is made of",
        example: "",
        keys: &[
            Key::new("type", Form::Kind, Required, "which kind it is"),
            Key::new(
                "normal_map",
                TEXTURE,
                Nothing,
                "turns the normal by its colours, 2c − 1 along u, v and the normal",
            )
            .see(&["materials.*.strength"]),
            Key::new("bump", TEXTURE, Nothing, "turns the normal by its slope, as a height in scene units")
                .see(&["materials.*.strength"]),
            Key::new(
                "strength",
                NUMBER,
                Chosen("1, beside normal_map or bump alone"),
                "multiplies how far the normal is turned",
            )
            .see(&["materials.*.bump"]),
        ],
    },
    Section {
        path: "materials.*",
        kind: "lambert",
        about: "diffuse, on both sides",
        example: "materials.NAME = { type = \"lambert\", reflectance = [0.7, 0.2, 0.1] }",
        keys: &[REFLECTANCE],
    },
    Section {
        path: "materials.*",
        kind: "oren_nayar",
        about: "diffuse and rough, on both sides",
        example: "materials.NAME = { type = \"oren_nayar\", sigma = 0.5 }",
        keys: &[
            REFLECTANCE,
            Key::new(
                "sigma",
                Form::Number(Range::Within(0.0, FRAC_PI_2)),
                Is("0.3"),
                "the standard deviation of slopes; 0 is lambert",
            )
            .unit("radians"),
        ],
    },
    Section {
        path: "materials.*",
        kind: "mirror",
        about: "a mirror, on both sides",
        example: "materials.NAME = { type = \"mirror\", reflectance = 0.9 }",
        keys: &[Key::new("reflectance", COLOUR, Is("1"), "the share of light that is reflected")
            .cost("caustics, for which photons are traced")
            .see(&["photons.caustic"])],
    },
    Section {
        path: "materials.*",
        kind: "phong",
        about: "diffuse, with a lobe about the mirror direction",
        example: "materials.NAME = { type = \"phong\", diffuse = 0.4, specular = 0.4, exponent = 100 }",
        keys: &[
            Key::new("diffuse", COLOUR, Is("0.5"), "the share that is reflected diffusely"),
            Key::new("specular", COLOUR, Is("0.3"), "the share of the lobe; both together at most 1"),
            Key::new(
                "exponent",
                Form::Number(Range::Within(0.0, 1e6)),
                Is("50"),
                "n of specular (n + 2)/2π cosⁿ: how narrow the lobe is",
            ),
        ],
    },
    Section {
        path: "materials.*",
        kind: "schlick",
        about: "Schlick's surface, of one layer or two",
        example: "materials.NAME = { type = \"schlick\", f0 = 0.05, layer = { f0 = 0.6, roughness = 1 } }",
        keys: &[
            F0,
            Key::new("roughness", SHARE_OR_TEXTURE, Is("0.1"), "the book's σ, from 0, a mirror, to 1, diffuse; α = √σ"),
            ISOTROPY,
            Key::new("layer", Form::Table("materials.*.layer"), Nothing, "a second layer under it"),
        ],
    },
    Section {
        path: "materials.*.layer",
        kind: "",
        about: "the lower layer of a schlick surface",
        example: "materials.NAME = { type = \"schlick\", layer = { f0 = 0.6 } }",
        keys: &[F0, Key::new("roughness", SHARE_OR_TEXTURE, Is("0.1"), "as of the upper one"), ISOTROPY],
    },
    Section {
        path: "materials.*",
        kind: "conductor",
        about: "a metal: one of f0, eta with k, and metal",
        example: "materials.NAME = { type = \"conductor\", metal = \"Au\", roughness = 0.2 }",
        keys: &[
            Key::new("f0", COLOUR, Nothing, "what it reflects head-on"),
            Key::new("eta", INDEX, Nothing, "the real part of its index of refraction").see(&["materials.*.k"]),
            Key::new("k", COLOUR, Nothing, "the imaginary part").see(&["materials.*.eta"]),
            Key::new("metal", Form::Choice(&["Ag", "Al", "Au", "Cu"]), Nothing, "measured indices"),
            Key::new(
                "roughness",
                Form::OneOf(&[SHARE, Form::Said("two of them", &Form::Array(2, &SHARE)), TEXTURE]),
                Is("0"),
                "GGX's α, or that along u and along v: brushed metal",
            )
            .cost("light between facets is followed"),
        ],
    },
    Section {
        path: "materials.*",
        kind: "coated",
        about: "a dielectric coat over a base: varnish, glaze, plastic",
        example: "materials.NAME = { type = \"coated\", base = { type = \"lambert\", reflectance = 0.6 } }",
        keys: &[
            Key::new("base", MATERIAL, Required, "what is under the coat, which reflects"),
            Key::new("ior", POSITIVE, Is("1.5"), "the coat's index of refraction"),
            Key::new("roughness", SHARE_OR_TEXTURE, Is("0"), "GGX's α of the coat")
                .cost("a rough coat is asked by walks between its facets"),
        ],
    },
    Section {
        path: "materials.*",
        kind: "thin_dielectric",
        about: "a sheet without thickness: window glass, bubbles",
        example: "materials.NAME = { type = \"thin_dielectric\" }",
        keys: &[Key::new("ior", INDEX, Is("1.5"), "its index of refraction")],
    },
    Section {
        path: "materials.*",
        kind: "mix",
        about: "two materials side by side",
        example: "materials.NAME = { type = \"mix\", a = { type = \"lambert\" }, b = { type = \"mirror\" }, weight = 0.2 }",
        keys: &[
            Key::new("a", MATERIAL, Required, "the one"),
            Key::new("b", MATERIAL, Required, "the other; one of both may be \"none\": a mask"),
            Key::new("weight", SHARE_OR_TEXTURE, Is("0.5"), "the share of b"),
        ],
    },
    Section {
        path: "materials.*",
        kind: "dielectric",
        about: "a refracting boundary, of closed shapes: glass, water",
        example: "materials.NAME = { type = \"dielectric\", ior = [1.500, 1.504, 1.513] }",
        keys: &[
            Key::new(
                "ior",
                INDEX,
                Is("1.5"),
                "the absolute index of refraction of what is inside; by channel it disperses",
            )
            .cost("caustics, for which photons are traced")
            .see(&["shapes.*.priority", "photons.caustic"]),
            Key::new("roughness", SHARE_OR_TEXTURE, Is("0"), "GGX's α, from 0, smooth, to 1; nothing is lost"),
        ],
    },
    Section {
        path: "materials.*",
        kind: "none",
        about: "no surface: light passes, only the medium changes",
        example: "materials.NAME = { type = \"none\" }",
        keys: &[],
    },
    Section {
        path: "materials.*.reflectance",
        kind: "",
        about: "a texture, in place of a colour, a roughness or a weight",
        example: "",
        keys: &[Key::new("texture", Form::Kind, Required, "which kind it is")],
    },
    Section {
        path: "materials.*.reflectance",
        kind: "image",
        about: "a texture from an image, mip-mapped",
        example: "materials.NAME = { type = \"lambert\", reflectance = { texture = \"image\", file = \"wood.png\" } }",
        keys: &[
            Key::new(
                "file",
                Form::Text("the name of a .png, .jpg, .exr, .hdr or .pfm file"),
                Required,
                "the image, from the folder of the scene",
            )
            .cost("16 bytes for each of its pixels, about"),
            Key::new("wrap", Form::Choice(&["repeat", "clamp", "mirror"]), Is("\"repeat\""), "what is beyond its edge"),
            Key::new(
                "color_space",
                Form::Choice(&["srgb", "linear"]),
                Chosen("sRGB for colours of integers, else linear"),
                "how its integers are read",
            ),
            Key::new("transform", STEPS, Chosen("none"), "moves (u, v, 0) to the image")
                .see(&["shapes.*.transform.*.scale"]),
        ],
    },
    Section {
        path: "materials.*.reflectance",
        kind: "checker",
        about: "a texture of cells",
        example: "materials.NAME = { type = \"lambert\", reflectance = { texture = \"checker\", scale = 8 } }",
        keys: &[A, B, Key::new("scale", POSITIVE, Is("1"), "cells to a unit"), SPACE],
    },
    Section {
        path: "materials.*.reflectance",
        kind: "noise",
        about: "a texture from a to b by fractal noise",
        example: "materials.NAME = { type = \"lambert\", reflectance = { texture = \"noise\", scale = 0.2 } }",
        keys: &[
            A,
            B,
            Key::new("scale", POSITIVE, Is("1"), "the size of its coarsest features"),
            Key::new(
                "octaves",
                Form::Integer(Range::Within(1.0, 12.0)),
                Is("4"),
                "each is half as large and half as strong as the one before",
            ),
            Key::new("threshold", Form::Number(Range::HalfOpen(0.0, 1.0)), Is("0"), "noise below it is all a"),
            Key::new("seed", COUNT, Is("0"), "another seed, another noise"),
            SPACE,
        ],
    },
];
