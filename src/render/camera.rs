use crate::gather::Fan;
use crate::math::random::Dimension;
use crate::math::{DVec3, Frame, Ray, Stream, sampling};
use crate::scene::description::{self, Filter};

/// A pinhole or a thin lens.
#[derive(Clone, Debug)]
pub struct Camera {
    /// Where it stands.
    pub position: DVec3,
    /// The unit direction of view.
    pub forward: DVec3,
    right: DVec3,
    up: DVec3,
    /// tan of half the vertical angle.
    tangent: f64,
    aperture: f64,
    focus_distance: f64,
    filter: Filter,
    width: f64,
    height: f64,
}

impl Camera {
    /// From what the scene says.
    pub fn new(camera: &description::Camera, film: &description::Film) -> Self {
        let forward = (camera.target - camera.position).normalize();
        // right = forward × up.
        let right = forward.cross(camera.up).normalize();
        Camera {
            position: camera.position,
            forward,
            right,
            up: right.cross(forward),
            tangent: (0.5 * camera.fov.to_radians()).tan(),
            aperture: camera.aperture,
            focus_distance: camera.focus_distance,
            filter: film.filter,
            width: film.width as f64,
            height: film.height as f64,
        }
    }

    /// The pixels across and down.
    pub fn size(&self) -> (u32, u32) {
        (self.width as u32, self.height as u32)
    }

    /// A ray through pixel (x, y), row 0 on top.
    pub fn ray(&self, x: u32, y: u32, stream: &mut Stream) -> Ray {
        let [dx, dy] = stream.draw(Dimension::Film, Stream::uniform2).map(|u| self.filter_offset(u));
        let across = self.across(x as f64 + 0.5 + dx, y as f64 + 0.5 + dy);
        if self.aperture == 0.0 {
            return Ray::new(self.position, (self.forward + across).normalize());
        }
        let (u, v) = sampling::disc(stream.draw(Dimension::Lens, Stream::uniform2));
        let lens = self.aperture * (u * self.right + v * self.up);
        let focus = self.focus_distance * (self.forward + across);
        Ray::new(self.position + lens, (focus - lens).normalize())
    }

    /// Where a place of the film, in pixels from the top left, is seen, from the end of `forward`.
    fn across(&self, x: f64, y: f64) -> DVec3 {
        let ndc_x = (2.0 * x - self.width) / self.height;
        let ndc_y = 1.0 - 2.0 * y / self.height;
        self.tangent * (ndc_x * self.right + ndc_y * self.up)
    }

    /// The rays through `size` × `size` pixels from (x, y) on, `rays` in all, if they come from one point.
    pub fn fan(&self, (x, y): (u32, u32), size: u32, rays: usize) -> Option<Fan> {
        let half = 0.5 * f64::from(size);
        let middle = self.forward + self.across(f64::from(x) + half, f64::from(y) + half);
        let z = middle.normalize();
        let x = self.right.reject_from_normalized(z).normalize();
        // Pixels are seen from farther away, and aslant, off the middle of the image; filters reach beyond them.
        let slope = (half + 0.5) * 2.0 * self.tangent / (self.height * middle.length());
        let frame = Frame { x, y: z.cross(x), z };
        (self.aperture == 0.0).then_some(Fan { origin: self.position, frame, slope, rays })
    }

    /// The radius of the lens.
    pub fn aperture(&self) -> f64 {
        self.aperture
    }

    /// The distance from the pixel's centre, distributed as the filter: every sample counts alike.
    fn filter_offset(&self, u: f64) -> f64 {
        match self.filter {
            Filter::Box => u - 0.5,
            // The inverse of the distribution of a tent over [−1, 1].
            Filter::Tent if u < 0.5 => (2.0 * u).sqrt() - 1.0,
            Filter::Tent => 1.0 - (2.0 - 2.0 * u).sqrt(),
            Filter::Gaussian => GAUSSIAN_WIDTH * truncated_normal(u),
        }
    }
}

/// The standard deviation of the Gaussian filter, in pixels; it is cut off at three of them.
const GAUSSIAN_WIDTH: f64 = 0.5;

/// The quantile function of the standard normal distribution cut off at ±3, by bisection and Newton's
/// method on the error function's series.
fn truncated_normal(u: f64) -> f64 {
    const CUT: f64 = 3.0;
    let edge = normal_mass(CUT);
    let target = (2.0 * u - 1.0) * edge;
    let (mut low, mut high) = (-CUT, CUT);
    let mut x = 0.0;
    for _ in 0..60 {
        let error = normal_mass(x) - target;
        if error > 0.0 {
            high = x
        } else {
            low = x
        }
        // The density of `normal_mass` is √(2/π) e^{−x²/2}.
        let next = x - error / ((2.0 / std::f64::consts::PI).sqrt() * (-0.5 * x * x).exp());
        let next = if next > low && next < high { next } else { 0.5 * (low + high) };
        if (next - x).abs() < 1e-9 {
            return next;
        }
        x = next;
    }
    x
}

/// P(|X| < x) of a standard normal, with x's sign: √(2/π) e^{−x²/2} Σ x^{2k+1}/(1·3·…·(2k+1)).
fn normal_mass(x: f64) -> f64 {
    let (mut term, mut sum) = (x, x);
    let mut k = 1.0;
    while term.abs() > 1e-16 * sum.abs() {
        k += 2.0;
        term *= x * x / k;
        sum += term;
    }
    (2.0 / std::f64::consts::PI).sqrt() * (-0.5 * x * x).exp() * sum
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_normal_quantile_inverts_its_distribution() {
        assert!((normal_mass(1.0) - 0.682_689_492_137).abs() < 1e-11);
        for i in 0..=1000 {
            let u = i as f64 / 1000.0 * (1.0 - f64::EPSILON);
            let x = truncated_normal(u);
            assert!((0.5 + 0.5 * normal_mass(x) / normal_mass(3.0) - u).abs() < 1e-9, "at {u}: {x}");
        }
    }
}
