//! Whether shapes are what they seem: boundaries of media without leaks, overlaps that mean something, meshes without holes.

use std::collections::{BTreeMap, HashSet};
use std::convert::Infallible;
use std::ops::ControlFlow;

use super::names::Names;
use super::report::{Outcome, Row};
use crate::geometry::Shape;
use crate::math::random::Purpose;
use crate::math::{DVec3, Ray, Stream, sampling};
use crate::scene::{Description, Inside, Scene};
use crate::transport::{Segment, Stop, Visitor, Walk, pass_by_chance};

/// Lines through the solids.
const LINES: u64 = 10_000;
/// Of a line so many pieces are looked at.
const MOST_PIECES: usize = 64;
/// Of a solid so many others that are not there with it are noted at one place.
const MOST_APART: usize = 64;
/// Pieces shorter than this share of the scene are not looked at: their ends round.
const SHORT: f64 = 1e-6;
/// The share of pieces that may disagree by rounding at edges.
const ROUNDING: f64 = 1e-4;
/// Of a mesh so small a share of whose edges lies round what is small beside it, these are holes; of many small sheets they are rims.
const NEARLY: f64 = 0.05;

/// What lines through the solids found.
#[derive(Default)]
struct Found {
    pieces: u64,
    /// Solids about which walk and point disagree, how often, and where first.
    leaks: BTreeMap<u32, (u64, DVec3)>,
    /// Pairs of solids found together, with a place, and each found without the other.
    together: BTreeMap<(u32, u32), DVec3>,
    apart: HashSet<(u32, u32)>,
}

/// Passes whatever there is.
struct Passing<'f> {
    stream: &'f mut Stream,
}

impl Visitor for Passing<'_> {
    type End = Infallible;

    fn segment(&mut self, _: &Segment<'_>) -> ControlFlow<Infallible> {
        ControlFlow::Continue(())
    }

    fn mixture(&mut self, passes: f64, _: bool) -> Option<f64> {
        pass_by_chance(passes, self.stream)
    }
}

/// What a walk that starts inside of these solids is inside of when it has come to parameter `t` of a line, through all that is there.
fn walked(scene: &Scene, ray: &Ray, start: &Inside, t: f64, stream: &mut Stream) -> Inside {
    let mut walk = Walk::new(scene, *ray, start.clone()).until(t);
    loop {
        match walk.advance(&mut Passing { stream }) {
            Stop::Surface(at) => {
                walk.leave(&at, ray.direction);
                // It may be on a line of its own now.
                let left = (ray.at(t) - walk.ray.origin).dot(ray.direction);
                walk = walk.until(left);
            }
            Stop::Escaped => return walk.inside,
            Stop::Ended(never) => match never {},
        }
    }
}

/// Walks along lines through the solids: what a walk is inside of must be what contains the middle of each piece of it, and the last of
/// them is beyond all. What crosses itself, or has a hole, shows.
fn lines(scene: &Scene, seed: u64, stop: &dyn Fn() -> bool) -> Found {
    let mut found = Found::default();
    let bounds = scene.near_bounds();
    let (middle, size) = (bounds.center(), bounds.diagonal());
    for index in 0..LINES {
        if index % 64 == 0 && stop() {
            break;
        }
        let mut stream = Stream::new(seed, Purpose::Pilot, index, u64::MAX - 10);
        let solid = &scene.solids[(index % scene.solids.len() as u64) as usize];
        if !scene.is_near(solid.shape) {
            continue;
        }
        let around = scene.geometry.bounds(solid.shape);
        let within = [(); 3].map(|()| stream.uniform());
        let target = around.min + around.size() * DVec3::from(within);
        let origin = middle + size * sampling::sphere(stream.uniform2());
        let Some(direction) = (target - origin).try_normalize() else { continue };
        line(scene, Ray::new(origin, direction), SHORT * size, &mut stream, &mut found);
    }
    found
}

fn line(scene: &Scene, ray: Ray, short: f64, stream: &mut Stream, found: &mut Found) {
    // Where it crosses boundaries of solids; beyond the last one there is nothing.
    let mut crossings = Vec::new();
    scene.geometry.all_hits(&ray, 0.0, f64::INFINITY, |hit| {
        if scene.surfaces[hit.id as usize].solid.is_some() {
            crossings.push(hit.t);
        }
    });
    crossings.sort_by(f64::total_cmp);
    crossings.extend(crossings.last().map(|last| last + 1e3 * short));
    let start = scene.inside(ray.origin);
    for piece in crossings.windows(2).take(MOST_PIECES).filter(|piece| piece[1] - piece[0] > short) {
        let middle = 0.5 * (piece[0] + piece[1]);
        let (walked, truth) = (walked(scene, &ray, &start, middle, stream), scene.inside(ray.at(middle)));
        found.compare(scene, ray.at(middle), (walked.solids(), truth.solids()));
    }
}

impl Found {
    /// Notes what a walk is inside of at a place, and what contains that.
    fn compare(&mut self, scene: &Scene, p: DVec3, (walked, there): (&[u32], &[u32])) {
        self.pieces += 1;
        let differ = walked.iter().filter(|solid| !there.contains(solid));
        for solid in differ.chain(there.iter().filter(|solid| !walked.contains(solid))) {
            self.leaks.entry(*solid).or_insert((0, p)).0 += 1;
        }
        for (index, &a) in there.iter().enumerate() {
            for &b in &there[index + 1..] {
                self.together.entry((a.min(b), a.max(b))).or_insert(p);
            }
            let others = (0..scene.solids.len() as u32).filter(|b| !there.contains(b));
            self.apart.extend(others.take(MOST_APART).map(|b| (a, b)));
        }
    }
}

/// The boundaries of solids.
pub fn boundaries(
    (scene, description, names): (&Scene, &Description, &Names<'_>),
    seed: u64,
    stop: &dyn Fn() -> bool,
) -> Vec<Row> {
    const LEAKS: &str = "boundaries without leaks";
    const OVERLAPS: &str = "overlaps of solids";
    if scene.solids.is_empty() {
        return vec![Row::not_applicable(LEAKS, "nothing is inside of anything")];
    }
    let found = lines(scene, seed, stop);
    let mut rows = Vec::new();
    let leaks: u64 = found.leaks.values().map(|(count, _)| count).sum();
    let share = leaks as f64 / found.pieces.max(1) as f64;
    let row = match found.leaks.iter().max_by_key(|(_, (count, _))| *count) {
        _ if found.pieces == 0 => Row::not_applicable(LEAKS, "no line crossed a boundary"),
        Some((solid, (count, place))) if share > ROUNDING => Row::new(
            LEAKS,
            Outcome::Fail,
            format!(
                "{} leaks: in {count} of {} places on lines through it, what the line has entered is not what is there, as at {}; it crosses itself, or has a hole",
                names.shape(scene.solids[*solid as usize].shape),
                found.pieces,
                names.place(*place)
            ),
        ),
        _ => Row::new(
            LEAKS,
            Outcome::Pass,
            format!("{leaks} of {} places on lines through solids disagree", found.pieces),
        ),
    };
    rows.push(row.with(share));
    rows.push(overlaps((scene, description, names), &found, OVERLAPS));
    rows
}

/// Solids of one priority that overlap in part: which of them is there is a matter of their order in the file.
fn overlaps((scene, description, names): (&Scene, &Description, &Names<'_>), found: &Found, test: &str) -> Row {
    let said: Vec<_> = description.shapes.iter().filter(|shape| shape.visible).collect();
    let ambiguous = |&(a, b): &(u32, u32)| {
        let solids = [a, b].map(|solid| &scene.solids[solid as usize]);
        let [one, other] = solids.map(|solid| said.get(solid.shape as usize));
        let (Some(one), Some(other)) = (one, other) else { return false };
        let differ = solids[0].medium != solids[1].medium || solids[0].index != solids[1].index;
        let partly = found.apart.contains(&(a, b)) && found.apart.contains(&(b, a));
        differ && partly && one.priority == other.priority && !solids.iter().any(|solid| solid.adds)
    };
    let pairs: Vec<_> = found.together.iter().filter(|(pair, _)| ambiguous(pair)).collect();
    let Some(((a, b), place)) = pairs.first() else {
        return Row::new(
            test,
            Outcome::Pass,
            format!("{} pairs overlap, none of them by chance", found.together.len()),
        )
        .with(0.0);
    };
    let [a, b] = [a, b].map(|solid| names.shape(scene.solids[*solid as usize].shape));
    let more = match pairs.len() {
        1 => String::new(),
        all => format!("; so it is with {} more pairs", all - 1),
    };
    Row::new(
        test,
        Outcome::Fail,
        format!(
            "{a} and {b} overlap in part, as at {}, and have one priority: the later in the file decides what is there; give them a `priority`{more}",
            names.place(**place)
        ),
    )
    .with(pairs.len() as f64)
}

/// The meshes.
pub fn meshes((scene, names): (&Scene, &Names<'_>)) -> Row {
    const TEST: &str = "meshes";
    let mut looked: HashSet<*const crate::geometry::Mesh> = HashSet::new();
    let (mut faces, mut wrong) = (0, Vec::new());
    for (id, placed) in (0..).zip(scene.geometry.placed()) {
        let Shape::Mesh(mesh) = placed.shape() else { continue };
        if !looked.insert(std::sync::Arc::as_ptr(mesh)) {
            continue;
        }
        faces += mesh.triangle_count();
        let flaws = mesh.flaws();
        let share = flaws.holes as f64 / flaws.edges.max(1) as f64;
        let place = flaws.place.map_or(String::new(), |place| {
            format!(", as at {}", names.place(placed.to_world().transform_point3(place)))
        });
        if flaws.flipped > 0 {
            wrong.push(format!(
                "{}: {} edges are of faces wound against each other{place}: some are flipped",
                names.shape(id),
                flaws.flipped
            ));
        } else if flaws.holes > 0 && share < NEARLY {
            wrong.push(format!(
                "{}: {} of {} edges are open and lie round a hole{place}",
                names.shape(id),
                flaws.holes,
                flaws.edges
            ));
        }
    }
    match wrong.first() {
        _ if looked.is_empty() => Row::not_applicable(TEST, "there are none"),
        None => Row::new(
            TEST,
            Outcome::Pass,
            format!("{faces} faces of {} meshes: none is flipped, none is missing", looked.len()),
        )
        .with(0.0),
        Some(first) => Row::new(TEST, Outcome::Fail, first.clone()).with(wrong.len() as f64),
    }
}
