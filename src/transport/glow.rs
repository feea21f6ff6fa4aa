//! Glowing media as lights.

use crate::math::random::Purpose;
use crate::math::{Bounds, DVec3, Rgb, Stream};
use crate::scene::{Inside, Scene};

/// A glowing medium that has an end, in a box: points are drawn from cells in proportion to what was found there.
#[derive(Debug)]
pub struct Glow {
    /// The medium: an index into [`Scene::media`].
    pub medium: u32,
    bounds: Bounds,
    /// Running sums over the cells, x fastest, ending in 1.
    cumulative: Vec<f64>,
    /// An estimate of its power.
    power: f64,
}

/// Cells along each edge of a glowing medium's box.
const CELLS: usize = 24;
/// Points tried in each cell.
const TRIES: usize = 4;
/// The share of points drawn evenly over the box, so that no place is missed.
const EVEN: f64 = 0.1;

impl Glow {
    /// All of a scene.
    pub fn all(scene: &Scene) -> Vec<Glow> {
        let media = (0..).zip(&scene.media).filter(|(_, medium)| medium.glows());
        media.filter_map(|(index, _)| Glow::new(scene, index)).collect()
    }

    /// `None` where the medium is nowhere, or has no end.
    fn new(scene: &Scene, medium: u32) -> Option<Glow> {
        let support = scene.media[medium as usize].density.support();
        let mut bounds = Bounds::EMPTY;
        if scene.world == Some(medium) {
            bounds = support;
        }
        for solid in scene.solids.iter().filter(|solid| solid.medium == Some(medium)) {
            bounds = bounds.union(scene.geometry.bounds(solid.shape).intersection(support));
        }
        if bounds.is_empty() || !bounds.size().is_finite() {
            return None;
        }
        let mut glow = Glow { medium, bounds, cumulative: Vec::with_capacity(CELLS.pow(3)), power: 0.0 };
        let mut stream = Stream::new(0, Purpose::Map, medium as u64, 0);
        let mut sum = 0.0;
        for cell in 0..CELLS.pow(3) {
            for _ in 0..TRIES {
                let p = glow.point_in(cell, std::array::from_fn(|_| stream.uniform()));
                sum += glow.radiated(scene, p).map_or(0.0, |(radiated, _)| radiated.element_sum());
            }
            glow.cumulative.push(sum);
        }
        if sum <= 0.0 {
            return None;
        }
        let cells = CELLS.pow(3) as f64;
        for (cell, share) in glow.cumulative.iter_mut().enumerate() {
            *share = (1.0 - EVEN) * *share / sum + EVEN * (cell + 1) as f64 / cells;
        }
        glow.power = 4.0 * std::f64::consts::PI * sum / TRIES as f64 * glow.cell_volume();
        Some(glow)
    }

    /// About the power it sends out, all channels together, before it is absorbed on its way.
    pub fn power(&self) -> f64 {
        self.power
    }

    fn cell_volume(&self) -> f64 {
        (self.bounds.size() / CELLS as f64).element_product()
    }

    fn point_in(&self, cell: usize, u: [f64; 3]) -> DVec3 {
        let index = DVec3::new((cell % CELLS) as f64, (cell / CELLS % CELLS) as f64, (cell / CELLS / CELLS) as f64);
        self.bounds.min + (index + DVec3::from_array(u)) / CELLS as f64 * self.bounds.size()
    }

    /// The share of points that one cell gets.
    fn share(&self, cell: usize) -> f64 {
        self.cumulative[cell] - if cell == 0 { 0.0 } else { self.cumulative[cell - 1] }
    }

    /// σ_a L_e at `p`, radiance per length, and the solids around; `None` outside of the medium.
    pub fn radiated(&self, scene: &Scene, p: DVec3) -> Option<(Rgb, Inside)> {
        let medium = &scene.media[self.medium as usize];
        let density = medium.density.at(p);
        if density <= 0.0 {
            return None;
        }
        let inside = scene.inside(p);
        (scene.medium(&inside) == Some(self.medium)).then(|| (medium.emitted(p) * density, inside))
    }

    /// Draws a point, perhaps outside of the medium, and tells the density per volume with which it was drawn.
    pub fn draw(&self, stream: &mut Stream) -> (DVec3, f64) {
        let u = stream.uniform();
        let cell = self.cumulative.partition_point(|&sum| sum <= u).min(self.cumulative.len() - 1);
        let point = self.point_in(cell, std::array::from_fn(|_| stream.uniform()));
        (point, self.share(cell) / self.cell_volume())
    }

    /// The density per volume with which [`Glow::draw`] draws `p`.
    fn density(&self, p: DVec3) -> f64 {
        let place = (p - self.bounds.min) / self.bounds.size() * CELLS as f64;
        let [x, y, z] = place.to_array().map(|x| (x.max(0.0) as usize).min(CELLS - 1));
        self.share((z * CELLS + y) * CELLS + x) / self.cell_volume()
    }
}

/// All glowing media of a scene that have an end, to ask for light.
///
/// Light of a glow reaches a point in two ways: along a direction drawn for the point, on which all of it is summed
/// up, or from a point drawn in the glow. They share by the balance heuristic (Veach and Guibas 1995), the first
/// counted as one point drawn somewhere on the glow's extent along its direction: any such count is unbiased.
#[derive(Debug)]
pub struct Glows<'s> {
    scene: &'s Scene,
    glows: Vec<Glow>,
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
    /// With which it was drawn, per steradian and length as seen from the asking point.
    density: f64,
    /// Of points drawn by chance, per length.
    by_length: f64,
}

impl Ember {
    /// Its share, over the density it was drawn with, where its direction is drawn by chance with `by_chance` per
    /// steradian.
    pub fn weight(&self, by_chance: f64) -> f64 {
        1.0 / (self.density + by_chance * self.by_length)
    }
}

/// The other way for a medium's light to reach a path that turned at a point.
#[derive(Clone, Copy, Debug)]
pub struct Rival<'g> {
    glow: &'g Glow,
    choice: f64,
    from: DVec3,
    by_chance: f64,
}

impl Rival<'_> {
    /// What is left for the light of the medium at `p`, met by chance.
    pub fn share(&self, p: DVec3) -> f64 {
        let by_chance = self.by_chance / self.glow.extent();
        by_chance / (by_chance + self.choice * self.glow.density(p) * self.from.distance_squared(p))
    }
}

impl Glow {
    fn extent(&self) -> f64 {
        self.bounds.size().max_element()
    }
}

impl<'s> Glows<'s> {
    /// Those of a scene.
    pub fn new(scene: &'s Scene) -> Self {
        let glows = Glow::all(scene);
        let power = glows.iter().map(Glow::power).sum();
        Glows { scene, glows, power }
    }

    /// Draws a point whose light may reach `from`.
    pub fn draw(&self, from: DVec3, stream: &mut Stream) -> Option<Ember> {
        let last = self.glows.last()?;
        let mut left = stream.uniform() * self.power;
        let glow = self.glows.iter().find(|glow| {
            left -= glow.power;
            left < 0.0
        });
        let glow = glow.unwrap_or(last);
        let (point, density) = glow.draw(stream);
        let (radiance, _) = glow.radiated(self.scene, point)?;
        let distance = from.distance(point);
        let direction = (point - from) / distance;
        if radiance.max_element() <= 0.0 || !direction.is_finite() {
            return None;
        }
        let density = glow.power / self.power * density * distance * distance;
        Some(Ember { direction, distance, radiance, density, by_length: 1.0 / glow.extent() })
    }

    /// The rival of light of `medium` that a path meets by chance which turned at `from`, its direction drawn with
    /// `by_chance` per steradian.
    pub fn rival(&self, medium: u32, from: DVec3, by_chance: f64) -> Option<Rival<'_>> {
        let glow = self.glows.iter().find(|glow| glow.medium == medium)?;
        Some(Rival { glow, choice: glow.power / self.power, from, by_chance })
    }
}
