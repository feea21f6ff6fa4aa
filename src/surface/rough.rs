use super::ggx::{Ggx, MOST_FACETS};
use super::mirror::reflect;
use super::{Dielectric, Incidence, Lobe, Onward, Scattering, Side, reflectance};
use crate::math::{DVec3, Frame, Rgb, Stream};

/// A rough boundary between two indices of refraction, met from one side: mirror-like facets, each of which
/// reflects and refracts by Fresnel's equations, with normals distributed by GGX (Walter, Marschner, Li and
/// Torrance 2007, Eqs. 33–34):
///
/// D(m) = α² / (π ((α² − 1) cos²θ_m + 1)²),  G₁(v) = 2 / (1 + √(1 + α² tan²θ_v)).
///
/// Light that a facet sends onto other facets is followed until it leaves: with the probability G₁ each time it
/// points away from the surface, whatever it did before. What one facet alone sends is so Walter's D G₁(i) G₁(o),
/// and all orders together lose nothing and are reciprocal: every order is a product of 1/((1 + Λ) |cos θ|) for each
/// direction on the way, the same both ways (after Heitz, Hanika, d'Eon and Dachsbacher 2016, with heights that are
/// forgotten from one facet to the next).
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Rough {
    /// The index of refraction on the side of arrival, by channel.
    pub from: Rgb,
    /// The index of refraction beyond the boundary, by channel.
    pub to: Rgb,
    /// α, above 0 and at most 1.
    pub alpha: f64,
}

/// What no facet sends.
const NOTHING: Scattering = Scattering { value: Rgb::ZERO, ahead: Rgb::ZERO };

/// Light on its way between facets, in coordinates whose z points away from the surface on the side where it is.
#[derive(Clone, Copy)]
pub(super) struct Visit {
    pub travel: DVec3,
    from: Rgb,
    to: Rgb,
    /// Whether that is the other side than that of arrival.
    beyond: bool,
    /// What a unit of power that is refracted next counts in the chance for that, against what is reflected: 1 is as it comes.
    pub passing: f64,
}

impl Visit {
    /// Turns directions from the side of arrival into those coordinates, and back.
    pub fn turned(&self, direction: DVec3) -> DVec3 {
        if self.beyond { DVec3::new(direction.x, direction.y, -direction.z) } else { direction }
    }

    /// The chance to be reflected, where the share `reflected` is.
    fn chance(&self, reflected: f64) -> f64 {
        let passing = (1.0 - reflected) * self.passing;
        if self.passing == 1.0 || passing <= 0.0 { reflected } else { reflected / (reflected + passing) }
    }
}

/// Closer indices than this do not bend light: there is no density.
const MATCHED: f64 = 1e-9;

impl Rough {
    /// What facets send along `o`, one part a facet: see [`Bsdf::toward`](super::Bsdf::toward).
    #[allow(clippy::too_many_arguments, reason = "those of `Bsdf::toward`")]
    pub(super) fn toward(
        &self,
        at: &Incidence,
        o: DVec3,
        side: Side,
        both: bool,
        weight: Rgb,
        stream: &mut Stream,
        mut part: impl FnMut(Rgb, Scattering),
    ) {
        let Some(scale) = self.scale(at, o, side) else { return };
        self.facets((at.direction, at.shading_normal), o, both, weight, stream, |weight, sent| {
            part(weight, Scattering { value: scale * sent.value, ..sent });
        });
    }

    /// Draws where facets send light: see [`Bsdf::onward`](super::Bsdf::onward).
    pub(super) fn onward(
        &self,
        at: &Incidence,
        side: Side,
        lobe: Option<Lobe>,
        weight: &mut Rgb,
        stream: &mut Stream,
    ) -> Option<Onward> {
        let (onward, _) = self.sample(at.direction, at.shading_normal, lobe, weight, stream)?;
        *weight *= self.scale(at, onward.direction, side)?;
        Some(onward)
    }

    /// By what power that leaves along `o` is multiplied: Veach's correction for light, and for eyes (η₁/η₂)² if that is through
    /// the boundary. `None` where the normals do not agree which side that is.
    fn scale(&self, at: &Incidence, o: DVec3, side: Side) -> Option<Rgb> {
        let through = o.dot(at.shading_normal) < 0.0;
        let ratio = if through && side == Side::Eye { self.from / self.to } else { Rgb::ONE };
        let agree = through == (o.dot(at.normal) < 0.0);
        agree.then(|| ratio * ratio * at.adjoint(side, at.shading_normal, o))
    }

    /// Draws where light goes on that travels along `direction`, against the unit `normal`, and weights `weight`
    /// for it, as power: refraction does not change it. `lobe` says what the first facet does, or leaves it to chance.
    /// The density is that with which the last facet sends there what came to it as this light did, and was to take the lobe
    /// that was given, if one was; 0 if there is none: then nothing else can find this light. With it comes the number of
    /// facets that were met.
    fn sample(
        &self,
        direction: DVec3,
        normal: DVec3,
        lobe: Option<Lobe>,
        weight: &mut Rgb,
        stream: &mut Stream,
    ) -> Option<(Onward, u32)> {
        let frame = Frame::around(normal);
        let mut visit = self.arrive(frame.to_local(direction));
        for facets in 1..=MOST_FACETS {
            let arriving = visit;
            let lobe = lobe.filter(|_| facets == 1);
            if self.meet(&mut visit, lobe, weight, stream)? {
                let leaving = visit.turned(visit.travel);
                let by_channel = self.sends(&arriving, leaving, lobe.is_some()).ahead;
                // Where the channels part, all but one have no weight; else they have one density.
                let density = (0..3).filter(|&c| weight[c] > 0.0).map(|c| by_channel[c]).fold(0.0, f64::max);
                return Some((Onward { direction: frame.to_world(leaving).normalize(), density }, facets));
            }
        }
        None
    }

    /// Follows light that travels along `direction`, against the unit `normal`, from facet to facet, and tells `sent` its weight
    /// at each and what that facet sends along `leaving`. On average, weights times values are all that goes there; and
    /// a light in that direction may be asked for what [`Rough::sample`] might also find by chance, each weighted by its
    /// facet's density. `both`: it is asked for both lobes of the first facet, one after the other.
    fn facets(
        &self,
        (direction, normal): (DVec3, DVec3),
        leaving: DVec3,
        both: bool,
        mut weight: Rgb,
        stream: &mut Stream,
        mut sent: impl FnMut(Rgb, Scattering),
    ) {
        let frame = Frame::around(normal);
        let leaving = frame.to_local(leaving);
        let mut visit = self.arrive(frame.to_local(direction));
        for facets in 1..=MOST_FACETS {
            sent(weight, self.sends(&visit, leaving, both && facets == 1));
            if self.meet(&mut visit, None, &mut weight, stream) != Some(false) {
                return;
            }
        }
    }

    pub(super) fn arrive(&self, travel: DVec3) -> Visit {
        Visit { travel, from: self.from, to: self.to, beyond: false, passing: 1.0 }
    }

    /// Meets a facet. Returns whether light leaves then, for neither side where `None`.
    pub(super) fn meet(
        &self,
        visit: &mut Visit,
        lobe: Option<Lobe>,
        weight: &mut Rgb,
        stream: &mut Stream,
    ) -> Option<bool> {
        let facet = self.normals().visible(-visit.travel, stream.uniform2());
        let reflected = reflectance(-visit.travel.dot(facet), visit.from, visit.to);
        let lobe = Lobe::take_by(lobe, reflected, |share| visit.chance(share), weight, stream);
        let Visit { travel, from, to, beyond, passing } = visit;
        if lobe == Lobe::Reflected {
            *travel = reflect(*travel, facet);
        } else {
            let channel = Dielectric::channel(*from, *to, weight, stream)?;
            *travel = Dielectric::refract(*travel, facet, from[channel], to[channel])?;
            travel.z = -travel.z;
            (*beyond, *passing) = (!*beyond, 1.0);
            std::mem::swap(from, to);
        }
        Some(travel.z > 0.0 && stream.uniform() < self.normals().unmasked(*travel))
    }

    /// What the next facet sends along `leaving`, which is seen from the side of arrival (Walter et al. 2007, Eqs. 17, 20
    /// and 21). `both`: both lobes are followed. Densities are those of light in which the channels have equal shares:
    /// whoever asks for light and whoever meets it must find the same, whatever weights they bring.
    pub(super) fn sends(&self, visit: &Visit, leaving: DVec3, both: bool) -> Scattering {
        let Visit { from, to, .. } = *visit;
        let (i, o) = (-visit.travel, visit.turned(leaving));
        if o.z == 0.0 {
            return NOTHING;
        }
        // Reflected about the half vector.
        if o.z > 0.0 {
            let Some((density, cos)) = self.normals().reflection(i, o) else { return NOTHING };
            let reflected = reflectance(cos, from, to);
            let chance = if both { 1.0 } else { visit.chance(reflected.element_sum() / 3.0) };
            return Scattering { value: reflected * density, ahead: Rgb::splat(chance * density) };
        }
        // Refracted about a half vector of each channel's own.
        let passes = self.normals().unmasked(o);
        let disperses = Dielectric::disperses(from, to);
        let mut sent = NOTHING;
        for channel in 0..3 {
            let (from, to) = (from[channel], to[channel]);
            if (from - to).abs() < MATCHED {
                continue;
            }
            let Some(half) = (from * i + to * o).try_normalize() else { continue };
            let half = if half.z < 0.0 { -half } else { half };
            let (cos, cos_beyond) = (i.dot(half), o.dot(half));
            if cos <= 0.0 || cos_beyond >= 0.0 {
                continue;
            }
            let bend = to * to * cos_beyond.abs() / (from * cos + to * cos_beyond).powi(2);
            let density = passes * self.normals().visible_density(i, half) * bend;
            if density <= 0.0 || !density.is_finite() {
                continue;
            }
            let reflected = reflectance(cos, visit.from, visit.to);
            let refracted = Rgb::ONE - reflected;
            // Where the channels part, one is drawn.
            let chance = match (disperses, both) {
                (true, true) => refracted[channel] / refracted.element_sum().max(f64::MIN_POSITIVE),
                (true, false) => refracted[channel] / 3.0,
                (false, true) => 1.0,
                (false, false) => 1.0 - visit.chance(reflected[channel]),
            };
            sent.value[channel] = refracted[channel] * density;
            sent.ahead[channel] = chance * density;
        }
        sent
    }

    #[inline]
    fn normals(&self) -> Ggx {
        Ggx::round(self.alpha)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::random::Purpose;
    use std::f64::consts::{PI, TAU};

    fn random(index: u64) -> Stream {
        Stream::new(23, Purpose::Test, index, 0)
    }

    fn slanted(sin: f64) -> DVec3 {
        DVec3::new(0.8 * sin, 0.6 * sin, -(1.0 - sin * sin).sqrt())
    }

    /// What the first facet alone sends.
    fn facet(boundary: &Rough, direction: DVec3, normal: DVec3, leaving: DVec3) -> Scattering {
        let frame = Frame::around(normal);
        let visit = boundary.arrive(frame.to_local(direction));
        boundary.sends(&visit, frame.to_local(leaving), false)
    }

    fn rough(from: f64, to: f64, alpha: f64) -> Rough {
        Rough { from: Rgb::splat(from), to: Rgb::splat(to), alpha }
    }

    /// Single facets against their density by χ², over cells of the sphere; facets beyond the first make up the
    /// rest, and nothing is lost.
    #[test]
    fn sampling_follows_the_density_and_loses_nothing() {
        const N: usize = 400_000;
        const COS: usize = 40;
        const TURN: usize = 24;
        // Cells are halved so often that the density is even in each.
        const FINE: usize = 24;
        for (case, &(from, to, alpha, sin)) in [
            (1.0, 1.5, 0.3, 0.5),
            (1.5, 1.0, 0.3, 0.5),
            (1.5, 1.0, 0.6, 0.9),
            (1.0, 1.3, 1.0, 0.99),
            (1.0, 1.5, 0.5, 0.0),
            (1.0, 1.5, 0.15, 0.95),
            (1.0, 4.0, 0.1, 0.6),
        ]
        .iter()
        .enumerate()
        {
            let (boundary, direction) = (rough(from, to, alpha), slanted(sin));
            let mut stream = random(case as u64);
            let mut counts = vec![0u32; COS * TURN];
            let mut single = 0;
            for _ in 0..N {
                let mut weight = Rgb::ONE;
                let (leaving, facets) =
                    boundary.sample(direction, DVec3::Z, None, &mut weight, &mut stream).expect("nothing is lost");
                assert!((weight - Rgb::ONE).abs().max_element() < 1e-12, "{weight}");
                if facets == 1 {
                    single += 1;
                    let o = leaving.direction;
                    let row = ((0.5 * (o.z + 1.0)) * COS as f64) as usize;
                    let turn = (o.y.atan2(o.x) / TAU + 0.5).rem_euclid(1.0);
                    counts[row.min(COS - 1) * TURN + (turn * TURN as f64) as usize] += 1;
                }
            }
            let cell = 4.0 * PI / (COS * TURN * FINE * FINE) as f64;
            let (mut chi2, mut cells, mut total) = (0.0, 0, 0.0);
            for row in 0..COS {
                for column in 0..TURN {
                    let mut expected = 0.0;
                    for k in 0..FINE * FINE {
                        let z = 2.0 * (row as f64 + ((k / FINE) as f64 + 0.5) / FINE as f64) / COS as f64 - 1.0;
                        let turn = (column as f64 + ((k % FINE) as f64 + 0.5) / FINE as f64) / TURN as f64 - 0.5;
                        let (s, c) = (TAU * turn).sin_cos();
                        let across = (1.0 - z * z).sqrt();
                        let o = DVec3::new(across * c, across * s, z);
                        expected += facet(&boundary, direction, DVec3::Z, o).ahead.x * cell;
                    }
                    total += expected;
                    let expected = expected * N as f64;
                    if expected >= 10.0 {
                        let error = f64::from(counts[row * TURN + column]) - expected;
                        // Cells are integrated to a fraction of a per cent.
                        chi2 += error * error / (expected + (0.004 * expected).powi(2));
                        cells += 1;
                    }
                }
            }
            let share = single as f64 / N as f64;
            assert!((share - total).abs() < 0.005, "{from} {to} {alpha} {sin}: {share} against {total}");
            let limit = cells as f64 + 5.0 * (2.0 * cells as f64).sqrt();
            assert!(cells > 20 && chi2 < limit, "{from} {to} {alpha} {sin}: χ² {chi2} over {cells} cells");
        }
    }

    /// What a light is asked for is what is drawn by chance, and so is what both give together, weighted by their densities:
    /// of facets after the first, and of all where channels part or both lobes are followed.
    #[test]
    fn facets_send_what_is_drawn() {
        const BINS: usize = 8;
        let parting = Rgb::new(1.4, 1.5, 1.7);
        // With as many draws as it takes to know the most of a case to a fiftieth.
        for (k, (from, to, alpha, sin, both, least, draws)) in [
            (Rgb::ONE, Rgb::splat(1.5), 0.3, 0.97, false, 2, 2_000_000),
            (Rgb::ONE, Rgb::splat(1.5), 0.9, 0.4, false, 2, 900_000),
            (Rgb::splat(1.5), Rgb::ONE, 0.6, 0.6, false, 2, 400_000),
            (Rgb::ONE, Rgb::splat(1.3), 1.0, 0.99, false, 2, 300_000),
            (Rgb::ONE, Rgb::splat(1.5), 0.5, 0.9, true, 1, 300_000),
            (Rgb::ONE, parting, 0.5, 0.8, false, 1, 300_000),
            (parting, Rgb::ONE, 0.5, 0.5, true, 1, 400_000),
        ]
        .into_iter()
        .enumerate()
        {
            let (boundary, direction) = (Rough { from, to, alpha }, slanted(sin));
            let lobes: &[_] = if both { &[Some(Lobe::Reflected), Some(Lobe::Refracted)] } else { &[None] };
            let mut stream = random(500 + k as u64);
            // By channel and cosine: drawn, asked for, and both combined.
            let mut sums = [[[[0.0; 2]; 3]; BINS]; 3];
            let uniform = 0.25 / PI;
            for _ in 0..draws {
                let bin = |o: DVec3| ((0.5 * (o.z + 1.0) * BINS as f64) as usize).min(BINS - 1);
                let mut found = [[[0.0; 3]; BINS]; 3];
                for &lobe in lobes {
                    let mut weight = Rgb::ONE;
                    let drawn = boundary.sample(direction, DVec3::Z, lobe, &mut weight, &mut stream);
                    let Some((drawn, _)) = drawn.filter(|(_, facets)| *facets >= least) else { continue };
                    for c in 0..3 {
                        found[c][bin(drawn.direction)][0] += weight[c];
                        found[c][bin(drawn.direction)][2] += weight[c] * drawn.density / (drawn.density + uniform);
                    }
                }
                let o = crate::math::sampling::sphere(stream.uniform2());
                let mut facets = 0;
                boundary.facets((direction, DVec3::Z), o, both, Rgb::ONE, &mut stream, |weight, facet| {
                    facets += 1;
                    for c in (0..3).filter(|_| facets >= least) {
                        found[c][bin(o)][1] += weight[c] * facet.value[c] / uniform;
                        found[c][bin(o)][2] += weight[c] * facet.value[c] / (facet.ahead[c] + uniform);
                    }
                });
                for (sum, x) in
                    sums.as_flattened_mut().as_flattened_mut().iter_mut().zip(found.as_flattened().as_flattened())
                {
                    *sum = [sum[0] + x, sum[1] + x * x];
                }
            }
            let n = f64::from(draws);
            let mut most = 0.0f64;
            for (place, sums) in sums.as_flattened().iter().enumerate() {
                let [drawn, asked, both] = sums.map(|[sum, squares]| {
                    let mean: f64 = sum / n;
                    (mean, ((squares / n - mean * mean) / n).sqrt())
                });
                for (mean, error) in [asked, both] {
                    let off = (mean - drawn.0).abs();
                    assert!(off < 4.5 * error.hypot(drawn.1) + 1e-6, "case {k}, {place}: {drawn:?} {mean} ± {error}");
                }
                most = most.max(drawn.0 / asked.1.hypot(drawn.1));
            }
            assert!(most > 50.0, "case {k}: known to 1/{most} only");
        }
    }

    /// What is reflected and what is refracted, each for itself, make together what is drawn.
    #[test]
    fn both_lobes_together_are_all() {
        const N: usize = 200_000;
        for (k, (from, to, sin)) in [(1.0, 1.5, 0.2), (1.0, 1.5, 0.97), (1.5, 1.0, 0.6)].into_iter().enumerate() {
            let boundary = rough(from, to, 0.5);
            let mut stream = random(400 + k as u64);
            // Sums of power and of its moments, above and below, with their squares.
            let mut sum = |lobes: &[Option<Lobe>]| {
                let mut sums = [[0.0; 2]; 4];
                for _ in 0..N {
                    let mut found = [0.0; 4];
                    for &lobe in lobes {
                        let mut weight = Rgb::ONE;
                        let leaving = boundary.sample(slanted(sin), DVec3::Z, lobe, &mut weight, &mut stream);
                        // Nothing is refracted where reflection is total.
                        let Some((Onward { direction, .. }, _)) = leaving else { continue };
                        let below = usize::from(direction.z < 0.0);
                        found[2 * below] += weight.x;
                        found[2 * below + 1] += weight.x * direction.x;
                    }
                    for (sum, x) in sums.iter_mut().zip(found) {
                        *sum = [sum[0] + x, sum[1] + x * x];
                    }
                }
                let n = N as f64;
                sums.map(|[sum, squares]| (sum / n, ((squares / n - (sum / n).powi(2)) / n).sqrt()))
            };
            let (drawn, both) = (sum(&[None]), sum(&[Some(Lobe::Reflected), Some(Lobe::Refracted)]));
            for ((a, e), (b, f)) in drawn.into_iter().zip(both) {
                assert!((a - b).abs() < 4.0 * e.hypot(f) && e < 0.002, "{from} {to} {sin}: {a} ± {e}, {b} ± {f}");
            }
        }
    }

    /// f(i → o)/n_o² = f(o → i)/n_i², for reflection and refraction.
    #[test]
    fn facets_are_reciprocal() {
        let mut stream = random(100);
        let mut compared = 0;
        for _ in 0..20_000 {
            let alpha = 0.05 + 0.9 * stream.uniform();
            let (there, back) = (rough(1.0, 1.5, alpha), rough(1.5, 1.0, alpha));
            let i = crate::math::sampling::sphere(stream.uniform2());
            let o = crate::math::sampling::sphere(stream.uniform2());
            let (boundary, returning) = (if i.z > 0.0 { there } else { back }, if o.z > 0.0 { there } else { back });
            let side = |v: DVec3| if v.z > 0.0 { DVec3::Z } else { -DVec3::Z };
            let forth = facet(&boundary, -i, side(i), o).value.x / o.z.abs();
            let reverse = facet(&returning, -o, side(o), i).value.x / i.z.abs();
            let index = |v: DVec3| if v.z > 0.0 { 1.0 } else { 1.5f64 };
            let (a, b) = (forth / index(o).powi(2), reverse / index(i).powi(2));
            assert!((a - b).abs() <= 1e-7 * a.max(b), "{i} {o} {alpha}: {a} {b}");
            compared += usize::from(a > 0.0);
        }
        assert!(compared > 5000);
    }

    /// All facets together: as much goes from one cone into another as back, by n² and projected solid angle.
    #[test]
    fn many_facets_are_reciprocal() {
        let alpha = 0.8;
        let count = |from: f64, to: f64, lit: (f64, f64), seen: (f64, f64), index: u64| {
            let boundary = rough(from, to, alpha);
            let mut stream = random(index);
            let mut met = 0;
            const N: usize = 400_000;
            for _ in 0..N {
                // Cosines squared are even in projected solid angle.
                let cos = (lit.0 + (lit.1 - lit.0) * stream.uniform()).sqrt();
                let mut weight = Rgb::ONE;
                let direction = -crate::math::sampling::direction(cos, stream.uniform());
                let (leaving, facets) =
                    boundary.sample(direction, DVec3::Z, None, &mut weight, &mut stream).expect("nothing is lost");
                let (cos2, z) = (leaving.direction.z.powi(2), leaving.direction.z);
                met += u32::from(z < 0.0 && facets > 1 && cos2 >= seen.0 && cos2 < seen.1);
            }
            let share = f64::from(met) / N as f64;
            (share * (lit.1 - lit.0) * from * from, share.sqrt() / (N as f64).sqrt() * (lit.1 - lit.0) * from * from)
        };
        for (k, (a, b)) in [((0.1, 0.4), (0.5, 0.9)), ((0.6, 1.0), (0.3, 0.6))].into_iter().enumerate() {
            let (there, noise) = count(1.0, 1.5, a, b, 200 + k as u64);
            let (back, other) = count(1.5, 1.0, b, a, 300 + k as u64);
            let error = noise.hypot(other);
            assert!((there - back).abs() < 4.0 * error && error < 0.05 * there, "{there} {back} ± {error}");
        }
    }
}
