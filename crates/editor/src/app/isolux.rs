//! Isolux lines of the picture, found beside the window whenever its light changes.

use clerestory_relight::Radiance;
use clerestory_transport::bake::BakeHeader;
use clerestory_transport::light::LightRig;

use super::App;
use super::identity::Identity;
use crate::illuminance::seen_irradiance;
use crate::isolux::{Isoline, Isolux};
use crate::panels::lights::heard;
use crate::session::Wake;
use crate::session::aside::Aside;
use crate::session::lamps::LampLight;
use crate::words::in_words;

/// What lines are of.
#[derive(Clone, PartialEq)]
struct Lined {
    isolux: Isolux,
    /// The header of the bake.
    bake: Identity<BakeHeader>,
    n_sets: usize,
    /// How often finer blocks came.
    n_lux: u64,
    rig: LightRig,
    /// The light of free lamps, if there is any.
    lamps: Option<Identity<Radiance>>,
}

/// The lines that were found last.
pub(super) struct IsoluxDesk {
    wake: Wake,
    drawn: Option<(Lined, Vec<Isoline>)>,
    drawing: Aside<(Lined, Result<Vec<Isoline>, String>)>,
}

impl IsoluxDesk {
    pub fn new(wake: Wake) -> IsoluxDesk {
        IsoluxDesk { wake, drawn: None, drawing: Aside::default() }
    }

    /// Lines of the picture: those of the light a moment ago while it changes.
    pub fn lines(&self) -> &[Isoline] {
        self.drawn.as_ref().map_or(&[], |(_, lines)| lines)
    }

    pub fn is_busy(&self) -> bool {
        self.drawing.is_busy()
    }
}

impl App {
    /// Takes lines in and asks for new ones where the light or the choice changed; every frame.
    pub(super) fn follow_isolux(&mut self) {
        match self.isolux.drawing.take() {
            Some(Ok((of, Ok(lines)))) => self.isolux.drawn = Some((of, lines)),
            Some(Ok((of, Err(words)))) => {
                self.isolux.drawn = Some((of, Vec::new()));
                self.complain(words);
            }
            Some(Err(words)) => self.complain(words),
            None => {}
        }
        let isolux = if self.hides_false_color() { Isolux::Off } else { self.look.display.isolux() };
        let shown = self.session.shown.as_ref().filter(|shown| shown.pixel_irradiance().is_some());
        let Some(shown) = shown.filter(|_| isolux != Isolux::Off) else {
            self.isolux.drawn = None;
            return;
        };
        let light = self.follower.shown_lamp_light(shown);
        let of = Lined {
            isolux,
            bake: Identity::of(&shown.header),
            n_sets: shown.irradiance.len(),
            n_lux: self.session.n_lux(),
            rig: heard(&shown.header.basis, &self.seen().lights, &self.lights.solo),
            lamps: light.map(|light| Identity::of(&light.direct)),
        };
        let is_of_these = |known: &Lined| (&known.bake, known.isolux) == (&of.bake, of.isolux);
        self.isolux.drawn.take_if(|(known, _)| !is_of_these(known));
        if self.isolux.drawn.as_ref().is_some_and(|(known, _)| *known == of) || self.isolux.is_busy() {
            return;
        }
        let (bake, added) = (shown.bake(), light.map(LampLight::added_lux).unwrap_or_default());
        let started = self.isolux.drawing.start("isolux", &self.isolux.wake, move || {
            let lines = seen_irradiance(&bake, &of.rig, &added).map(|irradiance| of.isolux.lines(&irradiance));
            let lines = lines.map_err(|error| in_words(&error));
            (of, lines)
        });
        if let Err(words) = started {
            self.complain(words);
        }
    }
}
