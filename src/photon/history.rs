//! What a photon remembers of its way: decides whether it is stored.

/// How light has come since it left its source.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Since {
    /// Straight.
    Straight,
    /// By refraction at smooth boundaries, and no other event.
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
}

impl History {
    /// Of a photon that sets out from its source.
    pub fn new(from_light: bool) -> Self {
        History { from_light, since: Since::Straight }
    }

    /// This way with one more event.
    pub fn after(self, refracted: bool) -> Self {
        let since = if refracted && self.since != Since::Other { Since::Refracted } else { Since::Other };
        History { since, ..self }
    }
}
