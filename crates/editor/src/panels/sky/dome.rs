//! The sky as a disk, seen as on a plan: north, −Z, is on top, east, +X, on the right, the zenith in the middle.

use std::sync::Arc;

use clerestory_transport::light::luminance;
use clerestory_transport::sky::{
    Environment, SkyLight, SkySetting, SunPlace, SunPosition, SunSetting, SunTime, sun_direction,
};
use eframe::egui::{
    self, Align2, Color32, ColorImage, FontId, Painter, Pos2, Rect, Response, Rgba, Sense, Stroke, TextureHandle,
    TextureOptions, Ui, Vec2, vec2,
};
use glam::Vec3;

use super::sun::tidy;
use crate::panels::arrows::{FINE, arrows};
use crate::theme;

/// Width of the widget and of the disk, points.
const SIDE: f32 = 156.0;
const DISK: f32 = 128.0;
/// Pixels across the disk.
const PIXELS: usize = 128;
/// Radiance of the mean sky as it is painted, of white.
const MEAN: f32 = 0.35;
/// Radius of the sun as it is painted, points.
const SUN: f32 = 6.0;
/// What an arrow key moves: degrees, or minutes of the day.
const KEY_STEP_DEG: f64 = 1.0;
const KEY_STEP_MINUTES: f64 = 10.0;
/// Minutes of a day.
const DAY_MINUTES: f64 = 24.0 * 60.0;
/// Minutes between two points of the way of the sun.
const WAY_MINUTES: u32 = 10;

/// The picture of a map that was painted last.
#[derive(Default)]
pub(super) struct DomePicture(Option<(Arc<Environment>, f32, TextureHandle)>);

/// Draws the disk and does what is done to it: a drag or the arrow keys take the sun along, or turn a sky without one.
pub(super) fn dome_ui(ui: &mut Ui, sky: &mut SkySetting, light: &SkyLight, picture: &mut DomePicture) {
    let (rect, response) = ui.allocate_exact_size(Vec2::splat(SIDE), Sense::click_and_drag());
    let disk = Rect::from_center_size(rect.center(), Vec2::splat(DISK));
    let hint = match sky.sun.map(|sun| sun.place) {
        Some(SunPlace::Angles { .. }) => "Drag to move the sun; arrow keys go by 1°, with Shift by 0.1°",
        Some(SunPlace::Time { .. }) => {
            "Drag along the way of the sun to change the time; arrow keys go by 10 minutes, with Shift by one"
        }
        None => "Drag to turn the sky; arrow keys go by 1°, with Shift by 0.1°",
    };
    drag(&response, disk, sky);
    step(arrows(ui, &response, FINE), sky);
    if ui.is_rect_visible(rect) {
        paint(ui, disk, sky, light, picture);
        theme::keyboard_frame(ui, &response);
    }
    response.widget_info(|| egui::WidgetInfo::labeled(egui::Role::Canvas, ui.is_enabled(), "Dome of the sky"));
    response.on_hover_text(format!("{hint}\nSeen from above: −Z, an azimuth of 0°, is on top, +X on the right"));
}

/// Where a unit direction lies on the disk; those below the horizon lie beyond its edge.
fn place(disk: Rect, d: Vec3) -> Pos2 {
    let from_zenith = d.y.clamp(-1.0, 1.0).acos() / std::f32::consts::FRAC_PI_2;
    disk.center() + vec2(d.x, d.z).normalized() * (0.5 * disk.width() * from_zenith)
}

/// The azimuth and the elevation at a point; what lies beyond the edge is on the horizon.
fn position(disk: Rect, at: Pos2) -> SunPosition {
    let from_center = at - disk.center();
    let from_zenith = (from_center.length() / (0.5 * disk.width())).min(1.0);
    let azimuth_deg = f64::from(from_center.x.atan2(-from_center.y)).to_degrees().rem_euclid(360.0);
    SunPosition { azimuth_deg, elevation_deg: 90.0 * (1.0 - f64::from(from_zenith)) }
}

fn drag(response: &Response, disk: Rect, sky: &mut SkySetting) {
    let Some(at) = response.interact_pointer_pos().filter(|_| response.dragged() || response.clicked()) else { return };
    // Turned back, as the sun is turned with the sky.
    let pointed = position(disk, at);
    let azimuth_deg = (pointed.azimuth_deg + f64::from(sky.rotation_deg)).rem_euclid(360.0);
    let wanted = SunPosition { azimuth_deg, ..pointed };
    match &mut sky.sun {
        Some(SunSetting { place: SunPlace::Angles { azimuth_deg, elevation_deg }, .. }) => {
            (*azimuth_deg, *elevation_deg) = (tidy(wanted.azimuth_deg), tidy(wanted.elevation_deg));
        }
        Some(SunSetting { place: SunPlace::Time { time, north_deg }, .. }) => {
            time.hour = hour_nearest(*time, *north_deg, wanted);
        }
        None if response.dragged() => {
            let before = position(disk, at - response.drag_delta());
            let turned = (pointed.azimuth_deg - before.azimuth_deg) as f32;
            sky.rotation_deg = (sky.rotation_deg - turned + 180.0).rem_euclid(360.0) - 180.0;
        }
        None => {}
    }
}

/// Takes the sun so many steps to the right and down, or turns a sky without one clockwise as it is seen.
fn step(steps: Vec2, sky: &mut SkySetting) {
    if steps == Vec2::ZERO {
        return;
    }
    let [right, up] = [f64::from(steps.x), -f64::from(steps.y)];
    match &mut sky.sun {
        Some(SunSetting { place: SunPlace::Angles { azimuth_deg, elevation_deg }, .. }) => {
            *azimuth_deg = tidy((*azimuth_deg + right * KEY_STEP_DEG).rem_euclid(360.0));
            *elevation_deg = tidy((*elevation_deg + up * KEY_STEP_DEG).clamp(-90.0, 90.0));
        }
        Some(SunSetting { place: SunPlace::Time { time, .. }, .. }) => {
            let minutes = (60.0 * time.hour + right * KEY_STEP_MINUTES).round();
            time.hour = minutes.clamp(0.0, DAY_MINUTES) / 60.0;
        }
        None => {
            let turned = tidy(f64::from(sky.rotation_deg) - right * KEY_STEP_DEG) as f32;
            sky.rotation_deg = (turned + 180.0).rem_euclid(360.0) - 180.0;
        }
    }
}

/// The minute of a day at which the sun comes closest to a place.
fn hour_nearest(time: SunTime, north_deg: f64, wanted: SunPosition) -> f64 {
    let to = sun_direction(wanted);
    let way = way(time, north_deg, 1);
    let nearest = way.iter().max_by(|(_, a), (_, b)| a.dot(to).total_cmp(&b.dot(to)));
    nearest.map_or(time.hour, |(hour, _)| *hour)
}

/// The way of the sun over a day: hours, and unit directions towards it.
fn way(time: SunTime, north_deg: f64, step_minutes: u32) -> Vec<(f64, Vec3)> {
    let at = |minute: u32| {
        let time = SunTime { hour: f64::from(minute) / 60.0, ..time };
        let position = time.position();
        let turned = SunPosition { azimuth_deg: position.azimuth_deg + north_deg, ..position };
        (time.hour, sun_direction(turned))
    };
    (0..24 * 60).step_by(step_minutes as usize).map(at).collect()
}

fn paint(ui: &Ui, disk: Rect, sky: &SkySetting, light: &SkyLight, DomePicture(known): &mut DomePicture) {
    let is_it = |(map, turn, _): &&(Arc<Environment>, f32, TextureHandle)| {
        (map.as_ref(), *turn) == (light.map.as_ref(), light.rotation_deg)
    };
    let texture = known.as_ref().filter(is_it).map(|(_, _, texture)| texture.clone()).unwrap_or_else(|| {
        let image = image(light);
        match known.take() {
            Some((_, _, mut texture)) => {
                texture.set(image, TextureOptions::LINEAR);
                texture
            }
            None => ui.ctx().load_texture("dome", image, TextureOptions::LINEAR),
        }
    });
    *known = Some((light.map.clone(), light.rotation_deg, texture.clone()));
    let painter = ui.painter();
    let whole = Rect::from_min_max(Pos2::ZERO, egui::pos2(1.0, 1.0));
    painter.image(texture.id(), disk, whole, Color32::WHITE);
    painter.circle_stroke(disk.center(), 0.5 * DISK, ui.visuals().widgets.hovered.bg_stroke);
    let north_deg = match sky.sun.map(|sun| sun.place) {
        Some(SunPlace::Time { time, north_deg }) => {
            paint_way(painter, disk, &way(time, north_deg, WAY_MINUTES), light);
            north_deg
        }
        _ => 0.0,
    };
    let turned = north_deg - f64::from(sky.rotation_deg);
    for (name, azimuth_deg) in [("N", 0.0), ("E", 90.0), ("S", 180.0), ("W", 270.0)] {
        let d = sun_direction(SunPosition { azimuth_deg: azimuth_deg + turned, elevation_deg: 0.0 });
        let at = disk.center() + vec2(d.x, d.z) * (0.5 * DISK + 8.0);
        painter.text(at, Align2::CENTER_CENTER, name, FontId::proportional(10.5), ui.visuals().weak_text_color());
    }
    paint_sun(painter, disk, sky, light);
}

fn paint_way(painter: &Painter, disk: Rect, way: &[(f64, Vec3)], light: &SkyLight) {
    let turn = light.turn();
    for (hour, d) in way.iter().filter(|(_, d)| d.y > 0.0) {
        let radius = if hour.fract() == 0.0 { 1.8 } else { 0.9 };
        painter.circle_filled(place(disk, turn.world_from_sky(*d)), radius, Color32::from_white_alpha(190));
    }
}

/// The sun, hollow while it is below the horizon.
fn paint_sun(painter: &Painter, disk: Rect, sky: &SkySetting, light: &SkyLight) {
    let set = sky.sun.and_then(|sun| sun.position().ok()).map(sun_direction);
    let Some(direction) = set.or(light.sun.map(|sun| sun.direction)) else { return };
    let mut d = light.turn().world_from_sky(direction);
    let is_up = d.y > 0.0;
    d.y = d.y.max(0.0);
    let at = place(disk, d.normalize_or(Vec3::Y));
    if is_up {
        painter.circle_filled(at, SUN, theme::ACCENT);
    }
    painter.circle_stroke(at, SUN, Stroke::new(1.5, if is_up { Color32::WHITE } else { theme::ACCENT }));
}

/// The upper half of a map as it is turned; the mean of it is painted alike however bright it is.
fn image(light: &SkyLight) -> ColorImage {
    let mean = luminance(light.map.level_irradiance()) / std::f32::consts::PI;
    let (scale, turn) = (MEAN / mean.max(f32::MIN_POSITIVE), light.turn());
    let pixel = |idx: usize| {
        let at =
            vec2((idx % PIXELS) as f32 + 0.5, (idx / PIXELS) as f32 + 0.5) * (2.0 / PIXELS as f32) - Vec2::splat(1.0);
        let from_zenith = at.length();
        let (sin, cos) = (from_zenith.min(1.0) * std::f32::consts::FRAC_PI_2).sin_cos();
        let side = at.normalized() * sin;
        let radiance = light.map.radiance(turn.sky_from_world(Vec3::new(side.x, cos, side.y))) * scale;
        let shown = radiance / (1.0 + luminance(radiance));
        // The edge is a pixel wide.
        let cover = (0.5 * PIXELS as f32 * (1.0 - from_zenith) + 0.5).clamp(0.0, 1.0);
        let [r, g, b] = shown.min(Vec3::ONE).to_array();
        Color32::from(Rgba::from_rgba_unmultiplied(r, g, b, cover))
    };
    ColorImage::new([PIXELS, PIXELS], (0..PIXELS * PIXELS).map(pixel).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    const SQUARE: Rect = Rect { min: Pos2::ZERO, max: Pos2 { x: 100.0, y: 100.0 } };

    #[test]
    fn the_disk_is_a_plan_with_north_on_top_and_the_zenith_in_the_middle() {
        assert!((place(SQUARE, Vec3::NEG_Z) - egui::pos2(50.0, 0.0)).length() < 1e-3);
        assert!((place(SQUARE, Vec3::X) - egui::pos2(100.0, 50.0)).length() < 1e-3);
        assert!((place(SQUARE, Vec3::Y) - egui::pos2(50.0, 50.0)).length() < 1e-3);
        for (azimuth_deg, elevation_deg) in [(10.0, 5.0), (135.0, 40.0), (290.0, 80.0)] {
            let own = SunPosition { azimuth_deg, elevation_deg };
            let back = position(SQUARE, place(SQUARE, sun_direction(own)));
            assert!((back.azimuth_deg - azimuth_deg).abs() < 0.01 && (back.elevation_deg - elevation_deg).abs() < 0.01);
        }
    }

    #[test]
    fn the_time_is_found_at_which_the_sun_stands_somewhere() {
        let time =
            SunTime { date: (2026, 4, 10), hour: 3.0, utc_offset_h: 1.0, latitude_deg: 48.0, longitude_deg: 11.0 };
        let morning = SunTime { hour: 9.5, ..time };
        let position = morning.position();
        let wanted = SunPosition { azimuth_deg: position.azimuth_deg + 20.0, ..position };
        assert!((hour_nearest(time, 20.0, wanted) - 9.5).abs() < 0.03);
    }

    #[test]
    fn the_picture_shows_the_map_as_it_is_turned() {
        let map = Environment::from_fn(64, 32, |d| if d.x > 0.7 { Vec3::splat(9.0) } else { Vec3::splat(0.5) });
        let light = |rotation_deg| SkyLight { rotation_deg, ..SkyLight::new("east", map.clone()) };
        let right_and_top = |light: &SkyLight| {
            let image = image(light);
            [image[(PIXELS - 4, PIXELS / 2)].r(), image[(PIXELS / 2, 3)].r()]
        };
        let [right, top] = right_and_top(&light(0.0));
        assert!(right > 2 * top, "{right} {top}");
        let [right, top] = right_and_top(&light(90.0));
        assert!(top > 2 * right, "{right} {top}");
    }
}
