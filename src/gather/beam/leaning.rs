//! Discs beside walls: what a wall cuts off them, and discs that lean on one.

use super::frame::RayLanes;
use crate::photon::discs::WallLayer;
use crate::photon::kernel::Profile;
use crate::photon::simd::{Lanes, dot_plus, load3};

/// Discs are not turned farther towards the ray than to this ν·ω, so that none counts more than twenty times.
const LEAST_ALONG: f32 = 0.05;

/// (H/r)² up to which a ray's end is on a wall.
const ON_WALL: f32 = 0.0625;

/// A wall in the ray's frame: its normal, that along u and v, and the height of the foot points above its plane.
#[inline(always)]
fn in_frame<L: Lanes>(wall: &WallLayer, ray: &RayLanes<L>, a: L, b: L) -> ([L; 3], [L; 2], L) {
    let zero = L::splat(0.0);
    let normal = load3::<L>(&wall.normal);
    let (nu, nv) = (dot_plus(&normal, &ray.u, zero), dot_plus(&normal, &ray.v, zero));
    let height = b.neg_mul_add(nv, a.neg_mul_add(nu, L::load(&wall.distance)));
    (normal, [nu, nv], height)
}

/// The share of each disc on the photon's side of its wall, and whether the foot point is there too.
/// `a` and `b` are the photon's coordinates across the ray: the foot point is x − a u − b v.
#[inline(always)]
pub(super) fn beside_wall_across<L: Lanes>(
    profile: Profile,
    wall: &WallLayer,
    ray: &RayLanes<L>,
    a: L,
    b: L,
    inverse_square: L,
) -> (L, L::Mask) {
    let (_, [nu, nv], height) = in_frame(wall, ray, a, b);
    // The wall cuts the disc's plane in a line at height/sin θ; it never does if the ray is normal to it.
    let sin2 = nu.mul_add(nu, nv.mul(nv)).max(L::splat(f32::MIN_POSITIVE));
    let s2 = height.mul(height).mul(inverse_square).div(sin2);
    (profile.disc_share_lanes(s2), L::splat(0.0).less(height))
}

/// Discs that lie along a wall, and others across the ray, of one block.
///
/// A photon may be spread over any disc around it: with the unit normal ν of the disc, the ray meets its plane at
/// t = tᵢ + δ, at the distance √(ρ² + δ²) from the photon, and per length of the ray there are 1/(ν·ω) times as many
/// discs. With ν the wall's normal, light is blended with light at the same depth below the surface only, where it
/// changes little; across the ray, it is blended with light at depths r sin θ apart.
///
/// A wall that is curved leaves its plane before it comes to the ray. Where the ray's start (or its end, if it goes
/// towards the wall) is off the plane by H, less than a quarter of the radius, it stands for the wall: the depth is
/// counted from there, which adds H/(ν·ω) to t. Else the ray comes through another wall, and discs lie across it.
pub(super) struct Leaning<L> {
    /// ν across the ray, and along it.
    across: [L; 2],
    along: L,
    /// δ.
    pub(super) shift: L,
    /// 1/(ν·ω).
    pub(super) stretch: L,
}

impl<L: Lanes> Leaning<L> {
    /// The photons of `bits` lean on their `wall`.
    #[inline(always)]
    pub(super) fn new(wall: &WallLayer, bits: u16, ray: &RayLanes<L>, [t, a, b]: [L; 3], inverse_square: L) -> Self {
        let (zero, one) = (L::splat(0.0), L::splat(1.0));
        let (normal, [nu, nv], foot) = in_frame(wall, ray, a, b);
        let along = dot_plus(&normal, &ray.omega, zero);
        let sign = one.select(zero.less_equal(along), L::splat(-1.0));
        // The end of the ray that may be on the wall, and how high above the wall's plane it is.
        let end = zero.select(zero.less(sign), ray.length).sub(t);
        let height = end.mul_add(along, foot);
        let mask = L::mask(bits & L::bits(height.mul(height).mul(inverse_square).less(L::splat(ON_WALL))));
        let along = along.mul(sign);
        let least = L::splat(LEAST_ALONG);
        // What is left across the ray where ν·ω is raised to its least.
        let rest = along.neg_mul_add(along, one).max(L::splat(f32::MIN_POSITIVE));
        let scale = one.min(least.neg_mul_add(least, one).div(rest).sqrt()).mul(sign);
        let across = [nu.mul(scale).keep(mask), nv.mul(scale).keep(mask)];
        let along = along.max(least).select(mask, one);
        let stretch = one.div(along);
        let lift = height.mul(sign).keep(mask);
        let shift = a.mul_add(across[0], b.mul_add(across[1], lift)).mul(stretch);
        Leaning { across, along, shift, stretch }
    }

    /// The share of each disc on the photon's side of a wall, and whether the point where the ray meets the disc is there too.
    /// `a` and `b` are the photon's coordinates across the ray. The disc's plane is not across the ray, as in [`beside_wall_across`].
    #[inline(always)]
    pub(super) fn beside_wall(
        &self,
        profile: Profile,
        wall: &WallLayer,
        ray: &RayLanes<L>,
        a: L,
        b: L,
        inverse_square: L,
    ) -> (L, L::Mask) {
        let zero = L::splat(0.0);
        let (normal, [nu, nv], foot) = in_frame(wall, ray, a, b);
        let nw = dot_plus(&normal, &ray.omega, zero);
        let height = self.shift.mul_add(nw, foot);
        let cos = nw.mul_add(self.along, nu.mul_add(self.across[0], nv.mul(self.across[1])));
        let sin2 = cos.neg_mul_add(cos, L::splat(1.0)).max(L::splat(1e-6));
        let s2 = height.mul(height).mul(inverse_square).div(sin2);
        (profile.disc_share_lanes(s2), zero.less(height))
    }
}
