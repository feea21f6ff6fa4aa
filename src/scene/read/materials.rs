//! `[materials.*]`

use std::cell::RefCell;

use super::Names;
use super::textures::texture;
use crate::math::Rgb;
use crate::scene::description::{Located, Material, Place, Texture};
use crate::scene::table::{Item, Noted, Read, Table};
use crate::scene::tree::Value;
use crate::surface::{
    self, Bsdf, Coat, Coated, Conductor, Constituent, Dielectric, Fresnel, Lambert, Mirror, Mix, Mixture, OrenNayar,
    Parameter, Phong, Reflector, Relief, Schlick, Slot, Thin, Varnish,
};

/// What shapes without a `material` are made of where they have an interior; a scene need not define it.
pub(super) const NONE: &str = "none";

/// What materials that are made of others see of a scene file.
pub(super) struct Materials<'a> {
    pub names: &'a Names<'a>,
    pub items: &'a [(&'a str, Item<'a>)],
    /// Parts of mixtures that have no name; their indices follow those of `items`.
    unnamed: RefCell<Vec<Material>>,
    /// Where mixtures are said, and their parts.
    mixtures: RefCell<Vec<(Place, [Place; 2])>>,
}

/// Mixtures of mixtures are no deeper: what passes them is the sum of up to two to the power of it.
const DEEPEST: usize = 8;

/// What there is in a mixture.
#[derive(Clone, Copy, Default)]
struct Holds {
    holes: bool,
    surfaces: bool,
    sheets: bool,
}

impl<'a> Materials<'a> {
    pub fn new(names: &'a Names<'a>, items: &'a [(&'a str, Item<'a>)]) -> Self {
        Materials { names, items, unnamed: RefCell::default(), mixtures: RefCell::default() }
    }

    /// The materials, with parts of mixtures that have no name after them; checks what mixtures are made of.
    pub fn with_parts(&self, mut materials: Vec<Material>) -> Read<Vec<Material>> {
        materials.append(&mut self.unnamed.borrow_mut());
        for index in 0..materials.len() {
            if let surface::Material::Mixture(mixture) = materials[index].kind {
                let Holds { holes, surfaces, sheets } = self.holds(&materials, &mut vec![index])?;
                if !surfaces {
                    return Err(self.fail(&materials[index].place, "both parts are \"none\"; expected one that is not"));
                }
                materials[index].kind =
                    surface::Material::Mixture(Mixture { has_holes: holes, has_sheets: sheets, ..mixture });
            }
        }
        Ok(materials)
    }

    fn fail(&self, place: &Place, message: impl std::fmt::Display) -> Noted {
        // What there are materials in.
        self.items[0].1.fail_about(place, message)
    }

    /// What a mixture holds, the last of those on the `way` from the outermost.
    fn holds(&self, materials: &[Material], way: &mut Vec<usize>) -> Read<Holds> {
        let material = &materials[way[way.len() - 1]];
        let surface::Material::Mixture(mixture) = material.kind else { return Ok(Holds::default()) };
        let places = self.mixtures.borrow().iter().find(|(place, _)| *place == material.place).cloned();
        let places = places.map_or([material.place.clone(), material.place.clone()], |(_, parts)| parts);
        let mut all = Holds::default();
        for (part, place) in [mixture.a as usize, mixture.b as usize].into_iter().zip(&places) {
            match materials[part].kind {
                surface::Material::None => all.holes = true,
                surface::Material::Opaque(bsdf) => {
                    all.surfaces = true;
                    all.sheets |= bsdf.is_sheet();
                }
                surface::Material::Dielectric(_) => {
                    return Err(self.fail(
                        place,
                        "is a dielectric, which has two sides; expected a part that reflects, \"thin_dielectric\", or \"none\"",
                    ));
                }
                surface::Material::Mixture(_) if way.contains(&part) => {
                    return Err(self.fail(place, format!("{:?} is made of itself", materials[part].name)));
                }
                surface::Material::Mixture(_) if way.len() == DEEPEST => {
                    return Err(self.fail(place, format!("mixtures of mixtures are deeper here than {DEEPEST}")));
                }
                surface::Material::Mixture(_) => {
                    way.push(part);
                    let inner = self.holds(materials, way)?;
                    way.pop();
                    all = Holds {
                        holes: all.holes || inner.holes,
                        surfaces: all.surfaces || inner.surfaces,
                        sheets: all.sheets || inner.sheets,
                    };
                }
            }
        }
        Ok(all)
    }

    /// The material that an item is, or names, if there is one of that name.
    fn meant<'b>(&'b self, item: &'b Item<'a>) -> Option<&'b Item<'a>> {
        match &item.node.value {
            Value::String(name) => self.items.iter().find(|(known, _)| known == name).map(|(_, item)| item),
            _ => Some(item),
        }
    }

    /// Whether a material reflects, and is made of nothing else.
    fn is_reflector(&self, item: &Item<'a>) -> bool {
        self.meant(item).is_some_and(|item| {
            let kind = item.peek("type");
            let others = ["layer", "normal_map", "bump"].iter().any(|key| item.peek(key).is_some());
            !others && matches!(kind, Some(Value::String(kind)) if REFLECTORS.iter().any(|(name, _)| name == kind))
        })
    }

    /// One part of a mixture, of whatever kind: its index.
    fn part(&self, item: &Item<'a>) -> Read<u32> {
        let part = if item.is_table() {
            material(item.place().key(), item, self)?
        } else {
            let name = item.string()?;
            if name != NONE || self.names.materials.contains(&NONE) {
                return item.reference("material", &self.names.materials).map(|index| index as u32);
            }
            let (kind, place) = (surface::Material::None, item.place());
            Material { name: NONE.to_owned(), kind, textures: Vec::new(), relief: None, place }
        };
        Ok(self.add(part))
    }

    /// Adds a part that has no name. Returns its index.
    fn add(&self, part: Material) -> u32 {
        let mut unnamed = self.unnamed.borrow_mut();
        unnamed.push(part);
        (self.items.len() + unnamed.len() - 1) as u32
    }
}

/// Where a material's parameters are read to.
struct Reading<'a> {
    all: &'a Materials<'a>,
    constituent: Constituent,
    textures: RefCell<Textures>,
}

/// What takes the place of constants.
type Textures = Vec<(Slot, Located<Texture>)>;

/// Stands for a constant that a texture takes the place of.
const ANY: f64 = 0.5;

impl Reading<'_> {
    fn new<'a>(all: &'a Materials<'a>) -> Reading<'a> {
        Reading { all, constituent: Constituent::Whole, textures: RefCell::default() }
    }

    /// A value of `read`, or a texture in its place.
    fn value<T>(&self, item: &Item, parameter: Parameter, any: T, read: impl FnOnce(&Item) -> Read<T>) -> Read<T> {
        if !item.is_table() {
            return read(item);
        }
        let slot = Slot { constituent: self.constituent, parameter };
        let texture = texture(item, self.all.names)?;
        self.textures.borrow_mut().push((slot, item.at(texture)));
        Ok(any)
    }

    /// A colour of shares.
    fn share(&self, table: &Table, key: &'static str, parameter: Parameter, default: f64) -> Read<Rgb> {
        let any = Rgb::splat(ANY);
        table.get_or(key, Rgb::splat(default), |item| self.value(item, parameter, any, |item| item.share()))
    }

    /// A number from 0 to 1.
    fn number(&self, table: &Table, key: &'static str, parameter: Parameter, default: f64) -> Read<f64> {
        table.get_or(key, default, |item| self.value(item, parameter, ANY, |item| item.within(0.0, 1.0)))
    }

    /// What a coat covers, or one part of a mixture: a material of its own, or the name of one.
    fn part(&self, item: &Item, constituent: Constituent) -> Read<Reflector> {
        let part = Reading { constituent, ..Reading::new(self.all) };
        let reflector = if item.is_table() {
            part.reflector(item)
        } else {
            let name = item.string()?;
            match self.all.items.iter().find(|(known, _)| *known == name) {
                Some((_, named)) => part
                    .reflector(named)
                    .map_err(|_| item.fail("refers to a material that is wrong, or does not only reflect")),
                None => Err(item.unknown_name("material", name, &self.all.names.materials)),
            }
        };
        self.textures.borrow_mut().append(&mut part.textures.borrow_mut());
        reflector
    }

    /// A material that reflects and is made of nothing else.
    fn reflector(&self, item: &Item) -> Read<Reflector> {
        let table = item.table()?;
        let read = table.require("type", |item| item.choice(&REFLECTORS, &[]))?;
        let reflector = read(self, &table);
        no_relief(&table)?;
        table.finish()?;
        reflector
    }
}

/// Refuses what turns the normal of a part.
fn no_relief(table: &Table) -> Read<()> {
    let refused = |item: &Item| -> Read<()> {
        Err(item.fail("a base or a part of a mixture has no relief of its own; expected it on what is made of it"))
    };
    ["normal_map", "bump"].iter().try_for_each(|&key| table.get(key, refused).map(|_| ()))
}

type ReadReflector = fn(&Reading, &Table) -> Read<Reflector>;

const REFLECTORS: [(&str, ReadReflector); 6] = [
    ("lambert", lambert),
    ("oren_nayar", oren_nayar),
    ("mirror", mirror),
    ("phong", phong),
    ("conductor", conductor),
    ("schlick", schlick),
];

/// Reads `item` as the material of this name.
pub(super) fn material(name: &str, item: &Item, all: &Materials) -> Read<Material> {
    #[derive(Clone, Copy)]
    enum Reader {
        Reflector(ReadReflector),
        Other(fn(&Reading, &Table) -> Read<surface::Material>),
    }
    let others: [(&str, Reader); 6] = [
        ("schlick", Reader::Other(schlick_layers)),
        ("dielectric", Reader::Other(dielectric)),
        ("thin_dielectric", Reader::Other(thin_dielectric)),
        ("coated", Reader::Other(coated)),
        ("mix", Reader::Other(mix)),
        ("none", Reader::Other(|_, _| Ok(surface::Material::None))),
    ];
    let reflectors = REFLECTORS.iter().map(|&(name, read)| (name, Reader::Reflector(read)));
    let kinds: Vec<(&str, Reader)> = reflectors.filter(|(name, _)| *name != "schlick").chain(others).collect();
    let table = item.table()?;
    let read = table.require("type", |item| item.choice(&kinds, &[]))?;
    let reading = Reading::new(all);
    let kind = match read {
        Reader::Reflector(read) => read(&reading, &table).map(surface::Material::from),
        Reader::Other(read) => read(&reading, &table),
    };
    let relief = relief(&table, all.names);
    table.finish()?;
    let (kind, relief) = (kind?, relief?);
    if name == NONE && kind != surface::Material::None {
        return Err(
            item.fail("the name is that of the index-matched boundary; expected another name, or type \"none\"")
        );
    }
    Ok(Material { name: name.to_owned(), kind, textures: reading.textures.into_inner(), relief, place: item.place() })
}

/// `normal_map` or `bump`, with their `strength`.
fn relief(table: &Table, names: &Names) -> Read<Option<Relief<Located<Texture>>>> {
    let map = table.get("normal_map", |item| relief_texture(item, names));
    let bump = table.get("bump", |item| relief_texture(item, names));
    let strength = table.get("strength", Item::number);
    match (map?, bump?, strength?) {
        (Some(_), Some(_), _) => Err(table.fail_at("bump", "stands beside `normal_map`; expected one of them")),
        (None, None, Some(_)) => Err(table.fail_at("strength", "has no meaning without `normal_map` or `bump`")),
        (Some(map), None, strength) => Ok(Some(Relief::NormalMap(map, strength.unwrap_or(1.0)))),
        (None, Some(bump), strength) => Ok(Some(Relief::Bump(bump, strength.unwrap_or(1.0)))),
        (None, None, None) => Ok(None),
    }
}

fn relief_texture(item: &Item, names: &Names) -> Read<Located<Texture>> {
    if !item.is_table() {
        return Err(item.expected("a texture, for example { texture = \"image\", file = \"bricks.png\" }"));
    }
    texture(item, names).map(|texture| item.at(texture))
}

fn lambert(reading: &Reading, table: &Table) -> Read<Reflector> {
    let reflectance = reading.share(table, "reflectance", Parameter::Reflectance, 0.5);
    Ok(Reflector::Lambert(Lambert { reflectance: reflectance? }))
}

fn oren_nayar(reading: &Reading, table: &Table) -> Read<Reflector> {
    let reflectance = reading.share(table, "reflectance", Parameter::Reflectance, 0.5);
    let sigma = table.get_or("sigma", 0.3, |item| item.slope());
    Ok(Reflector::OrenNayar(OrenNayar { reflectance: reflectance?, sigma: sigma? }))
}

fn mirror(reading: &Reading, table: &Table) -> Read<Reflector> {
    let reflectance = reading.share(table, "reflectance", Parameter::Reflectance, 1.0);
    Ok(Reflector::Mirror(Mirror { reflectance: reflectance? }))
}

fn phong(reading: &Reading, table: &Table) -> Read<Reflector> {
    // Rounding of decimal fractions that sum to one.
    const TOLERANCE: f64 = 1e-9;
    let diffuse = reading.share(table, "diffuse", Parameter::Diffuse, 0.5);
    let specular = reading.share(table, "specular", Parameter::Specular, 0.3);
    let exponent = table.get_or("exponent", 50.0, |item| item.within(0.0, 1e6));
    let (diffuse, specular) = (diffuse?, specular?);
    let most = (diffuse + specular).max_element();
    // Of textures what is too much is cut off where it is met.
    let constant = reading.textures.borrow().iter().all(|(slot, _)| slot.constituent != reading.constituent);
    if constant && most > 1.0 + TOLERANCE {
        return Err(table.fail_at("specular", format!("comes to {most} with `diffuse`; expected at most 1")));
    }
    Ok(Reflector::Phong(Phong { diffuse, specular, exponent: exponent? }))
}

fn conductor(reading: &Reading, table: &Table) -> Read<Reflector> {
    let metals: Vec<(&str, Fresnel)> = Fresnel::metals().collect();
    let any = Rgb::splat(ANY);
    let f0 = table.get("f0", |item| reading.value(item, Parameter::F0, any, |item| item.share()));
    let eta = table.get("eta", Item::positive_colour);
    let k = table.get("k", Item::colour);
    let metal = table.get("metal", |item| item.choice(&metals, &[]));
    let roughness = table.get_or("roughness", [0.0; 2], |item| {
        if item.is_number() || item.is_table() {
            let number = reading.value(item, Parameter::Roughness, ANY, |item| item.within(0.0, 1.0))?;
            return Ok([number; 2]);
        }
        let expected = "a number from 0 to 1, or two of them, along u and along v";
        let items = item.array(expected)?;
        let [u, v] = items.as_slice() else { return Err(item.expected(expected)) };
        let (u, v) = (u.within(0.0, 1.0), v.within(0.0, 1.0));
        Ok([u?, v?])
    });
    let fresnel = match (f0?, eta?, k?, metal?) {
        (Some(f0), None, None, None) => Fresnel::Schlick { f0 },
        (None, Some(eta), Some(k), None) => Fresnel::Complex { eta, k },
        (None, None, None, Some(metal)) => metal,
        _ => return Err(table.missing("", "expected one of `f0`, `eta` with `k`, and `metal`")),
    };
    Ok(Reflector::Conductor(Conductor { fresnel, roughness: roughness? }))
}

fn schlick(reading: &Reading, table: &Table) -> Read<Reflector> {
    let schlick = schlick_layer(reading, table);
    table.get("layer", |item| -> Read<()> {
        Err(item.fail("a base, or a part of a mixture of two that reflect, has one layer; expected no second one"))
    })?;
    schlick.map(Reflector::Schlick)
}

fn schlick_layer(reading: &Reading, table: &Table) -> Read<Schlick> {
    let f0 = reading.share(table, "f0", Parameter::F0, 0.5);
    let roughness = reading.number(table, "roughness", Parameter::Roughness, 0.1);
    let isotropy = table.get_or("isotropy", 1.0, |item| item.above_up_to(0.0, 1.0));
    Ok(Schlick { f0: f0?, roughness: roughness?, isotropy: isotropy? })
}

/// Schlick's surface of one layer, or of two: the keys of the table are the upper one's.
fn schlick_layers(reading: &Reading, table: &Table) -> Read<surface::Material> {
    let upper = schlick_layer(reading, table);
    let lower = table.get("layer", |item| {
        let part = Reading { constituent: Constituent::First, ..Reading::new(reading.all) };
        let table = item.table()?;
        let lower = schlick_layer(&part, &table);
        table.finish()?;
        reading.textures.borrow_mut().append(&mut part.textures.borrow_mut());
        lower
    });
    let (upper, lower) = (upper?, lower?);
    Ok(match lower {
        None => Reflector::Schlick(upper).into(),
        Some(lower) => Bsdf::Coated(Coated { base: Reflector::Schlick(lower), coat: Coat::Schlick(upper) }).into(),
    })
}

fn dielectric(reading: &Reading, table: &Table) -> Read<surface::Material> {
    let index = table.get_or("ior", Rgb::splat(1.5), Item::positive_colour);
    let roughness = reading.number(table, "roughness", Parameter::Roughness, 0.0);
    Ok(Dielectric { index: index?, roughness: roughness? }.into())
}

fn thin_dielectric(_: &Reading, table: &Table) -> Read<surface::Material> {
    let index = table.get_or("ior", Rgb::splat(1.5), Item::positive_colour);
    Ok(Bsdf::Thin(Thin { index: index? }).into())
}

fn coated(reading: &Reading, table: &Table) -> Read<surface::Material> {
    let base = table.require("base", |item| Ok(item.clone()));
    let index = table.get_or("ior", 1.5, Item::positive);
    let roughness = reading.number(table, "roughness", Parameter::Roughness, 0.0);
    let coat = Coat::Dielectric(Varnish::new(index?, roughness?));
    let (kind, textures) = coated_with(reading.all, (coat, &reading.textures.take()), &base?, (table.place(), 1))?;
    *reading.textures.borrow_mut() = textures;
    Ok(kind)
}

/// A base under a coat, with the textures of both; said in a place, so deep in mixtures. A mixture is patches of its parts, wider than the coat
/// is thick: a coat over it is a coat over each of them, and where the mixture has holes, so has the coat.
fn coated_with<'a>(
    all: &Materials<'a>,
    (coat, on_coat): (Coat, &Textures),
    base: &Item<'a>,
    (place, depth): (Place, usize),
) -> Read<(surface::Material, Textures)> {
    let reading = Reading::new(all);
    let mixed = all.meant(base).filter(|item| matches!(item.peek("type"), Some(Value::String(kind)) if kind == "mix"));
    let Some(mixed) = mixed else {
        let base = reading.part(base, Constituent::First)?;
        let textures = on_coat.iter().cloned().chain(reading.textures.into_inner()).collect();
        return Ok((Bsdf::Coated(Coated { base, coat }).into(), textures));
    };
    if depth > DEEPEST {
        return Err(base.fail(format!("mixtures of mixtures are deeper here than {DEEPEST}")));
    }
    let table = mixed.table()?;
    table.require("type", |_| Ok(()))?;
    let weight = reading.number(&table, "weight", Parameter::Weight, 0.5);
    let item = |key| table.require(key, |item| Ok(item.clone()));
    let (a, b) = (item("a"), item("b"));
    no_relief(&table)?;
    table.finish()?;
    let (a, b) = (a?, b?);
    let is_hole = |item: &Item| match &item.node.value {
        Value::String(name) => name == NONE,
        _ => matches!(item.peek("type"), Some(Value::String(kind)) if kind == NONE),
    };
    let part = |item: &Item<'a>| {
        if is_hole(item) {
            return all.part(item);
        }
        let (kind, textures) = coated_with(all, (coat, on_coat), item, (item.place(), depth + 1))?;
        Ok(all.add(Material { name: item.place().key().to_owned(), kind, textures, relief: None, place: item.place() }))
    };
    let parts = (part(&a), part(&b));
    all.mixtures.borrow_mut().push((place, [a.place(), b.place()]));
    let mixture = Mixture { a: parts.0?, b: parts.1?, weight: weight?, has_holes: false, has_sheets: false };
    Ok((surface::Material::Mixture(mixture), reading.textures.into_inner()))
}

fn mix(reading: &Reading, table: &Table) -> Read<surface::Material> {
    let weight = reading.number(table, "weight", Parameter::Weight, 0.5);
    let item = |key| table.require(key, |item| Ok(item.clone()));
    let (a, b) = (item("a"), item("b"));
    let (a, b) = (a?, b?);
    let all = reading.all;
    if !all.is_reflector(&a) || !all.is_reflector(&b) {
        let parts = (all.part(&a), all.part(&b));
        all.mixtures.borrow_mut().push((table.place(), [a.place(), b.place()]));
        let mixture = Mixture { a: parts.0?, b: parts.1?, weight: weight?, has_holes: false, has_sheets: false };
        return Ok(surface::Material::Mixture(mixture));
    }
    let (a, b) = (reading.part(&a, Constituent::First), reading.part(&b, Constituent::Second));
    Ok(Bsdf::Mix(Mix { a: a?, b: b?, weight: weight? }).into())
}
