//! Lights of the file in the picture: marks where its lamps hang, and the name of what shines under the pointer.

use clerestory_transport::basis::{LightBasis, LightSource, SourceKind};
use clerestory_transport::bvh::Ray;
use clerestory_transport::emitters::{Emitter, Lighting};
use clerestory_transport::prepared::PreparedScene;
use clerestory_transport::sampler::Sampler;
use clerestory_transport::scene::PunctualLight;
use eframe::egui::accesskit::Role;
use eframe::egui::{
    self, Align2, Color32, CursorIcon, FontId, Id, Painter, PointerButton, Pos2, Rect, Response, RichText, Sense,
    Stroke, Ui, Vec2, vec2,
};
use glam::Vec3;

use super::gizmo::{Sight, scale_of};
use super::lamps::{hint, tell};
use super::probe::choose;
use crate::action::Action;
use crate::look::Look;
use crate::panels::lamps::{Pick, Unmovable, make_movable_ui};
use crate::panels::lights::{LightsState, letters_menu};
use crate::panels::menu::context_menu;
use crate::theme;

/// Half a side of what is taken hold of, points.
const REACH: f32 = 7.0;
/// Radius of a mark, points.
const RADIUS: f32 = 4.0;
/// How strong a mark is that nobody points at.
const WEAK: f32 = 0.55;
/// Most selected lights whose names stand in the picture.
const MOST_NAMES: usize = 8;
/// Rays that are sent for the marks of a frame at most.
const MOST_RAYS: usize = 400;
/// Share of the light of a lamp behind glass that must come through for its mark to be seen.
const SEEN: f32 = 0.05;
/// How far before a lamp it is asked what hides it, m; in a model, which is seen from closer than a room, as much less.
const BEFORE_M: f32 = 0.15;
/// What the menu of a lamp says that the picture does not know.
const NOT_BAKED: &str = "Not in this bake: open its scene and bake it again to set this lamp";

/// Draws a mark where each lamp of the file is seen while the pointer is in the picture; a click on one chooses it, a drag takes
/// it along. `baked` are the lights of the picture, which are not those of a file that was changed since. Answers whether one is under the
/// pointer.
pub fn marks_ui(
    ui: &Ui,
    picture: &Response,
    (sight, baked): (&Sight, Option<&LightBasis>),
    look: &mut Look,
    lights: &mut LightsState,
    actions: &mut Vec<Action>,
) -> bool {
    let painter = ui.painter_at(picture.rect.intersect(sight.image));
    let is_near = ui.input(|input| input.pointer.hover_pos()).is_some_and(|at| picture.rect.contains(at));
    let is_meant = |lights: &LightsState, key: &str| lights.is_selected(key) || lights.chosen.as_deref() == Some(key);
    let replaced = look.lights.replaced();
    let in_view = lamps(sight.scene).filter_map(|(source, light)| {
        // A lamp that was moved away hangs there no longer.
        let is_there = !replaced.contains(source.key.as_str()) && (is_near || is_meant(lights, &source.key));
        let at = sight.seen_at(light.position).filter(|at| is_there && painter.clip_rect().contains(*at))?;
        Some((source, light, at))
    });
    let in_view: Vec<(&LightSource, &PunctualLight, Pos2)> = in_view.collect();
    let in_view = with_ray(in_view, |(source, ..)| is_meant(lights, &source.key));
    let is_baked = |key: &str| baked.is_none_or(|basis| basis.source(key).is_some());
    let mut touched = false;
    for (source, light, at) in in_view {
        if !is_seen(sight, light.position) {
            continue;
        }
        let is_measured = light.profile.is_some();
        let name = look.name_of(&source.key);
        let is_chosen = is_meant(lights, &source.key);
        let rect = Rect::from_center_size(at, Vec2::splat(2.0 * REACH));
        let response =
            ui.interact(rect, Id::unique(("lamp of the file", source.key.as_str())), Sense::click_and_drag());
        response.widget_info(|| egui::WidgetInfo::labeled(egui::Role::Button, true, format!("{name} in the picture")));
        let strength = if response.hovered() || is_chosen { 1.0 } else { WEAK };
        let color = if is_chosen { theme::ACCENT } else { Color32::from_gray(235) };
        ring(&painter, at, color.gamma_multiply(strength));
        theme::keyboard_frame(ui, &response);
        if response.hovered() {
            ui.ctx().set_cursor_icon(CursorIcon::PointingHand);
            let drag = match is_measured {
                _ if !is_baked(&source.key) => "it is not in this bake",
                true => "it is measured and stays where it is",
                false => "drag to move it",
            };
            hint(ui, picture.rect, &format!("{name}, click to choose it, {drag}"));
        }
        // Who presses before the mark is known to be under the pointer has hold of the picture.
        let pressed = ui.input(|input| input.pointer.press_origin()).unwrap_or(at);
        let of_picture = picture.drag_started_by(PointerButton::Primary) && rect.contains(pressed);
        let is_pulled = response.drag_started_by(PointerButton::Primary) || of_picture;
        if is_pulled && !is_measured {
            let at = pressed;
            lights.lamps.pulled_at = Some(at);
            actions.push(Action::PullLamp { key: source.key.clone(), at: at.into() });
        }
        // Chosen, it stays there while its menu is open. The handles of another lamp go: keys are not for that one any more.
        if response.clicked() {
            choose(lights, &source.key, Pick::of(ui.input(|input| input.modifiers)));
        } else if response.secondary_clicked() {
            choose(lights, &source.key, Pick::Alone);
        }
        context_menu(&response, |ui| match is_baked(&source.key) {
            true => mark_menu(ui, (&source.key, is_measured), (look, lights), actions),
            false => _ = ui.label(RichText::new(NOT_BAKED).weak()),
        });
        touched |= response.hovered() || response.clicked();
    }
    touched
}

/// Lamps for whose marks a ray is sent in a frame: those that are meant, then others, the first ones of each.
fn with_ray<T>(lamps: Vec<T>, is_meant: impl Fn(&T) -> bool) -> Vec<T> {
    let n_meant = lamps.iter().filter(|lamp| is_meant(lamp)).count().min(MOST_RAYS);
    let mut n_left = [MOST_RAYS - n_meant, n_meant];
    let has_ray = |lamp: &T| {
        let n_left = &mut n_left[usize::from(is_meant(lamp))];
        let has_ray = *n_left > 0;
        *n_left = n_left.saturating_sub(1);
        has_ray
    };
    lamps.into_iter().filter(has_ray).collect()
}

fn mark_menu(
    ui: &mut Ui,
    (key, is_measured): (&str, bool),
    (look, lights): (&mut Look, &mut LightsState),
    actions: &mut Vec<Action>,
) {
    letters_menu(ui, key, &mut look.lights, &mut lights.solo);
    make_movable_ui(ui, key, is_measured.then_some(Unmovable::Measured), actions);
}

fn ring(painter: &Painter, at: Pos2, color: Color32) {
    painter.circle_stroke(at, RADIUS, Stroke::new(3.0, Color32::from_black_alpha(110)));
    painter.circle_stroke(at, RADIUS, Stroke::new(1.4, color));
}

/// Shows where the lights are that are selected in the list, and the one whose name is under the pointer there: a ring, weak behind
/// something, and of a few the name.
pub fn selected_ui(
    ui: &Ui,
    picture: &Response,
    sight: &Sight,
    look: &Look,
    (lights, pointed): (&LightsState, Option<&str>),
) {
    let painter = ui.painter_at(picture.rect.intersect(sight.image));
    let is_meant = |key: &str| lights.is_selected(key) || pointed == Some(key);
    let sources = sight.scene.lighting.basis.sources.iter();
    let replaced = look.lights.replaced();
    let sources = sources.filter(|source| is_meant(&source.key) && !replaced.contains(source.key.as_str()));
    let of_file = sources.filter_map(|source| {
        let has_mark = matches!(source.kind, SourceKind::Point | SourceKind::Spot) && lights.is_selected(&source.key);
        Some((source.key.as_str(), source.origin.position?, has_mark))
    });
    // Lamps that were added have their handles.
    let added = look.lights.lamps.iter().filter(|lamp| pointed == Some(lamp.key.as_str()));
    let added = added.map(|lamp| (lamp.key.as_str(), lamp.position, false));
    let places: Vec<(&str, Vec3, bool)> = of_file.chain(added).collect();
    // Each of these has its mark as well, where it is to have one.
    let mut n_rays = MOST_RAYS - 1;
    for &(key, place, has_mark) in &places {
        let Some(at) = sight.seen_at(place).filter(|at| painter.clip_rect().contains(*at)) else { continue };
        // Of more lights than anybody tells apart it is not asked whether something hides them.
        let (name, is_clear) = (look.name_of(key), n_rays > 0 && is_seen(sight, place));
        n_rays = n_rays.saturating_sub(1);
        // A lamp that nothing hides has its mark already.
        if !(is_clear && has_mark) {
            ring(&painter, at, theme::ACCENT.gamma_multiply(if is_clear { 1.0 } else { WEAK }));
            let rect = Rect::from_center_size(at, Vec2::splat(2.0 * REACH));
            let id = Id::unique(("selected in the picture", key));
            tell(ui.ctx(), id, (Role::Mark, &format!("{name} is here")), rect);
        }
        if places.len() <= MOST_NAMES || pointed == Some(key) {
            name_tag(&painter, at, name);
        }
    }
}

/// A name beside a place, on a dark ground.
fn name_tag(painter: &Painter, at: Pos2, name: &str) {
    let galley = painter.layout_no_wrap(name.to_owned(), FontId::proportional(11.5), Color32::from_gray(230));
    let place = beside(at, galley.size(), painter.clip_rect());
    painter.rect_filled(place.expand2(vec2(4.0, 2.0)), 3.0, Color32::from_black_alpha(150));
    painter.galley(place.min, galley, Color32::WHITE);
}

/// Where words of a size stand beside a place: to the right, unless they are cut there and would not be to the left.
fn beside(at: Pos2, size: Vec2, seen: Rect) -> Rect {
    let away = vec2(REACH + 6.0, 0.0);
    let [right, left] = [(Align2::LEFT_CENTER, away), (Align2::RIGHT_CENTER, -away)]
        .map(|(anchor, away)| anchor.anchor_size(at + away, size));
    if right.right() > seen.right() && left.left() >= seen.left() { left } else { right }
}

/// Says the name of the shining surface under the pointer. Panels say more, elsewhere.
pub fn surface_hint(ui: &Ui, picture: &Response, sight: &Sight, look: &Look) {
    let pointer = picture.hover_pos().filter(|at| sight.image.contains(*at));
    let Some(source) = pointer.and_then(|at| shining_at(sight, at)) else { return };
    if !matches!(source.kind, SourceKind::Panel { .. } | SourceKind::Constant) {
        hint(ui, picture.rect, &format!("{}, click to see what lights this", look.name_of(&source.key)));
    }
}

/// The light whose surface is seen at a place on the screen.
pub fn shining_at<'a>(sight: &Sight<'a>, at: Pos2) -> Option<&'a LightSource> {
    let ray = Ray { origin: sight.camera.position(), direction: sight.direction(at), t_min: 0.0, t_max: f32::INFINITY };
    let hit = sight.scene.closest_seen(&ray, &mut Sampler::new(0, 0, 0))?;
    let lighting = &sight.scene.lighting;
    let source = lighting.triangle_source[hit.triangle as usize];
    (source != Lighting::NONE).then(|| &lighting.basis.sources[source as usize])
}

/// Lamps of the file that hang somewhere.
fn lamps(scene: &PreparedScene) -> impl Iterator<Item = (&LightSource, &PunctualLight)> {
    let lights = scene.lighting.basis.sources.iter().zip(&scene.lighting.emitters);
    lights.filter_map(|(source, emitter)| match (emitter, source.kind) {
        (Emitter::Punctual(light), SourceKind::Point | SourceKind::Spot) => Some((source, light)),
        _ => None,
    })
}

/// Whether nothing hides a point. Lamps often hang a hair behind the surface of their own housing.
fn is_seen(sight: &Sight, point: Vec3) -> bool {
    let eye = sight.camera.position();
    let before_m = BEFORE_M * scale_of(eye.distance(point)).min(1.0);
    let near = point + (eye - point).clamp_length_max(before_m);
    sight.scene.transmittance(eye, near).max_element() > SEEN
}

#[cfg(test)]
mod tests {
    use clerestory_transport::camera::{Camera, Film};
    use eframe::egui::pos2;

    use super::*;
    use crate::support::scaled_room;

    #[test]
    fn what_hides_a_lamp_hides_it_in_a_model_of_centimeters_as_well() {
        // A closed box from −1 to 1, and one of a hundredth of that.
        for scale in [1.0, 0.01] {
            let scene = PreparedScene::new(scaled_room(scale), &[]).unwrap().0;
            let camera = Camera::look_at("c", Vec3::Z * (0.9 * scale), Vec3::NEG_Z, 1.0, 1.0);
            let image = Rect::from_min_size(pos2(0.0, 0.0), vec2(64.0, 64.0));
            let sight = Sight { scene: &scene, camera: &camera, film: Film { width: 64, height: 64 }, image };
            assert!(is_seen(&sight, Vec3::NEG_Z * (0.5 * scale)));
            assert!(is_seen(&sight, Vec3::NEG_Z * (1.05 * scale)), "a hair behind the wall");
            assert!(!is_seen(&sight, Vec3::NEG_Z * (3.0 * scale)), "{scale}");
        }
    }

    #[test]
    fn a_name_stands_where_all_of_it_is_seen() {
        let seen = Rect::from_min_max(pos2(0.0, 0.0), pos2(300.0, 200.0));
        let place = |x: f32, width: f32| beside(pos2(x, 100.0), vec2(width, 14.0), seen);
        assert!(place(150.0, 80.0).left() > 150.0 && seen.contains_rect(place(150.0, 80.0)));
        assert!(place(290.0, 80.0).right() < 290.0 && seen.contains_rect(place(290.0, 80.0)));
        assert!(place(150.0, 250.0).left() > 150.0, "its beginning, where there is no room for all of it");
    }

    #[test]
    fn a_frame_sends_no_more_rays_than_it_may_and_what_is_selected_comes_first() {
        assert_eq!(with_ray((0..MOST_RAYS).collect(), |_| false), Vec::from_iter(0..MOST_RAYS));
        let some = with_ray((0..3 * MOST_RAYS).collect(), |lamp| *lamp >= 2 * MOST_RAYS && *lamp % 2 == 0);
        let others = MOST_RAYS / 2;
        assert!(some.len() == MOST_RAYS && some[..others].iter().copied().eq(0..others));
        assert!(some[others..].iter().copied().eq((2 * MOST_RAYS..3 * MOST_RAYS).step_by(2)));
        assert_eq!(with_ray((0..3 * MOST_RAYS).collect(), |_| true), Vec::from_iter(0..MOST_RAYS));
    }
}
