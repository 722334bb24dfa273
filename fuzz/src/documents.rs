//! Documents of the editor: looks, and files of wishes. They need the whole program, the other targets its core alone.

use std::path::Path;
use std::sync::OnceLock;

use clerestory::look::Look;
use clerestory::schedule::Schedule;
use clerestory::solve::parse::{self, Surroundings};
use clerestory_transport::archive;
use clerestory_transport::bake::Bake;

/// A bake that documents are about.
fn bake() -> &'static Bake {
    static BAKE: OnceLock<Bake> = OnceLock::new();
    const FILE: &[u8] = include_bytes!("../../crates/transport/tests/data/v4.transport");
    BAKE.get_or_init(|| archive::decode(FILE, Path::new("v4.transport")).expect("a file of the repository can be read"))
}

/// A look: read, mended, written and read again, looked at in time, and counted up.
pub fn look(bytes: &[u8]) {
    let text = String::from_utf8_lossy(bytes);
    let strict = Look::from_json(&text);
    let Ok((look, _)) = Look::recover(&text) else {
        assert!(strict.is_err(), "what can be read can be mended");
        return;
    };
    if let Ok((strict, _)) = strict {
        assert_eq!(strict, look, "what is whole is not changed by mending");
    }
    let written = look.to_json();
    let (again, warnings) = Look::from_json(&written).expect("what is written can be read");
    assert!(warnings.is_empty(), "{text}: {warnings:?}");
    assert_eq!(again.to_json(), written, "nothing is lost or rounded by saving");
    let basis = &bake().header.basis;
    let names = look.snapshots.iter().map(|snapshot| snapshot.name.clone());
    names.for_each(|name| assert!(look.named(&name).is_ok(), "the look `{name}` is not found"));
    for look in [0.0, 0.5, 1e4].map(|secs| look.at(secs, Some(basis))).iter().chain([&look]) {
        let coefficients = basis.project(&look.lights);
        assert!(coefficients.iter().flatten().all(|c| c.is_finite() && *c >= 0.0), "{text}: {coefficients:?}");
        let schedule = Schedule::new(basis, None, look, Some(100.0), Some(12.0));
        assert!(schedule.lumen() >= 0.0, "{text}: {} lm", schedule.lumen());
    }
}

/// A file of wishes.
pub fn wishes(bytes: &[u8]) {
    let text = String::from_utf8_lossy(bytes);
    let nowhere = Path::new("a folder that is not there");
    if let Ok(request) = parse::request(&text, nowhere, &Surroundings { bake: bake(), seen: None }) {
        assert!(request.wishes.iter().all(|wish| wish.weight >= 0.0 && wish.weight.is_finite()), "{text}");
    }
}
