//! What was chosen in the window about a scene, and makes another scene of it.

use std::path::Path;

use clerestory_transport::emitters::{PanelRequest, SkyRequest};
use clerestory_transport::lamp_units::LampUnits;
use clerestory_transport::sky::{SkyForm, SkyLight, SkySetting};

use crate::look::sky;
use crate::words::in_words;

/// What was chosen in the window about a scene, and makes another scene of it.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Chosen {
    /// Lights that became panels.
    pub panels: Vec<PanelRequest>,
    /// How its lamps are counted.
    pub units: LampUnits,
    /// The sky that lights it.
    pub sky: Option<ChosenSky>,
}

/// A sky that lights a scene by patches, each in a column of its own.
#[derive(Clone, Debug, PartialEq)]
pub struct ChosenSky {
    /// What it is made of; names no sky where that is not known, as of a bake that was opened.
    pub setting: SkySetting,
    /// The sky itself, once it was read.
    pub light: Option<SkyLight>,
    /// Divisions of its patches.
    pub divisions: u32,
}

impl ChosenSky {
    /// As a scene is prepared with it.
    pub(super) fn request(&self) -> Option<SkyRequest> {
        let form = SkyForm::Patches(self.divisions);
        self.light.clone().map(|light| SkyRequest { light, form })
    }
}

impl Chosen {
    /// Reads the sky, unless that was done. Answers what is odd about it; one that cannot be had is left out.
    pub(super) fn read_sky(&mut self) -> Vec<String> {
        let Some(chosen) = self.sky.as_mut().filter(|sky| sky.light.is_none()) else { return Vec::new() };
        match sky::load(&mut chosen.setting, Path::new("")) {
            Ok(odd) => {
                chosen.light = chosen.setting.light(None);
                odd
            }
            Err(error) => {
                self.sky = None;
                vec![format!("The sky that was chosen for it is left out: {}", in_words(&error))]
            }
        }
    }
}
