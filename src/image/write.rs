//! Files that appear whole or not at all.

use std::fs::{self, File};
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};
use std::time::Duration;

use crate::{Error, Result};

/// Writes a file by `fill`, aside in the same folder, and renames it to `path` once it is on the disk:
/// whoever reads `path` sees the old contents or the new, never a part, and a failure leaves the
/// old as it was. An existing file keeps its permissions, a new one gets the usual ones; a link
/// keeps pointing at the file it points at.
///
/// Errors: [`Error::Output`].
pub fn write_aside(
    path: impl AsRef<Path>,
    fill: impl FnOnce(&mut BufWriter<&mut File>) -> io::Result<()>,
) -> Result<()> {
    let path = path.as_ref();
    check_target(path)?;
    // Renaming onto a link would replace the link; its target is meant.
    let target = fs::canonicalize(path).unwrap_or_else(|_| path.to_path_buf());
    replace(&target, fill).map_err(|error| Error::output(path, error))
}

/// Writes a file as [`write_aside`] does, but never in the place of another.
///
/// # Errors
/// [`Error::Usage`] where there is something at `path`, whatever it is; else [`Error::Output`].
pub fn write_new(path: impl AsRef<Path>, fill: impl FnOnce(&mut BufWriter<&mut File>) -> io::Result<()>) -> Result<()> {
    let path = path.as_ref();
    let exists =
        || Error::Usage(format!("{}: exists already, and is left as it is: name another file", path.display()));
    // A link that leads nowhere is something, too.
    if fs::symlink_metadata(path).is_ok() {
        return Err(exists());
    }
    check_target(path)?;
    let written = filled(path, fill).and_then(|aside| {
        aside.persist_noclobber(path).map_err(|error| error.error)?;
        sync_folder(path);
        Ok(())
    });
    written.map_err(|error| match error.kind() {
        io::ErrorKind::AlreadyExists => exists(),
        _ => Error::output(path, error),
    })
}

fn replace(target: &Path, fill: impl FnOnce(&mut BufWriter<&mut File>) -> io::Result<()>) -> io::Result<()> {
    filled(target, fill)?.persist(target).map_err(|error| error.error)?;
    sync_folder(target);
    Ok(())
}

/// A file aside `target`, filled and on the disk.
fn filled(
    target: &Path,
    fill: impl FnOnce(&mut BufWriter<&mut File>) -> io::Result<()>,
) -> io::Result<tempfile::NamedTempFile> {
    let mut aside = aside().tempfile_in(folder_of(target))?;
    let mut buffer = BufWriter::with_capacity(1 << 16, aside.as_file_mut());
    fill(&mut buffer)?;
    buffer.flush()?;
    drop(buffer);
    if let Ok(existing) = fs::metadata(target) {
        aside.as_file().set_permissions(existing.permissions())?;
    }
    aside.as_file().sync_all()?;
    Ok(aside)
}

/// Puts the name of a file on the disk, which is in its folder. Not every file system can do that, and the data is safe.
fn sync_folder(target: &Path) {
    #[cfg(unix)]
    if let Ok(folder) = File::open(folder_of(target)) {
        let _ = folder.sync_all();
    }
    #[cfg(not(unix))]
    let _ = target;
}

/// How files are named until they are whole.
const NAME: (&str, &str) = (".volpm-", ".part");
/// What was not written to for so long has been left behind.
const LEFT: Duration = Duration::from_secs(3600);

/// Removes from a folder what programs have left there that were killed while they wrote.
fn sweep(folder: &Path) {
    let Ok(entries) = fs::read_dir(folder) else { return };
    for entry in entries.flatten() {
        let name = entry.file_name();
        let is_part = name.to_str().is_some_and(|name| name.starts_with(NAME.0) && name.ends_with(NAME.1));
        let age = |file: fs::Metadata| if file.is_file() { file.modified().ok()?.elapsed().ok() } else { None };
        if is_part && entry.metadata().ok().and_then(age).is_some_and(|age| age > LEFT) {
            // Whoever may not remove it leaves it.
            let _ = fs::remove_file(entry.path());
        }
    }
}

fn aside() -> tempfile::Builder<'static, 'static> {
    let mut builder = tempfile::Builder::new();
    builder.prefix(NAME.0).suffix(NAME.1);
    // Temporary files are private by default; the process's umask still applies to this.
    #[cfg(unix)]
    builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
    builder
}

/// Checks before the work starts that a file could be written at `path`: its folder exists and takes
/// new files, and nothing but a file is in its place. What earlier programs have left there half-written is removed.
///
/// Errors: [`Error::Output`].
pub fn check_target(path: impl AsRef<Path>) -> Result<()> {
    let path = path.as_ref();
    if path.file_name().is_none() {
        return Err(Error::output(path, "a file name is expected"));
    }
    let folder = folder_of(path);
    match fs::metadata(&folder) {
        Ok(metadata) if metadata.is_dir() => {}
        Ok(_) => return Err(Error::output(path, format!("{} is not a folder", folder.display()))),
        Err(error) if error.kind() == io::ErrorKind::NotFound => {
            return Err(Error::output(path, format!("there is no folder {}; create it first", folder.display())));
        }
        Err(error) => return Err(Error::output(path, format!("{}: {error}", folder.display()))),
    }
    match fs::metadata(path) {
        Ok(metadata) if metadata.is_dir() => Err(Error::output(path, "this is a folder; name a file in it")),
        Ok(metadata) if !metadata.is_file() => Err(Error::output(path, "only a plain file can be replaced")),
        _ => match aside().tempfile_in(&folder) {
            Ok(_) => {
                sweep(&folder);
                Ok(())
            }
            Err(error) => {
                Err(Error::output(path, format!("the folder {} takes no new files: {error}", folder.display())))
            }
        },
    }
}

/// The folder `path` lies in.
fn folder_of(path: &Path) -> PathBuf {
    match path.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent.to_path_buf(),
        _ => PathBuf::from("."),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_failed_write_leaves_the_old_file_and_nothing_else() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("out.bin");
        // Of programs that were killed, an hour ago and just now.
        let [old, new] = ["a", "b"].map(|name| folder.path().join(format!(".volpm-{name}.part")));
        let hours = std::time::SystemTime::now() - 2 * LEFT;
        File::create(&old).unwrap().set_modified(hours).unwrap();
        File::create(&new).unwrap();
        check_target(&path).unwrap();
        assert!(!old.exists() && new.exists());
        fs::remove_file(new).unwrap();

        write_aside(&path, |file| file.write_all(b"old")).unwrap();
        let error = write_aside(&path, |file| {
            file.write_all(&[0; 1 << 20])?;
            Err(io::ErrorKind::StorageFull.into())
        });
        assert!(matches!(error, Err(Error::Output { .. })));
        assert_eq!(fs::read(&path).unwrap(), b"old");
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
        write_aside(&path, |file| file.write_all(b"new")).unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"new");
    }

    #[cfg(unix)]
    #[test]
    fn permissions_and_links_are_those_of_plain_files() {
        use std::os::unix::fs::PermissionsExt;
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        let mode = |name: &str| fs::metadata(at(name)).unwrap().permissions().mode() & 0o777;

        File::create(at("plain")).unwrap();
        write_aside(at("aside"), |file| file.write_all(b"1")).unwrap();
        assert_eq!(mode("aside"), mode("plain"));

        fs::set_permissions(at("aside"), fs::Permissions::from_mode(0o640)).unwrap();
        std::os::unix::fs::symlink(at("aside"), at("link")).unwrap();
        write_aside(at("link"), |file| file.write_all(b"2")).unwrap();
        assert!(fs::symlink_metadata(at("link")).unwrap().is_symlink());
        assert_eq!((fs::read(at("aside")).unwrap(), mode("aside")), (b"2".to_vec(), 0o640));
    }
}
