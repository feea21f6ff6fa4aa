//! The text of a scene or study file.

use std::fs::File;
use std::io::Read as _;
use std::path::Path;

use crate::{Error, Result};

/// The largest scene file that is read, in bytes; instances by the hundred thousand fit.
const LARGEST_FILE: u64 = 64 << 20;

/// Reads a whole file.
///
/// # Errors
/// [`Error::Asset`] if it cannot be read, is larger than [`LARGEST_FILE`], or is no text.
pub(super) fn text_of(path: &Path) -> Result<String> {
    let failed = |error: std::io::Error| Error::asset(path, format!("cannot be read: {error}"));
    let file = File::open(path).map_err(failed)?;
    if file.metadata().map_err(failed)?.is_dir() {
        return Err(Error::asset(path, "is a folder; expected a scene file"));
    }
    let mut bytes = Vec::new();
    file.take(LARGEST_FILE + 1).read_to_end(&mut bytes).map_err(failed)?;
    if bytes.len() as u64 > LARGEST_FILE {
        return Err(Error::asset(path, format!("is larger than {} MiB; expected a scene file", LARGEST_FILE >> 20)));
    }
    String::from_utf8(bytes).map_err(|error| {
        let valid = &error.as_bytes()[..error.utf8_error().valid_up_to()];
        let line = valid.iter().filter(|&&byte| byte == b'\n').count() + 1;
        Error::asset(path, format!("is not UTF-8 text (line {line}); expected a scene file"))
    })
}
