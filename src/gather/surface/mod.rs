//! Radiance that a surface reflects, from photons that landed around.

mod balls;
mod cut;
mod sheets;

use std::f64::consts::PI;

use rayon::prelude::*;

use self::balls::Balls;
pub(super) use self::cut::{Place, are_one};
use self::sheets::Sheets;
use super::few::Few;
use crate::math::random::Purpose;
use crate::math::{DVec3, Rgb, Stream, Vec3};
use crate::photon::sheets::SheetSettings;
use crate::photon::{Ball, Kind, PackedNormal, Photon, PointMap, PointMemory};
use crate::scene::Scene;
use crate::scene::description::SurfaceFilter;
use crate::surface::{Scattering, Side};
use crate::transport::{Events, Interaction, Vertex};

/// Photons that landed on surfaces.
///
/// The radiance estimate (Jensen 2001, Eq. 7.8): L(x, ω) = Σ f(x, ω_p → ω) Φ_p k(d_p/r)/(s π r²) over photons within r of x, where r is the
/// distance of the n-th nearest, or the cap, or fixed, or as far as light is even; or each photon has an r and s of its own. Balls are flattened: photons count that lie
/// near the tangent plane, on surfaces that face the same way, so that light of one wall does not colour another at an edge, nor shine through
/// a thin wall; and where who looks is closer than two radii, and may be enclosed with the place, those to which no wall is on the way. s is the
/// share of the disc on which such photons can land, without what lies past an edge or behind a wall.
#[derive(Debug)]
pub struct SurfaceMap {
    photons: Photons,
    filter: SurfaceFilter,
}

#[derive(Debug)]
enum Photons {
    Balls(Balls),
    Sheets(Sheets),
}

/// How far photons on surfaces count.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Reach {
    /// Those within a ball around the place looked up.
    Ball {
        /// How wide it is.
        ball: Ball,
        /// Whether it is narrowed where light has an edge in it.
        checks: bool,
    },
    /// Each as far as those around it are sparse.
    Sheets {
        /// About so many overlap.
        neighbours: u32,
        /// No radius exceeds this.
        max_radius: f32,
    },
}

/// Radii of sheets are found from one in so many of the photons that are to overlap. With all of them, the squared error by blur of
/// `scenes/jensen/ring.toml` is half as large again, and the variance where light is even three quarters; the sum is about the same, and radii take
/// longer to find.
const PILOT: u32 = 4;

/// Of the Gaussian filter: Jensen's (2001, Eq. 7.10) β.
const BETA: f64 = 1.953;

impl SurfaceFilter {
    /// k(x), of which the mean over the unit disc is 1: what a photon counts at distance x of the radius.
    fn weight(self, squared: f32) -> f32 {
        match self {
            SurfaceFilter::None => 1.0,
            SurfaceFilter::Cone => 3.0 * (1.0 - squared.sqrt()),
            SurfaceFilter::Gaussian => {
                // Jensen's falls to 0 at the rim; his α = 0.918 lets the mean be 0.7 % off.
                let rest = 1.0 - (-BETA as f32).exp();
                let fallen = 1.0 - (-0.5 * BETA as f32 * squared).exp();
                (1.0 - fallen / rest).max(0.0) / gaussian_within(1.0) as f32
            }
        }
    }

    /// ∫₀^{x²} k(√s) ds, the share of the disc's weight within distance x of the radius: 1 at its rim.
    fn within(self, squared: f64) -> f64 {
        match self {
            SurfaceFilter::None => squared,
            SurfaceFilter::Cone => squared * (3.0 - 2.0 * squared.sqrt()),
            SurfaceFilter::Gaussian => gaussian_within(squared) / gaussian_within(1.0),
        }
    }
}

/// The integral over [0, `squared`] of 1 − (1 − e^{−βs/2})/(1 − e^{−β}).
fn gaussian_within(squared: f64) -> f64 {
    let fallen = squared - (1.0 - (-0.5 * BETA * squared).exp()) / (0.5 * BETA);
    squared - fallen / (1.0 - (-BETA).exp())
}

impl SurfaceMap {
    /// A photon is spread over a disc.
    pub const DIMENSION: u32 = 2;

    /// Puts photons in order, in parallel, with the same result for any number of threads. All radii are `scale` times as wide as
    /// `reach` says.
    pub fn build(
        scene: &Scene,
        (kind, photons): (Kind, Vec<Photon>),
        reach: Reach,
        filter: SurfaceFilter,
        scale: f32,
    ) -> Self {
        let photons = match reach {
            Reach::Ball { ball, checks } => Photons::Balls(Balls::build(scene, (kind, photons), (ball, checks), scale)),
            Reach::Sheets { neighbours, max_radius } => {
                let pilot = (neighbours / PILOT).max(5).min(neighbours);
                let settings = SheetSettings { neighbours, pilot, max_radius, scale };
                Photons::Sheets(Sheets::build(scene, (kind, photons), &settings, filter))
            }
        };
        SurfaceMap { photons, filter }
    }

    fn map(&self) -> &PointMap {
        match &self.photons {
            Photons::Balls(balls) => &balls.map,
            Photons::Sheets(sheets) => &sheets.map.photons,
        }
    }

    /// How many photons it holds.
    pub fn len(&self) -> usize {
        self.map().len()
    }

    /// Whether it holds none.
    pub fn is_empty(&self) -> bool {
        self.map().is_empty()
    }

    /// How many photons were left out because a number was not finite.
    pub fn rejected(&self) -> usize {
        self.map().rejected()
    }

    /// Memory taken, in bytes.
    pub fn bytes(&self) -> usize {
        match &self.photons {
            Photons::Balls(balls) => balls.bytes(),
            Photons::Sheets(sheets) => sheets.bytes(),
        }
    }

    /// The mean radius: of look-ups at some of the photons, or of their own.
    pub fn mean_radius(&self) -> f64 {
        let radii = match &self.photons {
            Photons::Balls(balls) => balls.map.radii(),
            Photons::Sheets(sheets) => sheets.map.radii(),
        };
        radii.mean.into()
    }

    /// The radiance that goes from `at` to where its ray came from, of light with no more events before than `most`.
    pub fn reflected(
        &self,
        scene: &Scene,
        at: &Interaction,
        most: Events,
        stream: &mut Stream,
        memory: &mut PointMemory,
    ) -> Rgb {
        let place = Place { point: at.point, normal: at.incidence.normal };
        let (vertex, shading_normal) = (Vertex::Surface(at), at.incidence.shading_normal);
        let lambertian = at.bsdf.lambertian();
        let mut sum = Rgb::ZERO;
        let mut send = |stream: &mut Stream, from: DVec3, power: Rgb| {
            // Powers on Lambertian surfaces are as the shading normal sees them: elsewhere it is this one that counts.
            let cos = from.dot(if lambertian.is_some() { shading_normal } else { place.normal });
            match lambertian {
                Some(reflectance) if cos > 0.0 => sum += power * reflectance / PI,
                None if cos > 0.0 => {
                    let part = |power: Rgb, sent: Scattering| sum += power * sent.value;
                    vertex.toward(from, Side::Eye, false, power / cos, stream, part);
                }
                _ => {}
            }
        };
        // To follow every photon between facets or layers is most of the time of a picture with a rough varnish.
        let mut few = at.bsdf.is_walked().then(Few::default);
        let photon = |stream: &mut Stream, from: DVec3, power: Rgb| match &mut few {
            Some(few) => few.tell(stream, from, power),
            None => send(stream, from, power),
        };
        let area = match &self.photons {
            Photons::Balls(balls) => {
                let found = balls.around(scene, place, (most, self.filter, at.t), stream, memory, photon);
                found.map(|(area, _)| area)
            }
            // Their powers are by area.
            Photons::Sheets(sheets) => {
                sheets.around(scene, place, (most, None, at.t), stream, memory, photon).map(|_| 1.0)
            }
        };
        few.iter().flat_map(Few::drawn).for_each(|(from, power)| send(stream, from, power));
        area.map_or(Rgb::ZERO, |area| sum / area)
    }

    /// Photons at places where photons landed, `one_in` so many, with the irradiance there as power, the normal, as long as the radius it
    /// was averaged over, as direction, and as many events as it is cut: 1 or 0.
    pub(super) fn irradiances(&self, scene: &Scene, places: &[(Vec3, PackedNormal)], one_in: u32) -> Vec<Photon> {
        let own = match &self.photons {
            Photons::Balls(_) => 1.0,
            Photons::Sheets(sheets) => sheets.weight_of_own(one_in),
        };
        let of = |memory: &mut PointMemory, (index, &(position, normal)): (usize, &(Vec3, PackedNormal))| {
            let direction = normal.unpacked();
            let place = Place { point: position.as_dvec3(), normal: direction.as_dvec3() };
            // Only turns the pattern of probes.
            let mut stream = Stream::new(0, Purpose::Map, index as u64, 0);
            let (irradiance, radius, cut) = match &self.photons {
                Photons::Balls(balls) => balls.irradiance(scene, place, &mut stream, memory),
                Photons::Sheets(sheets) => sheets.irradiance(scene, place, own, &mut stream, memory),
            };
            Photon { position, direction: radius * direction, power: irradiance.as_vec3(), events: cut.into(), normal }
        };
        places.par_iter().enumerate().map_init(PointMemory::default, of).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Over the unit disc, every filter has a mean of 1, and none is below 0.
    #[test]
    fn filters_are_normalised() {
        const N: usize = 100_000;
        for filter in [SurfaceFilter::None, SurfaceFilter::Cone, SurfaceFilter::Gaussian] {
            let weights = (0..N).map(|i| f64::from(filter.weight((i as f32 + 0.5) / N as f32)));
            assert!(weights.clone().all(|weight| weight >= 0.0));
            let mean = weights.sum::<f64>() / N as f64;
            assert!((mean - 1.0).abs() < 1e-4, "{filter:?}: {mean}");
            let within =
                (0..N / 4).map(|i| f64::from(filter.weight((i as f32 + 0.5) / N as f32))).sum::<f64>() / N as f64;
            assert!((filter.within(0.25) - within).abs() < 1e-4, "{filter:?}: {within}");
        }
    }
}
