//! Where bricks are: from the coordinates of a brick to its values, or to the one value that a cube of bricks has.

use super::BrickGrid;
use super::values::Place;

/// An entry of the index: a brick, a node of the next level, or, with this bit, a constant.
pub(super) const CONSTANT: u32 = 1 << 31;
/// The background is the first of the constants.
pub(super) const BACKGROUND: u32 = CONSTANT;

/// The least and the greatest of some voxels.
#[derive(Clone, Copy, PartialEq)]
pub(super) struct Range {
    pub(super) min: f32,
    pub(super) max: f32,
}

impl Range {
    /// The range of no voxels at all.
    pub(super) const NONE: Range = Range { min: f32::INFINITY, max: f32::NEG_INFINITY };

    /// The range of the voxels of both.
    pub(super) fn union(self, other: Range) -> Range {
        Range { min: self.min.min(other.min), max: self.max.max(other.max) }
    }
}

/// Where bricks are. Coordinates count bricks.
#[derive(Clone)]
pub(super) enum Index {
    /// An array over a box of bricks, z fastest; background beyond.
    Dense {
        min: [i32; 3],
        size: [u32; 3],
        codes: Vec<u32>,
        /// The least and greatest value of each entry's voxels and apron.
        ranges: Vec<Range>,
    },
    /// A tree, for bricks far apart.
    Sparse(SparseIndex),
}

/// The levels of an OpenVDB tree.
#[derive(Clone, Default)]
pub(super) struct SparseIndex {
    /// Sorted by coordinates, which count cubes of 512³ bricks.
    pub(super) roots: Vec<([i32; 3], u32)>,
    /// Nodes of 32³ entries of 16³ bricks each.
    pub(super) upper: Vec<Box<[u32]>>,
    /// Nodes of 16³ entries of one brick each.
    pub(super) lower: Vec<Box<[u32]>>,
}

/// A brick or a cube of bricks on the way of a ray.
pub(super) struct Block {
    /// The lowest brick.
    pub(super) lo: [i32; 3],
    /// Beyond the highest brick.
    pub(super) hi: [i32; 3],
    pub(super) code: u32,
    pub(super) range: Range,
}

impl BrickGrid {
    /// The entry for a brick: the number of its values, or that of a constant.
    #[inline]
    pub(super) fn code(&self, brick: [i32; 3]) -> u32 {
        match &self.index {
            Index::Dense { min, size, codes, .. } => dense_entry(min, size, brick).map_or(BACKGROUND, |n| codes[n]),
            Index::Sparse(index) => index.find(brick).0,
        }
    }

    /// The brick, or the cube of equal bricks, around `brick`.
    #[inline]
    pub(super) fn block(&self, brick: [i32; 3]) -> Block {
        // A dense index knows each entry's range.
        let one = |code, range| Block { lo: brick, hi: brick.map(|x| x + 1), code, range };
        let index = match &self.index {
            Index::Dense { min, size, codes, ranges } => {
                return match dense_entry(min, size, brick) {
                    Some(n) => one(codes[n], ranges[n]),
                    None => one(BACKGROUND, Range { min: self.background, max: self.background }),
                };
            }
            Index::Sparse(index) => index,
        };
        // Of a tree's cube of one value, as much as is one block.
        let (code, log2) = index.find(brick);
        if code & CONSTANT != 0 && log2 > 0 {
            // The uppermost layers of a cube have their apron in other cubes. Below them the cube is all
            // one; in them it is, layer by layer, if those others are as large and of the same value.
            let lo = brick.map(|x| x >> log2 << log2);
            let top = lo.map(|x| x + (1 << log2) - 1);
            let crosses: [bool; 3] = std::array::from_fn(|axis| brick[axis] == top[axis]);
            let same = (1..8).all(|n| {
                let step: [i32; 3] = std::array::from_fn(|axis| n >> (2 - axis) & 1);
                (0..3).any(|axis| step[axis] == 1 && !crosses[axis]) || {
                    let (other, size) = index.find(std::array::from_fn(|axis| brick[axis] + step[axis]));
                    other == code && size >= log2
                }
            });
            if same {
                return Block {
                    lo: std::array::from_fn(|axis| if crosses[axis] { brick[axis] } else { lo[axis] }),
                    hi: std::array::from_fn(|axis| top[axis] + crosses[axis] as i32),
                    code,
                    range: self.own_range(code),
                };
            }
        }
        // Otherwise one brick, whose range spans its apron.
        let range =
            self.codes_near(brick).into_iter().fold(Range::NONE, |range, code| range.union(self.own_range(code)));
        one(code, range)
    }

    /// The entries of a brick and its upper neighbours, z fastest.
    #[inline]
    pub(super) fn codes_near(&self, brick: [i32; 3]) -> [u32; 8] {
        match &self.index {
            Index::Dense { min, size, codes, .. } => {
                // A step beyond a row's end leads to another's first entry: both layers are background.
                let Some(n) = dense_entry(min, size, brick) else { return [BACKGROUND; 8] };
                let (y, x) = (size[2] as usize, size[1] as usize * size[2] as usize);
                [0, 1, y, y + 1, x, x + 1, x + y, x + y + 1]
                    .map(|step| codes.get(n + step).map_or(BACKGROUND, |code| *code))
            }
            Index::Sparse(index) => std::array::from_fn(|n| {
                let step = [n >> 2 & 1, n >> 1 & 1, n & 1];
                index.find(std::array::from_fn(|axis| brick[axis] + step[axis] as i32)).0
            }),
        }
    }

    /// Where an entry's values are, and which bits of an offset count there.
    #[inline]
    pub(super) fn place(&self, code: u32) -> Place {
        if code & CONSTANT != 0 {
            (512 * self.own_ranges.len() + (code & !CONSTANT) as usize, 0)
        } else {
            (512 * code as usize, 511)
        }
    }

    /// The value that a constant entry stands for.
    #[inline]
    pub(super) fn constant(&self, code: u32) -> f32 {
        self.values.at(self.place(code), 0)
    }

    /// The greatest of the 8³ voxels of a brick; coordinates count bricks.
    pub fn brick_max(&self, brick: [i32; 3]) -> f32 {
        self.own_range(self.code(brick)).max
    }

    /// The range of an entry without its apron.
    pub(super) fn own_range(&self, code: u32) -> Range {
        if code & CONSTANT == 0 {
            return self.own_ranges[code as usize];
        }
        let value = self.constant(code);
        Range { min: value, max: value }
    }
}

impl SparseIndex {
    /// The entry for a brick, and the size of the cube it stands for in bricks, as a power of two.
    pub(super) fn find(&self, brick: [i32; 3]) -> (u32, u32) {
        let root = brick.map(|x| x >> 9);
        let Ok(found) = self.roots.binary_search_by_key(&root, |root| root.0) else { return (BACKGROUND, 9) };
        let code = self.roots[found].1;
        if code & CONSTANT != 0 {
            return (code, 9);
        }
        let code = self.upper[code as usize][upper_offset(brick)];
        if code & CONSTANT != 0 {
            return (code, 4);
        }
        (self.lower[code as usize][lower_offset(brick)], 0)
    }
}

/// Where a dense index that begins at `min` keeps a brick; `None` outside.
#[inline]
pub(super) fn dense_entry(min: &[i32; 3], size: &[u32; 3], brick: [i32; 3]) -> Option<usize> {
    let at: [u32; 3] = std::array::from_fn(|axis| brick[axis].wrapping_sub(min[axis]) as u32);
    (at[0] < size[0] && at[1] < size[1] && at[2] < size[2])
        .then(|| (at[0] as usize * size[1] as usize + at[1] as usize) * size[2] as usize + at[2] as usize)
}

/// Where a node of the tree's upper level keeps a brick.
pub(super) fn upper_offset(brick: [i32; 3]) -> usize {
    brick.iter().fold(0, |n, x| n << 5 | (x >> 4 & 31) as usize)
}

/// Where a node of the tree's lower level keeps a brick.
pub(super) fn lower_offset(brick: [i32; 3]) -> usize {
    brick.iter().fold(0, |n, x| n << 4 | (x & 15) as usize)
}
