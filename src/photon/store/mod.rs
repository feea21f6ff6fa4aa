//! Where photons lie: in the order of a median split, in blocks of sixteen, under a tree of spheres and boxes.

mod blocks;
mod descent;
mod nearest;
mod order;
mod photon;
mod tree;

pub(crate) use blocks::{Block, Blocks, Kept, photons_in};
pub(crate) use descent::{Descent, Meets, Subtrees, blocks_of};
pub(crate) use nearest::{KEPT, List, nearest};
pub(crate) use order::{events_of, ordered, pieces, storable};
pub use photon::{PackedNormal, Photon};
pub(crate) use tree::{LEAF, Node, Widths, build, children, node_count};
