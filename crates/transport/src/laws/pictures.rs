//! Pictures of a stage: traced, and what a bake of it holds.

use std::ops::ControlFlow;
use std::sync::Arc;

use crate::bake::{Bake, BakeConfig, BakeJob, Passes};
use crate::camera::Film;
use crate::prepared::PreparedScene;
use crate::trace::{TraceConfig, trace};

/// Green radiance under one coefficient per column by path tracing.
pub(super) fn traced(
    scene: &PreparedScene,
    film: Film,
    coefficients: &[[f32; 3]],
    (spp, seed): (u32, u64),
) -> Vec<f64> {
    let config = TraceConfig { spp, bounces: None, seed };
    let go_on = |_| ControlFlow::Continue(());
    let pixels = trace(scene, &scene.scene.cameras[0], film, coefficients, &config, &go_on).expect("nobody stops it");
    pixels.into_iter().map(|rgb| f64::from(rgb[1])).collect()
}

/// A bake in one pass.
pub(super) fn baked(scene: &Arc<PreparedScene>, film: Film, config: BakeConfig) -> Bake {
    let (camera, passes, irradiance) = (scene.scene.cameras[0].clone(), Passes::FinalOnly, Vec::new());
    let job = BakeJob { scene: scene.clone(), camera, film, config, passes, irradiance };
    job.run(|_| ControlFlow::Continue(())).expect("the job is valid").expect("nobody stops it")
}
