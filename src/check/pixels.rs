//! Pixels that no light explains: not finite, negative, or lit by a single sample.

use super::bench::{Bench, Series, Shot};
use super::judge::percent;
use super::report::{Outcome, Row};
use crate::Result;
use crate::image::Image;
use crate::render::Replayer;
use crate::scene::description::Method;

/// A pixel of one picture that holds more than this share of its block's light, of all pictures together,
const SHARE: f64 = 0.1;
/// and is brighter than its surroundings in the other pictures by this factor, is a firefly.
const BRIGHTER: f64 = 50.0;
/// Pixels along the edge of the part of the picture that counts as its block.
const PART: usize = 6;
/// Fireflies that hold more than this share of all light spoil a picture.
const SPOILT: f64 = 0.01;

/// Who looks for pixels.
pub struct Pixels<'b, 'a> {
    /// What made the pictures.
    pub bench: &'b Bench<'a>,
    /// How a path is told: the command up to its seed.
    pub command: String,
}

/// A pixel of a picture.
struct Place {
    x: usize,
    y: usize,
    seed: u64,
}

impl Pixels<'_, '_> {
    /// Whether all pixels of all pictures are finite and not negative, and no sample was dropped or cut off.
    ///
    /// # Errors
    /// As [`Replayer::new`].
    pub fn sound(&self, all: &[(&str, &Series)]) -> Result<Row> {
        const TEST: &str = "pixels are finite and not negative";
        let shots = || all.iter().flat_map(|(name, series)| series.shots.iter().map(move |shot| (*name, shot)));
        let count: usize = shots().map(|(_, shot)| shot.image.pixels.len()).sum();
        if count == 0 {
            return Ok(Row::not_applicable(TEST, "there was no time for a picture: allow more --time"));
        }
        for (name, shot) in shots() {
            let bad = shot.image.pixels.iter().position(|pixel| !pixel.iter().all(|v| v.is_finite() && *v >= 0.0));
            if let Some(at) = bad {
                let place = Place { x: at % shot.image.width, y: at / shot.image.width, seed: shot.seed };
                let found = format!(
                    "{name}: pixel {},{} of seed {} is {:?}",
                    place.x, place.y, place.seed, shot.image.pixels[at]
                );
                let command = (name == Method::Path.name()).then(|| self.replay(&place, 0));
                return Ok(Row { command, ..Row::new(TEST, Outcome::Fail, found) });
            }
            let tally = shot.stats.tally;
            for (mishaps, what) in [
                (tally.broken, "samples or photons were dropped, as a number was not finite or too large"),
                (tally.violations, "look-ups exceeded their majorant"),
                (tally.stopped, "walks were cut off"),
            ] {
                if mishaps > 0 {
                    let found = format!("{name}: {mishaps} {what} (seed {})", shot.seed);
                    let culprit =
                        if name == Method::Path.name() && tally.broken > 0 { self.broken(shot)? } else { None };
                    let command = culprit.map(|(place, sample)| self.replay(&place, sample));
                    return Ok(Row { command, ..Row::new(TEST, Outcome::Fail, found).with(mishaps as f64) });
                }
            }
        }
        let pictures = shots().count();
        Ok(Row::new(TEST, Outcome::Pass, format!("{count} pixels of {pictures} pictures are")).with(0.0))
    }

    /// Pixels that a single sample lights. `own`: whether these are pictures as the scene itself asks for.
    ///
    /// # Errors
    /// As [`Replayer::new`].
    pub fn fireflies(&self, name: &str, series: &Series, own: bool) -> Result<Row> {
        let test = test_of(name);
        let Some(first) = series.shots.first() else { return Ok(Row::not_applicable(test, "there are no pictures")) };
        let found = Fireflies::of(series, |shot| &shot.image);
        let share = found.light / found.total.max(f64::MIN_POSITIVE);
        let Some((value, place)) = found.brightest else {
            return Ok(Row::new(test, Outcome::Pass, "none").with(0.0));
        };
        let mut command = None;
        if name == Method::Path.name() {
            let sample = self.brightest(&place)?;
            command = Some(self.replay(&place, sample));
        }
        // What camera rays meet of lamps in mirrors and through glass is no photons' doing.
        let are_glints = || {
            let directly = Fireflies::of(series, |shot| &shot.spread);
            name != Method::Path.name() && directly.light <= SPOILT * found.total
        };
        let mut text = format!(
            "{} pixels of {} hold {} of the light; the brightest is {},{} of seed {}: {:.3e}",
            found.count,
            series.shots.len() * first.image.pixels.len(),
            percent(share),
            place.x,
            place.y,
            place.seed,
            value / 3.0
        );
        let outcome = match (share > SPOILT, own) {
            (true, true) if are_glints() => {
                text += "; these are glints in mirrors and glass, of which few samples tell";
                Outcome::NotApplicable
            }
            (true, true) => Outcome::Fail,
            (true, false) => Outcome::NotApplicable,
            (false, _) => Outcome::Pass,
        };
        Ok(Row { command, ..Row::new(test, outcome, text).with(share) })
    }

    /// The command that tells of a path.
    fn replay(&self, place: &Place, sample: u64) -> String {
        format!("{} --seed {} --replay {},{},{sample}", self.command, place.seed, place.x, place.y)
    }

    fn replayer(&self, seed: u64) -> Result<Replayer<'_>> {
        let mut settings = self.bench.settings.clone();
        (settings.render.method, settings.render.seed) = (Method::Path, seed);
        Replayer::new(self.bench.scene, &settings)
    }

    /// The brightest sample of a pixel of paths.
    fn brightest(&self, place: &Place) -> Result<u64> {
        let replayer = self.replayer(place.seed)?;
        let mut brightest = (0.0, 0);
        for sample in 0..u64::from(self.bench.settings.render.samples) {
            let replayed = replayer.replay((place.x as u32, place.y as u32), sample)?;
            let radiance: f64 = replayed.sample.radiance.iter().map(|part| part.element_sum()).sum();
            if radiance > brightest.0 {
                brightest = (radiance, sample);
            }
        }
        Ok(brightest.1)
    }

    /// The first sample of paths that was dropped.
    fn broken(&self, shot: &Shot) -> Result<Option<(Place, u64)>> {
        let replayer = self.replayer(shot.seed)?;
        for at in 0..shot.image.pixels.len() {
            let (x, y) = (at % shot.image.width, at / shot.image.width);
            for sample in 0..u64::from(self.bench.settings.render.samples) {
                if self.bench.halt.is_over() {
                    return Ok(None);
                }
                if replayer.replay((x as u32, y as u32), sample)?.tally.broken > 0 {
                    return Ok(Some((Place { x, y, seed: shot.seed }, sample)));
                }
            }
        }
        Ok(None)
    }
}

fn test_of(name: &str) -> String {
    format!("fireflies: {name}")
}

/// Whether a row says that fireflies spoil the pictures of this name.
pub fn is_spoilt(row: &Row, name: &str) -> bool {
    row.test == test_of(name) && row.number.is_some_and(|share| share > SPOILT)
}

/// Pixels that a single sample lights.
struct Fireflies {
    /// How many there are, in all pictures together.
    count: u64,
    /// Their light, and that of all pixels, all channels together.
    light: f64,
    total: f64,
    /// The brightest of them, and its light.
    brightest: Option<(f64, Place)>,
}

impl Fireflies {
    /// Those of some part of all pictures.
    fn of(series: &Series, part: impl Fn(&Shot) -> &Image) -> Fireflies {
        let images: Vec<&Image> = series.shots.iter().map(part).collect();
        let mut found = Fireflies { count: 0, light: 0.0, total: 0.0, brightest: None };
        let [first, ..] = images[..] else { return found };
        let (width, height) = (first.width, first.height);
        let grey = |image: &Image, x: usize, y: usize| image.get(x, y).iter().map(|v| f64::from(*v)).sum::<f64>();
        // Sums over all pictures.
        let mut sums = vec![0.0; width * height];
        for image in &images {
            sums.iter_mut().enumerate().for_each(|(at, sum)| *sum += grey(image, at % width, at / width));
        }
        found.total = sums.iter().sum();
        // What is darker than the picture is no firefly.
        let usual_light = (found.total / (images.len() * width * height) as f64).max(f64::MIN_POSITIVE);
        let part = |x: usize, y: usize, size: usize| {
            let (x0, y0) = (x / size * size, y / size * size);
            let (x1, y1) = ((x0 + size).min(width), (y0 + size).min(height));
            (y0..y1).flat_map(|y| (x0..x1).map(move |x| y * width + x)).map(|at| sums[at]).sum::<f64>()
        };
        for (image, shot) in images.iter().zip(&series.shots) {
            for y in 0..height {
                for x in 0..width {
                    let value = grey(image, x, y);
                    if value < usual_light || value < SHARE * part(x, y, PART) {
                        continue;
                    }
                    let (xs, ys) = (x.saturating_sub(1)..(x + 2).min(width), y.saturating_sub(1)..(y + 2).min(height));
                    let near = xs.len() * ys.len();
                    let around: f64 = ys
                        .flat_map(|v| xs.clone().map(move |u| (u, v)))
                        .map(|(u, v)| sums[v * width + u] - grey(image, u, v))
                        .sum();
                    let usual = around / (near * (images.len() - 1).max(1)) as f64;
                    if value > BRIGHTER * usual {
                        found.count += 1;
                        found.light += value;
                        if found.brightest.as_ref().is_none_or(|(most, _)| value > *most) {
                            found.brightest = Some((value, Place { x, y, seed: shot.seed }));
                        }
                    }
                }
            }
        }
        found
    }
}
