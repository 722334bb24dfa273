//! A first look at a view: traced at few pixels, but all of them and under every light, long before the preview of its bake is whole. Those
//! of the bake are told by them.

use std::ops::ControlFlow;
use std::sync::Arc;

use clerestory_nystrom::{BlockFactors, BlockLowRank};
use clerestory_transport::bake::focus::Focus;
use clerestory_transport::bake::{BakeConfig, BakeError, BakeEvent, BakeHeader, BakeJob, Passes};
use clerestory_transport::camera::Film;

use super::preview::within;

/// Pixels across of the bake for each that is traced, and the least and greatest longest side of what is: a picture that is seen for seconds,
/// made in a fraction of them.
const FEWER: f32 = 4.0;
const SIDES_PX: [u32; 2] = [128, 240];
/// Pixels of the bake for each of a glimpse, at least: else the preview itself is there as soon.
const LEAST_GAIN: usize = 4;

/// The matrix of a first look.
pub struct Glimpse {
    /// What it is of.
    pub header: Arc<BakeHeader>,
    /// One part per group of columns.
    pub groups: Vec<BlockLowRank>,
}

/// What a first look at a bake is made by; none where the bake is as small itself.
pub fn job(of: &BakeJob) -> Option<BakeJob> {
    let side = (of.film.width.max(of.film.height) as f32 / FEWER) as u32;
    let film = within(of.film, side.clamp(SIDES_PX[0], SIDES_PX[1]));
    if of.film.n_pixels() < LEAST_GAIN * film.n_pixels() {
        return None;
    }
    // Light that arrives and lamps that move wait for the bake.
    let config = BakeConfig { patches: 0, ..of.config.clone() };
    Some(BakeJob { film, config, passes: Passes::FirstLook, irradiance: Vec::new(), ..of.clone() })
}

/// Bakes no further than the preview, and makes a picture of all pixels of the bake of it, where these do not take too much memory; nothing if
/// it was stopped before.
///
/// # Errors
/// As the bake itself.
pub fn run(job: BakeJob, film: Film, focus: &Focus) -> Result<Option<Glimpse>, BakeError> {
    let Some(Glimpse { header, groups }) = traced(job.clone(), focus)? else { return Ok(None) };
    let enlarged = job.enlarged(&header, &groups, film, focus).map(|groups| {
        let Film { width, height } = film;
        Glimpse { header: Arc::new(BakeHeader { width, height, ..(*header).clone() }), groups }
    });
    Ok(Some(enlarged.unwrap_or(Glimpse { header, groups })).filter(|_| !focus.is_left()))
}

fn traced(job: BakeJob, focus: &Focus) -> Result<Option<Glimpse>, BakeError> {
    let (mut glimpse, mut is_whole) = (None::<Glimpse>, false);
    let keep = |glimpse: &mut Option<Glimpse>, block_idx: usize, factors: Vec<Arc<BlockFactors>>| {
        let groups = glimpse.iter_mut().flat_map(|glimpse| &mut glimpse.groups);
        groups.zip(factors).for_each(|(group, factors)| group.blocks[block_idx] = Some(factors));
    };
    let on_event = |event| {
        match event {
            BakeEvent::Started { header, .. } => {
                let groups = header.empty_groups();
                glimpse = Some(Glimpse { header, groups });
            }
            BakeEvent::BlockDone { block_idx, factors, .. } => keep(&mut glimpse, block_idx, factors),
            BakeEvent::Denoised { blocks, .. } => {
                blocks.into_iter().for_each(|(block_idx, factors)| keep(&mut glimpse, block_idx, factors));
            }
            BakeEvent::PassDone { .. } => {
                is_whole = true;
                return ControlFlow::Break(());
            }
            _ => {}
        }
        ControlFlow::Continue(())
    };
    job.run_toward(focus, None, on_event)?;
    Ok(glimpse.filter(|_| is_whole))
}

#[cfg(test)]
mod tests {
    use clerestory_transport::camera::Film;
    use clerestory_transport::irradiance::IrradianceRows;

    use super::*;
    use crate::support::room_job;

    fn bake_of(film: Film) -> BakeJob {
        let config = BakeConfig { spp: 4096, tolerance_db: 100.0, patches: 64, ..BakeConfig::default() };
        BakeJob { passes: Passes::Progressive, irradiance: vec![IrradianceRows::Pixels], ..room_job(film, config) }
    }

    #[test]
    fn a_glimpse_has_all_pixels_under_every_light() {
        let of = bake_of(Film { width: 1280, height: 960 });
        let sources = of.scene.lighting.basis.sources.clone();
        let Glimpse { header, groups } = run(job(&of).unwrap(), of.film, &Focus::default()).unwrap().unwrap();
        assert_eq!((header.width, header.height), (1280, 960));
        assert_eq!(header.basis.sources, sources);
        for (group, of) in groups.iter().zip(&header.basis.groups) {
            let n_cols = of.columns.len() as u32;
            let are_apart = group.blocks.iter().flatten().all(|block| block.rank == n_cols);
            assert!(are_apart || n_cols > 64, "each of {n_cols} lights is a component of its own");
        }
        assert!(groups.iter().all(|group| group.blocks.iter().all(Option::is_some)));
    }

    #[test]
    fn it_has_as_little_noise_as_a_preview() {
        let of = bake_of(Film { width: 480, height: 360 });
        let mut grainy = of.clone();
        grainy.config.denoise = false;
        let [denoised, grainy] = [of, grainy].map(|of| traced(job(&of).unwrap(), &Focus::default()).unwrap().unwrap());
        let sampled = denoised.groups[0].blocks.iter().zip(&grainy.groups[0].blocks).filter(|(a, b)| a == b).count();
        assert!(2 * sampled < denoised.groups[0].blocks.len(), "{sampled} blocks are as they were sampled");
    }

    #[test]
    fn nobody_who_has_left_gets_one() {
        let focus = Focus::default();
        focus.leave();
        let of = bake_of(Film { width: 640, height: 480 });
        assert!(run(job(&of).unwrap(), of.film, &focus).unwrap().is_none());
    }

    #[test]
    fn a_bake_as_small_as_a_glimpse_has_none() {
        assert!(job(&bake_of(Film { width: 250, height: 188 })).is_none());
        assert!(job(&bake_of(Film { width: 480, height: 360 })).is_some());
    }
}
