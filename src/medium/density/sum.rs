//! Densities that add up.

use std::ops::ControlFlow;

use smallvec::SmallVec;

use super::bricks::Cell;
use super::{Density, Grid, KNOTS, reached, spaced};
use crate::math::{Bounds, DAffine3, DVec3, Ray};

/// A weighted sum of densities, ρ = Σ w_i ρ_i.
///
/// Depths are sums of the parts' depths. What needs the density itself along a ray walks over pieces on which all parts are smooth: from one end
/// of a voxel's cell to the next, whichever part it belongs to.
#[derive(Clone, Debug)]
pub struct Sum {
    parts: Vec<Part>,
}

/// A density in a sum.
#[derive(Clone, Debug)]
pub struct Part {
    /// What it is multiplied by, above 0.
    pub weight: f64,
    /// The density, which is no sum.
    pub density: Density,
}

/// A piece of a ray on which all parts of a sum are smooth.
#[derive(Clone, Copy, Debug)]
pub struct Piece {
    /// The ray's parameter where it begins.
    pub ta: f64,
    /// The ray's parameter where it ends; above `ta`.
    pub tb: f64,
    /// The density integrated over it.
    pub depth: f64,
    /// What the voxels of all parts add up to where it begins, halfway and where it ends: along it that is a cubic.
    voxels: [f64; 3],
}

/// A piece of a ray that belongs to one part.
trait Interval {
    fn range(&self) -> (f64, f64);
}

impl Interval for Cell {
    fn range(&self) -> (f64, f64) {
        (self.ta, self.tb)
    }
}

impl Interval for (f64, f64, f64) {
    fn range(&self) -> (f64, f64) {
        (self.0, self.1)
    }
}

/// Consecutive intervals of each of several parts, met in the order of the ray's parameter.
struct Merged<'a, T> {
    parts: SmallVec<[(&'a Part, Vec<T>, usize); 4]>,
    ends: Vec<f64>,
}

impl<'a, T: Interval> Merged<'a, T> {
    /// Between `t0` and `t1`, and of no parts yet.
    fn new((t0, t1): (f64, f64)) -> Self {
        Merged { parts: SmallVec::new(), ends: vec![t0, t1] }
    }

    fn push(&mut self, part: &'a Part, intervals: Vec<T>) {
        self.ends.extend(intervals.iter().map(Interval::range).flat_map(|(from, to)| [from, to]));
        self.parts.push((part, intervals, 0));
    }

    /// Calls `visit(from, to, met)` from one end to the next, with the interval of each part that has one there.
    fn walk(&mut self, mut visit: impl FnMut(f64, f64, &mut dyn Iterator<Item = (&'a Part, &T)>) -> ControlFlow<()>) {
        self.ends.sort_unstable_by(f64::total_cmp);
        for pair in self.ends.windows(2) {
            let (from, to) = (pair[0], pair[1]);
            if from >= to {
                continue;
            }
            let mut met = self.parts.iter_mut().filter_map(|(part, intervals, next)| {
                *next += intervals[*next..].iter().take_while(|interval| interval.range().1 <= from).count();
                let interval = intervals.get(*next).filter(|interval| interval.range().0 <= from)?;
                Some((*part, interval))
            });
            if visit(from, to, &mut met).is_break() {
                return;
            }
        }
    }
}

impl Sum {
    /// Of parts that are no sums.
    pub fn new(parts: Vec<Part>) -> Self {
        Sum { parts }
    }

    /// The densities with their weights.
    pub fn parts(&self) -> &[Part] {
        &self.parts
    }

    /// The voxels of its parts, with their weights.
    pub(super) fn grids(&self) -> impl Iterator<Item = (f64, &Grid)> {
        self.parts.iter().filter_map(|part| match &part.density {
            Density::Grid(grid) => Some((part.weight, grid)),
            _ => None,
        })
    }

    /// Those of its parts that are not voxels.
    fn closed(&self) -> impl Iterator<Item = &Part> {
        self.parts.iter().filter(|part| !part.density.has_voxels())
    }

    /// A sum of what is asked of each part, times its weight.
    fn weighted(&self, ask: impl Fn(&Density) -> f64) -> f64 {
        self.parts.iter().map(|part| part.weight * ask(&part.density)).sum()
    }

    pub(super) fn moved(&self, transform: DAffine3) -> Self {
        let part = |part: &Part| Part { weight: part.weight, density: part.density.moved(transform) };
        Sum { parts: self.parts.iter().map(part).collect() }
    }

    pub(super) fn is_that(&self, other: &Sum) -> bool {
        let same = |(one, other): (&Part, &Part)| one.weight == other.weight && one.density.is_that(&other.density);
        self.parts.len() == other.parts.len() && self.parts.iter().zip(&other.parts).all(same)
    }

    /// The density at the point `p`.
    pub fn at(&self, p: DVec3) -> f64 {
        self.weighted(|density| density.at(p))
    }

    /// An upper bound that holds everywhere.
    pub(super) fn max(&self) -> f64 {
        self.weighted(Density::max)
    }

    pub(super) fn support(&self) -> Bounds {
        self.parts.iter().fold(Bounds::EMPTY, |all, part| all.union(part.density.support()))
    }

    pub(super) fn feature_length(&self) -> f64 {
        self.parts.iter().map(|part| part.density.feature_length()).fold(f64::INFINITY, f64::min)
    }

    pub(super) fn depth(&self, ray: &Ray, t0: f64, t1: f64) -> f64 {
        self.weighted(|density| density.depth(ray, t0, t1))
    }

    /// Whether all but voxels is the same everywhere.
    fn is_even_between_voxels(&self) -> bool {
        self.closed().all(|part| part.density.is_even())
    }

    /// Calls `visit` on consecutive pieces of the ray between `t0` and `t1`, none of them longer than `longest` where that and the
    /// range are finite.
    pub fn pieces(&self, ray: &Ray, range: (f64, f64), longest: f64, mut visit: impl FnMut(&Piece) -> ControlFlow<()>) {
        let mut merged = Merged::new(range);
        for part in &self.parts {
            if let Density::Grid(grid) = &part.density {
                let mut cells: Vec<Cell> = Vec::new();
                grid.cells(ray, range.0, range.1, |cell| {
                    cells.push(cell);
                    ControlFlow::Continue(())
                });
                merged.push(part, cells);
            }
        }
        let count = ((range.1 - range.0) / longest).ceil();
        if count.is_finite() {
            let step = (range.1 - range.0) / count;
            merged.ends.extend((1..count as usize).map(|i| range.0 + step * i as f64));
        }
        merged.walk(|ta, tb, met| {
            let mut voxels = [0.0; 3];
            for (part, cell) in met {
                let Density::Grid(grid) = &part.density else { continue };
                let at = |t: f64| grid.at(ray.at(t));
                let [start, middle, end] = [cell.rho_a, cell.rho_mid, cell.rho_b].map(f64::from);
                // Where a cell begins or ends the density may jump.
                let found = match (cell.ta == ta, cell.tb == tb) {
                    _ if cell.is_constant() => [start; 3],
                    (true, true) => [start, middle, end],
                    (begins, ends) => {
                        [if begins { start } else { at(ta) }, at(0.5 * (ta + tb)), if ends { end } else { at(tb) }]
                    }
                };
                for (sum, found) in voxels.iter_mut().zip(found) {
                    *sum += part.weight * found;
                }
            }
            let depth = simpson(tb - ta, voxels) + self.closed_depth(ray, ta, tb);
            visit(&Piece { ta, tb, depth, voxels })
        });
    }

    /// The depth of what is no voxels.
    fn closed_depth(&self, ray: &Ray, t0: f64, t1: f64) -> f64 {
        self.closed().map(|part| part.weight * part.density.depth(ray, t0, t1)).sum()
    }

    /// The density of what is no voxels.
    fn closed_at(&self, ray: &Ray, t: f64) -> f64 {
        self.closed().map(|part| part.weight * part.density.at(ray.at(t))).sum()
    }

    /// The depth from the start of a piece to `t` in it: the cubic that voxels are, integrated, and closed forms. Voxels are not asked
    /// close to its ends, where rounding may find what lies beyond.
    pub fn depth_in(&self, ray: &Ray, piece: &Piece, t: f64) -> f64 {
        let width = piece.tb - piece.ta;
        let [start, middle, end] = piece.voxels;
        if t >= piece.tb {
            return piece.depth;
        }
        let closed = self.closed_depth(ray, piece.ta, t);
        if start == middle && middle == end {
            return start * (t - piece.ta) + closed;
        }
        let p = ray.at(piece.ta + 0.25 * width);
        let quarter: f64 = self.grids().map(|(weight, grid)| weight * grid.at(p)).sum();
        // Newton's divided differences at 0, ¼, ½ and 1.
        let slopes = [4.0 * (quarter - start), 4.0 * (middle - quarter), 2.0 * (end - middle)];
        let bends = [2.0 * (slopes[1] - slopes[0]), (slopes[2] - slopes[1]) / 0.75];
        let c3 = bends[1] - bends[0];
        let (c2, c1) = (bends[0] - 0.75 * c3, slopes[0] - 0.25 * bends[0] + 0.125 * c3);
        let x = (t - piece.ta) / width;
        let part = width * x * (start + x * (c1 / 2.0 + x * (c2 / 3.0 + x * c3 / 4.0)));
        part.clamp(0.0, simpson(width, piece.voxels)) + closed
    }

    /// See [`Density::knots`]: the ends of all pieces, closer together where an atmosphere thins out between voxels.
    pub(super) fn knots(
        &self,
        ray: &Ray,
        (t0, t1): (f64, f64),
        is_long: impl Fn(f64) -> bool,
        mut knot: impl FnMut(f64, f64, f64),
    ) {
        if self.grids().next().is_none() {
            return spaced((t0, t1), |t| (self.depth(ray, t0, t), self.at(ray.at(t))), knot);
        }
        let longest = if self.is_even_between_voxels() { f64::INFINITY } else { (t1 - t0) / KNOTS as f64 };
        let mut depth = 0.0;
        self.pieces(ray, (t0, t1), longest, |piece| {
            if !piece.tb.is_finite() {
                return ControlFlow::Break(());
            }
            let Piece { ta, tb, voxels, .. } = *piece;
            knot(ta, depth, voxels[0] + self.closed_at(ray, ta));
            if is_long(piece.depth) && voxels != [voxels[0]; 3] {
                let middle = 0.5 * (ta + tb);
                knot(middle, depth + self.depth_in(ray, piece, middle), voxels[1] + self.closed_at(ray, middle));
            }
            depth += piece.depth;
            knot(tb, depth, voxels[2] + self.closed_at(ray, tb));
            ControlFlow::Continue(())
        });
    }

    /// Where between `t0` and `t1` the depth since `t0` reaches `target`; `None` if it does not.
    pub(super) fn advance(&self, ray: &Ray, t0: f64, t1: f64, target: f64) -> Option<f64> {
        let mut left = target;
        let mut found = None;
        self.pieces(ray, (t0, t1), f64::INFINITY, |piece| {
            if left > piece.depth || piece.depth == 0.0 {
                left -= piece.depth;
                return ControlFlow::Continue(());
            }
            found = Some(self.within(ray, piece, left));
            ControlFlow::Break(())
        });
        found
    }

    /// Where in a piece the depth since its start reaches `target`.
    fn within(&self, ray: &Ray, piece: &Piece, target: f64) -> f64 {
        let (low, mut high) = (piece.ta, piece.tb);
        if high.is_infinite() {
            let mut length = 1.0;
            while self.depth_in(ray, piece, low + length) < target && length < f64::MAX.sqrt() {
                length *= 2.0;
            }
            high = low + length;
        }
        let share = if piece.tb.is_finite() { target / piece.depth } else { 0.5 };
        reached((low, high), share, target, |t| (self.depth_in(ray, piece, t), self.at(ray.at(t))))
    }

    /// See [`Density::has_cells`].
    pub(super) fn has_cells(&self) -> bool {
        self.is_even_between_voxels()
            && self.grids().next().is_some()
            && self.grids().all(|(_, grid)| grid.coarse().is_some())
    }

    /// See [`Density::coarse`].
    pub(super) fn coarse(&self, ray: &Ray, (a, b): (f64, f64), mut visit: impl FnMut(f64, f64, f64)) {
        let even: f64 = self.closed().filter(|part| part.density.is_even()).map(|part| part.weight).sum();
        let mut merged = Merged::new((a, b));
        for part in &self.parts {
            if let Density::Grid(grid) = &part.density
                && let Some(coarse) = grid.coarse()
            {
                let mut pieces = Vec::new();
                coarse.pieces(ray, (a, b), |from, to, density| pieces.push((from, to, density)));
                merged.push(part, pieces);
            }
        }
        merged.walk(|from, to, met| {
            let density = even + met.map(|(part, (_, _, density))| part.weight * density).sum::<f64>();
            if density > 0.0 {
                visit(from, to, density);
            }
            ControlFlow::Continue(())
        });
    }
}

/// Simpson's rule; 0 over any length of nothing.
fn simpson(length: f64, [start, middle, end]: [f64; 3]) -> f64 {
    let sum = start + 4.0 * middle + end;
    if sum == 0.0 { 0.0 } else { length * sum / 6.0 }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::math::random::{Purpose, Stream};
    use crate::math::sampling;
    use crate::medium::density::Exponential;
    use crate::medium::density::bricks::{BrickGrid, Interpolation, NegativePolicy};

    /// Cubes of voxels of 0.1 around the origin, with these values; turned.
    fn voxels(value: impl Fn(usize) -> f32, interpolation: Interpolation, turn: f64) -> Density {
        let values: Vec<f32> = (0..20 * 20 * 20).map(value).collect();
        let bricks = BrickGrid::from_dense([-10; 3], [20; 3], &values, 0.0, NegativePolicy::Error).expect("finite");
        let place = DAffine3::from_rotation_z(turn) * DAffine3::from_scale(DVec3::splat(0.1));
        Density::Grid(Grid::new(Arc::new(bricks.with_interpolation(interpolation)), place))
    }

    fn sum(parts: Vec<(f64, Density)>) -> Sum {
        Sum::new(parts.into_iter().map(|(weight, density)| Part { weight, density }).collect())
    }

    fn rays() -> impl Iterator<Item = Ray> {
        (0..40).map(|index| {
            let mut stream = Stream::new(8, Purpose::Test, index, 0);
            let direction = sampling::sphere(stream.uniform2()).normalize();
            let near = DVec3::from_array([0; 3].map(|_| stream.uniform() - 0.5));
            Ray::new(near - 2.0 * direction, direction)
        })
    }

    /// Voxels that are all alike, inside of them, and a density that is the same everywhere are a density that is the same everywhere.
    #[test]
    fn constants_add_up_to_a_constant() {
        let sum = sum(vec![(0.7, Density::Uniform), (0.2, voxels(|_| 1.5, Interpolation::Trilinear, 0.3))]);
        for ray in rays() {
            for (t0, t1) in [(1.7, 2.3), (1.9, 2.4)] {
                let depth = sum.depth(&ray, t0, t1);
                assert!((depth - (t1 - t0)).abs() < 1e-6, "{depth}");
                let t = sum.advance(&ray, t0, t1, 0.25).expect("within the range");
                assert!((t - t0 - 0.25).abs() < 1e-6, "{t}");
            }
        }
    }

    /// Depths are the density's integral, and all that is told along a ray agrees with them: pieces, knots and where a depth is reached; and
    /// nowhere it is denser than its cells say by far.
    #[test]
    fn depths_are_the_integral_of_the_sum() {
        let air = Exponential { origin: DVec3::ZERO, up: DVec3::Y, scale_height: 0.4, value: 0.8 };
        let rough = || voxels(|i| (i * i % 7) as f32 * 0.4, Interpolation::Trilinear, 0.7);
        let blocks = || voxels(|i| if i / 100 % 3 == 0 { 1.0 } else { 0.0 }, Interpolation::Nearest, -0.2);
        let even = || (0.3, Density::Uniform);
        let sums = [
            sum(vec![even(), (1.2, Density::Exponential(air))]),
            sum(vec![even(), (0.5, rough()), (2.0, blocks()), (1.5, Density::Exponential(air))]),
            sum(vec![(0.5, rough()), (2.0, blocks())]),
            sum(vec![even(), (2.0, blocks())]),
        ];
        for (number, sum) in sums.iter().enumerate() {
            for ray in rays() {
                let (t0, t1, n) = (0.2, 3.7, 70_000);
                let depth = sum.depth(&ray, t0, t1);
                let step = (t1 - t0) / f64::from(n);
                let quadrature: f64 = (0..n).map(|i| sum.at(ray.at(t0 + (f64::from(i) + 0.5) * step)) * step).sum();
                assert!((depth - quadrature).abs() < 1e-3 * (0.1 + depth), "{number}: {depth}, not {quadrature}");

                let (mut end, mut whole) = (t0, 0.0);
                sum.pieces(&ray, (t0, t1), 0.5, |piece| {
                    assert!(piece.ta == end || number == 2, "{number}: a gap at {end}");
                    assert!(piece.tb - piece.ta <= 0.5 + 1e-9);
                    let (t, until) = (0.3 * piece.ta + 0.7 * piece.tb, piece.tb.next_down());
                    for t in [t, until] {
                        let (part, expected) = (sum.depth_in(&ray, piece, t), sum.depth(&ray, piece.ta, t));
                        assert!((part - expected).abs() < 1e-5, "{number}: {part}, not {expected}");
                    }
                    whole += piece.depth;
                    end = piece.tb;
                    ControlFlow::Continue(())
                });
                assert!((whole - depth).abs() < 1e-5, "{number}: {whole} in pieces, {depth}");

                let mut last = (t0, 0.0);
                sum.knots(
                    &ray,
                    (t0, t1),
                    |_| true,
                    |t, reached, _| {
                        assert!(t >= last.0 && reached >= last.1 - 1e-12, "{number}: {last:?}, then {t}, {reached}");
                        last = (t, reached);
                        assert!((reached - sum.depth(&ray, t0, t)).abs() < 1e-5, "{number}, at {t}");
                    },
                );
                assert!((last.1 - depth).abs() < 1e-5);

                for share in [0.01, 0.4, 0.99] {
                    let target = share * depth;
                    if depth > 0.0 {
                        let t = sum.advance(&ray, t0, t1, target).expect("within the range");
                        assert!((sum.depth(&ray, t0, t) - target).abs() < 1e-5 * (1.0 + depth), "{number}: {share}");
                    }
                }
                assert!(sum.advance(&ray, t0, t1, 1.001 * depth + 1e-6).is_none());

                assert_eq!(sum.has_cells(), number >= 2);
                if sum.has_cells() {
                    let mut pieces = Vec::new();
                    sum.coarse(&ray, (t0, t1), |from, to, density| pieces.push((from, to, density)));
                    for i in 0..200 {
                        let t = t0 + (t1 - t0) * (f64::from(i) + 0.5) / 200.0;
                        let density = sum.at(ray.at(t));
                        let here = pieces.iter().find(|(from, to, _)| (*from..*to).contains(&t)).map_or(0.0, |p| p.2);
                        assert!(density <= 32.0 * here, "{number}: {density} where it is about {here}");
                    }
                }
            }
        }
    }

    /// The same voxels twice, as densities of their own, are twice as dense, to rounding.
    #[test]
    fn the_same_voxels_twice_are_twice_as_dense() {
        let rough = || voxels(|i| (i * i % 7) as f32 * 0.4, Interpolation::Trilinear, 0.7);
        let (one, twice) = (rough(), sum(vec![(0.75, rough()), (1.25, rough())]));
        assert!(twice.feature_length() == one.feature_length() && twice.support() == one.support());
        for ray in rays() {
            let (alone, together) = (one.depth(&ray, 0.0, 4.0), twice.depth(&ray, 0.0, 4.0));
            assert!((together - 2.0 * alone).abs() <= 1e-12 * together);
            assert!((twice.at(ray.at(2.0)) - 2.0 * one.at(ray.at(2.0))).abs() <= 1e-12 * twice.max());
            if alone > 0.0 {
                let reached = [one.advance(&ray, 0.0, 4.0, 0.3 * alone), twice.advance(&ray, 0.0, 4.0, 0.6 * alone)];
                let [alone, together] = reached.map(|t| t.expect("within the range"));
                assert!((alone - together).abs() < 1e-5, "{alone}, {together}");
            }
        }
    }
}
