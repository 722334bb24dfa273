//! Plain renders, which bakes are held against.

use std::ops::ControlFlow;

use anyhow::{Context, Result};
use clerestory_relight::Radiance;
use clerestory_transport::camera::Film;
use clerestory_transport::prepared::PreparedScene;
use clerestory_transport::trace::{TraceConfig, trace};

/// A path-traced picture by the first camera, under one RGB coefficient per column.
///
/// # Errors
/// None that is known: only who asks for a stop gets no picture.
pub fn rendered(scene: &PreparedScene, film: Film, light: &[[f32; 3]], config: &TraceConfig) -> Result<Radiance> {
    let go_on = |_: f32| ControlFlow::Continue(());
    let pixels = trace(scene, &scene.scene.cameras[0], film, light, config, &go_on);
    Ok(Radiance { width: film.width, height: film.height, pixels: pixels.context("nobody stops a render")? })
}
