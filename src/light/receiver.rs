use crate::math::DVec3;

/// Who asks for light: a point, and the side on which it receives any.
#[derive(Clone, Copy, Debug)]
pub struct Receiver {
    /// The point.
    pub point: DVec3,
    /// The unit normal of a surface that takes light from its side only, by the cosine; 0 where light counts from all around.
    pub normal: DVec3,
}

impl Receiver {
    /// A point that light reaches from all around: in a medium, or on a surface that lets light pass.
    #[inline]
    pub fn around(point: DVec3) -> Self {
        Receiver { point, normal: DVec3::ZERO }
    }
}
