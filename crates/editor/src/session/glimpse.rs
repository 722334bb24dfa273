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
/// it was stopped before. `on_event` may ask to stop; it hears of the start, that work goes on, and of the end.
///
/// # Errors
/// As the bake itself.
pub fn run(
    job: BakeJob,
    film: Film,
    focus: &Focus,
    mut on_event: impl FnMut(BakeEvent) -> ControlFlow<()> + Send,
) -> Result<Option<Glimpse>, BakeError> {
    let Some((Glimpse { header, groups }, end)) = traced(job.clone(), focus, &mut on_event)? else { return Ok(None) };
    let enlarged = job.enlarged(&header, &groups, film, focus).map(|groups| {
        let Film { width, height } = film;
        Glimpse { header: Arc::new(BakeHeader { width, height, ..(*header).clone() }), groups }
    });
    let is_wanted = !focus.is_left() && on_event(end).is_continue();
    Ok(is_wanted.then(|| enlarged.unwrap_or(Glimpse { header, groups })))
}

/// The small picture, and the event of its end.
fn traced(
    job: BakeJob,
    focus: &Focus,
    mut on_event: impl FnMut(BakeEvent) -> ControlFlow<()> + Send,
) -> Result<Option<(Glimpse, BakeEvent)>, BakeError> {
    let (mut glimpse, mut end) = (None::<Glimpse>, None);
    let keep = |glimpse: &mut Option<Glimpse>, block_idx: usize, factors: Vec<Arc<BlockFactors>>| {
        let groups = glimpse.iter_mut().flat_map(|glimpse| &mut glimpse.groups);
        groups.zip(factors).for_each(|(group, factors)| group.blocks[block_idx] = Some(factors));
    };
    let on_own_event = |event| {
        match event {
            BakeEvent::Started { ref header, .. } => {
                glimpse = Some(Glimpse { header: header.clone(), groups: header.empty_groups() });
                return on_event(event);
            }
            BakeEvent::BlockDone { block_idx, factors, .. } => keep(&mut glimpse, block_idx, factors),
            BakeEvent::Denoised { blocks, .. } => {
                blocks.into_iter().for_each(|(block_idx, factors)| keep(&mut glimpse, block_idx, factors));
            }
            BakeEvent::PassDone { .. } => {
                end = Some(event);
                return ControlFlow::Break(());
            }
            _ => {}
        }
        on_event(BakeEvent::Progress { pass: 0, done: 0.0, secs_left: None })
    };
    job.run_toward(focus, None, on_own_event)?;
    Ok(glimpse.zip(end))
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicUsize, Ordering};

    use clerestory_transport::camera::Film;
    use clerestory_transport::irradiance::IrradianceRows;

    use super::*;
    use crate::support::room_job;

    fn go_on(_: BakeEvent) -> ControlFlow<()> {
        ControlFlow::Continue(())
    }

    fn bake_of(film: Film) -> BakeJob {
        let config = BakeConfig { spp: 4096, tolerance_db: 100.0, patches: 64, ..BakeConfig::default() };
        BakeJob { passes: Passes::Progressive, irradiance: vec![IrradianceRows::Pixels], ..room_job(film, config) }
    }

    #[test]
    fn a_glimpse_has_all_pixels_under_every_light() {
        let of = bake_of(Film { width: 1280, height: 960 });
        let sources = of.scene.lighting.basis.sources.clone();
        let Glimpse { header, groups } = run(job(&of).unwrap(), of.film, &Focus::default(), go_on).unwrap().unwrap();
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
        let [denoised, grainy] =
            [of, grainy].map(|of| traced(job(&of).unwrap(), &Focus::default(), go_on).unwrap().unwrap().0);
        let sampled = denoised.groups[0].blocks.iter().zip(&grainy.groups[0].blocks).filter(|(a, b)| a == b).count();
        assert!(2 * sampled < denoised.groups[0].blocks.len(), "{sampled} blocks are as they were sampled");
    }

    #[test]
    fn nobody_who_has_left_gets_one() {
        let focus = Focus::default();
        focus.leave();
        let of = bake_of(Film { width: 640, height: 480 });
        assert!(run(job(&of).unwrap(), of.film, &focus, go_on).unwrap().is_none());
    }

    #[test]
    fn whoever_stops_it_gets_none_and_whoever_does_not_hears_of_its_end_once() {
        let of = bake_of(Film { width: 640, height: 480 });
        let run = |mut heed: Box<dyn FnMut(&BakeEvent) -> bool + Send>| {
            let go_on = move |event| if heed(&event) { ControlFlow::Continue(()) } else { ControlFlow::Break(()) };
            run(job(&of).unwrap(), of.film, &Focus::default(), go_on).unwrap()
        };
        assert!(run(Box::new(|_| false)).is_none(), "at its start");
        assert!(run(Box::new(|event| !matches!(event, BakeEvent::Progress { .. }))).is_none(), "under way");
        assert!(run(Box::new(|event| !matches!(event, BakeEvent::PassDone { .. }))).is_none(), "at its end");
        let n_ends = Arc::new(AtomicUsize::new(0));
        let counted = n_ends.clone();
        let whole = run(Box::new(move |event| {
            counted.fetch_add(usize::from(matches!(event, BakeEvent::PassDone { pass: 0, .. })), Ordering::Relaxed);
            true
        }));
        assert!(whole.is_some() && n_ends.load(Ordering::Relaxed) == 1);
    }

    #[test]
    fn a_bake_as_small_as_a_glimpse_has_none() {
        assert!(job(&bake_of(Film { width: 250, height: 188 })).is_none());
        assert!(job(&bake_of(Film { width: 480, height: 360 })).is_some());
    }
}
