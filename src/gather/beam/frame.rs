//! A ray in coordinates of its own, and which spheres and boxes of the hierarchy it touches.

use crate::math::{DVec3, Frame};
use crate::photon::discs::PhotonMap;
use crate::photon::simd::{Lanes, Row, dot_plus, load3, splat3};

/// A ray with two directions across it: x ↦ x·axis + offset gives the coordinates along ω, u and v.
/// Offsets are exact in f64, and cancel against coordinates of the same size as the map's, however far
/// away the ray starts.
#[derive(Clone, Copy, Debug)]
pub(in crate::gather) struct RayFrame {
    axes: [[f32; 3]; 3],
    offset: [f32; 3],
    length: f32,
}

impl RayFrame {
    pub(in crate::gather) fn new(origin: DVec3, direction: DVec3, length: f32) -> Self {
        let frame = Frame::around(direction);
        let axes = [direction, frame.x, frame.y];
        RayFrame {
            axes: axes.map(|axis| axis.as_vec3().to_array()),
            offset: axes.map(|axis| -axis.dot(origin) as f32),
            length,
        }
    }

    #[inline(always)]
    pub(in crate::gather) fn lanes<L: Lanes>(&self) -> RayLanes<L> {
        RayLanes {
            omega: splat3(self.axes[0]),
            u: splat3(self.axes[1]),
            v: splat3(self.axes[2]),
            offset: splat3(self.offset),
            length: L::splat(self.length),
        }
    }
}

/// A [`RayFrame`] in every lane.
pub(in crate::gather) struct RayLanes<L> {
    pub(super) omega: [L; 3],
    pub(super) u: [L; 3],
    pub(super) v: [L; 3],
    pub(super) offset: [L; 3],
    pub(super) length: L,
}

impl<L: Lanes> RayLanes<L> {
    /// Which spheres the segment touches.
    #[inline(always)]
    pub(in crate::gather) fn hit(&self, center: &[Row; 3], radius: &Row) -> u16 {
        let x = load3::<L>(center);
        let radius = L::load(radius);
        let t = dot_plus(&x, &self.omega, self.offset[0]);
        let a = dot_plus(&x, &self.u, self.offset[1]);
        let b = dot_plus(&x, &self.v, self.offset[2]);
        let near = a.mul_add(a, b.mul(b)).less_equal(radius.mul(radius));
        let ahead = L::splat(0.0).less(t.add(radius));
        let before_end = t.sub(radius).less(self.length);
        L::bits(L::and(near, L::and(ahead, before_end)))
    }
}

/// The ray as the box test wants it, its origin moved along it to next to the map.
#[derive(Clone, Copy, Debug)]
pub(in crate::gather) struct Slabs {
    origin: [f32; 3],
    inverse: [f32; 3],
    start: f32,
    end: f32,
}

/// Stands for 1/0: a ray parallel to a slab is inside of it always or never.
const PARALLEL: f32 = 1e30;

impl Slabs {
    pub(in crate::gather) fn new(map: &PhotonMap, origin: DVec3, direction: DVec3, length: f32) -> Self {
        let moved = (map.bounds().center() - origin).dot(direction);
        let origin = (origin + moved * direction).as_vec3().to_array();
        let inverse = direction.to_array().map(|w| {
            let inverse = (1.0 / w) as f32;
            if inverse.abs() < PARALLEL { inverse } else { PARALLEL.copysign(w as f32) }
        });
        // Ends are off by roundings of the distance moved. The last is finite, so that it lies
        // before boxes that do not exist.
        let slack = 4.0 * f32::EPSILON * moved.abs() as f32;
        let end = ((f64::from(length) - moved) as f32 + slack).min(f32::MAX);
        Slabs { origin, inverse, start: -moved as f32 - slack, end }
    }

    /// Which boxes the segment touches.
    #[inline(always)]
    pub(in crate::gather) fn hit<L: Lanes>(&self, min: &[Row; 3], max: &[Row; 3]) -> u16 {
        let mut enter = L::splat(self.start);
        let mut leave = L::splat(self.end);
        for axis in 0..3 {
            let (origin, inverse) = (L::splat(self.origin[axis]), L::splat(self.inverse[axis]));
            let low = L::load(&min[axis]).sub(origin).mul(inverse);
            let high = L::load(&max[axis]).sub(origin).mul(inverse);
            enter = enter.max(low.min(high));
            leave = leave.min(low.max(high));
        }
        L::bits(enter.less_equal(leave))
    }
}
