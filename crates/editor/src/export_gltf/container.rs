//! GLB chunks, and the files that a glTF refers to.

use std::io::{ErrorKind, Write};
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};
use clerestory_transport::import::named_file;

use super::raw::{Document, PROFILES};
use crate::output::{PendingFile, write_whole};

const MAGIC: u32 = 0x4654_6C67;
const JSON: u32 = 0x4E4F_534A;
/// Kind of the chunk of a GLB that holds the first buffer.
pub const BIN: u32 = 0x004E_4942;

/// Kind of file that is written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    Glb,
    Gltf,
}

impl Kind {
    /// # Errors
    /// If a name ends in neither `.glb` nor `.gltf`.
    pub fn of(path: &Path) -> Result<Kind> {
        match path.extension().map(|e| e.to_string_lossy().to_lowercase()).as_deref() {
            Some("glb") => Ok(Kind::Glb),
            Some("gltf") => Ok(Kind::Gltf),
            _ => bail!("cannot write {}: end the name in .glb or .gltf", path.display()),
        }
    }
}

/// The JSON of a file, and behind it the other chunks of a GLB as they are.
#[derive(Debug, PartialEq, Eq)]
pub(super) struct Container<'a> {
    pub json: &'a [u8],
    /// Kind and content of each chunk.
    pub chunks: Vec<(u32, &'a [u8])>,
}

impl<'a> Container<'a> {
    /// # Errors
    /// If chunks are cut short.
    pub fn split(bytes: &'a [u8]) -> Result<Container<'a>> {
        let word =
            |at: usize| bytes.get(at..at + 4).map(|four| u32::from_le_bytes(four.try_into().expect("four bytes")));
        if word(0) != Some(MAGIC) {
            return Ok(Container { json: bytes, chunks: Vec::new() });
        }
        let length = word(8).context("it ends within its header")? as usize;
        let (mut at, mut chunks) = (12, Vec::new());
        while at + 8 <= length.min(bytes.len()) {
            let (size, kind) =
                (word(at).context("it is cut short")? as usize, word(at + 4).context("it is cut short")?);
            chunks.push((kind, bytes.get(at + 8..at + 8 + size).context("a chunk of it is cut short")?));
            at += 8 + size;
        }
        match chunks.first() {
            Some((JSON, json)) => Ok(Container { json, chunks: chunks.split_off(1) }),
            _ => bail!("its first chunk is no JSON"),
        }
    }

    fn bin(&self) -> Option<&'a [u8]> {
        self.chunks.iter().find(|(kind, _)| *kind == BIN).map(|(_, bytes)| *bytes)
    }
}

/// Writes a document with the chunks of its source, and beside it what it refers to.
pub(super) fn save(
    source: &Container,
    mut document: Document,
    kind: Kind,
    folder: Option<&Path>,
    path: &Path,
) -> Result<()> {
    // Reserved first, so that a folder that cannot be written costs nothing.
    let place = PendingFile::create(path)?;
    let beside = path.parent().unwrap_or(Path::new(""));
    let mut put = Beside::default();
    if let Some(folder) = folder {
        copy_resources(&mut document, (folder, beside), &mut put)?;
    }
    // The binary part is the first buffer, unless that lies elsewhere or there is none.
    let first = (document.len("buffers") > 0).then(|| document.item("buffers", 0)).transpose()?;
    let first = first.filter(|buffer| buffer.read::<String>("uri").is_none());
    if let (Kind::Gltf, Some(bin), Some(mut buffer)) = (kind, source.bin(), first) {
        let name = path.with_extension("bin");
        put.file(&name, bin)?;
        buffer.set("uri", &percent_encoded(&name.file_name().unwrap_or_default().to_string_lossy()));
        document.put("buffers", 0, &buffer);
    }
    let json = document.into_json();
    place.commit(|writer| match kind {
        Kind::Gltf => Ok(writer.write_all(&json)?),
        Kind::Glb => write_glb(writer, json, &source.chunks),
    })?;
    put.keep();
    Ok(())
}

/// Writes a GLB: its JSON, filled up with spaces, and behind it the other chunks as they are, each a kind and a multiple of four bytes.
///
/// # Errors
/// If it is larger than a GLB can be, or cannot be written.
pub fn write_glb(writer: &mut impl Write, mut json: Vec<u8>, chunks: &[(u32, &[u8])]) -> Result<()> {
    json.resize(json.len().next_multiple_of(4), b' ');
    let length = 12 + [&json[..]].into_iter().chain(chunks.iter().map(|c| c.1)).map(|c| 8 + c.len()).sum::<usize>();
    let length = u32::try_from(length).context("a GLB holds 4 GiB at most; write a .gltf")?;
    let words = |words: [u32; 2]| words.map(u32::to_le_bytes).concat();
    writer.write_all(&[words([MAGIC, 2]), length.to_le_bytes().to_vec()].concat())?;
    for (kind, content) in std::iter::once(&(JSON, &json[..])).chain(chunks) {
        writer.write_all(&words([content.len() as u32, *kind]))?;
        writer.write_all(content)?;
    }
    Ok(())
}

/// A file name as it stands in a URI, where `:`, `%`, `#` and others have a meaning of their own.
fn percent_encoded(name: &str) -> String {
    let is_plain = |byte: u8| byte.is_ascii_alphanumeric() || b"-._~".contains(&byte);
    let encoded = |byte: u8| if is_plain(byte) { char::from(byte).to_string() } else { format!("%{byte:02X}") };
    name.bytes().map(encoded).collect()
}

/// Copies the files that a document refers to from its old folder to the same places below the new one.
fn copy_resources(document: &mut Document, (from, to): (&Path, &Path), put: &mut Beside) -> Result<()> {
    let canonical = |folder: &Path| if folder.as_os_str().is_empty() { Path::new(".") } else { folder }.canonicalize();
    if canonical(from).ok() == canonical(to).ok() {
        return Ok(());
    }
    for list in ["buffers", "images", PROFILES] {
        for idx in 0..document.len(list) {
            let uri: Option<String> = document.item(list, idx).unwrap_or_default().read("uri");
            let Some((file, name)) = uri.as_deref().and_then(|uri| named_file(from, uri)) else { continue };
            let target = to.join(name);
            let content = std::fs::read(&file)
                .with_context(|| format!("cannot read {}, which the scene needs", file.display()))?;
            if let Some(parent) = target.parent() {
                std::fs::create_dir_all(parent)
                    .with_context(|| format!("cannot make the folder {}", parent.display()))?;
            }
            put.file(&target, &content)?;
        }
    }
    Ok(())
}

/// Files that were written because a scene needs them; they go again if the scene cannot be written.
#[derive(Default)]
struct Beside(Vec<PathBuf>);

impl Beside {
    /// Writes a file, unless it is there already; another one of that name is not overwritten.
    fn file(&mut self, path: &Path, content: &[u8]) -> Result<()> {
        match std::fs::read(path) {
            Ok(there) if there == content => Ok(()),
            Ok(_) => bail!("{} is there already and is another file; choose another folder or name", path.display()),
            Err(error) if error.kind() == ErrorKind::NotFound => {
                write_whole(path, content)?;
                self.0.push(path.to_path_buf());
                Ok(())
            }
            Err(error) => Err(error).with_context(|| {
                format!("{} is there already and cannot be read; choose another folder or name", path.display())
            }),
        }
    }

    /// The scene is written.
    fn keep(mut self) {
        self.0.clear();
    }
}

impl Drop for Beside {
    fn drop(&mut self) {
        for path in &self.0 {
            // What cannot be removed stays.
            let _ = std::fs::remove_file(path);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_what_is_missing_is_written_beside_a_scene() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        std::fs::write(at("same.bin"), b"content").unwrap();
        std::fs::write(at("other.bin"), b"other").unwrap();
        // Of a folder nothing can be read, as of a file of somebody else.
        std::fs::create_dir(at("unreadable.bin")).unwrap();
        let mut put = Beside::default();
        for name in ["new.bin", "same.bin"] {
            put.file(&at(name), b"content").unwrap();
        }
        for (name, words) in [("other.bin", "is another file"), ("unreadable.bin", "cannot be read")] {
            let said = put.file(&at(name), b"content").unwrap_err().to_string();
            assert!(said.contains(words), "{said}");
        }
        // The scene is not written: what came with it goes, and nothing else.
        drop(put);
        assert!(!at("new.bin").exists());
        assert!(at("same.bin").exists() && at("other.bin").exists() && at("unreadable.bin").exists());
    }
}
