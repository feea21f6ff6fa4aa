//! Photons on surfaces that spread light: those of caustics, from a light by specular events, one at least, to the first such
//! surface; and the global ones, wherever they land and whatever they met.
//!
//! Each map's are traced apart, and apart from those in media: most light never meets a lens, and photons that are aimed at what
//! bends light are few and all alike, whatever the other maps need.

use std::ops::ControlFlow;

use rayon::prelude::*;

use super::budget::{self, Bill, Budget};
use super::control::{Filled, RICHER, Tagged, hand_over};
use super::emission::{Emission, Sources, Start};
use super::history::History;
use super::importance::{Importance, Importon, Origin, Useful};
use super::tracer::in_chunks;
use super::{PackedNormal, Photon};
use crate::Result;
use crate::math::random::Purpose;
use crate::math::{Ray, Stream};
use crate::scene::{Scene, Surface};
use crate::surface::{Incidence, Material, Nature, Side};
use crate::transport::{
    Ahead, Event, Events, Heading, Interaction, Luggage, Part, Parts, Segment, Tally, Traveller, Vertex, Walk, survive,
    travel,
};

/// Which photons on surfaces.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// L S⁺ D: mirrored or refracted, and not scattered, since they left a light.
    Caustic,
    /// L (S | D | M)* D: all.
    Global,
}

/// What a map of photons on surfaces is asked for.
#[derive(Clone, Copy, Debug)]
pub struct SurfacePass<'a> {
    /// Which photons.
    pub kind: Kind,
    /// The user's seed.
    pub seed: u64,
    /// The number of the pass: each draws photons of its own.
    pub index: u64,
    /// About how many photons the map should hold.
    pub target: u64,
    /// At most this many are emitted.
    pub max_emitted: u64,
    /// How they are emitted.
    pub emission: Emission,
    /// How many events light may have on its way to the eye.
    pub max_events: Events,
    /// Whether photons are of no use where surfaces send hardly any light to one another.
    pub needs_exchange: bool,
    /// Whether some of those that were scattered before are told apart.
    pub tells_scattered: bool,
    /// Where they count in the picture, if they are drawn and kept by that.
    pub importons: Option<&'a [Importon]>,
    /// Whether more photons are traced, and hand their power to neighbours where they lie closest; and whether only to those of as many
    /// events.
    pub control: Option<Tagged>,
}

/// What it holds.
#[derive(Debug, Default)]
pub struct Landed {
    /// The photons, powers divided by the number of emitted photons.
    pub photons: Vec<Photon>,
    /// Photons emitted.
    pub emitted: u64,
    /// Photons that a whole pass emits: more than that, of a [sample](sample_surfaces); 0 where there is none.
    pub planned: u64,
    /// Events of an emission on average, as a pilot counted them.
    pub events: f64,
    /// Whether most of them were aimed at surfaces.
    pub aimed: bool,
    /// Why there are none, if a pilot found that.
    pub why_none: Option<&'static str>,
    /// Whether there are none, as surfaces send hardly any light to one another, though media send light to them.
    pub from_media_only: bool,
    /// Some of those traced that were scattered before, if that was asked for: they tell where light comes from.
    pub scattered: Vec<Photon>,
    /// Which of those traced were,
    scattered_ones: Vec<u32>,
    /// and how many by a surface last.
    exchanged: u64,
    /// Of each, while it is noted, where it started and its power.
    origins: Vec<(Origin, f64)>,
    /// Counts of mishaps.
    pub tally: Tally,
    bill: Bill,
}

/// Emissions of the pilot that tells the yield.
const PILOT: u64 = 1 << 13;
/// Emissions of a pilot that tells where photons land.
const PILOT_OF_PLACES: u64 = 1 << 14;
/// No more emissions than so many for each photon that is wanted: light that hardly ever meets a lens is no caustic worth
/// more.
const MOST_EMISSIONS: u64 = 16;

/// What is learnt is used where it lands photons worth so many times as many of even power.
const BETTER: f64 = 1.2;

/// Specular surfaces that are aimed at one by one, at most: every photon asks every target for its density.
const MOST_TARGETS: usize = 64;

/// Where light comes from changes slowly from place to place: one in so many photons tells it.
const ONE_IN: usize = 4;

/// Where fewer of the pilot's photons land, there is no map: paths find that light by chance.
const FEWEST: usize = 8;

/// Photons of more events than these on average are long on their way: each lands often,
const LONG: f64 = 5000.0;
/// and a map is of so many at least, though not all that land are kept.
const LEAST_OF_LONG: u64 = 10_000;

/// Whether a surface spreads light.
pub(super) fn spreads(material: &Material) -> bool {
    match material {
        Material::Opaque(bsdf) => {
            bsdf.nature() == Nature::Diffuse && bsdf.albedo(&Incidence::head_on()).max_element() > 0.0
        }
        Material::Dielectric(_) | Material::None | Material::Mixture(_) => false,
    }
}

/// Whether light that a surface mirrors or refracts, smoothly or by a narrow lobe, may become a caustic.
fn casts(scene: &Scene, surface: &Surface) -> bool {
    surface.caustics.casts && scene.any_part(&surface.material, &Material::is_narrow)
}

/// Whether photons of this kind may land in a scene: on surfaces that spread light, and of caustics, where they are received, after
/// something specular that casts them.
pub fn may_land(scene: &Scene, kind: Kind) -> bool {
    why_none_land(scene, kind).is_none()
}

/// Why no photons of this kind can land in a scene; `None` where they may.
pub fn why_none_land(scene: &Scene, kind: Kind) -> Option<&'static str> {
    let any = |holds: &dyn Fn(&Surface) -> bool| scene.surfaces.iter().any(holds);
    let spreads = |surface: &Surface| scene.any_part(&surface.material, &spreads);
    match kind {
        Kind::Caustic => {
            let receives = |surface: &Surface| surface.caustics.receives && spreads(surface);
            if scene.lights.is_empty() {
                Some("there is no light but what glows")
            } else if !any(&|surface| casts(scene, surface)) {
                Some("nothing mirrors or refracts")
            } else {
                (!any(&receives)).then_some("no surface spreads light")
            }
        }
        Kind::Global if scene.lights.is_empty() && scene.glows.is_empty() => Some("nothing shines"),
        Kind::Global => (!any(&spreads)).then_some("no surface spreads light"),
    }
}

/// Traces the photons of a map. `progress` is told how many emissions were done since it was last told, and how many there are to
/// be; `stop` ends the pass early. No more than pilots are emitted where hardly any would land, or hardly any of use.
///
/// # Errors
/// As [`trace`](super::trace).
pub fn trace_surfaces(
    scene: &Scene,
    pass: &SurfacePass<'_>,
    progress: &(impl Fn(u64, u64) + Sync),
    stop: &(impl Fn() -> bool + Sync),
) -> Result<Landed> {
    trace_some(scene, pass, u64::MAX, progress, stop)
}

/// Traces the first photons of a map: as many as are to leave about so many in it. They tell what all of them come to.
///
/// # Errors
/// As [`trace_surfaces`], for what the whole map would take.
pub fn sample_surfaces(scene: &Scene, pass: &SurfacePass<'_>, photons: u64) -> Result<Landed> {
    trace_some(scene, pass, photons, &|_, _| {}, &|| false)
}

/// Traces the first photons of a map, about `most` of those that land, or all.
fn trace_some(
    scene: &Scene,
    pass: &SurfacePass<'_>,
    most: u64,
    progress: &(impl Fn(u64, u64) + Sync),
    stop: &(impl Fn() -> bool + Sync),
) -> Result<Landed> {
    let sources = match pass.kind {
        Kind::Caustic => Sources::of_lights(scene),
        Kind::Global => Sources::new(scene),
    };
    let (budget, notes) = (Budget::of_pilots(), true);
    let (importance, keep) = (None, 1.0);
    let mut tracer = SurfaceTracer { scene, pass, sources: sources.clone(), importance, notes, keep, budget: &budget };
    let none = |why| Landed { why_none: Some(why), ..Landed::default() };
    if tracer.sources.is_empty() {
        return Ok(none("lights have no power"));
    }

    // Where walks are very long, a few of them tell enough.
    let each = budget.events_of_each(|emitted| drop(tracer.run(Purpose::Pilot, emitted, &|_, _| {}, stop)));
    let few = budget::pilot(PILOT, each);

    // Aimed, at what bends light or at all there is, or not: whichever lands more. Photons that are not aimed are more alike, but those
    // that are may learn.
    let pilot = |tracer: &SurfaceTracer<'_>| tracer.run(Purpose::Pilot, few, &|_, _| {}, stop);
    let mut found = pilot(&tracer);
    if pass.emission.aims {
        let favour = match pass.kind {
            Kind::Caustic => {
                tracer.sources.aim_at_surfaces(|surface| casts(scene, surface), MOST_TARGETS);
                0.8
            }
            Kind::Global => {
                tracer.sources.aim_at_surfaces(|surface| scene.any_part(&surface.material, &spreads), 1);
                2.0
            }
        };
        let aimed = pilot(&tracer);
        if favour * found.photons.len() as f64 > aimed.photons.len() as f64 {
            tracer.sources = sources;
        } else {
            found = aimed;
        }
    }
    budget.settle()?;
    const HARDLY_ANY: &str = "hardly any photon of a pilot lands";
    if found.photons.len() < FEWEST {
        return Ok(none(HARDLY_ANY));
    }
    if pass.needs_exchange && found.exchanged < FEWEST as u64 {
        let from_media_only = found.scattered_ones.len() >= FEWEST;
        return Ok(Landed { from_media_only, ..none("surfaces send hardly any light to one another, by a pilot") });
    }

    // From which sources photons come that are of use, and aimed whither; what is of use in what is seen, and kept there.
    let mut pilots = few;
    if let Some(importons) = pass.importons {
        pilots = budget::pilot(PILOT_OF_PLACES, each);
        let pilot = |tracer: &SurfaceTracer<'_>| tracer.run(Purpose::Pilot, pilots, &|_, _| {}, stop);
        let places = |found: &Landed| Importance::new(importons, found.photons.iter().map(|photon| photon.position));
        found = pilot(&tracer);
        if let Some(importance) = places(&found).filter(|_| pass.emission.aims && tracer.sources.have_choices()) {
            let origins = found.origins.iter().map(|&(origin, _)| origin);
            let useful: Vec<Useful> = importance.useful(found.photons.iter().zip(origins)).collect();
            tracer.sources.favour(&useful);
            found = pilot(&tracer);
        }
        tracer.importance = places(&found);
        found = pilot(&tracer);
        if found.photons.is_empty() {
            return Ok(none(HARDLY_ANY));
        }
    } else if pass.emission.aims && tracer.sources.have_choices() {
        let mut learnt = SurfaceTracer { sources: tracer.sources.clone(), importance: None, ..tracer };
        let origins = || found.origins.iter();
        learnt.sources.even_out(&origins().map(|&((source, _), power)| (source, power)).collect::<Vec<_>>());
        learnt.sources.learn(&origins().filter_map(|&((_, aim), power)| Some((aim?, power))).collect::<Vec<_>>());
        let with = pilot(&learnt);
        if evenly(&with.photons) > BETTER * evenly(&found.photons) {
            (tracer, found) = (learnt, with);
        }
    }
    tracer.notes = false;

    budget.settle()?;

    // How many, so that the map holds what it should.
    let richer = if pass.control.is_some() { RICHER } else { 1 };
    let traced = pass.target.saturating_mul(richer);
    let most_emitted = traced.saturating_mul(MOST_EMISSIONS).min(pass.max_emitted);
    let share = found.photons.len() as f64 / pilots as f64;
    let wanted = traced.saturating_mul(pilots) / found.photons.len() as u64;
    let mut planned = wanted.clamp(1, most_emitted.max(1));
    if each > LONG {
        planned = planned.max(budget::fewest(LEAST_OF_LONG, each)).min(pass.max_emitted);
        tracer.keep = (traced as f64 / (planned as f64 * share)).min(1.0);
    }
    let part = (most as f64 / (planned as f64 * share * tracer.keep)).min(1.0);
    let emitted = (planned as f64 * part).ceil() as u64;
    let purpose = match pass.kind {
        Kind::Caustic => Purpose::Caustic,
        Kind::Global => Purpose::Global,
    };
    let budget = Budget::of_pass(traced);
    budget.allow(planned, each)?;
    let tracer = SurfaceTracer { budget: &budget, ..tracer };
    let mut landed = tracer.run(purpose, emitted, progress, stop);
    (landed.planned, landed.events, landed.aimed) = (planned, each, tracer.sources.are_aimed());
    budget.settle()?;
    let scale = (1.0 / landed.emitted.max(1) as f64) as f32;
    landed.photons.par_iter_mut().for_each(|photon| photon.power *= scale);
    if pass.tells_scattered {
        let photon = |index: &u32| landed.photons[*index as usize];
        landed.scattered = landed.scattered_ones.iter().step_by(ONE_IN).map(photon).collect();
    }
    if let Some(tagged) = pass.control {
        let target = (pass.target as f64 * part).ceil() as u64;
        landed.photons = hand_over(landed.photons, target, Filled::Surfaces, tagged);
    }
    Ok(landed)
}

/// How many photons of even power are as good, (Σ Φ)²/Σ Φ².
fn evenly(photons: &[Photon]) -> f64 {
    let powers = || photons.iter().map(|photon| f64::from(photon.power.element_sum()));
    powers().sum::<f64>().powi(2) / powers().map(|power| power * power).sum::<f64>().max(f64::MIN_POSITIVE)
}

/// What all of them share.
struct SurfaceTracer<'s> {
    scene: &'s Scene,
    pass: &'s SurfacePass<'s>,
    sources: Sources<'s>,
    /// How important places are, if photons are kept by that.
    importance: Option<Importance>,
    /// Whether it is noted where photons started.
    notes: bool,
    /// The share of what lands that is kept.
    keep: f64,
    /// What that may cost.
    budget: &'s Budget,
}

impl<'s> SurfaceTracer<'s> {
    fn run(
        &self,
        purpose: Purpose,
        emitted: u64,
        progress: &(impl Fn(u64, u64) + Sync),
        stop: &(impl Fn() -> bool + Sync),
    ) -> Landed {
        let stop = &|| stop() || self.budget.is_spent();
        let emit = |photon, found: &mut Landed, parts: &mut Parts<'s, Remembered>| {
            let mut stream = self.pass.emission.stream(self.pass.seed, purpose, photon, self.pass.index);
            self.emit(&mut stream, found, parts, stop);
        };
        let end = |found: &mut Landed, _: &mut Parts<'s, Remembered>, count| {
            found.emitted = count;
            found.bill.settle(self.budget, found.photons.len());
            progress(count, emitted);
        };
        let mut all = Landed::default();
        for chunk in in_chunks(0..emitted, stop, emit, end) {
            all.emitted += chunk.emitted;
            let before = all.photons.len() as u32;
            all.scattered_ones.extend(chunk.scattered_ones.iter().map(|index| before + index));
            all.exchanged += chunk.exchanged;
            all.origins.extend(chunk.origins);
            all.tally = all.tally.merge(chunk.tally);
            all.photons.extend(chunk.photons);
        }
        all
    }

    fn emit(
        &self,
        stream: &mut Stream,
        found: &mut Landed,
        parts: &mut Parts<'s, Remembered>,
        stop: &(dyn Fn() -> bool + Sync),
    ) {
        let Some(Start { ray, power, inside, from_light, source, aim }) = self.sources.start(stream) else { return };
        if !power.is_finite() {
            found.tally.broken += 1;
            return;
        }
        let own = Remembered { history: History::new(from_light), from_surface: false, ahead: Ahead::default() };
        let start =
            Part { walk: Walk::start(self.scene, ray, inside), luggage: Luggage::new(power, own), collision: None };
        let origin = self.notes.then_some((source, aim));
        travel(&mut Landing { tracer: self, found, stream, stop, origin }, start, parts);
    }
}

/// What such a photon remembers.
#[derive(Clone, Copy, Debug)]
struct Remembered {
    history: History,
    /// Whether it was scattered by a surface, and by no medium since.
    from_surface: bool,
    ahead: Ahead,
}

/// A photon on its way.
struct Landing<'f, 's> {
    tracer: &'f SurfaceTracer<'s>,
    found: &'f mut Landed,
    stream: &'f mut Stream,
    /// Whether to break off.
    stop: &'f (dyn Fn() -> bool + Sync),
    /// Where it started, if that is noted.
    origin: Option<Origin>,
}

impl<'s> Traveller<'s> for Landing<'_, 's> {
    type Own = Remembered;

    fn scene(&self) -> &'s Scene {
        self.tracer.scene
    }

    fn stream(&mut self) -> &mut Stream {
        self.stream
    }

    fn farthest(&mut self, medium: u32, _: &Ray, luggage: &mut Luggage<Remembered>) -> f64 {
        let medium = &self.tracer.scene.media[medium as usize];
        luggage.own.ahead.draw(medium, luggage.weight, self.stream)
    }

    fn segment(
        &mut self,
        segment: &Segment<'_>,
        luggage: &mut Luggage<Remembered>,
        _: &mut Parts<'s, Remembered>,
    ) -> ControlFlow<f64> {
        let medium = &self.tracer.scene.media[segment.medium as usize];
        let (range, weight) = ((segment.a, segment.b), &mut luggage.weight);
        let collision =
            luggage.own.ahead.collide(medium, segment.ray, range, weight, self.stream, &mut self.found.tally);
        collision.map_or(ControlFlow::Continue(()), ControlFlow::Break)
    }

    fn turn(
        &mut self,
        at: Vertex<'_>,
        _: &Walk<'s>,
        luggage: &mut Luggage<Remembered>,
        _: &mut Parts<'s, Remembered>,
    ) -> Option<Heading> {
        // What a medium scatters is no caustic.
        let SurfacePass { kind, max_events, .. } = *self.tracer.pass;
        let mut left_out = false;
        if let Vertex::Surface(surface) = at {
            left_out = luggage.own.history.is_left_out(surface);
            let stores = !left_out && (kind == Kind::Global || luggage.own.history.is_caustic());
            if stores && at.nature() == Nature::Diffuse && at.albedo().max_element() > 0.0 {
                self.deposit(surface, luggage);
            }
        } else if kind == Kind::Caustic {
            return None;
        }

        // On.
        let onward = at.onward(Side::Light, None, &mut luggage.weight, self.stream, survive)?;
        let event = at.event(&onward);
        luggage.events += 1;
        self.found.bill.add(self.tracer.budget, self.found.photons.len());
        luggage.own.history = luggage.own.history.after(event, &at);
        if event == Event::Scattered {
            luggage.own.from_surface = at.surface().is_some();
        }
        let is_useless = match kind {
            Kind::Caustic => luggage.own.history.ends_caustics(),
            Kind::Global => left_out && event == Event::Scattered,
        };
        let goes_on = !is_useless && max_events.allows(luggage.events);
        goes_on.then_some(Heading { direction: onward.direction })
    }

    fn breaks_off(&mut self) -> bool {
        (self.stop)()
    }

    fn stopped(&mut self) {
        self.found.tally.stopped += 1;
    }
}

impl Landing<'_, '_> {
    /// Stores what lands: on Lambertian surfaces as the shading normal sees it, |i·s|/|i·g| of the power that the surface gets.
    fn deposit(&mut self, at: &Interaction, luggage: &Luggage<Remembered>) {
        let mut power = luggage.weight;
        let mut share = self.tracer.keep;
        if let Some(importance) = &self.tracer.importance {
            share *= importance.keep(at.point.as_vec3());
        }
        if share < 1.0 {
            if self.stream.uniform() >= share {
                return;
            }
            power /= share;
        }
        if luggage.own.history.is_scattered() {
            self.found.scattered_ones.push(self.found.photons.len() as u32);
        }
        self.found.exchanged += u64::from(luggage.own.from_surface);
        self.found.origins.extend(self.origin.map(|origin| (origin, luggage.weight.element_sum())));
        let Incidence { direction, normal, shading_normal, .. } = at.incidence;
        let seen = direction.dot(shading_normal).min(0.0) / direction.dot(normal).min(-f64::MIN_POSITIVE);
        let seen = if at.bsdf.lambertian().is_some() { seen } else { 1.0 };
        self.found.photons.push(Photon {
            position: at.point.as_vec3(),
            direction: direction.as_vec3(),
            power: (power * seen).as_vec3(),
            events: luggage.events.min(255) as u8,
            normal: PackedNormal::new(normal),
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene;
    use crate::scene::description::PhotonEmission;
    use std::f64::consts::PI;

    fn landed(text: &str, kind: Kind) -> Landed {
        emitted(text, kind, Emission::default())
    }

    fn emitted(text: &str, kind: Kind, emission: Emission) -> Landed {
        let (scene, _) = scene::from_text(text);
        let max_events = Events::unlimited();
        let pass = SurfacePass {
            kind,
            seed: 5,
            index: 0,
            target: 40_000,
            max_emitted: 1 << 30,
            emission,
            max_events,
            needs_exchange: false,
            tells_scattered: false,
            importons: None,
            control: None,
        };
        assert!(may_land(&scene, kind));
        trace_surfaces(&scene, &pass, &|_, _| {}, &|| false).unwrap()
    }

    fn power(caustics: &Landed) -> f64 {
        caustics.photons.iter().map(|photon| f64::from(photon.power.x)).sum()
    }

    /// A mirror sends on what it gets of a lamp, all of which lands on the walls around: the solid angle of a disc under 45°, a
    /// seventh of the sphere. Aimed photons learn where it is, and bring it with about equal power each; a pane that only lets light pass
    /// sends nothing but what it mirrors.
    #[test]
    fn caustics_carry_the_light_that_is_bent() {
        let room = |shape: &str| {
            format!(
                "[camera]\nposition = [0, 0, 3]\ntarget = [0, 0, 0]\n[materials.wall]\ntype = \"lambert\"\n\
                 [materials.silver]\ntype = \"mirror\"\nreflectance = 0.8\n[materials.pane]\ntype = \"thin_dielectric\"\n\
                 [[shapes]]\ntype = \"sphere\"\ncenter = [0, 0, 0]\nradius = 5\nmaterial = \"wall\"\n\
                 [[lights]]\ntype = \"point\"\nposition = [0, 1, 0]\nintensity = 3\n[[shapes]]\n{shape}"
            )
        };
        let disc = |material: &str| {
            format!("type = \"disk\"\ncenter = [0, 0, 0]\nnormal = [0, 1, 0]\nradius = 1\nmaterial = \"{material}\"\n")
        };
        let caustics = landed(&room(&disc("silver")), Kind::Caustic);
        let expected = 3.0 * 2.0 * PI * (1.0 - 0.5f64.sqrt()) * 0.8;
        assert!((power(&caustics) / expected - 1.0).abs() < 0.01, "{}, not {expected}", power(&caustics));
        let share = caustics.photons.len() as f64 / caustics.emitted as f64;
        let even = evenly(&caustics.photons) / caustics.photons.len() as f64;
        assert!(share > 0.5 && even > 0.8, "{share} land, worth {even} of as many");

        // The same light without aiming, of which as few land as the mirror is small, all alike.
        for by in [PhotonEmission::Qmc, PhotonEmission::Random] {
            let bare = emitted(&room(&disc("silver")), Kind::Caustic, Emission { aims: false, by });
            assert!((power(&bare) / expected - 1.0).abs() < 0.03, "{}, not {expected}", power(&bare));
            let share = bare.photons.len() as f64 / bare.emitted as f64;
            let even = evenly(&bare.photons) / bare.photons.len() as f64;
            assert!(share < 0.2 && even > 0.999, "{share} land, worth {even} of as many");
        }

        // By a narrow lobe as much, but for what goes from facet to facet.
        let rough =
            room(&disc("silver")).replace("\"mirror\"\nreflectance = 0.8", "\"conductor\"\nf0 = 0.8\nroughness = 0.1");
        let found = power(&landed(&rough, Kind::Caustic));
        assert!((found / expected - 1.0).abs() < 0.01, "{found}, not {expected}");

        // A strong lamp far away beside it, of whose light little comes to the mirror.
        let lamp = "[[lights]]\ntype = \"point\"\nposition = [0, 4.5, 0]\nintensity = 30\n";
        let caustics = landed(&(room(&disc("silver")) + lamp), Kind::Caustic);
        let expected = expected + 30.0 * 2.0 * PI * (1.0 - 4.5 / 4.5f64.hypot(1.0)) * 0.8;
        assert!((power(&caustics) / expected - 1.0).abs() < 0.01, "{}, not {expected}", power(&caustics));
        let even = evenly(&caustics.photons) / caustics.photons.len() as f64;
        assert!(even > 0.6, "worth {even} of as many");

        // R = 2F/(1 + F) of a pane, averaged over the disc's solid angle.
        let mirrored = |cos: f64| {
            let once = crate::surface::fresnel(cos, 1.0, 1.5);
            2.0 * once / (1.0 + once)
        };
        const N: usize = 1000;
        let cosines = (0..N).map(|i| 0.5f64.sqrt() + (1.0 - 0.5f64.sqrt()) * (i as f64 + 0.5) / N as f64);
        let expected = 3.0 * 2.0 * PI * (1.0 - 0.5f64.sqrt()) * cosines.map(mirrored).sum::<f64>() / N as f64;
        let found = power(&landed(&room(&disc("pane")), Kind::Caustic));
        assert!((found / expected - 1.0).abs() < 0.03, "{found}, not {expected}");
    }

    /// No caustic is looked for where nothing casts one, or nothing receives it, an instance or not.
    #[test]
    fn caustics_that_are_left_out_do_not_land() {
        let scene = |mirror: &str, wall: &str, instance: &str| {
            let text = format!(
                "[camera]\nposition = [0, 0, 3]\ntarget = [0, 0, 0]\n[materials.wall]\ntype = \"lambert\"\n\
                 [materials.silver]\ntype = \"mirror\"\n\
                 [[shapes]]\ntype = \"sphere\"\ncenter = [0, 0, 0]\nradius = 5\nmaterial = \"wall\"\n{wall}\n\
                 [[shapes]]\nname = \"disc\"\ntype = \"disk\"\ncenter = [0, 0, 0]\nnormal = [0, 1, 0]\nradius = 1\n\
                 material = \"silver\"\n{mirror}\n[[shapes]]\ntype = \"instance\"\nof = \"disc\"\n\
                 transform = [{{ translate = [0, 1, 0] }}]\n{instance}\n\
                 [[lights]]\ntype = \"point\"\nposition = [0, 3, 0]\nintensity = 3\n"
            );
            may_land(&scene::from_text(&text).0, Kind::Caustic)
        };
        let (none, no_cast, no_catch) = ("", "casts_caustics = false", "receives_caustics = false");
        assert!(scene(none, none, none) && scene(no_cast, none, "casts_caustics = true"));
        assert!(!scene(no_cast, none, none) && !scene(none, no_catch, none));
    }

    /// On the walls of a closed room of even albedo a, all that a lamp sends lands, and of that again the part a: Φ/(1 − a), fog that
    /// absorbs nothing or not.
    #[test]
    fn all_light_lands() {
        let room = |rest: &str| {
            format!(
                "[camera]\nposition = [0, 0, 1]\ntarget = [0, 0, 0]\n[materials.wall]\ntype = \"lambert\"\nreflectance = 0.6\n\
                 [[shapes]]\ntype = \"box\"\nmin = [-2, -2, -2]\nmax = [2, 2, 2]\nmaterial = \"wall\"\n\
                 [[lights]]\ntype = \"point\"\nposition = [0, 1, 0]\nintensity = 3\n{rest}"
            )
        };
        for rest in ["", "[world]\nmedium = \"fog\"\n[media.fog]\nsigma_s = 0.3\n"] {
            let (found, expected) = (power(&landed(&room(rest), Kind::Global)), 3.0 * 4.0 * PI / 0.4);
            assert!((found / expected - 1.0).abs() < 0.01, "{found}, not {expected}: {rest}");
        }
    }
}
