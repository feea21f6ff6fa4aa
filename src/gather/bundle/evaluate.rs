//! What the photons near a bundle contribute to the rays of one group.

#![allow(
    clippy::needless_range_loop,
    reason = "iterators' closures need not be inlined into a kernel's instruction set"
)]

use super::group::{Group, Vector};
use super::photons::{Collected, Lists, PhotonLanes, Shifted};
use super::rays::Bundle;
use crate::gather::beam::exponents;
use crate::gather::gathered::GatherStats;
use crate::gather::phase::Evaluate;
use crate::gather::sampled::VECTORS;
use crate::photon::kernel::inverse_biweight_share;
use crate::photon::simd::{LANES, Lanes, Row, Task, dot_plus, splat3};

/// Where rays of a vector meet fewer of the photons than this share, each vector gets a list.
const SPARSE: f32 = 0.7;

/// Takes photons near the bundle to a group's frame, and evaluates them there.
pub(super) struct Shift<'a, P> {
    pub(super) bundle: &'a Bundle<'a>,
    pub(super) phase: P,
    pub(super) near: &'a Collected,
    pub(super) kind: usize,
    pub(super) group: &'a mut Group,
    pub(super) plain: &'a mut Shifted,
    pub(super) careful: &'a mut Shifted,
    pub(super) lists: &'a mut Lists,
    pub(super) stats: &'a mut GatherStats,
}

impl<P: Evaluate> Task for Shift<'_, P> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self) {
        let Shift { bundle, phase, near, kind, group, plain, careful, lists, stats } = self;
        let (walls, part) = (kind / 2, kind % 2);
        let axes = [splat3::<L>(group.axes[0]), splat3(group.axes[1]), splat3(group.axes[2])];
        let offset = splat3::<L>(group.offset);
        let zero = L::splat(0.0);
        let around = group.around.lanes::<L>();
        let (any_start, any_end) = (L::splat(group.any[0]), L::splat(group.any[1]));
        let (all_start, all_end) = (L::splat(group.all[0]), L::splat(group.all[1]));
        // |z| of a foot point deviates from that of its photon by the radius times the slope.
        let slope = L::splat(group.around.steepest() + 1e-5);
        let start = L::splat(group.zero);
        let sigma = bundle.extinction;
        let exponents = exponents(sigma);
        let tabulated = group.table.is_some();
        let grey = exponents[0] == exponents[1] && exponents[0] == exponents[2];
        // Tables know how transmittance varies from ray to ray.
        let thirds = L::splat(if tabulated { 0.0 } else { sigma.element_sum() * (2.0 / 9.0) });
        plain.len = 0;
        careful.len = 0;
        for at in (0..near.len).step_by(LANES) {
            // Where photons lie in the group's frame, and whether any ray may meet them.
            let (x, inverse_square) = (near.position::<L>(at), near.inverse_square::<L>(at));
            let a = dot_plus(&x, &axes[0], offset[0]);
            let b = dot_plus(&x, &axes[1], offset[1]);
            let z = dot_plus(&x, &axes[2], offset[2]);
            let r = inverse_square.rsqrt();
            let between = L::and(any_start.less(z.add(r)), z.sub(r).less(any_end));
            let between = L::and(between, z.less_equal(L::splat(group.pruned.end)));
            let valid = u16::MAX >> (LANES - (near.len - at).min(LANES));
            let hit = L::bits(L::and(around.meets(a, b, z, r), between)) & valid;
            if hit == 0 {
                continue;
            }

            // The phase function and the transmittance along the group's axis.
            let direction = near.direction::<L>(at);
            let d = [
                dot_plus(&direction, &axes[0], zero),
                dot_plus(&direction, &axes[1], zero),
                dot_plus(&direction, &axes[2], zero),
            ];
            let (value, kappa) = phase.near_axis(&d);
            // What lies farther before the start has its foot point there too, and counts nothing, however bright.
            let margin = r.mul(slope);
            let depth = z.sub(start).max(zero.sub(margin));
            let weights = if tabulated {
                [value; 3]
            } else {
                let lift = z.mul_add(L::splat(group.pruned.lift[1]), L::splat(group.pruned.lift[0])).max(zero);
                if grey {
                    [value.mul(depth.mul_add(L::splat(exponents[0]), lift).exp2()); 3]
                } else {
                    [
                        value.mul(depth.mul_add(L::splat(exponents[0]), lift).exp2()),
                        value.mul(depth.mul_add(L::splat(exponents[1]), lift).exp2()),
                        value.mul(depth.mul_add(L::splat(exponents[2]), lift).exp2()),
                    ]
                }
            };

            // How both change with the slope of a ray.
            let power = near.power::<L>(at);
            let photons = PhotonLanes {
                position: [a, b, z],
                inverse_square,
                change: [
                    a.mul_add(thirds, kappa.mul(d[0])),
                    b.mul_add(thirds, kappa.mul(d[1])),
                    z.mul_add(thirds, kappa.mul(d[2])),
                ],
                power: [power[0].mul(weights[0]), power[1].mul(weights[1]), power[2].mul(weights[2])],
            };

            // Photons between the ends of all rays and near no wall.
            let inside = L::bits(L::and(all_start.less(z.sub(margin)), z.add(margin).less(all_end)));
            let safe = if walls == 0 { hit & inside } else { 0 };
            if safe != 0 {
                plain.write(&photons, safe);
                if let Some(table) = &group.table {
                    plain.write_knot(table.place(z), safe);
                }
                if plain.advance(safe) {
                    evaluate::<L, P>(plain, group, part, lists, stats);
                }
            }

            // Photons near a wall or an end.
            let careful_ones = hit & !safe;
            if careful_ones != 0 {
                careful.write(&photons, careful_ones);
                careful.write_inverse_radius(inverse_square.mul(r), careful_ones);
                if let Some(table) = &group.table {
                    careful.write_knot(table.place(z), careful_ones);
                }
                for wall in 0..walls {
                    let (normal, distance) = near.wall::<L>(wall, at);
                    let turned = [
                        dot_plus(&normal, &axes[0], zero),
                        dot_plus(&normal, &axes[1], zero),
                        dot_plus(&normal, &axes[2], zero),
                    ];
                    careful.write_wall(wall, &turned, distance, careful_ones);
                }
                if careful.advance(careful_ones) {
                    evaluate_carefully::<L, P>(careful, walls, group, part, lists, stats);
                }
            }
        }
        evaluate::<L, P>(plain, group, part, lists, stats);
        evaluate_carefully::<L, P>(careful, walls, group, part, lists, stats);
    }
}

/// One ray vector, loaded.
#[derive(Clone, Copy)]
struct Rays<L> {
    offset: [L; 2],
    slope: [L; 2],
    bend: L,
}

impl Vector {
    #[inline(always)]
    fn load<L: Lanes>(&self) -> Rays<L> {
        Rays {
            offset: [L::load(&self.offset[0]), L::load(&self.offset[1])],
            slope: [L::load(&self.slope[0]), L::load(&self.slope[1])],
            bend: L::load(&self.bend),
        }
    }
}

/// (1 + d)^{−3/2} to fourth order.
#[inline(always)]
fn series<L: Lanes>(d: L) -> L {
    let p = L::splat(2.460_937_5).mul_add(d, L::splat(-2.1875));
    let p = p.mul_add(d, L::splat(1.875));
    let p = p.mul_add(d, L::splat(-1.5));
    p.mul_add(d, L::splat(1.0))
}

impl<L: Lanes> Rays<L> {
    /// The photon's offset from the rays.
    #[inline(always)]
    fn aside<const PINHOLE: bool>(&self, photon: &PhotonLanes<L>) -> [L; 2] {
        let [a, b, z] = photon.position;
        if PINHOLE {
            [z.neg_mul_add(self.slope[0], a), z.neg_mul_add(self.slope[1], b)]
        } else {
            [z.neg_mul_add(self.slope[0], a.sub(self.offset[0])), z.neg_mul_add(self.slope[1], b.sub(self.offset[1]))]
        }
    }

    /// 1 − ρ²/r², 0 outside of the disc.
    #[inline(always)]
    fn inside(&self, aside: &[L; 2], photon: &PhotonLanes<L>) -> L {
        let square = aside[0].mul_add(aside[0], aside[1].mul(aside[1]));
        square.neg_mul_add(photon.inverse_square, L::splat(1.0)).max(L::splat(0.0))
    }

    /// [`Rays::inside`] with what it leaves out: of the offset, what lies along the ray.
    #[inline(always)]
    fn inside_closely(&self, aside: &[L; 2], photon: &PhotonLanes<L>) -> L {
        let along = aside[0].mul_add(self.slope[0], aside[1].mul(self.slope[1]));
        let square = aside[0].mul_add(aside[0], aside[1].mul(aside[1]));
        let square = along.neg_mul_add(along, square);
        square.neg_mul_add(photon.inverse_square, L::splat(1.0)).max(L::splat(0.0))
    }

    /// The kernel's shape times how phase function and transmittance vary.
    #[inline(always)]
    fn weight<P: Evaluate>(&self, q: L, photon: &PhotonLanes<L>) -> L {
        let [x, y, z] = photon.change;
        let d = x.mul_add(self.slope[0], y.mul_add(self.slope[1], z.mul(self.bend)));
        let varied = if P::EVEN { d.mul_add(L::splat(-1.5), L::splat(1.0)) } else { series(d) };
        q.mul(q).mul(varied)
    }
}

#[inline(always)]
fn accumulate<L: Lanes>(sums: &mut [L; 3], weight: L, photon: &PhotonLanes<L>) {
    for channel in 0..3 {
        sums[channel] = weight.mul_add(photon.power[channel], sums[channel]);
    }
}

/// Adds a photon's power to the sums of a vector of rays, times `weight` and the transmittance on its way, which the
/// group's table knows in `TABLE` channels; with none, `weight` alone counts.
#[inline(always)]
fn accumulate_passed<L: Lanes, const TABLE: usize>(
    sums: &mut [L; 3],
    weight: L,
    (group, vector, place): (&Group, usize, f32),
    photon: &PhotonLanes<L>,
) {
    match &group.table {
        Some(table) if TABLE == 1 => {
            let [passed] = table.at::<L, 1>(vector, place);
            accumulate(sums, weight.mul(passed), photon);
        }
        Some(table) if TABLE == 3 => {
            let passed = table.at::<L, 3>(vector, place);
            for channel in 0..3 {
                sums[channel] = weight.mul(passed[channel]).mul_add(photon.power[channel], sums[channel]);
            }
        }
        _ => accumulate(sums, weight, photon),
    }
}

#[inline(always)]
fn add_to_rows<L: Lanes>(rows: &mut [Row; 3], sums: &[L; 3]) {
    for channel in 0..3 {
        L::load(&rows[channel]).add(sums[channel]).store(&mut rows[channel]);
    }
}

/// Lists which photons each vector may meet. Returns their numbers.
#[inline(always)]
fn list<L: Lanes>(photons: &Shifted, group: &Group, lists: &mut Lists) -> [usize; VECTORS] {
    let mut counts = [0; VECTORS];
    for (vector, list) in lists.iter_mut().enumerate().take(group.vectors()) {
        let around = group.near[vector].lanes::<L>();
        let mut count = 0;
        for at in (0..photons.len).step_by(LANES) {
            let ([a, b, z], inverse_square) = photons.discs::<L>(at);
            let hit = L::bits(around.meets(a, b, z, inverse_square.rsqrt()));
            let hit = hit & u16::MAX >> (LANES - (photons.len - at).min(LANES));
            let mut indices = [at as u32; LANES];
            for (lane, index) in indices.iter_mut().enumerate() {
                *index += lane as u32;
            }
            if let Some(out) = list[count..].first_chunk_mut() {
                L::compress_indices(&indices, hit, out);
                count += hit.count_ones() as usize;
            }
        }
        counts[vector] = count;
    }
    counts
}

/// Adds what shifted photons contribute, those that lie between the ends of all rays and near no wall.
#[inline(always)]
fn evaluate<L: Lanes, P: Evaluate>(
    photons: &mut Shifted,
    group: &mut Group,
    part: usize,
    lists: &mut Lists,
    stats: &mut GatherStats,
) {
    if photons.len == 0 {
        return;
    }
    let counts = list::<L>(photons, group, lists);
    let listed: usize = counts.iter().sum();
    let dense = group.vectors() == VECTORS && listed as f32 >= SPARSE * (VECTORS * photons.len) as f32;
    let channels = group.table.as_ref().map_or(0, |table| table.channels);
    let (tested, met) = match (dense, group.pinhole, channels) {
        (true, true, 0) if !group.wide => evaluate_dense::<L, P, true, false, 0>(photons, group, part),
        (true, true, 1) if !group.wide => evaluate_dense::<L, P, true, false, 1>(photons, group, part),
        (true, true, 0) => evaluate_dense::<L, P, true, true, 0>(photons, group, part),
        (true, true, 1) => evaluate_dense::<L, P, true, true, 1>(photons, group, part),
        (true, false, 0) => evaluate_dense::<L, P, false, true, 0>(photons, group, part),
        (true, false, 1) => evaluate_dense::<L, P, false, true, 1>(photons, group, part),
        (true, _, _) => evaluate_dense::<L, P, false, true, 3>(photons, group, part),
        (false, true, 0) => evaluate_listed::<L, P, true, 0>(photons, group, part, lists, &counts),
        (false, true, 1) => evaluate_listed::<L, P, true, 1>(photons, group, part, lists, &counts),
        (false, false, 0) => evaluate_listed::<L, P, false, 0>(photons, group, part, lists, &counts),
        (false, false, 1) => evaluate_listed::<L, P, false, 1>(photons, group, part, lists, &counts),
        (false, _, _) => evaluate_listed::<L, P, false, 3>(photons, group, part, lists, &counts),
    };
    stats.blocks += tested;
    stats.photons += met;
    photons.len = 0;
}

#[inline(always)]
fn evaluate_dense<L: Lanes, P: Evaluate, const PINHOLE: bool, const CLOSELY: bool, const TABLE: usize>(
    photons: &Shifted,
    group: &mut Group,
    part: usize,
) -> (u64, u64) {
    let mut met = 0;
    // Two vectors at a time: their sums and all that is needed for them fit into 32 registers.
    for pair in (0..VECTORS).step_by(2) {
        let rays = [group.rays[pair].load::<L>(), group.rays[pair + 1].load::<L>()];
        let mut sums = [[L::splat(0.0); 3]; 2];
        for index in 0..photons.len {
            let photon = photons.photon::<L>(index);
            for vector in 0..2 {
                let aside = rays[vector].aside::<PINHOLE>(&photon);
                let q = if CLOSELY {
                    rays[vector].inside_closely(&aside, &photon)
                } else {
                    rays[vector].inside(&aside, &photon)
                };
                let weight = rays[vector].weight::<P>(q, &photon);
                let passed = (&*group, pair + vector, photons.knot::<TABLE>(index));
                accumulate_passed::<L, TABLE>(&mut sums[vector], weight, passed, &photon);
                met += u64::from(L::bits(L::splat(0.0).less(q)).count_ones());
            }
        }
        for vector in 0..2 {
            add_to_rows(&mut group.sums[part][pair + vector], &sums[vector]);
        }
    }
    ((VECTORS * photons.len) as u64, met)
}

#[inline(always)]
fn evaluate_listed<L: Lanes, P: Evaluate, const PINHOLE: bool, const TABLE: usize>(
    photons: &Shifted,
    group: &mut Group,
    part: usize,
    lists: &Lists,
    counts: &[usize; VECTORS],
) -> (u64, u64) {
    let (mut tested, mut met) = (0, 0);
    for vector in 0..group.vectors() {
        let rays = group.rays[vector].load::<L>();
        let mut sums = [L::splat(0.0); 3];
        for &index in &lists[vector][..counts[vector]] {
            let photon = photons.photon::<L>(index as usize);
            let aside = rays.aside::<PINHOLE>(&photon);
            let q = rays.inside_closely(&aside, &photon);
            let weight = rays.weight::<P>(q, &photon);
            let passed = (&*group, vector, photons.knot::<TABLE>(index as usize));
            accumulate_passed::<L, TABLE>(&mut sums, weight, passed, &photon);
            met += u64::from(L::bits(L::splat(0.0).less(q)).count_ones());
        }
        tested += counts[vector] as u64;
        add_to_rows(&mut group.sums[part][vector], &sums);
    }
    (tested, met)
}

/// Adds what shifted photons contribute that lie near walls or near an end of a ray: each ray's ends are tested,
/// and walls cut discs.
#[inline(always)]
fn evaluate_carefully<L: Lanes, P: Evaluate>(
    photons: &mut Shifted,
    walls: usize,
    group: &mut Group,
    part: usize,
    lists: &mut Lists,
    stats: &mut GatherStats,
) {
    if photons.len == 0 {
        return;
    }
    let counts = list::<L>(photons, group, lists);
    let zero = L::splat(0.0);
    let mut met = 0;
    for vector in 0..group.vectors() {
        let rays = group.rays[vector].load::<L>();
        let (start, end) = (L::load(&group.rays[vector].start), L::load(&group.rays[vector].end));
        let mut sums = [zero; 3];
        for &index in &lists[vector][..counts[vector]] {
            let index = index as usize;
            let photon = photons.photon::<L>(index);
            let aside = rays.aside::<false>(&photon);
            let q = rays.inside_closely(&aside, &photon);
            // The foot point lies nearer to where the ray leans.
            let foot = aside[0].mul_add(rays.slope[0], aside[1].mul_add(rays.slope[1], photon.position[2]));
            let mut mask = L::and(zero.less(q), L::and(start.less(foot), foot.less(end)));
            let mut weight = rays.weight::<P>(q, &photon);
            let inverse = photons.inverse_radius::<L>(index);
            for wall in 0..walls {
                // The normal across the ray; the foot point's height; the disc's distance from the wall.
                let (normal, distance) = photons.wall::<L>(wall, index);
                let x = normal[2].neg_mul_add(rays.slope[0], normal[0]);
                let y = normal[2].neg_mul_add(rays.slope[1], normal[1]);
                let height = y.neg_mul_add(aside[1], x.neg_mul_add(aside[0], distance));
                let sin2 = x.mul_add(x, y.mul(y)).max(L::splat(f32::MIN_POSITIVE));
                let s = height.mul(inverse).mul(sin2.rsqrt());
                weight = weight.mul(inverse_biweight_share(s));
                mask = L::and(mask, zero.less(height));
            }
            let weight = weight.keep(mask);
            match group.table.as_ref().map(|table| table.channels) {
                None => accumulate(&mut sums, weight, &photon),
                Some(1) => {
                    let passed = (&*group, vector, photons.knot::<1>(index));
                    accumulate_passed::<L, 1>(&mut sums, weight, passed, &photon);
                }
                Some(_) => {
                    let passed = (&*group, vector, photons.knot::<3>(index));
                    accumulate_passed::<L, 3>(&mut sums, weight, passed, &photon);
                }
            }
            met += u64::from(L::bits(mask).count_ones());
        }
        stats.blocks += counts[vector] as u64;
        add_to_rows(&mut group.sums[part][vector], &sums);
    }
    stats.photons += met;
    photons.len = 0;
}
