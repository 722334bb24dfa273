//! Solids of glass within each other: ice in a drink, a drink in a glass. A walk knows the one solid that it entered last, so that
//! each bends light as if it were in air, and behind the inner one the outer one takes no more of it.

use std::collections::{BTreeMap, BTreeSet};

use crate::prepared::PreparedScene;
use crate::sheets::{is_solid, met_from_within, named, some_of};

/// Node and material of a solid.
type Solid = (u32, u32);

/// A sentence that names solids whose surface lies within another solid.
pub(crate) fn warning(scene: &PreparedScene) -> Option<String> {
    let mut solids: BTreeMap<Solid, Vec<u32>> = BTreeMap::new();
    for triangle in 0..scene.scene.mesh.triangles.len() as u32 {
        if is_solid(scene.material(triangle)) {
            solids.entry(solid_of(scene, triangle)).or_default().push(triangle);
        }
    }
    let pairs = solids.into_iter().filter_map(|(inner, triangles)| Some((inner, around(scene, inner, &triangles)?)));
    // Copies of a body have one name.
    let pairs: BTreeSet<String> =
        pairs.map(|(inner, outer)| format!("{} within {}", called(scene, inner), called(scene, outer))).collect();
    let pairs: Vec<String> = pairs.into_iter().collect();
    (!pairs.is_empty()).then(|| {
        format!(
            "glass lies within glass ({}): each bends light as if it were in air, and behind the inner one the outer one colors it no \
             more; where that shows, leave a gap of air between them",
            named(&pairs)
        )
    })
}

fn solid_of(scene: &PreparedScene, triangle: u32) -> Solid {
    let mesh = &scene.scene.mesh;
    (mesh.triangle_node[triangle as usize], mesh.triangle_material[triangle as usize])
}

/// The name of its material, else of its node.
fn called(scene: &PreparedScene, (node, material): Solid) -> String {
    match scene.scene.materials[material as usize].name.as_str() {
        "" => format!("`{}`", scene.scene.nodes[node as usize].key()),
        name => format!("`{name}`"),
    }
}

/// The other solid in which half of the surface of one lies, or more.
fn around(scene: &PreparedScene, inner: Solid, triangles: &[u32]) -> Option<Solid> {
    let looks = some_of(triangles);
    let n_looks = looks.len();
    let mut found: BTreeMap<Solid, usize> = BTreeMap::new();
    for solid in looks.filter_map(|triangle| outside(scene, triangle)).filter(|solid| *solid != inner) {
        *found.entry(solid).or_default() += 1;
    }
    let (outer, n_within) = found.into_iter().max_by_key(|(_, n)| *n)?;
    (2 * n_within >= n_looks).then_some(outer)
}

/// The solid that lies before a triangle: a ray straight off its front meets that from within.
fn outside(scene: &PreparedScene, triangle: u32) -> Option<Solid> {
    let outward = scene.scene.mesh.area_normal(triangle).normalize_or_zero();
    met_from_within(scene, triangle, outward).map(|hit| solid_of(scene, hit.triangle))
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;
    use crate::camera::Camera;
    use crate::laws::stage::{Stage, lambert, pane, room};
    use crate::scene::Material;

    /// A box whose fronts look outward.
    fn block(half: f32) -> Vec<Vec3> {
        room(Vec3::splat(half)).chunks_exact(3).flat_map(|t| [t[0], t[2], t[1]]).collect()
    }

    fn glass(name: &str) -> Material {
        Material { name: name.into(), thickness: 0.1, ..pane() }
    }

    /// What is told of two bodies.
    fn told(inner: (&[Vec3], Material), outer: (&[Vec3], Material)) -> Option<String> {
        let stage = Stage::new(Camera::look_at("eye", Vec3::Z * 9.0, Vec3::ZERO, 1.0, 1.0));
        warning(&stage.surface("inner", inner.0, inner.1).surface("outer", outer.0, outer.1).prepared())
    }

    #[test]
    fn ice_in_a_drink_and_a_drink_that_reaches_into_its_glass_are_named() {
        let ice = told((&block(0.2), glass("ice")), (&block(0.5), glass("drink"))).expect("it lies within");
        assert!(ice.contains("(`ice` within `drink`)"), "{ice}");
        // Walls of glass from 0.4 to 0.5 around a hollow.
        let walls = [block(0.5), room(Vec3::splat(0.4))].concat();
        let drink = told((&block(0.45), glass("")), (&walls, glass("tumbler"))).expect("it reaches into the walls");
        assert!(drink.contains("(`inner` within `tumbler`)"), "{drink}");
    }

    #[test]
    fn glass_in_a_hollow_beside_glass_or_around_what_is_opaque_is_not_named() {
        let walls = [block(0.5), room(Vec3::splat(0.4))].concat();
        assert_eq!(told((&block(0.2), glass("ice")), (&walls, glass("tumbler"))), None);
        let aside: Vec<Vec3> = block(0.2).into_iter().map(|corner| corner + Vec3::X * 2.0).collect();
        assert_eq!(told((&aside, glass("ice")), (&block(0.5), glass("drink"))), None);
        assert_eq!(told((&block(0.2), lambert(0.5, 0.0)), (&block(0.5), glass("drink"))), None);
    }
}
