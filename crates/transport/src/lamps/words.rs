//! A lamp in plain words for a device.

use glam::Vec3;

use super::PreparedLamps;
use super::body::Body;
use super::light::{Form, NEAR};
use crate::emitters::spot_rise;
use crate::prepared::PreparedScene;
use crate::scene::PunctualKind;

/// As a device takes it: kind (0 point, 1 spot, 2 parallel light, 3 rectangle, 4 disk, 5 sphere) and three words that are its own; then
/// bits of f32: place and area; axis or normal, and one minus the cosine of a spot's outer angle or of the radius of a disk far away; half of each side of a flat body, beside them one
/// over how much of that its rise to the full intensity takes and the squared distance within which its points are chosen by the angle that it fills
/// (of a sphere its squared radius); emission, and a distance beyond everything.
pub type LampWords = [u32; 24];

/// The same before it is packed.
#[derive(Clone, Copy, Default)]
struct Plain {
    kind: u32,
    position: Vec3,
    area: f32,
    axis: Vec3,
    rim: f32,
    half: [Vec3; 2],
    per_cos: f32,
    near: f32,
}

impl PreparedLamps {
    /// The lamp, if it is one alone and no measured distribution.
    pub fn words(&self, scene: &PreparedScene) -> Option<LampWords> {
        let [lamp] = self.lamps() else { return None };
        let plain = plain(&lamp.lamp.form)?;
        let rows = [
            plain.position.extend(plain.area),
            plain.axis.extend(plain.rim),
            plain.half[0].extend(plain.per_cos),
            plain.half[1].extend(plain.near),
            lamp.emission.extend(scene.far()),
        ];
        let mut words = [0; 24];
        words[0] = plain.kind;
        let numbers = rows.iter().flat_map(|row| row.to_array());
        words[4..].iter_mut().zip(numbers).for_each(|(word, number)| *word = number.to_bits());
        Some(words)
    }
}

fn plain(form: &Form) -> Option<Plain> {
    match form {
        Form::Point { profile: Some(_), .. } => None,
        Form::Point { light, .. } => {
            let plain = Plain { position: light.position, axis: light.direction, ..Plain::default() };
            Some(match light.kind {
                PunctualKind::Spot { inner_rad, outer_rad } => {
                    let [rim, rise] = spot_rise(inner_rad, outer_rad);
                    Plain { kind: 1, rim, per_cos: 1.0 / rise, ..plain }
                }
                PunctualKind::Point | PunctualKind::Directional => plain,
            })
        }
        Form::Distant { direction: axis, one_minus_cos: rim } => {
            Some(Plain { kind: 2, axis: *axis, rim: *rim, ..Plain::default() })
        }
        Form::Body(body) => {
            let (position, radius) = body.ball();
            let (kind, axis, half, reach) = match body {
                Body::Rectangle { half, normal, .. } => (3, *normal, *half, NEAR * radius),
                Body::Disk { radii, normal, .. } => (4, *normal, *radii, NEAR * radius),
                Body::Sphere { .. } => (5, Vec3::ZERO, [Vec3::ZERO; 2], radius),
            };
            Some(Plain { kind, position, area: body.area(), axis, half, near: reach * reach, ..Plain::default() })
        }
    }
}
