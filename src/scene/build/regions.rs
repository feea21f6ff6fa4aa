//! What a scene's parts make together: regions, surroundings, and darkness beyond an endless medium.

use std::collections::HashMap;

use crate::light::{Light, Surroundings};
use crate::math::{Bounds, DisjointSets, Rgb};
use crate::scene::{Scene, Solid};

/// Numbers the regions: solids with the same medium and index that touch share one, as does the world.
pub(super) fn join_regions(scene: &mut Scene) {
    let count = scene.solids.len();
    // Solids and, last, the world.
    let mut sets = DisjointSets::new(count + 1);
    let margin = 1e-9 * scene.geometry.all_bounds().diagonal();
    let boxes: Vec<Bounds> =
        scene.solids.iter().map(|solid| scene.geometry.bounds(solid.shape).grown(margin)).collect();
    let bounded = |&solid: &u32| scene.surfaces[scene.solids[solid as usize].shape as usize].solid == Some(solid);
    let unbounded: Vec<u32> = (0..count as u32).filter(|solid| !bounded(solid)).collect();
    let mut near: Vec<u32> = Vec::new();
    let index = |solid: &Solid| solid.index.unwrap_or(Rgb::ONE);
    for i in 0..count {
        if scene.solids[i].medium == scene.world && index(&scene.solids[i]) == Rgb::ONE {
            sets.join(i, count);
        }
        // Solids that no surface bounds are overlaps of others.
        near.clear();
        scene.geometry.boxes_overlapping(&boxes[i], |shape| near.extend(scene.surfaces[shape as usize].solid));
        for j in near.iter().copied().chain(unbounded.iter().copied()).map(|solid| solid as usize).filter(|&j| j != i) {
            let (one, other) = (&scene.solids[i], &scene.solids[j]);
            let same = one.medium == other.medium && index(one) == index(other);
            if same && boxes[i].overlaps(&boxes[j]) {
                sets.join(i, j);
            }
        }
    }
    let mut numbers = HashMap::new();
    let mut number = |root: usize| {
        let next = numbers.len() as u32;
        *numbers.entry(root).or_insert(next)
    };
    scene.world_region = number(sets.root(count));
    for i in 0..count {
        scene.solids[i].region = number(sets.root(i));
    }
    scene.regions = numbers.len() as u32;
    scene.region_media = vec![scene.world; numbers.len()];
    // All solids of a region have one medium.
    for solid in &scene.solids {
        scene.region_media[solid.region as usize] = solid.medium;
    }
}

/// A sphere around all surfaces, lights, the camera and bounded media. Where an atmosphere fills the world,
/// it reaches some mean free paths farther, for light that enters from the side.
pub(super) fn surroundings(scene: &Scene) -> Surroundings {
    let mut bounds = scene.bounds();
    let mut margin = 0.0;
    if let Some(world) = scene.world {
        let medium = &scene.media[world as usize];
        let support = medium.density.support();
        if support.size().is_finite() {
            bounds = bounds.union(support);
        } else if !medium.density.is_endless() {
            let extinction = medium.extinction.element_sum() / 3.0 * medium.density.max();
            if extinction > 0.0 {
                margin = FREE_PATHS / extinction;
            }
        }
    }
    let radius = 0.5 * bounds.diagonal() * (1.0 + 1e-6) + margin;
    Surroundings { center: bounds.center(), radius: if radius > 0.0 { radius } else { 1.0 } }
}

/// How many mean free paths of an atmosphere around the scene light from infinity is traced through.
const FREE_PATHS: f64 = 8.0;

/// Light from infinity does not survive a world medium that does not thin out.
pub(super) fn darken_infinity(scene: &mut Scene) {
    let Some(world) = scene.world else { return };
    let medium = &scene.media[world as usize];
    if !medium.density.is_endless() || medium.extinction.max_element() <= 0.0 {
        return;
    }
    let passes = medium.extinction.map(|sigma| if sigma > 0.0 { 0.0 } else { 1.0 });
    let mut darkened = false;
    scene.lights.retain_mut(|light| {
        if !light.is_infinite() {
            return true;
        }
        darkened = true;
        light.dim(passes);
        passes.max_element() > 0.0
    });
    if darkened {
        // Lights have moved: surfaces find theirs again.
        for (index, light) in scene.lights.iter().enumerate() {
            if let Light::Area(area) = light {
                scene.surfaces[area.shape as usize].light = Some(index as u32);
            }
        }
    }
}
