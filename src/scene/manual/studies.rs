//! `[compare]`

use super::form::{COUNT, Form, NON_NEGATIVE, POSITIVE, POSITIVE_INTEGER, Range, STRING};
use super::{Chosen, Key, Nothing, Required, Section};

const TIME: Form = Form::OneOf(&[Form::Said("seconds", &NON_NEGATIVE), Form::Text("a text such as \"30s\"")]);

pub(super) const SECTIONS: &[Section] = &[
    Section {
        path: "compare",
        kind: "",
        about: "what `volpm compare` compares",
        example: "compare = { variants = [\"beam\", \"path\"], budgets = [1, 4] }",
        keys: &[
            Key::new(
                "scene",
                Form::Text("the name of a .toml file"),
                Chosen("this file"),
                "the scene, of a study in a file of its own",
            ),
            Key::new("set", Form::Keys, Nothing, "keys of the scene to replace for all variants")
                .see(&["compare.variants.*.set"]),
            Key::new(
                "variants",
                Form::List("names and tables", &Form::OneOf(&[STRING, Form::Table("compare.variants.*")])),
                Chosen("those built in that suit the scene"),
                "the estimates to compare",
            ),
            Key::new(
                "budgets",
                Form::List("times, ascending", &TIME),
                Chosen("by time and seeds"),
                "the run times at which errors are measured",
            )
            .unit("s")
            .see(&["compare.samples", "compare.time"]),
            Key::new(
                "samples",
                Form::List("integers, ascending", &POSITIVE_INTEGER),
                Nothing,
                "camera samples at which errors are measured, instead of times",
            )
            .see(&["compare.budgets"]),
            Key::new("time", TIME, Chosen("30 s"), "how long each variant may take").unit("s"),
            Key::new("seeds", POSITIVE_INTEGER, Chosen("1"), "with how many seeds each is rendered")
                .cost("time grows with it"),
            Key::new(
                "reference",
                Form::Text("\"path\", \"photon\", \"own\", or a file"),
                Chosen("by the scene"),
                "what errors are against",
            ),
            Key::new("reference_set", Form::Keys, Nothing, "keys of the scene to replace for the reference"),
            Key::new(
                "reference_error",
                Form::OneOf(&[Form::Said("a share", &POSITIVE), Form::Text("a text such as \"1%\"")]),
                Chosen("by the variants"),
                "how precise a reference that is made should be",
            ),
            Key::new("reference_time", TIME, Chosen("by the variants"), "how long a reference may take").unit("s"),
            Key::new(
                "limit_samples",
                Form::Integer(Range::AtLeast(2.0)),
                Chosen("by samples"),
                "camera samples of the variants' own limits",
            ),
            Key::new("same_map", Form::Boolean, Chosen("false"), "whether all variants gather from one map of photons"),
            Key::new("layer", Form::Text("the name of a layer"), Chosen("the image"), "which layer is measured"),
            Key::new(
                "regions",
                Form::List("tables", &Form::Table("compare.regions.*")),
                Nothing,
                "parts of the image that are measured by themselves",
            ),
            Key::new("tune", Form::Text("a key"), Nothing, "a key that is chosen so that variants take the same time"),
        ],
    },
    Section {
        path: "compare.variants.*",
        kind: "",
        about: "a variant of a study",
        example: "compare = { variants = [{ name = \"few\", set = { \"photons.volume\" = 10_000 } }] }",
        keys: &[
            Key::new("name", Form::Text("letters, digits, -, _ and ."), Required, "what it is called"),
            Key::new(
                "of",
                Form::Text("the name of a built-in variant"),
                Chosen("the scene as it is"),
                "what it starts from",
            ),
            Key::new("set", Form::Keys, Nothing, "keys of the scene to replace"),
            Key::new(
                "samples",
                Form::OneOf(&[POSITIVE_INTEGER, Form::Said("a list", &Form::List("them", &POSITIVE_INTEGER))]),
                Nothing,
                "camera samples to try when it is tuned",
            ),
            Key::new("tune", Form::Text("a key"), Nothing, "the key that is chosen so that it takes the time given"),
            Key::new("time", Form::Text("the name of another variant"), Nothing, "whose time it gets"),
            Key::new("limit", Form::Keys, Nothing, "keys to replace besides for its own limit"),
        ],
    },
    Section {
        path: "compare.regions.*",
        kind: "",
        about: "a part of the image that is measured by itself",
        example: "compare = { regions = [{ name = \"shade\", x = 0, y = 0, width = 10, height = 10 }] }",
        keys: &[
            Key::new("name", STRING, Required, "what it is called"),
            Key::new("x", COUNT, Required, "its leftmost column").unit("pixels"),
            Key::new("y", COUNT, Required, "its top row").unit("pixels"),
            Key::new("width", POSITIVE_INTEGER, Required, "pixels across").unit("pixels"),
            Key::new("height", POSITIVE_INTEGER, Required, "pixels down").unit("pixels"),
        ],
    },
];
