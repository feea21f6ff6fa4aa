//! What fills space.
pub mod phase;
