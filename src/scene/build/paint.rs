//! Textures, loaded.

use super::Builder;
use crate::Result;
use crate::geometry::{Placed, Shape};
use crate::image;
use crate::scene::Finish;
use crate::scene::description::{ColorSpace, Located, Place, Texture as Described};
use crate::surface::{ImageTexture, Material, Paint, Parameter, Pyramid, Relief, Texture};

impl Builder<'_> {
    /// What changes over a shape of this material: an index into `paints`.
    ///
    /// # Errors
    /// Where an image cannot be used, or a mesh lacks the texture coordinates that a texture is taken at.
    pub(super) fn paint(&mut self, material: usize, place: &Place, placed: &Placed) -> Result<Option<u32>> {
        let paint = self.paint_of(material)?;
        let has_uvs = !matches!(placed.shape(), Shape::Mesh(mesh) if !mesh.has_uvs());
        if !has_uvs && let Some(name) = self.needs_uvs(material)? {
            return Err(place.error(format!(
                "the textures of material {name:?} are taken at u and v, and this shape has none: expected a mesh whose file gives \
                 texture coordinates (`vt`), or `space = \"object\"`",
            )));
        }
        Ok(paint)
    }

    /// The name of a material that this one is, or that it is a mixture of, if its textures are taken at u and v.
    fn needs_uvs(&mut self, index: usize) -> Result<Option<String>> {
        let material = &self.description.materials[index];
        if let Some(paint) = self.paint_of(index)? {
            let paint = &self.paints[paint as usize];
            if paint.relief.is_some() || paint.textures.iter().any(|(_, texture)| texture.needs_uv()) {
                return Ok(Some(material.name.clone()));
            }
        }
        let Material::Mixture(mixture) = material.kind else { return Ok(None) };
        match self.needs_uvs(mixture.a as usize)? {
            None => self.needs_uvs(mixture.b as usize),
            name => Ok(name),
        }
    }

    /// The material that is met everywhere on a shape of this one: a mixture with all of one part is that part.
    pub(super) fn met_everywhere(&self, mut index: usize) -> usize {
        loop {
            let material = &self.description.materials[index];
            index = match material.kind {
                Material::Mixture(mixture) if material.textures.is_empty() && material.relief.is_none() => {
                    match mixture.weight {
                        0.0 => mixture.a as usize,
                        1.0 => mixture.b as usize,
                        _ => return index,
                    }
                }
                _ => return index,
            }
        }
    }

    /// All materials with what changes over them, if there are mixtures, which refer to them.
    pub(super) fn finishes(&mut self) -> Result<Vec<Finish>> {
        let materials = &self.description.materials;
        if !materials.iter().any(|material| matches!(material.kind, Material::Mixture(_))) {
            return Ok(Vec::new());
        }
        (0..materials.len()).map(|i| Ok(Finish { material: materials[i].kind, paint: self.paint_of(i)? })).collect()
    }

    /// What changes over a material: an index into `paints`.
    fn paint_of(&mut self, index: usize) -> Result<Option<u32>> {
        let material = &self.description.materials[index];
        if material.textures.is_empty() && material.relief.is_none() {
            return Ok(None);
        }
        if let Some(&paint) = self.painted.get(&index) {
            return Ok(Some(paint));
        }
        let mut textures = Vec::new();
        for (slot, texture) in &material.textures {
            let as_colour = !matches!(slot.parameter, Parameter::Roughness | Parameter::Weight);
            let kind = if as_colour { ColorSpace::Srgb } else { ColorSpace::Linear };
            textures.push((*slot, self.texture(texture, kind)?));
        }
        let mut load = |texture| self.texture(texture, ColorSpace::Linear);
        let relief = match &material.relief {
            None => None,
            Some(Relief::NormalMap(texture, strength)) => Some(Relief::NormalMap(load(texture)?, *strength)),
            Some(Relief::Bump(texture, strength)) => Some(Relief::Bump(load(texture)?, *strength)),
        };
        self.paints.push(Paint::new(textures, relief));
        let paint = self.paints.len() as u32 - 1;
        self.painted.insert(index, paint);
        Ok(Some(paint))
    }

    fn texture(&mut self, texture: &Located<Described>, default: ColorSpace) -> Result<Texture> {
        Ok(match &texture.value {
            Described::Checker(checker) => Texture::Checker(*checker),
            Described::Noise(noise) => Texture::Noise(*noise),
            Described::Image { file, wrap, color_space, to_image } => {
                let color_space = color_space.unwrap_or(default);
                let key = (file.value.clone(), color_space);
                let image = match self.images.get(&key) {
                    Some(image) => image.clone(),
                    None => {
                        let read = image::read_texture(&file.value, color_space == ColorSpace::Linear);
                        let image = Pyramid::new(read.map_err(|error| file.place.error(error))?);
                        self.images.insert(key, image.clone());
                        image
                    }
                };
                let sound = |value: &f32| (0.0..=1.0).contains(value);
                if let Some(value) = image.image().pixels.iter().flatten().find(|value| !sound(value)) {
                    return Err(file.place.error(format!(
                        "the image holds {value}: expected numbers from 0 to 1 only, since no surface reflects more than all light"
                    )));
                }
                Texture::Image(ImageTexture::new(image, *wrap, *to_image))
            }
        })
    }
}
