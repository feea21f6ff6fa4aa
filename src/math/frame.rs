use super::DVec3;

/// A right-handed orthonormal frame whose `z` is a given direction.
#[derive(Clone, Copy, Debug)]
pub struct Frame {
    /// First tangent.
    pub x: DVec3,
    /// Second tangent.
    pub y: DVec3,
    /// The direction the frame was made for.
    pub z: DVec3,
}

impl Frame {
    /// A frame around the unit vector `z` (Duff et al. 2017, "Building an orthonormal basis, revisited").
    pub fn around(z: DVec3) -> Self {
        let sign = 1f64.copysign(z.z);
        let a = -1.0 / (sign + z.z);
        let b = z.x * z.y * a;
        Frame {
            x: DVec3::new(1.0 + sign * z.x * z.x * a, sign * b, -sign * z.x),
            y: DVec3::new(b, sign + z.y * z.y * a, -z.y),
            z,
        }
    }

    /// This frame, turned a little so that its z is the unit vector `z`.
    pub fn turned(&self, z: DVec3) -> Frame {
        let x = (self.x - self.x.dot(z) * z).normalize_or(Frame::around(z).x);
        Frame { x, y: z.cross(x), z }
    }

    /// From coordinates in this frame to the world.
    pub fn to_world(&self, v: DVec3) -> DVec3 {
        v.x * self.x + v.y * self.y + v.z * self.z
    }

    /// From the world to coordinates in this frame.
    pub fn to_local(&self, v: DVec3) -> DVec3 {
        DVec3::new(v.dot(self.x), v.dot(self.y), v.dot(self.z))
    }
}
