//! Pilots: a few photons that tell how the others are to be emitted, before any of them is stored.
//!
//! How many to emit must be settled beforehand: a count that depended on the photons themselves would be biased. A pilot counts
//! what some emissions yield; what it finds may change how photons are emitted, and then another pilot counts anew. In this
//! order:
//!
//! 1. *Bare*: lights emit in proportion to power, in all directions.
//! 2. *Aimed*, where few emissions collide: most photons are aimed at solids that scatter, from lights and from the diffuse
//!    surfaces around them.
//! 3. *Evened out*, where media are deep: sources are drawn so that photons enter with about the same power, and those that differ
//!    are split or left to roulette.
//! 4. *Important*, where that is asked for: sources are drawn for what is seen, and photons are kept by how much they count there.
//! 5. *Dense along flights*, where media are uneven, and flights leave few photons in them.
//! 6. *Forced*, where hardly any collides even so: first collisions are no matter of chance.
//! 7. *Counted*: longer pilots, as long as too few photons tell the yield.
//!
//! Where photons are to be emitted as lights shine, none are aimed, and sources are not evened out.

use super::Photon;
use super::budget;
use super::importance::{Importance, Useful};
use super::tracer::{Chunk, Entry, Tracer};
use crate::math::random::Purpose;

/// Emissions of the pilot that tells the yield; more where they store fewer photons than [`TELLING`].
const PILOTS: [u64; 3] = [1 << 12, 1 << 16, 1 << 20];
/// Emissions of a pilot that tells where photons lie.
const PLACES: u64 = 1 << 14;
/// A pilot that stores so many photons tells enough.
const TELLING: u64 = 64;
/// Where fewer emissions than this share collide, photons are aimed at what they may collide in.
const SELDOM: f64 = 0.2;
/// Where fewer emissions than this share collide, first collisions are forced.
const RARE: f64 = 0.01;
/// Sources are evened out for deep media where these are entered more often than this, for each emission that collides anywhere: else most
/// photons are of other media, to which other sources may matter.
const MOSTLY_DEEP: f64 = 0.5;
/// Photons of one walk through a deep medium lie near one another, and many of them are hardly more than one. So more are
/// emitted, and about one is kept of each walk, as in solids of uneven density where walks leave more than this many each.
const MANY: f64 = 8.0;
/// To thin walks takes no more than so many times the emissions,
const MOST_MORE: f64 = 8.0;
/// and no more than so many collisions for each photon kept: beyond, tracing would cost more than all the rest.
const MOST_COLLISIONS: f64 = 32.0;
/// An emission costs about as much as so many collisions.
const EMISSION: f64 = 8.0;

/// Where emissions leave fewer photons than this along flights through uneven media, these leave more,
const SPARSE: f64 = 0.5;
/// but no more than so many times as many as collide.
const MOST_ALONG: f64 = 1e4;

/// What a pilot's emissions came to.
#[derive(Clone, Copy, Debug)]
pub(super) struct Yield {
    /// How many there were.
    pub emitted: u64,
    /// The share of them that collided.
    pub collided: f64,
    /// Photons stored.
    pub stored: u64,
    /// How many times more photons to emit than are needed to fill the map: see [`MANY`].
    pub surplus: f64,
    /// Events of each.
    pub events: f64,
    /// Collisions of each.
    pub collisions: f64,
}

/// Finds how photons are to be emitted, and what that yields.
pub(super) fn prepare(tracer: &mut Tracer<'_>, stop: &(impl Fn() -> bool + Sync)) -> Yield {
    let deep = tracer.quota.any_is_deep();
    tracer.quota.counts = true;
    let run = |tracer: &Tracer<'_>, count: u64| tracer.run(Purpose::Pilot, (0..count, count), &|_, _| {}, stop);
    let many = if deep {
        0.0
    } else if tracer.has_uneven_solids() {
        MANY
    } else {
        f64::INFINITY
    };
    let count = |tracer: &Tracer<'_>, emitted: u64| {
        let before = tracer.budget.events();
        let chunks = run(tracer, emitted);
        Yield::of(&chunks, (emitted, tracer.budget.events() - before), many)
    };

    // Where walks are very long, a few of them tell enough.
    let each = tracer.budget.events_of_each(|emitted| drop(run(tracer, emitted)));
    let few = budget::pilot(PILOTS[0], each);

    // Bare.
    let mut found = count(tracer, few);

    // Aimed.
    let aims = tracer.pass.emission.aims;
    if aims && tracer.sources.aim_through_air() {
        found = count(tracer, few);
    } else if aims && found.collided < SELDOM {
        tracer.sources.aim();
        tracer.quota.notes = true;
        tracer.typical = median(run(tracer, few).into_iter().flat_map(|chunk| chunk.volume.powers).collect());
        tracer.quota.notes = false;
        found = count(tracer, few);
    }

    // Evened out.
    if deep {
        tracer.entry = Entry::Noted;
        let entering = |tracer: &Tracer<'_>| -> Vec<(u32, f64)> {
            run(tracer, few).into_iter().flat_map(|chunk| chunk.entering).collect()
        };
        if aims {
            let entering = entering(tracer);
            let collided = found.collided * found.emitted as f64;
            if entering.len() >= TELLING as usize && entering.len() as f64 > MOSTLY_DEEP * collided {
                tracer.sources.even_out(&entering);
            }
        }
        let portion = middle_of_power(entering(tracer).into_iter().map(|(_, power)| power).collect());
        tracer.entry = portion.map_or(Entry::Free, Entry::Portioned);
        // What is weaker would not enter.
        if let Some(typical) = &mut tracer.typical {
            *typical = portion.map_or(*typical, super::tracer::least_to_enter);
        }
        found = count(tracer, few);
    }

    // Important.
    if let Some(importons) = tracer.pass.importons {
        tracer.quota.notes = true;
        let places_pilot = budget::pilot(PLACES, each);
        let pilot = |tracer: &Tracer<'_>| run(tracer, places_pilot);
        let places = |chunks: &[Chunk]| Importance::new(importons, photons(chunks).map(|photon| photon.position));
        let bare = pilot(tracer);
        if let Some(importance) = places(&bare).filter(|_| aims) {
            let origins = bare.iter().flat_map(|chunk| &chunk.origins);
            let useful: Vec<Useful> = importance.useful(photons(&bare).zip(origins.copied())).collect();
            tracer.sources.favour(&useful);
        }
        tracer.quota.importance = places(&pilot(tracer));
        tracer.quota.notes = false;
        found = count(tracer, places_pilot);
    }

    // Dense along flights.
    let asked = tracer.pass.single_scattering.asks_lights();
    while tracer.quota.all_are_uneven() && !asked && !stop() {
        let share = found.stored.max(1) as f64 / found.emitted as f64;
        let rate = tracer.quota.rate / share;
        if share > SPARSE || rate > MOST_ALONG {
            break;
        }
        tracer.quota.rate = rate;
        found = count(tracer, few);
    }

    // Forced.
    if found.collided < RARE {
        tracer.forced = true;
        // Small media far from the light.
        for emitted in PILOTS {
            found = count(tracer, budget::pilot(emitted, found.events));
            if found.stored >= TELLING || stop() {
                break;
            }
        }
    }

    // Counted: what is left to shadow rays may be nearly all.
    if asked {
        for emitted in PILOTS.map(|emitted| budget::pilot(emitted, found.events)) {
            if found.stored < TELLING && emitted > found.emitted && !stop() {
                found = count(tracer, emitted);
            }
        }
    }
    tracer.quota.counts = false;
    found
}

impl Yield {
    /// What the chunks of `emitted` photons hold, that took so many events. Walks that leave more than `many` photons each are thinned.
    fn of(chunks: &[Chunk], (emitted, events): (u64, u64), many: f64) -> Yield {
        let sum = |of: &dyn Fn(&Chunk) -> u64| chunks.iter().map(of).sum::<u64>();
        let stored = sum(&|chunk| chunk.volume.stored);
        let (storing, collisions) = (sum(&|chunk| chunk.storing), sum(&|chunk| chunk.collisions));
        let correlated = stored as f64 / storing.max(1) as f64;
        let affordable = MOST_COLLISIONS * stored as f64 / (collisions as f64 + EMISSION * emitted as f64);
        let surplus = if correlated < many { 1.0 } else { correlated.min(affordable).clamp(1.0, MOST_MORE) };
        let share = |count: u64| count as f64 / emitted as f64;
        let (collided, events) = (share(sum(&|chunk| chunk.collided)), share(events));
        Yield { emitted, collided, stored, surplus, events, collisions: share(collisions) }
    }
}

/// The photons of chunks.
fn photons(chunks: &[Chunk]) -> impl Iterator<Item = &Photon> {
    chunks.iter().flat_map(|chunk| &chunk.volume.photons).map(|(_, photon)| photon)
}

/// The median of powers.
fn median(mut powers: Vec<f64>) -> Option<f64> {
    let middle = powers.len() / 2;
    (!powers.is_empty()).then(|| *powers.select_nth_unstable_by(middle, f64::total_cmp).1)
}

/// The power up to which photons carry half of all.
fn middle_of_power(mut powers: Vec<f64>) -> Option<f64> {
    powers.sort_unstable_by(f64::total_cmp);
    let half = 0.5 * powers.iter().sum::<f64>();
    let mut sum = 0.0;
    powers.into_iter().find(|power| {
        sum += power;
        sum >= half
    })
}
