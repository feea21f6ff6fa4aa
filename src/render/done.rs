//! Which passes a film holds.

use std::ops::RangeInclusive;

use serde::{Deserialize, Serialize};

/// Finished passes by seed. Passes count from 1.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Done {
    /// Seeds in ascending order, each with the passes that are done.
    seeds: Vec<Seed>,
}

#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
struct Seed {
    seed: u64,
    /// First and last passes, ascending, with gaps between.
    passes: Vec<(u32, u32)>,
}

/// Passes as a person says it.
pub fn range((first, last): (u32, u32)) -> String {
    if first == last { format!("pass {first}") } else { format!("passes {first} to {last}") }
}

impl Done {
    /// How many passes there are, of all seeds.
    pub fn count(&self) -> u64 {
        self.ranges().map(|(_, (first, last))| (last - first) as u64 + 1).sum()
    }

    /// The seeds, ascending.
    pub fn seeds(&self) -> impl Iterator<Item = u64> {
        self.seeds.iter().map(|seed| seed.seed)
    }

    /// Ranges of passes, first and last, with their seed.
    pub fn ranges(&self) -> impl Iterator<Item = (u64, (u32, u32))> {
        self.seeds.iter().flat_map(|seed| seed.passes.iter().map(|passes| (seed.seed, *passes)))
    }

    fn of(&self, seed: u64) -> &[(u32, u32)] {
        let at = self.seeds.binary_search_by_key(&seed, |seed| seed.seed);
        at.map_or(&[], |at| &self.seeds[at].passes)
    }

    /// Those of `passes` that are not among them, in order.
    pub fn missing(&self, seed: u64, passes: RangeInclusive<u32>) -> impl Iterator<Item = u32> + use<> {
        let done = self.of(seed).to_vec();
        passes.filter(move |pass| !done.iter().any(|(first, last)| (first..=last).contains(&pass)))
    }

    /// The last pass of a seed, if that is after `last`.
    pub fn beyond(&self, seed: u64, last: u32) -> Option<u32> {
        self.of(seed).last().map(|passes| passes.1).filter(|&pass| pass > last)
    }

    /// Adds a pass.
    pub fn insert(&mut self, seed: u64, pass: u32) {
        self.insert_range(seed, (pass, pass));
    }

    /// Adds all passes of others.
    pub fn merge(&mut self, other: &Done) {
        other.ranges().for_each(|(seed, passes)| self.insert_range(seed, passes));
    }

    fn insert_range(&mut self, seed: u64, passes: (u32, u32)) {
        let at = self.seeds.binary_search_by_key(&seed, |seed| seed.seed).unwrap_or_else(|at| {
            self.seeds.insert(at, Seed { seed, passes: Vec::new() });
            at
        });
        let ranges = &mut self.seeds[at].passes;
        ranges.push(passes);
        ranges.sort_unstable();
        // Neighbours become one.
        ranges.dedup_by(|next, last| {
            let joined = next.0 <= last.1.saturating_add(1);
            if joined {
                last.1 = last.1.max(next.1);
            }
            joined
        });
    }

    /// The first passes that both hold, with their seed.
    pub fn overlap(&self, other: &Done) -> Option<(u64, (u32, u32))> {
        self.ranges().find_map(|(seed, (first, last))| {
            let common = other.of(seed).iter().map(|other| (first.max(other.0), last.min(other.1)));
            common.filter(|(first, last)| first <= last).map(|passes| (seed, passes)).next()
        })
    }

    /// Whether it is as [`Done::insert`] leaves it: a file may claim anything.
    pub fn is_sound(&self) -> bool {
        let sound = |passes: &[(u32, u32)]| {
            passes.iter().all(|(first, last)| *first >= 1 && first <= last)
                && passes.windows(2).all(|pair| pair[0].1.checked_add(1).is_some_and(|next| next < pair[1].0))
        };
        self.seeds.windows(2).all(|pair| pair[0].seed < pair[1].seed)
            && self.seeds.iter().all(|seed| !seed.passes.is_empty() && sound(&seed.passes))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn passes_are_kept_as_ranges() {
        let mut done = Done::default();
        for pass in [3, 1, 7, 2, 8] {
            done.insert(5, pass);
        }
        done.insert(2, u32::MAX);
        assert!(done.is_sound());
        let ranges: Vec<_> = done.ranges().collect();
        assert_eq!(ranges, [(2, (u32::MAX, u32::MAX)), (5, (1, 3)), (5, (7, 8))]);
        assert_eq!(done.count(), 6);
        assert_eq!(done.missing(5, 1..=9).collect::<Vec<_>>(), [4, 5, 6, 9]);
        assert_eq!(done.missing(1, 1..=2).count(), 2);
        assert_eq!((done.beyond(5, 7), done.beyond(5, 8), done.beyond(1, 0)), (Some(8), None, None));

        let mut other = Done::default();
        other.insert(5, 4);
        assert_eq!(done.overlap(&other), None);
        other.insert(5, 7);
        assert_eq!((done.overlap(&other), other.overlap(&done)), (Some((5, (7, 7))), Some((5, (7, 7)))));
        done.merge(&other);
        assert_eq!(done.ranges().nth(1), Some((5, (1, 4))));

        let unsound = |text| !serde_json::from_str::<Done>(text).unwrap().is_sound();
        assert!(unsound(r#"{"seeds": [{"seed": 1, "passes": [[3, 2]]}]}"#));
        assert!(unsound(r#"{"seeds": [{"seed": 1, "passes": [[0, 2]]}]}"#));
        assert!(unsound(r#"{"seeds": [{"seed": 1, "passes": [[1, 2], [2, 3]]}]}"#));
        assert!(unsound(r#"{"seeds": [{"seed": 1, "passes": []}]}"#));
        assert!(unsound(r#"{"seeds": [{"seed": 2, "passes": [[1, 1]]}, {"seed": 2, "passes": [[2, 2]]}]}"#));
    }
}
