//! Where bytes outside the JSON come from: data URIs and files beside it.

use std::path::{Path, PathBuf};

/// Finds what a `uri` of the file names.
pub(super) struct Locator {
    /// Folder of the glTF file; `None` for bytes that came without one.
    pub folder: Option<PathBuf>,
}

impl Locator {
    /// Bytes behind a URI, or a reason in words.
    pub fn fetch(&self, uri: &str) -> Result<Vec<u8>, String> {
        if let Some(rest) = uri.strip_prefix("data:") {
            return decode_data_uri(rest);
        }
        let decoded = String::from_utf8(percent_decode(uri))
            .map_err(|_| format!("the file name {uri:?} is not readable text"))?;
        if decoded.contains("://") || Path::new(&decoded).is_absolute() {
            return Err(format!("{decoded:?} does not lie beside the glTF file"));
        }
        let folder = self.folder.as_ref().ok_or_else(|| format!("there is no folder to look for {decoded:?} in"))?;
        let plain = || std::fs::read(folder.join(uri));
        std::fs::read(folder.join(&decoded)).or_else(|error| plain().map_err(|_| error)).map_err(|error| {
            match error.kind() {
                std::io::ErrorKind::NotFound => format!("the file {decoded:?} is missing"),
                _ => format!("the file {decoded:?} cannot be read ({error})"),
            }
        })
    }
}

/// `[media type][;base64],payload`, after `data:`.
fn decode_data_uri(rest: &str) -> Result<Vec<u8>, String> {
    let (head, payload) = rest.split_once(',').ok_or("its data URI has no comma")?;
    match head.ends_with(";base64") {
        true => decode_base64(payload).ok_or_else(|| "its data URI is not valid base64".to_owned()),
        false => Ok(percent_decode(payload)),
    }
}

/// RFC 3986 percent-decoding; a stray `%` stays.
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

fn hex_digit(byte: u8) -> Option<u8> {
    (byte as char).to_digit(16).map(|digit| digit as u8)
}

/// RFC 4648 base64, standard or URL alphabet, with or without padding; white space and `%`-escapes are tolerated.
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
    fn files_elsewhere_are_refused_in_words() {
        let locator = Locator { folder: Some(PathBuf::from("/tmp")) };
        for uri in ["/etc/hostname", "https://example.org/a.bin", "file:///etc/hostname"] {
            assert!(locator.fetch(uri).expect_err("refused").contains("beside"), "{uri}");
        }
    }
}
