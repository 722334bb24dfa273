//! Which commit a program was built from, as far as what lies there can tell.

use std::path::Path;
use std::process::Command;
use std::time::SystemTime;
use std::{fs, io};

use super::{complain, sources};

/// The report's own sources, which [`sources`] leaves out.
const OWN: &str = "crates/editor/src/bin/report";

/// The commit of a repository in words, whether its files were changed since, and whether this program was built from others; nothing
/// where there is no repository.
pub fn commit(root: &Path) -> Option<String> {
    let git = |args: &[&str]| {
        let done = Command::new("git").arg("-C").arg(root).args(args).output().ok()?;
        done.status.success().then(|| String::from_utf8_lossy(&done.stdout).trim().to_string())
    };
    let commit = git(&["show", "--no-patch", "--format=%h of %cs", "HEAD"])?;
    let changed = git(&["status", "--porcelain", "--", "crates", "assets", "Cargo.lock"])?;
    let changed = if changed.is_empty() { "" } else { ", changed since" };
    let is_built = this_is_built_from(root).unwrap_or(false);
    if !is_built {
        complain("this program was built from other sources than lie here, and pages will say so: build it again");
    }
    Some(commit_words(&format!("{commit}{changed}"), is_built))
}

fn commit_words(commit: &str, is_built: bool) -> String {
    let built = if is_built { "" } else { "built from other sources than " };
    format!(" ({built}{commit})")
}

fn this_is_built_from(root: &Path) -> io::Result<bool> {
    let program = fs::metadata(std::env::current_exe()?)?.modified()?;
    is_built_from(root, env!("CLERESTORY_SOURCES"), program)
}

/// Whether the libraries have the sources of that hash, and those of the report were not written after the program.
fn is_built_from(root: &Path, hash: &str, program: SystemTime) -> io::Result<bool> {
    let is_same = sources::hash(root, &sources::files(root)?)? == hash;
    Ok(is_same && latest(&root.join(OWN))?.is_none_or(|own| own <= program))
}

/// When the latest file of a folder was written.
fn latest(folder: &Path) -> io::Result<Option<SystemTime>> {
    let mut found: Option<SystemTime> = None;
    for entry in fs::read_dir(folder)? {
        let path = entry?.path();
        let written = if path.is_dir() { latest(&path)? } else { Some(fs::metadata(&path)?.modified()?) };
        found = found.max(written);
    }
    Ok(found)
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;

    #[test]
    fn a_program_is_told_from_one_of_other_sources() {
        let folder = tempfile::tempdir().unwrap();
        let root = folder.path();
        let write = |path: &str, words: &str| {
            let path = root.join(path);
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            fs::write(path, words).unwrap();
        };
        let own = format!("{OWN}/time/runs.rs");
        for path in ["Cargo.lock", "Cargo.toml", "crates/editor/src/lib.rs", &own] {
            write(path, "one");
        }
        let hash = sources::hash(root, &sources::files(root).unwrap()).unwrap();
        let written = fs::metadata(root.join(&own)).unwrap().modified().unwrap();
        let is_built = |program: SystemTime| is_built_from(root, &hash, program).unwrap();
        assert!(is_built(written), "as built");
        assert!(!is_built(written - Duration::from_secs(1)), "the report was written anew since");
        write("crates/editor/src/lib.rs", "another");
        assert!(!is_built(written + Duration::from_secs(1)), "the library was");
    }

    #[test]
    fn a_commit_that_the_program_is_not_built_from_is_named_as_such() {
        assert_eq!(commit_words("1a2b3c of 2026-01-02", true), " (1a2b3c of 2026-01-02)");
        assert_eq!(
            commit_words("1a2b3c of 2026-01-02", false),
            " (built from other sources than 1a2b3c of 2026-01-02)"
        );
        assert_eq!(env!("CLERESTORY_SOURCES").len(), 16, "build.rs has told a hash");
    }
}
