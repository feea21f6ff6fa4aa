//! Blocks of values: raw, deflated (zlib) or in a Blosc frame.

use super::cursor::{Cursor, Parse};
use super::packed::{Inflate, unpack_lz4};

pub(super) const ZIP: u32 = 1;
pub(super) const ACTIVE_MASK: u32 = 2;
pub(super) const BLOSC: u32 = 4;

/// Decodes blocks; keeps its buffers from one to the next.
pub(super) struct Decoder {
    inflate: Inflate,
    raw: Vec<u8>,
    shuffled: Vec<u8>,
}

impl Decoder {
    pub fn new() -> Self {
        Decoder { inflate: Inflate::new(), raw: Vec::new(), shuffled: Vec::new() }
    }

    /// Reads `out.len()` floats, stored as halves if `half`.
    pub fn read(&mut self, from: &mut Cursor, out: &mut [f32], half: bool, compression: u32) -> Parse<()> {
        // OpenVDB writes nothing at all, not even a length, for an empty array of halves.
        if half && out.is_empty() {
            return Ok(());
        }
        let size = if half { 2 } else { 4 };
        let bytes = self.read_bytes(from, size * out.len(), compression)?;
        if half {
            for (value, bytes) in out.iter_mut().zip(bytes.as_chunks::<2>().0) {
                *value = half::f16::from_le_bytes(*bytes).to_f32();
            }
        } else {
            for (value, bytes) in out.iter_mut().zip(bytes.as_chunks::<4>().0) {
                *value = f32::from_le_bytes(*bytes);
            }
        }
        Ok(())
    }

    fn read_bytes<'b, 'a: 'b>(
        &'b mut self,
        from: &mut Cursor<'a>,
        expected: usize,
        compression: u32,
    ) -> Parse<&'b [u8]> {
        if compression & (ZIP | BLOSC) == 0 {
            return from.take(expected, "a block of values");
        }
        let at = from.position();
        let length = from.i64("the length of a block of values")?;
        if length <= 0 {
            // Stored as it is, where compression did not pay.
            if length.unsigned_abs() != expected as u64 {
                return Err(format!(
                    "block of values at offset {at}: {} bytes stored, {expected} expected",
                    length.unsigned_abs()
                ));
            }
            return from.take(expected, "a block of values");
        }
        let length = usize::try_from(length).unwrap_or(usize::MAX);
        let packed = from.take(length, "a compressed block of values")?;
        self.raw.resize(expected, 0);
        let result = if compression & BLOSC != 0 {
            unpack_blosc(packed, &mut self.raw, &mut self.shuffled)
        } else {
            self.inflate.unpack(packed, &mut self.raw)
        };
        result.map_err(|message| format!("block of values at offset {at}: {message}"))?;
        Ok(&self.raw)
    }
}

/// Decodes a frame of Blosc 1 into all of `out`. The format is that of c-blosc's `README_CHUNK_FORMAT`.
///
/// A frame is a header of 16 bytes, the offsets of its blocks, and the blocks. A block is cut into as
/// many streams as a value has bytes, or left whole; each stream is LZ4 or, if as long as what it
/// stands for, raw. Within a block the first bytes of all values come first, then all second bytes.
fn unpack_blosc(frame: &[u8], out: &mut [u8], shuffled: &mut Vec<u8>) -> Parse<()> {
    const HEADER: usize = 16;
    const SHUFFLED: u8 = 0x01;
    const STORED: u8 = 0x02;
    const BIT_SHUFFLED: u8 = 0x04;
    const WHOLE_BLOCKS: u8 = 0x10;
    const LZ4: u8 = 1;

    let mut header = Cursor::new(frame, 0);
    let version = header.u8("a Blosc header")?;
    header.u8("a Blosc header")?;
    let flags = header.u8("a Blosc header")?;
    let value_size = header.u8("a Blosc header")? as usize;
    let unpacked = header.u32("a Blosc header")? as usize;
    let block_size = header.u32("a Blosc header")? as usize;
    let packed = header.u32("a Blosc header")? as usize;
    if !(1..=2).contains(&version) {
        return Err(format!("Blosc frame of version {version}, expected 1 or 2"));
    }
    if unpacked != out.len() || packed != frame.len() {
        return Err(format!(
            "Blosc frame says {unpacked} bytes packed into {packed}, expected {} in {}",
            out.len(),
            frame.len()
        ));
    }
    if flags & STORED != 0 {
        out.copy_from_slice(header.take(unpacked, "a stored Blosc frame")?);
        return Ok(());
    }
    if unpacked == 0 {
        return Ok(());
    }
    match flags >> 5 {
        LZ4 => {}
        codec => {
            let name = ["BloscLZ", "LZ4", "Snappy", "Zlib", "Zstd"].get(codec as usize).unwrap_or(&"an unknown codec");
            return Err(format!("Blosc frame packed with {name}; OpenVDB packs with LZ4, and only that is read"));
        }
    }
    if flags & BIT_SHUFFLED != 0 {
        return Err("Blosc frame with shuffled bits; OpenVDB shuffles bytes, and only that is read".to_string());
    }
    if value_size == 0 || block_size == 0 || block_size > unpacked {
        return Err(format!("Blosc frame with values of {value_size} bytes in blocks of {block_size}"));
    }

    let shuffle = flags & SHUFFLED != 0 && value_size > 1;
    let mut offsets = header;
    for out in out.chunks_mut(block_size) {
        let start = offsets.u32("the offsets of Blosc blocks")? as usize;
        let mut block = Cursor::new(frame, start.max(HEADER));
        // c-blosc's limits: at most 16 streams, none shorter than 128 bytes, the short last block whole.
        let split =
            flags & WHOLE_BLOCKS == 0 && value_size <= 16 && block_size / value_size >= 128 && out.len() == block_size;
        let stream_size = if split { block_size / value_size } else { out.len() };
        if split && !block_size.is_multiple_of(value_size) {
            return Err(format!("Blosc blocks of {block_size} bytes hold no whole number of {value_size}-byte values"));
        }
        shuffled.resize(out.len(), 0);
        let target: &mut [u8] = if shuffle { &mut shuffled[..] } else { &mut *out };
        for stream in target.chunks_mut(stream_size) {
            let length = block.u32("the length of a Blosc stream")? as usize;
            let packed = block.take(length, "a Blosc stream")?;
            if length == stream.len() {
                stream.copy_from_slice(packed);
            } else {
                let size = unpack_lz4(packed, stream)?;
                if size != stream.len() {
                    return Err(format!("LZ4 stream holds {size} bytes, {} expected", stream.len()));
                }
            }
        }
        if shuffle {
            let count = out.len() / value_size;
            for (i, value) in out.chunks_exact_mut(value_size).enumerate() {
                for (j, byte) in value.iter_mut().enumerate() {
                    *byte = shuffled[j * count + i];
                }
            }
            out[count * value_size..].copy_from_slice(&shuffled[count * value_size..]);
        }
    }
    Ok(())
}
