use super::area::{area_of, point_in};
use super::face::Face;
use super::facing::Facing;
use super::tree::{Children, Search, Tree};
use super::triangles::{Sheared, Triangles};
use crate::math::{Bounds, DVec3, Distribution, Ray, Vec3};
use crate::{Error, Result};
use glam::Vec2;
use smallvec::SmallVec;
use std::collections::HashMap;
use std::sync::OnceLock;

/// Triangles; closed if, vertices at one position taken as one, every edge is shared by exactly two
/// oppositely wound triangles. Out is then away from the enclosed volume, whatever the winding in the
/// file; the counter-clockwise side otherwise.
#[derive(Debug)]
pub struct Mesh {
    /// In the order of the tree's leaves, counter-clockwise seen from outside.
    triangles: Triangles,
    /// One a vertex; none for flat shading.
    normals: Option<Vec<Vec3>>,
    /// One a vertex.
    uvs: Option<Vec<Vec2>>,
    /// The vertices of each triangle; empty if vertices have neither normals nor texture coordinates.
    vertices: Vec<[u32; 3]>,
    /// The sum of the triangles' areas,
    area: f64,
    /// and all of them, once points are drawn.
    areas: OnceLock<Distribution>,
    tree: Tree,
    /// Made when walls are first looked for.
    facing: OnceLock<Vec<Facing>>,
    /// Found when it is first asked for.
    pub(super) overlaps: OnceLock<bool>,
    bounds: Bounds,
    closed: bool,
    volume: f64,
}

/// The parts a mesh is made of.
#[derive(Debug, Default)]
pub(super) struct Parts {
    pub positions: Vec<Vec3>,
    /// One a vertex; zero where the file has none.
    pub normals: Vec<Vec3>,
    /// One a vertex, or empty.
    pub uvs: Vec<Vec2>,
    /// Indices are in range.
    pub triangles: Vec<[u32; 3]>,
}

/// Faces whose normals are this near, as a cosine, face the same way: 18 degrees.
pub(super) const SAME_WAY: f64 = 0.95;

/// More ways that faces near a point face are too many to tell.
const MOST_WAYS: usize = 6;

/// More triangles than this overflow the hierarchy's indices.
pub(super) const MAX_TRIANGLES: usize = 200_000_000;

/// A triangle near a point.
#[derive(Clone, Copy)]
struct Way {
    distance: f64,
    triangle: u32,
    on: DVec3,
    normal: DVec3,
}

/// A search for triangles near a point.
struct Walls<'m> {
    mesh: &'m Mesh,
    facing: &'m [Facing],
    p: DVec3,
    radius: f64,
    nearest: Option<Way>,
    /// Those that the point stands over, from near to far.
    ways: SmallVec<[Way; 8]>,
}

/// Sine and cosine of the angle of [`SAME_WAY`].
const OVER: [f32; 2] = [0.312_249_9, SAME_WAY as f32];
const _: () = assert!((OVER[0] * OVER[0] + OVER[1] * OVER[1] - 1.0).abs() < 1e-6);

impl Search for Walls<'_> {
    fn limit(&self) -> f64 {
        self.ways.get(MOST_WAYS - 1).map_or(self.radius, |last| last.distance)
    }

    fn nearest(&self) -> f64 {
        self.nearest.map_or(self.radius, |nearest| nearest.distance)
    }

    fn wants(&self, node: u32, children: &Children) -> u8 {
        let facing = &self.facing[node as usize];
        let mut wanted = facing.may_face(children, OVER);
        for way in &self.ways {
            let reach2 = self.mesh.tree.reach2(way.distance);
            let mut behind = 0;
            for (child, distance2) in children.distance2.iter().enumerate() {
                behind |= u8::from(*distance2 > reach2) << child;
            }
            wanted &= !(behind & facing.are_along(way.normal.as_vec3(), OVER));
        }
        wanted
    }

    fn visit(&mut self, triangle: u32) {
        let p = self.p;
        let limit = self.limit();
        let corners @ [a, b, c] = self.mesh.corners(triangle);
        let cross = (b - a).cross(c - a);
        let (above, size2) = ((p - a).dot(cross), cross.length_squared());
        let same = |way: &Way| {
            let cos = cross.dot(way.normal);
            cos > 0.0 && cos * cos > SAME_WAY * SAME_WAY * size2
        };
        // A triangle is not nearer than its plane, and along that no nearer than a corner less the longer edge there.
        let apart2 = if size2 > 0.0 { above * above / size2 } else { 0.0 };
        let along = ((p - a).length_squared() - apart2).max(0.0).sqrt();
        let edge = (b - a).length_squared().max((c - a).length_squared()).sqrt();
        let least2 = apart2 + (along - edge).max(0.0).powi(2);
        let behind = |way: &Way| least2 >= way.distance * way.distance;
        // No nearer than what is found, and too far aside for the point to stand over it, or hidden.
        let useless = || apart2 < SAME_WAY * SAME_WAY * least2 || self.ways.iter().any(|way| behind(way) && same(way));
        if least2 > limit * limit || self.nearest.is_some_and(|way| behind(&way)) && useless() {
            return;
        }
        let on = Face::Triangle(corners).closest(p);
        let way = Way { distance: on.distance(p), triangle, on, normal: cross.normalize_or(DVec3::Y) };
        if way.distance > limit {
            return;
        }
        if self.nearest.is_none_or(|nearest| way.distance < nearest.distance) {
            self.nearest = Some(way);
        }
        let over = size2 > 0.0 && above * above >= (SAME_WAY * way.distance).powi(2) * size2;
        if !over || self.ways.iter().any(|other| other.distance <= way.distance && same(other)) {
            return;
        }
        self.ways.retain(|other| !same(other));
        let place = self.ways.partition_point(|other| other.distance <= way.distance);
        self.ways.insert(place, way);
        self.ways.truncate(MOST_WAYS);
    }
}

impl Mesh {
    /// A mesh of `triangles`, indices into `positions`. With `smooth` the shading normals are the mean
    /// of the normals of the triangles around a vertex, weighted by their areas.
    ///
    /// # Errors
    /// When there are no triangles with an area, an index is out of range or a position not finite.
    pub fn new(positions: Vec<Vec3>, triangles: Vec<[u32; 3]>, smooth: bool) -> Result<Self> {
        if let Some(i) = positions.iter().position(|p| !p.is_finite()) {
            return Err(Error::Scene(format!("vertex {i} of a mesh is {}: expected finite numbers", positions[i])));
        }
        if let Some(t) = triangles.iter().find(|t| t.iter().any(|&i| i as usize >= positions.len())) {
            let message = format!("a triangle of a mesh names the vertices {t:?}, but there are {}", positions.len());
            return Err(Error::Scene(message));
        }
        let normals = vec![Vec3::ZERO; positions.len()];
        Self::from_parts(Parts { positions, normals, uvs: Vec::new(), triangles }, smooth)
    }

    pub(super) fn from_parts(parts: Parts, smooth: bool) -> Result<Self> {
        let Parts { positions, normals, uvs, mut triangles } = parts;
        let site = weld(&positions);
        // ---- triangles with two corners at one place are nothing
        triangles.retain(|t| {
            let [a, b, c] = t.map(|i| site[i as usize]);
            a != b && b != c && c != a
        });
        if triangles.len() > MAX_TRIANGLES {
            return Err(Error::Limit(format!(
                "a mesh of {} triangles: at most {MAX_TRIANGLES} can be used",
                triangles.len()
            )));
        }
        // ---- out
        let closed = is_closed(&triangles, &site);
        let middle = Bounds::of_points(triangles.iter().flatten().map(|&i| positions[i as usize].as_dvec3())).center();
        let corners = |t: &[u32; 3]| t.map(|i| positions[i as usize].as_dvec3() - middle);
        let mut volume = triangles.iter().map(corners).map(|[a, b, c]| a.dot(b.cross(c))).sum::<f64>() / 6.0;
        if closed && volume < 0.0 {
            triangles.iter_mut().for_each(|t| t.swap(1, 2));
            volume = -volume;
        }
        // ---- in the order of the tree
        let boxes: Vec<Bounds> =
            triangles.iter().map(|t| Bounds::of_points(t.map(|i| positions[i as usize].as_dvec3()))).collect();
        let tree = Tree::new(&boxes);
        let mut triangles: Vec<[u32; 3]> = tree.order().iter().map(|&i| triangles[i as usize]).collect();
        let bounds = boxes.iter().fold(Bounds::EMPTY, |all, b| all.union(*b));
        // ---- areas and normals
        let cross = |t: &[u32; 3]| {
            let [a, b, c] = t.map(|i| positions[i as usize].as_dvec3());
            (b - a).cross(c - a)
        };
        let area = triangles.iter().map(|t| 0.5 * cross(t).length()).sum::<f64>();
        if area <= 0.0 || !area.is_finite() {
            return Err(Error::Scene("a mesh without any triangle that has an area".into()));
        }
        let normals = smooth.then(|| {
            let mut means = vec![DVec3::ZERO; positions.len()];
            for t in &triangles {
                for &i in t {
                    means[site[i as usize] as usize] += cross(t);
                }
            }
            let given = normals.iter().zip(&site);
            given.map(|(n, &s)| n.try_normalize().unwrap_or(means[s as usize].normalize_or_zero().as_vec3())).collect()
        });
        let uvs = (uvs.len() == positions.len()).then_some(uvs);
        let corners = Triangles::new(triangles.iter().map(|t| t.map(|i| positions[i as usize])));
        drop(positions);
        // ---- vertices in the order of their first use: neighbours lie together in memory
        let mut used = Vec::new();
        if normals.is_some() || uvs.is_some() {
            let mut place = vec![u32::MAX; site.len()];
            for i in triangles.iter_mut().flatten() {
                let place = &mut place[*i as usize];
                if *place == u32::MAX {
                    *place = used.len() as u32;
                    used.push(*i as usize);
                }
                *i = *place;
            }
        } else {
            triangles = Vec::new();
        }
        Ok(Mesh {
            triangles: corners,
            normals: normals.map(|normals: Vec<Vec3>| used.iter().map(|&i| normals[i]).collect()),
            uvs: uvs.map(|uvs| used.iter().map(|&i| uvs[i]).collect()),
            vertices: triangles,
            area,
            areas: OnceLock::new(),
            tree,
            facing: OnceLock::new(),
            overlaps: OnceLock::new(),
            bounds,
            closed,
            volume,
        })
    }

    /// How many triangles there are, without those whose corners coincide.
    pub fn triangle_count(&self) -> usize {
        self.triangles.count()
    }

    /// The box around the triangles, in object space.
    pub fn bounds(&self) -> Bounds {
        self.bounds
    }

    /// Whether the mesh encloses a volume.
    pub fn is_closed(&self) -> bool {
        self.closed
    }

    /// The sum of the triangles' areas, in object space.
    pub fn area(&self) -> f64 {
        self.area
    }

    /// The enclosed volume in object space; `None` if open.
    pub fn volume(&self) -> Option<f64> {
        self.closed.then_some(self.volume)
    }

    /// The corners of a triangle.
    pub(super) fn corners(&self, triangle: u32) -> [DVec3; 3] {
        self.triangles.corners(triangle)
    }

    /// `visit` gets parameter, triangle and the weights of its second and third corner where the ray meets it, and returns
    /// the new `t_max`. Watertight: no ray passes between triangles that share an edge.
    #[inline]
    pub(super) fn crossings(
        &self,
        ray: &Ray,
        t_min: f64,
        t_max: f64,
        visit: &mut impl FnMut(f64, u32, [f64; 2]) -> f64,
    ) {
        let mut sheared = None;
        let mut t_max = t_max;
        self.tree.leaves_along(ray, t_min, t_max, |leaves| {
            let sheared = sheared.get_or_insert_with(|| Sheared::new(&self.triangles, ray));
            leaves.in_fours(|four, lanes| {
                let mut met = sheared.may_meet(four) & lanes;
                while met != 0 {
                    let triangle = 4 * four as u32 + met.trailing_zeros();
                    met &= met - 1;
                    if let Some((t, weights)) = sheared.meets(triangle)
                        && t > t_min
                        && t < t_max
                    {
                        t_max = visit(t, triangle, weights);
                    }
                }
            });
            t_max
        });
    }

    /// The geometric normal, by the triangle's winding.
    pub(super) fn normal(&self, triangle: u32) -> DVec3 {
        let [a, b, c] = self.corners(triangle);
        (b - a).cross(c - a).normalize_or(DVec3::Y)
    }

    /// The shading normal in the hemisphere of `geometric`, not normalised, and the texture
    /// coordinates; the weights themselves where the file has none.
    pub(super) fn shading(&self, triangle: u32, [v, w]: [f64; 2], geometric: DVec3) -> (DVec3, [f64; 2]) {
        let vertices = self.vertices.get(triangle as usize).copied().unwrap_or_default();
        let weights = [1.0 - v - w, v, w];
        let normal = self.normals.as_ref().map_or(geometric, |normals| {
            let n: DVec3 = vertices.iter().zip(weights).map(|(&i, w)| w * normals[i as usize].as_dvec3()).sum();
            if n.length_squared() < 1e-12 { geometric } else { n }
        });
        let uv = self.uvs.as_ref().map_or([v, w], |uvs| {
            let uv: glam::DVec2 = vertices.iter().zip(weights).map(|(&i, w)| w * uvs[i as usize].as_dvec2()).sum();
            uv.to_array()
        });
        (normal, uv)
    }

    /// Whether the file gives texture coordinates.
    pub(crate) fn has_uvs(&self) -> bool {
        self.uvs.is_some()
    }

    /// ∂p/∂u and ∂p/∂v of a triangle; its edges where all of it has one u or one v.
    pub(super) fn tangents(&self, triangle: u32) -> [DVec3; 2] {
        let [a, b, c] = self.corners(triangle);
        let edges = [b - a, c - a];
        let Some(uvs) = &self.uvs else { return edges };
        let vertices = self.vertices.get(triangle as usize).copied().unwrap_or_default();
        let [a, b, c] = vertices.map(|i| uvs[i as usize].as_dvec2());
        let [s, t] = [b - a, c - a];
        let determinant = s.perp_dot(t);
        if determinant == 0.0 {
            return edges;
        }
        [(t.y * edges[0] - s.y * edges[1]) / determinant, (s.x * edges[1] - t.x * edges[0]) / determinant]
    }

    /// The winding number about `p` (how often the surface encloses it), counted along rays in a few
    /// fixed directions that are parallel to nothing: the first ray that meets no edge decides, or the
    /// majority.
    pub(super) fn contains(&self, p: DVec3) -> bool {
        const DIRECTIONS: [DVec3; 5] = [
            DVec3::new(0.483_720_954_1, 0.712_905_413_7, 0.507_680_193_1),
            DVec3::new(-0.871_134_609_3, 0.217_730_881_9, -0.440_121_137_3),
            DVec3::new(0.102_718_281_9, -0.577_215_664_9, -0.810_094_431_7),
            DVec3::new(-0.314_159_265_3, -0.618_033_988_7, 0.720_614_277_1),
            DVec3::new(0.915_965_594_1, -0.261_497_212_8, 0.304_331_518_9),
        ];
        /// Weights below this are on an edge as far as rounding can tell.
        const EDGE: f64 = 1e-9;
        if !self.closed || !self.bounds.contains(p) {
            return false;
        }
        let mut votes = 0;
        for direction in DIRECTIONS {
            let (mut winding, mut clean) = (0, true);
            let ray = Ray::new(p, direction);
            self.crossings(&ray, 0.0, f64::INFINITY, &mut |_, triangle, [v, w]| {
                let [a, b, c] = self.corners(triangle);
                winding += if (b - a).cross(c - a).dot(direction) > 0.0 { 1 } else { -1 };
                clean &= v > EDGE && w > EDGE && v + w < 1.0 - EDGE;
                f64::INFINITY
            });
            if clean {
                return winding > 0;
            }
            votes += if winding > 0 { 1 } else { -1 };
        }
        votes > 0
    }

    /// A triangle by area, a point in it, and the weights of its second and third corner.
    pub(super) fn sample(&self, [u, v]: [f64; 2]) -> (DVec3, u32) {
        let area = |triangle: u32| area_of(self.corners(triangle));
        let areas = self.areas.get_or_init(|| Distribution::new((0..self.triangles.count() as u32).map(area)));
        let (index, u) = areas.choose(u).map_or((0, u), |choice| (choice.index as u32, choice.rest));
        (point_in(self.corners(index), [u, v]), index)
    }

    /// Distance, triangle and place of the point closest to `p`, if it is nearer than `limit`.
    pub(super) fn nearest(&self, p: DVec3, limit: f64) -> Option<(f64, u32, DVec3)> {
        let mut nearest = None;
        let mut near = limit;
        self.tree.near(p, limit, |i| {
            let on = Face::Triangle(self.corners(i)).closest(p);
            let distance = on.distance(p);
            if distance < near {
                near = distance;
                nearest = Some((distance, i, on));
            }
            near
        });
        nearest
    }

    /// Calls `visit` with triangle, closest point and normal of triangles within `radius` of `p`: of the nearest, and of
    /// those that `p` stands over, with its way to them as near to their normal as normals that are [`SAME_WAY`]. Of
    /// those that face the same way the nearest is given, and of the ways the [`MOST_WAYS`] that have the nearest.
    pub(super) fn faces_near(&self, p: DVec3, radius: f64, visit: &mut impl FnMut(u32, DVec3, DVec3)) {
        let facing = self.facing.get_or_init(|| Facing::of(&self.tree, |i| self.normal(i)));
        let mut walls = Walls { mesh: self, facing, p, radius, nearest: None, ways: SmallVec::new() };
        self.tree.search(p, &mut walls);
        let Walls { nearest, ways, .. } = walls;
        let alone = nearest.filter(|nearest| ways.iter().all(|way| way.triangle != nearest.triangle));
        alone.iter().chain(&ways).for_each(|way| visit(way.triangle, way.on, way.normal));
    }

    /// The triangles whose boxes overlap `query`, and a few more.
    pub(super) fn overlapping(&self, query: &Bounds, visit: impl FnMut(u32)) {
        self.tree.overlapping(query, visit);
    }
}

/// For every vertex the first one at the same position.
fn weld(positions: &[Vec3]) -> Vec<u32> {
    let mut first = HashMap::with_capacity(positions.len());
    // Adding zero makes one of 0 and −0.
    let key = |p: &Vec3| (*p + Vec3::ZERO).to_array().map(f32::to_bits);
    positions.iter().enumerate().map(|(i, p)| *first.entry(key(p)).or_insert(i as u32)).collect()
}

/// Whether every edge is used exactly once in each direction.
fn is_closed(triangles: &[[u32; 3]], site: &[u32]) -> bool {
    let mut edges: Vec<(u32, u32, bool)> = triangles
        .iter()
        .flat_map(|t| {
            let [a, b, c] = t.map(|i| site[i as usize]);
            [(a, b), (b, c), (c, a)].map(|(p, q)| (p.min(q), p.max(q), p < q))
        })
        .collect();
    edges.sort_unstable();
    let (pairs, rest) = edges.as_chunks::<2>();
    let paired = |[p, q]: &[(u32, u32, bool); 2]| (p.0, p.1) == (q.0, q.1) && p.2 != q.2;
    // An edge used twice each way sorts into pairs of equal direction and fails, as it should.
    !edges.is_empty() && rest.is_empty() && pairs.iter().all(paired)
}
