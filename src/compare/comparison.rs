//! A comparison ready to be made, and what was found of its variants so far.

use super::context::Context;
use super::figures::Standard;
use super::reference::Known;
use super::results::{Budgets, Reference, Region};
use super::store::{Run, Store};
use super::variant::Variant;
use crate::{Error, Result};

/// A variant with what was found of it.
pub struct Found {
    pub variant: Variant,
    pub limit: Option<Known>,
    /// Its runs, seed by seed.
    pub runs: Vec<Run>,
}

impl Found {
    pub fn new(variant: Variant) -> Found {
        Found { variant, limit: None, runs: Vec::new() }
    }
}

/// A comparison ready to be made.
pub struct Comparison<'c> {
    pub context: &'c Context<'c>,
    pub store: &'c Store,
    pub budgets: Budgets,
    pub regions: Vec<Region>,
    pub common: Option<Known>,
}

impl Comparison<'_> {
    pub fn seeds(&self) -> Vec<u64> {
        let first = self.context.base.render.seed;
        (0..u64::from(self.context.request.seeds.max(1))).map(|k| first.wrapping_add(k)).collect()
    }

    pub fn standard<'f>(&'f self, found: &'f Found) -> Held<'f> {
        Held(self.common.as_ref().or(found.limit.as_ref()))
    }
}

/// What errors of a variant are held against.
pub struct Held<'f>(pub Option<&'f Known>);

impl Held<'_> {
    pub fn facts(&self) -> Option<&Reference> {
        self.0.map(|known| &known.facts)
    }

    pub fn standard(&self) -> Result<&Standard> {
        self.0.map(|known| &known.standard).ok_or(Error::Interrupted)
    }
}
