//! All volume photons of a scene, and what a segment of a ray gathers from them.

use std::ops::ControlFlow;

use super::{BeamQuery, DepthTable, GatherStats, Gathered, Lobe, PhaseLanes};
use crate::math::{DVec3, Ray, Rgb, Vec3, one_minus_exp_over};
use crate::medium::density::Density;
use crate::medium::phase::Phase;
use crate::medium::{Emission, Medium};
use crate::photon::PhotonMap;

/// One photon map for each region, so that a ray gathers its region's photons only.
#[derive(Debug)]
pub struct VolumeMaps {
    maps: Vec<Option<PhotonMap>>,
    phases: Vec<PhaseLanes>,
}

/// Memory that a thread reuses from segment to segment.
#[derive(Debug, Default)]
pub struct Scratch {
    table: DepthTable,
    /// What was counted.
    pub stats: GatherStats,
}

/// Optical depth may grow by this much between two knots of a depth table.
const DEPTH_STEP: f64 = 0.5;

/// Knots on a ray through an exponential density.
const EXPONENTIAL_KNOTS: usize = 256;

impl VolumeMaps {
    /// From the maps of all regions, in their order, and all media.
    pub fn new(maps: Vec<Option<PhotonMap>>, media: &[Medium]) -> Self {
        VolumeMaps { maps, phases: media.iter().map(|medium| lanes(&medium.phase)).collect() }
    }

    /// The maps that hold photons.
    pub fn maps(&self) -> impl Iterator<Item = &PhotonMap> {
        self.maps.iter().flatten()
    }

    /// The same, with their regions.
    pub fn by_region(&self) -> impl Iterator<Item = (u32, &PhotonMap)> {
        self.maps.iter().enumerate().filter_map(|(region, map)| Some((region as u32, map.as_ref()?)))
    }

    /// The light scattered or emitted towards `ray`'s origin on its stretch from `a` to `b`, as radiance at
    /// `a`: what photons with at most `max_events` events say. Second, the transmittance of the stretch.
    pub fn gather(
        &self,
        (index, medium): (u32, &Medium),
        region: u32,
        ray: &Ray,
        (a, b): (f64, f64),
        max_events: u8,
        scratch: &mut Scratch,
    ) -> (Gathered, Rgb) {
        let Scratch { table, stats } = scratch;
        let map = self.maps[region as usize].as_ref();
        // No photon reaches beyond the box around all discs.
        let reach = map.and_then(|map| map.bounds().clip(ray, a, b)).map(|(_, end)| end);
        let depth = match &medium.density {
            Density::Grid(_) if reach.is_some() => {
                tabulate(medium, ray, a, b, table);
                table.total()
            }
            Density::Exponential(_) if reach.is_some() => {
                tabulate(medium, ray, a, reach.unwrap_or(a), table);
                medium.density.depth(ray, a, b)
            }
            _ => medium.density.depth(ray, a, b),
        };
        let gathered = match (map, reach) {
            (Some(map), Some(_)) => {
                let query = BeamQuery {
                    origin: ray.at(a),
                    direction: ray.direction,
                    length: (b - a) as f32,
                    phase: &self.phases[index as usize],
                    extinction: medium.extinction.as_vec3(),
                    depth: (!matches!(medium.density, Density::Uniform)).then_some(&*table),
                    max_events,
                };
                map.gather(&query, stats)
            }
            _ => Gathered::default(),
        };
        (gathered, medium.transmittance(depth))
    }
}

/// ∫ T σ_a L_e dt from `a` to `b`, as radiance at `a`: exact where L_e is the same everywhere, else one
/// point a cell, drawn with the numbers `jitter` gives.
pub fn emitted(medium: &Medium, ray: &Ray, (a, b): (f64, f64), mut jitter: impl FnMut() -> f64) -> Rgb {
    match &medium.emission {
        Emission::None => Rgb::ZERO,
        Emission::Uniform(_) => {
            let depth = medium.density.depth(ray, a, b);
            // ∫ e^{−σD} dD; 1/σ over an infinite depth.
            let mean = medium.extinction.map(|sigma| match sigma * depth {
                tau if tau.is_infinite() => 1.0 / sigma,
                tau => {
                    if sigma > 0.0 {
                        depth * one_minus_exp_over(tau)
                    } else {
                        0.0
                    }
                }
            });
            medium.emitted(DVec3::ZERO) * mean
        }
        Emission::BlackBody { temperature, .. } => {
            let Density::Grid(density) = &medium.density else { return Rgb::ZERO };
            let (mut sum, mut depth) = (Rgb::ZERO, 0.0);
            density.cells(ray, a, b, |cell| {
                let inside = cell.integral();
                if inside > 0.0 {
                    let t = cell.ta + (cell.tb - cell.ta) * jitter();
                    let p = ray.at(t);
                    // The depth up to t, as if the cell were even.
                    let share = (t - cell.ta) / (cell.tb - cell.ta);
                    if temperature.at(p) > 0.0 {
                        let here = medium.emitted(p) * (density.at(p) * (cell.tb - cell.ta));
                        sum += here * medium.transmittance(depth + share * inside);
                    }
                }
                depth += inside;
                ControlFlow::Continue(())
            });
            sum
        }
    }
}

/// Fills `table` with the depth from `a` on, in lengths from `a`.
fn tabulate(medium: &Medium, ray: &Ray, a: f64, b: f64, table: &mut DepthTable) {
    table.clear();
    table.push(0.0, 0.0, medium.density.at(ray.at(a)));
    let largest = medium.extinction.max_element();
    match &medium.density {
        Density::Uniform => {}
        Density::Grid(grid) => {
            let mut depth = 0.0;
            grid.cells(ray, a, b, |cell| {
                if !cell.tb.is_finite() {
                    return ControlFlow::Break(());
                }
                // A gap between cells, where the grid is clipped, adds nothing but needs its ends.
                table.push(cell.ta - a, depth, cell.rho_a as f64);
                let inside = cell.integral();
                if inside * largest > DEPTH_STEP && !cell.is_constant() {
                    // Simpson's rule over the first half, whose middle is a quarter in.
                    let quarter = grid.at(ray.at(0.75 * cell.ta + 0.25 * cell.tb));
                    let half = (cell.tb - cell.ta) * (cell.rho_a as f64 + 4.0 * quarter + cell.rho_mid as f64) / 12.0;
                    table.push(0.5 * (cell.ta + cell.tb) - a, depth + half.clamp(0.0, inside), cell.rho_mid as f64);
                }
                depth += inside;
                table.push(cell.tb - a, depth, cell.rho_b as f64);
                ControlFlow::Continue(())
            });
        }
        Density::Exponential(air) => {
            for i in 1..=EXPONENTIAL_KNOTS {
                let t = a + (b - a) * i as f64 / EXPONENTIAL_KNOTS as f64;
                table.push(t - a, air.depth(ray, a, t), air.at(ray.at(t)));
            }
        }
    }
    table.finish();
}

/// A phase function as beam queries want it.
fn lanes(phase: &Phase) -> PhaseLanes {
    let lobe = |phase: &Phase| match phase {
        Phase::HenyeyGreenstein(p) => Lobe::HenyeyGreenstein(p.g),
        Phase::Schlick(p) => Lobe::Schlick(p.k),
        Phase::Rayleigh(_) => Lobe::Rayleigh,
        Phase::Draine(p) => Lobe::Draine(p.g, p.alpha),
        Phase::Isotropic(_) | Phase::Mixture(_) => Lobe::Isotropic,
    };
    match phase {
        Phase::Mixture(mixture) => {
            let lobes: Vec<_> = mixture.lobes().iter().map(|(weight, phase)| (*weight, lobe(phase))).collect();
            PhaseLanes::mixture(&lobes)
        }
        _ => PhaseLanes::new(lobe(phase)),
    }
}

impl Gathered {
    /// Both parts in `f64`.
    pub fn rgb(&self) -> (Rgb, Rgb) {
        let wide = |rgb: [f32; 3]| Vec3::from_array(rgb).as_dvec3();
        (wide(self.total), wide(self.single))
    }
}
