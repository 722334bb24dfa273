//! Which map of colors lies over the picture.

use clerestory_transport::error_maps::BlockMap;
use eframe::egui::{Color32, ComboBox, Painter, Rect, TextureId, Ui, pos2};

use crate::legend::ScaleBar;

/// What the colors over the picture tell about the bake.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum HeatMap {
    /// There are none.
    #[default]
    Off,
    /// Rank of each block.
    Rank,
    /// Error of each block.
    Error,
    /// Samples of each block.
    Samples,
}

/// A map of colors, ready to be drawn.
#[derive(Clone, Copy, Debug)]
pub struct Overlay {
    /// One texel per block.
    pub texture: TextureId,
    /// Share of the texture that the picture covers, across and down.
    pub covered: [f32; 2],
    /// What its colors mean.
    pub bar: ScaleBar,
}

/// How much of a picture a map of colors hides, of 255.
const ALPHA: u8 = 200;

impl Overlay {
    /// Draws it over a picture that lies in a rectangle.
    pub fn paint(&self, painter: &Painter, image: Rect) {
        let covered = Rect::from_min_max(pos2(0.0, 0.0), pos2(self.covered[0], self.covered[1]));
        painter.image(self.texture, image, covered, Color32::from_white_alpha(ALPHA));
    }
}

impl HeatMap {
    const ALL: [HeatMap; 4] = [HeatMap::Off, HeatMap::Rank, HeatMap::Error, HeatMap::Samples];

    /// What is counted.
    pub fn kind(self) -> Option<BlockMap> {
        match self {
            HeatMap::Off => None,
            HeatMap::Rank => Some(BlockMap::Rank),
            HeatMap::Error => Some(BlockMap::ErrorPercent),
            HeatMap::Samples => Some(BlockMap::Samples),
        }
    }

    /// For people.
    pub fn name(self) -> &'static str {
        match self {
            HeatMap::Off => "Off",
            HeatMap::Rank => "Rank",
            HeatMap::Error => "Error",
            HeatMap::Samples => "Samples",
        }
    }

    /// Unit of its scale, for people.
    pub fn unit(self) -> &'static str {
        match self {
            HeatMap::Off => "",
            HeatMap::Rank => "rank",
            HeatMap::Error => "% of peak",
            HeatMap::Samples => "samples/px",
        }
    }
}

/// Draws the choice.
pub fn heat_ui(ui: &mut Ui, map: &mut HeatMap) {
    ui.horizontal(|ui| {
        let label = ui.label("Heat map");
        let combo = ComboBox::from_id_salt("heat map").selected_text(map.name()).show_ui(ui, |ui| {
            for choice in HeatMap::ALL {
                ui.selectable_value(map, choice, choice.name());
            }
        });
        let hint = "Colors over the picture: terms that each block needs, its error in percent of the peak, or the samples of its pixels";
        combo.response.labelled_by(label.id).on_hover_text(hint);
    });
}
