//! Spots of light that the file marks on its panels: `extras: {"clerestory": {"panel": 32, "spots": […]}}`, as a look has them.

use gltf::json::Node;

use super::document::called;
use super::report::Notes;
use super::sensors::extra;
use crate::light::PanelSpot;

/// Most spots of a panel.
const MOST_SPOTS: usize = 1000;
/// Most that a number of theirs is believed to be.
const MOST: f32 = 1e9;

/// The spots of a node, if it marks some that make sense.
pub(super) fn marked(node: &Node, index: usize, notes: &mut Notes) -> Option<Vec<PanelSpot>> {
    let asked = extra(node, "spots")?;
    let spots = serde_json::from_value::<Vec<PanelSpot>>(asked).ok().filter(|spots| spots.len() <= MOST_SPOTS);
    let spots = spots.filter(|spots| spots.iter().all(is_sane));
    if spots.is_none() {
        let name = called("node", index, node.name.as_ref());
        notes.warn(format!("{name}: the spots that it marks cannot be read: its panel shines uniformly"));
    }
    spots
}

fn is_sane(spot: &PanelSpot) -> bool {
    let amounts = spot.color.iter().flatten().chain([&spot.radius, &spot.intensity]);
    spot.position.iter().all(|v| v.abs() <= MOST) && amounts.into_iter().all(|v| (0.0..=MOST).contains(v))
}
