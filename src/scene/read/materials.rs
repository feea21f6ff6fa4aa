//! `[materials.*]`

use std::f64::consts::FRAC_PI_2;

use crate::math::Rgb;
use crate::scene::description::{Material, MaterialKind};
use crate::scene::table::{Item, Read};

/// What shapes without a `material` are made of where they have an interior; a scene need not define it.
pub(super) const NONE: &str = "none";

pub(super) fn material(name: &str, item: &Item) -> Read<Material> {
    #[derive(Clone, Copy)]
    enum Kind {
        Lambert,
        OrenNayar,
        Mirror,
        Dielectric,
        None,
    }
    let table = item.table()?;
    let kind = table.require("type", |item| {
        let kinds = [
            ("lambert", Kind::Lambert),
            ("oren_nayar", Kind::OrenNayar),
            ("mirror", Kind::Mirror),
            ("dielectric", Kind::Dielectric),
            ("none", Kind::None),
        ];
        item.choice(&kinds, &["schlick", "phong", "conductor"])
    })?;
    let kind = match kind {
        Kind::Lambert => table
            .get_or("reflectance", Rgb::splat(0.5), reflectance)
            .map(|reflectance| MaterialKind::Lambert { reflectance }),
        Kind::OrenNayar => {
            let reflectance = table.get_or("reflectance", Rgb::splat(0.5), reflectance);
            let sigma = table.get_or("sigma", 0.3, |item| item.within(0.0, FRAC_PI_2));
            sigma.and_then(|sigma| Ok(MaterialKind::OrenNayar { reflectance: reflectance?, sigma }))
        }
        Kind::Mirror => {
            table.get_or("reflectance", Rgb::ONE, reflectance).map(|reflectance| MaterialKind::Mirror { reflectance })
        }
        Kind::Dielectric => {
            let ior = table.get_or("ior", Rgb::splat(1.5), Item::positive_colour);
            let roughness = table.get_or("roughness", 0.0, |item| item.within(0.0, 1.0));
            roughness.and_then(|roughness| Ok(MaterialKind::Dielectric { ior: ior?, roughness }))
        }
        Kind::None => Ok(MaterialKind::None),
    };
    table.finish()?;
    let kind = kind?;
    if name == NONE && kind != MaterialKind::None {
        return Err(
            item.fail("the name is that of the index-matched boundary; expected another name, or type \"none\"")
        );
    }
    Ok(Material { name: name.to_owned(), kind, place: item.place() })
}

/// A colour; textures are tables.
fn reflectance(item: &Item) -> Read<Rgb> {
    if !item.is_table() {
        return item.share();
    }
    let table = item.table()?;
    table.require("texture", |item| item.choice(&[], &["image", "checker", "noise"]))
}
