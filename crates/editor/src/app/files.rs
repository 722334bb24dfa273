//! Files that are asked for and opened, and work that is not lost on the way.

use std::path::{Path, PathBuf};

use eframe::egui::{Context, ViewportCommand};

use super::App;
use crate::action::{Action, FileTask, is_look};
use crate::panels::dialogs::FileQuestion;
use crate::session::Source;

/// Recent files that are remembered, scenes and looks.
const MAX_RECENT: usize = 12;
/// Numbers that are tried for a name that is suggested.
const MOST_TRIED: u32 = 1000;

/// A name that replaces no file of a folder, such as `scene.png`, or `scene-2.png` where that one is there.
fn unused_name(task: FileTask, folder: &Path, stem: &str, after: &str) -> String {
    let numbered = (2..MOST_TRIED).map(|nth| format!("{stem}-{nth}{after}"));
    let plain = format!("{stem}{after}");
    let mut names = std::iter::once(plain.clone()).chain(numbered);
    names.find(|name| !task.replaces(&folder.join(name))).unwrap_or(plain)
}

/// A name without its ending. A dot before it begins no ending but hides a file, and what is written is to be found.
fn stem_of(name: &str) -> &str {
    let visible = name.trim_start_matches('.');
    let stem = visible.rsplit_once('.').map_or(visible, |(stem, _)| stem);
    if stem.is_empty() { "scene" } else { stem }
}

/// Puts a file before those of lately. The scene that was open last stays among them, however many looks come after it: a look that is
/// opened alone goes with it.
fn put_first(recent: &mut Vec<PathBuf>, path: PathBuf) {
    recent.retain(|other| *other != path);
    recent.insert(0, path);
    let last_scene = recent.iter().position(|path| !is_look(path));
    if let Some(place) = last_scene.filter(|place| *place >= MAX_RECENT) {
        recent.swap(place, MAX_RECENT - 1);
    }
    recent.truncate(MAX_RECENT);
}

/// Recent files of a window that began with those of `before`: what was opened in it since comes first, then what is `there`, where another
/// window may have left some.
pub(super) fn merged_recent(own: &[PathBuf], before: &[PathBuf], there: Vec<PathBuf>) -> Vec<PathBuf> {
    let is_as_before = |rest: &[PathBuf]| {
        let mut before = before.iter();
        rest.iter().all(|path| before.any(|other| other == path))
    };
    let n_opened = (0..own.len()).find(|n| is_as_before(&own[*n..])).unwrap_or(own.len());
    let mut merged = there;
    own[..n_opened].iter().rev().for_each(|path| put_first(&mut merged, path.clone()));
    merged
}

/// What the window is called: its scene, the file of its look, and a dot before what is not saved.
fn title_of(scene: &str, look: Option<&Path>, is_unsaved: bool) -> String {
    if scene.is_empty() {
        return "Clerestory".into();
    }
    let mark = if is_unsaved { "• " } else { "" };
    let look = look.and_then(Path::file_name).map_or_else(String::new, |name| format!(", {}", name.display()));
    format!("{mark}{scene}{look} – Clerestory")
}

impl App {
    pub(super) fn ask(&mut self, task: FileTask) {
        if task.writes_pictures() && self.lacks_whole_picture() {
            return;
        }
        let (stem, folder) = (self.stem(), self.folder());
        let unused = |after: &str| unused_name(task, &folder, stem, after);
        let own = self.look_path.clone().filter(|_| task == FileTask::SaveLook);
        let suggestion = match task {
            FileTask::OpenScene | FileTask::OpenPictures => String::new(),
            FileTask::OpenLook | FileTask::AddLooks => String::new(),
            FileTask::OpenProfile | FileTask::FindScene | FileTask::OpenTarget | FileTask::OpenSky => String::new(),
            FileTask::SaveSchedule => unused(".csv"),
            FileTask::SaveValues => unused("-lux.csv"),
            FileTask::SaveLook => own.as_ref().map_or_else(|| unused(".look"), |path| path.display().to_string()),
            FileTask::Export => unused(self.export.format.ending()),
            FileTask::SaveSheet => unused("-looks.png"),
            // A name with # of its own has two places for digits.
            FileTask::ExportFrames => unused_name(task, &folder, &stem.replace('#', "-"), "_####.png"),
            FileTask::ExportGltf => unused("-lit.glb"),
            FileTask::SaveBake => unused(".transport"),
        };
        if task != FileTask::SaveLook {
            self.after_saving = None;
        }
        if task != FileTask::OpenProfile {
            // The next profile is not for what another question took the place of.
            (self.profile_at_px, self.profile_for) = (None, None);
        }
        self.asked_frames = None;
        self.question = Some(FileQuestion::new(task, &suggestion, folder, own, self.dialogs));
    }

    /// What files of what is open are called, without an ending.
    fn stem(&self) -> &str {
        stem_of(self.session.opened.as_ref().map_or("", |opened| opened.name.as_str()))
    }

    /// Where a file goes that nobody names; it replaces none.
    pub(super) fn suggested(&self, task: FileTask, after: &str) -> PathBuf {
        let folder = self.folder();
        folder.join(unused_name(task, &folder, self.stem(), after))
    }

    /// Where files are looked for and written first: beside the scene that is open, else where the program was started. A start
    /// by a click has no place of its own, and is at the root of the disk.
    fn folder(&self) -> PathBuf {
        let opened = self.session.opened.as_ref().and_then(|opened| opened.path.as_ref());
        let beside = opened.and_then(|path| std::path::absolute(path).ok()?.parent().map(PathBuf::from));
        let started_in = || std::env::current_dir().ok().filter(|folder| folder.parent().is_some());
        beside.or_else(started_in).or_else(dirs::home_dir).unwrap_or_default()
    }

    pub(super) fn open(&mut self, path: PathBuf) {
        self.open_source(Source::File(path));
    }

    /// Opens something else than what is open, or was about to be read again.
    pub(super) fn open_source(&mut self, source: Source) {
        self.reloading = None;
        self.opening.given_up = self.look.clone();
        let chosen = self.choices.kept.of(&source);
        self.session.open_with(source, chosen);
    }

    /// What is open now is the first of the recent files, however it was asked for.
    pub(super) fn remember_opened(&mut self) {
        let opened = self.session.opened.as_ref().and_then(|opened| opened.path.clone());
        opened.into_iter().for_each(|path| self.remember(path));
    }

    /// A file is the first of the recent ones.
    pub(super) fn remember(&mut self, path: PathBuf) {
        put_first(&mut self.recent, std::path::absolute(&path).unwrap_or(path));
    }

    pub(super) fn answered(&mut self, answer: Option<Option<PathBuf>>) {
        let Some(path) = answer else { return };
        if let (Some(question), Some(path)) = (self.question.take(), path) {
            self.actions.push(question.action(path));
        } else {
            (self.profile_at_px, self.profile_for) = (None, None);
            self.stay();
        }
    }

    /// Does something that loses the look, or asks first.
    pub(super) fn unless_unsaved(&mut self, again: Action, job: impl FnOnce(&mut App)) {
        let may_lose = std::mem::take(&mut self.may_lose_look);
        if self.is_unsaved() && !may_lose {
            self.unsaved = Some(again);
        } else {
            job(self);
        }
    }

    pub(super) fn close_or_ask(&mut self, ctx: &Context) {
        if self.closes_later(ctx) || !ctx.input(|input| input.viewport().close_requested()) {
            return;
        }
        let may_lose = std::mem::take(&mut self.may_lose_look);
        if self.asks_before_loss(&Action::Quit) {
            // What was said of the look counts until somebody stays.
            self.may_lose_look = may_lose;
            ctx.send_viewport_cmd(ViewportCommand::CancelClose);
        } else if self.is_unsaved() && !may_lose {
            ctx.send_viewport_cmd(ViewportCommand::CancelClose);
            self.unsaved = Some(Action::Quit);
        } else if self.is_unsaved() {
            // What was given up is not offered at the next start.
            self.saved_look = self.look.clone();
            self.keep_unsaved(ctx);
        }
    }

    pub(super) fn set_title(&mut self, ctx: &Context) {
        let name = self.session.opened.as_ref().map_or("", |opened| opened.name.as_str());
        let title = title_of(name, self.look_path.as_deref(), self.is_unsaved());
        if title != self.title {
            ctx.send_viewport_cmd(ViewportCommand::Title(title.clone()));
            self.title = title;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_window_is_called_by_its_scene_and_the_file_of_its_look() {
        let look = Some(Path::new("/looks/evening.look"));
        assert_eq!(title_of("", look, true), "Clerestory");
        assert_eq!(title_of("hall.glb", None, false), "hall.glb – Clerestory");
        assert_eq!(title_of("hall.glb", look, true), "• hall.glb, evening.look – Clerestory");
    }

    #[test]
    fn every_name_has_a_stem_that_files_can_be_called_by() {
        let names = ["hall.glb", "hall v1.2.glb", "stage", ".frames", ".hall.glb", ".glb", ".", "..", ""];
        let stems = ["hall", "hall v1.2", "stage", "frames", "hall", "glb", "scene", "scene", "scene"];
        assert_eq!(names.map(stem_of), stems);
    }

    #[test]
    fn files_that_two_windows_opened_are_all_among_the_recent_ones() {
        let paths = |names: &[&str]| names.iter().map(PathBuf::from).collect::<Vec<_>>();
        let before = paths(&["a.glb", "b.glb", "c.glb"]);
        let there = paths(&["d.glb", "a.glb", "b.glb", "c.glb"]);
        assert_eq!(merged_recent(&before, &before, there.clone()), there, "nothing was opened here");
        let own = paths(&["e.glb", "c.glb", "a.glb", "b.glb"]);
        assert_eq!(merged_recent(&own, &before, there.clone()), paths(&["e.glb", "c.glb", "d.glb", "a.glb", "b.glb"]));
        assert_eq!(merged_recent(&own, &before, Vec::new()), paths(&["e.glb", "c.glb"]));
        assert_eq!(merged_recent(&[], &[], there.clone()), there);
    }

    #[test]
    fn the_scene_that_was_open_last_stays_among_the_recent_files() {
        let mut recent = vec![PathBuf::from("older.glb")];
        put_first(&mut recent, "hall.glb".into());
        (0..2 * MAX_RECENT).for_each(|nth| put_first(&mut recent, format!("{nth}.look").into()));
        assert_eq!((recent.len(), recent[0].clone()), (MAX_RECENT, PathBuf::from("23.look")));
        let scenes: Vec<&PathBuf> = recent.iter().filter(|path| !is_look(path)).collect();
        assert_eq!(scenes, [&PathBuf::from("hall.glb")]);
        put_first(&mut recent, "hall.glb".into());
        assert_eq!((recent.len(), recent[0].clone()), (MAX_RECENT, PathBuf::from("hall.glb")));
    }
}
