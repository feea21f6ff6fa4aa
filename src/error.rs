//! What can go wrong, sorted by who is at fault.

use std::fmt;
use std::path::{Path, PathBuf};

/// The result of everything in this crate that can fail.
pub type Result<T, E = Error> = std::result::Result<T, E>;

/// An error with a message for the person at the keyboard: it says where, what was found, what was
/// expected and, where possible, what to do.
#[derive(Debug)]
pub enum Error {
    /// The command line is wrong.
    Usage(String),
    /// The scene file is wrong. The message is complete: file, line, column, key, value, expectation.
    Scene(String),
    /// A file the scene or the command line names cannot be used: missing, malformed, of the wrong kind.
    Asset {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        message: String,
    },
    /// The request is well formed but exceeds what can be done (memory, sizes).
    Limit(String),
    /// Writing a result failed (full disk, permissions).
    Output {
        /// The file that could not be written.
        path: PathBuf,
        /// What went wrong.
        message: String,
    },
    /// The work was done, and what it found is not what was asked for. The message is complete.
    Failed(String),
    /// A scene was checked, and is not to be believed. The message is complete.
    Doubt(String),
    /// The user interrupted the work.
    Interrupted,
}

impl Error {
    /// An [`Error::Asset`] about `path`.
    pub fn asset(path: impl AsRef<Path>, message: impl fmt::Display) -> Self {
        Error::Asset { path: path.as_ref().to_path_buf(), message: message.to_string() }
    }

    /// An [`Error::Output`] about `path`.
    pub fn output(path: impl AsRef<Path>, message: impl fmt::Display) -> Self {
        Error::Output { path: path.as_ref().to_path_buf(), message: message.to_string() }
    }

    /// What a build that leaves out a feature says where that is asked for.
    pub(crate) fn left_out(what: &str, feature: &str) -> String {
        format!(
            "{what} cannot be used: this was built without the feature `{feature}` (cargo build --features {feature})"
        )
    }

    /// The process's exit status: 1 failed, 2 bad usage or bad input, 3 a scene that is not to be believed, 130 interrupted.
    pub fn exit_status(&self) -> u8 {
        match self {
            Error::Usage(_) | Error::Scene(_) | Error::Asset { .. } | Error::Limit(_) => 2,
            Error::Output { .. } | Error::Failed(_) => 1,
            Error::Doubt(_) => 3,
            Error::Interrupted => 130,
        }
    }
}

impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Error::Usage(message)
            | Error::Scene(message)
            | Error::Limit(message)
            | Error::Failed(message)
            | Error::Doubt(message) => f.write_str(message),
            Error::Asset { path, message } => write!(f, "{}: {message}", path.display()),
            Error::Output { path, message } => write!(f, "cannot write {}: {message}", path.display()),
            Error::Interrupted => f.write_str("interrupted"),
        }
    }
}

impl std::error::Error for Error {}
