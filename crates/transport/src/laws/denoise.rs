//! Pixels that show the same surface tell each other: less error, the same light, and no bake that is asked for without bias.

use std::ops::ControlFlow;
use std::sync::Arc;

use clerestory_nystrom::BlockFactors;
use glam::Vec3;

use super::stage::{Stage, lambert, room};
use crate::bake::focus::Focus;
use crate::bake::{Bake, BakeConfig, BakeEvent, BakeJob, HalfDone, Passes};
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
    let [plain, smooth] = [false, true].map(|denoise| baked(job(2, denoise)));
    let truth = picture(&baked(job(128, false)));
    let error = |bake: &Bake| -> f64 {
        picture(bake).iter().zip(&truth).map(|(x, t)| f64::from(x - t).powi(2)).sum::<f64>() / truth.len() as f64
    };
    let (before, after) = (error(&plain), error(&smooth));
    assert!(after < 0.6 * before, "{before:e} {after:e}");
    let told = |bake: &Bake| bake.figures().error_db.total;
    assert!(told(&smooth) > told(&plain) + 2.0, "{} {}", told(&plain), told(&smooth));
    let mean = |bake: &Bake| picture(bake).iter().map(|x| f64::from(*x)).sum::<f64>();
    let off = mean(&smooth) / mean(&plain) - 1.0;
    assert!(off.abs() < 0.005, "{off}");
}

#[test]
fn each_block_comes_as_it_was_sampled_and_once_more_without_noise() {
    let (mut sampled, mut denoised) = (Vec::new(), Vec::new());
    let run = job(8, true).run(|event| {
        match event {
            BakeEvent::BlockDone { block_idx, factors, .. } => sampled.push((block_idx, factors[0].clone())),
            BakeEvent::Denoised { pass: 0, blocks } => {
                denoised.extend(blocks.into_iter().map(|(block_idx, factors)| (block_idx, factors[0].clone())));
            }
            BakeEvent::PassDone { .. } => {
                assert_eq!((sampled.len(), denoised.len()), (12, 12), "all of them, each once")
            }
            _ => {}
        }
        ControlFlow::Continue(())
    });
    run.expect("the job is valid").expect("nobody stops it");
    let mut n_plain = 0;
    let plain = job(8, false).run(|event| {
        if let BakeEvent::BlockDone { block_idx, factors, .. } = &event {
            let of = |blocks: &[(usize, Arc<BlockFactors>)]| -> Arc<BlockFactors> {
                blocks.iter().find(|(other, _)| other == block_idx).expect("each block comes").1.clone()
            };
            assert_eq!(of(&sampled), factors[0], "block {block_idx}");
            assert_ne!(of(&denoised), factors[0], "block {block_idx}");
            n_plain += 1;
        }
        assert!(!matches!(event, BakeEvent::Denoised { .. }));
        ControlFlow::Continue(())
    });
    plain.expect("the job is valid").expect("nobody stops it");
    assert_eq!(n_plain, 12);
}

/// What is asked for without bias is neither denoised nor smoothed: the samples are the same, and nothing is taken out of them.
#[test]
fn blocks_are_smoothed_unless_they_are_asked_for_as_they_are() {
    let with = |smooth: bool| {
        let job = job(4, false);
        baked(BakeJob { config: BakeConfig { smooth, ..job.config.clone() }, ..job })
    };
    let [plain, smooth] = [false, true].map(with);
    let both = plain.groups[0].blocks.iter().flatten().zip(smooth.groups[0].blocks.iter().flatten());
    let mut n_better = 0;
    for (plain, smooth) in both {
        assert_eq!(plain.error.noise, smooth.error.noise);
        n_better += usize::from(smooth.error.sampling < 0.9 * plain.error.sampling);
    }
    assert!(n_better > 6, "{n_better} of 12 blocks were smoothed");
    let told = |bake: &Bake| serde_json::to_value(&bake.header.config).unwrap().get("smooth").cloned();
    assert_eq!([told(&plain), told(&smooth)], [Some(false.into()), None]);
}

#[test]
fn lamps_that_are_not_kept_apart_are_counted() {
    let together = |n_lamps: usize, denoise: bool| {
        let job = job(2, denoise);
        let walls = Stage::new(job.camera.clone()).surface("walls", &room(Vec3::ONE), lambert(0.6, 0.0));
        let place = |nth: usize| Vec3::new(0.05 * nth as f32 - 0.8, 0.5, -0.3);
        let stage = (0..n_lamps).fold(walls, |stage, nth| stage.lamp(&format!("lamp {nth}"), place(nth), 1.0));
        let film = Film { width: 16, height: 12 };
        baked(BakeJob { scene: Arc::new(stage.prepared()), film, ..job }).figures().lamps_together
    };
    assert_eq!([together(32, true), together(33, true)], [0, 33]);
    assert_eq!([together(1, false), together(2, false)], [0, 2], "without denoising a rank takes out noise");
}

#[test]
fn a_bake_that_goes_on_is_denoised_as_one_that_was_never_stopped() {
    let whole = baked(job(8, true));
    let header = whole.header.clone();
    let mut blocks = Vec::new();
    let half = job(8, true).run(|event| {
        if let BakeEvent::BlockDone { block_idx, factors, .. } = event {
            blocks.push((block_idx, factors));
        }
        if blocks.len() < 7 { ControlFlow::Continue(()) } else { ControlFlow::Break(()) }
    });
    assert!(half.expect("the job is valid").is_none());
    let begun = HalfDone { header, blocks };
    let again = job(8, true).run_toward(&Focus::default(), Some(begun), |_| ControlFlow::Continue(()));
    let again = again.expect("the job is valid").expect("nobody stops it");
    assert_eq!(again.groups[0].blocks, whole.groups[0].blocks);
}
