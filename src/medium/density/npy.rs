//! NumPy's `.npy` files: arrays of density samples.
//!
//! The format is that of NumPy's `numpy/lib/format.py`: a magic string, the version, the length of a header,
//! the header — a Python dictionary with `descr`, `fortran_order` and `shape` — and the values.

use crate::error::{Error, Result};
use std::path::Path;

/// A three-dimensional array of floats.
#[derive(Clone, Debug, PartialEq)]
pub struct Array {
    /// Samples along x, y and z.
    pub dims: [usize; 3],
    /// The samples, x fastest: the array's indices are \[z\]\[y\]\[x\].
    pub values: Vec<f32>,
}

/// Reads the array in the file `path`.
///
/// # Errors
/// [`Error::Asset`] if the file cannot be read or holds anything but a C-ordered, three-dimensional,
/// little-endian float32 array of format version 1 to 3.
pub fn read(path: impl AsRef<Path>) -> Result<Array> {
    let path = path.as_ref();
    let bytes = std::fs::read(path).map_err(|error| Error::asset(path, format!("cannot be read: {error}")))?;
    parse(&bytes).map_err(|message| Error::asset(path, message))
}

fn parse(bytes: &[u8]) -> Result<Array, String> {
    let short = || format!("ends within its header, after {} bytes: truncated", bytes.len());

    // Magic and version; the header's length has two bytes in version 1, four in later ones.
    let Some(rest) = bytes.strip_prefix(b"\x93NUMPY") else {
        return Err("is not a NumPy array: it does not start with \"\\x93NUMPY\"".to_string());
    };
    let (&[major, _], rest) = rest.split_first_chunk().ok_or_else(short)?;
    let (length, rest) = match major {
        1 => rest.split_first_chunk().map(|(n, rest)| (u16::from_le_bytes(*n) as usize, rest)),
        2 | 3 => rest.split_first_chunk().map(|(n, rest)| (u32::from_le_bytes(*n) as usize, rest)),
        _ => return Err(format!("is a NumPy array of format version {major}, expected 1, 2 or 3")),
    }
    .ok_or_else(short)?;
    let (header, data) = rest.split_at_checked(length).ok_or_else(short)?;
    let header = String::from_utf8_lossy(header);

    // The dictionary.
    let field = |key: &str| {
        let (_, rest) = header.split_once(&format!("'{key}'")).or_else(|| header.split_once(&format!("\"{key}\"")))?;
        rest.trim_start().strip_prefix(':').map(str::trim_start)
    };
    let missing = |key: &str| format!("has a header without {key:?}: {}", header.trim_end());
    let kind = field("descr").ok_or_else(|| missing("descr"))?;
    let kind = kind.split([',', '}']).next().unwrap_or_default().trim();
    if kind.trim_matches(['\'', '"']) != "<f4" {
        return Err(format!("holds values of type {kind}, expected '<f4': save it with .astype('<f4')"));
    }
    let order = field("fortran_order").ok_or_else(|| missing("fortran_order"))?;
    if !order.starts_with("False") {
        return Err("is in Fortran order, expected C order: save it with numpy.ascontiguousarray".to_string());
    }
    let shape = field("shape").ok_or_else(|| missing("shape"))?;
    let shape = shape.strip_prefix('(').and_then(|shape| shape.split_once(')')).ok_or_else(|| missing("shape"))?.0;
    let sizes: Option<Vec<usize>> =
        shape.split(',').map(str::trim).filter(|size| !size.is_empty()).map(|size| size.parse().ok()).collect();
    let Some(&[nz, ny, nx]) = sizes.as_deref() else {
        return Err(format!("has the shape ({shape}), expected three dimensions [z][y][x]"));
    };

    if nx.min(ny).min(nz) == 0 {
        return Err(format!("has the shape ({shape}), which holds no values"));
    }

    // The values.
    let size = nz.checked_mul(ny).and_then(|n| n.checked_mul(nx)).and_then(|n| n.checked_mul(4));
    if size != Some(data.len()) {
        return Err(format!(
            "has the shape ({shape}) of 4-byte values but {} bytes of them: truncated or damaged",
            data.len()
        ));
    }
    let values = data.as_chunks::<4>().0.iter().map(|bytes| f32::from_le_bytes(*bytes)).collect();
    Ok(Array { dims: [nx, ny, nz], values })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn file(version: u8, header: &str, data: &[u8]) -> Vec<u8> {
        let mut bytes = b"\x93NUMPY".to_vec();
        bytes.extend([version, 0]);
        match version {
            1 => bytes.extend((header.len() as u16).to_le_bytes()),
            _ => bytes.extend((header.len() as u32).to_le_bytes()),
        }
        bytes.extend(header.as_bytes());
        bytes.extend(data);
        bytes
    }

    const HEADER: &str = "{'descr': '<f4', 'fortran_order': False, 'shape': (2, 1, 3), }      \n";

    #[test]
    fn values_and_sizes_come_in_order() {
        let data: Vec<u8> = (0..6).flat_map(|i| (i as f32).to_le_bytes()).collect();
        for version in 1..=3 {
            let array = parse(&file(version, HEADER, &data)).unwrap();
            assert_eq!(array, Array { dims: [3, 1, 2], values: vec![0.0, 1.0, 2.0, 3.0, 4.0, 5.0] });
        }
    }

    #[test]
    fn anything_else_is_refused_by_what_is_wrong() {
        let data = [0; 24];
        for (found, replaced, by) in [
            ("'<f8'", "<f4", "<f8"),
            ("'>f4'", "<f4", ">f4"),
            ("Fortran", "False", "True"),
            ("three dimensions", "(2, 1, 3)", "(6,)"),
            ("truncated", "(2, 1, 3)", "(2, 1, 4)"),
            ("truncated", "(2, 1, 3)", "(4294967296, 4294967296, 4294967296)"),
            ("truncated", "(2, 1, 3)", "(-2, 1, 3)"),
            ("shape", "'shape'", "'size'"),
        ] {
            let error = parse(&file(1, &HEADER.replace(replaced, by), &data)).unwrap_err();
            assert!(error.contains(found) || (by.contains('-') && error.contains("dimensions")), "{found}: {error}");
        }
        assert!(parse(&file(9, HEADER, &data)).unwrap_err().contains("version 9"));
        assert!(parse(b"text").unwrap_err().contains("not a NumPy array"));
    }

    #[test]
    fn every_truncation_is_an_error() {
        let whole = file(2, HEADER, &[0; 24]);
        for end in 0..whole.len() {
            assert!(parse(&whole[..end]).is_err());
        }
    }
}
