//! Lamps without size whose light meets mirrors and coats, or smooth glass of any other shape: no connection finds what those bend,
//! and no walk meets them by chance; and a sun that walks find behind such glass by chance alone.

use glam::Vec3;

use super::IN_A_ROW;
use super::find::bends;
use crate::basis::{LightSource, SourceKind};
use crate::bsdf;
use crate::bvh::Ray;
use crate::emitters::{Emitter, punctual_falloff};
use crate::enclosed::directions;
use crate::patches::GOLDEN_ANGLE;
use crate::prepared::{PreparedScene, SurfaceHit};
use crate::sampler::Sampler;
use crate::scene::{Material, PunctualKind, PunctualLight, Scene};

/// Directions that are looked into from a lamp.
const DIRECTIONS: u32 = 512;
/// Share of a lamp's light that may be missing without a word.
pub(crate) const TOLERATED: f32 = 0.01;
/// Length over the extent of the scene within which light that leaves a slab meets nothing else.
pub(crate) const CLEAR: f32 = 1e-5;

/// Whether a scene has glass, mirrors or coats that may hide light.
fn may_hide(scene: &Scene) -> bool {
    // Roughness may be one of many texels: it is asked for last.
    let hides = |m: &Material| {
        let is_smooth = || !m.is_stretched() && bsdf::is_mirror(bsdf::least_roughness(m, &scene.textures));
        let is_lacquered = || m.finish.as_ref().is_some_and(|finish| finish.clearcoat > 0.0);
        !m.unlit && (is_lacquered() || is_tint(m) || is_smooth())
    };
    scene.materials.iter().any(hides)
}

/// Share of the light that smooth glass other than a slab takes in, whatever coats or waves are on it; 0 of what is none.
fn bent(scene: &PreparedScene, hit: &SurfaceHit) -> f32 {
    let material = scene.material(hit.triangle);
    if !bends(material) || material.is_stretched() || scene.slabs.has(hit.triangle) {
        return 0.0;
    }
    let params = scene.appearance(hit).params;
    if bsdf::is_mirror(params.roughness) { (1.0 - params.metallic) * params.transmission } else { 0.0 }
}

/// Whether a solid attenuates and bends nothing: light goes straight through, but no connection does.
fn is_tint(material: &Material) -> bool {
    let attenuates = material.thickness > 0.0 && material.attenuation_distance.is_finite();
    !material.unlit && material.transmission > 0.0 && attenuates && bsdf::is_matched(material.ior)
}

/// Share of the light that such a solid takes in; 0 of what is none.
fn tinted(scene: &PreparedScene, hit: &SurfaceHit) -> f32 {
    if !is_tint(scene.material(hit.triangle)) {
        return 0.0;
    }
    let params = scene.appearance(hit).params;
    (1.0 - params.metallic) * params.transmission
}

/// Shares of light of a direction that a smooth metal, and a smooth coat, throw on; 0 of what is none, and of glass.
fn thrown(scene: &PreparedScene, hit: &SurfaceHit, direction: Vec3) -> [f32; 2] {
    let material = scene.material(hit.triangle);
    if material.unlit || material.transmission > 0.0 {
        return [0.0; 2];
    }
    let looks = scene.appearance(hit);
    let lobes = scene.bsdf_of(hit, &looks, -direction);
    let share: f32 = lobes.deltas().filter(|lobe| !lobe.transmitted).map(|lobe| lobe.share.max_element()).sum();
    [share * looks.params.metallic, share * (1.0 - looks.params.metallic)]
}

/// A warning for each light of which more than a little is hidden.
pub(crate) fn warnings(scene: &PreparedScene) -> Vec<String> {
    let lights = scene.lighting.emitters.iter().zip(&scene.lighting.basis.sources);
    let may_be_hidden = |(emitter, source): (&Emitter, &LightSource)| {
        matches!((emitter, source.kind), (Emitter::Punctual(_), _) | (Emitter::Sun(_), SourceKind::Sun { .. }))
    };
    if !lights.clone().any(may_be_hidden) || !may_hide(&scene.scene) {
        return Vec::new();
    }
    let words = lights.flat_map(|(emitter, source)| match (emitter, source.kind) {
        (Emitter::Punctual(light), _) => of_lamp(source, missing(scene, &Sender::of(light))),
        (Emitter::Sun(sun), SourceKind::Sun { .. }) => of_sun(source, missing(scene, &Sender::Far(-sun.direction))),
        _ => Vec::new(),
    });
    words.collect()
}

/// What there is to say of a share of light.
fn said(share: f32, text: impl Fn(f32) -> String) -> Option<String> {
    (share > TOLERATED).then(|| text(100.0 * share))
}

fn of_lamp(source: &LightSource, missing: Missing) -> Vec<String> {
    let key = &source.key;
    let remedy = match source.kind {
        SourceKind::Directional => "a size with --sun-size",
        _ => "a shape that emits",
    };
    let of_glass = said(missing.bent, |percent| {
        format!(
            "light `{key}` sends {percent:.0} % of its light into smooth glass that bends it, and what passes there is missing: make \
             the glass rough (above 0.03), without thickness or a flat pane, of which {IN_A_ROW} in a row are passed, or give the lamp \
             {remedy}"
        )
    });
    let of_tints = said(missing.tinted, |percent| {
        format!(
            "light `{key}` sends {percent:.0} % of its light into solids that color it and bend nothing, and what passes there is \
             missing: give them no thickness, or an index above 1 and a roughness above 0.03, or give the lamp {remedy}"
        )
    });
    let of_mirrors = said(missing.mirrored, |percent| {
        format!(
            "light `{key}` sends {percent:.0} % of its light onto smooth mirrors, and what they throw on is missing: make the mirror \
             rough (above 0.03), or give the lamp {remedy}"
        )
    });
    let of_coats = said(missing.coated, |percent| {
        format!(
            "smooth coats throw on {percent:.0} % of the light of `{key}`, which is missing: make them rough (above 0.03), or give the \
             lamp {remedy}"
        )
    });
    [of_glass, of_tints, of_mirrors, of_coats].into_iter().flatten().collect()
}

fn of_sun(source: &LightSource, missing: Missing) -> Vec<String> {
    let of_glass = said(missing.bent, |percent| {
        format!(
            "light `{}` sends {percent:.0} % of its light into smooth glass that bends it, and what passes there is found by chance \
             alone, with much noise: make the glass rough (above 0.03), without thickness or a flat pane",
            source.key
        )
    });
    let of_tints = said(missing.tinted, |percent| {
        format!(
            "light `{}` sends {percent:.0} % of its light into solids that color it and bend nothing, and what passes there is found by \
             chance alone, with much noise: give them no thickness, or an index above 1 and a roughness above 0.03",
            source.key
        )
    });
    [of_glass, of_tints].into_iter().flatten().collect()
}

/// Where light comes from.
enum Sender<'a> {
    /// A place.
    Near(&'a PunctualLight),
    /// Far away, along a unit direction.
    Far(Vec3),
}

impl Sender<'_> {
    fn of(light: &PunctualLight) -> Sender<'_> {
        match light.kind {
            PunctualKind::Directional => Sender::Far(light.direction),
            _ => Sender::Near(light),
        }
    }

    /// Some of its rays, and how much each carries.
    fn rays(&self, scene: &PreparedScene) -> Vec<(Ray, f32)> {
        match *self {
            Sender::Far(direction) => parallel_rays(scene, direction).into_iter().map(|ray| (ray, 1.0)).collect(),
            Sender::Near(light) => {
                let of_direction = |direction| {
                    let intensity = punctual_falloff(light, &scene.scene.profiles, direction);
                    (intensity > 0.0).then(|| (ray(light.position, direction), intensity))
                };
                directions(light, DIRECTIONS).filter_map(of_direction).collect()
            }
        }
    }
}

/// A ray without an end.
pub(crate) fn ray(origin: Vec3, direction: Vec3) -> Ray {
    Ray { origin, direction, t_min: 0.0, t_max: f32::INFINITY }
}

/// Rays of light from far away along a unit direction: a sunflower across all surfaces. \[Vogel1979\]
pub(crate) fn parallel_rays(scene: &PreparedScene, direction: Vec3) -> Vec<Ray> {
    let Some((low, high)) = scene.scene.mesh.bounds() else { return Vec::new() };
    let (middle, radius) = (0.5 * (low + high), 0.5 * low.distance(high));
    let (x, y) = direction.any_orthonormal_pair();
    let of_place = |nth: u32| {
        let (sin, cos) = (nth as f32 * GOLDEN_ANGLE).sin_cos();
        let along = (nth as f32 + 0.5) / DIRECTIONS as f32;
        let place = middle + (x * cos + y * sin) * (radius * along.sqrt());
        ray(place - direction * (2.0 * radius), direction)
    };
    (0..DIRECTIONS).map(of_place).collect()
}

/// Shares of a light that no connection finds.
#[derive(Clone, Copy, Default)]
struct Missing {
    /// Meets smooth glass that is no slab, or too many of these.
    bent: f32,
    /// Meets solids that attenuate and bend nothing.
    tinted: f32,
    /// Meets smooth metal, and is thrown on.
    mirrored: f32,
    /// Meets smooth coats, and is thrown on.
    coated: f32,
}

/// What a ray of light meets behind clear panes and slabs.
enum Met {
    Nothing,
    Surface(SurfaceHit),
    /// More slabs than a connection passes.
    Slabs,
}

fn missing(scene: &PreparedScene, sender: &Sender<'_>) -> Missing {
    let (mut missing, mut all) = (Missing::default(), 0.0);
    for (nth, (ray, intensity)) in (0..).zip(sender.rays(scene)) {
        let met = met(scene, ray, nth);
        // Of light from far away only what meets the scene counts.
        all += if matches!((&met, sender), (Met::Nothing, Sender::Far(_))) { 0.0 } else { intensity };
        match met {
            Met::Nothing => {}
            Met::Slabs => missing.bent += intensity,
            Met::Surface(hit) => {
                let [mirrored, coated] = thrown(scene, &hit, ray.direction);
                missing.mirrored += intensity * mirrored;
                missing.coated += intensity * coated;
                missing.bent += intensity * bent(scene, &hit);
                missing.tinted += intensity * tinted(scene, &hit);
            }
        }
    }
    let share = |part: f32| if all > 0.0 { part / all } else { 0.0 };
    let Missing { bent, tinted, mirrored, coated } = missing;
    Missing { bent: share(bent), tinted: share(tinted), mirrored: share(mirrored), coated: share(coated) }
}

fn met(scene: &PreparedScene, mut ray: Ray, nth: u32) -> Met {
    let sampler = &mut Sampler::new(0, u64::from(nth), 0);
    for _ in 0..=IN_A_ROW {
        let Some((hit, _)) = scene.closest_behind_panes(&ray, sampler) else { return Met::Nothing };
        match scene.slabs.behind(hit.triangle, hit.position, ray.direction) {
            Some(out) => (ray.origin, ray.t_min) = (out, CLEAR * scene.extent()),
            None => return Met::Surface(hit),
        }
    }
    Met::Slabs
}
