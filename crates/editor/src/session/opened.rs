//! What is open: a scene, a stack or a bake, and what was chosen about it.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

use clerestory_transport::camera::Film;
use clerestory_transport::import::stack::ImageStack;
use clerestory_transport::prepared::PreparedScene;
use clerestory_transport::scene::PunctualLight;

use super::task::{self, Fact, Loaded, Prepared, words};
use super::{BakeState, Chosen, Notice, Session, Source, Stage};
use crate::crash;
use crate::words::in_words;

/// A scene, a stack or a bake that is open.
pub struct Opened {
    /// For people.
    pub name: String,
    /// What it was read from, where it is a scene.
    pub source: Option<Source>,
    /// Where it lies; what is part of the program, or came as bytes, lies nowhere.
    pub path: Option<PathBuf>,
    /// Files beside it that it is made of, there or not.
    pub files: Vec<PathBuf>,
    /// The scene; a bake that was opened from a file has none.
    pub scene: Option<Arc<PreparedScene>>,
    /// The folder of pictures, where one was opened instead.
    pub stack: Option<Arc<ImageStack>>,
    /// What was left behind or had to be guessed, in words.
    pub report: Vec<String>,
    /// Lamps as the file has them.
    pub lamps: Vec<PunctualLight>,
    /// What was chosen in the window.
    pub chosen: Chosen,
    /// The scene of a bake that was opened, for what is not baked.
    pub of_bake: Option<SceneOfBake>,
}

/// The scene of a bake that was opened.
pub enum SceneOfBake {
    /// It is being looked for.
    Waiting,
    /// Here it is.
    Found(Arc<PreparedScene>),
    /// It was not found, or is another one: why.
    Missing(String),
}

impl Opened {
    /// Whether it was opened as a finished bake.
    pub fn is_bake(&self) -> bool {
        self.of_bake.is_some()
    }

    /// Whether it has lamps that may be counted in other units.
    pub fn has_plain_lamps(&self) -> bool {
        self.lamps.iter().any(|lamp| lamp.profile.is_none())
    }
}

impl Session {
    /// Opens something in the background; what is open stays until it is there.
    pub fn open(&mut self, source: Source) {
        self.open_with(source, Chosen::default());
    }

    /// Reads what is open again, with what was chosen about it.
    pub fn reopen(&mut self, source: Source) {
        let chosen = self.opened.as_ref().map_or_else(Chosen::default, |opened| opened.chosen.clone());
        self.open_with(source, chosen);
    }

    /// The same, with what is chosen about it.
    pub fn open_with(&mut self, source: Source, chosen: Chosen) {
        self.stop_loading();
        self.stage = Stage::Loading(source.name());
        self.opening = source.path();
        self.opening_source = Some(source.clone());
        self.loading = self.spawn("open", move |post| {
            let name = source.name();
            let loaded = task::load(source, chosen, &post.stop).map_err(|error| in_words(&error));
            let _ = post.send(Fact::Loaded(name, loaded), Duration::ZERO);
        });
        if self.loading.is_none() {
            // That no thread could be started is told.
            self.cancel_opening();
        }
    }

    /// Whether something is being opened.
    pub fn is_opening(&self) -> bool {
        matches!(self.stage, Stage::Loading(_))
    }

    /// Whether it was read, and waits for what is open to go.
    pub fn has_arrived(&self) -> bool {
        self.arrived.is_some()
    }

    /// Gives up what is being opened; what is open stays.
    pub fn cancel_opening(&mut self) {
        if self.is_opening() {
            self.stop_loading();
            self.stage = if self.opened.is_some() { Stage::Ready } else { Stage::Empty };
        }
    }

    /// Makes of the open scene what is chosen about it: it is prepared again in the background.
    pub fn choose(&mut self, chosen: Chosen) {
        let of_scene = |opened: &Opened| Some((opened.scene.clone()?, opened.lamps.clone()));
        let Some((scene, lamps)) = self.opened.as_ref().and_then(of_scene) else { return };
        self.stop_loading();
        self.loading = self.spawn("prepare", move |post| {
            let prepared = task::prepare_again(&scene.scene, lamps, chosen, &post.stop).map_err(words);
            let _ = post.send(Fact::Prepared(prepared), Duration::ZERO);
        });
    }

    /// Number and size of the pictures that were opened, or that the opened bake is of.
    pub fn pictures(&self) -> Option<(usize, Film)> {
        let of_stack = || self.opened.as_ref()?.stack.as_ref().map(|stack| (stack.images.len(), stack.film));
        let of_bake = || {
            let header = &self.shown.as_ref()?.header;
            let film = Film { width: header.width, height: header.height };
            header.basis.is_measured().then(|| (header.basis.n_cols(), film))
        };
        of_stack().or_else(of_bake)
    }

    pub(super) fn loaded(&mut self, name: String, result: Result<Loaded, String>, notices: &mut Vec<Notice>) {
        self.others.extend(self.loading.take());
        match result {
            Ok(loaded) => self.arrived = Some((name, loaded)),
            Err(why) => self.not_opened(name, why, notices),
        }
    }

    fn not_opened(&mut self, name: String, why: String, notices: &mut Vec<Notice>) {
        notices.push(Notice::NotOpened);
        if self.opened.is_some() {
            self.stage = Stage::Ready;
            notices.push(Notice::Failed(format!("{name} could not be opened: {why}")));
        } else {
            self.stage = Stage::Failed(name, why);
        }
    }

    /// What opened or prepared something has panicked.
    pub(super) fn loading_crashed(&mut self, notices: &mut Vec<Notice>) {
        match &self.stage {
            Stage::Loading(name) => self.not_opened(name.clone(), crash::words(), notices),
            _ => notices.push(Notice::NotPrepared(crash::words())),
        }
    }

    /// Puts what was read in the place of what is open, unless that may not go yet.
    pub(super) fn take_arrived(&mut self, notices: &mut Vec<Notice>) {
        if self.holds_opened {
            return;
        }
        let Some((name, loaded)) = self.arrived.take() else { return };
        let path = self.opening.take();
        let source = self.opening_source.take();
        self.keep_earlier(source.as_ref());
        self.stop_baking();
        // The scene of a bake that goes is none of what comes.
        self.stop_finding();
        (self.bake, self.shown, self.error_db, self.figures) = (BakeState::Idle, None, None, None);
        self.forget_views();
        self.stage = Stage::Ready;
        self.history.clear();
        self.begun = None;
        let nothing = Opened {
            name,
            source: None,
            path,
            files: Vec::new(),
            scene: None,
            stack: None,
            report: Vec::new(),
            lamps: Vec::new(),
            chosen: Chosen::default(),
            of_bake: None,
        };
        match loaded {
            Loaded::Scene { scene, report, lamps, chosen, files } => {
                let scene = Some(Arc::from(scene));
                self.opened = Some(Opened { source, files, scene, report, lamps, chosen: *chosen, ..nothing });
            }
            Loaded::Stack(stack) => {
                let report = stack.remarks();
                self.opened = Some(Opened { stack: Some(Arc::new(stack)), report, ..nothing });
            }
            Loaded::Bake(bake) => {
                let folder = nothing.path.as_deref().and_then(Path::parent).map(Path::to_path_buf);
                self.opened = Some(nothing);
                let folder = folder.filter(|_| !bake.header.basis.is_measured());
                let scene = folder.map(|folder| folder.join(&bake.header.scene));
                self.show_finished(bake);
                if let Some(path) = scene {
                    self.find_scene(path);
                }
            }
        }
        notices.push(Notice::Opened);
    }

    pub(super) fn prepared_again(&mut self, result: Result<Prepared, String>, notices: &mut Vec<Notice>) {
        self.others.extend(self.loading.take());
        match (result, &mut self.opened) {
            (Ok(Prepared { scene, chosen, warnings }), Some(opened)) => {
                opened.scene = Some(Arc::from(scene));
                opened.chosen = chosen;
                for warning in warnings {
                    if !opened.report.contains(&warning) {
                        opened.report.push(warning);
                    }
                }
                let source = opened.source.clone();
                self.keep_earlier(source.as_ref());
                self.stop_baking();
                (self.bake, self.shown, self.error_db, self.figures) = (BakeState::Idle, None, None, None);
                self.forget_views();
                notices.push(Notice::PreparedAgain);
            }
            (Ok(_), None) => {}
            (Err(why), _) => notices.push(Notice::NotPrepared(why)),
        }
    }

    pub(super) fn remarked(&mut self, remarks: Vec<String>) {
        if let Some(opened) = &mut self.opened {
            opened
                .report
                .extend(remarks.into_iter().filter(|remark| !opened.report.contains(remark)).collect::<Vec<_>>());
        }
    }
}
