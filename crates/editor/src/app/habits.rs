//! How scenes are baked unless somebody says otherwise: the size and the quality that were chosen last. They outlast the program.

use clerestory_transport::bake::{BakeConfig, Indirect};
use clerestory_transport::camera::{Camera, Film};
use clerestory_transport::patches::MOST_PATCHES;
use serde::{Deserialize, Serialize};

use crate::panels::bake::{FEWEST_PATCHES, MOST_SPP, QUALITIES, SIDES_PX};
use crate::session::BakeSettings;

/// Width of a picture that is baked without being asked for.
const DEFAULT_WIDTH_PX: u32 = 640;
/// Cores from which the standard quality is what a bake starts with.
const MANY_CORES: usize = 8;

/// What was chosen in the bake panel.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub(super) struct BakeHabits {
    width_px: u32,
    /// None as long as the camera says it.
    height_px: Option<u32>,
    spp: u32,
    tolerance_db: f32,
    indirect: Indirect,
    patches: u32,
    denoise: bool,
    illuminance: bool,
}

impl Default for BakeHabits {
    /// A quality that suits the machine.
    fn default() -> BakeHabits {
        let n_cores = std::thread::available_parallelism().map_or(1, usize::from);
        let quality = QUALITIES[if n_cores >= MANY_CORES { 2 } else { 1 }];
        let BakeConfig { indirect, patches, denoise, .. } = BakeConfig::default();
        BakeHabits {
            width_px: DEFAULT_WIDTH_PX,
            height_px: None,
            spp: quality.spp,
            tolerance_db: quality.tolerance_db,
            indirect,
            patches,
            denoise,
            illuminance: false,
        }
    }
}

impl BakeHabits {
    /// Those of somebody who baked like this from a camera.
    pub fn of(settings: &BakeSettings, camera: Option<&Camera>) -> BakeHabits {
        let BakeConfig { spp, tolerance_db, indirect, patches, denoise, .. } = settings.config;
        let Film { width, height } = settings.film;
        // A height that follows a width by the pixel is still the camera's.
        let is_own = camera.is_none_or(|camera| Film::of_width(width, camera).height.abs_diff(height) > 1);
        BakeHabits {
            width_px: width,
            height_px: is_own.then_some(height),
            spp,
            tolerance_db,
            indirect,
            patches,
            denoise,
            illuminance: settings.illuminance,
        }
    }

    /// What of them can be set in the panel: they come from a file.
    pub fn within_reason(self) -> BakeHabits {
        let side = |px: u32| px.clamp(*SIDES_PX.start(), *SIDES_PX.end());
        let is_tolerance = (0.0..=100.0).contains(&self.tolerance_db);
        BakeHabits {
            width_px: side(self.width_px),
            height_px: self.height_px.map(side),
            spp: self.spp.clamp(2, MOST_SPP),
            tolerance_db: if is_tolerance { self.tolerance_db } else { BakeHabits::default().tolerance_db },
            patches: if self.patches == 0 { 0 } else { self.patches.clamp(FEWEST_PATCHES, MOST_PATCHES) },
            ..self
        }
    }

    /// The settings of a bake from the first camera of a scene.
    pub fn settings(self, camera: Option<&Camera>) -> BakeSettings {
        let BakeHabits { width_px: width, height_px, spp, tolerance_db, indirect, patches, denoise, illuminance } =
            self;
        let of_camera = camera.map_or(width * 9 / 16, |camera| Film::of_width(width, camera).height);
        let film = Film { width, height: height_px.unwrap_or(of_camera) };
        let config = BakeConfig { spp, tolerance_db, indirect, patches, denoise, ..BakeConfig::default() };
        BakeSettings { camera_idx: 0, film, config, illuminance, work_plane: None }
    }
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;

    #[test]
    fn a_height_is_the_cameras_until_somebody_wants_another() {
        let [flat, tall] = [2.0, 0.5].map(|aspect| Camera::look_at("a", Vec3::ZERO, Vec3::X, 1.0, aspect));
        let mut settings = BakeHabits::default().settings(Some(&flat));
        assert_eq!(settings.film, Film { width: 640, height: 320 });
        let habits = BakeHabits::of(&settings, Some(&flat));
        assert_eq!(habits, BakeHabits::default());
        assert_eq!(habits.settings(Some(&tall)).film, Film { width: 640, height: 1280 });
        settings.film.height = 400;
        let habits = BakeHabits::of(&settings, Some(&flat));
        assert_eq!(habits.settings(Some(&tall)).film, Film { width: 640, height: 400 });
    }

    #[test]
    fn what_comes_from_a_damaged_file_is_what_can_be_set() {
        let told = r#"{"width_px": 4000000000, "height_px": 0, "spp": 0, "tolerance_db": -3.0, "patches": 1}"#;
        let habits = serde_json::from_str::<BakeHabits>(told).unwrap().within_reason();
        let BakeSettings { film, config, .. } = habits.settings(None);
        assert_eq!(film, Film { width: *SIDES_PX.end(), height: *SIDES_PX.start() });
        assert_eq!((config.spp, config.patches), (2, FEWEST_PATCHES));
        assert_eq!(config.tolerance_db, BakeHabits::default().tolerance_db);
        let as_chosen = BakeHabits { width_px: 800, patches: 0, illuminance: true, ..BakeHabits::default() };
        assert_eq!(as_chosen.within_reason(), as_chosen);
    }
}
