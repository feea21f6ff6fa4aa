//! What blocks are packed with.

use super::cursor::Parse;
use flate2::{Decompress, FlushDecompress, Status};

/// Unpacks streams of zlib; keeps its state from one to the next.
pub(super) struct Inflate(Decompress);

impl Inflate {
    pub fn new() -> Self {
        Inflate(Decompress::new(true))
    }

    /// Fills all of `out`.
    pub fn unpack(&mut self, packed: &[u8], out: &mut [u8]) -> Parse<()> {
        let Inflate(inflate) = self;
        inflate.reset(true);
        let expected = out.len();
        let status = inflate
            .decompress(packed, out, FlushDecompress::Finish)
            .map_err(|error| format!("damaged deflate stream ({error})"))?;
        if status != Status::StreamEnd || inflate.total_out() != expected as u64 {
            return Err(format!("deflate stream does not hold the {expected} bytes expected"));
        }
        Ok(())
    }
}

/// Unpacks an LZ4 block into `out`; how many bytes it holds.
pub(super) fn unpack_lz4(packed: &[u8], out: &mut [u8]) -> Parse<usize> {
    lz4_flex::block::decompress_into(packed, out).map_err(|error| format!("damaged LZ4 stream ({error})"))
}
