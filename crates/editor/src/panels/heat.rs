//! Which map of colors lies over the picture.

use clerestory_transport::error_maps::{BlockMap, ErrorLayer};
use eframe::egui::{Color32, ComboBox, Painter, Rect, TextureId, Ui, pos2};

use super::bake::BakeView;
use crate::legend::{Counting, ScaleBar, number_words};

/// What the colors over the picture tell about the bake; `None` where there are none.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct HeatMap(Option<BlockMap>);

/// A map of colors, ready to be drawn.
#[derive(Clone, Copy, Debug)]
pub struct Overlay {
    /// One texel per block.
    pub texture: TextureId,
    /// Share of the texture that the picture covers, across and down.
    pub covered: [f32; 2],
    /// What its colors mean.
    pub bar: ScaleBar,
    /// Value of the block under the pointer.
    pub hovered: Option<f32>,
}

/// How much of a picture a map of colors hides, of 255.
const ALPHA: u8 = 200;
/// Points that the list of maps may take: all of them are seen at once.
const ROOM: f32 = 400.0;
/// Beyond this nothing is told apart in factors of 16 bits.
const BEST_DB: f32 = 100.0;

impl Overlay {
    /// Draws it over a picture that lies in a rectangle.
    pub fn paint(&self, painter: &Painter, image: Rect) {
        let covered = Rect::from_min_max(pos2(0.0, 0.0), pos2(self.covered[0], self.covered[1]));
        painter.image(self.texture, image, covered, Color32::from_white_alpha(ALPHA));
    }

    /// What it tells of the block under the pointer.
    pub fn hovered_words(&self) -> Option<String> {
        let ScaleBar { name, unit, counting, .. } = self.bar;
        self.hovered.map(|value| match counting {
            Counting::Down if value >= BEST_DB => format!("{name} of this block: none"),
            _ => format!("{name} of this block: {} {unit}", number_words(value)),
        })
    }
}

impl HeatMap {
    const ALL: [HeatMap; 7] = [
        HeatMap(None),
        HeatMap(Some(BlockMap::Rank)),
        HeatMap(Some(BlockMap::Error(ErrorLayer::Total))),
        HeatMap(Some(BlockMap::Error(ErrorLayer::Truncation))),
        HeatMap(Some(BlockMap::Error(ErrorLayer::Sampling))),
        HeatMap(Some(BlockMap::Error(ErrorLayer::Noise))),
        HeatMap(Some(BlockMap::Samples)),
    ];

    /// What is counted.
    pub fn kind(self) -> Option<BlockMap> {
        self.0
    }

    fn is_of_noise(self) -> bool {
        matches!(self.0, Some(BlockMap::Error(layer)) if layer.is_of_noise())
    }

    /// How its values are told.
    pub fn counting(self) -> Counting {
        if matches!(self.0, Some(BlockMap::Error(_))) { Counting::Down } else { Counting::Up }
    }

    /// For people.
    pub fn name(self) -> &'static str {
        match self.0 {
            None => "Off",
            Some(BlockMap::Rank) => "Rank",
            Some(BlockMap::Error(ErrorLayer::Total)) => "Total error",
            Some(BlockMap::Error(ErrorLayer::Truncation)) => "Lost detail",
            Some(BlockMap::Error(ErrorLayer::Sampling)) => "Noise left",
            Some(BlockMap::Error(ErrorLayer::Noise)) => "Noise sampled",
            Some(BlockMap::Samples) => "Samples",
        }
    }

    /// Unit of its scale, for people.
    pub fn unit(self) -> &'static str {
        match self.0 {
            None => "",
            Some(BlockMap::Rank) => "terms",
            Some(BlockMap::Error(_)) => "dB below peak",
            Some(BlockMap::Samples) => "samples/px",
        }
    }

    /// What it tells, for people.
    fn hint(self) -> &'static str {
        match self.0 {
            None => "The picture alone",
            Some(BlockMap::Rank) => "Terms that each block needs: many where shadows and highlights are sharp",
            Some(BlockMap::Error(ErrorLayer::Total)) => {
                "Lost detail and the noise that is left, together, in dB below what the lights reach at their brightest: \
                 32 dB is 2.5 %, 40 dB 1 %"
            }
            Some(BlockMap::Error(ErrorLayer::Truncation)) => {
                "What compression leaves out of shadows and highlights, held against samples that it has not seen\n\
                 More dB of tolerance keep more"
            }
            Some(BlockMap::Error(ErrorLayer::Sampling)) => {
                "Grain of the samples that is still there after compression, told by two halves of them\n\
                 More samples take it out"
            }
            Some(BlockMap::Error(ErrorLayer::Noise)) => {
                "Grain of the samples as they were taken, before compression took out most of it"
            }
            Some(BlockMap::Samples) => "Samples that each pixel took: a block stops once it is exact enough",
        }
    }
}

/// Draws the choice.
pub fn heat_ui(ui: &mut Ui, map: &mut HeatMap, view: &BakeView) {
    ui.horizontal(|ui| {
        let label = ui.label("Heat map");
        let combo = ComboBox::from_id_salt("heat map").height(ROOM).selected_text(map.name()).show_ui(ui, |ui| {
            for choice in HeatMap::ALL {
                let is_known = view.pictures.is_none() || !choice.is_of_noise();
                let value = ui.add_enabled_ui(is_known, |ui| ui.selectable_value(map, choice, choice.name())).inner;
                let unknown = "Pictures that were taken tell nothing of their own noise";
                value.on_hover_text(choice.hint()).on_disabled_hover_text(unknown);
            }
        });
        let hint = "Colors over the picture, a color for each block of pixels: what it needed, and how exact it is\nIt hides false color";
        combo.response.labelled_by(label.id).on_hover_text(format!("{hint}\n{}: {}", map.name(), map.hint()));
    });
}
