use std::sync::Arc;

use super::texture::Wrap;
use crate::image::Image;
use crate::math::Rgb;

/// An image at every size from its own down to one texel, each half of the last (Williams 1983): what stands behind a texture, so that
/// a glance at many texels costs no more than one at a few.
#[derive(Clone, Debug)]
pub struct Pyramid {
    /// Level k has texels of 2ᵏ of the image's, about.
    levels: Vec<Image>,
}

impl Pyramid {
    /// All sizes of an image.
    pub fn new(image: Image) -> Arc<Self> {
        let mut levels = vec![image];
        while let Some(last) = levels.last()
            && last.width.max(last.height) > 1
        {
            levels.push(halved(last));
        }
        Arc::new(Pyramid { levels })
    }

    /// The image itself.
    pub fn image(&self) -> &Image {
        &self.levels[0]
    }

    /// The colour about (x, y), in the image's widths and heights from its lower left corner, over about `footprint` of the image's texels:
    /// bilinear in the two levels whose texels are next in size, and between these linear.
    pub(super) fn at(&self, wrap: Wrap, place: [f64; 2], footprint: f64) -> Rgb {
        let last = self.levels.len() - 1;
        let level = footprint.max(1.0).log2().min(last as f64);
        let (finer, share) = (level as usize, level.fract());
        let colour = bilinear(&self.levels[finer], wrap, place);
        if share == 0.0 { colour } else { colour.lerp(bilinear(&self.levels[finer + 1], wrap, place), share) }
    }
}

/// Bilinear between the middles of texels.
fn bilinear(Image { width, height, pixels }: &Image, wrap: Wrap, place: [f64; 2]) -> Rgb {
    let (x, y) = (place[0] * *width as f64 - 0.5, (1.0 - place[1]) * *height as f64 - 0.5);
    // Farther away, texels have no index.
    const FARTHEST: f64 = (1u64 << 52) as f64;
    let [x, y] = [x, y].map(|x| if x.abs() < FARTHEST { x } else { 0.0 });
    let (i, j) = (x.floor(), y.floor());
    let (fx, fy) = (x - i, y - j);
    let columns = [0, 1].map(|k| wrap.texel(i as i64 + k, *width));
    let row = |k: i64| {
        let row = wrap.texel(j as i64 + k, *height) * width;
        let [a, b] = columns.map(|column| Rgb::from_array(pixels[row + column].map(f64::from)));
        a.lerp(b, fx)
    };
    row(0).lerp(row(1), fy)
}

/// Half as many texels each way, rounded up, of the areas that they cover.
fn halved(image: &Image) -> Image {
    let [width, height] = [image.width, image.height].map(|n| n.div_ceil(2));
    let columns = |i: usize| covered(i, width, image.width);
    let mut pixels = Vec::with_capacity(width * height);
    for j in 0..height {
        for i in 0..width {
            let mut sum = [0.0; 3];
            for (row, tall) in covered(j, height, image.height) {
                for (column, wide) in columns(i) {
                    let pixel = image.pixels[row * image.width + column];
                    sum = [0, 1, 2].map(|c| sum[c] + tall * wide * f64::from(pixel[c]));
                }
            }
            pixels.push(sum.map(|sum| sum as f32));
        }
    }
    Image { width, height, pixels }
}

/// The texels of `n` that texel `i` of `fewer` covers, with their shares of it.
fn covered(i: usize, fewer: usize, n: usize) -> impl Iterator<Item = (usize, f64)> {
    let size = n as f64 / fewer as f64;
    let (from, to) = (i as f64 * size, (i + 1) as f64 * size);
    (from as usize..n).map_while(move |k| {
        let part = to.min(k as f64 + 1.0) - from.max(k as f64);
        (part > 1e-9).then_some((k, part / size))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every level has the image's mean, whatever its size; what is seen of fine stripes from afar is that, from near the stripes, and
    /// between the two it changes without a jump.
    #[test]
    fn levels_keep_the_mean() {
        for (width, height) in [(1, 1), (7, 5), (64, 64), (1, 37)] {
            let pixels: Vec<[f32; 3]> = (0..width * height)
                .map(|k| [(k % 2) as f32, (k % 5) as f32 / 4.0, (k * k % 11) as f32 / 10.0])
                .collect();
            let pyramid = Pyramid::new(Image { width, height, pixels });
            let mean = |image: &Image| {
                let sum: Rgb = image.pixels.iter().map(|pixel| Rgb::from_array(pixel.map(f64::from))).sum();
                sum / image.pixels.len() as f64
            };
            let all = mean(pyramid.image());
            for level in &pyramid.levels {
                assert!((mean(level) - all).abs().max_element() < 1e-6, "{width}×{height}: {}", level.width);
            }
            assert!((pyramid.at(Wrap::Repeat, [0.3, 0.8], 1e9) - all).abs().max_element() < 1e-6);
            let middle = [0.5 / width as f64, 1.0 - 0.5 / height as f64];
            assert!(pyramid.at(Wrap::Repeat, middle, 0.5).max_element() < 1e-6);
            let step = |footprint: f64| pyramid.at(Wrap::Repeat, [0.31, 0.77], footprint);
            for k in 0..400 {
                let footprint = 0.5 * 1.02f64.powi(k);
                let jump = (step(footprint * 1.02) - step(footprint)).abs().max_element();
                assert!(jump < 0.06, "{width}×{height} at {footprint}: {jump}");
            }
        }
    }
}
