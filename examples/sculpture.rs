//! Carves the rose of `scenes/marble.toml` and the hand of `scenes/skin.toml` and writes them as meshes.
//!
//! ```sh
//! cargo run --release --example sculpture -- rose scenes/rose.obj.gz
//! cargo run --release --example sculpture -- hand scenes/hand.obj.gz
//! ```
//!
//! A figure is a function that is negative inside: the rose one spiral sheet of stone, thin at the lips of
//! its petals and thick where they grow together; the hand round cones that melt into each other. It is
//! sampled on a grid, and the figure is the zero of the spline through that. A dual mesh (surface
//! nets, Gibson 1998) gets one vertex for each cell that the surface passes; vertices then slide along the
//! surface until they lie evenly and are put on to it by Newton's method. A file whose name ends in `.gz`
//! is compressed. Lengths are millimetres.

use flate2::{Compression, GzBuilder};
use glam::{DVec2, DVec3};
use rayon::prelude::*;
use std::collections::HashMap;
use std::error::Error;
use std::f64::consts::TAU;
use std::fmt::Write as _;
use std::fs::File;
use std::io::Write as _;

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let block = match arguments.first().map(String::as_str) {
        Some("rose") => {
            let (low, high) = (DVec3::new(-14.5, -4.0, -14.5), DVec3::new(14.5, 12.5, 14.5));
            Block::carved(|p| Rose.value(p), low, high, 0.18).polished(2)
        }
        Some("hand") => {
            let (low, high) = (DVec3::new(-42.0, -76.0, -16.0), DVec3::new(30.0, 82.0, 18.0));
            let hand = Hand::new();
            Block::carved(|p| hand.value(p), low, high, 0.55).polished(1)
        }
        _ => return Err("expected rose or hand, and the name of the file to write".into()),
    };
    let path = arguments.get(1).ok_or("expected the name of the file to write")?;
    let mut net = block.net();
    net.relax(&block, 6);
    let mesh = net.triangles();
    let smallest = mesh.check()?;
    let text = mesh.obj();
    let file = File::create(path)?;
    if path.ends_with(".gz") {
        let mut out = GzBuilder::new().write(file, Compression::best());
        out.write_all(text.as_bytes())?;
        out.finish()?;
    } else {
        (&file).write_all(text.as_bytes())?;
    }
    println!("{path}: {} vertices, {} triangles, angles from {smallest:.1}°", mesh.points.len(), mesh.faces.len());
    Ok(())
}

// The rose.

/// A ribbon wound about the y axis, from the bud to the outer petals, after the parametric rose of Paul
/// Nylander. At each turn it leans farther out, its edge waves once a petal, and its lip curls.
struct Rose;

/// What the ribbon is like at one place along its length.
struct Blade {
    /// From the axis to the direction of growth.
    lean: f64,
    /// From root to lip.
    length: f64,
    /// How strongly it bends, as a share of its length.
    bend: f64,
}

impl Rose {
    /// Turns of the ribbon.
    const TURNS: f64 = 5.8;
    /// Petals in a turn: not a whole number, so that petals cover the gaps between those before.
    const PETALS: f64 = 2.618;
    /// The longest petal.
    const LENGTH: f64 = 11.4;
    /// Half the thickness at root and lip.
    const THICKNESS: [f64; 2] = [0.90, 0.36];
    /// Petals that come closer than this grow together.
    const FILLET: f64 = 0.8;

    /// Below 0 inside, and near the surface about the distance from it.
    fn value(&self, p: DVec3) -> f64 {
        let radius = p.x.hypot(p.z);
        let turn = p.z.atan2(p.x) / TAU;
        let half_plane = DVec2::new(radius, p.y);
        let mut value = f64::INFINITY;
        let first = (-1.0 - turn).floor() as i32;
        for whorl in first..=(Self::TURNS + 1.0 - turn).ceil() as i32 {
            let place = turn + f64::from(whorl);
            let on = place.clamp(0.0, Self::TURNS);
            // Beyond its ends, the distance from the end's edge.
            let beyond = TAU * (place - on).abs();
            if beyond > 1.5 {
                continue;
            }
            let blade = Self::blade(on);
            if blade.nearest(half_plane) > value + 2.0 * Self::FILLET + Self::THICKNESS[0] {
                continue;
            }
            let (distance, along) = blade.distance(half_plane);
            // The sheet slants where its edge waves: the distance within the half plane is too long.
            const STEP: f64 = 1e-4;
            let (next, _) = Self::blade((on + STEP).min(Self::TURNS)).distance(half_plane);
            let slope = (next - distance) / (TAU * STEP * radius.max(1.5));
            let distance = (distance / slope.hypot(1.0)).max(distance - 0.6).hypot(radius * 2.0 * (0.5 * beyond).sin());
            let [root, lip] = Self::THICKNESS;
            let thickness = root + (lip - root) * smoothstep(0.1, 1.0, along);
            value = smooth_min(value, distance - thickness, Self::FILLET);
        }
        // ---- the calyx below
        let calyx = DVec3::new(p.x, (p.y + 0.6) * 1.2, p.z).length() / 1.1 - 2.6;
        smooth_min(value, calyx, 1.5)
    }

    /// The ribbon at `place` turns from its beginning.
    fn blade(place: f64) -> Blade {
        let share = place / Self::TURNS;
        let lean = 0.09 + 1.42 * share;
        // From one gap between petals, −1, to the next, 1.
        let across = 2.0 * (place * Self::PETALS).rem_euclid(1.0) - 1.0;
        let gap = 0.2 + 0.3 * smoothstep(0.05, 0.5, share);
        let outline = 1.0 - gap * (1.25 * across * across - 0.25).powi(2);
        let grown = 0.80 + 0.20 * smoothstep(0.0, 0.7, share);
        // It rises from nothing and ends in nothing.
        let ends = smoothstep(-0.02, 0.25, place) * smoothstep(-0.01, 0.16, Self::TURNS - place);
        Blade {
            lean,
            length: Self::LENGTH * outline * grown * (0.35 + 0.65 * ends),
            bend: lean.sin() * (1.0 + 0.45 * share),
        }
    }
}

impl Blade {
    /// Not more than the distance of a point of the half plane.
    fn nearest(&self, p: DVec2) -> f64 {
        // The blade stays this near to the straight.
        const BENDS: f64 = 0.24;
        let axis = DVec2::new(self.lean.sin(), self.lean.cos()) * self.length;
        let foot = (p.dot(axis) / axis.length_squared()).clamp(0.0, 1.0) * axis;
        // Slanting sheets are nearer than they look within the half plane.
        0.5 * (p.distance(foot) - BENDS * self.length)
    }

    /// The distance of a point of the half plane (radius, height) from the blade, and how far along the
    /// blade that is, from 0 to 1.
    fn distance(&self, p: DVec2) -> (f64, f64) {
        let (sin, cos) = self.lean.sin_cos();
        let p = DVec2::new(p.x * sin + p.y * cos, p.x * cos - p.y * sin) / self.length;
        let curve = |u: f64| DVec2::new(u, self.height(u));
        let distance = |u: f64| curve(u).distance_squared(p);
        const PLACES: u32 = 8;
        let start = (0..=PLACES)
            .map(|i| f64::from(i) / f64::from(PLACES))
            .min_by(|a, b| distance(*a).total_cmp(&distance(*b)))
            .unwrap_or(0.0);
        // ---- Newton's method for the foot of the perpendicular
        let mut u = start;
        for _ in 0..5 {
            let (d, slope, bend) = (curve(u) - p, self.slope(u), self.curvature(u));
            let first = d.x + d.y * slope;
            let second = 1.0 + slope * slope + d.y * bend;
            u = (u - first / second.max(0.2)).clamp(start - 1.0 / f64::from(PLACES), start + 1.0 / f64::from(PLACES));
            u = u.clamp(0.0, 1.0);
        }
        (distance(u).sqrt() * self.length, u)
    }

    /// How far it bends outward from the straight: cupped first, then curled at the lip.
    fn height(&self, u: f64) -> f64 {
        1.95 * self.bend * (u * (1.28 * u - 1.0)).powi(2)
    }

    fn slope(&self, u: f64) -> f64 {
        1.95 * self.bend * 2.0 * u * (1.28 * u - 1.0) * (2.56 * u - 1.0)
    }

    fn curvature(&self, u: f64) -> f64 {
        let (a, b) = (u * (1.28 * u - 1.0), 2.56 * u - 1.0);
        1.95 * self.bend * 2.0 * (b * b + 2.56 * a)
    }
}

// The hand.

/// A left hand seen from its palm, fingers up.
struct Hand {
    /// Palm, wrist and thumb, and then each finger: melted together more than with each other.
    parts: Vec<Vec<Cone>>,
}

/// All points within a radius, which changes evenly, of a segment.
struct Cone {
    ends: [DVec3; 2],
    radii: [f64; 2],
}

impl Hand {
    /// Parts and the cones of a part that come closer than this melt together.
    const MELT: [f64; 2] = [3.5, 6.0];

    fn new() -> Self {
        let v = DVec3::new;
        let cone = |a: DVec3, b: DVec3, r: f64, s: f64| Cone { ends: [a, b], radii: [r, s] };
        // ---- base, direction from upright in degrees, bend forward, lengths of the bones, radius
        let fingers = [
            (v(-14.0, 19.0, 0.0), 9.0f64, 7.0f64, [21.0, 13.5, 10.0], 4.7),
            (v(-4.7, 22.5, -0.6), 2.5, 4.0, [23.5, 15.5, 10.5], 4.9),
            (v(4.8, 21.0, -0.3), -4.0, 6.0, [21.5, 14.5, 10.5], 4.6),
            (v(13.4, 16.5, 0.4), -14.0, 10.0, [16.5, 10.5, 9.5], 4.1),
        ];
        let mut palm = vec![
            cone(v(-1.0, -62.0, -0.5), v(-0.5, -24.0, 0.0), 10.5, 9.5),
            cone(v(-7.0, -62.0, -0.5), v(-6.0, -24.0, 0.0), 9.0, 8.5),
            cone(v(6.0, -62.0, -0.5), v(5.5, -24.0, 0.0), 9.0, 8.5),
            // The ball of the thumb and the edge of the hand.
            cone(v(-7.0, -22.0, 2.0), v(-15.0, -4.0, 3.5), 8.0, 7.5),
            cone(v(9.0, -20.0, 1.5), v(13.0, 2.0, 1.5), 7.0, 6.0),
        ];
        let mut parts = Vec::new();
        for (base, lean, bend, bones, radius) in fingers {
            palm.push(cone(v(0.35 * base.x, -22.0, 0.0), base, 7.6, 1.28 * radius));
            let mut finger = Vec::new();
            let (mut from, mut forward, mut r) = (base, 0.5 * bend, 1.08 * radius);
            for (i, bone) in bones.into_iter().enumerate() {
                let (side, front) = (-lean.to_radians(), forward.to_radians());
                let to = from + bone * v(side.sin(), side.cos() * front.cos(), front.sin());
                let s = radius * [0.97, 0.88, 0.72][i];
                finger.push(cone(from, to, r, s));
                (from, forward, r) = (to, forward + 1.6 * bend, s * 0.98);
            }
            parts.push(finger);
        }
        let (root, knuckle, joint, tip) =
            (v(-11.0, -16.0, 3.0), v(-23.5, 0.0, 5.5), v(-30.0, 14.5, 6.5), v(-33.0, 25.0, 6.0));
        parts.push(vec![cone(root, knuckle, 8.0, 6.2), cone(knuckle, joint, 6.0, 5.3), cone(joint, tip, 5.3, 4.1)]);
        parts.push(palm);
        Hand { parts }
    }

    /// Below 0 inside, and near the surface about the distance from it.
    fn value(&self, p: DVec3) -> f64 {
        let [between, within] = Self::MELT;
        let part = |cones: &Vec<Cone>, width: f64| {
            cones.iter().fold(f64::INFINITY, |value, cone| smooth_min(value, cone.value(p), width))
        };
        let palm = self.parts.len() - 1;
        let widths = (0..).map(|i| if i == palm { within } else { 1.5 });
        self.parts
            .iter()
            .zip(widths)
            .fold(f64::INFINITY, |value, (cones, width)| smooth_min(value, part(cones, width), between))
    }
}

impl Cone {
    fn value(&self, p: DVec3) -> f64 {
        let [a, b] = self.ends;
        let share = ((p - a).dot(b - a) / a.distance_squared(b)).clamp(0.0, 1.0);
        p.distance(a.lerp(b, share)) - (self.radii[0] + share * (self.radii[1] - self.radii[0]))
    }
}

/// 0 below `low`, 1 above `high`.
fn smoothstep(low: f64, high: f64, x: f64) -> f64 {
    let x = ((x - low) / (high - low)).clamp(0.0, 1.0);
    x * x * (3.0 - 2.0 * x)
}

/// The smaller of two, rounded where they differ by less than `width`.
fn smooth_min(a: f64, b: f64, width: f64) -> f64 {
    let h = (1.0 - (a - b).abs() / width).max(0.0);
    a.min(b) - 0.25 * width * h * h
}

// The mesh.

/// Quadrilaterals, counter-clockwise seen from outside.
struct Net {
    points: Vec<DVec3>,
    quads: Vec<[u32; 4]>,
}

/// Triangles, counter-clockwise seen from outside.
struct Mesh {
    points: Vec<DVec3>,
    faces: Vec<[u32; 3]>,
}

/// A block of stone: the function at the points of a grid, and between them the cubic B-spline with these
/// coefficients, which has two continuous derivatives whatever the creases of the function.
struct Block {
    low: DVec3,
    cell: f64,
    counts: [usize; 3],
    values: Vec<f64>,
}

impl Block {
    /// `value`, below 0 inside, in the box from `low` to `high`.
    fn carved(value: impl Fn(DVec3) -> f64 + Sync, low: DVec3, high: DVec3, cell: f64) -> Self {
        let counts @ [nx, ny, nz] = ((high - low) / cell).to_array().map(|cells| cells.ceil() as usize + 1);
        let at = |i: usize| DVec3::new((i % nx) as f64, (i / nx % ny) as f64, (i / (nx * ny)) as f64);
        // Only what is near the surface matters.
        let reach = 4.0 * cell;
        let values = (0..nx * ny * nz).into_par_iter();
        let values = values.map(|i| value(low + cell * at(i)).clamp(-reach, reach)).collect();
        Block { low, cell, counts, values }
    }

    fn strides(&self) -> [usize; 3] {
        [1, self.counts[0], self.counts[0] * self.counts[1]]
    }

    /// Each value the mean of it and its neighbours, weighted 1 : 2 : 1, along every axis and `times` over.
    fn polished(mut self, times: u32) -> Self {
        for _ in 0..times {
            for (axis, stride) in self.strides().into_iter().enumerate() {
                let (count, old) = (self.counts[axis], &self.values);
                let mean = |i: usize| {
                    let place = i / stride % count;
                    let before = if place > 0 { i - stride } else { i };
                    let after = if place + 1 < count { i + stride } else { i };
                    0.25 * (old[before] + 2.0 * old[i] + old[after])
                };
                self.values = (0..old.len()).into_par_iter().map(mean).collect();
            }
        }
        self
    }

    /// The spline and its gradient.
    fn value(&self, p: DVec3) -> (f64, DVec3) {
        let place = (p - self.low) / self.cell;
        let most = DVec3::from_array(self.counts.map(|count| count as f64 - 3.001));
        let place = place.clamp(DVec3::ONE, most);
        let first = place.floor();
        let f = (place - first).to_array();
        let weights = f.map(|f| {
            let g = 1.0 - f;
            [g * g * g, 4.0 - 6.0 * f * f + 3.0 * f * f * f, 4.0 - 6.0 * g * g + 3.0 * g * g * g, f * f * f]
                .map(|w| w / 6.0)
        });
        let slopes = f.map(|f| {
            let g = 1.0 - f;
            [-g * g, -f * (4.0 - 3.0 * f), g * (4.0 - 3.0 * g), f * f].map(|w| 0.5 * w / self.cell)
        });
        let [sx, sy, sz] = self.strides();
        let corner = (first.x as usize - 1) * sx + (first.y as usize - 1) * sy + (first.z as usize - 1) * sz;
        let (mut sum, mut slope) = (0.0, DVec3::ZERO);
        for k in 0..4 {
            for j in 0..4 {
                let row = corner + k * sz + j * sy;
                let (mut value, mut along) = (0.0, 0.0);
                for (i, coefficient) in self.values[row..row + 4].iter().enumerate() {
                    value += weights[0][i] * coefficient;
                    along += slopes[0][i] * coefficient;
                }
                let (wy, wz) = (weights[1][j], weights[2][k]);
                sum += wy * wz * value;
                slope += DVec3::new(wy * wz * along, slopes[1][j] * wz * value, wy * slopes[2][k] * value);
            }
        }
        (sum, slope)
    }

    /// One vertex in each cell whose corners differ in sign, one quadrilateral for each edge whose ends do.
    fn net(&self) -> Net {
        let [nx, ny, nz] = self.counts;
        let at = |[x, y, z]: [usize; 3]| self.low + self.cell * DVec3::new(x as f64, y as f64, z as f64);
        let index = |[x, y, z]: [usize; 3]| (z * ny + y) * nx + x;
        let place = |i: usize| [i % nx, i / nx % ny, i / (nx * ny)];
        let mut values: Vec<f64> = (0..self.values.len()).into_par_iter().map(|i| self.value(at(place(i))).0).collect();
        let cells = || (0..values.len()).map(place).filter(|&[x, y, z]| x + 1 < nx && y + 1 < ny && z + 1 < nz);
        let cells: Vec<[usize; 3]> = cells().collect();
        let corner = |[x, y, z]: [usize; 3], i: usize| [x + (i & 1), y + (i >> 1 & 1), z + (i >> 2)];

        // ---- cells that sheets pass twice are filled until none are left: there the net would touch itself
        let simple: Vec<bool> = (0..256).map(is_simple).collect();
        loop {
            let mut last = true;
            for &cell in &cells {
                let corners: [usize; 8] = std::array::from_fn(|i| index(corner(cell, i)));
                let inside = (0..8).filter(|&i| values[corners[i]] < 0.0).fold(0, |signs, i| signs | 1 << i);
                if simple[inside] {
                    continue;
                }
                let outside = corners.into_iter().filter(|&i| values[i] >= 0.0);
                if let Some(nearest) = outside.min_by(|&a, &b| values[a].total_cmp(&values[b])) {
                    values[nearest] = -1e-3 * self.cell;
                    last = false;
                }
            }
            if last {
                break;
            }
        }

        let mut points = Vec::new();
        let mut vertex = HashMap::new();
        for &cell in &cells {
            let (mut sum, mut crossed) = (DVec3::ZERO, 0.0);
            let edges = (0..8).flat_map(|i| [1, 2, 4].map(move |axis| (i, axis)));
            for (i, axis) in edges.filter(|(i, axis)| i & axis == 0) {
                let [p, q] = [i, i | axis].map(|i| corner(cell, i));
                let [a, b] = [p, q].map(|corner| values[index(corner)]);
                if (a < 0.0) != (b < 0.0) {
                    sum += at(p).lerp(at(q), a / (a - b));
                    crossed += 1.0;
                }
            }
            if crossed > 0.0 {
                vertex.insert(index(cell), points.len() as u32);
                points.push(sum / crossed);
            }
        }

        let mut quads = Vec::new();
        let [sx, sy, sz] = self.strides();
        for &cell in cells.iter().filter(|cell| cell.iter().all(|&place| place > 0)) {
            let i = index(cell);
            let here = values[i] < 0.0;
            for (next, u, v) in [(sx, sy, sz), (sy, sz, sx), (sz, sx, sy)] {
                if here == (values[i + next] < 0.0) {
                    continue;
                }
                let mut quad = [i - u - v, i - v, i, i - u].map(|i| vertex[&i]);
                if !here {
                    quad.reverse();
                }
                quads.push(quad);
            }
        }
        Net { points, quads }
    }
}

/// Whether the corners of a cube, a bit for each inside, are parted by one sheet that crosses no face twice.
fn is_simple(inside: usize) -> bool {
    let faces = [[0, 1, 3, 2], [4, 5, 7, 6], [0, 1, 5, 4], [2, 3, 7, 6], [0, 2, 6, 4], [1, 3, 7, 5]];
    let twice = faces.iter().any(|face| {
        let [a, b, c, d] = face.map(|corner| inside >> corner & 1);
        a == c && b == d && a != b
    });
    !twice && is_connected(inside) && is_connected(!inside & 0xff)
}

/// Whether corners of a cube, a bit for each, hang together by its edges.
fn is_connected(corners: usize) -> bool {
    let mut reached = corners & corners.wrapping_neg();
    for _ in 0..8 {
        let x = (reached & 0x55) << 1 | (reached & 0xaa) >> 1;
        let y = (reached & 0x33) << 2 | (reached & 0xcc) >> 2;
        let z = (reached & 0x0f) << 4 | (reached & 0xf0) >> 4;
        reached |= (x | y | z) & corners;
    }
    reached == corners
}

impl Net {
    /// Slides vertices along the surface towards the middle of their neighbours, some rounds, and then puts
    /// them on to it.
    fn relax(&mut self, block: &Block, rounds: u32) {
        let mut neighbours = vec![Vec::new(); self.points.len()];
        for &[a, b, c, d] in &self.quads {
            // Each edge belongs to two quadrilaterals, once in each direction.
            for (from, to) in [(a, b), (b, c), (c, d), (d, a)] {
                neighbours[from as usize].push(to);
            }
        }
        for round in 0..rounds {
            let steps = if round + 1 == rounds { 6 } else { 1 };
            let slid = self.points.par_iter().zip(&neighbours).map(|(&p, around)| {
                let middle = around.iter().map(|&i| self.points[i as usize]).sum::<DVec3>() / around.len() as f64;
                let normal = block.value(p).1.normalize_or_zero();
                let way = 0.6 * (middle - p);
                let mut p = p + way - way.dot(normal) * normal;
                for _ in 0..steps {
                    let (value, slope) = block.value(p);
                    let way = -value / slope.length_squared().max(0.01) * slope;
                    p += way.clamp_length_max(0.5 * block.cell);
                }
                p
            });
            self.points = slid.collect();
        }
    }

    /// Cut along the diagonals that leave the larger angles. Where creases have piled vertices up, they first
    /// go back to the middle of their neighbours.
    fn triangles(mut self) -> Mesh {
        const NARROW: f64 = 10.0;
        for _ in 0..200 {
            let mut crowded = vec![[0.0; 4]; self.points.len()];
            let narrow = |quad: &&[u32; 4]| self.cut(quad).1 < NARROW;
            let narrow: Vec<bool> = self.quads.par_iter().map(|quad| narrow(&quad)).collect();
            let mut moves = vec![false; self.points.len()];
            for quad in self.quads.iter().zip(&narrow).filter(|(_, narrow)| **narrow).flat_map(|(quad, _)| quad) {
                moves[*quad as usize] = true;
            }
            for &[a, b, c, d] in &self.quads {
                for (at, next) in [(a, b), (b, c), (c, d), (d, a)] {
                    if moves[at as usize] {
                        let [x, y, z] = self.points[next as usize].to_array();
                        let sum = &mut crowded[at as usize];
                        *sum = [sum[0] + x, sum[1] + y, sum[2] + z, sum[3] + 1.0];
                    }
                }
            }
            for (point, [x, y, z, count]) in self.points.iter_mut().zip(crowded).filter(|(_, sum)| sum[3] > 0.0) {
                *point = point.lerp(DVec3::new(x, y, z) / count, 0.5);
            }
        }
        let faces = self.quads.iter().flat_map(|quad| self.cut(quad).0).collect();
        Mesh { faces, points: self.points }
    }

    /// Two triangles and their smallest angle.
    fn cut(&self, &[a, b, c, d]: &[u32; 4]) -> ([[u32; 3]; 2], f64) {
        let (one, other) = ([[a, b, c], [a, c, d]], [[a, b, d], [b, c, d]]);
        let angle = |[f, g]: &[[u32; 3]; 2]| smallest_angle(&self.points, f).min(smallest_angle(&self.points, g));
        let (first, second) = (angle(&one), angle(&other));
        if first >= second { (one, first) } else { (other, second) }
    }
}

/// In degrees.
fn smallest_angle(points: &[DVec3], face: &[u32; 3]) -> f64 {
    let [a, b, c] = face.map(|i| points[i as usize]);
    let angles = [(a, b, c), (b, c, a), (c, a, b)].map(|(p, q, r)| (q - p).angle_between(r - p));
    angles.into_iter().fold(f64::INFINITY, f64::min).to_degrees()
}

impl Mesh {
    /// The smallest angle of a triangle, in degrees, of a mesh in which every edge joins two triangles that
    /// are wound alike and every triangle has an area.
    fn check(&self) -> Result<f64, String> {
        let mut edges = HashMap::with_capacity(3 * self.faces.len());
        for &[a, b, c] in &self.faces {
            for edge in [(a, b), (b, c), (c, a)] {
                *edges.entry(edge).or_insert(0) += 1;
            }
        }
        let open = edges.iter().filter(|((a, b), count)| **count != 1 || !edges.contains_key(&(*b, *a))).count();
        if open > 0 {
            return Err(format!("{open} edges do not join two triangles: the cells are too large for the shape"));
        }
        let smallest = self.faces.iter().map(|face| smallest_angle(&self.points, face)).fold(f64::INFINITY, f64::min);
        if smallest < 1.0 { Err(format!("a triangle with an angle of {smallest}°")) } else { Ok(smallest) }
    }

    /// As a Wavefront OBJ file. Faces name their vertices soon after these come, counted back from the
    /// latest: short numbers, many of them alike, which compresses well.
    fn obj(&self) -> String {
        let mut faces = vec![Vec::new(); self.points.len()];
        for face in &self.faces {
            let last = face[0].max(face[1]).max(face[2]);
            faces[last as usize].push(*face);
        }
        let mut text = String::from("# Carved by examples/sculpture.rs; millimetres\n");
        for (i, p) in self.points.iter().enumerate() {
            let _ = writeln!(text, "v {:.4} {:.4} {:.4}", p.x, p.y, p.z);
            for face in &faces[i] {
                let [a, b, c] = face.map(|k| i64::from(k) - i as i64 - 1);
                let _ = writeln!(text, "f {a} {b} {c}");
            }
        }
        text
    }
}
