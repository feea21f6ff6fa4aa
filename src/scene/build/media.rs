//! Media: what fills solids and the world, with the voxels they are made of.

use std::path::PathBuf;
use std::sync::Arc;

use super::grids::{Matter, Source};
use super::{Builder, Kept};
use crate::Result;
use crate::math::{Bounds, DAffine3, DVec3};
use crate::medium::black_body::BlackBody;
use crate::medium::density::bricks::{BrickGrid, Interpolation, NegativePolicy, Precision};
use crate::medium::density::{Density, Grid, npy};
use crate::medium::{Albedo, Emission, Medium, Phases};
use crate::scene::description::{self as said, Located};

impl Builder<'_> {
    /// The medium at `index` of the description, carried along by an instance: an index into `media`.
    pub(super) fn medium(&mut self, index: usize, instance: Option<usize>) -> Result<u32> {
        // What does not depend on the place is not carried.
        let even = self.description.media[index].density.even().is_some();
        let key = (index, if even { None } else { instance });
        if let Some(&medium) = self.carried.get(&key) {
            return Ok(medium);
        }
        if !self.loaded.contains_key(&index) {
            let medium = self.load_medium(index)?;
            self.loaded.insert(index, medium);
        }
        let carry = match key.1 {
            Some(instance) => self.moved() * self.description.shapes[instance].transform,
            None => self.moved(),
        };
        let medium = self.loaded[&index].moved(carry);
        let id = self.media.len() as u32;
        self.media.push(medium);
        self.carried.insert(key, id);
        Ok(id)
    }

    fn load_medium(&mut self, index: usize) -> Result<Medium> {
        let said = &self.description.media[index];
        let Matter { extinction, albedo, density } = match &said.grids {
            grids if grids.sigma_s.is_some() || grids.sigma_a.is_some() => self.coefficients(said)?,
            _ => self.matter(index)?,
        };
        let phase = match &said.grids.mean_cosine {
            None => said.phase.clone().into(),
            Some(grid) => Phases::HenyeyGreenstein(Box::new(self.asymmetry(said, grid)?)),
        };
        let emission = match &said.emission {
            None => Emission::None,
            Some(said::MediumEmission::Constant { radiance }) => Emission::Uniform(*radiance),
            Some(said::MediumEmission::Grid { radiance }) => {
                Emission::Grid(Box::new(self.field(said, radiance, (f64::INFINITY, "a radiance"))?.0))
            }
            Some(said::MediumEmission::BlackBody { temperature, kelvin_scale, scale }) => {
                let Some((file, transform)) = said.density.grids() else {
                    return Err(temperature.place.error("a grid of temperatures needs a density of type \"vdb\""));
                };
                let kept = (Interpolation::Trilinear, NegativePolicy::Zero, Precision::Full);
                let grid = self.vdb(file, Some(temperature), transform, kept)?;
                Emission::BlackBody {
                    temperature: Box::new(grid),
                    kelvin_scale: *kelvin_scale,
                    scale: *scale,
                    table: BlackBody::default(),
                }
            }
        };
        let medium = Medium { name: said.name.clone(), extinction, albedo, phase, density, emission };
        if (said.sigma_t().max_element() > 0.0 || !said.grids.is_empty()) && medium.is_clear() {
            self.warnings.push(said.place.told("the density is 0 everywhere: the medium is vacuum"));
        }
        Ok(medium)
    }
    /// Of coefficients that are numbers, and perhaps a grid of albedos.
    fn matter(&mut self, index: usize) -> Result<Matter> {
        let said = &self.description.media[index];
        let (mut extinction, albedo) = match &said.grids.albedo {
            None => (said.sigma_t(), said.albedo().into()),
            Some((extinction, grid)) => {
                let (field, least) = self.field(said, grid, (1.0, "an albedo"))?;
                (*extinction, Albedo::of_field(field, least))
            }
        };
        let density = match &said.density {
            said::Density::Constant { value } => {
                extinction *= *value;
                Density::Uniform
            }
            said::Density::Exponential(air) => Density::Exponential(*air),
            said::Density::Noise(noise) => {
                let extents = self.extents.get(&index).map_or(&[][..], Vec::as_slice);
                let grid = noise.sample(extents).map_err(|error| said.place.error(error))?;
                Density::Grid(grid.with_precision(said.precision))
            }
            said::Density::Array { file, min, max } => {
                Density::Grid(self.array(file, *min, *max)?.with_precision(said.precision))
            }
            said::Density::Vdb { file, grid, transform, interpolation, negative } => {
                let kept = (*interpolation, *negative, said.precision);
                Density::Grid(self.vdb(file, grid.as_ref(), *transform, kept)?)
            }
        };
        Ok(Matter { extinction, albedo, density })
    }

    fn vdb(
        &mut self,
        file: &Located<PathBuf>,
        name: Option<&Located<String>>,
        transform: DAffine3,
        kept: Kept,
    ) -> Result<Grid> {
        let source = Source::open(file, name)?;
        let (interpolation, negative, precision) = kept;
        let key = (file.value.clone(), source.index, kept);
        let voxels = match self.voxels.get(&key) {
            Some(voxels) => voxels.clone(),
            None => {
                let grid = source.read()?;
                let voxels = BrickGrid::from_vdb(&grid, negative).map_err(|error| source.fail(error))?;
                let voxels = Arc::new(voxels.with_interpolation(interpolation).with_precision(precision));
                self.voxels.insert(key, voxels.clone());
                voxels
            }
        };
        Ok(Grid::new(voxels, source.place(transform)?))
    }

    fn array(&mut self, file: &Located<PathBuf>, min: DVec3, max: DVec3) -> Result<Grid> {
        let array = npy::read(&file.value).map_err(|error| file.place.error(error))?;
        let [nx, ny, nz] = array.dims;
        let count = |wrong: fn(&f32) -> bool| array.values.iter().filter(|value| wrong(value)).count();
        let (odd, negative) = (count(|value| !value.is_finite()), count(|value| *value < 0.0));
        if odd + negative > 0 {
            return Err(file.place.error(format!(
                "{}: {odd} values are infinite or not numbers and {negative} are negative; densities must be finite and at least 0: repair the array",
                file.value.display()
            )));
        }
        // Clamped to the outer samples inside the box: one more layer of them all around.
        let mut values = Vec::with_capacity((nx + 2) * (ny + 2) * (nz + 2));
        for k in 0..nz + 2 {
            for j in 0..ny + 2 {
                let inner = |i: usize, n: usize| i.clamp(1, n) - 1;
                let row = (inner(k, nz) * ny + inner(j, ny)) * nx;
                values.extend((0..nx + 2).map(|i| array.values[row + inner(i, nx)]));
            }
        }
        let voxels = BrickGrid::from_dense([-1; 3], [nx + 2, ny + 2, nz + 2], &values, 0.0, NegativePolicy::Error)
            .map_err(|error| file.place.error(error))?;
        let counts = DVec3::new(nx as f64, ny as f64, nz as f64);
        let cell = (max - min) / counts;
        let to_world = DAffine3::from_translation(min + 0.5 * cell) * DAffine3::from_scale(cell);
        let clip = Bounds { min: DVec3::splat(-0.5), max: counts - 0.5 };
        Ok(Grid::new(Arc::new(voxels), to_world).clipped(clip))
    }
}
