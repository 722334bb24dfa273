//! Maps whose image cannot be had. A checkerboard stands for a base color, where nobody mistakes it for a design; in any other map it
//! would be a magenta light, a field of mirrors or holes of glass. So what such a map would scale is left out with it.

use std::collections::BTreeSet;

use glam::Vec3;

use super::document::shown;
use super::report::Notes;
use crate::scene::{Finish, Material, TextureRef};

/// Takes missing maps, by their index in the scene, from all slots but base colors. Tells the indices of the materials that shone.
pub(super) fn leave_out(materials: &mut [Material], missing: &BTreeSet<u32>, notes: &mut Notes) -> BTreeSet<u32> {
    let mut put_out = BTreeSet::new();
    for (idx, material) in (0..).zip(materials) {
        let shone = material.is_emitter();
        let mut lost = Lost { missing, maps: Vec::new() };
        lost.of_material(material);
        if lost.maps.is_empty() {
            continue;
        }
        let name = called(material);
        let is_dark = shone && !material.is_emitter();
        let dark = if is_dark { ", and it does not shine" } else { "" };
        let maps = lost.maps.join(", ");
        notes.warn(format!("{name}: its maps of {maps} cannot be had: what they scale is left out{dark}"));
        if is_dark {
            put_out.insert(idx);
        }
    }
    put_out
}

/// A material in a line of the report.
pub(super) fn called(material: &Material) -> String {
    match material.name.as_str() {
        "" => "a material without a name".to_owned(),
        name => format!("material {}", shown(name)),
    }
}

/// Maps of a material that are missing.
struct Lost<'a> {
    missing: &'a BTreeSet<u32>,
    /// In words.
    maps: Vec<&'static str>,
}

impl Lost<'_> {
    /// Empties a slot whose map is missing, and tells whether it was.
    fn take(&mut self, slot: &mut Option<TextureRef>, map: &'static str) -> bool {
        let is_lost = slot.is_some_and(|texture| self.missing.contains(&texture.texture));
        if is_lost {
            *slot = None;
            self.maps.push(map);
        }
        is_lost
    }

    fn of_material(&mut self, material: &mut Material) {
        if self.take(&mut material.metallic_roughness_texture, "metal and roughness") {
            material.metallic = 0.0;
        }
        self.take(&mut material.normal_texture, "normals");
        if self.take(&mut material.emissive_texture, "emission") {
            material.emissive = Vec3::ZERO;
        }
        if self.take(&mut material.transmission_texture, "transmission") {
            material.transmission = 0.0;
        }
        self.take(&mut material.specular_texture, "specular strength");
        if self.take(&mut material.specular_color_texture, "specular color") {
            material.ior = material.ior.min(Material::default().ior);
        }
        if let Some(finish) = &mut material.finish {
            self.of_finish(finish);
        }
        if material.finish.as_ref().is_some_and(|finish| !finish.is_visible()) {
            material.finish = None;
        }
    }

    fn of_finish(&mut self, finish: &mut Finish) {
        if self.take(&mut finish.clearcoat_texture, "clear coat") {
            finish.clearcoat = 0.0;
        }
        self.take(&mut finish.clearcoat_roughness_texture, "roughness of the clear coat");
        self.take(&mut finish.clearcoat_normal_texture, "normals of the clear coat");
        if self.take(&mut finish.sheen_color_texture, "sheen") {
            finish.sheen_color = Vec3::ZERO;
        }
        self.take(&mut finish.sheen_roughness_texture, "roughness of the sheen");
        if self.take(&mut finish.anisotropy_texture, "anisotropy") {
            finish.anisotropy = 0.0;
        }
        if self.take(&mut finish.iridescence_texture, "iridescence") {
            finish.iridescence = 0.0;
        }
        self.take(&mut finish.film_thickness_texture, "thickness of the film");
        if self.take(&mut finish.diffuse_transmission_texture, "diffuse transmission") {
            finish.diffuse_transmission = 0.0;
        }
        if self.take(&mut finish.diffuse_transmission_color_texture, "color of diffuse transmission") {
            finish.diffuse_transmission = 0.0;
        }
    }
}
