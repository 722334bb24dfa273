//! Pictures of which nothing can be seen although lights are on.

use clerestory_relight::Radiance;
use clerestory_transport::basis::{ColumnGroup, ColumnKind, LightBasis};
use clerestory_transport::light::{LightRig, LightSetting};
use glam::Vec3;

/// Said of pictures of which nothing can be seen, such as "the picture is", under the lights of a basis.
pub(crate) fn black_words(which: &str, basis: &LightBasis) -> String {
    let why = if basis.is_measured() {
        "nothing of the lights that are on is in the pictures that were baked; see whether those are black themselves, or turn other lights on"
    } else {
        "no light reaches what the camera sees; see whether a lamp or the camera stands inside of something, or looks away"
    };
    format!("{which} black: {why}")
}

/// Whether a picture is black in every pixel although lights are on.
pub(crate) fn is_black(radiance: &Radiance, basis: &LightBasis, rig: &LightRig) -> bool {
    radiance.pixels.as_flattened().iter().all(|value| *value == 0.0) && is_lit(basis, rig)
}

/// Whether any light is on, of a basis or a free lamp. Unlit surfaces are no light.
fn is_lit(basis: &LightBasis, rig: &LightRig) -> bool {
    let is_unlit =
        |group: &ColumnGroup, column: u32| group.kind == ColumnKind::Constant && group.columns.contains(&column);
    let is_light = |column: u32| !basis.groups.iter().any(|group| is_unlit(group, column));
    let is_on = |rgb: [f32; 3]| rgb.iter().any(|value| *value > 0.0);
    let shines = |setting: LightSetting| is_on(setting.emission(Vec3::ONE, 1.0).to_array());
    (0..).zip(basis.project(rig)).any(|(column, rgb)| is_on(rgb) && is_light(column))
        || rig.lit_lamps().iter().any(|lamp| lamp.strength > 0.0 && shines(lamp.setting))
}

#[cfg(test)]
mod tests {
    use clerestory_transport::basis::{LightSource, SourceKind};
    use clerestory_transport::lamps::FreeLamp;

    use super::*;
    use crate::support::lamp;

    #[test]
    fn photographs_that_are_black_are_not_told_of_lamps_inside_of_something() {
        let words = |kind| black_words("frame 3 is", &LightBasis::new(vec![LightSource::plain("a", kind, 0..1)]));
        let (of_pictures, of_scenes) = (words(SourceKind::Image), words(SourceKind::Sky));
        assert!(of_pictures.starts_with("frame 3 is black: ") && of_pictures.contains("turn other lights on"));
        assert!(!of_pictures.contains("inside of something") && of_scenes.contains("inside of something"));
    }

    #[test]
    fn unlit_surfaces_and_muted_lamps_are_no_light_that_is_on() {
        let source = |key: &str, kind| LightSource::plain(key, kind, 0..1);
        let basis = LightBasis::new(vec![source("unlit", SourceKind::Constant), source("sky", SourceKind::Sky)]);
        let mut rig = LightRig::default();
        assert!(is_lit(&basis, &rig));
        let muted = LightSetting { muted: true, ..LightSetting::default() };
        rig.set("sky", muted);
        assert!(!is_lit(&basis, &rig));
        rig.lamps.push(FreeLamp { setting: muted, ..lamp("lamp") });
        assert!(!is_lit(&basis, &rig));
        rig.lamps[0].setting.muted = false;
        assert!(is_lit(&basis, &rig));
        let dark = Radiance { width: 1, height: 1, pixels: vec![[0.0; 3]] };
        assert!(is_black(&dark, &basis, &rig));
        rig.lamps.clear();
        assert!(!is_black(&dark, &basis, &rig), "nothing is on");
    }
}
