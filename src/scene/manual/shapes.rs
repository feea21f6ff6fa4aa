//! `[[shapes]]`

use super::{Chosen, Is, Key, Nothing, Required, Section};

const POINT: &str = "[x, y, z]";
const LENGTH: &str = "a number above 0";
const LIST: &str = "scene units";

pub(super) const SECTIONS: &[Section] = &[
    Section {
        path: "shapes.*",
        kind: "",
        about: "a shape: a surface, a solid, or what shines",
        example: "",
        keys: &[
            Key::new("type", "the name of a kind", Required, "which kind it is"),
            Key::new("name", "a string", Nothing, "for instances, and for `--set shapes.NAME.…`"),
            Key::new(
                "transform",
                "a list of steps",
                Chosen("none"),
                "moves it, the first step first; a density is not moved",
            )
            .see(&["shapes.*.transform.*.rotate"]),
            Key::new(
                "material",
                "the name of a material, or \"none\"",
                Chosen("\"none\" with an interior, black with an emission, an instance's template's; else required"),
                "what its surface is made of",
            )
            .see(&["materials"]),
            Key::new("interior", "the name of a medium", Nothing, "what is inside, of closed shapes")
                .see(&["world.medium", "shapes.*.priority"]),
            Key::new(
                "priority",
                "an integer",
                Is("0"),
                "where solids overlap, the higher decides; the later in the file if they are equal",
            )
            .see(&["media.*.add"]),
            Key::new("emission", "a table", Nothing, "what it shines with").see(&["shapes.*.emission.radiance"]),
            Key::new(
                "casts_caustics",
                "true or false",
                Is("true"),
                "whether light that it mirrors or refracts makes caustics on surfaces",
            )
            .cost("caustics that are left out cost no photons")
            .see(&["shapes.*.receives_caustics", "photons.caustic"]),
            Key::new("receives_caustics", "true or false", Is("true"), "whether caustics fall on it")
                .see(&["shapes.*.casts_caustics"]),
            Key::new("visible", "true or false", Is("true"), "false: only a template for instances")
                .see(&["shapes.*.of"]),
        ],
    },
    Section {
        path: "shapes.*",
        kind: "sphere",
        about: "a sphere",
        example: "shapes = [{ type = \"sphere\", center = [0, 0, 0], radius = 1, material = \"none\" }]",
        keys: &[
            Key::new("center", POINT, Required, "its middle").unit(LIST),
            Key::new("radius", LENGTH, Required, "its radius").unit(LIST),
        ],
    },
    Section {
        path: "shapes.*",
        kind: "box",
        about: "a box along the axes",
        example: "shapes = [{ type = \"box\", min = [0, 0, 0], max = [1, 1, 1], material = \"none\" }]",
        keys: &[
            Key::new("min", POINT, Required, "its lowest corner").unit(LIST),
            Key::new("max", "[x, y, z], above min", Required, "its highest corner").unit(LIST),
        ],
    },
    Section {
        path: "shapes.*",
        kind: "quad",
        about: "a parallelogram; out is edge_u × edge_v",
        example: "shapes = [{ type = \"quad\", origin = [0, 0, 0], edge_u = [1, 0, 0], edge_v = [0, 1, 0], material = \"none\" }]",
        keys: &[
            Key::new("origin", POINT, Required, "a corner").unit(LIST),
            Key::new("edge_u", "[x, y, z], not 0", Required, "from there to the next corner").unit(LIST),
            Key::new("edge_v", "[x, y, z], not along edge_u", Required, "and to the other").unit(LIST),
        ],
    },
    Section {
        path: "shapes.*",
        kind: "disk",
        about: "a flat disk",
        example: "shapes = [{ type = \"disk\", center = [0, 0, 0], normal = [0, 1, 0], radius = 1, material = \"none\" }]",
        keys: &[
            Key::new("center", POINT, Required, "its middle").unit(LIST),
            Key::new("normal", "[x, y, z], not 0", Required, "the direction that is out"),
            Key::new("radius", LENGTH, Required, "its radius").unit(LIST),
        ],
    },
    Section {
        path: "shapes.*",
        kind: "cylinder",
        about: "a circular cylinder",
        example: "shapes = [{ type = \"cylinder\", base = [0, 0, 0], top = [0, 1, 0], radius = 1, material = \"none\" }]",
        keys: &[
            Key::new("base", POINT, Required, "the middle of its one end").unit(LIST),
            Key::new("top", POINT, Required, "and of the other").unit(LIST),
            Key::new("radius", LENGTH, Required, "its radius").unit(LIST),
            Key::new("caps", "true or false", Is("true"), "whether its ends are closed"),
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
                "a list of [radius, height]",
                Required,
                "the points; closed if both ends lie on the axis, or coincide",
            )
            .unit(LIST),
            Key::new("segments", "an integer of at least 3", Chosen("exactly round"), "so many flat facets around")
                .cost("memory of a mesh"),
            Key::new("crease", "a number from 0 to 180", Is("30"), "kinks below this are shaded round").unit("degrees"),
        ],
    },
    Section {
        path: "shapes.*",
        kind: "mesh",
        about: "triangles of a Wavefront OBJ file",
        example: "shapes = [{ type = \"mesh\", file = \"rose.obj\", material = \"none\" }]",
        keys: &[
            Key::new("file", "the name of an .obj or .obj.gz file", Required, "the file, from the folder of the scene")
                .cost("memory of its triangles and their hierarchy, once for all instances"),
            Key::new("smooth", "true or false", Is("true"), "whether it is shaded with normals at its vertices"),
        ],
    },
    Section {
        path: "shapes.*",
        kind: "instance",
        about: "another shape once more",
        example: "shapes = [{ type = \"instance\", of = \"one\" }, { name = \"one\", type = \"sphere\", center = [0, 0, 0], radius = 1, material = \"none\" }]",
        keys: &[Key::new(
            "of",
            "the name of another shape",
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
            Key::new("radiance", "a number of at least 0, or [r, g, b]", Nothing, "the same in all directions")
                .unit("W/(sr unit²)"),
            Key::new("power", "a number of at least 0, or [r, g, b]", Nothing, "over all that emits").unit("W"),
            Key::new("side", "\"out\", \"in\" or \"both\"", Is("\"out\""), "which sides emit"),
        ],
    },
    Section {
        path: "shapes.*.transform.*",
        kind: "",
        about: "a step of a transform: one of these",
        example: "shapes = [{ type = \"sphere\", center = [0, 0, 0], radius = 1, material = \"none\", transform = [{ scale = 2 }] }]",
        keys: &[
            Key::new("scale", "a number, or [x, y, z], not 0", Nothing, "makes it larger"),
            Key::new("rotate", "a table, { axis = [0, 1, 0], angle = 30 }", Nothing, "turns it")
                .see(&["shapes.*.transform.*.rotate.angle"]),
            Key::new("translate", POINT, Nothing, "moves it").unit(LIST),
            Key::new("matrix", "16 numbers, row by row", Nothing, "any affine map"),
        ],
    },
    Section {
        path: "shapes.*.transform.*.rotate",
        kind: "",
        about: "a turn about an axis through the origin",
        example: "shapes = [{ type = \"sphere\", center = [0, 0, 0], radius = 1, material = \"none\", transform = [{ rotate = { axis = [0, 1, 0], angle = 30 } }] }]",
        keys: &[
            Key::new("axis", "[x, y, z], not 0", Required, "the axis"),
            Key::new("angle", "a number", Required, "right-handed about it").unit("degrees"),
        ],
    },
];
