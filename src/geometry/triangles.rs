//! The corners of a mesh's triangles, and which triangles a ray passes.

use crate::math::{DMat3, DVec3, Ray, Vec3};
use glam::Vec4;

/// Triangles in fours: by corner, then axis, one triangle a lane.
#[derive(Debug)]
pub(super) struct Triangles {
    fours: Vec<[[Vec4; 3]; 3]>,
    count: usize,
    /// No coordinate is larger.
    reach: f64,
}

impl Triangles {
    /// Triangles with these corners.
    pub fn new(corners: impl Iterator<Item = [Vec3; 3]>) -> Self {
        let mut fours: Vec<[[Vec4; 3]; 3]> = Vec::with_capacity(corners.size_hint().0.div_ceil(4));
        let (mut count, mut reach) = (0, Vec3::ZERO);
        for triangle in corners {
            if count % 4 == 0 {
                fours.push([[Vec4::ZERO; 3]; 3]);
            }
            for (axes, corner) in fours[count / 4].iter_mut().zip(triangle) {
                for (lanes, x) in axes.iter_mut().zip(corner.to_array()) {
                    lanes[count % 4] = x;
                }
                reach = reach.max(corner.abs());
            }
            count += 1;
        }
        Triangles { fours, count, reach: f64::from(reach.max_element()) }
    }

    /// How many there are.
    pub fn count(&self) -> usize {
        self.count
    }

    /// The corners of one.
    #[inline]
    pub fn corners(&self, triangle: u32) -> [DVec3; 3] {
        let (lane, [a, b, c]) = (triangle as usize % 4, &self.fours[triangle as usize / 4]);
        let corner = |axes: &[Vec4; 3]| Vec3::new(axes[0][lane], axes[1][lane], axes[2][lane]).as_dvec3();
        [corner(a), corner(b), corner(c)]
    }
}

/// A ray sheared onto its main direction, as in the watertight test of Woop, Benthin and Wald 2013: a triangle is met where
/// the origin lies within it across that direction.
pub(super) struct Sheared<'m> {
    triangles: &'m Triangles,
    origin: DVec3,
    /// From a way off the origin to coordinates across the ray, and its parameter; for no index depends on the ray then,
    /// and zeros and ones do not round.
    rows: DMat3,
    /// The axes across the main direction, and that.
    axes: [usize; 3],
    /// How far along the axes across the ray goes per length along the main one; where it is at 0 along that.
    slope: [Vec4; 2],
    foot: [Vec4; 2],
    /// How far rounding moves a corner across the ray.
    off: Vec4,
}

impl<'m> Sheared<'m> {
    /// The ray before these triangles.
    #[inline(always)]
    pub fn new(triangles: &'m Triangles, ray: &Ray) -> Self {
        let (d, size) = (ray.direction, ray.direction.abs());
        let axes = if size.x >= size.y && size.x >= size.z {
            [1, 2, 0]
        } else if size.y >= size.z {
            [2, 0, 1]
        } else {
            [0, 1, 2]
        };
        let [x, y, z] = axes.map(|axis| DVec3::AXES[axis]);
        let along = d.dot(z);
        let slope = [x, y].map(|across| d.dot(across) / along);
        let rows = DMat3::from_cols(x - slope[0] * z, y - slope[1] * z, z / along).transpose();
        // A line that meets the triangles is within 4 `reach` of 0 across them. Slopes, corners and their sums are off by a dozen
        // roundings of that in `f32`, where the ray is by some of its origin in `f64`.
        let foot = rows * ray.origin;
        let off = triangles.reach * 2f64.powi(-19) + ray.origin.abs().max_element() * 2f64.powi(-46);
        Sheared {
            triangles,
            origin: ray.origin,
            rows,
            axes,
            slope: slope.map(|slope| Vec4::splat(slope as f32)),
            foot: [foot.x, foot.y].map(|foot| Vec4::splat(foot as f32)),
            off: Vec4::splat(off as f32),
        }
    }

    /// Of triangles `4 four` to `4 four + 3` those that the ray may meet, a bit each: it passes all others for certain.
    /// What lies in a box that a ray meets is mostly passed.
    #[inline(always)]
    pub fn may_meet(&self, four: usize) -> u32 {
        let [a, b, c] = &self.triangles.fours[four];
        let [x, y, z] = self.axes;
        let across =
            |p: &[Vec4; 3]| (p[x] - self.slope[0] * p[z] - self.foot[0], p[y] - self.slope[1] * p[z] - self.foot[1]);
        let ((ax, ay), (bx, by), (cx, cy)) = (across(a), across(b), across(c));
        let (u, v, w) = (cx * by - cy * bx, ax * cy - ay * cx, bx * ay - by * ax);
        // Each is off by at most 4 `off` of the largest coordinate and 2 off² and, its products rounding, by less once more.
        let largest = |a: Vec4, b: Vec4, c: Vec4| a.abs().max(b.abs()).max(c.abs());
        let most = largest(ax, bx, cx).max(largest(ay, by, cy));
        let bound = Vec4::splat(8.0) * self.off * (most + self.off) + Vec4::splat(f32::MIN_POSITIVE);
        let passed = u.min(v).min(w).cmplt(-bound) & u.max(v).max(w).cmpgt(bound);
        !passed.bitmask() & 0b1111
    }

    /// The parameter, and the weights of the second and third corner, where the ray's line meets a triangle: neighbours see
    /// a shared edge from the same side, so no line passes between them.
    #[inline(always)]
    pub fn meets(&self, triangle: u32) -> Option<(f64, [f64; 2])> {
        let [a, b, c] = self.triangles.corners(triangle);
        let sheared = |corner: DVec3| (self.rows * (corner - self.origin)).to_array();
        let (a, b, c) = (sheared(a), sheared(b), sheared(c));
        let u = c[0] * b[1] - c[1] * b[0];
        let v = a[0] * c[1] - a[1] * c[0];
        let w = b[0] * a[1] - b[1] * a[0];
        if (u < 0.0 || v < 0.0 || w < 0.0) && (u > 0.0 || v > 0.0 || w > 0.0) {
            return None;
        }
        let det = u + v + w;
        (det != 0.0).then(|| ((u * a[2] + v * b[2] + w * c[2]) / det, [v / det, w / det]))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::random::Purpose;
    use crate::math::{Stream, sampling};

    /// No triangle that a ray meets is taken for passed: of any size, anywhere, seen from afar and along its plane, through
    /// its corners and edges; and most are that it does not meet, if they are not smaller than rounding.
    #[test]
    fn only_what_is_passed_is_left_out() {
        let mut stream = Stream::new(61, Purpose::Test, 0, 0);
        let (mut met, mut passed, mut left) = (0, 0, 0);
        for k in 0..40_000 {
            let scale = 10f64.powf(60.0 * stream.uniform() - 30.0);
            let middle = [0.0, 1.0, 1e4][k % 3] * sampling::sphere(stream.uniform2());
            let size = 10f64.powf(-6.0 * stream.uniform() * stream.uniform());
            let mut corner = || ((middle + size * sampling::sphere(stream.uniform2())) * scale).as_vec3();
            let triangles = Triangles::new((0..4).map(|_| [corner(), corner(), corner()]));
            for triangle in 0..4 {
                // Towards a corner, a place on an edge, a place within; or past it.
                let [a, b, c] = triangles.corners(triangle);
                let [u, v] = stream.uniform2();
                let target = match stream.uniform() {
                    x if x < 0.2 => a,
                    x if x < 0.4 => a + u * (b - a),
                    x if x < 0.7 => a + u * (b - a) + v * (1.0 - u) * (c - a),
                    _ => a + size * scale * sampling::sphere([u, v]),
                };
                let far = scale * 10f64.powf(12.0 * stream.uniform() - 6.0);
                let aside = match stream.uniform() {
                    x if x < 0.2 => (b - a).normalize_or(DVec3::Y),
                    x if x < 0.3 => DVec3::X,
                    _ => sampling::sphere(stream.uniform2()),
                };
                let origin = target - far * aside;
                let ray = Ray { origin, direction: (target - origin) * stream.uniform() };
                let sheared = Sheared::new(&triangles, &ray);
                let may = sheared.may_meet(0);
                for other in 0..4 {
                    let may = may >> other & 1 == 1;
                    if sheared.meets(other).is_some() {
                        met += 1;
                        assert!(may, "{ray:?} meets {:?}", triangles.corners(other));
                    } else if k % 3 < 2 && size > 1e-2 && (1e-12..1e12).contains(&scale) {
                        passed += usize::from(!may);
                        left += usize::from(may);
                    }
                }
            }
        }
        assert!(met > 100_000 && passed > 10 * left, "{met} were met, {passed} passed, {left} left to be seen");
    }
}
