//! A column of the matrix is the picture under its own light, and all columns together are the picture.

use std::sync::{Arc, LazyLock};

use clerestory_nystrom::{Half, SampledMatrix};
use glam::Vec3;

use super::pictures;
use super::stage::{Stage, lambert, quad, room};
use super::walks::{Mean, assert_same_mean, file_light};
use crate::bake::{Bake, BakeConfig};
use crate::camera::{Camera, Film};
use crate::matrix::{CHANNELS, TransportMatrix, peak};
use crate::plan::{Density, MatrixPlan};
use crate::prepared::PreparedScene;
use crate::scene::Material;

const FILM: Film = Film { width: 64, height: 48 };
const TILE: usize = crate::bake::SIDE as usize;
/// What ranks may leave out of a column's mean at 60 dB.
const TRUNCATED: f64 = 2e-3;
/// Largest standard error of a difference of means, relative to the mean: four of them, 1 %, are what a test accepts.
const SHARP: f64 = 2.5e-3;
/// Texels along a side of the panel.
const TEXELS: usize = 4;
/// Corner and sides of the panel: u × v points down.
const PANEL: [Vec3; 3] = [Vec3::new(-0.5, 0.98, -0.5), Vec3::new(0.9, 0.0, 0.0), Vec3::new(0.0, 0.0, 0.9)];
/// Its radiance in the file.
const PANEL_NIT: f32 = 3.0;

/// A room with a shelf, without lights.
fn dark_room() -> Stage {
    let camera = Camera::look_at("door", Vec3::new(0.2, 0.1, 0.9), Vec3::new(0.0, -0.3, -1.0), 1.1, 4.0 / 3.0);
    Stage::new(camera).surface("walls", &room(Vec3::ONE), lambert(0.3, 0.0)).surface(
        "shelf",
        &quad(Vec3::new(0.1, -0.4, -0.9), Vec3::Z * 0.6, Vec3::X * 0.8),
        lambert(0.4, 0.0),
    )
}

fn with_lamp(stage: Stage) -> Stage {
    stage.lamp("lamp", Vec3::new(-0.6, 0.2, -0.1), 0.5)
}

/// The room lit by a panel of sixteen texels and a lamp; the first column is the lamp's.
fn lit_room() -> Arc<PreparedScene> {
    let [corner, u, v] = PANEL;
    let stage = dark_room().panel("panel", &quad(corner, u, v), PANEL_NIT, TEXELS as u32);
    Arc::new(with_lamp(stage).prepared())
}

/// The room with nothing that shines but one light of it, as its column tells: the lamp, or a texel, which is a surface of its own.
fn lit_by_one(column: usize) -> PreparedScene {
    let [corner, u, v] = PANEL;
    let Some(texel) = column.checked_sub(1) else {
        return with_lamp(dark_room().surface("panel", &quad(corner, u, v), lambert(0.0, 0.0))).prepared();
    };
    let [u, v] = [u, v].map(|side| side / TEXELS as f32);
    let square = |nth: usize| quad(corner + u * (nth % TEXELS) as f32 + v * (nth / TEXELS) as f32, u, v);
    let others: Vec<Vec3> = (0..TEXELS * TEXELS).filter(|nth| *nth != texel).flat_map(square).collect();
    let stage = dark_room().surface("others", &others, lambert(0.0, 0.0));
    stage.surface("texel", &square(texel), lambert(0.0, PANEL_NIT)).prepared()
}

/// The picture under one weight per column by path tracing, green radiance.
fn traced(scene: &PreparedScene, weights: &[f32], (spp, seed): (u32, u64)) -> Vec<f64> {
    let coefficients: Vec<[f32; 3]> = weights.iter().map(|&w| [w; 3]).collect();
    pictures::traced(scene, FILM, &coefficients, (spp, seed))
}

/// The picture of one light as a column has it, of strength 1, traced where there is no other one.
fn traced_alone(column: usize, (spp, seed): (u32, u64)) -> Vec<f64> {
    traced(&lit_by_one(column), &[1.0], (spp, seed))
}

/// The same out of the factors of a bake.
fn relit(bake: &Bake, weights: &[f32]) -> Vec<f64> {
    let scaled: Vec<f32> =
        weights.iter().zip(&bake.header.column_scale).map(|(weight, scale)| weight / scale).collect();
    let mut pixels = vec![0.0; FILM.n_pixels()];
    for (group, columns) in bake.groups.iter().zip(&bake.header.basis.groups) {
        let rows = group.apply(&scaled[columns.columns.start as usize..columns.columns.end as usize]);
        for (pixel, rows) in pixels.iter_mut().zip(rows.chunks_exact(CHANNELS)) {
            *pixel += f64::from(rows[1]);
        }
    }
    pixels
}

fn baked(scene: &Arc<PreparedScene>, spp: u32) -> Bake {
    let config = BakeConfig { spp, tolerance_db: 60.0, bounces: None, seed: 5, ..BakeConfig::default() };
    pictures::baked(scene, FILM, config)
}

/// The lit room, baked finely, made once for all laws.
fn finely_baked() -> &'static Bake {
    static BAKED: LazyLock<Bake> = LazyLock::new(|| baked(&lit_room(), 96));
    &BAKED
}

/// Means over the blocks of a bake: what pixels of a block share, blocks do not.
fn block_means(pixels: &[f64]) -> Vec<f64> {
    let width = FILM.width as usize;
    let mut means = vec![0.0; pixels.len() / (TILE * TILE)];
    for (index, value) in pixels.iter().enumerate() {
        let (x, y) = (index % width / TILE, index / width / TILE);
        means[y * (width / TILE) + x] += value / (TILE * TILE) as f64;
    }
    means
}

fn only(column: usize, n_cols: usize) -> Vec<f32> {
    (0..n_cols).map(|c| f32::from(c == column)).collect()
}

/// A floor under a shining quad that the camera sees as well.
fn under_a_glow(color: Vec3, texels: Option<u32>) -> PreparedScene {
    let camera = Camera::look_at("side", Vec3::new(0.0, 0.5, 3.0), Vec3::NEG_Z, 0.8, 4.0 / 3.0);
    let glow = Material { emissive: color, ..lambert(0.0, 5.0) };
    let floor = quad(Vec3::new(-1.0, 0.0, 1.0), Vec3::X * 2.0, Vec3::NEG_Z * 2.0);
    let stage = Stage::new(camera).surface("floor", &floor, lambert(0.8, 0.0));
    stage.surface("glow", &quad(Vec3::new(-0.5, 1.0, -0.5), Vec3::X, Vec3::Z), glow).with_panel(texels).prepared()
}

#[test]
fn a_light_that_is_red_in_the_file_has_the_columns_of_a_white_one() {
    for texels in [None, Some(4)] {
        let [red, white] = [Vec3::X, Vec3::ONE].map(|color| {
            let scene = under_a_glow(color, texels);
            traced(&scene, &vec![1.0; scene.lighting.basis.n_cols()], (32, 3))
        });
        assert!(white.iter().any(|green| *green > 0.0), "the camera sees no light");
        assert!(red == white, "green is missing from the columns of a red light, {texels:?}");
    }
}

#[test]
fn a_baked_column_is_the_picture_of_its_texel_alone() {
    let bake = finely_baked();
    let n_cols = bake.header.basis.n_cols();
    for column in [0, 7, n_cols - 1] {
        let expected = block_means(&traced_alone(column, (64, 100 + column as u64)));
        let found = block_means(&relit(bake, &only(column, n_cols)));
        let differences: Vec<f64> = found.iter().zip(&expected).map(|(a, b)| a - b).collect();
        let (off, scale) = (Mean::of(&differences), Mean::of(&expected).value);
        let [share, error] = [off.value, off.error].map(|value| 100.0 * value / scale);
        let told = format!("column {column}: off by {share:+.3} % ± {error:.3} % of {scale:.5}");
        println!("{told}");
        assert!(4.0 * off.error + TRUNCATED * scale < 1e-2 * scale, "{told}, too blurred");
        assert!(off.value.abs() < 4.0 * off.error + TRUNCATED * scale, "{told}");
    }
}

#[test]
fn pictures_of_each_light_alone_add_up_to_the_picture() {
    let scene = lit_room();
    let weights = file_light(&scene);
    let mut sum = vec![0.0; FILM.n_pixels()];
    for (column, &weight) in weights.iter().enumerate() {
        // The lamp has about half of the light, each texel a thirtieth.
        let spp = if column == 0 { 64 } else { 8 };
        let alone = traced_alone(column, (spp, 300 + column as u64));
        sum.iter_mut().zip(alone).for_each(|(sum, alone)| *sum += alone * f64::from(weight));
    }
    let together = traced(&scene, &weights, (64, 9));
    assert_same_mean(&together, &sum, SHARP, "all lights traced");
    // The bake keeps the picture of the file as it was sampled, so truncation counts nothing here. By blocks: pixels of one share walks.
    let bake = relit(finely_baked(), &weights);
    assert_same_mean(&block_means(&bake), &block_means(&sum), SHARP, "all columns of a bake");
}

#[test]
fn ranks_are_told_of_whole_blocks() {
    let bake = baked(&lit_room(), 4);
    let n_blocks = bake.groups[0].blocks.len();
    let rank = |block: usize| bake.groups.iter().flat_map(|group| &group.blocks[block]).map(|b| b.rank).sum();
    let ranks: Vec<u32> = (0..n_blocks).map(rank).collect();
    let figures = bake.figures();
    assert_eq!(Some(figures.max_rank), ranks.iter().copied().max());
    assert!((figures.mean_rank - ranks.iter().sum::<u32>() as f32 / n_blocks as f32).abs() < 1e-3, "{figures:?}");
    assert!(bake.groups.len() > 1 && bake.groups.iter().all(|group| group.max_rank() < figures.max_rank));
}

#[test]
fn a_sampled_column_is_the_picture_of_its_texel_alone() {
    let scene = lit_room();
    let n_cols = scene.lighting.basis.n_cols();
    let plan = MatrixPlan::new(&scene.lighting, Density::Full);
    let matrix = TransportMatrix::new(&scene, &plan, scene.scene.cameras[0].clone(), FILM, None, 21);
    let pixels: Vec<u32> = (0..FILM.n_pixels() as u32).collect();
    let (mut rows, mut sparse, n_samples) = (vec![0.0; matrix.n_rows() * n_cols], Vec::new(), 48);
    matrix.add_rows(&pixels, 0..n_samples, Half::A, &mut rows, &mut sparse);
    for entry in sparse {
        rows[entry.row as usize * n_cols + entry.col as usize] += entry.value;
    }
    for column in [0, 1, n_cols - 1] {
        let green = |pixel: usize| f64::from(rows[(pixel * CHANNELS + 1) * n_cols + column]) / f64::from(n_samples);
        let sampled: Vec<f64> = (0..FILM.n_pixels()).map(green).collect();
        let expected = traced_alone(column, (96, 200 + column as u64));
        // By blocks: neighboring pixels share walks.
        let [sampled, expected] = [sampled, expected].map(|pixels| block_means(&pixels));
        assert_same_mean(&sampled, &expected, SHARP, &format!("column {column}"));
    }
}

/// The error of a column in dB below its peak, beside two bakes that are independent of it and of each other.
fn error_db(bake: &Bake, [a, b]: [&Bake; 2], column: usize) -> f64 {
    let weights = only(column, bake.header.basis.n_cols());
    let [x, a, b] = [bake, a, b].map(|bake| relit(bake, &weights));
    let square = x.iter().zip(a.iter().zip(&b)).map(|(x, (a, b))| (x - a) * (x - b)).sum::<f64>() / x.len() as f64;
    let mut bright: Vec<f32> = a.iter().zip(&b).map(|(a, b)| 0.5 * (a + b) as f32).collect();
    10.0 * (f64::from(peak(&mut bright, 0.0)).powi(2) / square).log10()
}

#[test]
fn a_lamp_whose_light_comes_by_rare_walks_is_named_with_its_error() {
    let camera = Camera::look_at("door", Vec3::new(0.2, 0.1, 0.9), Vec3::new(0.0, -0.3, -1.0), 1.1, 4.0 / 3.0);
    // Between a wall and a plate, so that next to nothing but its light on the wall gets out.
    let plate = quad(Vec3::new(-0.25, -0.25, -0.96), Vec3::X * 0.5, Vec3::Y * 0.5);
    let scene = Stage::new(camera)
        .surface("walls", &room(Vec3::ONE), lambert(0.6, 0.0))
        .surface("plate", &plate, lambert(0.6, 0.0))
        .lamp("left", Vec3::new(-0.6, 0.2, -0.1), 0.5)
        .lamp("right", Vec3::new(0.6, 0.3, 0.1), 0.5)
        .lamp("hidden", Vec3::new(0.0, 0.0, -0.98), 0.5)
        .prepared();
    let scene = Arc::new(scene);
    let with = |seed: u64, spp: u32| {
        let config = BakeConfig { spp, tolerance_db: 50.0, bounces: None, seed, ..BakeConfig::default() };
        pictures::baked(&scene, FILM, config)
    };
    let (bake, a, b) = (with(5, 16), with(6, 128), with(7, 128));
    let told = bake.figures().column_error_db.expect("the halves tell");
    assert!(told.worst[0].light == "hidden" && told.worst[0].db < told.median - 3.0, "{told:?}");
    for light in &told.worst {
        let column = bake.header.basis.source(&light.light).unwrap().columns.start as usize;
        let found = error_db(&bake, [&a, &b], column);
        // What is told of the other two may suffer from what it cost to find the first.
        let most = if light.light == "hidden" { 5.0 } else { 9.0 };
        let better = f64::from(light.db) - found;
        assert!(-most < better && better < 5.0, "{light:?} told, {found} found");
    }
}

/// A night lamp beside the sun: muted lights leave neither darkness nor their own light.
#[test]
fn a_lamp_far_dimmer_than_the_other_one_is_itself_alone() {
    let camera = Camera::look_at("door", Vec3::new(0.2, 0.1, 0.9), Vec3::new(0.0, -0.3, -1.0), 1.1, 4.0 / 3.0);
    let stage = Stage::new(camera).surface("walls", &room(Vec3::ONE), lambert(0.6, 0.0));
    let stage = stage.lamp("bright", Vec3::new(-0.6, 0.2, -0.1), 5e4).lamp("dim", Vec3::new(0.5, 0.3, -0.2), 0.5);
    let scene = Arc::new(stage.prepared());
    let config = BakeConfig { spp: 32, tolerance_db: 35.0, seed: 6, ..BakeConfig::default() };
    let bake = pictures::baked(&scene, FILM, config);
    assert!(bake.groups[0].blocks.iter().flatten().all(|block| block.rank == 2), "each lamp is there by itself");
    let dim = only(1, 2);
    let (got, want) = (block_means(&relit(&bake, &dim)), block_means(&traced(&scene, &dim, (32, 3))));
    for (block, (got, want)) in got.iter().zip(&want).enumerate() {
        assert!((got / want - 1.0).abs() < 0.1, "block {block}: {got}, {want} is traced");
    }
}
