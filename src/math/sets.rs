/// Disjoint sets of the numbers from 0 on, joined pair by pair (Tarjan 1975).
#[derive(Debug)]
pub struct DisjointSets(Vec<u32>);

impl DisjointSets {
    /// So many sets of one number each; no more than a `u32` counts.
    pub fn new(count: usize) -> Self {
        DisjointSets((0..count as u32).collect())
    }

    /// The number that stands for the set which `i` is in: its smallest.
    pub fn root(&mut self, i: usize) -> usize {
        let DisjointSets(parent) = self;
        let mut i = i as u32;
        while parent[i as usize] != i {
            parent[i as usize] = parent[parent[i as usize] as usize];
            i = parent[i as usize];
        }
        i as usize
    }

    /// Makes the sets of `a` and `b` one.
    pub fn join(&mut self, a: usize, b: usize) {
        let (a, b) = (self.root(a), self.root(b));
        self.0[a.max(b)] = a.min(b) as u32;
    }

    /// The numbers of each set, in order; sets by their smallest.
    pub fn groups(mut self) -> Vec<Vec<usize>> {
        let mut groups: Vec<Vec<usize>> = Vec::new();
        let mut place = vec![0; self.0.len()];
        for i in 0..self.0.len() {
            let root = self.root(i);
            if root == i {
                place[i] = groups.len();
                groups.push(Vec::new());
            }
            groups[place[root]].push(i);
        }
        groups
    }
}
