//! The matrix that is shown, and the light that it is multiplied with.

use std::sync::Arc;

use clerestory_nystrom::BlockLowRank;
use clerestory_relight::Frame;
use clerestory_transport::bake::{Bake, BakeHeader, PackedMatrices};
use clerestory_transport::camera::{Camera, Film};
use clerestory_transport::light::LightRig;
use clerestory_transport::patches::Patches;

use super::lamps::LampLight;

/// The matrix that is shown.
pub struct Shown {
    /// What it is of.
    pub header: Arc<BakeHeader>,
    /// The camera, where the scene is known.
    pub camera: Option<Camera>,
    /// Its blocks as far as they are there; whoever makes a picture shares them.
    pub frame: Arc<Frame>,
    /// Irradiance of an opened file, so that it is there when the bake is saved again.
    pub irradiance: Vec<Vec<BlockLowRank>>,
    /// The bytes of all that, once they are what is shown.
    pub packed: Option<Arc<PackedMatrices>>,
    /// Whether it is a first look, traced at few pixels, to be replaced once the preview of its bake is whole.
    pub is_glimpse: bool,
}

impl Shown {
    /// Size of the picture.
    pub fn film(&self) -> Film {
        Film { width: self.header.width, height: self.header.height }
    }

    /// Whether every block is there.
    pub fn is_whole(&self) -> bool {
        self.frame.groups.iter().all(|group| group.blocks.iter().all(Option::is_some))
    }

    /// A matrix of irradiance as a picture is made of it.
    pub fn irradiance_frame(&self, set: usize) -> Frame {
        Frame { width: self.frame.width, height: self.frame.height, groups: self.irradiance[set].clone() }
    }

    /// The surfaces on which free lamps bring indirect light, where the bake has them.
    pub fn patches(&self) -> Option<&Patches> {
        self.header.patches.as_ref()
    }

    /// One RGB coefficient per column and group under a rig and the light of its free lamps.
    pub fn coefficients(&self, rig: &LightRig, light: Option<&LampLight>) -> Vec<Vec<[f32; 3]>> {
        let mut coefficients = self.header.coefficients(rig);
        if let Some(light) = light {
            self.header.add_of_patches(&mut coefficients, &light.of_patches);
        }
        coefficients
    }

    /// The same for a matrix of irradiance.
    pub fn irradiance_coefficients(&self, set: usize, rig: &LightRig, light: Option<&LampLight>) -> Vec<Vec<[f32; 3]>> {
        let mut coefficients = self.header.irradiance_coefficients(set, rig);
        if let Some(light) = light {
            self.header.add_of_patches(&mut coefficients, &light.of_patches);
        }
        coefficients
    }

    /// Whether what surfaces make of the light of free lamps is part of every matrix of irradiance.
    pub fn holds_lamp_lux(&self) -> bool {
        self.irradiance.iter().all(|groups| self.header.holds_patches(groups))
    }

    /// Which matrix of irradiance is that of the pixels, if there is one.
    pub fn pixel_irradiance(&self) -> Option<usize> {
        self.header.pixel_irradiance(self.irradiance.len())
    }

    /// Error of the illuminance at the pixels, dB below the peaks of the lights there; none where there is no illuminance.
    pub fn lux_error_db(&self) -> Option<f32> {
        let figures = self.pixel_irradiance().map(|set| self.bake().irradiance_figures().swap_remove(set));
        figures.map(|figures| figures.error_db.total)
    }

    /// The bake, as far as it is there.
    pub fn bake(&self) -> Bake {
        Bake {
            header: self.header.clone(),
            groups: self.frame.groups.clone(),
            irradiance: self.irradiance.clone(),
            packed: self.packed.clone(),
        }
    }
}
