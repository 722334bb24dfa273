//! Six framed pictures.

use std::f32::consts::{FRAC_PI_2, PI};

use glam::{Quat, Vec3, vec3};

use super::{HIGH, LOW, Stage};
use crate::art;
use crate::glb::{EncodedImage, MaterialId};
use crate::material::Material;
use crate::mesh::Mesh;
use crate::shapes::{block, picture, quad};

/// Heights of the pictures' centers in meters.
const EYE_M: f32 = 1.6;
/// Where the three pictures of the picture wall hang along z.
pub const HUNG_Z: [f32; 3] = [-3.2, -1.45, 0.3];
/// Center and size of the large picture on the back wall.
pub const LARGE: Vec3 = vec3(0.25, 1.72, LOW.z);
pub const LARGE_SIZE_M: (f32, f32) = (2.4, 1.6);

/// How a picture is framed.
struct Framing {
    /// Width and height of the picture in meters.
    size_m: (f32, f32),
    /// Width of the passe-partout in meters.
    margin_m: f32,
    frame: MaterialId,
}

pub fn build(stage: &mut Stage) {
    let (oak, black, brass) = (stage.materials.oak, stage.materials.black, stage.materials.brass);
    let right = Quat::from_rotation_y(-FRAC_PI_2);
    let upright = |frame| Framing { size_m: (0.8, 1.0), margin_m: 0.1, frame };
    let square = |frame| Framing { size_m: (0.95, 0.95), margin_m: 0.1, frame };
    let on_wall = |z: f32| vec3(HIGH.x, EYE_M, z);
    hang(stage, "picture horizon", art::horizon(), &upright(black), on_wall(HUNG_Z[0]), right);
    hang(stage, "picture orbits", art::orbits(), &square(oak), on_wall(HUNG_Z[1]), right);
    hang(stage, "picture quarters", art::quarters(), &upright(black), on_wall(HUNG_Z[2]), right);
    let large = Framing { size_m: LARGE_SIZE_M, margin_m: 0.0, frame: brass };
    hang(stage, "picture strata", art::strata(), &large, LARGE, Quat::IDENTITY);
    let entrance = Quat::from_rotation_y(PI);
    hang(stage, "picture drift", art::drift(), &square(black), vec3(-1.2, EYE_M, HIGH.z), entrance);
    let tall = Framing { size_m: (0.75, 1.0), margin_m: 0.08, frame: oak };
    hang(stage, "picture fields", art::fields(), &tall, vec3(LOW.x, 1.5, 3.6), Quat::from_rotation_y(FRAC_PI_2));
}

/// A picture whose back lies at the origin and that faces +z, moved to its place on a wall.
fn hang(stage: &mut Stage, name: &str, image: EncodedImage, framing: &Framing, place: Vec3, rotation: Quat) {
    const DEPTH_M: f32 = 0.03;
    const WIDTH_M: f32 = 0.022;
    let texture = stage.document.texture(image);
    let title = image_title(name);
    let canvas = Material { texture: Some(texture), ..Material::plain(title, Vec3::ONE, 0.65) };
    let canvas = stage.document.material(canvas);
    let (half_x, half_y) = (framing.size_m.0 / 2.0, framing.size_m.1 / 2.0);
    let image =
        picture(vec3(-half_x, -half_y, DEPTH_M - 0.008), vec3(2.0 * half_x, 0.0, 0.0), vec3(0.0, 2.0 * half_y, 0.0));
    let (x, y) = (half_x + framing.margin_m, half_y + framing.margin_m);
    let bar = |low: (f32, f32), high: (f32, f32)| block(vec3(low.0, low.1, 0.0), vec3(high.0, high.1, DEPTH_M));
    let frame = Mesh::join([
        bar((-x - WIDTH_M, -y - WIDTH_M), (x + WIDTH_M, -y)),
        bar((-x - WIDTH_M, y), (x + WIDTH_M, y + WIDTH_M)),
        bar((-x - WIDTH_M, -y), (-x, y)),
        bar((x, -y), (x + WIDTH_M, y)),
    ]);
    let mut parts = vec![(image, canvas), (frame, framing.frame)];
    if framing.margin_m > 0.0 {
        let mat = quad(vec3(-x, -y, DEPTH_M - 0.010), vec3(2.0 * x, 0.0, 0.0), vec3(0.0, 2.0 * y, 0.0));
        parts.push((mat, stage.materials.white));
    }
    let mesh = stage.document.mesh(name, &parts);
    stage.place(name, mesh, place, rotation);
}

/// The material's name: what follows `picture ` in the node's.
fn image_title(node_name: &str) -> &'static str {
    ["horizon", "orbits", "quarters", "strata", "drift", "fields"]
        .into_iter()
        .find(|title| node_name.ends_with(title))
        .unwrap_or("picture")
}
