//! Files that appear whole or not at all: written beside their place under a temporary name, then renamed.

use std::fs::{self, File};
use std::io::{BufWriter, ErrorKind, Write};
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, anyhow, bail};
use clerestory_transport::archive::beside::{followed, temporary};

/// Endings of files that tell what they hold: scenes and what they are made of, pictures, profiles of lamps, bakes, looks, wishes and
/// tables.
const KNOWN_ENDINGS: [&str; 17] = [
    "gltf",
    "glb",
    "bin",
    "exr",
    "hdr",
    "png",
    "jpg",
    "jpeg",
    "webp",
    "ktx2",
    "ies",
    "ldt",
    "transport",
    "part",
    "look",
    "json",
    "csv",
];

/// A file on its way: the place is known to be writable, nothing is there yet. Dropped before
/// [`PendingFile::commit`] it leaves nothing behind.
#[derive(Debug)]
pub struct PendingFile {
    path: PathBuf,
    /// What the path leads to where it is a symbolic link, else the path itself.
    target: PathBuf,
    temporary: PathBuf,
    file: Option<File>,
}

impl PendingFile {
    /// Reserves a place; what stands there stays until [`PendingFile::commit`]. Where the path is a symbolic link, the place is what it
    /// leads to.
    ///
    /// # Errors
    /// If the folder is missing or not writable, the name is too long, a folder, a device, a pipe or a file of another kind behind a link
    /// stands in the way, or `-` is named, which elsewhere means stdout.
    pub fn create(path: &Path) -> Result<PendingFile> {
        if path.as_os_str() == "-" {
            bail!("cannot write to stdout, as - means elsewhere; name a file (./- for one that is called -)");
        }
        let target = followed(path).with_context(|| format!("cannot write {}", path.display()))?;
        if target.file_name().is_none() || ends_in_separator(&target) {
            bail!("cannot write {}: it names no file; add a file name", path.display());
        }
        if path.is_dir() {
            bail!("cannot write {}: it is a folder; add a file name", path.display());
        }
        // A file would take the place of a device, and who reads a pipe would wait for ever.
        if target.metadata().is_ok_and(|there| !there.is_file()) {
            bail!("cannot write {}: it is a device or a pipe; name a file", path.display());
        }
        // A link with another ending, or none, is called as its user likes: it tells nothing of what is written.
        let own = ending_of(path);
        if target != path && KNOWN_ENDINGS.contains(&own.as_str()) {
            spare_others(path, &[own.as_str()], |_| false)?;
        }
        let folder = target.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
        if !folder.is_dir() {
            bail!("cannot write {}: the folder {} does not exist; create it first", path.display(), folder.display());
        }
        // The temporary name is short.
        if target.symlink_metadata().is_err_and(|error| error.kind() == ErrorKind::InvalidFilename) {
            bail!("cannot write {}: its name is too long for the system; give a shorter one", path.display());
        }
        let (temporary, file) = temporary(&target).map_err(|error| unplaced(path, folder, error))?;
        Ok(PendingFile { path: path.to_path_buf(), target, temporary, file: Some(file) })
    }

    /// Writes the contents through `write` and puts the file in its place.
    ///
    /// # Errors
    /// If anything cannot be written (a full disk, for instance); the partial file is gone then.
    pub fn commit(mut self, write: impl FnOnce(&mut BufWriter<File>) -> Result<()>) -> Result<()> {
        let path = self.path.display().to_string();
        let file = self.file.take().expect("only commit takes the file, and it consumes the place");
        let mut writer = BufWriter::new(file);
        write(&mut writer).map_err(|error| unwritten(&path, error))?;
        let kept = (|| {
            let file = writer.into_inner().map_err(std::io::IntoInnerError::into_error)?;
            file.sync_all()?;
            drop(file);
            fs::rename(&self.temporary, &self.target)
        })();
        kept.map_err(|error| unwritten(&path, error.into()))
    }
}

/// Why nothing can be put into a folder that is there. Some, such as `/proc`, take no new files: the system says then that something is
/// missing.
fn unplaced(path: &Path, folder: &Path, error: std::io::Error) -> anyhow::Error {
    let path = path.display();
    if error.kind() == ErrorKind::NotFound {
        return anyhow!("cannot write {path}: the folder {} takes no files; choose another one", folder.display());
    }
    anyhow::Error::new(error).context(format!("cannot write {path}: choose a folder that can be written"))
}

/// What went wrong with a file; the disk is suspected where the system refused, not where the contents are at fault.
fn unwritten(path: &str, error: anyhow::Error) -> anyhow::Error {
    let is_system = error.chain().any(|cause| cause.is::<std::io::Error>());
    let remedy = if is_system { ": check that there is room on the disk" } else { "" };
    error.context(format!("cannot write {path}{remedy}"))
}

impl Drop for PendingFile {
    fn drop(&mut self) {
        // After a rename there is nothing left under this name; before it there is nothing worth keeping.
        drop(self.file.take());
        let _ = fs::remove_file(&self.temporary);
    }
}

/// Whether a path is written as that of a folder.
pub fn ends_in_separator(path: &Path) -> bool {
    path.as_os_str().to_string_lossy().ends_with(std::path::is_separator)
}

/// Writes a whole file, or leaves what was there.
///
/// # Errors
/// As [`PendingFile::create`] and [`PendingFile::commit`].
pub fn write_whole(path: &Path, bytes: &[u8]) -> Result<()> {
    PendingFile::create(path)?.commit(|writer| Ok(writer.write_all(bytes)?))
}

/// Refuses an output that would take the place of an input, under any of its names. Inputs are what they are called and
/// where they are.
///
/// # Errors
/// Names both.
pub fn spare_inputs<'a>(output: &Path, inputs: impl IntoIterator<Item = (&'static str, &'a Path)>) -> Result<()> {
    for (what, input) in inputs {
        if is_same_file(output, input) {
            bail!("{} would overwrite the {what} {}; give the output another name", output.display(), input.display());
        }
    }
    Ok(())
}

/// Refuses an output that is there already and of another kind than what is written, by its ending or that of the file which a link
/// leads to: a slip of the finger costs no scene and no picture. `own` are the endings of what is written, without the dot, and
/// `is_own` says of a file with another ending whether it holds such a thing nevertheless. Files with endings that nothing is known by
/// are replaced.
///
/// # Errors
/// Names the file and the endings.
pub fn spare_others(output: &Path, own: &[&str], is_own: impl Fn(&Path) -> bool) -> Result<()> {
    // A link that leads nowhere leads to no other file.
    let behind = followed(output).unwrap_or_else(|_| output.to_path_buf());
    for place in [output, behind.as_path()] {
        let ending = ending_of(place);
        let is_other = KNOWN_ENDINGS.contains(&ending.as_str()) && !own.contains(&ending.as_str());
        if is_other && place.is_file() && !is_own(place) {
            let own: Vec<String> = own.iter().map(|ending| format!(".{ending}")).collect();
            bail!(
                "cannot write {}: {} is there already and is no {} file; give the output another name",
                output.display(),
                place.display(),
                own.join(" or ")
            );
        }
    }
    Ok(())
}

/// The ending of a name in small letters, without the dot.
fn ending_of(path: &Path) -> String {
    path.extension().map(|ending| ending.to_string_lossy().to_lowercase()).unwrap_or_default()
}

/// Whether two paths lead to one file, through links of either kind; false where there is none.
pub fn is_same_file(a: &Path, b: &Path) -> bool {
    if let (Ok(a), Ok(b)) = (a.canonicalize(), b.canonicalize())
        && a == b
    {
        return true;
    }
    #[cfg(unix)]
    {
        use std::os::unix::fs::MetadataExt;
        let id = |path: &Path| fs::metadata(path).map(|meta| (meta.dev(), meta.ino())).ok();
        id(a).is_some_and(|of_a| id(b) == Some(of_a))
    }
    #[cfg(not(unix))]
    false
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(folder: &Path) -> Vec<String> {
        fs::read_dir(folder).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap()).collect()
    }

    #[test]
    fn a_failed_write_keeps_the_old_file_and_leaves_no_other() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.look");
        write_whole(&path, b"old").unwrap();
        let failed = PendingFile::create(&path).unwrap().commit(|writer| {
            writer.write_all(b"half")?;
            bail!("no room")
        });
        assert!(failed.is_err());
        assert_eq!(fs::read(&path).unwrap(), b"old");
        assert_eq!(names(folder.path()), ["a.look"]);
    }

    #[test]
    fn of_two_files_on_their_way_to_one_place_each_is_whole() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.png");
        let [first, second] = [(); 2].map(|()| PendingFile::create(&path).unwrap());
        second.commit(|writer| Ok(writer.write_all(b"the second")?)).unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"the second");
        first.commit(|writer| Ok(writer.write_all(b"1st")?)).unwrap();
        assert_eq!((fs::read(&path).unwrap(), names(folder.path())), (b"1st".to_vec(), vec!["a.png".into()]));
    }

    #[test]
    fn an_input_is_spared_under_all_its_names() {
        let folder = tempfile::tempdir().unwrap();
        let (input, other) = (folder.path().join("a.glb"), folder.path().join("b.glb"));
        fs::write(&input, b"scene").unwrap();
        fs::write(&other, b"scene").unwrap();
        let mut names = vec![input.clone(), folder.path().join(".").join("a.glb")];
        #[cfg(unix)]
        {
            let (soft, hard) = (folder.path().join("soft"), folder.path().join("hard"));
            std::os::unix::fs::symlink(&input, &soft).unwrap();
            fs::hard_link(&input, &hard).unwrap();
            names.extend([soft, hard]);
        }
        for name in names {
            let said = spare_inputs(&name, [("scene", input.as_path())]).unwrap_err().to_string();
            assert!(said.contains("would overwrite the scene"), "{said}");
        }
        for free in [other, folder.path().join("none.glb")] {
            spare_inputs(&free, [("scene", input.as_path())]).unwrap();
        }
        spare_inputs(&input, [("look", folder.path().join("none.look").as_path())]).unwrap();
    }

    #[test]
    fn a_file_of_another_kind_is_spared_and_one_of_no_known_kind_is_not() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        for name in ["a.glb", "a.PNG", "a.csv", "a.CSV", "a.dat", "a"] {
            fs::write(at(name), b"old").unwrap();
        }
        for name in ["a.glb", "a.PNG"] {
            let said = spare_others(&at(name), &["csv"], |_| false).unwrap_err().to_string();
            assert!(said.contains(name) && said.contains("is no .csv file"), "{said}");
        }
        for name in ["a.csv", "a.CSV", "a.dat", "a", "none.glb"] {
            spare_others(&at(name), &["csv"], |_| false).unwrap();
        }
        spare_others(&at("a.PNG"), &["csv"], |file| fs::read(file).unwrap() == b"old").unwrap();
        spare_others(&at("a.PNG"), &["csv"], |file| fs::read(file).unwrap() == b"new").unwrap_err();
        #[cfg(unix)]
        {
            std::os::unix::fs::symlink("a.glb", at("link.csv")).unwrap();
            let said = PendingFile::create(&at("link.csv")).unwrap_err().to_string();
            assert!(said.contains("a.glb is there already"), "{said}");
        }
    }

    #[cfg(unix)]
    #[test]
    fn what_a_link_leads_to_is_written_and_keeps_its_permissions() {
        use std::os::unix::fs::{PermissionsExt, symlink};
        let folder = tempfile::tempdir().unwrap();
        let (link, target) = (folder.path().join("a.look"), folder.path().join("big/b.look"));
        symlink("big/b.look", &link).unwrap();
        let missing = PendingFile::create(&link).unwrap_err().to_string();
        assert!(missing.contains("big does not exist"), "{missing}");
        fs::create_dir(folder.path().join("big")).unwrap();
        write_whole(&link, b"first").unwrap();
        assert_eq!((fs::read(&target).unwrap(), link.is_symlink()), (b"first".to_vec(), true));
        fs::set_permissions(&target, fs::Permissions::from_mode(0o600)).unwrap();
        write_whole(&link, b"second").unwrap();
        assert_eq!((fs::read(&target).unwrap(), link.is_symlink()), (b"second".to_vec(), true));
        assert_eq!(fs::metadata(&target).unwrap().permissions().mode() & 0o777, 0o600);
        assert_eq!(names(&folder.path().join("big")), ["b.look"]);
        // A link may be called as its user likes.
        symlink("b.look", folder.path().join("big/latest")).unwrap();
        write_whole(&folder.path().join("big/latest"), b"third").unwrap();
        assert_eq!(fs::read(&target).unwrap(), b"third");
        symlink("loop", folder.path().join("loop")).unwrap();
        assert!(PendingFile::create(&folder.path().join("loop")).is_err());
    }

    #[cfg(unix)]
    #[test]
    fn a_device_or_a_pipe_keeps_its_place() {
        let folder = tempfile::tempdir().unwrap();
        let (pipe, link) = (folder.path().join("a.csv"), folder.path().join("b.csv"));
        assert!(std::process::Command::new("mkfifo").arg(&pipe).status().unwrap().success());
        std::os::unix::fs::symlink("/dev/null", &link).unwrap();
        for output in [pipe.as_path(), link.as_path(), Path::new("/dev/null")] {
            let said = PendingFile::create(output).unwrap_err().to_string();
            assert!(said.contains("it is a device or a pipe; name a file"), "{said}");
        }
        assert_eq!(names(folder.path()).len(), 2);
    }

    #[test]
    fn a_name_may_be_as_long_as_the_system_takes_it() {
        let folder = tempfile::tempdir().unwrap();
        let long = |n: usize| folder.path().join("a".repeat(n - 4) + ".png");
        write_whole(&long(255), b"whole").unwrap();
        assert_eq!(fs::read(long(255)).unwrap(), b"whole");
        let said = PendingFile::create(&long(256)).unwrap_err().to_string();
        assert!(said.contains("give a shorter one") && !said.contains("folder that can"), "{said}");
        assert_eq!(names(folder.path()).len(), 1);
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn a_folder_that_takes_no_files_is_not_told_as_missing() {
        let said = crate::words::in_words(&PendingFile::create(Path::new("/proc/x.png")).unwrap_err());
        assert!(!said.contains("No such file"), "{said}");
        assert!(said.contains("cannot write /proc/x.png") && said.contains("choose a"), "{said}");
    }

    #[test]
    fn missing_folders_and_folders_in_the_way_are_named() {
        let folder = tempfile::tempdir().unwrap();
        let missing = PendingFile::create(&folder.path().join("none/a.exr")).unwrap_err().to_string();
        assert!(missing.contains("does not exist"), "{missing}");
        let in_the_way = PendingFile::create(folder.path()).unwrap_err().to_string();
        assert!(in_the_way.contains("is a folder"), "{in_the_way}");
        let stdout = PendingFile::create(Path::new("-")).unwrap_err().to_string();
        assert!(stdout.contains("cannot write to stdout") && !Path::new("-").exists(), "{stdout}");
        PendingFile::create(&folder.path().join("-")).unwrap();
        let unnamed = PendingFile::create(&folder.path().join("none/")).unwrap_err().to_string();
        assert!(unnamed.contains("names no file"), "{unnamed}");
    }
}
