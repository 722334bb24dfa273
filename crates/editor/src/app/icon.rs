//! The sign of the program for title bars, task bars and docks: panes high in a dark wall, and the light that they let in.

use eframe::egui::IconData;

/// Pixels of a side, and samples of a pixel along one.
const SIDE: u32 = 256;
const SAMPLES: u32 = 3;
/// Radius of the corners; this and what follows in widths of the sign.
const CORNER: f32 = 0.2;
/// Where the panes begin from the left, and how wide they are.
const PANES: [f32; 3] = [0.1, 0.33, 0.56];
const PANE_WIDTH: f32 = 0.18;
/// From the top: the upper and lower edge of the panes, and the floor.
const TOP: f32 = 0.16;
const SILL: f32 = 0.4;
const FLOOR: f32 = 0.86;
/// How far the light goes to the right on its way down, and how strong it is below the panes.
const SLANT: f32 = 0.3;
const BEAM: f32 = 0.5;
/// sRGB, 0…255.
const WALL: [f32; 3] = [38.0, 36.0, 34.0];
const LIGHT: [f32; 3] = [255.0, 222.0, 162.0];

/// Draws it.
pub(super) fn icon() -> IconData {
    let pixels = (0..SIDE).flat_map(|y| (0..SIDE).flat_map(move |x| pixel(x, y)));
    IconData { rgba: pixels.collect(), width: SIDE, height: SIDE }
}

/// Red, green, blue and coverage of a pixel.
fn pixel(x: u32, y: u32) -> [u8; 4] {
    let place = |px: u32, nth: u32| (px as f32 + (nth as f32 + 0.5) / SAMPLES as f32) / SIDE as f32;
    let n_samples = SAMPLES * SAMPLES;
    let (mut sum, mut n_covered) = ([0.0f32; 3], 0.0f32);
    for rgb in (0..n_samples).filter_map(|nth| color(place(x, nth % SAMPLES), place(y, nth / SAMPLES))) {
        (0..3).for_each(|c| sum[c] += rgb[c]);
        n_covered += 1.0;
    }
    let [r, g, b] = sum.map(|sum| (sum / n_covered.max(1.0)).round() as u8);
    [r, g, b, (255.0 * n_covered / n_samples as f32).round() as u8]
}

/// What is seen at a place; nothing beyond the round corners.
fn color(x: f32, y: f32) -> Option<[f32; 3]> {
    let beyond = |at: f32| ((at - 0.5).abs() - (0.5 - CORNER)).max(0.0);
    if beyond(x).hypot(beyond(y)) > CORNER {
        return None;
    }
    let at_sill = x - SLANT * (y - SILL).max(0.0);
    let is_lit = PANES.iter().any(|left| (*left..left + PANE_WIDTH).contains(&at_sill));
    let light = if !is_lit || !(TOP..FLOOR).contains(&y) {
        0.0
    } else if y < SILL {
        1.0
    } else {
        BEAM * (FLOOR - y) / (FLOOR - SILL)
    };
    Some(std::array::from_fn(|c| WALL[c] + light * (LIGHT[c] - WALL[c])))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_sign_is_round_at_its_corners_and_brightest_in_its_panes() {
        let IconData { rgba, width, height } = icon();
        assert_eq!(rgba.len(), 4 * (width * height) as usize);
        let at = |x: f32, y: f32| {
            let (x, y) = ((x * width as f32) as usize, (y * height as f32) as usize);
            <[u8; 4]>::try_from(&rgba[4 * (y * width as usize + x)..][..4]).unwrap()
        };
        assert_eq!([at(0.0, 0.0)[3], at(0.999, 0.999)[3], at(0.5, 0.0)[3]], [0, 0, 255]);
        for left in PANES {
            let (pane, below) = (at(left + 0.5 * PANE_WIDTH, 0.3), at(left + 0.5 * PANE_WIDTH + 0.03, 0.5));
            assert!(pane[0] > 250 && (60..pane[0]).contains(&below[0]) && at(left - 0.02, 0.3)[0] < 50, "{left}");
        }
    }
}
