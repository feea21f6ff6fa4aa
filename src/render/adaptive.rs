//! Adaptive sampling (Jensen 2001, §3.1.1): pixels take more samples where there is noise, and fewer elsewhere.
//!
//! A pass first takes a few samples of every pixel alike. Those of half of the pixels, as on a chessboard, then tell how many more the other half takes, so
//! that no sample has a say in how many there are beside it: a pixel's mean stays unbiased, which it would not if fewer were taken where the first ones
//! happened to be dark (Kirk and Arvo 1991, *Unbiased sampling techniques for image synthesis*).

use super::tile::{BUNDLE, TILE};
use crate::math::Stream;
use crate::math::random::Purpose;

/// Passes of fewer samples a pixel have nothing to spare.
const FEWEST: u32 = 4;
/// Each half takes one in so many samples, and so many at most.
const HALF: (u32, u32) = (5, 8);
/// What pixels take of the rest whatever was found, which may have missed what is small and bright.
const EVEN: f64 = 0.3;
/// The most samples a pixel takes by its noise, for each that it would take if that were the same everywhere.
const MOST: f64 = 16.0;
/// Tiles that tell what the whole picture is like: all of a small one, one in so many of a large one.
const SOUNDED: (u32, u32) = (64, 8);

/// The samples that tell where noise is: after the first, which tells how bright the picture is, two halves that differ by noise.
#[derive(Clone, Copy, Debug)]
pub struct Sounding {
    half: u32,
    samples: u32,
}

impl Sounding {
    /// Of a pass that takes so many samples of a pixel, if it is worth while.
    pub fn new(samples: u32) -> Option<Sounding> {
        (samples >= FEWEST).then(|| Sounding { half: (samples / HALF.0).clamp(1, HALF.1), samples })
    }

    /// The samples of the first half.
    pub fn half(&self) -> u32 {
        self.half
    }

    /// All samples that each pixel has taken in the end.
    pub fn taken(&self) -> u32 {
        1 + 2 * self.half
    }
}

/// Sums over the pixels of a bundle, by the colour that they have on a chessboard.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Found {
    pixels: [u32; 2],
    sums: [f64; 2],
    work: [f64; 2],
}

impl Found {
    /// Adds what was found in a pixel, for so much work.
    pub fn add(&mut self, (x, y): (u32, u32), value: f64, work: u64) {
        let colour = colour(x, y);
        self.pixels[colour] += 1;
        self.sums[colour] += value;
        self.work[colour] += work as f64;
    }

    /// The standard deviation that the pixels of a colour found, and the work of one; `None` where there are none.
    fn told(&self, colour: usize) -> Option<(f64, f64)> {
        let pixels = f64::from(self.pixels[colour]);
        (pixels > 0.0).then(|| ((self.sums[colour] / pixels).sqrt(), self.work[colour] / pixels))
    }
}

pub(super) fn colour(x: u32, y: u32) -> usize {
    ((x ^ y) & 1) as usize
}

/// Whether a tile is one of those that tell what a picture of so many is like.
pub(super) fn is_sounded(tile: u32, tiles: u32) -> bool {
    tile.is_multiple_of((tiles / SOUNDED.0).clamp(1, SOUNDED.1))
}

/// What the bundles of the picture have found, row by row of whole tiles.
pub(super) struct Survey {
    columns: u32,
    tiles: (u32, u32),
    found: Vec<Found>,
}

impl Survey {
    /// Of a picture of so many tiles across and down.
    pub fn new(tiles: (u32, u32)) -> Survey {
        let across = TILE / BUNDLE;
        let columns = tiles.0 * across;
        Survey { columns, tiles, found: vec![Found::default(); columns as usize * (tiles.1 * across) as usize] }
    }

    /// Takes what was found in a bundle's pixels, one of which is this.
    pub fn set(&mut self, (x, y): (u32, u32), found: Found) {
        self.found[(y / BUNDLE * self.columns + x / BUNDLE) as usize] = found;
    }

    /// The bundles of the tiles that tell of the picture.
    fn sounded(&self) -> impl Iterator<Item = (usize, &Found)> {
        let across = TILE / BUNDLE;
        self.found.iter().enumerate().filter(move |(number, _)| {
            let (x, y) = (*number as u32 % self.columns, *number as u32 / self.columns);
            is_sounded(y / across * self.tiles.0 + x / across, self.tiles.0 * self.tiles.1)
        })
    }

    /// The mean over the picture, by the pixels of each colour.
    pub fn levels(&self) -> [f64; 2] {
        [0, 1].map(|colour| {
            let (sum, pixels) = self.sounded().fold((0.0, 0), |(sum, pixels), (_, found)| {
                (sum + found.sums[colour], pixels + u64::from(found.pixels[colour]))
            });
            sum / pixels.max(1) as f64
        })
    }
}

/// How many samples each pixel takes.
pub(super) struct Allotment {
    columns: u32,
    counts: Vec<[u32; 2]>,
    /// The most that any takes.
    pub most: u32,
}

impl Allotment {
    /// By the [noise](noise) that the first samples of a pass told, for as much work as the same number for all would be: each pixel in proportion to σ/√w, with
    /// the deviation σ and the work w of a sample around it, for that leaves the least error.
    pub fn new(survey: &Survey, sounding: Sounding, (seed, pass): (u64, u32)) -> Allotment {
        let more = f64::from(sounding.samples - sounding.taken());
        let share = |found: &Found, colour: usize| {
            found
                .told(1 - colour)
                .filter(|(deviation, _)| *deviation > 0.0)
                .map_or(0.0, |(deviation, work)| deviation / work.sqrt())
        };
        let scales = [0, 1].map(|colour| {
            let shares = survey.sounded().map(|(_, found)| {
                let work = found.told(1 - colour).map_or(0.0, |(_, work)| work);
                (share(found, colour), work * f64::from(found.pixels[colour]))
            });
            scale(&shares.collect::<Vec<_>>())
        });
        let mut most = 0;
        let counts = survey.found.iter().enumerate().map(|(number, found)| {
            [0, 1].map(|colour| {
                let by_noise = scales[colour].map_or(1.0, |scale| (scale * share(found, colour)).min(MOST));
                let place = 2 * number as u64 + colour as u64;
                let rest = Stream::new(seed, Purpose::Adaptive, place, u64::from(pass)).uniform();
                let share = EVEN + (1.0 - EVEN) * by_noise;
                let count = sounding.taken().saturating_add((more * share + rest) as u32);
                if found.pixels[colour] > 0 {
                    most = most.max(count);
                }
                count
            })
        });
        let counts = counts.collect();
        Allotment { columns: survey.columns, counts, most }
    }

    /// The share of all samples that come before this one.
    pub fn share(&self, sample: u32) -> f64 {
        let before = |end: u32| self.counts.iter().flatten().map(|count| u64::from(end.min(*count))).sum::<u64>();
        before(sample) as f64 / before(self.most).max(1) as f64
    }

    /// The samples of a pixel.
    pub fn count(&self, (x, y): (u32, u32)) -> u32 {
        self.counts[(y / BUNDLE * self.columns + x / BUNDLE) as usize][colour(x, y)]
    }
}

/// What shares, each for so much work, are multiplied by for their mean to be 1, where none counts for more than the most; `None` where there are none.
fn scale(shares: &[(f64, f64)]) -> Option<f64> {
    let all: f64 = shares.iter().map(|(_, work)| work).sum();
    let largest = shares.iter().map(|(share, _)| *share).fold(0.0, f64::max);
    let mean = |scale: f64| shares.iter().map(|(share, work)| (scale * share).min(MOST) * work).sum::<f64>() / all;
    let uncut = shares.iter().map(|(share, work)| share * work).sum::<f64>() / all;
    if uncut.is_nan() || uncut <= 0.0 {
        return None;
    }
    // The mean grows with the scale, up to where the smallest is cut.
    let least = shares.iter().map(|(share, _)| *share).filter(|share| *share > 0.0).fold(largest, f64::min);
    let (mut low, mut high) = (1.0 / uncut, (MOST / least).max(1.0 / uncut));
    for _ in 0..50 {
        let middle = (low * high).sqrt();
        if mean(middle) < 1.0 {
            low = middle;
        } else {
            high = middle;
        }
    }
    Some(low)
}

/// The variance of a pixel whose two halves found these means, relative to what it and its picture show: the square of half of their difference over I² + 0.01 M², the
/// mean of the channels.
pub(super) fn noise([a, b]: [[f64; 3]; 2], level: f64) -> f64 {
    let channel = |c: usize| {
        let (mean, difference) = (0.5 * (a[c] + b[c]), 0.5 * (a[c] - b[c]));
        let over = mean * mean + 0.01 * level * level;
        if over > 0.0 { difference * difference / over } else { 0.0 }
    };
    (0..3).map(channel).sum::<f64>() / 3.0
}

#[cfg(test)]
mod tests {
    use super::*;

    const TILES: (u32, u32) = (9, 7);
    const SAMPLES: u32 = 16;

    /// A picture whose bundles differ in noise by factors of some hundred, and in work by some ten; those of it that say so are noisier by `louder`, in
    /// the pixels of one colour.
    fn survey(louder: impl Fn(u32, u32) -> f64) -> Survey {
        let mut survey = Survey::new(TILES);
        let mut stream = Stream::new(1, Purpose::Test, 0, 0);
        for y in (0..TILES.1 * TILE).step_by(BUNDLE as usize) {
            for x in (0..TILES.0 * TILE).step_by(BUNDLE as usize) {
                let (noise, work) = (100.0_f64.powf(stream.uniform()), 1 + (10.0 * stream.uniform()) as u64);
                let mut found = Found::default();
                for (dx, dy) in (0..BUNDLE).flat_map(|dy| (0..BUNDLE).map(move |dx| (dx, dy))) {
                    let louder = if colour(x + dx, y + dy) == 0 { louder(x, y) } else { 1.0 };
                    found.add((x + dx, y + dy), louder * noise, work);
                }
                survey.set((x, y), found);
            }
        }
        survey
    }

    fn allotment(survey: &Survey) -> Allotment {
        Allotment::new(survey, Sounding::new(SAMPLES).unwrap(), (1, 0))
    }

    /// What pixels find changes how many samples those of the other colour take, and no number of their own colour.
    #[test]
    fn no_sample_has_a_say_in_how_many_there_are_beside_it() {
        let quiet = allotment(&survey(|_, _| 1.0));
        let loud = allotment(&survey(|x, y| if x < 40 && y > 20 { 50.0 } else { 1.0 }));
        let pixels = (0..TILES.1 * TILE).flat_map(|y| (0..TILES.0 * TILE).map(move |x| (x, y)));
        let changed = [0, 1].map(|of| {
            pixels
                .clone()
                .filter(|(x, y)| colour(*x, *y) == of && quiet.count((*x, *y)) != loud.count((*x, *y)))
                .count()
        });
        assert_eq!(changed[0], 0);
        assert!(changed[1] > 2000, "{changed:?}");
    }

    /// All samples together are as much work as the same number for all pixels, and n ∝ σ/√w beyond what all pixels take.
    #[test]
    fn work_goes_where_the_noise_is() {
        let survey = survey(|_, _| 1.0);
        let allotment = allotment(&survey);
        let (mut work, mut even) = (0.0, 0.0);
        let mut ratios = Vec::new();
        for (number, found) in survey.found.iter().enumerate() {
            let corner = (number as u32 % survey.columns * BUNDLE, number as u32 / survey.columns * BUNDLE);
            let (deviation, each) = found.told(0).unwrap();
            let counts = [corner, (corner.0 + 1, corner.1)].map(|pixel| f64::from(allotment.count(pixel)));
            work += each * (counts[0] + counts[1]);
            even += each * f64::from(2 * SAMPLES);
            // 7 are for all, and a part of the other 9.
            ratios.push((counts[0] - 7.0 - EVEN * 9.0) / (deviation / each.sqrt()));
        }
        assert!((work / even - 1.0).abs() < 0.02, "{work} instead of {even}");
        let mean = ratios.iter().sum::<f64>() / ratios.len() as f64;
        let spread = ratios.iter().map(|ratio| (ratio / mean - 1.0).powi(2)).sum::<f64>() / ratios.len() as f64;
        assert!(spread < 0.02, "{spread} of {mean}");
    }

    /// Where nothing is noisy, or the picture is a pixel, all take the same number.
    #[test]
    fn without_noise_all_take_as_many() {
        for pixels in [1, 16] {
            let mut survey = Survey::new((1, 1));
            let mut found = Found::default();
            (0..pixels).for_each(|x| found.add((x, 0), 0.0, 3));
            survey.set((0, 0), found);
            let allotment = allotment(&survey);
            assert!((0..pixels).all(|x| allotment.count((x, 0)) == SAMPLES), "{pixels}");
        }
    }
}
