//! Who hears of a comparison.

use crate::render::Progress;

/// Hears how far a comparison has come.
pub trait Watch: Progress {
    /// Something begins: a reference, or a run of a variant.
    fn begins(&self, what: &str);
}
