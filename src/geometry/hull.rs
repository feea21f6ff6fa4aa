//! Balls and boxes after any transform: solids simple enough to tell which part of a disc lies within them.

use super::{Geometry, Placed, Shape};
use crate::math::{DAffine3, DMat3, DVec3};

/// What a hull is in coordinates of its own.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum HullKind {
    /// The unit ball.
    Ball,
    /// The cube [−1, 1]³.
    Cube,
}

/// An ellipsoid or a parallelepiped.
#[derive(Clone, Copy, Debug)]
pub struct Hull {
    /// Which.
    pub kind: HullKind,
    /// From the world to its coordinates.
    pub to_unit: DAffine3,
    /// The distance of its faces from its middle, the least of three: the radius of a ball, half the edge of a cube.
    pub size: f64,
}

impl Hull {
    /// `unit` takes the unit ball or the cube to the object's space.
    fn new(kind: HullKind, placed: &Placed, unit: DAffine3) -> Hull {
        let to_unit = (*placed.to_world() * unit).inverse();
        let rows = to_unit.matrix3.transpose();
        let steepest = [rows.x_axis, rows.y_axis, rows.z_axis].map(|row| row.length()).into_iter().fold(0.0, f64::max);
        Hull { kind, to_unit, size: 1.0 / steepest }
    }

    /// Whether it contains a point.
    pub fn contains(&self, p: DVec3) -> bool {
        let p = self.to_unit.transform_point3(p);
        match self.kind {
            HullKind::Ball => p.length_squared() <= 1.0,
            HullKind::Cube => p.abs().max_element() <= 1.0,
        }
    }

    /// How far it is from a point within to its surface.
    pub fn exit(&self, from: DVec3, direction: DVec3) -> f64 {
        let (p, d) = (self.to_unit.transform_point3(from), self.to_unit.transform_vector3(direction));
        match self.kind {
            HullKind::Ball => {
                let (a, b, c) = (d.length_squared(), p.dot(d), p.length_squared() - 1.0);
                ((b * b - a * c).max(0.0).sqrt() - b) / a
            }
            HullKind::Cube => {
                let along = |p: f64, d: f64| if d == 0.0 { f64::INFINITY } else { (1.0 - p * d.signum()) / d.abs() };
                along(p.x, d.x).min(along(p.y, d.y)).min(along(p.z, d.z))
            }
        }
        .max(0.0)
    }
}

impl Geometry {
    /// The hull that a shape is, if it is one.
    pub fn hull(&self, id: u32) -> Option<Hull> {
        let placed = &self.placed[id as usize];
        match placed.shape() {
            Shape::Sphere(sphere) => {
                let scale = DMat3::from_diagonal(DVec3::splat(sphere.radius()));
                let unit = DAffine3 { matrix3: scale, translation: sphere.center() };
                Some(Hull::new(HullKind::Ball, placed, unit))
            }
            Shape::Cuboid(cuboid) => {
                let bounds = cuboid.bounds(&DAffine3::IDENTITY);
                let unit =
                    DAffine3 { matrix3: DMat3::from_diagonal(0.5 * bounds.size()), translation: bounds.center() };
                Some(Hull::new(HullKind::Cube, placed, unit))
            }
            _ => None,
        }
    }
}
