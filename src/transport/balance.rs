//! The balance heuristic (Veach and Guibas 1995).

/// The part of what was found with density `own` where `others` is the sum of all other densities.
pub fn balance(own: f64, others: f64) -> f64 {
    own / (own + others)
}
