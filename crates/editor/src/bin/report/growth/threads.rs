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
use crate::fit::{hundredths, median, spread_words};
use crate::goal::Goal;
use crate::hardware;

/// Times that each number of threads is measured, in turn: in a hurry or on a machine that is lent for minutes, and else.
const TURNS: [usize; 2] = [3, 7];
/// Rays of a pass of the bare loop.
const N_RAYS: usize = 200_000;
/// Samples per pixel of the bake.
const SPP: u32 = 8;
/// What is aimed at.
const AIM: f64 = 0.95;

/// A table over powers of two, up to the threads there are, as a part of a section.
///
/// # Errors
/// If a bake fails or threads cannot be had.
pub fn write(desk: &Desk, section: &str) -> Result<String> {
    // No heading stands twice on the page.
    let (turns, of) = match section {
        hardware::NAME => (TURNS[0], " of that machine"),
        _ => (desk.choose(TURNS[0], TURNS[1]), ""),
    };
    let film = film(desk);
    let available = std::thread::available_parallelism().map_or(1, usize::from);
    let mut counts: Vec<usize> =
        std::iter::successors(Some(1), |n| Some(2 * n)).take_while(|n| *n < available).collect();
    counts.push(available);
    let measured: Vec<Vec<[f64; 2]>> = desk.part(section, "threads", || measured(desk, &counts, turns))?;
    let rows: String = counts.iter().zip(&measured).map(|(n, many)| row(*n, &measured[0], many)).collect();
    Ok(format!(
        "\n### Threads{of}\n\n\
         A bake of the hall, {} × {} pixels of {SPP} samples, and a bare loop of {} passes over about {N_RAYS} rays that scatter from what the camera sees, seconds by the clock, all numbers of threads in turn, {turns} times. Of each turn:\n\
         how many times as fast it was as on one thread, and the bake's part of the loop's gain (aimed at: {AIM} in the median). Other work on the machine can make\n\
         a turn look better than threads can be. All are median (least…greatest). {}\n\n\
         | threads | bake, s | rays, s | bake, times as fast | rays, times as fast | bake / rays |\n|---|---|---|---|---|---|\n{rows}",
        film.width,
        film.height,
        passes(desk),
        desk.load_words(),
    ))
}

/// A number of threads beside one thread, given the seconds of the bake and of the loop of each turn.
fn row(n_threads: usize, alone: &[[f64; 2]], many: &[[f64; 2]]) -> String {
    let secs = |which: usize| spread_words(many.iter().map(|secs| secs[which]).collect());
    if n_threads == 1 {
        return format!("| 1 | {} | {} | 1 | 1 | 1 |\n", secs(0), secs(1));
    }
    let gains =
        |which: usize| -> Vec<f64> { alone.iter().zip(many).map(|(alone, many)| alone[which] / many[which]).collect() };
    let (bake, rays) = (gains(0), gains(1));
    let shares: Vec<f64> = bake.iter().zip(&rays).map(|(bake, rays)| bake / rays).collect();
    let word = median(&shares).map_or("not measured", |share| Goal::Least(AIM).word(share));
    format!(
        "| {n_threads} | {} | {} | {} | {} | {}, {word} |\n",
        secs(0),
        secs(1),
        hundredths(bake),
        hundredths(rays),
        hundredths(shares),
    )
}

/// Of the picture that is baked.
fn film(desk: &Desk) -> Film {
    desk.choose(Film { width: 64, height: 48 }, Film { width: 320, height: 240 })
}

/// Times that the loop goes over its rays.
fn passes(desk: &Desk) -> usize {
    desk.choose(4, 40)
}

/// Seconds of a bake and of the loop, by number of threads and turn.
fn measured(desk: &Desk, counts: &[usize], turns: usize) -> Result<Vec<Vec<[f64; 2]>>> {
    let film = film(desk);
    let bench = Bench {
        triangles: 100_000,
        side: 8,
        size: [film.width, film.height],
        spp: SPP,
        bounces: None,
        threads: None,
        seed: 1,
    };
    let scene = room::prepared(bench.triangles, bench.side)?;
    let rays = scattered(&scene, film);
    let passes = passes(desk);
    let mut secs = vec![Vec::new(); counts.len()];
    for turn in 0..turns {
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_turn_that_others_slowed_down_settles_nothing() {
        // In the last turn one thread was slowed down while it asked for rays, and two threads while they baked.
        let (alone, many) = ([[8.0, 2.0], [8.0, 2.0], [8.0, 3.0]], [[4.0, 1.0], [4.0, 1.0], [8.0, 1.0]]);
        let row = row(2, &alone, &many);
        assert!(row.contains("| 2.00 (1.00…2.00) | 2.00 (2.00…3.00) | 1.00 (0.33…1.00), kept |"), "{row}");
    }
}
