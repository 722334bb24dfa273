//! What pixels see, in plain words for a device that lights it, and what the device leaves to the CPU.

use glam::Vec3;
use rayon::prelude::*;

use super::shade::{GROUP, shift};
use super::{Band, TILE, VisiblePoints};
use crate::lamps::PreparedLamps;
use crate::prepared::PreparedScene;

/// What the pixels see in one of their samples.
#[derive(Clone, Debug)]
pub struct SampleWords {
    /// Where the points of each pixel begin, row by row, and the number of points.
    pub starts: Vec<u32>,
    /// Four rows for each point: place and throughput, its number among those of its tile with how many slabs light may pass, directions,
    /// and looks.
    pub points: Vec<[u32; 4]>,
}

/// Rows of a point.
const ROWS: usize = 4;

impl VisiblePoints {
    /// What a pass takes, for a device.
    pub fn words(&self, scene: &PreparedScene, pass: u32) -> SampleWords {
        let (sample, _) = self.turn(pass);
        let bands = &self.bands[sample as usize];
        let width = self.film.width as usize;
        let words: Vec<SampleWords> = bands
            .par_iter()
            .enumerate()
            .map(|(nth, band)| {
                let first = nth * TILE as usize * width;
                let n_pixels = (self.film.n_pixels() - first).min(TILE as usize * width);
                band.words(scene, first as u32, n_pixels)
            })
            .collect();
        let (mut starts, mut points) = (Vec::with_capacity(self.film.n_pixels() + 1), Vec::new());
        for band in words {
            let before = (points.len() / ROWS) as u32;
            starts.extend(band.starts.iter().map(|start| before + start));
            points.extend(band.points);
        }
        starts.push((points.len() / ROWS) as u32);
        SampleWords { starts, points }
    }

    /// Offsets of the points on a lamp in a pass, for each tile of 16 × 16 pixels.
    pub fn shifts(&self, pass: u32) -> Vec<[f32; 2]> {
        let (sample, round) = self.turn(pass);
        let key = (self.config.seed, [self.config.first + sample, round]);
        let (across, down) = (self.film.width.div_ceil(TILE) as usize, self.film.height.div_ceil(TILE));
        let tiles = (0..down).flat_map(|band| (0..across).map(move |tile| (band * TILE * self.film.width, tile)));
        tiles.map(|place| shift(place, 0, key).to_array()).collect()
    }

    /// A pass of one lamp of which a device found what it could: RGB of each pixel, and a fourth number that is not 0 where nothing was
    /// found. The same picture as [`VisiblePoints::direct`] but for rounding; `None` when `stop` asked to.
    pub fn completed(
        &self,
        scene: &PreparedScene,
        lamps: &PreparedLamps,
        pass: u32,
        found: &[[f32; 4]],
        stop: &(dyn Fn() -> bool + Sync),
    ) -> Option<Vec<[f32; 3]>> {
        let lacks = |pixel: u32| found[pixel as usize][3] != 0.0;
        let known = |&[r, g, b, left]: &[f32; 4]| if left == 0.0 { Vec3::new(r, g, b) } else { Vec3::ZERO };
        self.complete(scene, lamps, pass, found.par_iter().map(known).collect(), lacks, stop)
    }
}

impl Band {
    /// Pixels of the band begin with number `first`; starts count from the band's first point.
    fn words(&self, scene: &PreparedScene, first: u32, n_pixels: usize) -> SampleWords {
        let points = &self.found.points;
        let mut starts = vec![0u32; n_pixels + 1];
        for point in points {
            starts[(point.pixel - first) as usize + 1] += 1;
        }
        for pixel in 0..n_pixels {
            starts[pixel + 1] += starts[pixel];
        }
        starts.pop();
        let (mut next, mut rows) = (starts.clone(), vec![[0; 4]; ROWS * points.len()]);
        for ends in self.tiles.windows(2) {
            for (nth, point) in points[ends[0] as usize..ends[1] as usize].iter().enumerate() {
                let slot = &mut next[(point.pixel - first) as usize];
                let words = point.words(scene, (nth / GROUP) as u32, (nth % GROUP) as u32);
                rows[ROWS * *slot as usize..][..ROWS].copy_from_slice(&words);
                *slot += 1;
            }
        }
        SampleWords { starts, points: rows }
    }
}
