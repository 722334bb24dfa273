//! A bake again after a light of the file has changed: with what an earlier bake has, and from nothing.

use std::ops::ControlFlow;
use std::sync::Arc;

use anyhow::{Context, Result};
use clerestory_transport::bake::focus::Focus;
use clerestory_transport::bake::{Bake, BakeConfig, BakeJob, Passes};
use clerestory_transport::camera::Film;
use clerestory_transport::import;
use clerestory_transport::prepared::PreparedScene;
use clerestory_transport::scene::Scene;
use glam::Vec3;

use super::{TOLERANCE_DB, pictures_words, psnr_db, seeds};
use crate::desk::Desk;
use crate::fit::cpu_words;
use crate::matrix::process_cpu_secs;
use crate::rendered::as_in_file;

type Change = fn(&mut Scene);

/// What may have happened to the first lamp of a file.
const CHANGES: [(&str, Change); 5] = [
    ("nothing changed", |_| {}),
    ("a lamp of other strength and color", |scene| {
        (scene.punctual[0].intensity, scene.punctual[0].color) = (900.0, Vec3::new(0.2, 0.6, 1.0));
    }),
    ("a lamp removed", |scene| {
        scene.punctual.remove(0);
    }),
    ("a lamp moved", |scene| scene.punctual[0].position.z += 0.5),
    ("a lamp added", |scene| {
        let mut lamp = scene.punctual[0].clone();
        let mut node = scene.nodes[lamp.node as usize].clone();
        node.name = Some("added".into());
        lamp.node = scene.nodes.len() as u32;
        lamp.position.z += 0.5;
        scene.nodes.push(node);
        scene.punctual.push(lamp);
    }),
];

/// A table of these changes.
///
/// # Errors
/// If the scene cannot be baked, or this system does not tell the CPU time of a process.
pub(super) fn table(desk: &Desk, name: &str, film: Film, spp: u32) -> Result<String> {
    let path = desk.root.join(format!("assets/scenes/{name}.glb"));
    let scene = import::load(&path).with_context(|| format!("cannot load {}", path.display()))?.scene;
    let job = |change: Change, seed: u64| -> Result<BakeJob> {
        let mut scene = scene.clone();
        change(&mut scene);
        let scene = Arc::new(PreparedScene::new(scene, &[])?.0);
        let config = BakeConfig { spp, tolerance_db: TOLERANCE_DB, seed, ..BakeConfig::default() };
        let camera = scene.scene.cameras[0].clone();
        Ok(BakeJob { scene, camera, film, config, passes: Passes::FinalOnly, irradiance: Vec::new() })
    };
    let mut runs: Vec<Run> = CHANGES.iter().map(|_| Run::default()).collect();
    for &seed in seeds(desk) {
        let earlier = from_nothing(job(|_| {}, seed)?)?.0;
        for ((what, change), run) in CHANGES.iter().zip(&mut runs) {
            desk.say(&format!("baking {name} again: {what}, seed {seed}"));
            let (full, full_secs) = from_nothing(job(*change, seed)?)?;
            let begun = process_cpu_secs()?;
            let job = job(*change, seed)?;
            let prepared = process_cpu_secs()?;
            let reuse = job.reuse(&earlier).context("only a lamp has changed")?;
            let traced = reuse.n_traced_columns();
            let again = job.run_reusing(&reuse, &Focus::default(), None, |_| ControlFlow::Continue(()))?;
            run.again_secs.push(process_cpu_secs()? - prepared);
            let again = again.context("nobody stops a bake of the report")?;
            run.full_secs.push(full_secs);
            run.prepare_secs.push(prepared - begun);
            run.dbs.push(psnr_db(&as_in_file(&again), &as_in_file(&full)));
            run.columns = format!("{traced} of {}", again.header.basis.n_cols());
        }
    }
    let rows: String = CHANGES.iter().zip(&runs).map(|((what, _), run)| run.row(what)).collect();
    Ok(format!(
        "\n### {name}, baked again\n\n\
         An earlier bake of the scene with the same seed is at hand, and one of its lamps has changed. Preparing the scene (its hierarchies) is done either way.\n\n\
         | what changed | columns traced | bake, CPU s | from nothing, CPU s | preparing, CPU s | picture dB against that from nothing |\n\
         |---|---|---|---|---|---|\n{rows}"
    ))
}

/// What a change took, with each seed.
#[derive(Default)]
struct Run {
    again_secs: Vec<f64>,
    full_secs: Vec<f64>,
    prepare_secs: Vec<f64>,
    /// See [`psnr_db`].
    dbs: Vec<Option<f64>>,
    /// Those that were traced, in words.
    columns: String,
}

impl Run {
    fn row(&self, what: &str) -> String {
        let [again, full, prepare] =
            [&self.again_secs, &self.full_secs, &self.prepare_secs].map(|secs| cpu_words(secs.clone()));
        format!("| {what} | {} | {again} | {full} | {prepare} | {} |\n", self.columns, pictures_words(&self.dbs))
    }
}

fn from_nothing(job: BakeJob) -> Result<(Bake, f64)> {
    let begun = process_cpu_secs()?;
    let bake = job.run(|_| ControlFlow::Continue(()))?.context("nobody stops a bake of the report")?;
    Ok((bake, process_cpu_secs()? - begun))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_row_tells_all_seeds_of_a_change() {
        let run = Run {
            again_secs: vec![0.01, 0.03, 0.02],
            full_secs: vec![20.0, 22.0, 21.0],
            prepare_secs: vec![0.25; 3],
            dbs: vec![None; 3],
            columns: "0 of 9".into(),
        };
        let told = "| a lamp | 0 of 9 | 0.02 (0.01…0.03) | 21 (20…22) | 0.25 (0.25…0.25) | the same |\n";
        assert_eq!(run.row("a lamp"), told);
    }
}
