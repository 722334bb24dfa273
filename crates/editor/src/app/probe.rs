//! What the picture is made of where somebody looks: read again whenever the place or the picture changed.

use clerestory_transport::camera::{Camera, Film};
use clerestory_transport::light::{LightRig, luminance};

use super::follow::Follower;
use super::looks::Prints;
use crate::look::Quantity;
use crate::panels::looks::mix::Side;
use crate::session::lamps::LampLight;
use crate::session::prints::Slot;
use crate::session::{Session, Shown, shares};
use crate::viewport::probe::{Probes, Reading, Readings};

/// Reads the picture, or both sides of a comparison.
#[derive(Default)]
pub(super) struct Prober {
    /// Of which picture and which prints, where, and of which sides.
    read: (u64, u64, Probes, Option<[Side; 2]>),
    readings: [Readings; 2],
    /// What the probes are in.
    view: Option<(Film, Option<Camera>)>,
}

impl Prober {
    /// What was pointed at in another view means nothing; pins come from the look.
    pub fn heed_view(&mut self, shown: Option<&Shown>, probes: &mut Probes) {
        let is_it = |(film, camera): &(Film, Option<Camera>)| {
            shown.is_some_and(|shown| (shown.film(), &shown.camera) == (*film, camera))
        };
        if self.view.as_ref().is_none_or(|view| !is_it(view)) {
            probes.let_go();
            self.view = shown.map(|shown| (shown.film(), shown.camera.clone()));
        }
    }

    /// What is measured at some places of the picture that is shown, on each side where two are.
    pub fn read(
        &mut self,
        session: &Session,
        (follower, prints): (&Follower, &Prints),
        probes: &Probes,
        sides: Option<&[Side; 2]>,
    ) -> &[Readings; 2] {
        let asked = (follower.n_pictures(), prints.n_made(), probes.clone(), sides.cloned());
        if self.read != asked {
            let of_side = |idx: usize| {
                let shown = session.shown.as_ref()?;
                let (rig, light) = match sides.map(|sides| &sides[idx]) {
                    None if idx > 0 => return None,
                    None | Some(Side::Present) => (follower.rig()?, follower.shown_lamp_light(shown)),
                    Some(Side::Snapshot(_)) => prints.light(&Slot::Side(idx), shown)?,
                };
                Some(readings(shown, rig, light, probes))
            };
            self.readings = [0, 1].map(|idx| of_side(idx).unwrap_or_default());
            self.read = asked;
        }
        &self.readings
    }
}

fn readings(shown: &Shown, rig: &LightRig, light: Option<&LampLight>, probes: &Probes) -> Readings {
    let unit = if shown.header.basis.is_measured() { "" } else { Quantity::Luminance.unit() };
    let pixel = |px: [u32; 2]| px[1] * shown.header.width + px[0];
    let read = |px: [u32; 2]| {
        let pixel = [pixel(px)];
        let shares = shown.shares(rig, light, &pixel)?;
        let lux = shown.irradiance_at(rig, light, &pixel).map(luminance);
        Some((Reading { px, radiance: shares::sum(&shares), lux, unit }, shares))
    };
    let plain = |px: [u32; 2]| read(px).map(|(reading, _)| reading);
    Readings {
        hover: probes.hover.and_then(plain),
        picked: probes.picked.and_then(|px| {
            let (reading, mut shares) = read(px)?;
            shown.add_lux(&mut shares, rig, light, &[pixel(px)]);
            Some((reading, shares))
        }),
        pins: probes.pins.iter().filter_map(|px| plain(*px)).collect(),
    }
}
