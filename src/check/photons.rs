//! Photon maps of a scene, as it asks for them and otherwise, each with the radii that it has and with half of them.

use super::bench::{Bench, FEWEST, Series};
use super::halt::seconds_of_threads;
use super::judge::{Blurred, Side, biased, percent};
use super::report::{Outcome, Row};
use crate::photon::{Ball, Radius};
use crate::render::{self, Camera, Limits, Plan, SharedPhotons};
use crate::scene::Settings;
use crate::scene::description::{Estimate, Indirect, Kernel, Method, SingleScattering};
use crate::{Error, Result};

/// The most photons in a map, for each minute that the check may take.
const PHOTONS: f64 = 60_000.0;
/// Pictures of each.
const SEEDS: usize = 6;
/// An adaptive radius is halved where it covers so many times fewer photons: in space, and on a surface.
const IN_SPACE: u32 = 8;
const ON_SURFACES: u32 = 4;
/// No radius is found from fewer photons.
const FEWEST_NEIGHBOURS: u32 = 8;
/// Radii that move more of the light than this share blur a picture too much to be believed.
const BLURRED: f64 = 0.25;
/// So do blocks of one picture that differ from those of the next by more than this.
const NOISY: f64 = 0.25;

/// A way to gather photons.
pub struct Variant {
    /// What it is called.
    pub name: &'static str,
    wide: Settings,
    narrow: Settings,
    /// Pictures of both.
    pub series: Option<(Series, Series)>,
}

/// Ways to gather the photons of a scene, its own first.
///
/// # Errors
/// As [`Plan::new`].
pub fn variants(bench: &Bench<'_>, minutes: f64) -> Result<Vec<Variant>> {
    let mut own = bench.settings.clone();
    own.render.method = Method::Photon;
    if own.volume.single_scattering == SingleScattering::Approximate {
        own.volume.single_scattering = SingleScattering::Traced;
    }
    let most = ((PHOTONS * minutes) as u64).max(1000);
    let wanted = render::volume_photons(bench.scene, &own);
    own.photons.volume = Some(if wanted > 0 { wanted.min(most) } else { most });
    own.photons.caustic = own.photons.caustic.map(|photons| photons.min(most));
    own.photons.global = own.photons.global.map(|photons| photons.min(most));
    let mut all = vec![variant(bench, "photons", own.clone())?];
    if wanted > 0 {
        let with = |estimate, kernel| {
            let mut settings = own.clone();
            (settings.volume.estimate, settings.volume.kernel) = (estimate, kernel);
            // What differs is in media: paths tell what surfaces send to one another soonest.
            if matches!(settings.surface.indirect, Indirect::FinalGather | Indirect::Map) {
                settings.surface.indirect = Indirect::Path;
            }
            settings
        };
        for (name, settings) in [
            ("beams, fixed radii", with(Estimate::Beam, Kernel::Fixed)),
            ("beams, adaptive radii", with(Estimate::Beam, Kernel::Variable)),
            ("points", with(Estimate::Point, own.volume.kernel)),
        ] {
            if settings.volume != own.volume {
                all.push(variant(bench, name, settings)?);
            }
        }
    }
    Ok(all)
}

fn variant(bench: &Bench<'_>, name: &'static str, wide: Settings) -> Result<Variant> {
    let camera = Camera::new(&bench.scene.camera, &wide.film);
    let plan = Plan::new(bench.scene, &wide, &camera, &Limits::default())?;
    let mut narrow = wide.clone();
    match plan.radius {
        Radius::Fixed(radius) => narrow.volume.radius = Some(0.5 * f64::from(radius)),
        Radius::Variable { neighbours, pilot, max_radius } => {
            let fewer = (neighbours / IN_SPACE).max(FEWEST_NEIGHBOURS.min(neighbours));
            narrow.volume.neighbours = Some(fewer);
            narrow.volume.pilot = narrow.volume.pilot.map(|_| pilot.min(fewer).max(5));
            narrow.volume.max_radius = Some(0.5 * f64::from(max_radius));
        }
    }
    let surface = &mut narrow.surface;
    surface.neighbours = (surface.neighbours / ON_SURFACES).max(FEWEST_NEIGHBOURS.min(surface.neighbours));
    surface.max_radius = Some(0.5 * f64::from(plan.global.max_radius));
    match plan.caustics.0 {
        crate::gather::Reach::Ball { ball: Ball::Fixed(radius), .. } => surface.radius = Some(0.5 * f64::from(radius)),
        crate::gather::Reach::Ball { ball: Ball::Nearest { max_radius, .. }, .. }
        | crate::gather::Reach::Sheets { max_radius, .. } => surface.caustic_radius = Some(0.5 * f64::from(max_radius)),
    }
    Ok(Variant { name, wide, narrow, series: None })
}

/// Pictures of some variants, as many as `seconds` allow.
///
/// # Errors
/// As [`Bench::shoot`].
pub fn shoot(bench: &Bench<'_>, variants: &mut [Variant], seconds: f64, most: usize) -> Result<()> {
    let start = seconds_of_threads();
    bench.halt.allow(seconds);
    let mut series: Vec<(Series, Series)> = variants.iter().map(|_| Default::default()).collect();
    for index in 0..SEEDS.min(most) {
        let Some(shots) = one(bench, variants, bench.seed(index))? else { break };
        for ((wide, narrow), (own, half)) in series.iter_mut().zip(shots) {
            wide.shots.push(own);
            narrow.shots.push(half);
        }
        let done = seconds_of_threads() - start;
        if done * (index as f64 + 2.0) / (index as f64 + 1.0) > seconds {
            break;
        }
    }
    for (variant, series) in variants.iter_mut().zip(series) {
        variant.series = (series.0.shots.len() >= FEWEST.min(most)).then_some(series);
    }
    Ok(())
}

type Pair = (super::bench::Shot, super::bench::Shot);

/// Pictures of one seed: all from the same photons. `None` if the clock ended them.
fn one(bench: &Bench<'_>, variants: &[Variant], seed: u64) -> Result<Option<Vec<Pair>>> {
    let of = |settings: &Settings| {
        let mut settings = settings.clone();
        settings.render.seed = seed;
        settings
    };
    let Some(first) = variants.first() else { return Ok(Some(Vec::new())) };
    let photons = if render::volume_photons(bench.scene, &first.wide) > 0 {
        match SharedPhotons::trace(bench.scene, &of(&first.wide), &bench.watch, bench.halt.flag()) {
            Err(Error::Interrupted) => {
                bench.halt.go_on()?;
                return Ok(None);
            }
            photons => Some(photons?),
        }
    } else {
        None
    };
    let shoot = |settings: &Settings| match &photons {
        Some(photons) => bench.shoot_shared(&of(settings), photons),
        None => bench.shoot(&of(settings)),
    };
    let mut pairs = Vec::new();
    for variant in variants {
        let (Some(wide), Some(narrow)) = (shoot(&variant.wide)?, shoot(&variant.narrow)?) else { return Ok(None) };
        pairs.push((wide, narrow));
    }
    Ok(Some(pairs))
}

/// A variant against unbiased pictures: of all light by paths, and of what is not seen in mirrors by light paths.
pub fn judged(variant: &Variant, judges: &[(&Side<'_>, bool)], misses: Option<&str>) -> Vec<Row> {
    let test = |judge: &str| format!("{} ↔ {judge}", variant.name);
    let Some((wide, narrow)) = &variant.series else {
        return vec![Row::not_applicable(test("path"), "there was no time for enough pictures: allow more --time")];
    };
    if judges.is_empty() {
        return vec![Row::not_applicable(test("path"), "there was no time for a judge: allow more --time")];
    }
    let of = |series: &Series, spread: bool| if spread { series.spread() } else { series.blocks() };
    judges
        .iter()
        .map(|(judge, spread)| {
            let (wide, narrow) = (of(wide, *spread), of(narrow, *spread));
            let photons = Blurred { name: variant.name, wide: &wide, narrow: &narrow, misses };
            biased(&test(judge.name), &photons, judge)
        })
        .collect()
}

/// How much the scene's own radii blur, and how noisy its pictures are, as `settings` ask for them.
pub fn quality(bench: &Bench<'_>, settings: &Settings, own: &Variant) -> Vec<Row> {
    const BLUR: &str = "photons: bias of their radii";
    const NOISE: &str = "photons: noise";
    let Some((wide, narrow)) = &own.series else {
        return vec![Row::not_applicable(BLUR, "there was no time for enough pictures: allow more --time")];
    };
    // A lamp that the camera sees, smaller than a pixel, is noise of its samples, and no photons' fault.
    let (sent, direct) = (wide.sent(), wide.direct());
    let (wide, narrow) = (wide.blocks(), narrow.blocks());
    if wide.level() <= 0.0 {
        return vec![Row::not_applicable(BLUR, "photons find no light")];
    }
    let photons = Blurred { name: own.name, wide: &wide, narrow: &narrow, misses: None };
    // A picture with more photons has narrower discs. Bias falls with the radius at least, and with its square at most; noise falls
    // with the root of the number at most, and with fixed numbers of neighbours hardly at all at worst. Of several maps any may be what matters.
    let mut asked = settings.clone();
    asked.render.method = Method::Photon;
    let maps = [render::volume_photons, render::caustic_photons, render::global_photons];
    let maps = maps.map(|of| [of(bench.scene, &asked), of(bench.scene, &own.wide)]);
    let (mut wanted, mut traced, mut few, mut many) = (0, 0, f64::INFINITY, 1.0f64);
    for [asked, taken] in maps.into_iter().filter(|[_, taken]| *taken > 0) {
        let more = (asked as f64 / taken as f64).max(1.0);
        (wanted, traced, few, many) = (wanted + asked, traced + taken, few.min(more), many.max(more));
    }
    let [few, many] = [few.min(many), many];
    let fixed = own.wide.volume.kernel == Kernel::Fixed && own.wide.volume.radius.is_some();
    let third = |more: f64| if fixed { 1.0 } else { more.powf(-1.0 / 3.0) };
    let (blur, noise) = (photons.blur(), sent.noise() / wide.level());
    let of = if many > 1.0 { format!(", by {traced} photons instead of {wanted}") } else { String::new() };
    let limited = |test: &str, [least, most]: [f64; 2], limit: f64, what: &str| {
        let outcome = match (least > limit, most > limit) {
            (true, _) => Outcome::Fail,
            (false, true) => Outcome::NotApplicable,
            (false, false) => Outcome::Pass,
        };
        let share =
            if most - least > 0.1 * most { format!("{} to {}", percent(least), percent(most)) } else { percent(most) };
        Row::new(test, outcome, format!("{share} {what}{of}; {} are too much", percent(limit))).with(most)
    };
    let scale = [many.sqrt().recip(), 1.0];
    let mut noisy = limited(NOISE, scale.map(|by| noise * by), NOISY, "between the blocks of one picture and the next");
    // What camera rays meet of lamps in mirrors and through glass is noise of theirs.
    if noisy.outcome == Outcome::Fail && direct.noise() / wide.level() * scale[0] <= NOISY {
        noisy.outcome = Outcome::NotApplicable;
        noisy.found +=
            "; it is in what is seen in mirrors and through glass, where glints of lamps are noise of samples";
    }
    vec![
        limited(
            BLUR,
            [blur * third(many).powi(2), blur * third(few)],
            BLURRED,
            "of the light, root mean square over blocks",
        ),
        noisy,
    ]
}
