//! Hot loops of bakes that ask for vector instructions, each beside its safe twin, which is compiled for any machine of the kind. Whole
//! bakes are timed by the report.
//!
//! `cargo bench -p clerestory-transport -- [FILTER]`, as in `rows of a walk/vector`.

use clerestory_transport::patches::DEFAULT_PATCHES;
use clerestory_transport::patches::vector::{AT_ONCE, Link, STRIP, add_rows, plain, sums};
use clerestory_transport::sampler::uniform_hash;
use criterion::{Criterion, Throughput};
use half::bf16;

/// Patches, channels of each, and columns that stand for them.
const PATCHES: usize = DEFAULT_PATCHES as usize;
const CHANNELS: usize = 3;
const COLUMNS: usize = 512;
/// Rows that walks of a pixel meet, [`AT_ONCE`] at a time, and patches that those of a patch meet.
const MET_BY_PIXEL: usize = 256;
const MET_BY_PATCH: usize = 128;

/// Adds rows to another one.
type AddRows = fn(&mut [f32], [(f32, &[bf16]); AT_ONCE]);
/// Rows of a strip, and what is added to them.
type Sums = fn(&[[f32; STRIP]], &[Vec<Link>], &[[f32; STRIP]]) -> Vec<[f32; STRIP]>;

/// A number around 0.
fn number(key: usize) -> f32 {
    uniform_hash(key as u64) - 0.5
}

/// A place below an end.
fn place(key: usize, end: usize) -> usize {
    (uniform_hash(key as u64) * end as f32) as usize
}

/// What a pixel takes of a table that no cache close to the processor holds.
fn rows_of_walks(criterion: &mut Criterion) {
    let n_rows = PATCHES * CHANNELS;
    let table: Vec<bf16> = (0..n_rows * COLUMNS).map(|key| bf16::from_f32(number(key))).collect();
    let met = |first: usize| std::array::from_fn(|nth| (number(first + nth), place(first + nth, n_rows)));
    let met: Vec<[(f32, usize); AT_ONCE]> = (0..MET_BY_PIXEL).step_by(AT_ONCE).map(met).collect();
    let ways: [(&str, AddRows); 2] = [("vector", add_rows), ("plain", plain::add_rows)];
    let mut group = criterion.benchmark_group("rows of a walk");
    group.throughput(Throughput::Bytes((MET_BY_PIXEL * COLUMNS * size_of::<bf16>()) as u64));
    for (name, add_rows) in ways {
        let mut out = vec![0.0; COLUMNS];
        group.bench_function(name, |bencher| {
            bencher.iter(|| {
                for &rows in &met {
                    add_rows(&mut out, rows.map(|(weight, row)| (weight, &table[row * COLUMNS..][..COLUMNS])));
                }
                out[0]
            });
        });
    }
    group.finish();
}

/// A bounce between all patches, of a strip of the lamps that are learned from.
fn sums_of_a_bounce(criterion: &mut Criterion) {
    let row = |patch: usize| std::array::from_fn(|nth| number(patch * STRIP + nth));
    let strip: Vec<[f32; STRIP]> = (0..PATCHES).map(row).collect();
    let link = |key: usize| (place(key, PATCHES) as u32, number(key));
    let links = |patch: usize| (0..MET_BY_PATCH).map(|nth| link(patch * MET_BY_PATCH + nth)).collect();
    let links: Vec<Vec<Link>> = (0..PATCHES).map(links).collect();
    let ways: [(&str, Sums); 2] = [("vector", sums), ("plain", plain::sums)];
    let mut group = criterion.benchmark_group("sums of a bounce");
    group.sample_size(10).throughput(Throughput::Elements((PATCHES * MET_BY_PATCH * STRIP) as u64));
    for (name, sums) in ways {
        group.bench_function(name, |bencher| bencher.iter(|| sums(&strip, &links, &strip)));
    }
    group.finish();
}

fn main() {
    let mut criterion = Criterion::default().configure_from_args();
    rows_of_walks(&mut criterion);
    sums_of_a_bounce(&mut criterion);
    criterion.final_summary();
}
