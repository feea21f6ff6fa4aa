//! Light asked of glowing media.

use super::balance::balance;
use crate::math::{DVec3, Rgb, Stream, choose};
use crate::scene::{Glow, Scene};

/// All glowing media of a scene that have an end, to ask for light.
///
/// Light of a glow reaches a point in two ways: along a direction drawn for the point, on which all of it is summed
/// up, or from a point drawn in the glow. They share by the balance heuristic (Veach and Guibas 1995), the first
/// counted as one point drawn somewhere on the glow's extent along its direction: any such count is unbiased.
#[derive(Clone, Copy, Debug)]
pub struct Glows<'s> {
    scene: &'s Scene,
    power: f64,
}

/// A point of a glow, as light that may arrive.
#[derive(Clone, Copy, Debug)]
pub struct Ember {
    /// From the asking point to it, of unit length.
    pub direction: DVec3,
    /// How far it is.
    pub distance: f64,
    /// σ_a L_e there: radiance per length.
    pub radiance: Rgb,
    /// The density with which it was drawn, per steradian and length as seen from the asking point.
    density: f64,
    /// The density of points drawn by chance on a direction, per length.
    by_length: f64,
}

impl Ember {
    /// The share of one of `count` such points, over the density it was drawn with, where its direction is drawn by
    /// chance with `by_chance` per steradian.
    pub fn weight(&self, count: u32, by_chance: f64) -> f64 {
        1.0 / (f64::from(count) * self.density + by_chance * self.by_length)
    }
}

/// The other way for a medium's light to reach a path that turned at a point.
#[derive(Clone, Copy, Debug)]
pub struct Rival<'g> {
    glow: &'g Glow,
    /// Points drawn in it, on average.
    count: f64,
    from: DVec3,
    by_chance: f64,
}

impl Rival<'_> {
    /// What is left for the light of the medium at `p`, met by chance.
    pub fn share(&self, p: DVec3) -> f64 {
        let by_chance = self.by_chance / self.glow.extent();
        balance(by_chance, self.count * self.glow.density(p) * self.from.distance_squared(p))
    }
}

impl<'s> Glows<'s> {
    /// All glowing media of a scene that have an end.
    pub fn new(scene: &'s Scene) -> Self {
        Glows { scene, power: scene.glows.iter().map(Glow::power).sum() }
    }

    /// Draws a point whose light may reach `from`.
    pub fn draw(&self, from: DVec3, stream: &mut Stream) -> Option<Ember> {
        if self.scene.glows.is_empty() {
            return None;
        }
        let choice = choose(self.scene.glows.iter().map(Glow::power), self.power, stream.uniform())?;
        let glow = &self.scene.glows[choice.index];
        let (point, density) = glow.draw_leaving(stream);
        let (radiance, _) = self.scene.radiated(glow.medium, point)?;
        let distance = from.distance(point);
        let direction = (point - from) / distance;
        if radiance.max_element() <= 0.0 || !direction.is_finite() {
            return None;
        }
        let density = choice.probability * density * distance * distance;
        Some(Ember { direction, distance, radiance, density, by_length: 1.0 / glow.extent() })
    }

    /// The rival of what a path meets by chance of the light of `medium`. The path turned at `from`, where `count` points were
    /// drawn, into a direction drawn with density `by_chance` per steradian.
    pub fn rival(&self, medium: u32, from: DVec3, count: u32, by_chance: f64) -> Option<Rival<'s>> {
        let glow = self.scene.glows.iter().find(|glow| glow.medium == medium)?;
        let count = f64::from(count) * glow.power() / self.power;
        Some(Rival { glow, count, from, by_chance })
    }
}
