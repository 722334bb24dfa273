//! Views to come back to, as a look keeps them: numbers of a glTF camera, so that they come back exactly.

use anyhow::{Result, anyhow, ensure};
use clerestory_transport::camera::Camera;
use glam::{Mat3, Mat4, Vec4};
use serde_json::Value;

use super::parse::Reader;
use super::write::{member, value};

/// Bookmarks of one document.
const MAX_BOOKMARKS: usize = 500;
/// How far a matrix may be from a rotation.
const TURN_SLACK: f32 = 1e-3;

/// Whether a file holds one more of them.
pub fn has_room(bookmarks: &[Camera]) -> bool {
    bookmarks.len() < MAX_BOOKMARKS
}

/// The bookmarks as a member of the document; none without any.
pub(super) fn json(bookmarks: &[Camera]) -> Option<String> {
    let lines: Vec<String> = bookmarks.iter().map(|camera| format!("    {}", camera_json(camera))).collect();
    (!lines.is_empty()).then(|| format!("  \"bookmarks\": [\n{}\n  ]", lines.join(",\n")))
}

/// A camera on one line.
pub(super) fn camera_json(camera: &Camera) -> String {
    let mut members = vec![
        format!("\"name\": {}", value(&camera.name)),
        member("matrix", &camera.world_from_camera.to_cols_array()),
        member("yfov", &camera.yfov_rad),
        member("aspect", &camera.aspect),
    ];
    if camera.shift != [0.0; 2] {
        members.push(member("shift", &camera.shift));
    }
    format!("{{ {} }}", members.join(", "))
}

impl Reader<'_> {
    /// Views to come back to.
    pub(super) fn bookmarks(&mut self, value: &Value) -> Result<Vec<Camera>> {
        let list = self.array(value)?;
        ensure!(list.len() <= MAX_BOOKMARKS, "a look has at most {MAX_BOOKMARKS} bookmarks, not {}", list.len());
        let bookmarks = list.iter().enumerate().map(|(idx, value)| self.part(idx, |reader| reader.camera(value)));
        bookmarks.filter_map(Result::transpose).collect()
    }

    /// A camera that may stand anywhere.
    pub(super) fn camera(&mut self, value: &Value) -> Result<Camera> {
        let object = self.object(value)?;
        self.report_unknown(object, &["name", "matrix", "yfov", "aspect", "shift"]);
        let missing = |reader: &Reader, key: &str| anyhow!("`{}.{key}` is missing: a view needs it", reader.name());
        let name = self.optional(object, "name", |r, v| r.text(v))?.ok_or_else(|| missing(self, "name"))?;
        let matrix = self.optional(object, "matrix", |r, v| r.numbers::<16>(v, &(-1e6..=1e6)))?;
        let world_from_camera = Mat4::from_cols_array(&matrix.ok_or_else(|| missing(self, "matrix"))?);
        let turn = Mat3::from_mat4(world_from_camera);
        let is_turn = (turn * turn.transpose()).abs_diff_eq(Mat3::IDENTITY, TURN_SLACK) && turn.determinant() > 0.0;
        ensure!(
            is_turn && world_from_camera.row(3) == Vec4::W,
            "`{}.matrix` must turn and move only, 16 numbers column by column",
            self.name()
        );
        let yfov_rad = self.optional(object, "yfov", |r, v| r.number(v, &(1e-3..=3.1)))?;
        let most = f64::from(Camera::MOST_SHIFT);
        Ok(Camera {
            name,
            world_from_camera,
            yfov_rad: yfov_rad.ok_or_else(|| missing(self, "yfov"))?,
            aspect: self.optional(object, "aspect", |r, v| r.number(v, &(0.01..=100.0)))?.unwrap_or(16.0 / 9.0),
            shift: self.optional(object, "shift", |r, v| r.numbers(v, &(-most..=most)))?.unwrap_or_default(),
        })
    }
}

#[cfg(test)]
mod tests {
    use glam::{Quat, Vec3};

    use super::super::Look;
    use super::*;

    fn view() -> Camera {
        let turn = Quat::from_rotation_y(0.3) * Quat::from_rotation_x(-0.1);
        Camera {
            name: "Entrance, \"left\"".into(),
            world_from_camera: Mat4::from_rotation_translation(turn, Vec3::new(0.1, 1.6, 3.0)),
            yfov_rad: 0.7,
            aspect: 1.5,
            shift: [0.0, 0.125],
        }
    }

    #[test]
    fn views_come_back_to_the_last_bit() {
        let look = Look { bookmarks: vec![view(), Camera { shift: [0.0; 2], ..view() }], ..Look::default() };
        let (back, warnings) = Look::from_json(&look.to_json()).unwrap();
        assert_eq!(back, look);
        assert!(warnings.is_empty(), "{warnings:?}");
    }

    #[test]
    fn a_file_with_as_many_views_as_there_is_room_for_is_read() {
        let mut look = Look::default();
        while has_room(&look.bookmarks) {
            look.bookmarks.push(view());
        }
        assert_eq!(Look::from_json(&look.to_json()).unwrap().0, look);
        look.bookmarks.push(view());
        assert!(Look::from_json(&look.to_json()).is_err());
    }

    #[test]
    fn a_view_that_is_none_is_told_with_its_place() {
        let json = Look { bookmarks: vec![view()], ..Look::default() }.to_json();
        let stretched = Camera { world_from_camera: Mat4::from_scale(Vec3::splat(2.0)), ..view() };
        let stretched = Look { bookmarks: vec![stretched], ..Look::default() }.to_json();
        let cases = [
            (stretched.clone(), "`bookmarks[0].matrix` must turn and move only"),
            (json.replace("0.7", "7"), "`bookmarks[0].yfov`"),
            (json.replace("\"yfov\"", "\"lens\""), "`bookmarks[0].yfov` is missing"),
            (json.replace("0.125", "9"), "`bookmarks[0].shift`"),
        ];
        for (json, words) in cases {
            let error = format!("{:#}", Look::from_json(&json).unwrap_err());
            assert!(error.contains(words), "{error}");
            assert!(Look::recover(&json).is_ok(), "{words}");
        }
        assert!(Look::recover(&stretched).unwrap().0.bookmarks.is_empty(), "what is no view is left out");
    }
}
