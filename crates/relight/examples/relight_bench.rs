//! Milliseconds, bytes and bandwidth of relighting a synthetic frame on the CPU and on each kind of device.
//!
//! `cargo run --release -p clerestory-relight --example relight_bench -- [width height n_cols rank]`
#![expect(clippy::print_stdout, reason = "a program for people")]

use clerestory_relight::synthetic::{Ranks, Recipe};
use clerestory_relight::{
    CpuRelighter, DeviceChoice, DisplayParams, Frame, Gpu, GpuRelighter, Radiance, Relight, RelightError, encode,
};
use std::time::Instant;

const REPEATS: usize = 20;

fn main() -> Result<(), RelightError> {
    let args: Vec<u32> = std::env::args().skip(1).filter_map(|arg| arg.parse().ok()).collect();
    let [width, height, n_cols, rank] = <[u32; 4]>::try_from(args).unwrap_or([1024, 768, 256, 16]);
    let recipe = Recipe {
        width,
        height,
        tile: 16,
        n_cols: vec![n_cols],
        rank: Ranks::Fixed(rank),
        n_sparse: 0,
        ..Recipe::default()
    };
    let frame = recipe.frame();
    println!("{width} × {height} pixels, {n_cols} columns, rank {rank}, best of {REPEATS}");
    bench_cpu(&recipe, &frame)?;
    for choice in [DeviceChoice::Hardware, DeviceChoice::Software] {
        match Gpu::headless(choice) {
            Ok(gpu) => bench_gpu(&recipe, &frame, &gpu)?,
            Err(error) => println!("{error}"),
        }
    }
    Ok(())
}

fn bench_cpu(recipe: &Recipe, frame: &Frame) -> Result<(), RelightError> {
    println!("CPU, {} threads", rayon::current_num_threads());
    let mut relighter = CpuRelighter::new(frame)?;
    let mut radiance = Radiance::default();
    let ms = best_ms(|i| relighter.relight(&recipe.coefficients(i), &mut radiance))?;
    report("relight", ms, relighter.stats().n_bytes);
    let mut lamps = recipe.coefficients(0);
    let ms = best_ms(|i| {
        lamps[0][i as usize % 7 * recipe.n_cols[0] as usize / 7] = [i as f32; 3];
        relighter.relight(&lamps, &mut radiance)
    })?;
    report("one lamp", ms, relighter.stats().n_bytes);
    let ms = best_ms(|_| {
        std::hint::black_box(encode(&radiance, &DisplayParams::default()));
        Ok(())
    })?;
    report("display", ms, 16 * radiance.pixels.len() as u64);
    Ok(())
}

fn bench_gpu(recipe: &Recipe, frame: &Frame, gpu: &Gpu) -> Result<(), RelightError> {
    println!("{}", gpu.description());
    let start = Instant::now();
    let mut relighter = GpuRelighter::new(gpu, frame)?;
    gpu.wait()?;
    println!("  upload   {:8.2} ms", start.elapsed().as_secs_f64() * 1e3);
    let shown = best_ms(|i| {
        relighter.relight_to_texture(&recipe.coefficients(i), &DisplayParams::default())?;
        gpu.wait()
    })?;
    report("texture", shown, relighter.stats().n_bytes);
    let coefficients = recipe.coefficients(0);
    let display = best_ms(|_| {
        relighter.relight_to_texture(&coefficients, &DisplayParams::default())?;
        gpu.wait()
    })?;
    report("display", display, 20 * u64::from(frame.width) * u64::from(frame.height));
    let mut radiance = Radiance::default();
    let read = best_ms(|i| relighter.relight(&recipe.coefficients(i), &mut radiance))?;
    report("readback", read, relighter.stats().n_bytes);
    Ok(())
}

/// Shortest time of a job that is told its own number, after one run that does not count.
fn best_ms(mut job: impl FnMut(u64) -> Result<(), RelightError>) -> Result<f64, RelightError> {
    job(1000)?;
    let mut times = Vec::new();
    for i in 0..REPEATS {
        let start = Instant::now();
        job(i as u64)?;
        times.push(start.elapsed().as_secs_f64() * 1e3);
    }
    times.sort_by(f64::total_cmp);
    Ok(times[0])
}

fn report(name: &str, ms: f64, n_bytes: u64) {
    let (mega, giga_per_sec) = (n_bytes as f64 / 1e6, n_bytes as f64 / 1e6 / ms);
    println!("  {name:8} {ms:8.2} ms {mega:8.1} MB {giga_per_sec:8.1} GB/s");
}
