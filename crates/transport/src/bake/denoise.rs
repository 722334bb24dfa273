//! The end of a pass: noise is taken out of its picture, where pixels that show the same surface tell each other.

use std::ops::ControlFlow;
use std::time::Instant;

use clerestory_nystrom::rivals::Method;
use clerestory_nystrom::{BlockLowRank, denoise};

use super::{BakeEvent, Run};
use crate::figures::error_db;
use crate::guides::Guides;

impl Run<'_> {
    /// Takes noise out of the blocks that a pass has brought, if that was asked for, and says so and how exact the picture is. The
    /// blocks themselves stay as they were sampled, since others may follow.
    pub(super) fn end_pass(
        &mut self,
        pass: u32,
        on_event: &mut impl FnMut(BakeEvent) -> ControlFlow<()>,
    ) -> ControlFlow<()> {
        let n_own = self.n_own();
        if self.is_denoised(pass == self.last) {
            let Some(groups) = self.with_less_noise() else { return ControlFlow::Break(()) };
            on_event(BakeEvent::Denoised { pass, groups: groups.clone() })?;
            self.denoised = Some(groups);
        }
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
        self.look_at_pixels()?;
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
    fn n_own(&self) -> usize {
        self.job.scene.lighting.basis.groups.len()
    }

    /// Whether a pass is denoised. What other methods make is there to be compared as it is.
    fn is_denoised(&self, is_last: bool) -> bool {
        self.job.config.denoise && (!is_last || self.job.config.method == Method::default())
    }

    /// Looks at what pixels show, once.
    fn look_at_pixels(&mut self) -> Option<()> {
        let (job, focus) = (self.job, self.focus);
        if self.guides.is_none() {
            self.guides = Some(Guides::new(&job.scene, &job.camera, job.film, &|| !focus.is_left())?);
        }
        Some(())
    }

    fn with_less_noise(&mut self) -> Option<Vec<BlockLowRank>> {
        self.look_at_pixels()?;
        let (job, goes_on) = (self.job, || !self.focus.is_left());
        let guides = self.guides.as_ref().expect("pixels were looked at");
        let basis = &job.scene.lighting.basis;
        let light = basis.file_light(&self.header.column_scale);
        let preserved =
            basis.groups.iter().map(|group| &light[group.columns.start as usize..group.columns.end as usize]);
        let preserved: Vec<&[f32]> = preserved.collect();
        denoise(&self.matrices[0][..self.n_own()], &preserved, guides, &goes_on)
    }
}
