//! Finds the slabs of a scene: closed bodies of smooth glass whose greatest faces are flat and parallel.

use glam::{Vec2, Vec4};

use super::{Bounds, Face, Facet, NONE, PARALLEL, Slab, Slabs};
use crate::bsdf::{SurfaceParams, surface_params};
use crate::scene::{AlphaMode, Material, Mesh, Scene};

/// Thickness over the shorter extent of a face up to which a body is a pane and not a block.
const THINNEST_BLOCK: f32 = 0.5;
/// Distance of a vertex from a plane over the extent of the body, up to which it lies in it.
const FLAT: f32 = 1e-5;

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
        slabs
    }

    fn add(&mut self, slab: Slab, n_triangles: usize) {
        self.faces.resize(n_triangles, (NONE, Face::Back));
        for (face, facets) in [Face::Back, Face::Front].into_iter().zip(&slab.facets) {
            for facet in facets {
                self.faces[facet.triangle as usize] = (self.slabs.len() as u32, face);
            }
        }
        self.bounds = self.bounds.with(slab.bounds.lo).with(slab.bounds.hi);
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
    let (mesh, material) = (&scene.mesh, material_of(scene, body));
    let largest = *body.iter().max_by(|a, b| area(mesh, **a).total_cmp(&area(mesh, **b)))?;
    let normal = mesh.area_normal(largest).try_normalize()?;
    let (mut triangles, mut spans) = ([Vec::new(), Vec::new()], [[f32::INFINITY, f32::NEG_INFINITY]; 2]);
    let mut bounds = Bounds::default();
    for &triangle in body {
        let corners = mesh.corners(triangle);
        bounds = corners.into_iter().fold(bounds, Bounds::with);
        let Some(own) = mesh.area_normal(triangle).try_normalize() else { continue };
        let cos = own.dot(normal);
        if cos.abs() <= 1.0 - PARALLEL {
            continue;
        }
        let shaded = mesh.triangles[triangle as usize].map(|v| mesh.normals[v as usize].dot(own));
        if shaded.into_iter().any(|cos| cos <= 1.0 - PARALLEL) {
            return None;
        }
        let face = usize::from(cos > 0.0);
        triangles[face].push(triangle);
        let [lo, hi] = spans[face];
        let offsets = corners.map(|corner| corner.dot(normal));
        spans[face] = [offsets.into_iter().fold(lo, f32::min), offsets.into_iter().fold(hi, f32::max)];
    }
    let extent = (bounds.hi - bounds.lo).length();
    let flat = spans.iter().all(|[lo, hi]| hi - lo <= FLAT * extent);
    let offsets = spans.map(|[lo, hi]| 0.5 * (lo + hi));
    let thickness = offsets[1] - offsets[0];
    if !flat
        || thickness.is_nan()
        || thickness <= FLAT * extent
        || thickness > THINNEST_BLOCK * shorter_side(mesh, &triangles[1])
    {
        return None;
    }
    let facets = triangles.map(|face| face.into_iter().map(|triangle| Facet::new(mesh, triangle)).collect());
    let bounds = bounds.grown(FLAT * extent);
    Some(Slab { normal, offsets, ior: material.ior, bounds, facets, looks: looks(scene, body) })
}

/// The material of a body, which has one alone.
fn material_of<'a>(scene: &'a Scene, body: &[u32]) -> &'a Material {
    &scene.materials[scene.mesh.triangle_material[body[0] as usize] as usize]
}

/// What a body is made of, where that is the same everywhere.
fn looks(scene: &Scene, body: &[u32]) -> Option<SurfaceParams> {
    let (mesh, material) = (&scene.mesh, material_of(scene, body));
    let textures = [material.base_color_texture, material.metallic_roughness_texture, material.transmission_texture];
    let mut vertices = body.iter().flat_map(|&triangle| mesh.triangles[triangle as usize]);
    let is_colored = !mesh.colors.is_empty() && vertices.any(|vertex| mesh.colors[vertex as usize] != Vec4::ONE);
    let is_even = !is_colored && textures.iter().all(Option::is_none);
    is_even.then(|| surface_params(material, &scene.textures, [Vec2::ZERO; 2], None))
}

/// About the shorter extent of a flat face, m: its area over its greatest extent.
fn shorter_side(mesh: &Mesh, face: &[u32]) -> f32 {
    let total: f32 = face.iter().map(|&t| area(mesh, t)).sum();
    let bounds = face.iter().flat_map(|&t| mesh.corners(t)).fold(Bounds::default(), Bounds::with);
    total / (bounds.hi - bounds.lo).length()
}

fn area(mesh: &Mesh, triangle: u32) -> f32 {
    0.5 * mesh.area_normal(triangle).length()
}
