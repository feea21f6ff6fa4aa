//! Textures, wherever a colour or a number of a material may be one.

use super::transform::transform;
use super::{Names, media};
use crate::math::{DAffine3, Rgb};
use crate::scene::description::{ColorSpace, Texture};
use crate::scene::table::{Item, Read, Table};
use crate::surface::{Checker, NoiseTexture, Space, Wrap};

/// Reads a table as a texture.
pub(super) fn texture(item: &Item, names: &Names) -> Read<Texture> {
    type Reader = fn(&Table, &Names) -> Read<Texture>;
    let kinds: [(&str, Reader); 3] = [("image", image), ("checker", checker), ("noise", noise)];
    let table = item.table()?;
    let read = table.require("texture", |item| item.choice(&kinds, &[]))?;
    let texture = read(&table, names);
    table.finish()?;
    texture
}

fn image(table: &Table, names: &Names) -> Read<Texture> {
    let file = table.require("file", |item| item.file(names.folder, &["png", "jpg", "jpeg", "exr", "hdr", "pfm"]));
    let wrap = table.get_or("wrap", Wrap::Repeat, |item| {
        item.choice(&[("repeat", Wrap::Repeat), ("clamp", Wrap::Clamp), ("mirror", Wrap::Mirror)], &[])
    });
    let color_space = table
        .get("color_space", |item| item.choice(&[("srgb", ColorSpace::Srgb), ("linear", ColorSpace::Linear)], &[]));
    let to_image = table.get_or("transform", DAffine3::IDENTITY, transform);
    Ok(Texture::Image { file: file?, wrap: wrap?, color_space: color_space?, to_image: to_image? })
}

fn space(table: &Table) -> Read<Space> {
    table.get_or("space", Space::Uv, |item| item.choice(&[("uv", Space::Uv), ("object", Space::Object)], &[]))
}

fn colours(table: &Table) -> (Read<Rgb>, Read<Rgb>) {
    (table.get_or("a", Rgb::splat(0.8), Item::share), table.get_or("b", Rgb::splat(0.2), Item::share))
}

fn checker(table: &Table, _: &Names) -> Read<Texture> {
    let (a, b) = colours(table);
    let scale = table.get_or("scale", 1.0, Item::length);
    let space = space(table);
    Ok(Texture::Checker(Checker { a: a?, b: b?, scale: scale?, space: space? }))
}

fn noise(table: &Table, _: &Names) -> Read<Texture> {
    let (a, b) = colours(table);
    let noise = media::noise_of(table, 0.0);
    let space = space(table);
    Ok(Texture::Noise(NoiseTexture { a: a?, b: b?, noise: noise?, space: space? }))
}
