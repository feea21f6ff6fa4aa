//! Optical depth along a ray, tabulated before photons are gathered.

use crate::math::Ray;
use crate::medium::Medium;
use crate::photon::simd::{LANES, Lanes, Row};

/// The density integrated along a ray, D(t) = ∫₀ᵗ ρ, from values and slopes (the density) at knots:
/// exact there, a monotone cubic between them (Fritsch and Carlson 1980), constant outside. Optical
/// depths are σ·D.
///
/// Knots belong where the density's slope jumps, and close enough that σ·D does not grow by more
/// than about one half between two of them.
#[derive(Clone, Debug, Default)]
pub struct DepthTable {
    knots: Vec<Knot>,
    /// The cubic after each knot; the last is constant.
    pieces: Vec<Piece<f64>>,
    /// The cubics in single precision, for many photons at once.
    rounded: Vec<Piece<f32>>,
    /// For each of evenly wide buckets along the table, the piece its start lies in.
    buckets: Vec<u32>,
    buckets_per_length: f64,
}

#[derive(Clone, Copy, Debug)]
struct Knot {
    t: f64,
    depth: f64,
    /// ρ just before and just after: voxels without interpolation, and the rims of grids, jump.
    before: f64,
    after: f64,
}

#[derive(Clone, Copy, Debug)]
struct Piece<F> {
    start: F,
    /// Where the next one starts; ∞ for the last.
    end: F,
    /// Of the powers of `t − start`.
    coefficients: [F; 4],
}

/// Optical depth may grow by this much between two knots.
const DEPTH_STEP: f64 = 0.5;

/// Buckets for each piece.
const BUCKETS: usize = 4;

/// Coefficients of up to this size, thrice taken, are finite in single precision.
const LARGEST: f64 = 1e38;

impl DepthTable {
    /// A table without knots: no depth anywhere.
    pub fn new() -> Self {
        Self::default()
    }

    /// Forgets all knots and keeps the memory.
    pub fn clear(&mut self) {
        self.knots.clear();
        self.pieces.clear();
        self.rounded.clear();
        self.buckets.clear();
    }

    /// Adds a knot at `t`, with D(t) and ρ(t). A second knot at the same place says to what the density jumps there; one
    /// that lies before the last, or at no finite place, is dropped. Depths and densities below what is possible are
    /// raised to it, and those beyond the largest number of single precision are taken for that.
    pub fn push(&mut self, t: f64, depth: f64, density: f64) {
        let possible = |value: f64| if value > 0.0 { value.min(f64::from(f32::MAX)) } else { 0.0 };
        let (depth, density) = (possible(depth), possible(density));
        match self.knots.last_mut() {
            _ if !t.is_finite() => {}
            Some(last) if t < last.t => {}
            Some(last) if t == last.t => last.after = density,
            last => {
                let depth = last.map_or(depth, |last| depth.max(last.depth));
                self.knots.push(Knot { t, depth, before: density, after: density });
            }
        }
    }

    /// Makes the table ready for look-ups.
    pub fn finish(&mut self) {
        self.pieces.clear();
        self.rounded.clear();
        self.buckets.clear();
        let (Some(&first), Some(&last)) = (self.knots.first(), self.knots.last()) else { return };
        for pair in self.knots.windows(2) {
            self.pieces.push(Piece::between(&pair[0], &pair[1]));
        }
        let constant = [last.depth, 0.0, 0.0, 0.0];
        self.pieces.push(Piece { start: last.t, end: f64::INFINITY, coefficients: constant });

        self.rounded.extend(self.pieces.iter().map(Piece::rounded));

        let count = BUCKETS * self.pieces.len();
        let length = last.t - first.t;
        self.buckets_per_length = if length > 0.0 { count as f64 / length } else { 0.0 };
        // A look-up scans forward only. Its rounding may choose the next bucket for a place at the end of this one, so each
        // bucket's piece is that of slightly before its start.
        for (index, piece) in self.pieces[..self.pieces.len() - 1].iter().enumerate() {
            let before = ((piece.end - first.t) * self.buckets_per_length + 0.0625).ceil() as usize;
            self.buckets.resize(before.clamp(self.buckets.len(), count), index as u32);
        }
        self.buckets.resize(count, self.pieces.len() as u32 - 1);
    }

    /// Makes it the table of a ray through a medium from `a` to `b`, both finite, with lengths and depths from `a` on,
    /// ready for look-ups.
    pub(super) fn tabulate(&mut self, medium: &Medium, ray: &Ray, (a, b): (f64, f64)) {
        self.clear();
        self.push(0.0, 0.0, medium.density.at(ray.at(a)));
        let largest = medium.extinction.max_element();
        let is_long = |depth: f64| depth * largest > DEPTH_STEP;
        medium.density.knots(ray, (a, b), is_long, |t, depth, density| self.push(t - a, depth, density));
        self.finish();
    }

    /// A place at or beyond which D is at least this; infinite if it never is.
    pub(super) fn reach(&self, depth: f32) -> f32 {
        let beyond = self.knots.partition_point(|knot| knot.depth < f64::from(depth));
        // Rounded up.
        self.knots.get(beyond).map_or(f32::INFINITY, |knot| (knot.t as f32).next_up())
    }

    /// D(t): never negative, never decreasing.
    pub fn depth_at(&self, t: f64) -> f64 {
        let Some(first) = self.pieces.first() else { return 0.0 };
        let mut index = self.bucket(((t - first.start) * self.buckets_per_length) as usize);
        while t >= self.pieces[index].end && index + 1 < self.pieces.len() {
            index += 1;
        }
        let piece = &self.pieces[index];
        let [c0, c1, c2, c3] = piece.coefficients;
        let x = (t.min(f64::MAX) - piece.start).max(0.0);
        c0 + x * (c1 + x * (c2 + x * c3))
    }

    /// D(t) in the lanes of `bits`, to a few roundings, and the density D′(t), never negative; anything in the others.
    /// Photons of one block are neighbours: most share a piece.
    #[inline(always)]
    pub(super) fn look_up<L: Lanes>(&self, t: L, bits: u16) -> [L; 2] {
        let [mut depths, mut densities] = [L::splat(0.0); 2];
        let Some(first) = self.rounded.first() else { return [depths, densities] };
        let per_length = self.buckets_per_length as f32;
        let mut row = Row([0.0; LANES]);
        t.store(&mut row);
        let mut left = bits;
        while left != 0 {
            let lane = left.trailing_zeros();
            let place = row.0[lane as usize];
            let mut index = self.bucket(((place - first.start) * per_length) as usize);
            while place >= self.rounded[index].end && index + 1 < self.rounded.len() {
                index += 1;
            }
            let piece = &self.rounded[index];
            let (start, end) = (L::splat(piece.start), L::splat(piece.end));
            // The lane itself, even if it lies before the table.
            let inside = L::bits(L::and(start.less_equal(t), t.less(end))) | 1 << lane;
            let [c0, c1, c2, c3] = piece.coefficients;
            let x = t.sub(start).max(L::splat(0.0));
            let slope = x.mul_add(L::splat(c3), L::splat(c2)).mul_add(x, L::splat(c1));
            let density = x.mul_add(x.mul_add(L::splat(3.0 * c3), L::splat(2.0 * c2)), L::splat(c1));
            let inside_lanes = L::mask(inside);
            depths = slope.mul_add(x, L::splat(c0)).select(inside_lanes, depths);
            densities = density.max(L::splat(0.0)).select(inside_lanes, densities);
            left &= !inside;
        }
        [depths, densities]
    }

    /// The piece to start looking from in a bucket, or in the last one.
    #[inline(always)]
    fn bucket(&self, bucket: usize) -> usize {
        self.buckets[bucket.min(self.buckets.len() - 1)] as usize
    }

    /// D at the last knot: the whole table's depth.
    pub fn total(&self) -> f64 {
        self.knots.last().map_or(0.0, |knot| knot.depth)
    }
}

impl Piece<f64> {
    fn rounded(&self) -> Piece<f32> {
        Piece { start: self.start as f32, end: self.end as f32, coefficients: self.coefficients.map(|c| c as f32) }
    }

    fn between(a: &Knot, b: &Knot) -> Self {
        let width = b.t - a.t;
        let secant = (b.depth - a.depth) / width;
        let (mut start, mut end) = (a.after, b.before);
        if secant <= 0.0 {
            (start, end) = (0.0, 0.0);
        } else {
            // Slopes, in units of the secant's, inside of a circle of radius 3 keep the cubic
            // monotone.
            let (a, b) = (start / secant, end / secant);
            if a * a + b * b > 9.0 {
                let steepness = a.hypot(b);
                start *= 3.0 / steepness;
                end *= 3.0 / steepness;
            }
        }
        let c2 = (3.0 * secant - 2.0 * start - end) / width;
        let c3 = (start + end - 2.0 * secant) / (width * width);
        // What is too narrow for that in single precision is a step at its end.
        let largest = start + c2.abs() + c3.abs();
        let rest = if largest <= LARGEST { [start, c2, c3] } else { [0.0; 3] };
        Piece { start: a.t, end: b.t, coefficients: [a.depth, rest[0], rest[1], rest[2]] }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::random::{Purpose, Stream};

    /// A smooth density, 1.2 + sin 3t, and its integral.
    fn smooth(t: f64) -> (f64, f64) {
        (1.2 * t + (1.0 - (3.0 * t).cos()) / 3.0, 1.2 + (3.0 * t).sin())
    }

    #[test]
    fn interpolation_is_exact_at_knots_and_of_fourth_order_between() {
        let worst = |knots: usize| {
            let mut table = DepthTable::new();
            for i in 0..=knots {
                let t = 5.0 * i as f64 / knots as f64;
                let (depth, density) = smooth(t);
                table.push(t, depth, density);
            }
            table.finish();
            for i in 0..=knots {
                let t = 5.0 * i as f64 / knots as f64;
                assert!((table.depth_at(t) - smooth(t).0).abs() < 1e-13);
            }
            (0..5000).map(|i| i as f64 * 1e-3).map(|t| (table.depth_at(t) - smooth(t).0).abs()).fold(0.0, f64::max)
        };
        let (coarse, fine) = (worst(40), worst(80));
        assert!(coarse < 2e-5 && fine < coarse / 14.0, "{coarse} {fine}");
    }

    #[test]
    fn a_density_that_jumps_is_exact() {
        let mut table = DepthTable::new();
        let mut depth = 0.0;
        let densities = [2.0, 0.0, 5.0, 0.5];
        for (i, density) in densities.into_iter().enumerate() {
            table.push(i as f64, depth, density);
            depth += density;
            table.push(i as f64 + 1.0, depth, density);
        }
        table.finish();
        for (t, expected) in [(0.5, 1.0), (1.5, 2.0), (2.25, 3.25), (3.5, 7.25), (9.0, 7.5)] {
            assert!((table.depth_at(t) - expected).abs() < 1e-12, "{t}: {}", table.depth_at(t));
        }
    }

    #[test]
    fn depth_never_decreases_whatever_the_knots() {
        let mut stream = Stream::new(3, Purpose::Test, 0, 0);
        let mut table = DepthTable::new();
        for _ in 0..200 {
            table.clear();
            let (mut t, mut depth) = (stream.uniform(), 0.0);
            let knots = 1 + (stream.uniform() * 20.0) as usize;
            for _ in 0..knots {
                let density = if stream.uniform() < 0.3 { 0.0 } else { stream.exponential().powi(4) };
                table.push(t, depth, density);
                t += stream.exponential().powi(3) + 1e-9;
                depth += if stream.uniform() < 0.3 { 0.0 } else { stream.exponential() };
            }
            table.finish();
            let mut before = table.depth_at(-1.0);
            assert_eq!(before, 0.0);
            for i in 0..=2000 {
                let now = table.depth_at(1.1 * t * f64::from(i) / 2000.0);
                assert!(now >= before - 1e-12 * table.total() && now <= table.total() * (1.0 + 1e-12));
                before = now;
            }
            assert_eq!(table.depth_at(f64::INFINITY), table.total());
        }
        table.clear();
        table.finish();
        assert_eq!(table.depth_at(1.0), 0.0);
    }
}
