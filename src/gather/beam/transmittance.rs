//! What is left of light on its way along a ray, and how far a query goes where that is little.

use crate::gather::depth::DepthTable;
use crate::math::random::mix;
use crate::math::{DVec3, Vec3};
use crate::photon::simd::Lanes;
use std::f64::consts::LOG2_E;

/// Russian roulette by transmittance: where less than the share F = [`FAINTEST`] of light arrives from, in its
/// brightest channel, a query goes on with the chance P = T/F, and what it finds there counts 1/P times. One number
/// u decides for the whole ray: it ends where T = F u, and all beyond is neither visited nor evaluated. Right on
/// average over u.
#[derive(Clone, Copy, Debug)]
pub(in crate::gather) struct Pruning {
    /// log₂ F.
    pub(in crate::gather) faintest: f32,
    /// log₂ F u.
    pub(in crate::gather) last: f32,
}

/// Light of a smaller share is left to roulette. The larger it is, the sooner queries end, and the noisier are lights
/// seen through dense media.
const FAINTEST: f32 = 1e-4;

impl Pruning {
    pub(in crate::gather) fn new(u: Option<f32>) -> Self {
        match u {
            Some(u) => Pruning { faintest: FAINTEST.log2(), last: (FAINTEST * u).log2() },
            None => Pruning { faintest: f32::NEG_INFINITY, last: f32::NEG_INFINITY },
        }
    }

    /// The density integrated up to the end, at these −σ log₂e.
    pub(in crate::gather) fn depth(&self, exponents: [f32; 3]) -> f32 {
        let brightest = exponents.into_iter().fold(f32::NEG_INFINITY, f32::max);
        if brightest < 0.0 { self.last / brightest } else { f32::INFINITY }
    }

    /// A number for a ray, as good as random, from its direction.
    pub(in crate::gather) fn number(direction: DVec3) -> f32 {
        let bits = direction.to_array().into_iter().fold(0, |hash, x| mix(hash ^ x.to_bits()));
        ((bits >> 40) + 1) as f32 * (1.0 / (1u64 << 24) as f32)
    }
}

/// −σ log₂e, by channel.
pub(in crate::gather) fn exponents(extinction: Vec3) -> [f32; 3] {
    (extinction.as_dvec3() * -LOG2_E).as_vec3().to_array()
}

/// Transmittance from the segment's start, times a factor, for each channel.
pub(in crate::gather) trait Transmit: Copy {
    /// The same, one type for all kinds.
    fn any(&self) -> AnyTransmittance<'_>;

    /// Lanes outside of `bits` may be anything.
    fn weigh<L: Lanes>(&self, factor: L, t: L, bits: u16, pruning: Pruning) -> [L; 3];

    /// The density, where it varies: whatever it is outside of `bits`.
    #[inline(always)]
    fn density<L: Lanes>(&self, _t: L, _bits: u16) -> Option<L> {
        None
    }
}

/// A homogeneous medium with the same extinction in every channel: −σ log₂e.
#[derive(Clone, Copy)]
pub(in crate::gather) struct Grey(pub(in crate::gather) f32);

impl Transmit for Grey {
    fn any(&self) -> AnyTransmittance<'_> {
        AnyTransmittance::Grey(*self)
    }

    #[inline(always)]
    fn weigh<L: Lanes>(&self, factor: L, t: L, _: u16, pruning: Pruning) -> [L; 3] {
        let exponent = t.mul(L::splat(self.0));
        let kept = factor.keep(L::splat(pruning.last).less(exponent));
        [kept.mul(exponent.max(L::splat(pruning.faintest)).exp2()); 3]
    }
}

/// A homogeneous medium.
#[derive(Clone, Copy)]
pub(in crate::gather) struct Coloured(pub(in crate::gather) [f32; 3]);

impl Transmit for Coloured {
    fn any(&self) -> AnyTransmittance<'_> {
        AnyTransmittance::Coloured(*self)
    }

    #[inline(always)]
    fn weigh<L: Lanes>(&self, factor: L, t: L, _: u16, pruning: Pruning) -> [L; 3] {
        let [x, y, z] = [t.mul(L::splat(self.0[0])), t.mul(L::splat(self.0[1])), t.mul(L::splat(self.0[2]))];
        let brightest = x.max(y).max(z);
        let lift = L::splat(pruning.faintest).sub(brightest).max(L::splat(0.0));
        let kept = factor.keep(L::splat(pruning.last).less(brightest));
        [kept.mul(x.add(lift).exp2()), kept.mul(y.add(lift).exp2()), kept.mul(z.add(lift).exp2())]
    }
}

/// A heterogeneous medium.
#[derive(Clone, Copy)]
pub(in crate::gather) struct Tabulated<'a> {
    pub(super) table: &'a DepthTable,
    pub(super) exponents: [f32; 3],
    pub(super) grey: bool,
    /// Whether what passes counts in proportion to the density.
    pub(super) fluence: bool,
}

impl Transmit for Tabulated<'_> {
    fn any(&self) -> AnyTransmittance<'_> {
        AnyTransmittance::Tabulated(*self)
    }

    #[inline(always)]
    fn weigh<L: Lanes>(&self, factor: L, t: L, bits: u16, pruning: Pruning) -> [L; 3] {
        let [depth, density] = self.table.look_up(t, bits);
        let factor = if self.fluence { factor.mul(density) } else { factor };
        if self.grey {
            Grey(self.exponents[0]).weigh(factor, depth, bits, pruning)
        } else {
            Coloured(self.exponents).weigh(factor, depth, bits, pruning)
        }
    }

    #[inline(always)]
    fn density<L: Lanes>(&self, t: L, bits: u16) -> Option<L> {
        Some(self.table.look_up(t, bits)[1])
    }
}

/// Transmittance whose kind is looked at where it is needed: for code that is compiled once for all.
#[derive(Clone, Copy)]
pub(in crate::gather) enum AnyTransmittance<'a> {
    Grey(Grey),
    Coloured(Coloured),
    Tabulated(Tabulated<'a>),
}

impl Transmit for AnyTransmittance<'_> {
    fn any(&self) -> AnyTransmittance<'_> {
        *self
    }

    #[inline(always)]
    fn weigh<L: Lanes>(&self, factor: L, t: L, bits: u16, pruning: Pruning) -> [L; 3] {
        match self {
            AnyTransmittance::Grey(medium) => medium.weigh(factor, t, bits, pruning),
            AnyTransmittance::Coloured(medium) => medium.weigh(factor, t, bits, pruning),
            AnyTransmittance::Tabulated(medium) => medium.weigh(factor, t, bits, pruning),
        }
    }

    #[inline(always)]
    fn density<L: Lanes>(&self, t: L, bits: u16) -> Option<L> {
        match self {
            AnyTransmittance::Tabulated(medium) => medium.density(t, bits),
            _ => None,
        }
    }
}
