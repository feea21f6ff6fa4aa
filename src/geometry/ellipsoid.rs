//! Boxes around, areas of and closest points on transformed spheres, disks and cylinders.

use crate::math::{Bounds, DMat3, DVec3};
use std::f64::consts::{PI, TAU};

/// The box around the ellipsoid (three axes) or ellipse (two) that a matrix with the columns `axes` makes
/// of the unit sphere or circle.
pub(super) fn bounds_about(center: DVec3, axes: &[DVec3]) -> Bounds {
    let reach = axes.iter().map(|&a| a * a).sum::<DVec3>().map(f64::sqrt);
    Bounds { min: center - reach, max: center + reach }
}

/// The area of the image of the unit sphere under `m`: |det m| ∫ |m⁻ᵀn| dn over the sphere, which is
/// 4π |det m| R_G(λ₁, λ₂, λ₃) with Carlson's symmetric integral (DLMF 19.16.3) and the eigenvalues of
/// m⁻¹m⁻ᵀ; pulling |det m| into them leaves products of squared semi-axes (DLMF 19.33.1).
pub(super) fn area(m: &DMat3) -> f64 {
    let [a, b, c] = semi_axes(m).map(|axis| axis.length_squared());
    let scale = a.max(b).max(c);
    let [a, b, c] = [a, b, c].map(|x| x / scale);
    4.0 * PI * scale * r_g(a * b, a * c, b * c)
}

/// The length of the curve u cos φ + v sin φ over a full turn, by the arithmetic–geometric mean
/// (DLMF 19.8.6).
pub(super) fn circumference(u: DVec3, v: DVec3) -> f64 {
    // ---- semi-axes: singular values of the two columns, the smaller by their product
    let (uu, vv, uv) = (u.length_squared(), v.length_squared(), u.dot(v));
    let large = (0.5 * (uu + vv + (uu - vv).hypot(2.0 * uv))).sqrt();
    if large == 0.0 {
        return 0.0;
    }
    let (mut a, mut g) = (1.0, u.cross(v).length() / (large * large));
    let (mut sum, mut weight) = (1.0, 0.5);
    let mut c2 = 1.0 - g * g;
    // Convergence is quadratic.
    for _ in 0..40 {
        sum -= weight * c2;
        let c = 0.5 * (a - g);
        (a, g) = (0.5 * (a + g), (a * g).sqrt());
        c2 = c * c;
        weight *= 2.0;
        if c <= 1e-17 * a {
            break;
        }
    }
    TAU * large * sum / a
}

/// The point closest to `p` of the image of the unit sphere about `center` under `m`, which can be inverted.
///
/// Along the semi-axes, of lengths rᵢ in units of the shortest, the closest point to z is xᵢ = rᵢ² zᵢ/(u + rᵢ² − 1) with
/// the largest u ≥ 0 that puts it on the surface. Newton's steps on 1/√Σ(xᵢ/rᵢ)² − 1, which is concave, go to it from below
/// (Moré and Sorensen 1983). Where there is none, `p` is in the middle plane across a shortest axis, whose sides are alike.
pub(super) fn closest(center: DVec3, m: &DMat3, p: DVec3) -> DVec3 {
    let axes = semi_axes(m);
    let lengths = axes.map(|axis| axis.length());
    let shortest = lengths.into_iter().fold(f64::INFINITY, f64::min);
    let r = DVec3::from_array(lengths) / shortest;
    let z = DVec3::from_array(axes.map(|axis| (p - center).dot(axis))) / (r * shortest * shortest);
    // ---- xᵢ/rᵢ; along the shortest axes z is 0 where u is
    let beyond = r * r - 1.0;
    let below = |u: f64| (u + beyond).max(DVec3::splat(f64::MIN_POSITIVE));
    let mut u = (r * z.abs() - beyond).max_element().max(0.0);
    let mut n = r * z / below(u);
    for _ in 0..64 {
        let sum = n.length_squared();
        let next = u + (sum.sqrt() - 1.0) * sum / (n * n / below(u)).element_sum();
        if next.is_nan() || next <= u {
            break;
        }
        u = next;
        n = r * z / below(u);
    }
    if u == 0.0 {
        n[r.min_position()] += (1.0 - n.length_squared()).max(0.0).sqrt();
    }
    let n = n.normalize_or(DVec3::Z);
    center + n.x * axes[0] + n.y * axes[1] + n.z * axes[2]
}

/// The point closest to `p` of the elliptic disk with conjugate radii `u` and `v`, which are equal and
/// perpendicular if `circular`.
pub(super) fn closest_of_disk(center: DVec3, [u, v]: [DVec3; 2], circular: bool, p: DVec3) -> DVec3 {
    let (x, y) = coordinates(p - center, u, v);
    let r = x.hypot(y);
    if r <= 1.0 {
        return center + x * u + y * v;
    }
    if circular {
        return center + (x * u + y * v) / r;
    }
    closest_of_turn(p, |c, s| center + c * u + s * v)
}

/// The point closest to `p` of the side of a cylinder, a base with radii as above swept along `axis`,
/// which is perpendicular to them if `circular`.
pub(super) fn closest_of_side(base: DVec3, [u, v]: [DVec3; 2], axis: DVec3, circular: bool, p: DVec3) -> DVec3 {
    let on_line = |c: f64, s: f64| {
        let start = base + c * u + s * v;
        start + ((p - start).dot(axis) / axis.length_squared()).clamp(0.0, 1.0) * axis
    };
    if circular {
        let (x, y) = ((p - base).dot(u), (p - base).dot(v));
        let r = x.hypot(y);
        return if r > 0.0 { on_line(x / r, y / r) } else { on_line(1.0, 0.0) };
    }
    closest_of_turn(p, on_line)
}

/// How many `u` and `v` add up to the foot of `d` on their plane.
fn coordinates(d: DVec3, u: DVec3, v: DVec3) -> (f64, f64) {
    let (uu, uv, vv) = (u.dot(u), u.dot(v), v.dot(v));
    let (du, dv) = (d.dot(u), d.dot(v));
    let det = uu * vv - uv * uv;
    ((vv * du - uv * dv) / det, (uu * dv - uv * du) / det)
}

/// The point closest to `p` of a closed curve over cosine and sine of the turn: the best of some places,
/// refined by golden sections (Kiefer 1953).
pub(super) fn closest_of_turn(p: DVec3, curve: impl Fn(f64, f64) -> DVec3) -> DVec3 {
    const PLACES: u32 = 64;
    const GOLDEN: f64 = 0.618_033_988_749_894_8;
    let at = |turn: f64| {
        let (s, c) = turn.sin_cos();
        curve(c, s)
    };
    let distance = |turn: f64| at(turn).distance_squared(p);
    let width = TAU / f64::from(PLACES);
    let start =
        (0..PLACES).map(|i| f64::from(i) * width).min_by(|a, b| distance(*a).total_cmp(&distance(*b))).unwrap_or(0.0);
    let (mut low, mut high) = (start - width, start + width);
    for _ in 0..48 {
        let (a, b) = (high - GOLDEN * (high - low), low + GOLDEN * (high - low));
        if distance(a) < distance(b) {
            high = b;
        } else {
            low = a;
        }
    }
    at(0.5 * (low + high))
}

/// Carlson's R_G, arguments not negative (DLMF 19.21.10), by duplication.
fn r_g(x: f64, y: f64, z: f64) -> f64 {
    // ---- z between x and y avoids cancellation
    let mut v = [x, y, z];
    v.sort_by(f64::total_cmp);
    let [x, z, y] = v;
    if z == 0.0 {
        return 0.5 * y.sqrt();
    }
    0.5 * (z * r_f(x, y, z) - (x - z) * (y - z) / 3.0 * r_d(x, y, z) + (x * y / z).sqrt())
}

/// Carlson's R_F (1995, "Numerical computation of real or complex elliptic integrals", eq. 2.2–2.7).
fn r_f(mut x: f64, mut y: f64, mut z: f64) -> f64 {
    loop {
        let mean = (x + y + z) / 3.0;
        let (dx, dy, dz) = (1.0 - x / mean, 1.0 - y / mean, 1.0 - z / mean);
        if dx.abs().max(dy.abs()).max(dz.abs()) < 1e-3 {
            let (e2, e3) = (dx * dy - dz * dz, dx * dy * dz);
            return (1.0 - e2 / 10.0 + e3 / 14.0 + e2 * e2 / 24.0 - 3.0 * e2 * e3 / 44.0) / mean.sqrt();
        }
        let root = DVec3::new(x, y, z).map(f64::sqrt);
        let lambda = root.x * root.y + root.y * root.z + root.z * root.x;
        (x, y, z) = (0.25 * (x + lambda), 0.25 * (y + lambda), 0.25 * (z + lambda));
    }
}

/// Carlson's R_D (1995, eq. 2.28–2.33).
fn r_d(mut x: f64, mut y: f64, mut z: f64) -> f64 {
    let (mut sum, mut factor) = (0.0, 1.0);
    loop {
        let mean = (x + y + 3.0 * z) / 5.0;
        let (dx, dy, dz) = (1.0 - x / mean, 1.0 - y / mean, 1.0 - z / mean);
        if dx.abs().max(dy.abs()).max(dz.abs()) < 1e-3 {
            let (xy, zz) = (dx * dy, dz * dz);
            let e2 = xy - 6.0 * zz;
            let e3 = (3.0 * xy - 8.0 * zz) * dz;
            let e4 = 3.0 * (xy - zz) * zz;
            let e5 = xy * zz * dz;
            let series =
                1.0 - 3.0 * e2 / 14.0 + e3 / 6.0 + 9.0 * e2 * e2 / 88.0 - 3.0 * e4 / 22.0 - 9.0 * e2 * e3 / 52.0
                    + 3.0 * e5 / 26.0;
            return 3.0 * sum + factor * series / (mean * mean.sqrt());
        }
        let root = DVec3::new(x, y, z).map(f64::sqrt);
        let lambda = root.x * root.y + root.y * root.z + root.z * root.x;
        sum += factor / (root.z * (z + lambda));
        factor *= 0.25;
        (x, y, z) = (0.25 * (x + lambda), 0.25 * (y + lambda), 0.25 * (z + lambda));
    }
}

/// The semi-axes of the image of the unit sphere under `m`: its columns, turned until they are perpendicular, by Jacobi's
/// rotations from one side, which keep the digits of the short ones (Hestenes 1958; Golub and Van Loan, section 8.6).
fn semi_axes(m: &DMat3) -> [DVec3; 3] {
    let mut axes = [m.x_axis, m.y_axis, m.z_axis];
    for _ in 0..16 {
        let mut perpendicular = true;
        for (p, q) in [(0, 1), (0, 2), (1, 2)] {
            let (pp, qq, pq) = (axes[p].length_squared(), axes[q].length_squared(), axes[p].dot(axes[q]));
            if pq.abs() <= f64::EPSILON * (pp * qq).sqrt() {
                continue;
            }
            perpendicular = false;
            let tau = (qq - pp) / (2.0 * pq);
            let t = 1f64.copysign(tau) / (tau.abs() + tau.hypot(1.0));
            let c = t.hypot(1.0).recip();
            let s = t * c;
            (axes[p], axes[q]) = (c * axes[p] - s * axes[q], s * axes[p] + c * axes[q]);
        }
        if perpendicular {
            break;
        }
    }
    axes
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::random::Purpose;
    use crate::math::{Stream, sampling};

    #[test]
    fn areas_match_closed_forms() {
        let turn = DMat3::from_axis_angle(DVec3::new(1.0, 2.0, -2.0) / 3.0, 1.1);
        for a in [1e-3, 0.3, 0.999_999, 1.0, 1.5, 40.0] {
            let m = 7.0 * turn * DMat3::from_diagonal(DVec3::new(1.0, a, 1.0)) * turn;
            // Spheroids with semi-axes 1, 1, a.
            let e2: f64 = 1.0 - a * a;
            let expected = if a == 1.0 {
                4.0 * PI
            } else if a < 1.0 {
                TAU * (1.0 + a * a / e2.sqrt() * e2.sqrt().atanh())
            } else {
                let e = (1.0 - 1.0 / (a * a)).sqrt();
                TAU * (1.0 + a / e * e.asin())
            };
            assert!((area(&m) / (49.0 * expected) - 1.0).abs() < 1e-10, "{a}: {}", area(&m) / 49.0);
            // An ellipse as the integral of its speed: the trapezoidal rule converges exponentially.
            let (u, v) = (turn * DVec3::X + turn * DVec3::Y * 0.3, turn * DVec3::Y * a);
            let n = if a < 0.1 { 100_000 } else { 2000 };
            let speed = |i| (TAU * i as f64 / n as f64).sin_cos();
            let sum: f64 = (0..n).map(speed).map(|(s, c)| (c * v - s * u).length()).sum();
            assert!((circumference(u, v) * n as f64 / (TAU * sum) - 1.0).abs() < 1e-9);
        }
    }

    /// No point of the surface is closer, whether `p` lies outside or inside, in the middle or on a plane of symmetry, and
    /// however much longer one axis is than another.
    #[test]
    fn closest_points_of_ellipsoids_are_undercut_by_none() {
        let mut r = Stream::new(71, Purpose::Test, 0, 0);
        for k in 0..2000 {
            let turn = DMat3::from_axis_angle(sampling::sphere(r.uniform2()), 3.0 * r.uniform());
            let other = DMat3::from_axis_angle(sampling::sphere(r.uniform2()), 3.0 * r.uniform());
            let lengths = match k % 4 {
                0 => DVec3::new(2.0, 1.0, 1.0),
                1 => DVec3::new(1.0, 3.0, 3.0),
                _ => DVec3::new(1.0, 10f64.powf(3.0 * r.uniform()), 10f64.powf(6.0 * r.uniform())),
            };
            let m = turn * DMat3::from_diagonal(lengths) * other;
            let mut inside = 2.0 * r.uniform() * sampling::sphere(r.uniform2());
            if k % 3 == 0 {
                inside[k % 9 / 3] = 0.0;
            }
            if k % 5 == 0 {
                inside[k % 15 / 5] = 0.0;
            }
            let p =
                turn * (lengths * inside) + if k % 7 == 0 { 5.0 * sampling::sphere(r.uniform2()) } else { DVec3::ZERO };
            let on = closest(DVec3::ZERO, &m, p);
            let n = other.transpose() * (turn.transpose() * on / lengths);
            assert!((n.length() - 1.0).abs() < 1e-9, "{lengths} {inside}: {on}");
            for _ in 0..200 {
                let near = 10f64.powf(-8.0 * r.uniform());
                let q = m * (n + near * sampling::sphere(r.uniform2())).normalize();
                let rounding = 1e-15 * p.length().max(lengths.max_element());
                assert!(on.distance(p) <= q.distance(p) + rounding, "{lengths} {inside}: {on}, {q}");
            }
        }
        // From its middle it is as far as the shortest axis, from a place on the longest within the evolute by
        // b² (1 − x²/(a² − b²)) less.
        let m = DMat3::from_diagonal(DVec3::new(3.0, 1.0, 2.0));
        for x in [0.0, 1.0, 2.5] {
            let apart = closest(DVec3::ONE, &m, DVec3::new(1.0 + x, 1.0, 1.0)) - DVec3::new(1.0 + x, 1.0, 1.0);
            assert!((apart.length_squared() - (1.0 - x * x / 8.0)).abs() < 1e-14);
        }
    }
}
