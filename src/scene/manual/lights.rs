//! `[[lights]]`

use super::{Chosen, Is, Key, Nothing, Required, Section};

const COLOUR: &str = "a number of at least 0, or [r, g, b]";
const POSITION: Key = Key::new("position", "[x, y, z]", Required, "where it is").unit("scene units");
const INTENSITY: Key = Key::new("intensity", COLOUR, Nothing, "its strength, where that is greatest; or power")
    .unit("W/sr")
    .see(&["lights.*.power"]);
const POWER: Key = Key::new("power", COLOUR, Nothing, "what it sends in all directions together; or intensity")
    .unit("W")
    .see(&["lights.*.intensity", "lights.*.temperature"]);
const TEMPERATURE: Key =
    Key::new("temperature", "a number from 1000 to 40 000", Nothing, "gives a power the colour of a black body")
        .unit("K")
        .see(&["lights.*.power"]);
const PROFILE: Key = Key::new(
    "profile",
    "the name of an .ies or .ldt file",
    Chosen("as bright in all directions"),
    "measured intensities of a lamp",
);
const SCALE: Key = Key::new("scale", COLOUR, Is("1"), "multiplies all of it");

pub(super) const SECTIONS: &[Section] = &[
    Section {
        path: "lights.*",
        kind: "",
        about: "a light that is no shape",
        example: "",
        keys: &[
            Key::new("type", "the name of a kind", Required, "which kind it is"),
            Key::new("name", "a string", Nothing, "for `--set lights.NAME.…`"),
        ],
    },
    Section {
        path: "lights.*",
        kind: "point",
        about: "a lamp of no size, or a sphere",
        example: "lights = [{ type = \"point\", position = [2, 3, 2], intensity = 50 }]",
        keys: &[
            POSITION,
            INTENSITY,
            POWER,
            TEMPERATURE,
            Key::new("radius", "0, or a number above 0", Is("0"), "above 0 it is a sphere of the same power")
                .unit("scene units")
                .cost("noise in soft shadows; without a size it is not seen in mirrors or through glass"),
            PROFILE,
            Key::new(
                "direction",
                "[x, y, z], not 0",
                Chosen("down, beside profile alone"),
                "of the axis of a lamp with a profile",
            ),
        ],
    },
    Section {
        path: "lights.*",
        kind: "spot",
        about: "a lamp with a cone of light",
        example: "lights = [{ type = \"spot\", position = [0, 4, 0], target = [0, 0, 0], intensity = 100 }]",
        keys: &[
            POSITION,
            Key::new("target", "[x, y, z]", Required, "what its axis points to").unit("scene units"),
            INTENSITY,
            POWER,
            TEMPERATURE,
            Key::new(
                "inner_angle",
                "a number from 0 to 90",
                Chosen("5 less than outer_angle"),
                "full within this half-angle",
            )
            .unit("degrees")
            .see(&["lights.*.outer_angle"]),
            Key::new("outer_angle", "a number from 1e-6 to 90", Is("30"), "dark beyond this half-angle")
                .unit("degrees")
                .see(&["lights.*.inner_angle"]),
            Key::new(
                "radius",
                "0, or a number above 0",
                Is("0"),
                "above 0 it is a disc that faces the target, of the same strength",
            )
            .unit("scene units"),
            PROFILE,
        ],
    },
    Section {
        path: "lights.*",
        kind: "directional",
        about: "parallel light, or nearly so",
        example: "lights = [{ type = \"directional\", direction = [0, -1, 0], irradiance = 1 }]",
        keys: &[
            Key::new("direction", "[x, y, z], not 0", Required, "the way it travels"),
            Key::new("irradiance", COLOUR, Required, "what a plane gets that faces it").unit("W/unit²"),
            Key::new("angle", "a number of at least 0 and below 180", Is("0"), "its apparent diameter: soft shadows")
                .unit("degrees"),
            Key::new("center", "[x, y, z]", Nothing, "beside radius: a round beam that starts on that disc")
                .unit("scene units"),
            Key::new("radius", "a number above 0", Nothing, "beside center: of that beam").unit("scene units"),
        ],
    },
    Section {
        path: "lights.*",
        kind: "sky",
        about: "a clear sky with its sun, above an endless ground; up is +y",
        example: "lights = [{ type = \"sky\", sun = [1, 1, 0], scale = 0.01 }]",
        keys: &[
            Key::new("sun", "[x, y, z] with y of at least 0", Required, "the direction to the sun"),
            Key::new("turbidity", "a number from 1 to 10", Is("3"), "haze: 2 to 3 a clear day, 10 mist"),
            Key::new("ground", "a number from 0 to 1, or [r, g, b]", Is("0.2"), "the ground's albedo"),
            SCALE,
            Key::new("sun_scale", COLOUR, Is("1"), "multiplies the sun alone; 0: no sun"),
        ],
    },
    Section {
        path: "lights.*",
        kind: "environment",
        about: "light from all around, from infinity",
        example: "lights = [{ type = \"environment\", radiance = 0.5 }]",
        keys: &[
            Key::new("radiance", COLOUR, Nothing, "the same from everywhere; or file").unit("W/(sr unit²)"),
            Key::new(
                "file",
                "the name of an .exr or .hdr file",
                Nothing,
                "a map by longitude and latitude; or radiance",
            ),
            SCALE,
            Key::new("rotate", "a number", Is("0"), "turns it about +y, counter-clockwise from above").unit("degrees"),
        ],
    },
];
