//! The arrows of `docs/architecture.md`, read from the manifests and the lock file.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use toml::Table;

pub fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().expect("the tests package lies in the workspace").to_path_buf()
}

pub fn manifest(path: &str) -> Table {
    let text = std::fs::read_to_string(root().join(path)).unwrap();
    text.parse().unwrap_or_else(|error| panic!("{path}: {error}"))
}

/// What a crate needs to be built, without what only its tests need.
fn dependencies(crate_name: &str) -> BTreeSet<String> {
    let manifest = manifest(&format!("crates/{crate_name}/Cargo.toml"));
    let mut found = BTreeSet::new();
    for section in ["dependencies", "build-dependencies"] {
        found.extend(manifest.get(section).and_then(|s| s.as_table()).into_iter().flat_map(|t| t.keys().cloned()));
    }
    assert!(
        manifest.get("target").is_none(),
        "{crate_name} has dependencies by platform, which this test does not read"
    );
    found
}

#[test]
fn every_crate_uses_only_what_its_arrows_allow() {
    let arrows = [
        ("nystrom", "half nalgebra rayon thiserror"),
        ("transport", "bytemuck clerestory-nystrom exr glam gltf half image obvhs rayon serde serde_json thiserror"),
        ("relight", "bytemuck clerestory-nystrom half pollster rayon serde thiserror wgpu"),
        (
            "editor",
            "anyhow clap clerestory-nystrom clerestory-relight clerestory-transport dirs eframe egui_plot egui_tiles exr flate2 glam \
             image indicatif libc raw-window-handle rayon rfd serde serde_json signal-hook thread-priority x11rb",
        ),
    ];
    for (crate_name, allowed) in arrows {
        let allowed: BTreeSet<String> = allowed.split_whitespace().map(str::to_string).collect();
        let used = dependencies(crate_name);
        let forbidden: Vec<_> = used.difference(&allowed).collect();
        assert!(forbidden.is_empty(), "{crate_name} may not use {forbidden:?}");
    }
}

#[test]
fn nobody_needs_the_tests_and_only_the_editor_is_untyped_about_errors() {
    for crate_name in ["nystrom", "transport", "relight", "editor"] {
        let used = dependencies(crate_name);
        assert!(!used.contains("workspace-tests"), "{crate_name} uses the tests");
        assert_eq!(used.contains("anyhow"), crate_name == "editor", "{crate_name}");
    }
}

#[test]
fn all_crates_share_the_lints_and_the_licence() {
    for path in ["crates/nystrom", "crates/transport", "crates/relight", "crates/editor", "tests"] {
        let manifest = manifest(&format!("{path}/Cargo.toml"));
        assert_eq!(manifest["lints"]["workspace"].as_bool(), Some(true), "{path} has lints of its own");
        assert_eq!(manifest["package"]["license"]["workspace"].as_bool(), Some(true), "{path} has another licence");
    }
}

#[test]
fn one_wgpu_and_one_egui_are_locked() {
    let lock = manifest("Cargo.lock");
    let packages = lock["package"].as_array().unwrap();
    for name in ["wgpu", "naga", "egui", "eframe", "egui-wgpu"] {
        let of_name = packages.iter().filter(|package| package["name"].as_str() == Some(name));
        let versions: Vec<_> = of_name.filter_map(|package| package["version"].as_str()).collect();
        assert_eq!(versions.len(), 1, "{name} is locked in versions {versions:?}");
    }
}

#[test]
fn words_of_one_room_stay_out_of_the_others() {
    let rooms = [
        ("nystrom", &["wgpu", "egui", "gltf", "std::fs"][..]),
        ("transport", &["wgpu", "egui", "println!", "std::thread::spawn"][..]),
        ("relight", &["clerestory_transport", "gltf", "egui", "std::fs", "println!"][..]),
    ];
    for (crate_name, never) in rooms {
        let source = root().join("crates").join(crate_name).join("src");
        let files = sources(&source);
        assert!(!files.is_empty(), "{} has no sources", source.display());
        for file in files {
            let text = std::fs::read_to_string(&file).unwrap();
            let code: String = text.lines().filter(|line| !line.trim_start().starts_with("//")).collect();
            for word in never {
                assert!(!code.contains(word), "{} names {word}", file.display());
            }
        }
    }
}

/// What is told of a matrix is told in words of linear algebra, in comments, too.
#[test]
fn the_crate_of_matrices_has_no_word_for_light() {
    let never = "light lights lit lamp lamps shines bake bakes baked baking texel texels camera cameras pixel pixels picture pictures";
    for file in sources(&root().join("crates/nystrom/src")) {
        let words = words(&std::fs::read_to_string(&file).unwrap());
        for word in never.split(' ') {
            assert!(!words.contains(word), "{} says {word}", file.display());
        }
    }
    let taken_apart = words("/// A [`BakedError`] of n_lights, what CLAMP is: camera-ready");
    for word in ["baked", "lights", "clamp", "camera"] {
        assert!(taken_apart.contains(word), "{word} is not among {taken_apart:?}");
    }
    assert!(!taken_apart.contains("lamp"), "a part of a word is none");
}

/// Words of a text in lower case; names in code are as many words as they are made of.
fn words(text: &str) -> BTreeSet<String> {
    let mut spaced = String::new();
    let mut before = ' ';
    for letter in text.chars() {
        if before.is_lowercase() && letter.is_uppercase() {
            spaced.push(' ');
        }
        spaced.extend(letter.to_lowercase());
        before = letter;
    }
    spaced.split(|letter: char| !letter.is_alphabetic()).map(str::to_owned).collect()
}

#[test]
fn numbers_are_typed_into_one_field_alone() {
    let source = root().join("crates/editor/src");
    let field = source.join("panels/number.rs");
    for file in sources(&source).into_iter().filter(|file| *file != field) {
        let text = std::fs::read_to_string(&file).unwrap();
        assert!(!text.contains("DragValue"), "{} has a field of the toolkit, not `Number`", file.display());
    }
    assert!(std::fs::read_to_string(field).unwrap().contains("DragValue::new"));
}

/// Rust files below a folder, without those that only tests compile: a test may say what its numbers stand for.
fn sources(folder: &Path) -> Vec<PathBuf> {
    let is_test = |path: &Path| path.file_stem().is_some_and(|stem| stem == "tests" || stem == "laws");
    let mut found = Vec::new();
    for path in std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).filter(|path| !is_test(path)) {
        if path.is_dir() {
            found.extend(sources(&path));
        } else if path.extension().is_some_and(|extension| extension == "rs") {
            found.push(path);
        }
    }
    found
}

#[test]
fn everything_comes_from_the_registry_and_nothing_that_is_banned() {
    let banned: BTreeSet<String> = {
        let deny = manifest("deny.toml");
        let list = deny["bans"]["deny"].as_array().unwrap();
        list.iter().filter_map(|ban| Some(ban["crate"].as_str()?.to_owned())).collect()
    };
    assert!(banned.len() > 3, "{banned:?}");
    for package in manifest("Cargo.lock")["package"].as_array().unwrap() {
        let name = package["name"].as_str().unwrap();
        let source = package.get("source").and_then(|source| source.as_str());
        let known = "registry+https://github.com/rust-lang/crates.io-index";
        assert!(source.is_none_or(|source| source == known), "{name} comes from {source:?}");
        assert!(!banned.contains(name), "{name} is banned by deny.toml");
    }
}

#[test]
fn unsafe_code_is_where_docs_reliability_says_and_no_more() {
    let page = std::fs::read_to_string(root().join("docs/reliability.md")).unwrap();
    let told: BTreeSet<(String, usize)> = page
        .lines()
        .filter_map(|line| {
            let mut cells = line.strip_prefix("| `crates/")?.split('|').map(str::trim);
            let file = cells.next()?.strip_suffix('`')?;
            Some((file.to_owned(), cells.next()?.parse().ok()?))
        })
        .collect();
    let crates = root().join("crates");
    let found = sources(&crates).into_iter().filter_map(|file| {
        let n_uses = uses_of_unsafe(&std::fs::read_to_string(&file).unwrap());
        let name = file.strip_prefix(&crates).unwrap().to_string_lossy().replace('\\', "/");
        (n_uses > 0).then_some((name, n_uses))
    });
    assert_eq!(found.collect::<BTreeSet<_>>(), told, "the table of docs/reliability.md differs from the sources");
}

/// Blocks and functions, not lints of that name.
fn uses_of_unsafe(text: &str) -> usize {
    let code = text.lines().filter(|line| !line.trim_start().starts_with("//"));
    let is_word = |c: char| c.is_alphanumeric() || c == '_';
    code.flat_map(|line| line.split(move |c| !is_word(c))).filter(|word| *word == "unsafe").count()
}
