//! The bake: started, gone on with, watched block by block, and what is there at its end.

use std::sync::Arc;
use std::time::{Duration, Instant};

use clerestory_nystrom::{BlockFactors, BlockLowRank};
use clerestory_relight::Frame;
use clerestory_transport::bake::stack::{MEMORY_BYTES, StackJob};
use clerestory_transport::bake::{Bake, BakeConfig, BakeEvent, BakeHeader, BakeJob, HalfDone, Passes};
use clerestory_transport::camera::Camera;
use clerestory_transport::sensors::{IrradianceRequest, OfFile};

use super::begun::{Begun, seen_from};
use super::glimpse::{self, Glimpse};
use super::task::{self, Task, words};
use super::views::sees_alike;
use super::{BakeSettings, BakeState, Notice, Session, Shown, earlier};
use crate::picture::Changed;
use crate::platform::memory_bytes;

/// Time between two counts of ranks and bytes while a bake runs.
const FIGURES_EVERY: Duration = Duration::from_secs(1);

/// How much of what a bake is at now is there.
#[derive(Default)]
pub(super) struct PassBlocks {
    n_blocks: usize,
    n_done: usize,
    counted: Option<Counted>,
}

/// What blocks are counted for.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Counted {
    /// A pass of the picture.
    Pass(u32),
    /// The preview of a matrix of irradiance.
    Irradiance(usize),
}

impl PassBlocks {
    /// A block is there.
    fn came(&mut self, counted: Counted) {
        if self.counted != Some(counted) {
            (self.n_done, self.counted) = (0, Some(counted));
        }
        self.n_done += 1;
    }

    /// 0…1; a matrix of irradiance may have other blocks than the picture.
    fn done(&self) -> f32 {
        (self.n_done as f32 / self.n_blocks.max(1) as f32).min(1.0)
    }
}

impl Session {
    /// Starts a bake of the open scene or stack, ending one that runs; from a camera of its own, else from that of the settings.
    pub fn start_bake(&mut self, settings: &BakeSettings, camera: Option<Camera>, passes: Passes) {
        if let Some(stack) = self.opened.as_ref().and_then(|opened| opened.stack.clone()) {
            self.stop_baking();
            let BakeConfig { tolerance_db, seed, method, block, .. } = settings.config;
            self.history.clear();
            self.bake_began = Instant::now();
            let job = StackJob { stack, tolerance_db, method, block, seed, memory_bytes: MEMORY_BYTES };
            if let Err(why) = job.check_memory(memory_bytes()) {
                self.bake = BakeState::Failed(why.to_string());
                return;
            }
            self.bake = BakeState::Preparing;
            self.baking = self.spawn("bake", move |post| task::bake_stack(job, post));
            return;
        }
        let Some(scene) = self.opened.as_ref().and_then(|opened| opened.scene.clone()) else {
            return;
        };
        let (job, n_threads) = match self.fitting_job(settings, camera.clone()) {
            Ok(fitting) => fitting,
            Err(why) => {
                self.bake = BakeState::Failed(why);
                return;
            }
        };
        self.begun = Some(Begun::new(scene, settings.clone(), camera));
        self.begin(BakeJob { passes, ..job }, n_threads, None);
    }

    /// Goes on with a bake that was stopped, where it is of this view.
    pub fn resume_bake(&mut self, settings: &BakeSettings, camera: Option<&Camera>) {
        if self.n_resumable(settings, camera) == 0 {
            return;
        }
        match self.fitting_job(settings, self.begun.as_ref().and_then(Begun::camera)) {
            Ok((job, n_threads)) => self.begin(job, n_threads, self.half_done()),
            Err(why) => self.bake = BakeState::Failed(why),
        }
    }

    /// What would be baked with some settings, or why nothing can be.
    pub(super) fn job(&self, settings: &BakeSettings, camera: Option<Camera>) -> Result<BakeJob, String> {
        const NO_CAMERA: &str = "the scene has no camera and no surfaces to look at; open a scene with meshes";
        let scene = self.opened.as_ref().and_then(|opened| opened.scene.clone()).ok_or("no scene is open; open one")?;
        let camera = seen_from(&scene, settings, camera.as_ref()).cloned().ok_or(NO_CAMERA)?;
        let of_file = if settings.illuminance { OfFile::All } else { OfFile::Nothing };
        let work_planes = settings.work_plane.filter(|_| settings.illuminance).into_iter().collect();
        let irradiance = IrradianceRequest { of_file, nodes: Vec::new(), work_planes };
        let irradiance = irradiance.rows(&scene).map_err(words)?;
        let (film, config, passes) = (settings.film, settings.config.clone(), Passes::Progressive);
        Ok(BakeJob { scene, camera, film, config, passes, irradiance })
    }

    pub(super) fn begin(&mut self, job: BakeJob, n_threads: usize, half_done: Option<HalfDone>) {
        self.stop_baking();
        self.views.baking = Some(job.camera.clone());
        self.bake = BakeState::Preparing;
        self.history.clear();
        self.bake_began = Instant::now();
        let (cache, focus) = (self.cache.clone(), self.focus.clone());
        let glimpse = glimpse::job(&job).filter(|_| half_done.is_none() && !self.shows_view_of(&job));
        let there = (half_done, self.earlier_bakes());
        self.baking = self.spawn("bake", move |post| task::bake((job, n_threads), glimpse, there, cache, &focus, post));
    }

    /// Stops the bake; what was done stays.
    pub fn cancel_bake(&mut self) {
        if self.bake.is_running() {
            let was_aside = self.is_aside();
            self.stop_baking();
            self.bake = if was_aside { self.state_of_shown() } else { BakeState::Stopped };
            self.count();
        }
    }

    /// Somebody looks at a pixel of the picture that is shown: a bake of that view that runs makes what is there first.
    pub fn attend(&self, pixel: Option<[u32; 2]>) {
        let baking = self.incoming.as_ref().filter(|_| !self.is_aside());
        let films = self.shown.as_ref().zip(baking).map(|(shown, baking)| (shown.film(), baking.film()));
        let scaled = |px: u32, from: u32, to: u32| (u64::from(px) * u64::from(to) / u64::from(from.max(1))) as u32;
        let there = |[x, y]: [u32; 2]| match films {
            Some((from, to)) => [scaled(x, from.width, to.width), scaled(y, from.height, to.height)],
            None => [x, y],
        };
        let own = self.shown.as_ref().and_then(|shown| shown.camera.as_ref());
        let is_of_shown = own.zip(self.views.baking.as_ref()).is_none_or(|(own, baking)| sees_alike(own, baking));
        self.focus.set(pixel.filter(|_| is_of_shown && !self.is_aside()).map(there));
    }

    pub(super) fn stop_baking(&mut self) {
        self.others.extend(self.baking.take().map(Task::stopped));
        std::mem::take(&mut self.focus).leave();
        self.incoming = None;
        self.drop_aside();
    }

    pub(super) fn bake_event(&mut self, event: BakeEvent) {
        match event {
            BakeEvent::Started { header, n_blocks, n_passes } => {
                self.begun.iter_mut().for_each(|begun| begun.started(header.clone(), n_passes));
                self.pass_blocks = PassBlocks { n_blocks, ..PassBlocks::default() };
                self.bake_started(header, n_passes);
            }
            BakeEvent::BlockDone { pass, block_idx, factors } => {
                self.begun.iter_mut().for_each(|begun| begun.block_done(pass, block_idx, &factors));
                self.pass_blocks.came(Counted::Pass(pass));
                self.block_done(block_idx, &factors);
            }
            BakeEvent::IrradianceDone { set, block_idx, factors, is_preview } => {
                if is_preview {
                    self.pass_blocks.came(Counted::Irradiance(set));
                }
                self.irradiance_done(set, block_idx, &factors);
            }
            BakeEvent::Denoised { blocks, .. } => {
                blocks.iter().for_each(|(block_idx, factors)| self.block_done(*block_idx, factors));
            }
            BakeEvent::IrradianceDenoised { set, blocks } => {
                blocks.iter().for_each(|(block_idx, factors)| self.irradiance_done(set, *block_idx, factors));
            }
            BakeEvent::Progress { pass, done, secs_left } => {
                if let BakeState::Running { n_passes, .. } = self.bake {
                    let pass_done = self.pass_blocks.done();
                    self.bake = BakeState::Running { pass, n_passes, done, pass_done, secs_left };
                }
                if self.figures_at.elapsed() > FIGURES_EVERY {
                    self.count();
                }
            }
            BakeEvent::PassDone { error_db, .. } => {
                self.pass_blocks.n_done = 0;
                if self.is_aside() {
                    return;
                }
                match self.incoming.take() {
                    Some(incoming) => self.show(incoming),
                    None => self.n_whole += 1,
                }
                self.error_db = Some(error_db);
                self.count();
            }
        }
    }

    pub(super) fn bake_started(&mut self, header: Arc<BakeHeader>, n_passes: u32) {
        self.bake = BakeState::Running { pass: 0, n_passes, done: 0.0, pass_done: 0.0, secs_left: None };
        let camera = self.camera_of(&header);
        let frame = Arc::new(Frame { width: header.width, height: header.height, groups: header.empty_groups() });
        self.arriving = header.empty_irradiance().into();
        self.begin_view(Shown { header, camera, frame, irradiance: Vec::new(), packed: None, is_glimpse: false });
        // Of a bake that goes on, the first ones are shown already.
        let there = self.incoming.as_ref().or(self.shown.as_ref());
        let n_there = there.map_or(0, |shown| shown.irradiance.len());
        self.arriving.drain(..n_there.min(self.arriving.len()));
    }

    /// A first look at what is about to be baked.
    pub(super) fn glimpsed(&mut self, Glimpse { header, groups }: Glimpse) {
        let camera = self.camera_of(&header);
        let frame = Arc::new(Frame { width: header.width, height: header.height, groups });
        self.show_beside(Shown { header, camera, frame, irradiance: Vec::new(), packed: None, is_glimpse: true });
    }

    /// The camera of the bake that runs, or of a bake of the scene that is open.
    pub(super) fn camera_of(&self, header: &BakeHeader) -> Option<Camera> {
        let own = self.views.baking.as_ref().filter(|camera| camera.name == header.camera);
        own.or(header.view.as_ref()).or_else(|| Camera::named(self.cameras(), &header.camera)).cloned()
    }

    pub(super) fn block_done(&mut self, block_idx: usize, factors: &[Arc<BlockFactors>]) {
        let is_shown = self.incoming.is_none();
        let Some(shown) = self.incoming.as_mut().or(self.shown.as_mut()) else { return };
        shown.packed = None;
        for (group, factors) in Arc::make_mut(&mut shown.frame).groups.iter_mut().zip(factors) {
            group.blocks[block_idx] = Some(factors.clone());
        }
        if is_shown {
            self.changed.absorb(Changed::Blocks((0..factors.len()).map(|group| (group, block_idx)).collect()));
        }
    }

    /// A matrix of irradiance is shown once all of it is there; what is finer then takes its place block by block.
    fn irradiance_done(&mut self, set: usize, block_idx: usize, factors: &[Arc<BlockFactors>]) {
        let is_shown = self.incoming.is_none();
        let Some(shown) = self.incoming.as_mut().or(self.shown.as_mut()) else { return };
        let n_there = shown.irradiance.len();
        let groups = match set.checked_sub(n_there) {
            None => {
                self.has_finer_lux |= is_shown;
                &mut shown.irradiance[set]
            }
            Some(nth) => match self.arriving.get_mut(nth) {
                Some(groups) => groups,
                None => return,
            },
        };
        for (group, factors) in groups.iter_mut().zip(factors) {
            group.blocks[block_idx] = Some(factors.clone());
        }
        let is_whole = |groups: &Vec<BlockLowRank>| groups.iter().all(|group| group.blocks.iter().all(Option::is_some));
        while self.arriving.front().is_some_and(is_whole) {
            shown.irradiance.extend(self.arriving.pop_front());
        }
        if is_shown && shown.pixel_irradiance() == Some(set) {
            self.changed.absorb(Changed::Blocks((0..factors.len()).map(|group| (group, block_idx)).collect()));
        }
    }

    pub(super) fn bake_ended(&mut self, result: Result<Option<Bake>, String>, notices: &mut Vec<Notice>) {
        self.others.extend(self.baking.take());
        let mut aside = self.incoming.take().filter(|_| self.is_aside());
        self.bake = match result {
            Ok(Some(bake)) => {
                let figures = bake.figures();
                self.history.push([self.bake_began.elapsed().as_secs_f32(), figures.error_db.total]);
                notices.push(Notice::Said(earlier::baked_words(&bake, &figures)));
                self.forget_earlier(&bake.header);
                // The file will hold these, a little less exact than the blocks that came one by one.
                if let Some(shown) = aside.as_mut().or(self.shown.as_mut()) {
                    Arc::make_mut(&mut shown.frame).groups = bake.groups;
                    shown.header = bake.header;
                    (shown.irradiance, shown.packed) = (bake.irradiance, bake.packed);
                }
                match aside.take() {
                    Some(shown) => self.keep_aside(shown, Some(figures.error_db)),
                    None => {
                        self.error_db = Some(figures.error_db);
                        self.is_another();
                    }
                }
                BakeState::Done
            }
            Ok(None) => BakeState::Stopped,
            Err(why) => BakeState::Failed(why),
        };
        self.drop_aside();
        self.count();
    }

    /// The bake was made before.
    pub(super) fn bake_found(&mut self, bake: Bake, notices: &mut Vec<Notice>) {
        self.others.extend(self.baking.take());
        self.incoming = None;
        self.drop_aside();
        self.show_finished(bake);
        let db = self.error_db.map_or(f32::NAN, |error| error.total);
        notices.push(Notice::Said(format!("Baked before: {db:.1} dB")));
    }

    /// Shows a bake that was made before.
    pub(super) fn show_finished(&mut self, bake: Bake) {
        let Bake { header, groups, irradiance, packed } = bake;
        let camera = self.camera_of(&header);
        let frame = Arc::new(Frame { width: header.width, height: header.height, groups });
        let found = Shown { header, camera, frame, irradiance, packed, is_glimpse: false };
        self.begin_view(found);
        // The same view as before: what was found takes its place.
        if let Some(found) = self.incoming.take() {
            self.show(found);
        }
        self.bake = BakeState::Done;
        self.count();
        self.error_db = self.figures.as_ref().map(|figures| figures.error_db);
    }

    pub(super) fn show(&mut self, shown: Shown) {
        self.shown = Some(shown);
        self.is_another();
    }

    /// Another matrix is shown: what was made of the one before no longer counts.
    pub(super) fn is_another(&mut self) {
        self.n_whole += 1;
        self.n_counts += 1;
        self.changed = Changed::All;
    }

    /// Counts ranks and bytes of what is there.
    pub(super) fn count(&mut self) {
        // What is glimpsed at says nothing of the bake.
        let shown = self.shown.as_ref().filter(|shown| !shown.is_glimpse);
        self.figures = shown.map(|shown| shown.bake().figures());
        (self.figures_at, self.n_counts) = (Instant::now(), self.n_counts + 1);
        self.n_lux += u64::from(std::mem::take(&mut self.has_finer_lux));
        // Before the first block there is no error to speak of.
        let counted = self.figures.as_ref().filter(|figures| figures.max_rank > 0 && self.bake.is_running());
        if let Some(figures) = counted {
            self.history.push([self.bake_began.elapsed().as_secs_f32(), figures.error_db.total]);
        }
    }

    /// How often the blocks that are there were counted, or others took their place; what is made of them is as new as that.
    pub fn n_counts(&self) -> u64 {
        self.n_counts
    }

    /// How often those counts found finer irradiance than the one before; what is measured of it is as new as that.
    pub fn n_lux(&self) -> u64 {
        self.n_lux
    }
}

#[cfg(test)]
mod tests {
    use clerestory_transport::camera::Film;
    use clerestory_transport::irradiance::IrradianceRows;
    use clerestory_transport::sensors::SensorGrid;
    use glam::Vec3;

    use super::*;
    use crate::support::room_job;

    /// What a bake of the room tells, which holds the light that arrives at its pixels, and behind that more points than pixels.
    fn told() -> Vec<BakeEvent> {
        let grid = SensorGrid {
            name: "grid".into(),
            origin: Vec3::new(-0.4, -0.5, 0.4),
            u_edge: Vec3::X * 0.5,
            v_edge: Vec3::NEG_Z * 0.5,
            normal: Vec3::Y,
            size: [48, 16],
            left_out: Vec::new(),
        };
        let config = BakeConfig { spp: 2, tolerance_db: 10.0, ..BakeConfig::default() };
        let irradiance = vec![IrradianceRows::Pixels, IrradianceRows::Grid(grid)];
        let (film, passes) = (Film { width: 20, height: 16 }, Passes::PreviewAndFinal);
        let mut events = Vec::new();
        let job = BakeJob { passes, irradiance, ..room_job(film, config) };
        job.run(|event| {
            events.push(event);
            std::ops::ControlFlow::Continue(())
        })
        .unwrap()
        .unwrap();
        events
    }

    /// Whether an event brings a block of a matrix of irradiance as it stays.
    fn is_final(event: &BakeEvent, of: usize) -> bool {
        matches!(event, BakeEvent::IrradianceDone { set, is_preview: false, .. } if *set == of)
    }

    #[test]
    fn a_bake_that_goes_on_fills_the_matrices_of_irradiance_that_are_not_there_yet() {
        let events = told();
        let mut session = Session::new(Arc::new(|_| {}));
        let before_grid = events.iter().take_while(|event| !is_final(event, 1));
        before_grid.for_each(|event| session.bake_event(event.clone()));
        assert_eq!(session.shown.as_ref().unwrap().irradiance.len(), 1, "the grid comes last");
        session.cancel_bake();
        events.into_iter().for_each(|event| session.bake_event(event));
        let shown = session.shown.as_ref().unwrap();
        let partitions: Vec<_> = shown.irradiance.iter().map(|groups| groups[0].partition.clone()).collect();
        assert_eq!(partitions, shown.header.partitions()[1..]);
    }

    #[test]
    fn what_was_measured_is_old_once_a_stopped_bake_has_finer_irradiance() {
        let mut session = Session::new(Arc::new(|_| {}));
        let (mut events, mut n_finer) = (told().into_iter(), 0);
        while n_finer == 0 {
            let event = events.next().unwrap();
            n_finer += usize::from(is_final(&event, 0));
            session.bake_event(event);
        }
        let before = session.n_lux();
        session.cancel_bake();
        assert_eq!(session.n_lux(), before + 1);
        session.count();
        assert_eq!(session.n_lux(), before + 1, "nothing came since");
    }

    #[test]
    fn each_pass_and_each_matrix_of_irradiance_is_counted_from_its_first_block() {
        let mut blocks = PassBlocks { n_blocks: 4, ..PassBlocks::default() };
        let mut come = |counted, n_blocks: usize| {
            (0..n_blocks).for_each(|_| blocks.came(counted));
            blocks.done()
        };
        assert_eq!(come(Counted::Pass(0), 4), 1.0);
        assert_eq!(come(Counted::Irradiance(0), 3), 0.75);
        assert_eq!(come(Counted::Irradiance(1), 9), 1.0);
        assert_eq!(come(Counted::Pass(1), 1), 0.25);
        assert_eq!(come(Counted::Pass(1), 1), 0.5);
    }
}
