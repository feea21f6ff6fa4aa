//! The order of photons: that of a median split, down to blocks of sixteen.

use super::Photon;
use crate::math::Vec3;
use crate::photon::simd::LANES;
use rayon::prelude::*;

/// Subsets of fewer photons are ordered by one thread.
const PARALLEL_PHOTONS: usize = 8192;

/// The photons that a map can hold.
pub(crate) fn storable(mut photons: Vec<Photon>) -> Vec<Photon> {
    photons.truncate(u32::MAX as usize);
    if !photons.par_iter().all(Photon::is_finite) {
        photons.retain(Photon::is_finite);
    }
    photons
}

/// Photons in median order.
pub(crate) fn ordered(mut photons: Vec<Photon>) -> Vec<Photon> {
    split(&mut photons);
    photons
}

/// The most pieces that photons are handled in.
const PIECES: usize = 16;

/// Photons in pieces of whole blocks, in order: memory is given back piece by piece.
pub(crate) fn pieces(mut photons: Vec<Photon>) -> Vec<Vec<Photon>> {
    let size = photons.len().div_ceil(PIECES).next_multiple_of(PARALLEL_PHOTONS);
    let mut pieces = Vec::with_capacity(PIECES);
    while photons.len() > size {
        pieces.push(photons.split_off((photons.len() - 1) / size * size));
        photons.shrink_to_fit();
    }
    pieces.push(photons);
    pieces.reverse();
    pieces
}

/// The photons' events, by block.
pub(crate) fn events_of(photons: &[Photon]) -> impl IndexedParallelIterator<Item = [u8; LANES]> {
    photons.par_chunks(LANES).map(|photons| {
        let mut events = [u8::MAX; LANES];
        for (event, photon) in events.iter_mut().zip(photons) {
            *event = photon.events;
        }
        events
    })
}

/// Puts photons in the order of a median split along the longest edge, down to blocks. Splits fall
/// between whole blocks, where the hierarchy splits too.
fn split(photons: &mut [Photon]) {
    let blocks = photons.len().div_ceil(LANES);
    if blocks <= 1 {
        return;
    }
    let (mut min, mut max) = (Vec3::INFINITY, Vec3::NEG_INFINITY);
    for photon in photons.iter() {
        min = min.min(photon.position);
        max = max.max(photon.position);
    }
    let axis = (max - min).max_position();
    let middle = blocks / 2 * LANES;
    photons.select_nth_unstable_by(middle, |a, b| a.position[axis].total_cmp(&b.position[axis]));
    let (low, high) = photons.split_at_mut(middle);
    if low.len() + high.len() >= PARALLEL_PHOTONS {
        rayon::join(|| split(low), || split(high));
    } else {
        split(low);
        split(high);
    }
}
