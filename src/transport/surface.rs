//! A place where a walk meets a surface.

use crate::math::{DVec3, Ray, Rgb};
use crate::scene::Inside;
use crate::scene::description::Caustics;
use crate::surface::{Bsdf, Incidence, Nature, Onward};

/// What happened to light, or to an eye path, at a vertex.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Event {
    /// It passed a sheet in the direction it had.
    Passed,
    /// It was refracted by a smooth boundary.
    Refracted,
    /// It was mirrored.
    Mirrored,
    /// It was scattered into one of few directions.
    Narrow,
    /// It was scattered into one of many directions.
    Scattered,
}

impl Event {
    /// Whether it left in the one other direction that there was, or in one of few.
    pub fn bends(self) -> bool {
        matches!(self, Event::Refracted | Event::Mirrored | Event::Narrow)
    }
}

/// A surface that does something to light, and what is around it.
#[derive(Clone, Debug)]
pub struct Interaction {
    /// The point on the surface.
    pub point: DVec3,
    /// From where light, or an eye path, meets it.
    pub incidence: Incidence,
    /// How far along the ray it is.
    pub t: f64,
    /// What the surface does with light from there.
    pub bsdf: Bsdf,
    /// Which caustics it has to do with.
    pub caustics: Caustics,
    /// New rays start so far off the surface.
    pub(super) offset: f64,
    /// The solids on the side of arrival.
    pub(super) before: Inside,
    /// The solids beyond.
    pub(super) after: Inside,
}

impl Interaction {
    /// A ray that leaves along `direction`, and the solids around its start.
    #[inline]
    pub fn departure(&self, direction: DVec3) -> (Ray, Inside) {
        let normal = self.incidence.normal;
        let offset = if direction.dot(normal) >= 0.0 { self.offset } else { -self.offset };
        (Ray::new(self.point + offset * normal, direction), self.around(direction).clone())
    }

    /// What happened to what went on so.
    #[inline]
    pub fn event(&self, onward: &Onward) -> Event {
        match onward.density > 0.0 {
            true if self.bsdf.nature() == Nature::Narrow => Event::Narrow,
            true => Event::Scattered,
            false if self.is_passed_along(onward.direction) => Event::Passed,
            false if onward.direction.dot(self.incidence.normal) < 0.0 => Event::Refracted,
            false => Event::Mirrored,
        }
    }

    /// Whether what leaves along `direction` has passed straight through a sheet.
    #[inline]
    pub fn is_passed_along(&self, direction: DVec3) -> bool {
        self.bsdf.is_sheet() && direction.dot(self.incidence.normal) < 0.0
    }

    /// What passes straight through, if it is a sheet: by channel.
    #[inline]
    pub fn sheet(&self) -> Option<Rgb> {
        let straight = self.bsdf.straight(&self.incidence).filter(|_| self.bsdf.is_sheet())?;
        Some(straight.passed)
    }

    /// The solids on the side that `direction` points to.
    #[inline]
    pub fn around(&self, direction: DVec3) -> &Inside {
        if direction.dot(self.incidence.normal) >= 0.0 { &self.before } else { &self.after }
    }
}
