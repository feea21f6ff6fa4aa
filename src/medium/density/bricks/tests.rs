use super::build::Builder;
use super::*;
use crate::math::Stream;
use crate::math::random::Purpose;
use crate::medium::density::vdb;
use std::ops::ControlFlow;

type Values = Box<dyn Fn([i32; 3]) -> f32>;

struct Case {
    name: &'static str,
    grid: BrickGrid,
    /// The value of any voxel.
    values: Values,
    /// Where to look.
    around: Bounds,
}

/// Noise with holes of background and bricks of one value, so that every kind of entry meets every other.
fn noise(at: [i32; 3], background: f32) -> f32 {
    let brick = at.map(|x| x >> 3);
    let hash = |at: [i32; 3]| {
        let mut stream =
            Stream::new(9, Purpose::Test, (at[0] as u32 as u64) << 32 | at[1] as u32 as u64, at[2] as u32 as u64);
        stream.uniform() as f32
    };
    match (hash(brick.map(|x| x + 1000)) * 4.0) as i32 {
        0 => background,
        1 => 0.75,
        _ => hash(at),
    }
}

fn dense(name: &'static str, origin: [i32; 3], dims: [usize; 3], background: f32) -> Case {
    let size = dims.map(|n| n as i32);
    let inside = move |at: [i32; 3]| (0..3).all(|axis| (0..size[axis]).contains(&(at[axis] - origin[axis])));
    let values: Values = Box::new(move |at| if inside(at) { noise(at, background) } else { background });
    let mut list = Vec::new();
    for z in 0..size[2] {
        for y in 0..size[1] {
            for x in 0..size[0] {
                list.push(values([origin[0] + x, origin[1] + y, origin[2] + z]));
            }
        }
    }
    let grid = BrickGrid::from_dense(origin, dims, &list, background, NegativePolicy::Error).unwrap();
    let min = DVec3::from_array(origin.map(f64::from));
    let around = Bounds { min, max: min + DVec3::from_array(size.map(f64::from)) }.grown(12.0);
    Case { name, grid, values, around }
}

/// Leaves and tiles of every size, behind a sparse index: a cube of 4096³ would fill 134 million
/// dense entries.
fn sparse() -> Case {
    let mut builder = Builder::new(0.25, NegativePolicy::Error);
    for (origin, size, value) in [([4096, 0, 0], 4096, 0.5), ([0, 0, 128], 128, 0.75), ([0, 128, 0], 8, 1.0)] {
        builder.add_tile(&vdb::Tile { origin, size, value, active: true });
    }
    let leaf = |at: [i32; 3]| at[0] >> 3 == 511 && at[1] >> 4 == 0 && at[2] >> 5 == 0;
    for (y, z) in [(0, 0), (0, 8), (0, 16), (0, 24), (8, 0), (8, 8), (8, 16), (8, 24)] {
        let values =
            std::array::from_fn(|n| noise([4088 + (n >> 6) as i32, y + (n >> 3 & 7) as i32, z + (n & 7) as i32], 0.25));
        builder.add_leaf([4088, y, z], &[u64::MAX; 8], &values);
    }
    let values: Values = Box::new(move |at| {
        let within = |origin: [i32; 3], size: i32| (0..3).all(|a| (0..size).contains(&(at[a] - origin[a])));
        match () {
            () if within([4096, 0, 0], 4096) => 0.5,
            () if within([0, 0, 128], 128) => 0.75,
            () if within([0, 128, 0], 8) => 1.0,
            () if leaf(at) => noise(at, 0.25),
            () => 0.25,
        }
    });
    let grid = builder.finish().unwrap();
    assert!(matches!(grid.index, Index::Sparse(_)) && grid.bytes() < 1 << 20);
    let around = Bounds { min: DVec3::new(4080.0, -6.0, -6.0), max: DVec3::new(4106.0, 24.0, 40.0) };
    Case { name: "sparse", grid, values, around }
}

fn cases() -> Vec<Case> {
    vec![
        dense("brick", [-13, 5, -40], [37, 29, 50], 0.0),
        dense("background", [3, -9, 0], [20, 17, 23], 0.5),
        dense("single voxel", [7, 7, 7], [1, 1, 1], 0.0),
        dense("line", [-2, 8, -3], [1, 1, 40], 0.0),
        sparse(),
    ]
}

/// Interpolated and not, and in half the room with what its voxels have there.
fn each_way(case: Case) -> [Case; 3] {
    let Case { name, grid, values, around } = case;
    let values = std::rc::Rc::new(values);
    let other = values.clone();
    let copy = grid.clone();
    let halved = grid.clone().with_precision(Precision::Half);
    let rounded = halved.clone();
    [
        Case { name, grid: halved, values: Box::new(move |at| rounded.value_at(at[0], at[1], at[2])), around },
        Case { name, grid, values: Box::new(move |at| values(at)), around },
        Case {
            name,
            grid: copy.with_interpolation(Interpolation::Nearest),
            values: Box::new(move |at| other(at)),
            around,
        },
    ]
}

fn point(stream: &mut Stream, bounds: &Bounds) -> DVec3 {
    let u = DVec3::new(stream.uniform(), stream.uniform(), stream.uniform());
    bounds.min + u * bounds.size()
}

/// A ray and its end: any direction, along axes, in planes of voxels and cells, through corners, never ending.
fn ray(stream: &mut Stream, bounds: &Bounds, kind: usize) -> (DVec3, DVec3, f64, f64) {
    let mut origin = point(stream, bounds);
    let mut direction = point(stream, bounds) - point(stream, bounds);
    let axis = kind / 2 % 3;
    match kind % 8 {
        2 => direction = [DVec3::X, DVec3::NEG_Y, DVec3::Z][axis] * direction.length(),
        3 => {
            origin = origin.round();
            direction = [DVec3::NEG_X, DVec3::Y, DVec3::NEG_Z][axis] * 0.37;
        }
        4 => {
            origin = (origin / 8.0).round() * 8.0;
            direction[axis] = 0.0;
        }
        5 => {
            origin = (origin / 8.0).round() * 8.0 + 0.5;
            direction = DVec3::new(1.0, -1.0, 1.0) * direction.x.signum();
        }
        6 => direction[axis] = 1e-310,
        7 => direction[axis] = -0.0,
        _ => {}
    }
    let t0 = stream.uniform() * 2.0 - 0.5;
    let t1 = if kind.is_multiple_of(3) { f64::INFINITY } else { t0 + 3.0 * stream.uniform() };
    (origin, direction, t0, t1)
}

/// What lies between voxels, from the definition.
fn brute_force(case: &Case, p: DVec3) -> f64 {
    if case.grid.interpolation == Interpolation::Nearest {
        return (case.values)((p + 0.5).floor().to_array().map(|x| x as i32)) as f64;
    }
    let low = p.floor();
    let f = p - low;
    (0..8)
        .map(|n| {
            let step = [n >> 2 & 1, n >> 1 & 1, n & 1];
            let weight: f64 = (0..3).map(|a| if step[a] == 1 { f[a] } else { 1.0 - f[a] }).product();
            weight * (case.values)(std::array::from_fn(|a| low[a] as i32 + step[a])) as f64
        })
        .sum()
}

#[test]
fn densities_are_those_of_the_definition() {
    for case in cases().into_iter().flat_map(each_way) {
        let mut stream = Stream::new(1, Purpose::Test, 0, 0);
        let support = case.grid.support();
        for n in 0..4000 {
            let mut p = point(&mut stream, &case.around);
            if n % 4 == 0 {
                p[n / 4 % 3] = p[n / 4 % 3].round();
            }
            let (found, expected) = (case.grid.density(p) as f64, brute_force(&case, p));
            assert!((found - expected).abs() < 1e-6, "{} {p}: {found} {expected}", case.name);
            assert!(found <= case.grid.max() as f64);
            // Beyond the support there is the background, on its upper faces too.
            if p.cmplt(support.min).any() || p.cmpge(support.max).any() {
                assert_eq!(found, case.grid.background() as f64, "{} {p}", case.name);
            }
        }
        for p in [DVec3::INFINITY, DVec3::NEG_INFINITY, DVec3::splat(2147483647.5), DVec3::splat(-3e9)] {
            assert_eq!(case.grid.density(p), case.grid.background());
        }
    }
}

/// In half the room voxels are off by half a unit of eleven binary digits at most, or by 2⁻²⁹ of their brick's largest value; cubes of one value, and
/// zeros, not at all. From the least numbers to the largest.
#[test]
fn halves_are_as_exact_as_they_say() {
    for scale in [1e-38, 1e-20, 1.0, 3e4, 1e29] {
        let value = |n: usize| match n % 5 {
            0 => 0.0,
            1 => scale,
            _ => scale * (0.37 + n as f32).sin().abs().powi(1 + n as i32 % 24),
        };
        let values: Vec<f32> =
            (0..32 * 24 * 16).map(|n| if n < 32 * 24 * 8 { value(n) } else { 0.3 * scale }).collect();
        let grid = BrickGrid::from_dense([0; 3], [32, 24, 16], &values, 0.0, NegativePolicy::Error).unwrap();
        let half = grid.clone().with_precision(Precision::Half);
        for (n, expected) in values.iter().enumerate() {
            let [i, j, k] = [n % 32, n / 32 % 24, n / (32 * 24)].map(|i| i as i32);
            let off = (half.value_at(i, j, k) - expected).abs();
            let least = grid.brick_max([i >> 3, j >> 3, k >> 3]) / (1u32 << 29) as f32;
            assert!(off <= (expected / 2048.0).max(least).max(f32::MIN_POSITIVE), "{expected} is off by {off}");
            assert!(off == 0.0 || n < 32 * 24 * 8 && *expected != 0.0, "{expected} is off by {off}");
        }
        // Half of each brick's values, without its unit, and of two constants.
        assert_eq!((half.bricks(), grid.bytes() - half.bytes()), (12, 12 * (2 * 512 - 4) - 2 * 2), "{scale}");
    }
}

#[test]
fn the_support_is_as_small_as_it_can_be() {
    let one = || BrickGrid::from_dense([7, -8, 0], [1, 1, 1], &[2.0], 0.0, NegativePolicy::Error).unwrap();
    let at = DVec3::new(7.0, -8.0, 0.0);
    assert_eq!(one().support(), Bounds { min: at - 1.0, max: at + 1.0 });
    let nearest = one().with_interpolation(Interpolation::Nearest);
    assert_eq!(nearest.support(), Bounds { min: at - 0.5, max: at + 0.5 });
    assert_eq!((nearest.density(at - 0.5), nearest.density(at + DVec3::X * 0.5)), (2.0, 0.0));
    assert!(
        BrickGrid::from_dense([0; 3], [2, 1, 1], &[3.0; 2], 3.0, NegativePolicy::Error).unwrap().support().is_empty()
    );
    assert!(BrickGrid::from_dense([0; 3], [0, 1, 1], &[], 0.0, NegativePolicy::Error).unwrap().support().is_empty());
}

#[test]
fn majorants_tile_the_ray_and_bound_the_density() {
    for case in cases().into_iter().flat_map(each_way) {
        let mut stream = Stream::new(2, Purpose::Test, 0, 0);
        let (mut pieces, mut tight) = (0, 0);
        for kind in 0..800 {
            let (origin, direction, t0, t1) = ray(&mut stream, &case.around, kind);
            let mut at = t0;
            let flow = case.grid.majorants(origin, direction, t0, t1, |a, b, max, min| {
                assert!(a == at && b > a, "{} ray {kind}: {a}..{b} after {at}", case.name);
                at = b;
                pieces += 1;
                tight += (max < case.grid.max() as f64) as usize;
                for _ in 0..4 {
                    let t = a + (b.min(a + 1e3) - a) * (0.001 + 0.998 * stream.uniform());
                    let rho = case.grid.density(origin + t * direction) as f64;
                    assert!(
                        (min - 2e-6..=max + 2e-6).contains(&rho),
                        "{} ray {kind}: {rho} in {min}..{max}",
                        case.name
                    );
                }
                ControlFlow::<()>::Continue(())
            });
            assert!(flow.is_continue() && at == t1, "{} ray {kind}: ends at {at}, not {t1}", case.name);
        }
        assert!(pieces >= 800 && tight > pieces / 4, "{}: {tight} of {pieces} are tight", case.name);
    }
}

#[test]
fn cells_tile_the_ray_and_hold_its_densities() {
    for case in cases().into_iter().flat_map(each_way) {
        let mut stream = Stream::new(3, Purpose::Test, 0, 0);
        for kind in 0..800 {
            let (origin, direction, t0, t1) = ray(&mut stream, &case.around, kind);
            let mut at = t0;
            let flow = case.grid.walk_cells(origin, direction, t0, t1, |cell| {
                assert!(cell.ta == at && cell.tb > at, "{} ray {kind}: {cell:?} after {at}", case.name);
                at = cell.tb;
                // Slivers are left out: there a rounding of t may lead into the next cell.
                if (cell.tb - cell.ta) * direction.length() > 1e-6 {
                    let expected = |t: f64| brute_force(&case, origin + t * direction);
                    let (a, b) = (cell.ta, cell.tb.min(cell.ta + 1e3));
                    let mid = 0.5 * (a + b);
                    assert!((cell.rho_mid as f64 - expected(mid)).abs() < 2e-6, "{} ray {kind} {cell:?}", case.name);
                    let [ya, ym, yb] = [cell.rho_a, cell.rho_mid, cell.rho_b].map(f64::from);
                    if case.grid.interpolation == Interpolation::Trilinear {
                        assert!((ya - expected(a)).abs() < 2e-6 && (yb - expected(b)).abs() < 2e-6);
                    } else {
                        assert!(ya == ym && ym == yb);
                    }
                }
                ControlFlow::<()>::Continue(())
            });
            assert!(flow.is_continue() && at == t1, "{} ray {kind}: ends at {at}, not {t1}", case.name);
        }
    }
}

#[test]
fn integrals_are_those_of_fine_quadrature() {
    for case in cases().into_iter().flat_map(each_way) {
        let mut stream = Stream::new(4, Purpose::Test, 0, 0);
        for kind in 0..60 {
            let (origin, direction, t0, t1) = ray(&mut stream, &case.around, kind);
            let t1 = t1.min(t0 + 1.0);
            // Midpoints: the density is Lipschitz or has a jump per cell, far below the bound.
            let steps = 40_000;
            let width = (t1 - t0) / steps as f64;
            let sum: f64 = (0..steps)
                .map(|i| case.grid.density(origin + (t0 + (i as f64 + 0.5) * width) * direction) as f64)
                .sum();
            let (found, expected) = (case.grid.integral(origin, direction, t0, t1), sum * width);
            let jumps = if case.grid.interpolation == Interpolation::Nearest { 200.0 * width } else { 1e-6 };
            assert!((found - expected).abs() <= jumps, "{} ray {kind}: {found} {expected}", case.name);
        }
    }
}

#[test]
fn integrals_add_up_exactly_where_they_are_known() {
    // A linear ramp along x, integrated along a slanted line: a quadratic function of the ends.
    let values: Vec<f32> = (0..30 * 30 * 30).map(|n| (n % 30) as f32).collect();
    let grid = BrickGrid::from_dense([0; 3], [30; 3], &values, 0.0, NegativePolicy::Error).unwrap();
    let (a, b) = (DVec3::new(0.3, 2.1, 28.0), DVec3::new(28.9, 25.7, 1.0));
    let integral = grid.integral(a, b - a, 0.0, 1.0);
    assert!((integral - 0.5 * (0.3 + 28.9)).abs() < 1e-5, "{integral}");
    // A single voxel of value v holds v in total: ∫ over x at the middle.
    let one = BrickGrid::from_dense([100, -7, 7], [1; 3], &[3.0], 0.0, NegativePolicy::Error).unwrap();
    let integral = one.integral(DVec3::new(0.0, -7.0, 7.0), DVec3::X * 2.0, 0.0, f64::INFINITY);
    assert!((integral - 1.5).abs() < 1e-6, "{integral}");
}

#[test]
fn voxels_far_apart_cost_no_more_than_near_ones() {
    let mut builder = Builder::new(0.0, NegativePolicy::Error);
    for (origin, value) in [([-5000, 3000, 20000], 1.0), ([40_000_000, 0, 0], 2.0)] {
        let mut values = [0.0; 512];
        values[0] = value;
        builder.add_leaf(origin, &[1, 0, 0, 0, 0, 0, 0, 0], &values);
    }
    let grid = builder.finish().unwrap();
    assert!(grid.bytes() < 400_000, "{} bytes", grid.bytes());
    assert_eq!((grid.value_at(-5000, 3000, 20000), grid.value_at(40_000_000, 0, 0), grid.sum()), (1.0, 2.0, 3.0));
    // From one to the other, in 10,000 steps rather than five million.
    let mut pieces = 0;
    let from = DVec3::new(-5000.0, 3000.0, 20000.0);
    let _ = grid.majorants(from, DVec3::new(40_000_000.0, 0.0, 0.0) - from, 0.0, 1.0, |_, _, _, _| {
        pieces += 1;
        ControlFlow::<()>::Continue(())
    });
    assert!((3..10).contains(&pieces), "{pieces}");
    // The same in the uppermost layer of the index's cubes; one brick at a time it would take minutes.
    for n in 0..100 {
        let from = DVec3::new(-6000.0, 1000.5 + n as f64, 4090.0 + 0.05 * n as f64);
        assert_eq!(grid.integral(from, DVec3::new(1.0, 0.0, 0.0), 0.0, 1e9), 0.0);
    }
    let integral = grid.integral(from - DVec3::X * 10.0, DVec3::X, 0.0, f64::INFINITY);
    assert!((integral - 1.0).abs() < 1e-6, "{integral}");
}
