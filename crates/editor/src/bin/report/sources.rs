//! The sources of the crates, by which the report knows whether the program was built from what lies there; `build.rs` has them, too.

use std::hash::{DefaultHasher, Hash, Hasher};
use std::path::{Path, PathBuf};
use std::{fs, io};

/// What is no part of the library, and binaries, which change often and alone: who builds one of them builds no library for it.
const LEFT_OUT: [&str; 7] = ["benches", "bin", "examples", "laws", "laws.rs", "tests", "tests.rs"];
/// Ends of names of what a compiler reads.
const READ: [&str; 3] = ["rs", "toml", "wgsl"];

/// All files below the root of a repository that its libraries are built from, in an order of their own.
///
/// # Errors
/// If a folder cannot be read.
pub fn files(root: &Path) -> io::Result<Vec<PathBuf>> {
    let mut files = vec![root.join("Cargo.lock"), root.join("Cargo.toml")];
    collect(&root.join("crates"), &mut files)?;
    files.sort();
    Ok(files)
}

fn collect(folder: &Path, files: &mut Vec<PathBuf>) -> io::Result<()> {
    for entry in fs::read_dir(folder)? {
        let path = entry?.path();
        if LEFT_OUT.iter().any(|name| path.ends_with(name)) {
            continue;
        }
        if path.is_dir() {
            collect(&path, files)?;
        } else if READ.iter().any(|end| path.extension().is_some_and(|own| own == *end)) {
            files.push(path);
        }
    }
    Ok(())
}

/// A hash of what such files hold and of where they lie.
///
/// # Errors
/// If a file cannot be read.
pub fn hash(root: &Path, files: &[PathBuf]) -> io::Result<String> {
    let mut hasher = DefaultHasher::new();
    for file in files {
        file.strip_prefix(root).ok().hash(&mut hasher);
        fs::read(file)?.hash(&mut hasher);
    }
    Ok(format!("{:016x}", hasher.finish()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sources_of_libraries_count_and_those_of_tests_and_binaries_do_not() {
        let folder = tempfile::tempdir().unwrap();
        let root = folder.path();
        let write = |path: &str, words: &str| {
            let path = root.join(path);
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            fs::write(path, words).unwrap();
        };
        let now = || hash(root, &files(root).unwrap()).unwrap();
        for path in ["Cargo.lock", "Cargo.toml", "crates/a/Cargo.toml", "crates/a/src/lib.rs"] {
            write(path, "one");
        }
        let before = now();
        for path in ["bin/report/main.rs", "laws.rs", "path/tests/glass.rs", "lib.rs.orig"] {
            write(&format!("crates/a/src/{path}"), "one");
        }
        assert_eq!(now(), before);
        for path in ["Cargo.lock", "crates/a/src/lib.rs", "crates/a/shaders/expand.wgsl", "crates/a/src/path/glass.rs"]
        {
            let before = now();
            write(path, "another");
            assert_ne!(now(), before, "{path}");
        }
        let before = now();
        fs::rename(root.join("crates/a/src/path/glass.rs"), root.join("crates/a/src/path/slabs.rs")).unwrap();
        assert_ne!(now(), before, "names count");
    }
}
