//! Photons of caustics: from a light by specular events, one at least, to the first surface that spreads them.
//!
//! They are traced apart from those in media: most light never meets a lens, and photons that are aimed at what bends light are few
//! and all alike, whatever the other maps need.

use std::ops::ControlFlow;

use rayon::prelude::*;

use super::Photon;
use super::emission::{Sources, Start};
use super::history::History;
use super::tracer::in_chunks;
use crate::math::random::Purpose;
use crate::math::{Ray, Stream};
use crate::scene::Scene;
use crate::surface::{Incidence, Material, Nature, Side};
use crate::transport::{
    Ahead, Event, Events, Heading, Interaction, Luggage, Part, Parts, Segment, Tally, Traveller, Vertex, Walk, survive,
    travel,
};

/// What the caustic map is asked for.
#[derive(Clone, Copy, Debug)]
pub struct CausticPass {
    /// The user's seed.
    pub seed: u64,
    /// The number of the pass: each draws photons of its own.
    pub index: u64,
    /// About how many photons the map should hold.
    pub target: u64,
    /// At most this many are emitted.
    pub max_emitted: u64,
    /// How many events light may have on its way to the eye.
    pub max_events: Events,
}

/// What it holds.
#[derive(Debug, Default)]
pub struct Caustics {
    /// The photons, powers divided by the number of emitted photons.
    pub photons: Vec<Photon>,
    /// Photons emitted.
    pub emitted: u64,
    /// Counts of mishaps.
    pub tally: Tally,
}

/// Emissions of the pilot that tells the yield.
const PILOT: u64 = 1 << 13;
/// No more emissions than so many for each photon that is wanted: light that hardly ever meets a lens is no caustic worth
/// more.
const MOST_EMISSIONS: u64 = 16;

/// Where fewer of the pilot's photons land, caustics are left to chance.
const FEWEST: u64 = 8;

/// Whether there may be caustics: something specular among surfaces that spread light, and lights.
pub fn may_be(scene: &Scene) -> bool {
    let spreads = |material: &Material| match material {
        Material::Opaque(bsdf) => {
            bsdf.nature() == Nature::Diffuse && bsdf.albedo(&Incidence::head_on()).max_element() > 0.0
        }
        Material::Dielectric(_) | Material::None | Material::Mixture(_) => false,
    };
    !scene.lights.is_empty()
        && scene.surfaces.iter().any(|surface| scene.any_part(&surface.material, &spreads))
        && scene.surfaces.iter().any(|surface| scene.any_part(&surface.material, &Material::is_partly_specular))
}

/// Traces the photons of caustics. `progress` is told how many emissions were done since it was last told, and how many there are to
/// be; `stop` ends the pass early. Nothing is emitted where hardly any would land.
pub fn trace_caustics(
    scene: &Scene,
    pass: &CausticPass,
    progress: &(impl Fn(u64, u64) + Sync),
    stop: &(impl Fn() -> bool + Sync),
) -> Caustics {
    let mut tracer = CausticTracer { scene, pass, sources: Sources::of_lights(scene) };
    if tracer.sources.is_empty() {
        return Caustics::default();
    }

    // Aimed or not, whichever of the two lands more.
    let pilot = |tracer: &CausticTracer<'_>| tracer.run(Purpose::Pilot, PILOT, &|_, _| {}, stop).photons.len() as u64;
    let bare = pilot(&tracer);
    tracer.sources.aim_at_specular();
    let mut stored = pilot(&tracer);
    if bare > stored {
        tracer.sources = Sources::of_lights(scene);
        stored = bare;
    }

    if stored < FEWEST {
        return Caustics::default();
    }

    let most = pass.target.saturating_mul(MOST_EMISSIONS).min(pass.max_emitted);
    let wanted = pass.target.saturating_mul(PILOT) / stored;
    let emitted = wanted.clamp(1, most.max(1));
    let mut caustics = tracer.run(Purpose::Caustic, emitted, progress, stop);
    let scale = (1.0 / caustics.emitted.max(1) as f64) as f32;
    caustics.photons.par_iter_mut().for_each(|photon| photon.power *= scale);
    caustics
}

/// What all of them share.
struct CausticTracer<'s> {
    scene: &'s Scene,
    pass: &'s CausticPass,
    sources: Sources<'s>,
}

impl<'s> CausticTracer<'s> {
    fn run(
        &self,
        purpose: Purpose,
        emitted: u64,
        progress: &(impl Fn(u64, u64) + Sync),
        stop: &(impl Fn() -> bool + Sync),
    ) -> Caustics {
        let emit = |photon, found: &mut Caustics, parts: &mut Parts<'s, Bent>| {
            let mut stream = Stream::new(self.pass.seed, purpose, photon, self.pass.index);
            self.emit(&mut stream, found, parts);
        };
        let end = |found: &mut Caustics, count| {
            found.emitted = count;
            progress(count, emitted);
        };
        let mut all = Caustics::default();
        for chunk in in_chunks(0..emitted, stop, emit, end) {
            all.emitted += chunk.emitted;
            all.tally = all.tally.merge(chunk.tally);
            all.photons.extend(chunk.photons);
        }
        all
    }

    fn emit(&self, stream: &mut Stream, found: &mut Caustics, parts: &mut Parts<'s, Bent>) {
        let Some(Start { ray, power, inside, .. }) = self.sources.start(stream) else { return };
        if !power.is_finite() {
            found.tally.broken += 1;
            return;
        }
        let own = Bent { history: History::new(true), ahead: Ahead::default() };
        let start =
            Part { walk: Walk::start(self.scene, ray, inside), luggage: Luggage::new(power, own), collision: None };
        travel(&mut Bending { tracer: self, found, stream }, start, parts);
    }
}

/// What such a photon remembers.
#[derive(Clone, Copy, Debug)]
struct Bent {
    history: History,
    ahead: Ahead,
}

/// A photon on its way by specular events.
struct Bending<'f, 's> {
    tracer: &'f CausticTracer<'s>,
    found: &'f mut Caustics,
    stream: &'f mut Stream,
}

impl<'s> Traveller<'s> for Bending<'_, 's> {
    type Own = Bent;

    fn scene(&self) -> &'s Scene {
        self.tracer.scene
    }

    fn stream(&mut self) -> &mut Stream {
        self.stream
    }

    fn farthest(&mut self, medium: u32, _: &Ray, luggage: &mut Luggage<Bent>) -> f64 {
        let medium = &self.tracer.scene.media[medium as usize];
        luggage.own.ahead.draw(medium, luggage.weight, self.stream)
    }

    fn segment(
        &mut self,
        segment: &Segment<'_>,
        luggage: &mut Luggage<Bent>,
        _: &mut Parts<'s, Bent>,
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
        luggage: &mut Luggage<Bent>,
        _: &mut Parts<'s, Bent>,
    ) -> Option<Heading> {
        // What a medium scatters is no caustic.
        let Vertex::Surface(surface) = at else { return None };
        let caustic = luggage.own.history.is_caustic();
        if caustic && at.nature() == Nature::Diffuse && at.albedo().max_element() > 0.0 {
            self.deposit(surface, luggage);
        }
        let onward = at.onward(Side::Light, None, &mut luggage.weight, self.stream, survive)?;
        let event = surface.event(&onward);
        luggage.events += 1;
        luggage.own.history = luggage.own.history.after(event);
        let goes_on = event != Event::Scattered && self.tracer.pass.max_events.allows(luggage.events);
        goes_on.then_some(Heading { direction: onward.direction, clearance: None })
    }

    fn stopped(&mut self) {
        self.found.tally.stopped += 1;
    }
}

impl Bending<'_, '_> {
    /// Stores what lands.
    fn deposit(&mut self, at: &Interaction, luggage: &Luggage<Bent>) {
        self.found.photons.push(Photon {
            position: at.point.as_vec3(),
            direction: at.incidence.direction.as_vec3(),
            power: luggage.weight.as_vec3(),
            events: luggage.events.min(255) as u8,
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene;
    use std::f64::consts::PI;

    fn landed(text: &str) -> Caustics {
        let (scene, _) = scene::from_text(text);
        let pass =
            CausticPass { seed: 5, index: 0, target: 40_000, max_emitted: 1 << 30, max_events: Events::unlimited() };
        assert!(may_be(&scene));
        trace_caustics(&scene, &pass, &|_, _| {}, &|| false)
    }

    fn power(caustics: &Caustics) -> f64 {
        caustics.photons.iter().map(|photon| f64::from(photon.power.x)).sum()
    }

    /// A mirror sends on what it gets of a lamp, all of which lands on the walls around: the solid angle of a disc under 45°. Aimed
    /// photons bring it with equal power each, and a pane that only lets light pass sends nothing but what it mirrors.
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
        let caustics = landed(&room(&disc("silver")));
        let expected = 3.0 * 2.0 * PI * (1.0 - 0.5f64.sqrt()) * 0.8;
        assert!((power(&caustics) / expected - 1.0).abs() < 0.01, "{}, not {expected}", power(&caustics));
        let powers = caustics.photons.iter().map(|photon| photon.power.x);
        let (least, most) = powers.fold((f32::MAX, 0f32), |(a, b), power| (a.min(power), b.max(power)));
        assert!(most < 1.001 * least, "{least} to {most}");

        // R = 2F/(1 + F) of a pane, averaged over the disc's solid angle.
        let mirrored = |cos: f64| {
            let once = crate::surface::fresnel(cos, 1.0, 1.5);
            2.0 * once / (1.0 + once)
        };
        const N: usize = 1000;
        let cosines = (0..N).map(|i| 0.5f64.sqrt() + (1.0 - 0.5f64.sqrt()) * (i as f64 + 0.5) / N as f64);
        let expected = 3.0 * 2.0 * PI * (1.0 - 0.5f64.sqrt()) * cosines.map(mirrored).sum::<f64>() / N as f64;
        let found = power(&landed(&room(&disc("pane"))));
        assert!((found / expected - 1.0).abs() < 0.03, "{found}, not {expected}");
    }
}
