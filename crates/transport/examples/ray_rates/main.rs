//! Rates of our rays against those of obvhs' CWBVH, built by its slowest preset as it comes: the same triangles, the same
//! rays, in one process, in turn, on one thread. Prints a JSON array with one object per scene.
//!
//! `cargo run --release -p clerestory-transport --example ray_rates -- [--rays N] [--hall TRIANGLES] [SCENE.glb]…`

mod clock;
mod exact;
mod hall;
mod rays;
mod trees;

use std::path::PathBuf;
use std::process::ExitCode;

use clerestory_transport::camera::Camera;
use clerestory_transport::import;
use glam::Vec3;
use serde_json::{Value, json};

use clock::cpu_secs;
use rays::{Question, Rays};
use trees::{Ours, Theirs};

/// Passes over the rays of one kind by each tree; the fastest counts.
const PASSES: u32 = 4;

struct Asked {
    n_rays: usize,
    hall: Option<usize>,
    scenes: Vec<PathBuf>,
}

#[expect(clippy::print_stdout, clippy::print_stderr, reason = "this program speaks to people and programs")]
fn main() -> ExitCode {
    // One thread for everything, builders included, so that one clock knows all that was spent.
    let on_one_thread = || rayon::ThreadPoolBuilder::new().num_threads(1).build().map_err(|error| error.to_string());
    let found = asked(std::env::args().skip(1))
        .and_then(|asked| on_one_thread()?.install(|| scenes(&asked)))
        .map(|scenes| println!("{}", Value::Array(scenes)));
    match found {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("ray_rates: {error}");
            ExitCode::FAILURE
        }
    }
}

fn asked(mut args: impl Iterator<Item = String>) -> Result<Asked, String> {
    let mut asked = Asked { n_rays: 1_000_000, hall: None, scenes: Vec::new() };
    while let Some(arg) = args.next() {
        let mut number = || args.next().and_then(|n| n.parse().ok()).filter(|n| (1..=100_000_000).contains(n));
        match arg.as_str() {
            "--rays" => asked.n_rays = number().ok_or("--rays needs a number from 1 to 100000000")?,
            "--hall" => asked.hall = Some(number().ok_or("--hall needs a number from 1 to 100000000")?),
            _ => asked.scenes.push(arg.into()),
        }
    }
    Ok(asked)
}

fn scenes(asked: &Asked) -> Result<Vec<Value>, String> {
    let mut found = Vec::new();
    for path in &asked.scenes {
        let scene = import::load(path).map_err(|error| format!("{}: {error}", path.display()))?.scene;
        let triangles: Vec<_> = (0..scene.mesh.triangles.len() as u32).map(|t| scene.mesh.corners(t)).collect();
        let camera = scene.cameras.first().ok_or_else(|| format!("{}: it has no camera", path.display()))?;
        found.push(measure(&scene.name, &triangles, camera, asked.n_rays));
    }
    if let Some(n_triangles) = asked.hall {
        found.push(measure("generated hall", &hall::triangles(n_triangles), &hall::camera(), asked.n_rays));
    }
    Ok(found)
}

fn measure(name: &str, triangles: &[[Vec3; 3]], camera: &Camera, n_rays: usize) -> Value {
    let (build_ours, ours) = cpu_secs(|| Ours::build(triangles));
    let (build_theirs, theirs) = cpu_secs(|| Theirs::build(triangles));
    let rays = Rays::new(triangles, &ours, camera, n_rays);
    let compared = |(kind, question): (&str, Question)| {
        let settled = question.settled(&ours, &theirs, triangles);
        let mut told = compare(kind, &question, &ours, &theirs);
        told["differ"] = settled.n_differ.into();
        told["other_than_single"] = json!(question.n_other_than_single(&ours));
        told["wrong"] = json!({ "ours": settled.n_wrong[0], "theirs": settled.n_wrong[1] });
        told
    };
    let kinds: Vec<Value> = rays.kinds().map(compared).collect();
    json!({
        "scene": name, "triangles": triangles.len(),
        "build_secs": { "ours": build_ours, "theirs": build_theirs }, "kinds": kinds,
    })
}

/// Least seconds of a pass: few rays are asked again and again.
const LEAST_SECS: f64 = 0.1;

/// Seconds that a tree takes for all rays of a question.
fn secs(question: &Question, tree: &impl trees::Tree) -> f64 {
    let (mut total, mut n) = (0.0, 0.0);
    while total < LEAST_SECS {
        total += cpu_secs(|| question.ask(tree)).0;
        n += 1.0;
    }
    total / n
}

/// Rates in million rays per second of one thread, and the least and the greatest ratio of a pass.
fn compare(kind: &str, question: &Question, ours: &Ours, theirs: &Theirs) -> Value {
    let (mut best, mut ratios) = ([f64::INFINITY; 2], [f64::INFINITY, 0f64]);
    for _ in 0..PASSES {
        let pass = [secs(question, ours), secs(question, theirs)];
        best = [best[0].min(pass[0]), best[1].min(pass[1])];
        ratios = [ratios[0].min(pass[1] / pass[0]), ratios[1].max(pass[1] / pass[0])];
    }
    let rate = |secs: f64| question.n_rays() as f64 / secs / 1e6;
    json!({
        "kind": kind, "rays": question.n_rays(), "ours": rate(best[0]), "theirs": rate(best[1]), "ratios": ratios,
    })
}
