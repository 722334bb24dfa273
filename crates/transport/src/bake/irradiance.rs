//! Rows of irradiance beside those of the picture: each set is one more matrix, traced with all samples at once.
//!
//! What arrives at pixels is there as a preview when the picture is, and shares indirect light where the picture does: its nodes
//! hold what arrives, whatever the surface makes of it. Noise is taken out of it as of the picture. Points of grids are few, and
//! traced without bias.

use std::ops::ControlFlow;
use std::sync::Arc;

use clerestory_nystrom::{BlockFactors, BlockLowRank, Denoiser, Guide, Likeness, compress_by};

use super::clock::Clock;
use super::focus::Focus;
use super::patches::PatchBlocks;
use super::{BakeError, BakeEvent, BakeHeader, BakeJob, Indirect, Passes, Run, mean_square};
use crate::figures::error_db;
use crate::guides::Guides;
use crate::irradiance::{IrradianceHeader, IrradianceRows, block_of, locate};
use crate::matrix::CHANNELS;
use crate::nodes::Nodes;
use crate::plan::{Density, MatrixPlan};
use crate::sensors::{SensorError, SensorGrid};
use crate::shared::SharedMatrix;

impl BakeJob {
    /// Checks the rows of irradiance and measures the scale of their columns.
    pub(super) fn irradiance_headers(&self, dark: &[u32], focus: &Focus) -> Result<Vec<IrradianceHeader>, BakeError> {
        self.check_sensors()?;
        Ok(self.irradiance.iter().map(|rows| self.irradiance_header(rows, dark, focus)).collect())
    }

    /// Whether the grids can be laid as asked.
    pub(super) fn check_sensors(&self) -> Result<(), BakeError> {
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
        Ok(())
    }

    /// Measures the scale of the columns of some rows.
    pub(super) fn irradiance_header(&self, rows: &IrradianceRows, dark: &[u32], focus: &Focus) -> IrradianceHeader {
        let plan = MatrixPlan::without(&self.scene.lighting, Density::Full, dark_for(rows, dark));
        let (column_scale, sky_reach) = self.matrix(&plan, None, focus).of_irradiance(rows).measure_columns();
        IrradianceHeader { rows: rows.clone(), column_scale, sky_reach, sharing_bias: None, column_error: Vec::new() }
    }
}

/// A pass over a matrix of irradiance.
pub(super) struct IrradiancePass {
    /// The matrix.
    pub set: usize,
    /// Samples of each half; `None` is a preview.
    pub samples: Option<u32>,
    /// The pass of the picture that it follows.
    pub follows: u32,
    /// Its number in the clock.
    timed_as: usize,
}

/// Pixels of the picture for each point of a grid that is measured before the picture is refined.
const PIXELS_PER_EARLY_POINT: usize = 4;

/// Least tolerance of what is left out of factors of grids, dB: a twentieth of a percent of the peak of a light. Their points are read one
/// by one, beside a lamp's own figures, and are few.
const GRID_TOLERANCE_DB: f32 = 66.0;

impl IrradianceRows {
    /// Tolerance to which its factors are truncated and packed, where that of the picture is `tolerance_db`. Samples are asked for by that of
    /// the picture, but for points of grids, which take all.
    pub(super) fn tolerance_of_factors(&self, tolerance_db: f32) -> f32 {
        match self {
            IrradianceRows::Pixels => tolerance_db,
            IrradianceRows::Grid(_) => tolerance_db.max(GRID_TOLERANCE_DB),
        }
    }
}

/// How alike what arrives at pixels is expected to be: whatever the color of their surfaces.
struct Arriving<'a>(&'a Guides);

impl Likeness for Arriving<'_> {
    fn likeness(&self, bundle: u32, first: u32, out: &mut [f32]) {
        self.0.likeness(bundle, first, out);
    }

    fn gains(&self, _: u32) -> &[f32] {
        &[1.0; CHANNELS]
    }

    fn is_void(&self, bundle: u32) -> bool {
        self.0.is_void(bundle)
    }
}

/// Whether some noise is known, which a matrix of an earlier bake has left behind.
fn is_grainy(groups: &[BlockLowRank]) -> bool {
    groups.iter().flat_map(|group| &group.blocks).flatten().any(|block| !block.doubt.is_empty())
}

/// All matrices of a bake, one part per group of columns.
type Matrices = Vec<Vec<BlockLowRank>>;

impl BakeJob {
    /// Samples per half of each pass over irradiance whose picture is there; `None` is the preview.
    pub(super) fn irradiance_samples(&self) -> Vec<Option<u32>> {
        let all = Some(self.config.samples_per_half());
        if self.passes == Passes::FinalOnly { vec![all] } else { vec![None, all] }
    }

    /// Traces matrices of irradiance for a bake whose other matrices are `there`; `None` if `on_event` says stop. Blocks that
    /// are `done`, numbered through all matrices, are taken as they are.
    pub(super) fn run_irradiance(
        &self,
        header: &Arc<BakeHeader>,
        there: Matrices,
        done: &[(usize, Vec<Arc<BlockFactors>>)],
        focus: &Focus,
        on_event: &mut (impl FnMut(BakeEvent) -> ControlFlow<()> + Send),
    ) -> Result<Option<(Arc<BakeHeader>, Matrices)>, BakeError> {
        let plan = self.plan(Density::Full, header);
        let (matrix, empty) = self.scaled_matrix(&plan, header, focus);
        let passes = self.irradiance_samples();
        let (n_passes, last) = (passes.len() as u32, passes.len() as u32 - 1);
        let (n_blocks, partitions) = (header.partition().n_blocks(), header.partitions());
        let mut run = Run::new(self, &matrix, header, (focus, empty), last);
        run.matrices = there;
        for (number, factors) in done {
            let Some(place) = locate(&partitions, *number).filter(|place| place.0 > 0) else { continue };
            run.keep(place, factors);
        }
        let tell_all = |on_event: &mut dyn FnMut(BakeEvent) -> ControlFlow<()>| {
            on_event(BakeEvent::Started { header: header.clone(), n_blocks, n_passes })?;
            let groups = &run.matrices[0][..run.n_own()];
            for (matrix, groups) in run.matrices.iter().enumerate() {
                for block_idx in 0..partitions[matrix].n_blocks() {
                    block_of(groups, block_idx).map_or(ControlFlow::Continue(()), |factors| {
                        on_event(BakeEvent::of_block(last, (matrix, block_idx), factors))
                    })?;
                }
            }
            on_event(BakeEvent::PassDone { pass: last, error_db: error_db(groups, run.bias) })
        };
        if tell_all(on_event).is_break() {
            return Ok(None);
        }
        let n_given = |matrix: usize| partitions[matrix].n_blocks() - run.missing(matrix).len();
        let n_given: Vec<usize> = (1..partitions.len()).map(n_given).collect();
        let mut clock = Clock::new(&passes[passes.len() - 1..], n_blocks, n_blocks, rayon::current_num_threads());
        for own in header.irradiance_passes(&passes, &n_given, &mut clock) {
            let blocks = run.missing(1 + own.set);
            if run.irradiance(&own, &blocks, &mut clock, on_event)?.is_break() {
                return Ok(None);
            }
        }
        Ok((!focus.is_left()).then(|| (run.header_at_the_end(false), run.matrices)))
    }
}

impl BakeHeader {
    /// The passes over matrices of irradiance, beside those of the picture, in their order. `n_given` blocks of each matrix are there
    /// already.
    pub(super) fn irradiance_passes(
        &self,
        passes: &[Option<u32>],
        n_given: &[usize],
        clock: &mut Clock,
    ) -> Vec<IrradiancePass> {
        let (last, all, has_preview) = (passes.len() as u32 - 1, passes[passes.len() - 1], passes[0].is_none());
        let n_pixels = self.width as usize * self.height as usize;
        let is_early = |rows: &IrradianceRows| match rows {
            IrradianceRows::Grid(grid) => has_preview && PIXELS_PER_EARLY_POINT * grid.n_points() <= n_pixels,
            IrradianceRows::Pixels => false,
        };
        let partitions = self.partitions();
        let mut of_irradiance = Vec::new();
        for (set, IrradianceHeader { rows, .. }) in self.irradiance.iter().enumerate() {
            let n_blocks = partitions[1 + set].n_blocks();
            if has_preview && *rows == IrradianceRows::Pixels {
                let timed_as = clock.add_pass(None, n_blocks, 0);
                of_irradiance.push(IrradiancePass { set, samples: None, follows: 0, timed_as });
            }
            let timed_as = clock.add_pass(all, n_blocks, n_given[set]);
            let follows = if is_early(rows) { 0 } else { last };
            of_irradiance.push(IrradiancePass { set, samples: all, follows, timed_as });
        }
        of_irradiance.sort_by_key(|own| own.follows);
        of_irradiance
    }

    fn irradiance_plan(&self, job: &BakeJob, own: &IrradiancePass) -> MatrixPlan {
        let IrradianceHeader { rows, column_scale, sky_reach, .. } = &self.irradiance[own.set];
        let density = if own.samples.is_some() { Density::Full } else { Density::Quarter };
        let dark = dark_for(rows, &self.spared.dark_sources);
        let plan = MatrixPlan::without(&job.scene.lighting, density, dark);
        let plan = plan.fitted(column_scale, sky_reach, job.scene.skips);
        if own.samples.is_some() { plan } else { plan.for_short_walks() }
    }
}

/// The sources that light none of some rows, given those that light nothing that is seen: grids may lie elsewhere.
fn dark_for<'a>(rows: &IrradianceRows, dark: &'a [u32]) -> &'a [u32] {
    if *rows == IrradianceRows::Pixels { dark } else { &[] }
}

impl Run<'_> {
    /// Compresses some blocks of a matrix of irradiance. What arrives at pixels is told of once more with less noise, as a preview and
    /// as it stays.
    pub(super) fn irradiance(
        &mut self,
        own: &IrradiancePass,
        blocks: &[u32],
        clock: &mut Clock,
        on_event: &mut (impl FnMut(BakeEvent) -> ControlFlow<()> + Send),
    ) -> Result<ControlFlow<()>, BakeError> {
        let mut preview = self.empty_preview(own);
        let flow = self.trace_irradiance(own, blocks, &mut preview, clock, on_event)?;
        let is_last = own.samples.is_some();
        let groups = if is_last { self.matrices[1 + own.set][..self.n_own()].to_vec() } else { preview };
        let has_neighbors = self.header.irradiance[own.set].rows == IrradianceRows::Pixels;
        if flow.is_break() || !has_neighbors || !self.is_denoised(is_last) || !is_grainy(&groups) {
            return Ok(flow);
        }
        let Some(groups) = self.with_less_grain(own.set, &groups) else { return Ok(ControlFlow::Break(())) };
        let blocks = (0..self.header.partitions()[1 + own.set].n_blocks())
            .filter_map(|block_idx| Some((block_idx, block_of(&groups, block_idx)?)))
            .collect();
        if is_last {
            self.matrices[1 + own.set].iter_mut().zip(groups).for_each(|(own, group)| *own = group);
        }
        Ok(on_event(BakeEvent::IrradianceDenoised { set: own.set, blocks }))
    }

    /// Where the blocks of a preview are kept; empty where the pass is none.
    pub(super) fn empty_preview(&self, own: &IrradiancePass) -> Vec<BlockLowRank> {
        let mut preview = match own.samples {
            None => self.header.empty_matrices().swap_remove(1 + own.set),
            Some(_) => Vec::new(),
        };
        preview.truncate(self.n_own());
        preview
    }

    /// What arrives at pixels, noise taken out as of the picture; `None` if nobody wants it any more.
    fn with_less_grain(&mut self, set: usize, groups: &[BlockLowRank]) -> Option<Vec<BlockLowRank>> {
        let (job, focus, header) = (self.job, self.focus, self.header.clone());
        let light = job.scene.lighting.basis.file_light(&header.irradiance[set].column_scale);
        let (guides, partition) = (self.guides()?, header.partitions().swap_remove(1 + set));
        let preserved = job.preserved(&light);
        let denoiser =
            Denoiser { partition: &partition, bundle_len: CHANNELS, preserved, likeness: &Arriving(&guides) };
        denoiser.all(groups, &|| !focus.is_left())
    }

    /// The blocks of a preview are kept in `preview` alone.
    pub(super) fn trace_irradiance(
        &mut self,
        own: &IrradiancePass,
        blocks: &[u32],
        preview: &mut [BlockLowRank],
        clock: &mut Clock,
        on_event: &mut (impl FnMut(BakeEvent) -> ControlFlow<()> + Send),
    ) -> Result<ControlFlow<()>, BakeError> {
        let (job, header, focus, pass) = (self.job, self.header.clone(), self.focus, own.follows);
        let IrradianceHeader { rows, column_scale, .. } = &header.irradiance[own.set];
        let indirect = match (rows, own.samples) {
            (IrradianceRows::Grid(_), _) => None,
            (IrradianceRows::Pixels, None) => Indirect::Shared.nodes(None, job.config.tolerance_db),
            (IrradianceRows::Pixels, samples) => job.config.indirect.nodes(samples, job.config.tolerance_db),
        };
        let lacks_bias = own.samples.is_some() && indirect.is_some() && self.irradiance_bias[own.set].is_none();
        if blocks.is_empty() && !lacks_bias {
            return Ok(ControlFlow::Continue(()));
        }
        let plan = header.irradiance_plan(job, own);
        let mut matrix = job.matrix(&plan, self.empty.clone(), focus).of_irradiance(rows);
        matrix.set_column_scale(job.own_scale(column_scale));
        let shared = match indirect {
            None => None,
            Some(plan) => {
                // The same light as that of the picture, however it came to be here.
                let go_on = || on_event(BakeEvent::Progress { pass, done: clock.done(), secs_left: None });
                let nodes = self.nodes.take().or_else(|| Nodes::gather(self.matrix, plan, go_on));
                let Some(nodes) = nodes else { return Ok(ControlFlow::Break(())) };
                self.shared_bytes = self.shared_bytes.max(nodes.n_bytes() as u64);
                // The preview of the picture sends no walks to mirrors and glass: its nodes have that light already.
                if nodes.holds_caustics {
                    matrix = matrix.unguided();
                }
                let scales = matrix.column_scale().iter().zip(self.matrix.column_scale());
                let ratios: Vec<f32> = scales.map(|(own, of_picture)| own / of_picture).collect();
                Some(SharedMatrix { matrix: &matrix, nodes: nodes.scaled(&ratios) })
            }
        };
        if own.samples.is_some() {
            self.irradiance_bias[own.set] = shared.as_ref().map(|shared| shared.bias(job.config.tolerance_db));
        }
        if on_event(BakeEvent::Progress { pass, done: clock.done(), secs_left: None }).is_break() {
            return Ok(ControlFlow::Break(()));
        }
        let partition = header.partitions().swap_remove(1 + own.set);
        let mut config = self.compression((own.samples, own.samples.is_some()), column_scale, &partition);
        if own.samples.is_some() {
            let finer_db = rows.tolerance_of_factors(job.config.tolerance_db) - job.config.tolerance_db;
            config.groups.iter_mut().for_each(|group| group.share *= mean_square(finer_db));
            if matches!(rows, IrradianceRows::Grid(_)) {
                // Few samples that are spread evenly agree by chance: a point is read by itself, and more of them cost little.
                config.samples.min = config.samples.max;
            }
        }
        let mut of_patches = PatchBlocks::dark(&header, &partition);
        if own.samples.is_some() {
            let done = (pass, clock.done());
            if self.patches(&mut of_patches, (1 + own.set, blocks), done, on_event)?.is_break() {
                return Ok(ControlFlow::Break(()));
            }
        }
        clock.start_pass(own.timed_as, self.started.elapsed().as_secs_f32());
        let guide = Guide { goes_on: &|| !focus.is_left(), ..Guide::default() };
        let on_block = |block: u32, mut factors: Vec<BlockFactors>| {
            factors.extend(of_patches.take(block));
            let factors: Vec<_> = factors.into_iter().map(Arc::new).collect();
            if own.samples.is_some() {
                return self.deliver((1 + own.set, block as usize), pass, factors, clock, on_event);
            }
            for (group, factors) in preview.iter_mut().zip(&factors) {
                group.blocks[block as usize] = Some(factors.clone());
            }
            let (done, secs_left) = clock.block_done(self.started.elapsed().as_secs_f32());
            let (set, block_idx, is_preview) = (own.set, block as usize, true);
            on_event(BakeEvent::IrradianceDone { set, block_idx, factors, is_preview })?;
            on_event(BakeEvent::Progress { pass, done, secs_left })
        };
        Ok(match &shared {
            Some(shared) => compress_by(guide, shared, &partition, blocks, &config, on_block)?,
            None => compress_by(guide, &matrix, &partition, blocks, &config, on_block)?,
        })
    }
}
