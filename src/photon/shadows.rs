//! Shadow photons (Jensen and Christensen 1995; Jensen 2001, §11.5): from a light straight on through all that is in the way. What
//! they land on first is lit by that light, what they land on beyond is in shadow.
//!
//! They carry no power: only how many landed where tells anything.

use std::convert::Infallible;
use std::ops::ControlFlow;

use rayon::prelude::*;

use super::emission::{Emission, Sources, Start};
use super::surfaces::spreads;
use super::tracer::in_chunks;
use crate::light::Light;
use crate::math::random::Purpose;
use crate::math::{Bounds, Stream, Vec3};
use crate::scene::Scene;
use crate::surface::Nature;
use crate::transport::{Segment, Stop, Visitor, Walk, pass_by_chance};

/// What a place gets of a light.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Sight {
    /// All of it.
    Lit,
    /// What media, or mixtures with holes, let pass.
    Veiled,
    /// Nothing.
    Dark,
}

/// A photon where it landed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ShadowPhoton {
    /// The place.
    pub position: Vec3,
    /// The normal of the surface, on the side that faces the light.
    pub normal: Vec3,
    /// The light that it comes from.
    pub light: u32,
    /// What it says of the place.
    pub sight: Sight,
}

/// What a pass of shadow photons is asked for.
#[derive(Clone, Copy, Debug)]
pub struct ShadowPass {
    /// The user's seed.
    pub seed: u64,
    /// The number of the pass: each draws photons of its own.
    pub index: u64,
    /// About how many photons should land on what they meet first.
    pub target: u64,
    /// How they are emitted.
    pub emission: Emission,
    /// They are of use in this box alone.
    pub seen: Bounds,
}

/// What it found.
#[derive(Debug, Default)]
pub struct Shadows {
    /// Photons, one for each surface on their way.
    pub photons: Vec<ShadowPhoton>,
    /// Photons emitted.
    pub emitted: u64,
}

/// The share of the power of all that can be served that a light has to have: of others too few photons would land anywhere.
const LEAST_SHARE: f64 = 0.01;
/// Emissions of the pilot that tells how many land, and whether they are to be aimed.
const PILOT: u64 = 1 << 12;
/// They are where fewer land than this share of those emitted.
const STRAY: f64 = 0.25;
/// No more emissions than so many for each photon that is wanted.
const MOST_EMISSIONS: u64 = 4;
/// A photon lands so many times at most.
const MOST_LANDINGS: u32 = 64;

/// The lights that shadow photons can serve: those with a shadow to be found, which is none that shines from all around, and a large
/// share of the power.
pub fn served_lights(scene: &Scene) -> Vec<u32> {
    let power = |light: &Light| match light {
        Light::Environment(_) => 0.0,
        _ => light.power(&scene.surroundings).element_sum(),
    };
    let least = LEAST_SHARE * scene.lights.iter().map(power).sum::<f64>();
    (0..).zip(&scene.lights).filter(|(_, light)| power(light) > 0.0 && power(light) >= least).map(|(i, _)| i).collect()
}

/// Traces shadow photons. `stop` ends it early.
pub fn trace_shadows(scene: &Scene, pass: &ShadowPass, stop: &(impl Fn() -> bool + Sync)) -> Shadows {
    let mut tracer = ShadowTracer { scene, pass, sources: Sources::of_some_lights(scene, &served_lights(scene)) };
    if tracer.sources.is_empty() {
        return Shadows::default();
    }
    let pilot = |tracer: &ShadowTracer<'_>| {
        let photons = tracer.run(Purpose::Pilot, PILOT, stop);
        photons.iter().filter(|photon| photon.sight != Sight::Dark).count() as u64
    };
    let mut landed = pilot(&tracer);
    if pass.emission.aims && (landed as f64) < STRAY * PILOT as f64 {
        let sources = tracer.sources.clone();
        tracer.sources.aim_at_surfaces(|surface| scene.any_part(&surface.material, &spreads), 1);
        let aimed = pilot(&tracer);
        if aimed > landed {
            landed = aimed;
        } else {
            tracer.sources = sources;
        }
    }
    let emitted = (pass.target * PILOT / landed.max(1)).min(pass.target * MOST_EMISSIONS);
    Shadows { photons: tracer.run(Purpose::Shadow, emitted, stop), emitted }
}

struct ShadowTracer<'s> {
    scene: &'s Scene,
    pass: &'s ShadowPass,
    sources: Sources<'s>,
}

impl ShadowTracer<'_> {
    fn run(&self, purpose: Purpose, emitted: u64, stop: &(impl Fn() -> bool + Sync)) -> Vec<ShadowPhoton> {
        let emit = |photon, found: &mut Vec<ShadowPhoton>, (): &mut ()| {
            self.emit(&mut self.pass.emission.stream(self.pass.seed, purpose, photon, self.pass.index), found);
        };
        in_chunks(0..emitted, stop, emit, |_, _, _| {}).into_par_iter().flatten_iter().collect()
    }

    fn emit(&self, stream: &mut Stream, found: &mut Vec<ShadowPhoton>) {
        let Some(Start { ray, inside, source: light, .. }) = self.sources.start(stream) else { return };
        if self.pass.seen.clip(&ray, 0.0, f64::INFINITY).is_none() {
            return;
        }
        let mut walk = Walk::start(self.scene, ray, inside);
        let mut way = Way { scene: self.scene, stream, sight: Sight::Lit, leaks: false };
        for _ in 0..MOST_LANDINGS {
            let Stop::Surface(at) = walk.advance(&mut way) else { return };
            let asks = at.bsdf.nature() != Nature::Specular && at.bsdf.albedo(&at.incidence).max_element() > 0.0;
            if asks && self.pass.seen.contains(at.point) {
                let normal = at.incidence.normal.as_vec3();
                found.push(ShadowPhoton { position: at.point.as_vec3(), normal, light, sight: way.sight });
            }
            // Beyond what leaks, there may be some light.
            way.leaks |= at.bsdf.is_sheet();
            way.sight = way.sight.max(if std::mem::take(&mut way.leaks) { Sight::Veiled } else { Sight::Dark });
            let straight_on = walk.ray.direction;
            walk.leave(&at, straight_on);
        }
    }
}

/// What a photon knows of its way.
struct Way<'w> {
    scene: &'w Scene,
    stream: &'w mut Stream,
    /// Of where it is.
    sight: Sight,
    /// Whether the mixture that keeps it lets others pass.
    leaks: bool,
}

impl Visitor for Way<'_> {
    type End = Infallible;

    fn segment(&mut self, segment: &Segment<'_>) -> ControlFlow<Infallible> {
        if segment.b > segment.a && !self.scene.media[segment.medium as usize].is_clear() {
            self.sight = self.sight.max(Sight::Veiled);
        }
        ControlFlow::Continue(())
    }

    fn mixture(&mut self, passes: f64, sheets: bool) -> Option<f64> {
        let kept = pass_by_chance(passes, self.stream);
        match kept {
            None if passes < 1.0 => self.sight = self.sight.max(Sight::Veiled),
            None => {}
            Some(_) => self.leaks |= passes > 0.0 || sheets,
        }
        kept
    }
}
