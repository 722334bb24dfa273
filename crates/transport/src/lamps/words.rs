//! A lamp in plain words for a device.

use glam::Vec3;

use super::PreparedLamps;
use super::body::Body;
use super::light::{Form, NEAR};
use crate::emitters::spot_rise;
use crate::prepared::PreparedScene;
use crate::scene::PunctualKind;

/// A lamp as a device takes it.
#[derive(Clone, Debug)]
pub struct LampWords {
    /// Kind (0 point, 1 spot, 2 parallel light, 3 rectangle, 4 disk, 5 sphere) and three words that are the device's own; then
    /// bits of f32: place and area; axis or normal, and one minus the cosine of a spot's outer angle or of the radius of a disk far away; half of each side of a flat body (of a lamp without size
    /// unit vectors to its right and its upper side), beside them one
    /// over how much of that its rise to the full intensity takes and the squared distance within which its points are chosen by the angle that it fills
    /// (of a sphere its squared radius); emission, and a distance beyond everything. Then of a measured distribution the numbers of vertical and
    /// of horizontal angles, and 1 where its planes meet across the aim; and one more word that is the device's own.
    pub lamp: [u32; 28],
    /// Of a measured distribution: vertical and horizontal angles in radians, and intensities over the largest, horizontal × vertical. Empty
    /// of other lamps.
    pub distribution: Vec<f32>,
}

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
    /// The lamp, if it is one alone.
    pub fn words(&self, scene: &PreparedScene) -> Option<LampWords> {
        let [lamp] = self.lamps() else { return None };
        let plain = plain(&lamp.lamp.form);
        let (counts, distribution) = match &lamp.lamp.form {
            Form::Point { profile: Some(profile), .. } => profile.words(),
            _ => ([0; 3], Vec::new()),
        };
        let rows = [
            plain.position.extend(plain.area),
            plain.axis.extend(plain.rim),
            plain.half[0].extend(plain.per_cos),
            plain.half[1].extend(plain.near),
            lamp.emission.extend(scene.far()),
        ];
        let mut words = [0; 28];
        words[0] = plain.kind;
        let numbers = rows.iter().flat_map(|row| row.to_array());
        words[4..].iter_mut().zip(numbers).for_each(|(word, number)| *word = number.to_bits());
        words[24..27].copy_from_slice(&counts);
        Some(LampWords { lamp: words, distribution })
    }
}

fn plain(form: &Form) -> Plain {
    match form {
        Form::Point { light, .. } => {
            let (axis, half) = (light.direction, light.across);
            let plain = Plain { position: light.position, axis, half, ..Plain::default() };
            match light.kind {
                PunctualKind::Spot { inner_rad, outer_rad } => {
                    let [rim, rise] = spot_rise(inner_rad, outer_rad);
                    Plain { kind: 1, rim, per_cos: 1.0 / rise, ..plain }
                }
                PunctualKind::Point | PunctualKind::Directional => plain,
            }
        }
        Form::Distant { direction: axis, one_minus_cos: rim } => {
            Plain { kind: 2, axis: *axis, rim: *rim, ..Plain::default() }
        }
        Form::Body(body) => {
            let (position, radius) = body.ball();
            let (kind, axis, half, reach) = match body {
                Body::Rectangle { half, normal, .. } => (3, *normal, *half, NEAR * radius),
                Body::Disk { radii, normal, .. } => (4, *normal, *radii, NEAR * radius),
                Body::Sphere { .. } => (5, Vec3::ZERO, [Vec3::ZERO; 2], radius),
            };
            Plain { kind, position, area: body.area(), axis, half, near: reach * reach, ..Plain::default() }
        }
    }
}
