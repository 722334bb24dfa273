//! Laws of measured stacks: what the pictures hold comes back, to the error that was asked for.

use std::fs;
use std::path::{Path, PathBuf};

use exr::meta::attribute::Chromaticities;
use exr::prelude::{Image, SpecificChannels, Vec2, WritableImage};

use super::*;
use crate::archive::{self, ArchiveError, Restart};
use crate::bake::{SIDE, SIDES};
use crate::light::{LightRig, LightSetting};
use crate::matrix::CHANNELS;

const SIZE: [usize; 2] = [45, 37];
const N_LIGHTS: usize = 12;

/// A dim, smooth, colored light with an edge that moves from picture to picture.
fn value(light: usize, x: usize, y: usize, channel: usize) -> f32 {
    let at = (x as f32 / SIZE[0] as f32, y as f32 / SIZE[1] as f32);
    let angle = light as f32 * 0.5 + channel as f32 * 0.2;
    let smooth = 1.0 + (at.0 * angle.cos() * 3.0 + at.1 * angle.sin() * 2.0).sin();
    let edge = if (x + 2 * y) % N_LIGHTS == light { 0.5 } else { 0.0 };
    (smooth + edge) * 10f32.powi(light as i32 % 3)
}

fn write_light(folder: &Path, light: usize, value: impl Fn(usize, usize, usize) -> f32 + Sync) {
    let channels = SpecificChannels::rgb(|at: Vec2<usize>| {
        (value(at.x(), at.y(), 0), value(at.x(), at.y(), 1), value(at.x(), at.y(), 2))
    });
    Image::from_channels((SIZE[0], SIZE[1]), channels).write().to_file(path_of(folder, light)).unwrap();
}

fn path_of(folder: &Path, light: usize) -> PathBuf {
    folder.join(format!("light_{light}.exr"))
}

fn stack() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    (0..N_LIGHTS).for_each(|light| write_light(folder.path(), light, |x, y, channel| value(light, x, y, channel)));
    folder
}

fn job(folder: &Path, tolerance_db: f32) -> StackJob {
    let stack = Arc::new(ImageStack::open(folder).unwrap());
    StackJob { stack, tolerance_db, method: Method::default(), block: SIDE, seed: 7, memory_bytes: MEMORY_BYTES }
}

fn baked(job: StackJob) -> Bake {
    job.run(|_| ControlFlow::Continue(())).unwrap().expect("nobody asked to stop")
}

/// A channel of the picture under a rig.
fn relit(bake: &Bake, rig: &LightRig, channel: usize) -> Vec<f32> {
    let weights: Vec<f32> = bake.header.coefficients(rig)[0].iter().map(|rgb| rgb[channel]).collect();
    let rows = bake.groups[0].apply(&weights);
    rows.chunks_exact(CHANNELS).map(|rows| rows[channel]).collect()
}

/// Error of all pictures, each under its own light alone, dB below their peaks.
fn measured_db(bake: &Bake) -> f64 {
    let mut sum = 0.0f64;
    for light in 0..N_LIGHTS {
        let dark = LightSetting { muted: true, ..LightSetting::default() };
        let others = (0..N_LIGHTS).filter(|other| *other != light);
        let lights = others.map(|other| (format!("light_{other}"), dark)).collect();
        let rig = LightRig { lights, ..LightRig::default() };
        for channel in 0..CHANNELS {
            for (pixel, relit) in relit(bake, &rig, channel).into_iter().enumerate() {
                let (x, y) = (pixel % SIZE[0], pixel / SIZE[0]);
                let missed = (relit - value(light, x, y, channel)) * bake.header.column_scale[light];
                sum += f64::from(missed).powi(2);
            }
        }
    }
    -10.0 * (sum / (N_LIGHTS * CHANNELS * SIZE[0] * SIZE[1]) as f64).log10()
}

#[test]
fn every_picture_comes_back_to_the_error_that_was_asked_for() {
    let folder = stack();
    for tolerance_db in [25.0, 40.0, 60.0] {
        let bake = baked(job(folder.path(), tolerance_db));
        let error = bake.figures().error_db;
        let measured = measured_db(&bake);
        assert!(measured > f64::from(tolerance_db) - 0.3, "{measured} dB, {tolerance_db} dB were asked for");
        // Beyond that the rounding of the factors decides.
        let [of_pictures, told] = [measured, f64::from(error.total)].map(|db| db.min(70.0));
        assert!((of_pictures - told).abs() < 0.3, "{measured} dB, but told are {error:?}");
        assert!(error.noise >= 120.0 && error.sampling >= 100.0, "{error:?}");
        // The mean lies between the blocks.
        let (maps, spread) = (bake.error_maps(), bake.figures().block_error_db.total);
        assert_eq!((maps.width * maps.height) as usize, maps.total.len());
        assert!(maps.sampling.iter().chain(&maps.noise).all(Option::is_none), "nothing tells of the noise of pictures");
        let best = maps.total.iter().flatten().copied().fold(0.0, f32::max);
        assert!(spread.worst <= error.total && error.total <= best, "{spread:?} {error:?} {best}");
    }
}

#[test]
fn no_tolerance_has_a_stack_stored_more_finely_than_factors_of_16_bits_hold() {
    let folder = stack();
    let bake = baked(job(folder.path(), 110.0));
    let n_values = N_LIGHTS * CHANNELS * SIZE[0] * SIZE[1];
    let square = |i: usize| {
        let (light, channel, pixel) = (i % N_LIGHTS, i / N_LIGHTS % CHANNELS, i / (N_LIGHTS * CHANNELS));
        let scaled = value(light, pixel % SIZE[0], pixel / SIZE[0], channel) * bake.header.column_scale[light];
        f64::from(scaled).powi(2)
    };
    let mean_square = (0..n_values).map(square).sum::<f64>() / n_values as f64;
    let below = f64::from(bake.figures().error_db.total) + 10.0 * mean_square.log10();
    assert!((60.0..66.5).contains(&below), "{below} dB below the mean square, where the manual says up to 66");
}

#[test]
fn a_picture_far_darker_than_the_others_comes_back_as_well() {
    let folder = stack();
    let dark = |x: usize, y: usize, channel: usize| 1e-4 * value(0, x, y, channel);
    write_light(folder.path(), 0, dark);
    let bake = baked(job(folder.path(), 40.0));
    let muted = LightSetting { muted: true, ..LightSetting::default() };
    let lights = (1..N_LIGHTS).map(|other| (format!("light_{other}"), muted)).collect();
    let pixels = relit(&bake, &LightRig { lights, ..LightRig::default() }, 1);
    let sums = pixels.iter().enumerate().fold([0.0; 2], |sums, (pixel, relit)| {
        let wanted = dark(pixel % SIZE[0], pixel / SIZE[0], 1);
        [sums[0] + f64::from(relit - wanted).powi(2), sums[1] + f64::from(wanted).powi(2)]
    });
    let missing = (sums[0] / sums[1]).sqrt();
    assert!(missing < 0.05, "{missing} of a dark picture is missing");
}

/// The picture of one light alone, green.
fn alone(bake: &Bake, light: usize) -> Vec<f32> {
    let muted = LightSetting { muted: true, ..LightSetting::default() };
    let others = (0..N_LIGHTS).filter(|other| *other != light);
    let lights = others.map(|other| (format!("light_{other}"), muted)).collect();
    relit(bake, &LightRig { lights, ..LightRig::default() }, 1)
}

#[test]
fn a_hot_pixel_leaves_its_block_as_it_was() {
    let folder = stack();
    let hot = |x: usize, y: usize, channel: usize| if (x, y) == (20, 20) { 6e5 } else { value(0, x, y, channel) };
    write_light(folder.path(), 0, hot);
    let bake = baked(job(folder.path(), 40.0));
    for light in [0, 3] {
        for (pixel, relit) in alone(&bake, light).into_iter().enumerate() {
            let (x, y) = (pixel % SIZE[0], pixel / SIZE[0]);
            let wanted = if light == 0 { hot(x, y, 1) } else { value(light, x, y, 1) };
            assert!((relit - wanted).abs() < 0.1 + 1e-3 * wanted, "light {light} at {x}, {y}: {relit} for {wanted}");
        }
    }
}

#[test]
fn a_picture_that_is_mostly_below_black_counts_as_much_as_one_above() {
    let folder = stack();
    let below = |x: usize, y: usize, channel: usize| if (x, y) == (20, 20) { 1e-3 } else { -value(0, x, y, channel) };
    let above = baked(job(folder.path(), 40.0));
    write_light(folder.path(), 0, below);
    let bake = baked(job(folder.path(), 40.0));
    let [scale, of_positive] = [&bake, &above].map(|bake| bake.header.column_scale[0]);
    assert!((scale / of_positive - 1.0).abs() < 0.1, "{scale} is not {of_positive}");
    let told = bake.figures().column_error_db.expect("a stack tells");
    assert!(bake.figures().error_db.total > 39.7 && told.worst.iter().all(|light| light.db > 30.0), "{told:?}");
    assert!(bake.header.column_error[0] > 0.0);
}

#[test]
fn black_pictures_come_back_black() {
    let folder = stack();
    (2..N_LIGHTS).for_each(|light| write_light(folder.path(), light, |_, _, _| 0.0));
    let bake = baked(job(folder.path(), 40.0));
    for light in 2..N_LIGHTS {
        assert!(alone(&bake, light).iter().all(|x| *x == 0.0), "light {light} shows another one");
        assert_eq!(bake.header.column_error[light], 0.0, "light {light} counts");
    }
}

#[test]
fn a_rig_of_the_pictures_is_their_sum() {
    let folder = stack();
    let bake = baked(job(folder.path(), 50.0));
    let setting = |intensity, color| LightSetting { intensity, color, ..LightSetting::default() };
    let mut rig = LightRig::default();
    rig.lights.insert("light_2".into(), setting(3.0, Some([0.5, 0.25, 2.0])));
    rig.lights.insert("light_5".into(), LightSetting { muted: true, ..LightSetting::default() });
    let weight = |light: usize, channel: usize| match light {
        2 => 3.0 * [0.5f32, 0.25, 2.0][channel],
        5 => 0.0,
        _ => 1.0,
    };
    for (rig, weight) in [(&rig, &weight as &dyn Fn(usize, usize) -> f32), (&LightRig::default(), &|_, _| 1.0)] {
        for channel in 0..CHANNELS {
            for (pixel, relit) in relit(&bake, rig, channel).into_iter().enumerate() {
                let (x, y) = (pixel % SIZE[0], pixel / SIZE[0]);
                let sum: f32 = (0..N_LIGHTS).map(|light| weight(light, channel) * value(light, x, y, channel)).sum();
                assert!((relit - sum).abs() < 0.02 * sum, "{relit} {sum} at ({x}, {y})");
            }
        }
    }
}

#[test]
fn the_bytes_do_not_depend_on_memory_threads_or_being_stopped() {
    let folder = stack();
    let out = tempfile::tempdir().unwrap();
    let path = |name: &str| out.path().join(name);
    let to_file = |job: StackJob, name: &str, n_blocks: usize| {
        let mut n_left = n_blocks;
        let mut on_event = |event: BakeEvent| {
            n_left -= usize::from(matches!(event, BakeEvent::BlockDone { .. }));
            if n_left == 0 { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
        };
        let surveyed = job.survey(&mut |_: BakeEvent| ControlFlow::Continue(())).unwrap().unwrap();
        archive::stack_to_file(surveyed, &path(name), Restart::Resume, &mut on_event).unwrap().is_some()
    };
    assert!(to_file(job(folder.path(), 40.0), "whole", usize::MAX));
    let banded = || StackJob { memory_bytes: 1, ..job(folder.path(), 40.0) };
    assert_eq!(banded().bands(), [16..32, 0..16, 32..37]);
    let one_thread = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    assert!(one_thread.install(|| to_file(banded(), "banded", usize::MAX)));
    assert!(!to_file(banded(), "stopped", 4), "it was asked to stop");
    assert!(to_file(job(folder.path(), 40.0), "stopped", usize::MAX));
    let bytes = |name: &str| fs::read(path(name)).unwrap();
    assert!(bytes("whole") == bytes("banded") && bytes("whole") == bytes("stopped"));
    assert!(!archive::part_of(&path("stopped")).exists());

    let read = archive::read(&path("whole")).unwrap();
    assert!(read.header.basis.is_measured() && read.header.basis.sources[11].key == "light_11");
    assert_eq!(bytes("whole")[8..12], 4u32.to_le_bytes());
}

#[test]
fn blocks_of_any_side_hold_the_pictures_as_exactly_as_asked() {
    let folder = stack();
    for block in SIDES {
        let job = || StackJob { block, ..job(folder.path(), 40.0) };
        let bake = baked(job());
        assert_eq!((bake.header.tile, bake.header.config.block), (block, block));
        let n_blocks = SIZE[0].div_ceil(block as usize) * SIZE[1].div_ceil(block as usize);
        assert_eq!(bake.groups[0].blocks.iter().flatten().count(), n_blocks);
        let (measured, told) = (measured_db(&bake), f64::from(bake.figures().error_db.total));
        assert!(measured > 39.7 && (measured - told).abs() < 0.3, "{block}: {measured} dB, {told} dB told");
        let banded = baked(StackJob { memory_bytes: 1, ..job() });
        assert!(banded.groups[0].blocks == bake.groups[0].blocks, "{block}");
        // Of the usual side headers say what they always said.
        let told = serde_json::to_value(&bake.header.config).unwrap().get("block").cloned();
        assert_eq!(told, (block != SIDE).then(|| block.into()));
        let path = folder.path().join("a.transport");
        archive::write(&bake, &path).unwrap();
        let read = archive::read(&path).unwrap();
        assert!(read.header == bake.header && read.groups[0].blocks == bake.groups[0].blocks, "{block}");
    }
    let refused = StackJob { block: 12, ..job(folder.path(), 40.0) }.run(|_| ControlFlow::Continue(()));
    assert!(refused.unwrap_err().to_string().contains("8, 16 or 32 pixels"));
}

#[test]
fn a_row_of_blocks_that_fits_no_memory_is_refused() {
    let folder = stack();
    let job = job(folder.path(), 40.0);
    let least = (SIZE[0] * 16 * 12 * N_LIGHTS) as u64;
    assert!([None, Some(least)].into_iter().all(|there| job.check_memory(there).is_ok()));
    let refused = job.check_memory(Some(least - 1)).unwrap_err().to_string();
    assert!(refused.contains("16 rows of pixels of 12 pictures"), "{refused}");
}

#[test]
fn another_method_makes_the_factors_where_it_is_asked_for() {
    let folder = stack();
    let by = |method| baked(StackJob { method, ..job(folder.path(), 40.0) });
    let [ours, svd, kernel] = [Method::default(), Method::Svd, Method::KERNEL].map(by);
    assert_eq!(svd.header.config.method, Method::Svd);
    assert!(svd.groups[0].blocks != ours.groups[0].blocks);
    let (measured, told) = (measured_db(&svd), f64::from(svd.figures().error_db.total));
    assert!(measured > 39.7 && (measured - told).abs() < 0.3, "{measured} dB, {told} dB told");
    assert_eq!(kernel.figures().reconstruction.map(|of| of.method), Some(Method::KERNEL.to_string()));
    assert_eq!([ours, svd].map(|bake| bake.figures().reconstruction.is_some()), [false; 2]);
}

#[test]
fn a_half_done_bake_of_other_pictures_is_not_taken_up() {
    let folder = stack();
    let path = folder.path().join("a.transport");
    let survey = || job(folder.path(), 40.0).survey(&mut |_: BakeEvent| ControlFlow::Continue(())).unwrap().unwrap();
    let stop = |event: BakeEvent| match event {
        BakeEvent::BlockDone { .. } => ControlFlow::Break(()),
        _ => ControlFlow::Continue(()),
    };
    assert!(archive::stack_to_file(survey(), &path, Restart::Resume, stop).unwrap().is_none());
    write_light(folder.path(), 3, |_, _, _| 0.5);
    let error = archive::stack_to_file(survey(), &path, Restart::Resume, |_| ControlFlow::Continue(())).unwrap_err();
    assert!(matches!(error, BakeError::Archive(ArchiveError::OtherBake { .. })), "{error}");
    assert!(error.to_string().contains("the pictures have changed"), "{error}");
}

#[test]
fn a_picture_that_changes_while_it_is_baked_is_named() {
    let folder = stack();
    let banded = StackJob { memory_bytes: 1, ..job(folder.path(), 40.0) };
    let surveyed = banded.survey(&mut |_: BakeEvent| ControlFlow::Continue(())).unwrap().unwrap();
    write_light(folder.path(), 3, |_, _, _| 0.5);
    let header = Arc::new(surveyed.header.clone());
    let baked = surveyed.run_from(header, &[], &mut |_| ControlFlow::Continue(()));
    let error = baked.map(|baked| baked.is_some()).unwrap_err().to_string();
    assert!(error.contains("light_3.exr` was changed"), "{error}");
}

#[test]
fn values_without_a_number_are_refused_and_negative_ones_told() {
    let folder = stack();
    write_light(folder.path(), 1, |x, y, _| if (x, y) == (3, 5) { -1.0 } else { 1.0 });
    let survey = || job(folder.path(), 40.0).survey(&mut |_: BakeEvent| ControlFlow::Continue(()));
    let remarks = survey().unwrap().unwrap().remarks();
    assert!(remarks.len() == 1 && remarks[0].contains("3 values of its pixels are negative"), "{remarks:?}");
    write_light(folder.path(), 1, |x, y, _| if (x, y) == (3, 5) { f32::NAN } else { 1.0 });
    let error = survey().err().expect("a picture without numbers").to_string();
    assert!(
        error.contains("light_1.exr`: 1 of its pixels are infinite or no numbers, the first of them at (3, 5)"),
        "{error}"
    );
}

#[test]
fn what_is_odd_about_the_colors_of_pictures_is_told_once() {
    let folder = stack();
    for light in [2, 7] {
        let zero = Vec2(0.0, 0.0);
        let channels = SpecificChannels::rgb(|_: Vec2<usize>| (1.0f32, 1.0f32, 1.0f32));
        let mut image = Image::from_channels((SIZE[0], SIZE[1]), channels);
        image.attributes.chromaticities = Some(Chromaticities { red: zero, green: zero, blue: zero, white: zero });
        image.write().to_file(path_of(folder.path(), light)).unwrap();
    }
    let surveyed = job(folder.path(), 40.0).survey(&mut |_: BakeEvent| ControlFlow::Continue(()));
    let remarks = surveyed.unwrap().unwrap().remarks();
    assert!(remarks.len() == 1 && remarks[0].contains("2 of 12 pictures: its `chromaticities`"), "{remarks:?}");
}

#[test]
fn reading_can_be_stopped_and_black_pictures_are_columns_too() {
    let folder = stack();
    (0..N_LIGHTS).for_each(|light| write_light(folder.path(), light, |_, _, _| 0.0));
    let mut n_told = 0;
    let stopped = job(folder.path(), 40.0).run(|_| {
        n_told += 1;
        if n_told == 3 { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    });
    assert!(stopped.unwrap().is_none());
    let bake = baked(job(folder.path(), 40.0));
    assert!(relit(&bake, &LightRig::default(), 0).iter().all(|value| *value == 0.0));
}
