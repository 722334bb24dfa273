//! The sky behind the picture in the window: blocks that see it are lit by its map, each once for every turn of it.

use std::sync::Arc;

use clerestory_nystrom::BlockFactors;
use clerestory_relight::Frame;
use clerestory_transport::light::LightRig;
use clerestory_transport::sky::Backdrop;

use crate::picture::Changed;
use crate::session::Shown;

/// A block of the bake and the same block lit.
type Lit = Option<(Arc<BlockFactors>, Arc<BlockFactors>)>;

/// The sky that was shown last, and the blocks that it lit.
#[derive(Default)]
pub(super) struct LitSky {
    backdrop: Option<Backdrop>,
    blocks: Vec<Lit>,
}

impl LitSky {
    /// The frame as it is shown under a rig. Blocks of the sky are added to `changed` where the sky has turned.
    pub fn light(&mut self, shown: &Shown, rig: &LightRig, changed: &mut Changed) -> Frame {
        let mut frame = shown.frame.clone();
        let Some(backdrop) = Backdrop::new(&shown.header, rig) else {
            *self = LitSky::default();
            return frame;
        };
        let group = &mut frame.groups[backdrop.group];
        if !self.backdrop.as_ref().is_some_and(|other| other.shows_the_same(&backdrop)) {
            self.blocks.clear();
            changed.absorb(Changed::Blocks((0..group.blocks.len()).map(|idx| (backdrop.group, idx)).collect()));
        }
        self.blocks.resize(group.blocks.len(), None);
        let mut pixels = Vec::new();
        for (idx, (block, lit)) in group.blocks.iter_mut().zip(&mut self.blocks).enumerate() {
            let Some(block) = block else { continue };
            let known = lit.as_ref().filter(|(raw, _)| Arc::ptr_eq(raw, block)).map(|(_, lit)| lit.clone());
            let shown = known.unwrap_or_else(|| {
                group.partition.bundles(idx, &mut pixels);
                Arc::new(backdrop.lit(block, &pixels))
            });
            *lit = Some((block.clone(), shown.clone()));
            *block = shown;
        }
        self.backdrop = Some(backdrop);
        frame
    }
}
