use std::f64::consts::PI;

use crate::gather::Fan;
use crate::math::random::Dimension;
use crate::math::{DVec3, Frame, Ray, Stream, sampling};
use crate::scene::description::{self, Filter, FovAxis, Projection, Window};

/// A pinhole, a thin lens, or a film that sends parallel rays.
#[derive(Clone, Debug)]
pub struct Camera {
    /// Where it stands.
    pub position: DVec3,
    /// The unit direction of view.
    pub forward: DVec3,
    right: DVec3,
    up: DVec3,
    /// Half the film's height on the plane at distance 1; of parallel rays, anywhere.
    half: f64,
    projection: Projection,
    aperture: f64,
    focus_distance: f64,
    filter: Filter,
    width: f64,
    height: f64,
    window: Window,
}

impl Camera {
    /// From what the scene says.
    pub fn new(camera: &description::Camera, film: &description::Film) -> Self {
        let forward = (camera.target - camera.position).normalize();
        // right = forward × up.
        let right = forward.cross(camera.up).normalize();
        let (width, height) = (f64::from(film.width), f64::from(film.height));
        let tangent = (0.5 * camera.fov.to_radians()).tan();
        let upright = match camera.fov_axis {
            FovAxis::Y => tangent,
            FovAxis::Smaller if height <= width => tangent,
            FovAxis::X | FovAxis::Smaller => tangent * height / width,
        };
        let half = match camera.projection {
            Projection::Perspective => upright,
            Projection::Orthographic => upright * camera.target.distance(camera.position),
        };
        Camera {
            position: camera.position,
            forward,
            right,
            up: right.cross(forward),
            half,
            projection: camera.projection,
            aperture: camera.aperture,
            focus_distance: camera.focus_distance,
            filter: film.filter,
            width,
            height,
            window: film.window(),
        }
    }

    /// Whether all rays come from its position.
    pub fn is_pinhole(&self) -> bool {
        self.projection == Projection::Perspective && self.aperture == 0.0
    }

    /// Whether rays through one place of the lens are parallel.
    pub fn is_orthographic(&self) -> bool {
        self.projection == Projection::Orthographic
    }

    /// The part of the film that is made.
    pub fn window(&self) -> Window {
        self.window
    }

    /// The pixels across and down of the whole film.
    pub fn size(&self) -> (u32, u32) {
        (self.width as u32, self.height as u32)
    }

    /// A ray through pixel (x, y), row 0 on top.
    pub fn ray(&self, x: u32, y: u32, stream: &mut Stream) -> Ray {
        let [dx, dy] = stream.draw(Dimension::Film, Stream::uniform2).map(|u| self.filter_offset(u));
        let across = self.across(x as f64 + 0.5 + dx, y as f64 + 0.5 + dy);
        let (middle, axis) = match self.projection {
            Projection::Perspective => (self.position, self.forward + across),
            Projection::Orthographic => (self.position + across, self.forward),
        };
        if self.aperture == 0.0 {
            return Ray::new(middle, axis.normalize());
        }
        let lens = self.lens(stream);
        let focus = self.focus_distance * axis;
        Ray::new(middle + lens, (focus - lens).normalize())
    }

    /// A pixel's edge on the plane at distance 1; of parallel rays, anywhere.
    fn edge(&self) -> f64 {
        2.0 * self.half / self.height
    }

    /// How wide the middle pixel is at the camera, and how much wider for each unit of distance.
    pub fn cone(&self) -> [f64; 2] {
        match self.projection {
            Projection::Perspective => [0.0, self.edge()],
            Projection::Orthographic => [self.edge(), 0.0],
        }
    }

    /// Where a place of the film, in pixels from the top left, is seen, from the end of `forward`.
    fn across(&self, x: f64, y: f64) -> DVec3 {
        let ndc_x = (2.0 * x - self.width) / self.height;
        let ndc_y = 1.0 - 2.0 * y / self.height;
        self.half * (ndc_x * self.right + ndc_y * self.up)
    }

    /// The rays through `size` × `size` pixels from (x, y) on, `rays` in all, if they come from one point.
    pub fn fan(&self, (x, y): (u32, u32), size: u32, rays: usize) -> Option<Fan> {
        let half = 0.5 * f64::from(size);
        let middle = self.forward + self.across(f64::from(x) + half, f64::from(y) + half);
        let z = middle.normalize();
        let x = self.right.reject_from_normalized(z).normalize();
        // Pixels are seen from farther away, and aslant, off the middle of the image; filters reach beyond them.
        let slope = (half + 0.5) * 2.0 * self.half / (self.height * middle.length());
        let frame = Frame { x, y: z.cross(x), z };
        self.is_pinhole().then_some(Fan { origin: self.position, frame, slope, rays })
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
        // The way, and the place of the film: where the line meets the sharp plane, as seen from the middle of the lens.
        let (direction, distance, cos, across) = match self.projection {
            Projection::Perspective => {
                let way = self.position + lens - point;
                let distance = way.length();
                let direction = way / distance;
                let cos = -direction.dot(self.forward);
                (direction, distance, cos, lens / self.focus_distance - direction / cos)
            }
            Projection::Orthographic => {
                // The lens is around the place of the film.
                let offset = point - self.position;
                let depth = offset.dot(self.forward);
                let slope = self.forward - lens / self.focus_distance;
                let length = slope.length();
                let (distance, cos) = (depth * length, if depth > 0.0 { 1.0 / length } else { 0.0 });
                (-slope / length, distance, cos, offset - depth * slope - lens)
            }
        };
        if cos.is_nan() || cos <= 0.0 {
            return None;
        }
        let x = 0.5 * (self.width + self.height * across.dot(self.right) / self.half);
        let y = 0.5 * self.height * (1.0 - across.dot(self.up) / self.half);
        let reach = self.filter_reach();
        if x <= -reach || y <= -reach || x >= self.width + reach || y >= self.height + reach {
            return None;
        }

        // On the plane at distance 1, an area dA is seen under the solid angle cos³ dA; of parallel rays it is cos dA wide, and what the
        // point sends along them meets that plane at one place.
        let area = self.edge() * self.edge();
        let importance = match self.projection {
            Projection::Perspective => 1.0 / (area * cos.powi(3) * distance * distance),
            Projection::Orthographic => 1.0 / (area * cos),
        };
        Some(View { direction, distance, importance, x, y })
    }

    /// Tells `part` which pixels of the window receive what is seen, by number, and the share of each.
    pub fn spread(&self, view: &View, mut part: impl FnMut(u32, f64)) {
        // Pixels whose centres are within reach.
        let reach = self.filter_reach();
        let Window { x: left, y: top, width, height } = self.window;
        let near = |place: f64, from: u32, size: u32| {
            let first = (place - 0.5 - reach).ceil().max(f64::from(from));
            let last = (place - 0.5 + reach).floor().min(f64::from(from) + f64::from(size) - 1.0);
            first as i64..=last as i64
        };
        for y in near(view.y, top, height) {
            let down = self.filter_density(view.y - (y as f64 + 0.5));
            for x in near(view.x, left, width) {
                let share = down * self.filter_density(view.x - (x as f64 + 0.5));
                if share > 0.0 {
                    part((y as u32 - top) * width + (x as u32 - left), share);
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
    /// What a pixel receives of what the point sends there per steradian, before the filter: 1/(d² s² cos³ θ), with the edge s of a
    /// pixel on a film at distance 1 and the angle θ to the axis; along parallel rays 1/(s² cos θ).
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

    /// 16 × 12 pixels from (1, 2, 3) towards (4, 2, −1).
    fn camera(change: impl Fn(&mut description::Camera)) -> Camera {
        let (scene, settings) = crate::scene::from_text(
            "[film]\nwidth = 16\nheight = 12\n[camera]\nposition = [1, 2, 3]\ntarget = [4, 2, -1]\nfov = 60\n",
        );
        let mut camera = scene.camera.clone();
        change(&mut camera);
        Camera::new(&camera, &settings.film)
    }

    /// Points on a camera's rays are seen at the place of the film and in the direction that the rays have, through the same place of the lens.
    #[test]
    fn views_are_rays_backwards() {
        for projection in [Projection::Perspective, Projection::Orthographic] {
            for aperture in [0.0, 0.3] {
                let camera = camera(|camera| (camera.projection, camera.aperture) = (projection, aperture));
                for sample in 0..200 {
                    let mut stream = Stream::of_sample(1, 7, sample.into(), (0, sample));
                    let mut again = stream.clone();
                    let (x, y) = (sample % 16, sample % 12);
                    let ray = camera.ray(x, y, &mut stream);
                    let [u, v] = again.draw(Dimension::Film, Stream::uniform2);
                    let lens = camera.lens(&mut again);
                    let distance = 0.5 + f64::from(sample) / 20.0;
                    let view = camera.view(ray.at(distance), lens).expect("it is on the film");
                    let off = [view.x - f64::from(x) - u, view.y - f64::from(y) - v, view.distance - distance];
                    let turned = (view.direction + ray.direction).length();
                    assert!(
                        off.into_iter().chain([turned]).all(|off| off.abs() < 1e-9),
                        "{projection:?} {aperture} {off:?}"
                    );
                }
                assert!(camera.view(camera.position - camera.forward, DVec3::ZERO).is_none());
            }
        }
    }

    /// What a plane of radiance 1 across the axis sends to the film is 1 in every pixel.
    #[test]
    fn an_even_plane_is_even_on_the_film() {
        for (projection, aperture) in
            [(Projection::Perspective, 0.0), (Projection::Orthographic, 0.0), (Projection::Orthographic, 1.0)]
        {
            let camera = camera(|camera| (camera.projection, camera.aperture) = (projection, aperture));
            const N: u32 = 400_000;
            let mut stream = Stream::new(2, crate::math::random::Purpose::Test, 0, 0);
            let (size, mut sums) = (16.0, vec![0.0; 16 * 12]);
            for _ in 0..N {
                let [x, y] = stream.uniform2().map(|u| size * (u - 0.5));
                let lens = camera.lens(&mut stream);
                let point = camera.position + 4.0 * camera.forward + x * camera.right + y * camera.up;
                let Some(view) = camera.view(point, lens) else { continue };
                let sent = -view.direction.dot(camera.forward) * size * size / f64::from(N);
                camera.spread(&view, |pixel, part| sums[pixel as usize] += sent * view.importance * part);
            }
            // About as many points fall on each pixel as on another.
            let far = sums.iter().map(|sum| (sum - 1.0f64).abs()).fold(0.0, f64::max);
            assert!(far < 0.25, "{projection:?} {aperture}: {far}");
            let mean = sums.iter().sum::<f64>() / sums.len() as f64;
            assert!((mean - 1.0).abs() < 0.015, "{projection:?} {aperture}: {mean}");
        }
    }

    /// The angle is along the side that is said; parallel rays see as much of the target's plane.
    #[test]
    fn angles_are_along_their_axis() {
        let tangent = 30.0f64.to_radians().tan();
        for (axis, half) in [(FovAxis::Y, tangent), (FovAxis::Smaller, tangent), (FovAxis::X, tangent * 0.75)] {
            assert!((camera(|camera| camera.fov_axis = axis).half - half).abs() < 1e-12, "{axis:?}");
        }
        let parallel = camera(|camera| camera.projection = Projection::Orthographic);
        assert!((parallel.half - 5.0 * tangent).abs() < 1e-12);
        assert_eq!(parallel.cone(), [10.0 * tangent / 12.0, 0.0]);
    }

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
