//! `volpm render --frames`: a scene whose files, and whose pictures, have a number in their names.

use std::ops::RangeInclusive;
use std::path::{Path, PathBuf};

use crate::scene;
use crate::scene::description::Description;
use crate::{Error, Result};

/// What stands for a frame's number in the name of a file: as many digits at least.
const PLACE: char = '#';

/// A file's name with the frame's number for each run of `#`, filled up with zeros: `smoke_####.vdb` is `smoke_0012.vdb`. Folders stay as they are.
pub fn numbered(path: &Path, frame: u32) -> PathBuf {
    let Some(name) = path.file_name().and_then(|name| name.to_str()) else { return path.to_owned() };
    let mut text = String::with_capacity(name.len());
    let mut rest = name;
    while let Some(at) = rest.find(PLACE) {
        let end = rest[at..].find(|c| c != PLACE).map_or(rest.len(), |length| at + length);
        text += &rest[..at];
        text += &format!("{frame:0width$}", width = end - at);
        rest = &rest[end..];
    }
    path.with_file_name(text + rest)
}

/// Whether a file has a name of its own for each frame.
fn varies(path: &Path) -> bool {
    numbered(path, 0) != path
}

/// The scene of a frame.
pub fn number(description: &mut Description, frame: u32) {
    for file in description.files_mut() {
        *file = numbered(file, frame);
    }
}

/// Checks, before anything is computed, that frames can differ, that their files are there, and that none overwrites another's.
///
/// # Errors
/// [`Error::Usage`], and those of reading the scene.
pub fn check<'p>(
    frames: &RangeInclusive<u32>,
    (scene, overrides): (&Path, &[String]),
    outputs: impl IntoIterator<Item = &'p PathBuf>,
) -> Result<()> {
    if let Some(output) = outputs.into_iter().find(|output| !varies(output)) {
        return Err(Error::Usage(format!(
            "{}: each of the --frames would overwrite it: put #### in its name, for the number",
            output.display()
        )));
    }
    let mut description = scene::read(scene, overrides)?;
    let files: Vec<&PathBuf> =
        description.files_mut().into_iter().map(|file| &*file).filter(|file| varies(file)).collect();
    if files.is_empty() {
        return Err(Error::Usage(format!(
            "{}: nothing in it changes over --frames: put #### in the name of a file, for the number",
            scene.display()
        )));
    }
    for frame in frames.clone() {
        let missing = files.iter().map(|file| numbered(file, frame)).find(|file| !file.exists());
        if let Some(file) = missing {
            return Err(Error::Usage(format!("{}: no such file, for frame {frame} of --frames", file.display())));
        }
    }
    Ok(())
}
