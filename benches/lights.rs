//! Many lights: the error of a path-traced hall against its time, with 1 to 10 000 lights and a lamp of 5000 triangles.
//! `cargo bench --bench lights`, with names of scenes to leave out the others.
//!
//! The hall has coloured walls, pillars and thin fog; half of its lights are points, half are spots that look down, of many
//! colours and of intensities that differ by a factor of ten. The lamp is a knot of triangles that hangs in the middle. Each
//! picture is rendered some times with other seeds, which tells its relative variance, and on one thread, whose seconds count. What
//! is to be compared from one version of the program to the next is their product: seconds to a given error.

use std::fmt::Write;
use std::path::Path;
use std::sync::atomic::AtomicBool;
use volpm::math::DVec3;
use volpm::math::random::{Purpose, Stream};
use volpm::{render, scene};

const HALL: &str = r#"
[camera]
position = [0, -9.5, 2]
target = [0, 0, 2.2]
up = [0, 0, 1]
fov = 60
[film]
width = 24
height = 16
[render]
method = "path"
max_depth = 3
[materials.red]
type = "lambert"
reflectance = [0.7, 0.2, 0.2]
[materials.blue]
type = "lambert"
reflectance = [0.2, 0.3, 0.7]
[materials.white]
type = "lambert"
reflectance = 0.7
[[shapes]]
type = "quad"
origin = [-10, -10, 0]
edge_u = [20, 0, 0]
edge_v = [0, 20, 0]
material = "white"
[[shapes]]
type = "quad"
origin = [-10, -10, 6]
edge_u = [0, 20, 0]
edge_v = [20, 0, 0]
material = "white"
[[shapes]]
type = "quad"
origin = [-10, -10, 0]
edge_u = [0, 20, 0]
edge_v = [0, 0, 6]
material = "red"
[[shapes]]
type = "quad"
origin = [10, -10, 0]
edge_u = [0, 0, 6]
edge_v = [0, 20, 0]
material = "blue"
[[shapes]]
type = "quad"
origin = [-10, 10, 0]
edge_u = [20, 0, 0]
edge_v = [0, 0, 6]
material = "white"
"#;

const FOG: &str = "[world]\nmedium = \"fog\"\n[media.fog]\nsigma_s = 0.03\nsigma_a = 0.005\n";

/// How often each picture is rendered.
const RUNS: u32 = 16;

/// What stands in the hall.
fn pillars(text: &mut String) {
    for (x, y) in [(-5, -3), (5, -3), (-5, 4), (5, 4)] {
        let (low, high) = (format!("[{x}, {y}, 0]"), format!("[{x}, {y}, 6]"));
        let shape = "[[shapes]]\ntype = \"cylinder\"\nradius = 0.6\nmaterial = \"white\"";
        writeln!(text, "{shape}\nbase = {low}\ntop = {high}").unwrap();
    }
}

fn lights(count: usize, text: &mut String) {
    let mut stream = Stream::new(7, Purpose::Test, 0, 0);
    for i in 0..count {
        let [x, y, z] = [0; 3].map(|_| stream.uniform());
        let position = [19.0 * x - 9.5, 19.0 * y - 9.5, 1.0 + 4.8 * z];
        let size = 60.0 / count as f64 * 10f64.powf(stream.uniform());
        let color = [0; 3].map(|_| size * (0.2 + stream.uniform()));
        writeln!(text, "[[lights]]\nposition = {position:?}\nintensity = {color:?}").unwrap();
        if i % 2 == 0 {
            writeln!(text, "type = \"point\"").unwrap();
        } else {
            let target = [0, 1].map(|axis| position[axis] + stream.uniform() - 0.5);
            let outer = 20.0 + 40.0 * stream.uniform();
            let below = [target[0], target[1], position[2] - 1.0];
            writeln!(text, "type = \"spot\"\ntarget = {below:?}").unwrap();
            writeln!(text, "inner_angle = {}\nouter_angle = {outer}", 0.5 * outer).unwrap();
        }
    }
}

/// A knot of 5000 triangles, written beside the scene.
fn knot(folder: &Path, text: &mut String) {
    const AROUND: usize = 250;
    const ACROSS: usize = 10;
    let turn = |i: usize, n: usize| std::f64::consts::TAU * i as f64 / n as f64;
    let line = |a: f64| {
        let r = 2.0 + (3.0 * a).cos();
        DVec3::new(1.6 * r * (2.0 * a).cos(), 1.6 * r * (2.0 * a).sin(), 3.6 + 1.6 * (3.0 * a).sin())
    };
    let mut mesh = String::new();
    for i in 0..AROUND {
        let (p, next) = (line(turn(i, AROUND)), line(turn(i, AROUND) + 1e-3));
        let along = (next - p).normalize();
        let x = along.cross(DVec3::Z).normalize();
        let y = x.cross(along);
        for k in 0..ACROSS {
            let (sin, cos) = turn(k, ACROSS).sin_cos();
            let v = p + 0.15 * (cos * x + sin * y);
            writeln!(mesh, "v {} {} {}", v.x, v.y, v.z).unwrap();
        }
    }
    for i in 0..AROUND {
        for k in 0..ACROSS {
            let at = |i: usize, k: usize| (i % AROUND) * ACROSS + k % ACROSS + 1;
            let [a, b, c, d] = [at(i, k), at(i + 1, k), at(i + 1, k + 1), at(i, k + 1)];
            writeln!(mesh, "f {a} {b} {c}\nf {a} {c} {d}").unwrap();
        }
    }
    std::fs::write(folder.join("knot.obj"), mesh).unwrap();
    text.push_str("[[shapes]]\ntype = \"mesh\"\nfile = \"knot.obj\"\nemission = { radiance = [4, 3, 2] }\n");
}

/// Of the processor, spent by this thread.
fn thread_seconds() -> f64 {
    let mut time = libc::timespec { tv_sec: 0, tv_nsec: 0 };
    unsafe { libc::clock_gettime(libc::CLOCK_THREAD_CPUTIME_ID, &mut time) };
    time.tv_sec as f64 + 1e-9 * time.tv_nsec as f64
}

/// Relative variance, averaged over pixels; and seconds.
fn measure(text: &str, folder: &Path, samples: u32) -> (f64, f64) {
    let (mut sums, mut seconds) = (Vec::new(), 0.0);
    for seed in 0..RUNS {
        let changes = [format!("render.samples={samples}"), format!("render.seed={seed}")];
        let description = scene::parse(text, &folder.join("hall.toml"), &changes).unwrap();
        let (scene, settings) = scene::build(&description).unwrap();
        let start = thread_seconds();
        let rendering = render::render(&scene, &settings, &render::Silent, &AtomicBool::new(false)).unwrap();
        seconds += thread_seconds() - start;
        let image = rendering.film.image();
        sums.resize(image.pixels.len(), [0.0; 2]);
        for (sum, pixel) in sums.iter_mut().zip(&image.pixels) {
            let x = pixel.iter().sum::<f32>() as f64;
            *sum = [sum[0] + x, sum[1] + x * x];
        }
    }
    let runs = f64::from(RUNS);
    let relative = |&[sum, squares]: &[f64; 2]| {
        let mean = sum / runs;
        (squares - runs * mean * mean) / (runs - 1.0) / (mean * mean)
    };
    (sums.iter().map(relative).sum::<f64>() / sums.len() as f64, seconds / runs)
}

fn main() {
    let chosen: Vec<String> = std::env::args().skip(1).filter(|name| !name.starts_with('-')).collect();
    let folder = tempfile::tempdir().unwrap();
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    println!("{:>16} {:>10} {:>10} {:>12}", "scene", "variance", "seconds", "product");
    for (name, count) in [("1", 1), ("10", 10), ("100", 100), ("1000", 1000), ("10000", 10_000), ("lamp", 0)] {
        for fog in [false, true] {
            let name = format!("{name}{}", if fog { "-fog" } else { "" });
            if !chosen.is_empty() && !chosen.contains(&name) {
                continue;
            }
            let mut text = HALL.to_string();
            if fog {
                text.push_str(FOG);
            }
            pillars(&mut text);
            lights(count, &mut text);
            if count == 0 {
                knot(folder.path(), &mut text);
            }
            let samples = if count > 1000 { 16 } else { 64 };
            let (variance, seconds) = pool.install(|| measure(&text, folder.path(), samples));
            println!("{name:>16} {variance:>10.5} {seconds:>10.3} {:>12.6}", variance * seconds);
        }
    }
}
