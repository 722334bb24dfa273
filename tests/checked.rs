//! Sums that must not wrap in silence: those of all that reads files from strangers, in releases too.

use std::collections::BTreeSet;

use toml::Table;

use crate::architecture::{manifest, root};

/// Modules of ours that read bytes or text from strangers, each with all below it.
const OURS: [&str; 13] = [
    "editor/src/export/png.rs",
    "editor/src/look.rs",
    "editor/src/schedule.rs",
    "editor/src/solve/parse.rs",
    "nystrom/src/codec.rs",
    "nystrom/src/packed.rs",
    "transport/src/archive.rs",
    "transport/src/import/mod.rs",
    "transport/src/patches/codec.rs",
    "transport/src/photometry/mod.rs",
    "transport/src/sky/averaged.rs",
    "transport/src/sky/codec.rs",
    "transport/src/sky/environment.rs",
];

/// What readers of files begin with.
const READERS: [&str; 6] = ["exr", "flate2", "gltf", "image", "png", "serde_json"];

/// What these need that sees no lengths or places of a file, or is not compiled here: numbers, hashes, checksums, threads,
/// formats that are not switched on.
const HARMLESS: &str = "adler2 bitflags bytemuck crc32fast foldhash gltf-derive half indexmap itoa lazy_static memchr moxcms num-complex \
                        num-traits pulp quick-error rayon-core serde serde_core serde_derive simd-adler32 smallvec tiff zlib-rs zmij";

/// The codecs of factors are all arithmetic on numbers of few bits, so their casts are not looked at one by one.
#[test]
fn modules_that_read_files_refuse_sums_that_could_wrap_and_numbers_that_could_be_cut_off() {
    for path in OURS {
        let text = std::fs::read_to_string(root().join("crates").join(path)).unwrap();
        let denied = "#![cfg_attr(not(test), deny(clippy::arithmetic_side_effects))]";
        assert!(text.lines().any(|line| line == denied), "{path} does not deny sums that could wrap");
        let denied = "#![cfg_attr(not(test), deny(clippy::cast_possible_truncation, clippy::cast_sign_loss))]";
        let is_codec = path.starts_with("nystrom/");
        assert!(
            is_codec || text.lines().any(|line| line == denied),
            "{path} does not deny numbers that could be cut off"
        );
    }
}

#[test]
fn crates_that_read_files_count_with_checks_in_releases() {
    let (ours, lock) = (manifest("Cargo.toml"), manifest("Cargo.lock"));
    let checked = |name: &str| {
        let of_crate = ours["profile"]["release"]["package"].get(name);
        of_crate.and_then(|profile| profile.get("overflow-checks")?.as_bool()) == Some(true)
    };
    let harmless: BTreeSet<&str> = HARMLESS.split_whitespace().collect();
    let mut seen = BTreeSet::new();
    let mut next = READERS.map(str::to_owned).to_vec();
    while let Some(name) = next.pop() {
        if harmless.contains(&*name) || !seen.insert(name.clone()) {
            continue;
        }
        assert!(checked(&name), "{name} reads files without `overflow-checks` in `profile.release.package`");
        let needs = needs(&lock, &name);
        next.extend(needs);
    }
    assert!(seen.len() > READERS.len(), "{seen:?}");
}

/// Names of what all locked versions of a crate need.
fn needs(lock: &Table, name: &str) -> Vec<String> {
    let packages = lock["package"].as_array().unwrap().iter();
    let of_name: Vec<_> = packages.filter(|package| package["name"].as_str() == Some(name)).collect();
    assert!(!of_name.is_empty(), "{name} is not locked any more");
    let needs = of_name.iter().filter_map(|package| package.get("dependencies")?.as_array()).flatten();
    needs.map(|need| need.as_str().unwrap().split(' ').next().unwrap().to_owned()).collect()
}
