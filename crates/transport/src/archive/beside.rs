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
/// Most bytes of a name that such a name takes over: systems take 255 in all.
const MOST_NAME_BYTES: usize = 200;
/// Links that are followed one after another, as many as Linux does.
const MOST_LINKS: usize = 40;

/// The file that a path leads to through symbolic links, whether it is there or not. What is renamed to the name of a link takes the
/// place of the link, and the file behind it stays as it was.
///
/// # Errors
/// If there are more links than systems follow.
pub fn followed(path: &Path) -> io::Result<PathBuf> {
    let mut path = path.to_path_buf();
    for _ in 0..MOST_LINKS {
        // What cannot be read as a link is none.
        let Ok(target) = fs::read_link(&path) else { return Ok(path) };
        path = path.parent().unwrap_or(Path::new("")).join(target);
    }
    Err(io::Error::other("its links lead to each other, or are too many"))
}

/// A new file beside `path` that nobody else writes to, `.NAME.PROCESS-N.tmp`; locked by the operating system as long as it is open. It
/// may be read and written by whom the file at `path` may, if there is one.
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
                if let Err(error) = take_permissions(path, &file) {
                    drop(file);
                    let _ = fs::remove_file(&temporary);
                    return Err(error);
                }
                return Ok((temporary, file));
            }
        }
    }
    Err(io::Error::new(io::ErrorKind::AlreadyExists, "all temporary names are taken"))
}

/// Gives a file the permissions of the one whose place it will take.
#[cfg(unix)]
fn take_permissions(replaced: &Path, file: &File) -> io::Result<()> {
    use std::os::unix::fs::PermissionsExt;
    let mode_of = |of: &fs::Metadata| of.permissions().mode() & 0o777;
    let Ok(of) = fs::metadata(replaced) else { return Ok(()) };
    // Where a file system has none of its own, all files have the same.
    if !of.is_file() || mode_of(&file.metadata()?) == mode_of(&of) {
        return Ok(());
    }
    file.set_permissions(fs::Permissions::from_mode(mode_of(&of)))
}

/// Who may read and write a file is a matter of its folder here.
#[cfg(not(unix))]
fn take_permissions(_: &Path, _: &File) -> io::Result<()> {
    Ok(())
}

/// The names of this process up to their number.
fn own_prefix(name: &OsStr) -> OsString {
    let mut prefix = OsString::from(".");
    if name.len() > MOST_NAME_BYTES {
        let name = name.to_string_lossy();
        prefix.push(&name[..name.floor_char_boundary(MOST_NAME_BYTES)]);
    } else {
        prefix.push(name);
    }
    prefix.push(format!(".{}-", std::process::id()));
    prefix
}

/// Removes what this process has begun to write beside the file that `path` leads to, where it ends without coming back to that.
pub fn discard(path: &Path) {
    let Ok(path) = followed(path) else { return };
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
    fn a_long_name_leaves_room_for_that_of_a_temporary_file() {
        let folder = tempfile::tempdir().unwrap();
        for name in ["a".repeat(255), "ä".repeat(127)] {
            let path = folder.path().join(name);
            let (begun, _file) = temporary(&path).unwrap();
            std::fs::rename(&begun, &path).unwrap();
            let (begun, _file) = temporary(&path).unwrap();
            discard(&path);
            assert!(path.exists() && !begun.exists());
        }
    }

    #[cfg(unix)]
    #[test]
    fn links_are_followed_to_a_file_that_may_not_be_there() {
        use std::os::unix::fs::symlink;
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        std::fs::create_dir(at("big")).unwrap();
        symlink("big/second", at("first")).unwrap();
        symlink("../b.transport", at("big/second")).unwrap();
        symlink(at("loop"), at("loop")).unwrap();
        assert_eq!(followed(&at("a.transport")).unwrap(), at("a.transport"));
        assert_eq!(followed(&at("first")).unwrap(), at("big/../b.transport"));
        assert!(followed(&at("loop")).unwrap_err().to_string().contains("links"));
        let (begun, _file) = temporary(&followed(&at("first")).unwrap()).unwrap();
        discard(&at("first"));
        assert!(!begun.exists());
    }

    #[cfg(unix)]
    #[test]
    fn what_takes_the_place_of_a_file_may_be_read_by_whom_that_may() {
        use std::os::unix::fs::PermissionsExt;
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.transport");
        std::fs::write(&path, "").unwrap();
        for mode in [0o600, 0o640, 0o666] {
            std::fs::set_permissions(&path, std::fs::Permissions::from_mode(mode)).unwrap();
            let (_, file) = temporary(&path).unwrap();
            assert_eq!(file.metadata().unwrap().permissions().mode() & 0o777, mode);
        }
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
