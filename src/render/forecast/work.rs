//! What a render has to do, counted, and what each of these things costs on a machine.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize, Serializer};

/// Things that a render does many times, and that cost about the same each time. What costs more the more there is of it, such as
/// a ray among many triangles, counts as so many of the simplest kind.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Unit {
    /// A photon or a light path is emitted.
    Emission,
    /// It is reflected, refracted, or collides.
    Event,
    /// It collides within a dense medium, far from surfaces.
    Wandering,
    /// A photon in a medium comes into its map: order, radius, hierarchy.
    Photon,
    /// The same on a surface.
    SurfacePhoton,
    /// The irradiance is computed at a photon.
    Irradiance,
    /// A ray looks for the next surface.
    Ray,
    /// A camera path is reflected, refracted, or collides.
    Bounce,
    /// A light is asked for light, with the ray that looks whether something is in its way.
    ShadowRay,
    /// A path or a photon passes an uneven medium.
    Flight,
    /// Light is gathered along a ray, or at a point of one.
    Query,
    /// Sixteen photons are tested for that.
    Block,
    /// Photons around a place on a surface are looked up.
    LookUp,
}

/// How many units there are.
const UNITS: usize = 13;

impl Unit {
    /// All units.
    pub const ALL: [Unit; UNITS] = [
        Unit::Emission,
        Unit::Event,
        Unit::Wandering,
        Unit::Photon,
        Unit::SurfacePhoton,
        Unit::Irradiance,
        Unit::Ray,
        Unit::Bounce,
        Unit::ShadowRay,
        Unit::Flight,
        Unit::Query,
        Unit::Block,
        Unit::LookUp,
    ];

    /// Its name.
    pub fn name(self) -> &'static str {
        match self {
            Unit::Emission => "emission",
            Unit::Event => "event",
            Unit::Wandering => "wandering",
            Unit::Photon => "photon",
            Unit::SurfacePhoton => "surface_photon",
            Unit::Irradiance => "irradiance",
            Unit::Ray => "ray",
            Unit::Bounce => "bounce",
            Unit::ShadowRay => "shadow_ray",
            Unit::Flight => "flight",
            Unit::Query => "query",
            Unit::Block => "block",
            Unit::LookUp => "look_up",
        }
    }
}

/// How long a part of some work took.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Timed {
    /// The part.
    pub work: Work,
    /// Seconds of one thread.
    pub seconds: f64,
}

impl Timed {
    /// A part of work, and how long it took, if that is known; `None` where it is too short for a clock that ticks a hundred times a second.
    pub fn new(work: Work, seconds: Option<f64>) -> Option<Timed> {
        let seconds = seconds.filter(|seconds| *seconds >= SHORTEST && !work.is_none())?;
        Some(Timed { work, seconds })
    }
}

/// Seconds that can be told from nothing by a clock that ticks a hundred times a second.
pub(super) const SHORTEST: f64 = 0.05;

/// Tells seconds that were computed, where the system does.
pub(super) type Clock<'a> = &'a dyn Fn() -> Option<f64>;

/// Does something, and tells how long that took.
pub(super) fn timed<T>(clock: Clock<'_>, what: impl FnOnce() -> T) -> (T, Option<f64>) {
    let start = clock();
    let result = what();
    (result, clock().zip(start).map(|(end, start)| end - start))
}

/// How often a render does each of these things, all passes together.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Work([f64; UNITS]);

impl Work {
    /// So many of some units.
    pub fn of(counts: &[(Unit, f64)]) -> Work {
        let mut work = Work::default();
        counts.iter().for_each(|(unit, count)| work.0[*unit as usize] += count);
        work
    }

    /// How many of a unit.
    pub fn count(&self, unit: Unit) -> f64 {
        self.0[unit as usize]
    }

    /// As often again so many times.
    pub fn times(self, factor: f64) -> Work {
        Work(self.0.map(|count| factor * count))
    }

    /// Of these units alone.
    pub(super) fn only(&self, units: &[Unit]) -> Work {
        units.iter().map(|unit| Work::of(&[(*unit, self.count(*unit))])).sum()
    }

    /// Whether there is nothing to do.
    pub fn is_none(&self) -> bool {
        self.0.iter().all(|count| *count <= 0.0)
    }
}

impl std::ops::Add for Work {
    type Output = Work;

    fn add(self, other: Work) -> Work {
        Work(std::array::from_fn(|unit| self.0[unit] + other.0[unit]))
    }
}

impl std::iter::Sum for Work {
    fn sum<I: Iterator<Item = Work>>(all: I) -> Work {
        all.fold(Work::default(), |sum, next| sum + next)
    }
}

impl Serialize for Work {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let done = Unit::ALL.into_iter().filter(|unit| self.count(*unit) > 0.0);
        serializer.collect_map(done.map(|unit| (unit.name(), self.count(unit).round())))
    }
}

/// What each unit costs: nanoseconds of one thread.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(try_from = "BTreeMap<String, f64>")]
pub struct Costs([f64; UNITS]);

impl Costs {
    /// Those that shares of time are told by where none were measured: of one machine, fitted to the scenes of `scenes/`.
    pub const TYPICAL: Costs =
        Costs([550.0, 400.0, 120.0, 1200.0, 800.0, 12_000.0, 250.0, 500.0, 700.0, 5000.0, 2000.0, 12.0, 3500.0]);

    /// What one of these costs.
    pub fn of(&self, unit: Unit) -> f64 {
        self.0[unit as usize]
    }

    /// Seconds of one thread that this work takes.
    pub fn seconds(&self, work: &Work) -> f64 {
        1e-9 * self.0.iter().zip(work.0).map(|(cost, count)| cost * count).sum::<f64>()
    }

    /// Seconds that work takes of which a part was done: as many times as long as that took as it costs more.
    pub(super) fn seconds_by(&self, work: &Work, part: Option<&Timed>) -> f64 {
        let dearness = part.map_or(1.0, |part| part.seconds / self.seconds(&part.work));
        dearness * self.seconds(work)
    }

    /// With these units so many times as dear.
    pub(super) fn dearer(mut self, units: &[Unit], factor: f64) -> Costs {
        units.iter().for_each(|unit| self.0[*unit as usize] *= factor);
        self
    }
}

impl Serialize for Costs {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_map(Unit::ALL.map(|unit| (unit.name(), self.of(unit))))
    }
}

impl TryFrom<BTreeMap<String, f64>> for Costs {
    type Error = String;

    fn try_from(named: BTreeMap<String, f64>) -> Result<Costs, String> {
        let mut costs = Costs::TYPICAL;
        for unit in Unit::ALL {
            match named.get(unit.name()) {
                Some(cost) if cost.is_finite() && *cost > 0.0 => costs.0[unit as usize] = *cost,
                Some(cost) => return Err(format!("{}: {cost} is no number of nanoseconds", unit.name())),
                None => return Err(format!("{} is missing", unit.name())),
            }
        }
        Ok(costs)
    }
}
