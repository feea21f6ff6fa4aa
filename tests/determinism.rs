//! The same scene and seed give the same pixels, bit by bit, whatever the number of threads.

use volpm::image::Image;

use crate::support::{ALL_SORTS, render};

#[test]
fn threads_change_nothing() {
    for (method, estimate) in [("photon", "beam"), ("photon", "point"), ("path", "beam")] {
        let image = |threads: usize, seed: u32| -> Image {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let (method, seed) = (format!("render.method={method}"), format!("render.seed={seed}"));
            let estimate = format!("volume.estimate={estimate}");
            pool.install(|| render(ALL_SORTS, &[&method, &estimate, &seed]).film.image())
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
