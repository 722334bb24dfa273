//! Spots of light that the file marks on its panels: `extras: {"clerestory": {"panel": 32, "spots": […]}}`, as a look has them.

use gltf::json::Node;

use super::document::called;
use super::report::Notes;
use super::sensors::extra;
use crate::light::PanelSpot;

/// Most spots of a panel.
const MOST_SPOTS: usize = 1000;
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
    let within = |value: &f32, most: f32| (0.0..=most).contains(value);
    spot.position.iter().all(|coordinate| coordinate.abs() <= PanelSpot::MOST_AWAY)
        && within(&spot.radius, PanelSpot::MOST_RADIUS)
        && spot.color.iter().flatten().all(|channel| within(channel, PanelSpot::MOST_CHANNEL))
        && within(&spot.intensity, PanelSpot::MOST_INTENSITY)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spots_are_what_a_look_can_take_over() {
        let spot = PanelSpot { position: [-1.0, 2.0], radius: 3.0, color: Some([1.0, 0.5, 0.0]), intensity: 40.0 };
        assert!(is_sane(&spot));
        let odd = [
            PanelSpot { position: [0.0, 101.0], ..spot },
            PanelSpot { radius: 2000.0, ..spot },
            PanelSpot { color: Some([1.0, 2e6, 0.0]), ..spot },
            PanelSpot { intensity: f32::NAN, ..spot },
        ];
        assert!(!odd.iter().any(is_sane));
        assert!(odd[..3].iter().all(|odd| is_sane(&odd.within_limits())), "bakes of earlier versions hold such spots");
        assert_eq!(spot.within_limits(), spot);
    }
}
