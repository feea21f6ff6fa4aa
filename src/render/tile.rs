//! Samples through the pixels of a tile.

use std::ops::Range;

use rayon::prelude::*;

use super::eye::{Claim, Context, Eye, Mode};
use super::film::Sums;
use super::pass::{Progress, Renderer};
use crate::gather::{GatherStats, Queue};
use crate::math::Stream;
use crate::transport::Tally;

/// Pixels along the edge of a tile, the work of one task.
const TILE: u32 = 16;

/// Pixels along the edge of a bundle: its camera rays gather photons together.
const BUNDLE: u32 = 8;

/// Samples a pixel takes before its neighbours' turn, at most.
const ROUND: u32 = 16;

/// Sums of a tile's pixels, and what they cost.
struct Tile {
    sums: Vec<(u32, u32, Sums)>,
    gathered: GatherStats,
    tally: Tally,
}

impl<P: Progress> Renderer<'_, P> {
    /// Samples all pixels, in rounds, the first of them short, so that an interrupted image is whole.
    pub(super) fn expose(&mut self, mode: Mode<'_>, pass: u32) {
        let (width, height) = (self.scene.film.width, self.scene.film.height);
        let tiles = width.div_ceil(TILE) * height.div_ceil(TILE);
        self.progress.phase("render", tiles as u64 * self.plan.samples as u64);
        let eye = Eye::new(self.scene, mode);
        let mut from = 0;
        while from < self.plan.samples && !self.stopped() {
            let round = if pass == 0 { self.progress.round(from).clamp(1, ROUND) } else { ROUND };
            let to = self.plan.samples.min(from.saturating_add(round));
            let done: Vec<Option<Tile>> = (0..tiles)
                .into_par_iter()
                .map_init(Queue::default, |queue, tile| {
                    (!self.stopped()).then(|| self.tile(&eye, tile, pass, from..to, queue))
                })
                .collect();
            for tile in done.into_iter().flatten() {
                tile.sums.iter().for_each(|(x, y, sum)| self.film.add(*x, *y, sum));
                self.stats.gather += tile.gathered;
                self.stats.tally = self.stats.tally.merge(tile.tally);
            }
            from = to;
            self.end_round();
        }
    }

    /// These samples of the pixels of a tile.
    fn tile(&self, eye: &Eye<'_>, tile: u32, pass: u32, samples: Range<u32>, queue: &mut Queue<Claim>) -> Tile {
        let (width, height) = (self.scene.film.width, self.scene.film.height);
        let columns = width.div_ceil(TILE);
        let (x0, y0) = (tile % columns * TILE, tile / columns * TILE);
        let mut done = Tile { sums: Vec::new(), gathered: GatherStats::default(), tally: Tally::default() };
        for part in 0..(TILE / BUNDLE).pow(2) {
            let (x0, y0) = (x0 + part % (TILE / BUNDLE) * BUNDLE, y0 + part / (TILE / BUNDLE) * BUNDLE);
            for index in 0..BUNDLE * BUNDLE {
                let (x, y) = (x0 + every_second_bit(index), y0 + every_second_bit(index >> 1));
                if x < width && y < height && !self.stopped() {
                    self.pixel(eye, (x, y), pass, samples.clone(), queue, &mut done);
                }
            }
            if let Mode::Gather(maps) = eye.mode() {
                maps.gather_bundles(queue);
            }
        }
        if let Mode::Gather(maps) = eye.mode() {
            maps.gather_streams(queue);
            for (claim, gathered) in queue.done.drain(..) {
                for (component, radiance) in claim.settle(&gathered, &mut done.tally) {
                    done.sums[claim.pixel as usize].2.add_to(component, radiance);
                }
            }
        }
        done.gathered = std::mem::take(&mut queue.stats);
        self.progress.advance(samples.len() as u64);
        done
    }

    fn pixel(
        &self,
        eye: &Eye<'_>,
        (x, y): (u32, u32),
        pass: u32,
        samples: Range<u32>,
        queue: &mut Queue<Claim>,
        done: &mut Tile,
    ) {
        let Renderer { scene, camera, plan, .. } = self;
        let pixel = y as u64 * scene.film.width as u64 + x as u64;
        let mut sum = Sums::default();
        for sample in samples {
            let number = pass as u64 * plan.samples as u64 + sample as u64;
            let mut stream = Stream::of_sample(scene.render.seed, pixel, number, (pass, sample));
            let ray = camera.ray(x, y, &mut stream);
            let inside = plan.inside.clone().unwrap_or_else(|| scene.inside(ray.origin));
            let index = done.sums.len() as u32;
            let mut context = Context { stream: &mut stream, queue, pixel: index, tally: &mut done.tally };
            sum.add(&eye.look(ray, inside, &mut context));
        }
        done.sums.push((x, y, sum));
    }
}

/// The number made of bits 0, 2 and 4: one coordinate of a Morton code.
fn every_second_bit(code: u32) -> u32 {
    code & 1 | code >> 1 & 2 | code >> 2 & 4
}
