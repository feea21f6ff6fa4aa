//! `[[shapes]]`

use super::form::{COLOUR, DIRECTION, Form, NUMBER, POSITIVE, Range, STEPS, STRING, THREE, VECTOR};
use super::{Chosen, Is, Key, Nothing, Required, Section};

const LIST: &str = "scene units";

pub(super) const SECTIONS: &[Section] = &[
    Section {
        path: "shapes.*",
        kind: "",
        about: "a shape: a surface, a solid, or what shines",
        example: "",
        keys: &[
            Key::new("type", Form::Kind, Required, "which kind it is"),
            Key::new("name", STRING, Nothing, "for instances, and for `--set shapes.NAME.…`"),
            Key::new("transform", STEPS, Chosen("none"), "moves it, the first step first; a density is not moved")
                .see(&["shapes.*.transform.*.rotate"]),
            Key::new(
                "material",
                Form::Text("the name of a material, or \"none\""),
                Chosen("\"none\" with an interior, black with an emission, an instance's template's; else required"),
                "what its surface is made of",
            )
            .see(&["materials"]),
            Key::new("interior", Form::Text("the name of a medium"), Nothing, "what is inside, of closed shapes")
                .see(&["world.medium", "shapes.*.priority"]),
            Key::new(
                "priority",
                Form::Integer(Range::Any),
                Is("0"),
                "where solids overlap, the higher decides; the later in the file if they are equal",
            )
            .see(&["media.*.add"]),
            Key::new("emission", Form::Table("shapes.*.emission"), Nothing, "what it shines with")
                .see(&["shapes.*.emission.radiance"]),
            Key::new(
                "casts_caustics",
                Form::Boolean,
                Is("true"),
                "whether light that it mirrors or refracts makes caustics on surfaces",
            )
            .cost("caustics that are left out cost no photons")
            .see(&["shapes.*.receives_caustics", "photons.caustic"]),
            Key::new("receives_caustics", Form::Boolean, Is("true"), "whether caustics fall on it")
                .see(&["shapes.*.casts_caustics"]),
            Key::new("visible", Form::Boolean, Is("true"), "false: only a template for instances")
                .see(&["shapes.*.of"]),
        ],
    },
    Section {
        path: "shapes.*",
        kind: "sphere",
        about: "a sphere",
        example: "shapes = [{ type = \"sphere\", center = [0, 0, 0], radius = 1, material = \"none\" }]",
        keys: &[
            Key::new("center", VECTOR, Required, "its middle").unit(LIST),
            Key::new("radius", POSITIVE, Required, "its radius").unit(LIST),
        ],
    },
    Section {
        path: "shapes.*",
        kind: "box",
        about: "a box along the axes",
        example: "shapes = [{ type = \"box\", min = [0, 0, 0], max = [1, 1, 1], material = \"none\" }]",
        keys: &[
            Key::new("min", VECTOR, Required, "its lowest corner").unit(LIST),
            Key::new("max", Form::Said("[x, y, z], above min", &THREE), Required, "its highest corner").unit(LIST),
        ],
    },
    Section {
        path: "shapes.*",
        kind: "quad",
        about: "a parallelogram; out is edge_u × edge_v",
        example: "shapes = [{ type = \"quad\", origin = [0, 0, 0], edge_u = [1, 0, 0], edge_v = [0, 1, 0], material = \"none\" }]",
        keys: &[
            Key::new("origin", VECTOR, Required, "a corner").unit(LIST),
            Key::new("edge_u", DIRECTION, Required, "from there to the next corner").unit(LIST),
            Key::new("edge_v", Form::Said("[x, y, z], not along edge_u", &THREE), Required, "and to the other")
                .unit(LIST),
        ],
    },
    Section {
        path: "shapes.*",
        kind: "disk",
        about: "a flat disk",
        example: "shapes = [{ type = \"disk\", center = [0, 0, 0], normal = [0, 1, 0], radius = 1, material = \"none\" }]",
        keys: &[
            Key::new("center", VECTOR, Required, "its middle").unit(LIST),
            Key::new("normal", DIRECTION, Required, "the direction that is out"),
            Key::new("radius", POSITIVE, Required, "its radius").unit(LIST),
        ],
    },
    Section {
        path: "shapes.*",
        kind: "cylinder",
        about: "a circular cylinder",
        example: "shapes = [{ type = \"cylinder\", base = [0, 0, 0], top = [0, 1, 0], radius = 1, material = \"none\" }]",
        keys: &[
            Key::new("base", VECTOR, Required, "the middle of its one end").unit(LIST),
            Key::new("top", VECTOR, Required, "and of the other").unit(LIST),
            Key::new("radius", POSITIVE, Required, "its radius").unit(LIST),
            Key::new("caps", Form::Boolean, Is("true"), "whether its ends are closed"),
        ],
    },
    Section {
        path: "shapes.*",
        kind: "lathe",
        about: "a line through points, turned about the y axis",
        example: "shapes = [{ type = \"lathe\", profile = [[0, 0], [1, 0.5], [0, 1]], material = \"none\" }]",
        keys: &[
            Key::new(
                "profile",
                Form::List("[radius, height]", &Form::Array(2, &NUMBER)),
                Required,
                "the points; closed if both ends lie on the axis, or coincide",
            )
            .unit(LIST),
            Key::new(
                "segments",
                Form::Integer(Range::AtLeast(3.0)),
                Chosen("exactly round"),
                "so many flat facets around",
            )
            .cost("memory of a mesh"),
            Key::new("crease", Form::Number(Range::Within(0.0, 180.0)), Is("30"), "kinks below this are shaded round")
                .unit("degrees"),
        ],
    },
    Section {
        path: "shapes.*",
        kind: "mesh",
        about: "triangles of a Wavefront OBJ file",
        example: "shapes = [{ type = \"mesh\", file = \"rose.obj\", material = \"none\" }]",
        keys: &[
            Key::new(
                "file",
                Form::Text("the name of an .obj or .obj.gz file"),
                Required,
                "the file, from the folder of the scene",
            )
            .cost("memory of its triangles and their hierarchy, once for all instances"),
            Key::new("smooth", Form::Boolean, Is("true"), "whether it is shaded with normals at its vertices"),
        ],
    },
    Section {
        path: "shapes.*",
        kind: "instance",
        about: "another shape once more",
        example: "shapes = [{ type = \"instance\", of = \"one\" }, { name = \"one\", type = \"sphere\", center = [0, 0, 0], radius = 1, material = \"none\" }]",
        keys: &[Key::new(
            "of",
            Form::Text("the name of another shape"),
            Required,
            "the template, whose own transform comes first; what the instance does not say is the template's",
        )
        .see(&["shapes.*.visible"])],
    },
    Section {
        path: "shapes.*.emission",
        kind: "",
        about: "what a shape shines with: radiance or power",
        example: "shapes = [{ type = \"sphere\", center = [0, 0, 0], radius = 1, emission = { radiance = 10 } }]",
        keys: &[
            Key::new("radiance", COLOUR, Nothing, "the same in all directions").unit("W/(sr unit²)"),
            Key::new("power", COLOUR, Nothing, "over all that emits").unit("W"),
            Key::new("side", Form::Choice(&["out", "in", "both"]), Is("\"out\""), "which sides emit"),
        ],
    },
    Section {
        path: "shapes.*.transform.*",
        kind: "",
        about: "a step of a transform: one of these",
        example: "shapes = [{ type = \"sphere\", center = [0, 0, 0], radius = 1, material = \"none\", transform = [{ scale = 2 }] }]",
        keys: &[
            Key::new("scale", Form::OneOf(&[NUMBER, DIRECTION]), Nothing, "makes it larger"),
            Key::new(
                "rotate",
                Form::Said("a table, { axis = [0, 1, 0], angle = 30 }", &Form::Table("shapes.*.transform.*.rotate")),
                Nothing,
                "turns it",
            )
            .see(&["shapes.*.transform.*.rotate.angle"]),
            Key::new("translate", VECTOR, Nothing, "moves it").unit(LIST),
            Key::new(
                "matrix",
                Form::Said("16 numbers, row by row", &Form::Array(16, &NUMBER)),
                Nothing,
                "any affine map",
            ),
        ],
    },
    Section {
        path: "shapes.*.transform.*.rotate",
        kind: "",
        about: "a turn about an axis through the origin",
        example: "shapes = [{ type = \"sphere\", center = [0, 0, 0], radius = 1, material = \"none\", transform = [{ rotate = { axis = [0, 1, 0], angle = 30 } }] }]",
        keys: &[
            Key::new("axis", DIRECTION, Required, "the axis"),
            Key::new("angle", NUMBER, Required, "right-handed about it").unit("degrees"),
        ],
    },
];
