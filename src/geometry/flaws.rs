//! What is odd about a mesh: edges that are open, or that faces wound against each other share.

use std::collections::HashMap;

use super::mesh::Mesh;
use crate::math::DVec3;

/// Edges of a mesh by how its faces share them, faces without an area left out.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Flaws {
    /// All edges.
    pub edges: usize,
    /// Those of one face alone: the rim of a hole, or of an open sheet.
    pub open: usize,
    /// Those of two faces that are wound against each other: one of them is flipped.
    pub flipped: usize,
    /// Those of more than two faces.
    pub crowded: usize,
    /// The middle of the first edge that is open, flipped or crowded, in object space.
    pub place: Option<DVec3>,
}

impl Mesh {
    /// Looks at all edges. Vertices at one place are taken as one.
    pub fn flaws(&self) -> Flaws {
        let key = |p: DVec3| (p + DVec3::ZERO).to_array().map(f64::to_bits);
        // By edge, how many faces run along it in either direction, and the first of them.
        let mut edges: HashMap<_, ([u32; 2], DVec3)> = HashMap::new();
        for triangle in 0..self.triangle_count() as u32 {
            let corners = self.corners(triangle);
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
        for (counts, middle) in edges.values() {
            match counts {
                [1, 1] => continue,
                [1, 0] | [0, 1] => flaws.open += 1,
                [2, 0] | [0, 2] => flaws.flipped += 1,
                _ => flaws.crowded += 1,
            }
            // The same one in every run, whatever the order of the table.
            if first.is_none_or(|first| middle.to_array() < first.to_array()) {
                first = Some(*middle);
            }
        }
        flaws.place = first;
        flaws
    }
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
        assert_eq!((open.open, open.flipped, open.crowded), (3, 0, 0));
        assert_eq!(open.place, Some(DVec3::new(0.0, 0.5, 0.5)));
        let flipped = of(&[[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 3, 2]]);
        assert_eq!((flipped.open, flipped.flipped), (0, 3));
        let crowded = of(&[[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3], [1, 2, 0]]);
        assert!(crowded.crowded > 0);
    }
}
