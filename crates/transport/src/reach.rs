//! Lights that can reach nothing of what a camera sees, however often light is scattered: nobody connects to them.
//!
//! A light is left out only if that is proven: closed opaque walls lie between it and the camera (see `walls`), every
//! surface of the scene lies behind it or beside its cone, or it has no strength that a look could turn up. A few walks look
//! first at what they reach; they can only keep a light, never leave one out. Should rounding prove too much, walks that
//! meet the light by themselves still count in full.
//!
//! By the same walls surfaces are found that no light of the picture meets: a later bake does not ask whether they moved.

mod walls;

use std::f32::consts::FRAC_PI_2;

use glam::{DVec3, Vec3};

use self::walls::{Walls, is_clear_of_box};
use crate::basis::SourceKind;
use crate::bvh::Ray;
use crate::emitters::{Emitter, punctual_falloff};
use crate::prepared::{PreparedScene, next_after};
use crate::sampler::{Sampler, uniform_sphere};
use crate::scene::{PunctualKind, PunctualLight};
use crate::skips::{Skip, Spared};
use crate::streams::Stream;

/// Walks that look for light, and surfaces that each of them meets.
const WALKS: u32 = 64;
const SURFACES: u32 = 8;
/// Triangles of a light times those of the scene up to which it is asked whether it looks away from all of them.
const MOST_PAIRS: usize = 1 << 26;
/// Stream of random numbers that nobody else uses.
const STREAM: u64 = Stream::Reach.first();

impl PreparedScene {
    /// What is found needless of the scene itself, and the lights that light nothing of what is seen from `eye`.
    pub fn spared_from(&self, eye: Vec3) -> Spared {
        Spared { dark_sources: dark_sources(self, eye), ..self.spared() }
    }
}

/// Indices of the sources that light nothing of what is seen from `eye`, in order.
pub(crate) fn dark_sources(scene: &PreparedScene, eye: Vec3) -> Vec<u32> {
    let lighting = &scene.lighting;
    let mut asked: Vec<usize> = (0..lighting.emitters.len()).filter(|&source| can_be_dark(scene, source)).collect();
    let mut dark: Vec<usize> = asked.iter().copied().filter(|&source| is_never_on(scene, source)).collect();
    asked.retain(|source| !dark.contains(source));
    scout(scene, eye, &mut asked);
    let (averted, rest): (Vec<usize>, Vec<usize>) =
        asked.into_iter().partition(|&source| looks_at_nothing(scene, &lighting.emitters[source]));
    dark.extend(averted);
    if !rest.is_empty() {
        let walls = Walls::around(scene, eye);
        dark.extend(rest.into_iter().filter(|&source| is_walled_off(&walls, &lighting.emitters[source])));
    }
    dark.sort_unstable();
    dark.into_iter().map(|source| source as u32).collect()
}

/// Of each triangle whether closed walls around the eye keep it out, so that it changes nothing of what is seen from there; `None`
/// where they keep none out.
pub(crate) fn shut_out(scene: &PreparedScene, eye: Vec3) -> Option<Vec<bool>> {
    let mesh = &scene.scene.mesh;
    // Closed walls lie around all that lines out of the eye end at.
    let in_sight = walls_in_sight(scene, eye)?;
    if !(0..mesh.triangles.len() as u32).any(|triangle| is_clear_of_box(mesh.corners(triangle), in_sight)) {
        return None;
    }
    let out = Walls::around(scene, eye).shut_out(mesh);
    out.contains(&true).then_some(out)
}

/// The box around the walls that lines out of the eye end at; `None` where one ends at none.
fn walls_in_sight(scene: &PreparedScene, eye: Vec3) -> Option<[DVec3; 2]> {
    let [mut low, mut high] = [eye.as_dvec3(); 2];
    for walk in 0..WALKS {
        let mut sampler = Sampler::new(0, STREAM, walk);
        let direction = uniform_sphere(sampler.next_2d());
        let mut ray = Ray { origin: eye, direction, t_min: 0.0, t_max: f32::INFINITY };
        let mut hit = scene.closest(&ray, &mut sampler)?;
        while !scene.is_wall(hit.triangle) {
            ray.t_min = next_after(hit.t);
            hit = scene.closest(&ray, &mut sampler)?;
        }
        let end = hit.position.as_dvec3();
        (low, high) = (low.min(end), high.max(end));
    }
    Some([low, high])
}

/// Whether a source shines from beyond all surfaces.
pub(crate) fn is_beyond(kind: SourceKind) -> bool {
    matches!(kind, SourceKind::Sky | SourceKind::Dome { .. } | SourceKind::Sun { .. } | SourceKind::Directional)
}

/// Whether somebody connects to the source, and may leave it out.
fn can_be_dark(scene: &PreparedScene, source: usize) -> bool {
    let kind = if is_beyond(scene.lighting.basis.sources[source].kind) { Skip::ClosedSky } else { Skip::DarkLamps };
    scene.skips.has(kind)
        && !matches!(scene.lighting.emitters[source], Emitter::Sky | Emitter::Constant | Emitter::Lamp(_))
}

/// Lamps of no strength: a look multiplies it.
fn is_never_on(scene: &PreparedScene, source: usize) -> bool {
    matches!(scene.lighting.emitters[source], Emitter::Punctual(_))
        && scene.lighting.basis.sources[source].strength == 0.0
}

/// Strikes out the sources that some walks reach.
fn scout(scene: &PreparedScene, eye: Vec3, asked: &mut Vec<usize>) {
    for walk in 0..WALKS {
        let mut sampler = Sampler::new(0, STREAM, walk);
        let (mut origin, mut direction) = (eye, uniform_sphere(sampler.next_2d()));
        for _ in 0..SURFACES {
            if asked.is_empty() {
                return;
            }
            let ray = Ray { origin, direction, t_min: 0.0, t_max: f32::INFINITY };
            let Some(hit) = scene.closest(&ray, &mut sampler) else {
                asked.retain(|&source| !is_beyond(scene.lighting.basis.sources[source].kind));
                break;
            };
            let outward = hit.outward(-direction);
            origin = hit.origin(outward);
            let u = sampler.next_2d();
            asked.retain(|&source| {
                let target = seen_point(scene, &scene.lighting.emitters[source], hit.position, u);
                target.is_none_or(|target| scene.transmittance(origin, target) == Vec3::ZERO)
            });
            direction = uniform_sphere(sampler.next_2d());
            // Through what lets light pass the walk may go on, through walls it may not.
            if direction.dot(outward) < 0.0 {
                if scene.is_wall(hit.triangle) {
                    direction = -direction;
                } else {
                    origin = hit.origin(-outward);
                }
            }
        }
    }
}

/// A point of a lamp that shines on a position; `None` where it does not, or has no place.
fn seen_point(scene: &PreparedScene, emitter: &Emitter, position: Vec3, u: [f32; 2]) -> Option<Vec3> {
    let (target, normal, double_sided) = match emitter {
        Emitter::Punctual(light) if light.kind != PunctualKind::Directional => {
            let toward = (position - light.position).normalize_or_zero();
            let shines = punctual_falloff(light, &scene.scene.profiles, toward) > 0.0;
            return shines.then_some(light.position);
        }
        Emitter::Punctual(light) => return Some(position - light.direction * 4.0 * scene.diameter()),
        Emitter::Panel(panel) => (panel.point(u.into()), panel.normal, panel.double_sided),
        Emitter::Surface(surface) => {
            let point = surface.sample(u.into());
            (point.position, point.normal, point.double_sided)
        }
        _ => return None,
    };
    (double_sided || (position - target).dot(normal) > 0.0).then_some(target)
}

/// Whether no surface lies where the light shines.
fn looks_at_nothing(scene: &PreparedScene, emitter: &Emitter) -> bool {
    let mesh = &scene.scene.mesh;
    let vertices = || mesh.triangles.iter().flatten().map(|&v| mesh.positions[v as usize]);
    match emitter {
        Emitter::Panel(panel) => {
            !panel.double_sided && vertices().all(|vertex| is_behind(vertex, panel.origin, panel.normal))
        }
        Emitter::Surface(surface) => {
            surface.triangles.len() * mesh.triangles.len() < MOST_PAIRS
                && surface.all_triangles(|corner, normal, double_sided| {
                    !double_sided && vertices().all(|vertex| is_behind(vertex, corner, normal))
                })
        }
        Emitter::Punctual(light) => match light.kind {
            PunctualKind::Spot { outer_rad, .. } if light.profile.is_none() && outer_rad <= FRAC_PI_2 => {
                (0..mesh.triangles.len() as u32).all(|t| is_beside_cone(mesh.corners(t), light, outer_rad))
            }
            _ => false,
        },
        _ => false,
    }
}

/// Whether a point is not in front of a plane, but for what rounding does to coordinates of their size.
fn is_behind(point: Vec3, on_plane: Vec3, normal: Vec3) -> bool {
    let size = point.abs().max(on_plane.abs()).max_element();
    (point - on_plane).dot(normal) <= 8.0 * f32::EPSILON * size
}

/// Whether a triangle lies behind a lamp's cone, or the ball around it beside that.
fn is_beside_cone(corners: [Vec3; 3], light: &PunctualLight, outer_rad: f32) -> bool {
    if corners.into_iter().all(|corner| is_behind(corner, light.position, light.direction)) {
        return true;
    }
    let corners = corners.map(Vec3::as_dvec3);
    let center = (corners[0] + corners[1] + corners[2]) / 3.0;
    let radius = corners.iter().map(|corner| corner.distance(center)).fold(0.0, f64::max);
    let from_apex = center - light.position.as_dvec3();
    let along = from_apex.dot(light.direction.as_dvec3());
    let across = (from_apex.length_squared() - along * along).max(0.0).sqrt();
    let (sin, cos) = f64::from(outer_rad).sin_cos();
    // The distance from the cone, or less than that behind its apex.
    across * cos - along * sin > 1.0001 * radius + 1e-5 * from_apex.length()
}

/// Whether closed walls lie between the eye and a light.
fn is_walled_off(walls: &Walls, emitter: &Emitter) -> bool {
    match emitter {
        Emitter::Punctual(light) if light.kind != PunctualKind::Directional => {
            walls.keep_apart(light.position.as_dvec3(), 0.0)
        }
        Emitter::Punctual(_) | Emitter::Environment(_) | Emitter::Dome(_) | Emitter::Sun(_) => walls.are_closed(),
        Emitter::Panel(panel) => {
            let center = (panel.origin + 0.5 * (panel.u_edge + panel.v_edge)).as_dvec3();
            let radius = 0.5 * f64::from(panel.u_edge.length() + panel.v_edge.length());
            walls.keep_apart(center, radius)
        }
        Emitter::Surface(surface) => {
            let center = surface.center().as_dvec3();
            let radius = surface.corners().map(|corner| corner.as_dvec3().distance(center)).fold(0.0, f64::max);
            walls.keep_apart(center, radius)
        }
        Emitter::Sky | Emitter::Constant | Emitter::Lamp(_) => false,
    }
}
