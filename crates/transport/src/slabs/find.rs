//! Finds the slabs of a scene: closed bodies of smooth glass whose greatest faces are flat and parallel.

use glam::{Vec2, Vec3, Vec4};

use super::{Bounds, Face, Facet, MOST_ASIDE, NONE, Outline, Slab, Slabs, Tree};
use crate::bsdf::{SurfaceParams, surface_params};
use crate::scene::{AlphaMode, Material, Mesh, Scene};

/// Thickness over the shorter extent of a face up to which a body is a pane and not a block.
const THINNEST_BLOCK: f32 = 0.5;
/// Span of a face across its plane over the extent of the body, up to which it is flat: files round places and normals.
const FLAT: f32 = 2e-3;
/// The same over its thickness.
const FLAT_IN_GLASS: f32 = 0.5;
/// Thickness over the extent of a body up to which it is none.
const THINNEST: f32 = 1e-5;
/// One minus the cosine between a face and its triangles, and these and their vertices, up to which they are parallel: about a
/// degree.
const LEVEL: f32 = 1.5e-4;
/// Error of a place over its largest coordinate.
pub(super) const ROUNDING: f32 = 4.0 * f32::EPSILON;

impl Slabs {
    /// All slabs of a scene.
    pub(crate) fn find(scene: &Scene) -> Slabs {
        let mesh = &scene.mesh;
        let is_glass = |t: &u32| refracts_smoothly(&scene.materials[mesh.triangle_material[*t as usize] as usize]);
        let glass: Vec<u32> = (0..mesh.triangles.len() as u32).filter(is_glass).collect();
        let mut slabs = Slabs::default();
        let own = |t: u32| (mesh.triangle_node[t as usize], mesh.triangle_material[t as usize]);
        for body in mesh.bodies(&glass, own) {
            if let Some(slab) = slab(scene, &body) {
                slabs.add(slab, mesh.triangles.len());
            }
        }
        let boxes: Vec<Bounds> = slabs.slabs.iter().map(|slab| slab.bounds).collect();
        slabs.tree = Tree::new(&boxes);
        slabs.look_inside(mesh);
        slabs
    }

    fn add(&mut self, slab: Slab, n_triangles: usize) {
        self.faces.resize(n_triangles, (NONE, Face::Back));
        for (face, facets) in [Face::Back, Face::Front].into_iter().zip(&slab.facets) {
            for facet in facets {
                self.faces[facet.triangle as usize] = (self.slabs.len() as u32, face);
            }
        }
        self.slabs.push(slab);
    }
}

/// Smooth solid glass that nothing bends but its shape.
fn refracts_smoothly(material: &Material) -> bool {
    let plain = material.finish.is_none() && material.normal_texture.is_none() && material.alpha == AlphaMode::Opaque;
    bends(material) && plain && crate::bsdf::is_mirror(material.roughness)
}

/// Glass that bends what passes, smooth or rough.
pub(super) fn bends(material: &Material) -> bool {
    let is_solid = material.thickness > 0.0 && !crate::bsdf::is_matched(material.ior) && material.ior > 1.0;
    !material.unlit && material.transmission > 0.0 && is_solid
}

/// The slab that a body is, if it is one.
fn slab(scene: &Scene, body: &[u32]) -> Option<Slab> {
    let (mesh, ior) = (&scene.mesh, material_of(scene, body).ior);
    let (triangles, normal) = faces(mesh, body)?;
    let bounds = around(mesh, body);
    let (outline, middle) = Outline::new(mesh, normal, &triangles, bounds.lo)?;
    let [back, front] = triangles.each_ref().map(|face| {
        let heights = face.iter().flat_map(|&t| mesh.corners(t)).map(|corner| (corner - middle).dot(normal));
        heights.fold([f32::INFINITY, f32::NEG_INFINITY], |[lo, hi], height| [lo.min(height), hi.max(height)])
    });
    let mean = |[lo, hi]: [f32; 2]| 0.5 * (lo + hi);
    let thickness = mean(front) - mean(back);
    let extent = (bounds.hi - bounds.lo).length();
    let rounding = ROUNDING * bounds.lo.abs().max(bounds.hi.abs()).max_element();
    let rough = (FLAT * extent + rounding).min(FLAT_IN_GLASS * thickness);
    let is_flat = [back, front].iter().all(|[lo, hi]| hi - lo <= rough);
    // Also where a number is none.
    let is_thick = thickness > THINNEST * extent + rounding;
    if !is_flat || !is_thick || thickness > THINNEST_BLOCK * shorter_side(mesh, &triangles[1]) {
        return None;
    }
    let center = middle + normal * (0.5 * (mean(front) + mean(back)));
    let bounds = bounds.grown(Vec3::splat(rounding + MOST_ASIDE * thickness));
    let facets = triangles.map(|face| face.into_iter().map(|triangle| Facet::new(mesh, triangle)).collect());
    // What lies in it is found when all are.
    Some(Slab { normal, center, thickness, ior, outline, bounds, facets, looks: looks(scene, body), is_free: false })
}

/// Triangles of the back and the front of a body, and the unit normal of the front; `None` where one of both is not there, or bent
/// by its normals.
fn faces(mesh: &Mesh, body: &[u32]) -> Option<([Vec<u32>; 2], Vec3)> {
    let largest = *body.iter().max_by(|a, b| mesh.area_m2(**a).total_cmp(&mesh.area_m2(**b)))?;
    let toward = mesh.area_normal(largest).try_normalize()?;
    let (mut triangles, mut sum) = ([Vec::new(), Vec::new()], Vec3::ZERO);
    for &triangle in body {
        let across = mesh.area_normal(triangle);
        let Some(own) = across.try_normalize() else { continue };
        let cos = own.dot(toward);
        if cos.abs() <= 1.0 - LEVEL {
            continue;
        }
        let shaded = mesh.triangles[triangle as usize].map(|v| mesh.normals[v as usize].dot(own));
        if shaded.into_iter().any(|cos| cos <= 1.0 - LEVEL) {
            return None;
        }
        triangles[usize::from(cos > 0.0)].push(triangle);
        sum += across * cos.signum();
    }
    let is_whole = triangles.iter().all(|face| !face.is_empty());
    is_whole.then_some((triangles, sum.try_normalize()?))
}

/// The material of a body, which has one alone.
fn material_of<'a>(scene: &'a Scene, body: &[u32]) -> &'a Material {
    &scene.materials[scene.mesh.triangle_material[body[0] as usize] as usize]
}

/// What a body is made of, where that is the same everywhere.
fn looks(scene: &Scene, body: &[u32]) -> Option<SurfaceParams> {
    let (mesh, material) = (&scene.mesh, material_of(scene, body));
    let textures = [
        material.base_color_texture,
        material.metallic_roughness_texture,
        material.transmission_texture,
        material.specular_texture,
        material.specular_color_texture,
    ];
    let mut vertices = body.iter().flat_map(|&triangle| mesh.triangles[triangle as usize]);
    let is_colored = !mesh.colors.is_empty() && vertices.any(|vertex| mesh.colors[vertex as usize] != Vec4::ONE);
    let is_even = !is_colored && textures.iter().all(Option::is_none);
    is_even.then(|| surface_params(material, &scene.textures, [Vec2::ZERO; 2], None))
}

fn around(mesh: &Mesh, triangles: &[u32]) -> Bounds {
    triangles.iter().flat_map(|&t| mesh.corners(t)).fold(Bounds::default(), Bounds::with)
}

/// About the shorter extent of a flat face, m: its area over its greatest extent.
fn shorter_side(mesh: &Mesh, face: &[u32]) -> f32 {
    let total: f32 = face.iter().map(|&t| mesh.area_m2(t)).sum();
    let bounds = around(mesh, face);
    total / (bounds.hi - bounds.lo).length()
}
