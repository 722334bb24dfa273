//! Pictures of bakes, and plain renders, which they are held against.

use std::ops::ControlFlow;

use anyhow::{Context, Result};
use clerestory_nystrom::BlockLowRank;
use clerestory_relight::Radiance;
use clerestory_transport::bake::Bake;
use clerestory_transport::camera::Film;
use clerestory_transport::light::LightRig;
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

/// RGB of a bake under coefficients of each group's columns, row by row.
pub fn relit(bake: &Bake, coefficients: &[Vec<[f32; 3]>]) -> Vec<f32> {
    summed(bake, &bake.groups, coefficients)
}

/// The same under the light of the file, its sky as sharp as the camera sees it.
pub fn as_in_file(bake: &Bake) -> Vec<f32> {
    let rig = LightRig::default();
    summed(bake, &bake.groups_under(&rig), &bake.header.coefficients(&rig))
}

fn summed(bake: &Bake, groups: &[BlockLowRank], coefficients: &[Vec<[f32; 3]>]) -> Vec<f32> {
    let mut picture = vec![0.0; 3 * (bake.header.width * bake.header.height) as usize];
    for (group, coefficients) in groups.iter().zip(coefficients) {
        for channel in 0..3 {
            let light: Vec<f32> = coefficients.iter().map(|rgb| rgb[channel]).collect();
            let rows = group.apply(&light);
            picture.iter_mut().zip(rows).skip(channel).step_by(3).for_each(|(sum, value)| *sum += value);
        }
    }
    picture
}
