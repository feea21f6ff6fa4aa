//! What a photon remembers of its way: decides whether it is stored.

use crate::surface::Nature;
use crate::transport::{Event, Interaction, Vertex};

/// How light has come since it left its source.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Since {
    /// Straight, through sheets at most.
    Straight,
    /// By refraction at smooth boundaries, and no other event but these.
    Refracted,
    /// By any other way.
    Other,
}

/// The way of a photon to where it is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct History {
    /// Whether it comes from a light, not from a glowing medium.
    pub from_light: bool,
    /// The events on the way.
    pub since: Since,
    /// Whether it was mirrored or refracted, smoothly or by narrow lobes,
    bent: bool,
    /// by what casts no caustics,
    uncast: bool,
    /// or scattered.
    scattered: bool,
}

impl History {
    /// Of a photon that sets out from its source.
    pub fn new(from_light: bool) -> Self {
        History { from_light, since: Since::Straight, bent: false, uncast: false, scattered: false }
    }

    /// This way with one more event, at a vertex.
    pub fn after(self, event: Event, at: &Vertex<'_>) -> Self {
        let since = match event {
            Event::Passed => self.since,
            Event::Refracted if self.since != Since::Other => Since::Refracted,
            _ => Since::Other,
        };
        History {
            since,
            bent: self.bent || event.bends(),
            uncast: self.uncast || event.bends() && !at.casts_caustics(),
            scattered: self.scattered || event == Event::Scattered,
            ..self
        }
    }

    /// This way with one more collision in a medium.
    pub fn scattered(self) -> Self {
        History { since: Since::Other, scattered: true, ..self }
    }

    /// Whether it was scattered.
    pub fn is_scattered(self) -> bool {
        self.scattered
    }

    /// Whether it can be of no caustic any more: it was scattered, or bent by what casts none.
    pub fn ends_caustics(self) -> bool {
        self.scattered || self.uncast
    }

    /// Whether it is of a caustic that is left out where it lands: what the surface mirrors or lets pass goes on, but nothing is spread.
    pub fn is_left_out(self, at: &Interaction) -> bool {
        self.is_caustic() && (self.uncast || !at.caustics.receives) && at.bsdf.nature() == Nature::Diffuse
    }

    /// Whether it is light of a caustic, where it lands on a surface that spreads it: from a light, mirrored or refracted, smoothly or by
    /// narrow lobes, and not scattered.
    pub fn is_caustic(self) -> bool {
        self.from_light && self.bent && !self.scattered
    }
}
