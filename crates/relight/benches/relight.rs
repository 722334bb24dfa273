//! Relighting, the whole job first and then its parts, on the CPU and on every device there is: by the own clock of hardware that
//! has one, which tells parts apart. What computes on our cores may note a moment before its work is done, so there a part is the
//! picture in which nothing else is due.
//!
//! `cargo bench -p clerestory-relight -- [FILTER]`, as in `relight/512x384/256/4/cpu`: size, columns, rank and what runs it.

use std::hint::black_box;
use std::time::{Duration, Instant};

use clerestory_relight::synthetic::{Ranks, Recipe};
use clerestory_relight::{
    CpuRelighter, DeviceChoice, DisplayParams, Frame, Gpu, GpuRelighter, Precision, Radiance, Relight, RelightError,
    encode,
};
use criterion::{BenchmarkId, Criterion, Throughput};

/// Width, height, columns, rank.
const JOBS: [[u32; 4]; 4] = [[512, 384, 256, 4], [1024, 768, 256, 8], [1024, 768, 1024, 8], [1920, 1080, 1024, 16]];
/// The largest for a device that is none.
const SOFTWARE_JOBS: usize = 1;
/// What a device keeps of a pixel, and shows of it.
const RADIANCE_BYTES: u64 = 16;
const SHOWN_BYTES: u64 = 4;

fn recipe([width, height, n_cols, rank]: [u32; 4]) -> Recipe {
    Recipe { width, height, tile: 16, n_cols: vec![n_cols], rank: Ranks::Fixed(rank), n_sparse: 0, ..Recipe::default() }
}

/// A frame of which every right factor is zero: projected in whole, and never expanded.
fn blind(recipe: &Recipe) -> Frame {
    let mut frame = recipe.frame();
    for block in frame.groups.iter_mut().flat_map(|group| group.blocks.iter_mut().flatten()) {
        let blind = clerestory_nystrom::BlockFactors::clone(block);
        let right = vec![half::f16::ZERO; blind.right.len()];
        *block = std::sync::Arc::new(clerestory_nystrom::BlockFactors { right, ..blind });
    }
    frame
}

/// Bytes of its right factors as halves.
fn right_bytes(frame: &Frame) -> u64 {
    let blocks = frame.groups.iter().flat_map(|group| group.blocks.iter().flatten());
    blocks.map(|block| 2 * block.right.len() as u64).sum()
}

/// A frame whose blocks say that they miss so much that bytes will do.
fn coarse(job: [u32; 4]) -> Frame {
    Recipe { truncation: f32::MAX, ..recipe(job) }.frame()
}

/// What one relight did.
struct Done {
    n_bytes: u64,
    /// What the device noted that it took; what is seen from outside counts where it noted nothing.
    within: Option<Duration>,
}

/// Runs a job under other coefficients each time: all of them others, or those of one light.
fn bench(
    criterion: &mut Criterion,
    (name, runner): (&str, &str),
    job: [u32; 4],
    n_changed: u32,
    mut relight: impl FnMut(&[Vec<[f32; 3]>]) -> Result<Done, RelightError>,
) {
    let [width, height, n_cols, rank] = job;
    let both = [recipe(job).coefficients(1), recipe(job).coefficients(2)];
    relight(&both[0]).expect("the frame fits");
    let mut x = both[1].clone();
    let n_bytes = relight(&x).expect("the frame fits").n_bytes;
    let mut group = criterion.benchmark_group(name);
    group.sample_size(10).throughput(Throughput::Bytes(n_bytes.max(1)));
    let mut turn = 0;
    group.bench_function(
        BenchmarkId::from_parameter(format!("{width}x{height}/{n_cols}/{rank}/{runner}")),
        |bencher| {
            bencher.iter_custom(|n_times| {
                let of_one = |_| {
                    turn += 1;
                    x[0][..n_changed as usize].copy_from_slice(&both[turn % 2][0][..n_changed as usize]);
                    let start = Instant::now();
                    let done = relight(black_box(&x)).expect("the frame fits");
                    done.within.unwrap_or_else(|| start.elapsed())
                };
                (0..n_times).map(of_one).sum()
            });
        },
    );
    group.finish();
}

fn on_cpu(criterion: &mut Criterion) {
    let radiance = &mut Radiance::default();
    for job in JOBS {
        let [.., n_cols, _] = job;
        let mut run = |name, frame: &Frame, job, n_changed| {
            let precision = Precision::ByError;
            let mut relighter =
                CpuRelighter::with_precision(frame, precision).expect("a synthetic frame fits together");
            bench(criterion, (name, "cpu"), job, n_changed, |x| {
                relighter.relight(x, radiance)?;
                Ok(Done { n_bytes: relighter.stats().n_bytes, within: None })
            });
        };
        let frame = recipe(job).frame();
        run("relight", &frame, job, n_cols);
        run("one light", &frame, job, 1);
        drop(frame);
        let frame = coarse(job);
        run("relight bytes", &frame, job, n_cols);
        run("one light bytes", &frame, job, 1);
        drop(frame);
        run("project", &blind(&recipe(job)), job, n_cols);
        let [width, height, _, rank] = job;
        let narrow = [width, height, 1, rank];
        run("expand", &recipe(narrow).frame(), narrow, 1);
        let mut group = criterion.benchmark_group("display");
        group.throughput(Throughput::Bytes(16 * radiance.pixels.len() as u64));
        group.bench_function(format!("{width}x{height}/cpu"), |bencher| {
            bencher.iter(|| encode(black_box(radiance), &DisplayParams::default()));
        });
        group.finish();
    }
}

fn on_device(criterion: &mut Criterion, gpu: &Gpu) {
    let (kind, n_jobs) = if gpu.is_software() { ("software", SOFTWARE_JOBS) } else { ("gpu", JOBS.len()) };
    let runner = &format!("{kind}-{}", gpu.api());
    for job in &JOBS[..n_jobs] {
        let [width, height, n_cols, rank] = *job;
        let mut display = DisplayParams::default();
        let mut run = |name, frame: &Frame, job, n_changed, ev_step: f32| {
            let precision = Precision::ByError;
            let mut relighter =
                GpuRelighter::with_precision(gpu, frame, precision).expect("a synthetic frame fits the device");
            if !gpu.is_software() {
                relighter.start_clock();
            }
            bench(criterion, (name, runner), job, n_changed, |x| {
                display.exposure_ev += ev_step;
                relighter.relight_to_texture(x, &display)?;
                gpu.wait()?;
                let clock = relighter.stage_secs()?;
                let n_pixels = u64::from(width) * u64::from(height);
                let (secs, n_bytes) = match name {
                    "project" => (clock.map(|clock| clock.project), right_bytes(frame)),
                    "expand" => (clock.map(|clock| clock.expand), n_pixels * (6 * u64::from(rank) + RADIANCE_BYTES)),
                    "display" => (clock.map(|clock| clock.display), n_pixels * (RADIANCE_BYTES + SHOWN_BYTES)),
                    _ => (clock.map(|clock| clock.whole), relighter.stats().n_bytes),
                };
                Ok(Done { n_bytes, within: secs.map(Duration::from_secs_f64) })
            });
        };
        run("relight", &recipe(*job).frame(), *job, n_cols, 0.0);
        run("one light", &recipe(*job).frame(), *job, 1, 0.0);
        run("relight bytes", &coarse(*job), *job, n_cols, 0.0);
        run("one light bytes", &coarse(*job), *job, 1, 0.0);
        run("project", &blind(&recipe(*job)), *job, n_cols, 0.0);
        let narrow = [width, height, 1, rank];
        run("expand", &recipe(narrow).frame(), narrow, 1, 0.0);
        run("display", &recipe(narrow).frame(), narrow, 0, 1e-6);
    }
}

fn main() {
    let mut criterion = Criterion::default().configure_from_args();
    on_cpu(&mut criterion);
    Gpu::all_headless(DeviceChoice::Any).iter().for_each(|gpu| on_device(&mut criterion, gpu));
    criterion.final_summary();
}
