//! Pictures of a bake under one look after the other, each complete: thumbnails, comparisons, frames of a sequence.

use std::sync::Arc;

use anyhow::Result;
use clerestory_relight::Radiance;
use clerestory_transport::bake::Bake;
use clerestory_transport::camera::Film;
use clerestory_transport::sky::Backdrop;

use crate::cli::relight::{Graphics, Relighter};
use crate::export::{height_of, shrunk};
use crate::illuminance::irradiance_of;
use crate::look::{Display, Look, Quantity};
use crate::session::lamps::{LampLight, LampView, StillLamps};

/// What is pictured.
pub struct Subject {
    /// The matrix.
    pub bake: Bake,
    /// Where free lamps shine, if the scene is there.
    pub view: Option<LampView>,
}

/// How large a picture is to be.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Size {
    /// As it was baked.
    Whole,
    /// At most so many pixels wide.
    Within(u32),
}

/// Makes pictures of a subject. What two looks share is done once.
pub struct Stills {
    subject: Arc<Subject>,
    graphics: Option<Graphics>,
    relighter: Option<Relighter>,
    /// The sky that the relighter has behind its picture.
    backdrop: Option<Backdrop>,
    /// The lamps at the size of the last picture.
    lamps: Option<(Film, StillLamps)>,
}

impl Stills {
    /// On a graphics device, else on the CPU.
    pub(crate) fn new(subject: Arc<Subject>, graphics: Option<Graphics>) -> Stills {
        Stills { subject, graphics, relighter: None, backdrop: None, lamps: None }
    }

    /// How large pictures of a size are.
    pub fn film(&self, size: Size) -> Film {
        let header = &self.subject.bake.header;
        fitting(Film { width: header.width, height: header.height }, size)
    }

    /// What multiplies.
    pub(crate) fn relighter(&self) -> Option<&Relighter> {
        self.relighter.as_ref()
    }

    /// The picture under a look, nit; where the look shows illuminance and the bake has it, the light that arrives, lux. `None`
    /// if it was stopped. Lamps of the look stay dark without a scene.
    ///
    /// # Errors
    /// A failing device.
    pub fn picture(&mut self, look: &Look, size: Size, stop: &(dyn Fn() -> bool + Sync)) -> Result<Option<Radiance>> {
        let (subject, film) = (self.subject.clone(), self.film(size));
        let header = &subject.bake.header;
        let backdrop = Backdrop::new(header, &look.lights);
        let is_same_sky = match (&self.backdrop, &backdrop) {
            (None, None) => true,
            (Some(own), Some(new)) => own.shows_the_same(new),
            _ => false,
        };
        let kept = self.relighter.take().filter(|_| is_same_sky);
        let relighter = match kept {
            Some(kept) => self.relighter.insert(kept),
            None => self.relighter.insert(Relighter::new(&subject.bake, &look.lights, self.graphics.as_ref())?),
        };
        self.backdrop = backdrop;
        let Some(light) = lamp_light(&mut self.lamps, &subject, (look, film), stop) else { return Ok(None) };
        let mut coefficients = header.coefficients(&look.lights);
        if let Some(light) = &light {
            header.add_of_patches(&mut coefficients, &light.of_patches);
        }
        let whole = relighter.relight(&coefficients)?;
        let mut radiance = shrunk(&whole, [film.width, film.height]).into_owned();
        light.iter().for_each(|light| radiance.add(&light.direct));
        Ok(Some(radiance))
    }

    /// The light that arrives, if a look shows that and it was baked, lux per channel; and the display without what then cannot be
    /// shown.
    ///
    /// # Errors
    /// A failing device.
    pub fn arriving(
        &mut self,
        look: &Look,
        size: Size,
        stop: &(dyn Fn() -> bool + Sync),
    ) -> Result<(Option<Radiance>, Display)> {
        let arriving = match look.display.quantity() {
            Some(Quantity::Illuminance) => self.irradiance(look, size, stop)?,
            _ => None,
        };
        let display = if arriving.is_some() { look.display } else { look.display.of_seen_light() };
        Ok((arriving, display))
    }

    /// The light that arrives at what is seen under a look, lux per channel; `None` where it was not baked, or it was stopped.
    ///
    /// # Errors
    /// A failing device.
    pub fn irradiance(
        &mut self,
        look: &Look,
        size: Size,
        stop: &(dyn Fn() -> bool + Sync),
    ) -> Result<Option<Radiance>> {
        let (subject, film) = (self.subject.clone(), self.film(size));
        let bake = &subject.bake;
        let Some(set) = bake.pixel_irradiance() else { return Ok(None) };
        let Some(light) = lamp_light(&mut self.lamps, &subject, (look, film), stop) else { return Ok(None) };
        let of_patches = light.as_ref().map_or(&[][..], |light| &light.of_patches);
        let whole = irradiance_of(bake, set, &look.lights, of_patches)?;
        let mut arriving = shrunk(&whole, [film.width, film.height]).into_owned();
        let straight = light.iter().filter_map(|light| light.arriving.as_deref());
        straight.for_each(|straight| arriving.add(straight));
        Ok(Some(arriving))
    }

    /// The light of the free lamps of a look, if any shine; `None` if it was stopped.
    pub fn lamp_light(
        &mut self,
        look: &Look,
        size: Size,
        stop: &(dyn Fn() -> bool + Sync),
    ) -> Option<Option<LampLight>> {
        let (subject, film) = (self.subject.clone(), self.film(size));
        lamp_light(&mut self.lamps, &subject, (look, film), stop)
    }
}

/// The light of a look's lamps at a size; within it `None` if it was stopped, else what there is, if lamps shine.
fn lamp_light(
    kept: &mut Option<(Film, StillLamps)>,
    subject: &Subject,
    (look, film): (&Look, Film),
    stop: &(dyn Fn() -> bool + Sync),
) -> Option<Option<LampLight>> {
    let shining = look.lights.lit_lamps();
    let Some(view) = subject.view.as_ref().filter(|_| shining.iter().any(|lamp| !lamp.setting.muted)) else {
        return Some(None);
    };
    let (_, lamps) = match kept.take().filter(|(of, _)| *of == film) {
        Some(known) => kept.insert(known),
        None => kept.insert((film, StillLamps::new(Arc::new(LampView { film, ..view.clone() })))),
    };
    lamps.light(&shining, stop).map(Some)
}

fn fitting(film: Film, size: Size) -> Film {
    match size {
        Size::Within(width) if width < film.width => {
            Film { width, height: height_of(width, [film.width, film.height]) }
        }
        _ => film,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pictures_fit_and_are_never_larger_than_what_was_baked() {
        let film = Film { width: 12, height: 6 };
        assert_eq!(fitting(film, Size::Within(4)), Film { width: 4, height: 2 });
        assert_eq!((fitting(film, Size::Within(12)), fitting(film, Size::Whole)), (film, film));
        assert_eq!(fitting(film, Size::Within(90)), film);
    }
}
