//! Where photons are stored: the one place that decides which, by how they came.

use super::history::{History, Since};
use super::importance::Importance;
use super::{PackedNormal, Photon};
use crate::math::{DVec3, Rgb, Stream, Vec3};
use crate::medium::Medium;
use crate::medium::density::Coarse;
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
/// Near surfaces, the distance to them is asked for once in so many collisions: it saves more only where it is long.
const SELDOM_ASKED: u32 = 8;

/// What the volume map stores.
#[derive(Debug)]
pub(super) struct VolumeQuota<'s> {
    scene: &'s Scene,
    /// Who finds light that is scattered once: what lights are asked for is not stored.
    single_scattering: SingleScattering,
    /// By medium, the extinction that tells how deep a length is; `None` where all photons are kept.
    deep: Vec<Option<f64>>,
    /// By medium, about how dense it is where photons lie along flights, not at collisions.
    uneven: Vec<Option<&'s Coarse>>,
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
        VolumeQuota {
            scene,
            single_scattering,
            deep: scene.media.iter().map(deep).collect(),
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
    fn wants(&self, history: History) -> bool {
        let asked = match history.since {
            Since::Straight => true,
            Since::Refracted => self.single_scattering.goes_straight_on(),
            Since::Other => false,
        };
        !(asked && history.from_light && self.single_scattering.asks_lights())
    }

    /// The share of photons at `p` to keep: rays that gather light begin at surfaces and at the camera, and what is
    /// deeper than a mean free path below these is seen by its transmittance. Photons kept carry the power of the
    /// others. `clearance` is how far the nearest surface is, at least, before and afterwards.
    fn seen(&self, p: DVec3, extinction: f64, clearance: &mut f64) -> f64 {
        let deepest = DEEPEST / extinction;
        if *clearance < deepest {
            // Twice as far, so that this need not be asked soon again.
            *clearance = self.scene.geometry.clearance(p, 2.0 * deepest);
        }
        let camera = &self.scene.camera;
        let from_camera = match camera.projection {
            Projection::Perspective => p.distance(camera.position) - camera.aperture,
            Projection::Orthographic => (p - camera.position).dot((camera.target - camera.position).normalize()).abs(),
        };
        let depth = extinction * clearance.min(from_camera).clamp(0.0, deepest);
        (KEPT - depth).min(0.0).exp()
    }
}

/// Whether photons deep in a medium are left out of the volume map, as they are not seen: it does not hold all light.
pub(crate) fn leaves_out_deep(scene: &Scene, medium: u32) -> bool {
    VolumeQuota::new(scene, SingleScattering::Photons).is_deep(medium)
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
    /// For so many collisions near surfaces the distance to these is not asked for.
    unasked: u32,
}

impl VolumeSink {
    /// Stores a photon where it collides, if the map wants it: `power` is what it scatters. Returns how far the nearest surface
    /// is, at least, where that is worth knowing.
    pub fn deposit(
        &mut self,
        quota: &VolumeQuota<'_>,
        at: &Collision<'_>,
        (events, history): (u64, History),
        power: Rgb,
        stream: &mut Stream,
    ) -> Option<f64> {
        let mut keep = quota.keep;
        let mut stored = quota.wants(history) && power.max_element() > 0.0;
        let mut clearance = None;
        match quota.deep[at.index as usize] {
            None => {
                if let Some(importance) = quota.importance.as_ref().filter(|_| stored) {
                    keep *= importance.keep(at.point.as_vec3());
                }
                stored = stored && (keep >= 1.0 || stream.uniform() < keep);
            }
            // Deep down, transmittance tells what counts.
            Some(extinction) => {
                // To ask for the surface takes longer than all else: not for photons that would not be kept anyway,
                // and for the sake of the walk only where it may be far.
                let mut clear = at.clearance;
                let chance = stream.uniform();
                stored &= chance < keep;
                let near = clear * extinction < KEPT;
                if stored || near && self.unasked == 0 {
                    keep *= quota.seen(at.point, extinction, &mut clear);
                    stored &= chance < keep;
                    self.unasked = if clear * extinction < KEPT { SELDOM_ASKED } else { 0 };
                } else if near {
                    self.unasked -= 1;
                }
                clearance = Some(clear);
            }
        }
        if stored {
            let photon = Photon {
                position: at.point.as_vec3(),
                direction: at.direction.as_vec3(),
                power: (power / keep).as_vec3(),
                events: events.min(255) as u8,
                normal: PackedNormal::default(),
            };
            self.push(quota, quota.scene.region(at.inside), photon, photon.power);
        }
        clearance
    }

    /// Stores photons along a flight through a medium of uneven density, which ends at `end`, if the map wants them: `power`
    /// is what comes to a place on it.
    ///
    /// Power Φ that passes over a length adds as much to the fluence there, whether it collides or not: points at a rate λ per
    /// length, with Φ/λ each, add up to the fluence in a volume (a track-length estimate; Spanier 1966). They are stored with
    /// σ_s Φ/λ, where σ_s is that of density 1, and count ρ times on rays that pass where the density is ρ. So fluence is what
    /// they blur, and light is scattered only where there is matter. The rate is the extinction of the [`Coarse`] density: about
    /// as many as collide, and none by its density counts far more than others; of a flight through one cell, [`MOST_IN_A_PIECE`] at most.
    pub fn deposit_along(
        &mut self,
        quota: &VolumeQuota<'_>,
        (flight, end): (&Segment<'_>, f64),
        (events, history): (u64, History),
        power: impl Fn(f64) -> Rgb,
        stream: &mut Stream,
    ) {
        let Some(coarse) = quota.uneven[flight.medium as usize].filter(|_| quota.wants(history)) else { return };
        let medium = &quota.scene.media[flight.medium as usize];
        let region = quota.scene.region(flight.inside);
        let most = quota.rate * quota.keep * medium.extinction.max_element();
        let mut next = stream.exponential();
        coarse.pieces(flight.ray, (flight.a, end), |from, to, density| {
            let rate = (most * density).min(MOST_IN_A_PIECE / (to - from));
            let mut t = from;
            while t + next / rate < to {
                t += next / rate;
                next = stream.exponential();
                let (scattered, position) = (power(t) * medium.albedo, flight.ray.at(t).as_vec3());
                let mut rate = rate;
                if let Some(importance) = &quota.importance {
                    let share = importance.keep(position);
                    if stream.uniform() >= share {
                        continue;
                    }
                    rate *= share;
                }
                let photon = Photon {
                    position,
                    direction: flight.ray.direction.as_vec3(),
                    power: (scattered * medium.extinction / rate).as_vec3(),
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
        if quota.notes {
            self.powers.push(f64::from(scattered.element_sum()));
        }
        self.stored += 1;
        if !quota.counts || quota.notes {
            self.photons.push((region, photon));
        }
    }

    /// Begins another photon.
    pub fn next(&mut self) {
        self.unasked = 0;
    }
}
