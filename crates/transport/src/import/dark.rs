//! Surfaces whose map of what they emit is black all over. Exporters of baked textures write it with a factor of 1, whether
//! anything glows or not: such a surface is no light.

use std::collections::{BTreeMap, BTreeSet};

use glam::Vec3;

use crate::scene::{Image, Material, Texture};

/// Takes the light from materials of which the map leaves nothing, and tells their indices.
pub(super) fn put_out(materials: &mut [Material], textures: &[Texture]) -> BTreeSet<u32> {
    let (mut known, mut dark) = (BTreeMap::new(), BTreeSet::new());
    for (idx, material) in (0..).zip(materials).filter(|(_, material)| material.is_emitter()) {
        let Some(map) = material.emissive_texture else { continue };
        let Some(texture) = textures.get(map.texture as usize) else { continue };
        let lit = *known.entry(map.texture).or_insert_with(|| lit_channels(&texture.image));
        if (material.emissive * lit).max_element() <= 0.0 {
            (material.emissive, material.emissive_texture) = (Vec3::ZERO, None);
            dark.insert(idx);
        }
    }
    dark
}

/// 1 in the channels of which any texel is more than black.
fn lit_channels(image: &Image) -> Vec3 {
    let is_lit = |channel: usize| image.texels.iter().any(|texel| texel[channel] > 0);
    Vec3::from([0, 1, 2].map(|channel| if is_lit(channel) { 1.0 } else { 0.0 }))
}
