//! Optical depths of many rays from one point, as of a pinhole camera through neighbouring pixels: a lattice of rays
//! is sampled, and those between are interpolated.

use super::sampled::{SampledDepths, Samples, countable};
use crate::math::{DVec3, Frame, Ray};
use crate::medium::density::Density;

/// Rays from one point, close to one another.
#[derive(Clone, Copy, Debug)]
pub struct Fan {
    /// Where they come from.
    pub origin: DVec3,
    /// Around the direction in their middle.
    pub frame: Frame,
    /// The slopes along the frame's x and y that nearly all stay below.
    pub slope: f64,
    /// About how many there are.
    pub rays: usize,
}

/// Optical depths that are interpolated may be wrong by this much.
const TOLERANCE: f64 = 0.01;

/// A ray of the lattice must serve so many others.
const WORTHWHILE: f64 = 2.0;

/// The lattices of a fan through the grids it meets.
#[derive(Clone, Debug, Default)]
pub struct Lattices {
    fan: Option<Fan>,
    /// By medium and step, those the fan has asked about.
    lattices: Vec<((u32, f64), Option<Lattice>)>,
}

impl Lattices {
    /// Forgets what was sampled: rays that follow are those of `fan`, if they have one.
    pub fn begin(&mut self, fan: Option<Fan>) {
        self.fan = fan;
        self.lattices.clear();
    }

    /// Samples a ray as [`SampledDepths::sample`] would, by the rays of the lattice around it. `None` where that would
    /// not be accurate, or not worthwhile.
    pub fn sample(
        &mut self,
        (medium, density): (u32, &Density),
        step: f64,
        ray: &Ray,
        range: (f64, f64),
        (most, extinction): (f64, f64),
        depths: &mut SampledDepths,
    ) -> Option<(Samples, f64)> {
        let fan = self.fan.as_ref().filter(|fan| fan.origin == ray.origin)?;
        let key = (medium, step);
        let place = self.lattices.iter().position(|(other, _)| *other == key).unwrap_or_else(|| {
            self.lattices.push((key, Lattice::new(fan, density, step, (most, TOLERANCE / extinction))));
            self.lattices.len() - 1
        });
        let lattice = self.lattices[place].1.as_ref()?;
        let (cell, parts) = lattice.cell(ray.direction)?;
        lattice.smooth[cell].then(|| lattice.between(cell, parts, range, depths))
    }
}

/// The rays of a lattice, evenly spaced in slope.
#[derive(Clone, Debug)]
struct Lattice {
    frame: Frame,
    /// The slope of the first, and from each to the next.
    least: f64,
    spacing: f64,
    /// Along an edge.
    edge: usize,
    step: f64,
    /// The multiple of the step at which each one's samples begin, and how many there are.
    first: i64,
    count: usize,
    /// The density integrated from the origin: `count` values a ray.
    values: Vec<f32>,
    /// By its first ray, whether depths may be interpolated in a cell.
    smooth: Vec<bool>,
}

impl Lattice {
    /// Rays are no more than half a voxel apart wherever they meet the grid. Depths may grow by `most` between two
    /// samples, and be off by `tolerance` between rays. `None` if that is not worthwhile.
    fn new(fan: &Fan, density: &Density, step: f64, (most, tolerance): (f64, f64)) -> Option<Self> {
        let support = density.support();
        if support.is_empty() || !support.size().is_finite() {
            return None;
        }
        // No ray whose slopes stay below `slope` is in the grid beyond this distance.
        let corners = support.corners().map(|corner| corner - fan.origin);
        let (mut deepest, mut outermost) = (0.0f64, 0.0f64);
        for corner in corners {
            deepest = deepest.max(corner.dot(fan.frame.z));
            outermost = outermost.max(corner.length());
        }
        let reach = |slope: f64| outermost.min(deepest * (1.0 + 2.0 * slope * slope).sqrt());
        let nearest = (fan.origin.clamp(support.min, support.max) - fan.origin).length();
        let spacing = 0.5 * density.feature_length() / reach(fan.slope);
        let edge = ((2.0 * fan.slope / spacing).ceil() + 1.0).max(3.0);
        let (first, last) = ((nearest / step).floor(), (reach(0.5 * spacing * (edge - 1.0)) / step).ceil() + 1.0);
        let meets = deepest > 0.0 && first < last;
        if !meets || edge * edge * WORTHWHILE > fan.rays as f64 || !countable(first, last + 1.0) {
            return None;
        }
        let (edge, count) = (edge as usize, (last - first) as usize + 1);
        let mut lattice = Lattice {
            frame: fan.frame,
            least: -0.5 * spacing * (edge - 1) as f64,
            spacing,
            edge,
            step,
            first: first as i64,
            count,
            values: Vec::with_capacity(edge * edge * count),
            smooth: vec![true; edge * edge],
        };
        let mut depths = SampledDepths::default();
        for ray in 0..edge * edge {
            let slope = |place: usize| lattice.least + spacing * place as f64;
            let Frame { x, y, z } = fan.frame;
            let direction = (z + slope(ray % edge) * x + slope(ray / edge) * y).normalize();
            let along = Ray::new(fan.origin, direction);
            depths.clear();
            match depths.sample(density, step, &along, (first * step, last * step), most) {
                Some((samples, total)) => {
                    let sampled = depths.values(samples).iter().copied();
                    lattice.values.extend(sampled.chain(std::iter::repeat(total as f32)).take(count));
                }
                None => {
                    lattice.values.extend(std::iter::repeat_n(0.0, count));
                    lattice.roughen(ray);
                }
            }
        }
        // Linear interpolation is wrong by an eighth of the second difference along either axis.
        let limit = (4.0 * tolerance) as f32;
        for across in 0..edge {
            for along in 1..edge - 1 {
                for (ray, stride) in [(across * edge + along, 1), (along * edge + across, edge)] {
                    if lattice.bend(ray, stride) > limit {
                        lattice.roughen(ray);
                    }
                }
            }
        }
        Some(lattice)
    }

    /// The greatest second difference of depths at a ray, along the lattice.
    fn bend(&self, ray: usize, stride: usize) -> f32 {
        let (before, here, after) = (self.row(ray - stride), self.row(ray), self.row(ray + stride));
        let mut most = 0.0f32;
        for i in 0..self.count {
            most = most.max((before[i] + after[i] - 2.0 * here[i]).abs());
        }
        most
    }

    /// Depths are not interpolated in the cells around a ray.
    fn roughen(&mut self, ray: usize) {
        for before in [0, 1, self.edge, self.edge + 1] {
            if let Some(smooth) = ray.checked_sub(before).and_then(|cell| self.smooth.get_mut(cell)) {
                *smooth = false;
            }
        }
    }

    /// The cell a direction lies in, by its first ray, and where in it.
    fn cell(&self, direction: DVec3) -> Option<(usize, [f64; 2])> {
        let along = direction.dot(self.frame.z);
        let place = |axis: DVec3| (direction.dot(axis) / along - self.least) / self.spacing;
        let (x, y) = (place(self.frame.x), place(self.frame.y));
        let last = (self.edge - 1) as f64;
        let within = |place: f64| (0.0..last).contains(&place);
        (along > 0.0 && within(x) && within(y))
            .then(|| (y as usize * self.edge + x as usize, [x - x.floor(), y - y.floor()]))
    }

    fn corners(&self, cell: usize) -> [usize; 4] {
        [cell, cell + 1, cell + self.edge, cell + self.edge + 1]
    }

    fn row(&self, ray: usize) -> &[f32] {
        &self.values[ray * self.count..][..self.count]
    }

    /// The samples of a ray in a cell, from `a` to `b`.
    fn between(&self, cell: usize, [x, y]: [f64; 2], (a, b): (f64, f64), depths: &mut SampledDepths) -> (Samples, f64) {
        let [p, q, r, s] = self.corners(cell).map(|ray| self.row(ray));
        let weights = [(1.0 - x) * (1.0 - y), x * (1.0 - y), (1.0 - x) * y, x * y].map(|weight| weight as f32);
        let at = |i: usize| weights[0] * p[i] + weights[1] * q[i] + weights[2] * r[i] + weights[3] * s[i];
        // Linear between samples; nothing before the first.
        let depth = |t: f64| {
            let place = (t / self.step - self.first as f64).clamp(0.0, (self.count - 1) as f64);
            let (before, part) = (place as usize, place.fract() as f32);
            let after = (before + 1).min(self.count - 1);
            at(before) + part * (at(after) - at(before))
        };
        let [from, to] = [(a / self.step).floor(), (b / self.step).ceil()]
            .map(|multiple| (multiple - self.first as f64).clamp(0.0, (self.count - 1) as f64) as usize);
        let (start, total) = (depth(a), (depth(b) - depth(a)).max(0.0));
        let inner = from + 1..to.max(from + 1);
        let [p, q, r, s] = [p, q, r, s].map(|row| row[inner.clone()].iter());
        let inner = p.zip(q).zip(r).zip(s).map(|(((p, q), r), s)| {
            (weights[0] * p + weights[1] * q + weights[2] * r + weights[3] * s - start).clamp(0.0, total)
        });
        (depths.insert(self.first + from as i64, inner, total), f64::from(total))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::Stream;
    use crate::math::random::Purpose;
    use crate::medium::density::Grid;
    use crate::medium::density::bricks::{BrickGrid, NegativePolicy};
    use glam::DAffine3;
    use std::sync::Arc;

    /// 32 voxels along each edge of the cube [−1, 1]³.
    fn cube(value: impl Fn(DVec3) -> f64) -> Density {
        const EDGE: usize = 32;
        let middle = |i: usize| (i as f64 + 0.5) / (0.5 * EDGE as f64) - 1.0;
        let place = |i: usize| DVec3::new(middle(i % EDGE), middle(i / EDGE % EDGE), middle(i / EDGE / EDGE));
        let values: Vec<f32> = (0..EDGE.pow(3)).map(|i| value(place(i)) as f32).collect();
        let corner = [-(EDGE as i32) / 2; 3];
        let bricks = BrickGrid::from_dense(corner, [EDGE; 3], &values, 0.0, NegativePolicy::Error).expect("finite");
        Density::Grid(Grid::new(Arc::new(bricks), DAffine3::from_scale(DVec3::splat(2.0 / EDGE as f64))))
    }

    /// Samples 400 rays of a fan: how many were interpolated, and by how much their optical depths are off at most and
    /// on average.
    fn off(density: &Density, origin: DVec3, towards: DVec3, (a, b): (f64, f64), extinction: f64) -> (usize, f64, f64) {
        let step = 1.0 / 32.0;
        let frame = Frame::around((towards - origin).normalize());
        let slope = 0.12 / towards.distance(origin);
        let (mut lattices, mut depths) = (Lattices::default(), SampledDepths::default());
        lattices.begin(Some(Fan { origin, frame, slope, rays: 2000 }));
        let mut stream = Stream::new(31, Purpose::Test, 0, 0);
        let (mut count, mut known, mut most, mut sum) = (0, 0.0, 0.0f64, 0.0);
        for _ in 0..400 {
            let [x, y] = stream.uniform2().map(|u| slope * (2.0 * u - 1.0));
            let ray = Ray::new(origin, (frame.z + x * frame.x + y * frame.y).normalize());
            let limits = (0.15 / extinction, extinction);
            let Some((samples, total)) = lattices.sample((0, density), step, &ray, (a, b), limits, &mut depths) else {
                continue;
            };
            count += 1;
            let values = depths.values(samples);
            assert!(values.windows(2).all(|pair| pair[0] <= pair[1]), "a depth decreases");
            assert_eq!((values[0], *values.last().unwrap()), (0.0, total as f32));
            for (i, value) in values.iter().enumerate() {
                let t = ((a / step).floor() + i as f64).clamp(a / step, b / step) * step;
                let error = extinction * (f64::from(*value) - density.depth(&ray, a, t));
                (most, sum, known) = (most.max(error.abs()), sum + error, known + 1.0);
            }
        }
        (count, most, sum / f64::max(known, 1.0))
    }

    #[test]
    fn rays_between_those_of_a_lattice_have_their_depths() {
        let smoke = cube(|p| (1.0 - p.length_squared()).max(0.0) * (1.0 + (5.0 * p.x).sin() * (4.0 * p.y).cos()));
        let outside = DVec3::new(0.4, 0.3, -5.0);
        let target = DVec3::new(0.3, 0.4, 0.0);
        // Whole depths of some 3.
        let (count, most, mean) = off(&smoke, outside, target, (4.2, 7.0), 2.0);
        assert!(count == 400 && most < TOLERANCE && mean.abs() < 0.05 * TOLERANCE, "{count}, {most:.1e}, {mean:.1e}");
        // From within, and to a surface.
        let (count, most, mean) = off(&smoke, DVec3::new(0.1, -0.2, -0.3), target, (0.11, 0.63), 2.0);
        assert!(count == 400 && most < TOLERANCE && mean.abs() < 0.05 * TOLERANCE, "{count}, {most:.1e}, {mean:.1e}");

        // Beside an edge of an even cube, rays are left to be sampled themselves.
        let even = cube(|p| if p.x < 0.3 { 1.0 } else { 0.0 });
        let (count, most, _) = off(&even, outside, target, (4.2, 7.0), 2.0);
        assert!((100..380).contains(&count) && most < 2.0 * TOLERANCE, "{count}, {most:.1e}");

        // Other origins are none of the fan's rays; few rays are not worth a lattice.
        let (mut lattices, mut depths) = (Lattices::default(), SampledDepths::default());
        let frame = Frame::around(DVec3::Z);
        let mut ask = |origin: DVec3, rays: usize| {
            lattices.begin(Some(Fan { origin: outside, frame, slope: 0.02, rays }));
            let ray = Ray::new(origin, DVec3::Z);
            lattices.sample((0, &smoke), 1.0 / 32.0, &ray, (3.5, 7.0), (0.1, 2.0), &mut depths).is_some()
        };
        assert!(ask(outside, 400) && !ask(outside + 0.01 * DVec3::X, 400) && !ask(outside, 16));
    }
}
