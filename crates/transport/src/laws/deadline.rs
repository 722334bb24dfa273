//! A bake within a time is whole at any time, and the whole bake if it has the time.

use std::ops::ControlFlow;
use std::sync::Arc;
use std::time::{Duration, Instant};

use glam::Vec3;

use super::stage::{Stage, lambert, room};
use crate::archive::{self, Restart};
use crate::bake::{Bake, BakeConfig, BakeError, BakeEvent, BakeJob, Indirect, Passes};
use crate::camera::{Camera, Film};
use crate::irradiance::IrradianceRows;

fn job(passes: Passes) -> BakeJob {
    let camera = Camera::look_at("eye", Vec3::new(0.5, 0.2, 0.8), Vec3::new(-1.0, -0.5, -1.0), 1.1, 4.0 / 3.0);
    let stage = Stage::new(camera).surface("walls", &room(Vec3::ONE), lambert(0.6, 0.0)).lamp(
        "lamp",
        Vec3::new(-0.6, 0.2, -0.1),
        0.5,
    );
    let scene = Arc::new(stage.prepared());
    let camera = scene.scene.cameras[0].clone();
    let config = BakeConfig { spp: 8, seed: 5, ..BakeConfig::default() };
    BakeJob { scene, camera, film: Film { width: 64, height: 48 }, config, passes, irradiance: Vec::new() }
}

fn baked(passes: Passes) -> Bake {
    job(passes).run(|_| ControlFlow::Continue(())).expect("the job is valid").expect("nobody stops it")
}

#[test]
fn with_time_enough_a_bake_is_as_without_a_limit() {
    let whole = baked(Passes::FinalOnly);
    let timed = baked(Passes::Until(Instant::now() + Duration::from_secs(3600)));
    assert_eq!(timed.header, whole.header);
    assert_eq!(timed.groups[0].blocks, whole.groups[0].blocks);
}

#[test]
fn while_the_light_that_pixels_share_is_found_it_is_asked_whether_to_go_on() {
    let mut n_asked = 0;
    let in_time = Passes::Until(Instant::now() + Duration::from_secs(3600));
    let stopped = job(in_time).run(|event| {
        n_asked += u32::from(matches!(event, BakeEvent::Progress { .. }));
        if matches!(event, BakeEvent::BlockDone { .. }) { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    });
    assert!(stopped.expect("the job is valid").is_none());
    // Behind each of 32 parts of the nodes, and before each of 5 stages of the light behind them.
    assert_eq!(n_asked, 32 + 5);
}

#[test]
fn nothing_is_written_down_of_a_bake_within_a_time_until_it_is_whole() {
    let folder = tempfile::tempdir().expect("there is room");
    let path = folder.path().join("a.transport");
    let in_time = Passes::Until(Instant::now() + Duration::from_secs(3600));
    let stopped = archive::bake_to_file(job(in_time), &path, Restart::Fresh, |event| {
        let is_of_last = matches!(event, BakeEvent::BlockDone { pass: 1, .. });
        if is_of_last { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    });
    assert!(stopped.expect("it can be written").is_none());
    let state = archive::part_state(&archive::part_of(&path)).expect("it was begun");
    assert_eq!((state.n_done, state.n_blocks), (0, 12), "no later bake can go on with it");
}

#[test]
fn a_bake_whose_time_is_up_keeps_what_it_has() {
    let mut blocks_of_pass = [0, 0];
    let late = job(Passes::Until(Instant::now())).run(|event| {
        if let BakeEvent::BlockDone { pass, .. } = event {
            blocks_of_pass[pass as usize] += 1;
        }
        ControlFlow::Continue(())
    });
    let late = late.expect("the job is valid").expect("nobody stops it");
    // The preview, and the one block of the next pass at which the time was seen to be up.
    assert_eq!(blocks_of_pass, [12, 1]);
    assert!(late.groups[0].blocks.iter().all(Option::is_some));
    assert!(late.header.sharing_bias.is_some_and(f32::is_finite), "light of a preview is shared");
    assert!(late.figures().error_db.total.is_finite());
    assert_eq!(
        (late.header.preview_blocks, late.figures().preview_blocks),
        (11, 11),
        "and it is told how many hold it"
    );
    assert!(baked(Passes::FinalOnly).header.grounds.is_some() && late.header.grounds.is_none());
}

#[test]
fn samples_that_a_time_left_out_were_not_needless() {
    let skipped = |passes| baked(passes).figures().skipped;
    let late = skipped(Passes::Until(Instant::now()));
    assert_eq!((late.converged_blocks, late.samples_saved), (0, 0.0));
    // With time enough they are told as of any bake.
    let in_time = skipped(Passes::Until(Instant::now() + Duration::from_secs(3600)));
    assert_eq!(in_time, skipped(Passes::FinalOnly));
}

#[test]
fn a_bake_without_bias_traces_every_block_once_even_if_its_time_is_up() {
    let job = job(Passes::Until(Instant::now()));
    let config = BakeConfig { spp: 16, denoise: false, smooth: false, ..job.config.clone() };
    let mut blocks_of_pass = [0, 0, 0];
    let late = BakeJob { config, ..job }.run(|event| {
        if let BakeEvent::BlockDone { pass, .. } = event {
            blocks_of_pass[pass as usize] += 1;
        }
        ControlFlow::Continue(())
    });
    let late = late.expect("the job is valid").expect("nobody stops it");
    // The one block of the last pass is that at which the time was seen to be up.
    assert_eq!(blocks_of_pass, [12, 12, 1]);
    assert_eq!((late.header.preview_blocks, late.header.sharing_bias), (0, None));
}

#[test]
fn a_bake_whose_time_is_up_follows_no_walks_for_the_next_pass() {
    let job = job(Passes::Until(Instant::now()));
    let config = BakeConfig { indirect: Indirect::Shared, ..job.config.clone() };
    let mut blocks_of_pass = [0, 0];
    let late = BakeJob { config, ..job }.run(|event| {
        if let BakeEvent::BlockDone { pass, .. } = event {
            blocks_of_pass[pass as usize] += 1;
        }
        ControlFlow::Continue(())
    });
    let figures = late.expect("the job is valid").expect("nobody stops it").figures();
    assert!(figures.error_db.total.is_finite());
    assert_eq!((blocks_of_pass, figures.preview_blocks), ([12, 0], 12));
}

#[test]
fn what_needs_a_pass_of_its_own_has_no_time_limit() {
    let job = BakeJob { irradiance: vec![IrradianceRows::Pixels], ..job(Passes::Until(Instant::now())) };
    let Err(BakeError::Config { what }) = job.run(|_| ControlFlow::Continue(())) else { panic!("it was accepted") };
    assert!(what.contains("irradiance"), "{what}");
}
