//! What a device refuses: sizes beyond its limits, and memory that it does not have.

use super::relighter::device_bytes;
use super::tests::{assert_twins_agree, gpu, own_gpu, relit};
use super::*;
use crate::packing::Precision;
use crate::synthetic::{Ranks, Recipe};
use crate::{DisplayParams, Relight};

/// Every adapter whose driver gives devices, with some that keep to narrower limits than it has.
fn narrow(change: impl Fn(&mut wgpu::Limits)) -> Vec<Gpu> {
    let open = |adapter: &wgpu::Adapter| {
        let mut limits = adapter.limits();
        change(&mut limits);
        Gpu::open_within(adapter, limits).unwrap()
    };
    if gpu().is_none() {
        Vec::new()
    } else {
        adapters(DeviceChoice::Any).iter().filter(|adapter| Gpu::open(adapter).is_ok()).map(open).collect()
    }
}

fn recipe() -> Recipe {
    Recipe { width: 45, height: 41, n_cols: vec![200, 3], rank: Ranks::Mixed(24), ..Recipe::default() }
}

#[test]
fn a_frame_larger_than_a_binding_is_cut_and_a_device_that_checks_agrees() {
    let frame = recipe().frame();
    for n_bytes in [32_768, 40_000] {
        for gpu in narrow(|limits| {
            (limits.max_storage_buffer_binding_size, limits.max_buffer_size) = (n_bytes, n_bytes + 5000);
        }) {
            let mut relighter = GpuRelighter::new(&gpu, &frame).unwrap();
            let factors: u64 = device_bytes(&frame, Precision::Halves);
            assert!(factors > 8 * n_bytes, "nothing is cut: {factors} bytes");
            let mut x = recipe().coefficients(1);
            assert_twins_agree(&mut relighter, &frame, &x);
            x[0][150] = [2.0, 0.0, 1.0];
            assert_twins_agree(&mut relighter, &frame, &x);
        }
    }
}

#[test]
fn limits_that_no_cut_helps_against_are_told_in_words() {
    let frame = recipe().frame();
    type Narrowing = fn(&mut wgpu::Limits);
    let cases: [(Narrowing, &str); 4] = [
        (|limits| limits.max_storage_buffer_binding_size = 16_384, "the frame's radiance takes 29520"),
        (|limits| limits.max_storage_buffers_per_shader_stage = 6, "the number of buffers of a kernel takes 8"),
        (|limits| limits.max_texture_dimension_2d = 32, "the longer side of the frame takes 45"),
        (|limits| limits.max_compute_workgroups_per_dimension = 1, "the number of columns of a group takes 256"),
    ];
    for (change, words) in cases {
        for gpu in narrow(change) {
            let error = GpuRelighter::new(&gpu, &frame).unwrap_err();
            assert!(matches!(error, RelightError::TooLarge { .. }) && error.to_string().contains(words), "{error}");
            // It was asked before anything was made, so the device is as good as before.
            gpu.wait().unwrap();
            assert!(!gpu.is_lost());
        }
    }
}

#[test]
fn a_device_without_memory_says_so_and_works_once_it_has_some_again() {
    let Some(gpu) = own_gpu() else { return };
    let (recipe, frame) = (recipe(), recipe().frame());
    let x = recipe.coefficients(3);
    gpu.set_memory(DeviceMemory::Exhausted);
    assert_eq!(GpuRelighter::new(&gpu, &frame).unwrap_err(), RelightError::OutOfMemory);
    gpu.set_memory(DeviceMemory::Available);
    let mut relighter = GpuRelighter::new(&gpu, &frame).unwrap();
    assert_twins_agree(&mut relighter, &frame, &x);

    // Blocks and layers that come later need memory as well; light that moves does not.
    gpu.set_memory(DeviceMemory::Exhausted);
    relighter.relight_to_texture(&recipe.coefficients(4), &DisplayParams::default()).unwrap();
    let layer = std::sync::Arc::new(crate::Radiance::new(45, 41));
    assert_eq!(relighter.set_layer(Some(&layer)).unwrap_err(), RelightError::OutOfMemory);
    assert_eq!(relighter.update(&frame, &[(0, 3)]).unwrap_err(), RelightError::OutOfMemory);
    gpu.set_memory(DeviceMemory::Available);
    assert_twins_agree(&mut GpuRelighter::new(&gpu, &frame).unwrap(), &frame, &x);
    assert!(!gpu.is_lost());
}

#[test]
fn a_driver_that_gives_no_buffer_is_told_from_one_that_fails() {
    for gpu in Gpu::all_headless(DeviceChoice::Any) {
        // OpenGL counts bytes in 31 bits and so refuses what its limits allow; where a driver gives it, nothing is learned.
        let size = gpu.device.limits().max_buffer_size.min(1 << 31);
        let made = gpu.guarded(|| {
            let buffer = gpu.buffer("far too large", size, wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_DST);
            gpu.queue.write_buffer(&buffer, 0, &[0; 16]);
            Ok(())
        });
        assert!(made.is_ok() || made == Err(RelightError::OutOfMemory), "{}: {made:?}", gpu.description());
        let recipe = Recipe::default();
        relit(&mut GpuRelighter::new(&gpu, &recipe.frame()).unwrap(), &recipe.coefficients(1));
    }
}

#[test]
fn bytes_on_the_device_are_known_before_they_are_there() {
    let Some(gpu) = gpu() else { return };
    let large = Recipe { width: 190, height: 120, tile: 16, n_cols: vec![300, 7], ..Recipe::default() };
    for recipe in [recipe(), large] {
        let frame = recipe.frame();
        let (known, found) =
            (device_bytes(&frame, Precision::Halves), GpuRelighter::new(&gpu, &frame).unwrap().device_bytes());
        // Coefficients, parameters and the edges of buffers are left out.
        assert!(found >= known && found - known < 8192, "{known} known, {found} found");
    }
}
