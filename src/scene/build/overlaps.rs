//! Where media add up: each overlap of solids is filled with the sum, one medium, and stands as a solid of its own.

use std::collections::HashMap;

use smallvec::SmallVec;

use crate::Result;
use crate::math::{Bounds, DVec3, Rgb};
use crate::medium::phase::{Mixture, Phase};
use crate::medium::{Emission, Medium};
use crate::scene::description as said;
use crate::scene::{Overlap, Scene, Solid};

/// So many overlaps, of fourteen solids each with all others, are more than a scene means.
const MOST: usize = 1 << 14;

/// Solids that overlap, those with precedence first.
type Solids = SmallVec<[u32; 6]>;

/// Makes the sums of media that a scene needs.
pub(super) fn add_up(scene: &mut Scene, description: &[said::Medium]) -> Result<()> {
    let Some(adding) = scene.solids.iter().find_map(|solid| solid.medium.filter(|_| solid.adds)) else {
        return Ok(());
    };
    let name = |scene: &Scene, medium: u32| scene.media[medium as usize].name.clone();
    let fail = |name: &str, message: &str| match description.iter().find(|medium| medium.name == name) {
        Some(medium) => medium.place.error(message),
        None => crate::Error::Scene(message.to_string()),
    };
    let overlaps = overlaps(scene).ok_or_else(|| {
        fail(&name(scene, adding), "so many solids overlap where media add up that their sums cannot be kept")
    })?;
    let mut sums: HashMap<Vec<u32>, u32> = HashMap::new();
    for of in overlaps {
        let first = scene.solids[of[0] as usize];
        let lowest = scene.solids[of[of.len() - 1] as usize];
        let below = scene.world.filter(|_| lowest.adds);
        let media = of.iter().filter_map(|&solid| scene.solids[solid as usize].medium).chain(below);
        let mut media: Vec<u32> = media.filter(|&medium| !scene.media[medium as usize].is_clear()).collect();
        media.sort_unstable();
        let medium = match media[..] {
            [] => continue,
            [one] if first.medium == Some(one) => continue,
            [one] => one,
            _ => match sums.get(&media) {
                Some(&sum) => sum,
                None => {
                    let parts: Vec<&Medium> = media.iter().map(|&medium| &scene.media[medium as usize]).collect();
                    let name = || first.medium.map_or(String::new(), |medium| name(scene, medium));
                    let sum = sum(&parts).map_err(|message| fail(&name(), &message))?;
                    scene.media.push(sum);
                    sums.insert(media, scene.media.len() as u32 - 1);
                    scene.media.len() as u32 - 1
                }
            },
        };
        let extent = |solid: &Solid| scene.geometry.bounds(solid.shape).diagonal();
        let solids = of.iter().map(|&solid| scene.solids[solid as usize]);
        let smallest = solids.clone().min_by(|a, b| extent(a).total_cmp(&extent(b))).unwrap_or(first);
        let index = solids.clone().find_map(|solid| solid.index);
        let solid = scene.solids.len() as u32;
        scene.solids.push(Solid {
            shape: smallest.shape,
            medium: Some(medium),
            index,
            adds: false,
            overlaps_itself: false,
            region: 0,
        });
        scene.overlaps.push(Overlap { of, solid });
    }
    scene.overlaps.sort_unstable_by(|a, b| a.of.cmp(&b.of));
    Ok(())
}

/// Solids whose media add, with the first below them whose medium does not, or none: all that may be around a point, by
/// their boxes. `None` if there are too many.
fn overlaps(scene: &Scene) -> Option<Vec<Solids>> {
    // What only touches does not overlap.
    let least = 1e-9 * scene.geometry.all_bounds().diagonal();
    let boxes: Vec<Bounds> = scene.solids.iter().map(|solid| scene.geometry.bounds(solid.shape)).collect();
    let mut found: Vec<Solids> = Vec::new();
    let adding = (0..scene.solids.len() as u32).filter(|&solid| scene.solids[solid as usize].adds);
    let mut open: Vec<(Solids, Bounds)> =
        adding.map(|solid| (Solids::from_slice(&[solid]), boxes[solid as usize])).collect();
    while let Some((above, shared)) = open.pop() {
        for solid in 0..above[above.len() - 1] {
            let shared = shared.intersection(boxes[solid as usize]);
            if shared.size().min_element() <= least {
                continue;
            }
            let mut of = above.clone();
            of.push(solid);
            match scene.solids[solid as usize].adds {
                true => open.push((of, shared)),
                false => found.push(of),
            }
        }
        found.push(above);
        if found.len() + open.len() > MOST {
            return None;
        }
    }
    Some(found)
}

/// Media that fill the same space, as one: coefficients add up, and phase functions are mixed by how much each scatters.
fn sum(parts: &[&Medium]) -> Result<Medium, String> {
    let names: Vec<&str> = parts.iter().map(|medium| medium.name.as_str()).collect();
    let name = names.join(" + ");
    let density = &parts[0].density;
    if !parts.iter().all(|medium| medium.density.is_that(density)) {
        return Err(format!(
            "media may add up here to {name}, and only those of one density can so far: constant ones, or the same in the same place"
        ));
    }
    let extinction: Rgb = parts.iter().map(|medium| medium.extinction).sum();
    if parts.iter().any(|medium| medium.is_mixed()) {
        if parts.iter().all(|medium| std::ptr::eq(*medium, parts[0])) {
            return Ok(Medium { name, extinction, ..parts[0].clone() });
        }
        return Err(format!(
            "media may add up here to {name}, and one whose coefficients or phase function are grids adds to nothing but itself so far"
        ));
    }
    let scattering = parts.iter().map(|medium| scattering(medium)).sum();
    let phase = mixed(parts, scattering).ok_or_else(|| {
        format!(
            "media may add up here to {name}, which scatter by other phase functions and in other colours: light of one channel would be turned otherwise than that of another, which cannot be so far"
        )
    })?;
    let emission = glow(parts, extinction - scattering).ok_or_else(|| {
        format!("media may add up here to {name}, and a glow that varies adds to nothing but itself so far")
    })?;
    let albedo = share(scattering, extinction).into();
    Ok(Medium { name, extinction, albedo, phase: phase.into(), density: density.clone(), emission })
}

/// By channel; 0 of nothing.
fn share(part: Rgb, whole: Rgb) -> Rgb {
    Rgb::select(whole.cmpgt(Rgb::ZERO), part / whole, Rgb::ZERO)
}

/// What all send out, for as much as they absorb together; `None` if it varies over space and is not that of each.
fn glow(parts: &[&Medium], absorption: Rgb) -> Option<Emission> {
    if parts.iter().all(|medium| std::ptr::eq(*medium, parts[0])) {
        return Some(parts[0].emission.clone());
    }
    let mut glowing = parts.iter().filter(|medium| medium.glows()).peekable();
    if glowing.peek().is_none() {
        return Some(Emission::None);
    }
    let emitted = |medium: &&Medium| medium.even_glow().map(|_| medium.emitted(DVec3::ZERO));
    let emitted = glowing.map(emitted).sum::<Option<Rgb>>()?;
    Some(Emission::Uniform(share(emitted, absorption)))
}

/// Of a medium whose albedo is the same everywhere.
fn scattering(medium: &Medium) -> Rgb {
    medium.extinction * medium.albedo_at(DVec3::ZERO)
}

/// The phase function of all scattering, `whole`, together; `None` if it differs by channel.
fn mixed(parts: &[&Medium], whole: Rgb) -> Option<Phase> {
    let scattering_parts = || parts.iter().filter(|medium| scattering(medium) != Rgb::ZERO);
    let first = scattering_parts().next().or(parts.first())?;
    let phase = first.phase.even()?;
    if scattering_parts().all(|medium| medium.phase.even() == Some(phase)) {
        return Some(phase.clone());
    }
    let lobes = scattering_parts().map(|medium| {
        let shares = scattering(medium) / whole;
        let shares = shares.to_array().into_iter().filter(|share| share.is_finite());
        let [least, most] = shares.fold([f64::INFINITY, 0.0], |[least, most], x| [x.min(least), x.max(most)]);
        (most - least <= 1e-9).then(|| Some((most, medium.phase.even()?.clone()))).flatten()
    });
    Some(Mixture::new(lobes.collect::<Option<_>>()?).into())
}

#[cfg(test)]
mod tests {
    use crate::math::{DVec3, Rgb};
    use crate::medium::Medium;
    use crate::medium::phase::{HenyeyGreenstein, Isotropic, Mixture, Phase};
    use crate::scene::{self, Scene};

    const MEDIA: &str = r#"
[camera]
position = [0, 0, 9]
target = [0, 0, 0]
[media.fog]
sigma_s = 1
sigma_a = [0.5, 0, 0]
phase = { type = "hg", g = 0.5 }
[media.dye]
sigma_a = [0, 1, 2]
emission = { radiance = [5, 3, 1] }
add = true
[media.dust]
sigma_s = 3
add = true
[media.paint]
sigma_s = [1, 2, 3]
add = true
[media.smoke]
sigma_t = 1
albedo = 0.5
density = { type = "exponential", scale_height = 1 }
add = true
[media.noise]
sigma_t = 2
albedo = 0.2
density = { type = "noise", threshold = 0.1 }
add = true
[materials.glass]
type = "dielectric"
"#;

    /// A slab about the z axis.
    fn slab(from: f64, to: f64, what: &str) -> String {
        format!("[[shapes]]\ntype = \"box\"\nmin = [-1, -1, {from}]\nmax = [1, 1, {to}]\n{what}\n")
    }

    fn at(scene: &Scene, z: f64) -> Option<&Medium> {
        let medium = scene.medium(&scene.inside(DVec3::new(0.1, 0.2, z) - scene.center));
        medium.map(|medium| &scene.media[medium as usize])
    }

    fn extinction(scene: &Scene, z: f64) -> Rgb {
        at(scene, z).map_or(Rgb::ZERO, |medium| medium.extinction)
    }

    /// Wherever they stand in the file, those that add do so to each other and to the one below them that does not.
    #[test]
    fn coefficients_add_up() {
        let slabs = [
            slab(0.0, 3.0, "interior = 'dust'"),
            slab(1.0, 5.0, "interior = 'fog'"),
            slab(2.0, 7.0, "interior = 'dye'"),
            slab(6.0, 8.0, "interior = 'dust'"),
        ];
        let (fog, dye, dust) = (Rgb::new(1.5, 1.0, 1.0), Rgb::new(0.0, 1.0, 2.0), Rgb::splat(3.0));
        let expected = [
            (0.5, dust),
            (1.5, dust + fog),
            (2.5, dust + fog + dye),
            (4.0, fog + dye),
            (5.5, dye),
            (6.5, dye + dust),
            (7.5, dust),
        ];
        for slabs in [slabs.concat(), slabs.iter().rev().cloned().collect()] {
            let (scene, _) = scene::from_text(&format!("{MEDIA}{slabs}"));
            for (z, expected) in expected {
                assert_eq!(extinction(&scene, z), expected, "at {z}");
            }
            assert_eq!(extinction(&scene, 8.5), Rgb::ZERO);

            let three = at(&scene, 2.5).expect("a medium");
            assert!((three.albedo_at(DVec3::ZERO) * three.extinction).abs_diff_eq(Rgb::splat(4.0), 1e-12));
            let hg = Phase::from(HenyeyGreenstein { g: 0.5 });
            let mixed = |phase: &Phase| Phase::from(Mixture::new(vec![(0.25, hg.clone()), (0.75, phase.clone())]));
            let value = |phase: &Phase, cos: f64| phase.value(DVec3::Z, DVec3::new((1.0 - cos * cos).sqrt(), 0.0, cos));
            for cos in [-1.0, 0.3, 1.0] {
                let expected = value(&mixed(&Isotropic.into()), cos);
                assert!((value(three.phase.even().expect("one"), cos) - expected).abs() < 1e-12);
            }
            // The dye's glow alone.
            assert!(three.emitted(DVec3::ZERO).abs_diff_eq(Rgb::new(0.0, 3.0, 2.0), 1e-12));
            assert!(
                at(&scene, 6.5).is_some_and(|medium| medium.phase.even() == Some(&Isotropic.into())),
                "dye does not scatter"
            );
        }
    }

    /// What has precedence takes the place of media that add, as of others; what only touches is not added; and the world is
    /// below all.
    #[test]
    fn precedence_goes_before() {
        let slabs = [
            slab(0.0, 3.0, "interior = 'dust'"),
            slab(1.0, 2.0, "material = 'glass'\npriority = 1"),
            slab(2.5, 4.0, "interior = 'fog'\npriority = -1"),
            slab(4.0, 5.0, "interior = 'smoke'"),
        ];
        let (scene, _) = scene::from_text(&format!("{MEDIA}[world]\nmedium = 'dye'\n{}", slabs[..3].concat()));
        let (fog, dye, dust) = (Rgb::new(1.5, 1.0, 1.0), Rgb::new(0.0, 1.0, 2.0), Rgb::splat(3.0));
        for (z, expected) in [(0.5, dust + dye), (1.5, Rgb::ZERO), (2.7, dust + fog), (3.5, fog), (6.0, dye)] {
            assert_eq!(extinction(&scene, z), expected, "at {z}");
        }
        let (scene, _) = scene::from_text(&format!("{MEDIA}{}", slabs.concat()));
        assert_eq!(extinction(&scene, 4.5), Rgb::ONE);
        assert_eq!(scene.overlaps.len(), 1, "dust and fog: {:?}", scene.overlaps);
    }

    /// Of one medium twice, and of two that thin out alike.
    #[test]
    fn densities_that_are_the_same_add_up() {
        let twice = |what| slab(0.0, 2.0, what) + &slab(1.0, 3.0, what);
        let other = "[media.mist]\nsigma_s = 3\ndensity = { type = 'exponential', scale_height = 1 }\n";
        let slabs =
            twice("interior = 'noise'") + &slab(4.0, 6.0, "interior = 'smoke'") + &slab(5.0, 7.0, "interior = 'mist'");
        let (scene, _) = scene::from_text(&format!("{MEDIA}{other}{slabs}"));
        let part = |z: f64| {
            at(&scene, z).map_or((Rgb::ZERO, Rgb::ZERO), |medium| (medium.extinction, medium.albedo_at(DVec3::ZERO)))
        };
        let found = [0.5, 1.5, 2.5, 4.5, 5.5, 6.5].map(|z| (part(z).0.x, part(z).1.x));
        assert_eq!(found, [(2.0, 0.2), (4.0, 0.2), (2.0, 0.2), (1.0, 0.5), (4.0, 3.5 / 4.0), (3.0, 1.0)]);
    }

    #[test]
    fn what_is_not_one_medium_is_refused() {
        let refused = |first: &str, second: &str, expected: &str| {
            let slabs =
                [slab(0.0, 2.0, &format!("interior = '{first}'")), slab(1.0, 3.0, &format!("interior = '{second}'"))];
            let description =
                scene::parse(&format!("{MEDIA}{}", slabs.concat()), "x.toml".as_ref(), &[]).expect("can be read");
            let error = scene::build(&description).expect_err("cannot be one medium").to_string();
            assert!(error.contains(expected), "{error}");
        };
        refused("fog", "smoke", "media.smoke: media may add up here to fog + smoke");
        refused(
            "fog",
            "paint",
            "media.paint: media may add up here to fog + paint, which scatter by other phase functions",
        );
    }
}
