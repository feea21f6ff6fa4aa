//! The walk through a map's hierarchy that finds the blocks a query must look at.

use crate::photon::discs::PhotonMap;
use crate::photon::simd::{LANES, Lanes};
use crate::photon::store::{LEAF, Node, STACK};

/// Blocks found before they are evaluated: few enough that the list stays in the nearest cache.
const LISTED: usize = 256;

/// Added blocks of one node may overshoot the list, and so may a whole vector written for them.
const LIST: usize = LISTED + 2 * LANES;

/// What may meet a node's children.
pub(in crate::gather) trait Meets<L> {
    /// Those it meets.
    fn children(&self, node: &Node) -> u16;
}

/// A walk through the hierarchy, depth first, that lists the blocks it finds, some at a time.
pub(in crate::gather) struct Descent {
    stack: [u32; STACK + LANES],
    waiting: usize,
    list: [u32; LIST],
    /// Nodes visited.
    pub(in crate::gather) nodes: u64,
}

impl Descent {
    #[inline(always)]
    pub(in crate::gather) fn new() -> Self {
        Descent { stack: [0; STACK + LANES], waiting: 1, list: [0; LIST], nodes: 0 }
    }

    /// Whether there is more to be listed.
    #[inline(always)]
    pub(in crate::gather) fn goes_on(&self) -> bool {
        self.waiting > 0
    }

    /// Lists blocks anew until the list is full or the walk ends. Returns how many.
    #[inline(always)]
    pub(in crate::gather) fn list<L: Lanes>(&mut self, map: &PhotonMap, target: &impl Meets<L>) -> usize {
        let mut listed = 0;
        while self.waiting > 0 && listed < LISTED {
            self.waiting -= 1;
            let node = &map.nodes[self.stack[self.waiting] as usize];
            self.nodes += 1;
            let hit = target.children(node);
            let leaves = node.leaves();
            let (near, inner) = (hit & leaves, hit & !leaves);
            if near != 0
                && let Some(out) = self.list[listed..].first_chunk_mut()
            {
                L::compress_indices(&node.children, near, out);
                listed += near.count_ones() as usize;
            }
            if inner != 0
                && let Some(out) = self.stack[self.waiting..].first_chunk_mut()
            {
                L::compress_indices(&node.children, inner, out);
                self.waiting += inner.count_ones() as usize;
            }
        }
        listed
    }

    /// A block of the list.
    #[inline(always)]
    pub(in crate::gather) fn block(&self, place: usize) -> usize {
        (self.list[place] & !LEAF) as usize
    }
}
