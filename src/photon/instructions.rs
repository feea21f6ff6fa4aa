//! Which instruction set a map's kernels use.

use std::fmt;

use super::PhotonMap;
use super::simd::Isa;

/// An instruction set that this machine has and kernels are compiled for. Results differ between them by roundings.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Instructions(Isa);

impl Instructions {
    /// All of them, the fastest first: maps use that unless told otherwise.
    pub fn available() -> Vec<Instructions> {
        Isa::available().into_iter().map(Instructions).collect()
    }
}

impl fmt::Display for Instructions {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.0.name())
    }
}

impl PhotonMap {
    /// From now on, queries use these instructions.
    pub fn use_instructions(&mut self, instructions: Instructions) {
        self.isa = instructions.0;
    }
}
