//! What is odd about a mesh: edges that are open, or that faces wound against each other share.

use std::collections::HashMap;

use super::mesh::Mesh;
use crate::math::{Bounds, DVec3, DisjointSets};

/// A rim narrower than this share of its mesh is that of a hole, not the end of a sheet.
const NARROW: f64 = 0.5;

/// Edges of a mesh by how its faces share them, faces without an area left out.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Flaws {
    /// All edges.
    pub edges: usize,
    /// Those of one face alone: the rim of a hole, or of an open sheet.
    pub open: usize,
    /// Those of them whose rim is narrow beside the mesh.
    pub holes: usize,
    /// Those of two faces that are wound against each other: one of them is flipped.
    pub flipped: usize,
    /// Those of more than two faces.
    pub crowded: usize,
    /// The middle of the first edge that is flipped, crowded, or of a hole, in object space.
    pub place: Option<DVec3>,
}

/// The place of a vertex: vertices at one place are taken as one.
type Key = [u64; 3];

impl Mesh {
    /// Looks at all edges.
    pub fn flaws(&self) -> Flaws {
        let key = |p: DVec3| (p + DVec3::ZERO).to_array().map(f64::to_bits);
        // By edge, how many faces run along it in either direction, and the first of them.
        let mut edges: HashMap<(Key, Key), ([u32; 2], DVec3)> = HashMap::new();
        let mut bounds = Bounds::EMPTY;
        for triangle in 0..self.triangle_count() as u32 {
            let corners = self.corners(triangle);
            bounds = bounds.union(Bounds::of_points(corners));
            for i in 0..3 {
                let (p, q) = (corners[i], corners[(i + 1) % 3]);
                let (a, b) = (key(p), key(q));
                let edge = if a < b { (a, b) } else { (b, a) };
                let (counts, _) = edges.entry(edge).or_insert(([0; 2], 0.5 * (p + q)));
                counts[usize::from(a < b)] += 1;
            }
        }
        let mut flaws = Flaws { edges: edges.len(), ..Flaws::default() };
        let mut first: Option<DVec3> = None;
        // The same one in every run, whatever the order of the table.
        let mut note = |middle: DVec3| {
            if first.is_none_or(|first| middle.to_array() < first.to_array()) {
                first = Some(middle);
            }
        };
        let mut open = Vec::new();
        for (edge, (counts, middle)) in &edges {
            match counts {
                [1, 1] => continue,
                [1, 0] | [0, 1] => open.push((*edge, *middle)),
                [2, 0] | [0, 2] => flaws.flipped += 1,
                _ => flaws.crowded += 1,
            }
            if !matches!(counts, [1, 0] | [0, 1]) {
                note(*middle);
            }
        }
        flaws.open = open.len();
        for rim in rims(&open) {
            if Bounds::of_points(rim.iter().copied()).diagonal() < NARROW * bounds.diagonal() {
                flaws.holes += rim.len();
                rim.into_iter().for_each(&mut note);
            }
        }
        flaws.place = first;
        flaws
    }
}

/// The middles of open edges, rim by rim: edges that hang together.
fn rims(open: &[((Key, Key), DVec3)]) -> Vec<Vec<DVec3>> {
    let mut sets = DisjointSets::new(open.len());
    let mut first: HashMap<Key, usize> = HashMap::new();
    for (index, ((a, b), _)) in open.iter().enumerate() {
        sets.join(index, *first.entry(*a).or_insert(index));
        sets.join(index, *first.entry(*b).or_insert(index));
    }
    sets.groups().into_iter().map(|rim| rim.into_iter().map(|index| open[index].1).collect()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::Vec3;

    #[test]
    fn holes_and_flipped_faces_are_counted() {
        let corners = [Vec3::ZERO, Vec3::X, Vec3::Y, Vec3::Z].to_vec();
        let of = |triangles: &[[u32; 3]]| Mesh::new(corners.clone(), triangles.to_vec(), false).unwrap().flaws();
        let whole = of(&[[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]);
        assert_eq!(whole, Flaws { edges: 6, ..Flaws::default() });
        let open = of(&[[0, 2, 1], [0, 1, 3], [0, 3, 2]]);
        assert_eq!((open.open, open.holes, open.flipped, open.crowded), (3, 0, 0, 0));
        let flipped = of(&[[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 3, 2]]);
        assert_eq!((flipped.open, flipped.flipped), (0, 3));
        let crowded = of(&[[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3], [1, 2, 0]]);
        assert!(crowded.crowded > 0);
    }

    /// A sheet ends somewhere, however many edges it has there; what is missing in its midst is a hole.
    #[test]
    fn the_end_of_a_sheet_is_no_hole() {
        const SIDE: u32 = 12;
        let corners =
            (0..=SIDE).flat_map(|y| (0..=SIDE).map(move |x| Vec3::new(x as f32, y as f32, (x * y % 5) as f32)));
        let corners: Vec<Vec3> = corners.collect();
        let cell = |x: u32, y: u32| {
            let a = y * (SIDE + 1) + x;
            [[a, a + 1, a + SIDE + 2], [a, a + SIDE + 2, a + SIDE + 1]]
        };
        let of = |missing: Option<(u32, u32)>| {
            let cells = (0..SIDE).flat_map(|y| (0..SIDE).map(move |x| (x, y))).filter(|at| Some(*at) != missing);
            let triangles = cells.flat_map(|(x, y)| cell(x, y)).collect();
            Mesh::new(corners.clone(), triangles, false).unwrap().flaws()
        };
        let (sheet, torn) = (of(None), of(Some((5, 5))));
        assert_eq!((sheet.open, sheet.holes, sheet.place), (48, 0, None));
        assert_eq!((torn.open, torn.holes, torn.flipped), (52, 4, 0));
        assert_eq!(torn.place.map(|p| (p.x, p.y)), Some((5.0, 5.5)));
    }
}
