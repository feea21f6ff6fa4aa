//! A place in the bytes of a file; every read is checked against what is left.

/// What is wrong with a file; the caller adds which file.
pub(super) type Parse<T> = Result<T, String>;

/// Reads little-endian fields one after another.
#[derive(Clone)]
pub(super) struct Cursor<'a> {
    bytes: &'a [u8],
    at: usize,
}

impl<'a> Cursor<'a> {
    /// Starts at `at`, which may lie beyond the end: then every read fails.
    pub fn new(bytes: &'a [u8], at: usize) -> Self {
        Cursor { bytes, at }
    }

    /// The offset of the next byte in the file.
    pub fn position(&self) -> usize {
        self.at
    }

    /// The next `count` bytes; `what` names them in the error.
    pub fn take(&mut self, count: usize, what: &str) -> Parse<&'a [u8]> {
        let end = self.at.checked_add(count).filter(|end| *end <= self.bytes.len()).ok_or_else(|| {
            format!(
                "{what} needs {count} bytes at offset {}, but the data ends at {}: truncated or damaged",
                self.at,
                self.bytes.len()
            )
        })?;
        let bytes = &self.bytes[self.at..end];
        self.at = end;
        Ok(bytes)
    }

    fn array<const N: usize>(&mut self, what: &str) -> Parse<[u8; N]> {
        self.take(N, what).map(|bytes| std::array::from_fn(|i| bytes[i]))
    }

    pub fn u8(&mut self, what: &str) -> Parse<u8> {
        self.array::<1>(what).map(|[byte]| byte)
    }

    pub fn u32(&mut self, what: &str) -> Parse<u32> {
        self.array(what).map(u32::from_le_bytes)
    }

    pub fn i32(&mut self, what: &str) -> Parse<i32> {
        self.array(what).map(i32::from_le_bytes)
    }

    pub fn i64(&mut self, what: &str) -> Parse<i64> {
        self.array(what).map(i64::from_le_bytes)
    }

    pub fn f32(&mut self, what: &str) -> Parse<f32> {
        self.array(what).map(f32::from_le_bytes)
    }

    pub fn f64(&mut self, what: &str) -> Parse<f64> {
        self.array(what).map(f64::from_le_bytes)
    }

    pub fn coord(&mut self, what: &str) -> Parse<[i32; 3]> {
        Ok([self.i32(what)?, self.i32(what)?, self.i32(what)?])
    }

    /// A bit mask of `64 WORDS` bits.
    pub fn mask<const WORDS: usize>(&mut self, what: &str) -> Parse<Box<[u64; WORDS]>> {
        let bytes = self.take(8 * WORDS, what)?;
        let mut mask = Box::new([0; WORDS]);
        for (word, bytes) in mask.iter_mut().zip(bytes.as_chunks::<8>().0) {
            *word = u64::from_le_bytes(*bytes);
        }
        Ok(mask)
    }

    /// A string with its length before it; bytes that are not UTF-8 are replaced.
    pub fn string(&mut self, what: &str) -> Parse<String> {
        let length = self.u32(what)?;
        self.take(length as usize, what).map(|bytes| String::from_utf8_lossy(bytes).into_owned())
    }
}
