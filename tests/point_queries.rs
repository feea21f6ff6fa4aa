//! Point queries agree with path tracing under every marcher, ball and profile; a grid that holds one number is a
//! homogeneous medium for them.

use volpm::image::Image;

use crate::support::{Checks, Estimate, images};

const STEPS: [&str; 3] = ["uniform", "adaptive", "exponential"];

/// A small room full of forward scattering, coloured fog, its walls grey, a lamp below the ceiling, the camera inside.
fn room(density: &str) -> String {
    format!(
        r#"
[film]
width = 12
height = 12
[camera]
position = [0, 1, 1.8]
target = [0, 0.9, -1]
fov = 60
[media.fog]
sigma_s = [0.3, 0.5, 0.8]
sigma_a = 0.05
phase = {{ type = "hg", g = 0.4 }}
{density}
[materials.wall]
type = "lambert"
reflectance = [0.4, 0.3, 0.2]
[[shapes]]
type = "box"
min = [-2.1, -0.1, -2.1]
max = [2.1, 2.6, 2.1]
interior = "fog"
[[shapes]]
type = "box"
min = [-2, 0, -2]
max = [2, 2.5, 2]
material = "wall"
[[shapes]]
type = "sphere"
center = [0.8, 1.8, -0.6]
radius = 0.2
emission = {{ radiance = 20 }}
[photons]
volume = 60_000
[volume]
estimate = "point"
neighbours = 40
radius = 0.16
"#
    )
}

/// All channels together; each alone is noisier.
fn grey(images: &[Image]) -> Estimate {
    Estimate::over(images, |image| [image.mean(); 3])
}

#[test]
fn marchers_agree_with_path_tracing() {
    let mut checks = Checks::default();
    let path = grey(&images(16, &room(""), &["render.method=path", "render.samples=400"]));
    for (i, step) in STEPS.into_iter().enumerate() {
        for (j, kernel) in ["fixed", "knn"].into_iter().enumerate() {
            let profile = ["constant", "epanechnikov", "biweight"][(i + j) % 3];
            let set = [
                "render.samples=8".to_string(),
                format!("volume.kernel={kernel}"),
                format!("volume.profile={profile}"),
                format!("volume.march.step={step}"),
                "volume.march.size=0.2".to_string(),
            ];
            let set: Vec<&str> = set.iter().map(String::as_str).collect();
            let found = grey(&images(8, &room(""), &set));
            // Blur around the lamp, and corners.
            checks.agree(&format!("{step}, {kernel}, {profile}"), &found, &path, 0.01, BIAS);
        }
    }
    checks.finish();
}

/// What balls of 0.16 in a room four wide are off by, at most.
const BIAS: f64 = 0.01;

#[test]
fn a_grid_of_one_number_is_a_homogeneous_medium() {
    let mut checks = Checks::default();
    let grid =
        "density = { type = \"array\", file = \"beam/constant.npy\", min = [-2.5, -0.5, -2.5], max = [2.5, 3, 2.5] }";
    for step in STEPS {
        let step = format!("volume.march.step={step}");
        let set = ["render.samples=8", &step, "volume.march.size=0.4"];
        let [plain, voxels] = ["", grid].map(|density| grey(&images(8, &room(density), &set)));
        checks.agree(&step, &voxels, &plain, 0.01, 0.0);
    }
    checks.finish();
}
