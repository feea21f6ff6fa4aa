//! Where photons are stored: the one place that decides which, by how they came.

use super::history::{History, Since};
use super::{PackedNormal, Photon};
use crate::math::{DVec3, Rgb, Stream};
use crate::medium::Medium;
use crate::scene::Scene;
use crate::scene::description::{Projection, SingleScattering};
use crate::transport::Collision;

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
    /// The share of photons that are kept.
    pub keep: f64,
}

impl<'s> VolumeQuota<'s> {
    /// All photons, but for those deep in thick media of one density, and for light that lights are asked for.
    pub fn new(scene: &'s Scene, single_scattering: SingleScattering) -> Self {
        let extent = scene.bounds().diagonal();
        let deep = |medium: &Medium| {
            let extinction = medium.extinction.min_element();
            (medium.density.is_even() && extinction * extent > THICK).then_some(extinction)
        };
        VolumeQuota { scene, single_scattering, deep: scene.media.iter().map(deep).collect(), keep: 1.0 }
    }

    /// Whether a medium is of one density, and many mean free paths thick.
    pub fn is_deep(&self, medium: u32) -> bool {
        self.deep[medium as usize].is_some()
    }

    /// Whether any medium is.
    pub fn any_is_deep(&self) -> bool {
        self.deep.iter().any(Option::is_some)
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

/// The photons that collisions leave for the volume map.
#[derive(Debug, Default)]
pub(super) struct VolumeSink {
    /// With the region that each lies in.
    pub photons: Vec<(u32, Photon)>,
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
            None => stored = stored && (keep >= 1.0 || stream.uniform() < keep),
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
            self.photons.push((quota.scene.region(at.inside), photon));
        }
        clearance
    }

    /// Begins another photon.
    pub fn next(&mut self) {
        self.unasked = 0;
    }
}
