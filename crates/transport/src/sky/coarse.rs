//! A map at the resolution that patches need, made once for each map: turning a sky is then a matter of milliseconds.

use super::Environment;

/// Pixels around below which a map is left as it is; the smallest patches are five of these wide.
const WIDTH: usize = 512;

/// Means over blocks of pixels; no light is lost.
#[derive(Clone, Debug)]
pub(super) struct Coarse {
    /// From the zenith down.
    pub rows: Vec<CoarseRow>,
}

/// A row of blocks.
#[derive(Clone, Debug)]
pub(super) struct CoarseRow {
    /// Sines of the elevations between which it lies, the lower one first.
    pub sines: [f64; 2],
    /// Mean radiance of each block in nit.
    pub cells: Vec<[f32; 3]>,
}

impl Coarse {
    pub fn new(map: &Environment) -> Coarse {
        let width = map.width();
        // Blocks of equal width keep the directions of the map.
        let block = (1..=(width / WIDTH).max(1)).rev().find(|block| width.is_multiple_of(*block)).unwrap_or(1);
        let cells = map.cell_means();
        let row = |start: usize| {
            let rows = start..(start + block).min(map.height());
            let sines = [map.row_sines(rows.end - 1)[0], map.row_sines(start)[1]];
            let weight = |row: usize| {
                let [low, high] = map.row_sines(row);
                (high - low) / (sines[1] - sines[0]) / block as f64
            };
            let mut sums = vec![[0.0f64; 3]; width / block];
            for row in rows {
                let weight = weight(row);
                for (column, cell) in cells[row * width..(row + 1) * width].iter().enumerate() {
                    let sum = &mut sums[column / block];
                    sum.iter_mut().zip(cell).for_each(|(sum, v)| *sum += weight * f64::from(*v));
                }
            }
            CoarseRow { sines, cells: sums.into_iter().map(|sum| sum.map(|v| v as f32)).collect() }
        };
        Coarse { rows: (0..map.height()).step_by(block).map(row).collect() }
    }
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;

    #[test]
    fn a_coarse_map_has_the_light_of_the_fine_one() {
        let map = Environment::from_fn(1536, 101, |d| Vec3::new(1.0 + d.x, (3.0 * d.y).exp(), 1.0 + d.z));
        let (cells, coarse) = (map.cell_means(), Coarse::new(&map));
        assert_eq!((coarse.rows[0].cells.len(), coarse.rows.len()), (512, 34));
        let fine: f64 = (0..1536 * 101).map(|i| f64::from(cells[i][1]) * map.solid_angle(i / 1536)).sum();
        let row = |row: &CoarseRow| {
            let solid_angle = (row.sines[1] - row.sines[0]) * std::f64::consts::TAU / 512.0;
            row.cells.iter().map(|cell| f64::from(cell[1])).sum::<f64>() * solid_angle
        };
        let sum: f64 = coarse.rows.iter().map(row).sum();
        assert!((sum / fine - 1.0).abs() < 1e-6, "{sum} of {fine}");
    }
}
