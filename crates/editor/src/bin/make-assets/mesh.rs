//! Triangle meshes and what can be done with them.

use glam::{Affine3A, Quat, Vec2, Vec3};

/// A vertex; lengths in meters.
#[derive(Clone, Copy)]
pub struct Vertex {
    /// Position.
    pub position: Vec3,
    /// Unit normal.
    pub normal: Vec3,
    /// Texture coordinates, v down.
    pub uv: Vec2,
}

/// An indexed triangle mesh, counter-clockwise seen from the front.
#[derive(Clone, Default)]
pub struct Mesh {
    /// Vertices.
    pub vertices: Vec<Vertex>,
    /// Vertex indices.
    pub triangles: Vec<[u32; 3]>,
}

impl Mesh {
    /// A grid of `rows` × `columns` vertices joined by quads, turned so that the faces agree with the normals.
    pub fn grid(rows: usize, columns: usize, vertex: impl Fn(usize, usize) -> Vertex) -> Mesh {
        let vertices = (0..rows * columns).map(|i| vertex(i / columns, i % columns)).collect();
        let index = |row: usize, column: usize| u32::try_from(row * columns + column).expect("meshes are small");
        let mut triangles = Vec::new();
        for row in 0..rows - 1 {
            for column in 0..columns - 1 {
                let [a, b] = [index(row, column), index(row, column + 1)];
                let [c, d] = [index(row + 1, column), index(row + 1, column + 1)];
                triangles.extend([[a, b, d], [a, d, c]]);
            }
        }
        Mesh { vertices, triangles }.faced()
    }

    /// The parts as one mesh.
    pub fn join(parts: impl IntoIterator<Item = Mesh>) -> Mesh {
        parts.into_iter().fold(Mesh::default(), |mut all, part| {
            let offset = u32::try_from(all.vertices.len()).expect("meshes are small");
            all.vertices.extend(part.vertices);
            all.triangles.extend(part.triangles.iter().map(|t| t.map(|i| i + offset)));
            all
        })
    }

    /// Moved by an offset in meters.
    pub fn at(self, x: f32, y: f32, z: f32) -> Mesh {
        self.transformed(Affine3A::from_translation(Vec3::new(x, y, z)))
    }

    /// Turned about the origin.
    pub fn turned(self, rotation: Quat) -> Mesh {
        self.transformed(Affine3A::from_quat(rotation))
    }

    /// Moved rigidly.
    pub fn transformed(mut self, transform: Affine3A) -> Mesh {
        for vertex in &mut self.vertices {
            vertex.position = transform.transform_point3(vertex.position);
            vertex.normal = transform.transform_vector3(vertex.normal).normalize();
        }
        self
    }

    /// With texture coordinates times a factor.
    pub fn tiled(mut self, factor: f32) -> Mesh {
        for vertex in &mut self.vertices {
            vertex.uv *= factor;
        }
        self
    }

    /// Unit tangents along u for each vertex, `w` the sign that makes `w · normal × tangent` point up the image.
    pub fn tangents(&self) -> Vec<[f32; 4]> {
        let mut sums = vec![(Vec3::ZERO, Vec3::ZERO); self.vertices.len()];
        for triangle in &self.triangles {
            let [a, b, c] = triangle.map(|i| self.vertices[i as usize]);
            let (edge_b, edge_c) = (b.position - a.position, c.position - a.position);
            let (uv_b, uv_c) = (b.uv - a.uv, c.uv - a.uv);
            let orientation = uv_b.perp_dot(uv_c).signum();
            let along_u = (edge_b * uv_c.y - edge_c * uv_b.y) * orientation;
            let along_v = (edge_c * uv_b.x - edge_b * uv_c.x) * orientation;
            for &i in triangle {
                sums[i as usize].0 += along_u;
                sums[i as usize].1 += along_v;
            }
        }
        let tangent = |(vertex, (along_u, along_v)): (&Vertex, (Vec3, Vec3))| {
            let tangent = along_u.reject_from_normalized(vertex.normal).normalize();
            let up = vertex.normal.cross(tangent).dot(-along_v);
            tangent.extend(up.signum()).to_array()
        };
        self.vertices.iter().zip(sums).map(tangent).collect()
    }

    /// Drops triangles without area and turns the others to the side of their normals.
    fn faced(mut self) -> Mesh {
        let vertices = &self.vertices;
        self.triangles.retain_mut(|triangle| {
            let [a, b, c] = triangle.map(|i| vertices[i as usize]);
            let area_normal = (b.position - a.position).cross(c.position - a.position);
            if area_normal.dot(a.normal + b.normal + c.normal) < 0.0 {
                triangle.swap(1, 2);
            }
            area_normal.length() > 1e-10
        });
        self
    }
}
