//! Pictures of several seeds, as means over blocks of pixels.

use super::statistics::Mean;
use crate::image::Image;

/// Pixels along the edge of a block of a small picture.
pub const BLOCK: usize = 6;

/// What the pictures of one estimator hold in each block, and in the whole.
#[derive(Clone, Debug)]
pub struct Blocks {
    /// Pixels along the edge of a block.
    pub block: usize,
    /// Blocks across.
    pub columns: usize,
    width: usize,
    height: usize,
    /// By seed, of all blocks, and in the end of the whole picture.
    values: Vec<Vec<[f64; 3]>>,
}

impl Blocks {
    /// Of pictures of one size, in blocks of `block` × `block` pixels.
    pub fn of<'i>(images: impl IntoIterator<Item = &'i Image>, block: usize) -> Blocks {
        let mut blocks = Blocks { block, columns: 0, width: 0, height: 0, values: Vec::new() };
        for image in images {
            let means = image.block_means(block);
            (blocks.columns, blocks.width, blocks.height) = (means.width, image.width, image.height);
            let whole = image.channel_means();
            let each = means.pixels.iter().map(|pixel| pixel.map(f64::from));
            blocks.values.push(each.chain([whole]).collect());
        }
        blocks
    }

    /// How many there are, the whole picture included, which is the last.
    pub fn count(&self) -> usize {
        self.values.first().map_or(0, Vec::len)
    }

    /// How many seeds.
    pub fn seeds(&self) -> usize {
        self.values.len()
    }

    /// The pictures of some of the seeds.
    pub fn some(&self, of: impl Fn(usize) -> bool) -> Blocks {
        let values = self.values.iter().enumerate().filter(|(seed, _)| of(*seed)).map(|(_, values)| values.clone());
        Blocks { values: values.collect(), ..*self }
    }

    /// A channel of a block over the seeds.
    pub fn mean(&self, block: usize, channel: usize) -> Mean {
        Mean::of(self.values.iter().map(|values| values[block][channel]))
    }

    /// The sum of a block's channels over the seeds.
    pub fn grey(&self, block: usize) -> Mean {
        Mean::of(self.values.iter().map(|values| values[block].iter().sum()))
    }

    /// The mean over pixels and channels.
    pub fn level(&self) -> f64 {
        self.grey(self.count().saturating_sub(1)).value / 3.0
    }

    /// By how much one picture's blocks are off: the root of the mean square over blocks, of the mean of channels.
    pub fn noise(&self) -> f64 {
        let last = self.count().saturating_sub(1);
        let square = |block| {
            let Mean { variance, count, .. } = self.grey(block);
            variance * count
        };
        ((0..last).map(square).sum::<f64>() / last.max(1) as f64).sqrt() / 3.0
    }

    /// This less others, seed by seed.
    pub fn less(&self, others: &Blocks) -> Blocks {
        let less = |(a, b): (&[f64; 3], &[f64; 3])| [0, 1, 2].map(|c| a[c] - b[c]);
        let pairs = self.values.iter().zip(&others.values);
        Blocks { values: pairs.map(|(a, b)| a.iter().zip(b).map(less).collect()).collect(), ..*self }
    }

    /// Where a block is, in pixels.
    pub fn place(&self, block: usize) -> String {
        if block + 1 == self.count() {
            return "the whole picture".to_string();
        }
        let (x, y) = (block % self.columns * self.block, block / self.columns * self.block);
        let (right, bottom) = ((x + self.block).min(self.width), (y + self.block).min(self.height));
        format!("pixels {x}..{} × {y}..{}", right - 1, bottom - 1)
    }
}
