//! Sums over samples, by pixel and layer, and the pictures made of them.

use rayon::prelude::*;

use crate::image::{Image, Layer, LayerData};
use crate::math::Rgb;

use super::done::{Done, range};
use super::exact::{self, ExactSums};
use super::eye::{Component, Sample};
use super::splat::{Splat, Splats};

/// What a film keeps beside the image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Layers {
    /// The components of light transport and the first surface's albedo, normal and depth.
    pub components: bool,
}

/// The image while it is made: the sums of the pass under way, and those of all finished ones.
#[derive(Debug)]
pub struct Film {
    width: u32,
    height: u32,
    layers: Layers,
    shown: Shown,
    pass: Pass,
    /// `None` for a film of a single pass, whose sums say all there is.
    finished: Option<Finished>,
    done: Done,
}

/// Which components the image is the sum of.
pub(super) type Shown = [bool; COMPONENTS];

/// Sums over the samples of one pass.
#[derive(Debug)]
struct Pass {
    pixels: Vec<Pixel>,
    components: Vec<[[f32; 3]; COMPONENTS]>,
    surfaces: Vec<First>,
    /// What was sent to pixels, where any light was.
    splats: Option<Splats>,
}

/// Sums over passes: exact, so that they are the same however passes are grouped.
#[derive(Debug)]
pub(super) struct Finished {
    /// Of a pixel's mean in a pass.
    pub(super) means: ExactSums<3>,
    /// Of its square.
    pub(super) squares: ExactSums<3>,
    /// Of the components' means; `None` for those that are black throughout.
    pub(super) components: [Option<ExactSums<3>>; COMPONENTS],
    /// Of the first surfaces, where layers are kept.
    pub(super) surfaces: Option<Surfaces>,
}

/// Sums over the samples that met a surface.
#[derive(Debug)]
pub(super) struct Surfaces {
    /// Of albedo and normal.
    pub(super) guides: ExactSums<6>,
    pub(super) depth: ExactSums<1>,
    pub(super) hits: ExactSums<1>,
}

const COMPONENTS: usize = Component::ALL.len();

#[derive(Clone, Copy, Debug, Default)]
struct Pixel {
    sum: [f64; 3],
    samples: u32,
}

impl Pixel {
    fn mean(&self) -> [f64; 3] {
        let scale = 1.0 / self.samples.max(1) as f64;
        self.sum.map(|sum| sum * scale)
    }
}

#[derive(Clone, Copy, Debug, Default)]
struct First {
    albedo: [f32; 3],
    normal: [f32; 3],
    depth: f32,
    hits: u32,
}

impl First {
    fn guides(&self) -> [f64; 6] {
        let ([a, b, c], [x, y, z]) = (self.albedo, self.normal);
        [a, b, c, x, y, z].map(f64::from)
    }
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

    /// What these components add up to.
    fn total(&self, shown: &Shown) -> Rgb {
        self.components.iter().zip(shown).filter(|(_, shown)| **shown).map(|(radiance, _)| radiance).sum()
    }

    /// The mean over the samples.
    pub(super) fn mean(&self, shown: &Shown) -> Rgb {
        self.total(shown) / f64::from(self.samples.max(1))
    }
}

impl Film {
    /// A black film of one pass.
    pub fn new(width: u32, height: u32, layers: Layers) -> Self {
        let count = width as usize * height as usize;
        let kept = if layers.components { count } else { 0 };
        let pass = Pass {
            pixels: vec![Pixel::default(); count],
            components: vec![Default::default(); kept],
            surfaces: vec![First::default(); kept],
            splats: None,
        };
        Film { width, height, layers, shown: [true; COMPONENTS], pass, finished: None, done: Done::default() }
    }

    /// A black film that any number of passes can be added to.
    pub fn of_passes(width: u32, height: u32, layers: Layers) -> Self {
        let film = Film::new(width, height, layers);
        let count = film.pass.pixels.len();
        let surfaces = layers.components.then(|| Surfaces {
            guides: ExactSums::new(count),
            depth: ExactSums::new(count),
            hits: ExactSums::new(count),
        });
        let (means, squares) = (ExactSums::new(count), ExactSums::new(count));
        let finished = Finished { means, squares, components: [const { None }; COMPONENTS], surfaces };
        Film { finished: Some(finished), ..film }
    }

    /// A film that holds finished passes.
    pub(super) fn of_finished((width, height): (u32, u32), layers: Layers, finished: Finished, done: Done) -> Self {
        Film { finished: Some(finished), done, ..Film::new(width, height, layers) }
    }

    /// Bytes of the picture, with its layers, that is made of the sums in the end.
    pub(super) fn picture_bytes(width: u32, height: u32, layers: Layers) -> u64 {
        let mut pixel = size_of::<[f32; 3]>();
        if layers.components {
            pixel += size_of::<[[f32; 3]; COMPONENTS]>() + size_of::<[f32; 7]>();
        }
        width as u64 * height as u64 * pixel as u64
    }

    /// Bytes that a film of this size takes at most, with what making it takes besides.
    pub fn bytes(width: u32, height: u32, layers: Layers, of_passes: bool) -> u64 {
        let mut pixel = size_of::<Pixel>();
        if layers.components {
            pixel += size_of::<[[f32; 3]; COMPONENTS]>() + size_of::<First>();
        }
        if of_passes {
            pixel += 2 * ExactSums::<3>::BYTES;
            if layers.components {
                pixel += COMPONENTS * ExactSums::<3>::BYTES;
                pixel += ExactSums::<6>::BYTES + 2 * ExactSums::<1>::BYTES;
            }
        }
        width as u64 * height as u64 * pixel as u64 + Film::picture_bytes(width, height, layers)
    }

    /// From now on, samples add only these components to the image; layers are kept as they are.
    pub fn show_only(&mut self, components: &[Component]) {
        self.shown = Component::ALL.map(|component| components.contains(&component));
    }

    /// Which components the image is the sum of.
    pub(super) fn shown(&self) -> Shown {
        self.shown
    }

    /// Pixels across and down.
    pub fn size(&self) -> (u32, u32) {
        (self.width, self.height)
    }

    /// What is kept beside the image.
    pub fn kept(&self) -> Layers {
        self.layers
    }

    /// The finished passes.
    pub fn done(&self) -> &Done {
        &self.done
    }

    /// The sums over finished passes, if the film holds such.
    pub(super) fn finished(&self) -> Option<&Finished> {
        self.finished.as_ref()
    }

    /// Adds a round's samples of one pixel.
    pub fn add(&mut self, x: u32, y: u32, sums: &Sums) {
        let at = y as usize * self.width as usize + x as usize;
        let pixel = &mut self.pass.pixels[at];
        pixel.samples += sums.samples;
        for (sum, value) in pixel.sum.iter_mut().zip(sums.total(&self.shown).to_array()) {
            *sum += value;
        }
        if self.layers.components {
            for (sum, radiance) in self.pass.components[at].iter_mut().zip(sums.components) {
                add(sum, radiance);
            }
            let first = &mut self.pass.surfaces[at];
            add(&mut first.albedo, sums.albedo);
            add(&mut first.normal, sums.normal);
            first.depth += sums.depth as f32;
            first.hits += sums.hits;
        }
    }

    /// Adds all that `paths` light paths have sent to the pixels: no more than one splat for each pixel and component. In the
    /// end, each pixel receives the mean over all paths of the pass.
    pub(super) fn splat(&mut self, splats: &[Splat], paths: u64) {
        let pixels = self.pass.pixels.len();
        let sums = self.pass.splats.get_or_insert_with(|| Splats::new(pixels));
        sums.add(splats, paths, &self.shown, self.layers.components);
    }

    /// Ends pass number `pass` of `seed`: its means count as one independent estimate.
    pub fn end_pass(&mut self, seed: u64, pass: u32) {
        self.done.insert(seed, pass);
        let (now, count) = (&self.pass, self.pass.pixels.len());
        let Some(finished) = &mut self.finished else { return };
        finished.means.add(|at| now.mean(at));
        finished.squares.add(|at| now.mean(at).map(|mean| mean * mean));
        for (c, sums) in finished.components.iter_mut().enumerate() {
            if now.holds(c) {
                sums.get_or_insert_with(|| ExactSums::new(count)).add(|at| now.component(c, at));
            }
        }
        if let Some(surfaces) = &mut finished.surfaces {
            surfaces.guides.add(|at| now.surfaces[at].guides());
            surfaces.depth.add(|at| [now.surfaces[at].depth as f64]);
            surfaces.hits.add(|at| [now.surfaces[at].hits as f64]);
        }
        self.pass.pixels.fill(Pixel::default());
        self.pass.components.fill(Default::default());
        self.pass.surfaces.fill(First::default());
        self.pass.splats = None;
    }

    /// Adds the finished passes of another film.
    ///
    /// # Errors
    /// What keeps them apart: another size or other layers, or passes that both hold.
    pub fn merge(&mut self, other: &Film) -> Result<(), String> {
        let unlike = || format!("{} × {} pixels and {} × {}", self.width, self.height, other.width, other.height);
        if self.size() != other.size() {
            return Err(unlike());
        }
        if self.layers != other.layers {
            return Err("only one of them holds layers".to_string());
        }
        if let Some((seed, passes)) = self.done.overlap(&other.done) {
            return Err(format!("both hold {} of seed {seed}", range(passes)));
        }
        if self.done.count() + other.done.count() > exact::MOST as u64 {
            return Err(format!("together they hold more than {} passes", exact::MOST));
        }
        let (Some(sums), Some(more)) = (&mut self.finished, &other.finished) else {
            return Err("they hold single passes".to_string());
        };
        sums.means.merge(&more.means);
        sums.squares.merge(&more.squares);
        for (sums, more) in sums.components.iter_mut().zip(&more.components) {
            if let Some(more) = more {
                sums.get_or_insert_with(|| ExactSums::new(self.pass.pixels.len())).merge(more);
            }
        }
        if let (Some(sums), Some(more)) = (&mut sums.surfaces, &more.surfaces) {
            sums.guides.merge(&more.guides);
            sums.depth.merge(&more.depth);
            sums.hits.merge(&more.hits);
        }
        self.done.merge(&other.done);
        Ok(())
    }

    /// Whether any pixel has a sample.
    pub fn has_samples(&self) -> bool {
        self.done.count() > 0 || self.pass.pixels.iter().any(|pixel| pixel.samples > 0)
    }

    /// The fewest samples that a pixel has in the pass under way.
    pub fn samples_in_pass(&self) -> u32 {
        self.pass.pixels.iter().map(|pixel| pixel.samples).min().unwrap_or(0)
    }

    /// The sums of finished passes; `None` where there are none yet, or the film holds a single pass.
    fn sums(&self) -> Option<(&Finished, f64)> {
        let passes = self.done.count();
        self.finished.as_ref().filter(|_| passes > 0).map(|sums| (sums, passes as f64))
    }

    /// The image: the mean of all finished passes; of the pass under way while there are none.
    pub fn image(&self) -> Image {
        let pixels = match self.sums() {
            Some((sums, n)) => self.each(|at| sums.means.get(at).map(|sum| (sum / n) as f32)),
            None => self.each(|at| exact::rounded(self.pass.mean(at)).map(|mean| mean as f32)),
        };
        Image { width: self.width as usize, height: self.height as usize, pixels }
    }

    fn each<T: Send>(&self, value: impl Fn(usize) -> T + Sync + Send) -> Vec<T> {
        (0..self.pass.pixels.len()).into_par_iter().map(value).collect()
    }

    /// The layers: components that are not black throughout (they add up to the image), albedo, normal,
    /// depth, and the standard error where there are several passes.
    pub fn layers(&self) -> Vec<Layer> {
        let mut layers = Vec::new();
        if self.layers.components {
            self.components(&mut layers);
            self.surfaces(&mut layers);
        }
        if let Some((sums, n)) = self.sums().filter(|(_, n)| *n > 1.0) {
            let values = self.each(|at| sums.variance(at, n).map(|variance| variance.sqrt() as f32));
            layers.push(Layer { name: "standard_error".to_string(), channels: LayerData::Rgb(values) });
        }
        layers
    }

    fn components(&self, layers: &mut Vec<Layer>) {
        for component in Component::ALL {
            let c = component as usize;
            let values: Vec<[f32; 3]> = match self.sums() {
                Some((sums, n)) => match &sums.components[c] {
                    Some(sums) => self.each(|at| sums.get(at).map(|sum| (sum / n) as f32)),
                    None => continue,
                },
                None => self.each(|at| exact::rounded(self.pass.component(c, at)).map(|mean| mean as f32)),
            };
            if values.iter().any(|value| *value != [0.0; 3]) {
                layers.push(Layer { name: component.name().to_string(), channels: LayerData::Rgb(values) });
            }
        }
    }

    fn surfaces(&self, layers: &mut Vec<Layer>) {
        let finished = self.sums().and_then(|(sums, _)| sums.surfaces.as_ref());
        let surfaces: Vec<([f64; 6], f64, f64)> = self.each(|at| match finished {
            Some(sums) => (sums.guides.get(at), sums.depth.get(at)[0], sums.hits.get(at)[0]),
            None => {
                let first = &self.pass.surfaces[at];
                (exact::rounded(first.guides()), exact::rounded([first.depth as f64])[0], first.hits as f64)
            }
        });
        let albedo = surfaces.iter().map(|(guides, _, hits)| [0, 1, 2].map(|c| (guides[c] / hits.max(1.0)) as f32));
        layers.push(Layer { name: "albedo".to_string(), channels: LayerData::Rgb(albedo.collect()) });
        let normal = surfaces
            .iter()
            .map(|([.., x, y, z], ..)| glam::DVec3::new(*x, *y, *z).normalize_or_zero().as_vec3().to_array());
        layers.push(Layer { name: "normal".to_string(), channels: LayerData::Normal(normal.collect()) });
        let depth =
            surfaces.iter().map(|(_, depth, hits)| if *hits > 0.0 { (depth / hits) as f32 } else { f32::INFINITY });
        layers.push(Layer { name: "depth".to_string(), channels: LayerData::Scalar(depth.collect()) });
    }

    /// The relative standard error, estimated from the spread of passes: with s the standard error of a pixel's
    /// channel, I its value and M the mean of the image, √ of the mean of s²/(I² + 0.01 M²). What is wrong with
    /// every pass alike, blur foremost, it does not see. `None` before there are two passes.
    pub fn error(&self) -> Option<f64> {
        let (sums, n) = self.sums().filter(|(_, n)| *n > 1.0)?;
        let pixels = self.pass.pixels.len();
        // Summed in a fixed order.
        let mean = |of: &(dyn Fn(usize) -> [f64; 3] + Sync)| {
            let chunks: Vec<f64> = (0..pixels.div_ceil(CHUNK))
                .into_par_iter()
                .map(|chunk| {
                    let pixels = chunk * CHUNK..pixels.min((chunk + 1) * CHUNK);
                    pixels.map(|at| of(at).iter().sum::<f64>()).sum()
                })
                .collect();
            chunks.iter().sum::<f64>() / (3 * pixels) as f64
        };
        let level = mean(&|at| sums.means.get(at).map(|sum| sum / n));
        if level == 0.0 {
            return Some(0.0);
        }
        let relative = |at| {
            let (means, variances) = (sums.means.get(at), sums.variance(at, n));
            std::array::from_fn(|c| variances[c] / ((means[c] / n).powi(2) + 0.01 * level * level))
        };
        Some(mean(&relative).sqrt())
    }
}

/// Pixels that one task sums.
const CHUNK: usize = 4096;

impl Pass {
    /// A pixel's mean, of its samples and of what was sent to it.
    fn mean(&self, at: usize) -> [f64; 3] {
        let (seen, sent) = (self.pixels[at].mean(), self.splats.as_ref().map_or([0.0; 3], |splats| splats.mean(at)));
        std::array::from_fn(|c| seen[c] + sent[c])
    }

    /// Of one component.
    fn component(&self, component: usize, at: usize) -> [f64; 3] {
        let scale = 1.0 / self.pixels[at].samples.max(1) as f64;
        let sent = self.splats.as_ref().map_or([0.0; 3], |splats| splats.component(component, at));
        std::array::from_fn(|c| self.components[at][component][c] as f64 * scale + sent[c])
    }

    /// Whether a component is anything but black.
    fn holds(&self, component: usize) -> bool {
        let seen = || self.components.par_iter().any(|components| components[component] != [0.0; 3]);
        self.splats.as_ref().is_some_and(|splats| splats.holds(component)) || seen()
    }
}

impl Finished {
    /// The squared standard error of the mean of `n` passes, by channel.
    fn variance(&self, at: usize, n: f64) -> [f64; 3] {
        let (sums, squares) = (self.means.get(at), self.squares.get(at));
        std::array::from_fn(|c| (squares[c] - sums[c] * sums[c] / n).max(0.0) / (n - 1.0) / n)
    }
}

fn add(sum: &mut [f32; 3], value: Rgb) {
    for (sum, value) in sum.iter_mut().zip(value.to_array()) {
        *sum += value as f32;
    }
}
