use super::{Arrival, Departure, DrawnFrom, Surroundings};
use crate::image::Image;
use crate::math::{DMat3, DVec3, Distribution, Frame, Ray, Rgb, Stream, sampling};
use std::f64::consts::{PI, TAU};
use std::sync::Arc;

/// Light from infinity: the same from everywhere, or a latitude–longitude image with
/// u = ½ + atan2(d_x, −d_z)/2π and v = acos(d_y)/π from the top row.
#[derive(Clone, Debug)]
pub struct Environment {
    /// Multiplies the radiance.
    scale: Rgb,
    map: Option<Arc<Map>>,
}

/// An image with the distribution its directions are drawn from.
#[derive(Debug)]
struct Map {
    image: Image,
    /// Turns directions of the image into those of the scene.
    to_scene: DMat3,
    /// Turns directions of the scene into those of the image.
    to_image: DMat3,
    /// The mean over all directions.
    mean: Rgb,
    /// The cosines of the angle from +y at which rows begin and, last, the lowest one ends.
    rows: Vec<f64>,
    /// The texels by their weights, row by row.
    texels: Distribution,
}

impl Environment {
    /// An environment of one radiance from everywhere.
    pub fn constant(radiance: Rgb) -> Self {
        Environment { scale: radiance, map: None }
    }

    /// From an image, turned about +y by `turn` radians, counter-clockwise from above; `None` if the image is black.
    pub fn image(image: Image, scale: Rgb, turn: f64) -> Option<Self> {
        let (width, height) = (image.width, image.height);
        let rows: Vec<f64> = (0..=height).map(|y| (PI * y as f64 / height as f64).cos()).collect();
        // Bilinear look-ups reach half a texel into the neighbours.
        let around = |x: usize, y: usize| -> f64 {
            let near = (-1..=1).flat_map(|dy| (-1..=1).map(move |dx| (dx, dy)));
            near.map(|(dx, dy)| sum_of(texel(&image, x as isize + dx, y as isize + dy))).sum()
        };
        let weight = |x, y| around(x, y) / 9.0 * (rows[y] - rows[y + 1]);
        let texels = (0..height).flat_map(|y| (0..width).map(move |x| (x, y)));
        let texels = Distribution::new(texels.map(|(x, y)| weight(x, y)));
        (!texels.is_empty()).then(|| {
            let mean = mean(&image, &rows);
            let (to_scene, to_image) = (DMat3::from_rotation_y(turn), DMat3::from_rotation_y(-turn));
            Environment { scale, map: Some(Arc::new(Map { image, to_scene, to_image, mean, rows, texels })) }
        })
    }

    pub(super) fn dim(&mut self, factor: Rgb) {
        self.scale *= factor;
    }

    /// What is seen along `direction`.
    pub(super) fn radiance(&self, direction: DVec3) -> Rgb {
        match &self.map {
            None => self.scale,
            Some(map) => self.scale * map.look_up(map.to_image * direction),
        }
    }

    fn mean_radiance(&self) -> Rgb {
        match &self.map {
            None => self.scale,
            Some(map) => self.scale * map.mean,
        }
    }

    pub(super) fn power(&self, surroundings: &Surroundings) -> Rgb {
        4.0 * PI * PI * surroundings.radius.powi(2) * self.mean_radiance()
    }

    pub(super) fn importance(&self) -> f64 {
        PI * self.mean_radiance().element_sum()
    }

    fn sample(&self, stream: &mut Stream) -> (DVec3, f64) {
        match &self.map {
            None => (sampling::sphere(stream.uniform2()).normalize(), 0.25 / PI),
            Some(map) => {
                let (direction, density) = map.sample(stream);
                (map.to_scene * direction, density)
            }
        }
    }

    pub(super) fn density(&self, direction: DVec3) -> f64 {
        match &self.map {
            None => 0.25 / PI,
            Some(map) => map.density(map.to_image * direction),
        }
    }

    pub(super) fn arrive(&self, stream: &mut Stream) -> Option<Arrival> {
        let (direction, density) = self.sample(stream);
        (density > 0.0).then(|| Arrival {
            direction,
            distance: f64::INFINITY,
            radiance: self.radiance(direction),
            density,
            has_size: true,
            normal: -direction,
        })
    }

    pub(super) fn depart(&self, surroundings: &Surroundings, stream: &mut Stream) -> Option<Departure> {
        let (towards, density) = self.sample(stream);
        let (x, y) = sampling::disc(stream.uniform2());
        let frame = Frame::around(-towards);
        let origin = surroundings.center + surroundings.radius * (x * frame.x + y * frame.y + towards);
        (density > 0.0).then(|| Departure {
            ray: Ray::new(origin, -towards),
            power: self.radiance(towards) * (PI * surroundings.radius.powi(2) / density),
            spread: DrawnFrom::Disc,
        })
    }
}

fn sum_of(rgb: Rgb) -> f64 {
    rgb.element_sum().max(0.0)
}

/// A texel; columns wrap around, rows end at the poles.
fn texel(image: &Image, x: isize, y: isize) -> Rgb {
    #[cfg(test)]
    tests::LOOKED_AT.set(tests::LOOKED_AT.get() + 1);
    let x = x.rem_euclid(image.width as isize) as usize;
    let y = y.clamp(0, image.height as isize - 1) as usize;
    let [r, g, b] = image.pixels[y * image.width + x];
    Rgb::new(r as f64, g as f64, b as f64)
}

/// The mean over all directions, given the cosines between rows.
fn mean(image: &Image, rows: &[f64]) -> Rgb {
    let mut sum = Rgb::ZERO;
    for y in 0..image.height {
        let share = 0.5 * (rows[y] - rows[y + 1]);
        for x in 0..image.width {
            sum += texel(image, x as isize, y as isize) * (share / image.width as f64);
        }
    }
    sum
}

impl Map {
    /// Bilinear between texel centres.
    fn look_up(&self, direction: DVec3) -> Rgb {
        let (u, v) = coordinates(direction);
        let x = u * self.image.width as f64 - 0.5;
        let y = v * self.image.height as f64 - 0.5;
        let (i, j) = (x.floor() as isize, y.floor() as isize);
        let (fx, fy) = (x - x.floor(), y - y.floor());
        let row = |j| texel(&self.image, i, j).lerp(texel(&self.image, i + 1, j), fx);
        row(j).lerp(row(j + 1), fy)
    }

    fn texel_solid_angle(&self, y: usize) -> f64 {
        TAU / self.image.width as f64 * (self.rows[y] - self.rows[y + 1])
    }

    fn sample(&self, stream: &mut Stream) -> (DVec3, f64) {
        let texel = self.texels.choose(stream.uniform());
        let (index, share) = texel.map_or((0, 0.0), |choice| (choice.index, choice.probability));
        let (x, y) = (index % self.image.width, index / self.image.width);
        let [a, b] = stream.uniform2();
        let (top, bottom) = (self.rows[y], self.rows[y + 1]);
        let cos = top + (bottom - top) * b;
        let sin = (1.0 - cos * cos).max(0.0).sqrt();
        // u = ½ + atan2(d_x, −d_z)/2π.
        let phi = TAU * ((x as f64 + a) / self.image.width as f64 - 0.5);
        let direction = DVec3::new(sin * phi.sin(), cos, -sin * phi.cos()).normalize();
        (direction, share / self.texel_solid_angle(y))
    }

    fn density(&self, direction: DVec3) -> f64 {
        let (u, v) = coordinates(direction);
        let x = ((u * self.image.width as f64) as usize).min(self.image.width - 1);
        let y = ((v * self.image.height as f64) as usize).min(self.image.height - 1);
        self.texels.probability(y * self.image.width + x) / self.texel_solid_angle(y)
    }
}

fn coordinates(direction: DVec3) -> (f64, f64) {
    (0.5 + direction.x.atan2(-direction.z) / TAU, direction.y.clamp(-1.0, 1.0).acos() / PI)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::random::Purpose;
    use std::cell::Cell;

    thread_local! {
        /// How many texels were looked at.
        pub(super) static LOOKED_AT: Cell<u64> = const { Cell::new(0) };
    }

    /// A choice between lights costs the same for every image, and so does what is asked of one direction: what depends on
    /// the whole image is computed once.
    #[test]
    fn no_question_looks_at_the_whole_image() {
        let environment = gradient();
        let mut stream = Stream::new(4, Purpose::Test, 0, 0);
        let mut looked_at = |question: &dyn Fn(&mut Stream)| {
            LOOKED_AT.set(0);
            question(&mut stream);
            LOOKED_AT.get()
        };
        let surroundings = Surroundings { center: DVec3::ZERO, radius: 1.0 };
        assert_eq!(looked_at(&|_| assert!(environment.importance() > 0.0)), 0);
        assert_eq!(looked_at(&|_| assert!(environment.power(&surroundings).x > 0.0)), 0);
        assert_eq!(looked_at(&|_| assert!(environment.density(DVec3::X) > 0.0)), 0);
        assert_eq!(looked_at(&|_| assert!(environment.radiance(DVec3::X).x > 0.0)), 4);
        assert_eq!(looked_at(&|stream| assert!(environment.arrive(stream).is_some())), 4);
        assert_eq!(looked_at(&|stream| assert!(environment.depart(&surroundings, stream).is_some())), 4);
    }

    fn gradient() -> Environment {
        let (width, height) = (16, 8);
        let pixels = (0..width * height)
            .map(|i| {
                let (x, y) = ((i % width) as f32, (i / width) as f32);
                [if i == 37 { 40.0 } else { 0.1 }, x / 16.0, y / 8.0]
            })
            .collect();
        Environment::image(Image { width, height, pixels }, Rgb::new(1.0, 2.0, 0.5), 0.7).expect("not black")
    }

    /// ∫ L dω by the map's own sampling and by uniform sampling, and ∫ density = 1.
    #[test]
    fn samples_follow_the_density() {
        let environment = gradient();
        let mut stream = Stream::new(3, Purpose::Test, 0, 0);
        let n = 200_000;
        let (mut own, mut own2, mut uniform, mut uniform2, mut total) = (0.0, 0.0, 0.0, 0.0, 0.0);
        for _ in 0..n {
            let arrival = environment.arrive(&mut stream).expect("drawn where there is light");
            assert!((environment.density(arrival.direction) / arrival.density - 1.0).abs() < 1e-6);
            let x = arrival.radiance.element_sum() / arrival.density;
            own += x;
            own2 += x * x;
            let direction = sampling::sphere(stream.uniform2()).normalize();
            let x = environment.radiance(direction).element_sum() * 4.0 * PI;
            uniform += x;
            uniform2 += x * x;
            total += environment.density(direction) * 4.0 * PI;
        }
        let n = n as f64;
        let (a, b) = (own / n, uniform / n);
        let sigma = (((own2 / n - a * a) + (uniform2 / n - b * b)) / n).sqrt();
        assert!((a - b).abs() < 4.0 * sigma, "{a} against {b} ± {sigma}");
        assert!((total / n - 1.0).abs() < 0.05, "density integrates to {}", total / n);
    }

    #[test]
    fn directions_follow_the_convention() {
        let mut pixels = vec![[0.0; 3]; 8 * 4];
        // The column right of the middle, second row: slightly right of −z, slightly above the horizon.
        pixels[8 + 4] = [1.0; 3];
        let image = Image { width: 8, height: 4, pixels };
        let straight = Environment::image(image.clone(), Rgb::ONE, 0.0).expect("not black");
        let phi = TAU / 16.0;
        let theta = PI * 1.5 / 4.0;
        let seen = DVec3::new(theta.sin() * phi.sin(), theta.cos(), -theta.sin() * phi.cos());
        assert!((straight.radiance(seen).x - 1.0).abs() < 1e-6);
        // A quarter turn, counter-clockwise from above, takes −z to −x.
        let turned = Environment::image(image, Rgb::ONE, 0.5 * PI).expect("not black");
        let seen = DVec3::new(-theta.sin() * phi.cos(), theta.cos(), -theta.sin() * phi.sin());
        assert!((turned.radiance(seen).x - 1.0).abs() < 1e-6);
    }
}
