//! What is read and built until somebody asks for a stop ends there, wherever that is, and hands on nothing of it.

use std::path::Path;

use crate::bvh::Bvh;
use crate::emitters::LightingError;
use crate::import::{ImportError, load_bytes_until, load_until};
use crate::prepared::PreparedScene;
use crate::skips::Skips;
use crate::stop::Stop;

/// Each of the first looks at the flag, then ever fewer of them.
const FIRST: u64 = 40;

/// Stops some work at one look after the other, until it ends without: how many stops it heard. The work tells whether it was
/// stopped.
fn n_stopped(mut work: impl FnMut(&Stop) -> bool) -> u64 {
    let (mut looks, mut n_stopped) = (0, 0);
    while work(&Stop::after(looks)) {
        n_stopped += 1;
        looks += 1 + looks.saturating_sub(FIRST) / 4;
    }
    n_stopped
}

#[test]
fn a_scene_is_read_as_a_whole_or_not_at_all() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../assets/scenes/gallery.glb");
    let n_triangles = load_until(&path, Skips::default(), &Stop::default()).unwrap().scene.mesh.triangles.len();
    let was_stopped = |read: Result<crate::import::Imported, ImportError>| match read {
        Err(ImportError::Stopped(_)) => true,
        Ok(imported) => {
            assert_eq!(imported.scene.mesh.triangles.len(), n_triangles);
            assert!(imported.report.warnings.is_empty(), "{:?}", imported.report.warnings);
            false
        }
        Err(error) => panic!("a stop is no fault of the file: {error}"),
    };
    let n = n_stopped(|stop| was_stopped(load_until(&path, Skips::default(), stop)));
    assert!(n > 30, "it is looked at only {n} times");
    let bytes = std::fs::read(&path).unwrap();
    let n = n_stopped(|stop| was_stopped(load_bytes_until("gallery", &bytes, Skips::default(), stop)));
    assert!(n > 30, "it is looked at only {n} times");
}

#[test]
fn trees_are_built_as_a_whole_or_not_at_all() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../assets/scenes/mixed.glb");
    let scene = load_until(&path, Skips::default(), &Stop::default()).unwrap().scene;
    let n = n_stopped(|stop| match PreparedScene::until(scene.clone(), &[], None, Skips::default(), stop) {
        Err(LightingError::Stopped(_)) => true,
        Ok((prepared, _)) => {
            assert_eq!(prepared.extent(), prepared.diameter());
            false
        }
        Err(error) => panic!("a stop is no fault of the scene: {error}"),
    });
    assert!(n > 20, "it is looked at only {n} times");
    let ids: Vec<u32> = (0..scene.mesh.triangles.len() as u32).collect();
    let corners: Vec<_> = ids.iter().map(|&id| scene.mesh.corners(id)).collect();
    let n = n_stopped(|stop| Bvh::build_until(&corners, &ids, stop).is_err());
    assert!(n > 16, "between the passes of the builder it is looked at only {n} times");
}
