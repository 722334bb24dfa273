//! `clerestory export-gltf`: a scene with its lights as a look sets them.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use clap::Args;
use clerestory_transport::emitters::PanelRequest;
use clerestory_transport::import::Choice;
use clerestory_transport::prepared::PreparedScene;
use serde_json::json;

use super::args::{OutputArgs, parse_panel};
use super::console::{Answer, Console};
use super::looks::LookChoice;
use super::view::{
    count_in_watts, load_look, load_scene, or_of_file, panels, spare_look, spare_scene, warn_of_unknown_lights,
};
use crate::export_gltf::Lit;
use crate::look::lamps::resolve;

/// `clerestory export-gltf`.
#[derive(Debug, Args)]
pub struct ExportGltfArgs {
    /// Scene, .gltf or .glb.
    pub scene: PathBuf,
    /// Look whose lights are written [default: as the scene says].
    #[arg(long, value_name = "FILE.look")]
    pub look: Option<PathBuf>,
    /// What of it.
    #[command(flatten)]
    pub choice: LookChoice,
    /// Make a planar emissive node, by its key, a panel of M × M texels, M from 4 to 64; may be repeated.
    #[arg(long = "panel", value_name = "NODE=M", value_parser = parse_panel)]
    pub panels: Vec<PanelRequest>,
    /// Take the numbers of lamps as watts per steradian, not as candela and lux: 1 becomes 683.
    #[arg(long)]
    pub unitless: bool,
    /// Scene to write.
    #[arg(short, long, value_name = "OUT.glb|OUT.gltf")]
    pub output: PathBuf,
    /// How to answer.
    #[command(flatten)]
    pub answer: OutputArgs,
}

pub(super) fn export_gltf(args: &ExportGltfArgs, console: &mut Console) -> Result<Answer> {
    spare_scene(&args.output, &args.scene)?;
    let document = load_look(args.look.as_deref(), console)?;
    spare_look(&args.output, args.look.as_deref(), &document)?;
    let mut scene = load_scene(&args.scene, &Choice::default(), console)?.scene;
    count_in_watts(&mut scene, args.unitless, document.scene.units, console);
    let panels = panels(&scene, &args.panels, &document.scene, console);
    let problem = || format!("cannot prepare the scene {}", args.scene.display());
    let (scene, warnings) = PreparedScene::new(scene, &panels).with_context(problem)?;
    console.warn_all(warnings);
    let basis = &scene.lighting.basis;
    let mut look = args.choice.of(&or_of_file(document, args.look.as_deref(), basis), Some(basis))?;
    warn_of_unknown_lights(basis, &look, console);
    let folder = args.look.as_deref().and_then(Path::parent).unwrap_or(Path::new(""));
    console.warn_all(resolve(&mut look.lights.lamps, folder));
    let bytes = std::fs::read(&args.scene).with_context(|| format!("cannot read {}", args.scene.display()))?;
    let lit = Lit { bytes: &bytes, folder: args.scene.parent(), scene: &scene, look: &look };
    console.warn_all(lit.save(&args.output)?);
    let output = args.output.display().to_string();
    let (n_lights, n_lamps) = (basis.sources.len(), look.lights.lamps.len());
    let words = format!("{output}: {n_lights} lights, {n_lamps} lamps of the look");
    let json = json!({ "output": output, "lights": n_lights, "lamps": n_lamps, "warnings": console.warnings() });
    Ok(Answer { json, words })
}
