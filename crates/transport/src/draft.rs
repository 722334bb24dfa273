//! A quick picture of the surfaces alone, for somebody who looks for a view: one ray per pixel, no light but that of the eye.

use glam::{Vec2, Vec3};
use rayon::prelude::*;

use crate::camera::{Camera, Film};
use crate::prepared::{PreparedScene, SurfaceHit};
use crate::sampler::Sampler;
use crate::stop::Halt;

/// Side of the squares of pixels whose rays go together, and pixels of one.
const SQUARE: usize = 4;
const N_PIXELS: usize = SQUARE * SQUARE;
/// What a surface shows that is seen edge on, of what it shows from the front.
const EDGE: f32 = 0.3;
/// How much a surface that looks up is brighter than one that looks down.
const FROM_ABOVE: f32 = 0.12;
/// What lies beyond all surfaces.
const BEYOND: Vec3 = Vec3::new(0.05, 0.055, 0.065);
/// Surfaces that shine, whatever their color.
const SHINING: Vec3 = Vec3::new(1.0, 0.96, 0.88);

/// Colors of a film between 0 and 1, linear Rec. 709, row-major; `None` when `stop` asked to.
pub fn draft(
    scene: &PreparedScene,
    camera: &Camera,
    film: Film,
    stop: &(dyn Fn() -> bool + Sync),
) -> Option<Vec<[f32; 3]>> {
    let halt = Halt::new(stop);
    let mut pixels = vec![[0.0; 3]; film.n_pixels()];
    let width = film.width as usize;
    pixels.par_chunks_mut(SQUARE * width).enumerate().for_each(|(band, rows)| {
        if halt.is_called() {
            return;
        }
        for left in (0..width).step_by(SQUARE) {
            draw_square(scene, (camera, film), [left, band * SQUARE], rows);
        }
    });
    (!halt.was_called()).then_some(pixels)
}

/// Colors the square of pixels with this corner; `rows` are those of the film from there on.
fn draw_square(scene: &PreparedScene, (camera, film): (&Camera, Film), [left, top]: [usize; 2], rows: &mut [[f32; 3]]) {
    let width = film.width as usize;
    let (mut places, mut directions, mut n) = ([0; N_PIXELS], [Vec3::ZERO; N_PIXELS], 0);
    for y in 0..rows.len() / width {
        for x in left..(left + SQUARE).min(width) {
            places[n] = y * width + x;
            directions[n] = camera.direction(film, Vec2::new(x as f32 + 0.5, (top + y) as f32 + 0.5));
            n += 1;
        }
    }
    // Surfaces with alpha are there by chance, the same one for all pixels, so that nothing flickers.
    let mut samplers = [Sampler::new(0, 0, 0); N_PIXELS];
    let hits = scene.closest_seen16(camera.position(), &directions, &mut samplers[..n]);
    for i in 0..n {
        rows[places[i]] = hits[i].map_or(BEYOND, |hit| color(scene, &hit, directions[i])).to_array();
    }
}

fn color(scene: &PreparedScene, hit: &SurfaceHit, direction: Vec3) -> Vec3 {
    if scene.emitted(hit, -direction).is_some_and(|(_, radiance)| radiance.max_element() > 0.0) {
        return SHINING;
    }
    let normal = scene.smooth_normal(hit, direction);
    let facing = normal.dot(-direction).clamp(0.0, 1.0);
    let shade = EDGE + (1.0 - EDGE - FROM_ABOVE) * facing + FROM_ABOVE * (0.5 + 0.5 * normal.y);
    (scene.base_color(hit) * shade).clamp(Vec3::ZERO, Vec3::ONE)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bvh::Ray;
    use crate::import;

    #[test]
    fn a_draft_shows_walls_and_stops_when_asked() {
        let bytes = include_bytes!("../../editor/tests/room.gltf");
        let scene = import::load_bytes("room.gltf", bytes).unwrap().scene;
        let scene = PreparedScene::new(scene, &[]).unwrap().0;
        let (camera, film) = (scene.scene.cameras[0].clone(), Film { width: 16, height: 12 });
        let pixels = draft(&scene, &camera, film, &|| false).unwrap();
        assert!(pixels.iter().all(|rgb| Vec3::from(*rgb) != BEYOND && Vec3::from(*rgb).max_element() > 0.05));
        assert!(draft(&scene, &camera, film, &|| true).is_none());
        // Pixels that are looked at together show what each shows alone, also where a square is not full.
        let film = Film { width: 15, height: 11 };
        for (index, rgb) in draft(&scene, &camera, film, &|| false).unwrap().into_iter().enumerate() {
            let film_px = Vec2::new((index % 15) as f32 + 0.5, (index / 15) as f32 + 0.5);
            let (origin, direction) = (camera.position(), camera.direction(film, film_px));
            let ray = Ray { origin, direction, t_min: 0.0, t_max: f32::INFINITY };
            let hit = scene.closest_seen(&ray, &mut Sampler::new(0, 0, 0));
            let alone = hit.map_or(BEYOND, |hit| color(&scene, &hit, direction));
            assert_eq!(Vec3::from(rgb), alone, "pixel {index}");
        }
        // From outside, looking away, there is nothing.
        let away = Camera::look_at("away", Vec3::new(0.0, 50.0, 0.0), Vec3::new(0.0, 100.0, 0.0), 1.0, 1.0);
        let pixels = draft(&scene, &away, film, &|| false).unwrap();
        assert!(pixels.iter().all(|rgb| Vec3::from(*rgb) == BEYOND));
    }
}
