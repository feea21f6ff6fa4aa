//! Eye paths: radiance along a camera ray, by the unbiased path tracer or from photons.
//!
//! Both walk alike from surface to surface. They differ in the media between: a path either collides
//! there by chance, or, where collisions are rare, splits into a part that does and one that does not;
//! with photons it never collides, and gathers along every segment instead.

use std::f64::consts::PI;
use std::ops::ControlFlow;

use super::equiangular::{self, Stretch};
use crate::gather::march::Marcher;
use crate::gather::{self, Gathered, PointMaps, Queue, Reach, VolumeMaps};
use crate::light::Light;
use crate::math::random::Spread;
use crate::math::{DVec3, Ray, Rgb, Stream, shares};
use crate::medium::{Emission, Medium};
use crate::photon::walls;
use crate::scene::description::SingleScattering;
use crate::scene::{Inside, Scene};
use crate::surface::{Lobe, Rough};
use crate::transport::{
    self, Crossing, Ember, Glows, Interaction, Reflection, Rival, Segment, Side, Stop, Tally, Visitor, Walk,
    light_density, transmit, transmit_straight,
};

/// The components of light transport, by the first event on the eye's side.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(usize)]
pub enum Component {
    /// Emitters and the environment, seen directly.
    Emission,
    /// Light that reflects once, diffusely.
    Direct,
    /// What else a diffuse surface reflects.
    Indirect,
    /// What a mirror or a refracting boundary shows.
    Specular,
    /// What media emit, seen directly.
    VolumeEmission,
    /// Light that scatters once, in a medium.
    VolumeSingle,
    /// What else a medium scatters.
    VolumeMultiple,
}

impl Component {
    /// All of them, in order.
    pub const ALL: [Component; 7] = [
        Component::Emission,
        Component::Direct,
        Component::Indirect,
        Component::Specular,
        Component::VolumeEmission,
        Component::VolumeSingle,
        Component::VolumeMultiple,
    ];

    /// Its layer's name.
    pub fn name(self) -> &'static str {
        match self {
            Component::Emission => "emission",
            Component::Direct => "direct",
            Component::Indirect => "indirect",
            Component::Specular => "specular",
            Component::VolumeEmission => "volume_emission",
            Component::VolumeSingle => "volume_single",
            Component::VolumeMultiple => "volume_multiple",
        }
    }
}

/// What one camera sample saw.
#[derive(Clone, Copy, Debug)]
pub struct Sample {
    /// Radiance by [`Component`].
    pub radiance: [Rgb; Component::ALL.len()],
    /// Reflectance of the first surface.
    pub albedo: Rgb,
    /// Normal of the first surface, facing the eye.
    pub normal: DVec3,
    /// Distance of the first surface; infinite if there is none.
    pub depth: f64,
}

impl Default for Sample {
    fn default() -> Self {
        Sample { radiance: Default::default(), albedo: Rgb::ZERO, normal: DVec3::ZERO, depth: f64::INFINITY }
    }
}

/// How media are dealt with.
#[derive(Clone, Copy)]
pub enum Mode<'a> {
    /// Paths collide by chance.
    Track,
    /// Paths that have not collided yet split on every segment.
    Split,
    /// Light is gathered from photons, by beam queries.
    Gather(&'a VolumeMaps),
    /// The same, by point queries.
    March(&'a PointMaps),
}

/// The safety stop of walks that nothing ends: never below 10⁹ events; counted when it strikes.
pub const SAFETY_STOP: u64 = 1_000_000_000;

/// Samples of more radiance than this would leave the range of images, which are `f32`: dropped and counted.
const BRIGHTEST: f64 = 1e30;

/// Eye paths that carry less than this of a pixel's light are thinned by roulette where photons are gathered; it is also
/// the least that splits at rough boundaries.
const FAINT: f64 = 0.25;

/// The same before the first diffuse surface. A path that goes on through stone gathers nearly as much behind the first
/// petal as in it: with the limit above, roulette there was two thirds of the squared error of a rose of marble.
const FAINT_SPECULAR: f64 = 0.1;

/// The same before the first diffuse surface, where nothing scatters: a ray through clear glass costs little, and what is
/// left to chance there may be a lamp, hundreds of times brighter than what is around it.
const FAINT_CLEAR: f64 = 0.002;

/// The same for paths. Roulette at every event instead, by albedo, took 1.7 times the time for the same error in a
/// room of fog of albedo 1/2 and a third more in smoke; between 0.1 and 0.25 the difference is small.
const FAINT_PATH: f64 = 0.15;

/// Where photons are gathered, a path both reflects and refracts at smooth boundaries if the lesser part is more than this
/// of the pixel's light. In a glass of milk, to leave it to chance after the third boundary made nearly half of the squared
/// error, and the mirror image of a lamp in milk and glass was still speckled at a hundredth.
const LESSER: f64 = 0.002;

/// At rough ones, and behind diffuse surfaces, it does at its first events, so many at most.
const SPLITS: u64 = 3;

/// Points of glowing media that the first diffuse surface asks for light where photons are gathered: each costs
/// little beside the queries of a path.
const EMBERS: u32 = 4;

/// Computes radiance along rays.
pub struct Eye<'s> {
    scene: &'s Scene,
    mode: Mode<'s>,
    /// How rays are marched through each medium for light scattered once, if they are.
    traced: Option<&'s [Marcher]>,
    glows: Glows<'s>,
}

/// Which kind of event came first.
#[derive(Clone, Copy, PartialEq, Eq)]
enum First {
    Diffuse,
    Specular,
    Medium,
}

/// Where a path turned last: decides how light it meets by chance shares with light it asked for.
#[derive(Clone)]
enum Previous {
    /// At the camera or a specular surface: no one else can find that light.
    Specular,
    /// At a diffuse surface.
    Surface { point: DVec3, density: f64 },
    /// At a facet of a rough boundary: the same, but glowing media are met by chance alone.
    Facet { point: DVec3, density: f64 },
    /// In a medium.
    Medium(Collision),
}

/// A collision and how it came about.
#[derive(Clone)]
struct Collision {
    point: DVec3,
    /// The stretch it was drawn on, and where on it.
    stretch: Stretch,
    t: f64,
    /// Of drawing `t`, per length.
    flight_density: f64,
    /// Of the direction drawn since, per steradian.
    phase_density: f64,
}

/// A path on its way.
#[derive(Clone)]
struct Path {
    weight: Rgb,
    events: u64,
    first: Option<First>,
    /// Whether it has met a diffuse surface.
    diffuse: bool,
    previous: Previous,
}

impl Path {
    /// The same path with a collision behind it.
    fn scattered(&self, weight: Rgb) -> Path {
        Path {
            weight,
            events: self.events + 1,
            first: self.first.or(Some(First::Medium)),
            diffuse: self.diffuse,
            previous: Previous::Specular,
        }
    }

    fn component(&self, straight_from_light: bool) -> Component {
        Self::component_of(self.first, self.events, straight_from_light)
    }

    fn component_of(first: Option<First>, events: u64, straight_from_light: bool) -> Component {
        match (first, events) {
            (None, _) if straight_from_light => Component::Emission,
            (None, _) => Component::VolumeEmission,
            (Some(First::Specular), _) => Component::Specular,
            (Some(First::Diffuse), 1) if straight_from_light => Component::Direct,
            (Some(First::Diffuse), _) => Component::Indirect,
            (Some(First::Medium), 1) => Component::VolumeSingle,
            (Some(First::Medium), _) => Component::VolumeMultiple,
        }
    }
}

/// What a sample needs beside the scene.
pub struct Context<'c> {
    /// Its random numbers.
    pub stream: &'c mut Stream,
    /// Stretches that wait for light from photons.
    pub queue: &'c mut Queue<Claim>,
    /// The pixel that claims are made for, by the caller's count.
    pub pixel: u32,
    /// Counts.
    pub tally: &'c mut Tally,
}

/// What becomes of the light that a stretch gathers. No path waits for it: it is added to the pixel when it
/// is known.
#[derive(Clone, Copy, Debug)]
pub struct Claim {
    /// The pixel it is for.
    pub pixel: u32,
    weight: Rgb,
    /// Where light goes that was scattered once, and all other.
    components: [Component; 2],
}

impl Claim {
    /// The radiance that is due, by component; none where it is beyond what images hold, which is counted.
    pub fn settle(&self, gathered: &Gathered, tally: &mut Tally) -> [(Component, Rgb); 2] {
        let (total, single) = gathered.rgb();
        let mut due = [self.weight * single, self.weight * (total - single)];
        check(&mut due, tally);
        [(self.components[0], due[0]), (self.components[1], due[1])]
    }
}

/// How much of a pixel's light a path of this weight carries in a medium of this index, at most: radiance is larger there by
/// the square, which it loses on its way out.
fn matters(weight: Rgb, index: Rgb) -> f64 {
    weight.max_element() * index.max_element().powi(2)
}

/// Drops radiance that is not finite or beyond what images hold.
fn check(radiances: &mut [Rgb], tally: &mut Tally) {
    for radiance in radiances {
        if !radiance.is_finite() || radiance.max_element() > BRIGHTEST {
            tally.broken += 1;
            *radiance = Rgb::ZERO;
        }
    }
}

impl<'s> Eye<'s> {
    /// An eye in a scene. `traced` tells how rays are marched through each medium where light scattered once is
    /// traced; `None`: they are not, and one place is enough.
    pub fn new(scene: &'s Scene, mode: Mode<'s>, traced: Option<&'s [Marcher]>) -> Self {
        Eye { scene, mode, traced, glows: Glows::new(scene) }
    }

    /// How it deals with media.
    pub fn mode(&self) -> Mode<'s> {
        self.mode
    }

    /// What is seen along `ray`, which starts inside these solids.
    pub fn look(&self, ray: Ray, inside: Inside, context: &mut Context<'_>) -> Sample {
        let mut sample = Sample::default();
        let path = Path { weight: Rgb::ONE, events: 0, first: None, diffuse: false, previous: Previous::Specular };
        let split = matches!(self.mode, Mode::Split);
        self.follow(Walk::start(self.scene, ray, inside), path, split, &mut sample, context);
        check(&mut sample.radiance, context.tally);
        sample
    }

    /// Whether a path of `events` events may have one more.
    fn may_go_on(&self, events: u64) -> bool {
        let most = self.scene.render.max_depth as u64;
        most == 0 || events < most
    }

    fn follow(&self, mut walk: Walk<'s>, mut path: Path, split: bool, sample: &mut Sample, context: &mut Context<'_>) {
        let mut travelled = 0.0;
        let mut turns = 0;
        loop {
            let mut visitor = Passage { eye: self, path: &mut path, split, sample, context, collision: None };
            let stop = walk.advance(&mut visitor);
            let collision = visitor.collision.take();
            if path.weight.max_element() <= 0.0 {
                return;
            }
            match stop {
                Stop::Ended => {
                    let Some((collision, medium)) = collision else { return };
                    if !self.collide(&mut walk, &mut path, collision, medium, sample, context) {
                        return;
                    }
                    turns = 0;
                }
                Stop::Surface(at) => {
                    travelled += at.t;
                    if path.first.is_none() && sample.depth.is_infinite() {
                        sample.depth = travelled;
                        sample.normal = at.shading_normal;
                        sample.albedo = match at.reflection {
                            Reflection::Lambert(lambert) => lambert.reflectance,
                            Reflection::Mirror(mirror) => mirror.reflectance,
                            Reflection::Dielectric(..) | Reflection::Rough(_) => Rgb::ONE,
                        };
                    }
                    if !self.reflect(&mut walk, &mut path, &at, sample, context) {
                        return;
                    }
                    turns = if matches!(path.previous, Previous::Specular) { turns + 1 } else { 0 };
                    if !transport::endures(turns, &mut path.weight, context.stream) {
                        return;
                    }
                }
                Stop::Escaped => {
                    self.escape(walk.ray.direction, &path, sample);
                    return;
                }
            }
            if path.events >= SAFETY_STOP {
                context.tally.stopped += 1;
                return;
            }
        }
    }

    /// Scatters at a surface. Returns whether the path goes on.
    fn reflect(
        &self,
        walk: &mut Walk<'s>,
        path: &mut Path,
        at: &Interaction,
        sample: &mut Sample,
        context: &mut Context<'_>,
    ) -> bool {
        if !self.may_go_on(path.events) {
            return false;
        }
        path.events += 1;
        let diffuse = match at.reflection {
            Reflection::Lambert(lambert) => Some(lambert),
            _ => None,
        };
        path.first.get_or_insert(if diffuse.is_some() { First::Diffuse } else { First::Specular });
        path.diffuse |= diffuse.is_some();
        if let Some(lambert) = diffuse {
            if lambert.reflectance.max_element() <= 0.0 {
                return false;
            }
            self.light_surface(path, at, lambert.value(), sample, context);
        }
        let lesser = self.splits(path, at);
        if let Reflection::Rough(rough) = at.reflection {
            self.light_rough(path, at, (&rough, lesser.is_some()), sample, context);
        }
        context.stream.spread(Spread::Direction);
        let Some(lesser) = lesser else { return self.scatter(walk, path, at, None, context.stream) };
        // The greater part goes on here: so one waits for another only as often as light can be halved.
        let mut other = (walk.clone(), path.clone());
        if self.scatter(&mut other.0, &mut other.1, at, Some(lesser), context.stream) {
            self.follow(other.0, other.1, false, sample, context);
        }
        self.scatter(walk, path, at, Some(lesser.other()), context.stream)
    }

    /// Whether a path reflects *and* refracts, and which is the lesser part as a rule. Else a pixel's samples would see now the
    /// light of a medium, now what its boundary mirrors, which is most of their noise where that light is gathered from
    /// photons. Paths that collide by chance are noisier than that.
    fn splits(&self, path: &Path, at: &Interaction) -> Option<Lobe> {
        if !self.has_photons() {
            return None;
        }
        let early =
            |from: Rgb| (path.events <= SPLITS && matters(path.weight, from) >= FAINT).then_some(Lobe::Reflected);
        match at.reflection {
            Reflection::Dielectric(from, to) if !path.diffuse => {
                let (_, reflected) = at.reflected((from, to));
                let [back, through] = [reflected, Rgb::ONE - reflected].map(|part| matters(path.weight * part, from));
                let lesser = if back < through { Lobe::Reflected } else { Lobe::Refracted };
                (back.min(through) > LESSER).then_some(lesser)
            }
            Reflection::Dielectric(from, _) => early(from),
            Reflection::Rough(rough) => early(rough.from),
            Reflection::Lambert(_) | Reflection::Mirror(_) => None,
        }
    }

    /// Sends a path on from a surface. Returns whether it goes on.
    fn scatter(
        &self,
        walk: &mut Walk<'s>,
        path: &mut Path,
        at: &Interaction,
        lobe: Option<Lobe>,
        stream: &mut Stream,
    ) -> bool {
        let Some(onward) = at.scatter_always(Side::Eye, lobe, &mut path.weight, stream) else { return false };
        path.previous = match (at.reflection, onward.density) {
            (Reflection::Lambert(_), density) => Previous::Surface { point: at.point, density },
            (_, density) if density > 0.0 => Previous::Facet { point: at.point, density },
            _ => Previous::Specular,
        };
        walk.leave(at, onward.direction);
        self.outlives(path, &walk.inside, stream)
    }

    /// Whether light in media comes from photons.
    fn has_photons(&self) -> bool {
        matches!(self.mode, Mode::Gather(_) | Mode::March(_))
    }

    /// Roulette for paths that matter little: survivors carry the weight of the others.
    fn outlives(&self, path: &mut Path, inside: &Inside, stream: &mut Stream) -> bool {
        let chance = if self.has_photons() {
            let index = self.scene.index(inside);
            let gathers =
                || self.scene.medium(inside).is_some_and(|medium| self.scene.media[medium as usize].scatters());
            let faint = match path.diffuse {
                true => FAINT,
                false if gathers() => FAINT_SPECULAR,
                false => FAINT_CLEAR,
            };
            matters(path.weight, index) / faint
        } else {
            path.weight.max_element() / FAINT_PATH
        };
        if chance >= 1.0 {
            return true;
        }
        path.weight /= chance;
        stream.uniform() < chance
    }

    /// Light of a glowing medium, where a path turns: `factor` is what a surface or a medium does with it, and
    /// `by_chance` the density with which its direction might be drawn.
    fn light_by_glow(
        &self,
        path: &Path,
        ember: &Ember,
        (factor, by_chance): (Rgb, f64),
        (ray, inside): (Ray, &Inside),
        sample: &mut Sample,
        context: &mut Context<'_>,
    ) {
        let mut weight = path.weight * factor * ember.radiance * ember.weight(self.embers(path), by_chance);
        transmit(self.scene, ray, inside, ember.distance, &mut weight, context.stream);
        sample.radiance[path.component(false) as usize] += weight;
    }

    /// How many points of glowing media are asked for light where a path turned last.
    fn embers(&self, path: &Path) -> u32 {
        if self.has_photons() && path.events == 1 { EMBERS } else { 1 }
    }

    /// Who else sends a path the light of a medium.
    fn rival(&self, path: &Path, medium: u32) -> Option<Rival<'_>> {
        match &path.previous {
            Previous::Specular | Previous::Facet { .. } => None,
            Previous::Surface { point, density } => self.glows.rival(medium, *point, self.embers(path), *density),
            Previous::Medium(at) => self.glows.rival(medium, at.point, self.embers(path), at.phase_density),
        }
    }

    /// Light straight from a light, reflected by a diffuse surface.
    fn light_surface(&self, path: &Path, at: &Interaction, value: Rgb, sample: &mut Sample, context: &mut Context<'_>) {
        for _ in 0..self.embers(path) {
            let Some(ember) = self.glows.draw(at.point, context.stream) else { continue };
            let cos = at.shading_normal.dot(ember.direction);
            if cos > 0.0 && at.normal.dot(ember.direction) > 0.0 {
                let (ray, inside) = at.departure(ember.direction);
                self.light_by_glow(path, &ember, (value * cos, cos / PI), (ray, &inside), sample, context);
            }
        }
        context.stream.spread(Spread::LightChoice);
        let Some((index, choice)) = self.scene.choose_light(at.point, context.stream) else { return };
        let light = &self.scene.lights[index as usize];
        context.stream.spread(Spread::Light);
        let Some(arrival) = light.arrive(&self.scene.geometry, at.point, context.stream) else { return };
        let cos = at.shading_normal.dot(arrival.direction);
        if cos <= 0.0 || at.normal.dot(arrival.direction) <= 0.0 {
            return;
        }
        let density = choice * arrival.density;
        let share = if arrival.has_size { density / (density + cos / PI) } else { 1.0 };
        let mut weight = path.weight * value * arrival.radiance * (cos * share / density);
        let (ray, inside) = at.departure(arrival.direction);
        transmit(self.scene, ray, &inside, arrival.distance, &mut weight, context.stream);
        sample.radiance[path.component(true) as usize] += weight;
    }

    /// Light straight from a light, reflected or refracted by the facets of a rough boundary; `both` says whether both lobes are
    /// followed then.
    fn light_rough(
        &self,
        path: &Path,
        at: &Interaction,
        (rough, both): (&Rough, bool),
        sample: &mut Sample,
        context: &mut Context<'_>,
    ) {
        context.stream.spread(Spread::LightChoice);
        let Some((index, choice)) = self.scene.choose_light(at.point, context.stream) else { return };
        let light = &self.scene.lights[index as usize];
        context.stream.spread(Spread::Light);
        let Some(arrival) = light.arrive(&self.scene.geometry, at.point, context.stream) else { return };
        let asked = choice * arrival.density;
        let mut weight = Rgb::ZERO;
        at.facets(rough, arrival.direction, both, path.weight, context.stream, |arriving, facet| {
            let by_chance = if arrival.has_size { facet.density } else { Rgb::ZERO };
            weight += arriving * facet.value * arrival.radiance / (by_chance + asked);
        });
        if weight.max_element() <= 0.0 {
            return;
        }
        let (ray, inside) = at.departure(arrival.direction);
        transmit(self.scene, ray, &inside, arrival.distance, &mut weight, context.stream);
        sample.radiance[path.component(true) as usize] += weight;
    }

    /// Scatters at a collision in a medium. Returns whether the path goes on.
    fn collide(
        &self,
        walk: &mut Walk<'s>,
        path: &mut Path,
        mut collision: Collision,
        medium: u32,
        sample: &mut Sample,
        context: &mut Context<'_>,
    ) -> bool {
        if !self.may_go_on(path.events) {
            return false;
        }
        path.events += 1;
        path.first.get_or_insert(First::Medium);
        let medium = &self.scene.media[medium as usize];
        if let Some(ember) = self.glows.draw(collision.point, context.stream) {
            let phase = medium.phase.value(walk.ray.direction, ember.direction);
            let towards = (Ray::new(collision.point, ember.direction), &walk.inside);
            self.light_by_glow(path, &ember, (medium.albedo * phase, phase), towards, sample, context);
        }
        self.light_medium(path, &collision, &walk.inside, medium, sample, context);
        path.weight *= medium.albedo;
        if !self.outlives(path, &walk.inside, context.stream) {
            return false;
        }
        context.stream.spread(Spread::Direction);
        let (direction, density) = medium.phase.sample(walk.ray.direction, context.stream);
        walk.turn(collision.t, direction);
        collision.phase_density = density;
        path.previous = Previous::Medium(collision);
        true
    }

    /// Light straight from a light, scattered at a collision.
    fn light_medium(
        &self,
        path: &Path,
        collision: &Collision,
        inside: &Inside,
        medium: &Medium,
        sample: &mut Sample,
        context: &mut Context<'_>,
    ) {
        let point = collision.point;
        context.stream.spread(Spread::LightChoice);
        let Some((index, choice)) = self.scene.choose_light(point, context.stream) else { return };
        let light = &self.scene.lights[index as usize];
        context.stream.spread(Spread::Light);
        let Some(arrival) = light.arrive(&self.scene.geometry, point, context.stream) else { return };
        let phase = medium.phase.value(collision.stretch.ray.direction, arrival.direction);
        let asked = choice * arrival.density;
        let by_chance = if arrival.has_size && !self.straight_on() { phase } else { 0.0 };
        let other = equiangular::density(self.scene, &collision.stretch, collision.t, index, &arrival);
        let share = asked / (asked + by_chance + other / collision.flight_density);
        let mut weight = path.weight * medium.albedo * arrival.radiance * (phase * share / asked);
        let towards = Ray::new(point, arrival.direction);
        self.transmit_to_medium(path.events, towards, inside, arrival.distance, &mut weight, context.stream);
        sample.radiance[path.component(true) as usize] += weight;
    }

    /// Light straight from a light, scattered at a collision, the last event of its path: asked for, and met by
    /// chance, which wide lights and sharp phase functions need.
    fn light_once(
        &self,
        mut path: Path,
        mut collision: Collision,
        inside: &Inside,
        medium: &Medium,
        sample: &mut Sample,
        context: &mut Context<'_>,
    ) {
        self.light_medium(&path, &collision, inside, medium, sample, context);
        if self.straight_on() || !self.scene.lights.iter().any(Light::has_size) {
            return;
        }
        let (direction, density) = medium.phase.sample(collision.stretch.ray.direction, context.stream);
        collision.phase_density = density;
        path.weight *= medium.albedo;
        let mut walk = Walk::new(self.scene, Ray::new(collision.point, direction), inside.clone());
        path.previous = Previous::Medium(collision);
        let mut arriving = Arriving { eye: self, path: &mut path, sample, stream: context.stream };
        if let Stop::Escaped = walk.advance(&mut arriving) {
            self.escape(direction, &path, sample);
        }
    }

    /// Whether light to a medium goes straight on through refracting boundaries.
    fn straight_on(&self) -> bool {
        self.has_photons() && self.scene.volume.single_scattering == SingleScattering::Approximate
    }

    /// What passes from a light to a collision, the last of a path's events.
    fn transmit_to_medium(
        &self,
        events: u64,
        ray: Ray,
        inside: &Inside,
        distance: f64,
        weight: &mut Rgb,
        stream: &mut Stream,
    ) {
        if self.straight_on() {
            let most = match self.scene.render.max_depth as u64 {
                0 => u64::MAX,
                most => most.saturating_sub(events),
            };
            transmit_straight(self.scene, ray, inside, distance, most, weight, stream);
        } else {
            transmit(self.scene, ray, inside, distance, weight, stream);
        }
    }

    /// Light that a path meets by chance on a shape that shines.
    fn meet(&self, path: &Path, crossing: &Crossing<'_>, sample: &mut Sample) {
        let Light::Area(area) = &self.scene.lights[crossing.light as usize] else { return };
        let radiance = area.radiance(crossing.hit.normal, -crossing.ray.direction);
        if radiance.max_element() > 0.0 {
            let share = self.share_by_chance(path, crossing);
            sample.radiance[path.component(true) as usize] += path.weight * radiance * share;
        }
    }

    /// Light from infinity, met by chance.
    fn escape(&self, direction: DVec3, path: &Path, sample: &mut Sample) {
        let component = path.component(true) as usize;
        for (index, light) in self.scene.lights.iter().enumerate() {
            let radiance = light.escaping(direction);
            if radiance.max_element() <= 0.0 {
                continue;
            }
            let asked = |point| self.scene.light_choice(index as u32, point) * light.escaping_density(direction);
            let share = match &path.previous {
                Previous::Specular => 1.0,
                Previous::Surface { point, density } | Previous::Facet { point, density } => {
                    density / (density + asked(*point))
                }
                Previous::Medium(at) => at.phase_density / (at.phase_density + asked(at.point)),
            };
            sample.radiance[component] += path.weight * radiance * share;
        }
    }

    /// The share of light that is met by chance, on a shape that shines.
    fn share_by_chance(&self, path: &Path, crossing: &Crossing<'_>) -> f64 {
        let direction = crossing.ray.direction;
        match &path.previous {
            Previous::Specular => 1.0,
            Previous::Surface { point, density } | Previous::Facet { point, density } => {
                density / (density + light_density(self.scene, crossing, *point, direction))
            }
            Previous::Medium(at) => {
                let asked = light_density(self.scene, crossing, at.point, direction);
                let other = equiangular::density_of_crossing(self.scene, &at.stretch, at.t, crossing);
                at.phase_density / (at.phase_density + asked + other / at.flight_density)
            }
        }
    }
}

/// What a path does on its way to the next surface.
struct Passage<'p, 'c, 's> {
    eye: &'p Eye<'s>,
    path: &'p mut Path,
    split: bool,
    sample: &'p mut Sample,
    context: &'p mut Context<'c>,
    collision: Option<(Collision, u32)>,
}

impl Visitor for Passage<'_, '_, '_> {
    fn segment(&mut self, segment: &Segment<'_>) -> ControlFlow<()> {
        let scene = self.eye.scene;
        let medium = &scene.media[segment.medium as usize];
        if let Mode::Gather(maps) = self.eye.mode {
            self.gather(maps, segment, medium);
            return ControlFlow::Continue(());
        }
        if let Mode::March(maps) = self.eye.mode {
            self.march(maps, segment, medium);
            return ControlFlow::Continue(());
        }
        let stretch = Stretch::new(segment, medium, self.path.weight);
        if medium.scatters() && self.eye.may_go_on(self.path.events) {
            let split = self.split;
            let by_flight = |t| {
                let certain = split.then(|| stretch.certain(medium));
                certain.as_ref().unwrap_or(&stretch).flight_density(medium, t)
            };
            self.scatter_once(segment, &stretch, medium, by_flight);
        }
        if self.split {
            self.split(segment, stretch, medium);
            return ControlFlow::Continue(());
        }
        self.track(segment, stretch, medium)
    }

    fn crossing(&mut self, crossing: &Crossing<'_>) {
        self.eye.meet(self.path, crossing, self.sample);
    }
}

/// Light met by chance from a collision: no more is done to it than to pass.
struct Arriving<'p, 'c, 's> {
    eye: &'p Eye<'s>,
    path: &'p mut Path,
    sample: &'p mut Sample,
    stream: &'c mut Stream,
}

impl Visitor for Arriving<'_, '_, '_> {
    fn segment(&mut self, segment: &Segment<'_>) -> ControlFlow<()> {
        let medium = &self.eye.scene.media[segment.medium as usize];
        transport::pass(medium, segment.ray, (segment.a, segment.b), &mut self.path.weight, self.stream);
        if self.path.weight.max_element() > 0.0 { ControlFlow::Continue(()) } else { ControlFlow::Break(()) }
    }

    fn crossing(&mut self, crossing: &Crossing<'_>) {
        self.eye.meet(self.path, crossing, self.sample);
    }
}

impl Passage<'_, '_, '_> {
    fn add(&mut self, straight_from_light: bool, radiance: Rgb) {
        self.sample.radiance[self.path.component(straight_from_light) as usize] += radiance;
    }

    /// What a medium emits, met by chance.
    fn glow(&mut self, segment: &Segment<'_>, medium: &Medium) {
        let (ray, range, weight) = (segment.ray, (segment.a, segment.b), self.path.weight);
        let rival = self.eye.rival(self.path, segment.medium);
        let radiance = match (&medium.emission, &rival) {
            (Emission::None, _) => return,
            (Emission::Uniform(radiance), Some(rival)) => {
                // The share has no closed integral: one point, drawn as a collision.
                let Some((t, weight)) = transport::force(medium, ray, range, weight, self.context.stream).collision
                else {
                    return;
                };
                weight * (Rgb::ONE - medium.albedo) * *radiance * rival.share(ray.at(t))
            }
            _ => {
                let share = |p| rival.map_or(1.0, |rival| rival.share(p));
                weight * gather::emitted(medium, ray, range, || self.context.stream.uniform(), share)
            }
        };
        self.add(false, radiance);
    }

    fn gather(&mut self, maps: &VolumeMaps, segment: &Segment<'_>, medium: &Medium) {
        self.light_itself(segment, medium);
        let (reach, counts) = self.reach(segment);
        let claim = counts.then_some(Claim {
            pixel: self.context.pixel,
            weight: self.path.weight,
            components: self.components(),
        });
        let passed = maps.gather(medium, reach, claim, self.context.queue);
        self.path.weight *= passed;
    }

    fn march(&mut self, maps: &PointMaps, segment: &Segment<'_>, medium: &Medium) {
        self.light_itself(segment, medium);
        let (reach, counts) = self.reach(segment);
        if counts {
            let scene = self.eye.scene;
            let near = |position, radius, planes: &mut _| walls::near(scene, position, radius, false, planes);
            let Context { queue, stream, .. } = &mut *self.context;
            let stretch = (medium, &reach, self.path.weight);
            let gathered = maps.gather(stretch, &near, stream, &mut queue.marching, &mut queue.stats);
            for (component, radiance) in self.components().into_iter().zip(gathered) {
                self.sample.radiance[component as usize] += self.path.weight * radiance;
            }
        }
        self.path.weight *= medium.transmittance(medium.density.depth(segment.ray, segment.a, segment.b));
    }

    /// Light of a segment that no photon brings: what the medium emits and, if it is traced, what is scattered once.
    fn light_itself(&mut self, segment: &Segment<'_>, medium: &Medium) {
        self.glow(segment, medium);
        let traces = self.eye.scene.volume.single_scattering != SingleScattering::Photons;
        if traces && medium.scatters() && self.eye.may_go_on(self.path.events) {
            let marcher = self.eye.traced.map(|marchers| marchers[segment.medium as usize]);
            match marcher.zip(medium.density.support().clip(segment.ray, segment.a, segment.b)) {
                Some((marcher, (a, b))) if b.is_finite() => self.march_single(segment, medium, &marcher, (a, b)),
                _ => self.trace_single(segment, medium),
            }
        }
    }

    /// What is to be gathered along a segment, and whether any photon may count.
    fn reach(&self, segment: &Segment<'_>) -> (Reach, bool) {
        let scene = self.eye.scene;
        // A photon's events, this scattering and those on the eye's side.
        let most = scene.render.max_depth as u64;
        let allowed = most.checked_sub(self.path.events + 1);
        let reach = Reach {
            ray: *segment.ray,
            a: segment.a,
            b: segment.b,
            medium: segment.medium,
            region: scene.region(segment.inside),
            max_events: if most == 0 { u8::MAX } else { allowed.map_or(0, |events| events.min(255) as u8) },
            from_camera: self.path.events == 0,
        };
        (reach, most == 0 || allowed.is_some())
    }

    /// Where light goes that a medium scattered once on its way to the path, and all other.
    fn components(&self) -> [Component; 2] {
        match self.path.first {
            None => [Component::VolumeSingle, Component::VolumeMultiple],
            Some(First::Specular) => [Component::Specular; 2],
            Some(_) => [Component::Indirect; 2],
        }
    }

    /// A collision by chance.
    fn track(&mut self, segment: &Segment<'_>, stretch: Stretch, medium: &Medium) -> ControlFlow<()> {
        let range = (segment.a, segment.b);
        if matches!(medium.emission, Emission::Uniform(_)) {
            self.glow(segment, medium);
        }
        let rival = self.eye.rival(self.path, segment.medium);
        let component = self.path.component(false) as usize;
        let glows = matches!(medium.emission, Emission::BlackBody { .. });
        let Context { stream, tally, .. } = &mut *self.context;
        let radiance = &mut self.sample.radiance[component];
        stream.spread(Spread::Flight);
        let collision =
            transport::fly(medium, segment.ray, range, &mut self.path.weight, stream, tally, |t, weight| {
                if glows {
                    let point = segment.ray.at(t);
                    let share = rival.map_or(1.0, |rival| rival.share(point));
                    *radiance += weight * medium.emitted(point) * share;
                }
            });
        let Some(t) = collision else { return ControlFlow::Continue(()) };
        let point = segment.ray.at(t);
        let flight_density = stretch.flight_density(medium, t);
        self.collision = Some((Collision { point, stretch, t, flight_density, phase_density: 0.0 }, segment.medium));
        ControlFlow::Break(())
    }

    /// One part collides and is followed to its end; the other goes on.
    fn split(&mut self, segment: &Segment<'_>, mut stretch: Stretch, medium: &Medium) {
        self.glow(segment, medium);
        let weight = self.path.weight;
        self.context.stream.spread(Spread::Flight);
        let forced = transport::force(medium, segment.ray, (segment.a, segment.b), weight, self.context.stream);
        self.path.weight *= forced.passed;
        let Some((t, weight)) = forced.collision else { return };
        stretch.chance = forced.chance;
        let eye = self.eye;
        let mut walk = Walk::new(eye.scene, *segment.ray, segment.inside.clone());
        let mut path = Path { weight, ..self.path.clone() };
        let flight_density = stretch.flight_density(medium, t);
        let collision = Collision { point: segment.ray.at(t), stretch, t, flight_density, phase_density: 0.0 };
        if eye.collide(&mut walk, &mut path, collision, segment.medium, self.sample, self.context) {
            eye.follow(walk, path, false, self.sample, self.context);
        }
    }

    /// Light straight from a light, scattered once on a segment: the path tracer's first collision and no more.
    fn trace_single(&mut self, segment: &Segment<'_>, medium: &Medium) {
        let eye = self.eye;
        let mut stretch = Stretch::new(segment, medium, self.path.weight);
        self.scatter_once(segment, &stretch, medium, |t| stretch.certain(medium).flight_density(medium, t));

        // A collision in proportion to what arrives from there, and light asked for at it.
        let (ray, range, weight) = (segment.ray, (segment.a, segment.b), self.path.weight);
        let forced = transport::force(medium, ray, range, weight, self.context.stream);
        let Some((t, weight)) = forced.collision else { return };
        stretch.chance = forced.chance;
        let flight_density = stretch.flight_density(medium, t);
        let collision = Collision { point: ray.at(t), stretch, t, flight_density, phase_density: 0.0 };
        eye.light_once(self.path.scattered(weight), collision, segment.inside, medium, self.sample, self.context);
    }

    /// The same at every place of a march from `a` to `b`.
    fn march_single(&mut self, segment: &Segment<'_>, medium: &Medium, marcher: &Marcher, (a, b): (f64, f64)) {
        let eye = self.eye;
        let (ray, weight) = (segment.ray, self.path.weight);
        let stretch = Stretch::new(segment, medium, weight);
        let places = |t: f64| {
            let passed = medium.transmittance(medium.density.depth(ray, segment.a, t));
            marcher.places((shares(weight) * passed).element_sum()).max(f64::MIN_POSITIVE)
        };
        self.scatter_once(segment, &stretch, medium, places);

        // What the places' own light needs of the context is lent to the march.
        let mut march = std::mem::take(&mut self.context.queue.marching.march);
        let (path, context) = (&*self.path, &mut *self.context);
        let mut stream = context.stream.clone();
        let mut source = |t: f64, stream: &mut Stream| {
            let (point, flight_density) = (ray.at(t), places(t));
            let collision = Collision { point, stretch: stretch.clone(), t, flight_density, phase_density: 0.0 };
            let mut sample = Sample::default();
            let weight = medium.extinction * medium.density.at(point);
            if weight.max_element() > 0.0 {
                let Context { queue, pixel, tally, .. } = &mut *context;
                let mut context = Context { stream, queue, pixel: *pixel, tally };
                eye.light_once(path.scattered(weight), collision, segment.inside, medium, &mut sample, &mut context);
            }
            // All of it guides adaptive steps.
            let mut parts = [Rgb::ZERO; 1 + Component::ALL.len()];
            parts[0] = sample.radiance.iter().sum();
            parts[1..].copy_from_slice(&sample.radiance);
            parts
        };
        let line = (ray, segment.a, a, b);
        let [_, parts @ ..] = march.along(marcher, line, (medium, weight), &mut stream, &mut source);
        *self.context.stream = stream;
        self.context.queue.marching.march = march;
        for (radiance, part) in self.sample.radiance.iter_mut().zip(parts) {
            *radiance += weight * part;
        }
    }
    /// Light straight from a light, scattered where an equiangular draw says: finds what collisions by
    /// chance find badly, close to small lights and in thin media.
    /// `by_flight` tells with what density collisions are drawn there otherwise.
    fn scatter_once(
        &mut self,
        segment: &Segment<'_>,
        stretch: &Stretch,
        medium: &Medium,
        by_flight: impl Fn(f64) -> f64,
    ) {
        let scene = self.eye.scene;
        self.context.stream.spread(Spread::Equiangular);
        let Some(draw) = equiangular::draw(scene, stretch, self.context.stream) else { return };
        let point = segment.ray.at(draw.t);
        let density = medium.density.at(point);
        if density <= 0.0 {
            return;
        }
        let phase = medium.phase.value(segment.ray.direction, draw.arrival.direction);
        let by_flight = by_flight(draw.t);
        let asked = scene.light_choice(draw.light, point) * draw.arrival.density;
        let by_chance = if draw.arrival.has_size && !self.eye.straight_on() { phase } else { 0.0 };
        let share = draw.density / (draw.density + by_flight * (asked + by_chance));
        let scattering = medium.extinction * medium.albedo * density;
        let mut weight = self.path.weight * scattering * draw.arrival.radiance * (phase * share / draw.density);
        transport::pass(medium, segment.ray, (segment.a, draw.t), &mut weight, self.context.stream);
        if weight.max_element() <= 0.0 {
            return;
        }
        let towards = Ray::new(point, draw.arrival.direction);
        let (inside, distance) = (segment.inside, draw.arrival.distance);
        let events = self.path.events + 1;
        self.eye.transmit_to_medium(events, towards, inside, distance, &mut weight, self.context.stream);
        let first = self.path.first.or(Some(First::Medium));
        self.sample.radiance[Path::component_of(first, events, true) as usize] += weight;
    }
}
