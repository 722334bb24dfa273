//! A map of colors over the picture: what each block of the bake needed, and how exact it is.

use clerestory_nystrom::Partition;
use clerestory_relight::display::{ColorScale, Spacing};
use clerestory_relight::{DisplayParams, Radiance, encode};
use clerestory_transport::error_maps::BlockMap;
use eframe::egui::{Color32, ColorImage, Context, TextureHandle, TextureOptions};

use super::App;
use crate::legend::{Counting, ScaleBar};
use crate::look::FalseColor;
use crate::panels::heat::{HeatMap, Overlay};

/// The map that is shown, and what would take its place.
#[derive(Default)]
pub(super) struct HeatDesk {
    painted: Option<Heat>,
    /// False color of the look a frame ago.
    false_color: Option<FalseColor>,
}

/// A map as it was painted.
struct Heat {
    map: HeatMap,
    /// Which count of the blocks it is of.
    n_counts: u64,
    texture: TextureHandle,
    scale: ColorScale,
    /// Share of the map that the picture covers, across and down.
    covered: [f32; 2],
    /// Which block is where.
    partition: Partition,
    /// One per block.
    values: Vec<Option<f32>>,
}

/// Decibels from the worst blocks on that have colors of their own, at most, and to what a scale of them is rounded.
const MOST_DB: f32 = 40.0;
const STEP_DB: f32 = 5.0;
/// Share of the blocks beyond each end of a scale of decibels, at most.
const OUTSIDE: f64 = 0.02;

impl HeatDesk {
    /// The map is painted anew.
    pub fn forget(&mut self) {
        self.painted = None;
    }
}

impl Heat {
    /// The value of the block of a pixel.
    fn at(&self, [x, y]: [u32; 2]) -> Option<f32> {
        let Partition { tile, .. } = self.partition;
        let block_idx = (y / tile.max(1)) * self.partition.tiles_x() + x / tile.max(1);
        *self.values.get(block_idx as usize)?
    }
}

impl App {
    /// Whether false color is hidden by a map: colors over colors tell nothing.
    pub(super) fn hides_false_color(&self) -> bool {
        self.heat_map.kind().is_some()
    }

    /// The map that was chosen, made anew where blocks came since. False color that came or was changed since, by hand or by undo, takes
    /// its place.
    pub(super) fn heat_overlay(&mut self, ctx: &Context) -> Option<Overlay> {
        let now = self.look.display.false_color;
        let before = std::mem::replace(&mut self.heat.false_color, now);
        if now.is_some() && now != before {
            self.heat_map = HeatMap::default();
        }
        let Some(kind) = self.heat_map.kind() else {
            self.heat.forget();
            return None;
        };
        let (n_counts, map) = (self.session.n_counts(), self.heat_map);
        let is_current = |heat: &Heat| (heat.map, heat.n_counts) == (map, n_counts);
        if !self.heat.painted.as_ref().is_some_and(is_current) {
            self.heat.painted = self.paint_heat(ctx, kind, map, n_counts);
        }
        let heat = self.heat.painted.as_ref()?;
        let bar = ScaleBar { name: map.name(), unit: map.unit(), scale: heat.scale, counting: map.counting() };
        let hovered = self.view.probes.hover.and_then(|px| heat.at(px));
        Some(Overlay { texture: heat.texture.id(), covered: heat.covered, bar, hovered })
    }

    fn paint_heat(&self, ctx: &Context, kind: BlockMap, map: HeatMap, n_counts: u64) -> Option<Heat> {
        let shown = self.session.shown.as_ref()?;
        let values = shown.bake().block_map(kind);
        if values.iter().all(Option::is_none) {
            return None;
        }
        let partition = shown.header.partition();
        let (width, height) = (partition.tiles_x(), (values.len() as u32).div_ceil(partition.tiles_x().max(1)));
        let counting = map.counting();
        let pixels = values.iter().map(|value| [counting.turned(value.unwrap_or(0.0)); 3]).collect();
        let radiance = Radiance { width, height, pixels };
        let scale = match kind {
            _ if counting == Counting::Down => decibel_scale(values.iter().flatten()),
            BlockMap::Rank => ColorScale::fitting(&radiance, Spacing::Linear),
            _ => ColorScale::fitting(&radiance, Spacing::Log),
        };
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
        Some(Heat { map, n_counts, texture, scale, covered, partition, values })
    }
}

/// A scale for decibels below the peak. A few blocks that are far worse or far better than all others share its ends, so that they do
/// not take the colors of the rest.
fn decibel_scale<'a>(values: impl Iterator<Item = &'a f32>) -> ColorScale {
    let mut values: Vec<f32> = values.copied().collect();
    values.sort_by(f32::total_cmp);
    let at = |share: f64| values.get((values.len() as f64 * share) as usize).copied().unwrap_or(0.0);
    let high = -STEP_DB * (at(OUTSIDE) / STEP_DB).floor();
    let low = (-STEP_DB * (at(1.0 - OUTSIDE) / STEP_DB).ceil()).clamp(high - MOST_DB, high - STEP_DB);
    ColorScale { spacing: Spacing::Linear, low, high }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_scale_of_decibels_ends_with_the_worst_blocks_and_passes_over_what_is_exact() {
        let scale = |values: &[f32]| {
            let ColorScale { low, high, .. } = decibel_scale(values.iter());
            [low, high]
        };
        assert_eq!(scale(&[31.0, 44.0, 38.0]), [-45.0, -30.0]);
        assert_eq!(scale(&[31.0, 120.0]), [-70.0, -30.0]);
        assert_eq!(scale(&[120.0]), [-125.0, -120.0]);
        assert_eq!(scale(&[-3.0, 20.0]), [-20.0, 5.0]);
        // One block in a hundred is past all measure.
        let many: Vec<f32> = (0..99).map(|nth| 20.0 + 0.2 * nth as f32).chain([-40.0]).collect();
        assert_eq!(scale(&many), [-40.0, -20.0]);
    }
}
