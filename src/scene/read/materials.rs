//! `[materials.*]`

use crate::math::Rgb;
use crate::scene::description::Material;
use crate::scene::table::{Item, Read, Table};
use crate::surface::{self, Dielectric, Lambert, Mirror, OrenNayar, Reflector};

/// What shapes without a `material` are made of where they have an interior; a scene need not define it.
pub(super) const NONE: &str = "none";

/// Reads `item` as the material of this name.
pub(super) fn material(name: &str, item: &Item) -> Read<Material> {
    type Reader = fn(&Table) -> Read<surface::Material>;
    let kinds: [(&str, Reader); 5] = [
        ("lambert", lambert),
        ("oren_nayar", oren_nayar),
        ("mirror", mirror),
        ("dielectric", dielectric),
        ("none", |_| Ok(surface::Material::None)),
    ];
    let table = item.table()?;
    let read = table.require("type", |item| item.choice(&kinds, &["schlick", "phong", "conductor"]))?;
    let kind = read(&table);
    table.finish()?;
    let kind = kind?;
    if name == NONE && kind != surface::Material::None {
        return Err(
            item.fail("the name is that of the index-matched boundary; expected another name, or type \"none\"")
        );
    }
    Ok(Material { name: name.to_owned(), kind, place: item.place() })
}

fn lambert(table: &Table) -> Read<surface::Material> {
    let reflectance = table.get_or("reflectance", Rgb::splat(0.5), reflectance);
    Ok(Reflector::Lambert(Lambert { reflectance: reflectance? }).into())
}

fn oren_nayar(table: &Table) -> Read<surface::Material> {
    let reflectance = table.get_or("reflectance", Rgb::splat(0.5), reflectance);
    let sigma = table.get_or("sigma", 0.3, |item| item.slope());
    Ok(Reflector::OrenNayar(OrenNayar { reflectance: reflectance?, sigma: sigma? }).into())
}

fn mirror(table: &Table) -> Read<surface::Material> {
    let reflectance = table.get_or("reflectance", Rgb::ONE, reflectance);
    Ok(Reflector::Mirror(Mirror { reflectance: reflectance? }).into())
}

fn dielectric(table: &Table) -> Read<surface::Material> {
    let index = table.get_or("ior", Rgb::splat(1.5), Item::positive_colour);
    let roughness = table.get_or("roughness", 0.0, |item| item.within(0.0, 1.0));
    Ok(Dielectric { index: index?, roughness: roughness? }.into())
}

/// A colour; textures are tables.
fn reflectance(item: &Item) -> Read<Rgb> {
    if !item.is_table() {
        return item.share();
    }
    let table = item.table()?;
    table.require("texture", |item| item.choice(&[], &["image", "checker", "noise"]))
}
