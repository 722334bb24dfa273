//! Bakes that were stopped, and go on where they stood.

use std::collections::BTreeMap;
use std::sync::Arc;

use clerestory_nystrom::BlockFactors;
use clerestory_transport::bake::{BakeHeader, HalfDone};
use clerestory_transport::camera::Camera;
use clerestory_transport::prepared::PreparedScene;

use super::views::sees_alike;
use super::{BakeSettings, BakeState, Session};

/// What is baked.
pub(super) struct Asked {
    pub scene: Arc<PreparedScene>,
    pub settings: BakeSettings,
    /// Where it is seen from, if not from the camera of the settings.
    pub camera: Option<Camera>,
}

impl Asked {
    /// Whether it is the same picture, whatever its camera is called.
    pub fn is(&self, scene: &Arc<PreparedScene>, settings: &BakeSettings, camera: Option<&Camera>) -> bool {
        let own = seen_from(&self.scene, &self.settings, self.camera.as_ref());
        let sees_it = own.zip(seen_from(scene, settings, camera)).is_some_and(|(own, other)| sees_alike(own, other));
        Arc::ptr_eq(&self.scene, scene) && self.settings == *settings && sees_it
    }
}

/// Where a bake is seen from: a camera of its own, else that of the settings.
pub(super) fn seen_from<'a>(
    scene: &'a PreparedScene,
    settings: &BakeSettings,
    camera: Option<&'a Camera>,
) -> Option<&'a Camera> {
    camera.or_else(|| scene.scene.cameras.get(settings.camera_idx))
}

/// The bake that was started last, and the blocks of its last pass as they come.
pub(super) struct Begun {
    of: Asked,
    header: Option<Arc<BakeHeader>>,
    last_pass: u32,
    blocks: BTreeMap<usize, Vec<Arc<BlockFactors>>>,
}

impl Begun {
    pub fn new(scene: Arc<PreparedScene>, settings: BakeSettings, camera: Option<Camera>) -> Begun {
        let of = Asked { scene, settings, camera };
        Begun { of, header: None, last_pass: u32::MAX, blocks: BTreeMap::new() }
    }

    pub fn camera(&self) -> Option<Camera> {
        self.of.camera.clone()
    }

    pub fn started(&mut self, header: Arc<BakeHeader>, n_passes: u32) {
        (self.header, self.last_pass) = (Some(header), n_passes.saturating_sub(1));
    }

    pub fn block_done(&mut self, pass: u32, block_idx: usize, factors: &[Arc<BlockFactors>]) {
        if pass == self.last_pass {
            self.blocks.insert(block_idx, factors.to_vec());
        }
    }
}

impl Session {
    /// Blocks of the last pass that are there of a bake that was stopped; none where it would start over. `camera` is where
    /// the next one is seen from, if not from that of the settings.
    pub fn n_resumable(&self, settings: &BakeSettings, camera: Option<&Camera>) -> usize {
        let scene = self.opened.as_ref().and_then(|opened| opened.scene.as_ref());
        let begun = self.begun.as_ref().filter(|_| self.bake == BakeState::Stopped);
        begun
            .zip(scene)
            .filter(|(begun, scene)| begun.of.is(scene, settings, camera))
            .map_or(0, |(begun, _)| begun.blocks.len())
    }

    /// Whether the bake that runs is of this view with these settings. `camera` is where it is seen from, if not from that of the settings.
    pub fn is_baking(&self, settings: &BakeSettings, camera: Option<&Camera>) -> bool {
        let scene = self.opened.as_ref().and_then(|opened| opened.scene.as_ref());
        let begun = self.begun.as_ref().filter(|_| self.bake.is_running());
        begun.zip(scene).is_some_and(|(begun, scene)| begun.of.is(scene, settings, camera))
    }

    /// Whether the bake that runs holds illuminance in the end.
    pub fn bakes_illuminance(&self) -> bool {
        self.bake.is_running() && self.begun.as_ref().is_some_and(|begun| begun.of.settings.illuminance)
    }

    /// Whether a bake is there of this view with these settings, so that nothing is to be foreseen.
    pub(super) fn is_baked_with(&self, settings: &BakeSettings, camera: Option<&Camera>) -> bool {
        let Some(scene) = self.opened.as_ref().and_then(|opened| opened.scene.as_ref()) else { return false };
        let begun = self.begun.as_ref().filter(|_| matches!(self.bake, BakeState::Done | BakeState::Stopped));
        begun.is_some_and(|begun| begun.of.is(scene, settings, camera))
            || seen_from(scene, settings, camera).is_some_and(|camera| self.has_view(scene, settings, camera))
    }

    /// What is there of the bake that was stopped.
    pub(super) fn half_done(&self) -> Option<HalfDone> {
        let begun = self.begun.as_ref()?;
        let header = begun.header.clone()?;
        let blocks = begun.blocks.iter().map(|(block, factors)| (*block, factors.clone())).collect();
        Some(HalfDone { header, blocks })
    }
}
