//! Shapes: quads, boxes with sharp and with round edges, bodies of revolution, tubes, leaves.

use std::f32::consts::{FRAC_PI_4, PI, TAU};

use glam::{Vec2, Vec3, vec2, vec3};

use crate::mesh::{Mesh, Vertex};

/// Profiles that turn by less than this stay smooth (cosine of about 40°).
const SMOOTH_COS: f32 = 0.77;

/// A parallelogram in front of which `u × v` points; UVs are meters, v down.
pub fn quad(origin: Vec3, u: Vec3, v: Vec3) -> Mesh {
    let normal = u.cross(v).normalize();
    let size = vec2(u.length(), v.length());
    quad_with_uvs(origin, u, v, normal, size)
}

/// A parallelogram whose UVs are (0, 0) at the top left and (1, 1) at the bottom right, `u` to the right, `v` up.
pub fn picture(origin: Vec3, u: Vec3, v: Vec3) -> Mesh {
    quad_with_uvs(origin, u, v, u.cross(v).normalize(), Vec2::ONE)
}

fn quad_with_uvs(origin: Vec3, u: Vec3, v: Vec3, normal: Vec3, uv_size: Vec2) -> Mesh {
    Mesh::grid(2, 2, |row, column| {
        let (s, t) = (column as f32, row as f32);
        Vertex { position: origin + s * u + t * v, normal, uv: vec2(s, 1.0 - t) * uv_size }
    })
}

/// A box between two corners.
pub fn block(low: Vec3, high: Vec3) -> Mesh {
    let size = high - low;
    let faces = Vec3::AXES.iter().enumerate().flat_map(|(axis, &normal)| {
        // The grain of a texture runs along the longer side of each face.
        let (a, b) = ((axis + 1) % 3, (axis + 2) % 3);
        let (long, short) = if size[a] >= size[b] { (a, b) } else { (b, a) };
        [(low[axis], -normal), (high[axis], normal)].map(|(level, normal)| {
            Mesh::grid(2, 2, |row, column| {
                let mut position = low;
                position[axis] = level;
                position[long] += column as f32 * size[long];
                position[short] += row as f32 * size[short];
                Vertex { position, normal, uv: vec2(position[long], position[short]) }
            })
        })
    });
    Mesh::join(faces)
}

/// A box of a size around the origin with edges of a radius in meters.
pub fn rounded_block(size: Vec3, radius: f32) -> Mesh {
    const STEPS: usize = 5;
    let core = size / 2.0 - radius;
    // Offsets from the core's corner: equal angles from the face's plane to its edge at 45°.
    let offsets = |half: f32| -> Vec<f32> {
        let rise = |i: usize| radius * (FRAC_PI_4 * i as f32 / STEPS as f32).tan();
        let upper = (0..=STEPS).map(|i| half + rise(i));
        (0..=STEPS).rev().map(|i| -half - rise(i)).chain(upper).collect()
    };
    let faces = (0..3).flat_map(|axis| {
        let (a, b) = ((axis + 1) % 3, (axis + 2) % 3);
        let (rows, columns) = (offsets(core[a]), offsets(core[b]));
        [-1.0, 1.0].map(|side| {
            Mesh::grid(rows.len(), columns.len(), |row, column| {
                let mut outer = Vec3::ZERO;
                outer[axis] = side * (core[axis] + radius);
                outer[a] = rows[row];
                outer[b] = columns[column];
                let inner = outer.clamp(-core, core);
                let normal = (outer - inner).normalize();
                Vertex { position: inner + radius * normal, normal, uv: vec2(outer[a], outer[b]) }
            })
        })
    });
    Mesh::join(faces)
}

/// A body of revolution about +y: the profile runs through (radius, height), its outside to the right of its way up.
pub fn lathe(profile: &[(f32, f32)], n_segments: usize) -> Mesh {
    let points: Vec<Vec2> = profile.iter().map(|&(radius, height)| vec2(radius, height)).collect();
    let outward = |i: usize| {
        let along = (points[i + 1] - points[i]).normalize();
        vec2(along.y, -along.x)
    };
    let n_bands = points.len() - 1;
    let joined = |own: Vec2, other: Vec2| if own.dot(other) > SMOOTH_COS { (own + other).normalize() } else { own };
    let bands = (0..n_bands).map(|i| {
        let own = outward(i);
        let first = if i > 0 { joined(own, outward(i - 1)) } else { own };
        let last = if i + 1 < n_bands { joined(own, outward(i + 1)) } else { own };
        Mesh::grid(2, n_segments + 1, |row, column| {
            let point = points[i + row];
            let normal = [first, last][row];
            let around = column as f32 / n_segments as f32;
            let (sin, cos) = turn(column % n_segments, n_segments);
            Vertex {
                position: vec3(point.x * cos, point.y, point.x * sin),
                normal: vec3(normal.x * cos, normal.y, normal.x * sin),
                uv: vec2(around, point.y),
            }
        })
    });
    Mesh::join(bands)
}

fn turn(step: usize, n_steps: usize) -> (f32, f32) {
    (TAU * step as f32 / n_steps as f32).sin_cos()
}

/// A closed cylinder that stands on the origin.
pub fn cylinder(radius: f32, height: f32, n_segments: usize) -> Mesh {
    lathe(&[(0.0, 0.0), (radius, 0.0), (radius, height), (0.0, height)], n_segments)
}

/// A sphere around the origin.
pub fn sphere(radius: f32, n_segments: usize) -> Mesh {
    let n_rows = n_segments / 2;
    Mesh::grid(n_rows + 1, n_segments + 1, |row, column| {
        let (sin_polar, cos_polar) = match row {
            0 => (0.0, 1.0),
            last if last == n_rows => (0.0, -1.0),
            _ => (PI * row as f32 / n_rows as f32).sin_cos(),
        };
        let (sin, cos) = turn(column % n_segments, n_segments);
        let normal = vec3(sin_polar * cos, cos_polar, sin_polar * sin);
        Vertex { position: radius * normal, normal, uv: vec2(column as f32, row as f32) / n_segments as f32 }
    })
}

/// A tube of a radius along a closed curve about the origin; `curve` takes 0…1.
pub fn closed_tube(curve: impl Fn(f32) -> Vec3, radius: f32, n_along: usize, n_around: usize) -> Mesh {
    let ring = |i: usize| {
        let t = (i % n_along) as f32 / n_along as f32;
        let (here, next) = (curve(t), curve(t + 1e-3));
        let along = next - here;
        let side = along.cross(next + here).normalize();
        (here, side.cross(along).normalize(), side)
    };
    let rings: Vec<_> = (0..=n_along).map(ring).collect();
    Mesh::grid(n_along + 1, n_around + 1, |row, column| {
        let (center, across, side) = rings[row];
        let (sin, cos) = turn(column % n_around, n_around);
        let normal = cos * across + sin * side;
        let uv = vec2(row as f32 / n_along as f32, column as f32 / n_around as f32);
        Vertex { position: center + radius * normal, normal, uv }
    })
}

/// A ring that lies in the xz plane.
pub fn torus(radius: f32, tube_radius: f32) -> Mesh {
    let circle = |t: f32| radius * vec3((TAU * t).cos(), 0.0, (TAU * t).sin());
    closed_tube(circle, tube_radius, 96, 32)
}

/// A (p, q) torus knot about the z axis.
pub fn torus_knot(p: f32, q: f32, radius: f32, tube_radius: f32) -> Mesh {
    let knot = |t: f32| {
        let (around, winding) = (TAU * p * t, TAU * q * t);
        let reach = radius * (2.0 + winding.cos()) / 3.0;
        vec3(reach * around.cos(), reach * around.sin(), radius * winding.sin() / 3.0)
    };
    closed_tube(knot, tube_radius, 320, 24)
}

/// A leaf from the origin along +x that droops by an angle in radians and is cupped along its rib.
pub fn leaf(length: f32, width: f32, droop_rad: f32) -> Mesh {
    const ALONG: usize = 10;
    const ACROSS: usize = 6;
    let surface = |t: f32, s: f32| {
        let bend = droop_rad * t;
        let half = 0.5 * width * (PI * t.powf(0.8)).sin().max(0.0);
        let rib = length * t * vec3(bend.cos(), -bend.sin(), 0.0);
        rib + vec3(0.0, 0.35 * half * s * s, half * s)
    };
    Mesh::grid(ALONG + 1, ACROSS + 1, |row, column| {
        let t = row as f32 / ALONG as f32;
        let s = 2.0 * column as f32 / ACROSS as f32 - 1.0;
        // The normal is taken a little inside, where the leaf has width.
        let inside = t.clamp(0.05, 0.95);
        let along = surface(inside + 0.01, s) - surface(inside - 0.01, s);
        let across = surface(inside, s + 0.01) - surface(inside, s - 0.01);
        Vertex { position: surface(t, s), normal: across.cross(along).normalize(), uv: vec2(t, s) }
    })
}
