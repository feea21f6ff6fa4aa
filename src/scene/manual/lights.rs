//! `[[lights]]`

use super::form::{
    COLOUR, DIRECTION, Form, NON_NEGATIVE, NUMBER, POSITIVE, Range, SHARE_COLOUR, STRING, THREE, VECTOR,
};
use super::{Chosen, Is, Key, Nothing, Required, Section};

const POSITION: Key = Key::new("position", VECTOR, Required, "where it is").unit("scene units");
const INTENSITY: Key = Key::new("intensity", COLOUR, Nothing, "its strength, where that is greatest; or power")
    .unit("W/sr")
    .see(&["lights.*.power"]);
const POWER: Key = Key::new("power", COLOUR, Nothing, "what it sends in all directions together; or intensity")
    .unit("W")
    .see(&["lights.*.intensity", "lights.*.temperature"]);
const TEMPERATURE: Key = Key::new(
    "temperature",
    Form::Number(Range::Within(1000.0, 40000.0)),
    Nothing,
    "gives a power the colour of a black body",
)
.unit("K")
.see(&["lights.*.power"]);
const PROFILE: Key = Key::new(
    "profile",
    Form::Text("the name of an .ies or .ldt file"),
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
            Key::new("type", Form::Kind, Required, "which kind it is"),
            Key::new("name", STRING, Nothing, "for `--set lights.NAME.…`"),
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
            Key::new("radius", NON_NEGATIVE, Is("0"), "above 0 it is a sphere of the same power")
                .unit("scene units")
                .cost("noise in soft shadows; without a size it is not seen in mirrors or through glass"),
            PROFILE,
            Key::new(
                "direction",
                DIRECTION,
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
            Key::new("target", VECTOR, Required, "what its axis points to").unit("scene units"),
            INTENSITY,
            POWER,
            TEMPERATURE,
            Key::new(
                "inner_angle",
                Form::Number(Range::Within(0.0, 90.0)),
                Chosen("5 less than outer_angle"),
                "full within this half-angle",
            )
            .unit("degrees")
            .see(&["lights.*.outer_angle"]),
            Key::new("outer_angle", Form::Number(Range::Within(1e-6, 90.0)), Is("30"), "dark beyond this half-angle")
                .unit("degrees")
                .see(&["lights.*.inner_angle"]),
            Key::new(
                "radius",
                NON_NEGATIVE,
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
            Key::new("direction", DIRECTION, Required, "the way it travels"),
            Key::new("irradiance", COLOUR, Required, "what a plane gets that faces it").unit("W/unit²"),
            Key::new(
                "angle",
                Form::Number(Range::HalfOpen(0.0, 180.0)),
                Is("0"),
                "its apparent diameter: soft shadows",
            )
            .unit("degrees"),
            Key::new("center", VECTOR, Nothing, "beside radius: a round beam that starts on that disc")
                .unit("scene units"),
            Key::new("radius", POSITIVE, Nothing, "beside center: of that beam").unit("scene units"),
        ],
    },
    Section {
        path: "lights.*",
        kind: "sky",
        about: "a clear sky with its sun, above an endless ground; up is +y",
        example: "lights = [{ type = \"sky\", sun = [1, 1, 0], scale = 0.01 }]",
        keys: &[
            Key::new("sun", Form::Said("[x, y, z] with y of at least 0", &THREE), Required, "the direction to the sun"),
            Key::new("turbidity", Form::Number(Range::Within(1.0, 10.0)), Is("3"), "haze: 2 to 3 a clear day, 10 mist"),
            Key::new("ground", SHARE_COLOUR, Is("0.2"), "the ground's albedo"),
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
                Form::Text("the name of an .exr or .hdr file"),
                Nothing,
                "a map by longitude and latitude; or radiance",
            ),
            SCALE,
            Key::new("rotate", NUMBER, Is("0"), "turns it about +y, counter-clockwise from above").unit("degrees"),
        ],
    },
];
