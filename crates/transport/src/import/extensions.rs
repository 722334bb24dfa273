//! Which extensions of a file are honored, in words.

use gltf::json::{Material, Root};

use super::ImportError;
use super::document::shown;
use super::report::Notes;
use super::variants::{VARIANTS, names};

/// Extensions that are honored, or approximated with a line of their own.
const HONORED: &[&str] = &[
    "EXT_lights_ies",
    "EXT_mesh_gpu_instancing",
    "EXT_meshopt_compression",
    "EXT_texture_webp",
    "KHR_lights_punctual",
    "KHR_materials_anisotropy",
    "KHR_materials_clearcoat",
    "KHR_materials_diffuse_transmission",
    "KHR_materials_emissive_strength",
    "KHR_materials_ior",
    "KHR_materials_iridescence",
    "KHR_materials_pbrSpecularGlossiness",
    "KHR_materials_sheen",
    "KHR_materials_specular",
    "KHR_materials_transmission",
    "KHR_materials_unlit",
    "KHR_materials_volume",
    "KHR_mesh_quantization",
    "KHR_meshopt_compression",
    "KHR_node_visibility",
    "KHR_texture_transform",
];

/// Extensions that change nothing in the picture.
const WITHOUT_EFFECT: &[&str] = &[
    "EXT_instance_features",
    "EXT_mesh_features",
    "EXT_structural_metadata",
    "FB_geometry_metadata",
    "KHR_draco_mesh_compression",
    "KHR_interactivity",
    "KHR_node_hoverability",
    "KHR_node_selectability",
    "KHR_xmp",
    "KHR_xmp_json_ld",
];

/// What a known extension would have done, for the report.
const LEFT_OUT: &[(&str, &str)] = &[
    ("EPIC_hdri_backdrops", "its backdrop and the light of that are left out; give the picture as a sky"),
    ("EPIC_sky_spheres", "its sky and the light of that are left out; give it a sky here"),
    ("EXT_lights_image_based", "its environment light is left out"),
    ("EXT_texture_avif", "AVIF textures without a PNG or JPEG twin are a checkerboard as base color, else left out"),
    ("KHR_animation_pointer", "animations are not played"),
    ("KHR_lights", "its lights are left out; export them as KHR_lights_punctual"),
    ("KHR_lights_common", "its lights are left out; export them as KHR_lights_punctual"),
    ("KHR_materials_dispersion", "glass does not split colors"),
    (VARIANTS, "the materials that the file shows by default are shown"),
    ("KHR_texture_basisu", "KTX2 textures without a PNG or JPEG twin are a checkerboard as base color, else left out"),
    (
        "MOZ_hubs_components",
        "its components are left out, lights and skies among them; export lights as KHR_lights_punctual",
    ),
    ("MSFT_texture_dds", "DDS textures without a PNG or JPEG twin are a checkerboard as base color, else left out"),
];

/// Said of an extension without which glTF lets a program refuse the file; what can be shown is shown.
const REQUIRED: &str = "; the file requires it, so it may look quite different there";

/// Names of all extensions that something is said about.
#[cfg(test)]
pub(super) fn known() -> Vec<&'static str> {
    let left_out = LEFT_OUT.iter().map(|(name, _)| *name);
    HONORED.iter().chain(WITHOUT_EFFECT).copied().chain(left_out).collect()
}

/// Refuses files whose geometry cannot be read and lists what else is not shown.
///
/// # Errors
/// When a compression is required that cannot be undone here.
pub(super) fn check(name: &str, document: &Root, has_variant: bool, notes: &mut Notes) -> Result<(), ImportError> {
    if let Some(extension) = document.extensions_required.iter().find(|name| *name == "KHR_draco_mesh_compression") {
        return Err(ImportError::Extension {
            name: name.to_owned(),
            extension: extension.clone(),
            remedy: "export it again without Draco compression, or run `gltf-transform copy IN.glb OUT.glb`".to_owned(),
        });
    }
    let of_materials = document.materials.iter().filter_map(|material| material.extensions.as_ref());
    // Not all that materials use is listed by every program.
    let unlisted = of_materials.flat_map(|all| all.others.keys());
    let listed = document.extensions_used.iter().chain(&document.extensions_required);
    let mut names: Vec<&String> = listed.chain(unlisted).collect();
    names.sort();
    names.dedup();
    for extension in names {
        let known = extension.as_str();
        if HONORED.contains(&known) || WITHOUT_EFFECT.contains(&known) || (has_variant && known == VARIANTS) {
            continue;
        }
        let effect = LEFT_OUT.iter().find(|(name, _)| *name == known).map_or("it is ignored", |(_, effect)| effect);
        let whose = if known == VARIANTS { variants(document) } else { users(document, known) };
        let required = if document.extensions_required.contains(extension) { REQUIRED } else { "" };
        notes.unsupported(format!("{extension}: {effect}{whose}{required}"));
    }
    Ok(())
}

/// `, not those of "a", "b" and 3 more`, or nothing if the file names no variants.
fn variants(document: &Root) -> String {
    let names: Vec<String> = names(document).into_iter().map(|name| shown(&name)).collect();
    match names.len() {
        0 => String::new(),
        1..=4 => format!(", not those of {}", names.join(", ")),
        _ => format!(", not those of {} and {} more", names[..3].join(", "), names[3..].len()),
    }
}

/// ` (materials "a", "b" and 3 more)`, or nothing if no material uses the extension.
fn users(document: &Root, extension: &str) -> String {
    let named = |(index, material): (usize, &Material)| match &material.name {
        Some(name) if !name.is_empty() => shown(name),
        _ => index.to_string(),
    };
    let users: Vec<String> = document
        .materials
        .iter()
        .enumerate()
        .filter(|(_, material)| material.extensions.as_ref().is_some_and(|all| all.others.contains_key(extension)))
        .map(named)
        .collect();
    match users.len() {
        0 => String::new(),
        1 => format!(" (material {})", users[0]),
        2..=4 => format!(" (materials {})", users.join(", ")),
        _ => format!(" (materials {} and {} more)", users[..3].join(", "), users[3..].len()),
    }
}
