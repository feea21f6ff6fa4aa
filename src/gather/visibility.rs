//! Where surfaces are fully lit by a light, or in its shadow, by shadow photons: there no shadow ray need be sent (Jensen 2001, §11.5).
//!
//! Photons of each light are counted in cells, finer and finer ones. Of a cell and those around it all photons have to agree; where
//! they do not, finer cells may still. That n photons miss a shadow which a share f of them should be in has the probability exp(−n f).
//! So they have to be many, by themselves or for the share that the other kind has in the coarser cell: else they might agree by
//! chance. What remains unknown is for a shadow ray.

use std::collections::HashMap;
use std::hash::{BuildHasherDefault, Hasher};

use crate::math::random::mix;
use crate::math::{DVec3, Vec3};
use crate::photon::{ShadowPhoton, Sight};

/// What is known of a light at a place.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Visibility {
    /// All of the light is seen.
    Lit,
    /// Nothing of it is.
    Dark,
    /// Either, or a part.
    Unknown,
}

/// The coarsest cells: the scene's extent over a power of 2,
const COARSEST: u32 = 3;
/// and the finest.
const FINEST: u32 = 11;
/// Photons in and around a cell have to be so many at least,
const LEAST: u32 = 16;
/// and among them, were photons mixed evenly in the coarser cell, so many of the other kind.
const SURE: f32 = 1.5;
/// Or they are so many: whatever shadow there is then, if none of them is in it, takes 0.3 % of the light there on average at most,
/// max f exp(−n f) = 1/(e n).
const ENOUGH: u32 = 128;
/// Not one of the lights served.
const NONE: u8 = u8::MAX;

/// Shadow photons, counted.
#[derive(Debug, Default)]
pub struct VisibilityMap {
    cells: Cells<State>,
    /// By light, its number among those served.
    slots: Vec<u8>,
    origin: Vec3,
    /// The finest cells per length.
    scale: f32,
}

type Cells<T> = HashMap<u64, T, BuildHasherDefault<Mixer>>;

/// What a cell says.
#[derive(Clone, Copy, Debug, PartialEq)]
enum State {
    Lit,
    Dark,
    /// The shares of photons in and around it that are lit and dark; finer cells may know.
    Mixed([f32; 2]),
}

/// Photons of a cell, by [`Sight`].
type Counts = [u32; 3];

/// A cell: of a light, and of surfaces that face one of six sides.
#[derive(Clone, Copy)]
struct Place {
    slot: u8,
    side: u8,
    /// In finest cells.
    at: [u32; 3],
}

impl Place {
    /// Its cell of a level, or one beside that.
    fn key(&self, level: u32, aside: [i32; 3]) -> Option<u64> {
        let mut key = u64::from(self.slot) << 8 | u64::from(self.side) << 4 | u64::from(level);
        for (at, aside) in self.at.into_iter().zip(aside) {
            let cell = (at >> (FINEST - level)).checked_add_signed(aside).filter(|cell| cell >> level == 0)?;
            key = key << FINEST | u64::from(cell);
        }
        Some(key)
    }
}

impl VisibilityMap {
    /// Counts photons of a scene with so many lights.
    pub fn build(photons: &[ShadowPhoton], lights: usize) -> Self {
        let mut map = VisibilityMap { slots: vec![NONE; lights], ..VisibilityMap::default() };
        let (mut min, mut max, mut served) = (Vec3::INFINITY, Vec3::NEG_INFINITY, 0);
        for photon in photons.iter().filter(|photon| photon.position.is_finite()) {
            (min, max) = (min.min(photon.position), max.max(photon.position));
            let slot = &mut map.slots[photon.light as usize];
            if *slot == NONE && served < NONE {
                *slot = served;
                served += 1;
            }
        }
        // What lies at one height is not to lie at the border of cells, in which it would be by halves.
        let extent = 1.01 * (max - min).max_element();
        map.origin = min - 0.00371 * extent;
        map.scale = (1 << FINEST) as f32 / extent;
        let places: Vec<(Place, Sight)> = photons
            .iter()
            .filter_map(|photon| Some((map.place(photon.light, photon.position, photon.normal)?, photon.sight)))
            .collect();
        for level in COARSEST..=FINEST {
            if !map.add_level(level, &places) {
                break;
            }
        }
        map.cells.shrink_to_fit();
        map
    }

    /// Classifies the cells of a level that the coarser ones leave open. Returns whether finer ones may know more.
    fn add_level(&mut self, level: u32, places: &[(Place, Sight)]) -> bool {
        let mut counts: Cells<(Place, Counts)> = Cells::default();
        for (place, sight) in places {
            if let Some(key) = place.key(level, [0; 3]) {
                counts.entry(key).or_insert((*place, [0; 3])).1[*sight as usize] += 1;
            }
        }
        let mut is_open = false;
        for (key, (place, _)) in &counts {
            let coarser = match place.key(level - 1, [0; 3]) {
                Some(above) if level > COARSEST => match self.cells.get(&above) {
                    Some(State::Mixed(shares)) => Some(*shares),
                    _ => continue,
                },
                _ => None,
            };
            let around = AROUND.iter().filter_map(|&aside| counts.get(&place.key(level, aside)?));
            let sum = around.fold([0; 3], |sum: Counts, (_, counts)| [0, 1, 2].map(|i| sum[i] + counts[i]));
            if let Some(state) = State::of(sum, coarser) {
                is_open |= matches!(state, State::Mixed(_));
                self.cells.insert(*key, state);
            }
        }
        is_open
    }

    /// What is known of a light at a point of a surface with this geometric normal, on the side that light would come to.
    #[inline]
    pub fn visibility(&self, light: u32, point: DVec3, normal: DVec3) -> Visibility {
        let Some(place) = self.place(light, point.as_vec3(), normal.as_vec3()) else { return Visibility::Unknown };
        for level in COARSEST..=FINEST {
            match place.key(level, [0; 3]).and_then(|key| self.cells.get(&key)) {
                None => break,
                Some(State::Lit) => return Visibility::Lit,
                Some(State::Dark) => return Visibility::Dark,
                Some(State::Mixed(_)) => {}
            }
        }
        Visibility::Unknown
    }

    #[inline]
    fn place(&self, light: u32, point: Vec3, normal: Vec3) -> Option<Place> {
        let slot = self.slots[light as usize];
        let at = (point - self.origin) * self.scale;
        if slot == NONE || !(at.min_element() >= 0.0 && at.max_element() < (1 << FINEST) as f32) {
            return None;
        }
        let axis = normal.abs().max_position();
        let side = 2 * axis as u8 + u8::from(normal[axis] < 0.0);
        Some(Place { slot, side, at: at.to_array().map(|x| x as u32) })
    }

    /// Memory taken, in bytes.
    pub fn bytes(&self) -> usize {
        self.cells.capacity() * (size_of::<(u64, State)>() + 1) + size_of_val(&*self.slots)
    }
}

/// A cell and all that touch it.
const AROUND: [[i32; 3]; 27] = {
    let mut around = [[0; 3]; 27];
    let mut i = 0;
    while i < 27 {
        around[i] = [i as i32 % 3 - 1, i as i32 / 3 % 3 - 1, i as i32 / 9 - 1];
        i += 1;
    }
    around
};

impl State {
    /// What so many photons say, if it is anything. `coarser`: the shares of lit and dark ones in and around the coarser cell.
    fn of([lit, veiled, dark]: Counts, coarser: Option<[f32; 2]>) -> Option<State> {
        let all = lit + veiled + dark;
        if all < LEAST || veiled == all {
            return None;
        }
        let (state, same) = if lit == all {
            (State::Lit, 0)
        } else if dark == all {
            (State::Dark, 1)
        } else {
            return Some(State::Mixed([lit, dark].map(|part| part as f32 / all as f32)));
        };
        let others = coarser.map_or(0.0, |shares| all as f32 * (1.0 - shares[same]));
        (all >= ENOUGH || others >= SURE).then_some(state)
    }
}

/// Cells are found by their keys, which are well mixed.
#[derive(Default)]
struct Mixer(u64);

impl Hasher for Mixer {
    fn finish(&self) -> u64 {
        self.0
    }

    fn write(&mut self, bytes: &[u8]) {
        bytes.iter().for_each(|&byte| self.write_u64(byte.into()));
    }

    fn write_u64(&mut self, key: u64) {
        self.0 = mix(self.0 ^ key);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::light::Light;
    use crate::math::random::Purpose;
    use crate::math::{Bounds, Rgb, Stream};
    use crate::photon::{Emission, ShadowPass, trace_shadows};
    use crate::scene::{self, Inside, Scene};
    use crate::transport::{Events, ShadowRay, transmit};

    /// A round lamp above a plate above a floor, and a sky.
    const LAMP: &str = r#"
[camera]
position = [0, 2, 9]
target = [0, 0, 0]
[materials.grey]
type = "lambert"
reflectance = 0.5
[materials.lace]
type = "mix"
a = "grey"
b = "none"
weight = 0.5
[[shapes]]
type = "quad"
origin = [-4, 0, 4]
edge_u = [8, 0, 0]
edge_v = [0, 0, -8]
material = "grey"
[[shapes]]
type = "box"
min = [-0.5, 1, -0.5]
max = [0.5, 1.1, 0.5]
material = "grey"
[[lights]]
type = "environment"
radiance = 1
[[lights]]
type = "point"
position = [0, 4, 0]
intensity = 5
radius = 0.3
"#;

    fn map(scene: &Scene) -> VisibilityMap {
        let (min, max) = (DVec3::new(-2.0, -0.1, -2.0) - scene.center, DVec3::new(2.0, 0.1, 2.0) - scene.center);
        let seen = Bounds { min, max };
        let pass = ShadowPass { seed: 3, index: 0, target: 30_000, emission: Emission::default(), seen };
        VisibilityMap::build(&trace_shadows(scene, &pass, &|| false).photons, scene.lights.len())
    }

    fn lamp(scene: &Scene) -> u32 {
        scene.lights.iter().position(|light| matches!(light, Light::Area(_))).expect("there is one") as u32
    }

    /// The share of a light that a point above the floor sees, by rays.
    fn seen(scene: &Scene, light: &Light, point: DVec3, stream: &mut Stream) -> f64 {
        const RAYS: u32 = 64;
        let rays = (0..RAYS).filter(|_| {
            let arrival = light.arrive(&scene.geometry, None, point, stream).expect("nothing shines below the floor");
            let ray = ShadowRay::new(point, point, arrival.direction, arrival.distance, arrival.normal);
            let mut weight = Rgb::ONE;
            transmit(scene, ray, &Inside::default(), Events::unlimited(), &mut weight, stream);
            weight.x > 0.0
        });
        rays.count() as f64 / f64::from(RAYS)
    }

    /// Most of the floor is known to be lit or dark, and hardly any of it is not, which rays tell. Nothing is known of the penumbra, of what
    /// no photon was wanted for, and of the sky.
    #[test]
    fn what_is_known_is_so() {
        let (scene, _) = scene::from_text(LAMP);
        let (map, lamp) = (map(&scene), lamp(&scene));
        let ask = |x: f64, z: f64| map.visibility(lamp, DVec3::new(x, 0.0, z) - scene.center, DVec3::Y);
        assert_eq!(ask(0.1, 0.1), Visibility::Dark);
        assert_eq!(ask(1.5, -1.2), Visibility::Lit);
        for (x, z) in [(0.68, 0.0), (3.0, 3.0)] {
            assert_eq!(ask(x, z), Visibility::Unknown, "at {x}, {z}");
        }
        assert_eq!(map.visibility(1 - lamp, DVec3::X - scene.center, DVec3::Y), Visibility::Unknown);
        assert_eq!(map.visibility(lamp, DVec3::X - scene.center, DVec3::NEG_Y), Visibility::Unknown);
        assert!((1_000..200_000).contains(&map.bytes()), "{} bytes", map.bytes());

        const N: u32 = 4000;
        let mut stream = Stream::new(7, Purpose::Test, 0, 0);
        let (mut known, mut off) = (0, 0.0);
        for _ in 0..N {
            let [x, z] = stream.uniform2().map(|u| 3.0 * u - 1.5);
            let expected = match ask(x, z) {
                Visibility::Unknown => continue,
                Visibility::Lit => 1.0,
                Visibility::Dark => 0.0,
            };
            known += 1;
            off += f64::abs(
                expected
                    - seen(&scene, &scene.lights[lamp as usize], DVec3::new(x, 1e-6, z) - scene.center, &mut stream),
            );
        }
        let (known, off) = (f64::from(known) / f64::from(N), off / f64::from(N));
        assert!(known > 0.6 && off < 1e-3, "{known} of the floor is known, off by {off}");
    }

    /// Fog leaves it to rays how much of the light passes, but not whether a shadow is one; lace leaves both to them.
    #[test]
    fn what_lets_some_light_pass_is_for_rays() {
        let fog = format!("{LAMP}[media.fog]\nsigma_s = 0.01\n[world]\nmedium = \"fog\"\n");
        let lace =
            LAMP.replace("max = [0.5, 1.1, 0.5]\nmaterial = \"grey\"", "max = [0.5, 1.1, 0.5]\nmaterial = \"lace\"");
        for (text, below, beside) in
            [(fog, Visibility::Dark, Visibility::Unknown), (lace, Visibility::Unknown, Visibility::Lit)]
        {
            let (scene, _) = scene::from_text(&text);
            let (map, lamp) = (map(&scene), lamp(&scene));
            assert_eq!(map.visibility(lamp, DVec3::new(0.1, 0.0, 0.1) - scene.center, DVec3::Y), below);
            assert_eq!(map.visibility(lamp, DVec3::new(1.5, 0.0, -1.2) - scene.center, DVec3::Y), beside);
        }
    }

    /// Few photons tell nothing, nor do many of which one is of the other kind; all of a kind do where the coarser cell has enough
    /// of the other.
    #[test]
    fn cells_are_sure_or_say_nothing() {
        let half = Some([0.5, 0.5]);
        assert_eq!(State::of([LEAST - 1, 0, 0], half), None);
        assert_eq!(State::of([LEAST, 0, 0], half), Some(State::Lit));
        assert_eq!(State::of([0, 0, LEAST], half), Some(State::Dark));
        assert_eq!(State::of([LEAST, 0, 0], None), None);
        assert_eq!(State::of([ENOUGH, 0, 0], None), Some(State::Lit));
        assert!(matches!(State::of([1000, 0, 1], half), Some(State::Mixed(_))));
        assert_eq!(State::of([100, 0, 0], Some([0.99, 0.01])), None);
        assert_eq!(State::of([0, 1000, 0], half), None);
    }
}
