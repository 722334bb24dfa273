//! Glass and wax with a thickness whose shape has none: an open sheet, which light enters and never leaves. Programs that draw without
//! rays take the number for the glass; here the shape is traced.

use std::collections::BTreeMap;

use glam::Vec3;

use crate::bsdf::is_matched;
use crate::bvh::Ray;
use crate::prepared::{PreparedScene, SurfaceHit};
use crate::sampler::Sampler;
use crate::scene::Material;

/// Triangles of a body of glass from which it is looked for other glass, about.
const LOOKS: usize = 32;
/// Names that are told.
const MOST_NAMED: usize = 3;

/// A sentence that names nodes of which no ray into the glass finds the way out.
pub(crate) fn warning(scene: &PreparedScene) -> Option<String> {
    let mut glass: BTreeMap<u32, Vec<u32>> = BTreeMap::new();
    for (triangle, &node) in (0..).zip(&scene.scene.mesh.triangle_node) {
        if is_solid(scene.material(triangle)) {
            glass.entry(node).or_default().push(triangle);
        }
    }
    let is_open = |triangles: &[u32]| !some_of(triangles).any(|triangle| has_other_side(scene, triangle));
    let (mut open, mut is_clear) = (Vec::new(), true);
    for (node, triangles) in glass.into_iter().filter(|(_, triangles)| is_open(triangles)) {
        open.push(format!("`{}`", scene.scene.nodes[node as usize].key()));
        is_clear &= triangles.iter().all(|&triangle| scene.material(triangle).transmission > 0.0);
    }
    (!open.is_empty()).then(|| {
        format!(
            "the {} of {} has a thickness and an open shape, or faces turned inward: light goes in and never comes out, {}colored as by \
             a block; close the shape, turn its faces, or set the thickness to 0",
            if is_clear { "glass" } else { "translucent material" },
            named(&open),
            if is_clear { "bent and " } else { "" }
        )
    })
}

/// Triangles of a body from which it is looked for other glass, all over it.
pub(crate) fn some_of(triangles: &[u32]) -> impl ExactSizeIterator<Item = u32> {
    triangles.iter().copied().step_by(triangles.len().div_ceil(LOOKS).max(1))
}

/// The first of some names, and how many more there are.
pub(crate) fn named(names: &[String]) -> String {
    let first = names[..names.len().min(MOST_NAMED)].join(", ");
    match names.len().saturating_sub(MOST_NAMED) {
        0 => first,
        n_more => format!("{first} and {n_more} more"),
    }
}

/// Whether light that passes a surface goes on within a body that changes it.
pub(crate) fn is_solid(material: &Material) -> bool {
    let attenuates = material.attenuation_distance.is_finite();
    let bends = material.transmission > 0.0 && !is_matched(material.ior);
    let changes_light = bends || attenuates && material.transmits();
    !material.unlit && material.thickness > 0.0 && changes_light
}

/// Whether a ray straight into the body behind a triangle meets glass from within.
fn has_other_side(scene: &PreparedScene, triangle: u32) -> bool {
    let inward = -scene.scene.mesh.area_normal(triangle).normalize_or_zero();
    met_from_within(scene, triangle, inward).is_some()
}

/// The glass that a ray off the middle of a triangle, in a direction across it, meets first and from within.
pub(crate) fn met_from_within(scene: &PreparedScene, triangle: u32, direction: Vec3) -> Option<SurfaceHit> {
    let [a, b, c] = scene.scene.mesh.corners(triangle);
    let origin = scene.off_triangle(triangle, (a + b + c) / 3.0, direction);
    let ray = Ray { origin, direction, t_min: 0.0, t_max: f32::INFINITY };
    let hit = scene.closest(&ray, &mut Sampler::new(0, u64::from(triangle), 0))?;
    let is_within = hit.normal.dot(direction) > 0.0 && is_solid(scene.material(hit.triangle));
    is_within.then_some(hit)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::Camera;
    use crate::laws::stage::{Stage, lambert, pane, quad, room};
    use crate::scene::Finish;

    /// What is told of glass between a camera and a wall.
    fn told(corners: &[Vec3], glass: Material) -> Option<String> {
        let camera = Camera::look_at("eye", Vec3::Z * 9.0, Vec3::ZERO, 1.0, 1.0);
        let wall = quad(Vec3::new(-5.0, -5.0, -3.0), Vec3::X * 10.0, Vec3::Y * 10.0);
        let stage = Stage::new(camera).surface("window", corners, glass).surface("wall", &wall, lambert(0.5, 0.0));
        warning(&stage.prepared())
    }

    #[test]
    fn glass_with_a_thickness_that_is_an_open_sheet_or_inside_out_is_named() {
        let (sheet, inward) = (quad(Vec3::new(-1.0, -1.0, 0.0), Vec3::X * 2.0, Vec3::Y * 2.0), room(Vec3::splat(0.5)));
        let outward: Vec<Vec3> = inward.chunks_exact(3).flat_map(|t| [t[0], t[2], t[1]]).collect();
        let block = || Material { thickness: 0.1, ..pane() };
        let tinted = Material { ior: 1.0, attenuation_distance: 0.5, ..block() };
        for (corners, glass) in [(&sheet, block()), (&inward, block()), (&sheet, tinted)] {
            let words = told(corners, glass).expect("it is open");
            assert!(words.contains("the glass of `window` has a thickness"), "{words}");
        }
        let clear = Material { ior: 1.0, ..block() };
        for (corners, glass) in [(&sheet, pane()), (&outward, block()), (&sheet, clear)] {
            assert_eq!(told(corners, glass), None);
        }
    }

    #[test]
    fn wax_that_attenuates_and_is_an_open_sheet_is_named() {
        let (sheet, inward) = (quad(Vec3::new(-1.0, -1.0, 0.0), Vec3::X * 2.0, Vec3::Y * 2.0), room(Vec3::splat(0.5)));
        let outward: Vec<Vec3> = inward.chunks_exact(3).flat_map(|t| [t[0], t[2], t[1]]).collect();
        let leaf = || Box::new(Finish { diffuse_transmission: 0.5, ..Finish::default() });
        let wax = || Material { thickness: 0.01, finish: Some(leaf()), ..lambert(0.5, 0.0) };
        let tinted = || Material { attenuation_distance: 0.1, ..wax() };
        let words = told(&sheet, tinted()).expect("it is open");
        assert!(words.contains("the translucent material of `window` has a thickness"), "{words}");
        for (corners, wax) in [(&outward, tinted()), (&sheet, wax()), (&sheet, Material { thickness: 0.0, ..tinted() })]
        {
            assert_eq!(told(corners, wax), None);
        }
    }
}
