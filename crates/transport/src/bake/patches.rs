//! The columns of patches: learned before the bake, traced before its last pass, told of with its blocks.
//!
//! They have walks, samples and a tolerance of their own, so that all other columns are those of a bake without patches to
//! the last bit.

use std::collections::HashMap;
use std::ops::ControlFlow;

use clerestory_nystrom::{
    BlockFactors, ColumnGroup, CompressConfig, Guide, Partition, SamplePlan, Tolerance, compress_by,
};

use super::focus::Focus;
use super::{BRIGHT, BakeError, BakeEvent, BakeHeader, BakeJob, Run, mean_square, most_rank};
use crate::matrix::CHANNELS;
use crate::patches::{NARROW_ALPHA, PatchMatrix, Patches, Request, learn};
use crate::path::{Integrator, NoLights};

/// Tolerance of the picture that a lamp makes by way of patches, as if its root mean square were the peak of a column.
pub(super) const PATCH_TOLERANCE_DB: f32 = 30.0;
/// What arrives over what is seen, squared: 2π where half of the light comes back.
const ARRIVING: f32 = 39.5;
/// Samples of each half before the first look at the tolerance: a look decomposes 768 rows of some 500 columns twice, which costs more
/// than four samples save.
const FIRST_LOOK: u32 = 8;

impl BakeJob {
    /// Learns patches, if they are asked for, and adds their columns.
    pub(super) fn add_patches(&self, header: &mut BakeHeader, focus: &Focus) {
        let Some(patches) = self.learn(focus) else { return };
        let n_columns = patches.n_columns();
        header.basis = std::mem::take(&mut header.basis).with_patches(n_columns as u32);
        let scales = header.irradiance.iter_mut().map(|set| &mut set.column_scale);
        for scale in std::iter::once(&mut header.column_scale).chain(scales) {
            scale.resize(scale.len() + n_columns, 1.0);
        }
        (header.patches, header.view) = (Some(patches), Some(self.camera.clone()));
    }

    fn learn(&self, focus: &Focus) -> Option<Patches> {
        let super::BakeConfig { patches: n_patches, bounces, seed, .. } = self.config;
        // Without a second surface there is nothing to learn.
        let wanted = n_patches > 0 && bounces != Some(0);
        let request = Request { n_patches, bounces, seed, narrow_alpha: NARROW_ALPHA };
        wanted.then(|| learn(&self.scene, &self.camera, self.film, request, focus)).flatten()
    }

    /// The part of a scale that belongs to the columns of the scene's lights.
    pub(super) fn own_scale(&self, column_scale: &[f32]) -> Vec<f32> {
        column_scale[..self.scene.lighting.basis.n_cols()].to_vec()
    }
}

/// Blocks of the group of patches that wait for those of the other groups.
pub(super) struct PatchBlocks {
    /// Whose shape blocks have that hold nothing; `None` without patches.
    shape: Option<(Partition, u32)>,
    there: HashMap<u32, BlockFactors>,
}

impl PatchBlocks {
    /// Dark blocks of the picture.
    pub fn none(header: &BakeHeader) -> PatchBlocks {
        PatchBlocks::dark(header, &header.partition())
    }

    /// Dark blocks of a matrix.
    pub fn dark(header: &BakeHeader, partition: &Partition) -> PatchBlocks {
        let shape = header.patches.as_ref().map(|patches| (partition.clone(), patches.n_columns() as u32));
        PatchBlocks { shape, there: HashMap::new() }
    }

    /// What belongs behind the factors of the other groups of a block: nothing without patches.
    pub fn take(&mut self, block: u32) -> Option<BlockFactors> {
        let (partition, n_cols) = self.shape.as_ref()?;
        let dark = || {
            let [.., w, h] = partition.rect(block as usize);
            BlockFactors { n_rows: w * h * CHANNELS as u32, n_cols: *n_cols, ..BlockFactors::default() }
        };
        Some(self.there.remove(&block).unwrap_or_else(dark))
    }
}

impl Run<'_> {
    /// Traces the columns of patches for some blocks of a matrix: 0 is the picture, those of irradiance follow.
    pub(super) fn patches(
        &self,
        into: &mut PatchBlocks,
        (matrix_idx, blocks): (usize, &[u32]),
        (pass, done): (u32, f32),
        on_event: &mut (impl FnMut(BakeEvent) -> ControlFlow<()> + Send),
    ) -> Result<ControlFlow<()>, BakeError> {
        let job = self.job;
        let Some(patches) = &self.header.patches else { return Ok(ControlFlow::Continue(())) };
        // A bake that is taken up again learns the same once more: its file holds no more than relighting needs.
        let again = if patches.table().is_none() { job.learn(self.focus) } else { None };
        if self.focus.is_left() {
            return Ok(ControlFlow::Break(()));
        }
        let Some(table) = again.as_ref().unwrap_or(patches).table() else {
            return Err(BakeError::Config {
                what: "the scene has no patches any more; start over with --fresh".into(),
            });
        };
        if table.n_columns != patches.n_columns() {
            return Err(BakeError::Config { what: "the scene has other patches now; start over with --fresh".into() });
        }
        let irradiance = matrix_idx.checked_sub(1).map(|set| &self.header.irradiance[set].rows);
        let matrix = PatchMatrix {
            integrator: Integrator::new(&job.scene, &NoLights, job.config.bounces).watched(self.focus),
            camera: job.camera.clone(),
            film: irradiance.map_or(job.film, |rows| rows.film(job.film)),
            irradiance,
            seed: job.config.seed,
            table,
            empty: self.empty.clone(),
        };
        let gain = if irradiance.is_some() { ARRIVING } else { 1.0 };
        let config = job.patch_config(table.n_columns, gain);
        let on_block = |block: u32, factors: Vec<BlockFactors>| {
            into.there.extend(factors.into_iter().map(|factors| (block, factors)));
            on_event(BakeEvent::Progress { pass, done, secs_left: None })
        };
        let guide = Guide { goes_on: &|| !self.focus.is_left(), ..Guide::default() };
        let partition = self.header.partitions().swap_remove(matrix_idx);
        Ok(compress_by(guide, &matrix, &partition, blocks, &config, on_block)?)
    }
}

impl BakeJob {
    /// `gain` is how much more light a row has than one of the picture, squared.
    fn patch_config(&self, n_columns: usize, gain: f32) -> CompressConfig {
        let max = (self.config.spp / 2).max(1);
        let tolerance = Tolerance::AbsoluteMeanSquare(mean_square(PATCH_TOLERANCE_DB) * gain);
        CompressConfig {
            groups: vec![ColumnGroup {
                columns: 0..n_columns,
                tolerance,
                preserved: Vec::new(),
                share: 1.0,
                apart: 0.0,
            }],
            samples: SamplePlan { batch: max.min(8), min: max.min(FIRST_LOOK), max },
            seed: self.config.seed,
            max_rank: most_rank(self.config.block),
            strong: BRIGHT,
            ..CompressConfig::default()
        }
    }
}
