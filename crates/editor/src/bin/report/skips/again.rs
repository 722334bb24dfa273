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

use super::{TOLERANCE_DB, psnr_db};
use crate::desk::Desk;
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
    let job = |change: Change| -> Result<BakeJob> {
        let mut scene = scene.clone();
        change(&mut scene);
        let scene = Arc::new(PreparedScene::new(scene, &[])?.0);
        let config = BakeConfig { spp, tolerance_db: TOLERANCE_DB, ..BakeConfig::default() };
        let camera = scene.scene.cameras[0].clone();
        Ok(BakeJob { scene, camera, film, config, passes: Passes::FinalOnly, irradiance: Vec::new() })
    };
    let earlier = from_nothing(job(|_| {})?)?.0;
    let mut rows = String::new();
    for (what, change) in CHANGES {
        desk.say(&format!("baking {name} again: {what}"));
        let (full, full_secs) = from_nothing(job(change)?)?;
        let begun = process_cpu_secs()?;
        let job = job(change)?;
        let prepared = process_cpu_secs()?;
        let reuse = job.reuse(&earlier).context("only a lamp has changed")?;
        let traced = reuse.n_traced_columns();
        let again = job.run_reusing(&reuse, &Focus::default(), None, |_| ControlFlow::Continue(()))?;
        let again_secs = process_cpu_secs()? - prepared;
        let again = again.context("nobody stops a bake of the report")?;
        let db = psnr_db(&as_in_file(&again), &as_in_file(&full)).map_or("the same".into(), |db| format!("{db:.1}"));
        let columns = again.header.basis.n_cols();
        rows += &format!(
            "| {what} | {traced} of {columns} | {again_secs:.2} | {full_secs:.2} | {:.2} | {db} |\n",
            prepared - begun
        );
    }
    Ok(format!(
        "\n### {name}, baked again\n\n\
         An earlier bake of the scene is at hand, and one of its lamps has changed. Times are single tries with seed {}; preparing the scene (its hierarchies) is done either way.\n\n\
         | what changed | columns traced | bake, CPU s | from nothing, CPU s | preparing, CPU s | picture dB against that from nothing |\n\
         |---|---|---|---|---|---|\n{rows}",
        BakeConfig::default().seed,
    ))
}

fn from_nothing(job: BakeJob) -> Result<(Bake, f64)> {
    let begun = process_cpu_secs()?;
    let bake = job.run(|_| ControlFlow::Continue(()))?.context("nobody stops a bake of the report")?;
    Ok((bake, process_cpu_secs()? - begun))
}
