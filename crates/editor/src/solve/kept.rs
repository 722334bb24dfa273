//! Wishes of a look where they are to be solved: which of them fit the bake that is shown, and why the others do not.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::sync::Arc;

use clerestory_relight::Tone;

use super::parse::matching;
use super::{Exposure, Freedom, Place, Request, Target, TargetPicture, Wish};
use crate::look::Units;
use crate::look::wishes::{Entry, Wanted, Where, Wishes};
use crate::marks::Framing;

/// Pictures to match by their files, or why one cannot be had.
pub type Pictures = BTreeMap<String, Result<Arc<TargetPicture>, String>>;

/// What wishes are about.
pub struct Here<'a> {
    /// The picture that is shown.
    pub framing: Option<Framing>,
    /// Sensor grids of its bake: number and name.
    pub grids: Vec<(usize, String)>,
    /// What the numbers of the picture count.
    pub units: Units,
    /// Whether the light that arrives at the pixels was baked.
    pub has_illuminance: bool,
    /// Pictures that were read.
    pub pictures: Cow<'a, Pictures>,
}

impl Here<'_> {
    /// What is to be solved: the wishes that fit, by lights of which some are held.
    pub fn request(&self, wishes: &Wishes, lights: &[String]) -> Request {
        let free = lights.iter().filter(|key| !wishes.held.contains(*key)).cloned().collect();
        let freedom = wishes.colors.map_or(Freedom::Intensity, |most_saturation| Freedom::Color { most_saturation });
        Request {
            wishes: wishes.list.iter().filter_map(|entry| self.wish(entry)).collect(),
            lights: Some(free),
            bounds: wishes.bounds,
            freedom,
            keep: wishes.keep,
            ..Request::default()
        }
    }

    /// Why a wish cannot be solved here, and what to do about it.
    pub fn misfit(&self, entry: &Entry) -> Option<Cow<'static, str>> {
        let of_place = match &entry.place {
            Where::Whole => None,
            Where::Marked(marked) => (!self.framing.as_ref().is_some_and(|shown| marked.framing.fits(shown)))
                .then_some("Marked in another view: show that view, or mark it here again".into()),
            Where::Sensors(name) => (self.grid(name).is_none()).then(|| no_sensors(name).into()),
        };
        of_place.or_else(|| match &entry.wanted {
            Wanted::Lux(_) if !self.has_illuminance && !matches!(entry.place, Where::Sensors(_)) => {
                Some("This bake holds no illuminance: bake with illuminance".into())
            }
            Wanted::Match { file, .. } => match self.pictures.get(file) {
                Some(Ok(_)) => None,
                Some(Err(why)) => Some(why.clone().into()),
                None => Some("The picture is being read".into()),
            },
            _ => None,
        })
    }

    /// The tone curve and the exposure that a picture is taken to be shown with, once it is read.
    pub fn shown_with(&self, file: &str, tone: Option<Tone>, exposure_ev: Option<f64>) -> Option<(Tone, Exposure)> {
        let picture = self.pictures.get(file)?.as_ref().ok()?;
        let exposure = match exposure_ev {
            None if picture.was_encoded() => Exposure::Free,
            ev => Exposure::Ev(ev.unwrap_or(0.0)),
        };
        Some((tone.unwrap_or(picture.display.tone), exposure))
    }

    fn grid(&self, name: &str) -> Option<usize> {
        self.grids.iter().find(|(_, own)| own == name).map(|(set, _)| *set)
    }

    /// A wish as it is solved; what does not fit is left out, and said in the panel.
    fn wish(&self, entry: &Entry) -> Option<Wish> {
        if self.misfit(entry).is_some() {
            return None;
        }
        let place = match &entry.place {
            Where::Whole => Place::Whole,
            Where::Marked(marked) => Place::Marks(marked.on(self.framing.as_ref()?)?),
            Where::Sensors(name) => Place::Grid(self.grid(name)?),
        };
        let target = match &entry.wanted {
            Wanted::Lux(lux) => Target::Illuminance(*lux),
            Wanted::Luminance(nit) => Target::Luminance(*nit),
            Wanted::Times(times) => Target::Times(*times),
            Wanted::Keep => Target::Keep,
            Wanted::Match { file, tone, exposure_ev } => {
                matching(self.pictures.get(file)?.as_ref().ok()?.clone(), *exposure_ev, *tone)
            }
        };
        Some(Wish { name: entry.name.clone(), place, target, weight: entry.weight })
    }
}

fn no_sensors(name: &str) -> String {
    format!("This bake has no sensors {name}: bake the scene with its illuminance; a work plane is laid in Measure")
}

#[cfg(test)]
mod tests {
    use clerestory_transport::camera::{Camera, Film};
    use glam::Vec3;

    use super::*;
    use crate::marks::{Marked, Marks};

    fn framing(x: f32, width: u32) -> Framing {
        let camera = Camera::look_at("a", Vec3::new(x, 1.0, 2.0), Vec3::ZERO, 0.8, 1.5);
        Framing { film: Film { width, height: width * 2 / 3 }, camera: Some(camera) }
    }

    fn here(framing: Framing) -> Here<'static> {
        let picture = TargetPicture::of("there.exr", [1, 1], vec![[1.0; 3]]);
        let pictures = Pictures::from([
            ("there.exr".to_owned(), Ok(Arc::new(picture))),
            ("gone.exr".to_owned(), Err("cannot read gone.exr".to_owned())),
        ]);
        let grids = vec![(3, "Floor".to_owned())];
        let units = Units::Photometric;
        Here { framing: Some(framing), grids, units, has_illuminance: false, pictures: Cow::Owned(pictures) }
    }

    fn wishes() -> Wishes {
        let marks = |framing: Framing| {
            let marks = Arc::new(Marks::rect(framing.film, [[0.0, 0.0], [6.0, 4.0]]));
            Where::Marked(Marked { framing, marks })
        };
        let picture = |file: &str| Wanted::Match { file: file.into(), tone: None, exposure_ev: None };
        let mut wishes = Wishes::default();
        wishes.push("here", marks(framing(1.0, 12)), Wanted::Luminance(5.0));
        wishes.push("elsewhere", marks(framing(2.0, 12)), Wanted::Keep);
        wishes.push("no lux", marks(framing(1.0, 12)), Wanted::Lux(5.0));
        wishes.push("floor", Where::Sensors("Floor".into()), Wanted::Lux(300.0));
        wishes.push("desks", Where::Sensors("Desks".into()), Wanted::Lux(500.0));
        for file in ["there.exr", "gone.exr", "coming.exr"] {
            wishes.push(file, Where::Whole, picture(file));
        }
        wishes
    }

    #[test]
    fn wishes_that_fit_are_solved_and_the_others_say_why_not() {
        let (here, wishes) = (here(framing(1.0, 24)), wishes());
        let request = here.request(&wishes, &["a".into(), "b".into()]);
        let names: Vec<&str> = request.wishes.iter().map(|wish| wish.name.as_str()).collect();
        assert_eq!(names, ["here", "floor", "there.exr"]);
        assert!(matches!(request.wishes[1].place, Place::Grid(3)));
        let Place::Marks(marks) = &request.wishes[0].place else { panic!("it is marked") };
        assert_eq!(**marks, Marks::rect(Film { width: 24, height: 16 }, [[0.0, 0.0], [12.0, 8.0]]), "at its size");
        let words = ["another view", "no illuminance", "no sensors Desks", "cannot read gone.exr", "is being read"];
        let told: Vec<_> = wishes.list.iter().filter_map(|entry| here.misfit(entry)).collect();
        assert!(
            told.len() == words.len() && told.iter().zip(words).all(|(told, word)| told.contains(word)),
            "{told:?}"
        );
    }

    #[test]
    fn lights_that_are_held_do_not_change() {
        let wishes = Wishes { held: ["b".to_owned()].into(), colors: Some(0.2), ..wishes() };
        let request = here(framing(1.0, 12)).request(&wishes, &["a".into(), "b".into()]);
        assert_eq!(request.lights, Some(vec!["a".to_owned()]));
        assert_eq!(request.freedom, Freedom::Color { most_saturation: 0.2 });
    }
}
