//! What grids of a density's file tell of a medium: coefficients, albedos, mean cosines and glows.

use std::path::PathBuf;
use std::sync::Arc;

use super::Builder;
use crate::math::{DAffine3, Rgb};
use crate::medium::density::bricks::{BrickGrid, NegativePolicy};
use crate::medium::density::{Density, Grid, vdb};
use crate::medium::{Albedo, Asymmetry, Field};
use crate::scene::description::{self as said, Located, NamedGrid};
use crate::{Error, Result};

/// How much of the light that meets it a medium extinguishes and scatters, and where.
pub(super) struct Matter {
    pub extinction: Rgb,
    pub albedo: Albedo,
    pub density: Density,
}

/// A grid of an open file.
pub(super) struct Source<'d> {
    said: &'d Located<PathBuf>,
    name: Option<&'d Located<String>>,
    file: vdb::File,
    /// Its index in the file.
    pub index: usize,
}

impl<'d> Source<'d> {
    /// Opens the grid of this name; without one, the file's only grid, or else `density`.
    pub fn open(said: &'d Located<PathBuf>, name: Option<&'d Located<String>>) -> Result<Self> {
        let file = vdb::File::open(&said.value).map_err(|error| said.place.error(error))?;
        let mut source = Source { said, name, file, index: 0 };
        source.index = match name {
            Some(name) => source.file.find(&name.value).map_err(|error| source.fail(error))?,
            None if source.file.grids().len() == 1 => 0,
            None => source.file.find("density").map_err(|error| source.fail(error))?,
        };
        Ok(source)
    }

    /// An error about it.
    pub fn fail(&self, error: Error) -> Error {
        self.name.map_or(&self.said.place, |name| &name.place).error(error)
    }

    /// An error about its voxels.
    fn fault(&self, message: String) -> Error {
        let name = &self.file.grids()[self.index].name;
        self.fail(Error::asset(&self.said.value, format!("grid {name:?}: {message}")))
    }

    /// Reads its voxels, of which each has one number.
    pub fn read(&self) -> Result<vdb::Grid> {
        self.file.read_at(self.index).map_err(|error| self.fail(error))
    }

    /// Reads its voxels, a grid for each of the numbers that they have.
    fn read_channels(&self) -> Result<Vec<vdb::Grid>> {
        let channels = self.file.grids()[self.index].channels().unwrap_or(1);
        let read = |channel| self.file.read_channel(self.index, channel).map_err(|error| self.fail(error));
        (0..channels).map(read).collect()
    }

    /// From its index space to the file's own world.
    fn own_place(&self) -> Result<DAffine3> {
        let own = self.file.grids()[self.index].index_to_world.clone();
        own.map_err(|message| self.fail(Error::asset(&self.said.value, message)))
    }

    /// From its index space to the coordinates of the scene file.
    pub fn place(&self, transform: DAffine3) -> Result<DAffine3> {
        let place = transform * self.own_place()?;
        if !place.is_finite() || place.matrix3.determinant() == 0.0 {
            return Err(self.said.place.error("the grid's transform cannot be inverted"));
        }
        Ok(place)
    }

    /// Refuses voxels that are not as `is_fine` says, with their number and the worst of them.
    fn refuse_unless(&self, grids: &[vdb::Grid], is_fine: impl Fn(f64) -> bool, expected: &str) -> Result<()> {
        let values = grids.iter().flat_map(vdb::Grid::values).map(|(value, count)| (f64::from(value), count));
        let (mut wrong, mut worst) = (0, 0.0);
        for (value, count) in values.filter(|(value, _)| !is_fine(*value)) {
            wrong += count;
            worst = if value.abs() > f64::abs(worst) || value.is_nan() { value } else { worst };
        }
        match wrong {
            0 => Ok(()),
            _ => Err(self.fault(format!("{wrong} values are out of range, the worst {worst}; expected {expected}"))),
        }
    }
}

/// Says of which scale values are, if they have one.
fn scaled(grid: &NamedGrid) -> String {
    if grid.scale == 1.0 { String::new() } else { format!(" after its scale of {}", grid.scale) }
}

/// How far rounding may lead beyond a bound.
const ROUNDING: f64 = 1e-6;
/// By how much the extinction of a voxel may differ in colour from that of the densest, as a share of its own,
const COLOUR: f64 = 2e-3;
/// and of that of the densest.
const FAINT: f64 = 1e-4;

impl<'d> Builder<'d> {
    /// A field that tells `what`, from 0 to `most`, and its least value by channel.
    pub(super) fn field(
        &mut self,
        said: &'d said::Medium,
        grid: &'d NamedGrid,
        (most, what): (f64, &str),
    ) -> Result<(Field, Rgb)> {
        let said::Density::Vdb { file, transform, interpolation, negative, .. } = &said.density else {
            return Err(grid.name.place.error("needs a density of type \"vdb\""));
        };
        let source = Source::open(file, Some(&grid.name))?;
        let grids = source.read_channels()?;
        let expected = match most.is_finite() {
            true => format!("{what} of at most {most}{}", scaled(grid)),
            false => what.to_string(),
        };
        source.refuse_unless(&grids, |value| value * grid.scale <= most + ROUNDING, &expected)?;
        let place = source.place(*transform)?;
        let highest = (most / grid.scale) as f32;
        let (mut placed, mut least) = (Vec::new(), Vec::new());
        for grid in grids {
            let values = grid.values().map(|(value, _)| f64::from(value.max(0.0)));
            least.push(values.fold(f64::INFINITY, f64::min));
            let voxels = BrickGrid::from_vdb(&grid.map(|value| value.min(highest)), *negative);
            let voxels = voxels.map_err(|error| source.fail(error))?;
            let voxels = voxels.with_interpolation(*interpolation).with_precision(said.precision);
            placed.push(Grid::new(Arc::new(voxels), place));
        }
        let least = grid.scale * by_channel(&least);
        Ok((in_channels(placed, Rgb::splat(grid.scale)), least))
    }

    /// The mean cosine of a phase function.
    pub(super) fn asymmetry(&mut self, said: &'d said::Medium, grid: &'d NamedGrid) -> Result<Asymmetry> {
        let said::Density::Vdb { file, transform, interpolation, .. } = &said.density else {
            return Err(grid.name.place.error("needs a density of type \"vdb\""));
        };
        let source = Source::open(file, Some(&grid.name))?;
        let read = source.read()?;
        let expected = format!("mean cosines between -1 and 1{}", scaled(grid));
        let grids = [read];
        source.refuse_unless(&grids, |value| (value * grid.scale).abs() < 1.0, &expected)?;
        let [read] = grids;
        let largest = read.values().map(|(value, _)| (f64::from(value) * grid.scale).abs()).fold(0.0, f64::max);
        let shifted = read.map(|value| (1.0 + f64::from(value) * grid.scale) as f32);
        let voxels = BrickGrid::from_vdb(&shifted, NegativePolicy::Error).map_err(|error| source.fail(error))?;
        let voxels = Arc::new(voxels.with_interpolation(*interpolation));
        Ok(Asymmetry::new(Grid::new(voxels, source.place(*transform)?), largest))
    }

    /// Of coefficients that are grids: voxel by voxel, their sum is the density, times that of a grid that is named for it.
    pub(super) fn coefficients(&mut self, said: &'d said::Medium) -> Result<Matter> {
        let said::Density::Vdb { file, grid: factor, transform, interpolation, negative } = &said.density else {
            return Err(said.place.error("coefficients that are grids need a density of type \"vdb\""));
        };

        // All grids, and where the numbers of each begin among those of a voxel.
        let mut parts: Vec<(vdb::Grid, BrickGrid)> = Vec::new();
        let mut place: Option<(DAffine3, DAffine3)> = None;
        let mut add = |name: &'d Located<String>| {
            let source = Source::open(file, Some(name))?;
            let own = source.own_place()?;
            let (first, _) = *place.get_or_insert((own, source.place(*transform)?));
            if first != own {
                return Err(
                    source.fault("has another transform than the grids it is added to or multiplied by".to_string())
                );
            }
            let from = parts.len();
            for grid in source.read_channels()? {
                let voxels = BrickGrid::from_vdb(&grid, *negative).map_err(|error| source.fail(error))?;
                parts.push((grid, voxels));
            }
            Ok((from, parts.len() - from))
        };
        let factor = factor.as_ref().map(&mut add).transpose()?;
        let mut coefficient = |number: Rgb, grid: &'d Option<NamedGrid>| -> Result<Coefficient> {
            let channels = grid.as_ref().map(|grid| add(&grid.name)).transpose()?;
            Ok(Coefficient { scale: grid.as_ref().map_or(number, |grid| Rgb::splat(grid.scale)), channels })
        };
        let sigma_s = coefficient(said.sigma_s, &said.grids.sigma_s)?;
        let sigma_a = coefficient(said.sigma_a, &said.grids.sigma_a)?;
        let (_, to_world) = place.unwrap_or_default();

        // The extinction's greatest channel is the density.
        let density_of = |numbers: &[f32]| factor.map_or(1.0, |(at, _)| f64::from(numbers[at]));
        let sum = |numbers: &[f32]| (sigma_s.at(numbers) + sigma_a.at(numbers)) * density_of(numbers);
        let make = |value: &mut dyn FnMut(&[f32]) -> f64| -> Result<Grid> {
            let voxels = BrickGrid::from_grids(&parts, |numbers| value(numbers) as f32);
            let voxels = voxels.map_err(|error| said.place.error(error))?;
            let voxels = voxels.with_interpolation(*interpolation).with_precision(said.precision);
            Ok(Grid::new(Arc::new(voxels), to_world))
        };
        let mut densest = Rgb::ZERO;
        let density = make(&mut |numbers| {
            let sum = sum(numbers);
            if sum.max_element() > densest.max_element() {
                densest = sum;
            }
            sum.max_element()
        })?;
        let tint = if densest == Rgb::ZERO { Rgb::ONE } else { densest / densest.max_element() };

        // What of it is scattered, by unit of the extinction.
        let (mut strange, mut least, mut most) = (0_u64, Rgb::ONE, Rgb::ZERO);
        let widths = sigma_s.channels.map_or(1, |(_, count)| count);
        let scattered = (0..widths).map(|channel| {
            make(&mut |numbers| {
                let (sum, part) = (sum(numbers), sigma_s.at(numbers) * density_of(numbers));
                let whole = sum.max_element();
                let off = (sum - whole * tint).abs().max_element();
                if channel == 0 && off > COLOUR * whole + FAINT * densest.max_element() {
                    strange += 1;
                }
                let known = sum.cmpgt(Rgb::ZERO);
                least = Rgb::select(known, least.min(part / sum), least);
                most = Rgb::select(known, most.max(part / sum), most);
                sigma_s.number(numbers, channel) * density_of(numbers)
            })
        });
        let scattered: Vec<Grid> = scattered.collect::<Result<_>>()?;
        if strange > 0 {
            let message = format!(
                "the extinction sigma_s + sigma_a of {strange} voxels has another colour than that of the densest, {tint}: so far its colour must be the same everywhere"
            );
            return Err(said.place.error(message));
        }
        let by_extinction = Rgb::select(tint.cmpgt(Rgb::ZERO), sigma_s.scale / tint, Rgb::ZERO);
        let albedo = Albedo::of_scattering(in_channels(scattered, by_extinction), least.min(most), most);
        Ok(Matter { extinction: tint, albedo, density: Density::Grid(density) })
    }
}

/// A coefficient, where the density is 1.
struct Coefficient {
    /// The number, or what the grid is multiplied by.
    scale: Rgb,
    /// Where the grid's numbers begin among those of a voxel, and how many they are.
    channels: Option<(usize, usize)>,
}

impl Coefficient {
    /// The grid's number of a channel; 1 without a grid.
    fn number(&self, numbers: &[f32], channel: usize) -> f64 {
        self.channels.map_or(1.0, |(from, count)| f64::from(numbers[from + channel.min(count - 1)]))
    }

    fn at(&self, numbers: &[f32]) -> Rgb {
        self.scale * Rgb::from_array([0, 1, 2].map(|channel| self.number(numbers, channel)))
    }
}

/// The number of each channel, be there three or one.
fn by_channel(numbers: &[f64]) -> Rgb {
    Rgb::from_array([0, 1, 2].map(|channel: usize| numbers[channel.min(numbers.len() - 1)]))
}

/// A field of one grid, or of one for each channel.
fn in_channels(grids: Vec<Grid>, scale: Rgb) -> Field {
    match <[Grid; 3]>::try_from(grids) {
        Ok(grids) => Field::colour(grids, scale),
        Err(mut grids) => Field::grey(grids.swap_remove(0), scale),
    }
}
