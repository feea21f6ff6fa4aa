//! The blocks a query must look at, listed some at a time.

use crate::photon::discs::PhotonMap;
use crate::photon::simd::{LANES, Lanes};
use crate::photon::store::{Descent, LEAF, Meets, Node};

/// Blocks found before they are evaluated: few enough that the list stays in the nearest cache.
const LISTED: usize = 256;

/// Added blocks of one node may overshoot the list, and so may a whole vector written for them.
const LIST: usize = LISTED + 2 * LANES;

/// A walk through a map's hierarchy that lists the blocks it finds.
pub(in crate::gather) struct Listing<'m> {
    map: &'m PhotonMap,
    descent: Descent<'m, Node>,
    list: [u32; LIST],
}

impl<'m> Listing<'m> {
    #[inline(always)]
    pub(in crate::gather) fn new(map: &'m PhotonMap) -> Self {
        Listing { map, descent: Descent::new(&map.nodes), list: [0; LIST] }
    }

    /// Whether there is more to be listed.
    #[inline(always)]
    pub(in crate::gather) fn goes_on(&self) -> bool {
        self.descent.goes_on()
    }

    /// Lists blocks anew until the list is full or the walk ends. Returns how many.
    #[inline(always)]
    pub(in crate::gather) fn fill<L: Lanes>(&mut self, target: &impl Meets<Node>) -> usize {
        let mut listed = 0;
        while listed < LISTED
            && let Some((node, near)) = self.descent.next::<L>(target)
        {
            if let Some(out) = self.list[listed..].first_chunk_mut() {
                L::compress_indices(&self.map.nodes[node].children, near, out);
                listed += near.count_ones() as usize;
            }
        }
        listed
    }

    /// A block of the list.
    #[inline(always)]
    pub(in crate::gather) fn block(&self, place: usize) -> usize {
        (self.list[place] & !LEAF) as usize
    }

    /// Nodes visited.
    #[inline(always)]
    pub(in crate::gather) fn nodes(&self) -> u64 {
        self.descent.visited()
    }
}
