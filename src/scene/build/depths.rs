//! Matter so dense, or so far away, that light in it does not get from one number to the next.

use crate::medium::Medium;
use crate::medium::density::Density;
use crate::scene::Scene;
use crate::scene::description as said;
use crate::{Error, Result};

/// Mean free paths across a solid, at most: the lit surface of one of 10¹³ is right to 2 %, where that of one of 10¹⁵ is half as bright
/// as it should be, for want of digits.
const DEEPEST: f64 = 1e13;

/// Voxels from the scene's origin, at most: within each, numbers still tell some fifty places.
const FARTHEST: f64 = 1e14;

/// Refuses media that are deeper than any path could tell, and those that reach where their voxels have no digits left.
///
/// # Errors
/// [`Error::Scene`](crate::Error::Scene), with the medium's place and that of its densest voxel.
pub(super) fn refuse_endless(scene: &Scene, media: &[said::Medium]) -> Result<()> {
    let inside = scene.solids.iter().filter_map(|solid| Some((solid.medium?, scene.geometry.bounds(solid.shape))));
    let around = scene.world.map(|world| (world, scene.near_bounds()));
    for (index, bounds) in inside.chain(around) {
        let medium: &Medium = &scene.media[index as usize];
        let place = media.iter().find(|said| said.name == medium.name).map(|said| &said.place);
        let refused = |message: String| match place {
            Some(place) => Err(place.error(message)),
            None => Err(Error::Scene(format!("media.{}: {message}", medium.name))),
        };
        let farthest = bounds.min.abs().max(bounds.max.abs()).max_element();
        if let Some(grid) = medium.density.grids().find(|grid| farthest > FARTHEST * grid.voxel_size()) {
            return refused(format!(
                "its voxels are {:.1e} wide, and it is met up to {farthest:.1e} from the scene's middle, which leaves no digits for them: expected at most {FARTHEST:.0e} voxels",
                grid.voxel_size()
            ));
        }
        let extent = bounds.intersection(medium.density.support()).diagonal();
        let depth = medium.max_extinction() * extent;
        if depth <= DEEPEST {
            continue;
        }
        let voxel = match &medium.density {
            Density::Grid(grid) => grid.voxels().densest(),
            _ => None,
        };
        let voxel = voxel.map_or(String::new(), |[i, j, k]| {
            format!(", by the {:.1e} of its voxel ({i}, {j}, {k})", medium.density.max())
        });
        return refused(format!(
            "optical depths up to {depth:.1e}{voxel}: expected at most {DEEPEST:.0e}, a scale in which light gets anywhere"
        ));
    }
    Ok(())
}
