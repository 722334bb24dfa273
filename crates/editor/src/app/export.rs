//! Pictures out of the window: into files and onto the clipboard.

use std::path::PathBuf;

use clerestory_transport::light::LightRig;
use eframe::egui::{ColorImage, Context};

use super::App;
use crate::action::FileTask;
use crate::export::ImageFormat;
use crate::export::layers::LayerSet;
use crate::look::Look;
use crate::panels::export::{ExportView, export_ui, frames_ui};
use crate::panels::lights::heard;
use crate::sequence::last_frame;

impl App {
    /// How pictures are written.
    pub fn export_options(&self) -> &crate::export::ExportOptions {
        &self.export
    }

    /// What is seen is what is written, a solo included.
    pub(super) fn seen_look(&self) -> Look {
        let mut seen = self.seen();
        self.hear([&mut seen.lights].into_iter());
        seen
    }

    /// The look and its snapshots with a solo, as the timeline shows them.
    pub(super) fn heard_look(&self) -> Look {
        let mut look = self.look.clone();
        let rigs = look.snapshots.iter_mut().map(|snapshot| &mut snapshot.lights);
        self.hear(rigs.chain([&mut look.lights]));
        look
    }

    /// Mutes what a solo leaves out.
    fn hear<'a>(&self, rigs: impl Iterator<Item = &'a mut LightRig>) {
        if let Some(basis) = self.session.basis() {
            rigs.for_each(|rig| *rig = heard(basis, rig, &self.lights.solo));
        }
    }

    /// Whether there is no more to be seen than a first look, and says so: nobody wants that as a file.
    fn is_too_coarse(&mut self) -> bool {
        let is_glimpse = self.session.is_glimpse();
        if is_glimpse {
            self.complain("This is a first look, traced at few pixels; wait until the bake has a whole picture");
        }
        is_glimpse
    }

    /// Whether there is nothing that could be written yet, and says so.
    fn lacks_picture(&mut self) -> bool {
        let is_lacking = self.session.shown.is_none();
        if is_lacking {
            self.complain("There is no picture to write yet; start the bake, or wait for it");
        }
        is_lacking
    }

    /// Whether nothing is there of which a file is made, and says so.
    pub(super) fn lacks_whole_picture(&mut self) -> bool {
        self.lacks_picture() || self.is_too_coarse()
    }

    pub(super) fn export(&mut self, path: PathBuf) {
        // It may have gone since its file was asked for.
        if self.lacks_whole_picture() {
            return;
        }
        self.say_begun(format!("Writing {}", path.display()));
        self.export.format = ImageFormat::of(&path).unwrap_or_default();
        let (mut look, light) = (self.seen_look(), self.follower.final_lamp_light().cloned());
        if let Some(basis) = self.session.basis().filter(|_| self.export.layers == LayerSet::Groups) {
            look = crate::panels::lights::with_groups(basis, look, self.lights.layout.group_by);
        }
        self.session.export(look, light, path, self.export);
    }

    pub(super) fn copy_image(&mut self) {
        if self.session.shown.is_none() {
            self.complain("There is no picture to copy yet; start the bake");
            return;
        }
        if self.is_too_coarse() {
            return;
        }
        let (look, light) = (self.seen_look(), self.follower.final_lamp_light().cloned());
        self.session.copy(look, light);
    }

    pub(super) fn copied(&mut self, ctx: &Context, picture: ColorImage) {
        let [width, height] = picture.size;
        ctx.copy_image(picture);
        self.say(format!("Copied the picture, {width} × {height} pixels"));
    }

    /// Asks for a file where one is wanted.
    pub(super) fn question_ui(&mut self, ctx: &Context) {
        let units = self.units();
        let Some(question) = &mut self.question else { return };
        let suggested = question.suggestion().to_owned();
        let exports = matches!(question.task(), FileTask::Export | FileTask::ExportFrames);
        let view = self.session.shown.as_ref().filter(|_| exports).map(|shown| ExportView {
            suggested: &suggested,
            baked: [shown.header.width, shown.header.height],
            units,
            has_illuminance: shown.pixel_irradiance().is_some(),
            is_under_way: self.session.is_refining(),
            marked: self.view.marking.marks().and_then(|marks| marks.corners()),
            seen: self.view.seen,
        });
        let answer = match (question.task(), view) {
            (FileTask::Export, Some(view)) => {
                let (options, actions) = (&mut self.export, &mut self.actions);
                options.irradiance &= view.has_illuminance;
                question.ui(ctx, |ui, path| export_ui(ui, path, options, &view, actions))
            }
            (FileTask::ExportFrames, Some(view)) => {
                let timeline = &self.look.timeline;
                let (last, fps) = (last_frame(&self.look, timeline.fps), timeline.fps);
                let (options, asked) = (&mut self.export, &mut self.asked_frames);
                question.ui(ctx, |ui, path| frames_ui(ui, path, options, &view, (asked, last, fps)))
            }
            _ => question.ui(ctx, |_, _| None),
        };
        self.answered(answer);
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use clerestory_transport::bake::BakeConfig;
    use clerestory_transport::camera::Film;
    use egui_kittest::Harness;
    use egui_kittest::kittest::Queryable;

    use super::*;
    use crate::action::Action;
    use crate::session::BakeSettings;
    use crate::support::room_window;

    #[test]
    fn a_picture_that_went_while_its_file_was_asked_for_is_not_said_to_be_written() {
        let folder = tempfile::tempdir().unwrap();
        let film = Film { width: 480, height: 360 };
        let config = BakeConfig { spp: 4, tolerance_db: 20.0, ..BakeConfig::default() };
        let settings = BakeSettings { camera_idx: 0, film, config, illuminance: false, work_plane: None };
        let mut window = room_window(Some(settings));
        let ctx = window.ctx.clone();
        // A scene that was prepared again has a first look at first, and before that nothing.
        for _ in 0..40_000 {
            window.step();
            if window.state().session.is_glimpse() {
                break;
            }
            std::thread::sleep(Duration::from_millis(1));
        }
        let is_said = |window: &Harness<App>, words: &str| window.query_all_by_label_contains(words).next().is_some();
        let app = window.state_mut();
        assert!(app.session.is_glimpse());
        app.session.cancel_bake();
        app.apply(&ctx, Action::ExportImage(folder.path().join("a.png")));
        window.run_steps(2);
        assert!(is_said(&window, "wait until the bake has a whole picture") && !is_said(&window, "Writing"));
        let app = window.state_mut();
        app.session.shown = None;
        app.apply(&ctx, Action::SaveSheet(folder.path().join("looks.png")));
        window.run_steps(2);
        assert!(is_said(&window, "There is no picture to write yet") && !is_said(&window, "Writing"));
    }
}
