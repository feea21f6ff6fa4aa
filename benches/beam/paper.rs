//! The hierarchy of the 2008 paper (§3.5): a balanced kd-tree whose every node holds a photon and the box
//! around all discs below; walked and evaluated one photon at a time.

use glam::Vec3;
use volpm::math::Ray;
use volpm::photon::Disc;

struct Node {
    min: Vec3,
    max: Vec3,
    position: Vec3,
    inverse_square: f32,
    direction: Vec3,
    power: Vec3,
    /// The second child; the first, if there is one, follows its parent.
    second: u32,
    first: bool,
}

pub struct Paper {
    nodes: Vec<Node>,
}

/// Gathered radiance, and how many photons contributed.
pub struct Found {
    pub radiance: Vec3,
    pub photons: u64,
}

impl Paper {
    pub fn build(mut discs: Vec<Disc>) -> Self {
        let mut nodes = Vec::with_capacity(discs.len());
        grow(&mut discs, &mut nodes);
        Paper { nodes }
    }

    /// In a homogeneous grey medium under Henyey and Greenstein's phase function.
    pub fn gather(&self, ray: &Ray, sigma: f32, g: f32) -> Found {
        let (origin, omega) = (ray.origin.as_vec3(), ray.direction.as_vec3());
        let inverse = omega.recip();
        let mut found = Found { radiance: Vec3::ZERO, photons: 0 };
        let mut stack = vec![0u32];
        while let Some(index) = stack.pop() {
            let node = &self.nodes[index as usize];
            let (low, high) = ((node.min - origin) * inverse, (node.max - origin) * inverse);
            let enter = low.min(high).max_element().max(0.0);
            if enter > low.max(high).min_element() {
                continue;
            }
            let to = node.position - origin;
            let t = to.dot(omega);
            let q = 1.0 - (to - t * omega).length_squared() * node.inverse_square;
            if q > 0.0 && t > 0.0 {
                let base = 1.0 + g * g + 2.0 * g * node.direction.dot(omega);
                let phase = (1.0 - g * g) * 0.25 * std::f32::consts::FRAC_1_PI / (base * base.sqrt());
                found.radiance += node.power * (q * q * phase * (-sigma * t).exp());
                found.photons += 1;
            }
            if node.second != 0 {
                stack.push(node.second);
            }
            if node.first {
                stack.push(index + 1);
            }
        }
        found
    }
}

/// Appends the tree over these discs; returns its box.
fn grow(discs: &mut [Disc], nodes: &mut Vec<Node>) -> (Vec3, Vec3) {
    let (low, high) = discs.iter().fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(low, high), disc| {
        (low.min(disc.photon.position), high.max(disc.photon.position))
    });
    let axis = (high - low).max_position();
    let middle = discs.len() / 2;
    discs.select_nth_unstable_by(middle, |a, b| a.photon.position[axis].total_cmp(&b.photon.position[axis]));
    let (before, rest) = discs.split_at_mut(middle);
    let Some((disc, after)) = rest.split_first_mut() else { return (low, high) };
    let (x, r) = (disc.photon.position, disc.radius);
    let (mut min, mut max) = (x - r, x + r);
    let own = nodes.len();
    nodes.push(Node {
        min,
        max,
        position: x,
        inverse_square: 1.0 / (r * r),
        direction: disc.photon.direction,
        power: disc.photon.power * (3.0 * std::f32::consts::FRAC_1_PI / (r * r)),
        second: 0,
        first: !before.is_empty(),
    });
    if !before.is_empty() {
        let (low, high) = grow(before, nodes);
        (min, max) = (min.min(low), max.max(high));
    }
    if !after.is_empty() {
        nodes[own].second = nodes.len() as u32;
        let (low, high) = grow(after, nodes);
        (min, max) = (min.min(low), max.max(high));
    }
    (nodes[own].min, nodes[own].max) = (min, max);
    (min, max)
}
