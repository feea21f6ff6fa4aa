//! What light and eye share: the walk from surface to surface through the media between, free
//! flights and transmittance, events at surfaces, and light that arrives straight from a light.

mod events;
mod flight;
mod glow;
mod light;
mod roulette;
mod walk;

pub use events::Events;
pub use flight::{Forced, Tally, draw, end, flight_density, fly, force, pass};
pub use glow::{Ember, Glows, Rival};
pub use light::{light_density, transmit, transmit_straight};
pub use roulette::{endures, survive};
pub use walk::{Crossing, Interaction, Onward, Reflection, Segment, Side, Stop, Visitor, Walk};
