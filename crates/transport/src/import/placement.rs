//! From a mesh into the world: positions, normals and tangents by one matrix.

use glam::{DMat3, DMat4, DVec3, Vec3, Vec4};

/// A transform with what follows from it.
pub(super) struct Placement {
    world_from_mesh: DMat4,
    /// Its linear part, scaled so that its largest element is 1.
    unit: DMat3,
    normal_matrix: DMat3,
    /// Whether it mirrors, so that fronts would become backs.
    pub mirrors: bool,
}

impl Placement {
    pub fn new(world_from_mesh: DMat4) -> Placement {
        let linear = DMat3::from_mat4(world_from_mesh);
        let mirrors = linear.determinant() < 0.0;
        let sign = if mirrors { -1.0 } else { 1.0 };
        // The cofactor matrix is the inverse transpose up to a factor, and exists where a scale is 0 too.
        let scale = linear.to_cols_array().into_iter().fold(f64::MIN_POSITIVE, |most, x| most.max(x.abs()));
        let unit = linear * (1.0 / scale);
        let normal_matrix = DMat3::from_cols(
            unit.y_axis.cross(unit.z_axis),
            unit.z_axis.cross(unit.x_axis),
            unit.x_axis.cross(unit.y_axis),
        ) * sign;
        Placement { world_from_mesh, unit, normal_matrix, mirrors }
    }

    pub fn position(&self, position: Vec3) -> Vec3 {
        self.world_from_mesh.transform_point3(position.as_dvec3()).as_vec3()
    }

    /// Of length 1, or 0 where it has no direction.
    pub fn normal(&self, normal: Vec3) -> Vec3 {
        unit_or_zero(self.normal_matrix * normal.as_dvec3())
    }

    /// With its handedness.
    pub fn tangent(&self, tangent: Vec4) -> Vec4 {
        let direction = unit_or_zero(self.unit * tangent.truncate().as_dvec3());
        let handedness = if (tangent.w < 0.0) == self.mirrors { 1.0 } else { -1.0 };
        direction.extend(handedness)
    }
}

fn unit_or_zero(v: DVec3) -> Vec3 {
    v.normalize_or_zero().as_vec3()
}
