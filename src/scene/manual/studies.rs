//! `[compare]`

use super::{Chosen, Key, Nothing, Required, Section};

const TIME: &str = "seconds, or a text such as \"30s\"";

pub(super) const SECTIONS: &[Section] = &[
    Section {
        path: "compare",
        kind: "",
        about: "what `volpm compare` compares",
        example: "compare = { variants = [\"beam\", \"path\"], budgets = [1, 4] }",
        keys: &[
            Key::new(
                "scene",
                "the name of a .toml file",
                Chosen("this file"),
                "the scene, of a study in a file of its own",
            ),
            Key::new("set", "a table of keys and values", Nothing, "keys of the scene to replace for all variants")
                .see(&["compare.variants.*.set"]),
            Key::new(
                "variants",
                "a list of names and tables",
                Chosen("those built in that suit the scene"),
                "the estimates to compare",
            ),
            Key::new(
                "budgets",
                "a list of times, ascending",
                Chosen("by time and seeds"),
                "the run times at which errors are measured",
            )
            .unit("s")
            .see(&["compare.samples", "compare.time"]),
            Key::new(
                "samples",
                "a list of integers, ascending",
                Nothing,
                "camera samples at which errors are measured, instead of times",
            )
            .see(&["compare.budgets"]),
            Key::new("time", TIME, Chosen("30 s"), "how long each variant may take").unit("s"),
            Key::new("seeds", "an integer of at least 1", Chosen("1"), "with how many seeds each is rendered")
                .cost("time grows with it"),
            Key::new(
                "reference",
                "\"path\", \"photon\", \"own\", or a file",
                Chosen("by the scene"),
                "what errors are against",
            ),
            Key::new(
                "reference_set",
                "a table of keys and values",
                Nothing,
                "keys of the scene to replace for the reference",
            ),
            Key::new(
                "reference_error",
                "a share, or a text such as \"1%\"",
                Chosen("by the variants"),
                "how precise a reference that is made should be",
            ),
            Key::new("reference_time", TIME, Chosen("by the variants"), "how long a reference may take").unit("s"),
            Key::new(
                "limit_samples",
                "an integer of at least 2",
                Chosen("by samples"),
                "camera samples of the variants' own limits",
            ),
            Key::new(
                "same_map",
                "true or false",
                Chosen("false"),
                "whether all variants gather from one map of photons",
            ),
            Key::new("layer", "the name of a layer", Chosen("the image"), "which layer is measured"),
            Key::new("regions", "a list of tables", Nothing, "parts of the image that are measured by themselves"),
            Key::new("tune", "a key", Nothing, "a key that is chosen so that variants take the same time"),
        ],
    },
    Section {
        path: "compare.variants.*",
        kind: "",
        about: "a variant of a study",
        example: "compare = { variants = [{ name = \"few\", set = { \"photons.volume\" = 10_000 } }] }",
        keys: &[
            Key::new("name", "letters, digits, -, _ and .", Required, "what it is called"),
            Key::new("of", "the name of a built-in variant", Chosen("the scene as it is"), "what it starts from"),
            Key::new("set", "a table of keys and values", Nothing, "keys of the scene to replace"),
            Key::new(
                "samples",
                "an integer of at least 1, or a list",
                Nothing,
                "camera samples to try when it is tuned",
            ),
            Key::new("tune", "a key", Nothing, "the key that is chosen so that it takes the time given"),
            Key::new("time", "the name of another variant", Nothing, "whose time it gets"),
            Key::new("limit", "a table of keys and values", Nothing, "keys to replace besides for its own limit"),
        ],
    },
    Section {
        path: "compare.regions.*",
        kind: "",
        about: "a part of the image that is measured by itself",
        example: "compare = { regions = [{ name = \"shade\", x = 0, y = 0, width = 10, height = 10 }] }",
        keys: &[
            Key::new("name", "a string", Required, "what it is called"),
            Key::new("x", "an integer of at least 0", Required, "its leftmost column").unit("pixels"),
            Key::new("y", "an integer of at least 0", Required, "its top row").unit("pixels"),
            Key::new("width", "an integer of at least 1", Required, "pixels across").unit("pixels"),
            Key::new("height", "an integer of at least 1", Required, "pixels down").unit("pixels"),
        ],
    },
];
