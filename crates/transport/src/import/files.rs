//! Reading files with a bound on their size, so that no file is a flood, and decoding them so that none ends the program.

use std::fs;
use std::io::{self, Read};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;

use crate::stop::Stop;

/// What is read without a look around.
const PIECE_BYTES: u64 = 16 << 20;

/// More pixels than a byte of a compressed file stands for.
const MAX_PIXELS_PER_BYTE: u64 = 1 << 14;

/// Refuses more pixels than so many bytes can stand for.
pub(super) fn check_pixels([width, height]: [u32; 2], n_bytes: u64) -> Result<(), String> {
    #[expect(clippy::arithmetic_side_effects, reason = "a product of two 32-bit numbers")]
    let n_pixels = u64::from(width) * u64::from(height);
    if n_pixels > n_bytes.saturating_mul(MAX_PIXELS_PER_BYTE) {
        return Err(format!("{width} × {height} pixels cannot be in {n_bytes} bytes"));
    }
    Ok(())
}

/// A whole file of at most so many bytes.
///
/// # Errors
/// What the system says; a folder, a device, a pipe or a larger file is refused before a byte of it is read.
pub(super) fn read_at_most(path: &Path, n_bytes: u64) -> io::Result<Vec<u8>> {
    read_until(path, n_bytes, &Stop::default())
}

/// The same, if nobody asks for a stop meanwhile.
///
/// # Errors
/// As [`read_at_most`], and from a stop on.
pub(super) fn read_until(path: &Path, n_bytes: u64, stop: &Stop) -> io::Result<Vec<u8>> {
    // A pipe would block already when it is opened.
    let found = fs::metadata(path)?;
    if !found.is_file() {
        return Err(io::Error::other("it is no regular file"));
    }
    let too_long = || io::Error::other(format!("it has more than {} MiB", n_bytes >> 20));
    if found.len() > n_bytes {
        return Err(too_long());
    }
    let mut bytes = Vec::with_capacity(usize::try_from(found.len()).map_err(io::Error::other)?);
    let mut file = stop.reader(fs::File::open(path)?.take(n_bytes.saturating_add(1)));
    // In pieces, between which a stop is seen: a large file comes at once otherwise.
    while file.by_ref().take(PIECE_BYTES).read_to_end(&mut bytes)? > 0 {}
    if bytes.len() as u64 > n_bytes { Err(too_long()) } else { Ok(bytes) }
}

/// What the system says of a file while it is read.
pub(super) fn of_file(error: &io::Error) -> String {
    if error.kind() == io::ErrorKind::UnexpectedEof { "it is cut off".into() } else { error.to_string() }
}

/// What a decoder says of a picture.
pub(super) fn of_image(error: image::ImageError) -> String {
    match error {
        image::ImageError::IoError(error) => of_file(&error),
        error => error.to_string(),
    }
}

/// What a decoder makes of a file; its panic is a fault of the file.
pub(super) fn guarded<T>(decode: impl FnOnce() -> Result<T, String>) -> Result<T, String> {
    catch_unwind(AssertUnwindSafe(decode)).unwrap_or_else(|_| Err("its decoder failed".into()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_is_read_up_to_its_bound() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a");
        fs::write(&path, [7; 100]).unwrap();
        assert_eq!(read_at_most(&path, 100).unwrap(), [7; 100]);
        assert!(read_at_most(&path, 99).unwrap_err().to_string().contains("more than"));
        assert!(read_at_most(folder.path(), 99).unwrap_err().to_string().contains("no regular file"));
        #[cfg(unix)]
        assert!(read_at_most(Path::new("/dev/zero"), 99).unwrap_err().to_string().contains("no regular file"));
    }
}
