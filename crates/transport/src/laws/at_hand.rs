//! Files of other hands that tests read, in the folder that `CLERESTORY_SHARED` names.

use std::path::PathBuf;

/// That folder. Without one a test says so and ends, unless `CLERESTORY_REQUIRE_SHARED` forbids that.
pub(crate) fn folder() -> Option<PathBuf> {
    file("")
}

/// A file in it, by its path from there. Where the folder is named it has to be there.
pub(crate) fn file(path: &str) -> Option<PathBuf> {
    let folder = std::env::var_os("CLERESTORY_SHARED").filter(|folder| !folder.is_empty()).map(PathBuf::from);
    found(folder, path, std::env::var_os("CLERESTORY_REQUIRE_SHARED").is_some())
}

fn found(folder: Option<PathBuf>, path: &str, is_required: bool) -> Option<PathBuf> {
    let Some(folder) = folder else {
        assert!(!is_required, "CLERESTORY_REQUIRE_SHARED is set, but CLERESTORY_SHARED names no folder");
        println!("skipped: no shared data");
        return None;
    };
    let file = folder.join(path);
    assert!(file.exists(), "the shared data has no {}", file.display());
    Some(file)
}

#[test]
fn what_is_at_hand_is_found_and_without_a_folder_nothing_is() {
    let root = PathBuf::from(env!("CARGO_MANIFEST_DIR"));
    assert_eq!(found(Some(root.clone()), "Cargo.toml", true), Some(root.join("Cargo.toml")));
    assert_eq!(found(None, "Cargo.toml", false), None);
}

#[test]
#[should_panic(expected = "CLERESTORY_REQUIRE_SHARED is set")]
fn a_folder_that_is_required_has_to_be_named() {
    found(None, "Cargo.toml", true);
}

#[test]
#[should_panic(expected = "the shared data has no")]
fn a_file_that_the_folder_lacks_is_an_error() {
    found(Some(PathBuf::from(env!("CARGO_MANIFEST_DIR"))), "no such file", false);
}
