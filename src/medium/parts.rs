//! Media that fill the same space, where what they do with light differs from place to place.

use smallvec::SmallVec;

use super::{Medium, Phases};
use crate::math::{DAffine3, DVec3, Rgb, Stream, choose};

/// Media that fill the same space, each with its own density: together they scatter, turn and emit light as each of them would.
#[derive(Clone, Debug)]
pub struct Parts(Vec<Medium>);

/// A part of all scattering at a place.
struct Share<'a> {
    medium: &'a Medium,
    /// Its share of σ_s, by channel.
    by_channel: Rgb,
    /// The chance with which it is chosen: the mean over the channels that scatter.
    chance: f64,
}

impl Parts {
    /// Of at least one medium.
    pub(crate) fn new(media: Vec<Medium>) -> Self {
        Parts(media)
    }

    /// The media.
    pub fn media(&self) -> &[Medium] {
        &self.0
    }

    pub(super) fn moved(&self, transform: DAffine3) -> Self {
        Parts(self.0.iter().map(|medium| medium.moved(transform)).collect())
    }

    /// Σ σ_s,i ρ_i / Σ σ_t,i ρ_i at the point `p`, by channel; 0 of nothing.
    pub(super) fn albedo(&self, p: DVec3) -> Rgb {
        let (mut scattering, mut extinction) = (Rgb::ZERO, Rgb::ZERO);
        for medium in &self.0 {
            let own = medium.extinction * medium.density.at(p);
            extinction += own;
            scattering += own * medium.albedo_at(p);
        }
        share(scattering, extinction).min(Rgb::ONE)
    }

    /// The least and the most that the albedo may be, by channel: between those of the parts that have extinction there.
    pub(super) fn albedo_range(&self) -> (Rgb, Rgb) {
        let (mut least, mut most) = (Rgb::ONE, Rgb::ZERO);
        for medium in &self.0 {
            let (own, exists) = (medium.albedo.range(), medium.extinction.cmpgt(Rgb::ZERO));
            least = Rgb::select(exists, least.min(own.0), least);
            most = Rgb::select(exists, most.max(own.1), most);
        }
        (least.min(most), most)
    }

    /// Σ σ_a,i L_e,i ρ_i at the point `p`: radiance per length.
    pub(super) fn emitted(&self, p: DVec3) -> Rgb {
        self.0.iter().filter(|medium| medium.glows()).map(|medium| medium.emitted_at(p)).sum()
    }

    /// The greatest |g| of a Henyey–Greenstein function that light is turned by: see [`Parts::kept`].
    pub(super) fn greatest_cosine(&self) -> f64 {
        let sharpest = |medium: &Medium| match &medium.phase {
            Phases::Even(phase) => phase.lobes().into_iter().flatten().map(|(_, g)| g.abs()).fold(0.0, f64::max),
            phases => phases.greatest_cosine(),
        };
        self.0.iter().filter(|medium| medium.scatters()).map(sharpest).fold(0.0, f64::max)
    }

    /// The parts that scatter at the point `p`; where none does, the first alone.
    fn shares(&self, p: DVec3) -> SmallVec<[Share<'_>; 4]> {
        let scattering = |medium: &Medium| medium.extinction * medium.albedo_at(p) * medium.density.at(p);
        let mut shares: SmallVec<[Share<'_>; 4]> = SmallVec::new();
        let mut whole = Rgb::ZERO;
        for medium in &self.0 {
            let by_channel = scattering(medium);
            if by_channel.max_element() > 0.0 {
                whole += by_channel;
                shares.push(Share { medium, by_channel, chance: 0.0 });
            }
        }
        let channels = whole.to_array().into_iter().filter(|&whole| whole > 0.0).count() as f64;
        for part in &mut shares {
            part.by_channel = share(part.by_channel, whole);
            part.chance = part.by_channel.element_sum() / channels;
        }
        if shares.is_empty() {
            shares.extend(self.0.first().map(|medium| Share { medium, by_channel: Rgb::ONE, chance: 1.0 }));
        }
        shares
    }

    /// See [`Phases::value`].
    pub(super) fn phase(&self, p: DVec3, before: DVec3, after: DVec3) -> (Rgb, f64) {
        let (mut value, mut density) = (Rgb::ZERO, 0.0);
        for Share { medium, by_channel, chance } in self.shares(p) {
            let (own, drawn) = medium.phase.value(p, before, after);
            value += by_channel * own;
            density += chance * drawn;
        }
        (value, density)
    }

    /// See [`Phases::sample`].
    pub(super) fn sample(&self, p: DVec3, before: DVec3, weight: &mut Rgb, stream: &mut Stream) -> (DVec3, f64) {
        let (direction, _) = match choose_of(&self.shares(p), stream) {
            Some(part) => part.medium.phase.sample(p, before, &mut Rgb::splat(1.0), stream),
            None => (before, 0.0),
        };
        let (value, density) = self.phase(p, before, direction);
        if density > 0.0 {
            *weight *= value / density;
        }
        (direction, density)
    }

    /// See [`Phases::kept`]: by one of the Henyey–Greenstein functions that light is turned by here, drawn by chance.
    pub(super) fn kept(&self, p: DVec3, direction: DVec3, stream: &mut Stream) -> (DVec3, Rgb) {
        let shares = self.shares(p);
        let Some(part) = choose_of(&shares, stream) else { return (DVec3::ZERO, Rgb::ONE) };
        let factor = part.by_channel / part.chance;
        let lobes = part.medium.phase.even().and_then(|phase| phase.lobes());
        match lobes {
            None => {
                let (direction, own) = part.medium.phase.kept(p, direction, stream);
                (direction, factor * own)
            }
            Some(lobes) => {
                let chosen = choose(lobes.iter().map(|lobe| lobe.0), 1.0, stream.uniform());
                let g = chosen.map_or(0.0, |choice| lobes[choice.index].1);
                let (direction, own) = super::field::scaled(direction, g);
                (direction, factor * own)
            }
        }
    }
}

fn choose_of<'s, 'a>(shares: &'s [Share<'a>], stream: &mut Stream) -> Option<&'s Share<'a>> {
    choose(shares.iter().map(|part| part.chance), 1.0, stream.uniform()).map(|choice| &shares[choice.index])
}

/// A part of a whole, by channel; 0 of nothing.
pub(crate) fn share(part: Rgb, whole: Rgb) -> Rgb {
    Rgb::select(whole.cmpgt(Rgb::ZERO), part / whole, Rgb::ZERO)
}
