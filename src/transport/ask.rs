//! Light that a path asks for, and light that it meets: how the two share.
//!
//! At every vertex that spreads light, a path asks one light for what it sends there, and goes on in a direction drawn by
//! chance, on which it may meet that light. Each counts for its part, by the balance heuristic (Veach and Guibas 1995): of
//! densities p_i with which one and the same light might have been found, the one that found it gets p_i/Σp. What is asked for is
//! weighted by [`Asked::over`], what is met by [`Turn::share_of_crossing`] and [`Turn::share_of_escape`]; in media a third
//! way, the equiangular draw of a collision, takes part in both.

use super::balance::balance;
use super::equiangular::{Draw, Landing};
use super::glow::{Glows, Rival};
use super::segment::Crossing;
use crate::light::{Arrival, Emitter, Light, Receiver};
use crate::math::random::Dimension;
use crate::math::{DVec3, Rgb, Stream};
use crate::scene::Scene;

/// A light that a point was told to ask, and what might arrive from it.
#[derive(Clone, Copy, Debug)]
pub struct Asked {
    /// The light, or a triangle of it.
    pub emitter: Emitter,
    /// What arrives if nothing is in its way.
    pub arrival: Arrival,
    /// The density per steradian with which the light and the direction were drawn; the probability of the light if it has
    /// no size.
    pub density: f64,
}

impl Asked {
    /// Draws a light for a receiver, and a place on it. `None` where nothing would arrive.
    #[inline]
    pub fn draw(scene: &Scene, receiver: &Receiver, stream: &mut Stream) -> Option<Asked> {
        let (emitter, choice) = stream.draw(Dimension::LightChoice, |stream| scene.choose_light(receiver, stream))?;
        let light = &scene.lights[emitter.light as usize];
        let arrive = |stream: &mut Stream| light.arrive(&scene.geometry, emitter.triangle, receiver.point, stream);
        let arrival = stream.draw(Dimension::Light, arrive)?;
        Some(Asked { emitter, arrival, density: choice * arrival.density })
    }

    /// One of `count` such draws, which share with each other.
    pub fn of(self, count: u32) -> Asked {
        Asked { density: f64::from(count) * self.density, ..self }
    }

    /// The radiance to be multiplied by a vertex's value: its part by the balance heuristic over the density it was drawn with, which
    /// is 1/Σp. `met` is the density with which a path would meet the light by chance, `others` that of further ways.
    pub fn over(&self, met: Rgb, others: f64) -> Rgb {
        let met = if self.arrival.has_size { met } else { Rgb::ZERO };
        self.arrival.radiance / (met + self.density + others)
    }
}

impl Draw {
    /// The radiance to be multiplied by what a collision at the drawn place scatters: the draw's part over its density, 1/Σp. A
    /// flight would draw the collision with `by_flight`, and then ask for that light with density `asked`, or
    /// meet it with `met`.
    pub fn over(&self, by_flight: f64, asked: f64, met: f64) -> Rgb {
        let met = if self.arrival.has_size { met } else { 0.0 };
        self.arrival.radiance / (self.density + by_flight * (asked + met))
    }
}

/// Where a path turned last, and with what density its direction was drawn: what light that it meets shares with. To pass a sheet
/// straight on is no turn: shadow rays do so, too.
#[derive(Clone, Debug)]
pub enum Turn {
    /// At the camera, or by a specular event: no one else can find that light.
    Specular,
    /// At a surface that light was asked for.
    Surface {
        /// The point that asked, and its side.
        receiver: Receiver,
        /// The density of the direction per steradian.
        density: f64,
        /// How many shadow rays asked for light there,
        rays: u32,
        /// and how many points of glowing media were asked.
        embers: u32,
    },
    /// At a collision in a medium.
    Medium {
        /// The point of the collision.
        point: DVec3,
        /// The density of the direction per steradian.
        density: f64,
        /// How the collision was drawn.
        landing: Landing,
    },
}

impl Turn {
    /// The part of light that was met by chance on a shape that shines.
    pub fn share_of_crossing(&self, scene: &Scene, crossing: &Crossing<'_>) -> f64 {
        match self {
            Turn::Specular => 1.0,
            Turn::Surface { receiver, density, rays, .. } => {
                balance(*density, f64::from(*rays) * density_of_crossing(scene, crossing, receiver))
            }
            Turn::Medium { point, density, landing } => {
                let asked = density_of_crossing(scene, crossing, &Receiver::around(*point));
                balance(*density, asked + landing.rival_of_crossing(scene, crossing))
            }
        }
    }

    /// The part of what was met by chance of light `index`, which shines from infinity along `direction`.
    pub fn share_of_escape(&self, scene: &Scene, index: u32, direction: DVec3) -> f64 {
        let (receiver, density, rays) = match self {
            Turn::Specular => return 1.0,
            Turn::Surface { receiver, density, rays, .. } => (*receiver, *density, *rays),
            Turn::Medium { point, density, .. } => (Receiver::around(*point), *density, 1),
        };
        let light = &scene.lights[index as usize];
        let emitter = Emitter { light: index, triangle: None };
        let asked = scene.light_choice(emitter, &receiver) * light.escaping_density(direction);
        balance(density, f64::from(rays) * asked)
    }

    /// Who else sends a path the light of a glowing medium: points of it that were asked for light.
    pub fn rival<'s>(&self, glows: &Glows<'s>, medium: u32) -> Option<Rival<'s>> {
        match self {
            Turn::Specular | Turn::Surface { embers: 0, .. } => None,
            Turn::Surface { receiver, density, embers, .. } => glows.rival(medium, receiver.point, *embers, *density),
            Turn::Medium { point, density, .. } => glows.rival(medium, *point, 1, *density),
        }
    }
}

/// The density per steradian with which a light asked for the point `from` sends a sample along the ray of this crossing,
/// which starts there and meets the light's surface.
fn density_of_crossing(scene: &Scene, crossing: &Crossing<'_>, from: &Receiver) -> f64 {
    let Light::Area(area) = &scene.lights[crossing.light as usize] else { return 0.0 };
    let emitter = scene.emitters.at(crossing.light, crossing.hit);
    let choice = scene.light_choice(emitter, from);
    let (way, normal) = ((crossing.ray.direction, crossing.hit.t), crossing.hit.normal);
    if choice > 0.0 { choice * area.density(&scene.geometry, emitter.triangle, from.point, way, normal) } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::Frame;
    use crate::scene;
    use crate::surface::{Bsdf, Incidence, Lambert, Reflector, Side};
    use crate::transport::tests::{interaction, random};
    use crate::transport::{
        DirectionGuide, Events, Interaction, Segment, Stop, Vertex, Visitor, Walk, direction_table,
    };
    use std::convert::Infallible;
    use std::ops::ControlFlow;

    /// A round lamp before an even sky, and a lamp of no size.
    const LAMPS: &str = r#"
[camera]
position = [0, 0, 9]
target = [0, 0, 0]
[[shapes]]
type = "sphere"
center = [0, 1, 2]
radius = 0.8
emission = { radiance = 3 }
[[lights]]
type = "environment"
radiance = 0.25
[[lights]]
type = "point"
position = [-1, 0, 1]
intensity = 0.7
"#;

    /// The same, and rows of balls that shine from below the surface: a tree chooses, by the surface's normal.
    fn many_lamps() -> String {
        let ball = |i: i32| {
            let (x, y) = (2.5 * f64::from(i % 4) - 4.0, 2.5 * f64::from(i / 4) - 4.0);
            let place = format!("center = [{x}, {y}, -1.5]\nradius = 0.7");
            format!("[[shapes]]\ntype = \"sphere\"\n{place}\nemission = {{ radiance = 2 }}\n")
        };
        std::iter::once(LAMPS.to_string()).chain((0..16).map(ball)).collect()
    }

    /// Light met on the way from a place, with its part.
    struct Meeting<'a> {
        scene: &'a Scene,
        turn: Turn,
        found: f64,
    }

    impl Visitor for Meeting<'_> {
        type End = Infallible;

        fn segment(&mut self, _: &Segment<'_>) -> ControlFlow<Infallible> {
            ControlFlow::Continue(())
        }

        fn mixture(&mut self, _: f64, _: bool) -> Option<f64> {
            None
        }

        fn crossing(&mut self, crossing: &Crossing<'_>) {
            let Light::Area(area) = &self.scene.lights[crossing.light as usize] else { return };
            let radiance = area.radiance(crossing.hit.normal, -crossing.ray.direction).x;
            self.found += radiance * self.turn.share_of_crossing(self.scene, crossing);
        }
    }

    /// What a white surface reflects: asked for without sharing, and asked for and met with their parts, against its irradiance,
    /// E = πL (r/d)² cos for a ball above the horizon; of few lights and of many, with a guide for what goes on and without. However coarsely rays are put off the surface, as far from the camera.
    #[test]
    fn what_is_asked_and_what_is_met_make_up_the_light() {
        const N: usize = 200_000;
        let white = Bsdf::from(Reflector::Lambert(Lambert { reflectance: Rgb::ONE }));
        let (center, radius) = (DVec3::new(0.0, 1.0, 2.0), 0.8f64);
        let seen = (radius / center.length()).powi(2) * center.normalize().z;
        let lamp = 0.7 / 2.0 * 0.5f64.sqrt() / std::f64::consts::PI;
        let expected = 3.0 * seen + 0.25 * (1.0 - seen) + lamp;

        // What photons tell may be wrong.
        let table = direction_table([(DVec3::new(0.8, 0.0, 0.6), 1.0)].into_iter()).expect("there is a photon");
        let mut failed = Vec::new();
        for (text, offset) in [(LAMPS.to_string(), 1e-13), (LAMPS.to_string(), 1e-6), (many_lamps(), 1e-13)] {
            let (scene, _) = scene::from_text(&text);
            let point = -scene.center;
            let at = Interaction { point, offset, ..interaction(white, Incidence::head_on()) };
            let guide = DirectionGuide::new(Frame::around(at.incidence.shading_normal), &table);
            let mut sums = [[0.0; 2]; 3];
            for k in 0..2 * N {
                let mut stream = random(5000 + k);
                let vertex = if k < N { Vertex::Surface(&at) } else { Vertex::Guided(&at, &guide) };
                // Asked for, with its part and without.
                let mut asked = [0.0; 2];
                if let Some(light) = Asked::draw(&scene, &vertex.receiver(), &mut stream) {
                    let mut weights = [Rgb::ZERO; 2];
                    let towards = light.arrival.direction;
                    vertex.toward(towards, Side::Eye, false, Rgb::ONE, &mut stream, |weight, sent| {
                        weights[0] += weight * sent.value * light.over(sent.ahead, 0.0);
                        weights[1] += weight * sent.value * light.over(Rgb::ZERO, 0.0);
                    });
                    asked = weights.map(|mut weight| {
                        let way = (towards, light.arrival.distance, light.arrival.normal);
                        vertex.transmit(&scene, way, Events::unlimited(), &mut weight, &mut stream);
                        weight.x
                    });
                }
                // Met by chance.
                let mut weight = Rgb::ONE;
                let onward = vertex.onward(Side::Eye, None, &mut weight, &mut stream, |weight, factor, _| {
                    *weight *= factor;
                    true
                });
                let onward = onward.expect("white surfaces absorb nothing");
                let turn = Turn::Surface { receiver: vertex.receiver(), density: onward.density, rays: 1, embers: 0 };
                let (ray, inside) = at.departure(onward.direction);
                let mut meeting = Meeting { scene: &scene, turn, found: 0.0 };
                if let Stop::Escaped = Walk::new(&scene, ray, inside).advance(&mut meeting) {
                    for (index, light) in scene.lights.iter().enumerate() {
                        let radiance = light.escaping(onward.direction).x;
                        if radiance > 0.0 {
                            let share = meeting.turn.share_of_escape(&scene, index as u32, onward.direction);
                            meeting.found += radiance * share;
                        }
                    }
                }
                let both = asked[0] + weight.x * meeting.found;
                let found = if k < N { vec![(0, both), (1, asked[1])] } else { vec![(2, both)] };
                for (way, x) in found {
                    let sum = &mut sums[way];
                    *sum = [sum[0] + x, sum[1] + x * x];
                }
            }
            for (what, [sum, squares]) in ["both", "asked", "both, guided"].iter().zip(sums) {
                let mean = sum / N as f64;
                let error = ((squares / N as f64 - mean * mean) / N as f64).sqrt();
                let off = (mean - expected).abs();
                let holds = off < 4.0 * error && error < 0.02 * expected;
                let lights = scene.lights.len();
                failed.extend(
                    (!holds).then(|| format!("{what}, {lights} lights, {offset}: {mean} ± {error}, not {expected}")),
                );
            }
        }
        assert!(failed.is_empty(), "{failed:#?}");
    }
}
