//! Pixels that show the same surface tell each other: less error, the same light, and no bake that is asked for without bias.

use std::ops::ControlFlow;
use std::sync::Arc;

use glam::Vec3;

use super::stage::{Stage, lambert, room};
use crate::bake::{Bake, BakeConfig, BakeEvent, BakeJob, Passes};
use crate::camera::{Camera, Film};

fn job(spp: u32, denoise: bool) -> BakeJob {
    let camera = Camera::look_at("eye", Vec3::new(0.5, 0.2, 0.8), Vec3::new(-1.0, -0.5, -1.0), 1.1, 4.0 / 3.0);
    let block = [[-0.9, -0.2, -0.2], [-0.3, -0.2, -0.2], [-0.6, -0.2, -0.7]].map(Vec3::from_array);
    let ceiling = [[-0.4, 0.99, -0.4], [0.4, 0.99, -0.4], [0.4, 0.99, 0.4], [-0.4, 0.99, 0.4]].map(Vec3::from_array);
    let [a, b, c, d] = ceiling;
    let scene = Stage::new(camera)
        .surface("walls", &room(Vec3::ONE), lambert(0.6, 0.0))
        .surface("shade", &block, lambert(0.3, 0.0))
        .panel("panel", &[a, b, c, a, c, d], 1.0, 4)
        .prepared();
    let camera = scene.scene.cameras[0].clone();
    let config = BakeConfig { spp, tolerance_db: 60.0, seed: 5, denoise, ..BakeConfig::default() };
    let (film, passes) = (Film { width: 64, height: 48 }, Passes::FinalOnly);
    BakeJob { scene: Arc::new(scene), camera, film, config, passes, irradiance: Vec::new() }
}

fn baked(job: BakeJob) -> Bake {
    job.run(|_| ControlFlow::Continue(())).expect("the job is valid").expect("nobody stops it")
}

/// The picture under the light of the file, one value per row.
fn picture(bake: &Bake) -> Vec<f32> {
    let light = bake.header.basis.file_light(&bake.header.column_scale);
    bake.groups[0].apply(&light)
}

#[test]
fn a_denoised_bake_has_less_error_and_as_much_light() {
    let [plain, smooth] = [false, true].map(|denoise| baked(job(8, denoise)));
    let truth = picture(&baked(job(512, false)));
    let error = |bake: &Bake| -> f64 {
        picture(bake).iter().zip(&truth).map(|(x, t)| f64::from(x - t).powi(2)).sum::<f64>() / truth.len() as f64
    };
    let (before, after) = (error(&plain), error(&smooth));
    assert!(after < 0.4 * before, "{before:e} {after:e}");
    let told = |bake: &Bake| bake.figures().error_db.total;
    assert!(told(&smooth) > told(&plain) + 2.0, "{} {}", told(&plain), told(&smooth));
    let mean = |bake: &Bake| picture(bake).iter().map(|x| f64::from(*x)).sum::<f64>();
    let off = mean(&smooth) / mean(&plain) - 1.0;
    assert!(off.abs() < 0.005, "{off}");
}

#[test]
fn blocks_come_as_they_were_sampled_and_the_whole_picture_without_noise_at_the_end() {
    let (mut sampled, mut denoised) = (Vec::new(), Vec::new());
    let run = job(8, true).run(|event| {
        match event {
            BakeEvent::BlockDone { block_idx, factors, .. } => sampled.push((block_idx, factors[0].clone())),
            BakeEvent::Denoised { pass, groups } => denoised.push((pass, groups)),
            BakeEvent::PassDone { .. } => {
                assert_eq!(denoised.len(), 1, "noise is taken out before a pass is told to be done")
            }
            _ => {}
        }
        ControlFlow::Continue(())
    });
    run.expect("the job is valid").expect("nobody stops it");
    let plain = job(8, false).run(|event| {
        if let BakeEvent::BlockDone { block_idx, factors, .. } = &event {
            let same = sampled.iter().find(|(sampled, _)| sampled == block_idx).expect("each block comes");
            assert_eq!(same.1, factors[0], "block {block_idx}");
        }
        assert!(!matches!(event, BakeEvent::Denoised { .. }));
        ControlFlow::Continue(())
    });
    plain.expect("the job is valid").expect("nobody stops it");
    let (pass, groups) = denoised.remove(0);
    assert_eq!((pass, groups.len()), (0, 1));
    let changed = |(block_idx, sampled): &&(usize, Arc<_>)| groups[0].blocks[*block_idx].as_ref() != Some(sampled);
    assert_eq!(sampled.iter().filter(changed).count(), sampled.len());
}
