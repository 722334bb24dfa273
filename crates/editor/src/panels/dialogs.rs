//! Windows in front of everything: choosing a file, and what to do with a look that was not saved.

use std::path::{Path, PathBuf, is_separator};
use std::pin::Pin;
use std::sync::Arc;
use std::task::{Context as TaskContext, Poll, Wake, Waker};
use std::time::Duration;

use eframe::egui::{self, Button, Context, Key, Modal, RichText, ScrollArea, TextEdit, Ui};

use super::menu::are_keys_listed;
use super::sight::keep_in_sight;
use crate::action::{Action, FileTask};
use crate::theme;

/// Width of a question about a file, and of one about work, points, and what of the window stays beside it at least.
const WIDTH: f32 = 460.0;
const ANSWERS_WIDTH: f32 = 400.0;
const BESIDE: f32 = 40.0;
/// Points that title, field and buttons take beside what else is asked, and the least that is left for this.
const BELOW: f32 = 210.0;
const LEAST: f32 = 64.0;

type Answer = Pin<Box<dyn Future<Output = Option<PathBuf>>>>;

/// A dialog of the desktop. Where there is none it ends without an answer too, at once or after a while; but only one that
/// was shown takes the focus from the window.
struct NativeDialog {
    answer: Answer,
    took_focus: bool,
}

impl NativeDialog {
    /// `Some` once it has ended: the file, nothing if it was closed. A dialog that was never shown is [`Ended::Unseen`].
    fn poll(&mut self, window_has_focus: bool, waker: &Waker) -> Option<Ended> {
        self.took_focus |= !window_has_focus;
        let Poll::Ready(file) = self.answer.as_mut().poll(&mut TaskContext::from_waker(waker)) else {
            return None;
        };
        Some(match file {
            Some(path) => Ended::Chosen(path),
            None if self.took_focus => Ended::Closed,
            None => Ended::Unseen,
        })
    }
}

/// How a dialog of the desktop ended.
#[derive(Debug, PartialEq, Eq)]
enum Ended {
    Chosen(PathBuf),
    Closed,
    Unseen,
}

/// Where files are asked for.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum FileDialogs {
    /// In the desktop's own dialog where there is one, and in a path field.
    #[default]
    Desktop,
    /// In a path field alone.
    FieldOnly,
}

/// A file is being asked for: in the desktop's own dialog where there is one, and in a path field at any rate.
pub struct FileQuestion {
    task: FileTask,
    path: String,
    /// The path as it was at first.
    suggestion: String,
    /// What a path that names no folder is relative to.
    folder: PathBuf,
    native: Option<NativeDialog>,
    dialogs: FileDialogs,
    is_fresh: bool,
    /// The file that may be replaced without being asked for: the look's own, or that of the desktop's dialog, which asks itself.
    agreed: Option<PathBuf>,
    /// The file that was decided on and cannot be had, and why, in words.
    refused: Option<(PathBuf, String)>,
    /// The file that would be replaced, while that is being asked.
    replaces: Option<PathBuf>,
    /// The file that was looked for last, for the hint, and whether it was there.
    looked_for: Option<(PathBuf, bool)>,
}

struct Repaint(Context);

impl Wake for Repaint {
    fn wake(self: Arc<Self>) {
        self.0.request_repaint();
    }
}

impl FileQuestion {
    /// Asks for a file in `folder`, or elsewhere. The desktop's dialog is opened as well unless only the field is wanted. A file that
    /// is there is not replaced without a further question, unless it is the `own` one.
    pub fn new(
        task: FileTask,
        suggestion: &str,
        folder: PathBuf,
        own: Option<PathBuf>,
        dialogs: FileDialogs,
    ) -> FileQuestion {
        let (path, suggestion) = (suggestion.to_owned(), suggestion.to_owned());
        let (agreed, native, is_fresh) = (own, None, true);
        let (refused, replaces, looked_for) = (None, None, None);
        let mut question = FileQuestion {
            task,
            path,
            suggestion,
            folder,
            native,
            dialogs,
            is_fresh,
            agreed,
            refused,
            replaces,
            looked_for,
        };
        if dialogs == FileDialogs::Desktop && !task.asks_more() {
            question.browse();
        }
        question
    }

    fn browse(&mut self) {
        let (what, extensions) = self.task.extensions();
        let place = self.place();
        let folder = place.parent().unwrap_or(&self.folder);
        let dialog = rfd::AsyncFileDialog::new().set_title(self.task.title()).set_directory(folder);
        let dialog = if extensions.is_empty() { dialog } else { dialog.add_filter(what, extensions) };
        let path_of = |file: Option<rfd::FileHandle>| file.map(|file| file.path().to_path_buf());
        let answer: Answer = if self.task.writes() {
            let name = place.file_name().map_or_else(String::new, |name| name.to_string_lossy().into_owned());
            let dialog = dialog.set_file_name(name);
            Box::pin(async move { path_of(dialog.save_file().await) })
        } else if extensions.is_empty() {
            Box::pin(async move { path_of(dialog.pick_folder().await) })
        } else {
            Box::pin(async move { path_of(dialog.pick_file().await) })
        };
        self.native = Some(NativeDialog { answer, took_focus: false });
    }

    /// Looks whether the desktop's dialog has answered. `Some(None)` closes the question without an answer.
    pub fn poll(&mut self, ctx: &Context) -> Option<Option<PathBuf>> {
        let waker = Waker::from(Arc::new(Repaint(ctx.clone())));
        let ended = self.native.as_mut()?.poll(ctx.input(|input| input.focused), &waker)?;
        self.native = None;
        match ended {
            Ended::Chosen(path) if self.task.asks_more() => {
                self.path = path.display().to_string();
                // It knows nothing of the files that a name with # stands for.
                self.agreed = Some(path).filter(|_| self.task != FileTask::ExportFrames);
                None
            }
            Ended::Closed if self.task.asks_more() => None,
            Ended::Chosen(path) => {
                self.path = path.display().to_string();
                self.agreed = Some(path.clone());
                self.chosen(path).map(Some)
            }
            Ended::Closed => Some(None),
            Ended::Unseen => None,
        }
    }

    /// The file that somebody decided on, unless it cannot be had, or is to be asked about first.
    fn chosen(&mut self, path: PathBuf) -> Option<PathBuf> {
        let path = self.task.whole(path);
        self.refused = self.task.refusal(&path).map(|words| (path.clone(), words));
        if self.refused.is_some() {
            self.is_fresh = true;
            return None;
        }
        if self.agreed.as_ref() != Some(&path) && self.task.replaces(&path) {
            self.replaces = Some(path);
            return None;
        }
        Some(path)
    }

    /// The path that was typed, as a whole.
    fn place(&self) -> PathBuf {
        self.folder.join(self.typed())
    }

    /// The path that was typed, from the home folder where it begins with that.
    fn typed(&self) -> PathBuf {
        from_home(self.path.trim(), dirs::home_dir())
    }

    /// The folder in which that lies.
    fn folder_meant(&self) -> PathBuf {
        let typed = self.typed();
        let within = typed.parent().filter(|within| !within.as_os_str().is_empty());
        within.map_or_else(|| self.folder.clone(), |within| self.folder.join(within))
    }

    /// Takes the path of a file that was dropped on the window.
    pub fn fill_in(&mut self, path: &Path) {
        self.path = path.display().to_string();
    }

    /// The path that was suggested.
    pub fn suggestion(&self) -> &str {
        &self.suggestion
    }

    /// What the file is wanted for.
    pub fn task(&self) -> FileTask {
        self.task
    }

    /// Draws the field; answers with `Some(None)` when it was closed. What else is asked, `above` the field, it draws itself; it
    /// may change the path, and says in words why there can be no file as things are.
    pub fn ui(
        &mut self,
        ctx: &Context,
        above: impl FnOnce(&mut Ui, &mut String) -> Option<String>,
    ) -> Option<Option<PathBuf>> {
        if let Some(path) = &self.replaces {
            return match replace_file_ui(ctx, self.task, path)? {
                ReplaceAnswer::Replace => Some(self.replaces.take()),
                ReplaceAnswer::Elsewhere | ReplaceAnswer::Stay => {
                    (self.replaces, self.is_fresh) = (None, true);
                    None
                }
            };
        }
        let room = ctx.content_rect().size();
        let modal = Modal::new(egui::Id::unique("file question")).show(ctx, |ui| {
            ui.set_width(WIDTH.min(room.x - BESIDE));
            ui.label(RichText::new(self.task.title()).heading().strong());
            ui.add_space(6.0);
            let problem = if self.task.asks_more() {
                // In a small window, or with large letters, the field and its buttons stay in sight.
                let area = ScrollArea::vertical().id_salt("asked").auto_shrink([false, true]);
                let asked = area.max_height((room.y - BELOW).max(LEAST)).show(ui, |ui| {
                    let problem = above(ui, &mut self.path);
                    keep_in_sight(ui, "file question");
                    problem
                });
                asked.inner
            } else {
                above(ui, &mut self.path)
            };
            self.field_ui(ui, problem)
        });
        if modal.inner.is_none() && modal.should_close() { Some(None) } else { modal.inner }
    }

    /// Whether a file is there that would be replaced; looked for once for each path.
    fn is_there(&mut self) -> bool {
        let path = self.task.whole(self.place());
        if self.looked_for.as_ref().is_none_or(|(known, _)| *known != path) {
            self.looked_for = Some((path.clone(), self.task.replaces(&path)));
        }
        self.looked_for.as_ref().is_some_and(|(_, is_there)| *is_there)
    }

    fn field_ui(&mut self, ui: &mut Ui, problem: Option<String>) -> Option<Option<PathBuf>> {
        let is_folder = matches!(self.task, FileTask::OpenPictures);
        let hint = if is_folder { "Path of the folder" } else { "Path of the file" };
        let edit = TextEdit::singleline(&mut self.path).hint_text(hint).desired_width(f32::INFINITY);
        let field = ui.add(edit).accessible_name("Path");
        if std::mem::take(&mut self.is_fresh) {
            field.request_focus();
        }
        let entered = field.lost_focus() && ui.input(|input| input.key_pressed(Key::Enter));
        let (_, extensions) = self.task.extensions();
        let hint = match extensions {
            _ if self.is_there() => match self.task {
                FileTask::ExportFrames => "Files of these names are there; saving asks whether to replace them".into(),
                _ => "A file of this name is there; saving asks whether to replace it".into(),
            },
            [] => "A folder with one EXR, HDR, PNG or JPEG of the same view for each light".into(),
            endings => format!("Ends in .{}", endings.join(", .")),
        };
        let meant = self.task.whole(self.place());
        let refused = self.refused.as_ref().filter(|(path, _)| *path == meant).map(|(_, words)| words);
        match problem.as_ref().or(refused) {
            Some(words) => ui.colored_label(ui.visuals().error_fg_color, words),
            None => ui.label(RichText::new(hint).weak().small()),
        };
        if self.typed().is_relative() {
            ui.label(RichText::new(format!("In {}", self.folder_meant().display())).weak().small());
        }
        ui.add_space(8.0);
        let mut answer = None;
        ui.horizontal(|ui| {
            let why_not = match (&self.native, self.dialogs) {
                (Some(_), _) => Some("The dialog of the desktop is open; answer it, or type the path in the field"),
                (None, FileDialogs::FieldOnly) => Some("The desktop has no dialog here; type the path in the field"),
                (None, FileDialogs::Desktop) => None,
            };
            let browse = ui.add_enabled(why_not.is_none(), Button::new("Browse…"));
            if browse.on_disabled_hover_text(why_not.unwrap_or_default()).clicked() {
                self.browse();
            }
            ui.with_layout(egui::Layout::right_to_left(egui::Align::Center), |ui| {
                let verb = if self.task.writes() { "Save" } else { "Open" };
                let ok = Button::new(RichText::new(verb).color(theme::ON_ACCENT)).fill(theme::ACCENT);
                let has_path = !self.path.trim().is_empty() && problem.is_none();
                if (ui.add_enabled(has_path, ok).clicked() || entered) && has_path {
                    answer = self.chosen(self.place()).map(Some);
                }
                if ui.button("Cancel").clicked() {
                    answer = Some(None);
                }
            });
        });
        answer
    }

    /// What is done with the answer.
    pub fn action(&self, path: PathBuf) -> Action {
        self.task.action(path)
    }
}

/// The path that is meant: `~` at its beginning stands for the home folder, as in a shell.
fn from_home(path: &str, home: Option<PathBuf>) -> PathBuf {
    let within = path.strip_prefix('~').filter(|rest| rest.is_empty() || rest.starts_with(is_separator));
    match (within, home) {
        (Some(within), Some(home)) => home.join(within.trim_start_matches(is_separator)),
        _ => path.into(),
    }
}

/// What a person wants done with work that would be lost.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum UnsavedAnswer {
    /// Save it first.
    Save,
    /// Lose it.
    Discard,
    /// Go back.
    Stay,
}

/// Asks before a look is lost.
pub fn unsaved_ui(ctx: &Context) -> Option<UnsavedAnswer> {
    let words = "It was changed since it was last saved";
    let answers = Answers {
        best: ("Save look…", UnsavedAnswer::Save),
        back: Some(("Cancel", UnsavedAnswer::Stay)),
        lose: ("Discard", UnsavedAnswer::Discard),
    };
    answers.ui(ctx, "Save the look?", words)
}

/// Asks before frames of a timeline are given up that are still to be written.
pub fn frames_ui(ctx: &Context, n_written: u32, n_frames: u32) -> Option<UnsavedAnswer> {
    let words = format!("{n_written} of {n_frames} frames are written; those stay, the rest does not come");
    let answers = Answers {
        best: ("Go on writing", UnsavedAnswer::Stay),
        back: None,
        lose: ("Stop and close", UnsavedAnswer::Discard),
    };
    answers.ui(ctx, "Stop writing frames?", &words)
}

/// Asks before the bake of pictures is lost.
pub fn stack_ui(ctx: &Context) -> Option<UnsavedAnswer> {
    let words = "It is made of pictures, and in no file yet; it would have to be made again";
    let answers = Answers {
        best: ("Save bake…", UnsavedAnswer::Save),
        back: Some(("Cancel", UnsavedAnswer::Stay)),
        lose: ("Discard", UnsavedAnswer::Discard),
    };
    answers.ui(ctx, "Save the bake?", words)
}

/// Asks before a bake of pictures is given up that runs.
pub fn stack_under_way_ui(ctx: &Context) -> Option<UnsavedAnswer> {
    let words = "It is made of pictures, and nothing of it is in a file; it would have to be made again";
    let answers =
        Answers { best: ("Go on baking", UnsavedAnswer::Stay), back: None, lose: ("Discard", UnsavedAnswer::Discard) };
    answers.ui(ctx, "Give up the bake?", words)
}

/// What a person wants done where another program changed the file of the look.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ReplaceAnswer {
    /// Save under another name.
    Elsewhere,
    /// Lose what the other program wrote.
    Replace,
    /// Go back.
    Stay,
}

/// Asks before a look that another program wrote to the file of that name is lost.
pub fn replace_ui(ctx: &Context, name: &str) -> Option<ReplaceAnswer> {
    let words = format!(
        "Another program changed {name} since it was last opened or saved here. Replacing it loses what stands there now"
    );
    let answers = Answers {
        best: ("Save as…", ReplaceAnswer::Elsewhere),
        back: Some(("Cancel", ReplaceAnswer::Stay)),
        lose: ("Replace", ReplaceAnswer::Replace),
    };
    answers.ui(ctx, "Replace the look?", &words)
}

/// Asks before a file that is there, or the frames that a path names, are replaced.
fn replace_file_ui(ctx: &Context, task: FileTask, path: &Path) -> Option<ReplaceAnswer> {
    let name = path.file_name().map_or_else(|| path.display().to_string(), |name| name.display().to_string());
    let words = if task == FileTask::ExportFrames {
        format!("Files named {name} are there. Saving replaces those that have the number of a frame")
    } else {
        format!("{name} is there. Saving replaces what it holds")
    };
    let answers = Answers {
        best: ("Choose another name", ReplaceAnswer::Elsewhere),
        back: None,
        lose: ("Replace", ReplaceAnswer::Replace),
    };
    answers.ui(ctx, "Replace the file?", &words)
}

/// What a person wants done with a look that an editor left behind.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RecoveryAnswer {
    /// Go on with it.
    Recover,
    /// Lose it.
    Discard,
    /// Ask again at the next start.
    Later,
}

/// Offers a look that an editor left behind when it ended without asking, `age` ago.
pub fn recovery_ui(ctx: &Context, scene: &str, age: Option<Duration>) -> Option<RecoveryAnswer> {
    let when = age.map_or(String::new(), |age| format!(", last changed {}", ago(age)));
    let answers = Answers {
        best: ("Recover", RecoveryAnswer::Recover),
        back: Some(("Ask again later", RecoveryAnswer::Later)),
        lose: ("Discard", RecoveryAnswer::Discard),
    };
    let words = format!("Clerestory ended before the look of {scene} was saved{when}");
    answers.ui(ctx, "Recover unsaved lights?", &words)
}

/// Labels of the buttons of a question about work, and what each answers.
struct Answers<A> {
    /// Keeps the work.
    best: (&'static str, A),
    /// Leaves everything as it is, as closing the question does; none where that is what keeps the work.
    back: Option<(&'static str, A)>,
    /// Loses the work.
    lose: (&'static str, A),
}

impl<A: Copy> Answers<A> {
    /// Asks; none while there is no answer.
    fn ui(self, ctx: &Context, title: &str, words: &str) -> Option<A> {
        let Answers { best: (best_label, best), back, lose: (lose_label, lose) } = self;
        let mut chosen = None;
        let modal = Modal::new(egui::Id::unique(title)).show(ctx, |ui| {
            ui.set_width(ANSWERS_WIDTH.min(ctx.content_rect().width() - BESIDE));
            ui.label(RichText::new(title).heading().strong());
            ui.add_space(4.0);
            ui.label(words);
            ui.add_space(10.0);
            ui.horizontal(|ui| {
                if ui.button(lose_label).clicked() {
                    chosen = Some(lose);
                }
                ui.with_layout(egui::Layout::right_to_left(egui::Align::Center), |ui| {
                    let button = Button::new(RichText::new(best_label).color(theme::ON_ACCENT)).fill(theme::ACCENT);
                    let button = ui.add(button);
                    if button.clicked() {
                        chosen = Some(best);
                    }
                    // Enter keeps the work, and does nothing behind the list of keys.
                    if !are_keys_listed(ctx) && ui.memory(|memory| memory.focused().is_none()) {
                        button.request_focus();
                    }
                    if let Some((back_label, back)) = back
                        && ui.button(back_label).clicked()
                    {
                        chosen = Some(back);
                    }
                });
            });
        });
        let closed = || modal.should_close().then(|| back.map_or(best, |(_, back)| back));
        chosen.or_else(closed)
    }
}

/// A time ago, roughly, for people.
pub(super) fn ago(age: Duration) -> String {
    let counted = |n: u64, unit: &str| format!("{n} {unit}{} ago", if n == 1 { "" } else { "s" });
    match age.as_secs() {
        secs if secs < 60 => "less than a minute ago".into(),
        secs if secs < 3600 => counted(secs / 60, "minute"),
        secs if secs < 86_400 => counted(secs / 3600, "hour"),
        secs => counted(secs / 86_400, "day"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn answering(path: Option<&str>) -> NativeDialog {
        NativeDialog { answer: Box::pin(std::future::ready(path.map(PathBuf::from))), took_focus: false }
    }

    #[test]
    fn times_are_told_in_the_largest_unit_that_fits() {
        let told = [0, 59, 60, 150, 3600, 7300, 86_400, 300_000].map(|secs| ago(Duration::from_secs(secs)));
        let wanted = ["less than a minute ago", "less than a minute ago", "1 minute ago", "2 minutes ago"];
        assert_eq!(told[..4], wanted);
        assert_eq!(told[4..], ["1 hour ago", "2 hours ago", "1 day ago", "3 days ago"]);
    }

    #[test]
    fn a_tilde_stands_for_the_home_folder() {
        let meant = |path: &str| from_home(path, Some("/home/ada".into()));
        assert_eq!(meant("~/a b.look"), Path::new("/home/ada/a b.look"));
        assert_eq!(meant("~"), Path::new("/home/ada"));
        assert_eq!(meant("~/out/").to_string_lossy(), "/home/ada/out/", "it names a folder, as it was typed");
        for literal in ["~ada/a.look", "a/~/b.look", "./~", "~.look", "/tmp/a.look", ""] {
            assert_eq!(meant(literal), Path::new(literal));
        }
        assert_eq!(from_home("~/a.look", None), Path::new("~/a.look"));

        let home = dirs::home_dir().unwrap();
        for task in [FileTask::OpenScene, FileTask::SaveLook, FileTask::Export] {
            let mut question = FileQuestion::new(task, "", "/elsewhere".into(), None, FileDialogs::FieldOnly);
            question.path = " ~/a.glb ".into();
            assert_eq!(question.place(), home.join("a.glb"));
        }
    }

    #[test]
    fn frames_that_are_there_are_asked_about_although_the_desktop_did_not_see_them() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("f_03.png"), b"precious").unwrap();
        let chosen = |task: FileTask, name: &str| {
            let place = folder.path().join(name);
            let mut question = FileQuestion::new(task, "", folder.path().into(), None, FileDialogs::FieldOnly);
            question.native = Some(answering(place.to_str()));
            assert_eq!(question.poll(&Context::default()), None, "more is asked");
            question.chosen(question.place())
        };
        assert_eq!(chosen(FileTask::ExportFrames, "f_##.png"), None);
        let free = folder.path().join("g_##.png");
        assert_eq!(chosen(FileTask::ExportFrames, "g_##.png"), Some(free));
        let agreed = folder.path().join("f_03.png");
        assert_eq!(chosen(FileTask::Export, "f_03.png"), Some(agreed), "the desktop asked itself");
    }

    #[test]
    fn a_dialog_that_never_had_the_focus_was_never_shown() {
        let waker = Waker::noop();
        assert_eq!(answering(None).poll(true, waker), Some(Ended::Unseen));
        let mut shown = NativeDialog { answer: Box::pin(std::future::pending()), took_focus: false };
        assert_eq!(shown.poll(true, waker), None);
        assert_eq!(shown.poll(false, waker), None);
        shown.answer = answering(None).answer;
        assert_eq!(shown.poll(true, waker), Some(Ended::Closed), "it had the focus before");
        assert_eq!(answering(Some("a.png")).poll(true, waker), Some(Ended::Chosen("a.png".into())));
    }
}
