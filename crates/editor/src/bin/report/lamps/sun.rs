//! Parallel light in the gallery: its rooms are closed, so that glass takes the place of the panes of its clerestory that shine.

use anyhow::{Context, Result};
use clerestory_transport::lamps::{FreeLamp, LampShape, LampUnit};
use clerestory_transport::scene::Scene;
use glam::Vec3;

use super::lamp;

/// Illuminance of what faces it, lx: about as many lumens come in by the clerestory as other lamps have.
pub const LUX: f32 = 500.0;
/// As the sun is seen, from its middle to its rim.
pub const SUN: LampShape = LampShape::Directional { radius_rad: 0.0047 };
/// Middle of the clerestory.
pub const WINDOW: Vec3 = Vec3::new(-3.3, 3.06, -0.9);
/// Material of its panes.
const PANES: &str = "sky";

/// Gives the clerestory the glass of the gallery's screen.
///
/// # Errors
/// Another scene.
pub fn glaze(scene: &mut Scene) -> Result<()> {
    let glass = scene.materials.iter().find(|material| material.is_clear_pane()).cloned();
    let panes = scene.materials.iter_mut().find(|material| material.name == PANES);
    let (glass, panes) = glass.zip(panes).context("no clear glass, or no panes that shine")?;
    *panes = glass;
    Ok(())
}

/// Parallel light along the way from one place to another.
pub fn parallel(shape: LampShape, from: Vec3, to: Vec3) -> FreeLamp {
    FreeLamp { aim: to, strength: LUX, unit: LampUnit::Lux, ..lamp(shape, from) }
}

/// A lamp at a place that shines down; parallel light comes there through the middle of the clerestory.
pub fn to_place(shape: LampShape, place: Vec3) -> FreeLamp {
    if shape.is_parallel() { parallel(shape, WINDOW, place) } else { lamp(shape, place) }
}

#[cfg(test)]
mod tests {
    use clerestory::headless::GALLERY;
    use clerestory_transport::import;
    use clerestory_transport::lamps::PreparedLamps;
    use clerestory_transport::prepared::PreparedScene;

    use super::*;

    #[test]
    fn the_sun_comes_into_the_gallery_through_glass_alone() {
        let place = Vec3::new(0.9, 1.0, 1.5);
        let sun = PreparedLamps::new(&[to_place(SUN, place)], None).unwrap().0;
        let lux = |glazed: bool| {
            let mut scene = import::load_bytes("gallery.glb", GALLERY).unwrap().scene;
            if glazed {
                glaze(&mut scene).unwrap();
            }
            let scene = PreparedScene::new(scene, &[]).unwrap().0;
            sun.irradiance(&scene, place, (WINDOW - place).normalize(), None).y
        };
        assert_eq!(lux(false), 0.0);
        let through_glass = lux(true);
        assert!(through_glass > 0.5 * LUX && through_glass < LUX, "{through_glass}");
        assert!(glaze(&mut Scene::default()).is_err());
    }

    #[test]
    fn only_parallel_light_comes_from_elsewhere() {
        let place = Vec3::new(0.9, 1.0, 1.5);
        let (sun, point) = (to_place(SUN, place), to_place(LampShape::Point, place));
        assert_eq!((sun.position, sun.aim, sun.unit), (WINDOW, place, LampUnit::Lux));
        assert_eq!((point.position, point.aim, point.unit), (place, place - Vec3::Y, LampUnit::Lumen));
    }
}
