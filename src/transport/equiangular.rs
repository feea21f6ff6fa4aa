//! Equiangular draws along a segment (Kulla and Fajardo 2012): distances in proportion to the angle a light
//! sees, which cancels the 1/d² of small lights near the ray.

use super::flight;
use super::segment::{Crossing, Segment};
use crate::light::{Along, Arrival, Directivity, Emitter, Light, SoftCone};
use crate::math::{DVec3, Ray, Rgb, Stream, choose, shares};
use crate::medium::Medium;
use crate::scene::Scene;

/// A flight through a segment: how collisions on it are drawn.
#[derive(Clone, Debug)]
pub struct Flight {
    /// The ray.
    pub ray: Ray,
    /// The parameter where the segment begins.
    pub a: f64,
    /// The parameter where it ends; perhaps infinite.
    pub b: f64,
    /// The path's weight at its beginning.
    pub weight: Rgb,
    /// The chance of a collision, where one is certain to be drawn; 1 where it is left to chance.
    pub chance: f64,
    /// Lights farther aside than this are left to collisions by chance: a mean free path.
    reach: f64,
}

/// A draw.
#[derive(Clone, Copy, Debug)]
pub struct Draw {
    /// The parameter on the ray.
    pub t: f64,
    /// The light, or a triangle of it.
    pub emitter: Emitter,
    /// The light that could arrive there, with the density with which it would be asked for there.
    pub arrival: Arrival,
    /// The density of the draw per length, and per steradian if the light has a size.
    pub density: f64,
}

impl Flight {
    /// Through a segment entered with `weight`.
    pub fn new(segment: &Segment<'_>, medium: &Medium, weight: Rgb) -> Self {
        let reach = mean_free_path(medium);
        Flight { ray: *segment.ray, a: segment.a, b: segment.b, weight, chance: 1.0, reach }
    }

    /// This flight where a collision is certain to be drawn.
    pub fn certain(&self, medium: &Medium) -> Self {
        let passed = medium.transmittance(medium.density.depth(&self.ray, self.a, self.b));
        Flight { chance: (shares(self.weight) * (Rgb::ONE - passed)).element_sum(), ..self.clone() }
    }

    /// The density per length with which a collision is drawn at `t`.
    pub fn flight_density(&self, medium: &Medium, t: f64) -> f64 {
        flight::flight_density(medium, &self.ray, self.a, t, self.weight) / self.chance
    }

    /// How much a light matters to this flight; 0 for those it leaves to collisions by chance, wherever on its line it begins
    /// and ends: lights that are far aside, unless their cones are so narrow that chance would miss them.
    fn importance(&self, light: &Light) -> f64 {
        let (center, power, area) = match light {
            Light::Point(point) => (point.position, point.intensity, 0.0),
            Light::Spot(spot) => (spot.position, spot.intensity, 0.0),
            Light::Goniometric(lamp) => (lamp.position, lamp.intensity, 0.0),
            Light::Area(area) => match area.profile {
                Directivity::Diffuse(radiance) => (area.bounds.center(), radiance * area.area, area.area),
                Directivity::Spot(intensity, _) => (area.bounds.center(), intensity, area.area),
                Directivity::Beam(..) => return 0.0,
            },
            Light::Directional(_) | Light::Environment(_) => return 0.0,
        };
        let along = (center - self.ray.origin).dot(self.ray.direction);
        let aside2 = center.distance_squared(self.ray.at(along));
        let is_far = aside2.max(area) > self.reach * self.reach;
        let (a, b) = match cone(light) {
            None if is_far => return 0.0,
            None => (self.a, self.b),
            Some(cone) => {
                let chord = cone.chord(center, &self.ray).filter(|(a, b)| !is_far || b - a < self.reach);
                let Some((a, b)) = chord.or_else(|| (area > 0.0 && !is_far).then_some((self.a, self.b))) else {
                    return 0.0;
                };
                (a.max(self.a), b.min(self.b))
            }
        };
        let nearest = self.ray.at(along.min(b).max(a));
        power.element_sum() / (center.distance_squared(nearest) + area).max(f64::MIN_POSITIVE)
    }

    /// The part of the segment on which light of `light` may arrive that comes from `from`.
    fn lit(&self, light: &Light, from: DVec3) -> Option<(f64, f64)> {
        let Some(cone) = cone(light) else { return Some((self.a, self.b)) };
        let (a, b) = cone.chord(from, &self.ray)?;
        let (a, b) = (a.max(self.a), b.min(self.b));
        (a < b).then_some((a, b))
    }

    fn total_importance(&self, scene: &Scene) -> f64 {
        scene.lights.iter().map(|light| self.importance(light)).sum()
    }

    /// How `to` sees a part of the segment.
    fn seen_from(&self, to: DVec3, (a, b): (f64, f64)) -> Seen {
        let foot = (to - self.ray.origin).dot(self.ray.direction);
        let distance = to.distance(self.ray.origin);
        // A light on the ray itself is moved off it by a billionth.
        let aside = to.distance(self.ray.at(foot)).max(1e-9 * distance).max(f64::MIN_POSITIVE);
        let start = a - foot;
        // The difference of both ends' angles to the perpendicular, by the tangent of a difference.
        let angle = if b.is_finite() {
            (aside * (b - a)).atan2(aside * aside + start * (b - foot))
        } else {
            aside.atan2(start)
        };
        Seen { foot, aside, start, angle }
    }

    /// The density per length with which [`Flight::draw_distance`] draws `t`.
    #[inline]
    pub fn distance_density(&self, to: DVec3, (a, b): (f64, f64), t: f64) -> f64 {
        let seen = self.seen_from(to, (a, b));
        if seen.angle > 0.0 && a <= t && t <= b { seen.density(t) } else { 0.0 }
    }

    /// Draws a place `t` from `a` to `b` on the segment for a light, or a lens, at `to`: in proportion to the angle that it sees; with the
    /// density.
    pub fn draw_distance(&self, to: DVec3, (a, b): (f64, f64), u: f64) -> Option<(f64, f64)> {
        let seen = self.seen_from(to, (a, b));
        let Seen { foot, aside, start, angle } = seen;
        // foot + aside tan(α + u angle), of tan α = start/aside, by the tangent of a sum.
        let (sin, cos) = (u * angle).sin_cos();
        let along = aside * (start * cos + aside * sin) / (aside * cos - start * sin);
        let t = (foot + along).clamp(a, b);
        (angle > 0.0 && t.is_finite()).then(|| (t, seen.density(t)))
    }

    /// What chooses for it, where there are many emitters.
    fn among_many<'s>(&self, scene: &'s Scene) -> Option<Along<'s>> {
        scene.emitters.along(&self.ray, (self.a, self.b), self.reach)
    }

    /// Chooses a light, with the probability of that.
    fn choose(&self, scene: &Scene, stream: &mut Stream) -> Option<(Emitter, f64)> {
        if let Some(many) = self.among_many(scene) {
            return many.draw(stream.uniform());
        }
        let total = self.total_importance(scene);
        if total.is_nan() || total <= 0.0 {
            return None;
        }
        if scene.lights.len() == 1 {
            return Some((Emitter { light: 0, triangle: None }, 1.0));
        }
        let importances = scene.lights.iter().map(|light| self.importance(light));
        let choice = choose(importances, total, stream.uniform())?;
        Some((Emitter { light: choice.index as u32, triangle: None }, choice.probability))
    }

    /// The probability with which [`Flight::choose`] chooses this one.
    fn choice(&self, scene: &Scene, emitter: Emitter) -> f64 {
        if let Some(many) = self.among_many(scene) {
            return many.probability(emitter);
        }
        let importance = self.importance(&scene.lights[emitter.light as usize]);
        if importance > 0.0 && scene.lights.len() > 1 {
            importance / self.total_importance(scene)
        } else if importance > 0.0 {
            1.0
        } else {
            0.0
        }
    }
}

/// How a point sees a segment of a ray.
#[derive(Clone, Copy)]
struct Seen {
    /// The parameter of its foot on the ray.
    foot: f64,
    /// Its distance from the ray.
    aside: f64,
    /// From the foot to where the segment begins.
    start: f64,
    /// The angle under which it sees the segment.
    angle: f64,
}

impl Seen {
    /// The density per length at `t` of draws in proportion to the angle.
    fn density(&self, t: f64) -> f64 {
        let Seen { foot, aside, angle, .. } = *self;
        aside / (angle * (aside * aside + (t - foot) * (t - foot)))
    }
}

/// The cone outside of which no light of a light arrives.
fn cone(light: &Light) -> Option<&SoftCone> {
    match light {
        Light::Spot(spot) => Some(&spot.cone),
        Light::Area(area) => match &area.profile {
            Directivity::Spot(_, cone) => Some(cone),
            Directivity::Diffuse(_) | Directivity::Beam(..) => None,
        },
        _ => None,
    }
}

/// Where the medium is densest, by its mean extinction.
pub fn mean_free_path(medium: &Medium) -> f64 {
    1.0 / (medium.extinction.element_sum() / 3.0 * medium.density.max())
}

/// Whether there is a light to be drawn on flights along this line.
pub fn matters(scene: &Scene, medium: &Medium, ray: &Ray) -> bool {
    let (a, b, weight) = (0.0, f64::INFINITY, Rgb::ONE);
    let flight = Flight { ray: *ray, a, b, weight, chance: 1.0, reach: mean_free_path(medium) };
    scene
        .emitters
        .are_any_along(ray, (a, b), flight.reach)
        .unwrap_or_else(|| scene.lights.iter().any(|light| flight.importance(light) > 0.0))
}

/// Draws a light, a point on it, and a distance on the segment for them.
pub fn draw(scene: &Scene, flight: &Flight, stream: &mut Stream) -> Option<Draw> {
    let (emitter, choice) = flight.choose(scene, stream)?;
    let light = &scene.lights[emitter.light as usize];
    match light {
        Light::Area(area) => {
            let sample = area.sample(&scene.geometry, emitter.triangle, stream.uniform2());
            let lit = flight.lit(light, sample.point)?;
            let (t, per_length) = flight.draw_distance(sample.point, lit, stream.uniform())?;
            let from = flight.ray.at(t);
            let distance = sample.point.distance(from);
            let direction = (sample.point - from) / distance;
            let radiance = area.radiance(sample.normal, -direction);
            let cos = sample.normal.dot(direction).abs();
            if radiance.max_element() <= 0.0 || cos <= 0.0 || !direction.is_finite() {
                return None;
            }
            let arrival = Arrival {
                direction,
                distance,
                radiance,
                density: area.density(&scene.geometry, emitter.triangle, from, (direction, distance), sample.normal),
                has_size: true,
                normal: sample.normal,
            };
            let density = choice * sample.pdf * per_length * distance * distance / cos;
            Some(Draw { t, emitter, arrival, density })
        }
        _ => {
            let position = match light {
                Light::Point(point) => point.position,
                Light::Spot(spot) => spot.position,
                Light::Goniometric(lamp) => lamp.position,
                _ => return None,
            };
            let (t, per_length) = flight.draw_distance(position, flight.lit(light, position)?, stream.uniform())?;
            let arrival = light.arrive(&scene.geometry, None, flight.ray.at(t), stream)?;
            Some(Draw { t, emitter, arrival, density: choice * per_length })
        }
    }
}

/// The density with which [`draw`] draws `t` together with this emitter so that this `arrival` results.
fn density(scene: &Scene, flight: &Flight, t: f64, emitter: Emitter, arrival: &Arrival) -> f64 {
    let light = &scene.lights[emitter.light as usize];
    let choice = flight.choice(scene, emitter);
    if choice <= 0.0 {
        return 0.0;
    }
    let to = flight.ray.at(t) + arrival.distance * arrival.direction;
    let per_length = choice * flight.lit(light, to).map_or(0.0, |lit| flight.distance_density(to, lit, t));
    match light {
        Light::Area(area) => {
            let per_area = area.pdf(&scene.geometry, emitter.triangle, arrival.normal);
            per_length * per_area * arrival.distance * arrival.distance / arrival.normal.dot(arrival.direction).abs()
        }
        _ => per_length,
    }
}

/// A collision, by how it was drawn.
#[derive(Clone, Debug)]
pub struct Landing {
    /// The flight that ended there.
    pub flight: Flight,
    /// The parameter of the collision on the flight's ray.
    pub t: f64,
    /// The density per length with which the flight draws it.
    pub density: f64,
}

impl Landing {
    /// A collision at `t`, which a flight through `medium` draws.
    pub fn new(flight: Flight, medium: &Medium, t: f64) -> Self {
        let density = flight.flight_density(medium, t);
        Landing { flight, t, density }
    }

    /// The density of an equiangular draw of this collision together with this emitter so that this `arrival` results, over
    /// that with which the flight draws the collision: what rivals a light asked for from here, per steradian.
    pub fn rival(&self, scene: &Scene, emitter: Emitter, arrival: &Arrival) -> f64 {
        density(scene, &self.flight, self.t, emitter, arrival) / self.density
    }

    /// What [`Landing::rival`] is of light that was met by chance on the way from here.
    pub fn rival_of_crossing(&self, scene: &Scene, crossing: &Crossing<'_>) -> f64 {
        let arrival = Arrival {
            direction: crossing.ray.direction,
            distance: crossing.hit.t,
            radiance: Rgb::ZERO,
            density: 0.0,
            has_size: true,
            normal: crossing.hit.normal,
        };
        self.rival(scene, scene.emitters.at(crossing.light, crossing.hit), &arrival)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::random::Purpose;
    use std::f64::consts::FRAC_PI_2;

    /// Draws against angles taken one by one: the share of the angle before a draw is its random number, and the density is
    /// the derivative of that share. Beside the light and on its line, before it, behind it, and without an end.
    #[test]
    fn draws_share_out_the_angle() {
        let mut stream = Stream::new(1, Purpose::Test, 0, 0);
        for case in 0..20_000 {
            let size = 10f64.powf(8.0 * stream.uniform() - 4.0);
            let [from, length, aside] = std::array::from_fn(|_| 10f64.powf(6.0 * stream.uniform() - 3.0));
            let a = if case % 2 == 0 { 0.0 } else { size };
            let foot = if case % 3 == 0 { -from } else { from } * size;
            let b = if case % 5 == 0 { f64::INFINITY } else { a + length * size };
            let aside = aside * size;
            let flight = Flight {
                ray: Ray::new(DVec3::new(0.0, 0.0, size), DVec3::X),
                a,
                b,
                weight: Rgb::ONE,
                chance: 1.0,
                reach: f64::INFINITY,
            };
            let to = DVec3::new(foot, 0.6 * aside, size + 0.8 * aside);
            let u = stream.uniform();
            let (t, density) = flight.draw_distance(to, (a, b), u).unwrap();

            let angle = |t: f64| if t.is_finite() { ((t - foot) / aside).atan() } else { FRAC_PI_2 };
            let (start, end) = (angle(a), angle(b));
            // Angles near a right one, and their differences, lose digits to rounding.
            let sure = 1e-9 + 1e-13 / (end - start);
            let at = format!("case {case}: {u} draws {t} of {a} to {b}, the foot at {foot}, {aside} aside");
            assert!((a..=b).contains(&t), "{at}");
            assert!(((angle(t) - start) / (end - start) - u).abs() < sure, "{at}");
            let expected = 1.0 / (aside * (end - start) * (1.0 + ((t - foot) / aside).powi(2)));
            assert!((density / expected - 1.0).abs() < sure, "{at}: density {density}, not {expected}");
            assert_eq!(density, flight.distance_density(to, (a, b), t), "{at}");
        }
    }
}
