//! A map of colors over the picture: what each block of the bake needed, and how exact it is.

use clerestory_relight::display::{ColorScale, Spacing};
use clerestory_relight::{DisplayParams, Radiance, encode};
use clerestory_transport::error_maps::BlockMap;
use eframe::egui::{Color32, ColorImage, Context, TextureHandle, TextureOptions};

use super::App;
use crate::legend::ScaleBar;
use crate::panels::heat::{HeatMap, Overlay};

/// The map that is shown.
pub(super) struct Heat {
    map: HeatMap,
    /// Which count of the blocks it is of.
    n_counts: u64,
    texture: TextureHandle,
    scale: ColorScale,
    /// Share of the map that the picture covers, across and down.
    covered: [f32; 2],
}

impl App {
    /// The map that was chosen, made anew where blocks came since.
    pub(super) fn heat_overlay(&mut self, ctx: &Context) -> Option<Overlay> {
        let Some(kind) = self.heat_map.kind() else {
            self.heat = None;
            return None;
        };
        let (n_counts, map) = (self.session.n_counts(), self.heat_map);
        let is_current = |heat: &Heat| (heat.map, heat.n_counts) == (map, n_counts);
        if !self.heat.as_ref().is_some_and(is_current) {
            self.heat = self.paint_heat(ctx, kind, map, n_counts);
        }
        let heat = self.heat.as_ref()?;
        let bar = ScaleBar { name: map.name(), unit: map.unit(), scale: heat.scale };
        Some(Overlay { texture: heat.texture.id(), covered: heat.covered, bar })
    }

    fn paint_heat(&self, ctx: &Context, kind: BlockMap, map: HeatMap, n_counts: u64) -> Option<Heat> {
        let shown = self.session.shown.as_ref()?;
        let values = shown.bake().block_map(kind);
        let partition = shown.header.partition();
        let (width, height) = (partition.tiles_x(), (values.len() as u32).div_ceil(partition.tiles_x().max(1)));
        let pixels = values.iter().map(|value| [value.unwrap_or(0.0); 3]).collect();
        let radiance = Radiance { width, height, pixels };
        let spacing = if kind == BlockMap::Rank { Spacing::Linear } else { Spacing::Log };
        let scale = ColorScale::fitting(&radiance, spacing);
        let params = DisplayParams { false_color: Some(scale), ..DisplayParams::default() };
        let bytes = encode(&radiance, &params);
        let color = |(rgba, value): (&[u8; 4], &Option<f32>)| match value {
            Some(_) => Color32::from_rgb(rgba[0], rgba[1], rgba[2]),
            None => Color32::TRANSPARENT,
        };
        let pixels = bytes.as_chunks::<4>().0.iter().zip(&values).map(color).collect();
        let image = ColorImage::new([width as usize, height as usize], pixels);
        let texture = ctx.load_texture("heat map", image, TextureOptions::NEAREST);
        let share = |pixels: u32, tiles: u32| pixels as f32 / (tiles * partition.tile).max(1) as f32;
        let covered = [share(partition.width, width), share(partition.height, height)];
        Some(Heat { map, n_counts, texture, scale, covered })
    }
}
