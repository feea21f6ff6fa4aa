//! OpenVDB files: grids of floats and of vectors of three, read from the bytes up.
//!
//! The format is that of OpenVDB's `io/Archive.cc`, `io/Compression.h` and `tree/*.h`, file versions
//! 218 to 224. A file is a header and a list of grids; a grid is metadata, a map from index space to the
//! world, the *topology* of its tree (root, nodes of 32³ and 16³ children, masks of the 8³ leaves) and
//! then the voxels of its leaves. Numbers are little-endian and z varies fastest.
//!
//! The crate `vdb-rs` 0.6 is not used to render, because what it cannot read it mostly misreads:
//! halves with OpenVDB's default compression ask for terabytes, rotated and non-uniformly scaled grids
//! panic, root tiles and the background are dropped, grids of other types come back empty, and a
//! damaged length aborts the process. It serves the tests as a second opinion on the files it reads.
//!
//! No file makes this reader panic, loop or allocate more than some tens of times the file's size: lengths are
//! checked against the bytes that are left, the size of unpacked blocks is known beforehand, and tiles
//! stay tiles however large. There are no checksums in the format: a flipped bit in a value goes unseen.

mod codec;
mod cursor;
#[cfg_attr(not(feature = "vdb"), path = "left_out.rs")]
mod packed;
mod reader;

use crate::error::{Error, Result};
use crate::math::DAffine3;
use std::path::{Path, PathBuf};

/// What is said of files where this was built without the feature that reads them.
fn left_out() -> String {
    Error::left_out("OpenVDB files", "vdb")
}

/// An open file: what it holds is known, voxels are read on demand.
pub struct File {
    path: PathBuf,
    bytes: Vec<u8>,
    version: u32,
    library: (u32, u32),
    metadata: Vec<(String, MetaValue)>,
    grids: Vec<GridInfo>,
    /// Where each grid's data is.
    places: Vec<reader::Place>,
}

/// What a file says of a grid before its voxels are read.
#[derive(Clone, Debug)]
pub struct GridInfo {
    /// The name, without the suffix that tells grids of one name apart; may be empty.
    pub name: String,
    /// The tree's type, as `Tree_float_5_4_3`.
    pub tree_type: String,
    /// What the values mean: densities, distances or velocities.
    pub class: GridClass,
    /// Whether values are stored in 16 bits.
    pub half: bool,
    /// How its blocks are compressed.
    pub compression: Compression,
    /// The index of the grid whose tree this one shares.
    pub instance_of: Option<usize>,
    /// The value outside all nodes; `None` for other types than float.
    pub background: Option<f32>,
    /// How many voxels are active, by the file's own account.
    pub active_voxels: Option<u64>,
    /// The first and last active voxel along each axis, by the file's own account.
    pub bounds: Option<([i32; 3], [i32; 3])>,
    /// From index space to the world, or why it cannot be used.
    pub index_to_world: Result<DAffine3, String>,
    /// All metadata, in the file's order.
    pub metadata: Vec<(String, MetaValue)>,
}

/// What a grid's values mean.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum GridClass {
    /// The file does not say what they mean.
    Unknown,
    /// Signed distances to a surface.
    LevelSet,
    /// Densities, 0 outside.
    FogVolume,
    /// Velocities on cell faces.
    Staggered,
}

/// How the blocks of a grid are stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Compression {
    bits: u32,
}

/// A value in a file's or a grid's metadata.
#[derive(Clone, Debug, PartialEq)]
pub enum MetaValue {
    /// Text.
    Text(String),
    /// A truth value.
    Bool(bool),
    /// An integer.
    Int(i64),
    /// A real number.
    Float(f64),
    /// Three integers.
    Vec3i([i32; 3]),
    /// Three real numbers.
    Vec3([f64; 3]),
    /// Of another type, of which only the name is kept.
    Other(String),
}

/// A grid with its voxels.
pub struct Grid {
    /// The path of the file it is from.
    pub path: PathBuf,
    /// The name it has in the file.
    pub name: String,
    /// What the values mean: densities, distances or velocities.
    pub class: GridClass,
    /// The value where there is neither leaf nor tile.
    pub background: f32,
    /// From index space, where a voxel's value sits at its integer coordinates, to the world.
    pub index_to_world: DAffine3,
    /// The blocks of 8³ voxels.
    pub leaves: Vec<Leaf>,
    nodes: Vec<TileNode>,
}

/// A block of 8³ voxels. The voxel (x, y, z) has the offset 64 x + 8 y + z.
pub struct Leaf {
    /// The lowest voxel along each axis.
    pub origin: [i32; 3],
    /// Which voxels are active, 64 to a word by offset.
    pub active: [u64; 8],
    /// The values of all voxels, inactive ones included.
    pub values: Box<[f32; 512]>,
}

/// A cube of voxels of one value.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tile {
    /// The lowest voxel along each axis.
    pub origin: [i32; 3],
    /// Voxels along an edge: 8, 128 or 4096.
    pub size: i32,
    /// The value of all its voxels.
    pub value: f32,
    /// Whether its voxels are active.
    pub active: bool,
}

/// The tiles of one internal node, packed.
struct TileNode {
    origin: [i32; 3],
    /// Voxels along an edge of a tile, as a power of two.
    log2_size: u32,
    /// Tiles along the node's edge, as a power of two.
    log2_count: u32,
    /// Which of the node's entries are tiles worth keeping.
    kept: Box<[u64]>,
    active: Box<[u64]>,
    /// The values of the kept ones.
    values: Vec<f32>,
}

/// Sums over the active voxels of a grid.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Statistics {
    /// How many voxels are active.
    pub active_voxels: u64,
    /// The sum of their values.
    pub sum: f64,
    /// The smallest value; infinite if there is none.
    pub min: f32,
    /// The largest value; negative infinite if there is none.
    pub max: f32,
    /// The first and last active voxel along each axis; `None` without active voxels.
    pub bounds: Option<([i32; 3], [i32; 3])>,
}

impl File {
    /// Opens `path` and reads what it holds, without voxels.
    ///
    /// # Errors
    /// [`Error::Asset`] if the file cannot be read or is not a sound OpenVDB file.
    pub fn open(path: impl AsRef<Path>) -> Result<File> {
        let path = path.as_ref();
        let bytes = std::fs::read(path).map_err(|error| Error::asset(path, format!("cannot be read: {error}")))?;
        File::parse(bytes, path)
    }

    /// Reads a file's bytes; `path` is for messages.
    ///
    /// # Errors
    /// [`Error::Asset`] if they are not a sound OpenVDB file.
    pub fn parse(bytes: Vec<u8>, path: &Path) -> Result<File> {
        if cfg!(not(feature = "vdb")) {
            return Err(Error::asset(path, left_out()));
        }
        let listing = reader::list(&bytes).map_err(|message| Error::asset(path, message))?;
        let (grids, places) = listing.grids.into_iter().unzip();
        Ok(File {
            path: path.to_path_buf(),
            version: listing.version,
            library: listing.library,
            metadata: listing.metadata,
            grids,
            places,
            bytes,
        })
    }

    /// The version of the file format.
    pub fn version(&self) -> u32 {
        self.version
    }

    /// The major and minor version of the library that wrote the file.
    pub fn library_version(&self) -> (u32, u32) {
        self.library
    }

    /// The metadata of the file as a whole.
    pub fn metadata(&self) -> &[(String, MetaValue)] {
        &self.metadata
    }

    /// The grids, in the file's order.
    pub fn grids(&self) -> &[GridInfo] {
        &self.grids
    }

    /// The index of the grid called `name`; `name[1]` is the second of that name.
    ///
    /// # Errors
    /// [`Error::Asset`] naming the grids there are.
    pub fn find(&self, name: &str) -> Result<usize> {
        if let Some(index) = self.grids.iter().position(|grid| grid.name == name) {
            return Ok(index);
        }
        let numbered = name.strip_suffix(']').and_then(|name| name.rsplit_once('['));
        if let Some((name, number)) = numbered
            && let Ok(number) = number.parse()
            && let Some((index, _)) = self.grids.iter().enumerate().filter(|(_, grid)| grid.name == name).nth(number)
        {
            return Ok(index);
        }
        // A damaged file may list very many.
        const LISTED: usize = 100;
        let mut seen = std::collections::HashMap::new();
        let mut names = Vec::new();
        for grid in self.grids.iter().take(LISTED) {
            let count = seen.entry(&grid.name).or_insert(0);
            names.push(if *count == 0 { format!("{:?}", grid.name) } else { format!("\"{}[{count}]\"", grid.name) });
            *count += 1;
        }
        if names.is_empty() {
            names.push("none".to_string());
        }
        if self.grids.len() > LISTED {
            names.push(format!("and {} more", self.grids.len() - LISTED));
        }
        let names = names.join(", ");
        Err(Error::asset(&self.path, format!("holds no grid {name:?}; its grids are: {names}")))
    }

    /// Reads the grid called `name`; see [`File::find`].
    ///
    /// # Errors
    /// [`Error::Asset`] if there is none, its values are not floats, its map is not affine or cannot be
    /// inverted, or its data is damaged.
    pub fn read(&self, name: &str) -> Result<Grid> {
        self.read_at(self.find(name)?)
    }

    /// Reads the grid at `index` of [`File::grids`].
    ///
    /// # Errors
    /// As [`File::read`]; also if there is no such index.
    pub fn read_at(&self, index: usize) -> Result<Grid> {
        self.read_channels(index, (0, 1))
    }

    /// Reads one channel of the grid at `index` of [`File::grids`], one of [`GridInfo::channels`].
    ///
    /// # Errors
    /// As [`File::read_at`], but not for grids of vectors.
    pub fn read_channel(&self, index: usize, channel: usize) -> Result<Grid> {
        let channels = self.grids.get(index).and_then(GridInfo::channels);
        self.read_channels(index, (channel, channels.unwrap_or(1)))
    }

    fn read_channels(&self, index: usize, channels: (usize, usize)) -> Result<Grid> {
        let Some(info) = self.grids.get(index) else {
            return Err(Error::asset(&self.path, format!("holds {} grids, none at {index}", self.grids.len())));
        };
        let fail = |message: String| Error::asset(&self.path, format!("grid {:?}: {message}", info.name));
        let tree = reader::read_tree(&self.bytes, self.version, info, &self.places[index], channels).map_err(fail)?;
        let index_to_world = info.index_to_world.clone().map_err(fail)?;
        Ok(Grid {
            path: self.path.clone(),
            name: info.name.clone(),
            class: info.class,
            background: tree.background,
            index_to_world,
            leaves: tree.leaves,
            nodes: tree.nodes,
        })
    }
}

impl GridInfo {
    /// How many numbers each voxel has: one, or three of a grid of vectors; `None` for types that are not read.
    pub fn channels(&self) -> Option<usize> {
        reader::channels(&self.tree_type)
    }
}

impl Compression {
    /// Whether values go through Blosc.
    pub fn blosc(self) -> bool {
        self.bits & codec::BLOSC != 0
    }

    /// Whether values go through zlib.
    pub fn zip(self) -> bool {
        self.bits & codec::ZIP != 0
    }

    /// Whether only active values are stored.
    pub fn active_mask(self) -> bool {
        self.bits & codec::ACTIVE_MASK != 0
    }
}

impl std::fmt::Display for Compression {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match (self.blosc(), self.zip()) {
            (true, _) => "blosc",
            (_, true) => "zip",
            _ => "none",
        })?;
        f.write_str(if self.active_mask() { " + active mask" } else { "" })
    }
}

impl std::fmt::Display for GridClass {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            GridClass::Unknown => "unknown",
            GridClass::LevelSet => "level set",
            GridClass::FogVolume => "fog volume",
            GridClass::Staggered => "staggered",
        })
    }
}

impl Grid {
    /// All values that are stored, each with the number of voxels that have it; inactive ones and the background are among them.
    pub fn values(&self) -> impl Iterator<Item = (f32, u64)> + '_ {
        let leaves = self.leaves.iter().flat_map(|leaf| leaf.values.iter().map(|value| (*value, 1)));
        let tiles = self.tiles().map(|tile| (tile.value, (tile.size as u64).pow(3)));
        leaves.chain(tiles).chain([(self.background, 1)])
    }

    /// With each value replaced.
    pub fn map(mut self, value: impl Fn(f32) -> f32) -> Grid {
        self.background = value(self.background);
        let leaves = self.leaves.iter_mut().flat_map(|leaf| leaf.values.iter_mut());
        for stored in leaves.chain(self.nodes.iter_mut().flat_map(|node| &mut node.values)) {
            *stored = value(*stored);
        }
        self
    }

    /// The tiles whose voxels are active or differ from the background.
    pub fn tiles(&self) -> impl Iterator<Item = Tile> + '_ {
        self.nodes.iter().flat_map(|node| {
            let (log2, mask) = (node.log2_count, (1 << node.log2_count) - 1);
            ones(&node.kept).zip(&node.values).map(move |(n, &value)| Tile {
                origin: std::array::from_fn(|axis| {
                    node.origin[axis] + (((n >> (log2 * (2 - axis as u32))) & mask) << node.log2_size) as i32
                }),
                size: 1 << node.log2_size,
                value,
                active: node.active[n >> 6] >> (n & 63) & 1 != 0,
            })
        })
    }

    /// Sums over the active voxels.
    pub fn statistics(&self) -> Statistics {
        let mut all =
            Statistics { active_voxels: 0, sum: 0.0, min: f32::INFINITY, max: f32::NEG_INFINITY, bounds: None };
        let mut add = |origin: [i32; 3], size: i32, value: f32| {
            let count = (size as u64).pow(3);
            all.active_voxels += count;
            all.sum += value as f64 * count as f64;
            all.min = all.min.min(value);
            all.max = all.max.max(value);
            let (first, last) = all.bounds.get_or_insert((origin, origin));
            for axis in 0..3 {
                first[axis] = first[axis].min(origin[axis]);
                last[axis] = last[axis].max(origin[axis] + (size - 1));
            }
        };
        for leaf in &self.leaves {
            for n in ones(&leaf.active) {
                let [x, y, z] = leaf.origin;
                add([x + (n >> 6) as i32, y + (n >> 3 & 7) as i32, z + (n & 7) as i32], 1, leaf.values[n]);
            }
        }
        self.tiles().filter(|tile| tile.active).for_each(|tile| add(tile.origin, tile.size, tile.value));
        all
    }
}

/// The positions of the ones in a mask, ascending.
fn ones(mask: &[u64]) -> impl Iterator<Item = usize> + '_ {
    mask.iter().enumerate().flat_map(|(i, &word)| {
        std::iter::successors(Some(word), |word| Some(word & word.wrapping_sub(1)))
            .take_while(|word| *word != 0)
            .map(move |word| 64 * i + word.trailing_zeros() as usize)
    })
}
