use super::fresnel::mean_transmittance;
use super::ggx::{Ggx, MOST_FACETS};
use super::glaze::Glaze;
use super::lambert::cosine_density;
use super::rough::Rough;
use super::{Dielectric, Drawn, Incidence, Lobe, Nature, Reflector, Scattering, fresnel};
use crate::math::{DVec3, Rgb, Stream};

/// A dielectric coat, smooth or rough, over a base that reflects: varnish, glazed clay, what is called plastic.
///
/// Light is followed through the coat: reflected at its boundary, or on to the base, back, and between the two until it leaves, without
/// thickness (as by Guo, Hašan and Zhao 2018). Nothing is lost but what the base absorbs, colours deepen by what the boundary
/// returns to it, and the model is reciprocal.
///
/// What goes along `o` is asked for at the base, by the way that light from there would take back into the coat:
/// ∫ f_b(i′→o′) v(o′→o) dω′ = E[w f_b(i′→o′)] cos θ_o (n₁/n₂)², with o′ drawn by the walk from o into the coat, and w its weight; bases that
/// are narrower than the coat are drawn from, and the coat's facets asked instead. A smooth coat over a Lambertian base needs no
/// walk: its sum is known in closed form ([`Glaze`]).
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Coated {
    /// What is under the coat.
    pub base: Reflector,
    /// The coat's index of refraction, above 0.
    #[serde(rename = "ior")]
    pub index: f64,
    /// GGX's α of the coat's boundary, in \[0, 1\]; 0 is smooth.
    pub roughness: f64,
    /// The index of refraction of what is around.
    #[serde(skip)]
    outside: f64,
    /// The share of diffuse light that passes the smooth boundary from inside: follows from the indices.
    #[serde(skip)]
    passes: f64,
}

/// Reflections between base and coat, at most: of light that total reflection keeps in, 2 % are left after ten.
const MOST_LAYERS: u32 = 1000;

/// Of the density for sharing this much is cosine-weighted, so that it is nowhere too small.
const LEAST_DIFFUSE: f64 = 0.1;

/// In coordinates whose z points out of the coat.
fn flipped(v: DVec3) -> DVec3 {
    DVec3::new(v.x, v.y, -v.z)
}

/// Where light goes that met the boundary of the coat.
struct Crossed {
    travel: DVec3,
    through: bool,
    /// The density of its last facet.
    density: f64,
}

impl Coated {
    /// A coat of this index and roughness over `base`, with an index of 1 around.
    pub fn new(base: Reflector, index: f64, roughness: f64) -> Self {
        Coated { base, index, roughness, outside: 1.0, passes: mean_transmittance(index, 1.0) }
    }

    /// Puts it where this index of refraction is around.
    pub fn put_in(&mut self, outside: f64) {
        if outside != self.outside {
            (self.outside, self.passes) = (outside, mean_transmittance(self.index, outside));
        }
    }

    /// The closed form, where there is one.
    fn glaze(&self) -> Option<Glaze> {
        let Coated { base, index, roughness, outside, passes } = *self;
        match base {
            Reflector::Lambert(base) if roughness == 0.0 => {
                Some(Glaze { reflectance: base.reflectance, outside, index, passes })
            }
            _ => None,
        }
    }

    /// The boundary as it is met from outside or from inside.
    fn boundary(&self, inside: bool) -> Rough {
        let [from, to] = if inside { [self.index, self.outside] } else { [self.outside, self.index] };
        Rough { from: Rgb::splat(from), to: Rgb::splat(to), alpha: self.roughness }
    }

    /// How the base is met by light that travels along `travel`.
    fn met(travel: DVec3) -> Incidence {
        Incidence { direction: travel, normal: DVec3::Z, shading_normal: DVec3::Z, tangent: DVec3::X }
    }

    /// α of the base's facets; 1 stands for diffuse.
    fn base_roughness(&self) -> f64 {
        match (&self.base, self.base.nature()) {
            (_, Nature::Diffuse) => 1.0,
            (_, Nature::Specular) => 0.0,
            (Reflector::Conductor(conductor), _) => (conductor.roughness[0] * conductor.roughness[1]).sqrt(),
            (Reflector::Schlick(schlick), _) => schlick.roughness.sqrt(),
            // As wide as the lobe: cosⁿ falls to a half where α = √(2/(n + 2)).
            (Reflector::Phong(phong), _) => (2.0 / (phong.exponent + 2.0)).sqrt(),
            (Reflector::Lambert(_) | Reflector::OrenNayar(_) | Reflector::Mirror(_), _) => 1.0,
        }
    }

    pub(super) fn nature(&self) -> Nature {
        match self.base.nature() {
            Nature::Specular if self.roughness > 0.0 => Nature::Glossy,
            nature => nature,
        }
    }

    /// At most what neither coat nor base absorb: F + (1 − F) of the base.
    pub(super) fn albedo(&self, at: &Incidence) -> Rgb {
        if let Some(glaze) = self.glaze() {
            return glaze.albedo(at);
        }
        let reflected = fresnel(-at.direction.dot(at.shading_normal), self.outside, self.index);
        Rgb::splat(reflected) + (1.0 - reflected) * self.base.albedo(at)
    }

    /// With what density light along `travel` is said to leave along `o` after it was in the coat: for sharing, so that any will do that
    /// is a function of both alone.
    fn sharing(&self, travel: DVec3, o: DVec3) -> f64 {
        let diffuse = cosine_density(DVec3::Z, o);
        let base = self.base_roughness();
        if base >= 1.0 {
            return diffuse;
        }
        let facets = Ggx::round(base.hypot(self.roughness).clamp(1e-3, 1.0));
        let lobe = facets.reflection(-travel, o).map_or(0.0, |(density, _)| density);
        LEAST_DIFFUSE * diffuse + (1.0 - LEAST_DIFFUSE) * lobe
    }

    /// Meets the boundary from outside or from inside. `facet` is told the weight at each facet, and what it sends along `leaving`.
    fn cross(
        &self,
        inside: bool,
        travel: DVec3,
        weight: &mut Rgb,
        stream: &mut Stream,
        asked: Option<DVec3>,
        mut facet: impl FnMut(Rgb, Scattering),
    ) -> Option<Crossed> {
        let turned = |v: DVec3| if inside { flipped(v) } else { v };
        let boundary = self.boundary(inside);
        let travel = turned(travel);
        if self.roughness == 0.0 {
            let (from, to) = (boundary.from.x, boundary.to.x);
            let reflected = Rgb::splat(fresnel(-travel.z, from, to));
            let through = Lobe::take(None, reflected, weight, stream) == Lobe::Refracted;
            let travel = if through { Dielectric::refract(travel, DVec3::Z, from, to)? } else { flipped(travel) };
            return Some(Crossed { travel: turned(travel), through, density: 0.0 });
        }
        let asked = asked.map(turned);
        let mut visit = boundary.arrive(travel);
        for _ in 0..MOST_FACETS {
            if let Some(leaving) = asked {
                facet(*weight, boundary.sends(&visit, leaving, false));
            }
            let arriving = visit;
            if boundary.meet(&mut visit, None, weight, stream)? {
                let leaving = visit.turned(visit.travel);
                let density = boundary.sends(&arriving, leaving, false).ahead.x;
                return Some(Crossed { travel: turned(leaving), through: leaving.z < 0.0, density });
            }
        }
        None
    }

    /// What coat and base send along `o`: see [`Bsdf::toward`](super::Bsdf::toward).
    pub(super) fn toward(
        &self,
        at: &Incidence,
        o: DVec3,
        mut weight: Rgb,
        stream: &mut Stream,
        mut part: impl FnMut(Rgb, Scattering),
    ) {
        if let Some(glaze) = self.glaze() {
            return part(weight, glaze.value(at, o));
        }
        let frame = at.frame();
        let (arriving, leaving) = (frame.to_local(at.direction), frame.to_local(o));
        if leaving.z <= 0.0 || arriving.z >= 0.0 || self.nature() == Nature::Specular {
            return;
        }

        // The boundary itself, and on into the coat.
        let mut travel = if self.roughness > 0.0 {
            match self.cross(false, arriving, &mut weight, stream, Some(leaving), &mut part) {
                Some(crossed) if crossed.through => crossed.travel,
                _ => return,
            }
        } else {
            weight *= 1.0 - fresnel(-arriving.z, self.outside, self.index);
            let Some(travel) = Dielectric::refract(arriving, DVec3::Z, self.outside, self.index) else { return };
            travel
        };

        // Between base and boundary.
        let ahead = Rgb::splat(self.sharing(arriving, leaving));
        let at_base = self.base_roughness() >= self.roughness;
        for _ in 0..MOST_LAYERS {
            if at_base && let Some((back, passed)) = self.way_in(leaving, stream) {
                let scale = passed * leaving.z / back.z * (self.outside / self.index).powi(2);
                self.base.toward(&Self::met(travel), back, weight, stream, |weight, sent| {
                    part(weight, Scattering { value: scale * sent.value, ahead });
                });
            }
            let Some(drawn) = self.base.sample(&Self::met(travel), stream) else { return };
            weight *= drawn.factor;
            if drawn.direction.z <= 0.0 || !self.outlives(&mut weight, stream) {
                return;
            }
            if self.roughness == 0.0 {
                weight *= fresnel(drawn.direction.z, self.index, self.outside);
                travel = flipped(drawn.direction);
                continue;
            }
            let asked = (!at_base).then_some(leaving);
            let tell = |weight: Rgb, sent: Scattering| part(weight, Scattering { ahead, ..sent });
            match self.cross(true, drawn.direction, &mut weight, stream, asked, tell) {
                Some(crossed) if !crossed.through => travel = crossed.travel,
                _ => return,
            }
        }
    }

    /// A way from `leaving` into the coat, turned back: the direction in which light leaves the base to come out along `leaving`, with
    /// its weight; `None` where it does not get in.
    fn way_in(&self, leaving: DVec3, stream: &mut Stream) -> Option<(DVec3, Rgb)> {
        let mut weight = Rgb::ONE;
        let travel = if self.roughness > 0.0 {
            let crossed = self.cross(false, -leaving, &mut weight, stream, None, |_, _| {})?;
            crossed.through.then_some(crossed.travel)?
        } else {
            weight *= 1.0 - fresnel(leaving.z, self.outside, self.index);
            Dielectric::refract(-leaving, DVec3::Z, self.outside, self.index)?
        };
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

    /// Where light goes on from coat or base.
    pub(super) fn sample(&self, at: &Incidence, stream: &mut Stream) -> Option<Drawn> {
        if let Some(glaze) = self.glaze() {
            return Some(glaze.sample(at, stream));
        }
        let frame = at.frame();
        let arriving = frame.to_local(at.direction);
        let mut factor = Rgb::ONE;
        let leaves = |travel: DVec3, factor: Rgb, density: f64| {
            let direction = frame.to_world(travel).normalize();
            Some(Drawn { direction, normal: at.shading_normal, factor, density })
        };

        // At the boundary.
        let Crossed { mut travel, through, density } =
            self.cross(false, arriving, &mut factor, stream, None, |_, _| {})?;
        if !through {
            return leaves(travel, factor, density);
        }

        // Between base and boundary.
        let specular = self.nature() == Nature::Specular;
        for _ in 0..MOST_LAYERS {
            let drawn = self.base.sample(&Self::met(travel), stream)?;
            factor *= drawn.factor;
            if drawn.direction.z <= 0.0 || !self.outlives(&mut factor, stream) {
                return None;
            }
            let crossed = self.cross(true, drawn.direction, &mut factor, stream, None, |_, _| {})?;
            travel = crossed.travel;
            if crossed.through {
                return leaves(travel, factor, if specular { 0.0 } else { self.sharing(arriving, travel) });
            }
        }
        None
    }
}
