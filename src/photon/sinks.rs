//! Where photons are stored: the one place that decides which, by how they came.

use super::history::{History, Since};
use super::importance::Importance;
use super::{PackedNormal, Photon};
use crate::math::{DVec3, Rgb, Stream, Vec3};
use crate::medium::Medium;
use crate::medium::density::Density;
use crate::scene::Scene;
use crate::scene::description::{Projection, SingleScattering};
use crate::transport::{Collision, Segment};

/// Flights leave about so many photons in a cell at most: one voxel that is a million times as dense as those around it makes its
/// cell seem dense, and what passes it by would leave millions.
const MOST_IN_A_PIECE: f64 = 16.0;

/// Scenes less thick than this many mean free paths need all their photons.
const THICK: f64 = 16.0;
/// Photons within this many mean free paths of where eye rays begin are all kept; deeper, as many as there is
/// transmittance.
const KEPT: f64 = 1.0;
/// However deep they are, no fewer photons are kept than at this many mean free paths.
const DEEPEST: f64 = 8.0;

/// What the volume map stores.
#[derive(Debug)]
pub(super) struct VolumeQuota<'s> {
    scene: &'s Scene,
    /// Who finds light that is scattered once: what lights are asked for is not stored.
    single_scattering: SingleScattering,
    /// By medium, the extinction that tells how deep a length is; `None` where all photons are kept.
    deep: Vec<Option<f64>>,
    /// Whether eye rays may begin in a deep medium, and not at its surface.
    looks_from_within: bool,
    /// By medium, its density where photons lie along flights, not at collisions.
    uneven: Vec<Option<&'s Density>>,
    /// The share of photons that are kept.
    pub keep: f64,
    /// How many lie along flights for each collision.
    pub rate: f64,
    /// How important places are, if photons are kept by that.
    pub importance: Option<Importance>,
    /// Whether photons' powers and origins are noted.
    pub notes: bool,
    /// Whether photons are only counted.
    pub counts: bool,
}

impl<'s> VolumeQuota<'s> {
    /// All photons, but for those deep in thick media of one density, and for light that lights are asked for.
    pub fn new(scene: &'s Scene, single_scattering: SingleScattering) -> Self {
        let extent = scene.bounds().diagonal();
        let deep = |medium: &Medium| {
            let extinction = medium.extinction.min_element();
            (medium.density.is_even() && extinction * extent > THICK).then_some(extinction)
        };
        let deep: Vec<Option<f64>> = scene.media.iter().map(deep).collect();
        let camera = &scene.camera;
        let around = scene.medium(&scene.inside(camera.position));
        let looks_from_within = deep.iter().any(Option::is_some)
            && (camera.projection == Projection::Orthographic
                || around.is_some_and(|medium| deep[medium as usize].is_some()));
        VolumeQuota {
            scene,
            single_scattering,
            deep,
            looks_from_within,
            uneven: (0..scene.media.len()).map(|medium| scene.uneven(medium as u32)).collect(),
            keep: 1.0,
            rate: 1.0,
            importance: None,
            notes: false,
            counts: false,
        }
    }

    /// Whether a medium is of one density, and many mean free paths thick.
    pub fn is_deep(&self, medium: u32) -> bool {
        self.deep[medium as usize].is_some()
    }

    /// The extinction that tells how deep a length is in a medium of one density, many mean free paths thick.
    pub fn deep(&self, medium: u32) -> Option<f64> {
        self.deep[medium as usize]
    }

    /// Whether any medium is.
    pub fn any_is_deep(&self) -> bool {
        self.deep.iter().any(Option::is_some)
    }

    /// Whether photons in a medium lie along flights, not at collisions.
    pub fn is_uneven(&self, medium: u32) -> bool {
        self.uneven[medium as usize].is_some()
    }

    /// Whether they do in all media that scatter.
    pub fn all_are_uneven(&self) -> bool {
        let mut media = self.uneven.iter().zip(&self.scene.media);
        media.all(|(uneven, medium)| uneven.is_some() || !medium.scatters())
    }

    /// Whether the map wants light that came so: not if lights are asked for it.
    pub fn wants(&self, history: History) -> bool {
        let asked = match history.since {
            Since::Straight => true,
            Since::Refracted => self.single_scattering.goes_straight_on(),
            Since::Other => false,
        };
        !(asked && history.from_light && self.single_scattering.asks_lights())
    }

    /// How many mean free paths beyond [`KEPT`] photons lie below the nearest surface, and before the camera, if that looks from within:
    /// rays that gather light begin there, and what is deeper is seen by its transmittance.
    fn beyond(&self, p: DVec3, extinction: f64, clearance: f64) -> f64 {
        let nearest = if self.looks_from_within { clearance.min(self.camera_distance(p)) } else { clearance };
        ((extinction * nearest).clamp(0.0, DEEPEST) - KEPT).max(0.0)
    }

    fn camera_distance(&self, p: DVec3) -> f64 {
        let camera = &self.scene.camera;
        match camera.projection {
            Projection::Perspective => p.distance(camera.position) - camera.aperture,
            Projection::Orthographic => (p - camera.position).dot((camera.target - camera.position).normalize()).abs(),
        }
    }
}

/// Pilots note no more photons than this of a chunk: a single walk in dense matter that loses nothing may leave a hundred million.
const MOST_NOTED: usize = 1 << 20;

/// Whether photons deep in a medium are left out of the volume map, as they are not seen: it does not hold all light.
pub(crate) fn leaves_out_deep(scene: &Scene, medium: u32) -> bool {
    VolumeQuota::new(scene, SingleScattering::Photons).is_deep(medium)
}

/// Where a photon collides.
pub(super) struct Place {
    /// The point.
    pub point: DVec3,
    /// What is kept of the direction of arrival, by `Phases::kept`.
    pub direction: DVec3,
    /// The region.
    pub region: u32,
    /// The events before.
    pub events: u64,
}

/// The photons that collisions and flights leave for the volume map.
#[derive(Debug, Default)]
pub(super) struct VolumeSink {
    /// With the region that each lies in.
    pub photons: Vec<(u32, Photon)>,
    /// How many there are, be they kept or only counted.
    pub stored: u64,
    /// What is scattered of the light that left them, in all channels together, while that is noted.
    pub powers: Vec<f64>,
}

impl VolumeSink {
    /// Stores a photon where it collides, if the map wants it: `power` is what it scatters.
    pub fn deposit(
        &mut self,
        quota: &VolumeQuota<'_>,
        at: &Collision<'_>,
        (events, history): (u64, History),
        power: Rgb,
        stream: &mut Stream,
    ) {
        let wanted = quota.wants(history) && power.max_element() > 0.0;
        // By what tells its phase function.
        let kept = |stream: &mut Stream| {
            let (direction, factor) = at.medium.phase.kept(at.point, at.direction, stream);
            (Place { point: at.point, direction, region: quota.scene.region(at.inside), events }, factor)
        };
        if let Some(extinction) = quota.deep[at.index as usize] {
            let least = || quota.scene.least_clearance(at.inside, at.point);
            let (place, factor) = kept(stream);
            let power = if wanted { power * factor } else { Rgb::ZERO };
            return self.deposit_deep(quota, &place, extinction, least, power, stream);
        }
        let mut keep = quota.keep;
        if let Some(importance) = quota.importance.as_ref().filter(|_| wanted) {
            keep *= importance.keep(at.point.as_vec3());
        }
        if wanted && (keep >= 1.0 || stream.uniform() < keep) {
            let (place, factor) = kept(stream);
            self.store(quota, &place, power / keep * factor);
        }
    }

    /// Stores a photon where it collides in a deep medium of this extinction: there transmittance tells what counts. `least` is how far
    /// the nearest surface is, at least.
    pub fn deposit_deep(
        &mut self,
        quota: &VolumeQuota<'_>,
        place: &Place,
        extinction: f64,
        least: impl FnOnce() -> f64,
        power: Rgb,
        stream: &mut Stream,
    ) {
        let chance = stream.uniform();
        if chance >= quota.keep || power.max_element() <= 0.0 {
            return;
        }
        // To ask for the surface takes longer than all else: not for photons that would not be kept however near it may be. Two terms of
        // e^x tell that of most.
        let x = quota.beyond(place.point, extinction, least());
        if chance * (1.0 + x * (1.0 + 0.5 * x)) < quota.keep {
            let clearance = quota.scene.geometry.clearance(place.point, DEEPEST / extinction);
            // Photons kept carry the power of the others.
            let keep = quota.keep * (-quota.beyond(place.point, extinction, clearance)).exp();
            if chance < keep {
                self.store(quota, place, power / keep);
            }
        }
    }

    fn store(&mut self, quota: &VolumeQuota<'_>, place: &Place, power: Rgb) {
        let photon = Photon {
            position: place.point.as_vec3(),
            direction: place.direction.as_vec3(),
            power: power.as_vec3(),
            events: place.events.min(255) as u8,
            normal: PackedNormal::default(),
        };
        self.push(quota, place.region, photon, photon.power);
    }

    /// Stores photons along a flight through a medium of uneven density, which ends at `end`, if the map wants them: `power`
    /// is what comes to a place on it.
    ///
    /// Power Φ that passes over a length adds as much to the fluence there, whether it collides or not: points at a rate λ per
    /// length, with Φ/λ each, add up to the fluence in a volume (a track-length estimate; Spanier 1966). They are stored with
    /// σ_s Φ/λ, where σ_s is that of density 1, and count ρ times on rays that pass where the density is ρ. So fluence is what
    /// they blur, and light is scattered only where there is matter. The rate is the extinction of the [coarse](Density::coarse) density: about
    /// as many as collide, and none by its density counts far more than others; of a flight through one cell, [`MOST_IN_A_PIECE`] at most.
    pub fn deposit_along(
        &mut self,
        quota: &VolumeQuota<'_>,
        (flight, end): (&Segment<'_>, f64),
        (events, history): (u64, History),
        power: impl Fn(f64) -> Rgb,
        stream: &mut Stream,
    ) {
        let Some(density) = quota.uneven[flight.medium as usize].filter(|_| quota.wants(history)) else { return };
        let medium = &quota.scene.media[flight.medium as usize];
        let region = quota.scene.region(flight.inside);
        let most = quota.rate * quota.keep * medium.extinction.max_element();
        let mut next = stream.exponential();
        density.coarse(flight.ray, (flight.a, end), |from, to, density| {
            let rate = (most * density).min(MOST_IN_A_PIECE / (to - from));
            let mut t = from;
            while t + next / rate < to {
                t += next / rate;
                next = stream.exponential();
                let point = flight.ray.at(t);
                let (scattered, position) = (power(t) * medium.albedo_at(point), point.as_vec3());
                let mut rate = rate;
                if let Some(importance) = &quota.importance {
                    let share = importance.keep(position);
                    if stream.uniform() >= share {
                        continue;
                    }
                    rate *= share;
                }
                let (direction, factor) = medium.phase.kept(point, flight.ray.direction, stream);
                let photon = Photon {
                    position,
                    direction: direction.as_vec3(),
                    power: (scattered * medium.extinction / rate * factor).as_vec3(),
                    events: events.min(255) as u8,
                    normal: PackedNormal::default(),
                };
                if photon.power.max_element() > 0.0 {
                    self.push(quota, region, photon, scattered.as_vec3());
                }
            }
            next -= (to - t) * rate;
        });
    }

    fn push(&mut self, quota: &VolumeQuota<'_>, region: u32, photon: Photon, scattered: Vec3) {
        self.stored += 1;
        let is_noted = quota.notes && self.photons.len() < MOST_NOTED;
        if is_noted {
            self.powers.push(f64::from(scattered.element_sum()));
        }
        if !quota.counts || is_noted {
            self.photons.push((region, photon));
        }
    }
}
