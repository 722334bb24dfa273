//! How the window starts, and with which settings.

use std::collections::HashMap;
use std::path::PathBuf;
use std::sync::Arc;

use anyhow::Result;
use eframe::egui_wgpu::{WgpuSetup, WgpuSetupCreateNew};
use eframe::{Storage, egui, wgpu};
use serde::de::DeserializeOwned;

use super::RECENT_KEY;
use super::host::run_windows;
use super::icon::icon;
use super::recovery;
use crate::action::is_look;
use crate::bake_cache::BakeCache;
use crate::crash;
use crate::look::scene_of_file;
use crate::panels::dialogs::FileDialogs;
use crate::session::{BakeSettings, Source};

/// How the window starts.
#[derive(Clone, Debug, PartialEq)]
pub struct Start {
    /// What is opened.
    pub source: Source,
    /// How scenes are baked; by default one that suits the machine.
    pub settings: Option<BakeSettings>,
    /// Folder in which unsaved looks are kept for a crash; without one they are not.
    pub unsaved: Option<PathBuf>,
    /// Where finished bakes are found and kept; without it every bake is made anew.
    pub cache: Option<BakeCache>,
    /// The file in which windows leave what outlasts them, as the toolkit writes it: it is read again before it is written.
    pub state: Option<PathBuf>,
    /// Where files are asked for.
    pub dialogs: FileDialogs,
    /// Whether somebody who was never here before is welcomed.
    pub welcome: bool,
}

impl Start {
    /// With nothing of the user's: no folders and no dialogs of the desktop.
    pub fn alone(source: Source, settings: Option<BakeSettings>) -> Start {
        let dialogs = FileDialogs::FieldOnly;
        Start { source, settings, unsaved: None, cache: None, state: None, dialogs, welcome: false }
    }
}

/// What is opened first, and the look that it is lit by: one that is opened alone goes with the scene that it was saved for, else with the
/// one that was open last, where that is still there. Its path begins at the root, since other paths are relative to the folder of the
/// scene.
pub(super) fn with_its_scene(source: Source, recent: &[PathBuf]) -> (Source, Option<PathBuf>) {
    match source {
        Source::File(path) if is_look(&path) => {
            let last = || recent.iter().find(|scene| !is_look(scene) && scene.exists()).cloned();
            (
                scene_of_file(&path).or_else(last).map_or(Source::BuiltIn, Source::File),
                Some(std::path::absolute(&path).unwrap_or(path)),
            )
        }
        source => (source, None),
    }
}

/// The same of what somebody asks for who gets no window: what was open last stands where eframe keeps the window's state.
pub(crate) fn without_window(open: Option<PathBuf>) -> (Source, Option<PathBuf>) {
    let state = state_file().and_then(|file| std::fs::read_to_string(file).ok());
    let recent = state.and_then(recent_in).unwrap_or_default();
    with_its_scene(open.map_or(Source::BuiltIn, Source::File), &recent)
}

/// Where eframe keeps the state of the window.
fn state_file() -> Option<PathBuf> {
    eframe::storage_dir("clerestory").map(|folder| folder.join("app.ron"))
}

/// The recent files that a window left in the text of its state.
fn recent_in(state: String) -> Option<Vec<PathBuf>> {
    let state: HashMap<String, String> = decoded(state)?;
    decoded(state.get(RECENT_KEY)?.clone())
}

/// What eframe wrote, read by itself.
pub(super) fn decoded<T: DeserializeOwned>(text: String) -> Option<T> {
    eframe::get_value(&Text(text), RECENT_KEY)
}

/// One text, whatever it is asked by.
struct Text(String);

impl Storage for Text {
    fn get_string(&self, _key: &str) -> Option<String> {
        Some(self.0.clone())
    }

    fn set_string(&mut self, _key: &str, _value: String) {}

    fn remove_string(&mut self, _key: &str) {}

    fn flush(&mut self) {}
}

/// Opens the window and stays until it is closed.
///
/// # Errors
/// If there is no display or no graphics driver.
pub fn run(open: Option<PathBuf>) -> Result<()> {
    let source = open.map_or(Source::BuiltIn, Source::File);
    if let Some(folder) = eframe::storage_dir("clerestory") {
        crash::keep_reports(folder.join("crashes"));
    }
    let start = Start {
        source,
        settings: None,
        unsaved: recovery::folder(),
        cache: BakeCache::of_user()?,
        state: state_file(),
        dialogs: FileDialogs::Desktop,
        welcome: true,
    };
    run_windows(options, start)
}

fn options() -> eframe::NativeOptions {
    let mut options = eframe::NativeOptions {
        viewport: egui::ViewportBuilder::default()
            .with_title("Clerestory")
            .with_app_id("clerestory")
            .with_icon(icon())
            .with_inner_size([1440.0, 900.0])
            .with_min_inner_size([900.0, 600.0])
            .with_drag_and_drop(true),
        renderer: eframe::Renderer::Wgpu,
        ..Default::default()
    };
    options.wgpu_options.wgpu_setup = WgpuSetup::CreateNew(WgpuSetupCreateNew {
        device_descriptor: Arc::new(device_descriptor),
        ..WgpuSetupCreateNew::without_display_handle()
    });
    options
}

/// Everything that the adapter can do: factors of a large bake exceed the default limits.
fn device_descriptor(adapter: &wgpu::Adapter) -> wgpu::DeviceDescriptor<'static> {
    wgpu::DeviceDescriptor { label: Some("clerestory"), required_limits: adapter.limits(), ..Default::default() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::look::Look;

    #[test]
    fn recent_files_are_found_in_what_a_window_left() {
        let state = r#"{"lights": "(view:List)", "recent": "[\"/looks/dusk.look\",\"/rooms/hall.glb\"]"}"#;
        let recent = ["/looks/dusk.look", "/rooms/hall.glb"].map(PathBuf::from);
        assert_eq!(recent_in(state.into()), Some(recent.to_vec()));
        for other in ["", "{}", "nothing of ours", r#"{"recent": "7"}"#] {
            assert_eq!(recent_in(other.into()), None, "{other}");
        }
    }

    #[test]
    fn a_look_that_is_opened_first_comes_with_the_scene_that_it_was_saved_for() {
        let folder = tempfile::tempdir().unwrap();
        let [room, hall, look] = ["room.glb", "hall.glb", "evening.look"].map(|name| folder.path().join(name));
        for scene in [&room, &hall] {
            std::fs::write(scene, "").unwrap();
        }
        Look::default().save_for(&look, Some(&room)).unwrap();
        let opened = || with_its_scene(Source::File(look.clone()), std::slice::from_ref(&hall));
        assert_eq!(opened(), (Source::File(room.clone()), Some(look.clone())));
        std::fs::remove_file(&room).unwrap();
        assert_eq!(opened(), (Source::File(hall.clone()), Some(look.clone())));
    }

    #[test]
    fn a_look_that_is_opened_first_is_known_from_the_root() {
        let source = Source::File("evening.look".into());
        let recent = ["noon.look", "no such hall.glb"].map(PathBuf::from);
        let root = std::path::absolute("evening.look").unwrap();
        assert!(root.is_absolute());
        assert_eq!(with_its_scene(source, &recent), (Source::BuiltIn, Some(root)));
        let scene = Source::File("hall.glb".into());
        assert_eq!(with_its_scene(scene.clone(), &recent), (scene, None));
    }
}
