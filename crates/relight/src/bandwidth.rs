//! What memory can do at most, measured on the device that relights: the floor under every time.

use rayon::prelude::*;
use std::hint::black_box;
use std::time::Instant;

use crate::gpu::{Gpu, copy_pass};
use crate::relight::RelightError;

/// Bytes that one thread sums up at a time.
const RUN_BYTES: usize = 1 << 20;

/// Memory of ours to read from.
#[derive(Debug)]
pub struct ReadProbe(Vec<u64>);

impl ReadProbe {
    /// Takes so many bytes, which should be many times what caches hold.
    pub fn new(n_bytes: usize) -> Self {
        Self((0..n_bytes as u64 / 8).into_par_iter().collect())
    }

    /// Reads all of it once, on all threads; bytes per second.
    pub fn bytes_per_sec(&self) -> f64 {
        let start = Instant::now();
        let sum = self.0.par_chunks(RUN_BYTES / 8).map(sum).reduce(|| 0, u64::wrapping_add);
        black_box(sum);
        (8 * self.0.len()) as f64 / start.elapsed().as_secs_f64()
    }
}

/// In as many sums as it takes to keep loads under way.
fn sum(values: &[u64]) -> u64 {
    let mut sums = [0u64; 32];
    for values in values.as_chunks::<32>().0 {
        sums.iter_mut().zip(values).for_each(|(sum, value)| *sum = sum.wrapping_add(*value));
    }
    sums.into_iter().fold(0, u64::wrapping_add)
}

/// Memory of a device to copy.
#[derive(Debug)]
pub struct CopyProbe<'a> {
    gpu: &'a Gpu,
    n_bytes: u64,
    buffers: [wgpu::Buffer; 2],
    stage: wgpu::ComputePipeline,
}

impl<'a> CopyProbe<'a> {
    /// Takes twice so many bytes of the device, fewer where it does not give as many.
    ///
    /// # Errors
    /// [`RelightError::Device`] where it is out of memory.
    pub fn new(gpu: &'a Gpu, n_bytes: u64) -> Result<Self, RelightError> {
        gpu.guarded(|| {
            let (n_bytes, buffers, stage) = copy_pass::prepare(gpu, n_bytes);
            Ok(Self { gpu, n_bytes, buffers, stage })
        })
    }

    /// Copies so many times, one after the other; bytes read and written per second.
    ///
    /// # Errors
    /// [`RelightError::Device`] where the device fails.
    pub fn bytes_per_sec(&self, n_times: u32) -> Result<f64, RelightError> {
        let start = Instant::now();
        self.gpu.guarded(|| {
            copy_pass::run(self.gpu, &self.stage, &self.buffers, n_times);
            self.gpu.wait()
        })?;
        Ok(2.0 * self.n_bytes as f64 * f64::from(n_times) / start.elapsed().as_secs_f64())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gpu::tests::gpu;

    #[test]
    fn every_value_is_read_once() {
        let values: Vec<u64> = (0..4096 * 32).collect();
        assert_eq!(sum(&values), values.iter().sum::<u64>());
        assert!(ReadProbe::new(3 << 20).bytes_per_sec() > 0.0);
    }

    #[test]
    fn the_copy_is_whole() {
        let Some(gpu) = gpu() else { return };
        let probe = CopyProbe::new(&gpu, 1 << 20).unwrap();
        probe.bytes_per_sec(2).unwrap();
        let copied = gpu.read_back(probe.n_bytes, |encoder, buffer| {
            encoder.copy_buffer_to_buffer(&probe.buffers[1], 0, buffer, 0, probe.n_bytes);
        });
        assert!(copied.unwrap() == copy_pass::content(probe.n_bytes), "the copy differs");
    }
}
