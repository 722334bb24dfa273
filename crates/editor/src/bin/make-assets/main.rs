//! Writes the scenes of `assets/scenes`, the same bytes each time.
//!
//! `cargo run --release -p clerestory --bin make-assets -- [OUT_DIR]`

mod art;
mod gallery;
mod glb;
mod material;
mod mesh;
mod method_scenes;
mod shapes;
mod textures;

use std::path::{Path, PathBuf};

use anyhow::Context;
use clap::Parser;

use glb::Document;

/// Writes the scenes that come with Clerestory: the gallery and the four scene types of the method's evaluation.
#[derive(Parser)]
#[command(after_help = "Example: make-assets assets/scenes")]
struct Arguments {
    /// Folder that receives the GLB files.
    #[arg(default_value = "assets/scenes")]
    out_dir: PathBuf,
}

fn main() -> anyhow::Result<()> {
    let out_dir = Arguments::parse().out_dir;
    std::fs::create_dir_all(&out_dir).with_context(|| format!("cannot make the folder {}", out_dir.display()))?;
    write(&out_dir, "gallery", gallery::gallery())?;
    write(&out_dir, "diffuse", method_scenes::diffuse())?;
    write(&out_dir, "reflections", method_scenes::reflections())?;
    write(&out_dir, "caustics", method_scenes::caustics())?;
    write(&out_dir, "mixed", method_scenes::mixed())?;
    Ok(())
}

#[expect(clippy::print_stdout, reason = "the tool reports what it wrote")]
fn write(out_dir: &Path, name: &str, document: Document) -> anyhow::Result<()> {
    let (n_triangles, n_lights) = (document.n_triangles(), document.n_lights());
    let bytes = document.into_glb(name);
    let path = out_dir.join(format!("{name}.glb"));
    std::fs::write(&path, &bytes).with_context(|| format!("cannot write {}", path.display()))?;
    println!("{}: {n_triangles} triangles, {n_lights} lights, {} bytes", path.display(), bytes.len());
    Ok(())
}
