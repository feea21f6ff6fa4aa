//! What things cost on this machine: a few small scenes are rendered, and each tells some of it.

use std::path::Path;
use std::sync::atomic::AtomicBool;
use std::time::Instant;

use super::Forecast;
use super::work::{Costs, Unit, Work};
use crate::Result;
use crate::render::{Limits, Silent, Stats, render};
use crate::scene;

/// A room with a lamp and some balls, without fog.
const ROOM: &str = include_str!("calibrate.toml");

/// Each probe is rendered so often; the least time counts.
const TIMES: usize = 3;
/// Costs are no more than so many times as high as typical ones, and no fewer times as low.
const FARTHEST: f64 = 30.0;

/// What a probe tells: how long a part of a render takes, by which items, and which of their units that depends on.
struct Told {
    seconds: fn(&Stats) -> f64,
    items: &'static [&'static str],
    units: &'static [Unit],
}

/// Probes, as changes of the room, and what they tell, given what those before have told.
const PROBES: [(&[&str], &[Told]); 3] = [
    (
        &["render.method=\"path\"", "world.medium=\"fog\"", "render.samples=8"],
        &[Told {
            seconds: |stats| stats.render_seconds,
            items: &["camera_paths"],
            units: &[Unit::Ray, Unit::Bounce, Unit::ShadowRay, Unit::Flight],
        }],
    ),
    (
        &["world.medium=\"fog\"", "surface.irradiance_cache=false", "render.samples=4"],
        &[
            Told {
                seconds: |stats| stats.photons_seconds,
                items: &["volume_photons", "global_photons", "caustic_photons"],
                units: &[Unit::Emission, Unit::Event, Unit::Wandering],
            },
            Told {
                seconds: |stats| stats.build_seconds,
                items: &["volume_map", "global_map", "caustic_map"],
                units: &[Unit::Photon, Unit::SurfacePhoton, Unit::Irradiance],
            },
            Told {
                seconds: |stats| stats.render_seconds,
                items: &["camera_paths"],
                units: &[Unit::Query, Unit::Block],
            },
        ],
    ),
    (
        &["surface.indirect=\"map\"", "render.samples=8"],
        &[Told { seconds: |stats| stats.render_seconds, items: &["camera_paths"], units: &[Unit::LookUp] }],
    ),
];

impl Costs {
    /// Measures costs on one thread of this machine: some seconds. `processor` tells how many of them the process has computed, where the system tells that:
    /// what others compute meanwhile does not count then.
    ///
    /// # Errors
    /// As [`render`].
    pub fn measure(processor: impl Fn() -> Option<f64>) -> Result<Costs> {
        let mut costs = Costs::TYPICAL;
        for (overrides, all_told) in PROBES {
            let overrides: Vec<String> = overrides.iter().map(ToString::to_string).collect();
            let (scene, settings) = scene::build(&scene::parse(ROOM, Path::new("calibrate.toml"), &overrides)?)?;
            let forecast = Forecast::new(&scene, &settings, &Limits::default(), None)?;
            let rendered = || -> Result<_> {
                let (start, before) = (Instant::now(), processor());
                let stats = render(&scene, &settings, &Silent, &AtomicBool::new(false))?.stats;
                let computed = processor().zip(before).map(|(after, before)| after - before);
                Ok((stats, computed.map_or(1.0, |computed| computed / start.elapsed().as_secs_f64())))
            };
            let renderings = (0..TIMES).map(|_| rendered()).collect::<Result<Vec<_>>>()?;
            for Told { seconds, items, units } in all_told {
                let took = renderings.iter().map(|(stats, busy)| busy * seconds(stats)).fold(f64::INFINITY, f64::min);
                let work: Work = items.iter().filter_map(|name| forecast.item(name)).map(|item| item.work).sum();
                costs = costs.told(&work, units, took);
            }
        }
        Ok(costs)
    }

    /// With other costs of these units, all by one factor, so that this work takes so many seconds.
    fn told(self, work: &Work, units: &[Unit], seconds: f64) -> Costs {
        let theirs = self.seconds(&work.only(units));
        let others = self.seconds(work) - theirs;
        if theirs <= 0.0 {
            return self;
        }
        self.dearer(units, ((seconds - others) / theirs).clamp(FARTHEST.recip(), FARTHEST))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A time is told by the units that it is put down to, given what the others cost.
    #[test]
    fn a_time_tells_costs() {
        let work = Work::of(&[(Unit::Ray, 1e6), (Unit::Query, 1e5), (Unit::Block, 1e7)]);
        let gathering = [Unit::Query, Unit::Block];
        let costs = Costs::TYPICAL.told(&work, &gathering, 2.0);
        assert!((costs.seconds(&work) - 2.0).abs() < 1e-9);
        assert_eq!(costs.of(Unit::Ray), Costs::TYPICAL.of(Unit::Ray));
        let growth = |unit| costs.of(unit) / Costs::TYPICAL.of(unit);
        assert!((growth(Unit::Query) / growth(Unit::Block) - 1.0).abs() < 1e-12);
    }
}
