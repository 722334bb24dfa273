//! What outlasts the program. eframe keeps it in one file, which all windows of a user share: a window writes what was changed in it, and
//! leaves the rest as another one left it meanwhile. Only what the toolkit keeps of itself, such as widths of panels, is that of the
//! window that was written last.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::Duration;

use eframe::egui::{Context, ThemePreference};
use eframe::{CreationContext, Storage};

use super::choices::KeptChoices;
use super::files::merged_recent;
use super::start::decoded;
use super::{
    App, BAKE_KEY, CHOICES_KEY, DEVICE_KEY, EXPORT_KEY, LIGHTS_KEY, MEMORY_KEY, PANELS_KEY, RECENT_KEY, SCHEDULE_KEY,
    WELCOMED_KEY,
};

const THEME_KEY: &str = "theme";
const TEXT_SIZE_KEY: &str = "text_size";
/// What eframe keeps by itself.
const TOOLKIT_KEYS: [&str; 2] = ["egui", "window"];
/// How often a file that another window may be writing is read, and the time in between.
const READS: usize = 5;
const PAUSE: Duration = Duration::from_millis(10);
/// Text sizes that the toolkit can be set to.
const TEXT_SIZES: std::ops::RangeInclusive<f32> = 0.2..=5.0;

/// Values by their keys, as eframe writes them.
#[derive(Default)]
pub(super) struct Told(BTreeMap<String, String>);

impl Storage for Told {
    fn get_string(&self, key: &str) -> Option<String> {
        self.0.get(key).cloned()
    }

    fn set_string(&mut self, key: &str, value: String) {
        self.0.insert(key.into(), value);
    }

    fn remove_string(&mut self, key: &str) {
        self.0.remove(key);
    }

    fn flush(&mut self) {}
}

/// Theme and text size. The toolkit keeps them, too, but among much that every window has of its own.
#[derive(Clone, Copy)]
pub(super) struct Appearance {
    theme: ThemePreference,
    text_size: f32,
}

impl Appearance {
    pub fn of(ctx: &Context) -> Appearance {
        Appearance { theme: ctx.options(|options| options.theme_preference), text_size: ctx.zoom_factor() }
    }

    /// Gives a new window the ones that were chosen; who was never here before gets a dark one.
    pub fn restored(cc: &CreationContext<'_>) -> Appearance {
        let now = Appearance::of(&cc.egui_ctx);
        let left = |key| cc.storage.and_then(|storage| storage.get_string(key));
        let is_first = left(RECENT_KEY).is_none();
        let theme = left(THEME_KEY).and_then(decoded::<ThemePreference>);
        let theme = theme.unwrap_or(if is_first { ThemePreference::Dark } else { now.theme });
        let text_size = left(TEXT_SIZE_KEY).and_then(decoded::<f32>).filter(|size| TEXT_SIZES.contains(size));
        let text_size = text_size.unwrap_or(now.text_size);
        cc.egui_ctx.set_theme(theme);
        cc.egui_ctx.set_zoom_factor(text_size);
        Appearance { theme, text_size }
    }
}

/// What lies in the file now. One that cannot be read as a whole is being written by another window, which is soon done.
fn state_in(file: &Path) -> Option<BTreeMap<String, String>> {
    if !file.exists() {
        return None;
    }
    first_whole(|| decoded(std::fs::read_to_string(file).ok()?))
}

/// What is read first as a whole, after a pause where it was not.
fn first_whole<T>(mut read: impl FnMut() -> Option<T>) -> Option<T> {
    (0..READS).find_map(|nth| {
        if nth > 0 {
            std::thread::sleep(PAUSE);
        }
        read()
    })
}

impl App {
    /// What is to outlast the window, as it is now.
    pub(super) fn told(&self) -> Told {
        let mut told = Told::default();
        eframe::set_value(&mut told, RECENT_KEY, &self.recent);
        eframe::set_value(&mut told, LIGHTS_KEY, &self.lights.layout);
        eframe::set_value(&mut told, EXPORT_KEY, &self.export);
        eframe::set_value(&mut told, PANELS_KEY, &self.sides);
        eframe::set_value(&mut told, DEVICE_KEY, &self.follower.wish());
        eframe::set_value(&mut told, MEMORY_KEY, &self.session.memory_limit);
        eframe::set_value(&mut told, BAKE_KEY, &self.habits);
        eframe::set_value(&mut told, CHOICES_KEY, &self.choices.kept);
        eframe::set_value(&mut told, SCHEDULE_KEY, self.solving.schedule());
        eframe::set_value(&mut told, THEME_KEY, &self.appearance.theme);
        eframe::set_value(&mut told, TEXT_SIZE_KEY, &self.appearance.text_size);
        if !self.is_new_here {
            eframe::set_value(&mut told, WELCOMED_KEY, &true);
        }
        self.camera.save(&mut told);
        told
    }

    /// Leaves it to the next window, with what other windows have left since.
    pub(super) fn leave(&mut self, storage: &mut dyn Storage) {
        for (key, value) in self.state_file.as_deref().and_then(state_in).unwrap_or_default() {
            if !TOOLKIT_KEYS.contains(&key.as_str()) {
                storage.set_string(&key, value);
            }
        }
        self.take_in_lists(storage);
        let told = self.told();
        for (key, value) in &told.0 {
            let is_changed = self.told_before.0.get(key) != Some(value);
            if is_changed || storage.get_string(key).is_none() {
                storage.set_string(key, value.clone());
            }
        }
        self.told_before = told;
    }

    /// Of lists, what is new in either of two windows is kept.
    fn take_in_lists(&mut self, there: &dyn Storage) {
        let before = eframe::get_value::<Vec<PathBuf>>(&self.told_before, RECENT_KEY);
        if let Some((before, there)) = before.zip(eframe::get_value(there, RECENT_KEY)) {
            self.recent = merged_recent(&self.recent, &before, there);
        }
        let before = eframe::get_value::<KeptChoices>(&self.told_before, CHOICES_KEY);
        if let Some((before, there)) = before.zip(eframe::get_value(there, CHOICES_KEY)) {
            self.choices.kept = self.choices.kept.merged(&before, &there);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_another_window_is_writing_is_read_again() {
        let whole_after = |n: usize| {
            let mut n_reads = 0;
            let read = first_whole(|| {
                n_reads += 1;
                (n_reads > n).then_some("whole")
            });
            (read, n_reads)
        };
        assert_eq!(whole_after(0), (Some("whole"), 1));
        assert_eq!(whole_after(3), (Some("whole"), 4));
        assert_eq!(whole_after(9), (None, READS), "it is no state");
    }

    #[test]
    fn a_state_that_is_half_written_is_none() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("app.ron");
        assert_eq!(state_in(&file), None, "it is not there");
        std::fs::write(&file, r#"{"recent": "[]", "#).unwrap();
        assert_eq!(state_in(&file), None);
        std::fs::write(&file, r#"{"recent": "[]"}"#).unwrap();
        assert_eq!(state_in(&file), Some(BTreeMap::from([("recent".into(), "[]".into())])));
    }
}
