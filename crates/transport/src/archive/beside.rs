//! Names of files while they are written: beside their place, and each of one writer alone.
//!
//! Two editors may write to one place at the same time, and one editor twice. With a name in common the one would write into
//! what the other renames; so the last to end wins, with a whole file.

use std::ffi::{OsStr, OsString};
use std::fs::{self, File, OpenOptions, TryLockError};
use std::io;
use std::path::{Path, PathBuf};

/// Ending of such names.
const ENDING: &str = "tmp";

/// A new file beside `path` that nobody else writes to, `.NAME.PROCESS-N.tmp`; locked by the operating system as long as it is open.
///
/// # Errors
/// If the folder is missing or cannot be written, or the path names no file.
pub fn temporary(path: &Path) -> io::Result<(PathBuf, File)> {
    let name = path.file_name().ok_or_else(|| io::Error::new(io::ErrorKind::InvalidInput, "it names no file"))?;
    for n in 0_u32.. {
        let mut temporary = own_prefix(name);
        temporary.push(format!("{n}.{ENDING}"));
        let temporary = path.with_file_name(temporary);
        match OpenOptions::new().write(true).create_new(true).open(&temporary) {
            // Another write of this process to the same place, or one that was killed.
            Err(error) if error.kind() == io::ErrorKind::AlreadyExists => {}
            Err(error) => return Err(error),
            Ok(file) => {
                // Where there are no locks, leftovers stay.
                let _ = file.try_lock();
                return Ok((temporary, file));
            }
        }
    }
    Err(io::Error::new(io::ErrorKind::AlreadyExists, "all temporary names are taken"))
}

/// The names of this process up to their number.
fn own_prefix(name: &OsStr) -> OsString {
    let mut prefix = OsString::from(".");
    prefix.push(name);
    prefix.push(format!(".{}-", std::process::id()));
    prefix
}

/// Removes what this process has begun to write beside `path`, where it ends without coming back to that.
pub fn discard(path: &Path) {
    let Some(prefix) = path.file_name().map(own_prefix) else { return };
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    for entry in fs::read_dir(folder).into_iter().flatten().flatten() {
        let is_own = entry.file_name().as_encoded_bytes().starts_with(prefix.as_encoded_bytes());
        if is_own && is_temporary(&entry.path()) {
            // What cannot be removed stays, as after a kill.
            let _ = fs::remove_file(entry.path());
        }
    }
}

fn is_temporary(path: &Path) -> bool {
    path.extension().is_some_and(|ending| ending == ENDING)
}

/// Whether a file is what a killed program left of such a write; one that is being written is locked.
pub fn is_left_over(path: &Path) -> bool {
    is_temporary(path) && File::open(path).is_ok_and(|file| is_free(&file.try_lock()))
}

/// Whether nobody writes to a file; where there are no locks somebody may.
fn is_free(lock: &Result<(), TryLockError>) -> bool {
    lock.is_ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_writer_has_a_file_of_its_own_and_only_what_nobody_writes_is_left_over() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.transport");
        let [(first, file), (second, other)] = [temporary(&path).unwrap(), temporary(&path).unwrap()];
        assert_ne!(first, second);
        assert!(!path.exists() && first.parent() == path.parent());
        assert!(!is_left_over(&first) && !is_left_over(&second), "they are being written");
        drop(file);
        assert!(is_left_over(&first) && !is_left_over(&second));
        drop(other);
        std::fs::write(&path, "").unwrap();
        assert!(!is_left_over(&path), "it is no temporary file");
        assert!(temporary(&folder.path().join("gone/a.transport")).is_err());
        let no_locks = TryLockError::Error(io::ErrorKind::Unsupported.into());
        assert!(!is_free(&Err(no_locks)), "somebody may write to it");
    }

    #[test]
    fn who_ends_in_the_middle_of_a_write_takes_its_own_files_away_and_no_other() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.transport");
        let begun = [temporary(&path).unwrap(), temporary(&path).unwrap()];
        let beside = temporary(&folder.path().join("b.transport")).unwrap();
        let others = ["a.transport", ".a.transport.x-0.tmp"].map(|name| folder.path().join(name));
        others.iter().for_each(|path| std::fs::write(path, "").unwrap());
        discard(&path);
        assert!(begun.iter().all(|(path, _)| !path.exists()));
        assert!(beside.0.exists() && others.iter().all(|path| path.exists()));
    }
}
