//! A bake by a method whose own form is no pair of factors holds what the method makes of each block.

use std::ops::ControlFlow;
use std::sync::Arc;

use clerestory_nystrom::BlockFactors;
use clerestory_nystrom::rivals::Method;
use glam::Vec3;

use super::stage::{Stage, lambert, quad, room};
use crate::bake::{Bake, BakeConfig, BakeEvent, BakeJob, Passes};
use crate::camera::{Camera, Film};
use crate::light::LightRig;

/// Blocks as a method made them, one of each group of columns.
type Made = Vec<(usize, Vec<Arc<BlockFactors>>)>;

/// A bake of a room under a panel, and what the method made for it.
fn baked(method: Method) -> (Bake, Made) {
    let camera = Camera::look_at("inside", Vec3::new(0.3, 0.1, 0.9), Vec3::new(-0.2, -0.3, -1.0), 1.1, 1.5);
    let scene = Stage::new(camera.clone())
        .surface("walls", &room(Vec3::new(1.0, 0.8, 1.2)), lambert(0.6, 0.0))
        .surface("table", &quad(Vec3::new(-0.4, -0.4, -0.4), Vec3::Z * 0.6, Vec3::X * 0.6), lambert(0.5, 0.0))
        .panel("panel", &quad(Vec3::new(-0.5, 0.75, -0.5), Vec3::X * 0.6, Vec3::Z * 0.6), 3.0, 6)
        .lamp("lamp", Vec3::new(-0.6, 0.5, 0.2), 1.0);
    let config = BakeConfig { spp: 16, tolerance_db: 20.0, method, ..BakeConfig::default() };
    let (scene, film) = (Arc::new(scene.prepared()), Film { width: 24, height: 16 });
    let job = BakeJob { scene, camera, film, config, passes: Passes::FinalOnly, irradiance: Vec::new() };
    let mut made = Made::new();
    let bake = job.run(|event| {
        if let BakeEvent::BlockDone { block_idx, factors, .. } = event {
            made.push((block_idx, factors));
        }
        ControlFlow::Continue(())
    });
    (bake.expect("the job is valid").expect("nobody stops it"), made)
}

/// Root of the energy of a difference over that of the first.
fn relative(a: &[f32], b: &[f32]) -> f64 {
    let energy = |values: &mut dyn Iterator<Item = f32>| values.map(|x| f64::from(x).powi(2)).sum::<f64>();
    let difference = energy(&mut a.iter().zip(b).map(|(a, b)| a - b));
    (difference / energy(&mut a.iter().copied()).max(f64::MIN_POSITIVE)).sqrt()
}

#[test]
fn the_picture_of_a_method_without_factors_is_that_of_what_it_makes() {
    for method in [Method::KERNEL, Method::CompressedSensing] {
        let (bake, made) = baked(method);
        let light = bake.header.coefficients(&LightRig::default());
        assert_eq!(made.len(), 2);
        for (block_idx, factors) in made {
            for ((group, made), light) in bake.groups.iter().zip(&factors).zip(&light) {
                let kept = group.blocks[block_idx].as_ref().expect("every block is there");
                let green: Vec<f32> = light.iter().map(|rgb| rgb[1]).collect();
                let [entries, picture] =
                    [relative(&made.dense(), &kept.dense()), relative(&made.apply(&green), &kept.apply(&green))];
                assert!(entries < 2e-3 && picture < 2e-3, "{method}, {block_idx}: {entries:e}, {picture:e}");
                // Errors are kept in few bits.
                let [made, kept] = [made, kept].map(|block| f64::from(block.error.truncation + block.error.sampling));
                assert!((kept / made - 1.0).abs() < 0.02, "{method}, {block_idx}: {kept:e}, {made:e}");
            }
        }
        assert_eq!(bake.figures().reconstruction.map(|of| of.method), Some(method.to_string()));
    }
    assert_eq!(baked(Method::Svd).0.figures().reconstruction, None);
}
