//! Noise is taken out of the picture of a pass, where pixels that show the same surface tell each other: of each block as soon as
//! those around it are there.

use std::ops::ControlFlow;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Instant;

use clerestory_nystrom::rivals::Method;
use clerestory_nystrom::{BlockFactors, BlockLowRank, Denoiser, Partition};
use rayon::prelude::*;

use super::focus::Focus;
use super::{BakeEvent, BakeJob, LAMPS_APART, LAMPS_APART_IN_PREVIEWS, Passes, Run, n_lamps_apart};
use crate::figures::error_db;
use crate::guides::Guides;
use crate::matrix::CHANNELS;

/// A block with less noise: its place, and one factor per group of columns.
pub(super) type Denoised = (usize, Vec<Arc<BlockFactors>>);

/// The blocks of a pass as they come.
pub(super) struct Arrivals<'a> {
    denoiser: Denoiser<'a, Guides>,
    there: Mutex<There>,
    /// Those that nobody was told of.
    ready: Mutex<Vec<Denoised>>,
}

/// What is there, of earlier passes too.
struct There {
    groups: Vec<BlockLowRank>,
    is_missing: Vec<bool>,
    /// Whether somebody takes noise out of a block, or has done so.
    is_taken: Vec<bool>,
    denoised: Vec<BlockLowRank>,
}

impl<'a> Arrivals<'a> {
    /// Before `blocks` of a pass come to those that are there already.
    fn new(denoiser: Denoiser<'a, Guides>, groups: &[BlockLowRank], blocks: &[u32]) -> Arrivals<'a> {
        let n_blocks = denoiser.partition.n_blocks();
        let mut is_missing = vec![false; n_blocks];
        blocks.iter().for_each(|&block| is_missing[block as usize] = true);
        let (groups, denoised) = (groups.to_vec(), groups.to_vec());
        let there = There { groups, is_missing, is_taken: vec![false; n_blocks], denoised };
        Arrivals { denoiser, there: Mutex::new(there), ready: Mutex::default() }
    }

    /// A block came, of its own groups first.
    pub(super) fn came(&self, block_idx: usize, factors: &[Arc<BlockFactors>]) {
        let mut there = self.there.lock().unwrap_or_else(PoisonError::into_inner);
        for (group, factors) in there.groups.iter_mut().zip(factors) {
            group.blocks[block_idx] = Some(factors.clone());
        }
        there.is_missing[block_idx] = false;
    }

    /// Takes noise out of those blocks around one that came for which it was the last.
    pub(super) fn denoise_around(&self, block_idx: usize) {
        let whole: Vec<usize> = {
            let mut there = self.there.lock().unwrap_or_else(PoisonError::into_inner);
            let partition = self.denoiser.partition;
            let is_whole = |&near: &usize| !partition.around(near).any(|other| there.is_missing[other]);
            let whole: Vec<usize> =
                partition.around(block_idx).filter(is_whole).filter(|&near| !there.is_taken[near]).collect();
            whole.iter().for_each(|&near| there.is_taken[near] = true);
            whole
        };
        for near in whole {
            let factors = self.denoise(near);
            self.ready.lock().unwrap_or_else(PoisonError::into_inner).push((near, factors));
        }
    }

    fn denoise(&self, block_idx: usize) -> Vec<Arc<BlockFactors>> {
        let known = |group: usize, block_idx: usize| {
            let there = self.there.lock().unwrap_or_else(PoisonError::into_inner);
            there.groups[group].blocks[block_idx].clone()
        };
        let factors: Vec<_> = self.denoiser.block(block_idx, known).into_iter().flatten().collect();
        let mut there = self.there.lock().unwrap_or_else(PoisonError::into_inner);
        for (group, factors) in there.denoised.iter_mut().zip(&factors) {
            group.blocks[block_idx] = Some(factors.clone());
        }
        factors
    }

    /// Those that nobody was told of before.
    pub(super) fn take_ready(&self) -> Vec<Denoised> {
        std::mem::take(&mut *self.ready.lock().unwrap_or_else(PoisonError::into_inner))
    }

    /// When all blocks have come: those that are left, and the whole picture; `None` if `goes_on` said no.
    pub(super) fn finish(self, goes_on: &(dyn Fn() -> bool + Sync)) -> Option<(Vec<Denoised>, Vec<BlockLowRank>)> {
        let is_left =
            |block_idx: &usize| !self.there.lock().unwrap_or_else(PoisonError::into_inner).is_taken[*block_idx];
        let left: Vec<usize> = (0..self.denoiser.partition.n_blocks()).filter(is_left).collect();
        let rest: Option<Vec<Denoised>> =
            left.into_par_iter().map(|block_idx| goes_on().then(|| (block_idx, self.denoise(block_idx)))).collect();
        let mut ready = self.take_ready();
        ready.extend(rest?);
        Some((ready, self.there.into_inner().unwrap_or_else(PoisonError::into_inner).denoised))
    }
}

/// Tells of blocks with less noise, unless there are none or nobody wants them any more.
pub(super) fn tell(
    focus: &Focus,
    pass: u32,
    blocks: Vec<Denoised>,
    on_event: &mut impl FnMut(BakeEvent) -> ControlFlow<()>,
) -> ControlFlow<()> {
    if focus.is_left() {
        return ControlFlow::Break(());
    }
    if blocks.is_empty() { ControlFlow::Continue(()) } else { on_event(BakeEvent::Denoised { pass, blocks }) }
}

impl BakeJob {
    /// The light of the file in the scale of the columns, of each group.
    pub(super) fn preserved<'l>(&self, light: &'l [f32]) -> Vec<&'l [f32]> {
        let groups = self.scene.lighting.basis.groups.iter();
        groups.map(|group| &light[group.columns.start as usize..group.columns.end as usize]).collect()
    }
}

/// What of a picture is denoised by what.
pub(super) struct Likenesses {
    guides: Arc<Guides>,
    light: Vec<f32>,
    partition: Partition,
}

impl Likenesses {
    pub(super) fn denoiser(&self, job: &BakeJob) -> Denoiser<'_, Guides> {
        let Likenesses { guides, light, partition } = self;
        Denoiser { partition, bundle_len: CHANNELS, preserved: job.preserved(light), likeness: guides }
    }

    /// The blocks of a pass as they come.
    pub(super) fn arrivals(&self, job: &BakeJob, groups: &[BlockLowRank], blocks: &[u32]) -> Arrivals<'_> {
        Arrivals::new(self.denoiser(job), groups, blocks)
    }
}

impl Run<'_> {
    /// Looks at what pixels show, once; `None` if nobody wants it any more.
    pub(super) fn guides(&mut self) -> Option<Arc<Guides>> {
        let (job, focus) = (self.job, self.focus);
        let guides = match &self.guides {
            Some(guides) => guides.clone(),
            None => {
                let look = if job.passes == Passes::FirstLook { Guides::at_centers } else { Guides::new };
                Arc::new(look(&job.scene, &job.camera, job.film, &|| !focus.is_left())?)
            }
        };
        self.guides = Some(guides.clone());
        Some(guides)
    }

    /// What the picture is denoised by; `None` if nobody wants it any more.
    pub(super) fn likenesses(&mut self) -> Option<Likenesses> {
        let guides = self.guides()?;
        let light = self.job.scene.lighting.basis.file_light(&self.header.column_scale);
        Some(Likenesses { guides, light, partition: self.header.partition() })
    }

    /// Whether a pass is denoised. What other methods make is there to be compared as it is.
    pub(super) fn is_denoised(&self, is_last: bool) -> bool {
        self.job.config.denoise && (!is_last || self.job.config.method == Method::default())
    }

    /// Columns of a group up to which a pass keeps it as it was sampled: noise that is kept is taken out afterwards.
    pub(super) fn n_lamps_apart(&self, pass: u32, is_preview: bool) -> usize {
        let is_watched = matches!(self.job.passes, Passes::Progressive | Passes::FirstLook);
        let most = match () {
            () if is_preview && is_watched => LAMPS_APART_IN_PREVIEWS,
            () if self.is_denoised(pass == self.last) => LAMPS_APART,
            () => 0,
        };
        n_lamps_apart(&self.job.scene.lighting.basis, self.job.film.n_pixels(), most)
    }

    /// Says how exact the picture of a pass is.
    pub(super) fn end_pass(
        &mut self,
        pass: u32,
        on_event: &mut impl FnMut(BakeEvent) -> ControlFlow<()>,
    ) -> ControlFlow<()> {
        if self.focus.is_left() {
            return ControlFlow::Break(());
        }
        let n_own = self.n_own();
        let groups = self.denoised.as_deref().unwrap_or(&self.matrices[0][..n_own]);
        on_event(BakeEvent::PassDone { pass, error_db: error_db(groups, self.bias) })
    }

    /// All matrices as a bake keeps them; `None` if nobody wants them any more.
    pub(super) fn into_matrices(mut self) -> Option<Vec<Vec<BlockLowRank>>> {
        let groups = match self.denoised.take() {
            // A time that was up has ended the last pass.
            None if self.is_denoised(true) => Some(self.with_less_noise()?),
            groups => groups,
        };
        for (own, groups) in self.matrices[0].iter_mut().zip(groups.into_iter().flatten()) {
            *own = groups;
        }
        Some(self.matrices)
    }

    /// For an estimate: the end of a pass that has some of its blocks, which have less noise then. Seconds that it takes once, and for
    /// those blocks; `None` if nobody wants it any more.
    pub(super) fn try_end(&mut self, is_last: bool) -> Option<[f32; 2]> {
        if !self.is_denoised(is_last) {
            return Some([0.0; 2]);
        }
        let begun = Instant::now();
        self.likenesses()?;
        let once = begun.elapsed().as_secs_f32();
        let groups = self.with_less_noise()?;
        self.matrices[0].iter_mut().zip(groups).for_each(|(own, group)| *own = group);
        Some([once, begun.elapsed().as_secs_f32() - once])
    }

    /// Memory of the factors of the picture, those of patches aside.
    pub(super) fn sampled_bytes(&self) -> u64 {
        self.matrices[0][..self.n_own()].iter().map(|group| group.n_bytes() as u64).sum()
    }

    /// Groups of columns that are light, those of patches aside.
    pub(super) fn n_own(&self) -> usize {
        self.job.scene.lighting.basis.groups.len()
    }

    fn with_less_noise(&mut self) -> Option<Vec<BlockLowRank>> {
        let likenesses = self.likenesses()?;
        let groups = &self.matrices[0][..self.n_own()];
        likenesses.denoiser(self.job).all(groups, &|| !self.focus.is_left())
    }
}
