//! What changes over a surface: textures, and the numbers of materials that they stand for.

use std::sync::Arc;

use super::pyramid::Pyramid;
use crate::math::{DAffine3, DVec3, Rgb};
use crate::medium::density::Noise;

/// A place on a surface, as textures see it.
#[derive(Clone, Copy, Debug)]
pub struct TexturePoint {
    /// The surface's own coordinates: u to the right and v up as seen from outside.
    pub uv: [f64; 2],
    /// The point in object space, before the shape's transform.
    pub object: DVec3,
    /// Over about what length in uv, as the root of an area, details are too small to be seen; 0 where all are.
    pub footprint: f64,
}

/// Which coordinates a texture is taken at.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Space {
    /// u and v, and 0.
    Uv,
    /// Object space.
    Object,
}

impl Space {
    fn of(self, at: &TexturePoint) -> DVec3 {
        match self {
            Space::Uv => DVec3::new(at.uv[0], at.uv[1], 0.0),
            Space::Object => at.object,
        }
    }
}

/// What is seen beyond the edge of an image.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Wrap {
    /// The image again.
    Repeat,
    /// Its edge.
    Clamp,
    /// The image, mirrored.
    Mirror,
}

impl Wrap {
    /// The texel that stands for texel `i` of `n`.
    pub(super) fn texel(self, i: i64, n: usize) -> usize {
        let n = n as i64;
        let i = match self {
            Wrap::Repeat => i.rem_euclid(n),
            Wrap::Clamp => i.clamp(0, n - 1),
            Wrap::Mirror => {
                let i = i.rem_euclid(2 * n);
                i.min(2 * n - 1 - i)
            }
        };
        i as usize
    }
}

/// Colours from an image: its lower left corner is (0, 0), its upper right one (1, 1), and between the middles of texels it is bilinear.
/// What the camera sees from so far that texels are smaller than half a pixel is taken from smaller sizes of the image.
#[derive(Clone, Debug)]
pub struct ImageTexture {
    /// The colours.
    pub image: Arc<Pyramid>,
    /// What is beyond its edge.
    pub wrap: Wrap,
    /// Turns (u, v, 0) into coordinates of the image.
    to_image: DAffine3,
    /// Texels to a unit of u and v, as the root of those in an area.
    texels: f64,
}

impl ImageTexture {
    /// A texture; `to_image` turns (u, v, 0) into coordinates of the image.
    pub fn new(image: Arc<Pyramid>, wrap: Wrap, to_image: DAffine3) -> Self {
        let [u, v] = [to_image.matrix3.x_axis, to_image.matrix3.y_axis];
        let texels = (image.image().pixels.len() as f64 * (u.x * v.y - u.y * v.x).abs()).sqrt();
        ImageTexture { image, wrap, to_image, texels }
    }

    fn at(&self, at: &TexturePoint) -> Rgb {
        let place = self.to_image.transform_point3(DVec3::new(at.uv[0], at.uv[1], 0.0));
        self.image.at(self.wrap, [place.x, place.y], at.footprint * self.texels)
    }
}

/// Two colours by turns.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Checker {
    /// The colour of the cell at the origin.
    pub a: Rgb,
    /// The colour of its neighbours.
    pub b: Rgb,
    /// Cells to a unit, above 0.
    pub scale: f64,
    /// In which space cells are squares or cubes.
    pub space: Space,
}

impl Checker {
    fn at(&self, at: &TexturePoint) -> Rgb {
        // Surfaces lie on the faces of cells: rounding must not decide on which side.
        const OFF: f64 = 1e-7;
        let cell = (self.space.of(at) * self.scale + OFF).floor();
        if cell.element_sum().rem_euclid(2.0) < 0.5 { self.a } else { self.b }
    }
}

/// From one colour to another by noise: a + (b − a) ρ, with ρ as of media.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct NoiseTexture {
    /// The colour where the noise is 0.
    pub a: Rgb,
    /// The colour where it is 1.
    pub b: Rgb,
    /// The noise.
    pub noise: Noise,
    /// In which space it is taken.
    pub space: Space,
}

/// A colour, or a number for which the mean of its channels stands, that changes over a surface.
#[derive(Clone, Debug)]
pub enum Texture {
    /// From an image.
    Image(ImageTexture),
    /// Two colours by turns.
    Checker(Checker),
    /// Between two colours by noise.
    Noise(NoiseTexture),
}

impl Texture {
    /// The colour at a place.
    pub fn at(&self, at: &TexturePoint) -> Rgb {
        match self {
            Texture::Image(image) => image.at(at),
            Texture::Checker(checker) => checker.at(at),
            Texture::Noise(noise) => noise.a + (noise.b - noise.a) * noise.noise.at(noise.space.of(at)),
        }
    }

    /// The mean of the channels at a place.
    pub fn number(&self, at: &TexturePoint) -> f64 {
        self.at(at).element_sum() / 3.0
    }

    /// Whether it blurs details that are too small to be seen.
    pub fn is_filtered(&self) -> bool {
        matches!(self, Texture::Image(_))
    }

    /// Whether it is taken at u and v.
    pub fn needs_uv(&self) -> bool {
        match self {
            Texture::Image(_) => true,
            Texture::Checker(Checker { space, .. }) | Texture::Noise(NoiseTexture { space, .. }) => *space == Space::Uv,
        }
    }
}

/// A number or a colour of a material that a texture may stand for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Parameter {
    /// `reflectance`
    Reflectance,
    /// `diffuse`
    Diffuse,
    /// `specular`
    Specular,
    /// `f0`
    F0,
    /// `roughness`
    Roughness,
    /// `weight`
    Weight,
}

/// Which part of a material a parameter is of.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Constituent {
    /// The material itself.
    Whole,
    /// The base of a coat, or the first of a mixture.
    First,
    /// The second of a mixture.
    Second,
}

/// Where a texture takes the place of a constant.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
pub struct Slot {
    /// Of which part.
    pub constituent: Constituent,
    /// What.
    pub parameter: Parameter,
}

/// Textures that turn or lift a surface's normal.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Relief<T = Texture> {
    /// A normal in the coordinates of u, v and the surface's normal, as 2 c − 1 by channel.
    NormalMap(T, f64),
    /// A height, in lengths of the scene, times this.
    Bump(T, f64),
}

/// What changes over a surface.
#[derive(Clone, Debug, Default)]
pub struct Paint {
    /// Textures, in the order of the material's parameters.
    pub textures: Vec<(Slot, Texture)>,
    /// What turns the normal.
    pub relief: Option<Relief>,
    /// Whether any of these needs a [footprint](TexturePoint::footprint).
    pub filtered: bool,
}

impl Paint {
    /// These textures, and what turns the normal.
    pub fn new(textures: Vec<(Slot, Texture)>, relief: Option<Relief>) -> Self {
        let turning = relief.iter().map(|(Relief::NormalMap(texture, _) | Relief::Bump(texture, _))| texture);
        let filtered = textures.iter().map(|(_, texture)| texture).chain(turning).any(Texture::is_filtered);
        Paint { textures, relief, filtered }
    }

    /// Puts what textures are at a place where a material's constants stand.
    pub fn put_on(&self, bsdf: &mut super::Bsdf, at: &TexturePoint) {
        for (slot, texture) in &self.textures {
            bsdf.set(*slot, texture.at(at));
        }
    }

    /// The roughness of a boundary, or the weight of a mixture, at a place.
    pub fn number(&self, parameter: Parameter, constant: f64, at: &TexturePoint) -> f64 {
        let mut textures = self.textures.iter().filter(|(slot, _)| slot.parameter == parameter);
        textures.next().map_or(constant, |(_, texture)| texture.number(at).clamp(0.0, 1.0))
    }

    /// The shading normal at a place, by the outward normal there, and ∂p/∂u and ∂p/∂v in object space and in the world.
    pub fn normal(&self, normal: DVec3, [object, [along_u, along_v]]: [[DVec3; 2]; 2], at: &TexturePoint) -> DVec3 {
        match &self.relief {
            None => normal,
            Some(Relief::NormalMap(texture, strength)) => {
                let c = texture.at(at) * 2.0 - Rgb::ONE;
                let Some(x) = (along_u - along_u.dot(normal) * normal).try_normalize() else { return normal };
                let y = normal.cross(x) * if normal.cross(x).dot(along_v) < 0.0 { -1.0 } else { 1.0 };
                (strength * (c.x * x + c.y * y) + c.z.max(0.0) * normal).try_normalize().unwrap_or(normal)
            }
            Some(Relief::Bump(texture, strength)) => {
                // Differences over a thousandth of the way, about a texel.
                const STEP: f64 = 1e-3;
                let height = |u: f64, v: f64| {
                    let moved = TexturePoint {
                        uv: [at.uv[0] + u, at.uv[1] + v],
                        object: at.object + u * object[0] + v * object[1],
                        footprint: at.footprint,
                    };
                    texture.number(&moved)
                };
                let slope = |u, v| strength * (height(u, v) - height(-u, -v)) / (2.0 * STEP);
                let (du, dv) = (slope(STEP, 0.0), slope(0.0, STEP));
                let raised = (along_u + du * normal).cross(along_v + dv * normal);
                let turned = if raised.dot(normal) < 0.0 { -raised } else { raised };
                turned.try_normalize().unwrap_or(normal)
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::Image;

    /// Rows from the top: the lower left texel is at (0, 0); middles of texels have their own colours, beyond the edge each wrap has its
    /// way.
    #[test]
    fn images_lie_as_they_are_seen() {
        let pixels = vec![[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0; 3]];
        let image = Pyramid::new(Image { width: 2, height: 2, pixels });
        let at = |wrap, uv| {
            let at = TexturePoint { uv, object: DVec3::ZERO, footprint: 0.0 };
            ImageTexture::new(image.clone(), wrap, DAffine3::IDENTITY).at(&at)
        };
        assert_eq!(at(Wrap::Clamp, [0.25, 0.25]), Rgb::new(0.0, 0.0, 1.0));
        assert_eq!(at(Wrap::Clamp, [0.25, 0.75]), Rgb::new(1.0, 0.0, 0.0));
        assert_eq!(at(Wrap::Clamp, [0.5, 0.75]), Rgb::new(0.5, 0.5, 0.0));
        assert_eq!(at(Wrap::Clamp, [-9.0, 9.0]), Rgb::new(1.0, 0.0, 0.0));
        assert_eq!(at(Wrap::Repeat, [1.25, -0.75]), Rgb::new(0.0, 0.0, 1.0));
        assert_eq!(at(Wrap::Mirror, [1.25, 0.25]), Rgb::ONE);
        for far in [1e300, f64::INFINITY, f64::NAN] {
            assert!(at(Wrap::Repeat, [far, -far]).max_element() <= 1.0);
        }
    }
}
