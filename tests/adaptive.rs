//! More samples where the noise is: less of it for the same work, and means as they are without.

use crate::support::{Estimate, render};

/// Lamps, each smaller than the pixel in whose middle it shines, in so many columns, every so many pixels, and so many rows, on the left of a picture that
/// is black: all of its noise.
fn lamps(radius: f64, (columns, every): (u32, u32), rows: u32) -> String {
    let mut text = "\
[film]
width = 64
height = 32
[camera]
position = [0, 0, 5]
target = [0, 0, 0]
projection = \"orthographic\"
fov = 43.602818972070
[render]
method = \"path\"
samples = 4
"
    .to_string();
    for (column, row) in (0..columns).flat_map(|column| (0..rows).map(move |row| (column, row))) {
        let place = |pixel: u32| 0.125 * (f64::from(pixel) + 0.5);
        let (x, y) = (-4.0 + place(every * column), -2.0 + place(32 / rows * row));
        text += &format!(
            "[[shapes]]\ntype = \"sphere\"\ncenter = [{x}, {y}, 0]\nradius = {radius}\nemission = {{ radiance = 100 }}\n"
        );
    }
    text
}

/// A mean is not changed by what decides on the number of its samples, be they ever so few and unlike each other: here each is black or, one time in
/// five or six, bright.
#[test]
fn more_samples_where_the_noise_is_leave_the_mean_as_it_is() {
    // One in a bundle's pixels of each colour: what it finds alone says how many samples there are.
    let found = Estimate::of(1000, &lamps(0.03, (4, 3), 4), &[]);
    // What they send, over the picture's 8 × 4.
    let sent = 100.0 * 16.0 * std::f64::consts::PI * 0.03_f64.powi(2) / 32.0;
    for (bias, error) in found.bias(&Estimate::exact([sent; 3])) {
        assert!(error < 0.01, "{error}");
        assert!(bias.abs() < 4.0 * error, "{bias} ± {error}");
    }
}

/// The same work leaves half of the squared error, or less, where an eighth of the picture is noisy.
#[test]
fn more_samples_where_the_noise_is_leave_less_of_it() {
    let lamps = lamps(0.05, (8, 1), 32);
    let truth = render(&lamps, &["render.samples=4096", "render.adaptive=false"]).film.image();
    let error = |adaptive: bool| {
        let set = ["render.samples=16".to_string(), format!("render.adaptive={adaptive}")];
        let image = render(&lamps, &[&set[0], &set[1]]).film.image();
        let pairs = image.pixels.iter().zip(&truth.pixels);
        pairs.map(|(found, true_value)| (found[0] - true_value[0]).powi(2)).sum::<f32>()
    };
    let (adaptive, even) = (error(true), error(false));
    assert!(adaptive < 0.5 * even, "{adaptive} against {even}");
}
