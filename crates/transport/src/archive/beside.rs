//! Names of files while they are written: beside their place, and each of one writer alone.
//!
//! Two editors may write to one place at the same time, and one editor twice. With a name in common the one would write into
//! what the other renames; so the last to end wins, with a whole file.

use std::ffi::OsString;
use std::fs::{File, OpenOptions, TryLockError};
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
        let mut temporary = OsString::from(".");
        temporary.push(name);
        temporary.push(format!(".{}-{n}.{ENDING}", std::process::id()));
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

/// Whether a file is what a killed program left of such a write; one that is being written is locked.
pub fn is_left_over(path: &Path) -> bool {
    let is_temporary = path.extension().is_some_and(|ending| ending == ENDING);
    is_temporary && File::open(path).is_ok_and(|file| !matches!(file.try_lock(), Err(TryLockError::WouldBlock)))
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
    }
}
