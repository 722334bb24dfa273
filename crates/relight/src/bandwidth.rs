//! What memory can do at most, measured on the device that relights: the floor under every time.

use rayon::prelude::*;
use std::hint::black_box;
use std::time::Instant;

pub use crate::cpu::prefetch::prefetch;
use crate::gpu::clock::Stamps;
use crate::gpu::{Gpu, copy_pass};
use crate::relight::RelightError;

/// Bytes that one thread reads at a time.
const RUN_BYTES: usize = 256 << 10;
/// Places of a run that are read side by side.
const STREAMS: usize = 4;
/// Values that lie this far ahead are asked for where memory is.
const AHEAD: usize = 512;

/// Memory of ours to read from.
#[derive(Debug)]
pub struct ReadProbe(Vec<u64>);

impl ReadProbe {
    /// Takes so many bytes, one number at least, which should be many times what caches hold.
    pub fn new(n_bytes: usize) -> Self {
        Self((0..(n_bytes as u64 / 8).max(1)).into_par_iter().collect())
    }

    /// Reads the first `n_bytes`, or all there are, on all threads: in several streams, and in one with memory asked for ahead. Bytes per
    /// second of the faster. Few bytes come from caches, as they do for a job that moves as few.
    pub fn bytes_per_sec(&self, n_bytes: u64) -> f64 {
        let len = (n_bytes / 8).clamp(1, self.0.len() as u64) as usize;
        let values = &self.0[..len];
        let ways: [fn(&[u64]) -> u64; 2] = [in_streams, asked_ahead];
        let rate = |read: fn(&[u64]) -> u64| {
            let start = Instant::now();
            let sum = values.par_chunks(RUN_BYTES / 8).map(read).reduce(|| 0, |a, b| a ^ b);
            black_box(sum);
            size_of_val(values) as f64 / start.elapsed().as_secs_f64()
        };
        ways.map(rate).into_iter().fold(0.0, f64::max)
    }
}

/// From several places at once, each in as many sums as fill the registers.
fn in_streams(values: &[u64]) -> u64 {
    let n_lines = values.len() / STREAMS / 8;
    let (lines, rest) = values.split_at(STREAMS * 8 * n_lines);
    let streams: [_; STREAMS] = std::array::from_fn(|i| &lines.as_chunks::<8>().0[i * n_lines..][..n_lines]);
    let mut sums = [[0u64; 8]; STREAMS];
    for at in 0..n_lines {
        for (sums, stream) in sums.iter_mut().zip(&streams) {
            sums.iter_mut().zip(&stream[at]).for_each(|(sum, value)| *sum ^= value);
        }
    }
    sums.as_flattened().iter().chain(rest).fold(0, |sum, value| sum ^ value)
}

/// From one place on, with what comes later asked for before it is needed.
fn asked_ahead(values: &[u64]) -> u64 {
    let mut sums = [0u64; 16];
    let (lines, rest) = values.as_chunks::<16>();
    for (at, line) in lines.iter().enumerate() {
        prefetch(values.get(16 * at + AHEAD..16 * at + AHEAD + 16).unwrap_or_default());
        sums.iter_mut().zip(line).for_each(|(sum, value)| *sum ^= value);
    }
    sums.iter().chain(rest).fold(0, |sum, value| sum ^ value)
}

/// Memory of a device to copy.
#[derive(Debug)]
pub struct CopyProbe<'a> {
    gpu: &'a Gpu,
    n_bytes: u64,
    buffers: [wgpu::Buffer; 2],
    stage: wgpu::ComputePipeline,
    stamps: Option<Stamps>,
}

/// Copies in a row.
const COPIES: u32 = 8;

/// Bytes that a device reads and writes per second when it copies.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CopyRates {
    /// From handing over some copies in a row to their end, as the CPU sees it.
    pub from_outside: f64,
    /// From the begin of the first to the end of the last, as the device notes it; none where it takes no time.
    pub within: Option<f64>,
}

impl<'a> CopyProbe<'a> {
    /// Takes twice so many bytes of the device, fewer where it does not give as many.
    ///
    /// # Errors
    /// [`RelightError::Device`] where it is out of memory.
    pub fn new(gpu: &'a Gpu, n_bytes: u64) -> Result<Self, RelightError> {
        gpu.guarded(|| {
            let (n_bytes, buffers, stage) = copy_pass::prepare(gpu, n_bytes);
            Ok(Self { gpu, n_bytes, buffers, stage, stamps: Stamps::new(gpu, COPIES) })
        })
    }

    /// Copies some times, one after the other.
    ///
    /// # Errors
    /// [`RelightError::Device`] where the device fails.
    pub fn rates(&self) -> Result<CopyRates, RelightError> {
        let start = Instant::now();
        self.gpu.guarded(|| {
            copy_pass::run(self.gpu, &self.stage, &self.buffers, (COPIES, self.stamps.as_ref()));
            self.gpu.wait()
        })?;
        let (n_bytes, secs) = (2.0 * self.n_bytes as f64, start.elapsed().as_secs_f64());
        let rate = |secs: f64| n_bytes * f64::from(COPIES) / secs;
        let within = self.stamps.as_ref().map(|stamps| stamps.spans(self.gpu, COPIES)).transpose()?;
        Ok(CopyRates { from_outside: rate(secs), within: within.map(|spans| rate(spans.iter().sum())) })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gpu::tests::gpu;

    #[test]
    fn every_value_is_read_once() {
        // The exclusive or of these numbers misses any that is left out or read twice.
        for len in [0, 1, 15, 33, 4096 * 32, 4096 * 32 + 77] {
            let values: Vec<u64> = (0..len).map(|i: u64| (i + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15)).collect();
            let expected = values.iter().fold(0, |sum, value| sum ^ value);
            assert_eq!([in_streams(&values), asked_ahead(&values)], [expected; 2], "{len} values");
        }
        let probe = ReadProbe::new(3 << 20);
        assert!([1, 1 << 20, u64::MAX].iter().all(|n_bytes| probe.bytes_per_sec(*n_bytes) > 0.0));
    }

    #[test]
    fn the_copy_is_whole() {
        let Some(gpu) = gpu() else { return };
        let probe = CopyProbe::new(&gpu, 1 << 20).unwrap();
        let rates = probe.rates().unwrap();
        assert!(rates.from_outside > 0.0 && rates.within.is_some() == gpu.takes_time(), "{rates:?}");
        let copied = gpu.read_back(probe.n_bytes, |encoder, buffer| {
            encoder.copy_buffer_to_buffer(&probe.buffers[1], 0, buffer, 0, probe.n_bytes);
        });
        assert!(copied.unwrap() == copy_pass::content(probe.n_bytes), "the copy differs");
    }
}
