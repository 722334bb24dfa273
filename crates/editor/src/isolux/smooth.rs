//! Takes the grain out of a picture of light and leaves its edges, so that lines run where the light is and not where its noise is
//! \[Tomasi1998\].

use rayon::prelude::*;

use super::contour::Field;

/// Reach to either side, as a share of the width of the picture, a pixel at least, and the most of it in pixels.
const REACH: f32 = 0.005;
const MOST_PX: f32 = 4.0;
/// Neighbors whose light differs by this factor or more do not count.
const FACTOR: f32 = 1.8;
/// Values up to this count as equal, lux: what is darker has no line.
const FLOOR_LX: f32 = 0.01;

/// The mean of each pixel's neighbors, those of nearly its own light alone.
pub(super) fn smoothed(field: &Field) -> Field {
    let reach = (REACH * field.width as f32).round().clamp(1.0, MOST_PX) as usize;
    let stops: Vec<f32> = field.values.iter().map(|lux| lux.max(FLOOR_LX).log2()).collect();
    let row = |y: usize| (0..field.width).map(move |x| (x, y));
    let values = (0..field.height).into_par_iter().flat_map_iter(row);
    Field { values: values.map(|at| mean(field, &stops, reach, at)).collect(), ..*field }
}

fn mean(field: &Field, stops: &[f32], reach: usize, (x, y): (usize, usize)) -> f32 {
    let range = |at: usize, side: usize| at.saturating_sub(reach)..(at + reach + 1).min(side);
    let own = stops[y * field.width + x];
    let (mut sum, mut weights) = (0.0, 0.0);
    for row in range(y, field.height) {
        for column in range(x, field.width) {
            let index = row * field.width + column;
            let apart = (stops[index] - own) / FACTOR.log2();
            let weight = (1.0 - apart * apart).max(0.0);
            sum += weight * field.values[index];
            weights += weight;
        }
    }
    // A pixel has the weight 1 for itself, unless it is no number.
    if weights > 0.0 { sum / weights } else { field.values[y * field.width + x] }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn grain_goes_and_edges_stay() {
        // 100 lx beside 400 lx, with a grain of a tenth.
        let lux = |nth: usize| {
            let (x, y) = (nth % 400, nth / 400);
            let grain = if (x * 7 + y * 13) % 5 < 2 { 1.1 } else { 0.93 };
            if x < 200 { 100.0 * grain } else { 400.0 * grain }
        };
        let field = Field { width: 400, height: 40, values: (0..16_000).map(lux).collect(), jump: 1.6 };
        let smooth = smoothed(&field);
        let spread = |field: &Field, from: usize, known: f32| {
            let of = (0..40).flat_map(|y| (from..from + 190).map(move |x| (x, y)));
            of.map(|(x, y)| (field.values[y * 400 + x] / known - 1.0).abs()).fold(0.0, f32::max)
        };
        for (from, known) in [(0, 100.0), (205, 400.0)] {
            assert!(spread(&field, from, known) > 0.06 && spread(&smooth, from, known) < 0.04, "{known} lx");
        }
        assert!(smooth.values[199] < 112.0 && smooth.values[200] > 360.0, "the edge stays where it is");
    }
}
