//! Lamps without size whose light meets smooth glass of any other shape: no connection finds what the glass bends, and no walk
//! meets them by chance.

use glam::Vec3;

use super::find::refracts_smoothly;
use crate::bvh::Ray;
use crate::emitters::{Emitter, punctual_falloff};
use crate::prepared::PreparedScene;
use crate::scene::{PunctualKind, PunctualLight, Scene};

/// Directions that are looked into from a lamp.
const DIRECTIONS: u32 = 512;
/// Share of a lamp's light that may be missing without a word.
const TOLERATED: f32 = 0.01;

/// Whether a scene has both, lamps and glass, so that some may be hidden.
pub(crate) fn may_hide(scene: &Scene) -> bool {
    scene.punctual.iter().any(is_near) && scene.materials.iter().any(refracts_smoothly)
}

/// A warning for each lamp of which more than a little is hidden.
pub(crate) fn warnings(scene: &PreparedScene) -> Vec<String> {
    if !may_hide(&scene.scene) {
        return Vec::new();
    }
    let lamps = scene.lighting.emitters.iter().zip(&scene.lighting.basis.sources);
    let words = lamps.filter_map(|(emitter, source)| {
        let Emitter::Punctual(light) = emitter else { return None };
        let hidden = if is_near(light) { hidden(scene, light) } else { 0.0 };
        (hidden > TOLERATED).then(|| {
            format!(
                "light `{}` sends {:.0} % of its light into smooth glass that bends it, and what passes there is missing: \
                 make the glass rough (above 0.03), without thickness or a flat pane, or give the lamp a shape that emits",
                source.key,
                100.0 * hidden
            )
        })
    });
    words.collect()
}

fn is_near(light: &PunctualLight) -> bool {
    light.kind != PunctualKind::Directional
}

/// Share of a lamp's light whose first surface is smooth glass that is no slab.
fn hidden(scene: &PreparedScene, light: &PunctualLight) -> f32 {
    let (mut hidden, mut all) = (0.0, 0.0);
    for nth in 0..DIRECTIONS {
        // A spiral from pole to pole, evenly wound.
        let y = 1.0 - (2.0 * nth as f32 + 1.0) / DIRECTIONS as f32;
        let (sin, cos) = (nth as f32 * 2.399_963_2).sin_cos();
        let direction = Vec3::new(cos, 0.0, sin) * (1.0 - y * y).sqrt() + Vec3::Y * y;
        let intensity = punctual_falloff(light, &scene.scene.profiles, direction);
        let ray = Ray { origin: light.position, direction, t_min: 0.0, t_max: f32::INFINITY };
        all += intensity;
        if intensity > 0.0
            && let Some(triangle) = scene.first_opaque(&ray)
            && refracts_smoothly(scene.material(triangle))
            && !scene.slabs.has(triangle)
        {
            hidden += intensity;
        }
    }
    if all > 0.0 { hidden / all } else { 0.0 }
}
