//! The first surface of each pixel: rays of neighbors go together.

use glam::{Vec2, Vec3};

use super::{TILE, sampler_of};
use crate::camera::{Camera, Film};
use crate::prepared::{PreparedScene, SurfaceHit};
use crate::sampler::Sampler;

/// What a pixel sees straight on in one of its samples.
pub(super) struct First {
    pub direction: Vec3,
    pub hit: Option<SurfaceHit>,
    /// Random numbers for what comes after it.
    pub sampler: Sampler,
}

/// Side of the squares of pixels whose rays go together.
const SQUARE: u32 = 4;
/// Pixels of a square.
const N_PIXELS: usize = (SQUARE * SQUARE) as usize;

/// What the pixels of a tile see first, row by row; nothing where the tile is beyond the film.
pub(super) fn look(
    scene: &PreparedScene,
    (camera, film): (&Camera, Film),
    (seed, sample): (u64, u32),
    [left, top]: [u32; 2],
    out: &mut Vec<Option<First>>,
) {
    out.clear();
    out.resize_with((TILE * TILE) as usize, || None);
    let squares = (0..TILE).step_by(SQUARE as usize);
    for [x, y] in squares.clone().flat_map(|y| squares.clone().map(move |x| [x, y])) {
        let is_on_film = |[x, y]: &[u32; 2]| left + x < film.width && top + y < film.height;
        let mut pixels = [[0; 2]; N_PIXELS];
        let mut n = 0;
        let in_square = (0..N_PIXELS as u32).map(|nth| [x + nth % SQUARE, y + nth / SQUARE]);
        for pixel in in_square.filter(is_on_film) {
            pixels[n] = pixel;
            n += 1;
        }
        let pixels = &pixels[..n];

        // Every pixel draws as if it were followed alone: its place first, then whether what it meets is there.
        let mut samplers = [Sampler::new(seed, 0, 0); N_PIXELS];
        let mut directions = [Vec3::ZERO; N_PIXELS];
        for (nth, [x, y]) in pixels.iter().map(|[x, y]| [left + x, top + y]).enumerate() {
            let mut sampler = sampler_of(seed, y * film.width + x, sample);
            let film_px = Vec2::new(x as f32, y as f32) + Vec2::from(sampler.next_2d());
            (directions[nth], samplers[nth]) = (camera.direction(film, film_px), sampler);
        }
        let hits = scene.closest_seen16(camera.position(), &directions, &mut samplers[..n]);
        for (nth, [x, y]) in pixels.iter().enumerate() {
            let first = First { direction: directions[nth], hit: hits[nth], sampler: samplers[nth] };
            out[(y * TILE + x) as usize] = Some(first);
        }
    }
}
