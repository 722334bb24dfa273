//! The white furnace: how much light rough metal and rough glass lose that ought to lose none.
//!
//! Each surface is asked as if it were white, under light that is the same from everywhere, so that what does not come back
//! is lost by the model. \[Heitz2016\]

use std::collections::BTreeSet;

use glam::Vec3;

use super::compensation::points;
use super::{Bsdf, FinishParams, SurfaceParams, is_matched, is_mirror};
use crate::scene::{FacetScattering, Material, Scene};

/// Cosines of the viewers that are asked; below the last one little is seen.
const COSINES: [f32; 7] = [1.0, 0.8, 0.6, 0.4, 0.2, 0.1, 0.05];

/// What the rough metals and glasses of a scene lose in a white furnace.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FurnaceLoss {
    /// Number of materials that are such.
    pub n_materials: usize,
    /// Greatest share of light that one of them loses at any angle as it is, 0…1; textures can only make it less.
    pub at_most: f32,
    /// The same if light were followed to one facet only.
    pub single: f32,
}

/// What the rough metals and glasses of a scene lose; `None` where there are none.
pub fn furnace_loss(scene: &Scene) -> Option<FurnaceLoss> {
    let rough: Vec<&Material> = scene.materials.iter().filter(|material| !kinds(material).is_empty()).collect();
    let mut seen = BTreeSet::new();
    let mut loss = FurnaceLoss { n_materials: rough.len(), at_most: 0.0, single: 0.0 };
    for material in &rough {
        let finish = material.finish.as_ref().map_or(0.0, |finish| finish.anisotropy);
        for params in kinds(material) {
            let shape = [params.roughness, params.metallic, params.ior, params.thickness.min(1.0), finish];
            if !seen.insert((shape.map(f32::to_bits), params.facet_scattering == FacetScattering::Single)) {
                continue;
            }
            loss.at_most = loss.at_most.max(loss_of(&params, finish));
            let single = SurfaceParams { facet_scattering: FacetScattering::Single, ..params };
            loss.single = loss.single.max(loss_of(&single, finish));
        }
    }
    (loss.n_materials > 0).then_some(loss)
}

/// White surfaces as rough as a material: its metal and its glass.
fn kinds(material: &Material) -> Vec<SurfaceParams> {
    if material.unlit || is_mirror(material.roughness) {
        return Vec::new();
    }
    let white = SurfaceParams {
        base_color: Vec3::ONE,
        metallic: 0.0,
        roughness: material.roughness,
        transmission: 0.0,
        ior: material.ior,
        specular: 1.0,
        specular_color: Vec3::ONE,
        thickness: material.thickness,
        facet_scattering: material.facet_scattering,
    };
    let metal = SurfaceParams { metallic: 1.0, thickness: 0.0, ior: 1.5, ..white };
    let glass = SurfaceParams { transmission: 1.0, ..white };
    let has_glass = material.transmission > 0.0 && material.metallic < 1.0 && !is_matched(material.ior);
    [(material.metallic > 0.0).then_some(metal), has_glass.then_some(glass)].into_iter().flatten().collect()
}

/// Greatest share that a surface of facets loses, over viewers on both sides.
fn loss_of(params: &SurfaceParams, anisotropy: f32) -> f32 {
    let sides: &[f32] = if params.transmission > 0.0 { &[1.0, -1.0] } else { &[1.0] };
    let viewers = sides.iter().flat_map(|side| COSINES.map(|cos| side * cos));
    viewers.map(|cos| 1.0 - returned(params, anisotropy, cos)).fold(0.0, f32::max)
}

/// Share of uniform light that a surface sends to a viewer under a cosine, negative on its back.
pub(super) fn returned(params: &SurfaceParams, anisotropy: f32, cos: f32) -> f32 {
    let finish = FinishParams { anisotropy, anisotropy_direction: Vec3::X, ..FinishParams::default() };
    let wo = Vec3::new((0.5 * (1.0 - cos * cos)).sqrt(), (0.5 * (1.0 - cos * cos)).sqrt(), cos);
    let bsdf = Bsdf::finished(params, &finish, Vec3::Z, Vec3::Z, wo);
    // Radiance is squeezed where it enters a solid.
    let squeeze = match params.thickness > 0.0 {
        true if cos > 0.0 => params.ior * params.ior,
        true => 1.0 / (params.ior * params.ior),
        false => 1.0,
    };
    let weights = points([24, 64], 1.0).enumerate().filter_map(|(nth, (u, share))| {
        let sample = bsdf.sample((nth as f32 * 0.618_034 + 0.3).fract(), u)?;
        Some(share * sample.weight.max_element() * if sample.transmitted { squeeze } else { 1.0 })
    });
    weights.sum()
}
