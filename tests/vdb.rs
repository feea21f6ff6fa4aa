//! What volume files hold is what OpenVDB says they hold; no file, however damaged, does harm.

use std::path::{Path, PathBuf};
use volpm::math::random::Purpose;
use volpm::math::{DVec3, Stream};
use volpm::medium::density::bricks::{BrickGrid, NegativePolicy};
use volpm::medium::density::vdb::{File, Grid};

/// Counts what the current thread holds, and the most it held.
mod meter {
    use std::alloc::{GlobalAlloc, Layout, System};
    use std::cell::Cell;

    thread_local! {
        static HELD: Cell<isize> = const { Cell::new(0) };
        static PEAK: Cell<isize> = const { Cell::new(0) };
    }

    struct Meter;

    #[global_allocator]
    static METER: Meter = Meter;

    fn add(bytes: isize) {
        // A thread that is ending has no counters left.
        let _ = HELD.try_with(|held| {
            held.set(held.get() + bytes);
            let _ = PEAK.try_with(|peak| peak.set(peak.get().max(held.get())));
        });
    }

    // SAFETY: all calls go to the system's allocator unchanged; counting allocates nothing.
    unsafe impl GlobalAlloc for Meter {
        unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
            add(layout.size() as isize);
            unsafe { System.alloc(layout) }
        }

        unsafe fn dealloc(&self, block: *mut u8, layout: Layout) {
            add(-(layout.size() as isize));
            unsafe { System.dealloc(block, layout) }
        }

        unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
            add(layout.size() as isize);
            unsafe { System.alloc_zeroed(layout) }
        }

        unsafe fn realloc(&self, block: *mut u8, layout: Layout, size: usize) -> *mut u8 {
            // Old and new may be there at once.
            add(size as isize);
            let new = unsafe { System.realloc(block, layout, size) };
            add(-(layout.size() as isize));
            new
        }
    }

    /// The most that `work` holds at a time, in bytes.
    pub fn peak<T>(work: impl FnOnce() -> T) -> (T, isize) {
        let before = HELD.get();
        PEAK.set(before);
        let result = work();
        (result, PEAK.get() - before)
    }
}

fn data() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/vdb")
}

fn open(name: &str) -> File {
    File::open(data().join(name)).unwrap_or_else(|error| panic!("{error}"))
}

/// The value of a voxel, by search.
fn value(grid: &Grid, at: [i32; 3]) -> f32 {
    for leaf in &grid.leaves {
        let local: [i32; 3] = std::array::from_fn(|axis| at[axis] - leaf.origin[axis]);
        if local.iter().all(|x| (0..8).contains(x)) {
            return leaf.values[(local[0] * 64 + local[1] * 8 + local[2]) as usize];
        }
    }
    let inside = |tile: &volpm::medium::density::vdb::Tile| {
        (0..3).all(|axis| (tile.origin[axis]..=tile.origin[axis] + (tile.size - 1)).contains(&at[axis]))
    };
    grid.tiles().find(inside).map_or(grid.background, |tile| tile.value)
}

/// A line of `truth.csv`: what OpenVDB's Python module reads.
struct Truth {
    file: String,
    fields: Vec<String>,
}

impl Truth {
    fn all() -> Vec<Truth> {
        let text = std::fs::read_to_string(data().join("truth.csv")).unwrap();
        text.lines().skip(1).map(Truth::of).filter(|truth| truth.file.starts_with("fixtures/")).collect()
    }

    fn of(line: &str) -> Truth {
        let mut fields = vec![String::new()];
        let mut quoted = false;
        for c in line.chars() {
            match c {
                '"' => quoted = !quoted,
                ',' if !quoted => fields.push(String::new()),
                c => fields.last_mut().unwrap().push(c),
            }
        }
        Truth { file: fields[0].clone(), fields }
    }

    fn name(&self) -> &str {
        self.file.trim_start_matches("fixtures/")
    }

    /// The numbers in a field.
    fn numbers(&self, field: usize) -> Vec<f64> {
        self.fields[field].split(['(', ')', '[', ']', ',', ' ']).filter_map(|word| word.parse().ok()).collect()
    }
}

#[test]
fn files_hold_what_openvdb_reads() {
    let mut seen = std::collections::HashMap::new();
    let mut checked = 0;
    for truth in Truth::all() {
        let file = open(truth.name());
        if truth.fields[1] == "(no grids)" {
            assert!(file.grids().is_empty());
            continue;
        }
        let name = &truth.fields[1];
        if truth.fields[2] == "vec3s" {
            for channel in 0..3 {
                let grid = file.read_channel(0, channel).unwrap_or_else(|error| panic!("{error}"));
                assert_eq!(grid.background as f64, truth.numbers(4)[channel], "{}", truth.file);
                assert_eq!(grid.statistics().active_voxels as f64, truth.numbers(5)[0], "{}", truth.file);
                for sample in truth.numbers(12).chunks(6) {
                    let at: [i32; 3] = std::array::from_fn(|axis| sample[axis] as i32);
                    assert_eq!(value(&grid, at) as f64, sample[3 + channel], "{} {at:?}", truth.file);
                }
            }
        }
        if truth.fields[2] != "float" {
            let error = file.read_at(0).err().unwrap_or_else(|| panic!("{}: read", truth.file)).to_string();
            let kind = truth.name().trim_start_matches("type_").trim_start_matches("velocity_");
            let kind = kind.trim_end_matches(".vdb").trim_end_matches("_bg");
            assert!(error.contains(&format!("type {kind},")), "{error}");
            continue;
        }
        let nth = seen.entry((truth.file.clone(), name.clone())).and_modify(|n| *n += 1).or_insert(0);
        let wanted = if *nth == 0 { name.clone() } else { format!("{name}[{nth}]") };
        if truth.name() == "xf_frustum.vdb" {
            let error = file.read(&wanted).err().unwrap().to_string();
            assert!(error.contains("NonlinearFrustumMap"), "{error}");
            continue;
        }
        let info = &file.grids()[file.find(&wanted).unwrap()];
        let grid = file.read(&wanted).unwrap_or_else(|error| panic!("{error}"));
        let found = grid.statistics();
        let label = format!("{} {wanted:?}", truth.file);

        // Class, background, counts and sums.
        assert_eq!(grid.class.to_string(), truth.fields[3], "{label}");
        assert_eq!(grid.background as f64, truth.numbers(4)[0], "{label}");
        assert_eq!(info.background, Some(grid.background), "{label}");
        assert_eq!(found.active_voxels as f64, truth.numbers(5)[0], "{label}");
        assert_eq!(info.active_voxels, Some(found.active_voxels), "{label}");
        if let (&[sum], &[min], &[max]) = (&truth.numbers(6)[..], &truth.numbers(7)[..], &truth.numbers(8)[..]) {
            if sum.is_nan() {
                assert!(found.sum.is_nan(), "{label}");
            } else {
                assert!((found.sum - sum).abs() <= 1e-12 * sum.abs(), "{label}: {} {sum}", found.sum);
            }
            assert_eq!((found.min as f64, found.max as f64), (min, max), "{label}");
        }

        // Bounds.
        match found.bounds {
            None => assert_eq!(found.active_voxels, 0),
            Some((first, last)) => {
                assert_eq!(first.map(f64::from)[..], truth.numbers(9), "{label}");
                assert_eq!(last.map(f64::from)[..], truth.numbers(10), "{label}");
                assert_eq!(info.bounds, Some((first, last)), "{label}");
            }
        }

        // The map, printed to nine digits.
        let matrix = grid.index_to_world;
        for (row, expected) in truth.numbers(11).chunks(4).enumerate() {
            let found = [matrix.x_axis[row], matrix.y_axis[row], matrix.z_axis[row], matrix.translation[row]];
            for (found, expected) in found.iter().zip(expected) {
                assert!((found - expected).abs() <= 1e-8 * expected.abs(), "{label}: {found} {expected}");
            }
        }

        // Single voxels, in the tree and in bricks.
        let bricks = BrickGrid::from_vdb(&grid, NegativePolicy::Error);
        for sample in truth.numbers(12).chunks(4) {
            let at: [i32; 3] = std::array::from_fn(|axis| sample[axis] as i32);
            assert_eq!(value(&grid, at) as f64, sample[3], "{label} {at:?}");
            if let Ok(bricks) = &bricks {
                assert_eq!(bricks.value_at(at[0], at[1], at[2]) as f64, sample[3], "{label} {at:?}");
            }
        }
        match (truth.name(), &bricks) {
            ("levelset_sphere.vdb", Err(error)) => assert!(error.to_string().contains("level set"), "{error}"),
            ("mask_minusbg.vdb", Err(error)) => assert!(error.to_string().contains("down to -7"), "{error}"),
            ("nan_inf_negative.vdb", Err(error)) => assert!(error.to_string().contains("2 voxels"), "{error}"),
            (_, Err(error)) => panic!("{error}"),
            (_, Ok(bricks)) => {
                assert_eq!(bricks.active_voxels(), found.active_voxels);
                assert!((bricks.sum() - found.sum).abs() <= 1e-12 * found.sum);
                assert_eq!((bricks.min_active(), bricks.max_active()), (found.min, found.max));
                assert!(bricks.bytes() < 4 << 20, "{label}: {} bytes", bricks.bytes());
            }
        }
        checked += 1;
    }
    assert!(checked >= 55, "only {checked} grids");
}

#[test]
fn grids_are_found_by_name_and_the_absent_are_answered_with_a_list() {
    let file = open("two_same_name.vdb");
    let scale = |name: &str| file.read(name).unwrap().index_to_world.x_axis.x;
    assert!((scale("density") - 0.1).abs() < 1e-6 && (scale("density[1]") - 0.2).abs() < 1e-6);
    for absent in ["density[2]", "smoke", ""] {
        let error = file.read(absent).err().unwrap().to_string();
        assert!(error.contains(r#"its grids are: "density", "density[1]""#), "{error}");
    }
    assert!(open("no_grids.vdb").read("density").err().unwrap().to_string().contains("none"));
    assert!(open("unnamed.vdb").read("").is_ok() && open("utf8_name.vdb").read("dénsité").is_ok());
    assert_eq!(open("instanced.vdb").grids()[1].instance_of, Some(0));
}

#[test]
fn negative_voxels_can_be_taken_for_zero() {
    let grid = open("mask_minusbg.vdb").read("density").unwrap();
    let bricks = BrickGrid::from_vdb(&grid, NegativePolicy::Zero).unwrap();
    assert_eq!((value(&grid, [5, 10, 2]), bricks.value_at(5, 10, 2)), (-7.0, 0.0));
    assert_eq!((value(&grid, [9, 6, 8]), bricks.value_at(9, 6, 8)), (7.0, 7.0));
}

/// The fixtures as the crate `vdb-rs` reads them, where it reads them correctly.
#[test]
fn a_second_reader_agrees() {
    let mut agreed = 0;
    for entry in std::fs::read_dir(data()).unwrap() {
        let path = entry.unwrap().path();
        let name = path.file_name().unwrap().to_string_lossy().into_owned();
        // It cannot read rotations, scales without translation, instances, other types, root tiles.
        let beyond_it = [
            "xf_affine",
            "xf_scale.",
            "xf_frustum",
            "xf_unitary",
            "instanced",
            "type_",
            "velocity",
            "medium",
            "cube_root",
        ];
        if path.extension().is_none_or(|kind| kind != "vdb") || beyond_it.iter().any(|start| name.starts_with(start)) {
            continue;
        }
        let file = File::open(&path).unwrap();
        for info in file.grids() {
            // It misreads halves that are compressed and masked.
            let packed = info.compression.blosc() || info.compression.zip();
            if info.half && info.compression.active_mask() && packed || file.grids().len() != 1 || !info.name.is_ascii()
            {
                continue;
            }
            let mut theirs = vdb_rs::VdbReader::new(std::io::Cursor::new(std::fs::read(&path).unwrap())).unwrap();
            let their_name = theirs.available_grids()[0].clone();
            let mut theirs: Vec<([i32; 3], u32, u32)> = theirs
                .read_grid::<f32>(&their_name)
                .unwrap()
                .iter()
                .map(|(at, value, level)| {
                    let size = match level {
                        vdb_rs::VdbLevel::Node4 => 128,
                        vdb_rs::VdbLevel::Node3 => 8,
                        vdb_rs::VdbLevel::Voxel => 1,
                    };
                    (at.to_array().map(|x| x as i32), size, value.to_bits())
                })
                .collect();
            let grid = file.read(&info.name).unwrap();
            let mut ours = Vec::new();
            for leaf in &grid.leaves {
                for n in (0..512).filter(|n| leaf.active[n >> 6] >> (n & 63) & 1 != 0) {
                    let local = [n >> 6, n >> 3 & 7, n & 7];
                    let at = std::array::from_fn(|axis| leaf.origin[axis] + local[axis] as i32);
                    ours.push((at, 1, leaf.values[n].to_bits()));
                }
            }
            let tiles = grid.tiles().filter(|tile| tile.active);
            ours.extend(tiles.map(|tile| (tile.origin, tile.size as u32, tile.value.to_bits())));
            ours.sort_unstable();
            theirs.sort_unstable();
            assert_eq!(ours, theirs, "{name}");
            agreed += 1;
        }
    }
    assert!(agreed >= 30, "only {agreed} files");
}

/// Reads all that can be read and looks at it; errors are fine, more memory than the file is worth is not.
fn exercise(bytes: Vec<u8>) -> bool {
    let limit = 64 * bytes.len() + (4 << 20);
    let (sound, peak) = meter::peak(|| {
        let Ok(file) = File::parse(bytes, Path::new("mutant.vdb")) else { return false };
        let mut sound = !file.grids().is_empty();
        for index in 0..file.grids().len().min(4) {
            let Ok(grid) = file.read_at(index) else {
                sound = false;
                continue;
            };
            grid.statistics();
            if let Ok(bricks) = BrickGrid::from_vdb(&grid, NegativePolicy::Zero) {
                assert!(bricks.max().is_finite());
                assert!(bricks.trilinear(DVec3::new(3.5, 4.5, 7.5)).is_finite());
                assert!(bricks.integral(DVec3::new(-1e3, 5.2, 4.1), DVec3::X, 0.0, 1e7).is_finite());
            }
        }
        sound
    });
    assert!(peak < limit as isize, "{peak} bytes of memory, {limit} allowed");
    sound
}

/// A file that is nothing but its header, up to the numbers of root tiles and nodes.
fn headless() -> Vec<u8> {
    // One root tile ends the file, after the two counts.
    let mut bytes = std::fs::read(data().join("cube_roottile.vdb")).unwrap();
    bytes.truncate(bytes.len() - 17 - 8);
    bytes[20] = 0;
    bytes
}

#[test]
fn many_huge_tiles_cost_what_their_list_costs() {
    let count = 60_000;
    let mut bytes = headless();
    bytes.extend((count as u32).to_le_bytes());
    bytes.extend(0_u32.to_le_bytes());
    for n in 0..count {
        for x in [n % 250, n / 250, 0] {
            bytes.extend((4096_i32 * x).to_le_bytes());
        }
        bytes.extend((1.0 + n as f32).to_le_bytes());
        bytes.push(1);
    }
    let start = std::time::Instant::now();
    assert!(exercise(bytes));
    assert!(start.elapsed().as_secs() < 10, "took {:?}", start.elapsed());
}

#[test]
fn a_node_full_of_packed_tiles_costs_no_more_than_its_values() {
    // One node of 32768 tiles, a few hundred bytes packed besides its masks, again and again.
    let count = 200;
    let mut bytes = headless();
    // The flags stand behind the tree's type, no parent and three offsets.
    let kind = b"Tree_float_5_4_3";
    let at = bytes.windows(kind.len()).position(|window| window == kind).unwrap();
    let compression = at + kind.len() + 4 + 24;
    bytes[compression..compression + 4].copy_from_slice(&1_u32.to_le_bytes());
    bytes.extend(0_u32.to_le_bytes());
    bytes.extend((count as u32).to_le_bytes());
    let values: Vec<u8> = (0..32768).flat_map(|n| ((n % 7) as f32).to_le_bytes()).collect();
    let mut packed = flate2::write::ZlibEncoder::new(Vec::new(), flate2::Compression::best());
    std::io::Write::write_all(&mut packed, &values).unwrap();
    let packed = packed.finish().unwrap();
    for n in 0..count {
        for x in [n, 0, 0] {
            bytes.extend((4096_i32 * x).to_le_bytes());
        }
        bytes.extend([0; 4096]);
        bytes.extend([0xff; 4096]);
        bytes.push(6);
        bytes.extend((packed.len() as i64).to_le_bytes());
        bytes.extend(&packed);
    }
    assert!(exercise(bytes));
}

/// A file of one float grid without compression, as writers before file version 222 stored it.
fn in_old_format(name: &str, version: u32) -> Vec<u8> {
    let new = std::fs::read(data().join(name)).unwrap();
    let mut old = Vec::new();
    let mut at = 0;
    let word = |at: usize| u32::from_le_bytes(new[at..at + 4].try_into().unwrap()) as usize;

    // Header: a byte says whether the file is zipped; the compression of each grid is not said.
    old.extend(&new[..8]);
    old.extend(version.to_le_bytes());
    old.extend(&new[12..20]);
    old.push(0);
    if version >= 220 {
        old.push(0);
    }
    old.extend(&new[21..57]);
    at += 57;
    let mut copy = |old: &mut Vec<u8>, bytes: usize| {
        old.extend(&new[at..at + bytes]);
        at += bytes;
        at
    };
    let copy_metadata = |old: &mut Vec<u8>, copy: &mut dyn FnMut(&mut Vec<u8>, usize) -> usize| {
        let end = copy(old, 4);
        for _ in 0..word(end - 4) {
            for _ in 0..3 {
                let end = copy(old, 4);
                copy(old, word(end - 4));
            }
        }
    };
    copy_metadata(&mut old, &mut copy);
    copy(&mut old, 4);
    for _ in 0..3 {
        let end = copy(&mut old, 4);
        copy(&mut old, word(end - 4));
    }
    copy(&mut old, 24);
    let mut skipped = Vec::new();
    copy(&mut skipped, 4);
    copy_metadata(&mut old, &mut copy);

    // The map: matrices before version 219.
    let mut map = Vec::new();
    let end = copy(&mut map, 4);
    copy(&mut map, word(end - 4));
    copy(&mut map, 15 * 8);
    if version >= 219 {
        old.extend(&map);
    } else {
        let matrix = |diagonal: f64, translation: f64| {
            (0..16).map(move |n| match n {
                15 => 1.0_f64,
                0 | 5 | 10 => diagonal,
                12..=14 => translation,
                _ => 0.0,
            })
        };
        old.extend(15_u32.to_le_bytes());
        old.extend(b"LinearTransform");
        old.extend([0; 24]);
        let [local_to_world, world_to_local] = [matrix(0.25, 5.0), matrix(4.0, -20.0)];
        let [voxel_to_local, local_to_voxel] = [matrix(2.0, 1.0), matrix(0.5, -0.5)];
        let all = local_to_world.chain(world_to_local).chain(voxel_to_local).chain(local_to_voxel);
        old.extend(all.flat_map(f64::to_le_bytes));
    }

    // The tree: only values that are not children, without a byte before them. Zip was the rule before
    // version 220; blocks with a negative length are stored as they are.
    let length = |old: &mut Vec<u8>, values: usize| {
        if version < 220 {
            old.extend((-4 * values as i64).to_le_bytes());
        }
    };
    copy(&mut old, 16 + 12);
    let mut nodes = vec![1];
    for log2 in [15, 12] {
        let bytes = 1 << (log2 - 3);
        let mut below = Vec::new();
        for _ in 0..nodes.len() {
            let end = copy(&mut old, 2 * bytes);
            let children = &new[end - 2 * bytes..end - bytes];
            copy(&mut skipped, 1);
            let end = copy(&mut skipped, 4 << log2);
            let is_child = |n: usize| children[n / 8] >> (n % 8) & 1 != 0;
            length(&mut old, (0..1 << log2).filter(|n| !is_child(*n)).count());
            for n in 0..1 << log2 {
                if !is_child(n) {
                    old.extend(&new[end - (4 << log2) + 4 * n..][..4]);
                } else {
                    below.push(n);
                }
            }
        }
        nodes = below;
    }
    copy(&mut old, 64 * nodes.len());
    for _ in &nodes {
        copy(&mut old, 64);
        old.extend([0; 12]);
        // A second buffer, which nobody reads.
        old.push(2);
        copy(&mut skipped, 1);
        length(&mut old, 512);
        let end = copy(&mut old, 2048);
        length(&mut old, 512);
        old.extend(&new[end - 2048..end]);
    }
    assert_eq!(copy(&mut skipped, 0), new.len());
    old
}

#[test]
fn old_file_versions_hold_the_same_voxels() {
    for name in ["ramp_float_none.vdb", "mask_float_none.vdb"] {
        let expected = open(name).read("density").unwrap();
        for version in [218, 219, 220, 221] {
            let file = File::parse(in_old_format(name, version), Path::new("old.vdb")).unwrap();
            let grid = file.read("density").unwrap();
            assert_eq!(grid.statistics(), expected.statistics(), "{name} {version}");
            assert!(
                grid.leaves.iter().zip(&expected.leaves).all(|(a, b)| a.origin == b.origin && a.values == b.values)
            );
            if version >= 219 {
                assert_eq!(grid.index_to_world, expected.index_to_world);
            } else {
                // 2 p + 1, then 0.25 p + 5.
                let world = grid.index_to_world.transform_point3(DVec3::new(1.0, 2.0, 3.0));
                assert_eq!(world, DVec3::new(5.75, 6.25, 6.75));
            }
        }
    }
}

#[test]
fn malformed_files_are_errors_or_sound() {
    let mut count = 0;
    for entry in std::fs::read_dir(data().join("bad")).unwrap() {
        let path = entry.unwrap().path();
        let start = std::time::Instant::now();
        let sound = exercise(std::fs::read(&path).unwrap());
        assert!(start.elapsed().as_secs_f64() < 2.0, "{}", path.display());
        let name = path.file_stem().unwrap().to_string_lossy().into_owned();
        let must_fail =
            ["trunc_", "magic_", "text", "png", "random", "zero", "all_", "leaf_bloscbytes", "blosc_nbytes"];
        assert!(!(sound && must_fail.iter().any(|start| name.starts_with(start))), "{name} was read");
        count += 1;
    }
    assert!(count >= 110, "only {count} files");
}

#[test]
fn a_file_without_grid_offsets_is_read_in_sequence() {
    let file = open("bad/no_grid_offsets.vdb");
    assert_eq!(
        file.read("density").unwrap().statistics(),
        open("ramp_float_blosc_active.vdb").read("density").unwrap().statistics()
    );
    // Two grids, the second found behind the first.
    let mut bytes = std::fs::read(data().join("two_grids.vdb")).unwrap();
    bytes[20] = 0;
    let streamed = File::parse(bytes, Path::new("streamed.vdb")).unwrap();
    assert_eq!(streamed.read("temperature").unwrap().statistics().sum, 768_000.0);
}

#[test]
fn no_mutant_does_harm() {
    let start = std::time::Instant::now();
    let mut random = Stream::new(7, Purpose::Test, 0, 0);
    let mut below = |n: usize| ((random.uniform() * n as f64) as usize).min(n - 1);
    let (mut mutants, mut read) = (0, 0);
    let mut run = |bytes: Vec<u8>| {
        mutants += 1;
        read += exercise(bytes) as usize;
    };
    for name in [
        "ramp_float_blosc_active.vdb",
        "mask_half_zip_active.vdb",
        "mask_half_blosc.vdb",
        "mask_two_inactive.vdb",
        "ramp_float_zip.vdb",
        "cube_tile128.vdb",
        "cube_roottile.vdb",
        "two_grids.vdb",
        "instanced.vdb",
    ] {
        let whole = std::fs::read(data().join(name)).unwrap();
        for _ in 0..120 {
            run(whole[..below(whole.len())].to_vec());
        }
        // A window of wild bytes slides over the file: densely over its head, where the structure is.
        for start in (0..700.min(whole.len())).step_by(3).chain((700..whole.len()).step_by(whole.len() / 100)) {
            for wild in [0x00, 0x7f, 0xff] {
                let mut bytes = whole.clone();
                let end = (start + 4).min(bytes.len());
                bytes[start..end].fill(wild);
                run(bytes);
            }
        }
        for _ in 0..200 {
            let mut bytes = whole.clone();
            for _ in 0..1 + below(3) {
                let at = below(bytes.len());
                bytes[at] ^= 1 << below(8);
            }
            run(bytes);
        }
    }
    assert!(mutants > 8000 && read > mutants / 20, "{read} of {mutants} read");
    assert!(start.elapsed().as_secs() < 120, "took {:?}", start.elapsed());
}
