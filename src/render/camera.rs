use std::f64::consts::PI;

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
        let lens = self.lens(stream);
        let focus = self.focus_distance * (self.forward + across);
        Ray::new(self.position + lens, (focus - lens).normalize())
    }

    /// How wide the middle pixel is at distance 1.
    pub fn pixel(&self) -> f64 {
        2.0 * self.tangent / self.height
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

    /// A place drawn on the lens, from its middle.
    pub fn lens(&self, stream: &mut Stream) -> DVec3 {
        if self.aperture == 0.0 {
            return DVec3::ZERO;
        }
        let (u, v) = sampling::disc(stream.draw(Dimension::Lens, Stream::uniform2));
        self.aperture * (u * self.right + v * self.up)
    }

    /// How the camera sees `point` from a place on its [lens](Camera::lens); `None` where it is not on the film. What leaves the
    /// point towards the lens, per steradian and without what is lost on the way, is multiplied by the view's importance and
    /// [spread](Camera::spread) over pixels.
    pub fn view(&self, point: DVec3, lens: DVec3) -> Option<View> {
        let way = self.position + lens - point;
        let distance = way.length();
        let direction = way / distance;
        let cos = -direction.dot(self.forward);
        if cos.is_nan() || cos <= 0.0 {
            return None;
        }

        // The place of the film: where the line meets the sharp plane, as seen from the middle of the lens.
        let across = lens / self.focus_distance - direction / cos;
        let x = 0.5 * (self.width + self.height * across.dot(self.right) / self.tangent);
        let y = 0.5 * self.height * (1.0 - across.dot(self.up) / self.tangent);
        let reach = self.filter_reach();
        if x <= -reach || y <= -reach || x >= self.width + reach || y >= self.height + reach {
            return None;
        }

        // A pixel's edge on the plane at distance 1, where an area dA is seen under the solid angle cos³ dA.
        let edge = self.pixel();
        let importance = 1.0 / (edge * edge * cos.powi(3) * distance * distance);
        Some(View { direction, distance, importance, x, y })
    }

    /// Tells `part` which pixels receive what is seen, by number, and the share of each.
    pub fn spread(&self, view: &View, mut part: impl FnMut(u32, f64)) {
        // Pixels whose centres are within reach.
        let reach = self.filter_reach();
        let near = |place: f64, size: f64| {
            let first = (place - 0.5 - reach).ceil().max(0.0);
            let last = (place - 0.5 + reach).floor().min(size - 1.0);
            first as i64..=last as i64
        };
        for y in near(view.y, self.height) {
            let down = self.filter_density(view.y - (y as f64 + 0.5));
            for x in near(view.x, self.width) {
                let share = down * self.filter_density(view.x - (x as f64 + 0.5));
                if share > 0.0 {
                    part(y as u32 * self.width as u32 + x as u32, share);
                }
            }
        }
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

    /// The density of [`Camera::filter_offset`], per pixel.
    fn filter_density(&self, offset: f64) -> f64 {
        match self.filter {
            // A place on the border between two pixels belongs to one of them.
            Filter::Box if (-0.5..0.5).contains(&offset) => 1.0,
            Filter::Box => 0.0,
            Filter::Tent => (1.0 - offset.abs()).max(0.0),
            Filter::Gaussian => {
                let x = offset / GAUSSIAN_WIDTH;
                let height = 1.0 / ((2.0 * PI).sqrt() * GAUSSIAN_WIDTH * normal_mass(GAUSSIAN_CUT));
                if x.abs() <= GAUSSIAN_CUT { height * (-0.5 * x * x).exp() } else { 0.0 }
            }
        }
    }

    /// How far from its pixel's centre a sample may be, along each axis.
    fn filter_reach(&self) -> f64 {
        match self.filter {
            Filter::Box => 0.5,
            Filter::Tent => 1.0,
            Filter::Gaussian => GAUSSIAN_WIDTH * GAUSSIAN_CUT,
        }
    }
}

/// How a camera sees a point.
#[derive(Clone, Copy, Debug)]
pub struct View {
    /// From the point to the lens, of unit length.
    pub direction: DVec3,
    /// How far the lens is.
    pub distance: f64,
    /// What a pixel receives of what the point sends there per steradian: 1/(d² s² cos³ θ), with the edge s of a pixel on a film
    /// at distance 1 and the angle θ to the axis; before the filter.
    pub importance: f64,
    /// The place on the film, in pixels from the top left.
    x: f64,
    y: f64,
}

/// The standard deviation of the Gaussian filter, in pixels.
const GAUSSIAN_WIDTH: f64 = 0.5;
/// It is cut off at so many standard deviations.
const GAUSSIAN_CUT: f64 = 3.0;

/// The quantile function of the standard normal distribution cut off at ±[`GAUSSIAN_CUT`], by bisection and Newton's
/// method on the error function's series.
fn truncated_normal(u: f64) -> f64 {
    let edge = normal_mass(GAUSSIAN_CUT);
    let target = (2.0 * u - 1.0) * edge;
    let (mut low, mut high) = (-GAUSSIAN_CUT, GAUSSIAN_CUT);
    let mut x = 0.0;
    for _ in 0..60 {
        let error = normal_mass(x) - target;
        if error > 0.0 {
            high = x
        } else {
            low = x
        }
        // The density of `normal_mass` is √(2/π) e^{−x²/2}.
        let next = x - error / ((2.0 / PI).sqrt() * (-0.5 * x * x).exp());
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
    (2.0 / PI).sqrt() * (-0.5 * x * x).exp() * sum
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
