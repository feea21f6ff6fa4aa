use super::mesh::Parts;
use super::{Mesh, ellipsoid};
use crate::math::{Bounds, DAffine3, DMat3, DVec2, DVec3, Distribution, Ray};
use crate::{Error, Result};
use std::f64::consts::{FRAC_1_PI, PI, TAU};

/// A polyline of points (radius, height) turned about the y axis: cones, cylinders, rings and discs, one for
/// each piece of the line, which are its primitives. Closed if both ends lie on the axis or coincide; out is
/// then away from the inside, whichever way the line is drawn. Out of an open one is to the right of
/// the line, radius to the right and height upwards: away from the axis where it rises.
#[derive(Clone, Debug)]
pub struct Lathe {
    pieces: Vec<Piece>,
    /// Rings around runs of pieces: those around all, halves, quarters and so on, in a binary heap whose
    /// last row are the pieces; empty ones fill it up.
    rings: Vec<Ring>,
    closed: bool,
    /// The pieces' areas.
    areas: Distribution,
}

/// More points are refused: whether a line crosses itself takes quadratic time to find out.
const MOST_POINTS: usize = 10_000;

/// Facets of a lathe that has flat ones, at most.
const MOST_FACETS: usize = 1_000_000;

/// A piece of the line, which is not on the axis.
#[derive(Clone, Copy, Debug)]
struct Piece {
    /// (radius, height)
    ends: [DVec2; 2],
    /// Out; of unit length.
    normal: DVec2,
    /// To shade with at the ends, of unit length: means with the neighbours' where the kink is slight.
    smooth: [DVec2; 2],
    /// How much of the line's length lies before the ends.
    along: [f64; 2],
}

/// What lies between two radii and two heights.
#[derive(Clone, Copy, Debug)]
struct Ring {
    min: DVec2,
    max: DVec2,
}

/// A ray, seen from the axis. Heights are met at one parameter each, radii are a convex function of it.
struct Turned<'a> {
    ray: &'a Ray,
    across: DVec2,
    /// Parameter for height.
    rise: f64,
    /// Where it comes closest to the axis.
    closest: f64,
}

impl Lathe {
    /// Whether a lathe of this profile has an inside.
    pub fn closes(profile: &[DVec2]) -> bool {
        match profile {
            [first, .., last] => first.x == 0.0 && last.x == 0.0 || profile.len() > 3 && first == last,
            _ => false,
        }
    }

    /// The polyline through `profile` turned about the y axis. Kinks between pieces that turn by less than
    /// `crease`, in radians, are shaded round.
    ///
    /// # Errors
    /// When there are fewer than two points, a number is not finite, a radius below 0, two points in a row
    /// coincide, the whole line lies on the axis, or a closed line crosses or touches itself.
    pub fn new(profile: &[DVec2], crease: f64) -> Result<Self> {
        let turn = orientation(profile)?;
        let closed = Lathe::closes(profile);
        let count = profile.len() - 1;
        let ends = |i: usize| [profile[i], profile[i + 1]];
        let normal = |i: usize| -turn * (profile[i + 1] - profile[i]).normalize().perp();
        let on_axis = |i: usize| profile[i].x == 0.0 && profile[i + 1].x == 0.0;
        let loops = closed && profile[0] == profile[count];
        // The mean of a piece's normal and that of the next, or of the one before, if the kink is slight.
        let mean = |i: usize, other: Option<usize>| match other.filter(|&other| !on_axis(other)) {
            Some(other) if normal(i).dot(normal(other)) > crease.cos() => (normal(i) + normal(other)).normalize(),
            _ => normal(i),
        };
        // Where the line meets the axis, it meets its own mirror image.
        let tip = |i: usize, end: usize| {
            let n = normal(i);
            let upright = DVec2::new(0.0, n.y.signum());
            let slight = profile[end].x == 0.0 && n.dot(DVec2::new(-n.x, n.y)) > crease.cos();
            slight.then_some(upright)
        };
        let mut along = 0.0;
        let mut pieces = Vec::with_capacity(count);
        for i in (0..count).filter(|&i| !on_axis(i)) {
            let before = if i > 0 { Some(i - 1) } else { loops.then_some(count - 1) };
            let after = if i + 1 < count { Some(i + 1) } else { loops.then_some(0) };
            let smooth =
                [tip(i, i).unwrap_or_else(|| mean(i, before)), tip(i, i + 1).unwrap_or_else(|| mean(i, after))];
            let length = profile[i].distance(profile[i + 1]);
            pieces.push(Piece { ends: ends(i), normal: normal(i), smooth, along: [along, along + length] });
            along += length;
        }
        if pieces.is_empty() {
            return Err(Error::Scene("a lathe whose profile lies on the axis: expected a radius above 0".into()));
        }
        // ---- rings from pieces up to all
        let width = pieces.len().next_power_of_two();
        let mut rings = vec![Ring::EMPTY; 2 * width];
        for (ring, piece) in rings[width..].iter_mut().zip(&pieces) {
            *ring = Ring { min: piece.ends[0].min(piece.ends[1]), max: piece.ends[0].max(piece.ends[1]) };
        }
        for i in (1..width).rev() {
            let (a, b) = (rings[2 * i], rings[2 * i + 1]);
            rings[i] = Ring { min: a.min.min(b.min), max: a.max.max(b.max) };
        }
        let areas = Distribution::new(pieces.iter().map(Piece::area));
        Ok(Lathe { areas, pieces, rings, closed })
    }

    /// A mesh in the place of a lathe of this profile, with `segments` flat facets around the axis. Kinks between facets that turn by less
    /// than `crease`, in radians, are shaded round.
    ///
    /// # Errors
    /// As [`Lathe::new`], for fewer than three segments, and for more than a million facets.
    pub fn facets(profile: &[DVec2], segments: u32, crease: f64) -> Result<Mesh> {
        let lathe = Lathe::new(profile, crease)?;
        if segments < 3 {
            return Err(Error::Scene(format!("a lathe with {segments} segments: expected at least 3")));
        }
        let facets = segments as usize * lathe.pieces.len();
        if facets > MOST_FACETS {
            return Err(Error::Scene(format!(
                "a lathe of {facets} facets: expected at most {MOST_FACETS}; without segments it is round"
            )));
        }
        let step = TAU / f64::from(segments);
        let round = step < crease;
        let mut parts = Parts::default();
        for piece in &lathe.pieces {
            for k in 0..segments {
                // The last column is the first once more, to the bit.
                let turns = [k, (k + 1) % segments].map(|k| (f64::from(k) * step).sin_cos());
                let middle = ((f64::from(k) + 0.5) * step).sin_cos();
                let first = parts.positions.len() as u32;
                for (end, smooth) in piece.ends.into_iter().zip(piece.smooth) {
                    for turn in turns {
                        parts.positions.push(around(end, turn).as_vec3());
                        let normal = if round { around(smooth, turn) } else { around(smooth, middle) };
                        parts.normals.push(normal.as_vec3());
                    }
                }
                // Around a, b, c, d goes the turn first, then the line: counter-clockwise seen from its left.
                let [a, b, c, d] = [first, first + 1, first + 3, first + 2];
                let left = piece.normal.dot((piece.ends[1] - piece.ends[0]).perp()) > 0.0;
                let mut push = |x: u32, y: u32, z: u32| {
                    parts.triangles.push(if left { [x, y, z] } else { [x, z, y] });
                };
                if piece.ends[0].x > 0.0 {
                    push(a, b, c);
                }
                if piece.ends[1].x > 0.0 {
                    push(a, c, d);
                }
            }
        }
        Mesh::from_parts(parts, true)
    }

    pub(super) fn is_closed(&self) -> bool {
        self.closed
    }

    pub(super) fn bounds(&self, m: &DAffine3) -> Bounds {
        let ends = self.pieces.iter().flat_map(|piece| piece.ends);
        ends.fold(Bounds::EMPTY, |bounds, end| {
            let center = m.transform_point3(DVec3::new(0.0, end.y, 0.0));
            let radii = [DVec3::X, DVec3::Z].map(|axis| m.transform_vector3(end.x * axis));
            bounds.union(ellipsoid::bounds_about(center, &radii))
        })
    }

    /// Pieces that share an end ask the same question there, whether the ray passes inside of it, so no ray
    /// slips between them: every entry into a closed lathe has its exit.
    pub(super) fn crossings(&self, ray: &Ray, visit: &mut impl FnMut(f64, u32)) {
        let turned = Turned::new(ray);
        let first = self.rings.len() / 2;
        // Each level leaves one node behind.
        let mut pending = [0u32; usize::BITS as usize];
        let mut count = 1;
        pending[0] = 1;
        while count > 0 {
            count -= 1;
            let node = pending[count] as usize;
            if !turned.meets(&self.rings[node]) {
                continue;
            }
            if node < first {
                pending[count] = 2 * node as u32 + 1;
                pending[count + 1] = 2 * node as u32;
                count += 2;
            } else if let Some(piece) = self.pieces.get(node - first) {
                turned.crossings(piece, &mut |t| visit(t, (node - first) as u32));
            }
        }
    }

    pub(super) fn normal(&self, p: DVec3, piece: u32) -> DVec3 {
        let n = self.pieces[piece as usize].normal;
        let (sin, cos) = turn_of(p);
        around(n, (sin, cos))
    }

    /// Between the normals at the ends of a piece, not normalised.
    pub(super) fn shading_normal(&self, p: DVec3, piece: u32) -> DVec3 {
        let piece = &self.pieces[piece as usize];
        around(piece.smooth[0].lerp(piece.smooth[1], piece.share(half_plane(p))), turn_of(p))
    }

    /// The share of a full turn, and of the length of the profile.
    pub(super) fn uv(&self, p: DVec3, piece: u32) -> [f64; 2] {
        let piece = &self.pieces[piece as usize];
        let length = self.pieces.last().map_or(1.0, |last| last.along[1]);
        let share = piece.share(half_plane(p));
        let along = piece.along[0] + share * (piece.along[1] - piece.along[0]);
        [0.5 - p.z.atan2(p.x) * (0.5 * FRAC_1_PI), along / length]
    }

    /// ∂p/∂u and ∂p/∂v.
    pub(super) fn tangents(&self, p: DVec3, piece: u32) -> [DVec3; 2] {
        let length = self.pieces.last().map_or(1.0, |last| last.along[1]);
        let [a, b] = self.pieces[piece as usize].ends;
        let up = (b - a).normalize_or(DVec2::Y) * length;
        let (sin, cos) = turn_of(p);
        [TAU * DVec3::new(p.z, 0.0, -p.x), DVec3::new(up.x * cos, up.y, up.x * sin)]
    }

    /// Whether a way straight out from the axis crosses the profile an odd number of times.
    pub(super) fn contains(&self, p: DVec3) -> bool {
        let p = half_plane(p);
        let crosses = |piece: &&Piece| {
            let [a, b] = piece.ends;
            (a.y <= p.y) != (b.y <= p.y) && {
                // Beyond the piece's line, seen so that rounding is the same whichever way it is drawn.
                let (low, high) = if a.y < b.y { (a, b) } else { (b, a) };
                (p - low).perp_dot(high - low) < 0.0
            }
        };
        self.closed && self.pieces.iter().filter(crosses).count() % 2 == 1
    }

    pub(super) fn area(&self) -> f64 {
        self.areas.total()
    }

    /// The area after `m`, which stretches space unequally. The mean of each piece's area over the turn
    /// is that of a smooth periodic function, by the trapezoidal rule.
    pub(super) fn stretched_area(&self, m: &DMat3) -> f64 {
        const PLACES: u32 = 512;
        let cofactors = m.determinant() * m.inverse().transpose();
        let ratio = |n: DVec2| {
            let turns = (0..PLACES).map(|i| (TAU * f64::from(i) / f64::from(PLACES)).sin_cos());
            turns.map(|turn| (cofactors * around(n, turn)).length()).sum::<f64>() / f64::from(PLACES)
        };
        self.pieces.iter().map(|piece| piece.area() * ratio(piece.normal)).sum()
    }

    /// A piece by area, and a point on it.
    pub(super) fn sample(&self, [u, v]: [f64; 2]) -> (DVec3, u32) {
        let (index, u) = self.areas.choose(u).map_or((0, u), |choice| (choice.index, choice.rest));
        let [a, b] = self.pieces[index].ends;
        // Density in proportion to the radius: r² is uniform between a² and b².
        let share = u * (a.x + b.x) / (a.x + (a.x * a.x + u * (b.x * b.x - a.x * a.x)).sqrt());
        let end = a.lerp(b, if share.is_finite() { share.min(1.0) } else { 0.0 });
        (around(end, (TAU * v).sin_cos()), index as u32)
    }

    /// Calls `visit` with each piece and its point closest to `p` after `m`, which stretches all
    /// directions alike if `similar`; `local` is `p` before.
    pub(super) fn closest(
        &self,
        (p, local): (DVec3, DVec3),
        m: &DAffine3,
        similar: bool,
        mut visit: impl FnMut(u32, DVec3),
    ) {
        for (i, piece) in self.pieces.iter().enumerate() {
            let closest = if similar {
                let end = piece.ends[0].lerp(piece.ends[1], piece.share(half_plane(local)));
                m.transform_point3(around(end, turn_of(local)))
            } else {
                ellipsoid::closest_of_turn(p, |cos, sin| {
                    let [a, b] = piece.ends.map(|end| m.transform_point3(around(end, (sin, cos))));
                    let edge = b - a;
                    a + ((p - a).dot(edge) / edge.length_squared()).clamp(0.0, 1.0) * edge
                })
            };
            visit(i as u32, closest);
        }
    }
}

impl Piece {
    /// A frustum's side is 2π times its mean radius times its length.
    fn area(&self) -> f64 {
        PI * (self.ends[0].x + self.ends[1].x) * self.ends[0].distance(self.ends[1])
    }

    /// How far along the piece its point closest to `p` is.
    fn share(&self, p: DVec2) -> f64 {
        let edge = self.ends[1] - self.ends[0];
        ((p - self.ends[0]).dot(edge) / edge.length_squared()).clamp(0.0, 1.0)
    }
}

impl Ring {
    const EMPTY: Ring = Ring { min: DVec2::INFINITY, max: DVec2::NEG_INFINITY };
}

impl<'a> Turned<'a> {
    fn new(ray: &'a Ray) -> Self {
        let across = DVec2::new(ray.direction.x, ray.direction.z);
        let closest = -DVec2::new(ray.origin.x, ray.origin.z).dot(across) / across.length_squared();
        let rise = ray.direction.y.recip();
        Turned { ray, across, rise, closest: if closest.is_finite() { closest } else { 0.0 } }
    }

    /// The squared distance from the axis.
    fn radius2(&self, t: f64) -> f64 {
        (DVec2::new(self.ray.origin.x, self.ray.origin.z) + t * self.across).length_squared()
    }

    /// The parameter at which the ray has a height.
    fn at_height(&self, height: f64) -> f64 {
        (height - self.ray.origin.y) * self.rise
    }

    /// Whether the ray may meet the ring; errs on the side of yes.
    fn meets(&self, ring: &Ring) -> bool {
        const SLACK: f64 = 1e-6;
        if ring.min.y > ring.max.y {
            return false;
        }
        if self.ray.direction.y == 0.0 {
            let y = self.ray.origin.y;
            return y >= ring.min.y && y <= ring.max.y;
        }
        let (low, high) = (self.at_height(ring.min.y), self.at_height(ring.max.y));
        let (start, end) = (low.min(high), low.max(high));
        let nearest = self.radius2(self.closest.max(start).min(end));
        let farthest = self.radius2(start).max(self.radius2(end));
        let scale = SLACK * (farthest + ring.max.x * ring.max.x);
        // What is not a number is not known.
        !(nearest > ring.max.x * ring.max.x + scale || farthest < ring.min.x * ring.min.x - scale)
    }

    fn crossings(&self, piece: &Piece, visit: &mut impl FnMut(f64)) {
        let [a, b] = piece.ends;
        if self.ray.direction.y == 0.0 {
            self.level(piece, visit);
            return;
        }
        let [ta, tb] = [a, b].map(|end| self.at_height(end.y));
        let inside = |t: f64, radius: f64| self.radius2(t) < radius * radius;
        let (in_a, in_b) = (inside(ta, a.x), inside(tb, b.x));
        if a.y == b.y {
            if in_a != in_b && ta.is_finite() {
                visit(ta);
            }
            return;
        }
        // From the point of the piece's stretch that is closest to the axis, differences stay small.
        let (start, end) = (ta.min(tb), ta.max(tb));
        let from = self.closest.max(start).min(end);
        let (in_start, in_end) = if ta < tb { (in_a, in_b) } else { (in_b, in_a) };
        // Seen from the axis, the ray runs along a convex curve: inside at both ends, it stays inside.
        if in_start && in_end || !from.is_finite() {
            return;
        }
        let Some([first, second]) = self.roots(piece, from) else {
            // Roots lost to rounding where the ends differ: it is at one of the ends.
            if in_start != in_end {
                let off = |t: f64, radius: f64| (self.radius2(t) - radius * radius).abs();
                visit(if off(ta, a.x) < off(tb, b.x) { ta } else { tb });
            }
            return;
        };
        match (in_start, in_end) {
            (false, true) => visit(first.max(start).min(end)),
            (true, false) => visit(second.max(start).min(end)),
            // In and out again: both within the stretch or both beyond it, which the middle tells best.
            _ => {
                let middle = 0.5 * (first + second);
                if first < second && middle > start && middle < end {
                    visit(first.max(start));
                    visit(second.min(end));
                }
            }
        }
    }

    /// Where the ray enters and leaves the double cone, on the half that holds the piece: with the
    /// piece's normal n, where n_r ρ(t) = c − n_y y(t), squared. `None` where it does neither. With n_r
    /// above 0, what lies within is less than c: roots are ordered so that the first enters.
    fn roots(&self, piece: &Piece, from: f64) -> Option<[f64; 2]> {
        let n = piece.normal * piece.normal.x.signum();
        let o = DVec2::new(self.ray.origin.x, self.ray.origin.z) + from * self.across;
        let height = self.ray.origin.y + from * self.ray.direction.y;
        // c − n_y y at the start, taken from the end nearer in height.
        let [a, b] = piece.ends;
        let near = if (height - a.y).abs() < (height - b.y).abs() { a } else { b };
        let rest = n.x * near.x - n.y * (height - near.y);
        let slope = n.y * self.ray.direction.y;
        let (nx2, x2) = (n.x * n.x, self.across.length_squared());
        let a = nx2 * x2 - slope * slope;
        let half_b = nx2 * o.dot(self.across) + rest * slope;
        let c = nx2 * o.length_squared() - rest * rest;
        let discriminant = half_b * half_b - a * c;
        if discriminant < 0.0 {
            return None;
        }
        let q = -(half_b + discriminant.sqrt().copysign(half_b));
        let (mut roots, mut count) = ([0.0; 2], 0);
        for root in [q / a, c / q] {
            // On the other half of the double cone the radius would be below 0.
            if root.is_finite() && rest - slope * root >= 0.0 {
                roots[count] = from + root;
                count += 1;
            }
        }
        match count {
            // One root: before it or after it the ray is inside for ever.
            1 => Some([roots[0]; 2]),
            2 => Some([roots[0].min(roots[1]), roots[0].max(roots[1])]),
            _ => None,
        }
    }

    /// A ray across the axis meets each height for ever or never.
    fn level(&self, piece: &Piece, visit: &mut impl FnMut(f64)) {
        let [a, b] = piece.ends;
        let y = self.ray.origin.y;
        if (a.y <= y) == (b.y <= y) {
            return;
        }
        let (low, high) = if a.y < b.y { (a, b) } else { (b, a) };
        let radius = low.x + (high.x - low.x) * ((y - low.y) / (high.y - low.y));
        let room = radius * radius - self.radius2(self.closest);
        if room > 0.0 {
            let half = (room / self.across.length_squared()).sqrt();
            visit(self.closest - half);
            visit(self.closest + half);
        }
    }
}

/// The half plane's point or vector (radius, height) after a turn of this sine and cosine.
fn around(p: DVec2, (sin, cos): (f64, f64)) -> DVec3 {
    DVec3::new(p.x * cos, p.y, p.x * sin)
}

fn half_plane(p: DVec3) -> DVec2 {
    DVec2::new(DVec2::new(p.x, p.z).length(), p.y)
}

/// Sine and cosine of the turn to `p`.
fn turn_of(p: DVec3) -> (f64, f64) {
    let radius = DVec2::new(p.x, p.z).length();
    if radius > 0.0 { (p.z / radius, p.x / radius) } else { (0.0, 1.0) }
}

/// 1 if out is to the right of the line, else −1; refuses what is no profile.
fn orientation(profile: &[DVec2]) -> Result<f64> {
    let wrong = |message: String| Err(Error::Scene(format!("the profile of a lathe {message}")));
    if profile.len() < 2 {
        return wrong(format!("has {} points: expected at least 2", profile.len()));
    }
    if profile.len() > MOST_POINTS {
        return wrong(format!("has {} points: expected at most {MOST_POINTS}", profile.len()));
    }
    for (i, p) in profile.iter().enumerate() {
        if !p.is_finite() || p.x < 0.0 {
            return wrong(format!("has the point {i} at {p}: expected finite numbers and a radius of 0 or more"));
        }
        if i > 0 && *p == profile[i - 1] {
            return wrong(format!("has the points {} and {i} at the same place, {p}: expected one of them", i - 1));
        }
    }
    if !Lathe::closes(profile) {
        return Ok(1.0);
    }
    let loops = profile[0] == profile[profile.len() - 1];
    let segments: Vec<[DVec2; 2]> = profile.windows(2).map(|pair| [pair[0], pair[1]]).collect();
    for (i, s) in segments.iter().enumerate() {
        for (j, t) in segments.iter().enumerate().skip(i + 1) {
            let (next, last) = (j == i + 1, loops && i == 0 && j + 1 == segments.len());
            // Neighbours share an end; more only where the line turns back on itself.
            let (u, v) = (s[1] - s[0], t[1] - t[0]);
            let back = u.perp_dot(v) == 0.0 && u.dot(v) < 0.0;
            if if next || last { back } else { touch(s, t) } {
                return wrong(format!(
                    "crosses or touches itself between the points {i} and {} and {j} and {}: expected an outline",
                    i + 1,
                    j + 1
                ));
            }
        }
    }
    // Twice the area to the left; the way back along the axis adds nothing.
    let first = profile[0];
    let twice: f64 = segments.iter().map(|[a, b]| (*a - first).perp_dot(*b - first)).sum();
    Ok(if twice >= 0.0 { 1.0 } else { -1.0 })
}

/// Whether two segments share a point. Two that meet the axis may share one there: the surface then pinches.
fn touch([a, b]: &[DVec2; 2], [c, d]: &[DVec2; 2]) -> bool {
    let apart = a.max(*b).cmplt(c.min(*d)).any() || c.max(*d).cmplt(a.min(*b)).any();
    if apart {
        return false;
    }
    let shared = [a, b].into_iter().find(|p| p.x == 0.0 && (*p == c || *p == d));
    if let Some(p) = shared {
        let (s, t) = (if p == a { b } else { a }, if p == c { d } else { c });
        return s.x == 0.0 && t.x == 0.0;
    }
    let side = |p: &DVec2, q: &DVec2, r: &DVec2| (*q - *p).perp_dot(*r - *p);
    let (e, f) = (side(a, b, c), side(a, b, d));
    let (g, h) = (side(c, d, a), side(c, d, b));
    e * f <= 0.0 && g * h <= 0.0
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{Cluster, Geometry, Placed, Shape};
    use crate::math::Stream;
    use crate::math::random::Purpose;
    use std::sync::Arc;

    fn points(profile: &[[f64; 2]]) -> Vec<DVec2> {
        profile.iter().map(|p| DVec2::from_array(*p)).collect()
    }

    fn placed(lathe: Lathe) -> Geometry {
        Geometry::new(vec![Placed::new(Shape::Lathe(Arc::new(lathe)), DAffine3::IDENTITY).unwrap()])
    }

    /// A half circle of `pieces`.
    fn ball(pieces: u32) -> Vec<DVec2> {
        let point = |i: u32| {
            let (sin, cos) = (PI * f64::from(i) / f64::from(pieces)).sin_cos();
            DVec2::new(if i == 0 || i == pieces { 0.0 } else { sin }, -cos)
        };
        (0..=pieces).map(point).collect()
    }

    #[test]
    fn no_ray_slips_through_the_rings_between_pieces() {
        let lathe = Lathe::new(&ball(40), 0.5).unwrap();
        let ends: Vec<DVec2> = lathe.pieces.iter().flat_map(|piece| piece.ends).collect();
        let geometry = placed(lathe);
        let mut stream = Stream::new(11, Purpose::Test, 0, 0);
        let mut cluster = Cluster::default();
        for i in 0..60_000 {
            let end = ends[i % ends.len()];
            let target = around(end, (TAU * stream.uniform()).sin_cos());
            let mut from = 0.6 * (DVec3::new(stream.uniform(), stream.uniform(), stream.uniform()) * 2.0 - 1.0);
            // Level rays, rays along the axis and through it.
            match i % 7 {
                0 => from.y = target.y,
                1 => (from.x, from.z) = (target.x, target.z),
                2 => from = DVec3::new(0.0, from.y, 0.0),
                _ => {}
            }
            if from.length() > 0.95 || from.distance(target) < 0.05 {
                continue;
            }
            let ray = Ray::new(from, (target - from).normalize());
            assert!(geometry.intersect(&ray, 0.0, 9.0, &mut cluster), "{from} slipped out at {target}");
            assert!(cluster.nearest().unwrap().t > from.distance(target) - 0.01);
            let mut count = 0;
            let back = Ray::new(from + 5.0 * ray.direction, -ray.direction);
            geometry.all_hits(&back, 0.0, 99.0, |_| count += 1);
            assert!(count % 2 == 0, "{count} crossings");
        }
    }

    #[test]
    fn fine_profiles_and_facets_become_the_sphere() {
        let round = Lathe::new(&ball(400), 0.5).unwrap();
        let mesh = Lathe::facets(&ball(60), 120, 0.5).unwrap();
        assert!((round.area() / (4.0 * PI) - 1.0).abs() < 1e-4 && round.is_closed());
        assert!(mesh.is_closed() && (mesh.volume().unwrap() / (4.0 / 3.0 * PI) - 1.0).abs() < 3e-3);
        assert_eq!(mesh.triangle_count(), 120 * (2 * 60 - 2));
        let shapes = [Shape::Lathe(Arc::new(round)), Shape::Mesh(Arc::new(mesh))];
        for shape in shapes {
            let geometry = Geometry::new(vec![Placed::new(shape, DAffine3::IDENTITY).unwrap()]);
            let mut stream = Stream::new(12, Purpose::Test, 0, 0);
            let mut cluster = Cluster::default();
            for _ in 0..2000 {
                let direction = crate::math::sampling::sphere(stream.uniform2());
                assert!(geometry.intersect(&Ray::new(DVec3::ZERO, direction), 0.0, 9.0, &mut cluster));
                let hit = cluster.nearest().unwrap();
                assert!((hit.t - 1.0).abs() < 2e-3 && hit.normal.dot(direction) > 0.998);
                // Shading hides the facets, at the poles, too.
                assert!(hit.shading_normal.dot(direction) > 1.0 - 2e-4, "{direction}");
            }
        }
    }

    #[test]
    fn kinks_are_shaded_round_below_the_crease_only() {
        // ---- a drum with bevelled rims, each kink 45 degrees; the foot is sharp
        let profile = points(&[[0.0, 0.0], [1.0, 0.0], [1.0, 0.8], [0.8, 1.0], [0.0, 1.0]]);
        for (crease, round) in [(50f64, true), (40.0, false)] {
            let drum = Lathe::new(&profile, crease.to_radians()).unwrap();
            let bevel = drum.pieces[2];
            let slant = DVec2::ONE.normalize();
            let expected =
                if round { [(slant + DVec2::X).normalize(), (slant + DVec2::Y).normalize()] } else { [slant; 2] };
            assert!(bevel.smooth[0].distance(expected[0]) < 1e-12 && bevel.smooth[1].distance(expected[1]) < 1e-12);
            assert_eq!(drum.pieces[1].smooth[0], DVec2::X);
        }
        // ---- the same drum drawn the other way round has the same outside
        let reversed: Vec<DVec2> = profile.iter().rev().copied().collect();
        let (drum, turned) = (Lathe::new(&profile, 0.5).unwrap(), Lathe::new(&reversed, 0.5).unwrap());
        for (a, b) in drum.pieces.iter().zip(turned.pieces.iter().rev()) {
            assert!(a.normal.distance(b.normal) < 1e-12);
        }
    }

    #[test]
    fn profiles_that_are_none_are_refused() {
        for (profile, expected) in [
            (&[[1.0, 0.0]][..], "has 1 points"),
            (&[[1.0, 0.0], [-1.0, 1.0]], "the point 1"),
            (&[[1.0, f64::NAN], [1.0, 1.0]], "the point 0"),
            (&[[1.0, 0.0], [1.0, 0.0], [1.0, 1.0]], "the points 0 and 1 at the same place"),
            (&[[0.0, 0.0], [0.0, 1.0]], "lies on the axis"),
            (&[[0.0, 0.0], [1.0, 1.0], [1.0, 0.0], [0.0, 1.0]], "crosses or touches itself"),
            (&[[0.0, 0.0], [1.0, 0.0], [0.0, 0.0]], "crosses or touches itself"),
            (&[[0.5, 0.0], [1.0, 0.0], [1.0, 1.0], [0.7, 0.0], [0.5, 0.0]], "crosses or touches itself"),
        ] {
            let error = Lathe::new(&points(profile), 0.5).unwrap_err().to_string();
            assert!(error.contains(expected), "{error}");
        }
        // ---- pinched at the axis, and with a stretch on it, all is well
        for profile in [
            &[[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 2.0], [0.0, 2.0]][..],
            &[[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [0.0, 2.0], [1.0, 3.0], [0.0, 3.0]],
        ] {
            let lathe = Lathe::new(&points(profile), 0.5).unwrap();
            assert!(lathe.is_closed() && lathe.contains(DVec3::new(0.2, 0.1, 0.0)));
            assert!(!lathe.contains(DVec3::new(0.5, 1.0, 0.0)));
        }
        assert!(Lathe::facets(&ball(4), 2, 0.5).is_err());
    }
}
