//! Small pictures of a scene, by any estimator and seed.

use super::blocks::{BLOCK, Blocks};
use super::halt::{Halt, seconds_of_threads};
use crate::image::{Image, LayerData};
use crate::render::{
    Component, End, Limits, Progress, Rendering, SharedMap, SharedPhotons, Stats, refine, refine_shared,
};
use crate::scene::description::{Film, Method, Window};
use crate::scene::{Scene, Settings};
use crate::{Error, Result};

/// About how many pixels pictures have.
const PIXELS: f64 = 1728.0;

/// Camera samples per pixel of each picture, where paths are short.
const SAMPLES: u32 = 4;
/// So many pictures of that many samples should fit into the time of an estimator.
const SEVERAL: f64 = 16.0;

/// A scene, and the settings of small pictures of it.
pub struct Bench<'a> {
    /// The scene.
    pub scene: &'a Scene,
    /// Its settings, but for a small film, one pass, and few samples.
    pub settings: Settings,
    /// Ends renders.
    pub halt: &'a Halt<'a>,
    /// Hears how far they are.
    pub watch: &'a dyn Progress,
}

/// A picture.
pub struct Shot {
    /// All of it.
    pub image: Image,
    /// Without what is seen in mirrors and through boundaries.
    pub spread: Image,
    /// Without what the camera sees shine: what photons may have to do with.
    pub sent: Image,
    /// Without either: what photons bring to what the camera sees directly.
    pub direct: Image,
    /// Its seed.
    pub seed: u64,
    /// What it cost.
    pub stats: Stats,
    /// What the renderer said.
    pub warnings: Vec<String>,
}

/// Pictures of an estimator by several seeds.
#[derive(Default)]
pub struct Series {
    /// In the order of their seeds.
    pub shots: Vec<Shot>,
}

impl Series {
    /// All light, by blocks.
    pub fn blocks(&self) -> Blocks {
        Blocks::of(self.shots.iter().map(|shot| &shot.image), BLOCK)
    }

    /// That without what is seen in mirrors and through boundaries.
    pub fn spread(&self) -> Blocks {
        Blocks::of(self.shots.iter().map(|shot| &shot.spread), BLOCK)
    }

    /// That without either.
    pub fn direct(&self) -> Blocks {
        Blocks::of(self.shots.iter().map(|shot| &shot.direct), BLOCK)
    }

    /// That without what the camera sees shine.
    pub fn sent(&self) -> Blocks {
        Blocks::of(self.shots.iter().map(|shot| &shot.sent), BLOCK)
    }
}

/// Fewer pictures tell too little of how far apart they are.
pub const FEWEST: usize = 4;

impl<'a> Bench<'a> {
    /// Small pictures of a scene.
    pub fn new(scene: &'a Scene, settings: &Settings, halt: &'a Halt<'a>, watch: &'a dyn Progress) -> Self {
        let mut settings = settings.clone();
        settings.film = small(&settings.film);
        settings.render.samples = SAMPLES;
        // Who asks for a sample by its number finds it.
        settings.render.adaptive = false;
        settings.render.passes = 1;
        Bench { scene, settings, halt, watch }
    }

    /// The seed of picture number `index`.
    pub fn seed(&self, index: usize) -> u64 {
        self.settings.render.seed.wrapping_add(index as u64)
    }

    /// A picture by these settings; `None` if it was ended by the clock.
    ///
    /// # Errors
    /// As [`refine`]; [`Error::Interrupted`] if the user wants no more.
    pub fn shoot(&self, settings: &Settings) -> Result<Option<Shot>> {
        let flag = self.halt.flag();
        let rendering = refine(self.scene, settings, &Limits::default(), None, &self.watch, flag);
        self.finish(settings, rendering)
    }

    /// A picture from a map.
    ///
    /// # Errors
    /// As [`Bench::shoot`].
    pub fn shoot_shared(&self, settings: &Settings, photons: &SharedPhotons) -> Result<Option<Shot>> {
        let mut map = SharedMap::build(self.scene, settings, photons)?;
        let built = map.stats().clone();
        let (limits, flag) = (Limits::default(), self.halt.flag());
        let rendering = refine_shared(self.scene, settings, &mut map, &limits, None, &self.watch, flag);
        let mut shot = self.finish(settings, rendering)?;
        if let Some(shot) = &mut shot {
            shot.stats.merge(&built);
        }
        Ok(shot)
    }

    fn finish(&self, settings: &Settings, rendering: Result<Rendering>) -> Result<Option<Shot>> {
        self.halt.go_on()?;
        let rendering = match rendering {
            Err(Error::Interrupted) => return Ok(None),
            other => other?,
        };
        if rendering.end != End::Finished {
            return Ok(None);
        }
        let image = rendering.film.image();
        let layers = rendering.film.layers();
        let all_but = |left_out: &[Component]| {
            let mut sum = Image::new(image.width, image.height);
            for layer in &layers {
                let LayerData::Rgb(values) = &layer.channels else { continue };
                let mut counted = Component::ALL.iter().filter(|component| !left_out.contains(component));
                if counted.any(|component| component.name() == layer.name) {
                    let values = values.as_flattened().iter();
                    sum.pixels.as_flattened_mut().iter_mut().zip(values).for_each(|(sum, value)| *sum += value);
                }
            }
            sum
        };
        let (spread, sent) = (all_but(&[Component::Specular]), all_but(&[Component::Emission]));
        let direct = all_but(&[Component::Specular, Component::Emission]);
        let (stats, warnings) = (rendering.stats, rendering.warnings);
        Ok(Some(Shot { image, spread, sent, direct, seed: settings.render.seed, stats, warnings }))
    }

    /// Takes fewer samples for each picture, where as many take long: the more pictures, the surer is their spread.
    ///
    /// # Errors
    /// As [`Bench::shoot`].
    pub fn hurry(&mut self, seconds: f64) -> Result<()> {
        let mut settings = self.settings.clone();
        (settings.render.method, settings.render.samples) = (Method::Path, 1);
        self.halt.allow(seconds);
        let start = seconds_of_threads();
        let shot = self.shoot(&settings)?;
        if shot.is_none() || f64::from(SAMPLES) * SEVERAL * (seconds_of_threads() - start) > seconds {
            self.settings.render.samples = 1;
        }
        Ok(())
    }

    /// Pictures by a method, of as many seeds as `most`, or as `seconds` allow; `None` if these are too few.
    ///
    /// # Errors
    /// As [`Bench::shoot`].
    pub fn series(&self, method: Method, seconds: f64, most: usize) -> Result<Option<Series>> {
        let start = seconds_of_threads();
        let mut series = Series::default();
        self.halt.allow(seconds);
        for index in 0..most {
            let mut settings = self.settings.clone();
            settings.render.method = method;
            settings.render.seed = self.seed(index);
            let Some(shot) = self.shoot(&settings)? else { break };
            series.shots.push(shot);
            let done = seconds_of_threads() - start;
            if done * (index as f64 + 2.0) / (index as f64 + 1.0) > seconds {
                break;
            }
        }
        Ok((series.shots.len() >= FEWEST.min(most)).then_some(series))
    }
}

/// A film of as much of the scene, with few pixels, and all its layers.
fn small(film: &Film) -> Film {
    let (width, height) = film.size();
    let scale = (PIXELS / (f64::from(width) * f64::from(height))).sqrt().min(1.0);
    // Whole blocks, where there are several.
    let whole = |pixels: u32| {
        let pixels = f64::from(pixels) * scale;
        let block = BLOCK as f64;
        if pixels < 1.5 * block { pixels.ceil() } else { (pixels / block).round() * block }
    };
    let ([across, down], own) = ([whole(width), whole(height)], film.window());
    let (x, y) = (across / f64::from(width), down / f64::from(height));
    let mut small = Film { layers: true, standard_error: false, ..film.clone() };
    if scale >= 1.0 {
        return small;
    }
    (small.width, small.height) =
        ((f64::from(film.width) * x).round().max(across) as u32, (f64::from(film.height) * y).round().max(down) as u32);
    small.crop = film.crop.map(|_| {
        let place = |from: u32, scale: f64, size: f64, all: u32| {
            ((f64::from(from) * scale).round() as u32).min(all.saturating_sub(size as u32))
        };
        Window {
            x: place(own.x, x, across, small.width),
            y: place(own.y, y, down, small.height),
            width: across as u32,
            height: down as u32,
        }
    });
    small
}
