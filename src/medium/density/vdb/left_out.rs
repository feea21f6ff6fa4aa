//! Stands for what blocks are packed with, in builds without the feature `vdb`.

use super::cursor::Parse;

pub(super) struct Inflate;

impl Inflate {
    pub fn new() -> Self {
        Inflate
    }

    pub fn unpack(&mut self, _: &[u8], _: &mut [u8]) -> Parse<()> {
        Err(super::left_out())
    }
}

pub(super) fn unpack_lz4(_: &[u8], _: &mut [u8]) -> Parse<usize> {
    Err(super::left_out())
}
