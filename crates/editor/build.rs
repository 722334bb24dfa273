//! Tells the program which compiler built it and from which sources: measurements name both.

#[path = "src/bin/report/sources.rs"]
mod sources;

use std::io;
use std::path::Path;
use std::process::Command;

fn main() -> io::Result<()> {
    let compiler = std::env::var_os("RUSTC").unwrap_or_else(|| "rustc".into());
    let told = Command::new(compiler).arg("-V").output().ok().filter(|told| told.status.success());
    let version = told.map(|told| String::from_utf8_lossy(&told.stdout).trim().to_string());
    println!("cargo::rustc-env=CLERESTORY_RUSTC={}", version.as_deref().unwrap_or("an unknown compiler"));
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let files = sources::files(&root)?;
    println!("cargo::rustc-env=CLERESTORY_SOURCES={}", sources::hash(&root, &files)?);
    // Cargo asks again where another compiler builds, or one of these files changes; the program is built anew then anyway.
    files.iter().for_each(|file| println!("cargo::rerun-if-changed={}", file.display()));
    Ok(())
}
