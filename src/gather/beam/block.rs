//! What the photons of one block contribute to a ray.

use super::frame::RayLanes;
use super::leaning::{Leaning, beside_wall_across};
use super::transmittance::{Pruning, Transmit};
use crate::gather::confined::Confined;
use crate::gather::phase::Evaluate;
use crate::photon::discs::PhotonMap;
use crate::photon::simd::{Lanes, at_most, dot_plus, load3};

/// Sums in lanes, and how many photons there are in them, counted in a register.
pub(in crate::gather) struct Found<L> {
    pub(in crate::gather) total: [L; 3],
    pub(in crate::gather) single: [L; 3],
    pub(in crate::gather) photons: u64,
}

impl<L: Lanes> Found<L> {
    #[inline(always)]
    pub(in crate::gather) fn none() -> Self {
        Found { total: [L::splat(0.0); 3], single: [L::splat(0.0); 3], photons: 0 }
    }
}

/// The mean density around a ray is taken to be no less than this share of that around a photon.
const LEAST_DENSITY: f32 = 0.25;

/// Adds what the photons of a block contribute to a ray: of each whose foot point lies on the ray and whose disc the ray
/// meets,
///
/// > K₂(ρ/r)/r² · p(d → −ω) · T(t) · P,
///
/// with the photon's distance ρ from the ray, its direction d and power P, and the transmittance T to its foot point at t.
/// The kernel is K₂(ρ/r) = K₂(0) · (c₀ + c₁q + c₂q²) with q = 1 − ρ²/r², and the block's power is K₂(0) P/r² already; of
/// the phase function p, [`Evaluate::constant`] is left out. Beside walls the kernel is divided by the share of it that
/// they leave, and where light follows the density, what a photon counts is multiplied by the density on the ray over its
/// mean across the disc. Where photons tell the fluence, that density is a factor of T. A disc that leans on a wall is met at another t and another ρ, and counts 1/(ν·ω) times: see
/// [`Leaning`]. Photons of more than `max_events` events do not count, and what hardly passes is left to chance by `pruning`.
/// To `single` go the photons without events.
#[inline(always)]
pub(in crate::gather) fn add_block<L: Lanes>(
    map: &PhotonMap,
    index: usize,
    ray: &RayLanes<L>,
    phase: &impl Evaluate,
    transmittance: &impl Transmit,
    (max_events, pruning, confined): (u8, Pruning, Option<&Confined>),
    found: &mut Found<L>,
) {
    // The ray's frame: t of the foot point, and q, above 0 where the ray meets the disc.
    let block = map.blocks.get(index);
    let x = load3::<L>(block.position);
    let mut t = dot_plus(&x, &ray.omega, ray.offset[0]);
    let a = dot_plus(&x, &ray.u, ray.offset[1]);
    let b = dot_plus(&x, &ray.v, ray.offset[2]);
    let inverse_square = L::load(block.inverse_square);
    let mut q = a.mul_add(a, b.mul(b)).neg_mul_add(inverse_square, L::splat(1.0));
    let zero = L::splat(0.0);

    // Discs that lean on a wall: the ray meets them at another t and another distance.
    let mut leaning = None;
    // Not left to `leaning`: where that is none, what it would hold is multiplied by all the same, and thrown away, and
    // whatever lies there may be denormal, which takes a hundred times as long.
    let mut stretch = L::splat(1.0);
    if let Some(&bits) = map.leaning.get(index)
        && bits != 0
    {
        let disc = Leaning::new(&map.walls(index)[0], bits, ray, [t, a, b], inverse_square);
        t = t.add(disc.shift);
        q = disc.shift.mul(disc.shift).neg_mul_add(inverse_square, q);
        stretch = disc.stretch;
        leaning = Some(disc);
    }

    // Discs that are met, between the ends of the ray.
    let mut mask = L::and(zero.less(q), L::and(zero.less(t), t.less(ray.length)));
    let mut bits = L::bits(mask);
    if bits == 0 {
        return;
    }

    // The kernel's shape c₀ + c₁q + c₂q², and the phase function p.
    let [c0, c1, c2] = map.shape;
    let shape = q.mul_add(q.mul_add(L::splat(c2), L::splat(c1)), L::splat(c0));
    let mut factor = shape.mul(phase.values(&block.direction.map_or([zero; 3], load3))).mul(stretch);

    // Walls: the kernel by the share of it that they leave; nothing from beyond them.
    let walls = if confined.is_none() { map.walls(index) } else { &[] };
    for wall in walls {
        let (share, near) = match &leaning {
            None => beside_wall_across(map.profile, wall, ray, a, b, inverse_square),
            Some(disc) => disc.beside_wall(map.profile, wall, ray, a, b, inverse_square),
        };
        factor = factor.div(share);
        mask = L::and(mask, near);
        bits = L::bits(mask);
    }

    // Solids that discs may be as wide as: likewise.
    if let Some(confined) = confined {
        factor = factor.div(confined.share(map.profile, (t, bits), inverse_square));
        mask = L::and(mask, confined.within.contains(&x));
        bits = L::bits(mask);
    }

    // Photons of too many events.
    if let Some(events) = map.events.get(index)
        && max_events < u8::MAX
    {
        bits &= at_most(events, max_events);
        mask = L::mask(bits);
    }
    found.photons += u64::from(bits.count_ones());

    // Light that follows the density: by the density on the ray over its mean across the disc.
    if let Some(mean) = map.densities.get(index)
        && let Some(density) = transmittance.density(t, bits)
    {
        let normal = load3::<L>(&mean.normal);
        let (nu, nv) = (dot_plus(&normal, &ray.u, zero), dot_plus(&normal, &ray.v, zero));
        let here = L::load(&mean.distance);
        let mut around = b.neg_mul_add(nv, a.neg_mul_add(nu, here));
        if let Some(disc) = &leaning {
            around = disc.shift.mul_add(dot_plus(&normal, &ray.omega, zero), around);
        }
        factor = factor.mul(density.div(around.max(here.mul(L::splat(LEAST_DENSITY)))));
    }

    // Transmittance T, with roulette where it is small; the power; the sums.
    let weights = transmittance.weigh(factor, t, bits, pruning);
    let power: [L; 3] = block.power.map(L::load);
    for channel in 0..3 {
        found.total[channel] = weights[channel].keep(mask).mul_add(power[channel], found.total[channel]);
    }
    if let Some(events) = map.events.get(index) {
        let first = L::mask(bits & at_most(events, 0));
        for channel in 0..3 {
            found.single[channel] = weights[channel].keep(first).mul_add(power[channel], found.single[channel]);
        }
    }
}
