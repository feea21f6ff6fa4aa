//! `[media.*]`

use super::form::{
    COLOUR, COLOUR_CHANNELS, COUNT, DIRECTION, Form, NON_NEGATIVE, POSITIVE, Range, SHARE, SHARE_CHANNELS, STEPS,
    STRING, THREE, VECTOR,
};
use super::{Chosen, Is, Key, Nothing, Required, Section};
use crate::medium::presets::PRESETS;

/// The names of measured media.
const MEASURED: [&str; PRESETS.len()] = {
    let mut names = [""; PRESETS.len()];
    let mut at = 0;
    while at < names.len() {
        names[at] = PRESETS[at].name;
        at += 1;
    }
    names
};
const GRID: Form = Form::Said("a grid", &Form::Table("media.*.albedo"));
const PRECISION: Key =
    Key::new("precision", Form::Choice(&["full", "half"]), Is("\"full\""), "how exactly voxels are kept")
        .cost("half: half of their memory, 0.05 % off");
const KIND: Key = Key::new("type", Form::Kind, Required, "which kind it is");

pub(super) const SECTIONS: &[Section] = &[
    Section {
        path: "media.*",
        kind: "",
        about: "a medium: what fills space and scatters light",
        example: "media.NAME = { sigma_s = 1.0, sigma_a = 0.1 }",
        keys: &[
            Key::new(
                "sigma_s",
                Form::OneOf(&[NON_NEGATIVE, COLOUR_CHANNELS, GRID]),
                Chosen("0 beside sigma_a"),
                "the scattering coefficient where the density is 1",
            )
            .unit("1/unit")
            .see(&["media.*.sigma_a", "media.*.sigma_t"]),
            Key::new(
                "sigma_a",
                Form::OneOf(&[NON_NEGATIVE, COLOUR_CHANNELS, GRID]),
                Chosen("0 beside sigma_s"),
                "the absorption coefficient where the density is 1",
            )
            .unit("1/unit")
            .see(&["media.*.sigma_s"]),
            Key::new("sigma_t", COLOUR, Nothing, "the extinction coefficient where the density is 1, beside albedo")
                .unit("1/unit")
                .see(&["media.*.albedo"]),
            Key::new(
                "albedo",
                Form::OneOf(&[SHARE, SHARE_CHANNELS, GRID]),
                Nothing,
                "the share of the extinction that scatters, beside sigma_t",
            )
            .cost("the nearer to 1, the longer light is on its way")
            .see(&["media.*.sigma_t"]),
            Key::new(
                "preset",
                Form::Said("the name of a measured medium, such as \"marble\"", &Form::Choice(&MEASURED)),
                Nothing,
                "coefficients as they were measured, instead of given ones",
            )
            .see(&["media.*.unit", "media.*.scale", "world.unit"]),
            Key::new("scale", NON_NEGATIVE, Is("1"), "multiplies the coefficients"),
            Key::new(
                "unit",
                Form::Choice(&["scene", "mm", "cm", "m"]),
                Chosen("\"scene\"; \"mm\" with a preset"),
                "what coefficients are given per",
            )
            .see(&["world.unit"]),
            Key::new(
                "phase",
                Form::Table("media.*.phase"),
                Chosen("{ type = \"isotropic\" }"),
                "how light is turned where it is scattered",
            )
            .see(&["media.*.phase.g"]),
            Key::new(
                "density",
                Form::Table("media.*.density"),
                Chosen("{ type = \"constant\", value = 1 }"),
                "what the coefficients are multiplied by, from place to place",
            ),
            Key::new(
                "emission",
                Form::Table("media.*.emission"),
                Chosen("dark"),
                "what it glows with, multiplied by what it absorbs",
            ),
            Key::new(
                "add",
                Form::Boolean,
                Is("false"),
                "whether it adds to the media that it overlaps, instead of taking their place",
            )
            .see(&["shapes.*.priority"]),
        ],
    },
    Section {
        path: "media.*.phase",
        kind: "",
        about: "a phase function: how light is turned where it is scattered",
        example: "",
        keys: &[KIND],
    },
    Section {
        path: "media.*.phase",
        kind: "isotropic",
        about: "every direction alike",
        example: "media.NAME = { sigma_s = 1.0, phase = { type = \"isotropic\" } }",
        keys: &[],
    },
    Section {
        path: "media.*.phase",
        kind: "hg",
        about: "Henyey and Greenstein's",
        example: "media.NAME = { sigma_s = 1.0, phase = { type = \"hg\", g = 0.75 } }",
        keys: &[Key::new(
            "g",
            Form::OneOf(&[Form::Number(Range::Between(-1.0, 1.0)), GRID]),
            Required,
            "the mean cosine of the angle by which light is turned: above 0 it goes on, below 0 it comes back",
        )
        .cost("near 1 photons that fly towards the eye are bright: volume.peaks")
        .see(&["volume.peaks", "volume.neighbours"])],
    },
    Section {
        path: "media.*.phase",
        kind: "schlick",
        about: "Schlick's rational approximation of hg",
        example: "media.NAME = { sigma_s = 1.0, phase = { type = \"schlick\", k = 0.6 } }",
        keys: &[Key::new("k", Form::Number(Range::Between(-1.0, 1.0)), Required, "its anisotropy, positive forward")],
    },
    Section {
        path: "media.*.phase",
        kind: "rayleigh",
        about: "of particles far smaller than the wavelength",
        example: "media.NAME = { sigma_s = 1.0, phase = { type = \"rayleigh\" } }",
        keys: &[],
    },
    Section {
        path: "media.*.phase",
        kind: "mie",
        about: "of water droplets: mist, fog and clouds",
        example: "media.NAME = { sigma_s = 1.0, phase = { type = \"mie\", diameter = 10 } }",
        keys: &[Key::new(
            "diameter",
            Form::Number(Range::AboveUpTo(0.0, 50.0)),
            Required,
            "of the droplets: 5 to 50 is mist to cloud",
        )
        .unit("µm")
        .cost("a very narrow peak: volume.peaks")
        .see(&["volume.peaks"])],
    },
    Section {
        path: "media.*.phase",
        kind: "mixture",
        about: "several together",
        example: "media.NAME = { sigma_s = 1.0, phase = { type = \"mixture\", lobes = [{ weight = 0.8, type = \"hg\", g = 0.8 }, { weight = 0.2, type = \"isotropic\" }] } }",
        keys: &[Key::new(
            "lobes",
            Form::List("tables", &Form::Table("media.*.phase.lobes.*")),
            Required,
            "phase functions, each with a weight",
        )
        .see(&["media.*.phase.lobes.*.weight"])],
    },
    Section {
        path: "media.*.phase.lobes.*",
        kind: "isotropic",
        about: "a part of a mixture of phase functions: the keys of its own type, and",
        example: "media.NAME = { sigma_s = 1.0, phase = { type = \"mixture\", lobes = [{ weight = 1, type = \"isotropic\" }] } }",
        keys: &[KIND, Key::new("weight", SHARE, Required, "its share; all add up to 1")],
    },
    Section {
        path: "media.*.density",
        kind: "",
        about: "a density: what coefficients are multiplied by",
        example: "",
        keys: &[KIND],
    },
    Section {
        path: "media.*.density",
        kind: "constant",
        about: "the same everywhere",
        example: "media.NAME = { sigma_s = 1.0, density = { type = \"constant\", value = 0.5 } }",
        keys: &[Key::new("value", NON_NEGATIVE, Is("1"), "the density")],
    },
    Section {
        path: "media.*.density",
        kind: "vdb",
        about: "voxels of an OpenVDB file",
        example: "media.NAME = { sigma_s = 1.0, density = { type = \"vdb\", file = \"smoke.vdb\" } }",
        keys: &[
            Key::new("file", Form::Text("the name of a .vdb file"), Required, "the file, from the folder of the scene")
                .cost("memory of its voxels: `volpm plan` says how much"),
            Key::new("grid", STRING, Chosen("the only grid, or density"), "the name of the grid")
                .see(&["media.*.emission.temperature"]),
            Key::new("transform", STEPS, Chosen("none"), "applied after the grid's own")
                .see(&["shapes.*.transform.*.scale"]),
            Key::new(
                "interpolation",
                Form::Choice(&["trilinear", "nearest"]),
                Is("\"trilinear\""),
                "what is between voxels",
            ),
            Key::new("negative", Form::Choice(&["error", "zero"]), Is("\"error\""), "what becomes of negative voxels"),
            PRECISION,
        ],
    },
    Section {
        path: "media.*.density",
        kind: "array",
        about: "voxels of a NumPy array",
        example: "media.NAME = { sigma_s = 1.0, density = { type = \"array\", file = \"smoke.npy\", min = [0, 0, 0], max = [1, 1, 1] } }",
        keys: &[
            Key::new("file", Form::Text("the name of a .npy file"), Required, "float32 in C order, indices [z][y][x]"),
            Key::new("min", VECTOR, Required, "the lowest corner of the box that it fills").unit("scene units"),
            Key::new(
                "max",
                Form::Said("[x, y, z], above min", &THREE),
                Required,
                "the highest corner; beyond the box the density is 0",
            )
            .unit("scene units"),
            PRECISION,
        ],
    },
    Section {
        path: "media.*.density",
        kind: "exponential",
        about: "an atmosphere that thins out with height",
        example: "media.NAME = { sigma_s = 1.0, density = { type = \"exponential\", scale_height = 2 } }",
        keys: &[
            Key::new("scale_height", POSITIVE, Required, "the height over which the density falls to 1/e")
                .unit("scene units"),
            Key::new("origin", VECTOR, Is("[0, 0, 0]"), "from where up the density falls").unit("scene units"),
            Key::new("up", DIRECTION, Is("[0, 1, 0]"), "the direction of the height"),
            Key::new("value", NON_NEGATIVE, Is("1"), "the density at the origin, and below"),
        ],
    },
    Section {
        path: "media.*.density",
        kind: "noise",
        about: "fractal noise from 0 to 1: it has no end, and fills shapes",
        example: "media.NAME = { sigma_s = 1.0, density = { type = \"noise\", scale = 0.5 } }",
        keys: &[
            Key::new("scale", POSITIVE, Is("1"), "the size of its coarsest features").unit("scene units"),
            Key::new(
                "octaves",
                Form::Integer(Range::Within(1.0, 12.0)),
                Is("4"),
                "each is half as large and half as strong as the one before",
            )
            .cost("eight times as many voxels for each"),
            Key::new(
                "threshold",
                Form::Number(Range::HalfOpen(0.0, 1.0)),
                Is("0.5"),
                "noise below it is empty space, above it the density rises to 1",
            ),
            Key::new("seed", COUNT, Is("0"), "another seed, another noise"),
            PRECISION,
        ],
    },
    Section {
        path: "media.*.emission",
        kind: "",
        about: "what a medium glows with; it must absorb",
        example: "media.NAME = { sigma_a = 1.0, emission = { radiance = [1.0, 0.4, 0.1] } }",
        keys: &[
            Key::new("radiance", COLOUR, Nothing, "the same everywhere; multiplied by the absorption")
                .unit("W/(sr unit²)"),
            Key::new(
                "temperature",
                STRING,
                Nothing,
                "the grid of the density's file that holds the temperature of a black body",
            )
            .see(&["media.*.emission.kelvin_scale"]),
            Key::new("grid", STRING, Nothing, "the grid of the density's file that holds the radiance"),
            Key::new("scale", NON_NEGATIVE, Is("1"), "multiplies what is emitted"),
            Key::new("kelvin_scale", POSITIVE, Chosen("1, beside temperature alone"), "kelvins to a unit of the grid")
                .unit("K")
                .see(&["media.*.emission.temperature"]),
        ],
    },
    Section {
        path: "media.*.albedo",
        kind: "",
        about: "a grid of the density's .vdb file in place of a number; so for sigma_s, sigma_a and phase.g",
        example: "media.NAME = { sigma_t = 1.0, albedo = { grid = \"albedo\" }, density = { type = \"vdb\", file = \"smoke.vdb\" } }",
        keys: &[
            Key::new("grid", STRING, Required, "the name of the grid").cost("memory of its voxels"),
            Key::new("scale", NON_NEGATIVE, Is("1"), "multiplies its values"),
        ],
    },
];
