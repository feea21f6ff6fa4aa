//! Where media add up: each overlap of solids is filled with the sum, one medium, and stands as a solid of its own.

use std::cell::OnceCell;
use std::collections::HashMap;
use std::sync::Arc;

use smallvec::SmallVec;

use crate::Result;
use crate::math::{Bounds, DVec3, Rgb};
use crate::medium::density::{self, Density};
use crate::medium::phase::{Mixture, Phase};
use crate::medium::{Albedo, Emission, Medium, Parts, Phases, share};
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
    let whole: Rgb = parts.iter().map(|medium| medium.extinction).sum();
    if parts.iter().all(|medium| std::ptr::eq(*medium, parts[0])) {
        return Ok(Medium { name, extinction: whole, ..parts[0].clone() });
    }
    let (extinction, density) = density(parts).ok_or_else(|| {
        format!(
            "media may add up here to {name}, whose densities differ and whose sigma_t have different colours: one depth along a ray cannot tell then what passes of each channel; expected sigma_t in the same proportions, or the same density in the same place"
        )
    })?;
    // Of one density, nothing varies that is the same everywhere in each.
    let mixed = Mixed { parts, whole, apart: matches!(density, Density::Sum(_)), together: OnceCell::new() };
    let phase = mixed.phase().ok_or_else(|| {
        format!(
            "media may add up here to {name}, whose phase functions differ, and whose shares of the scattering differ by place or by channel: then phase functions can be \"isotropic\", \"hg\" and mixtures of these so far, or all the same"
        )
    })?;
    let (albedo, emission) = (mixed.albedo(), mixed.emission());
    Ok(Medium { name, extinction, albedo, phase, density, emission })
}

/// The density of media together, and their extinction where it is 1; `None` where densities differ and channels fade otherwise in one than in another.
fn density(parts: &[&Medium]) -> Option<(Rgb, Density)> {
    let mut different: Vec<(Rgb, &Density)> = Vec::new();
    for medium in parts {
        match different.iter_mut().find(|(_, density)| density.is_that(&medium.density)) {
            Some((extinction, _)) => *extinction += medium.extinction,
            None => different.push((medium.extinction, &medium.density)),
        }
    }
    let (extinction, first) = different[0];
    if different.len() == 1 {
        return Some((extinction, first.clone()));
    }
    let part = |&(own, density): &(Rgb, &Density)| {
        let weight = own.max_element() / extinction.max_element();
        let is_alike = (own - weight * extinction).abs().max_element() <= ALIKE * own.max_element();
        is_alike.then(|| density::Part { weight, density: density.clone() })
    };
    let sum = different.iter().map(part).collect::<Option<_>>()?;
    Some((extinction, Density::Sum(density::Sum::new(sum))))
}

/// Numbers that differ by no more than this share are meant to be the same.
const ALIKE: f64 = 1e-9;

/// Of a medium whose albedo is the same everywhere.
fn scattering(medium: &Medium) -> Option<Rgb> {
    Some(medium.extinction * medium.albedo.even()?)
}

/// What media do together with light that they meet.
struct Mixed<'a> {
    parts: &'a [&'a Medium],
    /// The extinction of all where all densities are 1.
    whole: Rgb,
    /// Whether their densities differ.
    apart: bool,
    together: OnceCell<Arc<Parts>>,
}

impl Mixed<'_> {
    /// For what varies.
    fn together(&self) -> Arc<Parts> {
        self.together
            .get_or_init(|| Arc::new(Parts::new(self.parts.iter().map(|&part| part.clone()).collect())))
            .clone()
    }

    /// What all scatter, if their shares of that are the same everywhere.
    fn scattering(&self) -> Option<Rgb> {
        self.parts.iter().map(|medium| scattering(medium)).sum::<Option<Rgb>>().filter(|_| !self.apart)
    }

    fn albedo(&self) -> Albedo {
        let first = self.parts[0].albedo.even();
        match self.scattering() {
            Some(scattering) => share(scattering, self.whole).into(),
            None => match first {
                Some(albedo) if self.parts.iter().all(|medium| medium.albedo.even() == first) => albedo.into(),
                _ => Albedo::Mixed(self.together()),
            },
        }
    }

    /// The phase function of all scattering together; `None` if it is one that photons cannot tell.
    fn phase(&self) -> Option<Phases> {
        let scattering_parts = || self.parts.iter().filter(|medium| medium.scatters());
        let Some(first) = scattering_parts().next() else { return Some(self.parts[0].phase.clone()) };
        if let Some(phase) = first.phase.even()
            && scattering_parts().all(|medium| medium.phase.even() == Some(phase))
        {
            return Some(phase.clone().into());
        }
        if let Some(mixture) = self.scattering().and_then(|whole| mixture(scattering_parts().copied(), whole)) {
            return Some(mixture.into());
        }
        let is_kept = |medium: &&Medium| medium.phase.even().is_none_or(|phase| phase.lobes().is_some());
        scattering_parts().copied().all(|medium| is_kept(&medium)).then(|| Phases::Mixed(self.together()))
    }

    /// What all send out, for as much as they absorb together.
    fn emission(&self) -> Emission {
        let mut glowing = self.parts.iter().filter(|medium| medium.glows()).peekable();
        if glowing.peek().is_none() {
            return Emission::None;
        }
        let emitted = |medium: &&Medium| medium.even_glow().map(|_| medium.emitted(DVec3::ZERO));
        match (self.scattering(), glowing.map(emitted).sum::<Option<Rgb>>()) {
            (Some(scattering), Some(emitted)) => Emission::Uniform(share(emitted, self.whole - scattering)),
            _ => Emission::Mixed(self.together()),
        }
    }
}

/// The phase function of scattering that is the same everywhere, `whole`; `None` if it differs by channel or by place.
fn mixture<'a>(parts: impl Iterator<Item = &'a Medium>, whole: Rgb) -> Option<Phase> {
    let lobes = parts.map(|medium| {
        let shares = scattering(medium)? / whole;
        let shares = shares.to_array().into_iter().filter(|share| share.is_finite());
        let [least, most] = shares.fold([f64::INFINITY, 0.0], |[least, most], x| [x.min(least), x.max(most)]);
        (most - least <= ALIKE).then(|| Some((most, medium.phase.even()?.clone()))).flatten()
    });
    Some(Mixture::new(lobes.collect::<Option<_>>()?).into())
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use crate::math::random::Purpose;
    use crate::math::{DVec3, Ray, Rgb, Stream, sampling};
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

    /// Of media whose densities, albedos, phase functions and glows all differ, each place has what they have there, in parts.
    #[test]
    fn what_differs_by_place_is_mixed() {
        let other = r#"
[media.cloud]
sigma_t = 4
albedo = [0.9, 0.6, 0.3]
phase = { type = "mixture", lobes = [{ type = "hg", g = 0.8, weight = 0.4 }, { type = "hg", g = -0.2, weight = 0.6 }] }
density = { type = "noise", threshold = 0.2, seed = 3 }
emission = { radiance = [3, 2, 1] }
add = true
"#;
        let slabs = ["smoke", "noise", "dust", "cloud"].map(|medium| slab(0.0, 2.0, &format!("interior = '{medium}'")));
        let (scene, _) = scene::from_text(&format!("{MEDIA}{other}{}", slabs.concat()));
        let together = at(&scene, 1.0).expect("a medium");
        let parts = ["smoke", "noise", "dust", "cloud"].map(|name| {
            let index = scene.solids.iter().filter_map(|solid| solid.medium);
            let mut media = index.map(|medium| &scene.media[medium as usize]);
            media.find(|medium| medium.name == name).expect("it is there")
        });
        let (before, after) = (DVec3::Z, DVec3::new(0.6, 0.0, 0.8));
        let mut stream = Stream::new(3, Purpose::Test, 0, 0);
        for i in 0..50 {
            let p = DVec3::new(0.013 * f64::from(i), 0.3, 0.02 * f64::from(i) + 0.1) - scene.center;
            let all = |of: &dyn Fn(&Medium) -> Rgb| parts.iter().map(|part| of(part) * part.density.at(p)).sum::<Rgb>();
            let extinction = all(&|part| part.extinction);
            let scattering = all(&|part| part.extinction * part.albedo_at(p));
            let turned = all(&|part| part.extinction * part.albedo_at(p) * part.phase.value(p, before, after).0);
            let emitted = all(&|part| part.emitted(p));
            let density = together.density.at(p);
            let close =
                |found: Rgb, expected: Rgb| assert!(found.abs_diff_eq(expected, 1e-9), "{found}, not {expected}");
            close(together.extinction * density, extinction);
            close(together.albedo_at(p), scattering / extinction);
            close(together.phase.value(p, before, after).0, turned / scattering);
            close(together.emitted(p) * density, emitted);

            // What is drawn, and what photons keep, is that on average: of the share that goes on into a half-space.
            let (mut drawn, mut kept, draws) = (Rgb::ZERO, Rgb::ZERO, 2000);
            for _ in 0..draws {
                let mut weight = Rgb::ONE;
                let (direction, density) = together.phase.sample(p, before, &mut weight, &mut stream);
                let (value, chance) = together.phase.value(p, before, direction);
                assert!((density / chance - 1.0).abs() < 1e-9);
                close(weight, value / density);
                drawn += if direction.dot(after) > 0.0 { weight } else { Rgb::ZERO };
                let (v, factor) = together.phase.kept(p, before, &mut stream);
                kept += factor * (0.25 / PI * (v - after).length().powi(-3));
            }
            let expected = turned / scattering;
            let [drawn, kept] = [drawn, kept].map(|sum| sum / f64::from(draws));
            assert!((kept / expected - 1.0).abs().max_element() < 0.15, "{kept}, not {expected}");
            let half = all(&|part| {
                let phase = part.phase.even().expect("one");
                let mut ahead = 0.0;
                for j in 0..400 {
                    let (u, v) = ((f64::from(j % 20) + 0.5) / 20.0, (f64::from(j / 20) + 0.5) / 20.0);
                    let direction = sampling::sphere([u, v]);
                    ahead += if direction.dot(after) > 0.0 { phase.value(before, direction) } else { 0.0 };
                }
                part.extinction * part.albedo_at(p) * (ahead * 4.0 * PI / 400.0)
            });
            assert!((drawn - half / scattering).abs().max_element() < 0.06, "{drawn}, not {}", half / scattering);
        }
        // Transmittance is the product.
        let ray = Ray::new(DVec3::new(0.1, 0.2, -1.0) - scene.center, DVec3::new(0.1, 0.3, 1.0).normalize());
        let passed = |medium: &Medium| medium.transmittance(medium.density.depth(&ray, 1.1, 2.9));
        let product = parts.iter().map(|part| passed(part)).fold(Rgb::ONE, |product, passed| product * passed);
        assert!((passed(together) / product - 1.0).abs().max_element() < 1e-9);
    }

    #[test]
    fn what_is_not_one_medium_is_refused() {
        let other = "[media.haze]\nsigma_s = [1, 2, 3]\nphase = { type = 'rayleigh' }\nadd = true\n";
        let refused = |first: &str, second: &str, expected: &str| {
            let slabs =
                [slab(0.0, 2.0, &format!("interior = '{first}'")), slab(1.0, 3.0, &format!("interior = '{second}'"))];
            let description = scene::parse(&format!("{MEDIA}{other}{}", slabs.concat()), "x.toml".as_ref(), &[])
                .expect("can be read");
            let error = scene::build(&description).expect_err("cannot be one medium").to_string();
            assert!(error.contains(expected), "{error}");
        };
        refused("fog", "smoke", "media.smoke: media may add up here to fog + smoke, whose densities differ");
        refused("fog", "haze", "media.haze: media may add up here to fog + haze, whose phase functions differ");
    }
}
