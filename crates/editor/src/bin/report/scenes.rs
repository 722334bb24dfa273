//! Scenes of files, ready for rays.

use std::path::Path;

use anyhow::{Context, Result};
use clerestory_transport::emitters::{PanelRequest, SkyRequest};
use clerestory_transport::import::{self, load_sky};
use clerestory_transport::prepared::PreparedScene;
use clerestory_transport::sky::{SkyForm, SkyLight};

/// Loads a scene and makes it ready for rays; under a sky of patches where a name and a map of one are given.
///
/// # Errors
/// If the scene or the map cannot be loaded, or its lights make no columns.
pub fn prepared(path: &Path, sky: Option<(&str, &Path)>) -> Result<PreparedScene> {
    with_panels(path, &[], sky)
}

/// The same with some of its lights divided into texels.
///
/// # Errors
/// As [`prepared`], and if a light cannot be divided.
pub fn with_panels(path: &Path, panels: &[PanelRequest], sky: Option<(&str, &Path)>) -> Result<PreparedScene> {
    let scene = import::load(path).with_context(|| format!("cannot load the scene {}", path.display()))?.scene;
    let request = |(name, path): (&str, &Path)| -> Result<SkyRequest> {
        let map = load_sky(path).with_context(|| format!("cannot load the sky {}", path.display()))?.0;
        Ok(SkyRequest { light: SkyLight::new(name, map), form: SkyForm::Patches(1) })
    };
    let sky = sky.map(request).transpose()?;
    Ok(PreparedScene::with_sky(scene, panels, sky.as_ref())?.0)
}
