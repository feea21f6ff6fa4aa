//! Rays as lines in a frame, and cones around them.

#![allow(
    clippy::needless_range_loop,
    reason = "iterators' closures need not be inlined into a kernel's instruction set"
)]

use crate::gather::sampled::GROUP;
use crate::math::{DVec3, Frame, Ray};
use crate::photon::discs::PhotonMap;
use crate::photon::simd::Lanes;
use std::ops::Range;

/// A cone, its spread growing from z = 0 in both directions.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Around {
    offset: [f32; 2],
    slope: [f32; 2],
    spread: f32,
    pub(super) widening: f32,
}

impl Around {
    pub(super) const AXIS: Around = Around { offset: [0.0; 2], slope: [0.0; 2], spread: 0.0, widening: 0.0 };
}

/// A ray in a frame: x = offset + slope·z.
#[derive(Clone, Copy, Debug)]
pub(super) struct Line {
    /// Where its parameter is 0.
    origin: f64,
    offset: [f64; 2],
    pub(super) slope: [f64; 2],
    start: f64,
    end: f64,
    /// The cosine between ray and axis.
    pub(super) cos: f64,
}

impl Line {
    /// Rays that lean away from the axis by more are too oblique.
    pub(super) const LEAST_COS: f64 = 0.5;

    #[inline(always)]
    pub(super) fn new(direction: DVec3, from: DVec3, (a, b): (f64, f64), frame: &Frame) -> Line {
        let cos = direction.dot(frame.z);
        let inverse = 1.0 / cos;
        let slope = [direction.dot(frame.x) * inverse, direction.dot(frame.y) * inverse];
        let z = from.dot(frame.z);
        let offset = [from.dot(frame.x) - z * slope[0], from.dot(frame.y) - z * slope[1]];
        Line { origin: z, offset, slope, start: z + a * cos, end: z + b * cos, cos }
    }

    /// The slope's square.
    pub(super) fn square(&self) -> f64 {
        square(self.slope)
    }
}

#[inline(always)]
pub(super) fn square([x, y]: [f64; 2]) -> f64 {
    x * x + y * y
}

/// The lines of a group's rays, by field.
#[derive(Clone, Debug)]
pub(super) struct Lines {
    pub(super) origin: [f64; GROUP],
    pub(super) offset: [[f64; GROUP]; 2],
    pub(super) slope: [[f64; GROUP]; 2],
    pub(super) square: [f64; GROUP],
    pub(super) start: [f64; GROUP],
    pub(super) end: [f64; GROUP],
    pub(super) cos: [f64; GROUP],
}

impl Lines {
    /// Of rays that end at `farthest` at the latest; lines to spare repeat the last. In loops that become vectors.
    #[inline(always)]
    pub(super) fn new(rays: &[(Ray, f64, f64)], frame: &Frame, origin: DVec3, farthest: f64) -> Self {
        let zero = [0.0; GROUP];
        let (mut direction, mut from, mut range) = ([zero; 3], [zero; 3], [zero; 2]);
        for i in 0..GROUP {
            let (ray, a, b) = &rays[i.min(rays.len() - 1)];
            let towards = ray.origin - origin;
            [direction[0][i], direction[1][i], direction[2][i]] = ray.direction.to_array();
            [from[0][i], from[1][i], from[2][i]] = towards.to_array();
            [range[0][i], range[1][i]] = [*a, b.min(farthest)];
        }
        let mut lines = Lines {
            origin: zero,
            offset: [zero; 2],
            slope: [zero; 2],
            square: zero,
            start: zero,
            end: zero,
            cos: zero,
        };
        for i in 0..GROUP {
            let along = DVec3::new(direction[0][i], direction[1][i], direction[2][i]);
            let from = DVec3::new(from[0][i], from[1][i], from[2][i]);
            let line = Line::new(along, from, (range[0][i], range[1][i]), frame);
            lines.origin[i] = line.origin;
            for axis in 0..2 {
                lines.offset[axis][i] = line.offset[axis];
                lines.slope[axis][i] = line.slope[axis];
            }
            lines.square[i] = line.square();
            lines.start[i] = line.start;
            lines.end[i] = line.end;
            lines.cos[i] = line.cos;
        }
        lines
    }

    /// The least and the greatest of a field.
    #[inline(always)]
    pub(super) fn extremes(field: &[f64; GROUP]) -> (f64, f64) {
        let (mut least, mut greatest) = (field[0], field[0]);
        for value in field {
            least = if *value < least { *value } else { least };
            greatest = if *value > greatest { *value } else { greatest };
        }
        (least, greatest)
    }
}

/// Rounded, and finite.
pub(super) fn bound(x: f64) -> f32 {
    x.clamp(f64::from(-f32::MAX), f64::from(f32::MAX)) as f32
}

/// Where rays come from and where they go.
#[derive(Clone, Copy, Debug)]
pub(super) struct Towards {
    /// The sums of directions and of origins.
    direction: DVec3,
    origins: DVec3,
    count: usize,
    /// The first one's origin, and whether it is that of all.
    origin: DVec3,
    common: bool,
}

impl Towards {
    pub(super) const NOWHERE: Towards =
        Towards { direction: DVec3::ZERO, origins: DVec3::ZERO, count: 0, origin: DVec3::ZERO, common: true };

    #[inline(always)]
    pub(super) fn of(rays: &[(Ray, f64, f64)]) -> Self {
        let mut all = Towards { origin: rays[0].0.origin, count: rays.len(), ..Self::NOWHERE };
        for (ray, ..) in rays {
            all.direction += ray.direction;
            all.origins += ray.origin;
            all.common &= ray.origin == all.origin;
        }
        all
    }

    pub(super) fn merge(&self, other: &Towards) -> Self {
        if self.count == 0 {
            return *other;
        }
        Towards {
            direction: self.direction + other.direction,
            origins: self.origins + other.origins,
            count: self.count + other.count,
            origin: self.origin,
            common: self.common && other.common && self.origin == other.origin,
        }
    }

    /// An axis, a place on it, and whether that is the origin of them all.
    pub(super) fn middle(&self, map: &PhotonMap) -> Option<(Frame, DVec3, bool)> {
        let axis = self.direction.try_normalize()?;
        // Single precision wants its origin near the map.
        let bounds = map.bounds();
        let pinhole = self.common && self.origin.distance(bounds.center()) < 4.0 * bounds.diagonal();
        let mean = if self.common { self.origin } else { self.origins / self.count as f64 };
        let origin = if pinhole { mean } else { mean + axis * (bounds.center() - mean).dot(axis) };
        Some((Frame::around(axis), origin, pinhole))
    }
}

pub(super) fn rows(frame: &Frame) -> [[f32; 3]; 3] {
    [frame.x, frame.y, frame.z].map(|axis| axis.as_vec3().to_array())
}

pub(super) fn offsets(frame: &Frame, origin: DVec3) -> [f32; 3] {
    [frame.x, frame.y, frame.z].map(|axis| -axis.dot(origin) as f32)
}

/// Lines of a group: by offset and slope.
pub(super) type Part<'a> = ([&'a [f64]; 2], [&'a [f64]; 2]);

impl Lines {
    #[inline(always)]
    pub(super) fn some(&self, range: Range<usize>) -> Part<'_> {
        let [x, y] = &self.offset;
        let [u, v] = &self.slope;
        ([&x[range.clone()], &y[range.clone()]], [&u[range.clone()], &v[range]])
    }
}

/// A cone around lines whose axis is their mean.
#[inline(always)]
pub(super) fn around(parts: &[Part<'_>]) -> Around {
    let (mut offset, mut slope, mut count) = ([0.0; 2], [0.0; 2], 0);
    for (offsets, slopes) in parts {
        count += offsets[0].len();
        for axis in 0..2 {
            for i in 0..offsets[axis].len() {
                offset[axis] += offsets[axis][i];
                slope[axis] += slopes[axis][i];
            }
        }
    }
    let share = 1.0 / count as f64;
    for axis in 0..2 {
        offset[axis] *= share;
        slope[axis] *= share;
    }
    let (mut spread, mut widening) = (0.0, 0.0);
    for (offsets, slopes) in parts {
        for i in 0..offsets[0].len() {
            let aside = square([offsets[0][i] - offset[0], offsets[1][i] - offset[1]]);
            let apart = square([slopes[0][i] - slope[0], slopes[1][i] - slope[1]]);
            spread = if aside > spread { aside } else { spread };
            widening = if apart > widening { apart } else { widening };
        }
    }
    Around::new(offset, slope, spread.sqrt(), widening.sqrt())
}

impl Around {
    /// Rounded up.
    pub(super) fn new(offset: [f64; 2], slope: [f64; 2], spread: f64, widening: f64) -> Self {
        let up = |x: f64| (x * (1.0 + 1e-5)) as f32;
        Around {
            offset: [offset[0] as f32, offset[1] as f32],
            slope: [slope[0] as f32, slope[1] as f32],
            spread: up(spread),
            widening: up(widening) + 1e-6,
        }
    }

    /// How far its lines may lean from z.
    pub(super) fn steepest(&self) -> f32 {
        self.widening + self.slope[0].hypot(self.slope[1])
    }
}

/// A cone in lanes.
pub(super) struct AroundLanes<L> {
    offset: [L; 2],
    slope: [L; 2],
    spread: L,
    widening: L,
}

impl Around {
    #[inline(always)]
    pub(super) fn lanes<L: Lanes>(&self) -> AroundLanes<L> {
        AroundLanes {
            offset: [L::splat(self.offset[0]), L::splat(self.offset[1])],
            slope: [L::splat(self.slope[0]), L::splat(self.slope[1])],
            spread: L::splat(self.spread),
            widening: L::splat(self.widening),
        }
    }
}

impl<L: Lanes> AroundLanes<L> {
    /// Which spheres of radius `r` around (a, b, z) it meets.
    #[inline(always)]
    pub(super) fn meets(&self, a: L, b: L, z: L, r: L) -> L::Mask {
        let x = z.neg_mul_add(self.slope[0], a.sub(self.offset[0]));
        let y = z.neg_mul_add(self.slope[1], b.sub(self.offset[1]));
        let limit = z.max(L::splat(0.0).sub(z)).add(r).mul_add(self.widening, self.spread.add(r));
        x.mul_add(x, y.mul(y)).less_equal(limit.mul(limit))
    }
}
