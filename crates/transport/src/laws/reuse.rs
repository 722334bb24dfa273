//! Pixels that share their walks have the means of pixels that do not.

use clerestory_nystrom::{Half, SampledMatrix};
use glam::{Vec3, Vec4};

use super::stage::{Stage, lambert, pane, quad, room, tint};
use super::walks::{Mean, Walks, assert_same_mean, file_light};
use crate::camera::{Camera, Film};
use crate::matrix::{CHANNELS, TransportMatrix};
use crate::plan::{Density, MatrixPlan};
use crate::prepared::PreparedScene;
use crate::scene::{AlphaMode, Material};

const FILM: Film = Film { width: 16, height: 12 };

/// What walls are like.
#[derive(Clone, Copy, Debug)]
enum Finish {
    Matte,
    /// Glossy, and lacquered like a mirror.
    Coated,
}

/// A room seen past a block that hides parts of it from other parts, with a pane, a sheet that is half there, a mirror and
/// a coated plate; its walls have a finish.
fn room_with_a_block(finish: Finish) -> PreparedScene {
    let camera = Camera::look_at("eye", Vec3::new(1.7, 0.3, 1.2), Vec3::new(-1.5, -0.4, -0.8), 1.2, 4.0 / 3.0);
    let block =
        room(Vec3::new(0.25, 0.5, 0.2)).iter().map(|corner| *corner + Vec3::new(-0.2, -0.7, 0.2)).collect::<Vec<_>>();
    let sheet = Material { base_color: Vec4::new(0.7, 0.7, 0.7, 0.5), alpha: AlphaMode::Blend, ..lambert(0.7, 0.0) };
    let coated = Material { specular: 1.0, roughness: 0.4, ..lambert(0.5, 0.0) };
    let mirror = Material { roughness: 0.0, ..Material::default() };
    let [walls, sides] = [(0.6, 0.3), (0.8, 0.0)].map(|(albedo, roughness)| match finish {
        Finish::Matte => lambert(albedo, 0.0),
        Finish::Coated => Material { specular: 1.0, roughness, ..lambert(albedo, 0.0) },
    });
    Stage::new(camera)
        .surface("walls", &room(Vec3::new(2.0, 1.2, 1.5)), walls)
        .surface("block", &block, sides)
        .surface("pane", &quad(Vec3::new(-1.2, -1.1, -1.1), Vec3::Y * 1.2, Vec3::Z * 1.4), pane())
        .surface("sheet", &quad(Vec3::new(0.3, -0.9, -1.2), Vec3::X * 0.9, Vec3::Y * 0.9), sheet)
        .surface("coated", &quad(Vec3::new(-0.8, -1.15, -1.3), Vec3::Z * 0.9, Vec3::X * 1.6), coated)
        .surface("mirror", &quad(Vec3::new(-1.0, -0.3, -1.49), Vec3::X * 1.2, Vec3::Y * 0.8), mirror)
        .panel("panel", &quad(Vec3::new(-0.6, 1.1, -0.6), Vec3::X * 1.2, Vec3::Z * 1.2), 3.0, 4)
        .surface("light", &quad(Vec3::new(-1.9, -0.9, 0.9), Vec3::Y * 0.4, Vec3::Z * 0.4), lambert(0.0, 9.0))
        .prepared()
}

/// Green radiance of each pixel under the light of the file, all pixels sampled together: pixel by pixel, seed by seed.
fn together(scene: &PreparedScene, seeds: u64, bounces: Option<u32>) -> Vec<Vec<f64>> {
    let (plan, weights) = (MatrixPlan::new(&scene.lighting, Density::Full), file_light(scene));
    let pixels: Vec<u32> = (0..FILM.n_pixels() as u32).collect();
    let n_cols = weights.len();
    let mut found = vec![Vec::new(); pixels.len()];
    for seed in 0..seeds {
        let camera = scene.scene.cameras[0].clone();
        let matrix = TransportMatrix::new(scene, &plan, camera, FILM, bounces, 1000 + seed);
        let (mut rows, mut sparse) = (vec![0.0; matrix.n_rows() * n_cols], Vec::new());
        matrix.add_rows(&pixels, 0..1, Half::A, &mut rows, &mut sparse);
        for entry in sparse {
            rows[entry.row as usize * n_cols + entry.col as usize] += entry.value;
        }
        for (found, rows) in found.iter_mut().zip(rows.chunks_exact(CHANNELS * n_cols)) {
            let green = rows[n_cols..2 * n_cols].iter().zip(&weights).map(|(x, w)| f64::from(x * w)).sum();
            found.push(green);
        }
    }
    found
}

#[test]
fn pixels_that_share_walks_have_the_mean_of_their_own_walks() {
    for (finish, bounces) in
        [(Finish::Matte, Some(3)), (Finish::Matte, None), (Finish::Coated, Some(3)), (Finish::Coated, None)]
    {
        let scene = room_with_a_block(finish);
        let (plan, weights) = (MatrixPlan::new(&scene.lighting, Density::Full), file_light(&scene));
        let shared = together(&scene, 1200, bounces);
        let per_pixel = 600;
        let walks = Walks { film: FILM, streams: per_pixel * FILM.n_pixels() as u64, spp: 2, bounces, seed: 5 };
        let alone = walks.streams(&scene, &plan, &weights);
        let mut squares = 0.0;
        for (pixel, shared) in shared.iter().enumerate() {
            let alone: Vec<f64> = alone.iter().skip(pixel).step_by(FILM.n_pixels()).copied().collect();
            let (a, b) = (Mean::of(shared), Mean::of(&alone));
            let z = (a.value - b.value) / a.error.hypot(b.error).max(1e-6 * b.value.abs()).max(f64::MIN_POSITIVE);
            assert!(z.abs() < 5.5, "{finish:?}, pixel {pixel} with {bounces:?} bounces: {a:?} is not {b:?}");
            squares += z * z / FILM.n_pixels() as f64;
        }
        assert!(
            squares < 1.5,
            "{finish:?}: the pixels are off by {squares} variances in the mean, with {bounces:?} bounces"
        );
        // By seeds, since pixels of a tile are not independent of each other.
        let sums: Vec<f64> = (0..shared[0].len()).map(|seed| shared.iter().map(|pixel| pixel[seed]).sum()).collect();
        let own: Vec<f64> = alone.chunks_exact(FILM.n_pixels()).map(|pixels| pixels.iter().sum()).collect();
        let pairs: Vec<f64> = sums.chunks_exact(2).map(|pair| 0.5 * (pair[0] + pair[1])).collect();
        assert_same_mean(&pairs, &own, 8e-3, "the whole picture");
    }
}

#[test]
fn without_bounces_no_pixel_shares_what_a_pane_scatters() {
    // The pane beside the floor lets a part of the light pass, and most of the rest leaves it by a diffuse base.
    let camera = Camera::look_at("eye", Vec3::new(0.0, 1.5, 0.3), Vec3::new(0.0, 0.0, -0.2), 0.5, 4.0 / 3.0);
    let milky = Material { base_color: Vec4::ONE, transmission: 0.4, ..pane() };
    let scene = Stage::new(camera)
        .surface("floor", &quad(Vec3::new(-1.5, 0.0, 1.5), Vec3::X * 3.0, Vec3::NEG_Z * 3.0), lambert(0.6, 0.0))
        .surface("pane", &quad(Vec3::new(-1.5, 0.0, -0.8), Vec3::X * 3.0, Vec3::Y * 1.5), milky)
        .panel("panel", &quad(Vec3::new(-0.6, 1.8, -0.6), Vec3::X * 1.2, Vec3::Z * 1.2), 3.0, 4)
        .prepared();
    let shared = together(&scene, 4, Some(0));
    assert!(shared.iter().flatten().all(|&value| value > 0.0), "the panel lights all of the floor");
    assert!(shared == together(&scene.with_lone_coats(), 4, Some(0)), "light of a pane came by a bounce more");
}

#[test]
fn a_film_that_takes_no_light_changes_nothing_on_either_side() {
    // The film parts the room from floor to panel, and is seen edge on.
    let room_with = |film: Option<Material>| {
        let camera = Camera::look_at("eye", Vec3::new(-0.1, 0.2, 1.4), Vec3::new(1.4, -0.4, -1.5), 1.2, 4.0 / 3.0);
        let across = quad(Vec3::new(0.0, -1.19, -1.49), Vec3::Y * 2.28, Vec3::Z * 2.98);
        let panel = quad(Vec3::new(-0.6, 1.1, -0.6), Vec3::X * 1.2, Vec3::Z * 1.2);
        let stage = Stage::new(camera).surface("walls", &room(Vec3::new(2.0, 1.2, 1.5)), lambert(0.8, 0.0));
        let stage = stage.panel("panel", &panel, 3.0, 4);
        if let Some(film) = film { stage.surface("film", &across, film).prepared() } else { stage.prepared() }
    };
    let [bare, parted] = [None, Some(tint(1.0))].map(|film| together(&room_with(film), 1200, Some(3)));
    // Pixels of the same tiles, before the film and behind it.
    for columns in [0..3, 5..8] {
        let is_asked = |pixel: &usize| columns.contains(&(pixel % FILM.width as usize));
        let sums = |found: &[Vec<f64>]| -> Vec<f64> {
            let pixels: Vec<&Vec<f64>> = (0..found.len()).filter(is_asked).map(|pixel| &found[pixel]).collect();
            (0..1200).map(|seed| pixels.iter().map(|values| values[seed]).sum()).collect()
        };
        assert_same_mean(&sums(&parted), &sums(&bare), 1e-2, &format!("columns {columns:?}"));
    }
}
