//! Speed of point queries, in nanoseconds per look-up and per gathered photon, against two textbook structures
//! over the same photons: the balanced kd-tree with a max-heap of Jensen (2001, §6.2), and a hashed grid. All
//! find the same light, which is checked. One thread. `cargo bench --bench point`; a number after `--` sets how
//! many photons (default 1 000 000).
//!
//! Even: photons spread over a cube five wide. Beams: six narrow cones inside of a larger box. March: along rays of
//! neighbouring pixels, front to back. Anyhow: points anywhere.

mod photons;

use glam::{DVec3, Vec3};
use smallvec::SmallVec;
use std::sync::OnceLock;
use std::time::Instant;
use volpm::gather::{GatherStats, PhaseLanes, PointQuery};
use volpm::math::random::{Purpose, Stream};
use volpm::math::{Frame, sampling};
use volpm::medium::phase::HenyeyGreenstein;
use volpm::photon::{Ball, Photon, Plane, PointMap, PointMemory, PointSettings};

const G: f32 = 0.75;

/// A place on a ray, and the ray's direction.
type Place = (DVec3, DVec3);

/// Steps along rays of a pinhole camera through tiles of 8 × 8 pixels.
fn march(from: DVec3, to: DVec3, half: f64, step: f64, tiles: usize) -> Vec<Place> {
    let mut stream = Stream::new(3, Purpose::Test, 0, 0);
    let frame = Frame::around((to - from).normalize());
    let middle = (to - from).length();
    let mut all = Vec::new();
    for tile in 0..tiles {
        let place = (tile as f64 + 0.5) / tiles as f64;
        let corner = [1.6 * place - 0.8, 1.6 * (place * 7.0).fract() - 0.8];
        for pixel in 0..64 {
            let [a, b] = stream.uniform2();
            let x = 0.4 * (corner[0] + ((pixel % 8) as f64 + a) / 128.0);
            let y = 0.4 * (corner[1] + ((pixel / 8) as f64 + b) / 128.0);
            let direction = (frame.z + x * frame.x + y * frame.y).normalize();
            let mut t = middle - half + step * stream.uniform();
            while t < middle + half {
                all.push((from + t * direction, direction));
                t += step;
            }
        }
    }
    all
}

fn anyhow(count: usize) -> Vec<Place> {
    let mut stream = Stream::new(4, Purpose::Test, 0, 0);
    let mut one = || {
        let x = DVec3::from_array([0; 3].map(|_| 4.0 * stream.uniform() - 2.0));
        (x, sampling::sphere(stream.uniform2()))
    };
    (0..count).map(|_| one()).collect()
}

/// The phase function times the power of a photon, seen along a ray.
fn weigh(photon: &Photon, omega: Vec3, sum: &mut Vec3) {
    let x = 1.0 + G * G + 2.0 * G * photon.direction.dot(omega);
    *sum += photon.power * ((1.0 - G * G) / (4.0 * std::f32::consts::PI * x * x.sqrt()));
}

/// A squared distance and a photon.
type Near = (f32, u32);

/// Keeps the `n` nearest of what it is given: a list first, a max-heap once it is full.
struct Heap {
    n: usize,
    items: Vec<Near>,
}

impl Heap {
    fn down(&mut self, mut i: usize) {
        loop {
            let mut child = 2 * i + 1;
            if child >= self.items.len() {
                return;
            }
            if child + 1 < self.items.len() && self.items[child + 1].0 > self.items[child].0 {
                child += 1;
            }
            if self.items[i].0 >= self.items[child].0 {
                return;
            }
            self.items.swap(i, child);
            i = child;
        }
    }

    /// Takes a photon closer than `bound`; returns the bound from then on.
    fn offer(&mut self, near: Near, bound: f32) -> f32 {
        if self.items.len() < self.n {
            self.items.push(near);
            if self.items.len() < self.n {
                return bound;
            }
            for i in (0..self.n / 2).rev() {
                self.down(i);
            }
        } else {
            self.items[0] = near;
            self.down(0);
        }
        self.items[0].0
    }
}

/// A left-balanced kd-tree: the children of photon i, counted from 1, are 2i and 2i + 1.
struct KdTree {
    photons: Vec<Photon>,
    axes: Vec<u8>,
}

impl KdTree {
    fn new(photons: &[Photon]) -> Self {
        let mut tree = KdTree { photons: photons.to_vec(), axes: vec![0; photons.len()] };
        let mut items = photons.to_vec();
        tree.build(&mut items, 1);
        tree
    }

    fn build(&mut self, items: &mut [Photon], at: usize) {
        let Some(first) = items.first() else { return };
        let (min, max) = items
            .iter()
            .fold((first.position, first.position), |(min, max), p| (min.min(p.position), max.max(p.position)));
        let axis = (max - min).max_position();
        // As many on the left as fill the last row from the left.
        let count = items.len();
        let row = (count + 1).next_power_of_two() / 2;
        let last = count + 1 - row;
        let left = (row - 1) / 2 + last.min(row / 2);
        let (low, median, high) =
            items.select_nth_unstable_by(left, |a, b| a.position[axis].total_cmp(&b.position[axis]));
        self.photons[at - 1] = *median;
        self.axes[at - 1] = axis as u8;
        self.build(low, 2 * at);
        self.build(high, 2 * at + 1);
    }

    fn visit(&self, x: Vec3, at: usize, bound: &mut f32, found: &mut impl FnMut(Near, f32) -> f32) {
        let Some(photon) = self.photons.get(at - 1) else { return };
        let from_plane = x[self.axes[at - 1] as usize] - photon.position[self.axes[at - 1] as usize];
        if 2 * at <= self.photons.len() {
            let (near, far) = if from_plane < 0.0 { (2 * at, 2 * at + 1) } else { (2 * at + 1, 2 * at) };
            self.visit(x, near, bound, found);
            if from_plane * from_plane < *bound {
                self.visit(x, far, bound, found);
            }
        }
        let d2 = photon.position.distance_squared(x);
        if d2 < *bound {
            *bound = found((d2, at as u32 - 1), *bound);
        }
    }
}

/// Photons in cubes, the cubes in a hash table.
struct HashedGrid {
    photons: Vec<Photon>,
    edge: f32,
    /// Where each bucket's photons start.
    starts: Vec<u32>,
}

impl HashedGrid {
    fn new(photons: &[Photon], edge: f32) -> Self {
        let buckets = photons.len().next_power_of_two();
        let mut grid = HashedGrid { photons: Vec::new(), edge, starts: vec![0; buckets + 1] };
        for photon in photons {
            let bucket = grid.bucket(grid.cell(photon.position));
            grid.starts[bucket + 1] += 1;
        }
        for i in 0..buckets {
            grid.starts[i + 1] += grid.starts[i];
        }
        let mut next = grid.starts.clone();
        grid.photons = photons.to_vec();
        for photon in photons {
            let bucket = grid.bucket(grid.cell(photon.position));
            grid.photons[next[bucket] as usize] = *photon;
            next[bucket] += 1;
        }
        grid
    }

    fn cell(&self, x: Vec3) -> [i32; 3] {
        (x / self.edge).floor().to_array().map(|x| x as i32)
    }

    /// Teschner et al. (2003).
    fn bucket(&self, cell: [i32; 3]) -> usize {
        let [x, y, z] = cell.map(|x| x as u32);
        let hash = x.wrapping_mul(73_856_093) ^ y.wrapping_mul(19_349_663) ^ z.wrapping_mul(83_492_791);
        hash as usize & (self.starts.len() - 2)
    }

    fn visit(&self, x: Vec3, radius: f32, found: &mut impl FnMut(Near, f32) -> f32) {
        let (low, high) = (self.cell(x - radius), self.cell(x + radius));
        let mut bound = radius * radius;
        for i in low[0]..=high[0] {
            for j in low[1]..=high[1] {
                for k in low[2]..=high[2] {
                    let bucket = self.bucket([i, j, k]);
                    for index in self.starts[bucket]..self.starts[bucket + 1] {
                        let position = self.photons[index as usize].position;
                        let d2 = position.distance_squared(x);
                        // Cubes may share a bucket.
                        if d2 < bound && self.cell(position) == [i, j, k] {
                            bound = found((d2, index), bound);
                        }
                    }
                }
            }
        }
    }
}

/// The three structures.
struct Structures {
    map: PointMap,
    tree: KdTree,
    grid: HashedGrid,
}

fn no_walls(_: Vec3, _: f32, _: &mut SmallVec<[Plane; 3]>) {}

/// Seconds that this thread has run, where the system tells; else seconds since the first call.
fn seconds() -> f64 {
    static START: OnceLock<Instant> = OnceLock::new();
    let start = START.get_or_init(Instant::now);
    let told = std::fs::read_to_string("/proc/thread-self/schedstat").ok();
    let nanoseconds: Option<f64> = told.and_then(|text| text.split(' ').next()?.parse().ok());
    nanoseconds.map_or_else(|| start.elapsed().as_secs_f64(), |ns| ns * 1e-9)
}

/// Seconds of the best of five, and the sum of what was found. The system counts in milliseconds.
fn time(mut run: impl FnMut() -> f64) -> (f64, f64) {
    const LONG_ENOUGH: f64 = 0.1;
    let mut best = f64::INFINITY;
    let mut sum = 0.0;
    for _ in 0..5 {
        let start = seconds();
        let mut runs = 0.0;
        while seconds() - start < LONG_ENOUGH {
            sum = std::hint::black_box(run());
            runs += 1.0;
        }
        best = best.min((seconds() - start) / runs);
    }
    (best, sum)
}

fn compare(name: &str, structures: &Structures, ball: Ball, places: &[Place]) {
    let phase = PhaseLanes::new(HenyeyGreenstein { g: f64::from(G) });
    let Structures { map, tree, grid } = structures;
    let mut stats = GatherStats::default();
    let blocks = time(|| {
        stats = GatherStats::default();
        let mut memory = PointMemory::default();
        let mut sum = 0.0;
        for &(position, direction) in places {
            let query = PointQuery { position, direction, phase: &phase, hull: None, max_events: 255 };
            sum += f64::from(map.gather(&query, &no_walls, &mut memory, &mut stats).total[1]);
        }
        sum
    });
    let others: [(f64, f64); 2] = match ball {
        Ball::Fixed(radius) => {
            let volume = 4.0 / 3.0 * std::f64::consts::PI * f64::from(radius).powi(3);
            let tree = time(|| {
                let mut all = 0.0;
                for (x, omega) in places {
                    let mut sum = Vec3::ZERO;
                    let mut bound = radius * radius;
                    tree.visit(x.as_vec3(), 1, &mut bound, &mut |(_, i), bound| {
                        weigh(&tree.photons[i as usize], omega.as_vec3(), &mut sum);
                        bound
                    });
                    all += f64::from(sum.y);
                }
                all / volume
            });
            let grid = time(|| {
                let mut all = 0.0;
                for (x, omega) in places {
                    let mut sum = Vec3::ZERO;
                    grid.visit(x.as_vec3(), radius, &mut |(_, i), bound| {
                        weigh(&grid.photons[i as usize], omega.as_vec3(), &mut sum);
                        bound
                    });
                    all += f64::from(sum.y);
                }
                all / volume
            });
            [tree, grid]
        }
        Ball::Nearest { neighbours, max_radius } => {
            let n = neighbours as usize;
            let finish = |heap: &Heap, photons: &[Photon], omega: &DVec3| {
                let mut sum = Vec3::ZERO;
                // All but the n-th, if there are so many.
                let (r2, inside) = match heap.items.first() {
                    Some(farthest) if heap.items.len() == n => (farthest.0, &heap.items[1..]),
                    _ => (max_radius * max_radius, &heap.items[..]),
                };
                for (_, i) in inside {
                    weigh(&photons[*i as usize], omega.as_vec3(), &mut sum);
                }
                f64::from(sum.y) / (4.0 / 3.0 * std::f64::consts::PI * f64::from(r2).powf(1.5))
            };
            let mut heap = Heap { n, items: Vec::with_capacity(n) };
            let tree = time(|| {
                let mut sum = 0.0;
                for (x, omega) in places {
                    heap.items.clear();
                    let mut bound = max_radius * max_radius;
                    tree.visit(x.as_vec3(), 1, &mut bound, &mut |near, bound| heap.offer(near, bound));
                    sum += finish(&heap, &tree.photons, omega);
                }
                sum
            });
            let grid = time(|| {
                let mut sum = 0.0;
                let mut radius = grid.edge;
                for (x, omega) in places {
                    // The last radius is a good first guess here too.
                    radius = (1.08 * radius).min(max_radius);
                    loop {
                        heap.items.clear();
                        grid.visit(x.as_vec3(), radius, &mut |near, bound| heap.offer(near, bound));
                        if heap.items.len() == n || radius == max_radius {
                            break;
                        }
                        radius = (1.3 * radius).min(max_radius);
                    }
                    if heap.items.len() == n {
                        radius = heap.items[0].0.sqrt();
                    }
                    sum += finish(&heap, &grid.photons, omega);
                }
                sum
            });
            [tree, grid]
        }
    };
    for (name, (_, sum)) in ["kd-tree", "grid"].iter().zip(&others) {
        assert!((sum / blocks.1 - 1.0).abs() < 1e-3, "{name}: {sum} instead of {}", blocks.1);
    }
    let of = |x: u64| x as f64 / places.len() as f64;
    let ns = |seconds: f64| seconds * 1e9 / places.len() as f64;
    println!(
        "  {name:34} {:7.0} ns a look-up ({:5.1} a photon); kd-tree {:7.0} ({:4.1}×), grid {:7.0} ({:4.1}×); {:4.0} photons, {:3.0} blocks, {:3.0} nodes",
        ns(blocks.0),
        ns(blocks.0) / of(stats.photons),
        ns(others[0].0),
        others[0].0 / blocks.0,
        ns(others[1].0),
        others[1].0 / blocks.0,
        of(stats.photons),
        of(stats.blocks),
        of(stats.nodes),
    );
}

fn build(photons: &[Photon], ball: Ball, edge: f32) -> Structures {
    let start = Instant::now();
    let map = PointMap::build(
        photons.to_vec(),
        &PointSettings { boundaries: false, ..PointSettings::new(ball) },
        &|_: Vec3, limit: f32| limit,
    );
    let blocks = start.elapsed().as_secs_f64();
    let start = Instant::now();
    let tree = KdTree::new(photons);
    let seconds = start.elapsed().as_secs_f64();
    let start = Instant::now();
    let grid = HashedGrid::new(photons, edge);
    println!(
        "{} photons, {ball:?}: {:.1} bytes each; built in {blocks:.3} s by {} threads, kd-tree {seconds:.3} s and grid {:.3} s by one",
        map.len(),
        map.bytes() as f64 / map.len() as f64,
        rayon::current_num_threads(),
        start.elapsed().as_secs_f64(),
    );
    Structures { map, tree, grid }
}

fn main() {
    let count = std::env::args().skip(1).find_map(|a| a.parse().ok()).unwrap_or(1_000_000);
    let density = count as f32 / 125.0;
    let radius_of = |n: f32| (n / density / 4.19).cbrt();
    let eye = DVec3::new(1.0, 2.0, -9.0);
    let photons = photons::even(count);
    for n in [8, 50, 200, 1000] {
        let r = radius_of(n as f32);
        let steps = march(eye, DVec3::ZERO, 2.0, 0.1, 4);
        // The same number of photons either way; cubes of the size that measures best.
        println!("even, {n} photons in a ball:");
        let fixed = Ball::Fixed(r);
        let structures = build(&photons, fixed, 1.2 * r);
        compare("fixed, march", &structures, fixed, &steps);
        compare("fixed, anyhow", &structures, fixed, &anyhow(4000));
        let nearest = Ball::Nearest { neighbours: n, max_radius: 2.0 };
        let structures = build(&photons, nearest, r);
        compare("nearest, march", &structures, nearest, &steps);
        compare("nearest, march in small steps", &structures, nearest, &march(eye, DVec3::ZERO, 2.0, 0.02, 1));
        compare("nearest, anyhow", &structures, nearest, &anyhow(4000));
    }
    let photons = photons::beams(count);
    let steps = march(DVec3::new(1.0, -17.0, 1.0), DVec3::ZERO, 3.0, 0.1, 4);
    println!("beams:");
    let fixed = Ball::Fixed(0.05);
    compare("fixed, march", &build(&photons, fixed, 0.06), fixed, &steps);
    let nearest = Ball::Nearest { neighbours: 50, max_radius: 0.4 };
    compare("nearest, march", &build(&photons, nearest, 0.1), nearest, &steps);
}
