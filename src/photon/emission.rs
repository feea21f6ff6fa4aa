//! Where photons start: lights and glowing media, each drawn in proportion to its power.

use std::f64::consts::{PI, TAU};

use super::importance::Useful;
use super::targets::{Aim, Target, Targets, turn};
use crate::light::{Departure, DrawnFrom, Light};
use crate::math::random::{Dimension, Purpose};
use crate::math::{Bounds, DVec3, Distribution, Frame, Ray, Rgb, Stream, sampling};
use crate::scene::description::PhotonEmission;
use crate::scene::{Glow, Inside, Scene, Surface};

/// How photons are emitted.
#[derive(Clone, Copy, Debug)]
pub struct Emission {
    /// Whether they are aimed at what matters, and learn where that is: a projection map that is drawn from (Jensen 2001, §5.3.1). If
    /// not, each light emits them as it shines, as many as it has power.
    pub aims: bool,
    /// What they are drawn by.
    pub by: PhotonEmission,
}

impl Default for Emission {
    fn default() -> Self {
        Emission { aims: true, by: PhotonEmission::Qmc }
    }
}

impl Emission {
    /// The random numbers of a photon.
    pub(super) fn stream(self, seed: u64, purpose: Purpose, photon: u64, pass: u64) -> Stream {
        match self.by {
            PhotonEmission::Qmc => Stream::of_path(seed, purpose, photon, pass),
            PhotonEmission::Random => Stream::new(seed, purpose, photon, pass),
        }
    }
}

/// All sources of photons of a scene.
#[derive(Clone, Debug)]
pub struct Sources<'s> {
    scene: &'s Scene,
    sources: Vec<Source<'s>>,
    /// The sources' shares of the photons, which are those of the power unless evened out.
    shares: Distribution,
    /// Where photons are aimed at: the spheres around solids, then wider ones; none while they are not.
    targets: Targets,
    /// Whether only those are aimed that come from infinity.
    from_infinity: bool,
}

/// The share of photons that are aimed at the spheres around solids, once photons are.
const CLOSEST: f64 = 0.5;
/// The share that is aimed at wider spheres around these: light that a floor near a solid sends to it comes from there.
const AROUND: f64 = 0.25;
/// The share of photons that are aimed at the spheres around surfaces: the rest is for what those photons bend farther.
const AIMED: f64 = 0.95;
/// The share of photons that stays drawn in proportion to power once shares are evened out: what is learnt from a few
/// photons may be wrong.
pub(super) const BY_POWER: f64 = 0.25;

#[derive(Clone, Debug)]
enum Source<'s> {
    /// A light, and the solids around it where they are the same for all of it.
    Light(u32, Option<Inside>),
    /// A glowing medium.
    Glow(&'s Glow),
}

/// A photon at its start, with the solids around it.
pub struct Start {
    /// The line it starts on.
    pub ray: Ray,
    /// Its power, if it were the only one.
    pub power: Rgb,
    /// The solids around.
    pub inside: Inside,
    /// Whether it comes from a light, not from a glowing medium.
    pub from_light: bool,
    /// The number of its source.
    pub source: u32,
    /// At what it was aimed, if it was.
    pub aim: Option<Aim>,
}

impl<'s> Sources<'s> {
    /// All sources with a power.
    pub fn new(scene: &'s Scene) -> Self {
        Self::of(scene, &scene.glows, |_| true)
    }

    /// All lights with a power, without what glows.
    pub fn of_lights(scene: &'s Scene) -> Self {
        Self::of(scene, &[], |_| true)
    }

    /// These lights alone.
    pub fn of_some_lights(scene: &'s Scene, lights: &[u32]) -> Self {
        Self::of(scene, &[], |light| lights.contains(&light))
    }

    /// All lights for which `shines` holds, and what glows.
    fn of(scene: &'s Scene, glows: &'s [Glow], shines: impl Fn(u32) -> bool) -> Self {
        let mut sources = Vec::new();
        let mut powers = Vec::new();
        for (index, light) in scene.lights.iter().enumerate() {
            let inside = match light {
                Light::Point(point) => Some(scene.inside(point.position)),
                Light::Spot(spot) => Some(scene.inside(spot.position)),
                Light::Goniometric(lamp) => Some(scene.inside(lamp.position)),
                Light::Area(area) => inside_all(scene, &area.bounds),
                _ => scene.solids.is_empty().then(Inside::default),
            };
            sources.push(Source::Light(index as u32, inside));
            let power = || light.power(&scene.surroundings).element_sum();
            powers.push(if shines(index as u32) { power() } else { 0.0 });
        }
        for glow in glows {
            powers.push(glow.power());
            sources.push(Source::Glow(glow));
        }
        let shares = Distribution::new(powers);
        let sources = if shares.is_empty() { Vec::new() } else { sources };
        Sources { scene, sources, shares, targets: Targets::none(), from_infinity: false }
    }

    /// Aims most photons at the solids whose medium scatters, as those that miss are seldom stored; the light is the
    /// same. Does nothing where the world's medium scatters.
    pub fn aim(&mut self) {
        let scatters = |medium: Option<u32>| medium.is_some_and(|index| self.scene.media[index as usize].scatters());
        if scatters(self.scene.world) {
            return;
        }
        let solids = self.scene.solids.iter().filter(|solid| scatters(solid.medium));
        let closest = solids.map(|solid| Target::around(self.scene.geometry.bounds(solid.shape))).collect();
        self.targets = Targets::with_wider(closest, self.scene.surroundings.radius, [CLOSEST, AROUND]);
    }

    /// Aims most photons that come from infinity at what is near, and at wider spheres around it, where the air of the world reaches much farther:
    /// one in thousands would come near. The light is the same. Returns whether it does.
    pub fn aim_through_air(&mut self) -> bool {
        let scene = self.scene;
        self.from_infinity = scene.has_wide_air();
        if self.from_infinity {
            self.targets = Targets::with_wider(
                vec![Target::around(scene.near_bounds())],
                scene.surroundings.radius,
                [CLOSEST, AROUND],
            );
        }
        self.from_infinity
    }

    /// Aims nearly all photons at the surfaces for which `wanted` holds: at each, if there are no more than `most`, else at
    /// the sphere around all. The light is the same.
    pub fn aim_at_surfaces(&mut self, wanted: impl Fn(&Surface) -> bool, most: usize) {
        let surfaces = (0..).zip(&self.scene.surfaces).filter(|(_, surface)| wanted(surface));
        let mut targets: Vec<Target> = surfaces
            .map(|(shape, _)| {
                let (center, radius) = self.scene.geometry.bounding_sphere(shape);
                // The light that just grazes it, too.
                Target::new(center, radius * (1.0 + 1e-9))
            })
            .collect();
        if targets.len() > most {
            let all = targets.iter().fold(Bounds::EMPTY, |all, target| {
                all.union(Bounds { min: target.center, max: target.center }.grown(target.radius))
            });
            targets = vec![Target::around(all)];
        }
        self.targets = Targets::even(targets, AIMED);
    }

    /// Aims anew, as photons of use were aimed: see `Targets::learn`. The light is the same.
    pub fn learn(&mut self, useful: &[(Aim, f64)]) {
        self.targets.learn(useful);
    }

    /// Whether most photons are aimed.
    pub fn are_aimed(&self) -> bool {
        !self.targets.is_empty()
    }

    /// Draws a direction from `from` towards one of the solids that photons are aimed at, if they are.
    pub fn towards_solids(&self, from: DVec3, stream: &mut Stream) -> Option<DVec3> {
        let target = self.targets.any_closest(stream.uniform())?;
        Some(target.towards(from, stream.uniform2()))
    }

    /// The density per steradian with which that is done.
    pub fn density_towards_solids(&self, from: DVec3, direction: DVec3) -> f64 {
        self.targets.density_to_closest(from, direction)
    }

    /// Draws a photon's start anew, from what it was drawn from and from what goes towards a target: the power is
    /// weighted by the density of the first over that of both together.
    fn redraw(&self, departure: Departure, stream: &mut Stream) -> Option<(Departure, Option<Aim>)> {
        let Departure { ray, power, spread } = departure;
        let aims = spread == DrawnFrom::Disc || spread != DrawnFrom::Other && !self.from_infinity;
        if self.targets.is_empty() || !aims {
            return Some((departure, None));
        }
        let [which, place @ ..] = stream.draw(Dimension::Aim, |stream| [(); 3].map(|()| stream.uniform()));
        let chosen = self.targets.choose(which);
        let target = chosen.map(|(_, target)| target);
        let place = target.and_then(|target| target.guide.as_ref()).map_or(place, |guide| guide.place(place));
        let aim = chosen.map(|(target, _)| Aim { target, place });
        if spread == DrawnFrom::Disc {
            let whole = self.scene.surroundings;
            let frame = Frame::around(ray.direction);
            let origin = match target {
                None => ray.origin,
                Some(Target { center, radius, .. }) => {
                    let (s, c) = (TAU * place[1]).sin_cos();
                    let p = *center + *radius * place[0].sqrt() * (c * frame.x + s * frame.y);
                    p - ((p - whole.center).dot(ray.direction) + whole.radius) * ray.direction
                }
            };
            let aside = |center: DVec3| {
                let offset = origin - center;
                offset - offset.dot(ray.direction) * ray.direction
            };
            // Areas of discs, in units of the whole one.
            let density = |target: &Target| {
                let offset = aside(target.center);
                let squared = offset.length_squared() / (target.radius * target.radius);
                let place = || [squared, turn(offset.dot(frame.x), offset.dot(frame.y))];
                if squared <= 1.0 {
                    target.share * (whole.radius / target.radius).powi(2) * target.guided(place)
                } else {
                    0.0
                }
            };
            let density = self.targets.across(&Ray::new(origin, ray.direction), density);
            let weight = if aside(whole.center).length_squared() <= whole.radius * whole.radius { 1.0 } else { 0.0 };
            let power = power * (weight / (weight * self.targets.unaimed() + density));
            return Some((Departure { ray: Ray::new(origin, ray.direction), power, spread }, aim));
        }
        let direction = target.map_or(ray.direction, |target| target.towards(ray.origin, place));
        let own = match spread {
            DrawnFrom::Cosine(normal) => normal.dot(direction).max(0.0) / PI,
            _ => 1.0 / (4.0 * PI),
        };
        let density = self.targets.density(ray.origin, direction);
        let power = power * (own / (own * self.targets.unaimed() + density));
        (own > 0.0).then(|| (Departure { ray: Ray::new(ray.origin, direction), power, spread }, aim))
    }

    /// Draws sources anew in shares with which photons of all of them arrive with about the same power, given the sources
    /// and powers of some that arrived: a sky is drawn for what it sends to a whole scene, of which a solid gets little,
    /// in many photons of little power. The light is the same.
    pub fn even_out(&mut self, arrived: &[(u32, f64)]) {
        let mut found = vec![(0.0, 0.0); self.sources.len()];
        for &(source, power) in arrived {
            let (count, sum) = &mut found[source as usize];
            *count += 1.0;
            *sum += power;
        }
        let mean = |(count, sum): (f64, f64)| if count > 0.0 { sum / count } else { 0.0 };
        self.share_out(|index, share| share * mean(found[index]));
    }

    /// Draws sources anew in the shares that leave the least noise in what is seen, given photons that are of use there, of the shares
    /// as they are: the variance that one leaves is its sum of squared powers there, and falls with its share. The light is the same.
    /// And aims anew, as they were aimed: see [`Self::learn`].
    pub(super) fn favour(&mut self, useful: &[Useful]) {
        let mut squared = vec![0.0; self.sources.len()];
        for useful in useful {
            squared[useful.origin.0 as usize] += useful.squared;
        }
        self.share_out(|index, share| (share * squared[index]).sqrt());
        let aimed = |useful: &Useful| Some((useful.origin.1?, useful.power));
        self.learn(&useful.iter().filter_map(aimed).collect::<Vec<_>>());
    }

    /// Draws sources anew in proportion to what `wanted` says of their numbers and shares, but for [`BY_POWER`].
    fn share_out(&mut self, wanted: impl Fn(usize, f64) -> f64) {
        let shares: Vec<f64> = (0..self.sources.len()).map(|index| self.shares.probability(index)).collect();
        let wanted: Vec<f64> = shares.iter().enumerate().map(|(index, &share)| wanted(index, share)).collect();
        let total: f64 = wanted.iter().sum();
        if !total.is_normal() {
            return;
        }
        let mixed = |(share, wanted): (&f64, f64)| BY_POWER * share + (1.0 - BY_POWER) * wanted / total;
        self.shares = Distribution::new(shares.iter().zip(wanted).map(mixed));
    }

    /// Whether photons may be drawn in more than one way.
    pub fn have_choices(&self) -> bool {
        self.sources.len() > 1 || !self.targets.is_empty()
    }

    /// Whether nothing shines.
    pub fn is_empty(&self) -> bool {
        self.sources.is_empty()
    }

    /// Draws a photon.
    pub fn start(&self, stream: &mut Stream) -> Option<Start> {
        let choice = self.shares.choose(stream.draw(Dimension::LightChoice, Stream::uniform))?;
        let mut start = match &self.sources[choice.index] {
            Source::Light(light, inside) => self.start_at_light(*light, inside.as_ref(), stream)?,
            Source::Glow(glow) => self.start_in(glow, stream)?,
        };
        start.power /= choice.probability;
        start.source = choice.index as u32;
        (start.power.max_element() > 0.0).then_some(start)
    }

    fn start_in(&self, glow: &Glow, stream: &mut Stream) -> Option<Start> {
        let (point, density) = stream.draw(Dimension::Departure, |stream| glow.draw(stream));
        let (radiated, inside) = self.scene.radiated(glow.medium, point)?;
        let direction = sampling::sphere(stream.draw(Dimension::Aim, Stream::uniform2)).normalize();
        Some(Start {
            ray: Ray::new(point, direction),
            power: radiated * (4.0 * PI / density),
            inside,
            from_light: false,
            source: 0,
            aim: None,
        })
    }

    fn start_at_light(&self, index: u32, inside: Option<&Inside>, stream: &mut Stream) -> Option<Start> {
        let light = &self.scene.lights[index as usize];
        let depart = |stream: &mut Stream| light.depart(&self.scene.geometry, &self.scene.surroundings, stream);
        let departure = stream.draw(Dimension::Departure, depart)?;
        let (Departure { ray, mut power, .. }, aim) = self.redraw(departure, stream)?;
        if light.is_infinite() {
            // What it lost in the world's medium before it came near.
            if let Some(world) = self.scene.world {
                let medium = &self.scene.media[world as usize];
                let back = Ray::new(ray.origin, -ray.direction);
                power *= medium.transmittance(medium.density.depth(&back, 0.0, f64::INFINITY));
            }
            return Some(Start { ray, power, inside: Inside::default(), from_light: true, source: 0, aim });
        }
        let inside = inside.cloned().unwrap_or_else(|| self.scene.inside(ray.origin));
        Some(Start { ray, power, inside, from_light: true, source: 0, aim })
    }
}

/// The solids around a light with this box, if they are certain to be the same for all photons that leave it.
fn inside_all(scene: &Scene, bounds: &Bounds) -> Option<Inside> {
    // Photons start a few roundings off the light, to the side that they leave on.
    let margin = 1e-9 * (bounds.min.abs().max(bounds.max.abs()).max_element() + bounds.diagonal());
    let bounds = bounds.grown(margin);
    let (mut around, mut certain) = (Vec::new(), true);
    scene.geometry.boxes_overlapping(&bounds, |shape| {
        if let Some(solid) = scene.surfaces[shape as usize].solid {
            match scene.geometry.contains_all(shape, &bounds) {
                Some(true) => around.push(solid),
                Some(false) => {}
                None => certain = false,
            }
        }
    });
    certain.then(|| Inside::of(around))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene;

    /// Of photons from infinity that are traced through wide air many more come near than of those that are not aimed, and they bring the same light
    /// there.
    #[test]
    fn photons_from_infinity_come_near_through_wide_air() {
        let (scene, _) = scene::from_text(
            "[camera]\nposition = [0, 1, 4]\ntarget = [0, 0, 0]\n\
             [media.air]\nsigma_s = 0.2\nsigma_a = 0.05\ndensity = { type = \"exponential\", scale_height = 2 }\n\
             [world]\nmedium = \"air\"\n\
             [materials.white]\ntype = \"lambert\"\nreflectance = 0.5\n\
             [[shapes]]\ntype = \"sphere\"\ncenter = [0, 0, 0]\nradius = 1\nmaterial = \"white\"\n\
             [[lights]]\ntype = \"environment\"\nradiance = 1\n\
             [[lights]]\ntype = \"directional\"\ndirection = [1, -1, 0]\nirradiance = 3\n",
        );
        assert!(scene.has_wide_air(), "{}", scene.width_of_air());
        const PHOTONS: u64 = 400_000;
        let near = Target::around(scene.near_bounds());
        // How many come near, the power that they bring, and the variance of that.
        let bring = |sources: &Sources<'_>, pass: u64| {
            let (mut count, mut sum, mut squares) = (0.0, 0.0, 0.0);
            for photon in 0..PHOTONS {
                let mut stream = Stream::new(5, Purpose::Test, photon, pass);
                let Some(start) = sources.start(&mut stream) else { continue };
                let offset = start.ray.origin - near.center;
                if offset.cross(start.ray.direction).length() < near.radius {
                    let power = start.power.element_sum() / PHOTONS as f64;
                    (count, sum, squares) = (count + 1.0, sum + power, squares + power * power);
                }
            }
            (count / PHOTONS as f64, sum, squares)
        };
        let mut sources = Sources::new(&scene);
        let (few, plain, plain_variance) = bring(&sources, 0);
        assert!(sources.aim_through_air());
        let (many, aimed, aimed_variance) = bring(&sources, 1);
        assert!(many > 50.0 * few, "{few}, {many}");
        assert!((aimed - plain).abs() < 4.0 * (plain_variance + aimed_variance).sqrt(), "{aimed}, not {plain}");
        assert!(aimed_variance < 0.05 * plain_variance, "{aimed_variance}, {plain_variance}");
    }
}
