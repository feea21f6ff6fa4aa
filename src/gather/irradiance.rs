//! The irradiance cache: indirect light at a few places of Lambertian surfaces, and between them by interpolation.
//!
//! A [`Record`] holds what a hemisphere of gather rays has found at a place: the irradiance for every normal near its own, how it
//! changes along the surface, and how far that may be trusted. How it changes is told by the mesh that the ends of neighbouring rays
//! span (Schwarzhaupt, Jensen and Jarosz 2012, "Practical Hessian-based error control for irradiance caching"): each of its triangles sends its
//! rays' radiance, and hides what is behind it, so that lights which come out behind an edge are accounted for.

use std::f64::consts::PI;

use crate::geometry::Tree;
use crate::math::{Bounds, Cells, DVec3, Frame, Rgb};

/// What a gather ray has found.
#[derive(Clone, Copy, Debug)]
pub struct Gathering {
    /// Its unit direction.
    pub direction: DVec3,
    /// The radiance that comes from there.
    pub radiance: Rgb,
    /// The distance of the surface there; infinite where there is none.
    pub distance: f64,
    /// The cell that it went through,
    pub cell: usize,
    /// and how many did.
    pub of: u32,
}

/// How records are spaced.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Spacing {
    /// So that second derivatives let all records be off by as much, summed over the area where one counts: one as wide as the largest by this
    /// share at its edge, smaller ones by more (Schwarzhaupt et al. 2012).
    Hessian(f64),
    /// This share of the harmonic mean of the distances around (Ward, Rubinstein and Clear 1988).
    SplitSphere(f64),
}

/// Indirect light at a place.
#[derive(Clone, Debug)]
pub struct Record {
    point: DVec3,
    /// z is the shading normal, x and y are the axes of the ellipse in which it counts,
    frame: Frame,
    /// half as long as this.
    radii: [f64; 2],
    /// ∫ L ω dω, by channel: its part along a normal is the irradiance for it.
    vectors: [DVec3; 3],
    /// How the irradiance changes along the tangent plane, by channel.
    gradients: [DVec3; 3],
    /// The least that the radii are shortened to.
    shortest: [f64; 2],
    /// The part that its derivatives hold for of the ellipse in which it counts.
    held: f64,
    /// The standard error of the irradiance's luminance, were the rays independent.
    noise: f64,
}

/// Records count for normals that differ by no more than this cosine.
const MOST_TURNED: f64 = 0.9;
/// Records count as far above or below their tangent plane as this share of the shorter radius.
const FLATTENED: f64 = 0.3;
/// Records count no less than so much for telling of a small part of where they count.
const LEAST_HELD: f64 = 1e-6;
/// As far as so many times where they count, records yield to what others say.
const REACH: f64 = 1.5;
/// What is seen lower than at this cosine is taken to be seen at it: at the rim of what is curved, no pixel sees as far as its tangent plane says.
const LOWEST_VIEW: f64 = 0.125;
/// What is at infinity is at this many times the largest radius for the mesh.
const FAR: f64 = 1e3;

/// How small and how large records may be.
#[derive(Clone, Copy, Debug)]
pub struct Limits {
    /// Half axes of an ellipse that a record covers at least,
    pub least: [DVec3; 2],
    /// and the largest radius.
    pub most: f64,
}

impl Limits {
    /// What is seen of a surface with this normal along `view` by a cone so wide: the lower it is looked at, the longer.
    pub fn seen(width: f64, normal: DVec3, view: DVec3, most: f64) -> Limits {
        let cos = view.dot(normal).abs().max(LOWEST_VIEW);
        let along = (view - view.dot(normal) * normal).try_normalize().unwrap_or(Frame::around(normal).x);
        let [length, width] = [width / cos, width].map(|radius| if radius < most { radius } else { most });
        Limits { least: [length * along, width * normal.cross(along)], most }
    }

    /// How far the least ellipse reaches along a unit vector of its plane.
    fn least_along(&self, unit: DVec3) -> f64 {
        self.least[0].dot(unit).hypot(self.least[1].dot(unit))
    }
}

impl Record {
    /// From what the rays of all cells have found, around a shading normal.
    pub fn new(
        point: DVec3,
        frame: &Frame,
        cells: Cells,
        found: &[Gathering],
        spacing: Spacing,
        limits: &Limits,
    ) -> Record {
        let each = PI / cells.count() as f64;
        let mut vectors = [DVec3::ZERO; 3];
        let (mut inverse, mut squares) = (0.0, 0.0);
        for Gathering { direction, radiance, distance, of, .. } in found {
            let (share, each) = (1.0 / f64::from(*of), each / f64::from(*of));
            squares += (each * luminance(*radiance)).powi(2);
            let cos = direction.dot(frame.z).max(1e-3);
            for (vector, radiance) in vectors.iter_mut().zip(radiance.to_array()) {
                *vector += radiance * each / cos * *direction;
            }
            inverse += share / distance;
        }

        // Derivatives along the tangent plane.
        let means = means(cells, found);
        let mesh = Mesh { cells, found: &means, frame, far: FAR * limits.most };
        let Derivatives { gradients, hessian } = mesh.derivatives();
        let irradiance = luminance(Rgb::from_array(vectors.map(|vector| vector.dot(frame.z)))).max(0.0);

        // How far it counts.
        let (axis, radii) = match spacing {
            Spacing::Hessian(error) => {
                let (axis, curvatures) = eigen(hessian);
                // Where |½ λ r²| = ε E; of that and the largest radius the geometric mean, which makes errors summed over areas alike.
                let within = |curvature: f64| (2.0 * error * irradiance / curvature.abs()).sqrt();
                (axis, curvatures.map(|curvature| (within(curvature) * limits.most).sqrt()))
            }
            Spacing::SplitSphere(share) => {
                let mean = cells.count() as f64 / inverse;
                ([1.0, 0.0], [share * mean; 2])
            }
        };
        // Not as far as the gradient would change it by all of it.
        let slope = luminance_of(&gradients).length();
        let radii = radii.map(|radius| radius.min(irradiance / slope));
        let x = axis[0] * frame.x + axis[1] * frame.y;
        let frame = Frame { x, y: frame.z.cross(x), z: frame.z };
        // Where it is dark, no error matters; what is not a number is not to be trusted.
        let shortest = [frame.x, frame.y].map(|axis| limits.least_along(axis));
        let within = |radius: f64, least: f64| if radius >= least { radius.min(limits.most) } else { least };
        let told = radii;
        let radii = [within(told[0], shortest[0]), within(told[1], shortest[1])];
        // Where it counts farther than its derivatives hold, what they tell of its edge holds there.
        let held = |told: f64, radius: f64| if told < radius { (told / radius).max(0.0) } else { 1.0 };
        let [along, across] = [held(told[0], radii[0]), held(told[1], radii[1])];
        let held = (along * across).max(LEAST_HELD);
        let shorten = |slope: DVec3| along * slope.dot(frame.x) * frame.x + across * slope.dot(frame.y) * frame.y;
        let gradients = gradients.map(shorten);
        let noise = (squares - irradiance * irradiance / found.len() as f64).max(0.0).sqrt();
        Record { point, frame, radii, vectors, gradients, shortest, held, noise }
    }

    /// The record with all radii `scale` times as long.
    pub fn scaled(self, scale: f64) -> Record {
        let scaled = |radii: [f64; 2]| radii.map(|radius| scale * radius);
        Record { radii: scaled(self.radii), shortest: scaled(self.shortest), ..self }
    }

    /// Shortens the radii if what it tells of the place of another is farther off what that says than it may be: by `error` at the
    /// ends of the ellipse, growing with the square of the distance, and by what both do not know. What the mesh cannot know, such as where in a
    /// medium light comes from, shows there (as Křivánek et al. 2006 clamp by neighbours). What tells of a part of a pixel alone is yielded to as little.
    fn yield_to(&mut self, other: &Record, error: f64) {
        let said = luminance(other.irradiance(other.point, other.frame.z));
        let distance = self.distance(other.point, other.frame.z);
        if distance >= REACH || said <= 0.0 {
            return;
        }
        let off = (luminance(self.irradiance(other.point, other.frame.z)) - said).abs() - self.noise - other.noise;
        let ratio = other.held * off / (said * error * distance * distance);
        if ratio > 1.0 {
            for (radius, shortest) in self.radii.iter_mut().zip(self.shortest) {
                *radius = (*radius / ratio.sqrt()).max(shortest.min(*radius));
            }
        }
    }

    /// What it counts at a point of a surface with this shading normal: from 1 there to 0 where it ends, and less where it tells of a part of a
    /// pixel alone, such as the gap behind a lamp's rim: beside records of more than that it would be a blotch.
    fn weight(&self, point: DVec3, normal: DVec3) -> f64 {
        self.held * (1.0 - self.distance(point, normal))
    }

    /// How far a point of a surface with this shading normal is, as a share of how far it counts.
    fn distance(&self, point: DVec3, normal: DVec3) -> f64 {
        let offset = point - self.point;
        let [a, b] = self.radii;
        let high = offset.dot(self.frame.z) / (FLATTENED * a.min(b));
        let aside = (offset.dot(self.frame.x) / a).powi(2) + (offset.dot(self.frame.y) / b).powi(2);
        let turned = (1.0 - normal.dot(self.frame.z)).max(0.0) / (1.0 - MOST_TURNED);
        (aside + high * high + turned).sqrt()
    }

    /// The irradiance at a point of a surface with this shading normal, extrapolated: no less than nothing, no more than double.
    fn irradiance(&self, point: DVec3, normal: DVec3) -> Rgb {
        let offset = point - self.point;
        let of = |channel: usize| {
            let here = self.vectors[channel].dot(normal).max(0.0);
            (here + self.gradients[channel].dot(offset)).clamp(0.0, 2.0 * here)
        };
        Rgb::new(of(0), of(1), of(2))
    }

    /// Around all places where it counts.
    fn bounds(&self) -> Bounds {
        let [a, b] = self.radii;
        let Frame { x, y, z } = self.frame;
        let half = ((a * x).powf(2.0) + (b * y).powf(2.0) + (FLATTENED * a.min(b) * z).powf(2.0)).map(f64::sqrt);
        Bounds { min: self.point - half, max: self.point + half }
    }
}

/// Records, and where they are.
#[derive(Debug)]
pub struct IrradianceCache {
    records: Vec<Record>,
    boxes: Vec<Bounds>,
    tree: Tree,
}

impl Default for IrradianceCache {
    fn default() -> Self {
        IrradianceCache { records: Vec::new(), boxes: Vec::new(), tree: Tree::new(&[]) }
    }
}

impl IrradianceCache {
    /// How many records there are.
    pub fn len(&self) -> usize {
        self.records.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.records.is_empty()
    }

    /// Memory taken, in bytes.
    pub fn bytes(&self) -> usize {
        size_of_val(&*self.records) + size_of_val(&*self.boxes)
    }

    /// Adds records, one after the other; each and those around it are shortened where they are farther apart than by `error`. Those
    /// that are not finite are left out.
    pub fn extend(&mut self, records: impl IntoIterator<Item = Record>, error: f64) {
        let vectors = |record: &Record| record.vectors.iter().chain(&record.gradients).all(|vector| vector.is_finite());
        let finite = |record: &Record| vectors(record) && record.bounds().size().is_finite();
        let before = self.records.len();
        for mut record in records.into_iter().filter(finite) {
            let bounds = record.bounds();
            let mut near: Vec<usize> = (before..self.records.len()).collect();
            let order = self.tree.order();
            self.tree.overlapping(&bounds, |place| near.push(order[place as usize] as usize));
            for index in near {
                let other = &mut self.records[index];
                record.yield_to(other, error);
                other.yield_to(&record, error);
                self.boxes[index] = other.bounds();
            }
            self.boxes.push(record.bounds());
            self.records.push(record);
        }
        self.tree = Tree::new(&self.boxes);
    }

    /// Calls `visit` with the records that count at a point of a surface with this shading normal, and what they count.
    fn around(&self, point: DVec3, normal: DVec3, mut visit: impl FnMut(&Record, f64)) {
        let order = self.tree.order();
        self.tree.overlapping(&Bounds { min: point, max: point }, |place| {
            let record = &self.records[order[place as usize] as usize];
            let weight = record.weight(point, normal);
            if weight > 0.0 {
                visit(record, weight);
            }
        });
    }

    /// Whether any record counts there.
    pub fn covers(&self, point: DVec3, normal: DVec3) -> bool {
        let mut covers = false;
        self.around(point, normal, |_, _| covers = true);
        covers
    }

    /// The irradiance there, of all records that count together; `None` where none does.
    pub fn irradiance(&self, point: DVec3, normal: DVec3) -> Option<Rgb> {
        let (mut sum, mut weights) = (Rgb::ZERO, 0.0);
        self.around(point, normal, |record, weight| {
            sum += weight * record.irradiance(point, normal);
            weights += weight;
        });
        (weights > 0.0).then(|| sum / weights)
    }
}

/// Of each cell the mean of what its rays have found, where the first one ends.
fn means(cells: Cells, found: &[Gathering]) -> Vec<Gathering> {
    let mut means: Vec<Gathering> = Vec::with_capacity(cells.count());
    for ray in found {
        let radiance = ray.radiance / f64::from(ray.of);
        match means.get_mut(ray.cell) {
            Some(mean) => mean.radiance += radiance,
            None => means.push(Gathering { radiance, ..*ray }),
        }
    }
    means
}

fn luminance(rgb: Rgb) -> f64 {
    rgb.dot(Rgb::new(0.2126, 0.7152, 0.0722))
}

fn luminance_of(gradients: &[DVec3; 3]) -> DVec3 {
    0.2126 * gradients[0] + 0.7152 * gradients[1] + 0.0722 * gradients[2]
}

/// An eigenvector of a symmetric matrix [[xx, xy], [xy, yy]], and the eigenvalues of it and of the one across.
fn eigen([xx, xy, yy]: [f64; 3]) -> ([f64; 2], [f64; 2]) {
    let angle = 0.5 * (2.0 * xy).atan2(xx - yy);
    let (sin, cos) = angle.sin_cos();
    let (mean, half) = (0.5 * (xx + yy), (0.25 * (xx - yy) * (xx - yy) + xy * xy).sqrt());
    ([cos, sin], [mean + half, mean - half])
}

/// The triangles between the ends of neighbouring rays, seen from a place.
struct Mesh<'f> {
    cells: Cells,
    found: &'f [Gathering],
    frame: &'f Frame,
    /// Where ends are that are infinitely far.
    far: f64,
}

/// How a mesh's irradiance changes along the tangent plane.
#[derive(Debug, Default)]
struct Derivatives {
    /// By channel.
    gradients: [DVec3; 3],
    /// Of the luminance: xx, xy and yy in the mesh's frame.
    hessian: [f64; 3],
}

impl Mesh<'_> {
    /// Rings of ends in the frame, from the pole to the horizon, with their radiance.
    fn rings(&self) -> Vec<Vec<(DVec3, Rgb)>> {
        let Cells { rings, sectors } = self.cells;
        let end = |of: &Gathering| {
            let distance = if of.distance < self.far { of.distance } else { self.far };
            (distance * self.frame.to_local(of.direction), of.radiance)
        };
        let mut all: Vec<Vec<_>> =
            self.found.chunks(sectors).map(|ring| ring.iter().map(end).collect::<Vec<_>>()).collect();

        // The pole, as the first ring, and the horizon, as the last.
        let mean = |of: fn(&(DVec3, Rgb)) -> DVec3| all[0].iter().map(of).sum::<DVec3>() / sectors as f64;
        let pole = (mean(|(end, _)| DVec3::Z * end.length()), mean(|(_, radiance)| *radiance));
        let level = |&(end, radiance): &(DVec3, Rgb)| {
            let along = DVec3::new(end.x, end.y, 0.0).try_normalize().unwrap_or(DVec3::X);
            (end.length() * along, radiance)
        };
        let horizon = all[rings - 1].iter().map(level).collect();
        all.insert(0, vec![pole; sectors]);
        all.push(horizon);
        all
    }

    fn derivatives(&self) -> Derivatives {
        let rings = self.rings();
        let sectors = self.cells.sectors;
        let mut sum = Derivatives::default();
        let mut add = |corners: [(DVec3, Rgb); 3]| {
            let radiance = revealed(&corners);
            if radiance.max_element() <= 0.0 {
                return;
            }
            let [value, x, y, xx, xy, yy] = seen(corners.map(|(end, _)| end));
            // Whichever way round its corners are.
            let sign = value.signum();
            for (gradient, radiance) in sum.gradients.iter_mut().zip(radiance.to_array()) {
                *gradient += sign * radiance * (x * self.frame.x + y * self.frame.y);
            }
            let weight = sign * luminance(radiance);
            for (hessian, part) in sum.hessian.iter_mut().zip([xx, xy, yy]) {
                *hessian += weight * part;
            }
        };
        for (ring, pair) in rings.windows(2).enumerate() {
            let [upper, lower] = pair else { continue };
            for k in 0..sectors {
                let next = (k + 1) % sectors;
                if ring > 0 {
                    add([upper[k], upper[next], lower[k]]);
                }
                add([upper[next], lower[next], lower[k]]);
            }
        }
        sum
    }
}

/// The radiance of a triangle of the mesh: the mean of its corners', weighted by their squared distances. On a surface these are alike. Between an
/// edge and what is behind it, it is the latter that comes out or hides as the place moves: with the plain mean, a bright ball would
/// seem to grow as one looks around it.
fn revealed(corners: &[(DVec3, Rgb); 3]) -> Rgb {
    // Ends may lie at the place itself, where faces coincide.
    let weights = corners.map(|(end, _)| end.length_squared().max(f64::MIN_POSITIVE));
    let sum: f64 = weights.iter().sum();
    corners.iter().zip(weights).map(|((_, radiance), weight)| weight / sum * *radiance).sum()
}

/// π times the form factor of a triangle from the origin with normal z (Lambert 1760), and its derivatives as the origin moves: along x,
/// y, xx, xy, yy. The sign is that of the triangle's turn.
///
/// An edge from a to a + d contributes ½ ∫ (a × d)·z/|a + t d|² dt. With s = (a × d)·z, r = a + t d and q = |r|², moving the origin changes
/// ∫ 1/q by 2 ∫ r/q², and s by −(d × z): second derivatives follow by the same rules.
fn seen(corners: [DVec3; 3]) -> [f64; 6] {
    let mut sum = [0.0; 6];
    for (a, b) in [(0, 1), (1, 2), (2, 0)] {
        let (a, d) = (corners[a], corners[b] - corners[a]);
        let length = d.length();
        if length <= 0.0 {
            continue;
        }
        // Along the edge, from the foot of the perpendicular on: r = p + l u.
        let u = d / length;
        let from = a.dot(u);
        let to = from + length;
        let p = a - from * u;
        // What is seen end on would turn infinitely fast.
        let h = p.length().max(1e-6 * (from.abs() + to.abs()));
        let h2 = h * h;
        let q = |l: f64| h2 + l * l;
        let angle = (to / h).atan() - (from / h).atan();
        // ∫ dl/q², ∫ l dl/q², ∫ dl/q³, ∫ l dl/q³, ∫ l² dl/q³.
        let a2 = 0.5 / h2 * (to / q(to) - from / q(from) + angle / h);
        let b2 = 0.5 * (1.0 / q(from) - 1.0 / q(to));
        let a3 = 0.25 / h2 * (to / q(to).powi(2) - from / q(from).powi(2) + 3.0 * a2);
        let b3 = 0.25 * (1.0 / q(from).powi(2) - 1.0 / q(to).powi(2));
        let c3 = a2 - h2 * a3;
        // ∫ 1/q dt, ∫ r/q² dt, ∫ 1/q² dt, ∫ r ⊗ r/q³ dt.
        let j1 = angle / (h * length);
        let g = (a2 * p + b2 * u) / length;
        let j2 = a2 / length;
        let outer =
            |i: usize, k: usize| (a3 * p[i] * p[k] + b3 * (p[i] * u[k] + u[i] * p[k]) + c3 * u[i] * u[k]) / length;
        let s = a.x * d.y - a.y * d.x;
        // d × z.
        let across = [d.y, -d.x];
        let gradient = |i: usize| 2.0 * s * g[i] - across[i] * j1;
        let second = |i: usize, k: usize| {
            let even = if i == k { j2 } else { 0.0 };
            -2.0 * (across[i] * g[k] + g[i] * across[k]) + 2.0 * s * (4.0 * outer(i, k) - even)
        };
        let parts = [s * j1, gradient(0), gradient(1), second(0, 0), second(0, 1), second(1, 1)];
        for (sum, part) in sum.iter_mut().zip(parts) {
            *sum += 0.5 * part;
        }
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::Stream;
    use crate::math::random::Purpose;
    use crate::math::sampling;

    /// Derivatives of a triangle's form factor, against differences of its values; and its value against that of a small one,
    /// cos θ cos θ' A/r².
    #[test]
    fn derivatives_are_those_of_the_form_factor() {
        let mut stream = Stream::new(4, Purpose::Test, 0, 0);
        let mut point = || DVec3::new(stream.uniform() - 0.5, stream.uniform() - 0.5, 0.4 + stream.uniform());
        for _ in 0..100 {
            let corners = [point(), point(), point()];
            let from = |x: f64, y: f64| seen(corners.map(|corner| corner - DVec3::new(x, y, 0.0)));
            let [_, x, y, xx, xy, yy] = from(0.0, 0.0);
            let e = 1e-4;
            let difference = |i: usize, [x, y]: [f64; 2]| (from(x, y)[i] - from(-x, -y)[i]) / (2.0 * e);
            for (found, expected) in [
                (x, difference(0, [e, 0.0])),
                (y, difference(0, [0.0, e])),
                (xx, difference(1, [e, 0.0])),
                (xy, difference(1, [0.0, e])),
                (xy, difference(2, [e, 0.0])),
                (yy, difference(2, [0.0, e])),
            ] {
                assert!((found - expected).abs() < 1e-5 * (1.0 + expected.abs()), "{found}, not {expected}");
            }
        }
        let small = [DVec3::new(1.0, 0.0, 2.0), DVec3::new(1.01, 0.0, 2.0), DVec3::new(1.0, 0.01, 2.0)];
        let middle = (small[0] + small[1] + small[2]) / 3.0;
        let expected = 0.5 * 0.01 * 0.01 * middle.z * middle.z / middle.length_squared().powi(2);
        assert!((seen(small)[0].abs() / expected - 1.0).abs() < 1e-4);
    }

    /// What a pixel sees along its view is as long as its tangent plane says, but where it only just sees it, at the rim of what is curved: a record
    /// there told of all that faces the same way.
    #[test]
    fn records_at_rims_stay_there() {
        let length = |cos: f64| {
            let view = DVec3::new((1.0 - cos * cos).sqrt(), 0.0, -cos);
            let limits = Limits::seen(0.1, DVec3::Z, view, 100.0);
            assert!((limits.least_along(DVec3::Y) - 0.1).abs() < 1e-12);
            limits.least_along(DVec3::X)
        };
        for (cos, expected) in [(1.0, 0.1), (0.5, 0.2), (0.2, 0.5), (1e-3, 0.8), (0.0, 0.8)] {
            assert!((length(cos) - expected).abs() < 1e-12, "{cos}: {}", length(cos));
        }
    }

    /// Below a small lamp in even light, E = π (L sin² α cos θ + L₀): on average by rays of which some go where photons came from, whatever
    /// these said, with a sixth of the variance that as many rays have which do not.
    #[test]
    fn rays_by_flux_bring_the_same_light() {
        const RECORDS: usize = 2000;
        let lamp = DVec3::new(0.5, 0.3, 0.7).normalize();
        let (sin2, bright, even) = (0.01f64, 100.0, 0.2);
        let radiance = |w: DVec3| if w.dot(lamp) > (1.0 - sin2).sqrt() { bright + even } else { even };
        let expected = PI * (bright * sin2 * lamp.z + even);
        let frame = Frame { x: DVec3::X, y: DVec3::Y, z: DVec3::Z };
        let limits = Limits { least: [1e-3 * frame.x, 1e-3 * frame.y], most: 10.0 };
        let mut stream = Stream::new(6, Purpose::Test, 0, 0);
        let mut of = |cells: Cells, by_flux: u32, wrong: f64| {
            let (mut sum, mut squares) = (0.0, 0.0);
            for _ in 0..RECORDS {
                let mut flux = vec![0.0; cells.count()];
                for _ in 0..64 {
                    let even = sampling::cosine_hemisphere(stream.uniform2());
                    let from_lamp = stream.uniform() < bright * sin2 * lamp.z * PI / expected;
                    let from = if from_lamp { (lamp + wrong * DVec3::X).normalize() } else { even };
                    cells.add(from, 1.0, &mut flux);
                }
                let rays = cells.rays(&flux, by_flux);
                assert_eq!(rays.iter().sum::<u32>() as usize, cells.count() + by_flux as usize);
                let through = |(cell, &of): (usize, &u32)| (0..of).map(move |_| (cell, of));
                let gather = |(cell, of)| {
                    let direction = cells.direction(cell, &frame, stream.uniform2());
                    Gathering { direction, radiance: Rgb::splat(radiance(direction)), distance: 1.0, cell, of }
                };
                let found: Vec<Gathering> = rays.iter().enumerate().flat_map(through).map(gather).collect();
                let record = Record::new(DVec3::ZERO, &frame, cells, &found, Spacing::Hessian(0.1), &limits);
                let irradiance = record.irradiance(DVec3::ZERO, DVec3::Z).x;
                (sum, squares) = (sum + irradiance, squares + irradiance * irradiance);
            }
            let mean = sum / RECORDS as f64;
            let variance = squares / RECORDS as f64 - mean * mean;
            let error = (variance / RECORDS as f64).sqrt();
            assert!((mean - expected).abs() < 4.0 * error, "{mean} ± {error}, not {expected}");
            variance
        };
        let plain = of(Cells::about(200), 0, 0.0);
        let by_flux = of(Cells::about(120), 200 - Cells::about(120).count() as u32, 0.0);
        assert!(by_flux < plain / 6.0, "{by_flux}, and {plain} without");
        of(Cells::about(120), 80, 0.7);
    }

    /// Beside a bright ball before a dark ceiling, E = π a² h/(c² + h²)^³⸍², and its change follows: what is behind the ball's rim is dark.
    #[test]
    fn what_comes_out_behind_a_rim_is_what_is_behind() {
        let (radius, center) = (0.5f64, DVec3::new(0.6, 0.0, 1.0));
        let (square, ceiling) = (center.length_squared(), 3.0);
        let frame = Frame { x: DVec3::X, y: DVec3::Y, z: DVec3::Z };
        let cells = Cells { rings: 40, sectors: 120 };
        let gather = |index: usize| {
            let direction = cells.direction(index, &frame, [0.5; 2]);
            let middle = center.dot(direction);
            let inside = radius * radius + middle * middle - square;
            let (bright, distance) =
                if inside > 0.0 { (1.0, middle - inside.sqrt()) } else { (0.0, ceiling / direction.z) };
            Gathering { direction, radiance: Rgb::splat(bright), distance, cell: index, of: 1 }
        };
        let found: Vec<Gathering> = (0..cells.count()).map(gather).collect();
        let limits = Limits { least: [1e-3 * frame.x, 1e-3 * frame.y], most: 1.0 };
        let record = Record::new(DVec3::ZERO, &frame, cells, &found, Spacing::Hessian(0.1), &limits);
        let expected = PI * radius * radius * center.z * 3.0 * center.x / square.powf(2.5);
        let found = record.gradients[0].x;
        assert!((found / expected - 1.0).abs() < 0.05, "{found}, not {expected}");
    }

    /// Below a lit square, a record tells irradiance and its change along the floor and with the normal as they are: Lambert's
    /// formula for the square, and differences of it.
    #[test]
    fn records_extrapolate() {
        let square = |x: f64, z: DVec3| -> f64 {
            let frame = Frame::around(z);
            let corner = |i: f64, k: f64| frame.to_local(DVec3::new(i - x, k, 1.0));
            let corners = [corner(-1.0, -1.0), corner(1.0, -1.0), corner(1.0, 1.0), corner(-1.0, 1.0)];
            let halves = [[corners[0], corners[1], corners[2]], [corners[0], corners[2], corners[3]]];
            halves.map(|half| seen(half)[0]).iter().sum::<f64>().abs()
        };
        let (x, cells) = (0.6, Cells { rings: 64, sectors: 200 });
        let frame = Frame { x: DVec3::X, y: DVec3::Y, z: DVec3::Z };
        let limits = Limits { least: [1e-3 * frame.x, 1e-3 * frame.y], most: 1.0 };
        let gather = |index: usize| {
            let direction = cells.direction(index, &frame, [0.5; 2]);
            let end = DVec3::X * x + direction / direction.z;
            let lit = end.x.abs() < 1.0 && end.y.abs() < 1.0;
            // Beyond the square is a black ceiling.
            Gathering {
                direction,
                radiance: Rgb::splat(f64::from(lit)),
                distance: 1.0 / direction.z,
                cell: index,
                of: 1,
            }
        };
        let found: Vec<Gathering> = (0..cells.count()).map(gather).collect();
        let record = Record::new(DVec3::X * x, &frame, cells, &found, Spacing::Hessian(0.1), &limits);
        let tilted = DVec3::new(0.1, 0.0, 1.0).normalize();
        for (what, expected, at, normal, precision) in [
            ("there", square(x, DVec3::Z), x, DVec3::Z, 0.005),
            ("aside", square(x + 0.1, DVec3::Z), x + 0.1, DVec3::Z, 0.01),
            ("tilted", square(x, tilted), x, tilted, 0.005),
        ] {
            let found = record.irradiance(DVec3::X * at, normal).x;
            assert!((found / expected - 1.0).abs() < precision, "{what}: {found}, not {expected}");
        }
        // Off by a tenth, as asked, where the largest radius would be but that far.
        let radius = record.radii[usize::from(record.frame.x.x.abs() < 0.5)].powi(2) / limits.most;
        let (found, expected) = (record.irradiance(DVec3::X * (x + radius), DVec3::Z).x, square(x + radius, DVec3::Z));
        let off = (found / square(x, DVec3::Z) - expected / square(x, DVec3::Z)).abs();
        assert!((0.05..0.2).contains(&off), "off by {off} at {radius}");
    }
}
