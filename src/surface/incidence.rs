use crate::math::{DVec3, Frame};

/// Whether a walk carries the power of photons or the importance of an eye.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Side {
    /// Photons carry power, which refraction leaves alone.
    Light,
    /// Eye paths bring radiance, which refraction from index η₁ into η₂ multiplies by (η₁/η₂)².
    Eye,
}

/// How light, or an eye path, meets a surface.
#[derive(Clone, Copy, Debug)]
pub struct Incidence {
    /// The unit direction of travel.
    pub direction: DVec3,
    /// The unit geometric normal on the side of arrival.
    pub normal: DVec3,
    /// The unit shading normal on the side of arrival.
    pub shading_normal: DVec3,
    /// The direction along which the surface's u grows, of any length; 0 where no one asks for it.
    pub tangent: DVec3,
}

impl Incidence {
    /// Travel straight against both normals.
    pub fn head_on() -> Self {
        Incidence { direction: -DVec3::Z, normal: DVec3::Z, shading_normal: DVec3::Z, tangent: DVec3::ZERO }
    }

    /// Coordinates whose z is the shading normal, with x along the tangent where there is one.
    pub fn frame(&self) -> Frame {
        let z = self.shading_normal;
        match (self.tangent - self.tangent.dot(z) * z).try_normalize() {
            Some(x) => Frame { x, y: z.cross(x), z },
            None => Frame::around(z),
        }
    }

    /// By what a shading normal changes the power that leaves along `direction`: |i·s| |o·g| / (|i·g| |o·s|) for photons that
    /// arrive along i and leave along o, with the geometric normal g and the normal `s` that directions were taken about
    /// (Veach 1996). 1 for eyes: shading normals break the symmetry of light and eye, and this restores it.
    pub fn adjoint(&self, side: Side, s: DVec3, direction: DVec3) -> f64 {
        if side == Side::Eye || s == self.normal {
            return 1.0;
        }
        let arriving = self.direction.dot(s) / self.direction.dot(self.normal);
        let leaving = direction.dot(self.normal) / direction.dot(s);
        (arriving * leaving).abs()
    }

    /// The normal for a specular event: the shading normal, if what it leads to lies on the right side of the surface (that of
    /// arrival if light is `reflected`, else beyond), else the geometric one.
    pub fn specular_normal(&self, outcome: impl Fn(DVec3) -> Option<DVec3>, reflected: bool) -> DVec3 {
        let right = outcome(self.shading_normal).is_none_or(|d| (d.dot(self.normal) > 0.0) == reflected);
        if right { self.shading_normal } else { self.normal }
    }
}
