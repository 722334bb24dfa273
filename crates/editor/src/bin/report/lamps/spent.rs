//! A bake, and the CPU seconds of its parts.

use std::ops::ControlFlow;
use std::sync::Arc;

use anyhow::{Context, Result};
use clerestory_transport::bake::{Bake, BakeConfig, BakeEvent, BakeJob, Passes};
use clerestory_transport::camera::{Camera, Film};
use clerestory_transport::prepared::PreparedScene;
use serde::{Deserialize, Serialize};

use crate::matrix::process_cpu_secs;

/// CPU seconds of a bake.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Spent {
    /// Learning of patches.
    pub learning: f64,
    /// Walks of their columns.
    pub walks: f64,
    /// All else: what a bake without patches does, and packing their columns, which no event tells apart.
    pub lights: f64,
}

impl Spent {
    /// Bake of patches over bake without.
    pub fn ratio(&self) -> f64 {
        (self.learning + self.walks) / self.lights
    }

    /// From the seconds at the beginning, once a header without patches was made, at the first event, after the last walk of
    /// patches, and at the end.
    fn of([begun, headed, started, walked, ended]: [f64; 5]) -> Spent {
        let header = headed - begun;
        Spent {
            learning: (started - headed - header).max(0.0),
            walks: walked - started,
            lights: header + ended - walked,
        }
    }
}

/// Bakes in a single pass.
///
/// # Errors
/// A bake that fails, or a system that does not tell the CPU time of a process.
pub fn bake(scene: &Arc<PreparedScene>, camera: &Camera, film: Film, config: BakeConfig) -> Result<(Bake, Spent)> {
    let job = |config: BakeConfig| {
        let (passes, irradiance) = (Passes::FinalOnly, Vec::new());
        BakeJob { scene: scene.clone(), camera: camera.clone(), film, config, passes, irradiance }
    };
    let begun = process_cpu_secs()?;
    job(BakeConfig { patches: 0, ..config.clone() }).header()?;
    let headed = process_cpu_secs()?;
    let (mut started, mut walked, mut has_blocks) = (None, None, false);
    let on_event = |event: BakeEvent| {
        match event {
            BakeEvent::Started { .. } => started = process_cpu_secs().ok(),
            // Patches are walked for before the first block is told of.
            BakeEvent::Progress { .. } if !has_blocks => walked = process_cpu_secs().ok(),
            BakeEvent::BlockDone { .. } => has_blocks = true,
            _ => {}
        }
        ControlFlow::Continue(())
    };
    let bake = job(config).run(on_event)?.context("nobody stopped it")?;
    let started = started.context("the bake did not tell that it began")?;
    let spent = Spent::of([begun, headed, started, walked.unwrap_or(started), process_cpu_secs()?]);
    Ok((bake, spent))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_patches_take_is_told_apart_from_what_all_bakes_take() {
        let spent = Spent::of([10.0, 11.0, 15.0, 21.0, 40.0]);
        assert_eq!(spent, Spent { learning: 3.0, walks: 6.0, lights: 20.0 });
        assert!((spent.ratio() - 0.45).abs() < 1e-12);
        assert_eq!(Spent::of([10.0, 11.0, 12.0, 12.0, 31.0]), Spent { learning: 0.0, walks: 0.0, lights: 20.0 });
    }
}
