//! The walk through a hierarchy over blocks, depth first: of beam queries, of point look-ups, and of radii.

use super::tree::{LEAF, Node};
use crate::photon::simd::{LANES, Lanes};

/// Enough for the nodes that wait during a walk, fifteen for each of at most eight levels, and a vector written behind them.
const STACK: usize = 9 * LANES;

/// A node of at most sixteen subtrees.
pub(crate) trait Subtrees {
    /// Indices of nodes, or of blocks with [`LEAF`] set.
    fn children(&self) -> &[u32; LANES];

    /// Which children are blocks.
    #[inline(always)]
    fn leaves(&self) -> u16 {
        let mut bits = 0;
        for (lane, child) in self.children().iter().enumerate() {
            bits |= ((child >> 31) as u16) << lane;
        }
        bits
    }
}

impl Subtrees for Node {
    #[inline(always)]
    fn children(&self) -> &[u32; LANES] {
        &self.children
    }
}

/// What is looked for in a hierarchy. No closure: kernels must be inlined into code for their instructions.
pub(crate) trait Meets<N> {
    /// The children of a node that it meets, by bits.
    fn children(&self, node: &N) -> u16;
}

/// A walk from the root, if there is one.
pub(crate) struct Descent<'n, N> {
    nodes: &'n [N],
    stack: [u32; STACK],
    waiting: usize,
    visited: u64,
}

impl<'n, N: Subtrees> Descent<'n, N> {
    #[inline(always)]
    pub(crate) fn new(nodes: &'n [N]) -> Self {
        Descent { nodes, stack: [0; STACK], waiting: usize::from(!nodes.is_empty()), visited: 0 }
    }

    /// Whether nodes wait to be visited.
    #[inline(always)]
    pub(crate) fn goes_on(&self) -> bool {
        self.waiting > 0
    }

    /// Nodes visited.
    #[inline(always)]
    pub(crate) fn visited(&self) -> u64 {
        self.visited
    }

    /// Goes on to a node some of whose children are blocks that `target` meets, and says which, by bits.
    #[inline(always)]
    pub(crate) fn next<L: Lanes>(&mut self, target: &impl Meets<N>) -> Option<(usize, u16)> {
        while self.waiting > 0 {
            self.waiting -= 1;
            let index = self.stack[self.waiting] as usize;
            let node = &self.nodes[index];
            self.visited += 1;
            let (hit, leaves) = (target.children(node), node.leaves());
            let inner = hit & !leaves;
            if inner != 0
                && let Some(out) = self.stack[self.waiting..].first_chunk_mut()
            {
                L::compress_indices(node.children(), inner, out);
                self.waiting += inner.count_ones() as usize;
            }
            if hit & leaves != 0 {
                return Some((index, hit & leaves));
            }
        }
        None
    }
}

/// The blocks among children, of which `bits` are taken.
#[inline(always)]
pub(crate) fn blocks_of(children: &[u32; LANES], mut bits: u16) -> impl Iterator<Item = usize> {
    std::iter::from_fn(move || {
        if bits == 0 {
            return None;
        }
        let block = children[bits.trailing_zeros() as usize] & !LEAF;
        bits &= bits - 1;
        Some(block as usize)
    })
}
