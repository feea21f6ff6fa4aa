//! Eye paths: radiance along a camera ray, by the unbiased path tracer, from photons, or by Whitted's ray tracing.
//!
//! Both travel alike from surface to surface. They differ in the media between: a path either collides
//! there by chance, or, where collisions are rare, splits into a part that does and one that does not;
//! with photons it gathers along every segment instead, and only where a phase function has a peak a part of it collides.

mod claim;
mod component;
mod light;
mod media;
mod replay;
mod roulette;
mod single;

use std::ops::ControlFlow;

pub(super) use claim::BRIGHTEST;
pub use claim::Claim;
pub use component::{Component, Sample};
pub use replay::{Happening, Told};

use crate::gather::march::Marcher;
use crate::gather::{FluxMap, GlobalMap, IrradianceCache, PointMaps, Queue, SurfaceMap, VisibilityMap, VolumeMaps};
use crate::light::Light;
use crate::math::{DVec3, Ray, Rgb, Stream};
use crate::medium::phase::Peak;
use crate::scene::description::SingleScattering;
use crate::scene::{Inside, Scene};
use crate::surface::{Lobe, Nature, Side};
use crate::transport::{
    Collision, Crossing, DirectionGuide, Event, Events, Glows, Heading, Interaction, Landing, Luggage, Part, Parts,
    Segment, Tally, Traveller, Turn, Vertex, Walk, travel,
};
pub(super) use component::First;

/// How media are dealt with.
#[derive(Clone, Copy)]
pub enum Mode<'a> {
    /// Paths collide by chance.
    Track,
    /// Paths that have not collided yet split on every segment.
    Split,
    /// Light is gathered from photons, by beam queries.
    Gather(&'a VolumeMaps),
    /// Light is gathered from photons, by point queries.
    March(&'a PointMaps),
    /// Photons would be gathered, but there are none: media only absorb, and shine themselves.
    Pass,
}

/// What an eye is told beside the scene.
#[derive(Clone, Copy)]
pub struct EyeSettings<'s> {
    /// How media are dealt with.
    pub mode: Mode<'s>,
    /// How many events a path may have between light and eye.
    pub max_events: Events,
    /// Who finds light that a medium scatters straight from a light, where all other comes from photons.
    pub single_scattering: SingleScattering,
    /// By medium, the peak of its phase function, where photons leave that to paths.
    pub peaks: &'s [Option<Peak>],
    /// How rays are marched through each medium where lights are asked for that light; `None`: they are not, and one place
    /// is enough.
    pub marchers: Option<&'s [Marcher]>,
    /// Photons of caustics, which surfaces that spread light look up; `None`: paths find caustics by chance.
    pub caustics: Option<&'s SurfaceMap>,
    /// Where surfaces are known to be lit by a light, or in its shadow, so that they need not ask.
    pub visibility: Option<&'s VisibilityMap>,
    /// Who tells what else diffuse surfaces send to one another.
    pub indirect: Indirect<'s>,
    /// How many shadow rays ask for light at the first event, if that is at a surface.
    pub light_samples: u32,
    /// Whether paths end where they meet a surface but a sheet after one that spread them: Whitted's ray tracing.
    pub whitted: bool,
    /// Whether light is sent, all but what comes straight from where it is emitted: paths end at the first surface but sheets.
    pub sends: bool,
    /// How wide what textures are taken over is at the camera, and how much wider for each unit of distance.
    pub spread: [f64; 2],
    /// Whether to break off long paths, which are of no use then.
    pub stop: &'s (dyn Fn() -> bool + Sync),
}

/// Who tells what light diffuse surfaces get that comes neither straight from a light nor as a caustic.
#[derive(Clone, Copy)]
pub enum Indirect<'s> {
    /// The path that goes on.
    Path,
    /// Nobody: it is left out.
    Nobody,
    /// The global map, of that light and of all other together.
    Map(&'s GlobalMap),
    /// Paths that go on to the next diffuse surface (gather rays), where the global map tells the rest.
    Gather {
        /// The map; without one the path goes on.
        global: Option<&'s GlobalMap>,
        /// What is less far away than this is so near that the path goes on: the light of two places would be told as one (Jensen
        /// 2001, §9.4).
        near: f64,
        /// How many rays go on from a surface.
        rays: u32,
        /// What such rays have found elsewhere, if that is kept: where it tells enough, none is sent.
        cache: Option<&'s IrradianceCache>,
    },
}

/// Computes radiance along rays.
pub struct Eye<'s> {
    scene: &'s Scene,
    settings: EyeSettings<'s>,
    glows: Glows<'s>,
    /// Whether rays can meet any light by chance.
    lights_have_size: bool,
    /// Whether rays can meet anything that shines, light or medium.
    meets_emission: bool,
}

/// What an eye path remembers.
#[derive(Clone)]
pub struct Path {
    first: Option<First>,
    /// Whether it has met a diffuse surface.
    diffuse: bool,
    /// Whether a medium has scattered it.
    scattered: bool,
    /// Whether lights that it meets straight from where it was scattered last have been asked for that.
    asked: bool,
    /// Where it was spread last,
    spread: Spread,
    /// and whether it has been mirrored or refracted since, smoothly or by narrow lobes, and no more than that.
    bent: bool,
    /// Whether caustics of what it has met since are left out: something casts none, or they fall on what receives none.
    uncast: bool,
    /// What it has yet to find,
    seeks: Seeks,
    /// and where it seeks what is scattered, how far it came by specular events alone.
    way: f64,
    /// Whether what shines straight on, on the way that it takes, is known already: see [`Looking::glimpse`],
    glimpsed: bool,
    /// and whether it is on the way that the surface mirrors to which it has come.
    mirror_glimpsed: bool,
    /// Whether it splits in media.
    splits: bool,
    /// The share that it is of the paths that went on in one's place, as gather rays do: it carries little, but counts as that one would.
    share: f64,
    /// Where it turned last.
    turn: Turn,
    /// How far it flies in the medium it enters, where that was drawn before.
    drawn: Option<f64>,
    /// How the collision was drawn to which it comes next, where it does.
    landing: Option<Landing>,
}

impl Path {
    /// This path with a collision behind it.
    fn scattered(&self) -> Path {
        let first = self.first.or(Some(First::Medium));
        Path {
            first,
            scattered: true,
            asked: false,
            spread: Spread::Other,
            bent: false,
            seeks: Seeks::All,
            glimpsed: false,
            mirror_glimpsed: false,
            turn: Turn::Specular,
            drawn: None,
            landing: None,
            ..*self
        }
    }

    /// Whether a diffuse surface or a medium has spread it.
    fn is_spread(&self) -> bool {
        self.diffuse || self.scattered
    }

    /// Whether it came straight to a place less far than `near` from where it turned.
    fn is_close(&self, at: &Interaction, near: f64) -> bool {
        matches!(&self.turn, Turn::Surface { receiver, .. } if receiver.point.distance_squared(at.point) < near * near)
    }

    /// Whether the light of a light that it meets is of a caustic: on the surface that it was spread by last.
    fn meets_caustic(&self) -> bool {
        self.bent && matches!(self.spread, Spread::First | Spread::Diffuse)
    }
}

/// Where light was spread over directions.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Spread {
    /// Nowhere, or not by a diffuse surface.
    Other,
    /// By a diffuse surface, the path's first event.
    First,
    /// By another diffuse surface.
    Diffuse,
}

/// What light a path has yet to find since it was spread last.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Seeks {
    /// All.
    All,
    /// What is emitted: it ends where it would be spread again.
    Emitted,
    /// What is scattered.
    Scattered,
}

/// What a sample needs beside the scene.
pub struct Context<'c, 's> {
    /// Its random numbers.
    pub stream: &'c mut Stream,
    /// Segments that wait for light from photons.
    pub queue: &'c mut Queue<Claim>,
    /// The pixel that claims are made for, by the caller's count.
    pub pixel: u32,
    /// Counts of mishaps.
    pub tally: &'c mut Tally,
    /// Room for parts of paths that are yet to be followed; empty between samples.
    pub parts: &'c mut Parts<'s, Path>,
}

impl<'s> Eye<'s> {
    /// An eye in a scene.
    pub fn new(scene: &'s Scene, settings: EyeSettings<'s>) -> Self {
        let lights_have_size = scene.lights.iter().any(Light::has_size);
        let meets_emission = lights_have_size || !scene.glows.is_empty();
        Eye { scene, settings, glows: Glows::new(scene), lights_have_size, meets_emission }
    }

    /// Whether it sends gather rays.
    pub fn gathers(&self) -> bool {
        matches!(self.settings.indirect, Indirect::Gather { .. })
    }

    /// From where light comes that they find, if photons tell that.
    pub fn flux(&self) -> Option<&'s FluxMap> {
        match self.settings.indirect {
            Indirect::Gather { global: Some(global), .. } => global.flux(),
            _ => None,
        }
    }

    /// Looks into a cache before it sends gather rays, from now on.
    pub fn keep(&mut self, kept: Option<&'s IrradianceCache>) {
        if let Indirect::Gather { cache, .. } = &mut self.settings.indirect {
            *cache = kept;
        }
    }

    /// How it deals with media.
    pub fn mode(&self) -> Mode<'s> {
        self.settings.mode
    }

    /// What is seen along `ray`, which starts inside these solids.
    pub fn look(&self, ray: Ray, inside: Inside, context: &mut Context<'_, 's>) -> Sample {
        let mut sample = Sample::default();
        let part = self.start(ray, inside);
        let mut parts = std::mem::take(context.parts);
        travel(&mut Looking { eye: self, sample: &mut sample, context }, part, &mut parts);
        *context.parts = parts;
        claim::check(&mut sample.radiance, context.tally);
        sample
    }

    /// A path at its start.
    fn start(&self, ray: Ray, inside: Inside) -> Part<'s, Path> {
        let splits = matches!(self.settings.mode, Mode::Split);
        let own = Path {
            first: None,
            diffuse: false,
            scattered: false,
            asked: false,
            spread: Spread::Other,
            bent: false,
            uncast: false,
            seeks: Seeks::All,
            way: 0.0,
            glimpsed: false,
            mirror_glimpsed: false,
            splits,
            share: 1.0,
            turn: Turn::Specular,
            drawn: None,
            landing: None,
        };
        let walk = Walk::start(self.scene, ray, inside).spread(self.settings.spread);
        Part { walk, luggage: Luggage::new(Rgb::ONE, own), collision: None }
    }

    /// What a gather ray finds of scattered light, along `direction` from a surface to which `walk` has come, and how far away the
    /// surface is that it meets first, along the way that mirrors and glass lead it. No emitter counts: it is asked for.
    pub fn gather(
        &self,
        at: &Interaction,
        walk: &Walk<'s>,
        direction: DVec3,
        context: &mut Context<'_, 's>,
    ) -> (Rgb, f64) {
        let mut sample = Sample::default();
        let vertex = Vertex::Surface(at);
        let density = at.incidence.shading_normal.dot(direction).max(0.0) / std::f64::consts::PI;
        let own = Path {
            first: Some(First::Diffuse),
            diffuse: true,
            scattered: false,
            asked: false,
            spread: Spread::First,
            bent: false,
            uncast: !at.caustics.receives,
            seeks: Seeks::Scattered,
            way: 0.0,
            glimpsed: false,
            mirror_glimpsed: false,
            splits: false,
            share: 1.0,
            turn: Turn::Surface { receiver: vertex.receiver(), density, rays: 1, embers: 1 },
            drawn: None,
            landing: None,
        };
        let mut luggage = Luggage::new(Rgb::ONE, own);
        luggage.events = 1;
        let mut walk = walk.clone();
        walk.leave(at, direction);
        let mut parts = std::mem::take(context.parts);
        let part = Part { walk, luggage, collision: None };
        travel(&mut Looking { eye: self, sample: &mut sample, context }, part, &mut parts);
        *context.parts = parts;
        claim::check(&mut sample.radiance, context.tally);
        (sample.radiance.iter().sum(), sample.depth)
    }

    /// Whether light in media comes from photons.
    fn has_photons(&self) -> bool {
        matches!(self.settings.mode, Mode::Gather(_) | Mode::March(_) | Mode::Pass)
    }

    /// The peak of a medium's phase function that photons leave to paths.
    fn peak(&self, medium: u32) -> Option<&'s Peak> {
        self.settings.peaks.get(medium as usize)?.as_ref()
    }

    /// Whether light to a medium goes straight on through refracting boundaries.
    fn straight_on(&self) -> bool {
        self.settings.single_scattering.goes_straight_on()
    }

    /// How many more events a path may have; none where it has had too many.
    fn left_after(&self, events: u64) -> Events {
        self.settings.max_events.left_after(events).unwrap_or(Events::at_most(0))
    }
}

/// An eye path on its way.
struct Looking<'e, 'c, 's> {
    eye: &'e Eye<'s>,
    sample: &'e mut Sample,
    context: &'e mut Context<'c, 's>,
}

impl<'s> Traveller<'s> for Looking<'_, '_, 's> {
    type Own = Path;

    fn scene(&self) -> &'s Scene {
        self.eye.scene
    }

    fn stream(&mut self) -> &mut Stream {
        self.context.stream
    }

    fn farthest(&mut self, medium: u32, ray: &Ray, luggage: &mut Luggage<Path>) -> f64 {
        self.draw_flight(&self.eye.scene.media[medium as usize], ray, luggage)
    }

    fn segment(
        &mut self,
        segment: &Segment<'_>,
        luggage: &mut Luggage<Path>,
        parts: &mut Parts<'s, Path>,
    ) -> ControlFlow<f64> {
        self.pass(segment, luggage, parts)
    }

    fn crossing(&mut self, crossing: &Crossing<'_>, luggage: &mut Luggage<Path>) {
        self.meet(crossing, luggage);
    }

    fn turn(
        &mut self,
        at: Vertex<'_>,
        walk: &Walk<'s>,
        luggage: &mut Luggage<Path>,
        parts: &mut Parts<'s, Path>,
    ) -> Option<Heading> {
        match at {
            Vertex::Surface(at) | Vertex::Guided(at, _) => self.reflect(at, walk, luggage, parts),
            Vertex::Medium(at) => self.collide(at, luggage),
        }
    }

    fn escapes(&mut self, direction: DVec3, luggage: &Luggage<Path>) {
        self.escape(direction, luggage);
    }

    fn breaks_off(&mut self) -> bool {
        self.sample.is_broken_off |= (self.eye.settings.stop)();
        self.sample.is_broken_off
    }

    fn stopped(&mut self) {
        self.context.tally.stopped += 1;
    }
}

impl<'s> Looking<'_, '_, 's> {
    /// Scatters at a surface.
    fn reflect(
        &mut self,
        at: &Interaction,
        walk: &Walk<'s>,
        luggage: &mut Luggage<Path>,
        parts: &mut Parts<'s, Path>,
    ) -> Option<Heading> {
        // Some paths are only to meet lights, and what they pass.
        let passes =
            self.eye.settings.sends || self.eye.settings.whitted && matches!(luggage.own.turn, Turn::Surface { .. });
        let (vertex, nature) = (Vertex::Surface(at), at.bsdf.nature());
        let albedo = vertex.albedo();

        // What denoisers and compositors ask for, of the first surface.
        let is_first = luggage.own.first.is_none() || luggage.own.seeks == Seeks::Scattered;
        if luggage.own.seeks == Seeks::Scattered && nature == Nature::Specular {
            // What a mirror or glass shows lies as far behind it as light has yet to go.
            luggage.own.way += at.t;
        } else if is_first && self.sample.depth.is_infinite() {
            self.sample.depth = luggage.own.way + at.t;
            self.sample.normal = at.incidence.shading_normal;
            self.sample.albedo = albedo;
        }

        // The event.
        if !self.eye.settings.max_events.allows(luggage.events) || passes && !at.bsdf.is_sheet() {
            return None;
        }
        luggage.events += 1;
        let diffuse = nature == Nature::Diffuse;
        luggage.own.first.get_or_insert(if diffuse { First::Diffuse } else { First::Specular });
        let gathers = diffuse && luggage.own.diffuse;
        if albedo.max_element() <= 0.0 {
            return None;
        }

        // What its coat or a sheet mirrors: all of it, apart from what the base sends or the sheet lets pass, or what shines in it.
        let coat = if passes { Some(Lobe::Refracted) } else { self.splits_coat(luggage, at) };
        if let Some(base) = coat.filter(|_| !passes) {
            self.send_apart(vertex, walk, luggage, parts, Some(base.other()));
        }
        luggage.own.mirror_glimpsed = coat.is_none() && self.glimpse(at, walk, luggage);
        luggage.own.diffuse |= diffuse;

        // Where all is known of the light that it spreads, on by specular events alone.
        if nature != Nature::Specular && luggage.own.seeks == Seeks::Emitted {
            return self.send_bent(at, luggage, coat);
        }
        match self.eye.settings.indirect {
            Indirect::Map(global) if diffuse => {
                self.read_global(global, at, luggage, false);
                return self.send_bent(at, luggage, coat);
            }
            Indirect::Gather { global: Some(global), near, .. } if gathers && !luggage.own.is_close(at, near) => {
                self.read_global(global, at, luggage, true);
                return self.send_bent(at, luggage, coat);
            }
            _ => {}
        }

        // Light asked for.
        let lesser = self.splits(luggage, at);
        let told = match self.eye.settings.indirect {
            Indirect::Gather { cache: Some(cache), .. } if diffuse => self.read_cache(cache, at, luggage),
            _ => false,
        };
        let guide = if diffuse && !gathers && !told && coat.is_none() { self.guide(at) } else { None };
        let vertex = guide.as_ref().map_or(vertex, |guide| Vertex::Guided(at, guide));
        if nature != Nature::Specular && !self.is_known(at, luggage) {
            self.ask(vertex, luggage, lesser.or(coat).is_some());
        }
        if diffuse {
            self.read_caustics(at, luggage);
            match self.eye.settings.indirect {
                Indirect::Nobody => return self.send_for_emission(at, luggage, coat),
                Indirect::Gather { .. } if told => return self.send_for_emission(at, luggage, coat),
                Indirect::Gather { rays, .. } if !gathers && rays > 1 => {
                    luggage.weight /= f64::from(rays);
                    luggage.own.share /= f64::from(rays);
                    for _ in 1..rays {
                        self.send_apart(vertex, walk, luggage, parts, coat);
                    }
                }
                Indirect::Gather { .. } | Indirect::Path | Indirect::Map(_) => {}
            }
        }

        // On, both ways where that matters: the lesser part waits.
        let Some(lesser) = lesser else { return self.send(vertex, luggage, coat) };
        let other = luggage.clone();
        let heading = self.send(vertex, luggage, Some(lesser.other()));
        self.send_apart(vertex, walk, &other, parts, Some(lesser));
        heading
    }

    /// Where gather rays go on from a matte surface, as photons tell.
    fn guide(&mut self, at: &Interaction) -> Option<DirectionGuide<'s>> {
        let flux = self.eye.flux().filter(|_| at.bsdf.is_matte())?;
        flux.guide(at, &mut self.context.queue.flux)
    }

    /// Draws where a path goes on from a surface.
    fn send(&mut self, vertex: Vertex<'_>, luggage: &mut Luggage<Path>, lobe: Option<Lobe>) -> Option<Heading> {
        let at = vertex.surface()?;
        let always = |weight: &mut Rgb, factor: Rgb, _: &mut Stream| {
            *weight *= factor;
            true
        };
        let onward = vertex.onward(Side::Eye, lobe, &mut luggage.weight, self.context.stream, always)?;
        let (event, diffuse) = (at.event(&onward), vertex.nature() == Nature::Diffuse);
        if onward.density > 0.0 {
            let rays = self.shadow_rays(luggage.events);
            let embers = if diffuse { self.embers(luggage.events) } else { 0 };
            luggage.own.turn = Turn::Surface { receiver: vertex.receiver(), density: onward.density, rays, embers };
            luggage.own.seeks = Seeks::All;
        } else if event != Event::Passed {
            luggage.own.turn = Turn::Specular;
        }
        luggage.own.asked &= match event {
            Event::Passed => true,
            Event::Refracted => self.eye.straight_on(),
            Event::Mirrored | Event::Narrow | Event::Scattered => false,
        };
        luggage.own.glimpsed = match event {
            Event::Passed => luggage.own.glimpsed,
            Event::Mirrored => luggage.own.mirror_glimpsed,
            Event::Refracted | Event::Narrow | Event::Scattered => false,
        };
        if event == Event::Scattered {
            luggage.own.bent = false;
            luggage.own.uncast = !at.caustics.receives;
            luggage.own.spread = match (diffuse, luggage.events) {
                (false, _) => Spread::Other,
                (true, 1) => Spread::First,
                (true, _) => Spread::Diffuse,
            };
        } else if event.bends() {
            luggage.own.bent = true;
            luggage.own.uncast |= !at.caustics.casts;
        }
        let spread = luggage.own.is_spread();
        let goes_on = self.outlives(&mut luggage.weight, (luggage.own.share, spread), at.around(onward.direction));
        goes_on.then_some(Heading { direction: onward.direction })
    }

    /// Goes on by a specular event, or ends. `coat`: the lobe that is left, where what the coat mirrors is followed apart.
    fn send_bent(&mut self, at: &Interaction, luggage: &mut Luggage<Path>, coat: Option<Lobe>) -> Option<Heading> {
        if coat.is_some() || !at.bsdf.is_partly_specular() {
            return None;
        }
        let seeks = luggage.own.seeks;
        let heading = self.send(Vertex::Surface(at), luggage, None);
        luggage.own.seeks = seeks;
        heading.filter(|_| matches!(luggage.own.turn, Turn::Specular))
    }

    /// Goes on to what is emitted, with its part of what was asked for; by a specular event to all there is.
    fn send_for_emission(
        &mut self,
        at: &Interaction,
        luggage: &mut Luggage<Path>,
        coat: Option<Lobe>,
    ) -> Option<Heading> {
        if !self.eye.meets_emission {
            return self.send_bent(at, luggage, coat);
        }
        let heading = self.send(Vertex::Surface(at), luggage, coat);
        if matches!(luggage.own.turn, Turn::Surface { .. }) {
            luggage.own.seeks = Seeks::Emitted;
        }
        heading
    }

    /// Sends a part on from a surface, to be followed later.
    fn send_apart(
        &mut self,
        vertex: Vertex<'_>,
        walk: &Walk<'s>,
        luggage: &Luggage<Path>,
        parts: &mut Parts<'s, Path>,
        lobe: Option<Lobe>,
    ) {
        let Some(at) = vertex.surface() else { return };
        let mut part = luggage.part(luggage.weight, luggage.own.clone());
        if let Some(Heading { direction }) = self.send(vertex, &mut part, lobe) {
            let mut walk = walk.clone();
            walk.leave(at, direction);
            parts.push(Part { walk, luggage: part, collision: None });
        }
    }

    /// Scatters at a collision in a medium: where photons bring light, by the peak of its phase function.
    fn collide(&mut self, at: &Collision<'_>, luggage: &mut Luggage<Path>) -> Option<Heading> {
        let at = &Collision { peak: self.eye.peak(at.index), ..*at };
        if !self.eye.settings.max_events.allows(luggage.events) {
            return None;
        }
        luggage.events += 1;
        luggage.own.first.get_or_insert(First::Medium);
        let landing = luggage.own.landing.take()?;
        let vertex = Vertex::Medium(at);
        luggage.own.scattered = true;
        luggage.own.asked = at.peak.is_some() && self.eye.settings.single_scattering.asks_lights();
        self.ask_glows(vertex, luggage);
        if !luggage.own.asked {
            self.ask_light(vertex, luggage, false, Some(&landing), 1);
        }

        // On.
        luggage.weight *= at.albedo();
        if !self.outlives(&mut luggage.weight, (luggage.own.share, true), at.inside) {
            return None;
        }
        let keep = |_: &mut Rgb, _: Rgb, _: &mut Stream| true;
        let onward = vertex.onward(Side::Eye, None, &mut luggage.weight, self.context.stream, keep)?;
        luggage.own.turn = Turn::Medium { point: at.point, density: onward.density, landing };
        (luggage.own.spread, luggage.own.bent, luggage.own.seeks) = (Spread::Other, false, Seeks::All);
        luggage.own.glimpsed = false;
        Some(Heading { direction: onward.direction })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::random::Purpose;
    use crate::math::sampling;
    use crate::scene;

    /// Fog, glass smooth and rough that holds fog, and white walls under an even sky: nothing absorbs, so nothing is seen, whatever
    /// a path meets and however it deals with media.
    const WHITE: &str = r#"
[camera]
position = [0, 0, 5]
target = [0, 0, 0]
[world]
medium = "thin"
[media.thin]
sigma_s = 0.05
density = { type = "exponential", up = [0, 1, 0], scale_height = 1.0 }
[media.thick]
sigma_s = [0.3, 0.5, 1]
phase = { type = "hg", g = 0.7 }
[materials.white]
type = "lambert"
reflectance = 1
[materials.mirror]
type = "mirror"
[materials.glass]
type = "dielectric"
ior = [1.4, 1.5, 1.6]
[materials.frosted]
type = "dielectric"
roughness = 0.4
[[shapes]]
type = "sphere"
center = [-1.2, 0, 0]
radius = 1
material = "glass"
interior = "thick"
[[shapes]]
type = "sphere"
center = [1.2, 0, 0]
radius = 1
material = "frosted"
interior = "thick"
[[shapes]]
type = "sphere"
center = [0, 2, 0]
radius = 0.8
material = "white"
[[shapes]]
type = "sphere"
center = [0, -2, 0]
radius = 0.8
material = "mirror"
[[lights]]
type = "environment"
radiance = 1
"#;

    #[test]
    fn nothing_is_seen_where_nothing_absorbs() {
        const N: u64 = 500;
        let (scene, _) = scene::from_text(WHITE);
        for (what, mode) in [("track", Mode::Track), ("split", Mode::Split)] {
            let settings = EyeSettings {
                mode,
                max_events: Events::unlimited(),
                single_scattering: SingleScattering::Photons,
                peaks: &[],
                marchers: None,
                caustics: None,
                visibility: None,
                indirect: Indirect::Path,
                light_samples: 1,
                whitted: false,
                sends: false,
                spread: [0.0; 2],
                stop: &|| false,
            };
            let eye = Eye::new(&scene, settings);
            let (mut queue, mut parts, mut tally) = (Queue::default(), Parts::new(), Tally::default());
            let (mut sum, mut squares) = (Rgb::ZERO, Rgb::ZERO);
            for index in 0..N {
                let mut stream = Stream::new(9, Purpose::Test, index, 0);
                let origin = 5.0 * sampling::sphere(stream.uniform2());
                let target = 2.5 * sampling::sphere(stream.uniform2());
                let ray = Ray::new(origin, (target - origin).normalize());
                let mut context =
                    Context { stream: &mut stream, queue: &mut queue, pixel: 0, tally: &mut tally, parts: &mut parts };
                let seen: Rgb = eye.look(ray, scene.inside(origin), &mut context).radiance.iter().sum();
                sum += seen;
                squares += seen * seen;
            }
            let n = N as f64;
            let mean = sum / n;
            let error = ((squares / n - mean * mean) / n).map(f64::sqrt);
            let off = (mean - Rgb::ONE).abs();
            assert!(parts.is_empty() && tally.broken == 0);
            for channel in 0..3 {
                assert!(off[channel] < 4.5 * error[channel] && error[channel] < 0.08, "{what}: {mean} ± {error}");
            }
        }
    }
}
