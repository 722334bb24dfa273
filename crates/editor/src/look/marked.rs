//! Marks and probes of a look, from JSON and back, each with the picture that they are in.

use std::ops::RangeInclusive;
use std::sync::Arc;

use anyhow::{Result, anyhow, ensure};
use clerestory_transport::camera::Film;
use serde_json::{Map, Value};

use super::bookmarks::camera_json;
use super::parse::Reader;
use super::write::{member, value};
use crate::marks::{Framing, Marked, Marks, Probed};

/// Pixels that one document may mark, over all of its wishes: a short file must not fill the memory.
pub(super) const MOST_MARKED: usize = 1 << 26;
/// Probes of one view, and views with probes.
const MOST_PROBES: usize = 1000;

/// Marks as an object on one line.
pub(super) fn json(marked: &Marked) -> String {
    let mut members = framing_members(&marked.framing);
    members.push(format!("\"runs\": {}", value(&marked.marks.runs())));
    format!("{{ {} }}", members.join(", "))
}

/// The member `probes`, if there are any.
pub(super) fn probes_json(probes: &[Probed]) -> Option<String> {
    let line = |probed: &Probed| {
        let mut members = framing_members(&probed.framing);
        members.push(member("pixels", &probed.pixels));
        format!("    {{ {} }}", members.join(", "))
    };
    let lines: Vec<String> = probes.iter().map(line).collect();
    (!lines.is_empty()).then(|| format!("  \"probes\": [\n{}\n  ]", lines.join(",\n")))
}

fn framing_members(framing: &Framing) -> Vec<String> {
    let film = member("film", &[framing.film.width, framing.film.height]);
    let view = framing.camera.as_ref().map(|camera| format!("\"view\": {}", camera_json(camera)));
    [Some(film), view].into_iter().flatten().collect()
}

impl Reader<'_> {
    /// What is marked in a picture; `left` is how many pixels the document may still mark.
    pub(super) fn marked(&mut self, value: &Value, left: &mut usize) -> Result<Marked> {
        let object = self.object(value)?;
        self.report_unknown(object, &["film", "view", "runs"]);
        let framing = self.framing(object)?;
        let runs = self.optional(object, "runs", |r, v| r.whole_numbers(v, &(0..=u32::MAX)))?;
        let runs = runs.ok_or_else(|| anyhow!("`{}.runs` is missing: marks need it", self.name()))?;
        let n_marked: usize =
            runs.iter().skip(1).step_by(2).fold(0, |sum: usize, run| sum.saturating_add(*run as usize));
        let rest = left.checked_sub(n_marked);
        *left = rest.ok_or_else(|| anyhow!("the look marks more than {MOST_MARKED} pixels"))?;
        let Film { width, height } = framing.film;
        let marks = Marks::of_runs(framing.film, &runs);
        let marks = marks.ok_or_else(|| anyhow!("`{}.runs` leaves the picture of {width} × {height}", self.name()))?;
        Ok(Marked { framing, marks: Arc::new(marks) })
    }

    /// Probes, view by view.
    pub(super) fn probes(&mut self, value: &Value) -> Result<Vec<Probed>> {
        let list = self.array(value)?;
        ensure!(list.len() <= MOST_PROBES, "a look has probes in at most {MOST_PROBES} views, not {}", list.len());
        let probes = list.iter().enumerate().map(|(idx, value)| self.part(idx, |reader| reader.probed(value)));
        probes.filter_map(Result::transpose).collect()
    }

    fn probed(&mut self, value: &Value) -> Result<Probed> {
        let object = self.object(value)?;
        self.report_unknown(object, &["film", "view", "pixels"]);
        let framing = self.framing(object)?;
        let pixels = self.optional(object, "pixels", |r, v| r.pixels(v, framing.film))?;
        let pixels = pixels.ok_or_else(|| anyhow!("`{}.pixels` is missing: probes need it", self.name()))?;
        Ok(Probed { framing, pixels })
    }

    fn pixels(&mut self, value: &Value, film: Film) -> Result<Vec<[u32; 2]>> {
        let list = self.array(value)?;
        ensure!(list.len() <= MOST_PROBES, "a view has at most {MOST_PROBES} probes, not {}", list.len());
        let pixel = |reader: &mut Reader, value: &Value| {
            let pair = <[u32; 2]>::try_from(reader.whole_numbers(value, &(0..=Film::MAX_SIDE))?);
            let inside = pair.ok().filter(|[x, y]| *x < film.width && *y < film.height);
            let Film { width, height } = film;
            inside.ok_or_else(|| {
                anyhow!("`{}` must be a pixel [x, y] of the picture of {width} × {height}", reader.name())
            })
        };
        let pixels = list.iter().enumerate().map(|(idx, value)| self.part(idx, |reader| pixel(reader, value)));
        pixels.filter_map(Result::transpose).collect()
    }

    /// The picture that something is in: `film`, and `view` where it has one.
    fn framing(&mut self, object: &Map<String, Value>) -> Result<Framing> {
        let film = self.optional(object, "film", |r, v| r.whole_numbers(v, &(1..=Film::MAX_SIDE)))?;
        let film = film.and_then(|sides| <[u32; 2]>::try_from(sides).ok());
        let [width, height] =
            film.ok_or_else(|| anyhow!("`{}.film` must be the size of a picture, [width, height]", self.name()))?;
        let camera = self.optional(object, "view", |r, v| r.camera(v))?;
        // What was marked in a view that cannot be read would be taken for one of every view.
        let names_one = object.get("view").is_some_and(|view| !view.is_null());
        ensure!(camera.is_some() || !names_one, "`{}.view` is no view", self.name());
        Ok(Framing { film: Film { width, height }, camera })
    }

    fn whole_numbers(&mut self, value: &Value, range: &RangeInclusive<u32>) -> Result<Vec<u32>> {
        let whole = |value: &Value| {
            let number = value.as_u64().and_then(|number| u32::try_from(number).ok());
            number.filter(|number| range.contains(number))
        };
        let numbers: Option<Vec<u32>> = self.array(value)?.iter().map(whole).collect();
        numbers.ok_or_else(|| {
            anyhow!("`{}` must be a list of whole numbers from {} to {}", self.name(), range.start(), range.end())
        })
    }
}

#[cfg(test)]
mod tests {
    use clerestory_transport::camera::Camera;
    use glam::Vec3;

    use super::*;
    use crate::look::Look;

    const FILM: Film = Film { width: 12, height: 9 };

    fn framing() -> Framing {
        Framing {
            film: FILM,
            camera: Some(Camera::look_at("Entrance", Vec3::new(0.1, 1.6, 3.0), Vec3::ZERO, 0.8, 1.5)),
        }
    }

    fn rich() -> Look {
        let marks = Arc::new(Marks::stroke(FILM, [[2.0, 2.0], [9.0, 7.0]], 1.7));
        let of_stack = Framing { film: FILM, camera: None };
        let probes = [framing(), of_stack].map(|framing| Probed { framing, pixels: vec![[0, 0], [11, 8]] });
        Look { marks: Some(Marked { framing: framing(), marks }), probes: probes.to_vec(), ..Look::default() }
    }

    #[test]
    fn marks_and_probes_come_back_pixel_by_pixel() {
        let look = rich();
        let (back, warnings) = Look::from_json(&look.to_json()).unwrap();
        assert_eq!(back, look);
        assert!(warnings.is_empty(), "{warnings:?}");
        assert!(!Look::default().to_json().contains("marks"));
    }

    #[test]
    fn what_is_no_mark_is_told_with_its_place_and_the_rest_is_kept() {
        let json = rich().to_json();
        let film = "\"film\": [12, 9]";
        let cases = [
            (json.replacen(film, "\"film\": [12]", 1), "`marks.film`"),
            (json.replacen(film, "\"film\": [12, 4000000000]", 1), "`marks.film`"),
            (json.replacen(film, "\"film\": [2, 2]", 1), "`marks.runs` leaves the picture"),
            (json.replacen("\"runs\"", "\"rows\"", 1), "`marks.runs` is missing"),
            (json.replacen("\"runs\": [", "\"runs\": [-1, ", 1), "`marks.runs`"),
            (json.replacen("[11, 8]", "[11, 9]", 1), "`probes[0].pixels[1]`"),
            (json.replacen("\"yfov\"", "\"lens\"", 1), "`marks.view.yfov` is missing"),
        ];
        for (json, words) in cases {
            let error = format!("{:#}", Look::from_json(&json).unwrap_err());
            assert!(error.contains(words), "{words}: {error}");
            let (look, warnings) = Look::recover(&json).unwrap();
            assert!(!look.probes.is_empty() && !warnings.is_empty(), "{words}: {warnings:?}");
        }
        let many =
            format!("{{\"clerestory\": 1, \"marks\": {{\"film\": [16384, 16384], \"runs\": [0, {}]}}}}", 1 << 27);
        assert!(format!("{:#}", Look::from_json(&many).unwrap_err()).contains("more than"));
    }
}
