//! Files that appear whole or not at all: written beside their place under a temporary name, then renamed.

use std::fs::{self, File};
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};
use clerestory_transport::archive::beside::temporary;

/// A file on its way: the place is known to be writable, nothing is there yet. Dropped before
/// [`PendingFile::commit`] it leaves nothing behind.
#[derive(Debug)]
pub struct PendingFile {
    path: PathBuf,
    temporary: PathBuf,
    file: Option<File>,
}

impl PendingFile {
    /// Reserves a place; what stands there stays until [`PendingFile::commit`].
    ///
    /// # Errors
    /// If the folder is missing or not writable, a folder stands in the way, or `-` is named, which elsewhere means stdout.
    pub fn create(path: &Path) -> Result<PendingFile> {
        if path.as_os_str() == "-" {
            bail!("cannot write to stdout, as - means elsewhere; name a file (./- for one that is called -)");
        }
        if path.file_name().is_none() || ends_in_separator(path) {
            bail!("cannot write {}: it names no file; add a file name", path.display());
        }
        if path.is_dir() {
            bail!("cannot write {}: it is a folder; add a file name", path.display());
        }
        let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
        if !folder.is_dir() {
            bail!("cannot write {}: the folder {} does not exist; create it first", path.display(), folder.display());
        }
        let (temporary, file) = temporary(path)
            .with_context(|| format!("cannot write {}: choose a folder that can be written", path.display()))?;
        Ok(PendingFile { path: path.to_path_buf(), temporary, file: Some(file) })
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
            fs::rename(&self.temporary, &self.path)
        })();
        kept.map_err(|error| unwritten(&path, error.into()))
    }
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

/// Whether two paths lead to one file, through links of either kind; false where there is none.
fn is_same_file(a: &Path, b: &Path) -> bool {
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
