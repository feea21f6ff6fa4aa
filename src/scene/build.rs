//! From what a scene file says to what the renderer needs: files loaded, instances placed, media carried
//! along, and everything moved so that the scene's middle is the origin.

mod depths;
mod grids;
mod lights;
mod media;
mod origin;
mod overlaps;
mod paint;
mod regions;

use std::collections::HashMap;
use std::path::PathBuf;
use std::sync::Arc;

use origin::Origin;

use super::description::{self as said, Description, Located, ShapeKind, Strength};
use super::world::{Scene, Solid, Surface};
use super::{Glow, Settings};
use crate::geometry::{Cuboid, Cylinder, Disk, Distances, Geometry, Lathe, Mesh, Placed, Quad, Shape, Sphere};
use crate::light::{Area, Directivity, Emitters, Light, Profile, Sides, Surroundings};
use crate::math::{Bounds, DAffine3, DVec3, Rgb};
use crate::medium::Medium;
use crate::medium::density::bricks::{BrickGrid, Interpolation, NegativePolicy, Precision};
use crate::surface::{Paint, Pyramid};
use crate::{Error, Result};

/// Loads and builds a scene. With it come the settings that its file gives for the picture.
///
/// # Errors
/// [`Error::Scene`], with its place, for files that cannot be used, for solids whose mesh is not closed, and
/// for scenes without a steady state.
pub fn build(description: &Description) -> Result<(Scene, Settings)> {
    let mut builder = Builder::new(description);
    builder.place_shapes()?;
    builder.place_lights()?;
    Ok((builder.finish()?, Settings::of(description)))
}

/// What a placed shape will be.
struct Part {
    placed: Placed,
    surface: Surface,
    solid: Option<Filling>,
    emission: Option<Shine>,
}

/// What is inside a placed shape that is a solid.
struct Filling {
    /// An index into `media`; `None` is vacuum.
    medium: Option<u32>,
    /// The index of refraction, of a dielectric.
    index: Option<Rgb>,
    /// Of the solids around a point, the one with the highest decides what is there.
    priority: i32,
    /// Whether its medium adds to that of the solids it overlaps.
    adds: bool,
}

/// How a placed shape shines.
enum Shine {
    Radiance(Rgb, Sides),
    Power(Rgb, Sides),
    Disc(Directivity),
}

/// A shape to be placed.
struct Unplaced {
    /// Its index in the description.
    index: usize,
    /// The surface in object space, an instance's template's.
    shape: Shape,
    /// From object space to the file's coordinates.
    transform: DAffine3,
    /// If it is an instance, its index in the description.
    instance: Option<usize>,
}

/// How voxels are read and kept.
type Kept = (Interpolation, NegativePolicy, Precision);

struct Builder<'d> {
    description: &'d Description,
    /// Where the origin is to be.
    origin: Origin,
    meshes: HashMap<(PathBuf, bool), Arc<Mesh>>,
    /// By file, the grid's index in it, and how it is read.
    voxels: HashMap<(PathBuf, usize, Kept), Arc<BrickGrid>>,
    /// Where media of noise are, in the coordinates of the noise, by index in the description.
    extents: HashMap<usize, Vec<Bounds>>,
    /// Base media in the file's coordinates, by index in the description.
    loaded: HashMap<usize, Medium>,
    /// Media by index in the description and the instance that carries them.
    media: Vec<Medium>,
    carried: HashMap<(usize, Option<usize>), u32>,
    parts: Vec<Part>,
    images: HashMap<(PathBuf, said::ColorSpace), Arc<Pyramid>>,
    paints: Vec<Paint>,
    /// By index of the material in the description.
    painted: HashMap<usize, u32>,
    lights: Vec<Light>,
    profiles: HashMap<PathBuf, Arc<Profile>>,
    warnings: Vec<String>,
}

impl<'d> Builder<'d> {
    fn new(description: &'d Description) -> Self {
        Builder {
            description,
            origin: Origin { center: DVec3::ZERO, near: f64::INFINITY },
            meshes: HashMap::new(),
            voxels: HashMap::new(),
            extents: HashMap::new(),
            loaded: HashMap::new(),
            media: Vec::new(),
            carried: HashMap::new(),
            parts: Vec::new(),
            images: HashMap::new(),
            paints: Vec::new(),
            painted: HashMap::new(),
            lights: Vec::new(),
            profiles: HashMap::new(),
            warnings: description.warnings.clone(),
        }
    }

    /// The transform from the file's coordinates to the scene's.
    fn moved(&self) -> DAffine3 {
        DAffine3::from_translation(-self.origin.center)
    }

    // Shapes.

    fn place_shapes(&mut self) -> Result<()> {
        let description = self.description;
        let shapes: Vec<Unplaced> = description
            .shapes
            .iter()
            .enumerate()
            .filter(|(_, shape)| shape.visible)
            .map(|(index, shape)| {
                let (template, transform, instance) = match shape.kind {
                    ShapeKind::Instance { of } => {
                        let template = &description.shapes[of];
                        (template, shape.transform * template.transform, Some(index))
                    }
                    _ => (shape, shape.transform, None),
                };
                Ok(Unplaced { index, shape: self.shape(template)?, transform, instance })
            })
            .collect::<Result<_>>()?;

        let mut boxes = Vec::with_capacity(shapes.len());
        for unplaced in &shapes {
            let place = &description.shapes[unplaced.index].place;
            let placed = Placed::new(unplaced.shape.clone(), unplaced.transform).map_err(|error| place.error(error))?;
            boxes.push((place, placed.bounds()));
        }
        self.origin = Origin::of(description, &boxes)?;
        self.find_noise(&shapes)?;

        for Unplaced { index, shape, transform, instance } in shapes {
            let said = &description.shapes[index];
            let placed = Placed::new(shape, self.moved() * transform).map_err(|error| said.place.error(error))?;
            let material_index = self.met_everywhere(said.material.value);
            let material = description.materials[material_index].kind;
            let medium = match &said.interior {
                Some(interior) => Some(self.medium(interior.value, instance)?),
                None => None,
            };
            let index_of_refraction = material.index();
            let adds = said.interior.as_ref().is_some_and(|interior| description.media[interior.value].adds);
            let is_solid = medium.is_some() || index_of_refraction.is_some();
            if is_solid && !placed.is_closed() {
                let why = if medium.is_some() { "an interior" } else { "a dielectric material" };
                return Err(said.place.error(format!(
                    "this shape has {why}, but is not closed, so nothing is inside: every edge of a solid's mesh must be shared by two triangles wound alike"
                )));
            }
            let emission = said.emission.as_ref().map(|emission| match emission.strength {
                Strength::Radiance(radiance) => Shine::Radiance(radiance, emission.side),
                Strength::Power(power) => Shine::Power(power, emission.side),
            });
            let paint = self.paint(material_index, &said.material.place, &placed)?;
            self.parts.push(Part {
                placed,
                surface: Surface { material, solid: None, light: None, paint, caustics: said.caustics },
                solid: is_solid.then_some(Filling {
                    medium,
                    index: index_of_refraction,
                    priority: said.priority,
                    adds,
                }),
                emission,
            });
        }
        Ok(())
    }

    /// Noise is sampled where there are shapes it fills. An instance carries the noise along: it is sampled where
    /// the template stands.
    fn find_noise(&mut self, shapes: &[Unplaced]) -> Result<()> {
        for Unplaced { index, shape, transform, instance } in shapes {
            let said = &self.description.shapes[*index];
            let Some(interior) = &said.interior else { continue };
            if !self.description.media[interior.value].density.fills_shapes() {
                continue;
            }
            let transform = match instance {
                Some(_) => said.transform.inverse() * *transform,
                None => *transform,
            };
            let placed = Placed::new(shape.clone(), transform).map_err(|error| said.place.error(error))?;
            self.extents.entry(interior.value).or_default().push(placed.bounds());
        }
        Ok(())
    }

    fn shape(&mut self, shape: &said::Shape) -> Result<Shape> {
        let made = match &shape.kind {
            ShapeKind::Sphere { center, radius } => Sphere::new(*center, *radius).map(Shape::Sphere),
            ShapeKind::Box { min, max } => Cuboid::new(*min, *max).map(Shape::Cuboid),
            ShapeKind::Quad { origin, edge_u, edge_v } => Quad::new(*origin, *edge_u, *edge_v).map(Shape::Quad),
            ShapeKind::Disk { center, normal, radius } => Disk::new(*center, *normal, *radius).map(Shape::Disk),
            ShapeKind::Cylinder { base, top, radius, caps } => {
                Cylinder::new(*base, *top, *radius, *caps).map(Shape::Cylinder)
            }
            ShapeKind::Lathe { profile, segments, crease } => {
                let crease = crease.to_radians();
                let made = match segments {
                    Some(segments) => Lathe::facets(profile, *segments, crease).map(|mesh| Shape::Mesh(Arc::new(mesh))),
                    None => Lathe::new(profile, crease).map(|lathe| Shape::Lathe(Arc::new(lathe))),
                };
                made.map_err(|error| shape.place.error(error))
            }
            ShapeKind::Mesh { file, smooth } => self.mesh(file, *smooth).map(Shape::Mesh),
            ShapeKind::Instance { .. } => Err(shape.place.error("an instance of an instance")),
        };
        made.map_err(|error| match error {
            Error::Scene(_) => error,
            other => shape.place.error(other),
        })
    }

    fn mesh(&mut self, file: &Located<PathBuf>, smooth: bool) -> Result<Arc<Mesh>> {
        let key = (file.value.clone(), smooth);
        if let Some(mesh) = self.meshes.get(&key) {
            return Ok(mesh.clone());
        }
        let mesh = Arc::new(Mesh::load(&file.value, smooth).map_err(|error| file.place.error(error))?);
        self.meshes.insert(key, mesh.clone());
        Ok(mesh)
    }

    // The scene.

    fn finish(mut self) -> Result<Scene> {
        let description = self.description;
        let finishes = self.finishes()?;
        let world = match &description.world.medium {
            Some(medium) => Some(self.medium(medium.value, None)?),
            None => None,
        };

        let mut camera = description.camera.clone();
        camera.position -= self.origin.center;
        camera.target -= self.origin.center;

        // Precedence: by priority, then those that add to the others, then by order in the file.
        let mut order: Vec<usize> = (0..self.parts.len()).filter(|&i| self.parts[i].solid.is_some()).collect();
        order.sort_by_key(|&i| self.parts[i].solid.as_ref().map(|filling| (filling.priority, filling.adds)));
        let mut solids = Vec::with_capacity(order.len());
        for part in order {
            if let Some(Filling { medium, index, adds, .. }) = self.parts[part].solid {
                self.parts[part].surface.solid = Some(solids.len() as u32);
                solids.push(Solid { shape: part as u32, medium, index, adds, overlaps_itself: false, region: 0 });
            }
        }

        let shines: Vec<Option<Shine>> = self.parts.iter_mut().map(|part| part.emission.take()).collect();
        let mut surfaces: Vec<Surface> = self.parts.iter().map(|part| part.surface).collect();
        let geometry = Geometry::new(self.parts.into_iter().map(|part| part.placed).collect());
        for solid in &mut solids {
            solid.overlaps_itself = geometry.overlaps_itself(solid.shape);
        }
        for (id, shine) in shines.into_iter().enumerate() {
            let (area, bounds) = (geometry.area(id as u32), geometry.bounds(id as u32));
            let (profile, sides) = match shine {
                None => continue,
                Some(Shine::Radiance(radiance, sides)) => (Directivity::Diffuse(radiance), sides),
                Some(Shine::Power(power, sides)) => {
                    (Directivity::Diffuse(power / (std::f64::consts::PI * area * sides.count())), sides)
                }
                Some(Shine::Disc(profile)) => (profile, Sides::Out),
            };
            let light = Area::new(id as u32, (profile, sides), area, bounds);
            if light.power().max_element() > 0.0 {
                surfaces[id].light = Some(self.lights.len() as u32);
                self.lights.push(Light::Area(light));
            }
        }

        let has_holes = surfaces.iter().any(|surface| surface.material.shades() && !surface.material.is_opaque());
        let mut scene = Scene {
            camera,
            geometry,
            surfaces,
            paints: self.paints,
            finishes,
            has_holes,
            solids,
            overlaps: Vec::new(),
            world,
            world_region: 0,
            regions: 1,
            distances: Vec::new(),
            region_media: Vec::new(),
            media: self.media,
            lights: self.lights,
            emitters: Emitters::default(),
            glows: Vec::new(),
            surroundings: Surroundings { center: DVec3::ZERO, radius: 0.0 },
            center: self.origin.center,
            near: self.origin.near,
            warnings: self.warnings,
        };
        overlaps::add_up(&mut scene, &description.media)?;
        regions::join_regions(&mut scene);
        scene.surroundings = regions::surroundings(&scene);
        regions::darken_infinity(&mut scene);
        scene.emitters = Emitters::new(&scene.lights, &scene.geometry);
        scene.glows = glows(&scene);
        scene.distances = distances(&scene);
        depths::refuse_endless(&scene, &description.media)?;
        Ok(scene)
    }
}

/// The glowing media that have an end, each in a box around the places that it fills.
fn glows(scene: &Scene) -> Vec<Glow> {
    let glow = |(index, medium): (u32, &Medium)| {
        let support = medium.density.support();
        let mut bounds = Bounds::EMPTY;
        if scene.world == Some(index) {
            bounds = support;
        }
        for solid in scene.solids.iter().filter(|solid| solid.medium == Some(index)) {
            bounds = bounds.union(scene.geometry.bounds(solid.shape).intersection(support));
        }
        Glow::new(index, medium, bounds, |p| scene.radiated(index, p).map(|(radiance, _)| radiance))
    };
    (0..).zip(&scene.media).filter(|(_, medium)| medium.glows()).filter_map(glow).collect()
}

/// Light wanders in what is more than so many mean free paths across.
const WANDERS: f64 = 8.0;
/// Cells that remember distances have edges of so many mean free paths.
const CELL: f64 = 0.5;

/// How far surfaces are from places in each solid and in the world, for media of one density in which light wanders.
fn distances(scene: &Scene) -> Vec<Option<Distances>> {
    let of = |medium: Option<u32>, bounds: &dyn Fn() -> Bounds| {
        let medium = &scene.media[medium? as usize];
        let extinction = medium.max_extinction();
        if !medium.density.is_even() || !medium.scatters() {
            return None;
        }
        let bounds = bounds();
        (extinction * bounds.diagonal() > WANDERS).then_some((bounds, CELL / extinction))
    };
    let solids = scene.solids.iter().map(|solid| of(solid.medium, &|| scene.geometry.bounds(solid.shape)));
    let wanted: Vec<Option<(Bounds, f64)>> = solids.chain([of(scene.world, &|| scene.bounds())]).collect();
    let sharing = wanted.iter().flatten().count();
    wanted.into_iter().map(|wanted| wanted.and_then(|(bounds, edge)| Distances::new(&bounds, edge, sharing))).collect()
}
