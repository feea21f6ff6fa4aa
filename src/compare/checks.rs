//! What can be refused of a comparison before anything is rendered.

use super::context::Context;
use super::request::Request;
use super::results::{BudgetKind, Budgets, Region};
use super::variant::{self, Tunable, Variant};
use crate::scene::description::Description;
use crate::scene::{StudyReference, StudyVariant};
use crate::{Error, Result};

/// The regions with the whole image first.
pub fn regions(request: &Request, base: &Description) -> Result<Vec<Region>> {
    let (width, height) = base.film.size();
    let mut regions = vec![Region { name: "image".to_string(), x: 0, y: 0, width, height }];
    for (name, [x, y, w, h]) in &request.regions {
        let fits = |from: u32, size: u32, all: u32| size > 0 && from.checked_add(size).is_some_and(|end| end <= all);
        if !fits(*x, *w, width) || !fits(*y, *h, height) {
            return Err(Error::Usage(format!(
                "region {name}={x},{y},{w},{h} is not within the image of {width} × {height} pixels"
            )));
        }
        if regions.iter().any(|region| region.name == *name) {
            return Err(Error::Usage(format!("two regions are named {name:?}")));
        }
        regions.push(Region { name: name.clone(), x: *x, y: *y, width: *w, height: *h });
    }
    Ok(regions)
}

/// Keys that variants may set although they share photons: how these are gathered.
fn is_of_gathering(key: &str) -> bool {
    let key = key.trim();
    (key.starts_with("volume.") && key != "volume.single_scattering")
        || key.starts_with("surface.")
        || matches!(key, "render.method" | "render.samples")
}

/// What was asked for, checked and with everything it sets.
pub fn variants(context: &mut Context<'_>, budgets: &Budgets) -> Result<Vec<Variant>> {
    let request = context.request;
    let asked: Vec<StudyVariant> = if request.variants.is_empty() {
        let names = variant::DEFAULT.iter().filter(|name| **name != "path" || !request.same_map);
        names.map(|name| StudyVariant { name: name.to_string(), ..StudyVariant::default() }).collect()
    } else {
        request.variants.clone()
    };
    if request.reference == StudyReference::Own && !request.same_map {
        return Err(Error::Usage(
            "a reference of each variant's own needs one map for all: add --same-map (same_map = true)".to_string(),
        ));
    }
    for (index, variant) in asked.iter().enumerate() {
        if asked[..index].iter().any(|other| other.name == variant.name) {
            return Err(Error::Usage(format!("two variants are named {}", variant.name)));
        }
        let other = variant.set.iter().find(|(key, _)| !is_of_gathering(key));
        if let (true, Some((key, _))) = (request.same_map, other) {
            return Err(Error::Usage(format!(
                "variant {} sets {key}, but with one map for all, variants differ only in how they gather: set it for all of them with --set, or leave --same-map out",
                variant.name
            )));
        }
    }
    let mut variants = Vec::new();
    for asked in &asked {
        let mut variant = Variant::new(asked, context)?;
        let ((w, h), (width, height)) = (variant.description.film.size(), context.base.film.size());
        if (w, h) != (width, height) {
            return Err(Error::Usage(format!(
                "variant {} has {w} × {h} pixels, the scene {width} × {height}; all variants need one size",
                asked.name
            )));
        }
        let common = request.tune.as_deref().map(Tunable::of).transpose()?;
        variant.tune = match &asked.tune {
            Some(key) => Some(Tunable::of(key)?),
            None => common.filter(|tunable| tunable.concerns(&variant)),
        };
        check_tuning(&variant, context, budgets)?;
        variants.push(variant);
    }
    Ok(variants)
}

fn check_tuning(variant: &Variant, context: &Context<'_>, budgets: &Budgets) -> Result<()> {
    let name = &variant.asked.name;
    let Some(tunable) = variant.tune else {
        if !variant.asked.samples.is_empty() {
            return Err(Error::Usage(format!(
                "variant {name} has numbers of samples to try, but nothing to tune: give it `tune`"
            )));
        }
        return Ok(());
    };
    if !tunable.concerns(variant) {
        return Err(Error::Usage(format!("variant {name} does not depend on {}", tunable.key())));
    }
    if context.request.same_map && tunable == Tunable::Photons {
        return Err(Error::Usage("photons.volume cannot be tuned where all variants share one map".to_string()));
    }
    if budgets.kind == BudgetKind::Samples && variant.asked.time.is_none() {
        return Err(Error::Usage(format!(
            "variant {name} is to be tuned, but to which time? Give budgets in seconds, or `time` with the variant whose time it gets"
        )));
    }
    Ok(())
}
