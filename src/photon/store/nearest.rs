//! Squared distances of photons to their m-th nearest other, from which their discs get radii; and lists of squared distances,
//! from which the n-th is selected.
//!
//! Exact, and batched by block: a first bound for each photon of a block comes from the blocks next
//! to it in median order, one walk through the tree finds the nodes near the block, and each photon
//! then looks into the blocks that its own bound reaches.

use super::{Block, Blocks, Descent, Meets, Node, blocks_of, photons_in};
use crate::photon::radius::InMedium;
use crate::photon::simd::{Isa, LANES, Lanes, Row, Task};
use rayon::prelude::*;

/// Blocks that one task handles.
const CHUNK: usize = 64;

/// Squared distances kept before the bound is drawn tighter.
pub(crate) const KEPT: usize = 2048;

/// The squared distance of every photon to its `m`-th nearest other, sixteen a block, coincident
/// photons counting with distance 0. `nodes` bound the positions. At least `m + 1` photons.
pub(crate) fn nearest(isa: Isa, blocks: &Blocks, photons: usize, nodes: &[Node], m: usize) -> Vec<f32> {
    let mut squared = vec![0.0f32; blocks.len() * LANES];
    squared.par_chunks_mut(CHUNK * LANES).enumerate().for_each_init(Scratch::default, |scratch, (chunk, out)| {
        isa.run(Search { blocks, photons, nodes, m, first: chunk * CHUNK, out, scratch });
    });
    squared
}

/// Buffers of one thread.
#[derive(Default)]
struct Scratch {
    /// Squared distances, with room for one vector more than is counted.
    distances: Vec<Row>,
    /// Nodes near a block, and which of their children are blocks near it.
    near: Vec<(u32, u16)>,
}

struct Search<'a> {
    blocks: &'a Blocks,
    photons: usize,
    nodes: &'a [Node],
    m: usize,
    first: usize,
    out: &'a mut [f32],
    scratch: &'a mut Scratch,
}

/// A growing list of numbers in rows.
pub(crate) struct List<'a> {
    rows: &'a mut [Row],
    count: usize,
}

impl<'a> List<'a> {
    /// An empty one, with room for one vector less than there are rows.
    pub(crate) fn new(rows: &'a mut [Row]) -> Self {
        List { rows, count: 0 }
    }

    /// How many numbers it holds.
    #[inline(always)]
    pub(crate) fn len(&self) -> usize {
        self.count
    }

    /// Forgets them.
    #[inline(always)]
    pub(crate) fn clear(&mut self) {
        self.count = 0;
    }

    /// Appends the lanes of `bits`.
    #[inline(always)]
    pub(crate) fn push<L: Lanes>(&mut self, values: L, bits: u16) {
        debug_assert!(self.count + LANES <= self.rows.len() * LANES, "no room");
        let flat = self.rows.as_flattened_mut_f32();
        if let Some(out) = flat[self.count..].first_chunk_mut() {
            values.compress(bits, out);
            self.count += bits.count_ones() as usize;
        }
    }

    /// The smallest number that `wanted` of the list's do not exceed. All lie in [0, `most`], and
    /// there are at least `wanted`.
    #[inline(always)]
    pub(crate) fn select<L: Lanes>(&mut self, wanted: usize, most: f32) -> f32 {
        let used = self.count.div_ceil(LANES);
        for value in &mut self.rows.as_flattened_mut_f32()[self.count..used * LANES] {
            *value = f32::INFINITY;
        }
        let rows = &self.rows[..used];
        if up_to::<L>(rows, 0.0).0 >= wanted {
            return 0.0;
        }
        // Bisection: by value while that converges, then by bits, which ends after 31 steps
        // however the numbers are spread. Always: fewer than `wanted` up to `low`, enough up to `high`.
        let (mut low, mut high) = (0.0f32, most);
        // As if the ball were filled evenly.
        let mut middle = high * InMedium::growth(wanted as f64 / self.count as f64).powi(2) as f32;
        for step in 0.. {
            if middle <= low || middle >= high {
                middle = f32::from_bits(low.to_bits().midpoint(high.to_bits()));
                if middle <= low {
                    break;
                }
            }
            let (count, largest) = up_to::<L>(rows, middle);
            if count == wanted {
                return largest.largest();
            }
            if count > wanted {
                high = middle;
            } else {
                low = middle;
            }
            middle =
                if step < 12 { 0.5 * (low + high) } else { f32::from_bits(low.to_bits().midpoint(high.to_bits())) };
        }
        high
    }

    /// Keeps `wanted` numbers, none above `bound`, which is the `wanted`-th smallest.
    pub(crate) fn shrink(&mut self, wanted: usize, bound: f32) {
        let flat = self.rows.as_flattened_mut_f32();
        let mut kept = 0;
        for i in 0..self.count {
            if flat[i] < bound {
                flat[kept] = flat[i];
                kept += 1;
            }
        }
        flat[kept..wanted].fill(bound);
        self.count = wanted;
    }
}

/// How many numbers do not exceed `limit`, and their maximum by lane.
#[inline(always)]
fn up_to<L: Lanes>(rows: &[Row], limit: f32) -> (usize, L) {
    let limit = L::splat(limit);
    let mut largest = L::splat(0.0);
    let mut count = 0;
    for row in rows {
        let x = L::load(row);
        let inside = x.less_equal(limit);
        count += L::bits(inside).count_ones() as usize;
        largest = largest.max(x.keep(inside));
    }
    (count, largest)
}

/// A view of rows as one slice of numbers.
trait Flat {
    fn as_flattened_mut_f32(&mut self) -> &mut [f32];
}

impl Flat for [Row] {
    #[inline(always)]
    fn as_flattened_mut_f32(&mut self) -> &mut [f32] {
        // SAFETY: a row is exactly sixteen numbers, without padding.
        unsafe { std::slice::from_raw_parts_mut(self.as_mut_ptr().cast(), self.len() * LANES) }
    }
}

impl Task for Search<'_> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self) {
        let wanted = self.m + 1;
        // The blocks next to this one hold enough photons, whichever of them is the last, partly
        // filled one.
        let window = (wanted.div_ceil(LANES) + 1).max(5);
        let rows = (KEPT / LANES).max(2 * window) + 1;
        self.scratch.distances.resize(rows, Row([0.0; LANES]));
        let mut list = List { rows: &mut self.scratch.distances, count: 0 };
        let near = &mut self.scratch.near;

        for (index, out) in self.out.chunks_exact_mut(LANES).enumerate() {
            let block = self.first + index;
            let count = photons_in(block, self.photons);
            let own = self.blocks.get(block).position;

            // Bounds from the neighbours in order.
            let start = block.saturating_sub(window / 2).min(self.blocks.len().saturating_sub(window));
            let around = start..(start + window).min(self.blocks.len());
            let mut bounds = [0.0f32; LANES];
            for (lane, bound) in bounds[..count].iter_mut().enumerate() {
                let x = [L::splat(own[0].0[lane]), L::splat(own[1].0[lane]), L::splat(own[2].0[lane])];
                let mut largest = L::splat(0.0);
                list.count = 0;
                for other in around.clone() {
                    let d2 = squared(self.blocks.get(other), &x);
                    let real = d2.less(L::splat(f32::INFINITY));
                    largest = largest.max(d2.keep(real));
                    list.push(d2, L::bits(real));
                }
                *bound = list.select::<L>(wanted, largest.largest());
            }

            // Nodes with blocks near this one.
            let widest = bounds.iter().fold(0.0f32, |a, &b| a.max(b));
            near.clear();
            if widest > 0.0 {
                let (mut low, mut high) = ([f32::INFINITY; 3], [f32::NEG_INFINITY; 3]);
                for axis in 0..3 {
                    for &x in &own[axis].0[..count] {
                        low[axis] = low[axis].min(x);
                        high[axis] = high[axis].max(x);
                    }
                }
                let low = [L::splat(low[0]), L::splat(low[1]), L::splat(low[2])];
                let high = [L::splat(high[0]), L::splat(high[1]), L::splat(high[2])];
                let near_block = Near { low, high, squared: widest };
                let mut descent = Descent::new(self.nodes);
                while let Some((index, blocks)) = descent.next::<L>(&near_block) {
                    near.push((index as u32, blocks));
                }
            }

            for lane in 0..count {
                let mut bound = bounds[lane];
                // No one is nearer than 0, and whole maps may be at one place.
                if bound == 0.0 {
                    out[lane] = 0.0;
                    continue;
                }
                let x = [L::splat(own[0].0[lane]), L::splat(own[1].0[lane]), L::splat(own[2].0[lane])];
                list.count = 0;
                for &(index, leaves) in near.iter() {
                    let node = &self.nodes[index as usize];
                    let hit = Near { low: x, high: x, squared: bound }.children(node) & leaves;
                    for block in blocks_of(&node.children, hit) {
                        let d2 = squared(self.blocks.get(block), &x);
                        list.push(d2, L::bits(d2.less_equal(L::splat(bound))));
                        if list.count + LANES > (rows - 1) * LANES {
                            bound = list.select::<L>(wanted, bound);
                            list.shrink(wanted, bound);
                        }
                    }
                }
                out[lane] = list.select::<L>(wanted, bound);
            }
        }
    }
}

/// Squared distances from a point to a block's photons; infinite in lanes without a photon.
#[inline(always)]
fn squared<L: Lanes>(block: Block<'_>, x: &[L; 3]) -> L {
    let dx = L::load(&block.position[0]).sub(x[0]);
    let dy = L::load(&block.position[1]).sub(x[1]);
    let dz = L::load(&block.position[2]).sub(x[2]);
    dx.mul_add(dx, dy.mul_add(dy, dz.mul(dz)))
}

/// What comes within a squared distance of a box.
struct Near<L> {
    low: [L; 3],
    high: [L; 3],
    squared: f32,
}

impl<L: Lanes> Meets<Node> for Near<L> {
    #[inline(always)]
    fn children(&self, node: &Node) -> u16 {
        let mut sum = L::splat(0.0);
        for axis in 0..3 {
            let below = L::load(&node.min[axis]).sub(self.high[axis]);
            let above = self.low[axis].sub(L::load(&node.max[axis]));
            let distance = below.max(above).max(L::splat(0.0));
            sum = distance.mul_add(distance, sum);
        }
        L::bits(sum.less_equal(L::splat(self.squared)))
    }
}
