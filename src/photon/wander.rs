//! Photons that wander through a dense solid of one density, far from its surface, many at once.
//!
//! Most collisions in marble, milk or skin are of such walks, and most of what they took went into asking for surfaces that are far, into
//! records of segments and vertices, and into numbers one by one. Here [`WIDE`] photons take each step together, as long as
//! [`Distances`] tell that a flight meets no surface. One that may is sent back with that flight to those that are traced one by one,
//! and another takes its place. A photon's numbers are its own: they do not depend on who walks beside it.

use super::simd::{Lanes, Task};
use crate::geometry::{Distances, Geometry};
use crate::math::wide::{self, WIDE, Wide};
use crate::math::{DVec3, Ray, Rgb, Stream};
use crate::medium::Medium;
use crate::medium::phase::Phase;
use crate::transport::Events;

/// Photons closer than this many mean free paths to a surface do not wander: flights that meet none are too seldom.
const NEAR: f64 = 0.5;
/// Every so many steps wanderers ask whether to break off.
const PATIENCE: u32 = 1 << 12;

/// A medium of one density, and how it scatters.
#[derive(Clone, Copy, Debug)]
pub(super) struct Dense {
    extinction: Rgb,
    albedo: Rgb,
    /// The mean cosine of its phase function, which is Henyey and Greenstein's.
    g: f64,
}

impl Dense {
    /// A medium as wanderers know it; `None` if it is of another kind.
    pub fn of(medium: &Medium) -> Option<Dense> {
        let g = match medium.phase.even()? {
            Phase::Isotropic(_) => 0.0,
            phase => phase.henyey_greenstein()?,
        };
        let walks = medium.density.is_even() && medium.extinction.min_element() > 0.0;
        walks.then_some(Dense { extinction: medium.extinction, albedo: medium.albedo.even()?, g })
    }

    /// The share of light that goes on from a collision.
    pub fn albedo(&self) -> Rgb {
        self.albedo
    }

    /// Whether a photon that is no closer to a surface than this may wander.
    pub fn is_far(&self, least: f64) -> bool {
        least * self.extinction.max_element() > NEAR
    }
}

/// A photon that wanders, at a collision.
#[derive(Clone, Debug)]
pub(super) struct Wanderer {
    /// Where it is.
    pub point: DVec3,
    /// The unit direction of arrival; once it leaves, the one in which it goes on.
    pub direction: DVec3,
    /// Its power.
    pub weight: Rgb,
    /// How far the nearest surface is, at least.
    pub least: f64,
    /// Its number, for who sent it.
    pub number: u32,
    /// Its events so far.
    pub events: u64,
    /// Its random numbers.
    pub stream: Stream,
}

/// What becomes of photons that wander.
pub(super) trait Host {
    /// Is told of a collision.
    fn collide(&mut self, wanderer: &mut Wanderer);
    /// Gets one back, which flies so far, past a surface, maybe.
    fn leave(&mut self, wanderer: Wanderer, flight: f64);
    /// Whether to break off.
    fn breaks_off(&mut self) -> bool;
}

/// A walk of many through one solid.
pub(super) struct Wander<'w, H> {
    /// What they walk through,
    pub dense: Dense,
    /// and how far surfaces are.
    pub distances: &'w Distances,
    /// The surfaces.
    pub geometry: &'w Geometry,
    /// How many events light may have.
    pub max_events: Events,
    /// Those who walk.
    pub wanderers: Vec<Wanderer>,
    /// Whom to tell.
    pub host: &'w mut H,
}

impl<H: Host> Task for Wander<'_, H> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self) {
        self.walk::<WIDE>();
    }
}

/// The random numbers of a step.
#[derive(Default)]
struct Chances {
    survival: Wide,
    deflection: Wide,
    turn: Wide,
    flight: Wide,
    channel: Wide,
}

/// Where photons are, side by side.
#[derive(Default)]
struct Numbers {
    point: [Wide; 3],
    direction: [Wide; 3],
    weight: [Wide; 3],
    flight: Wide,
    alive: [bool; WIDE],
}

impl<H: Host> Wander<'_, H> {
    /// Walks, `AT_ONCE` side by side, until all have ended or left.
    #[inline(always)]
    fn walk<const AT_ONCE: usize>(mut self) {
        let grey = self.dense.extinction == Rgb::splat(self.dense.extinction.x);
        let mut waiting = std::mem::take(&mut self.wanderers).into_iter();
        let mut walking: Vec<Wanderer> = Vec::with_capacity(AT_ONCE);
        let (mut numbers, mut chances) = (Numbers::default(), Chances::default());
        for step in 1u32.. {
            walking.extend(waiting.by_ref().take(AT_ONCE - walking.len()));
            if walking.is_empty() || step.is_multiple_of(PATIENCE) && self.host.breaks_off() {
                return;
            }

            // Collisions, and all that chance decides until the next.
            for (i, wanderer) in walking.iter_mut().enumerate() {
                self.host.collide(wanderer);
                wanderer.events += 1;
                chances.draw(i, grey, &mut wanderer.stream);
                numbers.put(i, wanderer);
            }
            numbers.turn(&self.dense, &chances);
            numbers.draw_flights(&self.dense, grey, &chances);

            // Who ends, who leaves; the last take the places of those.
            for i in (0..walking.len()).rev() {
                let wanderer = &mut walking[i];
                if !numbers.alive[i] || !self.max_events.allows(wanderer.events) {
                    walking.swap_remove(i);
                    numbers.move_here(i, walking.len());
                    continue;
                }
                (wanderer.direction, wanderer.weight) = (numbers.direction(i), numbers.weight(i));
                let flight = numbers.flight[i];
                if wanderer.least <= flight {
                    let ray = Ray::new(wanderer.point, wanderer.direction);
                    if !self.distances.is_free(self.geometry, &ray, wanderer.least, flight) {
                        let wanderer = walking.swap_remove(i);
                        numbers.move_here(i, walking.len());
                        self.host.leave(wanderer, flight);
                    }
                }
            }

            // To the next collision.
            numbers.fly(&self.dense, grey);
            for (i, wanderer) in walking.iter_mut().enumerate() {
                wanderer.point = numbers.point(i);
                wanderer.weight = numbers.weight(i);
                wanderer.least = self.distances.least(self.geometry, wanderer.point);
            }
        }
    }
}

impl Chances {
    /// Draws those of one photon.
    #[inline(always)]
    fn draw(&mut self, i: usize, grey: bool, stream: &mut Stream) {
        self.survival[i] = stream.uniform();
        [self.deflection[i], self.turn[i]] = stream.direction();
        self.flight[i] = stream.flight();
        if !grey {
            self.channel[i] = stream.uniform();
        }
    }
}

impl Numbers {
    #[inline(always)]
    fn put(&mut self, i: usize, wanderer: &Wanderer) {
        for axis in 0..3 {
            self.point[axis][i] = wanderer.point[axis];
            self.direction[axis][i] = wanderer.direction[axis];
            self.weight[axis][i] = wanderer.weight[axis];
        }
    }

    /// The numbers in one place go to another.
    #[inline(always)]
    fn move_here(&mut self, here: usize, from: usize) {
        for axis in 0..3 {
            self.point[axis][here] = self.point[axis][from];
            self.direction[axis][here] = self.direction[axis][from];
            self.weight[axis][here] = self.weight[axis][from];
        }
        self.flight[here] = self.flight[from];
    }

    fn point(&self, i: usize) -> DVec3 {
        DVec3::new(self.point[0][i], self.point[1][i], self.point[2][i])
    }

    fn direction(&self, i: usize) -> DVec3 {
        DVec3::new(self.direction[0][i], self.direction[1][i], self.direction[2][i])
    }

    fn weight(&self, i: usize) -> Rgb {
        Rgb::new(self.weight[0][i], self.weight[1][i], self.weight[2][i])
    }

    /// Roulette, as [`survive`](crate::transport::survive), and a direction drawn from the phase function.
    #[inline(always)]
    fn turn(&mut self, dense: &Dense, chances: &Chances) {
        let [r, g, b] = dense.albedo.to_array();
        for i in 0..WIDE {
            let (x, y, z) = (self.weight[0][i], self.weight[1][i], self.weight[2][i]);
            let chance = (x * r + y * g + z * b) / (x + y + z);
            self.alive[i] = chances.survival[i] < chance;
            let per_chance = 1.0 / chance;
            self.weight[0][i] = x * r * per_chance;
            self.weight[1][i] = y * g * per_chance;
            self.weight[2][i] = z * b * per_chance;
        }
        let (g, backward) = (dense.g.abs(), dense.g < 0.0);
        for i in 0..WIDE {
            // The inverse of the distribution function, as in `medium/phase/henyey_greenstein.rs`.
            let (u, v) = (chances.deflection[i], 1.0 - chances.deflection[i]);
            let per = 1.0 / ((1.0 - g) + 2.0 * g * u);
            let (near, far) = ((1.0 - g) * per, (1.0 + g) * per);
            let below_one = 2.0 * v * near * near * (1.0 + g * u);
            let above_minus_one = 2.0 * u * far * far * (1.0 - g * v);
            let ahead = if below_one < above_minus_one { 1.0 - below_one } else { above_minus_one - 1.0 };
            let cos = if backward { -ahead } else { ahead };
            let across = (below_one * above_minus_one).sqrt();
            let (s, c) = wide::sin_cos_of_turn(chances.turn[i]);
            let (s, c) = (across * s, across * c);
            // A frame around the direction, as `Frame::around`.
            let (x, y, z) = (self.direction[0][i], self.direction[1][i], self.direction[2][i]);
            let sign = 1f64.copysign(z);
            let a = -1.0 / (sign + z);
            let b = x * y * a;
            let new = [
                c * (1.0 + sign * x * x * a) + s * b + cos * x,
                c * (sign * b) + s * (sign + y * y * a) + cos * y,
                cos * z - c * sign * x - s * y,
            ];
            // Nearly of length 1: a step of Newton's method.
            let length = 1.5 - 0.5 * (new[0] * new[0] + new[1] * new[1] + new[2] * new[2]);
            self.direction[0][i] = new[0] * length;
            self.direction[1][i] = new[1] * length;
            self.direction[2][i] = new[2] * length;
        }
    }

    /// How far each flies, as [`draw`](crate::transport::draw).
    #[inline(always)]
    fn draw_flights(&mut self, dense: &Dense, grey: bool, chances: &Chances) {
        let sigma = dense.extinction.to_array();
        for i in 0..WIDE {
            self.flight[i] = -wide::ln(chances.flight[i]);
        }
        if grey {
            for i in 0..WIDE {
                self.flight[i] /= sigma[0];
            }
            return;
        }
        for i in 0..WIDE {
            let (x, y, z) = (self.weight[0][i], self.weight[1][i], self.weight[2][i]);
            let rest = chances.channel[i] * (x + y + z);
            let other = if rest < x + y { sigma[1] } else { sigma[2] };
            self.flight[i] /= if rest < x { sigma[0] } else { other };
        }
    }

    /// Goes on, and weights for a collision there, as [`end`](crate::transport::end).
    #[inline(always)]
    fn fly(&mut self, dense: &Dense, grey: bool) {
        for axis in 0..3 {
            for i in 0..WIDE {
                self.point[axis][i] += self.flight[i] * self.direction[axis][i];
            }
        }
        if grey {
            return;
        }
        let [r, g, b] = dense.extinction.to_array();
        for i in 0..WIDE {
            let (x, y, z) = (self.weight[0][i], self.weight[1][i], self.weight[2][i]);
            let collided = |sigma: f64| sigma * wide::exp(-sigma * self.flight[i]);
            let factor = [x * collided(r), y * collided(g), z * collided(b)];
            let scale = (x + y + z) / (factor[0] + factor[1] + factor[2]);
            self.weight[0][i] = factor[0] * scale;
            self.weight[1][i] = factor[1] * scale;
            self.weight[2][i] = factor[2] * scale;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::random::Purpose;
    use crate::math::sampling;
    use crate::photon::simd::Isa;
    use crate::scene::{self, Scene};

    /// Notes where photons collide, and which leave.
    #[derive(Default)]
    struct Notes {
        /// Of each channel: the sum of weights at collisions, and of those absorbed times squared distances from the middle; and both
        /// squared, photon by photon.
        sums: Vec<[Rgb; 2]>,
        center: DVec3,
        absorption: Rgb,
        left: Vec<(u32, [u64; 8])>,
    }

    impl Host for Notes {
        fn collide(&mut self, wanderer: &mut Wanderer) {
            let [weights, spread] = &mut self.sums[wanderer.number as usize];
            *weights += wanderer.weight;
            *spread += wanderer.weight * self.absorption * wanderer.point.distance_squared(self.center);
        }

        fn leave(&mut self, wanderer: Wanderer, flight: f64) {
            let Wanderer { point, direction, mut stream, .. } = wanderer;
            let [x, y, z] = point.to_array();
            let numbers = [x, y, z, direction.x, direction.y, direction.z, flight, stream.uniform()];
            self.left.push((wanderer.number, numbers.map(f64::to_bits)));
        }

        fn breaks_off(&mut self) -> bool {
            false
        }
    }

    fn ball(radius: f64, medium: &str) -> Scene {
        let text = format!(
            "[camera]\nposition = [0, 0, 999]\ntarget = [0, 0, 0]\n[media.a]\n{medium}\n\
             [[shapes]]\ntype = \"sphere\"\ncenter = [0, 0, 0]\nradius = {radius}\ninterior = \"a\"\n"
        );
        scene::from_text(&text).0
    }

    /// Photons start in the middle of a ball, along z.
    fn wander(scene: &Scene, count: u32, walk: impl FnOnce(Wander<'_, Notes>)) -> Notes {
        let center = scene.geometry.bounds(0).center();
        let one = |number| Wanderer {
            point: center,
            direction: DVec3::Z,
            weight: Rgb::new(1.0, 0.7, 0.4),
            least: 0.0,
            number,
            events: 0,
            stream: Stream::new(71, Purpose::Test, u64::from(number), 0),
        };
        let dense = Dense::of(&scene.media[0]).expect("it is even");
        let mut notes = Notes {
            sums: vec![[Rgb::ZERO; 2]; count as usize],
            center,
            absorption: Rgb::ONE - dense.albedo,
            ..Notes::default()
        };
        let distances = scene.distances[0].as_ref().expect("light wanders in it");
        walk(Wander {
            dense,
            distances,
            geometry: &scene.geometry,
            max_events: Events::unlimited(),
            wanderers: (0..count).map(one).collect(),
            host: &mut notes,
        });
        notes.left.sort_unstable();
        notes
    }

    /// One by one, many at once, and by whatever instructions: to the last bit the same.
    #[test]
    fn a_photons_numbers_are_its_own() {
        for medium in [
            "sigma_t = 1\nalbedo = 0.99",
            "sigma_t = [1, 0.8, 1.3]\nalbedo = [0.98, 0.99, 0.95]\nphase = { type = \"hg\", g = -0.4 }",
        ] {
            let scene = ball(7.0, medium);
            let alone = wander(&scene, 500, |wander| wander.walk::<1>());
            assert!(alone.left.len() > 200, "{} leave", alone.left.len());
            for isa in Isa::available() {
                let together = wander(&scene, 500, |wander| isa.run(wander));
                assert_eq!(alone.left, together.left, "{}", isa.name());
                assert_eq!(alone.sums, together.sums, "{}", isa.name());
            }
        }
    }

    /// In endless matter a photon collides 1/(1 − α) times, and where it is absorbed the square of its distance from its first collision
    /// is (2/σ²) α/((1 − α)(1 − αg)), in every channel: flights of the mean square 2/σ², and directions that forget by g each time.
    #[test]
    fn photons_wander_as_far_as_they_should() {
        const COUNT: u32 = 20_000;
        for (sigma, albedo, g) in [
            (Rgb::ONE, Rgb::splat(0.9), 0.0),
            (Rgb::splat(2.0), Rgb::new(0.9, 0.8, 0.85), 0.6),
            (Rgb::new(1.0, 1.1, 0.9), Rgb::new(0.9, 0.85, 0.8), -0.5),
        ] {
            let scene = ball(
                90.0,
                &format!(
                    "sigma_t = [{}, {}, {}]\nalbedo = [{}, {}, {}]\nphase = {{ type = \"hg\", g = {g} }}",
                    sigma.x, sigma.y, sigma.z, albedo.x, albedo.y, albedo.z
                ),
            );
            let notes = wander(&scene, COUNT, |wander| Isa::best().run(wander));
            assert!(notes.left.is_empty());
            let start = Rgb::new(1.0, 0.7, 0.4);
            let expected = [
                start / (Rgb::ONE - albedo),
                start * 2.0 * albedo / (sigma * sigma * (Rgb::ONE - albedo) * (Rgb::ONE - g * albedo)),
            ];
            for (which, expected) in expected.into_iter().enumerate() {
                let n = f64::from(COUNT);
                let mean = notes.sums.iter().map(|sums| sums[which]).sum::<Rgb>() / n;
                let squares = notes.sums.iter().map(|sums| sums[which] * sums[which]).sum::<Rgb>() / n;
                let error = ((squares - mean * mean) / n).map(f64::sqrt);
                let off = ((mean - expected) / error).abs();
                let sharp = (error / expected).max_element() < 0.05;
                assert!(off.max_element() < 4.0 && sharp, "{which}, g = {g}: {mean} ± {error}, not {expected}");
            }
        }
    }

    /// Remembered distances are no longer than true ones, and hardly shorter near surfaces; and what they call free is free.
    #[test]
    fn remembered_distances_are_safe() {
        let scene = ball(9.0, "sigma_t = 1\nalbedo = 0.9");
        let distances = scene.distances[0].as_ref().expect("light wanders in it");
        let mut stream = Stream::new(73, Purpose::Test, 0, 0);
        let (mut free, mut told) = (0, 0);
        for _ in 0..20_000 {
            let p = scene.geometry.bounds(0).center()
                + 10.0 * (2.0 * stream.uniform() - 1.0) * sampling::sphere(stream.uniform2());
            let (least, clear) = (distances.least(&scene.geometry, p), scene.geometry.clearance(p, 1e9));
            assert!(least <= clear, "{least} {clear}");
            // A cell's middle is up to 0.44 away, as its edge is half a mean free path; far away it is enough to know that.
            let inside = scene.geometry.contains(0, p);
            assert!(!inside || least >= (clear - 0.9).min(2.0), "{least} {clear}");
            let (ray, length) = (Ray::new(p, sampling::sphere(stream.uniform2())), stream.exponential());
            let meets = scene.geometry.occluded(&ray, 0.0, length, |_| true);
            let tells = distances.is_free(&scene.geometry, &ray, 0.0, length);
            assert!(!(meets && tells));
            free += u32::from(inside && !meets);
            told += u32::from(inside && tells);
        }
        assert!(f64::from(told) > 0.8 * f64::from(free), "{told} of {free} are known to be free");
    }
}
