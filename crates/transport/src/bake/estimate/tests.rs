use glam::Vec3;

use super::*;
use crate::bake::floor::job;
use crate::bake::{BakeConfig, Density};
use crate::camera::{Camera, Film};
use crate::laws::stage::{Stage, lambert, quad, room};

const LONG: Duration = Duration::from_secs(600);

#[test]
fn where_every_block_is_tried_sizes_are_those_of_the_bake() {
    let job = job(Film { width: 64, height: 48 });
    let estimate = job.estimate(LONG, &Focus::default()).unwrap().unwrap();
    assert_eq!((estimate.n_blocks, estimate.n_tried), (12, 12));
    let bake = BakeJob { passes: Passes::FinalOnly, ..job }.run(|_| ControlFlow::Continue(())).unwrap().unwrap();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.transport");
    crate::archive::write(&bake, &path).unwrap();
    let file = std::fs::metadata(&path).unwrap().len() as f64;
    let off = (estimate.file_bytes as f64 - file).abs() / file;
    assert!(off < 0.02, "{} bytes, not {file}", estimate.file_bytes);
    assert!(estimate.memory_bytes >= bake.figures().bytes as u64);
    assert!(estimate.secs > estimate.preview_secs && estimate.preview_secs > 0.0);
}

#[test]
fn a_part_of_the_blocks_stands_for_all_of_them() {
    let job = job(Film { width: 128, height: 128 });
    let n_tried = BLOCKS.max(BLOCKS_PER_THREAD * rayon::current_num_threads());
    let estimate = job.estimate(LONG, &Focus::default()).unwrap().unwrap();
    assert_eq!((estimate.n_blocks, estimate.n_tried), (64, n_tried.min(64)));
    let whole = BakeJob { passes: Passes::FinalOnly, ..job };
    let bytes = whole.run(|_| ControlFlow::Continue(())).unwrap().unwrap().figures().file_bytes.unwrap() as f64;
    let header = estimate.file_bytes as f64 - bytes;
    assert!(header > -0.25 * bytes, "{} bytes for {bytes} of factors", estimate.file_bytes);
    let factors = estimate.result_bytes as f64;
    assert!(factors > 0.0 && estimate.memory_bytes as f64 >= factors);
}

#[test]
fn cells_behind_shared_light_count_in_the_memory() {
    let camera = Camera::look_at("eye", Vec3::new(0.5, 0.2, 0.8), Vec3::new(-1.0, -0.5, -1.0), 1.1, 4.0 / 3.0);
    let panel = quad(Vec3::new(-0.5, 0.9, -0.5), Vec3::X, Vec3::Z);
    let stage = Stage::new(camera.clone()).surface("walls", &room(Vec3::ONE), lambert(0.6, 0.0));
    let scene = Arc::new(stage.panel("panel", &panel, 1.0, 16).prepared());
    let (film, passes) = (Film { width: 32, height: 24 }, Passes::FinalOnly);
    let config = BakeConfig { spp: 4, tolerance_db: 20.0, indirect: Indirect::Shared, ..BakeConfig::default() };
    let job = BakeJob { scene, camera, film, config, passes, irradiance: Vec::new() };
    let focus = Focus::default();
    let header = job.header().unwrap();
    let plan = job.plan(Density::Full, &header);
    let (matrix, _) = job.scaled_matrix(&plan, &header, &focus);
    let how = job.config.indirect.nodes(Some(2), job.config.tolerance_db).expect("its pixels share light");
    let shared = Nodes::gather(&matrix, how, || ControlFlow::Continue(())).unwrap().n_bytes() as u64;
    assert!(shared > job.shared_bytes() + 1_000_000, "{shared} bytes in all, {} in nodes", job.shared_bytes());
    let estimate = job.estimate(LONG, &focus).unwrap().unwrap();
    let told = estimate.least_memory_bytes;
    assert!(told >= job.thread_bytes() + shared, "{told} bytes, {shared} of them shared");
}

#[test]
fn nobody_waits_for_an_estimate_that_is_not_wanted_any_more() {
    let (job, focus) = (job(Film { width: 64, height: 48 }), Focus::default());
    assert!(job.estimate(LONG, &focus).unwrap().is_some());
    focus.leave();
    assert_eq!(job.estimate(LONG, &focus).unwrap(), None);
}

#[test]
fn blocks_that_are_tried_lie_all_over_the_picture_and_none_twice() {
    let mut blocks = spread(1200, 48);
    assert_eq!(blocks.len(), 48);
    blocks.sort_unstable();
    let widest = blocks.windows(2).map(|pair| pair[1] - pair[0]).max().unwrap();
    assert!(blocks.windows(2).all(|pair| pair[0] < pair[1]) && widest < 60, "{blocks:?}");
    let mut all = spread(5, 48);
    all.sort_unstable();
    assert_eq!(all, [0, 1, 2, 3, 4]);
}

#[test]
fn what_is_done_once_is_not_counted_for_every_block() {
    let started = Instant::now();
    let watch = Watch { started, prepared_secs: 3.0, last_secs: 5.0, n_done: 10 };
    let under_way = (rayon::current_num_threads() as f32 - 1.0) / 2.0;
    let blocks = 2.0 * 100.0 / (10.0 + under_way);
    assert!((watch.secs_for(100, Scales::Blocks) - (3.0 + blocks)).abs() < 1e-3);
    assert!((watch.secs_for(100, Scales::Everything) - 2.5 * blocks).abs() < 1e-3);
}
