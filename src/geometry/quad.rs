use crate::math::{Bounds, DAffine3, DVec3, Ray};
use crate::{Error, Result};

/// A parallelogram; open. Out is the side of edge_u × edge_v.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Quad {
    origin: DVec3,
    edge_u: DVec3,
    edge_v: DVec3,
    normal: DVec3,
    /// Dual to the edges: `p · dual_u` is how many `edge_u` lie in `p`.
    dual_u: DVec3,
    dual_v: DVec3,
}

impl Quad {
    /// The parallelogram with the corner `origin` and two edges that start there.
    ///
    /// # Errors
    /// When the edges are parallel, an edge is zero or a number is not finite.
    pub fn new(origin: DVec3, edge_u: DVec3, edge_v: DVec3) -> Result<Self> {
        let cross = edge_u.cross(edge_v);
        let n2 = cross.length_squared();
        let quad = Quad {
            origin,
            edge_u,
            edge_v,
            normal: cross / n2.sqrt(),
            dual_u: edge_v.cross(cross) / n2,
            dual_v: cross.cross(edge_u) / n2,
        };
        let finite = [quad.origin, quad.normal, quad.dual_u, quad.dual_v].iter().all(|v| v.is_finite());
        if !finite || n2.sqrt() <= 1e-14 * edge_u.length() * edge_v.length() {
            return Err(Error::Scene(format!(
                "a quad with origin {origin}, edge_u {edge_u} and edge_v {edge_v}: \
                 expected finite numbers and edges that are neither zero nor parallel"
            )));
        }
        Ok(quad)
    }

    /// This, `by` further on.
    pub(super) fn moved(self, by: DVec3) -> Self {
        Quad { origin: self.origin + by, ..self }
    }

    pub(super) fn bounds(&self, m: &DAffine3) -> Bounds {
        let corners = [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]];
        Bounds::of_points(corners.map(|u| m.transform_point3(self.sample(u))))
    }

    /// The border belongs to the quad, widened by the rounding of the point, so that quads that share
    /// an edge leave no gap.
    #[inline]
    pub(super) fn crossings(&self, ray: &Ray, (t_min, t_max): (f64, f64), visit: &mut impl FnMut(f64)) {
        let cosine = ray.direction.dot(self.normal);
        let from = ray.origin - self.origin;
        let t = -from.dot(self.normal) / cosine;
        // Most rays that come here meet the plane before or beyond; a parallel one nowhere.
        if cosine == 0.0 || t <= t_min || t >= t_max {
            return;
        }
        let p = from + t * ray.direction;
        let (u, v) = (p.dot(self.dual_u), p.dot(self.dual_v));
        if (0.0..=1.0).contains(&u) && (0.0..=1.0).contains(&v) {
            visit(t);
            return;
        }
        let rounding = 32.0 * f64::EPSILON * (from.abs() + ray.origin.abs() + (t * ray.direction).abs());
        let (gap_u, gap_v) = (rounding.dot(self.dual_u.abs()), rounding.dot(self.dual_v.abs()));
        if u >= -gap_u && u <= 1.0 + gap_u && v >= -gap_v && v <= 1.0 + gap_v {
            visit(t);
        }
    }

    pub(super) fn normal(&self) -> DVec3 {
        self.normal
    }

    pub(super) fn uv(&self, p: DVec3) -> [f64; 2] {
        let p = p - self.origin;
        [p.dot(self.dual_u).clamp(0.0, 1.0), p.dot(self.dual_v).clamp(0.0, 1.0)]
    }

    /// ∂p/∂u and ∂p/∂v.
    pub(super) fn tangents(&self) -> [DVec3; 2] {
        [self.edge_u, self.edge_v]
    }

    pub(super) fn area(&self) -> f64 {
        self.edge_u.cross(self.edge_v).length()
    }

    pub(super) fn sample(&self, [u, v]: [f64; 2]) -> DVec3 {
        self.origin + u * self.edge_u + v * self.edge_v
    }

    /// The quad as origin and two edges.
    pub(super) fn face(&self) -> [DVec3; 3] {
        [self.origin, self.edge_u, self.edge_v]
    }
}
