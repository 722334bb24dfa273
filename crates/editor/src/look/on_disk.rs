//! How the file of a look stood when it was read or written here, so that another program's changes are not overwritten unseen.

use std::path::Path;

use clerestory_nystrom::codec::checksum;
use serde::{Deserialize, Serialize};

use super::read_text;

/// What a file held, by its checksum.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct OnDisk(u64);

impl OnDisk {
    /// A file of these bytes.
    pub(super) fn of(bytes: &[u8]) -> OnDisk {
        OnDisk(checksum(bytes))
    }

    /// Whether something else stands there now. A file that is gone takes nothing with it when it is written anew.
    pub fn was_changed(self, path: &Path) -> bool {
        match read_text(path) {
            Ok(text) => OnDisk::of(text.as_bytes()) != self,
            // What is no look any more was changed, too.
            Err(_) => path.exists(),
        }
    }
}

#[cfg(test)]
mod tests {
    use crate::look::Look;

    #[test]
    fn only_another_content_is_a_change() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.look");
        let saved = Look::default().save(&path).unwrap();
        assert!(!saved.was_changed(&path));
        let (_, _, read) = Look::load_as_it_stands(&path).unwrap();
        assert_eq!(read, saved);
        std::fs::write(&path, std::fs::read(&path).unwrap()).unwrap();
        assert!(!saved.was_changed(&path), "the same was written again");
        for other in [&b"{\"clerestory\": 1}"[..], b"", b"\xff\xff"] {
            std::fs::write(&path, other).unwrap();
            assert!(saved.was_changed(&path), "{other:?}");
        }
        std::fs::remove_file(&path).unwrap();
        assert!(!saved.was_changed(&path), "nothing is lost");
    }
}
