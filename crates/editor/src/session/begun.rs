//! Bakes that were stopped, and go on where they stood.

use std::collections::BTreeMap;
use std::sync::Arc;

use clerestory_nystrom::BlockFactors;
use clerestory_transport::bake::{BakeHeader, HalfDone};
use clerestory_transport::camera::Camera;
use clerestory_transport::prepared::PreparedScene;

use super::{BakeSettings, BakeState, Session};

/// The bake that was started last, and the blocks of its last pass as they come.
pub(super) struct Begun {
    scene: Arc<PreparedScene>,
    settings: BakeSettings,
    /// Where it is seen from, if not from a camera of the scene.
    camera: Option<Camera>,
    header: Option<Arc<BakeHeader>>,
    last_pass: u32,
    blocks: BTreeMap<usize, Vec<Arc<BlockFactors>>>,
}

impl Begun {
    pub fn new(scene: Arc<PreparedScene>, settings: BakeSettings, camera: Option<Camera>) -> Begun {
        Begun { scene, settings, camera, header: None, last_pass: u32::MAX, blocks: BTreeMap::new() }
    }

    pub fn camera(&self) -> Option<Camera> {
        self.camera.clone()
    }

    pub fn started(&mut self, header: Arc<BakeHeader>, n_passes: u32) {
        (self.header, self.last_pass) = (Some(header), n_passes.saturating_sub(1));
    }

    pub fn block_done(&mut self, pass: u32, block_idx: usize, factors: &[Arc<BlockFactors>]) {
        if pass == self.last_pass {
            self.blocks.insert(block_idx, factors.to_vec());
        }
    }

    fn is_of(&self, scene: &Arc<PreparedScene>, settings: &BakeSettings) -> bool {
        Arc::ptr_eq(&self.scene, scene) && self.settings == *settings
    }
}

impl Session {
    /// Blocks of the last pass that are there of a bake that was stopped; none where it would start over.
    pub fn n_resumable(&self, settings: &BakeSettings) -> usize {
        let scene = self.opened.as_ref().and_then(|opened| opened.scene.as_ref());
        let begun = self.begun.as_ref().filter(|_| self.bake == BakeState::Stopped);
        begun
            .zip(scene)
            .filter(|(begun, scene)| begun.is_of(scene, settings))
            .map_or(0, |(begun, _)| begun.blocks.len())
    }

    /// Whether the bake that runs holds illuminance in the end.
    pub fn bakes_illuminance(&self) -> bool {
        self.bake.is_running() && self.begun.as_ref().is_some_and(|begun| begun.settings.illuminance)
    }

    /// Whether the bake that is there was made with these settings, so that nothing is to be foreseen.
    pub(super) fn is_baked_with(&self, settings: &BakeSettings) -> bool {
        let scene = self.opened.as_ref().and_then(|opened| opened.scene.as_ref());
        let begun = self.begun.as_ref().filter(|_| matches!(self.bake, BakeState::Done | BakeState::Stopped));
        begun.zip(scene).is_some_and(|(begun, scene)| begun.is_of(scene, settings))
    }

    /// What is there of the bake that was stopped.
    pub(super) fn half_done(&self) -> Option<HalfDone> {
        let begun = self.begun.as_ref()?;
        let header = begun.header.clone()?;
        let blocks = begun.blocks.iter().map(|(block, factors)| (*block, factors.clone())).collect();
        Some(HalfDone { header, blocks })
    }
}
