//! What compressing costs beside tracing.

use anyhow::Result;
use clerestory_nystrom::{BlockSamples, Half, Partition, SampledMatrix, compress_block};
use clerestory_transport::camera::Film;
use clerestory_transport::matrix::CHANNELS;

use super::coded::single_threaded;
use super::traced::{compression, with_matrix};
use crate::desk::Desk;
use crate::matrix::process_cpu_secs;

const FILM: Film = Film { width: 512, height: 384 };
/// Texels along a side of the panel.
const SIDE: u32 = 16;
const TOLERANCE_DB: f64 = 40.0;
/// Of the walks.
const SEED: u64 = 1;
/// Every so manyth block is measured.
const STEP: usize = 60;
/// Times that a block is compressed: CPU time is counted in hundredths of a second, and one block takes a thousandth.
const TIMES: u32 = 20;

/// A paragraph, and the share of the time to trace, the worst of the scenes.
///
/// # Errors
/// If a scene cannot be loaded, or this system does not tell the CPU time of a process.
pub fn write(desk: &Desk) -> Result<(String, f64)> {
    let spp = desk.choose(8, 32);
    let mut text = format!(
        "\n### Time to compress beside time to trace\n\n\
         One block in {STEP} of {} × {} pixels, {spp} samples per pixel and half, CPU milliseconds of one core per block, asked for {TOLERANCE_DB} dB, walks of seed {SEED}. Compressing is one look at all samples, done {TIMES} times and told by the mean, as CPU time is counted in hundredths of a second; bakes also look at fewer samples before. Bytes are not made in it.\n\n\
         | scene | tracing | compressing | share |\n|---|---|---|---|\n",
        FILM.width, FILM.height
    );
    let mut worst = 0.0f64;
    for name in ["diffuse", "mixed"] {
        desk.say(&format!("tracing and compressing blocks of {name}"));
        let [tracing, compressing] = single_threaded(|| measured(desk, name, spp))??;
        worst = worst.max(compressing / tracing);
        text += &format!("| {name} | {tracing:.0} | {compressing:.1} | {:.1} % |\n", 100.0 * compressing / tracing);
    }
    Ok((text, worst))
}

/// Of the seconds in which some blocks are traced once and compressed [`TIMES`] times: tracing, compressing.
fn millis_per_block([tracing, compressing]: [f64; 2], n_blocks: usize) -> [f64; 2] {
    [tracing, compressing / f64::from(TIMES)].map(|secs| 1e3 * secs / n_blocks as f64)
}

/// Milliseconds per block: tracing, compressing.
fn measured(desk: &Desk, name: &str, spp: u32) -> Result<[f64; 2]> {
    with_matrix(desk, (name, SIDE), (FILM, SEED), |matrix| {
        let n_cols = matrix.n_cols();
        let partition = Partition { width: FILM.width, height: FILM.height, tile: 16 };
        let config = compression(&partition, n_cols, TOLERANCE_DB, 1.0);
        let (mut secs, mut pixels) = ([0.0; 2], Vec::new());
        let blocks: Vec<usize> = (STEP / 2..partition.n_blocks()).step_by(STEP).collect();
        for &block_idx in &blocks {
            partition.bundles(block_idx, &mut pixels);
            let begun = process_cpu_secs()?;
            let halves = [Half::A, Half::B].map(|half| {
                let mut rows = vec![0.0; pixels.len() * CHANNELS * n_cols];
                matrix.add_rows(&pixels, 0..spp, half, &mut rows, &mut Vec::new());
                rows
            });
            let traced = process_cpu_secs()?;
            let halves = halves.each_ref().map(Vec::as_slice);
            let samples = BlockSamples { halves, sparse: [&[]; 2], n_cols, bundle_len: CHANNELS, n_samples: [spp; 2] };
            for _ in 0..TIMES {
                std::hint::black_box(compress_block(&samples, &config, block_idx as u32)?);
            }
            secs[0] += traced - begun;
            secs[1] += process_cpu_secs()? - traced;
        }
        Ok(millis_per_block(secs, blocks.len()))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn seconds_of_compressing_are_those_of_one_time() {
        assert_eq!(millis_per_block([2.0, 0.2], 4), [500.0, 2.5]);
    }
}
