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
use crate::light::{Arrival, Light};
use crate::math::random::Dimension;
use crate::math::{DVec3, Rgb, Stream};
use crate::scene::Scene;

/// A light that a point was told to ask, and what might arrive from it.
#[derive(Clone, Copy, Debug)]
pub struct Asked {
    /// The light: an index into [`Scene::lights`].
    pub light: u32,
    /// What arrives if nothing is in its way.
    pub arrival: Arrival,
    /// The density per steradian with which the light and the direction were drawn; the probability of the light if it has
    /// no size.
    pub density: f64,
}

impl Asked {
    /// Draws a light for a point, and a place on it. `None` where nothing would arrive.
    pub fn draw(scene: &Scene, point: DVec3, stream: &mut Stream) -> Option<Asked> {
        let (light, choice) = stream.draw(Dimension::LightChoice, |stream| scene.choose_light(point, stream))?;
        let arrive = |stream: &mut Stream| scene.lights[light as usize].arrive(&scene.geometry, point, stream);
        let arrival = stream.draw(Dimension::Light, arrive)?;
        Some(Asked { light, arrival, density: choice * arrival.density })
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

/// Where a path turned last, and with what density its direction was drawn: what light that it meets shares with.
#[derive(Clone, Debug)]
pub enum Turn {
    /// At the camera, or by a specular event: no one else can find that light.
    Specular,
    /// At a surface that light was asked for.
    Surface {
        /// The point that asked.
        point: DVec3,
        /// The density of the direction per steradian.
        density: f64,
        /// Whether glowing media were asked, too.
        glows: bool,
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
            Turn::Surface { point, density, .. } => balance(*density, density_of_crossing(scene, crossing, *point)),
            Turn::Medium { point, density, landing } => {
                let asked = density_of_crossing(scene, crossing, *point);
                balance(*density, asked + landing.rival_of_crossing(scene, crossing))
            }
        }
    }

    /// The part of what was met by chance of light `index`, which shines from infinity along `direction`.
    pub fn share_of_escape(&self, scene: &Scene, index: u32, direction: DVec3) -> f64 {
        match self {
            Turn::Specular => 1.0,
            Turn::Surface { point, density, .. } | Turn::Medium { point, density, .. } => {
                let light = &scene.lights[index as usize];
                balance(*density, scene.light_choice(index, *point) * light.escaping_density(direction))
            }
        }
    }

    /// Who else sends a path the light of a glowing medium: points of it, of which `count` were asked for light.
    pub fn rival<'s>(&self, glows: &Glows<'s>, medium: u32, count: u32) -> Option<Rival<'s>> {
        match self {
            Turn::Specular | Turn::Surface { glows: false, .. } => None,
            Turn::Surface { point, density, glows: true } | Turn::Medium { point, density, .. } => {
                glows.rival(medium, *point, count, *density)
            }
        }
    }
}

/// The density per steradian with which a light asked for the point `from` sends a sample along the ray of this crossing,
/// which starts there and meets the light's surface.
fn density_of_crossing(scene: &Scene, crossing: &Crossing<'_>, from: DVec3) -> f64 {
    let Light::Area(area) = &scene.lights[crossing.light as usize] else { return 0.0 };
    let choice = scene.light_choice(crossing.light, from);
    let (direction, hit) = (crossing.ray.direction, crossing.hit);
    if choice > 0.0 { choice * area.density(&scene.geometry, from, direction, hit.t, hit.normal) } else { 0.0 }
}
