//! Boxes around and areas of transformed spheres and cylinders.

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
    let [a, b, c] = eigenvalues(&(m.transpose() * *m)).map(|x| x.max(0.0));
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

/// The eigenvalues of a symmetric matrix by Jacobi's rotations (Golub and Van Loan, section 8.5).
fn eigenvalues(s: &DMat3) -> [f64; 3] {
    let mut a = s.to_cols_array_2d();
    for _ in 0..16 {
        for (p, q) in [(0, 1), (0, 2), (1, 2)] {
            if a[p][q] == 0.0 {
                continue;
            }
            let tau = (a[q][q] - a[p][p]) / (2.0 * a[p][q]);
            let t = 1f64.copysign(tau) / (tau.abs() + tau.hypot(1.0));
            let c = t.hypot(1.0).recip();
            let s = t * c;
            for row in &mut a {
                (row[p], row[q]) = (c * row[p] - s * row[q], s * row[p] + c * row[q]);
            }
            let (row_p, row_q) = (a[p], a[q]);
            for k in 0..3 {
                a[p][k] = c * row_p[k] - s * row_q[k];
                a[q][k] = s * row_p[k] + c * row_q[k];
            }
        }
    }
    [a[0][0], a[1][1], a[2][2]]
}
