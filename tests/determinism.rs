//! The same scene and seed give the same pixels, bit by bit, whatever the number of threads.

use volpm::image::Image;

use crate::support::render;

/// Fog and a grid, a diffuse wall, lights of several kinds: all random numbers there are.
const SCENE: &str = r#"
[film]
width = 40
height = 36
[camera]
position = [0, 0.2, 4]
target = [0, 0, 0]
fov = 40
[world]
medium = "haze"
[media.haze]
sigma_s = [0.05, 0.1, 0.2]
sigma_a = 0.02
[media.smoke]
sigma_t = 4
albedo = 0.9
density = { type = "vdb", file = "reference/smoke_grid/smoke_grid_64.vdb", grid = "density" }
phase = { type = "hg", g = 0.4 }
[materials.white]
type = "lambert"
reflectance = 0.7
[[shapes]]
type = "box"
min = [-1, -1, -1]
max = [1, 1, 1]
interior = "smoke"
[[shapes]]
type = "quad"
origin = [-4, -1.2, 4]
edge_u = [8, 0, 0]
edge_v = [0, 0, -8]
material = "white"
[[shapes]]
type = "sphere"
center = [2, 2, 1]
radius = 0.2
emission = { radiance = 40 }
[[lights]]
type = "point"
position = [-2, 1, 1]
intensity = [1, 2, 3]
[render]
samples = 3
[photons]
volume = 30_000
"#;

#[test]
fn threads_change_nothing() {
    for (method, estimate) in [("photon", "beam"), ("photon", "point"), ("path", "beam")] {
        let image = |threads: usize, seed: u32| -> Image {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let (method, seed) = (format!("render.method={method}"), format!("render.seed={seed}"));
            let estimate = format!("volume.estimate={estimate}");
            pool.install(|| render(SCENE, &[&method, &estimate, &seed]).film.image())
        };
        let one = image(1, 7);
        for threads in [2, 5] {
            let other = image(threads, 7);
            let bits = |image: &Image| image.pixels.iter().flatten().map(|x| x.to_bits()).collect::<Vec<_>>();
            assert!(bits(&one) == bits(&other), "{method}, {estimate}: {threads} threads");
        }
        let other = image(2, 8);
        let same = one.pixels.iter().zip(&other.pixels).filter(|(a, b)| a == b).count();
        assert!(same < one.pixels.len() / 20, "{method}, {estimate}: another seed left {same} pixels as they were");
        assert!(one.mean() > 0.0);
    }
}
