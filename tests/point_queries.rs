//! Point queries agree with path tracing under every marcher, ball and profile.

use volpm::image::Image;

use crate::support::{Checks, Estimate, images};

const STEPS: [&str; 3] = ["uniform", "adaptive", "exponential"];

/// A block of coloured fog, cut by a floor and a back wall that reflect nothing, lit from the side.
pub fn block(density: &str) -> String {
    format!(
        r#"
[film]
width = 12
height = 12
layers = false
[camera]
position = [0.4, 0.6, 5]
target = [0, 0, 0]
fov = 22
[media.fog]
sigma_s = [0.5, 0.8, 1.2]
sigma_a = 0.1
phase = {{ type = "hg", g = 0.4 }}
{density}
[materials.black]
type = "lambert"
reflectance = 0.0
[[shapes]]
type = "box"
min = [-1, -0.8, -0.8]
max = [1, 0.8, 0.8]
interior = "fog"
[[shapes]]
type = "quad"
origin = [-3, -0.7, 3]
edge_u = [6, 0, 0]
edge_v = [0, 0, -6]
material = "black"
[[shapes]]
type = "quad"
origin = [-3, -3, -0.7]
edge_u = [6, 0, 0]
edge_v = [0, 6, 0]
material = "black"
[[lights]]
type = "spot"
position = [2, 2.5, 2]
target = [0, 0, 0]
intensity = 10
inner_angle = 25
outer_angle = 40
[photons]
volume = 200_000
[volume]
estimate = "point"
neighbours = 40
radius = 0.05
"#
    )
}

/// All channels together; each alone is noisier.
pub fn grey(images: &[Image]) -> Estimate {
    Estimate::over(images, |image| [image.mean(); 3])
}

#[test]
fn marchers_agree_with_path_tracing() {
    let mut checks = Checks::default();
    let path = grey(&images(16, &block(""), &["render.method=path", "render.samples=60"]));
    for (i, step) in STEPS.into_iter().enumerate() {
        for (j, kernel) in ["fixed", "knn"].into_iter().enumerate() {
            let profile = ["constant", "epanechnikov", "biweight"][(i + j) % 3];
            let set = [
                "render.samples=7".to_string(),
                format!("volume.kernel={kernel}"),
                format!("volume.profile={profile}"),
                format!("volume.march.step={step}"),
                "volume.march.size=0.1".to_string(),
            ];
            let set: Vec<&str> = set.iter().map(String::as_str).collect();
            let found = grey(&images(3, &block(""), &set));
            checks.agree(&format!("{step}, {kernel}, {profile}"), &found, &path, 0.0045, BIAS);
        }
    }
    checks.finish();
}

/// What balls of 0.05 in fog two wide are off by, at most.
const BIAS: f64 = 0.002;
