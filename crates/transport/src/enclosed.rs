//! Lights in closed opaque bodies, a bulb, a shade or a housing: drawn for programs without shadows, they light nothing here. So do
//! bodies that shine and have their faces turned inward.

use std::collections::BTreeMap;
use std::f32::consts::TAU;

use glam::{Quat, Vec2, Vec3};

use crate::bvh::Ray;
use crate::emitters::{Emitter, punctual_falloff};
use crate::prepared::{PreparedScene, SurfaceHit};
use crate::sampler::{Sampler, cosine_around, uniform_sphere};
use crate::scene::{PunctualKind, PunctualLight};
use crate::streams::Stream;

/// Directions that are looked into from a lamp: few tell most apart, more find narrow openings.
const DIRECTIONS: [u32; 2] = [64, 512];
/// The same from a surface that shines, which lies at the end of a tube in many a housing.
const DIRECTIONS_OF_SURFACES: [u32; 2] = [64, 2048];
/// How far off its walls may be: m, and share of the diagonal of the scene. What is larger is a room.
const MOST_M: f32 = 2.0;
const MOST_OF_EXTENT: f32 = 0.15;
/// Stream of random numbers that nobody else uses.
const STREAM: u64 = Stream::Enclosed.first();
/// The same for where walls throw light.
const STREAM_OF_WALLS: u64 = STREAM | 1;

/// Where rays begin, and whereto.
type Rays<'a> = Box<dyn Iterator<Item = [Vec3; 2]> + 'a>;

/// A warning for each light that is closed in, with the node around it.
pub(crate) fn warnings(scene: &PreparedScene) -> Vec<String> {
    let lights = scene.lighting.emitters.iter().zip(&scene.lighting.basis.sources);
    let words = lights.filter_map(|(emitter, source)| {
        let (node, key) = (around(scene, emitter)?, &source.key);
        Some(if own_node(scene, emitter) == Some(node) {
            format!(
                "light `{key}` shines onto its own mesh alone, so that it lights nothing around: turn its faces round or make its \
                 material double-sided, or make what is around it glass"
            )
        } else {
            format!(
                "light `{key}` is closed in by `{}`, so that it lights nothing around: make that glass or leave it open, or put the lamp \
                 outside of it",
                scene.scene.nodes[node as usize].key()
            )
        })
    });
    words.collect()
}

/// The node of a surface that shines.
fn own_node(scene: &PreparedScene, emitter: &Emitter) -> Option<u32> {
    let triangle = match emitter {
        Emitter::Surface(surface) => surface.triangles.first()?.triangle,
        Emitter::Panel(panel) => panel.triangle,
        _ => return None,
    };
    Some(scene.scene.mesh.triangle_node[triangle as usize])
}

/// The node of most of the walls that stand around a light close by; `None` if light of it comes out, or comes far, also when walls
/// have thrown it back.
fn around(scene: &PreparedScene, emitter: &Emitter) -> Option<u32> {
    let [few, many] = match emitter {
        Emitter::Punctual(_) => DIRECTIONS,
        _ => DIRECTIONS_OF_SURFACES,
    };
    walls(scene, rays(scene, emitter, few)?)?;
    let nodes = walls(scene, rays(scene, emitter, many)?)?;
    nodes.into_iter().max_by_key(|(_, n_hits)| *n_hits).map(|(node, _)| node)
}

/// Rays to where a light shines; `None` if it is off or comes from beyond all surfaces.
fn rays<'a>(scene: &'a PreparedScene, emitter: &'a Emitter, n_rays: u32) -> Option<Rays<'a>> {
    let sampler = |nth| Sampler::new(0, STREAM, nth);
    let rays: Rays<'a> = match emitter {
        Emitter::Punctual(light) if light.kind != PunctualKind::Directional && light.intensity > 0.0 => {
            let shines = move |toward: &Vec3| punctual_falloff(light, &scene.scene.profiles, *toward) > 0.0;
            Box::new(directions(light, n_rays).filter(shines).map(move |toward| [light.position, toward]))
        }
        Emitter::Surface(surface) => Box::new((0..n_rays).map(move |nth| {
            let mut sampler = sampler(nth);
            let point = surface.sample(Vec2::from(sampler.next_2d()));
            leaving(scene, point.triangle, point.position, uniform_sphere(sampler.next_2d()))
        })),
        Emitter::Panel(panel) => Box::new((0..n_rays).map(move |nth| {
            let mut sampler = sampler(nth);
            let position = panel.point(Vec2::from(sampler.next_2d()));
            leaving(scene, panel.triangle, position, uniform_sphere(sampler.next_2d()))
        })),
        _ => return None,
    };
    Some(rays)
}

/// A ray off a point of a triangle: what would leave the back of a single-sided one leaves its front, the other way.
fn leaving(scene: &PreparedScene, triangle: u32, position: Vec3, toward: Vec3) -> [Vec3; 2] {
    let [a, b, c] = scene.scene.mesh.corners(triangle);
    let front = (b - a).cross(c - a).normalize_or(Vec3::Y);
    let turned = toward.dot(front) < 0.0 && !scene.material(triangle).double_sided;
    let toward = if turned { -toward } else { toward };
    let outward = if toward.dot(front) < 0.0 { -front } else { front };
    [scene.off_triangle(triangle, position, outward), toward]
}

/// How often rays meet walls of each node; `None` if one meets none, or if what a wall throws back comes out: a spot over a table
/// shines onto the table alone, and lights the room.
fn walls(scene: &PreparedScene, rays: Rays) -> Option<BTreeMap<u32, u32>> {
    let most_m = MOST_M.min(MOST_OF_EXTENT * scene.extent());
    let mut nodes: BTreeMap<u32, u32> = BTreeMap::new();
    for (nth, [origin, direction]) in (0_u32..).zip(rays) {
        let met = wall(scene, nth, &Ray { origin, direction, t_min: 0.0, t_max: most_m })?;
        let outward = met.outward(-direction);
        let thrown = cosine_around(outward, Sampler::new(0, STREAM_OF_WALLS, nth).next_2d());
        let ray = Ray { origin: met.origin(outward), direction: thrown, t_min: 0.0, t_max: 2.0 * most_m };
        if wall(scene, nth, &ray)?.position.distance(origin) > most_m {
            return None;
        }
        *nodes.entry(scene.scene.mesh.triangle_node[met.triangle as usize]).or_default() += 1;
    }
    Some(nodes)
}

/// The wall that a ray meets; `None` if it meets nothing, or what lets light pass.
fn wall(scene: &PreparedScene, nth: u32, ray: &Ray) -> Option<SurfaceHit> {
    scene.closest(ray, &mut Sampler::new(0, u64::from(nth), 0)).filter(|hit| scene.is_wall(hit.triangle))
}

/// Directions evenly spread over the cone of a spot, and all around other lamps.
pub(crate) fn directions(light: &PunctualLight, n_rays: u32) -> impl Iterator<Item = Vec3> {
    const GOLDEN: f32 = 0.618_034;
    let (axis, end) = match light.kind {
        PunctualKind::Spot { outer_rad, .. } if light.profile.is_none() => (light.direction, outer_rad.cos()),
        _ => (Vec3::Y, -1.0),
    };
    let turn = Quat::from_rotation_arc(Vec3::Y, axis);
    (0..n_rays).map(move |nth| {
        let y = 1.0 - (1.0 - end) * (nth as f32 + 0.5) / n_rays as f32;
        let (sin, cos) = (TAU * GOLDEN * nth as f32).sin_cos();
        turn * (Vec3::new(cos, 0.0, sin) * (1.0 - y * y).max(0.0).sqrt() + Vec3::Y * y)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::Camera;
    use crate::laws::stage::{Stage, lambert, quad, room};
    use crate::scene::Material;

    /// A can of black walls, 1 m high and open by a square hole in its top, with a lamp on its floor, in a wide scene.
    fn can(hole_m: f32, kind: PunctualKind) -> Vec<String> {
        let (half, hole) = (0.3, 0.5 * hole_m);
        let camera = Camera::look_at("eye", Vec3::Z * 9.0, Vec3::ZERO, 1.0, 1.0);
        let mut walls = quad(Vec3::new(-half, -0.1, -half), Vec3::X * 2.0 * half, Vec3::Z * 2.0 * half);
        for turn in (0..4).map(|nth| Quat::from_rotation_y(0.25 * TAU * nth as f32)) {
            let side = quad(Vec3::new(-half, -0.1, half), Vec3::X * 2.0 * half, Vec3::Y * 1.1);
            let lid = quad(Vec3::new(-half, 1.0, hole), Vec3::X * (half + hole), Vec3::Z * (half - hole));
            walls.extend([side, lid].concat().into_iter().map(|corner| turn * corner));
        }
        let floor = quad(Vec3::new(-20.0, -1.0, -20.0), Vec3::X * 40.0, Vec3::Z * 40.0);
        let stage = Stage::new(camera).surface("can", &walls, lambert(0.0, 0.0));
        let stage = stage.surface("floor", &floor, lambert(0.5, 0.0)).lamp("lamp", Vec3::ZERO, 1.0);
        let mut scene = stage.into_scene();
        (scene.punctual[0].kind, scene.punctual[0].direction) = (kind, Vec3::Y);
        warnings(&PreparedScene::new(scene, &[]).expect("a lamp without panels").0)
    }

    #[test]
    fn a_lamp_that_shines_out_of_a_narrow_opening_is_not_closed_in() {
        let spot = PunctualKind::Spot { inner_rad: 0.02, outer_rad: 0.05 };
        for kind in [PunctualKind::Point, spot] {
            let closed = can(0.0, kind);
            assert!(closed.len() == 1 && closed[0].contains("`lamp` is closed in by `can`"), "{kind:?}: {closed:?}");
            assert_eq!(can(0.2, kind), Vec::<String>::new(), "{kind:?}");
        }
    }

    #[test]
    fn a_spot_whose_whole_cone_falls_on_something_close_by_is_not_closed_in() {
        let camera = Camera::look_at("eye", Vec3::Z * 3.0, Vec3::ZERO, 1.0, 1.0);
        let (hall, white) = (room(Vec3::new(5.0, 1.5, 4.0)), lambert(0.5, 0.0));
        let table = quad(Vec3::new(-1.0, -0.75, -0.6), Vec3::Z * 1.2, Vec3::X * 2.0);
        let floor = quad(Vec3::new(-20.0, -1.0, -20.0), Vec3::Z * 40.0, Vec3::X * 40.0);
        for (surface, at, aim) in [
            (&[&hall[..], &table[..]].concat(), Vec3::Y * 0.2, Vec3::NEG_Y),
            (&hall, Vec3::new(-4.2, 0.5, -1.0), Vec3::NEG_X),
            (&floor, Vec3::ZERO, Vec3::NEG_Y),
        ] {
            let stage = Stage::new(camera.clone()).surface("around", surface, white.clone()).lamp("lamp", at, 1.0);
            let mut scene = stage.into_scene();
            scene.punctual[0].kind = PunctualKind::Spot { inner_rad: 0.3, outer_rad: 0.45 };
            scene.punctual[0].direction = aim;
            let told = warnings(&PreparedScene::new(scene, &[]).expect("a lamp without panels").0);
            assert_eq!(told, Vec::<String>::new(), "{at}");
        }
    }

    /// What is told of a bulb that shines, a box within another surface and high above a wide floor.
    fn bulb(corners: &[Vec3], material: Material, around: &[Vec3]) -> Vec<String> {
        let camera = Camera::look_at("eye", Vec3::Z * 9.0, Vec3::ZERO, 1.0, 1.0);
        let floor = quad(Vec3::new(-20.0, -5.0, -20.0), Vec3::Z * 40.0, Vec3::X * 40.0);
        let stage = Stage::new(camera).surface("bulb", corners, material);
        let stage = stage.surface("shade", around, lambert(0.5, 0.0)).surface("floor", &floor, lambert(0.5, 0.0));
        warnings(&PreparedScene::new(stage.into_scene(), &[]).expect("lights without panels").0)
    }

    #[test]
    fn a_bulb_that_shines_inward_or_in_a_closed_shade_is_named() {
        let (inward, shade) = (room(Vec3::splat(0.05)), room(Vec3::splat(0.2)));
        let outward: Vec<Vec3> = inward.chunks_exact(3).flat_map(|t| [t[0], t[2], t[1]]).collect();
        let shining = || lambert(0.0, 5.0);
        let closed = bulb(&outward, shining(), &shade);
        assert!(closed.len() == 1 && closed[0].contains("`bulb` is closed in by `shade`"), "{closed:?}");
        let turned = bulb(&inward, shining(), &[]);
        assert!(turned.len() == 1 && turned[0].contains("`bulb` shines onto its own mesh alone"), "{turned:?}");
        let both_sides = Material { double_sided: true, ..shining() };
        for (corners, material, around) in [
            (&outward, shining(), &shade[..0]),
            (&outward, shining(), &shade[..30]),
            (&inward, both_sides, &shade[..0]),
        ] {
            assert_eq!(bulb(corners, material, around), Vec::<String>::new());
        }
    }

    #[test]
    fn a_panel_in_a_closed_shade_is_named() {
        let camera = Camera::look_at("eye", Vec3::Z * 9.0, Vec3::ZERO, 1.0, 1.0);
        let panel = quad(Vec3::new(-0.1, 0.0, -0.1), Vec3::X * 0.2, Vec3::Z * 0.2);
        let floor = quad(Vec3::new(-20.0, -5.0, -20.0), Vec3::Z * 40.0, Vec3::X * 40.0);
        for (shade, n_told) in [(Vec3::splat(0.2), 1), (Vec3::new(9.0, 4.0, 9.0), 0)] {
            let stage = Stage::new(camera.clone()).panel("panel", &panel, 5.0, 4);
            let stage = stage.surface("shade", &room(shade), lambert(0.5, 0.0));
            let stage = stage.surface("floor", &floor, lambert(0.5, 0.0));
            let told = warnings(&PreparedScene::new(stage.into_scene(), &[]).expect("a panel").0);
            assert!(
                told.len() == n_told && told.iter().all(|words| words.contains("`panel` is closed in")),
                "{told:?}"
            );
        }
    }
}
