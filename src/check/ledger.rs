//! The energy of the light: what is emitted is absorbed, escapes, or is left when a walk is given up; no surface gives more than it
//! gets, and photons bring to each medium what is scattered there.

use super::halt::Halt;
use super::judge::{ALPHA, percent};
use super::names::Names;
use super::probe::{Ledger, Prober};
use super::report::{Outcome, Row};
use super::statistics::{Mean, student_quantile};
use crate::light::Light;
use crate::photon::{self, Sources, leaves_out_deep};
use crate::scene::description::SingleScattering;
use crate::scene::{Scene, Settings};
use crate::transport::Events;
use crate::{Error, Result};

/// Walks from what shines.
const WALKS: u64 = 40_000;
/// Roundings of sums are shares of what was added: for each addition some 10⁻¹⁶, at random.
const ROUNDING: f64 = 1e-11;
/// Passes of photons, and about how many each holds.
const PASSES: u64 = 8;
const PHOTONS: u64 = 20_000;
/// What photons bring may differ by this share beside its noise: powers are 32-bit numbers.
const SLACK: f64 = 0.01;
/// A surface that gives back more than it gets is told of from this share on: shading normals move some light.
const GAIN: f64 = 0.05;

/// Standard errors that hardly any of so many sums of many walks is off by.
fn errors(tests: usize) -> f64 {
    student_quantile(ALPHA / tests.max(1) as f64, 1e6)
}

/// The rows of the ledger.
///
/// # Errors
/// As [`photon::trace`].
pub fn rows(
    (scene, names, settings): (&Scene, &Names<'_>, &Settings),
    prober: &Prober<'_>,
    (halt, seconds): (&Halt<'_>, f64),
) -> Result<Vec<Row>> {
    let stop = &|| halt.is_over();
    const BALANCE: &str = "energy: emitted = absorbed + escaped + left";
    let sources = Sources::new(scene);
    if sources.is_empty() {
        return Ok(vec![Row::not_applicable(BALANCE, "nothing shines")]);
    }
    let mut ledger = Ledger::new(scene);
    halt.allow(seconds);
    prober.lights((&sources, 0), WALKS, Some(&mut ledger), stop);
    if ledger.walks < WALKS / 40 {
        return Ok(vec![Row::not_applicable(BALANCE, "walks are too long for the time: allow more --time")]);
    }
    let powers = ledger.powers;
    let off = powers.emitted - powers.absorbed - powers.escaped - powers.left;
    let share = off.abs() / powers.moved.max(powers.emitted).max(f64::MIN_POSITIVE);
    let of = |power: f64| percent(power / powers.emitted);
    let outcome = if share <= ROUNDING { Outcome::Pass } else { Outcome::Fail };
    let found = format!(
        "{} absorbed + {} escaped + {} left, of {} walks; {share:.1e} unaccounted for",
        of(powers.absorbed),
        of(powers.escaped),
        of(powers.left),
        ledger.walks
    );
    let mut rows = vec![Row::new(BALANCE, outcome, found).with(share), emission(scene, &ledger), gains(names, &ledger)];
    halt.go_on()?;
    halt.allow(seconds);
    rows.push(photons((scene, names, settings), &ledger, stop)?);
    Ok(rows)
}

/// Whether walks start with the power that lights have.
fn emission(scene: &Scene, ledger: &Ledger) -> Row {
    const TEST: &str = "energy: sources emit what lights say";
    let dimmed = scene.world.is_some() && scene.lights.iter().any(Light::is_infinite);
    if dimmed || !scene.glows.is_empty() {
        let why = if dimmed { "light from infinity is lost in the world's medium" } else { "media glow" };
        return Row::not_applicable(TEST, format!("{why}: there is no power to compare with"));
    }
    let said: f64 = scene.lights.iter().map(|light| light.power(&scene.surroundings).element_sum()).sum();
    let (found, error) = ledger.emitted.mean(ledger.walks);
    let off = found / said - 1.0;
    let allowed = errors(1) * error / said + 1e-6;
    let outcome = if off.abs() <= allowed { Outcome::Pass } else { Outcome::Fail };
    Row::new(TEST, outcome, format!("{off:+.1e} of the power, {allowed:.1e} by chance")).with(off)
}

/// Whether any surface gives more than it gets.
fn gains(names: &Names<'_>, ledger: &Ledger) -> Row {
    const TEST: &str = "energy: no surface gives more than it gets";
    let errors = errors(ledger.shapes.len());
    let (mut worst, mut which) = (0.0, None);
    for (id, (taken, got)) in (0..).zip(ledger.shapes.iter().zip(&ledger.arriving)) {
        let ((taken, error), (got, _)) = (taken.mean(ledger.walks), got.mean(ledger.walks));
        if got > 0.0 && taken < -errors * error && -taken / got > worst {
            (worst, which) = (-taken / got, Some(id));
        }
    }
    let worst_of = |id| format!("{} gives back {} more than it gets", names.shape(id), percent(worst));
    let (outcome, found) = match which {
        Some(id) if worst > GAIN => (Outcome::Fail, worst_of(id)),
        Some(id) => (Outcome::Pass, format!("{}, as its shading normals may", worst_of(id))),
        None => (Outcome::Pass, "none does".to_string()),
    };
    Row::new(TEST, outcome, found).with(worst)
}

/// Whether photons bring to each medium what is scattered there.
fn photons(
    (scene, names, settings): (&Scene, &Names<'_>, &Settings),
    ledger: &Ledger,
    stop: &(impl Fn() -> bool + Sync),
) -> Result<Row> {
    const TEST: &str = "energy: photons bring what media scatter";
    if !scene.media.iter().any(|medium| medium.scatters()) {
        return Ok(Row::not_applicable(TEST, "no medium scatters"));
    }
    if settings.render.max_depth > 0 {
        return Ok(Row::not_applicable(TEST, "events are limited, and both count them otherwise"));
    }
    let mut passes: Vec<Vec<f64>> = Vec::new();
    for index in 0..PASSES {
        let pass = photon::Pass {
            seed: settings.render.seed,
            index: u64::MAX - index,
            target: PHOTONS,
            max_emitted: settings.photons.max_emitted.min(100 * PHOTONS),
            emission: photon::Emission { aims: settings.photons.projection, by: settings.photons.emission },
            max_events: Events::unlimited(),
            single_scattering: SingleScattering::Photons,
            importons: None,
            control: None,
        };
        let traced = match photon::trace(scene, &pass, &|_, _| {}, stop) {
            Ok(_) if stop() => break,
            Err(Error::Limit(why)) => return Ok(Row::not_applicable(TEST, why)),
            traced => traced?,
        };
        let mut powers = vec![0.0; scene.media.len()];
        for photon in traced.regions.iter().flatten() {
            let p = photon.position.as_dvec3();
            let Some(medium) = scene.medium(&scene.inside(p)) else { continue };
            // Along flights through uneven matter they tell what is scattered where the density is 1, by volume.
            let of = &scene.media[medium as usize];
            let density = if scene.uneven(medium).is_some() { of.density.at(p) } else { 1.0 };
            let factor = of.phase.factor(photon.direction.as_dvec3());
            powers[medium as usize] += photon.power.as_dvec3().element_sum() * density / factor;
        }
        passes.push(powers);
    }
    if passes.len() < 4 {
        return Ok(Row::not_applicable(TEST, "there was no time for photons: allow more --time"));
    }
    let quantile = student_quantile(ALPHA / scene.media.len() as f64, passes.len() as f64 - 1.0);
    let (mut compared, mut worst, mut fault) = (0, 0.0f64, None);
    for (index, scattered) in (0..).zip(&ledger.scattered) {
        let (truth, error) = scattered.mean(ledger.walks);
        let own = Mean::of(passes.iter().map(|powers| powers[index as usize]));
        let known = truth > 20.0 * error || (truth == 0.0 && own.value == 0.0);
        if !scene.media[index as usize].scatters() || leaves_out_deep(scene, index) || !known {
            continue;
        }
        compared += 1;
        let allowed = quantile * (own.variance + error * error).sqrt() + SLACK * truth;
        let off = own.value - truth;
        if off.abs() > allowed {
            fault.get_or_insert(format!(
                "to medium {} they bring {:+.1} % of what it scatters too much; {} are allowed",
                names.medium(index),
                100.0 * off / truth,
                percent(allowed / truth)
            ));
        }
        worst = worst.max(off.abs() / truth.max(f64::MIN_POSITIVE));
    }
    Ok(match fault {
        Some(fault) => Row::new(TEST, Outcome::Fail, fault).with(worst),
        None if compared == 0 => Row::not_applicable(
            TEST,
            "media keep the photons near their surfaces only, or hardly any light comes to them",
        ),
        None => Row::new(TEST, Outcome::Pass, format!("to {} within {compared} media", percent(worst))).with(worst),
    })
}
