//! The scenes that are baked.

use std::path::PathBuf;

use anyhow::Result;
use serde_json::Value;

use super::desk::{Desk, clerestory};

/// One bake that is measured.
pub struct Case {
    /// Name of the scene.
    pub name: String,
    path: PathBuf,
    /// Width and height in pixels, as the command line takes them.
    pub size: &'static str,
    /// Most samples per pixel.
    pub spp: &'static str,
}

/// Size of real scenes and their samples: detail is what is hard about them, and in a hurry they go without most of it.
const REAL: [(&str, &str); 2] = [("128x96", "8"), ("512x384", "16")];

/// The gallery, the scenes of the method's evaluation, and real scenes where they are at hand.
pub fn cases(desk: &Desk) -> Vec<Case> {
    let own_look = desk.choose(("64x48", "16"), ("256x192", "64"));
    let own = ["gallery", "diffuse", "reflections", "caustics", "mixed"];
    let own = own.iter().map(|name| (Some(desk.root.join(format!("assets/scenes/{name}.glb"))), own_look));
    let shared: &[&str] = desk.choose(&["conference"], &["conference", "conference-panel", "bitterli-staircase2"]);
    let real_look = desk.choose(REAL[0], REAL[1]);
    let shared = shared.iter().map(|name| (desk.shared(&format!("scenes/{name}.glb")), real_look));
    let found = own.chain(shared).filter_map(|(path, look)| Some((path.filter(|path| path.exists())?, look)));
    let name = |path: &PathBuf| path.file_stem().map_or("scene".into(), |stem| stem.to_string_lossy().into_owned());
    found.map(|(path, (size, spp))| Case { name: name(&path), path, size, spp }).collect()
}

impl Case {
    /// The scene's file, as the command line takes it.
    pub fn scene(&self) -> String {
        self.path.display().to_string()
    }

    /// Bakes to the file of that name; what `bake` and `info` tell.
    pub fn bake(&self, transport: &str, tolerance_db: &str, seed: &str) -> Result<[Value; 2]> {
        let scene = self.scene();
        let bake = ["bake", &scene, "-o", transport, "--spp", self.spp, "--tolerance", tolerance_db];
        let bake: Vec<&str> = bake.into_iter().chain(["--size", self.size, "--seed", seed, "--json"]).collect();
        Ok([clerestory(&bake)?, clerestory(&["info", transport, "--json"])?])
    }
}
