//! The file itself, `[film]`, `[camera]`, `[world]`, `[render]`, `[photons]`, `[volume]` and `[surface]`.

use super::{Chosen, Is, Key, Nothing, Required, Section};

const INTEGER: &str = "an integer of at least 1";
const COUNT: &str = "an integer of at least 0";
const NUMBER: &str = "a number";
const LENGTH: &str = "a number above 0";
const BOOLEAN: &str = "true or false";
const VECTOR: &str = "[x, y, z]";

pub(super) const SCENE: &[Section] = &[
    Section {
        path: "",
        kind: "",
        about: "a scene file",
        example: "title = \"a room\"",
        keys: &[
            Key::new("title", "a string", Nothing, "what the scene calls itself"),
            Key::new("film", "a table", Nothing, "the image"),
            Key::new("camera", "a table", Required, "who looks, from where"),
            Key::new("world", "a table", Nothing, "what is outside of all solids, and how long a scene unit is"),
            Key::new("media", "a table of tables, by name", Nothing, "what fills space and scatters light"),
            Key::new("materials", "a table of tables, by name", Nothing, "what surfaces are made of"),
            Key::new("shapes", "a list of tables, [[shapes]]", Nothing, "surfaces, solids and shapes that shine"),
            Key::new("lights", "a list of tables, [[lights]]", Nothing, "lights that are no shapes"),
            Key::new("render", "a table", Nothing, "the method, and how much work it does"),
            Key::new("photons", "a table", Nothing, "how many photons are traced, and how"),
            Key::new("volume", "a table", Nothing, "how light in media is gathered from photons"),
            Key::new("surface", "a table", Nothing, "how light on surfaces is gathered from photons"),
            Key::new("compare", "a table", Nothing, "what `volpm compare` compares; a render does not depend on it"),
        ],
    },
    Section {
        path: "film",
        kind: "",
        about: "the image",
        example: "film = { width = 320, height = 240 }",
        keys: &[
            Key::new("width", INTEGER, Is("640"), "pixels across").unit("pixels").cost("time and memory of the film grow with it; photons that the plan chooses, too").see(&["film.height", "film.crop"]),
            Key::new("height", INTEGER, Is("480"), "pixels down").unit("pixels").cost("as film.width").see(&["film.width", "camera.fov_axis"]),
            Key::new("crop", "[x, y, width, height], integers", Chosen("all of it"), "makes this part alone, from the top left: its pixels are those of the whole picture, to the last bit").unit("pixels").cost("photons cost as much as for the whole"),
            Key::new("filter", "\"box\", \"tent\" or \"gaussian\"", Is("\"box\""), "how samples are weighted into pixels: the mean over the square; a tent two pixels wide; a Gaussian with σ of half a pixel"),
            Key::new("exposure", NUMBER, Chosen("from the image"), "by how much PNG files are brightened").unit("stops").see(&["film.tone_map"]),
            Key::new("tone_map", "\"filmic\" or \"linear\"", Is("\"filmic\""), "the tone curve of PNG files").see(&["film.exposure"]),
            Key::new("layers", BOOLEAN, Is("true"), "whether EXR files hold the components of light transport, and albedo, normal and depth of the first surface").cost("memory of the film: several times that of the image alone"),
            Key::new("standard_error", BOOLEAN, Is("false"), "for a single pass: EXR files hold the standard error of each pixel, from 8 independent parts whose mean is the image").cost("memory of the film; each part has an eighth of the photons").see(&["render.passes"]),
        ],
    },
    Section {
        path: "camera",
        kind: "",
        about: "who looks, from where",
        example: "",
        keys: &[
            Key::new("position", VECTOR, Required, "where it stands: in a medium, too, or in several").unit("scene units").see(&["camera.target"]),
            Key::new("target", VECTOR, Required, "what it looks at").unit("scene units").see(&["camera.position", "camera.focus_distance"]),
            Key::new("up", VECTOR, Is("[0, 1, 0]"), "what is up in the picture; not parallel to the view"),
            Key::new("projection", "\"perspective\" or \"orthographic\"", Is("\"perspective\""), "whether rays come from a point, or are parallel"),
            Key::new("fov", "a number above 0 and below 180", Is("40"), "the full angle of view; with parallel rays as much is seen as a perspective camera sees of the plane through the target").unit("degrees").see(&["camera.fov_axis"]),
            Key::new("fov_axis", "\"y\", \"x\" or \"smaller\"", Is("\"y\""), "the side of the film that fov is along: its height, its width, the shorter one").see(&["camera.fov"]),
            Key::new("aperture", "0, or a number above 0", Is("0"), "the radius of the lens; 0 is a pinhole").unit("scene units").cost("noise where the picture is out of focus").see(&["camera.focus_distance"]),
            Key::new("focus_distance", LENGTH, Chosen("the distance to the target"), "how far away the sharp plane is, along the axis").unit("scene units").see(&["camera.aperture"]),
        ],
    },
    Section {
        path: "world",
        kind: "",
        about: "what is outside of all solids",
        example: "world = { unit = \"cm\" }",
        keys: &[
            Key::new("medium", "the name of a medium", Chosen("vacuum"), "the medium of all space that no solid claims. If it is even it has no end, and light from infinity does not get through").see(&["media", "shapes.*.interior"]),
            Key::new("unit", "\"mm\", \"cm\" or \"m\"", Is("\"m\""), "what one scene unit is: tells how long a unit of media is").see(&["media.*.unit"]),
        ],
    },
];

pub(super) const SECTIONS: &[Section] = &[
    Section {
        path: "render",
        kind: "",
        about: "the method, and how much work it does",
        example: "render = { samples = 64 }",
        keys: &[
            Key::new("method", "\"auto\", \"photon\", \"path\", \"light\" or \"whitted\"", Is("\"auto\""), "photon maps; unbiased paths from the camera, or from the lights; Whitted's rays, of light straight from lights; or what suits the scene, which is photon if any key of [photons], [volume] or [surface] is set").cost("\"auto\" takes a pilot of paths; `volpm plan` says what it chose"),
            Key::new("quality", "\"draft\", \"normal\" or \"high\"", Is("\"normal\""), "what numbers are chosen for that the scene does not give: a draft takes a quarter of photons and samples, high makes four passes").see(&["render.samples", "render.passes", "photons.volume"]),
            Key::new("samples", INTEGER, Chosen("16; 4 for a draft"), "camera samples per pixel and pass; of \"light\" as many light paths, too").cost("time grows with it; variance of the pixels falls with 1/samples, that of the photons does not").see(&["render.passes", "photons.volume"]),
            Key::new("light_samples", "an integer from 1 to 4096", Is("1"), "shadow rays that ask lights where a camera ray first meets a surface that spreads light").cost("a shadow ray each; less noise in the soft shadows of wide lamps").see(&["render.samples"]),
            Key::new("passes", INTEGER, Chosen("1; 4 for high quality"), "passes, each with fresh photons in narrower discs").cost("time grows with it; noise and blur shrink").see(&["render.samples", "volume.neighbours"]),
            Key::new("seed", COUNT, Is("1"), "what all random numbers derive from"),
            Key::new("max_depth", COUNT, Is("0"), "the most reflections, refractions and scatterings between light and eye; 0: no limit").unit("events").cost("light with more events is missing; gathered light is not kept with a limit").see(&["surface.irradiance_cache"]),
        ],
    },
    Section {
        path: "photons",
        kind: "",
        about: "how many photons are traced, and how",
        example: "photons = { volume = 500_000 }",
        keys: &[
            Key::new("volume", INTEGER, Chosen("32 for each pixel, 300 000 to 1 000 000, or to 2 000 000 where a density is voxels"), "about how many photons the map of media should hold").unit("photons").cost("some 50 bytes each, up to twice that near walls, and time to trace and order them; blur shrinks with them").see(&["volume.neighbours", "photons.max_emitted", "render.passes"]),
            Key::new("global", COUNT, Chosen("16 for each pixel, 100 000 to 200 000, or photons.volume if that is said and less"), "about how many photons the map of all light on surfaces should hold; 0: none, and paths find indirect light").unit("photons").cost("some 60 bytes each").see(&["surface.indirect"]),
            Key::new("caustic", COUNT, Chosen("as photons.global"), "about how many photons the map of caustics should hold; 0: none, and they are left to chance").unit("photons").cost("some 40 bytes each").see(&["surface.caustic_radius", "shapes.*.casts_caustics"]),
            Key::new("max_emitted", INTEGER, Is("50_000_000"), "the most that lights emit to fill a map").unit("photons").cost("time, where few photons land").see(&["photons.projection"]),
            Key::new("projection", BOOLEAN, Is("true"), "whether photons are aimed at what matters, and learn where that is").cost("pilots of some ten thousand photons; without it most photons of small things miss them"),
            Key::new("importance", BOOLEAN, Is("false"), "whether photons are drawn and kept by how much they count in the picture").cost("32 768 paths from the camera; pays where the camera sees a small part of what is lit"),
            Key::new("density_control", BOOLEAN, Is("false"), "whether four times as many photons are traced as kept, and hand their power to neighbours where they lie closest").cost("four times the tracing, for a map with less noise").see(&["photons.importance"]),
            Key::new("emission", "\"qmc\" or \"random\"", Is("\"qmc\""), "what photons are drawn by: a scrambled Sobol' sequence, or independent numbers"),
        ],
    },
    Section {
        path: "volume",
        kind: "",
        about: "how light in media is gathered from photons",
        example: "volume = { neighbours = 100 }",
        keys: &[
            Key::new("estimate", "\"beam\" or \"point\"", Is("\"beam\""), "all photons around a ray at once, or those around points on it").cost("points are slower and noisier; for comparison").see(&["volume.march"]),
            Key::new("kernel", "\"variable\" (= \"knn\") or \"fixed\"", Is("\"variable\""), "whether photons are as wide as those around them are sparse, or all alike").see(&["volume.neighbours", "volume.radius"]),
            Key::new("profile", "\"biweight\", \"epanechnikov\" or \"constant\"", Chosen("\"biweight\"; of points \"constant\""), "how photons count towards their rim, x = 1: (1 − x²)², 1 − x², or all alike"),
            Key::new("radius", LENGTH, Chosen("as wide as holds n photons if they filled the media evenly"), "of kernel \"fixed\"").unit("scene units").cost("less noise and more blur").see(&["volume.kernel"]),
            Key::new("neighbours", INTEGER, Chosen("200 (1 − |g|), 60 at least; 60 to 200 where a density is voxels, 300 to 1000 in dense solids"), "n: a variable photon is about as wide as the sphere that holds n photons").unit("photons").cost("less noise and more blur; a ray meets more discs").see(&["volume.pilot", "volume.max_radius", "photons.volume"]),
            Key::new("pilot", "an integer of at least 5", Chosen("√n, rounded up, and 5 at least"), "m: radii are found from the m-th nearest photon, times (n/m)^⅓").unit("photons").cost("radii that vary less by chance, and take longer to find").see(&["volume.neighbours"]),
            Key::new("max_radius", LENGTH, Chosen("a tenth of the media's diagonal"), "the widest a variable photon or ball may be").unit("scene units").see(&["volume.neighbours"]),
            Key::new("boundaries", "\"lean\", \"share\" or \"none\"", Is("\"lean\""), "what is done about walls near photons: discs are cut and lie along boundaries of dense media; are cut; or nothing").cost("16 to 48 bytes for photons near walls; without it media are darker along walls"),
            Key::new("single_scattering", "\"photons\", \"traced\" or \"approximate\"", Is("\"photons\""), "where light comes from that was scattered once: the map, rays to the lights, or such rays straight on through glass").cost("shadow rays, and their noise instead of blur; caustics in media are lost by \"approximate\""),
            Key::new("peaks", "\"auto\", \"paths\" or \"photons\"", Is("\"auto\""), "who finds light in the narrow peak of a phase function; \"auto\": paths in clouds and thick smoke, and for sharp peaks where there are no spots, glass or mirrors").cost("paths go on within media; without them clouds glitter").see(&["media.*.phase.g"]),
            Key::new("march", "a table", Nothing, "how points on rays are chosen, of estimate \"point\" and of traced single scattering").see(&["volume.estimate", "volume.single_scattering"]),
        ],
    },
    Section {
        path: "volume.march",
        kind: "",
        about: "how points on rays are chosen",
        example: "volume = { march = { step = \"uniform\" } }",
        keys: &[
            Key::new("step", "\"exponential\", \"uniform\", \"adaptive\" or \"random\"", Is("\"exponential\""), "steps: longer the less light arrives, all alike, halved while their ends differ, or as free paths").see(&["volume.march.size"]),
            Key::new("size", LENGTH, Chosen("1/64 of the media's diagonal, or half a mean free path"), "the length of the smallest step").unit("scene units").cost("shorter steps take time; longer ones make noise and no bias"),
            Key::new("contrast", LENGTH, Is("0.2"), "what the ends of an adaptive step may differ by, as a share of the larger").see(&["volume.march.step"]),
        ],
    },
    Section {
        path: "surface",
        kind: "",
        about: "how light on surfaces is gathered from photons",
        example: "surface = { indirect = \"path\" }",
        keys: &[
            Key::new("indirect", "\"final_gather\", \"map\", \"path\" or \"none\"", Is("\"final_gather\""), "who tells light that comes from other surfaces: gather rays that end in the global map, that map itself, paths, or nobody").cost("the map is quick and blotched, paths are noisier and unbiased").see(&["photons.global", "surface.irradiance_cache"]),
            Key::new("estimate", "\"knn\", \"sheets\" or \"fixed\"", Is("\"knn\""), "how far photons count: to the n-th nearest, each as far as others are sparse around it, or everywhere as far").see(&["surface.neighbours", "surface.radius"]),
            Key::new("radius", LENGTH, Chosen("0.02 of the scene's diagonal"), "of estimate \"fixed\"").unit("scene units").see(&["surface.estimate"]),
            Key::new("neighbours", "an integer of at least 2", Is("80"), "n: the photons that count at a place").unit("photons").cost("less noise, more blur, and time for each look-up").see(&["surface.max_radius"]),
            Key::new("filter", "\"cone\", \"none\" or \"gaussian\"", Is("\"cone\""), "how photons count towards the rim: 1 − x, all alike, or a Gaussian"),
            Key::new("max_radius", LENGTH, Chosen("a tenth of the scene's diagonal"), "the widest radius in the global map").unit("scene units").see(&["surface.neighbours"]),
            Key::new("caustic_radius", LENGTH, Chosen("0.03 of the scene's diagonal"), "the widest radius in the map of caustics").unit("scene units").see(&["photons.caustic"]),
            Key::new("differential_checking", BOOLEAN, Is("false"), "whether photons count only as far as light is even, of \"knn\" and \"fixed\"").cost("less blur, more noise, a quarter more time"),
            Key::new("accurate_distance", "0, or a number above 0", Chosen("how far the global map averages light"), "gather rays that meet a surface nearer than this go on as paths").unit("scene units").cost("time in corners; light there is blurred without it"),
            Key::new("gather_rays", INTEGER, Chosen("1; for a record of the cache one for 10 000 camera samples, 200 to 2000"), "gather rays that go on from a surface, or of a record").cost("time of records, and less noise in them").see(&["surface.irradiance_cache"]),
            Key::new("gather_directions", "\"flux\" or \"bsdf\"", Is("\"flux\""), "where gather rays go: two in five of a record's and half of others whence photons came, or all as the surface reflects").cost("a map of some scattered photons"),
            Key::new("precomputed_irradiance", COUNT, Is("4"), "the irradiance is known beforehand at one of so many global photons; 0: at none").cost("a look-up for each when the map is built; gather rays then need one photon instead of n").see(&["surface.neighbours"]),
            Key::new("irradiance_cache", BOOLEAN, Is("true"), "whether what gather rays find is kept and interpolated").cost("noise of the pixels becomes a faint blur of records").see(&["surface.records", "surface.cache_error"]),
            Key::new("records", "\"hessian\" or \"split_sphere\"", Is("\"hessian\""), "how far apart records are: as second derivatives allow, or as distances around say").see(&["surface.cache_error"]),
            Key::new("cache_error", LENGTH, Chosen("0.01; of \"split_sphere\" 0.3"), "the share by which interpolated light may be off at the edge of the widest records").cost("smaller: more records").see(&["surface.records"]),
            Key::new("shadow_photons", BOOLEAN, Is("false"), "whether photons tell where surfaces are fully lit, or in shadow, so that no shadow ray is sent").cost("0.3 to 2 s of photons each pass, and a small bias; spares shadow rays"),
        ],
    },
];
