//! Error figures of several images of one estimate against a reference, as [`results`](super::results) defines them.

use super::results::{Figure, Figures, ReferenceRegion, Region};
use crate::image::Image;

/// What images are held against.
#[derive(Clone, Debug)]
pub struct Standard {
    /// R.
    pub image: Image,
    /// The standard error of each pixel.
    pub error: Option<Image>,
}

impl Standard {
    /// The standard error of the whole, relative as `relmse` is; `None` where it is not known.
    pub fn relative_error(&self) -> Option<f64> {
        let floor = self.floor();
        let mut sum = Sum::default();
        for at in 0..self.image.pixels.len() {
            let (Some(r), Some(v)) = (self.at(at), self.variance(at)?) else { continue };
            for c in 0..3 {
                sum.add(v[c] / (r[c] * r[c] + floor));
            }
        }
        Some(if floor > 0.0 { sum.mean().sqrt() } else { 0.0 })
    }

    /// What is known of a region.
    pub fn region(&self, region: &Region) -> ReferenceRegion {
        let mut means = [Sum::default(); 3];
        let mut variance = Sum::default();
        for at in pixels(region, self.image.width) {
            let Some(r) = self.at(at) else { continue };
            means.iter_mut().zip(r).for_each(|(sum, value)| sum.add(value));
            if let Some(Some(v)) = self.variance(at) {
                v.iter().for_each(|&v| variance.add(v));
            }
        }
        ReferenceRegion { mean: means.map(Sum::mean), variance: self.error.is_some().then(|| variance.mean()) }
    }

    /// 0.01 M².
    fn floor(&self) -> f64 {
        let mut level = Sum::default();
        (0..self.image.pixels.len()).filter_map(|at| self.at(at)).flatten().for_each(|value| level.add(value));
        0.01 * level.mean().powi(2)
    }

    /// A pixel, if it is finite and its error too.
    fn at(&self, at: usize) -> Option<[f64; 3]> {
        let finite = |pixel: [f32; 3]| pixel.iter().all(|value| value.is_finite());
        let known = self.error.as_ref().is_none_or(|error| finite(error.pixels[at]));
        Some(self.image.pixels[at]).filter(|&pixel| known && finite(pixel)).map(|pixel| pixel.map(f64::from))
    }

    fn variance(&self, at: usize) -> Option<Option<[f64; 3]>> {
        let error = self.error.as_ref()?;
        Some(self.at(at).map(|_| error.pixels[at].map(|value| f64::from(value).powi(2))))
    }
}

/// The pixels of a region of an image so wide.
fn pixels(region: &Region, width: usize) -> impl Iterator<Item = usize> {
    let columns = region.x as usize..(region.x + region.width) as usize;
    let rows = region.y as usize..(region.y + region.height) as usize;
    rows.flat_map(move |y| columns.clone().map(move |x| y * width + x))
}

#[derive(Clone, Copy, Default)]
struct Sum {
    sum: f64,
    count: u64,
}

impl Sum {
    fn add(&mut self, value: f64) {
        self.sum += value;
        self.count += 1;
    }

    fn mean(self) -> f64 {
        self.sum / self.count.max(1) as f64
    }
}

/// The figures of `images`, one a seed, of the standard's size.
pub fn figures(images: &[Image], standard: &Standard, region: &Region) -> Figures {
    let count = images.len();
    let floor = standard.floor();
    // ⟨(I_j − R)(I_k − R)⟩, plain and relative: every figure is a sum of these.
    let triangle: Vec<Vec<f64>> = (1..=count).map(|length| vec![0.0; length]).collect();
    let mut products = [triangle.clone(), triangle];
    let mut variances = [0.0; 2];
    let mut means = vec![[0.0; 3]; count];
    let mut used = 0u64;
    let mut differences = vec![0.0; count];
    for at in pixels(region, standard.image.width) {
        let Some(r) = standard.at(at) else { continue };
        used += 1;
        let variance = standard.variance(at).flatten().unwrap_or_default();
        for c in 0..3 {
            let weights = [1.0, 1.0 / (r[c] * r[c] + floor)];
            for (k, image) in images.iter().enumerate() {
                let value = f64::from(image.pixels[at][c]);
                means[k][c] += value;
                differences[k] = value - r[c];
            }
            for (w, weight) in weights.into_iter().enumerate() {
                variances[w] += weight * variance[c];
                for (row, one) in products[w].iter_mut().zip(&differences) {
                    for (product, other) in row.iter_mut().zip(&differences) {
                        *product += weight * one * other;
                    }
                }
            }
        }
    }
    let pixels = used.max(1) as f64;
    let [plain, relative] = products.map(|sums| Products::new(sums, 3.0 * pixels));
    let [variance, relative_variance] = variances.map(|sum| sum / (3.0 * pixels));

    let mse = shifted(mean(&plain.diagonal()), -variance);
    let rmse = mse.value.max(0.0).sqrt();
    let several = count > 1;
    Figures {
        mean: [0, 1, 2].map(|c| mean(&means.iter().map(|sums| sums[c] / pixels).collect::<Vec<_>>())),
        mse,
        rmse: Figure { value: rmse, error: mse.error.filter(|_| rmse > 0.0).map(|error| error / (2.0 * rmse)) },
        relmse: (floor > 0.0).then(|| shifted(mean(&relative.diagonal()), -relative_variance)),
        bias2: several.then(|| shifted(plain.jackknife(Products::off_diagonal), -variance)),
        variance: several.then(|| plain.jackknife(|products, left| products.spread(left))),
    }
}

fn shifted(figure: Figure, by: f64) -> Figure {
    Figure { value: figure.value + by, ..figure }
}

/// The mean of independent values with its standard error.
pub fn mean(values: &[f64]) -> Figure {
    let count = values.len() as f64;
    let mean = values.iter().sum::<f64>() / count.max(1.0);
    let squares: f64 = values.iter().map(|value| (value - mean).powi(2)).sum();
    Figure { value: mean, error: (count > 1.0).then(|| (squares / (count - 1.0) / count).sqrt()) }
}

/// Mean products of differences from the reference, by pairs of images: in row j those with images 0 to j.
struct Products(Vec<Vec<f64>>);

impl Products {
    /// From sums over so many values.
    fn new(mut sums: Vec<Vec<f64>>, values: f64) -> Self {
        sums.iter_mut().flatten().for_each(|sum| *sum /= values);
        Products(sums)
    }

    fn at(&self, j: usize, k: usize) -> f64 {
        self.0[j.max(k)][j.min(k)]
    }

    fn diagonal(&self) -> Vec<f64> {
        (0..self.0.len()).map(|k| self.at(k, k)).collect()
    }

    fn others(&self, left: Option<usize>) -> impl Iterator<Item = usize> + Clone {
        (0..self.0.len()).filter(move |&k| Some(k) != left)
    }

    /// The mean over pairs of different images: noise is independent there, and only bias is left.
    fn off_diagonal(&self, left: Option<usize>) -> f64 {
        let mut sum = Sum::default();
        for j in self.others(left) {
            self.others(left).filter(|&k| k != j).for_each(|k| sum.add(self.at(j, k)));
        }
        sum.mean()
    }

    /// What squares of single images have more than that: the variance.
    fn spread(&self, left: Option<usize>) -> f64 {
        let mut sum = Sum::default();
        self.others(left).for_each(|k| sum.add(self.at(k, k)));
        sum.mean() - self.off_diagonal(left)
    }

    /// A figure with its standard error by leaving out one image after the other, where there are three at least.
    fn jackknife(&self, figure: impl Fn(&Self, Option<usize>) -> f64) -> Figure {
        let count = self.0.len();
        let value = figure(self, None);
        if count < 3 {
            return Figure { value, error: None };
        }
        let partial: Vec<f64> = (0..count).map(|left| figure(self, Some(left))).collect();
        let middle = partial.iter().sum::<f64>() / count as f64;
        let squares: f64 = partial.iter().map(|value| (value - middle).powi(2)).sum();
        Figure { value, error: Some((squares * (count - 1) as f64 / count as f64).sqrt()) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::Stream;
    use crate::math::random::Purpose;

    /// Images of known bias and noise against a noisy reference: figures are right within their own errors, and their
    /// errors within their spread.
    #[test]
    fn bias_and_noise_are_told_apart() {
        const SIZE: usize = 40;
        const SEEDS: u64 = 6;
        let normal = |stream: &mut Stream| (0..12).map(|_| stream.uniform()).sum::<f64>() - 6.0;
        let noisy = |trial: u64, seed: u64, mean: f64, noise: f64| {
            let mut stream = Stream::new(trial, Purpose::Test, seed, 0);
            Image::from_fn(SIZE, SIZE, |x, _| {
                [0; 3].map(|_| (mean * (1.0 + x as f64) + noise * normal(&mut stream)) as f32)
            })
        };
        let region = Region { name: "all".into(), x: 4, y: 0, width: 30, height: 40 };
        let (mut found, mut errors) = ([0.0; 3], [0.0; 3]);
        const TRIALS: u64 = 40;
        // The means differ by 0.1 (x + 1).
        let bias2 = (5..35).map(|x| (0.1 * f64::from(x)).powi(2)).sum::<f64>() / 30.0;
        let expected = [bias2, 0.25, bias2 + 0.25];
        for trial in 0..TRIALS {
            let images: Vec<Image> = (0..SEEDS).map(|seed| noisy(trial, seed, 1.1, 0.5)).collect();
            let error = Some(Image::from_fn(SIZE, SIZE, |_, _| [0.3; 3]));
            let standard = Standard { image: noisy(trial, 1000, 1.0, 0.3), error };
            let figures = figures(&images, &standard, &region);
            let all = [figures.bias2.unwrap(), figures.variance.unwrap(), figures.mse];
            for (i, figure) in all.into_iter().enumerate() {
                found[i] += (figure.value - expected[i]) / TRIALS as f64;
                errors[i] += figure.error.unwrap().powi(2) / TRIALS as f64;
            }
            assert!((all[0].value + all[1].value - all[2].value).abs() < 1e-12);
        }
        for i in 0..3 {
            // The reference's noise adds to the errors of bias and MSE: 2 · 0.3 · √bias² each pixel.
            let reference = if i == 1 { 0.0 } else { 0.36 * bias2 / 3600.0 };
            let error = ((errors[i] + reference) / TRIALS as f64).sqrt();
            assert!(found[i].abs() < 4.0 * error, "{i}: {} ± {error}", found[i]);
        }
        let noise = 0.5f64.powi(2) * (2.0 / 3600.0f64 / (SEEDS - 1) as f64).sqrt();
        assert!((errors[1].sqrt() / noise - 1.0).abs() < 0.3, "{} {noise}", errors[1].sqrt());
    }

    #[test]
    fn figures_agree_with_diff() {
        let noisy = |seed: u64| {
            let mut stream = Stream::new(9, Purpose::Test, seed, 0);
            Image::from_fn(12, 9, |_, _| [0; 3].map(|_| stream.uniform() as f32))
        };
        let standard = Standard { image: noisy(1), error: Some(Image::from_fn(12, 9, |x, _| [0.01 * x as f32; 3])) };
        let region = Region { name: "image".into(), x: 0, y: 0, width: 12, height: 9 };
        let ours = figures(&[noisy(0)], &standard, &region);
        let theirs = crate::image::compare(&noisy(0), &standard.image, standard.error.as_ref()).unwrap();
        assert!((ours.rmse.value / theirs.rmse - 1.0).abs() < 1e-9);
        assert!((ours.relmse.unwrap().value / theirs.rel_mse.unwrap() - 1.0).abs() < 1e-9);
        assert_eq!((ours.bias2, ours.variance, ours.mse.error), (None, None, None));
    }
}
