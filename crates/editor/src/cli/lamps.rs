//! Free lamps of a look on the command line: as lights of a scene that is traced, or added to a picture that was baked.

use std::path::Path;
use std::sync::Arc;

use anyhow::{Context, Result, bail};
use clerestory_relight::Radiance;
use clerestory_transport::bake::{Bake, BakeHeader};
use clerestory_transport::camera::{Camera, Film};
use clerestory_transport::lamps::{FreeLamp, PreparedLamps};
use clerestory_transport::prepared::PreparedScene;
use clerestory_transport::visible::{VisibleConfig, VisiblePoints};

use super::console::Console;
use super::view::{View, load_scene};
use crate::look::Look;

/// Samples of a pixel that are kept at once, how often other ones take their place, and passes of each: as many in all as make
/// a soft shadow smooth.
const SAMPLES: u32 = 4;
const TURNS: u32 = 8;
const ROUNDS: u32 = 2;

/// The lamps of a look that shine.
pub(super) fn prepared(lamps: &[FreeLamp], look: Option<&Path>, console: &mut Console) -> Result<PreparedLamps> {
    let folder = look.and_then(Path::parent);
    let (lamps, warnings) = PreparedLamps::new(lamps, folder).context("the look has a lamp that cannot shine")?;
    console.warn_all(warnings);
    Ok(lamps)
}

/// Makes the lamps of a look lights of a scene that nobody else has yet, in columns of their own.
pub(super) fn install(view: &mut View, look: &Look, path: Option<&Path>, console: &mut Console) -> Result<()> {
    if look.lights.lamps.is_empty() {
        return Ok(());
    }
    let lamps = prepared(&look.lights.lamps, path, console)?;
    let scene = Arc::get_mut(&mut view.scene).context("the scene is in use")?;
    lamps.install(scene).context("the look cannot light the scene")
}

/// What lamps bring to a baked picture.
pub(super) struct LampLight {
    scene: PreparedScene,
    camera: Camera,
    film: Film,
    /// Lamps with their names, each for itself.
    lamps: Vec<(String, PreparedLamps)>,
    all: PreparedLamps,
}

impl LampLight {
    /// Of a look whose picture was baked from a scene; `None` for a look without lamps.
    pub fn of(
        bake: &Bake,
        look: &Look,
        (path, scene): (Option<&Path>, Option<&Path>),
        console: &mut Console,
    ) -> Result<Option<LampLight>> {
        let lamps = &look.lights.lamps;
        if lamps.is_empty() {
            return Ok(None);
        }
        if bake.header.basis.is_measured() {
            bail!("the look has lamps, but the bake is of pictures, which no lamp can light; bake a scene instead");
        }
        let Some(scene) = scene else {
            bail!(
                "the look has lamps, which light the surfaces of the scene; name the scene that was baked with --scene"
            );
        };
        let all = prepared(lamps, path, console)?;
        let each = lamps.iter().map(|lamp| {
            let alone = prepared(std::slice::from_ref(lamp), path, &mut *console)?;
            Ok((lamp.key.clone(), alone))
        });
        let lamps: Vec<(String, PreparedLamps)> = each.collect::<Result<_>>()?;
        if let Some((key, _)) = lamps.iter().find(|(key, _)| bake.header.basis.source(key).is_some()) {
            bail!("a light of the scene is called `{key}`, as a lamp of the look is; rename the lamp");
        }
        if bake.header.patches.is_none() {
            console.warn(
                "the transport has no patches, so the light of the look's lamps is shown where it falls, not what surfaces make \
                 of it; bake the scene with --patches 4096 for that",
            );
        }
        let (scene, camera) = open(&bake.header, scene, console)?;
        let film = Film { width: bake.header.width, height: bake.header.height };
        Ok(Some(LampLight { scene, camera, film, lamps, all }))
    }

    /// Direct light of all lamps, nit.
    pub fn direct(&self) -> Radiance {
        self.direct_of(&self.all)
    }

    /// Name of each lamp, its direct light, and its coefficients of patches.
    pub fn layers<'a>(&'a self, bake: &'a Bake) -> impl Iterator<Item = (&'a str, Radiance, Vec<[f32; 3]>)> {
        self.lamps.iter().map(|(key, lamps)| (key.as_str(), self.direct_of(lamps), self.of_patches(bake, lamps)))
    }

    /// Coefficients of the patches of a bake under all lamps; none for a bake without.
    pub fn coefficients(&self, bake: &Bake) -> Vec<[f32; 3]> {
        self.of_patches(bake, &self.all)
    }

    fn of_patches(&self, bake: &Bake, lamps: &PreparedLamps) -> Vec<[f32; 3]> {
        let irradiance = |position, normal| lamps.irradiance(&self.scene, position, normal);
        bake.header.patches.as_ref().map_or_else(Vec::new, |patches| patches.coefficients(&irradiance))
    }

    fn direct_of(&self, lamps: &PreparedLamps) -> Radiance {
        let Film { width, height } = self.film;
        let mut pixels = vec![[0.0; 3]; self.film.n_pixels()];
        let n_passes = SAMPLES * ROUNDS;
        for turn in 0..TURNS {
            let config = VisibleConfig { samples: SAMPLES, seed: u64::from(turn) };
            let points = VisiblePoints::new(&self.scene, &self.camera, self.film, config, &|| false);
            let passes = (0..n_passes).filter_map(|pass| points.as_ref()?.direct(&self.scene, lamps, pass, &|| false));
            for pass in passes {
                for (pixel, rgb) in pixels.iter_mut().zip(pass) {
                    (0..3).for_each(|c| pixel[c] += rgb[c] / (n_passes * TURNS) as f32);
                }
            }
        }
        Radiance { width, height, pixels }
    }
}

/// The scene of a bake and its camera.
fn open(header: &BakeHeader, path: &Path, console: &mut Console) -> Result<(PreparedScene, Camera)> {
    let scene = load_scene(path, header.skips, console)?.scene;
    let cameras = scene.cameras.iter().filter(|camera| camera.name == header.camera);
    let camera = header.view.iter().chain(cameras).find(|camera| header.is_of(&scene, camera)).cloned();
    let Some(camera) = camera else {
        bail!(
            "{} is not the scene that was baked: its geometry, materials, lights or camera differ (lamps that --ies or --unitless \
             changed count as well); name the same file, or bake again",
            path.display()
        );
    };
    let (scene, _) = PreparedScene::with_skips(scene, &[], None, header.skips)
        .with_context(|| format!("cannot prepare the scene {}", path.display()))?;
    Ok((scene, camera))
}
