//! Where a machine's costs are kept.

use std::env;
use std::fs;
use std::io::{ErrorKind, Write};
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use crate::image;
use crate::render::Costs;
use crate::{Error, Result};

/// The file, as it is written.
#[derive(Serialize, Deserialize)]
struct File {
    /// The program that measured: costs of another version are other costs.
    version: String,
    nanoseconds: Costs,
}

/// The variable that names the file.
const VARIABLE: &str = "VOLPM_COSTS";

/// The file: what [`VARIABLE`] says, else `volpm/costs.json` in the user's folder for configuration.
fn path() -> Option<PathBuf> {
    let set = |name: &str| env::var_os(name).filter(|value| !value.is_empty()).map(PathBuf::from);
    // The XDG Base Directory Specification.
    let folder = || set("XDG_CONFIG_HOME").filter(|folder| folder.is_absolute());
    let home = || set("HOME").or_else(|| set("USERPROFILE")).map(|home| home.join(".config"));
    set(VARIABLE).or_else(|| Some(folder().or_else(home)?.join("volpm/costs.json")))
}

/// The costs of this machine, if they were measured by this version.
///
/// # Errors
/// [`Error::Asset`] for a file that is none.
pub fn read() -> Result<Option<Costs>> {
    let Some(path) = path() else { return Ok(None) };
    let text = match fs::read_to_string(&path) {
        Ok(text) => text,
        Err(error) if error.kind() == ErrorKind::NotFound => return Ok(None),
        Err(error) => return Err(Error::asset(&path, error)),
    };
    let file: File = serde_json::from_str(&text).map_err(|error| {
        Error::asset(
            &path,
            format!("not costs that `volpm plan --calibrate` has written: {error}; remove it, or measure again"),
        )
    })?;
    Ok(Some(file.nanoseconds).filter(|_| file.version == env!("CARGO_PKG_VERSION")))
}

/// Where costs will be kept: a file that can be written, which is found out before they are measured.
///
/// # Errors
/// [`Error::Usage`] where there is no place for it; [`Error::Output`] where it cannot be written.
pub fn place() -> Result<PathBuf> {
    let path =
        path().ok_or_else(|| Error::Usage(format!("there is no home to keep costs in: say where by {VARIABLE}")))?;
    let cannot = |error: Error| match error {
        Error::Output { path, message } => Error::output(path, format!("{message}; {VARIABLE} may name another file")),
        error => error,
    };
    if let Some(folder) = path.parent() {
        fs::create_dir_all(folder).map_err(|error| cannot(Error::output(folder, error)))?;
    }
    image::check_target(&path).map_err(cannot)?;
    Ok(path)
}

/// Keeps costs in a file.
///
/// # Errors
/// [`Error::Output`] where they cannot be written.
pub fn write(costs: &Costs, path: &Path) -> Result<()> {
    let text = super::json(&File { version: env!("CARGO_PKG_VERSION").to_string(), nanoseconds: *costs })?;
    image::write_aside(path, |file| file.write_all(text.as_bytes()))
}
