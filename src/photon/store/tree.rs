//! The hierarchy over blocks of photons: a median-split tree of which up to four levels at a time are
//! collapsed into one node of at most sixteen children, each bounded by a sphere and by a box. Nodes
//! of fewer children stand at the top, where there is only one of them.

use super::{Blocks, photons_in};
use crate::photon::simd::{LANES, Row};
use glam::Vec3;
use rayon::prelude::*;
use std::ops::Range;

/// Marks a child that is a block.
pub(crate) const LEAF: u32 = 1 << 31;

/// Subtrees of fewer blocks are built by one thread.
const PARALLEL_BLOCKS: usize = 512;

/// Levels of the median split that make one node, at most.
const LEVELS: u32 = 4;

/// Sixteen subtrees: their bounds, and where they are.
#[derive(Clone, Debug, PartialEq)]
#[repr(C, align(64))]
pub(crate) struct Node {
    /// Centres of spheres around the discs, in any orientation.
    pub center: [Row; 3],
    /// The spheres' radii; −∞ for a child that does not exist.
    pub radius: Row,
    /// Lowest corners of boxes around the discs, in any orientation.
    pub min: [Row; 3],
    /// Highest corners; both are ∞ for a child that does not exist.
    pub max: [Row; 3],
    /// Indices of nodes, or of blocks with [`LEAF`] set.
    pub children: [u32; LANES],
}

impl Node {
    const EMPTY: Node = Node {
        center: [Row([0.0; LANES]); 3],
        radius: Row([f32::NEG_INFINITY; LANES]),
        min: [Row([f32::INFINITY; LANES]); 3],
        max: [Row([f32::INFINITY; LANES]); 3],
        children: [0; LANES],
    };
}

/// What encloses a subtree.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Extent {
    /// Lowest corner of the box around the discs.
    pub min: Vec3,
    /// Highest corner.
    pub max: Vec3,
    /// Centre of the sphere around the discs.
    center: Vec3,
    /// Its radius.
    radius: f32,
    /// The sum over blocks of the longest edge of the box around their photons.
    pub block_sizes: f64,
}

/// Radii of discs.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Widths<'a> {
    /// The same for all; 0 to bound positions alone.
    Same(f32),
    /// One each, sixteen a block.
    Own(&'a [f32]),
}

impl Widths<'_> {
    /// That of photon `index`.
    #[inline]
    pub(crate) fn of(&self, index: usize) -> f32 {
        match self {
            Widths::Same(radius) => *radius,
            Widths::Own(radii) => radii[index],
        }
    }
}

/// Builds the tree over `blocks`. The root is the first node. No node if there is no block.
pub(crate) fn build(blocks: &Blocks, photons: usize, radii: Widths<'_>) -> (Vec<Node>, Extent) {
    let input = Input { blocks, photons, radii };
    if blocks.len() == 0 {
        return (Vec::new(), Extent::around(Vec3::INFINITY, Vec3::NEG_INFINITY));
    }
    let mut nodes = vec![Node::EMPTY; node_count(blocks.len())];
    let extent = input.fill(0..blocks.len(), 0, &mut nodes);
    (nodes, extent)
}

struct Input<'a> {
    blocks: &'a Blocks,
    photons: usize,
    radii: Widths<'a>,
}

impl Extent {
    fn around(min: Vec3, max: Vec3) -> Self {
        Extent { min, max, center: 0.5 * (min + max), radius: 0.0, block_sizes: 0.0 }
    }
}

/// What `make` says of each part of a range of blocks, in order: given the part, and, if it is a subtree and no single
/// block, its root's index and its nodes, which are taken from those behind the parent at `first`. Fills the parent's
/// `indices`.
pub(crate) fn children<N: Send, R: Send>(
    range: &Range<usize>,
    first: usize,
    mut nodes: &mut [N],
    indices: &mut [u32; LANES],
    make: impl Fn(Range<usize>, usize, &mut [N]) -> R + Sync,
) -> Vec<R> {
    let mut jobs = Vec::with_capacity(LANES);
    let mut next = first + 1;
    for (index, ends) in indices.iter_mut().zip(parts(range).windows(2)) {
        let part = ends[0]..ends[1];
        if part.len() == 1 {
            *index = LEAF | part.start as u32;
            jobs.push((part, 0, Default::default()));
        } else {
            let count = node_count(part.len());
            let (own, others) = nodes.split_at_mut(count);
            nodes = others;
            *index = next as u32;
            jobs.push((part, next, own));
            next += count;
        }
    }
    let make = |(part, first, own): (Range<usize>, usize, &mut [N])| make(part, first, own);
    if range.len() >= PARALLEL_BLOCKS {
        jobs.into_par_iter().map(make).collect()
    } else {
        jobs.into_iter().map(make).collect()
    }
}

impl Input<'_> {
    /// Fills `nodes` with the tree over the blocks of `range`; `first` is the index of its root.
    fn fill(&self, range: Range<usize>, first: usize, nodes: &mut [Node]) -> Extent {
        let Some((root, rest)) = nodes.split_first_mut() else {
            return Extent::around(Vec3::INFINITY, Vec3::NEG_INFINITY);
        };
        let children = children(&range, first, rest, &mut root.children, |part, first, own| {
            if own.is_empty() { self.block(part.start) } else { self.fill(part, first, own) }
        });

        let (mut min, mut max) = (Vec3::INFINITY, Vec3::NEG_INFINITY);
        for (lane, child) in children.iter().enumerate() {
            // A ray's distance to a centre is computed with an error of some roundings of the
            // coordinates; bounds are grown by it.
            let slack = 8.0 * f32::EPSILON * (child.min.abs().max(child.max.abs())).max_element();
            for axis in 0..3 {
                root.center[axis].0[lane] = child.center[axis];
                root.min[axis].0[lane] = child.min[axis] - slack;
                root.max[axis].0[lane] = child.max[axis] + slack;
            }
            root.radius.0[lane] = child.radius + slack;
            min = min.min(child.min);
            max = max.max(child.max);
        }
        let mut extent = Extent::around(min, max);
        for child in &children {
            extent.radius = extent.radius.max(extent.center.distance(child.center) + child.radius);
            extent.block_sizes += child.block_sizes;
        }
        extent.radius = extent.radius.min(max.distance(extent.center));
        extent
    }

    fn block(&self, index: usize) -> Extent {
        let count = photons_in(index, self.photons);
        let position = self.blocks.get(index).position;
        let at = |lane: usize| Vec3::new(position[0].0[lane], position[1].0[lane], position[2].0[lane]);
        let disc = |lane: usize| self.radii.of(index * LANES + lane);
        let (mut low, mut high) = (Vec3::INFINITY, Vec3::NEG_INFINITY);
        let (mut min, mut max) = (low, high);
        for lane in 0..count {
            let (x, r) = (at(lane), disc(lane));
            low = low.min(x);
            high = high.max(x);
            min = min.min(x - r);
            max = max.max(x + r);
        }
        let center = 0.5 * (low + high);
        let radius = (0..count).fold(0.0f32, |radius, lane| radius.max(center.distance(at(lane)) + disc(lane)));
        Extent { min, max, center, radius, block_sizes: f64::from((high - low).max_element()) }
    }
}

/// Where a range of blocks is split: up to sixteen parts, none empty. The order of photons splits at
/// the same places.
pub(crate) fn parts(range: &Range<usize>) -> smallvec::SmallVec<[usize; LANES + 1]> {
    if range.len() <= LANES {
        return (range.start..=range.end).collect();
    }
    // Levels down to parts of at most sixteen blocks; what does not divide by four is taken first, so
    // that the many nodes below are full.
    let above = range.len().div_ceil(LANES).next_power_of_two().ilog2();
    let levels = (above - 1) % LEVELS + 1;
    let mut ends: smallvec::SmallVec<[usize; LANES + 1]> = smallvec::smallvec![range.start, range.end];
    for _ in 0..levels {
        let mut finer = smallvec::smallvec![range.start];
        for pair in ends.windows(2) {
            let half = (pair[1] - pair[0]) / 2;
            if half > 0 {
                finer.push(pair[0] + half);
            }
            finer.push(pair[1]);
        }
        ends = finer;
    }
    ends
}

/// How many nodes the tree over `blocks` blocks has.
pub(crate) fn node_count(blocks: usize) -> usize {
    if blocks <= LANES {
        return 1;
    }
    let inner = |ends: &[usize]| if ends[1] - ends[0] > 1 { node_count(ends[1] - ends[0]) } else { 0 };
    1 + parts(&(0..blocks)).windows(2).map(inner).sum::<usize>()
}
