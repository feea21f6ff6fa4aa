use super::coat::{Coat, Crossed, flipped, met};
use super::ggx::Ggx;
use super::glaze::{Glaze, returned};
use super::lambert::{cosine, cosine_density};
use super::transmittance::Transmittance;
use super::{Drawn, Incidence, Lobe, Mirror, Nature, Reflector, Scattering};
use crate::math::{DVec3, Rgb, Stream};

/// A coat over a base that reflects: a dielectric one, smooth or rough, as of varnish, glazed clay, what is called plastic; or the upper
/// layer of Schlick's double surface.
///
/// Light is followed through the coat: reflected there, or on to the base, back, and between the two until it leaves, without
/// thickness (as by Guo, Hašan and Zhao 2018). Nothing is lost but what the base absorbs, colours deepen by what the coat
/// returns to it, and the model is reciprocal.
///
/// What goes along `o` is asked for at the base, by the way that light from there would take back into the coat:
/// ∫ f_b(i′→o′) v(o′→o) dω′ = E[w f_b(i′→o′)] cos θ_o (n₁/n₂)², with o′ drawn by the walk from o into the coat, and w its weight; bases that
/// are narrower than the coat are drawn from, and the coat's facets asked instead. A Lambertian base under a rough dielectric sends what the coat lets pass
/// evenly, and what passes is tabulated: f(i→o) = T(i) T(o) (n₁/n₂)² ρ / (π (1 − ρ (1 − T̄))), beside what the coat reflects. Where both coat and base reflect shares a and b
/// of light specularly, what is on its way out goes to and fro between them: 1 + ab + (ab)² + … = 1/(1 − ab) times. A smooth dielectric
/// over a Lambertian base needs no walk: its sum is known in closed form.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Coated {
    /// What is under the coat.
    pub base: Reflector,
    /// What is over it.
    pub coat: Coat,
}

/// Reflections between base and coat, at most: of light that total reflection keeps in, 2 % are left after ten.
const MOST_LAYERS: u32 = 1000;

/// However little the base returns, light that passes the coat counts so much in the chance for that.
const LEAST_PASSING: f64 = 0.1;

/// Of the density for sharing this much is cosine-weighted, so that it is nowhere too small.
const LEAST_DIFFUSE: f64 = 0.1;

impl Coated {
    /// The closed form, where there is one.
    fn glaze(&self) -> Option<Glaze> {
        match (self.base, self.coat) {
            (Reflector::Lambert(base), Coat::Dielectric(varnish)) if varnish.roughness == 0.0 => {
                Some(Glaze { reflectance: base.reflectance, varnish })
            }
            _ => None,
        }
    }

    /// Of a Lambertian base under a rough dielectric, where it is known what passes that: what the base sends with all that comes back to it of what the coat returns,
    /// in radiance under the coat against that without: ρ (n₁/n₂)²/(1 − ρ (1 − T̄)); and what passes.
    fn varnish(&self) -> Option<(Rgb, Transmittance)> {
        match (self.base, self.coat) {
            (Reflector::Lambert(base), Coat::Dielectric(varnish)) if varnish.roughness > 0.0 => {
                let (passes, spreads) = (varnish.transmittance()?, self.coat.spreads());
                // As much comes out of the denser side as went in.
                Some((spreads * returned(base.reflectance, spreads * passes.diffuse()), passes))
            }
            _ => None,
        }
    }

    pub(super) fn is_walked(&self) -> bool {
        self.glaze().is_none()
    }

    pub(super) fn nature(&self) -> Nature {
        self.base.nature().min(self.coat.nature())
    }

    pub(super) fn is_partly_specular(&self) -> bool {
        match &self.coat {
            Coat::Dielectric(varnish) => varnish.roughness == 0.0,
            Coat::Schlick(schlick) => schlick.is_partly_specular() || self.base.is_partly_specular(),
        }
    }

    pub(super) fn is_anisotropic(&self) -> bool {
        let coat = matches!(self.coat, Coat::Schlick(schlick) if schlick.isotropy != 1.0);
        coat || self.base.is_anisotropic()
    }

    /// At most what neither coat nor base absorb: F + (1 − F) of the base.
    pub(super) fn albedo(&self, at: &Incidence) -> Rgb {
        if let Some(glaze) = self.glaze() {
            return glaze.albedo(at);
        }
        let reflected = self.coat.reflected(-at.direction.dot(at.shading_normal));
        reflected + (Rgb::ONE - reflected) * self.base.albedo(at)
    }

    /// What light that passes the coat counts in the chance for that, against what the coat reflects: about what the base returns of it.
    fn passing(&self, at: &Incidence) -> f64 {
        (self.base.albedo(at).element_sum() / 3.0).clamp(LEAST_PASSING, 1.0)
    }

    /// With what density light along `travel` is said to leave along `o` after it was in the coat: for sharing, so that any will do that
    /// is a function of both alone.
    fn sharing(&self, travel: DVec3, o: DVec3) -> f64 {
        let diffuse = cosine_density(DVec3::Z, o);
        let base = self.base.alpha();
        if base >= 1.0 {
            return diffuse;
        }
        let facets = Ggx::round(base.hypot(self.coat.roughness()).clamp(1e-3, 1.0));
        let lobe = facets.reflection(-travel, o).map_or(0.0, |(density, _)| density);
        LEAST_DIFFUSE * diffuse + (1.0 - LEAST_DIFFUSE) * lobe
    }

    /// What base and coat reflect specularly of light that leaves the base at an angle of this cosine: the base's share, and how much
    /// of what is on its way out there is after all ways to and fro.
    fn echo(&self, cos: f64) -> (Rgb, Rgb) {
        let base = self.base.specular(cos);
        if base == Rgb::ZERO {
            return (base, Rgb::ONE);
        }
        let both = base * self.coat.specular(true, cos);
        (base, both.map(|both| if both < 1.0 { 1.0 / (1.0 - both) } else { 0.0 }))
    }

    /// What coat and base send along `o`: see [`Bsdf::toward`](super::Bsdf::toward).
    pub(super) fn toward(
        &self,
        at: &Incidence,
        o: DVec3,
        both: bool,
        mut weight: Rgb,
        stream: &mut Stream,
        mut part: impl FnMut(Rgb, Scattering),
    ) {
        if let Some(glaze) = self.glaze() {
            return part(weight, glaze.value(at, o, both));
        }
        let frame = at.frame();
        let (arriving, leaving) = (frame.to_local(at.direction), frame.to_local(o));
        if leaving.z <= 0.0 || arriving.z >= 0.0 || self.nature() == Nature::Specular {
            return;
        }

        // What the base sends, where that is known, beside the coat.
        if let Some((sent, passes)) = self.varnish() {
            let cosine = cosine_density(DVec3::Z, leaving);
            let value = sent * (passes.from(-arriving.z) * passes.from(leaving.z) * cosine);
            part(weight, Scattering { value, ahead: Rgb::splat(cosine) });
            self.coat.cross(Some(self.passing(at)), arriving, &mut weight, stream, Some(leaving), part);
            return;
        }

        // The coat itself, and on into it.
        let smooth = self.coat.is_smooth();
        let entered = if smooth {
            self.coat.enter(arriving, &mut weight, stream)
        } else {
            let crossed =
                self.coat.cross(Some(self.passing(at)), arriving, &mut weight, stream, Some(leaving), &mut part);
            crossed.filter(|crossed| crossed.through).map(|crossed| crossed.travel)
        };
        let Some(mut travel) = entered else { return };

        // Between base and coat.
        let ahead = Rgb::splat(self.sharing(arriving, leaving));
        let straight = self.coat.passes_in_one_direction();
        let at_base = straight || self.base.alpha() >= self.coat.roughness();
        for _ in 0..MOST_LAYERS {
            // What the base sends, and all that is then specular.
            let way = if at_base { self.way_in(leaving, stream) } else { None };
            if let Some((back, passed)) = way {
                let scale = passed * self.echo(back.z).1 * (leaving.z / back.z * self.coat.spreads());
                self.base.toward(&met(travel), back, weight, stream, |weight, sent| {
                    part(weight, Scattering { value: scale * sent.value, ahead });
                });
            }
            let Some(drawn) = self.base.sample(&met(travel), stream) else { return };
            weight *= drawn.factor;
            if drawn.direction.z <= 0.0 || !self.outlives(&mut weight, stream) {
                return;
            }
            if smooth {
                weight *= self.coat.specular(true, drawn.direction.z);
                travel = flipped(drawn.direction);
                continue;
            }

            // What the coat sends: what leaves it, or what it returns so that the base reflects it specularly.
            let (asked, scale) = match way {
                Some((back, passed)) if straight => {
                    let (base, echo) = self.echo(back.z);
                    (Some(flipped(back)).filter(|_| base != Rgb::ZERO), passed * base * echo)
                }
                _ => (Some(leaving).filter(|_| !straight && (!at_base || drawn.density == 0.0)), Rgb::ONE),
            };
            let tell = |weight: Rgb, sent: Scattering| part(weight, Scattering { value: scale * sent.value, ahead });
            match self.coat.cross(None, drawn.direction, &mut weight, stream, asked, tell) {
                Some(crossed) if !crossed.through => travel = crossed.travel,
                _ => return,
            }
        }
    }

    /// A way from `leaving` into the coat, turned back: the direction in which light leaves the base to come out along `leaving`, with
    /// its weight; `None` where it does not get in.
    fn way_in(&self, leaving: DVec3, stream: &mut Stream) -> Option<(DVec3, Rgb)> {
        let mut weight = Rgb::ONE;
        let travel = self.coat.enter(-leaving, &mut weight, stream)?;
        (travel.z < 0.0).then_some((-travel, weight))
    }

    /// Ends the walk of weak light by roulette.
    fn outlives(&self, weight: &mut Rgb, stream: &mut Stream) -> bool {
        const WEAK: f64 = 0.1;
        let most = weight.max_element();
        if most >= WEAK {
            return true;
        }
        let chance = most / WEAK;
        *weight /= chance.max(f64::MIN_POSITIVE);
        stream.uniform() < chance
    }

    /// What the coat alone mirrors in a single direction, where the base spreads all that it gets.
    pub(super) fn mirrored(&self, at: &Incidence) -> Option<Drawn> {
        match self.coat {
            Coat::Dielectric(varnish) if varnish.roughness == 0.0 && !self.base.is_partly_specular() => {
                let reflectance = self.coat.reflected(-at.direction.dot(at.shading_normal));
                Some(Mirror { reflectance }.sample(at))
            }
            _ => None,
        }
    }

    /// Where light goes on from coat or base; where it is [`mirrored`](Self::mirrored), from one of them as `lobe` says.
    pub(super) fn sample(&self, at: &Incidence, lobe: Option<Lobe>, stream: &mut Stream) -> Option<Drawn> {
        if let Some(glaze) = self.glaze() {
            return Some(glaze.sample(at, lobe, stream));
        }
        let frame = at.frame();
        let arriving = frame.to_local(at.direction);
        let mut factor = Rgb::ONE;
        let leaves = |travel: DVec3, factor: Rgb, density: f64| {
            let direction = frame.to_world(travel).normalize();
            Some(Drawn { direction, normal: at.shading_normal, factor, density })
        };

        // At the coat.
        let Crossed { mut travel, through, density } = match lobe {
            None => self.coat.cross(Some(self.passing(at)), arriving, &mut factor, stream, None, |_, _| {})?,
            Some(Lobe::Reflected) => return self.mirrored(at),
            Some(Lobe::Refracted) => {
                Crossed { travel: self.coat.enter(arriving, &mut factor, stream)?, through: true, density: 0.0 }
            }
        };
        if !through {
            return leaves(travel, factor, density);
        }

        // The base, where it is known what leaves.
        if let Some((sent, passes)) = self.varnish() {
            let (direction, density) = cosine(DVec3::Z, stream);
            return leaves(direction, factor * sent * passes.from(direction.z), density);
        }

        // Between base and coat.
        let mut specular = density == 0.0;
        for _ in 0..MOST_LAYERS {
            let drawn = self.base.sample(&met(travel), stream)?;
            factor *= drawn.factor;
            if drawn.direction.z <= 0.0 || !self.outlives(&mut factor, stream) {
                return None;
            }
            let crossed = self.coat.cross(None, drawn.direction, &mut factor, stream, None, |_, _| {})?;
            travel = crossed.travel;
            specular = specular && drawn.density == 0.0 && crossed.density == 0.0;
            if crossed.through {
                return leaves(travel, factor, if specular { 0.0 } else { self.sharing(arriving, travel) });
            }
        }
        None
    }
}
