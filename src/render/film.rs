//! Sums over samples, by pixel and layer, and the pictures made of them.

use crate::image::{Image, Layer, LayerData};
use crate::math::Rgb;

use super::eye::{Component, Sample};

/// What a film keeps beside the image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Layers {
    /// The components of light transport and the first surface's albedo, normal and depth.
    pub components: bool,
    /// The standard error over passes.
    pub standard_error: bool,
}

/// The image while it is made.
#[derive(Debug)]
pub struct Film {
    width: u32,
    height: u32,
    layers: Layers,
    pixels: Vec<Pixel>,
    components: Vec<[[f32; 3]; Component::ALL.len()]>,
    surfaces: Vec<First>,
    /// Sums over passes of the pixel's mean in a pass, and of its square.
    passes: Vec<[[f64; 3]; 2]>,
    finished_passes: u32,
}

#[derive(Clone, Copy, Debug, Default)]
struct Pixel {
    sum: [f64; 3],
    /// The part of `sum` from passes before this one.
    before: [f64; 3],
    samples: u32,
    samples_before: u32,
}

#[derive(Clone, Copy, Debug, Default)]
struct First {
    albedo: [f32; 3],
    normal: [f32; 3],
    depth: f32,
    hits: u32,
}

/// One pixel's samples of a round.
#[derive(Clone, Copy, Debug, Default)]
pub struct Sums {
    components: [Rgb; Component::ALL.len()],
    albedo: Rgb,
    normal: Rgb,
    depth: f64,
    hits: u32,
    samples: u32,
}

impl Sums {
    /// Adds a sample.
    pub fn add(&mut self, sample: &Sample) {
        for (sum, radiance) in self.components.iter_mut().zip(sample.radiance) {
            *sum += radiance;
        }
        if sample.depth.is_finite() {
            self.albedo += sample.albedo;
            self.normal += sample.normal;
            self.depth += sample.depth;
            self.hits += 1;
        }
        self.samples += 1;
    }

    /// Adds light that a sample was still waiting for.
    pub fn add_to(&mut self, component: Component, radiance: Rgb) {
        self.components[component as usize] += radiance;
    }
}

impl Film {
    /// A black film.
    pub fn new(width: u32, height: u32, layers: Layers) -> Self {
        let count = width as usize * height as usize;
        let when = |kept: bool| if kept { count } else { 0 };
        Film {
            width,
            height,
            layers,
            pixels: vec![Pixel::default(); count],
            components: vec![Default::default(); when(layers.components)],
            surfaces: vec![First::default(); when(layers.components)],
            passes: vec![Default::default(); when(layers.standard_error)],
            finished_passes: 0,
        }
    }

    /// Bytes that a film of this size takes.
    pub fn bytes(width: u32, height: u32, layers: Layers) -> u64 {
        let mut pixel = size_of::<Pixel>() + size_of::<[f32; 3]>();
        if layers.components {
            pixel += 2 * (size_of::<[[f32; 3]; Component::ALL.len()]>() + size_of::<First>());
        }
        if layers.standard_error {
            pixel += size_of::<[[f64; 3]; 2]>();
        }
        width as u64 * height as u64 * pixel as u64
    }

    /// Adds a round's samples of one pixel.
    pub fn add(&mut self, x: u32, y: u32, sums: &Sums) {
        let at = y as usize * self.width as usize + x as usize;
        let pixel = &mut self.pixels[at];
        let total: Rgb = sums.components.iter().sum();
        pixel.samples += sums.samples;
        for (sum, value) in pixel.sum.iter_mut().zip(total.to_array()) {
            *sum += value;
        }
        if self.layers.components {
            for (sum, radiance) in self.components[at].iter_mut().zip(sums.components) {
                add(sum, radiance);
            }
            let first = &mut self.surfaces[at];
            add(&mut first.albedo, sums.albedo);
            add(&mut first.normal, sums.normal);
            first.depth += sums.depth as f32;
            first.hits += sums.hits;
        }
    }

    /// Ends a pass: its means count as one independent estimate.
    pub fn end_pass(&mut self) {
        self.finished_passes += 1;
        for (pixel, sums) in self.pixels.iter_mut().zip(&mut self.passes) {
            let samples = (pixel.samples - pixel.samples_before).max(1) as f64;
            let [means, squares] = sums;
            for (c, (sum, before)) in pixel.sum.iter().zip(pixel.before).enumerate() {
                let mean = (sum - before) / samples;
                means[c] += mean;
                squares[c] += mean * mean;
            }
            pixel.before = pixel.sum;
            pixel.samples_before = pixel.samples;
        }
    }

    /// Whether any pixel has a sample.
    pub fn has_samples(&self) -> bool {
        self.pixels.iter().any(|pixel| pixel.samples > 0)
    }

    /// The image.
    pub fn image(&self) -> Image {
        let pixels = self.pixels.iter().map(|pixel| {
            let scale = 1.0 / pixel.samples.max(1) as f64;
            pixel.sum.map(|sum| (sum * scale) as f32)
        });
        Image { width: self.width as usize, height: self.height as usize, pixels: pixels.collect() }
    }

    /// The layers: components that are not black throughout (they add up to the image), albedo, normal,
    /// depth, and the standard error.
    pub fn layers(&self) -> Vec<Layer> {
        let mut layers = Vec::new();
        if self.layers.components {
            for component in Component::ALL {
                let values: Vec<[f32; 3]> = self
                    .components
                    .iter()
                    .zip(&self.pixels)
                    .map(|(sums, pixel)| sums[component as usize].map(|sum| sum / pixel.samples.max(1) as f32))
                    .collect();
                if values.iter().any(|value| *value != [0.0; 3]) {
                    layers.push(Layer { name: component.name().to_string(), channels: LayerData::Rgb(values) });
                }
            }
            let mean = |first: &First, value: [f32; 3]| value.map(|sum| sum / first.hits.max(1) as f32);
            let albedo = self.surfaces.iter().map(|first| mean(first, first.albedo)).collect();
            layers.push(Layer { name: "albedo".to_string(), channels: LayerData::Rgb(albedo) });
            let normal =
                self.surfaces.iter().map(|first| glam::Vec3::from_array(first.normal).normalize_or_zero().to_array());
            layers.push(Layer { name: "normal".to_string(), channels: LayerData::Normal(normal.collect()) });
            let depth = self.surfaces.iter().map(|first| match first.hits {
                0 => f32::INFINITY,
                hits => first.depth / hits as f32,
            });
            layers.push(Layer { name: "depth".to_string(), channels: LayerData::Scalar(depth.collect()) });
        }
        if self.layers.standard_error && self.finished_passes > 1 {
            let n = self.finished_passes as f64;
            let values = self.passes.iter().map(|[sum, squares]| {
                std::array::from_fn(|c| {
                    let variance = (squares[c] - sum[c] * sum[c] / n).max(0.0) / (n - 1.0);
                    (variance / n).sqrt() as f32
                })
            });
            layers.push(Layer { name: "standard_error".to_string(), channels: LayerData::Rgb(values.collect()) });
        }
        layers
    }
}

fn add(sum: &mut [f32; 3], value: Rgb) {
    for (sum, value) in sum.iter_mut().zip(value.to_array()) {
        *sum += value as f32;
    }
}
