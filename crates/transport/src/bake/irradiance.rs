//! Rows of irradiance at the end of a bake: each set is one more matrix, traced with all samples at once.
//!
//! They are never shared between neighbors and have no preview: what is measured in lux is measured without bias.

use std::ops::ControlFlow;
use std::sync::Arc;

use clerestory_nystrom::{BlockFactors, Guide, compress_by};

use super::clock::Clock;
use super::focus::Focus;
use super::patches::PatchBlocks;
use super::{BakeError, BakeEvent, BakeHeader, BakeJob, Run};
use crate::irradiance::{IrradianceHeader, IrradianceRows};
use crate::plan::{Density, MatrixPlan};
use crate::sensors::{SensorError, SensorGrid};

impl BakeJob {
    /// Checks the rows of irradiance and measures the scale of their columns.
    pub(super) fn irradiance_headers(&self, dark: &[u32], focus: &Focus) -> Result<Vec<IrradianceHeader>, BakeError> {
        let mut n_points = 0;
        for rows in &self.irradiance {
            if let IrradianceRows::Grid(grid) = rows {
                grid.check()?;
                n_points += grid.n_points();
            }
        }
        if n_points > SensorGrid::MAX_POINTS {
            return Err(SensorError::TooMany { n_points }.into());
        }
        let header = |rows: &IrradianceRows| {
            let plan = MatrixPlan::without(&self.scene.lighting, Density::Full, dark_for(rows, dark));
            let (column_scale, sky_reach) = self.matrix(&plan, None, focus).of_irradiance(rows).measure_columns();
            IrradianceHeader { rows: rows.clone(), column_scale, sky_reach }
        };
        Ok(self.irradiance.iter().map(header).collect())
    }
}

impl BakeHeader {
    fn irradiance_plan(&self, job: &BakeJob, set: usize) -> MatrixPlan {
        let IrradianceHeader { rows, column_scale, sky_reach } = &self.irradiance[set];
        let dark = dark_for(rows, &self.spared.dark_sources);
        let plan = MatrixPlan::without(&job.scene.lighting, Density::Full, dark);
        plan.fitted(column_scale, sky_reach, job.scene.skips)
    }
}

/// The sources that light none of some rows, given those that light nothing that is seen: grids may lie elsewhere.
fn dark_for<'a>(rows: &IrradianceRows, dark: &'a [u32]) -> &'a [u32] {
    if *rows == IrradianceRows::Pixels { dark } else { &[] }
}

impl Run<'_> {
    /// Compresses some blocks of a matrix of irradiance; `pass` is the last one of the picture.
    pub(super) fn irradiance(
        &mut self,
        (pass, samples, set): (u32, u32, usize),
        blocks: &[u32],
        clock: &mut Clock,
        on_event: &mut (impl FnMut(BakeEvent) -> ControlFlow<()> + Send),
    ) -> Result<ControlFlow<()>, BakeError> {
        let (job, header, started) = (self.job, self.header.clone(), self.started);
        let IrradianceHeader { rows, column_scale, .. } = &header.irradiance[set];
        let plan = header.irradiance_plan(job, set);
        let mut matrix = job.matrix(&plan, self.empty.clone(), self.focus).of_irradiance(rows);
        matrix.set_column_scale(job.own_scale(column_scale));
        let partition = header.partitions().swap_remove(1 + set);
        clock.start_pass(pass + 1 + set as u32, started.elapsed().as_secs_f32());
        let mut config = job.compress_config(samples, job.config.tolerance_db, column_scale);
        config.smoothing = Some(header.smoothing(&partition));
        let focus = self.focus;
        let guide = Guide { goes_on: &|| !focus.is_left(), ..Guide::default() };
        let mut of_patches = PatchBlocks::dark(&header, &partition);
        if self.patches(&mut of_patches, (1 + set, blocks), (pass, clock.done()), on_event)?.is_break() {
            return Ok(ControlFlow::Break(()));
        }
        let on_block = |block: u32, mut factors: Vec<BlockFactors>| {
            factors.extend(of_patches.take(block));
            let factors = factors.into_iter().map(Arc::new).collect();
            self.deliver((1 + set, block as usize), pass, factors, clock, on_event)
        };
        Ok(compress_by(guide, &matrix, &partition, blocks, &config, on_block)?)
    }
}
