//! Pictures, frames, scenes and bakes as files, written beside the window.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

use clerestory_transport::archive;

use super::lamps::LampLight;
use super::seen::Seen;
use super::task::{self, Fact, Post, Task};
use super::{Session, sheet};
use crate::crash;
use crate::export::ExportOptions;
use crate::look::Look;
use crate::look::snapshot::Snapshot;
use crate::sequence::Sequence;
use crate::words::in_words;

impl Session {
    /// Writes the picture under `look` in the background, with the light of its free lamps; without `light` that is traced.
    pub fn export(&mut self, look: Look, light: Option<LampLight>, path: PathBuf, options: ExportOptions) {
        let Some(subject) = self.subject() else { return };
        self.write(path.clone(), move || Seen::of(subject, look, light).save(&path, &options));
    }

    /// Makes the same picture for the clipboard in the background; it comes as a notice.
    pub fn copy(&mut self, look: Look, light: Option<LampLight>) {
        let Some(subject) = self.subject() else { return };
        let task = self.spawn_writer("copy", "the picture was not copied".into(), move |post| {
            let developed = Seen::of(subject, look, light).develop().map_err(|error| in_words(&error));
            let _ = post.send(Fact::Developed(developed), Duration::ZERO);
        });
        self.others.extend(task);
    }

    /// Writes the open scene with its lights under `look` in the background.
    pub fn export_gltf(&mut self, look: Look, path: PathBuf) {
        let opened = self.opened.as_ref().and_then(|opened| Some((opened.scene.clone()?, opened.source.clone()?)));
        let Some((scene, source)) = opened else { return };
        let lost = not_saved(&path);
        let body = move |post: &Post| task::write_gltf(&scene, source, &look, &path, post);
        let task = self.spawn_writer("write", lost, body);
        self.others.extend(task);
    }

    /// Writes the frames of a timeline in the background.
    pub fn export_frames(&mut self, sequence: Sequence) {
        let Some(subject) = self.subject() else { return };
        self.cancel_frames();
        let n_frames = sequence.n_frames();
        let body = move |post: &Post| task::write_frames(&sequence, subject, post);
        let task = self.spawn_writer("frames", "not all frames were saved".into(), body);
        self.frames = task.map(|task| (task, (0, n_frames)));
    }

    /// Writes the pictures of looks on one sheet in the background.
    pub fn save_sheet(&mut self, snapshots: Vec<Snapshot>, path: PathBuf) {
        let Some(subject) = self.subject() else { return };
        let lost = not_saved(&path);
        let task = self.spawn_writer("sheet", lost, move |post| sheet::write(&snapshots, subject, &path, post));
        self.others.extend(task);
    }

    /// Frames that are written, and how many there will be, while a sequence is under way.
    pub fn frames(&self) -> Option<(u32, u32)> {
        self.frames.as_ref().map(|(_, progress)| *progress)
    }

    /// Stops writing frames; those that are there stay.
    pub fn cancel_frames(&mut self) {
        self.others.extend(self.frames.take().map(|(task, _)| task.stopped()));
    }

    /// Writes the bake that is shown in the background.
    pub fn save_bake(&mut self, path: PathBuf) {
        let Some(shown) = &self.shown else { return };
        let (bake, header) = (shown.bake(), shown.header.clone());
        let task = self.write(path.clone(), move || {
            archive::write(&bake, &path)?;
            Ok(None)
        });
        self.saving = task.map(|task| (task, header));
    }

    /// Writes it at once: the program ends.
    ///
    /// # Errors
    /// If the file cannot be written, in words.
    pub fn save_bake_now(&self, path: &Path) -> Result<(), String> {
        let Some(shown) = &self.shown else { return Ok(()) };
        archive::write(&shown.bake(), path).map_err(|error| format!("{}: {}", not_saved(path), in_words(&error.into())))
    }

    /// A file is there.
    pub(super) fn written(&mut self, task: u64) {
        if let Some((_, header)) = self.saving.take_if(|(saving, _)| *saving == task) {
            self.saved = Some(header);
        }
    }

    /// Whether a finished bake of pictures is shown that is in no file. Bakes of scenes are found again.
    pub fn has_unsaved_stack(&self) -> bool {
        let is_stack = self.opened.as_ref().is_some_and(|opened| opened.stack.is_some());
        let baked = self.shown.as_ref().filter(|shown| is_stack && shown.packed.is_some());
        baked.is_some_and(|shown| !self.saved.as_ref().is_some_and(|saved| Arc::ptr_eq(saved, &shown.header)))
    }

    /// Whether a bake of pictures runs.
    pub fn is_baking_stack(&self) -> bool {
        self.bake.is_running() && self.opened.as_ref().is_some_and(|opened| opened.stack.is_some())
    }

    /// Does what writes a file, and says a warning about it where there is one. Answers with the number of the task.
    pub(super) fn write(
        &mut self,
        path: PathBuf,
        job: impl FnOnce() -> anyhow::Result<Option<String>> + Send + 'static,
    ) -> Option<u64> {
        let task = self.spawn_writer("write", not_saved(&path), move |post| {
            post.written(job().map(|warning| (format!("Saved {}", path.display()), warning)));
        });
        let id = task.as_ref().map(Task::id);
        self.others.extend(task);
        id
    }

    /// Starts a thread whose end nobody else watches: where it panics, what is `lost` by that is told as any other failure.
    fn spawn_writer(&mut self, name: &str, lost: String, body: impl FnOnce(&Post) + Send + 'static) -> Option<Task> {
        self.spawn(name, move |post| {
            if let Err(words) = crash::guarded(|| body(&post)) {
                post.written(Err(anyhow::Error::msg(format!("{lost}: {words}"))));
            }
        })
    }
}

/// What is said first of a file that is not there.
fn not_saved(path: &Path) -> String {
    format!("{} was not saved", path.display())
}

#[cfg(test)]
mod tests {
    use super::super::Notice;
    use super::*;

    #[test]
    fn a_writer_that_panics_is_told_as_a_failure() {
        let mut session = Session::new(Arc::new(|_| {}));
        session.write("hall.png".into(), || panic!("injected by a test of the writers"));
        let mut notices = Vec::new();
        while !session.others.is_empty() {
            notices.extend(session.drain());
            std::thread::sleep(Duration::from_millis(2));
        }
        notices.extend(session.drain());
        let [Notice::Failed(words)] = notices.as_slice() else { panic!("{notices:?}") };
        assert!(words.starts_with("hall.png was not saved: it ended unexpectedly"), "{words}");
    }
}
