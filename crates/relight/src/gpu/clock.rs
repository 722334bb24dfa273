//! How long stages take, told by the device itself: what is timed from outside holds the way there and back as well.

use crate::gpu::Gpu;
use crate::relight::RelightError;

/// What a picture is made by, in this order.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Stage {
    Project,
    Gather,
    Expand,
    Display,
}

/// As many as a picture takes at most: groups that stay and groups that move are expanded one after the other.
const N_STAGES: u32 = 5;

/// Seconds that the stages of one picture took on the device; 0 of those that it did without.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct StageSecs {
    /// Right factors times coefficients.
    pub project: f64,
    /// Sums of segments, and what is left as it is.
    pub gather: f64,
    /// Left factors times what was gathered.
    pub expand: f64,
    /// Radiance to what a screen takes.
    pub display: f64,
    /// From the begin of the first to the end of the last.
    pub whole: f64,
}

/// Moments that a device notes, in pairs of begin and end.
#[derive(Debug)]
pub(crate) struct Stamps {
    queries: wgpu::QuerySet,
    resolved: wgpu::Buffer,
}

impl Stamps {
    /// None where the device notes none.
    pub(crate) fn new(gpu: &Gpu, n_pairs: u32) -> Option<Self> {
        gpu.takes_time().then(|| Self {
            queries: gpu.device.create_query_set(&wgpu::QuerySetDescriptor {
                label: Some("stamps"),
                ty: wgpu::QueryType::Timestamp,
                count: 2 * n_pairs,
            }),
            resolved: gpu.buffer(
                "stamps",
                u64::from(2 * n_pairs * wgpu::QUERY_SIZE),
                wgpu::BufferUsages::QUERY_RESOLVE | wgpu::BufferUsages::COPY_SRC,
            ),
        })
    }

    /// Notes begin and end of a pass.
    pub(crate) fn around(&self, pair: u32) -> wgpu::ComputePassTimestampWrites<'_> {
        wgpu::ComputePassTimestampWrites {
            query_set: &self.queries,
            beginning_of_pass_write_index: Some(2 * pair),
            end_of_pass_write_index: Some(2 * pair + 1),
        }
    }

    /// Records that the first pairs, which were noted, can be read.
    pub(crate) fn resolve(&self, encoder: &mut wgpu::CommandEncoder, n_pairs: u32) {
        if n_pairs > 0 {
            encoder.resolve_query_set(&self.queries, 0..2 * n_pairs, &self.resolved, 0);
        }
    }

    /// Waits, and reads how long each of the first passes took, in seconds of the device: up to the begin of the next, since some
    /// devices note the end of a pass before all of it is done, and begin none before.
    pub(crate) fn spans(&self, gpu: &Gpu, n_pairs: u32) -> Result<Vec<f64>, RelightError> {
        if n_pairs == 0 {
            return Ok(Vec::new());
        }
        let n_bytes = u64::from(2 * n_pairs * wgpu::QUERY_SIZE);
        let bytes = gpu.read_back(n_bytes, |encoder, buffer| {
            encoder.copy_buffer_to_buffer(&self.resolved, 0, buffer, 0, n_bytes);
        })?;
        let secs_per_tick = 1e-9 * f64::from(gpu.queue.get_timestamp_period());
        let ticks: Vec<u64> = bytes.chunks_exact(8).map(bytemuck::pod_read_unaligned).collect();
        let moments = ticks.iter().step_by(2).chain(ticks.last()).copied().collect::<Vec<u64>>();
        Ok(moments.windows(2).map(|pair| pair[1].saturating_sub(pair[0]) as f64 * secs_per_tick).collect())
    }
}

/// Times the stages of pictures.
#[derive(Debug)]
pub(super) struct Clock {
    stamps: Stamps,
    /// Stages of the last picture, in the order of their pairs.
    timed: Vec<Stage>,
}

impl Clock {
    /// None where the device takes no time.
    pub(super) fn new(gpu: &Gpu) -> Option<Self> {
        Some(Self { stamps: Stamps::new(gpu, N_STAGES)?, timed: Vec::new() })
    }

    /// Another picture begins.
    pub(super) fn reset(&mut self) {
        self.timed.clear();
    }

    fn around(&mut self, stage: Stage) -> wgpu::ComputePassTimestampWrites<'_> {
        self.timed.push(stage);
        self.stamps.around(self.timed.len() as u32 - 1)
    }

    /// Records that the times of what was recorded can be read.
    pub(super) fn resolve(&self, encoder: &mut wgpu::CommandEncoder) {
        self.stamps.resolve(encoder, self.timed.len() as u32);
    }

    /// What the last picture took.
    pub(super) fn read(&self, gpu: &Gpu) -> Result<StageSecs, RelightError> {
        let spans = self.stamps.spans(gpu, self.timed.len() as u32)?;
        let mut secs = StageSecs { whole: spans.iter().sum(), ..StageSecs::default() };
        for (stage, span) in self.timed.iter().zip(spans) {
            let of_stage = match stage {
                Stage::Project => &mut secs.project,
                Stage::Gather => &mut secs.gather,
                Stage::Expand => &mut secs.expand,
                Stage::Display => &mut secs.display,
            };
            *of_stage += span;
        }
        Ok(secs)
    }
}

/// A pass for one stage, timed where there is a clock.
pub(super) fn begin_pass<'e>(
    encoder: &'e mut wgpu::CommandEncoder,
    clock: &mut Option<Clock>,
    stage: Stage,
) -> wgpu::ComputePass<'e> {
    let timestamp_writes = clock.as_mut().map(|clock| clock.around(stage));
    encoder.begin_compute_pass(&wgpu::ComputePassDescriptor { label: None, timestamp_writes })
}
