use super::mirror::reflect;
use crate::math::{DVec3, Stream};
use std::f64::consts::{PI, TAU};

/// Facets that light meets in one visit, at most; 1 in 10⁶ meets more than thirty.
pub(super) const MOST_FACETS: u32 = 1000;

/// The normals of facets by GGX (Walter, Marschner, Li and Torrance 2007, Eqs. 33–34; stretched as by Heitz 2014):
///
/// D(m) = 1/(π α_x α_y (m_x²/α_x² + m_y²/α_y² + m_z²)²),  G₁(v) = 2/(1 + √(1 + (α_x² v_x² + α_y² v_y²)/v_z²)),
///
/// in coordinates whose z is the surface's normal.
#[derive(Clone, Copy, Debug)]
pub(super) struct Ggx {
    /// α along x and along y, above 0.
    pub alpha: [f64; 2],
}

impl Ggx {
    /// The same in all directions.
    #[inline]
    pub fn round(alpha: f64) -> Self {
        Ggx { alpha: [alpha; 2] }
    }

    /// α_x² v_x² + α_y² v_y².
    #[inline]
    fn across(&self, v: DVec3) -> f64 {
        let [x, y] = [self.alpha[0] * v.x, self.alpha[1] * v.y];
        x * x + y * y
    }

    /// G₁: the share of light along `v` that no other facet is in the way of.
    #[inline]
    pub fn unmasked(&self, v: DVec3) -> f64 {
        2.0 / (1.0 + (1.0 + self.across(v) / (v.z * v.z)).sqrt())
    }

    /// The density of the normals of facets as seen from `v`, above the surface or below it: D (v·m)/σ(v), where
    /// σ(v) = (z + √(z² + α_x² v_x² + α_y² v_y²))/2 is the area of all facets as seen from there: z/G₁ from above.
    #[inline]
    pub fn visible_density(&self, v: DVec3, m: DVec3) -> f64 {
        if m.z <= 0.0 {
            return 0.0;
        }
        let [x, y] = self.alpha;
        let across = self.across(v);
        let root = v.z.abs() + (v.z * v.z + across).sqrt();
        // Without cancellation from below.
        let area = 0.5 * if v.z >= 0.0 { root } else { across / root };
        if area <= 0.0 {
            return 0.0;
        }
        let spread = x * y * m.z * m.z + (y / x * m.x * m.x + x / y * m.y * m.y);
        x * y / (PI * spread * spread) * v.dot(m).max(0.0) / area
    }

    /// The density with which one facet reflects light that comes from `i` to `o`, and the cosine to it; `None` where it does not.
    #[inline]
    pub fn reflection(&self, i: DVec3, o: DVec3) -> Option<(f64, f64)> {
        let half = (i + o).try_normalize()?;
        let cos = i.dot(half);
        let density = self.unmasked(o) * self.visible_density(i, half) / (4.0 * cos);
        (cos > 0.0 && density > 0.0 && density.is_finite()).then_some((density, cos))
    }

    /// Draws the normal of a facet as seen from `v`, above the surface or below it (Heitz 2018, whose half disc
    /// and half ellipse become a crescent for directions from below).
    pub fn visible(&self, v: DVec3, [u1, u2]: [f64; 2]) -> DVec3 {
        let [x, y] = self.alpha;
        let stretched = DVec3::new(x * v.x, y * v.y, v.z).normalize();
        let across = stretched.x * stretched.x + stretched.y * stretched.y;
        let t1 = if across > 0.0 { DVec3::new(-stretched.y, stretched.x, 0.0) / across.sqrt() } else { DVec3::X };
        let t2 = stretched.cross(t1);
        let (sin, cos) = (TAU * u2).sin_cos();
        let (p1, full) = (u1.sqrt() * cos, u1.sqrt() * sin);
        let s = 0.5 * (1.0 + stretched.z);
        let p2 = (1.0 - s) * (1.0 - p1 * p1).max(0.0).sqrt() + s * full;
        let p3 = (1.0 - p1 * p1 - p2 * p2).max(0.0).sqrt();
        let normal = p1 * t1 + p2 * t2 + p3 * stretched;
        DVec3::new(x * normal.x, y * normal.y, normal.z.max(1e-9)).normalize()
    }

    /// Reflects light at a facet that it sees. Returns the cosine to that, and whether no other one is in the way then.
    #[inline]
    pub fn bounce(&self, travel: &mut DVec3, stream: &mut Stream) -> (f64, bool) {
        let facet = self.visible(-*travel, stream.uniform2());
        let cos = -travel.dot(facet);
        *travel = reflect(*travel, facet);
        (cos, travel.z > 0.0 && stream.uniform() < self.unmasked(*travel))
    }
}
