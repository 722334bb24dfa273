//! Where bytes outside the JSON come from: data URIs and files beside it.
//!
//! A file from a stranger must not make this program read what is not part of it: a URI names a file in the folder of the
//! glTF or below, whatever links lie there, and nothing is ever fetched over a network.

use std::collections::BTreeSet;
use std::path::{Component, Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Mutex, PoisonError};

use serde_json::Value;

use super::document::shown;
use super::files::read_until;
use crate::stop::Stop;

/// Most bytes of all files beside a glTF together; one that is named twice counts twice.
const MAX_BYTES: u64 = 8 << 30;

/// Finds what a `uri` of the file names.
pub(super) struct Locator {
    /// Folder of the glTF file; `None` for bytes that came without one.
    folder: Option<PathBuf>,
    /// What may still be read.
    n_bytes_left: AtomicU64,
    /// Files that were asked for, there or not.
    asked: Mutex<BTreeSet<PathBuf>>,
    /// Whether the file is still wanted.
    pub stop: Stop,
}

impl Locator {
    /// For a glTF in a folder, or for bytes that came without one.
    pub fn new(folder: Option<&Path>, stop: &Stop) -> Locator {
        let folder = folder.map(|folder| if folder.as_os_str().is_empty() { Path::new(".") } else { folder });
        let (folder, asked) = (folder.map(Path::to_path_buf), Mutex::default());
        Locator { folder, n_bytes_left: AtomicU64::new(MAX_BYTES), asked, stop: stop.clone() }
    }

    /// Files beside the glTF that were asked for, there or not.
    pub fn files(&self) -> Vec<PathBuf> {
        // Whoever panicked left a set of paths, which is never half done.
        self.asked.lock().unwrap_or_else(PoisonError::into_inner).iter().cloned().collect()
    }

    fn note(&self, path: PathBuf) {
        self.asked.lock().unwrap_or_else(PoisonError::into_inner).insert(path);
    }

    /// Bytes behind a URI, or a reason in words.
    pub fn fetch(&self, uri: &str) -> Result<Vec<u8>, String> {
        if let Some(rest) = data(uri) {
            return decode_data_uri(rest);
        }
        let decoded = String::from_utf8(percent_decode(uri))
            .map_err(|_| format!("the file name {} is not readable text", shown(uri)))?;
        let elsewhere = || format!("{} does not lie beside the glTF file", shown(&decoded));
        if has_scheme(uri) || !is_below(&decoded) || !is_below(uri) {
            return Err(elsewhere());
        }
        let folder =
            self.folder.as_ref().ok_or_else(|| format!("there is no folder to look for {} in", shown(&decoded)))?;
        let in_words = |error: std::io::Error| match error.kind() {
            std::io::ErrorKind::NotFound => format!("the file {} is missing", shown(&decoded)),
            _ => format!("the file {} cannot be read ({error})", shown(&decoded)),
        };
        let found = found_in(folder, &decoded, uri);
        if found.is_err() {
            self.note(folder.join(&decoded));
        }
        let (path, _) = found.map_err(in_words)?;
        if !path.starts_with(folder.canonicalize().map_err(in_words)?) {
            return Err(elsewhere());
        }
        self.note(path.clone());
        self.read(&path).map_err(in_words)
    }

    fn read(&self, path: &Path) -> std::io::Result<Vec<u8>> {
        let bytes = read_until(path, self.n_bytes_left.load(Ordering::Relaxed), &self.stop)?;
        let n_bytes = bytes.len() as u64;
        let left = |left: u64| left.checked_sub(n_bytes);
        match self.n_bytes_left.fetch_update(Ordering::Relaxed, Ordering::Relaxed, left) {
            Ok(_) => Ok(bytes),
            Err(_) => Err(std::io::Error::other(format!("all files together have more than {} GiB", MAX_BYTES >> 30))),
        }
    }
}

/// The file that a URI of a glTF names in its folder or below, as an import finds it, and the name by which a copy of it is found below
/// another folder. `None` for data, addresses, and what lies elsewhere or is not there.
pub fn named_file(folder: &Path, uri: &str) -> Option<(PathBuf, PathBuf)> {
    let folder = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
    let decoded = String::from_utf8(percent_decode(uri)).ok()?;
    if has_scheme(uri) || !is_below(&decoded) || !is_below(uri) {
        return None;
    }
    let (path, name) = found_in(folder, &decoded, uri).ok()?;
    let is_inside = path.is_file() && path.starts_with(folder.canonicalize().ok()?);
    is_inside.then(|| (path, name.into()))
}

/// All URIs of a document but those of data: of buffers, images, light profiles, and what extensions name.
pub(super) fn uris(json: &str) -> Vec<String> {
    fn collect(value: Value, found: &mut Vec<String>) {
        match value {
            Value::Array(items) => items.into_iter().for_each(|item| collect(item, found)),
            Value::Object(members) => members.into_iter().for_each(|(key, value)| match value {
                Value::String(uri) if key == "uri" && data(&uri).is_none() => found.push(uri),
                other => collect(other, found),
            }),
            _ => {}
        }
    }
    let mut found = Vec::new();
    // What is no JSON names nothing.
    collect(serde_json::from_str(json).unwrap_or_default(), &mut found);
    found
}

/// What a URI names in a folder, and by which of its names. Some names hold percent signs of their own, and some programs write the
/// separator of Windows.
fn found_in(folder: &Path, decoded: &str, uri: &str) -> std::io::Result<(PathBuf, String)> {
    let others = [uri.to_owned(), decoded.replace('\\', "/")];
    let other = || others.iter().find_map(|name| Some((folder.join(name).canonicalize().ok()?, name.clone())));
    let in_another_case = || Some((in_any_case(folder, &others[1])?, others[1].clone()));
    match folder.join(decoded).canonicalize() {
        Ok(path) => Ok((path, decoded.to_owned())),
        Err(error) => other().or_else(in_another_case).ok_or(error),
    }
}

/// What a path names in a folder where it does not tell upper from lower case, as Windows has it: the first by name.
fn in_any_case(folder: &Path, name: &str) -> Option<PathBuf> {
    let mut at = folder.to_path_buf();
    for step in name.split('/').filter(|step| !matches!(*step, "" | ".")) {
        let wanted = step.to_lowercase();
        let names = std::fs::read_dir(&at).ok()?.flatten().map(|entry| entry.file_name());
        at.push(names.filter(|name| name.to_string_lossy().to_lowercase() == wanted).min()?);
    }
    at.canonicalize().ok()
}

/// What follows the scheme of a URI that holds data itself; schemes are of any case.
pub(super) fn data(uri: &str) -> Option<&str> {
    uri.split_once(':').filter(|(scheme, _)| scheme.eq_ignore_ascii_case("data")).map(|(_, rest)| rest)
}

/// The name of the file that a URI asks for, for messages; `None` where it holds data itself.
pub(super) fn file_of(uri: &str) -> Option<String> {
    data(uri).is_none().then(|| String::from_utf8_lossy(&percent_decode(uri)).into_owned())
}

/// Whether a URI says by what means it is to be had; a drive of Windows looks alike.
fn has_scheme(uri: &str) -> bool {
    let is_part = |c: char| c.is_ascii_alphanumeric() || matches!(c, '+' | '-' | '.');
    uri.split_once(':').is_some_and(|(scheme, _)| !scheme.is_empty() && scheme.chars().all(is_part))
}

/// Whether a name, read as one of this system or of another, stays below the folder that it is looked for in.
fn is_below(name: &str) -> bool {
    // Where the system allows it a colon is part of a name, but for that of a drive with a path behind it.
    let has_drive = name.find(':') == Some(1) && matches!(name.as_bytes().get(2), None | Some(b'/' | b'\\'));
    let on_a_drive = has_drive || (cfg!(windows) && name.contains(':'));
    let climbs = name.split(['/', '\\']).any(|step| step == "..");
    let plain = |component| matches!(component, Component::Normal(_) | Component::CurDir);
    !on_a_drive && !name.starts_with('\\') && !climbs && Path::new(name).components().all(plain)
}

/// `[media type][;base64],payload`, after `data:`.
fn decode_data_uri(rest: &str) -> Result<Vec<u8>, String> {
    let (head, payload) = rest.split_once(',').ok_or("its data URI has no comma")?;
    match head.rsplit_once(';').is_some_and(|(_, last)| last.eq_ignore_ascii_case("base64")) {
        true => decode_base64(payload).ok_or_else(|| "its data URI is not valid base64".to_owned()),
        false => Ok(percent_decode(payload)),
    }
}

/// RFC 3986 percent-decoding; a stray `%` stays.
#[expect(clippy::arithmetic_side_effects, reason = "places within the text, and two digits below 16")]
fn percent_decode(text: &str) -> Vec<u8> {
    let bytes = text.as_bytes();
    let mut out = Vec::with_capacity(bytes.len());
    let mut at = 0;
    while at < bytes.len() {
        let code = (bytes[at] == b'%').then(|| bytes.get(at + 1..at + 3)).flatten();
        match code.and_then(|hex| Some(hex_digit(hex[0])? * 16 + hex_digit(hex[1])?)) {
            Some(byte) => {
                out.push(byte);
                at += 3;
            }
            None => {
                out.push(bytes[at]);
                at += 1;
            }
        }
    }
    out
}

#[expect(clippy::cast_possible_truncation, reason = "a digit, and the lower bits of what is decoded")]
fn hex_digit(byte: u8) -> Option<u8> {
    (byte as char).to_digit(16).map(|digit| digit as u8)
}

/// RFC 4648 base64, standard or URL alphabet, with or without padding; white space and `%`-escapes are tolerated.
#[expect(clippy::arithmetic_side_effects, reason = "letters are in their ranges, and at most 13 bits wait")]
#[expect(clippy::cast_possible_truncation, reason = "a digit, and the lower bits of what is decoded")]
fn decode_base64(text: &str) -> Option<Vec<u8>> {
    let unescaped = if text.contains('%') { percent_decode(text) } else { text.as_bytes().to_vec() };
    let mut out = Vec::with_capacity(unescaped.len() / 4 * 3 + 3);
    let (mut bits, mut n_bits) = (0_u32, 0_u32);
    for byte in unescaped {
        let sextet = match byte {
            b'A'..=b'Z' => byte - b'A',
            b'a'..=b'z' => byte - b'a' + 26,
            b'0'..=b'9' => byte - b'0' + 52,
            b'+' | b'-' => 62,
            b'/' | b'_' => 63,
            b'=' | b' ' | b'\n' | b'\r' | b'\t' => continue,
            _ => return None,
        };
        bits = bits << 6 | u32::from(sextet);
        n_bits += 6;
        if n_bits >= 8 {
            n_bits -= 8;
            out.push((bits >> n_bits) as u8);
        }
    }
    Some(out)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn base64_of_rfc_4648_decodes() {
        let decode = |text: &str| String::from_utf8(decode_base64(text).expect("valid")).expect("ascii");
        assert_eq!(decode("Zm9vYmFy"), "foobar");
        assert_eq!(decode("Zm9vYg=="), "foob");
        assert_eq!(decode("Zm9v\nYmE"), "fooba");
        assert!(decode_base64("Zm9*").is_none());
    }

    #[test]
    fn percent_escapes_decode_and_stray_signs_stay() {
        assert_eq!(percent_decode("a%20b%2Fc%"), b"a b/c%");
        assert_eq!(percent_decode("100%zz"), b"100%zz");
    }

    #[test]
    fn data_is_known_in_any_case_and_long_names_are_cut_in_messages() {
        let locator = Locator::new(None, &Stop::default());
        for uri in ["data:;base64,Zm9v", "DATA:application/octet-stream;BASE64,Zm9v", "Data:,foo"] {
            assert_eq!(locator.fetch(uri).unwrap(), b"foo", "{uri}");
            assert_eq!(uris(&serde_json::json!({"uri": uri}).to_string()), Vec::<String>::new());
        }
        for start in ["more:", "", "%ff"] {
            let told = locator.fetch(&format!("{start}{}", "ä".repeat(1 << 16))).unwrap_err();
            assert!(told.chars().count() < 250, "{told}");
        }
        // Letters of two characters, as a Mac has them, and of other scripts.
        let name = "Ku\u{308}che \u{e01}\u{e31}.bin";
        let told = locator.fetch(name).unwrap_err();
        assert!(told.contains(&format!("\"{name}\"")), "{told}");
    }

    #[test]
    fn every_uri_but_data_is_listed_wherever_it_stands() {
        let json = r#"{"uri": 3, "buffers": [{"uri": "a.bin"}, {"uri": "data:,x"}, {}], "images": [{"uri": "t/b.png"}],
            "extensions": {"EXT_lights_ies": {"lights": [{"uri": "c.ies", "name": "uri"}]}}}"#;
        let mut found = uris(json);
        found.sort();
        assert_eq!(found, ["a.bin", "c.ies", "t/b.png"]);
        assert_eq!(uris("no JSON"), Vec::<String>::new());
    }

    #[test]
    fn files_elsewhere_are_refused_in_words() {
        let locator = Locator::new(Some(Path::new("/tmp")), &Stop::default());
        for uri in [
            "/etc/hostname",
            "https://example.org/a.bin",
            "file:///etc/hostname",
            "file:a.bin",
            "../etc/hostname",
            "a/../../etc/hostname",
            "%2e%2e/etc/hostname",
            "%2Fetc%2Fhostname",
            "..\\a.bin",
            "C:\\a.bin",
            "C:a.bin",
            "C%3A/a.bin",
            "\\\\server\\share\\a.bin",
        ] {
            assert!(locator.fetch(uri).expect_err("refused").contains("beside"), "{uri}");
        }
    }

    #[test]
    fn files_below_are_read_and_links_that_lead_out_are_not() {
        let (folder, outside) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
        std::fs::create_dir(folder.path().join("textures")).unwrap();
        for (name, bytes) in [("a b.bin", "a"), ("100%25.bin", "b"), ("textures/c.bin", "c")] {
            std::fs::write(folder.path().join(name), bytes).unwrap();
        }
        let locator = Locator::new(Some(folder.path()), &Stop::default());
        for (uri, bytes) in [
            ("a%20b.bin", "a"),
            ("./a b.bin", "a"),
            ("100%25.bin", "b"),
            ("textures/c.bin", "c"),
            ("textures\\c.bin", "c"),
            (".\\textures%5Cc.bin", "c"),
            ("Textures/C.BIN", "c"),
            ("TEXTURES\\.\\c.bin", "c"),
        ] {
            assert_eq!(locator.fetch(uri).unwrap(), bytes.as_bytes(), "{uri}");
            let (path, name) = named_file(folder.path(), uri).unwrap();
            assert_eq!(std::fs::read(path).unwrap(), bytes.as_bytes(), "{uri}");
            // A copy by that name is found as well.
            let copy = outside.path().join(name);
            std::fs::create_dir_all(copy.parent().unwrap()).unwrap();
            std::fs::write(&copy, bytes).unwrap();
            let found = named_file(outside.path(), uri).unwrap().0;
            assert_eq!(found, copy.canonicalize().unwrap(), "{uri}");
        }
        assert!(locator.fetch("textures").unwrap_err().contains("no regular file"));
        assert!(locator.fetch("Textures/D.bin").unwrap_err().contains("missing"));
        #[cfg(unix)]
        {
            std::fs::write(outside.path().join("secret"), "s").unwrap();
            std::fs::write(folder.path().join("a:b.bin"), "d").unwrap();
            assert_eq!(locator.fetch("a%3Ab.bin").unwrap(), b"d");
            assert!(named_file(folder.path(), "a%3Ab.bin").is_some() && locator.fetch("a:b.bin").is_err());
            std::os::unix::fs::symlink(outside.path(), folder.path().join("out")).unwrap();
            std::os::unix::fs::symlink(folder.path().join("a b.bin"), folder.path().join("in")).unwrap();
            assert!(locator.fetch("out/secret").unwrap_err().contains("beside"));
            assert!(locator.fetch("OUT/Secret").unwrap_err().contains("beside"));
            assert_eq!(locator.fetch("in").unwrap(), b"a");
            assert_eq!((named_file(folder.path(), "out/secret"), named_file(folder.path(), "textures")), (None, None));
        }
        drop(outside);
    }
}
