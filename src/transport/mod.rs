//! What light and eye share: the walk from surface to surface through the media between, vertices and the journey from one
//! to the next, free flights and transmittance, and light asked for and met.
//!
//! - `journey` is the loop from vertex to vertex, for all kinds of travellers; `walk` goes from one surface to the next,
//!   segment by segment; `vertex` and `surface` are what is met there.
//! - `flight` draws collisions and transmittance, `shadow` what passes from a light, `roulette` who goes on.
//! - `ask` is next-event estimation: it draws lights, and forms the shares (multiple importance sampling) of light asked for
//!   and met; [`equiangular`] draws places for lights in media, `glow` points of glowing media. Eye paths ask in
//!   `render/eye/light.rs`.

mod ask;
mod balance;
pub mod equiangular;
mod events;
mod flight;
mod glow;
mod guide;
mod journey;
mod roulette;
mod segment;
mod shadow;
mod surface;
#[cfg(test)]
mod tests;
mod vertex;
mod walk;

pub use ask::{Asked, Turn};
pub use balance::balance;
pub use equiangular::{Flight, Landing};
pub use events::Events;
pub use flight::{Ahead, Forced, Tally, draw, end, flight_density, fly, force, pass};
pub use glow::{Ember, Glows, Rival};
pub use guide::{DirectionGuide, DirectionTable, direction_table};
pub use journey::{Heading, Luggage, Part, Parts, SAFETY_STOP, Traveller, travel};
pub use roulette::{endures, survive};
pub use segment::{Crossing, Segment};
pub use shadow::{ShadowRay, transmit, transmit_straight};
pub use surface::{Event, Interaction};
pub use vertex::{Collision, Vertex};
pub use walk::{Stop, Visitor, Walk, pass_by_chance};
