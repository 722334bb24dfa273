//! How much of a lamp's light meets mirrors and clear bodies, and how much of it panes and smooth coats mirror onto other surfaces: no
//! connection finds what these throw on, whether it is looked for at surfaces that are seen or on patches.

use super::PreparedLamps;
use super::light::Form;
use super::prepared::PreparedLamp;
use crate::bsdf::{Bsdf, SurfaceParams, is_mirror};
use crate::bvh::Ray;
use crate::prepared::{PreparedScene, SurfaceHit, next_after};
use crate::sampler::Sampler;
use crate::scene::Material;
use crate::slabs::hidden::{CLEAR, TOLERATED, parallel_rays, ray};

/// Surfaces that a ray meets at most.
const MOST_SURFACES: u32 = 16;

/// About which shares of a lamp's light surfaces throw on in ways that are not carried; 0 where that is no more than a little.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Lacking {
    /// Meets mirrors and clear bodies, see [`Material::casts_caustics`], as smooth as their textures leave them.
    pub caustic: f32,
    /// Panes of glass, thin and solid, and smooth coats mirror it onto other surfaces.
    pub mirrored: f32,
}

impl PreparedLamps {
    /// What the light of lamps lacks that is moved, by the lamp's key; lamps that lack nothing are left out.
    pub fn lacking(&self, scene: &PreparedScene) -> Vec<(String, Lacking)> {
        if !scene.scene.materials.iter().any(may_mirror) {
            return Vec::new();
        }
        let shares = self.lamps().iter().map(|lamp| (lamp.key.clone(), lamp.lacking(scene)));
        shares.filter(|(_, lacking)| *lacking != Lacking::default()).collect()
    }
}

/// Whether a material may mirror, whatever its textures say.
fn may_mirror(material: &Material) -> bool {
    let has_coat = material.finish.as_ref().is_some_and(|finish| finish.clearcoat > 0.0);
    let may_be_smooth = is_mirror(material.roughness) || material.metallic_roughness_texture.is_some();
    !material.unlit && !material.is_plainly_diffuse() && (has_coat || may_be_smooth)
}

impl PreparedLamp {
    /// What of its light is not carried.
    fn lacking(&self, scene: &PreparedScene) -> Lacking {
        let (mut lacking, mut all) = (Lacking::default(), 0.0);
        for (nth, (ray, weight)) in (0..).zip(self.rays(scene)) {
            let found = lacking_along(scene, ray, &mut Sampler::new(0, nth, 0));
            // Of light from far away only what meets the scene counts.
            all += if found.is_none() && self.lamp.is_beyond() { 0.0 } else { weight };
            let found = found.unwrap_or_default();
            lacking.caustic += weight * found.caustic;
            lacking.mirrored += weight * found.mirrored;
        }
        let told = |part: f32| if part > TOLERATED * all { part / all } else { 0.0 };
        Lacking { caustic: told(lacking.caustic), mirrored: told(lacking.mirrored) }
    }

    /// Some of its rays, and how much each carries.
    fn rays(&self, scene: &PreparedScene) -> Vec<(Ray, f32)> {
        if let Form::Distant { direction, .. } = self.lamp.form {
            return parallel_rays(scene, direction).into_iter().map(|ray| (ray, 1.0)).collect();
        }
        let beams = self.beams(scene.extent()).into_iter();
        beams.map(|beam| (ray(beam.origin, beam.direction), beam.flux.max_element())).collect()
    }
}

/// What of a ray's light is not carried; `None` where it meets nothing.
fn lacking_along(scene: &PreparedScene, mut ray: Ray, sampler: &mut Sampler) -> Option<Lacking> {
    let (mut passing, mut lacking) = (1.0f32, Lacking::default());
    for nth in 0..MOST_SURFACES {
        let Some(hit) = scene.closest(&ray, sampler) else { return (nth > 0).then_some(lacking) };
        let out = scene.slabs.behind(hit.triangle, hit.position, ray.direction);
        let looks = scene.appearance(&hit);
        let turned = turned_share(scene.material(hit.triangle), &looks.params);
        if out.is_none() && turned > 0.0 {
            lacking.caustic = passing * turned;
            break;
        }
        let bsdf = scene.bsdf_of(&hit, &looks, -ray.direction);
        let [reflected, landed] = mirror_shares(scene, (&hit, &bsdf), sampler);
        lacking.mirrored += passing * landed;
        match out {
            Some(out) => {
                let glass = looks.params.transmission * looks.params.base_color.max_element();
                let both_faces = ((1.0 - reflected) * glass).powi(2);
                // The back mirrors as much, which passes the front twice.
                lacking.mirrored += passing * landed * both_faces;
                passing *= both_faces;
                (ray.origin, ray.t_min) = (out, CLEAR * scene.extent());
            }
            None => {
                passing *= bsdf.straight_through().max_element();
                ray.t_min = next_after(hit.t);
            }
        }
        if passing <= 0.0 {
            break;
        }
    }
    Some(lacking)
}

/// Share of light that smooth metal and clear bodies send another way than it came, at a point that is so by its textures.
fn turned_share(material: &Material, params: &SurfaceParams) -> f32 {
    if !material.turns_light() || !is_mirror(params.roughness) {
        return 0.0;
    }
    let glass = if material.is_clear_by(|| params.roughness) { 0.0 } else { params.transmission };
    params.metallic + (1.0 - params.metallic) * glass
}

/// Share of light that a surface mirrors, and the part of it that meets another one.
fn mirror_shares(scene: &PreparedScene, (hit, bsdf): (&SurfaceHit, &Bsdf), sampler: &mut Sampler) -> [f32; 2] {
    let (mut all, mut landed) = (0.0, 0.0);
    for lobe in bsdf.deltas().filter(|lobe| !lobe.transmitted) {
        let share = lobe.share.max_element();
        let ray = ray(hit.origin(hit.outward(lobe.wi)), lobe.wi);
        all += share;
        landed += if scene.closest_behind_panes(&ray, sampler).is_some() { share } else { 0.0 };
    }
    [all, landed]
}
