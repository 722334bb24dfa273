//! Where a material may hold a texture.

use super::{Material, TextureRef};

impl Material {
    /// Every place that may hold a texture, in the order in which an import meets them.
    pub(crate) fn texture_slots(&mut self) -> Vec<&mut Option<TextureRef>> {
        let mut slots = vec![
            &mut self.base_color_texture,
            &mut self.metallic_roughness_texture,
            &mut self.normal_texture,
            &mut self.emissive_texture,
            &mut self.transmission_texture,
            &mut self.specular_texture,
            &mut self.specular_color_texture,
        ];
        if let Some(finish) = &mut self.finish {
            slots.extend([
                &mut finish.clearcoat_texture,
                &mut finish.clearcoat_roughness_texture,
                &mut finish.clearcoat_normal_texture,
                &mut finish.sheen_color_texture,
                &mut finish.sheen_roughness_texture,
                &mut finish.anisotropy_texture,
                &mut finish.iridescence_texture,
                &mut finish.film_thickness_texture,
                &mut finish.diffuse_transmission_texture,
                &mut finish.diffuse_transmission_color_texture,
            ]);
        }
        slots
    }
}
