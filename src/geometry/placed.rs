use super::face::Face;
use super::{Cuboid, Cylinder, Disk, Lathe, Mesh, Quad, Sphere, cylinder, ellipsoid};
use crate::math::{Bounds, DAffine3, DMat3, DVec3, Ray, choose};
use crate::{Error, Result};
use std::sync::Arc;

/// A shape in its own space. Meshes and lathes are shared by all their instances.
#[derive(Clone, Debug)]
pub enum Shape {
    /// A sphere.
    Sphere(Sphere),
    /// A box.
    Cuboid(Cuboid),
    /// A parallelogram.
    Quad(Quad),
    /// A flat disk.
    Disk(Disk),
    /// A circular cylinder.
    Cylinder(Cylinder),
    /// A polyline turned about the y axis.
    Lathe(Arc<Lathe>),
    /// A mesh of triangles.
    Mesh(Arc<Mesh>),
}

/// A shape that is this many times farther from its own origin than it reaches from the world's is kept about the world's.
const FAR: f64 = 16.0;

/// A shape at its place in the world.
#[derive(Clone, Debug)]
pub struct Placed {
    shape: Shape,
    /// Where the shape's space has the origin of object space's.
    moved: DVec3,
    to_world: DAffine3,
    to_local: DAffine3,
    identity: bool,
    /// How many times longer lengths are in the world, if by the same factor in all directions.
    similarity: Option<f64>,
    /// How many times larger volumes are in the world.
    volume_ratio: f64,
    /// −1 where the transform turns the side that is out.
    turn: f64,
    bounds: Bounds,
    area: f64,
}

/// What a point on a surface looks like in the world: unit normals and texture coordinates.
pub(super) struct Surface {
    pub normal: DVec3,
    pub shading_normal: DVec3,
    pub uv: [f64; 2],
}

impl Shape {
    /// This, moved to the world's origin where it is far from its own, whose coordinates would have too few digits there; and by how much. `origin` is the world's.
    fn about(self, origin: DVec3) -> (Shape, DVec3) {
        let Bounds { min, max } = self.bounds(&DAffine3::IDENTITY);
        let reach = (min - origin).abs().max((max - origin).abs()).max_element();
        if origin.abs().max_element() <= FAR * reach {
            return (self, DVec3::ZERO);
        }
        let moved = match self {
            Shape::Sphere(s) => Shape::Sphere(s.moved(-origin)),
            Shape::Cuboid(c) => Shape::Cuboid(c.moved(-origin)),
            Shape::Quad(q) => Shape::Quad(q.moved(-origin)),
            Shape::Disk(d) => Shape::Disk(d.moved(-origin)),
            Shape::Cylinder(c) => Shape::Cylinder(c.moved(-origin)),
            // Their numbers are those of a file or a profile.
            Shape::Lathe(_) | Shape::Mesh(_) => return (self, DVec3::ZERO),
        };
        (moved, -origin)
    }
}

impl Placed {
    /// `shape` moved by `to_world`.
    ///
    /// # Errors
    /// When the transform is not finite or flattens space.
    pub fn new(shape: Shape, to_world: DAffine3) -> Result<Self> {
        let m = to_world.matrix3;
        let determinant = m.determinant();
        let columns = [m.x_axis, m.y_axis, m.z_axis].map(|c| c.length());
        let product: f64 = columns.iter().product();
        let to_local = to_world.inverse();
        // Below this ratio the inverse has no correct digit.
        if !to_world.is_finite() || !to_local.is_finite() || determinant.abs() <= 1e-14 * product {
            return Err(Error::Scene(format!(
                "a transform with determinant {determinant} cannot be inverted: expected finite numbers, \
                 no scale of 0 and a matrix that does not flatten space"
            )));
        }
        let scale = product.cbrt();
        let gram = m.transpose() * m - DMat3::from_diagonal(DVec3::splat(scale * scale));
        let similarity = gram.to_cols_array().iter().all(|x| x.abs() <= 1e-12 * scale * scale).then_some(scale);
        let (shape, moved) = shape.about(to_local.transform_point3(DVec3::ZERO));
        let to_world = to_world * DAffine3::from_translation(-moved);
        let to_local = if moved == DVec3::ZERO { to_local } else { to_world.inverse() };
        let mut placed = Placed {
            turn: if matches!(shape, Shape::Quad(_)) { determinant.signum() } else { 1.0 },
            bounds: shape.bounds(&to_world),
            identity: to_world == DAffine3::IDENTITY,
            similarity,
            volume_ratio: determinant.abs(),
            area: 0.0,
            shape,
            moved,
            to_world,
            to_local,
        };
        placed.area = placed.compute_area();
        let finite = placed.bounds.min.is_finite() && placed.bounds.max.is_finite() && placed.area.is_finite();
        if !finite || placed.area <= 0.0 {
            return Err(Error::Scene(format!(
                "a shape of area {} from {} to {} after its transform: expected finite numbers and an area above 0",
                placed.area, placed.bounds.min, placed.bounds.max
            )));
        }
        Ok(placed)
    }

    /// The shape, in its own space: object space, or that moved nearer.
    pub fn shape(&self) -> &Shape {
        &self.shape
    }

    /// From the shape's space to the world.
    pub fn to_world(&self) -> &DAffine3 {
        &self.to_world
    }

    /// From the world to the shape's space.
    pub fn to_local(&self) -> &DAffine3 {
        &self.to_local
    }

    /// The box around it in the world.
    pub fn bounds(&self) -> Bounds {
        self.bounds
    }

    /// The corners of a triangle in the world, and its outward unit normal there; of a mesh.
    pub(super) fn triangle(&self, triangle: u32) -> Option<([DVec3; 3], DVec3)> {
        let Shape::Mesh(mesh) = &self.shape else { return None };
        let corners = mesh.corners(triangle).map(|corner| self.to_world.transform_point3(corner));
        Some((corners, self.normal_to_world(mesh.normal(triangle))))
    }

    pub(super) fn area(&self) -> f64 {
        self.area
    }

    /// The shape is a sphere in the world, too: its centre and radius there.
    pub(super) fn world_sphere(&self) -> Option<(DVec3, f64)> {
        match (&self.shape, self.similarity) {
            (Shape::Sphere(s), Some(scale)) => Some((self.to_world.transform_point3(s.center()), scale * s.radius())),
            _ => None,
        }
    }

    /// Whether it has an inside.
    pub fn is_closed(&self) -> bool {
        match &self.shape {
            Shape::Sphere(_) | Shape::Cuboid(_) => true,
            Shape::Quad(_) | Shape::Disk(_) => false,
            Shape::Cylinder(c) => c.is_closed(),
            Shape::Lathe(l) => l.is_closed(),
            Shape::Mesh(m) => m.is_closed(),
        }
    }

    pub(super) fn contains(&self, p: DVec3) -> bool {
        let p = self.to_local.transform_point3(p);
        match &self.shape {
            Shape::Sphere(s) => s.contains(p),
            Shape::Cuboid(c) => c.contains(p),
            Shape::Quad(_) | Shape::Disk(_) => false,
            Shape::Cylinder(c) => c.contains(p),
            Shape::Lathe(l) => l.contains(p),
            Shape::Mesh(m) => m.contains(p),
        }
    }

    /// A ray in object space with the parameters of one in the world; the direction is not of unit length there.
    #[inline]
    fn local_ray(&self, ray: &Ray) -> Ray {
        if self.identity {
            return *ray;
        }
        Ray {
            origin: self.to_local.transform_point3(ray.origin),
            direction: self.to_local.transform_vector3(ray.direction),
        }
    }

    /// Calls `visit` with parameter, primitive and, in triangles, weights of every crossing with
    /// `t_min < t < t_max`. It returns the new `t_max`; negative infinity ends the search.
    #[inline]
    pub(super) fn crossings(
        &self,
        ray: &Ray,
        t_min: f64,
        mut t_max: f64,
        visit: &mut impl FnMut(f64, u32, [f64; 2]) -> f64,
    ) {
        let ray = &self.local_ray(ray);
        let range = (t_min, t_max);
        let mut inside = |t: f64, primitive: u32| {
            if t > t_min && t < t_max {
                t_max = visit(t, primitive, [0.0; 2]);
            }
        };
        match &self.shape {
            Shape::Sphere(s) => s.crossings(ray, &mut |t| inside(t, 0)),
            Shape::Cuboid(c) => c.crossings(ray, &mut inside),
            Shape::Quad(q) => q.crossings(ray, range, &mut |t| inside(t, 0)),
            Shape::Disk(d) => d.crossings(ray, &mut |t| inside(t, 0)),
            Shape::Cylinder(c) => c.crossings(ray, &mut inside),
            Shape::Lathe(l) => l.crossings(ray, &mut inside),
            Shape::Mesh(m) => m.crossings(ray, t_min, t_max, visit),
        }
    }

    /// The outward normal in object space at a point there.
    fn local_normal(&self, p: DVec3, primitive: u32) -> DVec3 {
        match &self.shape {
            Shape::Sphere(s) => s.normal(p),
            Shape::Cuboid(c) => c.normal(primitive),
            Shape::Quad(q) => q.normal(),
            Shape::Disk(d) => d.normal(),
            Shape::Cylinder(c) => c.normal(p, primitive),
            Shape::Lathe(l) => l.normal(p, primitive),
            Shape::Mesh(m) => m.normal(primitive),
        }
    }

    /// Normals go by the inverse transpose.
    #[inline]
    fn normal_to_world(&self, n: DVec3) -> DVec3 {
        if self.identity { n } else { self.turn * (self.to_local.matrix3.transpose() * n).normalize() }
    }

    pub(super) fn surface(&self, ray: &Ray, t: f64, primitive: u32, weights: [f64; 2]) -> Surface {
        let p = self.local_ray(ray).at(t);
        let local = self.local_normal(p, primitive);
        let normal = self.normal_to_world(local);
        let uv = match &self.shape {
            Shape::Sphere(s) => s.uv(p),
            Shape::Cuboid(c) => c.uv(p, primitive),
            Shape::Quad(q) => q.uv(p),
            Shape::Disk(d) => d.uv(p),
            Shape::Cylinder(c) => c.uv(p, primitive),
            Shape::Lathe(l) => {
                return self.shaded(normal, l.shading_normal(p, primitive), l.uv(p, primitive));
            }
            Shape::Mesh(m) => {
                let (shading, uv) = m.shading(primitive, weights, local);
                return self.shaded(normal, shading, uv);
            }
        };
        Surface { normal, shading_normal: normal, uv }
    }

    /// ∂p/∂u and ∂p/∂v in object space at a point of the surface there.
    pub(super) fn tangents(&self, p: DVec3, primitive: u32) -> [DVec3; 2] {
        let p = p + self.moved;
        match &self.shape {
            Shape::Sphere(s) => s.tangents(p),
            Shape::Cuboid(c) => c.tangents(primitive),
            Shape::Quad(q) => q.tangents(),
            Shape::Disk(d) => d.tangents(p),
            Shape::Cylinder(c) => c.tangents(p, primitive),
            Shape::Lathe(l) => l.tangents(p, primitive),
            Shape::Mesh(m) => m.tangents(primitive),
        }
    }

    /// A vector of object space in the world.
    pub(super) fn vector_to_world(&self, v: DVec3) -> DVec3 {
        if self.identity { v } else { self.to_world.transform_vector3(v) }
    }

    /// A point of the world in object space.
    pub(super) fn to_object(&self, p: DVec3) -> DVec3 {
        if self.identity { p } else { self.to_local.transform_point3(p) - self.moved }
    }

    /// With a shading normal in object space, brought to the side of `normal`.
    fn shaded(&self, normal: DVec3, shading: DVec3, uv: [f64; 2]) -> Surface {
        let shading = self.normal_to_world(shading).normalize_or(normal);
        let shading_normal = if shading.dot(normal) < 0.0 { -shading } else { shading };
        Surface { normal, shading_normal, uv }
    }

    /// How many times larger an area with the world's unit normal `n` is in the world:
    /// |det M| / |Mᵀn|.
    fn area_ratio(&self, n: DVec3) -> f64 {
        self.volume_ratio / (self.to_world.matrix3.transpose() * n).length()
    }

    fn compute_area(&self) -> f64 {
        let m = &self.to_world.matrix3;
        match (&self.shape, self.similarity) {
            (Shape::Sphere(s), Some(scale)) => scale * scale * s.area(),
            (Shape::Sphere(s), None) => ellipsoid::area(&(*m * s.radius())),
            (Shape::Cuboid(c), _) => (0..6).map(|f| self.box_face_area(c, f)).sum(),
            (Shape::Quad(q), _) => q.area() * self.area_ratio(self.normal_to_world(q.normal())),
            (Shape::Disk(d), _) => d.area() * self.area_ratio(self.normal_to_world(d.normal())),
            (Shape::Cylinder(c), _) => {
                let (_, [u, v], axis) = c.axes();
                let [u, v, axis] = [u, v, axis].map(|a| *m * a);
                let cap = if c.is_closed() { std::f64::consts::PI * u.cross(v).length() } else { 0.0 };
                // The side's area element is |axis × (u cos φ + v sin φ)| dφ: the rim of an ellipse.
                ellipsoid::circumference(axis.cross(u), axis.cross(v)) + 2.0 * cap
            }
            (Shape::Lathe(l), Some(scale)) => scale * scale * l.area(),
            (Shape::Lathe(l), None) => l.stretched_area(m),
            (Shape::Mesh(mesh), Some(scale)) => scale * scale * mesh.area(),
            (Shape::Mesh(mesh), None) => (0..mesh.triangle_count() as u32)
                .map(|i| {
                    let [a, b, c] = mesh.corners(i);
                    0.5 * (*m * (b - a)).cross(*m * (c - a)).length()
                })
                .sum(),
        }
    }

    fn box_face_area(&self, c: &Cuboid, face: u32) -> f64 {
        let [_, u, v] = c.face(face).map(|e| self.to_world.matrix3 * e);
        u.cross(v).length()
    }

    /// A point on the surface, its outward unit normal, and the density by world area.
    pub(super) fn sample_area(&self, u: [f64; 2]) -> (DVec3, DVec3, f64) {
        let (local, primitive) = match &self.shape {
            Shape::Sphere(s) => (s.sample(u), 0),
            Shape::Cuboid(c) => self.sample_box(c, u),
            Shape::Quad(q) => (q.sample(u), 0),
            Shape::Disk(d) => (d.sample(u), 0),
            Shape::Cylinder(c) => c.sample(u),
            Shape::Lathe(l) => l.sample(u),
            Shape::Mesh(m) => m.sample(u),
        };
        let normal = self.normal_to_world(self.local_normal(local, primitive));
        let point = if self.identity { local } else { self.to_world.transform_point3(local) };
        (point, normal, self.pdf_area(normal))
    }

    /// The density of [`Placed::sample_area`] where the outward unit normal is `normal`: uniform where
    /// the transform stretches all faces alike, and for boxes; by the area in object space otherwise.
    pub(super) fn pdf_area(&self, normal: DVec3) -> f64 {
        let local_area = match &self.shape {
            _ if self.similarity.is_some() => return self.area.recip(),
            Shape::Cuboid(_) | Shape::Quad(_) | Shape::Disk(_) => return self.area.recip(),
            Shape::Sphere(s) => s.area(),
            Shape::Cylinder(c) => c.area(),
            Shape::Lathe(l) => l.area(),
            Shape::Mesh(m) => m.area(),
        };
        (local_area * self.area_ratio(normal)).recip()
    }

    fn sample_box(&self, c: &Cuboid, [u, v]: [f64; 2]) -> (DVec3, u32) {
        let areas = (0..6).map(|face| self.box_face_area(c, face));
        let (face, u) = choose(areas, self.area, u).map_or((0, u), |choice| (choice.index as u32, choice.rest));
        let [origin, edge_u, edge_v] = c.face(face);
        (origin + u * edge_u + v * edge_v, face)
    }

    /// Calls `visit` with primitive, closest point, and outward unit normal of every face within
    /// `radius` of `p`; of a mesh as [`Mesh::faces_near`] chooses.
    pub(super) fn faces_near(&self, p: DVec3, radius: f64, visit: &mut impl FnMut(u32, DVec3, DVec3)) {
        let m = &self.to_world;
        let mut flat = |primitive: u32, face: Face, normal: DVec3| {
            let closest = face.closest(p);
            if closest.distance_squared(p) <= radius * radius {
                visit(primitive, closest, normal);
            }
        };
        let placed = |[o, u, v]: [DVec3; 3]| {
            Face::Parallelogram([m.transform_point3(o), m.transform_vector3(u), m.transform_vector3(v)])
        };
        match &self.shape {
            Shape::Quad(q) => flat(0, placed(q.face()), self.normal_to_world(q.normal())),
            Shape::Cuboid(c) => {
                for face in 0..6 {
                    flat(face, placed(c.face(face)), self.normal_to_world(c.normal(face)));
                }
            }
            Shape::Mesh(mesh) => match self.similarity {
                Some(scale) => {
                    mesh.faces_near(self.to_local.transform_point3(p), radius / scale, &mut |i, on, normal| {
                        visit(i, m.transform_point3(on), self.normal_to_world(normal));
                    })
                }
                None => {
                    // ---- the box around the sphere, which is an ellipsoid in object space
                    let rows = self.to_local.matrix3.transpose();
                    let reach = radius * DVec3::new(rows.x_axis.length(), rows.y_axis.length(), rows.z_axis.length());
                    let center = self.to_local.transform_point3(p);
                    mesh.overlapping(&Bounds { min: center - reach, max: center + reach }, |i| {
                        let triangle = mesh.corners(i).map(|c| m.transform_point3(c));
                        flat(i, Face::Triangle(triangle), self.normal_to_world(mesh.normal(i)));
                    });
                }
            },
            Shape::Sphere(s) => {
                let on = self.closest_of_sphere(s, p);
                let normal = self.normal_to_world(s.normal(self.to_local.transform_point3(on)));
                if on.distance_squared(p) <= radius * radius {
                    visit(0, on, normal);
                }
            }
            Shape::Disk(d) => {
                let (center, radii) = d.radii();
                let radii = radii.map(|a| m.transform_vector3(a));
                let face = Face::Ellipse(m.transform_point3(center), radii, self.similarity.is_some());
                flat(0, face, self.normal_to_world(d.normal()));
            }
            Shape::Lathe(l) => {
                let local = self.to_local.transform_point3(p);
                l.closest((p, local), m, self.similarity.is_some(), |piece, on| {
                    if on.distance_squared(p) <= radius * radius {
                        let normal = l.normal(self.to_local.transform_point3(on), piece);
                        visit(piece, on, self.normal_to_world(normal));
                    }
                });
            }
            Shape::Cylinder(c) => {
                let (base, radii, axis) = c.axes();
                let (radii, axis) = (radii.map(|a| m.transform_vector3(a)), m.transform_vector3(axis));
                let (base, circular) = (m.transform_point3(base), self.similarity.is_some());
                if c.is_closed() {
                    for (primitive, center) in [(cylinder::BASE, base), (cylinder::TOP, base + axis)] {
                        let normal = self.normal_to_world(c.normal(p, primitive));
                        flat(primitive, Face::Ellipse(center, radii, circular), normal);
                    }
                }
                let on = ellipsoid::closest_of_side(base, radii, axis, circular, p);
                let normal = self.normal_to_world(c.normal(self.to_local.transform_point3(on), cylinder::SIDE));
                if on.distance_squared(p) <= radius * radius {
                    visit(cylinder::SIDE, on, normal);
                }
            }
        }
    }

    /// How far the surface is from `p`; `limit` if it is farther.
    pub(super) fn clearance(&self, p: DVec3, limit: f64) -> f64 {
        let mut nearest = limit;
        match (&self.shape, self.similarity) {
            (Shape::Mesh(mesh), Some(scale)) => {
                let found = mesh.nearest(self.to_local.transform_point3(p), limit / scale);
                nearest = nearest.min(found.map_or(limit, |(distance, _, _)| scale * distance));
            }
            _ => self.faces_near(p, limit, &mut |_, on, _| nearest = nearest.min(on.distance(p))),
        }
        nearest
    }

    /// Under a similarity the image of the closest point in object space is the closest in the world, too.
    fn closest_of_sphere(&self, s: &Sphere, p: DVec3) -> DVec3 {
        let m = &self.to_world;
        if self.similarity.is_some() {
            m.transform_point3(s.closest(self.to_local.transform_point3(p)))
        } else {
            ellipsoid::closest(m.transform_point3(s.center()), &(m.matrix3 * s.radius()), p)
        }
    }
}

impl Shape {
    fn bounds(&self, m: &DAffine3) -> Bounds {
        match self {
            Shape::Sphere(s) => s.bounds(m),
            Shape::Cuboid(c) => c.bounds(m),
            Shape::Quad(q) => q.bounds(m),
            Shape::Disk(d) => d.bounds(m),
            Shape::Cylinder(c) => c.bounds(m),
            Shape::Lathe(l) => l.bounds(m),
            Shape::Mesh(mesh) => mesh.bounds().transformed(m),
        }
    }
}
