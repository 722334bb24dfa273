//! Lamps without size whose light meets mirrors, or smooth glass of any other shape: no connection finds what those bend, and no
//! walk meets them by chance.

use glam::Vec3;

use super::find::bends;
use crate::basis::SourceKind;
use crate::bsdf;
use crate::bvh::Ray;
use crate::emitters::{Emitter, punctual_falloff};
use crate::prepared::{PreparedScene, SurfaceHit};
use crate::sampler::Sampler;
use crate::scene::{Material, PunctualKind, PunctualLight, Scene};

/// Directions that are looked into from a lamp.
const DIRECTIONS: u32 = 512;
/// Share of a lamp's light that may be missing without a word.
const TOLERATED: f32 = 0.01;

/// Whether a scene has both, lamps without size and glass or mirrors, so that some light may be missing.
fn may_hide(scene: &Scene) -> bool {
    let hides = |m: &Material| bends_smoothly(m, || bsdf::least_roughness(m, &scene.textures)) || mirrored(m) > 0.0;
    scene.punctual.iter().any(is_sharp) && scene.materials.iter().any(hides)
}

/// Whether glass bends what passes into one direction alone, whatever coats or waves are on it, where it is that rough.
fn bends_smoothly(material: &Material, roughness: impl FnOnce() -> f32) -> bool {
    bends(material) && !material.is_stretched() && bsdf::is_mirror(roughness())
}

/// Share of the light that smooth glass other than a slab takes in; 0 of what is none.
fn bent(scene: &PreparedScene, hit: &SurfaceHit) -> f32 {
    if !bends(scene.material(hit.triangle)) || scene.slabs.has(hit.triangle) {
        return 0.0;
    }
    let params = scene.appearance(hit).params;
    let is_smooth = bends_smoothly(scene.material(hit.triangle), || params.roughness);
    if is_smooth { (1.0 - params.metallic) * params.transmission } else { 0.0 }
}

/// Share of the light that a mirror throws on; 0 of what is none.
fn mirrored(material: &Material) -> f32 {
    if material.unlit || material.is_stretched() || !bsdf::is_mirror(material.roughness) {
        return 0.0;
    }
    material.metallic * material.base_color.truncate().max_element()
}

/// A warning for each lamp of which more than a little is hidden.
pub(crate) fn warnings(scene: &PreparedScene) -> Vec<String> {
    if !may_hide(&scene.scene) {
        return Vec::new();
    }
    let lamps = scene.lighting.emitters.iter().zip(&scene.lighting.basis.sources);
    let words = lamps.flat_map(|(emitter, source)| {
        let missing = match emitter {
            Emitter::Punctual(light) => missing(scene, light),
            _ => Missing::default(),
        };
        let said = |share: f32, text: &dyn Fn(f32) -> String| (share > TOLERATED).then(|| text(100.0 * share));
        let remedy = match source.kind {
            SourceKind::Directional => "a size with --sun-size",
            _ => "a shape that emits",
        };
        let of_glass = said(missing.bent, &|percent| {
            format!(
                "light `{}` sends {percent:.0} % of its light into smooth glass that bends it, and what passes there is missing: \
                 make the glass rough (above 0.03), without thickness or a flat pane, or give the lamp {remedy}",
                source.key
            )
        });
        let of_mirrors = said(missing.mirrored, &|percent| {
            format!(
                "light `{}` sends {percent:.0} % of its light onto smooth mirrors, and what they throw on is missing: make the \
                 mirror rough (above 0.03), or give the lamp {remedy}",
                source.key
            )
        });
        [of_glass, of_mirrors].into_iter().flatten()
    });
    words.collect()
}

fn is_near(light: &PunctualLight) -> bool {
    light.kind != PunctualKind::Directional
}

/// Whether no walk can meet it.
fn is_sharp(light: &PunctualLight) -> bool {
    is_near(light) || light.radius_rad <= 0.0
}

/// Shares of a lamp's light that no walk and no connection finds.
#[derive(Clone, Copy, Default)]
struct Missing {
    /// First meets smooth glass that is no slab.
    bent: f32,
    /// First meets mirrors, and is thrown on.
    mirrored: f32,
}

fn missing(scene: &PreparedScene, light: &PunctualLight) -> Missing {
    let (mut missing, mut all) = (Missing::default(), 0.0);
    for nth in 0..DIRECTIONS {
        let Some((ray, intensity)) = ray_of(scene, light, nth) else { continue };
        let met = scene.closest_behind_panes(&ray, &mut Sampler::new(0, u64::from(nth), 0)).map(|(hit, _)| hit);
        // Of light from far away only what meets the scene counts.
        all += if met.is_some() || is_near(light) { intensity } else { 0.0 };
        let Some(hit) = met else { continue };
        missing.mirrored += intensity * mirrored(scene.material(hit.triangle));
        missing.bent += intensity * bent(scene, &hit);
    }
    let share = |part: f32| if all > 0.0 { part / all } else { 0.0 };
    Missing { bent: share(missing.bent), mirrored: share(missing.mirrored) }
}

/// One of some rays that a lamp sends, and how much it carries.
fn ray_of(scene: &PreparedScene, light: &PunctualLight, nth: u32) -> Option<(Ray, f32)> {
    let (sin, cos) = (nth as f32 * 2.399_963_2).sin_cos();
    let along = (nth as f32 + 0.5) / DIRECTIONS as f32;
    let ray = |origin, direction| Ray { origin, direction, t_min: 0.0, t_max: f32::INFINITY };
    if !is_near(light) {
        // A sunflower across all surfaces. [Vogel1979]
        let (low, high) = scene.scene.mesh.bounds()?;
        let (middle, radius) = (0.5 * (low + high), 0.5 * low.distance(high));
        let (x, y) = light.direction.any_orthonormal_pair();
        let place = middle + (x * cos + y * sin) * (radius * along.sqrt());
        return Some((ray(place - light.direction * (2.0 * radius), light.direction), 1.0));
    }
    // A spiral from pole to pole, evenly wound.
    let y = 1.0 - 2.0 * along;
    let direction = Vec3::new(cos, 0.0, sin) * (1.0 - y * y).sqrt() + Vec3::Y * y;
    let intensity = punctual_falloff(light, &scene.scene.profiles, direction);
    (intensity > 0.0).then(|| (ray(light.position, direction), intensity))
}
