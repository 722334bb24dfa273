//! How a bake scales over threads, beside a bare loop over rays in the same run.

use std::ops::ControlFlow;
use std::sync::Arc;
use std::time::Instant;

use anyhow::{Context, Result};
use clerestory_transport::bvh::Ray;
use clerestory_transport::camera::Film;
use clerestory_transport::prepared::PreparedScene;
use clerestory_transport::sampler::Sampler;
use glam::{Vec2, Vec3};
use rayon::prelude::*;

use super::{Bench, job, room};
use crate::desk::Desk;
use crate::fit::spread_words;
use crate::lamps::tables::Goal;

/// Times that each number of threads is measured, in turn; the shortest counts.
const TURNS: usize = 3;
/// Rays of a pass of the bare loop.
const N_RAYS: usize = 200_000;
/// What is aimed at.
const AIM: f64 = 0.95;

/// A table over powers of two, up to the threads there are, as a part of a section.
///
/// # Errors
/// If a bake fails or threads cannot be had.
pub fn write(desk: &Desk, section: &str) -> Result<String> {
    let available = std::thread::available_parallelism().map_or(1, usize::from);
    let mut counts: Vec<usize> =
        std::iter::successors(Some(1), |n| Some(2 * n)).take_while(|n| *n < available).collect();
    counts.push(available);
    let measured: Vec<Vec<[f64; 2]>> = desk.part(section, "threads", || measured(desk, &counts))?;
    let best = |nth: usize, which: usize| measured[nth].iter().map(|secs| secs[which]).fold(f64::INFINITY, f64::min);
    let mut rows = String::new();
    for (nth, n) in counts.iter().enumerate() {
        let [bake, rays] = [0, 1].map(|which| best(0, which) / best(nth, which));
        let secs = |which: usize| spread_words(measured[nth].iter().map(|secs| secs[which]).collect());
        let share = bake / rays;
        let word = if nth == 0 { String::new() } else { format!(", {}", Goal::Least(AIM).word(share)) };
        rows +=
            &format!("| {n} | {} | {} | {bake:.2}× | {rays:.2}× | {:.0} %{word} |\n", secs(0), secs(1), 100.0 * share);
    }
    Ok(format!(
        "\n### Threads\n\n\
         A bake of the hall, and a bare loop over {N_RAYS} rays that scatter from what the camera sees, in turn: seconds by the clock, median (least…greatest) of\n\
         {TURNS}; how much sooner the best of them ended than on one thread; and how much of the loop's gain the bake has (aimed at: {:.0} %). {}\n\n\
         | threads | bake, s | rays, s | bake sooner | rays sooner | bake / rays |\n|---|---|---|---|---|---|\n{rows}",
        100.0 * AIM,
        desk.load_words(),
    ))
}

/// Seconds of a bake and of the loop, by number of threads and turn.
fn measured(desk: &Desk, counts: &[usize]) -> Result<Vec<Vec<[f64; 2]>>> {
    let film = desk.choose(Film { width: 96, height: 72 }, Film { width: 320, height: 240 });
    let bench = Bench { triangles: 100_000, side: 8, size: [film.width, film.height], spp: 8, bounces: None };
    let scene = room::prepared(bench.triangles, bench.side)?;
    let rays = scattered(&scene, film);
    let passes = desk.choose(4, 40);
    let mut secs = vec![Vec::new(); counts.len()];
    for turn in 0..TURNS {
        for (secs, &n) in secs.iter_mut().zip(counts) {
            desk.say(&format!("baking on {n} threads, turn {}", turn + 1));
            let pool = rayon::ThreadPoolBuilder::new().num_threads(n).build()?;
            let begun = Instant::now();
            let bake = pool.install(|| job(&scene, bench).run(|_| ControlFlow::Continue(())))?;
            bake.context("nobody stops a bake of the report")?;
            let baked = begun.elapsed().as_secs_f64();
            let begun = Instant::now();
            pool.install(|| (0..passes).for_each(|_| ask(&scene, &rays)));
            secs.push([baked, begun.elapsed().as_secs_f64()]);
        }
    }
    Ok(secs)
}

fn ask(scene: &PreparedScene, rays: &[Ray]) {
    let met = |ray: &Ray| scene.closest(ray, &mut Sampler::new(1, 1, 1)).is_some();
    std::hint::black_box(rays.par_iter().with_min_len(1024).filter(|ray| met(ray)).count());
}

/// Rays from what the camera sees into all directions above it.
fn scattered(scene: &Arc<PreparedScene>, film: Film) -> Vec<Ray> {
    let camera = &scene.scene.cameras[0];
    let ray = |origin: Vec3, direction: Vec3| Ray { origin, direction, t_min: 0.0, t_max: f32::INFINITY };
    let scatter = |nth: usize| {
        // Multiples of the roots of the plastic number fill squares evenly.
        let share = |step: f64| (nth as f64 * step).fract() as f32;
        let [a, b, c, d] = [0.754_877_666, 0.569_840_291, 0.618_033_989, 0.414_213_562].map(share);
        let film_px = Vec2::new(a * film.width as f32, b * film.height as f32);
        let first = ray(camera.position(), camera.direction(film, film_px));
        let hit = scene.closest(&first, &mut Sampler::new(1, 1, 1))?;
        let normal = if hit.normal.dot(first.direction) > 0.0 { -hit.normal } else { hit.normal };
        let (z, (sin, cos)) = (1.0 - 2.0 * c, (std::f32::consts::TAU * d).sin_cos());
        let aside = Vec3::new((1.0 - z * z).sqrt() * cos, (1.0 - z * z).sqrt() * sin, z);
        Some(ray(hit.origin(normal), (aside + normal).normalize_or(normal)))
    };
    (0..N_RAYS).filter_map(scatter).collect()
}
