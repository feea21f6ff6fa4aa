//! Bricks from files, arrays and functions.

use std::collections::{BTreeSet, HashMap};

use super::index::{BACKGROUND, CONSTANT, Index, Range, SparseIndex, dense_entry, lower_offset, upper_offset};
use super::values::Values;
use super::{Active, BrickGrid, Interpolation, NegativePolicy};
use crate::error::{Error, Result};
use crate::medium::density::vdb;
use rayon::prelude::*;

/// Larger values are refused: interpolation would leave the range of `f32`.
const LARGEST: f32 = 1e30;

impl BrickGrid {
    /// The voxels of `grid`, to be interpolated trilinearly.
    ///
    /// Inactive voxels count with the value OpenVDB gives them: as stored, or the background.
    ///
    /// # Errors
    /// [`Error::Asset`] for a level set, for voxels that are not finite or (under
    /// [`NegativePolicy::Error`]) negative, with their count, and for voxels beyond ±2³⁰.
    pub fn from_vdb(grid: &vdb::Grid, negative: NegativePolicy) -> Result<BrickGrid> {
        let fail = |message: String| Error::asset(&grid.path, format!("grid {:?}: {message}", grid.name));
        if grid.class == vdb::GridClass::LevelSet {
            return Err(fail(
                "is a level set: its values are distances to a surface, not densities; convert it to a fog volume"
                    .into(),
            ));
        }
        let mut builder = Builder::new(grid.background, negative);
        for leaf in &grid.leaves {
            builder.add_leaf(leaf.origin, &leaf.active, &leaf.values);
        }
        for tile in grid.tiles() {
            builder.add_tile(&tile);
        }
        builder.finish().map_err(fail)
    }

    /// `values` in z, y, x order (x fastest) from voxel `origin` on, all active; `background` beyond.
    ///
    /// # Errors
    /// [`Error::Limit`] if `values` has another length than `dims` say, and as [`BrickGrid::from_vdb`] for values
    /// out of range.
    pub fn from_dense(
        origin: [i32; 3],
        dims: [usize; 3],
        values: &[f32],
        background: f32,
        negative: NegativePolicy,
    ) -> Result<BrickGrid> {
        let [nx, ny, nz] = dims;
        if nx.checked_mul(ny).and_then(|n| n.checked_mul(nz)) != Some(values.len()) {
            return Err(Error::Limit(format!("{} values for an array of {nx} x {ny} x {nz}", values.len())));
        }
        // What does not fit into the coordinates is refused before anything is made.
        let mut builder = Builder::new(background, negative);
        let end: [i64; 3] = std::array::from_fn(|axis| origin[axis] as i64 + dims[axis] as i64);
        if (0..3).any(|axis| out_of_reach(origin[axis] as i64, end[axis])) {
            return Err(Error::Limit(format!("an array of {nx} x {ny} x {nz} from {origin:?} is out of reach")));
        }
        // Every brick that the array touches, with the background around it.
        if !values.is_empty() {
            let bricks = |axis: usize| origin[axis] >> 3..=(end[axis] as i32 - 1) >> 3;
            let mut brick = [background; 512];
            for bx in bricks(0) {
                for by in bricks(1) {
                    for bz in bricks(2) {
                        let lowest = [8 * bx, 8 * by, 8 * bz];
                        let mut active = [0_u64; 8];
                        for (n, value) in brick.iter_mut().enumerate() {
                            let local = [n >> 6, n >> 3 & 7, n & 7];
                            let at: [usize; 3] = std::array::from_fn(|axis| {
                                (lowest[axis] + local[axis] as i32).wrapping_sub(origin[axis]) as u32 as usize
                            });
                            let inside = at[0] < nx && at[1] < ny && at[2] < nz;
                            *value = if inside { values[(at[2] * ny + at[1]) * nx + at[0]] } else { background };
                            active[n >> 6] |= (inside as u64) << (n & 63);
                        }
                        builder.add_leaf(lowest, &active, &brick);
                    }
                }
            }
        }
        builder.finish().map_err(Error::Limit)
    }

    /// The voxels of these bricks, none of which is named twice, from a function of the voxel; 0 beyond.
    ///
    /// # Errors
    /// As [`BrickGrid::from_dense`] for values out of range.
    pub fn from_function(bricks: &[[i32; 3]], value: impl Fn([i32; 3]) -> f32 + Sync) -> Result<BrickGrid> {
        // Values of so many bricks wait to be indexed.
        const AT_ONCE: usize = 1 << 12;
        let mut builder = Builder::new(0.0, NegativePolicy::Error);
        for batch in bricks.chunks(AT_ONCE) {
            let fill = |brick: &[i32; 3]| -> [f32; 512] {
                std::array::from_fn(|n| {
                    let local = [n >> 6, n >> 3 & 7, n & 7];
                    value(std::array::from_fn(|axis| 8 * brick[axis] + local[axis] as i32))
                })
            };
            let filled: Vec<[f32; 512]> = batch.par_iter().map(fill).collect();
            for (brick, values) in batch.iter().zip(&filled) {
                builder.add_leaf(brick.map(|x| 8 * x), &[u64::MAX; 8], values);
            }
        }
        builder.finish().map_err(Error::Limit)
    }

    /// Voxels that are a function of those of several grids, each given with its bricks, at the same place of index space.
    ///
    /// # Errors
    /// As [`BrickGrid::from_vdb`] for values out of range.
    pub fn from_grids(parts: &[(vdb::Grid, BrickGrid)], mut value: impl FnMut(&[f32]) -> f32) -> Result<BrickGrid> {
        // Cubes within which something changes, by their lowest voxel: of 8³, 128³ and 4096³.
        let mut split: [BTreeSet<[i32; 3]>; 3] = Default::default();
        let mut roots = BTreeSet::new();
        let within = |origin: [i32; 3], log2: u32| origin.map(|x| x >> log2 << log2);
        for (grid, _) in parts {
            let leaves = grid.leaves.iter().map(|leaf| (leaf.origin, 8));
            for (origin, size) in leaves.chain(grid.tiles().map(|tile| (tile.origin, tile.size))) {
                roots.insert(within(origin, 12));
                for (split, (edge, log2)) in split.iter_mut().zip([(8, 3), (128, 7), (4096, 12)]) {
                    if edge > size || size == 8 {
                        split.insert(within(origin, log2));
                    }
                }
            }
        }
        let backgrounds: Vec<f32> = parts.iter().map(|(_, voxels)| voxels.background).collect();
        let mut builder = Builder::new(value(&backgrounds), NegativePolicy::Error);
        let mut numbers = vec![0.0; parts.len()];
        let mut at = |[i, j, k]: [i32; 3]| {
            for (number, (_, voxels)) in numbers.iter_mut().zip(parts) {
                *number = voxels.value_at(i, j, k);
            }
            value(&numbers)
        };
        let mut open: Vec<([i32; 3], i32)> = roots.into_iter().map(|root| (root, 4096)).collect();
        while let Some((origin, size)) = open.pop() {
            let (level, part) = match size {
                8 => (0, 1),
                128 => (1, 8),
                _ => (2, 128),
            };
            if !split[level].contains(&origin) {
                builder.add_tile(&vdb::Tile { origin, size, value: at(origin), active: true });
            } else if size == 8 {
                let local = |n: usize| [n >> 6, n >> 3 & 7, n & 7];
                let values = std::array::from_fn(|n| at([0, 1, 2].map(|axis| origin[axis] + local(n)[axis] as i32)));
                builder.add_leaf(origin, &[u64::MAX; 8], &values);
            } else {
                let along = |axis: usize| (origin[axis]..origin[axis] + size).step_by(part as usize);
                let cubes = along(0).flat_map(|x| along(1).flat_map(move |y| along(2).map(move |z| [x, y, z])));
                open.extend(cubes.map(|cube| (cube, part)));
            }
        }
        builder.finish().map_err(Error::Limit)
    }

    /// The same with values in half the room; ranges are those of the rounded values.
    pub(super) fn halved(self) -> BrickGrid {
        let count = self.bricks();
        let values = self.values.halved(count);
        let (bricks, constants) = (|| (0..count).map(|brick| values.brick(brick).values()), values.constants(count));
        let own_ranges: Vec<Range> = bricks().map(|values| layer_range(&values, 0)).collect();
        let greatest = own_ranges.iter().map(|range| range.max);
        let max = greatest.chain(constants.iter().copied()).fold(0.0, f32::max);
        let index = match self.index {
            Index::Dense { min, size, codes, .. } => {
                let ranges = ranges((&min, &size, &codes), bricks(), constants);
                Index::Dense { min, size, codes, ranges }
            }
            sparse @ Index::Sparse(_) => sparse,
        };
        BrickGrid { values, own_ranges, index, max, ..self }
    }
}

/// Collects bricks and cubes of one value, then indexes them.
pub(super) struct Builder {
    /// The background as the file has it, perhaps out of range.
    stored_background: f32,
    background: f32,
    negative: NegativePolicy,
    values: Vec<[f32; 512]>,
    constants: Vec<f32>,
    /// The entry of each constant, by its bits.
    by_value: HashMap<u32, u32>,
    roots: HashMap<[i32; 3], u32>,
    /// The tree, without its roots.
    index: SparseIndex,
    occupied: Option<([i32; 3], [i32; 3])>,
    active: Active,
    max: f32,
    /// How many voxels are infinite, too large or no numbers.
    bad: u64,
    /// How many voxels are negative and must not be.
    below_zero: u64,
    /// The least of those.
    lowest: f32,
    /// A voxel whose coordinates are too large.
    far: Option<[i32; 3]>,
}

impl Builder {
    /// Nothing yet but the background.
    pub(super) fn new(background: f32, negative: NegativePolicy) -> Self {
        // As for voxels; what is out of range is refused in the end.
        let stored_background = background;
        let background = if background > 0.0 && background.is_finite() { background } else { 0.0 };
        let mut builder = Builder {
            stored_background,
            background,
            negative,
            values: Vec::new(),
            constants: Vec::new(),
            by_value: HashMap::new(),
            roots: HashMap::new(),
            index: SparseIndex::default(),
            occupied: None,
            active: Active { count: 0, sum: 0.0, min: f32::INFINITY, max: f32::NEG_INFINITY },
            max: background,
            bad: 0,
            below_zero: 0,
            lowest: 0.0,
            far: None,
        };
        builder.constant(background);
        builder
    }

    /// Counts what is out of range, and applies the policy.
    fn check(&mut self, value: f32, count: u64) -> f32 {
        if value.is_nan() || value.abs() > LARGEST {
            self.bad += count;
            return 0.0;
        }
        if value < 0.0 {
            if self.negative == NegativePolicy::Error {
                self.below_zero += count;
                self.lowest = self.lowest.min(value);
            }
            return 0.0;
        }
        // A zero has no sign.
        value + 0.0
    }

    /// The entry for a constant; each value has one.
    fn constant(&mut self, value: f32) -> u32 {
        *self.by_value.entry(value.to_bits()).or_insert_with(|| {
            self.constants.push(value);
            CONSTANT | (self.constants.len() - 1) as u32
        })
    }

    /// Counts active voxels of one value.
    fn add_active(&mut self, value: f32, count: u64) {
        self.active.count += count;
        self.active.sum += value as f64 * count as f64;
        self.active.min = self.active.min.min(value);
        self.active.max = self.active.max.max(value);
    }

    /// Widens the range of voxels that differ from the background.
    fn occupy(&mut self, first: [i32; 3], last: [i32; 3]) {
        if (0..3).any(|axis| out_of_reach(first[axis] as i64, last[axis] as i64)) {
            self.far.get_or_insert(first);
            return;
        }
        let (lo, hi) = self.occupied.get_or_insert((first, last));
        for axis in 0..3 {
            lo[axis] = lo[axis].min(first[axis]);
            hi[axis] = hi[axis].max(last[axis]);
        }
    }

    /// Adds 8³ voxels from `origin` on, x slowest, with a bit for each that is active.
    pub(super) fn add_leaf(&mut self, origin: [i32; 3], active: &[u64; 8], stored: &[f32; 512]) {
        // Values, and those that differ from the background.
        let mut values = [0.0; 512];
        let (mut first, mut last) = ([8; 3], [-1; 3]);
        for (n, (value, &stored)) in values.iter_mut().zip(stored).enumerate() {
            *value = self.check(stored, 1);
            self.max = self.max.max(*value);
            if active[n >> 6] >> (n & 63) & 1 != 0 {
                self.add_active(*value, 1);
            }
            if *value != self.background {
                let local = [n >> 6, n >> 3 & 7, n & 7];
                for axis in 0..3 {
                    first[axis] = local[axis].min(first[axis] as usize) as i32;
                    last[axis] = last[axis].max(local[axis] as i32);
                }
            }
        }
        if last[0] < 0 {
            return;
        }
        self.occupy(
            std::array::from_fn(|axis| origin[axis] + first[axis]),
            std::array::from_fn(|axis| origin[axis] + last[axis]),
        );

        // Leaves of one value are constants.
        let code = if values.iter().all(|value| *value == values[0]) {
            self.constant(values[0])
        } else {
            self.values.push(values);
            (self.values.len() - 1) as u32
        };
        self.enter(origin.map(|x| x >> 3), 0, code);
    }

    /// Adds a cube of one value.
    pub(super) fn add_tile(&mut self, tile: &vdb::Tile) {
        let count = (tile.size as u64).pow(3);
        let value = self.check(tile.value, count);
        self.max = self.max.max(value);
        if tile.active {
            self.add_active(value, count);
        }
        if value != self.background {
            self.occupy(tile.origin, tile.origin.map(|x| x + (tile.size - 1)));
            let code = self.constant(value);
            self.enter(tile.origin.map(|x| x >> 3), tile.size.ilog2() - 3, code);
        }
    }

    /// The grid of all that was added.
    ///
    /// # Errors
    /// A message about voxels that are out of range.
    pub(super) fn finish(mut self) -> Result<BrickGrid, String> {
        // What cannot be a density.
        let stored = self.stored_background;
        if !stored.is_finite() || stored < 0.0 && self.negative == NegativePolicy::Error {
            return Err(format!("its background is {stored}, expected a number not below 0"));
        }
        if self.bad > 0 {
            return Err(format!("{} voxels are infinite, above 10³⁰ or not numbers: repair the grid", self.bad));
        }
        if self.below_zero > 0 {
            return Err(format!(
                "{} voxels are negative, down to {}: densities must not be; set negative = \"zero\" to take them for 0",
                self.below_zero, self.lowest
            ));
        }
        if let Some(far) = self.far {
            return Err(format!("has voxels at {far:?}, beyond ±2^30"));
        }
        if self.values.len() >= CONSTANT as usize || self.constants.len() >= CONSTANT as usize {
            return Err("has more than 2^31 bricks".to_string());
        }

        // The index.
        let own_ranges = self.values.iter().map(|values| layer_range(values, 0)).collect();
        let mut sparse = std::mem::take(&mut self.index);
        sparse.roots = self.roots.drain().collect();
        sparse.roots.sort_unstable();
        let index = self.dense_index(&sparse).unwrap_or(Index::Sparse(sparse));

        // Constants stand behind the bricks, so that both are read alike.
        let mut values = self.values.into_flattened();
        values.reserve_exact(self.constants.len());
        values.extend(self.constants);
        values.shrink_to_fit();
        Ok(BrickGrid {
            background: self.background,
            interpolation: Interpolation::Trilinear,
            values: Values::Full(values),
            own_ranges,
            index,
            occupied: self.occupied,
            active: self.active,
            max: self.max,
        })
    }

    /// Enters a cube of 2^`log2` bricks along an edge.
    fn enter(&mut self, brick: [i32; 3], log2: u32, code: u32) {
        /// A new node, all background.
        fn node(nodes: &mut Vec<Box<[u32]>>, size: usize) -> u32 {
            nodes.push(vec![BACKGROUND; size].into());
            (nodes.len() - 1) as u32
        }
        let SparseIndex { upper, lower, .. } = &mut self.index;
        let root = self.roots.entry(brick.map(|x| x >> 9)).or_insert(BACKGROUND);
        if log2 == 9 {
            *root = code;
            return;
        }
        if *root & CONSTANT != 0 {
            *root = node(upper, 1 << 15);
        }
        let entry = &mut upper[*root as usize][upper_offset(brick)];
        if log2 == 4 {
            *entry = code;
            return;
        }
        if *entry & CONSTANT != 0 {
            *entry = node(lower, 1 << 12);
        }
        lower[*entry as usize][lower_offset(brick)] = code;
    }

    /// A dense index in place of the sparse one, if it is not too large.
    fn dense_index(&self, sparse: &SparseIndex) -> Option<Index> {
        // An entry takes 12 bytes, a brick 2048: the array may cost a third of the bricks, or 1 MB.
        const ALWAYS: u64 = 1 << 16;
        const PER_BRICK: u64 = 56;
        let budget = ALWAYS + PER_BRICK * self.values.len() as u64;
        let (first, last) = self.occupied.unwrap_or_default();
        // One more below, where cells reach up into the first bricks, and one more above for these.
        let min = first.map(|x| (x >> 3) - 1);
        let size: [u32; 3] = std::array::from_fn(|axis| ((last[axis] >> 3) - min[axis] + 2) as u32);
        let count = size.iter().try_fold(1_u64, |count, &n| count.checked_mul(n as u64)).filter(|n| *n <= budget)?;

        let codes: Vec<u32> = (0..count as usize).map(|n| sparse.find(brick_of((&min, &size), n, 0)).0).collect();

        let ranges = ranges((&min, &size, &codes), self.values.iter().copied(), &self.constants);
        Some(Index::Dense { min, size, codes, ranges })
    }
}

/// The bricks of a dense index: coordinates of the `n`-th, or of that beyond its upper faces where `part` says so.
fn brick_of((min, size): (&[i32; 3], &[u32; 3]), n: usize, part: usize) -> [i32; 3] {
    let (y, x) = (size[2] as usize, size[1] as usize * size[2] as usize);
    let local = [n / x + (part >> 2 & 1), n / y % size[1] as usize + (part >> 1 & 1), n % y + (part & 1)];
    std::array::from_fn(|axis| min[axis] + local[axis] as i32)
}

/// The ranges of the bricks of a dense index with their aprons, from the values of all bricks, and the constants.
fn ranges(
    (min, size, codes): (&[i32; 3], &[u32; 3], &[u32]),
    bricks: impl Iterator<Item = [f32; 512]>,
    constants: &[f32],
) -> Vec<Range> {
    // Those parts of each brick that lie in the apron of a lower neighbour.
    let parts: Vec<[Range; 8]> = bricks.map(|values| std::array::from_fn(|part| layer_range(&values, part))).collect();
    let range = |n: usize| {
        (0..8).fold(Range::NONE, |range, part| {
            let code = dense_entry(min, size, brick_of((min, size), n, part)).map_or(BACKGROUND, |n| codes[n]);
            range.union(if code & CONSTANT == 0 {
                parts[code as usize][part]
            } else {
                let value = constants[(code & !CONSTANT) as usize];
                Range { min: value, max: value }
            })
        })
    };
    (0..codes.len()).map(range).collect()
}

/// Whether voxels from `first` to `last` leave what `i32` arithmetic has room for.
fn out_of_reach(first: i64, last: i64) -> bool {
    first < -(1 << 30) || last > 1 << 30
}

/// The range of the voxels of a brick whose x, y, z is 0 where the bits 2, 1, 0 of `part` say so.
fn layer_range(values: &[f32; 512], part: usize) -> Range {
    let count = |bit: usize| if part >> bit & 1 != 0 { 1 } else { 8 };
    let mut range = Range::NONE;
    for x in 0..count(2) {
        for y in 0..count(1) {
            for value in &values[64 * x + 8 * y..][..count(0)] {
                range = range.union(Range { min: *value, max: *value });
            }
        }
    }
    range
}
