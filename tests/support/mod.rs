//! Scenes, statistics, and devices for the house tests.

mod gltf;
mod statistics;

use std::ops::ControlFlow;
use std::sync::Arc;

use clerestory_relight::{CpuRelighter, DeviceChoice, Frame, Gpu, Radiance, Relight};
use clerestory_transport::bake::{Bake, BakeConfig, BakeJob, Passes};
use clerestory_transport::camera::Film;
use clerestory_transport::import;
use clerestory_transport::light::LightRig;
use clerestory_transport::prepared::PreparedScene;
use clerestory_transport::trace::{TraceConfig, trace};
use glam::Vec3;

pub use gltf::{SceneFile, Shape};
pub use statistics::{Mean, block_means};

/// A scene made of the bytes of a GLB.
pub fn prepare(glb: &[u8]) -> Arc<PreparedScene> {
    let imported = import::load_bytes("house", glb).expect("the house's own scenes are valid");
    let (scene, _) = PreparedScene::new(imported.scene, &[]).expect("the house's own scenes have valid lights");
    Arc::new(scene)
}

/// The picture under a rig by plain path tracing, first camera.
pub fn traced(scene: &PreparedScene, rig: &LightRig, film: Film, config: &TraceConfig) -> Vec<[f32; 3]> {
    let coefficients = scene.lighting.basis.project(rig);
    let go_on = |_| ControlFlow::Continue(());
    trace(scene, &scene.scene.cameras[0], film, &coefficients, config, &go_on).expect("nobody asked to stop")
}

/// A bake of the first camera without a preview.
pub fn baked(scene: &Arc<PreparedScene>, film: Film, config: BakeConfig) -> Bake {
    let camera = scene.scene.cameras[0].clone();
    let job = BakeJob { scene: scene.clone(), camera, film, config, passes: Passes::FinalOnly, irradiance: Vec::new() };
    job.run(|_| ControlFlow::Continue(())).expect("the job is valid").expect("nobody asked to stop")
}

/// The frame that a bake hands to a relighter.
pub fn frame(bake: &Bake) -> Frame {
    Frame { width: bake.header.width, height: bake.header.height, groups: bake.groups.clone() }
}

/// The picture under a rig by multiplication on the CPU.
pub fn relit(bake: &Bake, rig: &LightRig) -> Radiance {
    let mut radiance = Radiance::default();
    let mut relighter = CpuRelighter::new(&frame(bake)).expect("a bake is a valid frame");
    relighter.relight(&bake.header.coefficients(rig), &mut radiance).expect("a rig has finite coefficients");
    radiance
}

/// Any graphics adapter. Without one a test skips itself and says so, unless `CLERESTORY_REQUIRE_GPU` forbids that.
pub fn gpu() -> Option<Gpu> {
    match Gpu::headless(DeviceChoice::Any) {
        Ok(gpu) => Some(gpu),
        Err(error) if std::env::var_os("CLERESTORY_REQUIRE_GPU").is_some() => {
            panic!("CLERESTORY_REQUIRE_GPU is set, but: {error}")
        }
        Err(_) => {
            println!("skipped: no adapter");
            None
        }
    }
}

/// All devices that run here, on a second driver, too, where there is one.
#[allow(dead_code, reason = "not every test is about devices")]
pub fn gpus() -> Vec<Gpu> {
    if gpu().is_some() { Gpu::all_headless(DeviceChoice::Any) } else { Vec::new() }
}

/// A file of the folder that `CLERESTORY_SHARED` names, which has to be there. Without such a folder a test skips itself and says so, unless
/// `CLERESTORY_REQUIRE_SHARED` forbids that.
pub fn shared(path: &str) -> Option<std::path::PathBuf> {
    let Some(folder) = std::env::var_os("CLERESTORY_SHARED").filter(|folder| !folder.is_empty()) else {
        let is_required = std::env::var_os("CLERESTORY_REQUIRE_SHARED").is_some();
        assert!(!is_required, "CLERESTORY_REQUIRE_SHARED is set, but CLERESTORY_SHARED names no folder");
        println!("skipped: no shared data");
        return None;
    };
    let file = std::path::Path::new(&folder).join(path);
    assert!(file.exists(), "the shared data has no {}", file.display());
    Some(file)
}

/// A small room with a box on the floor, two lamps of different color, and a panel of 4 × 4 texels at the ceiling.
pub fn two_lamps_and_a_panel() -> SceneFile {
    let wall = SceneFile::lambert([0.7, 0.6, 0.5], [0.0; 3]);
    let block = Shape::room(Vec3::splat(0.25)).turned().moved(Vec3::new(0.3, -0.75, -0.3));
    let panel = Shape::quad(Vec3::new(-0.4, 0.98, -0.4), Vec3::X * 0.8, Vec3::Z * 0.8);
    SceneFile::default()
        .surface("room", &Shape::room(Vec3::ONE), wall)
        .surface("block", &block, SceneFile::lambert([0.3, 0.5, 0.7], [0.0; 3]))
        .panel("panel", &panel, [3.0, 2.5, 2.0], 4)
        .point_lamp("warm", Vec3::new(-0.6, 0.3, 0.2), [1.0, 0.7, 0.4], 1.5)
        .point_lamp("cool", Vec3::new(0.7, 0.5, -0.5), [0.5, 0.7, 1.0], 1.0)
        .camera("door", Vec3::new(0.0, 0.0, 0.95), 1.1)
}
