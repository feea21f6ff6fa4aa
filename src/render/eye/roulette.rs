//! Which paths are worth following: splits, and Russian roulette for paths that matter little.

use super::{Looking, Path};
use crate::math::Rgb;
use crate::scene::Inside;
use crate::surface::Lobe;
use crate::transport::{Interaction, Luggage};

/// Eye paths that something has spread and that carry less than this of a pixel's light are thinned by roulette where photons are gathered; it is also
/// the least that splits at rough boundaries.
const FAINT: f64 = 0.25;

/// Before anything has spread them, paths that carry less than this are thinned. A path that goes on through stone gathers
/// nearly as much behind the first petal as in it: with [`FAINT`], roulette there was two thirds of the squared error of a
/// rose of marble.
const FAINT_SPECULAR: f64 = 0.1;

/// Before anything has spread them, and where nothing scatters, paths that carry less than this are thinned: a ray through
/// clear glass costs little, and what is left to chance there may be a lamp, hundreds of times brighter than what is
/// around it.
const FAINT_CLEAR: f64 = 0.002;

/// Paths that no photons help are thinned below this weight. Roulette at every event instead, by albedo, took 1.7 times
/// the time for the same error in a room of fog of albedo 1/2 and a third more in smoke; between 0.1 and 0.25 the
/// difference is small.
const FAINT_PATH: f64 = 0.15;

/// Where photons are gathered, a path both reflects and refracts at smooth boundaries if the lesser part is more than this
/// of the pixel's light. In a glass of milk, to leave it to chance after the third boundary made nearly half of the squared
/// error, and the mirror image of a lamp in milk and glass was still speckled at a hundredth.
const LESSER: f64 = 0.002;

/// At rough boundaries, and behind diffuse surfaces or where a medium scattered it, a path both reflects and refracts at its first events: so many at most.
const SPLITS: u64 = 3;

/// How much of a pixel's light a path of this weight carries in a medium of this index, at most: radiance is larger there by
/// the square, which it loses on its way out.
fn matters(weight: Rgb, index: Rgb) -> f64 {
    weight.max_element() * index.max_element().powi(2)
}

impl Looking<'_, '_, '_> {
    /// Whether a path reflects *and* refracts, and which is the lesser part as a rule. Else a pixel's samples would see now the
    /// light of a medium, now what its boundary mirrors, which is most of their noise where that light is gathered from
    /// photons. Paths that collide by chance are noisier than that.
    pub(super) fn splits(&self, luggage: &Luggage<Path>, at: &Interaction) -> Option<Lobe> {
        if !self.eye.has_photons() {
            return None;
        }
        let boundary = at.bsdf.boundary(&at.incidence)?;
        let (weight, from) = (luggage.weight, boundary.from);
        match boundary.reflected {
            Some(reflected) if !luggage.own.is_spread() => {
                let [back, through] = [reflected, Rgb::ONE - reflected].map(|part| matters(weight * part, from));
                let lesser = if back < through { Lobe::Reflected } else { Lobe::Refracted };
                (back.min(through) > LESSER).then_some(lesser)
            }
            _ => (luggage.events <= SPLITS && matters(weight, from) >= FAINT).then_some(Lobe::Reflected),
        }
    }

    /// Whether a path follows what a smooth coat or a sheet mirrors apart from what the base sends or the sheet lets pass, which is the lobe
    /// that is left then. The mirror's part was rarely drawn, and counted many times over.
    pub(super) fn splits_coat(&self, luggage: &Luggage<Path>, at: &Interaction) -> Option<Lobe> {
        if !self.eye.has_photons() || luggage.own.is_spread() {
            return None;
        }
        let (_, factor) = at.bsdf.mirrored(&at.incidence)?;
        (matters(luggage.weight * factor, Rgb::ONE) > LESSER).then_some(Lobe::Refracted)
    }

    /// Roulette for paths that matter little: survivors carry the weight of the others. Of a path that is a `share` of those in one's place, all
    /// that they carry counts: else gather rays would end at once, the sooner the more there are.
    pub(super) fn outlives(&mut self, weight: &mut Rgb, (share, spread): (f64, bool), inside: &Inside) -> bool {
        let scene = self.eye.scene;
        let chance = if self.eye.has_photons() {
            let gathers = || scene.medium(inside).is_some_and(|medium| scene.media[medium as usize].scatters());
            let faint = match spread {
                true => FAINT,
                false if gathers() => FAINT_SPECULAR,
                false => FAINT_CLEAR,
            };
            matters(*weight / share, scene.index(inside)) / faint
        } else {
            weight.max_element() / (FAINT_PATH * share)
        };
        if chance >= 1.0 {
            return true;
        }
        *weight /= chance;
        self.context.stream.uniform() < chance
    }
}
