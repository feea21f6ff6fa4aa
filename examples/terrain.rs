//! Makes the rough surfaces of `scenes/jensen` and writes them as meshes.
//!
//! ```sh
//! cargo run --release --example terrain -- waves scenes/jensen/waves.obj.gz
//! cargo run --release --example terrain -- wall scenes/jensen/wall.obj.gz
//! cargo run --release --example terrain -- sand scenes/jensen/sand.obj.gz
//! cargo run --release --example terrain -- mountain scenes/jensen/mountain.obj.gz
//! ```
//!
//! The waves are a sum of sines over a block of water. All others are heights over a square of 256 × 256 cells, each of side 1 (so that
//! files are short), that midpoint displacement makes (Fournier, Fussell and Carpenter 1982): every step halves the cells and moves
//! new points up or down by a random length, which shrinks from step to step. A file whose name ends in `.gz` is compressed.

use flate2::{Compression, GzBuilder};
use std::error::Error;
use std::f64::consts::TAU;
use std::fmt::Write as _;
use std::fs::File;
use std::io::Write as _;

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let mesh = match arguments.first().map(String::as_str) {
        Some("waves") => waves(),
        // A square that fits its neighbours, for each part of a wall.
        Some("wall") => Field::fractal(0.8, 3, Edges::Flat).mesh(30.0),
        // Grains, and no more than ripples.
        Some("sand") => Field::fractal(0.45, 5, Edges::Free).mesh(2.0),
        Some("mountain") => Field::fractal(0.92, 7, Edges::Free).raised().mesh(100.0),
        _ => return Err("expected waves, wall, sand or mountain, and the name of the file to write".into()),
    };
    let path = arguments.get(1).ok_or("expected the name of the file to write")?;
    let (file, text) = (File::create(path)?, mesh.obj());
    if path.ends_with(".gz") {
        let mut out = GzBuilder::new().write(file, Compression::best());
        out.write_all(text.as_bytes())?;
        out.finish()?;
    } else {
        (&file).write_all(text.as_bytes())?;
    }
    println!("{path}: {} vertices, {} triangles", mesh.points.len(), mesh.faces.len());
    Ok(())
}

/// Triangles, counter-clockwise from outside.
struct Mesh {
    points: Vec<[f64; 3]>,
    faces: Vec<[usize; 3]>,
    /// Decimals of the coordinates.
    digits: usize,
}

impl Mesh {
    /// A grid of n × n cells over a square around the y axis, by its heights, seen from above.
    fn grid(n: usize, side: f64, digits: usize, height: impl Fn(usize, usize) -> f64) -> Mesh {
        let at = |i: usize| side * (i as f64 / n as f64 - 0.5);
        let index = |i: usize, j: usize| j * (n + 1) + i;
        let mut mesh = Mesh { points: Vec::new(), faces: Vec::new(), digits };
        for j in 0..=n {
            mesh.points.extend((0..=n).map(|i| [at(i), height(i, j), at(j)]));
        }
        for j in 0..n {
            for i in 0..n {
                let [a, b, c, d] = [index(i, j), index(i, j + 1), index(i + 1, j + 1), index(i + 1, j)];
                // Diagonals take turns, so that slopes have no grain.
                let halves = if (i + j).is_multiple_of(2) { [[a, b, c], [a, c, d]] } else { [[a, b, d], [b, c, d]] };
                mesh.faces.extend(halves);
            }
        }
        mesh
    }

    /// The text of an OBJ file.
    fn obj(&self) -> String {
        let mut text = String::new();
        let number = |x: f64| {
            let text = format!("{x:.*}", self.digits);
            let text = text.trim_end_matches('0').trim_end_matches('.');
            if text == "-0" { "0".to_string() } else { text.to_string() }
        };
        // Faces follow as soon as their points are there and count back from the last: so most lines are alike, and compress to nothing.
        let mut faces: Vec<(usize, [usize; 3])> =
            self.faces.iter().map(|&face| (face.into_iter().max().unwrap_or(0), face)).collect();
        faces.sort_by_key(|(last, _)| *last);
        let mut faces = faces.into_iter().peekable();
        for (k, [x, y, z]) in self.points.iter().enumerate() {
            let _ = writeln!(text, "v {} {} {}", number(*x), number(*y), number(*z));
            while let Some((_, face)) = faces.next_if(|(last, _)| *last == k) {
                let [a, b, c] = face.map(|corner| k + 1 - corner);
                let _ = writeln!(text, "f -{a} -{b} -{c}");
            }
        }
        text
    }
}

/// A block of water 2 across and 1 deep under waves around the height 0: 20 000 triangles on top, and its sides and bottom.
fn waves() -> Mesh {
    const N: usize = 100;
    // Length, direction in turns, height, phase in turns.
    let trains = [
        (0.74, 0.07, 0.0150, 0.1),
        (0.52, 0.29, 0.0120, 0.6),
        (0.41, -0.16, 0.0100, 0.8),
        (0.33, 0.43, 0.0070, 0.35),
        (0.27, 0.18, 0.0045, 0.5),
    ];
    let height = |i: usize, j: usize| {
        let [x, z] = [i, j].map(|k| 2.0 * k as f64 / N as f64 - 1.0);
        let wave = |(length, turn, height, phase): (f64, f64, f64, f64)| {
            let (sin, cos) = (TAU * turn).sin_cos();
            height * (TAU * ((cos * x + sin * z) / length + phase)).sin()
        };
        trains.into_iter().map(wave).sum()
    };
    let mut mesh = Mesh::grid(N, 2.0, 5, height);

    // Around the rim, as it is seen from above counter-clockwise; below it the same line, and a bottom.
    let index = |i: usize, j: usize| j * (N + 1) + i;
    let rim: Vec<usize> = (0..N)
        .map(|k| index(0, k))
        .chain((0..N).map(|k| index(k, N)))
        .chain((0..N).map(|k| index(N, N - k)))
        .chain((0..N).map(|k| index(N - k, 0)))
        .collect();
    let below = mesh.points.len();
    for &top in &rim {
        let [x, _, z] = mesh.points[top];
        mesh.points.push([x, -1.0, z]);
    }
    let middle = mesh.points.len();
    mesh.points.push([0.0, -1.0, 0.0]);
    for k in 0..rim.len() {
        let next = (k + 1) % rim.len();
        let (a, b) = (below + k, below + next);
        mesh.faces.extend([[rim[k], a, b], [rim[k], b, rim[next]], [middle, b, a]]);
    }
    mesh
}

/// What becomes of the edges of a field.
#[derive(Clone, Copy, PartialEq)]
enum Edges {
    /// They lie at 0.
    Flat,
    /// They are displaced as all else.
    Free,
}

/// Cells along the side of a field.
const CELLS: usize = 256;

/// Heights at the corners of cells, row by row.
struct Field(Vec<f64>);

impl Field {
    /// By midpoint displacement, whose random lengths begin with 1 and shrink by 2^−`smoothness` from step to step.
    fn fractal(smoothness: f64, seed: u64, edges: Edges) -> Field {
        let cells = CELLS;
        let mut field = Field(vec![0.0; (cells + 1) * (cells + 1)]);
        let mut random = Random(seed);
        let mut reach = 1.0;
        let mut half = cells / 2;
        while half > 0 {
            // The middles of squares, then those of their sides.
            for j in (half..cells).step_by(2 * half) {
                for i in (half..cells).step_by(2 * half) {
                    let corners =
                        [(i - half, j - half), (i + half, j - half), (i - half, j + half), (i + half, j + half)];
                    field.displace((i, j), &corners, reach * random.next());
                }
            }
            for j in (0..=cells).step_by(half) {
                let first = if (j / half).is_multiple_of(2) { half } else { 0 };
                for i in (first..=cells).step_by(2 * half) {
                    let length = reach * std::f64::consts::FRAC_1_SQRT_2 * random.next();
                    if edges == Edges::Flat && (i == 0 || j == 0 || i == cells || j == cells) {
                        continue;
                    }
                    let mut around = Vec::new();
                    around.extend((i >= half).then(|| (i - half, j)));
                    around.extend((j >= half).then(|| (i, j - half)));
                    around.extend((i + half <= cells).then(|| (i + half, j)));
                    around.extend((j + half <= cells).then(|| (i, j + half)));
                    field.displace((i, j), &around, length);
                }
            }
            reach *= 0.5f64.powf(smoothness);
            half /= 2;
        }
        field
    }

    /// Puts a point at the mean height of others, moved by a length.
    fn displace(&mut self, (i, j): (usize, usize), around: &[(usize, usize)], length: f64) {
        let row = CELLS + 1;
        let sum: f64 = around.iter().map(|(i, j)| self.0[j * row + i]).sum();
        self.0[j * row + i] = sum / around.len() as f64 + length;
    }

    /// Makes a mountain of a fractal: creases of it become ridges, sharper and rougher towards a peak behind the middle.
    fn raised(self) -> Field {
        let raise = |(at, rough): (usize, f64)| {
            let [x, z] = [at % (CELLS + 1), at / (CELLS + 1)].map(|k| 2.0 * k as f64 / CELLS as f64 - 1.0);
            let from_peak = (x - 0.1).hypot(z + 0.3);
            let swell = 0.12 + 0.95 * (-1.9 * from_peak).exp();
            let ridge = 1.0 - rough.abs().min(1.0);
            swell * (0.5 + 0.95 * ridge * ridge)
        };
        Field(self.0.into_iter().enumerate().map(raise).collect())
    }

    /// Its mesh, with heights of so many cells.
    fn mesh(&self, high: f64) -> Mesh {
        Mesh::grid(CELLS, CELLS as f64, 2, |i, j| high * self.0[j * (CELLS + 1) + i])
    }
}

/// Numbers from −1 to 1: SplitMix64 (Steele, Lea and Flood 2014).
struct Random(u64);

impl Random {
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^= z >> 31;
        2.0 * ((z >> 11) as f64 / (1u64 << 53) as f64) - 1.0
    }
}
