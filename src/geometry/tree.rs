//! A hierarchy of boxes for finding what a ray or a box meets.

use crate::math::{Bounds, DVec3, Ray, Vec3};
use glam::{BVec4A, UVec2, Vec3A, Vec4};
use obvhs::aabb::Aabb;
use obvhs::bvh2::Bvh2;
use obvhs::bvh2::node::Bvh2Node;
use obvhs::cwbvh::bvh2_to_cwbvh::bvh2_to_cwbvh;
use obvhs::cwbvh::node::CwBvhNode;
use obvhs::cwbvh::{CwBvh, firstbithigh};
use smallvec::SmallVec;

/// Compressed wide nodes (Ylitie, Karras and Laine 2017, made by `obvhs`) in `f32`. All boxes live in
/// the cube [−1, 1]³, whatever the scene's place and size, and rays start where they enter it, so that
/// rounding to `f32` shifts a plane by less than `PADDING`, by which the boxes are grown: a traversal
/// visits too much rather than too little.
#[derive(Debug)]
pub(crate) struct Tree {
    nodes: CwBvh,
    /// All boxes, if there are few.
    few: Option<Few>,
    /// Around the padded boxes.
    bounds: Bounds,
    diagonal: f64,
    center: DVec3,
    /// From lengths to lengths in the cube.
    scale: f64,
}

/// Rounding of origin, direction, planes and their products: below 4e-6 in the cube.
const PADDING: f64 = 1e-5;
/// The nodes' test ignores what lies nearer than 1e-4, so rays start before the cube.
const LEAD: f64 = 1e-2;

/// Up to so many boxes are tested one by one: all of them are done before two nodes are unpacked.
const FEW: usize = 32;

/// Boxes in fours, in the order of a tree.
#[derive(Debug)]
struct Few {
    /// Lower and upper faces along x, y and z.
    fours: Vec<[Vec4; 6]>,
}

impl Few {
    fn new<'a>(boxes: impl Iterator<Item = &'a Aabb>) -> Self {
        let mut fours: Vec<[Vec4; 6]> = Vec::new();
        for (i, of) in boxes.enumerate() {
            if i % 4 == 0 {
                // Places to spare hold boxes that nothing meets.
                let (low, high) = (Vec4::INFINITY, Vec4::NEG_INFINITY);
                fours.push([low, high, low, high, low, high]);
            }
            for axis in 0..3 {
                fours[i / 4][2 * axis][i % 4] = of.min[axis];
                fours[i / 4][2 * axis + 1][i % 4] = of.max[axis];
            }
        }
        Few { fours }
    }

    /// Calls `visit` for every box met from `origin` on, up to `t_max`; it returns the new `t_max`. What rounding shifts
    /// along the ray, the boxes' padding does more.
    #[inline(always)]
    fn along(&self, origin: DVec3, direction: DVec3, mut t_max: f32, mut visit: impl FnMut(u32) -> f32) {
        // Parallel to faces is nearly so: nothing is infinite, nothing undefined.
        let oblique = |d: f64| if d.abs() < 1e-30 { 1e-30 } else { d };
        let [x, y, z] = direction.to_array().map(oblique);
        let steep = |d: f64| Vec4::splat((1.0 / d) as f32);
        let (ix, iy, iz) = (steep(x), steep(y), steep(z));
        let from = origin.as_vec3();
        let (ox, oy, oz) = (Vec4::splat(from.x), Vec4::splat(from.y), Vec4::splat(from.z));
        let turned = |d: f64| usize::from(d < 0.0);
        let (x, y, z) = (turned(x), turned(y), turned(z));
        let mut entries = [0.0; FEW];
        let mut met = 0u32;
        for (i, (faces, entries)) in self.fours.iter().zip(entries.as_chunks_mut().0).enumerate() {
            let enter = ((faces[x] - ox) * ix).max((faces[2 + y] - oy) * iy).max((faces[4 + z] - oz) * iz);
            let leave = ((faces[1 - x] - ox) * ix).min((faces[3 - y] - oy) * iy).min((faces[5 - z] - oz) * iz);
            let enter = enter.max(Vec4::ZERO);
            met |= enter.cmple(leave.min(Vec4::splat(t_max))).bitmask() << (4 * i);
            *entries = enter.to_array();
        }
        // From near to far: what is behind a hit need not be looked into.
        while met != 0 {
            let mut nearest = met.trailing_zeros();
            let mut others = met & (met - 1);
            while others != 0 {
                let other = others.trailing_zeros();
                others &= others - 1;
                if entries[other as usize % FEW] < entries[nearest as usize % FEW] {
                    nearest = other;
                }
            }
            if entries[nearest as usize % FEW] > t_max {
                return;
            }
            met &= !(1 << nearest);
            t_max = visit(nearest);
        }
    }

    /// Calls `visit` for every box that overlaps `query`.
    fn overlapping(&self, query: &Aabb, mut visit: impl FnMut(u32)) {
        for (i, faces) in self.fours.iter().enumerate() {
            let mut both = BVec4A::from_array([true; 4]);
            for axis in 0..3 {
                both &= faces[2 * axis].cmple(Vec4::splat(query.max[axis]));
                both &= faces[2 * axis + 1].cmpge(Vec4::splat(query.min[axis]));
            }
            let mut met = both.bitmask();
            while met != 0 {
                visit(4 * i as u32 + met.trailing_zeros());
                met &= met - 1;
            }
        }
    }
}

/// Groups of nodes still to be visited: deep trees spill to the heap.
type Pending = SmallVec<[UVec2; 24]>;

/// The bits of a group that name inner nodes.
const INNER: u32 = 0xff00_0000;

impl Tree {
    /// A tree over `boxes`, which are finite and not empty.
    pub fn new(boxes: &[Bounds]) -> Self {
        let all = boxes.iter().fold(Bounds::EMPTY, |all, b| all.union(*b));
        let (center, half) =
            if all.is_empty() { (DVec3::ZERO, 1.0) } else { (all.center(), 0.5 * all.size().max_element()) };
        // A box without extent needs some scale; that of its coordinates keeps padding above rounding.
        let half = half.max(1e-9 * center.abs().max_element()).max(f64::MIN_POSITIVE.sqrt());
        let scale = half.recip();
        let boxes: Vec<Aabb> = boxes
            .iter()
            .map(|b| Aabb {
                min: ((b.min - center) * scale - PADDING).as_vec3a(),
                max: ((b.max - center) * scale + PADDING).as_vec3a(),
            })
            .collect();
        let nodes = bvh2_to_cwbvh(&halved(&boxes), 3, true, false);
        let few = (boxes.len() <= FEW).then(|| Few::new(nodes.primitive_indices.iter().map(|&i| &boxes[i as usize])));
        let bounds = all.grown(2.0 * PADDING * half);
        Tree { nodes, few, diagonal: bounds.diagonal(), bounds, center, scale }
    }

    /// The order in which boxes should lie in memory: `order()[i]` is the index of the box that a
    /// traversal calls `i`.
    pub fn order(&self) -> &[u32] {
        &self.nodes.primitive_indices
    }

    /// Calls `visit` for every box that `ray`, whose direction may have any length, meets for a
    /// parameter in `[t_min, t_max]`, roughly from near to far. `visit` gets the place in
    /// [`Tree::order`] and returns the new `t_max`; negative infinity ends the traversal.
    #[inline]
    pub fn along(&self, ray: &Ray, t_min: f64, t_max: f64, mut visit: impl FnMut(u32) -> f64) {
        self.leaves_along(ray, t_min, t_max, |leaves| {
            let mut t = t_max;
            for index in leaves {
                t = visit(index);
                if t == f64::NEG_INFINITY {
                    break;
                }
            }
            t
        });
    }

    /// As [`Tree::along`], with the boxes that one node's leaves hold at once.
    #[inline]
    pub fn leaves_along(&self, ray: &Ray, t_min: f64, t_max: f64, mut visit: impl FnMut(Leaves) -> f64) {
        if self.nodes.nodes.is_empty() {
            return;
        }
        if let Some(few) = &self.few {
            let start = if self.bounds.contains(ray.at(t_min)) {
                t_min
            } else {
                let Some((start, _)) = self.bounds.clip(ray, t_min, t_max) else { return };
                start
            };
            let origin = (ray.at(start) - self.center) * self.scale;
            if origin.is_finite() {
                let rounded = |t: f64| ((t - start) * (1.0 + 1e-6)) as f32;
                few.along(origin, ray.direction * self.scale, rounded(t_max), |index| {
                    rounded(visit(Leaves { first: index, met: 1 }))
                });
            }
            return;
        }
        let speed = ray.direction.length();
        let (start, end) = if self.bounds.contains(ray.at(t_min)) {
            (t_min, t_max.min(t_min + self.diagonal / speed))
        } else {
            let Some(range) = self.bounds.clip(ray, t_min, t_max) else { return };
            range
        };
        // ---- the ray in the cube
        let direction = ray.direction / speed;
        let origin = (ray.at(start) - self.center) * self.scale - LEAD * direction;
        if !origin.is_finite() {
            return;
        }
        let stretch = speed * self.scale;
        let to_cube = |t: f64| (((t.min(end) - start) * stretch + LEAD) * (1.0 + 1e-6)) as f32 + 1e-6;
        // Adding zero turns −0 into 0: the test takes the sign of the reciprocal from the comparison with 0.
        let mut cube_ray =
            obvhs::ray::Ray::new(origin.as_vec3a(), direction.as_vec3a() + Vec3A::ZERO, 0.0, to_cube(t_max));
        let octant = octant(cube_ray.direction);
        self.walk(
            octant,
            &mut cube_ray,
            |node, ray| met(node, ray, octant),
            |leaves, ray| {
                let t = visit(leaves);
                ray.tmax = if t == f64::NEG_INFINITY { t as f32 } else { to_cube(t) };
                ray.tmax >= 0.0
            },
        );
    }

    /// Calls `visit` for every box that overlaps `query` with its place in [`Tree::order`].
    pub fn overlapping(&self, query: &Bounds, mut visit: impl FnMut(u32)) {
        let near = query.intersection(self.bounds);
        if near.is_empty() || self.nodes.nodes.is_empty() {
            return;
        }
        let cube = Aabb {
            min: ((near.min - self.center) * self.scale - PADDING).as_vec3a(),
            max: ((near.max - self.center) * self.scale + PADDING).as_vec3a(),
        };
        if let Some(few) = &self.few {
            few.overlapping(&cube, visit);
            return;
        }
        self.walk(
            0,
            &mut (),
            |node, ()| node.intersect_aabb(&cube, 0),
            |leaves, ()| {
                leaves.for_each(&mut visit);
                true
            },
        );
    }

    /// Calls `visit` for boxes within `limit` of `p`, roughly from near to far, with their places in
    /// [`Tree::order`]. `visit` returns the new `limit`.
    pub fn near(&self, p: DVec3, limit: f64, visit: impl FnMut(u32) -> f64) {
        self.search(p, &mut Nearest { limit, visit });
    }

    /// Visits what a search around `p` wants, roughly from near to far.
    pub fn search(&self, p: DVec3, search: &mut impl Search) {
        if self.nodes.nodes.is_empty() {
            return;
        }
        let q = self.in_cube(p);
        let mut pending: SmallVec<[(f32, u32, bool); 32]> = SmallVec::new();
        pending.push((0.0, 0, true));
        while let Some((distance2, index, wanted)) = pending.pop() {
            let mut most = self.reach2(search.limit());
            let mut nearest = self.reach2(search.nearest());
            if distance2 > most || !wanted && distance2 > nearest {
                continue;
            }
            let node = &self.nodes.nodes[index as usize];
            let children = Children::of(node, q);
            let wanted = search.wants(index, &children);
            let before = pending.len();
            for (child, &distance2) in children.distance2.iter().enumerate() {
                let wanted = wanted >> child & 1 == 1;
                if distance2 > most || !wanted && distance2 > nearest || node.is_child_empty(child) {
                    continue;
                }
                if node.is_leaf(child) {
                    let (first, count) = node.child_primitives(child);
                    (first..first + count).for_each(|index| search.visit(index));
                    (most, nearest) = (self.reach2(search.limit()), self.reach2(search.nearest()));
                } else {
                    pending.push((distance2, node.child_node_index(child), wanted));
                }
            }
            // The nearest comes last: it is the next.
            pending[before..].sort_unstable_by(|a, b| b.0.total_cmp(&a.0));
        }
    }

    /// The square of a distance, as long as it may be in the cube for what rounding does.
    pub fn reach2(&self, distance: f64) -> f32 {
        ((distance * self.scale) * (1.0 + 1e-5) + 1e-6).powi(2) as f32
    }

    /// Where `p` is in the cube that all boxes lie in.
    pub fn in_cube(&self, p: DVec3) -> Vec3 {
        ((p - self.center) * self.scale).as_vec3()
    }

    /// For each node what each of its children is: what `merge` makes of the boxes of a leaf, which `leaf` tells by their
    /// places in [`Tree::order`], or of the children of a node. `nothing` stands for a child that does not exist.
    pub fn gathered<T: Copy>(&self, nothing: T, leaf: impl Fn(u32) -> T, merge: impl Fn(&[T]) -> T) -> Vec<[T; 8]> {
        let nodes = &self.nodes.nodes;
        let children = |index: usize| (0..8).filter(move |&child| !nodes[index].is_child_empty(child));
        // Parents come before their children.
        let mut order = Vec::with_capacity(nodes.len());
        order.extend((!nodes.is_empty()).then_some(0));
        let mut next = 0;
        while let Some(&index) = order.get(next) {
            let inner = children(index).filter(|&child| !nodes[index].is_leaf(child));
            order.extend(inner.map(|child| nodes[index].child_node_index(child) as usize));
            next += 1;
        }
        let mut found = vec![[nothing; 8]; nodes.len()];
        let mut parts: SmallVec<[T; 8]> = SmallVec::new();
        for &index in order.iter().rev() {
            let node = &nodes[index];
            for child in children(index) {
                parts.clear();
                if node.is_leaf(child) {
                    let (first, count) = node.child_primitives(child);
                    parts.extend((first..first + count).map(&leaf));
                } else {
                    let inner = node.child_node_index(child) as usize;
                    parts.extend(children(inner).map(|child| found[inner][child]));
                }
                found[index][child] = merge(&parts);
            }
        }
        found
    }

    /// The traversal of Ylitie et al. 2017, section 4.2. `test` gives the mask of a node's children to
    /// visit, `visit`, which gets what is met of a node's leaves, whether to go on.
    #[inline]
    fn walk<S>(
        &self,
        octant: u32,
        state: &mut S,
        test: impl Fn(&CwBvhNode, &S) -> u32,
        mut visit: impl FnMut(Leaves, &mut S) -> bool,
    ) {
        let mut pending = Pending::new();
        let mut group = UVec2::new(0, 0x8000_0000);
        loop {
            // ---- the first inner node of the group
            let bit = firstbithigh(group.y);
            let mask = group.y;
            group.y &= !(1 << bit);
            if group.y & INNER != 0 {
                pending.push(group);
            }
            let slot = (bit - 24) ^ (octant & 0xff);
            let rank = (mask & !(u32::MAX << slot)).count_ones();
            let node = &self.nodes.nodes[(group.x + rank) as usize];
            let hits = test(node, state);
            // ---- its leaves
            let leaves = Leaves { first: node.primitive_base_idx, met: hits & !INNER };
            if leaves.met != 0 && !visit(leaves, state) {
                return;
            }
            // ---- its inner children, or else the next group
            group = UVec2::new(node.child_base_idx, hits & INNER | u32::from(node.imask));
            if group.y & INNER == 0 {
                match pending.pop() {
                    Some(next) => group = next,
                    None => return,
                }
            }
        }
    }
}

/// Boxes of a node's leaves, by their places in [`Tree::order`].
#[derive(Clone, Copy)]
pub(crate) struct Leaves {
    first: u32,
    /// A bit for each of those from `first` on, at most 24.
    met: u32,
}

impl Leaves {
    /// Calls `visit` with fours of places, `4 i` to `4 i + 3`, by `i` and a bit for each that is met.
    #[inline(always)]
    pub fn in_fours(self, mut visit: impl FnMut(usize, u32)) {
        let four = self.first as usize / 4;
        let mut met = self.met << (self.first % 4);
        while met != 0 {
            let k = met.trailing_zeros() / 4;
            visit(four + k as usize, met >> (4 * k) & 0b1111);
            met &= !(0b1111 << (4 * k));
        }
    }
}

impl Iterator for Leaves {
    type Item = u32;

    #[inline(always)]
    fn next(&mut self) -> Option<u32> {
        let bit = self.met.trailing_zeros();
        self.met &= self.met.wrapping_sub(1);
        (bit < u32::BITS).then_some(self.first + bit)
    }
}

/// The children of a node that a ray meets, as [`CwBvhNode::intersect_ray`] tells them. That one branches on each child and each
/// sign of the direction, which no processor foresees.
#[inline(always)]
fn met(node: &CwBvhNode, ray: &obvhs::ray::Ray, octant: u32) -> u32 {
    /// Nothing nearer is met.
    const NEAREST: f32 = 1e-4;
    let scale = node.compute_extent() * ray.inv_direction;
    let offset = (Vec3A::from(node.p) - ray.origin) * ray.inv_direction;
    // ---- planes that the ray enters by, and those that it leaves by
    let sides = |negative: bool, low, high| if negative { [high, low] } else { [low, high] };
    let [x_in, x_out] = sides(ray.direction.x < 0.0, &node.child_min_x, &node.child_max_x);
    let [y_in, y_out] = sides(ray.direction.y < 0.0, &node.child_min_y, &node.child_max_y);
    let [z_in, z_out] = sides(ray.direction.z < 0.0, &node.child_min_z, &node.child_max_z);
    let (nearest, farthest) = (Vec4::splat(NEAREST), Vec4::splat(ray.tmax));
    let mut children = 0;
    for half in [0, 4] {
        let along = |planes: &[u8; 8], scale: f32, offset: f32| {
            Vec4::from_array(std::array::from_fn(|i| f32::from(planes[half + i]))) * scale + offset
        };
        let x = [x_in, x_out].map(|planes| along(planes, scale.x, offset.x));
        let y = [y_in, y_out].map(|planes| along(planes, scale.y, offset.y));
        let z = [z_in, z_out].map(|planes| along(planes, scale.z, offset.z));
        let enter = x[0].max(y[0]).max(z[0].max(nearest));
        let leave = x[1].min(y[1]).min(z[1].min(farthest));
        children |= enter.cmple(leave).bitmask() << half;
    }
    // ---- their bits, and where those go
    let (bits, places) = node.get_child_and_index_bits(octant);
    let mut hits = 0;
    while children != 0 {
        let byte = 8 * children.trailing_zeros();
        children &= children - 1;
        hits |= ((bits >> byte) as u32 & 0xff) << ((places >> byte) as u32 & 0xff);
    }
    hits
}

/// What is looked for around a point.
pub(crate) trait Search {
    /// Nothing farther is wanted.
    fn limit(&self) -> f64;
    /// Nothing farther is wanted for being near.
    fn nearest(&self) -> f64;
    /// The children of a node, a bit each, that may hold something wanted for another reason.
    fn wants(&self, node: u32, children: &Children) -> u8;
    /// Takes a box, by its place in [`Tree::order`].
    fn visit(&mut self, index: u32);
}

/// A search for what is nearest.
struct Nearest<V> {
    limit: f64,
    visit: V,
}

impl<V: FnMut(u32) -> f64> Search for Nearest<V> {
    fn limit(&self) -> f64 {
        self.limit
    }

    fn nearest(&self) -> f64 {
        self.limit
    }

    fn wants(&self, _: u32, _: &Children) -> u8 {
        0
    }

    fn visit(&mut self, index: u32) {
        self.limit = (self.visit)(index);
    }
}

/// Where a node's children are as seen from a point, in the tree's cube; anything for those that do not exist.
pub(crate) struct Children {
    /// Squared distances of their boxes.
    pub distance2: [f32; 8],
    /// The way from the middles of their boxes to the point.
    pub way: [[f32; 8]; 3],
    /// The squared radii of the spheres around their boxes.
    pub radius2: [f32; 8],
}

impl Children {
    #[inline]
    fn of(node: &CwBvhNode, q: Vec3) -> Self {
        let extent = node.compute_extent();
        let axes = [
            (node.p.x, extent.x, &node.child_min_x, &node.child_max_x),
            (node.p.y, extent.y, &node.child_min_y, &node.child_max_y),
            (node.p.z, extent.z, &node.child_min_z, &node.child_max_z),
        ];
        let mut children = Children { distance2: [0.0; 8], way: [[0.0; 8]; 3], radius2: [0.0; 8] };
        for (axis, ((p, extent, low, high), q)) in axes.into_iter().zip(q.to_array()).enumerate() {
            for child in 0..8 {
                let (low, high) = (p + f32::from(low[child]) * extent, p + f32::from(high[child]) * extent);
                let apart = (low - q).max(q - high).max(0.0);
                let half = 0.5 * (high - low);
                children.distance2[child] += apart * apart;
                children.way[axis][child] = q - (low + half);
                children.radius2[child] += half * half;
            }
        }
        children
    }
}

/// A binary tree by the surface area heuristic over bins (Wald 2007, "On fast construction of SAH-based
/// bounding volume hierarchies"). Below `MAX_DEPTH`, and where centres coincide, it halves by count: the
/// merging builders of `obvhs` make lists, not trees, of many equal boxes.
fn halved(boxes: &[Aabb]) -> Bvh2 {
    const MAX_DEPTH: u32 = 48;
    let mut tree = Bvh2::zeroed(boxes.len());
    if boxes.is_empty() {
        return tree;
    }
    tree.primitive_indices = (0..boxes.len() as u32).collect();
    let mut used = 1;
    let mut pending = vec![(0, 0..boxes.len(), 0)];
    while let Some((node, range, depth)) = pending.pop() {
        let items = &mut tree.primitive_indices[range.clone()];
        let around = items.iter().fold(Aabb::empty(), |all, &i| all.union(&boxes[i as usize]));
        if items.len() == 1 {
            tree.nodes[node] = Bvh2Node::new(around, 1, range.start as u32);
            continue;
        }
        let cut = if depth < MAX_DEPTH { cut_by_area(boxes, items) } else { None };
        let middle = range.start + cut.unwrap_or(items.len() / 2);
        tree.nodes[node] = Bvh2Node::new(around, 0, used as u32);
        pending.push((used, range.start..middle, depth + 1));
        pending.push((used + 1, middle..range.end, depth + 1));
        used += 2;
    }
    tree
}

/// Reorders `items` so that those before the returned place and those after make the cheapest pair of
/// boxes, among cuts between bins; `None` if all are in one bin.
fn cut_by_area(boxes: &[Aabb], items: &mut [u32]) -> Option<usize> {
    const BINS: usize = 16;
    let middle = |i: u32| boxes[i as usize].min + boxes[i as usize].max;
    let (low, high) = items
        .iter()
        .fold((Vec3A::INFINITY, Vec3A::NEG_INFINITY), |(low, high), &i| (low.min(middle(i)), high.max(middle(i))));
    let scale = (BINS as f32 * (1.0 - 1e-6)) / (high - low).max(Vec3A::splat(f32::MIN_POSITIVE));
    let bin = |i: u32| ((middle(i) - low) * scale).clamp(Vec3A::ZERO, Vec3A::splat(BINS as f32 - 1.0));
    let mut bins = [[(Aabb::empty(), 0u32); BINS]; 3];
    for &i in items.iter() {
        for (slots, at) in bins.iter_mut().zip(bin(i).to_array()) {
            let (around, count) = &mut slots[at as usize];
            *around = around.union(&boxes[i as usize]);
            *count += 1;
        }
    }
    let mut best: Option<(f32, usize, usize)> = None;
    for (axis, slots) in bins.iter().enumerate() {
        // ---- from the right, then from the left
        let mut behind = [0.0; BINS];
        let (mut around, mut count) = (Aabb::empty(), 0);
        for k in (1..BINS).rev() {
            around = around.union(&slots[k].0);
            count += slots[k].1;
            behind[k] = if count == 0 { f32::INFINITY } else { around.half_area() * count as f32 };
        }
        let (mut around, mut count) = (Aabb::empty(), 0);
        for k in 1..BINS {
            around = around.union(&slots[k - 1].0);
            count += slots[k - 1].1;
            let cost = if count == 0 { f32::INFINITY } else { around.half_area() * count as f32 + behind[k] };
            if cost < best.map_or(f32::INFINITY, |b| b.0) {
                best = Some((cost, axis, k));
            }
        }
    }
    let (_, axis, cut) = best?;
    let mut place = 0;
    for j in 0..items.len() {
        if (bin(items[j]).to_array()[axis] as usize) < cut {
            items.swap(place, j);
            place += 1;
        }
    }
    Some(place)
}

/// The order in which children are visited, for all four bytes (Ylitie et al. 2017, section 3.3).
fn octant(direction: Vec3A) -> u32 {
    let bit = |negative: bool, value: u32| if negative { 0 } else { value };
    let o = bit(direction.x < 0.0, 4) | bit(direction.y < 0.0, 2) | bit(direction.z < 0.0, 1);
    o * 0x0101_0101
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::random::Purpose;
    use crate::math::{Stream, sampling};
    use std::time::{Duration, Instant};

    /// As the crate that makes the nodes tests them.
    #[test]
    fn children_are_met_as_the_nodes_say() {
        let mut stream = Stream::new(67, Purpose::Test, 0, 0);
        let mut point = || 2.0 * stream.uniform() * sampling::sphere(stream.uniform2());
        let boxes: Vec<Bounds> = (0..3000)
            .map(|_| {
                let (a, b) = (point(), 0.1 * point());
                Bounds::of_points([a, a + b])
            })
            .collect();
        let tree = Tree::new(&boxes);
        let mut met = 0;
        for k in 0..3000 {
            let (origin, mut direction) = (point(), point());
            if k % 4 == 0 {
                direction[k % 3] = 0.0;
            }
            let (origin, direction) = (origin.as_vec3a(), direction.normalize().as_vec3a() + Vec3A::ZERO);
            let ray = obvhs::ray::Ray::new(origin, direction, 0.0, 1.0 + (k % 3) as f32);
            for node in &tree.nodes.nodes {
                let octant = octant(direction);
                let hits = super::met(node, &ray, octant);
                assert_eq!(hits, node.intersect_ray(&ray, octant), "{node:?} {ray:?}");
                met += hits.count_ones();
            }
        }
        assert!(met > 10_000, "{met}");
    }

    /// Equal boxes and boxes nested in a geometric series, the worst for builders, make shallow trees soon.
    #[test]
    fn degenerate_boxes_make_shallow_trees() {
        for shrink in [1.0, 0.9, 0.999] {
            let boxes: Vec<Bounds> = (0..50_000)
                .map(|i| Bounds { min: DVec3::ZERO, max: DVec3::splat(f64::powi(shrink, i.min(6000))) })
                .collect();
            let start = Instant::now();
            let tree = Tree::new(&boxes);
            assert!(start.elapsed() < Duration::from_secs(20));
            let mut depth = vec![0; tree.nodes.nodes.len()];
            for (i, node) in tree.nodes.nodes.iter().enumerate() {
                for child in (0..8).filter(|&c| !node.is_child_empty(c) && !node.is_leaf(c)) {
                    depth[node.child_node_index(child) as usize] = depth[i] + 1;
                }
            }
            assert!(depth.iter().all(|&d| d < 70));
            let mut found = 0;
            tree.along(&Ray::new(DVec3::new(-1.0, 0.0, 0.0), DVec3::X), 0.0, 9.0, |_| {
                found += 1;
                9.0
            });
            assert_eq!(found, boxes.len());
        }
    }
}
