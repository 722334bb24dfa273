//! Materials that may be seen through and never are: programs mark a whole group of them, or glass whose transmission lets light pass
//! already. As opaque ones they can be panels, panes with a thickness and walls, and nobody asks for their alpha.

use crate::scene::{AlphaMode, Material, Scene, Texture};

/// Makes materials opaque of which every point is there.
pub(super) fn settle(scene: &mut Scene) {
    if scene.materials.iter().all(|material| material.alpha == AlphaMode::Opaque) {
        return;
    }
    let of_vertices = least_of_vertices(scene);
    for (material, of_vertices) in scene.materials.iter_mut().zip(of_vertices) {
        let needed = match material.alpha {
            AlphaMode::Opaque => continue,
            AlphaMode::Mask { cutoff } => cutoff,
            AlphaMode::Blend => 1.0,
        };
        if material.base_color.w * of_vertices * least_of_texture(material, &scene.textures) >= needed {
            material.alpha = AlphaMode::Opaque;
        }
    }
}

/// The least alpha of the vertices of each material.
fn least_of_vertices(scene: &Scene) -> Vec<f32> {
    let (mesh, mut least) = (&scene.mesh, vec![1.0; scene.materials.len()]);
    if mesh.colors.is_empty() {
        return least;
    }
    for (triangle, &material) in mesh.triangles.iter().zip(&mesh.triangle_material) {
        let least = &mut least[material as usize];
        *least = triangle.iter().fold(*least, |least: f32, &v| least.min(mesh.colors[v as usize].w));
    }
    least
}

fn least_of_texture(material: &Material, textures: &[Texture]) -> f32 {
    let texture = material.base_color_texture.and_then(|map| textures.get(map.texture as usize));
    let least = texture.and_then(|texture| texture.image.texels.iter().map(|texel| texel[3]).min());
    f32::from(least.unwrap_or(u8::MAX)) / 255.0
}
