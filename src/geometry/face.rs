//! Flat faces, and their points closest to others.

use super::ellipsoid;
use crate::math::DVec3;

/// A flat face.
pub(super) enum Face {
    /// A corner and two edges.
    Parallelogram([DVec3; 3]),
    /// Three corners.
    Triangle([DVec3; 3]),
    /// Centre, two conjugate radii, and whether it is a circle.
    Ellipse(DVec3, [DVec3; 2], bool),
}

impl Face {
    /// Its point closest to `p`.
    pub(super) fn closest(&self, p: DVec3) -> DVec3 {
        let (o, u, v, parallelogram) = match *self {
            Face::Parallelogram([o, u, v]) => (o, u, v, true),
            Face::Triangle([a, b, c]) => (a, b - a, c - a, false),
            Face::Ellipse(center, radii, circular) => return ellipsoid::closest_of_disk(center, radii, circular, p),
        };
        // ---- the foot on the plane, if it is in the face
        let (d, uu, uv, vv) = (p - o, u.dot(u), u.dot(v), v.dot(v));
        let (du, dv) = (d.dot(u), d.dot(v));
        let det = uu * vv - uv * uv;
        // Which edges it is beyond; any, if there is no plane.
        let (mut low, mut left, mut high, mut right) = (true, true, parallelogram, true);
        if det > 0.0 {
            let (s, t) = ((vv * du - uv * dv) / det, (uu * dv - uv * du) / det);
            (low, left) = (t < 0.0, s < 0.0);
            (high, right) = if parallelogram { (t > 1.0, s > 1.0) } else { (false, s + t > 1.0) };
            if !(low || left || high || right) {
                return o + s * u + t * v;
            }
        }
        // ---- or else on one of those edges
        let edge = |a: DVec3, e: DVec3| a + (((p - a).dot(e) / e.length_squared()).clamp(0.0, 1.0)) * e;
        let mut nearest = (f64::INFINITY, o);
        let mut take = |beyond: bool, a: DVec3, e: DVec3| {
            if beyond {
                let on = edge(a, e);
                let distance2 = on.distance_squared(p);
                if distance2 < nearest.0 {
                    nearest = (distance2, on);
                }
            }
        };
        take(low, o, u);
        take(left, o, v);
        take(right, o + u, if parallelogram { v } else { v - u });
        take(high, o + v, u);
        nearest.1
    }
}
