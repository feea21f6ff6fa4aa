//! The parts of a file, in the order they are stored.

use super::codec::{ACTIVE_MASK, BLOSC, Decoder, ZIP};
use super::cursor::{Cursor, Parse};
use super::{Compression, GridClass, GridInfo, Leaf, MetaValue, TileNode, ones};
use crate::math::{DAffine3, DMat3, DMat4, DVec3};

/// `OPENVDB_FILE_VERSION_NEW_TRANSFORM`: maps by name.
const NAMED_MAPS: u32 = 219;
/// `OPENVDB_FILE_VERSION_SELECTIVE_COMPRESSION`: the header says whether blocks are zipped.
const SELECTIVE_COMPRESSION: u32 = 220;
/// `OPENVDB_FILE_VERSION_NODE_MASK_COMPRESSION`: compression per grid, inactive values left out.
const MASK_COMPRESSION: u32 = 222;

const FLOAT_TREE: &str = "Tree_float_5_4_3";
const VECTOR_TREE: &str = "Tree_vec3s_5_4_3";
const HALF_SUFFIX: &str = "_HalfFloat";

/// A file's header and grids.
pub(super) struct Listing {
    pub version: u32,
    pub library: (u32, u32),
    pub metadata: Vec<(String, MetaValue)>,
    pub grids: Vec<(GridInfo, Place)>,
}

/// Where a grid's tree is stored.
pub(super) struct Place {
    /// The offset of the tree, or why it is not known.
    tree: Parse<usize>,
    /// The first offset beyond the grid.
    end: usize,
    /// How the tree is stored: for an instance, as its parent says.
    half: bool,
    compression: u32,
}

/// The voxels of a tree, as stored.
pub(super) struct Tree {
    pub background: f32,
    pub leaves: Vec<Leaf>,
    pub nodes: Vec<TileNode>,
    end: usize,
}

/// Reads everything but voxels.
pub(super) fn list(bytes: &[u8]) -> Parse<Listing> {
    let mut at = Cursor::new(bytes, 0);

    // Header.
    const MAGIC: [u8; 8] = *b" BDV\0\0\0\0";
    if !bytes.starts_with(&MAGIC) {
        let start: Vec<String> = bytes.iter().take(8).map(|byte| format!("{byte:02x}")).collect();
        return Err(if bytes.is_empty() {
            "is empty, not an OpenVDB file".to_string()
        } else {
            format!(
                "is not an OpenVDB file: it starts with the bytes {}, expected 20 42 44 56 00 00 00 00",
                start.join(" ")
            )
        });
    }
    at.take(8, "the header")?;
    let version = at.u32("the header")?;
    if !(218..=224).contains(&version) {
        return Err(format!(
            "OpenVDB file format {version} is not supported, only 218 to 224: save it again with another \
             version of OpenVDB"
        ));
    }
    let library = (at.u32("the header")?, at.u32("the header")?);
    let has_offsets = at.u8("the header")? != 0;
    let mut compression = ZIP | ACTIVE_MASK;
    if (SELECTIVE_COMPRESSION..MASK_COMPRESSION).contains(&version) {
        compression = if at.u8("the header")? != 0 { ZIP } else { 0 };
    }
    at.take(36, "the header's identifier")?;
    let metadata = read_metadata(&mut at)?;
    let count = at.u32("the number of grids")?;

    // Grids. Each must end behind where it starts, so that a damaged list cannot be read in circles.
    let mut unique_names = Vec::new();
    let mut parents = Vec::new();
    let mut grids = Vec::new();
    for number in 1..=count {
        let unique_name = at.string("a grid's name")?;
        let name = plain_name(&unique_name).to_string();
        let named = |message: String| format!("grid {name:?}: {message}");
        let stored_type = at.string("a grid's type")?;
        let parent = at.string("a grid's instance parent")?;
        let grid_at = at.i64("a grid's offsets")?;
        at.i64("a grid's offsets")?;
        let end = at.i64("a grid's offsets")?;
        let mut end = if has_offsets {
            let inside = at.position() as u64..=bytes.len() as u64;
            match (u64::try_from(grid_at), u64::try_from(end)) {
                (Ok(start), Ok(end)) if start <= end && inside.contains(&start) && inside.contains(&end) => {
                    at = Cursor::new(bytes, start as usize);
                    end as usize
                }
                _ => {
                    return Err(named(format!(
                        "is said to lie at bytes {grid_at} to {end}, expected a range within {} to {}: truncated or damaged",
                        at.position(),
                        bytes.len()
                    )));
                }
            }
        } else {
            bytes.len()
        };

        let mut data = Cursor::new(&bytes[..end], at.position());
        let (info, place) =
            read_grid_head(&mut data, version, compression, &name, &stored_type, !parent.is_empty(), end)
                .map_err(named)?;
        if !has_offsets && number < count {
            if !parent.is_empty() {
                end = data.position();
            } else if let Some(width) = channels(&info.tree_type) {
                end = read_tree(bytes, version, &info, &place, (0, width)).map_err(named)?.end;
            } else {
                return Err(format!(
                    "was streamed without grid offsets, and what follows grid {name:?} of type {stored_type} cannot be \
                     found: save the file with offsets, or its float and vec3s grids alone"
                ));
            }
        }
        at = Cursor::new(bytes, end);
        unique_names.push(unique_name);
        parents.push(parent);
        grids.push((info, Place { end, ..place }));
    }

    // Instances: their parents go by the unique name, or by the plain one.
    let mut by_name = std::collections::HashMap::new();
    for (i, name) in unique_names.iter().enumerate().filter(|(i, _)| parents[*i].is_empty()) {
        by_name.entry(name.as_str()).or_insert(i);
        by_name.entry(plain_name(name)).or_insert(i);
    }
    for (i, parent) in parents.iter().enumerate().filter(|(_, parent)| !parent.is_empty()) {
        let Some(&found) = by_name.get(parent.as_str()) else {
            grids[i].1.tree = Err(format!("shares the tree of {parent:?}, which is not in the file"));
            continue;
        };
        let (head, place) = &grids[found];
        let (background, active_voxels, bounds) = (head.background, head.active_voxels, head.bounds);
        let tree = place.tree.as_ref().map_err(|_| "shares its tree with a grid whose map cannot be read".to_string());
        let place = Place { tree: tree.copied(), ..*place };
        let (info, own) = &mut grids[i];
        info.instance_of = Some(found);
        info.background = background;
        info.active_voxels = info.active_voxels.or(active_voxels);
        info.bounds = info.bounds.or(bounds);
        *own = place;
    }
    Ok(Listing { version, library, metadata, grids })
}

/// A name without the suffix that tells grids of one name apart.
fn plain_name(unique: &str) -> &str {
    unique.split('\u{1e}').next().unwrap_or_default()
}

/// Reads what stands before a grid's tree.
fn read_grid_head(
    at: &mut Cursor,
    version: u32,
    mut compression: u32,
    name: &str,
    stored_type: &str,
    instance: bool,
    end: usize,
) -> Parse<(GridInfo, Place)> {
    if version >= MASK_COMPRESSION {
        compression = at.u32("the compression flags")?;
        if compression & !(ZIP | ACTIVE_MASK | BLOSC) != 0 {
            return Err(format!("unknown compression flags {compression:#x}, expected a sum of 1, 2 and 4: damaged"));
        }
    }
    let metadata = read_metadata(at)?;
    let find = |key: &str| metadata.iter().find(|(name, _)| name == key).map(|(_, value)| value);
    let tree_type = stored_type.strip_suffix(HALF_SUFFIX).unwrap_or(stored_type);
    let half = match find("is_saved_as_half_float") {
        Some(MetaValue::Bool(half)) => *half,
        _ => stored_type.ends_with(HALF_SUFFIX),
    };
    let class = match find("class") {
        Some(MetaValue::Text(class)) if class == "level set" => GridClass::LevelSet,
        Some(MetaValue::Text(class)) if class == "fog volume" => GridClass::FogVolume,
        Some(MetaValue::Text(class)) if class == "staggered" => GridClass::Staggered,
        _ => GridClass::Unknown,
    };
    let active_voxels = match find("file_voxel_count") {
        Some(MetaValue::Int(count)) => u64::try_from(*count).ok(),
        _ => None,
    };
    let bounds = match (find("file_bbox_min"), find("file_bbox_max")) {
        (Some(MetaValue::Vec3i(min)), Some(MetaValue::Vec3i(max))) if (0..3).all(|i| min[i] <= max[i]) => {
            Some((*min, *max))
        }
        _ => None,
    };
    let index_to_world = read_map(at, version);
    let tree = index_to_world.clone().map(|_| at.position());
    // A map that is read but useless does not hide the tree from instances.
    let index_to_world = index_to_world.and_then(check_map);
    let mut background = None;
    if tree.is_ok() && !instance && tree_type == FLOAT_TREE {
        let mut root = at.clone();
        background = root.u32("").and_then(|_| root.f32("")).ok();
    }
    let info = GridInfo {
        name: name.to_string(),
        tree_type: tree_type.to_string(),
        class,
        half,
        compression: Compression { bits: compression },
        instance_of: None,
        background,
        active_voxels,
        bounds,
        index_to_world,
        metadata,
    };
    Ok((info, Place { tree, end, half, compression }))
}

fn read_metadata(at: &mut Cursor) -> Parse<Vec<(String, MetaValue)>> {
    let count = at.u32("the number of metadata")?;
    let mut metadata = Vec::new();
    for _ in 0..count {
        let name = at.string("a metadata name")?;
        let kind = at.string("a metadata type")?;
        let length = at.u32("a metadata length")? as usize;
        let bytes = at.take(length, "a metadata value")?;
        let mut value = Cursor::new(bytes, 0);
        let what = "a metadata value";
        let value = match (kind.as_str(), length) {
            ("string", _) => MetaValue::Text(String::from_utf8_lossy(bytes).into_owned()),
            ("bool", 1) => MetaValue::Bool(value.u8(what)? != 0),
            ("int32", 4) => MetaValue::Int(value.i32(what)? as i64),
            ("int64", 8) => MetaValue::Int(value.i64(what)?),
            ("float", 4) => MetaValue::Float(value.f32(what)? as f64),
            ("double", 8) => MetaValue::Float(value.f64(what)?),
            ("vec3i", 12) => MetaValue::Vec3i(value.coord(what)?),
            ("vec3s", 12) => {
                MetaValue::Vec3([value.f32(what)? as f64, value.f32(what)? as f64, value.f32(what)? as f64])
            }
            ("vec3d", 24) => MetaValue::Vec3([value.f64(what)?, value.f64(what)?, value.f64(what)?]),
            _ => MetaValue::Other(kind),
        };
        metadata.push((name, value));
    }
    Ok(metadata)
}

/// Reads the map from index space to the world.
fn read_map(at: &mut Cursor, version: u32) -> Parse<DAffine3> {
    fn vector(at: &mut Cursor) -> Parse<DVec3> {
        let what = "the grid's map";
        Ok(DVec3::new(at.f64(what)?, at.f64(what)?, at.f64(what)?))
    }
    // OpenVDB multiplies row vectors from the left: its rows, in the order stored, are our columns.
    fn matrix(at: &mut Cursor) -> Parse<DMat4> {
        let mut columns = [0.0; 16];
        for value in &mut columns {
            *value = at.f64("the grid's map")?;
        }
        Ok(DMat4::from_cols_array(&columns))
    }
    fn affine(matrix: DMat4) -> Parse<DAffine3> {
        let last = matrix.row(3);
        if last.to_array() != [0.0, 0.0, 0.0, 1.0] {
            return Err(format!(
                "its map's last column is {:?}, expected [0, 0, 0, 1] of an affine map",
                last.to_array()
            ));
        }
        Ok(DAffine3::from_mat4(matrix))
    }
    // What follows the scale (its inverse and the like) is computed from it.
    fn scale(at: &mut Cursor) -> Parse<DVec3> {
        let scale = vector(at)?;
        at.take(4 * 24, "the grid's map")?;
        Ok(scale)
    }

    let kind = at.string("the name of the grid's map")?;
    if version < NAMED_MAPS {
        if kind != "LinearTransform" {
            return Err(format!("its map is a {kind:?}, expected LinearTransform: only affine maps can be used"));
        }
        at.take(24, "the grid's map")?;
        let [local_to_world, _, voxel_to_local, _] = [matrix(at)?, matrix(at)?, matrix(at)?, matrix(at)?];
        return affine(local_to_world * voxel_to_local);
    }
    match kind.as_str() {
        "AffineMap" | "UnitaryMap" => affine(matrix(at)?),
        "TranslationMap" => Ok(DAffine3::from_translation(vector(at)?)),
        "ScaleMap" | "UniformScaleMap" => Ok(DAffine3::from_scale(scale(at)?)),
        "ScaleTranslateMap" | "UniformScaleTranslateMap" => {
            let translation = vector(at)?;
            Ok(DAffine3::from_mat3_translation(DMat3::from_diagonal(scale(at)?), translation))
        }
        "NonlinearFrustumMap" => {
            Err("its voxels fill a camera's frustum (NonlinearFrustumMap); only affine maps can be \
                                      used: resample it to a uniform grid"
                .to_string())
        }
        _ => Err(format!("unknown map {kind:?}, expected one of OpenVDB's affine maps: damaged")),
    }
}

fn check_map(map: DAffine3) -> Parse<DAffine3> {
    let inverse = map.inverse();
    if map.is_finite() && inverse.is_finite() && map.matrix3.determinant() != 0.0 {
        return Ok(map);
    }
    let [x, y, z] = [map.x_axis, map.y_axis, map.z_axis].map(|axis| axis.to_array());
    Err(format!("its map takes the axes of index space to {x:?}, {y:?}, {z:?}: a voxel has no volume"))
}

/// How many numbers each voxel of a tree of this type has; `None` for types that are not read.
pub(super) fn channels(tree_type: &str) -> Option<usize> {
    match tree_type {
        FLOAT_TREE => Some(1),
        VECTOR_TREE => Some(3),
        _ => None,
    }
}

/// Reads a tree with its voxels: one channel of so many.
pub(super) fn read_tree(
    bytes: &[u8],
    version: u32,
    info: &GridInfo,
    place: &Place,
    (channel, width): (usize, usize),
) -> Parse<Tree> {
    if channels(&info.tree_type) != Some(width) {
        let kind = info.tree_type.strip_prefix("Tree_").and_then(|kind| kind.strip_suffix("_5_4_3"));
        return Err(match kind {
            Some("float") | None => format!("its tree is a {:?}, expected {FLOAT_TREE}", info.tree_type),
            Some(kind) => format!("its values are of type {kind}, expected float: convert the grid to float"),
        });
    }
    let at = Cursor::new(&bytes[..place.end], place.tree.clone()?);
    let mut reader = TreeReader {
        at,
        version,
        half: place.half,
        compression: place.compression,
        width,
        channel,
        background: 0.0,
        decoder: Decoder::new(),
        wide: Vec::new(),
        packed: Vec::new(),
        topology: Vec::new(),
        nodes: Vec::new(),
    };
    reader.read_topology()?;
    let leaves = reader.read_leaves()?;
    Ok(Tree { background: reader.background, leaves, nodes: reader.nodes, end: reader.at.position() })
}

struct TreeReader<'a> {
    at: Cursor<'a>,
    version: u32,
    half: bool,
    compression: u32,
    /// Numbers to a voxel, and which of them is read.
    width: usize,
    channel: usize,
    background: f32,
    decoder: Decoder,
    packed: Vec<f32>,
    /// All numbers of a node's voxels.
    wide: Vec<f32>,
    /// Origin and active mask of each leaf, in the order their voxels are stored.
    topology: Vec<([i32; 3], [u64; 8])>,
    nodes: Vec<TileNode>,
}

impl TreeReader<'_> {
    fn read_topology(&mut self) -> Parse<()> {
        let buffers = self.at.u32("the tree's head")?;
        if buffers != 1 {
            return Err(format!("its tree has {buffers} buffers, expected 1"));
        }
        self.background = self.value("the background")?;
        let tile_count = self.at.u32("the number of root tiles")?;
        let child_count = self.at.u32("the number of root nodes")?;
        let mut origins = Vec::new();
        for _ in 0..tile_count {
            let origin = self.root_origin()?;
            let value = self.value("a root tile")?;
            let active = self.at.u8("a root tile")? != 0;
            origins.push(origin);
            if active || value != self.background {
                self.nodes.push(TileNode {
                    origin,
                    log2_size: 12,
                    log2_count: 0,
                    kept: Box::new([1]),
                    active: Box::new([active as u64]),
                    values: vec![value],
                });
            }
        }
        let mut values = vec![0.0; 1 << 15];
        for _ in 0..child_count {
            let origin = self.root_origin()?;
            origins.push(origin);
            let children = self.read_node::<512>(origin, 5, 7, &mut values)?;
            for n in ones(&children[..]) {
                let origin = child_origin(origin, n, 5, 7);
                let children = self.read_node::<64>(origin, 4, 3, &mut values[..1 << 12])?;
                for n in ones(&children[..]) {
                    let mask = self.at.mask("the mask of a leaf")?;
                    self.topology.push((child_origin(origin, n, 4, 3), *mask));
                }
            }
        }
        origins.sort_unstable();
        match origins.windows(2).find(|pair| pair[0] == pair[1]) {
            Some(pair) => Err(format!("the root's entry at {:?} is there twice: damaged", pair[0])),
            None => Ok(()),
        }
    }

    fn root_origin(&mut self) -> Parse<[i32; 3]> {
        let origin = self.at.coord("the origin of a root entry")?;
        if origin.iter().any(|x| x.rem_euclid(4096) != 0) {
            return Err(format!("the root has an entry at {origin:?}, expected multiples of 4096: damaged"));
        }
        Ok(origin)
    }

    /// Reads an internal node up to its children and keeps its tiles; gives the mask of children.
    fn read_node<const WORDS: usize>(
        &mut self,
        origin: [i32; 3],
        log2_count: u32,
        log2_size: u32,
        values: &mut [f32],
    ) -> Parse<Box<[u64; WORDS]>> {
        let children = self.at.mask::<WORDS>("the child mask of a node")?;
        let active = self.at.mask::<WORDS>("the value mask of a node")?;
        if self.version < MASK_COMPRESSION {
            // Only the entries that are not children are stored: read them, then spread them.
            let stored = values.len() - ones(&children[..]).count();
            self.read_block(&mut values[..stored], &active[..])?;
            let mut from = stored;
            for n in (0..values.len()).rev() {
                if children[n >> 6] >> (n & 63) & 1 == 0 {
                    from -= 1;
                    values[n] = values[from];
                }
            }
        } else {
            self.read_block(values, &active[..])?;
        }
        let mut kept: Box<[u64]> = vec![0; WORDS].into();
        for (n, value) in values.iter().enumerate() {
            let (word, bit) = (n >> 6, 1 << (n & 63));
            if children[word] & bit == 0 && (active[word] & bit != 0 || *value != self.background) {
                kept[word] |= bit;
            }
        }
        let count = kept.iter().map(|word| word.count_ones() as usize).sum();
        if count > 0 {
            let mut list = Vec::with_capacity(count);
            list.extend(ones(&kept).map(|n| values[n]));
            let active = Box::new(*active) as Box<[u64]>;
            self.nodes.push(TileNode { origin, log2_size, log2_count, kept, active, values: list });
        }
        Ok(children)
    }

    fn read_leaves(&mut self) -> Parse<Vec<Leaf>> {
        let mut leaves = Vec::new();
        for (origin, active) in std::mem::take(&mut self.topology) {
            if *self.at.mask::<8>("the mask of a leaf")? != active {
                return Err(format!("the leaf at {origin:?} has two different masks: damaged"));
            }
            let mut buffers = 1;
            if self.version < MASK_COMPRESSION {
                self.at.coord("the origin of a leaf")?;
                buffers = self.at.u8("the buffers of a leaf")?;
            }
            let mut values = Box::new([0.0; 512]);
            self.read_block(&mut values[..], &active)?;
            for _ in 1..buffers {
                // Auxiliary values of old writers.
                let mut unused = [0.0; 512];
                self.read_values(&mut unused, self.compression & ZIP)?;
            }
            leaves.push(Leaf { origin, active, values });
        }
        Ok(leaves)
    }

    /// Reads one voxel's number.
    fn value(&mut self, what: &str) -> Parse<f32> {
        let mut value = 0.0;
        for channel in 0..self.width {
            let number = self.at.f32(what)?;
            if channel == self.channel {
                value = number;
            }
        }
        Ok(value)
    }

    /// Reads a block of voxels' numbers.
    fn read_values(&mut self, out: &mut [f32], compression: u32) -> Parse<()> {
        if self.width == 1 {
            return self.decoder.read(&mut self.at, out, self.half, compression);
        }
        self.wide.resize(self.width * out.len(), 0.0);
        self.decoder.read(&mut self.at, &mut self.wide, self.half, compression)?;
        for (value, numbers) in out.iter_mut().zip(self.wide.chunks_exact(self.width)) {
            *value = numbers[self.channel];
        }
        Ok(())
    }

    /// Reads the values of a node, with the inactive ones as stored, implied or background.
    fn read_block(&mut self, out: &mut [f32], active: &[u64]) -> Parse<()> {
        // How inactive values are told apart: `io/Compression.h`, the enumeration behind
        // NO_MASK_OR_INACTIVE_VALS.
        const NONE: u8 = 0;
        const ONE: u8 = 2;
        const MASK: u8 = 3;
        const MASK_AND_ONE: u8 = 4;
        const MASK_AND_TWO: u8 = 5;
        const ALL: u8 = 6;

        let at = self.at.position();
        let kind = if self.version < MASK_COMPRESSION { ALL } else { self.at.u8("the kind of a node's values")? };
        if kind > ALL {
            return Err(format!("values of kind {kind} at offset {at}, expected 0 to 6: damaged"));
        }
        let mut inactive = [if kind == NONE { self.background } else { -self.background }, self.background];
        if matches!(kind, ONE | MASK_AND_ONE | MASK_AND_TWO) {
            inactive[0] = self.value("an inactive value")?;
        }
        if kind == MASK_AND_TWO {
            inactive[1] = self.value("an inactive value")?;
        }
        let mut selection: &[u8] = &[];
        if matches!(kind, MASK | MASK_AND_ONE | MASK_AND_TWO) {
            selection = self.at.take(out.len() / 8, "the mask of inactive values")?;
        }
        if self.compression & ACTIVE_MASK == 0 || kind == ALL {
            return self.read_values(out, self.compression);
        }
        let count = active.iter().map(|word| word.count_ones() as usize).sum();
        let mut packed = std::mem::take(&mut self.packed);
        packed.resize(count, 0.0);
        self.read_values(&mut packed, self.compression)?;
        self.packed = packed;
        let mut packed = self.packed.iter();
        for (n, value) in out.iter_mut().enumerate() {
            *value = if active[n >> 6] >> (n & 63) & 1 != 0 {
                // As many values were read as the mask has ones.
                packed.next().copied().unwrap_or(self.background)
            } else {
                inactive[selection.get(n >> 3).map_or(0, |byte| byte >> (n & 7) & 1) as usize]
            };
        }
        Ok(())
    }
}

/// The origin of a node's `n`th child.
fn child_origin(origin: [i32; 3], n: usize, log2_count: u32, log2_size: u32) -> [i32; 3] {
    let mask = (1 << log2_count) - 1;
    std::array::from_fn(|axis| origin[axis] + (((n >> (log2_count * (2 - axis as u32))) & mask) << log2_size) as i32)
}
