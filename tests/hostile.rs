//! Hostile files, made of valid ones from a seed. The same targets as those of `fuzz/`, which runs them for hours; here some
//! thousand cases say that nothing has become worse. A failure names the case, which the seed gives again.

use clerestory_relight::{CpuRelighter, Frame, Radiance, Relight};
use clerestory_transport::archive;
use clerestory_transport::light::LightRig;

use fuzz::mutate::{Dice, mutated};
use fuzz::{seeds, targets};

#[expect(dead_code, reason = "the driver of fuzz/ uses more of it")]
#[path = "../fuzz/src/lib.rs"]
mod fuzz;

/// Those of its targets that need the whole program, which it has only where it is asked for.
#[path = "../fuzz/src/documents.rs"]
mod documents;

const SEED: u64 = 20_261_122;

/// How many times as many cases as usual: `CLERESTORY_HOSTILE_TIMES`.
fn times() -> u64 {
    std::env::var("CLERESTORY_HOSTILE_TIMES").map_or(1, |times| times.parse().expect("a number of times"))
}

/// Feeds a target with so many mutations of its files.
fn survives(name: &str, n_cases: u64, target: impl Fn(&[u8]) + std::panic::RefUnwindSafe) {
    let files = seeds::of(name);
    assert!(!files.is_empty());
    files.iter().for_each(|file| target(file));
    for case in 0..n_cases * times() {
        let mut dice = Dice(SEED ^ (case << 20));
        let (one, other) = (dice.below(files.len()), dice.below(files.len()));
        let bytes = mutated(&files[one], &files[other], &mut dice);
        assert!(std::panic::catch_unwind(|| target(&bytes)).is_ok(), "{name}: case {case} of seed {SEED}");
    }
}

#[test]
fn hostile_scenes_do_no_harm() {
    survives("gltf", 1500, targets::gltf);
}

#[test]
fn hostile_compressed_geometry_does_no_harm() {
    survives("meshopt", 4000, targets::meshopt);
}

#[test]
fn hostile_measured_lamps_do_no_harm() {
    survives("photometry", 4000, targets::photometry);
}

#[test]
fn hostile_skies_do_no_harm() {
    survives("sky", 3000, targets::sky);
}

#[test]
fn hostile_pictures_do_no_harm() {
    survives("picture", 3000, targets::picture);
}

#[test]
fn hostile_bakes_do_no_harm() {
    survives("archive", 2000, |bytes| {
        targets::archive(bytes);
        relight(bytes);
    });
}

/// A bake that is read can be relit.
fn relight(bytes: &[u8]) {
    let Ok(bake) = archive::decode(bytes, "a.transport".as_ref()) else { return };
    let (rig, header) = (LightRig::default(), &bake.header);
    if header.width * header.height > 10_000 {
        return;
    }
    let frame = Frame { width: header.width, height: header.height, groups: bake.groups_under(&rig) };
    let mut radiance = Radiance::default();
    if let Ok(mut relighter) = CpuRelighter::new(&frame) {
        let _ = relighter.relight(&header.coefficients(&rig), &mut radiance);
    }
}

#[test]
fn hostile_looks_do_no_harm() {
    survives("look", 3000, documents::look);
}

/// What is not read as a whole is no way to what lies behind it.
#[test]
fn hostile_looks_are_made_of_whole_ones() {
    for seed in seeds::of("look") {
        let text = String::from_utf8(seed).unwrap();
        match clerestory::look::Look::from_json(&text) {
            Ok((_, warnings)) => assert!(warnings.is_empty(), "{warnings:?}"),
            Err(error) => panic!("{error:#}"),
        }
    }
}

#[test]
fn hostile_wishes_do_no_harm() {
    survives("wishes", 2000, documents::wishes);
}
