//! `[[shapes]]`: read one by one, then instances and default materials resolved.

use std::collections::HashMap;

use super::materials::NONE;
use super::transform::{NOT_INVERTIBLE, is_invertible, transform};
use super::{Either, Names, all, either};
use crate::geometry::Lathe;
use crate::light::Sides;
use crate::math::{DAffine3, DVec2};
use crate::scene::description::{Caustics, Located, Material, Shape, ShapeEmission, ShapeKind, Strength};
use crate::scene::table::{Item, Noted, Read, Table, name_of, unit};
use crate::surface;

/// A shape as its own table has it: an instance's missing keys are not filled in yet.
pub(super) struct Draft<'a> {
    item: Item<'a>,
    name: Option<&'a str>,
    /// An instance's `of` is any shape here.
    kind: ShapeKind,
    transform: DAffine3,
    material: Option<Located<MaterialReference>>,
    interior: Option<Located<usize>>,
    priority: Option<i32>,
    emission: Option<ShapeEmission>,
    casts_caustics: Option<bool>,
    receives_caustics: Option<bool>,
    visible: bool,
}

/// A material of the file, or `none` where the file has no such name.
#[derive(Clone, Copy)]
enum MaterialReference {
    Index(usize),
    None,
}

/// The shapes that have names.
#[derive(Default)]
struct ShapeNames<'a> {
    /// In the order of the file.
    all: Vec<&'a str>,
    indices: HashMap<&'a str, usize>,
}

pub(super) fn shapes<'a>(items: &[Item<'a>], names: &Names) -> Read<Vec<Draft<'a>>> {
    let mut shapes = ShapeNames::default();
    let mut unique = Ok(());
    for (index, item) in items.iter().enumerate() {
        let Some(name) = name_of(item.node) else { continue };
        shapes.all.push(name);
        if shapes.indices.insert(name, index).is_some() {
            unique = Err(item.fail(format!("another shape is named {name:?} too; expected each name once")));
        }
    }
    let drafts = all(items, |item| draft(item, names, &shapes));
    unique.and(drafts)
}

fn draft<'a>(item: &Item<'a>, names: &Names, shapes: &ShapeNames) -> Read<Draft<'a>> {
    let table = item.table()?;
    let name = table.get("name", Item::string);
    let transform = table.get_or("transform", DAffine3::IDENTITY, transform);
    let material = table.get("material", |item| Ok(item.at(material_reference(item, names)?)));
    let interior = table.get("interior", |item| Ok(item.at(item.reference("medium", &names.media)?)));
    let priority = table.get("priority", |item| item.integer(i32::MIN.into(), i32::MAX.into()));
    let emission = table.get("emission", |item| emission(&item.table()?));
    let casts_caustics = table.get("casts_caustics", Item::boolean);
    let receives_caustics = table.get("receives_caustics", Item::boolean);
    let visible = table.get_or("visible", true, Item::boolean);
    let kind = kind(&table, names, shapes);
    Ok(Draft {
        item: item.clone(),
        name: name?,
        transform: transform?,
        material: material?,
        interior: interior?,
        priority: priority?,
        emission: emission?,
        casts_caustics: casts_caustics?,
        receives_caustics: receives_caustics?,
        visible: visible?,
        kind: kind?,
    })
}

fn material_reference(item: &Item, names: &Names) -> Read<MaterialReference> {
    let name = item.string()?;
    match names.materials.iter().position(|known| *known == name) {
        Some(index) => Ok(MaterialReference::Index(index)),
        None if name == NONE => Ok(MaterialReference::None),
        None => {
            let known: Vec<&str> = names.materials.iter().copied().chain([NONE]).collect();
            item.reference("material", &known).map(MaterialReference::Index)
        }
    }
}

fn emission(table: &Table) -> Read<ShapeEmission> {
    let strength = either(table, ("radiance", Item::colour), ("power", Item::colour));
    let side = table.get_or("side", Sides::Out, |item| {
        item.choice(&[("out", Sides::Out), ("in", Sides::In), ("both", Sides::Both)], &[])
    });
    table.finish()?;
    let strength = match strength? {
        Either::First(radiance) => Strength::Radiance(radiance),
        Either::Second(power) => Strength::Power(power),
    };
    Ok(ShapeEmission { strength, side: side?, place: table.place() })
}

/// The keys of the shape's own type; they are the last to be read.
fn kind(table: &Table, names: &Names, shapes: &ShapeNames) -> Read<ShapeKind> {
    type Reader = fn(&Table, &Names, &ShapeNames) -> Read<ShapeKind>;
    let kinds: [(&str, Reader); 8] = [
        ("sphere", sphere),
        ("box", cuboid),
        ("quad", quad),
        ("disk", disk),
        ("cylinder", cylinder),
        ("lathe", lathe),
        ("mesh", mesh),
        ("instance", instance),
    ];
    let read = table.require("type", |item| item.choice(&kinds, &[]))?;
    read(table, names, shapes)
}

fn sphere(table: &Table, _: &Names, _: &ShapeNames) -> Read<ShapeKind> {
    let center = table.require("center", Item::vector);
    let radius = table.require("radius", Item::length);
    table.finish()?;
    Ok(ShapeKind::Sphere { center: center?, radius: radius? })
}

fn cuboid(table: &Table, _: &Names, _: &ShapeNames) -> Read<ShapeKind> {
    let corners = super::corners(table);
    table.finish()?;
    let (min, max) = corners?;
    Ok(ShapeKind::Box { min, max })
}

fn quad(table: &Table, _: &Names, _: &ShapeNames) -> Read<ShapeKind> {
    let origin = table.require("origin", Item::vector);
    let edge_u = table.require("edge_u", Item::nonzero_vector);
    let edge_v = table.require("edge_v", Item::nonzero_vector);
    table.finish()?;
    let (edge_u, edge_v) = (edge_u?, edge_v?);
    // Narrower parallelograms have no normal beyond rounding.
    const PARALLEL: f64 = 1e-9;
    let normal = unit(edge_u).zip(unit(edge_v)).map(|(u, v)| u.cross(v));
    if normal.is_none_or(|normal| normal.length() < PARALLEL) {
        return Err(table.fail_at("edge_v", format!("{edge_v} is parallel to `edge_u`, {edge_u}")));
    }
    Ok(ShapeKind::Quad { origin: origin?, edge_u, edge_v })
}

fn disk(table: &Table, _: &Names, _: &ShapeNames) -> Read<ShapeKind> {
    let center = table.require("center", Item::vector);
    let normal = table.require("normal", Item::direction);
    let radius = table.require("radius", Item::length);
    table.finish()?;
    Ok(ShapeKind::Disk { center: center?, normal: normal?, radius: radius? })
}

fn cylinder(table: &Table, _: &Names, _: &ShapeNames) -> Read<ShapeKind> {
    let base = table.require("base", Item::vector);
    let top = table.require("top", Item::vector);
    let radius = table.require("radius", Item::length);
    let caps = table.get_or("caps", true, Item::boolean);
    table.finish()?;
    let (base, top) = (base?, top?);
    if base == top {
        return Err(table.fail_at("top", format!("found {top}, the same point as `base`; expected another")));
    }
    Ok(ShapeKind::Cylinder { base, top, radius: radius?, caps: caps? })
}

fn lathe(table: &Table, _: &Names, _: &ShapeNames) -> Read<ShapeKind> {
    let profile = table.require("profile", |item| {
        let points = item.array("a list of points, [[radius, height], …]")?;
        if points.len() < 2 {
            return Err(item.fail(format!("found {} points; expected at least 2", points.len())));
        }
        all(&points, profile_point)
    });
    let segments = table.get("segments", |item| item.u32(3));
    let crease = table.get_or("crease", 30.0, |item| item.within(0.0, 180.0));
    table.finish()?;
    Ok(ShapeKind::Lathe { profile: profile?, segments: segments?, crease: crease? })
}

fn mesh(table: &Table, names: &Names, _: &ShapeNames) -> Read<ShapeKind> {
    let file = table.require("file", |item| item.file(names.folder, &["obj", "obj.gz"]));
    let smooth = table.get_or("smooth", true, Item::boolean);
    table.finish()?;
    Ok(ShapeKind::Mesh { file: file?, smooth: smooth? })
}

fn instance(table: &Table, _: &Names, shapes: &ShapeNames) -> Read<ShapeKind> {
    let of = table.require("of", |item| {
        let name = item.string()?;
        let index = shapes.indices.get(name).copied();
        index.ok_or_else(|| item.unknown_name("shape", name, &shapes.all))
    });
    table.finish()?;
    Ok(ShapeKind::Instance { of: of? })
}

/// `[radius, height]`
fn profile_point(item: &Item) -> Read<DVec2> {
    let expected = "two numbers, [radius, height]";
    let numbers = item.array(expected)?;
    let [radius, height] = numbers.as_slice() else { return Err(item.expected(expected)) };
    let (radius, height) = (radius.length_or_zero(), height.coordinate());
    Ok(DVec2::new(radius?, height?))
}

/// Resolves instances and default materials, and checks what depends on both. `materials` gains those
/// that only defaults refer to.
pub(super) fn finish(mut drafts: Vec<Draft>, materials: &mut Vec<Material>, names: &Names) -> Read<Vec<Shape>> {
    resolve_instances(&mut drafts)?;
    let mut none = None;
    let mut black = None;
    let mut add = |known: &mut Option<usize>, name: &str, kind, draft: &Draft| {
        *known.get_or_insert_with(|| {
            let (name, place) = (name.to_owned(), draft.item.place());
            materials.push(Material { name, kind, textures: Vec::new(), relief: None, place });
            materials.len() - 1
        })
    };
    let mut shapes = Vec::with_capacity(drafts.len());
    let mut sound = Ok(());
    let defined_none = names.materials.iter().position(|name| *name == NONE);
    for draft in &drafts {
        let mut none = |draft| defined_none.unwrap_or_else(|| add(&mut none, NONE, surface::Material::None, draft));
        let material = match &draft.material {
            Some(Located { value: MaterialReference::Index(index), place }) => {
                Located { value: *index, place: place.clone() }
            }
            Some(Located { value: MaterialReference::None, place }) => {
                Located { value: none(draft), place: place.clone() }
            }
            None if draft.interior.is_some() || !draft.visible => draft.item.at(none(draft)),
            None if draft.emission.is_some() => {
                draft.item.at(add(&mut black, "black", surface::Material::BLACK, draft))
            }
            None => {
                sound = Err(draft.item.fail("a shape without `interior` or `emission` needs a `material`"));
                continue;
            }
        };
        shapes.push(Shape {
            name: draft.name.map(str::to_owned),
            kind: draft.kind.clone(),
            transform: draft.transform,
            material,
            interior: draft.interior.clone(),
            priority: draft.priority.unwrap_or(0),
            emission: draft.emission.clone(),
            caustics: Caustics {
                casts: draft.casts_caustics.unwrap_or(true),
                receives: draft.receives_caustics.unwrap_or(true),
            },
            visible: draft.visible,
            place: draft.item.place(),
        });
    }
    sound?;
    all(&(0..shapes.len()).collect::<Vec<_>>(), |&index| {
        let shape = &shapes[index];
        let root = match shape.kind {
            ShapeKind::Instance { of } => &shapes[of],
            _ => shape,
        };
        check_closed(&drafts[index].item, shape, root, materials)
    })?;
    Ok(shapes)
}

/// Only what is closed has an inside.
fn check_closed(item: &Item, shape: &Shape, root: &Shape, materials: &[Material]) -> Read<()> {
    let open = match root.kind {
        ShapeKind::Quad { .. } => "a quad",
        ShapeKind::Disk { .. } => "a disk",
        ShapeKind::Cylinder { caps: false, .. } => "a cylinder without caps",
        ShapeKind::Lathe { ref profile, .. } if !Lathe::closes(profile) => {
            "a lathe whose profile neither begins and ends on the axis nor comes back to its beginning"
        }
        _ => return Ok(()),
    };
    if let Some(interior) = &shape.interior {
        let message = format!("{open} is not closed, so it has no interior; expected a closed shape");
        return Err(item.fail_about(&interior.place, message));
    }
    if materials[shape.material.value].kind.index().is_some() {
        let message = format!("{open} is not closed; expected a closed shape for a dielectric, which has two sides");
        return Err(item.fail_about(&shape.material.place, message));
    }
    Ok(())
}

/// Lets every instance refer to a shape that is none, with composed transforms and what it takes over.
fn resolve_instances(drafts: &mut [Draft]) -> Read<()> {
    #[derive(Clone, Copy, PartialEq)]
    enum State {
        Open,
        OnTheWay,
        Done,
    }
    let mut states = vec![State::Open; drafts.len()];
    let mut result = Ok(());
    for start in 0..drafts.len() {
        // From instance to template, up to a shape that is known ...
        let mut way = Vec::new();
        let mut at = start;
        while let (State::Open, ShapeKind::Instance { of }) = (states[at], &drafts[at].kind) {
            states[at] = State::OnTheWay;
            way.push(at);
            at = *of;
        }
        if states[at] == State::OnTheWay {
            result = Err(cycle(drafts, &way, at));
        }
        // ... and back.
        while let Some(instance) = way.pop() {
            states[instance] = State::Done;
            if result.is_ok() {
                result = inherit(drafts, instance, at);
            }
            at = instance;
        }
        states[at] = State::Done;
    }
    result
}

fn cycle(drafts: &[Draft], way: &[usize], first: usize) -> Noted {
    let from = way.iter().position(|&index| index == first).unwrap_or(0);
    const SHOWN: usize = 8;
    let names = way[from..].iter().chain([&first]).map(|&index| drafts[index].name.unwrap_or_default());
    let mut names: Vec<&str> = names.collect();
    if names.len() > SHOWN {
        names.splice(SHOWN / 2..names.len() - SHOWN / 2, ["…"]);
    }
    drafts[first].item.fail(format!("instances that repeat each other: {}", names.join(" → ")))
}

/// Gives an instance what its resolved template has and it does not say itself.
fn inherit(drafts: &mut [Draft], instance: usize, template: usize) -> Read<()> {
    let (root, before) = match drafts[template].kind {
        ShapeKind::Instance { of } => (of, drafts[template].transform),
        _ => (template, DAffine3::IDENTITY),
    };
    let from = &drafts[template];
    let (material, interior, priority, emission) =
        (from.material.clone(), from.interior.clone(), from.priority, from.emission.clone());
    let (casts_caustics, receives_caustics) = (from.casts_caustics, from.receives_caustics);
    let root_transform = drafts[root].transform;
    let draft = &mut drafts[instance];
    draft.kind = ShapeKind::Instance { of: root };
    draft.transform *= before;
    draft.material = draft.material.take().or(material);
    draft.interior = draft.interior.take().or(interior);
    draft.priority = draft.priority.or(priority);
    draft.emission = draft.emission.take().or(emission);
    draft.casts_caustics = draft.casts_caustics.or(casts_caustics);
    draft.receives_caustics = draft.receives_caustics.or(receives_caustics);
    if is_invertible(&draft.transform) && is_invertible(&(draft.transform * root_transform)) {
        Ok(())
    } else {
        Err(draft.item.fail(format!("the transform composed with its template's {NOT_INVERTIBLE}")))
    }
}
