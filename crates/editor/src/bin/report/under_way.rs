//! A bake that is left before its end, and what it has by then.

use std::ops::ControlFlow;
use std::sync::Arc;
use std::time::Instant;

use anyhow::{Context, Result};
use clerestory_nystrom::BlockLowRank;
use clerestory_transport::bake::{BakeEvent, BakeHeader, BakeJob, Indirect};

/// Indirect light as a window has it that is told nothing, and as it has it soonest, with the words behind the name of a scene.
pub const OF_WINDOW: [(Indirect, &str); 2] = [(Indirect::Traced, ""), (Indirect::Shared, ", light shared")];

/// What a bake had when a pass of it was over.
pub struct Pass {
    /// When that was.
    pub ended: Instant,
    /// Error that it told, dB.
    pub told_db: f32,
    /// One matrix per group of columns.
    pub groups: Vec<BlockLowRank>,
}

/// What a bake has when it is left.
pub struct UnderWay {
    /// What it is of.
    pub header: Arc<BakeHeader>,
    /// One matrix per group of columns, of the latest pass that reached each block.
    pub groups: Vec<BlockLowRank>,
    /// Passes that came to their end, the preview first.
    pub passes: Vec<Pass>,
    /// When it was left, or was done.
    pub ended: Instant,
}

/// Runs a job until an event says that it is enough.
///
/// # Errors
/// If the bake fails.
pub fn run_until(job: BakeJob, mut is_enough: impl FnMut(&BakeEvent) -> bool + Send) -> Result<UnderWay> {
    let (mut header, mut groups, mut passes, mut ended) = (None, Vec::new(), Vec::new(), None);
    let bake = job.run(|event| {
        let is_enough = is_enough(&event);
        match event {
            BakeEvent::Started { header: started, .. } => {
                groups = started.empty_groups();
                header = Some(started);
            }
            BakeEvent::BlockDone { block_idx, factors, .. } => {
                groups.iter_mut().zip(factors).for_each(|(group, block)| group.blocks[block_idx] = Some(block));
            }
            BakeEvent::Denoised { blocks, .. } => {
                for (block_idx, factors) in blocks {
                    groups.iter_mut().zip(factors).for_each(|(group, block)| group.blocks[block_idx] = Some(block));
                }
            }
            BakeEvent::PassDone { error_db, .. } => {
                passes.push(Pass { ended: Instant::now(), told_db: error_db.total, groups: groups.clone() });
            }
            _ => {}
        }
        if is_enough {
            ended = Some(Instant::now());
            return ControlFlow::Break(());
        }
        ControlFlow::Continue(())
    })?;
    if let Some(bake) = bake {
        (header, groups) = (Some(bake.header), bake.groups);
    }
    let header = header.context("a bake that began has a header")?;
    Ok(UnderWay { header, groups, passes, ended: ended.unwrap_or_else(Instant::now) })
}

/// Whether an event says that a pass has ended.
pub fn ends_a_pass(event: &BakeEvent) -> bool {
    matches!(event, BakeEvent::PassDone { .. })
}

#[cfg(test)]
mod tests {
    use clerestory_transport::bake::BakeConfig;

    use super::*;

    #[test]
    fn a_window_that_is_told_nothing_comes_first() {
        assert_eq!(OF_WINDOW[0], (BakeConfig::default().indirect, ""));
    }
}
