//! How a surface is turned to its viewer.

use glam::Vec3;

use super::SurfaceParams;
use super::layers::MIRROR_ALPHA;

/// A surface turned to its viewer.
pub(super) struct Facing {
    /// Unit normals on the viewer's side.
    pub(super) ng: Vec3,
    pub(super) ns: Vec3,
    /// Index behind the surface over the one in front.
    pub(super) eta: f32,
}

impl Facing {
    #[inline]
    pub(super) fn new(params: &SurfaceParams, ng: Vec3, ns: Vec3, wo: Vec3) -> Facing {
        let ns = if ns.dot(ng) > 0.0 { ns } else { ng };
        let ior = params.ior.max(MIN_IOR);
        if ng.dot(wo) >= 0.0 { Facing { ng, ns, eta: ior } } else { Facing { ng: -ng, ns: -ns, eta: 1.0 / ior } }
    }
}

/// An index of 0 means "reflects everything" in KHR_materials_ior; this one comes close and can be divided by.
pub(super) const MIN_IOR: f32 = 1e-3;

/// Least cosine between viewer and shading normal: a viewer below the shading horizon would see no microfacet.
const MIN_VIEW_COS: f32 = 0.01;

/// Turns a shading normal as little as needed for the viewer to be above its horizon.
pub(super) fn turned_to_viewer(ns: Vec3, wo: Vec3) -> Vec3 {
    let cos = ns.dot(wo);
    if cos >= MIN_VIEW_COS { ns } else { (ns + wo * (MIN_VIEW_COS - cos)).normalize() }
}

/// Where a surface is looked at from, and how its facets lie.
#[derive(Clone, Copy, Debug)]
pub(super) struct Pose {
    /// Tangent, bitangent and shading normal; the viewer is above.
    pub(super) frame: [Vec3; 3],
    /// Towards the viewer, in world space.
    pub(super) wo: Vec3,
    /// Index behind the surface over the one in front, as the viewer sees it.
    pub(super) eta: f32,
    /// Width of the facets' normals along tangent and bitangent.
    pub(super) alpha: [f32; 2],
}

impl Pose {
    /// Facets that are alike in all directions.
    pub(super) fn round(ns: Vec3, wo: Vec3, eta: f32, roughness: f32) -> Pose {
        let (tangent, bitangent) = ns.any_orthonormal_pair();
        Pose { frame: [tangent, bitangent, ns], wo, eta, alpha: [roughness * roughness; 2] }
    }

    /// Facets whose roughness grows with `strength` 0…1 along a direction. \[glTF2, KHR_materials_anisotropy\]
    pub(super) fn stretched(self, along: Vec3, strength: f32) -> Pose {
        let [_, _, ns] = self.frame;
        let Some(tangent) = (along - ns * ns.dot(along)).try_normalize() else { return self };
        let alpha = self.alpha[1].max(MIRROR_ALPHA);
        let stretched = alpha + (1.0 - alpha) * strength * strength;
        Pose { frame: [tangent, ns.cross(tangent), ns], alpha: [stretched, alpha], ..self }
    }
}
