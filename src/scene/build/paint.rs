//! Textures, loaded.

use super::Builder;
use crate::Result;
use crate::geometry::{Placed, Shape};
use crate::image;
use crate::scene::description::{ColorSpace, Located, Shape as Said, Texture as Described};
use crate::surface::{ImageTexture, Paint, Parameter, Pyramid, Relief, Texture};

impl Builder<'_> {
    /// What changes over a shape of this material: an index into `paints`.
    ///
    /// # Errors
    /// Where an image cannot be used, or a mesh lacks the texture coordinates that a texture is taken at.
    pub(super) fn paint(&mut self, shape: &Said, placed: &Placed) -> Result<Option<u32>> {
        let material = &self.description.materials[shape.material.value];
        if material.textures.is_empty() && material.relief.is_none() {
            return Ok(None);
        }
        let index = match self.painted.get(&shape.material.value) {
            Some(&index) => index,
            None => {
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
                let index = self.paints.len() as u32 - 1;
                self.painted.insert(shape.material.value, index);
                index
            }
        };
        let paint = &self.paints[index as usize];
        let needs_uv = paint.relief.is_some() || paint.textures.iter().any(|(_, texture)| texture.needs_uv());
        if needs_uv && matches!(placed.shape(), Shape::Mesh(mesh) if !mesh.has_uvs()) {
            return Err(shape.material.place.error(format!(
                "the textures of material {:?} are taken at u and v, and this shape has none: expected a mesh whose file gives \
                 texture coordinates (`vt`), or `space = \"object\"`",
                material.name
            )));
        }
        Ok(Some(index))
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
