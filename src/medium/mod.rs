//! What fills space.

pub mod density;
