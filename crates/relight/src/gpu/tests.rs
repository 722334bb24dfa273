use super::chunk::ChunkLimits;
use super::*;
use crate::display::{ColorScale, Dither, Spacing, WhitePoint};
use crate::packing::Precision;
use crate::synthetic::{Ranks, Recipe};
use crate::{CpuRelighter, DisplayParams, Frame, Radiance, Relight, Tone, encode};

/// The device that tests share, or the word that there is none; with `CLERESTORY_REQUIRE_GPU` that is a failure. It stays to the end: drivers
/// for real cards come to a stop where many threads end while devices do.
pub(crate) fn gpu() -> Option<Gpu> {
    static SHARED: OnceLock<Result<Gpu, RelightError>> = OnceLock::new();
    match SHARED.get_or_init(|| Gpu::headless(DeviceChoice::Any)) {
        Ok(gpu) => Some(gpu.clone()),
        Err(error) => {
            assert_eq!(n_required(), 0, "{error}");
            println!("skipped: no adapter");
            None
        }
    }
}

/// A device that no other test has, to be lost or filled.
pub(super) fn own_gpu() -> Option<Gpu> {
    gpu().map(|_| Gpu::headless(DeviceChoice::Any).expect("it was there just now"))
}

/// So many devices must be there, as `CLERESTORY_REQUIRE_GPU` says; any number may be where it is not set.
pub(super) fn n_required() -> usize {
    std::env::var("CLERESTORY_REQUIRE_GPU").map_or(0, |number| number.parse().expect("a number of devices"))
}

pub(super) fn relit(relighter: &mut impl Relight, x: &[Vec<[f32; 3]>]) -> Radiance {
    let mut out = Radiance::default();
    relighter.relight(x, &mut out).unwrap();
    out
}

pub(super) fn assert_twins_agree(gpu: &mut GpuRelighter, frame: &Frame, x: &[Vec<[f32; 3]>]) {
    assert_precise_twins_agree(gpu, frame, Precision::Halves, x);
}

pub(super) fn assert_precise_twins_agree(
    gpu: &mut GpuRelighter,
    frame: &Frame,
    precision: Precision,
    x: &[Vec<[f32; 3]>],
) {
    let expected = relit(&mut CpuRelighter::with_precision(frame, precision).unwrap(), x);
    let found = relit(gpu, x);
    assert_eq!((found.width, found.height), (expected.width, expected.height));
    let largest = expected.pixels.as_flattened().iter().fold(0f32, |m, v| m.max(v.abs()));
    for (i, (a, b)) in found.pixels.as_flattened().iter().zip(expected.pixels.as_flattened()).enumerate() {
        assert!(
            (a - b).abs() <= 1e-3 * b.abs() + 1e-5 * largest && a.is_finite(),
            "entry {i}: {a} on the GPU, {b} on the CPU"
        );
    }
}

#[test]
fn gpu_and_cpu_agree_on_every_shape() {
    let Some(gpu) = gpu() else { return };
    let recipes = [
        Recipe::default(),
        Recipe { width: 1, height: 1, tile: 16, n_cols: vec![1], rank: Ranks::Fixed(1), ..Recipe::default() },
        Recipe { tile: 16, n_cols: vec![129, 1, 7], n_sparse: 40, seed: 5, ..Recipe::default() },
        Recipe { n_cols: vec![5, 0], rank: Ranks::Fixed(3), n_sparse: 0, seed: 3, ..Recipe::default() },
        Recipe { n_cols: vec![6], rank: Ranks::Fixed(0), seed: 6, ..Recipe::default() },
        Recipe { width: 200, height: 90, n_cols: vec![33], rank: Ranks::Mixed(9), seed: 7, ..Recipe::default() },
    ];
    for recipe in recipes {
        let frame = recipe.frame();
        let mut relighter = GpuRelighter::new(&gpu, &frame).unwrap();
        assert_twins_agree(&mut relighter, &frame, &recipe.coefficients(4));
    }
}

#[test]
fn chunks_of_any_size_give_the_same_picture() {
    let Some(gpu) = gpu() else { return };
    let recipe = Recipe { rank: Ranks::Mixed(20), ..Recipe::default() };
    let (frame, x) = (recipe.frame(), recipe.coefficients(2));
    let whole = relit(&mut GpuRelighter::new(&gpu, &frame).unwrap(), &x);
    for limits in [ChunkLimits { n_blocks: 3, n_bytes: 1 << 20 }, ChunkLimits { n_blocks: 64, n_bytes: 16384 }] {
        let mut relighter = GpuRelighter::with_limits(&gpu, &frame, (limits, Precision::Halves)).unwrap();
        assert_eq!(relit(&mut relighter, &x), whole);
    }
    let limits = ChunkLimits { n_blocks: 3, n_bytes: 256 };
    let too_small = GpuRelighter::with_limits(&gpu, &frame, (limits, Precision::Halves));
    assert!(matches!(too_small, Err(RelightError::TooLarge { .. })));
}

#[test]
fn changed_coefficients_and_blocks_show() {
    let Some(gpu) = gpu() else { return };
    let recipe = Recipe { n_cols: vec![19, 1, 40], ..Recipe::default() };
    let mut frame = recipe.frame();
    let limits = ChunkLimits { n_blocks: 4, ..ChunkLimits::of(&gpu.device.limits()) };
    let mut relighter = GpuRelighter::with_limits(&gpu, &frame, (limits, Precision::Halves)).unwrap();
    let mut x = recipe.coefficients(1);
    assert_twins_agree(&mut relighter, &frame, &x);
    x[2].fill([0.0; 3]);
    assert_twins_agree(&mut relighter, &frame, &x);
    assert_eq!(relighter.stats().n_dark_groups, 1);
    relit(&mut relighter, &x);
    assert_eq!(relighter.stats().n_expanded, 0, "nothing changed");

    x[2][7] = [3.0, 0.0, 1.0];
    let other = Recipe { seed: 8, ..recipe }.frame();
    for (group, block) in [(0, 3), (2, 9), (2, 0)] {
        frame.groups[group].blocks[block] = other.groups[group].blocks[block].clone();
    }
    frame.groups[0].blocks[5] = None;
    relighter.update(&frame, &[(0, 3), (2, 9), (2, 0), (0, 5)]).unwrap();
    assert_twins_agree(&mut relighter, &frame, &x);

    let larger = Recipe { width: 61, n_cols: vec![19, 1, 40], ..Recipe::default() }.frame();
    relighter.update(&larger, &[]).unwrap();
    assert_twins_agree(&mut relighter, &larger, &x);
}

#[test]
fn where_nothing_changed_nothing_is_submitted() {
    let Some(gpu) = gpu() else { return };
    let recipe = Recipe { n_cols: vec![300, 40], rank: Ranks::Fixed(3), n_sparse: 0, ..Recipe::default() };
    let mut relighter = GpuRelighter::new(&gpu, &recipe.frame()).unwrap();
    let (mut x, mut display) = (recipe.coefficients(1), DisplayParams::default());
    let mut n_submitted = |x: &[Vec<[f32; 3]>], display: &DisplayParams| {
        relighter.relight_to_texture(x, display).unwrap();
        (relighter.stats().n_submitted, relighter.stats().n_bytes > 0)
    };
    assert_eq!(n_submitted(&x, &display), (1, true));
    assert_eq!(n_submitted(&x, &display), (0, false));
    display.exposure_ev = 1.0;
    assert_eq!(n_submitted(&x, &display), (1, false), "another exposure is display alone");
    x[0][299] = [0.0; 3];
    assert_eq!(n_submitted(&x, &display), (1, true));
    assert_eq!(n_submitted(&x, &display), (0, false));
}

#[test]
fn a_group_that_moves_alone_is_the_only_one_read_and_only_by_its_changed_columns() {
    let Some(gpu) = gpu() else { return };
    let recipe = Recipe { n_cols: vec![300, 40, 200], rank: Ranks::Fixed(5), n_sparse: 0, ..Recipe::default() };
    let frame = recipe.frame();
    let n_blocks = frame.partition().n_blocks();
    let mut relighter = GpuRelighter::new(&gpu, &frame).unwrap();
    let mut x = recipe.coefficients(1);
    relit(&mut relighter, &x);
    assert_eq!(relighter.stats().n_expanded, 3 * n_blocks);
    x[0][150] = [4.0; 3];
    assert_twins_agree(&mut relighter, &frame, &x);
    assert_eq!(relighter.stats().n_expanded, 3 * n_blocks, "the others are summed once");
    let whole = relighter.stats().n_bytes;
    x[0][151] = [5.0; 3];
    assert_twins_agree(&mut relighter, &frame, &x);
    assert_eq!(relighter.stats().n_expanded, n_blocks);
    assert!(relighter.stats().n_bytes < whole / 2);
    x[2][3] = [0.5; 3];
    assert_twins_agree(&mut relighter, &frame, &x);
    assert_eq!(relighter.stats().n_expanded, 3 * n_blocks, "another group moves now");
}

/// Groups are summed in another order while some move; nothing else may differ.
pub(super) fn assert_ends_where_a_fresh_relight_does(
    gpu: &Gpu,
    frame: &Frame,
    relighter: &mut GpuRelighter,
    x: &[Vec<[f32; 3]>],
) {
    let fresh = relit(&mut GpuRelighter::new(gpu, frame).unwrap(), x);
    let found = relit(relighter, x);
    let largest = fresh.pixels.as_flattened().iter().fold(0f32, |m, v| m.max(v.abs()));
    for (a, b) in found.pixels.as_flattened().iter().zip(fresh.pixels.as_flattened()) {
        assert!((a - b).abs() <= 4.0 * f32::EPSILON * largest, "{a} after increments, {b} fresh");
    }
}

#[test]
fn ten_thousand_pictures_end_where_a_fresh_relight_does() {
    for gpu in super::twin_tests::gpus() {
        let recipe = Recipe { width: 20, height: 9, n_cols: vec![150, 9], rank: Ranks::Mixed(6), ..Recipe::default() };
        let frame = recipe.frame();
        let mut relighter = GpuRelighter::new(&gpu, &frame).unwrap();
        let mut x = recipe.coefficients(1);
        for step in 0..10_000usize {
            let (group, col) = if step % 97 == 0 { (1, step % 9) } else { (0, step * 7 % 150) };
            x[group][col] = [0.01 * (step % 331) as f32, 0.3, 0.02 * (step % 57) as f32];
            relighter.relight_to_texture(&x, &DisplayParams::default()).unwrap();
        }
        assert_ends_where_a_fresh_relight_does(&gpu, &frame, &mut relighter, &x);
    }
}

#[test]
fn ten_thousand_increments_of_groups_that_move_together_end_where_a_fresh_relight_does() {
    for gpu in super::twin_tests::gpus() {
        let n_cols = vec![150, 9, 4];
        let recipe = Recipe { width: 20, height: 9, n_cols, rank: Ranks::Mixed(6), ..Recipe::default() };
        let frame = recipe.frame();
        let display = DisplayParams { exposure_ev: -6.0, ..DisplayParams::default() };
        let mut relighter = GpuRelighter::new(&gpu, &frame).unwrap();
        let mut x = recipe.coefficients(1);
        let (mut n_alone, mut n_together) = (0, 0);
        for step in 0..5_000usize {
            // Two increments a picture; for a while one group moves alone.
            x[0][step * 7 % 150] = [0.01 * (step % 331) as f32, 0.3, 0.02 * (step % 57) as f32];
            if step % 1000 < 800 {
                x[1][step % 9][step % 3] += 1e-4;
            }
            relighter.relight_to_texture(&x, &display).unwrap();
            match relighter.stats().n_expanded / frame.partition().n_blocks() {
                0 => n_alone += 1,
                _ => n_together += 1,
            }
        }
        assert!(n_alone > 500 && n_together > 3000, "{n_alone} alone, {n_together} together");
        assert_ends_where_a_fresh_relight_does(&gpu, &frame, &mut relighter, &x);
    }
}

#[test]
fn tiles_without_content_in_the_first_group_that_moves_follow_the_others() {
    let Some(gpu) = gpu() else { return };
    let recipe = Recipe { n_cols: vec![19, 40, 7], rank: Ranks::Fixed(5), ..Recipe::default() };
    let mut frame = recipe.frame();
    (0..6).for_each(|block| frame.groups[0].blocks[block] = None);
    (4..9).for_each(|block| frame.groups[1].blocks[block] = None);
    let mut relighter = GpuRelighter::new(&gpu, &frame).unwrap();
    let mut x = recipe.coefficients(1);
    relit(&mut relighter, &x);
    for step in 1..4 {
        (x[0][3], x[1][7]) = ([step as f32; 3], [0.25, step as f32, 1.0]);
        assert_twins_agree(&mut relighter, &frame, &x);
    }
    // One of them goes dark, comes back, and moves alone.
    let lit = std::mem::replace(&mut x[0], vec![[0.0; 3]; 19]);
    assert_twins_agree(&mut relighter, &frame, &x);
    x[0] = lit;
    for step in 0..3 {
        x[0][3] = [0.5 * step as f32; 3];
        assert_twins_agree(&mut relighter, &frame, &x);
    }
}

#[test]
fn sparse_entries_of_lights_that_stayed_leave_their_tile_alone() {
    let Some(gpu) = gpu() else { return };
    let recipe = Recipe { n_cols: vec![16], rank: Ranks::Fixed(4), n_sparse: 0, ..Recipe::default() };
    let mut frame = recipe.frame();
    let block = std::sync::Arc::make_mut(frame.groups[0].blocks[1].as_mut().unwrap());
    (0..4).for_each(|k| block.right[k * 16 + 3] = half::f16::ZERO);
    block.sparse = vec![clerestory_nystrom::SparseEntry { row: 2, col: 9, value: 1.5 }];
    let mut relighter = GpuRelighter::new(&gpu, &frame).unwrap();
    let mut x = recipe.coefficients(1);
    assert_twins_agree(&mut relighter, &frame, &x);
    // Numbers that nobody computes stay where the tile is left alone.
    let [left, top, ..] = frame.groups[0].partition.rect(1);
    let pixel = u64::from(top * frame.width + left);
    let mark =
        |relighter: &GpuRelighter| gpu.queue.write_buffer(relighter.radiance(), 16 * pixel, &77f32.to_le_bytes());
    mark(&relighter);
    x[0][3] = [9.0; 3];
    assert_eq!(relit(&mut relighter, &x).pixels[pixel as usize][0], 77.0, "the light of the entry did not change");
    x[0][9] = [7.0; 3];
    assert_twins_agree(&mut relighter, &frame, &x);
}

#[test]
fn a_device_that_takes_time_tells_that_of_every_stage() {
    for gpu in super::twin_tests::gpus() {
        let recipe = Recipe { n_cols: vec![300, 40], ..Recipe::default() };
        let mut relighter = GpuRelighter::new(&gpu, &recipe.frame()).unwrap();
        assert_eq!(relighter.stage_secs().unwrap(), None);
        relighter.start_clock();
        let display = DisplayParams::default();
        relighter.relight_to_texture(&recipe.coefficients(1), &display).unwrap();
        let secs = relighter.stage_secs().unwrap();
        assert_eq!(secs.is_some(), gpu.takes_time());
        let Some(secs) = secs else { continue };
        assert!([secs.project, secs.gather, secs.expand, secs.display].iter().all(|secs| *secs > 0.0), "{secs:?}");
        relighter.relight_to_texture(&recipe.coefficients(1), &DisplayParams { exposure_ev: 1.0, ..display }).unwrap();
        let secs = relighter.stage_secs().unwrap().unwrap();
        assert!(secs.project == 0.0 && secs.expand == 0.0 && secs.whole == secs.display, "{secs:?}");
        relighter.relight_to_texture(&recipe.coefficients(1), &DisplayParams { exposure_ev: 1.0, ..display }).unwrap();
        assert_eq!(relighter.stage_secs().unwrap().unwrap().whole, 0.0, "nothing was submitted");
        relighter.stop_clock();
        assert_eq!(relighter.stage_secs().unwrap(), None);
    }
}

#[test]
fn display_agrees_within_one_step() {
    let Some(gpu) = gpu() else { return };
    let recipe = Recipe { width: 83, height: 61, rank: Ranks::Fixed(3), n_sparse: 9, ..Recipe::default() };
    let (frame, x) = (recipe.frame(), recipe.coefficients(2));
    let mut relighter = GpuRelighter::new(&gpu, &frame).unwrap();
    let radiance = relit(&mut CpuRelighter::new(&frame).unwrap(), &x);
    let mut assert_near = |params: DisplayParams| {
        relighter.relight_to_texture(&x, &params).unwrap();
        let (found, expected) = (relighter.read_texture().unwrap(), encode(&radiance, &params));
        assert_eq!(found.len(), expected.len());
        for (i, (a, b)) in found.iter().zip(&expected).enumerate() {
            assert!(a.abs_diff(*b) <= 1, "byte {i} at {params:?}: {a} on the GPU, {b} on the CPU");
        }
    };
    let warm = WhitePoint { kelvin: 2900.0, duv: -0.003 };
    for tone in Tone::ALL {
        for exposure_ev in [-6.0, -2.5, 3.0] {
            let plain = DisplayParams { tone, exposure_ev, ..DisplayParams::default() };
            assert_near(plain);
            assert_near(DisplayParams { white: Some(warm), dither: Dither::Ordered, ..plain });
        }
    }
    for spacing in [Spacing::Log, Spacing::Linear] {
        let scale = ColorScale { spacing, low: 0.5, high: 20.0 };
        assert_near(DisplayParams { false_color: Some(scale), ..DisplayParams::default() });
    }
}

#[test]
fn what_is_no_light_is_shown_alike() {
    let (nan, far) = (f32::NAN, f32::INFINITY);
    let colors =
        [[nan; 3], [far; 3], [-far; 3], [nan, 2.0, 1.0], [far, 0.5, 0.5], [3e38, 3e38, 1.0], [-3e38, 1.0, 1.0]];
    let scale = |spacing| Some(ColorScale { spacing, low: 0.5, high: 20.0 });
    let displays = || {
        let tones = Tone::ALL.map(|tone| DisplayParams { tone, ..DisplayParams::default() });
        let scales = [Spacing::Log, Spacing::Linear].map(scale);
        tones.into_iter().chain(scales.map(|false_color| DisplayParams { false_color, ..DisplayParams::default() }))
    };
    for gpu in super::twin_tests::gpus() {
        let recipe = Recipe { width: colors.len() as u32, height: 1, ..Recipe::default() };
        let mut relighter = GpuRelighter::new(&gpu, &recipe.frame()).unwrap();
        let radiance = Radiance { width: recipe.width, height: 1, pixels: colors.to_vec() };
        relit(&mut relighter, &recipe.coefficients(1));
        let texels = colors.map(|[r, g, b]| [r, g, b, 0.0]);
        gpu.queue.write_buffer(relighter.radiance(), 0, bytemuck::cast_slice(&texels));
        for display in displays() {
            relighter.relight_to_texture(&recipe.coefficients(1), &display).unwrap();
            let (found, expected) = (relighter.read_texture().unwrap(), encode(&radiance, &display));
            let near = found.iter().zip(&expected).all(|(a, b)| a.abs_diff(*b) <= 1);
            assert!(near, "{} at {display:?}: {found:?} instead of {expected:?}", gpu.description());
        }
    }
}

#[test]
fn a_frame_wider_than_a_texture_is_refused_in_words() {
    let Some(gpu) = gpu() else { return };
    let recipe = Recipe { width: 40_000, height: 1, n_cols: vec![1], rank: Ranks::Fixed(0), ..Recipe::default() };
    let error = GpuRelighter::new(&gpu, &recipe.frame()).unwrap_err();
    assert!(error.to_string().contains("40000"), "{error}");
}

#[test]
fn a_lost_device_is_an_error() {
    let Some(gpu) = own_gpu() else { return };
    let recipe = Recipe::default();
    let mut relighter = GpuRelighter::new(&gpu, &recipe.frame()).unwrap();
    relighter.relight_to_texture(&recipe.coefficients(2), &DisplayParams::default()).unwrap();
    assert!(!gpu.is_lost());
    gpu.device.destroy();
    // It is told once what was submitted before is done with.
    let _ = gpu.wait();
    assert!(gpu.is_lost());
    let lost = relighter.relight_to_texture(&recipe.coefficients(2), &DisplayParams::default());
    assert!(matches!(lost, Err(RelightError::Device(_))), "nothing is new, and still it is told");
    let lost = relighter.relight_to_texture(&recipe.coefficients(3), &DisplayParams::default());
    assert!(matches!(lost, Err(RelightError::Device(_))), "nothing is read back, and still it is told");
    let lost = relighter.relight(&recipe.coefficients(1), &mut Radiance::default());
    assert!(matches!(lost, Err(RelightError::Device(_))), "{lost:?}");
}

#[test]
fn gpu_and_cpu_agree_on_a_layer_in_radiance_and_on_the_display() {
    let Some(gpu) = gpu() else { return };
    let recipe = Recipe { width: 37, height: 21, n_cols: vec![9, 3], ..Recipe::default() };
    let (frame, x) = (recipe.frame(), recipe.coefficients(2));
    let (mut cpu, mut device) = (CpuRelighter::new(&frame).unwrap(), GpuRelighter::new(&gpu, &frame).unwrap());
    let layer = |seed: usize| {
        let value = |i: usize| ((i * 7919 + seed * 104_729) % 1000) as f32 / 1000.0;
        let pixels = (0..37 * 21).map(|i| [value(3 * i), value(3 * i + 1), value(3 * i + 2)]).collect();
        std::sync::Arc::new(Radiance { width: 37, height: 21, pixels })
    };
    let display = DisplayParams { tone: Tone::Linear, exposure_ev: -1.0, ..DisplayParams::default() };
    let (first, second) = (layer(1), layer(2));
    for layer in [Some(&first), None, Some(&second), Some(&first)] {
        cpu.set_layer(layer).unwrap();
        device.set_layer(layer).unwrap();
        let expected = relit(&mut cpu, &x);
        let found = relit(&mut device, &x);
        for (a, b) in found.pixels.as_flattened().iter().zip(expected.pixels.as_flattened()) {
            assert!((a - b).abs() <= 1e-3 * b.abs() + 1e-5, "{a} on the GPU, {b} on the CPU");
        }
        device.relight_to_texture(&x, &display).unwrap();
        let bytes = device.read_texture().unwrap();
        for (i, (a, b)) in bytes.iter().zip(encode(&expected, &display)).enumerate() {
            assert!(a.abs_diff(b) <= 1, "byte {i}: {a} on the GPU, {b} on the CPU");
        }
        device.set_layer(layer).unwrap();
        device.relight_to_texture(&x, &display).unwrap();
        assert_eq!(device.stats().n_submitted, 0, "the same layer again is nothing new");
    }
    let wrong = std::sync::Arc::new(Radiance::new(3, 3));
    assert!(matches!(device.set_layer(Some(&wrong)), Err(RelightError::LayerSize { .. })));
}
